"""The pose filter alone, fed with a gyro whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from omnitrack_sim.autonomy.candidates import of_limbs
from omnitrack_sim.autonomy.pose_filter import (
    BIAS,
    POSE,
    SLIP,
    TURN,
    PoseFilter,
    initial_covariance,
)
from omnitrack_sim.base.rotations import Array, Pose, rotation_vector, turned_by
from omnitrack_sim.pipes import Part, Tee
from omnitrack_sim.robots.odometry import BodyReadings, Motion
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, Omnitrack
from omnitrack_sim.robots.omnitrack.odometry import TrackOdometry
from omnitrack_sim.senses.settings import SensingTable
from omnitrack_sim.walls.rays import RayWalls

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
        pose.advance(Motion.along(STILL), BIAS_OF_GYRO[None] * PERIOD, STILL, PERIOD)
        if step % 50 == 49:
            measure_rotation(pose, np.eye(3), 1e-4)
    assert pose.bias[0] == pytest.approx(BIAS_OF_GYRO, rel=0.02, abs=2e-5)
    assert pose.covariance[0, BIAS, BIAS].diagonal().max() < np.radians(0.05) ** 2 / 100
    before = pose.rotation[0]
    for _ in range(1500):
        pose.advance(Motion.along(STILL), BIAS_OF_GYRO[None] * PERIOD, STILL, PERIOD)
    drift = rotation_vector((pose.rotation[0] @ before.T)[None])[0]
    assert np.abs(drift).max() < 0.05 * np.abs(BIAS_OF_GYRO).max() * 30


def test_the_pose_follows_belts_and_gyro() -> None:
    """Along an arc of a quarter turn, driven in steps, to the end of the arc."""
    pose, radius, steps = filter_of(), 0.24, 400
    angle = np.pi / 2 / steps
    for _ in range(steps):
        travel, turned = np.array([radius * angle]), np.array([[0.0, angle, 0.0]])
        pose.advance(Motion.along(travel), turned, STILL, PERIOD)
    assert pose.position[0] == pytest.approx([radius, 0.0, radius], abs=1e-5)
    expected = turned_by(np.array([[0.0, np.pi / 2, 0.0]]))[0]
    assert pose.rotation[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("skid", "slip"), [(0.0, 0.01), (0.01, 0.51)])
def test_belts_that_slip_get_less_far(skid: float, slip: float) -> None:
    """By one standard deviation of the motion at hand: in a pipe by 1 %, though they slipped by
    half of their travel in the turn before."""
    pose = filter_of()
    pose.slip = np.ones(1)
    pose.advance(Motion.along(np.array([0.01])), np.zeros((1, 3)), np.array([skid]), PERIOD)
    assert pose.position[0, 2] == pytest.approx(0.01 * (1 - slip))
    assert 0 < pose.covariance[0, SLIP, SLIP] <= 1
    pose.settle(np.ones(1, bool))
    assert pose.covariance[0, SLIP, SLIP] == pytest.approx(1.0)


@pytest.mark.parametrize("sharp", [0.0, 0.3])
@pytest.mark.parametrize("differ", [0.1, 0.6, 2.0])
def test_robots_wander_aside_by_what_is_worse_turn_or_slip(sharp: float, differ: float) -> None:
    """How sharply they turn, and how much drives and gyro differ, each as a part of the way and one
    at most: the larger decides."""
    way, table = 0.01, TABLE.filter
    turned, spread = np.array([[sharp * way / 0.08, 0.0, 0.0]]), []
    for skid in (0.0, differ * way):
        pose = filter_of()
        pose.advance(Motion.along(np.array([way])), turned, np.array([skid]), PERIOD)
        pose.settle(np.ones(1, bool))
        spread.append(pose.covariance[0, 0, 0])
    before, loose = (
        (table.aside_std + table.aside_turning * part) ** 2 * way
        for part in (sharp, max(sharp, min(differ, 1.0)))
    )
    assert spread[1] - spread[0] == pytest.approx(loose - before, rel=1e-6, abs=1e-12)


ROBOT = Omnitrack()


TEE = Part("tee", Tee(), Pose(np.eye(3), np.zeros(3)))


def touch(along: float, slide: float) -> tuple[Array, Array]:
    """Information and evidence of the arms of a robot on the axis of a tee's run, ``along`` m from
    the branch's, with its first module towards the branch and that arm at ``slide`` m."""
    branch, axis = (TEE.port(port).rotation[:, 2] for port in ("branch", "run_end"))
    # The robot's z axis is the run's, and its first module's direction the branch's.
    frame = np.stack([branch, np.cross(axis, branch), axis], axis=-1)
    frame = frame @ turned_by(np.array([[0.0, 0.0, -MODULE_ANGLES[0]]]))[0]
    position = TEE.port("run_end").position - (Tee().run_length / 2 - along) * axis
    covariance = np.diag([0.003**2] * 3 + [0.03**2] * 3)[None]
    slides, walls = np.array([[slide, 0.0, 0.0]]), RayWalls([[TEE]])
    pose = position[None], frame[None], covariance
    body = BodyReadings(*np.zeros((2, 1, 3)), slides, np.zeros((1, 3)))
    limbs = TrackOdometry(Omnitrack()).limbs(body)
    return of_limbs(limbs, walls, np.zeros(1, int), *pose, 0.002)


@pytest.mark.parametrize(
    ("along", "slide", "arms", "pushed"),
    [(0.1, 0.0, 3, 0.0), (0.1, 0.002, 3, 500.0), (0.0, 0.005, 2, 0.0), (0.04, 0.0, 3, 0.0)],
    ids=["at the wall", "too far out", "over the mouth", "with one end on the rim"],
)
def test_arms_measure_where_a_track_touches(
    along: float, slide: float, arms: int, pushed: float
) -> None:
    """One that swings out over the mouth of a branch touches nothing: the rim, which is the nearest
    wall, draws the robot neither aside nor along."""
    information, evidence = touch(along, slide)
    assert np.trace(information[0, :3, :3]) == pytest.approx(arms / 0.002**2, rel=0.1)
    # Away from the branch, which is along x, and not along the run.
    assert evidence[0, :3] == pytest.approx([-pushed, 0.0, 0.0], abs=1.0)
