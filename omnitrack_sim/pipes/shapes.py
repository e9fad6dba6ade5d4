"""Shapes that a fitting is made of beside its exact surface.

Solids describe its mesh; ``walls.meshes`` makes them, pipes stay free of any mesh library. Pieces
are its collision wall from primitives, as plain numbers: boxes tangent to a bore, capsules along
rims. Every facet is shifted by half its sagitta, so that the exact surface lies midway between the
facet's nearest and farthest points; the shift halves the error for the same number of pieces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, Self

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, frame_of, unit


class Solid(Protocol):
    """A closed body: ``a + b`` unites, ``a - b`` cuts away, ``a ^ b`` keeps what both hold."""

    def __add__(self, other: Self, /) -> Self: ...

    def __sub__(self, other: Self, /) -> Self: ...

    def __xor__(self, other: Self, /) -> Self: ...


class Kit(Protocol):
    """Factory of solids, in the fitting frame, m."""

    @property
    def sections(self) -> int:
        """Corners of a pipe's cross-section."""
        ...

    @property
    def overcut(self) -> float:
        """Reach, m, of solids that are cut away into what is already empty."""
        ...

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

    def prism(self, length: float, outline: Array) -> Solid:
        """Make a prism along +z from the origin over an outline (n, 2) m, anticlockwise."""
        ...

    def revolved(self, outline: Array) -> Solid:
        """Revolve the closed outline (n, 2), radius and z, m, about the z axis."""
        ...

    def bend(self, mean_radius: float, angle: float, radius: float) -> Solid:
        """Sweep a disc of ``radius`` m at the origin, across +z, by ``angle`` rad towards +x.

        The axis is ``mean_radius`` m away; what would lie beyond it is left out.
        """
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


STRIP_ROWS = 2
"""Rows of boxes along a rim, which fill what the square-ended staves leave open: a stave's
width."""
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
        """Add a box of ``depth`` m, its inner face centred at ``point`` and facing ``-normal``.

        ``along``: its length.
        """
        rotation = frame_of(normal, along)
        half = np.array([depth / 2, half_width, half_length])
        self.boxes.append((point + normal * depth / 2, rotation, half))

    def capsule(self, start: Array, end: Array, radius: float) -> None:
        """Add a capsule from ``start`` to ``end``."""
        self.capsules.append((start, end, radius))

    def add(self, others: Pieces, pose: Pose | None = None) -> None:
        """Add other pieces, moved by a pose."""
        pose = pose or Pose()
        self.boxes += [(pose.apply(p), pose.rotation @ turn, h) for p, turn, h in others.boxes]
        self.capsules += [(pose.apply(a), pose.apply(b), r) for a, b, r in others.capsules]

    def add_strips(
        self,
        line: Array,
        axis: Array,
        radius: float,
        away: Array,
        strip: float,
        depth: float,
        extent: Callable[[Array], Array],
    ) -> None:
        """Add rows of boxes tangent to a cylinder, along the line where a rim's fillet begins.

        The cylinder's axis leads through the origin.

        Args:
            line: (k, 3) m.
            axis: (3,) unit vector.
            radius: m, of the cylinder.
            away: (k, 3), to the side of the line that the wall is on.
            strip: m, width of a row.
            depth: m, of the boxes.
            extent: ``Fitting.extent``; beyond a port the neighbour's wall takes over.
        """
        chords, middles = np.diff(line, axis=0), (line[:-1] + line[1:]) / 2
        out = unit(middles - np.outer(middles @ axis, axis))
        tangents = unit(chords - out * (chords * out).sum(axis=1)[:, None])
        beyond = np.cross(out, tangents)
        beyond *= np.sign((beyond * (away[:-1] + away[1:])).sum(axis=1))[:, None]
        # At the corners the rows are mitred: their directions, so long that neighbouring strips
        # meet.
        closed = np.allclose(line[0], line[-1])
        before = np.vstack([beyond[-1:] if closed else beyond[:1], beyond])
        after = np.vstack([beyond, beyond[:1] if closed else beyond[-1:]])
        mitre = (before + after) / (1 + (before * after).sum(axis=1))[:, None]
        for i, (middle, tangent, side) in enumerate(zip(middles, tangents, beyond, strict=True)):
            for row in range(STRIP_ROWS):
                # A mitred row is a trapezium: the longer of its two edges decides, so that no gap
                # is left.
                longest = max(
                    abs((chords[i] + d * strip * (mitre[i + 1] - mitre[i])) @ tangent)
                    for d in (row, row + 1)
                )
                half_length = 0.55 * longest
                point = middle + side * strip * (row + 0.5)
                normal = unit(point - axis * (point @ axis))
                around = np.cross(axis, normal)
                reach = strip / 2 * abs(side @ around) + half_length * abs(tangent @ around)
                face = axis * (point @ axis) + normal * (
                    radius - sagitta(radius, reach / radius) / 2
                )
                if extent(face) < 0:
                    continue
                along = unit(tangent - normal * (tangent @ normal))
                self.facet(face, normal, along, strip / 2, half_length, depth)


def stave_count(radius: float, tolerance: float) -> int:
    """Return the least number of staves, a multiple of 4, within ``tolerance`` m of a bore.

    ``radius``: m, of the bore.
    """
    # R (1 / cos(pi / N) - 1) / 2 <= tolerance
    exact = math.pi / math.acos(1 / (1 + 2 * tolerance / radius))
    # A multiple of 4 puts staves at the fitting's axes, so that walls are symmetric about them.
    return max(8, 4 * math.ceil(exact / 4))


def sagitta(radius: float, half_angle: float) -> float:
    """Return by how much, m, a tangent leaves a circle of ``radius`` m after ``half_angle`` rad."""
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
        """Add the stave on the side ``out`` (3,) of an axis ``along`` (3,), if any is left of it.

        ``ends``: m, from the origin. ``depth``: m.
        """
        start, end = ends
        if end - start > 1e-5:
            middle = self.face * out + along * (start + end) / 2
            pieces.facet(middle, out, along, self.half_width, (end - start) / 2, depth)


ARC_STEP = math.radians(15)
"""Largest angle between neighbouring points on a fillet's arc, rad."""


def rounded_rim(
    kit: Kit,
    centre: Array,
    corner: Array,
    normals: tuple[Array, Array],
    fillet: float,
    *,
    closed: bool,
) -> Solid:
    """Return what a ball rounds off the rim where two bores meet.

    Args:
        kit: makes the solid.
        centre: (m, 3) m, where the ball's centre is at each cross-section of the rim.
        corner: (m, 3) m, the bores' common edge there, a little within them.
        normals: two times (m, 3), outward from the axis of either bore at the ball's centre.
        fillet: m, radius of the ball.
        closed: whether the last cross-section is followed by the first.
    """
    one, other = normals
    between = np.arccos(np.clip((one * other).sum(axis=1), -1.0, 1.0))
    count = max(6, math.ceil(between.max() / ARC_STEP))
    weight = np.linspace(0.0, 1.0, count + 1)[:, None, None]
    turn = np.maximum(between, 1e-9)[:, None]
    # Spherical interpolation: unit vectors at even angles between the two normals.
    arc = (np.sin((1 - weight) * turn) * one + np.sin(weight * turn) * other) / np.sin(turn)
    arc = centre - fillet * arc  # (count + 1, m, 3)
    last, first = arc[-1] - kit.overcut * other, arc[0] - kit.overcut * one
    rings = np.concatenate([arc, last[None], corner[None], first[None]]).transpose(1, 0, 2)
    return kit.loft(rings, None if closed else rings.shape[1] - 2)
