"""Films and pictures are drawn from a recorded trajectory."""

from __future__ import annotations

from dataclasses import replace

import av
import imageio.v3 as imageio
import numpy as np
import pytest
from samples import drive, sample_result, two_legs, two_legs_result

from omnitrack_sim.errors import InputError, OutputError
from omnitrack_sim.film.inset import Inset, needs_map, projection
from omnitrack_sim.film.overlay import Overlay
from omnitrack_sim.film.render import render_frame, render_frames, render_video
from omnitrack_sim.film.stage import Stage
from omnitrack_sim.film.strip import FRAMES, render_strip, strip_times
from omnitrack_sim.film.viewpoint import in_the_way, view_directions
from omnitrack_sim.record.trajectory import RECORDED, Trajectory
from omnitrack_sim.rotations import quaternion_from_matrix
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.result import Result

SIZE = (320, 180)
PIPES = [
    {"kind": "straight", "length": 0.5},
    {"kind": "elbow", "mean_radius": 0.24},
    {"kind": "straight", "length": 0.4},
]


@pytest.fixture(scope="module")
def result():
    """A robot drawn along a centreline for one second, without physics."""
    scenario = Scenario.model_validate({"name": "film", "pipes": PIPES})
    line = scenario.route.centreline
    time = np.linspace(0.0, 1.0, 51, dtype=np.float64)
    distance = 0.1 + 0.5 * time
    channels = {name: np.zeros((len(time), *channel.shape)) for name, channel in RECORDED.items()}
    position, frame = line.at(distance)[0], line.frame(distance)
    channels |= {
        "position": position,
        "quaternion": quaternion_from_matrix(frame),
        "distance": distance,
    }
    channels["belt_speed"] = np.full((len(time), 3), 0.1)
    qpos = np.concatenate([position, channels["quaternion"], np.zeros((len(time), 15))], axis=1)
    channels["gear"] = np.ones(len(time))
    trajectory = Trajectory(time, channels, ("straight",), qpos)
    return sample_result(trajectory, scenario=scenario)


def test_film_has_the_length_size_and_codec_asked_for(result, tmp_path):
    """One second at 10 frames a second is 11 frames of H.264, odd sizes made even, and nothing else
    stays."""
    progress = []
    path = render_video(
        result,
        tmp_path / "run.mp4",
        width=319,
        height=179,
        fps=10,
        progress=lambda f, _: progress.append(f),
    )
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height, stream.codec_context.name) == (*SIZE, "h264")
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.average_rate == 10
        assert sum(1 for _ in film.decode(video=0)) == 11
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")
    assert progress[-1] == 1.0
    assert progress == sorted(progress)
    assert [p.name for p in tmp_path.iterdir()] == ["run.mp4"]


def test_a_gif_is_a_gif(result, tmp_path):
    """One second at 10 frames a second is 11 frames of 0.1 s that repeat, and look as they should;
    nothing else stays."""
    path = render_video(result, tmp_path / "run.gif", width=319, height=179, fps=10)
    assert path.read_bytes()[:6] == b"GIF89a"
    with imageio.imopen(path, "r", plugin="pillow") as film:
        frames = film.read(index=...)
        assert film.metadata(index=0)["duration"] == 100
        assert film.metadata(index=0)["loop"] == 0
    assert frames.shape == (11, 180, 320, 3)
    for frame, time in ((0, 0.0), (10, 1.0)):
        still = render_frame(result, time, "side", *SIZE)
        assert np.abs(frames[frame].astype(int) - still).mean() < 2
    assert [p.name for p in tmp_path.iterdir()] == ["run.gif"]


def test_a_webm_is_vp9(result, tmp_path):
    """One second at 10 frames a second is 11 frames of VP9, which look as they should."""
    path = render_video(result, tmp_path / "run.webm", width=319, height=179, fps=10)
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        assert "webm" in film.format.name
        assert (stream.width, stream.height, stream.codec_context.name) == (*SIZE, "vp9")
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 11
    still = render_frame(result, 1.0, "side", *SIZE)
    assert np.abs(frames[-1].astype(int) - still).mean() < 4
    assert [p.name for p in tmp_path.iterdir()] == ["run.webm"]


