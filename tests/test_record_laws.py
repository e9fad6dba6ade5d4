"""Laws of what is read of contacts, of passages of a timeline, and of intervals in tables."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from samples import drive
from scipy import stats

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.statistics import (
    mean_interval,
    paired_rate_interval,
    rate_difference_interval,
    wilson_interval,
)
from omnitrack_sim.record.timeline import Touch, running_mean, timeline
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.model_sensors import TOUCH, model_sensors
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.robots.scene import compiled
from omnitrack_sim.robots.sensor import State

TIME = 3.0 + np.cumsum([0.0, 0.1, 0.05, 0.2, 0.05, 0.3, 0.02, 0.28])
T = len(TIME)
HALVES = np.convolve(np.diff(TIME), [0.5, 0.5])
"""Half of both steps beside each sample, s: its weight by the trapezoidal rule."""


def test_contacts_of_a_body_add_up_and_slip_by_their_forces() -> None:
    """The force of a body is the sum of the sizes of its contacts' normal forces, its slip the mean
    of their tangential speeds by these, whatever their normal speeds; without a contact both are 0;
    power of an actuator is its force times its speed."""
    model = compiled(ot.load_scenario("robots/presser_tee").robot)
    sensors = {sensor.channel.name: sensor for sensor in model_sensors(model)}
    bodies = [
        model.sensor(i) for i in range(model.nsensor) if model.sensor(i).name.startswith(TOUCH)
    ]
    data = np.zeros((2, model.nsensordata))
    of_third = data[1, bodies[2].adr[0] :][: 4 * 7].reshape(4, 7)  # found, force, velocity
    of_third[0] = [1, -30.0, 1.0, 2.0, 9.0, 0.03, -0.04]  # 0.05 m/s
    of_third[2] = [1, 10.0, 5.0, 5.0, -9.0, 0.0, 0.01]
    pushed = {name: np.arange(2.0 * model.nu).reshape(2, -1) for name in ("force", "velocity")}
    arrays = {"sensordata": data} | {f"actuator_{name}": one for name, one in pushed.items()}
    state = State(arrays, None, SimpleNamespace(), sensors, {})  # type: ignore[arg-type]
    force, speed = np.zeros((2, 2, len(bodies)))
    force[1, 2], speed[1, 2] = 40.0, (30.0 * 0.05 + 10.0 * 0.01) / 40.0
    assert state["wall_force"] == pytest.approx(force)
    assert state["contact_speed"] == pytest.approx(speed)
    assert state["actuator_power"] == pytest.approx(pushed["force"] ** 2)


@pytest.fixture(scope="module")
def route() -> Route:
    """Through an elbow between straights."""
    return ot.load_scenario("elbow").route


def record(route: Route, places: Array, **channels: Array) -> Trajectory:
    """A robot at places (T,) m of a route."""
    return Trajectory(
        TIME, drive(route, places) | channels, ("cruise",), np.zeros((T, 28)), RECORDED
    )


def touch(power: Array, speed: Array, force: Array, ratio: Array | None = None) -> Touch:
    """Contacts of two parts; the second one is in the air in the first sample."""
    touching = np.ones((T, 2), bool)
    touching[0, 1] = False
    return Touch(touching, force, speed, ratio, power)


def test_each_sample_counts_once_in_the_passages_of_a_timeline(route: Route) -> None:
    """Work and slip of one sample are those of half the steps beside it, those before it in the
    passage that they began in; what brakes does no work, and slip counts both ways."""
    first, second = (passage.s_leave for passage in route.passages[:2])
    places = np.array([0.1, first - 0.01, first, 0.5 * (first + second), 9.0, 9.0, 9.0, 9.0])
    places[4:] = second + 0.01
    owner = np.array([0, 0, 1, 1, 2, 2, 2, 2])
    steps = np.append(np.diff(TIME), 0.0)
    zero = np.zeros((T, 2))
    rows = timeline(record(route, places), [route], touch(zero, zero, zero))
    assert [row.duration_s for row in rows] == pytest.approx(
        [steps[owner == number].sum() for number in range(3)]
    )
    assert [row.time_enter_s for row in rows] == pytest.approx(TIME[[0, 2, 4]])
    assert [row.time_leave_s for row in rows][:2] == pytest.approx(TIME[[2, 4]].tolist())
    for sample, sign in itertools.product(range(T), (1.0, -1.0)):
        impulse = np.outer(np.eye(T)[sample], [sign, 0.0])
        rows = timeline(record(route, places), [route], touch(impulse, impulse, zero))
        expected = np.zeros(3)
        for at, weight in ((sample - 1, 0.5), (sample, 0.5)):
            if at >= 0:
                expected[owner[at]] += weight * steps[at]
        assert expected.sum() == pytest.approx(HALVES[sample])
        assert [row.energy_j for row in rows] == pytest.approx(expected * (sign > 0))
        assert [row.slip_distance_m for row in rows] == pytest.approx(expected / 2)


def test_slip_ratio_of_a_passage_is_that_of_parts_that_touch(route: Route) -> None:
    """Parts in the air do not count; where none touches there is none."""
    ratio = np.tile([0.2, -0.6], (T, 1))
    zero = np.zeros((T, 2))
    still = record(route, np.full(T, 0.1))
    (row,) = timeline(still, [route], touch(zero, zero, zero, ratio))
    without = 0.5 * (TIME[1] - TIME[0]) / (TIME[-1] - TIME[0])  # of the second part
    assert row.slip_ratio_mean == pytest.approx((0.2 + 0.6 * (1 - without)) / (2 - without))
    air = touch(zero, zero, zero, ratio)._replace(touching=np.zeros((T, 2), bool))
    assert timeline(still, [route], air)[0].slip_ratio_mean is None
    (row,) = timeline(still, [route], touch(zero, zero, zero))
    assert row.slip_ratio_mean is None


def test_a_place_that_is_no_number_is_that_of_the_sample_before(route: Route) -> None:
    """A record of physics that has diverged keeps the passages that it had."""
    first = route.passages[0].s_leave
    places = np.array([0.1, np.nan, first + 0.01, np.nan, np.nan, 0.1, np.nan, np.nan])
    zero = np.zeros((T, 2))
    rows = timeline(record(route, places), [route], touch(zero, zero, zero))
    steps = np.append(np.diff(TIME), 0.0)
    assert [row.duration_s for row in rows] == pytest.approx(
        [steps[[0, 1, 5, 6]].sum(), steps[2:5].sum()]
    )


def test_a_running_mean_is_centred_and_shorter_at_both_ends() -> None:
    """Over four steps of a ramp it is the ramp, at its ends the middle of the two steps that are
    left; an impulse lies in it with its weight, by one step in four; of one sample it is that."""
    time: Any = 3.0 + 0.02 * np.arange(11)
    ramp, impulse = 2.0 * time, np.eye(11)[5]
    found = running_mean(np.stack([ramp, impulse], axis=1), time, 0.08)
    assert found[2:-2, 0] == pytest.approx(ramp[2:-2])
    assert found[[0, 1, -2, -1], 0] == pytest.approx(
        [ramp[1], ramp[1] + 0.02, ramp[-2] - 0.02, ramp[-2]]
    )
    assert found[:, 1] == pytest.approx([0, 0, 0, 0.125, 0.25, 0.25, 0.25, 0.125, 0, 0, 0])
    assert running_mean(ramp[:1, None], time[:1], 0.08).tolist() == ramp[:1, None].tolist()


def test_intervals_are_those_of_the_library_of_statistics() -> None:
    """Wilson's interval of every rate of up to twelve trials, and Student's of a mean, agree with
    SciPy's; what is tried never or once has none."""
    for total in range(1, 13):
        for passed in range(total + 1):
            theirs = stats.binomtest(passed, total).proportion_ci(method="wilson")
            assert wilson_interval(passed, total) == pytest.approx(tuple(theirs), abs=1e-12)
    values = [3.0, 1.0, 4.0, 1.0, 5.0]
    theirs = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert mean_interval(values) == pytest.approx(tuple(theirs))
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert all(math.isnan(end) for end in mean_interval([2.0]))


