"""Reward of one decision: named terms with weights, measured by the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.sim.simulation import Simulation


@dataclass(frozen=True)
class Term:
    """A part of the reward.

    Attributes:
        name: for options and ``info``.
        unit: of its measure, for one decision.
        weight: default factor of the measure.
        meaning: one line for the docs.
    """

    name: str
    unit: str
    weight: float
    meaning: str


# The way through a tee is about 5 D long, so that progress brings about 5, and arriving half as
# much again. The costs of a gentle drive are a tenth of that.
_TERMS = (
    Term("progress", "D", 1.0, "way along the route; backward it is negative"),
    Term("tilt", "rad s", -0.2, "robot axis against the centreline, over time"),
    Term("slip", "D", -0.2, "way of what touches the wall over it, mean of modules or bodies"),
    Term(
        "torque_change",
        "torque limits",
        -0.02,
        "change of the motors' torques from control step to control step, mean of the motors",
    ),
    Term("arrival", "1", 2.5, "1 when the robot reaches its goal"),
    Term("failure", "1", -2.5, "1 when its run ends otherwise, but for the end of its time"),
)
TERMS: Mapping[str, Term] = {term.name: term for term in _TERMS}
"""The terms of the reward by name."""


class Tally:
    """Adds up the terms of n robots over the control steps of one decision, by the truth."""

    def __init__(self, simulation: Simulation) -> None:
        n, first = simulation.n, simulation.scenarios[0]
        self._bore, self._period = first.robot.nominal_bore, simulation.period
        self.measured: dict[str, Array] = {name: np.zeros(n) for name in TERMS}
        self._limit = simulation.plant.effort_limit
        self._remember(simulation)

    def _remember(self, simulation: Simulation) -> None:
        self._active, self._leg = simulation.active, simulation.legs.number
        self._location: Location = simulation.location
        self._effort = simulation.plant.effort(simulation.readings)

    def add(self, simulation: Simulation) -> None:
        """Add the control step that has just been done."""
        measured, readings, location = self.measured, simulation.readings, simulation.location
        plant = simulation.plant
        # On another leg the way is counted from elsewhere.
        same = self._active & (simulation.legs.number == self._leg)
        moved = location.distance - self._location.distance
        measured["progress"] += np.where(same, moved / self._bore, 0.0)
        slip = plant.slip_speed(readings)
        change = (np.abs(plant.effort(readings) - self._effort) / self._limit).mean(axis=1)
        measured["tilt"] += np.where(self._active, location.tilt * self._period, 0.0)
        measured["slip"] += np.where(self._active, slip * self._period / self._bore, 0.0)
        measured["torque_change"] += np.where(self._active, change, 0.0)
        self._remember(simulation)

    def over(
        self, arrived: NDArray[np.bool_], failed: NDArray[np.bool_], diverged: NDArray[np.bool_]
    ) -> Mapping[str, Array]:
        """Return all terms (n,) at the end of the decision; of robots whose physics has diverged
        only the failure counts."""
        self.measured["arrival"] += arrived
        self.measured["failure"] += failed
        for name in TERMS:
            if name != "failure":
                self.measured[name] = np.where(diverged, 0.0, self.measured[name])
        return self.measured
