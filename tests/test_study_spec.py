"""Study files: what is accepted, how faults are told, and what the trials of a candidate make."""

import math

import numpy as np
import pyarrow as pa
import pytest
from study_samples import small_study, study_data

from omnitrack_sim import StudyError, load_study, override, shipped_files
from omnitrack_sim.trials import study_file
from omnitrack_sim.trials.measure import Measure
from omnitrack_sim.trials.search import Candidate
from omnitrack_sim.trials.search_plan import Objective, SearchPlan, Variable
from omnitrack_sim.trials.study import Study, batches_of
from omnitrack_sim.trials.study_file import resolve

SPEED, PRELOAD = study_data()["variables"]
DISTANCE, TORQUE = study_data()["objectives"]
TRIALS = study_data()["trials"][0]
PITCH, DAMPING = {"path": "robot.pitch_limit"}, {"path": "robot.slide_damping"}
LONG = {"run.time_limit": 9000.0}


def _faults(**changes) -> dict[str, str]:
    with pytest.raises(StudyError) as caught:
        small_study(**changes)
    return {fault.where: str(fault) for fault in caught.value.faults}


@pytest.mark.parametrize("name", ["controller_gains", "robot_design"])
def test_shipped_studies_are_whole(name):
    """Every shipped study loads, says what it answers, begins with the values of its scenario, and
    the candidate at its start has the scenarios of its trials unchanged."""
    study = load_study(name)
    assert set(shipped_files("studies")) == {"controller_gains", "robot_design"}
    assert "Answers" in shipped_files("studies")[name].read_text(encoding="utf-8")
    start = Candidate(0, 1, 0, tuple(v.start for v in study.variables))  # type: ignore[misc]
    trials = [t for batch in batches_of(study, study.trials, [start]) for t in batch.trials]
    assert len(trials) == study.size
    assert sorted(trial.index for trial in trials) == list(range(study.size))
    base = next(iter(study.trials[0].bases.values()))
    assert override(base, study.settings(start.values)) == base


def test_all_faults_of_the_form_are_told_at_once():
    """Every fault of the tables has its path in the file."""
    faults = _faults(
        variables=[
            SPEED | {"low": 0.3},
            PRELOAD | {"low": 0, "scale": "log"},
            PRELOAD | {"start": 31},
            {"path": 3, "low": 0, "hi": 1},
            PRELOAD | {"scale": "cubic"},
        ],
        objectives=[DISTANCE | {"goal": "max"}, TORQUE | {"aggregate": "p101"}, {"module": 4}],
        final={"candidate": 3},
        generation=3,
        population=1,
    )
    assert set(faults) == {
        "variables.0.high",
        "variables.1.scale",
        "variables.2.start",
        "variables.3.path",
        "variables.3.high",
        "variables.3.hi",
        "variables.4.scale",
        "objectives.0.goal",
        "objectives.1.aggregate",
        "objectives.2.metric",
        "objectives.2.goal",
        "objectives.2.module",
        "final.candidate",
        "generation",
        "population",
    }
    assert "over low, 0.3" in faults["variables.0.high"]
    assert "5 to 30" in faults["variables.2.start"]
    assert "generations" in faults["generation"]
    assert "candidates" in faults["final.candidate"]


def test_all_faults_of_the_trials_are_told_at_once():
    """Those of every sweep, each at its place."""
    faults = _faults(
        trials=[TRIALS | {"samples": 0, "group_by": []}, TRIALS, TRIALS, TRIALS | {"base": "far"}]
    )
    assert set(faults) == {
        "trials.0.samples",
        "trials.0.group_by",
        "trials.2.name",
        "trials.3.base: far",
    }
    assert "name of earlier trials" in faults["trials.2.name"]


