"""Films and pictures are drawn from a recorded trajectory."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import av
import imageio.v3 as imageio
import numpy as np
import pytest
from film_samples import SIZE, elbow_result

import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError, OutputError
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.show.film.render import render_frame, render_frames, render_video
from omnitrack_sim.show.film.strip import FRAMES, composed, render_strip, strip_times


@pytest.fixture(scope="module")
def result():
    """One run for all films."""
    return elbow_result()


def test_film_has_the_length_size_and_codec_asked_for(result, tmp_path):
    """One second at 10 frames a second is 11 frames of H.264, odd sizes made even, and nothing else
    stays."""
    progress = []
    path = render_video(
        result,
        path=tmp_path / "run.mp4",
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
    path = render_video(result, path=tmp_path / "run.gif", width=319, height=179, fps=10)
    assert path.read_bytes()[:6] == b"GIF89a"
    with imageio.imopen(path, "r", plugin="pillow") as film:
        frames = film.read(index=...)
        assert film.metadata(index=0)["duration"] == 100
        assert film.metadata(index=0)["loop"] == 0
    assert frames.shape == (11, 180, 320, 3)
    for frame, time in ((0, 0.0), (10, 1.0)):
        still = render_frame(result, time=time, camera="side", width=SIZE[0], height=SIZE[1])
        assert np.abs(frames[frame].astype(int) - still).mean() < 2
    assert [p.name for p in tmp_path.iterdir()] == ["run.gif"]


def test_a_webm_is_vp9(result, tmp_path):
    """One second at 10 frames a second is 11 frames of VP9, which look as they should."""
    path = render_video(result, path=tmp_path / "run.webm", width=319, height=179, fps=10)
    with av.open(str(path)) as film:
        stream = film.streams.video[0]
        assert "webm" in film.format.name
        assert (stream.width, stream.height, stream.codec_context.name) == (*SIZE, "vp9")
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 11
    still = render_frame(result, time=1.0, camera="side", width=SIZE[0], height=SIZE[1])
    assert np.abs(frames[-1].astype(int) - still).mean() < 4
    assert [p.name for p in tmp_path.iterdir()] == ["run.webm"]


def test_a_picture_is_made_whatever_has_loaded_opengl_before(result, tmp_path):
    """PyOpenGL that a notebook has loaded for windows knows no offscreen context."""
    result.save(tmp_path / "run")
    picture = "ot.render_frame('run', time=0.1, width=64, height=48)"
    code = f"import OpenGL.GL, omnitrack_sim as ot; {picture}"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)


def test_same_run_same_film(result, tmp_path):
    """Rendered twice, the files are the same byte for byte; of other formats their encoders are
    tried on the same frames."""
    films = [
        render_video(result, path=tmp_path / f"{k}.mp4", width=64, height=36, fps=10)
        for k in range(2)
    ]
    assert films[0].read_bytes() == films[1].read_bytes()


@pytest.mark.parametrize("name", ["run.png", "run", "run.avi", "run.mp4.part", ".mp4"])
def test_other_formats_are_refused_before_anything_is_read(tmp_path, name):
    """With those there are."""
    with pytest.raises(InputError, match="choose from: mp4, webm, gif") as caught:
        render_video("nowhere", path=tmp_path / name)
    assert name in str(caught.value)


@pytest.mark.parametrize(
    ("ending", "size"),
    [("mp4", {"fps": 241}), ("gif", {"fps": 51}), ("mp4", {"width": 7681}), ("gif", {"height": 0})],
)
def test_sizes_and_rates_have_limits(tmp_path, ending, size):
    """Refused before anything is read."""
    with pytest.raises(InputError, match=rf"{next(iter(size))}: is .* must be from 1 to"):
        render_video("nowhere", path=tmp_path / f"run.{ending}", **size)


def test_all_faults_of_a_request_are_named():
    """An unknown camera and a size of zero are both told, with the cameras there are."""
    with pytest.raises(InputError) as caught:
        render_frame(
            "nowhere", time=0.0, camera="above", width=0
        )  # refused before anything is read
    assert [f.where for f in caught.value.faults] == ["camera", "width"]
    assert "follow" in str(caught.value)


@pytest.mark.parametrize(
    ("value", "camera"), [(np.nan, "side"), (np.inf, "follow"), (1e300, "onboard"), (1e300, "side")]
)
def test_a_run_that_diverged_stops_in_its_film(result, value, camera):
    """A sample without a pose shows the one before it."""
    plain = result.trajectory
    channels = {name: np.array(values) for name, values in plain.channels.items()}
    qpos = np.array(plain.qpos)
    for values in (channels["position"], channels["distance"], channels["belt_speed"], qpos):
        values[-5:] = value
    trajectory = Trajectory(plain.time, channels, plain.phases, qpos, plain.schema)
    broken = replace(result, trajectory=trajectory)
    end, sound = (
        render_frame(run, time=time, camera=camera, width=64, height=36).astype(int)
        for run, time in ((broken, 1.0), (result, plain.time[-6]))
    )
    assert np.abs(end - sound).mean() < 8  # the camera that follows turns a little earlier


def test_several_processes_make_the_same_film(result, tmp_path):
    """Byte for byte, by the camera that stands still, and nothing else stays."""
    films = [
        render_video(
            result,
            path=tmp_path / f"{n}.mp4",
            camera="side",
            width=64,
            height=36,
            fps=5,
            processes=n,
        )
        for n in (1, 2)
    ]
    assert films[0].read_bytes() == films[1].read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["1.mp4", "2.mp4"]


def test_a_strip_of_one_still_is_that_still_over_its_time():
    """A single picture has a letter and a time, too."""
    still = np.full((120, 160, 3), 40, np.uint8)
    sheet = np.asarray(composed([still], [1.0]))
    assert sheet.shape[1] == 160 + 2 * 3
    assert (sheet[3 : 3 + 120, 3:163] == 40).all()


def test_a_strip_has_its_stills_letters_and_times(result, tmp_path):
    """Six stills in two rows of three, on white paper; the first is the picture at its time."""
    path = render_strip(result, path=tmp_path / "strip.png", width=160, height=120)
    sheet = imageio.imread(path)
    assert sheet.shape == (2 * (120 + 10 + 3) + 3, 3 * 163 + 3, 3)
    assert (sheet[0] == 255).all()
    times = strip_times(result)
    assert len(times) == FRAMES
    assert times == sorted(times)
    (first,) = render_frames(
        result, times=times[:1], camera="side", width=160, height=120, inset=False, overlay=False
    )
    assert (sheet[3:123, 3:163] == first).all()
    assert sheet[124:132, 3:163].min() < 80  # letter and time


def test_a_strip_covers_the_fittings(result):
    """From just before the elbow to the end of the run, which ends in it or behind it."""
    (elbow,) = (passage for passage in result.timeline() if passage.kind == "elbow")
    times = strip_times(result, 4)
    assert times[0] == pytest.approx(max(0.0, elbow.time_enter_s - 0.3))
    end = result.duration_s if elbow.time_leave_s is None else elbow.time_leave_s + 0.3
    assert times[-1] == pytest.approx(min(end, result.trajectory.time[-1]))


def test_a_strip_covers_relief():
    """It begins just before a pipe with a weld, though that does not bend."""
    plain = {"kind": "straight", "length": 0.3}
    pipes = [plain, plain | {"relief": [{"kind": "weld", "at": 0.15}]}, plain]
    changes = {"pipes": pipes, "start.distance": 0.2, "run.time_limit": 1.5}
    welded = ot.run(ot.load_scenario("straight", changes))
    assert strip_times(welded, 3)[0] == pytest.approx(welded.timeline()[1].time_enter_s - 0.3)


def test_a_strip_shows_the_turn(result):
    """Stills share way and turns of the robot, so those of one that turns on the spot in a part of
    its time are in that part."""
    trajectory = result.trajectory
    time, span = trajectory.time, strip_times(result, 2)
    turning = (span[0] + 0.6 * (span[1] - span[0]), span[0] + 0.8 * (span[1] - span[0]))
    half = np.interp(time, turning, (0.0, np.pi / 4))
    quaternion = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1)
    still = np.repeat(trajectory["position"][:1], len(time), axis=0)
    channels = dict(trajectory.channels) | {"quaternion": quaternion, "position": still}
    turned = replace(result, trajectory=replace(trajectory, channels=channels))
    times = strip_times(turned, 6)
    assert [times[0], times[-1]] == span
    assert times == sorted(times)
    assert sum(turning[0] < t < turning[1] for t in times[1:-1]) >= 3


@pytest.mark.parametrize("ending", ["png", "jpg", "pdf"])
def test_same_run_same_strip(result, tmp_path, ending):
    """Made twice, the files are the same byte for byte."""
    strips = [
        render_strip(
            result,
            path=tmp_path / f"{k}.{ending}",
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
        render_strip(result, path=tmp_path / "strip.png", **asked)
    assert not list(tmp_path.iterdir())


def test_films_longer_than_anybody_waits_for_are_refused(result, tmp_path):
    """A run of a day at full size."""
    long = Trajectory(
        86400 * result.trajectory.time,
        result.trajectory.channels,
        result.trajectory.phases,
        result.trajectory.qpos,
        result.trajectory.schema,
    )
    with pytest.raises(
        InputError, match="frames: are 2160001 of 1280 x 720 pixels; at most 542534"
    ):
        render_video(replace(result, trajectory=long), path=tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


def test_unwritable_film_is_a_clean_error(result, tmp_path):
    """A film into a folder that does not exist is an OutputError that names the file."""
    with pytest.raises(OutputError, match=r"missing/run.mp4"):
        render_video(result, path=tmp_path / "missing" / "run.mp4", width=64, height=36)
