"""Onboard sensors, one by one: their noise, their errors, their pictures."""

from __future__ import annotations

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import turned_by
from omnitrack_sim.senses.cameras import (
    EXPOSED,
    DepthCamera,
    DepthTable,
    HeadlightCamera,
    HeadlightTable,
    exposure_level,
)
from omnitrack_sim.senses.draws import keys, normal, uniform
from omnitrack_sim.senses.optics import OpticsTable, rays_of
from omnitrack_sim.walls.rays import RayWalls

ONE = np.zeros(1, int)


def hits_in(name, distance, camera):
    """What the pixels of a camera on the centreline of a shipped scenario meet."""
    route = ot.load_scenario(name).route
    at = np.array([distance])
    place, frame = route.centreline.at(at)[0], route.centreline.frame(at)
    rays = rays_of(camera.optics)
    walls = RayWalls([route.network.parts], dirty=True)
    hits = walls.trace(ONE, place, frame, rays, camera.optics.far, camera.lamp)
    return walls, place, frame, rays, hits


def test_a_robot_draws_the_same_alone_and_among_others():
    """Numbers depend on key, name and count of the draw, and on nothing else."""
    three, one = keys(["a", "b", "c"]), keys(["b"])
    assert normal(three, "gyro", 7, 5)[1].tobytes() == normal(one, "gyro", 7, 5)[0].tobytes()
    assert normal(one, "gyro", 7, 5).tobytes() != normal(one, "gyro", 8, 5).tobytes()
    assert normal(one, "gyro", 7, 5).tobytes() != normal(one, "arms", 7, 5).tobytes()


def test_draws_are_distributed_as_they_say():
    """Mean, spread and tails of 200,000 numbers, and no correlation of neighbours."""
    found = normal(keys([str(i) for i in range(200)]), "depth", 3, 1000)
    assert abs(found.mean()) < 0.01
    assert found.std() == pytest.approx(1.0, abs=0.01)
    assert (np.abs(found) > 3).mean() == pytest.approx(0.0027, abs=0.0005)
    assert abs((found[:, 1:] * found[:, :-1]).mean()) < 0.01
    flat = uniform(keys(["x"]), "dropouts", 1, 100_000)
    assert np.histogram(flat, 10, (0, 1))[0].std() < 150


@pytest.mark.parametrize("distortion", [0.0, 0.2, -0.1])
def test_the_field_of_view_is_what_was_asked_for(distortion):
    """Half a pixel beyond the outermost ones, a ray stands at half the field of view."""
    optics = OpticsTable(pixels=200, field_of_view_deg=90, distortion=distortion)
    rays = rays_of(optics).reshape(200, 200, 3)
    edge = np.degrees(np.arccos(rays[100, [0, -1], 2]))
    assert edge == pytest.approx([45, 45], abs=0.6)
    assert np.linalg.norm(rays, axis=-1) == pytest.approx(1.0)
    assert rays[100, -1, 0] > 0.7  # columns go along x, to module 1


def test_depth_has_the_noise_of_its_table():
    """Over 40 pictures a pixel scatters by 1 % of its distance, and some pixels drop out."""
    camera = DepthCamera(DepthTable(scale_error=0.0))
    *_, rays, hits = hits_in("straight", 0.3, camera)
    robots = keys([str(i) for i in range(40)])
    pictures = camera.picture(np.repeat(hits, 40, axis=0), rays, np.arange(48**2), robots, 1)
    expected = camera.expected(hits, rays)[0]
    near = np.isfinite(expected) & (expected > 0.1)
    assert np.isnan(pictures[:, near]).mean() == pytest.approx(0.02, abs=0.005)
    errors = (pictures[:, near] - expected[near]) / expected[near]
    assert np.nanstd(errors) == pytest.approx(0.0125, abs=0.001)  # 1 %, the floor, the step
    assert np.isnan(pictures[:, ~np.isfinite(hits[0, :, 0])]).all()


def test_slopes_of_depth_are_those_of_its_pictures():
    """The formula agrees with pictures of neighbouring poses."""
    camera = DepthCamera(DepthTable())
    walls, place, frame, rays, hits = hits_in("elbow", 0.3, camera)
    expected, slopes = camera.expected(hits, rays), camera.slopes(hits, rays, frame)
    step = 1e-5
    for axis in range(6):
        move = np.zeros((1, 3))
        move[0, axis % 3] = step
        moved = (place + move, frame) if axis < 3 else (place, frame @ turned_by(move))
        there = camera.expected(walls.trace(ONE, *moved, rays, 1.5), rays)
        found = (there - expected)[0] / step
        # Not at pixels on the edge between near and far wall.
        smooth = np.isfinite(found) & (np.abs(found) < 20)
        assert smooth.mean() > 0.8
        assert np.median(np.abs(found - slopes[0, :, axis])[smooth]) < 0.02


