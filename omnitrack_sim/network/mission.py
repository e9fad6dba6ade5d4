"""From start and goals to legs: which way, in which gear, from where to where.

Nothing here moves a robot.

A robot drives nose first from an open end to a goal. Where it has to turn back, at a goal with
another one to follow or where its way is blocked, it backs out the way it came, tail first, until
it stands before the tee where the new way leaves the old one, and goes on nose first. So every way
nose first begins at the mission's start, and arc lengths on the part that two of them share are
equal. To a goal that is the mission's start it backs out all the way.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field

from omnitrack_sim.bounds import MOST_GOALS, MOST_PARTS
from omnitrack_sim.errors import Fault, NetworkError
from omnitrack_sim.network.along import Along, Passed
from omnitrack_sim.network.layout import End
from omnitrack_sim.network.planning import Way, port_graph, route_of, shortest_way, unreachable
from omnitrack_sim.network.spec import Network
from omnitrack_sim.network.to_go import ToGo
from omnitrack_sim.pipes import ARCS, Arcs, Route
from omnitrack_sim.robot import Robot
from omnitrack_sim.table import Table

NOSE_ROOM = 0.005
"""Room between the robot's nose and the port of a goal when it arrives, m."""
ROUNDING = 1e-9
"""Difference of two travels, m, that may come from rounding."""
AT_THE_NOSE = 0.02
"""How far behind the nose an obstacle may seem to be that stops a robot, m."""


