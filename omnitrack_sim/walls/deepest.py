"""Bounds on the depth of a body's points in a wall, and the search for one below its contacts.

The searches of ``bodies`` follow slopes, so they may end in a minimum that is not the least where a
wall has an edge or a saddle: the rim of a branch, the corner of a mitre. Here the body's surface is
cut into cells until none can hold a deeper point (branch and bound). The distance d from a wall
changes by no more than a metre a metre, so it is at least d(p) - |x - p| at x, for any p. From a p
far out in the bore that bound is nearly exact over the whole neighbourhood of a contact: the wall
lies outside of a ball about p. One such ball, which touches the wall at the deepest contact, is
most often enough for the whole body.

A cell is five numbers: side, middle (2), half size (2). On a cylinder's mantle, which ends at its
rims, the coordinates are the angle, rad, and the height, m; on an ellipsoid those of one of the six
sides of a cube about it, from -1 to 1; on a line the first one is the place, from -1 to 1. A ball
is four: its middle in the geom's frame, on a mantle by radius, angle and height, and the distance
of that from the wall.
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.pipes.native import call_span, call_surface, scratch
from omnitrack_sim.walls.contacts import CONTACT_SIZE, point_at, touch
from omnitrack_sim.walls.curves import holds
from omnitrack_sim.walls.rims import CYLINDER, ELLIPSOID

WIDE, BALL_TRIES = 0.95, 5
"""Radius of a ball, in that of the bore, and how often a smaller one is tried."""
LINE = -1
"""Kind of body beside MuJoCo's types of geoms: a line along z."""
PROVED = 1.5e-5
"""Depth, m, by which no point is deeper than the deepest contact, but for what the smallest cells
may hide: see ``LEAF_IN_BORE``."""
LEAF_IN_BORE, LEAF_IN_BODY = 2e-3, 1e-2
"""Radius of the smallest cells, in radii of the bore and in the body's largest size: 0.16 mm. A
minimum in one is no deeper than its middle but for its square times half of the curvature, of at
most 1 / 2.5 mm at the rim of a mitre: 5 um. Where a joint is both open and bent it may be more:
``benchmarks/contact_lots.py`` measures it."""
MAX_CELLS = 1000
"""Of a body, at most: beyond it the deepest contact is taken as it is."""
MAX_STRAYS = 2
"""Minima of a body that lie beyond the fitting's port planes, at most: they are those of its
neighbour, or of the edge of an open end."""
BEYOND = 10.0
"""Radius of the smallest cells with a middle beyond a port plane, in those of the others."""
CELL, BALL = 5, 4
"""Numbers of a cell and of a ball."""
BALLS, CELLS = 4, 256
"""Balls that are remembered, and cells that wait at most."""
QUEUE = BALL * BALLS
"""Where the cells begin, in a room of numbers that begins with the balls."""
AS_FAR, AT_RIM = 1e-9, 1e-9
"""Distances, m, that differ by less are the same; part of a cylinder's half length by which a cell
may miss its end."""
SETTLED, MOVES = 1e-7, 400
"""Of the search for a minimum: its last step, m, and its steps at most."""


@compiled
def _direction(side, u, v):
    """Return the unit vector to a place on a side of a cube."""
    n = 1.0 / math.sqrt(1.0 + u * u + v * v)
    sign = n if side % 2.0 == 0.0 else -n
    if side < 2.0:
        return sign, u * n, v * n
    return (v * n, sign, u * n) if side < 4.0 else (u * n, v * n, sign)


@compiled
def _chord(u, v, du, dv):
    """Return the farthest distance, on a ball of radius 1, of a cell's directions from its middle.

    That is at one of its corners: its sides are parts of great circles.
    """
    least = 1.0
    for i in range(4):
        p, q = u + du * (2.0 * (i & 1) - 1.0), v + dv * ((i & 2) - 1.0)
        cosine = (1.0 + p * u + q * v) / math.sqrt((1.0 + p * p + q * q) * (1.0 + u * u + v * v))
        least = min(least, cosine)
    return math.sqrt(max(2.0 - 2.0 * least, 0.0))


@compiled
def _point(body, side, u, v):
    """Return a point of a body in its frame."""
    kind, a, b, c = body
    if kind == CYLINDER:
        return a * math.cos(u), a * math.sin(u), v
    if kind == LINE:
        return 0.0, 0.0, b * u
    x, y, z = _direction(side, u, v)
    return a * x, b * y, c * z


@compiled
def _radius(body, u, v, du, dv):
    """Return the radius, m, of a ball about a cell's middle that holds the cell."""
    kind, a, b, c = body
    if kind == CYLINDER:
        across = 2.0 * a * math.sin(0.5 * min(du, math.pi))
        return math.sqrt(across * across + dv * dv)
    return b * du if kind == LINE else max(a, b, c) * _chord(u, v, du, dv)


