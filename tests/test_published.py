"""The published models in plain MuJoCo and in Gymnasium: they drive, within the robot's limits."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import gymnasium
import mujoco
import numpy as np
import pytest
from documents import page
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.utils.env_checker import check_env
from scipy.stats import qmc

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.kinematics import elbow_speeds

MODELS = Path(__file__).parents[1] / "models"
PAGE = page("mujoco")
NUMBERS = (1, 2, 3)
EVERY = sorted(path.name for path in MODELS.glob("*.xml"))
SCENES = [name for name in EVERY if name.startswith("scene_")]
DRIVEN = ["robot.xml", *SCENES]


def opened(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A model in its keyframe ``start``, where it has one."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / name))
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    return model, data


def source(word: str) -> str:
    """Return the one example of mujoco.md that has a word in it."""
    (code,) = (code for code in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if word in code)
    return code


def example(word: str) -> dict:
    """Run the example of mujoco.md that has a word in it; returns what it defines."""
    names = {"__name__": "mujoco_page"}
    exec(compile(source(word), "mujoco.md", "exec"), names)
    return names


def drive(model, data, seconds: float, belts=(0.0, 0.0, 0.0), roll: float = 0.0) -> None:
    """Nothing but ``mj_step`` under constant controls."""
    for number, speed in zip(NUMBERS, belts, strict=True):
        data.actuator(f"belt_{number}").ctrl = speed
        data.actuator(f"roll_{number}").ctrl = roll
    mujoco.mj_step(model, data, nstep=round(seconds / model.opt.timestep))


def belt_forces(data) -> np.ndarray:
    """What the motors give at the belts, (3,) N."""
    return np.array([data.actuator(f"belt_{number}").force[0] for number in NUMBERS])


def test_there_are_the_models_that_the_documents_name():
    """A robot, four fittings and three scenes."""
    assert len(EVERY) == 8
    assert SCENES == ["scene_elbow.xml", "scene_straight.xml", "scene_tee.xml"]


@pytest.mark.parametrize("name", EVERY)
def test_contract_of_every_model(name):
    """It compiles and has a camera. What moves has the robot's mass, a keyframe and six bounded
    controls, and runs under quasi-random ones without a warning and the same again."""
    ends = []
    for _ in range(2 if name == "robot.xml" else 1):
        model, data = opened(name)
        assert model.ncam >= 1
        assert model.nkey == (model.nq > 0)
        assert model.nu == (6 if name in DRIVEN else 0)
        assert model.actuator_ctrllimited.all()
        assert (model.actuator_ctrlrange[:, 0] < model.actuator_ctrlrange[:, 1]).all()
        if model.nu:
            assert model.body_mass.sum() == pytest.approx(Omnitrack().mass, rel=0.01)
            low, high = model.actuator_ctrlrange.T
            for sample in qmc.Sobol(model.nu, seed=1).random_base2(3):
                data.ctrl[:] = low + (high - low) * sample
                mujoco.mj_step(model, data, nstep=50)
        assert np.isfinite(data.qpos).all()
        assert not data.warning.number.any()
        ends.append(data.qpos.tobytes())
    assert len(set(ends)) == 1


@pytest.mark.parametrize("name", DRIVEN)
def test_limits_are_those_of_the_robot(name):
    """Belt force is torque limit over lug radius; belts run as fast as the motor does at that
    torque; rolls go half a turn either way with the rotary motor's torque."""
    model, _ = opened(name)
    robot = Omnitrack()
    force = robot.motor.torque_limit / robot.lug_radius
    speed = robot.motor.full_torque_speed * robot.lug_radius
    line = robot.motor.stall_torque * (1 - speed / robot.lug_radius / robot.motor.no_load_speed)
    assert line == pytest.approx(robot.motor.torque_limit)
    for number in NUMBERS:
        belt, roll = model.actuator(f"belt_{number}"), model.actuator(f"roll_{number}")
        assert belt.forcerange == pytest.approx([-force, force], rel=1e-5)
        assert belt.ctrlrange == pytest.approx([-speed, speed], rel=1e-5)
        assert roll.forcerange == pytest.approx([-robot.roll_torque, robot.roll_torque])
        assert roll.ctrlrange == pytest.approx([-math.pi, math.pi], rel=1e-5)


