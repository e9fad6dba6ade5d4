"""A run drawn into its pipes: slip and normal force along the path, and the events over time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.record.events import FellOff
from omnitrack_sim.record.timeline import (
    FORCE_WINDOW,
    RETRY_PHASE,
    ROLL_PHASE,
    phase_starts,
    running_mean,
)
from omnitrack_sim.record.trajectory import Trajectory, spans
from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.show.landmarks import SHADES, passage_spans
from omnitrack_sim.show.plots.network_figure import (
    PIPE,
    draw_names,
    draw_pipes,
    extent,
    frame_view,
)
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
    over them, in another colour, those in the map of a robot that explores; all names are those of
    the true parts. On the left the colour
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
    return page(lambda: _Mission(run).figure, path, format)


class _Mission:
    """Figure of one run: two columns of views, each with its colours, and the time chart.

    Places are in inches from the lower left corner.
    """

    def __init__(self, result: Result) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        self.result, self.trajectory, self.pipes = result, result.trajectory, result.pipes
        self.faces = bore_faces(self.pipes)
        self.marks, self.travel = marks_of(result), list(_travel_of(self.trajectory))
        # Height of the row of the time chart that names the legs.
        self.legs = 0.16 if len(self.travel) > 1 else 0.0
        self.legend = _CHART + 2 * _PANEL + _PANELS + self.legs + _STRIP + 0.38
        top = self._place_views(self.legend + 0.40)
        self.height = top + 0.44 + _HEAD
        self.figure = new_figure((PAGE, self.height), dpi=DPI)
        self.renderer = FigureCanvasAgg(self.figure).get_renderer()  # measures names as drawn
        name, outcome = result.scenario.name, _outcome(result)
        headline(self.figure, name, outcome, _LEFT, result.success, _RIGHT)
        slip = [leg.slip for leg in self.travel]
        of_modules = "slip_ratio" in self.trajectory
        text = "slip ratio: mean magnitude of the modules over 10 mm"
        other = "slip speed at contacts, mean of the bodies over 10 mm [mm/s]"
        self._draw_column(_LEFT, top + 0.36, text if of_modules else other, "viridis", slip)
        force = [leg.force for leg in self.travel]
        text, other = "least normal force of a module [N]", "force on the wall, all bodies [N]"
        text = text if of_modules else other
        self._draw_column(_LEFT + _COLUMN + _GUTTER, top + 0.36, text, "plasma", force)
        self._draw_legend()
        self._draw_time_chart()

    def _place_views(self, bottom: float) -> float:
        """Choose scale and places of the views above ``bottom``; return where they end."""
        self._low, self._high = extent(self.faces)
        size = self._high - self._low
        elevation, _, plan = aligned(size)
        self.views = (elevation, plan)
        width, depth, tall = size[[*plan.columns, 2]]
        stacked = min(_COLUMN / width, (_TALLEST - _STACKED) / (tall + depth))
        aside = min((_COLUMN - _ASIDE) / (2 * width), _TALLEST / max(tall, depth))
        self._aside = aside > 0.85 * stacked  # a little smaller, but the figure is much lower
        scale = aside if self._aside else stacked  # inches a metre
        wide, deep, high = scale * width, scale * depth, scale * tall
        if self._aside:
            top = max(high, deep)
            margin = (_COLUMN - 2 * wide - _ASIDE) / 2
            lefts, bottoms = (margin, margin + wide + _ASIDE), (top - high, top - deep)
        else:
            top = high + deep + _STACKED
            margin = (_COLUMN - wide) / 2
            lefts, bottoms = (margin, margin), (deep + _STACKED, 0.0)
        self._boxes = [
            (left, bottom + low, wide, size)
            for left, low, size in zip(lefts, bottoms, (high, deep), strict=True)
        ]
        return bottom + top

    def _add(self, left: float, bottom: float, width: float, height: float) -> Axes:
        box = (left / PAGE, bottom / self.height, width / PAGE, height / self.height)
        return self.figure.add_axes(box)

    def _draw_column(
        self, left: float, bar: float, text: str, colours: str, values: list[Array]
    ) -> None:
        """Draw a column of both views with its colour bar, whose bottom is at ``bar``."""
        scale = self._draw_colour_bar(left, bar, text, colours, values)
        axes = []
        for (x, *box), view in zip(self._boxes, self.views, strict=True):
            axis = self._add(left + x, *box)
            frame_view(axis, view, self._low, self._high)
            # Few steps at round distances, the same in both views.
            axis.locator_params(nbins=6, steps=(1, 2, 5, 10))
            draw_pipes(axis, self.pipes, view, self.faces)
            if self.result.map is not None:
                explored = self.result.map.pipes
                draw_pipes(axis, explored, view, bore_faces(explored), EXPLORED)
            self._draw_path(axis, view, values, scale)
            self._draw_signs(axis, list(view.columns), self._plates[view.title])
            axes.append(axis)
        if not self._aside:
            axes[0].set_xlabel("")
            axes[0].tick_params(labelbottom=False)
        driven = np.concatenate([self.trajectory["position"][leg.rows] for leg in self.travel])
        draw_names(axes, self.views, self.renderer, self.pipes, driven, _NAMES)

    def _draw_colour_bar(
        self, left: float, bottom: float, text: str, colours: str, values: list[Array]
    ) -> Any:
        """Draw the colour scale of a column above it.

        It goes from 0 to a round number that 98 % of the pieces stay below.
        """
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize
        from matplotlib.ticker import MaxNLocator

        every = np.concatenate([*values, np.zeros(0)])
        every = every[np.isfinite(every)]
        top = _round_up(float(np.quantile(every, 0.98)) if len(every) else 1.0)
        scale = ScalarMappable(Normalize(0.0, top), colours)
        axis = self._add(left + 0.19 * _COLUMN, bottom, 0.62 * _COLUMN, 0.07)
        more = "max" if every.max(initial=0.0) > 1.001 * top else "neither"
        bar = self.figure.colorbar(scale, cax=axis, orientation="horizontal", extend=more)
        bar.locator = MaxNLocator(6)
        bar.update_ticks()
        bar.outline.set_linewidth(0.5)  # type: ignore[operator]
        axis.tick_params(**TICKS)
        axis.set_title(text, fontsize=7.5, color=INK, pad=3)
        return scale

    def _draw_path(self, axis: Axes, view: Projection, values: list[Array], scale: Any) -> None:
        """Draw the path of the robot's centre, each piece in the colour of its value."""
        from matplotlib.collections import LineCollection

        i, j = view.columns[::-1] if view.falls else view.columns
        for leg, value in zip(self.travel, values, strict=True):
            points = self.trajectory["position"][leg.rows]
            if leg.tail_first:  # beside the axis, to the right of the direction of travel
                tail = -matrix_from_quaternion(self.trajectory["quaternion"][leg.rows])[:, :, 2]
                shift = np.zeros_like(tail)
                shift[:, i], shift[:, j] = tail[:, j], -tail[:, i]
                points = points + BESIDE * self.pipes.parts[0].fitting.radius * shift
            flat = points[:, list(view.columns)]
            pieces = np.stack([flat[:-1], flat[1:]], axis=1)
            axis.plot(*flat.T, color=INK, linewidth=3.0, solid_capstyle="round", zorder=3)
            colours = {"array": value, "cmap": scale.cmap, "norm": scale.norm}
            lines = LineCollection(list(pieces), zorder=3.1, **colours)
            lines.set(linewidth=2.2, capstyle="projecting")
            axis.add_collection(lines, autolim=False)
            if leg.tail_first:
                axis.plot(*flat.T, color="white", linewidth=0.7, linestyle=(0, (4, 4)), zorder=3.2)

    @cached_property
    def _plates(self) -> dict[str, list[Array]]:
        """Return the rims (k, 3) m of the plates that each view shows, by its title.

        Where another pipe lies behind or before a plate it would look closed, so another view shows
        it, if one can.
        """
        shown: dict[str, list[Array]] = {view.title: [] for view in self.views}
        for rim in self.result.plate_rims():
            clear = [view for view in self.views if not self._covers(rim, view)]
            for view in clear or self.views:
                shown[view.title].append(rim)
        return shown

    def _covers(self, rim: Array, view: Projection) -> bool:
        """Return True if a plate is drawn across another pipe than its own in a view."""
        centre, towards = rim.mean(axis=0), view.axes[:, 2]
        radius = float(np.linalg.norm(rim - centre, axis=1).max())
        # From its own pipe, which reaches a radius to either side, through the whole network.
        most = float(np.linalg.norm(self._high - self._low))
        far = np.arange(1.5 * radius, most, 0.5 * radius)
        away = np.concatenate([-far, far])[:, None, None] * towards
        points = centre + 0.9 * (rim[::4] - centre) + away  # (n, k, 3)
        columns = list(view.columns)
        flat = centre[columns]
        boxes = np.stack(self._bounds)[:, :, columns]  # (2, parts, 2)
        near = (boxes[0] < flat + radius).all(axis=1) & (boxes[1] > flat - radius).all(axis=1)
        parts = (self.pipes.parts[i] for i in np.flatnonzero(near))
        return any(
            (np.minimum(part.signed_distance(points)[0], part.extent(points)) > 0).any()
            for part in parts
        )

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates (parts, 3) m of the bores of all parts."""
        bores = [part.bore_samples() for part in self.pipes.parts]
        return np.array([b.min(axis=0) for b in bores]), np.array([b.max(axis=0) for b in bores])

    def _draw_signs(self, axis: Axes, columns: list[int], plates: list[Array]) -> None:
        """Draw ``plates``, start, goals and events into one view."""
        position = self.trajectory["position"]
        for rim in plates:
            axis.fill(*rim[:, columns].T, **_PLATE, zorder=4)
        axis.plot(*position[:1, columns].T, **_START, zorder=5)
        axis.plot(*self.result.goal_points()[:, columns].T, **_GOAL, zorder=5)
        for mark in self.marks:
            for look in mark.looks():
                axis.plot(*position[mark.rows][:, columns].T, **look, zorder=5.5)

    def _draw_legend(self) -> None:
        """Explain the signs of the map, in one row below it."""
        from matplotlib.lines import Line2D

        def line(**look: Any) -> Line2D:
            return Line2D([], [], **look)

        def band(colour: str) -> Line2D:
            return line(color=colour, linewidth=6.0, solid_capstyle="butt")

        exploration = self.result.scenario.exploration
        comes_home = exploration is not None and exploration.mission.task == "explore"
        goal = "home" if comes_home else "goal"
        rows: list[tuple[str, Any]] = [("start", line(**_START)), (goal, line(**_GOAL))]
        if any(leg.tail_first for leg in self.travel):
            core = line(color="white", lw=0.7, ls=(0, (2, 2)))
            rows.append(("tail first", (line(color=INK, lw=3.0, solid_capstyle="butt"), core)))
        if len(self.result.plate_rims()):
            rows.append(("closed end", line(color=ALARM, linewidth=_PLATE["linewidth"])))
        if self.result.map is not None:
            rows += [("in its map", band(EXPLORED)), ("not in its map", band(PIPE))]
        rows += [(m.text, tuple(line(**look) for look in m.looks())) for m in self.marks]
        texts, handles = zip(*rows, strict=True)
        look: dict[str, Any] = {"ncols": len(texts), "columnspacing": 1.8, "handletextpad": 0.4}
        place = (0.5, self.legend / self.height)
        self.figure.legend(handles, texts, loc="center", bbox_to_anchor=place, **look)

    def _draw_time_chart(self) -> None:
        """Draw bands of the parts, tilt and speed over time, with the events at their times."""
        width, time = PAGE - _LEFT - _RIGHT, self.trajectory.time
        rows = ((_CHART, _PANEL), (_CHART + _PANEL + _PANELS, _PANEL))
        rows += ((_CHART + 2 * _PANEL + _PANELS, self.legs + _STRIP),)
        speed, tilt, strip = (self._add(_LEFT, low, width, height) for low, height in rows)
        for axis in (speed, tilt, strip):
            axis.set_xlim(time[0], time[-1] if time[-1] > time[0] else time[0] + 1.0)
        for axis in (speed, tilt):
            axis.tick_params(**TICKS)
            axis.yaxis.set_label_coords(-0.05, 0.5)
        self._draw_bands(strip, (speed, tilt))
        degrees = np.degrees(self.trajectory["tilt"])
        tilt.plot(time, degrees, color=INK)
        top = max(1.0, 1.3 * _largest(degrees))
        tilt.set_ylim(0, top)
        tilt.set_ylabel("tilt [deg]")
        tilt.tick_params(labelbottom=False)
        shown = 1e3 * _speed(self.trajectory)
        speed.plot(time, shown, color=INK)
        speed.set_ylim(-1.15 * _largest(-shown) - 1.0, 1.15 * _largest(shown) + 1.0)
        speed.axhline(0.0, color=GREY, linewidth=0.6)
        speed.set_ylabel("speed [mm/s]")
        speed.set_xlabel("time [s]")
        for mark in self.marks:
            at = np.full(len(mark.rows), 0.87 * top)
            for look in mark.looks():
                tilt.plot(time[mark.rows], at, **look, zorder=5, clip_on=False)

    def _draw_bands(self, strip: Axes, panels: tuple[Axes, ...]) -> None:
        """Name the parts that the robot's centre was in, and shade them behind the panels."""
        from matplotlib.patches import Patch

        top = self.legs + _STRIP
        strip.set_axis_off()
        strip.set_ylim(0, top)
        leg, time = self.trajectory["leg"].astype(int), self.trajectory.time
        shades: dict[str, str] = {}
        for span in passage_spans(self.result, self.trajectory):
            shade = shades[span.words] = span.colour
            start, end = float(time[span.first]), float(time[span.last])
            for axis in panels:
                axis.axvspan(start, end, color=shade, linewidth=0, zorder=0)
            strip.fill_between([start, end], self.legs, top, color=shade, linewidth=0)
            strip.plot([start, start], [self.legs, top], color="white", linewidth=1.2)
            self._name_band(strip, span.part.name, (start, end), (self.legs, top))
        if self.legs:
            self._name_legs(strip, leg)
        order = [words for words in dict.fromkeys([*SHADES, *shades]) if words in shades]
        look = {"edgecolor": GREY, "linewidth": 0.4}
        handles = [Patch(facecolor=shades[words], label=words, **look) for words in order]
        gaps: dict[str, Any] = {
            "borderpad": 0.1,
            "borderaxespad": 0.3,
            "columnspacing": 1.6,
            "fontsize": 6.5,
        }
        gaps |= {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
        strip.legend(handles=handles, ncols=len(handles), **gaps)

    def _name_band(
        self, strip: Axes, name: str, across: tuple[float, float], up: tuple[float, float]
    ) -> None:
        """Write a name into its band, level or upright, as small as must be, if there is room."""
        room = np.ptp(strip.transData.transform(np.stack([across, up], axis=-1)), axis=0) - 2
        x, y = sum(across) / 2, sum(up) / 2
        text = strip.text(x, y, name, ha="center", va="center", color=INK)
        for size in (6.5, 5.5, 4.5):
            for angle in (0, 90):
                text.set(fontsize=size, rotation=angle)
                box = text.get_window_extent(self.renderer)
                if box.width <= room[0] and box.height <= room[1]:
                    return
        text.remove()

    def _name_legs(self, strip: Axes, leg: NDArray[np.intp]) -> None:
        """Write number and gear of each leg into a row at the bottom of the strip.

        Where there is little room it is the number alone.
        """
        time, middle = self.trajectory.time, 0.5 * self.legs
        line: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "marker": "|", "markersize": 6}
        for first, last in spans(leg):
            start, end = float(time[first]), float(time[last])
            strip.plot([start, end], [middle] * 2, **line)
            gear = ", tail first" if self.trajectory["gear"][first] < 0 else ""
            number = leg[first] + 1
            self._name_leg(strip, (start, end), middle, (f" leg {number}{gear} ", f" {number} "))

    def _name_leg(
        self, strip: Axes, across: tuple[float, float], up: float, names: tuple[str, ...]
    ) -> None:
        """Write the first of some names that is no longer than its leg; none without room."""
        room = np.ptp(strip.transData.transform([(time, up) for time in across])[:, 0])
        name = strip.text(sum(across) / 2, up, "", ha="center", va="center", fontsize=6)
        name.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.5})
        for text in names:
            name.set_text(text)
            if name.get_window_extent(self.renderer).width <= room:
                return
        name.remove()


