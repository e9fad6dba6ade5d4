"""The crawler motors' torque-speed line, limit and integral part."""

import numpy as np
import pytest

from omnitrack_sim.drive import DRIVES, SpeedLoop
from omnitrack_sim.robot import MOTORS

R = 0.0276


def _drive(name="pololu_1000_hpcb", limit=None):
    motor = MOTORS[name]
    return SpeedLoop(DRIVES["three_motors"], motor, [limit or motor.torque_limit], R, 1)


def _advance(drive, command, speed, torque=0.0):
    row = np.ones((1, 3))
    return drive.advance(command * row, speed * row, torque * row, 0.01)


def test_no_torque_beyond_the_no_load_speed():
    """At the no-load speed the motor cannot push, but it can brake up to its limit."""
    motor = MOTORS["pololu_1000_hpcb"]
    _, lowest, highest = _advance(_drive(), 0.2, motor.no_load_speed * R)
    assert np.allclose(highest, 0.0)
    assert np.allclose(lowest, -motor.torque_limit / R)


def test_torque_limit_holds_at_rest():
    """At rest the limit stands on both sides, as a belt force."""
    _, lowest, highest = _advance(_drive(limit=0.1), 0.1, 0.0)
    assert np.allclose(highest, 0.1 / R)
    assert np.allclose(lowest, -0.1 / R)


def test_integral_grows_only_while_the_motor_can_follow():
    """A saturated motor keeps its set point: no wind-up in a stall."""
    free, stalled = _drive(limit=0.1), _drive(limit=0.1)
    for _ in range(50):
        rising = _advance(free, 0.1, 0.09)[0]
        held = _advance(stalled, 0.1, 0.0, torque=0.1)[0]
    assert rising[0, 0] == pytest.approx(0.1 + 50 * 0.01 * 0.01 / 0.1)
    assert held[0, 0] == pytest.approx(0.1)
    assert stalled.saturated.all()
    assert not free.saturated.any()


def test_a_motor_is_the_same_in_both_directions():
    """Turned round in command, speed and torque it gives the same set points, forces and verdict,
    turned round: it is saturated, and does not wind up, at its lower limit as well."""
    for command, speed, torque in ((0.1, 0.0, 0.1), (0.1, 0.02, 0.05), (0.1, 0.05, 0.02)):
        one, other = _drive(limit=0.1), _drive(limit=0.1)
        for _ in range(5):
            set_point, lowest, highest = _advance(one, command, speed, torque)
            turned = _advance(other, -command, -speed, -torque)
        assert np.array_equal(turned, (-set_point, -highest, -lowest))
        assert np.array_equal(one.saturated, other.saturated)
        assert one.saturated.all() == (torque == 0.1)


def test_recommended_torque_carries_a_third_of_the_robot():
    """The recommended 0.245 N m at the belt is more than a third of a 1 kg robot's weight, as
    climbing needs."""
    assert MOTORS["pololu_1000_hpcb"].torque_limit / R > 9.81 / 3
