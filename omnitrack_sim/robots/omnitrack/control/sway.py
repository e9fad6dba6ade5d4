"""The sway of a robot across the plane of a turn into a branch, where its inner module slips."""

from __future__ import annotations

from ctypes import CFUNCTYPE
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBER,
    NUMBERS,
    WORD,
    WORDS,
    at,
    c_function,
    compiled,
    pointers,
)
from omnitrack_sim.pipes.route_map import (
    AHEAD,
    DIRECTION,
    PASSAGE,
    RADIUS,
    Location,
    progress_of,
)
from omnitrack_sim.pipes.vectors import (
    cross,
    dot,
    in_frame,
    put_vector,
    scaled,
    vector,
)
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.control.orientation import (
    keeps_the_wall,
    orientation_error,
    preferred_theta5,
)
from omnitrack_sim.robots.omnitrack.kinematics import MODULE_AXES, rotation_part


class SwayTable(Table):
    """Parameters of the sway in a turn from a tee's run into its branch.

    The slip of the turn is the part of the rotation by the belts that the gyroscope does not see.
    """

    lean_deg: Annotated[float, Field(ge=0, le=80)] = 40.0
    """Largest lean that is asked for, 0 to 80; a robot reaches half of it. 0: none."""
    # A turn with less slip is left alone. On a dry wall it is -0.14 to -0.02, in turns that fail
    # without sway 0.23 and more.
    slip: Annotated[NotNegative, Unit("1")] = 0.1
    """A turn that slips no more than this is left alone."""
    slip_range: Annotated[Part, Unit("1")] = 0.2
    """Slip beyond that with which the lean is in full."""
    # A robot that has slid past the branch hardly ever comes back (docs/studies/tee-turn.md). With
    # 0.4 from a tenth of the turn on, 25 of 120 robots begin again with friction 0.6 to 0.75 and 19
    # to 24 N, of which all would have passed and 2 fail; with 0.55 from 0.15 on 5, and none fails.
    begin_again: Annotated[NotNegative, Unit("1")] = 0.55
    """Slip in the beginning of a turn beyond which the robot backs off to try again at once."""


@dataclass(frozen=True)
class SwayProfile:
    """Lean over the course of a turn into a branch.

    Attributes:
        progress: rotation so far at which ``lean`` stands, as parts of the turn.
        lean: lean there, as parts of the largest; linear between. The swing back begins early: a
            robot follows it by about a ninth of the turn later. On slippery walls (friction 0.5 to
            0.62, 20 to 34 N, 0.6 and more of the weight down the run, no retry) 76 of 90 turns
            pass, 70 without the first swing to the other side, 33 without any lean.
        judged: part of the turn after which its slip is no longer measured. Farther on the inner
            module may have lost its wall, and its belt then turns nothing on a dry wall either.
        min_turn: rad, rotation by the belts that is enough to tell how much of it slips.
        beginning: parts of the turn between which it can be begun again. Before, belts that have
            just begun to turn a robot slip on dry walls, too; farther on it no longer comes back.
    """

    progress: tuple[float, ...] = (1 / 9, 1 / 3, 5 / 9, 7 / 9)
    lean: tuple[float, ...] = (-0.15, 1.0, 0.5, 0.0)
    judged: float = 1 / 3
    min_turn: float = np.radians(5.0)
    beginning: tuple[float, float] = (0.15, 0.3)


SWAY = SwayProfile()


class Lean(NamedTuple):
    """Set point of the lean of n robots.

    Attributes:
        aside: (n, 3) added to the unit vector of the wanted heading, world frame.
        limit: (n,) largest size of ``aside`` in this turn.
        slip: (n,) that of the turn at the first attempt, where robots try again, beyond 1 of those
            that were turned back; 0 of the others.
    """

    aside: Array
    limit: Array
    slip: Array