def test_all_faults_in_the_light_of_the_trials_are_told_at_once():
    """Unknown paths, metrics and trials, values that are no numbers, bounds out of range, clashes
    and objectives that no trial gives."""
    faults = _faults(
        variables=[
            SPEED | {"path": "control.speed"},
            SPEED | {"path": "control.align"},
            SPEED | {"path": "world.gravity"},
            SPEED | {"path": "robot.motor"},
            PRELOAD,
            PRELOAD,
            PRELOAD | {"path": "world.friction"},
            PRELOAD | {"path": "robot.lugs_per_track"},
        ],
        objectives=[
            DISTANCE | {"metric": "distance"},
            DISTANCE | {"metric": "no_load_slip_m_s"},
            TORQUE | {"module": None},
            DISTANCE | {"module": 1},
            DISTANCE,
            DISTANCE | {"name": "x", "trials": "straigt"},
            {"metric": "success_rate", "goal": "maximise", "aggregate": "mean"},
            TORQUE | {"name": "robot.preload"},
        ],
        directions=3,
    )
    assert "cruise_speed" in faults["variables.0.path"]
    assert "not a number" in faults["variables.1.path"]
    assert "world.gravity.0" in faults["variables.2.path"]
    assert "speed_bandwidth" in faults["variables.3.path"]
    assert "variables.4.path" not in faults
    assert "set by variables.4 too" in faults["variables.5.path"]
    assert "set by trials.0.axes.0 too" in faults["variables.6.path"]
    assert "set by trials.0.set or --set too" in faults["variables.7.path"]
    assert "torque_change_nm_s" in faults["objectives.0.metric"]
    assert "no trial of a study" in faults["objectives.1.metric"]
    assert "choose from: 1, 2, 3, mean" in faults["objectives.2.module"]
    assert "one value for all modules" in faults["objectives.3.module"]
    assert "earlier objective" in faults["objectives.4.name"]
    assert "straight" in faults["objectives.5.trials"]
    assert "counts all trials" in faults["objectives.6.aggregate"]
    assert "another column" in faults["objectives.7.name"]
    assert "at least the 8 objectives" in faults["directions"]


@pytest.mark.parametrize(
    ("changes", "where", "told"),
    [
        ({"trials": [TRIALS | {"base": "nowhere"}]}, "trials.0.base: nowhere", "tee_turn"),
        ({"trials": [TRIALS | {"axes": []}]}, "trials.0.axes", "at least one axis"),
        ({"variables": [PRELOAD | PITCH | {"high": 50}]}, "variables.0.high", "0.001 to 0.5"),
        ({"variables": [PRELOAD | DAMPING | {"low": -5}]}, "variables.0.low", "from 0 to 10000"),
        ({"trials": []}, "trials", "at least 1"),
        ({"trials": 3}, "trials", "list"),
        ({"objectives": [DISTANCE | {"weight": 0}]}, "objectives", "have no weight"),
        ({"objectives": [DISTANCE], "directions": 2}, "directions", "one direction"),
        ({"final": {"seed": 0}}, "final.seed", "the very trials of trials.0"),
        ({"generations": 100_000, "population": 10_000}, "generations", "at most 1000000"),
        ({"generations": 300, "trials": [TRIALS | {"samples": 9000}]}, "generations", "trials; at"),
        ({"trials": [TRIALS | {"samples": 200_000}]}, "generations", "makes 3800000 trials"),
        ({"final": {"samples": 900_000}}, "final.samples", "makes 8100000 trials; at most"),
        ({"trials": [TRIALS | {"batch": 4000, "set": LONG}]}, "trials.0.batch", "16 trials togeth"),
        ({"variables": [PRELOAD | {"high": 1e300}]}, "variables.0.high", "1000000000000000"),
        ({"variables": [SPEED | {"low": 1e-300}]}, "variables.0.scale", "bounds of 1e-15 or more"),
        ({"step": 1e300}, "step", "less than or equal to 10"),
    ],
)
def test_single_faults(changes, where, told):
    """Faults of trials, weights and numbers."""
    assert told in _faults(**changes)[where]


@pytest.mark.parametrize(("of", "most"), [("variables", 100), ("objectives", 10)])
def test_a_study_has_as_many_variables_and_objectives_as_a_search_can_sort(of, most):
    """One more is a fault."""
    for count in (most, most + 1):
        counts = {"variables": 1, "objectives": 1, of: count}
        given = {
            "variables": [
                {"path": f"a.x{i}", "low": 0.0, "high": 1.0, "start": 0.5}
                for i in range(counts["variables"])
            ],
            "objectives": [
                {"metric": f"m{i}", "goal": "minimise"} for i in range(counts["objectives"])
            ],
        }
        if count == most:
            assert len(getattr(SearchPlan.model_validate(given), of)) == most
        else:
            with pytest.raises(ValueError, match=of):
                SearchPlan.model_validate(given)


