"""Plan legs through a network: which path, in which gear, from where to where.

Nothing here moves a robot.

A robot drives nose first from an open end to a goal. Where it has to turn back, at a goal with
another one to follow or where its way is blocked, it backs out the way it came, tail first, until
it stands before the tee where the new path leaves the old one, and goes on nose first. So arc
lengths on the part that two paths nose first share are equal. To a goal where its path began it
backs out all the way.

A robot that lies anywhere else in the network, because it fell off its route, or that has come to a
goal tail first, may go on either way round: nose first as above, or tail first as if its tail were
its nose. It takes the one that asks for less travel.

Robots that explore avoid sharp turns, in which they often fall: they drive past the fitting and
reverse into the port instead, where there is room (``gentler``).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array, dot, length
from omnitrack_sim.pipes import ARCS, Arcs, Fitting, Part, Passage, Port, Route
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import (
    Closed,
    Leg,
    PathsToGoals,
    port_graph,
    shortest_path,
    without,
)
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class LegPlannerSettings:
    """Rooms and tolerances of planning legs.

    Attributes:
        rounding: m, difference of two lengths that may come from rounding.
        at_nose: m, for D = 160 mm, behind the nose up to which an obstacle may seem to be that
            stops a robot.
        along: rad, angle between a robot and the axis of its pipe up to which it lies along the
            pipe; beyond it the robot lies across.
        across: rad, angle beyond which it is not known which way round the robot lies.
        beside: bore radii, largest distance of the centre of a robot that lies in a pipe from the
            pipe's axis.
        sharp: rad, turn in a fitting from which on a robot falls about every second time, such as
            that from a wye's branch back along its run.
        detour: m, travel that a robot prefers to a sharp turn, or to one that it has no room to
            stand and roll before.
        reversals: most reversals by which it goes round sharp turns on its way to a goal.
    """

    rounding: float = 1e-9
    at_nose: float = 0.02
    along: float = math.radians(30)
    across: float = math.radians(80)
    beside: float = 0.5
    sharp: float = math.radians(100)
    detour: float = 20.0
    reversals: int = 2


LEG_PLANNER = LegPlannerSettings()


class PartLocation(NamedTuple):
    """Location of a robot in a part of a network, between two of its ports.

    Attributes:
        part: index of the part that the robot's centre is in.
        behind: port that its tail points to.
        ahead: port that its nose points to.
        to_behind: m, arc length from the robot's centre to the port behind.
        to_ahead: m, arc length to the port ahead.
        across: it lies across the pipe rather than along it.
    """

    part: int
    behind: str
    ahead: str
    to_behind: float
    to_ahead: float
    across: bool = False


class LegPlanner:
    """Plans legs through a network, from wherever a robot is to one of several goals.

    Args:
        network: where.
        ends: ports (part index, port) of the start and of the goals.
        names: of the goals.
        robot: its length, and the room it needs before a fitting, decide where legs begin and end.
        arcs: of the centreline in tees.
        avoid: names of fittings that are not entered.
    """

    def __init__(
        self,
        network: Network,
        ends: Sequence[Port],
        names: Sequence[str],
        robot: Robot,
        arcs: Arcs = ARCS,
        avoid: Collection[str] = (),
    ) -> None:
        self.network, self.ends, self.robot, self.arcs = network, list(ends), robot, arcs
        self._names = names
        self._graph = port_graph(network, arcs, avoid)
        # Planning compares many paths through the same parts, and asks for one goal many times.
        self._passages: dict[Edge, Passage] = {}
        self._latest: tuple[tuple[Edge, ...], Route] | None = None
        self._paths: tuple[object, PathsToGoals] = None, PathsToGoals(self._graph, ())

    def route(self, path: Iterable[Edge]) -> Route:
        """Return the route along a path; its centreline is laid when it is first asked for."""
        path = tuple(path)
        # A robot that explores asks for the route of its leg in every step.
        if self._latest is None or self._latest[0] != path:
            self._latest = path, Route.of(self.network.pipes, map(self._passage, path))
        return self._latest[1]

    def _passage(self, edge: Edge) -> Passage:
        if edge not in self._passages:
            self._passages[edge] = Passage.of(self.network.pipes, edge, self.arcs)
        return self._passages[edge]

    def obstacle(self, leg: Leg, distance: float) -> Port:
        """Return the port that stops a robot at arc length ``distance`` m of a leg."""
        nose = distance + self.robot.length / 2 - float(self.robot.own_length(LEG_PLANNER.at_nose))
        part, _, leave = leg.path[self.route(leg.path).index_at(nose)]
        return part, leave

    def turn_in(self, leg: Leg, part: int) -> tuple[Edge, ...]:
        """Return the turn into or out of a branch that a leg takes in a part, if there is one."""
        fitting = self.network.pipes.parts[part].fitting
        return tuple(
            edge
            for edge in leg.path
            if edge[0] == part and fitting.describe(*edge[1:]).manoeuvre == "tee_turn"
        )

    def locate(self, position: Array, axis: Array) -> PartLocation | None:
        """Locate a robot from its pose alone, whatever leg it was sent on.

        Args:
            position: (3,) m, of the robot's centre, world frame.
            axis: (3,) unit vector to its nose, world frame.

        Returns:
            None where its nose, centre or tail is out of all bores, beyond an open end, or where it
            lies across a fitting and along none of its axes.
        """
        pipes = self.network.pipes
        points = position + self.robot.length / 2 * np.array([[-1.0], [0.0], [1.0]]) * axis
        if pipes.signed_distance(points)[0].min() <= 0:
            return None
        centre = position[None]
        options = [
            option
            for index, part in enumerate(pipes.parts)
            if part.holds(centre, 0.0)
            for option in _locations(index, part, centre, axis[None], self.arcs)
        ]
        # Where it lies straight in a run, it is not about to turn.
        return min(options, key=lambda option: option[0], default=(0.0, None))[1]

    def location(self, leg: Leg, distance: float) -> PartLocation:
        """Return the location of a robot at arc length ``distance`` m on a leg."""
        route = self.route(leg.path)
        here = route.passages[route.index_at(distance)]
        since, rest = distance - here.s_enter, here.s_leave - distance
        if leg.gear > 0:
            return PartLocation(here.index, here.enter, here.leave, since, rest)
        return PartLocation(here.index, here.leave, here.enter, rest, since)

    def extend(
        self, leg: Leg, distance: float, goal: int, closed: Iterable[Port | Edge]
    ) -> list[Leg] | None:
        """Plan the leg to a goal that leads on from the end of ``leg`` without backing out.

        Returns:
            None where no path leads on, or where the robot, at arc length ``distance`` m, has come
            too far to stand before the first fitting that is new. Arguments as in ``replan``.
        """
        closed, (part, _, leave) = tuple(closed), leg.path[-1]
        beyond = self.network.joined_to.get(self.network.port_name((part, leave)))
        if beyond is None or (part, leave) in closed:
            return None
        onward = self._paths_to(goal, closed).path(self.network.port(beyond))
        if onward is None:
            return None
        path = (*leg.path, *onward)
        if distance > self.latest_stand(path, len(leg.path)):
            return None
        return [self.leg_to(goal, path, distance, leg.gear)]

    def replan(
        self, leg: Leg, distance: float, goal: int, closed: Iterable[Port | Edge]
    ) -> list[Leg] | None:
        """Plan the legs to a goal for a robot on a leg; None where no path is left.

        Args:
            leg: the robot is on it.
            distance: m, arc length of the robot's centre on that leg.
            goal: number of the goal.
            closed: ports and edges that are not passed.
        """
        closed = tuple(closed)
        driven = self._driven(leg, distance)
        if leg.gear < 0:
            return self.replan_from(self.location(leg, distance), goal, closed, driven.path)
        if self.ends[goal + 1] == leg.path[0][:2]:
            return [self._back_out(driven, self.robot.length / 2 + self.robot.nose_room, goal)]
        plan = self._turn_off(driven, goal, closed)
        return None if plan is None else plan[1]

    def replan_from(
        self,
        location: PartLocation,
        goal: int,
        closed: Iterable[Port | Edge],
        driven: Collection[Edge] = (),
    ) -> list[Leg] | None:
        """Plan the legs to a goal for a robot anywhere in the network.

        In the gear that asks for less travel; None where there is no path.

        Args:
            location: of the robot.
            goal: number of the goal.
            closed: ports and edges that are not passed.
            driven: passages by which the robot is known to have come: the way back through them
                needs no preparation.
        """
        closed = tuple(closed)
        first, up_to = list[Leg](), list[Leg]()
        if location.across:
            realign = self._realign(location, closed)
            first, up_to = [realign], [self._driven(realign, realign.end)]
            location = self.location(realign, realign.end)
        up_to += self._legs_up_to(location, closed)
        plans = [plan for leg in up_to if (plan := self._turn_off(leg, goal, closed))]

        def cost(plan: tuple[float, list[Leg]]) -> float:
            # Sums that differ by rounding alone count as equal: then the earlier one is taken.
            travel, legs = plan
            return round(travel, 6) + LEG_PLANNER.detour * self._unprepared(legs[0], driven)

        best = min(plans, key=cost, default=None)
        return None if best is None else [*first, *best[1]]

    def _unprepared(self, leg: Leg, driven: Collection[Edge]) -> int:
        """Return the number of turns on a leg that leave no room to stand and roll before them.

        It begins too close to them. Turns back through passages that it has ``driven`` do not
        count.
        """
        route = self.route(leg.path)
        nose = leg.begin + self.robot.length / 2
        return sum(
            here.manoeuvre == "tee_turn"
            and nose < here.span[0] < leg.end + self.robot.length / 2
            and leg.begin > self.latest_stand(leg.path, index)
            and (part, leave, enter) not in driven
            for index, ((part, enter, leave), here) in enumerate(
                zip(leg.path, route.passages, strict=True)
            )
        )

    def _driven(self, leg: Leg, distance: float) -> Leg:
        """A leg up to arc length ``distance`` m, without the passages ahead."""
        last = self.route(leg.path).index_at(distance)
        return replace(leg, path=leg.path[: last + 1], end=distance)

    def _legs_up_to(self, location: PartLocation, closed: Closed) -> Iterator[Leg]:
        """Yield the legs on which a robot that lies along its pipe may have come to where it is.

        Nose first and tail first.
        """
        part, behind, ahead, to_behind, to_ahead, _ = location
        for gear, enter, leave, inside in (
            (1, behind, ahead, to_behind),
            (-1, ahead, behind, to_ahead),
        ):
            path = (*self._path_up_to((part, enter), closed), (part, enter, leave))
            distance = self.route(path).passages[-1].s_enter + inside
            yield Leg(path, gear, distance, distance)

    def _realign(self, location: PartLocation, closed: Closed) -> Leg:
        """Plan the leg that realigns a robot lying across its pipe.

        Nothing turns it but the room where the branch opens. So it drives over the middle of its
        fitting, in the gear that points there, to where it can stand beyond.
        """
        part, behind, ahead, to_behind, to_ahead, _ = location
        gear = 1 if to_behind < to_ahead else -1
        enter, leave = (behind, ahead) if gear > 0 else (ahead, behind)
        before = self._path_up_to((part, enter), closed)
        begin = self.route((*before, (part, enter, leave))).passages[-1].s_enter
        name = self.network.fittings[part].name
        return self._leg_over(
            before,
            (part, enter, leave),
            closed,
            gear,
            begin + min(to_behind, to_ahead),
            f"rights itself in {name}",
        )

    def _leg_over(
        self,
        before: tuple[Edge, ...],
        edge: Edge,
        closed: Closed,
        gear: int,
        begin: float,
        note: str,
    ) -> Leg:
        """Plan the leg that drives over a fitting to where the robot can stand beyond.

        It begins at arc length ``begin`` m, and ends where the pipe does if that is too short.
        """
        part, _, leave = edge
        beyond = self._path_up_to((part, leave), closed)
        path = (*before, edge, *((i, b, a) for i, a, b in beyond[::-1]))
        route, half = self.route(path), self.robot.length / 2
        end = route.passages[len(before)].s_leave + half + self.robot.standing_room
        return Leg(path, gear, begin, min(end, route.length - half), -1, note)

    def reverse_beyond(self, leg: Leg, index: int, closed: Closed) -> Leg | None:
        """Plan the leg past a turn to where the robot can reverse and take it from there.

        The turn is passage ``index`` of ``leg``; the robot drives on by the third port of its
        fitting. None where there is no such port, or no room for the robot beyond it.
        """
        part, enter, leave = leg.path[index]
        ports = self.network.pipes.parts[part].fitting.port_names
        if leg.begin > self.route(leg.path).passages[index].s_enter:
            return None
        for port in (port for port in ports if port not in (enter, leave)):
            note = f"passes {self.network.fittings[part].name} to reverse"
            edge = part, enter, port
            over = self._leg_over(leg.path[:index], edge, closed, leg.gear, leg.begin, note)
            tail = over.end - self.robot.length / 2
            if tail >= self.route(over.path[: index + 1]).length:
                return over
        return None

    def once_more(self, leg: Leg, distance: float) -> list[Leg]:
        """Plan the legs of a robot that hangs at arc length ``distance`` where the way is free.

        In m. It backs off to where it stands clear before the fitting that its nose is in, and
        comes again; none where it has begun too close to that.
        """
        route, half = self.route(leg.path), self.robot.length / 2
        index = route.index_at(distance + half)
        stand = min(self._stand(route, index, leg.path[index]), distance - half)
        stand = max(stand, leg.begin)
        if distance - stand < self.robot.standing_room:
            return []
        back = self._back_out(self._driven(leg, distance), stand)
        return [back, replace(leg, begin=stand)]

    def gentler(
        self, legs: list[Leg], location: PartLocation, goal: int, closed: Closed
    ) -> list[Leg]:
        """Replace legs to a goal by others without sharp turns, if there are any.

        Args:
            legs: planned from ``location``; returned where they have no sharp turn, or where there
                are no others.
            location: of the robot.
            goal: number of the goal.
            closed: ports and edges that are not passed.
        """
        if not self.sharp_turns(legs):
            return legs
        return self._without_sharp_turns(location, goal, closed, LEG_PLANNER.reversals) or legs

    def _without_sharp_turns(
        self, location: PartLocation, goal: int, closed: Closed, reversals: int
    ) -> list[Leg] | None:
        """Plan legs to a goal without sharp turns.

        With at most ``reversals`` legs on which the robot drives past a fitting to reverse; None
        where there are none.
        """
        legs = self.replan_from(location, goal, (*closed, *self._sharp_edges()))
        sharp = legs or self.replan_from(location, goal, closed)
        if legs or not sharp or not reversals:
            return legs
        number, index = self.sharp_turns(sharp)[0]
        over = self.reverse_beyond(sharp[number], index, closed)
        if over is None:
            return None
        there = self.location(over, over.end)
        rest = self._without_sharp_turns(there, goal, closed, reversals - 1)
        return rest and [*sharp[:number], over, *rest]

    def _sharp_edges(self) -> list[Edge]:
        """Return the sharp turns of all fittings with more than two ports."""
        return [
            (i, enter, leave)
            for i, part in enumerate(self.network.pipes.parts)
            if len(part.fitting.port_names) > 2
            for enter, leave in permutations(part.fitting.port_names, 2)
            if is_sharp(part.fitting, enter, leave)
        ]

    def sharp_turns(self, legs: Sequence[Leg]) -> list[tuple[int, int]]:
        """Return the sharp turns on legs.

        Each by the numbers of its leg and of its passage on that.
        """
        return [
            (number, index)
            for number, leg in enumerate(legs)
            for index, here in enumerate(self.route(leg.path).passages)
            if is_sharp(here.part.fitting, here.enter, here.leave)
            and here.s_leave > leg.begin
            and here.s_enter < leg.end
        ]

    def cost(self, legs: Sequence[Leg]) -> float:
        """Return the travel on legs, m, plus ``detour`` for each sharp turn."""
        return travel(legs) + LEG_PLANNER.detour * len(self.sharp_turns(legs))

    def _path_up_to(self, enter: Port, closed: Closed) -> tuple[Edge, ...]:
        """Return the path from the nearest open end up to a port by which a part is entered.

        Empty where the port is itself an open end, or where no path leads there from one.
        """
        port = self.network.joined_to.get(self.network.port_name(enter))
        if port is None:
            return ()
        ends = [self.network.port(end) for end in self.network.open_ends]
        paths = PathsToGoals(without(self._graph, closed), ends)
        out = paths.path(self.network.port(port)) or ()
        return tuple((part, leave, enter) for part, enter, leave in out[::-1])

    def _turn_off(self, leg: Leg, goal: int, closed: Closed) -> tuple[float, list[Leg]] | None:
        """Return the least travel, back and on, to a goal from the end of a leg, with its legs.

        In m. None where there is no path. The robot backs out no farther than to where the leg's
        path begins.
        """
        route, paths = self.route(leg.path), self._paths_to(goal, closed)
        best: tuple[tuple[float, int], tuple[Edge, ...], float] | None = None
        for least, behind, index in self._turns(leg, route, paths):
            if best is not None and least > best[0][0] + LEG_PLANNER.rounding:
                break
            onward = paths.path(leg.path[index][:2]) or self._around(leg.path[index], goal, closed)
            if onward is None:
                continue
            path = (*leg.path[:index], *onward)
            stand = min(leg.end, self._stand(route, index, onward[0]))
            cost = leg.end - stand + self.route(path).length - stand, behind
            if best is None or cost < best[0]:
                best = cost, path, stand
        if best is None:
            return None
        (travel, _), path, stand = best
        forward = self.leg_to(goal, path, stand, leg.gear)
        if stand >= leg.end - LEG_PLANNER.rounding:
            return travel, [forward]
        return travel, [self._back_out(leg, stand), forward]

    def _turns(self, leg: Leg, route: Route, paths: PathsToGoals) -> list[tuple[float, int, int]]:
        """Return the passages of a leg from which a path leads to a goal, least travel first.

        Each with the least travel back and on, m, the number of passages behind the last one, and
        its number.
        """
        turns = []
        for index, here in enumerate(route.passages):
            travels = [
                leg.end
                - 2 * min(leg.end, self._stand(route, index, (here.index, here.enter, leave)))
                + here.s_enter
                + rest
                for leave, rest in paths.exits((here.index, here.enter))
            ]
            if travels:
                turns.append((min(travels), len(leg.path) - 1 - index, index))
        return sorted(turns)

    def _around(self, edge: Edge, goal: int, closed: Closed) -> tuple[Edge, ...] | None:
        """Return the shortest path to a goal from a port that does not lead out by that port."""
        enter = edge[:2]
        if enter == self.ends[goal + 1]:
            return None  # the goal is behind the robot; it comes there in the other gear
        back = self.network.joined_to.get(self.network.port_name(enter))
        cut = [] if back is None else [(enter, self.network.port(back))]
        return shortest_path(without(self._graph, closed, cut), enter, self.ends[goal + 1])

    def _paths_to(self, goal: int, closed: Closed) -> PathsToGoals:
        key = self.ends[goal + 1], closed
        if self._paths[0] != key:
            self._paths = key, PathsToGoals(without(self._graph, closed), [key[0]])
        return self._paths[1]

    def latest_stand(self, path: Sequence[Edge], index: int) -> float:
        """Return the greatest arc length, m, at which a robot can still stand before a passage.

        Of passage ``index`` of a path; infinite where that asks for no orientation.
        """
        if not self._passage(path[index]).asks_orientation:
            return math.inf
        return self._stand(self.route(path), index, path[index]) + LEG_PLANNER.rounding

    def _stand(self, route: Route, index: int, edge: Edge) -> float:
        """Return the arc length, m, where a robot stands clear before it passes ``edge``.

        In place of passage ``index`` of a route, and of what lies too close before that.
        """
        length, room = self.robot.length, self.robot.standing_room
        begin = self._passage(edge).at(route.passages[index].s_enter).s_prepared
        while index > 0 and begin - route.cleared(index - 1) < length + room:
            index -= 1
            begin = route.passages[index].s_prepared
        return max(begin - length / 2 - room, length / 2)

    def leg_to(self, goal: int, path: tuple[Edge, ...], begin: float, gear: int = 1) -> Leg:
        """Return the leg along a path that ends with the nose, in its gear, at a goal."""
        end = self.route(path).length - self.robot.length / 2 - self.robot.nose_room
        tail_first = "" if gear > 0 else ", tail first"
        return Leg(path, gear, begin, end, goal, f"to {self._names[goal]}{tail_first}")

    def _back_out(self, leg: Leg, stand: float, goal: int = -1) -> Leg:
        """Plan the leg that backs out from the end of ``leg`` in the other gear.

        Up to arc length ``stand`` m; ``goal`` is the number of the goal that is there, -1 if there
        is none.
        """
        route = self.route(leg.path)
        path: tuple[Edge, ...] = tuple(
            (part, leave, enter) for part, enter, leave in leg.path[::-1]
        )
        last, index = len(path) - 1, route.index_at(stand)
        begin = route.passages[last].s_leave - leg.end
        # The arcs into and out of a branch differ in length, so lengths are counted from the port
        # that both routes share.
        beyond = stand - route.passages[index].s_enter
        end = self.route(path).passages[last - index].s_leave - beyond
        to = "" if goal < 0 else f", to {self._names[goal]}"
        verb = "backs" if leg.gear > 0 else "drives"
        note = f"{verb} out of {route.passages[last].part.name}{to}"
        return Leg(path, -leg.gear, begin, end, goal, note)


def travel(legs: Sequence[Leg]) -> float:
    """Return the travel of a robot's centre on legs, m."""
    return sum(leg.end - leg.begin for leg in legs)


