"""Verdicts on when a run is over, and why. The supervisor acts on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario.tables import MonitorTable
from omnitrack_sim.sim.tail_load import TailLoad


class Verdict(NamedTuple):
    """Judgement of one robot: an outcome, or None where it makes no headway."""

    robot: int
    outcome: Outcome | None


class Monitor:
    """Watches n robots.

    Args:
        routes: of the robots.
        robot: its length is a unit of the limits, and it finds causes of failures.
        limits: see ``[monitor]`` in docs/reference/scenarios.md.
        start: (n,) m, arc lengths where they begin.
        cruise_speed: (n,) m/s.
        time_limit: (n,) s.
        period: s, between two looks.
        sample_every: looks between two samples of the averages.
        tail: pulls at the robots; None: nothing does.
    """

    def __init__(
        self,
        routes: RouteMap,
        robot: Robot,
        limits: MonitorTable,
        start: Array,
        cruise_speed: Array,
        time_limit: Array,
        period: float,
        sample_every: int,
        tail: TailLoad | None = None,
    ):
        n = len(start)
        self.routes, self.limits, self.period, self._tail = routes, limits, period, tail
        self._sample_every = sample_every
        self._diagnosis = robot.diagnosis(limits, period * sample_every, n)
        self._progress, self._slide_back, self._patience_length = (
            float(robot.own_length(length))
            for length in (limits.progress, limits.slide_back, limits.patience)
        )
        self._scale = robot.time_scale
        self._exit = robot.length / 2
        # s of patience, s since the last progress, s, m
        self._patience, self._waiting, self._time_limit, self._farthest = np.zeros((4, n))
        self._looks = np.zeros(n, int)
        self._version = -1
        self.reset(np.arange(n), start, cruise_speed, time_limit)

    def reset(
        self, rows: NDArray[np.intp], start: Array, cruise_speed: Array, time_limit: Array
    ) -> None:
        """Watch robots ``rows`` (k,) from the start of a new run; arguments (k,) as of the
        monitor."""
        patience = self._patience_length / cruise_speed
        self._patience[rows] = np.maximum(self.limits.patience_time * self._scale, patience)
        # Times are sums of steps: 1e-9 s keeps their rounding from adding a step.
        self._time_limit[rows], self._farthest[rows] = time_limit - 1e-9, start
        self._waiting[rows], self._looks[rows] = 0.0, 0
        self._diagnosis.reset(rows)

    def sent_on(self, robot: int, seconds: float) -> None:
        """Reset the headway of a robot that drives another leg, and extend its time limit."""
        # Arc length begins elsewhere on another leg: any value is headway.
        self._farthest[robot], self._waiting[robot] = -np.inf, 0.0
        self.goes_on(robot, seconds)

    def moved(self, robot: int, shift: float) -> None:
        """Take note that the estimate of a robot has been moved by ``shift`` m along its leg: where
        it has been farthest moves with it."""
        self._farthest[robot] += shift

    def goes_on(self, robot: int, seconds: float) -> None:
        """Extend the time limit of a robot whose leg is longer than was known."""
        self._time_limit[robot] += seconds

    def look(
        self,
        readings: Mapping[str, Array],
        location: Location,
        arrived: NDArray[np.bool_],
        resting: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
        robots: NDArray[np.bool_],
    ) -> list[Verdict]:
        """Judge one control step; verdicts in the order in which they count.

        Args:
            readings: of the sensors.
            location: of the robots.
            arrived: (n,) robots that are at the end of the leg at hand, or take themselves to be.
            resting: (n,) robots that stand still or drive backward on purpose.
            diverged: (n,) robots whose physics has gone wrong.
            robots: (n,) those that are judged; nothing changes for the others.
        """
        distance = location.distance
        # Headway counts anew from where a robot rests or has backed off to.
        headway = (distance > self._farthest + self._progress) | resting
        self._farthest = np.where(headway & robots, distance, self._farthest)
        waiting = (self._waiting + self.period) * ~headway
        self._waiting = np.where(robots, waiting, self._waiting)
        hanging = (self._waiting > self._patience) | (distance < self._farthest - self._slide_back)
        judgements = (
            (diverged, Outcome.DIVERGED),
            (arrived, Outcome.REACHED_GOAL),
            (self.outside(location), Outcome.LEFT_PIPE),
            (hanging, None),
            (readings["time"] >= self._time_limit, Outcome.TIMED_OUT),
        )
        return [
            Verdict(robot, outcome)
            for flags, outcome in judgements
            if np.count_nonzero(flags)
            for robot in np.flatnonzero(flags & robots).tolist()
        ]

    def outside(self, location: Location) -> NDArray[np.bool_]:
        """Return the robots (n,) that have left their route."""
        routes = self.routes
        if self._version != routes.version:
            self._version = routes.version
            # In the middle of a tee the arc of a turn is up to a bore's radius from where the robot
            # may well be.
            in_turn = routes.is_tee_turn
            self._room = routes.radius * np.where(in_turn, self.limits.tee_room, 1.0)  # (Q,) m
            self._way_out = routes.lengths + self._exit  # (W,) m
        return (
            (location.offset > self._room.take(location.passage))
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

    def cause(self, robot: int, location: Location) -> Outcome:
        """Return the cause for which a robot makes no headway."""
        cause = self._diagnosis.cause(robot, location, self.routes)
        return cause if self._tail is None else self._tail.cause(robot, cause)

    def lies_across(self, robot: int, location: Location) -> bool:
        """Return whether a robot lies across its pipe."""
        return self._diagnosis.lies_across(robot, location)

    def reason(self, robot: int, location: Location, goal: float, time: float) -> str:
        """Describe the end of a robot's run: its location, and the measurements there.

        ``goal`` is where the leg at hand is over, m, and ``time`` how long the run took, s.
        """
        length = self.routes.lengths[location.route[robot]]
        distance = location.distance[robot]
        there, before = (", the goal,", "") if distance >= goal else ("", f", goal at {goal:.3f} m")
        slid = self._farthest[robot] - distance
        if slid > self._slide_back:
            before += f", slid back by {1000 * slid:.0f} mm"
        tilt = np.degrees(location.tilt[robot])
        pulled = "" if self._tail is None else self._tail.words(robot)
        return (
            f"at {distance:.3f} m{there} of a route of {length:.3f} m{before}, after {time:.2f} s; "
            f"tilt {tilt:.1f} deg{self._diagnosis.words(robot, time)}{pulled}"
        )
