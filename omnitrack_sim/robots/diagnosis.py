"""Why a robot makes no headway."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Outcome


class Motion(StrEnum):
    """How a robot moves over the walls."""

    FALLING = "fell"
    """Nothing of it touches a wall."""
    SLIDING = "slid"
    """What touches slides."""
    DRIVING = "moved"
    """What touches rolls, steps or sticks."""


class Diagnosis:
    """Finds the cause for which each of n robots makes no headway.

    A robot whose causes need more than its tilt and its contacts keeps averages of its readings.

    Args:
        robot: parameters.
        limits: ``[monitor]`` of the scenario.
        period: s, between two samples of the averages.
        robots: the parameters of each; the list is the simulation's, which changes it.
    """

    def __init__(self, robot: Any, limits: Any, period: float, robots: Sequence[Any]) -> None:
        self.limits, self.robots, self.n = limits, robots, len(robots)

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

    def cause(
        self, robot: int, location: Location, routes: RouteMap, retreat: Motion | None
    ) -> Outcome:
        """Return the cause for which a robot makes no headway.

        Args:
            robot: its number.
            location: of all robots.
            routes: of theirs.
            retreat: how it moved back by ``monitor.slide_back``; None if it did not.
        """
        if self.lies_across(robot, location):
            return Outcome.WEDGED
        lost_hold = retreat in (Motion.FALLING, Motion.SLIDING)
        return Outcome.SLIPPING if lost_hold else Outcome.STUCK

    def motion(self, robot: int, readings: Mapping[str, Array], speed: float) -> Motion:
        """Return how a robot moves that is asked for a ``speed``, m/s."""
        if not readings["wall_force"][robot].any():
            return Motion.FALLING
        slides = _slip(robot, readings) > self.limits.slipping_ratio * speed
        return Motion.SLIDING if slides else Motion.DRIVING

    def lies_across(self, robot: int, location: Location) -> bool:
        """Return whether a robot lies across its pipe."""
        return bool(np.abs(np.cos(location.tilt[robot])) < self.limits.wedged_cosine)

    def words(self, robot: int, readings: Mapping[str, Array], speed: float) -> str:
        """Return measurements at the end of a run, in words; "" for none.

        Args:
            robot: its number.
            readings: of the sensors at the end.
            speed: that it is asked for, m/s.
        """
        if self.motion(robot, readings, speed) is not Motion.SLIDING:
            return ""
        slip = _slip(robot, readings)
        return f", sliding over the wall at {slip:.2g} m/s; it is asked for {speed:.2g} m/s"


def _slip(robot: int, readings: Mapping[str, Array]) -> float:
    """Speed of what touches over the wall, m/s, mean by force."""
    force = readings["wall_force"][robot]
    return float(force @ readings["contact_speed"][robot]) / float(force.sum())
