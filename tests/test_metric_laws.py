"""Laws of metrics: figures of made-up records for which they are known in closed form."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.autonomy.camera_sight import CameraSight
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.map_difference import MapDifference
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.metrics import (
    COMMON_METRICS,
    ESTIMATE_METRICS,
    ESTIMATES,
    Metric,
    Run,
    summarise,
)
from omnitrack_sim.record.timeline import timeline
from omnitrack_sim.record.trajectory import Recorder, Trajectory
from omnitrack_sim.robots.kinds import ROBOTS, robot_class
from omnitrack_sim.robots.omnitrack.channels import RECORDED
from omnitrack_sim.robots.omnitrack.metrics import METRICS
from omnitrack_sim.robots.scene import compiled
from omnitrack_sim.robots.tail import (
    TAIL_CHANNELS,
    TAIL_METRICS,
    TETHER_CHANNELS,
    TETHER_METRICS,
)
from omnitrack_sim.senses.optics import Eyes, Mount
from omnitrack_sim.senses.settings import SensingTable, camera_of
from omnitrack_sim.sim.onboard import ScoredSight
from omnitrack_sim.trials.mobility import CONTACT_FORCE
from omnitrack_sim.walls.rays import RayWalls

TIME = 2.0 + 1.25 * np.array([0.0, 0.1, 0.15, 0.35, 0.4, 0.7, 0.72, 1.0])
"""Instants of samples, s: no two steps are alike, and the first is not at 0."""
T, SECONDS = len(TIME), 1.25
LIMIT, EFFICIENCY, SPEED = 0.3, 0.8, 0.04
"""Torque limit, N m, and efficiency of the motors; a belt's speed, m/s."""
MOTOR = ot.MOTORS["pololu_1000_hpcb"].model_copy(
    update={"torque_limit": LIMIT, "efficiency": EFFICIENCY}
)
ROBOT = ot.Omnitrack(motor=MOTOR)
RADIUS = ROBOT.lug_radius
MODULES = np.array([1.0, 2.0, 0.0])
"""Factors of what the modules, bodies and actuators do: no two are alike."""
PHASES = ("cruise", "turn", "leave")
BODIES = tuple(
    Channel(name, (3,), unit, "of three bodies or actuators")
    for name, unit in (("actuator_power", "W"), ("wall_force", "N"), ("contact_speed", "m/s"))
)
SCHEMA = {**RECORDED} | {
    channel.name: channel for channel in (*ESTIMATES, *TAIL_CHANNELS, *TETHER_CHANNELS, *BODIES)
}
BELTS = {metric.name: metric for metric in METRICS}
"""Metrics of the paper's robot."""
OTHERS = {
    metric.name: metric
    for metric in (
        *(*COMMON_METRICS, *ESTIMATE_METRICS, *TAIL_METRICS, *TETHER_METRICS, CONTACT_FORCE),
    )
}
"""Metrics of all others, of estimates, tails and tethers."""


def record(time: Array = TIME, **channels: Any) -> Trajectory:
    """A record in which nothing happens but what ``channels`` (T, ...) say."""
    schema = dict(SCHEMA)
    for one in BODIES:  # of which a robot may have any number
        if one.name in channels:
            schema[one.name] = replace(one, shape=channels[one.name].shape[1:])
    whole = {name: np.zeros((len(time), *one.shape)) for name, one in schema.items()}
    whole |= {name: np.asarray(values) for name, values in channels.items()}
    return Trajectory(time, whole, PHASES, np.zeros((len(time), 28)), schema)


def figure(metric: Metric, trajectory: Trajectory, robot: Any = ROBOT) -> Any:
    """The figure of a record of the paper's robot, which weighs 9.81 N."""
    run = robot.run_record(trajectory, 0.007, 0.004 * math.sqrt(robot.length_scale))
    if metric not in METRICS:
        run = Run(trajectory, 9.81)
    value: Any = summarise(run, [metric])[metric.name]
    several = value.values() if isinstance(value, dict) else np.ravel(value).tolist()
    # Files hold plain numbers.
    assert isinstance(value, float | list | dict)
    assert all(type(one) is float for one in several), metric.name
    return value


