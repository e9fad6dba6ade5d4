"""Cross-sections of pipes: circles, ovals, and the egg, mouth and arch of sewers.

All are convex, so the distance to a wall of any of them is concave along lines. A section lies
about the middle of the largest circle in it, the pipe's axis. It has two axes of its own: u towards
an oval's longest diameter, or the invert (the lowest line) of the others, and v, about which it is
symmetric. Angles of normals go from u to v.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.compiled import FACE, compiled, crossing, put

SectionName = Literal["circle", "oval", "egg", "mouth", "arch"]
"""Names of sections in files."""
CODES = {"circle": 0.0, "oval": 1.0, "egg": 2.0, "mouth": 3.0, "arch": 4.0}
OVAL, EGG, MOUTH = 1.0, 2.0, 3.0
"""Numbers that stand for sections in compiled code; 0 for a circle."""
CODE, COS, SIN, FIRST, SECOND = 0, 1, 2, 3, 4
"""Indices in the numbers of a section: code, cosine and sine of the angle of u in the pipe, both
half axes, m, of an oval, or half of the width, m, of another one."""
MAX_OVALITY = 0.5
"""Far beyond the 0.05 to 0.15 at which pipes are relined or replaced."""
ELLIPSE_STEPS, ELLIPSE_ACCURACY = 40, 1e-8
"""Of Newton's method for the foot on an ellipse: steps at most, and the relative one that is the
last: what is left of it is about its square. Two or three do for ovals of pipes."""
ROUNDING = 1e-12
"""Part of a half width by which a point may lie beyond an arc's sector."""


@compiled
def arcs(code):
    """Return radius and place of the arcs of a section of width 2 in its half v >= 0.

    Radius of the arc about the invert and the u of its centre on the axis of symmetry; radius of
    the one beside it, and u and v of its centre; radius and u of the crown's. Each goes on where
    the last one ends, in the same direction.
    """
    if code == EGG:
        # DIN 4263, normal egg, width to height 2 : 3: radii r / 2, 3 r and r; area 4.594 r².
        return 0.5, 1.5, 3.0, 0.0, -2.0, 1.0, 0.0
    if code == MOUTH:
        # DIN 4263, normal mouth, 2 : 1.5: radii 2 r and r; that beside is tangent to the bottom and
        # to the semicircle's ends, 3 r / 8; area 2.378 r².
        return 2.0, -1.25, 0.375, 0.25, 0.625, 1.0, 0.25
    # ASTM C506, arch of 18 inches span and 11 rise (equivalent to a circle of 15): radii of 22 7/8,
    # 4 1/32 and 10 5/8 inches; area 1.09 square feet.
    bottom, side, crown = 22.875 / 9.0, 4.03125 / 9.0, 10.625 / 9.0
    beside = 1.0 - side
    # Heights of the centres below that of the bottom arc, from the tangency of neighbours.
    low = math.sqrt((bottom - side) ** 2 - beside * beside)
    high = low + math.sqrt((crown - side) ** 2 - beside * beside)
    middle = 0.5 * (bottom + high - crown)
    return bottom, -middle, side, low - middle, beside, crown, high - middle


@compiled
def _sectors(code):
    """Return the normals, of any length, at both joints of the arcs: u, v; u, v."""
    bottom, low, side, u, v, crown, high = arcs(code)
    # Centres and joint lie on one line; the larger circle's centre is farther from the joint.
    one, other = math.copysign(1.0, side - bottom), math.copysign(1.0, side - crown)
    return one * (low - u), -one * v, other * (high - u), -other * v


@compiled
def _from_arc(u, v, radius, way_u, way_v):
    """Return the distance from an arc and its gradient, of a point relative to the centre.

    ``way``: direction of the arc's foot of the centre itself.
    """
    away = math.sqrt(u * u + v * v)
    if away < 1e-12:
        return radius, -way_u, -way_v
    return radius - away, -u / away, -v / away


@compiled
def _from_arcs(code, u, v):
    """Return the distance from three arcs, v >= 0, and its gradient; the width is 2.

    In the bore it is the least distance from those arcs in whose sectors the point lies.
    """
    bottom, low, side, us, vs, crown, high = arcs(code)
    au, av, bu, bv = _sectors(code)
    best, gu, gv = math.inf, 0.0, 0.0
    if (u - low) * av - v * au >= -ROUNDING:
        best, gu, gv = _from_arc(u - low, v, bottom, 1.0, 0.0)
    p, q = u - us, v - vs
    if au * q - av * p >= -ROUNDING and p * bv - q * bu >= -ROUNDING:
        d, hu, hv = _from_arc(p, q, side, 0.0, 1.0)
        if d < best:
            best, gu, gv = d, hu, hv
    if bu * v - bv * (u - high) >= -ROUNDING:
        d, hu, hv = _from_arc(u - high, v, crown, -1.0, 0.0)
        if d < best:
            best, gu, gv = d, hu, hv
    return best, gu, gv


