"""Contacts of a geom with the sharp edge of a wall: the narrow end of a reducer, an open end.

There the side of a wheel or of an ellipsoid may touch with a point that neither wall beside the
edge is nearest to. So the edge is a geom of its own, a circle about the z axis of its frame, and is
searched for the places that lie deepest in the body. A contact belongs to the edge if its normal
lies between those of the walls on both sides; otherwise it is theirs.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.walls.contacts import CONTACT_SIZE
from omnitrack_sim.walls.record import DEPTH, KIND, MARK, RECORD_SIZE, SIZE, SIZES

RIM = 1.0
"""Number of the kind, less than that of any fitting."""
RADIUS, BEHIND, BEYOND = 0, 1, 2
"""Indices in its sizes: radius, m, and growth of the bore's radius, m/m, away from it towards -z
and towards +z."""
OPEN = 1e9
"""Growth of the radius beyond an open end."""
SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)
"""Types of geoms that touch exact walls."""
LEAST_SAMPLES = 16
FEET = 4
"""Steps by which the foot of a point on an ellipsoid is found."""
FARTHEST_FACE = 4.0
"""Depth behind a face that faces the edge, in depths behind the nearest face, up to which it is
touched."""
BETWEEN, BETWEEN_BY_DEPTH = 1e-4, 6.0
"""Room of a normal's slope beyond those of the walls on both sides, and more of it for each radius
that the edge lies deep in a body: there the walls and the edge no longer agree on whose the contact
is, and one that both leave to the other would let the body through."""
ACCURACY = 1e-6
"""Of a place on the edge, radii."""


def rim_record(radius: float, behind: float, beyond: float, depth: float) -> Array:
    """Return the record (RECORD_SIZE,) of an edge, see ``RADIUS``; ``depth`` m to which it is
    solid."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[KIND], record[SIZE], record[DEPTH] = MARK, RIM, radius, depth
    record[SIZES : SIZES + 3] = radius, behind, beyond
    return record


@compiled
def _faces_edge(d, nx, ny, nz, gate):
    """Return whether a body's outward normal lies between those that the walls beside the edge
    turn against. ``gate``: unit vectors into the bore and along the axis (3 each), geom frame, and
    the growths of the bore, its radius, and whether (over 0) only faces that do count."""
    ix, iy, iz, ax, ay, az, behind, beyond, radius, _ = gate
    room = BETWEEN + BETWEEN_BY_DEPTH * max(-d, 0.0) / radius
    inward, along = -(nx * ix + ny * iy + nz * iz), -(nx * ax + ny * ay + nz * az)
    return inward >= -room and -behind * inward - room <= along <= beyond * inward + room


@compiled
def _nearer(best, d, nx, ny, nz, gate, out):
    """Take over a face at distance ``d`` behind which the point lies, if it is nearer than ``best``
    and faces the edge: where a body's edge crosses the wall's, one of its faces does not."""
    if d <= best or (gate[9] > 0.0 and not _faces_edge(d, nx, ny, nz, gate)):
        return best
    out[0], out[1], out[2] = nx, ny, nz
    return d


@compiled
def _nearer_edge(best, u, m, w, l, gate, out):
    """Take over, as ``_nearer`` does, the edge between two faces with normals ``m`` and ``l``,
    which are ``u`` and ``w`` away: its normal is across the wall's edge."""
    ix, iy, iz, ax, ay, az, _, _, _, _ = gate
    tx, ty, tz = ay * iz - az * iy, az * ix - ax * iz, ax * iy - ay * ix
    p, q = l[0] * tx + l[1] * ty + l[2] * tz, -(m[0] * tx + m[1] * ty + m[2] * tz)
    # Between the two faces both weights have one sign.
    if p * q <= 0.0:
        return best
    p, q = abs(p), abs(q)
    nx, ny, nz = p * m[0] + q * l[0], p * m[1] + q * l[1], p * m[2] + q * l[2]
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    d = (p * u + q * w) / size
    return _nearer(best, d, nx / size, ny / size, nz / size, gate, out)


@compiled
def _outside(u, v, w, out):
    """Distance from a corner whose faces are u, v, w away, and the direction from it."""
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    size = math.sqrt(u * u + v * v + w * w)
    out[0], out[1], out[2] = u / size, v / size, w / size
    return size


