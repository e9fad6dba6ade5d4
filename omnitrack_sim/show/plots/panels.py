"""Channels over time: a panel with its label and unit, lines for the modules, phases behind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.record.channels import MODULE_COUNT, Channel, Vector
from omnitrack_sim.show.plots.style import INK, MODULE_COLOURS, labelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from omnitrack_sim.record.trajectory import Trajectory

LINES: tuple[dict[str, Any], ...] = ({"lw": 0.9}, {"lw": 1.9, "alpha": 0.5}, {"lw": 0.9})
"""Module 2 is drawn broad and pale below module 3, so that both are seen where they coincide."""
COMMAND: dict[str, Any] = {"lw": 2.0, "color": "#a6acb6", "zorder": 1.8}
"""What was asked of one module, or of all alike: broad and pale below what was measured, so that
both are seen where they coincide."""
_ASKED: dict[str, Any] = {"lw": 0.7, "ls": (0, (3, 2))}
"""What was asked of each module, in one panel with all."""
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


@dataclass(frozen=True)
class Panel:
    """How a channel is shown.

    Attributes:
        channel: its name.
        name: what people call it.
        unit: that it is shown in.
        scale: of that unit; the values are multiplied by it.
        command: channel of what was asked for; empty without one.
        low, high: what the axis reaches down or up to at least; None: as the values are.
        span: what it spans at least, so that a constant value does not look like movement.
    """

    channel: str
    name: str
    unit: str
    scale: float = 1.0
    command: str = ""
    low: float | None = None
    high: float | None = None
    span: float = 0.0

    def label_of(self, module: int | None = None) -> str:
        """Name and unit; of one module alone with its number."""
        name = self.name if module is None else f"{self.name}, module {module}"
        return labelled(name, self.unit)

    def values(self, trajectory: Trajectory, channel: str = "") -> NDArray[np.float64]:
        """What is drawn: (T,), or (T, n) with a line each; of ``channel`` instead of its own."""
        values = np.asarray(trajectory[channel or self.channel], float) * self.scale
        if self.channel == "contact_count":
            return values.sum(axis=-1)
        return values.reshape(len(values), -1) if values.ndim > 2 else values


_MM, _DEG = 1e3, 180.0 / np.pi
PANELS = {
    panel.channel: panel
    for panel in (
        Panel("distance", "Distance along the centreline", "m"),
        Panel("tilt", "Tilt against the centreline", "deg", _DEG, low=0.0, span=1.0),
        Panel("offset", "Offset from the centreline", "mm", _MM, low=0.0, span=1.0),
        Panel("theta5", "Module 1 from the turning direction", "deg", _DEG),
        Panel("belt_speed", "Belt speed", "mm/s", _MM, command="belt_speed_command", span=10.0),
        Panel("belt_speed_command", "Belt speed asked", "mm/s", _MM, span=10.0),
        Panel("wall_speed", "Speed asked at the wall", "mm/s", _MM, span=10.0),
        Panel("motor_torque", "Motor torque", "N m"),
        Panel("traction", "Traction", "N"),
        Panel("normal_force", "Normal force", "N", low=0.0),
        Panel("slip_velocity", "Slip velocity", "mm/s", _MM),
        Panel("slip_ratio", "Slip ratio", "1", low=-1.05, high=1.05),
        Panel("contact_count", "Contact points", "1", low=-0.3),
        Panel("slide", "Arm slide, outward", "mm", _MM, span=1.0),
        Panel("pitch", "Arm pitch, nose outward", "deg", _DEG, span=1.0),
        Panel("roll", "Module roll", "deg", _DEG, command="roll_command", span=10.0),
        Panel("roll_command", "Module roll asked", "deg", _DEG, span=10.0),
    )
}
"""The channels that have a name of their own; of the others ``panel_of`` makes one."""


def panel_of(channel: Channel) -> Panel:
    """How a channel is shown, also one of a user's own sensor."""
    known = PANELS.get(channel.name)
    if known is not None:
        return known
    name = channel.name.replace("_", " ").capitalize()
    if channel.unit in ("rad", "rad/s"):
        return Panel(channel.name, name, channel.unit.replace("rad", "deg"), _DEG)
    return Panel(channel.name, name, channel.unit)


