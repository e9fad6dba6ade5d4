"""When a robot that explores has come to see each part of its map: films show it as it grows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.sight import AT_PORT
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.trajectory import Trajectory


def found_at(
    trajectory: Trajectory, routes: Sequence[Route], half: float, sight: float
) -> NDArray[np.intp]:
    """For each part of a map the first sample at which it can have been seen; the number of samples
    for what never was.

    Args:
        trajectory: the record. routes: of each leg, through the map.
        half: m, from the robot's centre to its front. sight: m, how far ahead of that it sees.
    """
    first = np.full(len(routes[0].network.parts), len(trajectory.time))
    for leg, route in enumerate(routes):
        rows = np.flatnonzero((trajectory["leg"] == leg) & np.isfinite(trajectory["distance"]))
        front = trajectory["distance"][rows] + half
        corner = -np.inf  # where the last fitting is left, beyond which nothing is seen from before
        for passage in route.passages:
            seen = np.flatnonzero((front + sight >= passage.s_enter) & (front + AT_PORT >= corner))
            if len(seen):
                first[passage.index] = min(first[passage.index], rows[seen[0]])
            if not route.network.parts[passage.index].fitting.is_plain:
                corner = passage.s_leave
    return first
