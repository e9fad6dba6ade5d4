"""Figures that show claims.

Of one run shaft speeds, forces and slip as curves, and contacts on the unrolled pipe; of groups of
runs elbows over the start orientation, and success rates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, MODULES
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.show.plots.run_figures import LINES, display_values, limits_of
from omnitrack_sim.show.plots.style import ALARM, GREY, INK, new_figure, style
from omnitrack_sim.show.plots.success import PASSED_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.pipes import Route
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result


PHASES = {
    "align": ("#fbe9a6", "holonomic motion"),
    "tee_turn": ("#d3ebcb", "turn"),
    "elbow": ("#dbe6f3", "elbow"),
    "tee_straight": ("#eadfeb", "tee, straight on"),
}
"""Background of the shaded phases, and their names in legends; any other phase stays white."""
TURNS = "tee_turn", "elbow"
DASHED: dict[str, Any] = {"ls": (0, (4, 2)), "lw": 0.8, "alpha": 0.7}
NO_CONTACT_FORCE = 0.5
"""Normal force below which a module counts as off the wall, N."""


def inner_module(trajectory: Trajectory) -> int | None:
    """Return the module that points into the first turn as it begins; None without one."""
    turns = [trajectory.phases.index(name) for name in TURNS if name in trajectory.phases]
    turning = np.isin(trajectory["phase"].astype(int), turns)
    if not turning.any():
        return None
    theta5 = trajectory["theta5"][np.argmax(turning)]
    return int(np.argmin(np.abs(wrap_angle(theta5 + np.array(MODULE_ANGLES)))))


@style()
def angular_velocity_figure(result: Result) -> Figure:
    """Plot the shaft speeds of the crawlers and the roll of the modules (the paper's Fig. 13).

    Returns:
        Two panels over time [s]: angular velocity [rad/s], with the commanded one dashed, and
        module roll [deg].
    """
    trajectory, radius = result.trajectory, result.scenario.robot.lug_radius

    figure = new_figure((7.2, 4.8), layout="constrained")
    speed, roll = figure.subplots(2, 1, sharex=True, height_ratios=(1.7, 1))
    for axis, name, scale in (
        (speed, "belt_speed", 1 / radius),
        (roll, "roll", CHANNELS["roll"].display.scale),
    ):
        _lines(axis, trajectory, trajectory.time, scale * trajectory[name])
        for i, command in enumerate((scale * trajectory[f"{name}_command"]).T):
            style = {"color": MODULE_COLOURS[i], "label": f"module {i + 1}, commanded"} | DASHED
            axis.plot(trajectory.time, command, **style)
        _shade(axis, trajectory, trajectory.time)
    speed.set_ylabel("angular velocity [rad/s]")
    roll.set_ylabel("module roll [deg]")
    roll.set_xlabel("time [s]")
    limits = limits_of(CHANNELS["roll"].display, display_values(trajectory, "roll"))
    roll.set_ylim(*(limits or (None, None)))
    _legend(figure)
    return figure


@style()
def along_figure(result: Result) -> Figure:
    """Plot forces and slip of the modules along the pipe.

    Returns:
        Three panels over the arc length of the robot's centre [m]: traction [N], normal force [N],
        slip velocity [mm/s].
    """
    trajectory = result.trajectory

    figure = new_figure((7.2, 6.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for axis, name in zip(axes, ("traction", "normal_force", "slip_velocity"), strict=True):
        _lines(axis, trajectory, trajectory["distance"], display_values(trajectory, name))
        _shade(axis, trajectory, trajectory["distance"])
        axis.set_ylabel(CHANNELS[name].display.label())
    axes[-1].set_xlabel("arc length of the robot's centre [m]")
    _legend(figure)
    return figure


def _lines(axis: Axes, trajectory: Trajectory, x: NDArray, values: NDArray) -> None:
    """Draw ``values`` (T, 3) over ``x`` (T,), one line for each module."""
    inner = inner_module(trajectory)
    for i, column in enumerate(values.T):
        side = "" if inner is None else ", inner" if i == inner else ", outer"
        axis.plot(x, column, color=MODULE_COLOURS[i], label=f"module {i + 1}{side}", **LINES[i])
    if np.ptp(x) > 0:
        axis.set_xlim(x.min(), x.max())


def _shade(
    axis: Axes, trajectory: Trajectory, x: NDArray, phases: Collection[str] = tuple(PHASES)
) -> None:
    """Shade the named phases over ``x`` (T,)."""
    # A phase in which the robot stands still becomes a narrow strip, so that it is visible.
    narrowest = 0.004 * float(np.ptp(x))
    codes = trajectory["phase"].astype(int)
    for first, end in spans(codes):
        name = trajectory.phases[codes[first]]
        if name in phases:
            low, high = float(x[first : end + 1].min()), float(x[first : end + 1].max())
            grow = max(0.0, narrowest - (high - low)) / 2
            colour, label = PHASES[name]
            axis.axvspan(low - grow, high + grow, color=colour, lw=0, zorder=0, label=label)


def _legend(figure: Figure, columns: int = 3) -> None:
    """Name the lines and shades of the first panel, each once, above the panels."""
    handles, labels = figure.axes[0].get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    figure.legend(named.values(), named.keys(), loc="outside upper left", ncols=columns)
    figure.align_ylabels()


@style()
def contact_map_figure(result: Result) -> Figure:
    """Plot the unrolled pipe: where the modules ran, and how hard each was pressed to the wall.

    Returns:
        One panel: arc length [m] to the right, angle of the module from the turning direction [deg]
            up, normal force [N] as colour. Grey rings show where a module is off the wall (below
            ``NO_CONTACT_FORCE``). The bends and openings of the route are marked and named.
    """
    figure = new_figure((7.6, 4.4), layout="constrained")
    axis = figure.subplots()
    _contacts(axis, result.trajectory)
    _fittings(axis, result.scenario.route)
    # Somewhat beyond half a turn, so that marks at 180 degrees are whole.
    axis.set_ylim(-188, 188)
    axis.set_yticks(range(-180, 181, 60))
    axis.set_xlabel("arc length of the robot's centre [m]")
    axis.set_ylabel("angle around the pipe\nfrom the turning direction [deg]")
    _legend(figure, 4)
    return figure


def _contacts(axis: Axes, trajectory: Trajectory) -> None:
    """Draw the marks of the contact map, its colour bar and its shades."""
    distance = np.repeat(trajectory["distance"], MODULES)
    angle = np.degrees(wrap_angle(trajectory["theta5"][:, None] + np.array(MODULE_ANGLES)))
    for i, start in enumerate(angle[0]):  # (3,)
        style: dict[str, Any] = {"color": MODULE_COLOURS[i], "weight": "bold", "size": 8}
        name, at = f"module {i + 1}", (distance[0], start)
        axis.annotate(name, at, (2, 6), textcoords="offset points", **style)
    angle, force = angle.ravel(), trajectory["normal_force"].ravel()
    on = force >= NO_CONTACT_FORCE
    ring: dict[str, Any] = {"fc": "white", "ec": GREY, "lw": 0.9, "zorder": 4}
    name = f"no contact, below {NO_CONTACT_FORCE} N"
    axis.scatter(distance[~on], angle[~on], s=20, label=name, **ring)
    _shade(axis, trajectory, trajectory["distance"], ("elbow", "tee_turn", "tee_straight"))
    # At least 1 N: the colour bar needs a range where nothing touches, too.
    top = max(1.0, float(force[on].max(initial=0.0)))
    colours: dict[str, Any] = {"c": force[on], "cmap": "viridis_r", "vmin": 0, "vmax": top}
    points = axis.scatter(distance[on], angle[on], s=16, lw=0, **colours)
    bar = axis.figure.colorbar(points, ax=axis, pad=0.02)
    bar.set_label("normal force [N]")
    bar.outline.set_visible(False)  # type: ignore[operator]


def _fittings(axis: Axes, route: Route) -> None:
    """Name each bend or tee opening, between dotted lines where it begins and ends."""
    for passage in route.passages:
        start, end = passage.span
        if math.isfinite(start) and math.isfinite(end):
            for s in (start, end):
                axis.axvline(s, color=INK, lw=0.8, ls=":")
            name = route.network.parts[passage.index].name
            axis.text((start + end) / 2, 182, name, ha="center", va="top", size=8, color=INK)


SERIES_COLOURS = ("#2f6db3", "#d1591f", "#1c9a72", "#a8478f", "#22262b", "#b8901c")
_MARKERS = ("o", "s", "^", "D", "v", "P")


@style()
def elbow_figure(results: Mapping[str, Sequence[Result]]) -> Figure:
    """Compare controllers or robots in elbows over the start orientation.

    Args:
        results: the runs of each line, by the line's name.

    Returns:
        Four panels over theta5 at the start [deg]: tilt at the exit and largest tilt [deg], slip
        distance as the mean of the modules [mm], duration [s]. Runs that failed have hollow marks.
    """
    figure = new_figure((7.6, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for axis, (label, value) in zip(axes.flat, _ELBOW_PANELS, strict=True):
        for k, (name, runs) in enumerate(results.items()):
            _series(axis, k, name, runs, value)
        axis.set_ylabel(label)
        # From zero, with room for the marks above the largest value.
        axis.set_ylim(bottom=0.0, top=max(1.06 * axis.get_ylim()[1], 1e-3))
        axis.locator_params(axis="y", nbins=7)
    for axis in axes[-1]:
        axis.set_xlabel("theta5 at the start [deg]")
    figure.align_ylabels()
    # Not by their labels: a name may begin with an underscore, which hides it.
    handles = list(axes[0, 0].lines)
    for face, label in ((GREY, "passed"), ("white", "failed")):
        mark: dict[str, Any] = {"ls": "none", "marker": "o", "mec": GREY, "ms": 5}
        # Lines without data: the legend's own.
        handles += axes[0, 0].plot([], [], mfc=face, label=label, **mark)
    figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 5))
    return figure


def _series(
    axis: Axes, k: int, name: str, runs: Sequence[Result], value: Callable[[Result], float]
) -> None:
    """Draw one line of ``elbow_figure``, in the order of theta5."""
    # The line joins neighbours in theta5, whatever the order of the runs.
    ordered = sorted(runs, key=lambda run: run.scenario.start.theta5_deg)
    colour, marker = SERIES_COLOURS[k % len(SERIES_COLOURS)], _MARKERS[k % len(_MARKERS)]
    theta5 = [run.scenario.start.theta5_deg for run in ordered]
    values = [value(run) for run in ordered]
    line: dict[str, Any] = {"color": colour, "lw": 1.0, "alpha": 0.8, "zorder": 2}
    # Marks on the line for the legend only: those of the panel are filled run by run.
    axis.plot(theta5, values, marker=marker, markevery=[], label=name, **line)
    faces = [colour if run.success else "white" for run in ordered]
    axis.scatter(theta5, values, s=26, marker=marker, fc=faces, ec=colour, lw=1.1, zorder=3)


def _mean(name: str, scale: float = 1.0) -> Callable[[Result], float]:
    """Return a function that reads a metric, averaged over the modules; NaN if missing."""

    def read(result: Result) -> float:
        value: Any = result.metrics[name]
        return math.nan if value is None else scale * float(np.mean(value))

    return read


_ELBOW_PANELS: tuple[tuple[str, Callable[[Result], float]], ...] = (
    ("tilt at the exit [deg]", _mean("tilt_exit_deg")),
    ("largest tilt [deg]", _mean("tilt_max_deg")),
    ("slip distance,\nmean of the modules [mm]", _mean("slip_distance_m", 1e3)),
    ("duration [s]", lambda result: result.duration_s),
)


@style()
def rates_figure(
    groups: Sequence[tuple[str, int, int]],
    reference: float | None = None,
    label: str = "success rate",
) -> Figure:
    """Compare rates of several groups of runs with their 95 % intervals (``wilson_interval``).

    Args:
        groups: (name, passed, total) of each bar, from the top.
        reference: a rate from 0 to 1, drawn as a dashed line.
        label: name of the rate; the axis shows it in %.
    """
    figure = new_figure((6.4, 1.2 + 0.42 * max(1, len(groups))), layout="constrained")
    axis = figure.subplots()
    for k, group in enumerate(groups):
        _bar(axis, k, *group[1:])
    axis.set_yticks(range(len(groups)), [name for name, _, _ in groups])
    # Downward: the first group stands at the top.
    axis.set_ylim(max(len(groups), 1) - 0.4, -0.6)
    axis.set_xlim(0, 100)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    if reference is not None:
        percent = 100 * reference
        axis.axvline(percent, color=ALARM, lw=1.1, ls=(0, (4, 2)), label="reference")
        above: dict[str, Any] = {"transform": axis.get_xaxis_transform(), "ha": "center"}
        axis.text(percent, 1.02, f"reference {percent:.2f} %", color=ALARM, size=8, **above)
    axis.set_xlabel(f"{label} [%], with 95 % interval")
    return figure


def _bar(axis: Axes, k: int, passed: int, total: int) -> None:
    """Draw the bar of group ``k``, with its interval as a whisker and its counts at the right."""
    percent, text = 0.0, "none tried"
    if total:
        percent = 100 * passed / total
        text = f"{percent:.1f} %  ({passed} of {total})"
        ends = [100 * end for end in wilson_interval(passed, total)]
        whisker: dict[str, Any] = {"color": INK, "lw": 1.1, "marker": "|", "ms": 7, "mew": 1.1}
        # Whiskers that end at 0 or 100 % are drawn whole.
        axis.plot(ends, [k, k], clip_on=False, **whisker)
    axis.barh(k, percent, height=0.56, color=PASSED_COLOUR, alpha=0.55, lw=0)
    axis.text(1.03, k, text, transform=axis.get_yaxis_transform(), va="center", color=INK)
