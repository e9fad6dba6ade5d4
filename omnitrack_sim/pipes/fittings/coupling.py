"""A joint of two pipes as it is: ends that lie aside, apart or deflected, or bores that differ.

Both ends are half spaces without a cylinder, about their own axes; between them lies a groove, if
there is a gap. The wall is all points within the edges' radius of these solids: so the edges are
rounded by it, and the distance is that from the nearest solid less the radius, in closed form. The
solids' bores are therefore wider by the radius.

The first pipe ends at z = ``collar``; behind it the other one begins, ``gap`` m later.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.rotations import Array, Pose, rotation_about
from omnitrack_sim.base.table import Angle, NotNegative, Size, Unit
from omnitrack_sim.pipes.compiled import (
    EDGE,
    FACE,
    SOLID,
    Wall,
    clip,
    compiled,
    in_bore,
    part_within,
    put,
)
from omnitrack_sim.pipes.fittings.base import (
    BORE,
    Arcs,
    Axis,
    AxisCurve,
    Bore,
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
from omnitrack_sim.pipes.shapes import (
    ARC_STEP,
    THICKNESS,
    Kit,
    Pieces,
    Ring,
    Solid,
    stave_count,
)

MAX_OFFSET, MAX_STEP, MAX_EDGE = 0.25, 0.25, 1 / 16
"""Largest offset, difference of the bores, and radius of the edges, in bores."""
MAX_ANGLE_DEG = 10.0
"""Largest deflection, degrees, assumed; mitres and elbows turn by more."""
FLUSH = 0.1
"""Part of its radius by which an edge in meshes lies before its place, without a gap."""
TINY = 1e-12
"""m, that keeps a gradient's direction where a point lies on the wall."""
RIM_STEP = math.radians(4)
"""Angle around the axis from one capsule of an edge to the next, at most, rad."""
RADIUS, COLLAR, END_RADIUS, SPACE, RECESS, OFFSET, SINE, EDGE_RADIUS = range(8)
"""Indices in the sizes: radius at the start, length of either pipe, radius at the end, distance of
the solids, radius of the groove, offset, m; sine of the deflection; radius of the edges, m. The
other pipe lies aside and is deflected towards x."""
FIRST = 1.0
"""Number of the first pipe's solid, with the groove, see ``SOLID``; the other pipe's is 2."""


@compiled
def _from_end(short, beyond):
    """Return the distance from a solid without a bore that begins at a plane; 0 within it.

    Args:
        short: m, from the bore's wall, positive in the bore.
        beyond: m, beyond the plane, outside of the solid.
    """
    return math.sqrt(max(short, 0.0) ** 2 + max(beyond, 0.0) ** 2)


@compiled
def _places(sizes, x, y, z):
    """Return a point's places about both axes.

    Its distance from the first axis, and how far it lies beyond the end of the first pipe; its
    coordinate towards x across the other axis, the distance from that, and how far it lies in the
    other pipe.
    """
    beyond, sine = z - sizes[COLLAR], sizes[SINE]
    aside, ahead, cosine = x - sizes[OFFSET], beyond - sizes[SPACE], 1.0
    if sine != 0.0:
        cosine = math.sqrt(1.0 - sine * sine)
        aside, ahead = cosine * aside - sine * ahead, sine * aside + cosine * ahead
    return math.sqrt(x * x + y * y), beyond, aside, math.sqrt(aside * aside + y * y), ahead


@compiled
def _put(out, x, y, z, face):
    """Write a gradient of any length to ``out``."""
    size = math.sqrt(x * x + y * y + z * z)
    put(out, x / size, y / size, z / size, face)


@compiled
def _put_first(out, x, y, away, radial, axial, face):
    """Write a gradient of any length, away from and along the first axis, to ``out``."""
    # On an axis any direction across it will do.
    cos, sin = (x / away, y / away) if away > 0.0 else (1.0, 0.0)
    _put(out, radial * cos, radial * sin, axial, face)