class Sway:
    """The sway of n robots.

    A robot leans to the side of the turn's plane that the inner module, the one nearest to the
    branch, is not on when the turn begins.

    Args:
        setup: of the controller.
        path: of the ``SwayTable`` in its parameters.

    Attributes:
        by_belts: (n,) rad, rotation in the first part of the turn by the speeds of the belts; of
            turns out of a branch, too.
        turned: (n,) rad, the same by the gyroscope.
        slides: (n,) bool, robots that slip so much in the beginning of a turn that they had better
            begin it again.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self._path, self._rows = path, np.zeros((setup.n, SWAYING))
        self.by_belts, self.turned = self._rows[:, BY_BELTS], self._rows[:, TURNED]
        self.slides = np.zeros(setup.n, bool)
        self._best = preferred_theta5("tee_turn")
        # While no robot turns and none has slipped, the last location is all that is kept.
        self._idle = False
        self._before: Location | None = None
        self._upright = Lean(np.zeros((setup.n, 3)), np.zeros(setup.n), np.zeros(setup.n))
        self.reset(np.arange(setup.n), setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self._catch_up()
        self.routes, self.period = setup.routes, setup.period
        each = {name: setup.each(f"{self._path}.{name}") for name in SwayTable.model_fields}
        # Added across a unit vector, a tangent turns it by the angle.
        self._rows[:, LARGEST] = np.tan(np.radians(each["lean_deg"]))
        self._rows[:, SLIP_FROM], self._rows[:, SLIP_RANGE] = each["slip"], each["slip_range"]
        # Leaning needs both outer modules at the wall.
        self._rows[:, BEGIN_AGAIN] = np.where(keeps_the_wall(setup), each["begin_again"], np.inf)
        self._rows[rows, BY_BELTS:] = 0.0
        self._rows[rows, SIDE] = 1.0
        self.slides[rows] = False

    @property
    def known(self) -> NDArray[np.bool_]:
        """Robots (n,) that belts have turned far enough to tell the slip."""
        return self.by_belts > MIN_TURN

    @property
    def slip(self) -> Array:
        """Slip of the turn (n,), 1; zero as long as it is not known."""
        return self._rows[:, TURN_SLIP]

    @property
    def grips(self) -> NDArray[np.bool_]:
        """Robots (n,) that are known to turn with so little slip that they are left alone."""
        return self.known & (self.slip <= self._rows[:, SLIP_FROM])

    @property
    def slipped(self) -> NDArray[np.bool_]:
        """Robots (n,) whose turn slips, or has slipped at the attempt before, so that they lean."""
        return self._rows[:, SLIPPED] > self._rows[:, SLIP_FROM]

    def step(
        self,
        observation: Observation,
        turning: NDArray[np.bool_],
        merging: NDArray[np.bool_],
        full: NDArray[np.bool_],
    ) -> Lean:
        """Return the set point of the lean.

        Args:
            observation: of this moment.
            turning: (n,) robots that turn into a branch now.
            merging: (n,) robots that turn out of one now, whose slip is measured.
            full: (n,) robots that sway in full at any slip, as they try again.
        """
        location, measured, rows = observation.location, turning | merging, self._rows
        nobody = not np.count_nonzero(measured)
        if nobody and self._idle:
            self._before = location
            return self._upright
        self._catch_up()
        if np.count_nonzero(turning) < len(turning):
            rows[:, SIDE] = np.where(turning, rows[:, SIDE], self._side_of(location))
        rows[:, MEASURED], rows[:, TURNS], rows[:, FULL] = measured, turning, full
        rows[:, SPEEDS : SPEEDS + 3] = observation.wall_speed
        rows[:, SPIN : SPIN + 3] = observation.angular_velocity
        rows[:, FRAME : FRAME + 9] = observation.rotation.reshape(-1, 9)
        c_function(_sway, _SWAY).ctypes(
            len(rows),
            self.routes.tables[-1],
            *pointers(location.passage, _PROFILE, MODULE_AXES),
            self.period,
            *pointers(rows),
        )
        self._idle = nobody and not np.count_nonzero(rows[:, SLIPPED])
        self.slides = rows[:, SLIDES] > 0
        aside, limit, again = rows[:, ASIDE_BY : ASIDE_BY + 3], rows[:, LEAN_BY], rows[:, AGAIN]
        return Lean(aside.copy(), limit.copy(), again.copy())

    def _catch_up(self) -> None:
        """Take up the side of the turn's plane at the last location of robots that did not turn."""
        if self._before is not None:
            self._rows[:, SIDE], self._before = self._side_of(self._before), None

    def _side_of(self, location: Location) -> Array:
        """Side (n,) of a turn's plane to lean to, 1 or -1, by the orientation before the turn."""
        # Equal orientations lean alike: theta5 = -115 is 5 degrees beside the best, as 5 itself.
        return np.where(orientation_error(location.theta5, self._best) < 0, 1.0, -1.0)


