"""Where the robots are along the route: arc length, tilt, offset, and theta5 to the fitting ahead."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.frames import Array, cross, dot, length
from omnitrack_sim.pipes import Route


@dataclass(frozen=True)
class Place:
    """Places of n robots on the route.

    Attributes:
        distance: (n,) m, arc length of the centreline point nearest to the robot's centre.
        offset: (n,) m, distance from that point.
        tilt: (n,) rad, robot axis against the tangent there.
        theta5: (n,) rad, module 1 from the turning direction of the fitting being passed or next, in [-pi, pi).
        passage: (n,) index into ``Guide.passages`` of that fitting; ``len(passages)`` after the last one.
    """

    distance: Array
    offset: Array
    tilt: Array
    theta5: Array
    passage: NDArray[np.intp]


class Guide:
    """Follows n robots along one route.

    ``passages`` are the fittings that need an orientation: elbows and tees, in order. A straight route has none; theta5
    is then measured from the x axis of the route's frame.
    """

    def __init__(self, route: Route, distance: Array):
        self.route = route
        self.passages = tuple(p for p in route.fittings if p.is_turn or p.kind == "tee")
        spans = [(p.s_bend_start, p.s_bend_end) if p.is_turn else p.opening for p in self.passages]
        start, end = [first for first, _ in spans], [last for _, last in spans]
        directions = [p.turn_direction for p in self.passages]
        self.start = np.array([*start, np.inf])  # (P + 1,) m, arc length where the fitting begins to matter
        self.end = np.array([*end, np.inf])  # (P + 1,) m, where it has been passed
        last_direction = route.centreline.frame(np.array([route.centreline.length]))[0, :, 0]
        self.directions = np.array([*directions, last_direction])  # (P + 1, 3) turning direction at the start
        self.is_turn = np.array([*(p.is_turn for p in self.passages), False])
        self._distance = np.array(distance, float)

    def locate(self, position: Array, rotation: Array) -> Place:
        """Places of the robots at ``position`` (n, 3) m with ``rotation`` (n, 3, 3), world frame."""
        line = self.route.centreline
        distance = line.locate(position, self._distance)
        self._distance = distance
        point, tangent, normal, _ = line.at(distance)
        axis = rotation[:, :, 2]
        passage = self._passage(distance)
        reference = self._turning_direction(distance, passage, normal)
        return Place(
            distance=distance,
            offset=length(position - point),
            tilt=angle_between(axis, tangent),
            theta5=angle_about(axis, reference, rotation[:, :, 0]),
            passage=passage,
        )

    def name_of(self, passage: int) -> str:
        """The name of a passage's fitting in the network."""
        return self.route.network.parts[self.passages[passage].index].name

    def turning_direction(self, distance: Array) -> Array:
        """Unit vectors (n, 3), world frame: where the fitting passed or next at arc length (n,) m turns to."""
        return self._turning_direction(distance, self._passage(distance), self.route.centreline.at(distance)[2])

    def _passage(self, distance: Array) -> NDArray[np.intp]:
        return np.searchsorted(self.end, distance, side="right").clip(0, len(self.passages))

    def _turning_direction(self, distance: Array, passage: NDArray[np.intp], normal: Array) -> Array:
        bending = self.is_turn[passage] & (distance > self.start[passage])
        return np.where(bending[:, None], normal, self.directions[passage])


def angle_between(a: Array, b: Array) -> Array:
    """Angle (n,) rad between unit vectors (n, 3); exact near zero."""
    return 2 * np.arctan2(length(a - b), length(a + b))


def angle_about(axis: Array, start: Array, end: Array) -> Array:
    """Angle (n,) rad about ``axis`` (n, 3) from ``start`` to ``end`` (n, 3), both projected across the axis."""
    return np.arctan2(dot(cross(axis, start), end), dot(start, end) - dot(axis, start) * dot(axis, end))
