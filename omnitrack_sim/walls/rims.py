"""Contacts of a geom with the sharp edge of a wall: the narrow end of a reducer, an open end.

There the side of a wheel or of an ellipsoid may touch with a point that neither wall beside the
edge is nearest to. So the edge is a geom of its own, a circle or another section about the z axis
of its frame, and is searched for the places that are nearest to the body or lie deepest in it.
Beside a body its nearest point gives the normal, and a contact belongs to the edge if that lies
between the normals of the walls on both sides; otherwise it is theirs. Within a body the normal is
the one, of those between, along which the body has the least way out.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import at
from omnitrack_sim.pipes.sections import Section
from omnitrack_sim.pipes.sections import distance as from_section
from omnitrack_sim.pipes.sections import leaving as out_of_section
from omnitrack_sim.walls.contacts import CONTACT_SIZE
from omnitrack_sim.walls.curves import FLAT
from omnitrack_sim.walls.record import DEPTH, KIND, MARK, RECORD_SIZE, SIZE, SIZES

RIM = 1.0
"""Number of the kind, less than that of any fitting."""
RADIUS, BEHIND, BEYOND, TURN, SECTION = 0, 1, 2, 3, 4
"""Indices in its sizes: radius, m, and growth of the bore's radius, m/m, away from it towards -z
and towards +z; and of a section that is no circle, the largest turn of the edge, rad, for a radian
about the axis, and the section's numbers. Its radius is the longest way along the edge for one."""
OPEN = 1e9
"""Growth of the radius beyond an open end."""
SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = (
    int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}"))
    for name in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
)
"""Types of geoms that touch exact walls."""
MIN_SAMPLES = 16
FEET = 4
"""Steps by which the foot of a point on an ellipsoid is found."""
DEEPEST, MAX_DEPTH_IN_BORE = 4.0, 1e-3
"""Way out of a body between the walls' normals, in depths behind its nearest face, and in radii
beside these, up to which an edge touches: beyond it the edge is at the body's other side."""
BETWEEN, BETWEEN_BY_DEPTH = 1e-4, 6.0
"""Room, rad, of a normal beyond those of the walls on both sides, and more of it for each radius
that the edge lies deep in a body: there the walls and the edge no longer agree on whose the contact
is, and one that both leave to the other would let the body through."""
NORMALS, HALVINGS = 8, 24
"""Of the search for the least way out: steps between the walls' normals, and steps of the golden
section about the best of these."""
GOLDEN = 0.6180339887498949
AT_WALL = 1e-6
"""Angle, rad, from the last normal that an edge may have up to which the least way out is a wall's:
the search ends 3e-7 from where it goes on. Without it the last digit decides whose the contact is,
and a body has it once from the wall and once from the edge."""
SEPARATE = 5e-4
"""Distance, m, of two places up to which a minimum between them is less than a micrometre deep."""
ACCURACY = 1e-6
"""Of a place on the edge, radii."""


def rim_record(radius: float, behind: float, beyond: float, depth: float) -> Array:
    """Return the record (RECORD_SIZE,) of an edge, see ``RADIUS``, solid to ``depth`` m."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[KIND], record[SIZE], record[DEPTH] = MARK, RIM, radius, depth
    record[SIZES : SIZES + 3] = radius, behind, beyond
    return record


def section_rim_record(edge: Section, depth: float) -> Array:
    """Return the record (RECORD_SIZE,) of an open end's edge that is no circle."""
    way, turn = edge.rim_numbers()
    record = rim_record(way, 0.0, OPEN, depth)
    numbers = (turn, *edge.numbers)
    record[SIZES + TURN : SIZES + TURN + len(numbers)] = numbers
    return record


@compiled
def _outside(u, v, w, out):
    """Distance from a corner whose faces are u, v, w away, and the direction from it."""
    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    size = math.sqrt(u * u + v * v + w * w)
    out[0], out[1], out[2] = u / size, v / size, w / size
    return size


