"""Compiled functions by which a fitting states its wall, and what such functions share.

They are Python on numbers, marked by ``compiled``, and may use ``math``, numbers that their module
defines in capitals, and other marked functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBERS,
    WORD,
    at,
    c_function,
    call_surface,
    compiled,
    pointers,
)

SOLID = 9
"""Index in the sizes of a wall of several solids of the one that is asked for, from 1 on; 0 for all
together. Each touches bodies by itself: a ball in the corner between two has two contacts."""
FACE, EDGE = 0.0, 1.0
"""Nearest part of a wall: a face such as a cylinder, cone or torus; or a rounded rim, the edge of a
cone."""
LOW, HIGH, LOW_ENDS, HIGH_ENDS = 0, 1, 2, 3
"""Indices of a span in ``out``: the part of a line [low, high], m, and whether contact ends there
(over 0)."""


@compiled
def unknown(_sizes, _px, _py, _pz, _ax, _ay, _az):
    """See ``Wall``: for any fitting; rays then find its wall by its ``surface`` alone."""
    return 0.0


@dataclass(frozen=True)
class Wall:
    """The wall of a kind of fitting as compiled functions, for contact, rays and distances.

    Attributes:
        surface: ``surface(sizes, x, y, z, out)`` returns the distance, m, of a point of the fitting
            frame from the wall, positive in the bore; it writes the unit gradient to ``out[0]`` to
            ``out[2]`` and ``FACE`` or ``EDGE`` to ``out[3]``. ``sizes`` are those of the fitting.
        span: ``span(sizes, ends, px, py, pz, ax, ay, az, out)`` narrows the part [low, high], m, of
            the line p + s a that lies at this fitting's wall. ``out`` holds a span already (see
            ``LOW``); ``clip`` narrows it at a plane. ``ends[i]`` is over 0 where the wall stops
            carrying a track at the i-th port. Returns 1.0, or 0.0 where a line can touch the wall
            at the ends of the span only, as in a straight.
        clear: ``clear(sizes, px, py, pz, ax, ay, az)`` returns how far, m, the line p + s a, of
            unit vector a, leads through the bore for certain, up to the wall at most; port planes
            do not count. 0.0 where p is not in the bore or it is not known. Only rays ask for it,
            which are followed the faster the farther it leads.
        solids: number of solids that it is made of, which ``surface`` knows by ``SOLID``.
    """

    surface: Callable[..., float]
    span: Callable[..., float]
    clear: Callable[..., float] = unknown
    solids: int = 1


@compiled
def clip(out, value, slope, ends):
    """Keep the part of the span in ``out`` where value + slope s <= 0.

    ``ends`` is over 0 where contact ends there.
    """
    if abs(slope) < 1e-14:
        if value > 0.0:
            out[HIGH] = out[LOW] - 1.0
    elif slope > 0.0:
        s = -value / slope
        if s < out[HIGH]:
            out[HIGH], out[HIGH_ENDS] = s, ends
    else:
        s = -value / slope
        if s > out[LOW]:
            out[LOW], out[LOW_ENDS] = s, ends


@compiled
def part_within(low, high, value, slope):
    """Return the part of [low, high] where value + slope s <= 0."""
    if slope > 0.0:
        return low, min(high, -value / slope)
    if slope < 0.0:
        return max(low, -value / slope), high
    return (low, high) if value <= 0.0 else (math.inf, -math.inf)


@compiled
def put(out, x, y, z, face):
    """Write a gradient and a face to ``out``."""
    out[0], out[1], out[2], out[3] = x, y, z, face


@compiled
def crossing(a, b, c):
    """Return the least positive root of s² a + 2 b s + c, positive at 0; infinite for none."""
    under = b * b - a * c
    # Without a real root the quadratic stays positive: the line never leaves.
    if under < 0.0:
        return math.inf
    root = math.sqrt(under)
    # The form of the quadratic's root that adds numbers of one sign, and so loses no digits.
    if b > 0.0:
        return (b + root) / -a if a < 0.0 else math.inf
    return c / (root - b) if root > b else math.inf


@compiled
def in_bore(x, y, ax, ay, radius):
    """Return the part [low, high] of a line that is in a round bore; high below low where none is.

    The line goes from a point (x, y) across the bore in a direction (ax, ay).
    """
    a, b, c = ax * ax + ay * ay, x * ax + y * ay, x * x + y * y - radius * radius
    under = b * b - a * c
    # Along the axis (a = 0) a line is in the bore everywhere or nowhere.
    if a < 1e-20 or under <= 0.0:
        return (-math.inf, math.inf) if c < 0.0 and a < 1e-20 else (math.inf, -math.inf)
    root = math.sqrt(under)
    return (-b - root) / a, (root - b) / a


@compiled
def out_of_two(low, high, other_low, other_high):
    """Return where a line from 0 on leaves the union of two parts of it; 0.0 if it is in none."""
    if not low < 0.0 < high:
        if not other_low < 0.0 < other_high:
            return 0.0
        low, high, other_low, other_high = other_low, other_high, low, high
    # Where the parts overlap the line passes from one into the other.
    return max(high, other_high) if other_low <= high else high


def distances(surface: int, sizes: Sequence[float], points: Array) -> tuple[Array, Array]:
    """Evaluate a compiled ``surface`` at many points.

    Args:
        surface: its address.
        sizes: of the fitting.
        points: (..., 3) m, fitting frame.

    Returns:
        Distances (...,) m from the wall, positive in the bore, and unit gradients (..., 3).
    """
    points = np.ascontiguousarray(points, float)
    rows = np.empty((*points.shape[:-1], 5))
    evaluate = c_function(_at_points, _AT_POINTS).ctypes
    evaluate(surface, *pointers(np.array(sizes), points), points.size // 3, *pointers(rows))
    return rows[..., 0], rows[..., 1:4]


def _at_points(surface, sizes, points, count, rows):
    """Evaluate ``surface`` at points (count, 3) into ``rows`` (count, 5).

    A row has the distance, and what ``surface`` writes to its ``out``.
    """
    for i in range(count):
        x, y, z = points[3 * i], points[3 * i + 1], points[3 * i + 2]
        rows[5 * i] = call_surface(surface, sizes, x, y, z, at(rows, 5 * i + 1))
    return 0


_AT_POINTS = CFUNCTYPE(INTEGER, WORD, NUMBERS, NUMBERS, WORD, NUMBERS)
