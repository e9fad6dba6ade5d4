"""Sweep files: what is accepted, how axes become trials, how faults are told."""

import json
import math
import re

import numpy as np
import pytest
from documents import page

import omnitrack_sim as ot
from omnitrack_sim import (
    Omnitrack,
    ScenarioError,
    SweepError,
    load_scenario,
    load_sweep,
    override,
    shipped_files,
)
from omnitrack_sim.base.table import Table, Unit, marks_of
from omnitrack_sim.pipes.fittings.kinds import shipped_fittings
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.model import unit_of, words_of
from omnitrack_sim.sim.builder import batch_key
from omnitrack_sim.trials.sweep_figure import spreads
from omnitrack_sim.trials.sweep_file import resolve

GRID = {"path": "world.friction", "kind": "grid", "start": 0.2, "stop": 0.8, "count": 3}
KIND = {"path": "control.kind", "kind": "list", "values": ["jacobian", "paper"]}
UNIFORM = {"path": "robot.preload", "kind": "uniform", "low": 10, "high": 30}
GRAVITY = {"path": "world.gravity", "kind": "direction"}
SHIPPED = {
    "tee_orientation": 120,
    "tee_monte_carlo": 10_000,
    "tee_merge": 1_000,
    "elbow_orientation": 120,
    "preload_friction": 144,
    "design_reach_length": 400,
    "tee_springs": 600,
    "tee_factors": 2160,
    "tee_lugs": 300,
    "fig14_pairs": 25,
    "elbow_drives": 360,
    "timestep_helix": 36,
}


def _sweep(*axes, **keys):
    return resolve({"name": "s", "base": "tee_turn", "axes": list(axes), **keys})


def _faults(*axes, **keys) -> dict[str, str]:
    with pytest.raises(SweepError) as caught:
        _sweep(*axes, **keys)
    return {fault.where: str(fault) for fault in caught.value.faults}


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_sweeps_are_whole(name):
    """Every shipped sweep loads, has its number of trials, says what it answers, and its second and
    last but one are
    valid: the first and last of ``fig14_pairs`` have the start as the goal."""
    sweep = load_sweep(name)
    assert set(shipped_files("sweeps")) == set(SHIPPED)
    assert sweep.size == SHIPPED[name] == sum(len(batch.trials) for batch in sweep.batches())
    comment = re.match(r"(#.*\n)+", shipped_files("sweeps")[name].read_text())
    assert comment
    assert "Answers" in comment[0]
    for index in (1, sweep.size - 2):
        sweep.scenario(index)


def test_values_that_only_go_together_are_no_fault():
    """A goal that is the base's start goes with another start; a port that there is not goes with
    none."""
    ends = {"kind": "list", "values": ["inlet", "top"]}
    start, goal = ends | {"path": "mission.start"}, ends | {"path": "mission.goals.0"}
    assert resolve({"name": "s", "base": "missions/fig14", "axes": [start, goal]}).size == 4
    with pytest.raises(
        SweepError, match=r"^axes.1.values.0: there is no port 'cellar' \(choose from: inlet, "
    ):
        resolve(
            {
                "name": "s",
                "base": "missions/fig14",
                "axes": [start, goal | {"values": ["cellar", "top"]}],
            }
        )


def test_ten_thousand_trials_are_expanded_without_a_scenario(monkeypatch):
    """Expanding and batching the Monte Carlo validates no scenario and lays no route, which would
    take minutes."""
    sweep = load_sweep("tee_monte_carlo")

    def refuse(*_args, **_keys):
        raise AssertionError("a scenario is made")

    monkeypatch.setattr(Scenario, "__init__", refuse)
    monkeypatch.setattr(Scenario, "model_validate_json", refuse)
    monkeypatch.setattr(Scenario, "route", property(refuse))
    assert len(sweep.batches()) == 313
    with pytest.raises(AssertionError, match="a scenario is made"):
        sweep.scenario(0)


def test_crossed_axes_run_first_slowest_and_share_their_draws():
    """Grid and list are crossed; every combination has the same random values."""
    columns = _sweep(KIND, UNIFORM, GRID, samples=2).trials()
    assert columns["control.kind"] == ["jacobian"] * 6 + ["paper"] * 6
    assert columns["world.friction"] == pytest.approx([0.2, 0.2, 0.5, 0.5, 0.8, 0.8] * 2)
    assert columns["robot.preload"] == columns["robot.preload"][:2] * 6
    assert len(set(columns["robot.preload"])) == 2


