"""Sweeps read back from their folders, and single trials of them run again."""

import json
import shutil
from pathlib import Path

import pyarrow as pa
import pytest
from commands import omnitrack
from sweep_samples import VALID, parts, small_sweep, write_sweep

import omnitrack_sim as ot
from omnitrack_sim.cli import runs as cli_runs
from omnitrack_sim.trials import dispatch
from omnitrack_sim.trials.store import _differences
from omnitrack_sim.trials.table import failures


@pytest.fixture
def place(calm, tmp_path) -> Path:
    """A copy of a finished sweep."""
    return Path(shutil.copytree(calm, tmp_path / "sweep"))


def test_a_finished_sweep_is_read_back_as_it_was_run(calm, monkeypatch):
    """Plan, table, summary and progress; nothing is run and no file touched."""
    monkeypatch.setattr(dispatch, "run_rows", None)
    before = {path: path.stat().st_mtime_ns for path in calm.rglob("*")}
    read = ot.load_sweep_result(calm)
    assert {path: path.stat().st_mtime_ns for path in calm.rglob("*")} == before
    ran = ot.run_trials(small_sweep(), out=calm)
    assert (read.plan, read.plan.hash) == (ran.plan, ran.plan.hash)
    assert read.table.equals(ran.table)
    assert (read.summary, read.folder, read.status) == (ran.summary, calm, ran.status)


def test_of_many_differences_five_are_told_and_the_others_counted():
    """In a line; keys that may differ are none, and without any the program is another one."""
    ours = dict.fromkeys("abcdefg", 1)
    there = dict.fromkeys("abcdefg", 0)
    for count, rest in ((5, ""), (6, " and 1 more"), (7, " and 2 more")):
        told = _differences(there, ours, "abcdefg"[count:])
        assert told == ", ".join(f"{name} is 0 there and 1 here" for name in "abcde") + rest
    assert "another version" in _differences(there, ours, "abcdefg")


def test_an_unfinished_sweep_has_the_trials_that_are_done(place, table):
    """Of the batches that are there, in order; a figure of all trials is refused."""
    (place / "trials.parquet").unlink()
    gone = parts(place)[0]
    gone.unlink()
    read = ot.load_sweep_result(place)
    there = read.table["trial"].to_pylist()
    assert len(there) == read.status.done == read.status.found < 10
    assert there == sorted(there)
    assert read.table.select(["scenario_sha256"]).equals(
        table.take(there).select(["scenario_sha256"])
    )
    assert read.summary == {}
    with pytest.raises(ot.InputError, match=f"has {len(there)} of 10 trials"):
        ot.plot_sweep(place)


def test_a_folder_of_a_sweep_is_drawn(calm):
    """As its result is."""
    (axis,) = ot.plot_sweep(calm, over="world.friction").axes
    (same,) = ot.plot_sweep(ot.load_sweep_result(str(calm)), over="world.friction").axes
    assert axis.lines[0].get_xydata().tolist() == same.lines[0].get_xydata().tolist()


@pytest.mark.parametrize(
    ("file", "text", "told"),
    [
        ("sweep.json", None, "holds no sweep: sweep.json is missing"),
        ("sweep.json", "{", "sweep.json: is no description of a sweep"),
        ("sweep.json", '{"sha256": "0", "sweep": {"axes": []}}', "it is not the sweep of its hash"),
        ("trials.parquet", "x", "trials.parquet: is damaged"),
        ("summary.json", "[", "summary.json: cannot be read"),
        ("summary.json", '{"sha256": "0"}', "summary.json: is of another sweep"),
    ],
)
def test_a_damaged_folder_names_its_file(place, file, text, told):
    """And what is the matter with it."""
    (place / file).unlink()
    if text is not None:
        (place / file).write_text(text)
    with pytest.raises(ot.OutputError, match=told):
        ot.load_sweep_result(place)


def test_a_table_of_another_sweep_is_refused(place, tmp_path):
    """Though it is whole."""
    other = ot.run_trials(small_sweep(seed=1), out=tmp_path / "other")
    assert other.folder is not None
    shutil.copy(other.folder / "trials.parquet", place)
    with pytest.raises(ot.OutputError, match=r"trials\.parquet: is of another sweep"):
        ot.load_sweep_result(place)


def test_who_gives_the_folder_of_a_sweep_elsewhere_is_told_who_takes_it(calm):
    """Readers of runs, of scenarios and of sweep files name the two that do."""
    for read in (ot.load_result, ot.load_scenario, ot.load_sweep):
        with pytest.raises(ot.OmnitrackError, match=r"load_sweep_result.*omnitrack run .* --trial"):
            read(calm)
    with pytest.raises(ot.SweepError, match="load_sweep_result"):
        ot.load_sweep(calm / "sweep.json")
    with pytest.raises(TypeError, match=r"such as ot\.load_sweep_result or ot\.run_trials makes"):
        ot.plot_sweep(3)