def test_the_headlight_is_brighter_on_near_walls_and_dark_down_the_pipe():
    """In a straight the picture is a bright ring about a dark middle, and exposed to 0.8."""
    camera = HeadlightCamera(HeadlightTable(dirt=0.0, ring=0.0))
    *_, rays, hits = hits_in("straight", 0.3, camera)
    picture = camera.expected(hits, rays).reshape(48, 48)
    assert picture[24, 24] < 0.05
    profile = picture[24, 24:]
    assert (np.diff(profile[4:18]) > 0).all()
    assert np.quantile(picture, 0.9) == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize("count", [1, 2, 11, 144, 579])
def test_the_exposure_is_the_quantile_of_the_light(count):
    """Bit for bit that of NumPy, also where many pixels are dark."""
    light = np.random.default_rng(count).random((20, count)) ** 4
    light[:10] = np.where(light[:10] < 0.3, 0.0, light[:10])
    assert (
        exposure_level(light).tobytes()
        == np.quantile(light, EXPOSED, axis=1, keepdims=True).tobytes()
    )


def test_pixels_that_stand_for_others_expose_a_picture_as_those_would():
    """Of every other pixel, where those of the lower half stand for more than the others."""
    camera = HeadlightCamera(HeadlightTable())
    *_, rays, hits = hits_in("tee_turn", 0.3, camera)
    stand = np.concatenate([np.arange(1152), np.repeat(np.arange(576, 1152), 3)])
    whole = camera.expected(hits[:, ::2][:, stand], rays[::2][stand])
    some = camera.expected(hits[:, ::2], rays[::2], stand)
    assert some.tobytes() == whole[:, :1152].tobytes()
    assert some.tobytes() != camera.expected(hits[:, ::2], rays[::2]).tobytes()


def test_a_branch_makes_the_headlight_picture_lopsided():
    """On the branch's side, in front of a tee, there is less light than on the other."""
    camera = HeadlightCamera(HeadlightTable(dirt=0.0, ring=0.0, lamp_aside=0.0))
    *_, rays, hits = hits_in("tee_turn", 0.3, camera)
    picture = camera.expected(hits, rays).reshape(48, 48)
    columns = picture[18:30]
    assert columns[:, 34:46].mean() < 0.8 * columns[:, 2:14].mean()


@pytest.mark.parametrize(
    ("changes", "where", "told"),
    [
        ({"sensing.depth.rate": 30.0}, "sensing.depth.rate", "control period"),
        ({"sensing.depth.latency": 0.003}, "sensing.depth.latency", "control period"),
        ({"sensing.camera": "sonar"}, "sensing.camera", "depth, headlight"),
        ({"sensing.kind": "gps"}, "sensing.kind", "onboard"),
        ({"sensing.imu.gyro": 1.0}, "sensing.imu.gyro", "gyro_noise_deg"),
        ({"sensing.depth.ahead": -0.05}, "sensing.depth.ahead", ""),
    ],
)
def test_sensors_that_cannot_be_are_refused(changes, where, told):
    """Each fault is told at its key, with the choices."""
    with pytest.raises(ot.InputError) as error:
        ot.override(ot.load_scenario("tee_turn"), {"sensing.kind": "onboard"} | changes)
    assert where in str(error.value)
    assert told in str(error.value)


def test_slopes_of_light_are_those_of_its_pictures():
    """Beside the lamp's direction of the pipe, where joints and shadows do not show; the exposure
    changes with all pixels."""
    camera = HeadlightCamera(HeadlightTable(ring=0.0))
    walls, place, frame, rays, hits = hits_in("straight", 0.3, camera)
    slopes = camera.slopes(hits, rays, frame)[0]

    def picture(*pose):
        return camera.expected(walls.trace(ONE, *pose, rays, 1.5, camera.lamp), rays)[0]

    for axis, step in ((0, 1e-3), (1, 1e-3), (2, 1e-3), (3, 1e-2), (4, 1e-2)):
        move = step * np.eye(3)[None, axis % 3]
        sides = [
            picture(place + side * move, frame)
            if axis < 3
            else picture(place, frame @ turned_by(side * move))
            for side in (1.0, -1.0)
        ]
        change = (sides[0] - sides[1]) / (2 * step)
        error = np.median(np.abs(slopes[:, axis] - change))
        assert error < 0.25 * np.median(np.abs(change)) + 0.02


def test_the_exposure_changes_with_the_pixels_about_its_own():
    """Beside a wall, towards which those grow brighter while most others hardly change."""
    camera = HeadlightCamera(HeadlightTable(ring=0.0))
    walls, place, frame, rays, _ = hits_in("straight", 0.3, camera)
    aside = np.array([[0.0, 1.0, 0.0]])

    def met(offset):
        return walls.trace(ONE, place + offset * aside, frame, rays, 1.5, camera.lamp)

    near, step = 0.04, 1e-3
    slopes = camera.slopes(met(near), rays, frame)[0, :, 1]
    sides = [camera.expected(met(near + side * step), rays)[0] for side in (1.0, -1.0)]
    change = (sides[0] - sides[1]) / (2 * step)
    assert np.median(np.abs(change)) > 1.0
    assert np.median(np.abs(slopes - change)) < 0.2 * np.median(np.abs(change))