@compiled
def _from_polygons(x, y, z, hull, normals, out):
    """Return the distance of a point outside from a convex hull; the direction goes to ``out``.

    It is that from the nearest of the polygons that face the point.
    """
    vertices, _, _, count, begins, sizes, numbers = hull
    least = math.inf
    for polygon in range(count):
        k, first, size = 3 * polygon, begins[polygon], sizes[polygon]
        nx, ny, nz = normals[k], normals[k + 1], normals[k + 2]
        a = 3 * numbers[first + size - 1]
        d = nx * (x - vertices[a]) + ny * (y - vertices[a + 1]) + nz * (z - vertices[a + 2])
        if d < 0.0 or d * d >= least:
            continue
        above = True
        for i in range(size):
            b = 3 * numbers[first + i]
            px, py, pz = x - vertices[a], y - vertices[a + 1], z - vertices[a + 2]
            ex = float(vertices[b]) - vertices[a]
            ey = float(vertices[b + 1]) - vertices[a + 1]
            ez = float(vertices[b + 2]) - vertices[a + 2]
            a = b
            # Vertices go round the outward normal, so this is over 0 beyond the edge.
            if (
                px * (ey * nz - ez * ny) + py * (ez * nx - ex * nz) + pz * (ex * ny - ey * nx)
                <= 0.0
            ):
                continue
            above = False
            s = (px * ex + py * ey + pz * ez) / (ex * ex + ey * ey + ez * ez)
            s = min(max(s, 0.0), 1.0)
            px, py, pz = px - s * ex, py - s * ey, pz - s * ez
            square = px * px + py * py + pz * pz
            if square < least:
                least = square
                out[0], out[1], out[2] = px, py, pz
        if above:
            least = d * d
            out[0], out[1], out[2] = d * nx, d * ny, d * nz
    d = max(math.sqrt(least), 1e-12)
    out[0], out[1], out[2] = out[0] / d, out[1] / d, out[2] / d
    return d


@compiled
def _from_hull(x, y, z, hull, normals, out):
    """Distance from a convex hull: within it, that from the face which is nearest."""
    vertices, _, _, count, begins, _, numbers = hull
    best = -math.inf
    for polygon in range(count):
        v, k = 3 * numbers[begins[polygon]], 3 * polygon
        nx, ny, nz = normals[k], normals[k + 1], normals[k + 2]
        d = nx * (x - vertices[v]) + ny * (y - vertices[v + 1]) + nz * (z - vertices[v + 2])
        if d > best:
            best, out[0], out[1], out[2] = d, nx, ny, nz
    return _from_polygons(x, y, z, hull, normals, out) if best > 0.0 else best


@compiled
def _from_ellipsoid(x, y, z, a, b, c, out):
    """Return the distance from an ellipsoid that is near, by the plane that touches it.

    It touches where the level of the point's foot has its normal. The foot is found by going back
    along the normal.
    """
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
def from_body(kind, sizes, hull, normals, x, y, z, out):
    """Return the distance, m, of a point from a geom, in its frame; the gradient goes to ``out``.

    Within it is negative: that from the nearest face.
    """
    a, b, c = sizes[0], sizes[1], sizes[2]
    if kind == MESH:
        return _from_hull(x, y, z, hull, normals, out)
    if kind == ELLIPSOID:
        return _from_ellipsoid(x, y, z, a, b, c, out)
    if kind in (SPHERE, CAPSULE):
        along = min(max(z, -b), b) if kind == CAPSULE else 0.0
        size = max(math.sqrt(x * x + y * y + (z - along) * (z - along)), 1e-12)
        out[0], out[1], out[2] = x / size, y / size, (z - along) / size
        return size - a
    sx, sy, sz = math.copysign(1.0, x), math.copysign(1.0, y), math.copysign(1.0, z)
    if kind == BOX:
        u, v, w = sx * x - a, sy * y - b, sz * z - c
    else:
        r = max(math.sqrt(x * x + y * y), 1e-12)
        # A cylinder is a box whose first axis turns with the point.
        sx, sy, u, v, w = x / r, y / r, r - a, -math.inf, sz * z - b
    if u > 0.0 or v > 0.0 or w > 0.0:
        d = _outside(u, v, w, out)
    else:
        d = max(u, v, w)
        out[0], out[1], out[2] = 1.0 * (d == u), 1.0 * (d == v), 1.0 * (d == w)
    out[1] = sy * (out[1] if kind == BOX else out[0])
    out[0], out[2] = sx * out[0], sz * out[2]
    return d


