"""A study's history does not depend on who ran it, survives kills, and loses nothing."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from commands import omnitrack
from study_samples import explore, small_study, study_data, write_study
from sweep_samples import GATED, parts
from test_sweep_workers import started, wait_for_parts, wait_until_gone
from typer.testing import CliRunner

from omnitrack_sim import OutputError, StudyError, load_scenario, load_study, override, run_trials
from omnitrack_sim.cli import app
from omnitrack_sim.cli.common import with_changes
from omnitrack_sim.cli.trials import _print_study
from omnitrack_sim.show.plots.style import PictureWarning
from omnitrack_sim.trials import dispatch, study
from omnitrack_sim.trials.search import Measured
from omnitrack_sim.trials.search_plan import Objective
from omnitrack_sim.trials.study import _unit_of_objective

FILES = {
    "study.json",
    *(
        f"{name}.{end}"
        for name in ("trials", "history", "front", "final")
        for end in ("parquet", "csv")
    ),
    "front.png",
    "best.toml",
    "summary.json",
    "parts",
    "values",
}


def bytes_of(place: Path) -> dict[str, bytes]:
    """Every file of a folder by its path in it."""
    return {
        str(path.relative_to(place)): path.read_bytes()
        for path in sorted(place.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def calm(tmp_path_factory) -> Path:
    """The small study, run in one process without interruption."""
    place = tmp_path_factory.mktemp("studies") / "calm"
    run_trials(small_study(), out=place)
    return place


def test_the_folder_holds_its_files(calm):
    """A finished study has its files, nothing temporary, and a row a candidate with units."""
    assert {path.name for path in calm.iterdir()} == FILES
    table = pq.read_table(calm / "history.parquet")
    assert table["number"].to_pylist() == list(range(19))
    assert table["generation"].to_pylist() == [1] * 9 + [2] * 8 + [3] * 2
    assert table["search"].to_pylist() == [0, *[1] * 4, *[2] * 4] + [1] * 4 + [2] * 4 + [1, 2]
    assert table["trials"].to_pylist() == [2] * 19
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    assert (units["control.cruise_speed"], units["torque_rms_nm"]) == (b"m/s", b"N m")
    assert units["robot.preload"] == b"N"
    assert len((calm / "history.csv").read_text().splitlines()) == 20
    summary = json.loads((calm / "summary.json").read_text())
    assert (summary["candidates"], summary["trials_each"]) == (19, 2)
    assert summary["start"]["values"] == {"control.cruise_speed": 0.1, "robot.preload": 25.0}


def test_trials_tell_the_check_from_the_search(calm):
    """Each trial of both is in the table, those of the check behind those of the search."""
    table = pq.read_table(calm / "trials.parquet")
    in_check = table["check"].to_pylist()
    assert in_check == sorted(in_check)
    assert in_check.count(False) == 38
    assert in_check.count(True) > 0


@pytest.mark.parametrize(
    ("metric", "unit"),
    [("duration_s", "s"), ("attempts", "1"), ("success_rate", "1"), ("torque_rms_nm", "N m")],
)
def test_objectives_have_the_unit_of_what_they_are_of(metric, unit):
    """Of a metric its own; of a trial, that of its figure; a rate has none."""
    goal = "maximise" if metric == "success_rate" else "minimise"
    assert _unit_of_objective(small_study(), Objective(metric=metric, goal=goal)) == unit


def test_two_workers_give_the_same_bytes(calm, tmp_path):
    """All files of two worker processes are those of one process."""
    told = []
    run_trials(small_study(), out=tmp_path / "two", workers=2, progress=told.append)
    assert bytes_of(calm) == bytes_of(tmp_path / "two")
    assert [status.stage for status in told if status.done == status.total][-1].startswith("check")
    parts = [status.done / status.total for status in told]
    assert parts == sorted(parts)
    assert parts[-1] == 1
    assert [status.done for status in told if not status.stage.startswith("check")][-1] == 38


@pytest.mark.long
def test_a_kill_changes_nothing(tmp_path):
    """Killed in the second generation, the workers die with their parent, and the next run ends
    with the files of a calm one."""
    file, place = write_study(tmp_path, GATED[0], batch=6), tmp_path / "killed"
    command = ("optimise", file, "--out", place, "--workers", 2)
    process = started(*command, GATE_FOLDER=place, GATE_PARTS=4)
    under = wait_for_parts(process, place, 4)
    process.kill()
    process.wait()
    wait_until_gone(under)  # before its pipes are read, which workers would hold open
    process.communicate()
    kept = {path: path.stat().st_mtime_ns for path in parts(place)}
    run_trials(load_study(file), out=place)
    assert 4 <= len(kept) < len(parts(place))
    run_trials(load_study(file), out=tmp_path / "calm")
    assert bytes_of(place) == bytes_of(tmp_path / "calm")
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items())


def test_a_finished_study_runs_nothing_again(calm, monkeypatch):
    """The same call on a finished folder reads its trials and writes nothing."""
    before = {path: path.stat().st_mtime_ns for path in calm.rglob("*.*")}
    monkeypatch.setattr(dispatch, "run_rows", None)
    result = run_trials(small_study(), out=calm, workers=2)
    assert result.tables["history"].num_rows == 19
    assert {path: path.stat().st_mtime_ns for path in calm.rglob("*.*")} == before


def test_without_a_folder_nothing_is_written(calm, tmp_path, monkeypatch):
    """The result is the same, and no file appears."""
    monkeypatch.chdir(tmp_path)
    result = run_trials(small_study())
    for name, table in result.tables.items():
        assert table.equals(pq.read_table(calm / f"{name}.parquet")), name
    assert result.summary == json.loads((calm / "summary.json").read_text())
    assert list(tmp_path.iterdir()) == []


def test_more_generations_and_another_check_go_on(calm, tmp_path, monkeypatch):
    """With a third generation the first two are those that were there; the check may change without
    any trial of the search being run again."""
    place = tmp_path / "longer"
    run_trials(small_study(final={"candidates": 0}), out=place)
    assert not (place / "final.csv").exists()
    before = {path.stem for path in parts(place)}
    ran, usual = [], dispatch.run_rows
    monkeypatch.setattr(dispatch, "run_rows", lambda batch: ran.append(batch) or usual(batch))
    longer = run_trials(small_study(generations=3), out=place)
    first = pq.read_table(calm / "history.parquet").slice(0, 17)
    history = longer.tables["history"]
    assert history.slice(0, 17).equals(first)
    assert history.num_rows == 27
    assert "final" in longer.tables
    assert ran
    assert not [batch for batch in ran if batch.hash in before]
    assert (place / "final.csv").exists()


def test_another_study_is_refused_and_the_difference_named(calm):
    """A changed bound and a changed draw are named with both values; nothing in the folder
    changes."""
    before = bytes_of(calm)
    data = study_data()
    variables = [data["variables"][0] | {"high": 0.3}, data["variables"][1]]
    trials = [data["trials"][0] | {"seed": 9}]
    with pytest.raises(OutputError, match="holds a different study") as caught:
        run_trials(small_study(variables=variables, trials=trials), out=calm)
    assert "variables.0.high is 0.2 there and 0.3 here" in str(caught.value)
    assert "trials.0.seed is 0 there and 9 here" in str(caught.value)
    assert bytes_of(calm) == before


def test_a_folder_with_other_files_is_refused(tmp_path):
    """A folder that is no study keeps its files; a file is no folder."""
    (tmp_path / "mine").mkdir()
    thesis = tmp_path / "mine" / "thesis.txt"
    thesis.write_text("mine")
    (tmp_path / "other" / "best.toml").mkdir(parents=True)
    for place, told in (
        (tmp_path / "mine", "thesis.txt"),
        (thesis, "is a file"),
        (tmp_path / "other", "best.toml: is a folder"),
    ):
        with pytest.raises(OutputError, match=told):
            run_trials(small_study(), out=place)
    assert {path.name for path in tmp_path.rglob("*")} == {
        "mine",
        "thesis.txt",
        "other",
        "best.toml",
    }


def test_a_damaged_part_is_run_again(calm, tmp_path):
    """Parts that are cut, of other bytes or missing are made anew, and all files are the usual
    ones."""
    place = Path(shutil.copytree(calm, tmp_path / "study"))
    cut, odd, lost, *_ = parts(place)
    cut.write_bytes(cut.read_bytes()[:-100])
    odd.write_bytes(bytes(byte ^ 1 for byte in odd.read_bytes()))
    lost.unlink()
    run_trials(small_study(), out=place)
    assert bytes_of(place) == bytes_of(calm)


def test_a_figure_that_fails_costs_only_itself(calm, tmp_path, monkeypatch):
    """All other files are there, the figure of an earlier run is not; the same command tries
    again."""
    place = Path(shutil.copytree(calm, tmp_path / "study"))
    (place / "summary.json").write_text("{}")
    with monkeypatch.context() as patch:
        patch.setattr(study, "draw_front", lambda *_: 1 / 0)
        with pytest.warns(PictureWarning, match=r"no front\.png: division by zero"):
            run_trials(small_study(), out=place)
    assert {path.name for path in place.iterdir()} == FILES - {"front.png"}
    run_trials(small_study(), out=place)
    assert bytes_of(place) == bytes_of(calm)


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100_000, '{"sha256": 1}'])
def test_a_damaged_description_is_named(tmp_path, text):
    """It cannot be known whose trials these are."""
    (tmp_path / "study.json").write_text(text)
    with pytest.raises(OutputError, match=r"study\.json: is no description of a study"):
        run_trials(small_study(), out=tmp_path)


@pytest.mark.parametrize("failed", [None, "worst"])
def test_a_study_in_which_no_trial_passes_is_an_error(tmp_path, failed):
    """The first generation ends it with what to do, and its trials stay; with a finite value for
    failures, which all candidates then have, the study goes on."""
    distance, torque = study_data()["objectives"]
    objectives = [distance, {key: torque[key] for key in ("metric", "goal", "module")}]
    objectives[1] |= {} if failed is None else {"failed": failed}
    with pytest.raises(StudyError) as caught:
        run_trials(small_study(objectives=objectives), out=tmp_path)
    (fault,) = caught.value.faults
    assert fault.where == "objectives.1"
    assert "torque_rms_nm: no trial of the first generation passed" in fault.problem
    assert 'use failed = "count"' in fault.problem
    assert len(pq.read_table(parts(tmp_path)[0])) > 0
    objectives[1] |= {"failed": "worst", "worst": 9.0}
    shown = run_trials(small_study(objectives=objectives)).summary["best"]["search"]
    assert (shown["torque_rms_nm"], shown["passed"], shown["trials"]) == (9.0, 0, 2)


def test_a_front_without_candidates_is_written_whole(tmp_path):
    """Where every candidate lacks a value in an objective, because one of its trials is invalid,
    all files are there and the printed result says so."""
    bore = {"path": "pipes.*.inner_diameter", "kind": "list", "values": [0.17, 0.3]}
    trials = study_data()["trials"][0]
    trials = trials | {"axes": [*trials["axes"], bore], "samples": 1}
    result = run_trials(small_study(trials=[trials]), out=tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    assert result.tables["front"].num_rows == 0
    assert result.summary["on_front"] == 0
    assert len((tmp_path / "out" / "front.csv").read_text().splitlines()) == 1
    (tmp_path / "small.json").write_text(json.dumps(study_data() | {"trials": [trials]}))
    options = [str(tmp_path / "small.json"), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["optimise", *options])
    assert done.exit_code == 0, done.output
    assert "none has a value in every objective" in done.stdout


def test_a_best_one_that_is_not_on_the_front_says_so(calm, capsys):
    """The check may choose a candidate that others beat in the search."""
    result = run_trials(small_study(), out=calm)
    number = result.summary["best"]["number"]
    tables = result.tables
    kept = [i for i, one in enumerate(tables["front"]["number"].to_pylist()) if one != number]
    for front, told in ((tables["front"].take(kept), True), (tables["history"], False)):
        _print_study(small_study(), replace(result, tables={**tables, "front": front}), calm)
        assert ("not this one, which is the best in the check" in capsys.readouterr().out) is told


def test_the_figure_leaves_out_what_has_no_weight(monkeypatch):
    """An objective that is a limit alone has no panel; candidates beyond it are still marked."""
    distance, torque = study_data()["objectives"]
    limited = torque | {"name": "limited", "weight": 0, "limit": 1e-9}
    limits = small_study(objectives=[limited, distance, torque])
    history = explore(limits, lambda asked: [Measured((1.0, 2.0, 3.0)) for _ in asked])
    drawn = []
    usual = study.study_figure
    monkeypatch.setattr(study, "study_figure", lambda *given: drawn.append(given) or usual(*given))
    study.draw_front(limits, history, history[:2], history[1][0])
    ((scales, tried),) = drawn
    assert [scale.name for scale in scales] == ["distance_m", "torque_rms_nm"]
    assert (tried.values == [2.0, 3.0]).all()
    assert (tried.checked == [2.0, 3.0]).all()
    assert list(tried.places) == [0, 1]
    assert not tried.feasible.any()


def test_the_best_values_can_be_set(calm, tmp_path):
    """best.toml goes through ``--set @FILE`` into a scenario, also for a sweep; the values of every
    checked candidate are there."""
    summary = json.loads((calm / "summary.json").read_text())
    changes = with_changes(dict, [f"@{calm / 'best.toml'}", "robot.mass_unit=1"])
    assert changes.pop("robot.mass_unit") == 1
    assert changes == summary["best"]["values"]
    best = override(load_scenario("straight"), changes)
    assert best.robot.preload == summary["best"]["values"]["robot.preload"]
    checked = [line.split(",")[0] for line in (calm / "final.csv").read_text().splitlines()[1:]]
    assert {path.stem for path in (calm / "values").iterdir()} == set(checked)
    tables = tmp_path / "tables.toml"
    tables.write_text("[robot]\npreload = 20.0\n[robot.motor]\nspeed_bandwidth = 10.0\n")
    assert with_changes(dict, [f"@{tables}"]) == {
        "robot.preload": 20.0,
        "robot.motor.speed_bandwidth": 10.0,
    }


def test_values_that_do_not_fit_and_trials_that_break_are_the_worst(monkeypatch):
    """Bores beyond the arms' reach are invalid trials, and one that diverged has figures that would
    win; the study goes on, and neither of them does."""
    usual = dispatch.run_rows

    def run_rows(batch):
        results = usual(batch)
        for trial, row in zip(batch.trials, results.rows, strict=True):
            if trial.index == 2:
                row |= {"outcome": "diverged", "success": False, "distance_m": 1e6}
        return results

    monkeypatch.setattr(dispatch, "run_rows", run_rows)
    bore = {"path": "pipes.*.inner_diameter", "low": 0.15, "high": 0.2, "start": 0.185}
    reach = {"path": "robot.reach", "low": 0.083, "high": 0.105}
    distance = study_data()["objectives"][0]
    fields = {"variables": [bore, reach], "objectives": [distance], "final": {"samples": 1}}
    result = run_trials(small_study(**fields, generations=1, directions=1))
    rows = result.tables["history"].to_pylist()
    invalid = [row["distance_m"] for row in rows if row["invalid"]]
    assert set(invalid) == {float("-inf")}
    assert (rows[1]["lost"], rows[1]["distance_m"]) == (1, float("-inf"))
    best = result.summary["best"]["values"]
    assert best["pipes.*.inner_diameter"] < 2 * best["robot.reach"]


def test_a_study_of_invalid_trials_only_is_an_error():
    """When no trial of the first candidates fits, the error says why."""
    bore = {"path": "pipes.*.inner_diameter", "low": 0.196, "high": 0.2}
    reach = {"path": "robot.reach", "low": 0.09, "high": 0.105}
    with pytest.raises(StudyError, match="none of the first 18 trials is valid") as caught:
        run_trials(small_study(variables=[bore, reach], step=0.001))
    assert "the arms reach bores" in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "controller_gains"),
        (["controller_gains", "--set", "control.sped=1"], "control.sped"),
        (["controller_gains", "--set", "robot.motor.speed_bandwidth=1"], "or --set too"),
        (["controller_gains", "--set", "@nowhere.toml"], "cannot be read"),
        (["controller_gains", "--workers", "2", "--dask", "tcp://127.0.0.1:9"], "one of the two"),
    ],
)
def test_bad_arguments_end_with_status_2(tmp_path, arguments, told):
    """Bad arguments are named and leave no file."""
    done = omnitrack("optimise", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_list_and_result_of_the_command(calm):
    """--list shows what is varied and asked for and runs nothing; a finished study prints start and
    best, and where its values are; the catalogue names the studies."""
    file = write_study(calm.parent)

    def optimise(*options: object) -> str:
        done = CliRunner().invoke(app, ["optimise", str(file), *map(str, options)])
        assert done.exit_code == 0, done.output
        return done.stdout

    shown = optimise("--list")
    assert (
        "search: the start, 2 x 2 generations x 4 candidates, and 2 centres: 19 candidates of 2 "
        "trials, 38 trials in all" in shown
    )
    assert (
        "check: the start, 2 centres, and the best 1 of each of 2 directions: at most 5 candidates "
        "of 3 trials, 15 trials in all" in shown
    )
    assert "control.cruise_speed" in shown
    assert "torque_rms_nm" in shown
    printed = optimise("--out", calm)
    assert "distance_m, other trials" in printed
    rows = [line.split() for line in printed.splitlines()]
    assert ["passed", "0", "of", "2", "0", "of", "2"] in rows
    assert ["passed,", "other", "trials", "0", "of", "3", "0", "of", "3"] in rows
    assert "best.toml" in printed
    summary = json.loads((calm / "summary.json").read_text())
    assert json.loads(optimise("--out", calm, "--json")) == summary
    assert "studies/robot_design" in json.loads(omnitrack("scenarios", "--json").stdout)


def test_a_missing_library_is_told(monkeypatch):
    """Without cmaes the error says what to install."""
    monkeypatch.setitem(__import__("sys").modules, "cmaes", None)
    with pytest.raises(Exception, match=r"pip install 'omnitrack_sim\[optimise\]'"):
        run_trials(small_study())
