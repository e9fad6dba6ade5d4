"""Rays against the exact walls, and distances of points from them, compiled.

A ray is followed as far as a fitting knows that the bore is clear along it (``Wall.clear``), from
there by steps of the distance to the wall (sphere tracing); both never pass through it. The wall
of a part is valid between its port planes only. A ray that leaves through an open end meets
nothing; one that leaves through a plate meets that; of one that leaves through a port beyond which
nothing is known, nothing is returned.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from ctypes import CFUNCTYPE
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Fitting, Part, Port
from omnitrack_sim.pipes.compiled import HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.pipes.fittings.base import MAX_SIZES
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBER,
    NUMBERS,
    WORD,
    at,
    c_function,
    call_clear,
    call_span,
    call_surface,
    doubles,
    pointers,
    scratch,
)
from omnitrack_sim.walls.record import long_sizes

SURFACE, SPAN, CLEAR, CENTRE, REACH, POSITION, ROTATION = 0, 1, 2, 3, 6, 7, 10
PORTS, PLANES, SIZES, LONG = 19, 20, 48, 58
"""Indices in the record of a part: addresses of its compiled functions; a ball around it (3 and its
radius, m); its pose (3 m, and 9 row by row); the number of its ports, and for each port its place
(3 m), its direction outward (3), world frame, and what is there; sizes, or the address of those
that are longer, and 0."""
OPEN, PLATE, UNKNOWN, UNSEEN = 0.0, 1.0, 2.0, 3.0
"""An open end; a plate; unexplored space behind a fitting's port, where there is a joint; the end
of the part of a straight that has been seen, where there may be none."""
PORT_SIZE, PART_SIZE = 7, 59
RANGE, NORMAL, PART, LIT, JOINT, GRAIN, HIT_SIZE = 0, 1, 4, 5, 6, 7, 8
"""Indices in what a ray has met: distance, m, infinite for nothing, NaN where it leaves through a
port beyond which nothing is known; the wall's unit normal (3) into the bore, world frame;
number of the part, from the first of its map, -1 for nothing, ``BEYOND`` in pipe whose end has not
been seen; how squarely the lamp shines on it: cosine of the angle from its normal, 0 in the dark;
distance from the nearest port plane, m; grain of the surface, -1 to 1, where it has one. The last
three are looked for only where there is a lamp."""
BEYOND = -2.0
"""The number of no part: what a ray meets at or beyond the end of the pipe that has been seen."""
NORMALS = slice(NORMAL, NORMAL + 3)
"""The normals among all that ``RayWalls.trace`` returns."""
SHORT = 1e-7
"""A step at least, m, which crosses port planes in spite of rounding."""
TOLERANCE = 1e-6
"""Room beyond a port plane, m, in which a part still counts: there are no gaps at joints."""
MAX_NEAR, NEAR, PORTS_ROOM = 32, 9, 8
"""Parts that one ray can meet, and numbers for each: the part, its span, the ray in its frame; and
room for one number a port."""


@compiled
def in_part(parts, p, x, y, z, row):
    """Return a coordinate of the world vector (x, y, z) in the frame of the part at ``p``."""
    r = p + ROTATION
    return parts[r + row] * x + parts[r + 3 + row] * y + parts[r + 6 + row] * z


@compiled
def sizes_at(parts, p):
    """Sizes of the part at ``p``."""
    return doubles(int(parts[p + LONG])) if parts[p + LONG] > 0.0 else at(parts, p + SIZES)


@compiled
def enter(parts, p, x, y, z, ux, uy, uz, line):
    """Write the ray x + s u, world frame, to ``line`` (6,) in the frame of the part at ``p``."""
    dx, dy, dz = x - parts[p + POSITION], y - parts[p + POSITION + 1], z - parts[p + POSITION + 2]
    for row in range(3):
        line[row] = in_part(parts, p, dx, dy, dz, row)
        line[3 + row] = in_part(parts, p, ux, uy, uz, row)


@compiled
def surface_at(parts, p, line, s, out):
    """Return the distance from the wall of the part at ``p`` at s on a line in its frame.

    The gradient goes to ``out``.
    """
    return call_surface(
        int(parts[p + SURFACE]),
        sizes_at(parts, p),
        line[0] + s * line[3],
        line[1] + s * line[4],
        line[2] + s * line[5],
        out,
    )


@compiled
def clear_from(parts, near, k, s):
    """Return how far, m, a ray leads through a part's bore for certain, from s on.

    The part is the k-th in ``near``.
    """
    p, line = int(near[NEAR * k]) * PART_SIZE, at(near, NEAR * k + 3)
    return call_clear(
        int(parts[p + CLEAR]),
        sizes_at(parts, p),
        line[0] + s * line[3],
        line[1] + s * line[4],
        line[2] + s * line[5],
        line[3],
        line[4],
        line[5],
    )


@compiled
def span_in(parts, p, line, ends, out):
    """Narrow ``out`` to the part of a line between the port planes of the part at ``p``.

    It goes from LOW to HIGH in ``out``.
    """
    call_span(
        int(parts[p + SPAN]),
        sizes_at(parts, p),
        ends,
        line[0],
        line[1],
        line[2],
        line[3],
        line[4],
        line[5],
        out,
    )


@compiled
def parts_around(parts, first, last, x, y, z, far, around):
    """Write the parts nearer to a place than ``far`` to ``around``; return their number."""
    count = 0
    for part in range(first, last):
        p = part * PART_SIZE
        cx, cy, cz = parts[p + CENTRE] - x, parts[p + CENTRE + 1] - y, parts[p + CENTRE + 2] - z
        within = far + parts[p + REACH]
        if cx * cx + cy * cy + cz * cz <= within * within:
            around[count] = part
            count += 1
    return count


@compiled
def parts_along(parts, around, number, x, y, z, ux, uy, uz, far, near, ends, out):
    """Write the parts of ``around`` that a ray may meet to ``near``; return their number.

    Each has its span and the ray in its frame, NEAR numbers in all.
    """
    count = 0
    for i in range(number):
        p = int(around[i]) * PART_SIZE
        cx, cy, cz = parts[p + CENTRE] - x, parts[p + CENTRE + 1] - y, parts[p + CENTRE + 2] - z
        along = cx * ux + cy * uy + cz * uz
        reach = parts[p + REACH]
        # Pythagoras gives the squared distance of the ball's centre from the ray without a root.
        beside = cx * cx + cy * cy + cz * cz - along * along
        if beside > reach * reach or along < -reach or along > far + reach or count >= MAX_NEAR:
            continue
        k = NEAR * count
        line = at(near, k + 3)
        enter(parts, p, x, y, z, ux, uy, uz, line)
        # A little behind the start, since a camera may stand in a port plane.
        out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -TOLERANCE, far, 0.0, 0.0
        span_in(parts, p, line, ends, out)
        if out[HIGH] >= out[LOW]:
            near[k] = around[i]
            near[k + 1], near[k + 2] = out[LOW] - TOLERANCE, out[HIGH] + TOLERANCE
            count += 1
    return count


@compiled
def nearest_port(parts, p, x, y, z):
    """Return the port of a part whose plane is nearest to a world point, and how far, m."""
    best, where = 1e30, p + PLANES
    for port in range(int(parts[p + PORTS])):
        q = p + PLANES + port * PORT_SIZE
        beyond = abs(
            (x - parts[q]) * parts[q + 3]
            + (y - parts[q + 1]) * parts[q + 4]
            + (z - parts[q + 2]) * parts[q + 5]
        )
        if beyond < best:
            best, where = beyond, q
    return where, best


NEWTON_DISTANCE, MAX_NEWTON_STEP = 5e-4, 0.01
"""Distance from the wall, m, below which Newton's method takes over from sphere tracing, and its
longest step, m."""
EXACT = 1e-10
"""Distance from the wall, m, at which a ray is on it."""
MET = 1e-7
"""Distance, m, up to which a ray is on a wall with relief."""
APART = 3e-3
"""A ray that enters another part more than this deep in that part's wall, m, has left through an
open end before which that pipe passes, not through a joint. Walls are thicker than that, and joints
of maps fit better."""
OVER_RELAXATION = 1.6
"""Over-relaxation: a step of sphere tracing over the distance from the wall; see ``_follow``."""
MAX_STEPS = 300
DIM = 0.03
"""Before the end of what has been seen of a straight, m, a ray returns nothing: the end may be
there, and a ring, or a little before."""
GRAIN_SIZE = 0.012
"""Of the patches of the surface's grain, m."""


