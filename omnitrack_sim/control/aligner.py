"""Rolling the modules before a fitting: when to stop, what to ask for, when it is done. Shared by all controllers."""

from __future__ import annotations

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
from omnitrack_sim.control.interface import Observation, Settings
from omnitrack_sim.frames import Array
from omnitrack_sim.kinematics import belt_sign
from omnitrack_sim.robot import Robot

STOP_BEFORE = 0.02
"""Room between the robot's nose and the fitting's bend or opening when it stops to align, m."""
ROLL_SETTLED = 0.02
"""Roll error at which a roll counts as done, rad."""
ALIGN_ATTEMPTS = 3
"""Rolls in a row before one fitting; slip while rolling makes the first one fall short."""
NO_MOTION_BAND = 0.1
"""Size of cos(roll) below which the belts keep their direction: at the no-motion line its sign is noise."""
AIMS: dict[Manoeuvre, tuple[float, ...]] = {
    "elbow": (0.5, 1.0),
    "tee_turn": (0.5, 1.0),
    "tee_straight": (0.25, 0.5, 1.0),
}
"""Parts of the safe margin that a roll aims at; the next one where the first has no roll off the no-motion line.
Straight over a tee nearer is steadier: tilt up to 1.1 degrees from 6 degrees beside the best orientation, 0.9 from the
best. In a tee turn it is not: dead on, both outer modules lose the wall at the same time (docs/design-study.md)."""


def manoeuvres(guide: Guide) -> tuple[Manoeuvre, ...]:
    """What each passage of a route asks for."""
    return tuple("elbow" if p.kind == "elbow" else "tee_turn" if p.is_turn else "tee_straight" for p in guide.passages)


class Aligner:
    """Roll commands of n robots. ``roll`` (n, 3) rad is what the rotary motors are asked."""

    def __init__(self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float) -> None:
        self.guide, self.robot, self.settings, self.period = guide, robot, settings, period
        n = len(settings.cruise_speed)
        self.radius_ratio = robot.lug_radius / guide.route.fittings[0].radius
        self.best = np.array([*(preferred_theta5(m) for m in manoeuvres(guide)), 0.0])  # (P + 1,) rad
        tries = max(len(aims) for aims in AIMS.values())
        aims = [np.resize(AIMS[m] + (1.0,) * tries, tries) for m in manoeuvres(guide)]
        self.aims = np.array([*aims, np.ones(tries)])  # (P + 1, tries) of the safe margin
        self.roll = np.array(roll, float)  # (n, 3) rad
        self.roll_target = self.roll.copy()
        self.aligned = np.where(settings.align, 0, len(self.best))  # (n,) passages dealt with so far
        self.attempts = np.zeros(n, int)
        self.events: list[list[str]] = [[] for _ in range(n)]
        self._belt_sign = belt_sign(self.roll)  # (n, 3)

    def nose_room(self, place: Place) -> Array:
        """Room (n,) m from the robot's nose to the next fitting's bend or opening; infinite after the last one."""
        return self.guide.start[place.passage] - place.distance - self.robot.length / 2

    def belt_sign(self, roll: Array) -> Array:
        """Direction (n, 3) in which the belts drive forward at the measured ``roll`` (n, 3) rad."""
        clear = np.abs(np.cos(roll)) > NO_MOTION_BAND
        self._belt_sign = np.where(clear, belt_sign(roll), self._belt_sign)
        return self._belt_sign

    def align_again(self, robots: NDArray[np.bool_], passage: NDArray[np.intp]) -> None:
        """Forget that ``robots`` (n,) have been aligned for their ``passage`` (n,)."""
        again = robots & self.settings.align
        self.aligned = np.where(again, np.minimum(self.aligned, passage), self.aligned)

    def step(self, observation: Observation) -> NDArray[np.bool_]:
        """Which robots (n,) stand still to roll; plans a roll where one is due, and moves ``roll`` on."""
        standing = self._stand(observation)
        step = self.robot.roll_rate * self.period
        self.roll += np.clip(self.roll_target - self.roll, -step, step)
        return standing

    def _stand(self, observation: Observation) -> NDArray[np.bool_]:
        place = observation.place
        due = (self.aligned <= place.passage) & (self.nose_room(place) <= STOP_BEFORE)
        if not due.any():
            return due
        settled = np.abs(observation.roll - self.roll_target).max(axis=-1) < ROLL_SETTLED
        oriented = np.abs(orientation_error(place.theta5, self.best[place.passage])) <= self.settings.safe_margin
        off_the_line = no_motion_distance(observation.roll).min(axis=-1) >= NO_MOTION_MARGIN - ROLL_SETTLED
        decide = due & settled
        finished = decide & ((oriented & off_the_line) | (self.attempts >= ALIGN_ATTEMPTS))
        self.aligned = np.where(finished, place.passage + 1, self.aligned)
        self.attempts = np.where(finished, 0, self.attempts)
        again = decide & ~finished
        if again.any():
            self._plan(np.flatnonzero(again), observation)
        return due & ~finished

    def _plan(self, robots: NDArray[np.intp], observation: Observation) -> None:
        """Plan a roll for each of ``robots`` (m,) and note it; those without a plan drive on as they are."""
        place, roll = observation.place, self.roll_target[robots, 0]
        theta5, best = place.theta5[robots], self.best[place.passage[robots]]
        margin = self.settings.safe_margin[robots]
        aims = self.aims[place.passage[robots]].T * margin  # (tries, m) rad
        plan = plan_roll(theta5, roll, best, aims[0], self.radius_ratio)
        for aim in aims[1:]:
            if not plan.exists.all():
                plan = plan.where(plan.exists, plan_roll(theta5, roll, best, aim, self.radius_ratio))
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
