"""Contacts within the faces of bodies with walls that bulge into the bore, or are smooth.

A wall that is concave in some direction everywhere is nearest to a body's edges; a bump is nearest
to the middle of a face. So the distance and its slopes are sampled over each face that may be near
such a wall, as finely as its waves are wide. Between four samples there is a minimum only where
both slopes change their sign; from there it is followed. The round faces of cylinders and
ellipsoids are sampled likewise at walls that are smooth all over.

A face is 16 numbers: a frame (12), a shape and three sizes, m. Its places are two numbers from -1
to 1.
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import at, call_surface, scratch
from omnitrack_sim.walls.contacts import point_at, touch
from omnitrack_sim.walls.curves import holds

RECTANGLE, DISC, TRIANGLE, MANTLE, SIDE = 0.0, 1.0, 2.0, 3.0, 4.0
"""Shapes of faces: of half sizes; of a half size; of half of its longest side, half of the height
over it, and how far along it the third corner is from the first one; of a cylinder's radius and
half length; and the first of the six sides of an ellipsoid of half axes."""
SAMPLES, AROUND, ON_SIDE = 32, 16, 4
"""Of a face along either coordinate, at most; cells round a mantle, and along either coordinate of
an ellipsoid's side, at least: their own bend counts as well."""
CHORD = 0.92
"""Distance of the middle of a side of a cube on a ball of radius 1 from its corners there."""
STEPS, LEVEL, ON_FACE = 40, 1e-4, 5e-3
"""Of the search for a minimum: steps at most, the slope, m/m, at which it ends, and the one up to
which its end counts as a minimum."""
BEYOND = 0.75
"""Way from the middle of a cell, in cells, from which on the search leaves it to others."""
FAR = 1e9
"""Stands for a sample whose neighbourhood touches nothing, m."""


@compiled
def _is_within(face, u, v):
    """Tell whether a place is on a face."""
    shape = face[12]
    if shape == MANTLE:
        return abs(v) <= 1.0
    if shape == DISC:
        return u * u + v * v <= 1.0
    if shape == TRIANGLE:
        # Both shares of the sides from its first corner are at least 0, and 1 at most together.
        q = 0.5 * (v + 1.0)
        p = 0.5 * (u + 1.0) - q * face[15] / (2.0 * face[13])
        return p >= 0.0 and q >= 0.0 and p + q <= 1.0
    return abs(u) <= 1.0 and abs(v) <= 1.0


@compiled
def _on_side(side, a, b, c, u, v):
    """Return point and both tangents, geom frame, on a side of an ellipsoid, see ``_at``."""
    n, sign = 1.0 / math.sqrt(1.0 + u * u + v * v), 1.0 - 2.0 * (side % 2.0)
    # On a ball of radius 1, of the side's axis and both others; each coordinate turns it.
    w, uu, vv = n, n * u, n * v
    du, dv = -n * uu, -n * vv
    along = sign * w, uu, vv
    by_u = sign * w * du, n + uu * du, vv * du
    by_v = sign * w * dv, uu * dv, n + vv * dv
    axis = side // 2.0
    if axis == 0.0:
        return (
            (a * along[0], b * along[1], c * along[2]),
            (a * by_u[0], b * by_u[1], c * by_u[2]),
            (a * by_v[0], b * by_v[1], c * by_v[2]),
        )
    if axis == 1.0:
        return (
            (a * along[2], b * along[0], c * along[1]),
            (a * by_u[2], b * by_u[0], c * by_u[1]),
            (a * by_v[2], b * by_v[0], c * by_v[1]),
        )
    return (
        (a * along[1], b * along[2], c * along[0]),
        (a * by_u[1], b * by_u[2], c * by_u[0]),
        (a * by_v[1], b * by_v[2], c * by_v[0]),
    )


@compiled
def _at(face, u, v):
    """Return a place of a face and the tangents of both coordinates, geom frame, m."""
    shape, p, q = face[12], face[13], face[14]
    if shape >= SIDE:
        return _on_side(shape - SIDE, p, q, face[15], u, v)
    if shape == MANTLE:
        cos, sin = math.cos(math.pi * u), math.sin(math.pi * u)
        turn = math.pi * p
        return (p * cos, p * sin, q * v), (-turn * sin, turn * cos, 0.0), (0.0, 0.0, q)
    return (p * u, q * v, 0.0), (p, 0.0, 0.0), (0.0, q, 0.0)


@compiled
def _along(face, way, out):
    """Return the slope of the distance, whose gradient is in ``out``, along a tangent."""
    x, y, z = way
    return (
        out[0] * (face[3] * x + face[4] * y + face[5] * z)
        + out[1] * (face[6] * x + face[7] * y + face[8] * z)
        + out[2] * (face[9] * x + face[10] * y + face[11] * z)
    )


