"""The exact inner surface of a wye with a rounded rim.

A wye is a tee at any angle, with an equal or a smaller branch.

Frame: run of radius R along z, branch of radius r <= R along u = (sin a, 0, cos a) from the origin.
With e = (cos a, 0, -sin a) a point has the coordinates t = p.u along and w = p.e, y across the
branch.

The wall is the complement of both bores, opened by a ball of radius f: shrunk by f to E = {A = R +
f or more from the run's axis and, where t > 0, B = r + f or more from the branch's}, then grown by
f. So the distance to the wall is the distance to E less f. The half space t > 0 may stand for any
other that cuts the branch within the run, such as x > 0: what the run leaves of the branch's
cylinder has t > 0 on the one side and t < 0 on the other, for B <= A and every a.

E has two faces, the cylinders, and an edge where they meet: y = B sin q, w = B cos q, x = sqrt(A^2
- y^2), z = (x cos a - w) / sin a, with the angle q around the branch from 0 at the heel (obtuse) to
pi at the crotch (acute). For A = B it is two half ellipses in the planes that halve the angles
between the axes. Seen along y it is a hyperbola: (x + w) (x - w) = A^2 - B^2.

Which part of E is nearest: a point of the bore within the run is nearest to its foot on the run's
cylinder if that foot is on E, for all of E is as far from the run's axis. Else its foot on the
branch's cylinder if that is on E; else the edge.

The functions are those of ``compiled.Wall``; their ``sizes``: half run, branch length, run radius,
branch radius, fillet radius (m), sine and cosine of the angle.
"""

from __future__ import annotations

import math

from omnitrack_sim.pipes.compiled import (
    EDGE,
    FACE,
    HIGH,
    HIGH_ENDS,
    LOW,
    LOW_ENDS,
    compiled,
    in_bore,
    out_of_two,
    part_within,
)

EQUAL = 1e-9
"""Bores whose radii differ by less, m, are equal."""
_CLOSE = 1e-7  # rad; Newton's method squares the error once more after a step as small as this
_SAME_DIRECTION = 1e-15  # rad; Newton's bracket is as narrow as numbers can tell
_ROOTS = 4  # square roots: the edge is sampled at 2 ** _ROOTS + 1 places


@compiled
def surface(sizes, x, y, z, out):
    """Return the distance, m, at a point of the wye's frame, positive in the bore.

    The gradient goes to out[0:3], the face to out[3].
    """
    fillet, sin, cos = sizes[4], sizes[5], sizes[6]
    big, small = sizes[2] + fillet, sizes[3] + fillet
    t, w = x * sin + z * cos, x * cos - z * sin
    from_run, from_branch = math.sqrt(x * x + y * y), math.sqrt(y * y + w * w)
    out[3] = FACE
    if from_run >= big and (
        t <= 0.0 or from_branch >= small
    ):  # within the wall, deeper than the fillet
        # Deep in the wall the nearest face is that of the cylinder whose wall is less deep.
        if t > 0.0 and from_branch - small < from_run - big:
            out[0], out[1], out[2] = -w * cos / from_branch, -y / from_branch, w * sin / from_branch
            return small - from_branch - fillet
        out[0], out[1], out[2] = -x / from_run, -y / from_run, 0.0
        return big - from_run - fillet
    if from_run <= big:
        ox, oy = (x / from_run, y / from_run) if from_run > 0.0 else (0.0, 1.0)
        foot_x, foot_y = big * ox, big * oy
        foot_w = foot_x * cos - z * sin
        if foot_x * sin + z * cos <= 0.0 or foot_y * foot_y + foot_w * foot_w >= small * small:
            out[0], out[1], out[2] = -ox, -oy, 0.0
            return big - from_run - fillet
    if from_branch <= small and t > 0.0:
        if from_branch > 0.0:
            ow, oy = w / from_branch, y / from_branch
        else:
            # On the branch's axis all feet are equally far: the one farthest from the run counts.
            ow = min(1.0, t * cos / (sin * small))
            oy = math.sqrt(1.0 - ow * ow)
        foot_x, foot_y = t * sin + small * ow * cos, small * oy
        if foot_x * foot_x + foot_y * foot_y >= big * big:
            out[0], out[1], out[2] = -ow * cos, -oy, ow * sin
            return small - from_branch - fillet
    return from_edge(big, small, sin, cos, x, y, z, out) - fillet


