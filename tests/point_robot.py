"""Explorations without physics: a point that drives the legs of an explorer through a network."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from omnitrack_sim.autonomy.exploration import Exploration
from omnitrack_sim.autonomy.mission import Mission
from omnitrack_sim.autonomy.sight import Look, Sighting, TrueSight
from omnitrack_sim.base.rotations import TURNED, Array, rotation_about
from omnitrack_sim.pipes import ARCS, Port
from omnitrack_sim.pipes.network import Network, both_ways
from omnitrack_sim.record.events import Event
from omnitrack_sim.robots.omnitrack import Omnitrack

STEP = 0.005
"""Travel between two moments, m."""
START = 0.1
"""From the open end where it begins to its centre, m."""
MAX_DECISIONS = 100
"""Most decisions of an explorer at one place."""
SHARP = np.radians(100)
"""Turn from which on ``PointRobot.sharp`` names a part, rad."""


class Errors:
    """Errors of a robot's senses: none."""

    std = 0.0
    """Standard deviation of the arc length that the robot states, m."""

    def seen(self, sighting: Sighting, robot: PointRobot) -> Sighting | None:
        """Return what a camera of a robot makes of a true sighting."""
        return sighting

    def frame(self, frame: Array) -> Array:
        """Return the estimate of a true frame (3, 3)."""
        return frame

    def slip(self, travel: float, robot: PointRobot) -> float:
        """Return by how much ``travel`` m of a robot by odometry is off, m."""
        return 0.0

    def passed(self, turn: float, new: bool) -> float:
        """Return the error of the arc length that a passage adds which turns by ``turn`` rad, m.

        ``new``: it is a fitting that is passed for the first time.
        """
        return 0.0

    def bore(self, bore: float) -> float:
        """Return a true bore as the arms measure it, m."""
        return bore

    def falls(self, robot: PointRobot) -> bool:
        """Return whether a robot falls in the fitting that it has come into."""
        return False