def test_too_many_bases_are_refused(monkeypatch):
    """The bounds of every variable are tried in each of them."""
    monkeypatch.setattr(study_file, "MAX_BASES", 1)
    told = _faults(trials=[TRIALS | {"base": ["straight", "tee_turn"], "batch": 1}])
    assert told == {"trials": "trials: have 2 base scenarios; at most 1"}


def test_a_bound_that_only_goes_with_others_is_no_fault():
    """A reach below the pipe's radius does not fit the pipe, whatever the others are; a bore beyond
    the reach of the base fits the highest reach."""
    bore = {"path": "pipes.*.inner_diameter", "low": 0.15, "high": 0.205}
    reach = {"path": "robot.reach", "low": 0.09, "high": 0.12}
    assert small_study(variables=[bore, reach]).variables[0].high == 0.205


def test_changes_of_the_call_reach_all_trials():
    """``--set`` changes the bases of every sweep; what is wrong in them is told."""
    data = study_data() | {"trials": [TRIALS, TRIALS | {"name": "again", "seed": 3}]}
    study = resolve(data, changes={"physics.collider": "primitives"})
    bases = [base for sweep in study.trials for base in sweep.bases.values()]
    assert [base.physics.collider for base in bases] == ["primitives", "primitives"]
    with pytest.raises(StudyError) as caught:
        resolve(data, changes={"physics.colider": "exact"})
    assert [fault.where for fault in caught.value.faults] == ["--set physics.colider"]


def test_the_start_is_that_of_the_scenario_or_the_middle():
    """A value within the bounds is the start, one beyond them is not; a start that is given is."""
    study = small_study(
        variables=[
            SPEED,
            SPEED | {"path": "control.speed_limit", "low": 0.3, "high": 2.7},
            PRELOAD | {"start": 7},
            PRELOAD | {"path": "robot.springs_per_module", "low": 2, "high": 8},
        ]
    )
    assert [v.start for v in study.variables] == [0.1, 0.9, 7, 4]
    assert [v.whole for v in study.variables] == [False, False, False, True]


def test_values_have_places_between_their_bounds():
    """On a logarithmic scale the middle is the geometric mean; value and place are each other's
    inverse; values have nine digits and stay within their bounds."""
    log = Variable(path="a", low=0.01, high=100, scale="log")
    assert log.value_at(0.5) == 1
    assert Variable(path="a", low=-1, high=3).value_at(0.25) == 0
    for place in (0.0, 0.123, 1.0):
        assert log.place_of(log.value_at(place)) == pytest.approx(place, abs=1e-9)
    assert Variable(path="a", low=0, high=1).value_at(1 / 3) == 0.333333333
    third = Variable(path="a", low=1 / 3, high=1)
    assert third.value_at(0) == 1 / 3


def test_a_study_in_json_form_is_the_same():
    """The resolved study goes through JSON and back unchanged; name, generations and check do not
    change what is tried, everything else does."""
    study = small_study()
    assert Study.model_validate_json(study.model_dump_json()).hash == study.hash
    same = small_study(name="other", generations=9, final={"candidates": 0})
    assert same.hash == study.hash
    assert small_study(seed=1).hash != study.hash
    assert small_study(trials=[TRIALS | {"seed": 5}]).hash != study.hash


def test_candidates_share_their_draws_and_the_check_has_others():
    """Trial for trial two candidates have the same friction; those of the check differ."""
    study = small_study()
    pair = [Candidate(0, 1, 0, (0.1, 20.0)), Candidate(1, 1, 1, (0.05, 10.0))]
    trials = {
        trial.index: trial.changes
        for batch in batches_of(study, study.trials, pair)
        for trial in batch.trials
    }
    friction = [trials[i]["world.friction"] for i in range(4)]
    assert friction[:2] == friction[2:]
    assert [trials[i]["control.cruise_speed"] for i in range(4)] == [0.1, 0.1, 0.05, 0.05]
    unseen = study.unseen[0].trials()["world.friction"]
    assert len(unseen) == 3
    assert not set(unseen) & set(friction)


