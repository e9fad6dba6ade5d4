"""Contacts of MuJoCo's shapes with one fitting, in the fitting's frame.

At every point of a pipe's wall there is a direction in which it is concave: round the bore, or
along a rim. So a flat face that presses on it is never nearest within, and vertices and edges give
all contacts of a box, a mesh, and the ends of a cylinder. A round body touches where its outward
normal meets the wall's.

A frame is twelve numbers: a geom's centre in the fitting's frame (3), and its axes there, which
are the columns of a rotation written row by row (9).
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.pipes.native import at, call_span, call_surface, row
from omnitrack_sim.walls.contacts import CONTACT_SIZE, MAX_KEPT, MAX_OF_PAIR, point_at, touch
from omnitrack_sim.walls.curves import (
    along_circle,
    along_line,
    holds,
    minimum,
    slope_at,
)
from omnitrack_sim.walls.deepest import LINE, corner_ball, edge_no_deeper, is_in_ball, no_deeper
from omnitrack_sim.walls.faces import MANTLE, face_contacts, triangle_contacts
from omnitrack_sim.walls.faces import SIDE as ELLIPSOID_SIDE
from omnitrack_sim.walls.record import BOX, BUMPS, ENDS, SIZE, WAVES
from omnitrack_sim.walls.rims import CYLINDER, ELLIPSOID

SAME_IN_BORE, SAME_IN_REACH = 0.04, 0.05
"""Contacts nearer to each other than this part of the bore's radius (3 mm at 80 mm), and of that of
a ball round the geom, are one."""
SPACING_IN_BORE = 0.1
"""Largest spacing of the samples between which a minimum is looked for, in radii of the bore: 8 mm
at 80 mm."""
MANTLE_LINES, MANTLE_SPACING = 16, 2.5
"""Lines along a cylinder's mantle between which its minima are looked for, and the largest spacing
of samples on each, in those of ``SPACING_IN_BORE``."""
SEEDS = 14
DESCENT_STEPS = 40
"""Of the search for a contact of an ellipsoid: where it begins, and its steps at most."""
ANGLE, LEVEL = 1e-5, 1e-2
"""Accuracy of a place on a cylinder, rad; and slope round it, m/m, up to which it is a minimum."""
FACING = 3e-4
"""Accuracy with which an ellipsoid faces the wall where it touches, rad. The depth is off by its
square: 1e-9 m."""


@compiled
def wall_of(surface, span, sizes, records, w, depth, margin, reach):
    """Return what all contacts of a pair need.

    Addresses of ``surface`` and ``span``, sizes, ends, depth of the wall, margin, distance up to
    which two contacts are one, spacing of samples, radius of the bore, width of the bumps that
    stand in it, 0 without any, and of the waves of a smooth wall, 0 for others, m.

    Args:
        surface: address.
        span: address.
        sizes: of the wall.
        records: user data of all geoms.
        w: where that of the wall begins.
        depth: m, to which the wall is solid.
        margin: m, up to which contacts count.
        reach: m, radius of a ball around the geom.
    """
    size = records[w + SIZE]
    same = min(SAME_IN_BORE * size, SAME_IN_REACH * reach)
    bumps, waves, spacing = records[w + BUMPS], records[w + WAVES], SPACING_IN_BORE * size
    if bumps > 0.0:
        spacing = min(spacing, bumps)
    if waves > 0.0:
        spacing = min(spacing, waves)
    return (
        surface,
        span,
        sizes,
        at(records, w + ENDS),
        depth,
        margin,
        same,
        spacing,
        size,
        bumps,
        waves,
    )


@compiled
def point_in(records, w, position, matrix, x, y, z, g_wall):
    """Return a point of the world in the frame of the fitting of a wall."""
    b, m = 3 * g_wall, 9 * g_wall
    x, y, z = x - position[b], y - position[b + 1], z - position[b + 2]
    # The box that bounds the fitting has its centre elsewhere.
    return (
        matrix[m] * x + matrix[m + 3] * y + matrix[m + 6] * z + records[w + BOX],
        matrix[m + 1] * x + matrix[m + 4] * y + matrix[m + 7] * z + records[w + BOX + 1],
        matrix[m + 2] * x + matrix[m + 5] * y + matrix[m + 8] * z + records[w + BOX + 2],
    )


@compiled
def frame_in(records, w, position, matrix, g_geom, g_wall):
    """Return the frame of a geom in that of the fitting of a wall."""
    a, m, k = 3 * g_geom, 9 * g_wall, 9 * g_geom
    x, y, z = position[a], position[a + 1], position[a + 2]
    x, y, z = point_in(records, w, position, matrix, x, y, z, g_wall)
    return (
        x,
        y,
        z,
        _product(matrix, m, k),
        _product(matrix, m, k + 1),
        _product(matrix, m, k + 2),
        _product(matrix, m + 1, k),
        _product(matrix, m + 1, k + 1),
        _product(matrix, m + 1, k + 2),
        _product(matrix, m + 2, k),
        _product(matrix, m + 2, k + 1),
        _product(matrix, m + 2, k + 2),
    )


@compiled
def _product(matrix, a, b):
    """Scalar product of two columns of rotations."""
    return matrix[a] * matrix[b] + matrix[a + 3] * matrix[b + 3] + matrix[a + 6] * matrix[b + 6]


@compiled
def sphere(con, n, wall, frame, radius, out):
    """Add the contact of a sphere."""
    x, y, z = frame[0], frame[1], frame[2]
    if not holds(wall, x, y, z, out):
        return n
    return touch(con, n, wall, x, y, z, radius, out)


@compiled
def _edge(con, n, wall, frame, ax, ay, az, bx, by, bz, ends, reach, out):
    """Add the contacts along the line between two points of the geom, see ``along_line``."""
    px, py, pz = point_at(frame, 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz))
    qx, qy, qz = point_at(frame, bx, by, bz)
    ux, uy, uz = qx - px, qy - py, qz - pz
    half = math.sqrt(ux * ux + uy * uy + uz * uz)
    if half < 1e-12:
        return n
    line = (px, py, pz, ux / half, uy / half, uz / half, 0.0, 0.0, 0.0, 0.0)
    return along_line(con, n, wall, line, half, ends, ends, reach, out)


@compiled
def capsule(con, n, wall, frame, radius, half, out):
    """Add the contacts of a capsule: those of a ball along its axis."""
    n = _edge(con, n, wall, frame, 0.0, 0.0, -half, 0.0, 0.0, half, 1.0, radius, out)
    return no_deeper(con, n, wall, frame, (LINE, 0.0, half, 0.0), radius, out)


@compiled
def _corner(a, b, c, i):
    """Corner number ``i`` of a box: the bits are the signs of x, y and z."""
    return a * (1.0 - 2.0 * (i & 1)), b * (1.0 - 2.0 * (i >> 1 & 1)), c * (1.0 - 2.0 * (i >> 2))


@compiled
def box(con, n, wall, frame, a, b, c, out):
    """Add the contacts of a box: along its edges, those along x with the vertices."""
    distances = row()
    for i in range(8):
        px, py, pz = _corner(a, b, c, i)
        x, y, z = point_at(frame, px, py, pz)
        distances[i] = call_surface(wall[0], wall[2], x, y, z, out)
    for axis in range(3):
        half = a if axis == 0 else (b if axis == 1 else c)
        bit = 1 << axis
        for i in range(8):
            # The distance changes by no more than one metre a metre.
            if i & bit or 0.5 * (distances[i] + distances[i | bit]) - half >= wall[5]:
                continue
            px, py, pz = _corner(a, b, c, i)
            qx, qy, qz = _corner(a, b, c, i | bit)
            ends = 1.0 if axis == 0 else 0.0
            n = _edge(con, n, wall, frame, px, py, pz, qx, qy, qz, ends, 0.0, out)
    n = _box_edges(con, n, wall, frame, a, b, c, distances, out)
    if wall[9] > 0.0:
        for side in (-1.0, 1.0):
            n = face_of(con, n, wall, frame, 0, side * a, b, c, 0.0, out)
            n = face_of(con, n, wall, frame, 1, side * b, c, a, 0.0, out)
            n = face_of(con, n, wall, frame, 2, side * c, a, b, 0.0, out)
    return n


@compiled
def face_of(con, n, wall, frame, axis, height, half_a, half_b, shape, out):
    """Add the contacts within a face across an axis of a geom, ``height`` m from its middle."""
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    x, y, z = (xx, yx, zx), (xy, yy, zy), (xz, yz, zz)
    normal = x if axis == 0 else (y if axis == 1 else z)
    u = y if axis == 0 else (z if axis == 1 else x)
    v = z if axis == 0 else (x if axis == 1 else y)
    middle = px + height * normal[0], py + height * normal[1], pz + height * normal[2]
    axes = u[0], v[0], normal[0], u[1], v[1], normal[1], u[2], v[2], normal[2]
    face = (*middle, *axes, shape, half_a, half_b, 0.0)
    return face_contacts(con, n, wall, face, wall[9], out)


@compiled
def _box_edges(con, n, wall, frame, a, b, c, distances, out):
    """Add contacts until no edge of a box is deeper than they are, see ``deepest``."""
    ball, target = corner_ball(con, n, wall, frame, out)
    is_within = True
    for i in range(8):
        px, py, pz = _corner(a, b, c, i)
        x, y, z = point_at(frame, px, py, pz)
        is_within = is_within and is_in_ball(ball, x, y, z, target)
    if is_within:
        return n
    for i in range(8):
        px, py, pz = _corner(a, b, c, i)
        x, y, z = point_at(frame, px, py, pz)
        for axis in range(3):
            j = i | 1 << axis
            if i == j:
                continue
            px, py, pz = _corner(a, b, c, j)
            u, v, w = point_at(frame, px, py, pz)
            one, other = (x, y, z, distances[i]), (u, v, w, distances[j])
            n = edge_no_deeper(con, n, wall, ball, one, other, out)
    return n


@compiled
def mesh(con, n, wall, frame, hull, out):
    """Add the contacts of a mesh's convex hull: at its vertices and along its edges.

    Args:
        con: room for contacts.
        n: how many there are.
        wall: see ``wall_of``.
        frame: of the geom in the fitting's frame.
        hull: its vertices (float32), how many, the number of polygons at each, how many polygons,
            where the vertices of each begin, how many they are, and their numbers.
        out: room for what the surface writes.
    """
    vertices, vertex_count, polygons_at, count, begins, sizes, numbers = hull
    # The distances of the vertices stand where MuJoCo has room for contacts that are never kept.
    is_known = vertex_count <= CONTACT_SIZE * (MAX_OF_PAIR - MAX_KEPT - 1)
    distances = at(con, CONTACT_SIZE * (MAX_KEPT + 1))
    for v in range(vertex_count):
        # Of the vertices of the mesh those of its hull alone belong to a polygon.
        if polygons_at[v] > 0:
            x, y, z = _vertex(frame, vertices, v)
            d = call_surface(wall[0], wall[2], x, y, z, out)
            if is_known:
                distances[v] = d
            if d < wall[5] and holds(wall, x, y, z, out):
                n = touch(con, n, wall, x, y, z, 0.0, out)
    for polygon in range(count):
        first, size = begins[polygon], sizes[polygon]
        a = numbers[first + size - 1]
        for i in range(size):
            b = numbers[first + i]
            # Each edge stands in two polygons, once in either direction.
            if a < b:
                px, py, pz = _coordinates(vertices, a)
                qx, qy, qz = _coordinates(vertices, b)
                length = math.sqrt((qx - px) ** 2 + (qy - py) ** 2 + (qz - pz) ** 2)
                if not is_known or 0.5 * (distances[a] + distances[b] - length) < wall[5]:
                    n = _edge(con, n, wall, frame, px, py, pz, qx, qy, qz, 0.0, 0.0, out)
            a = b
    n = _mesh_edges(con, n, wall, frame, hull, out) if is_known else n
    if wall[9] > 0.0:
        for polygon in range(count):
            n = mesh_face(con, n, wall, frame, hull, polygon, out)
    return n


@compiled
def mesh_face(con, n, wall, frame, hull, polygon, out):
    """Add the contacts within a polygon of a hull: those within its triangles from one corner."""
    vertices, _, _, _, begins, sizes, numbers = hull
    first, size = begins[polygon], sizes[polygon]
    ax, ay, az = _vertex(frame, vertices, numbers[first])
    for i in range(1, size - 1):
        bx, by, bz = _vertex(frame, vertices, numbers[first + i])
        cx, cy, cz = _vertex(frame, vertices, numbers[first + i + 1])
        corners = ax, ay, az, bx, by, bz, cx, cy, cz
        n = triangle_contacts(con, n, wall, corners, out)
    return n


@compiled
def _mesh_edges(con, n, wall, frame, hull, out):
    """Add contacts until no edge of a hull is deeper than they are, see ``deepest``."""
    vertices, vertex_count, polygons_at, count, begins, sizes, numbers = hull
    distances = at(con, CONTACT_SIZE * (MAX_KEPT + 1))
    ball, target = corner_ball(con, n, wall, frame, out)
    is_within = True
    for v in range(vertex_count):
        if is_within and polygons_at[v] > 0:
            x, y, z = _vertex(frame, vertices, v)
            is_within = is_in_ball(ball, x, y, z, target)
    if is_within:
        return n
    for polygon in range(count):
        first, size = begins[polygon], sizes[polygon]
        a = numbers[first + size - 1]
        for i in range(size):
            b = numbers[first + i]
            if a < b:
                x, y, z = _vertex(frame, vertices, a)
                u, v, w = _vertex(frame, vertices, b)
                one, other = (x, y, z, distances[a]), (u, v, w, distances[b])
                n = edge_no_deeper(con, n, wall, ball, one, other, out)
            a = b
    return n


@compiled
def _coordinates(vertices, v):
    """Vertex of a mesh."""
    return float(vertices[3 * v]), float(vertices[3 * v + 1]), float(vertices[3 * v + 2])


@compiled
def _vertex(frame, vertices, v):
    """Vertex of a mesh in the fitting's frame."""
    x, y, z = _coordinates(vertices, v)
    return point_at(frame, x, y, z)


