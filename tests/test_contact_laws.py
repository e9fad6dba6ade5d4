"""Contacts of bodies with every fitting: each is exact, none is missed, none is there twice."""

from __future__ import annotations

import itertools
import math

import contact_lots
import mujoco
import numpy as np
import pytest
from reference_surfaces import signed_distance
from scipy.spatial import ConvexHull

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, frame_along, matrix_from_quaternion, unit
from omnitrack_sim.pipes import (
    Assembly,
    Cross,
    Elbow,
    Mitre,
    Part,
    Reducer,
    Straight,
    Tee,
    Wye,
)
from omnitrack_sim.pipes.native import SIGNATURES, c_function, pointers
from omnitrack_sim.walls.deepest import _across_ellipsoid, is_in_ball
from omnitrack_sim.walls.rims import ELLIPSOID

FITTINGS = {
    "straight": Straight(0.4),
    "elbow": Elbow(0.24),
    "tight elbow": Elbow(0.09),
    "reducer": Reducer(0.15, 0.12),
    "tee": Tee(),
    "wye": Wye(angle=math.radians(50)),
    "narrow wye": Wye(branch_diameter=0.1),
    "cross": Cross(),
    "narrow cross": Cross(angle=math.radians(50), branch_diameter=0.1),
    "mitre": Mitre(),
    "flat mitre": Mitre(angle=math.radians(40)),
}
LOTS = [
    ("mitre", "ellipsoid", 1),
    ("mitre", "tyre", 1),
    ("wye", "wheel", 6),
    ("sharp wye", "wheel", 8),
    ("tee", "roller", 11),
]
"""Fittings, geoms and seeds of poses in which slopes alone lead to a minimum that is not the least
one."""
MARGIN = 0.003  # m, up to which contacts count
SAME = 0.004  # m, places nearer to each other count as one: 5 % of the largest body and 1 mm
SLACK = 2e-5  # m, by which a sample of an edge may lie higher than the minimum beside it
_POINTS = unit(np.random.default_rng(5).normal(size=(16, 3))) * [0.03, 0.02, 0.025]
_HULL = ConvexHull(_POINTS)
_CORNERS = np.array(list(itertools.product((-0.03, 0.03), (-0.02, 0.02), (-0.01, 0.01))))
SHAPES = {
    "sphere": [0.025, 0, 0],
    "capsule": [0.015, 0.04, 0],
    "wheel": [0.03, 0.01, 0],
    "roller": [0.012, 0.04, 0],
    "ellipsoid": [0.035, 0.02, 0.012],
    "box": [0.03, 0.02, 0.01],
    "mesh": None,
}
PLACE = Pose(frame_along([1, 2, -1], 0.7), np.array([0.3, -0.2, 0.5]))
"""Where the fittings stand; all else here is in their frame."""
KINDS = {"wheel": "CYLINDER", "roller": "CYLINDER"}


def between(a, b):
    """Points (k, 3) along a line from a to b (3,), 0.4 mm apart."""
    t = np.linspace(0, 1, max(3, math.ceil(np.linalg.norm(b - a) / 4e-4)))[:, None]
    return a + t * (b - a)


def hull_edges(points, hull):
    """Pairs (k, 2) of the numbers of vertices at the ends of a hull's edges: where it turns."""
    owners = {}
    for triangle, normal in zip(hull.simplices, hull.equations[:, :3], strict=True):
        for pair in itertools.combinations(sorted(triangle), 2):
            owners.setdefault(pair, []).append(normal)
    return [pair for pair, (one, other) in owners.items() if one @ other < 1 - 1e-9]


