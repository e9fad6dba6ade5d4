"""Benchmarks of controllers and robots: courses, entries, figures, tables, and going on."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from commands import omnitrack
from policy_samples import driver

import omnitrack_sim as ot
from omnitrack_sim import run_trials, shipped_files
from omnitrack_sim.base.errors import InputError, OutputError
from omnitrack_sim.calibration.parameters import Parameter
from omnitrack_sim.cli import main
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval
from omnitrack_sim.robots.kinds import ROBOTS
from omnitrack_sim.robots.omnitrack.control import open_loop
from omnitrack_sim.trials import dispatch
from omnitrack_sim.trials.bench import Bench
from omnitrack_sim.trials.bench_table import page, rows_of
from omnitrack_sim.trials.entries import Changes, robot_entry, robot_of
from omnitrack_sim.trials.suite import Course, load_suite, min_friction

CONTROL = load_suite("control")
TABLES = (f"{name}.{end}" for name in ("trials", "results") for end in ("parquet", "csv"))
FILES = ("bench.json", "summary.json", "results.md", "bench.png", *TABLES)


def driven_by(source: str):
    """The entry of a controller."""
    return CONTROL.entry("", source)


def _short(trials: int, changes: Changes):
    """Begins of turns in the tee, of 0.3 s."""
    return CONTROL.courses["turn"].sweep(trials, {**changes, "run.time_limit": 0.3})


SHORT = Course("short", "up the run for a moment", 4, 2, _short)


def _status(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["omnitrack", "bench", "control", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    return caught.value.code


def calibrated(path: str) -> ot.Calibration:
    """A calibration of one parameter: 28 with a standard deviation of 1.5."""
    own = Parameter(path, 25.0, 15.0, 35.0, "N", "assumed", 5.0)
    return ot.Calibration([own], np.array([28.0]), np.array([[1.5**2]]))


def test_a_bench_draws_the_robots_of_a_calibration():
    """Each trial another one, whether the course draws anything itself or not; all entries drive
    the same ones, and results with others are not taken for them."""
    path = "robot.preload"
    bench = Bench.of("control", ["elbow", "turn"], quick=True, calibration=calibrated(path))
    for course in bench.courses:
        drawn = [bench.sweeps()[course.name, own.name].trials()[path] for own in bench.entries]
        assert len(set(drawn[0])) == len(drawn[0]) > 2
        assert all(own == drawn[0] for own in drawn)
        assert np.mean(drawn[0]) == pytest.approx(28.0, abs=2.0)
    assert bench.hash != Bench.of("control", ["elbow", "turn"], quick=True).hash
    with pytest.raises(InputError, match="has no parameter"):
        Bench.of("control", calibration=calibrated("world.friction"))
    with pytest.raises(InputError, match=r"--calibration: is of another robot than presser"):
        Bench.of("mobility", ["elbow_15"], ["presser"], calibration=calibrated("robot.arm_mass"))


def test_every_entry_can_drive_every_course_by_the_same_draws():
    bench = Bench.of("control", quick=True)
    entries, sweeps = bench.entries, bench.sweeps()
    assert len(sweeps) == len(CONTROL.courses) * len(entries)
    for course in CONTROL.courses:
        trials = [sweeps[course, entry.name].trials() for entry in entries]
        assert all(one == trials[0] for one in trials)
    kinds = {key: next(iter(sweep.bases.values())).control.kind for key, sweep in sweeps.items()}
    assert kinds["network", "equal"] == "equal"
    assert sweeps["turn", "earlier"].bases["tee_turn"].robot.motor.speed_bandwidth == 50.0
    assert sweeps["turn", "differential"].bases["tee_turn"].robot.drive == "differential"
    networks = sweeps["network", "feedback"].bases.values()
    assert len({scenario.network.model_dump_json() for scenario in networks}) == 4


def test_more_trials_are_so_many_of_each_course():
    """Drawn anew, but for networks, which are counted on."""
    turn, network = CONTROL.courses["turn"], CONTROL.courses["network"]
    courses = [replace(turn, trials=20), replace(network, trials=3)]
    entries = [driven_by("feedback")]
    some, more = (Bench(CONTROL, courses, entries, trials=n).sweeps() for n in (None, 5))
    assert [sweep.size for sweep in some.values()] == [20, 3]
    assert [sweep.size for sweep in more.values()] == [5, 5]
    friction = [s["turn", "feedback"].trials()["world.friction"] for s in (some, more)]
    assert not set(friction[0]) & set(friction[1])
    assert list(more["network", "feedback"].bases)[:3] == list(some["network", "feedback"].bases)


def test_dry_and_slippery_walls_do_not_overlap():
    sweeps = Bench.of("control", ["turn", "turn_slippery"], ["feedback"]).sweeps()
    dry, wet = (sweep.trials()["world.friction"] for sweep in sweeps.values())
    assert len(dry) == len(wet) == 200
    assert min(dry) >= 0.7 >= max(wet) >= 0.69
    assert min(wet) >= 0.5


def test_it_goes_on_and_takes_further_entries(tmp_path, monkeypatch):
    """Only what is not there is run, also by two workers."""
    driver().save(tmp_path / "driver.npz")
    first = [driven_by("feedback"), driven_by(f"mine={tmp_path / 'driver.npz'}")]
    rows = run_trials(Bench(CONTROL, [SHORT], first), out=tmp_path / "out").summary["rows"]
    assert [row["entry"] for row in rows] == ["feedback", "mine"]
    assert rows[0]["others"] == "4 timed_out"
    with monkeypatch.context() as patch:
        patch.setattr(dispatch, "run_rows", lambda batch: pytest.fail("ran again"))
        again = run_trials(Bench(CONTROL, [SHORT], first), out=tmp_path / "out")
        assert again.summary["rows"] == rows
    told = []
    more = Bench(
        CONTROL,
        [SHORT],
        [*first, driven_by(f"{open_loop.__name__}:EqualController")],
    )
    again = run_trials(more, out=tmp_path / "out", workers=2, progress=told.append)
    again = again.summary["rows"]
    assert again[:2] == rows
    assert again[2]["entry"] == f"{open_loop.__name__}.EqualController"
    assert [(status.found, status.done) for status in (told[0], told[-1])] == [(8, 8), (8, 12)]
    for name in FILES:
        assert (tmp_path / "out" / name).stat().st_size > 0, name
    table = pq.read_table(tmp_path / "out" / "trials.parquet")
    assert table.num_rows == 12
    assert table.column_names[:3] == ["trial", "course", "entry"]
    results = pq.read_table(tmp_path / "out" / "results.parquet")
    assert results.schema.field("energy_j").metadata[b"unit"] == b"J"
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["rows"][0]["trials"] == 4
    record = json.loads((tmp_path / "out" / "bench.json").read_text())
    assert list(record["bench"]["entries"]) == [row["entry"] for row in again]


def _trials(seconds: list[float], outcomes: list[str]) -> pa.Table:
    """Table of trials that took so long, each with its outcome."""
    figures = {measure.name: [1.0] * len(seconds) for measure in CONTROL.measures}
    figures |= {"duration_s": seconds, "success": [one == "reached_goal" for one in outcomes]}
    figures |= {"reason": [""] * len(outcomes)}
    return pa.table({"outcome": outcomes, **figures})


def test_rates_and_paired_differences():
    """Of time only over trials that both passed; what did not run does not count."""
    default = _trials([10.0, 11.0, 12.0, 50.0, 50.0], ["reached_goal"] * 3 + ["stuck"] * 2)
    other = _trials(
        [9.0, 10.5, 50.0, 4.0, math.nan],
        ["reached_goal", "reached_goal", "stuck", "reached_goal", "error"],
    )
    plain, paired = rows_of(CONTROL, {("turn", "feedback"): default, ("turn", "other"): other})
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
    written = page(Bench(CONTROL, [SHORT], [driven_by("feedback")]), [plain | {"course": "short"}])
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
        (["--course", "trun"], "did you mean 'turn'"),
        (["--controller", "feedbck"], "did you mean 'feedback'"),
        (["--controller", "xyz"], "jacobian, paper, driven, policy, module:Object"),
        (["--controller", "no_such:Thing"], "module 'no_such' cannot be imported"),
        (["--controller", "missing.npz"], "no such file, nor a shipped policy"),
        (["--controller", "a/b=equal"], "has no name for a folder"),
        (["--controller", "equal=paper"], "is the name of two"),
        (["--robot", "presser"], "is for suites of robots"),
        (["--robot", "a", "--robot", "b", "--controller", "c"], "give one for each --robot"),
        (["--trials", "12"], "is the number of trials; leave out --quick"),
    ],
)
def test_bad_arguments_are_refused(tmp_path, monkeypatch, capsys, arguments, told):
    out = tmp_path / "out"
    assert _status(monkeypatch, "--quick", "--out", str(out), *arguments) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not out.exists()


def test_an_unknown_suite_is_refused(tmp_path, monkeypatch, capsys):
    """With those there are."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["omnitrack", "bench", "contrl"])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert "did you mean 'control'" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


