"""An equal tee: its run along z, centred at the origin, its branch along +x, its rim rounded."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

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
    Branched,
    FittingTable,
    X,
    Y,
    Z,
    check,
    fill_in,
    in_bores,
    positive,
)
from omnitrack_sim.pipes.shapes import THICKNESS, Kit, Pieces, Ring, Solid, sagitta, stave_count

RIM_SEGMENTS = 32
"""Capsules along each half of the rim."""
RIM_STRIP = 0.006
"""Width of one strip of boxes along the rim, m; two strips fill what the square-ended staves leave
open."""
CROTCH_PATCH = 0.007
"""Half width of the flat pieces where the two halves of the rim meet, m."""
FILLET_POINTS = 7
"""Points on the fillet's arc in meshes, ends included."""


@compiled
def surface(sizes, x, y, z, out):
    """See ``compiled.Wall``. Sizes: radius, half run, branch length, fillet radius, m.

    The bore is the union of a run along z and a branch along +x, both of radius R. The wall is its
    complement, opened by a ball of radius f: shrunk by f to E = {points rho = R + f or more from
    the run's axis and, for x > 0, the branch's}, then grown by f. The distance to the wall is
    therefore the distance to E less f. E has two faces, the cylinders of radius rho, and an edge
    where they meet: the half ellipses x = |z|, with semi-axes sqrt(2) rho and rho.

    A cylinder's foot, where it is on the wall, is never farther than the edge, which lies on both
    cylinders.
    """
    fillet = sizes[3]
    rho = sizes[0] + fillet
    from_run, from_branch = math.sqrt(x * x + y * y), math.sqrt(y * y + z * z)
    # Only the half x > 0 of the branch's cylinder bounds the bore; behind it the run is whole.
    beside = x < 0.0
    # Within the wall, deeper than the fillet.
    if from_run >= rho and (beside or from_branch >= rho):
        if beside or from_run <= from_branch:
            put(out, -x / from_run, -y / from_run, 0.0, FACE)
            return rho - from_run - fillet
        put(out, 0.0, -y / from_branch, -z / from_branch, FACE)
        return rho - from_branch - fillet
    best = math.inf
    gx = gy = gz = 0.0
    # The second condition asks whether the foot on the run's cylinder lies outside the branch.
    if from_run <= rho and (beside or abs(z) * from_run >= rho * x):
        best = rho - from_run
        if from_run > 1e-12:
            gx, gy = -x / from_run, -y / from_run
    if (
        from_branch <= rho
        and not beside
        and x * from_branch >= rho * abs(z)
        and rho - from_branch < best
    ):
        best = rho - from_branch
        gx = gy = gz = 0.0
        if from_branch > 1e-12:
            gy, gz = -y / from_branch, -z / from_branch
    if best < math.inf:
        put(out, gx, gy, gz, FACE)
        return best - fillet
    # No cylinder's foot lies on the wall: the rounded edge is nearest.
    ex, ey, ez = _onto_edge(x, y, z, rho)
    dx, dy, dz = x - ex, y - ey, z - ez
    away = math.sqrt(dx * dx + dy * dy + dz * dz)
    put(out, dx / away, dy / away, dz / away, EDGE)
    return away - fillet


@compiled
def _onto_edge(x, y, z, rho):
    """Nearest point of the edge (rho cos t, rho sin t, +-rho cos t), |t| <= 90 degrees.

    The root of g(t) = a u sin t - b v cos t - (a^2 - b^2) sin t cos t in the first quadrant, by
    Newton's method kept in a bracket; (u, v) is the point along the ellipse's axes.
    """
    # By symmetry the problem is that of one half ellipse in the quadrant y, z >= 0.
    root2 = math.sqrt(2.0)
    u, v = max(x + abs(z), 0.0) / root2, abs(y)
    a, b = root2 * rho, rho
    low, high = 0.0, math.pi / 2
    # The direction towards the point in the ellipse's own coordinates is close to the root.
    t = math.atan2(a * v, b * u) if u + v > 0 else 0.0
    sin, cos = math.sin(t), math.cos(t)
    for _ in range(60):
        g = a * u * sin - b * v * cos - (a * a - b * b) * sin * cos
        slope = a * u * cos + b * v * sin - (a * a - b * b) * (cos * cos - sin * sin)
        if g < 0.0:
            low = t
        else:
            high = t
        # Where the slope is not positive Newton's step leads away: the bracket is halved instead.
        new = t - g / slope if slope > 0.0 else low - 1.0
        if not low <= new <= high:
            new = 0.5 * (low + high)
        done = abs(new - t) < 1e-12
        t = new
        sin, cos = math.sin(t), math.cos(t)
        if done:
            break
    side_y = -1.0 if y < 0.0 else 1.0
    side_z = -1.0 if z < 0.0 else 1.0
    return rho * cos, side_y * rho * sin, side_z * rho * cos


@compiled
def span(sizes, ends, px, py, pz, ax, ay, az, out):
    """See ``compiled.Wall``: between the port planes."""
    clip(out, -pz - sizes[1], -az, ends[0])
    clip(out, pz - sizes[1], az, ends[1])
    clip(out, px - sizes[2], ax, ends[2])
    return 1.0


