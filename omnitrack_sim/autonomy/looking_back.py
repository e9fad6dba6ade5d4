"""Where a robot that explores is past a fitting: it looks back at that.

Round a bend a robot knows least how far it has come, and sees that best when the bend is just
behind it.
"""

from __future__ import annotations

import math

from omnitrack_sim.autonomy.ahead import Ahead
from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.pipes.along import Along
from omnitrack_sim.pipes.planning import Way

BACK = 0.1
"""How far from a fitting behind it a robot's back is when it looks at that, m."""
BACK_AGAIN = 0.01
"""Travel after which it does so again, m, where it could not tell."""
LEANS = math.radians(4)
"""No robot leans by more in a straight pipe: what says so has taken one thing for another."""
CLEAR = 0.01
"""Standard deviation, m, up to which it relies on how far what is behind it is."""
FAR_OFF = 0.1
"""By how much it may be wrong about how far it has come, m: what says more has to say so twice."""
AGREE = 0.02
"""Difference of two such looks that say the same, m."""


class LookingBack:
    """One robot's looks at what it has passed, one in each straight behind a fitting.

    Args:
        belief: its map. half: m, from its centre to its ends.
        sure: probability from which on it believes what it sees.
    """

    def __init__(self, belief: Belief, half: float, sure: float) -> None:
        self._belief, self._half, self._sure = belief, half, sure
        self._done: set[int] = set()
        self._again, self._shift = 0.0, math.inf

    def begin(self) -> None:
        """It begins another leg."""
        self._again = 0.0

    def at(self, way: Way, along: Along) -> float:
        """Arc length on a way, m, where it looks back next; infinite where it does not any more."""
        for i, (part, _, _) in enumerate(way):
            if i and part not in self._done and self._belief.fitting(part).is_plain:
                at = max(along.begins[i] + self._half + BACK, self._again)
                if at < along.ends[i] - self._half:
                    return at
        return math.inf

    def placed(self, way: Way, along: Along, distance: float, behind: Ahead | None) -> float:
        """Where it is along a way, m, by what it has seen behind it; ``distance``, where it takes
        itself to be, where that does not tell well."""
        i = along.at(distance)
        self._again = distance + BACK_AGAIN
        if i == 0 or behind is None or not self._tells(way, i, behind):
            return distance
        placed = along.begins[i] + behind.distance
        shift, before = placed - distance, self._shift
        self._shift = shift
        if abs(shift) > FAR_OFF and abs(shift - before) > AGREE:
            return distance
        self._done.add(way[i][0])
        return placed

    def _tells(self, way: Way, i: int, behind: Ahead) -> bool:
        """Whether what is seen behind the robot, in part ``i`` of its way, is the part before."""
        if behind.fitting is None or behind.sure < self._sure or behind.axis[2] < math.cos(LEANS):
            return False
        here, passed = (self._belief.fitting(way[j][0]) for j in (i, i - 1))
        right = behind.fitting.kind == passed.kind and behind.distance_std <= CLEAR
        return right and here.is_plain