@compiled
def _only(near, count, s):
    """Index in ``near`` of the one part that the ray is in at s; -1 for none or several."""
    which = -1
    for k in range(count):
        if near[NEAR * k + 1] <= s <= near[NEAR * k + 2]:
            # Where parts overlap at a joint, either's clear length may end in the other's bore.
            if which >= 0:
                return -1
            which = k
    return which


@compiled
def _widest(parts, near, count, s, out):
    """Index in ``near`` of the part that the ray is in at s, and the distance from its wall.

    Of several parts it is the widest one; -1 outside all. The gradient goes to ``out``.
    """
    best, which, latest = -1e30, -1, -1
    for k in range(count):
        n = NEAR * k
        if near[n + 1] <= s <= near[n + 2]:
            d, latest = surface_at(parts, int(near[n]) * PART_SIZE, at(near, n + 3), s, out), k
            if d > best:
                best, which = d, k
    # `out` holds the gradient of the part that was evaluated last, which need not be the widest.
    if which != latest:
        n = NEAR * which
        surface_at(parts, int(near[n]) * PART_SIZE, at(near, n + 3), s, out)
    return which, best


@compiled
def _follow(parts, near, count, far, out):
    """Follow a ray to the wall; the gradient there goes to ``out``.

    Returns the distance along the ray, m; the index in ``near`` of the part that it ends in; and 1
    on a wall, 0 where the ray leaves through a port, -1 where it gets as far as ``far``.

    It goes on as far as the bore is clear for certain, else by a step that is longer than the
    distance from the wall, which halves the number of steps along a pipe. Where the clearance
    spheres of successive points do not overlap there may be a wall between: then the step is undone
    and repeated without over-relaxation.
    """
    s, last, stretch = 0.0, -1, OVER_RELAXATION
    from_s, from_d, stretched, at_end = 0.0, 0.0, False, False
    for _ in range(MAX_STEPS):
        k = -1 if stretched or at_end else _only(near, count, s)
        d, clear = 0.0, clear_from(parts, near, k, s) if k >= 0 else 0.0
        if clear <= 0.0:
            was_alone = k >= 0
            k, d = _widest(parts, near, count, s, out)
            # The two balls do not touch: go back and take the step that is safe.
            if stretched and (k < 0 or from_d + d < s - from_s):
                s, stretch, stretched = from_s + from_d, 1.0, False
                continue
            if k < 0 or (0 <= last != k and d < -APART):
                return s, last, 0
            if d < NEWTON_DISTANCE:
                there = _onto_wall(parts, near, k, s, d, out)
                if _is_on_wall(parts, near, k, there, d, out):
                    return there, k, 1
                s, from_s, stretched, last = s + max(d, SHORT), s, False, k
                continue
            clear = 0.0 if was_alone else clear_from(parts, near, k, s)
        last, stretched, at_end = k, False, False
        left = max(min(near[NEAR * k + 2], far) - s, 0.0)
        if clear > d:
            at_end = clear < left
            # Where it is clear up to the port, step across its plane into the next part.
            s += clear if at_end else left + SHORT
        else:
            from_s, from_d = s, d
            # Across a port plane the next part's wall may be narrower: no longer step there.
            stretched = stretch > 1.0 and stretch * d < left
            s += stretch * d if stretched else max(min(d, left), SHORT)
        if s >= far:
            return far, k, -1
    _widest(parts, near, count, s, out)
    return s, last, 1


