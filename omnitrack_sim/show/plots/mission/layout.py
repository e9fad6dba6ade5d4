"""Where everything stands in the figure of a mission, in inches from the lower left corner."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.show.plots.style import INK, PAGE, TICKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, LEFT, RIGHT = PAGE, 0.46, 0.08
"""Width of the figure and of its margins, inches."""
_BETWEEN = 0.42  # inches between the two columns
COLUMN = (WIDTH - LEFT - RIGHT - _BETWEEN) / 2
"""Width of a column, which holds both views of one quantity, inches."""
_TALLEST = 4.2  # inches, largest height of the views of one quantity
_HEAD = 0.42  # inches for the title
_STACKED, _ASIDE = 0.24, 0.38  # inches between two views, one above the other or side by side
_PANELS = 0.1  # inches between the panels of the time chart
_AXES = "xyz"


@dataclass(frozen=True)
class View:
    """One view of the pipes.

    Attributes:
        pair: world axes that point to the right and up.
        title: shown above it.
        low, high: (2,) m, limits of both axes.
        left, bottom, width, height: place in its column and size, inches.
    """

    pair: tuple[int, int]
    title: str
    low: Array
    high: Array
    left: float
    bottom: float
    width: float
    height: float

    @property
    def flipped(self) -> bool:
        """Whether the second axis points down: with y to the right, x seen from above does."""
        return self.pair == (1, 0)


class Layout:
    """Places of everything in the figure. Views are as large as their column can hold."""

    def __init__(self, quads: Array, several_legs: bool) -> None:
        low, high = quads.reshape(-1, 3).min(axis=0), quads.reshape(-1, 3).max(axis=0)
        room = 0.04 * (high - low).max()
        low, high = low - room, high + room
        across = 0 if high[0] - low[0] >= high[1] - low[1] else 1
        other = 1 - across
        width, depth, tall = (high - low)[[across, other, 2]]
        stacked = min(COLUMN / width, (_TALLEST - _STACKED) / (tall + depth))
        aside = min((COLUMN - _ASIDE) / (2 * width), _TALLEST / max(tall, depth))
        self.aside = aside > 0.85 * stacked  # a little smaller, but the figure is much lower
        scale = aside if self.aside else stacked  # inches a metre
        if self.aside:
            total = 2 * scale * width + _ASIDE
            places = [(0.0, 0.0), (scale * width + _ASIDE, scale * max(tall - depth, 0.0))]
            self.map_height = scale * max(tall, depth)
            places[0] = (0.0, self.map_height - scale * tall)
        else:
            total = scale * width
            places = [(0.0, scale * depth + _STACKED), (0.0, 0.0)]
            self.map_height = scale * (tall + depth) + _STACKED
        margin = (COLUMN - total) / 2
        texts = (f"elevation, along {'yx'[across]}", "plan, from above")
        self.views = [
            View(
                pair=pair,
                title=text,
                low=low[list(pair)],
                high=high[list(pair)],
                left=margin + x,
                bottom=y,
                width=scale * width,
                height=scale * size,
            )
            for text, pair, size, (x, y) in zip(
                texts, ((across, 2), (across, other)), (tall, depth), places, strict=True
            )
        ]
        self.legs = 0.16 if several_legs else 0.0
        self.chart_bottom = 0.36
        self.panel = 0.72
        self.strip = 0.46
        self.legend = self.chart_bottom + 2 * self.panel + _PANELS + self.legs + self.strip + 0.22
        self.map_bottom = self.legend + 0.56
        self.bar = self.map_bottom + self.map_height + 0.36
        self.height = self.bar + 0.08 + _HEAD
        self.left_of = [LEFT, LEFT + COLUMN + _BETWEEN]

    def box(
        self, left: float, bottom: float, width: float, height: float
    ) -> tuple[float, float, float, float]:
        """A rectangle given in inches, as fractions of the figure."""
        return left / WIDTH, bottom / self.height, width / WIDTH, height / self.height

    def add(self, figure: Figure, view: View, column: int) -> Axes:
        """The axes of one view, both to the same scale."""
        left, bottom = self.left_of[column] + view.left, self.map_bottom + view.bottom
        axis: Axes = figure.add_axes(self.box(left, bottom, view.width, view.height))
        for name, index, limits in zip(
            "xy", view.pair, zip(view.low, view.high, strict=True), strict=True
        ):
            getattr(axis, f"set_{name}lim")(
                *(limits[::-1] if view.flipped and name == "y" else limits)
            )
            getattr(axis, f"set_{name}label")(f"{_AXES[index]} [m]", labelpad=1.5)
            getattr(axis, f"{name}axis").set_major_locator(_ticks(limits[1] - limits[0]))
        axis.tick_params(**TICKS)
        axis.set_title(view.title, loc="left", fontsize=7, color=INK, pad=3)
        if not self.aside and view is self.views[0]:
            axis.set_xlabel("")
            axis.tick_params(labelbottom=False)
        axis.autoscale(False)
        return axis

    def chart(self, figure: Figure) -> tuple[Axes, Axes, Axes]:
        """Axes of the time chart: bands, tilt, speed."""
        width, tilt = WIDTH - LEFT - RIGHT, self.chart_bottom + self.panel + _PANELS
        rows = (
            (tilt + self.panel, self.legs + self.strip),
            (tilt, self.panel),
            (self.chart_bottom, self.panel),
        )
        strip, above, below = (
            figure.add_axes(self.box(LEFT, bottom, width, height)) for bottom, height in rows
        )
        for axis in (above, below):
            axis.tick_params(**TICKS)
            axis.yaxis.set_label_coords(-0.05, 0.5)
        return strip, above, below


def _ticks(length: float) -> Any:
    """Ticks at round distances, the same in every view of about this length, m."""
    from matplotlib.ticker import MultipleLocator

    steps = np.outer(10.0 ** np.arange(-1, 5), [1, 2, 5]).ravel()  # m; pipes are 10 km at most
    return MultipleLocator(float(steps[np.argmax(length / steps <= 6)]))
