"""The walls of the shipped fittings once more, as NumPy formulas written independently of the
compiled ones that the package states, which are tested against them."""

from __future__ import annotations

import math

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Coupling, Cross, Elbow, Fitting, Mitre, Reducer, Straight, Tee
from omnitrack_sim.pipes.fittings.wye import Wye

EQUAL = 1e-9
"""Bores whose radii differ by less, m, are equal."""
_BISECTIONS = 52
_SAMPLES = 64
_CHUNK = 20000


def signed_distance(fitting: Fitting, points: Array) -> tuple[Array, Array]:
    """Distance (...,) m of points (..., 3) m from the wall of a shipped kind, and its gradient."""
    if isinstance(fitting, Straight) and not fitting.is_round:
        return _section(fitting, points)
    if isinstance(fitting, Straight):
        return _bore(points * [1, 1, 0], fitting.radius)
    if isinstance(fitting, Elbow):
        return _bore(_from_axis_circle(points, fitting.mean_radius), fitting.radius)
    if isinstance(fitting, Reducer):
        return _reducer(fitting, points)
    if isinstance(fitting, Tee):
        return tee_signed_distance(points, fitting.radius, fitting.fillet_radius)
    if isinstance(fitting, Mitre):
        return _mitre(fitting, points)
    if isinstance(fitting, Cross):
        return _cross(fitting, points)
    if isinstance(fitting, Coupling):
        return _coupling(fitting, points)
    assert isinstance(fitting, Wye)
    sizes = fitting.radius, fitting.branch_radius, fitting.fillet_radius, fitting.angle
    return wye_signed_distance(points, *sizes)


def _bore(from_axis: Array, radius: float) -> tuple[Array, Array]:
    """Distance and gradient of a round wall, for vectors (..., 3) m from the bore's axis."""
    away = np.linalg.norm(from_axis, axis=-1)
    return radius - away, -from_axis / np.where(away > 0, away, 1.0)[..., None]


def _section(pipe: Straight, points: Array) -> tuple[Array, Array]:
    """The nearest place of the section's edge by samples, refined by Newton's method.

    An oval's edge is that of its eccentric angle, another section's that of its normals.
    """
    section, across = pipe.shape, points[:, :2]
    assert section is not None
    places = section.points(np.linspace(0.0, 2 * np.pi, 3601)[:-1])
    near = np.array([np.linalg.norm(places - p, axis=1).argmin() for p in across])
    angle = near * 2 * np.pi / 3600
    for _ in range(30):
        # The normal at the foot leads to the point: turn by what is left of it.
        normal, place = section.outward(angle), section.points(angle)
        way = across - place
        aside = normal[:, 0] * way[:, 1] - normal[:, 1] * way[:, 0]
        along = (way * normal).sum(axis=1)
        angle = angle + aside / (section.curvature_radii(angle) + along)
    normal = section.outward(angle)
    distance = ((section.points(angle) - across) * normal).sum(axis=1)
    return distance, np.column_stack([-normal, np.zeros(len(normal))])


def _from_axis_circle(points: Array, mean_radius: float) -> Array:
    """Vectors (..., 3) m from the circle that is a bend's axis."""
    p = points - [mean_radius, 0, 0]
    flat = p * [1, 0, 1]
    return p - mean_radius * flat / np.linalg.norm(flat, axis=-1, keepdims=True)


def _reducer(cone: Reducer, points: Array) -> tuple[Array, Array]:
    """The cone between the port planes, so its edge where that is nearer than the rest."""
    x, y, z = np.moveaxis(points, -1, 0)
    from_axis, slope = np.hypot(x, y), cone.slope
    cosine = 1 / math.hypot(1.0, slope)
    outward = np.where((from_axis > 0)[..., None], points * [1, 1, 0], [1, 0, 0])
    outward = outward / np.where(from_axis > 0, from_axis, 1.0)[..., None]
    # In the half plane through the axis and the point the wall is a straight line.
    distance = cosine * (cone.radius + slope * z - from_axis)
    foot = z - slope * cosine * distance
    edge = np.clip(foot, 0.0, cone.length)
    across, along = from_axis - cone.radius - slope * edge, z - edge
    away = np.copysign(np.hypot(across, along), distance)
    safe = np.where(away == 0, 1.0, away)[..., None]
    on_cone = (foot == edge)[..., None]
    from_edge = (across[..., None] * outward + along[..., None] * np.array([0, 0, 1])) / safe
    gradient = np.where(on_cone, cosine * (slope * np.array([0, 0, 1]) - outward), from_edge)
    return np.where(foot == edge, distance, away), gradient