@compiled
def cylinder(con, n, wall, frame, radius, half, out):
    """Add the contacts of a cylinder: along both rims, and on the mantle between them."""
    _, _, _, xx, xy, _, yx, yy, _, zx, zy, _ = frame
    for side in (-half, half):
        px, py, pz = point_at(frame, 0.0, 0.0, side)
        circle = (px, py, pz, xx, yx, zx, xy, yy, zy, radius)
        n = along_circle(con, n, wall, circle, out)
    if wall[10] > 0.0:
        n = round_face(con, n, wall, frame, MANTLE, radius, half, 0.0, out)
    else:
        n = _mantle(con, n, wall, frame, radius, half, out)
    if wall[9] > 0.0:
        for side in (-half, half):
            n = face_of(con, n, wall, frame, 2, side, radius, radius, 1.0, out)
    if wall[10] > 0.0:
        return n
    return no_deeper(con, n, wall, frame, (CYLINDER, radius, half, 0.0), 0.0, out)


@compiled
def round_face(con, n, wall, frame, shape, a, b, c, out):
    """Add the contacts within a round face of a geom with a smooth wall."""
    return face_contacts(con, n, wall, (*frame, shape, a, b, c), wall[10], out)


@compiled
def _mantle_line(wall, frame, radius, half, angle, out):
    """Least distance along the mantle's line at an angle, where it lies between the ends.

    Returns whether there is one (over 0), its place along the line, m, and the derivative of the
    distance round the cylinder there. At a bend there may be one though the wall falls away beyond
    it before the ends.
    """
    c, s = math.cos(angle), math.sin(angle)
    px, py, pz = point_at(frame, radius * c, radius * s, 0.0)
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    line = (px, py, pz, xz, yz, zz, 0.0, 0.0, 0.0, 0.0)
    surface, sizes = wall[0], wall[2]
    # Most lines of a mantle are farther from the wall than they are long.
    if call_surface(surface, sizes, px, py, pz, out) - half >= wall[5]:
        return 0.0, 0.0, 0.0
    out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -half, half, 0.0, 0.0
    call_span(wall[1], sizes, wall[3], px, py, pz, xz, yz, zz, out)
    low, high = out[LOW], out[HIGH]
    if high <= low:
        return 0.0, 0.0, 0.0
    least, place, round_it, a = math.inf, 0.0, 0.0, low
    step = (high - low) / math.ceil((high - low) / (MANTLE_SPACING * wall[7]))
    d_a, slope_a, _ = slope_at(surface, sizes, line, low, out)
    while a < high - 0.5 * step:
        b = a + step
        d_b, slope_b, _ = slope_at(surface, sizes, line, b, out)
        if slope_a < 0.0 <= slope_b and 0.5 * (d_a + d_b - step) < wall[5]:
            t = minimum(surface, sizes, line, a, slope_a, b, slope_b, out)
            d, _, _ = slope_at(surface, sizes, line, t, out)
            if d < least:
                tx, ty, tz = c * xy - s * xx, c * yy - s * yx, c * zy - s * zx
                least, place, round_it = d, t, out[0] * tx + out[1] * ty + out[2] * tz
        a, d_a, slope_a = b, d_b, slope_b
    return (1.0 if least < math.inf else 0.0), place, round_it