def test_folders_of_something_else_are_left_alone(tmp_path, monkeypatch, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    assert _status(monkeypatch, "--quick", "--out", str(tmp_path)) == 2
    assert "holds 'notes.txt' but no bench.json" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_an_entry_that_cannot_drive_is_refused_before_any_trial():
    with pytest.raises(InputError, match="one of each at least"):
        Bench(CONTROL, [SHORT], [])


OWN = """
title = "Short pipes"
[[measures]]
name = "duration_s"
unit = "s"
words = "time"
[[entries]]
name = "gentle"
words = "slowly"
changes = { "control.cruise_speed" = 0.05 }
[[courses]]
course = "mine.toml"
trials = 2
quick = 1
seed = 5
[[courses]]
name = "climb"
words = "up a pipe"
trials = 3
quick = 1
seed = 6
base = "straight"
[[courses.axes]]
path = "world.friction"
kind = "uniform"
low = 0.5
high = 0.9
"""
COURSE = 'words = "along"\nclimb_deg = 0\n[[pipes]]\nkind = "straight"\nlength = 1.0\n'


@pytest.fixture
def own_suite(tmp_path):
    """A suite file of a user's, beside a course file that it names."""
    (tmp_path / "mine.toml").write_text(COURSE)
    (tmp_path / "own.toml").write_text(OWN)
    return tmp_path / "own.toml"


def test_a_suite_of_a_user_is_a_file(own_suite):
    """Courses in bores and random trials of a scenario, its entries and others."""
    bench = Bench.of(own_suite, trials=1, changes={"run.time_limit": 0.05})
    assert (bench.name, [course.words for course in bench.courses]) == (
        "own",
        ["along", "up a pipe"],
    )
    rows = run_trials(bench).summary["rows"]
    assert [(row["course"], row["entry"]) for row in rows] == [
        ("mine", "gentle"),
        ("climb", "gentle"),
        ("all", "gentle"),
    ]
    assert [row["others"] for row in rows] == ["1 timed_out", "1 timed_out", "2 timed_out"]
    bases = [base for sweep in bench.sweeps().values() for base in sweep.bases.values()]
    assert {base.control.cruise_speed for base in bases} == {0.05}


def test_the_version_of_a_suite_is_that_of_its_file(own_suite):
    """The first where it names none."""
    assert load_suite(own_suite).version == 1
    own_suite.write_text("version = 3\n" + OWN)
    assert load_suite(own_suite).version == 3


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('base = "straight"', "", "needs one of base, course and missions"),
        ('words = "up a pipe"', "", "needs name and words"),
        ('name = "climb"', 'name = "mine"', "is the name of an earlier one"),
        ('course = "mine.toml"', 'course = "none.toml"', "none.toml"),
        ("seed = 5", "sed = 5", "sed"),
        (
            'course = "mine.toml"',
            'name = "far"\nwords = "far"\nmissions = { friction = [0.9, 0.5] }',
            r"courses\.0\.missions\.friction: must have the lower one first",
        ),
    ],
)
def test_faults_of_a_suite_file_are_told(own_suite, old, new, told):
    own_suite.write_text(OWN.replace(old, new))
    with pytest.raises(InputError, match=told):
        load_suite(own_suite)