def _mitre(bend: Mitre, points: Array) -> tuple[Array, Array]:
    """The nearer of two half cylinders' feet that lie on their own side of the plane between them,
    else of the edge, which is sampled and then bisected."""
    rho, half = bend.radius + bend.fillet_radius, bend.angle / 2
    normal = np.array([math.sin(half), 0.0, math.cos(half)])
    along = np.array([math.cos(half), 0.0, -math.sin(half)])
    p = points - [0, 0, bend.leg_length]
    onward = np.array([math.sin(bend.angle), 0.0, math.cos(bend.angle)])
    best, gradient = np.full(len(p), np.inf), np.zeros(p.shape)
    for axis, side in ((np.array([0.0, 0.0, 1.0]), -1.0), (onward, 1.0)):
        across = p - np.outer(p @ axis, axis)
        away = np.linalg.norm(across, axis=-1)
        out = across / away[:, None]
        foot = p + (rho - away)[:, None] * out
        nearer = (side * (foot @ normal) >= 0) & (side * (p @ normal) >= 0) & (rho - away < best)
        best, gradient = (
            np.where(nearer, rho - away, best),
            np.where(nearer[:, None], -out, gradient),
        )
    u, v, a = np.abs(p @ along), np.abs(p[:, 1]), rho / math.cos(half)
    low, high = np.zeros(len(p)), np.full(len(p), np.pi / 2)
    for _ in range(_BISECTIONS):
        q = (low + high) / 2
        sin, cos = np.sin(q), np.cos(q)
        below = a * u * sin - rho * v * cos - (a * a - rho * rho) * sin * cos < 0
        low, high = np.where(below, q, low), np.where(below, high, q)
    q = (low + high) / 2
    edge = np.sign(p @ along)[:, None] * (a * np.cos(q))[:, None] * along
    edge[:, 1] = np.sign(p[:, 1]) * rho * np.sin(q)
    apart = p - edge
    away = np.linalg.norm(apart, axis=-1)
    on_edge = np.isinf(best)
    gradient = np.where(on_edge[:, None], apart / away[:, None], gradient)
    return np.where(on_edge, away, best) - bend.fillet_radius, gradient


def _coupling(joint: Coupling, points: Array) -> tuple[Array, Array]:
    """The nearest of the places, in each pipe's solid, that a point in the bore is brought to.

    The solids' bores are wider by the edges' radius, which the wall stands out from them.
    """
    edge = joint.edge_radius
    space = joint.gap + 2 * edge if joint.gap else 0.0
    collar, onward = (joint.length - space) / 2, np.array([0.0, 0.0, 1.0])
    leaning = np.array([math.sin(joint.angle), 0.0, math.cos(joint.angle)])
    first, second = np.array([0.0, 0.0, collar]), np.array([joint.offset, 0.0, collar + space])
    bores, feet = (joint.inner_diameter / 2 + edge, joint.end_diameter / 2 + edge), []
    for end, axis, bore, side in ((first, onward, bores[0], -1), (second, leaning, bores[1], 1)):
        along = (points - end) @ axis
        across = points - end - along[:, None] * axis
        away = np.linalg.norm(across, axis=1)
        out = across * (np.maximum(away, bore) / away)[:, None]
        feet.append(end + out + (side * np.maximum(side * along, 0.0))[:, None] * axis)
    if joint.gap:
        wide = max(joint.inner_diameter / 2, joint.offset + joint.end_diameter / 2) + joint.depth
        away = np.hypot(*points[:, :2].T)
        out = points * ((wide + edge) / away[:, None]) * [1, 1, 0] + points * [0, 0, 1]
        feet.append(np.where(((points - second) @ leaning < 0)[:, None], out, np.inf))
    apart = np.linalg.norm(points - np.array(feet), axis=-1)
    nearest = np.choose(apart.argmin(axis=0)[:, None], feet)
    away = apart.min(axis=0)
    return away - edge, (points - nearest) / away[:, None]


def _cross(fitting: Cross, points: Array) -> tuple[Array, Array]:
    """The nearest of both cylinders' feet that are in neither bore, and of both edges."""
    big, small = (
        fitting.radius + fitting.fillet_radius,
        fitting.branch_radius + fitting.fillet_radius,
    )
    run, branch = np.array([0.0, 0.0, 1.0]), fitting.branch_axis
    half_turn = np.array([-1.0, 1.0, -1.0])

    def from_axis(points: Array, axis: Array) -> Array:
        return points - (points @ axis)[:, None] * axis

    candidates = [nearest_on_edge(points, big, small, fitting.angle)]
    candidates.append(nearest_on_edge(points * half_turn, big, small, fitting.angle) * half_turn)
    for axis, radius in ((run, big), (branch, small)):
        across = from_axis(points, axis)
        away = np.linalg.norm(across, axis=-1, keepdims=True)
        candidates.append(points + across * (radius / away - 1))
    feet = np.stack(candidates)
    distance = np.linalg.norm(points - feet, axis=-1)
    for k, (axis, radius) in ((2, (branch, small)), (3, (run, big))):
        inside = np.linalg.norm(from_axis(feet[k], axis), axis=-1) < radius - 1e-12
        distance[k][inside] = np.inf
    best = distance.argmin(axis=0)
    rows = np.arange(len(points))
    away, nearest = distance[best, rows], feet[best, rows]
    return away - fitting.fillet_radius, (points - nearest) / away[:, None]


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


def edge_curve(q: Array, big: float, small: float, angle: float) -> Array:
    """Points (..., 3) m of the edge at angles ``q`` (...,) rad; ``big`` and ``small`` are A and B,
    m."""
    y, w = small * np.sin(q), small * np.cos(q)
    x = np.sqrt(big * big - small * small + w * w)
    return np.stack([x, y, (x * math.cos(angle) - w) / math.sin(angle)], axis=-1)
