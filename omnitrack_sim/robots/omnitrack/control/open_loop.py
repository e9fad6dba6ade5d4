"""The paper's controllers: speeds set beforehand, begun and ended at marks, open loop.

Sections V and VI.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array, angle_between, cross, dot, unit
from omnitrack_sim.base.table import Table, Unit
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES
from omnitrack_sim.robots.omnitrack.control.alignment import Aligner, AlignmentTable
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.control.jacobian import LegWatch
from omnitrack_sim.robots.omnitrack.control.orientation import manoeuvres
from omnitrack_sim.robots.omnitrack.kinematics import elbow_speeds

CRUISE, ALIGN, ELBOW, TEE_TURN, TEE_STRAIGHT = range(5)
_PHASES = {"elbow": ELBOW, "tee_turn": TEE_TURN, "tee_straight": TEE_STRAIGHT, None: CRUISE}


class PaperTable(Table):
    """``[control.parameters]`` of the controllers ``paper``, ``equal`` and ``eq20``.

    Lengths are for D = 160 mm and grow with the robot's bore.
    """

    elbow_delay: Annotated[float, Field(ge=0, le=10), Unit("m")] = 0.0
    """Distance of the head past the bend's start when an elbow begins; 0.0726 begins it with the
    centre at the bend."""
    tee_trigger: Annotated[float, Field(ge=-10, le=10), Unit("m")] = 0.04
    """Distance of the head past the near edge of a tee's opening when a turn begins; half a pipe
    radius is published."""
    complete_deg: Annotated[float, Field(ge=0, le=90)] = 2.0
    """A turn is complete when the robot's axis, in the plane of the bend, is this near to the way
    out, or past it."""
    alignment: AlignmentTable = AlignmentTable()


class PaperController:
    """Sets speeds at marks: by Eq. 20 in elbows, in tees by the side that a module is on.

    In a tee modules on the inner side run backward, the others forward, at cruise speed.

    theta5 is read when a turn begins and the speeds are kept until it is complete. Alignment before
    fittings is that of the default controller; the paper does it by hand.
    """

    phases: ClassVar[tuple[str, ...]] = ("cruise", "align", "elbow", "tee_turn", "tee_straight")
    Parameters: ClassVar[type[Table]] = PaperTable

    def __init__(self, setup: ControlSetup) -> None:
        self.aligner = Aligner(setup, "alignment")
        self._legs = LegWatch(setup)
        # (n,) passage whose turn is under way, and the last one whose turn is complete
        self.turning, self.turned = np.zeros((2, setup.n), int)
        self.turn_speeds = np.zeros((setup.n, 3))  # m/s, at the walls
        self.reset(np.arange(setup.n), setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Reset robots ``rows``; ``setup`` is that of all robots."""
        self.aligner.reset(rows, setup)
        self._legs.reset(rows, setup)
        self.routes, self.robot, self.settings = setup.routes, setup.robot, setup.settings
        own = setup.robot.own_length
        self._elbow_delay, self._tee_trigger = (
            own(setup.each(key)) for key in ("elbow_delay", "tee_trigger")
        )  # (n,) m
        self._complete = np.radians(setup.each("complete_deg"))
        self.turning[rows] = self.turned[rows] = -1
        self.turn_speeds[rows] = 0.0
        self._build_tables()

    def _build_tables(self) -> None:
        """Look up phase, mark and tangents of each passage of the routes."""
        routes, passages = self.routes, self.routes.passages
        self.kind = np.array([_PHASES[m] for m in manoeuvres(routes)])  # (Q,)
        # (Q,) m, an opening's near edge or a bend's start
        self.mark = np.array([np.inf if p is None else p.mark for p in passages])
        way = routes.route_of
        longest = routes.lengths[way]
        # A passage without a bend has no finite start and end; tangents are looked up on the route.
        start, end = np.clip(routes.start, 0, longest), np.clip(routes.end, 0, longest)
        self.way_in = routes.centreline.at(start, way)[1]  # (Q, 3) tangents before the turns
        self.way_out = routes.centreline.at(end, way)[1]  # (Q, 3) and behind them

    def _follow_legs(self, observation: Observation) -> None:
        """Prepare robots that have been sent onto another way."""
        changes = self._legs.changes(observation)
        if self._legs.grown:
            self._build_tables()
            self.aligner.ranges.update()
        for robot, shift in self._legs.extended:
            self.aligner.extend_leg(robot, shift)
            # -1, which stands for no passage, has to stay.
            self.turning[robot] += shift * (self.turning[robot] >= 0)
            self.turned[robot] += shift * (self.turned[robot] >= 0)
        for robot, turned in changes:
            self.aligner.begin_leg(robot, turned, int(observation.location.route[robot]))
            self.turning[robot] = self.turned[robot] = -1

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        self._follow_legs(observation)
        location, s = observation.location, self.settings
        room = self.routes.nose_room(location, self.robot.length)
        resting, rolled = self.aligner.step(observation, room)
        self._mark(location, observation.rotation[:, :, 2], resting)
        turning = self.turning >= 0
        wall_speed = np.where(turning[:, None], self.turn_speeds, s.cruise_speed[:, None])
        # Eq. 20 may ask the outer modules for more than the belts are allowed.
        limit = s.speed_limit[:, None]
        wall_speed = np.minimum(np.maximum(wall_speed, -limit), limit)
        belt_sign = self.aligner.rolls.belt_sign(observation.roll)
        belt_speed = np.where(resting[:, None], 0.0, wall_speed * belt_sign)
        straight_over = (self.kind[location.passage] == TEE_STRAIGHT) & (room < 0)
        phase = np.where(straight_over, TEE_STRAIGHT, CRUISE)
        phase = np.where(turning, self.kind[self.turning], phase)
        phase = np.where(resting, ALIGN, phase)
        return Command(belt_speed, self.aligner.rolls.now.copy(), phase, resting, rolled)

    def _mark(self, location: Location, axis: Array, resting: NDArray[np.bool_]) -> None:
        """Begin turns whose mark the head has passed, end those that are complete."""
        # The paper's marks are passed by the head, half a length before the centre.
        head = location.distance + self.robot.length / 2
        new = (self.turning < 0) & (location.passage > self.turned)
        new &= self.routes.is_turn[location.passage]
        is_elbow = self.kind[location.passage] == ELBOW
        delay = np.where(is_elbow, self._elbow_delay, self._tee_trigger)
        begins = new & (head >= self.mark[location.passage] + delay) & ~resting
        self.turning = np.where(begins, location.passage, self.turning)
        if begins.any():
            speeds = self._speeds(location)
            self.turn_speeds = np.where(begins[:, None], speeds, self.turn_speeds)
        way_in, way_out = self.way_in[self.turning], self.way_out[self.turning]
        about = unit(cross(way_in, way_out))  # the bend's axis
        # Signed about the bend's axis: a turn that has gone too far is complete, too.
        turned = np.arctan2(dot(cross(way_in, axis), about), dot(way_in, axis))
        left = angle_between(way_in, way_out) - turned
        past = location.passage > self.turning
        complete = (self.turning >= 0) & ((left < self._complete) | past)
        self.turned = np.where(complete, self.turning, self.turned)
        self.turning = np.where(complete, -1, self.turning)

    def _speeds(self, location: Location) -> Array:
        """Wall speeds (n, 3) m/s of the turn ahead, for theta5 as it is now."""
        speed = self.settings.cruise_speed
        slower = self.settings.speed_in(self.routes.sharpness[location.passage])
        bend_radius = np.nan_to_num(self.routes.bend_radius[location.passage], nan=1.0)
        radius = self.routes.radius[location.passage]
        elbow = elbow_speeds(slower, location.theta5, bend_radius, radius)
        # The modules of the half that faces the branch, one or two of them.
        inner: NDArray[np.bool_] = np.cos(location.theta5[:, None] + np.array(MODULE_ANGLES)) > 0
        tee = np.where(inner, -1.0, 1.0) * speed[:, None]
        return np.where((self.kind[location.passage] == ELBOW)[:, None], elbow, tee)


class EqualController(PaperController):
    """All modules at cruise speed everywhere, without speed modulation: the baseline of Eq. 20."""

    def _speeds(self, location: Location) -> Array:  # noqa: ARG002 - as in turns
        return np.repeat(self.settings.cruise_speed[:, None], 3, axis=1)


class BendController(PaperController):
    """Eq. 20 in every turn: of a tee it takes the arc of the centreline for an elbow."""

    def _speeds(self, location: Location) -> Array:
        bend = np.nan_to_num(self.routes.bend_radius[location.passage], nan=1.0)
        radius = self.routes.radius[location.passage]
        speed = self.settings.speed_in(self.routes.sharpness[location.passage])
        return elbow_speeds(speed, location.theta5, bend, radius)
