"""Accuracy of contacts with exact walls: the least distance of a body against dense samples.

    python benchmarks/contact_accuracy.py [--poses 200] [--seed 1]

Prints, for each type of geom and each kind of wall, the largest error of the least distance in
random poses up to 0.5 mm off the wall, and pressed in by 0.1 mm from there, and the one that 99.9 %
of all poses of a geom stay below, in micrometres. The reference is the least distance of all points
of the body's surface from all walls, searched on from the nearest of dense samples, and that of the
circles at all ports from the body.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from shape import Arguments, table
from touching_geom import SHAPES, add_body

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Assembly, Part, Step, route

MARGIN, GAP, PRESSED = 0.004, 0.5e-3, 0.1e-3
"""Of the geom, m; largest distance of a pose from the wall, m; and depth, m, to which it is then
pressed."""
COARSE, STARTS, ROUNDS = 41, 8, 14
"""Samples along either side of a patch; samples from which the search goes on, and its rounds, each
of which halves the distance of the samples."""
Patch = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Maps numbers between 0 and 1 to points (..., 3) m of a part of a surface."""


def in_a_row(*steps: tuple[ot.Fitting, str, str]) -> Assembly:
    """Fittings one after the other: (fitting, enter, leave)."""
    return route([Step(f"part_{i}", *step) for i, step in enumerate(steps)]).network


def straights(*fittings: ot.Fitting) -> Assembly:
    """Fittings of two ports one after the other."""
    return in_a_row(*((fitting, "start", "end") for fitting in fittings))


def alone(fitting: ot.Fitting) -> Assembly:
    """One fitting at the origin."""
    return Assembly((Part("pipe", fitting, Pose()),))


NETWORKS = {
    "straight": (alone(ot.Straight(0.4)),),
    "elbow": (alone(ot.Elbow(0.24)), alone(ot.Elbow(0.09))),
    "tee": (alone(ot.Tee()),),
    "wye": (alone(ot.Wye(angle=math.radians(50))), alone(ot.Wye(branch_diameter=0.1))),
    "cross": (alone(ot.Cross()), alone(ot.Cross(angle=math.radians(50), branch_diameter=0.1))),
    "mitre": (alone(ot.Mitre()), alone(ot.Mitre(angle=math.radians(135)))),
    "reducer": (alone(ot.Reducer(0.15, end_diameter=0.12)),),
    "joints": (
        straights(ot.Straight(0.3), ot.Elbow(0.12), ot.Straight(0.3)),
        straights(ot.Elbow(0.12), ot.Elbow(0.12)),
        in_a_row((ot.Tee(), "run_start", "branch"), (ot.Elbow(0.12), "start", "end")),
    ),
    "reducer's joints": (
        straights(ot.Straight(0.3), ot.Reducer(0.2, end_diameter=0.12)),
        straights(
            ot.Straight(0.2),
            ot.Reducer(0.1, end_diameter=0.12),
            ot.Straight(0.2, inner_diameter=0.12),
        ),
        straights(
            ot.Reducer(0.1, end_diameter=0.12),
            ot.Elbow(0.12, inner_diameter=0.12),
        ),
    ),
    "open end": (alone(ot.Straight(0.4)), alone(ot.Elbow(0.24)), alone(ot.Reducer(0.15, 0.12))),
}