@compiled
def from_edge(big, small, sin, cos, x, y, z, out):
    """Distance m to the edge; gradient and face to ``out``."""
    v = abs(y)
    if big - small < EQUAL:
        # Equal bores: the half ellipses lie in the planes that halve the angles between the axes.
        half_cos = math.sqrt(0.5 * (1.0 + cos))
        half_sin = 0.5 * sin / half_cos
        # Along the two half ellipses; one of the two is positive where x is.
        first, second = x * half_cos - z * half_sin, x * half_sin + z * half_cos
        ex = ey = ez = 0.0
        best = math.inf
        if first > 0.0 or second <= 0.0:
            k, l = on_ellipse(big / half_cos, big, max(first, 0.0), v)
            ex, ey, ez = big * k, big * l, -big * k * half_sin / half_cos
            best = (x - ex) ** 2 + (v - ey) ** 2 + (z - ez) ** 2
        if second > 0.0:
            k, l = on_ellipse(big / half_sin, big, second, v)
            fx, fy, fz = big * k, big * l, big * k * half_cos / half_sin
            if (x - fx) ** 2 + (v - fy) ** 2 + (z - fz) ** 2 < best:
                ex, ey, ez = fx, fy, fz
    else:
        k, l = _on_curve(big, small, sin, cos, x, v, z)
        ey, w = small * l, small * k
        ex = math.sqrt(big * big - small * small + w * w)
        ez = (ex * cos - w) / sin
    dx, dy, dz = x - ex, (v - ey) * (-1.0 if y < 0.0 else 1.0), z - ez
    away = math.sqrt(dx * dx + dy * dy + dz * dz)
    out[3] = EDGE
    if away > 0.0:
        out[0], out[1], out[2] = dx / away, dy / away, dz / away
    else:
        out[0], out[1], out[2] = -x / big, -y / big, 0.0
    return away


@compiled
def on_ellipse(a, b, u, v):
    """Return cosine and sine of q where (a cos q, b sin q) is nearest to (u, v), all >= 0.

    The root of g(q) = a u sin q - b v cos q - (a^2 - b^2) sin q cos q in the first quadrant, by
    Newton's method kept in a bracket. Directions stand for angles, so that no iteration needs a
    sine.
    """
    square = a * a - b * b
    # On the long axis, up to where the ends of that axis bend, they are farthest.
    if v == 0.0 and a * u < square:
        k = a * u / square
        return k, math.sqrt(1.0 - k * k)
    low_k, low_l, high_k, high_l = 1.0, 0.0, 0.0, 1.0
    k, l = b * u, a * v
    size = math.sqrt(k * k + l * l)
    if size > 0.0:
        k, l = k / size, l / size
    else:
        k, l = 0.0, 1.0
    for _ in range(60):
        g = a * u * l - b * v * k - square * l * k
        slope = a * u * k + b * v * l - square * (k * k - l * l)
        if g < 0.0:
            low_k, low_l = k, l
        else:
            high_k, high_l = k, l
        k, l, close = _step(g, slope, k, l, low_k, low_l, high_k, high_l)
        if close:
            break
    return k, l


