"""A run drawn into its pipes: slip and normal force along the way driven, and what happened
when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.pipes import Assembly, Route
from omnitrack_sim.plots.network import draw_pipes, faces, middle, widest_view
from omnitrack_sim.plots.style import ALARM, INK, save_figure, styled
from omnitrack_sim.plots.time_chart import START, Mark, draw_time_chart, signs
from omnitrack_sim.record.timeline import (
    FORCE_WINDOW,
    RETRY_PHASE,
    ROLL_PHASE,
    begun,
    running_mean,
)
from omnitrack_sim.rotations import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.sim.result import Result

BIN = 0.01
"""Travel that shares one colour, m."""
BESIDE = 0.5
"""How far beside the axis tail-first travel is drawn, in bore radii."""
_WIDTH, _LEFT, _RIGHT, _BETWEEN = (
    12.0,
    0.82,
    0.25,
    0.85,
)  # inches: of the figure, beside it, between its columns
_COLUMN, _TALLEST = (
    (_WIDTH - _LEFT - _RIGHT - _BETWEEN) / 2,
    5.6,
)  # inches: room for the views of one quantity
_HEAD, _STACKED, _ASIDE = 0.66, 0.30, 0.72  # inches: title, gaps between two views
_AXES = "xyz"
_PLATE: dict[str, Any] = {
    "facecolor": f"{ALARM}40",
    "edgecolor": ALARM,
    "linewidth": 2.5,
    "joinstyle": "bevel",
}
_GOAL: dict[str, Any] = START | {
    "marker": "*",
    "markersize": 13,
    "markerfacecolor": "#ffd23f",
    "markeredgewidth": 0.9,
}


@dataclass(frozen=True)
class _Stretch:
    """Travel on one leg in pieces of ``BIN``: rows (n + 1,) that bound them, and the values (n,) of
    each."""

    leg: int
    tail_first: bool
    rows: NDArray[np.intp]
    slip: Array
    force: Array


def plot_mission(result: Result, path: str | Path, format: str | None = None) -> None:
    """Write the figure of ``mission_figure``.

    Raises:
        InputError: no such format. OSError: the file cannot be written.
    """
    save_figure(mission_figure(result), path, format)


def mission_figure(result: Result) -> Figure:
    """Map and time chart of a run.

    The map shows the pipes in elevation and plan, with the way of the robot's centre in them. On
    the left its colour is the slip ratio, the mean of the modules' magnitudes over 10 mm of travel;
    on the right the least normal force of a module there, of a mean over 0.1 s. Travel tail first
    is drawn beside the axis, on the right-hand side of its direction, with a dashed core. The chart
    below has the fittings as bands, tilt and speed over time.
    """
    return styled(lambda: _draw(result))


def _draw(result: Result) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    routes = result.routes()
    pipes, trajectory = routes[0].network, result.trajectory
    quads = faces(pipes)
    marks = _marks(result)
    stretches = list(_stretches(trajectory))
    layout = _Layout(quads, len({s.leg for s in stretches}) > 1)
    figure = Figure(figsize=(_WIDTH, layout.height))
    canvas = FigureCanvasAgg(figure)  # names are measured as they are drawn
    renderer = canvas.get_renderer()
    _title(figure, result, routes, layout)
    quantities = (
        (
            "slip ratio, mean magnitude of the modules over 10 mm",
            "viridis",
            [s.slip for s in stretches],
        ),
        ("least normal force of a module, N", "plasma", [s.force for s in stretches]),
    )
    start, goals, plates = trajectory["position"][:1], result.goal_points(), result.plate_rims()
    for column, (text, colours, values) in enumerate(quantities):
        scale = _colour_bar(figure, layout, column, text, colours, values)
        axes = []
        for view in layout.views:
            axis = layout.add(figure, view, column)
            draw_pipes(axis, pipes, view.pair, quads)
            _draw_way(axis, view, trajectory, routes, stretches, values, scale)
            _draw_places(axis, view.pair, start, goals, plates)
            _draw_marks(axis, view.pair, trajectory, marks)
            axes.append(axis)
        _names(
            axes,
            layout,
            renderer,
            pipes,
            np.concatenate([trajectory["position"][s.rows] for s in stretches]),
        )
    _legend(figure, layout, marks, any(s.tail_first for s in stretches), len(plates) > 0)
    draw_time_chart(
        layout.chart(figure), (layout.legs, layout.strip), renderer, trajectory, routes, marks
    )
    return figure


@dataclass(frozen=True)
class _View:
    """One view of the pipes: world axes to the right and up, their limits in m, and its place in
    its column, inches."""

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
        """Whether the second axis points down: with y to the right, x does when seen from above."""
        return self.pair == (1, 0)


class _Layout:
    """Where everything stands, inches from the lower left corner: views are as large as their
    column holds."""

    def __init__(self, quads: Array, several_legs: bool) -> None:
        low, high = quads.reshape(-1, 3).min(axis=0), quads.reshape(-1, 3).max(axis=0)
        room = 0.04 * (high - low).max()
        low, high = low - room, high + room
        across = 0 if high[0] - low[0] >= high[1] - low[1] else 1
        other = 1 - across
        width, depth, tall = (high - low)[[across, other, 2]]
        stacked = min(_COLUMN / width, (_TALLEST - _STACKED) / (tall + depth))
        aside = min((_COLUMN - _ASIDE) / (2 * width), _TALLEST / max(tall, depth))
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
        margin = (_COLUMN - total) / 2
        texts = (f"elevation, along {'yx'[across]}", "plan, from above")
        self.views = [
            _View(
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
        self.legs = 0.2 if several_legs else 0.0
        self.chart_bottom = 0.48
        self.panel = 1.05
        self.strip = 0.62
        self.legend = self.chart_bottom + 2 * self.panel + 0.14 + self.legs + self.strip + 0.36
        self.map_bottom = self.legend + 0.82
        self.bar = self.map_bottom + self.map_height + 0.54
        self.height = self.bar + 0.14 + _HEAD
        self.left_of = [_LEFT, _LEFT + _COLUMN + _BETWEEN]

    def box(
        self, left: float, bottom: float, width: float, height: float
    ) -> tuple[float, float, float, float]:
        """The same rectangle in parts of the figure."""
        return left / _WIDTH, bottom / self.height, width / _WIDTH, height / self.height

    def add(self, figure: Figure, view: _View, column: int) -> Axes:
        """The axes of one view, at scale."""
        left, bottom = self.left_of[column] + view.left, self.map_bottom + view.bottom
        axis: Axes = figure.add_axes(self.box(left, bottom, view.width, view.height))
        for name, index, limits in zip(
            "xy", view.pair, zip(view.low, view.high, strict=True), strict=True
        ):
            getattr(axis, f"set_{name}lim")(
                *(limits[::-1] if view.flipped and name == "y" else limits)
            )
            getattr(axis, f"set_{name}label")(f"{_AXES[index]}, m")
            getattr(axis, f"{name}axis").set_major_locator(_ticks(limits[1] - limits[0]))
        axis.set_title(view.title, loc="left", fontsize=8.5, color=INK, pad=4)
        if not self.aside and view is self.views[0]:
            axis.set_xlabel("")
            axis.tick_params(labelbottom=False)
        axis.autoscale(False)
        return axis

    def chart(self, figure: Figure) -> tuple[Axes, Axes, Axes]:
        """Axes of the time chart: bands, tilt, speed."""
        width, tilt = _WIDTH - _LEFT - _RIGHT, self.chart_bottom + self.panel + 0.14
        rows = (
            (tilt + self.panel, self.legs + self.strip),
            (tilt, self.panel),
            (self.chart_bottom, self.panel),
        )
        strip, above, below = (
            figure.add_axes(self.box(_LEFT, bottom, width, height)) for bottom, height in rows
        )
        for axis in (above, below):
            axis.yaxis.set_label_coords(-0.045, 0.5)
        return strip, above, below


def _ticks(length: float) -> Any:
    """Ticks at the same round distances in every view of about this length, m."""
    from matplotlib.ticker import MultipleLocator

    steps = np.array([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0])
    return MultipleLocator(float(steps[np.argmax(length / steps <= 6)]))


def _title(figure: Figure, result: Result, routes: tuple[Route, ...], layout: _Layout) -> None:
    top = 1 - 0.16 / layout.height
    figure.text(
        _LEFT / _WIDTH, top, result.scenario.name, size=14, weight="bold", color=INK, va="top"
    )
    outcome = result.outcome.value.replace("_", " ")
    travel = sum(float(np.abs(np.diff(rows)).sum()) for rows in _distances(result.trajectory))
    text = f"{outcome} after {result.duration_s:.2f} s, {travel:.2f} m driven"
    if len(routes) > 1:
        text += f" on {int(result.trajectory['leg'].max()) + 1} of {len(routes)} legs"
    colour = INK if result.success else ALARM
    figure.text(1 - _RIGHT / _WIDTH, top, text, size=11, color=colour, va="top", ha="right")


def _distances(trajectory: Trajectory) -> list[Array]:
    """The finite distances of each leg, m."""
    leg, distance = trajectory["leg"], trajectory["distance"]
    known = np.isfinite(distance)
    return [distance[known & (leg == index)] for index in np.unique(leg)]


def _marks(result: Result) -> list[Mark]:
    trajectory = result.trajectory
    marks = [
        Mark(
            "modules rolled",
            "\N{ANTICLOCKWISE OPEN CIRCLE ARROW}",
            INK,
            begun(trajectory, ROLL_PHASE),
        ),
        Mark(
            "backs off to retry",
            "\N{LEFTWARDS ARROW WITH HOOK}",
            ALARM,
            begun(trajectory, RETRY_PHASE),
        ),
    ]
    known = np.flatnonzero(np.isfinite(trajectory["position"]).all(axis=1))
    if not result.success:
        marks.append(Mark(f"end: {result.outcome.value.replace('_', ' ')}", "X", ALARM, known[-1:]))
    return [mark for mark in marks if len(mark.rows)]


def _stretches(trajectory: Trajectory) -> Iterator[_Stretch]:
    """The travel of each leg in pieces of ``BIN``."""
    slip = np.abs(trajectory["slip_ratio"]).mean(axis=1)
    force = running_mean(trajectory["normal_force"], trajectory.time, FORCE_WINDOW).min(axis=1)
    known = np.isfinite(trajectory["position"]).all(axis=1) & np.isfinite(trajectory["distance"])
    for leg in np.unique(trajectory["leg"]).tolist():
        rows = np.flatnonzero(known & (trajectory["leg"] == leg))
        if len(rows) == 0:
            continue
        travel = np.append(0.0, np.cumsum(np.abs(np.diff(trajectory["distance"][rows]))))
        starts = np.flatnonzero(np.diff(np.floor(travel / BIN), prepend=-1.0))
        count = np.diff(np.append(starts, len(rows)))
        yield _Stretch(
            leg=int(leg),
            tail_first=bool(trajectory["gear"][rows[0]] < 0),
            rows=np.append(rows[starts], rows[-1]),
            slip=np.add.reduceat(slip[rows], starts) / count,
            force=np.minimum.reduceat(force[rows], starts),
        )


def _colour_bar(
    figure: Figure, layout: _Layout, column: int, text: str, colours: str, values: list[Array]
) -> Any:
    """The colour scale of one column, drawn above it; from 0 to what 98 of 100 pieces stay
    below."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate(values) if values else np.zeros(0)
    every = every[np.isfinite(every)]
    largest = float(every.max()) if len(every) else 1.0
    top = _round_up(float(np.quantile(every, 0.98)) if len(every) else 1.0)
    scale = ScalarMappable(Normalize(0.0, top), colours)
    width = 0.62 * _COLUMN
    left = layout.left_of[column] + (_COLUMN - width) / 2
    axis = figure.add_axes(layout.box(left, layout.bar, width, 0.11))
    bar = figure.colorbar(
        scale,
        cax=axis,
        orientation="horizontal",
        extend="max" if largest > 1.001 * top else "neither",
    )
    bar.locator = MaxNLocator(6)
    bar.update_ticks()
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]
    axis.tick_params(labelsize=8, length=2.5, pad=2)
    axis.set_title(text, fontsize=9.5, color=INK, pad=5)
    return scale


