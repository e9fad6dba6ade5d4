"""The exact inner surface of an equal tee with a rounded rim.

The bore is the union of a run along z and a branch along +x, both of radius R. The wall is its
complement, opened by
a ball of radius f: shrunk by f to E = {points rho = R + f or more from the run's axis and, for x >
0, the branch's}, then grown by f. The distance to the wall is therefore the distance to E less f. E
has two faces, the cylinders of
radius rho, and an edge where they meet: the half ellipses x = |z|, with semi-axes sqrt(2) rho and
rho.
"""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import Array

_BISECTIONS = 50


def tee_signed_distance(points: Array, radius: float, fillet: float) -> tuple[Array, Array]:
    """Distance (...,) m of ``points`` (..., 3) m to the wall, positive in the bore, and its unit
    gradient (..., 3).

    Args:
        points: tee frame, run along z, branch along +x.
        radius: R, m.
        fillet: f, m.
    """
    rho = radius + fillet
    x, y, z = np.moveaxis(points, -1, 0)
    from_run, from_branch = np.hypot(x, y), np.hypot(y, z)
    beside = x < 0  # here the wall is the run's alone
    in_e = (from_run >= rho) & (beside | (from_branch >= rho))

    run_point = _onto_cylinder(points, [1, 1, 0], from_run, rho)
    branch_point = _onto_cylinder(points, [0, 1, 1], from_branch, rho)
    run_valid = (from_run <= rho) & (beside | (np.abs(z) >= run_point[..., 0]))
    branch_valid = (from_branch <= rho) & ~beside & (x >= np.abs(branch_point[..., 2]))
    edge_point = _onto_edge(points, rho)

    candidates = np.stack([run_point, branch_point, edge_point], axis=-2)  # (..., 3, 3)
    distance = np.linalg.norm(candidates - points[..., None, :], axis=-1)
    # Inside E the nearest boundary is the nearer cylinder.
    deep = np.stack([np.full(x.shape, True), ~beside, np.full(x.shape, False)], axis=-1)
    open_side = np.stack([run_valid, branch_valid, ~beside], axis=-1)
    allowed = np.where(in_e[..., None], deep, open_side)
    best = np.argmin(np.where(allowed, distance, np.inf), axis=-1)[..., None]
    nearest = np.take_along_axis(candidates, best[..., None], axis=-2)[..., 0, :]
    away = np.take_along_axis(distance, best, axis=-1)[..., 0]
    sign = np.where(in_e, -1.0, 1.0)
    gradient = sign[..., None] * (points - nearest) / np.where(away > 0, away, 1.0)[..., None]
    return sign * away - fillet, gradient


def _onto_cylinder(points: Array, mask: list[int], distance: Array, rho: float) -> Array:
    """Radial projection of points (..., 3) onto the cylinder of radius rho; ``mask`` keeps what is
    across."""
    across = points * mask
    scale = rho / np.where(distance > 0, distance, 1.0)
    on_axis = np.array([0.0, rho, 0.0])
    return points - across + np.where((distance > 0)[..., None], across * scale[..., None], on_axis)


def _onto_edge(points: Array, rho: float) -> Array:
    """Nearest points (..., 3) of the edge (rho cos t, rho sin t, +-rho cos t), |t| <= 90 degrees.

    In the ellipse's plane, along its axes, the point is (u, v); the foot is the one root in the
    quadrant of g(t) = a u sin t - b v cos t - (a^2 - b^2) sin t cos t, found by bisection.
    """
    x, y, z = np.moveaxis(points, -1, 0)
    u, v = np.maximum(x + np.abs(z), 0.0) / np.sqrt(2), np.abs(y)
    a, b = np.sqrt(2) * rho, rho
    low, high = np.zeros(x.shape), np.full(x.shape, np.pi / 2)
    for _ in range(_BISECTIONS):
        t = (low + high) / 2
        sin, cos = np.sin(t), np.cos(t)
        below = a * u * sin - b * v * cos - (a * a - b * b) * sin * cos < 0
        low, high = np.where(below, t, low), np.where(below, high, t)
    t = (low + high) / 2
    side = np.where(z < 0, -1.0, 1.0)
    return rho * np.stack(
        [np.cos(t), np.where(y < 0, -1.0, 1.0) * np.sin(t), side * np.cos(t)], axis=-1
    )