@compiled
def _point(face, place):
    """Return a place of a face, geom frame, in the fitting's frame."""
    return point_at(face[:12], place[0], place[1], place[2])


@compiled
def _distance_at(wall, face, u, v, out):
    """Return the distance from the wall at a place of a face, and its slopes by both coordinates.

    In m, for their whole length of 1.
    """
    place, by_u, by_v = _at(face, u, v)
    x, y, z = _point(face, place)
    d = call_surface(wall[0], wall[2], x, y, z, out)
    return d, _along(face, by_u, out), _along(face, by_v, out)


@compiled
def _length(way):
    """Length of a vector."""
    return math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])


@compiled
def _descend(wall, face, u, v, du, dv, out):
    """Return the place of the minimum that is reached from a place, and whether it is one.

    By steps along the slope, as long as the last change of the slope over its way asks for
    (Barzilai and Borwein), no farther off than ``du`` and ``dv``.
    """
    _, by_u, by_v = _at(face, u, v)
    m_u, m_v = 1.0 / max(_length(by_u), 1e-12), 1.0 / max(_length(by_v), 1e-12)
    first_u, first_v = u, v
    d, p, q = _distance_at(wall, face, u, v, out)
    p, q = p * m_u, q * m_v
    size, longest = math.sqrt(p * p + q * q), 0.5 * min(du / m_u, dv / m_v)
    length = 0.25 * longest / max(size, 1e-9)
    for _ in range(STEPS):
        if size < LEVEL:
            break
        length = min(length, longest / size)
        u_there, v_there = u - length * p * m_u, v - length * q * m_v
        off_u, off_v = abs(u_there - first_u) / du, abs(v_there - first_v) / dv
        if max(off_u, off_v) > 1.0:
            if max(abs(u - first_u) / du, abs(v - first_v) / dv) > BEYOND:
                return u, v, False
            length *= 0.5
            continue
        there, r, s = _distance_at(wall, face, u_there, v_there, out)
        r, s = r * m_u, s * m_v
        if there > d + 1e-12:
            length *= 0.3
            continue
        a, b = (u_there - u) / m_u, (v_there - v) / m_v
        along, way = (r - p) * a + (s - q) * b, a * a + b * b
        u, v, d, p, q = u_there, v_there, there, r, s
        size = math.sqrt(p * p + q * q)
        length = way / along if along > 1e-15 else 2.0 * length
    return u, v, size < ON_FACE and _is_within(face, u, v)


@compiled
def _cells(face, detail):
    """Return the numbers of cells along both coordinates, and their largest sizes, m."""
    shape, p, q = face[12], face[13], face[14]
    least_u, least_v, long_u, long_v = 2, 2, 2.0 * p, 2.0 * q
    if shape >= SIDE:
        r, axis = face[15], (shape - SIDE) // 2.0
        along = p if axis == 0.0 else (q if axis == 1.0 else r)
        half_u = q if axis == 0.0 else (r if axis == 1.0 else p)
        half_v = r if axis == 0.0 else (p if axis == 1.0 else q)
        # Its normal turns the faster the farther it reaches out.
        least_u = math.ceil(ON_SIDE * max(along / half_u, 1.0))
        least_v = math.ceil(ON_SIDE * max(along / half_v, 1.0))
        long_u = long_v = 2.0 * max(p, q, r)
    elif shape == MANTLE:
        least_u, long_u = AROUND, 2.0 * math.pi * p
    rows = min(max(math.ceil(long_u / detail), least_u), SAMPLES)
    columns = min(max(math.ceil(long_v / detail), least_v), SAMPLES)
    return rows, columns, long_u / rows, long_v / columns


@compiled
def _radius(face):
    """Return the radius, m, of a ball about a face's middle that holds it."""
    shape, p, q = face[12], face[13], face[14]
    if shape >= SIDE:
        return CHORD * max(p, q, face[15])
    return 2.0 * p + q if shape == MANTLE else math.sqrt(p * p + q * q)


@compiled
def _sample_row(wall, face, u, columns, step, near, samples, out):
    """Write distance and slopes at the places of a row to ``samples``, ``FAR`` where it is far.

    Those up to ``near`` m from the wall are not; ``step`` m lie between two at most.
    """
    for j in range(columns + 1):
        samples[3 * j] = FAR
    d, _, _ = _distance_at(wall, face, u, 0.0, out)
    if d - 0.5 * step * columns >= near:
        return
    j = 0
    while j <= columns:
        d, p, q = _distance_at(wall, face, u, 2.0 * j / columns - 1.0, out)
        if d < near:
            samples[3 * j], samples[3 * j + 1], samples[3 * j + 2] = d, p, q
        # The distance changes by no more than one metre a metre.
        j += max(1, math.floor((d - near) / step))


