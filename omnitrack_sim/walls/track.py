"""Contacts of a whole track with one fitting, and the records by which both are known.

A track is a line of spheres. Along the line the distance to a concave wall (a straight's, a tee's
cylinders) has its minima at the ends of what lies beside that wall; along a convex one (an elbow's
inner side, a tee's rim) within. So contacts are wanted at the ends of the line, at the minima along
it, and where a straight wall that carries the line ends: at a port before an elbow, at an open end,
at the rim, at the ends of a reducer's cone.

A minimum is a patch, not a point: lugs straddle a rim and push against its flanks, which carries
force along the track beyond friction. So there are contacts half a lug pitch to either side of it
too. Without them a robot on a slippery wall fails more often than one with 15 or 43 lugs a track
(docs/studies/design-study.md).

Round the ends of a module the chain runs over sprockets. An end that presses against a wall ahead
would push its whole row of lugs back, with the inertia of the motor behind it, and would jump when
the row is moved back by a pitch: forces of a thousand newtons. So beyond ``LEAN`` the contact is
that of a sphere that turns about the sprocket's axle.
"""

from __future__ import annotations

import math
import secrets

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Fitting
from omnitrack_sim.pipes.compiled import EDGE, HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.pipes.fittings.base import MOST_PORTS, MOST_SIZES
from omnitrack_sim.pipes.native import at, call_span, call_surface, scratch

MARK = float(secrets.randbits(52))
"""First number of the records of this process. Records hold addresses of compiled code: in another
process, which reads them from a saved model, they must count for nothing."""
SURFACE, SPAN, BOX = 1, 2, 3
ENDS = BOX + 3
SIZES = ENDS + MOST_PORTS
RECORD_SIZE = SIZES + MOST_SIZES
"""Indices in the record of a wall, and its size: mark, addresses of the compiled ``surface`` and
``span``, centre of the bounding box (3), whether contact ends at each port, the fitting's
``sizes``."""
PITCH, SCALE, SIDE, OTHER = 1, 2, 3, 4
"""Indices in the record of a track: distance of its lugs, m, the robot's scale, and the side of
its module that it is the run of: 1 towards the module's x axis, -1 away from it, 0 for a line
that touches all round. In that of a sprocket: how many geoms further the sprocket at the module's
other end is; 0 for a line."""
LEAN = 0.6
"""Cosine between a contact's normal and the module's axis from which on the end of a run is the
sprocket's: 37 degrees off the track's normal. At 0.25 sprockets take over where the straight run
still carries, and more tee turns fail; at 0.8 the forces of a row that pushes come back."""
BAND = 0.05
"""Cosine between a contact's normal and the plane between both runs of a chain up to which both
touch. There the farther run is less deep by twice the tracks' offset times this: 0.1 mm."""
ROOM = 0.002
"""Of the bounding box around the bore, m: deeper than any lug presses."""
BACKSTOP = 0.5
"""Depth, in radii of a line, down to which a wall is solid for its axis. A line in a neighbouring
pipe is a radius deep at least."""
CONTACT_SIZE = 10
"""Numbers of a contact (MuJoCo's mjPreContact): distance, position (3), normal (3), first tangent
(3)."""
MOST_CONTACTS = 24
"""On one line and one fitting; MuJoCo has room for 50."""
SPACING = 0.008
"""Largest spacing of the samples between which a minimum is looked for, m, for a robot of scale 1:
a third of a lug's radius."""
PLATEAU = 0.02
"""Slope along the line up to which a wall that ends at the rim counts as carrying it."""
LEAST_APART = 0.003
"""A minimum nearer than this to an end of the line is that end, m."""
POSITION = 1e-7
"""Accuracy of a minimum along the line, m."""


def wall_record(fitting: Fitting, ends: tuple[bool, ...]) -> Array:
    """Return the record (RECORD_SIZE,) of one fitting, for this process only.

    Args:
        fitting: of any kind.
        ends: for each port, whether a contact line stops being supported there (open end, or the
            wall bends or steps).
    """
    record = np.zeros(RECORD_SIZE)
    record[0] = MARK
    record[SURFACE], record[SPAN] = fitting.wall_address("surface"), fitting.wall_address("span")
    record[BOX:ENDS] = bounding_box(fitting)[0]
    record[ENDS : ENDS + len(ends)] = ends
    record[SIZES : SIZES + len(fitting.sizes)] = fitting.sizes
    return record