@compiled
def _across_ellipsoid(body, ball, direction, chord):
    """Return the largest squared distance, m², of an ellipsoid's points from the middle of a ball.

    Those up to ``chord`` from a direction, on a ball of radius 1.
    """
    _, a, b, c = body
    px, py, pz, _ = ball
    sx, sy, sz = direction
    wx, wy, wz = a * sx - px, b * sy - py, c * sz - pz
    # The square grows with the chord e by 2 g e + k e² at most: e leans inward by e² / 2.
    qx, qy, qz = a * wx, b * wy, c * wz
    outward = qx * sx + qy * sy + qz * sz
    g = math.sqrt(max(qx * qx + qy * qy + qz * qz - outward * outward, 0.0))
    k = max(a, b, c) ** 2 - outward
    e = chord if g + k * chord >= 0.0 else -g / k
    return wx * wx + wy * wy + wz * wz + e * (2.0 * g + k * e)


@compiled
def _across(body, ball, side, u, v, du, dv):
    """Return the largest squared distance, m², of a cell's points from the middle of a ball."""
    kind, a, b, _ = body
    p, q, r, _ = ball
    if kind == CYLINDER:
        turn = abs(u - q)
        # From the direction that leads away from the ball's middle.
        back = max(abs(turn - math.pi) - du, 0.0)
        height = abs(v - r) + dv
        return a * a + p * p + 2.0 * a * p * math.cos(back) + height * height
    if kind == LINE:
        along = abs(b * u - r) + b * du
        return p * p + along * along
    return _across_ellipsoid(body, ball, _direction(side, u, v), _chord(u, v, du, dv))


@compiled
def _in_frame(frame, x, y, z):
    """Return a point of the fitting's frame in that of a geom."""
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    x, y, z = x - px, y - py, z - pz
    return xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z


@compiled
def _ball(wall, x, y, z, d, out):
    """Return a large ball of the bore that touches the wall at the foot of a point: middle, radius.

    The point is ``d`` m from the wall, with the gradient in ``out``.
    """
    gx, gy, gz = out[0], out[1], out[2]
    px = py = pz = away = 0.0
    r = WIDE * max(wall[8] - d, 0.0)
    for _ in range(BALL_TRIES):
        px, py, pz = x + r * gx, y + r * gy, z + r * gz
        away = call_surface(wall[0], wall[2], px, py, pz, out)
        if away > d + r - AS_FAR:
            break
        # Another wall is nearer: of a narrower bore its middle is half of the way back.
        r = max(min(WIDE * 0.5 * (away - d + r), 0.6 * r), 0.2 * r)
    return px, py, pz, away


@compiled
def _beside(body, frame, ball):
    """Return a ball as ``_across`` takes it, in a body's frame."""
    px, py, pz, away = ball
    ux, uy, uz = _in_frame(frame, px, py, pz)
    if body[0] == CYLINDER:
        return math.sqrt(ux * ux + uy * uy), math.atan2(uy, ux), uz, away
    if body[0] == LINE:
        # The frame of an edge has but one axis.
        x, y, z = px - frame[0], py - frame[1], pz - frame[2]
        return math.sqrt(max(x * x + y * y + z * z - uz * uz, 0.0)), 0.0, uz, away
    return ux, uy, uz, away


@compiled
def _deepest(con, n, margin):
    """Return the number of the deepest contact, -1 for none, and its distance or the margin, m."""
    number, least = -1, margin
    for i in range(n):
        if con[i * CONTACT_SIZE] < least:
            number, least = i, con[i * CONTACT_SIZE]
    return number, least


@compiled
def _first_ball(con, n, wall, frame, reach, out):
    """Return a ball at the deepest contact, or without one at the wall nearest to the geom.

    Beside it are the point, in the fitting's frame, that it is found from, and the distance from
    the wall, m, that a point must have to be ``PROVED`` deeper.
    """
    number, least = _deepest(con, n, wall[5])
    x, y, z, d = frame[0], frame[1], frame[2], least + reach
    if number >= 0:
        k, beyond = number * CONTACT_SIZE, 0.5 * least + reach
        gx, gy, gz = con[k + 4], con[k + 5], con[k + 6]
        x, y, z = con[k + 1] + beyond * gx, con[k + 2] + beyond * gy, con[k + 3] + beyond * gz
        out[0], out[1], out[2] = gx, gy, gz
    else:
        d = call_surface(wall[0], wall[2], x, y, z, out)
    return _ball(wall, x, y, z, d, out), (x, y, z), least + reach - PROVED


@compiled
def _is_within(away, square, target):
    """Tell whether what is that far, by its square, from a ball's middle is ``target`` m off."""
    room = away - target
    return room > 0.0 and square <= room * room