@compiled
def _may_hold_minimum(low, high, margin, diagonal):
    """Tell whether there may be a minimum up to ``margin`` m between two samples of two rows.

    ``low`` and ``high``: the first ones of each row.
    """
    if max(low[0], low[3], high[0], high[3]) >= FAR:
        return False
    if 0.25 * (low[0] + low[3] + high[0] + high[3]) - 0.5 * diagonal >= margin:
        return False
    # A slope that is a linear function with its zero between them has both signs at the corners.
    for k in range(1, 3):
        least = min(low[k], low[3 + k], high[k], high[3 + k])
        most = max(low[k], low[3 + k], high[k], high[3 + k])
        if least > 0.0 or most < 0.0:
            return False
    return True


@compiled
def face_contacts(con, n, wall, face, detail, out):
    """Add the contacts within a face, see ``contacts.keep``.

    Args:
        con: room for contacts.
        n: how many there are.
        wall: see ``bodies.wall_of``.
        face: see the module.
        detail: m, as fine as which it is sampled.
        out: room for what the surface writes.
    """
    margin = wall[5]
    if _distance_at(wall, face, 0.0, 0.0, out)[0] - _radius(face) >= margin:
        return n
    rows, columns, step_u, step_v = _cells(face, detail)
    diagonal, samples = math.sqrt(step_u * step_u + step_v * step_v), scratch()
    below, above = samples, at(samples, 3 * (SAMPLES + 1))
    near, du, dv = margin + diagonal, 2.0 / rows, 2.0 / columns
    _sample_row(wall, face, -1.0, columns, step_v, near, below, out)
    for i in range(rows):
        u = -1.0 + i * du
        _sample_row(wall, face, u + du, columns, step_v, near, above, out)
        for j in range(columns):
            if _may_hold_minimum(at(below, 3 * j), at(above, 3 * j), margin, diagonal):
                v = -1.0 + j * dv
                n = _add_minimum(con, n, wall, face, u + 0.5 * du, v + 0.5 * dv, du, dv, out)
        below, above = above, below
    return n


@compiled
def _add_minimum(con, n, wall, face, u, v, du, dv, out):
    """Add the contact at the minimum that is reached from a place of a face."""
    u, v, is_found = _descend(wall, face, u, v, du, dv, out)
    if not is_found:
        return n
    x, y, z = _point(face, _at(face, u, v)[0])
    return touch(con, n, wall, x, y, z, 0.0, out) if holds(wall, x, y, z, out) else n


@compiled
def _side_of(corners, i, j):
    """Return the vector from one corner of a triangle to another, and its length."""
    x, y, z = (
        corners[3 * j] - corners[3 * i],
        corners[3 * j + 1] - corners[3 * i + 1],
        corners[3 * j + 2] - corners[3 * i + 2],
    )
    return x, y, z, math.sqrt(x * x + y * y + z * z)


@compiled
def triangle_contacts(con, n, wall, corners, out):
    """Add the contacts within a triangle of corners (9,) m, fitting frame."""
    # Along its longest side, so that the third corner stands over it.
    i, longest = 0, 0.0
    for k in range(3):
        size = _side_of(corners, k, (k + 1) % 3)[3]
        if size > longest:
            i, longest = k, size
    ux, uy, uz, first = _side_of(corners, i, (i + 1) % 3)
    wx, wy, wz, _ = _side_of(corners, i, (i + 2) % 3)
    if first < 1e-9:
        return n
    ux, uy, uz = ux / first, uy / first, uz / first
    lean = wx * ux + wy * uy + wz * uz
    wx, wy, wz = wx - lean * ux, wy - lean * uy, wz - lean * uz
    second = math.sqrt(wx * wx + wy * wy + wz * wz)
    if second < 1e-9:
        return n
    wx, wy, wz = wx / second, wy / second, wz / second
    p, q = 0.5 * first, 0.5 * second
    x, y, z = (
        corners[3 * i] + p * ux + q * wx,
        corners[3 * i + 1] + p * uy + q * wy,
        corners[3 * i + 2] + p * uz + q * wz,
    )
    # No place of a triangle has a part along its normal.
    frame = x, y, z, ux, wx, 0.0, uy, wy, 0.0, uz, wz, 0.0
    return face_contacts(con, n, wall, (*frame, TRIANGLE, p, q, lean), wall[9], out)
