"""A straight pipe along +z from the origin, and a cap, which is one with a closed end.

Its bore is a circle, or one of the other ``sections``; its wall may have ``relief``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BeforeValidator, Field, SerializeAsAny

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.reading import by_kind
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Angle, Size, Unit
from omnitrack_sim.pipes.compiled import FACE, Wall, clip, compiled, in_bore, put
from omnitrack_sim.pipes.fittings.base import (
    ADDRESS,
    BORE,
    Axial,
    FittingTable,
    Z,
    check,
    positive,
    possible_bore,
)
from omnitrack_sim.pipes.heights import Patch, numbers_of, total_height
from omnitrack_sim.pipes.heights import distance as from_heights
from omnitrack_sim.pipes.native import SIGNATURES, at, c_function, call_surface, row, scratch
from omnitrack_sim.pipes.obstacles import PLACED, Obstacle
from omnitrack_sim.pipes.obstacles import nearest as nearest_obstacle
from omnitrack_sim.pipes.profile import Profile, load_profile
from omnitrack_sim.pipes.relief import MAX_RELIEF, Deposit, Relief, relief_kind
from omnitrack_sim.pipes.sections import CODES, MAX_OVALITY, Section, SectionName
from omnitrack_sim.pipes.sections import distance as from_section
from omnitrack_sim.pipes.sections import leaving as out_of_section
from omnitrack_sim.pipes.shapes import THICKNESS, Kit, Pieces, Ring, Solid, sagitta, stave_count

SECTION = 2
"""Index in the sizes of the first number of the section: 0 for a circle, ``RELIEVED`` for a wall
with relief."""
RELIEVED = -1.0
CLEAR, OBSTACLES, PATCHES, OWN_SECTION, SOLIDS = 4, 5, 6, 7, 12
"""Indices in the sizes of a wall with relief, after the address of ``relieved``: radius of the
cylinder that is clear of relief, m; numbers of solids and of patches of height; the section's
numbers; where the solids begin, which the patches follow."""
MAX_SLOPE_DEG = 60
"""Steepest pipe that has a lowest side, degrees."""
MAX_STEEP = math.sin(math.radians(MAX_SLOPE_DEG))


@compiled
def _from_bore(sizes, section, x, y, out):
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
    count, patches = int(sizes[OBSTACLES]), int(sizes[PATCHES])
    if patches > 0:
        numbers = at(sizes, SOLIDS + PLACED * count)
        d = from_heights(numbers, patches, sizes[0], x, y, z, scratch(), out)
    else:
        d = _from_bore(sizes, OWN_SECTION, x, y, out)
    return nearest_obstacle(at(sizes, SOLIDS), count, 0.0, x, y, z, d, out)


@compiled
def from_relief(sizes, x, y, z, out):
    """Call ``relieved`` by its address, so that what every wheel in a plain pipe calls is small."""
    return call_surface(int(sizes[ADDRESS]), sizes, x, y, z, out)


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``. Sizes: radius, length, m, and the numbers of the section."""
    if sizes[SECTION] < 0.0:
        return from_relief(sizes, x, y, z, out)
    return _from_bore(sizes, SECTION, x, y, out)


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
class Straight(Axial):
    """A straight pipe of ``length`` m.

    Attributes:
        section: of its bore. ``inner_diameter`` is the nominal diameter of an oval, the width of an
            egg, mouth or arch; the axis is that of the largest ball in it.
        ovality: of an oval, the difference of its longest and shortest diameter over the nominal.
        direction: rad about the axis, from x, of an oval's longest diameter, or of the invert.
        relief: how its wall differs from that: tables, or plain data of them.

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
    kind: ClassVar[str] = "straight"
    is_plain: ClassVar[bool] = True
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(FittingTable):
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
        relief: Annotated[
            tuple[Annotated[SerializeAsAny[Relief], by_kind(relief_kind, strict=True)], ...],
            # Pipes of a scenario come as lists of Python, which strict tuples are not.
            BeforeValidator(lambda relief: tuple(relief) if isinstance(relief, list) else relief),
            Field(max_length=MAX_RELIEF, exclude_if=lambda relief: not relief),
        ] = ()
        """How the wall differs from the bore, such as by beads of welds: a list of tables, by
        `kind`. It ends within the pipe: the ports stay as they are."""
        profile: Annotated[Profile | None, Field(exclude_if=lambda profile: profile is None)] = None
        """The measured wall: a CSV file of rays, length by angle by radius."""

    def __post_init__(self) -> None:
        """Check the sizes."""
        tables = tuple(
            relief_kind(str(one.get("kind"))).model_validate(one)
            if isinstance(one, Mapping)
            else one
            for one in self.relief
        )
        object.__setattr__(self, "relief", tables)
        object.__setattr__(self, "profile", _profile_of(self.profile))
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
        faults = [
            Fault(f"{self.kind}.relief.{i}.{key}", problem)
            for i, one in enumerate(self.relief)
            for key, problem in one.problems(self)
        ]
        if self.profile is not None:
            where = f"{self.kind}.profile"
            faults += [Fault(where, problem) for problem in self.profile.problems(self)]
        if faults:
            raise GeometryError(faults)

    def to_table(self) -> dict[str, Any]:
        """See ``Fitting``."""
        table = super().to_table()
        relief = [one.model_dump(exclude_none=True) for one in table.pop("relief")]
        profile = table.pop("profile")
        table |= {"relief": relief} if relief else {}
        return table | ({} if profile is None else {"profile": profile.model_dump()})

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
        return (self.radius if self.shape is None else self.shape.max_radius) + self._widening

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """See ``Fitting``."""
        return self._obstacles

    @cached_property
    def _obstacles(self) -> tuple[Obstacle, ...]:
        solids = (one.obstacle(self) for one in self.relief)
        return tuple(solid for solid in solids if solid is not None)

    @property
    def bumps(self) -> float:
        """See ``Fitting``."""
        return min((patch.width for patch in self.patches if patch.bulges), default=0.0)

    @property
    def waves(self) -> float:
        """See ``Fitting``."""
        return min((patch.width for patch in self.patches), default=0.0)

    @cached_property
    def patches(self) -> tuple[Patch, ...]:
        """Heights of its wall over the bore."""
        measured = () if self.profile is None else (self.profile.patch(self),)
        patches = (one.patch(self) for one in self.relief)
        return (*measured, *(patch for patch in patches if patch is not None))

    @cached_property
    def _widening(self) -> float:
        """Depth, m, of the deepest place of its wall outside of the bore."""
        totals = [total_height(self.patches, patch.nodes) for patch in self.patches]
        return max([0.0, *(-float(total.min()) for total in totals)])

    def edge(self, port: str) -> Section | None:
        """See ``Fitting``."""
        if self.shape is None or port == "end":
            return self.shape
        # The port at the start has the pipe's x axis, and its y axis turned round.
        return replace(self.shape, direction=-self.direction)

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``surface``, and of walls with relief ``CLEAR``."""
        return self._sizes_with_relief if self.relief or self.profile else self._plain_sizes

    @property
    def wall_sizes(self) -> tuple[float, ...]:
        """See ``Fitting``."""
        return self._sizes_of_patches if self.patches else self._plain_sizes

    @property
    def _plain_sizes(self) -> tuple[float, ...]:
        return (self.radius, self.length, *(self.shape.numbers if self.shape else (0.0,)))

    @cached_property
    def _sizes_with_relief(self) -> tuple[float, ...]:
        return self._sizes(self.obstacles)

    @cached_property
    def _sizes_of_patches(self) -> tuple[float, ...]:
        return self._sizes(())

    def _sizes(self, obstacles: tuple[Obstacle, ...]) -> tuple[float, ...]:
        """Return the sizes of a wall with relief."""
        patches = numbers_of(self.patches, self.radius)
        # The third of the distance of two nodes that a height may rise between them is some um.
        high = -min([0.0, *(-total_height(self.patches, p.nodes).max() for p in self.patches)])
        clear = min([self.radius - 1.02 * high, *(solid.clear for solid in obstacles)])
        section = self.shape.numbers if self.shape else (0.0,) * (SOLIDS - OWN_SECTION)
        address = float(c_function(relieved, SIGNATURES["surface"]).address)
        counts = len(obstacles), len(self.patches)
        placed = [number for solid in obstacles for number in solid.placed]
        head = (self.radius, self.length, RELIEVED, address, clear, *counts, *section)
        return (*head, *placed, *patches.tolist())

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves around the bore, and pieces of what stands on it."""
        for solid in self.obstacles:
            solid.add_pieces(pieces, self.axis_frame(solid.s), tolerance)
        if self.patches:
            self._add_facets(pieces, tolerance)
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
        more = sum(solid.piece_count(tolerance) for solid in self.obstacles)
        if self.patches:
            return more + math.prod(self._facets(tolerance))
        if self.shape is None:
            return more + super().piece_count(tolerance, staves)
        return more + len(self.shape.normals(self._stave_turn(tolerance, staves))[0])

    def _facets(self, tolerance: float) -> tuple[int, int]:
        """Return the numbers of facets along the pipe and round it."""
        bend = max(patch.bend(self.radius) for patch in self.patches)
        around = math.ceil(
            2 * math.pi * self.radius * math.sqrt((bend + 1 / self.radius) / tolerance / 16)
        )
        return math.ceil(self.length * math.sqrt(bend / tolerance / 16)), max(16, around)

    def _add_facets(self, pieces: Pieces, tolerance: float) -> None:
        """Add boxes tangent to the wall in the middle of the cells of a grid."""
        rows, columns = self._facets(tolerance)
        s = (np.arange(rows) + 0.5) * self.length / rows
        angles = 2 * np.pi * np.arange(columns) / columns
        places = np.stack(np.meshgrid(s, angles, indexing="ij"), axis=-1).reshape(-1, 2)
        points = self._on_wall(places)
        normals = -self.signed_distance(points)[1]
        half = self.length / rows / 2, math.pi * self.max_radius / columns
        for point, normal in zip(points, normals, strict=True):
            along = Z - normal * normal[2]
            reach = half[0] / float(np.linalg.norm(along)), half[1]
            pieces.facet(point, normal, along, reach[1], reach[0])

    def _on_wall(self, places: Array) -> Array:
        """Return points (k, 3) m of the wall at places (k, 2): m along the pipe, rad round it."""
        r = self.radius - total_height(self.patches, places)
        return np.stack([r * np.cos(places[:, 1]), r * np.sin(places[:, 1]), places[:, 0]], axis=-1)

    def _stave_turn(self, tolerance: float, staves: int | None) -> Callable[[float], float]:
        """Return the turn, rad, of a stave by the radius of curvature that it lies along, m."""
        if staves is None:
            return lambda radius: 2 * math.acos(1 / (1 + 2 * tolerance / radius))
        return lambda radius: 2 * math.pi / staves * math.sqrt(self.inner_diameter / 2 / radius)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a cylinder."""
        return self._cylinder(kit, self.length, more)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``: without what stands in it."""
        bore: Any = super().bore(kit)
        for solid in self.obstacles:
            bore -= kit.moved(solid.solid(kit), solid.pose(self.axis_frame(solid.s)))
        return bore

    def _lofted(self, kit: Kit, length: float, more: float) -> Solid:
        """Return the solid of a wall of heights and ``more`` m around it."""
        columns = max(kit.sections, *(round(2 * math.pi / patch.step) for patch in self.patches))
        nodes = [
            patch.begin + patch.spacing * np.arange(len(patch.coefficients))
            for patch in self.patches
        ]
        rows = np.concatenate([[0.0, self.length], *nodes])
        rows = np.unique(rows[(rows >= 0) & (rows <= self.length)].round(4))
        angles = 2 * np.pi * np.arange(columns) / columns
        places = np.stack(np.meshgrid(rows, angles, indexing="ij"), axis=-1)
        r = self.radius - total_height(self.patches, places) + more
        heights = np.broadcast_to(places[..., 0], r.shape).copy()
        heights[-1] = length
        rings = np.stack([r * np.cos(places[..., 1]), r * np.sin(places[..., 1]), heights], axis=-1)
        return kit.loft(rings, 0)

    def _cylinder(self, kit: Kit, length: float, more: float) -> Solid:
        """Return the solid of the section and ``more`` m around it, ``length`` m long."""
        if self.patches:
            return self._lofted(kit, length, more)
        if self.shape is None:
            return kit.cylinder(length, self.radius + more)
        return kit.prism(length, self.shape.polygon(kit.sections, more))


def _profile_of(given: Any) -> Profile | None:
    """Return a measured wall, or that of a file or a table."""
    if isinstance(given, str | Path):
        return load_profile(given)
    return Profile.model_validate(given) if isinstance(given, Mapping) else given


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
