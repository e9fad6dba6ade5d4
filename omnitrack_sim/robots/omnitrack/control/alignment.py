"""Roll before a fitting: to a safe theta5, with the modules off the no-motion line.

``Aligner`` decides for each robot of a batch when to stop, which range to aim for and when the roll
is done; all controllers share it. ``RollSetPoints`` moves the modules. ``AlignmentTable`` holds
their numbers; ranges are those of ``orientation``, rolls those of ``roll_plan``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.pipes.fittings.base import Manoeuvre
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.events import Event
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.control.command import SWAPPED
from omnitrack_sim.robots.omnitrack.control.orientation import (
    BY_IMPORTANCE,
    OrientationRanges,
    orientation_error,
    preferred_theta5,
)
from omnitrack_sim.robots.omnitrack.control.roll_plan import (
    ROUNDING,
    Obstacle,
    RollPlan,
    no_motion_distance,
    plan_roll,
)
from omnitrack_sim.robots.omnitrack.events import NotAligned, Rolled
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign

Three = tuple[NotNegative, NotNegative, NotNegative]


class AlignmentTable(Table):
    """Conditions and ranges of the roll of the modules before a fitting."""

    roll_settled: Annotated[Part, Unit("rad")] = 0.02
    """Error of the roll at which it counts as done."""
    attempts: Annotated[int, Field(ge=1, le=1000), Unit("1")] = 3
    """Rolls in a row before one fitting; slip may make the first one fall short."""
    patience: Annotated[Part, Unit("s")] = 1.0
    """Time beyond the planned roll after which it counts as it is, for D = 160 mm. Friction
    may hold a module off its target."""
    # Distances of the roll from the no-motion line, the best first, and the further roll that a
    # robot puts up with to have so much. Out of a branch 60 of 60 robots pass with 90 and 60
    # degrees, 58 with 40 and 11 with 30, where the track away from the wall touches and brakes;
    # straight over a tee such a robot falls into a branch that opens downward.
    clearances_deg: Three = (60.0, 45.0, 30.0)
    """Distances of the roll from the no-motion line, the best first."""
    clearance_detours_deg: Three = (0.0, 90.0, 360.0)
    """Cost of each of these, as further roll."""
    aim_detour_deg: NotNegative = 90.0
    """Cost, as further roll, of falling back to the next wider range."""
    clear_enough_deg: Annotated[float, Field(ge=0, le=90)] = 45.0
    """Least distance of the roll from the no-motion line with which a robot of good theta5 does not
    roll."""
    no_motion_band: Annotated[float, Field(ge=0, le=1), Unit("1")] = 0.1
    """Size of cos(roll) below which the belts keep their direction, as its sign is noise."""
    # Fractions of the safe margin to aim for, tried in order. If every roll that reaches the first
    # ends near the no-motion line, the planner falls back to the next, wider one. Straight over a
    # tee nearer is steadier: tilt up to 1.1 degrees from 6 degrees beside the best orientation, 0.9
    # from the best.
    aim_elbow: Annotated[Three, Unit("1")] = (0.5, 0.5, 1.0)
    """Half-widths of the range for an elbow, the narrowest first, as parts of the safe margin."""
    aim_tee_turn: Annotated[Three, Unit("1")] = (0.5, 0.85, 1.0)
    """Likewise for a turn in a tee."""
    aim_tee_straight: Annotated[Three, Unit("1")] = (0.25, 0.5, 1.0)
    """Likewise straight over a tee."""
    # Out of a branch dead on is best: up a slippery run 33 of 40 pass, 29 from 5 or 10 degrees
    # beside (docs/studies/design-study.md).
    aside_tee_turn: Annotated[Three, Unit("1")] = (0.45, 0.4, 0.3)
    """Distance of each range for a turn into a branch from the best orientation, where both
    outer modules lose the wall at the same time. 0: none."""


def held_belt_sign(roll: Array, band: ArrayLike, before: Array) -> Array:
    """Direction (n, 3) in which the belts drive forward.

    Args:
        roll: (n, 3) rad, as measured.
        band: size of cos(roll) below which the direction stays what it was.
        before: (n, 3) direction of a moment ago.
    """
    cosine = np.cos(roll)
    return np.where(np.abs(cosine) > band, np.sign(cosine), before)


class RollSetPoints:
    """Set points of the rotary motors of n robots, which move at the largest roll rate.

    Args:
        setup: of the controller.
        path: of the ``AlignmentTable`` in its parameters.

    Attributes:
        now: (n, 3) rad, set points of this moment.
        target: (n, 3) rad, where they move to.
        waited_for: (n,) bool, robots that back off once they have rolled to their targets.
        tolerance: (n,) rad, error of the roll at which it counts as done.
        patience: (n,) s, after the end of a roll, until it counts as it is.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self._path = path
        self.now, self.target, self._belt_sign = np.zeros((3, setup.n, 3))
        self.waited_for = np.zeros(setup.n, bool)
        self._wait_until = np.full(setup.n, np.inf)  # s, at the latest
        self.reset(np.arange(setup.n), setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self.rate = setup.robot.roll_rate
        self._step = self.rate * setup.period  # rad
        self.tolerance = setup.each(f"{self._path}.roll_settled")
        self.patience = setup.each(f"{self._path}.patience") * setup.robot.time_scale
        self._band = setup.each(f"{self._path}.no_motion_band")[:, None]
        self.now[rows] = self.target[rows] = setup.command.roll[rows]
        self._belt_sign[rows] = belt_sign(setup.command.roll[rows])
        self.waited_for[rows] = False

    def belt_sign(self, roll: Array) -> Array:
        """Direction (n, 3) in which the belts drive forward at the measured ``roll`` (n, 3) rad."""
        self._belt_sign = held_belt_sign(roll, self._band, self._belt_sign)
        return self._belt_sign

    def begin_leg(self, robot: int, turned: bool) -> None:
        """Take up another leg; ``turned``: in the other gear, where modules change places."""
        if turned:
            # Subtracted, not negated: a roll of 0 must not become a negative zero in the record.
            self.now[robot] = 0.0 - self.now[robot, SWAPPED]
            self.target[robot] = -self.target[robot, SWAPPED]
            self._belt_sign[robot] = self._belt_sign[robot, SWAPPED]
        self.waited_for[robot] = False

    def square(self, robots: NDArray[np.bool_], time: Array) -> None:
        """Have ``robots`` (n,) roll the short way until their tracks face the wall.

        ``time`` (n,) s is this moment.
        """
        self.roll_first(robots, np.pi * np.round(self.now / np.pi), time)

    def roll_first(self, robots: NDArray[np.bool_], target: Array, time: Array) -> None:
        """Have ``robots`` (n,) roll to ``target`` (n, 3) rad before they back off.

        ``time`` (n,) s is this moment.
        """
        rolling = np.abs(target - self.now).max(axis=1) / self.rate
        self.target = np.where(robots[:, None], target, self.target)
        self._wait_until = np.where(robots, time + rolling + self.patience, self._wait_until)
        self.waited_for = self.waited_for | robots

    def end_waiting(self, roll: Array, time: Array) -> None:
        """Have robots back off that have rolled to their targets, or whose time is over.

        ``roll`` (n, 3) rad is measured at ``time`` (n,) s.
        """
        if np.count_nonzero(self.waited_for):
            self.waited_for = self.waited_for & ~self.settled(roll) & (time <= self._wait_until)

    def settled(self, roll: Array) -> NDArray[np.bool_]:
        """Robots (n,) whose modules, at the measured ``roll`` (n, 3) rad, are at their targets."""
        return np.abs(roll - self.target).max(axis=-1) < self.tolerance

    def move(self) -> None:
        """Move the set points on by one control period."""
        missing = self.target - self.now
        if np.count_nonzero(missing):
            self.now += np.minimum(np.maximum(missing, -self._step), self._step)


class Aligner:
    """Decides when n robots stop to roll before a fitting, and to where.

    Args:
        setup: of the controller.
        path: of the ``AlignmentTable`` in its parameters.

    Attributes:
        rolls: set points of the rotary motors.
        ranges: of theta5, for each passage.
        aligned: (n,) first passage that is not dealt with yet.
        attempts: (n,) rolls so far for that passage.
        deadline: (n,) s, after which a roll is judged as it is.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self._path, self._rows = path, np.arange(setup.n)
        self.rolls = RollSetPoints(setup, path)
        self.attempts, self.aligned = np.zeros((2, setup.n), int)
        self.deadline = np.zeros(setup.n)
        self._inside = np.zeros(setup.n, bool)  # robots that are aligned with the nose in a fitting
        self._astride = np.zeros(setup.n, bool)  # of these, with an opening between two modules
        self.reset(self._rows, setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self.rolls.reset(rows, setup)
        self.routes, self.robot, self.settings = setup.routes, setup.robot, setup.settings
        each = {name: setup.each(f"{self._path}.{name}") for name in AlignmentTable.model_fields}
        self._max_attempts = each["attempts"]
        self._clearances = np.radians(each["clearances_deg"])  # (n, K) rad
        self._clearance_detours = np.radians(each["clearance_detours_deg"])
        self._aim_detour = np.radians(each["aim_detour_deg"])
        self._clear_enough = np.radians(each["clear_enough_deg"]) - self.rolls.tolerance
        aims: dict[Manoeuvre, Array] = {
            manoeuvre: each[f"aim_{manoeuvre}"] for manoeuvre in BY_IMPORTANCE
        }
        self.ranges = OrientationRanges(setup, aims, each["aside_tee_turn"])
        self.attempts[rows], self.deadline[rows] = 0, np.inf
        self._inside[rows] = self._astride[rows] = False
        # Without alignment every passage counts as dealt with.
        first = self.routes.first[setup.location.route]
        self.aligned[rows] = np.where(self.settings.align, first, np.iinfo(np.intp).max)[rows]

    def begin_leg(self, robot: int, turned: bool, route: int) -> None:
        """Take up another leg on a route; ``turned``: in the other gear."""
        self.rolls.begin_leg(robot, turned)
        self.attempts[robot], self.deadline[robot] = 0, np.inf
        self._inside[robot] = self._astride[robot] = False
        if self.settings.align[robot]:
            self.aligned[robot] = self.routes.first[route]

    def extend_leg(self, robot: int, shift: int) -> None:
        """Follow a robot onto a route that extends its own.

        Numbers of passages are larger by ``shift``.
        """
        if self.settings.align[robot]:
            self.aligned[robot] += shift

    def align_again(self, robots: NDArray[np.bool_], passage: NDArray[np.intp]) -> None:
        """Forget that ``robots`` (n,) have been aligned for their ``passage`` (n,)."""
        again = robots & self.settings.align
        self.aligned = np.where(again, np.minimum(self.aligned, passage), self.aligned)

    def align_inside(
        self, robots: NDArray[np.bool_], passage: NDArray[np.intp], astride: bool = False
    ) -> None:
        """As ``align_again``, and for fittings that go with any orientation, too.

        Args:
            robots: (n,) that are told.
            passage: (n,) they are in.
            astride: as for driving straight over an opening, whatever the passage.
        """
        self.align_again(robots, passage)
        self._inside = self._inside | robots
        self._astride = np.where(robots, astride, self._astride)

    def roll_astride(
        self, robots: NDArray[np.bool_], observation: Observation, room: Array
    ) -> list[Event]:
        """Have ``robots`` (n,) roll where they are, an opening between two modules; then back off.

        ``room`` is as of ``step``. Returns the events.
        """
        # A module at the opening has no wall, and the springs do not press the others to theirs.
        rows, target = np.flatnonzero(robots), self.rolls.target.copy()
        plan = self._cheapest(rows, observation.location, robots)
        target[rows] += plan.change[:, None]
        self.rolls.roll_first(robots, target, observation.time)
        return self._roll_events(rows, plan, observation, room)

    def _ranges(
        self,
        robots: NDArray[np.intp],
        passage: NDArray[np.intp],
        astride: NDArray[np.bool_],
    ) -> tuple[Array, Array]:
        """Ranges of theta5 that ``robots`` (m,) aim for, those ``astride`` (n,) beside an opening.

        Returns:
            Middles and half-widths (AIMS, SIDES, m) rad.
        """
        best = np.where(
            astride[robots],
            preferred_theta5("tee_straight"),
            self.ranges.best[..., robots, passage],
        )
        return best, self.ranges.half_width[..., robots, passage]

    def step(
        self, observation: Observation, room: Array
    ) -> tuple[NDArray[np.bool_], Sequence[Event]]:
        """Plan a roll where one is due, and move the set points on.

        Args:
            observation: of this moment.
            room: (n,) m, ``RouteMap.nose_room`` at this moment.

        Returns:
            The robots (n,) that stand still to roll, and the events of this step.
        """
        self.rolls.end_waiting(observation.roll, observation.time)
        standing = self._stand(observation, room)
        self.rolls.move()
        return standing

    def _stand(
        self, observation: Observation, room: Array
    ) -> tuple[NDArray[np.bool_], Sequence[Event]]:
        location, events = observation.location, []
        due = (self.aligned <= location.passage) & (room <= self.robot.standing_room)
        if not np.count_nonzero(due):
            return due, ()
        # An infinite deadline says that nothing has been tried for this fitting yet.
        new = due & np.isinf(self.deadline)
        self.deadline = np.where(new, observation.time + self.rolls.patience, self.deadline)
        # The last ranges are the widest.
        best, width = self._ranges(self._rows, location.passage, self._astride)
        error = np.abs(orientation_error(location.theta5, best[-1]))
        oriented = (error <= width[-1] + ROUNDING).any(axis=0)
        off_the_line = no_motion_distance(observation.roll).min(axis=-1) >= self._clear_enough
        # With the nose inside, a fitting that goes with any orientation is not worth a stop.
        inside = (room < 0) & self.ranges.any_goes[location.passage]
        decide = due & (self.rolls.settled(observation.roll) | (observation.time > self.deadline))
        if location.sure is not None:
            decide &= location.sure
        good = (oriented | (inside & ~self._inside)) & off_the_line
        finished = decide & (good | (self.attempts >= self._max_attempts))
        self.aligned = np.where(finished, location.passage + 1, self.aligned)
        self.attempts = np.where(finished, 0, self.attempts)
        self._inside, self._astride = self._inside & ~finished, self._astride & ~finished
        self.deadline = np.where(finished, np.inf, self.deadline)
        again = decide & ~finished
        if again.any():
            events = self._plan(np.flatnonzero(again), observation, room)
        return due & ~finished, events

    def _plan(self, robots: NDArray[np.intp], observation: Observation, room: Array) -> list[Event]:
        """Plan a roll for each of ``robots`` (m,); those without a plan drive on as they are."""
        plan = self._cheapest(robots, observation.location, self._astride)
        # All modules roll alike: against each other they would scrub instead of turning the robot.
        self.rolls.target[robots] += plan.change[:, None]
        rolls = np.abs(plan.change) > self.rolls.tolerance[robots]
        max_attempts = self._max_attempts[robots]
        # Where no roll is needed, or none helps, no further attempt is worth the time.
        self.attempts[robots] = np.where(rolls, self.attempts[robots] + 1, max_attempts)
        rolling = np.abs(plan.change) / self.robot.roll_rate
        self.deadline[robots] = observation.time[robots] + rolling + self.rolls.patience[robots]
        return self._roll_events(robots, plan, observation, room)

    def _cheapest(
        self, robots: NDArray[np.intp], location: Location, astride: NDArray[np.bool_]
    ) -> RollPlan:
        """Plan the cheapest of the rolls to all aims with all clearances, for ``robots`` (m,).

        ``astride`` is as of ``_ranges``.
        """
        theta5, passage = location.theta5[robots], location.passage[robots]
        roll = self.rolls.target[robots, 0]
        ratio = self.robot.lug_radius / self.routes.radius[passage]
        best, aims = self._ranges(robots, passage, astride)
        plan, least = None, np.full(len(robots), np.inf)
        for clearance, detour in zip(
            self._clearances[robots].T, self._clearance_detours[robots].T, strict=True
        ):
            for width, side in np.ndindex(*best.shape[:2]):
                centre, aim = best[width, side], aims[width, side]
                other = plan_roll(theta5, roll, centre, aim, ratio, no_motion_margin=clearance)
                # Of two equally long rolls, to either side, the positive one costs less.
                roll_cost = np.abs(other.change) - ROUNDING * (other.change > 0)
                cost = roll_cost + detour + width * self._aim_detour[robots]
                cost = np.where(other.exists, cost, np.inf)
                plan = other if plan is None else other.where(cost < least, plan)
                least = np.minimum(cost, least)
        assert plan is not None
        return plan

    def _roll_events(
        self, robots: NDArray[np.intp], plan: RollPlan, observation: Observation, room: Array
    ) -> list[Event]:
        """Return the events of the plans of ``robots`` (m,): of all that roll, or cannot."""
        told = (np.abs(plan.change) > self.rolls.tolerance[robots]) | ~plan.exists
        return [
            self._roll_event(robot, plan, i, observation, "in" if room[robot] < 0 else "before")
            for i, robot in enumerate(robots.tolist())
            if told[i]
        ]

    def _roll_event(
        self, robot: int, plan: RollPlan, i: int, observation: Observation, place: str
    ) -> Event:
        """One plan, or why there is none, as an event."""
        location, time = observation.location, float(observation.time[robot])
        fitting = self.routes.name_of(int(location.passage[robot]))
        theta5_deg = float(np.degrees(location.theta5[robot]))
        if not plan.exists[i]:
            cause = Obstacle(int(plan.obstacle[i])).text
            return NotAligned(robot, time, fitting, theta5_deg, cause, place)
        change, after = float(np.degrees(plan.change[i])), float(np.degrees(plan.theta5[i]))
        return Rolled(robot, time, fitting, change, theta5_deg, after, place)
