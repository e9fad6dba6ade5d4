"""Chains of parts along a line: straights, and bends at its corners, between two ports."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, angle_between, frame_along, length, unit
from omnitrack_sim.pipes.assembly import BORE_TOLERANCE, attached
from omnitrack_sim.pipes.fittings.base import Fitting
from omnitrack_sim.pipes.fittings.reducer import Reducer
from omnitrack_sim.pipes.fittings.straight import Straight
from omnitrack_sim.pipes.importing.assumptions import ImportSettings
from omnitrack_sim.pipes.importing.junctions import STRAIGHT_ON, bends

CONE, STEEP_CONE = math.tan(math.radians(10)), math.tan(math.radians(19.9))
"""Slope of a reducer's wall, and where there is little room; at most 20 degrees."""
MAX_STRAIGHT = 500.0
"""Of a straight, m."""
NOTHING, ROUNDING = 1e-5, 1e-9
"""Length of a straight, m, that is left out, as no file has one: a ring closes to 1 mm; and what
rounding may take of one, m."""
STEP_ASIDE = 1.02
"""A bend behind a port gets a little more room than its angle asks for."""


class TooShortError(Exception):
    """The parts of a line do not fit on it.

    Attributes:
        short: by how much, m.
    """

    def __init__(self, short: float, problem: str = ""):
        super().__init__(problem or f"is {1e3 * short:.0f} mm shorter than its fittings")
        self.short = short


class Outlet(NamedTuple):
    """A port that a chain begins or ends at, world frame: its frame, z outward, and bore, m."""

    pose: Pose
    bore: float


class Link(NamedTuple):
    """A part of a chain, from its port ``start`` to ``end``.

    Attributes:
        fitting: it. turn: rad, at the joint before it.
    """

    fitting: Fitting
    turn: float


class Chain(NamedTuple):
    """Parts from one port to another.

    Attributes:
        links: in order. turn: rad, at the joint behind the last.
    """

    links: list[Link]
    turn: float

    @property
    def length(self) -> float:
        """Length of all axes, m."""
        return sum(link.fitting.length_of_axes for link in self.links)


@dataclass
class _Plan:
    """Corners of a line and the bends there.

    Attributes:
        points: (k, 3) m, ends included. reserved: m, taken by reducers at either end.
        options: of each corner, the bends, each with what it takes of either side, m. chosen: which
            of them.
        lead: how many points come before the line's own.
    """

    points: Array
    reserved: tuple[float, float]
    options: list[list[tuple[Fitting | None, float]]]
    chosen: list[int]
    lead: int

    def rooms(self) -> Array:
        """Return what is left of each side for a straight, m; below 0 where bends do not fit."""
        rooms = length(np.diff(self.points, axis=0))
        rooms[0] -= self.reserved[0]
        rooms[-1] -= self.reserved[1]
        cuts = np.array([o[c][1] for o, c in zip(self.options, self.chosen, strict=True)])
        if len(cuts):
            rooms[:-1] -= cuts
            rooms[1:] -= cuts
        return rooms

    def choose(self) -> tuple[int, float] | None:
        """Choose bends that leave room for all straights, or return the side that is too short.

        Of that also by how much, m.
        """
        while True:
            rooms = self.rooms()
            side = int(rooms.argmin())
            if rooms[side] >= -ROUNDING:
                return None
            beside = [k for k in (side - 1, side) if 0 <= k < len(self.options)]
            smaller = [k for k in beside if self.chosen[k] + 1 < len(self.options[k])]
            if not smaller:
                return side, float(-rooms[side])
            # The one that takes more gives way.
            k = max(smaller, key=lambda k: self.options[k][self.chosen[k]][1])
            self.chosen[k] += 1


def chain(
    line: Array,
    start: Outlet | None,
    end: Outlet | None,
    bore: float,
    settings: ImportSettings,
) -> Chain:
    """Return the parts along a line.

    Args:
        line: (k, 3) m; its first and last point are nodes, which the ports lie near.
        start: port; None where the pipe just ends at the node, and begins there along the line.
        end: port; None where the pipe just ends at the node.
        bore: m.
        settings: of the import.

    Raises:
        TooShortError: parts do not fit on it.
    """
    try:
        return _Line(line, (start, end), bore, settings, tight=False).chain()
    except TooShortError:
        return _Line(line, (start, end), bore, settings, tight=True).chain()


