"""Environments of robots other than the package's own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import omnitrack_sim as ot
import omnitrack_sim.gym
from omnitrack_sim.robots.decisions import InputDecisions, _joint_positions, _joint_speeds

BRIEF = {"changes": {"run.time_limit": 0.4}}


def env_of(scenario, **options):
    return gymnasium.make("omnitrack_sim/Any-v0", scenario=scenario, **options)


def test_gymnasium_finds_nothing_wrong_with_the_presser():
    """Six wheels, an observation of joints and place, the reward's terms."""
    env = env_of("robots/presser_tee", **BRIEF)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.action_space.shape == (6,)
    assert set(env.unwrapped.entries) >= {"joint_position", "joint_speed", "tilt", "weight"}


def test_a_climber_observes_by_its_own_sensors():
    """Modules with chains, as the package's own robot has; a snake's joints nothing measures."""
    env = env_of("robots/climber_elbow", **BRIEF)
    assert env.reset(seed=1)[0].shape == env.observation_space.shape
    assert env.action_space.shape == (4,)
    assert env.unwrapped.scenario.sensing.kind == "onboard"
    with pytest.raises(ot.InputError, match="'onboard', and no sensors of this robot"):
        env_of("robots/snake_elbow", sensing="onboard")


def test_joints_are_observed_in_what_does_not_depend_on_their_size():
    """Hinges by the sine of their angle and rad/s, slides in tenths of a bore and bores a second;
    balls and the free joint not at all."""
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody><body><freejoint/><geom size="0.1"/>
        <body><joint type="hinge"/><geom size="0.1"/></body>
        <body><joint type="ball"/><geom size="0.1"/></body>
        <body><joint type="slide"/><geom size="0.1"/></body>
      </body></worldbody></mujoco>""")
    qpos = np.array([[*np.zeros(7), 2.0, 1.0, 0.0, 0.0, 0.0, 0.008]])
    qvel = np.array([[*np.zeros(6), 3.0, 0.0, 0.0, 0.0, 0.04]])
    setup = SimpleNamespace(model=model, robot=SimpleNamespace(nominal_bore=0.16))
    asked: Any = SimpleNamespace(setup=setup, observation=SimpleNamespace(qpos=qpos, qvel=qvel))
    np.testing.assert_allclose(_joint_positions(asked), [[np.sin(2.0), 0.5]])
    np.testing.assert_allclose(_joint_speeds(asked), [[3.0, 0.25]])


def test_before_the_first_decision_inputs_are_those_of_the_start():
    """Whatever their ranges; a decision of 1 is the end of each, and beyond it nothing is."""
    robot = SimpleNamespace(input_range=np.array([[-1.0, 3.0], [0.0, 0.5], [-2.0, 2.0]]))
    start = np.array([[0.0, 0.4, -2.0], [2.5, 0.0, 1.0]])
    setup: Any = SimpleNamespace(period=0.01, robot=robot, n=2, command=SimpleNamespace(ctrl=start))
    decisions = InputDecisions(setup, ())
    unseen: Any = None
    np.testing.assert_allclose(decisions.command(unseen).ctrl, start)
    decisions.decide(np.array([[1.0, 1.0, 1.0], [-1.0, -1.0, -2.0]]))
    np.testing.assert_allclose(decisions.command(unseen).ctrl, robot.input_range.T[::-1])


def test_a_presser_drives_as_its_controller_does():
    """All inputs at their upper end: to the same bytes as in a run."""
    still = {"world.friction": 0.8, "start.theta5_deg": 30.0}
    env = env_of("robots/presser_tee", ranges=still, gravity="scenario", **BRIEF)
    env.reset(seed=3)
    over = False
    while not over:
        _, reward, terminated, truncated, info = env.step(np.ones(6))
        over = terminated or truncated
        assert np.isfinite(reward)
    expected = ot.run(env.unwrapped.scenario)
    assert info["outcome"] == expected.outcome.value
    assert info["distance"] == expected.trajectory["distance"][-1]
    assert info["distance"] > 0.2


def test_a_vector_of_pressers_is_each_alone():
    """Robot i of a batch gets the bytes of the single environment with its seed."""
    many = gymnasium.make_vec(
        "omnitrack_sim/Any-v0",
        num_envs=2,
        scenario="robots/presser_tee",
        observation="route",
        **BRIEF,
    )
    seen, _ = many.reset(seed=5)
    alone = env_of("robots/presser_tee", observation="route", **BRIEF)
    one, _ = alone.reset(seed=6)
    assert np.array_equal(seen[1], one)
    actions = many.action_space.sample()
    seen, reward, *_ = many.step(actions)
    one, own_reward, *_ = alone.step(actions[1])
    assert np.array_equal(seen[1], one)
    assert reward[1] == own_reward


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"scenario": "robots/presser_tee", "acting": "residual"}, "acting"),
        ({"scenario": "robots/presser_tee", "sensing": "onboard"}, "sensing"),
        ({"scenario": "robots/presser_tee", "observation": "onboard"}, "observation"),
        ({"scenario": "robots/presser_tee", "ranges": {"robot.preload": 3.0}}, "ranges"),
    ],
)
def test_options_that_a_robot_has_not_are_refused(options, told):
    """With the place and the reason."""
    with pytest.raises(ot.InputError, match=told):
        env_of(**options).reset(seed=1)


@pytest.mark.parametrize("robot", ["inchworm", "snake", "screw", "helix", "pirate"])
def test_learners_know_the_range_of_every_shipped_robot(robot):
    """Of the actuators, so that actions from -1 to 1 reach from one end to the other."""
    low, high = ot.load_scenario(f"robots/{robot}_elbow").robot.input_range.T
    assert (low < high).all()


def test_a_robot_without_ranges_is_refused(tmp_path):
    """By the names of its actuators."""
    model = tmp_path / "free.xml"
    model.write_text(
        '<mujoco><worldbody><body name="hull"><freejoint/><geom size="0.02"/><body>'
        '<joint name="spin"/><geom size="0.02"/></body></body></worldbody>'
        '<actuator><motor name="free" joint="spin"/></actuator></mujoco>'
    )
    robot = {"kind": "mjcf", "file": str(model), "bore": 0.16}
    with pytest.raises(ot.InputError, match="ctrlrange of the actuators free"):
        env_of("robots/presser_tee", changes={"robot": robot}).reset(seed=1)


def test_a_picture_of_a_presser(monkeypatch):
    """``rgb_array`` shows it, and shows it elsewhere once it has moved."""
    monkeypatch.setenv("MUJOCO_GL", "egl")
    env = env_of("robots/presser_tee", render_mode="rgb_array", width=320, height=180)
    env.reset(seed=1)
    try:
        first = env.render()
    except ot.RenderError as error:
        pytest.skip(str(error))
    for _ in range(20):
        env.step(np.ones(6))
    assert (np.abs(first.astype(int) - env.render()) > 30).any(axis=2).sum() > 100
