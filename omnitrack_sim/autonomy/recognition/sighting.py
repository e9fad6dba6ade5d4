"""What a recogniser gives, and what it is told of the robot's motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from omnitrack_sim.base.rotations import Array


@dataclass(frozen=True)
class Sighting:
    """What lies ahead in a straight pipe.

    The robot frame has its origin at the lens, z forward and x towards module 1. Where two
    directions are the same, as from the branch of a tee, the turn is one of them.

    Attributes:
        kind: "straight", "elbow", "tee", "wye", "reducer", "open end" or "closed end".
        enter: port by which the fitting is entered, "" without one. An elbow and a reducer are
            told as entered by `start`, which describes them whichever way they lie.
        sizes: keys of the fitting's constructor in SI units.
        distance: m, from the lens along the pipe's axis to the port plane; of "straight": how far
            is seen to be straight.
        turn: rad, angle about the robot's forward axis from the robot's x axis to the x axis of the
            port that is entered: to where an elbow bends and a branch opens, and, where a branch is
            entered, along the run (of a wye: to its `run_end`). 0 for what is round about the axis.
        covariance: (2, 2) of distance and turn, m and rad; infinite for a straight pipe.
        size_spread: standard deviation of each of the sizes.
        sure: probability of the kind and the port; what is less than `SURE` is not sure.
        aside: (2,) m, where the pipe's axis lies in the robot's frame, nearest to the lens.
        tilt: (2,) rad, by which the pipe's axis leans from the robot's towards its x and y.
    """

    kind: str
    enter: str
    sizes: dict[str, float]
    distance: float
    turn: float
    covariance: Array
    size_spread: dict[str, float]
    sure: float
    aside: Array
    tilt: Array


class Motion(NamedTuple):
    """How the camera stood when an earlier picture was taken, in its frame at the last one.

    Attributes:
        rotation: (3, 3). position: (3,) m.
    """

    rotation: Array
    position: Array


SURE = 0.95
"""Probability from which a sighting counts as sure."""