class Of(NamedTuple):
    """What a metric is the integral, the mean or the largest of.

    Attributes:
        channels: of a record in which that is ``part(values)`` for values (T,).
        factor: of the figure, or those of the modules' figures.
        part: of the values that counts.
        power: of the figure that is such a mean.
    """

    channels: Callable[[Array], Mapping[str, Array]]
    factor: Any = MODULES
    part: Callable[[Array], Array] = np.abs
    power: int = 1


def modules(**channels: float) -> Callable[[Array], Mapping[str, Array]]:
    """Channels (T, 3) in proportion to the values, by the values' unit."""
    return lambda v: {name: unit * np.outer(v, MODULES) for name, unit in channels.items()}


def belts(v: Array) -> Mapping[str, Array]:
    """Belts that are driven by v W each."""
    speed = np.full((len(v), 3), SPEED)
    return {"belt_speed": speed, "motor_torque": np.outer(v, MODULES) * RADIUS / SPEED}


def limit(v: Array) -> Mapping[str, Array]:
    """Modules 1 and 2 at the torque limit where v is 1 or -1, which way the belts run or stand."""
    return {"motor_torque": np.outer(v, [0.995 * LIMIT, 1.1 * LIMIT, 0.0])}


def slipping(v: Array) -> Mapping[str, Array]:
    """Bodies that slip; the third does not touch the wall."""
    touch = np.tile([1.0, 1.0, 0.0], (len(v), 1))
    return {"contact_speed": np.outer(v, [1.0, 2.0, 7.0]), "wall_force": touch}


def touching(v: Array) -> Mapping[str, Array]:
    """Module 1 touches with its lower, module 2 with its upper track."""
    count = np.zeros((len(v), 3, 2))
    count[:, 0, 1], count[:, 1, 0] = v, 5 * v
    return {"contact_count": count}


def root(name: str) -> Callable[[Array], Mapping[str, Array]]:
    """A channel whose square is v, with the sign of v."""
    return lambda v: {name: np.sqrt(np.outer(np.abs(v), MODULES)) * np.sign(v)[:, None]}


def missed(v: Array) -> Mapping[str, Array]:
    """A robot that is off by v m, askew."""
    true = np.outer(np.arange(len(v)), [0.0, 0.0, 0.3])
    return {"position": true, "position_estimate": true + np.outer(v, [0.6, 0.0, -0.8])}


def driving(v: Array) -> Array:
    """What is not negative: braking gives nothing back."""
    return np.maximum(v, 0.0)


