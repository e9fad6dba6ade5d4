"""From start and goals to legs: which way, in which gear, from where to where.

Nothing here moves a robot.

A robot drives nose first from an open end to a goal. Where it has to turn back, at a goal with
another one to follow or where its way is blocked, it backs out the way it came, tail first, until
it stands before the tee where the new way leaves the old one, and goes on nose first. So every way
nose first begins at the mission's start, and arc lengths on the part that two of them share are
equal. To a goal that is the mission's start it backs out all the way.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from omnitrack_sim.errors import Fault, NetworkError
from omnitrack_sim.network.layout import End
from omnitrack_sim.network.planning import Way, port_graph, route_of, shortest_way, unreachable
from omnitrack_sim.network.spec import Network
from omnitrack_sim.pipes import ARCS, Arcs, Route
from omnitrack_sim.robot import Robot
from omnitrack_sim.table import Table

NOSE_ROOM = 0.005
"""Room between the robot's nose and the port of a goal when it arrives, m."""
AT_THE_NOSE = 0.02
"""How far behind the nose an obstacle may seem to be that stops a robot, m."""


class Mission(Table):
    """Where to go in a network."""

    start: str  # open end
    goals: Annotated[tuple[str, ...], Field(min_length=1)]  # open ends, in order
    avoid: tuple[str, ...] = ()  # fittings that are not entered
    blocked: tuple[str, ...] = ()  # ports closed by a plate that the robot does not know of


@dataclass(frozen=True)
class Leg:
    """A way in one gear.

    Attributes:
        way: (part index, port entered, port left) of the parts in order.
        gear: 1 nose first, -1 tail first.
        begin, end: m, arc length of the robot's centre along the way where the leg begins and ends.
        goal: number of the goal that is reached at its end; -1 if the robot only backs out.
        note: what is done, as text.
    """

    way: Way
    gear: int
    begin: float
    end: float
    goal: int
    note: str


