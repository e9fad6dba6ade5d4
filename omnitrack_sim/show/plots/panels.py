"""Channels over time: one panel a channel, with a line for each module and the phases behind."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.channels import (
    MODULE_COLOURS,
    MODULE_COUNT,
    Channel,
    Display,
    Vector,
)
from omnitrack_sim.record.metrics import KNOWN
from omnitrack_sim.show.plots.style import INK, PAGE, TICKS, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from omnitrack_sim.record.trajectory import Trajectory

LINES: tuple[dict[str, Any], ...] = ({"lw": 0.9}, {"lw": 1.9, "alpha": 0.5}, {"lw": 0.9})
"""Module 2 is drawn broad and pale below module 3, so that both are seen where they coincide."""
COMMAND: dict[str, Any] = {"lw": 2.0, "color": "#a6acb6", "zorder": 1.8}
"""The command of one module, or of all alike: broad and pale below the measured value, so that both
are seen where they coincide."""
_COMMANDS: dict[str, Any] = {"lw": 0.7, "ls": (0, (3, 2))}  # of each module, in one panel with all
PHASE_SHADES = (
    "#ffffff",
    "#e3e6ec",
    "#f3ead9",
    "#dcebe4",
    "#eadfeb",
    "#e8e8d6",
    "#dde8f2",
    "#f2dfdc",
)
"""Background of the phases, in the order of the trajectory's phase names."""
BAND, BAND_COLOUR = 2.0, "#b9cbe4"
"""Half of the width of an estimate's band, in standard deviations, and its colour."""
ERRORS = {
    "distance": Display("Error of the distance", "mm", 1e3, span=4.0),
    "theta5": Display("Error of theta5", "deg", 180.0 / np.pi, span=2.0),
    "tilt": Display("Error of the tilt", "deg", 180.0 / np.pi, span=2.0),
}
"""Display of the errors of estimates, by the channel that is estimated."""
_ERRORS_SHOWN = 95.0
"""Part of the times, in percent, at which error and band are seen whole, of those at which the
robot claims to know its orientation: before, its band is as wide as a circle."""
LEFT, RIGHT = 0.42, 0.08
"""Margins of a page of panels, inches."""
_ABOVE, _BELOW = 0.78, 0.36  # inches: title and legends above the panels, times below them
_BESIDE, _BETWEEN, _HEIGHT = 0.44, 0.27, 0.82  # inches between columns, between rows; of a panel
_LONGEST_LEGEND = 80
"""Characters of a legend that fit into one line."""


def values_of(trajectory: Trajectory, channel: str) -> NDArray[np.float64]:
    """Values of a channel as they are displayed: (T,), or (T, n) with a line each."""
    scale = trajectory.schema[channel].display.scale
    values = np.asarray(trajectory[channel], float) * scale
    if channel == "contact_count":
        return values.sum(axis=-1)  # of both tracks of a module
    return values.reshape(len(values), -1) if values.ndim > 2 else values


def has_modules(channel: Channel) -> bool:
    """True where a panel has one line a module."""
    counts = channel.name == "contact_count"
    return counts or (channel.shape == (MODULE_COUNT,) and not isinstance(channel, Vector))


def draw_panel(axis: Axes, trajectory: Trajectory, name: str, module: int | None = None) -> None:
    """Lines of a channel over time: one a module in its colour, or those of one ``module`` (1 to
    3), with the command where there is one. Phases are not drawn; see ``shade``."""
    time, values = trajectory.time, values_of(trajectory, name)
    display = trajectory.schema[name].display
    command = values_of(trajectory, display.command) if display.command else None
    if module is not None:
        values = values[:, module - 1]
        command = None if command is None else command[:, module - 1]
        axis.plot(time, values, color=MODULE_COLOURS[module - 1], label=f"module {module}")
        if command is not None:
            axis.plot(time, command, label="command", **COMMAND)
    elif values.ndim == 1:
        axis.plot(time, values, color=INK)
    else:
        _draw_columns(axis, time, values, trajectory.schema[name])
        if command is not None:
            _draw_commands(axis, time, command)
    limits = limits_of(display, values if command is None else np.stack([values, command]))
    if limits is not None:
        axis.set_ylim(*limits)


def _draw_columns(axis: Axes, time: NDArray, values: NDArray, channel: Channel) -> None:
    """One line a column: a module, or a component of a vector."""
    modules = has_modules(channel)
    for i, column in enumerate(values.T):
        look: dict[str, Any] = {"label": channel.columns[i].removeprefix(f"{channel.name}_")}
        if modules:
            look = {"color": MODULE_COLOURS[i], "label": f"module {i + 1}"} | LINES[i]
        axis.plot(time, column, **look)


def _draw_commands(axis: Axes, time: NDArray, commands: NDArray) -> None:
    """The commands of all modules in one panel: one line where they are the same."""
    if (commands == commands[:, :1]).all():
        axis.plot(time, commands[:, 0], label="command", **COMMAND)
        return
    for i, column in enumerate(commands.T):
        dark = tuple(0.6 * part for part in MODULE_COLOURS[i])
        axis.plot(time, column, color=dark, label=f"command {i + 1}", **_COMMANDS)


