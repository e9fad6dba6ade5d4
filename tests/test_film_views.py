"""What films show: cameras, light on walls, maps and text."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from film_samples import PIPES, SIZE, chain_result, elbow_result
from samples import two_legs, two_legs_result

import omnitrack_sim as ot
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.film.overlay import MapPanel, StatusPanel
from omnitrack_sim.show.film.render import painted, render_frame, render_frames
from omnitrack_sim.show.film.shots import SideCamera, in_the_way, view_directions
from omnitrack_sim.show.landmarks import Landmarks
from omnitrack_sim.show.projection import clearest, needs_map
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.sources import playback_of


@pytest.fixture(scope="module")
def result():
    """One run for all pictures."""
    return elbow_result()


@pytest.mark.parametrize("camera", ["side", "follow", "onboard"])
def test_every_camera_sees_something_that_changes(result, camera):
    """Each camera gives a picture of the size asked for, not of one colour, and another one later
    in the run."""
    early, late = (
        render_frame(result, time=t, camera=camera, width=SIZE[0], height=SIZE[1])
        for t in (0.0, 1.0)
    )
    assert early.shape == (180, 320, 3)
    assert early.dtype == np.uint8
    assert early[:100].std() > 4
    assert np.abs(early[:100].astype(int) - late[:100]).max() > 20


def test_the_side_camera_paints_what_changes_and_nothing_else_changes(result, monkeypatch):
    """Pictures of which only what is near robot and shadow is painted are those painted whole."""
    playback, times = playback_of(result), np.linspace(0.0, 1.0, 5).tolist()
    order = (playback, times, (640, 360), "side", {"fine": False})
    near = list(painted(*order))
    from omnitrack_sim.show.film.painter import Painter  # OpenGL's platform is chosen by now

    monkeypatch.setattr(Painter, "_box_of_robot", lambda painter, *_: painter._drawn.whole)
    np.testing.assert_array_equal(near, list(painted(*order)))


def test_modules_show_in_three_colours(result):
    """At least two of orange, blue and green are in the picture that follows the robot; the third
    may be behind it."""
    frame = render_frame(result, time=0.0, camera="follow", width=640, height=360).astype(int)[
        :, 180:
    ]
    red, green, blue = frame[..., 0], frame[..., 1], frame[..., 2]
    orange = (red > 120) & (red > green + 40) & (green > blue + 30)
    teal = (green > red + 50) & (green > blue + 15)
    sky = (blue > red + 70) & (blue > green + 30)
    assert sorted(bool(c.sum() > 300) for c in (orange, teal, sky))[1:] == [True, True]


def test_no_specks_in_the_wall_of_a_pipe(result):
    """Above the robot no pixel is much darker than all those two pixels away from it, where these
    are of a wall in the light: a wall must not throw dots of shadow on itself."""
    frame = render_frame(result, time=0.0, camera="side", width=640, height=360)[:240, 100:]
    grey = frame.astype(int).sum(axis=2) / 3
    shifts = [(i, j) for i in (-2, 0, 2) for j in (-2, 0, 2) if i or j]
    around = np.min([np.roll(grey, shift, axis=(0, 1)) for shift in shifts], axis=0)
    assert (around > 90).sum() > 15_000
    assert ((around > 90) & (around - grey > 20))[2:-2, 2:-2].sum() == 0


def test_a_pipe_stands_out_from_what_is_behind_it(result):
    """The wall in the light is 2.5 times as bright as the ground, and the cut edge brighter."""
    (frame,) = render_frames(
        result, times=[0.0], camera="side", width=640, height=360, overlay=False
    )
    grey = frame.astype(int).sum(axis=2) / 3
    ground, wall, edge = np.percentile(grey, [5, 90, 99.9])
    assert wall > 2.5 * ground
    assert edge > wall + 40


def test_the_side_camera_shows_the_pipes_on_the_way(result):
    """The same picture with and without a long pipe that the robot does not come to."""
    longer = result.scenario.model_dump(exclude_none=True)
    frames = []
    for length in (0.4, 4.0):
        longer["pipes"][-1]["length"] = length
        run = replace(result, scenario=Scenario.model_validate(longer))
        (frame,) = render_frames(
            run, times=[0.5], camera="side", width=SIZE[0], height=SIZE[1], overlay=False
        )
        frames.append(frame.astype(int))
    orange = [(f[..., 0] > f[..., 2] + 60).sum() for f in frames]
    assert orange[1] > 0.8 * orange[0] > 0


def test_onboard_nearer_walls_are_brighter(result):
    """The lamp's light falls off: the wall beside the robot is brighter than farther on."""
    frame = (
        render_frame(result, time=0.0, camera="onboard", width=SIZE[0], height=SIZE[1])
        .astype(float)
        .mean(axis=2)
    )
    assert frame[20:40, 60:260].mean() > 1.5 * frame[75:105, 145:175].mean()
    assert frame[20:40, 60:260].std() > 3  # its texture