@pytest.mark.parametrize("ending", ["mp4", "webm", "gif"])
def test_same_run_same_film(result, tmp_path, ending):
    """Rendered twice, the files are the same byte for byte."""
    films = [
        render_video(result, tmp_path / f"{k}.{ending}", width=64, height=36, fps=10)
        for k in range(2)
    ]
    assert films[0].read_bytes() == films[1].read_bytes()


@pytest.mark.parametrize("name", ["run.png", "run", "run.avi", "run.mp4.part", ".mp4"])
def test_other_formats_are_refused_before_anything_is_read(tmp_path, name):
    """With those there are."""
    with pytest.raises(InputError, match="choose from: mp4, webm, gif") as caught:
        render_video("nowhere", tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize("camera", ["side", "follow", "onboard"])
def test_every_camera_sees_something_that_changes(result, camera):
    """Each camera gives a picture of the size asked for, not of one colour, and another one later
    in the run."""
    early, late = (render_frame(result, t, camera, *SIZE) for t in (0.0, 1.0))
    assert early.shape == (180, 320, 3)
    assert early.dtype == np.uint8
    assert early[:100].std() > 4
    assert np.abs(early[:100].astype(int) - late[:100]).max() > 20


def test_modules_show_in_three_colours(result):
    """At least two of orange, blue and green are in the picture that follows the robot; the third
    may be behind it."""
    frame = render_frame(result, 0.0, "follow", 640, 360).astype(int)[:, 180:]
    red, green, blue = frame[..., 0], frame[..., 1], frame[..., 2]
    orange = (red > 120) & (red > green + 40) & (green > blue + 30)
    teal = (green > red + 50) & (green > blue + 15)
    sky = (blue > red + 70) & (blue > green + 30)
    assert sorted(bool(c.sum() > 300) for c in (orange, teal, sky))[1:] == [True, True]


@pytest.mark.parametrize(
    ("ending", "size"),
    [("mp4", {"fps": 241}), ("gif", {"fps": 51}), ("mp4", {"width": 7681}), ("gif", {"height": 0})],
)
def test_sizes_and_rates_have_limits(tmp_path, ending, size):
    """Refused before anything is read."""
    with pytest.raises(InputError, match=rf"{next(iter(size))}: is .* must be from 1 to"):
        render_video("nowhere", tmp_path / f"run.{ending}", **size)


def test_all_faults_of_a_request_are_named():
    """An unknown camera and a size of zero are both told, with the cameras there are."""
    with pytest.raises(InputError) as caught:
        render_frame("nowhere", 0.0, "above", width=0)  # refused before anything is read
    assert [f.where for f in caught.value.faults] == ["camera", "width"]
    assert "follow" in str(caught.value)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("camera", ["side", "follow", "onboard"])
def test_a_run_that_diverged_stops_in_its_film(result, camera, value):
    """A sample without a pose shows the one before it."""
    plain = result.trajectory
    channels = {name: np.array(values) for name, values in plain.channels.items()}
    qpos = np.array(plain.qpos)
    for values in (channels["position"], channels["distance"], channels["belt_speed"], qpos):
        values[-5:] = value
    trajectory = Trajectory(plain.time, channels, plain.phases, qpos)
    broken = replace(result, trajectory=trajectory)
    end, sound = (
        render_frame(run, time, camera, 64, 36).astype(int)
        for run, time in ((broken, 1.0), (result, plain.time[-6]))
    )
    assert np.abs(end - sound).mean() < 8  # the camera that follows turns a little earlier


@pytest.mark.parametrize("camera", ["side", "follow"])
def test_several_processes_make_the_same_film(result, tmp_path, camera):
    """Byte for byte, and nothing else stays."""
    films = [
        render_video(result, tmp_path / f"{n}.mp4", camera, width=64, height=36, fps=5, processes=n)
        for n in (1, 2)
    ]
    assert films[0].read_bytes() == films[1].read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["1.mp4", "2.mp4"]


@pytest.mark.parametrize("fine", [False, True])
def test_still_pipes_painted_once_are_those_painted_each_time(result, fine):
    """What the camera that stands paints anew, over the pipes without a robot, gives the picture
    that is painted as a whole, to the bit, wherever the robot is."""
    with Stage(result, SIZE, "side", fine=fine) as stage:
        for row in (0, 17, 34, 50):
            kept = stage._seen(row)
            view = stage._camera.view(row, *stage._chassis())
            region = stage._changed(view)
            assert region is not None
            assert region.width * region.height < 0.7 * SIZE[0] * SIZE[1]
            assert (kept == stage._painted(view)).all()


def test_no_specks_in_the_wall_of_a_pipe(result):
    """Above the robot no pixel is much darker than all those two pixels away from it, where these
    are of a wall in the light: a wall must not throw dots of shadow on itself."""
    frame = render_frame(result, 0.0, "side", 640, 360)[:240, 100:]
    grey = frame.astype(int).sum(axis=2) / 3
    shifts = [(i, j) for i in (-2, 0, 2) for j in (-2, 0, 2) if i or j]
    around = np.min([np.roll(grey, shift, axis=(0, 1)) for shift in shifts], axis=0)
    assert (around > 90).sum() > 15_000
    assert ((around > 90) & (around - grey > 20))[2:-2, 2:-2].sum() == 0


def test_a_pipe_stands_out_from_what_is_behind_it(result):
    """The wall in the light is 2.5 times as bright as the ground, and the cut edge brighter."""
    (frame,) = render_frames(result, [0.0], "side", 640, 360, overlay=False)
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
        (frame,) = render_frames(run, [0.5], "side", *SIZE, overlay=False)
        frames.append(frame.astype(int))
    orange = [(f[..., 0] > f[..., 2] + 60).sum() for f in frames]
    assert orange[1] > 0.8 * orange[0] > 0


def test_onboard_nearer_walls_are_brighter(result):
    """The lamp's light falls off: the wall beside the robot is brighter than farther on."""
    frame = render_frame(result, 0.0, "onboard", *SIZE).astype(float).mean(axis=2)
    assert frame[20:40, 60:260].mean() > 1.5 * frame[75:105, 145:175].mean()
    assert frame[20:40, 60:260].std() > 3  # its texture


def test_a_strip_has_its_stills_letters_and_times(result, tmp_path):
    """Six stills in two rows of three, on white paper; the first is the picture at its time."""
    path = render_strip(result, tmp_path / "strip.png", width=160, height=120)
    sheet = imageio.imread(path)
    assert sheet.shape == (2 * (120 + 10 + 3) + 3, 3 * 163 + 3, 3)
    assert (sheet[0] == 255).all()
    times = strip_times(result)
    assert len(times) == FRAMES
    assert times == sorted(times)
    (first,) = render_frames(result, times[:1], "side", 160, 120, inset=False, overlay=False)
    assert (sheet[3:123, 3:163] == first).all()
    assert sheet[124:132, 3:163].min() < 80  # letter and time


def test_a_strip_covers_the_fittings(result):
    """From just before the elbow to the end of the run, which ends in it or behind it."""
    (elbow,) = (visit for visit in result.timeline() if visit.kind == "elbow")
    times = strip_times(result, 4)
    assert times[0] == pytest.approx(max(0.0, elbow.time_enter_s - 0.3))
    end = result.duration_s if elbow.time_leave_s is None else elbow.time_leave_s + 0.3
    assert times[-1] == pytest.approx(min(end, result.trajectory.time[-1]))


@pytest.mark.parametrize("ending", ["png", "jpg", "pdf"])
def test_same_run_same_strip(result, tmp_path, ending):
    """Made twice, the files are the same byte for byte."""
    strips = [
        render_strip(
            result,
            tmp_path / f"{k}.{ending}",
            times=[0.1, 0.9],
            camera="follow",
            width=64,
            height=48,
        ).read_bytes()
        for k in range(2)
    ]
    assert strips[0] == strips[1]


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"count": 0}, "count: are 0 stills; must be from 1 to 26"),
        ({"times": [0.5] * 27}, "times: are 27 stills"),
        ({"times": [0.5, 1.5]}, r"times\[1\]: is 1.5 s; the run goes from 0 to 1 s"),
        ({"times": [0.5, float("nan")]}, r"times\[1\]: is nan; it must be a number, s"),
        ({"camera": "above"}, "camera"),
        ({"width": 0}, "width: is 0"),
    ],
)
def test_strips_that_cannot_be_made_are_refused(result, tmp_path, asked, told):
    """With the place of the fault, and nothing is written."""
    with pytest.raises(InputError, match=told):
        render_strip(result, tmp_path / "strip.png", **asked)
    assert not list(tmp_path.iterdir())


