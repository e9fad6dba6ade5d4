"""How all figures look, and how they are written."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from omnitrack_sim.errors import Fault, InputError

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
}


def styled(draw: Callable[[], Figure]) -> Figure:
    """The figure that ``draw`` makes, in the package's style."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        return draw()


def figure_format(path: str | Path | BinaryIO, format: str | None = None) -> str:
    """The file format asked for, or else that of the path's ending.

    Raises:
        InputError: it is none of ``FORMATS``.
    """
    chosen = format or Path(str(path)).suffix[1:].lower()
    if chosen not in FORMATS:
        raise InputError(Fault(str(path), f"has the figure format {chosen!r}", FORMATS))
    return chosen


def save_figure(figure: Figure, path: str | Path | BinaryIO, format: str | None = None) -> None:
    """Write a figure.

    Neither date nor program is written into the file, so the same data gives the same bytes.

    Args:
        figure: of ``styled``.
        path: file to write, at 140 dots per inch as a bitmap; or an open binary file, with
            ``format``.
        format: of ``FORMATS``; none: from the ending of ``path``.

    Raises:
        InputError: no such format.
        OSError: the file cannot be written.
    """
    import matplotlib

    chosen = figure_format(path, format)
    stampless = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Producer": None},
        "svg": {"Date": None},
    }
    with matplotlib.rc_context(STYLE):
        figure.savefig(path, format=chosen, dpi=140, metadata=stampless[chosen])