@compiled
def _put_second(sizes, out, aside, y, far, radial, axial, face):
    """Write a gradient of any length, away from and along the other axis, to ``out``."""
    cos, sin = (aside / far, y / far) if far > 0.0 else (1.0, 0.0)
    across, sine = radial * cos, sizes[SINE]
    cosine = math.sqrt(1.0 - sine * sine)
    x, z = cosine * across + sine * axial, cosine * axial - sine * across
    _put(out, x, radial * sin, z, face)


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``; for ``sizes`` see ``RADIUS``."""
    edge, which = sizes[EDGE_RADIUS], sizes[SOLID]
    place = _places(sizes, x, y, z)
    away, beyond, aside, far, within = place
    short, other = sizes[RADIUS] + edge - away, sizes[END_RADIUS] + edge - far
    groove = sizes[RECESS] + edge - away
    first, second = _from_end(short, beyond), _from_end(other, -within)
    in_gap = sizes[SPACE] > 0.0 and within < 0.0
    in_first = first <= 0.0 or (in_gap and beyond > 0.0 and groove <= 0.0)
    # Within one of the solids what counts is what both leave free.
    if (in_first and which != FIRST + 1.0) or (second <= 0.0 and which != FIRST):
        return _in_solids(sizes, x, y, place, short, other, groove, out) - edge
    if which == FIRST or (which == 0.0 and first <= second):
        if in_gap and groove < first:
            _put_first(out, x, y, away, -1.0, 0.0, FACE)
            return groove - edge
        radial, axial = -max(short, 0.0), max(beyond, 0.0)
        _put_first(out, x, y, away, radial, axial, EDGE if radial * axial != 0.0 else FACE)
        return first - edge
    if which == 0.0 and in_gap and groove < second:
        _put_first(out, x, y, away, -1.0, 0.0, FACE)
        return groove - edge
    radial, axial = -max(other, 0.0), min(within, 0.0)
    _put_second(sizes, out, aside, y, far, radial, axial, EDGE if radial * axial != 0.0 else FACE)
    return second - edge


@compiled
def _in_solids(sizes, x, y, place, short, other, groove, out):
    """Return the distance, at most 0, of a point within the solids from what they leave free.

    That are both bores up to their ends, and the groove between them.
    """
    away, beyond, aside, far, within = place
    first, second = _from_end(-short, beyond), _from_end(-other, -within)
    if sizes[SPACE] > 0.0:
        out_of, back = max(-groove, 0.0), max(-beyond, 0.0)
        between, sine = math.sqrt(out_of * out_of + back * back), 0.0
        if within > 0.0:
            # Behind the other end, which leans towards the groove's wall or from it.
            sine = sizes[SINE]
            lean = sine * x / away if away > 0.0 else 0.0
            out_of, back = -groove - lean * within, within + lean * groove
            if out_of <= 0.0:
                out_of, back = 0.0, within
            elif back <= 0.0:
                out_of, back = -groove, 0.0
            else:
                square = 1.0 - lean * lean
                out_of, back = out_of / square, back / square
            between = math.sqrt(out_of * out_of + back * back + 2.0 * lean * out_of * back)
        if between < min(first, second):
            r = max(out_of, TINY) / max(away, TINY)
            axial = back if within <= 0.0 else -back * math.sqrt(1.0 - sine * sine)
            _put(out, -r * x - back * sine, -r * y, axial, FACE)
            return -between
    if first <= second:
        _put_first(out, x, y, away, -max(-short, TINY), -max(beyond, 0.0), FACE)
        return -first
    _put_second(sizes, out, aside, y, far, -max(-other, TINY), max(-within, 0.0), FACE)
    return -second


@compiled
def _end_plane(sizes, px, pz, ax, az):
    """Return how far beyond the end's port plane a point lies, m, and a direction leads, m/m."""
    sine = sizes[SINE]
    cosine = math.sqrt(1.0 - sine * sine)
    ahead = pz - sizes[COLLAR] - sizes[SPACE]
    value = sine * (px - sizes[OFFSET]) + cosine * ahead - sizes[COLLAR]
    return value, sine * ax + cosine * az


@compiled
def span(sizes, ends, px, _py, pz, ax, _ay, az, out):
    """See ``compiled.Wall``: between the port planes."""
    clip(out, -pz, -az, ends[0])
    value, slope = _end_plane(sizes, px, pz, ax, az)
    clip(out, value, slope, ends[1])
    return 1.0


