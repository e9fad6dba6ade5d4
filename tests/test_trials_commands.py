"""Commands that run trials print what their tables hold: sweeps, their plans, benches."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import pyarrow as pa
import pytest
from sweep_samples import write_sweep
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import out
from omnitrack_sim.cli.trials import _print_bench, _print_study
from omnitrack_sim.record.statistics import wilson_interval


@pytest.fixture(autouse=True)
def wide(monkeypatch):
    """A terminal on which no line is wrapped, whatever made the console before."""
    monkeypatch.setattr(out, "_width", 200)


def printed(*arguments: object) -> list[list[str]]:
    """The cells of each line that a command prints."""
    run = CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "200"})
    assert run.exit_code == 0, run.output
    return cells(run.stdout)


def cells(text: str) -> list[list[str]]:
    return [re.split(r" {2,}", line.strip()) for line in text.splitlines() if line.strip()]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The file of a small sweep, of which some trials are invalid, and the folder it is in."""
    folder = tmp_path_factory.mktemp("commands")
    file = write_sweep(folder, samples=4)
    ot.run_trials(ot.load_sweep(str(file)), out=folder / "done")
    return file, folder / "done"


def test_a_sweep_prints_its_rates_by_group(done):
    """All, then each value of a list; with Wilson's interval, outcomes, and what does not count."""
    file, place = done
    rows = printed("sweep", file, "--out", place)
    summary = json.loads((place / "summary.json").read_text())
    table = ot.load_sweep_result(place).table.to_pylist()

    def rate(chosen):
        counted = [row for row in chosen if row["outcome"] not in ("invalid", "error")]
        passed = sum(row["success"] for row in counted)
        low, high = wilson_interval(passed, len(counted))
        share = f"{100 * passed / len(counted):.2f} %" if counted else "-"
        return [str(passed), str(len(counted)), share, f"{100 * low:.2f} to {100 * high:.2f} %"]

    begin = rows.index(["group", "passed", "of", "rate", "95 % interval"])
    expected = [["all", *rate(table)]]
    for kind in ("jacobian", "equal"):
        own = [row for row in table if row["control.kind"] == kind]
        expected.append([f"control.kind = {kind}", *rate(own)])
    assert rows[begin + 1 : begin + 4] == expected
    ends, left_out, saved = (" ".join(row) for row in rows[begin + 4 : begin + 7])
    assert ends == ", ".join(f"{count} {name}" for name, count in summary["outcomes"].items())
    assert summary["invalid"] > 0
    assert left_out == f"not in the rates: {summary['invalid']} invalid, {summary['error']} error"
    assert saved == f"saved in {place}"


def test_a_share_of_a_sweep_says_how_far_it_is(done, tmp_path):
    """Trials of this share, and how many there are."""
    file, _ = done
    rows = printed("sweep", file, "--out", tmp_path / "half", "--shard", "1/2", "--workers", "1")
    (line,) = [" ".join(row) for row in rows if row[0].startswith("of this share")]
    size = ot.load_sweep(str(file)).size
    found = re.fullmatch(r"of this share (\d+) trials done; .* all (\d+) are in .*half", line)
    assert found
    assert 0 < int(found[1]) < size == int(found[2])


def test_a_plan_is_listed_by_its_trials(done):
    """How many, in how many batches of how many models; each trial with its values."""
    file, _ = done
    sweep = ot.load_sweep(str(file))
    rows = printed("sweep", file, "--list")
    batches = sweep.batches()
    models = len({batch.model for batch in batches})
    words = f"{sweep.size} trials in {len(batches)} batches of {models} model"
    assert " ".join(rows[0]).startswith(words)
    (begin,) = [i for i, row in enumerate(rows) if row == ["trial", "values"]]
    values = sweep.trials()
    for trial, row in enumerate(rows[begin + 1 : begin + 1 + sweep.size]):
        assert row[0] == str(trial)
        assert f"world.friction = {values['world.friction'][trial]:.6g}" in row[1]
        assert f"control.kind = {values['control.kind'][trial]}" in row[1]


def test_a_bench_prints_a_table_a_course(capsys, tmp_path):
    """Entries with what passed and its interval, and only figures that some row has."""
    planned = ot.Bench.of("control", ["turn"], ["feedback", "equal"], trials=2)
    rows = [
        {"course": "turn", "entry": "feedback", "passed": 2, "trials": 2, "success": 1.0}
        | {"success_low": 0.342, "success_high": 1.0, "energy_j": 9.318},
        {"course": "turn", "entry": "equal", "passed": 1, "trials": 2, "success": 0.5}
        | {"success_low": 0.095, "success_high": 0.905, "energy_j": None},
    ]
    assert "energy_j" in planned.suite.heads
    result = type("Result", (), {"summary": {"rows": rows}})
    _print_bench(planned, result, tmp_path / "bench")
    text = capsys.readouterr().out
    lines = cells(text)
    assert "turn: " in text
    print(lines)
    assert ["feedback", "2 of 2", "34 to 100", "9.32"] in lines
    assert ["equal", "1 of 2", "10 to 90", "-"] in lines
    assert lines[-1][0].startswith("saved in ")


def candidate(number: int, energy: float | None, passed: int, **values: float) -> dict:
    figures = {"energy_j": energy, "passed": passed, "trials": 8}
    return {"number": number, "search": figures, "check": None, "values": values}


@pytest.mark.parametrize(
    ("front", "told"),
    [
        ([3, 5], "candidate 5 of 40; 2 on the front of the search"),
        ([3], "2 on the front of the search, not this one, which is the best in the check"),
        ([], "none has a value in every objective, so none is better than the start"),
    ],
)
def test_a_study_prints_its_start_beside_its_best(front, told, capsys, tmp_path):
    """Figures, shares and values of both, to six digits; "-" for none, and no row for a check that
    there was not; which candidate it is, and where its values are."""
    start = candidate(0, None, 2, **{"robot.preload": 25.0})
    best = candidate(5, 9.3184567, 7, **{"robot.preload": 1e-7})
    best["check"] = start["check"] = {"energy_j": 10.0, "passed": 1, "trials": 9}
    summary = {"start": start, "best": best, "on_front": 2, "candidates": 40}
    result = SimpleNamespace(
        summary=summary, tables={"front": pa.table({"number": pa.array(front, pa.int64())})}
    )
    _print_study(SimpleNamespace(columns=("energy_j",)), result, tmp_path / "study")
    text = capsys.readouterr().out
    lines = cells(text)
    for row in (
        ["energy_j", "-", "9.31846"],
        ["energy_j, other trials", "10", "10"],
        ["passed", "2 of 8", "7 of 8"],
        ["passed, other trials", "1 of 9", "1 of 9"],
        ["robot.preload", "25", "1e-07"],
    ):
        assert row in lines
    assert told in " ".join(text.split())
    start["check"] = best["check"] = None
    _print_study(SimpleNamespace(columns=("energy_j",)), result, tmp_path / "study")
    assert "other trials" not in capsys.readouterr().out
