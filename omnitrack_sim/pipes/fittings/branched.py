"""A run with a branch: what tees, wyes and crosses have in common.

Frame: run along z, centred at the origin; the branch leaves the origin along (sin a, 0, cos a).
Port frames have z out of the fitting and x towards the branch, or along the run.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, cross, length, unit
from omnitrack_sim.pipes.compiled import Wall
from omnitrack_sim.pipes.fittings.base import (
    Arcs,
    Axis,
    AxisCurve,
    Description,
    Fitting,
    X,
    Y,
    Z,
    port_pose,
)
from omnitrack_sim.pipes.fittings.wye_surface import EQUAL, clear, span, surface
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

CROTCH_PATCH = 0.007
"""Half width of the flat pieces where the two halves of the rim meet, m."""

RIM_STEP = 0.008
"""Longest capsule along the rim, m."""
RIM_SAGITTA = 1.5e-4
"""By how much a capsule's chord may leave the rim, m."""
_DENSE, _CUT_SAMPLES = 4001, 17
"""Points along the rim between which its curvature is measured, and across the cut end of a
stave."""
MIN_FILL = 5e-4
"""Depth, m, of what a ball rounds off a crotch, below which solids leave the crotch sharp."""
CLEARANCE = 0.5
"""Least distance of an axis curve from the rim inside its turn, in radii of the branch."""