@compiled
def _is_on_wall(parts, near, k, s, d, out):
    """Tell whether a ray has met the wall where ``_onto_wall`` leads it from ``d`` m before it.

    It passes by a bead, or is still on its way into the corner beside it, where it is farther off.
    """
    p = int(near[NEAR * k]) * PART_SIZE
    if parts[p + LONG] == 0.0 or d < MET:
        return True
    return abs(surface_at(parts, p, at(near, NEAR * k + 3), s, out)) < MET


@compiled
def _onto_wall(parts, near, k, s, d, out):
    """Refine a place close to the wall by Newton steps onto it; its gradient goes to ``out``."""
    n = NEAR * k
    p, line = int(near[n]) * PART_SIZE, at(near, n + 3)
    for _ in range(3):
        # Newton's method for the distance along the ray; at grazing incidence it would run away.
        slope = out[0] * line[3] + out[1] * line[4] + out[2] * line[5]
        if abs(d) < EXACT or slope > -1e-2:
            break
        there = s + max(-MAX_NEWTON_STEP, min(d / -slope, MAX_NEWTON_STEP))
        beyond = surface_at(parts, p, line, there, out)
        # A step that does not help is dropped, and the gradient is that of the place kept.
        if abs(beyond) >= abs(d) or there > near[n + 2]:
            surface_at(parts, p, line, s, out)
            break
        s, d = there, beyond
    return s


