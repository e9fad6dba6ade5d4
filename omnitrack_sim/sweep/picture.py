"""From a sweep's table to its figure."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.plots.style import save_figure
from omnitrack_sim.plots.sweep import Spread, sweep_figure
from omnitrack_sim.rotations import Array, direction_of
from omnitrack_sim.schema.tables import unit_of
from omnitrack_sim.sweep.axes import DirectionAxis
from omnitrack_sim.sweep.batch import ERROR, INVALID
from omnitrack_sim.sweep.spec import Sweep
from omnitrack_sim.theory.singularity import TurnCase

if TYPE_CHECKING:
    import pyarrow as pa

ALONG = 1 / 3
"""Components of a unit vector along the run axis, from - to + this, that count as across.

Each of the three classes has a third of the sphere.
"""
CLASSES = ("against the run axis", "across", "along")


def draw_map(sweep: Sweep, table: pa.Table) -> bytes:
    """``success_map.png``."""
    ends = zip(table["outcome"].to_pylist(), table["success"].to_pylist(), strict=True)
    passed = np.array(
        [np.nan if outcome in (INVALID, ERROR) else float(success) for outcome, success in ends]
    )
    buffer = io.BytesIO()
    save_figure(sweep_figure(spreads(sweep), passed, turn_case(sweep)), buffer, "png")
    return buffer.getvalue()


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
