"""Recovery from a failed turn.

A robot that makes no headway in a turn rolls its tracks to the wall, backs off to before the
fitting and tries again; straight over an opening, or turned out of a branch already, it rolls where
it is, and so does one that hangs upright while it backs off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Part, Table, Unit
from omnitrack_sim.record.events import BackedOff, Event
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.control.alignment import Aligner
from omnitrack_sim.robots.omnitrack.control.orientation import keeps_the_wall


class RecoveryTable(Table):
    """Failure of a turn, and retries. Lengths are for D = 160 mm and grow with the robot's bore."""

    retries: Annotated[int, Field(ge=0, le=1000), Unit("1")] = 2
    """Retries at one fitting."""
    progress: Annotated[Part, Unit("m")] = 0.002
    """Advance beyond the farthest point so far that counts as progress."""
    # A robot pressed with 15 to 20 N often hangs for a moment on the rim of the opening, where an
    # outer module has lost the wall. The rate loop then asks the belts to turn it at all costs, and
    # nobody drives it forward: without this 95 of 120 such robots pass at once, with it 112.
    hesitation: Annotated[Part, Unit("m")] = 0.04
    """Distance at cruise speed without progress after which the rate loop is left out, until the
    robot moves on; backing off, after which a robot that hangs upright in the opening rolls
    astride it."""
    patience: Annotated[Part, Unit("m")] = 0.15
    """Distance at cruise speed without progress after which the turn has failed; half of
    `monitor.patience`."""
    merge_patience: Annotated[Part, Unit("m")] = 0.27
    """The same out of a branch, where most robots that hang at first get through."""
    fallen: Annotated[Part, Unit("m")] = 0.04
    """Fall behind the farthest point after which the turn has failed."""
    beside: Annotated[Part, Unit("pipe radii")] = 0.6
    """Offset from the centreline beyond which a robot has gone past the branch."""
    # A robot that its springs hardly press to the wall comes back more often if it backs off
    # sooner. Of 800 turns (friction 0.6 to 1.0, 15 to 22 N) 797 pass with 0.4, 789 with 0.6, and
    # all that differ are of 18.9 N or less; with more, on slippery walls, some pass beyond 0.4.
    weak_beside: Annotated[Part, Unit("pipe radii")] = 0.4
    """The same where the springs are too weak for a safe orientation."""
    # Its nose is in the branch by then, and backing off wedges it across the run.
    facing: Annotated[Part, Unit("1")] = 0.75
    """Part of the turn into a branch beyond which a robot is past nothing, however far beside the
    centreline."""
    # Such a robot stands in the run. Backing off, it falls into the other half, and out of the tee.
    upright: Annotated[Part, Unit("1")] = 2 / 3
    """Part of the turn out of a branch beyond which a robot that has failed does not back off, but
    rolls where it is, the opening between two modules. Turning into a branch a robot is upright
    while it has more than that part of the turn before it."""
    # Where a robot hangs across the run, a track that is rolled aside touches the wall with its
    # edge, or the other track does, which runs the other way. Of 430 such robots (friction 0.6 to
    # 0.8, 15 to 20 N) 6 % came free that backed off less than 30 degrees from the no-motion line,
    # 42 % at 45 to 60 degrees, 66 % at 75 to 90 degrees.
    square: bool = True
    """Roll until the tracks face the wall before backing off."""
    back_off: Annotated[Part, Unit("m")] = 0.6
    """Distance at cruise speed after which backing off is given up."""


