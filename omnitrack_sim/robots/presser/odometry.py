"""Odometry of the wheeled wall-presser: encoders of six wheels, and the travel of three arms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.control import Actuation
from omnitrack_sim.robots.odometry import (
    BodyReadings,
    Limbs,
    LookAround,
    Motion,
    Odometry,
    rotation_by_sides,
)
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.sensor import State

if TYPE_CHECKING:
    from omnitrack_sim.robots.presser import Presser

ARMS = np.array([2 * math.pi / 3 * k for k in range(3)])
"""Angles of the arms about the robot's axis, rad."""
STOP_MARGIN = 0.0005
"""Distance from its outer stop, m, at which an arm may touch no wall: more than its reading errs
by."""
MAX_ARM_SPREAD = 0.15
"""Reject the bore if the places of the arms differ by more than this, in nominal radii: one of them
may hang free."""
TREAD = np.radians([-24.0, -12.0, 0.0, 12.0, 24.0])
"""Angles of the points of a tyre at which it may touch a wall, from its outermost one, rad: between
two of them the tyre stands out by 0.1 mm."""


class WheelOdometry(Odometry):
    """What wheels and arms tell; see ``Odometry``.

    Args:
        robot: shared by all.
    """

    robot: Presser

    def __init__(self, robot: Presser) -> None:
        super().__init__(robot)
        self.surface_radius = robot.wheel_radius

    def surfaces(self, state: State) -> Array:
        """See ``Odometry``: of the wheels, in the order of the actuators."""
        return self.surface_radius * state.qpos.take(self._wheels, axis=1)

    def arms(self, state: State) -> Array:
        """See ``Odometry``: the arms' places in their guides."""
        return state.qpos.take(self._guides, axis=1)

    def torques(self, state: State) -> Array:
        """See ``Odometry``: of the wheels."""
        return state["actuator_force"]

    def torque_limit(self, robot: Robot) -> float:
        """See ``Odometry``."""
        return robot.torque_limit  # type: ignore[attr-defined]

    @cached_property
    def _wheels(self) -> NDArray[np.intp]:
        """Columns of the wheels in ``qpos``."""
        joints = self.robot.joints
        return np.array([joints[f"{end}_{k}"].start for end in ("front", "rear") for k in range(3)])

    @cached_property
    def _guides(self) -> NDArray[np.intp]:
        """Columns of the arms in ``qpos``."""
        return np.array([self.robot.joints[f"guide_{k}"].start for k in range(3)])

    def motion(self, body: BodyReadings) -> Motion:
        """See ``Odometry``: both wheels of an arm run alike."""
        of_arm = body.travel.reshape(-1, 2, 3).mean(axis=1)
        rotation = rotation_by_sides(of_arm, ARMS, self.robot.bore / 2)
        std = np.tile([0.0, 0.0, math.inf], (len(rotation), 1))
        return Motion(of_arm.mean(axis=1), np.zeros(len(of_arm)), rotation, std)

    @property
    def _axle(self) -> float:
        """Distance of the wheels' axles from the robot's axis, m, where the arms are at 0.

        A tyre touches the bore with its two edges.
        """
        robot = self.robot
        return math.sqrt(robot.bore**2 / 4 - robot.tyre_width**2 / 4) - robot.wheel_radius

    def limbs(self, body: BodyReadings) -> Limbs:
        """See ``Odometry``: an arm comes out until one of its tyres touches."""
        robot = self.robot
        radial, axial = np.cos(TREAD) * robot.wheel_radius, np.sin(TREAD) * robot.wheel_radius
        ends, edges = np.array([-0.5, 0.5]) * robot.wheelbase, np.array([-0.5, 0.5])
        out, along, across = (
            each.ravel()
            for each in np.broadcast_arrays(
                radial[:, None, None],
                axial[:, None, None] + ends[:, None],
                edges * robot.tyre_width,
            )
        )
        out = self._axle + body.arm[:, :, None] + out  # (n, 3, p)
        x, y = np.cos(ARMS)[:, None], np.sin(ARMS)[:, None]
        points = [out * x - across * y, out * y + across * x, np.broadcast_to(along, out.shape)]
        return Limbs(np.stack(points, axis=-1), body.arm < robot.travel_out - STOP_MARGIN)

    def bore(self, body: BodyReadings) -> Array:
        """See ``Odometry``: by the arms; not a number where one of them may not touch."""
        robot = self.robot
        free = np.ptp(body.arm, axis=1) > MAX_ARM_SPREAD * robot.bore / 2
        tread = self._axle + robot.wheel_radius + body.arm.mean(axis=1)
        return np.where(free, np.nan, 2 * np.hypot(tread, robot.tyre_width / 2))

    def observed(self, body: BodyReadings, period: float) -> Mapping[str, Array]:
        """See ``Odometry``: speeds and torques of the wheels."""
        speed = body.travel / (period * self.surface_radius)
        return {"actuator_velocity": speed, "actuator_force": body.torque}

    def look_around(self, command: Actuation, order: LookAround) -> Actuation:
        """See ``Odometry``: all wheels creep alike."""
        speed = (order.gear * order.speed)[:, None] / self.surface_radius
        return command._replace(ctrl=np.where(order.robots[:, None], speed, command.ctrl))
