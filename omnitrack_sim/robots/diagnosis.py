"""Diagnosis: the cause for which a robot makes no headway."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Outcome


class Diagnosis:
    """Finds the cause for which each of n robots makes no headway.

    A robot with more to tell than its tilt keeps averages of its readings.

    Args:
        robot: parameters.
        limits: ``[monitor]`` of the scenario.
        period: s, between two samples of the averages.
        n: number of robots.
    """

    def __init__(self, robot: Any, limits: Any, period: float, n: int) -> None:
        self.limits, self.n = limits, n

    def reset(self, rows: NDArray[np.intp]) -> None:
        """Begin anew for robots ``rows`` (k,)."""

    def average(
        self,
        readings: Mapping[str, Array],
        command: Any,
        saturated: NDArray[np.bool_],
        due: NDArray[np.bool_],
    ) -> None:
        """Add a sample to the averages of the robots ``due`` (n,).

        Args:
            readings: of the sensors.
            command: that the robots carry out.
            saturated: (n, m) motors at their limit.
            due: (n,) robots of which a sample is taken.
        """

    def cause(self, robot: int, location: Location, routes: RouteMap) -> Outcome:
        """Return the cause for which a robot makes no headway."""
        return Outcome.WEDGED if self.lies_across(robot, location) else Outcome.STUCK

    def lies_across(self, robot: int, location: Location) -> bool:
        """Return whether a robot lies across its pipe."""
        return bool(np.abs(np.cos(location.tilt[robot])) < self.limits.wedged_cosine)

    def words(self, robot: int, time: float) -> str:
        """Return measurements at the end of a run of ``time`` s, after the robot's tilt; "" for
        none."""
        return ""