class Recovery:
    """Decides which of n robots back off.

    Args:
        setup: of the controller.
        path: of the ``RecoveryTable`` in its parameters.

    Attributes:
        max_distance: (n,) m, farthest point so far.
        waiting: (n,) s without headway, or backing off.
        backing: (n,) bool, robots that back off.
        retries: (n,) at the current ``passage``.
        passage: (n,) that retries are counted for.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self._path, n = path, setup.n
        self.max_distance, self.waiting = np.zeros((2, n))
        self._least_distance, self._hanging = np.zeros((2, n))  # m, and s without less, backing off
        self.backing = np.zeros(n, bool)
        self.retries, self.passage = np.zeros((2, n), np.intp)
        self.reset(np.arange(n), setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self.routes, self.robot, self.settings = setup.routes, setup.robot, setup.settings
        self.period = setup.period
        each = {name: setup.each(f"{self._path}.{name}") for name in RecoveryTable.model_fields}
        own, speed = setup.robot.own_length, setup.settings.min_cruise_speed
        self._hesitation = own(each["hesitation"]) / speed  # (n,) s
        self._max_retries = each["retries"]
        self._beside = np.where(keeps_the_wall(setup), each["beside"], each["weak_beside"])
        self._upright, self._square = each["upright"], each["square"]
        self._facing = each["facing"]
        self._progress, self._fallen = own(each["progress"]), own(each["fallen"])  # (n,) m
        self._patience = own(each["patience"]) / speed  # (n,) s
        self._merge_patience = own(each["merge_patience"]) / speed
        self._back_off = own(each["back_off"]) / speed
        self.begin_leg(rows)

    @property
    def hesitating(self) -> NDArray[np.bool_]:
        """Robots (n,) that have made no headway for a moment and do not back off."""
        return (self.waiting > self._hesitation) & ~self.backing

    def begin_leg(self, rows: int | NDArray[np.intp]) -> None:
        """Forget the progress and the retries of robots ``rows``, which begin a leg."""
        # Arc length begins elsewhere on another leg: any value is headway.
        self.max_distance[rows], self.waiting[rows] = -np.inf, 0.0
        self.backing[rows], self.retries[rows], self.passage[rows] = False, 0, -1

    def extend_leg(self, robot: int, shift: int) -> None:
        """Follow a robot onto a route that extends its own.

        Numbers of passages are larger by ``shift``.
        """
        self.passage[robot] += shift

    def step(
        self,
        observation: Observation,
        standing: NDArray[np.bool_],
        sliding: NDArray[np.bool_],
        room: Array,
        aligner: Aligner,
    ) -> tuple[NDArray[np.bool_], Sequence[Event]]:
        """Return the robots (n,) that drive backward now, and the events of this step.

        Args:
            observation: of this moment.
            standing: (n,) robots that roll on the spot and are not waited for.
            sliding: (n,) robots that are about to slide past a branch.
            room: (n,) m, from the nose to the next fitting.
            aligner: told to align robots again that have backed off.
        """
        location = observation.location
        moved_on = location.passage != self.passage
        if np.count_nonzero(moved_on):
            self.retries = np.where(moved_on & ~self.backing, 0, self.retries)
            self.passage = np.where(self.backing, self.passage, location.passage)
        distance = location.distance
        headway = distance > self.max_distance + self._progress
        if np.count_nonzero(headway):
            self.max_distance = np.where(headway, distance, self.max_distance)
        still = self.backing | ~(headway | standing)
        # A robot has all of ``back_off`` left when its tracks face the wall.
        self.waiting = (self.waiting + self.period) * (still & ~aligner.rolls.waited_for)
        events = self._begin(observation, sliding, room, aligner)
        self._roll_where_they_hang(location.passage, room, aligner)
        if np.count_nonzero(self.backing):
            events = [*events, *self._roll_astride(observation, room, aligner)]
            self._end(location.distance, aligner)
        return self.backing, events

    def _begin(
        self,
        observation: Observation,
        sliding: NDArray[np.bool_],
        room: Array,
        aligner: Aligner,
    ) -> list[Event]:
        location, routes = observation.location, self.routes
        turning = routes.is_turn.take(location.passage) & (room < 0) & ~self.backing
        if not np.count_nonzero(turning):
            return []
        merging = routes.out_of_branch[location.passage]
        # Out of a branch most robots that hang for a while get through: they get more time.
        hanging = self.waiting > np.where(merging, self._merge_patience, self._patience)
        fallen = location.distance < self.max_distance - self._fallen
        # Out of a branch there is nothing to go past: the far wall stands across the way.
        room_beside = self._beside * routes.radius[location.passage]
        beside = routes.into_branch[location.passage] & (location.offset > room_beside)
        if np.count_nonzero(beside):
            beside &= routes.progress(location.passage, observation.rotation) < self._facing
        may = turning & (self.retries < self._max_retries) & self.settings.retry
        failed = may & (hanging | fallen | beside | sliding)
        upright = merging & self.settings.align & failed
        if np.count_nonzero(upright):
            progress = routes.progress(location.passage, observation.rotation)
            upright &= progress > self._upright
        causes = {"no headway": hanging, "falls back": fallen, "slips past": beside}
        events: list[Event] = []
        for robot in np.flatnonzero(failed).tolist():
            name = routes.name_of(int(location.passage[robot]))
            time, distance = float(observation.time[robot]), float(location.distance[robot])
            tilt = float(np.degrees(location.tilt[robot]))
            cause = next((cause for cause, robots in causes.items() if robots[robot]), "slips")
            how = "rolls where it is" if upright[robot] else "backs off"
            events.append(BackedOff(robot, time, name, distance, tilt, cause, how))
        if events:
            self.backing = self.backing | (failed & ~upright)
            self.retries = self.retries + failed
            self.waiting = np.where(failed, 0.0, self.waiting)
            self._least_distance = np.where(failed, location.distance, self._least_distance)
            self._hanging = np.where(failed, 0.0, self._hanging)
            # One that is about to slide past is in the pipe yet, and has no time to lose.
            squares = failed & ~upright & ~sliding & self._square & self.settings.align
            aligner.rolls.square(squares, observation.time)
            self.max_distance = np.where(upright, location.distance, self.max_distance)
            if np.count_nonzero(upright):
                aligner.align_inside(upright, location.passage, astride=True)
        return events

    def _roll_where_they_hang(
        self, passage: NDArray[np.intp], room: Array, aligner: Aligner
    ) -> None:
        """Align robots on the spot that hang straight over an opening.

        A robot that has fallen into the fitting has not been aligned before it.
        """
        over = self.routes.is_straight_over.take(passage) & (room < 0)
        if not np.count_nonzero(over):
            return
        may = over & (self.retries < self._max_retries) & self.settings.retry
        hanging = may & (self.waiting > self._patience)
        if hanging.any():
            self.retries = self.retries + hanging
            self.waiting = np.where(hanging, 0.0, self.waiting)
            aligner.align_inside(hanging, passage)

    def _roll_astride(
        self, observation: Observation, room: Array, aligner: Aligner
    ) -> Sequence[Event]:
        """Roll robots that hang in the run, beside a branch, once each time that they back off."""
        location, routes = observation.location, self.routes
        nearer = location.distance < self._least_distance - self._progress
        self._least_distance = np.where(nearer, location.distance, self._least_distance)
        moves = nearer | aligner.rolls.waited_for
        self._hanging = np.where(moves, np.minimum(self._hanging, 0.0), self._hanging + self.period)
        hangs = self.backing & (self._hanging > self._hesitation) & (room < 0)
        hangs &= routes.into_branch[location.passage] & self.settings.align
        if np.count_nonzero(hangs):
            progress = routes.progress(location.passage, observation.rotation)
            hangs &= progress < 1.0 - self._upright
        if not np.count_nonzero(hangs):
            return ()
        self._hanging = np.where(hangs, -np.inf, self._hanging)  # once
        return aligner.roll_astride(hangs, observation, room)

    def _end(self, distance: Array, aligner: Aligner) -> None:
        # While a robot backs off, ``waiting`` counts the time of that.
        given_up = self.waiting > self._back_off
        start = self.routes.start[self.passage]
        before = start - self.robot.length / 2 - self.robot.standing_room  # m, a retry begins here
        done = self.backing & ((distance <= before) | given_up)
        if not done.any():
            return
        self.backing = self.backing & ~done
        self.max_distance = np.where(done, distance, self.max_distance)
        self.waiting = np.where(done, 0.0, self.waiting)
        # One that has given up lies beside the branch yet, and backs off once more. That it rolls
        # for the turn meanwhile shakes some free: 15 of 58 pass, 11 whose tracks stay at the wall.
        aligner.align_again(done, self.passage)
