"""How all figures look, and how they are written."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar

from omnitrack_sim.writing import format_of, whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MODULE_COLOURS = ((0.95, 0.55, 0.05), (0.10, 0.45, 0.80), (0.05, 0.62, 0.42))
"""Red, green, blue of modules 1, 2, 3: orange, blue and green as on the model (``model.looks``)."""
GREY, INK, ALARM = "#7a7f87", "#22262b", "#c8322b"
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
    # Names come from users. They are drawn as they are, whatever they mean to TeX.
    "text.parse_math": False,
    "text.usetex": False,
}
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


def styled(draw: Callable[[], Figure]) -> Figure:
    """The figure that ``draw`` makes, in the package's style."""
    with _style():
        return draw()


@contextmanager
def _style() -> Iterator[None]:
    import matplotlib
    import numpy as np

    # Of physics that has diverged, numbers may be none or too large.
    quiet = np.errstate(invalid="ignore", over="ignore")
    with matplotlib.rc_context(STYLE), warnings.catch_warnings(), quiet:
        for beginning in _NOT_TOLD:
            warnings.filterwarnings("ignore", beginning, UserWarning)
        yield


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
        path: file to write, at 140 dots per inch as a bitmap; or an open binary file, with
            ``format``.
        format: of ``FORMATS``; none: from the ending of ``path``.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written.
    """
    chosen = figure_format(path, format)
    stampless = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Producer": None},
        "svg": {"Date": None},
    }
    options: dict[str, Any] = {"format": chosen, "dpi": 140, "metadata": stampless[chosen]}
    with _style():
        if isinstance(path, str | Path):
            with whole_file(path) as part:
                figure.savefig(part, **options)
        else:
            figure.savefig(path, **options)