@pytest.mark.parametrize(("gain", "loss"), [(0.1, 0.1), (0.3, 0.05), (0.05, 0.5), (0.0, 0.2)])
def test_the_interval_of_paired_rates_covers_their_difference(gain: float, loss: float) -> None:
    """Over all outcomes of forty trials, each as probable as it is, the true difference lies within
    in 93 to 99 % of them; exchanging both sides changes the signs."""
    total, within = 40, 0.0
    for gained in range(total + 1):
        for lost in range(total + 1 - gained):
            low, high = paired_rate_interval(gained, lost, total)
            assert (-high, -low) == pytest.approx(paired_rate_interval(lost, gained, total))
            if low <= gain - loss <= high:
                rest = total - gained - lost
                within += stats.multinomial.pmf(
                    [gained, lost, rest], total, [gain, loss, 1 - gain - loss]
                )
    assert 0.93 < within < 0.99


def test_bodies_that_never_touch_are_no_parts_of_a_robot_s_contact() -> None:
    """Of three bodies of another robot the two that touch at some time count; power is that of its
    actuators; where none touches, all count."""
    robot: Any = ot.load_scenario("robots/presser_tee").robot
    force = np.outer([0.0, 3.0], [1.0, 0.0, 2.0])
    data = {"wall_force": force, "contact_speed": force / 10, "actuator_power": force}
    found = robot.touch(data)
    assert found.force.tolist() == force[:, [0, 2]].tolist()
    assert found.slip_speed.tolist() == (force / 10)[:, [0, 2]].tolist()
    assert found.touching.tolist() == [[False, False], [True, True]]
    assert found.power.tolist() == force.tolist()
    assert found.slip_ratio is None
    assert robot.touch(data | {"wall_force": 0 * force}).force.shape == (2, 3)


def test_the_interval_of_two_rates_is_the_published_one():
    """Newcombe (1998), Table II, method 10: cases (a) to (h), to the digits that are printed."""
    cases = {
        (56, 70, 48, 80): (0.0524, 0.3339),
        (9, 10, 3, 10): (0.1705, 0.8090),
        (6, 7, 2, 7): (0.0582, 0.8062),
        (5, 56, 0, 29): (-0.0381, 0.1926),
        (0, 10, 0, 20): (-0.1611, 0.2775),
        (0, 10, 0, 10): (-0.2775, 0.2775),
        (10, 10, 0, 20): (0.6791, 1.0000),
        (10, 10, 0, 10): (0.6075, 1.0000),
    }
    for counts, printed in cases.items():
        low, high = rate_difference_interval(*counts)
        assert (low, high) == pytest.approx(printed, abs=5e-5), counts
        other = rate_difference_interval(*counts[2:], *counts[:2])
        assert other == pytest.approx((-high, -low)), counts
    assert rate_difference_interval(0, 0, 3, 4) == (-1.0, 1.0)