def test_combinations_have_draws_of_their_own_when_asked():
    """Independent draws differ between the combinations, and cover each axis evenly over all of
    them."""
    columns = _sweep(
        KIND, UNIFORM, samples=50, sampling="latin_hypercube", draws="independent"
    ).trials()
    preload = np.array(columns["robot.preload"])
    assert columns["control.kind"] == ["jacobian"] * 50 + ["paper"] * 50
    assert (preload[:50] != preload[50:]).all()
    assert (np.sort(np.floor((preload - 10) / 20 * 100)) == np.arange(100)).all()


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_draws_have_their_distributions_and_repeat(sampling):
    """Uniform, truncated normal and direction have their ranges and means; the seed alone
    decides."""
    normal = {"path": "world.friction", "kind": "normal", "mean": 0.8, "std": 0.2, "low": 0.7}
    axes = (UNIFORM, normal, GRAVITY)
    columns = _sweep(*axes, samples=1000, sampling=sampling).trials()
    preload, friction = np.array(columns["robot.preload"]), np.array(columns["world.friction"])
    gravity = np.array(columns["world.gravity"])
    assert 10 <= preload.min() < preload.max() <= 30
    assert preload.mean() == pytest.approx(20, abs=0.6)
    density = math.exp(-0.125) / math.sqrt(2 * math.pi)
    above = 0.5 * math.erfc(-0.5 / math.sqrt(2))
    assert friction.min() >= 0.7
    assert friction.mean() == pytest.approx(0.8 + 0.2 * density / above, abs=0.02)
    assert np.linalg.norm(gravity, axis=-1) == pytest.approx(np.full(1000, 9.81))
    assert np.abs(gravity.mean(axis=0)).max() < 0.6
    assert columns == _sweep(*axes, samples=1000, sampling=sampling).trials()
    assert columns != _sweep(*axes, samples=1000, sampling=sampling, seed=1).trials()


def test_a_normal_far_above_its_mean_stays_in_its_range():
    """A truncation eight deviations out neither leaves its range nor collapses."""
    axis = {
        "path": "world.friction",
        "kind": "normal",
        "mean": 0.0,
        "std": 0.1,
        "low": 0.8,
        "high": 0.9,
    }
    values = _sweep(axis, samples=200).trials()["world.friction"]
    assert min(values) >= 0.8
    assert max(values) <= 0.9
    assert len(set(values)) > 150


def test_a_clipped_normal_lies_at_its_end_as_often_as_beyond():
    """Half of the values of one clipped at its mean; the others keep their distribution."""
    axis = {"path": "robot.preload", "kind": "normal", "mean": 20.0, "std": 5.0, "low": 20.0}
    values = np.array(_sweep({**axis, "clipped": True}, samples=1000).trials()["robot.preload"])
    assert np.mean(values == 20.0) == pytest.approx(0.5, abs=0.05)
    assert np.std(values[values > 20.0] - 20.0) == pytest.approx(
        5 * math.sqrt(1 - 2 / math.pi), 0.1
    )


def test_a_trial_is_the_override_of_its_base():
    """scenario(i) is the base with the axis values, on all paths of the axis and all pipes of a
    star."""
    bore = {
        "path": ["pipes.*.inner_diameter", "robot.preload"],
        "kind": "list",
        "values": [0.16, 0.17],
    }
    sweep = _sweep(bore, GRID, set={"control.align": False})
    expected = override(
        load_scenario("tee_turn"),
        {
            **{f"pipes.{i}.inner_diameter": 0.17 for i in range(3)},
            "robot.preload": 0.17,
            "world.friction": 0.2,
            "control.align": False,
        },
    )
    assert sweep.scenario(3).hash == expected.hash


def test_several_bases_are_the_first_axis():
    """A list of bases is crossed first and makes a group."""
    sweep = _sweep(GRID, base=["tee_turn", "elbow_short"])
    assert sweep.trials()["base"] == ["tee_turn"] * 3 + ["elbow_short"] * 3
    assert sweep.scenario(5).name == "elbow_short"
    assert sweep.groups == ("base", "world.friction")