@compiled
def _eccentric(u, v, a, b):
    """Return cosine and sine of the eccentric angle of a point's foot on an ellipse, u, v >= 0.

    The half axes are a >= b. With the multiplier t of the foot, and w = t + b², these are
    a u / (w + a² - b²) and b v / w.
    """
    square = a * a - b * b
    w = max(b * v, a * u - square)
    if w <= 0.0:
        # On the longer axis between the centres of curvature two feet are as near.
        cos = a * u / square if square > 0.0 else 1.0
        return cos, math.sqrt(max(1.0 - cos * cos, 0.0))
    cos, sin = a * u / (w + square), b * v / w
    for _ in range(ELLIPSE_STEPS):
        # The inverse of the vector's length is concave and nearly a line, so that Newton's method
        # goes to its root from below without passing it.
        length = math.sqrt(cos * cos + sin * sin)
        fall = cos * cos / (w + square) + sin * sin / w
        step = (length - 1.0) * length * length / fall
        w += step
        cos, sin = a * u / (w + square), b * v / w
        if step <= ELLIPSE_ACCURACY * w:
            break
    length = math.sqrt(cos * cos + sin * sin)
    return cos / length, sin / length


@compiled
def _from_ellipse(u, v, a, b):
    """Return the distance from an ellipse of half axes a >= b, and its gradient; v >= 0."""
    side = math.copysign(1.0, u)
    cos, sin = _eccentric(abs(u), v, a, b)
    nu, nv = cos / a, sin / b
    size = math.sqrt(nu * nu + nv * nv)
    nu, nv = nu / size, nv / size
    d = (a * cos - abs(u)) * nu + (b * sin - v) * nv
    return d, -side * nu, -nv


@compiled
def distance(section, x, y, out):
    """Return the distance, m, of a point across a pipe from its section, positive in the bore.

    Args:
        section: its numbers, see ``CODE``; not a circle.
        x: m, from the pipe's axis.
        y: likewise.
        out: the unit gradient and the face are written to it, see ``compiled.Wall``.
    """
    cos, sin = section[COS], section[SIN]
    u, v = cos * x + sin * y, cos * y - sin * x
    side, v = math.copysign(1.0, v), abs(v)
    if section[CODE] == OVAL:
        d, gu, gv = _from_ellipse(u, v, section[FIRST], section[SECOND])
    else:
        size = section[FIRST]
        d, gu, gv = _from_arcs(section[CODE], u / size, v / size)
        d *= size
    gv *= side
    put(out, cos * gu - sin * gv, sin * gu + cos * gv, 0.0, FACE)
    return d


@compiled
def _out_of_arc(u, v, au, av, radius):
    """Return where a line leaves a circle about the origin; below 0 where it does not meet it."""
    a, b, c = au * au + av * av, u * au + v * av, u * u + v * v - radius * radius
    under = b * b - a * c
    return (math.sqrt(under) - b) / a if under > 0.0 and a > 0.0 else -1.0


@compiled
def _out_of_arcs(code, u, v, au, av):
    """Return where a line from a point in a section of width 2 leaves it on the side v >= 0.

    It is infinite where it does not.
    """
    bottom, low, side, us, vs, crown, high = arcs(code)
    ju, jv, ku, kv = _sectors(code)
    leaves = math.inf
    s = _out_of_arc(u - low, v, au, av, bottom)
    p, q = u - low + s * au, v + s * av
    if s > 0.0 and q >= -ROUNDING and p * jv - q * ju >= -ROUNDING:
        leaves = s
    s = _out_of_arc(u - us, v - vs, au, av, side)
    p, q = u - us + s * au, v - vs + s * av
    if s > 0.0 and ju * q - jv * p >= -ROUNDING and p * kv - q * ku >= -ROUNDING:
        leaves = min(leaves, s)
    s = _out_of_arc(u - high, v, au, av, crown)
    p, q = u - high + s * au, v + s * av
    if s > 0.0 and q >= -ROUNDING and ku * q - kv * p >= -ROUNDING:
        leaves = min(leaves, s)
    return leaves


