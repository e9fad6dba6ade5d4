"""What a robot that explores has only seen from afar: it looks at that once more from close by.

From afar both cameras tell distances by centimetres, and may take one fitting for another. What is
at the far end of a straight is therefore provisional (``Belief.provisional``) until the robot is
near.
"""

from __future__ import annotations

from omnitrack_sim.autonomy.ahead import Ahead
from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.pipes.along import Along
from omnitrack_sim.pipes.planning import Way

CLOSE_LOOK = 0.1
"""How far before what is at the end of a straight, m, a robot's front is when it looks at that
once more: from there both cameras tell distances by 1 to 2 mm."""
CLOSEST = 0.05
"""The same of the last try to do so: nearer to it, a lens sees too little of the wall before."""
LOOK_AGAIN = 0.003
"""Travel after which a robot looks again that could not tell what it saw, m."""
DOUBT_AGAIN = 0.01
"""Travel after which a robot looks again, m, that has seen one thing from afar and another from
close by."""


class LookingCloser:
    """One robot's looks at what it has only seen from afar, at the end of a straight.

    Args:
        belief: its map. half: m, from its centre to its ends.
    """

    def __init__(self, belief: Belief, half: float) -> None:
        self._belief, self._half = belief, half
        self._seen: dict[tuple[str, str], int] = {}

    def index(self, way: Way) -> int | None:
        """Place in a way of the straight with something provisional at its end."""
        parts = [part for part, _, _ in way]
        part = self._belief.provisional
        return None if part is None or part not in parts else parts.index(part)

    def begin(self, ahead: Ahead, way: Way, along: Along, distance: float) -> float | None:
        """What has just been seen at the end of a way is provisional from now on, if the way ends
        in a straight and ``distance``, m, is not close to it yet.

        Returns:
            Arc length, m, from which the robot looks at it again; None if it is not provisional.
        """
        part, close = way[-1][0], along.length - self._half - CLOSE_LOOK
        if not self._belief.fitting(part).is_plain or distance >= close - LOOK_AGAIN:
            return None
        self._belief.settle(part)
        self._seen = {_kind_of(ahead): 1}
        return close

    def doubted(self, ahead: Ahead, way: Way, along: Along, distance: float) -> float | None:
        """Where a robot looks once more, m, that sees something else from close by than from afar
        and has not seen it twice; None where it does not, or where it is too late for that."""
        if self.index(way) is None:
            return None
        kind = _kind_of(ahead)
        self._seen[kind] = self._seen.get(kind, 0) + 1
        again = distance + DOUBT_AGAIN
        return None if self._seen[kind] > 1 or self.too_late(again, way, along) else again

    def too_late(self, at: float, way: Way, along: Along) -> bool:
        """Whether arc length ``at`` m is too close to what is provisional to look at it there."""
        i = self.index(way)
        return i is not None and at > along.ends[i] - self._half - CLOSEST


def _kind_of(ahead: Ahead) -> tuple[str, str]:
    """What is seen, without its place and sizes."""
    return ("" if ahead.fitting is None else ahead.fitting.kind), ahead.end
