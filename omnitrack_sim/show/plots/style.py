"""Style of all figures, and how they are made and written.

Matplotlib is loaded by the first figure.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import clipped, shown
from omnitrack_sim.base.writing import format_of, write_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GREY, INK, ALARM = "#7a7f87", "#22262b", "#c8322b"
CURVE_COLOURS = (
    (0.10, 0.45, 0.80),
    (0.95, 0.55, 0.05),
    (0.05, 0.62, 0.42),
    (0.80, 0.32, 0.55),
    (0.45, 0.40, 0.75),
    (0.35, 0.35, 0.35),
)
"""Red, green, blue of curves in one panel, told apart with any colour vision."""
PAGE, COLUMN = 7.16, 3.5
"""Widths of a page and of one of two columns of a paper, inches."""
DPI = 220
"""Dots per inch of bitmaps: a page, and any wider figure, is 1575 pixels wide."""
FORMATS = ("png", "svg", "pdf")
_NOTEBOOK_DPI = 110
"""Dots per inch in a notebook, where a page is then as wide as the text."""
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#b9bec6",
    "grid.linewidth": 0.4,
    "xtick.color": INK,
    "ytick.color": INK,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "svg.hashsalt": "omnitrack_sim",
    # Letters as TrueType fonts, which journals ask for, not as drawings (type 3).
    "pdf.fonttype": 42,
    # Names come from users. They are drawn as they are, whatever they mean to TeX.
    "text.parse_math": False,
    "text.usetex": False,
}
PAPER: dict[Any, Any] = {
    "font.size": 7.5,
    "axes.labelsize": 7.5,
    "axes.titlesize": 7.5,
    "axes.linewidth": 0.5,
    "lines.linewidth": 0.9,
    "legend.fontsize": 7.0,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.3,
    "legend.borderaxespad": 0.0,
    "legend.borderpad": 0.0,
}
"""Changes of ``STYLE`` for figures as wide as a page or a column: text that can be read there."""
TICKS: dict[str, Any] = {"labelsize": 6.5, "length": 2.0, "width": 0.5, "pad": 1.8}
"""Their ticks, for ``tick_params``."""
_UNSTAMPED: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    "svg": {"Date": None, "Creator": None},
}
"""Metadata without date and program, so that equal figures give equal bytes."""
_NOT_TOLD = ("Glyph .* missing from font", "constrained_layout not applied")
"""Beginnings of warnings about names that have letters the font lacks, or hundreds of them."""
_Drawn = TypeVar("_Drawn")


class PictureWarning(UserWarning):
    """A picture could not be made; its data are saved."""


def attempt(what: str, draw: Callable[[], _Drawn], again: str = "") -> _Drawn | None:
    """Call ``draw`` and return its result; None, with a ``PictureWarning``, if it raises.

    For pictures of what has been computed: whatever is wrong with one, the data are not lost;
    ``again`` makes it from the data later.
    """
    try:
        return draw()
    except Exception as error:
        cause = f"{error}" or type(error).__name__
        later = f"; the data are saved, {again} draws it again" if again else ""
        warnings.warn(f"no {what}: {cause}{later}", PictureWarning, stacklevel=2)
        return None


@contextmanager
def style(more: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """Apply the package's style, updated by ``more``, as a context or as a decorator."""
    import matplotlib

    # Of physics that has diverged, numbers may be none or too large.
    quiet = np.errstate(invalid="ignore", over="ignore")
    with matplotlib.rc_context(STYLE | dict(more or {})), warnings.catch_warnings(), quiet:
        for beginning in _NOT_TOLD:
            warnings.filterwarnings("ignore", beginning, UserWarning)
        yield


def new_figure(size: tuple[float, float], **options: Any) -> Figure:
    """An empty figure of ``size`` inches.

    It belongs to no window and to no list of open figures, so it goes when nothing holds it any
    more. It shows itself in notebooks, and has the package's style wherever it is drawn.
    """
    return _figure_class()(figsize=size, **options)