def line_record(lug_pitch: float, scale: float, side: float = 0.0) -> Array:
    """Return the record (RECORD_SIZE,) of a track: mark, distance of its lugs, m, the robot's
    scale, and its side, see ``SIDE``."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[PITCH], record[SCALE], record[SIDE] = MARK, lug_pitch, scale, side
    return record


def sprocket_record(other: int) -> Array:
    """Return the record (RECORD_SIZE,) of a sprocket's sphere, see ``OTHER``."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[OTHER] = MARK, other
    return record


def bounding_box(fitting: Fitting) -> tuple[Array, Array]:
    """Centre (3,) and half sizes (3,) m of a box around the bore, fitting frame."""
    low, high = fitting.bounds
    return (low + high) / 2, (high - low) / 2 + ROOM


@compiled
def _add(con, n, surface, sizes, ray, face, s, radius, margin, out):
    """Add the contact at s if the wall is that near and faces the run; returns the number of
    contacts. Still in the fitting's frame."""
    px, py, pz, ax, ay, az = ray
    x, y, z = px + s * ax, py + s * ay, pz + s * az
    d = call_surface(surface, sizes, x, y, z, out)
    # A line whose axis lies deep within the wall belongs to another pipe.
    # Beyond MOST_CONTACTS the rest is dropped: the ends and the first minima come first.
    if d <= -BACKSTOP * radius or d - radius >= margin or n >= MOST_CONTACTS:
        return n
    gx, gy, gz = out[0], out[1], out[2]
    # The wall behind a run belongs to the other run of its chain.
    if gx * face[0] + gy * face[1] + gz * face[2] > BAND:
        return n
    k = n * CONTACT_SIZE
    # MuJoCo places a contact half way between the two surfaces.
    middle = 0.5 * (d + radius)
    con[k] = d - radius
    con[k + 1], con[k + 2], con[k + 3] = x - middle * gx, y - middle * gy, z - middle * gz
    con[k + 4], con[k + 5], con[k + 6] = gx, gy, gz
    return n + 1


@compiled
def _add_end(con, n, surface, sizes, ray, face, s, radius, margin, out):
    """Add the contact of an end, see ``_add``; of a run only where it is not its sprocket's."""
    count = _add(con, n, surface, sizes, ray, face, s, radius, margin, out)
    if face[3] > 0.0 and abs(out[0] * ray[3] + out[1] * ray[4] + out[2] * ray[5]) > LEAN:
        return n
    return count


@compiled
def _slope(surface, sizes, ray, s, out):
    """Distance, its derivative along the line, and the face, at s."""
    px, py, pz, ax, ay, az = ray
    d = call_surface(surface, sizes, px + s * ax, py + s * ay, pz + s * az, out)
    return d, out[0] * ax + out[1] * ay + out[2] * az, out[3]


@compiled
def _minimum(surface, sizes, ray, a, slope_a, b, slope_b, out):
    """Find the minimum between ``a``, where the slope is negative, and ``b``, where it is positive,
    by regula falsi (Illinois)."""
    side = 0
    s = b
    for _ in range(60):
        s = (a * slope_b - b * slope_a) / (slope_b - slope_a)
        _, slope, _ = _slope(surface, sizes, ray, s, out)
        if slope < 0.0:
            a, slope_a = s, slope
            if side == -1:
                # Illinois: an end that has stayed twice gets half its weight, or convergence would
                # be linear.
                slope_b *= 0.5
            side = -1
        else:
            b, slope_b = s, slope
            if side == 1:
                slope_a *= 0.5
            side = 1
        if b - a < POSITION or abs(slope) < 1e-9:
            break
    return s


@compiled
def _rim_begins(surface, sizes, ray, a, face_a, b, out):
    """Find the place between ``a`` and ``b`` where the nearest part of the wall changes, by
    bisection."""
    while b - a > POSITION:
        s = 0.5 * (a + b)
        _, _, face = _slope(surface, sizes, ray, s, out)
        if face == face_a:
            a = s
        else:
            b = s
    return 0.5 * (a + b)


