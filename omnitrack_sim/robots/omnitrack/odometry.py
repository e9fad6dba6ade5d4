"""Odometry of the omnidirectional robot: belts, rolling modules and arms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robots.odometry import BodyReadings, Limbs, LookAround, Motion, Odometry
from omnitrack_sim.robots.omnitrack.control.command import Command, mirror_readings
from omnitrack_sim.robots.omnitrack.kinematics import angular_velocity, belt_sign
from omnitrack_sim.robots.omnitrack.parameters import MODULE_ANGLES, MODULES, Omnitrack
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.robots.sensor import State

STOP_MARGIN = 0.0005
"""Distance from its outer stop, m, at which an arm may touch no wall: more than its reading errs
by."""
MAX_SLIDE_SPREAD = 0.15
"""Reject the bore if the slides of the arms differ by more than this, in nominal radii: beyond, an
arm may hang free, and the bore came out 8 mm too small; below, within 2.5 mm."""
ARMS = np.stack([np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES), np.zeros(MODULES)], axis=-1)
"""Directions (3, 3) of the arms, robot frame."""
ALONG = np.linspace(-0.5, 0.5, 5)
"""Points of a track at which it may touch a wall, as parts of its length from its middle."""


class TrackOdometry(Odometry):
    """What belts, modules and arms tell; see ``Odometry``.

    Args:
        robot: shared by all.
        rolls: its modules roll.
    """

    robot: Omnitrack

    def __init__(self, robot: Omnitrack, *, rolls: bool = True) -> None:
        super().__init__(robot)
        # Chains are endless: their joints are moved back by whole pitches.
        self.surface_radius, self.surface_period = robot.lug_radius, robot.lug_pitch
        self.roll_rate = robot.roll_rate if rolls else 0.0

    def surfaces(self, state: State) -> Array:
        """See ``Odometry``: of the belts."""
        return state.qpos.take(state.at.belts[:, 0], axis=1)

    def angles(self, state: State) -> Array:
        """See ``Odometry``: the modules' roll."""
        return state["roll"]

    def arms(self, state: State) -> Array:
        """See ``Odometry``: the arms' slides."""
        return state["slide"]

    def torques(self, state: State) -> Array:
        """See ``Odometry``: of the belts' motors."""
        return state["motor_torque"]

    def velocity(self, state: State) -> Array:
        """See ``Odometry``."""
        return state.qvel[:, :3]

    def torque_limit(self, robot: Robot) -> float:
        """See ``Odometry``."""
        assert isinstance(robot, Omnitrack)
        return robot.motor.max_torque

    def motion(self, body: BodyReadings) -> Motion:
        """See ``Odometry``: belts tell nothing of the rotation about the axis."""
        at_wall = body.travel * belt_sign(body.angle)
        rotation = angular_velocity(at_wall, 0.0, self.robot.nominal_pipe_radius)
        std = np.tile([0.0, 0.0, math.inf], (len(rotation), 1))
        return Motion(at_wall.mean(axis=1), np.zeros(len(at_wall)), rotation, std)

    def limbs(self, body: BodyReadings) -> Limbs:
        """See ``Odometry``: a track is straight, so it comes out until one point of it touches.

        In a bend that is an end, at the mouth of a branch what lies on the rim.
        """
        reach = self.robot.nominal_pipe_radius + body.arm  # (n, 3) m
        track = np.outer(self.robot.contact_length * ALONG, [0.0, 0.0, 1.0])
        points = reach[:, :, None, None] * ARMS[:, None] + track  # (n, 3, p, 3)
        return Limbs(points, body.arm < self.robot.slide_range[1] - STOP_MARGIN)

    def bore(self, body: BodyReadings) -> Array:
        """See ``Odometry``: by the arms; not a number where one of them may not touch."""
        radius = self.robot.nominal_pipe_radius
        free = np.ptp(body.arm, axis=1) > MAX_SLIDE_SPREAD * radius
        return np.where(free, np.nan, 2 * (radius + body.arm.mean(axis=1)))

    def observed(self, body: BodyReadings, period: float) -> Mapping[str, Array]:
        """See ``Odometry``."""
        belt_speed = body.travel / period
        return {
            "belt_speed": belt_speed,
            "wall_speed": belt_speed * belt_sign(body.angle),
            "motor_torque": body.torque,
            "slide": body.arm,
            "roll": body.angle,
        }

    def to_controller(
        self, readings: Mapping[str, Array], gear: NDArray[np.int_], channels: Iterable[Channel]
    ) -> Mapping[str, Array]:
        """See ``Odometry``: nose and tail are alike, so a robot in reverse sees itself mirrored."""
        return mirror_readings(readings, gear, channels)

    def look_around(self, command: Command, order: LookAround) -> Command:
        """See ``Odometry``: the belts creep, and the modules roll."""
        roll, each = order.readings["roll"], order.robots[:, None]
        speed, target = order.speed[:, None], order.turn[:, None]
        if self.roll_rate:
            target = order.begun["roll"] + target
        return command._replace(
            belt_speed=np.where(each, speed * belt_sign(roll), command.belt_speed),
            roll=np.where(each, target, roll if command.roll is None else command.roll),
        )