@compiled
def clear(sizes, px, py, pz, ax, ay, az):
    """See ``compiled.Wall``: through the first bore, what both have in common, and the other."""
    edge, sine = sizes[EDGE_RADIUS], sizes[SINE]
    cosine = math.sqrt(1.0 - sine * sine)
    low, high = in_bore(px, py, ax, ay, sizes[RADIUS])
    aside, ahead = px - sizes[OFFSET], pz - sizes[COLLAR] - sizes[SPACE]
    w, across = cosine * aside - sine * ahead, cosine * ax - sine * az
    far_low, far_high = in_bore(w, py, across, ay, sizes[END_RADIUS])
    within, along = sine * aside + cosine * ahead, sine * ax + cosine * az
    both = max(low, far_low), min(high, far_high)
    one = part_within(low, high, pz - sizes[COLLAR] + edge, az)
    other = part_within(far_low, far_high, edge - within, -along)
    reach = 0.0
    # A line passes from one of the three into the next.
    for _ in range(3):
        if one[0] <= reach < one[1]:
            reach = one[1]
        if both[0] <= reach < both[1]:
            reach = both[1]
        if other[0] <= reach < other[1]:
            reach = other[1]
    return reach


@dataclass(frozen=True)
class Coupling(Fitting):
    """A joint of two pipes of ``inner_diameter`` and ``end_diameter`` m, ``length`` m in all.

    Without an offset, gap or deflection, of two bores, it is a step: the ends of two pipes that
    meet without a reducer.

    It lies with its axes in the plane y = 0, and the pipe at its port ``end`` towards x.

    Attributes:
        length: m, along the axes, from port to port: as much of either pipe, and the gap.
        end_diameter: m, bore of the pipe at its port ``end``.
        offset: m, by which that pipe's axis lies aside.
        direction: rad, of offset and deflection about the axis from the x axis of the pipe before.
        angle: rad, by which that pipe is deflected.
        gap: m, between the ends of both pipes, along the axis.
        depth: m, of the groove in the gap, from the bore that reaches farther out.
        edge_radius: m, of the rounded edges of both ends.

    Example:
        >>> ot.Coupling(offset=0.003).ports["end"].position
        array([0.003, 0.   , 0.16 ])
    """

    length: float = in_bores(1)
    end_diameter: float = in_bores(1)
    offset: float = 0.0
    direction: float = 0.0
    angle: float = 0.0
    gap: float = in_bores(0)
    depth: float = in_bores(1 / 40)
    edge_radius: float = in_bores(1 / 320)
    inner_diameter: float = BORE
    kind: ClassVar[str] = "coupling"
    wall: ClassVar[Wall] = Wall(surface, span, clear, solids=2)

    class Table(FittingTable):
        """Keys in files."""

        length: Annotated[Size | None, Unit("m", "L")] = None
        """Along the axes, the gap in the middle. Left out: `inner_diameter`, or what the edges ask
        for."""
        end_diameter: Annotated[Bore | None, Unit("m")] = None
        """The bore behind. Left out: `inner_diameter`; else it is a step, of half of the
        difference."""
        offset: Annotated[NotNegative, Unit("m", "offset")] = 0.0
        """By which the axis behind lies aside, at most a quarter of the bore."""
        direction_deg: Annotated[Angle, Unit("deg")] = 0.0
        """Of offset and deflection, about the axis from the x axis of the pipe before."""
        angle_deg: Annotated[float, Field(ge=0, le=MAX_ANGLE_DEG), Unit("deg", "angle")] = 0.0
        """By which the axis behind is deflected, up to 10."""
        gap: Annotated[NotNegative | None, Unit("m", "gap")] = None
        """Between both ends, along the axis. Left out: none, or with `angle_deg` as much as keeps
        the ends from each other."""
        depth: Annotated[NotNegative | None, Unit("m")] = None
        """Of the gap, from the bore that reaches farther out. Left out: 1/40 of `inner_diameter`, 4
        mm at 160 mm, as thick as the wall; assumed."""
        edge_radius: Annotated[Size | None, Unit("m")] = None
        """Of the rounded edges of both ends. Left out: 1/320 of `inner_diameter`, 0.5 mm at 160 mm;
        assumed."""

    def __post_init__(self) -> None:
        """Check the sizes."""
        left_out = fill_in(self)
        bore, end = self.inner_diameter, self.end_diameter
        check(self.kind, inner_diameter=possible_bore(bore), end_diameter=possible_bore(end))
        most = MAX_OFFSET * min(bore, end)
        degrees = math.degrees(self.angle)
        check(
            self.kind,
            end_diameter=(
                abs(end - bore) <= MAX_STEP * max(bore, end) * (1 + 1e-9),
                f"is {end} m, beside {bore} m; a coupling's bores differ by at most a quarter of "
                "the wider one, a reducer's by more",
            ),
            offset=(
                0 <= self.offset <= most * (1 + 1e-9),
                f"is {self.offset} m; must be from 0 to a quarter of the bore, {most:.6g} m",
            ),
            angle=(
                0 <= degrees <= MAX_ANGLE_DEG * (1 + 1e-9),
                f"is {degrees:.6g} degrees; must be from 0 to {MAX_ANGLE_DEG:g}; a mitre or an "
                "elbow turns by more",
            ),
            edge_radius=(
                0 < self.edge_radius <= MAX_EDGE * bore * (1 + 1e-9),
                f"is {self.edge_radius} m; must be over 0 and at most a 16th of the bore, "
                f"{MAX_EDGE * bore:.6g} m",
            ),
            gap=(
                0 <= self.gap <= bore,
                f"is {self.gap} m; must be from 0 to the bore, {bore} m",
            ),
        )
        self._fit_gap(left_out)
        least = math.ceil(1e5 * (self._space + 2 * self._min_collar)) / 1e5
        lengthen(self, left_out, length=least)

    def _fit_gap(self, left_out: list[str]) -> None:
        """Widen a gap that was left out to what a deflection asks for; check it and its depth."""
        # The far side of the deflected end comes back so far towards the other.
        least = max(self.inner_diameter, self.end_diameter) / 2 * math.sin(self.angle)
        least = math.ceil(1e5 * least) / 1e5
        if "gap" in left_out:
            object.__setattr__(self, "gap", least)
        if "depth" in left_out and self.gap == 0:
            object.__setattr__(self, "depth", 0.0)
        most = self.inner_diameter / 2
        check(
            self.kind,
            gap=(
                self.gap >= least - 2e-12,
                f"is {self.gap} m; deflected by {math.degrees(self.angle):.6g} degrees the ends "
                f"would meet, so it must be at least {least:.5f} m",
            ),
            depth=(
                0 < self.depth <= most if self.gap else self.depth == 0,
                f"is {self.depth} m; of a gap it must be over 0 and at most half of the bore, "
                f"{most:.6g} m, and without one it is 0",
            ),
        )

    @property
    def _space(self) -> float:
        """Distance of the solids that are rounded, m."""
        return self.gap + 2 * self.edge_radius if self.gap else 0.0

    @property
    def _collar(self) -> float:
        """Length of either pipe, m."""
        return (self.length - self._space) / 2

    @property
    def _min_collar(self) -> float:
        """Least length of either pipe, m: points farther off are nearer to its wall than its end.

        That is so by Pythagoras for points of the axis, then for all.
        """
        edge, reach = self.edge_radius, [0.0]
        across = self.end_radius * math.cos(self.angle)
        for radius, other in ((self.radius, across), (across, self.radius)):
            step = min(max(radius + self.offset - other, 0.0), radius + edge)
            reach.append(math.sqrt(2 * step * (radius + edge) - step * step))
        return max(reach) + edge

    @property
    def end_radius(self) -> float:
        """Bore radius at the end, m."""
        return self.end_diameter / 2

    @property
    def recess(self) -> float:
        """Radius of the groove in the gap, m, about the axis at the start."""
        return max(self.radius, self.offset + self.end_radius) + self.depth

    def bore_key(self, port: str) -> str:
        """See ``Fitting``."""
        return "end_diameter" if port == "end" else "inner_diameter"

    def port_radius(self, port: str) -> float:
        """See ``Fitting``."""
        return self.end_radius if port == "end" else self.radius

    @cached_property
    def _behind(self) -> Pose:
        """Frame of the other pipe's end in the joint, z along that pipe."""
        place = self.offset * X + (self._collar + self._space) * Z
        return Pose(rotation_about([0, 1, 0], self.angle), place)

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``start`` at the origin, ``end`` aside and deflected towards x.

        Their x axes are turned from x by as much as makes that the ``direction``.
        """
        x = np.array([math.cos(self.direction), -math.sin(self.direction), 0.0])
        turn, place = self._behind.rotation, self._behind.apply(self._collar * Z)
        return {
            "start": port_pose(-Z, x, np.zeros(3)),
            "end": port_pose(turn[:, 2], turn @ x, place),
        }

    @property
    def is_axial(self) -> bool:
        """See ``Fitting``: without offset and deflection."""
        return self.offset == 0 and self.angle == 0

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:  # noqa: ARG002
        """See ``Fitting``: two arcs, from one axis over to the other."""
        port = self.ports[enter]
        across = X if enter == "start" else self._behind.rotation[:, 0]
        segments = self._arcs if enter == "start" else self._arcs[::-1]
        return AxisCurve(port.position, -port.rotation[:, 2], across, segments)

    @property
    def drawn_bores(self) -> tuple[Axis, ...]:
        """See ``Fitting``: both pipes, and the groove between them."""
        collar, behind = self._collar, self._behind
        bores = [
            (np.zeros(3), Z, collar, self.radius),
            (collar * Z, Z, self._space, self.recess),
            (behind.position, behind.rotation[:, 2], collar, self.end_radius),
        ]
        return tuple(
            Axis(AxisCurve(place, along, Y, ((length, 0.0),)), radius, radius)
            for place, along, length, radius in bores
            if length > 0
        )

    @cached_property
    def _arcs(self) -> tuple[tuple[float, float], ...]:
        """Length, m, and curvature towards x, 1/m, of the arcs of a curve from port to port.

        Both arcs have tangents of one length, from either port to where they meet.
        """
        way, onward = self.ports["end"].position, self.ports["end"].rotation[:, 2]
        both = Z + onward
        along, square = float(way @ both), float(way @ way)
        tangent = square / (along + math.sqrt(along**2 + square * (4 - float(both @ both))))
        x, _, z = (way - tangent * both).tolist()
        first = math.atan2(x, z)
        turns = (first, self.angle - first)
        if max(map(abs, turns)) < TINY:
            return ((float(np.linalg.norm(way)), 0.0),)
        lengths = [2 * tangent * _half_arc(turn / 2) for turn in turns]
        return tuple((length, turn / length) for length, turn in zip(lengths, turns, strict=True))

    def describe(self, enter: str, leave: str) -> Description:  # noqa: ARG002
        """See ``Fitting``: it asks nothing of a robot."""
        return Description(self.kind, turn_angle=self.angle)

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        end, p = self.ports["end"], np.asarray(points, float)
        return np.minimum(p[..., 2], (end.position - p) @ end.rotation[:, 2])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``: around the discs at both ends of both pipes, and the groove."""
        behind, end = self._behind, self.ports["end"].position
        across = np.sqrt(np.maximum(1 - np.square(behind.rotation[:, 2]), 0.0))
        flat = X + Y
        discs = [
            (np.zeros(3), self.radius * flat),
            (self._collar * Z, self.radius * flat),
            (behind.position, self.end_radius * across),
            (end, self.end_radius * across),
        ]
        if self.gap:
            discs.append((self._collar * Z, self.recess * flat))
        corners = np.array([(centre - reach, centre + reach) for centre, reach in discs])
        return corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``surface``."""
        return (
            self.radius,
            self._collar,
            self.end_radius,
            self._space,
            self.recess,
            self.offset,
            math.sin(self.angle),
            self.edge_radius,
            *[0.0] * (SOLID - EDGE_RADIUS),
        )

    # What it is made of elsewhere

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves of both pipes and of the groove, capsules as the edges."""
        count = staves or stave_count(self.max_radius, tolerance)
        reach = self.recess + THICKNESS
        # The second pipe is the mirror image of one that ends in the joint.
        turned = Pose(self._behind.rotation * [1, -1, -1], self.ports["end"].position)
        for radius, pose in ((self.radius, None), (self.end_radius, turned)):
            end = Pieces()
            self._add_end(end, radius, count, reach)
            pieces.add(end, pose)
        if self.gap:
            # Up to where the second end is farthest.
            far = self._collar + self._space + self.recess * math.sin(self.angle)
            _add_staves(pieces, self.recess, count, (self._collar, far), THICKNESS)

    def _add_end(self, pieces: Pieces, radius: float, count: int, reach: float) -> None:
        """Add a pipe along z that ends at the collar, ``reach`` m from its axis outward."""
        edge, end = self.edge_radius, self._collar
        _add_staves(pieces, radius, count, (0.0, end), reach - radius)
        _add_staves(pieces, radius + edge, count, (end, end + edge), reach - radius - edge)
        around = np.linspace(0, 2 * np.pi, math.ceil(2 * math.pi / RIM_STEP) + 1)
        flat = np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1)
        rim = (radius + edge) * flat + end * Z
        for a, b in pairwise(rim):
            pieces.capsule(a, b, edge)

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``."""
        around = staves or stave_count(self.max_radius, tolerance)
        return 5 * around + 2 * math.ceil(2 * math.pi / RIM_STEP)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: both pipes, each going on by ``more`` m, and a socket about the gap."""
        collar, space = self._collar, self._space
        solid = kit.cylinder(collar + min(more, collar), self.radius + more)
        begin = min(more, collar)
        behind = kit.moved(
            kit.cylinder(collar + begin, self.end_radius + more),
            self._behind @ Pose(np.eye(3), -begin * Z),
        )
        solid += behind
        if self.gap:
            socket = kit.cylinder(space + 2 * begin + self._lean, self.recess + more)
            solid += kit.moved(socket, Pose(np.eye(3), (collar - begin) * Z))
        return solid

    @property
    def _lean(self) -> float:
        """How far the groove goes on where the second pipe is deflected from it, m."""
        return self.recess * math.sin(self.angle)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``: what both ends leave free, up to the groove's wall in the gap."""
        total = self.length + 2 * self._lean + 2 * kit.overcut
        first = kit.revolved(self._free(self.radius, -kit.overcut, total))
        end = self.ports["end"]
        turned = Pose(self._behind.rotation * [1, -1, -1], end.position)
        second = kit.revolved(self._free(self.end_radius, -kit.overcut, total))
        free = first ^ kit.moved(second, turned)
        if not self.gap:
            return free
        edge = self.edge_radius
        behind = kit.cylinder(self._collar + edge / 2 + 2 * kit.overcut, self.end_radius + 2 * edge)
        begin = self._behind @ Pose(np.eye(3), -edge / 2 * Z)
        groove = kit.moved(kit.cylinder(total, self.recess), Pose(np.eye(3), -kit.overcut * Z))
        return free ^ (groove + kit.moved(behind, begin))

    def _free(self, radius: float, begin: float, end: float) -> Array:
        """Return the outline (n, 2) m, radius and z, of what a pipe along z leaves free.

        Its bore from ``begin`` m on, the rounded edge, and all beyond up to ``end`` m.
        """
        edge, outside = self.edge_radius, 2 * self.recess
        # Without a gap a little before its place, so that the edges of flush pipes cross.
        place = self._collar if self.gap else self._collar - FLUSH * edge
        turn = np.linspace(0, np.pi / 2, math.ceil(math.pi / 2 / ARC_STEP) + 1)
        lip = np.stack([radius + edge * (1 - np.cos(turn)), place + edge * np.sin(turn)], axis=-1)
        corners = [(0.0, begin), (radius, begin), *lip.tolist(), (outside, place + edge)]
        return np.array([*corners, (outside, end), (0.0, end)])


def _half_arc(angle: float) -> float:
    """Return the length of an arc over that of its tangent, by its angle, rad."""
    return angle / math.tan(angle) if abs(angle) > TINY else 1.0


def _add_staves(
    pieces: Pieces, radius: float, count: int, ends: tuple[float, float], depth: float
) -> None:
    """Add staves around a bore along z, from one end to the other, m, ``depth`` m thick."""
    ring = Ring.of(radius, count)
    # Wide enough for their backs to meet.
    half_width = (ring.face + depth) * math.tan(math.pi / count)
    for u in ring.azimuths:
        out = np.array([math.cos(u), math.sin(u), 0.0])
        middle = ring.face * out + sum(ends) / 2 * Z
        pieces.facet(middle, out, Z, half_width, (ends[1] - ends[0]) / 2, depth)
