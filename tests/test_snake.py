"""The snake: what its helix holds, how fast it rolls, what it passes and what stops it."""

import math

import mujoco
import numpy as np
import pytest
from in_pipes import DOWN, LEVEL, UP, Drive, pipe

from omnitrack_sim.robots.snake import CENTRE, RADIUS, Snake


def press(drive):
    """Sum of the forces that press a robot to the walls, N."""
    force, total = np.empty(6), 0.0
    for i in range(drive.data.ncon):
        mujoco.mj_contactForce(drive.model, drive.data, i, force)
        total += force[0]
    return total


def test_its_joints_lie_on_a_helix_that_touches_the_wall():
    """Ends of links lie 22 mm from the wall, where their rubber begins to touch."""
    drive = Drive(Snake(), pipe("straight"), s=0.5)
    for k in range(8):
        geom = drive.data.geom(f"link_{k}")
        ends = geom.xpos + np.outer([-0.045, 0.045], geom.xmat.reshape(3, 3)[:, 2])
        np.testing.assert_allclose(drive.pipes.clearance(ends), RADIUS, atol=1e-9)


def test_its_commands_keep_the_shape_while_the_links_turn():
    """Bodies laid by the commanded angles have the same distances of joints at any roll."""
    drive = Drive(Snake(squeeze=0.0), pipe("straight"), s=0.5)
    distances = []
    for time in (0.0, 0.7, 1.9):
        drive.data.time = time
        drive.run(0.02)
        drive.data.qpos[7:] = drive.data.ctrl
        mujoco.mj_kinematics(drive.model, drive.data)
        links = np.array([drive.data.geom(f"link_{k}").xpos for k in range(8)])
        distances.append(np.linalg.norm(links[:, None] - links, axis=-1))
    np.testing.assert_allclose(distances[1], distances[0], atol=1e-9)
    np.testing.assert_allclose(distances[2], distances[0], atol=1e-9)


@pytest.mark.parametrize("axis", [UP, LEVEL, DOWN])
def test_it_rolls_at_the_speed_of_its_balls(axis):
    """At rate a sin(lean) cos(turn / 2), within 8 %: it slips by as much up and down."""
    robot = Snake()
    drive = Drive(robot, pipe("straight", axis=axis), s=0.45).run(6.0)
    sine = np.linalg.norm(robot.directions()[CENTRE][:2])
    law = robot.rate * RADIUS * sine * math.cos(robot.turn / 2)
    assert drive.speed(4.0) == pytest.approx(law, rel=0.08)


def test_it_is_held_by_one_and_a_half_turns_and_by_friction():
    """At rest it stays where friction times pressure exceeds its weight by a half, and slides where
    it is half of it; with one and a quarter turns it finds a pose without pressure and falls."""
    course = pipe("straight", "straight")
    rest = Drive(Snake(rate=0.0), course, s=0.9).run(1.0)
    least = rest.weight / press(rest)
    for factor, falls in ((1.5, False), (0.5, True)):
        drive = Drive(Snake(rate=0.0, friction=factor * least), course, s=0.9).run(1.0)
        assert (drive.s < 0.8) == falls
    assert rest.s > 0.89
    assert Drive(Snake(rate=0.0, turn=1.0), course, s=0.9).run(1.0).s < 0.8


@pytest.mark.parametrize(("axis", "turn", "roll"), [(LEVEL, 90, 180), (DOWN, 0, 90)])
def test_it_passes_elbows(axis, turn, roll):
    """Its joints' torque limit lets the helix bend."""
    course = pipe("elbow", axis=axis, turns=[turn])
    assert Drive(Snake(), course, s=0.45, roll=roll).run(30.0, until=1.05).s > 1.05


@pytest.mark.parametrize(("axis", "turn", "roll"), [(UP, 0, 180), (LEVEL, 0, 90)])
def test_it_crosses_a_tee(axis, turn, roll):
    """The helix spans the opening."""
    course = pipe("tee", axis=axis, turns=[turn])
    assert Drive(Snake(), course, s=0.45, roll=roll).run(26.0, until=1.0).s > 1.0
