"""The centreline of a route: straight lines and circular arcs, by arc length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, dot, frame_of

SEARCH = 0.15
"""Distance from the last known arc length that ``locate`` searches, m: routes may come close to
themselves."""


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
        rows = np.empty((len(segments), _COLUMNS))
        for i, (segment, begin) in enumerate(zip(segments, start, strict=True)):
            k = segment.curvature
            rows[i, _START], rows[i, _LENGTH], rows[i, _CURVATURE] = begin, segment.length, k
            # Both branches of np.where are evaluated: on lines the arc's formulas divide by this 1
            # unused.
            rows[i, _SAFE_CURVATURE] = 1.0 if k == 0 else k
            rows[i, _POINT], rows[i, _TANGENT] = segment.point, segment.tangent
            rows[i, _NORMAL], rows[i, _SIDE] = segment.normal, side
            angle = np.array([segment.length * k])
            side = _carried(side[None], segment.tangent[None], segment.normal[None], angle)[0]
        # Lines at the ends go on; arcs there are not continued round: the pipe is.
        rows[:, _LOWEST], rows[:, _HIGHEST] = 0.0, rows[:, _LENGTH]
        if segments[0].curvature == 0:
            rows[0, _LOWEST] = -np.inf
        if segments[-1].curvature == 0:
            rows[-1, _HIGHEST] = np.inf
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
        self._first = np.cumsum(self._count) - self._count  # (W,) first segment of each line
        self._last = self._first + self._count - 1
        self._begins = np.full((len(counts), max(counts)), np.inf)  # (W, most segments) m
        self.lengths = np.empty(len(counts))  # (W,) m
        self._within_search = 1
        for line, (first, count) in enumerate(zip(self._first, counts, strict=True)):
            start = rows[first : first + count, _START]
            self._begins[line, :count] = start
            # Added in order, as `Route.length` does: NumPy's pairwise sum may differ in the last
            # bit.
            self.lengths[line] = sum(rows[first : first + count, _LENGTH].tolist())
            # Most segments that a stretch of twice SEARCH touches: the last of them begins at its
            # end.
            lowest = np.searchsorted(start, start - 2 * SEARCH, side="right").clip(1) - 1
            touched = int((np.arange(count) - lowest).max()) + 1
            self._within_search = max(self._within_search, touched)
        self._offsets = np.arange(self._within_search)

    @property
    def length(self) -> float:
        """Length of the line, m; of the first one where several are kept together."""
        return float(self.lengths[0])

    @property
    def is_straight(self) -> bool:
        """True if the line has no arc."""
        return not np.count_nonzero(self._rows[:, _CURVATURE])

    def at(
        self, s: Array, line: NDArray[np.intp] | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Return point, tangent, normal (n, 3) and curvature (n,) 1/m at arc length (n,) m.

        The normal points into the bend.

        On a straight the normal is the side of the frame. ``line`` (n,): which of several lines;
        None: the first.
        """
        s = np.asarray(s, float)
        rows = self._rows.take(self._segment(s, line), axis=0)
        return _along(rows, s - rows[:, _START])

    def tangents(self, s: Array, line: NDArray[np.intp] | None = None) -> Array:
        """Tangents (n, 3) at arc length (n,) m, as ``at`` gives them."""
        rows = self._rows.take(self._segment(s, line), axis=0)
        t, n, curvature = rows[:, _TANGENT], rows[:, _NORMAL], rows[:, _CURVATURE]
        if not np.count_nonzero(curvature):
            return t + n * 0.0
        u = s - rows[:, _START]
        inside = np.minimum(np.maximum(u, 0.0), rows[:, _LENGTH])
        angle = (inside * curvature)[:, None]
        return t * np.cos(angle) + n * np.sin(angle)

    def straight(
        self, start: Array, end: Array, line: NDArray[np.intp] | None = None
    ) -> Array | None:
        """Return tangents (n, 3) of stretches from ``start`` to ``end`` (n,) m if all are straight.

        None where one does not lie on a straight.
        """
        first, last = self._segment(start, line), self._segment(end, line)
        # Compared as bytes, which is faster than element by element for the few robots of a batch.
        if first.tobytes() != last.tobytes():
            return None
        rows = self._rows.take(first, axis=0)
        if np.count_nonzero(rows[:, _CURVATURE]):
            return None
        return rows[:, _TANGENT] + rows[:, _NORMAL] * 0.0

    def frame(self, s: Array, line: NDArray[np.intp] | None = None) -> Array:
        """Return the route's frames (n, 3, 3) at arc length (n,) m.

        z is the tangent, x is carried without twist.
        """
        return self.at_with_frame(s, line)[1]

    def at_with_frame(
        self, s: Array, line: NDArray[np.intp] | None = None
    ) -> tuple[tuple[Array, Array, Array, Array], Array]:
        """What ``at`` and ``frame`` give, which look up the same segments."""
        s = np.asarray(s, float)
        rows = self._rows.take(self._segment(s, line), axis=0)
        u = s - rows[:, _START]
        angle = np.minimum(np.maximum(u, 0.0), rows[:, _LENGTH]) * rows[:, _CURVATURE]
        x = _carried(rows[:, _SIDE], rows[:, _TANGENT], rows[:, _NORMAL], angle)
        place = _along(rows, u)
        return place, frame_of(x, place[1])

    def locate(
        self, points: Array, near: Array | None = None, line: NDArray[np.intp] | None = None
    ) -> Array:
        """Arc length (n,) m of the centreline's point nearest to each of ``points`` (n, 3) m.

        With ``near`` (n,) m only arc lengths within ``SEARCH`` of it are looked at. ``line`` (n,):
        see ``at``.
        """
        rows = self._rows.take(self._candidates(len(points), near, line), axis=0)
        tangent, normal = rows[..., _TANGENT], rows[..., _NORMAL]  # (n, S, 3)
        low, high, k = rows[..., _LOWEST], rows[..., _HIGHEST], rows[..., _SAFE_CURVATURE]
        offset = points[:, None] - rows[..., _POINT]
        along = dot(offset, tangent)
        # Most robots are on straights most of the time: no sines then.
        if not np.count_nonzero(rows[..., _CURVATURE]):
            u = np.minimum(np.maximum(along, low), high)
            miss = offset - u[..., None] * tangent
        else:
            straight, across = rows[..., _CURVATURE] == 0, dot(offset, normal)
            # The angle about the arc's centre, which lies 1/k along the normal.
            u = np.where(straight, along, np.arctan2(along * k, 1 - across * k) / k)
            u = np.minimum(np.maximum(u, low), high)
            angle = u * k
            reach = np.where(straight, u, np.sin(angle) / k)
            bend = np.where(straight, 0.0, (1 - np.cos(angle)) / k)
            miss = offset - reach[..., None] * tangent - bend[..., None] * normal
        s = u + rows[..., _START]
        if s.shape[1] == 1:
            return s[:, 0]
        squared = dot(miss, miss)
        if near is not None:
            # A penalty far above any squared distance, m², instead of a masked search.
            squared = squared + 1e6 * (np.abs(s - near[:, None]) > SEARCH)
        return s[np.arange(len(s)), squared.argmin(axis=1)]

    def nearest(
        self, points: Array, near: Array, line: NDArray[np.intp] | None = None
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Arc length (n,) m of the nearest point, and what ``at`` gives there.

        Where the foot of every point lies within the segment that ``near`` (n,) m is on, no other
        one is looked at; otherwise as ``locate``. Arguments as there.
        """
        rows = self._rows.take(self._segment(near, line), axis=0)
        offset = points - rows[:, _POINT]
        u = dot(offset, rows[:, _TANGENT])
        if np.count_nonzero(rows[:, _CURVATURE]):
            k, across = rows[:, _SAFE_CURVATURE], dot(offset, rows[:, _NORMAL])
            u = np.where(rows[:, _CURVATURE] == 0, u, np.arctan2(u * k, 1 - across * k) / k)
        # A foot at an end of its segment may really lie on the neighbour: that takes the full
        # search.
        within = (u > rows[:, _LOWEST]) & (u < rows[:, _HIGHEST])
        if np.count_nonzero(within) == len(u):
            s = u + rows[:, _START]
            return (s, *_along(rows, s - rows[:, _START]))
        s = self.locate(points, near, line)
        return (s, *self.at(s, line))

    def _candidates(
        self, count: int, near: Array | None, line: NDArray[np.intp] | None
    ) -> NDArray[np.intp]:
        """Return segments (n, S) on which the nearest point may lie; the last one fills up rows."""
        # Only the segments within reach are looked at, so that a long route costs no more than a
        # short one.
        if near is None:
            line = np.zeros(count, np.intp) if line is None else line
            every = self._first[line][:, None] + np.arange(self._count.max())
            return np.minimum(every, self._last[line][:, None])
        last = len(self._rows) - 1 if line is None else self._last[line][:, None]
        return np.minimum(self._segment(near - SEARCH, line)[:, None] + self._offsets, last)

    def _segment(self, s: Array, line: NDArray[np.intp] | None) -> NDArray[np.intp]:
        """Segment (n,) that arc length (n,) m lies on."""
        if line is None:
            begins = self._begins[0, : self._count[0]]
            return np.maximum(begins.searchsorted(s, side="right") - 1, 0)
        # Counting the begins behind s serves lines of different lengths at once; padding is
        # infinite.
        passed = np.add.reduce(self._begins[line] <= s[:, None], axis=1, dtype=np.intp)
        return self._first[line] + np.maximum(passed - 1, 0)


# Columns of the table of segments.
_START, _LENGTH, _CURVATURE, _SAFE_CURVATURE, _LOWEST, _HIGHEST = range(6)
_POINT, _TANGENT, _NORMAL, _SIDE = (slice(i, i + 3) for i in range(6, 18, 3))
_COLUMNS = 18


def _along(rows: Array, u: Array) -> tuple[Array, Array, Array, Array]:
    """Result of ``Centreline.at``, ``u`` (n,) m into segments (n, columns)."""
    inside = np.minimum(np.maximum(u, 0.0), rows[:, _LENGTH])
    t, n, curvature = rows[:, _TANGENT], rows[:, _NORMAL], rows[:, _CURVATURE]
    along = inside[:, None]
    if not np.count_nonzero(curvature):
        # As below with an angle of zero, to the bit.
        tangent, normal = t + n * 0.0, rows[:, _SIDE]
        way_in = along * t
    else:
        straight = (curvature == 0)[:, None]
        angle = (inside * curvature)[:, None]
        sin, cos = np.sin(angle), np.cos(angle)
        tangent = t * cos + n * sin
        normal = np.where(straight, rows[:, _SIDE], n * cos - t * sin)
        arc = (t * sin + n * (1 - cos)) / rows[:, _SAFE_CURVATURE, None]
        way_in = np.where(straight, along * t, arc)
    # Beyond the segment's end the line goes on along its last tangent, without curvature.
    point = rows[:, _POINT] + way_in + (u - inside)[:, None] * tangent
    return point, tangent, normal, curvature * (u == inside)


def _carried(side: Array, tangent: Array, normal: Array, angle: Array) -> Array:
    """Carry vectors (n, 3) without twist through a bend by ``angle`` (n,) rad to the normal."""
    angle = angle[:, None]
    along_n = dot(side, normal)[:, None]
    # Only the part of the vector in the plane of the bend turns; what is square to it stays.
    across = side - along_n * normal
    return across + along_n * (normal * np.cos(angle) - tangent * np.sin(angle))
