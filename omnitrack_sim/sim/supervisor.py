"""Supervision of n robots: locates them on their legs, asks their pilots, ends their runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.autonomy.pilots import Decision
from omnitrack_sim.base.rotations import Array, heading, set_rows, with_rows
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.events import Event, Note, Outcome
from omnitrack_sim.robots.control import MOMENTARY
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.monitor import Monitor, Verdict
from omnitrack_sim.sim.sensing import Senses


@dataclass(frozen=True)
class RightingSettings:
    """Lean from which on a robot whose pilot ``rights_itself`` does so, and does not drive on.

    Attributes:
        lean: rad, to the centreline: of eight explorations without a fall six had none beyond 30
            degrees, and one beyond 45, for 0.4 s.
        time: s, for which it leans by more, for D = 160 mm.
    """

    lean: float = math.radians(45)
    time: float = 0.5


RIGHTING = RightingSettings()


@dataclass(frozen=True)
class Ending:
    """Outcome of one robot's run, and the reason."""

    outcome: Outcome
    reason: str


def held_command(command: Any, held: Any, active: NDArray[np.bool_]) -> Any:
    """Return the command that n robots carry out: fields that it omits, and all fields of robots
    that are not ``active`` (n,), are kept from the command ``held`` so far.

    A field that holds for one period is None where it is left out.
    """
    nobody = np.zeros(len(active), bool)
    values: dict[str, Any] = {}
    all_active = np.count_nonzero(active) == len(active)
    for name, value, before in zip(command._fields, command, held, strict=True):
        if name in MOMENTARY:
            values[name] = nobody if value is None and name in ("resting", "over") else value
        elif value is None:
            values[name] = before
        elif all_active:
            # Copies: whoever made the command may write into its arrays again.
            values[name] = value.copy()
        else:
            # Robots whose run is over keep what they were asked last.
            rows = active.reshape(-1, *[1] * (value.ndim - 1))
            values[name] = np.where(rows, value, before)
    return type(command)(**values)