def is_sharp(fitting: Fitting, enter: str, leave: str) -> bool:
    """Return whether the way from one port of a fitting to another is a sharp turn."""
    return fitting.describe(enter, leave).turn_angle > LEG_PLANNER.sharp


def _locations(
    index: int, part: Part, centre: Array, axis: Array, arcs: Arcs
) -> Iterator[tuple[float, PartLocation]]:
    """Yield the passages of a part that a robot with its centre (1, 3) m in it lies along.

    Each with the angle by which it turns, rad.
    """
    fitting = part.fitting
    # In a pipe without a branch nothing turns a robot that lies across.
    most = LEG_PLANNER.across if len(fitting.port_names) > 2 else LEG_PLANNER.along
    for behind, ahead in permutations(fitting.port_names, 2):
        line = part.axis(behind, ahead, arcs)
        along = line.locate(centre)
        point, tangent = line.at(along)[:2]
        beside = float(length(centre - point)[0]) / fitting.port_radius(behind)
        cosine = float(dot(axis, tangent)[0])
        if beside <= LEG_PLANNER.beside and cosine >= math.cos(most):
            since, across = float(along[0]), cosine < math.cos(LEG_PLANNER.along)
            location = PartLocation(index, behind, ahead, since, line.length - since, across)
            yield fitting.describe(behind, ahead).turn_angle, location
