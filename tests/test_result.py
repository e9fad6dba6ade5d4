"""A run on disk: whole or not at all, the same bytes for the same run, and back again."""

from __future__ import annotations

import errno
import json
import time

import numpy as np
import pyarrow.parquet as pq
import pytest
from samples import sample_result, sample_trajectory

import omnitrack_sim as ot
from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.results import files
from omnitrack_sim.results.result import load_result
from omnitrack_sim.robots.kinds import DEFAULT, ROBOTS, robot_class
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.scenario import override

FILES = {"scenario.json", "result.json", "timeline.csv", "trajectory.parquet", "replay.npz"}
READ = FILES - {"timeline.csv"}
"""What a run is read back from; the timeline is derived."""


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_every_outcome_has_advice():
    """Each outcome says in one sentence what happened or what to try."""
    assert all(outcome.advice.endswith(".") for outcome in Outcome)
    assert len({outcome.advice for outcome in Outcome}) == len(Outcome)


@pytest.mark.parametrize("kind", sorted(set(ROBOTS) - {"mjcf"}))
def test_every_robot_has_advice_for_each_outcome(kind):
    """Its own, or that which holds for any robot."""
    robot = robot_class(kind)()
    for outcome in Outcome:
        advice = robot.advice(outcome)
        assert advice.endswith(".")
        if not issubclass(robot_class(kind), robot_class(DEFAULT)):
            assert advice == outcome.advice


def test_a_result_of_a_batch_is_saved_as_that_of_one_run(tmp_path):
    """Also where its arrays are parts of those of all robots."""
    scenario = ot.load_scenario("straight", {"run.time_limit": 0.1})
    alone = ot.run(scenario).save(tmp_path / "alone")
    for number, result in enumerate(ot.run_batch([scenario, scenario])):
        assert contents(result.save(tmp_path / str(number))) == contents(alone)


@pytest.mark.parametrize(
    ("expected", "outcome", "told"),
    [
        ("reached_goal", Outcome.REACHED_GOAL, True),
        ("reached_goal", Outcome.STUCK, False),
        ("stuck", Outcome.STUCK, True),
        (None, Outcome.STUCK, None),
    ],
)
def test_a_result_says_whether_it_was_expected(tmp_path, expected, outcome, told):
    """True where the outcome is that of ``run.expected_outcome``, None where nothing is expected;
    so it stands in result.json. Success is the goal, whatever was expected."""
    plain = sample_result(outcome=outcome)
    scenario = override(plain.scenario, {"run.expected_outcome": expected})
    result = sample_result(outcome=outcome, scenario=scenario)
    assert result.as_expected is told
    summary = json.loads((result.save(tmp_path / "run") / "result.json").read_text())
    assert summary["as_expected"] is told
    assert summary["success"] is (outcome is Outcome.REACHED_GOAL)


def test_round_trip(tmp_path):
    """A loaded run equals the saved one: scenario, outcome, figures, every channel and the
    replay."""
    saved = sample_result()
    loaded = load_result(saved.save(tmp_path / "run"))
    assert loaded.summary() == saved.summary()
    assert loaded.scenario == saved.scenario
    assert loaded.trajectory.phases == saved.trajectory.phases
    np.testing.assert_array_equal(loaded.trajectory.time, saved.trajectory.time)
    np.testing.assert_array_equal(loaded.trajectory.qpos, saved.trajectory.qpos)
    for name in RECORDED:
        np.testing.assert_array_equal(loaded.trajectory[name], saved.trajectory[name], err_msg=name)


def test_same_run_same_bytes(tmp_path, monkeypatch):
    """Two saves of equal runs are equal byte for byte, a year apart: no clock enters."""
    sample_result().save(tmp_path / "a")
    seconds, local, year = time.time, time.localtime, 365 * 86400.0
    monkeypatch.setattr(time, "time", lambda: seconds() + year)
    monkeypatch.setattr(time, "localtime", lambda at=None: local((at or seconds()) + year))
    sample_result().save(tmp_path / "b")
    assert set(contents(tmp_path / "a")) == FILES
    assert contents(tmp_path / "a") == contents(tmp_path / "b")