def lines_of(shape):
    """Curves (k, 3) m of a geom at whose minima of the distance it touches, whether each closes,
    and radius of the ball about them."""
    size = SHAPES[shape]
    if shape == "sphere":
        return [(np.zeros((1, 3)), False)], size[0]
    if shape == "capsule":
        end = np.array([0, 0, size[1]])
        return [(between(-end, end), False)], size[0]
    if shape in ("wheel", "roller"):
        angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
        ring = [size[0] * np.cos(angle), size[0] * np.sin(angle), 0 * angle + size[1]]
        return [(np.transpose(ring) * [1, 1, side], True) for side in (1, -1)], 0.0
    if shape == "ellipsoid":
        return [], 0.0
    points, hull = (_CORNERS, ConvexHull(_CORNERS)) if shape == "box" else (_POINTS, _HULL)
    return [(between(points[i], points[j]), False) for i, j in hull_edges(points, hull)], 0.0


def smooth_of(shape):
    """Patch of a geom on which it may touch away from its edges: places (k, 2) all over it, and
    what makes points (..., 3) m of them."""
    size = np.array(SHAPES[shape])
    if shape == "ellipsoid":
        places = np.stack(np.meshgrid(np.linspace(0, 2 * np.pi, 40), np.linspace(0, np.pi, 20)), -1)

        def on_ball(place):
            u, v = place[..., 0], place[..., 1]
            return np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], -1) * size

        return places.reshape(-1, 2), on_ball
    places = np.stack(np.meshgrid(np.linspace(0, 2 * np.pi, 48), np.linspace(-1, 1, 17)), -1)

    def on_mantle(place):
        u, v = place[..., 0], np.clip(place[..., 1], -1, 1)
        return np.stack([size[0] * np.cos(u), size[0] * np.sin(u), size[1] * v], -1)

    return places.reshape(-1, 2), on_mantle


def model_in(fitting):
    """Model of a free body of each shape in one fitting, which do not touch each other."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="stone", uservert=_POINTS.ravel())
    ot.add_pipes(spec, Assembly((Part("pipe", fitting, PLACE),)))
    for shape, size in SHAPES.items():
        body = spec.worldbody.add_body(name=shape)
        body.add_freejoint()
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{KINDS.get(shape, shape.upper())}")
        own = {"meshname": "stone"} if size is None else {"size": size}
        body.add_geom(name=shape, type=kind, contype=1, conaffinity=0, margin=MARGIN, **own)
    return spec.compile()


def samples_of(shape):
    """Points (k, 3) m all over a geom's surface, fine enough to place it."""
    lines, reach = lines_of(shape)
    points = np.concatenate([line[::4] for line, _ in lines] or [np.empty((0, 3))])
    if shape in ("wheel", "roller", "ellipsoid"):
        places, at = smooth_of(shape)
        points = np.concatenate([points, at(places)])
    return points, reach


def poses(fitting, shape, count, rng):
    """Positions (n, 3) m and rotations (n, 3, 3) of a body between 1 mm in the wall and 1 mm off
    it, away from the ports."""
    points, reach = samples_of(shape)
    radius = np.linalg.norm(points, axis=1).max() + reach
    low, high = fitting.bounds
    centre = rng.uniform(low, high, (20 * count, 3))
    centre = centre[fitting.signed_distance(centre)[0] > 0.0][: 4 * count]
    rotation = matrix_from_quaternion(unit4(rng.normal(size=(len(centre), 4))))
    gap = rng.uniform(-1e-3, 1e-3, len(centre))
    for _ in range(8):
        least = least_distance(fitting, points, centre, rotation) - reach
        gradient = fitting.signed_distance(centre)[1]
        centre = centre - gradient * np.clip(least - gap, -0.02, 0.02)[:, None]
    least = least_distance(fitting, points, centre, rotation) - reach
    good = (np.abs(least) < 1.2e-3) & (fitting.extent(centre) > radius + 0.002)
    good &= fitting.signed_distance(centre)[0] > 0.0
    return centre[good][:count], rotation[good][:count]


def unit4(quaternion):
    """Quaternions (..., 4) of length 1."""
    return quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)


def placed(points, centre, rotation):
    """Points (n, k, 3) of a body's frame, world frame."""
    return np.einsum("nij,kj->nki", rotation, points) + centre[:, None]


