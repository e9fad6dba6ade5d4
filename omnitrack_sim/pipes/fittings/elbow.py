"""A bend: enters along +z at the origin and bends towards +x."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.compiled import FACE, Wall, clip, compiled, put
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    MILLIMETRES,
    Arcs,
    AxisCurve,
    Description,
    X,
    Z,
    check,
    port_pose,
    possible_bore,
)
from omnitrack_sim.pipes.fittings.relieved import (
    MARKED,
    OWN,
    PATCHES,
    ReliefTable,
    Relieved,
    from_relief,
    from_relief_on,
)
from omnitrack_sim.pipes.shapes import THICKNESS, Kit, Pieces, Ring, Solid, sagitta, stave_count

SIDE_SLIP = 4e-4
"""Distance, m, by which a piece of an elbow's side may leave its row."""
MOUTH_OVERLAP = 1e-6
"""Depth, m, from which a bore goes straight on beyond its ports: any deeper it leaves the bend."""
MAX_BEND = 1000.0
"""Mean radius in bores beyond which it was meant in millimetres: steel pipes bend by as much when
they are laid."""


@compiled
def from_torus(sizes, x, y, z, out):
    """Return the distance from the bore without relief."""
    radius, mean_radius = sizes[0], sizes[1]
    # The axis circle lies in the plane y = 0 with its centre at (mean_radius, 0, 0).
    px = x - mean_radius
    from_axis = math.sqrt(px * px + z * z)
    # On the axis of the bend every direction is as good; the one towards the entry is taken.
    ox, oz = (px / from_axis, z / from_axis) if from_axis > 0.0 else (-1.0, 0.0)
    across = from_axis - mean_radius
    away = math.sqrt(across * across + y * y)
    # On the centreline the gradient is undefined: any unit vector across the bore will do.
    if away < 1e-12:
        put(out, -1.0, 0.0, 0.0, FACE)
        return radius
    put(out, -across * ox / away, -y / away, -across * oz / away, FACE)
    return radius - away


