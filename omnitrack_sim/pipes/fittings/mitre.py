"""A mitre bend: two straight legs that meet at a corner; enters along +z and bends towards +x.

As old mains have at their corners; with a small angle it is a deflected joint. The corner lies at z
= ``leg_length``, and the plane that halves the bend goes through it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.rotations import Array, Pose, unit
from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.compiled import (
    EDGE,
    FACE,
    Wall,
    clip,
    compiled,
    in_bore,
    out_of_two,
    put,
)
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    Arcs,
    Axis,
    AxisCurve,
    Description,
    Fitting,
    FittingTable,
    X,
    Y,
    Z,
    check,
    fill_in,
    in_bores,
    lengthen,
    port_pose,
    possible_bore,
)
from omnitrack_sim.pipes.fittings.wye_surface import on_ellipse
from omnitrack_sim.pipes.shapes import (
    STRIP_ROWS,
    THICKNESS,
    Kit,
    Pieces,
    Ring,
    Solid,
    rounded_rim,
    stave_count,
)

MAX_ANGLE = math.radians(150)
"""Sharpest corner, rad: the legs then stand 30 degrees apart."""
MIN_ANGLE_DEG = 1e-6
"""Of files, degrees: over a pipe of 10 km such a bend makes 0.2 mm."""
DEFLECTION = math.radians(15)
"""Angle, rad, up to which a robot drives through as it is."""
CLEARANCE = 0.5
"""Least distance of the axis curve from the rim inside the corner, in radii."""
RIM_STEP = math.radians(4)
"""Angle around the axis from one capsule of the rim to the next, at most, rad."""
BLUNT = 1e-5
"""A corner is left as it is in meshes where its fillet would round off less, m."""


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``; ``sizes``: radius, leg length, fillet radius, m, sine and cosine.

    Sine and cosine are those of half the angle.

    The wall shrunk by the fillet's ball is E = {rho = R + f or more from the leg's axis, on either
    side of the plane that halves the bend}. By symmetry the nearest point lies on the point's own
    side: its foot on the leg's cylinder if that is on this side, else the edge, which is the
    ellipse in the plane.
    """
    fillet, sin, cos = sizes[2], sizes[3], sizes[4]
    rho = sizes[0] + fillet
    z = z - sizes[1]
    side = x * sin + z * cos
    mirrored = side > 0.0
    if mirrored:
        x, z, side = x - 2.0 * side * sin, z - 2.0 * side * cos, -side
    away = math.sqrt(x * x + y * y)
    if away < rho and rho * x * sin + z * cos * away > 0.0:
        # In the plane, along the ellipse's long axis and across it.
        u, v = x * cos - z * sin, abs(y)
        k, l = on_ellipse(rho / cos, rho, u, v)
        du, dv = u - k * rho / cos, (v - l * rho) * (-1.0 if y < 0.0 else 1.0)
        distance = math.sqrt(du * du + dv * dv + side * side)
        gx, gy, gz = du * cos + side * sin, dv, side * cos - du * sin
        if distance > 0.0:
            gx, gy, gz = gx / distance, gy / distance, gz / distance
        face = EDGE
    else:
        distance, gz, face = rho - away, 0.0, FACE
        # On the axis the foot away from the inside of the corner is on this side for certain.
        gx, gy = (-x / away, -y / away) if away > 1e-12 else (1.0, 0.0)
    if mirrored:
        turn = 2.0 * (gx * sin + gz * cos)
        gx, gz = gx - turn * sin, gz - turn * cos
    put(out, gx, gy, gz, face)
    return distance - fillet


@compiled
def span(sizes, ends, px, _py, pz, ax, _ay, az, out):
    """See ``compiled.Wall``: between the port planes; neither leg crosses the other's."""
    sin, cos = 2.0 * sizes[3] * sizes[4], sizes[4] * sizes[4] - sizes[3] * sizes[3]
    clip(out, -pz, -az, ends[0])
    beyond = px * sin + (pz - sizes[1]) * cos - sizes[1]
    clip(out, beyond, ax * sin + az * cos, ends[1])
    return 1.0