def distances(fitting, points):
    """Distances (...,) m of points (..., 3)."""
    return fitting.signed_distance(points.reshape(-1, 3))[0].reshape(points.shape[:-1])


def least_distance(fitting, points, centre, rotation):
    """Least distances (n,) m of a body's points from the wall."""
    return distances(fitting, placed(points, centre, rotation)).min(axis=1)


def contacts_of(model, data, shape, centre, rotation):
    """Depths (k,), normals and points (k, 3) on the body of its contacts with the wall."""
    address = model.jnt_qposadr[model.body(shape).jntadr[0]]
    turned = (PLACE.rotation @ rotation).ravel()
    mujoco.mju_mat2Quat(data.qpos[address + 3 : address + 7], turned)
    data.qpos[address : address + 3] = PLACE.apply(centre)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    pair = [model.geom("wall_pipe").id, model.geom(shape).id]
    own = [one for one in data.contact if one.geom.tolist() == pair]
    depth = np.array([one.dist for one in own])
    normal = np.array([one.frame[:3] for one in own]).reshape(-1, 3) @ PLACE.rotation
    place = PLACE.inverse().apply(np.array([one.pos for one in own]).reshape(-1, 3))
    return depth, normal, place + normal * depth[:, None] / 2


def minima_along(along, closes):
    """Numbers of the samples of a curve at its minima, and at its ends where it does not close."""
    if closes:
        return np.flatnonzero((along < np.roll(along, 1)) & (along <= np.roll(along, -1)))
    inner = np.flatnonzero((along[1:-1] < along[:-2]) & (along[1:-1] <= along[2:])) + 1
    return np.unique([*inner, 0, len(along) - 1])


def smooth_minima(fitting, shape, centre, rotation):
    """Points (k, 3) m, world frame, of minima of the distance on a smooth surface."""
    places, at = smooth_of(shape)
    d = distances(fitting, at(places) @ rotation.T + centre)
    best = places[np.argsort(d)[:24]]
    step = np.full(len(best), 0.15)
    moves = np.array([(np.cos(a), np.sin(a)) for a in np.arange(8) * np.pi / 4])
    now = distances(fitting, at(best) @ rotation.T + centre)
    for _ in range(45):
        tried = best[:, None] + step[:, None, None] * moves
        if shape != "ellipsoid":
            tried[..., 1] = np.clip(tried[..., 1], -1, 1)
        there = distances(fitting, at(tried) @ rotation.T + centre)
        rows, k = np.arange(len(best)), there.argmin(axis=1)
        lower = there[rows, k] < now
        best = np.where(lower[:, None], tried[rows, k], best)
        now, step = np.where(lower, there[rows, k], now), np.where(lower, step * 1.3, step / 2)
    on_edge = (shape != "ellipsoid") & (np.abs(best[:, 1]) > 0.999)
    done = (now < MARGIN - 1e-4) & (step < 1e-3) & ~on_edge
    return at(best[done]) @ rotation.T + centre, now[done]


def expected(fitting, shape, centre, rotation):
    """Points (k, 3) m on or in a body at which it touches, and their depths (k,) m."""
    found, depths = [np.empty((0, 3))], [np.empty(0)]
    lines, reach = lines_of(shape)
    for line, closes in lines:
        points = line @ rotation.T + centre
        along = distances(fitting, points)
        at = minima_along(along, closes)
        at = at[along[at] - reach < MARGIN - 1e-4]
        found.append(points[at])
        depths.append(along[at] - reach)
    if shape in ("wheel", "roller", "ellipsoid"):
        points, d = smooth_minima(fitting, shape, centre, rotation)
        found.append(points)
        depths.append(d)
    return deepest_of(np.concatenate(found), np.concatenate(depths))


def deepest_of(points, depths):
    """Of points (n, 3) nearer to each other than ``SAME`` the deepest, and its depth."""
    kept = []
    for i in np.argsort(depths):
        if all(np.linalg.norm(points[i] - points[k]) > SAME for k in kept):
            kept.append(i)
    return points[kept], depths[kept]