@compiled
def _mantle(con, n, wall, frame, radius, half, out):
    """Add the contacts on a cylinder's mantle: minima round it of the least distance along lines.

    A wall that does not bend along itself has none.
    """
    # Where a line touches at its ends only there is nothing between the rims.
    x, y, z = frame[0], frame[1], frame[2]
    out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = 0.0, 0.0, 0.0, 0.0
    if call_span(wall[1], wall[2], wall[3], x, y, z, 0.57735, 0.57735, 0.57735, out) == 0.0:
        return n
    step = 2.0 * math.pi / MANTLE_LINES
    first = _mantle_line(wall, frame, radius, half, 0.0, out)
    there, _, slope = first
    for i in range(MANTLE_LINES):
        b = (i + 1) * step
        # Where it closes rounding must not hide a minimum.
        at_b = _mantle_line(wall, frame, radius, half, b, out) if i + 1 < MANTLE_LINES else first
        there_b, _, slope_b = at_b
        # Of two neighbours one may have its minimum at a rim: the slope of the other decides.
        falls, rises = there > 0.0 and slope < 0.0, there_b > 0.0 and slope_b >= 0.0
        if (falls or there == 0.0) and (rises or there_b == 0.0) and (falls or rises):
            n = _mantle_minimum(con, n, wall, frame, radius, half, i * step, b, out)
        there, slope = there_b, slope_b
    return n


