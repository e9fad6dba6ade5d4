"""Diagnosis of a robot that makes no headway: averages of forces, slip and motors, and the cause
that they tell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.diagnosis import Diagnosis
from omnitrack_sim.robots.omnitrack.parameters import Omnitrack
from omnitrack_sim.robots.robot import GRAVITY

# Rows of the averages that the cause of a failure is read from.
NORMAL_FORCE, SLIP_RATIO, SATURATED, BELT_SPEED, BELT_COMMAND, ROLL_COSINE = range(6)


class TrackDiagnosis(Diagnosis):
    """Finds the causes for which n robots make no headway; see ``Diagnosis``.

    Args:
        robot: its length and weight are units of the limits.
        limits: see ``[monitor]`` in docs/reference/scenarios.md.
        period: s, between two samples.
        n: number of robots.
    """

    def __init__(self, robot: Omnitrack, limits: Any, period: float, n: int) -> None:
        super().__init__(robot, limits, period, n)
        self._period, self._memory = period, limits.memory * robot.time_scale
        self._lost_contact = limits.lost_contact * robot.mass * GRAVITY
        self._exit = robot.length / 2
        self._samples = np.zeros(n, int)
        self._mean, self._sample = np.zeros((2, n, 6, 3))

    def reset(self, rows: NDArray[np.intp]) -> None:
        """See ``Diagnosis``."""
        self._mean[rows], self._samples[rows] = 0.0, 0

    def average(
        self,
        readings: Mapping[str, Array],
        command: Any,
        saturated: NDArray[np.bool_],
        due: NDArray[np.bool_],
    ) -> None:
        """See ``Diagnosis``."""
        self._samples += due
        # A plain mean until the memory is full.
        part = np.maximum(self._period / self._memory, 1 / np.maximum(self._samples, 1))
        weight = np.where(due, part, 0.0)[:, None, None]
        sample, belt_command = self._sample, command.belt_speed
        sample[:, NORMAL_FORCE] = readings["normal_force"]
        np.abs(readings["slip_ratio"], out=sample[:, SLIP_RATIO])
        sample[:, SATURATED] = saturated
        np.multiply(readings["belt_speed"], np.sign(belt_command), out=sample[:, BELT_SPEED])
        np.abs(belt_command, out=sample[:, BELT_COMMAND])
        np.abs(np.cos(readings["roll"]), out=sample[:, ROLL_COSINE])
        self._mean += weight * (sample - self._mean)

    def cause(self, robot: int, location: Location, routes: RouteMap) -> Outcome:
        """See ``Diagnosis``."""
        if self.lies_across(robot, location):
            return Outcome.WEDGED
        mean, limits, passage = self._mean[robot], self.limits, int(location.passage[robot])
        running = limits.stalled_speed * mean[BELT_COMMAND]
        # At its limit and slower than asked: a motor that only works hard is not stalled.
        stalled = (mean[SATURATED] > 0.5) & (mean[BELT_SPEED] < running)
        # First, for there both tracks of a module work against each other: motors may stall, belts
        # slip.
        if (mean[ROLL_COSINE] < limits.no_motion_cosine).all():
            return Outcome.NO_MOTION_LINE
        turning = routes.is_tee_turn[passage]
        begun = location.distance[robot] > routes.start[passage] - self._exit
        if turning and begun and mean[NORMAL_FORCE].min() < self._lost_contact:
            return Outcome.MOTION_SINGULARITY
        if stalled.any():
            return Outcome.STALLED
        # The median of the three: one module alone may spin without a wall.
        if np.sort(mean[SLIP_RATIO])[1] > limits.slipping_ratio:
            return Outcome.SLIPPING
        return Outcome.STUCK

    def words(self, robot: int, time: float) -> str:
        """See ``Diagnosis``."""
        mean = self._mean[robot]
        forces = ", ".join(f"{force:.1f}" for force in mean[NORMAL_FORCE])
        slips = ", ".join(f"{slip:.2f}" for slip in mean[SLIP_RATIO])
        return (
            f", normal force {forces} N, slip ratio {slips} "
            f"(means of the last {min(self._memory, time):.2g} s)"
        )