class Branched(Fitting):
    """A run along z, centred at the origin, with a branch that leaves it there towards +x.

    Attributes:
        run_length: m, of the run.
        branch_length: m, of the branch, from the point where the axes meet.
        angle: rad, of the branch from +z.
        fillet_radius: m, of the ball that rounds the rim.
        branch_diameter: m, bore of the branch.
        branches: the ports that are not the run's.
    """

    port_names: ClassVar[tuple[str, ...]] = ("run_start", "run_end", "branch")
    default_way: ClassVar[tuple[str, str]] = ("run_start", "branch")
    branches: ClassVar[tuple[str, ...]] = ("branch",)
    wall: ClassVar[Wall] = Wall(surface, span, clear)
    run_length: float
    branch_length: float
    angle: float
    fillet_radius: float
    branch_diameter: float

    def port_radius(self, port: str) -> float:
        """See ``Fitting``."""
        return self.branch_diameter / 2 if port in self.branches else self.radius

    @property
    def sin_cos(self) -> tuple[float, float]:
        """Sine and cosine of the angle; the cosine of a right angle is 0 to the last bit."""
        return math.sin(self.angle), 0.0 if self.angle == math.pi / 2 else math.cos(self.angle)

    @property
    def branch_axis(self) -> Array:
        """Unit vector (3,) along the branch, outward."""
        sin, cos = self.sin_cos
        return np.array([sin, 0.0, cos])

    @property
    def min_lengths(self) -> tuple[float, float]:
        """Least half run and branch length, m: as far as the rim's fillet reaches at the crotch."""
        big, small = self._edge_radii()
        sin, cos = self.sin_cos
        return (big * cos + small) / sin, (big + small * cos) / sin

    @property
    def branch_radius(self) -> float:
        """Bore radius of the branch, m."""
        return self.port_radius("branch")

    @property
    def ports(self) -> Mapping[str, Pose]:
        """``run_start`` (z < 0), ``run_end``, ``branch``; x to the branch or along the run."""
        half, out = self.run_length / 2, self.branch_axis
        return {
            "run_start": port_pose(-Z, X, -half * Z),
            "run_end": port_pose(Z, X, half * Z),
            "branch": port_pose(out, cross(out, Y), self.branch_length * out),
        }

    @property
    def axes(self) -> tuple[Axis, ...]:
        """See ``Fitting``: the run, and the branch from the run's axis."""
        run = AxisCurve(self.ports["run_start"].position, Z, X, ((self.run_length, 0.0),))
        branch = AxisCurve(np.zeros(3), self.branch_axis, Y, ((self.branch_length, 0.0),))
        return (
            Axis(run, self.radius, self.radius),
            Axis(branch, self.branch_radius, self.branch_radius),
        )

    @property
    def bounds(self) -> tuple[Array, Array]:
        """See ``Fitting``."""
        run, half = self.radius, self.run_length / 2
        far, end = self.branch_length * self.branch_axis, self.branch_radius * self.branch_axis
        high = np.array([max(run, far[0] + end[2]), run, max(half, far[2] + end[0])])
        return np.array([-run, -run, -half]), high

    def turn_angle(self, enter: str, leave: str) -> float:
        """Angle, rad, by which the way from port ``enter`` to port ``leave`` turns."""
        if "branch" not in (enter, leave):
            return 0.0
        return self.angle if "run_start" in (enter, leave) else math.pi - self.angle

    def axis_curve(self, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
        """See ``Fitting``: a line over the run, or line, arc, line between run and branch.

        The arc is as wide as the two legs leave room for.
        """
        return _axis_curve(self, enter, leave, arcs)

    def mouth(self, enter: str) -> tuple[float, float]:
        """Return middle and half length, m, of the branch's opening, along the axis from a port.

        Along the run the mouth (the sharp edge of the bores) is 2 r / sin a long, about R cot a
        from where the axes meet, towards the side the branch leans to. Out of the branch it begins
        where the crotch is and ends at the far wall of the run.
        """
        run, branch, (sin, cos) = self.radius, self.branch_radius, self.sin_cos
        if enter == "branch":
            first = self.branch_length - (run + branch * cos) / sin
            last = self.branch_length + run / sin
        else:
            middle = self.run_length / 2 + (run if enter == "run_start" else -run) * cos / sin
            first, last = middle - branch / sin, middle + branch / sin
        return (first + last) / 2, (last - first) / 2

    def clear_of_rim(self, radius: float, tangent: Array, normal: Array, turn: float) -> float:
        """Return the largest radius, up to ``radius`` m, of an arc by ``turn`` rad off the rim.

        It stays ``CLEARANCE`` off the wall inside it.
        """
        around = np.linspace(0, turn, 97)[:, None]
        # Per metre of radius, from where the axes meet.
        arc = normal * (1 - np.cos(around)) + tangent * (np.sin(around) - math.tan(turn / 2))

        def is_clear(radius: float) -> bool:
            return bool(
                self.signed_distance(radius * arc)[0].min() >= CLEARANCE * self.branch_radius
            )

        if is_clear(radius):
            return radius
        # Arcs shrink towards the corner of the axes, so clearance grows: bisection finds its limit.
        low, high = 0.0, radius
        for _ in range(24):
            low, high = (middle, high) if is_clear(middle := (low + high) / 2) else (low, middle)
        return low

    def depth_between(self, enter: str, leave: str, points: Array) -> Array:
        """See ``Fitting``: in the arm to either port, and where the two bores cross.

        A point of a third arm is left out as soon as it lies beyond the mouths of both.
        """
        p, ports = np.asarray(points, float), self.ports
        along, depth = [], []
        for port in (enter, leave):
            axis = ports[port].rotation[:, 2]
            s = p @ axis
            along.append(s)
            depth.append(self.port_radius(port) - length(p - s[..., None] * axis))
        # The axes meet in the origin, from where the arms go.
        arms = np.maximum(*(np.minimum(d, s) for d, s in zip(depth, along, strict=True)))
        inside = np.maximum(arms, np.minimum(*depth))
        return np.minimum(inside, self.extent(p))

    def describe(self, enter: str, leave: str) -> Description:
        """See ``Fitting``."""
        opening, turn = self.mouth(enter), self.turn_angle(enter, leave)
        if turn == 0:
            return Description("over the run", "tee_straight", opening=opening)
        into = leave in self.branches
        return Description(
            "run to branch" if into else "branch to run",
            "tee_turn",
            into_branch=into,
            out_of_branch=not into,
            opening=opening,
            turn_angle=turn,
        )

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``wye_surface``: lengths and radii, m, sine and cosine of the angle."""
        lengths = (self.run_length / 2, self.branch_length)
        radii = (self.radius, self.branch_radius, self.fillet_radius)
        return (*lengths, *radii, *self.sin_cos)

    def extent(self, points: Array) -> Array:
        """See ``Fitting``; the legs of an oblique wye cross each other's port planes.

        A point belongs to the branch where it is nearer to that bore's wall than to the run's, or
        less deep in the run.
        """
        p = np.asarray(points, float)
        x, y, z = np.moveaxis(p, -1, 0)
        out = self.branch_axis
        # Coordinates along the branch and across it in the plane of the axes.
        t, w = x * out[0] + z * out[2], x * out[2] - z * out[0]
        in_branch = (t > 0) & (np.hypot(y, w) - self.branch_radius < np.hypot(x, y) - self.radius)
        return np.where(in_branch, self.branch_length - t, self.run_length / 2 - np.abs(z))

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves cut back along the rim, strips along it, capsules as the rim."""
        run_ring = Ring.of(self.radius, staves or stave_count(self.radius, tolerance))
        branch_ring = Ring.of(
            self.branch_radius, staves or stave_count(self.branch_radius, tolerance)
        )
        # A piece by the rim is no thicker than the wall is there: a ball of the fillet's radius
        # fits.
        depth = min(THICKNESS, 2 * self.fillet_radius)
        self._add_run(pieces, run_ring, depth)
        self.add_branches(pieces, run_ring, branch_ring, depth)

    def add_branches(self, pieces: Pieces, run_ring: Ring, branch_ring: Ring, depth: float) -> None:
        """Add the wall of the branch and its rim; rings and depth as in ``add_walls``."""
        self._add_branch(pieces, branch_ring, depth)
        equal = self.radius - self.branch_radius < EQUAL
        if equal:
            # Where the halves of the rim meet the wall is flat: run and branch share their tangent
            # plane.
            for side in (1.0, -1.0):
                y = np.array([0, side, 0])
                point, z = (self.radius + 5e-5) * y, np.array([0, 0, 1.0])
                pieces.facet(point, y, z, CROTCH_PATCH, CROTCH_PATCH, THICKNESS)
        for q in self._rim_angles():
            self._add_rim(pieces, q, run_ring, branch_ring, depth)

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``."""
        around = staves or stave_count(self.radius, tolerance)
        _, small = self._edge_radii()
        # The rim is about the ellipse in which a plane cuts the branch, bent round the run; its
        # circumference is Ramanujan's.
        a, b = small / self.sin_cos[0], small
        rim = 1.3 * math.pi * (3 * (a + b) - math.sqrt((3 * a + b) * (a + 3 * b)))
        capsules = math.ceil(rim / min(RIM_STEP, math.sqrt(8 * RIM_SAGITTA * small)))
        return 3 * around + (1 + 2 * STRIP_ROWS) * capsules + 2

    def _rim_angles(self) -> list[Array]:
        """Angles round the branch, rad, of the capsules' ends: one closed line, or two.

        Equal bores have two.
        """
        big, small = self._edge_radii()
        equal = self.radius - self.branch_radius < EQUAL
        parts = (
            [(-np.pi / 2, np.pi / 2), (np.pi / 2, 3 * np.pi / 2)] if equal else [(0.0, 2 * np.pi)]
        )
        lines = []
        for first, last in parts:
            q = np.linspace(first, last, _DENSE)
            chords = np.diff(edge_curve(q, big, small, self.angle), axis=0)
            lengths = np.linalg.norm(chords, axis=1)
            turns = np.linalg.norm(np.diff(unit(chords), axis=0), axis=1)
            curvature = np.pad(turns / lengths[1:], (0, 1), mode="edge")
            # A chord of length c leaves an arc of curvature k by the sagitta k c² / 8.
            step = np.minimum(RIM_STEP, np.sqrt(8 * RIM_SAGITTA / np.maximum(curvature, 1e-9)))
            count = np.concatenate([[0.0], np.cumsum(lengths / step)])
            # An even number of steps puts corners at heel and crotch.
            lines.append(
                np.interp(np.linspace(0, count[-1], 2 * math.ceil(count[-1] / 2) + 1), count, q)
            )
        return lines

    def _edge_radii(self) -> tuple[float, float]:
        return self.radius + self.fillet_radius, self.branch_radius + self.fillet_radius

    def _add_run(self, pieces: Pieces, ring: Ring, depth: float) -> None:
        """Staves of the run; those that the mouth interrupts in two parts, square at their ends."""
        half, z = self.run_length / 2, np.array([0, 0, 1.0])
        for u in ring.azimuths:
            out = np.array([math.cos(u), math.sin(u), 0.0])
            mouth = self.mouth_at(u, np.pi / len(ring.azimuths))
            if mouth is None:
                pieces.facet(ring.face * out, out, z, ring.half_width, half, THICKNESS)
                continue
            for a, b in ((-half, mouth[0]), (mouth[1], half)):
                ring.add_stave(pieces, out, z, (a, b), depth)

    def mouth_at(self, middle: float, half_angle: float) -> tuple[float, float] | None:
        """Return the heights z, m, between which the mouth opens the run near an azimuth, or None.

        ``middle``: azimuth, rad. ``half_angle``: rad, to either side of it.
        """
        big, small = self._edge_radii()
        sin, cos = self.sin_cos
        middle, limit = math.remainder(middle, 2 * math.pi), math.asin(min(1.0, small / big))
        # Beyond `limit` the mouth of a smaller branch does not reach around the run.
        first, last = max(middle - half_angle, -limit), min(middle + half_angle, limit)
        if last - first <= 1e-9:
            return None
        around = np.linspace(first, last, _CUT_SAMPLES)
        root = np.sqrt(np.maximum(small**2 - (big * np.sin(around)) ** 2, 0.0))
        # The edge's two heights z at an azimuth of the run; between them is the mouth.
        low, high = ((big * np.cos(around) * cos + side * root) / sin for side in (-1.0, 1.0))
        return low.min(), high.max()

    def _add_branch(self, pieces: Pieces, ring: Ring, depth: float) -> None:
        """Staves of the branch, from the rim to the port."""
        big, small = self._edge_radii()
        (sin, cos), along = self.sin_cos, self.branch_axis
        across = np.array([cos, 0.0, -sin])
        half_angle = np.pi / len(ring.azimuths)
        for u in ring.azimuths:
            out = math.cos(u) * across + math.sin(u) * np.array([0, 1.0, 0])
            around = np.linspace(u - half_angle, u + half_angle, _CUT_SAMPLES)
            x = np.sqrt(np.maximum(big**2 - (small * np.sin(around)) ** 2, 0.0))
            start = ((x - small * np.cos(around) * cos) / sin).max()
            ring.add_stave(pieces, out, along, (start, self.branch_length), depth)

    def _add_rim(
        self, pieces: Pieces, q: Array, run_ring: Ring, branch_ring: Ring, depth: float
    ) -> None:
        """Capsules along the angles ``q`` of the edge, and the strips on either side of them."""
        edge = edge_curve(q, *self._edge_radii(), self.angle)
        for a, b in itertools.pairwise(edge):
            pieces.capsule(a, b, self.fillet_radius)
        axes = (
            (np.array([0, 0, 1.0]), self.radius, run_ring),
            (self.branch_axis, self.branch_radius, branch_ring),
        )
        outward = [unit(edge - np.outer(edge @ axis, axis)) for axis, _, _ in axes]
        for (axis, radius, ring), mine, other in zip(axes, outward, reversed(outward), strict=True):
            # A tenth wider than a share of a stave, so that rows overlap instead of leaving gaps.
            strip = 1.1 * 2 * radius * math.tan(np.pi / len(ring.azimuths)) / STRIP_ROWS
            line = edge - self.fillet_radius * mine
            pieces.add_strips(line, axis, radius, other, strip, depth, self.extent)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: the rim is rounded outside, too; the crotch is as thick as the rest."""
        return self._solid(kit, more, 0.0)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``."""
        return self._solid(kit, 0.0, kit.overcut)

    def _solid(self, kit: Kit, more: float, longer: float) -> Solid:
        """Return the bores, their rim rounded, and ``more`` m around them, between the ports."""
        solid = kit.cylinder(self.run_length, self.radius + more, centred=True)
        for part in self.branch_solids(kit, more, longer):
            solid += part
        return solid

    def branch_solids(self, kit: Kit, more: float, longer: float) -> list[Solid]:
        """Return the branch's bore and what the fillet rounds off its rim, see ``_solid``."""
        radius, branch_radius, along = (
            self.radius + more,
            self.branch_radius + more,
            self.branch_axis,
        )
        turned = Pose(np.stack([np.cross(Y, along), Y, along], axis=-1))
        solids = [kit.moved(kit.cylinder(self.branch_length + longer, branch_radius), turned)]
        # The outer wall is parallel to the bore, so its ball is smaller by the wall's thickness.
        fillet = self.fillet_radius - more
        depth = fillet * (1 / math.sin(self.angle / 2) - 1)  # of what fills the crotch
        if fillet > 2 * kit.overcut and depth > MIN_FILL:
            for q in self._solid_rim_angles(kit.sections):
                solids.append(self._fillet(kit, q, radius, branch_radius, fillet))
        return solids

    def _solid_rim_angles(self, sections: int) -> list[Array]:
        """Angles round the branch, rad, of cross-sections: a closed line, or two open ones."""
        step = 2 * np.pi / sections
        if self.radius - self.branch_radius < EQUAL:
            # Half way between the corners of the cylinders: threads may stay where corners
            # coincide.
            around = (np.arange(sections // 2) + 0.5) * step
            return [np.asarray(around + turn, float) for turn in (-np.pi / 2, np.pi / 2)]
        # Where the edge bends sharply, even steps along the hyperbola as well; see
        # ``wye_surface``.
        big, small = self._edge_radii()
        # Half axis of the hyperbola (x + w)(x - w) = A² - B² that the edge is when seen along y.
        gap = math.sqrt(big**2 - small**2)
        along = gap / small * np.sinh(np.linspace(-3, 3, 25))
        bend = np.arccos(along[np.abs(along) < 1])
        q = np.sort(np.concatenate([np.arange(sections) * step, bend, 2 * np.pi - bend]))
        return [np.asarray(q[np.diff(q, append=q[0] + 2 * np.pi) > 0.1 * step], float)]

    def _fillet(
        self, kit: Kit, q: Array, radius: float, branch_radius: float, fillet: float
    ) -> Solid:
        """Return what a ball of radius ``fillet`` m rounds off the rim, at angles ``q``.

        These are angles round the branch, rad.
        """
        centre = edge_curve(q, radius + fillet, branch_radius + fillet, self.angle)
        corner = edge_curve(q, radius - kit.overcut, branch_radius - kit.overcut, self.angle)
        axis = self.branch_axis
        to_run = unit(centre * [1, 1, 0])
        to_branch = unit(centre - np.outer(centre @ axis, axis))
        # Equal bores give two open lofts that need end caps, a smaller branch one closed ring.
        closed = self.radius - self.branch_radius >= EQUAL
        return rounded_rim(kit, centre, corner, (to_run, to_branch), fillet, closed=closed)


def edge_curve(q: Array, big: float, small: float, angle: float) -> Array:
    """Return points (..., 3) m of the edge at angles ``q`` (...,) rad round the branch.

    ``big``, ``small``: A and B of ``wye_surface``, m. ``angle``: rad.
    """
    y, w = small * np.sin(q), small * np.cos(q)
    x = np.sqrt(big * big - small * small + w * w)
    return np.stack([x, y, (x * math.cos(angle) - w) / math.sin(angle)], axis=-1)


@lru_cache(maxsize=1024)  # fittings are values, and planning asks for the same few again and again
def _axis_curve(fitting: Branched, enter: str, leave: str, arcs: Arcs) -> AxisCurve:
    start, turn = fitting.ports[enter], fitting.turn_angle(enter, leave)
    tangent, half = -start.rotation[:, 2], fitting.run_length / 2
    if turn == 0:
        length = 2 * fitting.branch_length if leave in fitting.branches else fitting.run_length
        return AxisCurve(start.position, tangent, start.rotation[:, 0], ((length, 0.0),))
    # The arc depends on the direction: out of a branch a wide one passes more often (`Arcs`).
    wanted, first, last = (
        (arcs.turn, half, fitting.branch_length)
        if leave in fitting.branches
        else (arcs.merge, fitting.branch_length, half)
    )
    # An arc of radius q takes q tan(turn / 2) of either axis; tan(pi / 4) is not quite 1.
    slope = 1.0 if turn == math.pi / 2 else math.tan(turn / 2)
    onward = fitting.ports[leave].rotation[:, 2]
    normal = unit(onward - tangent * (onward @ tangent))
    radius = min(wanted, half / slope, fitting.branch_length / slope)
    radius = fitting.clear_of_rim(radius, tangent, normal, turn)
    cut = radius * slope
    lines = ((first - cut, 0.0), (radius * turn, 1 / radius), (last - cut, 0.0))
    segments = tuple(segment for segment in lines if segment[0] > 1e-12)
    return AxisCurve(start.position, tangent, normal, segments)