@compiled
def _mantle_minimum(con, n, wall, frame, radius, half, low, high, out):
    """Add the contact on the mantle between two angles, by bisection of the slope round it."""
    # Which side the lines without a minimum are on: beyond them the slope points back.
    there, t, _ = _mantle_line(wall, frame, radius, half, low, out)
    rising, angle, found, slope = there > 0.0, low, 0.0, 0.0
    while high - low > ANGLE:
        angle = 0.5 * (low + high)
        found, t, slope = _mantle_line(wall, frame, radius, half, angle, out)
        if found <= 0.0:
            low, high = (low, angle) if rising else (angle, high)
        elif slope < 0.0:
            low = angle
        else:
            high = angle
    # Beside the last line that has a minimum between the rims the distance goes on falling, towards
    # one of the rims: that is no contact of the mantle.
    if found <= 0.0 or abs(slope) > LEVEL:
        return n
    x, y, z = point_at(frame, radius * math.cos(angle), radius * math.sin(angle), t)
    return touch(con, n, wall, x, y, z, 0.0, out)


@compiled
def _ellipsoid_point(wall, frame, a, b, c, v, out):
    """Return the distance at an ellipsoid's point, and the direction that faces the wall there.

    ``v``: the point's direction in the ellipsoid's sphere.
    """
    x, y, z = point_at(frame, a * v[0], b * v[1], c * v[2])
    d = call_surface(wall[0], wall[2], x, y, z, out)
    gx, gy, gz = out[0], out[1], out[2]
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    hx = -a * (xx * gx + yx * gy + zx * gz)
    hy = -b * (xy * gx + yy * gy + zy * gz)
    hz = -c * (xz * gx + yz * gy + zz * gz)
    size = math.sqrt(hx * hx + hy * hy + hz * hz)
    return d, (hx / size, hy / size, hz / size)


