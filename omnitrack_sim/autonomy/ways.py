"""From start and goals to legs: which way, in which gear, from where to where.

Nothing here moves a robot.

A robot drives nose first from an open end to a goal. Where it has to turn back, at a goal with
another one to follow or where its way is blocked, it backs out the way it came, tail first, until
it stands before the tee where the new way leaves the old one, and goes on nose first. So arc
lengths on the part that two ways nose first share are equal. To a goal where its way began it backs
out all the way.

A robot that lies anywhere else in the network, because it fell off its way, or that has come to a
goal tail first, may go on either way round: nose first as above, or tail first as if its tail were
its nose. It takes the one that asks for less travel.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any, NamedTuple

from omnitrack_sim.autonomy.to_go import ToGo
from omnitrack_sim.autonomy.whereabouts import Whereabouts, whereabouts
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import ARCS, Arcs, Route
from omnitrack_sim.pipes.along import Along, Passed
from omnitrack_sim.pipes.layout import End
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import (
    Closed,
    Leg,
    Step,
    Way,
    port_graph,
    route_of,
    shortest_way,
    without,
)
from omnitrack_sim.robots.omnitrack import Robot

NOSE_ROOM = 0.005
"""Room between the robot's nose and the port of a goal when it arrives, m."""
ROUNDING = 1e-9
"""Difference of two lengths, m, that may come from rounding."""
AT_THE_NOSE = 0.02
"""How far behind the nose an obstacle may seem to be that stops a robot, m."""


class _Track(NamedTuple):
    """A way that a robot is on, up to the part that it is in.

    Attributes:
        way: the way. along: the same in numbers.
        gear: 1 nose first, -1 tail first.
        distance: m, arc length of the robot's centre.
    """

    way: Way
    along: Along
    gear: int
    distance: float


class _Onward(NamedTuple):
    """How a robot comes from its track to a goal.

    Attributes:
        travel: m, back and on. behind: how many parts behind the robot's one the ways part.
        way: from the beginning of the track to the goal.
        stand: m, arc length on both up to which the robot backs out first.
    """

    travel: float
    behind: int
    way: Way
    stand: float


