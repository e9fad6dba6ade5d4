"""A straight pipe along +z from the origin, and a cap, which is one with a closed end.

Its bore is a circle, or one of the other ``sections``; its wall may have ``relief``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Angle, Size, Unit
from omnitrack_sim.pipes.compiled import FACE, Wall, clip, compiled, in_bore, put
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    Axial,
    Z,
    check,
    positive,
    possible_bore,
)
from omnitrack_sim.pipes.fittings.relieved import (
    CLEAR,
    MARKED,
    OWN,
    PATCHES,
    ReliefTable,
    Relieved,
    from_relief,
    from_relief_on,
)
from omnitrack_sim.pipes.native import at, row
from omnitrack_sim.pipes.relief import Deposit
from omnitrack_sim.pipes.sections import CODES, MAX_OVALITY, Section, SectionName
from omnitrack_sim.pipes.sections import distance as from_section
from omnitrack_sim.pipes.sections import leaving as out_of_section
from omnitrack_sim.pipes.shapes import THICKNESS, Kit, Pieces, Ring, Solid, sagitta, stave_count

SECTION, OWN_SECTION = MARKED, OWN
"""Indices in the sizes of the first number of the section, 0 for a circle; of a wall with relief,
which has ``RELIEVED`` there, that is among its own numbers."""
MAX_SLOPE_DEG = 60
"""Steepest pipe that has a lowest side, degrees."""
MAX_STEEP = math.sin(math.radians(MAX_SLOPE_DEG))


@compiled
def from_bore(sizes, section, x, y, out):
    """Return the distance from the bore without relief, whose section begins at an index."""
    if sizes[section] != 0.0:
        return from_section(at(sizes, section), x, y, out)
    away = math.sqrt(x * x + y * y)
    # On the axis the gradient is undefined: any unit vector across the bore will do.
    if away < 1e-12:
        put(out, -1.0, 0.0, 0.0, FACE)
        return sizes[0]
    put(out, -x / away, -y / away, 0.0, FACE)
    return sizes[0] - away


def relieved(sizes, x, y, z, out):
    """See ``compiled.Wall``: the surface of a wall with relief."""
    if sizes[PATCHES] > 0.0:
        return from_relief_on(sizes, 0.0, x, y, z, 0.0, out)
    d = from_bore(sizes, OWN_SECTION, x, y, out)
    return from_relief_on(sizes, 0.0, x, y, z, d, out)


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``. Sizes: radius, length, m, and the numbers of the section."""
    if sizes[SECTION] < 0.0:
        return from_relief(sizes, x, y, z, out)
    return from_bore(sizes, SECTION, x, y, out)


@compiled
def span(sizes, ends, _px, _py, pz, _ax, _ay, az, out):
    """See ``compiled.Wall``: between the port planes; the wall carries a line by its two ends."""
    clip(out, -pz, -az, ends[0])
    clip(out, pz - sizes[1], az, ends[1])
    # The distance to a convex cylinder is concave along any line: no minimum between the ends.
    return 1.0 if sizes[SECTION] < 0.0 else 0.0


@compiled
def clear(sizes, px, py, _pz, ax, ay, _az):
    """See ``compiled.Wall``: up to the cylinder."""
    radius = sizes[0]
    if sizes[SECTION] > 0.0:
        return out_of_section(at(sizes, SECTION), px, py, ax, ay, row())
    if sizes[SECTION] < 0.0:
        radius = sizes[CLEAR]
    low, high = in_bore(px, py, ax, ay, radius)
    # A start in the wall has no clear length; the tracing then goes on by distances.
    return high if low < 0.0 < high else 0.0


