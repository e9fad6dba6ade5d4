"""Features of a passage that a robot's success depends on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array, direction_of
from omnitrack_sim.pipes import Passage
from omnitrack_sim.pipes.fittings.coupling import Coupling

RELIEF = ("step", "gap", "ovality", "deposit")
"""Features of pipes as they are, which ideal ones have none of."""
FEATURES = ("friction", "pull", "climb", "lift", "turn", "sharpness", "bore", *RELIEF)
"""Of a passage, in the order of arrays:

* friction: of the walls;
* pull: force at the tail over the robot's weight;
* climb: sine of the slope by which the fitting is entered, 1 straight up;
* lift: the same of the direction to which it turns, or in which a branch opens; 0 without one;
* turn: degrees by which the way turns;
* sharpness: bore over bend radius of an elbow; of a reducer the bore's part that it loses;
* bore: over the one that the robot is made for;
* step: height of the highest edge in the way, of a joint or a bead, over that bore;
* gap: distance of the ends of two pipes, over that bore;
* ovality: difference of the longest and shortest diameter over the nominal;
* deposit: depth of the deepest bed or dent, over that bore.

Of several in one straight the largest of each counts, as a robot that passes it passes the others.
"""
STEPS, DEPOSITS, OVALS = ("weld",), ("deposit", "dent"), ("ovality",)
"""Kinds of relief that the features tell of; what has another one, or a section other than an oval,
is a kind of passage of its own."""


def kind_of(passage: Passage) -> str:
    """Return the name of a fitting's kind and of the way through it: "tee, run to branch".

    Behind it stands "relief" where it has some, or what of it no feature tells: "straight, egg".
    """
    # A cap is a straight, whose end is opened where the robot goes in there.
    kind = "straight" if passage.kind == "cap" else passage.kind
    words = [kind] if passage.words in (kind, passage.kind) else [kind, passage.words]
    fitting = passage.part.fitting
    relief = {one.kind for one in getattr(fitting, "relief", ())}
    section = getattr(fitting, "section", "circle")
    odd = sorted(relief - {*STEPS, *DEPOSITS, *OVALS})
    odd += [section] if section not in ("circle", "oval") else []
    odd += ["profile"] if getattr(fitting, "profile", None) is not None else []
    if relief or odd or section != "circle":
        words += odd or ["relief"]
    return ", ".join(words)


def relief_of(passage: Passage, nominal_bore: float) -> tuple[float, float, float, float]:
    """Return step, gap, ovality and deposit of a passage."""
    fitting = passage.part.fitting
    relief = getattr(fitting, "relief", ())
    steps = [one.height for one in relief if one.kind in STEPS]
    beds = [one.depth for one in relief if one.kind in DEPOSITS]
    ovals = [one.ratio for one in relief if one.kind in OVALS]
    ovals += [fitting.ovality] if getattr(fitting, "section", "circle") == "oval" else []
    gap = 0.0
    if isinstance(fitting, Coupling):
        gap = fitting.gap
        # The pipe behind stands in where it is narrower, or aside.
        narrower = passage.radius - fitting.port_radius(passage.leave)
        steps.append(max(narrower + fitting.offset, 0.0))
    sizes = max(steps, default=0.0), gap, max(beds, default=0.0)
    step, gap, bed = (size / nominal_bore for size in sizes)
    return step, gap, max(ovals, default=0.0), bed


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
    others = ("lift", "turn", "sharpness", *RELIEF)
    there[:, [FEATURES.index(name) for name in others]] = 0.0
    return there
