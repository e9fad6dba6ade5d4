"""A concentric cone between bores of two sizes, along +z from the origin."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from omnitrack_sim.base.rotations import unit
from omnitrack_sim.base.table import Size, Unit
from omnitrack_sim.pipes.compiled import (
    EDGE,
    FACE,
    HIGH,
    HIGH_ENDS,
    LOW,
    LOW_ENDS,
    Wall,
    clip,
    compiled,
    crossing,
    put,
)
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    Axial,
    Bore,
    FittingTable,
    Z,
    check,
    positive,
    possible_bore,
)
from omnitrack_sim.pipes.shapes import THICKNESS, Kit, Pieces, Ring, Solid, stave_count

MAX_CONE_ANGLE = math.radians(20)
"""Largest half cone angle of a reducer, rad."""
BEYOND_END = 0.0
"""Distance, m, beyond its ends to which a place on the cone is no edge. In single precision it is
over 0, for where a span ends, and what is nearest there, are told apart by rounding."""
POSITION = 1e-7
"""Accuracy, m, of the end of a span."""


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``. Sizes: radius at the start, length, radius at the end, m."""
    radius, length, end_radius = sizes[0], sizes[1], sizes[2]
    slope = (end_radius - radius) / length
    # The distance to a cone is the radial gap times the cosine of the half cone angle.
    cosine = 1.0 / math.sqrt(1.0 + slope * slope)
    from_axis = math.sqrt(x * x + y * y)
    ox, oy = (x / from_axis, y / from_axis) if from_axis > 0.0 else (1.0, 0.0)
    d = cosine * (radius + slope * z - from_axis)
    # Along z the foot is shifted from the point by the slope: the normal of a cone leans.
    foot = z - slope * cosine * d
    if -BEYOND_END <= foot <= length + BEYOND_END:
        put(out, -cosine * ox, -cosine * oy, cosine * slope, FACE)
        return d
    # Beyond the cone's ends its nearest point is on the circle that ends it, where it is an edge.
    edge = 0.0 if foot < 0.0 else length
    across, along = from_axis - radius - slope * edge, z - edge
    away = math.copysign(math.sqrt(across * across + along * along), d)
    if away == 0.0:
        put(out, -cosine * ox, -cosine * oy, cosine * slope, FACE)
        return 0.0
    put(out, across * ox / away, across * oy / away, along / away, EDGE)
    return away


@compiled
def _before_wide_end(z, from_axis, radius, length, end_radius):
    """Return how far a point's foot on the cone lies before the wide end, m times a factor > 0.

    It is negative beyond the end.
    """
    slope = (end_radius - radius) / length
    return (
        z + slope * (from_axis - radius)
        if slope < 0.0
        else length - z - slope * (from_axis - end_radius)
    )


@compiled
def _rise(sizes, px, py, pz, ax, ay, az, s):
    """``_before_wide_end`` at the place s of a line, and its derivative along the line."""
    radius, length, end_radius = sizes[0], sizes[1], sizes[2]
    slope = (end_radius - radius) / length
    x, y, z = px + s * ax, py + s * ay, pz + s * az
    from_axis = math.hypot(x, y)
    value = _before_wide_end(z, from_axis, radius, length, end_radius)
    outward = (x * ax + y * ay) / from_axis if from_axis > 0.0 else 0.0
    return value, az + slope * outward if slope < 0.0 else -az - slope * outward


@compiled
def _root(sizes, px, py, pz, ax, ay, az, a, b):
    """Return the root in [a, b] of ``_before_wide_end`` along a line.

    It is NaN or a place elsewhere where a quadratic does not tell it.
    """
    radius, length, end_radius = sizes[0], sizes[1], sizes[2]
    slope = abs(end_radius - radius) / length
    # The value is w + v s less the slope times the distance from the axis.
    w, v = (pz, az) if end_radius < radius else (length - pz, -az)
    w += slope * max(radius, end_radius)
    squared = slope * slope
    first = squared * (ax * ax + ay * ay) - v * v
    half = squared * (px * ax + py * ay) - w * v
    last = squared * (px * px + py * py) - w * w
    root = math.sqrt(max(half * half - first * last, 0.0))
    # The form of the roots that adds numbers of one sign, and so loses no digits.
    q = -half - math.copysign(root, half)
    s = q / first
    return s if a <= s <= b and w + v * s >= 0.0 else last / q


