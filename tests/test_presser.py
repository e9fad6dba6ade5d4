"""The wheeled wall-presser: what holds it, how fast it climbs, what it passes and what stops it."""

import numpy as np
import pytest
from in_pipes import DOWN, LEVEL, UP, Drive, pipe

from omnitrack_sim.pipes import Elbow
from omnitrack_sim.robots.presser import Presser

GAIN = 0.326
"""Stall torque over no-load speed of its motors, N m s."""


@pytest.mark.parametrize("axis", [UP, LEVEL, DOWN])
@pytest.mark.parametrize("payload", [0.0, 0.6])
def test_it_climbs_at_the_speed_of_its_motors_and_their_droop(axis, payload):
    """Its speed is r (w0 - m g r / 6 k), within 1 %, up, level and down."""

    def load(spec):
        spec.body("chassis").add_geom(size=[0.01, 0, 0], mass=payload + 1e-9, contype=0)

    robot = Presser()
    drive = Drive(robot, pipe("straight", axis=axis), edit=load).run(4.0)
    droop = axis[2] * drive.weight * robot.wheel_radius / 6 / GAIN
    law = robot.speed - robot.wheel_radius * droop
    assert drive.speed(2.0) == pytest.approx(law, rel=0.01)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_preload_times_friction_holds_its_weight(part):
    """It climbs if the springs' forces times the friction exceed its weight by a tenth; a tenth
    below them it slides down."""
    weight = 9.81 * Presser().spec().compile().body_mass.sum()
    robot = Presser(friction=part * weight / (3 * 40.0))
    drive = Drive(robot, pipe("straight", "straight"), s=0.7).run(1.5)
    assert (drive.s > 0.75) == (part > 1)
    assert (drive.s < 0.6) == (part < 1)


@pytest.mark.parametrize("roll", [0, 60])
@pytest.mark.parametrize("axis", [UP, LEVEL, DOWN])
def test_it_passes_elbows(axis, roll):
    """With an arm at the inside or at the outside of the bend."""
    assert Drive(Presser(), pipe("elbow", axis=axis), roll=roll).run(15.0, until=1.1).s > 1.1


@pytest.mark.parametrize("roll", [0, 30, 60])
@pytest.mark.parametrize(("axis", "turn"), [(UP, 0), (LEVEL, 90), (LEVEL, 180)])
def test_it_crosses_a_tee_with_the_branch_at_any_side(axis, turn, roll):
    """Its arms' outer stops keep wheels over the opening from falling in."""
    course = pipe("tee", axis=axis, turns=[turn])
    assert Drive(Presser(), course, roll=roll).run(15.0, until=1.1).s > 1.1


def test_too_little_preload_leaves_it_in_the_tee():
    """At 25 N a wheel that hangs in the opening stops at the far edge."""
    drive = Drive(Presser(preload=25.0), pipe("tee")).run(12.0)
    assert 0.6 < drive.s < 0.75
    assert abs(drive.speed(2.0)) < 0.002


def test_it_does_not_turn_into_a_branch():
    """All its wheels turn alike: it goes straight on."""
    drive = Drive(Presser(), pipe("branch", axis=LEVEL, turns=[90])).run(8.0)
    run_end = drive.course.network.parts[1].port("run_end")
    assert (drive.chassis.xpos - run_end.position) @ run_end.rotation[:, 2] > -0.1


def test_a_tight_elbow_stops_it():
    """Of 90 mm: its wheelbase is 104 mm."""
    drive = Drive(Presser(), pipe((Elbow(0.09), "start", "end"))).run(8.0)
    assert drive.s < 0.6
    assert abs(drive.speed(2.0)) < 0.002
    assert np.isfinite(drive.data.qpos).all()
