"""Joints, geoms and actuators of a model file are keys: set, swept, with units, in one batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from runs import same_record

import omnitrack_sim as ot
from omnitrack_sim.base.paths import Document, expand
from omnitrack_sim.robots.scene import compiled
from omnitrack_sim.sim.builder import batch_key, is_shared
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.trials.sweep_file import resolve

MODEL = """
<mujoco>
  <option integrator="implicitfast"/>
  <default><default class="tip"><geom size=".02"/></default></default>
  <worldbody>
    <body name="hull">
      <freejoint name="root"/>
      <geom name="hull" type="capsule" size=".02 .05" mass=".5"/>
      <body name="arm_1" pos="0 .03 0">
        <joint name="front" axis="1 0 0" stiffness="2" springref="20" damping=".1"/>
        <geom name="tip_1" class="tip" pos="0 .02 .02"/>
      </body>
      <body name="arm_2" pos="0 -.03 0">
        <joint name="rear" type="slide" axis="0 1 0" stiffness="200" damping="3"/>
        <geom name="tip_2" class="tip" pos="0 -.02 -.02"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="angle" joint="front" kp="5" kv="1"/>
    <position name="critical" joint="rear" kp="40" dampratio="1"/>
    <velocity name="speed" joint="rear" kv="3"/>
    <motor name="torque" joint="front" gear="10"/>
  </actuator>
</mujoco>
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch) -> Path:
    """A folder with the model."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arms.xml").write_text(MODEL)
    return tmp_path


def arms(**changes: Any) -> ot.Scenario:
    """A short run of it; keys with ``__`` for dots."""
    own = {path.replace("__", "."): value for path, value in changes.items()}
    return ot.load_scenario("straight", {"robot": "arms.xml", "run.time_limit": 0.2, **own})


def changed(path: str, value: Any) -> mujoco.MjModel:
    """The model of the robot with one value changed."""
    return compiled(ot.override(arms(), {path: value}).robot)


def test_values_are_those_of_the_file():
    """By MJCF's words, angles in radians; servos by their gains; nothing is changed by them."""
    robot = arms().robot
    assert isinstance(robot, ot.Mjcf)
    assert robot.joint["front"] == {
        "stiffness": 2.0,
        "springref": pytest.approx(np.radians(20)),
        "damping": 0.1,
        "armature": 0.0,
        "frictionloss": 0.0,
    }
    assert robot.geom["hull"] == {"size": (0.02, 0.05), "mass": 0.5}
    assert robot.geom["tip_1"] == {"size": (0.02,), "density": 1000.0}
    assert robot.actuator == {
        "angle": {"kp": 5.0, "kv": 1.0, "gear": 1.0},
        "critical": {"kp": 40.0, "gear": 1.0},
        "speed": {"kv": 3.0, "gear": 1.0},
        "torque": {"gear": 10.0},
    }
    alone = mujoco.MjModel.from_xml_string(MODEL)
    ours = compiled(robot)
    for field in ("jnt_stiffness", "qpos_spring", "actuator_biasprm", "geom_size", "body_mass"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(alone, field))


@pytest.mark.parametrize(
    ("path", "value", "field", "expected"),
    [
        ("joint.front.stiffness", 7.0, "jnt_stiffness", [0, 7, 200]),
        ("joint.*.damping", 0.5, "dof_damping", [*[0] * 6, 0.5, 0.5]),
        ("joint.rear.armature", 0.25, "dof_armature", [*[0] * 7, 0.25]),
        ("joint.front.frictionloss", 0.3, "dof_frictionloss", [*[0] * 6, 0.3, 0]),
        ("joint.front.springref", 0.5, "qpos_spring", [0, 0, 0, 1, 0, 0, 0, 0.5, 0]),
        ("geom.tip_*.size.0", 0.01, "geom_size", [[0.02, 0.05, 0], [0.01, 0, 0], [0.01, 0, 0]]),
        ("geom.hull.mass", 0.8, "body_mass", None),
        ("actuator.angle.kp", 9.0, "actuator_biasprm", None),
        ("actuator.*.gear", 4.0, "actuator_gear", None),
    ],
)
def test_a_value_reaches_the_model(path, value, field, expected):
    """Of the element that is named, or of all that a pattern fits."""
    model = changed(f"robot.{path}", value)
    if expected is not None:
        np.testing.assert_allclose(getattr(model, field), expected, atol=1e-12)
    elif field == "body_mass":
        assert model.body("hull").mass[0] == pytest.approx(value)
    elif field == "actuator_gear":
        assert model.actuator_gear[:, 0].tolist() == [value] * 4
    else:
        assert model.actuator("angle").gainprm[0] == value
        assert model.actuator("angle").biasprm[:3].tolist() == [0, -value, -1]
        assert model.actuator("speed").gainprm[0] == 3