def _round_up(value: float) -> float:
    """The next of 1, 2, 2.5, 4, 5, 8 times a power of ten; 1 for what is not positive."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(
        power
        * next(
            (m for m in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if m * power >= value * (1 - 1e-9)), 10
        )
    )


def _draw_way(
    axis: Axes,
    view: _View,
    trajectory: Trajectory,
    routes: tuple[Route, ...],
    stretches: list[_Stretch],
    values: list[Array],
    scale: Any,
) -> None:
    """The way of the robot's centre, piece by piece in its colour, on a dark edge."""
    from matplotlib.collections import LineCollection

    columns = list(view.pair)
    for stretch, value in zip(stretches, values, strict=True):
        points = trajectory["position"][stretch.rows]
        if stretch.tail_first:
            points = points + _beside(trajectory, routes[stretch.leg], stretch, view)
        flat = points[:, columns]
        pieces = np.stack([flat[:-1], flat[1:]], axis=1)
        axis.plot(*flat.T, color=INK, linewidth=4.2, solid_capstyle="round", zorder=3)
        lines = LineCollection(
            list(pieces), array=value, cmap=scale.cmap, norm=scale.norm, zorder=3.1
        )
        lines.set(linewidth=3.2, capstyle="projecting")
        axis.add_collection(lines, autolim=False)
        if stretch.tail_first:
            axis.plot(*flat.T, color="white", linewidth=0.9, linestyle=(0, (4, 4)), zorder=3.2)


