"""How all figures look, and how they are written."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

from omnitrack_sim.base.writing import format_of, whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODULE_COLOURS = ((0.95, 0.55, 0.05), (0.10, 0.45, 0.80), (0.05, 0.62, 0.42))
"""Red, green, blue of modules 1, 2, 3: orange, blue and green as on the model (``model.looks``)."""
GREY, INK, ALARM = "#7a7f87", "#22262b", "#c8322b"
PAGE, COLUMN = 7.16, 3.5
"""Widths of what fills a page and of what fills one of two columns of a paper, inches."""
DPI = 220
"""Dots per inch of bitmaps: a page is 1575 pixels wide, and so is what is wider than a page."""
FORMATS = ("png", "svg", "pdf")
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
"""What figures that are as wide as a page or a column have beside ``STYLE``: text that can be read
there."""
TICKS: dict[str, Any] = {"labelsize": 6.5, "length": 2.0, "width": 0.5, "pad": 1.8}
"""Their ticks, for ``tick_params``."""
_NOT_TOLD = ("Glyph .* missing from font", "constrained_layout not applied")
"""Beginnings of warnings about names that have letters the font lacks, or hundreds of them."""
_Drawn = TypeVar("_Drawn")


class PictureWarning(UserWarning):
    """A picture could not be made; what it shows is saved all the same."""


def attempt(what: str, draw: Callable[[], _Drawn], again: str = "") -> _Drawn | None:
    """What ``draw`` returns; None, with a ``PictureWarning``, if it raises anything.

    For pictures of what has been computed: whatever is wrong with one, the data are not lost.

    Args:
        what: name of the picture.
        draw: makes it.
        again: what makes it from the data, once the cause is gone; told with the warning.
    """
    try:
        return draw()
    except Exception as error:
        cause = f"{error}" or type(error).__name__
        later = f"; the data are saved, {again} draws it again" if again else ""
        warnings.warn(f"no {what}: {cause}{later}", PictureWarning, stacklevel=2)
        return None


def styled(draw: Callable[[], _Drawn], more: Mapping[Any, Any] | None = None) -> _Drawn:
    """What ``draw`` makes in the package's style, with what ``more`` changes of it."""
    with style(more):
        return draw()


@contextmanager
def style(more: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """The package's style, with what ``more`` changes of it."""
    import matplotlib
    import numpy as np

    # Of physics that has diverged, numbers may be none or too large.
    quiet = np.errstate(invalid="ignore", over="ignore")
    with matplotlib.rc_context(STYLE | dict(more or {})), warnings.catch_warnings(), quiet:
        for beginning in _NOT_TOLD:
            warnings.filterwarnings("ignore", beginning, UserWarning)
        yield


def labelled(name: str, unit: str) -> str:
    """What an axis is called: the name with its unit, or the name alone of numbers without one."""
    return name if unit in ("", "1", "code") else f"{name} [{unit}]"


def figure_format(path: str | Path | BinaryIO, format: str | None = None) -> str:
    """The file format asked for, or else that of the path's ending.

    Raises:
        InputError: it is none of ``FORMATS``.
    """
    return format_of(path, format, "figure", FORMATS)


def save_figure(figure: Figure, path: str | Path | BinaryIO, format: str | None = None) -> None:
    """Write a figure, whole or not at all.

    Neither date nor program is written into the file, so the same data gives the same bytes.

    Args:
        figure: of ``styled``.
        path: file to write; bitmaps have ``DPI``; or an open binary file, with ``format``.
        format: of ``FORMATS``; none: from the ending of ``path``.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written.
    """
    options = saving(figure, figure_format(path, format))
    with style():
        if isinstance(path, str | Path):
            with whole_file(path) as part:
                figure.savefig(part, **options)
        else:
            figure.savefig(path, **options)


def saving(figure: Figure, format: str) -> dict[str, Any]:
    """Options of matplotlib's ``savefig``: dots per inch, and neither date nor program."""
    stampless = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
        "svg": {"Date": None, "Creator": None},
    }
    dpi = round(DPI * min(1.0, PAGE / figure.get_figwidth()))
    return {"format": format, "dpi": dpi, "metadata": stampless[format]}
