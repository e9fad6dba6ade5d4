"""Section III of the paper."""

import numpy as np
import pytest

from omnitrack_sim.kinematics import belt_sign, jacobian, module_speeds, turn_from_roll
from omnitrack_sim.robot import MODULE_ANGLES

RADIUS, LEVER = 0.0276, 0.0524


def test_module_speeds_invert_the_jacobian():
    """Shaft speeds from the inverse give back the wanted motion through Eq. 18."""
    rng = np.random.default_rng(1)
    v, wx, wy = rng.normal(size=(3, 40))
    shafts = module_speeds(v, wx, wy, LEVER) / RADIUS
    motion = np.concatenate([shafts, np.zeros((40, 1))], axis=1) @ jacobian(RADIUS, LEVER).T
    assert np.allclose(motion, np.stack([wx, wy, np.zeros(40), v], axis=1))


def test_module_speeds_are_those_of_a_rigid_body():
    """Each speed is the z component of V + omega x p at its module, by the rigid-body formula."""
    speeds = module_speeds(0.1, 0.3, -0.7, LEVER)
    for speed, angle in zip(speeds, MODULE_ANGLES, strict=True):
        point = LEVER * np.array([np.cos(angle), np.sin(angle), 0])
        assert speed == pytest.approx(0.1 + np.cross([0.3, -0.7, 0], point)[2])


def test_lever_of_half_the_diameter_gives_the_elbow_ratios():
    """With l = D/2 a turn of radius 1.5 D gives Eq. 20: 1.5 D - 0.5 D cos(theta5 - a_i)."""
    D, theta5 = 0.16, 0.4
    omega = 0.1 / (1.5 * D)
    # Turning towards direction d rotates about z x d; module 1 stands at theta5 from d.
    direction = -theta5
    wx, wy = -omega * np.sin(direction), omega * np.cos(direction)
    speeds = module_speeds(0.1, wx, wy, D / 2)
    paths = 1.5 * D - 0.5 * D * np.cos(theta5 + np.array(MODULE_ANGLES))
    assert np.allclose(speeds / speeds.sum(), paths / paths.sum(), atol=1e-12)


def test_belt_sign_follows_the_cosine_of_the_roll():
    """Upper track below 90 degrees, lower one beyond, neither on the no-motion line."""
    assert belt_sign(np.radians([0, 80, 90, 100, 180, -100, 360])).tolist() == [1, 1, 0, -1, -1, -1, 1]


def test_half_a_roll_turns_the_robot_by_62_degrees():
    """-180 r / R = -62.1 degrees for the published sizes."""
    assert np.degrees(turn_from_roll(np.pi, RADIUS, 0.08)) == pytest.approx(-62.1)
