"""Minima of the distance to a wall along a line or a circle.

A curve is ten numbers: a point (3), a unit vector (3), another one across it (3), and the radius;
radius 0 is the line through the point along the first vector. Places along it are arc lengths, m.
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import EDGE, HIGH, HIGH_ENDS, LOW, LOW_ENDS, compiled
from omnitrack_sim.pipes.native import call_span, call_surface
from omnitrack_sim.walls.contacts import keep

PLATEAU = 0.02
"""Slope along a line up to which a wall that ends at a rim counts as carrying it."""
POSITION = 1e-7
"""Accuracy of a minimum along a curve, m."""
FLAT = 1e-9
"""Slope along a curve that is none: at a minimum."""
SAME_PLACE = 1e-9
"""Room about a point, m, that keeps it in one fitting or the other at a joint in spite of
rounding."""


@compiled
def place(curve, s):
    """Point and unit tangent, six numbers, of a curve at s."""
    cx, cy, cz, ux, uy, uz, vx, vy, vz, r = curve
    if r == 0.0:
        return cx + s * ux, cy + s * uy, cz + s * uz, ux, uy, uz
    c, d = math.cos(s / r), math.sin(s / r)
    a, b = r * c, r * d
    return (
        cx + a * ux + b * vx,
        cy + a * uy + b * vy,
        cz + a * uz + b * vz,
        c * vx - d * ux,
        c * vy - d * uy,
        c * vz - d * uz,
    )


@compiled
def slope_at(surface, sizes, curve, s, out):
    """Distance from the wall, its derivative along the curve, and the face, at s."""
    x, y, z, tx, ty, tz = place(curve, s)
    d = call_surface(surface, sizes, x, y, z, out)
    return d, out[0] * tx + out[1] * ty + out[2] * tz, out[3]


@compiled
def minimum(surface, sizes, curve, a, slope_a, b, slope_b, out):
    """Find the minimum in [a, b] by regula falsi (Illinois); the slope is negative at ``a``."""
    side = 0
    s = b
    for _ in range(60):
        s = (a * slope_b - b * slope_a) / (slope_b - slope_a)
        _, slope, _ = slope_at(surface, sizes, curve, s, out)
        if slope < 0.0:
            a, slope_a = s, slope
            if side == -1:
                # Illinois: an end that has stayed twice gets half its weight, or convergence would
                # be linear.
                slope_b *= 0.5
            side = -1
        else:
            b, slope_b = s, slope
            if side == 1:
                slope_a *= 0.5
            side = 1
        if b - a < POSITION or abs(slope) < FLAT:
            break
    return s


@compiled
def rim_begins(surface, sizes, curve, a, face_a, b, out):
    """Bisect [a, b] for the place where the nearest part of the wall changes."""
    while b - a > POSITION:
        s = 0.5 * (a + b)
        _, _, face = slope_at(surface, sizes, curve, s, out)
        if face == face_a:
            a = s
        else:
            b = s
    return 0.5 * (a + b)


@compiled
def holds(wall, x, y, z, out):
    """Return whether a point lies between the port planes, as the fitting's ``span`` has it."""
    out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -SAME_PLACE, SAME_PLACE, 0.0, 0.0
    # A line in an oblique direction, which is hardly ever parallel to a port plane.
    call_span(wall[1], wall[2], wall[3], x, y, z, 0.57735, 0.57735, 0.57735, out)
    return out[HIGH] >= out[LOW]


@compiled
def _leaves(wall, curve, a, b, out):
    """Find the last place between ``a`` and ``b`` of a curve that the fitting holds.

    It holds ``a`` and not ``b``.
    """
    while abs(b - a) > POSITION:
        s = 0.5 * (a + b)
        x, y, z, _, _, _ = place(curve, s)
        if holds(wall, x, y, z, out):
            a = s
        else:
            b = s
    return a


@compiled
def _between(con, n, wall, curve, a, at_a, b, at_b, reach, out):
    """Add the contact between two neighbouring samples, if there is one.

    At a minimum, or where a rim begins at a wall that carries the line up to there.
    """
    surface, sizes = wall[0], wall[2]
    d_a, slope_a, face_a = at_a
    d_b, slope_b, face_b = at_b
    # The distance changes by no more than one metre a metre.
    if 0.5 * (d_a + d_b - (b - a)) >= reach + wall[5]:
        return n
    if slope_a < 0.0 <= slope_b:
        s = minimum(surface, sizes, curve, a, slope_a, b, slope_b, out)
    elif face_a != face_b and (slope_b if face_b == EDGE else -slope_a) > -PLATEAU:
        s = rim_begins(surface, sizes, curve, a, face_a, b, out)
    else:
        return n
    x, y, z, _, _, _ = place(curve, s)
    d = call_surface(surface, sizes, x, y, z, out)
    return keep(con, n, wall, d, reach, x, y, z, out)


