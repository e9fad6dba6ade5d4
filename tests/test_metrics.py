"""The summary figures of a run, against values known by formula."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import LUG_RADIUS, TORQUE_LIMIT, sample_trajectory

from omnitrack_sim.record.metrics import ESTIMATE_METRICS, ESTIMATES, Metrics, Run, summarise
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.omnitrack.drive import DRIVES, Drive
from omnitrack_sim.robots.omnitrack.metrics import METRICS, BeltRun

T = 201
PER_MODULE = (
    "slip_ratio_mean",
    "slip_distance_m",
    "traction_rms_n",
    "normal_force_mean_n",
    "contact_fraction",
    "spring_travel_max_m",
    "torque_rms_nm",
    "torque_change_nm_s",
    "time_at_limit_s",
    "stall_time_s",
)


def figures(trajectory: Trajectory) -> Metrics:
    return summarise(
        BeltRun(trajectory, 9.81, 1e-4, LUG_RADIUS, TORQUE_LIMIT, drive=DRIVES["three_motors"]),
        METRICS,
    )


def each(*values: float) -> np.ndarray:
    """A channel (T, 3) that holds one constant a module."""
    return np.tile(np.array(values, float), (T, 1))


def test_mean_speed_is_distance_over_time():
    """0.4 m in 4 s is 0.1 m/s."""
    metrics = figures(sample_trajectory(T))
    assert metrics["distance_m"] == pytest.approx(0.4)
    assert metrics["mean_speed_m_s"] == pytest.approx(0.1)


def test_energy_of_constant_power():
    """Torque 0.1 N m at a belt speed of one lug radius a second is 0.1 W a module: 3 x 0.1 W x 4
    s."""
    steady = sample_trajectory(
        T, motor_torque=each(0.1, 0.1, 0.1), belt_speed=each(LUG_RADIUS, LUG_RADIUS, LUG_RADIUS)
    )
    assert figures(steady)["energy_j"] == pytest.approx(1.2)


def test_braking_gives_no_energy_back():
    """A motor that is driven backward by its load does not lower the energy."""
    speed = each(LUG_RADIUS, LUG_RADIUS, LUG_RADIUS)
    braking = sample_trajectory(T, motor_torque=each(0.1, 0.1, -0.1), belt_speed=speed)
    assert figures(braking)["energy_j"] == pytest.approx(0.8)


def test_traction_is_a_root_mean_square():
    """A sine of amplitude 3 N has 3/sqrt(2) N, a constant -2 N has 2 N."""
    time = np.linspace(0, 4, T)
    traction = np.stack([3 * np.sin(2 * np.pi * time), np.full(T, -2.0), np.zeros(T)], axis=1)
    assert figures(sample_trajectory(T, traction=traction))["traction_rms_n"] == pytest.approx(
        [3 / 2**0.5, 2, 0], abs=1e-3
    )


def test_slip_counts_in_both_directions():
    """10 mm/s ahead for 2 s and 10 mm/s behind for 2 s are 40 mm of slip, not none."""
    slip = np.where(np.arange(T) < T // 2, 0.01, -0.01)[:, None] * np.array([1.0, 0.0, 2.0])
    metrics = figures(sample_trajectory(T, slip_velocity=slip, slip_ratio=slip * 10))
    assert metrics["slip_distance_m"] == pytest.approx([0.04, 0.0, 0.08], rel=0.01)
    assert metrics["slip_ratio_mean"] == pytest.approx([0.1, 0.0, 0.2], rel=0.01)


def test_stall_needs_full_torque_and_standstill():
    """Full torque while running either way, and standstill with little torque, are no stall; full
    torque at a standstill is, whichever way it pushes."""
    for sign in (1.0, -1.0):
        torque, speed = sign * each(TORQUE_LIMIT, TORQUE_LIMIT, 0.1), each(0.1, 0.0, 0.0)
        for way in (1.0, -1.0):
            run = sample_trajectory(T, motor_torque=torque, belt_speed=way * speed)
            assert figures(run)["stall_time_s"] == pytest.approx([0.0, 4.0, 0.0])


def test_torque_is_a_root_mean_square():
    """A sine of amplitude 0.2 N m has 0.2/sqrt(2) N m, a constant -0.1 N m has 0.1 N m."""
    time = np.linspace(0, 4, T)
    torque = np.stack([0.2 * np.sin(2 * np.pi * time), np.full(T, -0.1), np.zeros(T)], axis=1)
    assert figures(sample_trajectory(T, motor_torque=torque))["torque_rms_nm"] == pytest.approx(
        [0.2 / 2**0.5, 0.1, 0], abs=1e-4
    )


def test_torque_change_is_the_mean_rate_up_and_down():
    """A triangle wave of 0.2 N m that rises and falls at 0.4 N m/s changes by 0.4 N m/s, however
    long the run and whatever its mean; a constant torque does not change; one step of 0.2 N m in 4
    s is 0.05 N m/s."""
    time = np.linspace(0, 4, T)
    triangle = 0.2 * np.abs((2 * time + 1) % 2 - 1) - 0.7
    step = np.where(time < 2, 0.0, -0.2)
    torque = np.stack([triangle, np.full(T, -0.1), step], axis=1)
    change = figures(sample_trajectory(T, motor_torque=torque))["torque_change_nm_s"]
    assert change == pytest.approx([0.4, 0, 0.05])


def test_time_at_the_limit_counts_in_both_directions_and_while_running():
    """Full torque ahead for a quarter of 4 s and astern for another is 2 s, with the belt running;
    98 % of the limit is not at it."""
    quarter = np.arange(T) * 4 // T
    full = np.select([quarter == 1, quarter == 3], [TORQUE_LIMIT, -TORQUE_LIMIT], 0.0)
    torque = np.stack([full, np.full(T, 0.98 * TORQUE_LIMIT), np.full(T, TORQUE_LIMIT)], axis=1)
    running = sample_trajectory(T, motor_torque=torque, belt_speed=each(0.1, 0.1, 0.0))
    metrics = figures(running)
    assert metrics["time_at_limit_s"] == pytest.approx([2.0, 0.0, 4.0], abs=0.03)
    assert metrics["stall_time_s"] == pytest.approx([0.0, 0.0, 4.0])


@pytest.mark.parametrize(
    ("drive", "limits"),
    [
        (DRIVES["three_motors"], (1.18, 1.18, 1.18)),
        (DRIVES["differential"], (1.18, 1.18, 1.18)),
        (Drive("small", ((1 / 3, 1 / 3, 1 / 3),)), (1.18 / 3, 1.18 / 3, 1.18 / 3)),
        (Drive("pair", ((1, 0, 0), (0, 0.5, 0.5)), size=1.5), (1.77, 0.885, 0.885)),
        (Drive("opposed", ((1, 0, 0), (0, 1, -0.5))), (1.18, 1.18, 0.59)),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_a_belt_is_at_its_limit_where_its_motors_can_give_no_more(drive, limits):
    """The limits of drives by hand: just below 99 % no belt counts, just above each does."""
    for part, seconds in ((0.985, 0.0), (0.995, 4.0)):
        torque = each(*(part * limit for limit in limits))
        run = sample_trajectory(T, motor_torque=torque, belt_speed=each(0.0, 0.0, 0.0))
        found = summarise(BeltRun(run, 9.81, 0.0, LUG_RADIUS, 1.18, drive=drive), METRICS)
        assert found["time_at_limit_s"] == pytest.approx([seconds] * 3)
        assert found["stall_time_s"] == found["time_at_limit_s"]


def test_contact_on_either_track_is_contact():
    """A module that touches with its lower track only counts as much as one on its upper track."""
    count = np.zeros((T, 3, 2))
    count[:, 0, 0] = count[:, 1, 1] = 3
    assert figures(sample_trajectory(T, contact_count=count))["contact_fraction"] == pytest.approx(
        [1.0, 1.0, 0.0]
    )


def test_spring_travel_is_counted_from_the_start():
    """An arm that starts at -1 mm and reaches -6 mm has travelled 5 mm."""
    slide = each(-0.001, 0.0, 0.0)
    slide[100, 0] = -0.006
    assert figures(sample_trajectory(T, slide=slide))["spring_travel_max_m"] == pytest.approx(
        [0.005, 0.0, 0.0]
    )


def test_angles_are_the_largest_and_the_last_in_degrees():
    """Tilt at its worst and at the end, and the largest pitch of each arm either way."""
    tilt, pitch = np.linspace(0.1, 0.02, T), np.zeros((T, 3))
    tilt[50], pitch[20, 0], pitch[30, 2] = 0.2, 0.03, -0.04
    metrics = figures(sample_trajectory(T, tilt=tilt, pitch=pitch))
    assert metrics["tilt_max_deg"] == pytest.approx(np.degrees(0.2))
    assert metrics["tilt_exit_deg"] == pytest.approx(np.degrees(0.02))
    assert metrics["pitch_max_deg"] == pytest.approx(np.degrees([0.03, 0.0, 0.04]))


def test_the_largest_torque_counts_in_both_directions():
    """A motor that brakes with 0.2 N m has given more than one that drives with 0.1."""
    torque = each(0.1, 0.05, 0.0)
    torque[80, 1] = -0.2
    found = figures(sample_trajectory(T, motor_torque=torque))["motor_torque_max_nm"]
    assert found == pytest.approx([0.1, 0.2, 0.0])


def test_headway_is_counted_leg_by_leg():
    """On a new leg arc length begins anew, nose or tail first: 0.2 m on the first, from 0.1 m on,
    and 0.3 m on the second, from 5 m on, are 0.5 m."""
    half = T // 2
    distance = np.concatenate([np.linspace(0.1, 0.3, half), np.linspace(5.0, 5.3, T - half)])
    leg = (np.arange(T) >= half).astype(float)
    metrics = figures(sample_trajectory(T, distance=distance, leg=leg))
    assert metrics["distance_m"] == pytest.approx(0.5)
    assert metrics["mean_speed_m_s"] == pytest.approx(0.5 / 4.0)


def test_phase_times_add_up_to_the_duration():
    """No second is counted twice or lost between two phases."""
    times = figures(sample_trajectory(T))["phase_time_s"]
    assert isinstance(times, dict)
    assert set(times) == {"straight", "turn", "leave"}
    assert sum(times.values()) == pytest.approx(4.0)


def test_means_weigh_by_time_not_by_sample():
    """Halving the step in one half of the run does not pull the mean there."""
    trajectory = sample_trajectory(T)
    time = np.concatenate([np.linspace(0, 1, 101), np.linspace(1, 4, 101)[1:]])
    force = np.where(time[:, None] <= 1, 10.0, 20.0) * np.ones(3)
    uneven = Trajectory(
        time,
        dict(trajectory.channels) | {"normal_force": force},
        trajectory.phases,
        trajectory.qpos,
        trajectory.schema,
    )
    assert figures(uneven)["normal_force_mean_n"] == pytest.approx([17.5] * 3, rel=0.01)


def test_a_single_sample_has_figures():
    """A run that ends at once gives finite figures, zero where they are rates or integrals."""
    trajectory = sample_trajectory(T)
    one = Trajectory(
        trajectory.time[:1],
        {k: v[:1] for k, v in trajectory.channels.items()},
        trajectory.phases,
        trajectory.qpos[:1],
        trajectory.schema,
    )
    metrics = figures(one)
    assert metrics["mean_speed_m_s"] == 0.0
    assert metrics["torque_change_nm_s"] == metrics["time_at_limit_s"] == [0.0] * 3
    assert metrics["normal_force_mean_n"] == pytest.approx([25.0] * 3)


@pytest.mark.parametrize("name", PER_MODULE)
def test_per_module_figures_are_three_plain_numbers(name):
    """Every figure of the modules is a list of three numbers that JSON can hold."""
    values = figures(sample_trajectory(T))[name]
    assert isinstance(values, list)
    assert [type(value) for value in values] == [float] * 3


def localisation(**channels: np.ndarray) -> Metrics:
    """Figures of a robot's own estimates along a way of 2 m, by channels (T, ...)."""
    position = np.zeros((T, 3))
    position[:, 2] = np.linspace(0.0, 2.0, T)
    trajectory, schema = sample_trajectory(), {one.name: one for one in ESTIMATES}
    whole = {name: np.zeros((T, *channel.shape)) for name, channel in schema.items()}
    whole |= {**trajectory.channels, "theta5": np.zeros(T)}
    whole |= {"position": position, "position_estimate": position} | channels
    record = replace(trajectory, channels=whole, schema={**trajectory.schema, **schema})
    return summarise(Run(record), ESTIMATE_METRICS)


