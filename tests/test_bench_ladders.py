"""Ladders of a benchmark: courses of rising size, and the least size that stops a robot."""

from __future__ import annotations

import pytest

from omnitrack_sim import run_trials
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.trials.bench import Bench
from omnitrack_sim.trials.bench_table import least_size, page, passed_table
from omnitrack_sim.trials.mobility import CourseFile
from omnitrack_sim.trials.suite import load_suite

SUITE = load_suite("as_built")
LADDERS = ("step_up", "step_down", "gap", "ovality", "weld", "deposit", "dent", "egg")


def _clear(scenario: Scenario) -> float:
    """Distance of the wall from the middle of the second pipe's axis, bores."""
    fitting = scenario.route.network.parts[1].fitting
    middle = [[0.0, 0.0, fitting.length / 2]]
    return float(fitting.signed_distance(middle)[0][0]) / scenario.robot.nominal_bore


def _pipes(scenario: Scenario):
    return [(2 * pipe.fitting().radius) / scenario.robot.nominal_bore for pipe in scenario.pipes]


SIZES = {
    "step_up": lambda s: (_pipes(s)[0] - _pipes(s)[2]) / 2,
    "step_down": lambda s: (_pipes(s)[2] - _pipes(s)[0]) / 2,
    "gap": lambda s: s.pipes[1].gap / s.robot.nominal_bore,
    # Half of the shortest diameter, which an oval's ratio lessens by a quarter of it.
    "ovality": lambda s: 4 * (0.5 - _clear(s)),
    "weld": lambda s: 0.5 - _clear(s),
    "deposit": lambda s: 0.5 - _clear(s),
    "dent": lambda s: 0.5 - _clear(s),
    "egg": lambda s: _pipes(s)[0],
}


@pytest.mark.parametrize("ladder", LADDERS)
def test_a_size_is_that_of_what_stands_in_the_way(ladder):
    """Measured at the wall, in bores of a robot of 160 mm and of one of 100 mm."""
    sweeps = Bench.of("as_built", [ladder], ["omnitrack", "pirate"], trials=1).sweeps()
    for (name, _), sweep in sweeps.items():
        (scenario,) = sweep.bases.values()
        assert SIZES[ladder](scenario) == pytest.approx(SUITE.courses[name].size, abs=1e-6), name


def test_every_shipped_robot_drives_every_size_by_the_same_draws():
    """Also those whose bores do not hold it are a row, not an abort."""
    assert [*SUITE.entries] == [*load_suite("mobility").entries]
    assert {course.ladder for course in SUITE.courses.values()} == {"", *LADDERS}
    for course in SUITE.courses.values():
        sweeps = [course.sweep(2, entry.changes) for entry in SUITE.entries.values()]
        draws = [sweep.trials() for sweep in sweeps if not isinstance(sweep, str)]
        assert draws
        assert all(one == draws[0] for one in draws)


def test_a_ladder_is_chosen_by_its_name_and_a_size_by_its_own():
    rungs = ["weld_0.00625", "weld_0.0125", "weld_0.025", "weld_0.05", "weld_0.1"]
    chosen = Bench.of("as_built", ["weld", "step_up_0.1"], ["presser"]).courses
    assert [course.name for course in chosen] == ["step_up_0.1", *rungs]
    with pytest.raises(InputError, match="did you mean 'step_up'"):
        Bench.of("as_built", ["step_upp"])


COURSE = {
    "name": "bead",
    "words": "over a bead",
    "climb_deg": 0,
    "sizes": (0.01, 0.04),
    "grows": {"pipes.0.relief.0.height": 1.0, "pipes.0.length": -2.0},
    "pipes": (
        {"kind": "straight", "length": 1.0, "relief": [{"kind": "weld", "at": 0.4, "width": 0.1}]},
    ),
}


