"""A run drawn into its pipes: slip and normal force along the path, and the events over time."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.events import FellOff
from omnitrack_sim.record.timeline import (
    FORCE_WINDOW,
    RETRY_PHASE,
    ROLL_PHASE,
    begun,
    passage_indices,
    running_mean,
)
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.results.result import as_result
from omnitrack_sim.show.plots.network_figure import draw_names, draw_pipes, extent, frame_view
from omnitrack_sim.show.plots.style import (
    ALARM,
    DPI,
    GREY,
    INK,
    PAGE,
    TICKS,
    headline,
    new_figure,
    page,
)
from omnitrack_sim.show.projection import Projection, aligned, bore_faces

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result

SHADES = {
    "straight": "#f1f3f5",
    "elbow": "#d7e4f2",
    "reducer": "#e8dcec",
    "run to branch": "#f8dfbd",
    "branch to run": "#f3c9bb",
    "over the run": "#d3eadb",
}
"""Colours of the bands of parts, by manoeuvre."""
EXPLORED = "#b5dcc6"
"""Colour of pipes that are in the map of a robot that explores."""
SPEED_WINDOW = 0.2
"""Length of the running mean of the speed, s."""
BIN = 0.01
"""Length of the pieces of travel that have one colour each, m."""
BESIDE = 0.5
"""Distance of tail-first travel beside the pipe's axis, in bore radii."""
_NAMES = 5.5
"""Size of the parts' names, points."""
_LEFT, _RIGHT, _HEAD = 0.46, 0.08, 0.42  # inches: margins, and height of the title
_GUTTER = 0.42  # inches between the two columns
_COLUMN = (PAGE - _LEFT - _RIGHT - _GUTTER) / 2  # inches; holds both views of one quantity
_TALLEST = 4.2  # inches, largest height of the views of one quantity
_STACKED, _ASIDE = 0.24, 0.38  # inches between two views, one above the other or side by side
_CHART, _PANEL, _PANELS, _STRIP = 0.36, 0.72, 0.1, 0.46
"""Inches of the time chart: below it, of a panel, between panels, of the bands."""
_START: dict[str, Any] = {
    "marker": "o",
    "markersize": 4.5,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "markeredgewidth": 0.9,
    "linestyle": "none",
}
"""The sign for places: a white disc with a dark edge."""
_GOAL = _START | {
    "marker": "*",
    "markersize": 8,
    "markerfacecolor": "#ffd23f",
    "markeredgewidth": 0.6,
}
_PLATE: dict[str, Any] = {
    "facecolor": f"{ALARM}40",
    "edgecolor": ALARM,
    "linewidth": 1.8,
    "joinstyle": "bevel",
}


def plot_mission(
    result: Result | str | os.PathLike[str],
    *,
    path: str | Path | None = None,
    format: str | None = None,
) -> Figure:
    """Plot map and time chart of a run, as wide as a page (7.16 inches).

    The map shows the pipes in elevation and plan, with the path of the robot's centre in them, and
    over them, in another colour, those in the map of a robot that explores. On the left the colour
    of the path is the slip ratio, the mean of the modules' magnitudes over 10 mm of travel; on the
    right the least normal force of a module there, of a mean over 0.1 s. Travel tail first is drawn
    beside the axis, on the right-hand side of its direction, with a dashed core. The chart below
    has the parts as bands, tilt and speed over time.

    Args:
        result: the run, or the folder of a saved one.
        path: file to write; none: the figure is returned and nothing is written.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written, or the folder is no run.

    Example:
        >>> import omnitrack_sim as ot
        >>> result = ot.run(ot.load_scenario("elbow", {"run.time_limit": 0.1}))
        >>> figure = ot.plot_mission(result)
        >>> float(figure.get_figwidth())
        7.16
    """
    run = as_result(result)
    return page(lambda: _draw(run), path, format)


