"""Sight of the pipe ahead of a robot: what a look reports, and error-free sight."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from omnitrack_sim.autonomy.belief import are_alike
from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.base.rotations import Array, length, unit
from omnitrack_sim.pipes import Arcs, Assembly, Fitting, Part, Port
from omnitrack_sim.pipes.network import both_ways
from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class SightSettings:
    """Reach and tolerances of error-free sight.

    Attributes:
        reach: bores that the robot is made for, seen beyond its nose: 0.96 m in 0.16 m.
        port: m, from its nose to the port by which it leaves a fitting, up to which it sees on.
        same_place: m, distance up to which an observation and the truth are of the same thing.
    """

    reach: float = 6.0
    port: float = 0.02
    same_place: float = 0.1


SIGHT = SightSettings()
SAME_FROM_ALL_PORTS = ("mean_radius", "angle", "length")
"""Keys of sizes that mean the same from all ports of a fitting."""


@dataclass(frozen=True)
class Sighting:
    """Sighting of the pipe before one end of a robot, at one moment.

    Ahead is where the robot drives to: beyond its nose in gear 1, beyond its tail in gear -1. The
    frame is that of the gear, which has z ahead and x towards module 1 in both; that of a look back
    is turned by half a turn.

    Attributes:
        fitting: the next one that the robot's centre has not come into and that is no plain
            straight of the same bore, with its sizes as seen; None: nothing but straight pipe as
            far as is seen, or an end. The nose may be in it already.
        enter: port of ``fitting`` by which it would be entered; "" without one. Where a fitting
            looks the same from two ports, such as an elbow or a tee from either end of its run,
            either of them.
        end: the pipe ends there, "open" or "closed"; "" where it does not, or goes into a fitting.
        distance: m, along the pipe's axis from the robot's centre to the port plane of what is
            seen, or to where sight ends.
        turn: rad, from the robot's x axis, projected across the pipe, to the x axis of the port
            ``enter`` (``Fitting.ports``), about the pipe's axis ahead. It is the turn of
            ``pipes.attached`` for a placed port whose x axis is that projection (``side_of``). 0
            for a fitting that is round about its axis.
        distance_std: m, standard deviation of the distance.
        turn_std: rad, standard deviation of the turn.
        confidence: probability that the kind of ``fitting``, or of the end, is right.
        axis: (3,) unit vector along the pipe ahead, in the robot's frame.
        size_stds: standard deviations of sizes of ``fitting``, m and rad, by the keys of its
            constructor; none by error-free sight.
        covariance: (1 + k, 1 + k) of the distance and the k sizes in ``size_stds``, m and rad; None
            where it is not known, or there is no error.

    Example:
        >>> ot.Sighting(end="open", distance=0.4).kind  # an open end, 0.4 m ahead
        ('', 'open')
    """

    fitting: Fitting | None = None
    enter: str = ""
    end: str = ""
    distance: float = 0.0
    turn: float = 0.0
    distance_std: float = 0.0
    turn_std: float = 0.0
    confidence: float = 1.0
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]), compare=False)
    size_stds: Mapping[str, float] = field(default_factory=dict, compare=False)
    covariance: Array | None = field(default=None, compare=False)

    def conditioned_on(self, known: Fitting, stds: Mapping[str, float]) -> Sighting:
        """Return the sighting as it is where sizes of its fitting are known.

        Distance and standard deviation follow: a bend that seems wider also seems to begin
        elsewhere.

        Args:
            known: the same fitting, as a map has it; one of another kind changes nothing.
            stds: standard deviations of its sizes, m and rad, by their keys; sizes without one, and
                diameters, are not used.
        """
        keys = [key for key in self.size_stds if key in stds and key in SAME_FROM_ALL_PORTS]
        seen, covariance = self.fitting, self.covariance
        if covariance is None or seen is None or seen.kind != known.kind or not keys:
            return self
        at = [1 + list(self.size_stds).index(key) for key in keys]
        apart = [getattr(known, key) - getattr(seen, key) for key in keys]
        off = np.diag([stds[key] ** 2 for key in keys])
        gain = np.linalg.solve(covariance[np.ix_(at, at)] + off, covariance[at, 0])
        variance = float(covariance[0, 0] - gain @ covariance[at, 0])
        distance = self.distance + float(gain @ apart)
        return replace(self, distance=distance, distance_std=math.sqrt(max(variance, 0.0)))

    @property
    def kind(self) -> tuple[str, str]:
        """Kind of the fitting, and the end, without position and sizes."""
        return "" if self.fitting is None else self.fitting.kind, self.end


def side_of(frame: Array, ahead: Array) -> Array:
    """Return the direction (3,), world frame, that ``Sighting.turn`` is measured from.

    It is the x axis of a robot's ``frame`` (3, 3), projected across a pipe along ``ahead`` (3,).
    """
    x = frame[:, 0]
    return unit(x - ahead * (x @ ahead))


class Look(NamedTuple):
    """A robot has looked ahead, and maybe back.

    Attributes:
        time: s.
        distance: m, arc length of its centre on its leg, estimate.
        ahead: sighting; None where it is ambiguous.
        behind: the same back; None also where the robot has not looked.
        frame: (3, 3) of the robot in its gear, world frame, estimate.
        bore: m, of the pipe around it, by its arms; not a number where they were not read.
        std: m, standard deviation of ``distance``, on the robot's map.
    """

    time: float
    distance: float
    ahead: Sighting | None
    behind: Sighting | None
    frame: Array
    bore: float = math.nan
    std: float = 0.0


class TrueSight:
    """Error-free sight of one network.

    Args:
        pipes: the network.
        plates: ports that a plate closes.
        robot: its length, and the bore that it is made for.
        arcs: of the centreline in tees, along which distances are measured.
    """

    def __init__(self, pipes: Assembly, plates: Collection[Port], robot: Robot, arcs: Arcs) -> None:
        self._pipes, self._half, self._arcs = pipes, robot.length / 2, arcs
        self._reach = SIGHT.reach * robot.nominal_bore
        self._joined = both_ways(pipes.joints)
        closed = set(plates)
        self._closed = closed | {self._joined[end] for end in closed if end in self._joined}

    def look(self, robot: int, position: Array, frame: Array) -> Sighting | None:  # noqa: ARG002 - as of a camera
        """Return the sighting of one robot now; None where it is ambiguous, such as within a bend.

        Args:
            robot: index in its batch.
            position: (3,) m, of the robot's centre, world frame, the true one.
            frame: (3, 3) of the robot in its gear, in the world, the true one.
        """
        nearest = min(self._ports_ahead(position[None], frame[:, 2]), default=None)
        return None if nearest is None else self._sighting_through(*nearest[1:], frame)

    def _ports_ahead(self, centre: Array, axis: Array) -> Iterator[tuple[float, float, Port]]:
        """Yield the ports ahead of a robot with its centre (1, 3) m in a straight.

        In another fitting its nose has to be at the port. Of each: the distance of the centre from
        the axis that leads there, and along it to the port plane, m, and the port.
        """
        for index, part in enumerate(self._pipes.parts):
            fitting = part.fitting
            if not part.holds(centre, 0.0):
                continue
            for enter, leave in permutations(fitting.port_names, 2):
                if float(axis @ part.port(leave).rotation[:, 2]) < math.cos(LEG_PLANNER.along):
                    continue
                line = part.axis(enter, leave, self._arcs)
                at = line.locate(centre)
                left = line.length - float(at[0])
                # Within a fitting its walls hide what is beyond, until the nose is at the port.
                if fitting.is_plain or left <= self._half + SIGHT.port:
                    beside = float(length(centre - line.at(at)[0])[0])
                    yield beside, left, (index, leave)

    def _sighting_through(self, distance: float, end: Port, frame: Array) -> Sighting:
        """Return the sighting through a port at ``distance`` m."""
        axis = frame.T @ self._pipes.parts[end[0]].port(end[1]).rotation[:, 2]
        reach = self._half + self._reach
        while distance <= reach:
            if end in self._closed:
                return Sighting(end="closed", distance=distance, axis=axis)
            if end not in self._joined:
                return Sighting(end="open", distance=distance, axis=axis)
            index, enter = self._joined[end]
            part = self._pipes.parts[index]
            if not part.fitting.is_plain:
                turn = _turn(part, enter, frame)
                return Sighting(part.fitting, enter, distance=distance, turn=turn, axis=axis)
            # A straight of the same bore looks like more of the pipe: sight goes on through it.
            distance += part.fitting.length_of_axes
            end = index, next(name for name in part.fitting.port_names if name != enter)
        return Sighting(distance=reach, axis=axis)


def _turn(part: Part, enter: str, frame: Array) -> float:
    """See ``Sighting.turn``."""
    if part.fitting.is_axial:
        return 0.0
    port = part.port(enter).rotation
    ahead, x = -port[:, 2], port[:, 0]
    side = side_of(frame, ahead)
    return math.atan2(float(x @ np.cross(ahead, side)), float(x @ side))


def is_right(observed: Sighting, truth: Sighting) -> bool:
    """Return whether a sighting agrees with the truth.

    It is of a fitting, an end, or, as far as is seen, nothing. Which of a fitting's ports is nearer
    counts where the ports differ.
    """
    if observed.fitting is None and not observed.end:
        return truth.distance > observed.distance - SIGHT.same_place
    if abs(observed.distance - truth.distance) > SIGHT.same_place or observed.end != truth.end:
        return False
    if observed.fitting is None or truth.fitting is None:
        return observed.fitting is truth.fitting
    same = observed.fitting.kind == truth.fitting.kind
    return same and are_alike(truth.fitting, observed.enter, truth.enter)
