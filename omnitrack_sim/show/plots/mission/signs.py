"""Signs in the map of a mission: start, goals, plates, and what happened where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.events import FellOff
from omnitrack_sim.record.timeline import RETRY_PHASE, ROLL_PHASE, begun
from omnitrack_sim.show.plots.mission.layout import Layout
from omnitrack_sim.show.plots.style import ALARM, INK
from omnitrack_sim.show.plots.time_chart import START, Mark, signs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result

_PLATE: dict[str, Any] = {
    "facecolor": f"{ALARM}40",
    "edgecolor": ALARM,
    "linewidth": 1.8,
    "joinstyle": "bevel",
}
FOUND = "#b5dcc6"
"""Colour of pipes that are in the map of a robot that explores."""
_GOAL: dict[str, Any] = START | {
    "marker": "*",
    "markersize": 8,
    "markerfacecolor": "#ffd23f",
    "markeredgewidth": 0.6,
}


def marks_of(result: Result) -> list[Mark]:
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
    falls = [event.time for event in result.events if isinstance(event, FellOff)]
    rows = np.minimum(np.searchsorted(trajectory.time, falls), len(trajectory.time) - 1)
    marks.append(Mark("falls off its way", "\N{DOWNWARDS ARROW}", ALARM, rows))
    known = np.flatnonzero(np.isfinite(trajectory["position"]).all(axis=1))
    if not result.success:
        marks.append(Mark(f"end: {result.outcome.value.replace('_', ' ')}", "X", ALARM, known[-1:]))
    return [mark for mark in marks if len(mark.rows)]


def draw_places(
    axis: Axes, pair: tuple[int, int], start: Array, goals: Array, plates: Array
) -> None:
    """Draw start (1, 3) m, goals (G, 3) m, and plates given by their rims (P, k, 3) m."""
    columns = list(pair)
    for rim in plates:
        axis.fill(*rim[:, columns].T, **_PLATE, zorder=4)
    axis.plot(*start[:, columns].T, **START, zorder=5)
    axis.plot(*goals[:, columns].T, **_GOAL, zorder=5)


def draw_marks(
    axis: Axes, pair: tuple[int, int], trajectory: Trajectory, marks: list[Mark]
) -> None:
    for mark in marks:
        points = trajectory["position"][mark.rows][:, list(pair)].T
        for style in signs(mark):
            axis.plot(*points, **style, zorder=5.5)


def draw_legend(
    figure: Figure,
    layout: Layout,
    marks: list[Mark],
    tail_first: bool,
    plates: bool,
    found: bool,
) -> None:
    """Explain the signs of the map, in one row below it."""
    from matplotlib.lines import Line2D

    handles: list[Any] = [Line2D([], [], **START), Line2D([], [], **_GOAL)]
    texts = ["start", "goal"]
    if tail_first:
        handles.append(
            (
                Line2D([], [], color=INK, lw=3.0, solid_capstyle="butt"),
                Line2D([], [], color="white", lw=0.7, ls=(0, (2, 2))),
            )
        )
        texts.append("tail first")
    if plates:
        handles.append(Line2D([], [], color=ALARM, linewidth=_PLATE["linewidth"]))
        texts.append("closed by a plate")
    if found:
        handles.append(Line2D([], [], color=FOUND, linewidth=6.0, solid_capstyle="butt"))
        texts.append("in its map")
    for mark in marks:
        handles.append(tuple(Line2D([], [], **style) for style in signs(mark)))
        texts.append(mark.text)
    place = {"loc": "center", "bbox_to_anchor": (0.5, (layout.legend + 0.16) / layout.height)}
    figure.legend(handles, texts, ncols=len(texts), columnspacing=1.8, handletextpad=0.4, **place)