def relieved(sizes, x, y, z, out):
    """See ``compiled.Wall``: the surface of a wall with relief."""
    d = 0.0 if sizes[PATCHES] > 0.0 else from_torus(sizes, x, y, z, out)
    return from_relief_on(sizes, 1.0 / sizes[1], x, y, z, d, out)


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``. Sizes: radius, mean radius, m, sine and cosine of the angle."""
    if sizes[MARKED] < 0.0:
        return from_relief(sizes, x, y, z, out)
    return from_torus(sizes, x, y, z, out)


@compiled
def span(sizes, ends, px, _py, pz, ax, _ay, az, out):
    """See ``compiled.Wall``: between the port planes."""
    a, b, c = sizes[1], sizes[2], sizes[3]
    if b < 0.0:
        b, c = sizes[OWN], sizes[OWN + 1]
    clip(out, -pz, -az, ends[0])
    # The second port plane contains the axis of the bend and is turned about it by the angle.
    clip(out, (px - a) * b + pz * c, ax * b + az * c, ends[1])
    return 1.0


@dataclass(frozen=True)
class Elbow(Relieved):
    """A bend of ``angle`` rad, at most pi, with its axis on a circle of ``mean_radius`` m.

    The radius is at least that of the bore.

    Attributes:
        relief: how its wall differs from its bore: tables, or plain data of them.
        profile: the measured wall, or the file of a scan; None without one.

    Example:
        >>> round(ot.Elbow(0.24).length_of_axes, 3)
        0.377
    """

    mean_radius: float
    angle: float = math.pi / 2
    inner_diameter: float = BORE
    relief: Sequence[Any] = ()
    profile: Any = None
    relieved_surface: ClassVar[Any] = relieved
    kind: ClassVar[str] = "elbow"
    wall: ClassVar[Wall] = Wall(surface, span)

    class Table(ReliefTable):
        """Keys in files."""

        mean_radius: Annotated[Size, Unit("m", "Rm")] = 0.24
        """Of the axis, at least the pipe radius."""
        angle_deg: Annotated[float, Field(ge=0.01, le=180), Unit("deg", "")] = 90.0
        """By which it bends, up to 180."""

    def __post_init__(self) -> None:
        radius = self.inner_diameter / 2
        check(
            self.kind,
            inner_diameter=possible_bore(self.inner_diameter),
            mean_radius=(
                radius <= self.mean_radius <= MAX_BEND * self.inner_diameter,
                f"is {self.mean_radius} m; must be at least the pipe radius of {radius} m"
                if self.mean_radius < radius
                else f"is {self.mean_radius} m, over {MAX_BEND:g} bores{MILLIMETRES}",
            ),
            angle=(
                0 < self.angle <= math.pi,
                f"is {math.degrees(self.angle):.6g} degrees; must be over 0, at most 180",
            ),
        )
        self._check_relief()

    @property
    def _end_axes(self) -> tuple[Array, Array]:
        """Tangent and inward normal at the end."""
        s, c = math.sin(self.angle), math.cos(self.angle)
        return np.array([s, 0, c]), np.array([c, 0, -s])

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` where the bend ends; x to the centre of the bend."""
        tangent, normal = self._end_axes
        return {
            "start": port_pose(-Z, X, np.zeros(3)),
            "end": port_pose(tangent, normal, self.mean_radius * (X - normal)),
        }

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """See ``Fitting``: the arc."""
        arc = ((self.mean_radius * self.angle, 1 / self.mean_radius),)
        if enter == "start":
            return AxisCurve(np.zeros(3), Z, X, arc)
        tangent, normal = self._end_axes
        return AxisCurve(self.ports["end"].position, -tangent, normal, arc)

    def describe(self, enter: str, leave: str) -> Description:
        """See ``Fitting``."""
        return Description(self.kind, "elbow", turn_angle=self.angle)

    def bends_at(self, port: str) -> bool:
        """See ``Fitting``: at both ports."""
        return True

    def extent(self, points: Array) -> Array:
        """See ``Fitting``; measured along the axis circle."""
        p = np.asarray(points, float)
        angle = np.arctan2(p[..., 2], self.mean_radius - p[..., 0])
        # Angles behind the start belong to whichever port plane is nearer.
        behind = (angle < 0) & (angle < self.angle / 2 - math.pi)
        angle = np.where(behind, angle + 2 * math.pi, angle)
        return self.mean_radius * np.minimum(angle, self.angle - angle)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``: around both end discs and the outermost circle between them."""
        r = self.max_radius
        # The extremes lie at the ends or within the bend, as its angle has it: samples settle it.
        angles = np.append(np.linspace(0, self.angle, 181), self.angle)
        rims = np.array([self.mean_radius + r, max(self.mean_radius - r, 0.0)])
        x = self.mean_radius - rims[:, None] * np.cos(angles)
        z = rims[:, None] * np.sin(angles)
        return np.array([x.min(), -r, z.min()]), np.array([x.max(), r, z.max()])

    @property
    def axis_length(self) -> float:
        """See ``Relieved``."""
        return self.mean_radius * self.angle

    @property
    def curvature(self) -> float:
        """See ``Relieved``."""
        return 1 / self.mean_radius

    @property
    def max_radius(self) -> float:
        """See ``Fitting``."""
        return self.radius + self.widening

    @property
    def plain_sizes(self) -> tuple[float, ...]:
        """See ``surface``."""
        return self.radius, self.mean_radius, *self.own_numbers

    @property
    def own_numbers(self) -> tuple[float, ...]:
        """See ``Relieved``: sine and cosine of the angle."""
        return math.sin(self.angle), math.cos(self.angle)

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: rows of boxes along the bend, each as fine as its radius asks."""
        if self.add_relief(pieces, tolerance):
            return
        ring, along_tolerance = self._ring(tolerance, staves)
        for u in ring.azimuths:
            self._add_row(pieces, ring, u, self._row_count(ring, u, along_tolerance))

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``."""
        count, is_all = self.relief_count(tolerance)
        if is_all:
            return count
        ring, along_tolerance = self._ring(tolerance, staves)
        return count + sum(self._row_count(ring, u, along_tolerance) for u in ring.azimuths)

    def _ring(self, tolerance: float, staves: int | None) -> tuple[Ring, float]:
        """Return the rows around the bore, and the rest of the tolerance along them, m."""
        # Half of the tolerance for the facets around, half for those along.
        staves = staves or stave_count(self.radius, tolerance / 2)
        around = sagitta(self.radius, math.pi / staves) / 2
        return Ring.of(self.radius, staves), max(0.8 * tolerance - around, tolerance / 4)

    def _row_count(self, ring: Ring, u: float, along_tolerance: float) -> int:
        """Return the number of boxes of a row at azimuth ``u``, by the tolerance along it, m."""
        from_axis = self.mean_radius - ring.face * math.cos(u)
        # The facet leaves the surface by its sagitta times the part that points across it; the rest
        # slips sideways.
        least = min(2 * along_tolerance / max(abs(math.cos(u)), 1e-9), SIDE_SLIP)
        step = 2 * math.acos(1 / (1 + least / max(from_axis, 1e-6)))
        return max(2, math.ceil(self.angle / step))

    def _add_row(self, pieces: Pieces, ring: Ring, u: float, count: int) -> None:
        """Add the ``count`` boxes along the bend at azimuth ``u``."""
        from_axis = self.mean_radius - ring.face * math.cos(u)
        half = self.angle / count / 2
        # Half of the sagitta balances the error: the facet is as far inside as outside of the arc.
        shift = sagitta(from_axis, half) * math.cos(u) / 2
        back = from_axis - THICKNESS * math.cos(u)
        # Long enough for the edge that is farthest from the bend's axis; outer facets also for
        # their backs.
        widest = max(from_axis + abs(shift), back) + ring.half_width * abs(math.sin(u))
        half_length = max(widest * math.tan(half), 1e-5)
        for j in range(count):
            a = (2 * j + 1) * half
            inward = np.array([math.cos(a), 0, -math.sin(a)])
            along = np.array([math.sin(a), 0, math.cos(a)])
            out = math.cos(u) * inward + math.sin(u) * np.array([0, 1.0, 0])
            centre = self.mean_radius * (np.array([1.0, 0, 0]) - inward)
            face = centre + (ring.face + shift) * out
            pieces.facet(face, out, along, ring.half_width, half_length)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a sector of a torus."""
        if self.patches:
            return self.lofted(kit, more)
        return kit.bend(self.mean_radius, self.angle, self.radius + more)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``: a little longer than the wall at both ports."""
        # A port plane that is turned by the bend's angle is rounded otherwise for the bore than for
        # the wall; bores that end flush with it leave shreds of a film across the mouth.
        bore: Any = super().bore(kit)
        for port in self.ports.values():
            within = Pose(port.rotation, port.position - MOUTH_OVERLAP * port.rotation[:, 2])
            bore += kit.moved(kit.cylinder(kit.overcut, self.radius), within)
        return bore
