"""What stands on a pipe's wall as a solid of closed distance: the bead of a weld, a bed of deposit.

Seen from the bore the distance to pipe and solids together is the least of theirs. A solid has a
frame of its own: the origin on the pipe's axis, z along it, x towards the solid's middle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, rotation_about
from omnitrack_sim.pipes.compiled import FACE, HIGH, LOW, Wall, compiled, put
from omnitrack_sim.pipes.native import SIGNATURES, at, c_function
from omnitrack_sim.pipes.shapes import THICKNESS, Kit, Pieces, Solid, stave_count

BEAD, BED = 1.0, 2.0
"""Kinds of solids."""
CODE, LIMIT, FIRST = 0, 1, 2
"""Indices in the numbers of a solid: its kind; distance from the pipe's axis, m, beyond which a
point is no longer one of this pipe's; and the first of those of its kind."""
RING, TUBE, HALF_ARC, OVAL, TOWARD = range(FIRST, FIRST + 5)
"""Of a bead: distance from the axis at which its cross-section's centre lies, m; radius of the
cross-section, m; half of the angle round the pipe, rad, pi for all round; amplitude, m, by which
that distance goes as the cosine of twice the angle, on a wall that is out of round, and the angle,
rad, at which it is largest."""
LEVEL, HALF, SINE, COSINE, ROUND = FIRST, FIRST + 1, FIRST + 2, FIRST + 3, FIRST + 4
"""Of a bed: distance of its surface from the axis, m; half of the length at which a rounded end
begins, m, both less the radius by which its upper edges are rounded; sine and cosine of the slope
of its ends; that radius, m."""
NUMBERS = 8
"""Of a solid."""
RING_STEPS = 30
"""Of Newton's method on an oval ring, at most."""
BEYOND = 1e-3
"""Depth, m, to which solids of beads reach into the wall."""


@compiled
def _ring_at(numbers, angle):
    """Distance from the axis, and its derivatives, of a bead's middle at an angle."""
    double = 2.0 * (angle - numbers[TOWARD])
    c, d = numbers[OVAL] * math.cos(double), numbers[OVAL] * math.sin(double)
    return numbers[RING] + c, -2.0 * d, -4.0 * c


@compiled
def _foot_on_ring(numbers, rho, theta, angle):
    """Return the angle of the foot on an oval ring that Newton's method finds, and the square."""
    for _ in range(RING_STEPS):
        q, q1, q2 = _ring_at(numbers, angle)
        cos, sin = math.cos(angle - theta), math.sin(angle - theta)
        first = q1 * (q - rho * cos) + rho * q * sin
        second = q2 * (q - rho * cos) + q1 * (q1 + 2.0 * rho * sin) + rho * q * cos
        # Not near a minimum: downhill.
        step = -first / second if second > 0.1 * q * rho else -first / (q * q)
        angle += min(max(step, -0.3), 0.3)
        if abs(step) < 1e-12:
            break
    q, _, _ = _ring_at(numbers, angle)
    return angle, q * q + rho * rho - 2.0 * rho * q * math.cos(angle - theta)


@compiled
def _on_oval(numbers, x, y):
    """Return the angle of the place of an oval ring that is nearest to a point across the pipe."""
    rho, theta = math.sqrt(x * x + y * y), math.atan2(y, x)
    angle, least = _foot_on_ring(numbers, rho, theta, theta)
    # Near the axis there are several.
    if rho < 0.6 * numbers[RING]:
        for k in range(4):
            start = numbers[TOWARD] + 0.5 * math.pi * k
            other, square = _foot_on_ring(numbers, rho, theta, start)
            if square < least:
                angle, least = other, square
    return angle


@compiled
def _from_bead(numbers, x, y, z, out):
    """Return the distance from an arc of a ring, m; the gradient goes to ``out``."""
    ring, half = numbers[RING], numbers[HALF_ARC]
    away = math.sqrt(x * x + y * y)
    cos, sin = (x / away, y / away) if away > 1e-12 else (1.0, 0.0)
    if numbers[OVAL] != 0.0:
        angle = _on_oval(numbers, x, y)
        cos, sin = math.cos(angle), math.sin(angle)
        ring = _ring_at(numbers, angle)[0]
    if half < math.pi and cos < math.cos(half):
        angle = math.copysign(half, y)
        cos, sin, ring = math.cos(half), math.sin(angle), _ring_at(numbers, angle)[0]
    u, v = x - ring * cos, y - ring * sin
    size = math.sqrt(u * u + v * v + z * z)
    if size < 1e-12:
        put(out, -cos, -sin, 0.0, FACE)
    else:
        put(out, u / size, v / size, z / size, FACE)
    return size - numbers[TUBE]


