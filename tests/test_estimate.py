"""How long trials take: a sum over batches of what was measured, between two bounds."""

from __future__ import annotations

import re

import pytest
from commands import omnitrack
from sweep_samples import small_sweep

import omnitrack_sim as ot
from omnitrack_sim.scenario.model import max_seconds, min_seconds
from omnitrack_sim.trials import estimate as estimating
from omnitrack_sim.trials.estimate import STEPS, _Pace, estimate
from omnitrack_sim.trials.sweep_file import resolve


@pytest.fixture
def paced(monkeypatch):
    """Batches that take 3 s and 0.5 s for each simulated second of a robot."""
    monkeypatch.setattr(estimating, "_measured", lambda batch: _Pace(3.0, 0.5))


def test_time_adds_up_over_batches_and_robots(paced):
    """Each batch has its model to make, each robot its way at cruise speed or its time limit."""
    axis = {"path": "world.friction", "kind": "grid", "start": 0.5, "stop": 1.0, "count": 10}
    sweep = resolve({"name": "s", "base": "straight", "batch": 4, "axes": [axis]})
    straight = ot.load_scenario("straight")
    found = estimate(sweep)
    assert (found.trials, found.done) == (10, 0)
    way = straight.goal_distance - straight.start.distance
    assert min_seconds(straight) == pytest.approx(way / straight.control.cruise_speed)
    assert found.shortest == pytest.approx(3 * 3.0 + 10 * 0.5 * min_seconds(straight))
    assert found.longest == pytest.approx(3 * 3.0 + 10 * 0.5 * max_seconds(straight))


def test_robots_that_differ_in_their_own_values_have_one_pace(monkeypatch):
    """One is measured of those that share a model, and one of each other robot."""
    asked = []
    monkeypatch.setattr(estimating, "_measured", lambda batch: asked.append(batch))
    for path, values, paces in (
        ("robot.preload", [20.0, 22.0, 25.0], 1),
        ("robot.scale", [1.0, 1.01, 1.02], 3),
    ):
        asked.clear()
        axis = {"path": path, "kind": "list", "values": values}
        estimate(resolve({"name": "s", "base": "straight", "batch": 1, "axes": [axis]}))
        assert len(asked) == paces


def test_what_a_folder_holds_is_left_out(paced, tmp_path):
    """And counted."""
    sweep = small_sweep()
    ot.run_trials(sweep, out=tmp_path / "s", shard=(1, 2))
    whole, rest = estimate(sweep), estimate(sweep, tmp_path / "s")
    done = ot.load_sweep_result(tmp_path / "s").status.done
    assert (whole.done, rest.done, rest.trials) == (0, done, whole.trials)
    assert rest.longest < whole.longest
    ot.run_trials(sweep, out=tmp_path / "s")
    assert estimate(sweep, tmp_path / "s").longest == 0


@pytest.mark.parametrize("name", ["tee_turn", "missions/dead_end", "missions/explore_house"])
def test_no_robot_is_there_before_it_could_be(name):
    """Cruising all the way takes less than the time limit, in missions and explorations, too."""
    scenario = ot.load_scenario(name)
    assert 0 < min_seconds(scenario) <= max_seconds(scenario)


def test_the_pace_is_that_of_the_robots_steps(monkeypatch):
    """Some control steps of a batch, by CPU time; a robot that does not fit has none."""
    ticks = iter([0.0, 2.0, 5.0])
    monkeypatch.setattr("time.process_time", lambda: next(ticks))
    batch = small_sweep().batches()[0]
    pace = estimating._measured(batch)
    assert pace is not None
    valid = sum(estimating._scenario(batch, trial) is not None for trial in batch.trials)
    period = small_sweep().scenario(3).physics.control_period
    assert pace == _Pace(2.0, pytest.approx(3.0 / (STEPS * period * valid)))


def test_a_study_counts_all_its_generations(monkeypatch):
    """Its rounds come one by one; how many candidates share a model depends on what they vary."""
    monkeypatch.setattr(estimating, "_measured", lambda batch: _Pace(0.0, 0.5))
    study = ot.load_study("controller_gains")
    assert estimate(study).trials == study.max_trials
    # The start is the first round, a candidate of so many.
    each = sum(estimate(sweep).shortest for sweep in study.trials) / study.size
    assert estimate(study).shortest == pytest.approx(each * study.max_trials)


def test_a_bench_and_a_passport_say_how_long_they_take_and_run_nothing(paced, tmp_path):
    """Courses with their trials, those that do not fit, and the time."""
    command = ("bench", "--quick", "--list", "--alone", "--robot", "presser", "--workers", "2")
    shown = omnitrack(*command, "--course", "tee_into", "--course", "elbow_15", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    words = " ".join(shown.stdout.split())
    assert "tee_into 1 2 from the run of a tee into its branch" in words
    assert "4 trials take 0:00:" in words
    assert "with 2 processes on cores of their own" in words
    listed = omnitrack("passport", "presser", "--quick", "--list", cwd=tmp_path).stdout
    words = " ".join(listed.split())
    assert "straight 8" in words
    assert "520 trials take" in words
    assert list(tmp_path.iterdir()) == []


def test_more_processes_take_less_time(paced, tmp_path):
    """In proportion."""
    longest = []
    for workers in ("1", "4"):
        shown = omnitrack("sweep", "tee_lugs", "--list", "--workers", workers, cwd=tmp_path).stdout
        *_, ends = re.findall(r"(\d+):(\d\d):(\d\d)", " ".join(shown.split()))
        longest.append(int(ends[0]) * 3600 + int(ends[1]) * 60 + int(ends[2]))
    assert longest[0] == pytest.approx(4 * longest[1], abs=4)
    assert longest[1] > 60


def test_columns_of_benches_and_passports_have_units():
    """Those of what is varied."""
    bench = ot.Bench.of("mobility", ["tee_into"], ["presser"], quick=True)
    passport = ot.PassportPlan.of("presser", courses=["straight"], trials=2)
    for plan in (bench, passport):
        units = next(plan.rounds()).units
        assert (units["world.gravity"], units["start.theta5_deg"]) == ("m/s²", "deg")
