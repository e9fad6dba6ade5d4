"""Contacts of a whole track with one fitting, compiled.

A track is a line of spheres. Along the line the distance to a concave wall (a straight's, a tee's
cylinders) has its minima at the ends of what lies beside that wall; along a convex one (an elbow's
inner side, a tee's rim) within. So contacts are wanted at the ends of the line, at the minima along
it, and where a straight wall that carries the line
ends: at a port before an elbow, at an open end, at the rim, at the ends of a reducer's cone.

A minimum is a patch, not a point: lugs straddle a rim and push against its flanks, which carries
force along the track beyond friction. So there are contacts half a lug pitch to either side of it
too. Without them a robot on a slippery wall fails more often than one with 15 or 43 lugs a track
(docs/design-study.md).
"""

from __future__ import annotations

import math

from numba import njit

from omnitrack_sim.model.collider.record import ELBOW, RECORD_SIZE, REDUCER, STRAIGHT, TEE
from omnitrack_sim.model.collider.surface import EDGE, FACE, cone, tee, torus

_compiled = njit(cache=True, error_model="numpy")
_KIND, _RADIUS, _SIZES, _BOX, _ENDS = 1, 2, 3, 6, 9  # places in a record
assert _ENDS + 3 == RECORD_SIZE
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
"""A minimum nearer than this to an end of the line is that end, m, for a robot of scale 1."""
_POSITION = 1e-7  # m, to which a minimum is found


@_compiled
def _wall(wall, w, x, y, z):
    """Distance, gradient and face at a point of the fitting frame."""
    kind, radius = wall[w + _KIND], wall[w + _RADIUS]
    if kind == STRAIGHT:
        away = math.sqrt(x * x + y * y)
        if away < 1e-12:
            return radius, -1.0, 0.0, 0.0, FACE
        return radius - away, -x / away, -y / away, 0.0, FACE
    if kind == ELBOW:
        d, gx, gy, gz = torus(x, y, z, wall[w + _SIZES], radius)
        return d, gx, gy, gz, FACE
    if kind == REDUCER:
        return cone(x, y, z, radius, wall[w + _SIZES], wall[w + _SIZES + 1])
    return tee(x, y, z, radius, wall[w + _SIZES + 2])


@_compiled
def _clip(low, high, low_ends, high_ends, value, slope, ends):
    """The part of [low, high] where value + slope s <= 0, and whether contact ends at each of its
    ends."""
    if abs(slope) < 1e-14:
        if value > 0.0:
            high = low - 1.0
    elif slope > 0.0:
        s = -value / slope
        if s < high:
            high, high_ends = s, ends
    else:
        s = -value / slope
        if s > low:
            low, low_ends = s, ends
    return low, high, low_ends, high_ends


@_compiled
def _before_wide_end(z, from_axis, radius, length, end_radius):
    """How far a point's foot lies on the cone from its wide end, m times a positive factor;
    negative beyond the end."""
    slope = (end_radius - radius) / length
    return (
        z + slope * (from_axis - radius)
        if slope < 0.0
        else length - z - slope * (from_axis - end_radius)
    )


@_compiled
def _wide_end(wall, w, px, py, pz, ax, ay, az, low, high, low_ends, high_ends, ends):
    """The part of [low, high] that the cone itself is nearest to on the side of its wide end.

    That part ends at the normals of the wide edge, not at the port plane: a lug touches the cone
    before its centre is past the port. A line along a pipe passes those normals once.
    """
    if high < low:
        return low, high, low_ends, high_ends
    radius, length, end_radius = wall[w + _RADIUS], wall[w + _SIZES], wall[w + _SIZES + 1]
    a, b = low, high
    at_a = _before_wide_end(
        pz + a * az, math.hypot(px + a * ax, py + a * ay), radius, length, end_radius
    )
    at_b = _before_wide_end(
        pz + b * az, math.hypot(px + b * ax, py + b * ay), radius, length, end_radius
    )
    if at_a >= 0.0 and at_b >= 0.0:
        return low, high, low_ends, high_ends
    if at_a < 0.0 and at_b < 0.0:
        return low, low - 1.0, low_ends, high_ends
    while b - a > _POSITION:
        s = 0.5 * (a + b)
        at_s = _before_wide_end(
            pz + s * az, math.hypot(px + s * ax, py + s * ay), radius, length, end_radius
        )
        if (at_s < 0.0) == (at_a < 0.0):
            a = s
        else:
            b = s
    if at_a < 0.0:
        return b, high, ends, high_ends
    return low, a, low_ends, ends


