"""Forces on the tails of n robots: a pull that grows with time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.plant import Plant
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.legs import Legs


class TailLoad:
    """Pulls at the tails of n robots, backward along their routes.

    Args:
        scenarios: of one batch, which share what pulls.
        legs: that the robots drive.
        plant: that the forces act in.

    Attributes:
        force: (n,) N, backward along the pipe.
    """

    def __init__(self, scenarios: Sequence[Scenario], legs: Legs, plant: Plant) -> None:
        first = scenarios[0]
        self._legs, self._plant = legs, plant
        self._pull = first.pull
        self._half = first.robot.length / 2
        self.force = np.full(len(scenarios), self._pull.force)

    def act(self, time: Array, location: Location) -> None:
        """Pull at all robots, at ``time`` (n,) s and where they are, until this is called again."""
        legs = self._legs
        # In reverse gear the tail leads.
        tail = location.distance - legs.gear * self._half
        backward = -legs.routes.tangents(tail[:, None], location.route)[:, 0]
        self.force = self._pull.force + self._pull.rate * time
        self._plant.pull(self.force[:, None] * backward)

    def values(self) -> Mapping[str, NDArray]:
        """Return the values (n,) of ``TAIL_CHANNELS``."""
        return {"tail_force": self.force}

    def words(self, robot: int) -> str:
        """Return the force on a robot's tail, for the reason of its outcome."""
        return f", pulled back by {self.force[robot]:.3g} N"