@compiled
def _from_hull(x, y, z, hull, normals, gate, out):
    """Distance from a convex hull: that from the face beyond which the point lies farthest."""
    vertices, _, _, count, begins, _, numbers = hull
    best, second = -math.inf, -math.inf
    m = l = (0.0, 0.0, 0.0)
    for polygon in range(count):
        v, k = 3 * numbers[begins[polygon]], 3 * polygon
        normal = normals[k], normals[k + 1], normals[k + 2]
        d = (
            normal[0] * (x - vertices[v])
            + normal[1] * (y - vertices[v + 1])
            + normal[2] * (z - vertices[v + 2])
        )
        if d > best:
            best, second, m, l = d, best, normal, m
        elif d > second:
            second, l = d, normal
    d = _nearer(-math.inf, best, m[0], m[1], m[2], gate, out)
    if d == -math.inf:
        d = _nearer(d, second, l[0], l[1], l[2], gate, out)
    if d == -math.inf:
        d = _nearer_edge(d, best, m, second, l, gate, out)
    return d if d > -math.inf else best


@compiled
def _from_ellipsoid(x, y, z, a, b, c, out):
    """Distance from an ellipsoid that is near: from the plane that touches it where the level of
    the point's foot has its normal. The foot is found by going back along the normal."""
    d, px, py, pz = 0.0, x, y, z
    for _ in range(FEET):
        nx, ny, nz = px / (a * a), py / (b * b), pz / (c * c)
        size = max(math.sqrt(nx * nx + ny * ny + nz * nz), 1e-12)
        nx, ny, nz = nx / size, ny / size, nz / size
        u, v, w = a * nx, b * ny, c * nz
        d = nx * x + ny * y + nz * z - math.sqrt(u * u + v * v + w * w)
        px, py, pz = x - d * nx, y - d * ny, z - d * nz
        out[0], out[1], out[2] = nx, ny, nz
    return d


@compiled
def from_body(kind, sizes, hull, normals, x, y, z, gate, out):
    """Distance, m, of a point from a geom, in the geom's frame; the unit gradient goes to ``out``.
    Within it is negative: that from the nearest face, or from the nearest that faces the edge."""
    a, b, c = sizes[0], sizes[1], sizes[2]
    out[0], out[1], out[2] = 0.0, 0.0, 0.0
    if kind == MESH:
        return _from_hull(x, y, z, hull, normals, gate, out)
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    if kind == BOX:
        u, v, w = sx * x - a, sy * y - b, sz * z - c
        if u > 0.0 or v > 0.0 or w > 0.0:
            d = _outside(u, v, w, out)
            out[0], out[1], out[2] = sx * out[0], sy * out[1], sz * out[2]
            return d
        d = _nearer(-math.inf, u, sx, 0.0, 0.0, gate, out)
        d = _nearer(d, v, 0.0, sy, 0.0, gate, out)
        d = _nearer(d, w, 0.0, 0.0, sz, gate, out)
        if d == -math.inf:
            x_face, y_face, z_face = (sx, 0.0, 0.0), (0.0, sy, 0.0), (0.0, 0.0, sz)
            d = _nearer_edge(d, u, x_face, v, y_face, gate, out)
            d = _nearer_edge(d, v, y_face, w, z_face, gate, out)
            d = _nearer_edge(d, w, z_face, u, x_face, gate, out)
        return d if d > -math.inf else max(u, v, w)
    if kind == ELLIPSOID:
        return _from_ellipsoid(x, y, z, a, b, c, out)
    if kind == CYLINDER:
        r = max(math.sqrt(x * x + y * y), 1e-12)
        u, w = r - a, sz * z - b
        if u > 0.0 or w > 0.0:
            d = _outside(u, 0.0, w, out)
            out[0], out[1], out[2] = out[0] * x / r, out[0] * y / r, sz * out[2]
            return d
        d = _nearer(-math.inf, u, x / r, y / r, 0.0, gate, out)
        d = _nearer(d, w, 0.0, 0.0, sz, gate, out)
        if d == -math.inf:
            d = _nearer_edge(d, u, (x / r, y / r, 0.0), w, (0.0, 0.0, sz), gate, out)
        return d if d > -math.inf else max(u, w)
    along = min(max(z, -b), b) if kind == CAPSULE else 0.0
    size = max(math.sqrt(x * x + y * y + (z - along) * (z - along)), 1e-12)
    out[0], out[1], out[2] = x / size, y / size, (z - along) / size
    return size - a


