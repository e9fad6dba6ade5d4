"""Location of robots on their routes: arc length, tilt, offset, theta5 to the fitting ahead."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base import rotations
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Centreline, Passage, Route
from omnitrack_sim.pipes.centreline import COLUMNS, nearest, place_on, segment_at
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBERS,
    WORD,
    WORDS,
    at,
    c_function,
    compiled,
    pointers,
)
from omnitrack_sim.pipes.vectors import angle_between, cross, dot, length, minus, put_vector, vector

BEFORE_END = 1e-9
"""Distance before the end of a fitting where its centreline is still that of the fitting, m."""


@dataclass(eq=False)
class Location:
    """Locations of n robots on their routes.

    Attributes:
        route: (n,) index into ``RouteMap.routes``.
        distance: (n,) m, arc length of the centreline point nearest to the robot's centre.
        aside: (n, 3) m, from that point to the robot's centre, world frame. offset: (n,) m, its
            length.
        tangent, normal: (n, 3) of the centreline at that point, world frame. curvature: (n,) 1/m.
        passage: (n,) index into ``RouteMap.passages`` of the fitting being passed or next, or of
            the end of the route after its last one.
        turning: (n, 3) unit vectors, world frame, of its turning direction.
        frame: (n, 3, 3) of the robots that drive nose first, in the world.
        tilt: (n,) rad, robot axis against the centreline's tangent.
        theta5: (n,) rad, in [-pi, pi): module 1 from the turning direction of the passage.
        distance_std, theta5_std: (n,) m and rad, standard deviations, where the location is an
            estimate; None where it is the truth.
        sure: (n,) bool, robots that know their theta5 well enough to plan by it; None: all.
    """

    route: NDArray[np.intp]
    distance: Array
    aside: Array
    offset: Array
    tangent: Array
    normal: Array
    curvature: Array
    passage: NDArray[np.intp]
    turning: Array
    frame: Array
    tilt: Array
    theta5: Array
    distance_std: Array | None = None
    theta5_std: Array | None = None
    sure: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        return f"Location({len(self.route)} robots)"


class RouteMap:
    """Routes of a batch with the tables that are looked up along them; only ``add`` changes it.

    ``passages`` are the fittings that need an orientation, elbows and tees, of one route after the
    other. Each route has one entry more, None, for what comes after its last one; theta5 is then
    measured from the x axis of the route's frame at its end.

    Attributes:
        routes: what ``route`` counts. version: how many times routes have been added.
        first, count: (W,) first passage of each route, and number with the end; arrays below have
            an entry a passage.
        start, end: (Q,) m, arc length where the fitting begins to matter and where it has been
            passed.
        route_of: (Q,) route of each passage.
        is_turn: (Q,) bool, the route bends there. is_tee_turn, is_straight_over, into_branch,
            out_of_branch: (Q,) bool.
        bend_radius: (Q,) m, of the centreline; nan where it does not bend.
        sharpness: (Q,) radius of the bore over that of the bend; 0 where it does not bend.
        radius: (Q,) m, of the bore there. corner_radius: (Q,) m, see ``Passage``.
        directions: (Q, 3) turning directions at the fitting's entry, world frame. ahead: (Q, 3)
            the route's direction there. turn: (Q,) rad, by which it turns; a right angle where
            it does not bend.
    """

    def __init__(self, routes: Sequence[Route] = ()):
        self.routes: list[Route] = []
        self.version = 0
        self.add(routes)

    def add(self, routes: Sequence[Route]) -> None:
        """Add further routes. Passages of the earlier ones keep their numbers."""
        if routes:
            self.routes += routes
            self.version += 1
            self._build_tables()

    def _build_tables(self) -> None:
        """Build the tables of all routes."""
        self.centreline = Centreline.together([route.centreline for route in self.routes])
        self.lengths = self.centreline.lengths  # (W,) m
        passages: list[Passage | None] = []
        first, end_directions, last_radius = [], [], []
        for route in self.routes:
            first.append(len(passages))
            # An end entry for each route, so that "the next passage" exists everywhere along it.
            passages += [p for p in route.passages if p.asks_orientation]
            passages.append(None)
            end_directions.append(
                route.centreline.frame(np.array([route.centreline.length]))[0, :, 0]
            )
            last_radius.append(route.passages[-1].radius)
        self.passages = tuple(passages)
        self.first = np.array(first)
        self.count = np.diff([*first, len(passages)])
        self.last = self.first + self.count - 1
        self.route_of = np.repeat(np.arange(len(self.routes)), self.count)
        spans = [(np.inf, np.inf) if p is None else p.span for p in passages]
        self.start, self.end = np.array(spans).T

        def each(value: Callable[[Passage], Any], at_end: Any) -> NDArray[Any]:
            return np.array([at_end if p is None else value(p) for p in passages])

        self.is_turn = each(lambda p: p.is_turn, False)
        self.is_tee_turn = each(lambda p: p.manoeuvre == "tee_turn", False)
        self.is_straight_over = each(lambda p: p.manoeuvre == "tee_straight", False)
        self.into_branch = each(lambda p: p.description.into_branch, False)
        self.out_of_branch = each(lambda p: p.description.out_of_branch, False)
        self.bend_radius = each(lambda p: p.bend_radius, np.nan)
        self.turn = each(lambda p: p.description.turn_angle if p.is_turn else np.pi / 2, np.pi / 2)
        self.directions = each(lambda p: p.turn_direction, np.zeros(3))
        self.radius = each(lambda p: p.radius, 0.0)
        self.corner_radius = each(lambda p: p.corner_radius, 0.0)
        self.sharpness = np.nan_to_num(self.radius / self.bend_radius)
        self.directions[self.last] = end_directions
        self.radius[self.last] = self.corner_radius[self.last] = last_radius
        # The end entries begin at infinity, where no tangent can be looked up.
        entries = np.where(np.isinf(self.start), 0.0, self.start)
        self.ahead = self.tangents(entries[:, None], self.route_of)[:, 0]
        # What compiled functions look up of the passages, and (W, 2) first and last of each route.
        self._passages = np.empty((len(passages), PASSAGE))
        self._passages[:, END] = self.end
        self._passages[:, TURN_BEGIN] = np.where(self.is_turn, self.start, np.inf)
        self._passages[:, BRANCH] = self.out_of_branch * 1.0 - self.into_branch
        self._passages[:, RADIUS], self._passages[:, TURN] = self.radius, self.turn
        self._passages[:, DIRECTION : DIRECTION + 3] = self.directions
        self._passages[:, AHEAD : AHEAD + 3] = self.ahead
        self._spans = np.stack([self.first, self.last], axis=1).astype(np.int64)

    def locate(
        self, position: Array, rotation: Array, route: NDArray[np.intp], near: Array
    ) -> Location:
        """Locate n robots on their routes.

        Args:
            position: (n, 3) m, world frame.
            rotation: (n, 3, 3) frames that drive nose first, in the world.
            route: (n,) number of each robot's route.
            near: (n,) m, arc length where each robot was a moment ago: routes may come close to
                themselves.
        """
        count = len(route)
        passage, rows = np.empty(count, np.int64), np.empty((count, PLACE))
        given = (np.ascontiguousarray(each, float) for each in (position, rotation, near))
        c_function(_locate, _LOCATE).ctypes(
            count,
            *self.tables,
            *pointers(self._spans, route, *given, passage, rows),
        )
        return Location(
            route=route,
            distance=rows[:, DISTANCE],
            aside=rows[:, ASIDE : ASIDE + 3],
            offset=rows[:, OFFSET],
            tangent=rows[:, TANGENT : TANGENT + 3],
            normal=rows[:, NORMAL : NORMAL + 3],
            curvature=rows[:, CURVATURE],
            passage=passage,
            turning=rows[:, TURNING : TURNING + 3],
            frame=rotation,
            tilt=rows[:, TILT],
            theta5=rows[:, THETA5],
        )

    @property
    def arrays(self) -> tuple[NDArray[Any], ...]:
        """What ``locate`` looks up: arrays of the centreline, passages (Q, PASSAGE), spans (W, 2).

        A span is the first and the last passage of a route.
        """
        return *self.centreline.arrays, self._passages, self._spans

    @property
    def tables(self) -> list[Any]:
        """Pointers to segments, first and last segment of each route, and passages.

        See ``centreline.COLUMNS`` and ``PASSAGE``.
        """
        return [*self.centreline.tables, *pointers(self._passages)]

    def has_left(self, location: Location) -> NDArray[np.bool_]:
        """Return which located robots (n,) have their centres in no bore of their routes.

        Beyond the ends of a route its bores go on.
        """
        # In a bore that does not branch none is farther from the centreline than its radius. In a
        # turn at a branch many are, and the wall inside the corner is nearer, where none gets.
        left = location.offset > self.radius.take(location.passage)
        for robot in np.flatnonzero(left).tolist() if np.count_nonzero(left) else ():
            route, s = self.routes[location.route[robot]], float(location.distance[robot])
            if 0 <= s <= route.length:
                point = route.centreline.at(np.array([s]))[0][0] + location.aside[robot]
                left[robot] = route.passages[route.index_at(s)].depth(point) <= 0
        return left

    def theta5(self, location: Location, passage: NDArray[np.intp]) -> Array:
        """Return theta5 (n,) rad, in [-pi, pi), of located robots for ``passage`` (n,).

        The passage may be the one before or after that of their location.
        """
        # Beyond a bend, its turning direction is that at its end.
        before_end = np.minimum(location.distance, self.end.take(passage) - BEFORE_END)
        theta5 = np.empty(len(passage))
        turning = self._turning(before_end, location.route, passage)
        c_function(_angles, _ANGLES).ctypes(
            len(theta5), *pointers(np.ascontiguousarray(location.frame), turning, theta5)
        )
        return theta5

    def nose_room(self, location: Location, length: float) -> Array:
        """Return the room (n,) m from noses of robots ``length`` m long to the next fitting.

        That is its bend or opening. It is infinite after the last one.
        """
        return self.start.take(location.passage) - location.distance - length / 2

    def progress(self, passage: NDArray[np.intp], rotation: Array) -> Array:
        """Return by which share robots (n,) have turned into their passages; 1 when they are round.

        Args:
            passage: (n,) that robots are in.
            rotation: (n, 3, 3) robot frame in the world.
        """
        share = np.empty(len(passage))
        c_function(_progress, _PROGRESS).ctypes(
            len(share),
            *pointers(self._passages, passage, np.ascontiguousarray(rotation), share),
        )
        return share

    def tangents(self, distance: Array, route: NDArray[np.intp]) -> Array:
        """Unit vectors (n, k, 3) along each robot's centreline at arc lengths (n, k) m."""
        repeated = np.repeat(route, distance.shape[1])
        return self.centreline.at(distance.ravel(), repeated)[1].reshape(*distance.shape, 3)

    def name_of(self, passage: int) -> str:
        """Name of a passage's fitting in the network."""
        fitting = self.passages[passage]
        assert fitting is not None
        return self.routes[self.route_of[passage]].network.parts[fitting.index].name

    def start_poses(
        self, route: NDArray[np.intp], distance: Array, theta5: Array
    ) -> tuple[Array, Array]:
        """Positions (n, 3) m and rotations (n, 3, 3) on the centreline of robots at their start.

        ``distance`` (n,) m, arc length. ``theta5`` (n,) rad.
        """
        position, tangent, _, _ = self.centreline.at(distance, route)
        turning = self._turning(distance, route, np.full(len(route), -1))
        return position, _turned(tangent, turning, theta5)

    def poses(self, route: NDArray[np.intp], distance: Array, turn: Array) -> tuple[Array, Array]:
        """Return positions (k, 3) m and rotations (k, 3, 3) on the centreline, along its tangent.

        ``distance`` (k,) m, arc length. ``turn`` (k,) rad, of module 1 from the centreline's
        normal.
        """
        position, tangent, normal, _ = self.centreline.at(distance, route)
        return position, _turned(tangent, normal, turn)

    def _turning(
        self, distance: Array, route: NDArray[np.intp], passage: NDArray[np.intp]
    ) -> Array:
        """Turning directions (n, 3) at arc lengths (n,) m for ``passage`` (n,).

        A passage of -1 is that of the arc length.
        """
        turning = np.empty((len(route), 3))
        c_function(_turnings, _TURNINGS).ctypes(
            len(route),
            *self.tables,
            *pointers(self._spans, route, passage, distance, turning),
        )
        return turning