class Supervisor:
    """Supervises n robots; see ``judge``.

    Args:
        scenarios: of the robots; the list is the simulation's, which changes it.
        legs: that they drive.
        senses: of theirs.
        monitor: gives verdicts on them.

    Attributes:
        active: (n,) bool, robots whose run is not over.
        end_time: (n,) s.
        endings: how each robot's run ended; None while it runs.
        events: of each robot's run.
        location: true locations along their routes.
    """

    location: Location

    def __init__(
        self, scenarios: Sequence[Scenario], legs: Legs, senses: Senses, monitor: Monitor
    ) -> None:
        self._scenarios, self._legs, self._senses, self._monitor = scenarios, legs, senses, monitor
        n = len(scenarios)
        self.active, self.end_time = np.ones(n, bool), np.zeros(n)
        self.endings: list[Ending | None] = [None] * n
        self.events: list[list[Event]] = [[] for _ in scenarios]
        self._near, self._done = np.zeros(n), 0.0
        # Robots that right themselves; that have stood upright on the leg at hand; s since they
        # lean over.
        self._rights, self._upright = np.zeros((2, n), bool)
        self._leaning = np.zeros(n)

    def reset(
        self,
        rows: NDArray[np.intp],
        readings: Mapping[str, Array],
        notes: Sequence[Sequence[str]],
    ) -> None:
        """Begin the runs of robots ``rows`` (k,), with remarks ``notes`` (k,) on each; ``readings``
        are those of all n."""
        set_rows(self, rows, active=True, end_time=np.nan, _near=self._legs.near[rows])
        rights = [self._legs.pilots[row].rights_itself for row in rows.tolist()]
        set_rows(self, rows, _rights=rights, _upright=False, _leaning=0.0)
        for row, words in zip(rows.tolist(), notes, strict=True):
            self.endings[row] = None
            self.events[row] = [Note(row, 0.0, each) for each in words]
        self.locate(readings)

    def locate(self, readings: Mapping[str, Array]) -> None:
        """Locate the robots on their routes by ``readings``, and update their estimates."""
        self._readings, legs = readings, self._legs
        frames = heading(readings["rotation"], legs.gear)
        self.location = legs.routes.locate(readings["position"], frames, legs.route, self._near)
        # The next search starts from here: a route may pass the same pipe twice.
        self._near = self.location.distance
        self._senses.locate(self.location)
        legs.near = self._senses.location.distance

    def note(self, events: Iterable[Event]) -> None:
        """Keep events of the controller, of robots whose run is not over."""
        for event in events:
            if self.active[event.robot]:
                self.events[event.robot].append(event)

    def judge(
        self,
        robots: NDArray[np.bool_],
        command: Any,
        saturated: NDArray[np.bool_],
        diverged: NDArray[np.bool_],
        given_up: NDArray[np.bool_],
    ) -> None:
        """Judge the robots' states; start the next legs of some, and end the runs of others.

        Args:
            robots: (n,) those that are judged.
            command: that they carry out.
            saturated: (n, m) motors at their limit.
            diverged: (n,) robots whose physics has gone wrong.
            given_up: (n,) robots that have searched for their pose in vain.
        """
        # Averages first: the cause of a failure is read from them.
        self._monitor.average(self._readings, command, saturated, robots)
        # Before the verdicts: a look may lengthen the leg at whose end the robot seems to be.
        self._look_ahead(robots)
        location = self._senses.location
        arrived = location.distance >= self._legs.end
        verdicts = [
            *_verdicts(given_up & robots, Outcome.LOST),
            *self._monitor.look(
                self._readings, location, arrived, command.resting, diverged, robots
            ),
            *_verdicts(command.over & robots, Outcome.ENDED),
        ]
        if verdicts:
            self._dispatch(verdicts)
        righting = robots & self.active & self._rights
        if np.count_nonzero(righting):
            self._right(righting)
        # Last, and by the truth: who was sent on is judged on the new route.
        self._end_those_outside(robots)

    def _right(self, robots: NDArray[np.bool_]) -> None:
        """Have those of ``robots`` (n,) right themselves that were upright on the leg at hand and
        lean over: soon they would lie across, and be wedged."""
        tilt = self._senses.location.tilt
        self._upright = self._upright | (tilt < LEG_PLANNER.along)
        leans = robots & self._upright & (tilt > RIGHTING.lean)
        self._leaning = np.where(leans, self._leaning + self._monitor.period, 0.0)
        longest = RIGHTING.time * self._scenarios[0].robot.time_scale
        sent: list[int] = []
        for robot in np.flatnonzero(self._leaning > longest).tolist():
            self._leaning = with_rows(self._leaning, np.array([robot]), 0.0)
            decision = self._on_fall(robot)
            # It may lie so that it cannot tell which way round: it asks again.
            if decision.leg is not None:
                sent.append(robot)
                self._follow(robot, decision)
        self._locate_again(sent)

    def _on_fall(self, robot: int) -> Decision:
        """Return the decision of a robot's pilot where the robot lies off its route or across."""
        senses, time = self._senses, float(self._readings["time"][robot])
        position, rotation = (senses.readings[name][robot] for name in ("position", "rotation"))
        return self._legs.pilots[robot].on_fall(time, position, rotation[:, 2])

    def _end_those_outside(self, robots: NDArray[np.bool_]) -> None:
        """End the runs of robots whose true position is in no pipe, whatever their estimate."""
        outside = self._monitor.outside(self.location) & robots & self.active
        for robot in np.flatnonzero(outside).tolist() if np.count_nonzero(outside) else ():
            if not self._scenarios[robot].holds(*self._pose(robot)):
                self._end(robot, Outcome.LEFT_PIPE)

    def _pose(self, robot: int) -> tuple[Array, Array]:
        """The true position (3,) m of a robot and the direction (3,) of its nose, world frame."""
        return self._readings["position"][robot], self._readings["rotation"][robot, :, 2]

    def _dispatch(self, verdicts: Sequence[Verdict]) -> None:
        """Send robots that have arrived, hang, or have fallen off their route onto their next legs;
        end the runs of others."""
        sent: list[int] = []
        for robot, outcome in verdicts:
            # A robot may have several verdicts: the first one counts.
            if robot in sent or not self.active[robot]:
                continue
            decision = self._decision(robot, outcome)
            if decision is None:
                continue
            if decision.leg is not None:
                sent.append(robot)
                self._follow(robot, decision)
                continue
            self.events[robot] += decision.events
            self._end(robot, outcome or self._monitor.cause(robot, self.location))
        self._locate_again(sent)

    def _decision(self, robot: int, outcome: Outcome | None) -> Decision | None:
        """Return the decision of a robot's pilot on a verdict; None where the robot may not be
        where it takes itself to be, and looks for itself first."""
        pilot, senses = self._legs.pilots[robot], self._senses
        time = float(self._readings["time"][robot])
        if outcome is Outcome.LEFT_PIPE:
            decision = self._on_fall(robot)
            # One that explores, and has fallen too often, is where it takes itself to be: it has
            # been there.
            knows = decision.leg is not None or (pilot.belief is not None and decision.events)
            return decision if knows or not senses.doubt(robot) else None
        if outcome not in (None, Outcome.REACHED_GOAL):
            return Decision(None)
        scenario, (position, axis) = self._scenarios[robot], self._pose(robot)
        nose = position + scenario.robot.length / 2 * self._legs.gear[robot] * axis
        goal = scenario.goal_at(nose)
        distance = float(senses.location.distance[robot])
        if outcome is Outcome.REACHED_GOAL:
            return pilot.on_arrival(time, distance, goal)
        across = bool(senses.location.tilt[robot] > LEG_PLANNER.along)
        if pilot.rights_itself and across:
            # It lies across, which no other way helps: it is to right itself.
            decision = self._on_fall(robot)
            if decision.leg is not None:
                return decision
        # Belts that slip before an obstacle push an estimate into it.
        hangs_at = distance - 2 * float(senses.distance_std[robot])
        decision = pilot.on_blockage(time, hangs_at, goal)
        if decision.leg is None and pilot.rights_itself and not across:
            # It hangs on a leg that was planned for it as it lay before, such as across; or it is
            # elsewhere, where it takes itself to lie in no pipe.
            fallen = self._on_fall(robot)
            nowhere = fallen.leg is None and not fallen.events
            if nowhere and senses.doubt(robot):
                return None
            decision = decision if fallen.leg is None else fallen
        return decision

    def _look_ahead(self, robots: NDArray[np.bool_]) -> None:
        """Let those of ``robots`` (n,) look ahead that have reached their next viewpoint."""
        looking = (self._senses.location.distance >= self._legs.look_at) & robots
        if not np.count_nonzero(looking) or not self._senses.can_look:
            return
        rows = np.flatnonzero(looking).tolist()
        for robot in rows:
            pilot, distance = self._legs.pilots[robot], self._senses.location.distance[robot]
            look = self._senses.look(robot, pilot.looks_back(float(distance)))
            self._follow(robot, pilot.on_look(look))
        self._locate_again(rows)

    def _follow(self, robot: int, decision: Decision) -> None:
        """Carry out a pilot's decision for a robot, and extend its time limit accordingly."""
        length = self._legs.follow(robot, decision)
        if decision.shift:
            self._senses.shift(robot, decision.shift)
            self._monitor.moved(robot, decision.shift)
        self.events[robot] += decision.events
        scenario = self._scenarios[robot]
        if decision.goes_on:
            # The fixed part of the time was granted when the leg began.
            self._monitor.goes_on(robot, scenario.time_for(length) - scenario.time_for(0.0))
        else:
            self._upright = with_rows(self._upright, np.array([robot]), False)
            self._monitor.sent_on(robot, scenario.time_for(length))

    def _locate_again(self, robots: Sequence[int]) -> None:
        """Find robots on their routes that are on another one now."""
        if robots:
            self._senses.update_maps(robots)
            self._near = with_rows(self._near, np.array(robots), self._legs.near[robots])
            self.locate(self._readings)

    def _end(self, robot: int, outcome: Outcome) -> None:
        """End a robot's run."""
        time, location = float(self._readings["time"][robot]), self.location
        reason = self._monitor.reason(robot, location, float(self._legs.end[robot]), time)
        missed = self._legs.pilots[robot].missed
        error = float(self._senses.location.distance[robot] - location.distance[robot])
        if outcome is Outcome.REACHED_GOAL:
            # A robot that localises itself may take itself to be where it is not.
            if not self._scenarios[robot].is_done_at(*self._pose(robot), error):
                outcome, reason = Outcome.LOST, f"took itself to be at the goal; {reason}"
            elif missed:
                reason = f"no way to {', '.join(missed)} is left; {reason}"
                outcome = Outcome.STUCK
            elif self._monitor.lies_across(robot, location):
                outcome = Outcome.WEDGED
            else:
                outcome, reason = self._judged_map(robot, reason)
        elif outcome is Outcome.LEFT_PIPE:
            place = ", ".join(f"{x:.3f}" for x in self._readings["position"][robot])
            reason = f"left the pipe at ({place}) m, {location.offset[robot]:.3f} m off; {reason}"
        self.endings[robot] = Ending(outcome, reason)
        set_rows(self, np.array([robot]), active=False, end_time=time)

    def _judged_map(self, robot: int, reason: str) -> tuple[Outcome, str]:
        """Return outcome and reason of a robot at its goal, judged by its map; parts that it
        reports as unexplored may be missing."""
        left, network = self._legs.pilots[robot].left, self._legs.map(robot)
        exploration = self._scenarios[robot].exploration
        # Who searches for goals has no need of a whole map.
        if exploration is None or network is None or exploration.mission.task == "find":
            return Outcome.REACHED_GOAL, reason
        if left:
            reason = f"not explored: {left}; {reason}"
        difference = exploration.difference(network)
        if difference.same:
            return Outcome.REACHED_GOAL, reason
        right = difference.consistent and left
        return Outcome.REACHED_GOAL if right else Outcome.WRONG_MAP, f"{difference}; {reason}"

    def progress(self, phase: Sequence[str]) -> tuple[float, str]:
        """Return the part of all tasks that is done, 0 to 1, which never decreases, and time and
        place; ``phase`` is of each robot."""
        running, distance, legs = np.flatnonzero(self.active), self.location.distance, self._legs
        part = np.ones(len(self.active))
        part[running] = [legs.pilots[i].done_at(float(distance[i])) for i in running]
        # A detour makes the way longer, and a robot may slide back: progress then stands still.
        self._done = max(self._done, float(part.mean()))
        text = f"{len(running)} of {len(part)} running"
        if len(part) == 1:
            route = legs.routes.routes[legs.route[0]]
            passage = route.passages[route.index_at(float(distance[0]))]
            text = f"{phase[0]} in {passage.part.name}"
        return self._done, f"{self._readings['time'].max():.0f} s, {text}"


def _verdicts(flags: NDArray[np.bool_], outcome: Outcome) -> list[Verdict]:
    """Return a verdict on each robot of which ``flags`` (n,) is true."""
    return [Verdict(robot, outcome) for robot in np.flatnonzero(flags).tolist()]