def _measured(trials: list[dict], count: int = 1, **objective):
    """The values of one objective over trials of ``count`` candidates."""
    fields = {"metric": "energy_j", "goal": "minimise"} | objective
    study = small_study(trials=[TRIALS | {"samples": len(trials) // count}])
    plan = study.model_copy(update={"objectives": (Objective(**fields),)})
    usual = {"outcome": "reached_goal", "energy_j": 1.0}
    rows = [usual | row for row in trials]
    rows = [row | {"success": row["outcome"] == "reached_goal"} for row in rows]
    found = Measure(plan, study.trials)(pa.Table.from_pylist(rows), count)
    return [one.values[0] for one in found], found


def _energies(*values: float) -> list[dict]:
    return [{"energy_j": value} for value in values]


@pytest.mark.parametrize(
    ("aggregate", "value"),
    [(None, 3.6), ("mean", 3.6), ("median", 3), ("min", 1), ("max", 8), ("p80", 4), ("p81", 8)],
)
def test_trials_become_one_number(aggregate, value):
    """Of 1, 2, 3, 4 and 8: mean, median, ends, and percentiles as values that were there."""
    values, _ = _measured(_energies(4, 1, 8, 3, 2), aggregate=aggregate)
    assert values == pytest.approx([value])


def test_a_failed_trial_counts_as_it_is_said():
    """Left out, counted, or the worst; where none has passed there is no value."""
    trials = [*_energies(1, 3), {"energy_j": 8.0, "outcome": "stuck"}]
    assert _measured(trials)[0] == [2]
    assert _measured(trials, failed="count")[0] == [4]
    assert _measured(trials, failed="worst")[0] == [math.inf]
    assert _measured(trials, failed="worst", worst=20.0)[0] == [8]
    assert _measured(trials[2:])[0] == [math.inf]
    assert _measured(trials[2:], goal="maximise")[0] == [-math.inf]


@pytest.mark.parametrize("outcome", ["diverged", "invalid", "error"])
def test_a_trial_without_figures_is_the_worst_and_no_error(outcome):
    """One that diverged, was invalid or broke counts the worst even where failures are left out and
    where figures were left behind; it is a failure in the success rate, and counted."""
    trials = [*_energies(1, 3), {"energy_j": 0.1, "outcome": outcome}]
    assert _measured(trials)[0] == [math.inf]
    assert _measured(trials, aggregate="median")[0] == [3]
    assert _measured(trials, worst=20.0)[0] == [8]
    values, found = _measured(trials, metric="success_rate", goal="maximise")
    assert values == pytest.approx([2 / 3])
    assert (found[0].trials, found[0].passed) == (3, 2)
    assert found[0].invalid == (outcome == "invalid")
    assert found[0].lost == (outcome != "invalid")


def test_candidates_and_modules_are_kept_apart():
    """Two candidates of two trials each; the mean, the largest and the second of three modules."""
    rows = [{f"torque_rms_nm_{i}": value * i for i in (1, 2, 3)} for value in (1.0, 3.0, 5.0, 7.0)]
    for module, factor in (("mean", 2), ("max", 3), (2, 2), ("sum", 6)):
        values, _ = _measured(rows, count=2, metric="torque_rms_nm", module=module)
        assert values == [2 * factor, 6 * factor]


def test_trials_of_an_objective_are_its_own():
    """An objective over one of two sweeps counts the trials of that one alone."""
    data = study_data() | {"trials": [TRIALS, TRIALS | {"name": "again", "samples": 1}]}
    study = resolve(data | {"objectives": [DISTANCE | {"trials": "again"}], "directions": 1})
    rows = [{"outcome": "timed_out", "success": False, "distance_m": v} for v in (1.0, 2.0, 5.0)]
    (found,) = Measure(study, study.trials)(pa.Table.from_pylist(rows), 1)
    assert found.values == (5,)


def test_an_objective_that_no_trial_gives_is_refused():
    """A metric that is not finite in any trial that ran is named; one that a single trial has is
    not."""
    study = small_study()
    columns = {f"torque_rms_nm_{i}": [None, 1.0] for i in (1, 2, 3)}
    table = pa.table(
        {"outcome": ["stuck"] * 2, "success": [False] * 2, "distance_m": [None, np.nan]} | columns
    )
    with pytest.raises(StudyError, match=r"^objectives.0.metric: 'distance_m' has no finite value"):
        Measure(study, study.trials).refuse_unmeasured(table)