@compiled
def _step(g, slope, k, l, low_k, low_l, high_k, high_l):
    """Step by Newton or bisection from the direction (k, l); tell whether it was the last step."""
    if slope > 0.0:
        # Half of Newton's step as the tangent of the half angle: a rational rotation without a
        # sine.
        h = -0.5 * g / slope
        if abs(h) < 1.0:
            scale = 1.0 / (1.0 + h * h)
            even, odd = (1.0 - h * h) * scale, 2.0 * h * scale
            new_k, new_l = even * k - odd * l, even * l + odd * k
            if low_k * new_l - low_l * new_k >= 0.0 and new_k * high_l - new_l * high_k >= 0.0:
                return new_k, new_l, abs(h) < _CLOSE
    # The sum of two unit vectors halves the angle between them.
    k, l = low_k + high_k, low_l + high_l
    size = math.sqrt(k * k + l * l)
    return k / size, l / size, low_k * high_l - low_l * high_k < _SAME_DIRECTION


@compiled
def _on_curve(big, small, sin, cos, x, v, z):
    """Return the direction round the branch of the edge's point nearest to (x, v, z), v >= 0.

    A direction is cosine and sine of the angle.

    Samples at even steps along the hyperbola (p = X + W grows by a constant factor) bracket the two
    lowest minima.
    """
    square = big * big - small * small
    # Ratio of the largest p (heel) to the smallest (crotch); its 16th root is the step.
    factor = (big + small) / (big - small)
    for _ in range(_ROOTS):
        factor = math.sqrt(factor)
    count = 2**_ROOTS
    p, shrink, side = big + small, 1.0 / factor, big - small
    # Directions: two samples back, one back, this one. Brackets of the two lowest minima: low,
    # middle, high.
    k0 = k1 = 1.0
    l0 = l1 = 0.0
    d0 = d1 = math.inf
    best = other = math.inf
    bk0 = bk1 = bk2 = ck0 = ck1 = ck2 = 1.0
    bl0 = bl1 = bl2 = cl0 = cl1 = cl2 = 0.0
    for i in range(count + 2):
        k2, l2, d2 = k1, l1, math.inf
        if i <= count:
            # The last sample is set to the crotch itself, since rounding may miss it.
            w = 0.5 * (p - side) if i < count else -small
            edge_x, y = 0.5 * (p + side), math.sqrt(max(small * small - w * w, 0.0))
            dx, dy, dz = edge_x - x, y - v, (edge_x * cos - w) / sin - z
            k2, l2, d2 = w / small, y / small, dx * dx + dy * dy + dz * dz
            p, side = p * shrink, side * factor
        # The middle of three samples is lowest: they bracket a minimum.
        if d1 <= d0 and d1 < d2:
            if d1 < best:
                other, ck0, cl0, ck1, cl1, ck2, cl2 = best, bk0, bl0, bk1, bl1, bk2, bl2
                best, bk0, bl0, bk1, bl1, bk2, bl2 = d1, k0, l0, k1, l1, k2, l2
            elif d1 < other:
                other, ck0, cl0, ck1, cl1, ck2, cl2 = d1, k0, l0, k1, l1, k2, l2
        k0, l0, d0, k1, l1, d1 = k1, l1, d1, k2, l2, d2
    k, l, least = _minimum(square, small, sin, cos, x, v, z, bk0, bl0, bk1, bl1, bk2, bl2)
    if other < math.inf:
        k1, l1, d1 = _minimum(square, small, sin, cos, x, v, z, ck0, cl0, ck1, cl1, ck2, cl2)
        if d1 < least:
            k, l = k1, l1
    return k, l


@compiled
def _minimum(square, small, sin, cos, px, py, pz, low_k, low_l, k, l, high_k, high_l):
    """Return the direction of the minimum between two directions, and its squared distance.

    Newton's method on the derivative g of half the squared distance, kept in the bracket.
    """
    for _ in range(60):
        y, w = small * l, small * k
        inverse = 1.0 / math.sqrt(square + w * w)
        x = (square + w * w) * inverse
        dx = -w * y * inverse
        ddx = (y * y - w * w - dx * dx) * inverse
        ax, ay, az = x - px, y - py, (x * cos - w) / sin - pz
        dz, ddz = (dx * cos + y) / sin, (ddx * cos + w) / sin
        g = ax * dx + ay * w + az * dz
        slope = dx * dx + w * w + dz * dz + ax * ddx - ay * y + az * ddz
        if g < 0.0:
            low_k, low_l = k, l
        else:
            high_k, high_l = k, l
        k, l, close = _step(g, slope, k, l, low_k, low_l, high_k, high_l)
        if close:
            break
    y, w = small * l, small * k
    x = math.sqrt(square + w * w)
    return k, l, (x - px) ** 2 + (y - py) ** 2 + ((x * cos - w) / sin - pz) ** 2


