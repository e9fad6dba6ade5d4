"""A point that explores a network: it follows the legs of an explorer without physics."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from omnitrack_sim.autonomy.exploration import Exploration
from omnitrack_sim.autonomy.mission import Mission
from omnitrack_sim.autonomy.sight import Look, Sighting, TrueSight
from omnitrack_sim.base.rotations import TURNED, rotation_about
from omnitrack_sim.pipes import ARCS
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.record.events import Event
from omnitrack_sim.robots.omnitrack import Omnitrack

STEP = 0.005
"""Travel between two moments, m."""


class Ghost:
    """Explores a network from one of its open ends.

    Args:
        network: the true one. start: an open end, as ``Network.end`` takes it.
        goals: to find. seen, hidden: ports closed by plates that sight shows, and does not show.
        erring: changes what is seen.
        lag: m, by which it takes itself to be farther on when it has passed a fitting for the first
            time, until it is told better or begins another leg.
        slip: where on its first leg, m, its belts slip, and by how much.
        arms: it has some, and measures the bore with them.

    Attributes:
        sharp: names of the true parts in which it has come round by more than 100 degrees.
    """

    def __init__(
        self,
        network: Network,
        start: str,
        goals: Collection[str] = (),
        seen: Collection[str] = (),
        hidden: Collection[str] = (),
        erring: Callable[[Sighting], Sighting | None] = lambda ahead: ahead,
        lag: float = 0.0,
        slip: tuple[float, float] = (np.inf, 0.0),
        arms: bool = False,
    ) -> None:
        self.network, self.pipes, self.robot = network, network.pipes, Omnitrack()
        mission = Mission(
            start=start,
            map="unknown",
            task="find" if goals else "explore",
            goals=tuple(goals),
            blocked=tuple(seen),
        )
        exploration = Exploration(network, mission, self.robot, 0.1, ARCS)
        self.hidden = [network.port(port) for port in hidden]
        self.sight = TrueSight(network.pipes, exploration.plates, self.robot, ARCS)
        self.erring, self.lag, self.slip, self.arms = erring, lag, slip, arms
        self.explorer = exploration.explorer(0, 2)
        self.ends = {goal: network.end("goals", goal) for goal in goals}
        self.events: list[Event] = []
        self.legs, self.travel, self.most_shift = 1, 0.0, 0.0
        self.sharp: set[str] = set()
        self.behind: set[int] = set()
        self._line: Any = None

    def run(self, most: float = 60.0) -> None:
        """Drive until the run is over, or ``most`` m."""
        explorer, distance = self.explorer, float(self.explorer.leg.begin)
        wrong = 0.0
        # By a plate, or by what a test has put in the place of plates.
        hangs = bool(self.hidden) or "_blocked" in vars(self)
        while self.travel < most:
            wrong += self.lag * self._has_passed(distance)
            if distance >= self.slip[0]:
                wrong, self.slip = wrong + self.slip[1], (np.inf, 0.0)
            time, decision, told = self.travel, None, distance + wrong
            looks, arrives = told >= explorer.looks_at, told >= explorer.leg.end
            if looks or arrives or hangs:
                position, frame = self._pose(distance)
            if looks:
                ahead, behind = self._look(position, frame), None
                if explorer.looks_back(told):
                    behind = self._look(position, frame * TURNED)
                look = Look(time, told, ahead, behind, frame)
                if self.arms:
                    reach = float(self.pipes.signed_distance(position[None])[0][0])
                    look = look._replace(bore=2 * reach)
                decision = explorer.on_look(look)
                wrong += decision.shift
                self.most_shift = max(self.most_shift, abs(decision.shift))
            elif arrives:
                decision = explorer.on_arrival(time, told, self._here(position, frame))
            elif hangs and self._blocked(position, frame):
                decision = explorer.on_blockage(time, told, self._here(position, frame))
            if decision is None:
                self._note_turn(distance)
                distance, self.travel = distance + STEP, self.travel + STEP
                continue
            self.events += decision.events
            if decision.leg is None:
                return
            if not decision.goes_on:
                self.legs, distance, wrong = self.legs + 1, decision.leg.begin, 0.0
        raise AssertionError(f"it still drives after {most} m: {self.events[-5:]}")

    def _note_turn(self, distance: float) -> None:
        """Note the fitting that it is in, if it turns sharply there."""
        route = self.explorer.route()
        here = route.passages[route.index_at(distance)]
        if here.part.fitting.describe(here.enter, here.leave).turn_angle > np.radians(100):
            self.sharp.add(here.part.name)

    def _has_passed(self, distance: float) -> int:
        """How many fittings it has just left behind for the first time."""
        route = self.explorer.route()
        new = {
            passage.index
            for passage in route.passages
            if passage.s_leave < distance and not passage.part.fitting.is_plain
        } - self.behind
        self.behind |= new
        return len(new)

    def _look(self, position, frame) -> Sighting | None:
        ahead = self.sight.look(0, position, frame)
        return None if ahead is None else self.erring(ahead)

    def _pose(self, distance: float):
        leg, planner = self.explorer.leg, self.explorer.planner
        if self._line is None or self._line[:2] != (leg, planner):
            self._line = leg, planner, planner.route(leg.path).centreline
        line = self._line[2]
        s = np.array([distance])
        # Turned about its axis by what it has driven: nothing may depend on how it is turned.
        frame = line.frame(s)[0] @ rotation_about([0, 0, 1], 2.0 * self.travel)
        return line.at(s)[0][0], frame

    def _at(self, port, position, frame) -> bool:
        """Whether the nose is at a port, from either side."""
        pose = self.pipes.parts[port[0]].port(port[1])
        offset = position + self.robot.length / 2 * frame[:, 2] - pose.position
        along = float(frame[:, 2] @ pose.rotation[:, 2])
        return float(np.linalg.norm(offset)) < 0.03 and abs(along) > 0.8

    def _blocked(self, position, frame) -> bool:
        return any(self._at(port, position, frame) for port in self.hidden)

    def _here(self, position, frame) -> str:
        found = [goal for goal, port in self.ends.items() if self._at(port, position, frame)]
        return found[0] if found else ""