def _outcome(result: Result) -> str:
    """Outcome, duration, headway and legs of a run, in words."""
    leg = result.trajectory["leg"]
    # The metric, not the length of the path: numbers of one run have to agree.
    headway = result.metrics["distance_m"]
    text = f"{result.ending} after {result.duration_s:.2f} s, {headway:.2f} m of headway"
    legs = len(result.routes())
    return text if legs == 1 else f"{text} on {int(leg.max()) + 1} of {legs} legs"


@dataclass(frozen=True)
class LegTravel:
    """Travel on one leg, in n pieces of ``BIN``.

    Attributes:
        tail_first: it was driven tail first.
        rows: (n + 1,) samples that bound the pieces.
        slip: (n,) mean slip ratio of the modules, as a magnitude; of robots without modules the
            slip speed of their contacts, mm/s.
        force: (n,) N, least normal force of a module; of other robots that of all bodies.
    """

    tail_first: bool
    rows: NDArray[np.intp]
    slip: Array
    force: Array


def _way(position: Array) -> Array:
    """Length (n,) m of the path up to each of the positions (n, 3)."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1)))


def _travel_of(trajectory: Trajectory) -> Iterator[LegTravel]:
    if "slip_ratio" in trajectory:
        slip = np.abs(trajectory["slip_ratio"]).mean(axis=1)
        force = running_mean(trajectory["normal_force"], trajectory.time, FORCE_WINDOW).min(axis=1)
    else:
        touching = (trajectory["wall_force"] > 0).any(axis=0)
        slip = 1e3 * trajectory["contact_speed"].sum(axis=1) / max(1, np.count_nonzero(touching))
        force = running_mean(trajectory["wall_force"], trajectory.time, FORCE_WINDOW).sum(axis=1)
    known = np.isfinite(trajectory["position"]).all(axis=1) & np.isfinite(trajectory["distance"])
    for leg in np.unique(trajectory["leg"]).tolist():
        rows = np.flatnonzero(known & (trajectory["leg"] == leg))
        if len(rows) == 0:
            continue
        # Not ``distance``: a robot that backs off has pieces of their own for each pass, and on a
        # map of its own that is wrong it moves where ``distance`` stands still.
        way = _way(trajectory["position"][rows])
        starts = np.flatnonzero(np.diff(np.floor(way / BIN), prepend=-1.0))
        count = np.diff(np.append(starts, len(rows)))
        yield LegTravel(
            tail_first=bool(trajectory["gear"][rows[0]] < 0),
            rows=np.append(rows[starts], rows[-1]),
            slip=np.add.reduceat(slip[rows], starts) / count,
            force=np.minimum.reduceat(force[rows], starts),
        )


def _round_up(value: float) -> float:
    """The next round number: 1, 1.5, 2, 2.5, ... times a power of ten; 1 if not positive."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    steps = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10)
    return float(power * next((m for m in steps if m * power >= value * (1 - 1e-9)), 10))


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
    rolls, retries = (phase_starts(trajectory, phase) for phase in (ROLL_PHASE, RETRY_PHASE))
    falls = np.minimum(np.searchsorted(trajectory.time, falls), len(trajectory.time) - 1)
    marks = [
        EventMark("modules rolled", "\N{ANTICLOCKWISE OPEN CIRCLE ARROW}", INK, rolls),
        EventMark("backs off to retry", "\N{LEFTWARDS ARROW WITH HOOK}", ALARM, retries),
        EventMark("leaves its route", "\N{DOWNWARDS ARROW}", ALARM, falls),
        EventMark(end, "X", ALARM, last[:0] if result.success else last),
    ]
    return [mark for mark in marks if len(mark.rows)]


def _largest(values: Array) -> float:
    """The largest of the values that are finite, at least 0."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


def _speed(trajectory: Trajectory) -> Array:
    """Return the mean speed (T,) m/s over ``SPEED_WINDOW`` along the centreline.

    It is positive with the nose ahead.
    """
    time, gear = trajectory.time, np.where(trajectory["gear"] < 0, -1.0, 1.0)
    if len(time) < 2:
        return np.zeros(len(time))
    # A robot that finds itself elsewhere on its map jumps in ``distance``, and has not moved.
    most = 2.0 * np.linalg.norm(np.diff(trajectory["position"], axis=0), axis=1)
    speed = gear[1:] * np.clip(np.diff(trajectory["distance"]), -most, most) / np.diff(time)
    # Each leg counts its distance from its own start.
    speed = np.where(np.diff(trajectory["leg"]) == 0, speed, 0.0)
    return running_mean(np.append(speed[:1], speed)[:, None], time, SPEED_WINDOW)[:, 0]
