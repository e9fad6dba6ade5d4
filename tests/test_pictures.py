"""Pictures of the robots' cameras: taken as they come, saved with the run, read back."""

from __future__ import annotations

import gc
import os
import pickle
from dataclasses import replace

import numpy as np
import pytest
from runs import same_record
from samples import two_legs_result

import omnitrack_sim as ot
from omnitrack_sim.base.writing import whole_folder
from omnitrack_sim.record.metrics import ESTIMATES
from omnitrack_sim.results.pictures import PICTURES_FILE, Album, Coding
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.show.film.overlay import (
    BAR_APART,
    BARS,
    CAMERA_GAP,
    CAMERA_HEIGHT,
    LEFT,
    MARGIN,
    MapPanel,
    levels,
    palette,
)
from omnitrack_sim.show.film.render import painted, render_frames
from omnitrack_sim.show.landmarks import Landmarks
from omnitrack_sim.show.run_playback import RunPlayback

CAMERAS = ("depth", "headlight")


def filmed(camera="depth", **changes):
    """One and a half seconds of a robot that drives by this camera."""
    base = {
        "run.time_limit": 1.5,
        "sensing.kind": "onboard",
        "sensing.camera": camera,
        "record.pictures": True,
    }
    more = {key.replace("__", "."): value for key, value in changes.items()}
    return ot.override(ot.load_scenario("tee_turn"), base | more)


@pytest.fixture(scope="module", params=CAMERAS)
def run(request):
    return ot.run(filmed(request.param))


@pytest.mark.parametrize("stride", [3, 4])
@pytest.mark.parametrize("camera", CAMERAS)
def test_a_run_is_the_same_with_and_without_its_pictures(camera, stride):
    """A robot compares the same pixels, exposed alike, whether the others are looked at or not."""
    limit = {"run__time_limit": 1.0, "sensing__filter__stride": stride}
    kept, plain = (ot.run(filmed(camera, record__pictures=p, **limit)) for p in (True, False))
    assert same_record(kept, plain)
    assert len(kept.pictures) == 11


@pytest.mark.parametrize("camera", CAMERAS)
def test_a_whole_picture_has_the_pixels_that_the_robot_compares(camera):
    """To the bit, with and without a record of whole pictures."""
    whole, part = (ot.Simulation([filmed(camera, record__pictures=p)]) for p in (True, False))
    assert whole.senses.picture.tobytes() == part.senses.picture.tobytes()
    assert np.isfinite(part.senses.picture).mean() > 0.8  # the rest are dropouts
    assert part.senses.pictures() == [None]
    assert whole.senses.pictures()[0] is not None


def test_pictures_are_of_the_pipe_ahead_and_behind(run):
    """Ten a second, from either end in turn; near walls at the rim, the far pipe in the middle."""
    pictures = run.pictures
    assert np.allclose(np.diff(pictures.time), 0.1)
    assert pictures.end.tolist() == [1, -1] * 8
    assert len(pictures) == 16
    picture = pictures[0]
    assert picture.shape == (48, 48)
    rim, middle = np.nanmean(picture[[0, -1]]), np.nanmean(picture[16:32, 16:32])
    if pictures.unit == "m":
        assert rim < 0.2 < middle
        assert np.isnan(picture).any()
    else:
        assert 0 <= middle < 0.5 * rim < rim <= 1


def test_pictures_are_saved_and_read_back(run, tmp_path):
    """Bit by bit; the same run gives the same bytes, and so does the run that was read back."""
    folder = run.save(tmp_path / "run")
    again = ot.load_result(folder)
    assert again.pictures.time.tobytes() == run.pictures.time.tobytes()
    assert again.pictures.end.tolist() == run.pictures.end.tolist()
    assert (again.pictures.unit, again.pictures.size) == (run.pictures.unit, 48)
    for one, other in zip(again.pictures, run.pictures, strict=True):
        assert one.tobytes() == other.tobytes()
    assert len(again.pictures[2:5]) == 3
    octets = (folder / PICTURES_FILE).read_bytes()
    again.save(tmp_path / "copy")
    ot.run(run.scenario).save(tmp_path / "anew")
    for place in ("copy", "anew"):
        assert (tmp_path / place / PICTURES_FILE).read_bytes() == octets