@pytest.mark.parametrize("kind", [[1], {"a": 1}, 3, True])
def test_a_kind_of_robot_that_is_no_text_is_refused(kind):
    """At its key, as in a scenario."""
    with pytest.raises(InputError, match=r"robot\.kind"):
        robot_of({"robot.kind": kind})


def test_all_shipped_policies_are_entries():
    assert {*shipped_files("policies")} <= {*CONTROL.entries}


# Robots

SLUG = """<mujoco><worldbody><body name="slug"><freejoint/><site name="middle"/>
<geom type="capsule" size="0.03 0.03" mass="0.1"/></body></worldbody>
<actuator><general site="middle" gear="0 0 1 0 0 0"/></actuator></mujoco>"""
PUSH = """import numpy as np, omnitrack_sim as ot
class Push:
    def __init__(self, setup):
        self.ctrl = np.full((setup.n, 1), 1.2)
    def step(self, observation):
        return ot.Actuation(self.ctrl)
"""


@pytest.fixture
def outside(tmp_path, monkeypatch):
    """A folder of somebody else's, with a robot and its controller."""
    (tmp_path / "slug.xml").write_text(SLUG)
    (tmp_path / "push_control.py").write_text(PUSH)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_outside_robot_has_its_row_by_one_command(outside, monkeypatch, capsys):
    line = "bench --quick --alone --robot slug.xml --controller push_control:Push --workers 1"
    line += " --course straight_level --json"
    monkeypatch.setattr("sys.argv", ["omnitrack", *line.split()])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 0
    rows = json.loads(capsys.readouterr().out)
    (row,) = rows
    assert (row["course"], row["entry"]) == ("straight_level", "slug.push_control.Push")
    assert (row["passed"], row["trials"]) == (2, 2)
    assert row["min_friction"] == 0.5
    assert row["mean_speed_m_s"] > 0.01
    out = outside / "out" / "bench_mobility_quick"
    assert (out / "bench.png").is_file()
    assert "2 of 2" in (out / "results.md").read_text()