def balls(centre: list[float], half: list[float]) -> list[Patch]:
    """An ellipsoid's surface as the six sides of a cube, so that it has no pole."""

    def side(axis: int, sign: float) -> Patch:
        def at(u: np.ndarray, v: np.ndarray) -> np.ndarray:
            cube = np.stack([sign + 0 * u, 2 * u - 1, 2 * v - 1], axis=-1)
            ball = cube / np.linalg.norm(cube, axis=-1, keepdims=True)
            return np.roll(ball, axis, axis=-1) * half + centre

        return at

    return [side(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]


def patches(shape: str, size: list[float], triangles: np.ndarray) -> list[Patch]:
    """Parts of a geom's surface; ``triangles`` (n, 3, 3) m are those of a box or mesh."""
    a, b, c = size
    turn = 2 * np.pi

    def lathe(radius: Patch, height: Patch, scale: tuple[float, float, float]) -> Patch:
        return lambda u, v: (
            np.stack(
                [radius(u, v) * np.cos(turn * u), radius(u, v) * np.sin(turn * u), height(u, v)],
                axis=-1,
            )
            * scale
        )

    if shape in ("sphere", "ellipsoid"):
        return balls([0, 0, 0], [a, a, a] if shape == "sphere" else [a, b, c])
    mantle = lathe(lambda _, v: a + 0 * v, lambda _, v: b * (2 * v - 1), (1, 1, 1))
    ends = [(1, 1, 1), (1, 1, -1)]
    if shape == "capsule":
        return [mantle, *balls([0, 0, b], [a, a, a]), *balls([0, 0, -b], [a, a, a])]
    if shape in ("wheel", "roller"):
        return [mantle, *(lathe(lambda _, v: a * v, lambda _, v: b + 0 * v, end) for end in ends)]

    def triangle(corners: np.ndarray) -> Patch:
        # The square's side u = 0 is the triangle's first corner.
        return lambda u, v: (
            corners[0]
            + u[..., None] * ((1 - v[..., None]) * corners[1] + v[..., None] * corners[2])
            - u[..., None] * corners[0]
        )

    return [triangle(corners) for corners in triangles]


class Body:
    """A geom, whose surface is searched for its least distance from pipes."""

    def __init__(self, shape: str, size: list[float], vertices: np.ndarray) -> None:
        a, b, c = size
        if shape == "box":
            vertices = np.array([[x, y, z] for x in (-a, a) for y in (-b, b) for z in (-c, c)])
        self._shape, self._size = shape, size
        self._triangles = (
            vertices[ConvexHull(vertices).simplices] if shape in ("box", "mesh") else np.empty(0)
        )
        self._parts = parts = patches(shape, size, self._triangles)
        count = COARSE if len(parts) < 4 else 25 if len(parts) < 8 else 13
        steps = np.linspace(0, 1, count)
        across = np.linspace(0, 1, 4 * count - 3) if len(parts) < 4 else steps
        u, v = (grid.ravel() for grid in np.meshgrid(across, steps))
        self._places = np.stack([u, v], axis=-1)
        self._steps = np.array([across[1], steps[1]])
        self.points = np.concatenate([part(u, v) for part in parts])
        self.reach = float(np.linalg.norm(self.points, axis=1).max())

    def least(self, distance: Callable[[np.ndarray], np.ndarray]) -> tuple[float, np.ndarray]:
        """Least distance of points of the geom's frame, m, and the point (3,) that has it."""
        coarse, count = distance(self.points), len(self._places)
        best, where = np.inf, self.points[0]
        offsets = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 2), axis=-1).reshape(-1, 2)
        for start in np.argsort(coarse)[:STARTS]:
            part, place, width = self._parts[start // count], self._places[start % count], 1.0
            for _ in range(ROUNDS):
                places = np.clip(place + width * self._steps * offsets, 0, 1)
                points = part(places[:, 0], places[:, 1])
                values = distance(points)
                place, width = places[values.argmin()], width / 2
                if values.min() < best:
                    best, where = float(values.min()), points[values.argmin()]
        return best, where

    def from_circle(self, pose: Pose, radius: float) -> tuple[float, np.ndarray]:
        """Return the least distance, m, of a circle from the geom, and the place (3,) that has it.

        The circle lies about the z axis of a pose in the geom's frame.
        """
        angle, width = np.linspace(0, 2 * np.pi, 721), np.pi / 360
        while True:
            circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
            places = pose.apply(radius * circle)
            away = self.from_points(places)
            nearest = int(away.argmin())
            if width < 1e-7:
                return float(away[nearest]), places[nearest]
            angle, width = angle[nearest] + np.linspace(-width, width, 21), width / 5

    def from_points(self, points: np.ndarray) -> np.ndarray:
        """Distances (n,) m of points (n, 3) m outside."""
        a, b, _ = self._size
        if self._shape == "sphere":
            return np.linalg.norm(points, axis=1) - a
        if self._shape == "capsule":
            along = np.clip(points[:, 2], -b, b)
            return np.linalg.norm(points - np.outer(along, [0, 0, 1]), axis=1) - a
        if self._shape in ("wheel", "roller"):
            beside = np.hypot(points[:, 0], points[:, 1]) - a
            return np.hypot(np.maximum(beside, 0), np.maximum(np.abs(points[:, 2]) - b, 0))
        if self._shape == "box":
            return np.linalg.norm(np.maximum(np.abs(points) - self._size, 0), axis=1)
        if self._shape == "ellipsoid":
            return self._from_ellipsoid(points)
        return from_triangles(points, self._triangles)

    def _from_ellipsoid(self, points: np.ndarray) -> np.ndarray:
        """Distances from the foot p a² / (a² + t), whose t bisection finds."""
        squares = np.square(self._size)
        low, high = np.zeros(len(points)), np.full(len(points), 0.1)
        for _ in range(60):
            t = (low + high) / 2
            foot = points * squares / (squares + t[:, None])
            outside = (foot**2 / squares).sum(axis=1) > 1
            low, high = np.where(outside, t, low), np.where(outside, high, t)
        return np.linalg.norm(points - foot, axis=1)


def from_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Distances (n,) m of points (n, 3) from triangles (k, 3, 3)."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Outward: the origin is within.
    normal *= np.sign((normal * triangles[:, 0]).sum(axis=1, keepdims=True))
    best = np.full((len(points), len(triangles)), np.inf)
    height = np.einsum("nki,ki->nk", points[:, None] - triangles[:, 0], normal)
    within = np.ones_like(best, bool)
    for i in range(3):
        a, b = triangles[:, i], triangles[:, i - 2]
        edge, to = b - a, points[:, None] - a
        middle = triangles.mean(axis=1) - a
        inward = np.cross(normal, edge)
        inward *= np.sign((inward * middle).sum(axis=1, keepdims=True))
        within &= np.einsum("nki,ki->nk", to, inward) >= 0
        along = np.clip(np.einsum("nki,ki->nk", to, edge) / (edge**2).sum(axis=1), 0, 1)
        best = np.minimum(best, np.linalg.norm(to - along[..., None] * edge, axis=2))
    away = np.where(within, np.minimum(best, np.abs(height)), best).min(axis=1)
    return np.where((height < 0).all(axis=1), 0.0, away)


def from_walls(network: Assembly, points: np.ndarray) -> np.ndarray:
    """Return distances (n,) m of points (n, 3), world frame, from all walls between port planes.

    They are negative in the walls, and infinite beyond open ends.
    """
    away, inside = np.full(len(points), np.inf), np.zeros(len(points), bool)
    value = np.full(len(points), -np.inf)
    for part in network.parts:
        distance, gradient = part.signed_distance(points)
        # A part's wall ends at its port planes.
        there = part.extent(points - distance[:, None] * gradient) >= -1e-6
        away = np.where(there, np.minimum(away, np.abs(distance)), away)
        held = part.extent(points) >= -1e-9
        value, inside = np.where(held, np.maximum(value, distance), value), inside | held
    return np.where(inside & (value < 0), -away, away)


def turned(rng: np.random.Generator) -> np.ndarray:
    """A random rotation (3, 3)."""
    matrix, quaternion = np.empty(9), rng.normal(size=4)
    mujoco.mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)