@_compiled
def _between_ports(wall, w, px, py, pz, ax, ay, az, half):
    """The part of the line p + s a, |s| <= half, between the port planes; of a reducer, that its
    cone is nearest to."""
    kind, a, b, c = wall[w + _KIND], wall[w + _SIZES], wall[w + _SIZES + 1], wall[w + _SIZES + 2]
    first, second, third = wall[w + _ENDS] > 0, wall[w + _ENDS + 1] > 0, wall[w + _ENDS + 2] > 0
    low, high, low_ends, high_ends = -half, half, True, True
    if kind == STRAIGHT:
        low, high, low_ends, high_ends = _clip(low, high, low_ends, high_ends, -pz, -az, first)
        return _clip(low, high, low_ends, high_ends, pz - a, az, second)
    if kind == REDUCER and b < wall[w + _RADIUS]:
        low, high, low_ends, high_ends = _clip(low, high, low_ends, high_ends, pz - a, az, second)
        return _wide_end(wall, w, px, py, pz, ax, ay, az, low, high, low_ends, high_ends, first)
    if kind == REDUCER:
        low, high, low_ends, high_ends = _clip(low, high, low_ends, high_ends, -pz, -az, first)
        return _wide_end(wall, w, px, py, pz, ax, ay, az, low, high, low_ends, high_ends, second)
    if kind == ELBOW:
        low, high, low_ends, high_ends = _clip(low, high, low_ends, high_ends, -pz, -az, first)
        return _clip(low, high, low_ends, high_ends, (px - a) * b + pz * c, ax * b + az * c, second)
    low, high, low_ends, high_ends = _clip(low, high, low_ends, high_ends, -pz - a, -az, first)
    low, high, low_ends, high_ends = _clip(low, high, low_ends, high_ends, pz - a, az, second)
    return _clip(low, high, low_ends, high_ends, px - b, ax, third)


@_compiled
def _add(con, n, wall, w, px, py, pz, ax, ay, az, s, radius, margin):
    """Add the contact at s if the wall is that near; returns the number of contacts. Still in the
    fitting's frame."""
    x, y, z = px + s * ax, py + s * ay, pz + s * az
    d, gx, gy, gz, _ = _wall(wall, w, x, y, z)
    # A line whose axis lies within the wall belongs to another pipe.
    if d <= 0.0 or d - radius >= margin or n >= MOST_CONTACTS:
        return n
    k = n * CONTACT_SIZE
    middle = 0.5 * (d + radius)
    con[k] = d - radius
    con[k + 1], con[k + 2], con[k + 3] = x - middle * gx, y - middle * gy, z - middle * gz
    con[k + 4], con[k + 5], con[k + 6] = gx, gy, gz
    return n + 1


@_compiled
def _slope(wall, w, px, py, pz, ax, ay, az, s):
    """Distance, its derivative along the line, and the face, at s."""
    d, gx, gy, gz, face = _wall(wall, w, px + s * ax, py + s * ay, pz + s * az)
    return d, gx * ax + gy * ay + gz * az, face


@_compiled
def _minimum(wall, w, px, py, pz, ax, ay, az, a, slope_a, b, slope_b):
    """Where the slope turns from negative at ``a`` to positive at ``b``: regula falsi
    (Illinois)."""
    side = 0
    s = b
    for _ in range(60):
        s = (a * slope_b - b * slope_a) / (slope_b - slope_a)
        _, slope, _ = _slope(wall, w, px, py, pz, ax, ay, az, s)
        if slope < 0.0:
            a, slope_a = s, slope
            if side == -1:
                slope_b *= 0.5
            side = -1
        else:
            b, slope_b = s, slope
            if side == 1:
                slope_a *= 0.5
            side = 1
        if b - a < _POSITION or abs(slope) < 1e-9:
            break
    return s


@_compiled
def _rim_begins(wall, w, px, py, pz, ax, ay, az, a, face_a, b):
    """Where the nearest part of the wall changes between ``a`` and ``b``, by bisection."""
    while b - a > _POSITION:
        s = 0.5 * (a + b)
        _, _, face = _slope(wall, w, px, py, pz, ax, ay, az, s)
        if face == face_a:
            a = s
        else:
            b = s
    return 0.5 * (a + b)


@_compiled
def _add_within(
    con,
    n,
    wall,
    w,
    px,
    py,
    pz,
    ax,
    ay,
    az,
    low,
    high,
    low_ends,
    high_ends,
    radius,
    pitch,
    margin,
    robot_scale,
):
    """Add the contacts between the ends: minima with their flanks, and where a rim begins at a
    straight wall."""
    pieces = math.ceil((high - low) / (SPACING * robot_scale))
    reach = radius + margin
    first = low + (LEAST_APART * robot_scale if low_ends else 0.0)
    last = high - (LEAST_APART * robot_scale if high_ends else 0.0)
    a = low
    d_a, slope_a, face_a = _slope(wall, w, px, py, pz, ax, ay, az, a)
    for i in range(pieces):
        b = low + (high - low) * (i + 1) / pieces
        d_b, slope_b, face_b = _slope(wall, w, px, py, pz, ax, ay, az, b)
        # The distance changes by no more than one metre a metre.
        if 0.5 * (d_a + d_b - (b - a)) < reach:
            s = low - 1.0
            if slope_a < 0.0 <= slope_b:
                s = _minimum(wall, w, px, py, pz, ax, ay, az, a, slope_a, b, slope_b)
            elif face_a != face_b:
                onto_rim = slope_b if face_b == EDGE else -slope_a
                if onto_rim > -PLATEAU:
                    s = _rim_begins(wall, w, px, py, pz, ax, ay, az, a, face_a, b)
            if first <= s <= last:
                n = _add(con, n, wall, w, px, py, pz, ax, ay, az, s, radius, margin)
                for flank in (s - pitch / 2, s + pitch / 2):
                    if low <= flank <= high:
                        n = _add(con, n, wall, w, px, py, pz, ax, ay, az, flank, radius, margin)
        a, d_a, slope_a, face_a = b, d_b, slope_b, face_b
    return n