@compiled
def leaving(section, x, y, ax, ay, out):
    """Return how far along a line (x, y) + s (ax, ay), m, it leaves the section; 0.0 outside it.

    Args:
        section: its numbers, see ``CODE``; not a circle.
        x: m, from the pipe's axis.
        y: likewise.
        ax: of the line's direction, shorter than 1 where the line is not square to the axis.
        ay: likewise.
        out: room for four numbers.
    """
    cos, sin = section[COS], section[SIN]
    u, v, au, av = cos * x + sin * y, cos * y - sin * x, cos * ax + sin * ay, cos * ay - sin * ax
    if section[CODE] == OVAL:
        p, q = 1.0 / (section[FIRST] * section[FIRST]), 1.0 / (section[SECOND] * section[SECOND])
        c = 1.0 - u * u * p - v * v * q
        return crossing(-au * au * p - av * av * q, -u * au * p - v * av * q, c) if c > 0.0 else 0.0
    if distance(section, x, y, out) <= 0.0:
        return 0.0
    if au * au + av * av < 1e-20:
        return math.inf
    size = section[FIRST]
    u, v, au, av = u / size, v / size, au / size, av / size
    one, other = (
        _out_of_arcs(section[CODE], u, v, au, av),
        _out_of_arcs(section[CODE], u, -v, au, -av),
    )
    leaves = min(one, other)
    # By rounding a line may miss both arcs at their joint.
    return leaves if leaves < math.inf else 0.0


class _Arc(NamedTuple):
    """An arc of a section: normals from start to end, rad, centre (2,) m, and radius, m."""

    start: float
    end: float
    centre: Array
    radius: float