# Columns of the table of passages. A turn's begin is infinite where there is none; the branch is 1
# on the way out of one, -1 on the way into one and 0 elsewhere.
END, TURN_BEGIN, BRANCH, RADIUS, TURN, DIRECTION, AHEAD = 0, 1, 2, 3, 4, 5, 8
PASSAGE = 11
# Columns of what a robot's place is.
DISTANCE, OFFSET, CURVATURE, TILT, THETA5 = range(5)
ASIDE, TANGENT, NORMAL, TURNING = range(5, 17, 3)
PLACE = 17


@compiled
def passage_at(passages, first, last, s):
    """Return which passage, of first to last, arc length ``s`` m lies in or before."""
    # Their ends ascend along a route.
    while first < last:
        middle = (first + last) // 2
        if passages[middle * PASSAGE + END] <= s:
            first = middle + 1
        else:
            last = middle
    return first


@compiled
def turning_at(passages, passage, s, normal):
    """Return the turning direction of a passage at arc length ``s`` m.

    Within a bend it follows the arc's normal; before it, it is that at the entry.
    """
    start = passage * PASSAGE
    return normal if s > passages[start + TURN_BEGIN] else vector(passages, start + DIRECTION)


@compiled
def theta5_of(frame, turning):
    """Return the angle, rad, of a frame's x axis about its z axis from ``turning``."""
    x, z = (frame[0], frame[3], frame[6]), (frame[2], frame[5], frame[8])
    # The subtraction takes away what lies along the axis: only the part across makes the angle.
    return math.atan2(dot(cross(z, turning), x), dot(turning, x) - dot(z, turning) * dot(z, x))