def _beside(trajectory: Trajectory, route: Route, stretch: _Stretch, view: _View) -> Array:
    """Shifts (n + 1, 3) m to the right of the direction of travel as one view shows it."""
    i, j = view.pair
    tangent = route.centreline.at(trajectory["distance"][stretch.rows])[1]
    if view.flipped:
        i, j = j, i
    shift = np.zeros_like(tangent)
    shift[:, i], shift[:, j] = tangent[:, j], -tangent[:, i]
    return BESIDE * route.fittings[0].radius * shift


def _draw_places(
    axis: Axes, pair: tuple[int, int], start: Array, goals: Array, plates: Array
) -> None:
    """Start (1, 3) m, goals (G, 3) m and plates by their rims (P, k, 3) m."""
    columns = list(pair)
    for rim in plates:
        axis.fill(*rim[:, columns].T, **_PLATE, zorder=4)
    axis.plot(*start[:, columns].T, **START, zorder=5)
    axis.plot(*goals[:, columns].T, **_GOAL, zorder=5)


def _draw_marks(
    axis: Axes, pair: tuple[int, int], trajectory: Trajectory, marks: list[Mark]
) -> None:
    for mark in marks:
        points = trajectory["position"][mark.rows][:, list(pair)].T
        for style in signs(mark):
            axis.plot(*points, **style, zorder=5.5)