@compiled
def clear(sizes, px, py, pz, ax, ay, az):
    """See ``compiled.Wall``: up to where the line leaves both legs; the rounded rim leaves more."""
    half_sin, half_cos = sizes[3], sizes[4]
    sin, cos = 2.0 * half_sin * half_cos, half_cos * half_cos - half_sin * half_sin
    pz = pz - sizes[1]
    low, high = in_bore(px, py, ax, ay, sizes[0])
    w, across = px * cos - pz * sin, ax * cos - az * sin
    far_low, far_high = in_bore(w, py, across, ay, sizes[0])
    # Where the line crosses the plane that halves the bend, from one leg to the other.
    side, ahead = px * half_sin + pz * half_cos, ax * half_sin + az * half_cos
    if ahead > 0.0:
        high, far_low = min(high, -side / ahead), max(far_low, -side / ahead)
    elif ahead < 0.0:
        low, far_high = max(low, -side / ahead), min(far_high, -side / ahead)
    elif side < 0.0:
        far_high = -math.inf
    else:
        high = -math.inf
    return out_of_two(low, high, far_low, far_high)


@dataclass(frozen=True)
class Mitre(Fitting):
    """Two legs of ``leg_length`` m, from port to corner, whose axes meet at ``angle`` rad.

    The rim inside the corner is rounded by a ball of ``fillet_radius`` m that rolls inside the
    wall; the corner outside is sharp.

    Example:
        >>> round(ot.Mitre(0.1).length_of_axes, 3)
        0.2
    """

    leg_length: float = in_bores(0.625)
    angle: float = math.pi / 2
    fillet_radius: float = in_bores(1 / 64)
    inner_diameter: float = BORE
    kind: ClassVar[str] = "mitre"
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(FittingTable):
        """Keys in files."""

        leg_length: Annotated[Size | None, Unit("m", "leg")] = None
        """From a port to the corner. Left out: 0.625 `inner_diameter`, 0.1 m at 160 mm, or what
        the rim asks for."""
        angle_deg: Annotated[float, Field(ge=MIN_ANGLE_DEG, le=150), Unit("deg", "")] = 90.0
        """By which it bends, up to 150."""
        fillet_radius: Annotated[Size | None, Unit("m")] = None
        """Of the rim inside the corner. Left out: 1/64 of `inner_diameter`, 2.5 mm at 160 mm."""

    def __post_init__(self) -> None:
        left_out = fill_in(self)
        degrees, fillet = math.degrees(self.angle), self.fillet_radius
        check(
            self.kind,
            inner_diameter=possible_bore(self.inner_diameter),
            angle=(
                MIN_ANGLE_DEG * (1 - 1e-9) <= degrees <= 150 * (1 + 1e-9),
                f"is {degrees:.6g} degrees; must be over 0, at most 150",
            ),
            fillet_radius=(
                0 < fillet <= self.inner_diameter / 4,
                f"is {fillet} m; must be over 0 and at most a quarter of the diameter",
            ),
        )
        least = self.min_leg(self.angle, self.inner_diameter, fillet)
        lengthen(self, left_out, leg_length=least)

    @staticmethod
    def min_leg(angle: float, bore: float, fillet: float) -> float:
        """Return the least length of a leg, m: how far the rim's fillet reaches along it.

        Args:
            angle: rad.
            bore: m.
            fillet: radius of the rim, m.
        """
        # A port right where the fillet ends would leave slivers in meshes.
        return (bore / 2 + fillet) * math.tan(angle / 2) + fillet

    @property
    def _corner(self) -> Array:
        return self.leg_length * Z

    @property
    def _halves(self) -> tuple[Array, Array]:
        """Unit vectors: normal of the plane that halves the bend, and the way in it to the inside.

        The normal points towards the second leg.
        """
        sin, cos = math.sin(self.angle / 2), math.cos(self.angle / 2)
        return np.array([sin, 0.0, cos]), np.array([cos, 0.0, -sin])

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` at the other leg's end; x to the inside of the bend."""
        s, c = math.sin(self.angle), math.cos(self.angle)
        onward, inward = np.array([s, 0, c]), np.array([c, 0, -s])
        return {
            "start": port_pose(-Z, X, np.zeros(3)),
            "end": port_pose(onward, inward, self._corner + self.leg_length * onward),
        }

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """See ``Fitting``: round the corner as wide as legs and rim leave room for."""
        half = self.angle / 2
        radius = self.leg_length / math.tan(half)
        # Past the corner the arc is radius (1 / cos - 1) from where the axes meet.
        rho, free = self.radius + self.fillet_radius, self.fillet_radius + CLEARANCE * self.radius
        if (bow := 1 / math.cos(half) - 1) > 0:
            radius = min(radius, (rho / math.cos(half) - free) / bow)
        line = self.leg_length - radius * math.tan(half)
        segments = ((line, 0.0), (radius * self.angle, 1 / radius), (line, 0.0))
        port = self.ports[enter]
        kept = tuple(segment for segment in segments if segment[0] > 1e-12)
        return AxisCurve(port.position, -port.rotation[:, 2], port.rotation[:, 0], kept)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """See ``Fitting``: both legs, each from its port to the corner."""
        ends, segments = self.ports.values(), ((self.leg_length, 0.0),)
        curves = (AxisCurve(p.position, -p.rotation[:, 2], Y, segments) for p in ends)
        return tuple(Axis(curve, self.radius, self.radius) for curve in curves)

    def describe(self, enter: str, leave: str) -> Description:
        """See ``Fitting``."""
        manoeuvre = "elbow" if self.angle > DEFLECTION else None
        return Description(self.kind, manoeuvre, turn_angle=self.angle)

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        end, p = self.ports["end"], np.asarray(points, float)
        return np.minimum(p[..., 2], (end.position - p) @ end.rotation[:, 2])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``: around the discs of both ports and the ellipse at the corner."""
        end, (_, inside) = self.ports["end"], self._halves
        long = self.radius / math.cos(self.angle / 2)
        centres = np.array([np.zeros(3), self._corner, end.position])
        across = self.radius * np.abs([X, long / self.radius * inside, end.rotation[:, 0]])
        across[:, 1] = self.radius
        return (centres - across).min(axis=0), (centres + across).max(axis=0)

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``surface``."""
        half = self.angle / 2
        return self.radius, self.leg_length, self.fillet_radius, math.sin(half), math.cos(half)

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves of both legs, strips along the rim, capsules as the rim."""
        ring = Ring.of(self.radius, staves or stave_count(self.radius, tolerance))
        rim = self._edge(self._rim_angles, self.radius + self.fillet_radius)
        leg = Pieces()
        self._add_leg(leg, ring, rim)
        (normal, _), corner = self._halves, Pose(np.eye(3), self._corner)
        pieces.add(leg, corner)
        # The other leg is the mirror image. A box is its own, so the mirrored rotation may be
        # turned back into a right-handed one by its middle axis.
        mirror = np.eye(3) - 2 * np.outer(normal, normal)
        for centre, rotation, half in leg.boxes:
            turned = mirror @ rotation @ np.diag([1.0, -1.0, 1.0])
            pieces.boxes.append((corner.apply(mirror @ centre), turned, half))
        # Where the rim ends both legs share a tangent plane, and the staves' square ends leave a
        # gap.
        for side in (Y, -Y):
            point, wide = self._corner + (self.radius + 5e-5) * side, 1.5 * ring.half_width
            along = 2 * wide / math.cos(self.angle / 2)
            pieces.facet(point, side, normal, along, 2 * wide)
        for a, b in pairwise(rim):
            pieces.capsule(a + self._corner, b + self._corner, self.fillet_radius)

    def _add_leg(self, pieces: Pieces, ring: Ring, rim: Array) -> None:
        """Add the first leg's staves, and the strips beside its rim (k, 3) m, from the corner."""
        slope, half_angle = math.tan(self.angle / 2), math.pi / len(ring.azimuths)
        rho, depth = self.radius + self.fillet_radius, min(THICKNESS, 2 * self.fillet_radius)
        for u in ring.azimuths:
            out = np.array([math.cos(u), math.sin(u), 0.0])
            inmost = math.cos(max(abs(math.remainder(u, 2 * math.pi)) - half_angle, 0.0))
            # Inside the corner up to the fillet; outside beyond the corner, into the wall, by the
            # farthest edge of the stave's back.
            back = (ring.face + THICKNESS) * math.cos(u) - ring.half_width * abs(math.sin(u))
            end = -rho * inmost * slope if inmost > 1e-9 else -back * slope
            ring.add_stave(pieces, out, Z, (-self.leg_length, end), THICKNESS if end > 0 else depth)
        outward = unit(rim * (X + Y))
        line = rim - self.fillet_radius * outward
        strip = 1.1 * 2 * self.radius * math.tan(half_angle) / STRIP_ROWS
        away = np.broadcast_to(-Z, line.shape)

        def extent(point: Array) -> Array:
            return self.leg_length + point[..., 2]

        pieces.add_strips(line, Z, self.radius, away, strip, depth, extent)

    @property
    def _rim_angles(self) -> Array:
        """Angles (k,) rad around the leg's axis, from inside the bend, of the capsules' ends."""
        return np.linspace(-math.pi / 2, math.pi / 2, math.ceil(math.pi / RIM_STEP) + 1)

    def _edge(self, around: Array, radius: float) -> Array:
        """Points (k, 3) m, from the corner, of the ellipse where cylinders of ``radius`` m meet."""
        x, y = radius * np.cos(around), radius * np.sin(around)
        return np.stack([x, y, -x * math.tan(self.angle / 2)], axis=-1)

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``."""
        around = staves or stave_count(self.radius, tolerance)
        return 2 * around + (1 + 2 * STRIP_ROWS) * len(self._rim_angles)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: two legs cut at the plane that halves the bend."""
        return self._legs(kit, self.radius + more, 0.0)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``: with the rim rounded, a little longer than the wall, as an elbow's."""
        solid, half = self._legs(kit, self.radius, kit.overcut), self.angle / 2
        rho = self.radius + self.fillet_radius
        if self.fillet_radius * (1 / math.cos(half) - 1) < BLUNT:
            return solid
        count = kit.sections // 2
        # Half way between the corners of the legs, and short of where the rim ends.
        around = np.pi * ((np.arange(count) + 0.5) / count - 0.5)
        normal, _ = self._halves
        centre = self._edge(around, rho)
        one = unit(centre * (X + Y))
        other = one - 2 * np.outer(one @ normal, normal)
        corner = self._edge(around, self.radius - kit.overcut)
        rim = rounded_rim(kit, centre, corner, (one, other), self.fillet_radius, closed=False)
        return solid + kit.moved(rim, Pose(np.eye(3), self._corner))

    def _legs(self, kit: Kit, radius: float, longer: float) -> Solid:
        """Return the legs of ``radius`` m, ``longer`` m beyond their ports."""
        around = 2 * np.pi * np.arange(kit.sections) / kit.sections
        ring = radius * np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1)
        end, reach = self.ports["end"], self.leg_length + longer
        across = np.stack([end.rotation[:, 0], Y, end.rotation[:, 2]], axis=-1)
        rings = [
            ring - longer * Z,
            self._corner + self._edge(around, radius),
            self._corner + reach * end.rotation[:, 2] + ring @ across.T,
        ]
        return kit.loft(np.stack(rings), hub=0)
