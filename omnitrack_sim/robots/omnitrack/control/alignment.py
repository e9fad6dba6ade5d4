"""Roll before a fitting: to a safe theta5, with the modules off the no-motion line.

``plan_roll`` finds the shortest roll into a range of theta5, pure and for arrays of robots.
``Aligner`` decides for each robot of a batch when to stop, which range to aim for and when the roll
is done; all controllers share it. ``AlignmentTable`` holds its numbers.

Rolling all modules by phi turns the robot by -phi r / R. With R / r = 2.9 a third of a turn of the
robot costs nearly a whole turn of the modules, so the three equal orientations have almost the same
roll and picking another one does not leave the no-motion line; the width of the safe range does
(11.73 degrees of theta5 are 34 degrees of roll).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, wrap_angle
from omnitrack_sim.base.table import NotNegative, Part, Table, Unit
from omnitrack_sim.pipes.fittings.base import Manoeuvre
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.record.events import Event, NotAligned, Rolled
from omnitrack_sim.robots.control import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.robots.omnitrack.control.command import SWAPPED
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign, turn_from_roll
from omnitrack_sim.robots.omnitrack.singularity import best_theta5, safe_margin, sector_angle

NO_MOTION_MARGIN = np.radians(30.0)
"""Default least distance of a roll from the no-motion line, rad.

There both tracks of a module touch and work against each other.
"""
TURN_LIMIT = np.pi
"""Default limit of the robot's turn in one plan, rad.

