"""What every robot of another kind keeps: its model, its controller, and a small network."""

import doctest
import sys
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from in_pipes import UP, Drive, pipe

from omnitrack_sim.robots.inchworm import Inchworm
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.screw import Screw
from omnitrack_sim.robots.snake import Snake

STARTS = {Presser: 0.2, Inchworm: 0.3, Screw: 0.2, Snake: 0.35}
"""Arc length at which each begins, m."""
kinds = pytest.mark.parametrize("kind", STARTS)


@kinds
def test_a_robot_lies_along_z_and_has_what_is_asked_of_it(kind):
    """Its nose is ahead of its tail along the pipe; bodies, joints and actuators have names; its
    chassis is there."""
    robot = kind()
    model = robot.spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.site(robot.nose).xpos[2] - data.site(robot.tail).xpos[2] > 0.15
    assert np.hypot(*data.body(robot.chassis).xpos[:2]) < 0.06
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert all(model.actuator(i).name for i in range(model.nu))
    assert all(model.body(i).name for i in range(model.nbody))


@kinds
@pytest.mark.parametrize("bore", [0.15, 0.16, 0.18])
def test_a_robot_begins_in_its_bore_and_not_in_its_wall(kind, bore):
    """In a pipe of its bore nothing is deeper than 0.1 mm in a wall, and no part in another."""
    drive = Drive(kind(bore=bore), pipe(bore=bore), s=0.5)
    assert drive.data.contact.dist.min(initial=0.0) > -1e-4


@kinds
def test_a_gait_commands_many_robots_as_it_commands_one(kind):
    """Rows of its answer are the answers to their robots."""
    robot = kind()
    model = robot.spec().compile()
    times = np.array([0.0, 0.3, 1.7])
    qpos, qvel = np.tile(model.qpos0, (3, 1)), np.zeros((3, model.nv))
    every = robot.gait(SimpleNamespace(time=times, qpos=qpos, qvel=qvel))
    assert every.shape == (3, model.nu)
    for i, time in enumerate(times):
        one = SimpleNamespace(time=np.array([time]), qpos=qpos[:1], qvel=qvel[:1])
        np.testing.assert_array_equal(robot.gait(one)[0], every[i])


@pytest.mark.parametrize(
    ("kind", "seconds"),
    # Those that are slow pass an elbow and a tee in tests of their own.
    [
        (Presser, 30),
        *(pytest.param(kind, 45, marks=pytest.mark.long) for kind in (Inchworm, Snake)),
    ],
)
def test_a_robot_drives_through_a_small_network(kind, seconds):
    """Up, round an elbow and over a tee whose branch lies between two arms of the presser, on
    walls as MuJoCo has them by default, with their own friction."""
    course = pipe("elbow", "tee", axis=UP, turns=[0, 60], length=0.4)
    goal = course.length - 0.3
    drive = Drive(kind(), course, s=STARTS[kind], friction=0.8).run(seconds, until=goal)
    assert drive.s > goal
    assert not drive.data.warning.number.any()


@kinds
def test_examples_run(kind):
    """Those of the docstrings."""
    tried = doctest.testmod(sys.modules[kind.__module__])
    assert tried.attempted
    assert not tried.failed