JUDGED, MIN_TURN = SWAY.judged, SWAY.min_turn
EARLIEST, LATEST = SWAY.beginning
_PROFILE = np.array([*SWAY.progress, *SWAY.lean])
POINTS = len(SWAY.progress)
# Columns of a robot in the table of the sway: parameters, state, what it is given and returns.
LARGEST, SLIP_FROM, SLIP_RANGE, BEGIN_AGAIN = range(4)
BY_BELTS, TURNED, SLIPPED, SIDE, TURN_SLIP, SLIDES = range(4, 10)
MEASURED, TURNS, FULL, LEAN_BY, AGAIN = range(10, 15)
SPEEDS, SPIN, ASIDE_BY, FRAME = 15, 18, 21, 24
SWAYING = 33


@compiled
def interpolated(x, points, values, count):
    """Return the value at x of a line through points, ascending; beyond them it is constant."""
    if x <= points[0]:
        return values[0]
    for i in range(1, count):
        if x <= points[i]:
            slope = (values[i] - values[i - 1]) / (points[i] - points[i - 1])
            return slope * (x - points[i - 1]) + values[i - 1]
    return values[count - 1]


@compiled
def rotation_by(speeds, lever, modules):
    """Return the rotation, rad/s in the robot's frame, by wall speeds of the modules."""
    omega_x = omega_y = 0.0
    for k in range(3):
        omega_x += rotation_part(speeds[k], lever, -modules[2 * k + 1])
        omega_y += rotation_part(speeds[k], lever, modules[2 * k])
    return omega_x, omega_y, 0.0


@compiled
def slip_of(robot):
    """Return the slip of a robot's turn, 0 as long as it is not known."""
    if robot[BY_BELTS] > MIN_TURN:
        return 1.0 - robot[TURNED] / robot[BY_BELTS]
    return 0.0


@compiled
def sway_of(robot, passage, profile, modules, period):
    """Update a robot's state, and what is asked of it; see ``Sway.step``."""
    turns, full = robot[TURNS] > 0.0, robot[FULL] > 0.0
    if not full:
        robot[SLIPPED] = max(robot[TURN_SLIP], 0.0)
    robot[AGAIN] = robot[SLIPPED] if full and turns else 0.0
    robot[SLIDES] = robot[LEAN_BY] = 0.0
    put_vector(robot, ASIDE_BY, (0.0, 0.0, 0.0))
    if robot[MEASURED] == 0.0:
        robot[BY_BELTS] = robot[TURNED] = robot[TURN_SLIP] = 0.0
        return
    frame, normal = at(robot, FRAME), cross(vector(passage, AHEAD), vector(passage, DIRECTION))
    about = in_frame(frame, normal)
    progress = progress_of(passage, frame)
    if progress < JUDGED:
        # The lever is the pipe's radius: tracks act at the wall (docs/explanation/kinematics.md).
        belts = rotation_by(at(robot, SPEEDS), passage[RADIUS], modules)
        robot[BY_BELTS] += period * dot(belts, about)
        robot[TURNED] += period * dot(vector(robot, SPIN), about)
    slip = robot[TURN_SLIP] = slip_of(robot)
    if not turns:
        return
    begins = not full and EARLIEST <= progress < LATEST
    robot[SLIDES] = 1.0 if begins and slip > robot[BEGIN_AGAIN] else 0.0
    share = min(max((slip - robot[SLIP_FROM]) / robot[SLIP_RANGE], 0.0), 1.0)
    robot[LEAN_BY] = robot[LARGEST] * (1.0 if full else share)
    # Back at 0 before the turn ends: the robot has to leave it in its plane.
    size = robot[LEAN_BY] * interpolated(progress, profile, at(profile, POINTS), POINTS)
    put_vector(robot, ASIDE_BY, scaled(normal, robot[SIDE] * size))


def _sway(count, passages, passage, profile, modules, period, robots):
    """Carry out one control step of the sway of robots; see ``Sway.step``."""
    for i in range(count):
        robot, fitting = at(robots, SWAYING * i), at(passages, PASSAGE * passage[i])
        sway_of(robot, fitting, profile, modules, period)
    return 0


_SWAY = CFUNCTYPE(INTEGER, WORD, NUMBERS, WORDS, *[NUMBERS] * 2, NUMBER, NUMBERS)