@cache
def _figure_class() -> type[Figure]:
    """The class of the package's figures, made when matplotlib is first needed."""
    from matplotlib.figure import Figure

    class StyledFigure(Figure):
        """A figure in the package's style."""

        def draw(self, renderer: Any) -> None:
            """As of matplotlib, in the package's style."""
            with style():
                super().draw(renderer)

        def savefig(self, fname: Any, **options: Any) -> None:
            """Write the figure as matplotlib does, in the package's style.

            Without date and program in PNG, PDF and SVG the same figure gives the same bytes.
            """
            ending = Path(str(fname)).suffix[1:].lower()
            format = options.get("format") or ending or "png"
            own: dict[str, Any] = {}
            if format in FORMATS:
                dpi = round(DPI * min(1.0, PAGE / self.get_figwidth()))
                own = {"dpi": dpi, "metadata": _UNSTAMPED[format]}
            with style():
                super().savefig(fname, **own | options)

        def _repr_png_(self) -> bytes:
            """Return the bitmap that notebooks show."""
            return figure_bytes(self, dpi=_NOTEBOOK_DPI)

    return StyledFigure


def page(draw: Callable[[], Figure], path: str | Path | None, format: str | None) -> Figure:
    """Return the figure of ``draw`` in the style of papers, written to ``path`` if given.

    Its format is ``format`` or that of the path's ending.
    """
    _check_format(path, format)
    with style(PAPER):
        figure = draw()
    if path is not None:
        save_figure(figure, path, format)
    return figure


def chart(
    draw: Callable[[Axes], None],
    size: tuple[float, float],
    path: str | Path | None,
    ax: Axes | None,
    format: str | None,
) -> Figure:
    """Return a figure of ``size`` inches with one chart, or that of ``ax`` with the chart.

    See ``page`` for the other arguments.
    """
    if ax is None:

        def own() -> Figure:
            figure = new_figure(size, layout="constrained")
            draw(figure.subplots())
            return figure

        return page(own, path, format)
    _check_ax(ax)
    if path is not None:
        raise InputError(Fault("path", "is given with ax; draw first and save the figure of ax"))
    _check_format(path, format)
    with style(PAPER):
        draw(ax)
    return ax.get_figure(root=True)  # type: ignore[return-value]


def _check_ax(ax: object) -> None:
    """Raise a TypeError unless ``ax`` is an axes of matplotlib."""
    from matplotlib.axes import Axes

    if isinstance(ax, Axes):
        return
    if isinstance(ax, np.ndarray | list | tuple):
        raise TypeError("ax: is an array of axes; give one of them")
    told = "it must be axes, such as figure.subplots() makes"
    raise TypeError(f"ax: is {shown(ax)}, of type {type(ax).__name__}; {told}")


def _check_format(path: str | Path | None, format: str | None) -> None:
    if path is not None:
        figure_format(path, format)
    elif format is not None:
        raise InputError(Fault("format", "is given without a path to write to"))


def headline(
    figure: Figure, name: str, text: str, left: float, good: bool = True, right: float = 0.08
) -> None:
    """Write the head of a page: a name on the left and its outcome on the right.

    The outcome is red unless ``good``; margins are in inches.
    """
    top = 1 - 0.07 / figure.get_figheight()
    figure.text(left / PAGE, top, clipped(name, 60), size=10, weight="bold", color=INK, va="top")
    colour = INK if good else ALARM
    figure.text(1 - right / PAGE, top, text, size=8, color=colour, va="top", ha="right")


def figure_format(path: str | Path, format: str | None = None) -> str:
    """The file format asked for, or else that of the path's ending, one of ``FORMATS``."""
    return format_of(path, format, "figure", FORMATS)


def figure_bytes(figure: Figure, format: str = "png", **options: Any) -> bytes:
    """The file of a figure of ``new_figure``: the same data give the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=format, **options)
    return buffer.getvalue()


def save_figure(figure: Figure, path: str | Path, format: str | None = None) -> None:
    """Write a figure of ``new_figure``, whole or not at all.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written.
    """
    write_file(path, figure_bytes(figure, figure_format(path, format)))