def test_pictures_can_be_handed_to_another_process(run, tmp_path):
    """Those in the temporary file as well as those of a folder."""
    run.save(tmp_path / "run")
    for pictures in (run.pictures, ot.load_result(tmp_path / "run").pictures):
        sent = pickle.loads(pickle.dumps(pictures))
        assert sent[3].tobytes() == pictures[3].tobytes()


def test_a_robot_has_the_same_pictures_alone_and_among_others():
    """Also where the others' runs end earlier or later than its own."""
    robots = [filmed(run__goal_distance=d) for d in (0.15, 0.22, 0.3)]
    alone = [ot.run(robot).pictures for robot in robots]
    lengths = [len(pictures) for pictures in alone]
    assert lengths[0] < lengths[2]
    for one, other in zip(alone, ot.run_batch(robots), strict=True):
        assert one.time.tobytes() == other.pictures.time.tobytes()
        assert one[-1].tobytes() == other.pictures[-1].tobytes()


def test_a_run_without_pictures_says_so():
    """Also where a robot has no camera at all."""
    result = ot.run(filmed(record__pictures=False, run__time_limit=0.1))
    with pytest.raises(ot.InputError, match=r"record\.pictures: is false: this run has recorded"):
        _ = result.pictures
    with pytest.raises(ot.InputError, match=r'record\.pictures: is true, .* = "onboard"'):
        filmed(sensing__kind="truth")


def test_a_folder_without_its_pictures_is_refused(run, tmp_path):
    """When it is read."""
    folder = run.save(tmp_path / "run")
    (folder / PICTURES_FILE).unlink()
    with pytest.raises(ot.OutputError, match=r"is no run: pictures\.parquet is missing"):
        ot.load_result(folder)