def place_at(network: Assembly, column: str, number: int, rng: np.random.Generator) -> np.ndarray:
    """A point (3,) m of the bore near which a body is looked for."""
    joints = [network.parts[i].port(port) for (i, port), _ in network.joints]
    ends = [network.parts[i].port(port) for i, port in network.open_ends]
    if column == "open end" or (joints and number % 2):
        ports = ends if column == "open end" else joints
        port = ports[number // 2 % len(ports)]
        angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(0.0, 0.06)
        along = rng.uniform(-0.03, 0.03)
        return port.apply([radius * math.cos(angle), radius * math.sin(angle), along])
    part = network.parts[rng.integers(len(network.parts))]
    return part.pose.apply(rng.uniform(*part.fitting.bounds))


def min_distance(
    network: Assembly, body: Body, pose: Pose
) -> tuple[float, np.ndarray, tuple[int, str] | None]:
    """Return the least distance, m, of a body in a pose from walls and edges.

    Beside it are the place (3,) of the wall, world frame, and the port whose edge it is, if any.
    """
    least, where = body.least(lambda points: from_walls(network, pose.apply(points)))
    away, place, port = from_edges(network, body, pose)
    if away < least:
        return away, place, port
    nearest = pose.apply(where)
    return least, nearest - least * network.signed_distance(nearest)[1], None


def from_edges(
    network: Assembly, body: Body, pose: Pose
) -> tuple[float, np.ndarray, tuple[int, str] | None]:
    """Return the least distance, m, of a body from the circles at ports.

    Beside it are that circle's place (3,), world frame, and the port.
    """
    least, nearest, at = np.inf, pose.position, None
    for index, part in enumerate(network.parts):
        for name in part.fitting.ports:
            port, radius = part.port(name), part.fitting.port_radius(name)
            if np.linalg.norm(port.position - pose.position) < radius + body.reach + GAP:
                away, place = body.from_circle(pose.inverse() @ port, radius)
                if away < least:
                    least, nearest, at = away, pose.apply(place), (index, name)
    return least, nearest, at


def poses(
    network: Assembly, column: str, body: Body, count: int, rng: np.random.Generator
) -> Iterator[tuple[Pose, float]]:
    """Yield poses of a body up to ``GAP`` off the walls, then pressed in, with distances, m."""
    while count:
        pose = pose_near(network, column, body, count, rng)
        if pose is None:
            continue
        least, place, port = min_distance(network, body, pose)
        at_end = port in network.open_ends
        if not 1e-5 < least < GAP or at_end != (column == "open end"):
            continue
        towards = pose.rotation @ slope(body.from_points, pose.inverse().apply(place))
        # A body that touches the front of an open end from without is not asked for.
        if port in network.open_ends:
            end = network.parts[port[0]].port(port[1])
            if towards @ (place - end.position) < 0:
                continue
        count -= 1
        yield pose, least
        # As deep along the same normal: a body that is convex is not less deep than that anywhere.
        yield Pose(pose.rotation, pose.position + (least + PRESSED) * towards), -PRESSED


def slope(distance: Callable[[np.ndarray], np.ndarray], point: np.ndarray) -> np.ndarray:
    """Gradient (3,) of a distance at a point (3,), by differences."""
    steps = 1e-7 * np.concatenate([np.eye(3), -np.eye(3)])
    ahead, behind = distance(point + steps).reshape(2, 3)
    return (ahead - behind) / 2e-7


def pose_near(
    network: Assembly, column: str, body: Body, number: int, rng: np.random.Generator
) -> Pose | None:
    """Return a pose in which samples of a body's surface are up to about ``GAP`` off the walls.

    It is None where the search for it fails.
    """
    centre, rotation = place_at(network, column, number, rng), turned(rng)
    if from_walls(network, centre[None])[0] < 0:
        return None
    part = max(network.parts, key=lambda part: part.extent(centre[None])[0])
    outward = -part.signed_distance(centre[None])[1][0]
    wanted = rng.uniform(0.02e-3, GAP)
    for _ in range(12):
        pose = Pose(rotation, centre)
        least = from_walls(network, pose.apply(body.points)).min()
        least = min(least, from_edges(network, body, pose)[0])
        if abs(least - wanted) < 0.1e-3:
            return pose
        if least < -0.03:
            return None
        # Of an edge within a body the depth is not known.
        step = -0.5e-3 if least == 0 else np.clip(least - wanted, -0.02, 0.02)
        centre = centre + outward * step
    return None


def errors(column: str, shape: str, count: int, seed: int) -> np.ndarray:
    """Errors (n,) m of the least distance in random poses."""
    rows, networks = [], NETWORKS[column]
    for number, network in enumerate(networks):
        spec = mujoco.MjSpec()
        ot.add_pipes(spec, network)
        add_body(spec, shape).margin = MARGIN
        model = spec.compile()
        data, geom = mujoco.MjData(model), model.ngeom - 1
        body = Body(shape, list(model.geom_size[geom]), model.mesh_vert.astype(float))
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
        # MuJoCo turns a mesh into its principal axes: the geom is what is placed.
        own = Pose(matrix.reshape(3, 3), model.geom_pos[geom]).inverse()
        rng = np.random.default_rng([seed, number, len(column), *shape.encode()])
        for pose, least in poses(network, column, body, -(-count // len(networks)), rng):
            placed = pose @ own
            data.qpos[:] = *placed.position, *placed.quaternion
            mujoco.mj_forward(model, data)
            rows.append(data.contact.dist.min(initial=MARGIN) - least)
    return np.array(rows)


NEGLIGIBLE = "< 0.01"
"""Text of an error below the rounding of the reference."""


def micrometres(error: float) -> str:
    """Return an error, m, as text."""
    return f"{1e6 * error:.2g}" if error >= 1e-8 else NEGLIGIBLE


def row(shape: str, count: int, seed: int) -> list[str]:
    """Return the errors of a geom at all walls."""
    found = {column: np.abs(errors(column, shape, count, seed)) for column in NETWORKS}
    where = max(found, key=lambda column: found[column].max())
    largest = micrometres(found[where].max())
    most = micrometres(np.quantile(np.concatenate([*found.values()]), 0.999))
    return [shape, largest, "anywhere" if largest == NEGLIGIBLE else where, most]


def main() -> None:
    """Measure and print the table."""
    given = Arguments(__doc__, trials=200, of="poses", seed=1).read()
    text = "Largest error, um, where, and the one that 99.9 % of all poses keep:"
    rows = (row(shape, given.poses, given.seed) for shape in SHAPES)
    table("accuracy", ("geom", "largest", "where", "99.9 %"), rows, text)


if __name__ == "__main__":
    main()
