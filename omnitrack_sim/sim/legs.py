"""The legs that n robots drive: the one at hand, those to come, and new ones where the way is
blocked or a robot has fallen off it. The only place that puts robots onto legs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.ahead import Look
from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.autonomy.explorer import Decision
from omnitrack_sim.autonomy.mission import Planner
from omnitrack_sim.autonomy.ways import Ways
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.layout import End
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import Leg, Step
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.record.events import (
    Event,
    FellOff,
    GaveUp,
    GoalReached,
    LegBegan,
    TakenForClosed,
)
from omnitrack_sim.scenario import Scenario


class Onward(NamedTuple):
    """What a robot does next.

    Attributes:
        leg: its leg, or None where there is none. events: what there is to tell.
        goes_on: it is the leg at hand, made longer by ``more`` m.
        shift: m, how much farther along its way the robot is than it took itself to be.
    """

    leg: Leg | None
    events: Sequence[Event]
    goes_on: bool = False
    more: float = 0.0
    shift: float = 0.0


class Legs:
    """Legs of n robots. A robot in plain pipes has one leg, its route. The legs of one that
    explores lead through the pipes as it believes them to be.

    The arrays are replaced when they change, never written into: who keeps one keeps what was.

    Attributes:
        routes: of all legs so far.
        route: (n,) number in ``routes`` of each robot's route.
        number: (n,) legs done so far. gear: (n,) 1 nose first, -1 tail first.
        end: (n,) m, arc length along the way where the leg at hand is over.
        near: (n,) m, arc length where each robot was seen last, or where its leg begins.
        look_at: (n,) m, arc length where each robot looks ahead next; infinite where it does not.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self._planners = [scenario.planner for scenario in scenarios]
        self._explorations = [scenario.exploration for scenario in scenarios]
        self._explorers = [
            None if e is None else e.explorer(robot, scenarios[robot].monitor.falls)
            for robot, e in enumerate(self._explorations)
        ]
        self._driven: list[list[Leg]] = [[] if p is None else [p.first] for p in self._planners]
        self._to_come: list[list[Leg]] = [[] for _ in scenarios]
        self._closed: list[list[End]] = [[] for _ in scenarios]
        self._fallen_off: list[list[Step]] = [[] for _ in scenarios]
        self._falls_left = [scenario.monitor.falls for scenario in scenarios]
        self._route_numbers: dict[object, int] = {}
        routes, numbers = [], []
        for scenario, driven in zip(scenarios, self._driven, strict=True):
            key = driven[0].way if driven else None
            if key not in self._route_numbers:
                self._route_numbers[key] = len(routes)
                routes.append(scenario.route)
            numbers.append(self._route_numbers[key])
        n = len(scenarios)
        for robot, explorer in enumerate(self._explorers):
            if explorer is not None:
                self._driven[robot] = [explorer.leg]
                numbers[robot] = len(routes)
                routes.append(explorer.ways.route(explorer.leg))
        self.routes = RouteMap(routes)
        self.route: NDArray[np.intp] = np.array(numbers, np.intp)
        self.number = np.zeros(n, int)
        self.gear = np.ones(n, int)
        self.end: Array = np.array([s.goal_distance for s in scenarios])
        self.near: Array = np.array([s.start.distance for s in scenarios])
        self.look_at: Array = np.full(n, np.inf)
        for robot, explorer in enumerate(self._explorers):
            if explorer is not None:
                self.end[robot], self.look_at[robot] = explorer.leg.end, explorer.looks_at

    def restart(self, robots: NDArray[np.intp], scenarios: Sequence[Scenario]) -> None:
        """Put ``robots`` (k,) onto the first legs of ``scenarios`` (k), which do not explore."""
        self.route, self.number = self.route.copy(), self.number.copy()
        self.gear, self.end, self.near = self.gear.copy(), self.end.copy(), self.near.copy()
        for robot, scenario in zip(robots.tolist(), scenarios, strict=True):
            planner = self._planners[robot] = scenario.planner
            self._driven[robot] = [] if planner is None else [planner.first]
            self._to_come[robot], self._closed[robot], self._fallen_off[robot] = [], [], []
            self._falls_left[robot] = scenario.monitor.falls
            key = None if planner is None else planner.first.way
            if key not in self._route_numbers:
                self._route_numbers[key] = self.routes.add(scenario.route)
            self.route[robot], self.number[robot] = self._route_numbers[key], 0
            self.gear[robot], self.end[robot] = 1, scenario.goal_distance
            self.near[robot] = scenario.start.distance

    def seen_at(self, distance: Array) -> None:
        """Robots were seen at arc lengths ``distance`` (n,) m."""
        self.near = distance

    def send_on(
        self, robot: int, time: float, distance: float, arrived: bool, nose: Array
    ) -> Onward:
        """Put a robot onto the leg that follows, where there is one.

        Args:
            robot: index. time: s. distance: m, along its way.
            arrived: at the end of its leg; otherwise it makes no headway.
            nose: (3,) m, world frame, where its front in the gear at hand truly is.
        """
        planner, explorer = self._planners[robot], self._explorers[robot]
        exploration = self._explorations[robot]
        if explorer is not None and exploration is not None:
            here = exploration.goal_at(nose)
            comes = explorer.arrived if arrived else explorer.hangs
            return self._decided(robot, comes(time, distance, here))
        if planner is None:
            return Onward(None, ())
        leg = self._driven[robot][-1]
        if arrived:
            return self._put(robot, self._after(robot, planner, leg, time, distance))
        return self._put(robot, self._round(robot, planner, leg, time, distance))

    def see(self, robot: int, look: Look) -> Onward:
        """A robot that explores has looked ahead, and back where it ``looks_back``."""
        explorer = self._explorers[robot]
        assert explorer is not None
        return self._decided(robot, explorer.see(look))

    def looks_back(self, robot: int, distance: float) -> bool:
        """Whether a robot that explores looks both ways at arc length ``distance`` m."""
        explorer = self._explorers[robot]
        return explorer is not None and explorer.looks_back(distance)

    def _decided(self, robot: int, decision: Decision) -> Onward:
        """Put a robot that explores onto the leg that it has decided for."""
        explorer, before = self._explorers[robot], self._driven[robot][-1]
        assert explorer is not None
        self.look_at = _with(self.look_at, robot, explorer.looks_at)
        leg, goes_on, told, shift = decision
        if leg is None or leg == before:
            return Onward(leg, told, goes_on, shift=shift)
        route = explorer.ways.route(leg)
        more = route.centreline.length - float(self.routes.lengths[self.route[robot]])
        if goes_on:
            self._driven[robot][-1] = leg
        else:
            self._begin(robot, leg)
        self.end = _with(self.end, robot, leg.end)
        self.route = _with(self.route, robot, self.routes.add(route))
        return Onward(leg, told, goes_on, more, shift)

    def in_a_pipe(self, robot: int, position: Array, axis: Array) -> bool:
        """Whether a robot that truly is at ``position`` (3,) m with its nose along ``axis`` (3,),
        world frame, is in any pipe of its network, whatever its map; plain pipes are no
        network."""
        planner, exploration = self._planners[robot], self._explorations[robot]
        if exploration is not None:
            return exploration.holds(position)
        return planner is not None and planner.find(position, axis) is not None

    def belief(self, robot: int) -> Belief | None:
        """What a robot that explores takes its network to be; None for others."""
        explorer = self._explorers[robot]
        return None if explorer is None else explorer.belief

    def bore_ahead(self, robot: int) -> float:
        """What a robot that explores takes for the bore at the end of its way, m."""
        explorer = self._explorers[robot]
        assert explorer is not None
        part, _, leave = explorer.leg.way[-1]
        return 2 * explorer.belief.fitting(part).port_radius(leave)

    def _ways(self, robot: int) -> Ways | None:
        """Ways through a robot's network, or through what it believes to be one."""
        explorer = self._explorers[robot]
        return self._planners[robot] if explorer is None else explorer.ways

    def plan_anew(self, robot: int, time: float, position: Array, axis: Array) -> Onward:
        """Put a robot that is off its way onto a leg from where it lies, where that is in a pipe of
        its network and there is one.

        Args:
            robot: index. time: s.
            position: (3,) m, of its centre. axis: (3,) unit vector to its nose, world frame.
        """
        planner, explorer, ways = self._planners[robot], self._explorers[robot], self._ways(robot)
        where = None if ways is None else ways.find(position, axis)
        if where is not None and explorer is not None:
            return self._decided(robot, explorer.fell(time, where))
        if planner is None or where is None:
            return Onward(None, ())
        part = planner.network.fittings[where.part].name
        told = [FellOff(robot, time, part, planner.network.port_name((where.part, where.ahead)))]
        if self._falls_left[robot] == 0:
            return _given_up(robot, time, told, "has fallen too often")
        self._falls_left[robot] -= 1
        leg = self._driven[robot][-1]
        goal = next(leg.goal for leg in (leg, *self._to_come[robot]) if leg.goal >= 0)
        self._fallen_off[robot] += planner.turn_in(leg, where.part)
        legs = self._plan(robot, lambda closed: planner.anew(where, goal, closed))
        return self._put(robot, self._onto(robot, time, told, legs))

    def _after(
        self, robot: int, planner: Planner, leg: Leg, time: float, distance: float
    ) -> Onward:
        """What follows on a leg that has been driven to its end."""
        if self._to_come[robot]:
            return self._onto(robot, time, [], self._to_come[robot])
        if leg.goal + 1 == len(planner.mission.goals):
            return Onward(None, ())
        told = [GoalReached(robot, time, planner.mission.goals[leg.goal])]
        goal = leg.goal + 1
        legs = self._plan(robot, lambda closed: planner.onward(leg, distance, goal, closed))
        return self._onto(robot, time, told, legs)

    def _round(
        self, robot: int, planner: Planner, leg: Leg, time: float, distance: float
    ) -> Onward:
        """What follows on a leg on which a robot makes no headway."""
        if leg.goal < 0:
            return _given_up(robot, time, [], f"no headway as it {leg.note}")
        port = planner.obstacle(leg, distance)
        self._closed[robot].append(port)
        told = [TakenForClosed(robot, time, planner.network.port_name(port), distance)]
        legs = self._plan(robot, lambda closed: planner.onward(leg, distance, leg.goal, closed))
        return self._onto(robot, time, told, legs)

    def _plan(
        self, robot: int, plan: Callable[[Sequence[End | Step]], list[Leg] | None]
    ) -> list[Leg] | None:
        """Legs of ``plan`` for what is closed to a robot. A turn that it has fallen off it takes
        from the other side, and tries again only where there is no other way."""
        closed, fallen_off = self._closed[robot], self._fallen_off[robot]
        legs = plan([*closed, *fallen_off])
        return plan(closed) if legs is None and fallen_off else legs

    def _onto(
        self, robot: int, time: float, told: Sequence[Event], legs: Sequence[Leg] | None
    ) -> Onward:
        """The first of ``legs``, the others being kept for later; without legs the robot gives
        up."""
        if not legs:
            return _given_up(robot, time, told, "no other way")
        following, *self._to_come[robot] = legs
        return Onward(following, [*told, LegBegan(robot, time, following.note)])

    def _put(self, robot: int, onward: Onward) -> Onward:
        """Put a robot onto its next leg, where it has one."""
        leg = onward.leg
        if leg is not None:
            self._begin(robot, leg)
            self.end = _with(self.end, robot, leg.end)
            self.route = _with(self.route, robot, self._route_number(robot, leg))
        return onward

    def _begin(self, robot: int, leg: Leg) -> None:
        """A robot begins another leg."""
        self._driven[robot].append(leg)
        self.number = _with(self.number, robot, self.number[robot] + 1)
        self.gear = _with(self.gear, robot, leg.gear)
        self.near = _with(self.near, robot, leg.begin)

    def _route_number(self, robot: int, leg: Leg) -> int:
        """The number of a leg's route, added to the routes where it is a new one."""
        planner = self._planners[robot]
        assert planner is not None
        if leg.way not in self._route_numbers:
            self._route_numbers[leg.way] = self.routes.add(planner.route(leg))
        return self._route_numbers[leg.way]

    def missed(self, robot: int) -> tuple[str, ...]:
        """The goals of a robot's mission that its legs so far do not lead to; none in plain
        pipes."""
        planner, explorer = self._planners[robot], self._explorers[robot]
        if explorer is not None:
            return explorer.missed
        reached = [leg.goal for leg in self._driven[robot] if leg.goal >= 0]
        return () if planner is None else planner.mission.goals[reached[-1] + 1 :]

    def map(self, robot: int) -> Network | None:
        """The map that a robot has made; None for one that does not explore."""
        belief = self.belief(robot)
        return None if belief is None else belief.network

    def driven(self, robot: int) -> tuple[Leg, ...]:
        """The legs that a robot has begun."""
        return tuple(self._driven[robot])


def _given_up(robot: int, time: float, told: Sequence[Event], cause: str) -> Onward:
    return Onward(None, [*told, GaveUp(robot, time, cause)])


def _with(values: NDArray, robot: int, value: float) -> NDArray:
    """A copy with one robot's value changed."""
    changed = values.copy()
    changed[robot] = value
    return changed
