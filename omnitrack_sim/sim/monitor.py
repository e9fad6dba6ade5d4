"""Verdicts on n robots: who has arrived, hangs, leans over, or is to end, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.autonomy.pilots import Hindrance
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.diagnosis import Motion
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario.tables import MonitorTable
from omnitrack_sim.sim.tail_load import TailLoad


@dataclass(frozen=True)
class LeanLimits:
    """Lean from which on a robot that rights itself does so, and does not drive on.

    Attributes:
        lean: rad, to the centreline: of eight explorations without a fall six had none beyond 30
            degrees, and one beyond 45, for 0.4 s.
        time: s, for which it leans by more, for D = 160 mm.
    """

    lean: float = math.radians(45)
    time: float = 0.5


LEAN_LIMITS = LeanLimits()
TIME_ROUNDING = 1e-9
"""Rounding of times, s, which are sums of steps: without it a time limit may last a step longer."""


class Verdict(NamedTuple):
    """Judgement of one robot."""

    robot: int
    found: Outcome | Hindrance


class Headway(NamedTuple):
    """What n robots have to make headway by.

    Attributes:
        patience: (n,) s, longest time without headway.
        waiting: (n,) s, how long each has made none by now.
        time_limit: (n,) s, of the run.
        farthest: (n,) m, arc length that each has reached.
        progress: m, that counts as headway.
        slide_back: m, back from the farthest point, that ends a run.
    """

    patience: Array
    waiting: Array
    time_limit: Array
    farthest: Array
    progress: float
    slide_back: float


class Monitor:
    """Watches n robots.

    Args:
        routes: of the robots.
        robots: the parameters of each; the list is the simulation's, which changes it. The length
            of the first is a unit of the limits, and it finds causes of failures.
        limits: see ``[monitor]`` in docs/reference/scenarios.md.
        start: (n,) m, arc lengths where they begin.
        cruise_speed: (n,) m/s, in the sharpest bend of the way.
        time_limit: (n,) s.
        period: s, between two looks.
        sample_every: looks between two samples of the averages.
        tail: pulls at the robots; None: nothing does.
        rights: (n,) robots that right themselves where they lean over; None: none does.
    """

    def __init__(
        self,
        routes: RouteMap,
        robots: Sequence[Robot],
        limits: MonitorTable,
        start: Array,
        cruise_speed: Array,
        time_limit: Array,
        period: float,
        sample_every: int,
        tail: TailLoad | None = None,
        rights: NDArray[np.bool_] | None = None,
    ):
        n, robot = len(start), robots[0]
        self.routes, self.limits, self.period, self._tail = routes, limits, period, tail
        self._sample_every = sample_every
        self._diagnosis = robots[0].diagnosis(limits, period * sample_every, robots)
        self._progress, self._slide_back, self._patience_length = (
            float(robot.own_length(length))
            for length in (limits.progress, limits.slide_back, limits.patience)
        )
        self._scale = robot.time_scale
        self._exit = robot.length / 2
        # s of patience, s since the last progress, s, m
        self._patience, self._waiting, self._time_limit, self._max_distance = np.zeros((4, n))
        self._cruise_speed = np.zeros(n)  # m/s
        self._looks = np.zeros(n, int)
        # Robots that right themselves; that have been upright on the leg at hand; s since when
        # they lean over.
        self._rights, self._upright = np.zeros((2, n), bool)
        self._leaning = np.zeros(n)
        self._version = -1
        everyone, none = np.arange(n), np.zeros(n, bool)
        self.reset(everyone, start, cruise_speed, time_limit, none if rights is None else rights)

    @property
    def headway(self) -> Headway:
        """Headway of the robots, and what is asked of them."""
        return Headway(
            self._patience.copy(),
            self._waiting.copy(),
            self._time_limit.copy(),
            self._max_distance.copy(),
            self._progress,
            self._slide_back,
        )

    def reset(
        self,
        rows: NDArray[np.intp],
        start: Array,
        cruise_speed: Array,
        time_limit: Array,
        rights: NDArray[np.bool_],
    ) -> None:
        """Watch robots ``rows`` (k,) from the start of a new run; see the class."""
        patience = self._patience_length / cruise_speed
        self._cruise_speed[rows] = cruise_speed
        self._patience[rows] = np.maximum(self.limits.patience_time * self._scale, patience)
        self._time_limit[rows], self._max_distance[rows] = time_limit - TIME_ROUNDING, start
        self._waiting[rows], self._looks[rows] = 0.0, 0
        self._rights[rows], self._upright[rows], self._leaning[rows] = rights, False, 0.0
        self._diagnosis.reset(rows)

    def start_leg(self, robot: int, seconds: float) -> None:
        """Begin to watch a robot on another leg, and extend its time limit."""
        # Arc length begins elsewhere on another leg: any value is headway.
        self._max_distance[robot], self._waiting[robot] = -np.inf, 0.0
        self._upright[robot], self._leaning[robot] = False, 0.0
        self.extend_time_limit(robot, seconds)

    def shift_progress(self, robot: int, shift: float) -> None:
        """Move the farthest point of a robot whose estimate has been moved by ``shift`` m."""
        self._max_distance[robot] += shift

    def extend_time_limit(self, robot: int, seconds: float) -> None:
        """Extend the time limit of a robot whose leg is longer than was known."""
        self._time_limit[robot] += seconds

    def look(
        self,
        readings: Mapping[str, Array],
        location: Location,
        robots: NDArray[np.bool_],
        *,
        arrived: NDArray[np.bool_],
        resting: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
        lost: NDArray[np.bool_],
        over: NDArray[np.bool_],
    ) -> list[Verdict]:
        """Judge one control step; verdicts in the order in which they count.

        Args:
            readings: of the sensors.
            location: of the robots.
            robots: (n,) those that are judged; nothing changes for the others.
            arrived: (n,) robots that are at the end of the leg at hand, or take themselves to be.
            resting: (n,) robots that stand still or drive backward on purpose.
            diverged: (n,) robots whose physics has gone wrong.
            lost: (n,) robots that have searched for their pose in vain.
            over: (n,) robots whose controller ends the run.
        """
        hanging = self._hanging(location.distance, resting, robots)
        off_route = self.off_route(location)
        timed_out = readings["time"] >= self._time_limit
        leaning = self._leaning_over(location, robots)
        # In nearly every step nothing is found, and this is all that is done.
        found = arrived | off_route | hanging | timed_out | diverged | lost | over | leaning
        if not np.count_nonzero(found & robots):
            return []
        judgements = (
            (lost, Outcome.LOST),
            (diverged, Outcome.DIVERGED),
            (arrived, Outcome.REACHED_GOAL),
            (off_route, Hindrance.OFF_ROUTE),
            (hanging, Hindrance.NO_HEADWAY),
            (timed_out, Outcome.TIMED_OUT),
            (over, Outcome.ENDED),
            (leaning, Hindrance.LEANING),
        )
        return [
            Verdict(robot, finding)
            for flags, finding in judgements
            for robot in np.flatnonzero(flags & robots).tolist()
        ]

    def _hanging(
        self, distance: Array, resting: NDArray[np.bool_], robots: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Robots (n,) that have made no headway for too long, or have slid back."""
        # Headway counts anew from where a robot rests or has backed off to.
        headway = ((distance > self._max_distance + self._progress) | resting) & robots
        np.copyto(self._max_distance, distance, where=headway)
        np.add(self._waiting, self.period, out=self._waiting, where=robots)
        np.copyto(self._waiting, 0.0, where=headway)
        return (self._waiting > self._patience) | (distance < self._max_distance - self._slide_back)

    def _leaning_over(self, location: Location, robots: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Robots (n,) that lean over for too long: soon they would lie across, and be wedged.

        Those that right themselves, and were upright on the leg at hand.
        """
        if not np.count_nonzero(self._rights):
            return self._rights
        robots = robots & self._rights
        self._upright |= robots & (location.tilt < LEG_PLANNER.along)
        leans = robots & self._upright & (location.tilt > LEAN_LIMITS.lean)
        self._leaning = np.where(leans, self._leaning + self.period, 0.0)
        leaning = self._leaning > LEAN_LIMITS.time * self._scale
        self._leaning[leaning] = 0.0
        return leaning

    def off_route(self, location: Location) -> NDArray[np.bool_]:
        """Return the robots (n,) that have left their route.

        Their centres are in no bore of it, or half their length beyond one of its ends.
        """
        routes = self.routes
        if self._version != routes.version:
            self._version = routes.version
            self._way_out = routes.lengths + self._exit  # (W,) m
        return (
            routes.has_left(location)
            | (location.distance < -self._exit)
            | (location.distance > self._way_out.take(location.route))
        )

    def average(
        self,
        readings: Mapping[str, Array],
        command: Any,
        saturated: NDArray[np.bool_],
        robots: NDArray[np.bool_],
    ) -> None:
        """Add to the averages that the cause of a failure is read from, where a sample is due.

        Args:
            readings: of the sensors.
            command: that the robots carry out.
            saturated: (n, m) motors at their limit.
            robots: (n,) those that run.
        """
        due = robots & (self._looks % self._sample_every == 0)
        self._looks += robots
        if np.count_nonzero(due):
            self._diagnosis.average(readings, command, saturated, due)

    def cause(self, robot: int, location: Location, readings: Mapping[str, Array]) -> Outcome:
        """Return the cause for which a robot makes no headway."""
        retreat = None
        if self._retreat(robot, location) > self._slide_back:
            retreat = self._motion(robot, readings)
        cause = self._diagnosis.cause(robot, location, self.routes, retreat)
        return cause if self._tail is None else self._tail.cause(robot, cause)

    def _retreat(self, robot: int, location: Location) -> float:
        """Distance of a robot behind its farthest point, m."""
        return float(self._max_distance[robot] - location.distance[robot])

    def _motion(self, robot: int, readings: Mapping[str, Array]) -> Motion:
        return self._diagnosis.motion(robot, readings, float(self._cruise_speed[robot]))

    def lies_across(self, robot: int, location: Location) -> bool:
        """Return whether a robot lies across its pipe."""
        return self._diagnosis.lies_across(robot, location)

    def reason(
        self, robot: int, location: Location, goal: float, readings: Mapping[str, Array]
    ) -> str:
        """Describe the end of a robot's run: its location, and the measurements there.

        ``goal`` is where the leg at hand is over, m.
        """
        time, speed = readings["time"][robot], float(self._cruise_speed[robot])
        length = self.routes.lengths[location.route[robot]]
        distance = location.distance[robot]
        there, before = (", the goal,", "") if distance >= goal else ("", f", goal at {goal:.3f} m")
        retreat = self._retreat(robot, location)
        if retreat > self._slide_back:
            motion = self._motion(robot, readings)
            before += f", {motion.value} back by {1000 * retreat:.0f} mm"
            before += ", touching no wall" if motion is Motion.FALLING else ""
        tilt = np.degrees(location.tilt[robot])
        pulled = "" if self._tail is None else self._tail.words(robot)
        return (
            f"at {distance:.3f} m{there} of a route of {length:.3f} m{before}, after {time:.2f} s; "
            f"tilt {tilt:.1f} deg{self._diagnosis.words(robot, readings, speed)}{pulled}"
        )