def test_films_longer_than_anybody_waits_for_are_refused(result, tmp_path):
    """A run of a day at full size."""
    long = Trajectory(
        86400 * result.trajectory.time,
        result.trajectory.channels,
        result.trajectory.phases,
        result.trajectory.qpos,
    )
    with pytest.raises(
        InputError, match="frames: are 2160001 of 1280 x 720 pixels; at most 542534"
    ):
        render_video(replace(result, trajectory=long), tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


def test_unwritable_film_is_a_clean_error(result, tmp_path):
    """A film into a folder that does not exist is an OutputError that names the file."""
    with pytest.raises(OutputError, match=r"missing/run.mp4"):
        render_video(result, tmp_path / "missing" / "run.mp4", width=64, height=36)


def chain_result() -> Result:
    """A robot drawn through bends in three planes and a tee: more fittings than a film goes without
    a map."""
    pipes = [
        *PIPES,
        {"kind": "elbow", "mean_radius": 0.09, "turn_deg": 90.0},
        {"kind": "straight", "length": 0.5},
    ]
    pipes += [{"kind": "tee", "enter": "run_start", "leave": "branch", "turn_deg": 120.0}]
    scenario = Scenario.model_validate(
        {"name": "chain", "pipes": [*pipes, {"kind": "straight", "length": 0.4}]}
    )
    way = scenario.route
    distance = np.arange(0.1, way.centreline.length - 0.1, 0.01)
    channels = drive(way, distance)
    qpos = np.concatenate(
        [channels["position"], channels["quaternion"], np.zeros((len(distance), 15))], axis=1
    )
    trajectory = Trajectory(0.1 * np.arange(len(distance)), channels, ("cruise",), qpos)
    return sample_result(trajectory, scenario=scenario)


def test_the_camera_that_follows_looks_across_the_pipe():
    """In every plane: never along the pipe, never from far below, and without a jump."""
    result = chain_result()
    (way,) = result.routes()
    back = view_directions(result.trajectory, (way,), [0.1, -1.0, 0.4])
    tangent = way.centreline.at(result.trajectory["distance"])[1]
    assert np.allclose(np.linalg.norm(back, axis=1), 1.0)
    assert np.abs((back * tangent).sum(axis=1)).max() < 0.75
    assert np.abs((back * tangent).sum(axis=1)).mean() < 0.3
    assert np.linalg.norm(np.diff(back, axis=0), axis=1).max() < 0.12  # rad for 10 mm of travel
    assert (back[:, 2] > -0.5).all()


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
    assert needs_map(result.routes())
    for camera, has_map in (("side", False), ("follow", True), ("onboard", True)):
        mapped, bare = (
            render_frame(result, 3.0, camera, *SIZE, inset=wanted) for wanted in (True, False)
        )
        assert (mapped[10:60, 250:300] != bare[10:60, 250:300]).any() == has_map, camera
        assert (mapped[:, :200] == bare[:, :200]).all()


def test_map_shows_the_way_driven_so_far():
    """The way grows, its colour tells tail first from nose first, and the rest of the frame stays
    as it is."""
    result = two_legs_result()
    inset = Inset(
        result.trajectory, result.routes(), result.goal_points(), result.plate_rims(), 1280, 720
    )
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
    assert np.allclose(np.abs(projection(flat)), [[1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12)
    network = two_legs()[0].network
    view = projection(network)
    for part in network.parts:
        start, end = (part.port(port).position for port in part.fitting.port_names[:2])
        assert np.linalg.norm((end - start) @ view[:, :2]) > 0.4 * np.linalg.norm(end - start)


def test_overlay_names_fitting_and_gear():
    """Two fittings, and two gears, give different text; a long name is cut to the panel."""
    overlay, grey = Overlay(1280, 720), np.full((720, 1280, 3), 90, np.uint8)
    trajectory = two_legs_result().trajectory
    last = len(trajectory.time) - 1

    def written(shown: Trajectory, name: str) -> np.ndarray:
        frame = grey.copy()
        overlay.write(frame, shown, last, name)
        return frame

    named, long = (written(trajectory, name) for name in ("drop", "a_very_long_name_" * 5))
    assert (named != long).any()
    assert (long[:, 360:] == 90).all()
    channels = dict(trajectory.channels) | {"gear": np.ones(last + 1)}
    nose_first = Trajectory(trajectory.time, channels, trajectory.phases, trajectory.qpos)
    assert (written(nose_first, "drop") != named).any()
