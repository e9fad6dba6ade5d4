"""What rays know of a network: records of its parts, and a line through one of them. Compiled."""

from __future__ import annotations

from omnitrack_sim.pipes.compiled import HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.walls.collider.through import at, call_clear, call_span, call_surface

KIND, CENTRE, REACH, POSITION, ROTATION, PORTS, PLANES, SIZES = 0, 1, 4, 5, 8, 17, 18, 46
"""Places in the record of a part: number of its kind, a ball around it (3 and its radius, m), its
pose (3 m, and 9 row by row), the number of its ports; for each port its place (3 m), its direction
outward (3), world frame, and what is there; sizes."""
OPEN, PLATE, UNKNOWN, UNSEEN = 0.0, 1.0, 2.0, 3.0
"""Nothing, a plate; what nothing is known of, behind a fitting's port, at which there is a joint,
and at the end of so much of a straight as has been seen, where there may be none."""
PORT_SIZE, PART_SIZE = 7, 56
RANGE, NORMAL, PART, LIT, JOINT, GRAIN, HIT_SIZE = 0, 1, 4, 5, 6, 7, 8
"""Places of what a ray has met: distance, m, infinite where it has met nothing, NaN where it leaves
through a port beyond which nothing is known; the wall's unit normal (3) into the bore, world frame;
number of the part, from the first of its map, -1 for nothing; how squarely the lamp shines on it:
cosine of the angle from its normal, 0 in the dark; distance from the nearest port plane, m; grain
of the surface, -1 to 1, where it has one. The last three are looked for only where there is a
lamp."""
SHORT = 1e-7
"""A step at least, m, which crosses port planes in spite of rounding."""
TOLERANCE = 1e-6
"""Room beyond a port plane, m, in which a part still counts: there are no gaps at joints."""
MOST_NEAR, NEAR, PORTS_ROOM = 32, 9, 8
"""Parts that one ray can meet, and numbers for each: the part, its span, the ray in its frame; and
room for one number a port."""


@compiled
def in_part(parts, p, x, y, z, row):
    """A coordinate of the world vector (x, y, z) in the frame of the part at ``p``: rotation
    transposed."""
    r = p + ROTATION
    return parts[r + row] * x + parts[r + 3 + row] * y + parts[r + 6 + row] * z


@compiled
def enter(parts, p, x, y, z, ux, uy, uz, line):
    """Write the ray x + s u, world frame, to ``line`` in the frame of the part at ``p``: 6
    numbers."""
    dx, dy, dz = x - parts[p + POSITION], y - parts[p + POSITION + 1], z - parts[p + POSITION + 2]
    for row in range(3):
        line[row] = in_part(parts, p, dx, dy, dz, row)
        line[3 + row] = in_part(parts, p, ux, uy, uz, row)


@compiled
def surface_at(parts, p, line, s, out):
    """Distance from the wall of the part at ``p`` at s on a line in its frame; gradient in
    ``out``."""
    return call_surface(
        int(parts[p + KIND]),
        at(parts, p + SIZES),
        line[0] + s * line[3],
        line[1] + s * line[4],
        line[2] + s * line[5],
        out,
    )


@compiled
def clear_from(parts, near, k, s):
    """How far the ray leads through the bore of the k-th part in ``near`` for certain, from s
    on."""
    p, line = int(near[NEAR * k]) * PART_SIZE, at(near, NEAR * k + 3)
    return call_clear(
        int(parts[p + KIND]),
        at(parts, p + SIZES),
        line[0] + s * line[3],
        line[1] + s * line[4],
        line[2] + s * line[5],
        line[3],
        line[4],
        line[5],
    )


@compiled
def span_in(parts, p, line, ends, out):
    """Have ``out`` hold the part of a line, from LOW to HIGH in it, that lies between the port
    planes of the part at ``p``."""
    call_span(
        int(parts[p + KIND]),
        at(parts, p + SIZES),
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
    """Write the parts that are nearer to a place than ``far`` to ``around``; returns their
    number."""
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
    """Write those of the parts in ``around`` that the ray may meet to ``near``, each with its span
    and the ray in its frame, NEAR numbers each; returns their number."""
    count = 0
    for i in range(number):
        p = int(around[i]) * PART_SIZE
        cx, cy, cz = parts[p + CENTRE] - x, parts[p + CENTRE + 1] - y, parts[p + CENTRE + 2] - z
        along = cx * ux + cy * uy + cz * uz
        reach = parts[p + REACH]
        beside = cx * cx + cy * cy + cz * cz - along * along
        if beside > reach * reach or along < -reach or along > far + reach or count >= MOST_NEAR:
            continue
        k = NEAR * count
        line = at(near, k + 3)
        enter(parts, p, x, y, z, ux, uy, uz, line)
        out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -TOLERANCE, far, 0.0, 0.0
        span_in(parts, p, line, ends, out)
        if out[HIGH] >= out[LOW]:
            near[k] = around[i]
            near[k + 1], near[k + 2] = out[LOW] - TOLERANCE, out[HIGH] + TOLERANCE
            count += 1
    return count


@compiled
def nearest_port(parts, p, x, y, z):
    """Place of the port of the part at ``p`` whose plane a world point is nearest to, and the
    distance from it, m."""
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