def _draw(result: Result) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    trajectory, routes, explored = result.trajectory, result.routes(), result.map
    pipes = routes[0].network if explored is None else result.pipes
    faces = bore_faces(pipes)
    marks, travel = marks_of(result), list(_travel_of(trajectory))
    layout = MissionLayout(*extent(faces), len({leg.index for leg in travel}) > 1)
    figure = new_figure((PAGE, layout.height), dpi=DPI)
    renderer = FigureCanvasAgg(figure).get_renderer()  # measures the names as they are drawn
    headline(figure, result.scenario.name, _outcome(result), _LEFT, result.success, _RIGHT)
    columns = (
        (
            "slip ratio: mean magnitude of the modules over 10 mm",
            "viridis",
            [leg.slip for leg in travel],
        ),
        ("least normal force of a module [N]", "plasma", [leg.force for leg in travel]),
    )
    driven = np.concatenate([trajectory["position"][leg.rows] for leg in travel])
    for column, (text, colours, values) in enumerate(columns):
        scale = _colour_bar(figure, layout, column, text, colours, values)
        axes = []
        for number, view in enumerate(layout.views):
            axis = layout.add(figure, number, column)
            draw_pipes(axis, pipes, view, faces)
            if explored is not None:
                draw_pipes(axis, explored.pipes, view, bore_faces(explored.pipes), EXPLORED)
            _draw_path(axis, view, trajectory, routes, travel, values, scale)
            _draw_signs(axis, view, result, marks)
            axes.append(axis)
        draw_names(axes, layout.views, renderer, pipes, driven, _NAMES)
    _sign_legend(figure, layout, marks, any(leg.tail_first for leg in travel), result)
    _draw_time_chart(figure, layout, renderer, trajectory, routes, marks)
    return figure


def _outcome(result: Result) -> str:
    """Outcome, duration, travel and legs of a run, in words."""
    leg, distance = result.trajectory["leg"], result.trajectory["distance"]
    known = np.isfinite(distance)
    travel = sum(
        float(np.abs(np.diff(distance[known & (leg == index)])).sum()) for index in np.unique(leg)
    )
    outcome = result.outcome.value.replace("_", " ")
    text = f"{outcome} after {result.duration_s:.2f} s, {travel:.2f} m driven"
    legs = len(result.routes())
    return text if legs == 1 else f"{text} on {int(leg.max()) + 1} of {legs} legs"


class MissionLayout:
    """Places of everything in the figure, in inches from the lower left corner. The views are as
    large as their column can hold.

    Args:
        low: (3,) m, of the pipes.
        high: (3,) m, of the pipes.
        several_legs: the time chart names the legs.

    Attributes:
        views: elevation and plan.
        legend: height of the middle of the legend of signs.
        bar: bottom of the colour bars.
        legs: height of the row that names the legs; 0 for none.
        height: of the figure.
    """

    def __init__(self, low: Array, high: Array, several_legs: bool) -> None:
        self._low, self._high = low, high
        elevation, _, plan = aligned(high - low)
        self.views = (elevation, plan)
        width, depth, tall = (high - low)[[*plan.columns, 2]]
        stacked = min(_COLUMN / width, (_TALLEST - _STACKED) / (tall + depth))
        aside = min((_COLUMN - _ASIDE) / (2 * width), _TALLEST / max(tall, depth))
        self._aside = aside > 0.85 * stacked  # a little smaller, but the figure is much lower
        scale = aside if self._aside else stacked  # inches a metre
        wide, deep, high_ = scale * width, scale * depth, scale * tall
        if self._aside:
            top = max(high_, deep)
            margin = (_COLUMN - 2 * wide - _ASIDE) / 2
            lefts, bottoms = (margin, margin + wide + _ASIDE), (top - high_, top - deep)
        else:
            top = high_ + deep + _STACKED
            margin = (_COLUMN - wide) / 2
            lefts, bottoms = (margin, margin), (deep + _STACKED, 0.0)
        self.legs = 0.16 if several_legs else 0.0
        self.legend = _CHART + 2 * _PANEL + _PANELS + self.legs + _STRIP + 0.38
        pipes = self.legend + 0.40
        self._boxes = [
            (left, pipes + bottom, wide, size)
            for left, bottom, size in zip(lefts, bottoms, (high_, deep), strict=True)
        ]
        self.bar = pipes + top + 0.36
        self.height = self.bar + 0.08 + _HEAD

    def left(self, column: int) -> float:
        """Left edge of a column."""
        return _LEFT + column * (_COLUMN + _GUTTER)

    def box(
        self, left: float, bottom: float, width: float, height: float
    ) -> tuple[float, float, float, float]:
        """A rectangle given in inches, as fractions of the figure."""
        return left / PAGE, bottom / self.height, width / PAGE, height / self.height

    def add(self, figure: Figure, view: int, column: int) -> Axes:
        """The axes of one view in one column, both to the same scale."""
        left, bottom, width, height = self._boxes[view]
        axis: Axes = figure.add_axes(self.box(self.left(column) + left, bottom, width, height))
        frame_view(axis, self.views[view], self._low, self._high)
        for name, index in zip("xy", self.views[view].columns, strict=True):
            length = float(self._high[index] - self._low[index])
            getattr(axis, f"{name}axis").set_major_locator(_ticks(length))
        if not self._aside and view == 0:
            axis.set_xlabel("")
            axis.tick_params(labelbottom=False)
        return axis


