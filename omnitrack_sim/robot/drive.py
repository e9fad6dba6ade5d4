"""The electrical side of the crawler motors: torque-speed line, torque limit, integral part of the
speed loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.robot.motors import Motor
from omnitrack_sim.rotations import Array


class Drive:
    """The electrical side of n robots' crawler motors: what the speed servo is asked and how much
    force it may give.

    The belt itself, with the reflected rotor inertia and the proportional speed loop, is part of
    the physics. Here are the integral part, the torque-speed line and the torque limit.

    Args:
        motor: the crawler motor.
        torque_limit: (n,) N m, overrides the motor's own.
        lug_radius: m, belt speed over shaft speed (Eq. 1).
        n: number of robots.
    """

    def __init__(self, motor: Motor, torque_limit: ArrayLike, lug_radius: float, n: int):
        self.motor, self.lug_radius = motor, lug_radius
        self.torque_limit = np.broadcast_to(np.asarray(torque_limit, float), (n,))[:, None]
        self.saturated = np.zeros((n, 3), bool)
        self._correction = np.zeros((n, 3))  # m/s, integral part

    def advance(
        self, command: Array, belt_speed: Array, torque: Array, dt: float
    ) -> tuple[Array, Array, Array]:
        """One control step.

        Args:
            command: (n, 3) m/s, belt speeds asked.
            belt_speed: (n, 3) m/s, as they are.
            torque: (n, 3) N m, what the motors gave last.
            dt: s since the last call.

        Returns:
            Set points of the speed servo (n, 3) m/s, and the least and largest belt force (n, 3) N
            it may give.
        """
        lowest, highest = self._torque_range(belt_speed / self.lug_radius)
        self.saturated = (torque <= 0.999 * lowest) | (torque >= 0.999 * highest)
        # The integral grows only where the motor can follow (no wind-up in a stall).
        error = command - belt_speed
        self._correction = np.where(
            self.saturated,
            self._correction,
            self._correction + error * dt / self.motor.servo_integral_time,
        )
        return command + self._correction, lowest / self.lug_radius, highest / self.lug_radius

    def _torque_range(self, speed: Array) -> tuple[Array, Array]:
        """Least and largest torque (n, 3) N m at ``speed`` rad/s: torque-speed line on the driving
        side, and limit."""
        line = self.motor.stall_torque / self.motor.no_load_speed
        highest = _within(self.motor.stall_torque - line * speed, self.torque_limit)
        lowest = -_within(self.motor.stall_torque + line * speed, self.torque_limit)
        return lowest, highest


def _within(torque: Array, limit: Array) -> Array:
    """``torque`` cut to the range from 0 to ``limit``."""
    return np.minimum(np.maximum(torque, 0.0), limit)