def test_errors_of_the_estimated_place_are_largest_mean_and_95_percent():
    """Of an error that grows evenly from 0 to 0.4 m on a way of 2 m."""
    error = np.linspace(0.0, 0.4, T)
    estimate = np.stack([error, np.zeros(T), np.linspace(0.0, 2.0, T)], axis=-1)
    found = localisation(position_estimate=estimate)
    assert found["localisation_error_max_m"] == pytest.approx(0.4)
    assert found["localisation_error_mean_m"] == pytest.approx(0.2, rel=0.01)
    assert found["localisation_error_rel"] == pytest.approx(0.95 * 0.4 / 2.0, rel=0.01)


def test_the_error_of_theta5_counts_where_the_robot_claims_to_know_it():
    """To 20 degrees; it is the angle between both, whole turns apart or not."""
    early = np.arange(T) < T // 2
    estimate = np.where(early, 2.0, 2 * np.pi + np.radians(3.0))
    for std, expected in ((19.0, np.degrees(2.0)), (21.0, 3.0)):
        doubt = np.where(early, np.radians(std), 0.0)
        found = localisation(theta5_estimate=estimate, theta5_std=doubt)
        assert found["theta5_error_p95_deg"] == pytest.approx(expected)
    nothing = localisation(theta5_std=np.full(T, np.pi))
    assert np.isnan(nothing["theta5_error_p95_deg"])
