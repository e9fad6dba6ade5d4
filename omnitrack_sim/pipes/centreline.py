"""The centreline of a route: straight lines and circular arcs, by arc length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.rotations import Array, cross, dot

SEARCH = 0.15
"""How far from the last known arc length ``locate`` looks, m: routes may come close to
themselves."""


@dataclass(frozen=True)
class Segment:
    """A line (curvature 0) or arc that starts at ``point`` along ``tangent`` and bends towards
    ``normal``.

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
    """Arc length -> point, tangent, normal, curvature; and back. Beyond its ends it goes on
    straight.

    Several lines may be kept together, so that points on different ones are found at once: ``way``
    then says which.
    """

    def __init__(self, segments: Sequence[Segment], side: Array):
        """``side`` (3,) is the x axis of the frame at the start, across the first tangent."""
        self._start = np.cumsum([0.0, *(s.length for s in segments[:-1])])  # (S,) m
        self._length = np.array([s.length for s in segments])
        self._curvature = np.array([s.curvature for s in segments])
        self._point, self._tangent, self._normal = (
            np.array([getattr(s, name) for s in segments])
            for name in ("point", "tangent", "normal")
        )  # (S, 3)
        self._side = np.empty_like(
            self._point
        )  # x axis of the rotation-minimising frame at each segment's start
        for i, segment in enumerate(segments):
            self._side[i] = side
            angle = np.array([segment.length * segment.curvature])
            side = _carried(side[None], segment.tangent[None], segment.normal[None], angle)[0]
        straight = self._curvature == 0
        self._lowest = np.where(np.arange(len(segments)) == 0, -np.inf, 0.0)
        self._highest = np.where(
            np.arange(len(segments)) == len(segments) - 1, np.inf, self._length
        )
        # Arcs at the ends are not continued round: the pipe is.
        self._lowest[0] = self._lowest[0] if straight[0] else 0.0
        self._highest[-1] = self._highest[-1] if straight[-1] else self._length[-1]
        self._index([len(segments)])

    @classmethod
    def together(cls, lines: Sequence[Centreline]) -> Centreline:
        """Lines kept together; ``way`` k is the k-th of them."""
        bundle = cls.__new__(cls)
        for name in _PER_SEGMENT:
            setattr(bundle, name, np.concatenate([getattr(line, name) for line in lines]))
        bundle._index([int(count) for line in lines for count in line._count])
        return bundle

    def _index(self, counts: Sequence[int]) -> None:
        """What is looked up in segments that belong to lines of ``counts`` segments each."""
        self._count = np.array(counts)
        self._first = np.cumsum(self._count) - self._count  # (W,) first segment of each line
        self._straight = self._curvature == 0
        self._safe_curvature = np.where(self._straight, 1.0, self._curvature)
        self._begins = np.full((len(counts), max(counts)), np.inf)  # (W, most segments) m
        self.lengths = np.empty(len(counts))  # (W,) m
        self._within_search = 1
        for way, (first, count) in enumerate(zip(self._first, counts, strict=True)):
            start = self._start[first : first + count]
            self._begins[way, :count] = start
            self.lengths[way] = sum(self._length[first : first + count].tolist())
            # Most segments that a stretch of twice SEARCH touches: the last of them begins at its
            # end.
            lowest = np.searchsorted(start, start - 2 * SEARCH, side="right").clip(1) - 1
            self._within_search = max(
                self._within_search, int((np.arange(count) - lowest).max()) + 1
            )

    @property
    def length(self) -> float:
        """Length of the line, m; of the first one where several are kept together."""
        return float(self.lengths[0])

    @property
    def is_straight(self) -> bool:
        """Whether it has no arc."""
        return bool(self._straight.all())

    def at(
        self, s: Array, way: NDArray[np.intp] | None = None
    ) -> tuple[Array, Array, Array, Array]:
        """Point (n, 3) m, tangent (n, 3), normal (n, 3) towards the bend, curvature (n,) 1/m at arc
        length (n,) m.

        On a straight the normal is the side of the route's frame. ``way`` (n,): line of each; none:
        the first.
        """
        s = np.asarray(s, float)
        i = self._segment(s, way)
        u, k, straight = (
            s - self._start[i],
            self._safe_curvature[i][:, None],
            self._straight[i][:, None],
        )
        inside = np.clip(u, 0.0, self._length[i])
        angle = (inside * self._curvature[i])[:, None]
        t, n = self._tangent[i], self._normal[i]
        sin, cos = np.sin(angle), np.cos(angle)
        tangent, normal = t * cos + n * sin, n * cos - t * sin
        point = self._point[i] + np.where(
            straight, inside[:, None] * t, (t * sin + n * (1 - cos)) / k
        )
        point = point + (u - inside)[:, None] * tangent
        normal = np.where(straight, self._side[i], normal)
        return point, tangent, normal, np.where(u == inside, self._curvature[i], 0.0)

    def frame(self, s: Array, way: NDArray[np.intp] | None = None) -> Array:
        """Rotations (n, 3, 3) of the route's frame at arc length (n,) m: z the tangent, x carried
        without twist."""
        s = np.asarray(s, float)
        i = self._segment(s, way)
        angle = np.clip(s - self._start[i], 0.0, self._length[i]) * self._curvature[i]
        x = _carried(self._side[i], self._tangent[i], self._normal[i], angle)
        _, z, _, _ = self.at(s, way)
        return np.stack([x, cross(z, x), z], axis=-1)

    def locate(
        self, points: Array, near: Array | None = None, way: NDArray[np.intp] | None = None
    ) -> Array:
        """Arc length (n,) m of the centreline's point nearest to each of ``points`` (n, 3) m.

        With ``near`` (n,) m only arc lengths within ``SEARCH`` of it are looked at. ``way`` (n,):
        see ``at``.
        """
        # Only the segments within reach are looked at, so that a long route costs no more than a
        # short one.
        if near is None:
            way = np.zeros(len(points), np.intp) if way is None else way
            last = (self._first + self._count - 1)[way][:, None]
            i = np.minimum(self._first[way][:, None] + np.arange(self._count.max()), last)
        else:
            i = self._segment(near - SEARCH, way)[:, None] + np.arange(self._within_search)
            last = (
                len(self._start) - 1
                if way is None
                else (self._first + self._count - 1)[way][:, None]
            )
            i = np.minimum(i, last)
        tangent, normal = self._tangent[i], self._normal[i]  # (n, S, 3)
        offset = points[:, None] - self._point[i]
        along, across = dot(offset, tangent), dot(offset, normal)
        k, straight = self._safe_curvature[i], self._straight[i]
        u = np.where(straight, along, np.arctan2(along * k, 1 - across * k) / k)
        u = np.clip(u, self._lowest[i], self._highest[i])
        angle = u * k
        reach = np.where(straight, u, np.sin(angle) / k)
        bend = np.where(straight, 0.0, (1 - np.cos(angle)) / k)
        miss = offset - reach[..., None] * tangent - bend[..., None] * normal
        squared, s = dot(miss, miss), u + self._start[i]
        if near is not None:
            squared = squared + 1e6 * (np.abs(s - near[:, None]) > SEARCH)
        return s[np.arange(len(s)), np.argmin(squared, axis=1)]

    def _segment(self, s: Array, way: NDArray[np.intp] | None) -> NDArray[np.intp]:
        """Segment (n,) that arc length (n,) m lies on."""
        if way is None:
            return np.clip(
                np.searchsorted(self._begins[0], s, side="right") - 1, 0, int(self._count[0]) - 1
            )
        place = (self._begins[way] <= np.asarray(s)[:, None]).sum(axis=1) - 1
        return self._first[way] + np.clip(place, 0, self._count[way] - 1)


_PER_SEGMENT = (
    "_start",
    "_length",
    "_curvature",
    "_point",
    "_tangent",
    "_normal",
    "_side",
    "_lowest",
    "_highest",
)


def _carried(side: Array, tangent: Array, normal: Array, angle: Array) -> Array:
    """Vectors ``side`` (n, 3), carried without twist through a bend by ``angle`` (n,) rad from
    tangent to normal."""
    angle = angle[:, None]
    along_n = dot(side, normal)[:, None]
    across = side - along_n * normal
    return across + along_n * (normal * np.cos(angle) - tangent * np.sin(angle))