ONE_OR_BOTH = np.array([1.0, 1.0, 0.0])
INTEGRALS: Mapping[Metric, Of] = {
    BELTS["energy_j"]: Of(belts, 3.0 / EFFICIENCY, driving),
    BELTS["slip_distance_m"]: Of(modules(slip_velocity=1.0)),
    BELTS["time_at_limit_s"]: Of(limit, ONE_OR_BOTH),
    BELTS["stall_time_s"]: Of(limit, ONE_OR_BOTH),
    OTHERS["energy_j"]: Of(modules(actuator_power=1.0), 3.0, driving),
    OTHERS["slip_distance_mean_m"]: Of(slipping, 1.5, np.positive),
}
MEANS: Mapping[Metric, Of] = {
    BELTS["slip_ratio_mean"]: Of(modules(slip_ratio=1.0)),
    BELTS["traction_rms_n"]: Of(root("traction"), power=2),
    BELTS["torque_rms_nm"]: Of(root("motor_torque"), power=2),
    BELTS["normal_force_mean_n"]: Of(modules(normal_force=1.0), part=np.positive),
    BELTS["contact_fraction"]: Of(touching, ONE_OR_BOTH, np.positive),
    OTHERS["wall_force_sum_mean_n"]: Of(modules(wall_force=1.0), 3.0, np.positive),
    OTHERS["localisation_error_mean_m"]: Of(missed, 1.0),
}
EXTREMES: Mapping[Metric, Of] = {
    BELTS["tilt_max_deg"]: Of(lambda v: {"tilt": np.radians(v)}, 1.0, np.positive),
    BELTS["normal_force_max_n"]: Of(modules(normal_force=1.0), part=np.positive),
    BELTS["spring_travel_max_m"]: Of(modules(slide=1.0)),
    BELTS["pitch_max_deg"]: Of(modules(pitch=math.pi / 180)),
    BELTS["motor_torque_max_nm"]: Of(modules(motor_torque=1.0)),
    OTHERS["wall_force_max_n"]: Of(modules(wall_force=1.0), 2.0, np.positive),
    OTHERS["localisation_error_max_m"]: Of(missed, 1.0),
    OTHERS["tail_force_max_n"]: Of(lambda v: {"tail_force": v}, 1.0, np.positive),
    OTHERS["tether_out_max_m"]: Of(lambda v: {"tether_out": v}, 1.0, np.positive),
}
FLAGS = ("time_at_limit_s", "stall_time_s", "contact_fraction")
"""What holds or does not: there is nothing in between."""


def impulses(part: Callable[[Array], Array]) -> list[tuple[Array, Array]]:
    """Values (T,) of 1 in one sample, of -1 in one or in turns where they may be; and weights."""
    weights = np.convolve(np.diff(TIME), [0.5, 0.5])  # of the trapezoidal rule
    single = [*np.eye(T)]
    if part is not np.positive:
        single += [*-np.eye(T), (-1.0) ** np.arange(T)]
    return [(values, weights) for values in single]


def check(metric: Metric, law: Of, values: Array, expected: float) -> None:
    """Compare the figure of a record of values with what it is in closed form."""
    found = np.asarray(figure(metric, record(TIME[: len(values)], **law.channels(values))))
    wanted = np.asarray(law.factor) * expected
    message = f"{metric.name} of {values}"
    assert found**law.power == pytest.approx(wanted, rel=1e-9, abs=1e-12), message


@pytest.mark.parametrize(("laws", "time"), [(INTEGRALS, 1.0), (MEANS, SECONDS)])
def test_integrals_and_means_follow_the_trapezoidal_rule(laws, time) -> None:
    """Each sample, the first and the last too, weighs half of the steps beside it; a ramp counts
    with its middle; sizes count both ways, and what brakes gives nothing back."""
    for metric, law in laws.items():
        for values, weights in impulses(law.part):
            check(metric, law, values, weights @ law.part(values) / time)
        if metric.name not in FLAGS:
            check(metric, law, TIME - TIME[0] + 2.0, (2.0 + SECONDS / 2) * SECONDS / time)


def test_extremes_are_found_in_any_sample() -> None:
    """The largest value counts once, be it in the first or the last sample, and with its size where
    it may be negative."""
    for metric, law in EXTREMES.items():
        for values, _ in impulses(law.part)[: 2 * T]:
            check(metric, law, values, 1.0)


def test_a_record_of_one_sample_has_figures() -> None:
    """Integrals over no time are 0, and means and extremes are the sample itself."""
    for metric, law in INTEGRALS.items():
        check(metric, law, np.ones(1), 0.0)
    for metric, law in {**MEANS, **EXTREMES}.items():
        travel = metric.name == "spring_travel_max_m"  # from the first sample
        check(metric, law, np.ones(1), 0.0 if travel else 1.0)


def test_what_is_no_number_is_not_hidden() -> None:
    """A sample that physics has left without a number makes a figure of its module none."""
    for metric, law in {**INTEGRALS, **MEANS, **EXTREMES}.items():
        if metric.name in FLAGS:
            continue
        for sample in (0, 3, T - 1):
            values = np.ones(T)
            values[sample] = math.nan
            found = figure(metric, record(**law.channels(values)))
            assert np.isnan(np.asarray(found).flat[0]), metric.name


