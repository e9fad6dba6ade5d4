"""The summary figure of one run: what the robot and its modules did over time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.text import clipped
from omnitrack_sim.show.plots.errors import BAND, BAND_COLOUR, ERRORS, draw_error, has_estimates
from omnitrack_sim.show.plots.grid import Grid
from omnitrack_sim.show.plots.panels import (
    COMMAND,
    LINES,
    PANELS,
    draw_panel,
    limits_of,
    phases_shown,
    shade,
)
from omnitrack_sim.show.plots.style import GREY, MODULE_COLOURS, PAGE, PAPER, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result

SHOWN: tuple[tuple[tuple[str, int | None], ...], ...] = (
    (("distance", None), ("belt_speed", 1), ("normal_force", None)),
    (("tilt", None), ("belt_speed", 2), ("contact_count", None)),
    (("offset", None), ("belt_speed", 3), ("slip_velocity", None)),
    (("roll", None), ("motor_torque", None), ("slip_ratio", None)),
    (("pitch", None), ("traction", None), ("slide", None)),
)
"""Channel of each panel, row by row, and the module where a panel shows only one."""
_LONGEST_PHASE = 24
"""Characters of the name of a phase in the legend."""


def plot_summary(
    result: Result | str | os.PathLike[str],
    path: str | Path | None = None,
    *,
    format: str | None = None,
) -> Figure:
    """The summary of a run: fifteen panels over time, with the phases shaded and named.

    It is as wide as a page (7.16 inches). Where a panel shows one module, its command is drawn
    broad and pale below the measured value. Of a robot that drives by its own sensors a further
    row shows how far it was wrong about itself, and by how much it says that it may be.

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
    from omnitrack_sim.show.plots.picture import Picture

    trajectory = result.trajectory
    errors = ERRORS if has_estimates(trajectory) else ()
    grid = Grid(rows=len(SHOWN) + bool(errors), columns=len(SHOWN[0]), above=0.78)
    figure = Picture(figsize=(PAGE, grid.height))
    speeds = PANELS["belt_speed"]
    both = [speeds.values(trajectory, name) for name in (speeds.channel, speeds.command)]
    same = limits_of(speeds, np.stack(both))
    for row, panels in enumerate(SHOWN):
        for column, (channel, module) in enumerate(panels):
            axis = grid.add(figure, row, column, PANELS[channel], module)
            shade(axis, trajectory)
            draw_panel(axis, PANELS[channel], trajectory, module)
            if channel == speeds.channel and same is not None:
                axis.set_ylim(*same)
    for column, panel in enumerate(errors):
        axis = grid.add(figure, len(SHOWN), column, panel, None)
        shade(axis, trajectory)
        draw_error(axis, panel, trajectory)
    told = f"{result.outcome.value.replace('_', ' ')} after {result.duration_s:.2f} s"
    grid.title(figure, result.scenario.name, told, result.success)
    _legends(figure, grid, trajectory)
    return figure


def _legends(figure: Figure, grid: Grid, trajectory: Trajectory) -> None:
    """What the lines are, and below it the phases."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines: list[Line2D | Patch] = [
        Line2D([], [], color=colour, label=f"module {i + 1}", **LINES[i])
        for i, colour in enumerate(MODULE_COLOURS)
    ]
    lines.append(Line2D([], [], label="command", **COMMAND))
    if has_estimates(trajectory):
        band = f"{BAND:.0f} sigma of the estimate"
        lines.append(Patch(fc=BAND_COLOUR, label=band))
    shades = [
        Patch(fc=shade, ec=GREY, lw=0.4, label=clipped(name, _LONGEST_PHASE))
        for name, shade in phases_shown(trajectory)
    ]
    grid.legend(figure, lines, 0.28)
    grid.legend(figure, shades, 0.43)
