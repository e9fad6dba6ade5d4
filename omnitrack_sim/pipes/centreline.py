"""The centreline of a route: straight lines and circular arcs, by arc length."""

from __future__ import annotations

import math
from collections.abc import Sequence
from ctypes import CFUNCTYPE
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array, frame_of
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
from omnitrack_sim.pipes.vectors import dot, minus, over, plus, put_vector, scaled, vector

SEARCH = 0.15
"""Distance from the last known arc length that ``locate`` searches, m: routes may come close to
themselves."""
FAR = 1e6
"""Penalty of points beyond that, m²: far above any squared distance."""


@dataclass(frozen=True)
class Segment:
    """A line (curvature 0) or an arc, from ``point`` along ``tangent``, bent towards ``normal``.

    Attributes:
        length: m. curvature: 1/m.
        point: (3,) m. tangent, normal: (3,) unit vectors, world frame.
    """

    length: float
    curvature: float
    point: Array
    tangent: Array
    normal: Array


class Centreline:
    """Map from arc length to point, tangent, normal and curvature, and back.

    Beyond its ends the line continues straight. Several lines may be kept together, so that points
    on different ones are looked up at once: ``line`` then says which.
    """

    def __init__(self, segments: Sequence[Segment], side: Array):
        """``side`` (3,) is the x axis of the frame at the start, across the first tangent."""
        start = np.cumsum([0.0, *(s.length for s in segments[:-1])])  # (S,) m
        rows = np.empty((len(segments), COLUMNS))
        for i, (segment, begin) in enumerate(zip(segments, start, strict=True)):
            k = segment.curvature
            rows[i, START], rows[i, LENGTH], rows[i, CURVATURE] = begin, segment.length, k
            for column, values in (
                (POINT, segment.point),
                (TANGENT, segment.tangent),
                (NORMAL, segment.normal),
                (SIDE, side),
            ):
                rows[i, column : column + 3] = values
            side = np.array(carried(side, segment.tangent, segment.normal, segment.length * k))
        # Lines at the ends go on; arcs there are not continued round: the pipe is.
        rows[:, LOWEST], rows[:, HIGHEST] = 0.0, rows[:, LENGTH]
        if segments[0].curvature == 0:
            rows[0, LOWEST] = -np.inf
        if segments[-1].curvature == 0:
            rows[-1, HIGHEST] = np.inf
        self._index(rows, [len(segments)])

    @classmethod
    def together(cls, lines: Sequence[Centreline]) -> Centreline:
        """Lines kept together; ``line`` k is the k-th of them."""
        bundle = cls.__new__(cls)
        counts = [int(count) for line in lines for count in line._count]
        bundle._index(np.concatenate([line._rows for line in lines]), counts)
        return bundle

    def _index(self, rows: Array, counts: Sequence[int]) -> None:
        """Build the look-up tables of lines of ``counts`` segments each."""
        self._rows = rows
        self._count = np.array(counts)
        first = np.cumsum(self._count) - self._count
        # (W, 2) first and last segment of each line
        self._spans = np.stack([first, first + self._count - 1], axis=1).astype(np.int64)
        # Added in order, as `Route.length` does: NumPy's pairwise sum may differ in the last bit.
        self.lengths = np.array(
            [sum(rows[a : b + 1, LENGTH].tolist()) for a, b in self._spans]
        )  # (W,) m

    @property
    def length(self) -> float:
        """Length of the line, m; of the first one where several are kept together."""
        return float(self.lengths[0])

    @property
    def is_straight(self) -> bool:
        """True if the line has no arc."""
        return not np.count_nonzero(self._rows[:, CURVATURE])

    def at(
        self, s: ArrayLike, line: NDArray[np.intp] | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Return point, tangent, normal (n, 3) and curvature (n,) 1/m at arc length (n,) m.

        The normal points into the bend.

        On a straight the normal is the side of the frame. ``line`` (n,): which of several lines;
        None: the first.
        """
        return self.at_with_frame(s, line)[0]

    def frame(self, s: Array, line: NDArray[np.intp] | None = None) -> Array:
        """Return the route's frames (n, 3, 3) at arc length (n,) m.

        z is the tangent, x is carried without twist.
        """
        return self.at_with_frame(s, line)[1]

    def at_with_frame(
        self, s: ArrayLike, line: NDArray[np.intp] | None = None
    ) -> tuple[tuple[Array, Array, Array, Array], Array]:
        """What ``at`` and ``frame`` give, which look up the same segments."""
        s = np.ascontiguousarray(s, float)
        places = np.empty((len(s), PLACE))
        c_function(_places, _PLACES).ctypes(
            len(s), *self.tables, *pointers(self._line(line, len(s)), s, places)
        )
        point, tangent, normal, x = (places[:, i : i + 3] for i in range(0, 12, 3))
        return (point, tangent, normal, places[:, PLACE - 1]), frame_of(x, tangent)

    def locate(
        self, points: Array, near: Array | None = None, line: NDArray[np.intp] | None = None
    ) -> Array:
        """Arc length (n,) m of the centreline's point nearest to each of ``points`` (n, 3) m.

        With ``near`` (n,) m only arc lengths within ``SEARCH`` of it are looked at. ``line`` (n,):
        see ``at``.
        """
        count = len(points)
        points, found = np.ascontiguousarray(points, float), np.empty(count)
        near = np.full(count, np.nan) if near is None else np.ascontiguousarray(near, float)
        c_function(_distances, _DISTANCES).ctypes(
            count, *self.tables, *pointers(self._line(line, count), points, near, found)
        )
        return found

    @property
    def arrays(self) -> tuple[Array, NDArray[np.int64]]:
        """Segments (S, COLUMNS), and first and last one of each line (W, 2)."""
        return self._rows, self._spans

    @property
    def tables(self) -> list[Any]:
        """Pointers to the ``arrays``."""
        return pointers(*self.arrays)

    def _line(self, line: NDArray[np.intp] | None, count: int) -> NDArray[np.int64]:
        """Return the number of the line (n,) of each of ``count`` points."""
        return np.zeros(count, np.int64) if line is None else np.ascontiguousarray(line, np.int64)


# Columns of the table of segments.
START, LENGTH, CURVATURE, LOWEST, HIGHEST, POINT, TANGENT, NORMAL, SIDE = (
    0,
    1,
    2,
    3,
    4,
    5,
    8,
    11,
    14,
)
COLUMNS = 17
PLACE = 13
"""Numbers of a place on a line: point, tangent, normal, x axis of the frame, curvature."""


@compiled
def segment_at(segments, first, last, s):
    """Return which segment, of first to last, arc length ``s`` m lies on."""
    while first < last:
        middle = (first + last + 1) // 2
        if segments[middle * COLUMNS + START] <= s:
            first = middle
        else:
            last = middle - 1
    return first


@compiled
def place_on(segment, s):
    """Return point, tangent, normal and curvature of a segment's line at arc length ``s`` m.

    Beyond the segment's ends the line goes on along its tangents there, without curvature.
    """
    u, k = s - segment[START], segment[CURVATURE]
    inside = min(max(u, 0.0), segment[LENGTH])
    t, n = vector(segment, TANGENT), vector(segment, NORMAL)
    if k == 0.0:
        # A product with zero is added as in a bend: there is no negative zero.
        tangent, normal, way = plus(t, scaled(n, 0.0)), vector(segment, SIDE), scaled(t, inside)
    else:
        sin, cos = math.sin(inside * k), math.cos(inside * k)
        tangent = plus(scaled(t, cos), scaled(n, sin))
        normal = minus(scaled(n, cos), scaled(t, sin))
        way = over(plus(scaled(t, sin), scaled(n, 1.0 - cos)), k)
    point = plus(plus(vector(segment, POINT), way), scaled(tangent, u - inside))
    return point, tangent, normal, k if u == inside else 0.0


@compiled
def carried(side, tangent, normal, angle):
    """Carry a vector without twist through a bend by ``angle`` rad to the normal."""
    along = dot(side, normal)
    # Only the part of the vector in the plane of the bend turns; what is square to it stays.
    across = minus(side, scaled(normal, along))
    turned = minus(scaled(normal, math.cos(angle)), scaled(tangent, math.sin(angle)))
    return plus(across, scaled(turned, along))


@compiled
def foot_on(segment, place):
    """Return how far, m, the point nearest to ``place`` lies into a segment's endless line."""
    offset, k = minus(place, vector(segment, POINT)), segment[CURVATURE]
    along = dot(offset, vector(segment, TANGENT))
    if k == 0.0:
        return along
    # The angle about the arc's centre, which lies 1/k along the normal.
    return math.atan2(along * k, 1.0 - dot(offset, vector(segment, NORMAL)) * k) / k


@compiled
def nearest(segments, first, last, place, near):
    """Return the arc length, m, of a line's point nearest to ``place``, and its segment.

    Args:
        segments: table of them.
        first: segment of the line.
        last: segment of the line.
        place: m.
        near: m, arc length within ``SEARCH`` of which it is searched; not a number: everywhere.
    """
    here = segment_at(segments, first, last, near)
    segment = at(segments, here * COLUMNS)
    u = foot_on(segment, place)
    # A foot at an end of its segment may really lie on the neighbour: that takes the search.
    if not math.isnan(near) and segment[LOWEST] < u < segment[HIGHEST]:
        return u + segment[START], here
    begin, reach = first, math.inf
    if not math.isnan(near):
        begin, reach = segment_at(segments, first, last, near - SEARCH), SEARCH
    least, found, here = math.inf, math.nan, begin
    for i in range(begin, last + 1):
        segment = at(segments, i * COLUMNS)
        if segment[START] > near + reach:
            break
        u = min(max(foot_on(segment, place), segment[LOWEST]), segment[HIGHEST])
        s = u + segment[START]
        miss = minus(place, place_on(segment, s)[0])
        # A penalty far above any squared distance, m², beyond the reach of the search.
        squared = dot(miss, miss) + (FAR if abs(s - near) > reach else 0.0)
        if squared < least:
            least, found, here = squared, s, i
    return found, here


def _places(count, segments, spans, line, s, places):
    """Write what each arc length is at to ``places`` (count, PLACE)."""
    for i in range(count):
        first, last = spans[2 * line[i]], spans[2 * line[i] + 1]
        segment = at(segments, segment_at(segments, first, last, s[i]) * COLUMNS)
        point, tangent, normal, curvature = place_on(segment, s[i])
        k, inside = segment[CURVATURE], min(max(s[i] - segment[START], 0.0), segment[LENGTH])
        sides = vector(segment, SIDE), vector(segment, TANGENT), vector(segment, NORMAL)
        put_vector(places, PLACE * i, point)
        put_vector(places, PLACE * i + 3, tangent)
        put_vector(places, PLACE * i + 6, normal)
        put_vector(places, PLACE * i + 9, carried(sides[0], sides[1], sides[2], inside * k))
        places[PLACE * i + 12] = curvature
    return 0


_PLACES = CFUNCTYPE(INTEGER, WORD, NUMBERS, WORDS, WORDS, NUMBERS, NUMBERS)


def _distances(count, segments, spans, line, points, near, found):
    """Write the arc length nearest to each of ``points`` (count, 3) to ``found`` (count,)."""
    for i in range(count):
        first, last = spans[2 * line[i]], spans[2 * line[i] + 1]
        found[i] = nearest(segments, first, last, vector(points, 3 * i), near[i])[0]
    return 0


_DISTANCES = CFUNCTYPE(INTEGER, WORD, NUMBERS, WORDS, WORDS, *[NUMBERS] * 3)
