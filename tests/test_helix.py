"""The snake that rolls as a helix: its kinematics by joint angles alone."""

import numpy as np
import pytest

from omnitrack_sim.robots.helix import JOINTS, Helix, coil_of
from omnitrack_sim.robots.scene import initial_state


def test_its_model_lies_in_the_helix_of_its_joint_angles():
    """Ends of its modules are those that the angles lead to, about the pipe's axis."""
    robot = Helix()
    data = initial_state(robot)
    joints = np.array([data.joint(f"joint_{k}").xanchor for k in range(JOINTS)])
    coil = robot.coil(robot.angles(0.0, robot.twist))
    own = coil_of(joints)
    assert own.outer == pytest.approx(coil.outer)
    assert own.rise == pytest.approx(coil.rise)
    np.testing.assert_allclose(own.axis, [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(own.point[:2], 0, atol=1e-6)
    assert robot.pipe_bore(coil) == pytest.approx(robot.bore, rel=0.02)


@pytest.mark.parametrize("radius", [0.04, 0.06])
def test_the_cylinder_about_a_true_helix_is_found(radius):
    """Of points on a helix with any axis: radius, rise and axis to the digits of least squares."""
    turn, rise = np.linspace(0, 9, 16), 0.05
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), rise * turn], axis=-1)
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    coil = coil_of(points @ rotation.T + [1.0, 2.0, 3.0])
    assert coil.outer == pytest.approx(radius, rel=1e-9)
    assert coil.zigzag < 1e-9
    assert coil.rise == pytest.approx(rise, rel=1e-9)
    assert abs(coil.axis @ rotation[:, 2]) == pytest.approx(1)


def test_rolling_back_undoes_rolling():
    """A step of the gait backwards takes it back by the same way; a rate of 0 takes it nowhere;
    its way is the one of a smooth helix to 15 %."""
    robot = Helix()
    before, after = robot.angles(np.array([0.3, 0.34]), robot.twist)
    way = robot.advance(before, after)
    assert way > 0
    assert robot.advance(after, before) == pytest.approx(-way, rel=0.05)
    assert robot.advance(before, before) == pytest.approx(0, abs=1e-12)
    phases = np.arange(0, 2 * np.pi, 0.04)
    angles = robot.angles(phases, robot.twist)
    mean = np.mean([robot.advance(*angles[i : i + 2]) for i in range(0, len(phases) - 1, 8)])
    smooth = robot.rolling_speed(robot.coil(before)) * 0.04 / robot.rate
    assert mean == pytest.approx(smooth, rel=0.15)