class Planner:
    """Plans the legs of one mission.

    Args:
        network: where.
        mission: start and goals.
        robot: its length, and the room it needs before a fitting, decide where legs begin and end.
        distance: m along the way from the start port to the robot's centre as it begins.
        arcs: of the centreline in tees.

    Attributes:
        ends: ports (part index, port) of start and goals.
        plates: ports closed by a plate.

    Raises:
        NetworkError: no such port or fitting, no open end, or a goal that cannot be reached;
            ``start``, ``goals.0``, ``avoid.0`` or ``blocked.0`` say which.
    """

    def __init__(
        self,
        network: Network,
        mission: Mission,
        robot: Robot,
        distance: float,
        arcs: Arcs = ARCS,
    ) -> None:
        self.network, self.mission, self.robot, self.arcs = network, mission, robot, arcs
        self.ends, self.plates = _checked(network, mission)
        self._graph = port_graph(network, arcs, mission.avoid)
        way = shortest_way(self._graph, self.ends[0], self.ends[1])
        if way is None:
            raise NetworkError(_unreachable(0, mission))
        self.first = self._forward(way, distance, 0)

    def route(self, leg: Leg) -> Route:
        """The route of a leg: its way with the centreline."""
        return route_of(self.network, leg.way, self.arcs)

    def plan(self) -> tuple[Leg, ...]:
        """The legs to all goals if nothing is in the way.

        Raises:
            NetworkError: a goal cannot be reached from the one before it.
        """
        planned = [self.first]
        for goal in range(1, len(self.mission.goals)):
            legs = self.onward(planned[-1], planned[-1].end, goal, ())
            if legs is None:
                raise NetworkError(_unreachable(goal, self.mission))
            planned += legs
        return tuple(planned)

    def obstacle(self, leg: Leg, distance: float) -> End:
        """The port (part index, port) that stops a robot at arc length ``distance`` m of a leg."""
        nose = distance + self.robot.length / 2 - AT_THE_NOSE
        fittings = self.route(leg).fittings
        index = next((i for i, p in enumerate(fittings) if nose < p.s_leave), len(fittings) - 1)
        part, _, leave = leg.way[index]
        return part, leave

    def onward(
        self, leg: Leg, distance: float, goal: int, closed: Iterable[End]
    ) -> list[Leg] | None:
        """Legs to a goal for a robot that is on a leg; None where no way is left.

        The robot comes back to the mission's start tail first. From there it sets out anew.

        Args:
            leg: the robot is on it, nose first; or tail first at its end, which is the mission's
                start.
            distance: m, arc length of the robot's centre on that leg.
            goal: number of the goal.
            closed: ports (part index, port) found to be closed.
        """
        import networkx

        closed = tuple(closed)
        graph = networkx.restricted_view(self._graph, closed, [])
        at_the_start = self.robot.length / 2 + NOSE_ROOM
        if leg.gear < 0:
            way = shortest_way(graph, self.ends[0], self.ends[goal + 1])
            return None if way is None else [self._forward(way, at_the_start, goal)]
        old = self.route(leg)
        here = next(
            (i for i, p in enumerate(old.fittings) if distance < p.s_leave), len(leg.way) - 1
        )
        if self.ends[goal + 1] == self.ends[0]:
            return [self._backing(old, leg.way, here, distance, at_the_start, goal)]
        found = self._turn_off(leg.way[: here + 1], distance, goal, closed)
        if found is None:
            return None
        way, stand = found
        forward = self._forward(way, stand, goal)
        if stand >= distance:
            return [forward]
        return [self._backing(old, leg.way, here, distance, stand), forward]

    def _turn_off(
        self, old: Way, distance: float, goal: int, closed: tuple[End, ...]
    ) -> tuple[Way, float] | None:
        """The way to a goal, nose first, that asks for the least travel back and on.

        Args:
            old: the way up to the fitting that the robot is in, at arc length ``distance`` m.
            goal: number of the goal.
            closed: ports (part index, port) found to be closed.

        Returns:
            The new way, and the arc length in m up to which the robot has to back out, at most
            ``distance``; None where there is no way.
        """
        import networkx

        best: tuple[float, Way, float] | None = None
        for index in range(len(old) - 1, -1, -1):
            part, enter, _ = old[index]
            # Nose first, the robot cannot leave through the port that it came in by.
            back = self.network.joined_to.get(f"{self.network.fittings[part].name}.{enter}")
            cut = [] if back is None else [((part, enter), self.network.port(back))]
            graph = networkx.restricted_view(self._graph, closed, cut)
            onward = shortest_way(graph, (part, enter), self.ends[goal + 1])
            if onward is None:
                continue
            way = (*old[:index], *onward)
            new = route_of(self.network, way, self.arcs)
            stand = min(distance, self._stand(new, index))
            cost = distance - stand + new.centreline.length - stand
            if best is None or cost < best[0]:
                best = (cost, way, stand)
        return None if best is None else best[1:]

    def _forward(self, way: Way, begin: float, goal: int) -> Leg:
        length = route_of(self.network, way, self.arcs).centreline.length
        return Leg(
            way,
            1,
            begin,
            length - self.robot.length / 2 - NOSE_ROOM,
            goal,
            f"to {self.mission.goals[goal]}",
        )

    def _backing(
        self, old: Route, way: Way, here: int, distance: float, stand: float, goal: int = -1
    ) -> Leg:
        """The leg that backs out of a way.

        Args:
            old: route of the way.
            way: the way.
            here: index of the part that the robot is in.
            distance: m, arc length on it where the robot is.
            stand: m, arc length on it to back out to.
            goal: number of the goal that is there; -1 if there is none.
        """
        reverse: Way = tuple((part, leave, enter) for part, enter, leave in way[here::-1])
        route = route_of(self.network, reverse, self.arcs)
        at = next(i for i, p in enumerate(old.fittings) if stand < p.s_leave)
        begin = old.fittings[here].s_leave - distance
        # The arcs into and out of a branch differ in length, so lengths are counted from the port
        # that both ways share.
        end = route.fittings[here - at].s_leave - (stand - old.fittings[at].s_enter)
        name = self.network.fittings[way[here][0]].name
        to = "" if goal < 0 else f", to {self.mission.goals[goal]}"
        return Leg(reverse, -1, begin, end, goal, f"backs out of {name}{to}")

    def _stand(self, route: Route, index: int) -> float:
        """Arc length, m, where a robot stands to pass fitting ``index`` of a route another way."""
        first, length, room = index, self.robot.length, self.robot.standing_room
        while first > 0 and _start(route, first) - _end(route, first - 1) < length + room:
            first -= 1
        return max(_start(route, first) - length / 2 - room, length / 2)


def _start(route: Route, index: int) -> float:
    """Arc length, m, where a fitting's bend or opening begins; its end if it has neither."""
    passage = route.fittings[index]
    return passage.span[0] if passage.asks_orientation else passage.s_leave


def _end(route: Route, index: int) -> float:
    """Arc length, m, where the last bend or opening up to fitting ``index`` ends."""
    return next((p.span[1] for p in route.fittings[index::-1] if p.asks_orientation), -float("inf"))


def _unreachable(goal: int, mission: Mission) -> Fault:
    before = mission.goals[goal - 1] if goal else mission.start
    return unreachable(f"goals.{goal}", before, mission.goals[goal], mission.avoid)


def _checked(network: Network, mission: Mission) -> tuple[list[End], tuple[End, ...]]:
    """Ports of start and goals, and ports closed by a plate."""
    ends, plates, faults = [], [], []
    asked = [
        ("start", mission.start),
        *((f"goals.{i}", goal) for i, goal in enumerate(mission.goals)),
    ]
    for where, port in asked:
        try:
            ends.append(network.end(where, port))
            if len(ends) > 1 and ends[-1] == ends[-2]:
                faults.append(Fault(where, f"{port!r} is where the robot is already"))
        except NetworkError as error:
            faults += error.faults
    names = tuple(part.name for part in network.fittings)
    faults += [
        Fault(f"avoid.{i}", f"there is no fitting {name!r}", names, given=name)
        for i, name in enumerate(mission.avoid)
        if name not in names
    ]
    for i, port in enumerate(mission.blocked):
        try:
            plates.append(network.port(port, f"blocked.{i}"))
        except NetworkError as error:
            faults += error.faults
    if faults:
        raise NetworkError(faults)
    return ends, tuple(plates)