@pytest.mark.parametrize("of", ["file", "folder"])
def test_a_trial_is_run_again_as_a_run(calm, table, tmp_path, of):
    """By the file or the folder of its sweep, to the numbers of its row, in a folder of its own."""
    source = write_sweep(tmp_path).name if of == "file" else str(calm)
    command = ("run", source, "--trial", str(VALID), "--no-video", "--json")
    done = omnitrack(*command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    row = table.slice(VALID, 1).to_pylist()[0]
    (folder,) = (tmp_path / "out").iterdir()
    assert folder.name == f"small_{VALID}"
    result = ot.load_result(folder)
    assert result.scenario.hash == row["scenario_sha256"]
    assert json.loads(done.stdout)["reason"] == row["reason"] == result.reason
    assert result.metrics["energy_j"] == row["energy_j"]


def test_changes_of_a_trial_come_on_top(calm, tmp_path):
    """Of those that the sweep makes."""
    command = ("run", str(calm), "--trial", str(VALID), "--no-video", "--out", "x")
    assert omnitrack(*command, "--set", "run.time_limit=0.06", cwd=tmp_path).returncode == 0
    again = ot.load_result(tmp_path / "x")
    own = small_sweep().scenario(VALID)
    assert again.scenario == ot.override(own, {"run.time_limit": 0.06})


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("SWEEP", "--trial", "10"), "--trial: is 10; small has trials 0 to 9"),
        (("tee_turn", "--trial", "1"), "is a scenario, not a sweep"),
        ((".", "--trial", "1"), "holds no sweep"),
    ],
)
def test_a_trial_that_there_is_not_is_refused(tmp_path, arguments, told):
    """Exit status 2, and nothing is written."""
    file = write_sweep(tmp_path)
    done = omnitrack("run", *(str(file) if a == "SWEEP" else a for a in arguments), cwd=tmp_path)
    assert done.returncode == 2
    assert told in " ".join(done.stderr.split())
    assert not (tmp_path / "out").exists()


def test_a_scenario_is_run_by_name(tmp_path):
    """As the same one that was loaded; a folder or number is refused."""
    file = tmp_path / "mine.json"
    short = ot.load_scenario("straight", {"run.time_limit": 0.06})
    file.write_text(short.model_dump_json())
    assert ot.run(file, no_load=False).scenario == short
    with pytest.raises(ot.ScenarioError, match="did you mean 'straight'"):
        ot.run("straigth")
    with pytest.raises(TypeError, match=r"scenario: is 3, of type int; it must be an ot\.Scenario"):
        ot.run(3)  # type: ignore[arg-type]


def test_a_renamed_sweep_reads_the_table_of_before(place, table):
    """Its name is no part of what ties the two."""
    ot.run_trials(small_sweep(name="other"), out=place)
    read = ot.load_sweep_result(place)
    assert read.plan.name == "other"
    assert read.table.equals(table)


def test_failed_trials_are_filmed_one_of_each_outcome_first(place, monkeypatch):
    """Each is a run of its own below the sweep, which stays as it is; a second time nothing is
    made again."""
    monkeypatch.setattr(cli_runs, "filmed", lambda _, target, *__: target.write_bytes(b"film"))
    before = {path.name: path.read_bytes() for path in place.iterdir() if path.is_file()}
    file = write_sweep(place.parent)
    command = ("sweep", str(file), "--out", str(place), "--film-failed", "2", "--workers", "1")
    done = omnitrack(*command)
    assert done.returncode == 0, done.stderr
    table = ot.load_sweep_result(place).table
    folders = sorted((place / "failed").iterdir())
    assert [folder.name for folder in folders] == [f"trial_{n}" for n in failures(table, 2)]
    for folder in folders:
        row = table.slice(int(folder.name.removeprefix("trial_")), 1).to_pylist()[0]
        run = ot.load_result(folder)
        assert (run.scenario.hash, run.outcome) == (row["scenario_sha256"], row["outcome"])
        assert {"video.mp4", "replay.html", "summary.png"} <= {one.name for one in folder.iterdir()}
    assert {p.name: p.read_bytes() for p in place.iterdir() if p.is_file()} == before
    monkeypatch.setattr(ot, "run", None)
    assert omnitrack(*command).returncode == 0


def test_failures_are_taken_in_turn_by_outcome():
    """Not those that passed, were invalid or broke."""
    outcomes = ["stuck", "stuck", "reached_goal", "lost", "invalid", "stuck", "error", "lost"]
    table = pa.table(
        {
            "trial": [*range(8)],
            "outcome": outcomes,
            "success": [one == "reached_goal" for one in outcomes],
        }
    )
    assert failures(table, 10) == [0, 3, 1, 7, 5]
    assert failures(table, 3) == [0, 3, 1]


def test_the_batch_may_be_chosen(tmp_path, place, table):
    """In a sweep, the trials of a study, a bench and a passport; the table is the same, and a
    folder with another one is refused."""
    sweep = ot.load_sweep(write_sweep(tmp_path), batch=2)
    assert {len(batch.trials) for batch in sweep.batches()} <= {1, 2}
    assert ot.run_trials(sweep).table.equals(table)
    assert {one.batch for one in ot.load_study("controller_gains", batch=5).trials} == {5}
    command = ("sweep", "small.toml", "--out", str(place), "--batch", "2")
    bench = ot.Bench.of("mobility", ["tee_into"], ["presser"], quick=True, batch=1)
    (own,) = bench.sweeps().values()
    assert isinstance(own, ot.Sweep)
    assert {len(batch.trials) for batch in own.batches()} == {1}
    assert bench.hash != ot.Bench.of("mobility", ["tee_into"], ["presser"], quick=True).hash
    assert ot.PassportPlan.of("presser", courses=["straight"], batch=3).sweep.batch == 3
    refused = omnitrack(*command, cwd=tmp_path)
    assert refused.returncode == 2
    assert "batch is 3 there and 2 here" in " ".join(refused.stderr.split())
    assert omnitrack("sweep", "small.toml", "--batch", "5000", cwd=tmp_path).returncode == 2
