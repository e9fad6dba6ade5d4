"""A sweep's table does not depend on who ran it, and survives kills, damage, full disks and bad
trials."""

import dataclasses
import errno
import json
import math
import os
import shutil
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import omnitrack
from sweep_samples import (
    FILES,
    VALID,
    parts,
    same,
    small_sweep,
)

from omnitrack_sim import OutputError, SweepError, run, run_trials
from omnitrack_sim.base import writing
from omnitrack_sim.base.writing import whole_file
from omnitrack_sim.record.events import BackedOff, FellOff
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.robots.omnitrack.metrics import METRICS
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.trials import batches, dispatch, sweep_figure
from omnitrack_sim.trials.table import to_parquet

ALL = {*FILES, "parts"}


def columns_of(metric: Metric) -> list[str]:
    """Columns of a metric: one, or one for each module."""
    return [f"{metric.name}_{i}" for i in (1, 2, 3)] if metric.per_module else [metric.name]


def test_the_folder_holds_its_files(calm, table):
    """A finished sweep has its files and parts, nothing temporary, and a row a trial in order."""
    assert {path.name for path in calm.iterdir()} == ALL
    assert len(parts(calm)) == 4 == len(list((calm / "parts").iterdir()))
    assert table["trial"].to_pylist() == list(range(10))
    assert {"timed_out", "invalid"} == set(table["outcome"].to_pylist())
    assert len((calm / "trials.csv").read_text().splitlines()) == 11


def test_columns_and_units(table):
    """Axis columns, vectors by letter, results and every metric of a run; units in the fields."""
    names = table.schema.names
    assert names[:7] == [
        "trial",
        "control.kind",
        "world.friction",
        *(f"world.gravity_{c}" for c in "xyz"),
        "robot.preload",
    ]
    units = {
        field.name: (field.metadata or {}).get(b"unit", b"").decode() for field in table.schema
    }
    assert units["world.gravity_z"] == "m/s²"
    assert (units["robot.preload"], units["duration_s"], units["slip_ratio_mean_2"]) == (
        "N",
        "s",
        "1",
    )
    assert names[-4:] == ["attempts", "falls", "collider", "events"]
    invalid = table["outcome"].to_pylist().index("invalid")
    row = table.slice(invalid, 1).to_pylist()[0]
    assert "robot.preload" in row["reason"]
    assert row["duration_s"] is None
    assert row["scenario_sha256"] is None
    assert row["success"] is False


def test_a_row_is_what_the_run_of_its_scenario_gives(table):
    """A trial run alone has the numbers of its row: batches do not mix."""
    index = table["outcome"].to_pylist().index("timed_out")
    row = table.slice(index, 1).to_pylist()[0]
    result = run(small_sweep().scenario(index))
    assert row["scenario_sha256"] == result.scenario.hash
    assert (row["reason"], row["duration_s"]) == (result.reason, result.duration_s)
    assert (row["attempts"], row["falls"]) == (1, 0)
    for metric in result.scenario.robot.metrics:
        if metric.in_tables:
            values = [row[column] for column in columns_of(metric)]
            figure = result.metrics[metric.name]
            assert values == (figure if metric.per_module else [figure])


def test_every_metric_is_in_the_table(table):
    """The table has all metrics of a run but those that are left out on purpose: what slip reads
    without load, which sweeps do not measure, and the times of phases, which are no number."""
    (result,) = run_batch([small_sweep().scenario(VALID)], no_load=False)
    metrics = result.scenario.robot.metrics
    in_tables = {metric.name: columns_of(metric) for metric in metrics if metric.in_tables}
    assert set(in_tables) == set(result.metrics) - {
        "no_load_slip_m_s",
        "slip_excess",
        "phase_time_s",
    }
    assert {column for columns in in_tables.values() for column in columns} <= set(
        table.schema.names
    )
    assert np.isnan(result.metrics["no_load_slip_m_s"])  # type: ignore[arg-type]


def test_every_metric_says_what_it_is():
    """Each shipped metric has a meaning of its own, and its name ends in its unit."""
    assert len({metric.meaning for metric in METRICS}) == len(METRICS)
    endings = {"m/s": "m_s", "N m": "nm", "N m/s": "nm_s", "1": "", "°C": "c"}
    for metric in METRICS:
        assert metric.name.endswith(endings.get(metric.unit, metric.unit.lower())), metric.name