@compiled
def clear(sizes, px, py, pz, ax, ay, az):
    """See ``compiled.Wall``: up to where the line leaves both cylinders; the rounded rim leaves
    more."""
    low, high = in_bore(px, py, ax, ay, sizes[0])
    branch_low, branch_high = in_bore(py, pz, ay, az, sizes[0])
    # The branch exists on the side x > 0 only, so the line's part at x < 0 is cut off.
    if ax > 0.0:
        branch_low = max(branch_low, -px / ax)
    elif ax < 0.0:
        branch_high = min(branch_high, -px / ax)
    elif px < 0.0:
        branch_high = -math.inf
    return out_of_two(low, high, branch_low, branch_high)


@dataclass(frozen=True)
class Tee(Branched):
    """An equal tee: run of ``run_length`` m, branch that ends ``branch_length`` m from the run's
    axis, rim rounded.

    The rim's ``fillet_radius`` m is that of a ball that rolls inside the wall: the solid wall is
    opened by it.

    Example:
        >>> ot.Tee().describe("run_start", "branch").words
        'run to branch'
    """

    run_length: float = in_bores(2)
    branch_length: float = in_bores(1)
    fillet_radius: float = in_bores(1 / 32)
    inner_diameter: float = BORE
    kind: ClassVar[str] = "tee"
    wall: ClassVar[Wall] = Wall(surface, span, clear)

    class Table(FittingTable):
        """Keys in files."""

        run_length: Annotated[Size | None, Unit("m", "run")] = None
        """Along the run. Left out: 2 `inner_diameter`, 0.32 m at 160 mm."""
        branch_length: Annotated[Size | None, Unit("m", "branch")] = None
        """From the run's axis. Left out: `inner_diameter`."""
        fillet_radius: Annotated[Size | None, Unit("m")] = None
        """Of the rounded rim. Left out: 1/32 of `inner_diameter`, 5 mm at 160 mm."""

    def __post_init__(self) -> None:
        fill_in(self)
        least = self.inner_diameter / 2 + max(self.fillet_radius, 0.0)
        check(
            self.kind,
            inner_diameter=positive(self.inner_diameter),
            fillet_radius=(
                0 < self.fillet_radius <= self.inner_diameter / 4,
                f"is {self.fillet_radius} m; must be over 0 and at most a quarter of the diameter",
            ),
            run_length=(
                self.run_length / 2 >= least,
                f"is {self.run_length} m; must be at least {2 * least} m",
            ),
            branch_length=(
                self.branch_length >= least,
                f"is {self.branch_length} m; must be at least {least} m",
            ),
        )

    @property
    def branch_angle(self) -> float:
        """See ``Branched``."""
        return math.pi / 2

    @property
    def branch_axis(self) -> Array:
        """See ``Branched``."""
        return X

    def mouth(self, enter: str) -> tuple[float, float]:
        """See ``Branched``: as wide as the branch, about the point where the axes meet."""
        return self.branch_length if enter == "branch" else self.run_length / 2, self.radius

    def extent(self, points: Array) -> Array:
        """See ``Fitting``."""
        p = np.asarray(points, float)
        return np.minimum(self.run_length / 2 - np.abs(p[..., 2]), self.branch_length - p[..., 0])

    @property
    def sizes(self) -> tuple[float, ...]:
        """See ``surface``."""
        return self.radius, self.run_length / 2, self.branch_length, self.fillet_radius

    def add_walls(self, pieces: Pieces, tolerance: float, staves: int | None) -> None:
        """See ``Fitting``: staves of run and branch up to the rim's fillet, strips of boxes along
        it, capsules as the fillet itself. Within 10 mm of the rim the wall is within 0.5 mm of the
        exact surface at a tolerance of 0.1 mm."""
        # Staves end square, the rim is curved: each is cut where its farthest edge meets the
        # fillet.
        staves = staves or stave_count(self.radius, tolerance)
        ring = Ring.of(self.radius, staves)
        rho = self.radius + self.fillet_radius
        half_angle = math.pi / staves
        run, branch = self.run_length / 2, self.branch_length
        for u in ring.azimuths:
            out = np.array([math.cos(u), math.sin(u), 0.0])
            edges = np.cos([u - half_angle, u, u + half_angle])
            if edges.max() <= 1e-9:
                ring.add_stave(pieces, out, Z, (-run, run), THICKNESS)
            else:
                cut = rho * edges.max()
                for ends in ((cut, run), (-run, -cut)):
                    ring.add_stave(pieces, out, Z, ends, THICKNESS)
            # Staves of the branch: around the x axis, from the rim to the port.
            out = np.array([0.0, math.sin(u), math.cos(u)])
            cut = rho * np.abs(edges).max()
            ring.add_stave(pieces, out, X, (cut, branch), THICKNESS)
        for side in (1.0, -1.0):
            # Where the halves of the rim meet the wall is flat: run and branch share their tangent
            # plane.
            middle = side * (self.radius + 5e-5) * Y
            pieces.facet(middle, np.array([0, side, 0]), Z, CROTCH_PATCH, CROTCH_PATCH)
        self._add_rim(pieces, rho)

    def piece_count(self, tolerance: float, staves: int | None) -> int:
        """See ``Fitting``: a stave of the run may be cut in two; a capsule of the rim has four
        boxes beside it."""
        around = staves or stave_count(self.radius, tolerance)
        return 3 * around + 2 * 5 * RIM_SEGMENTS + 2

    def _add_rim(self, pieces: Pieces, rho: float) -> None:
        """Add the fillet as capsules, and two strips of boxes on either side of it."""
        t = np.linspace(-np.pi / 2, np.pi / 2, RIM_SEGMENTS + 1)
        radius = self.radius
        for side in (1.0, -1.0):
            saddle = rho * np.stack([np.cos(t), np.sin(t), side * np.cos(t)], axis=-1)
            for a, b in itertools.pairwise(saddle):
                pieces.capsule(a, b, self.fillet_radius)
            run_edge = np.stack(
                [radius * np.cos(t), radius * np.sin(t), side * rho * np.cos(t)], axis=-1
            )
            branch_edge = np.stack(
                [rho * np.cos(t), radius * np.sin(t), side * radius * np.cos(t)], axis=-1
            )
            _add_strips(pieces, run_edge, np.array([0, 0, side]), X + Y, radius)
            _add_strips(pieces, branch_edge, X, Y + Z, radius)

    def fill(self, kit: Kit, more: float) -> Solid:
        """See ``Fitting``: two cylinders."""
        radius = self.radius + more
        run = kit.cylinder(self.run_length, radius, centred=True)
        branch = kit.cylinder(self.branch_length, radius)
        along_x = Pose(np.stack([-Z, Y, X], axis=-1))
        return run + kit.moved(branch, along_x)

    def bore(self, kit: Kit) -> Solid:
        """See ``Fitting``: with the rim rounded."""
        return self.fill(kit, 0.0) + (self._fillet(kit, 1.0) + self._fillet(kit, -1.0))

    def _fillet(self, kit: Kit, side: float) -> Solid:
        """Return what a ball of the fillet radius rounds off the rim on one side of the branch
        (``side`` = sign of z).

        The ball's centre runs on the saddle where two cylinders of radius R + f meet. Each
        cross-section is bounded by the ball's arc between its two points of tangency and closed
        within the bores.
        """
        steps = kit.sections // 2
        angles = (np.arange(1, steps) - steps / 2) * 2 * math.pi / kit.sections
        cos, sin, zero = np.cos(angles), np.sin(angles), np.zeros_like(angles)
        to_run = np.stack([cos, sin, zero], axis=-1)  # (m, 3) away from the run's axis
        to_branch = np.stack([zero, sin, side * cos], axis=-1)
        diagonal = np.stack([cos, sin, side * cos], axis=-1)
        radius, fillet, overcut = self.radius, self.fillet_radius, kit.overcut
        centre = (radius + fillet) * diagonal
        weight = np.linspace(0.0, 1.0, FILLET_POINTS)[:, None, None]
        arc = (1 - weight) * to_run + weight * to_branch
        arc = centre - fillet * arc / np.linalg.norm(arc, axis=-1, keepdims=True)
        # arc: (FILLET_POINTS, m, 3)
        closing = (
            arc[-1] - overcut * to_branch,
            (radius - overcut) * diagonal,
            arc[0] - overcut * to_run,
        )
        rings = np.concatenate([arc, np.stack(closing)])
        return kit.loft(rings.transpose(1, 0, 2), hub=FILLET_POINTS + 1)


