"""Decides when a trial is over, and why."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.guide import Guide, Place
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array
from omnitrack_sim.sim.plant import Readings

PROGRESS = 0.002
"""Advance beyond the farthest point so far that counts as progress, m."""
PATIENCE_TIME = 3.0
"""Least time without progress after which a trial is over, s."""
PATIENCE_DISTANCE = 0.3
"""Likewise in distance at the commanded speed, m: 3 s at 0.1 m/s."""
SLIDE_BACK = 0.10
"""Fall behind the farthest point that ends a trial, m."""
MEMORY = 0.5
"""Time constant of the averages that the cause is read from, s."""
TEE_ROOM = 1.5
"""Offset from the centreline, in pipe radii, beyond which a robot has gone astray in a tee turn; 1
elsewhere."""
LOST_CONTACT = 1.0
"""Mean normal force below which a module counts as having lost the wall, N."""
NO_MOTION_COSINE = 0.2
SLIPPING_RATIO = 0.5
STALLED_SPEED = 0.2
"""Part of the commanded belt speed below which a saturated motor counts as stalled."""


SendsOn = Callable[[int, Place, float, bool], float | None]
"""Given a robot, the places of all, the time in s and whether it has arrived: seconds for its next
leg, or None."""


@dataclass
class _Averages:
    """Exponential averages of what the cause of a failure is read from, (n, 3) each."""

    normal_force: Array
    slip_ratio: Array
    saturated: Array
    belt_speed: Array
    belt_command: Array
    roll_cosine: Array

    def update(self, weight: float, **values: Array) -> None:
        for name, value in values.items():
            old = getattr(self, name)
            old += weight * (value - old)


class Monitor:
    """Outcomes of n trials. ``outcome`` holds None while a trial runs."""

    def __init__(
        self,
        guide: Guide,
        robot: Robot,
        goal: Array,
        start: Array,
        cruise_speed: Array,
        time_limit: Array,
        period: float,
        sends_on: SendsOn,
    ):
        """``goal`` (n,) m is read anew at every step. ``sends_on`` is asked before a trial ends
        that could go on."""
        n = len(goal)
        self._sends_on = sends_on
        self.guide, self.goal, self.period = guide, goal, period
        self.time_limit = np.array(time_limit, float)
        self.patience = np.maximum(PATIENCE_TIME, PATIENCE_DISTANCE / cruise_speed)
        self.exit = robot.length / 2
        self.farthest = np.array(start, float)
        self.waiting = np.zeros(n)  # s since the last progress
        self.outcome: list[Outcome | None] = [None] * n
        self.reason = [""] * n
        self.end_time = np.full(n, np.nan)
        self._steps = 0
        self._mean = _Averages(*(np.zeros((n, 3)) for _ in range(6)))

    @property
    def active(self) -> NDArray[np.intp]:
        """Indices of the trials that still run."""
        return np.flatnonzero(np.isnan(self.end_time))

    def update(
        self,
        readings: Readings,
        place: Place,
        belt_command: Array,
        saturated: NDArray[np.bool_],
        resting: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
    ) -> None:
        """Look at one control step.

        Args:
            readings: of the plant.
            place: of the robots.
            belt_command: (n, 3) m/s.
            saturated: (n, 3) bool, motors at their torque limit.
            resting: (n,) bool, robots that stand still or drive backward on purpose.
            diverged: (n,) bool.
        """
        self._steps += 1
        self._mean.update(
            max(self.period / MEMORY, 1 / self._steps),  # a plain mean until the memory is full
            normal_force=readings.normal_force,
            slip_ratio=np.abs(readings.slip_ratio),
            saturated=saturated.astype(float),
            belt_speed=readings.belt_speed * np.sign(belt_command),
            belt_command=np.abs(belt_command),
            roll_cosine=np.abs(np.cos(readings.roll)),
        )
        progress = place.distance > self.farthest + PROGRESS
        # Headway is counted anew from where a robot rests or has backed off to.
        self.farthest = np.where(progress | resting, place.distance, self.farthest)
        self.waiting = np.where(progress | resting, 0.0, self.waiting + self.period)
        # In the middle of a tee the arc of a turn is up to a bore's radius from where the robot may
        # well be.
        in_turn = self.guide.is_tee_turn[place.passage]
        room = self.guide.radius[place.passage] * np.where(in_turn, TEE_ROOM, 1.0)
        outside = (place.offset > room) | (place.distance < -self.exit)
        outside |= place.distance > self.guide.lengths[place.way] + self.exit
        hanging = (self.waiting > self.patience) | (place.distance < self.farthest - SLIDE_BACK)
        events = (
            (diverged, Outcome.DIVERGED),
            (place.distance >= self.goal, Outcome.REACHED_GOAL),
            (outside, Outcome.LEFT_PIPE),
            (hanging, None),
            (readings.time >= self.time_limit - 1e-9, Outcome.TIMED_OUT),
        )
        if not np.any([flags.any() for flags, _ in events]):
            return
        sent: set[int] = set()
        for flags, outcome in events:
            for i in np.flatnonzero(flags & np.isnan(self.end_time)).tolist():
                if i in sent:
                    continue
                goes_on = outcome in (None, Outcome.REACHED_GOAL)
                allowed = (
                    self._sends_on(i, place, float(readings.time[i]), outcome is not None)
                    if goes_on
                    else None
                )
                if allowed is None:
                    self._end(i, outcome or self._cause(i, place), readings, place)
                else:
                    sent.add(i)
                    self.farthest[i], self.waiting[i] = -np.inf, 0.0
                    self.time_limit[i] += allowed

    def _cause(self, i: int, place: Place) -> Outcome:
        """Why trial ``i`` makes no headway."""
        mean, passage = self._mean, int(place.passage[i])
        stalled = (mean.saturated[i] > 0.5) & (
            mean.belt_speed[i] < STALLED_SPEED * mean.belt_command[i]
        )
        if (mean.roll_cosine[i] < NO_MOTION_COSINE).all():
            return Outcome.NO_MOTION_LINE
        turning = self.guide.is_tee_turn[passage]
        if (
            turning
            and place.distance[i] > self.guide.start[passage] - self.exit
            and mean.normal_force[i].min() < LOST_CONTACT
        ):
            return Outcome.MOTION_SINGULARITY
        if stalled.any():
            return Outcome.STALLED
        if np.sort(mean.slip_ratio[i])[1] > SLIPPING_RATIO:
            return Outcome.SLIPPING
        return Outcome.STUCK

    def _end(self, i: int, outcome: Outcome, readings: Readings, place: Place) -> None:
        self.outcome[i], self.end_time[i] = outcome, readings.time[i]
        mean = self._mean
        where = (
            f"at {place.distance[i]:.3f} m of {self.guide.lengths[place.way[i]]:.3f} m after "
            f"{readings.time[i]:.2f} s"
        )
        forces = ", ".join(f"{f:.1f}" for f in mean.normal_force[i])
        slips = ", ".join(f"{s:.2f}" for s in mean.slip_ratio[i])
        self.reason[i] = (
            f"{where}; tilt {np.degrees(place.tilt[i]):.1f} deg, normal force {forces} N, slip "
            f"ratio {slips} "
            f"(means of the last {MEMORY} s)"
        )