@_compiled
def line_contacts(
    con, wall, w, position, matrix, g_line, g_wall, radius, half, pitch, margin, robot_scale
):
    """Contacts of a capsule's axis with one fitting, written to ``con``; returns their number.

    Args:
        con: room for MOST_CONTACTS contacts of CONTACT_SIZE numbers; normals point from the wall to
            the line.
        wall: user data of all geoms, m; ``w`` is where this fitting's record begins.
        position, matrix: (3 per geom) m and (9 per geom, row major), frames of all geoms in the
            world.
        g_line, g_wall: geom numbers of the line and of the wall.
        radius, half: of the capsule, m. pitch: distance of its lugs, m.
        margin: distance up to which contacts count, m.
        robot_scale: size of the robot that the line belongs to, 1 for 160 mm pipes.
    """
    l, o = 3 * g_line, 3 * g_wall
    m = 9 * g_wall
    dx, dy, dz = (
        position[l] - position[o],
        position[l + 1] - position[o + 1],
        position[l + 2] - position[o + 2],
    )
    ux, uy, uz = matrix[9 * g_line + 2], matrix[9 * g_line + 5], matrix[9 * g_line + 8]
    # Into the fitting's frame; the box that bounds it has its centre elsewhere.
    px = matrix[m] * dx + matrix[m + 3] * dy + matrix[m + 6] * dz + wall[w + _BOX]
    py = matrix[m + 1] * dx + matrix[m + 4] * dy + matrix[m + 7] * dz + wall[w + _BOX + 1]
    pz = matrix[m + 2] * dx + matrix[m + 5] * dy + matrix[m + 8] * dz + wall[w + _BOX + 2]
    ax = matrix[m] * ux + matrix[m + 3] * uy + matrix[m + 6] * uz
    ay = matrix[m + 1] * ux + matrix[m + 4] * uy + matrix[m + 7] * uz
    az = matrix[m + 2] * ux + matrix[m + 5] * uy + matrix[m + 8] * uz

    low, high, low_ends, high_ends = _between_ports(wall, w, px, py, pz, ax, ay, az, half)
    if high < low:
        return 0
    n = 0
    if low_ends:
        n = _add(con, n, wall, w, px, py, pz, ax, ay, az, low, radius, margin)
    if high_ends:
        n = _add(con, n, wall, w, px, py, pz, ax, ay, az, high, radius, margin)
    if wall[w + _KIND] != STRAIGHT and high > low:
        n = _add_within(
            con,
            n,
            wall,
            w,
            px,
            py,
            pz,
            ax,
            ay,
            az,
            low,
            high,
            low_ends,
            high_ends,
            radius,
            pitch,
            margin,
            robot_scale,
        )
    for i in range(n):
        k = i * CONTACT_SIZE
        _to_world(con, k + 1, matrix, m)
        con[k + 1] += position[o] - _turned(matrix, m, wall, w + _BOX, 0)
        con[k + 2] += position[o + 1] - _turned(matrix, m, wall, w + _BOX, 1)
        con[k + 3] += position[o + 2] - _turned(matrix, m, wall, w + _BOX, 2)
        _to_world(con, k + 4, matrix, m)
        along = ux * con[k + 4] + uy * con[k + 5] + uz * con[k + 6]
        tx, ty, tz = ux - along * con[k + 4], uy - along * con[k + 5], uz - along * con[k + 6]
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
        scale = 1.0 / size if size > 1e-6 else 0.0
        con[k + 7], con[k + 8], con[k + 9] = scale * tx, scale * ty, scale * tz
    return n


@_compiled
def _turned(matrix, m, vector, v, row):
    """One row of a geom's rotation times a vector."""
    r = m + 3 * row
    return matrix[r] * vector[v] + matrix[r + 1] * vector[v + 1] + matrix[r + 2] * vector[v + 2]


@_compiled
def _to_world(con, k, matrix, m):
    """Rotate three numbers in place from the fitting's frame to the world's."""
    x, y, z = (
        _turned(matrix, m, con, k, 0),
        _turned(matrix, m, con, k, 1),
        _turned(matrix, m, con, k, 2),
    )
    con[k], con[k + 1], con[k + 2] = x, y, z


assert REDUCER > TEE > ELBOW > STRAIGHT