@dataclass(frozen=True)
class Section:
    """The cross-section of a bore, but for a circle.

    Attributes:
        name: what it is called in files.
        size: m, the nominal diameter of an oval, the width of another section.
        ovality: of an oval, the difference of its longest and shortest diameter over the nominal.
        direction: rad, of u from the pipe's x axis.
    """

    name: SectionName
    size: float
    ovality: float = 0.0
    direction: float = 0.0

    @property
    def numbers(self) -> tuple[float, ...]:
        """The numbers that compiled code gets, see ``CODE``."""
        turn = math.cos(self.direction), math.sin(self.direction)
        return (CODES[self.name], *turn, *self._halves)

    @property
    def _halves(self) -> tuple[float, float]:
        """Half axes of an oval, m; else half of the width."""
        half = self.size / 2
        return half * (1 + self.ovality / 2), half * (1 - self.ovality / 2)

    @cached_property
    def inscribed_radius(self) -> float:
        """Radius, m, of the largest circle in it, about the pipe's axis."""
        if self.name == "oval":
            return self._halves[1]
        return self.size / 2 * _from_arcs(CODES[self.name], 0.0, 0.0)[0]

    @cached_property
    def max_radius(self) -> float:
        """Greatest distance, m, of its edge from the pipe's axis."""
        if self.name == "oval":
            return self._halves[0]
        return float(np.linalg.norm(self.points(np.linspace(0, 2 * np.pi, 1441)), axis=1).max())

    @cached_property
    def _arcs(self) -> tuple[_Arc, ...]:
        """Its arcs all round, from the first beside the invert; none of an oval."""
        half, code = self.size / 2, CODES[self.name]
        bottom, low, side, u, v, crown, high = (half * number for number in arcs(code))
        au, av, bu, bv = _sectors(code)
        one, other = math.atan2(av, au), math.atan2(bv, bu)
        whole = 2 * math.pi
        return (
            _Arc(0.0, one, np.array([low, 0.0]), bottom),
            _Arc(one, other, np.array([u, v]), side),
            _Arc(other, whole - other, np.array([high, 0.0]), crown),
            _Arc(whole - other, whole - one, np.array([u, -v]), side),
            _Arc(whole - one, whole, np.array([low, 0.0]), bottom),
        )

    def points(self, normals: Array) -> Array:
        """Return the places (k, 2) m in the pipe's frame at which the edge has these normals.

        ``normals``: (k,) rad, from u.
        """
        direction = np.stack([np.cos(normals), np.sin(normals)], axis=-1)
        if self.name == "oval":
            square = np.square(self._halves)
            place = square * direction
            place /= np.sqrt(square @ np.square(direction).T)[:, None]
        else:
            ends = np.array([arc.end for arc in self._arcs[:-1]])
            which = ends.searchsorted(normals % (2 * math.pi))
            centres = np.array([arc.centre for arc in self._arcs])[which]
            place = centres + np.array([arc.radius for arc in self._arcs])[which, None] * direction
        return self._in_pipe(place)

    def _in_pipe(self, places: Array) -> Array:
        """Turn places (k, 2) of the section's own axes into the pipe's."""
        cos, sin = math.cos(self.direction), math.sin(self.direction)
        return places @ np.array([[cos, sin], [-sin, cos]])

    def outward(self, normals: Array) -> Array:
        """Return unit vectors (k, 2) in the pipe's frame of normals (k,) rad from u."""
        angle = normals + self.direction
        return np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def normals(self, step: Callable[[float], float]) -> tuple[Array, Array]:
        """Cut the edge into pieces of even turn; return their middle normals and their turns.

        Args:
            step: largest turn, rad, of a piece by the radius of curvature, m.

        Returns:
            (k,) rad from u, and (k,) rad.
        """
        if self.name == "oval":
            a, b = self._halves
            # The widest radius of curvature asks for the finest turns.
            count = 4 * math.ceil(math.pi / 2 / step(a * a / b))
            return 2 * np.pi * np.arange(count) / count, np.full(count, 2 * math.pi / count)
        middles, turns = [], []
        for arc in self._arcs:
            count = math.ceil((arc.end - arc.start) / step(arc.radius) - 1e-9)
            turn = (arc.end - arc.start) / count
            middles.append(arc.start + turn * (np.arange(count) + 0.5))
            turns.append(np.full(count, turn))
        return np.concatenate(middles), np.concatenate(turns)

    def polygon(self, corners: int, more: float = 0.0) -> Array:
        """Return an inscribed polygon (k, 2) m, anticlockwise, ``more`` m outside of the edge.

        Its edges leave the section by no more than those of a polygon of so many corners leave a
        circle of half its size.
        """
        middles, turns = self.normals(lambda radius: _step(radius, self.size / 2, corners))
        ends = middles - turns / 2
        return self.points(ends) + more * self.outward(ends)

    def radii(self, angles: Array) -> Array:
        """Return the distances (...) m of the edge from the axis at angles (...) rad from x."""
        angle = np.asarray(angles, float) - self.direction
        u, v = np.cos(angle), np.abs(np.sin(angle))
        if self.name == "oval":
            a, b = self._halves
            return a * b / np.hypot(b * u, a * v)
        places = np.stack([u, v], axis=-1)
        found = np.full(np.shape(angle), np.nan)
        for arc in self._arcs[:3]:
            along = places @ arc.centre
            s = along + np.sqrt(np.maximum(arc.radius**2 - arc.centre @ arc.centre + along**2, 0.0))
            toward = s[..., None] * places - arc.centre
            normal = np.arctan2(toward[..., 1], toward[..., 0])
            within = (normal >= arc.start - ROUNDING) & (normal <= arc.end + ROUNDING)
            found = np.where(within, s, found)
        return found

    def rim_numbers(self) -> tuple[float, float]:
        """Return the largest way along the edge, m, and turn of it, rad, for a turn about the axis.

        Ratios to the turn's angle, rad.
        """
        angles = np.linspace(0.0, 2 * np.pi, 1441)
        place, normal = self.points(angles), self.outward(angles)
        square, height = (place * place).sum(axis=1), (place * normal).sum(axis=1)
        way = square / height
        return 1.01 * float(way.max()), 1.01 * float((way / self.curvature_radii(angles)).max())

    def curvature_radii(self, normals: Array) -> Array:
        """Return the radii of curvature (k,) m at normals (k,) rad."""
        if self.name == "oval":
            square = np.square(self._halves)
            direction = np.stack([np.cos(normals), np.sin(normals)], axis=-1)
            return square.prod() / np.sqrt(square @ np.square(direction).T) ** 3
        ends = np.array([arc.end for arc in self._arcs[:-1]])
        radii = np.array([arc.radius for arc in self._arcs])
        # Where two arcs join the smaller radius counts.
        return np.minimum(
            radii[ends.searchsorted(normals % (2 * math.pi), "left")],
            radii[ends.searchsorted(normals % (2 * math.pi), "right")],
        )


def _step(radius: float, size: float, corners: int) -> float:
    """Return the turn, rad, of a chord that leaves its arc of ``radius`` m as far as a polygon.

    The polygon has so many corners in a circle of radius ``size`` m.
    """
    sagitta = size * (1 - math.cos(math.pi / corners))
    return 2 * math.acos(max(1 - sagitta / radius, -1.0))