def limits_of(display: Display, values: NDArray) -> tuple[float, float] | None:
    """Limits of an axis that shows values; None where no value is finite."""
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = float(known.min()), float(known.max())
    room = 0.06 * (high - low)
    low = low - room if display.low is None else min(display.low, low)
    high = high + room if display.high is None else max(display.high, high)
    short = max(0.0, display.span - (high - low))
    if display.low is None:
        low, high = low - short / 2, high + short / 2
    else:
        high += short
    return (low, high) if high > low else None


def draw_error(axis: Axes, trajectory: Trajectory, name: str) -> None:
    """The error of a channel's estimate over time, above the band of ``BAND`` standard deviations
    to either side."""
    display = ERRORS[name]
    error = trajectory[f"{name}_estimate"] - trajectory[name]
    if display.unit == "deg":
        error = wrap_angle(error)
    error = display.scale * error
    band = BAND * display.scale * trajectory[f"{name}_std"]
    axis.fill_between(trajectory.time, -band, band, color=BAND_COLOUR, lw=0, zorder=1.5)
    axis.axhline(0.0, color="white", lw=0.6, zorder=1.6)
    axis.plot(trajectory.time, error, color=INK)
    largest = np.maximum(np.abs(error), band)
    sure = trajectory["theta5_std"] < KNOWN
    largest = largest[np.isfinite(largest) & (sure if sure.any() else True)]
    half = 1.1 * float(np.percentile(largest, _ERRORS_SHOWN)) if len(largest) else 0.0
    half = max(half, display.span / 2)
    axis.set_ylim(-half, half)


def shade(axis: Axes, trajectory: Trajectory) -> None:
    """Shade the phases behind a panel, and let it end with the run."""
    from matplotlib.collections import PolyCollection

    time = trajectory.time
    if len(time) > 1:
        axis.set_xlim(time[0], time[-1])
    codes = {name: code for code, name in enumerate(trajectory.phases)}
    spans = [(shade_of(codes[name]), a, b) for name, a, b in trajectory.phase_spans()]
    spans = [span for span in spans if span[0] != PHASE_SHADES[0]]
    corners = [[(a, 0), (b, 0), (b, 1), (a, 1)] for _, a, b in spans]
    # One collection draws a thousand phases at once, where each axvspan is an artist of its own.
    phases = PolyCollection(
        corners,
        facecolors=[colour for colour, _, _ in spans],
        linewidths=0,
        zorder=0,
        transform=axis.get_xaxis_transform(),
    )
    axis.add_collection(phases, autolim=False)


def shade_of(code: int) -> str:
    """Background of a phase."""
    return PHASE_SHADES[code % len(PHASE_SHADES)]


class PanelGrid:
    """A figure as wide as a page with rows and columns of panels, each at a known place: to find a
    layout takes longer than to draw.

    Args:
        rows: how many.
        columns: how many.
    """

    def __init__(self, rows: int, columns: int) -> None:
        self.rows, self.columns = rows, columns
        self.height = _ABOVE + rows * _HEIGHT + (rows - 1) * _BETWEEN + _BELOW  # inches
        self.figure = new_figure((PAGE, self.height))

    def add(self, row: int, column: int, label: str) -> Axes:
        """An empty panel with its label level above its axis, which reads better than upright
        beside it. The last row has the numbers of the times."""
        width = (PAGE - LEFT - RIGHT - (self.columns - 1) * _BESIDE) / self.columns
        left = LEFT + column * (width + _BESIDE)
        bottom = _BELOW + (self.rows - 1 - row) * (_HEIGHT + _BETWEEN)
        box = (left / PAGE, bottom / self.height, width / PAGE, _HEIGHT / self.height)
        axis = self.figure.add_axes(box)
        last = row == self.rows - 1
        axis.tick_params(**TICKS)
        axis.tick_params(axis="x", labelbottom=last)
        axis.locator_params(axis="x", nbins=5, steps=(1, 2, 5, 10))
        axis.locator_params(axis="y", nbins=4, steps=(1, 2, 5, 10))
        if last:
            axis.set_xlabel("time [s]")
            axis.xaxis.set_label_coords(0.5, -0.24)
        axis.set_ylabel(label, rotation=0, ha="left", va="bottom")
        axis.yaxis.set_label_coords(0.0, 1.04)
        return axis

    def legend(self, handles: list, down: float) -> None:
        """A legend from the left, ``down`` inches below the top, in several lines where it is
        long."""
        names = [handle.get_label() for handle in handles]
        lines = -(-sum(len(name) + 5 for name in names) // _LONGEST_LEGEND)
        self.figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(LEFT / PAGE, 1 - down / self.height),
            ncols=-(-len(names) // max(1, lines)),
        )