LEGS = {
    "leg": np.array([0, 0, 0, 1, 1, 1, 1, 2]),
    "distance": np.array([0.1, 0.3, 0.15, 5.0, 5.4, 5.2, 5.3, 9.0]),  # 0.05 + 0.3 + 0 m
}
LINE = np.outer([0.0, 0.3, 0.6, 1.0, 0.7, 0.5, 0.2, 0.0], [0.0, 0.6, 0.8])  # there and back, 2 m
FORCE = np.array([9.0, 1.0, 2.0, 3.0, 8.0, 4.0, 5.0, 6.0])
STEADY = {"actuator_power": np.tile([7.0, 0.0, -3.0], (T, 1))}  # W
STEPS = np.outer([0.0, 1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 0.25], [1.0, -2.0, 0.0])
SHAKY = {"theta5": np.full(T, 3.1), "theta5_estimate": np.radians(np.arange(T)) - np.pi}
LOST, SURE = np.full(T, 0.36), np.full(T, 0.34)  # rad; 20 degrees are 0.349
COIL, TURN = MOTOR.winding, 2.0
assert COIL is not None
KN = COIL.torque_constant * MOTOR.gear_ratio  # N m/A at the shaft
CURRENTS = [
    (0.25 / EFFICIENCY + MOTOR.friction_torque) / KN,
    COIL.no_load_current,
    (0.6 * EFFICIENCY - MOTOR.friction_torque) / KN,
]
"""Of motors with 0.25, 0 and -0.6 N m at the shaft, A."""
EXACT: tuple[tuple[str, dict[str, Any], dict[Metric, Any]], ...] = (
    (
        "headway is that of each leg; arc lengths of different legs are not subtracted",
        LEGS | STEADY,
        {
            BELTS["distance_m"]: 0.35,
            BELTS["mean_speed_m_s"]: 0.35 / SECONDS,
            OTHERS["cost_of_transport"]: 7.0 * SECONDS / (9.81 * 0.35),
        },
    ),
    (
        "backing off takes away from headway, and what goes backward costs no transport",
        STEADY | {"distance": np.linspace(1.0, 0.4, T)},
        {
            BELTS["distance_m"]: -0.6,
            BELTS["mean_speed_m_s"]: -0.6 / SECONDS,
            OTHERS["cost_of_transport"]: math.nan,
        },
    ),
    (
        "the tilt at the exit is that of the last sample, whatever there was before",
        {"tilt": np.linspace(0.3, 0.1, T)},
        {BELTS["tilt_exit_deg"]: math.degrees(0.1)},
    ),
    (
        "what slip reads without load is told as it was found, at twice the default step too large",
        {},
        {BELTS["no_load_slip_m_s"]: 0.007, BELTS["slip_excess"]: 0.1 * 2**2.6},
    ),
    (
        "changes of torque add up by their sizes, to 1 + 2 + 1 + 0.25 of the first module",
        {"motor_torque": STEPS},
        {BELTS["torque_change_nm_s"]: [4.25 / SECONDS, 8.5 / SECONDS, 0.0]},
    ),
    (
        "times of a phase add up; one that begins with the last sample has lasted no time",
        {"phase": np.array([1, 1, 0, 0, 1, 1, 1, 2])},
        {BELTS["phase_time_s"]: {"turn": 0.9375, "cruise": 0.3125, "leave": 0.0}},
    ),
    (
        "errors of the place are told in parts of the whole way, there and back",
        {"position": LINE, "position_estimate": LINE + np.outer(np.arange(T) / 70, [0, 1.0, 0])},
        {OTHERS["localisation_error_rel"]: 0.95 * 0.1 / 2.0},
    ),
    (
        "an error of a robot that stands is no part of any way",
        {"position_estimate": LINE},
        {OTHERS["localisation_error_rel"]: math.nan},
    ),
    (
        "errors of theta5 are angles, whole turns aside: 95 % of the way from 2.4 to 9.4",
        SHAKY | {"theta5_std": SURE},
        {OTHERS["theta5_error_p95_deg"]: np.degrees(np.pi - 3.1) + 0.95 * 7},
    ),
    (
        "what a robot does not claim to know to 20 degrees is not held against it",
        SHAKY | {"theta5_std": np.where(np.arange(T) == 2, SURE, LOST)},
        {OTHERS["theta5_error_p95_deg"]: np.degrees(np.pi - 3.1) + 2},
    ),
    (
        "nothing is held against a robot that claims nothing",
        SHAKY | {"theta5_std": LOST},
        {OTHERS["theta5_error_p95_deg"]: math.nan},
    ),
    (
        "the pull that is held is that at the farthest place of the last leg",
        {"tail_force": FORCE, "leg": np.arange(T) > 2, "distance": [9, 9, 9, 1, 2, 4, 3, 1.0]},
        {OTHERS["pull_held_n"]: 4.0},
    ),
    (
        "neither the first sample, of a robot that is held, nor what is no number is a force",
        {
            "wall_force": np.stack(
                [np.where(np.arange(T) == 6, math.nan, 0.0), FORCE, FORCE / 2], axis=1
            )
        },
        {CONTACT_FORCE: 8.0},
    ),
    (
        "a body counts as touching if it touches once, also at the end; if none does, none slips",
        {
            "wall_force": np.outer(np.arange(T) == T - 1, [0.0, 1.0, 0.0]),
            "contact_speed": np.tile([9.0, 0.5, 9.0], (T, 1)),
        },
        {OTHERS["slip_distance_mean_m"]: 0.5 * SECONDS},
    ),
    (
        "nothing touches: no force and no slip",
        {"contact_speed": np.ones((T, 3))},
        {
            OTHERS["slip_distance_mean_m"]: 0.0,
            OTHERS["wall_force_max_n"]: 0.0,
            OTHERS["wall_force_sum_mean_n"]: 0.0,
            BELTS["contact_fraction"]: [0.0] * 3,
            CONTACT_FORCE: 0.0,
        },
    ),
    (
        "a robot without a body that could touch has no force either",
        {"contact_speed": np.ones((T, 0)), "wall_force": np.ones((T, 0))},
        {OTHERS["slip_distance_mean_m"]: 0.0, OTHERS["wall_force_max_n"]: 0.0, CONTACT_FORCE: 0.0},
    ),
    (
        "a belt stalls below 5 mm/s at 99 % of its torque limit, either way",
        {
            "belt_speed": np.tile([-0.0049, 0.0051, 0.0], (T, 1)),
            "motor_torque": np.tile([0.991 * LIMIT, -0.991 * LIMIT, 0.989 * LIMIT], (T, 1)),
        },
        {BELTS["time_at_limit_s"]: [1.25, 1.25, 0.0], BELTS["stall_time_s"]: [1.25, 0.0, 0.0]},
    ),
    (
        "torque counts beyond the recommended 0.245 N m, either way",
        {"motor_torque": np.tile([0.2451, -0.2451, 0.245], (T, 1))},
        {BELTS["time_above_recommended_s"]: [1.25, 1.25, 0.0]},
    ),
    (
        "a motor that drives, one that runs free, and one that brakes harder than friction does",
        {
            "belt_speed": np.full((T, 3), TURN * RADIUS),
            "motor_torque": np.tile([0.25, 0.0, -0.6], (T, 1)),
        },
        {
            BELTS["motor_current_max_a"]: CURRENTS,
            BELTS["motor_current_rms_a"]: CURRENTS,
            BELTS["electric_energy_j"]: SECONDS
            * sum(COIL.resistance * i**2 + KN * TURN * i for i in CURRENTS[:2]),
            BELTS["winding_temperature_max_c"]: COIL.temperature(TIME, np.tile(CURRENTS, (T, 1)))[
                -1
            ],
        },
    ),
)


