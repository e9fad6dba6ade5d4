"""Proprioception of n robots: encoders, arms, currents, gyro and accelerometer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, rotation_vector, set_rows
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.senses.draws import Keys, normal
from omnitrack_sim.senses.settings import SensingTable

AHEAD = 16
"""Control steps whose noise is drawn together."""


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
        table: ``[sensing]``.
        robot: shared by all.
        period: s between two control steps.
        lug_pitch: m, after which a belt's joint begins anew.
        n: number of robots.
    """

    def __init__(
        self,
        table: SensingTable,
        robot: Omnitrack,
        period: float,
        lug_pitch: float,
        n: int,
    ) -> None:
        self._table, self._period = table, period
        self._radius, self._pitch = robot.lug_radius, lug_pitch
        self._keys, self._number = np.zeros(n, np.uint64), np.zeros(n, int)
        self._torque, self._gravity = np.zeros((n, 1)), np.zeros((n, 3))
        self._wear, self._arm_bias, self._torque_bias = np.zeros((3, n, 3))
        self._bias, self._scale, self._force_bias = np.zeros((3, n, 3))
        self._belt_at, self._way, self._counted, self._velocity = np.zeros((4, n, 3))
        self._rotation = np.zeros((n, 3, 3))
        self._drawn, self._drawn_from = np.zeros((n, AHEAD, 5, 3)), np.zeros(n, int)

    def reset(
        self,
        rows: NDArray[np.intp],
        keys: Keys,
        gravity: Array,
        torque_limit: Array,
        state: State,
    ) -> None:
        """Begin anew for robots ``rows`` (k,).

        Args:
            rows: numbers of the robots.
            keys: (k,) of their random numbers.
            gravity: (k, 3) m/s², world frame.
            torque_limit: (k,) N m, of the motors.
            state: of all n robots at the start.
        """
        table, imu = self._table, self._table.imu
        set_rows(
            self,
            rows,
            _keys=keys,
            _gravity=gravity,
            _torque=torque_limit[:, None],
            # What is wrong with a robot's own sensors, for the whole run.
            _wear=1 + table.encoders.radius_error * normal(keys, "wear", 0, 3),
            _arm_bias=table.arms.bias * normal(keys, "arm bias", 0, 3),
            _torque_bias=table.current.bias * normal(keys, "torque bias", 0, 3),
            _bias=np.radians(imu.gyro_bias_deg) * normal(keys, "gyro bias", 0, 3),
            _scale=1 + imu.gyro_scale * normal(keys, "gyro scale", 0, 3),
            _force_bias=imu.force_bias * normal(keys, "force bias", 0, 3),
            # What the readings of the next moment are counted from.
            _number=0,
            _drawn_from=-AHEAD,
            _belt_at=state.qpos[rows[:, None], state.at.belts[:, 0]],
            _way=0.0,
            _counted=0.0,
            _rotation=state["rotation"][rows],
            _velocity=state.qvel[rows, :3],
        )

    def read(self, state: State) -> Felt:
        """The readings of this moment, once a control step."""
        self._number = self._number + 1
        table, period = self._table, self._period
        travel = self._travel(state)
        torque = state["motor_torque"] / self._torque + self._torque_bias
        noise = self._noise()
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

    def _noise(self) -> Array:
        """The draws (n, 5, 3) of this moment. Those of some moments ahead are drawn together, which
        takes a fraction of the time."""
        n, ahead = self._drawn.shape[:2]
        place = self._number - self._drawn_from
        if np.any((place < 0) | (place >= ahead)):
            self._drawn_from, place = self._number, np.zeros(n, int)
            numbers = self._number[:, None] + np.arange(ahead)
            drawn = normal(np.repeat(self._keys, ahead), "felt", numbers.ravel(), 15)
            self._drawn = drawn.reshape(self._drawn.shape)
        return self._drawn[np.arange(n), place]

    def _travel(self, state: State) -> Array:
        """Counts of the belts' encoders since the step before, as m."""
        at = state.qpos.take(state.at.belts[:, 0], axis=1)
        moved = at - self._belt_at
        self._belt_at = at
        # Chains are endless: the joint is moved back by whole pitches.
        moved = moved - self._pitch * np.rint(moved / self._pitch)
        self._way = self._way + moved * self._wear
        step = 2 * np.pi * self._radius / self._table.encoders.counts
        # The whole way is rounded, not each step of it, so that errors do not add up.
        counted = np.round(self._way / step) * step
        before, self._counted = self._counted, counted
        return counted - before

    def _turned(self, rotation: Array, walk: Array, noise: Array) -> Array:
        """Rotation by the gyro over the period, rad; ``walk`` and ``noise`` (n, 3): draws."""
        imu, period = self._table.imu, self._period
        true = rotation_vector(np.swapaxes(self._rotation, 1, 2) @ rotation)
        self._bias = self._bias + np.radians(imu.gyro_walk_deg) * np.sqrt(period) * walk
        # White noise added up over a time grows with its root.
        density = np.radians(imu.gyro_noise_deg) * np.sqrt(period)
        self._rotation = rotation
        return self._scale * true + self._bias * period + density * noise

    def _force(self, state: State, noise: Array) -> Array:
        """Mean of the accelerometer over the period, m/s²; ``noise`` (n, 3): draws."""
        imu, velocity = self._table.imu, state.qvel[:, :3].copy()
        before, self._velocity = self._velocity, velocity
        in_world = (velocity - before) / self._period - self._gravity
        in_robot = np.einsum("nij,ni->nj", state["rotation"], in_world)
        # A mean of white noise over a time falls with its root.
        density = imu.force_noise / np.sqrt(self._period)
        return in_robot + self._force_bias + density * noise
