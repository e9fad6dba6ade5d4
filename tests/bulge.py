"""A kind of fitting from outside the package: a short pipe that bulges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from omnitrack_sim.pipes import (
    BORE,
    EDGE,
    FACE,
    Array,
    Axial,
    FittingTable,
    Kit,
    Pieces,
    Ring,
    Size,
    Solid,
    Unit,
    Wall,
    Z,
    check,
    clip,
    compiled,
    positive,
    put,
    stave_count,
)


@compiled
def surface(sizes, x, y, z, out):
    """The arc about (centre, length / 2) in the half plane of radius and z, or its ends."""
    radius, length, arc, centre = sizes[0], sizes[1], sizes[2], sizes[3]
    r = math.sqrt(x * x + y * y)
    ox, oy = (x / r, y / r) if r > 0.0 else (1.0, 0.0)
    across, along = r - centre, z - length / 2
    away = math.sqrt(across * across + along * along)
    if abs(along) * arc <= length / 2 * away:
        put(out, -across * ox / away, -across * oy / away, -along / away, FACE)
        return arc - away
    across, along = r - radius, z - (length if along > 0.0 else 0.0)
    d = math.copysign(math.sqrt(across * across + along * along), arc - away)
    put(out, across * ox / d, across * oy / d, along / d, EDGE)
    return d


@compiled
def span(sizes, ends, px, py, pz, ax, ay, az, out):
    """Between the port planes."""
    clip(out, -pz, -az, ends[0])
    clip(out, pz - sizes[1], az, ends[1])
    return 1.0


@dataclass(frozen=True)
class Bulge(Axial):
    """A pipe of ``length`` m whose wall is an arc, ``depth`` m wider in the middle."""

    depth: float = 0.004
    inner_diameter: float = BORE
    kind: ClassVar[str] = "bulge"
    wall: ClassVar[Wall] = Wall(surface, span)

    class Table(FittingTable):
        """Keys in files."""

        length: Annotated[Size, Unit("m", "L")]
        depth: Annotated[Size, Unit("m", "depth")] = 0.004

    def __post_init__(self) -> None:
        check(self.kind, length=positive(self.length), depth=positive(self.depth))

    @property
    def arc(self) -> float:
        """Radius of the arc, m."""
        return (self.length**2 / 4 + self.depth**2) / (2 * self.depth)

    @property
    def sizes(self) -> tuple[float, ...]:
        return self.radius, self.length, self.arc, self.radius + self.depth - self.arc

    @property
    def bounds(self) -> tuple[Array, Array]:
        r = self.radius + self.depth
        return np.array([-r, -r, 0.0]), np.array([r, r, self.length])

    def flare(self, port: str) -> float:
        return self.length / 2 / math.sqrt(self.arc**2 - self.length**2 / 4)

    def profile(self, count: int) -> tuple[Array, Array]:
        """Radius and z (count + 1,) m along the arc."""
        half = math.asin(self.length / 2 / self.arc)
        angle = np.linspace(-half, half, count + 1)
        centre = self.sizes[3]
        return centre + self.arc * np.cos(angle), self.length / 2 + self.arc * np.sin(angle)

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        widest = self.radius + self.depth
        ring = Ring.of(widest, staves or stave_count(widest, tolerance / 2))
        count = math.ceil(self.length / math.sqrt(8 * self.arc * tolerance))
        radius, z = self.profile(count)
        for k in range(count):
            run, rise = z[k + 1] - z[k], radius[k + 1] - radius[k]
            length = math.hypot(run, rise)
            middle = (radius[k] + radius[k + 1]) / 2 - (widest - ring.face) + tolerance / 4
            for u in ring.azimuths:
                out = np.array([math.cos(u), math.sin(u), 0.0])
                along, normal = (rise * out + run * Z) / length, (run * out - rise * Z) / length
                place = middle * out + (z[k] + z[k + 1]) / 2 * Z
                pieces.facet(place, normal, along, ring.half_width, length / 2)

    def fill(self, kit: Kit, more: float) -> Solid:
        radius, z = self.profile(12)
        outline = [[0.0, 0.0], *np.stack([radius + more, z], axis=-1), [0.0, self.length]]
        return kit.revolved(np.array(outline))