@compiled
def _from_bed(numbers, x, z, out):
    """Return the distance from a bed with sloping ends, m; the gradient goes to ``out``."""
    sine, cosine = numbers[SINE], numbers[COSINE]
    side = math.copysign(1.0, z)
    # From the upper edge of the bed without its rounding: along it, and up.
    along, up = abs(z) - numbers[HALF], numbers[LEVEL] - x
    before = along * sine + up * cosine
    if along > 0.0 and up * sine > along * cosine and before > 0.0:
        size = math.sqrt(along * along + up * up)
        put(out, -up / size, 0.0, side * along / size, FACE)
        return size - numbers[ROUND]
    if up >= before:
        put(out, -1.0, 0.0, 0.0, FACE)
        return up - numbers[ROUND]
    put(out, -cosine, 0.0, side * sine, FACE)
    return before - numbers[ROUND]


@compiled
def distance(numbers, x, y, z, out):
    """See ``compiled.Wall``: the distance from a solid."""
    if numbers[CODE] == BEAD:
        return _from_bead(numbers, x, y, z, out)
    return _from_bed(numbers, x, z, out)


@compiled
def _span(numbers, _ends, px, py, _pz, _ax, _ay, _az, out):
    """See ``compiled.Wall``: everywhere, but for points of another pipe."""
    if px * px + py * py > numbers[LIMIT] * numbers[LIMIT]:
        out[HIGH] = out[LOW] - 1.0
    return 1.0


@compiled
def nearest(solids, count, curvature, x, y, z, d, out):
    """Return the least of a distance and of those from the solids of a pipe.

    Args:
        solids: for each ``PLACED`` numbers: arc length of its frame, m, cosine and sine of the
            angle of its x axis about the pipe's axis, and its own numbers.
        count: of them.
        curvature: of the pipe's axis, 1/m, towards x.
        x: m, of a point in the fitting's frame.
        y: likewise.
        z: likewise.
        d: m, distance from the wall without them, whose gradient is in ``out``.
        out: gets the gradient.
    """
    gx, gy, gz = out[0], out[1], out[2]
    for i in range(count):
        solid = at(solids, PLACED * i)
        s, cos, sin = solid[0], solid[1], solid[2]
        px, pz, c, b = x, z - s, 1.0, 0.0
        if curvature != 0.0:
            c, b = math.cos(curvature * s), math.sin(curvature * s)
            px, pz = x - (1.0 - c) / curvature, z - b / curvature
            px, pz = c * px - b * pz, b * px + c * pz
        u, v = cos * px + sin * y, cos * y - sin * px
        there = distance(at(solid, 3), u, v, pz, out)
        if there < d:
            d = there
            hx, gy, hz = cos * out[0] - sin * out[1], sin * out[0] + cos * out[1], out[2]
            gx, gz = c * hx + b * hz, c * hz - b * hx
    put(out, gx, gy, gz, out[3])
    return d


PLACED = 3 + NUMBERS
"""Numbers of a solid with its place."""