def _add_strips(pieces: Pieces, edge: Array, away: Array, across: Array, radius: float) -> None:
    """Boxes along the line ``edge`` (k, 3) where the fillet begins, tangent to the cylinder, on its
    ``away`` side.

    ``across`` keeps the coordinates across the cylinder's axis.
    """
    for a, b in itertools.pairwise(edge):
        middle = (a + b) / 2
        out = unit(middle * across)
        tangent = unit((b - a) - out * ((b - a) @ out))
        beyond = np.cross(out, tangent)
        beyond = beyond if beyond @ away > 0 else -beyond
        # A fifth longer than the chord, so that neighbouring boxes overlap where the edge bends.
        half_length = 0.6 * float(np.linalg.norm(b - a))
        for strip in range(2):
            point = middle + beyond * RIM_STRIP * (strip + 0.5)
            normal = unit(point * across)
            # A strip lies askew on the cylinder; its bulge is taken as that of half its diagonal at
            # 45 degrees.
            bent = sagitta(radius, math.hypot(RIM_STRIP / 2, half_length) / radius / math.sqrt(2))
            face = point * (1 - across) + normal * (radius - bent / 2)
            along = unit(tangent - normal * (tangent @ normal))
            pieces.facet(face, normal, along, 0.5 * RIM_STRIP, half_length)
