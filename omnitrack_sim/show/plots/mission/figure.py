"""The figure of a mission: map, time chart, title and legend put together."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import clipped
from omnitrack_sim.pipes import Route
from omnitrack_sim.show.plots.mission.layout import LEFT, RIGHT, WIDTH, Layout
from omnitrack_sim.show.plots.mission.signs import (
    FOUND,
    draw_legend,
    draw_marks,
    draw_places,
    marks_of,
)
from omnitrack_sim.show.plots.mission.travel import colour_bar, draw_way, stretches_of
from omnitrack_sim.show.plots.names import draw_names
from omnitrack_sim.show.plots.network import draw_pipes, faces, named_parts
from omnitrack_sim.show.plots.style import ALARM, DPI, INK, PAPER, styled
from omnitrack_sim.show.plots.time_chart import draw_time_chart

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result

_NAMES = 5.5
"""Size of the parts' names, points."""


def plot_mission(
    result: Result | str | os.PathLike[str],
    path: str | Path | None = None,
    *,
    format: str | None = None,
) -> Figure:
    """Map and time chart of a run, as wide as a page (7.16 inches).

    The map shows the pipes in elevation and plan, with the way of the robot's centre in them, and
    over them those that are in the map of a robot that explores, in another colour. On
    the left its colour is the slip ratio, the mean of the modules' magnitudes over 10 mm of travel;
    on the right the least normal force of a module there, of a mean over 0.1 s. Travel tail first
    is drawn beside the axis, on the right-hand side of its direction, with a dashed core. The chart
    below has the fittings as bands, tilt and speed over time.

    Args:
        result: the run, or the folder of a saved one.
        path: file to write; none: the figure is returned and nothing is written.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Raises:
        InputError: no such format.
        OutputError: the file cannot be written, or the folder is no run.
    """
    from omnitrack_sim.results.result import as_result
    from omnitrack_sim.show.plots.picture import page

    run = as_result(result)
    return page(lambda: styled(lambda: _draw(run), PAPER), path, format)


def _draw(result: Result) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from omnitrack_sim.show.plots.picture import Picture

    routes = result.routes()
    trajectory, found = result.trajectory, result.map
    pipes = routes[0].network if found is None else result.pipes
    quads = faces(pipes)
    marks = marks_of(result)
    stretches = list(stretches_of(trajectory))
    layout = Layout(quads, len({s.leg for s in stretches}) > 1)
    figure = Picture(figsize=(WIDTH, layout.height), dpi=DPI)
    canvas = FigureCanvasAgg(figure)  # measures the names as they are drawn
    renderer = canvas.get_renderer()
    _title(figure, result, routes, layout)
    quantities = (
        (
            "slip ratio: mean magnitude of the modules over 10 mm",
            "viridis",
            [s.slip for s in stretches],
        ),
        ("least normal force of a module [N]", "plasma", [s.force for s in stretches]),
    )
    way = np.concatenate([trajectory["position"][s.rows] for s in stretches])
    start, goals, plates = trajectory["position"][:1], result.goal_points(), result.plate_rims()
    for column, (text, colours, values) in enumerate(quantities):
        scale = colour_bar(figure, layout, column, text, colours, values)
        axes = []
        for view in layout.views:
            axis = layout.add(figure, view, column)
            draw_pipes(axis, pipes, view.pair, quads)
            if found is not None:
                draw_pipes(axis, found.pipes, view.pair, faces(found.pipes), FOUND)
            draw_way(axis, view, trajectory, routes, stretches, values, scale)
            draw_places(axis, view.pair, start, goals, plates)
            draw_marks(axis, view.pair, trajectory, marks)
            axes.append(axis)
        pairs = [view.pair for view in layout.views]
        draw_names(axes, pairs, renderer, pipes, named_parts(pipes), way, _NAMES)
    draw_legend(
        figure,
        layout,
        marks,
        any(s.tail_first for s in stretches),
        len(plates) > 0,
        found is not None,
    )
    draw_time_chart(
        layout.chart(figure), (layout.legs, layout.strip), renderer, trajectory, routes, marks
    )
    return figure


def _title(figure: Figure, result: Result, routes: tuple[Route, ...], layout: Layout) -> None:
    top = 1 - 0.07 / layout.height
    name = clipped(result.scenario.name, 60)
    figure.text(LEFT / WIDTH, top, name, size=10, weight="bold", color=INK, va="top")
    outcome = result.outcome.value.replace("_", " ")
    travel = sum(float(np.abs(np.diff(rows)).sum()) for rows in _distances(result.trajectory))
    text = f"{outcome} after {result.duration_s:.2f} s, {travel:.2f} m driven"
    if len(routes) > 1:
        text += f" on {int(result.trajectory['leg'].max()) + 1} of {len(routes)} legs"
    colour = INK if result.success else ALARM
    figure.text(1 - RIGHT / WIDTH, top, text, size=8, color=colour, va="top", ha="right")


def _distances(trajectory: Trajectory) -> list[Array]:
    """The distances of each leg, m, without samples that have none."""
    leg, distance = trajectory["leg"], trajectory["distance"]
    known = np.isfinite(distance)
    return [distance[known & (leg == index)] for index in np.unique(leg)]