def _ticks(length: float) -> Any:
    """Ticks at round distances, the same in every view of about this length, m."""
    from matplotlib.ticker import MultipleLocator

    steps = np.outer(10.0 ** np.arange(-1, 5), [1, 2, 5]).ravel()  # m; pipes are 10 km at most
    return MultipleLocator(float(steps[np.argmax(length / steps <= 6)]))


@dataclass(frozen=True)
class LegTravel:
    """Travel on one leg, in n pieces of ``BIN``.

    Attributes:
        index: of the leg.
        tail_first: it was driven tail first.
        rows: (n + 1,) samples that bound the pieces.
        slip: (n,) mean slip ratio of the modules, as a magnitude.
        force: (n,) N, least normal force of a module.
    """

    index: int
    tail_first: bool
    rows: NDArray[np.intp]
    slip: Array
    force: Array


def _travel_of(trajectory: Trajectory) -> Iterator[LegTravel]:
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
        yield LegTravel(
            index=int(leg),
            tail_first=bool(trajectory["gear"][rows[0]] < 0),
            rows=np.append(rows[starts], rows[-1]),
            slip=np.add.reduceat(slip[rows], starts) / count,
            force=np.minimum.reduceat(force[rows], starts),
        )


def _colour_bar(
    figure: Figure,
    layout: MissionLayout,
    column: int,
    text: str,
    colours: str,
    values: list[Array],
) -> Any:
    """Draw the colour scale of one column above it, from 0 to a round number that 98 % of the
    pieces stay below."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate(values) if values else np.zeros(0)
    every = every[np.isfinite(every)]
    largest = float(every.max()) if len(every) else 1.0
    top = _round_up(float(np.quantile(every, 0.98)) if len(every) else 1.0)
    scale = ScalarMappable(Normalize(0.0, top), colours)
    width = 0.62 * _COLUMN
    left = layout.left(column) + (_COLUMN - width) / 2
    axis = figure.add_axes(layout.box(left, layout.bar, width, 0.07))
    more = "max" if largest > 1.001 * top else "neither"
    bar = figure.colorbar(scale, cax=axis, orientation="horizontal", extend=more)
    bar.locator = MaxNLocator(6)
    bar.update_ticks()
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]
    axis.tick_params(**TICKS)
    axis.set_title(text, fontsize=7.5, color=INK, pad=3)
    return scale


def _round_up(value: float) -> float:
    """The next round number: 1, 1.5, 2, 2.5, ... times a power of ten; 1 if not positive."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    steps = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return float(power * next((m for m in steps if m * power >= value * (1 - 1e-9)), 10))


