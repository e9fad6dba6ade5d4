"""Ports of a robot's map that it has yet to explore, and those that it has given up."""

from __future__ import annotations

from collections.abc import Iterable

from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.pipes import Port


class Frontier:
    """Ports at which a robot's map ends.

    Args:
        belief: the map.

    Attributes:
        abandoned: ports that the robot has given up, and why.
    """

    def __init__(self, belief: Belief) -> None:
        self._belief = belief
        self.abandoned: dict[Port, str] = {}
        self._reopened: set[Port] = set()  # ports that have been reopened once

    @property
    def ports(self) -> list[Port]:
        """Unexplored ports, see ``Belief.unexplored``."""
        return self._belief.unexplored

    def abandon(self, end: Port, why: str) -> None:
        """Give up a port: it stays unexplored."""
        self._belief.set_end(end, "impassable")
        self._belief.set_explored(end)
        self.abandoned[end] = why

    def abandon_unreachable(self, closed: Iterable[Port]) -> None:
        """Give up all ports, none of which can be reached past those that are ``closed``."""
        names = ", ".join(self._belief.name(end) for end in dict.fromkeys(closed))
        for end in self.ports:
            self.abandon(end, f"no way past {names}" if names else "no way there is left")

    def reopen(self, closed: Iterable[Port]) -> list[Port]:
        """Reopen ports that are ``closed`` or abandoned, each once; return those reopened.

        The robot comes there from elsewhere now, and often it was a fall that stopped it.
        """
        again = [end for end in [*closed, *self.abandoned] if end not in self._reopened]
        self._reopened.update(again)
        for end in again:
            if self.abandoned.pop(end, ""):
                self._belief.set_unexplored(end)
        return again