class Ways:
    """Legs through a network, from wherever a robot is to one of several ends.

    Args:
        network: where.
        ends: ports (part index, port) of the start and of the goals. names: of the goals.
        robot: its length, and the room it needs before a fitting, decide where legs begin and end.
        arcs: of the centreline in tees.
        avoid: names of fittings that are not entered.
    """

    def __init__(
        self,
        network: Network,
        ends: Sequence[End],
        names: Sequence[str],
        robot: Robot,
        arcs: Arcs = ARCS,
        avoid: Collection[str] = (),
    ) -> None:
        self.network, self.ends, self.robot, self.arcs = network, list(ends), robot, arcs
        self._names = names
        self._graph = port_graph(network, arcs, avoid)
        self._known_passed: dict[tuple[int, str, str], Passed] = {}
        self._known_to_go: tuple[Any, ToGo] = None, ToGo(self._graph, ())

    def route(self, leg: Leg) -> Route:
        """The route of a leg: its way with the centreline."""
        return route_of(self.network, leg.way, self.arcs)

    def length(self, leg: Leg) -> float:
        """Length of the whole way of a leg, m."""
        return self.along_of(leg.way).length

    def obstacle(self, leg: Leg, distance: float) -> End:
        """The port (part index, port) that stops a robot at arc length ``distance`` m of a leg."""
        nose = distance + self.robot.length / 2 - AT_THE_NOSE
        part, _, leave = leg.way[self.along_of(leg.way).at(nose)]
        return part, leave

    def onward(
        self, leg: Leg, distance: float, goal: int, closed: Iterable[End | Step]
    ) -> list[Leg] | None:
        """Legs to a goal for a robot that is on a leg; None where no way is left.

        Args:
            leg: the robot is on it.
            distance: m, arc length of the robot's centre on that leg.
            goal: number of the goal.
            closed: what is not passed.
        """
        closed = tuple(closed)
        if leg.gear < 0:
            return self.anew(self.on(leg, distance), goal, closed)
        way = leg.way[: self.along_of(leg.way).at(distance) + 1]
        track = _Track(way, self.along_of(way), leg.gear, distance)
        if self.ends[goal + 1] == leg.way[0][:2]:
            return [self._backing(track, self.robot.length / 2 + NOSE_ROOM, goal)]
        found = self._turn_off(track, goal, closed)
        return None if found is None else self._legs(track, found, goal)

    def ahead(
        self, leg: Leg, distance: float, goal: int, closed: Iterable[End | Step]
    ) -> list[Leg] | None:
        """The leg to a goal that leads on from the end of the one at hand, without backing out;
        None where no way does, or where the robot has come too far to stand before what is new.
        Arguments as in ``onward``."""
        closed, (part, _, leave) = tuple(closed), leg.way[-1]
        beyond = self.network.joined_to.get(self.network.port_name((part, leave)))
        if beyond is None or (part, leave) in closed:
            return None
        onward = self._to_go(goal, closed).way(self.network.port(beyond))
        if onward is None:
            return None
        way, passed = (*leg.way, *onward), self.passed(*onward[0])
        stand = self.stand(self.along_of(way), len(leg.way), passed)
        if passed.asks_orientation and distance > stand + ROUNDING:
            return None
        return [self._forward(way, distance, goal, leg.gear)]

    def find(self, position: Array, axis: Array) -> Whereabouts | None:
        """Where in the network a robot lies with its centre at ``position`` (3,) m and its nose
        along the unit vector ``axis`` (3,), world frame; None where it lies in none of its
        pipes."""
        return whereabouts(self.network.pipes, position, axis, self.robot.length, self.arcs)

    def anew(self, where: Whereabouts, goal: int, closed: Iterable[End | Step]) -> list[Leg] | None:
        """Legs to a goal for a robot that lies anywhere in the network, in the gear that asks for
        less travel; None where there is no way.

        Args:
            where: it lies. goal: number of the goal. closed: what is not passed.
        """
        closed, found = tuple(closed), list[tuple[float, list[Leg]]]()
        first, tracks = (
            self._righted(where, closed) if where.across else ([], self._tracks(where, closed))
        )
        for track in tracks:
            way_on = self._turn_off(track, goal, closed)
            if way_on is not None:
                legs = [*first, *self._legs(track, way_on, goal)]
                found.append((round(way_on.travel, 6), legs))
        return min(found, key=lambda option: option[0], default=(0.0, None))[1]

    def _tracks(self, where: Whereabouts, closed: Closed) -> list[_Track]:
        """The ways, nose first and tail first, on which a robot that lies along its pipe may have
        come to where it is."""
        part, behind, ahead, passed, left, _ = where
        found = []
        for gear, enter, leave, inside in ((1, behind, ahead, passed), (-1, ahead, behind, left)):
            way = (*self._up_to((part, enter), closed), (part, enter, leave))
            along = self.along_of(way)
            found.append(_Track(way, along, gear, along.begins[-1] + inside))
        return found

    def _righted(self, where: Whereabouts, closed: Closed) -> tuple[list[Leg], list[_Track]]:
        """The leg on which a robot that lies across its pipe rights itself, and the ways that it is
        on then, as in ``_tracks``.

        Nothing turns it but the room where the branch opens. So it drives over the middle of its
        fitting, in the gear that points there, to where it can stand beyond.
        """
        part, behind, ahead, passed, left, _ = where
        gear = 1 if passed < left else -1
        enter, leave = (behind, ahead) if gear > 0 else (ahead, behind)
        up, beyond = (self._up_to((part, port), closed) for port in (enter, leave))
        way = (*up, (part, enter, leave), *((i, b, a) for i, a, b in beyond[::-1]))
        along = self.along_of(way)
        begin = along.begins[len(up)] + min(passed, left)
        half = self.robot.length / 2
        end = along.ends[len(up)] + half + self.robot.standing_room
        end = min(end, along.length - half)
        here = along.at(end)
        leg = Leg(way, gear, begin, end, -1, f"rights itself in {self.network.fittings[part].name}")
        track = _Track(way[: here + 1], self.along_of(way[: here + 1]), gear, end)
        return [leg], [track, *self._tracks(self.on(leg, end), closed)]

    def on(self, leg: Leg, distance: float) -> Whereabouts:
        """Where a robot lies at arc length ``distance`` m on a leg."""
        along = self.along_of(leg.way)
        here = along.at(distance)
        part, enter, leave = leg.way[here]
        passed, left = distance - along.begins[here], along.ends[here] - distance
        if leg.gear > 0:
            return Whereabouts(part, enter, leave, passed, left)
        return Whereabouts(part, leave, enter, left, passed)

    def _up_to(self, enter: End, closed: Closed) -> Way:
        """A way from the nearest open end up to a port by which a part is entered; none where the
        port is itself an open end, or where no way leads there from one."""
        port = self.network.joined_to.get(self.network.port_name(enter))
        if port is None:
            return ()
        ends = [self.network.port(end) for end in self.network.open_ends]
        out = ToGo(without(self._graph, closed), ends).way(self.network.port(port)) or ()
        return tuple((part, leave, enter) for part, enter, leave in out[::-1])

    def turn_in(self, leg: Leg, part: int) -> Way:
        """The turn into or out of a branch that a leg takes in a part, if there is one there."""
        fitting = self.network.pipes.parts[part].fitting
        return tuple(
            step
            for step in leg.way
            if step[0] == part and fitting.describe(*step[1:]).manoeuvre == "tee_turn"
        )

    def _legs(self, track: _Track, found: _Onward, goal: int) -> list[Leg]:
        """The leg to a goal, after one that backs out where that has to be."""
        forward = self._forward(found.way, found.stand, goal, track.gear)
        if found.stand >= track.distance - ROUNDING:
            return [forward]
        return [self._backing(track, found.stand), forward]

    def _turn_off(self, track: _Track, goal: int, closed: Closed) -> _Onward | None:
        """The way to a goal that asks for the least travel back and on; None where there is none.

        Args:
            track: where the robot is. It backs out no farther than to there.
            goal: number of the goal.
            closed: what is not passed.
        """
        old, along, _, distance = track
        to_go = self._to_go(goal, closed)
        best: _Onward | None = None
        for least, behind, index in self._turns(track, to_go):
            if best is not None and least > best.travel + ROUNDING:
                break
            onward = to_go.way(old[index][:2]) or self._around(old[index], goal, closed)
            if onward is None:
                continue
            way = (*old[:index], *onward)
            stand = min(distance, self.stand(along, index, self.passed(*onward[0])))
            cost = distance - stand + self.along_of(way).length - stand
            if best is None or (cost, behind) < best[:2]:
                best = _Onward(cost, behind, way, stand)
        return best

    def _turns(self, track: _Track, to_go: ToGo) -> list[tuple[float, int, int]]:
        """The fittings of a robot's way from which there is a way to the goal, those first that ask
        for little travel: the least travel back and on, m, how many fittings behind the robot's one
        it is, and its index."""
        old, along, _, distance = track
        found = []
        for index, (part, enter, _) in enumerate(old):
            travels = [
                distance
                - 2 * min(distance, self.stand(along, index, self.passed(part, enter, leave)))
                + along.begins[index]
                + length
                for (_, leave), length in to_go.options((part, enter))
            ]
            if travels:
                found.append((min(travels), len(old) - 1 - index, index))
        return sorted(found)

    def _around(self, step: tuple[int, str, str], goal: int, closed: Closed) -> Way | None:
        """The shortest way to a goal that comes to no port twice from the port that a part is
        entered by, where the robot cannot leave by it."""
        part, enter, _ = step
        if (part, enter) == self.ends[goal + 1]:
            return None  # the goal is behind the robot; it comes there in the other gear
        back = self.network.joined_to.get(f"{self.network.fittings[part].name}.{enter}")
        cut = [] if back is None else [((part, enter), self.network.port(back))]
        return self._shortest((part, enter), goal, closed, cut)

    def _shortest(
        self,
        start: End,
        goal: int,
        closed: Closed,
        cut: Collection[tuple[End, End]] = (),
    ) -> Way | None:
        import networkx

        graph = networkx.restricted_view(without(self._graph, closed), (), cut)
        return shortest_way(graph, start, self.ends[goal + 1])

    def _to_go(self, goal: int, closed: Closed) -> ToGo:
        key = self.ends[goal + 1], closed
        if self._known_to_go[0] != key:
            self._known_to_go = key, ToGo(without(self._graph, closed), [key[0]])
        return self._known_to_go[1]

    def passed(self, part: int, enter: str, leave: str) -> Passed:
        """A part as it is passed from one port to another."""
        key = part, enter, leave
        if key not in self._known_passed:
            fitting = self.network.pipes.parts[part].fitting
            self._known_passed[key] = Passed.of(fitting, enter, leave, self.arcs)
        return self._known_passed[key]

    def along_of(self, way: Way) -> Along:
        """A way in numbers."""
        return Along.of([self.passed(*step) for step in way])

    def stand(self, along: Along, index: int, other: Passed) -> float:
        """Arc length, m, where a robot stands to pass fitting ``index`` of a way another way."""
        return along.stand(index, other, self.robot.length, self.robot.standing_room)

    def _forward(self, way: Way, begin: float, goal: int, gear: int = 1) -> Leg:
        end = self.along_of(way).length - self.robot.length / 2 - NOSE_ROOM
        tail_first = "" if gear > 0 else ", tail first"
        return Leg(way, gear, begin, end, goal, f"to {self._names[goal]}{tail_first}")

    def _backing(self, track: _Track, stand: float, goal: int = -1) -> Leg:
        """The leg that backs out of a way, in the other gear.

        Args:
            track: where the robot is.
            stand: m, arc length on its way to back out to.
            goal: number of the goal that is there; -1 if there is none.
        """
        way, old, gear, distance = track
        reverse: Way = tuple((part, leave, enter) for part, enter, leave in way[::-1])
        here, at = len(way) - 1, old.at(stand)
        begin = old.ends[here] - distance
        # The arcs into and out of a branch differ in length, so lengths are counted from the port
        # that both ways share.
        end = self.along_of(reverse).ends[here - at] - (stand - old.begins[at])
        name = self.network.fittings[way[here][0]].name
        to = "" if goal < 0 else f", to {self._names[goal]}"
        goes = "backs" if gear > 0 else "drives"
        return Leg(reverse, -gear, begin, end, goal, f"{goes} out of {name}{to}")
