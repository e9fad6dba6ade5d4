"""The default controller: track the centreline through the inverse Jacobian, align before fittings,
retry."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from omnitrack_sim.control.aligner import Aligner, manoeuvres
from omnitrack_sim.control.alignment import Manoeuvre
from omnitrack_sim.control.gear import TURNED
from omnitrack_sim.control.guide import Guide
from omnitrack_sim.control.interface import Command, Observation, Settings
from omnitrack_sim.control.recovery import Recovery
from omnitrack_sim.control.tracking import tracking_speeds, wanted_rotation
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array

CRUISE, ALIGN, ELBOW, TEE_TURN, TEE_STRAIGHT, BACK_OFF = range(6)
_PHASES = {"elbow": ELBOW, "tee_turn": TEE_TURN, "tee_straight": TEE_STRAIGHT, None: CRUISE}
RATE_GAIN: dict[Manoeuvre, float] = {"elbow": 2.5, "tee_turn": 5.0, "tee_straight": 2.5}
"""Rotation asked in addition, per rad/s that the rotation is too slow or too fast, in each
manoeuvre. In a tee, where the inner module has lost the wall, the springs can turn the robot over
in 0.2 s; in an elbow it keeps it centred."""
MERGE_RATE_GAIN = 2.5
"""The same out of a branch: 298 of 300 robots pass, 294 with 5, 273 with 8, 296 with 1.5 (friction
0.7 to 1.0, no
retry). Also while backing off into the branch again, where the tail has to find the way in: 7 of 10
robots pass in the end, and none without it. Backing off from elsewhere goes better without."""
CENTRING = 7.0
"""Slope back to the centreline per metre beside it, on straights, 1/m. Friction holds a robot that
leaves a bend beside
the centreline there: 10 mm take all load off a module, and over an opening the robot falls."""
RATE_FILTER = 0.005
"""Time constant of the measured rotation rate, s: single lugs shake the robot."""


class JacobianController:
    """Straights, elbows and tees with one law; stops and rolls the modules where theta5 is outside
    the safe margin.

    A robot that makes no headway in a turn backs off to where the turn began, aligns anew and tries
    again.
    """

    phases: ClassVar[tuple[str, ...]] = (
        "cruise",
        "align",
        "elbow",
        "tee_turn",
        "tee_straight",
        "back_off",
    )

    def __init__(
        self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float
    ) -> None:
        self.guide, self.settings, self.period = guide, settings, period
        self.aligner = Aligner(guide, robot, settings, roll, period)
        self.recovery = Recovery(guide, robot, settings, period)
        self.events = self.aligner.events
        self.resting = np.zeros(len(settings.cruise_speed), bool)
        self.angular_velocity = np.zeros(
            (len(settings.cruise_speed), 3)
        )  # rad/s, robot frame, smoothed
        self._learn()

    def _learn(self) -> None:
        asked = manoeuvres(self.guide)
        self.kind = np.array([_PHASES[m] for m in asked])  # (Q,) phase in each passage
        gains = np.array([0.0 if m is None else RATE_GAIN[m] for m in asked])
        self.rate_gain = np.where(self.guide.out_of_branch, MERGE_RATE_GAIN, gains)  # (Q,)

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
        damped = np.where(backing, self.guide.out_of_branch[place.passage], inside & ~aligning)
        phase = np.where(inside, self.kind[place.passage], CRUISE)
        phase = np.where(backing, BACK_OFF, np.where(aligning, ALIGN, phase))
        direction = np.where(backing, -1.0, 1.0)
        centring = np.where((phase == CRUISE) | (phase == TEE_STRAIGHT), CENTRING, 0.0)
        wanted = wanted_rotation(
            self.guide,
            place,
            observation.rotation,
            s.gain,
            s.lookahead,
            s.rotation_limit,
            direction,
            centring,
        )
        wall_speed = tracking_speeds(
            observation.rotation,
            self.angular_velocity,
            np.where(damped, self.rate_gain[place.passage], 0.0),
            wanted,
            direction * s.cruise_speed,
            self.guide.radius[place.passage],
            s.speed_limit,
        )
        belt_speed = np.where(
            aligning[:, None], 0.0, wall_speed * self.aligner.belt_sign(observation.roll)
        )
        return Command(belt_speed=belt_speed, roll=self.aligner.roll.copy(), phase=phase)
