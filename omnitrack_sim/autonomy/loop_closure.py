"""Closing of loops in the map of a robot.

Where the robot comes to a port that its map has already, by another way, lengths, angles and turns
around the loop are adjusted by least squares, weighted by their standard deviations, so that its
ends meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from omnitrack_sim.autonomy.belief import BELIEF, Belief, are_alike
from omnitrack_sim.base.rotations import Array, angle_between, unit
from omnitrack_sim.pipes import Elbow, Fitting, Port
from omnitrack_sim.pipes.map_difference import ANGLES
from omnitrack_sim.pipes.network import CLOSES
from omnitrack_sim.pipes.planning import port_graph
from omnitrack_sim.pipes.routes import Edge


@dataclass(frozen=True)
class LoopClosureSettings:
    """Tolerances of the ends of a loop.

    Attributes:
        miss: m, by which the two ends of a loop may miss each other.
        length_std: m, standard deviation of the length of a straight that is not measured.
        surprise: squared standard deviations by which the two ends of a loop may miss each other in
            position and direction, six numbers: 99 of 100 loops do not miss by more.
        closing_std: m and rad, standard deviation of what two ports that meet are apart.
        adjustments: steps of the search for the changes that close a loop.
    """

    miss: float = 0.15
    length_std: float = 0.01
    surprise: float = 16.8
    closing_std: float = 1e-3
    adjustments: int = 3


LOOP_CLOSURE = LoopClosureSettings()


class _Variable(NamedTuple):
    """A size or turn of the map that a loop may change, m or rad.

    Attributes:
        std: its standard deviation.
        slope: (6,) derivative of position and rotation of the loop's end.
        add: adds to it.
    """

    std: float
    slope: Array
    add: Callable[[float], object]


def known_port(belief: Belief, end: Port, fitting: Fitting, enter: str) -> Port | None:
    """Return the port of the map where a fitting lies that is observed at another one.

    Args:
        belief: the map.
        end: port at which it is observed.
        fitting: as observed.
        enter: its port there.

    Returns:
        A free port that agrees in kind, position and direction; None where there is none.
    """
    places = [
        (miss, other)
        for miss, other in _coinciding(belief, end)
        if belief.fitting(other[0]).kind == fitting.kind and are_alike(fitting, enter, other[1])
    ]
    return min(places, default=(0.0, None))[1]


def meeting_ports(belief: Belief, part: int) -> list[tuple[Port, Port]]:
    """Return pairs of an unexplored port of a new part and another one at the same position."""
    free = [end for end in belief.unexplored if end[0] == part]
    pairs = [(end, min(_coinciding(belief, end), default=(0.0, None))[1]) for end in free]
    return [(end, other) for end, other in pairs if other is not None]


def close_loop(belief: Belief, end: Port, other: Port) -> tuple[float, bool]:
    """Join two ports of a map at which a loop closes.

    Returns:
        Their distance before, m, and whether they missed each other by more than the sizes and
        turns around the loop may be off by.
    """
    miss, surprise = float(np.linalg.norm(_gap(belief, end, other)[:3])), 0.0
    if miss > CLOSES / 2:
        sizes = _measured_sizes(belief)
        surprise = _adjust(belief, end, other)
        _widen_stds(belief, sizes)
    a, b = belief.port(end), belief.port(other)
    # Both joints lie where they are; the turn is what is between their x axes.
    x, y, _ = b.rotation[:, 0] @ a.rotation
    belief.join(end, other, math.degrees(math.atan2(y, x)))
    return miss, surprise > LOOP_CLOSURE.surprise


def _coinciding(belief: Belief, end: Port) -> Iterator[tuple[float, Port]]:
    """Yield unexplored ports of other parts that may be the same as ``end``.

    With their distances, m.
    """
    here = belief.port(end)
    for other in belief.unexplored:
        if other[0] == end[0]:
            continue
        there = belief.port(other)
        miss = float(np.linalg.norm(there.position - here.position))
        apart = float(angle_between(here.rotation[:, 2], -there.rotation[:, 2]))
        if miss <= LOOP_CLOSURE.miss and apart <= 2 * ANGLES:
            yield miss, other


def _loop(belief: Belief, end: Port, other: Port) -> list[Edge]:
    """Return the passages from one port to another."""
    import networkx

    graph = port_graph(belief.network)
    ports = networkx.shortest_path(graph, other, end, weight="length")
    steps = zip(ports[::2], ports[1::2], strict=True)
    return [(a[0], a[1], b[1]) for a, b in steps]


def _gap(belief: Belief, end: Port, other: Port) -> Array:
    """Return what two ports (6,) are apart that meet, m and rad."""
    here, there = belief.port(end), belief.port(other)
    turned = np.cross(here.rotation[:, 2], -there.rotation[:, 2])
    return np.concatenate([there.position - here.position, turned])


def _adjust(belief: Belief, end: Port, other: Port) -> float:
    """Adjust a loop by weighted least squares so that its ends ``end`` and ``other`` meet.

    Returns the squared standard deviations by which they missed.
    """
    total, surprise = np.zeros(len(_variables(belief, end, other))), 0.0
    for step in range(LOOP_CLOSURE.adjustments):
        variables = _variables(belief, end, other)
        std, slope = (np.array([each[i] for each in variables]) for i in (0, 1))
        # Gauss and Newton's step: the most probable changes of what was measured.
        gap, spread = _gap(belief, end, other), std[:, None] * slope
        both = spread.T @ spread + LOOP_CLOSURE.closing_std**2 * np.eye(len(gap))
        wanted = std * (spread @ np.linalg.solve(both, gap + total @ slope))
        if step == 0:
            surprise = float(gap @ np.linalg.solve(both, gap))
        for variable, more in zip(variables, (wanted - total).tolist(), strict=True):
            variable.add(more)
        total = wanted
    return surprise


def _measured_sizes(belief: Belief) -> list[tuple[int, str, float, float]]:
    """Return numbers of parts, and keys, values and standard deviations of sizes measured."""
    return [
        (part, key, getattr(fitting.fitting, key), std)
        for part, fitting in enumerate(belief.network.pipes.parts)
        for key, std in belief.stds.get(belief.part_name(part), {}).items()
    ]


def _widen_stds(belief: Belief, before: list[tuple[int, str, float, float]]) -> None:
    """Hold sizes that were other ones ``before`` to be off by as much as they have changed."""
    for part, key, size, std in before:
        moved = abs(getattr(belief.fitting(part), key) - size)
        belief.set_stds(part, **{key: max(std, moved)})


def _variables(belief: Belief, end: Port, other: Port) -> list[_Variable]:
    """Return the variables of a loop from ``other`` to ``end``."""
    parts, at = belief.network.pipes.parts, belief.port(end).position

    def swing(axis: Array, centre: Array) -> Array:
        return np.concatenate([np.cross(axis, at - centre), axis])

    found: list[_Variable] = []
    for part, enter, leave in _loop(belief, end, other):
        fitting, came, left = parts[part].fitting, *map(parts[part].port, (enter, leave))
        ahead, measured = left.rotation[:, 2], belief.stds.get(belief.part_name(part), {})
        if fitting.is_plain:
            std = measured.get("length", 0.0) or LOOP_CLOSURE.length_std
            along = np.concatenate([ahead, np.zeros(3)])
            found.append(_Variable(std, along, partial(belief.lengthen, part)))
        elif isinstance(fitting, Elbow):
            before = -came.rotation[:, 2]
            inwards = unit(ahead - before * (before @ ahead))
            middle = came.position + fitting.mean_radius * inwards
            about = swing(np.cross(before, inwards), middle)
            std = measured.get("angle", 0.0) or BELIEF.angle_std
            found.append(_Variable(std, about, partial(_bend, belief, part)))
        port = part, leave
        joint = belief.joint(port)
        # Of a round fitting the turn means nothing.
        if joint is not None and not belief.fitting(joint[1][0]).is_axial:
            about = swing(ahead, left.position)
            found.append(_Variable(BELIEF.turn_std, about, partial(belief.rotate_joint, port)))
    return found


def _bend(belief: Belief, part: int, more: float) -> None:
    elbow = belief.fitting(part)
    assert isinstance(elbow, Elbow)
    belief.resize(part, angle=elbow.angle + more)
