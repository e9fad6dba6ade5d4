"""Features of a passage: what the success of a robot in it depends on."""

from __future__ import annotations

import math

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