@compiled
def _dot(v, w):
    """Scalar product of two vectors."""
    return v[0] * w[0] + v[1] * w[1] + v[2] * w[2]


@compiled
def _plus(v, factor, w):
    """Sum of a vector and a factor times another."""
    return v[0] + factor * w[0], v[1] + factor * w[1], v[2] + factor * w[2]


@compiled
def _mixed(before, r, v):
    """Return the direction in which the next fixed point is expected (Anderson's mixing).

    It is ``v`` + ``r``, corrected by the last two steps, at which ``r`` changed.

    Args:
        before: whether (over 0) there are one or two steps before, and of each the changes of
            ``r`` and of ``v`` + ``r``.
        r: from ``v`` to the direction that faces the wall.
        v: direction of the latest step.
    """
    count, p, p_step, q, q_step = before
    ahead = _plus(v, 1.0, r)
    pp, pq, qq, rp, rq = _dot(p, p), _dot(p, q), _dot(q, q), _dot(r, p), _dot(r, q)
    under = pp * qq - pq * pq
    # Two changes along one line say no more than one.
    if count > 1 and under > 1e-6 * pp * qq:
        ahead = _plus(ahead, (pq * rq - qq * rp) / under, p_step)
        return _plus(ahead, (pq * rp - pp * rq) / under, q_step)
    if count > 0 and pp > 0.0:
        return _plus(ahead, -rp / pp, p_step)
    return ahead


