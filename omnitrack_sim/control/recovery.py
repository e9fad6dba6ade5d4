"""A robot that makes no headway in a turn backs off to before the fitting and tries again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.aligner import Aligner
from omnitrack_sim.control.guide import Guide
from omnitrack_sim.control.interface import Observation, Settings
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array

RETRIES = 2
"""How often a robot backs off at one fitting before it is left to hang."""
PROGRESS = 0.002
"""Advance beyond the farthest point so far that counts as headway, m."""
PATIENCE_DISTANCE = 0.15
"""Distance at cruise speed without headway after which a turn has failed, m; half of what ends the
run."""
MERGE_PATIENCE_DISTANCE = 0.27
"""Likewise out of a branch, where most robots that hang for a while get through."""
FALLEN = 0.04
"""Fall behind the farthest point after which a turn has failed, m."""
BESIDE = 0.6
"""Offset from the centreline, in pipe radii, beyond which a robot has gone past the branch; at 1
the run ends."""
BACKS_OFF = "backs off and tries again"
"""How an event tells that a robot does so."""
BACK_OFF_DISTANCE = 0.6
"""Distance at cruise speed after which backing off is given up, m."""


class Recovery:
    """Which of n robots back off. ``retries`` (n,) counts them at the fitting at hand."""

    def __init__(self, guide: Guide, robot: Robot, settings: Settings, period: float) -> None:
        self.guide, self.settings, self.period = guide, settings, period
        n = len(settings.cruise_speed)
        self.robot = robot
        self.farthest = np.full(n, -np.inf)
        self.waiting = np.zeros(n)  # s without headway, or backing off
        self.backing = np.zeros(n, bool)
        self.retries = np.zeros(n, int)
        self.passage = np.zeros(n, np.intp)

    def begin_leg(self, robot: int) -> None:
        """Start a robot afresh on its new way."""
        self.farthest[robot], self.waiting[robot] = -np.inf, 0.0
        self.backing[robot], self.retries[robot], self.passage[robot] = False, 0, -1

    def step(
        self,
        observation: Observation,
        standing: NDArray[np.bool_],
        aligner: Aligner,
        events: list[list[str]],
    ) -> NDArray[np.bool_]:
        """The robots (n,) that drive backward now. ``standing`` (n,) roll on the spot and are not
        waited for."""
        place = observation.place
        self.retries = np.where((place.passage != self.passage) & ~self.backing, 0, self.retries)
        self.passage = np.where(self.backing, self.passage, place.passage)
        headway = place.distance > self.farthest + PROGRESS
        self.farthest = np.where(headway, place.distance, self.farthest)
        still = self.backing | ~(headway | standing)
        self.waiting = np.where(still, self.waiting + self.period, 0.0)
        self._begin(observation, aligner, events)
        self._end(place.distance, aligner)
        return self.backing

    def _begin(self, observation: Observation, aligner: Aligner, events: list[list[str]]) -> None:
        place, speed = observation.place, self.settings.cruise_speed
        turning = self.guide.is_turn[place.passage] & (aligner.nose_room(place) < 0)
        patience = np.where(
            self.guide.out_of_branch[place.passage], MERGE_PATIENCE_DISTANCE, PATIENCE_DISTANCE
        )
        hanging = self.waiting > patience / speed
        fallen = place.distance < self.farthest - FALLEN
        # Out of a branch there is nothing to go past: the far wall stands across the way.
        beside = self.guide.into_branch[place.passage] & (
            place.offset > BESIDE * self.guide.radius[place.passage]
        )
        failed = (
            turning
            & (hanging | fallen | beside)
            & ~self.backing
            & (self.retries < RETRIES)
            & self.settings.retry
        )
        for robot in np.flatnonzero(failed):
            name = self.guide.name_of(int(place.passage[robot]))
            events[robot].append(
                f"{observation.time[robot]:.2f} s, in {name}: no headway at "
                f"{place.distance[robot]:.3f} m, tilt "
                f"{np.degrees(place.tilt[robot]):.1f} deg: {BACKS_OFF}"
            )
        self.backing = self.backing | failed
        self.retries = self.retries + failed
        self.waiting = np.where(failed, 0.0, self.waiting)

    def _end(self, distance: Array, aligner: Aligner) -> None:
        given_up = self.waiting > BACK_OFF_DISTANCE / self.settings.cruise_speed
        before = (
            self.guide.start[self.passage] - self.robot.length / 2 - self.robot.standing_room
        )  # m, where a retry begins
        done = self.backing & ((distance <= before) | given_up)
        self.backing = self.backing & ~done
        self.farthest = np.where(done, distance, self.farthest)
        self.waiting = np.where(done, 0.0, self.waiting)
        aligner.align_again(done, self.passage)