@compiled
def _is_near(wall, x, y, z, far, out):
    """Return whether the fitting holds any point up to ``far`` m from a point."""
    # A plane that is so near meets one of the axes within root 3 times that.
    reach = 1.7320508 * far
    for axis in range(3):
        out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -reach, reach, 0.0, 0.0
        ax, ay, az = 1.0 * (axis == 0), 1.0 * (axis == 1), 1.0 * (axis == 2)
        call_span(wall[1], wall[2], wall[3], x, y, z, ax, ay, az, out)
        if out[HIGH] >= out[LOW]:
            return True
    return False


@compiled
def _settle(wall, frame, body, side, u, v, du, dv, d, out):
    """Return the coordinates of the minimum of the distance that is reached from a place.

    By steps to the lowest of eight places around, half as long where none is lower.
    """
    kind, _, b, _ = body
    scale = 1.0 if kind == CYLINDER else max(b, body[1])
    for _ in range(MOVES):
        best, best_u, best_v = d, u, v
        for i in range(9):
            p, q = u + (i % 3 - 1) * du, v + (i // 3 - 1) * dv
            if kind == CYLINDER:
                q = min(max(q, -b), b)
            elif kind == LINE:
                p = min(max(p, -1.0), 1.0)
            x, y, z = _point(body, side, p, q)
            x, y, z = point_at(frame, x, y, z)
            d_there = call_surface(wall[0], wall[2], x, y, z, out)
            if d_there < best:
                best, best_u, best_v = d_there, p, q
        if best < d:
            d, u, v = best, best_u, best_v
        elif max(du, dv) * scale < SETTLED:
            break
        else:
            du, dv = 0.5 * du, 0.5 * dv
    return u, v


@compiled
def _add_minimum(con, n, wall, frame, body, side, u, v, du, dv, d, reach, out):
    """Add the contact at the minimum reached from a place; tell whether this fitting holds it."""
    u, v = _settle(wall, frame, body, side, u, v, du, dv, d, out)
    x, y, z = _point(body, side, u, v)
    x, y, z = point_at(frame, x, y, z)
    if not holds(wall, x, y, z, out):
        return n, False
    return touch(con, n, wall, x, y, z, reach, out), True


@compiled
def _put_cell(room, k, side, u, v, du, dv):
    """Write cell number k to the queue."""
    i = QUEUE + CELL * (k % CELLS)
    room[i], room[i + 1], room[i + 2], room[i + 3], room[i + 4] = side, u, v, du, dv


@compiled
def _halve(room, k, body, side, u, v, du, dv):
    """Queue both halves of a cell, cut across its longer side, as numbers k and k + 1."""
    kind, a, b, c = body
    first, second = du, dv
    if kind == CYLINDER:
        first = a * du
    elif kind == ELLIPSOID:
        axis = side // 2.0
        first = du * (b if axis == 0.0 else (c if axis == 1.0 else a))
        second = dv * (c if axis == 0.0 else (a if axis == 1.0 else b))
    half_u, half_v = (0.5 * du, 0.0) if first >= second else (0.0, 0.5 * dv)
    _put_cell(room, k, side, u - half_u, v - half_v, du - half_u, dv - half_v)
    _put_cell(room, k + 1, side, u + half_u, v + half_v, du - half_u, dv - half_v)


@compiled
def no_deeper(con, n, wall, frame, body, reach, out):
    """Add contacts until no point of a body is deeper, by ``PROVED``, than the deepest.

    Args:
        con: room for contacts, see ``contacts.keep``.
        n: how many there are.
        wall: see ``bodies.wall_of``.
        frame: of the geom in the fitting's frame.
        body: kind (``CYLINDER``, ``ELLIPSOID`` or ``LINE``) and sizes of the geom, m.
        reach: m, radius of the ball that is moved along a line; else 0.
        out: room for what the surface writes.
    """
    kind, a, b, c = body
    # The fitting that holds the middle proves it. On a smooth wall the samples of a line are as
    # close as its waves are wide.
    if (kind == LINE and wall[10] > 0.0) or not holds(wall, frame[0], frame[1], frame[2], out):
        return n
    ball, point, target = _first_ball(con, n, wall, frame, reach, out)
    ball, room, end = _beside(body, frame, ball), scratch(), 1
    leaf = min(LEAF_IN_BORE * wall[8], LEAF_IN_BODY * max(a, b, c))
    if kind == ELLIPSOID:
        x, y, z = _in_frame(frame, point[0], point[1], point[2])
        x, y, z = x / a, y / b, z / c
        size = math.sqrt(x * x + y * y + z * z)
        if size < 0.5:
            x, y, z = -a * ball[0], -b * ball[1], -c * ball[2]
            size = math.sqrt(x * x + y * y + z * z)
        direction = x / size, y / size, z / size
        if _is_within(ball[3], _across_ellipsoid(body, ball, direction, 2.0), target):
            return n
        end = 6
        for side in range(6):
            _put_cell(room, side, float(side), 0.0, 0.0, 1.0, 1.0)
    elif kind == CYLINDER:
        _put_cell(room, 0, 0.0, 0.0, 0.0, math.pi, b)
    else:
        _put_cell(room, 0, 0.0, 0.0, 0.0, 1.0, 0.0)
    room[0], room[1], room[2], room[3] = ball
    balls, first, strays = 1, 0, 0
    # Large cells come first: what is far deeper is found soon.
    while first < min(end, MAX_CELLS):
        i = QUEUE + CELL * (first % CELLS)
        first += 1
        side, u, v, du, dv = room[i], room[i + 1], room[i + 2], room[i + 3], room[i + 4]
        is_clear = False
        for j in range(min(balls, BALLS)):
            k = BALL * j
            ball = room[k], room[k + 1], room[k + 2], room[k + 3]
            if _is_within(ball[3], _across(body, ball, side, u, v, du, dv), target):
                is_clear = True
                break
        if is_clear:
            continue
        h = _radius(body, u, v, du, dv)
        if kind == CYLINDER and h < leaf and abs(v) + dv >= b * (1.0 - AT_RIM):
            # At a rim it need not be level across it: there the rim itself is looked at.
            v, dv = math.copysign(b, v), 0.0
        x, y, z = _point(body, side, u, v)
        x, y, z = point_at(frame, x, y, z)
        d = call_surface(wall[0], wall[2], x, y, z, out)
        if d - h >= target:
            continue
        gx, gy, gz = out[0], out[1], out[2]
        inside = holds(wall, x, y, z, out)
        if inside and d <= -wall[4]:
            # What is so deep belongs to another pipe.
            return n
        if inside and d < target:
            n, held = _add_minimum(con, n, wall, frame, body, side, u, v, du, dv, d, reach, out)
            strays += 1 * (not held)
            if strays > MAX_STRAYS:
                return n
            target = _deepest(con, n, wall[5])[1] + reach - PROVED
        if h < (leaf if inside else BEYOND * leaf):
            continue
        if not inside and not _is_near(wall, x, y, z, h, out):
            continue
        out[0], out[1], out[2] = gx, gy, gz
        ball = _beside(body, frame, _ball(wall, x, y, z, d, out))
        k = BALL * (balls % BALLS)
        room[k], room[k + 1], room[k + 2], room[k + 3] = ball
        balls += 1
        if _is_within(ball[3], _across(body, ball, side, u, v, du, dv), target):
            continue
        if end + 2 - first <= CELLS:
            _halve(room, end, body, side, u, v, du, dv)
            end += 2
    return n


@compiled
def corner_ball(con, n, wall, frame, out):
    """Return a ball of the bore at the deepest contact, in the fitting's frame, and its target.

    A geom whose corners all lie in the ball, see ``is_in_ball``, is nowhere deeper. It is without
    end at a smooth wall, and where another fitting holds the geom's middle, and proves it.
    """
    if wall[10] > 0.0 or not holds(wall, frame[0], frame[1], frame[2], out):
        return (0.0, 0.0, 0.0, math.inf), 0.0
    ball, _, target = _first_ball(con, n, wall, frame, 0.0, out)
    return ball, target


@compiled
def is_in_ball(ball, x, y, z, target):
    """Tell whether a point is ``target`` m from the wall for it lies in a ball of the bore."""
    x, y, z = x - ball[0], y - ball[1], z - ball[2]
    return _is_within(ball[3], x * x + y * y + z * z, target)


@compiled
def edge_no_deeper(con, n, wall, ball, a, b, out):
    """Add contacts until no point of an edge is deeper, by ``PROVED``, than the deepest.

    Args:
        con: room for contacts, see ``contacts.keep``.
        n: how many there are.
        wall: see ``bodies.wall_of``.
        ball: of the bore, see ``_ball``.
        a: one end in the fitting's frame, and its distance from the wall, m.
        b: the other.
        out: room for what the surface writes.
    """
    x, y, z = 0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1]), 0.5 * (b[2] - a[2])
    half, target = math.sqrt(x * x + y * y + z * z), _deepest(con, n, wall[5])[1] - PROVED
    if 0.5 * (a[3] + b[3]) - half >= target or half < 1e-12:
        return n
    if is_in_ball(ball, a[0], a[1], a[2], target) and is_in_ball(ball, b[0], b[1], b[2], target):
        return n
    middle = a[0] + x, a[1] + y, a[2] + z
    x, y, z = x / half, y / half, z / half
    frame = (*middle, 0.0, 0.0, x, 0.0, 0.0, y, 0.0, 0.0, z)
    return no_deeper(con, n, wall, frame, (LINE, 0.0, half, 0.0), 0.0, out)
