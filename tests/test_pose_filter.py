"""The pose filter alone, fed with a gyro whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from omnitrack_sim.autonomy.pose_filter import (
    BIAS,
    POSE,
    SLIP,
    TURN,
    PoseFilter,
    initial_covariance,
)
from omnitrack_sim.base.rotations import Array, rotation_vector, turned_by
from omnitrack_sim.senses.settings import SensingTable

PERIOD, ROWS = 0.02, np.arange(1)
TABLE = SensingTable()
BIAS_OF_GYRO = np.radians([0.05, -0.03, 0.08])  # rad/s
STILL = np.zeros(1)


def filter_of() -> PoseFilter:
    """A filter of one robot at the origin of a pipe along z."""
    start = TABLE.start.model_copy(update={"theta5_known": True})
    # Of what slip adds to the gyro's own noise these tests want nothing.
    table = TABLE.model_copy(
        update={"start": start, "filter": TABLE.filter.model_copy(update={"turn_walk_deg": 0.0})}
    )
    pose = PoseFilter(1, table.filter, table.imu, 0.08)
    covariance = initial_covariance(table, np.array([[0.0, 0.0, 1.0]]))
    pose.reset(ROWS, np.zeros((1, 3)), np.eye(3)[None], covariance)
    return pose


def measure_rotation(pose: PoseFilter, true: Array, std: float) -> None:
    """Correct by a measurement of the whole rotation, with standard deviation ``std`` rad."""
    information, evidence = np.zeros((1, POSE, POSE)), np.zeros((1, POSE))
    information[0, TURN, TURN] = np.eye(3) / std**2
    evidence[0, TURN] = rotation_vector((true @ pose.rotation[0].T)[None])[0] / std**2
    pose.settle(np.ones(1, bool))
    pose.correct(information, evidence, pose.position)


def test_the_bias_of_the_gyro_is_learned_and_taken_off() -> None:
    """A robot that stands, whose gyro drifts: rotations that are measured tell the bias, with its
    sign, and from then on the estimate stays for half a minute without any."""
    pose = filter_of()
    for step in range(3000):
        pose.advance(STILL, BIAS_OF_GYRO[None] * PERIOD, STILL, PERIOD)
        if step % 50 == 49:
            measure_rotation(pose, np.eye(3), 1e-4)
    assert pose.bias[0] == pytest.approx(BIAS_OF_GYRO, rel=0.02, abs=2e-5)
    assert pose.covariance[0, BIAS, BIAS].diagonal().max() < np.radians(0.05) ** 2 / 100
    before = pose.rotation[0]
    for _ in range(1500):
        pose.advance(STILL, BIAS_OF_GYRO[None] * PERIOD, STILL, PERIOD)
    drift = rotation_vector((pose.rotation[0] @ before.T)[None])[0]
    assert np.abs(drift).max() < 0.05 * np.abs(BIAS_OF_GYRO).max() * 30


def test_the_pose_follows_belts_and_gyro() -> None:
    """Along an arc of a quarter turn, driven in steps, to the end of the arc."""
    pose, radius, steps = filter_of(), 0.24, 400
    angle = np.pi / 2 / steps
    for _ in range(steps):
        travel, turned = np.array([radius * angle]), np.array([[0.0, angle, 0.0]])
        pose.advance(travel, turned, STILL, PERIOD)
    assert pose.position[0] == pytest.approx([radius, 0.0, radius], abs=1e-5)
    expected = turned_by(np.array([[0.0, np.pi / 2, 0.0]]))[0]
    assert pose.rotation[0] == pytest.approx(expected, abs=1e-9)


def test_belts_that_slip_get_less_far() -> None:
    """By the part of their travel that the filter holds for slip."""
    pose = filter_of()
    pose.slip = np.array([0.1])
    pose.advance(np.array([0.01]), np.zeros((1, 3)), STILL, PERIOD)
    assert pose.position[0, 2] == pytest.approx(0.009)
    assert pose.covariance[0, SLIP, SLIP] > 0
