"""Distance to the walls of a reducer, an elbow and a tee at one point, compiled: the same surfaces
as in ``pipes``.

Scalars in, scalars out: distance (m, positive in the bore), its gradient, and the face that is
nearest.
"""

from __future__ import annotations

import math

from numba import njit

FACE, EDGE = 0, 1
"""Nearest part of a wall: a cylinder, cone or torus; or the rounded rim of a tee, the edge of a
cone."""
_compiled = njit(cache=True, error_model="numpy")


@_compiled
def cone(x, y, z, radius, length, end_radius):
    """Wall of a reducer between its ports: (d, gx, gy, gz, face) at a point of the fitting frame,
    m."""
    slope = (end_radius - radius) / length
    cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    from_axis = math.sqrt(x * x + y * y)
    ox, oy = (x / from_axis, y / from_axis) if from_axis > 0.0 else (1.0, 0.0)
    d = cosine * (radius + slope * z - from_axis)
    foot = z - slope * cosine * d
    if 0.0 <= foot <= length:
        return d, -cosine * ox, -cosine * oy, cosine * slope, FACE
    edge = 0.0 if foot < 0.0 else length
    across, along = from_axis - radius - slope * edge, z - edge
    away = math.copysign(math.sqrt(across * across + along * along), d)
    if away == 0.0:
        return 0.0, -cosine * ox, -cosine * oy, cosine * slope, FACE
    return away, across * ox / away, across * oy / away, along / away, EDGE


@_compiled
def torus(x, y, z, mean_radius, radius):
    """Wall of an elbow: (d, gx, gy, gz) at a point of the fitting frame, m."""
    px = x - mean_radius
    from_axis = math.sqrt(px * px + z * z)
    ox, oz = px / from_axis, z / from_axis
    across = from_axis - mean_radius
    away = math.sqrt(across * across + y * y)
    if away < 1e-12:
        return radius, -1.0, 0.0, 0.0
    return radius - away, -across * ox / away, -y / away, -across * oz / away


@_compiled
def tee(x, y, z, radius, fillet):
    """Wall of a tee with its rounded rim: (d, gx, gy, gz, face). See ``pipes.saddle`` for the
    surface.

    A cylinder's foot, where it is on the wall, is never farther than the edge, which lies on both
    cylinders.
    """
    rho = radius + fillet
    from_run, from_branch = math.sqrt(x * x + y * y), math.sqrt(y * y + z * z)
    beside = x < 0.0
    if from_run >= rho and (
        beside or from_branch >= rho
    ):  # within the wall, deeper than the fillet
        if beside or from_run <= from_branch:
            return rho - from_run - fillet, -x / from_run, -y / from_run, 0.0, FACE
        return rho - from_branch - fillet, 0.0, -y / from_branch, -z / from_branch, FACE
    best = math.inf
    gx = gy = gz = 0.0
    if from_run <= rho and (beside or abs(z) * from_run >= rho * x):
        best = rho - from_run
        if from_run > 1e-12:
            gx, gy = -x / from_run, -y / from_run
    if (
        from_branch <= rho
        and not beside
        and x * from_branch >= rho * abs(z)
        and rho - from_branch < best
    ):
        best = rho - from_branch
        gx = gy = gz = 0.0
        if from_branch > 1e-12:
            gy, gz = -y / from_branch, -z / from_branch
    if best < math.inf:
        return best - fillet, gx, gy, gz, FACE
    ex, ey, ez = _onto_edge(x, y, z, rho)
    dx, dy, dz = x - ex, y - ey, z - ez
    away = math.sqrt(dx * dx + dy * dy + dz * dz)
    return away - fillet, dx / away, dy / away, dz / away, EDGE


@_compiled
def _onto_edge(x, y, z, rho):
    """Nearest point of the edge (rho cos t, rho sin t, +-rho cos t), |t| <= 90 degrees.

    The root of g(t) = a u sin t - b v cos t - (a^2 - b^2) sin t cos t in the first quadrant, by
    Newton's method kept in a bracket; (u, v) is the point along the ellipse's axes.
    """
    root2 = math.sqrt(2.0)
    u, v = max(x + abs(z), 0.0) / root2, abs(y)
    a, b = root2 * rho, rho
    low, high = 0.0, math.pi / 2
    t = math.atan2(a * v, b * u) if u + v > 0 else 0.0
    sin, cos = math.sin(t), math.cos(t)
    for _ in range(60):
        g = a * u * sin - b * v * cos - (a * a - b * b) * sin * cos
        slope = a * u * cos + b * v * sin - (a * a - b * b) * (cos * cos - sin * sin)
        if g < 0.0:
            low = t
        else:
            high = t
        new = t - g / slope if slope > 0.0 else low - 1.0
        if not low <= new <= high:
            new = 0.5 * (low + high)
        done = abs(new - t) < 1e-12
        t = new
        sin, cos = math.sin(t), math.cos(t)
        if done:
            break
    side_y = -1.0 if y < 0.0 else 1.0
    side_z = -1.0 if z < 0.0 else 1.0
    return rho * cos, side_y * rho * sin, side_z * rho * cos
