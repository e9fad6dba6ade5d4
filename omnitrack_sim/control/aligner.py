"""Rolling the modules before a fitting: when to stop, what to ask for, when it is done. Shared by
all controllers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.alignment import (
    NO_MOTION_MARGIN,
    ROUNDING,
    Manoeuvre,
    Obstacle,
    RollPlan,
    Wish,
    agreed,
    no_motion_distance,
    orientation_error,
    plan_roll,
    preferred_theta5,
)
from omnitrack_sim.control.gear import SWAPPED
from omnitrack_sim.control.guide import Guide, Place
from omnitrack_sim.control.interface import Observation, Settings
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array
from omnitrack_sim.theory.kinematics import belt_sign
from omnitrack_sim.theory.singularity import safe_margin, sector_angle

ROLL_SETTLED = 0.02
"""Roll error at which a roll counts as done, rad."""
ALIGN_ATTEMPTS = 3
"""Rolls in a row before one fitting; slip while rolling makes the first one fall short."""
CLEARANCES = {
    np.radians(60.0): 0.0,
    np.radians(45.0): np.radians(90.0),
    NO_MOTION_MARGIN: np.radians(360.0),
}
"""Distances of the roll from the no-motion line, and the further roll, rad, that a robot puts up
with to have so much. Out of a branch 60 of 60 robots pass with 90 and 60 degrees, 58 with 40 and 11
with 30, where the track away from the wall touches and brakes; straight over a tee such a robot
falls into a branch that opens downward."""
WIDTH_DETOUR = np.radians(90.0)
"""Further roll, rad, that a robot puts up with to come into the next narrower range of ``AIMS``."""
CLEAR_ENOUGH = np.radians(45.0)
"""Distance of the roll from the no-motion line with which a robot that is oriented drives on,
rad."""
ROLL_PATIENCE = 1.0
"""Time beyond what a roll should take after which it is looked at as it is, s: the belts' grip may
hold a module off its target for good."""
NO_MOTION_BAND = 0.1
"""Size of cos(roll) below which the belts keep their direction: at the no-motion line its sign is
noise."""
AIMS: dict[Manoeuvre, tuple[float, ...]] = {
    "elbow": (0.5, 0.5, 1.0),
    "tee_turn": (0.5, 0.85, 1.0),
    "tee_straight": (0.25, 0.5, 1.0),
}
"""Parts of the safe margin that a roll aims at; the next one where the first has no roll clear of
the no-motion line.
Straight over a tee nearer is steadier: tilt up to 1.1 degrees from 6 degrees beside the best
orientation, 0.9 from the
best. In a tee turn it is not: dead on, both outer modules lose the wall at the same time
(docs/design-study.md)."""
WIDTHS = len(AIMS["elbow"])


def manoeuvres(guide: Guide) -> tuple[Manoeuvre | None, ...]:
    """What each passage of the routes asks for; None after the last one of a route."""
    return tuple(None if p is None else p.manoeuvre for p in guide.passages)


class Aligner:
    """Roll commands of n robots. ``roll`` (n, 3) rad is what the rotary motors are asked.

    Fittings that follow each other with less room between than the robot needs to stand in are
    prepared for together,
    before the first of them: a tee turn comes first, then a tee to be passed straight, then elbows.
    What cannot be met beforehand is made up for on the way.
    """

    def __init__(
        self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float
    ) -> None:
        self.guide, self.robot, self.settings, self.period = guide, robot, settings, period
        n = len(settings.cruise_speed)
        self.roll = np.array(roll, float)  # (n, 3) rad
        self.roll_target = self.roll.copy()
        self.attempts = np.zeros(n, int)
        self.deadline = np.full(n, np.inf)  # s, when a roll is looked at as it is
        self.events: list[list[str]] = [[] for _ in range(n)]
        self._belt_sign = belt_sign(self.roll)  # (n, 3)
        self._learn()
        everything = np.iinfo(np.intp).max
        self.aligned = np.where(
            settings.align, guide.first[guide.way], everything
        )  # (n,) passages dealt with so far

    def _learn(self) -> None:
        """What each passage wants of theta5, together with those that follow it closely."""
        guide, asked = self.guide, manoeuvres(self.guide)
        given, reach = self.settings.safe_margin, self.settings.reach
        derived = safe_margin(sector_angle(guide.radius, reach[:, None]))  # (n, Q) rad
        margin = np.where(np.isnan(given)[:, None], derived, given[:, None])
        self.best = np.zeros((WIDTHS, *margin.shape))  # (widths, n, Q) rad
        self.aim = np.zeros(self.best.shape)  # (widths, n, Q) rad, half-width of the range about it
        self.makes_do = np.array(
            [m in ("elbow", "tee_straight") for m in asked]
        )  # (Q,) goes with any orientation
        for q, manoeuvre in enumerate(asked):
            if manoeuvre is None:
                continue
            together: list[tuple[int, Manoeuvre]] = [(q, manoeuvre)]
            for p in range(q + 1, len(asked)):
                following = asked[p]
                if (
                    following is None
                    or self._room_between(p - 1) >= self.robot.length + self.robot.standing_room
                ):
                    break
                together.append((p, following))
            together.sort(key=lambda passage: _FIRST_COMES.index(passage[1]))
            centres = [
                preferred_theta5(wanted) - self._turned_between(q, p) for p, wanted in together
            ]
            for i in range(WIDTHS):
                widths = [AIMS[wanted][i] * margin[:, p] for p, wanted in together]
                self.best[i, :, q], self.aim[i, :, q] = agreed(list(map(Wish, centres, widths)))

    def _room_between(self, passage: int) -> float:
        """Length, m, of the way from the end of a passage to the start of the next one."""
        return float(self.guide.start[passage + 1] - self.guide.end[passage])

    def _turned_between(self, first: int, later: int) -> float:
        """How much larger, rad, theta5 is at a ``later`` passage than at the ``first`` without
        twist."""
        angles = []
        for q in (first, later):
            found = self.guide.passages[q]
            assert found is not None
            frame = self.guide.centreline.frame(np.array([found.s_enter]), self.guide.way_of[[q]])[
                0
            ]
            x, y, _ = self.guide.directions[q] @ frame
            angles.append(np.arctan2(y, x))
        return float(angles[0] - angles[1])

    def nose_room(self, place: Place) -> Array:
        """Room (n,) m from the robot's nose to the next fitting's bend or opening; infinite after
        the last one."""
        return self.guide.start[place.passage] - place.distance - self.robot.length / 2

    def belt_sign(self, roll: Array) -> Array:
        """Direction (n, 3) in which the belts drive forward at the measured ``roll`` (n, 3) rad."""
        clear = np.abs(np.cos(roll)) > NO_MOTION_BAND
        self._belt_sign = np.where(clear, belt_sign(roll), self._belt_sign)
        return self._belt_sign

    def begin_leg(self, robot: int, turned: bool) -> None:
        """See ``Controller``."""
        self._learn()
        if turned:
            self.roll[robot] = -self.roll[robot, SWAPPED]
            self.roll_target[robot] = -self.roll_target[robot, SWAPPED]
            self._belt_sign[robot] = self._belt_sign[robot, SWAPPED]
        self.attempts[robot], self.deadline[robot] = 0, np.inf
        if self.settings.align[robot]:
            self.aligned[robot] = self.guide.first[self.guide.way[robot]]

    def align_again(self, robots: NDArray[np.bool_], passage: NDArray[np.intp]) -> None:
        """Forget that ``robots`` (n,) have been aligned for their ``passage`` (n,)."""
        again = robots & self.settings.align
        self.aligned = np.where(again, np.minimum(self.aligned, passage), self.aligned)

    def step(self, observation: Observation) -> NDArray[np.bool_]:
        """Which robots (n,) stand still to roll; plans a roll where one is due, and moves ``roll``
        on."""
        standing = self._stand(observation)
        step = self.robot.roll_rate * self.period
        self.roll += np.clip(self.roll_target - self.roll, -step, step)
        return standing

    def _stand(self, observation: Observation) -> NDArray[np.bool_]:
        place = observation.place
        room = self.nose_room(place)
        due = (self.aligned <= place.passage) & (room <= self.robot.standing_room)
        if not due.any():
            return due
        rows = np.arange(len(due))
        new = due & np.isinf(self.deadline)
        self.deadline = np.where(new, observation.time + ROLL_PATIENCE, self.deadline)
        settled = np.abs(observation.roll - self.roll_target).max(axis=-1) < ROLL_SETTLED
        # The last range is the widest.
        best, width = self.best[-1, rows, place.passage], self.aim[-1, rows, place.passage]
        oriented = np.abs(orientation_error(place.theta5, best)) <= width + ROUNDING
        off_the_line = (
            no_motion_distance(observation.roll).min(axis=-1) >= CLEAR_ENOUGH - ROLL_SETTLED
        )
        # With the nose inside, a fitting that goes with any orientation is not worth a stop.
        inside = (room < 0) & self.makes_do[place.passage]
        decide = due & (settled | (observation.time > self.deadline))
        finished = decide & (
            ((oriented | inside) & off_the_line) | (self.attempts >= ALIGN_ATTEMPTS)
        )
        self.aligned = np.where(finished, place.passage + 1, self.aligned)
        self.attempts = np.where(finished, 0, self.attempts)
        self.deadline = np.where(finished, np.inf, self.deadline)
        again = decide & ~finished
        if again.any():
            self._plan(np.flatnonzero(again), observation)
        return due & ~finished

    def _plan(self, robots: NDArray[np.intp], observation: Observation) -> None:
        """Plan a roll for each of ``robots`` (m,) and note it; those without a plan drive on as
        they are."""
        place, roll = observation.place, self.roll_target[robots, 0]
        theta5, passage = place.theta5[robots], place.passage[robots]
        ratio = self.robot.lug_radius / self.guide.radius[passage]
        best, aims = self.best[:, robots, passage], self.aim[:, robots, passage]  # (widths, m) rad
        plan, least = None, np.full(len(robots), np.inf)
        for clearance, detour in CLEARANCES.items():
            for width, (centre, aim) in enumerate(zip(best, aims, strict=True)):
                other = plan_roll(theta5, roll, centre, aim, ratio, no_motion_margin=clearance)
                cost = np.abs(other.change) + detour + width * WIDTH_DETOUR
                cost = np.where(other.exists, cost, np.inf)
                plan = other if plan is None else other.where(cost < least, plan)
                least = np.minimum(cost, least)
        assert plan is not None
        self.roll_target[robots] += plan.change[:, None]
        rolls = np.abs(plan.change) > ROLL_SETTLED
        self.attempts[robots] = np.where(rolls, self.attempts[robots] + 1, ALIGN_ATTEMPTS)
        rolling = np.abs(plan.change) / self.robot.roll_rate
        self.deadline[robots] = observation.time[robots] + rolling + ROLL_PATIENCE
        for i, robot in enumerate(robots):
            if plan.exists[i] and not rolls[i]:
                continue
            fitting = self.guide.name_of(int(place.passage[robot]))
            self.events[robot].append(
                f"{observation.time[robot]:.2f} s, before {fitting}: {_told(plan, i, theta5[i])}"
            )


_FIRST_COMES: tuple[Manoeuvre, ...] = ("tee_turn", "tee_straight", "elbow")


def _told(plan: RollPlan, i: int, theta5: float) -> str:
    """One plan in words."""
    if not plan.exists[i]:
        return (
            f"theta5 {np.degrees(theta5):.1f} deg, not aligned: "
            f"{Obstacle(int(plan.obstacle[i])).text}"
        )
    return (
        f"rolls the modules by {np.degrees(plan.change[i]):.1f} deg, theta5 from "
        f"{np.degrees(theta5):.1f} to "
        f"{np.degrees(plan.theta5[i]):.1f} deg"
    )
