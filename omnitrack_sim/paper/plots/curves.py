"""One run as curves: shaft speeds and roll over time, forces and slip along the pipe."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.paper.plots.phases import LINES, module_names, phase_patches, shade
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.show.plots.style import GREY, MODULE_COLOURS, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result

_DASHES: Any = (0, (4, 2))
_MM = 1e3


def angular_velocity_figure(result: Result, lug_radius: float | None = None) -> Figure:
    """Shaft speeds of the crawlers over time, and the roll of the modules (the paper's Fig. 13).

    Args:
        result: the run.
        lug_radius: m, belt speed over shaft speed; that of the scenario's robot if not given.

    Returns:
        Two panels over time [s]: angular velocity [rad/s], with the commanded one dashed, and
        module roll [deg].
    """
    from omnitrack_sim.show.plots.picture import Picture

    radius = result.scenario.robot.lug_radius if lug_radius is None else lug_radius
    trajectory = result.trajectory

    def draw() -> Figure:
        figure = Picture(figsize=(7.2, 4.8), layout="constrained")
        axes = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1))
        _pairs(
            axes[0],
            trajectory,
            trajectory["belt_speed"] / radius,
            trajectory["belt_speed_command"] / radius,
        )
        _pairs(
            axes[1],
            trajectory,
            np.degrees(trajectory["roll"]),
            np.degrees(trajectory["roll_command"]),
        )
        _at_least(axes[1], 10.0)
        _finish(
            axes,
            trajectory,
            trajectory.time,
            "time [s]",
            ("angular velocity [rad/s]", "module roll [deg]"),
        )
        _head(figure, trajectory, commanded=True)
        return figure

    return styled(draw)


def along_figure(result: Result) -> Figure:
    """Forces and slip of the modules along the pipe.

    Returns:
        Three panels over the arc length of the robot's centre [m]: traction [N], normal force [N],
        slip velocity [mm/s].
    """
    from omnitrack_sim.show.plots.picture import Picture

    trajectory = result.trajectory
    channels = ("traction", 1.0), ("normal_force", 1.0), ("slip_velocity", _MM)

    def draw() -> Figure:
        figure = Picture(figsize=(7.2, 6.2), layout="constrained")
        axes = figure.subplots(3, 1, sharex=True)
        for axis, (name, scale) in zip(axes, channels, strict=True):
            _module_lines(axis, trajectory, trajectory["distance"], trajectory[name] * scale)
        labels = ("traction [N]", "normal force [N]", "slip velocity [mm/s]")
        _finish(
            axes, trajectory, trajectory["distance"], "arc length of the robot's centre [m]", labels
        )
        _head(figure, trajectory)
        return figure

    return styled(draw)


def _module_lines(axis: Axes, trajectory: Trajectory, x: NDArray, values: NDArray) -> None:
    """Draw ``values`` (T, 3) over ``x`` (T,), one line for each module."""
    for i, name in enumerate(module_names(trajectory)):
        axis.plot(x, values[:, i], color=MODULE_COLOURS[i], label=name, **LINES[i])


def _pairs(axis: Axes, trajectory: Trajectory, measured: NDArray, commanded: NDArray) -> None:
    """Draw measured values solid and commanded ones dashed, both (T, 3), over time."""
    for i in range(MODULES):
        label = f"module {i + 1}, commanded"
        axis.plot(
            trajectory.time,
            commanded[:, i],
            color=MODULE_COLOURS[i],
            ls=_DASHES,
            lw=0.8,
            alpha=0.7,
            label=label,
        )
    _module_lines(axis, trajectory, trajectory.time, measured)


def _finish(
    axes: NDArray, trajectory: Trajectory, x: NDArray, xlabel: str, ylabels: Sequence[str]
) -> None:
    """Shade and label the panels, which share ``x`` (T,), and set their limits."""
    for axis, ylabel in zip(axes, ylabels, strict=True):
        shade(axis, trajectory, x)
        axis.set_ylabel(ylabel)
        # Ticks that follow the panel's size would push labels out of the page.
        axis.locator_params(axis="y", nbins=7)
        if np.ptp(x) > 0:
            axis.set_xlim(x.min(), x.max())
    axes[-1].set_xlabel(xlabel)
    axes[0].figure.align_ylabels()


def _head(figure: Figure, trajectory: Trajectory, commanded: bool = False) -> None:
    """The legend above the panels: modules first, line style and phases in the second row."""
    from matplotlib.lines import Line2D

    names = module_names(trajectory)
    lines = [
        Line2D([], [], color=MODULE_COLOURS[i], label=names[i], **LINES[i]) for i in range(MODULES)
    ]
    if commanded:
        lines.append(Line2D([], [], color=GREY, lw=0.9, ls=_DASHES, label="commanded"))
    rows = [row for row in (lines, phase_patches(trajectory)) if row]
    height = figure.get_figheight()
    for k, row in enumerate(rows):
        place = (0.0, 1 - (0.02 + 0.22 * k) / height)
        figure.legend(
            handles=row, loc="upper left", bbox_to_anchor=place, ncols=len(row), borderaxespad=0.2
        )
    room = 1 - (0.12 + 0.22 * len(rows)) / height
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, room))  # type: ignore[union-attr]


def _at_least(axis: Axes, height: float) -> None:
    """Widen the y range to ``height``, so that a constant value does not look like movement."""
    low, high = axis.get_ylim()
    if high - low < height:
        axis.set_ylim((low + high - height) / 2, (low + high + height) / 2)