def _draw_path(
    axis: Axes,
    view: Projection,
    trajectory: Trajectory,
    routes: Sequence[Route],
    travel: list[LegTravel],
    values: list[Array],
    scale: Any,
) -> None:
    """Draw the path of the robot's centre on a dark edge, each piece in the colour of its value."""
    from matplotlib.collections import LineCollection

    i, j = view.columns[::-1] if view.falls else view.columns
    for leg, value in zip(travel, values, strict=True):
        points = trajectory["position"][leg.rows]
        if leg.tail_first:  # beside the axis, to the right of the direction of travel
            line = routes[leg.index].centreline
            tangent = line.at(trajectory["distance"][leg.rows])[1]
            shift = np.zeros_like(tangent)
            shift[:, i], shift[:, j] = tangent[:, j], -tangent[:, i]
            points = points + BESIDE * routes[leg.index].passages[0].radius * shift
        flat = points[:, list(view.columns)]
        pieces = np.stack([flat[:-1], flat[1:]], axis=1)
        axis.plot(*flat.T, color=INK, linewidth=3.0, solid_capstyle="round", zorder=3)
        colours = {"array": value, "cmap": scale.cmap, "norm": scale.norm}
        lines = LineCollection(list(pieces), zorder=3.1, **colours)
        lines.set(linewidth=2.2, capstyle="projecting")
        axis.add_collection(lines, autolim=False)
        if leg.tail_first:
            axis.plot(*flat.T, color="white", linewidth=0.7, linestyle=(0, (4, 4)), zorder=3.2)


@dataclass(frozen=True)
class EventMark:
    """Something that happened, with its sign in the map and in the time chart.

    Attributes:
        text: for the legend.
        marker: a marker of matplotlib, or one letter that is drawn as a glyph.
        colour: of the sign.
        rows: samples at which it happened.
    """

    text: str
    marker: str
    colour: Any
    rows: NDArray[np.intp]

    def looks(self) -> list[dict[str, Any]]:
        """The line styles that draw it: a glyph on a white disc, or a plain marker."""
        if self.marker.isascii():
            look = {"marker": self.marker, "markersize": 6.5, "markerfacecolor": self.colour}
            return [_START | look]
        disc = {"markersize": 7, "markeredgecolor": self.colour, "markeredgewidth": 0.6}
        glyph = {
            "marker": _glyph(self.marker),
            "markersize": 4,
            "color": self.colour,
            "linestyle": "none",
            "markeredgewidth": 0.2,
        }
        return [_START | disc, glyph]


@cache
def _glyph(letter: str) -> Any:
    """The outline of a letter about its middle, as a marker."""
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    outline = TextPath((0, 0), letter)
    middle = outline.get_extents().get_points().mean(axis=0)
    return Outline(outline.vertices - middle, outline.codes)


def marks_of(result: Result) -> list[EventMark]:
    """Rolls, retries, falls and a failed end of a run."""
    trajectory = result.trajectory
    falls = [event.time for event in result.events if isinstance(event, FellOff)]
    last = np.flatnonzero(np.isfinite(trajectory["position"]).all(axis=1))[-1:]
    end = f"end: {result.outcome.value.replace('_', ' ')}"
    marks = [
        EventMark(
            "modules rolled",
            "\N{ANTICLOCKWISE OPEN CIRCLE ARROW}",
            INK,
            begun(trajectory, ROLL_PHASE),
        ),
        EventMark(
            "backs off to retry",
            "\N{LEFTWARDS ARROW WITH HOOK}",
            ALARM,
            begun(trajectory, RETRY_PHASE),
        ),
        EventMark(
            "falls off its way",
            "\N{DOWNWARDS ARROW}",
            ALARM,
            np.minimum(np.searchsorted(trajectory.time, falls), len(trajectory.time) - 1),
        ),
        EventMark(end, "X", ALARM, last[:0] if result.success else last),
    ]
    return [mark for mark in marks if len(mark.rows)]