def draw_panel(axis: Axes, panel: Panel, trajectory: Trajectory, module: int | None = None) -> None:
    """Lines over time: one a module in its colour, or those of one ``module`` (1 to 3), with the
    command where there is one. Phases are not drawn; see ``shade``."""
    time, values = trajectory.time, panel.values(trajectory)
    asked = panel.values(trajectory, panel.command) if panel.command else None
    if module is not None:
        values = values[:, module - 1]
        asked = None if asked is None else asked[:, module - 1]
        axis.plot(time, values, color=MODULE_COLOURS[module - 1], label=f"module {module}")
        if asked is not None:
            axis.plot(time, asked, label="command", **COMMAND)
    elif values.ndim == 1:
        axis.plot(time, values, color=INK)
    else:
        _several(axis, trajectory, panel, values)
        if asked is not None:
            _asked_of_all(axis, time, asked)
    _limits(axis, panel, values if asked is None else np.stack([values, asked]))


def _several(axis: Axes, trajectory: Trajectory, panel: Panel, values: NDArray) -> None:
    """One line a column: a module, or a component of a vector."""
    channel = trajectory.schema[panel.channel]
    modules = not isinstance(channel, Vector) and values.shape[1:] == (MODULE_COUNT,)
    style: dict[str, Any]
    for i, column in enumerate(values.T):
        if modules:
            style = {"color": MODULE_COLOURS[i], "label": f"module {i + 1}"} | LINES[i]
        else:
            style = {"label": channel.columns[i].removeprefix(f"{channel.name}_")}
        axis.plot(trajectory.time, column, **style)


def _asked_of_all(axis: Axes, time: NDArray, asked: NDArray) -> None:
    """The commands of all modules in one panel: one line where they are the same."""
    if (asked == asked[:, :1]).all():
        axis.plot(time, asked[:, 0], label="command", **COMMAND)
        return
    for i, column in enumerate(asked.T):
        dark = tuple(0.6 * part for part in MODULE_COLOURS[i])
        axis.plot(time, column, color=dark, label=f"command {i + 1}", **_ASKED)


def limits_of(panel: Panel, values: NDArray) -> tuple[float, float] | None:
    """What a panel's axis shows; None where no value is finite."""
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    low, high = float(known.min()), float(known.max())
    room = 0.06 * (high - low)
    low = low - room if panel.low is None else min(panel.low, low)
    high = high + room if panel.high is None else max(panel.high, high)
    short = panel.span - (high - low)
    if short > 0:
        low, high = (
            (low, high + short) if panel.low is not None else (low - short / 2, high + short / 2)
        )
    return (low, high) if high > low else None


def _limits(axis: Axes, panel: Panel, values: NDArray) -> None:
    found = limits_of(panel, values)
    if found is not None:
        axis.set_ylim(*found)


def shade(axis: Axes, trajectory: Trajectory) -> None:
    """Shade the phases behind a panel, and let it end with the run."""
    from matplotlib.collections import PolyCollection

    time = trajectory.time
    if len(time) > 1:
        axis.set_xlim(time[0], time[-1])
    spans = [
        (code, start, end) for code, start, end in _spans(trajectory) if shade_of(code) != "#ffffff"
    ]
    corners = [[(a, 0), (b, 0), (b, 1), (a, 1)] for _, a, b in spans]
    colours = [shade_of(code) for code, _, _ in spans]
    place = axis.get_xaxis_transform()
    axis.add_collection(
        PolyCollection(corners, facecolors=colours, linewidths=0, zorder=0, transform=place),
        autolim=False,
    )


def _spans(trajectory: Trajectory) -> list[tuple[int, float, float]]:
    codes = {name: code for code, name in enumerate(trajectory.phases)}
    return [(codes[name], start, end) for name, start, end in trajectory.phase_spans()]


def shade_of(code: int) -> str:
    """Background of a phase."""
    return PHASE_SHADES[code % len(PHASE_SHADES)]


def phases_shown(trajectory: Trajectory) -> list[tuple[str, str]]:
    """Name and background of each phase that occurred."""
    codes = sorted(set(trajectory["phase"].astype(int).tolist()))
    return [(trajectory.phases[code].replace("_", " "), shade_of(code)) for code in codes]