@compiled
def _grain(x, y, z):
    """A smooth pattern of the place (fitting frame, m), -1 to 1: dirt and the like."""
    # Sines of sines do not repeat along a pipe, so that pictures of two places differ.
    a, b, c = x / GRAIN_SIZE, y / GRAIN_SIZE, z / GRAIN_SIZE
    first = math.sin(a + 1.7 * math.sin(0.83 * b + 0.4)) * math.sin(b + 1.3 * math.sin(0.71 * c))
    second = math.sin(2.3 * c + 1.1 * math.sin(1.9 * a)) * math.sin(1.7 * a + 2.9 * b)
    return 0.6 * first + 0.4 * second


@compiled
def _write(parts, first, near, k, met, s, x, y, z, ux, uy, uz, lamp, hits, h, out):
    """Write a ray's hit to ``hits`` from ``h`` on; return whether it met a wall or plate.

    ``out`` holds the gradient of the wall's distance there.
    """
    hits[h + RANGE], hits[h + PART], hits[h + LIT] = math.inf, -1.0, 0.0
    hits[h + NORMAL] = hits[h + NORMAL + 1] = hits[h + NORMAL + 2] = 0.0
    hits[h + JOINT], hits[h + GRAIN] = math.inf, 0.0
    if met < 0 or k < 0:
        return False
    p = int(near[NEAR * k]) * PART_SIZE
    wx, wy, wz = x + s * ux, y + s * uy, z + s * uz
    q, beyond = p, math.inf
    if met == 0 or lamp[3] > 0.0:
        q, beyond = nearest_port(parts, p, wx, wy, wz)
    if met == 0:
        if parts[q + 6] != PLATE:
            if parts[q + 6] >= UNKNOWN:
                hits[h + RANGE] = math.nan
            if parts[q + 6] == UNSEEN:
                hits[h + PART] = BEYOND
            return False
        hits[h + NORMAL], hits[h + NORMAL + 1] = -parts[q + 3], -parts[q + 4]
        hits[h + NORMAL + 2] = -parts[q + 5]
    else:
        if q != p and parts[q + 6] == UNSEEN:
            if beyond < DIM:
                hits[h + RANGE], hits[h + PART] = math.nan, BEYOND
                return False
            beyond = math.inf
        r = p + ROTATION
        for row in range(3):
            hits[h + NORMAL + row] = (
                parts[r + 3 * row] * out[0]
                + parts[r + 3 * row + 1] * out[1]
                + parts[r + 3 * row + 2] * out[2]
            )
    hits[h + RANGE], hits[h + PART], hits[h + JOINT] = s, near[NEAR * k] - first, beyond
    if lamp[3] > 0.0 and lamp[4] > 0.0:
        line = at(near, NEAR * k + 3)
        hits[h + GRAIN] = _grain(
            line[0] + s * line[3], line[1] + s * line[4], line[2] + s * line[5]
        )
    return True


@compiled
def _lit(parts, around, number, x, y, z, nx, ny, nz, lx, ly, lz, work, ends, out):
    """Return the cosine of the lamp's angle to the normal n at a point; 0 where it is shaded.

    The way to the lamp begins a little off the wall.
    """
    lift = 5.0 * NEWTON_DISTANCE
    # Without the lift the wall itself would shade the point by its rounding errors.
    x, y, z = x + lift * nx, y + lift * ny, z + lift * nz
    dx, dy, dz = lx - x, ly - y, lz - z
    far = math.sqrt(dx * dx + dy * dy + dz * dz)
    if far < 1e-9:
        return 1.0
    ux, uy, uz = dx / far, dy / far, dz / far
    facing = ux * nx + uy * ny + uz * nz
    if facing <= 0.0:
        return 0.0
    count = parts_along(parts, around, number, x, y, z, ux, uy, uz, far, work, ends, out)
    _, _, met = _follow(parts, work, count, far, out)
    return facing if met < 0 else 0.0