Half a turn either way reaches every equal orientation.
"""
ROUNDING = 1e-9  # rad, by which a plan may lie outside the border of a range
_LEAST_NO_MOTION_MARGIN = 1e-6  # rad, keeps off the line itself if no margin is asked


class Obstacle(IntEnum):
    """Why no roll helps; ``CLEAR`` if one does."""

    CLEAR = 0
    NO_SAFE_ORIENTATION = 1
    NO_ROLL_OFF_THE_LINE = 2
    OUT_OF_RANGE = 3

    @property
    def text(self) -> str:
        """One sentence that says why, and what to try."""
        return _OBSTACLES[self]


_OBSTACLES = {
    Obstacle.CLEAR: "there is a roll that ends in the safe range and off the no-motion line",
    Obstacle.NO_SAFE_ORIENTATION: "the safe margin is zero: no orientation keeps all modules on "
    "the wall; a longer reach makes the singular sector smaller",
    Obstacle.NO_ROLL_OFF_THE_LINE: "the no-motion margin is over 90 degrees: it excludes every "
    "roll; ask for less",
    Obstacle.OUT_OF_RANGE: "every safe orientation within the turn limit has its modules near "
    "the no-motion line; "
    "ask for a wider safe margin, a smaller no-motion margin or a larger turn limit",
}


@dataclass(frozen=True)
class RollPlan:
    """Rolls of any number of robots, arrays of one shape (...).

    Attributes:
        change: rad, what all modules roll by; 0 if none is needed or none helps.
        roll: rad, roll of the modules afterwards.
        theta5: rad, in [-pi, pi), afterwards, if they roll without slip.
        belt_sign: direction in which a positive belt speed drives afterwards: the sign of
            cos(roll).
        obstacle: an ``Obstacle``, as int8.
    """

    change: Array
    roll: Array
    theta5: Array
    belt_sign: Array
    obstacle: NDArray[np.int8]

    @property
    def exists(self) -> NDArray[np.bool_]:
        """True where there is a roll that helps, or none is needed."""
        return self.obstacle == Obstacle.CLEAR

    def where(self, chosen: NDArray[np.bool_], other: RollPlan) -> RollPlan:
        """These plans where ``chosen``, ``other`` elsewhere."""
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return RollPlan(*(np.where(chosen, mine, theirs) for mine, theirs in pairs))


def preferred_theta5(manoeuvre: Manoeuvre, modules: int = MODULES) -> float:
    """The orientation, rad, to reach before a fitting.

    theta5 is measured from the turning direction, or from the opening of the tee.

    * ``elbow``: one module on the innermost curve (Fig. 15);
    * ``tee_turn``: the outer direction midway between two modules (Fig. 8(b), Fig. 9);
    * ``tee_straight``: the opening midway between two modules, on either side of it (Fig. 17).

    Raises:
        InputError: there is no such manoeuvre.
    """
    orientations = {
        "elbow": 0.0,
        "tee_turn": float(best_theta5(modules)),
        "tee_straight": np.pi / modules,
    }
    if manoeuvre not in orientations:
        raise InputError(Fault("manoeuvre", f"is {manoeuvre!r}", tuple(orientations), manoeuvre))
    return orientations[manoeuvre]


def orientation_error(theta5: ArrayLike, best: ArrayLike, modules: int = MODULES) -> Array:
    """Angle (...,) rad from the nearest of the equal best orientations.

    In [-period / 2, period / 2).
    """
    return wrap_angle(np.asarray(theta5, float) - best, 2 * np.pi / modules)


class Wish(NamedTuple):
    """A range of theta5 that a fitting asks for.

    Attributes:
        best: (n,) rad, or one for all, middle of the range, modulo the period.
        margin: (n,) rad to either side.
    """

    best: float | Array
    margin: Array


def agreed(wishes: Sequence[Wish], modules: int = MODULES) -> tuple[Array, Array]:
    """The range of theta5 that wishes have in common.

    The first wish always counts. Each of the others narrows the range, in order, and is left out
    for a robot for which nothing of the range would be left.

    Returns:
        Middle (n,) and half-width (n,) of the range, rad.
    """
    first = wishes[0]
    low, high = -first.margin, np.array(first.margin)
    for best, margin in wishes[1:]:
        centre = orientation_error(best, first.best, modules)
        new_low, new_high = np.maximum(low, centre - margin), np.minimum(high, centre + margin)
        common = new_low <= new_high
        low, high = np.where(common, new_low, low), np.where(common, new_high, high)
    return first.best + (low + high) / 2, (high - low) / 2


def no_motion_distance(roll: ArrayLike) -> Array:
    """Angle (...,) rad between a roll and the nearest no-motion line, in [0, pi/2].

    These lines are at 90 and 270 degrees.
    """
    return np.abs(wrap_angle(np.asarray(roll, float) - np.pi / 2, np.pi))


def plan_roll(
    theta5: ArrayLike,
    roll: ArrayLike,
    best: ArrayLike,
    margin: ArrayLike,
    radius_ratio: ArrayLike,
    *,
    no_motion_margin: ArrayLike = NO_MOTION_MARGIN,
    turn_limit: float = TURN_LIMIT,
    modules: int = MODULES,
) -> RollPlan:
    """Shortest roll to within ``margin`` of ``best``, with the modules clear of the no-motion line.

    The shortest roll is zero or a border of an admissible range, so all borders are tried.

    Args:
        theta5: (...,) rad, module 1 from the turning direction.
        roll: (...,) rad, roll of the modules now.
        best: (...,) rad, wanted theta5, modulo 2 pi / modules.
        margin: (...,) rad, half-width of the safe range, as of ``singularity.safe_margin``.
        radius_ratio: (...,) lug radius over pipe radius, r / R.
        no_motion_margin: (...,) rad, least distance of the roll from the no-motion line.
        turn_limit: rad, largest turn of the robot.
        modules: number of equal modules.

    Raises:
        InputError: a radius ratio is not positive, or the turn limit negative.
    """
    values = (theta5, roll, best, margin, radius_ratio, no_motion_margin)
    arrays = (np.asarray(value, float) for value in values)
    theta5, roll, best, margin, ratio, clearance = np.broadcast_arrays(*arrays)
    if not np.all(ratio > 0):
        raise InputError(Fault("radius_ratio", "must be positive"))
    if not turn_limit >= 0:
        raise InputError(Fault("turn_limit", f"is {turn_limit}; it must not be negative"))
    clearance = np.maximum(clearance, _LEAST_NO_MOTION_MARGIN)
    error, period = orientation_error(theta5, best, modules), 2 * np.pi / modules
    change, exists = _shortest_roll(error, roll, margin, ratio, clearance, turn_limit, period)
    obstacle = np.select(
        [exists, ~(margin > 0), clearance > np.pi / 2 + ROUNDING],
        [Obstacle.CLEAR, Obstacle.NO_SAFE_ORIENTATION, Obstacle.NO_ROLL_OFF_THE_LINE],
        Obstacle.OUT_OF_RANGE,
    )
    return RollPlan(
        change=change,
        roll=roll + change,
        theta5=wrap_angle(theta5 + turn_from_roll(change, ratio, 1.0)),
        belt_sign=belt_sign(roll + change),
        obstacle=obstacle.astype(np.int8),
    )


def _shortest_roll(
    error: Array,
    roll: Array,
    margin: Array,
    ratio: Array,
    clearance: Array,
    turn_limit: float,
    period: float,
) -> tuple[Array, NDArray[np.bool_]]:
    """Shortest admissible roll (...,) rad, 0 where there is none, and whether there is one (...,).

    Args:
        error: (...,) rad, theta5 from the middle of the nearest safe range.
        roll: (...,) rad, roll of the modules now.
        margin: (...,) rad, half-width of the safe ranges.
        ratio: (...,) lug radius over pipe radius.
        clearance: (...,) rad, least distance of the roll from the no-motion line.
        turn_limit: rad, largest turn of the robot.
        period: rad, distance of the equal orientations.
    """
    candidates = np.concatenate(
        [
            np.zeros((*error.shape, 1)),
            _safe_borders(error, margin, ratio, turn_limit, period),
            # The smallest ratio asks for the longest roll: one set of candidates serves all robots.
            _line_borders(roll, clearance, turn_limit / float(ratio.min(initial=np.inf))),
        ],
        axis=-1,
    )
    after = wrap_angle(error[..., None] + turn_from_roll(candidates, ratio[..., None], 1.0), period)
    admissible = (
        (np.abs(after) <= margin[..., None] + ROUNDING)
        & (no_motion_distance(roll[..., None] + candidates) >= clearance[..., None] - ROUNDING)
        & (np.abs(candidates) * ratio[..., None] <= turn_limit + ROUNDING)
        & (margin[..., None] > 0)
    )
    # Of two equally long rolls the positive one costs less, by less than the rounding of angles.
    cost = np.where(
        admissible, np.abs(candidates) - np.where(candidates > 0, ROUNDING, 0.0), np.inf
    )
    shortest = np.argmin(cost, axis=-1)[..., None]
    exists = np.take_along_axis(admissible, shortest, axis=-1)[..., 0]
    change = np.where(exists, np.take_along_axis(candidates, shortest, axis=-1)[..., 0], 0.0)
    return change, exists


def _safe_borders(
    error: Array, margin: Array, ratio: Array, turn_limit: float, period: float
) -> Array:
    """Rolls (..., K) that bring theta5 to the borders of the safe ranges.

    There is a range about each of the equal orientations.
    """
    # All ranges within the limit, and one more, as the robot begins between two of them.
    reached = int(np.ceil(turn_limit / period)) + 1
    centres = error[..., None] + period * np.arange(-reached, reached + 1)
    # The far border of a range is needed too: the near one may lie at the no-motion line.
    borders = np.concatenate([centres - margin[..., None], centres + margin[..., None]], axis=-1)
    return borders / ratio[..., None]


def _line_borders(roll: Array, clearance: Array, roll_limit: float) -> Array:
    """Rolls (..., K) that bring the modules to the borders of the bands about no-motion lines."""
    reached = int(np.ceil(roll_limit / np.pi)) + 1
    nearest = wrap_angle(np.pi / 2 - roll, np.pi)
    lines = nearest[..., None] + np.pi * np.arange(-reached, reached + 1)
    return np.concatenate([lines - clearance[..., None], lines + clearance[..., None]], axis=-1)


Three = tuple[NotNegative, NotNegative, NotNegative]
_BY_IMPORTANCE: tuple[Manoeuvre, ...] = ("tee_turn", "tee_straight", "elbow")


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


AIMS = 3
"""Number of fractions that are tried."""
SIDES = 2
"""Number of ranges of theta5 of one aim: one on either side of the best orientation."""


def manoeuvres(routes: RouteMap) -> tuple[Manoeuvre | None, ...]:
    """Manoeuvre of each passage of the routes; None after the last one of a route."""
    return tuple(None if p is None else p.manoeuvre for p in routes.passages)


def keeps_the_wall(setup: ControlSetup) -> NDArray[np.bool_]:
    """Whether the springs of robots (n,) reach far enough to press both outer modules of a turn in
    a tee against its wall, from the best orientation."""
    robot = setup.robot
    radius = robot.nominal_pipe_radius
    reach = radius + setup.own("preload") / robot.module_stiffness
    return safe_margin(sector_angle(radius, reach, np.pi / 2)) > 0


def held_belt_sign(roll: Array, band: ArrayLike, before: Array) -> Array:
    """Direction (n, 3) in which the belts drive forward.

    Args:
        roll: (n, 3) rad, as measured.
        band: size of cos(roll) below which the direction stays what it was ``before``, (n, 3).
    """
    cosine = np.cos(roll)
    return np.where(np.abs(cosine) > band, np.sign(cosine), before)


class Aligner:
    """Roll commands of n robots.

    Fittings that follow each other with less room between than the robot needs to stand in are
    prepared for together, before the first of them: a tee turn comes first, then a tee to be passed
    straight, then elbows. What cannot be met beforehand is made up for on the way.

    Args:
        setup: of the controller.
        path: of the ``AlignmentTable`` in its parameters.

    Attributes:
        roll: (n, 3) rad, set point of the rotary motors.
        roll_target: (n, 3) rad, to which ``roll`` moves at the largest roll rate.
        aligned: (n,) first passage that is not dealt with yet.
        squaring: (n,) bool, robots that roll until their tracks face the wall.
        attempts: (n,) rolls so far for that passage.
        deadline: (n,) s, after which a roll is judged as it is.
    """

    def __init__(self, setup: ControlSetup, path: str) -> None:
        self._path, self._rows = path, np.arange(setup.n)
        self.roll, self.roll_target, self._belt_sign = np.zeros((3, setup.n, 3))
        self.attempts, self.aligned = np.zeros((2, setup.n), int)
        self.deadline = np.zeros(setup.n)
        self.squaring = np.zeros(setup.n, bool)
        self._square_by = np.full(setup.n, np.inf)  # s, when ``squaring`` ends at the latest
        self._inside = np.zeros(setup.n, bool)  # robots that are aligned with the nose in a fitting
        self._astride = np.zeros(setup.n, bool)  # of these, with an opening between two modules
        self.reset(self._rows, setup)

    def reset(self, rows: NDArray[np.intp], setup: ControlSetup) -> None:
        """Begin anew with robots ``rows``; ``setup`` is that of all robots."""
        self.routes, self.robot, self.settings = setup.routes, setup.robot, setup.settings
        each = {name: setup.each(f"{self._path}.{name}") for name in AlignmentTable.model_fields}
        self._settled, self._most_attempts = each["roll_settled"], each["attempts"]
        self._patience = each["patience"] * setup.robot.time_scale
        self._clearances = np.radians(each["clearances_deg"])  # (n, K) rad
        self._clearance_detours = np.radians(each["clearance_detours_deg"])
        self._aim_detour = np.radians(each["aim_detour_deg"])
        self._clear_enough = np.radians(each["clear_enough_deg"]) - self._settled
        self._band = each["no_motion_band"][:, None]
        self._aims = {m: each[f"aim_{m}"] for m in _BY_IMPORTANCE}  # (n, AIMS) of each manoeuvre
        self._aside = each["aside_tee_turn"]  # (n, AIMS)
        self._step = self.robot.roll_rate * setup.period  # rad
        self.learn()
        self.roll[rows] = self.roll_target[rows] = setup.command.roll[rows]
        self._belt_sign[rows] = belt_sign(setup.command.roll[rows])
        self.attempts[rows], self.deadline[rows] = 0, np.inf
        self._inside[rows] = self._astride[rows] = self.squaring[rows] = False
        # Without alignment every passage counts as dealt with.
        first = self.routes.first[setup.location.route]
        self.aligned[rows] = np.where(self.settings.align, first, np.iinfo(np.intp).max)[rows]

    def learn(self) -> None:
        """Compute the ranges of theta5 for each passage together with those that follow it closely.

        The safe margin is that of a right-angled corner, whatever the angle of the branch. With the
        angle put in, the region has no sector below 67 degrees and no safe orientation above 106,
        while wyes are passed, at 60 degrees as at 135, by about the orientations that pass a tee
        (docs/studies/wye.md).
        """
        routes, required = self.routes, manoeuvres(self.routes)
        fixed = self.settings.safe_margin[:, None]
        sector = sector_angle(routes.corner_radius, self.robot.reach, np.pi / 2)
        margin = np.where(np.isnan(fixed), safe_margin(sector), fixed)  # (n, Q) rad
        self.best = np.zeros((AIMS, SIDES, *margin.shape))  # (AIMS, SIDES, n, Q) rad
        self.aim = np.zeros(self.best.shape)  # rad, half-width of the range about it
        # (Q,) goes with any orientation
        self.makes_do = np.array([m in ("elbow", "tee_straight") for m in required])
        for q, manoeuvre in enumerate(required):
            if manoeuvre is None:
                continue
            together = self._together(q, manoeuvre, required)
            centres = [
                preferred_theta5(wanted) - self._turned_between(q, p) for p, wanted in together
            ]
            for i in range(AIMS):
                widths = [self._aims[wanted][:, i] * margin[:, p] for p, wanted in together]
                wishes = list(map(Wish, centres, widths))
                for j, first in enumerate(self._to_the_sides(together[0][0], wishes[0], i, margin)):
                    best, aim = agreed([first, *wishes[1:]])
                    self.best[i, j, :, q], self.aim[i, j, :, q] = best, aim

    def _to_the_sides(self, q: int, wish: Wish, aim: int, margin: Array) -> tuple[Wish, Wish]:
        """Split the wish of passage ``q`` into both sides of the best orientation; return it twice
        where the best orientation itself is allowed."""
        if not self.routes.into_branch[q]:
            return wish, wish
        aside = np.minimum(self._aside[:, aim] * margin[:, q], wish.margin)
        # A side reaches from ``aside`` to the margin.
        middle = np.where(aside > 0, (wish.margin + aside) / 2, 0.0)
        half = wish.margin - middle
        return Wish(wish.best + middle, half), Wish(wish.best - middle, half)

    def _together(
        self, q: int, manoeuvre: Manoeuvre, required: Sequence[Manoeuvre | None]
    ) -> list[tuple[int, Manoeuvre]]:
        """Passage ``q`` and those that follow it closely, the one that matters most first."""
        together: list[tuple[int, Manoeuvre]] = [(q, manoeuvre)]
        for p in range(q + 1, len(required)):
            following = required[p]
            # With less room between, a robot that stands before the later fitting is still in the
            # earlier.
            room = self.robot.length + self.robot.standing_room
            if following is None or self._room_between(p - 1) >= room:
                break
            together.append((p, following))
        # The first wish always counts (``agreed``): that of the most important passage.
        together.sort(key=lambda passage: _BY_IMPORTANCE.index(passage[1]))
        return together

    def _room_between(self, passage: int) -> float:
        """Length, m, of the way from the end of a passage to the start of the next one."""
        return float(self.routes.start[passage + 1] - self.routes.end[passage])

    def _turned_between(self, first: int, later: int) -> float:
        """Increase of theta5, rad, from the passage ``first`` to ``later`` without twist."""
        routes, angles = self.routes, []
        for q in (first, later):
            passage = routes.passages[q]
            assert passage is not None
            entry = np.array([passage.s_enter])
            frame = routes.centreline.frame(entry, routes.route_of[[q]])[0]
            # The frame is carried along the centreline without twist, as a robot that does not roll
            # is.
            x, y, _ = routes.directions[q] @ frame
            angles.append(np.arctan2(y, x))
        return float(angles[0] - angles[1])

    def belt_sign(self, roll: Array) -> Array:
        """Direction (n, 3) in which the belts drive forward at the measured ``roll`` (n, 3) rad."""
        self._belt_sign = held_belt_sign(roll, self._band, self._belt_sign)
        return self._belt_sign

    def begin_leg(self, robot: int, turned: bool, route: int) -> None:
        """A robot drives another way from now on; ``turned``: in the other gear."""
        if turned:
            # Subtracted, not negated: a roll of 0 must not become a negative zero in the record.
            self.roll[robot] = 0.0 - self.roll[robot, SWAPPED]
            self.roll_target[robot] = -self.roll_target[robot, SWAPPED]
            self._belt_sign[robot] = self._belt_sign[robot, SWAPPED]
        self.attempts[robot], self.deadline[robot] = 0, np.inf
        self._inside[robot] = self._astride[robot] = self.squaring[robot] = False
        if self.settings.align[robot]:
            self.aligned[robot] = self.routes.first[route]

    def extend_leg(self, robot: int, shift: int) -> None:
        """Follow a robot whose leg goes on, on a route whose passages have numbers larger by
        ``shift``."""
        if self.settings.align[robot]:
            self.aligned[robot] += shift

    def square(self, robots: NDArray[np.bool_], time: Array) -> None:
        """Have ``robots`` (n,) roll the short way until their tracks face the wall; ``time`` (n,) s
        is this moment."""
        facing = np.pi * np.round(self.roll / np.pi)
        rolling = np.abs(facing - self.roll).max(axis=1) / self.robot.roll_rate
        self.roll_target = np.where(robots[:, None], facing, self.roll_target)
        self._square_by = np.where(robots, time + rolling + self._patience, self._square_by)
        self.squaring = self.squaring | robots

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

    def _ranges(self, robots: NDArray[np.intp], passage: NDArray[np.intp]) -> tuple[Array, Array]:
        """Middles and half-widths (AIMS, SIDES, m) rad of the ranges of theta5 that ``robots`` (m,)
        aim for."""
        best = np.where(
            self._astride[robots],
            preferred_theta5("tee_straight"),
            self.best[..., robots, passage],
        )
        return best, self.aim[..., robots, passage]

    def step(
        self, observation: Observation, room: Array
    ) -> tuple[NDArray[np.bool_], Sequence[Event]]:
        """Plan a roll where one is due, and move ``roll`` on; return the robots (n,) that stand
        still to roll, and the events of this step.

        Args:
            observation: of this moment.
            room: (n,) m, ``RouteMap.nose_room`` at this moment.
        """
        if np.count_nonzero(self.squaring):
            going = ~self._is_settled(observation) & (observation.time <= self._square_by)
            self.squaring = self.squaring & going
        standing = self._stand(observation, room)
        missing = self.roll_target - self.roll
        if np.count_nonzero(missing):
            self.roll += np.minimum(np.maximum(missing, -self._step), self._step)
        return standing

    def _is_settled(self, observation: Observation) -> NDArray[np.bool_]:
        """Robots (n,) whose modules have reached their ``roll_target``."""
        return np.abs(observation.roll - self.roll_target).max(axis=-1) < self._settled

    def _stand(
        self, observation: Observation, room: Array
    ) -> tuple[NDArray[np.bool_], Sequence[Event]]:
        location, events = observation.location, []
        due = (self.aligned <= location.passage) & (room <= self.robot.standing_room)
        if not np.count_nonzero(due):
            return due, ()
        # An infinite deadline says that nothing has been tried for this fitting yet.
        new = due & np.isinf(self.deadline)
        self.deadline = np.where(new, observation.time + self._patience, self.deadline)
        # The last ranges are the widest.
        best, width = self._ranges(self._rows, location.passage)
        error = np.abs(orientation_error(location.theta5, best[-1]))
        oriented = (error <= width[-1] + ROUNDING).any(axis=0)
        off_the_line = no_motion_distance(observation.roll).min(axis=-1) >= self._clear_enough
        # With the nose inside, a fitting that goes with any orientation is not worth a stop.
        inside = (room < 0) & self.makes_do[location.passage]
        decide = due & (self._is_settled(observation) | (observation.time > self.deadline))
        if location.sure is not None:
            decide &= location.sure
        good = (oriented | (inside & ~self._inside)) & off_the_line
        finished = decide & (good | (self.attempts >= self._most_attempts))
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
        location = observation.location
        theta5 = location.theta5[robots]
        plan = self._cheapest(robots, theta5, location.passage[robots])
        # All modules roll alike: against each other they would scrub instead of turning the robot.
        self.roll_target[robots] += plan.change[:, None]
        rolls = np.abs(plan.change) > self._settled[robots]
        most = self._most_attempts[robots]
        # Where no roll is needed, or none helps, no further attempt is worth the time.
        self.attempts[robots] = np.where(rolls, self.attempts[robots] + 1, most)
        rolling = np.abs(plan.change) / self.robot.roll_rate
        self.deadline[robots] = observation.time[robots] + rolling + self._patience[robots]
        return [
            self._told(int(robot), plan, i, observation, "in" if room[robot] < 0 else "before")
            for i, robot in enumerate(robots)
            if rolls[i] or not plan.exists[i]
        ]

    def _cheapest(
        self, robots: NDArray[np.intp], theta5: Array, passage: NDArray[np.intp]
    ) -> RollPlan:
        """Of the rolls to all aims with all clearances, the one that costs least, for ``robots``
        (m,)."""
        roll = self.roll_target[robots, 0]
        ratio = self.robot.lug_radius / self.routes.radius[passage]
        best, aims = self._ranges(robots, passage)
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

    def _told(
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
