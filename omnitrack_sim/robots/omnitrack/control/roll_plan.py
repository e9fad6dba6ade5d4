"""The shortest roll of the modules into a range of theta5 and off the no-motion line.

Rolling all modules by phi turns the robot by -phi r / R. With R / r = 2.9 a third of a turn of the
robot costs nearly a whole turn of the modules, so the three equal orientations have almost the same
roll and picking another one does not leave the no-motion line; the width of the safe range does
(11.73 degrees of theta5 are 34 degrees of roll).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, wrap_angle
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.robots.omnitrack.control.orientation import orientation_error
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign, turn_from_roll

NO_MOTION_MARGIN = np.radians(30.0)
"""Default least distance of a roll from the no-motion line, rad.

There both tracks of a module touch and work against each other.
"""
TURN_LIMIT = np.pi
"""Default limit of the robot's turn in one plan, rad.

Half a turn either way reaches every equal orientation.
"""
ROUNDING = 1e-9  # rad, by which a plan may lie outside the border of a range


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