@dataclass(frozen=True)
class Obstacle:
    """A solid on the wall of a pipe.

    Attributes:
        s: m, arc length along the pipe's axis at which its frame stands.
        angle: rad, of its x axis about the pipe's axis, from the pipe's.
        shape: kind and numbers of the kind, see ``CODE``, but for the limit.
        clear: m, distance of its nearest point from the pipe's axis.
        bounds: lowest and highest corner, m, of a box around what of it is in the bore, own frame.
        friction: its own; None for that of the wall.
    """

    s: float
    angle: float
    shape: tuple[float, ...]
    clear: float
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    friction: float | None = None
    wall: ClassVar[Wall] = Wall(distance, _span)

    @classmethod
    def file_kind(cls) -> str:
        """Return what stands for it where fittings have their kind."""
        return "obstacle"

    @classmethod
    def wall_address(cls, name: str) -> int:
        """Address of a function of ``wall`` as compiled C code."""
        return c_function(getattr(cls.wall, name), SIGNATURES[name]).address

    def sizes(self, limit: float = math.inf) -> tuple[float, ...]:
        """The numbers that compiled functions get; see ``LIMIT``."""
        code, *own = self.shape
        return (code, limit, *own, *[0.0] * (NUMBERS - FIRST - len(own)))

    @property
    def placed(self) -> tuple[float, ...]:
        """The numbers of ``nearest``."""
        return (self.s, math.cos(self.angle), math.sin(self.angle), *self.sizes())

    @property
    def bumps(self) -> float:
        """Width, m, of what of it bulges all round: the ends of a bead; 0 where nothing does."""
        code, _, tube, half = self.shape[:4]
        return tube if code == BEAD and half < math.pi else 0.0

    def pose(self, frame: Pose) -> Pose:
        """Return its frame, from that of the pipe's axis at its place: z along, x to one side."""
        return frame @ Pose(rotation_about([0, 0, 1], self.angle), np.zeros(3))

    def solid(self, kit: Kit) -> Solid:
        """Return its solid, own frame."""
        numbers = self.sizes()
        if numbers[CODE] == BEAD:
            return _bead_solid(kit, numbers, self.bounds[1][0])
        return self._bed_solid(kit)

    def _bed_solid(self, kit: Kit) -> Solid:
        """Return the solid of a bed: a prism across the pipe over its profile along it."""
        profile, aside = self._profile(), 1.1 * self.bounds[1][1]
        # The prism's axis lies along -y; x of the outline is that of the bed's frame, y its z.
        frame = Pose(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.array([0, aside, 0]))
        return kit.moved(kit.prism(2 * aside, profile), frame)

    def _profile(self) -> Array:
        """Corners (k, 2) m of a bed's profile, x and z, anticlockwise."""
        level, half, sine, cosine, rounding = self.sizes()[LEVEL : ROUND + 1]
        slope, bottom = math.atan2(sine, cosine), 1.2 * self.bounds[1][0]
        turns = np.linspace(0.0, slope, 7)
        arc = np.stack([level - rounding * np.cos(turns), half + rounding * np.sin(turns)], axis=-1)
        run = (bottom - arc[-1, 0]) * cosine / sine
        side = np.vstack([arc, [bottom, arc[-1, 1] + run]])
        # From the far end of the floor round over the top: x points down, so this is clockwise.
        return np.vstack([side[::-1] * [1, -1], side])[::-1]

    def add_pieces(self, pieces: Pieces, frame: Pose, tolerance: float) -> None:
        """Add it as capsules or boxes to the pieces of a wall.

        Args:
            pieces: to add to, fitting frame.
            frame: of the pipe's axis at its place, see ``pose``.
            tolerance: m, largest distance from its surface.
        """
        own, numbers = Pieces(), self.sizes()
        if numbers[CODE] == BEAD:
            tube, half = numbers[TUBE : HALF_ARC + 1]
            angles = np.linspace(-half, half, self.piece_count(tolerance) + 1)
            ring = (numbers[RING] + _oval(numbers, angles))[:, None]
            places = ring * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
            for a, b in pairwise(places):
                own.capsule(a, b, tube)
        else:
            self._add_bed(own)
        pieces.add(own, self.pose(frame))

    def _add_bed(self, pieces: Pieces) -> None:
        """Add a bed's top, its ends, and capsules along its edges."""
        level, half, sine, cosine, rounding = self.sizes()[LEVEL : ROUND + 1]
        aside, (floor, _, toe) = self.bounds[1][1], self.bounds[1]
        x, y = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
        if half > 0:
            pieces.facet((level - rounding) * x, x, y, half, aside)
        for side in (-1.0, 1.0):
            edge = np.array([level, 0.0, side * half])
            normal = np.array([cosine, 0.0, -side * sine])
            toe_point = np.array([floor, 0.0, side * toe])
            begin = edge - rounding * normal
            way = float(np.linalg.norm(toe_point - begin)) / 2
            pieces.facet((begin + toe_point) / 2, normal, y, way, aside, min(THICKNESS, way))
            pieces.capsule(edge - aside * y, edge + aside * y, rounding)

    def piece_count(self, tolerance: float) -> int:
        """Return how many pieces ``add_pieces`` adds."""
        if self.shape[0] != BEAD:
            return 5
        ring, half = self.sizes()[RING], self.sizes()[HALF_ARC]
        return max(2, math.ceil(stave_count(ring, tolerance / 2) * half / math.pi))


