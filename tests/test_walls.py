"""Collision walls against the exact inner surface, by casting rays from inside the bore."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
import pytest

from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.pipes import Assembly, Elbow, Part, Reducer, Step, Straight, Tee, route
from omnitrack_sim.pipes.shapes import stave_count
from omnitrack_sim.robots.kinds import robot_class
from omnitrack_sim.walls.geoms import add_walls, new_spec

FITTINGS = {
    "straight": Straight(0.4),
    "reducer": Reducer(0.1, 0.15),
    "reducer_widening": Reducer(0.1, 0.16, 0.15),
    "reducer_steep": Reducer(0.12, 0.08),
    "elbow_1.5d": Elbow(0.24),
    "elbow_90mm": Elbow(0.09),
    "tee": Tee(),
}
RAYS = 4000
END_MARGIN = (
    1e-3  # m, rays that leave this close to a port plane may slip past the ends of the pieces
)


@lru_cache
def cast(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cast length (n,) or -1, exact distance of the hit (n,), the hit (n, 3), of rays that end in
    the wall."""
    fitting = FITTINGS[name]
    spec = new_spec(name)
    add_walls(spec, Assembly((Part("pipe", fitting, Pose()),)))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.1, -0.1, -0.2], [0.3, 0.1, 0.4], (60 * RAYS, 3))
    points = points[
        (fitting.signed_distance(points)[0] > 1e-3) & (fitting.extent(points) > END_MARGIN)
    ][:RAYS]
    rays = unit(rng.normal(size=points.shape))
    exact = np.zeros(len(points))
    for _ in range(300):
        exact += np.maximum(fitting.signed_distance(points + rays * exact[:, None])[0], 0)
    ends_in_wall = fitting.extent(points + rays * exact[:, None]) > END_MARGIN
    points, rays = points[ends_in_wall], rays[ends_in_wall]
    geom = np.zeros(1, np.int32)
    length = np.array(
        [
            mujoco.mj_ray(model, data, p, v, None, 1, -1, geom)
            for p, v in zip(points, rays, strict=True)
        ]
    )
    hits = points + rays * length[:, None]
    return length, fitting.signed_distance(hits)[0], hits


@pytest.mark.parametrize("name", FITTINGS)
def test_no_leak(name):
    """Every ray that ends in the wall of the exact pipe hits a piece of the wall."""
    length, _, _ = cast(name)
    assert len(length) > RAYS / 2
    assert (length >= 0).all()


@pytest.mark.parametrize("name", [name for name in FITTINGS if name != "tee"])
def test_wall_error(name):
    """Rays meet the walls of straights, reducers and elbows within 0.1 mm of the exact surface."""
    assert np.abs(cast(name)[1]).max() <= 1e-4


def test_tee_wall_error():
    """Rays meet a tee's wall within 0.5 mm of the exact surface by the rim, and 0.1 mm farther
    away."""
    _, error, hits = cast("tee")
    tee = FITTINGS["tee"]
    rho = tee.radius + tee.fillet_radius
    t = np.linspace(-np.pi / 2, np.pi / 2, 400)
    edge = rho * np.concatenate(
        [np.stack([np.cos(t), np.sin(t), sign * np.cos(t)], -1) for sign in (1, -1)]
    )
    from_rim = np.array([np.linalg.norm(edge - p, axis=1).min() for p in hits]) - tee.fillet_radius
    near = from_rim < 0.010
    assert near.sum() > 100
    assert np.abs(error[near]).max() <= 5e-4
    assert np.abs(error[~near]).max() <= 1e-4


def test_no_leak_where_reducers_are_joined():
    """Around every joint of a chain with two cones, rays from the axis meet the wall where it
    should be."""
    narrow = Reducer(0.05, 0.14)
    steps = [
        Step("a", Straight(0.1), "start", "end"),
        Step("b", narrow, "start", "end"),
        Step("c", Straight(0.1, 0.14), "start", "end"),
        Step("d", narrow, "end", "start"),
        Step("e", Straight(0.1), "start", "end"),
    ]
    way = route(steps)
    spec = new_spec("joined")
    add_walls(spec, way.network)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, np.int32)
    rng = np.random.default_rng(3)
    s = np.concatenate([joint + rng.uniform(-0.01, 0.01, 600) for joint in (0.1, 0.15, 0.25, 0.3)])
    around, along = rng.uniform(0, 2 * np.pi, len(s)), rng.uniform(-1, 1, len(s))
    rays = unit(np.stack([np.cos(around), np.sin(around), along], axis=-1))
    ends, radii = [0.0, 0.1, 0.15, 0.25, 0.3, 0.4], [0.08, 0.08, 0.07, 0.07, 0.08, 0.08]  # m
    error = []
    for point, ray in zip(way.centreline.at(s)[0], rays, strict=True):
        length = mujoco.mj_ray(model, data, point, ray, None, 1, -1, geom)
        assert length > 0
        hit = point + length * ray
        error.append(np.hypot(hit[0], hit[1]) - np.interp(hit[2], ends, radii))
    assert np.abs(error).max() <= 1.1e-4  # radially; the tolerance is across the cone


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_stave_count_is_the_least(tolerance):
    """The count of staves meets the tolerance, and four fewer would not."""

    def error(n: int) -> float:
        return 0.08 * (1 / np.cos(np.pi / n) - 1) / 2

    n = stave_count(0.08, tolerance)
    assert error(n) <= tolerance < error(n - 4)


def test_walls_touch_only_lugs():
    """Wall geoms are named after their part, stand in group 3 and do not collide with one
    another."""
    spec = new_spec("x")
    count = add_walls(spec, Assembly((Part("pipe", Tee(), Pose()),)))
    model = spec.compile()
    assert model.ngeom == count
    assert all("pipe" in model.geom(i).name for i in range(count))
    assert set(model.geom_group) == {3}
    assert not (model.geom_contype & model.geom_conaffinity).any()


@pytest.mark.parametrize("kind", ["omnitrack", "presser"])
def test_plates_in_pictures_have_the_shape_of_the_bore(kind):
    """Of any robot; corners of a square one would stand out of the pipe."""
    parts = Assembly((Part("pipe", FITTINGS["straight"], Pose()),))
    spec = robot_class(kind)().display.spec(parts, [(0, "end")])
    plate = spec.compile().geom("plate_pipe_end")
    assert plate.type == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert plate.size[0] == parts.parts[0].fitting.radius