def test_the_camera_that_follows_looks_across_the_pipe():
    """In every plane: never along the pipe, never from far below, and without a jump; in bends
    across their plane, from near the direction that is liked, and with few turns."""
    result = chain_result()
    (way,) = result.routes()
    liking = np.array([0.1, -1.0, 0.4])
    back = view_directions(RunPlayback(result), liking)
    tangent = way.centreline.at(result.trajectory["distance"])[1]
    assert np.allclose(np.linalg.norm(back, axis=1), 1.0)
    assert np.abs((back * tangent).sum(axis=1)).max() < 0.75
    assert np.abs((back * tangent).sum(axis=1)).mean() < 0.19
    assert np.linalg.norm(np.diff(back, axis=0), axis=1).max() < 0.12  # rad for 10 mm of travel
    assert (back[:, 2] > -0.5).all()
    assert (back @ liking).mean() > 0.6 * np.linalg.norm(liking)
    assert np.linalg.norm(np.diff(back, axis=0), axis=1).sum() < 4.0
    position, across = result.trajectory["position"], []
    for part in scenario_parts(result):
        if part.fitting.kind == "elbow":
            inside = np.minimum(part.extent(position), part.signed_distance(position)[0]) > 0
            across += np.abs(back[inside] @ part.pose.rotation[:, 1]).tolist()
    assert np.mean(across) > 0.85


def test_the_camera_that_follows_does_not_look_through_another_pipe():
    """Where the direction that is liked leads through the other leg of a bend back, the viewer
    stands beside it."""
    elbow = {"kind": "elbow", "mean_radius": 0.12}
    leg = {"kind": "straight", "length": 0.8}
    result = elbow_result([leg, elbow, elbow, leg])
    first, *_, last = scenario_parts(result)
    towards = last.bore_samples().mean(axis=0) - first.bore_samples().mean(axis=0)
    towards /= np.linalg.norm(towards)
    back = view_directions(RunPlayback(result), towards)
    for place, direction in zip(result.trajectory["position"], back, strict=True):
        sight = place + np.linspace(0.16, 1.0, 20)[:, None] * 0.68 * direction
        assert np.minimum(last.extent(sight), last.signed_distance(sight)[0]).max() < 0


def scenario_parts(result):
    """The parts of a result's pipes."""
    return RunPlayback(result).network.parts


@pytest.mark.parametrize(("aspect", "panel"), [(16 / 9, 0.0), (0.6, 1.0)])
def test_the_side_camera_has_all_pipes_in_the_picture_and_none_behind_panels(result, aspect, panel):
    """Those near the robot's way fill it but for some 3 % at the edges they come next to; where
    panels cover its left side, they are right of it."""
    playback = RunPlayback(result)
    camera = SideCamera(playback, aspect, 0.2, panel)
    eye = camera.shot(0, mujoco.MjData(playback.model)).eye
    points = np.concatenate([part.bore_samples() for part in playback.network.parts])
    away = np.linalg.norm(points[:, None] - playback.position, axis=2).min(axis=1)
    points = points[away < 0.3]
    seen, ahead = eye.pixels(points, (round(900 * aspect), 900))
    assert ahead.all()
    low, high = (end(axis=0) / (900 * aspect, 900) for end in (seen.min, seen.max))
    edge = min(*low, *(1 - high)) if not panel else 1 - high[0]
    assert 0.01 < edge < 0.06
    assert low[0] > 0.28 * panel


def test_a_pipe_in_the_way_is_known():
    """A part between eye and robot is in the way; the one around the robot, and one elsewhere, are
    not."""
    parts = two_legs()[0].network.parts
    robot = np.array([[0.0, 0.0, 0.3]])
    drop = next(part for part in parts if part.name == "drop")
    beyond = robot[0] + 1.6 * (drop.pose.position - robot[0]) * [1, 1, 0]
    shares = in_the_way(parts, beyond, robot)
    share = {part.name: float(value) for part, value in zip(parts, shares, strict=True)}
    assert share["drop"] == 1.0
    assert share["riser"] == share["chimney"] == 0.0


