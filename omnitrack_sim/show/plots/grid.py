"""A page of panels over time, each where it is told to be: no layout has to be found, which takes
longer than to draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from omnitrack_sim.base.text import clipped
from omnitrack_sim.show.plots.panels import Panel
from omnitrack_sim.show.plots.style import ALARM, INK, PAGE, TICKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEFT, RIGHT = 0.42, 0.08
"""Margins, inches."""
_BELOW = 0.36  # inches below the panels
_BESIDE, _BETWEEN, _HEIGHT = 0.44, 0.27, 0.82  # inches between columns, between rows; of a panel
_STEPS = (1, 2, 5, 10)
"""Ticks stand at these and their tenfolds."""
_LONGEST_LEGEND = 80
"""Characters of a legend that fit into one line."""


@dataclass(frozen=True)
class Grid:
    """Rows and columns of panels as wide as a page.

    Attributes:
        rows, columns: how many.
        above: inches for title and legends.
    """

    rows: int
    columns: int
    above: float

    @property
    def height(self) -> float:
        """Of the figure, inches."""
        return self.above + self.rows * _HEIGHT + (self.rows - 1) * _BETWEEN + _BELOW

    def add(self, figure: Figure, row: int, column: int, panel: Panel, module: int | None) -> Axes:
        """An empty panel with its name and unit level above its axis, which reads better than
        upright beside it. The last row has the numbers of the times."""
        axis = figure.add_axes(self._place(row, column))
        last = row == self.rows - 1
        axis.tick_params(**TICKS)
        axis.tick_params(axis="x", labelbottom=last)
        axis.locator_params(axis="x", nbins=5, steps=_STEPS)
        axis.locator_params(axis="y", nbins=4, steps=_STEPS)
        if last:
            axis.set_xlabel("time [s]")
            axis.xaxis.set_label_coords(0.5, -0.24)
        axis.set_ylabel(panel.label_of(module), rotation=0, ha="left", va="bottom")
        axis.yaxis.set_label_coords(0.0, 1.04)
        return axis

    def _place(self, row: int, column: int) -> tuple[float, float, float, float]:
        width = (PAGE - LEFT - RIGHT - (self.columns - 1) * _BESIDE) / self.columns
        left = LEFT + column * (width + _BESIDE)
        bottom = _BELOW + (self.rows - 1 - row) * (_HEIGHT + _BETWEEN)
        return left / PAGE, bottom / self.height, width / PAGE, _HEIGHT / self.height

    def title(self, figure: Figure, name: str, told: str, good: bool) -> None:
        """Name on the left, what came of it on the right."""
        top = 1 - 0.07 / self.height
        name = clipped(name, 60)
        figure.text(LEFT / PAGE, top, name, size=10, weight="bold", color=INK, va="top")
        colour, right = INK if good else ALARM, 1 - RIGHT / PAGE
        figure.text(right, top, told, size=8, color=colour, va="top", ha="right")

    def legend(self, figure: Figure, handles: list, down: float) -> None:
        """A legend from the left, ``down`` inches below the top, in several lines where it is
        long."""
        names = [handle.get_label() for handle in handles]
        lines = -(-sum(len(name) + 5 for name in names) // _LONGEST_LEGEND)
        figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(LEFT / PAGE, 1 - down / self.height),
            ncols=-(-len(names) // max(1, lines)),
        )
