"""The inchworm: what its clamps hold, how far a cycle takes it, what it passes and stops it."""

from types import SimpleNamespace

import numpy as np
import pytest
from in_pipes import DOWN, LEVEL, UP, Drive, pipe

from omnitrack_sim.robots.inchworm import Inchworm

CYCLE = 1.4
STIFFNESS = 20e3
"""Of its spindle, N/m."""


class Hangs(Inchworm):
    """Hangs by its rear clamp alone."""

    def gait(self, observation):
        return np.array([[0.0, self.grip, -5.0]])


@pytest.mark.parametrize("axis", [UP, LEVEL, DOWN])
def test_a_cycle_takes_it_a_stride_less_what_its_spindle_gives(axis):
    """A stride less m g / k, within 1 %: up, level and down."""
    drive = Drive(Inchworm(), pipe("straight", axis=axis), s=0.3).run(2 * CYCLE)
    start = drive.s
    drive.run(4 * CYCLE)
    law = 0.05 - axis[2] * drive.weight / STIFFNESS
    assert (drive.s - start) / 4 == pytest.approx(law, rel=0.01)


def test_it_begins_as_it_stands_and_extends_first():
    """Both clamps hold and the spindle is short; then the rear one alone, while it extends."""
    robot = Inchworm()
    times = np.array([0.0, 0.25 * CYCLE, 0.5 * CYCLE, 0.75 * CYCLE])
    begins, extends, turns, contracts = robot.gait(
        SimpleNamespace(time=times, qpos=np.zeros((4, 1)))
    )
    np.testing.assert_array_equal(begins, robot.start_ctrl)
    np.testing.assert_allclose(turns, [robot.stride, robot.grip, robot.grip])
    assert extends[0] + contracts[0] == pytest.approx(robot.stride)
    assert extends[1] == contracts[2] == robot.grip
    assert max(extends[2], contracts[1]) < 0


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_a_clamp_holds_eight_times_friction_times_grip(part):
    """With a tenth more than its weight it hangs still, with a tenth less it slides down."""
    weight = 9.81 * Inchworm().spec().compile().body_mass.sum()
    robot = Hangs(friction=part * weight / (8 * 25.0))
    drive = Drive(robot, pipe("straight"), s=0.7).run(1.0)
    start = drive.s
    drive.run(0.3)
    assert (start - drive.s < 1e-4) == (part > 1)
    assert (start - drive.s > 1e-2) == (part < 1)


def test_it_holds_between_commands():
    """With a clamp closed it creeps by less than 0.1 mm/s."""
    drive = Drive(Hangs(), pipe("straight"), s=0.7).run(1.0)
    assert abs(drive.run(1.0).speed(0.9)) < 1e-4


@pytest.mark.parametrize(("axis", "turn", "roll"), [(LEVEL, 90, 0), (DOWN, 0, 45)])
def test_it_passes_elbows(axis, turn, roll):
    """Its runners guide an open clamp into the bend, its joints bend."""
    course = pipe("elbow", axis=axis, turns=[turn])
    assert Drive(Inchworm(), course, s=0.35, roll=roll).run(32.0, until=1.05).s > 1.05


@pytest.mark.parametrize(("axis", "turn", "roll"), [(UP, 0, 0), (UP, 0, 22.5)])
def test_it_crosses_a_tee(axis, turn, roll):
    """Whatever the side of the branch, two pads of a ring of a clamp stand across it and hold."""
    course = pipe("tee", axis=axis, turns=[turn])
    assert Drive(Inchworm(), course, s=0.35, roll=roll).run(28.0, until=1.0).s > 1.0


def test_a_branch_downwards_stops_it():
    """Over the opening of a level tee the upper pads press a clamp into the branch, whose far edge
    holds it."""
    drive = Drive(Inchworm(), pipe("tee", axis=LEVEL), s=0.4).run(7 * CYCLE)
    start = drive.s
    assert drive.run(2 * CYCLE).s - start < 0.01