def _draw_signs(axis: Axes, view: Projection, result: Result, marks: list[EventMark]) -> None:
    """Draw plates, start, goals and events into one view."""
    columns, position = list(view.columns), result.trajectory["position"]
    for rim in result.plate_rims():
        axis.fill(*rim[:, columns].T, **_PLATE, zorder=4)
    axis.plot(*position[:1, columns].T, **_START, zorder=5)
    axis.plot(*result.goal_points()[:, columns].T, **_GOAL, zorder=5)
    for mark in marks:
        for look in mark.looks():
            axis.plot(*position[mark.rows][:, columns].T, **look, zorder=5.5)


def _sign_legend(
    figure: Figure, layout: MissionLayout, marks: list[EventMark], tail_first: bool, result: Result
) -> None:
    """Explain the signs of the map, in one row below it."""
    from matplotlib.lines import Line2D

    def line(**look: Any) -> Line2D:
        return Line2D([], [], **look)

    rows: list[tuple[str, Any]] = [("start", line(**_START)), ("goal", line(**_GOAL))]
    if tail_first:
        core = line(color="white", lw=0.7, ls=(0, (2, 2)))
        rows.append(("tail first", (line(color=INK, lw=3.0, solid_capstyle="butt"), core)))
    if len(result.plate_rims()):
        rows.append(("closed by a plate", line(color=ALARM, linewidth=_PLATE["linewidth"])))
    if result.map is not None:
        rows.append(("in its map", line(color=EXPLORED, linewidth=6.0, solid_capstyle="butt")))
    rows += [(mark.text, tuple(line(**look) for look in mark.looks())) for mark in marks]
    texts, handles = zip(*rows, strict=True)
    place = {"loc": "center", "bbox_to_anchor": (0.5, layout.legend / layout.height)}
    figure.legend(handles, texts, ncols=len(texts), columnspacing=1.8, handletextpad=0.4, **place)


def _draw_time_chart(
    figure: Figure,
    layout: MissionLayout,
    renderer: Any,
    trajectory: Trajectory,
    routes: Sequence[Route],
    marks: list[EventMark],
) -> None:
    """Draw bands of the parts, tilt and speed over time, with the events at their times."""
    tilt_bottom = _CHART + _PANEL + _PANELS
    rows = (
        (tilt_bottom + _PANEL, layout.legs + _STRIP),
        (tilt_bottom, _PANEL),
        (_CHART, _PANEL),
    )
    width, time = PAGE - _LEFT - _RIGHT, trajectory.time
    ends = (float(time[0]), float(time[-1]) if time[-1] > time[0] else float(time[0]) + 1.0)
    axes = [figure.add_axes(layout.box(_LEFT, low, width, height)) for low, height in rows]
    for axis in axes:
        axis.set_xlim(*ends)
    strip, tilt, speed = axes
    for axis in (tilt, speed):
        axis.tick_params(**TICKS)
        axis.yaxis.set_label_coords(-0.05, 0.5)
    _draw_bands(strip, (speed, tilt), layout.legs, renderer, trajectory, routes)
    degrees = np.degrees(trajectory["tilt"])
    tilt.plot(time, degrees, color=INK)
    top = max(1.0, 1.3 * _largest(degrees))
    tilt.set_ylim(0, top)
    tilt.set_ylabel("tilt [deg]")
    tilt.tick_params(labelbottom=False)
    shown = 1e3 * _speed(trajectory)
    speed.plot(time, shown, color=INK)
    speed.set_ylim(-1.15 * _largest(-shown) - 1.0, 1.15 * _largest(shown) + 1.0)
    speed.axhline(0.0, color=GREY, linewidth=0.6)
    speed.set_ylabel("speed [mm/s]")
    speed.set_xlabel("time [s]")
    for mark in marks:
        at = np.full(len(mark.rows), 0.87 * top)
        for look in mark.looks():
            tilt.plot(time[mark.rows], at, **look, zorder=5, clip_on=False)


