"""Sight as true as can be: what a robot could see of the network that it is in, up to some
distance."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np

from omnitrack_sim.network.ahead import Ahead
from omnitrack_sim.network.layout import End, both_ways
from omnitrack_sim.network.whereabouts import ALONG
from omnitrack_sim.pipes import Arcs, Assembly, Part
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array, length

RANGE = 6.0
"""How far a robot sees beyond its nose, in bores that it is made for: 0.96 m."""
AT_PORT = 0.02
"""How far, m, before the port by which it leaves a fitting a nose sees what is beyond it."""
BACK = 4
"""Most parts that a robot lies in at once."""


class _Port(NamedTuple):
    """A port that a nose points out of, and how far the nose is before its plane, m."""

    end: End
    room: float


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
        nose = position + self._half * frame[:, 2]
        port = self._port_ahead(nose, frame[:, 2])
        if port is None:
            return None
        before = self._way_to(port.end, position)
        return None if before is None else self._from(port, before, frame)

    def _port_ahead(self, nose: Array, axis: Array) -> _Port | None:
        """The port that a nose in a straight points to, or that it is about to come out of."""
        best: _Port | None = None
        for index, part in enumerate(self._pipes.parts):
            near = math.inf if part.fitting.is_plain else AT_PORT
            if not part.holds(nose[None], 0.0):
                continue
            for name in part.fitting.port_names:
                port = part.port(name)
                room = float((port.position - nose) @ port.rotation[:, 2])
                along = float(axis @ port.rotation[:, 2]) > math.cos(ALONG)
                if along and room <= near and (best is None or room > best.room):
                    best = _Port((index, name), room)
        return best

    def _way_to(self, port: End, centre: Array) -> float | None:
        """Length, m, of the axis from a robot's centre (3,) m to a port ahead of it."""
        found = min(self._ways_to(port, centre), key=lambda way: way[0], default=None)
        return None if found is None else found[1]

    def _ways_to(self, port: End, centre: Array) -> Iterator[tuple[float, float]]:
        """Ways from a centre (3,) m to a port ahead: how far the centre is beside each, and its
        length, m."""
        waiting = [(port, 0.0)]
        for _ in range(BACK):
            behind: list[tuple[End, float]] = []
            for (index, leave), beyond in waiting:
                part = self._pipes.parts[index]
                here = part.holds(centre[None], 0.0)
                for enter in part.fitting.port_names:
                    if enter == leave:
                        continue
                    line = part.axis(enter, leave, self._arcs)
                    if here:
                        at = line.locate(centre[None])
                        beside = float(length(centre - line.at(at)[0][0]))
                        yield beside, beyond + line.length - float(at[0])
                    if (index, enter) in self._joined:
                        behind.append((self._joined[index, enter], beyond + line.length))
            waiting = behind

    def _from(self, port: _Port, distance: float, frame: Array) -> Ahead:
        """What is seen through a port whose plane is ``distance`` m ahead of the centre."""
        end, reach = port.end, distance - port.room + self._reach
        while distance <= reach:
            if end in self._closed:
                return Ahead(end="closed", distance=distance)
            if end not in self._joined:
                return Ahead(end="open", distance=distance)
            index, enter = self._joined[end]
            part = self._pipes.parts[index]
            if not part.fitting.is_plain:
                turn = _turn(part, enter, frame)
                return Ahead(part.fitting, enter, distance=distance, turn=turn)
            distance += part.fitting.length_of_axes
            end = index, next(name for name in part.fitting.port_names if name != enter)
        return Ahead(distance=reach)


def _turn(part: Part, enter: str, frame: Array) -> float:
    """See ``Ahead.turn``."""
    if part.fitting.is_axial:
        return 0.0
    x, y, _ = part.port(enter).rotation[:, 0] @ frame
    return float(np.arctan2(y, x))
