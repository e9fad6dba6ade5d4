"""The paper's controller: speeds set beforehand, begun and ended at marks, open loop (Sections V
and VI)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.aligner import Aligner, manoeuvres
from omnitrack_sim.control.guide import Guide, Place, angle_between
from omnitrack_sim.control.interface import Command, Observation, Settings
from omnitrack_sim.robot import MODULE_ANGLES, Robot
from omnitrack_sim.rotations import Array, cross, dot, unit
from omnitrack_sim.theory.kinematics import elbow_speeds

CRUISE, ALIGN, ELBOW, TEE_TURN, TEE_STRAIGHT = range(5)
_PHASES = {"elbow": ELBOW, "tee_turn": TEE_TURN, "tee_straight": TEE_STRAIGHT, None: CRUISE}
COMPLETE = np.radians(2.0)
"""A turn is complete when the robot's axis, in the plane of the bend, is this near to the way out
or past it."""


class PaperController:
    """Speeds by Eq. 20 in elbows; in tees modules on the inner side backward, the others forward,
    at cruise speed.

    theta5 is read when a turn begins and the speeds are kept until it is complete. Alignment before
    fittings is that of the default controller; the paper does it by hand.
    """

    phases: ClassVar[tuple[str, ...]] = ("cruise", "align", "elbow", "tee_turn", "tee_straight")

    def __init__(
        self, guide: Guide, robot: Robot, settings: Settings, roll: Array, period: float
    ) -> None:
        self.guide, self.robot, self.settings = guide, robot, settings
        n = len(settings.cruise_speed)
        self.aligner = Aligner(guide, robot, settings, roll, period)
        self.events = self.aligner.events
        self.resting = np.zeros(n, bool)
        self.turning = np.full(n, -1)  # (n,) passage whose turn is under way
        self.turned = np.full(n, -1)  # (n,) last passage whose turn is complete
        self.turn_speeds = np.zeros((n, 3))  # m/s, at the walls
        self._learn()

    def _learn(self) -> None:
        guide, passages = self.guide, self.guide.passages
        self.kind = np.array([_PHASES[m] for m in manoeuvres(guide)])  # (Q,)
        self.bend_radius = np.array(
            [np.nan if p is None else p.bend_radius for p in passages]
        )  # (Q,) m
        # (Q,) m, an opening's near edge or a bend's start
        self.mark = np.array([np.inf if p is None else p.mark for p in passages])
        way = guide.way_of
        longest = guide.lengths[way]
        self.way_in = guide.centreline.at(np.clip(guide.start, 0, longest), way)[
            1
        ]  # (Q, 3) tangents before the turns
        self.way_out = guide.centreline.at(np.clip(guide.end, 0, longest), way)[
            1
        ]  # (Q, 3) and behind them

    def begin_leg(self, robot: int, turned: bool) -> None:
        """See ``Controller``."""
        self._learn()
        self.aligner.begin_leg(robot, turned)
        self.turning[robot] = self.turned[robot] = -1

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        place = observation.place
        self.resting = self.aligner.step(observation)
        self._mark(place, observation.rotation[:, :, 2])
        turning = self.turning >= 0
        cruise = self.settings.cruise_speed[:, None]
        wall_speed = np.where(turning[:, None], self.turn_speeds, cruise)
        wall_speed = np.clip(
            wall_speed, -self.settings.speed_limit[:, None], self.settings.speed_limit[:, None]
        )
        belt_speed = np.where(
            self.resting[:, None], 0.0, wall_speed * self.aligner.belt_sign(observation.roll)
        )
        straight_over = (self.kind[place.passage] == TEE_STRAIGHT) & (
            self.aligner.nose_room(place) < 0
        )
        phase = np.where(
            turning, self.kind[self.turning], np.where(straight_over, TEE_STRAIGHT, CRUISE)
        )
        return Command(belt_speed, self.aligner.roll.copy(), np.where(self.resting, ALIGN, phase))

    def _mark(self, place: Place, axis: Array) -> None:
        """Begin turns whose mark the head has passed, end those that are complete."""
        head = place.distance + self.robot.length / 2
        new = (self.turning < 0) & (place.passage > self.turned) & self.guide.is_turn[place.passage]
        is_elbow = self.kind[place.passage] == ELBOW
        delay = np.where(is_elbow, self.settings.elbow_delay, self.settings.tee_trigger)
        begins = new & (head >= self.mark[place.passage] + delay) & ~self.resting
        self.turning = np.where(begins, place.passage, self.turning)
        if begins.any():
            self.turn_speeds = np.where(begins[:, None], self._speeds(place), self.turn_speeds)
        way_in, way_out = self.way_in[self.turning], self.way_out[self.turning]
        about = unit(cross(way_in, way_out))  # the bend's axis
        left = angle_between(way_in, way_out) - np.arctan2(
            dot(cross(way_in, axis), about), dot(way_in, axis)
        )
        complete = (self.turning >= 0) & ((left < COMPLETE) | (place.passage > self.turning))
        self.turned = np.where(complete, self.turning, self.turned)
        self.turning = np.where(complete, -1, self.turning)

    def _speeds(self, place: Place) -> Array:
        """Wall speeds (n, 3) m/s of the turn ahead, for theta5 as it is now."""
        speed = self.settings.cruise_speed
        bend_radius = np.nan_to_num(self.bend_radius[place.passage], nan=1.0)
        elbow = elbow_speeds(speed, place.theta5, bend_radius, self.guide.radius[place.passage])
        inner: NDArray[np.bool_] = np.cos(place.theta5[:, None] + np.array(MODULE_ANGLES)) > 0
        tee = np.where(inner, -1.0, 1.0) * speed[:, None]
        return np.where((self.kind[place.passage] == ELBOW)[:, None], elbow, tee)


class EqualController(PaperController):
    """All modules at cruise speed everywhere: what a robot without speed modulation does, the
    baseline of Eq. 20."""

    def _speeds(self, place: Place) -> Array:
        return np.repeat(self.settings.cruise_speed[:, None], 3, axis=1)