@pytest.mark.parametrize("name", SCENES)
def test_scenes_start_in_equilibrium(name):
    """In the keyframe the modules press with their preload, and the robot stands by itself."""
    model, data = opened(name)
    start = data.qpos.copy()
    mujoco.mj_step(model, data)
    slides = [data.joint(f"slide_{number}").qvel[0] for number in NUMBERS]
    assert np.abs(slides).max() < 1e-3
    drive(model, data, 0.5)
    for number in NUMBERS:
        found, *force = data.sensor(f"contact_{number}").data[:4]
        assert found == Omnitrack().lugs_per_track
        assert math.hypot(*force[:2]) == pytest.approx(Omnitrack().preload, rel=0.01)
    moved = np.abs(data.qpos - start)
    assert moved[:2].max() < 1e-6
    assert moved[2] < 4e-4  # the servos hold by a speed error, 0.6 mm/s under a third of the weight


def test_the_straight_scene_climbs_as_the_package_does():
    """With ``mj_step`` alone the robot climbs a vertical pipe more than six times as far as its
    tracks are long, at the speed and with the belt force of the package's own run, within 1 %."""
    scenario = ot.override(ot.load_scenario("vertical_climb"), {"run.time_limit": 1.5})
    there = ot.run(scenario).trajectory
    late = there.time > 1.0
    speed = np.polyfit(there.time[late], there["position"][late, 2], 1)[0]
    force = there["motor_torque"][late].mean() / Omnitrack().lug_radius

    model, data = opened("scene_straight.xml")
    assert model.opt.gravity.tolist() == [0, 0, -9.81]
    drive(model, data, 0.5, belts=(0.1, 0.1, 0.1))
    begun = data.qpos[2]
    drive(model, data, 6.0, belts=(0.1, 0.1, 0.1))
    assert data.qpos[2] - begun == pytest.approx(6.0 * speed, rel=0.01)
    assert belt_forces(data) == pytest.approx(force, rel=0.01)
    assert np.abs(data.qpos[:2]).max() < 1e-5
    assert not data.warning.number.any()


def test_a_rolled_module_drives_as_the_theory_of_balls_says():
    """At 60 degrees of roll the wall passes at half of the belt speed, at 180 backward, as far as
    the 7.5 degrees that a piece of the wall spans let it; the roll motor keeps its speed."""
    for roll in (math.pi / 3, math.pi):
        model, data = opened("scene_straight.xml")
        model.opt.gravity[:] = 0
        drive(model, data, 1.0, roll=roll)
        rates = [data.joint(f"roll_{number}").qvel[0] for number in NUMBERS]
        assert max(rates) < 1.02 * Omnitrack().roll_rate
        drive(model, data, 2.0, roll=roll)
        rolls = np.array([data.joint(f"roll_{number}").qpos[0] for number in NUMBERS])
        assert rolls == pytest.approx(roll, abs=2e-3)
        belts = np.full(3, 0.1)
        drive(model, data, 0.5, belts=belts, roll=roll)
        begun = data.qpos[2]
        drive(model, data, 0.5, belts=belts, roll=roll)
        ratio = (data.qpos[2] - begun) / 0.05
        # Balls lose speed gradually, with the cosine of the roll.
        within = np.cos([roll - math.radians(3.75), roll + math.radians(3.75)])
        assert min(within) - 0.01 < ratio < max(within) + 0.01


def test_the_elbow_scene_turns():
    """Module speeds by Eq. 20 take the robot into the scene's elbow, 30 degrees round its arc."""
    model, data = opened("scene_elbow.xml")
    drive(model, data, 1.6, belts=np.full(3, 0.2))
    turned, speeds = 0.0, elbow_speeds(0.2, 0.0, 0.24, 0.08)
    while turned < 30 and data.time < 3.0:
        drive(model, data, 0.05, belts=speeds)
        forward = data.body("chassis").xmat.reshape(3, 3)[:, 2]
        turned = math.degrees(math.atan2(forward[0], forward[2]))
    assert turned >= 30
    x, y, z = data.body("chassis").xpos
    assert math.hypot(x - 0.24, z - 0.4) == pytest.approx(0.24, abs=0.01)
    assert abs(y) < 1e-3
    assert not data.warning.number.any()


