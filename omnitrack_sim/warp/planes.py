"""Contacts of MuJoCo's shapes with the plane of a plate that closes a pipe, as MuJoCo finds them.

On the processor MuJoCo's own functions do that. Here they are written in the language of
``pipes.compiled``, in the world's frame.
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.walls.collider import (
    BOUND,
    MATRICES,
    POSITIONS,
    SIZE,
    TYPE,
    doubles,
    hull_of,
    integers,
    word,
)
from omnitrack_sim.walls.contacts import CONTACT_SIZE, point_at
from omnitrack_sim.walls.rims import BOX, CAPSULE, CYLINDER, ELLIPSOID, MESH, SPHERE

MAX_CORNERS = 4
"""Corners of a box that touch at most."""
MAX_VERTICES, APART = 3, 0.3
"""Vertices of a mesh that touch at most, and their least distance from the first one, in radii of a
ball round the mesh."""


@compiled
def _put(con, n, plane, x, y, z, reach, margin):
    """Add the contact of a ball of radius ``reach`` at a point, if it is near the plane."""
    px, py, pz, nx, ny, nz = plane
    d = (x - px) * nx + (y - py) * ny + (z - pz) * nz - reach
    if d > margin:
        return n
    k, away = CONTACT_SIZE * n, reach + 0.5 * d
    con[k] = d
    con[k + 1], con[k + 2], con[k + 3] = x - away * nx, y - away * ny, z - away * nz
    con[k + 4], con[k + 5], con[k + 6] = nx, ny, nz
    con[k + 7] = con[k + 8] = con[k + 9] = 0.0
    return n + 1


@compiled
def _capsule(con, plane, frame, radius, half, margin):
    """Contacts of both ends of a capsule, whose first tangents lie along it."""
    n = 0
    for end in (half, -half):
        x, y, z = point_at(frame, 0.0, 0.0, end)
        before = n
        n = _put(con, n, plane, x, y, z, radius, margin)
        if n > before:
            k = CONTACT_SIZE * before
            con[k + 7], con[k + 8], con[k + 9] = frame[5], frame[8], frame[11]
    return n


@compiled
def _downward(plane, frame):
    """Return the plane's normal, turned into the wall, in a geom's frame."""
    _, _, _, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    _, _, _, nx, ny, nz = plane
    return (
        -xx * nx - yx * ny - zx * nz,
        -xy * nx - yy * ny - zy * nz,
        -xz * nx - yz * ny - zz * nz,
    )


@compiled
def _cylinder(con, plane, frame, radius, half, margin):
    """Contacts of a cylinder: its lowest point, that of the other disc, two more of the first."""
    u, v, w = _downward(plane, frame)
    size = math.sqrt(u * u + v * v)
    # A cylinder that stands upright touches by its x axis first.
    u, v = (u / size, v / size) if size > 1e-7 else (1.0, 0.0)
    end = half if w >= 0.0 else -half
    x, y, z = point_at(frame, radius * u, radius * v, end)
    n = _put(con, 0, plane, x, y, z, 0.0, margin)
    if n == 0:
        return 0
    x, y, z = point_at(frame, radius * u, radius * v, -end)
    n = _put(con, n, plane, x, y, z, 0.0, margin)
    across = 0.5 * math.sqrt(3.0)
    for side in (across, -across):
        a, b = -0.5 * u - side * v, -0.5 * v + side * u
        x, y, z = point_at(frame, radius * a, radius * b, end)
        n = _put(con, n, plane, x, y, z, 0.0, margin)
    return n


@compiled
def _box(con, plane, frame, a, b, c, margin):
    """Contacts of the corners of a box that lie below its middle."""
    u, v, w = _downward(plane, frame)
    n = 0
    for i in range(8):
        x, y, z = a * (2.0 * (i & 1) - 1.0), b * ((i & 2) - 1.0), c * (0.5 * (i & 4) - 1.0)
        if n < MAX_CORNERS and u * x + v * y + w * z >= 0.0:
            x, y, z = point_at(frame, x, y, z)
            n = _put(con, n, plane, x, y, z, 0.0, margin)
    return n


@compiled
def _ellipsoid(con, plane, frame, a, b, c, margin):
    """Contact of the lowest point of an ellipsoid."""
    u, v, w = _downward(plane, frame)
    u, v, w = a * u, b * v, c * w
    size = math.sqrt(u * u + v * v + w * w)
    x, y, z = point_at(frame, a * u / size, b * v / size, c * w / size)
    return _put(con, 0, plane, x, y, z, 0.0, margin)


@compiled
def _mesh(con, plane, frame, hull, bound, margin):
    """Contacts of the deepest vertex of a mesh, and of two that are the next deepest elsewhere."""
    vertices, count, polygons_at, _, _, _, _ = hull
    u, v, w = _downward(plane, frame)
    n, reach = 0, APART * bound
    for _ in range(MAX_VERTICES):
        best, most, before = -1, -math.inf, n
        for i in range(count):
            px, py, pz = (
                float(vertices[3 * i]),
                float(vertices[3 * i + 1]),
                float(vertices[3 * i + 2]),
            )
            x, y, z = point_at(frame, px, py, pz)
            # Contacts lie half way to the plane: by less than the distances that count here.
            is_apart = True
            for j in range(n):
                k = CONTACT_SIZE * j
                dx, dy, dz = x - con[k + 1], y - con[k + 2], z - con[k + 3]
                is_apart = is_apart and dx * dx + dy * dy + dz * dz >= reach * reach
            deep = u * px + v * py + w * pz
            if polygons_at[i] > 0 and is_apart and deep > most:
                best, most = i, deep
        if best < 0:
            return n
        px, py, pz = (
            float(vertices[3 * best]),
            float(vertices[3 * best + 1]),
            float(vertices[3 * best + 2]),
        )
        x, y, z = point_at(frame, px, py, pz)
        n = _put(con, n, plane, x, y, z, 0.0, margin)
        if n == before:
            return n
    return n


@compiled
def with_plane(model, data, con, plate, geom, margin):
    """Find the contacts of a geom with the plane of another one; returns their number."""
    position, matrix = doubles(data[word(POSITIONS)]), doubles(data[word(MATRICES)])
    p, r, q, m = 3 * plate, 9 * plate, 3 * geom, 9 * geom
    plane = (
        position[p],
        position[p + 1],
        position[p + 2],
        matrix[r + 2],
        matrix[r + 5],
        matrix[r + 8],
    )
    frame = (
        position[q],
        position[q + 1],
        position[q + 2],
        matrix[m],
        matrix[m + 1],
        matrix[m + 2],
        matrix[m + 3],
        matrix[m + 4],
        matrix[m + 5],
        matrix[m + 6],
        matrix[m + 7],
        matrix[m + 8],
    )
    sizes, kind = doubles(model[word(SIZE)] + 24 * geom), integers(model[word(TYPE)])[geom]
    if kind == SPHERE:
        return _put(con, 0, plane, frame[0], frame[1], frame[2], sizes[0], margin)
    if kind == CAPSULE:
        return _capsule(con, plane, frame, sizes[0], sizes[1], margin)
    if kind == CYLINDER:
        return _cylinder(con, plane, frame, sizes[0], sizes[1], margin)
    if kind == BOX:
        return _box(con, plane, frame, sizes[0], sizes[1], sizes[2], margin)
    if kind == ELLIPSOID:
        return _ellipsoid(con, plane, frame, sizes[0], sizes[1], sizes[2], margin)
    if kind == MESH:
        bound = doubles(model[word(BOUND)])[geom]
        return _mesh(con, plane, frame, hull_of(model, geom)[0], bound, margin)
    return 0