class Mission(Table):
    """Where to go in a network."""

    start: str  # open end
    # open ends, in order
    goals: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_GOALS)]
    # fittings that are not entered
    avoid: Annotated[tuple[str, ...], Field(max_length=MOST_PARTS)] = ()
    # ports closed by a plate that the robot does not know of
    blocked: Annotated[tuple[str, ...], Field(max_length=MOST_PARTS)] = ()


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
        self._known_passed: dict[tuple[int, str, str], Passed] = {}
        self._known_to_go: tuple[Any, ToGo] = None, ToGo(self._graph, self.ends[0], ())
        way = shortest_way(self._graph, self.ends[0], self.ends[1])
        if way is None:
            raise NetworkError(_unreachable(0, mission))
        self.first = self._forward(way, distance, 0)
        self._planned = [self.first]

    def route(self, leg: Leg) -> Route:
        """The route of a leg: its way with the centreline."""
        return route_of(self.network, leg.way, self.arcs)

    def length(self, leg: Leg) -> float:
        """Length of the whole way of a leg, m."""
        return self._along(leg.way).length

    def plan(self) -> tuple[Leg, ...]:
        """The legs to all goals if nothing is in the way.

        Raises:
            NetworkError: a goal cannot be reached from the one before it.
        """
        for goal in range(self._planned[-1].goal + 1, len(self.mission.goals)):
            legs = self.onward(self._planned[-1], self._planned[-1].end, goal, ())
            if legs is None:
                raise NetworkError(_unreachable(goal, self.mission))
            self._planned += legs
        return tuple(self._planned)

    def obstacle(self, leg: Leg, distance: float) -> End:
        """The port (part index, port) that stops a robot at arc length ``distance`` m of a leg."""
        nose = distance + self.robot.length / 2 - AT_THE_NOSE
        part, _, leave = leg.way[self._along(leg.way).at(nose)]
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
        closed = tuple(closed)
        at_the_start = self.robot.length / 2 + NOSE_ROOM
        if leg.gear < 0:
            way = self._shortest(self.ends[0], goal, closed)
            return None if way is None else [self._forward(way, at_the_start, goal)]
        old = self._along(leg.way)
        here = old.at(distance)
        if self.ends[goal + 1] == self.ends[0]:
            return [self._backing(old, leg.way, here, distance, at_the_start, goal)]
        found = self._turn_off(old, leg.way[: here + 1], distance, goal, closed)
        if found is None:
            return None
        way, stand = found
        forward = self._forward(way, stand, goal)
        if stand >= distance:
            return [forward]
        return [self._backing(old, leg.way, here, distance, stand), forward]

    def _turn_off(
        self, along: Along, old: Way, distance: float, goal: int, closed: tuple[End, ...]
    ) -> tuple[Way, float] | None:
        """The way to a goal, nose first, that asks for the least travel back and on.

        Args:
            along: the way that the robot is on, in numbers.
            old: that way up to the fitting that the robot is in, at arc length ``distance`` m.
            goal: number of the goal.
            closed: ports (part index, port) found to be closed.

        Returns:
            The new way, and the arc length in m up to which the robot has to back out, at most
            ``distance``; None where there is no way.
        """
        to_go = self._to_go(goal, closed)
        best: tuple[float, int, Way, float] | None = None
        for least, behind, index in self._turns(along, old, distance, to_go):
            if best is not None and least > best[0] + ROUNDING:
                break
            onward = to_go.way(old[index][:2]) or self._around(old[index], goal, closed)
            if onward is None:
                continue
            way = (*old[:index], *onward)
            stand = min(distance, self._stand(along, index, self._passed(*onward[0])))
            cost = distance - stand + self._along(way).length - stand
            if best is None or (cost, behind) < best[:2]:
                best = (cost, behind, way, stand)
        return None if best is None else best[2:]

    def _turns(
        self, along: Along, old: Way, distance: float, to_go: ToGo
    ) -> list[tuple[float, int, int]]:
        """The fittings of the way ``old`` from which there is a way to the goal, those first that
        ask for little travel: the least travel back and on, m, how many fittings behind the
        robot's one it is, and its index."""
        found = []
        for index, (part, enter, _) in enumerate(old):
            travels = [
                distance
                - 2 * min(distance, self._stand(along, index, self._passed(part, enter, leave)))
                + along.begins[index]
                + length
                for (_, leave), length in to_go.options((part, enter))
            ]
            if travels:
                found.append((min(travels), len(old) - 1 - index, index))
        return sorted(found)

    def _around(self, step: tuple[int, str, str], goal: int, closed: tuple[End, ...]) -> Way | None:
        """The shortest way to a goal that comes to no port twice from the port that a part is
        entered by, where the robot cannot leave by it."""
        part, enter, _ = step
        back = self.network.joined_to.get(f"{self.network.fittings[part].name}.{enter}")
        cut = [] if back is None else [((part, enter), self.network.port(back))]
        return self._shortest((part, enter), goal, closed, cut)

    def _shortest(
        self,
        start: End,
        goal: int,
        closed: Collection[End],
        cut: Collection[tuple[End, End]] = (),
    ) -> Way | None:
        import networkx

        graph = networkx.restricted_view(self._graph, closed, cut)
        return shortest_way(graph, start, self.ends[goal + 1])

    def _to_go(self, goal: int, closed: tuple[End, ...]) -> ToGo:
        key = self.ends[goal + 1], closed
        if self._known_to_go[0] != key:
            self._known_to_go = key, ToGo(self._graph, *key)
        return self._known_to_go[1]

    def _passed(self, part: int, enter: str, leave: str) -> Passed:
        key = part, enter, leave
        if key not in self._known_passed:
            fitting = self.network.pipes.parts[part].fitting
            self._known_passed[key] = Passed.of(fitting, enter, leave, self.arcs)
        return self._known_passed[key]

    def _along(self, way: Way) -> Along:
        return Along.of([self._passed(*step) for step in way])

    def _stand(self, along: Along, index: int, other: Passed) -> float:
        return along.stand(index, other, self.robot.length, self.robot.standing_room)

    def _forward(self, way: Way, begin: float, goal: int) -> Leg:
        end = self._along(way).length - self.robot.length / 2 - NOSE_ROOM
        return Leg(way, 1, begin, end, goal, f"to {self.mission.goals[goal]}")

    def _backing(
        self, old: Along, way: Way, here: int, distance: float, stand: float, goal: int = -1
    ) -> Leg:
        """The leg that backs out of a way.

        Args:
            old: the way in numbers.
            way: the way.
            here: index of the part that the robot is in.
            distance: m, arc length on it where the robot is.
            stand: m, arc length on it to back out to.
            goal: number of the goal that is there; -1 if there is none.
        """
        reverse: Way = tuple((part, leave, enter) for part, enter, leave in way[here::-1])
        at = old.at(stand)
        begin = old.ends[here] - distance
        # The arcs into and out of a branch differ in length, so lengths are counted from the port
        # that both ways share.
        end = self._along(reverse).ends[here - at] - (stand - old.begins[at])
        name = self.network.fittings[way[here][0]].name
        to = "" if goal < 0 else f", to {self.mission.goals[goal]}"
        return Leg(reverse, -1, begin, end, goal, f"backs out of {name}{to}")


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
    names = dict.fromkeys(part.name for part in network.fittings)
    faults += [
        Fault(f"avoid.{i}", f"there is no fitting {name!r}", tuple(names), given=name)
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
