"""The screw drive: laws that its claims (tests/test_robot_claims.py) do not measure."""

import numpy as np
import pytest
from in_pipes import LEVEL, Drive, pipe

import omnitrack_sim as ot
from omnitrack_sim.robots.screw import ARMS, Screw


def test_a_rotor_that_turns_back_takes_it_back():
    """Backward it is as fast as forward, within 0.1 %: a helix has no front."""
    speeds = []
    for turn in (1, -1):
        drive = Drive(Screw(speed=turn * 3.62), pipe("straight"), s=0.6)
        drive.model.opt.gravity[:] = 0
        speeds.append(drive.run(3.0).speed(1.0))
    assert speeds[0] == pytest.approx(-speeds[1], rel=1e-3)


def test_wheels_of_the_rotor_slip_along_their_axles_alone():
    """Rolling, contacts of the wheels rest on the wall: under a hundredth of the rotor's speed
    there."""
    changes = {"start.axis": LEVEL, "run.time_limit": 3.0, "run.expected_outcome": "timed_out"}
    run = ot.run(ot.load_scenario("robots/screw_elbow", {**changes, "start.distance": 0.15}))
    late = run.trajectory["contact_speed"][run.trajectory.time > 1.5]
    assert late.max() < 0.01 * 3.62 * 0.08


def test_its_wheels_press_with_their_springs():
    """Each of the rotor's by its own, each of the stator's by half of its arm's."""
    drive = Drive(Screw(), pipe("straight"), s=0.5)
    drive.model.opt.gravity[:] = 0
    drive.run(2.0)
    total = sum(drive.data.efc_force[c.efc_address] for c in drive.data.contact)
    assert drive.data.ncon == 3 * ARMS
    assert total == pytest.approx(ARMS * (25 + 15), rel=0.04)


def test_the_motor_stalls_at_the_rim_of_a_branch():
    """Over a tee the rotor comes to rest at the torque that its motor gives at most."""
    drive = Drive(Screw(), pipe("tee"), s=0.25).run(12.0)
    assert np.abs(drive.speed(2.0)) < 0.002
    assert drive.data.actuator_force[0] == pytest.approx(0.5)
