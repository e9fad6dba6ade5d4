"""Figures of one run: shaft speeds, forces and slip as curves; contacts on the unrolled pipe."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.record.channels import MODULE_COLOURS
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, MODULES
from omnitrack_sim.show.plots.style import GREY, INK, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.pipes import Route
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result


PHASE_COLOURS = {
    "align": "#fbe9a6",
    "tee_turn": "#d3ebcb",
    "elbow": "#dbe6f3",
    "tee_straight": "#eadfeb",
}
"""Background of the phases; a phase that is not here stays white."""
PHASE_NAMES = {
    "align": "holonomic motion",
    "tee_turn": "turn",
    "elbow": "elbow",
    "tee_straight": "tee, straight on",
}
"""Names of the shaded phases in legends."""
LINES: tuple[dict[str, Any], ...] = ({"lw": 1.2}, {"lw": 2.8, "alpha": 0.5}, {"lw": 1.2})
"""Module 2 is drawn broad and pale below module 3, so that both are seen where they coincide."""


def inner_module(trajectory: Trajectory) -> int | None:
    """Index of the module that points into the first tee turn as it begins; None without one."""
    start = next((a for name, a, _ in phase_spans(trajectory) if name == "tee_turn"), None)
    if start is None:
        return None
    return int(np.argmin(np.abs(wrap_angle(trajectory["theta5"][start] + np.array(MODULE_ANGLES)))))


def module_names(trajectory: Trajectory) -> list[str]:
    inner = inner_module(trajectory)
    names = [f"module {i + 1}" for i in range(MODULES)]
    return (
        names
        if inner is None
        else [f"{name}, {'inner' if i == inner else 'outer'}" for i, name in enumerate(names)]
    )


def phase_spans(trajectory: Trajectory) -> Iterator[tuple[str, int, int]]:
    """The phases in order: name, first sample, sample of the end."""
    codes = trajectory["phase"]
    for first, end in spans(codes):
        yield trajectory.phases[int(codes[first])], first, end


def shade(
    axis: Axes, trajectory: Trajectory, x: NDArray, phases: Sequence[str] = tuple(PHASE_COLOURS)
) -> None:
    """Shade the named phases over ``x`` (T,).

    A phase in which the robot stands still becomes a narrow strip, so that it is seen.
    """
    narrowest = 0.004 * float(np.ptp(x))
    for name, a, b in phase_spans(trajectory):
        if name in phases:
            low, high = float(x[a : b + 1].min()), float(x[a : b + 1].max())
            grow = max(0.0, narrowest - (high - low)) / 2
            axis.axvspan(
                low - grow,
                high + grow,
                color=PHASE_COLOURS[name],
                lw=0,
                zorder=0,
                label=PHASE_NAMES[name],
            )


def phase_patches(trajectory: Trajectory) -> list[Any]:
    from matplotlib.patches import Patch

    present = {name for name, _, _ in phase_spans(trajectory)}
    shown = [name for name in PHASE_COLOURS if name in present]
    return [
        Patch(fc=PHASE_COLOURS[name], ec=GREY, lw=0.4, label=PHASE_NAMES[name]) for name in shown
    ]


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
    from omnitrack_sim.show.plots.style import new_figure

    radius = result.scenario.robot.lug_radius if lug_radius is None else lug_radius
    trajectory = result.trajectory

    def draw() -> Figure:
        figure = new_figure((7.2, 4.8), layout="constrained")
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
    from omnitrack_sim.show.plots.style import new_figure

    trajectory = result.trajectory
    channels = ("traction", 1.0), ("normal_force", 1.0), ("slip_velocity", _MM)

    def draw() -> Figure:
        figure = new_figure((7.2, 6.2), layout="constrained")
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
        # In inches from the top, so that the rows stand alike above figures of any height.
        place = (0.0, 1 - (0.02 + 0.22 * k) / height)
        figure.legend(
            handles=row, loc="upper left", bbox_to_anchor=place, ncols=len(row), borderaxespad=0.2
        )
    # The panels get what the legend leaves.
    room = 1 - (0.12 + 0.22 * len(rows)) / height
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, room))  # type: ignore[union-attr]


def _at_least(axis: Axes, height: float) -> None:
    """Widen the y range to ``height``, so that a constant value does not look like movement."""
    low, high = axis.get_ylim()
    if high - low < height:
        axis.set_ylim((low + high - height) / 2, (low + high + height) / 2)


NO_CONTACT_FORCE = 0.5
"""Normal force below which a module counts as off the wall, N."""


def contact_map_figure(result: Result, route: Route | None = None) -> Figure:
    """The unrolled pipe: where the modules ran, and how hard each was pressed to the wall.

    Args:
        result: the run.
        route: if given, its fittings are marked and named.

    Returns:
        One panel: arc length [m] to the right, angle of the module from the turning direction [deg]
            up, normal force [N] as colour. Grey rings show where a module is off the wall (below
            ``NO_CONTACT_FORCE``).
    """
    from omnitrack_sim.show.plots.style import new_figure

    def draw() -> Figure:
        figure = new_figure((7.6, 4.4), layout="constrained")
        axis = figure.subplots()
        _contacts(axis, result.trajectory)
        if route is not None:
            _fittings(axis, route)
        return figure

    return styled(draw)


def _contacts(axis: Axes, trajectory: Trajectory) -> None:
    """The marks of the contact map, its colour bar and its shades."""
    distance = np.repeat(trajectory["distance"], MODULES)
    angle = wrap_angle(trajectory["theta5"][:, None] + np.array(MODULE_ANGLES))
    angle = np.degrees(angle)  # (T, 3)
    force = trajectory["normal_force"].ravel()
    on, off = force >= NO_CONTACT_FORCE, ~(force >= NO_CONTACT_FORCE)
    shade(axis, trajectory, trajectory["distance"], ("elbow", "tee_turn", "tee_straight"))
    axis.scatter(
        distance[off],
        angle.ravel()[off],
        s=20,
        fc="white",
        ec=GREY,
        lw=0.9,
        label="no contact",
        zorder=4,
    )
    # At least 1 N: the colour bar needs a range where nothing touches, too.
    top = max(1.0, float(force[on].max(initial=0.0)))
    points = axis.scatter(
        distance[on],
        angle.ravel()[on],
        c=force[on],
        s=16,
        lw=0,
        cmap="viridis_r",
        vmin=0,
        vmax=top,
        label="contact",
    )
    bar = axis.figure.colorbar(points, ax=axis, pad=0.02)
    bar.set_label("normal force [N]")
    bar.outline.set_visible(False)  # type: ignore[operator]
    for i in range(MODULES):
        at = (trajectory["distance"][0], angle[0, i])
        axis.annotate(
            f"module {i + 1}",
            at,
            (2, 6),
            textcoords="offset points",
            color=MODULE_COLOURS[i],
            weight="bold",
            size=8,
        )
    _unrolled(axis, trajectory)


def _unrolled(axis: Axes, trajectory: Trajectory) -> None:
    """Axes and legend of the contact map."""
    from matplotlib.lines import Line2D

    # Somewhat beyond half a turn, so that marks at 180 degrees are whole.
    axis.set_ylim(-188, 188)
    axis.set_yticks(range(-180, 181, 60))
    axis.set_xlabel("arc length of the robot's centre [m]")
    axis.set_ylabel("angle around the pipe\nfrom the turning direction [deg]")
    ring = Line2D(
        [],
        [],
        ls="none",
        marker="o",
        mfc="white",
        mec=GREY,
        ms=4.5,
        label=f"no contact, below {NO_CONTACT_FORCE} N",
    )
    shades = [
        patch for patch in phase_patches(trajectory) if patch.get_label() != PHASE_NAMES["align"]
    ]
    axis.figure.legend(handles=[ring, *shades], loc="outside upper left", ncols=4)  # type: ignore[union-attr]


def _fittings(axis: Axes, route: Route) -> None:
    """Name each bend or tee opening, between dotted lines where it begins and ends."""
    for fitting in route.passages:
        start, end = fitting.span
        if math.isfinite(start) and math.isfinite(end):
            for s in (start, end):
                axis.axvline(s, color=INK, lw=0.8, ls=":")
            name = route.network.parts[fitting.index].name
            axis.text((start + end) / 2, 182, name, ha="center", va="top", size=8, color=INK)