def _angles(count, frames, turning, theta5):
    """Write theta5 (count,) of frames from turning directions (count, 3)."""
    for i in range(count):
        theta5[i] = theta5_of(at(frames, 9 * i), vector(turning, 3 * i))
    return 0


_ANGLES = CFUNCTYPE(INTEGER, WORD, *[NUMBERS] * 3)


def _locate(
    count, segments, lines, passages, spans, route, position, rotation, near, passage, places
):
    """Write passages (count,) and places (count, PLACE) of robots on their routes."""
    for i in range(count):
        way, place, frame = route[i], at(places, PLACE * i), at(rotation, 9 * i)
        robot = vector(position, 3 * i)
        s, here = nearest(segments, lines[2 * way], lines[2 * way + 1], robot, near[i])
        point, tangent, normal, curvature = place_on(at(segments, here * COLUMNS), s)
        aside = minus(robot, point)
        passage[i] = passage_at(passages, spans[2 * way], spans[2 * way + 1], s)
        turning = turning_at(passages, passage[i], s, normal)
        place[DISTANCE], place[OFFSET], place[CURVATURE] = s, length(aside), curvature
        place[TILT] = angle_between((frame[2], frame[5], frame[8]), tangent)
        place[THETA5] = theta5_of(frame, turning)
        put_vector(place, ASIDE, aside)
        put_vector(place, TANGENT, tangent)
        put_vector(place, NORMAL, normal)
        put_vector(place, TURNING, turning)
    return 0


