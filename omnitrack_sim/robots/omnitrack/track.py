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
from functools import cache

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.compiled import EDGE, HIGH, HIGH_ENDS, LOW, LOW_ENDS, SOLID, compiled
from omnitrack_sim.pipes.fittings.base import MAX_SIZES
from omnitrack_sim.pipes.native import at, call_span, call_surface, row
from omnitrack_sim.walls.bodies import frame_in
from omnitrack_sim.walls.collider import (
    LINE_PREVIOUS,
    MATRICES,
    POSITIONS,
    SIZE,
    USER,
    USER_SIZE,
    call_collide,
    doubles,
    enter,
    functions_of,
    sizes_of,
    word,
)
from omnitrack_sim.walls.contacts import CONTACT_SIZE, in_world, put_contact
from omnitrack_sim.walls.curves import PLATEAU, minimum, rim_begins, slope_at
from omnitrack_sim.walls.record import ENDS, KIND, MARK, RECORD_SIZE

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
BACKSTOP = 0.5
"""Depth, in radii of a line, down to which a wall is solid for its axis. A line in a neighbouring
pipe is a radius deep at least."""
MAX_CONTACTS = 24
"""On one line and one fitting; MuJoCo has room for 50."""
SPACING = 0.008
"""Largest spacing of the samples between which a minimum is looked for, m, for a robot of scale 1:
a third of a lug's radius."""
MIN_END_DISTANCE = 0.003
"""A minimum nearer than this to an end of the line is that end, m."""


def line_record(lug_pitch: float, scale: float, side: float = 0.0) -> Array:
    """Return the record (RECORD_SIZE,) of a track.

    It holds a mark, the distance of its lugs, m, the robot's scale, and its side, see ``SIDE``.
    """
    record = np.zeros(RECORD_SIZE)
    record[0], record[PITCH], record[SCALE], record[SIDE] = MARK, lug_pitch, scale, side
    return record


def sprocket_record(other: int) -> Array:
    """Return the record (RECORD_SIZE,) of a sprocket's sphere, see ``OTHER``."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[OTHER] = MARK, other
    return record


@compiled
def _add(con, n, surface, sizes, ray, face, s, radius, margin, out):
    """Add the contact at s if the wall is that near and faces the run.

    Returns the number of contacts, which are still in the fitting's frame.
    """
    px, py, pz, ax, ay, az, _, _, _, _ = ray
    x, y, z = px + s * ax, py + s * ay, pz + s * az
    d = call_surface(surface, sizes, x, y, z, out)
    # A line whose axis lies deep within the wall belongs to another pipe.
    # Beyond MAX_CONTACTS the rest is dropped: the ends and the first minima come first.
    if d <= -BACKSTOP * radius or d - radius >= margin or n >= MAX_CONTACTS:
        return n
    # The wall behind a run belongs to the other run of its chain.
    if out[0] * face[0] + out[1] * face[1] + out[2] * face[2] > BAND:
        return n
    put_contact(con, n, d, radius, x, y, z, out)
    return n + 1


@compiled
def _add_end(con, n, surface, sizes, ray, face, s, radius, margin, out):
    """Add the contact of an end, see ``_add``; of a run only where it is not its sprocket's."""
    count = _add(con, n, surface, sizes, ray, face, s, radius, margin, out)
    if face[3] > 0.0 and abs(out[0] * ray[3] + out[1] * ray[4] + out[2] * ray[5]) > LEAN:
        return n
    return count


