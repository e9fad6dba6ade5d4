"""Films and pictures are drawn from a recorded trajectory."""

from __future__ import annotations

from types import SimpleNamespace

import av
import numpy as np
import pytest

from omnitrack_sim.errors import InputError, OutputError
from omnitrack_sim.frames import quaternion_from_matrix
from omnitrack_sim.render import render_frame, render_video
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.trajectory import CHANNELS, Trajectory

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
    line = scenario.route().centreline
    time = np.linspace(0.0, 1.0, 51, dtype=np.float64)
    distance = 0.1 + 0.5 * time
    channels = {name: np.zeros((len(time), *channel.shape)) for name, channel in CHANNELS.items()}
    position, frame = line.at(distance)[0], line.frame(distance)
    channels |= {"position": position, "quaternion": quaternion_from_matrix(frame), "distance": distance}
    channels["belt_speed"] = np.full((len(time), 3), 0.1)
    qpos = np.concatenate([position, channels["quaternion"], np.zeros((len(time), 15))], axis=1)
    return SimpleNamespace(scenario=scenario, trajectory=Trajectory(time, channels, ("straight",), qpos))


def test_film_has_the_length_size_and_codec_asked_for(result, tmp_path):
    """One second at 10 frames a second is 11 frames of H.264, odd sizes made even, and nothing else stays."""
    progress = []
    path = render_video(
        result, tmp_path / "run.mp4", width=319, height=179, fps=10, progress=lambda f, _: progress.append(f)
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


@pytest.mark.parametrize("camera", ["side", "follow", "onboard"])
def test_every_camera_sees_something_that_changes(result, camera):
    """Each camera gives a picture of the size asked for, not of one colour, and another one later in the run."""
    early, late = (render_frame(result, t, camera, *SIZE) for t in (0.0, 1.0))
    assert early.shape == (180, 320, 3)
    assert early.dtype == np.uint8
    assert early[:100].std() > 4
    assert np.abs(early[:100].astype(int) - late[:100]).max() > 20


def test_modules_show_in_three_colours(result):
    """At least two of orange, blue and green are in the picture that follows the robot; the third may be behind it."""
    frame = render_frame(result, 0.0, "follow", 640, 360).astype(int)[:, 180:]
    red, green, blue = frame[..., 0], frame[..., 1], frame[..., 2]
    orange = (red > 120) & (red > green + 40) & (green > blue + 30)
    teal = (green > red + 50) & (green > blue + 15)
    sky = (blue > red + 70) & (blue > green + 30)
    assert sorted(bool(c.sum() > 300) for c in (orange, teal, sky))[1:] == [True, True]


def test_all_faults_of_a_request_are_named():
    """An unknown camera and a size of zero are both told, with the cameras there are."""
    with pytest.raises(InputError) as caught:
        render_frame("nowhere", 0.0, "above", width=0)  # refused before anything is read
    assert [f.where for f in caught.value.faults] == ["camera", "width"]
    assert "follow" in str(caught.value)


def test_unwritable_film_is_a_clean_error(result, tmp_path):
    """A film into a folder that does not exist is an OutputError that names the file."""
    with pytest.raises(OutputError, match=r"missing/run.mp4"):
        render_video(result, tmp_path / "missing" / "run.mp4", width=64, height=36)