def _largest(values: Array) -> float:
    """The largest of the values that are finite, at least 0."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


def _speed(trajectory: Trajectory) -> Array:
    """Speed (T,) m/s along the centreline, positive with the nose ahead.

    It is a running mean over ``SPEED_WINDOW``.
    """
    time, gear = trajectory.time, np.where(trajectory["gear"] < 0, -1.0, 1.0)
    if len(time) < 2:
        return np.zeros(len(time))
    speed = gear[1:] * np.diff(trajectory["distance"]) / np.diff(time)
    # Each leg counts its distance from its own start.
    speed = np.where(np.diff(trajectory["leg"]) == 0, speed, 0.0)
    return running_mean(np.append(speed[:1], speed)[:, None], time, SPEED_WINDOW)[:, 0]


def _draw_bands(
    strip: Axes,
    panels: tuple[Axes, ...],
    legs: float,
    renderer: Any,
    trajectory: Trajectory,
    routes: Sequence[Route],
) -> None:
    """Name the parts that the robot's centre was in, and shade them behind the panels."""
    strip.set_axis_off()
    strip.set_ylim(0, legs + _STRIP)
    leg, passages = trajectory["leg"].astype(int), passage_indices(trajectory, routes)
    time = trajectory.time
    shown: dict[str, str] = {}
    for first, last in spans(leg, passages):
        route = routes[leg[first]]
        passage = route.passages[passages[first]]
        shade = shown[passage.words] = SHADES.get(passage.words, SHADES["straight"])
        start, end = float(time[first]), float(time[last])
        for axis in panels:
            axis.axvspan(start, end, color=shade, linewidth=0, zorder=0)
        strip.fill_between([start, end], legs, legs + _STRIP, color=shade, linewidth=0)
        strip.plot([start, start], [legs, legs + _STRIP], color="white", linewidth=1.2)
        name = route.network.parts[passage.index].name
        _band_name(strip, renderer, name, (start, end), (legs, legs + _STRIP))
    if legs:
        _leg_row(strip, legs, trajectory)
    _band_legend(strip, shown)


def _leg_row(strip: Axes, height: float, trajectory: Trajectory) -> None:
    """Number and gear of each leg, in a row of ``height`` at the bottom of the strip."""
    leg, time = trajectory["leg"].astype(int), trajectory.time
    middle = 0.5 * height
    for first, last in spans(leg):
        start, end = float(time[first]), float(time[last])
        strip.plot([start, end], [middle] * 2, color=GREY, linewidth=0.8, marker="|", markersize=6)
        gear = ", tail first" if trajectory["gear"][first] < 0 else ""
        text = f" leg {leg[first] + 1}{gear} "
        name = strip.text((start + end) / 2, middle, text, ha="center", va="center", fontsize=6)
        name.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.5})


def _band_legend(strip: Axes, shown: dict[str, str]) -> None:
    """Name the colours of the bands, by manoeuvre, above the strip."""
    from matplotlib.patches import Patch

    order = [manoeuvre for manoeuvre in dict.fromkeys([*SHADES, *shown]) if manoeuvre in shown]
    handles = [
        Patch(facecolor=shown[manoeuvre], edgecolor=GREY, linewidth=0.4, label=manoeuvre)
        for manoeuvre in order
    ]
    strip.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(handles),
        borderpad=0.1,
        borderaxespad=0.3,
        columnspacing=1.6,
        fontsize=6.5,
    )


def _band_name(
    strip: Axes,
    renderer: Any,
    name: str,
    across: tuple[float, float],
    up: tuple[float, float],
) -> None:
    """Write a name into its band, level or upright, as small as it must be; none without room."""
    room = np.ptp(strip.transData.transform(np.stack([across, up], axis=-1)), axis=0) - 2
    x, y = sum(across) / 2, sum(up) / 2
    text = strip.text(x, y, name, ha="center", va="center", color=INK)
    for size in (6.5, 5.5, 4.5):
        for angle in (0, 90):
            text.set(fontsize=size, rotation=angle)
            box = text.get_window_extent(renderer)
            if box.width <= room[0] and box.height <= room[1]:
                return
    text.remove()
