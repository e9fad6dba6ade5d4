"""Folders of runs whose files are damaged, exchanged or made up: refused with the file's name, or
read as a whole and valid run."""

from __future__ import annotations

import io
import json
import random
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from samples import JOINT_POSITIONS, sample_result, sample_trajectory

from omnitrack_sim import Result, load_scenario, override
from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import load_result
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.robots.omnitrack.events import NotAligned
from omnitrack_sim.scenario.model import sha256_of

READ = ("result.json", "scenario.json", "trajectory.parquet", "replay.npz")


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    return sample_result().save(tmp_path_factory.mktemp("runs") / "whole")


@pytest.fixture
def run(whole, tmp_path) -> Path:
    """A copy to be damaged."""
    return Path(shutil.copytree(whole, tmp_path / "run"))


def refused(folder: Path, name: str, told: str = ".") -> bool:
    """Whether a folder is refused with a message that names a file."""
    with pytest.raises(OutputError, match=told) as caught:
        load_result(folder)
    return name in str(caught.value)


@pytest.mark.parametrize("name", READ)
@pytest.mark.parametrize("data", [b"", b"damaged", b"\0" * 200, b"[" * 100_000, b"9" * 10_000])
def test_a_file_of_something_else_is_named(run, name, data):
    """Nothing, other bytes, nesting and numbers without end."""
    (run / name).write_bytes(data)
    assert refused(run, name)


@pytest.mark.parametrize("name", READ)
def test_a_file_that_is_cut_short_is_named(run, name):
    """At any place before the last character."""
    data = (run / name).read_bytes()
    for part in (0.1, 0.5, 0.9, 0.99):
        (run / name).write_bytes(data[: int(part * len(data))])
        assert refused(run, name)


def test_a_damaged_record_can_be_made_again_from_its_scenario(run):
    """The advice stands where the scenario is whole, and only there."""
    again = f"`omnitrack run {run}/scenario.json --out {run}` makes the run again"
    for name in ("replay.npz", "trajectory.parquet"):
        (run / name).write_bytes(b"damaged")
        assert refused(run, name, re.escape(again))
    (run / "scenario.json").write_bytes(b"damaged")
    with pytest.raises(OutputError) as caught:
        load_result(run)
    assert "omnitrack run" not in str(caught.value)


def loaded(folder: Path) -> Result | str:
    """A run, or why it cannot be read."""
    try:
        return load_result(folder)
    except OutputError as error:
        return str(error)


@pytest.mark.parametrize("name", READ)
def test_damage_is_refused_or_harmless(run, name, whole):
    """Wherever a few bytes are other ones, the file is named, or the record is still the same."""
    draw, data = random.Random(name), (run / name).read_bytes()
    expected = load_result(whole)
    for _ in range(60):
        damaged = bytearray(data)
        for _ in range(draw.choice((1, 1, 4))):
            damaged[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        (run / name).write_bytes(bytes(damaged))
        found = loaded(run)
        if isinstance(found, str):
            assert name in found or "trajectory.parquet" in found
            continue
        found.timeline()
        found.summary()
        assert all(
            np.array_equal(found.trajectory[channel], expected.trajectory[channel])
            for channel in RECORDED
        )
        assert found.scenario == expected.scenario


def test_the_joint_positions_are_those_of_the_model():
    """What is read as wide as the replay of a run is as wide as a model's."""
    model = load_scenario("straight").to_spec().compile()
    assert sample_trajectory().qpos.shape[1] == model.nq


def rewrite(run: Path, **changes) -> None:
    """Change keys of ``result.json``."""
    data = json.loads((run / "result.json").read_text())
    (run / "result.json").write_text(json.dumps(data | changes))


LEG = {
    "path": [[0, "start", "end"]],
    "gear": 1,
    "begin": 0.1,
    "end": 0.4,
    "goal": 0,
    "note": "to b",
}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"outcome": "flew"}, "outcome"),
        ({"outcome": ["stuck"]}, "outcome"),
        ({"reason": None}, "reason"),
        ({"duration_s": "4.0"}, "duration_s"),
        ({"duration_s": -1.0}, "duration_s"),
        ({"duration_s": 3.0}, "ends at 4.0"),
        ({"metrics": []}, "metrics"),
        ({"metrics": {"tilt_max_deg": "steep"}}, "tilt_max_deg"),
        ({"metrics": {"contact_fraction": [1.0, 1.0]}}, "contact_fraction"),
        ({"provenance": {}}, "not the scenario"),
        ({"events": {}}, "events"),
        ({"events": [{"kind": "Remark", "time": 1.0}]}, "words"),
        ({"events": [{"kind": "Rolled", "time": "soon", "text": ""}]}, "damaged"),
        ({"events": [{"kind": "Remark", "time": "soon", "words": "a"}]}, "damaged"),
        ({"events": [{"kind": [], "time": 1.0, "text": ""}]}, "damaged"),
        ({"legs": [LEG | {"gear": 2}]}, "gear"),
        ({"legs": [LEG | {"path": []}]}, "path"),
        ({"legs": [LEG | {"path": [[0, "start"]]}]}, "path"),
        ({"legs": [LEG | {"begin": None}]}, "begin"),
    ],
)
def test_every_field_of_the_summary_is_checked(run, changes, told):
    """Types and values of ``result.json``."""
    rewrite(run, **changes)
    assert refused(run, "result.json", told)


