"""The figures that this package makes, and what all functions that plot have in common.

It loads matplotlib; import it where a figure is made.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import shown
from omnitrack_sim.show.plots.style import FORMATS, figure_format, save_figure, saving, style

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_NOTEBOOK_DPI = 110
"""Dots per inch in a notebook, where a page is then as wide as the text."""


class Picture(Figure):
    """A figure of matplotlib that belongs to no window and to no list of open figures, so it goes
    when nothing holds it any more. It shows itself in notebooks, and is drawn in the package's
    style wherever it is drawn.
    """

    def draw(self, renderer: Any) -> None:
        """As of matplotlib, in the package's style."""
        with style():
            super().draw(renderer)

    def savefig(self, fname: Any, **options: Any) -> None:
        """As of matplotlib, in the package's style, and without date and program in PNG, PDF and
        SVG, so that the same figure gives the same bytes."""
        ending = Path(str(fname)).suffix[1:].lower()
        format = options.get("format") or ending or "png"
        with style():
            super().savefig(
                fname, **((saving(self, format) if format in FORMATS else {}) | options)
            )

    def _repr_png_(self) -> bytes:
        """What notebooks show."""
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=_NOTEBOOK_DPI)
        return buffer.getvalue()


def page(make: Callable[[], Figure], path: str | Path | None, format: str | None) -> Figure:
    """The figure that ``make`` draws, written to ``path`` where there is one."""
    _check_format(path, format)
    figure = make()
    if path is not None:
        save_figure(figure, path, format)
    return figure


def chart(
    draw: Callable[[Axes], None],
    size: tuple[float, float],
    path: str | Path | None,
    ax: Axes | None,
    format: str | None,
    more: Mapping[Any, Any] | None = None,
) -> Figure:
    """A figure with one chart; or the figure of ``ax``, with the chart in ``ax``.

    Args:
        draw: draws the chart.
        size: of a figure of its own, inches.
        path: file to write; none: it is not written.
        ax: where to draw; none: in a figure of its own.
        format: of the file; none: from the ending of ``path``.
        more: what its style has beside that of the package.
    """
    if ax is None:

        def make() -> Figure:
            with style(more):
                own = Picture(figsize=size, layout="constrained")
                draw(own.subplots())
            return own

        return page(make, path, format)
    _check_ax(ax)
    if path is not None:
        raise InputError(Fault("path", "is given with ax; draw first and save the figure of ax"))
    _check_format(path, format)
    with style(more):
        draw(ax)
    return ax.get_figure(root=True)  # type: ignore[return-value]


def _check_ax(ax: object) -> None:
    """Look at where a chart is to be drawn.

    Raises:
        TypeError: it is no axes of matplotlib.
    """
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