def test_figures_of_single_records_are_those_of_hand() -> None:
    """Headway, changes, phases, errors of the estimate, pulls and thresholds, one by one."""
    for what, channels, expected in EXACT:
        trajectory = record(**channels)
        for metric, value in expected.items():
            found = figure(metric, trajectory)
            assert found == pytest.approx(value, rel=1e-9, nan_ok=True), f"{metric.name}: {what}"


def test_the_contact_force_of_modules_is_their_normal_force() -> None:
    """A robot whose bodies are not measured one by one has its modules; a force without bound is
    told as such, and not as a large number."""
    force = np.outer(FORCE, [0.5, 1.0, 0.0])
    for last, expected in ((6.0, 8.0), (math.inf, math.inf)):
        force[-1, 0] = last
        channels = {name: np.zeros((T, *one.shape)) for name, one in RECORDED.items()}
        trajectory = Trajectory(
            TIME, channels | {"normal_force": force}, PHASES, np.zeros((T, 28)), RECORDED
        )
        assert figure(CONTACT_FORCE, trajectory) == expected


PAIR = ot.Drive("pair", ((1, 0, 0), (0, 0.5, 0.5)), size=1.5)
OPPOSED = ot.Drive("opposed", ((1, 0, -0.5),), size=2.0)


def test_a_motor_of_unknown_winding_has_no_current() -> None:
    """Robots have the metrics that the figures of their motors are enough for, and no others."""
    electric = {
        *("motor_current_max_a", "motor_current_rms_a"),
        *("winding_temperature_max_c", "electric_energy_j"),
    }
    everything = set(BELTS)
    for missing, names in (
        ({}, set()),
        ({"winding": None}, electric),
        ({"recommended_torque": None}, {"time_above_recommended_s"}),
    ):
        robot = ot.Omnitrack(motor=MOTOR.model_copy(update=missing))
        assert {one.name for one in robot.metrics} == everything - names