@compiled
def _descend(wall, frame, a, b, c, v, out):
    """Return the direction of a local minimum of the distance, from ``v`` on.

    The point whose outward normal faces the wall is nearest to a flat wall. On a curved one that is
    repeated, with the wall's curvature estimated from the steps before; where the distance does not
    fall, by a step a quarter as long and without them.
    """
    d, w = _ellipsoid_point(wall, frame, a, b, c, v, out)
    r, none, factor = _plus(w, -1.0, v), (0.0, 0.0, 0.0), 1.0
    before = 0, none, none, none, none
    for _ in range(DESCENT_STEPS):
        if _dot(r, r) < FACING * FACING:
            break
        u = _mixed(before, r, v) if before[0] > 0 else _plus(v, factor, r)
        size = math.sqrt(_dot(u, u))
        u = u[0] / size, u[1] / size, u[2] / size
        d_u, w_u = _ellipsoid_point(wall, frame, a, b, c, u, out)
        if not d_u <= d:
            factor, before = 0.25 * factor if before[0] == 0 else 1.0, (0, none, none, none, none)
            continue
        r_u = _plus(w_u, -1.0, u)
        count, p, p_step, _, _ = before
        before = count + 1, _plus(r_u, -1.0, r), _plus(w_u, -1.0, w), p, p_step
        v, w, d, r, factor = u, w_u, d_u, r_u, 1.0
    return v


@compiled
def _seed(i):
    """One of 14 unit vectors: along the axes, and between them."""
    if i >= 6:
        k, r = i - 6, 0.57735026919
        return r - 2.0 * r * (k & 1), r - 2.0 * r * ((k >> 1) & 1), r - 2.0 * r * (k >> 2)
    s = 1.0 - 2.0 * (i & 1)
    return s if i < 2 else 0.0, s if 2 <= i < 4 else 0.0, s if i >= 4 else 0.0


@compiled
def ellipsoid(con, n, wall, frame, a, b, c, out):
    """Add the contacts of an ellipsoid: local minima of the distance all over it.

    They are reached from those of 14 places that are nearer to the wall than their neighbours; at a
    smooth wall from samples all over it.
    """
    if wall[10] > 0.0:
        for side in range(6):
            n = round_face(con, n, wall, frame, ELLIPSOID_SIDE + side, a, b, c, out)
        return n
    distances = row()
    for i in range(SEEDS):
        distances[i] = _ellipsoid_point(wall, frame, a, b, c, _seed(i), out)[0]
    for i in range(SEEDS):
        v, lowest = _seed(i), True
        for j in range(SEEDS):
            u = _seed(j)
            near = u[0] * v[0] + u[1] * v[1] + u[2] * v[2] > 0.5
            lowest = lowest and not (near and distances[j] < distances[i])
        if lowest:
            v = _descend(wall, frame, a, b, c, v, out)
            x, y, z = point_at(frame, a * v[0], b * v[1], c * v[2])
            if holds(wall, x, y, z, out):
                n = touch(con, n, wall, x, y, z, 0.0, out)
    return no_deeper(con, n, wall, frame, (ELLIPSOID, a, b, c), 0.0, out)
