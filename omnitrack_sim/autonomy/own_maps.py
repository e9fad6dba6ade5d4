"""Maps that the pictures of robots are compared with, and how estimates move as maps change."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pilots import Pilot
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Part, Port
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.walls.rays import RayWalls

MIN_SHIFT = 1e-6
"""Least shift of a part, m, that moves an estimate: lengths of a map are rounded to it."""


class OwnMaps:
    """Maps of n robots, as walls that rays meet.

    Args:
        pilots: of the robots, the caller's own list: their beliefs are the maps that they make.
        parts: of the true network, which robots share that make no map.
        caps: ports of it that a cap closes.

    Attributes:
        walls: of the maps.
        which: (n,) map of each robot.
    """

    def __init__(
        self, pilots: Sequence[Pilot], parts: Sequence[Part], caps: Collection[Port]
    ) -> None:
        self._pilots = pilots
        beliefs = [pilot.belief for pilot in pilots]
        self._networks = [None if belief is None else belief.network for belief in beliefs]
        self.which: NDArray[np.intp] = np.zeros(len(pilots), np.intp)
        maps = [(parts, caps, ())]
        if any(self._networks):
            maps = [maps[0] if belief is None else belief.reliable_parts() for belief in beliefs]
            self.which = np.arange(len(pilots))
        self.walls = RayWalls(*zip(*maps, strict=True))

    def renew(self, robot: int) -> tuple[Network, Network] | None:
        """Take a robot's map as it is now; return it before and after, None where it is the same.

        Args:
            robot: number.
        """
        belief, before = self._pilots[robot].belief, self._networks[robot]
        if belief is None or belief.network is before:
            return None
        self._networks[robot] = belief.network
        self.walls.replace(robot, *belief.reliable_parts())
        assert before is not None
        return before, belief.network


def bends_otherwise(before: Network, after: Network) -> bool:
    """Return whether a fitting has another form than on the map before, and no loop has closed.

    Where a loop has closed the robot goes another way, and lies in its pipe as it did.
    """
    changed = (a.fitting != b.fitting and not a.fitting.is_plain for a, b in _pairs(before, after))
    return _loops(after) <= _loops(before) and any(changed)


def shift_of_part(before: Network, after: Network, position: Array) -> tuple[Pose, Pose] | None:
    """Return the poses, before and after, of the part of a map that a robot is in.

    Args:
        before: map.
        after: the map as it is now.
        position: (3,) m, of the robot's centre on the map before.

    Returns:
        None where the part has not moved, or is not on both maps.
    """
    # Pipe that was taken back may have given its number to another part.
    same = [(a, b) for a, b in _pairs(before, after) if a.fitting.kind == b.fitting.kind]
    part, moved = next((pair for pair in same if pair[0].holds(position[None], 0.0)), (None, None))
    if part is None or moved is None:
        return None
    port = part.fitting.port_names[0]
    start, end = part.port(port), moved.port(port)
    return (start, end) if np.linalg.norm(end.position - start.position) > MIN_SHIFT else None


def _pairs(before: Network, after: Network) -> list[tuple[Part, Part]]:
    """Return parts of the same number."""
    return list(zip(before.pipes.parts, after.pipes.parts, strict=False))


def _loops(network: Network) -> int:
    """Return the number of loops of a network: of joints beyond those that hold it together."""
    return len(network.joints) - len(network.fittings) + 1