def test_courses_are_of_the_robots_size(outside):
    """Lengths in bores, with room for the robot, and time by its speed."""
    sweeps = Bench.of("mobility", ["elbow_15"], ["omnitrack", "slug.xml"], quick=True).sweeps()
    large, small = (next(iter(sweep.bases.values())) for sweep in sweeps.values())
    assert small.robot.nominal_bore == pytest.approx(0.06)
    for scenario in (large, small):
        bore, length = scenario.robot.nominal_bore, scenario.robot.length
        assert scenario.pipes[1].mean_radius == pytest.approx(1.5 * bore)
        assert scenario.pipes[0].length == pytest.approx(0.5 * bore + length)
        # As much room behind the tail as before the nose.
        assert scenario.start.distance == pytest.approx(scenario.pipes[0].length / 2)
        assert scenario.pipes[2].inner_diameter == pytest.approx(bore)
        assert scenario.control.cruise_speed == scenario.robot.nominal_speed
    assert small.time_limit_s > large.time_limit_s / 2


def test_straights_of_networks_hold_a_robot_and_half_a_bore():
    """However long it is; those of short robots are as long as the course says."""
    sweeps = Bench.of("mobility", ["network"], ["presser", "snake"], trials=3).sweeps()
    for (_, entry), sweep in sweeps.items():
        for scenario in sweep.bases.values():
            bore, room = scenario.robot.nominal_bore, scenario.robot.length
            fittings = scenario.network.fittings
            lengths = [f.length for f in fittings if f.kind == "straight"]
            least = max(2.0, room / bore + 0.5)
            assert (least > 2.0) == (entry == "snake")
            assert least * bore * (1 - 1e-9) <= min(lengths) < 1.2 * least * bore