def test_the_elbow_of_the_page_is_passed(monkeypatch, capsys):
    """The examples of mujoco.md print what stands in it."""
    monkeypatch.chdir(MODELS.parent)
    example("scene_elbow")
    assert capsys.readouterr().out == "turned by 88 degrees after 8.8 s\n"
    example("climbed")
    assert capsys.readouterr().out == "climbed 0.495 m\n"
    assert "prints 88 degrees after 8.8 s" in PAGE


def test_the_program_of_the_page_shows_a_run_in_mujoco():
    """In a process of its own, where MuJoCo can still choose its OpenGL: both robots stand in the
    pipe, and a picture is drawn."""
    program = [sys.executable, "-c", source("to_spec")]
    ended = subprocess.run(program, capture_output=True, text=True, check=True)
    batch, last, picture = ended.stdout.splitlines()
    assert float(batch.split()[-1].rstrip("]")) > 0.11
    assert float(last.partition("]")[0].split()[-1]) > 0.25
    assert picture == "(360, 640, 3)"


def test_the_tee_scene_turns_with_module_1_backward():
    """As mujoco.md says: from z = 0.46 on, until the robot has turned into the branch."""
    model, data = opened("scene_tee.xml")
    turned = 0.0
    while data.qpos[0] < 0.3 and data.time < 12.0:
        forward = data.body("chassis").xmat.reshape(3, 3)[:, 2]
        turned = math.degrees(math.atan2(forward[0], forward[2]))
        inner = -0.1 if data.qpos[2] > 0.46 and turned < 88.0 else 0.1
        drive(model, data, 0.02, belts=(inner, 0.1, 0.1))
    # Nothing steers it straight in the branch, where it leaves the bend a degree or two askew.
    assert data.qpos[:3] == pytest.approx([0.3, 0.0, 0.56], abs=1e-2)
    assert turned > 85


def test_what_the_contact_sensors_tell():
    """Force of the module on the wall, world axes: outward, and down by a third of the weight; its
    place is on the wall."""
    model, data = opened("scene_straight.xml")
    drive(model, data, 0.6)
    for number in NUMBERS:
        x, y, _ = data.body(f"module_{number}").xpos
        count, fx, fy, fz, px, py, pz = data.sensor(f"contact_{number}").data
        assert count == Omnitrack().lugs_per_track
        assert (fx * x + fy * y) / math.hypot(x, y) == pytest.approx(Omnitrack().preload, rel=0.01)
        assert fz == pytest.approx(-Omnitrack().mass * 9.81 / 3, rel=0.01)
        assert math.hypot(px, py) == pytest.approx(0.08, abs=5e-4)
        assert abs(pz - 0.1) < 0.01


class Climb(MujocoEnv):
    """An environment of Gymnasium: as high as it can."""

    metadata: ClassVar = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}

    def __init__(self):
        super().__init__(str(MODELS / "scene_straight.xml"), 10, observation_space=None)
        size = self.model.nq + self.model.nv
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)

    def step(self, action):
        before = self.data.qpos[2]
        self.do_simulation(action, self.frame_skip)
        return self.state_vector(), (self.data.qpos[2] - before) / self.dt, False, False, {}

    def reset_model(self):
        start = self.model.key("start")
        self.set_state(start.qpos, start.qvel)
        return self.state_vector()


@pytest.mark.filterwarnings("ignore:.*recommend using a symmetric and normalized space")
@pytest.mark.filterwarnings("ignore:.*observation space m[a-z]+ value is -?infinity")
def test_gymnasium_has_six_bounded_actions():
    """An environment takes its action space from the model, begins in the keyframe, passes
    Gymnasium's own check, and climbs. Its actions are in the order told in mujoco.md."""
    env = Climb()
    start = env.model.key("start").qpos
    assert not np.array_equal(env.init_qpos, start)
    assert np.array_equal(env.reset(seed=1)[0][: len(start)], start)
    assert env.action_space.shape == (6,)
    assert env.action_space.is_bounded()
    check_env(env, skip_render_check=True)
    env.reset(seed=1)
    names = [env.model.actuator(index).name for index in range(6)]
    assert f"| {', '.join(f'`{name}`' for name in names)};" in PAGE
    action = np.array([0.1 if name.startswith("belt") else 0 for name in names], np.float32)
    rewards = [env.step(action)[1] for _ in range(50)]
    assert np.mean(rewards[10:]) == pytest.approx(0.1, rel=0.01)