@compiled
def _stride(wall, d, reach):
    """Return the length, m, to the next sample: to where the wall can be touched.

    It is at least a spacing.
    """
    return max(wall[7], d - reach - wall[5])


@compiled
def along_line(con, n, wall, line, half, low_counts, high_counts, reach, out):
    """Add the contacts of a ball of radius ``reach`` that is moved along a line.

    Args:
        con: room for contacts, see ``contacts.keep``.
        n: how many there are.
        wall: see ``bodies.wall_of``.
        line: a curve of radius 0.
        half: m, to either side of its middle.
        low_counts: whether (over 0) the ball at the beginning is asked for.
        high_counts: whether (over 0) the ball at the end is asked for.
        reach: m, radius of the ball.
        out: room for what the surface writes.
    """
    px, py, pz, ax, ay, az, _, _, _, _ = line
    surface, span, sizes, ends = wall[0], wall[1], wall[2], wall[3]
    # Most edges of a body are farther from the wall than they are long.
    if call_surface(surface, sizes, px, py, pz, out) - half >= reach + wall[5]:
        return n
    out[LOW], out[HIGH], out[LOW_ENDS], out[HIGH_ENDS] = -half, half, low_counts, high_counts
    within = call_span(span, sizes, ends, px, py, pz, ax, ay, az, out)
    low, high, low_ends, high_ends = out[LOW], out[HIGH], out[LOW_ENDS] > 0, out[HIGH_ENDS] > 0
    if high < low or (within == 0.0 and not low_ends and not high_ends):
        return n
    at_low = slope_at(surface, sizes, line, low, out)
    if low_ends:
        x, y, z, _, _, _ = place(line, low)
        n = keep(con, n, wall, at_low[0], reach, x, y, z, out)
    at_high = slope_at(surface, sizes, line, high, out)
    if high_ends:
        x, y, z, _, _, _ = place(line, high)
        n = keep(con, n, wall, at_high[0], reach, x, y, z, out)
    if within == 0.0 or 0.5 * (at_low[0] + at_high[0] - (high - low)) >= reach + wall[5]:
        return n
    a, at_a = low, at_low
    while a < high:
        b = a + _stride(wall, at_a[0], reach)
        if b >= high:
            b, at_b = high, at_high
        else:
            at_b = slope_at(surface, sizes, line, b, out)
        n = _between(con, n, wall, line, a, at_a, b, at_b, reach, out)
        a, at_a = b, at_b
    return n


@compiled
def along_circle(con, n, wall, circle, out):
    """Add the contacts at the minima of the distance along a circle, see ``contacts.keep``.

    Samples that the fitting does not hold are passed over; where the circle leaves through a port
    plane that place is a sample, so that the next fitting goes on from it.
    """
    surface, sizes, end = wall[0], wall[2], 2.0 * math.pi * circle[9]
    if call_surface(surface, sizes, circle[0], circle[1], circle[2], out) - circle[9] >= wall[5]:
        return n
    first = at_a = slope_at(surface, sizes, circle, 0.0, out)
    a = 0.0
    while a < end:
        # An eighth of the circle at most: over more of it a minimum and a maximum cancel.
        b = min(a + min(_stride(wall, at_a[0], 0.0), end / 8), end)
        # Where it closes rounding must not hide a minimum.
        at_b = slope_at(surface, sizes, circle, b, out) if b < end else first
        if 0.5 * (at_a[0] + at_b[0] - (b - a)) < wall[5]:
            n = _within(con, n, wall, circle, a, at_a, b, at_b, out)
        a, at_a = b, at_b
    return n


@compiled
def _within(con, n, wall, circle, a, at_a, b, at_b, out):
    """Add the contact between two samples of the part of a circle that the fitting holds."""
    x, y, z, _, _, _ = place(circle, a)
    inside_a = holds(wall, x, y, z, out)
    x, y, z, _, _, _ = place(circle, b)
    inside_b = holds(wall, x, y, z, out)
    if inside_a and inside_b:
        return _between(con, n, wall, circle, a, at_a, b, at_b, 0.0, out)
    if inside_a:
        s = _leaves(wall, circle, a, b, out)
        at_s = slope_at(wall[0], wall[2], circle, s, out)
        return _between(con, n, wall, circle, a, at_a, s, at_s, 0.0, out)
    if inside_b:
        s = _leaves(wall, circle, b, a, out)
        at_s = slope_at(wall[0], wall[2], circle, s, out)
        return _between(con, n, wall, circle, s, at_s, b, at_b, 0.0, out)
    return n
