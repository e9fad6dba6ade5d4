"""Files that close the loop: the scenario.json of a run runs again, and values are set before
anything is checked."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import pytest
from runs import there_and_back

import omnitrack_sim as ot
from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.scenario import load_scenario, override, validate
from omnitrack_sim.trials.sweep_file import resolve

SAME = ("scenario.json", "timeline.csv", "trajectory.parquet", "replay.npz", "result.json")
SHORT = {"run.time_limit": 0.1}
PIPES = [{"kind": "straight", "length": 1.0}]
DRIVER = """
import numpy as np
from pydantic import BaseModel

import omnitrack_sim as ot


class Slow:
    class Parameters(BaseModel):
        part: float = 0.5

    def __init__(self, setup):
        self.speed = np.repeat((setup.settings.cruise_speed * setup.each("part"))[:, None], 3, 1)

    def step(self, observation):
        return ot.Command(self.speed)


TWICE = ot.Sensor(ot.Channel("twice", (3,), "m/s", "twice the belt speed"),
                  lambda state: 2 * state["belt_speed"])
LAST = ot.Metric("twice_last_m_s", "m/s", "at the end",
                 lambda run: run.trajectory["twice"][-1].tolist(), per_module=True)
"""


@pytest.fixture
def driver(tmp_path, monkeypatch) -> ModuleType:
    """A user's own module with a controller, a sensor and a metric, where Python finds it."""
    import importlib

    (tmp_path / "own_driver.py").write_text(DRIVER)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("own_driver")


def scenarios_of_all_kinds() -> dict[str, ot.Scenario]:
    """Pipes, a scaled robot with a motor, a mission through a network, and a controller, a sensor
    and a metric of a user's own."""
    own = {"control.kind": "own_driver:Slow", "control.parameters.part": 0.25}
    measured = {"record.sensors": ["own_driver:TWICE"], "record.metrics": ["own_driver:LAST"]}
    small = {
        "robot": {"scale": 0.625, "preload": 30, "motor": {"like": "simulation", "name": "m"}},
        "pipes": [{"kind": "straight", "length": 0.6, "inner_diameter": 0.1}],
        "start": {"distance": 0.07, "axis": [0.3, -0.5, 0.2]},
    }
    return {
        "tee": load_scenario("tee_turn", SHORT),
        "scaled": validate(small, changes=SHORT),
        "mission": override(there_and_back(), SHORT),
        "own": load_scenario("straight", SHORT | own | measured),
    }


@pytest.mark.parametrize("name", ["tee", "scaled", "mission", "own"])
def test_the_scenario_of_a_run_runs_again_to_the_same_bytes(driver, name, tmp_path):
    """scenario.json read as a file gives the same scenario, and its run the same files."""
    first = ot.run(scenarios_of_all_kinds()[name]).save(tmp_path / "first")
    again = load_scenario(first / "scenario.json")
    second = ot.run(again).save(tmp_path / "second")
    for file in SAME:
        assert (first / file).read_bytes() == (second / file).read_bytes(), file


@pytest.mark.parametrize("name", sorted(ot.shipped_files("scenarios")))
def test_every_resolved_scenario_reads_back_as_itself(name, tmp_path):
    """What a run writes of a shipped scenario is that scenario, byte for byte."""
    scenario = load_scenario(name)
    file = tmp_path / "scenario.json"
    file.write_text(scenario.model_dump_json(indent=2))
    assert load_scenario(file).model_dump_json(indent=2) == file.read_text()


def test_a_sweep_takes_the_scenario_of_a_run_as_its_base(tmp_path):
    """A base in JSON, found beside the sweep file."""
    file = tmp_path / "run.json"
    file.write_text(load_scenario("straight").model_dump_json())
    axes = [{"kind": "list", "path": "world.friction", "values": [0.5, 0.9]}]
    plain = {"name": "s", "base": "run.json", "axes": axes, "set": {"run.time_limit": 2.0}}
    sweep = resolve(plain, tmp_path)
    assert sweep.hash == resolve(plain | {"base": "straight"}).hash
    assert sweep.scenario(1).world.friction == 0.9


@pytest.mark.parametrize(
    "changes",
    [
        {"control.cruise_speed": 0.08, "world.gravity.2": -1.0, "run.goal_distance": 0.4},
        {"robot.preload": 7.0},
        {"robot.scale": 0.5, "pipes.0.inner_diameter": 0.08, "start.distance": 0.06},
        {"robot.scale": 0.5, "robot.preload": 7.0, "pipes.0.inner_diameter": 0.08},
        {"robot.motor": "pololu_1000_hpcb"},
        {"robot.motor.speed_bandwidth": 16.0},
        {"control.kind": "paper", "control.parameters.alignment.aim_elbow.1": 0.75},
        {"pipes.*.length": 0.7},
    ],
)
def test_set_with_the_file_is_what_override_makes_of_the_scenario(changes):
    """A change means the same before the check and after it: a value of a scaled robot is one of
    its own size, and below what the file leaves out stand the defaults."""
    data = {
        "robot": {"scale": 0.625, "preload": 30.0, "values_at_scale": 1.0},
        "pipes": [{"kind": "straight", "length": 0.6, "inner_diameter": 0.1}],
        "start": {"distance": 0.07},
    }
    assert validate(data, changes=changes) == override(validate(data), changes)


