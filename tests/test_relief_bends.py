"""Relief and scans on the walls of bends."""

from __future__ import annotations

import math

import contact_lots
import numpy as np
import pytest
import thrown_bodies
from in_pipes import check_that_thrown_bodies_stay, gradient_error
from scipy.spatial import cKDTree

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose, unit
from omnitrack_sim.pipes import Part
from omnitrack_sim.walls.meshes import fitting_mesh
from omnitrack_sim.walls.rays import RayWalls

RADIUS, MEAN = 0.08, 0.24
LENGTH = MEAN * math.pi / 2
RELIEF = {
    "ovality": {"kind": "ovality", "ratio": 0.06, "direction_deg": 20},
    "dent inside": {"kind": "dent", "at": 0.19, "depth": 0.008, "length": 0.08, "width": 0.06},
    "corrosion": {"kind": "corrosion", "roughness": 0.0008, "wavelength": 0.03, "seed": 3},
    "weld": {"kind": "weld", "at": 0.19},
    "part of a weld": {"kind": "weld", "at": 0.19, "height": 0.005, "from_deg": -40, "to_deg": 60},
}
RELIEF["dent outside"] = RELIEF["dent inside"] | {"angle_deg": 170}
HEIGHTS = ("ovality", "dent inside", "dent outside", "corrosion")


def bend(*names: str, mean: float = MEAN, angle: float = math.pi / 2) -> ot.Elbow:
    """A bend with relief by name."""
    return ot.Elbow(mean, angle, relief=[RELIEF[name] for name in names])


def points_in(fitting: ot.Elbow, count: int) -> np.ndarray:
    """Points (count, 3) m up to 0.94 of the bore's radius from the middle of the bend's axis."""
    rng = np.random.default_rng(1)
    s, angle = rng.uniform(0.17, 0.21, count), rng.uniform(0, 2 * np.pi, count)
    away = 0.075 * np.sqrt(rng.uniform(0, 1, count))
    frames = [fitting.axis_frame(float(each)) for each in s]
    across = np.stack([away * np.cos(angle), away * np.sin(angle), 0 * s], axis=-1)
    return np.array([f.position + f.rotation @ p for f, p in zip(frames, across, strict=True)])


def places_of(fitting: ot.Elbow, spacing: float) -> np.ndarray:
    """Places (k, 3) m of a wall of heights about the middle of the bend."""
    s = np.arange(0.08, 0.30, spacing)
    angle = np.arange(0, 2 * np.pi, spacing / RADIUS)
    return fitting.on_wall(np.stack(np.meshgrid(s, angle), axis=-1)).reshape(-1, 3)


@pytest.mark.parametrize("mean", [MEAN, pytest.param(0.17, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", HEIGHTS)
def test_the_distance_is_that_of_the_nearest_place(name, mean):
    """No place of the wall is nearer, one is as near, and the gradient is the distance's
    derivative."""
    fitting, spacing = bend(name, mean=mean, angle=LENGTH / mean), 5e-4
    points = points_in(fitting, 1500)
    distance, gradient = fitting.signed_distance(points)
    kept = distance > 1e-3
    points, distance, gradient = points[kept], distance[kept], gradient[kept]
    away = cKDTree(places_of(fitting, spacing)).query(points)[0]
    assert (distance - away).max() < 1e-6
    # The nearest of the places lies up to 0.5 mm aside.
    assert (away - distance - 1.3e-7 / distance).max() < 3e-5
    assert np.abs(fitting.signed_distance(points - distance[:, None] * gradient)[0]).max() < 1e-7
    error = gradient_error(fitting, points, gradient)
    assert np.quantile(error, 0.98) < 1e-5


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi])
def test_a_bead_stands_across_the_axis_of_a_bend(angle):
    """Below its middle, on all sides of the bend, the distance is that to a circle across the
    axis."""
    fitting = bend("weld")
    frame = fitting.axis_frame(0.19)
    out = np.array([math.cos(angle), math.sin(angle), 0.0])
    distance, gradient = fitting.signed_distance(frame.position + frame.rotation @ (0.06 * out))
    assert distance == pytest.approx(RADIUS - 0.003 - 0.06, abs=1e-6)
    np.testing.assert_allclose(gradient, -frame.rotation @ out, atol=1e-6)


def test_a_bend_without_relief_beside_it_is_a_torus():
    """Away from a dent the distance is that of the ideal bend, to 1 nm, at both ports and on."""
    fitting, rng = bend("dent inside"), np.random.default_rng(2)
    points = rng.uniform([-0.04, -0.04, -0.05], [0.04, 0.04, 0.05], (500, 3))
    ideal, plain = ot.Elbow(MEAN).signed_distance(points), fitting.signed_distance(points)
    np.testing.assert_allclose(plain[0], ideal[0], atol=1e-9)
    np.testing.assert_allclose(plain[1], ideal[1], atol=1e-6)


@pytest.mark.parametrize("shape", contact_lots.SHAPES)
@pytest.mark.parametrize(
    "name",
    ["dent inside", *(pytest.param(n, marks=pytest.mark.long) for n in ("ovality", "weld"))],
)
def test_contacts_tell_the_least_distance_of_any_body(name, shape):
    """The deepest contact of each type of geom is as deep as branch and bound finds, to 0.02 mm."""
    lot = contact_lots.Lot(bend(name), shape)
    lot._bore *= 0.7
    assert lot.errors(12, np.random.default_rng([7])).max() < 2e-5


@pytest.mark.parametrize("name", RELIEF)
def test_meshes_lie_on_the_wall_and_rays_end_there(name):
    """Corners of the inner surface are on the exact wall, the mesh is closed, rays end on the wall
    and pass through none."""
    fitting = bend(name)
    mesh = fitting_mesh(fitting)
    distance = fitting.signed_distance(mesh.vertices)[0]
    inner = distance > -0.002
    # The ideal bend's own mesh has chords of two degrees.
    assert np.abs(distance[inner]).max() < (5e-5 if name in HEIGHTS else 1e-4)
    assert inner.mean() > 0.4
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    )
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    rays = unit(np.random.default_rng(2).normal((0.3, 0.0, 1.0), 0.6, (300, 3)))
    parts, position = (Part("bend", fitting, Pose()),), np.array([[0.01, -0.02, 0.05]])
    hits = RayWalls([parts]).trace(np.zeros(1, int), position, np.eye(3)[None], rays, 9)[0]
    met = np.isfinite(hits[:, 0])
    assert met.mean() > 0.6
    for part, most in ((1.0, 1e-7), (0.95, math.inf), (0.5, math.inf)):
        along = position + part * hits[met, :1] * rays[met]
        distance = fitting.signed_distance(along)[0]
        assert np.abs(distance).max() < most
        assert part == 1.0 or distance.min() > 0


