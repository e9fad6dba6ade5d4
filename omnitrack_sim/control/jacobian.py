"""The default controller: track the centreline through the inverse Jacobian, align before fittings, retry."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from omnitrack_sim.control.aligner import Aligner, manoeuvres
from omnitrack_sim.control.gear import TURNED
from omnitrack_sim.control.guide import Guide
from omnitrack_sim.control.interface import Command, Observation, Settings
from omnitrack_sim.control.recovery import Recovery
from omnitrack_sim.control.tracking import tracking_speeds, wanted_rotation
from omnitrack_sim.frames import Array
from omnitrack_sim.robot import Robot

CRUISE, ALIGN, ELBOW, TEE_TURN, TEE_STRAIGHT, BACK_OFF = range(6)
_PHASES = {"elbow": ELBOW, "tee_turn": TEE_TURN, "tee_straight": TEE_STRAIGHT, None: CRUISE}
RATE_GAIN = np.array([0.0, 0.0, 2.5, 5.0, 0.0, 0.0])
"""Rotation asked in addition, per rad/s that the rotation is too slow or too fast, by phase. In a tee, where the inner
module has lost the wall, the springs can turn the robot over within 0.2 s; in an elbow the term keeps it centred."""
MERGE_BACK_OFF_GAIN = 2.5
"""The same while backing off into the branch that a robot came out of: its tail has to find the way in. Of 10 robots
that back off there 7 pass in the end, and none without it; into a branch, backing off goes better without."""
RATE_FILTER = 0.005
"""Time constant of the measured rotation rate, s: single lugs shake the robot."""


class JacobianController:
    """Straights, elbows and tees with one law; stops and rolls the modules where theta5 is outside the safe margin.

    A robot that makes no headway in a turn backs off to where the turn began, aligns anew and tries again.
    """

    phases: ClassVar[tuple[str, ...]] = ("cruise", "align", "elbow", "tee_turn", "tee_straight", "back_off")

    def __init__(self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float) -> None:
        self.guide, self.settings, self.period = guide, settings, period
        self.aligner = Aligner(guide, robot, settings, roll, period)
        self.recovery = Recovery(guide, robot, settings, period)
        self.events = self.aligner.events
        self.resting = np.zeros(len(settings.cruise_speed), bool)
        self.angular_velocity = np.zeros((len(settings.cruise_speed), 3))  # rad/s, robot frame, smoothed
        self._learn()

    def _learn(self) -> None:
        self.kind = np.array([_PHASES[m] for m in manoeuvres(self.guide)])  # (Q,) phase in each passage

    def begin_leg(self, robot: int, turned: bool) -> None:
        """See ``Controller``."""
        self._learn()
        self.aligner.begin_leg(robot, turned)
        self.recovery.begin_leg(robot)
        if turned:
            self.angular_velocity[robot] *= TURNED

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        place, s = observation.place, self.settings
        backing = self.recovery.step(observation, self.resting, self.aligner, self.events)
        aligning = self.aligner.step(observation) & ~backing
        self.resting = aligning | backing
        smoothing = self.period / (RATE_FILTER + self.period)
        self.angular_velocity = self.angular_velocity + smoothing * (
            observation.angular_velocity - self.angular_velocity
        )
        inside = self.aligner.nose_room(place) < 0
        phase = np.where(inside, self.kind[place.passage], CRUISE)
        phase = np.where(backing, BACK_OFF, np.where(aligning, ALIGN, phase))
        direction = np.where(backing, -1.0, 1.0)
        wanted = wanted_rotation(
            self.guide, place, observation.rotation, s.gain, s.lookahead, s.rotation_limit, direction
        )
        wall_speed = tracking_speeds(
            observation.rotation,
            self.angular_velocity,
            np.where(backing & self.recovery.out_of_branch[place.passage], MERGE_BACK_OFF_GAIN, RATE_GAIN[phase]),
            wanted,
            direction * s.cruise_speed,
            self.guide.radius[place.passage],
            s.speed_limit,
        )
        belt_speed = np.where(aligning[:, None], 0.0, wall_speed * self.aligner.belt_sign(observation.roll))
        return Command(belt_speed=belt_speed, roll=self.aligner.roll.copy(), phase=phase)