@compiled
def _extent(kind, sizes, hull, x, y, z):
    """Largest coordinate, m, of a geom's points along a unit vector of its frame."""
    a, b, c = sizes[0], sizes[1], sizes[2]
    if kind == BOX:
        return a * abs(x) + b * abs(y) + c * abs(z)
    if kind == ELLIPSOID:
        return math.sqrt(a * a * x * x + b * b * y * y + c * c * z * z)
    if kind == CYLINDER:
        return a * math.sqrt(x * x + y * y) + b * abs(z)
    if kind == MESH:
        vertices, most = hull[0], -math.inf
        for v in range(hull[1]):
            along = x * vertices[3 * v] + y * vertices[3 * v + 1] + z * vertices[3 * v + 2]
            most = max(most, along)
        return most
    return a + b * abs(z) if kind == CAPSULE else a


@compiled
def _at(angle, frame, body, out):
    """Return the distance of the edge's point at an angle from the body, and its derivative.

    The derivative is by arc length. ``out`` gets the point from 4 and the gradient from 7 on, in
    the edge's frame, and from 10 on the bore's normal outward, as long as the radius.
    """
    kind, sizes, hull, normals, radius, section = body
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    cos, sin = math.cos(angle), math.sin(angle)
    ex, ey = radius * cos, radius * sin
    nx, ny = ex, ey
    if section[0] != 0.0:
        away = out_of_section(section, 0.0, 0.0, cos, sin, out)
        ex, ey = away * cos, away * sin
        from_section(section, ex, ey, out)
        cos, sin = -out[0], -out[1]
        nx, ny = radius * cos, radius * sin
    dx, dy, dz = ex - px, ey - py, -pz
    x, y, z = (
        xx * dx + yx * dy + zx * dz,
        xy * dx + yy * dy + zy * dz,
        xz * dx + yz * dy + zz * dz,
    )
    d = from_body(kind, sizes, hull, normals, x, y, z, out)
    gx = xx * out[0] + xy * out[1] + xz * out[2]
    gy = yx * out[0] + yy * out[1] + yz * out[2]
    gz = zx * out[0] + zy * out[1] + zz * out[2]
    out[4], out[5], out[6] = ex, ey, 0.0
    out[7], out[8], out[9] = gx, gy, gz
    out[10], out[11] = nx, ny
    return d, cos * gy - sin * gx


@compiled
def _way_out(slant, frame, body, out):
    """Return the distance, m, of the body from the edge's point along a normal.

    The normal is at an angle from the bore's normal towards the axis. Below 0 the body has to go
    there.
    """
    kind, sizes, hull, _, radius, _ = body
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    cos = math.cos(slant) / radius
    x, y, z = -out[10] * cos, -out[11] * cos, math.sin(slant)
    # The body reaches farthest towards the edge against the normal.
    u, v, w = -xx * x - yx * y - zx * z, -xy * x - yy * y - zy * z, -xz * x - yz * y - zz * z
    centre = x * (px - out[4]) + y * (py - out[5]) + z * pz
    return centre - _extent(kind, sizes, hull, u, v, w)


@compiled
def _min_way_out(low, high, frame, body, out):
    """Return the slant in [a, b] of the normal with the least way out, and the distance along it.

    See ``_way_out``.
    """
    step, best, least = (high - low) / NORMALS, low, -math.inf
    for i in range(NORMALS + 1):
        d = _way_out(low + i * step, frame, body, out)
        if d > least:
            best, least = low + i * step, d
    a, b = max(best - step, low), min(best + step, high)
    for _ in range(HALVINGS):
        c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
        if _way_out(c, frame, body, out) > _way_out(d, frame, body, out):
            b = d
        else:
            a = c
    middle = 0.5 * (a + b)
    d = _way_out(middle, frame, body, out)
    return (middle, d) if d > least else (best, least)


@compiled
def _add(con, n, d, slant, depth, margin, out):
    """Add the contact at the point in ``out``, see ``_at``, with the normal at a slant."""
    if d >= margin or d <= -depth:
        return n
    k, ex, ey = n * CONTACT_SIZE, out[4], out[5]
    ux, uy = out[10], out[11]
    inward = math.cos(slant) / math.sqrt(ux * ux + uy * uy)
    nx, ny, nz = -inward * ux, -inward * uy, math.sin(slant)
    con[k] = d
    # Half way between the edge and the body's surface.
    con[k + 1], con[k + 2], con[k + 3] = ex + 0.5 * d * nx, ey + 0.5 * d * ny, 0.5 * d * nz
    con[k + 4], con[k + 5], con[k + 6] = nx, ny, nz
    con[k + 7] = con[k + 8] = con[k + 9] = 0.0
    return n + 1