def test_columns_carry_units():
    """Column names tell module, track or axis apart."""
    assert RECORDED["contact_count"].columns[2:4] == (
        "contact_count_2_upper",
        "contact_count_2_lower",
    )
    assert RECORDED["position"].columns == ("position_x", "position_y", "position_z")
    assert RECORDED["contact_position"].columns[:3] == (
        "contact_position_1_x",
        "contact_position_1_y",
        "contact_position_1_z",
    )
    names = [column for channel in RECORDED.values() for column in channel.columns]
    assert len(names) == len(set(names))


def test_parquet_schema_holds_units(tmp_path):
    """Every column of the table has a unit in its metadata."""
    schema = pq.read_schema(sample_result().save(tmp_path / "run") / "trajectory.parquet")
    assert schema.field("belt_speed_1").metadata[b"unit"] == b"m/s"
    assert all(schema.field(name).metadata[b"unit"] for name in schema.names)


def test_a_folder_that_is_no_run_is_left_alone(tmp_path):
    """Saving into a folder of other files is refused and changes nothing."""
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="no run"):
        sample_result().save(tmp_path)
    assert contents(tmp_path) == {"notes.txt": b"mine"}


def test_a_file_in_the_way_is_left_alone(tmp_path):
    """Saving onto a file is refused."""
    (tmp_path / "out").write_text("mine")
    with pytest.raises(OutputError, match="is a file"):
        sample_result().save(tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"


def test_an_earlier_run_is_replaced_whole(tmp_path):
    """Nothing of an earlier run stays, not even files that the new one lacks."""
    sample_result().save(tmp_path / "run")
    (tmp_path / "run" / "video.mp4").write_bytes(b"old")
    sample_result(outcome=Outcome.STUCK).save(tmp_path / "run")
    assert set(contents(tmp_path / "run")) == FILES
    assert load_result(tmp_path / "run").outcome is Outcome.STUCK
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def full_disk(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("writer", ["_write_parquet", "npz_of"])
def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch, writer):
    """A disk that fills up is a clean error; no folder, half-written file or temporary stays."""
    monkeypatch.setattr(files, writer, full_disk)
    with pytest.raises(OutputError, match="No space left"):
        sample_result().save(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_keeps_the_earlier_run(tmp_path, monkeypatch):
    """Where a run stood before, it still stands, untouched."""
    sample_result().save(tmp_path / "run")
    before = contents(tmp_path / "run")
    monkeypatch.setattr(files, "npz_of", full_disk)
    with pytest.raises(OutputError):
        sample_result(outcome=Outcome.STUCK).save(tmp_path / "run")
    assert contents(tmp_path / "run") == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("missing", sorted(READ))
def test_a_missing_file_is_named(tmp_path, missing):
    """Loading a run that lacks a file names the file."""
    folder = sample_result().save(tmp_path / "run")
    (folder / missing).unlink()
    with pytest.raises(OutputError, match=missing):
        load_result(folder)


def test_result_json_is_strict(tmp_path):
    """A diverged run, whose figures are not numbers, still gives JSON that every reader takes."""
    broken = sample_trajectory(tilt=np.full(201, np.nan))
    folder = sample_result(
        broken, outcome=Outcome.DIVERGED, metrics={"tilt_max_deg": float("nan")}
    ).save(tmp_path / "run")

    def refuse(token):
        raise AssertionError(token)

    summary = json.loads((folder / "result.json").read_text(), parse_constant=refuse)
    assert summary["outcome"] == "diverged"
    assert summary["metrics"]["tilt_max_deg"] is None


@pytest.mark.parametrize("drive", ["three_motors", "differential"])
def test_columns_of_joint_positions_are_those_of_the_model(drive):
    """``result.joints`` names the joints of the scenario's model and where their positions are."""
    scenario = ot.load_scenario("straight", {"robot.drive": drive, "run.time_limit": 0.05})
    result, model = ot.run(scenario), scenario.to_spec().compile()
    joints = {model.joint(i).name: model.joint(i) for i in range(model.njnt)}
    assert result.qpos.shape == (len(result.trajectory.time), model.nq)
    assert {name: columns.start for name, columns in result.joints.items()} == {
        name: joint.qposadr[0] for name, joint in joints.items()
    }