@pytest.mark.parametrize(("kind", "most"), [("list", 12), ("grid", 24)])
def test_axes_of_few_values_make_groups(kind, most):
    """As few as a summary can list."""
    for count in (most, most + 1):
        axis = {"path": "world.friction", "kind": kind}
        axis |= (
            {"start": 0.2, "stop": 0.8, "count": count}
            if kind == "grid"
            else {"values": np.linspace(0.2, 0.8, count).tolist()}
        )
        assert _sweep(axis).groups == (("world.friction",) if count == most else ())


def test_a_base_may_be_a_file_beside_the_sweep(tmp_path):
    """Paths of bases are relative to the sweep's file, whose stem is its name."""
    (tmp_path / "pipe.toml").write_text('[[pipes]]\nkind = "straight"\nlength = 0.6\n')
    text = 'base = "pipe.toml"\n[[axes]]\npath = "world.friction"\nkind = "list"\nvalues = [0.5]\n'
    (tmp_path / "mine.toml").write_text(text)
    sweep = load_sweep(tmp_path / "mine.toml", {"robot.preload": 20})
    assert sweep.name == "mine"
    assert sweep.scenario(0).pipes[0].length == 0.6  # type: ignore[union-attr]
    assert sweep.scenario(0).robot.preload == 20


def test_batches_never_mix_models_and_are_fixed_by_the_file():
    """Trials of one model are together in order, at most batch of them; the key is that of
    runs."""
    reach = {"path": "robot.reach", "kind": "grid", "start": 0.095, "stop": 0.097, "count": 2}
    sweep = _sweep(GRID, reach, batch=2)
    batches = sweep.batches()
    assert [[trial.index for trial in batch.trials] for batch in batches] == [
        [0, 2],
        [4],
        [1, 3],
        [5],
    ]
    assert len({batch.hash for batch in batches}) == 4
    keys = [
        {batch_key(sweep.scenario(trial.index).model_dump(mode="json")) for trial in batch.trials}
        for batch in batches
    ]
    assert all(len(found) == 1 for found in keys)
    assert len({batch.model for batch in batches}) == 2 == len(set.union(*keys))
    assert keys[0] == keys[1] != keys[2] == keys[3]


def test_the_hash_tells_what_the_table_depends_on():
    """Name, groups and labels do not change the hash; axes, base and seed do."""
    same = _sweep(KIND).hash
    assert _sweep(KIND | {"labels": ["a", "b"]}, name="other", group_by=[]).hash == same
    assert same not in {
        _sweep(KIND, seed=1).hash,
        _sweep(GRID).hash,
        _sweep(KIND, set={"control.align": False}).hash,
    }


def test_parts_are_known_by_all_that_their_rows_depend_on():
    """Another value of the base, of an axis or of the seed gives part files of other names; another
    name of the sweep does not."""

    def hashes(*axes, **keys):
        return [batch.hash for batch in _sweep(*axes, batch=2, **keys).batches()]

    usual = hashes(GRID, UNIFORM)
    assert len(set(usual)) == len(usual) == 2
    assert hashes(GRID, UNIFORM, name="other", group_by=[]) == usual
    for others in (
        hashes(GRID, UNIFORM, set={"robot.reach": 0.0965}),
        hashes(GRID | {"start": 0.3, "stop": 0.9}, UNIFORM),
        hashes(GRID, UNIFORM, seed=1),
        hashes(GRID, UNIFORM, base="tee_straight"),
    ):
        assert not set(others) & set(usual)


def test_whole_numbers_and_decimals_are_one_value():
    """1 and 1.0 give the same trial, and a grid fits a key of whole numbers."""
    sweep = _sweep(KIND | {"path": "robot.preload", "values": [20]})
    assert type(sweep.trials()["robot.preload"][0]) is float
    assert sweep.crossed["robot.preload"] == sweep.trials()["robot.preload"]
    assert sweep.label("robot.preload", sweep.crossed["robot.preload"][0]) == "20"
    lugs = GRID | {"path": "robot.lugs_per_track", "start": 5, "stop": 15}
    assert _sweep(lugs).trials()["robot.lugs_per_track"] == [5, 10, 15]
    assert "whole numbers" in _faults(lugs | {"stop": 16})["axes.0.path"]


