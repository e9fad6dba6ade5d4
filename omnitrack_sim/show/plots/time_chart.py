"""The time chart of a run: the fittings as bands, tilt, speed, and marks for what happened."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.timeline import passage_indices, running_mean
from omnitrack_sim.record.trajectory import spans
from omnitrack_sim.show.plots.style import GREY, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from omnitrack_sim.record.trajectory import Trajectory

SPEED_WINDOW = 0.2
"""Length of the running mean of the speed, s."""
SHADES = {
    "straight": "#f1f3f5",
    "elbow": "#d7e4f2",
    "reducer": "#e8dcec",
    "run to branch": "#f8dfbd",
    "branch to run": "#f3c9bb",
    "over the run": "#d3eadb",
}
"""Colours of the bands, by manoeuvre."""
START: dict[str, Any] = {
    "marker": "o",
    "markersize": 4.5,
    "markerfacecolor": "white",
    "markeredgecolor": INK,
    "markeredgewidth": 0.9,
    "linestyle": "none",
}
"""The sign for places: a white disc with a dark edge."""


@dataclass(frozen=True)
class Mark:
    """Something that happened, with its sign in the map and in the time chart.

    Attributes:
        text: what it means, for the legend.
        marker: a marker of matplotlib, or one letter that is drawn as a glyph.
        colour: of the sign.
        rows: samples at which it happened.
    """

    text: str
    marker: str
    colour: Any
    rows: NDArray[np.intp]


def signs(mark: Mark) -> list[dict[str, Any]]:
    """The line styles that draw a mark: a glyph on a white disc, or a plain marker."""
    if mark.marker.isascii():
        return [START | {"marker": mark.marker, "markersize": 6.5, "markerfacecolor": mark.colour}]
    disc = START | {"markersize": 7, "markeredgecolor": mark.colour, "markeredgewidth": 0.6}
    glyph = {
        "marker": _glyph(mark.marker),
        "markersize": 4,
        "color": mark.colour,
        "linestyle": "none",
    }
    return [disc, glyph | {"markeredgewidth": 0.2}]


@cache
def _glyph(letter: str) -> Any:
    """The outline of a letter about its middle, as a marker."""
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    outline = TextPath((0, 0), letter)
    return Outline(
        outline.vertices - outline.get_extents().get_points().mean(axis=0), outline.codes
    )


def draw_time_chart(
    axes: tuple[Axes, Axes, Axes],
    heights: tuple[float, float],
    renderer: Any,
    trajectory: Trajectory,
    routes: tuple[Route, ...],
    marks: list[Mark],
) -> None:
    """Bands of the fittings, tilt and speed over time.

    Args:
        axes: for the bands, the tilt and the speed, one above the other.
        heights: height of the row that names the legs (0 for none) and of the bands, in the same
            unit.
        renderer: measures the text.
        trajectory: the record.
        routes: of each leg.
        marks: what to mark at its time.
    """
    strip, tilt, speed = axes
    time = trajectory.time
    ends = (float(time[0]), float(time[-1]) if time[-1] > time[0] else float(time[0]) + 1.0)
    for axis in axes:
        axis.set_xlim(*ends)
    _bands(strip, (speed, tilt), heights, renderer, trajectory, routes)
    tilt.plot(time, np.degrees(trajectory["tilt"]), color=INK)
    tilt.set_ylim(0, max(1.0, 1.3 * _largest(np.degrees(trajectory["tilt"]))))
    tilt.set_ylabel("tilt [deg]")
    tilt.tick_params(labelbottom=False)
    shown = 1e3 * _speed(trajectory)
    speed.plot(time, shown, color=INK)
    speed.set_ylim(-1.15 * _largest(-shown) - 1.0, 1.15 * _largest(shown) + 1.0)
    speed.axhline(0.0, color=GREY, linewidth=0.6)
    speed.set_ylabel("speed [mm/s]")
    speed.set_xlabel("time [s]")
    high = tilt.get_ylim()[1]
    for mark in marks:
        for style in signs(mark):
            tilt.plot(
                time[mark.rows],
                np.full(len(mark.rows), 0.87 * high),
                **style,
                zorder=5,
                clip_on=False,
            )


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


def _bands(
    strip: Axes,
    panels: tuple[Axes, ...],
    heights: tuple[float, float],
    renderer: Any,
    trajectory: Trajectory,
    routes: tuple[Route, ...],
) -> None:
    """Name the fittings that the robot's centre was in, and shade them behind the panels."""
    legs, names = heights
    strip.set_axis_off()
    strip.set_ylim(0, legs + names)
    leg, place = trajectory["leg"].astype(int), passage_indices(trajectory, routes)
    time = trajectory.time
    shown: dict[str, str] = {}
    for first, last in spans(leg, place):
        passage = routes[leg[first]].passages[place[first]]
        what = passage.words
        shade = shown[what] = SHADES.get(what, SHADES["straight"])
        start, end = float(time[first]), float(time[last])
        for axis in panels:
            axis.axvspan(start, end, color=shade, linewidth=0, zorder=0)
        strip.fill_between([start, end], legs, legs + names, color=shade, linewidth=0)
        strip.plot([start, start], [legs, legs + names], color="white", linewidth=1.2)
        name = routes[leg[first]].network.parts[passage.index].name
        _band_name(strip, renderer, name, start, end, legs, names)
    if legs:
        _leg_row(strip, legs, trajectory)
    _manoeuvre_legend(strip, shown)


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


def _manoeuvre_legend(strip: Axes, shown: dict[str, str]) -> None:
    """Legend above the strip; ``shown``: colours of the bands by manoeuvre."""
    from matplotlib.patches import Patch

    order = [what for what in dict.fromkeys([*SHADES, *shown]) if what in shown]
    handles = [
        Patch(facecolor=shown[what], edgecolor=GREY, linewidth=0.4, label=what) for what in order
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
    strip: Axes, renderer: Any, name: str, start: float, end: float, low: float, height: float
) -> None:
    """Write a name into its band, level or upright, as small as it must be; none without room."""
    left, right = (strip.transData.transform((x, 0.0))[0] for x in (start, end))
    room = float(right - left)
    bottom, top = (strip.transData.transform((0.0, y))[1] for y in (low, low + height))
    for size in (6.5, 5.5, 4.5):
        for angle in (0, 90):
            text = strip.text(
                (start + end) / 2, low + height / 2, name, ha="center", va="center", color=INK
            )
            text.set(fontsize=size, rotation=angle)
            box = text.get_window_extent(renderer)
            if box.width <= room - 2 and box.height <= top - bottom - 2:
                return
            text.remove()
