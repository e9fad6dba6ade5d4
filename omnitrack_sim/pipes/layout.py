"""Fittings and joints of a network placed in the world, part by part from the first."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnitrack_sim.base.errors import Fault, GeometryError, NetworkError
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Assembly, Fitting, Part, attached

CLOSES = 1e-3
"""Distance by which the two ports of a joint that closes a loop may miss each other, m."""
CLOSES_ANGLE = math.radians(0.1)
"""Angle by which the axes of these two ports may miss being opposite, rad."""
End = tuple[int, str]
"""A port: index of the part and the port's name."""


def both_ways(joints: Iterable[tuple[End, End]]) -> dict[End, End]:
    """The port that each port of some joints is joined to."""
    return {port: other for a, b in joints for port, other in ((a, b), (b, a))}


@dataclass(frozen=True)
class Joined:
    """Two ports in one place.

    Attributes:
        ends: the two ports.
        turn: rad, by which the part that is placed later is turned about the joint's axis.
    """

    ends: tuple[End, End]
    turn: float = 0.0


def lay_out(fittings: Mapping[str, Fitting], joints: Sequence[Joined], first: Pose) -> Assembly:
    """Place the fittings along the joints, breadth first.

    Args:
        fittings: by name, in order. joints: ports that exist, each in one joint at most.
        first: frame of the first port of the first fitting, z into the pipe, world frame.

    Raises:
        NetworkError: parts that hang on nothing, loops that do not close, bores that differ, parts
            that run into each other. Every fault is told.
    """
    names, kinds = list(fittings), list(fittings.values())
    poses, used = _placed(kinds, joints, first)
    faults = [
        Fault(f"fittings.{i}", f"{name!r} is not connected to {names[0]!r}")
        for i, name in enumerate(names)
        if i not in poses
    ]
    parts = {i: Part(names[i], kinds[i], poses[i]) for i in sorted(poses)}
    for k, joint in enumerate(joints):
        if k not in used and joint.ends[0][0] in parts:
            faults += _misses(k, joint, parts)
    # Parts that hang on nothing have no place; the others are checked against each other all the
    # same.
    order = {i: place for place, i in enumerate(parts)}
    kept = [
        ((order[i], p), (order[j], q))
        for (i, p), (j, q) in (joint.ends for joint in joints)
        if i in order
    ]
    try:
        network = Assembly(tuple(parts.values()), tuple(kept))
    except GeometryError as error:
        raise NetworkError([*faults, *_in_file(error.faults, list(order))]) from None
    if faults:
        raise NetworkError(faults)
    return network


def lay_out_unchecked(
    fittings: Mapping[str, Fitting], joints: Sequence[Joined], first: Pose
) -> Assembly:
    """As ``lay_out``, of fittings that all hang together, whether or not they fit: pipes as a robot
    believes them to be."""
    poses, _ = _placed(list(fittings.values()), joints, first)
    parts = [Part(name, kind, poses[i]) for i, (name, kind) in enumerate(fittings.items())]
    return Assembly.unchecked(tuple(parts), tuple(joint.ends for joint in joints))


def _placed(
    kinds: Sequence[Fitting], joints: Sequence[Joined], first: Pose
) -> tuple[dict[int, Pose], set[int]]:
    """Poses by part, and the joints that placed a part; the others close loops or lie apart from
    the first part."""
    at_part: list[list[tuple[int, Joined, End, End]]] = [[] for _ in kinds]
    for k, joint in enumerate(joints):
        for here, there in (joint.ends, joint.ends[::-1]):
            at_part[here[0]].append((k, joint, here, there))
    poses = {0: attached(first, kinds[0], kinds[0].port_names[0], 0.0)}
    used: set[int] = set()
    queue = deque([0])
    while queue:
        part = queue.popleft()
        for k, joint, (here, port), (there, other) in at_part[part]:
            if there not in poses:
                poses[there] = attached(
                    poses[here] @ kinds[here].ports[port], kinds[there], other, joint.turn
                )
                used.add(k)
                queue.append(there)
    return poses, used


def _misses(k: int, joint: Joined, parts: Mapping[int, Part]) -> list[Fault]:
    """The fault of a loop that does not close."""
    (i, port_i), (j, port_j) = joint.ends
    a, b = parts[i].port(port_i), parts[j].port(port_j)
    gap = float(np.linalg.norm(a.position - b.position))
    # As chord, not cosine: exact for small angles.
    chord = float(np.linalg.norm(a.rotation[:, 2] + b.rotation[:, 2]))
    angle = 2 * math.asin(min(1.0, chord / 2))
    if gap <= CLOSES and angle <= CLOSES_ANGLE:
        return []
    ends = f"{parts[i].name}.{port_i} and {parts[j].name}.{port_j}"
    problem = (
        f"does not close the loop: {ends} miss by {1e3 * gap:.3f} mm and "
        f"{math.degrees(angle):.3f} degrees"
    )
    return [Fault(f"joints.{k}", problem)]


def _in_file(faults: Iterable[Fault], order: Sequence[int]) -> list[Fault]:
    """Faults of ``Assembly`` with the paths of a network file.

    ``order``: for each part, its place in the file.
    """

    def renamed(text: str) -> str:
        return re.sub(r"\bpipes\.(\d+)", lambda match: f"fittings.{order[int(match[1])]}", text)

    return [
        replace(fault, where=renamed(fault.where), problem=renamed(fault.problem))
        for fault in faults
    ]