def test_the_current_of_a_belt_is_that_of_its_motor(monkeypatch) -> None:
    """Of three times the size a motor takes three times the current and is as hot; belts that
    share a motor have its figures."""
    monkeypatch.setitem(ot.DRIVES, PAIR.name, PAIR)
    robot = ot.Omnitrack(motor=MOTOR, drive=PAIR.name)
    torque = 1.5 * np.array([[0.25, 0.1, 0.1]])  # the shared motor has 0.2 N m a size of one
    speed = np.full((T, 3), TURN * RADIUS)
    trajectory = record(motor_torque=np.tile(torque, (T, 1)), belt_speed=speed)
    each = [(part / EFFICIENCY + MOTOR.friction_torque) / KN for part in (0.25, 0.2, 0.2)]
    found = figure(BELTS["motor_current_max_a"], trajectory, robot)
    assert found == pytest.approx([1.5 * current for current in each])
    assert COIL is not None
    hot = COIL.temperature(TIME, np.tile(each, (T, 1)))[-1]
    assert figure(BELTS["winding_temperature_max_c"], trajectory, robot) == pytest.approx(hot)


@pytest.mark.parametrize("drive", [*ot.DRIVES.values(), PAIR, OPPOSED], ids=lambda one: one.name)
def test_energy_is_that_of_the_motors_whatever_the_gears(drive: ot.Drive, monkeypatch) -> None:
    """A motor that pushes with 5 N while its belts run at its speed of 0.2 m/s does 1 W over the
    efficiency, whichever belts it drives; one that is driven does none; passages of a timeline add
    up to the same."""
    monkeypatch.setitem(ot.DRIVES, drive.name, drive)
    robot = ot.Omnitrack(motor=MOTOR, drive=drive.name)
    route = ot.load_scenario("straight").route
    for way in (1.0, -1.0):
        motors = way * np.array([5.0, -3.0, 4.0])[: drive.motors]
        speed = 0.2 * np.linalg.pinv(drive.matrix) @ np.array([1.0, 1.0, -2.0])[: drive.motors]
        power = motors * (drive.matrix @ speed)
        torque = np.tile(drive.belt_values(motors[None]) * RADIUS, (T, 1))
        trajectory = record(motor_torque=torque, belt_speed=np.tile(speed, (T, 1)))
        expected = pytest.approx(np.maximum(power, 0.0).sum() * SECONDS / EFFICIENCY)
        assert figure(BELTS["energy_j"], trajectory, robot) == expected
        passages = timeline(trajectory, [route], robot.touch(trajectory))
        assert sum(one.energy_j for one in passages) == expected