@compiled
def _crossing(sizes, px, py, pz, ax, ay, az, a, b, before_at_a):
    """Bisect [a, b] for the place where a line passes the normals of the wide edge."""
    s = _root(sizes, px, py, pz, ax, ay, az, a, b)
    # The value is looked at where it is in question only: long lines take some twenty halvings.
    low, high = s - POSITION, s + POSITION
    if not (low > a and (_rise(sizes, px, py, pz, ax, ay, az, low)[0] >= 0.0) == before_at_a):
        low = a
    if not (high < b and (_rise(sizes, px, py, pz, ax, ay, az, high)[0] >= 0.0) != before_at_a):
        high = b
    while b - a > POSITION:
        s = 0.5 * (a + b)
        before = s <= low
        if low < s < high:
            before = (_rise(sizes, px, py, pz, ax, ay, az, s)[0] >= 0.0) == before_at_a
        if before:
            a = s
        else:
            b = s
    return a, b


@compiled
def _highest(sizes, px, py, pz, ax, ay, az, a, b):
    """Return the place in [a, b] where a line is farthest before the wide end.

    The line begins and ends beyond that end.

    Along a line ``_before_wide_end`` is concave: the distance from the axis is convex.
    """
    at_a, slope_a = _rise(sizes, px, py, pz, ax, ay, az, a)
    at_b, slope_b = _rise(sizes, px, py, pz, ax, ay, az, b)
    if slope_a <= 0.0 or slope_b >= 0.0:
        return a
    # Nothing is above both tangents.
    s = (at_b - at_a + slope_a * a - slope_b * b) / (slope_a - slope_b)
    if at_a + slope_a * (s - a) < 0.0:
        return a
    while b - a > POSITION:
        s = 0.5 * (a + b)
        at_s, slope_s = _rise(sizes, px, py, pz, ax, ay, az, s)
        if at_s >= 0.0:
            return s
        if slope_s > 0.0:
            a = s
        else:
            b = s
    return s


@compiled
def _wide_end(sizes, px, py, pz, ax, ay, az, out, ends):
    """Keep the part of the span that the cone itself is nearest to on the side of its wide end.

    That part ends at the normals of the wide edge, not at the port plane: a lug touches the cone
    before its centre is past the port. A line along a pipe passes those normals once, one across it
    may do so twice.
    """
    if out[HIGH] < out[LOW]:
        return
    a, b = out[LOW], out[HIGH]
    at_a, _ = _rise(sizes, px, py, pz, ax, ay, az, a)
    at_b, _ = _rise(sizes, px, py, pz, ax, ay, az, b)
    if at_a >= 0.0 and at_b >= 0.0:
        return
    middle = b if at_a < 0.0 else a
    if at_a < 0.0 and at_b < 0.0:
        middle = _highest(sizes, px, py, pz, ax, ay, az, a, b)
        if _rise(sizes, px, py, pz, ax, ay, az, middle)[0] < 0.0:
            out[HIGH] = out[LOW] - 1.0
            return
    if at_a < 0.0:
        _, low = _crossing(sizes, px, py, pz, ax, ay, az, a, middle, False)
        out[LOW], out[LOW_ENDS] = low, ends
    if at_b < 0.0:
        high, _ = _crossing(sizes, px, py, pz, ax, ay, az, middle, b, True)
        out[HIGH], out[HIGH_ENDS] = high, ends


@compiled
def span(sizes, ends, px, py, pz, ax, ay, az, out):
    """See ``compiled.Wall``: what the cone is nearest to."""
    if sizes[2] < sizes[0]:
        clip(out, pz - sizes[1], az, ends[1])
        _wide_end(sizes, px, py, pz, ax, ay, az, out, ends[0])
    else:
        clip(out, -pz, -az, ends[0])
        _wide_end(sizes, px, py, pz, ax, ay, az, out, ends[1])
    return 1.0


