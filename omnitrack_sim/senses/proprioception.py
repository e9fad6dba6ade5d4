"""What n robots feel of themselves: encoders, arms, currents, gyro and accelerometer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, rotation_vector
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.senses.draws import Keys, normal
from omnitrack_sim.senses.sensor import State
from omnitrack_sim.senses.table import SensingTable


@dataclass(frozen=True)
class Felt:
    """Readings of n robots over one control period, robot frame.

    Attributes:
        time: (n,) s.
        travel: (n, 3) m, by which each belt has moved on.
        belt_speed: (n, 3) m/s, the same for a second.
        roll: (n, 3) rad. slide: (n, 3) m. motor_torque: (n, 3) N m.
        turned: (n, 3) rad, rotation vector of the chassis over the period, by the gyro.
        angular_velocity: (n, 3) rad/s, the same for a second.
        force: (n, 3) m/s², mean of the accelerometer: acceleration less gravity.
    """

    time: Array
    travel: Array
    belt_speed: Array
    roll: Array
    slide: Array
    motor_torque: Array
    turned: Array
    angular_velocity: Array
    force: Array


class Proprioception:
    """Reads the sensors of n robots at every control step.

    Args:
        table: ``[sensing]``. robot: shared by all. keys: (n,) of the robots' random numbers.
        gravity: (n, 3) m/s², world frame. torque_limit: (n,) N m, of the motors.
        period: s between two control steps. lug_pitch: m, after which a belt's joint begins anew.
        state: at the start.
    """

    def __init__(
        self,
        table: SensingTable,
        robot: Robot,
        keys: Keys,
        gravity: Array,
        torque_limit: Array,
        period: float,
        lug_pitch: float,
        state: State,
    ) -> None:
        self._table, self._keys, self._gravity, self._period = table, keys, gravity, period
        self._radius, self._pitch = robot.lug_radius, lug_pitch
        self._torque = torque_limit[:, None]
        self._belts: NDArray[np.intp] = state.at.belts[:, 0]
        once = (len(keys), -1)
        self._wear = 1 + table.encoders.radius_error * self._draw("wear", 0)
        self._arm_bias = table.arms.bias * self._draw("arm bias", 0)
        self._torque_bias = table.current.bias * self._draw("torque bias", 0)
        imu = table.imu
        self._bias = np.radians(imu.gyro_bias_deg) * self._draw("gyro bias", 0).reshape(once)
        self._scale = 1 + imu.gyro_scale * self._draw("gyro scale", 0)
        self._force_bias = imu.force_bias * self._draw("force bias", 0)
        self._belt_at = state.qpos.take(self._belts, axis=1)
        self._way, self._counted = np.zeros_like(self._belt_at), np.zeros_like(self._belt_at)
        self._rotation, self._velocity = state["rotation"], state.qvel[:, :3].copy()
        self._number = np.zeros(len(keys), int)

    def _draw(self, name: str, number: int) -> Array:
        return normal(self._keys, name, number, 3)

    def read(self, state: State) -> Felt:
        """The readings of this moment, once a control step."""
        self._number += 1
        table, number, period = self._table, self._number, self._period
        travel = self._travel(state)
        torque = state["motor_torque"] / self._torque + self._torque_bias
        noise = normal(self._keys, "felt", number, 15).reshape(-1, 5, 3)
        torque = torque + table.current.noise * noise[:, 0]
        turned = self._turned(state["rotation"], noise[:, 2], noise[:, 3])
        step = 2 * np.pi / table.encoders.counts
        slide = state["slide"] + self._arm_bias + table.arms.noise * noise[:, 1]
        return Felt(
            time=state["time"],
            travel=travel,
            belt_speed=travel / period,
            roll=np.round(state["roll"] / step) * step,
            slide=np.round(slide / table.arms.resolution) * table.arms.resolution,
            motor_torque=torque * self._torque,
            turned=turned,
            angular_velocity=turned / period,
            force=self._force(state, noise[:, 4]),
        )

    def _travel(self, state: State) -> Array:
        """Counts of the belts' encoders since the step before, as m."""
        at = state.qpos.take(self._belts, axis=1)
        moved = at - self._belt_at
        self._belt_at = at
        # Chains are endless: the joint is moved back by whole pitches.
        moved = moved - self._pitch * np.rint(moved / self._pitch)
        self._way = self._way + moved * self._wear
        step = 2 * np.pi * self._radius / self._table.encoders.counts
        counted = np.round(self._way / step) * step
        before, self._counted = self._counted, counted
        return counted - before

    def _turned(self, rotation: Array, walk: Array, noise: Array) -> Array:
        """What the gyro adds up over the period, rad; ``walk`` and ``noise`` (n, 3): draws."""
        imu, period = self._table.imu, self._period
        true = rotation_vector(np.swapaxes(self._rotation, 1, 2) @ rotation)
        self._bias = self._bias + np.radians(imu.gyro_walk_deg) * np.sqrt(period) * walk
        density = np.radians(imu.gyro_noise_deg) * np.sqrt(period)
        self._rotation = rotation
        return self._scale * true + self._bias * period + density * noise

    def _force(self, state: State, noise: Array) -> Array:
        """Mean of the accelerometer over the period, m/s²; ``noise`` (n, 3): draws."""
        imu, velocity = self._table.imu, state.qvel[:, :3].copy()
        before, self._velocity = self._velocity, velocity
        in_world = (velocity - before) / self._period - self._gravity
        in_robot = np.einsum("nij,ni->nj", state["rotation"], in_world)
        density = imu.force_noise / np.sqrt(self._period)
        return in_robot + self._force_bias + density * noise