LIMITS = (
    (ot.DRIVES["three_motors"], (1.0, 1.0, 1.0)),
    (ot.DRIVES["differential"], (1.0, 1.0, 1.0)),
    (PAIR, (1.5, 0.75, 0.75)),
    (OPPOSED, (2.0, 0.0, 1.0)),
)


@pytest.mark.parametrize(("drive", "limits"), LIMITS, ids=lambda one: getattr(one, "name", ""))
def test_a_belt_is_at_its_limit_where_its_motors_can_give_no_more(drive, limits, monkeypatch):
    """The limits of drives by hand: just below 99 % no belt counts, just above each does."""
    monkeypatch.setitem(ot.DRIVES, drive.name, drive)
    robot = ot.Omnitrack(motor=MOTOR, drive=drive.name)
    for part, seconds in ((0.985, 0.0), (0.995, SECONDS)):
        torque = np.tile(part * LIMIT * np.array(limits), (T, 1))
        found = figure(BELTS["time_at_limit_s"], record(motor_torque=torque), robot)
        driven = np.array(limits) > 0
        assert np.array(found)[driven] == pytest.approx(seconds)


@pytest.mark.parametrize("kind", ["presser", "screw"])
def test_other_robots_are_weighed_as_they_are(kind: str) -> None:
    """Cost of transport is over the weight of all bodies of the robot's own model."""
    robot = ot.load_scenario(f"robots/{kind}_tee").robot
    run = robot.run_record(record(**STEADY, distance=np.linspace(0, 0.5, T)), math.nan, math.nan)
    weight = 9.81 * compiled(robot).body_mass.sum()
    found = summarise(run, robot.metrics)["cost_of_transport"]
    assert found == pytest.approx(7.0 * SECONDS / (weight * 0.5))


def test_a_robot_that_ended_early_in_a_batch_has_the_figures_that_it_has_alone() -> None:
    """Its record ends with the first sample at its end, however long the others run."""
    ends = np.array([TIME[-1], TIME[3], TIME[0], 2.46])  # the last one between two samples
    time = np.minimum(TIME[:, None], ends)  # of a robot that has ended it stands still
    rng = np.random.default_rng(1)
    values = {name: rng.random((T, 4, *one.shape)) for name, one in SCHEMA.items()}
    values |= {"phase": np.zeros((T, 4)), "leg": np.zeros((T, 4))}
    recorder = Recorder(PHASES, SCHEMA)
    for sample in range(T):
        now = {name: of_all[sample] for name, of_all in values.items()}
        measured = {name for name in SCHEMA if SCHEMA[name].source == "plant"}
        readings = {"time": time[sample]} | {name: now.pop(name) for name in measured}
        recorder.sample(np.zeros((4, 28)), readings, now)
    for i, trajectory in enumerate(recorder.trajectories(ends)):
        count = (T, 4, 1, 5)[i]
        alone = record(time[:count, i], **{name: all[:count, i] for name, all in values.items()})
        assert trajectory.time.tolist() == alone.time.tolist()
        for metric in LAWS:
            found = figure(metric, trajectory)
            np.testing.assert_equal(found, figure(metric, alone), metric.name)