def test_what_grows_does_so_from_what_stands_there():
    """From 0 where nothing does; the file itself stays as it is."""
    file = CourseFile.model_validate(COURSE)
    (pipe,) = file.of_size(0.04).pipes
    assert pipe["length"] == pytest.approx(0.92)
    assert pipe["relief"][0] == {"kind": "weld", "at": 0.4, "width": 0.1, "height": 0.04}
    assert "height" not in file.pipes[0]["relief"][0]
    made = file.of_size(0.01)
    assert (made.name, made.words, made.sizes) == ("bead_0.01", "over a bead, 0.01", ())


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"sizes": ()}, "needs both sizes and grows"),
        ({"grows": {}}, "needs both sizes and grows"),
        ({"sizes": (0.04, 0.01)}, "sizes that ascend"),
        ({"grows": {"pipes.1.length": 1.0}}, r"no number at 'pipes\.1\.length'"),
        ({"grows": {"pipes.0.kind": 1.0}}, r"no number at 'pipes\.0\.kind'"),
    ],
)
def test_faults_of_a_ladder_are_told(changes, told):
    with pytest.raises(ValueError, match=told):
        CourseFile.model_validate(COURSE | changes)


def _row(size: float, passed: int, trials: int = 4, ladder: str = "step") -> dict:
    others = f"{trials - passed} stuck" if trials else "does not fit"
    row = {"course": f"{ladder}_{size:g}", "entry": "a", "ladder": ladder, "size": size}
    return row | {"passed": passed, "trials": trials, "others": others}


def test_trials_passed_are_a_row_a_course_and_a_column_an_entry():
    """In the order of the rows; nothing where an entry has not been tried."""
    rows = [
        _row(size, 3) | {"entry": entry, "success": 0.75} for size in (0.2, 0.1) for entry in "ba"
    ]
    rows += [_row(0.3, 0, 0) | {"entry": "b", "success": None}]
    cells = [[text.strip() for text in line.split("|")[1:-1]] for line in passed_table(rows)]
    assert cells[0] == ["course", "`b`", "`a`"]
    assert cells[2:-1] == [
        ["`step_0.2`", "3 of 4", "3 of 4"],
        ["`step_0.1`", "3 of 4", "3 of 4"],
        ["`step_0.3`", "does not fit", "-"],
    ]


def test_the_least_size_that_stops_is_where_less_than_half_pass_first():
    """However larger ones end; a robot that does not fit is stopped; else none does."""
    rows = [_row(0.1, 4), _row(0.2, 2), _row(0.3, 1), _row(0.4, 4), _row(0.1, 0, ladder="gap")]
    assert least_size(rows, "step", "a") == "0.3: 3 stuck"
    assert least_size(rows, "gap", "a") == "0.1: 4 stuck"
    assert least_size(rows[:2], "step", "a") == "> 0.2"
    assert least_size([_row(0.1, 0, 0)], "step", "a") == "0.1: does not fit"
    assert least_size(rows, "step", "b") == "-"


def test_a_bench_of_a_ladder_tells_what_stops(tmp_path):
    """On its page, in its table and in a picture; a robot without time passes nothing."""
    short = {"run.time_limit": 0.1}
    courses = ["straight_level", "step_up_0.00625", "step_up_0.0125"]
    bench = Bench.of("as_built", courses, ["presser"], trials=1, changes=short)
    result = run_trials(bench, out=tmp_path)
    by_course = {row["course"]: row for row in result.summary["rows"]}
    assert (by_course["step_up_0.0125"]["ladder"], by_course["step_up_0.0125"]["size"]) == (
        "step_up",
        0.0125,
    )
    assert "ladder" not in by_course["straight_level"]
    written = page(bench, result.summary["rows"])
    assert "## least size that stops" in written
    assert "| `step_up` | 0.00625: 1 timed_out |" in written
    assert (tmp_path / "bench.png").stat().st_size > 1000
    sizes = result.tables["results"]["size"].to_pylist()
    assert sizes == [None, 0.00625, 0.0125, None]
