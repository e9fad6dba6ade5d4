"""Figures of manoeuvres: one run over time and along the pipe, and comparisons of many runs.

In polar panels the turning direction points right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.plots.style import ALARM, GREY, INK, MODULE_COLOURS, styled
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.robot import MODULE_ANGLES, MODULES
from omnitrack_sim.rotations import wrap_angle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

    from omnitrack_sim.pipes import Route
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.sim.result import Result

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
PASSED_COLOUR, FAILED_COLOUR, SINGULAR_COLOUR = "#2f6db3", "#e8882e", "#f6e3a3"
SERIES_COLOURS = ("#2f6db3", "#d1591f", "#1c9a72", "#a8478f", "#22262b", "#b8901c")
NO_CONTACT_FORCE = 0.5
"""Normal force below which a module counts as off the wall, N."""
_LINES: tuple[dict[str, Any], ...] = ({"lw": 1.2}, {"lw": 2.8, "alpha": 0.5}, {"lw": 1.2})
"""Module 2 is drawn broad and pale below module 3: in a symmetric turn they coincide, and both
shall be seen."""
_DASHES: Any = (0, (4, 2))
_MARKERS = ("o", "s", "^", "D", "v", "P")
_MM = 1e3


def angular_velocity_figure(result: Result, lug_radius: float | None = None) -> Figure:
    """Shaft speeds of the crawlers over time, and the roll of the modules (the paper's Fig. 13).

    Args:
        result: the run.
        lug_radius: m, belt speed over shaft speed; none: that of the scenario's robot.

    Returns:
        Two panels over time [s]: angular velocity [rad/s], commanded dashed, and module roll [deg].
    """
    from matplotlib.figure import Figure

    radius = result.scenario.robot.lug_radius if lug_radius is None else lug_radius
    trajectory = result.trajectory

    def draw() -> Figure:
        figure = Figure(figsize=(7.2, 4.8), layout="constrained")
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
    from matplotlib.figure import Figure

    trajectory = result.trajectory
    channels = ("traction", 1.0), ("normal_force", 1.0), ("slip_velocity", _MM)

    def draw() -> Figure:
        figure = Figure(figsize=(7.2, 6.2), layout="constrained")
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


def contact_map_figure(result: Result, route: Route | None = None) -> Figure:
    """The unrolled pipe: where the modules ran, and how hard each was pressed to the wall.

    Args:
        result: the run.
        route: its fittings are marked and named where given.

    Returns:
        One panel: arc length [m] across, angle of the module from the turning direction [deg] up,
            normal force [N] as
        colour; grey rings where a module is off the wall (below ``NO_CONTACT_FORCE``).
    """
    from matplotlib.figure import Figure

    def draw() -> Figure:
        figure = Figure(figsize=(7.6, 4.4), layout="constrained")
        axis = figure.subplots()
        _contacts(axis, result.trajectory)
        if route is not None:
            _fittings(axis, route)
        return figure

    return styled(draw)


def success_figure(
    theta5_deg: ArrayLike,
    passed: Mapping[str, ArrayLike],
    sector_deg: float,
    period_deg: float = 120,
    real_margin_deg: float | None = None,
) -> Figure:
    """Which start orientations pass a fitting, beside the singular range of the formula.

    Args:
        theta5_deg: (M,) deg, orientations; those outside half a period are wrapped. A cell that
            several runs share has the colour of their success rate.
        passed: (M,) bool for each row of the figure; or 0, 1, and not a number for what the row
            does not have.
        sector_deg: deg, singular sector on the pipe's circumference.
        period_deg: deg, after which orientations repeat.
        real_margin_deg: deg, half-width of the safe range in the real geometry.

    Returns:
        Left over theta5 [deg] with each row's success rate [%]; right the same as rings, repeated
        around the circle.
    """
    from matplotlib.figure import Figure

    theta5 = _wrapped(np.asarray(theta5_deg, float), period_deg)
    rows = {
        name: _cells(theta5, np.asarray(values, float), period_deg)
        for name, values in passed.items()
    }
    rates = [float(np.nanmean(np.asarray(values, float))) for values in passed.values()]
    margin = (period_deg - sector_deg) / 2

    def draw() -> Figure:
        figure = Figure(figsize=(9.2, max(3.6, 2.2 + 0.5 * len(rows))), layout="constrained")
        line = figure.add_subplot(figure.add_gridspec(1, 2, width_ratios=(1.75, 1))[0])
        ring: Any = figure.add_subplot(1, 2, 2, projection="polar")
        ring.set_subplotspec(line.get_gridspec()[1])  # type: ignore[union-attr]
        _success_rows(line, rows, rates, period_deg)
        _success_rings(ring, list(rows.values()), margin, period_deg, real_margin_deg)
        _margins(line, margin, period_deg / 2, real_margin_deg)
        _success_legend(figure, rows, margin, period_deg / 2, real_margin_deg)
        return figure

    return styled(draw)


def elbow_figure(results: Mapping[str, Sequence[Result]]) -> Figure:
    """Controllers or robots compared in elbows over the start orientation.

    Args:
        results: the runs of each line.

    Returns:
        Four panels over theta5 at the start [deg]: tilt at the exit and largest tilt [deg], slip
            distance, mean over
        the modules [mm], duration [s]. Runs that failed have hollow marks.
    """
    from matplotlib.figure import Figure

    def draw() -> Figure:
        figure = Figure(figsize=(7.6, 5.2), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True)
        for axis, (label, value) in zip(axes.flat, _ELBOW_PANELS, strict=True):
            for k, runs in enumerate(results.values()):
                _series(axis, k, runs, value)
            axis.set_ylabel(label)
            _from_zero(axis)
            axis.locator_params(axis="y", nbins=7)
        for axis in axes[-1]:
            axis.set_xlabel("theta5 at the start [deg]")
        figure.align_ylabels()
        _series_legend(figure, list(results))
        return figure

    return styled(draw)


def rates_figure(
    groups: Sequence[tuple[str, int, int]],
    reference: float | None = None,
    label: str = "success rate",
) -> Figure:
    """Rates of several groups of runs with their 95 % intervals (``statistics.wilson_interval``).

    Args:
        groups: (name, passed, total) of each bar, from the top.
        reference: a rate, 0 to 1, drawn as a dashed line.
        label: what the rate is; the axis has it in %.
    """
    from matplotlib.figure import Figure

    def draw() -> Figure:
        figure = Figure(figsize=(6.4, 1.2 + 0.42 * max(1, len(groups))), layout="constrained")
        axis = figure.subplots()
        _bars(axis, groups)
        if reference is not None:
            _reference(axis, 100 * reference)
        axis.set_xlabel(f"{label} [%], with 95 % interval")
        return figure

    return styled(draw)


def inner_module(trajectory: Trajectory) -> int | None:
    """Index of the module that points into the turn when the first tee turn begins; None without
    such a phase."""
    start = next((a for name, a, _ in _spans(trajectory) if name == "tee_turn"), None)
    if start is None:
        return None
    return int(np.argmin(np.abs(wrap_angle(trajectory["theta5"][start] + np.array(MODULE_ANGLES)))))


def _module_names(trajectory: Trajectory) -> list[str]:
    inner = inner_module(trajectory)
    names = [f"module {i + 1}" for i in range(MODULES)]
    return (
        names
        if inner is None
        else [f"{name}, {'inner' if i == inner else 'outer'}" for i, name in enumerate(names)]
    )


def _spans(trajectory: Trajectory) -> Iterator[tuple[str, int, int]]:
    """The phases in order: (name, first sample, sample of its end)."""
    codes = trajectory["phase"]
    for first, end in spans(codes):
        yield trajectory.phases[int(codes[first])], first, end


def _module_lines(axis: Axes, trajectory: Trajectory, x: NDArray, values: NDArray) -> None:
    """One line a module of ``values`` (T, 3) over ``x`` (T,)."""
    for i, name in enumerate(_module_names(trajectory)):
        axis.plot(x, values[:, i], color=MODULE_COLOURS[i], label=name, **_LINES[i])


def _pairs(axis: Axes, trajectory: Trajectory, measured: NDArray, commanded: NDArray) -> None:
    """Measured solid and commanded dashed, both (T, 3), over time."""
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
    """Shades, labels and limits of panels that share ``x`` (T,)."""
    for axis, ylabel in zip(axes, ylabels, strict=True):
        _shade(axis, trajectory, x)
        axis.set_ylabel(ylabel)
        axis.locator_params(
            axis="y", nbins=7
        )  # ticks that follow the panel's size would push labels out of the page
        if np.ptp(x) > 0:
            axis.set_xlim(x.min(), x.max())
    axes[-1].set_xlabel(xlabel)
    axes[0].figure.align_ylabels()


def _shade(
    axis: Axes, trajectory: Trajectory, x: NDArray, phases: Sequence[str] = tuple(PHASE_COLOURS)
) -> None:
    """Shade the named phases over ``x`` (T,); one in which the robot stands still is a narrow
    strip."""
    narrowest = 0.004 * float(np.ptp(x))
    for name, a, b in _spans(trajectory):
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


def _head(figure: Figure, trajectory: Trajectory, commanded: bool = False) -> None:
    """The legend above the panels: modules in the first row; line style and phases in the
    second."""
    from matplotlib.lines import Line2D

    names = _module_names(trajectory)
    lines = [
        Line2D([], [], color=MODULE_COLOURS[i], label=names[i], **_LINES[i]) for i in range(MODULES)
    ]
    if commanded:
        lines.append(Line2D([], [], color=GREY, lw=0.9, ls=_DASHES, label="commanded"))
    rows = [row for row in (lines, _phase_patches(trajectory)) if row]
    height = figure.get_figheight()
    for k, row in enumerate(rows):
        place = (0.0, 1 - (0.02 + 0.22 * k) / height)
        figure.legend(
            handles=row, loc="upper left", bbox_to_anchor=place, ncols=len(row), borderaxespad=0.2
        )
    room = 1 - (0.12 + 0.22 * len(rows)) / height
    figure.get_layout_engine().set(rect=(0.0, 0.0, 1.0, room))  # type: ignore[union-attr]


def _phase_patches(trajectory: Trajectory) -> list[Any]:
    from matplotlib.patches import Patch

    present = {name for name, _, _ in _spans(trajectory)}
    shown = [name for name in PHASE_COLOURS if name in present]
    return [
        Patch(fc=PHASE_COLOURS[name], ec=GREY, lw=0.4, label=PHASE_NAMES[name]) for name in shown
    ]


def _at_least(axis: Axes, height: float) -> None:
    """Widen the y range to ``height``: a quantity that only holds shall not look like a
    movement."""
    low, high = axis.get_ylim()
    if high - low < height:
        axis.set_ylim((low + high - height) / 2, (low + high + height) / 2)


def _from_zero(axis: Axes) -> None:
    """Start the y range at zero, with room for the marks above the largest value."""
    axis.set_ylim(bottom=0.0, top=max(1.06 * axis.get_ylim()[1], 1e-3))


def _contacts(axis: Axes, trajectory: Trajectory) -> None:
    """The marks of the contact map, its colour bar and its shades."""
    distance = np.repeat(trajectory["distance"], MODULES)
    angle = np.degrees(
        wrap_angle(trajectory["theta5"][:, None] + np.array(MODULE_ANGLES))
    )  # (T, 3)
    force = trajectory["normal_force"].ravel()
    on, off = force >= NO_CONTACT_FORCE, ~(force >= NO_CONTACT_FORCE)
    _shade(axis, trajectory, trajectory["distance"], ("elbow", "tee_turn", "tee_straight"))
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
        patch for patch in _phase_patches(trajectory) if patch.get_label() != PHASE_NAMES["align"]
    ]
    axis.figure.legend(handles=[ring, *shades], loc="outside upper left", ncols=4)  # type: ignore[union-attr]


def _fittings(axis: Axes, route: Route) -> None:
    """Dotted lines where each bend or tee opening begins and ends, with the fitting's name between
    them."""
    for fitting in route.fittings:
        start, end = fitting.span
        if math.isfinite(start) and math.isfinite(end):
            for s in (start, end):
                axis.axvline(s, color=INK, lw=0.8, ls=":")
            name = route.network.parts[fitting.index].name
            axis.text((start + end) / 2, 182, name, ha="center", va="top", size=8, color=INK)


def _wrapped(theta5: NDArray, period: float) -> NDArray:
    """Orientations (M,) within half a period of zero; both ends are kept as they are."""
    inside = np.abs(theta5) <= period / 2 + 1e-9
    return np.where(inside, theta5, wrap_angle(theta5, period))


def _cells(theta5: NDArray, passed: NDArray, period: float) -> tuple[NDArray, NDArray]:
    """Edges (K + 1,) deg and success rates (K,) of the different orientations; edges may lie beyond
    half a period."""
    if theta5.shape != passed.shape or theta5.ndim != 1 or not len(theta5):
        raise ValueError(
            f"orientations {theta5.shape} and outcomes {passed.shape} are not two rows of one "
            "length"
        )
    known = np.isfinite(passed)
    theta5, passed = theta5[known], passed[known]
    centres, cell = np.unique(np.round(theta5, 6), return_inverse=True)
    rate = np.bincount(cell, passed) / np.bincount(cell)
    if len(centres) == 1:
        return centres[0] + np.array([-0.01, 0.01]) * period, rate
    gaps = np.diff(centres, append=centres[0] + period)  # the last one reaches around
    first = centres[0] - min(gaps[0], gaps[-1]) / 2
    last = centres[-1] + min(gaps[-2], gaps[-1]) / 2
    return np.array([first, *(centres[1:] + centres[:-1]) / 2, last]), rate


def success_colours() -> Any:
    """Colour map from failed to passed."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("success", [FAILED_COLOUR, PASSED_COLOUR])


def _mesh(axis: Axes, edges: NDArray, middle: float, rate: NDArray) -> None:
    axis.pcolormesh(
        edges,
        [middle - 0.32, middle + 0.32],
        rate[None],
        cmap=success_colours(),
        vmin=0,
        vmax=1,
        zorder=2,
    )


def _success_rows(
    axis: Axes, rows: Mapping[str, tuple[NDArray, NDArray]], rates: Sequence[float], period: float
) -> None:
    """One row of cells a key, the first on top, with its success rate at the right."""
    for k, ((edges, rate), mean) in enumerate(zip(rows.values(), rates, strict=True)):
        for shift in (-period, 0.0, period):
            _mesh(axis, edges + shift, k, rate)
        axis.text(
            1.015,
            k,
            f"{100 * mean:.1f} %",
            transform=axis.get_yaxis_transform(),
            va="center",
            color=INK,
            weight="bold",
        )
    axis.text(
        1.015, -0.78, "passed", transform=axis.get_yaxis_transform(), va="center", color=INK, size=8
    )
    axis.set_yticks(range(len(rows)), list(rows))
    axis.set_ylim(len(rows) - 0.45, -0.95)
    axis.set_xlim(-period / 2, period / 2)
    axis.set_xticks(np.linspace(-period / 2, period / 2, 9))
    axis.tick_params(axis="y", length=0)
    axis.grid(False)
    axis.set_xlabel("theta5 at the start [deg]")


def _singular_bands(margin: float, half: float) -> list[tuple[float, float]]:
    """Ranges of theta5, deg, that the formula calls singular: beyond ``margin`` on both sides up to
    ``half``."""
    if margin >= half:
        return []
    return [(-half, -margin), (margin, half)] if margin > 0 else [(-half, half)]


def _margins(axis: Axes, margin: float, half: float, real_margin: float | None) -> None:
    """The singular range behind the rows, its borders and those of the real geometry before
    them."""
    for low, high in _singular_bands(margin, half):
        axis.axvspan(
            low, high, color=SINGULAR_COLOUR, lw=0, zorder=0, label="singular by the formula"
        )
    if 0 < margin < half:
        for side in (-margin, margin):
            axis.axvline(side, color=INK, lw=0.9, zorder=3)
    if real_margin is not None:
        for side in (-real_margin, real_margin):
            axis.axvline(side, color=INK, lw=1.1, ls=_DASHES, zorder=3, label="real geometry")


def _success_rings(
    axis: PolarAxes,
    rows: Sequence[tuple[NDArray, NDArray]],
    margin: float,
    period: float,
    real_margin: float | None,
) -> None:
    """The rows as rings, the first outermost, repeated every ``period`` deg."""
    inside = 0.8 + 0.35 * len(rows)
    outside = inside + len(rows) + 0.2
    singular = min(period, period - 2 * margin)
    for turn in np.radians(period) * np.arange(round(360 / period)):
        if singular > 0:
            middle, width = turn + np.radians(period / 2), np.radians(singular)
            axis.bar(middle, outside - inside, width, inside, color=SINGULAR_COLOUR, lw=0, zorder=0)
        for k, (edges, rate) in enumerate(rows):
            _mesh(axis, turn + np.radians(edges), outside - 0.6 - k, rate)
        for side in () if real_margin is None else (-real_margin, real_margin):
            axis.plot(
                [turn + np.radians(side)] * 2, [inside, outside], color=INK, lw=1.1, ls=_DASHES
            )
    axis.set_ylim(0, outside)
    axis.set_yticks([])
    axis.grid(False)
    axis.set_xticks(np.radians(np.arange(0, 360, 30)))
    axis.set_xlabel("theta5 [deg], outer ring: top row")


def _success_legend(
    figure: Figure,
    rows: Mapping[str, tuple[NDArray, NDArray]],
    margin: float,
    half: float,
    real_margin: float | None,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(fc=PASSED_COLOUR, label="passed"),
        Patch(fc=FAILED_COLOUR, label="failed"),
    ]
    if any(((rate > 0) & (rate < 1)).any() for _, rate in rows.values()):
        handles.insert(1, Patch(fc=success_colours()(0.5), label="some passed"))
    if margin < half:
        beyond = f", beyond ±{margin:.2f}°" if margin > 0 else ""
        handles.append(
            Patch(fc=SINGULAR_COLOUR, ec=INK, lw=0.5, label=f"singular by the formula{beyond}")
        )
    if real_margin is not None:
        handles.append(
            Line2D(
                [], [], color=INK, lw=1.1, ls=_DASHES, label=f"real geometry, ±{real_margin:.2f}°"
            )
        )
    figure.legend(handles=handles, loc="outside upper left", ncols=len(handles))


def _series(axis: Axes, k: int, runs: Sequence[Result], value: Callable[[Result], float]) -> None:
    """One line of ``elbow_figure``, in the order of theta5."""
    ordered = sorted(runs, key=lambda run: run.scenario.start.theta5_deg)
    colour, marker = SERIES_COLOURS[k % len(SERIES_COLOURS)], _MARKERS[k % len(_MARKERS)]
    theta5 = [run.scenario.start.theta5_deg for run in ordered]
    values = [value(run) for run in ordered]
    axis.plot(theta5, values, color=colour, lw=1.0, alpha=0.8, zorder=2)
    faces = [colour if run.success else "white" for run in ordered]
    axis.scatter(theta5, values, s=26, marker=marker, fc=faces, ec=colour, lw=1.1, zorder=3)


def _series_legend(figure: Figure, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            color=SERIES_COLOURS[k % len(SERIES_COLOURS)],
            marker=_MARKERS[k % len(_MARKERS)],
            label=name,
        )
        for k, name in enumerate(names)
    ]
    for face, label in ((GREY, "passed"), ("white", "failed")):
        handles.append(Line2D([], [], ls="none", marker="o", mfc=face, mec=GREY, ms=5, label=label))
    figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 5))


