"""Where in a network a robot lies, found from its pose alone, whatever way it was sent."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import permutations
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array, dot, length
from omnitrack_sim.pipes import Arcs, Assembly, Part

ALONG = math.radians(30)
"""Angle between a robot and the axis of its pipe, rad, up to which it lies along the pipe; beyond
it the robot lies across."""
ACROSS = math.radians(80)
"""Angle beyond which it is not known which way round the robot lies, rad."""
BESIDE = 0.5
"""Largest distance of the centre of a robot that lies in a pipe from the pipe's axis, in bore
radii."""


class Whereabouts(NamedTuple):
    """A robot in a part of a network, between two of its ports.

    Attributes:
        part: index of the part that the robot's centre is in.
        behind, ahead: ports that its tail and its nose point to.
        passed, left: m, arc length from the port behind to the robot's centre, and from there to
            the port ahead.
        across: whether it lies across the pipe rather than along it.
    """

    part: int
    behind: str
    ahead: str
    passed: float
    left: float
    across: bool = False


def whereabouts(
    pipes: Assembly, position: Array, axis: Array, robot_length: float, arcs: Arcs
) -> Whereabouts | None:
    """Where a robot lies; None where its nose, centre or tail is out of all bores, beyond an open
    end, or where it lies across a fitting and along none of its axes.

    Args:
        pipes: the network. arcs: of the centreline in tees.
        position: (3,) m, of the robot's centre, world frame. axis: (3,) unit vector to its nose.
        robot_length: m.
    """
    ends = position + robot_length / 2 * np.array([[-1.0], [0.0], [1.0]]) * axis
    if pipes.signed_distance(ends)[0].min() <= 0:
        return None
    centre = position[None]
    around = [
        found
        for index, part in enumerate(pipes.parts)
        if part.holds(centre, 0.0)
        for found in _passages(index, part, centre, axis[None], arcs)
    ]
    # Where it lies straight in a run, it is not about to turn.
    return min(around, key=lambda found: found[0], default=(0.0, None))[1]


def _passages(
    index: int, part: Part, centre: Array, axis: Array, arcs: Arcs
) -> Iterator[tuple[float, Whereabouts]]:
    """The ways through a part that a robot with its centre (1, 3) m in it lies along, nose towards
    the port ahead, each with the angle by which it turns, rad."""
    fitting = part.fitting
    # In a pipe without a branch nothing turns a robot that lies across.
    turns = len(fitting.port_names) > 2
    for behind, ahead in permutations(fitting.port_names, 2):
        line = part.axis(behind, ahead, arcs)
        passed = line.locate(centre)
        point, tangent = line.at(passed)[:2]
        beside = float(length(centre - point)[0]) / fitting.port_radius(behind)
        cosine = float(dot(axis, tangent)[0])
        across = cosine < math.cos(ALONG)
        if beside <= BESIDE and cosine >= math.cos(ACROSS if turns else ALONG):
            along = float(passed[0])
            found = Whereabouts(index, behind, ahead, along, line.length - along, across)
            yield fitting.describe(behind, ahead).turn_angle, found
