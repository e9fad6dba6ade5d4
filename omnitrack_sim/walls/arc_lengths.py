"""Places of points along the axes of pipes: compiled, for any number of points and parts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from ctypes import CFUNCTYPE

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Part
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import INTEGER, NUMBERS, WORD, c_function, pointers

LINE, BEGIN, LENGTH, CURVATURE, POINT, TANGENT, NORMAL, ROW = 0, 1, 2, 3, 4, 7, 10, 13
"""Indices in the row of a segment, and its size: number of the line among those of its part, arc
length at which it begins, m, length, m, curvature, 1/m, and first point (3), tangent (3) and normal
(3), world frame."""
ANSWER = 5
"""Numbers of an answer: arc length, m, tangent (3), number of the line."""
_ALONG = CFUNCTYPE(INTEGER, NUMBERS, NUMBERS, NUMBERS, NUMBERS, WORD, NUMBERS)


class Axes:
    """Axes of placed parts, to look points up on.

    Args:
        parts: of an assembly.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        rows, ends = [], [0]
        for part in parts:
            for number, axis in enumerate(part.fitting.axes):
                begin = 0.0
                for segment in part.segments(axis.curve):
                    along = [number, begin, segment.length, segment.curvature]
                    rows.append([*along, *segment.point, *segment.tangent, *segment.normal])
                    begin += segment.length
            ends.append(len(rows))
        self._rows, self._ends = np.array(rows), np.array(ends, float)

    def along(self, points: Array, parts: Array) -> tuple[Array, Array, Array]:
        """Look up the nearest place on the axes of the part that each point lies in.

        Args:
            points: (n, 3) m, world frame.
            parts: (n,) number of the part, negative for none.

        Returns:
            Arc lengths (n,) m and unit tangents (n, 3), NaN for points in no part; and which of the
            part's lines it is (n,), -1 for none.
        """
        answers = np.empty((len(points), ANSWER))
        arrays = self._rows, self._ends, np.ascontiguousarray(points), np.ascontiguousarray(parts)
        along = c_function(_along, _ALONG).ctypes
        along(*pointers(*arrays), len(points), *pointers(answers))
        return answers[:, 0], answers[:, 1:4], answers[:, 4]


@compiled
def _on_segment(rows, r, x, y, z):
    """Arc length from the beginning of a segment to the place on it nearest to a point, and the
    squared distance."""
    dx, dy, dz = x - rows[r + POINT], y - rows[r + POINT + 1], z - rows[r + POINT + 2]
    t, n = r + TANGENT, r + NORMAL
    ahead = dx * rows[t] + dy * rows[t + 1] + dz * rows[t + 2]
    aside = dx * rows[n] + dy * rows[n + 1] + dz * rows[n + 2]
    square, k, length = dx * dx + dy * dy + dz * dz, rows[r + CURVATURE], rows[r + LENGTH]
    if k == 0.0:
        s = min(max(ahead, 0.0), length)
        return s, square - ahead * ahead + (ahead - s) * (ahead - s)
    # Behind the start by less than half of what the arc leaves of the circle counts as the start.
    angle = math.atan2(ahead * k, 1.0 - aside * k)
    if angle < 0.5 * length * k - math.pi:
        angle += 2.0 * math.pi
    s = min(max(angle / k, 0.0), length)
    a, b = ahead - math.sin(s * k) / k, aside - (1.0 - math.cos(s * k)) / k
    return s, square - ahead * ahead - aside * aside + a * a + b * b


def _along(rows, ends, points, parts, count, answers):
    """Write the answers (count, ANSWER) of points (count, 3) in parts (count,), see ``Axes``."""
    for i in range(count):
        a, best = ANSWER * i, math.inf
        for j in range(4):
            answers[a + j] = math.nan
        answers[a + 4] = -1.0
        if parts[i] < 0.0:
            continue
        for row in range(int(ends[int(parts[i])]), int(ends[int(parts[i]) + 1])):
            r = ROW * row
            s, square = _on_segment(rows, r, points[3 * i], points[3 * i + 1], points[3 * i + 2])
            if square < best:
                best, k = square, rows[r + CURVATURE]
                answers[a], answers[a + 4] = rows[r + BEGIN] + s, rows[r + LINE]
                for j in range(3):
                    tangent, normal = rows[r + TANGENT + j], rows[r + NORMAL + j]
                    answers[a + 1 + j] = math.cos(s * k) * tangent + math.sin(s * k) * normal
    return 0