@compiled
def _add_within(con, n, surface, sizes, ray, face, bounds, radius, pitch, margin, scale, out):
    """Add the contacts between the ends: minima with their flanks, and where a rim begins at a
    straight wall. ``bounds``: the span, and whether contact ends at its ends."""
    low, high, low_ends, high_ends = bounds
    # Even pieces from end to end: the samples are the same seen from either end.
    pieces = math.ceil((high - low) / (SPACING * scale))
    reach = radius + margin
    # Next to an end that already has a contact, another one would only split its force.
    first = low + (LEAST_APART * scale if low_ends else 0.0)
    last = high - (LEAST_APART * scale if high_ends else 0.0)
    a = low
    d_a, slope_a, face_a = _slope(surface, sizes, ray, a, out)
    for i in range(pieces):
        b = low + (high - low) * (i + 1) / pieces
        d_b, slope_b, face_b = _slope(surface, sizes, ray, b, out)
        # The distance changes by no more than one metre a metre.
        if 0.5 * (d_a + d_b - (b - a)) < reach:
            s = low - 1.0
            if slope_a < 0.0 <= slope_b:
                s = _minimum(surface, sizes, ray, a, slope_a, b, slope_b, out)
            elif face_a != face_b:
                onto_rim = slope_b if face_b == EDGE else -slope_a
                if onto_rim > -PLATEAU:
                    s = _rim_begins(surface, sizes, ray, a, face_a, b, out)
            if first <= s <= last:
                n = _add(con, n, surface, sizes, ray, face, s, radius, margin, out)
                # Half a pitch is where the neighbouring lugs of a real track would touch the
                # flanks.
                for flank in (s - pitch / 2, s + pitch / 2):
                    if low <= flank <= high:
                        n = _add(con, n, surface, sizes, ray, face, flank, radius, margin, out)
        a, d_a, slope_a, face_a = b, d_b, slope_b, face_b
    return n


@compiled
def _in_fitting(wall, w, position, matrix, g_line, g_wall):
    """Centre and direction of a line in the frame of a fitting: six numbers."""
    l, o = 3 * g_line, 3 * g_wall
    m = 9 * g_wall
    dx, dy, dz = (
        position[l] - position[o],
        position[l + 1] - position[o + 1],
        position[l + 2] - position[o + 2],
    )
    ux, uy, uz = matrix[9 * g_line + 2], matrix[9 * g_line + 5], matrix[9 * g_line + 8]
    # The box that bounds the fitting has its centre elsewhere.
    px = matrix[m] * dx + matrix[m + 3] * dy + matrix[m + 6] * dz + wall[w + BOX]
    py = matrix[m + 1] * dx + matrix[m + 4] * dy + matrix[m + 7] * dz + wall[w + BOX + 1]
    pz = matrix[m + 2] * dx + matrix[m + 5] * dy + matrix[m + 8] * dz + wall[w + BOX + 2]
    ax = matrix[m] * ux + matrix[m + 3] * uy + matrix[m + 6] * uz
    ay = matrix[m + 1] * ux + matrix[m + 4] * uy + matrix[m + 7] * uz
    az = matrix[m + 2] * ux + matrix[m + 5] * uy + matrix[m + 8] * uz
    return px, py, pz, ax, ay, az


@compiled
def _towards(matrix, g_line, g_wall, side):
    """Direction in which a run faces, three numbers in the frame of a fitting, and whether it is
    one (over 0)."""
    l, m = 9 * g_line, 9 * g_wall
    x, y, z = side * matrix[l], side * matrix[l + 3], side * matrix[l + 6]
    return (
        matrix[m] * x + matrix[m + 3] * y + matrix[m + 6] * z,
        matrix[m + 1] * x + matrix[m + 4] * y + matrix[m + 7] * z,
        matrix[m + 2] * x + matrix[m + 5] * y + matrix[m + 8] * z,
        abs(side),
    )


@compiled
def _outward(position, matrix, g_line, other, g_wall):
    """Direction from the sprocket at the other end of a module to this one, three numbers in the
    frame of a fitting."""
    a, b, m = 3 * g_line, 3 * other, 9 * g_wall
    x, y, z = (
        position[a] - position[b],
        position[a + 1] - position[b + 1],
        position[a + 2] - position[b + 2],
    )
    size = math.sqrt(x * x + y * y + z * z)
    return (
        (matrix[m] * x + matrix[m + 3] * y + matrix[m + 6] * z) / size,
        (matrix[m + 1] * x + matrix[m + 4] * y + matrix[m + 7] * z) / size,
        (matrix[m + 2] * x + matrix[m + 5] * y + matrix[m + 8] * z) / size,
    )