def test_walls_are_from_oily_steel_to_dry_rubber_each_as_often():
    """Frictions of 0.3 to 1.0 in steps of 0.1; few trials are spread evenly over them."""
    for trials, wanted in ((16, [round(0.1 * k, 1) for k in range(3, 11)] * 2), (2, [0.5, 0.9])):
        (sweep,) = Bench.of("mobility", ["pull"], ["presser"], trials=trials).sweeps().values()
        assert sorted(sweep.trials()["world.friction"]) == sorted(wanted)


@pytest.mark.parametrize("kind", ["omnitrack", "presser", "pirate", "helix"])
def test_a_similar_robot_for_another_bore(kind):
    """Lengths grow with the bore, masses with its cube; a user's own name comes before it."""
    own, small = (
        robot_of(Bench.of("mobility", ["pull"], [source]).entries[0].changes)
        for source in (kind, f"small={kind}@0.08")
    )
    factor = 0.08 / own.nominal_bore
    assert small.nominal_bore == pytest.approx(0.08)
    assert small.length == pytest.approx(factor * own.length)
    assert small.mass == pytest.approx(factor**3 * own.mass)


def test_fixed_sizes_do_not_scale(outside):
    for source in ("snake@0.1", "slug.xml@0.1"):
        with pytest.raises(InputError, match="sizes that are no parameters"):
            Bench.of("mobility", ["pull"], [source])
    with pytest.raises(InputError, match="no bore in metres"):
        Bench.of("mobility", ["pull"], ["presser@-1"])


def test_every_shipped_robot_has_every_course():
    """Or a reason why it does not fit; not one of them is an abort."""
    assert {*ROBOTS} - {"mjcf"} <= {*load_suite("mobility").entries}
    sweeps = Bench.of("mobility", quick=True).sweeps()
    assert all(sweep.size in (1, 2) for sweep in sweeps.values() if not isinstance(sweep, str))
    assert [key for key, sweep in sweeps.items() if isinstance(sweep, str)] == []


@pytest.mark.parametrize(
    ("robot", "bore", "reason"),
    [("omnitrack", 0.3, "the arms reach bores from"), ("slug.xml", 0.054, "deep in the wall")],
)
def test_a_robot_that_does_not_fit_is_a_row(outside, robot, bore, reason):
    """By its own bores, or by what is seen once it has settled."""
    changes = {"pipes.0.inner_diameter": bore}
    bench = Bench.of("mobility", ["bore_small"], [robot], trials=1, changes=changes)
    (row,) = run_trials(bench).summary["rows"]
    assert (row["trials"], row["success"], row["others"]) == (0, None, "does not fit")
    assert reason in row["reason"]


def test_the_seat_is_no_force_of_the_run():
    """A chassis that is held where the nominal bore has it is no robot that presses."""
    short = {"run.time_limit": 0.1}
    trials = run_trials(
        Bench.of("mobility", ["bore_small"], ["snake"], trials=1, changes=short)
    ).table
    assert 0 < trials["contact_force_max_n"][0].as_py() < 300