_LOCATE = CFUNCTYPE(
    INTEGER, WORD, NUMBERS, WORDS, NUMBERS, WORDS, WORDS, *[NUMBERS] * 3, WORDS, NUMBERS
)


def _turnings(count, segments, lines, passages, spans, route, passage, s, turning):
    """Write turning directions (count, 3) at arc lengths; see ``RouteMap._turning``."""
    for i in range(count):
        way, q = route[i], passage[i]
        here = segment_at(segments, lines[2 * way], lines[2 * way + 1], s[i])
        normal = place_on(at(segments, here * COLUMNS), s[i])[2]
        if q < 0:
            q = passage_at(passages, spans[2 * way], spans[2 * way + 1], s[i])
        put_vector(turning, 3 * i, turning_at(passages, q, s[i], normal))
    return 0


_TURNINGS = CFUNCTYPE(INTEGER, WORD, NUMBERS, WORDS, NUMBERS, WORDS, WORDS, WORDS, NUMBERS, NUMBERS)


@compiled
def progress_of(passage, frame):
    """Return by which share a robot has turned into a passage; see ``RouteMap.progress``."""
    axis = (frame[2], frame[5], frame[8])
    towards, along = dot(axis, vector(passage, DIRECTION)), dot(axis, vector(passage, AHEAD))
    return math.atan2(towards, along) / passage[TURN]


def _progress(count, passages, passage, rotation, share):
    """Write the shares (count,) of turns; see ``RouteMap.progress``."""
    for i in range(count):
        share[i] = progress_of(at(passages, PASSAGE * passage[i]), at(rotation, 9 * i))
    return 0


_PROGRESS = CFUNCTYPE(INTEGER, WORD, NUMBERS, WORDS, NUMBERS, NUMBERS)


def _turned(tangent: Array, normal: Array, turn: Array) -> Array:
    """Frames (n, 3, 3) along ``tangent``, their x axes turned by ``turn`` (n,) from ``normal``."""
    side = rotations.cross(tangent, normal)
    x = np.cos(turn)[:, None] * normal + np.sin(turn)[:, None] * side
    return np.stack([x, rotations.cross(tangent, x), tangent], axis=-1)