def trace(parts, maps, poses, cameras, rays, count, lamp, far, work, hits):
    """Trace the rays of cameras to the walls.

    Args:
        parts: records of PART_SIZE numbers.
        maps: (cameras, 2) first and last + 1 of the parts that are a camera's world.
        poses: (cameras, 12) m place, and rotation row by row, of each camera in the world.
        cameras: their number.
        rays: (count, 3) unit vectors, camera frame.
        count: of rays a camera.
        lamp: (3,) m, camera frame, then 1 where there is one, then 1 where walls have a grain.
        far: m, beyond which nothing is seen.
        work: room for NEAR MAX_NEAR numbers, as many for the way to the lamp, PORTS_ROOM zeros
            for ports, and a number for each part of a map.
        hits: (cameras, count, HIT_SIZE), written to.
    """
    out = scratch()
    to_lamp, ends = at(work, NEAR * MAX_NEAR), at(work, 2 * NEAR * MAX_NEAR)
    around = at(work, 2 * NEAR * MAX_NEAR + PORTS_ROOM)
    # The way to the lamp may leave the camera's ball by the lamp's offset.
    aside = math.sqrt(lamp[0] * lamp[0] + lamp[1] * lamp[1] + lamp[2] * lamp[2])
    for camera in range(cameras):
        first, last, c = int(maps[2 * camera]), int(maps[2 * camera + 1]), 12 * camera
        x, y, z = poses[c], poses[c + 1], poses[c + 2]
        lx = x + poses[c + 3] * lamp[0] + poses[c + 4] * lamp[1] + poses[c + 5] * lamp[2]
        ly = y + poses[c + 6] * lamp[0] + poses[c + 7] * lamp[1] + poses[c + 8] * lamp[2]
        lz = z + poses[c + 9] * lamp[0] + poses[c + 10] * lamp[1] + poses[c + 11] * lamp[2]
        number = parts_around(parts, first, last, x, y, z, far + aside, around)
        for ray in range(count):
            rx, ry, rz = rays[3 * ray], rays[3 * ray + 1], rays[3 * ray + 2]
            ux = poses[c + 3] * rx + poses[c + 4] * ry + poses[c + 5] * rz
            uy = poses[c + 6] * rx + poses[c + 7] * ry + poses[c + 8] * rz
            uz = poses[c + 9] * rx + poses[c + 10] * ry + poses[c + 11] * rz
            near = parts_along(parts, around, number, x, y, z, ux, uy, uz, far, work, ends, out)
            s, k, met = _follow(parts, work, near, far, out)
            h = (camera * count + ray) * HIT_SIZE
            met_wall = _write(
                parts, first, work, k, met, s, x, y, z, ux, uy, uz, lamp, hits, h, out
            )
            if met_wall and lamp[3] > 0.0:
                hits[h + LIT] = _lit(
                    parts,
                    around,
                    number,
                    x + s * ux,
                    y + s * uy,
                    z + s * uz,
                    hits[h + NORMAL],
                    hits[h + NORMAL + 1],
                    hits[h + NORMAL + 2],
                    lx,
                    ly,
                    lz,
                    to_lamp,
                    ends,
                    out,
                )
    return 0


@compiled
def _nearest_of(parts, first, last, points, i, work, rows, out):
    """Write the nearest wall of a map's parts, from ``first`` to ``last``, to point i, as a row."""
    x, y, z = points[3 * i], points[3 * i + 1], points[3 * i + 2]
    best = -1e30
    rows[5 * i], rows[5 * i + 4] = 0.0, -1.0
    rows[5 * i + 1] = rows[5 * i + 2] = rows[5 * i + 3] = 0.0
    for part in range(first, last):
        p = part * PART_SIZE
        cx, cy, cz = (
            x - parts[p + CENTRE],
            y - parts[p + CENTRE + 1],
            z - parts[p + CENTRE + 2],
        )
        if cx * cx + cy * cy + cz * cz > parts[p + REACH] * parts[p + REACH]:
            continue
        out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -SHORT, SHORT, 0.0, 0.0
        # A line through the point in an oblique direction (1, 1, 1)/sqrt(3), which is hardly ever
        # parallel to a port plane.
        enter(parts, p, x, y, z, 0.57735, 0.57735, 0.57735, work)
        span_in(parts, p, work, at(work, 6), out)
        if out[HIGH] < out[LOW]:
            continue
        d = surface_at(parts, p, work, 0.0, out)
        if d > best:
            best = d
            rows[5 * i], rows[5 * i + 4] = d, float(part - first)
            for row in range(3):
                r = p + ROTATION + 3 * row
                rows[5 * i + 1 + row] = (
                    parts[r] * out[0] + parts[r + 1] * out[1] + parts[r + 2] * out[2]
                )