@compiled
def clear(sizes, px, py, pz, ax, ay, az):
    """See ``compiled.Wall``: up to the cone, whose radius grows by ``more`` along the line."""
    # Substituting the line into x² + y² = (radius + slope z)² leaves a quadratic for the distance.
    slope = (sizes[2] - sizes[0]) / sizes[1]
    radius, more = sizes[0] + slope * pz, slope * az
    c = radius * radius - px * px - py * py
    if radius <= 0.0 or c <= 0.0:
        return 0.0
    return crossing(more * more - ax * ax - ay * ay, more * radius - px * ax - py * ay, c)


@dataclass(frozen=True)
class Reducer(Axial):
    """A concentric cone, ``length`` m from ``inner_diameter`` to ``end_diameter``, m.

    ``inner_diameter`` is that at ``start``, ``end_diameter`` that at ``end``.

    Example:
        >>> ot.Reducer(0.1, end_diameter=0.14).port_radius("end")
        0.07
    """

    end_diameter: float
    inner_diameter: float = BORE
    kind: ClassVar[str] = "reducer"
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(FittingTable):
        """Keys in files."""

        length: Annotated[Size, Unit("m", "L")]
        """Along the axis; the half cone angle is at most 20 degrees."""
        end_diameter: Bore
        """The bore at its port `end`, larger or smaller than `inner_diameter`."""

    def __post_init__(self) -> None:
        check(
            self.kind,
            length=positive(self.length),
            inner_diameter=possible_bore(self.inner_diameter),
            end_diameter=possible_bore(self.end_diameter),
        )
        # Only after the first check: a length or diameter that is not positive would divide by
        # zero.
        least = abs(self.end_diameter - self.inner_diameter) / 2 / math.tan(MAX_CONE_ANGLE)
        angle = math.degrees(math.atan(abs(self.slope)))
        steepest = math.degrees(MAX_CONE_ANGLE)
        check(
            self.kind,
            end_diameter=(
                self.end_diameter != self.inner_diameter,
                f"is {self.end_diameter} m, as inner_diameter is; use a straight",
            ),
            length=(
                self.length >= least,
                f"is {self.length} m, a half cone angle of {angle:.3g} degrees; at most "
                # Rounded up to a hundredth of a millimetre, so that the advised length passes this
                # check.
                f"{steepest:g} degrees are "
                f"possible, so at least {math.ceil(1e5 * least) / 1e5:.5f} m",
            ),
        )

    @property
    def slope(self) -> float:
        """Growth of the bore radius along +z, m/m: the tangent of the half cone angle.

        It is negative where the bore narrows.
        """
        return (self.end_diameter - self.inner_diameter) / 2 / self.length

    def bore_key(self, port: str) -> str:
        """See ``Fitting``."""
        return "end_diameter" if port == "end" else "inner_diameter"

    def port_radius(self, port: str) -> float:
        """See ``Fitting``."""
        return self.end_diameter / 2 if port == "end" else self.radius

    def flare(self, port: str) -> float:
        """See ``Fitting``."""
        return self.slope if port == "start" else -self.slope

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``surface``."""
        return self.radius, self.length, self.port_radius("end")

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves tangent to the cone, as wide as its wide end asks for."""
        widest = self.max_radius
        ring, slope = Ring.of(widest, staves or stave_count(widest, tolerance)), self.slope
        shift = widest - ring.face
        # The ends of the staves stand square to the cone: at the wide end they go on behind the
        # wall of the next pipe as far as their backs need to close the wedge; at the narrow end
        # they would come out into its bore.
        overlap = THICKNESS * abs(slope)
        half_length = (self.length * math.hypot(1.0, slope) + overlap) / 2
        for u in ring.azimuths:
            out = np.array([math.cos(u), math.sin(u), 0.0])
            along, normal = unit(slope * out + [0, 0, 1]), unit(out - slope * Z)
            middle = (self.radius + slope * self.length / 2) * out + [0, 0, self.length / 2]
            centre = middle - shift * normal + math.copysign(overlap / 2, slope) * along
            pieces.facet(centre, normal, along, ring.half_width, half_length)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: a cone."""
        return kit.cylinder(self.length, self.radius + more, self.port_radius("end") + more)
