"""A straight pipe along +z from the origin, and a cap, which is one with a closed end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.compiled import FACE, Wall, clip, compiled, in_bore, put
from omnitrack_sim.pipes.fittings.base import BORE, Axial, FittingTable, Z, check, positive
from omnitrack_sim.pipes.shapes import Kit, Pieces, Ring, Solid, stave_count


@compiled
def surface(sizes, x, y, _z, out):
    """See ``compiled.Wall``. Sizes: radius, length, m."""
    away = math.sqrt(x * x + y * y)
    # On the axis the gradient is undefined: any unit vector across the bore will do.
    if away < 1e-12:
        put(out, -1.0, 0.0, 0.0, FACE)
        return sizes[0]
    put(out, -x / away, -y / away, 0.0, FACE)
    return sizes[0] - away


@compiled
def span(sizes, ends, _px, _py, pz, _ax, _ay, az, out):
    """See ``compiled.Wall``: between the port planes; the wall carries a line by its two ends."""
    clip(out, -pz, -az, ends[0])
    clip(out, pz - sizes[1], az, ends[1])
    # The distance to a cylinder is concave along any line, so it has no minimum between the ends.
    return 0.0


@compiled
def clear(sizes, px, py, _pz, ax, ay, _az):
    """See ``compiled.Wall``: up to the cylinder."""
    low, high = in_bore(px, py, ax, ay, sizes[0])
    # A start in the wall has no clear length; the tracing then goes on by distances.
    return high if low < 0.0 < high else 0.0


@dataclass(frozen=True)
class Straight(Axial):
    """A straight pipe of ``length`` m.

    Example:
        >>> ot.Straight(0.5).length_of_axes
        0.5
    """

    inner_diameter: float = BORE
    kind: ClassVar[str] = "straight"
    is_plain: ClassVar[bool] = True
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(FittingTable):
        """Keys in files."""

        length: Annotated[Size, Unit("m", "L")]
        """Along the axis."""

    def __post_init__(self) -> None:
        check(self.kind, length=positive(self.length), inner_diameter=positive(self.inner_diameter))

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``surface``."""
        return self.radius, self.length

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves around the bore."""
        ring = Ring.of(self.radius, staves or stave_count(self.radius, tolerance))
        for u in ring.azimuths:
            out = np.array([math.cos(u), math.sin(u), 0.0])
            middle = ring.face * out + [0, 0, self.length / 2]
            pieces.facet(middle, out, Z, ring.half_width, self.length / 2)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a cylinder."""
        return kit.cylinder(self.length, self.radius + more)


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

    def extended(self, length: float) -> Cap:
        """See ``Fitting``: a longer cap."""
        return replace(self, length=self.length + length)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a cylinder that closes the bore with ``more`` m of wall."""
        return kit.cylinder(self.length + more, self.radius + more)