def test_summary_counts_without_the_invalid(calm, table):
    """Rates are over the trials with an outcome; invalid ones are told; groups add up to the
    whole."""
    summary = json.loads((calm / "summary.json").read_text())
    invalid = table["outcome"].to_pylist().count("invalid")
    assert (summary["trials"], summary["invalid"], summary["counted"]) == (
        10,
        invalid,
        10 - invalid,
    )
    assert summary["outcomes"] == {"invalid": invalid, "timed_out": 10 - invalid}
    (rows,) = summary["groups"].values()
    assert [row["value"] for row in rows] == ["jacobian", "equal"]
    assert sum(row["counted"] for row in rows) == summary["counted"]
    assert {"versions", "git_commit", "platform"} <= set(summary["made_by"][0])


def test_groups_of_every_kind_of_value():
    """Whole numbers, vectors and truth values are grouped, and stand in columns of their kind."""
    axes = [
        {"path": "robot.lugs_per_track", "kind": "grid", "start": 2, "stop": 3, "count": 2},
        {
            "path": "world.gravity",
            "kind": "list",
            "values": [[0, 0, -9.81], [0, 0, 0]],
            "labels": ["down", "none"],
        },
        {"path": "control.align", "kind": "list", "values": [True, False]},
        {"path": "robot.preload", "kind": "list", "values": [20, 30.5]},
    ]
    sweep = small_sweep(axes=axes, set={"run.time_limit": 0.02})
    table = run_trials(sweep).table
    kinds = [str(table.schema.field(name).type) for name in table.schema.names[1:7]]
    assert kinds == ["int64", "double", "double", "double", "bool", "double"]
    groups = sweep.summary(table)["groups"]
    assert [[row["value"] for row in rows] for rows in groups.values()] == [
        ["2", "3"],
        ["down", "none"],
        ["true", "false"],
        ["20", "30.5"],
    ]
    assert {row["counted"] for rows in groups.values() for row in rows} == {8}


def test_two_shards_in_one_folder_and_in_two(calm, tmp_path):
    """Shards in one folder finish it; parts of two folders copied together do too."""
    sweep = small_sweep()
    first = run_trials(sweep, out=tmp_path / "one", shard=(1, 2))
    assert 0 < first.table.num_rows < 10
    assert first.summary == {}
    assert not (tmp_path / "one" / "trials.parquet").exists()
    assert run_trials(sweep, out=tmp_path / "one", shard=(2, 2)).table.num_rows == 10
    assert same(calm, tmp_path / "one")
    for i in (1, 2):
        run_trials(sweep, out=tmp_path / f"share{i}", shard=(i, 2))
    (tmp_path / "both" / "parts").mkdir(parents=True)
    for file in [*parts(tmp_path / "share1"), *parts(tmp_path / "share2")]:
        (tmp_path / "both" / "parts" / file.name).write_bytes(file.read_bytes())
    run_trials(sweep, out=tmp_path / "both")
    assert same(calm, tmp_path / "both")


def test_nothing_is_written_without_a_folder(table, tmp_path, monkeypatch):
    """Without a directory the table comes back and no file appears."""
    monkeypatch.chdir(tmp_path)
    with ThreadPoolExecutor(2) as threads:
        assert run_trials(small_sweep(), executor=threads).table.equals(table)
        assert threads.submit(int).result() == 0  # a given executor is left open
    assert list(tmp_path.iterdir()) == []


def test_a_finished_sweep_runs_nothing_again(calm, monkeypatch):
    """The same call on a finished folder reads the table."""
    monkeypatch.setattr(dispatch, "run_rows", None)
    assert run_trials(small_sweep(), out=calm).status.found == 10


