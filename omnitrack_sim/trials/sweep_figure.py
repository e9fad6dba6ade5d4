"""From a sweep's table to its figure."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, direction_of
from omnitrack_sim.base.text import counted
from omnitrack_sim.robots.omnitrack.singularity import TurnCase
from omnitrack_sim.scenario.tables import unit_of
from omnitrack_sim.show.plots.style import PAPER, save_figure
from omnitrack_sim.show.plots.sweep import CHART, Spread, draw_chart, sweep_figure
from omnitrack_sim.trials.axes import DirectionAxis
from omnitrack_sim.trials.batches import ERROR, INVALID
from omnitrack_sim.trials.sweep import Sweep

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ALONG = 1 / 3
"""Components of a unit vector along the run axis, from - to + this, that count as across.

Each of the three classes has a third of the sphere.
"""
CLASSES = ("against the run axis", "across", "along")


def plot_sweep(
    sweep: Sweep,
    table: pa.Table,
    path: str | Path | None = None,
    *,
    over: str | Sequence[str] | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """Success over what a sweep has varied.

    Args:
        sweep: that was run.
        table: of ``run_sweep``, all trials.
        path: file to write; none: the figure is returned and nothing is written.
        over: one axis of the sweep for the rates over it with Wilson 95 % intervals, or two that
            are numbers for a map; none: as in a sweep's folder (docs/how-to/sweeps.md).
        ax: where to draw one chart; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: the table has other trials; no such axis or format; ``ax`` is given, and the
            sweep has more axes than one chart can show; ``path`` is given with ``ax``.
        OutputError: the file cannot be written.
    """
    from omnitrack_sim.show.plots.picture import chart, page

    check_is(Sweep, "sweep", sweep)
    if getattr(table, "num_rows", None) != sweep.size:
        told = f"is not the table of {sweep.name!r}, which has {counted(sweep.size, 'trial')}"
        raise InputError(Fault("table", told))
    passed = _passed(table)
    if over is None and ax is None:
        return page(lambda: sweep_figure(spreads(sweep), passed, turn_case(sweep)), path, format)
    chosen = _chosen(spreads(sweep), over)
    return chart(lambda axis: draw_chart(axis, chosen, passed), CHART, path, ax, format, PAPER)


def _chosen(found: list[Spread], over: str | Sequence[str] | None) -> list[Spread]:
    """The axes of one chart, by their names; all where none are named."""
    by_name = {spread.name: spread for spread in found}
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
    """``success_map.png``."""
    buffer = io.BytesIO()
    save_figure(sweep_figure(spreads(sweep), _passed(table), turn_case(sweep)), buffer, "png")
    return buffer.getvalue()


def _passed(table: pa.Table) -> Array:
    """Of each trial 1 passed, 0 failed, not a number where it has no outcome of the robot."""
    ends = zip(table["outcome"].to_pylist(), table["success"].to_pylist(), strict=True)
    return np.array(
        [np.nan if outcome in (INVALID, ERROR) else float(success) for outcome, success in ends]
    )


def spreads(sweep: Sweep) -> list[Spread]:
    """The axes with their values, as numbers or words, one for each trial."""
    found = []
    axis_of = {axis.name: axis for axis in sweep.axes}
    for name, values in sweep.trials().items():
        axis = axis_of.get(name)
        if isinstance(axis, DirectionAxis):
            found.append(Spread(name, "", _classes(sweep, values), CLASSES))
        elif (
            all(type(value) in (int, float) for value in values)
            and getattr(axis, "labels", None) is None
        ):
            found.append(Spread(name, unit_of(name) or "1", np.array(values, float)))
        else:
            order = tuple(sweep.label(name, value) for value in sweep.crossed[name])
            found.append(Spread(name, "", [sweep.label(name, value) for value in values], order))
    return found


def turn_case(sweep: Sweep) -> TurnCase | None:
    """Robot and tee of the first base; None if its route does not turn in a tee."""
    scenario = next(iter(sweep.bases.values()))
    for passage in scenario.route.fittings if scenario.pipes else ():
        if passage.manoeuvre == "tee_turn":
            return TurnCase(
                pipe_radius=passage.corner_radius,
                turn_angle=passage.turn_angle,
                reach=scenario.robot.reach,
                contact_length=scenario.robot.contact_length,
                bend_radius=scenario.control.tee_turn_radius,
            )
    return None


def _classes(sweep: Sweep, vectors: list[list[float]]) -> list[str]:
    """The class of each vector by its angle to the run axis of the first base."""
    axis: Array = direction_of(next(iter(sweep.bases.values())).start.axis)
    component = direction_of(vectors) @ axis
    return [CLASSES[k] for k in np.digitize(component, (-ALONG, ALONG))]
