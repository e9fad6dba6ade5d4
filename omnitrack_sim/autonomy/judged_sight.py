"""How often robots that look ahead by camera are right about what they see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnitrack_sim.autonomy.ahead import Ahead, Sight
from omnitrack_sim.autonomy.belief import alike
from omnitrack_sim.base.rotations import Array

SAME_PLACE = 0.1
"""Distance, m, within which what is seen and what is there count as the same thing."""


class JudgedSight:
    """Sight whose looks are compared with the truth, of which the robots learn nothing.

    Args:
        sight: by which n robots see. true: for each robot, what tells the truth.
    """

    def __init__(self, sight: Sight, true: Sequence[Sight | None]) -> None:
        self._sight, self._true = sight, true
        self._told, self._right = np.zeros((2, len(true)))

    def look(self, robot: int, position: Array, frame: Array) -> Ahead | None:
        """See ``Sight``."""
        seen = self._sight.look(robot, position, frame)
        true = self._true[robot]
        there = None if true is None else true.look(robot, position, frame)
        if seen is not None and there is not None:
            self._told[robot] += 1
            self._right[robot] += is_right(seen, there)
        return seen

    def figures(self, robot: int) -> dict[str, float]:
        """Return the metric of a robot's looks (docs/reference/metrics.md); nan if none."""
        told = self._told[robot]
        return {"fitting_recognition_rate": float(self._right[robot] / told) if told else np.nan}


def is_right(seen: Ahead, there: Ahead) -> bool:
    """Whether what is seen is of the kind of what is there: a fitting, an end, or, as far as is
    seen, nothing. Which of a fitting's ports is nearer counts where the ports differ."""
    if seen.fitting is None and not seen.end:
        return there.distance > seen.distance - SAME_PLACE
    if abs(seen.distance - there.distance) > SAME_PLACE or seen.end != there.end:
        return False
    if seen.fitting is None or there.fitting is None:
        return seen.fitting is there.fitting
    same = seen.fitting.kind == there.fitting.kind
    return same and alike(there.fitting, seen.enter, there.enter)
