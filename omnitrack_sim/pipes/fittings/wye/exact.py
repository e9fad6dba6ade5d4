"""The exact inner surface of a wye (a tee at any angle, with an equal or a smaller branch) with a
rounded rim.

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
"""

from __future__ import annotations

import math

import numpy as np

from omnitrack_sim.base.rotations import Array

EQUAL = 1e-9
"""Bores whose radii differ by less, m, are equal."""
_BISECTIONS = 52
_SAMPLES = 64
_CHUNK = 20000


def wye_signed_distance(
    points: Array, run_radius: float, branch_radius: float, fillet: float, angle: float
) -> tuple[Array, Array]:
    """Distance (...,) m of ``points`` (..., 3) m to the wall, positive in the bore, and its unit
    gradient (..., 3).

    Args:
        points: wye frame, run along z, branch along (sin angle, 0, cos angle).
        run_radius, branch_radius: R and r <= R, m.
        fillet: f, m.
        angle: between branch and +z, rad.
    """
    points = np.asarray(points, float)
    big, small = run_radius + fillet, branch_radius + fillet
    sin, cos = math.sin(angle), math.cos(angle)
    x, y, z = np.moveaxis(points, -1, 0)
    t, w = x * sin + z * cos, x * cos - z * sin
    from_run, from_branch = np.hypot(x, y), np.hypot(y, w)
    in_e = (from_run >= big) & ((t <= 0) | (from_branch >= small))

    # Unit vectors out from the axes; on an axis, towards a foot that is on E if any is.
    out_x, out_y = _direction(x, y, from_run, np.zeros_like(x))
    steepest = np.clip(t * cos / sin / small, -1.0, 1.0)
    out_w, out_v = _direction(w, y, from_branch, steepest)
    foot_x = big * out_x
    foot_w = foot_x * cos - z * sin
    run_valid = (from_run <= big) & (
        (foot_x * sin + z * cos <= 0) | (np.hypot(big * out_y, foot_w) >= small)
    )
    foot_from_run = np.hypot(t * sin + small * out_w * cos, small * out_v)
    branch_valid = (from_branch <= small) & (t > 0) & (foot_from_run >= big)

    # Inside E the nearest boundary is the nearer cylinder.
    branch_nearer = (t > 0) & (from_branch - small < from_run - big)
    onto_run = np.where(in_e, ~branch_nearer, run_valid)
    to_run = np.stack([-out_x, -out_y, np.zeros_like(x)], axis=-1)
    to_branch = np.stack([-out_w * cos, -out_v, out_w * sin], axis=-1)
    distance = np.where(onto_run, big - from_run, small - from_branch)
    gradient = np.where(onto_run[..., None], to_run, to_branch)

    edge = ~(in_e | run_valid | branch_valid)
    if edge.any():
        nearest = nearest_on_edge(points[edge], big, small, angle)
        apart = points[edge] - nearest
        away = np.linalg.norm(apart, axis=-1)
        distance[edge] = away
        gradient[edge] = np.where(
            (away > 0)[:, None], apart / np.where(away > 0, away, 1.0)[:, None], to_run[edge]
        )
    return distance - fillet, gradient


def edge_curve(q: Array, big: float, small: float, angle: float) -> Array:
    """Points (..., 3) m of the edge at angles ``q`` (...,) rad; ``big`` and ``small`` are A and B,
    m."""
    y, w = small * np.sin(q), small * np.cos(q)
    x = np.sqrt(big * big - small * small + w * w)
    return np.stack([x, y, (x * math.cos(angle) - w) / math.sin(angle)], axis=-1)


def nearest_on_edge(points: Array, big: float, small: float, angle: float) -> Array:
    """The nearest points (n, 3) m of the edge to ``points`` (n, 3) m that are nearest to no
    face."""
    upper = points.copy()
    upper[:, 1] = np.abs(points[:, 1])
    if big - small < EQUAL:
        feet = _on_half_ellipses(upper, big, angle)
    else:
        chunks = [upper[i : i + _CHUNK] for i in range(0, len(upper), _CHUNK)]
        feet = [
            np.concatenate(f)
            for f in zip(*(_on_space_curve(p, big, small, angle) for p in chunks), strict=True)
        ]
    first, second = feet
    first_nearer = np.linalg.norm(first - upper, axis=1) <= np.linalg.norm(second - upper, axis=1)
    best = np.where(first_nearer[:, None], first, second)
    best[:, 1] = np.where(points[:, 1] < 0, -best[:, 1], best[:, 1])
    return best