def _number(result: Result, name: str) -> float:
    """A metric, the mean over the modules of one that has three; not a number where a diverged run
    left none."""
    value: Any = result.metrics[name]
    return math.nan if value is None else float(np.mean(value))


_ELBOW_PANELS: tuple[tuple[str, Callable[[Result], float]], ...] = (
    ("tilt at the exit [deg]", lambda result: _number(result, "tilt_exit_deg")),
    ("largest tilt [deg]", lambda result: _number(result, "tilt_max_deg")),
    (
        "slip distance,\nmean of the modules [mm]",
        lambda result: _MM * _number(result, "slip_distance_m"),
    ),
    ("duration [s]", lambda result: result.duration_s),
)


def _bars(axis: Axes, groups: Sequence[tuple[str, int, int]]) -> None:
    """One bar a group, its interval as a whisker and its counts at the right."""
    for k, (_, passed, total) in enumerate(groups):
        rate = passed / total if total else 0.0
        low, high = wilson_interval(passed, total)
        axis.barh(k, 100 * rate, height=0.56, color=PASSED_COLOUR, alpha=0.55, lw=0)
        if total:
            axis.plot(
                [100 * low, 100 * high],
                [k, k],
                color=INK,
                lw=1.1,
                marker="|",
                ms=7,
                mew=1.1,
                clip_on=False,
            )
        text = f"{100 * rate:.1f} %  ({passed} of {total})" if total else "none tried"
        axis.text(1.03, k, text, transform=axis.get_yaxis_transform(), va="center", color=INK)
    axis.set_yticks(range(len(groups)), [name for name, _, _ in groups])
    axis.set_ylim(max(len(groups), 1) - 0.4, -0.6)
    axis.set_xlim(0, 100)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")


def _reference(axis: Axes, percent: float) -> None:
    axis.axvline(percent, color=ALARM, lw=1.1, ls=_DASHES, label="reference")
    text = f"reference {percent:.2f} %"
    axis.text(
        percent, 1.02, text, transform=axis.get_xaxis_transform(), ha="center", color=ALARM, size=8
    )