def test_figures_of_a_map_count_what_it_has_and_what_is_wrong() -> None:
    """Faults are the parts that are wrong or too many and the ends that are; a map that lacks a
    part, has another kind or leaves a joint open is not complete."""
    pairs = [("a", "b")] * 9
    right = MapDifference(10, 10, (), (), (), (), (), (), 5.0, 0.25)
    wrong = replace(
        right,
        found=4,
        missing=("a",),
        extra=("a",) * 2,
        kinds=pairs[:3],
        wrong_sizes=pairs[:4],
        angles=pairs[:5],
        loose=pairs[:6],
        ends=pairs[:7],
    )
    assert right.figures() == {
        "map_found": 1.0,
        "map_complete": 1.0,
        "map_length_error_m": 0.25,
        "map_faults": 0.0,
    }
    assert wrong.figures() == {
        "map_found": 0.4,
        "map_complete": 0.0,
        "map_length_error_m": 0.25,
        "map_faults": 2.0 + 3 + 4 + 5 + 7,
    }
    for name in ("missing", "kinds", "loose", "extra", "wrong_sizes", "angles", "ends"):
        complete = replace(right, **{name: pairs[:1]}).figures()["map_complete"]
        assert complete == (name not in ("missing", "kinds", "loose")), name


def test_the_recognition_rate_is_of_looks_that_were_sure(monkeypatch) -> None:
    """Two of three sightings that are right are two thirds, for each robot by itself; a look that
    shows nothing counts for none, and without any there is no rate."""
    true = ot.Sighting(end="open", distance=0.4)
    wrong, unsure = replace(true, end="closed"), None
    seen = iter([true, wrong, unsure, true])
    monkeypatch.setattr(CameraSight, "look", lambda *_: next(seen))
    table = SensingTable()
    walls = RayWalls([ot.load_scenario("straight").route.network.parts])
    world: Any = SimpleNamespace(sight=SimpleNamespace(look=lambda *_: true))
    sight = ScoredSight(Eyes(Mount(camera_of(table), 0.1), walls, 2), table, [world] * 2)
    at: Any = SimpleNamespace(position=None, rotation=None)
    for _ in range(4):
        sight.look(1, at, at, at)
    assert math.isnan(sight.rate(0))
    assert sight.rate(1) == pytest.approx(2 / 3)
    sight.reset(np.array([1]), [world])
    assert math.isnan(sight.rate(1))


LAWS = {*INTEGRALS, *MEANS, *EXTREMES, *(one for *_, expected in EXACT for one in expected)}


def metrics_of_package() -> set[Metric]:
    """Metrics of all shipped robots, and all others that a module of the package states."""
    found = {one for kind in ROBOTS for one in robot_class(kind).model_construct().metrics}
    package = Path(ot.__file__).parent
    for path in package.rglob("*.py"):
        if "Metric(" not in path.read_text():
            continue
        module = importlib.import_module(
            ".".join((package.name, *path.relative_to(package).with_suffix("").parts))
        )
        for value in vars(module).values():
            several = value if isinstance(value, tuple) else (value,)
            found |= {one for one in several if isinstance(one, Metric)}
    return found


def test_every_metric_has_a_law() -> None:
    """A metric of any shipped robot, of estimates or of tethers that no law is about is told."""
    assert sorted(one.name for one in metrics_of_package() - LAWS) == []


def test_the_slip_without_load_is_that_of_a_robot_that_has_settled() -> None:
    """It is that of a weightless robot long after its start, within a twentieth."""
    changes = {"world.gravity": [0.0, 0.0, 0.0], "run.time_limit": 2.0}
    result = ot.run(ot.load_scenario("straight", changes))
    slip, time = result.trajectory["slip_velocity"], result.trajectory.time
    steady = np.abs(slip[time > 1.5]).mean()
    assert result.metrics["no_load_slip_m_s"] == pytest.approx(steady, rel=0.05)
