"""The map of a replay: the axes of all pipes in one plane, as in the map of films."""

from __future__ import annotations

from typing import Any

import numpy as np

from omnitrack_sim.results.result import Result
from omnitrack_sim.show.film.inset import BESIDE, axis_lines, needs_map, projection
from omnitrack_sim.show.replay.packing import rounded


def map_table(result: Result) -> dict[str, Any] | None:
    """Pieces of the pipes' axes from the farthest to the nearest, goals and plates, in m to the
    right and up; None where the route is too short to need a map."""
    if not needs_map(result.routes()):
        return None
    view = projection(result.pipes)
    pieces = [
        (part.fitting.radius, line[i : i + 2])
        for part in result.pipes.parts
        for line in axis_lines(part)
        for i in range(len(line) - 1)
    ]
    depth = [float((piece @ view[:, 2]).mean()) for _, piece in pieces]
    flat = view[:, :2]
    return {
        "beside": BESIDE,
        "view": rounded(flat.T, 7),
        "pieces": [
            [round(pieces[i][0], 4), *rounded(pieces[i][1] @ flat, 4)]
            for i in np.argsort(depth, kind="stable")
        ],
        "goals": rounded(result.goal_points() @ flat, 4),
        "plates": [rounded(rim @ flat, 4) for rim in result.plate_rims()],
    }