def on_surface(shape, points):
    """Distances (k,) m of points (k, 3) from what of a body can touch: a ball's centre, a capsule's
    axis, a cylinder's mantle, an ellipsoid's surface, and edges."""
    size = SHAPES[shape]
    if shape in ("wheel", "roller"):
        beyond = np.maximum(np.abs(points[:, 2]) - size[1], 0.0)
        return np.hypot(np.linalg.norm(points[:, :2], axis=1) - size[0], beyond)
    if shape == "ellipsoid":
        return np.abs(np.linalg.norm(points / size, axis=1) - 1) * min(size)
    ends = [(line[0], line[-1]) for line, _ in lines_of(shape)[0]]
    apart = []
    for a, b in ends:
        t = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-12), 0, 1)
        apart.append(np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return np.min(apart, axis=0)


def outward(shape, points):
    """Unit normals (k, 3) of the smooth surface of an ellipsoid or of a cylinder's mantle."""
    size = SHAPES[shape]
    return unit(points / np.square(size) if shape == "ellipsoid" else points * [1, 1, 0])


class Count:
    """Contacts that were expected, found, missed, and found where none was expected."""

    def __init__(self):
        self.poses = self.expected = self.found = self.missed = self.extra = self.doubled = 0

    def add(self, found, depth, points, depths):
        """Match contacts, points (k, 3) on the body and depths, with those expected."""
        apart = np.linalg.norm(points[:, None] - found, axis=2)
        matched = (apart < SAME) & (depth < depths[:, None] + SLACK)
        # Of one that hardly counts the sample beside it may be out of the margin.
        near = (apart < SAME).any(axis=0) | (depth > MARGIN - 2e-4)
        self.poses += 1
        self.expected += len(points)
        self.found += len(found)
        self.missed += int((~matched.any(axis=1)).sum())
        self.extra += int((~near).sum())


@pytest.mark.parametrize("name", FITTINGS)
def test_contacts_are_exact_and_none_is_missed(name):
    """In poses by lot every contact has the depth and normal of an independent distance, lies on
    the body's surface, where that faces the wall, and apart from the others; and each minimum of
    the distance over the body is a contact, but for 2 % that lie beside another one (0.15 %
    of 28,000 in other poses)."""
    fitting = FITTINGS[name]
    model, count = model_in(fitting), Count()
    data, rng = mujoco.MjData(model), np.random.default_rng(list(FITTINGS).index(name))
    for shape in SHAPES:
        reach, bound = lines_of(shape)[1], model.geom_rbound[model.geom(shape).id]
        centres, rotations = poses(fitting, shape, 12, rng)
        assert len(centres) > 3
        for centre, rotation in zip(centres, rotations, strict=True):
            depth, normal, touching = contacts_of(model, data, shape, centre, rotation)
            distance, gradient = signed_distance(fitting, touching)
            np.testing.assert_allclose(depth, distance, atol=1e-9)
            np.testing.assert_allclose(normal, gradient, atol=1e-6)
            found = touching + reach * normal
            own = (found - centre) @ rotation
            assert on_surface(shape, own).max(initial=0.0) < 1e-6
            if shape in ("wheel", "roller", "ellipsoid"):
                inner = np.abs(own[:, 2]) < (SHAPES[shape][1] - 1e-6 if shape in KINDS else 1)
                faces = -normal[inner] @ rotation
                assert np.abs(faces - outward(shape, own[inner])).max(initial=0.0) < 0.01
            places = touching - normal * depth[:, None] / 2
            for one, other in itertools.combinations(places, 2):
                near = 0.999 * min(0.04 * fitting.radius, 0.05 * bound)
                count.doubled += np.linalg.norm(one - other) < near
            points, depths = expected(fitting, shape, centre, rotation)
            inside = fitting.extent(points) > 1e-3
            count.add(found, depth, points[inside], depths[inside])
    assert count.missed <= 0.02 * count.expected
    assert count.extra <= 0.06 * count.found
    # One that gives way to a deeper one beside it may have come near to a third.
    assert count.doubled <= 0.005 * count.found + 1
    # Bodies that just touch have a contact, now and then two.
    assert count.found > 1.05 * count.poses


@pytest.mark.parametrize(("name", "shape", "seed"), LOTS)
def test_no_point_of_a_body_is_deeper_than_its_deepest_contact(name, shape, seed):
    """Beside rims and corners, where the distance has several minima over a body, contacts tell the
    least one within 0.02 mm of that which branch and bound finds."""
    lot = contact_lots.Lot(contact_lots.FITTINGS[name], shape)
    errors = lot.errors(250, np.random.default_rng([seed]))
    assert errors.max() < 2e-5


@pytest.mark.parametrize("name", contact_lots.FITTINGS)
def test_a_ray_meets_no_wall_where_it_is_clear(name):
    """Along lines in any direction, along the axes, and along the plane that halves a mitre; up to
    the port planes."""
    fitting, rng = contact_lots.FITTINGS[name], np.random.default_rng(1)
    sizes = np.array(fitting.wall_sizes, float)
    clear = c_function(fitting.wall.clear, SIGNATURES["clear"]).ctypes
    points = rng.uniform(*fitting.bounds, (300, 3))
    points = points[fitting.signed_distance(points)[0] > 1e-4]
    special = [*np.eye(3), *-np.eye(3)]
    if isinstance(fitting, Mitre):
        special += [side * np.array([sizes[4], 0.0, -sizes[3]]) for side in (1, -1)]
    for point in points:
        for way in (*unit(rng.normal(size=(2, 3))), *special):
            far = clear(*pointers(sizes), *point.tolist(), *way.tolist())
            assert far >= 0.0
            places = point + np.linspace(0.0, min(far, 2.0), 40)[:, None] * way
            inside = fitting.extent(places) > 0.0
            assert (fitting.signed_distance(places)[0][inside] > -1e-9).all()


def test_a_point_in_a_ball_of_the_bore_is_as_far_from_the_wall_as_from_the_balls_surface():
    """So a point that is told to be farther than a target from a wall is."""
    rng, middle, away = np.random.default_rng(2), np.array([0.02, -0.01, 0.3]), 0.05
    points = middle + rng.uniform(-0.06, 0.06, (2000, 3))
    depth = away - np.linalg.norm(points - middle, axis=1)
    for target in (-0.01, 0.0, 0.02):
        told = [is_in_ball((*middle, away), *point, target) for point in points.tolist()]
        assert told == (depth >= target).tolist()
        assert 10 < sum(told) < 1500
    assert not is_in_ball((*middle, away), *middle, 0.06)


def test_bounds_of_ellipsoids_are_reached_but_for_the_square_of_a_cell():
    """No point of an ellipsoid within a chord of a direction is farther from a ball's middle than
    the bound, and the bound exceeds the farthest by the second order of the chord at most: so the
    search ends after few cells."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        sizes, middle = rng.uniform(0.005, 0.08, 3), rng.uniform(-0.3, 0.3, 3)
        towards = unit(rng.normal(size=3))
        for chord in (0.02, 0.1, 0.5, 2.0):
            aside = np.cross(towards, rng.normal(size=(2000, 3)))
            aside /= np.linalg.norm(aside, axis=1)[:, None]
            angle = 2 * np.arcsin(chord / 2 * np.sqrt(rng.random((2000, 1))))
            angle[:1000] = 2 * math.asin(chord / 2)  # most are farthest at the border
            points = sizes * (np.cos(angle) * towards + np.sin(angle) * aside)
            farthest = ((points - middle) ** 2).sum(axis=1).max()
            body, ball = (ELLIPSOID, *sizes), (*middle, 0.1)
            slack = _across_ellipsoid(body, ball, tuple(towards), chord) - farthest
            far = sizes.max() + np.linalg.norm(middle)
            assert -1e-12 < slack < chord**2 * sizes.max() * far


def test_a_brick_touches_a_dent_alike_as_a_box_and_as_a_mesh():
    """Which bulges into the bore: often in the midst of a face, which a mesh has of triangles."""
    half = np.array([0.04, 0.02, 0.01])
    dent = {"kind": "dent", "at": 0.2, "depth": 0.015, "length": 0.08, "width": 0.06}
    pipe = Assembly((Part("pipe", Straight(0.4, relief=(dent,)), Pose()),))
    runs = []
    for kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH):
        spec = mujoco.MjSpec()
        corners = np.array(list(itertools.product((-1, 1), repeat=3))) * half
        spec.add_mesh(name="brick", uservert=corners.ravel())
        ot.add_pipes(spec, pipe)
        body = spec.worldbody.add_body()
        body.add_freejoint()
        own = {"size": half} if kind == mujoco.mjtGeom.mjGEOM_BOX else {"meshname": "brick"}
        body.add_geom(type=kind, margin=0.004, **own)
        model = spec.compile()
        runs.append((model, mujoco.MjData(model)))

    def deepest(model, data):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        i = np.argmin(data.contact.dist) if data.ncon else -1
        return (data.contact.dist[i], data.contact.pos[i]) if data.ncon else (0.004, None)

    rng, inside = np.random.default_rng(3), 0
    for _ in range(40):
        place = np.array([0.03, 0.0, 0.2]) + rng.uniform(-0.012, 0.012, 3)
        _, (away,) = pipe.parts[0].fitting.signed_distance(place[None])
        frame = frame_along(away + rng.normal(0.0, 0.1, 3), rng.uniform(0.0, 6.0))
        found = []
        for model, data in runs:
            mujoco.mju_mat2Quat(data.qpos[3:], frame.ravel())
            for _ in range(40 if not found else 1):  # towards the wall, until the box touches it
                data.qpos[:3] = place
                depth, point = deepest(model, data)
                if abs(depth) < 1e-4 or found:
                    break
                place = place - away * np.clip(depth, -0.003, 0.003)
            found.append((depth, point))
        (depth, point), (other, _) = found
        assert abs(depth) < 1e-3
        assert other == pytest.approx(depth, abs=1e-6)
        inside += (np.abs((point - place) @ frame) < half - 0.002).sum() == 2
    assert inside > 10


def edge_contacts(model, data, shape):
    """Least distances of a body from the circle of radius 80 mm at z = 0.4 m, where they are least:
    (depth, normal, place) by MuJoCo's own distance of geoms."""
    probe, geom, ends = model.geom("probe").id, model.geom(shape).id, np.empty(6)

    def gap(angle):
        data.mocap_pos[0] = [0.08 * math.cos(angle), 0.08 * math.sin(angle), 0.4]
        mujoco.mj_kinematics(model, data)
        return mujoco.mj_geomDistance(model, data, probe, geom, 0.2, ends) + PROBE

    step = 2 * np.pi / 400
    gaps = np.array([gap(i * step) for i in range(400)])
    for i in np.flatnonzero((gaps < np.roll(gaps, 1)) & (gaps <= np.roll(gaps, -1))):
        low, high = (i - 1) * step, (i + 1) * step
        for _ in range(24):
            a, b = low + 0.382 * (high - low), low + 0.618 * (high - low)
            low, high = (low, b) if gap(a) < gap(b) else (a, high)
        depth, on_body = gap((low + high) / 2), ends[3:].copy()
        edge = data.mocap_pos[0].copy()
        yield depth, unit(on_body - edge), (edge + on_body) / 2


PROBE = 1e-6


@pytest.mark.parametrize("shape", SHAPES)
def test_an_open_end_touches_where_it_is_nearest(shape):
    """A body beside the end of a pipe touches the edge at each place that is nearest to it, along
    the line between both, if that leads neither into the bore nor along the outside."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="stone", uservert=_POINTS.ravel())
    ot.add_pipes(spec, Assembly((Part("pipe", Straight(0.4), Pose()),)))
    body = spec.worldbody.add_body()
    body.add_freejoint()
    size = SHAPES[shape]
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{KINDS.get(shape, shape.upper())}")
    own = {"meshname": "stone"} if size is None else {"size": size}
    body.add_geom(name=shape, type=kind, margin=MARGIN, **own)
    probe = spec.worldbody.add_body(mocap=True)
    probe.add_geom(name="probe", size=[PROBE, 0, 0], contype=0, conaffinity=0)
    model = spec.compile()
    data, rng, seen = mujoco.MjData(model), np.random.default_rng(8), 0
    for _ in range(24):
        angle, out = rng.uniform(-np.pi, np.pi), rng.uniform(0.05, 0.1)
        data.qpos[:3] = [out * math.cos(angle), out * math.sin(angle), rng.uniform(0.39, 0.45)]
        data.qpos[3:] = unit4(rng.normal(size=4))
        # Off the edge by up to the margin.
        depth, normal, _ = min(edge_contacts(model, data, shape), key=lambda one: one[0])
        data.qpos[:3] += (rng.uniform(2e-4, MARGIN) - depth) * normal
        nearest = list(edge_contacts(model, data, shape))
        mujoco.mj_collision(model, data)
        found = [
            (one.dist, one.frame[:3].copy(), one.pos.copy())
            for one in data.contact
            if model.geom(one.geom[0]).name == "rim_pipe_end"
        ]
        for depth, normal, place in nearest:
            # Into the bore the wall of the pipe is nearer, outside there is no wall.
            inward = -normal[:2] @ unit2(place[:2])
            if not 1e-4 < depth < MARGIN - 1e-4 or inward < 0.02 or normal[2] < 0.02:
                continue
            near = [one for one in found if np.linalg.norm(one[2] - place) < 1e-3]
            assert len(near) == 1
            assert near[0][0] == pytest.approx(depth, abs=1e-5)
            assert near[0][1] @ normal > 1 - 1e-3
            assert np.linalg.norm(near[0][2] - place) < 3e-4
            seen += 1
        assert sum(one[0] > 1e-4 for one in found) <= len(nearest)
    assert seen >= 4


def test_the_last_digits_do_not_decide_whether_an_edge_touches():
    """A roller deep at the narrow end of a cone, whose way out gets shorter up to the wall's
    normal, touches the wall alone, wherever rounding puts it."""
    spec, cone, pipe = mujoco.MjSpec(), Reducer(0.1, 0.12), Straight(0.3, inner_diameter=0.12)
    end = cone.ports["end"]
    parts = Part("cone", cone, Pose()), Part("pipe", pipe, Pose(end.rotation, end.position))
    ot.add_pipes(spec, Assembly(parts, (((0, "end"), (1, "start")),)))
    body = spec.worldbody.add_body()
    body.add_freejoint()
    kind = mujoco.mjtGeom.mjGEOM_CYLINDER
    body.add_geom(type=kind, size=SHAPES["roller"], margin=MARGIN)
    model = spec.compile()
    data, rng, found = mujoco.MjData(model), np.random.default_rng(1), []
    turn = np.array(
        [
            [-0.9872857980, -0.1143548260, -0.1104070960],
            [-0.1532471048, 0.5002992191, 0.8521830885],
            [-0.0422146649, 0.8582678283, -0.5114628597],
        ]
    )
    mujoco.mju_mat2Quat(data.qpos[3:], turn.ravel())
    place = np.array([0.0148807158, 0.0183304288, 0.1143133984])
    for _ in range(50):
        data.qpos[:3] = place + rng.normal(0, 1e-9, 3)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found.append([model.geom(one.geom[0]).name for one in data.contact if one.dist < 0])
    assert found == [["wall_pipe"]] * 50


def unit2(vector):
    """A vector (2,) of length 1."""
    return vector / np.linalg.norm(vector)
