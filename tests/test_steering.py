"""The linear model of steering against its limits, and against the simulated swing."""

import numpy as np
import pytest
from steering_loop import SteeringLoop

import omnitrack_sim as ot

STEERING = {"rate_gain": 5.0, "rate_filter": 0.005, "period": 0.01, "heading_gain": 5.2}


def _loop(bandwidth: float, **changes) -> SteeringLoop:
    motor = ot.MOTORS["simulation"].model_copy(
        update={"speed_bandwidth": bandwidth, "speed_droop": 0.0}
    )
    return SteeringLoop.of(ot.Omnitrack(motor=motor), **(STEERING | changes))


def test_the_speed_loop_follows_slow_commands_and_falls_off_beyond_its_bandwidth():
    """Gain 1 at rest, and w over the frequency far beyond."""
    loop = _loop(8.0)
    assert abs(loop.speed_loop(1e-3)) == pytest.approx(1.0, abs=1e-4)
    assert abs(loop.speed_loop(800.0)) == pytest.approx(0.01, rel=0.02)


def test_springs_are_those_of_the_robot():
    """Stiffness 3/2 of an arm's pitch stiffness over the inertia of the chassis."""
    loop, inertia = _loop(8.0), 0.28 * (3 * 0.025**2 + 0.15**2) / 12
    assert loop.spring_frequency == pytest.approx(np.sqrt(1.5 * 9.8 / inertia))
    assert abs(loop.springs(loop.spring_frequency)) > 1.5
    assert loop.springs(1e-3) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("bandwidth", "low", "high"), [(50.0, -40, -10), (8.0, 55, 75)])
def test_the_margin_tells_which_loop_swings(bandwidth, low, high):
    """50 rad/s has none, the default has 64 degrees."""
    assert low < np.degrees(_loop(bandwidth).rate_margin().phase) < high


def test_the_margin_is_where_the_gain_is_one():
    """At the crossover the loop's gain is 1, its phase 180 degrees less than the margin, and a
    delay of the margin's size takes it all."""
    loop = _loop(8.0)
    margin = loop.rate_margin()
    value = loop.rate_loop(margin.crossover)
    assert abs(value) == pytest.approx(1.0, rel=5e-3)
    assert margin.phase == pytest.approx(np.pi + np.angle(value), abs=1e-9)
    late = value * np.exp(-1j * margin.crossover * margin.delay)
    assert abs(np.angle(late)) == pytest.approx(np.pi, abs=1e-6)


def test_a_loop_that_never_crosses_over_bears_any_delay():
    """Without a rate gain there is nothing to swing."""
    margin = _loop(8.0, rate_gain=0.01).rate_margin()
    assert (margin.crossover, margin.delay) == (0.0, np.inf)


def test_the_heading_loop_crosses_over_at_its_gain():
    """With a rate loop that is much faster, at gain times speed with 90 degrees of margin."""
    margin = _loop(20.0).heading_margin()
    assert margin.crossover == pytest.approx(5.2, rel=0.02)
    assert np.degrees(margin.phase) == pytest.approx(90, abs=5)


def test_the_simulated_torque_swings_where_the_model_has_no_margin():
    """In one dry tee turn the torque changes four times as much with 50 rad/s and a rate gain of 5
    as with the defaults."""
    dry = {"start.theta5_deg": 0.0, "control.align": False}
    soft = ot.override(ot.load_scenario("tee_turn"), dry)
    swinging = {"robot.motor.speed_bandwidth": 50.0, "control.parameters.damping.tee_turn": 5.0}
    calm, wild = (
        np.mean(ot.run(s).metrics["torque_change_nm_s"])
        for s in (soft, ot.override(soft, swinging))
    )
    assert wild > 3 * calm