@pytest.mark.parametrize("damage", ["cut", "flip", "name", "empty", "other", "foreign"])
def test_a_damaged_part_is_run_again(calm, tmp_path, damage, monkeypatch):
    """A part is run again that is cut, has a wrong byte, in its rows or in a column's name, is
    empty, belongs to other trials, or to trials of the same numbers with other values."""
    figure = (calm / "success_map.png").read_bytes()
    monkeypatch.setattr(sweep_figure, "draw_map", lambda *_: figure)  # takes half a second
    place = tmp_path / "sweep"
    run_trials(small_sweep(), out=place, shard=(1, 2))
    file = parts(place)[0]
    whole = file.read_bytes()
    middle = len(whole) // 3
    flipped = whole[:middle] + bytes([whole[middle] ^ 0xFF]) + whole[middle + 1 :]
    other = next(one for one in parts(calm) if one.name != file.name).read_bytes()
    table = pq.read_table(file)
    zeros = pa.array([0.0] * table.num_rows)
    at = table.schema.get_field_index("energy_j")
    foreign = table.set_column(at, table.schema.field(at), zeros)
    foreign = foreign.replace_schema_metadata(table.schema.metadata | {b"part": b"0" * 16})
    named = whole.replace(b"energy_j", b"\x91nergy_j")
    files = {"cut": whole[:-100], "flip": flipped, "name": named, "empty": b"", "other": other}
    file.write_bytes((files | {"foreign": to_parquet(foreign)})[damage])
    run_trials(small_sweep(), out=place)
    assert same(calm, place)
    assert file.read_bytes() == whole


def test_another_sweep_is_refused_and_the_difference_named(calm):
    """A changed axis is named with both values."""
    other = small_sweep(samples=6, set={"run.time_limit": 0.2})
    with pytest.raises(OutputError, match="samples is 5 there and 6 here") as caught:
        run_trials(other, out=calm)
    assert "bases.straight.run.time_limit is 0.1 there and 0.2 here" in str(caught.value)
    assert "another folder" in str(caught.value)


def test_a_renamed_sweep_is_told_anew_and_not_run_again(calm, tmp_path, monkeypatch):
    """Name and groups of a finished sweep may change: summary and sweep.json follow, no trial is
    run."""
    place = shutil.copytree(calm, tmp_path / "sweep")
    monkeypatch.setattr(dispatch, "run_rows", None)
    run_trials(small_sweep(name="renamed", group_by=[]), out=place)
    summary = json.loads((place / "summary.json").read_text())
    assert (summary["name"], summary["groups"]) == ("renamed", {})
    assert json.loads((place / "sweep.json").read_text())["sweep"]["name"] == "renamed"
    run_trials(small_sweep(), out=place)
    assert same(calm, place)


