"""Sight as true as can be: what a robot could see of the network that it is in, up to some
distance."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from itertools import permutations
from typing import NamedTuple

import numpy as np

from omnitrack_sim.autonomy.ahead import Ahead, side_of
from omnitrack_sim.autonomy.belief import alike
from omnitrack_sim.autonomy.whereabouts import ALONG
from omnitrack_sim.base.rotations import Array, length
from omnitrack_sim.pipes import Arcs, Assembly, Part
from omnitrack_sim.pipes.layout import End, both_ways
from omnitrack_sim.robots.omnitrack import Robot

RANGE = 6.0
"""How far a robot sees beyond its nose, in bores that it is made for: 0.96 m."""
AT_PORT = 0.02
"""How far before the port by which a robot leaves a fitting its nose has to be, m, for it to see
what is beyond."""


SAME_PLACE = 0.1
"""Distance, m, within which what is seen and what is there count as the same thing."""


class _Port(NamedTuple):
    """A port ahead of a robot.

    Attributes:
        beside: m, the robot's centre from the axis that leads there.
        distance: m, along that axis from the centre to the port plane.
        end: the port.
    """

    beside: float
    distance: float
    end: End


class TrueSight:
    """Tells robots of one network what is ahead, without error.

    Args:
        pipes: the network. plates: ports that a plate closes.
        robot: its length, and the bore that it is made for.
        arcs: of the centreline in tees, along which distances are measured.
        reach: m, how far it sees beyond its nose; None: ``RANGE``.
    """

    def __init__(
        self,
        pipes: Assembly,
        plates: Collection[End],
        robot: Robot,
        arcs: Arcs,
        reach: float | None = None,
    ) -> None:
        self._pipes, self._half, self._arcs = pipes, robot.length / 2, arcs
        self._reach = RANGE * robot.nominal_bore if reach is None else reach
        self._joined = both_ways(pipes.joints)
        closed = set(plates)
        self._closed = closed | {self._joined[end] for end in closed if end in self._joined}

    def look(self, robot: int, position: Array, frame: Array) -> Ahead | None:
        """See ``Sight``."""
        ports = list(self._ports_ahead(position[None], frame[:, 2]))
        return self._from(min(ports), frame) if ports else None

    def _ports_ahead(self, centre: Array, axis: Array) -> Iterator[_Port]:
        """Ports ahead of a robot with its centre (1, 3) m in a straight, or in another fitting with
        its nose at the port."""
        for index, part in enumerate(self._pipes.parts):
            fitting = part.fitting
            if not part.holds(centre, 0.0):
                continue
            for enter, leave in permutations(fitting.port_names, 2):
                if float(axis @ part.port(leave).rotation[:, 2]) < math.cos(ALONG):
                    continue
                line = part.axis(enter, leave, self._arcs)
                at = line.locate(centre)
                left = line.length - float(at[0])
                if fitting.is_plain or left <= self._half + AT_PORT:
                    beside = float(length(centre - line.at(at)[0])[0])
                    yield _Port(beside, left, (index, leave))

    def _from(self, port: _Port, frame: Array) -> Ahead:
        """What is seen through a port."""
        _, distance, end = port
        axis = frame.T @ self._pipes.parts[end[0]].port(end[1]).rotation[:, 2]
        reach = self._half + self._reach
        while distance <= reach:
            if end in self._closed:
                return Ahead(end="closed", distance=distance, axis=axis)
            if end not in self._joined:
                return Ahead(end="open", distance=distance, axis=axis)
            index, enter = self._joined[end]
            part = self._pipes.parts[index]
            if not part.fitting.is_plain:
                turn = _turn(part, enter, frame)
                return Ahead(part.fitting, enter, distance=distance, turn=turn, axis=axis)
            distance += part.fitting.length_of_axes
            end = index, next(name for name in part.fitting.port_names if name != enter)
        return Ahead(distance=reach, axis=axis)


def _turn(part: Part, enter: str, frame: Array) -> float:
    """See ``Ahead.turn``."""
    if part.fitting.is_axial:
        return 0.0
    port = part.port(enter).rotation
    ahead, x = -port[:, 2], port[:, 0]
    side = side_of(frame, ahead)
    return math.atan2(float(x @ np.cross(ahead, side)), float(x @ side))


def is_right(seen: Ahead, there: Ahead) -> bool:
    """Whether what is seen is of the kind of what is there: a fitting, an end, or, as far as is
    seen, nothing. Which of a fitting's ports is nearer counts where the ports differ."""
    if seen.fitting is None and not seen.end:
        return there.distance > seen.distance - SAME_PLACE
    if abs(seen.distance - there.distance) > SAME_PLACE or seen.end != there.end:
        return False
    if seen.fitting is None or there.fitting is None:
        return seen.fitting is there.fitting
    same = seen.fitting.kind == there.fitting.kind
    return same and alike(there.fitting, seen.enter, there.enter)
