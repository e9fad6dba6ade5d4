"""The crawler motors' torque-speed line, limit and integral part."""

import numpy as np
import pytest

from omnitrack_sim.robots.omnitrack import MOTORS
from omnitrack_sim.robots.omnitrack.drive import DRIVES, SpeedLoop

R = 0.0276
LINE = MOTORS["pololu_1000_hpcb"]
LOSSLESS = LINE.model_copy(update={"efficiency": 1.0, "winding": None, "torque_limit": 0.245})
"""The published motor at its recommended torque, with gears that lose nothing."""
PER_SPEED = LOSSLESS.speed_bandwidth * LOSSLESS.reflected_inertia / R
"""Torque, N m, that the servo asks for by each 1 m/s of the set point beyond the speed."""


def _drive(motor=LOSSLESS, limit=None):
    motor = motor.model_copy(update={"torque_limit": limit or motor.torque_limit})
    return SpeedLoop(DRIVES["three_motors"], [motor], R)


def _advance(drive, command, speed, torque=0.0):
    row = np.ones((1, 3))
    return drive.advance(command * row, speed * row, torque * row, 0.01)


def test_no_torque_beyond_the_no_load_speed():
    """At the no-load speed the motor cannot push, but it can brake up to its limit."""
    _, lowest, highest = _advance(_drive(), 0.2, LOSSLESS.no_load_speed * R)
    assert np.allclose(highest, 0.0)
    assert np.allclose(lowest, -LOSSLESS.torque_limit / R)


def test_torque_limit_holds_at_rest():
    """At rest the limit stands on both sides, as a belt force."""
    _, lowest, highest = _advance(_drive(limit=0.1), 0.1, 0.0)
    assert np.allclose(highest, 0.1 / R)
    assert np.allclose(lowest, -0.1 / R)


def test_integral_grows_only_while_the_motor_can_follow():
    """A saturated motor keeps its set point: no wind-up in a stall."""
    free, stalled = _drive(limit=0.1), _drive(limit=0.1)
    for _ in range(10):
        rising = _advance(free, 0.1, 0.09)[0]
        held = _advance(stalled, 0.1, 0.0, torque=0.1)[0]
    assert rising[0, 0] == pytest.approx(0.1 + 10 * 0.01 * 0.01 / 0.1)
    assert held[0, 0] == pytest.approx(0.1)
    assert stalled.saturated.all()
    assert not free.saturated.any()


def test_a_motor_at_its_limit_lets_go_when_it_is_asked_to_turn_back():
    """A belt that stalled at the limit, its integral grown by 0.01 m/s, gives that back while the
    torque is still at the limit, and drives on into the limit no further."""
    for command, change in ((0.1, 0.0), (-0.1, -2 * 0.01 * 0.1 / 0.1)):
        drive = _drive(limit=0.1)
        before = _advance(drive, 0.1, 0.0, torque=0.09)[0][0, 0] - 0.1
        for _ in range(2):
            after = _advance(drive, command, 0.0, torque=0.1)[0][0, 0] - command
        assert before == pytest.approx(0.01)
        assert after - before == pytest.approx(change)


def test_the_integral_counts_on_what_losses_hold():
    """A belt that is dragged on winds up until its gears, with the motor's whole torque, hold no
    more: four times that torque at an efficiency of 0.5."""
    motor = LOSSLESS.model_copy(update={"efficiency": 0.5})
    for torque, grows in ((-3.9 * 0.245, True), (-4 * 0.245, False)):
        drive = _drive(motor)
        for _ in range(20):
            asked = _advance(drive, -0.05, 0.05, torque=torque)[0][0, 0]
        assert (asked < -0.051) == grows
        assert drive.saturated.all() != grows


def test_a_belt_that_is_dragged_on_by_jerks_lets_go():
    """What losses hold changes with the speed of a belt from step to step: dragged on by jerks for
    ten seconds, it asks forward one second after its command does."""
    drive = _drive(LOSSLESS.model_copy(update={"efficiency": 0.5}))
    torque = 0.0
    for step in range(1000):
        speed = 0.004 + 0.004 * (step % 2)
        _, lowest, _ = _advance(drive, -0.07, speed, torque)
        torque = lowest[0, 0] * R
    for _ in range(100):
        asked = _advance(drive, 0.02, 0.0, torque)[0][0, 0]
        torque = max(asked * PER_SPEED, -0.245)
    assert asked > 0