@compiled
def _at(angle, frame, body, strict, out):
    """Distance of the edge's point at an angle from the body, and its derivative by arc length; in
    ``out`` the point and the gradient, both in the edge's frame, from 4 and from 7 on."""
    kind, sizes, hull, normals, radius, behind, beyond = body
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    cos, sin = math.cos(angle), math.sin(angle)
    dx, dy, dz = radius * cos - px, radius * sin - py, -pz
    x, y, z = (
        xx * dx + yx * dy + zx * dz,
        xy * dx + yy * dy + zy * dz,
        xz * dx + yz * dy + zz * dz,
    )
    ix, iy, iz = -xx * cos - yx * sin, -xy * cos - yy * sin, -xz * cos - yz * sin
    gate = ix, iy, iz, zx, zy, zz, behind, beyond, radius, strict
    d = from_body(kind, sizes, hull, normals, x, y, z, gate, out)
    gx = xx * out[0] + xy * out[1] + xz * out[2]
    gy = yx * out[0] + yy * out[1] + yz * out[2]
    gz = zx * out[0] + zy * out[1] + zz * out[2]
    out[4], out[5], out[6] = radius * cos, radius * sin, 0.0
    out[7], out[8], out[9] = gx, gy, gz
    return d, cos * gy - sin * gx


@compiled
def _add(con, n, d, radius, behind, beyond, depth, margin, out):
    """Add the contact at the point in ``out``, see ``_at``, if it is the edge's."""
    ex, ey, ez, nx, ny, nz = out[4], out[5], out[6], out[7], out[8], out[9]
    if d >= margin or d <= -depth:
        return n
    gate = -ex / radius, -ey / radius, 0.0, 0.0, 0.0, 1.0, behind, beyond, radius, 1.0
    if nx * nx + ny * ny + nz * nz == 0.0 or not _faces_edge(d, nx, ny, nz, gate):
        return n
    k = n * CONTACT_SIZE
    con[k] = d
    # Half way between the edge and the body's surface.
    con[k + 1], con[k + 2], con[k + 3] = ex - 0.5 * d * nx, ey - 0.5 * d * ny, ez - 0.5 * d * nz
    con[k + 4], con[k + 5], con[k + 6] = -nx, -ny, -nz
    con[k + 7] = con[k + 8] = con[k + 9] = 0.0
    return n + 1


@compiled
def rim_contacts(con, records, w, kind, sizes, hull, normals, frame, margin, most, out):
    """Find the contacts of a geom with an edge, in the edge's frame; returns their number.

    Args:
        con: room for ``most`` contacts.
        records, w: user data of all geoms, and where the record of the edge begins.
        kind, sizes, hull, normals: of the geom; its hull, and the normals of its polygons, where it
            is a mesh.
        frame: of the geom in the edge's frame, see ``bodies``.
        margin: m, up to which contacts count.
    """
    radius, behind, beyond = records[w + SIZES], records[w + SIZES + 1], records[w + SIZES + 2]
    # The distance to a cone knows its edge, as far as the middle of a ball is not in the wall.
    if beyond < OPEN and kind in (SPHERE, CAPSULE):
        return 0
    body = kind, sizes, hull, normals, radius, behind, beyond
    depth, n, a, end = records[w + DEPTH], 0, 0.0, 2.0 * math.pi
    first = _at(0.0, frame, body, 0.0, out)
    d_a, slope_a = first
    while a < end and n < most:
        # The distance changes by no more than a metre a metre.
        stride = max(end / LEAST_SAMPLES / 4.0, 0.5 * (d_a - margin) / radius)
        b = min(a + min(stride, end / LEAST_SAMPLES), end)
        # Where it closes rounding must not hide a minimum.
        d_b, slope_b = _at(b, frame, body, 0.0, out) if b < end else first
        if slope_a < 0.0 <= slope_b and min(d_a, d_b) - radius * (b - a) < margin:
            low, high, slope = a, b, 1.0
            while high - low > ACCURACY and abs(slope) > 1e-9:
                middle = 0.5 * (low + high)
                _, slope = _at(middle, frame, body, 0.0, out)
                low, high = (middle, high) if slope < 0.0 else (low, middle)
            nearest, _ = _at(0.5 * (low + high), frame, body, 0.0, out)
            d, _ = _at(0.5 * (low + high), frame, body, 1.0, out)
            # A face much deeper than the nearest is one on the other side of the body.
            if d >= min(FARTHEST_FACE * nearest, nearest):
                n = _add(con, n, d, radius, behind, beyond, depth, margin, out)
        a, d_a, slope_a = b, d_b, slope_b
    return n
