"""Features of a passage that a robot's success depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array, direction_of
from omnitrack_sim.pipes import Passage

FEATURES = ("friction", "pull", "climb", "lift", "turn", "sharpness", "bore")
"""Of a passage, in the order of arrays:

* friction: of the walls;
* pull: force at the tail over the robot's weight;
* climb: sine of the slope by which the fitting is entered, 1 straight up;
* lift: the same of the direction to which it turns, or in which a branch opens; 0 without one;
* turn: degrees by which the way turns;
* sharpness: bore over bend radius of an elbow; of a reducer the bore's part that it loses;
* bore: over the one that the robot is made for.
"""


def kind_of(passage: Passage) -> str:
    """Return the name of a fitting's kind and of the way through it: "tee, run to branch"."""
    if passage.kind == "cap":  # a straight, whose end is opened where the robot goes in there
        return "straight"
    return passage.kind if passage.words == passage.kind else f"{passage.kind}, {passage.words}"


def slopes_of(passage: Passage, gravity: Array) -> tuple[float, float, float]:
    """Return climb and lift of a passage, and the sine of the slope by which it is left.

    Args:
        passage: of parts that are placed in the world.
        gravity: (3,) m/s², world frame; without any nothing climbs.
    """
    if not np.any(gravity):
        return 0.0, 0.0, 0.0
    up = -direction_of(gravity)
    first, *_, last = [*passage.part.segments(passage.curve)] * 2
    angle = last.length * last.curvature
    leave = last.tangent * math.cos(angle) + last.normal * math.sin(angle)
    turns = passage.asks_orientation
    lift = float(up @ passage.turn_direction) if turns else 0.0
    return float(up @ first.tangent), lift, float(up @ leave)


def shape_of(passage: Passage, nominal_bore: float) -> tuple[float, float, float]:
    """Return turn, sharpness and bore of a passage."""
    turn = math.degrees(passage.description.turn_angle) if passage.is_turn else 0.0
    entry, exit_ = passage.radius, passage.part.fitting.port_radius(passage.leave)
    # From branch to branch a cross leads through its run, which may be wider than both.
    if max(entry, exit_) < passage.part.fitting.radius:
        exit_ = passage.part.fitting.radius
    # Round the corner of a branch the arc is the controller's, not the pipe's.
    bend = 2 * entry / passage.bend_radius if passage.kind == "elbow" else 0.0
    return turn, bend + 1 - exit_ / entry, 2 * entry / nominal_bore


@dataclass(frozen=True)
class Tried:
    """Ranges that the trials of a passport are drawn from.

    Attributes:
        friction: of the walls.
        pull: largest pull, robot weights.
        spread: standard deviation of the normal distribution of the pulls, of which the half below
            0 is none: tethers pull little on most of a way, and many robots have none.
    """

    friction: tuple[float, float] = (0.3, 1.0)
    pull: float = 6.0
    spread: float = 2.0


TRIED = Tried()


def as_straights(points: Array) -> Array:
    """Return points (n, features) of straights with the friction, pull, climb and bore of others.

    Args:
        points: (n, features) of any passages.
    """
    there = points.copy()
    there[:, [FEATURES.index(name) for name in ("lift", "turn", "sharpness")]] = 0.0
    return there
