"""Shapes that a fitting is made of beside its exact surface.

Solids describe its mesh; ``walls.meshes`` makes them, pipes stay free of any mesh library. Pieces
are its collision wall from primitives, as plain numbers: boxes tangent to a bore, capsules along
rims. Every facet is shifted by half its sagitta, so that the exact surface lies midway between the
facet's nearest and farthest points; the shift halves the error for the same number of pieces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose


class Solid(Protocol):
    """A closed body: ``a + b`` unites, ``a - b`` cuts away."""

    def __add__(self, other: Self, /) -> Self: ...

    def __sub__(self, other: Self, /) -> Self: ...


class Kit(Protocol):
    """Factory of solids, in the fitting frame, m.

    Attributes:
        sections: corners of a pipe's cross-section.
        overcut: m, how far solids that are cut away should reach into what is already empty.
    """

    @property
    def sections(self) -> int: ...

    @property
    def overcut(self) -> float: ...

    def cylinder(
        self,
        length: float,
        radius: float,
        end_radius: float | None = None,
        *,
        centred: bool = False,
    ) -> Solid:
        """Make a cylinder along +z from the origin, or centred there; a cone for two radii."""
        ...

    def revolved(self, outline: Array) -> Solid:
        """Revolve the closed outline (n, 2), radius and z, m, about the z axis."""
        ...

    def bend(self, mean_radius: float, angle: float, radius: float) -> Solid:
        """Sweep a disc of ``radius`` m at the origin, across +z, by ``angle`` rad towards +x about
        the axis ``mean_radius`` m away; what would lie beyond that axis is left out."""
        ...

    def loft(self, rings: Array, hub: int | None) -> Solid:
        """Loft through the closed rings (m, k, 3).

        The ends are closed by fans about corner ``hub``, which sees every other one; with None the
        last ring is joined to the first.
        """
        ...

    def moved(self, solid: Any, pose: Pose) -> Solid:
        """Return a solid that is given in the frame ``pose``."""
        ...


THICKNESS = 0.010
"""Depth of the wall pieces, m: many times what a lug moves in a step."""


@dataclass
class Pieces:
    """Boxes and capsules in a fitting's frame.

    Attributes:
        boxes: centre (3,) m, rotation (3, 3), half sizes (3,) m.
        capsules: ends of the axis (3,), (3,) m, radius m.
    """

    boxes: list[tuple[Array, Array, Array]] = field(default_factory=list)
    capsules: list[tuple[Array, Array, float]] = field(default_factory=list)

    def facet(
        self,
        point: Array,
        normal: Array,
        along: Array,
        half_width: float,
        half_length: float,
        depth: float = THICKNESS,
    ) -> None:
        """Add a box whose inner face has its centre at ``point``, facing ``-normal``, with
        ``along`` its length; it is ``depth`` m deep."""
        rotation = np.stack([normal, np.cross(along, normal), along], axis=-1)
        half = np.array([depth / 2, half_width, half_length])
        self.boxes.append((point + normal * depth / 2, rotation, half))

    def capsule(self, start: Array, end: Array, radius: float) -> None:
        """Add a capsule from ``start`` to ``end``."""
        self.capsules.append((start, end, radius))


def stave_count(radius: float, tolerance: float) -> int:
    """Least number of staves, a multiple of 4, that keep within ``tolerance`` m of a bore of
    ``radius`` m."""
    # R (1 / cos(pi / N) - 1) / 2 <= tolerance
    exact = math.pi / math.acos(1 / (1 + 2 * tolerance / radius))
    # A multiple of 4 puts staves at the fitting's axes, so that walls are symmetric about them.
    return max(8, 4 * math.ceil(exact / 4))


def sagitta(radius: float, half_angle: float) -> float:
    """Distance, m, by which a chord's tangent leaves a circle of ``radius`` m after ``half_angle``
    rad."""
    return radius * (1 / math.cos(half_angle) - 1)


@dataclass(frozen=True)
class Ring:
    """Staves around a bore.

    Attributes:
        azimuths: (N,) rad, of the staves' middles.
        face: m, distance of their faces from the axis.
        half_width: m, of their faces, wide enough for their backs to meet.
    """

    azimuths: Array
    face: float
    half_width: float

    @classmethod
    def of(cls, radius: float, staves: int) -> Ring:
        """Return a number of staves around a bore of ``radius`` m."""
        # Half of the sagitta inward: the facet's middle lies inside the circle, its edges outside.
        face = radius - sagitta(radius, math.pi / staves) / 2
        width = (face + THICKNESS) * math.tan(math.pi / staves)
        return cls(2 * np.pi * np.arange(staves) / staves, face, width)

    def add_stave(
        self, pieces: Pieces, out: Array, along: Array, ends: tuple[float, float], depth: float
    ) -> None:
        """Add the stave on the side ``out`` (3,) of an axis ``along`` (3,), between ``ends`` m from
        the origin and ``depth`` m deep; none where hardly anything is left of it."""
        start, end = ends
        if end - start > 1e-5:
            middle = self.face * out + along * (start + end) / 2
            pieces.facet(middle, out, along, self.half_width, (end - start) / 2, depth)