def _names(axes: list[Axes], layout: _Layout, renderer: Any, pipes: Assembly, way: Array) -> None:
    """Names of the parts, each in the view that shows most of it, off the pipes and off the way (n,
    3) m."""
    pairs = [view.pair for view in layout.views]
    bores = np.concatenate([part.bore_samples() for part in pipes.parts])
    for part in pipes.parts:
        view = widest_view(part, pairs)
        axis, columns = axes[view], list(pairs[view])
        place = axis.transData.transform(middle(part)[columns])
        text = axis.text(0, 0, part.name, fontsize=7, color=INK, ha="center", va="center", zorder=6)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4})
        half = np.array(text.get_window_extent(renderer).size) / 2
        reach = _pixels(axis, part.fitting.radius)
        boxes = [
            np.array(other.get_window_extent(renderer).get_points())
            for other in axis.texts
            if other is not text
        ]
        covered = [
            (axis.transData.transform(points[:, columns]), worth)
            for points, worth in ((way, 20), (bores, 1))
        ]
        spots = place + _around(reach, half)
        costs = [_cost(spot, half, boxes, covered, axis) for spot in spots]
        x, y = axis.transData.inverted().transform(spots[int(np.argmin(costs))]).tolist()
        text.set_position((x, y))


def _pixels(axis: Axes, length: float) -> float:
    """A length in m as it is drawn."""
    return float(np.ptp(axis.transData.transform([[0.0, 0.0], [length, 0.0]])[:, 0]))


def _around(reach: float, half: Array) -> Array:
    """Shifts (n, 2) that put a box of half the size ``half`` (2,) on or beside a disc of radius
    ``reach``, pixels."""
    angle = np.radians([90, 270, 0, 180, 45, 135, 225, 315, 67, 113, 247, 293])
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate(
        [[[0.0, 0.0]], *(direction * (reach + half + gap) for gap in (4, 14, 26, 40))]
    )


def _cost(
    spot: Array, half: Array, boxes: list[Array], covered: list[tuple[Array, int]], axis: Axes
) -> float:
    """How bad a name stands with its middle at ``spot`` (2,), pixels: over names, over the way,
    over pipes, outside."""
    low, high = spot - half - (6, 2), spot + half + (6, 2)
    names = sum(bool((low < other[1]).all() and (high > other[0]).all()) for other in boxes)
    points = sum(worth * float(((p > low) & (p < high)).all(axis=1).sum()) for p, worth in covered)
    frame = axis.get_window_extent().get_points()
    outside = (low < frame[0]).any() or (high > frame[1]).any()
    return 1e6 * names + 1e5 * outside + points


def _legend(
    figure: Figure, layout: _Layout, marks: list[Mark], tail_first: bool, plates: bool
) -> None:
    """What the signs of the map mean, in one row below it."""
    from matplotlib.lines import Line2D

    handles: list[Any] = [Line2D([], [], **START), Line2D([], [], **_GOAL)]
    texts = ["start", "goal"]
    if tail_first:
        handles.append(
            (
                Line2D([], [], color=INK, lw=4.2, solid_capstyle="butt"),
                Line2D([], [], color="white", lw=0.9, ls=(0, (2, 2))),
            )
        )
        texts.append("tail first")
    if plates:
        handles.append(Line2D([], [], color=ALARM, linewidth=_PLATE["linewidth"]))
        texts.append("closed by a plate")
    for mark in marks:
        handles.append(tuple(Line2D([], [], **style) for style in signs(mark)))
        texts.append(mark.text)
    place = {"loc": "center", "bbox_to_anchor": (0.5, (layout.legend + 0.22) / layout.height)}
    figure.legend(handles, texts, ncols=len(texts), columnspacing=2.2, handletextpad=0.5, **place)
