"""Whether two runs drove through the same pipes."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.text import clipped
from omnitrack_sim.results.result import Result

SAME_PLACE = 1e-6
"""Difference of positions, m, and of rotations, within which two fittings lie alike."""
_LONGEST_NAME = 60


def other_pipes(one: Result, other: Result) -> str:
    """In what the pipes of a second run are others than those of the first one, in words; empty
    where they are the same, with the same ports closed."""
    problem = _parts_differ(one, other)
    if not problem and one.scenario.plates != other.scenario.plates:
        problem = "other ports are closed by plates"
    return f"it drove through other pipes than the first run: {problem}" if problem else ""


def _parts_differ(one: Result, other: Result) -> str:
    first, second = (run.pipes.parts for run in (one, other))
    if len(first) != len(second):
        fittings = "fitting" if len(second) == 1 else "fittings"
        return f"it has {len(second)} {fittings}, and the first run {len(first)}"
    for a, b in zip(first, second, strict=True):
        moved = np.abs(a.pose.position - b.pose.position).max() > SAME_PLACE
        turned = np.abs(a.pose.rotation - b.pose.rotation).max() > SAME_PLACE
        if a.fitting != b.fitting or moved or turned:
            names = [clipped(part.name, _LONGEST_NAME) for part in (b, a)]
            return f"{names[0]} is not {names[1]} of the first run"
    return ""