@compiled
def span(sizes, ends, px, py, pz, ax, ay, az, out):
    """See ``compiled.Wall``.

    The legs of an oblique wye cross the port planes of one another: beyond a leg's plane a line is
    outside unless it is in the other leg there.
    """
    run_low, run_high = in_run(sizes, px, py, pz, ax, ay, az)
    low, high = in_branch(sizes, px, py, pz, ax, ay, az, 0.0)
    clip_leg(-pz - sizes[0], -az, ends[0], low, high, out)
    clip_leg(pz - sizes[0], az, ends[1], low, high, out)
    value, slope = px * sizes[5] + pz * sizes[6] - sizes[1], ax * sizes[5] + az * sizes[6]
    clip_leg(value, slope, ends[2], run_low, run_high, out)
    return 1.0


@compiled
def in_run(sizes, px, py, pz, ax, ay, az):
    """Return the part [low, high] of a line in the bore of the run, between its port planes."""
    low, high = in_bore(px, py, ax, ay, sizes[2])
    low, high = part_within(low, high, pz - sizes[0], az)
    return part_within(low, high, -pz - sizes[0], -az)


@compiled
def in_branch(sizes, px, py, pz, ax, ay, az, back):
    """Return the part [low, high] of a line in the bore of the branch.

    It begins ``back`` m behind where the axes meet, and ends at the port plane.
    """
    sin, cos = sizes[5], sizes[6]
    low, high = in_bore(px * cos - pz * sin, py, ax * cos - az * sin, ay, sizes[3])
    along, ahead = px * sin + pz * cos, ax * sin + az * cos
    low, high = part_within(low, high, along - sizes[1], ahead)
    return part_within(low, high, -along - back, -ahead)


@compiled
def clip_leg(value, slope, ends, other_low, other_high, out):
    """Keep the part of the span where value + slope s <= 0: inside the port plane of a leg.

    What lies beyond is kept where the line is in the other leg there, from ``other_low`` to
    ``other_high``.
    """
    low, high = out[LOW], out[HIGH]
    # A line parallel to the plane is either wholly inside or wholly outside.
    s = -value / slope if abs(slope) >= 1e-14 else (math.inf if value <= 0.0 else -math.inf)
    rising = slope >= 0.0 or abs(slope) < 1e-14
    if high < low or (rising and s >= high) or (not rising and s <= low):
        return
    first, last = (max(low, s), high) if rising else (low, min(high, s))
    if max(first, other_low) < min(last, other_high):
        return
    if (rising and s <= low) or (not rising and s >= high):
        out[HIGH] = low - 1.0
    elif rising:
        out[HIGH], out[HIGH_ENDS] = s, ends
    else:
        out[LOW], out[LOW_ENDS] = s, ends


@compiled
def clear(sizes, px, py, pz, ax, ay, az):
    """See ``compiled.Wall``: up to where the line leaves both cylinders; the rim leaves more."""
    sin, cos = sizes[5], sizes[6]
    low, high = in_bore(px, py, ax, ay, sizes[2])
    w, across = px * cos - pz * sin, ax * cos - az * sin
    branch_low, branch_high = in_bore(w, py, across, ay, sizes[3])
    along, ahead = px * sin + pz * cos, ax * sin + az * cos
    branch_low, branch_high = part_within(branch_low, branch_high, -along, -ahead)
    return out_of_two(low, high, branch_low, branch_high)