def test_a_list_axis_sets_the_motor_by_name():
    """A table that has names, such as the robot's motor, may be an axis of names; a misspelt one
    lists the choices."""
    motors = KIND | {"path": "robot.motor", "values": ["simulation", "pololu_1000_hpcb"]}
    sweep = _sweep(motors)
    assert [sweep.scenario(i).robot.motor.name for i in (0, 1)] == motors["values"]
    assert len(sweep.batches()) == 2
    faults = _faults(motors | {"values": ["simulation", "pololu"]})
    assert "choose from: simulation, pololu_1000_hpcb" in faults["axes.0.values.1"]
    assert "is a table" in _faults(motors | {"values": [1.0]})["axes.0.path"]


def test_the_size_of_the_robot_is_an_axis():
    """Each value of ``robot.scale`` makes a model of its own, with the values of that size."""
    sizes = GRID | {"path": "robot.scale", "start": 0.95, "stop": 1.05}
    sweep = _sweep(sizes)
    assert sweep.scenario(0).robot == Omnitrack(scale=0.95)
    assert len(sweep.batches()) == 3


def test_a_trial_that_does_not_fit_is_no_fault_of_the_file():
    """Values out of range make an invalid trial."""
    sweep = _sweep(GRID | {"path": "robot.preload", "start": -1})
    with pytest.raises(ScenarioError, match=r"robot\.preload"):
        sweep.scenario(0)


def test_all_faults_of_the_form_are_told_at_once():
    """Every fault of the tables has its path and its choices."""
    axes = [
        {"path": "a", "kind": "sobol"},
        UNIFORM | {"high": 1},
        {"kind": "grid", "start": 1},
        KIND | {"path": 5},
    ]
    faults = _faults(*axes, {"path": "x"}, bach=3, samples=0, sampling="lhs")
    assert set(faults) == {
        "samples",
        "sampling",
        "bach",
        "axes.0.kind",
        "axes.1.high",
        "axes.2.path",
        "axes.2.stop",
        "axes.2.count",
        "axes.3.path",
        "axes.4.kind",
    }
    assert 'sampling = "sobol" at the top' in faults["axes.0.kind"]
    assert "latin_hypercube" in faults["sampling"]
    assert "batch" in faults["bach"]
    assert "over low, 10" in faults["axes.1.high"]


def test_all_faults_in_the_light_of_the_base_are_told_at_once():
    """Unknown paths, misspelt words, unfit kinds of axis, clashes and groups are named with the
    choices."""
    faults = _faults(
        KIND | {"path": "control.knd"},
        KIND | {"values": ["jacobian", "papr"]},
        GRID | {"path": "pipes.0"},
        GRID | {"path": "control.align"},
        GRID | {"path": "world.gravity"},
        GRID,
        GRID,
        GRAVITY | {"path": "world.friction"},
        set={"world.friction": 0.5},
        group_by=["robot.reach"],
    )
    assert "cruise_speed" in faults["axes.0.path"]
    assert "choose from: jacobian, paper, equal" in faults["axes.1.values.1"]
    assert "is a table" in faults["axes.2.path"]
    assert "list axis" in faults["axes.3.path"]
    assert "vector" in faults["axes.4.path"]
    assert "set by axes.5 too" in faults["axes.6.path"]
    assert "axes.7.path" in faults
    assert "set by axes.5 too" in faults["set.world.friction"]
    assert "world.friction" in faults["group_by.0"]


@pytest.mark.parametrize(
    ("keys", "where", "told"),
    [
        ({"base": "nowhere"}, "base: nowhere", "tee_turn"),
        ({"base": 3}, "base", "neither a text nor a list"),
        ({"axes": []}, "axes", "at least one axis"),
        ({"samples": 1_000_000}, "axes", "at most 1000000"),
        ({"set": {"control.aling": 1}}, "set.control.aling", "align"),
        ({"set": {"world.friction": -1}}, "set.world.friction", "greater"),
    ],
)
def test_single_faults(keys, where, told):
    """Faults of the base, of missing axes and of size."""
    data = {"name": "s", "base": "tee_turn", "axes": [KIND, UNIFORM]} | keys
    with pytest.raises(SweepError) as caught:
        resolve(data)
    assert told in {fault.where: str(fault) for fault in caught.value.faults}[where]