def test_a_leg_of_no_way_is_refused(tmp_path):
    """Of a mission, a way through parts that are not there is refused as the summary's fault."""
    scenario = override(load_scenario("missions/narrow"), {})
    leg = scenario.planner.first
    saved = sample_result(scenario=scenario, provenance=provenance_of(scenario), legs=(leg,))
    folder = saved.save(tmp_path / "run")
    assert load_result(folder).legs == (leg,)
    rewrite(folder, legs=[LEG | {"path": [[999, "start", "end"]]}])
    assert refused(folder, "result.json")
    rewrite(folder, legs=[LEG | {"path": [[0, "start", "nowhere"]]}])
    assert refused(folder, "result.json")
    rewrite(folder, legs=[])
    assert refused(folder, "trajectory.parquet", "legs")


@pytest.mark.parametrize("name", READ)
def test_a_file_of_another_run_is_named(run, tmp_path, name):
    """Of a run of other length in another pipe."""
    scenario = override(sample_result().scenario, {"world.friction": 0.5})
    other = sample_result(
        sample_trajectory(end=5.0), scenario=scenario, provenance=provenance_of(scenario)
    ).save(tmp_path / "other")
    shutil.copy(other / name, run / name)
    assert refused(run, "scenario.json" if name == "result.json" else name)


def changed(run: Path, **changes) -> None:
    """Write the run's table again with columns replaced; None takes one out."""
    path = run / "trajectory.parquet"
    table = pq.read_table(path)
    for name, values in changes.items():
        index = table.column_names.index(name)
        table = table.remove_column(index)
        if values is not None:
            table = table.add_column(index, name, [values])
    pq.write_table(table, path)


def bent(samples: int, row: int, value: float) -> np.ndarray:
    time = np.linspace(0.0, 4.0, samples)
    time[row] = value
    return time


@pytest.mark.parametrize(
    ("column", "values", "told"),
    [
        ("tilt", None, "columns"),
        ("tilt", ["steep"] * 201, "columns"),
        ("tilt", [None] + [0.0] * 200, "gaps"),
        ("phase", np.full(201, 3, np.int32), "phases"),
        ("phase", np.full(201, -1, np.int32), "phases"),
        ("leg", np.ones(201, np.int32), "legs"),
        ("gear", np.zeros(201), "gears"),
        ("time", bent(201, 5, np.nan), "times"),
        ("time", bent(201, 5, 0.0), "times"),
    ],
)
def test_columns_that_no_run_has_are_refused(run, column, values, told):
    """Missing ones, other types, gaps, codes without a meaning, time that stands or runs back."""
    changed(run, **{column: values})
    assert refused(run, "trajectory.parquet", told)


TIME = np.linspace(0.0, 4.0, 201)


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        (lambda: {"time": TIME}, "qpos"),
        (lambda: {"time": TIME, "qpos": np.zeros((201, 21))}, "shape"),
        (lambda: {"time": TIME, "qpos": np.zeros((200, JOINT_POSITIONS))}, "200 samples, not 201"),
        (lambda: {"time": TIME, "qpos": np.zeros((201, JOINT_POSITIONS), int)}, "holds int64"),
        (
            lambda: {"time": TIME, "qpos": np.zeros((2_000_000, JOINT_POSITIONS))},
            "not of the same run as trajectory.parquet: more",
        ),
        (lambda: {"time": TIME, "qpos": np.array([{}] * 201, object)}, "replay.npz"),
        (lambda: {"time": TIME + 1.0, "qpos": np.zeros((201, JOINT_POSITIONS))}, "times"),
    ],
)
def test_a_replay_of_other_arrays_is_refused(run, arrays, told):
    """Missing, too narrow, too short, of another type, a bomb, pickled, at other times."""
    np.savez_compressed(run / "replay.npz", **arrays())
    assert refused(run, "replay.npz", told)