def test_films_of_long_routes_have_a_map():
    """A map in the upper right corner of follow and onboard, not of side, and not when it is not
    wanted."""
    result = chain_result()
    assert needs_map(result)
    for camera, has_map in (("side", False), ("follow", True), ("onboard", True)):
        mapped, bare = (
            render_frame(
                result, time=3.0, camera=camera, width=SIZE[0], height=SIZE[1], inset=wanted
            )
            for wanted in (True, False)
        )
        assert (mapped[10:60, 250:300] != bare[10:60, 250:300]).any() == has_map, camera
        assert (mapped[:, :200] == bare[:, :200]).all()


def test_map_shows_the_way_driven_so_far():
    """The way grows, its colour tells tail first from nose first, and the rest of the frame stays
    as it is."""
    result = two_legs_result()
    marks = Landmarks.of(result, result.trajectory)
    inset = MapPanel(RunPlayback(result), marks, (1280, 720))
    grey = np.full((720, 1280, 3), 90, np.uint8)
    frames = []
    for row in (0, 900, len(result.trajectory.time) - 1):
        frame = grey.copy()
        inset.write(frame, row)
        frames.append(frame.astype(int))
    yellow = [
        int(((f[..., 0] > 220) & (f[..., 1] > 170) & (f[..., 2] < 100)).sum()) for f in frames
    ]
    pink = [int(((f[..., 0] > 220) & (f[..., 1] < 140) & (f[..., 2] > 140)).sum()) for f in frames]
    assert yellow[0] < yellow[1] / 2
    assert pink[0] == pink[1] == 0
    assert pink[2] > 50
    assert (frames[2][:, :800] == 90).all()
    again = grey.copy()
    inset.write(again, 900)
    assert (again == frames[1]).all()  # whatever was drawn before


def test_map_of_a_plane_network_is_an_elevation():
    """Pipes in the plane y = 0 are seen along y; of pipes in space every one is longer than a
    dot."""
    flat = Scenario.model_validate({"name": "flat", "pipes": PIPES}).route.network
    assert np.allclose(np.abs(clearest(flat).axes), [[1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12)
    network = two_legs()[0].network
    view = clearest(network).axes
    for part in network.parts:
        start, end = (part.port(port).position for port in part.fitting.port_names[:2])
        assert np.linalg.norm((end - start) @ view[:, :2]) > 0.4 * np.linalg.norm(end - start)


def test_overlay_names_fitting_and_gear():
    """Two fittings, and two gears, give different text; a long name is cut to the panel."""
    grey = np.full((720, 1280, 3), 90, np.uint8)
    result = two_legs_result()
    trajectory = result.trajectory
    last = len(trajectory.time) - 1

    def written(shown: Trajectory, name: str) -> np.ndarray:
        frame = grey.copy()
        playback = RunPlayback(replace(result, trajectory=shown))
        moment = playback.moment(last)._replace(part=name)
        StatusPanel(lambda row: playback.display.status(moment), (1280, 720)).write(frame, last)
        return frame

    named, long = (written(trajectory, name) for name in ("drop", "a_very_long_name_" * 5))
    assert (named != long).any()
    assert (long[:, 360:] == 90).all()
    channels = dict(trajectory.channels) | {"gear": np.ones(last + 1)}
    nose_first = Trajectory(
        trajectory.time, channels, trajectory.phases, trajectory.qpos, trajectory.schema
    )
    assert (written(nose_first, "drop") != named).any()


def test_a_robot_of_half_the_size_looks_the_same_in_half_the_pipe():
    """Its pictures are sized by its bore; in those of a whole pipe's size it would be a speck."""
    whole = {"pipes.0.length": 0.6, "start.distance": 0.2, "run.time_limit": 0.02}
    half = {
        "robot.scale": 0.5,
        "pipes.0.inner_diameter": 0.08,
        "pipes.0.length": 0.3,
        "start.distance": 0.1,
        "run.time_limit": 0.02,
        "control.cruise_speed": 0.07,
    }
    look = {"camera": "follow", "overlay": False, "width": 320, "height": 180}
    one, other = (
        ot.render_frame(ot.run(ot.load_scenario("straight", c)), time=0.0, **look).astype(int)
        for c in (whole, half)
    )
    assert np.abs(one - other).mean() < 3