def test_units_are_those_of_the_documents():
    """Every unit in the code stands beside its key in scenarios.md, and every robot parameter
    has its own."""
    text = page("scenarios")
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in text.splitlines()
        if line.startswith("| `")
    ]
    told = {
        (key, cell)
        for cells in rows
        for key in re.findall(r"`(\w+)`", cells[0])
        for cell in cells[1:]
    }
    tables = [kind.Table for kind in shipped_fittings().values()]
    pipes = {
        f"pipes.{k}": unit.symbol for table in tables for k, unit in marks_of(table, Unit).items()
    }
    keys = {
        f"{table}.{key}": unit.symbol
        for table, info in Scenario.model_fields.items()
        if isinstance(info.default, Table) and table != "sensing"
        for key, unit in marks_of(type(info.default), Unit).items()
    }
    for path, unit in (keys | pipes).items():
        key = path.rpartition(".")[2]
        assert unit == "1" or (key, unit) in told, path
    assert unit_of("start.theta5_deg") == "deg"
    assert unit_of("pipes.*.inner_diameter") == unit_of("pipes.2.length") == "m"
    assert unit_of("world.gravity.2") == "m/s²"
    assert unit_of("control.kind") is None
    assert words_of("start.theta5_deg") == "theta5 at the start"
    assert (words_of("world.friction"), words_of("control.kind")) == ("friction", "control kind")
    assert words_of("pipes.0.inner_diameter") == "pipes 0 inner diameter"
    assert (words_of("physics.timestep"), words_of("base")) == ("physics timestep", "base")
    robot = Omnitrack(roll_motor="simulation")
    for row in robot.parameters():
        assert unit_of(f"robot.{row.name}", [robot]) == (row.unit or None)


def test_a_sweep_file_in_json_form_is_the_same():
    """The resolved sweep goes through JSON and back unchanged."""
    sweep = _sweep(KIND, UNIFORM, GRAVITY, samples=3)
    again = type(sweep).model_validate_json(sweep.model_dump_json())
    assert again.hash == sweep.hash
    assert json.dumps(again.trials()) == json.dumps(sweep.trials())


class Hinged(ot.Robot):
    """A robot whose stiffness is not that of the package's own."""

    spring_stiffness: float = ot.quantity(2.0, "N m/rad", "assumed", "of its hinge")
    blades: int = 3

    @property
    def nominal_bore(self) -> float:
        """Inner diameter, m."""
        return 0.16

    @property
    def length(self) -> float:
        """Nose to tail, m."""
        return 0.1

    def spec(self):
        """A ball."""
        import mujoco

        spec = mujoco.MjSpec()
        ball = spec.worldbody.add_body(name="chassis")
        ball.add_freejoint()
        ball.add_geom(size=[0.05, 0, 0])
        return spec


def test_units_of_a_robots_values_are_its_own(tmp_path):
    """On the axis and in the schema of the table: of no other robot with a value of that name."""
    data = {
        "name": "own",
        "base": "straight",
        "set": {"robot.kind": Hinged.kind, "run.time_limit": 0.02},
        "axes": [
            {"path": "robot.spring_stiffness", "kind": "list", "values": [1.0, 2.0]},
            {"path": "robot.blades", "kind": "list", "values": [3]},
        ],
    }
    sweep = resolve(data)
    assert sweep.units == {"robot.spring_stiffness": "N m/rad", "robot.blades": None}
    assert [spread.unit for spread in spreads(sweep)] == ["N m/rad", "1"]
    table = ot.run_trials(sweep, out=tmp_path / "own").table
    assert table.schema.field("robot.spring_stiffness").metadata == {b"unit": b"N m/rad"}
    assert table.schema.field("robot.blades").metadata is None
    assert ot.load_sweep_result(tmp_path / "own").table.schema.equals(table.schema, True)
    other = resolve({**data, "set": {}, "axes": [data["axes"][0]]})
    assert other.units == {"robot.spring_stiffness": "N/m"}
    runs = [ot.run(sweep.scenario(i), no_load=False) for i in (0, 1)]
    assert ("robot.spring_stiffness", "N m/rad") in {
        (v.name, v.unit) for v in ot.compare(*runs).values
    }