def nearest(parts, maps, points, robots, count, work, rows):
    """Distances of points from the walls, positive in the bore, with gradients.

    Args:
        parts: as of ``trace``.
        maps: as of ``trace``, a map for each robot.
        points: (robots, count, 3) m, world frame.
        robots: number of robots.
        count: number of points of each.
        work: room for 6 numbers, and zeros for ports.
        rows: (robots, count, 5), written to: distance, m; unit gradient (3), world frame; number
            of the part, from the first of the map, -1 where the point lies between the port planes
            of none, and then the distance counts for nothing.
    """
    out = scratch()
    for robot in range(robots):
        first, last = int(maps[2 * robot]), int(maps[2 * robot + 1])
        for i in range(robot * count, (robot + 1) * count):
            _nearest_of(parts, first, last, points, i, work, rows, out)
    return 0


_TRACE = CFUNCTYPE(
    INTEGER, *(NUMBERS, NUMBERS, NUMBERS, WORD, NUMBERS, WORD, NUMBERS, NUMBER, NUMBERS, NUMBERS)
)
_NEAREST = CFUNCTYPE(INTEGER, NUMBERS, NUMBERS, NUMBERS, WORD, WORD, NUMBERS, NUMBERS)
"""C types of the compiled functions, in the order of their arguments."""
_WORK = 2 * NEAR * MAX_NEAR + PORTS_ROOM


class RayWalls:
    """Maps, each a number of placed parts, whose walls rays meet.

    A map may be the true network or what a robot takes for it; robots may share one.

    Args:
        maps: parts of each map.
        closed: (part index, port) that a plate closes, of each map.
        unknown: (part index, port), of each map, that nothing is known of what is beyond.
        dirty: whether the walls have a grain, as those of a map have not.

    Raises:
        GeometryError: a kind of fitting has a wall that does not compile.
    """

    def __init__(
        self,
        maps: Sequence[Sequence[Part]],
        closed: Sequence[Collection[Port]] | None = None,
        unknown: Sequence[Collection[Port]] | None = None,
        *,
        dirty: bool = False,
    ) -> None:
        self._dirty = dirty
        plates = [()] * len(maps) if closed is None else closed
        dark = [()] * len(maps) if unknown is None else unknown
        self._maps = [_records(*each) for each in zip(maps, plates, dark, strict=True)]
        self._all: tuple[Array, Array, int] | None = None

    @classmethod
    def joined(cls, several: Sequence[RayWalls]) -> RayWalls:
        """Return walls that hold the maps of several in order, with the grain of the first."""
        walls = cls.__new__(cls)
        walls._dirty, walls._maps = several[0]._dirty, [m for each in several for m in each._maps]
        walls._all = None
        return walls

    def replace(
        self,
        number: int,
        parts: Sequence[Part],
        closed: Collection[Port] = (),
        unknown: Collection[Port] = (),
    ) -> None:
        """Put another map in the place of one; arguments as of the class."""
        self._maps[number] = _records(parts, closed, unknown)
        self._all = None

    def _together(self) -> tuple[Array, Array, int]:
        """Records of all maps in one array, the span (maps, 2) of each one's rows, a ray's room.

        Cameras name maps by the spans. Made when first asked for, as most walls are only joined to
        others.
        """
        if self._all is None:
            ends = np.cumsum([0, *(len(records) for records in self._maps)])
            spans = np.stack([ends[:-1], ends[1:]], axis=-1).astype(float)
            room = _WORK + max(map(len, self._maps), default=0)
            self._all = np.concatenate(self._maps), spans, room
        return self._all

    def trace(
        self,
        which: NDArray[np.intp],
        position: Array,
        rotation: Array,
        rays: Array,
        far: float,
        lamp: Array | None = None,
    ) -> Array:
        """Trace the rays of n cameras to the walls.

        Args:
            which: (n,) map of each camera.
            position: (n, 3) m, world frame.
            rotation: (n, 3, 3) camera frame in the world.
            rays: (k, 3) unit vectors, camera frame.
            far: m, beyond which nothing is seen.
            lamp: (3,) m, camera frame; None: what it shines on is not asked for.

        Returns:
            (n, k, HIT_SIZE), indices ``RANGE`` to ``GRAIN``: range, m (infinite for nothing, NaN
            beyond a port that nothing is known of); unit normal into the bore (3), world frame;
            number of the part in its map, -1 for nothing, ``BEYOND`` in pipe whose end has not
            been seen; how squarely the lamp shines there, cosine, 0 in the dark; distance from the
            nearest joint or end, m; grain, -1 to 1, 0 of walls without one.
        """
        n, k = len(position), len(rays)
        poses = np.concatenate([position, rotation.reshape(n, 9)], axis=1)
        light = np.zeros(5) if lamp is None else np.array([*lamp, 1.0, self._dirty])
        hits = np.empty((n, k, HIT_SIZE))
        parts, spans, room = self._together()
        c_function(trace, _TRACE).ctypes(
            *pointers(parts, spans[which], poses),
            n,
            *pointers(np.ascontiguousarray(rays, float)),
            k,
            *pointers(light),
            far,
            # A buffer for each call, so that calls share no state.
            *pointers(np.zeros(room), hits),
        )
        return hits

    def nearest(self, which: NDArray[np.intp], points: Array) -> tuple[Array, Array, Array]:
        """Return the distances of points from the walls.

        Args:
            which: (n,) map of each row.
            points: (n, k, 3) m, world frame.

        Returns:
            Distances (n, k) m, positive in the bore; unit gradients (n, k, 3); and the parts (n, k)
            that the points lie in, -1 for none, where the distance means nothing.
        """
        n, k = points.shape[:2]
        rows = np.empty((n, k, 5))
        parts, spans, _ = self._together()
        c_function(nearest, _NEAREST).ctypes(
            *pointers(parts, spans[which], np.ascontiguousarray(points)),
            n,
            k,
            *pointers(np.zeros(16), rows),
        )
        return rows[..., 0], rows[..., 1:4], rows[..., 4]