def test_a_motor_is_at_its_limit_where_rounding_has_its_force_a_little_short():
    """Within a part in a million of its limit it does not wind up; within a twentieth it does."""
    for torque, saturated in ((0.1 * (1 - 1e-6), True), (0.095, False)):
        drive = _drive(limit=0.1)
        _advance(drive, 0.1, 0.0, torque=torque)
        assert (drive.saturated == saturated).all()


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
    assert LINE.recommended_torque / R > 9.81 / 3


def test_a_droop_shares_the_load():
    """Belts that are held 0.02 m/s below and 0.01 m/s above their commands settle at torques whose
    difference is that of the speeds over droop and lever, however long they are held."""
    motor = MOTORS["simulation"].model_copy(update={"speed_droop": 20.0})
    loop = SpeedLoop(DRIVES["three_motors"], [motor], R)
    inertia = motor.reflected_inertia / R**2
    speed, torque = np.array([[0.08, 0.11, 0.11]]), np.zeros((1, 3))
    for _ in range(2000):
        set_point = loop.advance(np.full((1, 3), 0.1), speed, torque, 0.01)[0]
        torque = R * inertia * motor.speed_bandwidth * (set_point - speed)
    assert torque[0, 0] - torque[0, 1] == pytest.approx(0.03 / R / 20.0, rel=1e-3)
    assert torque[0, 1] == torque[0, 2]


def test_losses_of_the_gears_help_to_brake():
    """With an efficiency of 0.5 the same rotor torque holds four times the load that it lifts."""
    motor = LOSSLESS.model_copy(update={"efficiency": 0.5})
    _, lowest, highest = _advance(_drive(motor), 0.05, 0.05)
    assert np.allclose(highest, motor.torque_limit / R)
    assert np.allclose(lowest, -4 * motor.torque_limit / R)


def test_losses_stop_a_motor_and_do_not_turn_it_back():
    """What losses hold beyond the limit falls to nothing with the speed: in a period of 10 ms it
    takes no more than the rotor's momentum away."""
    motor = LOSSLESS.model_copy(update={"efficiency": 0.5})
    for speed in (0.0, 1e-3, 5e-3):
        _, lowest, _ = _advance(_drive(motor), 0.05, speed)
        beyond = -lowest[0, 0] * R - motor.torque_limit
        assert beyond == pytest.approx(motor.reflected_inertia * speed / R / 0.01)


def test_friction_of_the_rotor_helps_to_brake():
    """Driving, the motor gives the torque that its maker states; braking, it is helped by the
    friction that it had to overcome, and by the same once more."""
    motor = LINE.model_copy(update={"torque_limit": 0.3})
    friction, part = motor.friction_torque, motor.efficiency
    assert friction == pytest.approx(986.41 * 0.003 * 0.08)
    for way in (1, -1):
        _, *limits = _advance(_drive(motor), way * 0.05, way * 0.05)
        driving, braking = (limits[1], limits[0])[::way]
        assert np.allclose(driving, way * 0.3 / R)
        assert np.allclose(braking, -way * (0.3 / part + 2 * friction) / part / R)


def test_one_motor_for_three_belts_is_as_strong_as_three():
    """The differential's motor is asked the mean of the speeds and gives three times the force; the
    modules count as saturated together."""
    motor = LOSSLESS
    loop = SpeedLoop(DRIVES["differential"], [motor, motor], R)
    command = np.array([[0.1, 0.2, 0.0], [0.1, 0.1, 0.1]])
    torque = np.array([[0.245] * 3, [0.1] * 3])
    set_point, lowest, highest = loop.advance(command, np.zeros((2, 3)), torque, 0.01)
    assert set_point.shape == (2, 1)
    assert set_point[0, 0] == pytest.approx(0.1)
    assert np.allclose([-lowest, highest], 3 * motor.torque_limit / R)
    assert loop.saturated.tolist() == [[True] * 3, [False] * 3]
