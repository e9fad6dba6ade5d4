"""The figure of a sweep: success over what was varied."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, direction_of
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.display import SingularRange
from omnitrack_sim.scenario.model import unit_of, words_of
from omnitrack_sim.show.plots.style import chart, figure_bytes, page
from omnitrack_sim.show.plots.success import (
    CHART,
    Spread,
    draw_chart,
    groups_of,
    sweep_figure,
)
from omnitrack_sim.trials.axes import DirectionAxis
from omnitrack_sim.trials.run import TrialsResult
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import passed_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALONG = 1 / 3
"""Components of a unit vector along the run axis, from - to + this, that count as across.

Each of the three classes has a third of the sphere.
"""
CLASSES = ("against the run axis", "across", "along")


def plot_sweep(
    result: TrialsResult,
    path: str | Path | None = None,
    *,
    over: str | Sequence[str] | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """Plot success over the axes of a sweep.

    Args:
        result: of a sweep, all trials.
        path: file to write; none: the figure is returned and nothing is written.
        over: one axis of the sweep for the rates over it with Wilson 95 % intervals, or two that
            are numbers for a map; none: as in a sweep's folder (docs/how-to/sweeps.md).
        ax: where to draw one chart; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: trials are missing; no such axis or format; ``ax`` is given, and the sweep has
            more axes than one chart can show; ``path`` is given with ``ax``.
        OutputError: the file cannot be written.

    Example:
        >>> result = ot.run_trials(ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01}))
        >>> figure = ot.plot_sweep(result)
    """
    sweep = check_is(Sweep, "result.plan", check_is(TrialsResult, "result", result).plan)
    if result.table.num_rows != sweep.size:
        problem = f"has {result.table.num_rows} of {counted(sweep.size, 'trial')} of {sweep.name!r}"
        raise InputError(Fault("result", problem))
    passed = passed_of(result.table)
    if over is None and ax is None:
        return page(lambda: _figure(sweep, passed), path, format)
    axes = spreads(sweep)
    chosen, groups = _chosen(axes, over), groups_of(axes)
    return chart(lambda axis: draw_chart(axis, chosen, passed, groups), CHART, path, ax, format)


def _figure(sweep: Sweep, passed: Array) -> Figure:
    return sweep_figure(spreads(sweep), passed, singular_range(sweep), sweep.name)


def _chosen(axes: list[Spread], over: str | Sequence[str] | None) -> list[Spread]:
    """Axes of one chart, by their names; all where none are named."""
    by_name = {spread.name: spread for spread in axes}
    names = list(by_name) if over is None else [over] if isinstance(over, str) else [*over]
    for name in names:
        if name not in by_name:
            raise InputError(Fault("over", f"is {name!r}", tuple(by_name), str(name)))
    chosen = [by_name[name] for name in names]
    if len(chosen) not in (1, 2) or (len(chosen) == 2 and any(one.order for one in chosen)):
        problem = "name one axis, or two of numbers, for one chart"
        raise InputError(Fault("over", problem, tuple(by_name)))
    return chosen


def draw_map(sweep: Sweep, table: pa.Table) -> bytes:
    """Draw ``success_map.png``."""
    return figure_bytes(_figure(sweep, passed_of(table)))


def spreads(sweep: Sweep) -> list[Spread]:
    """Return the axes with their values, as numbers or words, one for each trial."""
    axes = []
    axis_of = {axis.name: axis for axis in sweep.axes}
    for name, values in sweep.trials().items():
        axis = axis_of.get(name)
        if isinstance(axis, DirectionAxis):
            # By the angle to the run axis of the first base.
            run_axis = direction_of(next(iter(sweep.bases.values())).start.axis)
            places = np.digitize(direction_of(values) @ run_axis, (-ALONG, ALONG))
            values = [CLASSES[k] for k in places]
            axes.append(Spread(name, "", values, CLASSES, words=words_of(name)))
        elif (
            # By exact type, since a truth value is an integer to isinstance, and has no place on a
            # scale.
            all(type(value) in (int, float) for value in values)
            and getattr(axis, "labels", None) is None
        ):
            numbers = np.array(values, float)
            axes.append(Spread(name, unit_of(name) or "1", numbers, words=words_of(name)))
        else:
            order = tuple(sweep.label(name, value) for value in sweep.crossed[name])
            words = [sweep.label(name, value) for value in values]
            axes.append(Spread(name, "", words, order, compared=True, words=words_of(name)))
    return axes


def singular_range(sweep: Sweep) -> SingularRange | None:
    """Return the orientations in which the robot of the first base cannot turn on its route."""
    scenario = next(iter(sweep.bases.values()))
    # Missions are left out: they may turn in several tees.
    passages = scenario.route.passages if scenario.pipes else ()
    radius = scenario.control.tee_turn_radius
    ranges = (scenario.robot.singular_range(passage, radius) for passage in passages)
    return next((found for found in ranges if found is not None), None)
