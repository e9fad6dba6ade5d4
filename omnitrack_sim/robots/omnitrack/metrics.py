"""Metrics of the omnidirectional robot, computed from the trajectory of a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.record.metrics import MOTION, PHASE_TIME, Metric, Run
from omnitrack_sim.robots.omnitrack.drive import Drive
from omnitrack_sim.robots.omnitrack.motors import Motor

STALL_SPEED = 0.005
"""Belt speed below which a belt at its torque limit counts as stalled, m/s."""
AT_LIMIT = 0.99
"""Part of its torque limit from which on a belt counts as at its limit."""


@dataclass(frozen=True)
class BeltRun(Run):
    """Data of a run of the omnidirectional robot.

    Attributes:
        no_load_slip: m/s, what slip reads in a straight pipe without load.
        lug_radius: m, belt speed over shaft speed.
        motor: ``robot.motor``.
        drive: the motors, and the gears between them and the belts.
        slip_excess: share by which slip reads too large at the run's time step, of a typical turn.
    """

    no_load_slip: float = math.nan
    lug_radius: float = math.nan
    motor: Motor = field(kw_only=True)
    drive: Drive = field(kw_only=True)
    slip_excess: float = 0.0

    @property
    def belt_limits(self) -> NDArray[np.float64]:
        """Largest torque that the motors can give each belt's shaft (3,), N m."""
        return self.drive.strength * self.motor.max_torque

    @property
    def shafts(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Torque, N m, and speed, rad/s, of each motor's shaft (T, m)."""
        # With a differential, torques and speeds of the motors are not those of the belts.
        torque = self.drive.motor_forces(np.asarray(self.trajectory["motor_torque"], float))
        speed = self.drive.motor_values(np.asarray(self.trajectory["belt_speed"], float))
        return torque, speed / self.lug_radius

    @property
    def power(self) -> NDArray[np.float64]:
        """Mechanical power of each motor's shaft (T, m), W."""
        torque, speed = self.shafts
        return torque * speed

    @property
    def current(self) -> NDArray[np.float64]:
        """Current of each motor (T, m), A.

        A motor of another size than ``robot.motor`` stands for as many of them side by side.

        Raises:
            ValueError: ``robot.motor`` has no winding.
        """
        torque, speed = self.shafts
        return self.drive.size * self.motor.current(torque / self.drive.size, speed)

    def of_belts(self, values: NDArray) -> list[float]:
        """Largest of the figures (m,) of the motors that drive each belt (3,)."""
        drives = np.abs(self.drive.matrix) > 0
        return np.where(drives, np.asarray(values)[:, None], -math.inf).max(axis=0).tolist()


def _at_limit(run: BeltRun) -> NDArray[np.float64]:
    """Ones (T, 3) for belts at their torque limits, else zeros."""
    # Not quite the limit, which a motor that the servo holds there misses by a little.
    torque = np.abs(run.trajectory["motor_torque"])
    return (torque >= AT_LIMIT * run.belt_limits).astype(float)


def _above_recommended(run: BeltRun) -> list[float]:
    recommended = run.motor.recommended_torque
    assert recommended is not None
    above = np.abs(run.trajectory["motor_torque"]) > run.drive.strength * recommended
    return run.integral(above.astype(float)).tolist()


def _winding_temperature(run: BeltRun) -> list[float]:
    winding = run.motor.winding
    assert winding is not None
    each = winding.temperature(run.trajectory.time, run.current / run.drive.size)
    return run.of_belts(each.max(axis=0))


def _electric_energy(run: BeltRun) -> float:
    (torque, speed), size = run.shafts, run.drive.size
    power = size * run.motor.electric_power(torque / size, speed)
    return float(run.integral(np.maximum(power, 0.0)).sum())


def _torque_change(run: Run) -> list[float]:
    # A run of one sample has no time to divide by.
    if run.duration == 0:
        return [0.0] * run.trajectory["motor_torque"].shape[1]
    # Sizes add up, so that a torque that swings counts and one that merely grows counts once.
    steps = np.abs(np.diff(run.trajectory["motor_torque"], axis=0))
    return (steps.sum(axis=0) / run.duration).tolist()


def _largest(values: NDArray) -> list[float]:
    return np.abs(values).max(axis=0).tolist()


def _of_modules(
    name: str, unit: str, meaning: str, compute: Callable[[Any], list[float]], **shown: Any
) -> Metric:
    """Return a metric with a value for each module; ``shown``: its title and digits."""
    return Metric(name, unit, meaning, compute, per_module=True, **shown)


_OF_ANY_MOTOR: tuple[Metric, ...] = (
    *MOTION,
    Metric(
        "energy_j",
        "J",
        "mechanical work of the rotors of all crawler motors: the positive part of each shaft's "
        "power, integrated, over the motor's efficiency; braking gives nothing back",
        lambda r: float(r.integral(np.maximum(r.power, 0.0)).sum()) / r.motor.efficiency,
        title="energy",
        digits=1,
    ),
    Metric(
        "no_load_slip_m_s",
        "m/s",
        "mean size of the slip velocity when nothing pulls: of the same robot at the same friction "
        "and speed in a straight pipe without gravity, a run of its own",
        lambda r: r.no_load_slip,
        in_tables=False,
    ),
    Metric(
        "slip_excess",
        "1",
        "share by which slip reads too large at this time step, against an eighth of 2 ms: median "
        "of 64 dry tee turns, by a law of the step alone (docs/explanation/physics.md)",
        lambda r: r.slip_excess,
        in_tables=False,
    ),
    _of_modules(
        "slip_ratio_mean",
        "1",
        "mean size of the slip ratio, 0 to 1: slip velocity over the larger of belt and module "
        "speed; 0 without contact and where both are below 1 mm/s",
        lambda r: r.mean(np.abs(r.trajectory["slip_ratio"])).tolist(),
        title="mean slip ratio",
        digits=3,
    ),
    _of_modules(
        "slip_distance_m",
        "m",
        "size of the slip velocity, integrated: slip ahead and slip behind add up; none without "
        "contact",
        lambda r: r.integral(np.abs(r.trajectory["slip_velocity"])).tolist(),
        title="slip distance",
        digits=4,
    ),
    _of_modules(
        "traction_rms_n",
        "N",
        "root mean square of the wall's force on the module along its axis",
        lambda r: r.rms(r.trajectory["traction"]),
        title="traction, rms",
        digits=2,
    ),
    _of_modules(
        "normal_force_mean_n",
        "N",
        "mean of the sum of the normal forces at the module's lugs, 0 without contact",
        lambda r: r.mean(r.trajectory["normal_force"]).tolist(),
        title="mean normal force",
        digits=1,
    ),
    _of_modules(
        "normal_force_max_n",
        "N",
        "largest sum of the normal forces at the module's lugs in a sample; it depends on "
        "`record.period`",
        lambda r: _largest(r.trajectory["normal_force"]),
        title="largest normal force",
        digits=1,
    ),
    _of_modules(
        "contact_fraction",
        "1",
        "part of the time in which at least one lug of the module touches the wall, 0 to 1",
        lambda r: r.mean((r.trajectory["contact_count"].sum(axis=-1) > 0).astype(float)).tolist(),
        title="time in contact",
        digits=3,
    ),
    _of_modules(
        "spring_travel_max_m",
        "m",
        "largest travel of the arm, either way, from where it stood at the start",
        lambda r: _largest(r.trajectory["slide"] - r.trajectory["slide"][0]),
        title="largest spring travel",
        digits=4,
    ),
    _of_modules(
        "pitch_max_deg",
        "deg",
        "largest pitch of the arm against the robot axis, either way",
        lambda r: np.degrees(np.abs(r.trajectory["pitch"]).max(axis=0)).tolist(),
    ),
    _of_modules(
        "motor_torque_max_nm",
        "N m",
        "largest size of `motor_torque`, what the motors give the belt's shaft",
        lambda r: _largest(r.trajectory["motor_torque"]),
        title="largest motor torque",
        digits=3,
    ),
    _of_modules(
        "torque_rms_nm",
        "N m",
        "root mean square of the same torque",
        lambda r: r.rms(r.trajectory["motor_torque"]),
        title="motor torque, rms",
        digits=3,
    ),
    _of_modules(
        "torque_change_nm_s",
        "N m/s",
        "sizes of the changes of the same torque from sample to sample, added up, over the time; "
        "it depends on `record.period`",
        _torque_change,
        title="change of torque",
        digits=2,
    ),
    _of_modules(
        "time_at_limit_s",
        "s",
        f"time with at least {100 * AT_LIMIT:.0f} % of the belt's torque limit, either way, "
        "whether the belt stands or runs; the limit is the most that the motors can give this "
        "belt: `torque_limit`, or what its driver's current gives, with a motor for each, else "
        "that times the drive's size times the sum of the sizes of the belt's gears",
        lambda r: r.integral(_at_limit(r)).tolist(),
        title="time at the torque limit",
        digits=2,
    ),
    _of_modules(
        "stall_time_s",
        "s",
        f"the part of `time_at_limit_s` with a belt slower than {1e3 * STALL_SPEED:.0f} mm/s",
        lambda r: r.integral(
            _at_limit(r) * (np.abs(r.trajectory["belt_speed"]) < STALL_SPEED)
        ).tolist(),
        title="time stalled",
        digits=2,
    ),
    PHASE_TIME,
)
_OF_RECOMMENDED_TORQUE: tuple[Metric, ...] = (
    _of_modules(
        "time_above_recommended_s",
        "s",
        "time with more than `robot.motor.recommended_torque`, which for a belt is multiplied as "
        "its limit is; of motors that have one",
        _above_recommended,
        title="time above the recommended torque",
        digits=2,
    ),
)
_OF_WINDING: tuple[Metric, ...] = (
    Metric(
        "electric_energy_j",
        "J",
        "what the crawler motors take from their supply, with windings of 20 °C; what braking "
        "gives back is lost; of motors with a `winding`",
        _electric_energy,
        digits=1,
    ),
    _of_modules(
        "motor_current_max_a",
        "A",
        "largest current of a motor that drives the belt, by its torque and speed; of motors with "
        "a `winding`",
        lambda r: r.of_belts(r.current.max(axis=0)),
        digits=2,
    ),
    _of_modules(
        "motor_current_rms_a",
        "A",
        "root mean square of the same current, by which it heats",
        lambda r: r.of_belts(r.rms(r.current)),
        digits=2,
    ),
    _of_modules(
        "winding_temperature_max_c",
        "°C",
        "highest temperature of the winding of such a motor, of 20 °C at the start and around it",
        _winding_temperature,
        digits=0,
    ),
)
METRICS = (*_OF_ANY_MOTOR, *_OF_RECOMMENDED_TORQUE, *_OF_WINDING)
"""Metrics in the order of ``result.json``."""


def metrics_of(motor: Motor) -> tuple[Metric, ...]:
    """Return the metrics of robots with a motor: those that its figures are enough for."""
    recommended = () if motor.recommended_torque is None else _OF_RECOMMENDED_TORQUE
    return (*_OF_ANY_MOTOR, *recommended, *(() if motor.winding is None else _OF_WINDING))