@compiled
def line_contacts(con, wall, w, track, position, matrix, g_line, g_wall, radius, half, margin):
    """Contacts of a capsule's axis with one fitting, written to ``con``; returns their number.

    A sprocket is a capsule without length.

    Args:
        con: room for MOST_CONTACTS contacts of CONTACT_SIZE numbers; normals point from the wall to
            the line.
        wall: user data of all geoms; ``w`` and ``track`` are where the records of this fitting and
            of the line begin.
        position, matrix: (3 per geom) m and (9 per geom, row major), frames of all geoms in the
            world.
        g_line, g_wall: geom numbers of the line and of the wall.
        radius, half: of the capsule, m.
        margin: distance up to which contacts count, m.
    """
    surface, sizes, out = int(wall[w + SURFACE]), at(wall, w + SIZES), scratch()
    # All is found in the fitting's frame, where the formulas are simple, and rotated once at the
    # end.
    ray = _in_fitting(wall, w, position, matrix, g_line, g_wall)
    px, py, pz, ax, ay, az = ray
    face = _towards(matrix, g_line, g_wall, wall[track + SIDE])
    pitch, scale = wall[track + PITCH], wall[track + SCALE]
    out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -half, half, 1.0, 1.0
    span = int(wall[w + SPAN])
    within = call_span(span, sizes, at(wall, w + ENDS), px, py, pz, ax, ay, az, out)
    low, high, low_ends, high_ends = out[LOW], out[HIGH], out[LOW_ENDS] > 0, out[HIGH_ENDS] > 0
    if high < low:
        return 0
    n = 0
    if wall[track + OTHER] != 0.0:
        other = g_line + int(wall[track + OTHER])
        outward = _outward(position, matrix, g_line, other, g_wall)
        if _add(con, n, surface, sizes, ray, face, 0.0, radius, margin, out) == 0:
            return 0
        if out[0] * outward[0] + out[1] * outward[1] + out[2] * outward[2] > -LEAN:
            return 0
        _into_world(con, 0, wall, w, position, matrix, g_line, g_wall)
        return 1
    # A line that goes on into the next fitting gets that end's contact there, not here as well.
    if low_ends:
        n = _add_end(con, n, surface, sizes, ray, face, low, radius, margin, out)
    if high_ends:
        n = _add_end(con, n, surface, sizes, ray, face, high, radius, margin, out)
    if within > 0.0 and high > low:
        bounds = low, high, low_ends, high_ends
        n = _add_within(
            con, n, surface, sizes, ray, face, bounds, radius, pitch, margin, scale, out
        )
    for i in range(n):
        _into_world(con, i * CONTACT_SIZE, wall, w, position, matrix, g_line, g_wall)
    return n


@compiled
def _into_world(con, k, wall, w, position, matrix, g_line, g_wall):
    """Bring the contact at ``con[k]`` from the fitting's frame into the world's; its first tangent
    lies along the line."""
    o, m = 3 * g_wall, 9 * g_wall
    ux, uy, uz = matrix[9 * g_line + 2], matrix[9 * g_line + 5], matrix[9 * g_line + 8]
    _to_world(con, k + 1, matrix, m)
    con[k + 1] += position[o] - _turned(matrix, m, wall, w + BOX, 0)
    con[k + 2] += position[o + 1] - _turned(matrix, m, wall, w + BOX, 1)
    con[k + 3] += position[o + 2] - _turned(matrix, m, wall, w + BOX, 2)
    _to_world(con, k + 4, matrix, m)
    along = ux * con[k + 4] + uy * con[k + 5] + uz * con[k + 6]
    tx, ty, tz = ux - along * con[k + 4], uy - along * con[k + 5], uz - along * con[k + 6]
    size = math.sqrt(tx * tx + ty * ty + tz * tz)
    # A zero tangent tells MuJoCo to choose one itself, as where the line is normal to the wall.
    scale = 1.0 / size if size > 1e-6 else 0.0
    con[k + 7], con[k + 8], con[k + 9] = scale * tx, scale * ty, scale * tz


@compiled
def _turned(matrix, m, vector, v, row):
    """One row of a geom's rotation times a vector."""
    r = m + 3 * row
    return matrix[r] * vector[v] + matrix[r + 1] * vector[v + 1] + matrix[r + 2] * vector[v + 2]


@compiled
def _to_world(con, k, matrix, m):
    """Rotate three numbers in place from the fitting's frame to the world's."""
    x, y, z = (
        _turned(matrix, m, con, k, 0),
        _turned(matrix, m, con, k, 1),
        _turned(matrix, m, con, k, 2),
    )
    con[k], con[k + 1], con[k + 2] = x, y, z
