"""The default controller: track the centreline through the inverse Jacobian, align before fittings."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from omnitrack_sim.control.alignment import orientation_error, plan_roll
from omnitrack_sim.control.guide import Guide, Place
from omnitrack_sim.control.interface import Command, Observation, Settings
from omnitrack_sim.control.tracking import tracking_speeds, wanted_rotation
from omnitrack_sim.frames import Array
from omnitrack_sim.kinematics import belt_sign
from omnitrack_sim.robot import Robot

CRUISE, ALIGN, ELBOW, TEE_TURN, TEE_STRAIGHT = range(5)
STOP_BEFORE = 0.02
"""Room between the robot's nose and the fitting's bend or opening when it stops to align, m."""
ROLL_SETTLED = 0.02
"""Roll error at which a roll counts as done, rad."""
ALIGN_ATTEMPTS = 3
"""Rolls in a row before one fitting; slip while rolling makes the first one fall short."""
NO_MOTION_BAND = 0.1
"""Size of cos(roll) below which the belts keep their direction: at the no-motion line its sign is noise."""
RATE_GAIN = np.array([0.0, 0.0, 2.5, 5.0, 0.0])
"""Rotation asked in addition, per rad/s that the rotation is too slow or too fast, by phase. In a tee, where the inner
module has lost the wall, the springs can turn the robot over within 0.2 s; in an elbow the term keeps it centred."""
RATE_FILTER = 0.005
"""Time constant of the measured rotation rate, s: single lugs shake the robot."""
BESIDE = np.pi / 3
"""Best theta5 for going straight over a tee: modules on either side of the opening (Fig. 17)."""


class JacobianController:
    """Straights, elbows and tees with one law; stops and rolls the modules where theta5 is outside the safe margin."""

    phases: ClassVar[tuple[str, ...]] = ("cruise", "align", "elbow", "tee_turn", "tee_straight")

    def __init__(self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float) -> None:
        self.guide, self.robot, self.settings, self.period = guide, robot, settings, period
        n = len(settings.cruise_speed)
        pipe_radius = guide.route.fittings[0].radius
        self.lever, self.radius_ratio = pipe_radius, robot.lug_radius / pipe_radius
        kinds = [ELBOW if p.kind == "elbow" else TEE_TURN if p.is_turn else TEE_STRAIGHT for p in guide.passages]
        self.kind = np.array([*kinds, CRUISE])  # (P + 1,) phase in each passage
        self.best = np.where(self.kind == TEE_STRAIGHT, BESIDE, 0.0)  # (P + 1,) rad
        self.roll = np.array(roll, float)  # (n, 3) rad, what the rotary motors are asked
        self.roll_target = self.roll.copy()
        self.aligned = np.where(settings.align, 0, len(kinds) + 1)  # (n,) passages dealt with so far
        self.attempts = np.zeros(n, int)
        self.resting = np.zeros(n, bool)
        self.angular_velocity = np.zeros((n, 3))  # rad/s, robot frame, smoothed
        self.belt_sign = belt_sign(self.roll)  # (n, 3)

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        place = observation.place
        aligning = self.resting = self._align(observation)
        smoothing = self.period / (RATE_FILTER + self.period)
        self.angular_velocity = self.angular_velocity + smoothing * (
            observation.angular_velocity - self.angular_velocity
        )
        self.roll += np.clip(
            self.roll_target - self.roll, -self.robot.roll_rate * self.period, self.robot.roll_rate * self.period
        )
        inside = self._nose_room(place) < 0
        phase = np.where(aligning, ALIGN, np.where(inside, self.kind[place.passage], CRUISE))
        s = self.settings
        wanted = wanted_rotation(
            self.guide.route.centreline, place, observation.rotation, s.gain, s.lookahead, s.rotation_limit
        )
        wall_speed = tracking_speeds(
            observation.rotation,
            self.angular_velocity,
            RATE_GAIN[phase],
            wanted,
            s.cruise_speed,
            self.lever,
            s.speed_limit,
        )
        clear = np.abs(np.cos(observation.roll)) > NO_MOTION_BAND
        self.belt_sign = np.where(clear, belt_sign(observation.roll), self.belt_sign)
        belt_speed = np.where(aligning[:, None], 0.0, wall_speed * self.belt_sign)
        return Command(belt_speed=belt_speed, roll=self.roll.copy(), phase=phase)

    def _nose_room(self, place: Place) -> Array:
        """Room (n,) m from the robot's nose to the next fitting's bend or opening; infinite after the last one."""
        return self.guide.start[place.passage] - place.distance - self.robot.length / 2

    def _align(self, observation: Observation) -> np.ndarray:
        """Which robots (n,) stand still to roll; plans a roll where one is due."""
        place = observation.place
        due = (self.aligned <= place.passage) & (self._nose_room(place) <= STOP_BEFORE)
        if not due.any():
            return due
        settled = np.abs(observation.roll - self.roll_target).max(axis=-1) < ROLL_SETTLED
        best = self.best[place.passage]
        margin = self.settings.safe_margin
        safe = np.abs(orientation_error(place.theta5, best)) <= margin
        decide = due & settled
        finished = decide & (safe | (self.attempts >= ALIGN_ATTEMPTS))
        self.aligned = np.where(finished, place.passage + 1, self.aligned)
        self.attempts = np.where(finished, 0, self.attempts)
        again = decide & ~finished
        if again.any():
            change, _ = plan_roll(place.theta5, self.roll_target[:, 0], best, margin, self.radius_ratio)
            self.roll_target = np.where(again[:, None], self.roll_target + change[:, None], self.roll_target)
            self.attempts = self.attempts + again
        return due & ~finished