@compiled
def _may_hide(d_a, slope_a, d_b, slope_b, step, turn, radius, margin):
    """Tell whether a minimum and a maximum may lie between places ``step`` rad apart.

    The distance from a convex body is convex along a line. Along a circle its slope may also fall,
    by the angle at most: that by which it turns.
    """
    if step * radius < SEPARATE or 0.5 * (d_a + d_b - radius * step) >= margin:
        return False
    if slope_a < 0.0 <= slope_b:
        return False
    return slope_a < turn * step and slope_b > -turn * step


@compiled
def _minimum(con, n, low, high, frame, body, slants, depth, margin, out):
    """Add the contact at the minimum of the distance between two angles."""
    slope = 1.0
    while high - low > ACCURACY and abs(slope) > FLAT:
        middle = 0.5 * (low + high)
        _, slope = _at(middle, frame, body, out)
        low, high = (middle, high) if slope < 0.0 else (low, middle)
    d, _ = _at(0.5 * (low + high), frame, body, out)
    radius, (first, last) = body[4], slants
    room = BETWEEN + BETWEEN_BY_DEPTH * max(-d, 0.0) / radius
    first, last = first - room, last + room
    slant = math.atan2(-out[9], (out[7] * out[10] + out[8] * out[11]) / radius)
    if d <= 0.0:
        slant, way = _min_way_out(first, last, frame, body, out)
        if way < DEEPEST * d - MAX_DEPTH_IN_BORE * radius:
            return n
        d = way
    # A way out that goes on getting shorter is that of a wall.
    if first + AT_WALL < slant < last - AT_WALL:
        n = _add(con, n, d, slant, depth, margin, out)
    return n


@compiled
def rim_contacts(con, records, w, kind, sizes, bound, hull, normals, frame, margin, most, out):
    """Find the contacts of a geom with an edge, in the edge's frame; returns their number.

    Args:
        con: room for ``most`` contacts.
        records: user data of all geoms.
        w: where the record of the edge begins.
        kind: of the geom.
        sizes: of the geom.
        bound: m, radius of a ball around the geom.
        hull: of the geom where it is a mesh.
        normals: of the polygons of its hull.
        frame: of the geom in the edge's frame, see ``bodies``.
        margin: m, up to which contacts count.
        most: number of contacts at most.
        out: room for what the surface writes.
    """
    radius, behind, beyond = records[w + SIZES], records[w + SIZES + 1], records[w + SIZES + 2]
    # The distance to a cone knows its edge, as far as the middle of a ball is not in the wall.
    if beyond < OPEN and kind in (SPHERE, CAPSULE):
        return 0
    section, turn = at(records, w + SIZES + SECTION), 1.0
    # Most geoms near the box around an edge are not near the edge.
    if section[0] == 0.0:
        across = math.sqrt(frame[0] * frame[0] + frame[1] * frame[1]) - radius
    else:
        across, turn = from_section(section, frame[0], frame[1], out), records[w + SIZES + TURN]
    if across * across + frame[2] * frame[2] >= (bound + margin) * (bound + margin):
        return 0
    body = kind, sizes, hull, normals, radius, section
    slants = -math.atan(behind), math.atan(beyond)
    depth, n, a, end = records[w + DEPTH], 0, 0.0, 2.0 * math.pi
    first = _at(0.0, frame, body, out)
    d_a, slope_a = first
    while a < end and n < most:
        # The distance changes by no more than a metre a metre.
        stride = max(end / MIN_SAMPLES / 4.0, 0.5 * (d_a - margin) / radius)
        b = min(a + min(stride, end / MIN_SAMPLES), end)
        # Where it closes rounding must not hide a minimum.
        d_b, slope_b = _at(b, frame, body, out) if b < end else first
        while _may_hide(d_a, slope_a, d_b, slope_b, b - a, turn, radius, margin):
            b = 0.5 * (a + b)
            d_b, slope_b = _at(b, frame, body, out)
        if slope_a < 0.0 <= slope_b and min(d_a, d_b) - radius * (b - a) < margin:
            n = _minimum(con, n, a, b, frame, body, slants, depth, margin, out)
        a, d_a, slope_a = b, d_b, slope_b
    return n