@dataclass(frozen=True)
class _Line:
    """A line that parts are laid along; arguments as of ``chain``.

    Attributes:
        tight: parts are as short as can be.
    """

    line: Array
    outlets: tuple[Outlet | None, Outlet | None]
    bore: float
    settings: ImportSettings
    tight: bool

    def chain(self) -> Chain:
        """Return the parts; points of the line that leave no room are left out."""
        inner = [np.asarray(point) for point in self.line[1:-1]]
        while True:
            plan = self._plan(inner)
            worst = plan.choose()
            if worst is None:
                return self._links(plan)
            side, short = worst
            # The line's own points beside the side that is too short, as indices in ``inner``.
            beside = [k for k in (side - plan.lead, side + 1 - plan.lead) if 0 <= k < len(inner)]
            if not beside:
                raise TooShortError(short)
            inner.pop(beside[0])

    def _reducer(self, first: float, second: float) -> list[Reducer]:
        """Return the reducer from one bore to another, m; none where they may be joined."""
        if abs(first - second) <= BORE_TOLERANCE:
            return []
        slope = STEEP_CONE if self.tight else CONE
        return [Reducer(abs(first - second) / 2 / slope, second, first)]

    def _bends(self, angle: float) -> list[tuple[Fitting, float]]:
        """Return the bends of an angle, rad, that are tried, see ``bends``."""
        options = bends(angle, self.bore, self.settings)
        return options[-1:] if self.tight else options

    def _plan(self, inner: list[Array]) -> _Plan:
        """Return the line's corners with bends behind ports that look elsewhere, and the bends."""
        ends = [None if o is None else o.pose.position for o in self.outlets]
        points = [
            *(self.line[:1] if ends[0] is None else ()),
            *inner,
            *(self.line[-1:] if ends[1] is None else ()),
        ]
        reserved = [
            sum(cone.length for cone in self._reducer(outlet.bore, self.bore)) if outlet else 0.0
            for outlet in self.outlets
        ]
        beyond: list[Array | None] = [None, None]
        # The place of a bend behind a port depends on where the other end's is; once again settles
        # it.
        for which in (0, 1, 0, 1):
            outlet = self.outlets[which]
            if outlet is None:
                continue
            there = beyond[1 - which] if beyond[1 - which] is not None else ends[1 - which]
            aims = [*points, there] if which == 0 else [*points[::-1], there]
            aim = next(place for place in aims if place is not None)
            beyond[which] = self._behind(outlet, aim, reserved[which])
        before, after = (
            [p for p in both if p is not None] for both in zip(ends, beyond, strict=True)
        )
        places = np.array([*before, *points, *after[::-1]])
        ways = unit(np.diff(places, axis=0))
        options: list[list[tuple[Fitting | None, float]]] = []
        for angle in angle_between(ways[:-1], ways[1:]).tolist():
            found = self._bends(angle) if angle > STRAIGHT_ON else [(None, 0.0)]
            options.append([*found] or [(None, math.inf)])
        lead = 1 if beyond[0] is None else 2
        return _Plan(places, (reserved[0], reserved[1]), options, [0] * len(options), lead)

    def _behind(self, outlet: Outlet, aim: Array, reserved: float) -> Array | None:
        """Return where behind a port a bend turns to a place; None where the port looks there."""
        way, place = outlet.pose.rotation[:, 2], outlet.pose.position
        cut = 0.0
        for _ in range(6):
            corner = place + (reserved + cut) * way
            angle = float(angle_between(way, unit(aim - corner)))
            if angle <= STRAIGHT_ON:
                return None
            options = self._bends(angle)
            if not options:
                short = float(length(aim - corner)) + self.bore
                problem = "turns back behind a fitting" if short > 4 * self.bore else ""
                raise TooShortError(short, problem)
            wanted = options[0][1]
            if 0 < wanted <= cut:
                break
            cut = wanted * STEP_ASIDE
        return place + (reserved + cut) * way

    def _links(self, plan: _Plan) -> Chain:
        """Return the parts of a plan."""
        links: list[Link] = []
        (start, end), ways = self.outlets, unit(np.diff(plan.points, axis=0))
        port = Pose(frame_along(ways[0], 0.0), plan.points[0]) if start is None else start.pose
        for fitting, inward in self._fittings(plan, ways):
            turn = 0.0 if inward is None else _turn(port, inward)
            port = attached(port, fitting, "start", turn) @ fitting.ports["end"]
            links.append(Link(fitting, turn))
        return Chain(links, 0.0 if end is None else _turn(port, end.pose.rotation[:, 0]))

    def _fittings(self, plan: _Plan, ways: Array) -> Iterator[tuple[Fitting, Array | None]]:
        """Yield the parts in order, and where the x axis of a bend's port looks."""
        start, end = self.outlets
        for cone in self._reducer(start.bore, self.bore) if start else ():
            yield cone, None
        for side, room in enumerate(plan.rooms().tolist()):
            if room > NOTHING:
                count = math.ceil(room / MAX_STRAIGHT)
                for _ in range(count):
                    yield Straight(room / count, self.bore), None
            if side < len(plan.options):
                bend, _ = plan.options[side][plan.chosen[side]]
                if bend is not None:
                    onward = ways[side + 1]
                    yield bend, unit(onward - ways[side] * (ways[side] @ onward))
        for cone in self._reducer(self.bore, end.bore) if end else ():
            yield cone, None


def _turn(port: Pose, inward: Array) -> float:
    """Return the turn, rad, at a joint that brings the next port's x axis along ``inward``."""
    x, y = port.rotation[:, 0] @ inward, port.rotation[:, 1] @ inward
    return math.atan2(y, x)