def test_a_folder_with_other_files_is_refused(tmp_path):
    """A folder that is no sweep keeps its files; a file is no folder."""
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"thesis\.txt"):
        run_trials(small_sweep(), out=tmp_path)
    with pytest.raises(OutputError, match="is a file"):
        run_trials(small_sweep(), out=tmp_path / "thesis.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_leftovers_of_killed_runs_go_but_not_those_of_living_ones(tmp_path):
    """What a writer that lives is at stays; others' is removed."""
    place = tmp_path / "sweep"
    dead = place / "parts" / ".omnitrack-00000000.tmp"
    dead.mkdir(parents=True)
    (dead / "new").write_bytes(b"half")
    with whole_file(place / "parts" / "0123456789abcdef.parquet"):
        run_trials(small_sweep(), out=place, shard=(1, 4))
        assert not dead.exists()
        (alive,) = (place / "parts").glob(".omnitrack-*.tmp")
        (alive / "new").touch()


def test_an_exception_makes_one_row(calm, tmp_path, monkeypatch):
    """A trial that raises becomes a row with the exception; its companions have their usual
    rows."""
    usual = batches.run_batch
    bad = small_sweep().scenario(VALID).hash

    def run_batch(scenarios, **keys):
        if bad in [scenario.hash for scenario in scenarios]:
            raise ZeroDivisionError("a rare case")
        return usual(scenarios, **keys)

    monkeypatch.setattr(batches, "run_batch", run_batch)
    rows = run_trials(small_sweep(), out=tmp_path / "sweep").table.to_pylist()
    assert (rows[VALID]["outcome"], rows[VALID]["reason"]) == (
        "error",
        "ZeroDivisionError: a rare case",
    )
    expected = pq.read_table(calm / "trials.parquet").to_pylist()
    assert rows[:VALID] + rows[VALID + 1 :] == expected[:VALID] + expected[VALID + 1 :]
    summary = json.loads((tmp_path / "sweep" / "summary.json").read_text())
    assert summary["error"] == 1
    assert summary["counted"] == 10 - summary["invalid"] - 1
    assert summary["success_rate_95"][1] == wilson_interval(0, summary["counted"])[1]


def test_a_row_tells_attempts_and_falls_and_has_no_figure_that_is_not_finite(monkeypatch):
    """Each time that a robot has backed off is a further attempt, and falls are counted; of a
    diverged run the figures that are not finite are null."""
    usual = batches.run_batch

    def run_batch(scenarios, **keys):
        first, *others = usual(scenarios, **keys)
        figures = {"energy_j": math.inf, "slip_distance_m": [math.nan, 0.0, -math.inf]}
        events = [BackedOff(0, t, "tee_1", 0.5, 3.0) for t in (0.01, 0.05)]
        events += [FellOff(0, 0.07, "tee_1", "tee_1.run_end")]
        broken = {"metrics": first.metrics | figures, "events": events, "duration_s": math.nan}
        return [dataclasses.replace(first, **broken), *others]

    monkeypatch.setattr(batches, "run_batch", run_batch)
    rows = [
        row for row in run_trials(small_sweep()).table.to_pylist() if row["outcome"] != "invalid"
    ]
    broken = [row for row in rows if row["attempts"] == 3]
    assert 1 < len(broken) < len(rows)
    assert {(row["attempts"], row["falls"]) for row in rows} == {(1, 0), (3, 1)}
    for row in broken:
        columns = ("energy_j", "slip_distance_m_1", "slip_distance_m_2", "slip_distance_m_3")
        assert [row[column] for column in columns] == [None, None, 0.0, None]
        assert row["duration_s"] is None


def test_a_full_disk_keeps_the_finished_parts(calm, tmp_path, monkeypatch):
    """ENOSPC is told with what to do, leaves nothing half written, and the same call goes on."""
    usual, calls = os.fsync, []

    def fsync(descriptor):
        calls.append(descriptor)
        if len(calls) == 7:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        usual(descriptor)

    monkeypatch.setattr(writing.os, "fsync", fsync)
    with pytest.raises(OutputError, match=r"No space left on device.*goes on"):
        run_trials(small_sweep(), out=tmp_path / "sweep")
    assert len(parts(tmp_path / "sweep")) == 2
    assert not list((tmp_path / "sweep").rglob("*.tmp"))
    run_trials(small_sweep(), out=tmp_path / "sweep")
    assert same(calm, tmp_path / "sweep")


def test_a_sweep_of_invalid_trials_only_is_an_error(tmp_path):
    """When no trial fits, the error says why."""
    axis = {"path": "robot.preload", "kind": "grid", "start": -3, "stop": -1, "count": 2}
    with pytest.raises(SweepError, match=r"none of 2 trials is valid\nrobot\.preload"):
        run_trials(small_sweep(axes=[axis]), out=tmp_path / "sweep")
    assert not (tmp_path / "sweep" / "trials.parquet").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "tee_monte_carlo"),
        (["tee_orientation", "--set", "control.sped=1"], "control.sped"),
        (["tee_orientation", "--set", "start.theta5_deg=1"], "set by axes.0 too"),
        (["tee_orientation", "--shard", "3/2"], "--shard"),
        (["tee_orientation", "--continue"], "holds no sweep"),
        (
            ["tee_orientation", "--workers", "2", "--dask", "tcp://127.0.0.1:9"],
            "give one of the two",
        ),
    ],
)
def test_bad_arguments_end_with_status_2(tmp_path, arguments, told):
    """Bad arguments are named and leave no file."""
    done = omnitrack("sweep", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_list_shows_trials_and_runs_nothing(tmp_path):
    """--list tells number and first trials and writes nothing; the catalogue names the sweeps."""
    done = omnitrack("sweep", "tee_monte_carlo", "--list", cwd=tmp_path)
    assert "10000 trials in 313 batches of 1 model\n" in done.stdout
    assert "and 9990 more" in done.stdout
    assert list(tmp_path.iterdir()) == []
    assert "sweeps/tee_orientation" in json.loads(omnitrack("scenarios", "--json").stdout)