class PointRobot:
    """Explores a network from one of its open ends.

    It moves along the true network, through the ports to which its leg on the map leads, and its
    arc length on the leg is odometry, which looks correct.

    Args:
        network: the true one.
        start: an open end, as ``Network.end`` takes it.
        goals: to find.
        seen: ports closed by plates that sight shows.
        hidden: ports closed by plates that sight does not show.
        arms: it has some, and measures the bore with them.
        errors: of its senses.
        falls: see ``Explorer``.

    Attributes:
        sharp: names of the true parts in which it has come round by more than 100 degrees.
        looking_back: what is seen now lies behind it.
        max_shift: m, greatest correction of its arc length.
    """

    def __init__(
        self,
        network: Network,
        start: str,
        goals: Collection[str] = (),
        seen: Collection[str] = (),
        hidden: Collection[str] = (),
        arms: bool = False,
        errors: Errors | None = None,
        falls: int = 2,
    ) -> None:
        self.network, self.pipes, self.robot = network, network.pipes, Omnitrack()
        mission = Mission(
            start=start,
            map="unknown",
            task="find" if goals else "explore",
            goals=tuple(goals),
            blocked=tuple(seen),
        )
        exploration = Exploration(network, mission, self.robot, START, ARCS)
        self.hidden = [network.port(port) for port in hidden]
        self.sight = TrueSight(network.pipes, exploration.plates, self.robot, ARCS)
        self.arms, self.errors = arms, errors or Errors()
        self.explorer = exploration.explorer(0, falls)
        self.ends = {goal: network.end("goals", goal) for goal in goals}
        self.events: list[Event] = []
        self.legs, self.travel, self.max_shift = 1, 0.0, 0.0
        self.sharp: set[str] = set()
        self.looking_back = False
        self.told = float(self.explorer.leg.begin)
        self._joined = both_ways(network.pipes.joints)
        self._gear = self.explorer.leg.gear
        self._passed: set[int] = set()
        part, enter = exploration.ends[0]
        (leave,) = (port for port in self.pipes.parts[part].fitting.port_names if port != enter)
        self._lie(part, enter, leave, START)

    # Where it is

    def _lie(self, part: int, enter: str, leave: str, since: float) -> None:
        self.part, self.enter, self.leave, self.since = part, enter, leave, since
        self._axis = self.pipes.parts[part].axis(enter, leave, ARCS)

    def pose(self) -> tuple[Array, Array]:
        """Return the true position (3,) m of its centre, and its frame (3, 3) in its gear."""
        s = np.array([self.since])
        # Turned about its axis by what it has driven: nothing may depend on how it is turned.
        frame = self._axis.frame(s)[0] @ rotation_about([0, 0, 1], 2.0 * self.travel)
        return self._axis.at(s)[0][0], frame

    def fall(self, time: float) -> Any:
        """Return the explorer's decision where it lies off its route, at its own estimate."""
        line = self.explorer.route().centreline
        s = np.array([min(self.told, self.explorer.route().length)])
        axis = line.frame(s)[0][:, 2] * self.explorer.leg.gear
        return self.explorer.on_fall(time, line.at(s)[0][0], axis)

    @property
    def left(self) -> float:
        """Travel to the port by which it leaves its part, m."""
        return self._axis.length - self.since

    @property
    def is_behind_fitting(self) -> bool:
        """Whether it has come into its part out of a fitting that is no plain pipe."""
        end = self._joined.get((self.part, self.enter))
        return end is not None and not self.pipes.parts[end[0]].fitting.is_plain

    def _advance(self) -> None:
        """Drive a step, no farther than the leg leads, and through a port where it comes to one."""
        step = min(STEP, self.explorer.leg.end - self.told)
        self.told += step + self.errors.slip(step, self)
        self.travel += step
        self.since += step
        if self._axis.length < self.since:
            end = self._joined.get((self.part, self.leave))
            if end is None:
                self.since = self._axis.length
                return
            self.told += self._left()
            self._enter(end, self.since - self._axis.length)

    def _left(self) -> float:
        """Return the error that the part adds which it leaves, m."""
        fitting = self.pipes.parts[self.part].fitting
        new = not fitting.is_plain and self.part not in self._passed
        self._passed.add(self.part)
        turn = fitting.describe(self.enter, self.leave).turn_angle
        return self.errors.passed(turn, new)

    def _enter(self, end: Port, since: float) -> None:
        """Come into a part by a port, on the way on which the leg leads."""
        part, enter = end
        ports = [port for port in self.pipes.parts[part].fitting.port_names if port != enter]
        leave = max(ports, key=lambda port: self._agreement(part, enter, port, self.told - since))
        self._lie(part, enter, leave, since)

    def _agreement(self, part: int, enter: str, leave: str, begin: float) -> float:
        """Return how well a way through a true part agrees in direction with the leg from arc
        length ``begin`` m on."""
        route, axis = self.explorer.route(), self.pipes.parts[part].axis(enter, leave, ARCS)
        s = np.linspace(0.0, axis.length, 9)
        on_map = route.centreline.frame(np.clip(begin + s, 0.0, route.length))
        return float((axis.frame(s)[..., 2] * on_map[..., 2]).sum(axis=-1).mean())

    def _follow(self) -> None:
        """Begin another leg from where it is."""
        leg = self.explorer.leg
        self.legs, self.told = self.legs + 1, leg.begin
        enter, leave, since = self.enter, self.leave, self.since
        if leg.gear != self._gear:
            self._gear = leg.gear
            enter, leave, since = leave, enter, self._axis.length - since
        self._lie(self.part, enter, leave, since)
        self._enter((self.part, enter), since)

    # Driving

    def run(self, most: float = 60.0) -> None:
        """Drive until the run is over, or ``most`` m."""
        explorer, entered = self.explorer, self.part
        # By a plate, or by what a test has put in the place of plates.
        hangs = bool(self.hidden) or "_blocked" in vars(self)
        stands, decisions = 0.0, 0
        while self.travel < most:
            decisions = decisions + 1 if self.travel == stands else 0
            stands = self.travel
            assert decisions < MAX_DECISIONS, f"it decides without end: {self.events[-5:]}"
            time, told, decision = self.travel, self.told, None
            looks, arrives = told >= explorer.looks_at, told > explorer.leg.end - 1e-9
            if looks or arrives or hangs:
                position, frame = self.pose()
            if entered != self.part and self.errors.falls(self):
                decision = self.fall(time)
            elif looks:
                decision = explorer.on_look(self._look(time, position, frame))
                self.told += decision.shift
                self.max_shift = max(self.max_shift, abs(decision.shift))
            elif arrives:
                decision = explorer.on_arrival(time, told, self._here(position, frame))
            elif hangs and self._blocked(position, frame):
                decision = explorer.on_blockage(time, told, self._here(position, frame))
            entered = self.part
            if decision is None:
                self._note_turn()
                self._advance()
                continue
            assert all((event.robot, event.time) == (0, time) for event in decision.events)
            self.events += decision.events
            if decision.leg is None:
                return
            if not decision.same_leg:
                self._follow()
        raise AssertionError(f"it still drives after {most} m: {self.events[-5:]}")

    def _look(self, time: float, position: Array, frame: Array) -> Look:
        ahead, behind = self._seen(position, frame), None
        if self.explorer.looks_back(self.told):
            self.looking_back = True
            behind = self._seen(position, frame * TURNED)
            self.looking_back = False
        look = Look(time, self.told, ahead, behind, self.errors.frame(frame), std=self.errors.std)
        if not self.arms:
            return look
        reach = float(self.pipes.signed_distance(position[None])[0][0])
        return look._replace(bore=self.errors.bore(2 * reach))

    def _seen(self, position: Array, frame: Array) -> Sighting | None:
        sighting = self.sight.look(0, position, frame)
        return None if sighting is None else self.errors.seen(sighting, self)

    def _note_turn(self) -> None:
        """Note the fitting that it is in, if it turns sharply there."""
        part = self.pipes.parts[self.part]
        if part.fitting.describe(self.enter, self.leave).turn_angle > SHARP:
            self.sharp.add(part.name)

    def _at(self, port: Port, position: Array, frame: Array) -> bool:
        """Return whether the nose is at a port, from either side."""
        pose = self.pipes.parts[port[0]].port(port[1])
        offset = position + self.robot.length / 2 * frame[:, 2] - pose.position
        along = float(frame[:, 2] @ pose.rotation[:, 2])
        return float(np.linalg.norm(offset)) < 0.03 and abs(along) > 0.8

    def _blocked(self, position: Array, frame: Array) -> bool:
        return any(self._at(port, position, frame) for port in self.hidden)

    def _here(self, position: Array, frame: Array) -> str:
        found = [goal for goal, port in self.ends.items() if self._at(port, position, frame)]
        return found[0] if found else ""