@pytest.mark.parametrize(
    ("path", "value", "told"),
    [
        ("joint.frnt.stiffness", 1, "robot.joint.frnt: fits no name; did you mean 'front'?"),
        ("joint.front.stifness", 1, "robot.joint.front.stifness: unknown key; did you mean 'stiff"),
        ("joint.front.stiffness", -1, "robot.joint.front.stiffness: is -1; it must be a number fr"),
        ("joint.front.stiffness", "x", "robot.joint.front.stiffness: is 'x'; it must be a number"),
        ("joint.front", 3, "robot.joint.front: input should be a table"),
        ("geom.tip_1.size", 0.1, "robot.geom.tip_1.size: is 0.1; it must be a list of 1 number"),
        ("geom.tip_1.size", [0], "robot.geom.tip_1.size.0: is 0; it must be a number from 1e-06"),
        ("actuator.torque.kp", 1, "robot.actuator.torque.kp: unknown key (choose from: gear)"),
    ],
)
def test_what_there_is_not_is_told_with_its_place_and_choices(path, value, told):
    """At the key."""
    with pytest.raises(ot.ScenarioError) as refused:
        ot.override(arms(), {f"robot.{path}": value})
    assert told in str(refused.value)


def test_units_are_those_of_the_joint():
    """A hinge's are of torques, a slide's of forces; a pattern has one where all agree."""
    robot = arms().robot
    for path, unit in {
        "joint.front.stiffness": "N m/rad",
        "joint.rear.stiffness": "N/m",
        "joint.*.stiffness": None,
        "joint.f*.damping": "N m s/rad",
        "actuator.angle.kp": "N m/rad",
        "actuator.speed.kv": "N s/m",
        "geom.tip_1.size.0": "m",
        "geom.hull.mass": "kg",
        "bore": "m",
    }.items():
        assert robot.unit_at(path) == unit, path
    rows = {row.name: row.unit for row in robot.parameters()}
    assert rows["joint.rear.damping"] == "N s/m"


def test_a_sweep_varies_them_by_name_and_by_pattern(tmp_path):
    """Without a class; the table has the units."""
    sweep = resolve(
        {
            "name": "arms",
            "base": arms_file(tmp_path),
            "axes": [
                {"path": "robot.joint.front.stiffness", "kind": "list", "values": [1.0, 2.0]},
                {"path": "robot.actuator.*.kp", "kind": "list", "values": [3.0, 4.0]},
            ],
        },
        tmp_path,
    )
    robot = sweep.scenario(3).robot
    assert isinstance(robot, ot.Mjcf)
    assert robot.joint["front"]["stiffness"] == 2.0
    assert (robot.actuator["angle"]["kp"], robot.actuator["critical"]["kp"]) == (4.0, 4.0)
    table = ot.run_trials(sweep, out="swept").table
    assert {*table["outcome"].to_pylist()} <= {"timed_out", "slipping"}
    field = table.schema.field("robot.joint.front.stiffness")
    assert field.metadata == {b"unit": b"N m/rad"}
    assert len(sweep.batches()) == 1  # of one model
    with pytest.raises(ot.SweepError, match=r"there is no 'frnt'; did you mean 'front'"):
        resolve(
            {
                "name": "arms",
                "base": arms_file(tmp_path),
                "axes": [{"path": "robot.joint.frnt.stiffness", "kind": "list", "values": [1.0]}],
            },
            tmp_path,
        )


def arms_file(folder: Path) -> str:
    """The scenario as a file."""
    (folder / "arms.toml").write_text(
        'robot = "arms.xml"\n[run]\ntime_limit = 0.2\n[[pipes]]\nkind = "straight"\nlength = 1.0\n'
        "[start]\ndistance = 0.3\n"
    )
    return "arms.toml"


def test_the_short_form_of_a_robot_takes_changes(tmp_path):
    """As its table does."""
    file = tmp_path / arms_file(tmp_path)
    robot = ot.load_scenario(file, {"robot.joint.rear.damping": 5.0, "robot.bore": 0.15}).robot
    assert isinstance(robot, ot.Mjcf)
    assert (robot.joint["rear"]["damping"], robot.bore) == (5.0, 0.15)


@pytest.mark.parametrize(
    "path",
    [
        "robot.joint.front.stiffness",
        "robot.joint.rear.damping",
        "robot.joint.*.frictionloss",
        "robot.actuator.angle.kp",
        "robot.actuator.critical.kp",
        "robot.actuator.speed.kv",
    ],
)
def test_a_robot_runs_to_the_same_bytes_alone_and_beside_others(path):
    """Robots of one batch may differ in these values, without a model for each."""
    scenarios = [ot.override(arms(), {path: value}) for value in (0.5, 3.0, 20.0)]
    assert len({batch_key(one.model_dump(mode="json")) for one in scenarios}) == 1
    assert not is_shared(path.replace("*", "front"), "mjcf")
    together = run_batch(scenarios, no_load=False)
    for scenario, result in zip(scenarios, together, strict=True):
        assert same_record(ot.run(scenario, no_load=False), result)
    assert not same_record(together[0], together[2])


