"""Contacts of the flat faces of bodies with walls that bulge into the bore.

A wall that is concave in some direction everywhere is nearest to a body's edges; a bump is nearest
to the middle of a face. So the distance is sampled over each face that may be near such a wall, as
finely as the bumps are wide, and followed from each sample that is nearer than its neighbours.
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import compiled
from omnitrack_sim.pipes.native import call_surface, scratch
from omnitrack_sim.walls.contacts import touch
from omnitrack_sim.walls.curves import holds

RECTANGLE, DISC, TRIANGLE = 0.0, 1.0, 2.0
"""Shapes of faces."""
SAMPLES = 32
"""Of a face along either side, at most."""
STEPS, LEVEL, ON_FACE = 40, 1e-5, 5e-3
"""Of the search for a minimum: steps at most, the slope, m/m, at which it ends, and the one up to
which its end counts as a minimum."""


@compiled
def _is_within(face, a, b):
    """Tell whether a place, m along both sides from the middle, is on a face."""
    half_a, half_b, shape = face[9], face[10], face[11]
    if shape == RECTANGLE:
        return abs(a) <= half_a and abs(b) <= half_b
    if shape == DISC:
        return a * a + b * b <= half_a * half_a
    # Of a triangle both shares of the sides from its first corner are at least 0, and 1 at most
    # together; the sides lean to each other.
    s, t = a + half_a, b + half_b
    q = t / (2.0 * half_b)
    p = (s - q * face[12]) / (2.0 * half_a)
    return p >= 0.0 and q >= 0.0 and p + q <= 1.0


@compiled
def _side(corners, i, j):
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
        size = _side(corners, k, (k + 1) % 3)[3]
        if size > longest:
            i, longest = k, size
    ux, uy, uz, first = _side(corners, i, (i + 1) % 3)
    wx, wy, wz, _ = _side(corners, i, (i + 2) % 3)
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
    middle = (
        corners[3 * i] + p * ux + q * wx,
        corners[3 * i + 1] + p * uy + q * wy,
        corners[3 * i + 2] + p * uz + q * wz,
    )
    face = (*middle, ux, uy, uz, wx, wy, wz, p, q, TRIANGLE, lean)
    return face_contacts(con, n, wall, face, out)


@compiled
def _distance_at(wall, face, a, b, out):
    """Return the distance from the wall at a place of a face, and its slopes along both sides."""
    x = face[0] + a * face[3] + b * face[6]
    y = face[1] + a * face[4] + b * face[7]
    z = face[2] + a * face[5] + b * face[8]
    d = call_surface(wall[0], wall[2], x, y, z, out)
    return (
        d,
        out[0] * face[3] + out[1] * face[4] + out[2] * face[5],
        out[0] * face[6] + out[1] * face[7] + out[2] * face[8],
    )


@compiled
def _descend(wall, face, a, b, step, out):
    """Return the place of the minimum that is reached from a place, and whether it is one.

    By steps along the slope, as long as the last change of the slope over its way asks for
    (Barzilai and Borwein).
    """
    d, p, q = _distance_at(wall, face, a, b, out)
    size = math.sqrt(p * p + q * q)
    length = 0.25 * step / max(size, 1e-9)
    for _ in range(STEPS):
        if size < LEVEL:
            break
        length = min(length, step / size)
        u, v = a - length * p, b - length * q
        there, r, s = _distance_at(wall, face, u, v, out)
        if there > d + 1e-12:
            length *= 0.3
            continue
        along = (r - p) * (u - a) + (s - q) * (v - b)
        way = (u - a) * (u - a) + (v - b) * (v - b)
        a, b, d, p, q = u, v, there, r, s
        size = math.sqrt(p * p + q * q)
        length = way / along if along > 1e-15 else 2.0 * length
    return a, b, size < ON_FACE and _is_within(face, a, b)


@compiled
def face_contacts(con, n, wall, face, out):
    """Add the contacts within a face, see ``contacts.keep``.

    Args:
        con: room for contacts.
        n: how many there are.
        wall: see ``bodies.wall_of``.
        face: its middle (3), m, and unit vectors along its sides (6), fitting frame, half sizes, m,
            its shape, and of a triangle how far, m, its third corner is along the first side.
        out: room for what the surface writes.
    """
    half_a, half_b, margin, detail = face[9], face[10], wall[5], wall[9]
    d, _, _ = _distance_at(wall, face, 0.0, 0.0, out)
    if d - math.sqrt(half_a * half_a + half_b * half_b) >= margin:
        return n
    rows = min(max(math.ceil(2.0 * half_a / detail), 2), SAMPLES) + 1
    columns = min(max(math.ceil(2.0 * half_b / detail), 2), SAMPLES) + 1
    step_a, step_b = 2.0 * half_a / (rows - 1), 2.0 * half_b / (columns - 1)
    step, samples = max(step_a, step_b), scratch()
    for i in range(rows):
        for j in range(columns):
            a, b = i * step_a - half_a, j * step_b - half_b
            samples[i * columns + j] = _distance_at(wall, face, a, b, out)[0]
    for i in range(rows):
        for j in range(columns):
            here = samples[i * columns + j]
            if here - step >= margin:
                continue
            is_least = True
            for k in range(9):
                u, v = i + k // 3 - 1, j + k % 3 - 1
                if 0 <= u < rows and 0 <= v < columns and samples[u * columns + v] < here:
                    is_least = False
            if is_least:
                a, b = i * step_a - half_a, j * step_b - half_b
                a, b, is_found = _descend(wall, face, a, b, step, out)
                if is_found:
                    x = face[0] + a * face[3] + b * face[6]
                    y = face[1] + a * face[4] + b * face[7]
                    z = face[2] + a * face[5] + b * face[8]
                    if holds(wall, x, y, z, out):
                        n = touch(con, n, wall, x, y, z, 0.0, out)
    return n
