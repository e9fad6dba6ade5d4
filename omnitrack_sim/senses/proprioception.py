"""Proprioception of n robots: encoders, arms, currents, gyro and accelerometer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, rotation_vector, set_rows
from omnitrack_sim.robots.odometry import BodyReadings, Odometry
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.sensor import State
from omnitrack_sim.senses.draws import Keys, normal
from omnitrack_sim.senses.settings import SensingTable

AHEAD = 16
"""Control steps whose noise is drawn together."""


@dataclass(frozen=True)
class ProprioceptiveReadings:
    """Readings of n robots over one control period, robot frame.

    Attributes:
        time: (n,) s.
        body: of encoders, arms and currents.
        rotation: (n, 3) rad, rotation vector of the chassis over the period, by the gyro.
        angular_velocity: (n, 3) rad/s, the same for a second.
        force: (n, 3) m/s², mean of the accelerometer: acceleration less gravity.
    """

    time: Array
    body: BodyReadings
    rotation: Array
    angular_velocity: Array
    force: Array


class Proprioception:
    """Reads the sensors in the bodies of n robots at every control step.

    Args:
        table: ``[sensing]``.
        odometry: what is measured.
        period: s between two control steps.
        state: of the n robots.
    """

    def __init__(
        self, table: SensingTable, odometry: Odometry, period: float, state: State
    ) -> None:
        self._table, self._odometry, self._period = table, odometry, period
        n = len(state["time"])
        self._keys, self._number = np.zeros(n, np.uint64), np.zeros(n, int)
        self._gravity = np.zeros((n, 3))
        self._wear: Array = np.zeros_like(odometry.surfaces(state))
        self._arm_bias: Array = np.zeros_like(odometry.arms(state))
        self._torque_bias: Array = np.zeros_like(odometry.torques(state))
        self._torque_limit = np.zeros((n, 1))
        self._bias, self._scale, self._force_bias, self._velocity = np.zeros((4, n, 3))
        self._position, self._way, self._counted = np.zeros((3, *self._wear.shape))
        self._rotation = np.zeros((n, 3, 3))
        # Of a moment: of each torque and arm, then of gyro walk, gyro and accelerometer.
        self._draws = self._torque_bias.shape[1] + self._arm_bias.shape[1] + 9
        self._drawn, self._drawn_from = np.zeros((n, AHEAD, self._draws)), np.zeros(n, int)

    def reset(
        self,
        rows: NDArray[np.intp],
        keys: Keys,
        gravity: Array,
        robots: Sequence[Robot],
        state: State,
    ) -> None:
        """Begin anew for robots ``rows`` (k,).

        Args:
            rows: numbers of the robots.
            keys: (k,) of their random numbers.
            gravity: (k, 3) m/s², world frame.
            robots: (k,) parameters of each.
            state: of all n robots at the start.
        """
        table, imu, odometry = self._table, self._table.imu, self._odometry
        surfaces, arms = self._wear.shape[1], self._arm_bias.shape[1]
        limit = np.array([odometry.torque_limit(robot) for robot in robots])
        set_rows(
            self,
            rows,
            _keys=keys,
            _gravity=gravity,
            _torque_limit=limit[:, None],
            # What is wrong with a robot's own sensors, for the whole run.
            _wear=1 + table.encoders.radius_error * normal(keys, "wear", 0, surfaces),
            _arm_bias=table.arms.bias * normal(keys, "arm bias", 0, arms),
            _torque_bias=table.current.bias
            * normal(keys, "torque bias", 0, self._torque_bias.shape[1]),
            _bias=np.radians(imu.gyro_bias_deg) * normal(keys, "gyro bias", 0, 3),
            _scale=1 + imu.gyro_scale * normal(keys, "gyro scale", 0, 3),
            _force_bias=imu.force_bias * normal(keys, "force bias", 0, 3),
            # What the readings of the next moment are counted from.
            _number=0,
            _drawn_from=-AHEAD,
            _position=odometry.surfaces(state)[rows],
            _way=0.0,
            _counted=0.0,
            _rotation=state["rotation"][rows],
            _velocity=odometry.velocity(state)[rows],
        )

    def at_rest(self, state: State) -> ProprioceptiveReadings:
        """Return readings without noise of robots that stand still."""
        odometry = self._odometry
        body = BodyReadings(
            np.zeros_like(self._wear),
            odometry.angles(state),
            odometry.arms(state),
            np.zeros_like(self._torque_bias),
        )
        still = np.zeros_like(self._gravity)
        return ProprioceptiveReadings(state["time"], body, still, still, still)

    def read(self, state: State) -> ProprioceptiveReadings:
        """Return the readings of this moment, once a control step."""
        self._number = self._number + 1
        motors, arms = self._torque_bias.shape[1], self._arm_bias.shape[1]
        of_torque, of_arm, *of_imu = np.split(
            self._noise(), np.cumsum([motors, arms, 3, 3]), axis=1
        )
        rotation = self._turned(state["rotation"], *of_imu[:2])
        return ProprioceptiveReadings(
            time=state["time"],
            body=self._body(state, of_torque, of_arm),
            rotation=rotation,
            angular_velocity=rotation / self._period,
            force=self._force(state, of_imu[2]),
        )

    def _body(self, state: State, of_torque: Array, of_arm: Array) -> BodyReadings:
        """Return the readings of encoders, arms and currents, with draws (n, m) and (n, b)."""
        table, odometry = self._table, self._odometry
        step = 2 * np.pi / table.encoders.counts
        arm = odometry.arms(state) + self._arm_bias + table.arms.noise * of_arm
        torque = odometry.torques(state) / self._torque_limit + self._torque_bias
        torque = torque + table.current.noise * of_torque
        return BodyReadings(
            travel=self._travel(state),
            angle=np.round(odometry.angles(state) / step) * step,
            arm=np.round(arm / table.arms.resolution) * table.arms.resolution,
            torque=torque * self._torque_limit,
        )

    def _noise(self) -> Array:
        """Return the draws (n, k) of this moment.

        Those of some moments ahead are drawn together, which takes a fraction of the time.
        """
        n, ahead = self._drawn.shape[:2]
        place = self._number - self._drawn_from
        if np.any((place < 0) | (place >= ahead)):
            self._drawn_from, place = self._number, np.zeros(n, int)
            numbers = self._number[:, None] + np.arange(ahead)
            drawn = normal(np.repeat(self._keys, ahead), "felt", numbers.ravel(), self._draws)
            self._drawn = drawn.reshape(self._drawn.shape)
        return self._drawn[np.arange(n), place]

    def _travel(self, state: State) -> Array:
        """Return the counts of the surfaces' encoders since the step before, as m."""
        odometry = self._odometry
        position, period = odometry.surfaces(state), odometry.surface_period
        moved = position - self._position
        self._position = position
        if np.isfinite(period):
            moved = moved - period * np.rint(moved / period)
        self._way = self._way + moved * self._wear
        step = 2 * np.pi * odometry.surface_radius / self._table.encoders.counts
        # The whole way is rounded, not each step of it, so that errors do not add up.
        counted = np.round(self._way / step) * step
        before, self._counted = self._counted, counted
        return counted - before

    def _turned(self, rotation: Array, walk: Array, noise: Array) -> Array:
        """Return the gyro's rotation over the period, rad; ``walk``, ``noise``: draws (n, 3)."""
        imu, period = self._table.imu, self._period
        true = rotation_vector(np.swapaxes(self._rotation, 1, 2) @ rotation)
        self._bias = self._bias + np.radians(imu.gyro_walk_deg) * np.sqrt(period) * walk
        # White noise added up over a time grows with its root.
        density = np.radians(imu.gyro_noise_deg) * np.sqrt(period)
        self._rotation = rotation
        return self._scale * true + self._bias * period + density * noise

    def _force(self, state: State, noise: Array) -> Array:
        """Return the mean of the accelerometer over the period, m/s²; ``noise`` (n, 3): draws."""
        imu, velocity = self._table.imu, self._odometry.velocity(state).copy()
        before, self._velocity = self._velocity, velocity
        in_world = (velocity - before) / self._period - self._gravity
        in_robot = np.einsum("nij,ni->nj", state["rotation"], in_world)
        # A mean of white noise over a time falls with its root.
        density = imu.force_noise / np.sqrt(self._period)
        return in_robot + self._force_bias + density * noise