@compiled
def _add_within(con, n, surface, sizes, ray, face, bounds, radius, pitch, margin, scale, out):
    """Add the contacts between the ends of a track.

    These are minima with their flanks, and where a rim begins at a straight wall. ``bounds``: the
    span, and whether contact ends at its ends.
    """
    low, high, low_ends, high_ends = bounds
    # Even pieces from end to end: the samples are the same seen from either end.
    pieces = math.ceil((high - low) / (SPACING * scale))
    reach = radius + margin
    # Next to an end that already has a contact, another one would only split its force.
    first = low + (MIN_END_DISTANCE * scale if low_ends else 0.0)
    last = high - (MIN_END_DISTANCE * scale if high_ends else 0.0)
    a = low
    d_a, slope_a, face_a = slope_at(surface, sizes, ray, a, out)
    for i in range(pieces):
        b = low + (high - low) * (i + 1) / pieces
        d_b, slope_b, face_b = slope_at(surface, sizes, ray, b, out)
        # The distance changes by no more than one metre a metre.
        if 0.5 * (d_a + d_b - (b - a)) < reach:
            s = low - 1.0
            if slope_a < 0.0 <= slope_b:
                s = minimum(surface, sizes, ray, a, slope_a, b, slope_b, out)
            elif face_a != face_b:
                onto_rim = slope_b if face_b == EDGE else -slope_a
                if onto_rim > -PLATEAU:
                    s = rim_begins(surface, sizes, ray, a, face_a, b, out)
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
def _outward(position, matrix, g_line, other, g_wall):
    """Direction from the sprocket at the other end of a module to this one.

    Three numbers, in the frame of a fitting.
    """
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
def line_contacts(
    con,
    surface,
    span,
    sizes,
    wall,
    w,
    track,
    position,
    matrix,
    g_line,
    g_wall,
    radius,
    half,
    margin,
):
    """Contacts of a capsule's axis with one fitting, written to ``con``; returns their number.

    A sprocket is a capsule without length.

    Args:
        con: room for MAX_CONTACTS contacts of CONTACT_SIZE numbers; normals point from the wall to
            the line.
        surface: address of the fitting's function of that name.
        span: the same.
        sizes: of the fitting.
        wall: user data of all geoms.
        w: where in ``wall`` the record of this fitting begins.
        track: where in ``wall`` the record of the line begins.
        position: (3 per geom) m, of all geoms in the world.
        matrix: (9 per geom, row major), of all geoms in the world.
        g_line: geom number of the line.
        g_wall: geom number of the wall.
        radius: of the capsule, m.
        half: half the length of the capsule's axis, m.
        margin: distance up to which contacts count, m.
    """
    out = row()
    # All is found in the fitting's frame, where the formulas are simple, and rotated once at the
    # end.
    frame = frame_in(wall, w, position, matrix, g_line, g_wall)
    px, py, pz, xx, _, ax, yx, _, ay, zx, _, az = frame
    ray, side = (px, py, pz, ax, ay, az, 0.0, 0.0, 0.0, 0.0), wall[track + SIDE]
    # The direction that a run faces in, and whether it faces in one (over 0).
    face = side * xx, side * yx, side * zx, abs(side)
    pitch, scale = wall[track + PITCH], wall[track + SCALE]
    out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -half, half, 1.0, 1.0
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
    """Bring the contact at ``con[k]`` from the fitting's frame into the world's.

    Its first tangent lies along the line.
    """
    in_world(con, k, wall, w, position, matrix, g_wall)
    ux, uy, uz = matrix[9 * g_line + 2], matrix[9 * g_line + 5], matrix[9 * g_line + 8]
    along = ux * con[k + 4] + uy * con[k + 5] + uz * con[k + 6]
    tx, ty, tz = ux - along * con[k + 4], uy - along * con[k + 5], uz - along * con[k + 6]
    size = math.sqrt(tx * tx + ty * ty + tz * tz)
    # For a zero tangent MuJoCo chooses one, as where the line is normal to the wall.
    scale = 1.0 / size if size > 1e-6 else 0.0
    con[k + 7], con[k + 8], con[k + 9] = scale * tx, scale * ty, scale * tz


def collide_line(model, data, contacts, wall, line, margin):
    """MuJoCo's collision function of height field and capsule, where the capsule has a record."""
    count = model[word(USER_SIZE)]
    # A foreign model may have user data of another length, which must not be read as a record.
    if count < RECORD_SIZE:
        return call_collide(word(LINE_PREVIOUS), model, data, contacts, wall, line, margin)
    records = doubles(model[word(USER)])
    # The records end the rows, so that a robot may have user data of its own before.
    track, w = count * (line + 1) - RECORD_SIZE, count * (wall + 1) - RECORD_SIZE
    if records[w] != MARK or records[track] != MARK:
        return call_collide(word(LINE_PREVIOUS), model, data, contacts, wall, line, margin)
    surface, span, solids = functions_of(records[w + KIND])
    # Edges and closed ends, which pipes around any robot have, are no wall that carries a row.
    if surface == 0:
        return 0
    # MuJoCo has three sizes a geom; of a capsule they are its radius and half length.
    bodies = doubles(model[word(SIZE)])
    radius, half = bodies[3 * line], bodies[3 * line + 1]
    position, matrix = doubles(data[word(POSITIONS)]), doubles(data[word(MATRICES)])
    sizes, n = sizes_of(records, w), 0
    if solids > 1:
        alone = row()
        for i in range(MAX_SIZES):
            alone[i] = sizes[i]
        sizes = alone
    for k in range(solids):
        if solids > 1:
            sizes[SOLID] = k + 1.0
        n += line_contacts(
            at(contacts, n * CONTACT_SIZE),
            surface,
            span,
            sizes,
            records,
            w,
            track,
            position,
            matrix,
            line,
            wall,
            radius,
            half,
            margin,
        )
    return n


@cache
def install_lines() -> None:
    """Have MuJoCo find the contacts of tracks with exact walls, in this process."""
    enter(collide_line, mujoco.mjtGeom.mjGEOM_CAPSULE, LINE_PREVIOUS)