def _records(parts: Sequence[Part], closed: Collection[Port], unknown: Collection[Port]) -> Array:
    """Return the records (parts, PART_SIZE) of a map."""
    records = [
        part_record(part, *([port for i, port in ends if i == index] for ends in (closed, unknown)))
        for index, part in enumerate(parts)
    ]
    return np.array(records).reshape(-1, PART_SIZE)


def part_record(part: Part, closed: Collection[str] = (), unknown: Collection[str] = ()) -> Array:
    """Return the record (PART_SIZE,) of a placed part, for this process only.

    Args:
        part: of a map.
        closed: its ports that a plate closes.
        unknown: its ports behind which the map ends.
    """
    fitting, pose = part.fitting, part.pose
    unplaced, points, directions = _unplaced(fitting)
    record = unplaced.copy()
    points = pose.apply(points)
    record[CENTRE : CENTRE + 3] = points[0]
    record[POSITION : POSITION + 3] = pose.position
    record[ROTATION : ROTATION + 9] = pose.rotation.ravel()
    ports = record[PLANES : PLANES + PORT_SIZE * len(directions)].reshape(-1, PORT_SIZE)
    ports[:, :3], ports[:, 3:6] = points[1:], directions @ pose.rotation.T
    if closed or unknown:
        dark = UNSEEN if fitting.is_plain else UNKNOWN
        ports[:, 6] = [
            PLATE if name in closed else dark if name in unknown else OPEN
            for name in fitting.port_names
        ]
    return record


# Many parts of the forms that a recogniser tries are equal straights.
@lru_cache(maxsize=4096)
def _unplaced(fitting: Fitting) -> tuple[Array, Array, Array]:
    """Return what records of a fitting have in common, with open ports, in its frame.

    Beside the record: the middle of the ball around it and the places of its ports (1 + ports, 3)
    m, and their directions (ports, 3).
    """
    record, (low, high), ports = np.zeros(PART_SIZE), fitting.bounds, fitting.ports
    record[SURFACE] = fitting.wall_address("surface")
    record[SPAN] = fitting.wall_address("span")
    record[CLEAR] = fitting.wall_address("clear")
    # Points that are measured a little outside the wall still belong to it.
    record[REACH] = float(np.linalg.norm(high - low)) / 2 + fitting.max_radius / 2
    record[PORTS] = len(fitting.port_names)
    if len(fitting.sizes) > MAX_SIZES:
        record[LONG] = long_sizes.address(long_sizes.add(fitting.sizes))
    else:
        record[SIZES : SIZES + len(fitting.sizes)] = fitting.sizes
    placed = [ports[name] for name in fitting.port_names]
    points = np.array([(low + high) / 2, *(port.position for port in placed)])
    return record, points, np.array([port.rotation[:, 2] for port in placed])