def test_what_can_be_passed_counts_for_all_courses():
    """A pull is measured; rates are of the others, and of those together."""
    short = {"run.time_limit": 0.2}
    bench = Bench.of(
        "mobility", ["elbow_15", "tee_over", "pull"], ["presser"], quick=True, changes=short
    )
    rows = {row["course"]: row for row in run_trials(bench).summary["rows"]}
    assert list(rows) == ["elbow_15", "tee_over", "pull", "all"]
    assert rows["pull"]["success"] is None
    assert rows["pull"]["pull_held_n"] > 0
    assert (rows["all"]["passed"], rows["all"]["trials"]) == (0, 4)
    assert rows["all"]["others"] == "4 timed_out"


def test_min_friction():
    """At it and at all higher ones half of the trials pass, wherever those without one stand."""
    friction = [None, 0.3, 1.0, None, 0.5, 0.8, 0.8, 0.3]
    ends = ["stuck", "reached_goal", "reached_goal", "stuck", "stuck"]
    outcomes = [*ends, "reached_goal", "stuck", "reached_goal"]
    columns = {"world.friction": friction, "outcome": outcomes}
    columns["success"] = [outcome == "reached_goal" for outcome in outcomes]
    assert min_friction(pa.table(columns)) == 0.8
    assert math.isnan(min_friction(pa.table({**columns, "success": [False] * 8})))


def test_a_wrong_change_is_no_misfit():
    bench = Bench.of("mobility", ["bore_small"], ["presser"], changes={"world.frction": 1.0})
    with pytest.raises(InputError, match="frction"):
        bench.sweeps()


def _results(out, workers: int) -> tuple[bytes, ...]:
    short = {"run.time_limit": 0.3}
    bench = Bench.of(
        "mobility", ["elbow_15", "straight_up_90"], ["presser"], trials=3, changes=short
    )
    run_trials(bench, out=out, workers=workers)
    return tuple((out / name).read_bytes() for name in FILES)


def test_the_table_is_the_same_whoever_runs_it(tmp_path):
    """Where some batches were lost, and by other processes: every file, to the byte."""
    whole = _results(tmp_path / "one", workers=1)
    next((tmp_path / "one" / "parts").glob("*.parquet")).unlink()
    (tmp_path / "one" / "results.csv").unlink()
    assert _results(tmp_path / "one", workers=2) == whole


def test_a_folder_of_another_form_is_left_alone(tmp_path):
    _results(tmp_path, workers=1)
    other = Bench.of("mobility", ["elbow_15"], ["presser"], quick=True)
    with pytest.raises(
        OutputError, match="holds a different bench: quick is false there and true here"
    ):
        run_trials(other, out=tmp_path)


def test_a_robot_by_its_kind_is_the_one_that_was_built():
    """It has the motor that its paper names, and so has its passport; its sister, whose motor is
    not known, and a similar robot for another bore have that of the simulation."""
    assert robot_of(robot_entry("omnitrack").changes).motor is ot.MOTORS["pololu_1000_hpcb"]
    assert ot.PassportPlan.of("omnitrack").changes["robot.motor"] == "pololu_1000_hpcb"
    assert "robot.motor" not in robot_entry("climber").changes
    small = robot_of(robot_entry("omnitrack@0.1").changes).motor
    assert small.name == "simulation"
    assert small.stall_torque == pytest.approx(12.0 * 0.625**4)


def test_a_robot_of_ones_own_beside_the_shipped_ones_is_told_how_to_run_alone(monkeypatch):
    """And so is one of the same name; alone nothing is told."""

    def stop(*_: object, **__: object) -> None:
        raise ot.OutputError("stopped here")

    monkeypatch.setattr(ot, "run_trials", stop)
    command = ("bench", "--quick", "--course", "straight_level", "--robot")
    beside = omnitrack(*command, "mine=presser").stderr
    assert "runs beside 10 shipped entries; --alone leaves these out" in " ".join(beside.split())
    assert "beside" not in omnitrack(*command, "mine=presser", "--alone").stderr
    twice = omnitrack(*command, "presser")
    assert twice.returncode == 2
    assert "leave that out by --alone, or write NAME= before" in " ".join(twice.stderr.split())