def test_what_is_no_folder_of_a_run_is_told(run):
    """A folder that is not there, a file of a run, another file."""
    (run.parent / "notes.txt").write_text("words")
    for place, told in (
        (run.parent / "nothing", "no such folder"),
        (run / "result.json", f"is a file; a run is the folder of its files; {run} is one"),
        (run.parent / "notes.txt", "is a file; a run is the folder of its files"),
        (run.parent, "is no run: result.json is missing"),
    ):
        with pytest.raises(OutputError) as caught:
            load_result(place)
        assert str(caught.value) == f"{place}: {told}"


def test_a_replay_that_claims_more_than_there_is_is_refused(run):
    """An array's header says 8 TB."""
    header = io.BytesIO()
    claim = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    np.lib.format.write_array_header_1_0(header, claim)
    with zipfile.ZipFile(run / "replay.npz", "w") as archive:
        archive.writestr("time.npy", header.getvalue())
        archive.writestr("qpos.npy", header.getvalue())
    assert refused(run, "replay.npz")


def own_channels(run: Path, text: str) -> None:
    """Write the run's table again with other words about a user's own channels."""
    path = run / "trajectory.parquet"
    table = pq.read_table(path)
    metadata = table.schema.metadata | {b"own_channels": text.encode()}
    pq.write_table(table.replace_schema_metadata(metadata), path)


CHANNEL = {"name": "current", "unit": "A", "meaning": "", "frame": "", "shape": [], "vector": False}


@pytest.mark.parametrize(
    "changes",
    [
        {"shape": [10**9]},
        {"shape": [-1]},
        {"shape": 3},
        {"name": 5},
        {"name": "tilt"},
        {"extra": 1},
    ],
)
def test_own_channels_that_no_sensor_has_are_refused(run, changes):
    """Shapes beyond the table, names that are taken or no text, unknown keys."""
    own_channels(run, json.dumps([CHANNEL | changes]))
    assert refused(run, "trajectory.parquet")


def test_a_run_that_diverged_comes_back(tmp_path):
    """Its clock has begun anew, and its numbers are none."""
    broken = sample_trajectory(tilt=np.full(201, np.nan), distance=np.full(201, np.nan))
    saved = sample_result(broken, outcome=Outcome.DIVERGED, duration_s=0.004)
    loaded = load_result(saved.save(tmp_path / "run"))
    assert loaded.outcome is Outcome.DIVERGED
    assert loaded.timeline()[0].name == saved.timeline()[0].name


def test_a_users_own_channel_and_a_number_that_is_none_come_back(tmp_path):
    """Nothing of the checks refuses what a run may well hold."""
    plain = sample_trajectory()
    schema = {**RECORDED, "current": Channel("current", (2,), "A", "of two motors")}
    channels = {**plain.channels, "current": np.ones((201, 2)), "tilt": np.full(201, np.nan)}
    trajectory = Trajectory(plain.time, channels, plain.phases, plain.qpos, schema)
    event = NotAligned(0, 1.0, "tee", float("nan"), "not known")
    saved = sample_result(trajectory, events=[event], metrics={"own": [[1, True], "a"]})
    loaded = load_result(saved.save(tmp_path / "run"))
    assert loaded.trajectory.schema["current"] == schema["current"]
    assert loaded.metrics == {"own": [[1, True], "a"]}
    assert str(loaded.events[0]) == str(event)


def test_a_run_of_a_robot_whose_module_is_not_here_says_what_to_do(run):
    """Without trust its name is told; with it where the module is looked for, since the folder is
    not remembered, and the run is not called damaged for sure."""
    file = run / "scenario.json"
    scenario = json.loads(file.read_text(encoding="utf-8"))
    scenario["robot"] = {"kind": "no_such_rover:Rover"}
    file.write_text(json.dumps(scenario), encoding="utf-8")
    assert refused(run, "scenario.json", "is not the scenario that")  # before any name is followed
    result = json.loads((run / "result.json").read_text(encoding="utf-8"))
    rewrite(run, provenance=result["provenance"] | {"scenario_sha256": sha256_of(scenario)})
    assert refused(run, "scenario.json", "'no_such_rover:Rover', code that .* --trust")
    told = "names what is not here: robot.kind: .*no_such_rover.* add that to PYTHONPATH: "
    with pytest.raises(OutputError, match=told):
        load_result(run, trust=True)
