"""The benchmark of controllers: tasks, entries, figures, tables, and going on."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from policy_samples import driver

from omnitrack_sim.base.errors import InputError
from omnitrack_sim.cli import main
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval
from omnitrack_sim.trials import dispatch
from omnitrack_sim.trials.bench import (
    DRY,
    TASKS,
    Bench,
    Task,
    _drawn,
    entry_of,
    shipped_entries,
)
from omnitrack_sim.trials.bench_run import FILES, MEASURES, page, rows_of, run_bench


def _short(trials: int, changes: dict):
    """Begins of turns in the tee, of 0.3 s."""
    return _drawn("tee_turn", 1, DRY, trials, {**changes, "run.time_limit": 0.3})


SHORT = Task("short", "up the run for a moment", 4, 2, _short)


def _status(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["omnitrack", "bench-control", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code


def test_every_entry_can_drive_every_task_by_the_same_draws():
    entries = list(shipped_entries().values())
    sweeps = Bench(list(TASKS.values()), entries, quick=True).sweeps()
    assert len(sweeps) == len(TASKS) * len(entries)
    for task in TASKS:
        trials = [sweeps[task, entry.name].trials() for entry in entries]
        assert all(one == trials[0] for one in trials)
    kinds = {key: next(iter(sweep.bases.values())).control.kind for key, sweep in sweeps.items()}
    assert kinds["network", "equal"] == "equal"
    assert sweeps["turn", "earlier"].bases["tee_turn"].robot.motor.speed_bandwidth == 50.0
    assert sweeps["turn", "differential"].bases["tee_turn"].robot.drive == "differential"
    networks = sweeps["network", "feedback"].bases.values()
    assert len({scenario.network.model_dump_json() for scenario in networks}) == 4


def test_more_trials_are_so_many_of_each_task():
    """Drawn anew, but for networks, which are counted on."""
    tasks = [replace(TASKS["turn"], trials=20), replace(TASKS["network"], trials=3)]
    entries = [entry_of("feedback")]
    some, more = (Bench(tasks, entries, trials=trials).sweeps() for trials in (None, 5))
    assert [sweep.size for sweep in some.values()] == [20, 3]
    assert [sweep.size for sweep in more.values()] == [5, 5]
    friction = [s["turn", "feedback"].trials()["world.friction"] for s in (some, more)]
    assert not set(friction[0]) & set(friction[1])
    assert list(more["network", "feedback"].bases)[:3] == list(some["network", "feedback"].bases)


def test_dry_and_slippery_walls_do_not_overlap():
    sweeps = Bench([TASKS["turn"], TASKS["turn_slippery"]], [entry_of("feedback")]).sweeps()
    dry, wet = (sweep.trials()["world.friction"] for sweep in sweeps.values())
    assert len(dry) == len(wet) == 200
    assert min(dry) >= 0.7 >= max(wet) >= 0.69
    assert min(wet) >= 0.5


def test_it_goes_on_and_takes_further_entries(tmp_path, monkeypatch):
    """Only what is not there is run, also by two workers."""
    driver().save(tmp_path / "driver.npz")
    first = [entry_of("feedback"), entry_of(f"mine={tmp_path / 'driver.npz'}")]
    rows = run_bench(Bench([SHORT], first), out=tmp_path / "out").rows
    assert [row["entry"] for row in rows] == ["feedback", "mine"]
    assert rows[0]["others"] == "4 timed_out"
    with monkeypatch.context() as patch:
        patch.setattr(dispatch, "run_trials", lambda batch: pytest.fail("ran again"))
        assert run_bench(Bench([SHORT], first), out=tmp_path / "out").rows == rows
    told = []
    more = Bench([SHORT], [*first, entry_of("omnitrack_sim.paper.open_loop:EqualController")])
    again = run_bench(more, out=tmp_path / "out", workers=2, progress=told.append).rows
    assert again[:2] == rows
    assert again[2]["entry"] == "omnitrack_sim.paper.open_loop.EqualController"
    assert [(status.found, status.done) for status in (told[0], told[-1])] == [(8, 8), (8, 12)]
    for name in FILES:
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    table = pq.read_table(tmp_path / "out" / "trials.parquet")
    assert table.num_rows == 12
    assert table.column_names[:2] == ["task", "entry"]
    results = pq.read_table(tmp_path / "out" / "results.parquet")
    assert results.schema.field("energy_j").metadata[b"unit"] == b"J"
    assert json.loads((tmp_path / "out" / "bench.json").read_text())["rows"][0]["trials"] == 4


def _trials(seconds: list[float], outcomes: list[str]) -> pa.Table:
    """Table of trials that took so long, each with its outcome."""
    figures = {name: [1.0] * len(seconds) for measure in MEASURES for name in measure.columns}
    figures |= {"duration_s": seconds, "success": [one == "reached_goal" for one in outcomes]}
    return pa.table({"outcome": outcomes, **figures})


def test_rates_and_paired_differences():
    """Of time only over trials that both passed; what did not run does not count."""
    default = _trials([10.0, 11.0, 12.0, 50.0, 50.0], ["reached_goal"] * 3 + ["stuck"] * 2)
    other = _trials(
        [9.0, 10.5, 50.0, 4.0, math.nan],
        ["reached_goal", "reached_goal", "stuck", "reached_goal", "error"],
    )
    plain, paired = rows_of({("turn", "feedback"): default, ("turn", "other"): other})
    assert (plain["passed"], plain["trials"], plain["duration_s"]) == (3, 5, 11.0)
    assert "success_more" not in plain
    assert (paired["passed"], paired["trials"]) == (3, 4)
    assert paired["others"] == "1 error, 1 stuck"
    assert paired["success_more"] == 0.0
    assert (paired["success_more_low"], paired["success_more_high"]) == paired_rate_interval(
        1, 1, 4
    )
    assert paired["duration_s_more"] == pytest.approx(-0.75)
    assert paired["duration_s_more_low"] < -0.75 < paired["duration_s_more_high"]
    written = page(Bench([SHORT], [entry_of("feedback")]), [plain | {"task": "short"}])
    assert "| `feedback` | 3 of 5 |" in written
    assert "entry less" not in written


def test_intervals():
    """Bonett and Price's own form, and Student's t of 1, 2, 3."""
    assert paired_rate_interval(0, 0, 0) == (-1.0, 1.0)
    low, high = paired_rate_interval(20, 5, 98)
    half = 1.959964 * math.sqrt((0.21 + 0.06 - 0.15**2) / 100)
    assert (low, high) == pytest.approx((0.15 - half, 0.15 + half), abs=1e-6)
    assert paired_rate_interval(5, 20, 98) == pytest.approx((-high, -low))
    assert mean_interval([1.0, 2.0, 3.0]) == pytest.approx((2 - 2.48414, 2 + 2.48414), abs=1e-4)
    assert all(map(math.isnan, mean_interval([1.0])))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--task", "trun"], "did you mean 'turn'"),
        (["--entry", "feedbck"], "did you mean 'feedback'"),
        (["--entry", "xyz"], "jacobian, paper, driven, policy, module:Object"),
        (["--entry", "no_such:Thing"], "module 'no_such' cannot be imported"),
        (["--entry", "missing.npz"], "no such file, nor a shipped policy"),
        (["--entry", "a/b=equal"], "has no name for a folder"),
        (["--entry", "equal", "--entry", "equal=paper"], "is the name of two"),
        (["--trials", "12"], "is the number of trials; leave out --quick"),
    ],
)
def test_bad_arguments_are_refused(tmp_path, monkeypatch, capsys, arguments, told):
    out = tmp_path / "out"
    assert _status(monkeypatch, "--quick", "--out", str(out), *arguments) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


def test_folders_of_something_else_are_left_alone(tmp_path, monkeypatch, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert _status(monkeypatch, "--quick", "--out", str(tmp_path)) == 2
    assert "holds files but no bench.json" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_an_entry_that_cannot_drive_is_refused_before_any_trial():
    with pytest.raises(InputError, match="one of each at least"):
        Bench([SHORT], [])