def test_what_makes_another_model_runs_in_a_batch_of_its_own():
    """Sizes, masses and armatures."""
    for path in ("robot.geom.tip_1.size.0", "robot.joint.front.armature", "robot.actuator.*.gear"):
        one, other = (ot.override(arms(), {path: value}) for value in (0.011, 0.012))
        keys = {batch_key(each.model_dump(mode="json")) for each in (one, other)}
        assert len(keys) == 2
        assert is_shared(path.replace("*", "angle"), "mjcf")


def test_another_file_brings_its_own_values(tmp_path):
    """Those of the first one are forgotten with its digest."""
    (tmp_path / "other.xml").write_text(
        MODEL.replace('name="front"', 'name="nose"').replace('joint="front"', 'joint="nose"')
    )
    scenario = ot.override(arms(), {"robot.file": "other.xml"})
    assert isinstance(scenario.robot, ot.Mjcf)
    assert set(scenario.robot.joint) == {"nose", "rear"}


def test_a_saved_run_reads_back_its_values(tmp_path):
    """And repeats itself."""
    scenario = ot.override(arms(), {"robot.joint.front.stiffness": 6.0})
    result = ot.run(scenario, no_load=False)
    result.save(tmp_path / "run")
    again = ot.load_result(tmp_path / "run", trust=True)
    assert again.scenario == scenario
    assert same_record(ot.run(tmp_path / "run" / "scenario.json", no_load=False), result)


def test_a_pattern_stands_for_the_keys_of_a_table_that_it_fits():
    """A key of that very name comes first, and what fits nothing stays as it is."""
    data = {"joint": {"wheel_1": {"d": 1}, "wheel_2": {"d": 2}, "arm": {"d": 3}}}
    assert expand(data, "joint.wheel_*.d") == ["joint.wheel_1.d", "joint.wheel_2.d"]
    assert len(expand(data, "joint.*.d")) == 3
    assert expand(data, "joint.x*.d") == ["joint.x*.d"]
    assert expand({"joint": {"*": {}, "a": {}}}, "joint.*.d") == ["joint.*.d"]
    scenario = Document(ot.Scenario, {"robot": {"kind": "mjcf", "file": "arms.xml"}})
    assert scenario.set("robot.joint.wheel_*.damping", 1.0) is None
    assert scenario.data["robot"]["joint"] == {"wheel_*": {"damping": 1.0}}


def test_a_capsule_between_two_points_has_one_size(place):
    """Its length is that between the points."""
    (place / "rod.xml").write_text(
        "<mujoco><worldbody><body name='rod'><freejoint/>"
        "<geom name='rod' type='capsule' fromto='0 0 0 0 0 .1' size='.02'/></body></worldbody>"
        "</mujoco>"
    )
    robot = ot.Mjcf(file="rod.xml")
    assert robot.geom == {"rod": {"size": (0.02,), "density": 1000.0}}
    thick = ot.Mjcf(file="rod.xml", geom={"rod": {"size": [0.03]}})
    np.testing.assert_allclose(compiled(thick).geom_size[0], [0.03, 0.05, 0])


def test_a_sweep_of_a_strangers_robot_is_looked_at_without_its_file(tmp_path):
    """Table, summary and figure, with the units; its trials are run with trust alone."""
    axis = {"path": "robot.joint.front.stiffness", "kind": "grid", "start": 1.0, "stop": 3.0}
    data = {"name": "arms", "base": arms_file(tmp_path), "axes": [axis | {"count": 3}]}
    sweep = resolve(data, tmp_path)
    ran = ot.run_trials(sweep, out="swept")
    figure = ot.plot_sweep(ran, over=axis["path"]).axes[0].get_xlabel()
    (tmp_path / "arms.xml").unlink()
    read = ot.load_sweep_result("swept")
    assert read.table.equals(ran.table)
    assert (read.summary, read.plan.hash) == (ran.summary, sweep.hash)
    assert ot.plot_sweep("swept", over=axis["path"]).axes[0].get_xlabel() == figure
    assert figure.endswith("[N m/rad]")
    (tmp_path / "swept" / "trials.parquet").unlink()
    assert ot.load_sweep_result("swept").table.num_rows == 3
    with pytest.raises(ot.OutputError, match="names what is not here"):
        ot.load_sweep_result("swept", trust=True)
