"""The figure of a sweep's folder: success over what was varied."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.rotations import direction_of
from omnitrack_sim.record.display import SingularRange
from omnitrack_sim.scenario.model import words_of
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.show.plots.success import Spread, sweep_figure
from omnitrack_sim.trials.axes import DirectionAxis
from omnitrack_sim.trials.table import passed_of, unit_in

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnitrack_sim.trials.sweep import Sweep

ALONG = 1 / 3
"""Components of a unit vector along the run axis, from - to + this, that count as across.

Each of the three classes has a third of the sphere.
"""
CLASSES = ("against the run axis", "across", "along")


def figure_of(sweep: Sweep, table: pa.Table) -> Figure:
    """Return the figure of all trials."""
    axes = spreads(sweep, table)
    return sweep_figure(axes, passed_of(table), singular_range(sweep), sweep.name)


def draw_map(sweep: Sweep, table: pa.Table) -> bytes:
    """Draw ``success_map.png``."""
    return figure_bytes(figure_of(sweep, table))


def spreads(sweep: Sweep, table: pa.Table | None = None) -> list[Spread]:
    """Return the axes with their values, as numbers or words, one for each trial.

    Units that the sweep does not know, since its robot's code was not read, are those of the table.
    """
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
            axes.append(Spread(name, _unit(sweep, table, name), numbers, words=words_of(name)))
        else:
            order = tuple(sweep.label(name, value) for value in sweep.crossed[name])
            words = [sweep.label(name, value) for value in values]
            axes.append(Spread(name, "", words, order, compared=True, words=words_of(name)))
    return axes


def _unit(sweep: Sweep, table: pa.Table | None, name: str) -> str:
    told = None if table is None else unit_in(table, name)
    return sweep.units[name] or told or "1"


def singular_range(sweep: Sweep) -> SingularRange | None:
    """Return the orientations in which the robot of the first base cannot turn on its route."""
    scenario = next(iter(sweep.bases.values()))
    # Missions are left out: they may turn in several tees.
    passages = scenario.route.passages if scenario.pipes else ()
    radius = scenario.arcs.turn
    ranges = (scenario.robot.singular_range(passage, radius) for passage in passages)
    return next((found for found in ranges if found is not None), None)
