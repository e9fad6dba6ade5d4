"""Where the robots are along their routes: arc length, tilt, offset, and theta5 to the fitting
ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.pipes import Centreline, Passage, Route
from omnitrack_sim.rotations import Array, cross, dot, length


@dataclass(frozen=True)
class Place:
    """Places of n robots on their routes.

    Attributes:
        way: (n,) index into ``Guide.routes`` of each robot's route.
        distance: (n,) m, arc length of the centreline point nearest to the robot's centre.
        aside: (n, 3) m, from that point to the robot's centre, world frame. offset: (n,) m, its
            length.
        tilt: (n,) rad, robot axis against the tangent there.
        theta5: (n,) rad, module 1 from the turning direction of the fitting being passed or next,
            in [-pi, pi).
        passage: (n,) index into ``Guide.passages`` of that fitting, or of the end of the way after
            its last one.
    """

    way: NDArray[np.intp]
    distance: Array
    aside: Array
    offset: Array
    tilt: Array
    theta5: Array
    passage: NDArray[np.intp]


class Guide:
    """Follows n robots, each along a route of its own.

    ``passages`` are the fittings that need an orientation, elbows and tees, of one route after the
    other. Each route has one entry more, None, for what comes after its last one; theta5 is then
    measured from the x axis of the route's frame at its end.

    Attributes:
        routes: what ``way`` counts.
        way: (n,) route of each robot.
        first, count: (W,) first passage of each route, and number with the end; arrays below have
            an entry a passage.
        start, end: (Q,) m, arc length where the fitting begins to matter and where it has been
            passed.
        way_of: (Q,) route of each passage.
        is_turn: (Q,) bool, the route bends there. is_tee_turn, into_branch, out_of_branch: (Q,)
            bool.
        radius: (Q,) m, of the bore there.
        directions: (Q, 3) turning directions at the fitting's entry, world frame.
    """

    def __init__(self, routes: Sequence[Route], way: NDArray[np.intp], distance: Array):
        self.routes = list(routes)
        self.way = np.array(way)
        self._distance = np.array(distance, float)
        self._learn()

    @classmethod
    def along(cls, route: Route, distance: Array) -> Guide:
        """For n robots on one route, at arc length (n,) m."""
        return cls([route], np.zeros(len(distance), np.intp), distance)

    def add(self, route: Route) -> int:
        """A further route; returns its number. Passages of the earlier ones keep theirs."""
        self.routes.append(route)
        self._learn()
        return len(self.routes) - 1

    def send(self, robot: int, way: int, distance: float) -> None:
        """Put a robot onto a way, near arc length ``distance`` m."""
        self.way[robot], self._distance[robot] = way, distance

    def _learn(self) -> None:
        """What is looked up of all routes."""
        self.centreline = Centreline.together([route.centreline for route in self.routes])
        self.lengths = self.centreline.lengths  # (W,) m
        passages: list[Passage | None] = []
        first, end_directions, last_radius = [], [], []
        for route in self.routes:
            first.append(len(passages))
            passages += [p for p in route.fittings if p.asks_orientation]
            passages.append(None)
            end_directions.append(
                route.centreline.frame(np.array([route.centreline.length]))[0, :, 0]
            )
            last_radius.append(route.fittings[-1].radius)
        self.passages = tuple(passages)
        self.first = np.array(first)
        self.count = np.diff([*first, len(passages)])
        self.way_of = np.repeat(np.arange(len(self.routes)), self.count)
        spans = [(np.inf, np.inf) if p is None else p.span for p in passages]
        self.start, self.end = np.array(spans).T
        self.is_turn = np.array([p is not None and p.is_turn for p in passages])
        self.is_tee_turn = np.array([p is not None and p.manoeuvre == "tee_turn" for p in passages])
        self.into_branch = np.array([p is not None and p.into_branch for p in passages])
        self.out_of_branch = np.array([p is not None and p.out_of_branch for p in passages])
        at_end = iter(zip(end_directions, last_radius, strict=True))
        ends = [(p.turn_direction, p.radius) if p is not None else next(at_end) for p in passages]
        self.directions = np.array([direction for direction, _ in ends])
        self.radius = np.array([radius for _, radius in ends])
        self._ends = np.full((len(first), int(self.count.max())), np.inf)  # (W, most passages) m
        for way, (begin, count) in enumerate(zip(self.first, self.count, strict=True)):
            self._ends[way, :count] = self.end[begin : begin + count]

    def locate(self, position: Array, rotation: Array) -> Place:
        """Places of the robots at ``position`` (n, 3) m with ``rotation`` (n, 3, 3), world
        frame."""
        distance = self.centreline.locate(position, self._distance, self._way)
        self._distance = distance
        point, tangent, normal, _ = self.at(distance)
        aside = position - point
        axis = rotation[:, :, 2]
        passage = self._passage(distance)
        reference = self._turning_direction(distance, passage, normal)
        return Place(
            way=self.way.copy(),
            distance=distance,
            aside=aside,
            offset=length(aside),
            tilt=angle_between(axis, tangent),
            theta5=angle_about(axis, reference, rotation[:, :, 0]),
            passage=passage,
        )

    def at(self, distance: Array) -> tuple[Array, Array, Array, Array]:
        """Of each robot's centreline at arc length (n,) or (n, k) m: see ``Centreline.at``, arrays
        (n, ...)."""
        if distance.ndim == 1:
            return self.centreline.at(distance, self._way)
        way = None if self._way is None else np.repeat(self._way, distance.shape[1])
        point, tangent, normal, curvature = self.centreline.at(distance.ravel(), way)
        shape = distance.shape
        return (*(a.reshape(*shape, 3) for a in (point, tangent, normal)), curvature.reshape(shape))  # type: ignore[return-value]

    @property
    def _way(self) -> NDArray[np.intp] | None:
        """As ``Centreline`` takes it: none where there is one route only."""
        return self.way if len(self.routes) > 1 else None

    def name_of(self, passage: int) -> str:
        """The name of a passage's fitting in the network."""
        found = self.passages[passage]
        assert found is not None
        return self.routes[self.way_of[passage]].network.parts[found.index].name

    def turning_direction(self, distance: Array) -> Array:
        """Unit vectors (n, 3), world frame: where the fitting passed or next at arc length (n,) m
        turns to."""
        return self._turning_direction(distance, self._passage(distance), self.at(distance)[2])

    def _passage(self, distance: Array) -> NDArray[np.intp]:
        passed = (self._ends[self.way] <= distance[:, None]).sum(axis=1)
        return self.first[self.way] + np.minimum(passed, self.count[self.way] - 1)

    def _turning_direction(
        self, distance: Array, passage: NDArray[np.intp], normal: Array
    ) -> Array:
        bending = self.is_turn[passage] & (distance > self.start[passage])
        return np.where(bending[:, None], normal, self.directions[passage])


def angle_between(a: Array, b: Array) -> Array:
    """Angle (n,) rad between unit vectors (n, 3); exact near zero."""
    return 2 * np.arctan2(length(a - b), length(a + b))


def angle_about(axis: Array, start: Array, end: Array) -> Array:
    """Angle (n,) rad about ``axis`` (n, 3) from ``start`` to ``end`` (n, 3), both projected across
    the axis."""
    return np.arctan2(
        dot(cross(axis, start), end), dot(start, end) - dot(axis, start) * dot(axis, end)
    )