def _direction(a: Array, b: Array, size: Array, first: Array) -> tuple[Array, Array]:
    """The unit vectors (a, b) / size; where size is 0 the one that begins with ``first``."""
    safe = np.where(size > 0, size, 1.0)
    return (
        np.where(size > 0, a / safe, first),
        np.where(size > 0, b / safe, np.sqrt(1 - first * first)),
    )


def _on_half_ellipses(points: Array, rho: float, angle: float) -> tuple[Array, Array]:
    """Feet (n, 3) on the half ellipses of the heel and of the crotch for equal cylinders of radius
    ``rho``, y >= 0.

    In each plane, along the ellipse's axes, the point is (u, v); the foot is the one root in the
    quadrant of g(q) = a u sin q - b v cos q - (a^2 - b^2) sin q cos q.
    """
    half_sin, half_cos = math.sin(angle / 2), math.cos(angle / 2)
    v, feet = points[:, 1], []
    for along, a in (
        (np.array([half_cos, 0.0, -half_sin]), rho / half_cos),
        (np.array([half_sin, 0.0, half_cos]), rho / half_sin),
    ):
        u = np.maximum(points @ along, 0.0)
        low, high = np.zeros(len(points)), np.full(len(points), np.pi / 2)
        for _ in range(_BISECTIONS):
            q = (low + high) / 2
            sin, cos = np.sin(q), np.cos(q)
            below = a * u * sin - rho * v * cos - (a * a - rho * rho) * sin * cos < 0
            low, high = np.where(below, q, low), np.where(below, high, q)
        q = (low + high) / 2
        feet.append(
            a * np.cos(q)[:, None] * along + rho * np.sin(q)[:, None] * np.array([0.0, 1.0, 0.0])
        )
    return feet[0], feet[1]


def _on_space_curve(points: Array, big: float, small: float, angle: float) -> tuple[Array, Array]:
    """Feet (n, 3) at the two deepest minima of the distance to the edge of unequal cylinders, y >=
    0.

    The minima are bracketed by samples that are dense where the curve bends sharply (evenly spaced
    along the hyperbola, and around the branch), and then found by bisection of the derivative of
    the squared distance.
    """
    sin, cos = math.sin(angle), math.cos(angle)
    gap = math.sqrt(big * big - small * small)
    most = math.asinh(small / gap)
    along = np.arccos(
        np.clip(gap / small * np.sinh(np.linspace(most, -most, _SAMPLES + 1)), -1.0, 1.0)
    )
    samples = np.unique(
        np.concatenate([[0.0, np.pi], along, np.linspace(0, np.pi, _SAMPLES // 2 + 1)])
    )
    curve = edge_curve(samples, big, small, angle)
    squares = ((points[:, None, :] - curve) ** 2).sum(axis=-1)
    padded = np.pad(squares, ((0, 0), (1, 1)), constant_values=np.inf)
    minimum = (squares <= padded[:, :-2]) & (squares <= padded[:, 2:])
    order = np.argsort(np.where(minimum, squares, np.inf), axis=1)[:, :2]
    px, py, pz = points.T
    feet = []
    for pick in order.T:
        low, high = (
            samples[np.maximum(pick - 1, 0)],
            samples[np.minimum(pick + 1, len(samples) - 1)],
        )
        for _ in range(_BISECTIONS):
            q = (low + high) / 2
            y, w = small * np.sin(q), small * np.cos(q)
            x = np.sqrt(gap * gap + w * w)
            dx = -w * y / x
            z, dz = (x * cos - w) / sin, (dx * cos + y) / sin
            below = (x - px) * dx + (y - py) * w + (z - pz) * dz < 0
            low, high = np.where(below, q, low), np.where(below, high, q)
        feet.append(edge_curve((low + high) / 2, big, small, angle))
    return feet[0], feet[1]
