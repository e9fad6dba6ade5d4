"""Contacts of one pair as MuJoCo takes them, found in the fitting's frame."""

from __future__ import annotations

from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import call_surface
from omnitrack_sim.walls.record import BOX

CONTACT_SIZE = 10
"""Numbers of a contact (MuJoCo's mjPreContact): distance, position (3), normal (3), first tangent
(3)."""
MAX_KEPT, MAX_OF_PAIR = 16, 50
"""Contacts of one geom and one fitting that are handed on, and those that MuJoCo has room for."""


@compiled
def point_at(frame, x, y, z):
    """Point of a geom's frame in the fitting's frame."""
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    return (
        px + xx * x + xy * y + xz * z,
        py + yx * x + yy * y + yz * z,
        pz + zx * x + zy * y + zz * z,
    )


@compiled
def put_contact(con, n, d, reach, x, y, z, out):
    """Write contact ``n``: of a ball of radius ``reach`` at a point ``d`` m from the wall.

    The wall's gradient is in ``out``.
    """
    k = n * CONTACT_SIZE
    gx, gy, gz = out[0], out[1], out[2]
    # MuJoCo places a contact half way between the two surfaces.
    middle = 0.5 * (d + reach)
    con[k] = d - reach
    con[k + 1], con[k + 2], con[k + 3] = x - middle * gx, y - middle * gy, z - middle * gz
    con[k + 4], con[k + 5], con[k + 6] = gx, gy, gz
    con[k + 7] = con[k + 8] = con[k + 9] = 0.0


@compiled
def _apart(con, i, j):
    """Squared distance of two contacts' positions, m²."""
    a, b = i * CONTACT_SIZE, j * CONTACT_SIZE
    x, y, z = con[a + 1] - con[b + 1], con[a + 2] - con[b + 2], con[a + 3] - con[b + 3]
    return x * x + y * y + z * z


@compiled
def _move(con, source, target):
    """Copy a contact over another."""
    for i in range(CONTACT_SIZE):
        con[target * CONTACT_SIZE + i] = con[source * CONTACT_SIZE + i]


@compiled
def _drop_nearest(con, count):
    """Drop the shallower of the two contacts nearest to each other: the deepest always stays.

    So the others stay spread.
    """
    least, drop = 1e30, count - 1
    for i in range(count):
        for j in range(i):
            gap = _apart(con, i, j)
            if gap < least:
                least = gap
                drop = i if con[i * CONTACT_SIZE] >= con[j * CONTACT_SIZE] else j
    _move(con, count - 1, drop)


@compiled
def keep(con, n, wall, d, reach, x, y, z, out):
    """Add a ball's contact at ``d`` m from the wall if it is near; return the number of contacts.

    Args:
        con: room for ``MAX_KEPT`` + 1 contacts.
        n: how many there are.
        wall: see ``bodies.wall_of``.
        d: m, distance of the point from the wall.
        reach: m, radius of the ball.
        x: of the point, m, fitting frame.
        y: likewise.
        z: likewise.
        out: holds the gradient there.
    """
    depth, margin, same = wall[4], wall[5], wall[6]
    # A point deep within the wall belongs to another pipe.
    if d - reach >= margin or d <= -depth:
        return n
    put_contact(con, n, d, reach, x, y, z, out)
    # Two contacts in one place would share a force that the solver cannot divide.
    for i in range(n):
        if _apart(con, i, n) < same * same:
            if con[n * CONTACT_SIZE] < con[i * CONTACT_SIZE]:
                _move(con, n, i)
            return n
    if n == MAX_KEPT:
        _drop_nearest(con, n + 1)
        return n
    return n + 1


@compiled
def add_apart(kept, count, con, n, same):
    """Add n contacts to others of the same geom, and return how many there are then.

    Of two less than ``same`` m apart the deeper one stays, as in ``keep``.
    """
    before = count
    for i in range(n):
        k, place = i * CONTACT_SIZE, count
        for j in range(before):
            o, square = j * CONTACT_SIZE, 0.0
            for axis in range(1, 4):
                square += (con[k + axis] - kept[o + axis]) ** 2
            if square < same * same:
                place = j
        if place == count or con[k] < kept[place * CONTACT_SIZE]:
            for axis in range(CONTACT_SIZE):
                kept[place * CONTACT_SIZE + axis] = con[k + axis]
            count += 1 * (place == count)
    return count


@compiled
def touch(con, n, wall, x, y, z, reach, out):
    """Add the contact of a ball at a point, see ``keep``."""
    d = call_surface(wall[0], wall[2], x, y, z, out)
    return keep(con, n, wall, d, reach, x, y, z, out)


@compiled
def in_world(con, k, records, w, position, matrix, g_wall):
    """Bring the contact at ``con[k]`` from the frame of the fitting's geom into the world's."""
    o, m = 3 * g_wall, 9 * g_wall
    to_world(con, k + 1, matrix, m)
    con[k + 1] += position[o] - turned(matrix, m, records, w + BOX, 0)
    con[k + 2] += position[o + 1] - turned(matrix, m, records, w + BOX, 1)
    con[k + 3] += position[o + 2] - turned(matrix, m, records, w + BOX, 2)
    to_world(con, k + 4, matrix, m)


@compiled
def turned(matrix, m, vector, v, row):
    """One row of a geom's rotation times a vector."""
    r = m + 3 * row
    return matrix[r] * vector[v] + matrix[r + 1] * vector[v + 1] + matrix[r + 2] * vector[v + 2]


@compiled
def to_world(con, k, matrix, m):
    """Rotate three numbers in place from the fitting's frame to the world's."""
    x, y, z = (
        turned(matrix, m, con, k, 0),
        turned(matrix, m, con, k, 1),
        turned(matrix, m, con, k, 2),
    )
    con[k], con[k + 1], con[k + 2] = x, y, z
