"""The summary figure of one run: what the robot and its modules did over time."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.plots.style import GREY, INK, MODULE_COLOURS, save_figure, styled
from omnitrack_sim.robot import MODULES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.sim.result import Result

_LINES: tuple[dict[str, Any], ...] = ({"lw": 1.1}, {"lw": 2.8, "alpha": 0.5}, {"lw": 1.1})
"""Module 2 is drawn broad and pale below module 3, so that both are seen where they coincide."""
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


def plot_summary(
    result: Result | str | os.PathLike[str], path: str | Path, format: str | None = None
) -> None:
    """Write the summary figure of a run: twelve panels over time with the phases shaded and named.

    Args:
        result: the run, or the folder of a saved one.
        path: file to write; 1680 x 1260 pixels as a bitmap.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written.
    """
    from omnitrack_sim.sim.loading import as_result

    save_figure(summary_figure(as_result(result)), path, format)


def summary_figure(result: Result) -> Figure:
    """The figure of ``plot_summary``, not tied to any window."""
    from matplotlib.figure import Figure

    def draw() -> Figure:
        figure = Figure(figsize=(12, 9), layout="constrained")
        _fill(figure, result)
        return figure

    return styled(draw)


def _fill(figure: Figure, result: Result) -> None:
    trajectory = result.trajectory
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, 0.895), h_pad=0.05, w_pad=0.06)  # type: ignore[union-attr]
    axes = figure.subplots(4, 3, sharex=True)
    for panel, axis in zip(PANELS, axes.flat, strict=True):
        _shade(axis, trajectory)
        panel(axis, trajectory)
        axis.margins(x=0)
        if len(trajectory.time) > 1:
            axis.set_xlim(trajectory.time[0], trajectory.time[-1])
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.align_ylabels()
    _head(figure, result)


def _head(figure: Figure, result: Result) -> None:
    """Name and outcome of the run, and the one legend: modules, line styles and phases."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    outcome = result.outcome.value.replace("_", " ")
    figure.text(0.012, 0.985, result.scenario.name, size=14, weight="bold", color=INK, va="top")
    text = f"{outcome} after {result.duration_s:.2f} s"
    figure.text(0.988, 0.985, text, size=11, color=INK, va="top", ha="right")
    lines = [
        Line2D([], [], color=MODULE_COLOURS[i], label=f"module {i + 1}", **_LINES[i])
        for i in range(MODULES)
    ]
    lines.append(Line2D([], [], color=GREY, lw=1.1, ls=(0, (4, 2)), label="commanded"))
    codes = sorted(set(result.trajectory["phase"].astype(int).tolist()))
    names = result.trajectory.phases
    shades = [
        Patch(fc=_phase_shade(code), ec=GREY, lw=0.5, label=names[code].replace("_", " "))
        for code in codes
    ]
    figure.legend(
        handles=lines,
        loc="upper left",
        bbox_to_anchor=(0.006, 0.955),
        ncols=len(lines),
        columnspacing=1.4,
    )
    figure.legend(
        handles=shades,
        loc="upper right",
        bbox_to_anchor=(0.994, 0.955),
        ncols=len(shades),
        columnspacing=1.4,
    )


def _phase_shade(code: int) -> str:
    return PHASE_SHADES[code % len(PHASE_SHADES)]


def _shade(axis: Axes, trajectory: Trajectory) -> None:
    """Shade the phases behind a panel; a thin line marks each change."""
    codes = {name: code for code, name in enumerate(trajectory.phases)}
    for name, start, end in trajectory.phase_spans():
        axis.axvspan(start, end, color=_phase_shade(codes[name]), lw=0, zorder=0)
        if start > trajectory.time[0]:
            axis.axvline(start, color=GREY, lw=0.5, zorder=0.5)


def _title(axis: Axes, name: str, unit: str) -> None:
    axis.set_title(name, loc="left")
    axis.set_ylabel(f"[{unit}]")


def _modules(axis: Axes, trajectory: Trajectory, values: NDArray) -> None:
    """One line a module of ``values`` (T, 3)."""
    for i in range(MODULES):
        axis.plot(
            trajectory.time,
            values[:, i],
            color=MODULE_COLOURS[i],
            label=f"module {i + 1}",
            **_LINES[i],
        )


def _commands(axis: Axes, trajectory: Trajectory, values: NDArray) -> None:
    """As ``_modules``, dashed and pale: what was asked."""
    for i in range(MODULES):
        axis.plot(
            trajectory.time,
            values[:, i],
            color=MODULE_COLOURS[i],
            ls=(0, (4, 2)),
            lw=0.9,
            alpha=0.75,
        )


def _single(axis: Axes, trajectory: Trajectory, values: NDArray) -> None:
    axis.plot(trajectory.time, values, color=INK)


def _per_module(
    name: str, channel: str, unit: str, scale: float = 1.0
) -> Callable[[Axes, Trajectory], None]:
    """A panel with one channel of the modules, times ``scale``."""

    def panel(axis: Axes, trajectory: Trajectory) -> None:
        _title(axis, name, unit)
        _modules(axis, trajectory, trajectory[channel] * scale)

    return panel


def _distance(axis: Axes, trajectory: Trajectory) -> None:
    _title(axis, "Distance along the centreline", "m")
    _single(axis, trajectory, trajectory["distance"])


def _tilt(axis: Axes, trajectory: Trajectory) -> None:
    _title(axis, "Tilt against the centreline", "deg")
    _single(axis, trajectory, np.degrees(trajectory["tilt"]))
    axis.set_ylim(bottom=0)


def _belt_speed(axis: Axes, trajectory: Trajectory) -> None:
    _title(axis, "Belt speed", "mm/s")
    _modules(axis, trajectory, trajectory["belt_speed"] * 1e3)
    _commands(axis, trajectory, trajectory["belt_speed_command"] * 1e3)


def _roll(axis: Axes, trajectory: Trajectory) -> None:
    _title(axis, "Module roll", "deg")
    _modules(axis, trajectory, np.degrees(trajectory["roll"]))
    _commands(axis, trajectory, np.degrees(trajectory["roll_command"]))
    low, high = axis.get_ylim()
    if high - low < 10.0:  # a constant roll must not look like movement
        axis.set_ylim((low + high) / 2 - 5.0, (low + high) / 2 + 5.0)


def _contacts(axis: Axes, trajectory: Trajectory) -> None:
    _title(axis, "Contact points", "1")
    _modules(axis, trajectory, trajectory["contact_count"].sum(axis=-1))
    axis.set_ylim(bottom=-0.3)


def _slip_ratio(axis: Axes, trajectory: Trajectory) -> None:
    _title(axis, "Slip ratio", "1")
    _modules(axis, trajectory, trajectory["slip_ratio"])
    axis.set_ylim(-1.05, 1.05)


PANELS: tuple[Callable[[Axes, Trajectory], None], ...] = (
    _distance,
    _tilt,
    _roll,
    _belt_speed,
    _per_module("Motor torque", "motor_torque", "N m"),
    _per_module("Traction", "traction", "N"),
    _per_module("Normal force", "normal_force", "N"),
    _per_module("Slip velocity", "slip_velocity", "mm/s", 1e3),
    _slip_ratio,
    _per_module("Arm slide, outward", "slide", "mm", 1e3),
    _per_module("Arm pitch, nose outward", "pitch", "deg", 180 / math.pi),
    _contacts,
)
"""The panels of the figure, row by row."""
