"""The electrical side of the crawler motors: torque-speed line, torque limit, integral part and
droop of the speed loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack.drive.gears import Drive
from omnitrack_sim.robots.omnitrack.motors import Motor


class SpeedLoop:
    """The electrical side of n robots' crawler motors: what the speed servos are asked and how much
    force they may give.

    The belts, with the reflected rotor inertia and the proportional part of the loop, are part of
    the physics. Here are the integral part with its droop, the torque-speed line and the limit.

    Args:
        drive: number of motors, and the gears between them and the belts.
        motor: ``robot.motor``.
        torque_limit: (n,) N m, overrides the motor's own.
        lug_radius: m, belt speed over shaft speed (Eq. 1).
        n: number of robots.

    Attributes:
        saturated: (n, 3) bool, modules whose motor is at its limit.
    """

    def __init__(
        self, drive: Drive, motor: Motor, torque_limit: ArrayLike, lug_radius: float, n: int
    ):
        self.drive, self.motor, self.lug_radius = drive, motor, lug_radius
        self.torque_limit = np.broadcast_to(np.asarray(torque_limit, float), (n,))[:, None]
        self.saturated: NDArray[np.bool_] = np.zeros((n, 3), bool)
        self._correction = np.zeros((n, drive.motors))  # m/s, integral part
        self._driven = np.abs(drive.matrix) > 0  # (m, 3) belts of each motor

    def restart(self, robots: NDArray[np.intp], torque_limit: Array) -> None:
        """Have the motors of ``robots`` (k,) begin anew, with limits ``torque_limit`` (k,) N m."""
        limits = self.torque_limit.copy()
        limits[robots, 0] = torque_limit
        saturated = self.saturated.copy()
        saturated[robots] = False
        self.torque_limit, self.saturated = limits, saturated
        self._correction[robots] = 0.0

    def advance(
        self, command: Array, belt_speed: Array, torque: Array, dt: float
    ) -> tuple[Array, Array, Array]:
        """One control step.

        Args:
            command: (n, 3) m/s, belt speeds asked.
            belt_speed: (n, 3) m/s, as they are.
            torque: (n, 3) N m, what the motors gave the modules' shafts last.
            dt: s since the last call.

        Returns:
            Set points of the m speed servos (n, m) m/s, and the least and largest force (n, m) N
            that each may give, all at the belts.
        """
        drive, size = self.drive, self.drive.size
        wanted, speed = drive.motor_values(command), drive.motor_values(belt_speed)
        given = drive.motor_forces(torque) / size  # N m, of one robot.motor
        lowest, highest = self._torque_range(speed / self.lug_radius)
        saturated = (given <= 0.999 * lowest) | (given >= 0.999 * highest)
        # The integral grows only where the motor can follow (no wind-up in a stall).
        excess = given - _mean(given)
        droop = self.motor.speed_droop * self.lug_radius * excess
        error = wanted - droop - speed
        self._correction = np.where(
            saturated,
            self._correction,
            self._correction + error * dt / self.motor.speed_integral_time,
        )
        self.saturated = saturated if drive.direct else self._of_modules(saturated)
        force = size / self.lug_radius
        return wanted + self._correction, lowest * force, highest * force

    def _of_modules(self, motors: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether a motor of each module (n, 3) is among those of ``motors`` (n, m)."""
        return np.any(motors[:, :, None] & self._driven, axis=1)

    def _torque_range(self, speed: Array) -> tuple[Array, Array]:
        """Least and largest torque (n, m) N m at the shaft at ``speed`` rad/s.

        Driving, the torque-speed line and the limit hold as the maker states them, at the output
        shaft. Against its direction of turning the gears' losses help the motor twice: once for
        what it does not lose on the way out, and once for what it does lose on the way in.
        """
        motor = self.motor
        line = motor.stall_torque / motor.no_load_speed
        highest = _within(motor.stall_torque - line * speed, self.torque_limit)
        lowest = -_within(motor.stall_torque + line * speed, self.torque_limit)
        if motor.efficiency == 1:
            return lowest, highest
        braking = 1 / motor.efficiency**2
        return (
            np.where(speed > 0, lowest * braking, lowest),
            np.where(speed < 0, highest * braking, highest),
        )


def _mean(torque: Array) -> Array:
    """Mean (n, 1) over the motors, in one order of sums."""
    total = torque[:, :1]
    for i in range(1, torque.shape[1]):
        total = total + torque[:, i : i + 1]
    return total / torque.shape[1]


def _within(torque: Array, limit: Array) -> Array:
    """``torque`` cut to the range from 0 to ``limit``."""
    return np.minimum(np.maximum(torque, 0.0), limit)