def test_damage_is_told_when_it_is_met(run, tmp_path):
    """A file whose end is missing when the run is read; a wrong byte when a picture is."""
    folder = run.save(tmp_path / "run")
    path, octets = folder / PICTURES_FILE, bytearray((folder / PICTURES_FILE).read_bytes())
    path.write_bytes(octets[:-20])
    with pytest.raises(ot.OutputError, match=r"pictures\.parquet: is damaged"):
        ot.load_result(folder)
    octets[len(octets) // 2] ^= 1
    path.write_bytes(octets)
    damaged = ot.load_result(folder).pictures
    with pytest.raises(ot.OutputError, match=r"pictures\.parquet: .* checksum"):
        _ = damaged[4]


def test_the_temporary_file_goes_with_its_last_reader(tmp_path, monkeypatch):
    """It has no name that a killed process could leave behind, and holds no file open for good."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    gc.collect()
    before = len(os.listdir("/proc/self/fd"))
    album = Album(Coding(48, "m"), 1)
    album.add(np.zeros(1), np.ones(1, int), np.full((1, 48 * 48), 0.5), np.ones(1, bool))
    assert os.listdir(tmp_path) == []
    (pictures,) = album.pictures()
    del album
    assert pictures[0][0, 0] == 0.5
    del pictures
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) == before


@pytest.mark.long
def test_ten_minutes_of_pictures_take_little_memory(tmp_path):
    """6000 pictures are kept and written by parts: no array of all of them is ever there."""
    import tracemalloc

    end, active = np.ones(1, int), np.ones(1, bool)
    noise = 0.3 + 0.01 * np.random.default_rng(1).standard_normal((1, 48 * 48))

    def write(count: int) -> None:
        album = Album(Coding(48, "m"), 1)
        for number in range(count):
            album.add(np.full(1, 0.1 * number), end, noise, active)
        (pictures,) = album.pictures()
        with whole_folder(tmp_path / f"run_{count}", "mark") as folder:
            pictures.write(folder / PICTURES_FILE)

    write(1)  # what is imported as a picture is written is none of it
    tracemalloc.start()
    write(6000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 12e6


def test_colours_tell_near_from_far_and_from_nothing():
    """Nearer, or brighter, is a higher level and a brighter colour."""
    depth, light = np.array([0.1, 0.2, 1.5, np.nan]), np.array([1.0, 0.4, 0.0])
    for picture, unit in ((depth, "m"), (light, "1")):
        found = levels(picture, unit)
        bright = palette(unit)[found].astype(int).sum(axis=-1)
        assert (np.diff(found.astype(int)) < 0).all()
        assert (np.diff(bright[:3]) < 0).all()
    assert levels(depth, "m")[3] == 0 < levels(depth, "m")[2]


def test_a_film_shows_what_the_robot_sees(run, tmp_path):
    """In a panel of its own and nowhere else; it changes with time, and is the same from a folder
    and in other processes."""
    size, times = (640, 360), [0.3, 1.2]
    height = BARS + 3 * BAR_APART + 6  # of the status panel
    with_panel = render_frames(run, times=times, camera="follow", width=size[0], height=size[1])
    without = render_frames(
        replace(run, album=None), times=times, camera="follow", width=size[0], height=size[1]
    )
    for seen, bare in zip(with_panel, without, strict=True):
        changed = np.argwhere((seen != bare).any(axis=-1))
        assert len(changed) > 5000
        (top, left), (bottom, right) = changed.min(axis=0), changed.max(axis=0)
        assert top >= (1 - (LEFT + height + CAMERA_GAP + CAMERA_HEIGHT + MARGIN) / 720) * 360
        assert left >= 8
        assert right <= 180
        assert bottom < 360 - 115
    panel = np.s_[135:225, 10:175]
    assert (with_panel[0][panel] != with_panel[1][panel]).mean() > 0.1
    saved = ot.load_result(run.save(tmp_path / "run"))
    assert (
        render_frames(saved, times=times, camera="follow", width=size[0], height=size[1])[1]
        == with_panel[1]
    ).all()
    if run.scenario.sensing.camera == "depth":  # processes take long to start
        spread = list(painted(RunPlayback(run), times, size, "follow", {"fine": True}, processes=2))
        assert (spread[1] == with_panel[1]).all()


def test_the_map_marks_where_the_robot_takes_itself_to_be():
    """By a ring where that is not where it is, and by nothing where it is."""
    result, believed = two_legs_result(), []
    for beside in (0.0, 0.3):
        channels = dict(result.trajectory.channels)
        channels["position_estimate"] = channels["position"] + [0.0, 0.0, beside]
        schema = {channel.name: channel for channel in (*RECORDED.values(), ESTIMATES[0])}
        trajectory = replace(result.trajectory, channels=channels, schema=schema)
        run = replace(result, trajectory=trajectory)
        inset = MapPanel(RunPlayback(run), Landmarks.of(run, trajectory), (1280, 720))
        frame = np.full((720, 1280, 3), 90, np.uint8)
        inset.write(frame, 900)
        blue = (frame[..., 2] > 200) & (frame[..., 0] < 150)
        believed.append(int(blue.sum()))
    assert believed[0] == 0
    assert 20 < believed[1] < 400


def test_the_summary_shows_errors_and_what_the_robot_claims(run):
    """A row more than of a robot that is told the truth; the band is two standard deviations."""
    figure = ot.plot_summary(run)
    errors = {axis.get_ylabel(): axis for axis in figure.axes[15:]}
    assert list(errors) == [
        "Error of the distance [mm]",
        "Error of theta5 [deg]",
        "Error of the tilt [deg]",
    ]
    assert len(ot.plot_summary(two_legs_result()).axes) == 15
    axis, channels = errors["Error of the distance [mm]"], run.trajectory.channels
    line = next(line for line in axis.lines if len(line.get_xdata()) == len(run.trajectory.time))
    error = channels["distance_estimate"] - channels["distance"]
    assert np.allclose(line.get_ydata(), 1e3 * error)
    band = axis.collections[-1].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(2e3 * channels["distance_std"].max())