def _bead_solid(kit: Kit, numbers: tuple[float, ...], radius: float) -> Solid:
    """Return the solid of a bead in a bore: a ring, or an arc of one with balls at its ends."""
    ring, tube, half = numbers[RING : HALF_ARC + 1]
    # Only what is in the bore, and a little of what is not.
    beyond = radius + BEYOND
    widest = math.acos(max((ring - beyond) / tube, 0.0))
    turns = np.linspace(-widest, widest, 25)
    arc = np.stack([ring - tube * np.cos(turns), tube * np.sin(turns)], axis=-1)
    disc = np.vstack([arc[::-1], [[beyond, arc[0, 1]], [beyond, arc[-1, 1]]]])
    if half >= math.pi and numbers[OVAL] == 0:
        return kit.revolved(disc)
    count = max(3, math.ceil(kit.sections * half / math.pi))
    angles = np.linspace(-half, half, count + 1)[: count + (half < math.pi)]
    across = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    radii = disc[None, :, 0] + _oval(numbers, angles)[:, None]
    rings = radii[..., None] * across[:, None] + disc[None, :, 1:] * np.array([0.0, 0, 1])
    if half >= math.pi:
        return kit.loft(rings, None)
    solid: Any = kit.loft(rings, 0)
    turns = np.linspace(-np.pi / 2, np.pi / 2, 13)
    ball = kit.revolved(tube * np.stack([np.cos(turns), np.sin(turns)], axis=-1))
    for k in (0, -1):
        place = (ring + _oval(numbers, angles)[k]) * across[k]
        solid += kit.moved(ball, Pose(np.eye(3), place))
    return solid


def _oval(numbers: tuple[float, ...], angles: Array) -> Array:
    """Return what the ring of a bead is farther from the axis, m, at angles (k,) rad."""
    return numbers[OVAL] * np.cos(2 * (angles - numbers[TOWARD]))


def bead(
    s: float,
    radius: float,
    height: float,
    width: float,
    angle: float,
    half_arc: float,
    oval: float,
    toward: float,
) -> Obstacle:
    """Return the bead of a weld: an arc of a circle in cross-section.

    Args:
        s: m, of its middle along the pipe.
        radius: m, of the wall below it, on the mean.
        height: m, above the wall.
        width: m, along the pipe.
        angle: rad, of its middle about the axis.
        half_arc: rad, half of its length round the pipe; pi all round.
        oval: m, amplitude of the second harmonic of the wall's radius; 0 on a round one.
        toward: rad, of the longest diameter about the axis.
    """
    tube = (width * width / 4 + height * height) / (2 * height)
    ring, top, half = radius + tube - height, radius - height - abs(oval), min(tube, width / 2)
    reach = radius + abs(oval)
    aside = reach if half_arc >= math.pi / 2 else reach * math.sin(half_arc) + half
    near = top * math.cos(half_arc) - half if half_arc < math.pi else -reach
    corners = (max(near, -reach), -aside, -half), (reach, aside, half)
    shape = BEAD, ring, tube, half_arc, oval, toward - angle
    return Obstacle(s, angle, shape, top, corners)


def bed(
    s: float,
    floor: float,
    reach: float,
    depth: float,
    half: float,
    slope: float,
    rounding: float,
    angle: float,
    friction: float | None,
) -> Obstacle:
    """Return a flat bed with sloping ends.

    Args:
        s: m, of its middle along the pipe.
        floor: m, from the pipe's axis to the wall in the middle of the bed.
        reach: m, from the axis to the farthest place of the wall.
        depth: m, of the bed.
        half: m, half of its length along the floor.
        slope: rad, of its ends.
        rounding: m, radius of its upper edges.
        angle: rad, of the bed's middle about the axis.
        friction: its own; None for that of the wall.
    """
    sine, cosine = math.sin(slope), math.cos(slope)
    along = half - ((depth - rounding) * cosine + rounding) / sine
    shape = (BED, floor - depth + rounding, along, sine, cosine, rounding)
    corners = (floor - depth, -reach, -half), (reach, reach, half)
    return Obstacle(s, angle, shape, floor - depth, corners, friction)


def corners_of(obstacle: Obstacle) -> tuple[Array, Array]:
    """Return the box around an obstacle: lowest and highest corner (3,) m."""
    low, high = obstacle.bounds
    return np.array(low), np.array(high)