def test_set_mends_a_file():
    """Faulty values, tables of the wrong kind, and values of a scaled robot can be set right."""
    data = {
        "robot": {"scale": 0.625, "preload": -30},
        "control": {"cruise_speed": "fast", "kind": "magic"},
        "pipes": [{"kind": "straigt", "length": 0.6, "inner_diameter": 0.1}],
        "world": 5,
    }
    changes = {
        "world": {},
        "robot.preload": 7.0,
        "control.cruise_speed": 0.08,
        "control.kind": "paper",
        "pipes.0.kind": "straight",
        "start.distance": 0.07,
    }
    scenario = validate(data, changes=changes)
    assert scenario.robot.preload == 7.0  # of the robot's own size, not scaled again
    assert scenario.robot.reach == pytest.approx(0.625 * 0.0961)
    assert scenario.control.kind == "paper"
    assert (data["world"], data["robot"]) == (5, {"scale": 0.625, "preload": -30})


def test_set_mends_the_network_of_a_file(tmp_path):
    """Below ``network`` the file that it names is changed, and a whole mission can be set."""
    (tmp_path / "net.toml").write_text('[[fittings]]\nkind = "straight"\nname = "a"\nlength = -1\n')
    data = {"network": "net.toml"}
    mission = {"mission.start": "a.start", "mission.goals": ["a.end"]}
    with pytest.raises(ScenarioError, match=r"network: fittings\.0\.length"):
        validate(data, tmp_path, mission)
    scenario = validate(data, tmp_path, mission | {"network.fittings.0.length": 1.5})
    assert scenario.network is not None
    assert scenario.network.length == 1.5


def test_all_faults_of_file_and_changes_are_told_at_once():
    """Of the file, of its network, of own sensors, of parameters, and of paths that lead nowhere;
    a path that leads nowhere changes nothing."""
    data = {
        "seed": -1,
        "network": {"fittings": [{"kind": "straight", "name": "a", "lenght": 1.0}]},
        "mission": {"start": "a.start", "goals": ["a.end"]},
        "control": {"parameters": {"trakcing": {}}},
        "record": {"sensors": ["nowhere:X"]},
    }
    changes = {
        "contrl.kind": "paper",
        "run.goal_distanc": 1.0,
        "pipes.0.length": 1.0,
        "start.a.b": 2,
    }
    with pytest.raises(ScenarioError) as caught:
        validate(data, changes=changes)
    assert {fault.where for fault in caught.value.faults} == {
        "seed",
        "network.fittings.0.length",
        "network.fittings.0.lenght",
        "control.parameters.trakcing",
        "record.sensors.0",
        "contrl.kind",
        "run.goal_distanc",
        "pipes.0.length",
        "start.a.b",
    }


def test_a_network_with_faults_is_not_missing_as_well():
    """What is wrong with the network is the only fault of a scenario that is right otherwise."""
    network = {"fittings": [{"kind": "straight", "name": "a", "length": -1.0}]}
    with pytest.raises(ScenarioError) as caught:
        validate({"network": network, "mission": {"start": "a.start", "goals": ["a.end"]}})
    assert [fault.where for fault in caught.value.faults] == ["network.fittings.0.length"]


def test_faults_in_a_sweep_say_where_the_value_comes_from(tmp_path):
    """--set, the file's [set], or the base; --set mends what the base has wrong."""
    (tmp_path / "bad.json").write_text(json.dumps({"seed": -1, "pipes": PIPES}))
    axes = [{"kind": "grid", "path": "world.friction", "start": 0.3, "stop": 0.9, "count": 3}]
    plain = {"name": "s", "base": "bad.json", "axes": axes, "set": {"pipes.*.length": -1}}
    with pytest.raises(ot.SweepError) as caught:
        resolve(plain, tmp_path, {"control.kind": "papr"})
    assert {fault.where for fault in caught.value.faults} == {
        "base: seed",
        "set.pipes.0.length",
        "--set control.kind",
    }
    sweep = resolve(plain, tmp_path, {"seed": 3, "pipes.*.length": 2.0})
    assert sweep.bases["bad"].seed == 3
    assert sweep.bases["bad"].pipes[0].fitting().length_of_axes == 2.0


def test_parameters_that_json_cannot_say_are_refused(tmp_path, monkeypatch):
    """A user's own model may allow infinity; the scenario.json of a run could not say it."""
    text = DRIVER.replace("part: float = 0.5", 'part: float = float("inf")')
    (tmp_path / "endless_driver.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ScenarioError, match=r"control\.parameters\.part: is inf; it must be finit"):
        load_scenario("straight", {"control.kind": "endless_driver:Slow"})
    changes = {"control.kind": "endless_driver:Slow", "control.parameters.part": 0.5}
    assert load_scenario("straight", changes).control.parameters == {"part": 0.5}


def test_the_command_runs_a_saved_scenario(tmp_path, monkeypatch):
    """`omnitrack run DIR/scenario.json --set` is the run of DIR with one value changed."""
    from omnitrack_sim import cli

    monkeypatch.setattr(
        "omnitrack_sim.show.plots.run_figures.plot_summary", lambda result, path: path.touch()
    )

    def omnitrack(*arguments: str) -> Path:
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        options = ("--no-video", "--out", str(folder))
        monkeypatch.setattr("sys.argv", ["omnitrack", "run", *arguments, *options])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 0
        return folder

    first = omnitrack("straight", "--set", "run.time_limit=0.1")
    again = omnitrack(str(first / "scenario.json"))
    other = omnitrack(str(first / "scenario.json"), "--set", "robot.preload=20")
    for file in SAME:
        assert (first / file).read_bytes() == (again / file).read_bytes(), file
    assert ot.load_result(other).scenario.robot.preload == 20.0
