"""A cap: the closed end of a pipe."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from omnitrack_sim.pipes.fittings.straight import Straight
from omnitrack_sim.pipes.shapes import Kit, Solid


@dataclass(frozen=True)
class Cap(Straight):
    """A straight pipe of ``length`` m whose port ``end`` is closed by a flat wall.

    Nothing is joined to that port; a route may start or end there.

    Example:
        >>> ot.Cap(0.2).closed_ports
        ('end',)
    """

    kind: ClassVar[str] = "cap"
    closed_ports: ClassVar[tuple[str, ...]] = ("end",)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a cylinder that closes the bore with ``more`` m of wall."""
        return kit.cylinder(self.length + more, self.radius + more)
