"""Short tests on a bench: what each scenario of ``calibration/`` measures, by closed forms."""

import functools

import numpy as np
import pytest

import omnitrack_sim as ot

NAMES = ("slide", "pull", "pull_tight", "climb", "stall", "elbow")
GRAVITY = 9.81


@functools.cache
def run_of(name: str, *changes: tuple[str, float]) -> ot.Result:
    """The run of a bench test."""
    return ot.run(ot.load_scenario(f"calibration/{name}", dict(changes)))


def grip_of(scenario: ot.Scenario) -> float:
    """Largest force on the robot along a straight pipe that its modules hold, N."""
    (radius,) = set(scenario.bores.values())
    return 3 * scenario.world.friction * scenario.robot.spring_force(radius)


@pytest.mark.parametrize("name", NAMES)
def test_each_bench_test_ends_as_it_says(name):
    """A bench test states its outcome, and its run has it."""
    result = run_of(name)
    assert result.scenario.run.expected_outcome is result.outcome


def test_locked_belts_slide_at_the_grip_less_the_weight():
    """Belts that stand slip when pull and weight reach friction times the springs' forces."""
    result = run_of("slide")
    trajectory, scenario = result.trajectory, result.scenario
    # The motors that hold the belts give way a little before these slip.
    slid = np.cumsum(trajectory["slip_velocity"].mean(axis=1)) * scenario.record.period
    force = trajectory["tail_force"][np.argmax(slid > 0.005)]
    assert force + scenario.robot.mass * GRAVITY == pytest.approx(grip_of(scenario), rel=0.06)


def test_weight_alone_does_not_slide():
    """With its springs in, a robot with locked belts holds itself in an upright pipe."""
    result = run_of("slide", ("pull.rate", 0.0), ("run.time_limit", 1.0))
    moved = result.trajectory["distance"] - result.scenario.start.distance
    assert np.abs(moved).max() < 0.002


@pytest.mark.parametrize("name", ["pull", "pull_tight"])
def test_a_balance_reads_the_grip_less_the_weight(name):
    """Driven up against a balance, it slips where the balance reads the grip less the weight."""
    result = run_of(name)
    held = result.trajectory["tail_force"].max() + result.scenario.robot.mass * GRAVITY
    assert held == pytest.approx(grip_of(result.scenario), rel=0.03)


def test_two_preloads_tell_the_friction():
    """Readings at two preloads differ by friction times a known part of the springs' forces."""
    low, high = (run_of(name) for name in ("pull", "pull_tight"))
    robot = low.scenario.robot
    shorter = 3 * robot.module_stiffness * 0.005  # N
    read = [result.trajectory["tail_force"].max() for result in (low, high)]
    assert (read[1] - read[0]) / shorter == pytest.approx(low.scenario.world.friction, rel=0.05)


def test_climbing_up_and_down_tells_losses_from_weight():
    """Currents up and down are the weight's torque over and times the efficiency, and friction."""
    result = run_of("climb")
    time, robot = result.trajectory.time, result.scenario.robot
    motor = robot.motor
    current = result.trajectory["motor_current"].mean(axis=1)
    up, down = (current[(time > a) & (time < b)].mean() for a, b in ((1.0, 1.45), (2.4, 2.95)))
    torque = robot.mass * GRAVITY / 3 * robot.lug_radius
    constant = motor.gear_ratio * motor.winding.torque_constant
    friction = motor.friction_torque
    assert up == pytest.approx((torque / motor.efficiency + friction) / constant, rel=0.02)
    wanted = abs(friction - torque * motor.efficiency) / constant
    assert down == pytest.approx(wanted, rel=0.02)


def test_a_growing_load_shows_the_motors_line():
    """Against the balance the belts' speed falls with the load along the motors' line."""
    result = run_of("stall")
    trajectory, robot = result.trajectory, result.scenario.robot
    loaded = (trajectory["tail_force"] > 45) & (trajectory.time < 3.9)
    torque = trajectory["motor_torque"][loaded].mean(axis=1)
    speed = trajectory["belt_speed"][loaded].mean(axis=1) / robot.lug_radius
    line = robot.motor.no_load_speed * (1 - torque / robot.motor.stall_torque)
    assert np.ptp(torque) > 0.2
    np.testing.assert_allclose(speed, line, rtol=0.03)


def test_currents_are_recorded_as_the_metrics_have_them():
    """The sensor of currents reads what the metric of the largest current is made of."""
    result = run_of("climb")
    largest = result.trajectory["motor_current"].max(axis=0)
    np.testing.assert_allclose(largest, result.metrics["motor_current_max_a"])


def test_current_of_a_shared_motor_is_that_of_its_belts():
    """Belts that one motor drives have its current, which stands for three motors side by side."""
    changes = {"robot.drive": "differential", "run.time_limit": 0.5}
    result = ot.run(ot.load_scenario("calibration/climb", changes))
    current = result.trajectory["motor_current"]
    assert (current == current[:, :1]).all()
    np.testing.assert_allclose(current.max(axis=0), result.metrics["motor_current_max_a"])


def test_a_motor_without_winding_has_no_current():
    """A current is refused of a motor whose winding is not known, by the key that names it."""
    scenario = ot.load_scenario("calibration/climb", {"robot.motor": "simulation"})
    with pytest.raises(ot.InputError, match=r"robot\.motor: is 'simulation', which has no winding"):
        ot.run(scenario)