@dataclass(frozen=True)
class Straight(Relieved, Axial):
    """A straight pipe of ``length`` m.

    Attributes:
        section: of its bore. ``inner_diameter`` is the nominal diameter of an oval, the width of an
            egg, mouth or arch; the axis is that of the largest ball in it.
        ovality: of an oval, the difference of its longest and shortest diameter over the nominal.
        direction: rad about the axis, from x, of an oval's longest diameter, or of the invert.
        relief: how its wall differs from that: a list of tables by ``kind``, such as the weld
            below; docs/reference/networks.md has the keys of each kind.
        profile: the measured wall, or the file of a scan; None without one.

    Example:
        >>> ot.Straight(0.5).length_of_axes
        0.5
        >>> welded = ot.Straight(0.5, relief=[{"kind": "weld", "at": 0.3, "height": 0.004}])
        >>> round(float(welded.signed_distance([0.07, 0.0, 0.3])[0]), 6)  # m
        0.006
        >>> round(ot.Straight(0.5, section="oval", ovality=0.05).port_radius("start"), 6)
        0.078
    """

    inner_diameter: float = BORE
    section: SectionName = "circle"
    ovality: float = 0.0
    direction: float = 0.0
    relief: Sequence[Any] = ()
    profile: Any = None
    relieved_surface: ClassVar[Any] = relieved
    kind: ClassVar[str] = "straight"
    is_plain: ClassVar[bool] = True
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(ReliefTable):
        """Keys in files."""

        length: Annotated[Size, Unit("m", "L")]
        """Along the axis."""
        # Left out of plain data where it is a circle: noise is drawn by a scenario's data.
        section: Annotated[SectionName, Field(exclude_if=lambda section: section == "circle")] = (
            "circle"
        )
        """Of the bore: "circle", "oval", or of sewers "egg", "mouth" or "arch". `inner_diameter` is
        the nominal diameter of an oval, the width of the others. Joined sections are the same."""
        ovality: Annotated[
            float, Field(ge=0, le=MAX_OVALITY, exclude_if=lambda ratio: ratio == 0), Unit("1")
        ] = 0.0
        """Of an oval: difference of its longest and shortest diameter over the nominal."""
        direction_deg: Annotated[Angle, Field(exclude_if=lambda angle: angle == 0), Unit("deg")] = (
            0.0
        )
        """Of an oval's longest diameter, or of the invert, about the axis from the x axis."""

    def __post_init__(self) -> None:
        """Check the sizes."""
        check(
            self.kind,
            length=positive(self.length),
            inner_diameter=possible_bore(self.inner_diameter),
            section=(
                self.section in CODES,
                f"is {self.section!r}; must be one of {', '.join(CODES)}",
            ),
            ovality=self._ovality_condition(),
            direction=(
                self.section != "circle" or self.direction == 0,
                f"is {math.degrees(self.direction):.6g} degrees; a circle has no direction",
            ),
        )
        self._check_relief()

    def settled(self, down: Array) -> Self:
        """See ``Fitting``: with beds on the lowest side."""
        x, y, z = down
        if not any(isinstance(one, Deposit) and one.angle_deg is None for one in self.relief):
            return self
        if abs(z) > MAX_STEEP:
            problem = f"has no angle_deg, and its pipe is over {MAX_SLOPE_DEG} degrees steep"
            raise GeometryError(Fault(f"{self.kind}.relief", f"a deposit {problem}"))
        angle = {"angle_deg": round(math.degrees(math.atan2(y, x)), 9)}
        relief = tuple(
            one.model_copy(update=angle)
            if isinstance(one, Deposit) and one.angle_deg is None
            else one
            for one in self.relief
        )
        return replace(self, relief=relief)

    def _ovality_condition(self) -> tuple[bool, str]:
        """Return the condition, for ``check``, on the ovality of its section."""
        if self.section == "oval":
            problem = f"is {self.ovality}; of an oval it must be over 0, at most {MAX_OVALITY}"
            return 0 < self.ovality <= MAX_OVALITY, problem
        return self.ovality == 0, f"is {self.ovality}; only a section 'oval' has one"

    @cached_property
    def shape(self) -> Section | None:
        """Its section; None for a circle."""
        sizes = self.inner_diameter, self.ovality, self.direction
        return None if self.section == "circle" else Section(self.section, *sizes)

    @property
    def radius(self) -> float:
        """See ``Fitting``: of the largest ball in the bore, m."""
        return self.inner_diameter / 2 if self.shape is None else self.shape.inscribed_radius

    @property
    def max_radius(self) -> float:
        """See ``Fitting``."""
        return (self.radius if self.shape is None else self.shape.max_radius) + self.widening

    @property
    def axis_length(self) -> float:
        """See ``Relieved``."""
        return self.length

    @property
    def plain_sizes(self) -> tuple[float, ...]:
        """See ``Relieved``: radius, length and section."""
        return (self.radius, self.length, *(self.shape.numbers if self.shape else (0.0,)))

    @property
    def own_numbers(self) -> tuple[float, ...]:
        """See ``Relieved``: of the section."""
        return self.shape.numbers if self.shape else ()

    def edge(self, port: str) -> Section | None:
        """See ``Fitting``."""
        if self.shape is None or port == "end":
            return self.shape
        # The port at the start has the pipe's x axis, and its y axis turned round.
        return replace(self.shape, direction=-self.direction)

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves around the bore, and pieces of what stands on it."""
        if self.add_relief(pieces, tolerance):
            return
        if self.shape is not None:
            _add_staves(pieces, self.shape, self._stave_turn(tolerance, staves), self.length)
            return
        ring = Ring.of(self.radius, staves or stave_count(self.radius, tolerance))
        for u in ring.azimuths:
            out = np.array([math.cos(u), math.sin(u), 0.0])
            middle = ring.face * out + [0, 0, self.length / 2]
            pieces.facet(middle, out, Z, ring.half_width, self.length / 2)

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``."""
        more, is_all = self.relief_count(tolerance)
        if is_all:
            return more
        if self.shape is None:
            return more + Axial.piece_count(self, tolerance, staves)
        return more + len(self.shape.normals(self._stave_turn(tolerance, staves))[0])

    def _stave_turn(self, tolerance: float, staves: int | None) -> Callable[[float], float]:
        """Return the turn, rad, of a stave by the radius of curvature that it lies along, m."""
        if staves is None:
            return lambda radius: 2 * math.acos(1 / (1 + 2 * tolerance / radius))
        return lambda radius: 2 * math.pi / staves * math.sqrt(self.inner_diameter / 2 / radius)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a cylinder."""
        return self._cylinder(kit, self.length, more)

    def _cylinder(self, kit: Kit, length: float, more: float) -> Solid:
        """Return the solid of the section and ``more`` m around it, ``length`` m long."""
        if self.patches:
            return self.lofted(kit, more, length - self.length)
        if self.shape is None:
            return kit.cylinder(length, self.radius + more)
        return kit.prism(length, self.shape.polygon(kit.sections, more))


def _add_staves(
    pieces: Pieces, shape: Section, turn: Callable[[float], float], length: float
) -> None:
    """Add boxes tangent to a section, half of their sagitta within it, along a pipe."""
    normals, turns = shape.normals(turn)
    out = shape.outward(normals)
    radii = shape.curvature_radii(normals)
    inset = np.array([sagitta(*each) / 2 for each in zip(radii, turns / 2, strict=True)])
    faces = (shape.points(normals) * out).sum(axis=1) - inset
    # Neighbouring faces meet in corners.
    beside, far = np.roll(out, -1, axis=0), np.roll(faces, -1)
    sine = out[:, 0] * beside[:, 1] - out[:, 1] * beside[:, 0]
    corner = (
        np.stack(
            [faces * beside[:, 1] - far * out[:, 1], far * out[:, 0] - faces * beside[:, 0]],
            axis=-1,
        )
        / sine[:, None]
    )
    before = np.roll(corner, 1, axis=0)
    for normal, first, last, angle in zip(out, before, corner, turns, strict=True):
        # Wide enough for their backs to meet.
        half = float(np.linalg.norm(last - first)) / 2 + THICKNESS * math.tan(angle / 2)
        face = np.append((first + last) / 2, length / 2)
        pieces.facet(face, np.append(normal, 0.0), Z, half, length / 2)


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
        return self._cylinder(kit, self.length + more, more)
