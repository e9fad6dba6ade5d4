"""The default controller: track the centreline through the inverse Jacobian, align before fittings."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.alignment import (
    NO_MOTION_MARGIN,
    Manoeuvre,
    Obstacle,
    RollPlan,
    no_motion_distance,
    orientation_error,
    plan_roll,
    preferred_theta5,
)
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
AIM = 0.5
"""Part of the safe margin that a roll aims at first; the rest takes up slip while rolling. Of 96 random tee turns from
any orientation 94 pass with 0.5 and 92 with 0.8; all that fail have less preload than the tee asks for."""
_MANOEUVRES: dict[int, Manoeuvre] = {ELBOW: "elbow", TEE_TURN: "tee_turn", TEE_STRAIGHT: "tee_straight"}


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
        self.best = np.array([*(preferred_theta5(_MANOEUVRES[k]) for k in kinds), 0.0])  # (P + 1,) rad
        self.roll = np.array(roll, float)  # (n, 3) rad, what the rotary motors are asked
        self.roll_target = self.roll.copy()
        self.aligned = np.where(settings.align, 0, len(kinds) + 1)  # (n,) passages dealt with so far
        self.attempts = np.zeros(n, int)
        self.resting = np.zeros(n, bool)
        self.events: list[list[str]] = [[] for _ in range(n)]
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
        oriented = np.abs(orientation_error(place.theta5, best)) <= margin
        off_the_line = no_motion_distance(observation.roll).min(axis=-1) >= NO_MOTION_MARGIN - ROLL_SETTLED
        safe = oriented & off_the_line
        decide = due & settled
        finished = decide & (safe | (self.attempts >= ALIGN_ATTEMPTS))
        self.aligned = np.where(finished, place.passage + 1, self.aligned)
        self.attempts = np.where(finished, 0, self.attempts)
        again = decide & ~finished
        if again.any():
            self._roll(np.flatnonzero(again), observation)
        return due & ~finished

    def _roll(self, robots: NDArray[np.intp], observation: Observation) -> None:
        """Plan a roll for each of ``robots`` (m,) and note it; those without a plan drive on as they are."""
        place, roll = observation.place, self.roll_target[robots, 0]
        theta5, best = place.theta5[robots], self.best[place.passage[robots]]
        margin = self.settings.safe_margin[robots]
        plan = plan_roll(theta5, roll, best, AIM * margin, self.radius_ratio)
        if not plan.exists.all():  # the whole margin is better than nothing
            wide = plan_roll(theta5, roll, best, margin, self.radius_ratio)
            plan = wide.where(~plan.exists, plan)
        self.roll_target[robots] += plan.change[:, None]
        self.attempts[robots] = np.where(plan.exists, self.attempts[robots] + 1, ALIGN_ATTEMPTS)
        for i, robot in enumerate(robots):
            fitting = self.guide.name_of(int(place.passage[robot]))
            self.events[robot].append(f"{observation.time[robot]:.2f} s, before {fitting}: {_told(plan, i, theta5[i])}")


def _told(plan: RollPlan, i: int, theta5: float) -> str:
    """One plan in words."""
    if not plan.exists[i]:
        return f"theta5 {np.degrees(theta5):.1f} deg, not aligned: {Obstacle(int(plan.obstacle[i])).text}"
    return (
        f"rolls the modules by {np.degrees(plan.change[i]):.1f} deg, theta5 from {np.degrees(theta5):.1f} to "
        f"{np.degrees(plan.theta5[i]):.1f} deg"
    )