def test_a_scan_of_a_bend_is_its_wall():
    """Radii about the axis of a bend, along it: read back to 0.02 mm."""
    s, angle = np.meshgrid(
        np.arange(0, LENGTH, 0.005), np.radians(np.arange(0, 360, 2)), indexing="ij"
    )
    fitting = bend("ovality", "dent outside")
    radius = np.full(s.shape, RADIUS)
    for each in fitting.patches:
        radius -= ot_height(each, s, angle)
    profile = ot.Profile.from_rays(s, angle, radius)
    measured = ot.Elbow(MEAN, profile=profile)
    places = np.stack([s, angle], axis=-1)[16:-20]
    assert np.abs(measured.on_wall(places) - fitting.on_wall(places)).max() < 2e-5


def ot_height(patch, s: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Height, m, of one patch."""
    from omnitrack_sim.pipes.heights import total_height

    return total_height([patch], np.stack([s, angle], axis=-1))


@pytest.mark.parametrize(
    ("keys", "where", "told"),
    [
        ({"mean_radius": 0.1, "relief": [RELIEF["ovality"]]}, "relief.0.kind", "at least 0.16 m"),
        (
            {
                "mean_radius": MEAN,
                "relief": [
                    {"kind": "deposit", "at": 0.2, "length": 0.1, "depth": 0.01, "angle_deg": 0}
                ],
            },
            "relief.0.kind",
            "straights and caps",
        ),
        (
            {"mean_radius": MEAN, "relief": [{"kind": "weld", "at": 0.4}]},
            "relief.0.at",
            "must be from",
        ),
    ],
)
def test_relief_that_cannot_be_in_a_bend_is_told(keys, where, told):
    """Heights in a tight bend, a flat bed, and what reaches beyond a port are faults."""
    with pytest.raises(ot.GeometryError) as caught:
        ot.Elbow(**keys)
    (fault,) = caught.value.faults
    assert fault.where == f"elbow.{where}"
    assert told in str(fault)


def test_a_weld_stands_in_a_tight_bend():
    """A bead is no height: it may stand where the bend is as tight as its bore."""
    assert len(ot.Elbow(0.09, relief=[{"kind": "weld", "at": 0.07}]).obstacles) == 1


@pytest.mark.long
@pytest.mark.parametrize("name", ["dent outside", "part of a weld"])
def test_bodies_thrown_into_a_bend_stay_there(name):
    """Bodies of seven shapes at 1 to 12 m/s are in the bore half a second later."""
    table = {"kind": "elbow", "mean_radius": MEAN, "relief": [RELIEF[name]]}
    check_that_thrown_bodies_stay(thrown_bodies.fitting_alone(table))


@pytest.mark.long
def test_the_robot_drives_through_an_oval_bend():
    """A bend whose wall is oval by 3 % is passed as the ideal one is."""
    scenario = ot.load_scenario("elbow")
    index = next(i for i, pipe in enumerate(scenario.pipes) if pipe.kind == "elbow")
    oval = ot.override(scenario, {f"pipes.{index}.relief": [{"kind": "ovality", "ratio": 0.03}]})
    assert ot.run(oval).outcome == ot.run(scenario).outcome == ot.Outcome.REACHED_GOAL
