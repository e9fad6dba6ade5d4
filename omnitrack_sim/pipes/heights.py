"""Walls that differ from a round bore by a smooth height over length and angle.

The axis is a line along z, or an arc from the origin along z that bends towards x.

The height, inward, is the sum of patches, each a cubic B-spline over a grid: twice differentiable,
nothing outside of the patch. The foot of a point on such a wall is found by Newton's method: from
the foot on the round bore, and from the nodes of those patches that may hold a nearer one. No place
of the wall nearer than what is known is farther along the pipe, or round it, than the sides of a
triangle with the gap between the point and the highest place of the patch; so few nodes are looked
at near the wall, and none is missed far from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes.compiled import FACE, compiled, put
from omnitrack_sim.pipes.native import (
    INTEGER,
    NUMBERS,
    WORD,
    at,
    c_function,
    pointers,
    scratch,
)

ROWS, COLUMNS, BEGIN, SPACING, FIRST, STEP, HIGHEST, BEND, LENGTH, LOWEST = range(10)
HEAD = 10
"""Indices in the numbers of a patch, and how many stand before its coefficients: nodes along and
round the pipe; of the first node the place, m, and spacing along, m; its angle, rad, and spacing;
largest inward height of the wall over the patch, m; largest curvature of its height, 1/m; count of
all its numbers; its least inward height, m. Coefficients are followed by the wall's radius, m, at
the nodes."""
STEPS, SETTLED, MAX_STEP = 20, 1e-6, 0.01
"""Of Newton's method: steps at most, the last step, m, and the longest one, m. What is left after
the last one is of the order of its square times the curvature: 1e-9 m where that is 1 / mm."""
NEAR = 0.5
"""Distance from the wall, in its least radius of curvature, up to which there is but one foot, to
which the one on the round bore leads: no node is looked at."""
CLOSE = 1e-4
"""Distance from the wall, m, up to which its gradient is the normal at the foot: that is as exact
as the foot, their difference as the foot over the distance."""
STARTS = 6
"""Nodes from which the foot is looked for, of each patch, at most."""


@compiled
def _add_patch(patch, s, angle, height):
    """Add height of a patch and its derivatives at a place to ``height``.

    These are by s, by angle, and the second ones: s s, s angle, angle angle.
    """
    rows, columns = int(patch[ROWS]), int(patch[COLUMNS])
    u, step = (s - patch[BEGIN]) / patch[SPACING], patch[STEP]
    i = math.floor(u)
    # A spline reaches two nodes far.
    if i < -2 or i > rows:
        return
    turn = angle - patch[FIRST]
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi))
    v = turn / step
    is_ring = columns * step > 2.0 * math.pi - 0.5 * step
    j = math.floor(v)
    if not is_ring and j > columns:
        # Just before the first column.
        v -= 2.0 * math.pi / step
        j = math.floor(v)
        if j < -2:
            return
    u, v = u - i, v - j
    # Values, first and second derivatives of the four splines that reach there.
    a, b = 1.0 - u, 1.0 - v
    u0, u1, u2, u3 = a * a * a / 6.0, 2.0 / 3.0 - u * u * (1.0 - 0.5 * u), 0.0, u * u * u / 6.0
    u2 = 1.0 - u0 - u1 - u3
    p0, p1, p3 = -0.5 * a * a, u * (1.5 * u - 2.0), 0.5 * u * u
    p2 = -p0 - p1 - p3
    q0, q1, q3 = a, 3.0 * u - 2.0, u
    q2 = -q0 - q1 - q3
    v0, v1, v3 = b * b * b / 6.0, 2.0 / 3.0 - v * v * (1.0 - 0.5 * v), v * v * v / 6.0
    v2 = 1.0 - v0 - v1 - v3
    w0, w1, w3 = -0.5 * b * b, v * (1.5 * v - 2.0), 0.5 * v * v
    w2 = -w0 - w1 - w3
    x0, x1, x3 = b, 3.0 * v - 2.0, v
    x2 = -x0 - x1 - x3
    for k in range(4):
        row = i - 1 + k
        if row < 0 or row >= rows:
            continue
        c0 = c1 = c2 = c3 = 0.0
        base = HEAD + row * columns
        j0, j1, j2, j3 = j - 1, j, j + 1, j + 2
        if is_ring:
            if j0 < 0:
                j0 += columns
            if j1 >= columns:
                j1 -= columns
            if j2 >= columns:
                j2 -= columns
            if j3 >= columns:
                j3 -= columns
        if 0 <= j0 < columns:
            c0 = patch[base + j0]
        if 0 <= j1 < columns:
            c1 = patch[base + j1]
        if 0 <= j2 < columns:
            c2 = patch[base + j2]
        if 0 <= j3 < columns:
            c3 = patch[base + j3]
        value = v0 * c0 + v1 * c1 + v2 * c2 + v3 * c3
        first = (w0 * c0 + w1 * c1 + w2 * c2 + w3 * c3) / step
        second = (x0 * c0 + x1 * c1 + x2 * c2 + x3 * c3) / (step * step)
        f = u0 if k == 0 else (u1 if k == 1 else (u2 if k == 2 else u3))
        g = p0 if k == 0 else (p1 if k == 1 else (p2 if k == 2 else p3))
        h = q0 if k == 0 else (q1 if k == 1 else (q2 if k == 2 else q3))
        g, h = g / patch[SPACING], h / (patch[SPACING] * patch[SPACING])
        height[0] += f * value
        height[1] += g * value
        height[2] += f * first
        height[3] += h * value
        height[4] += g * first
        height[5] += f * second


@compiled
def height_at(patches, count, s, angle, height):
    """Write the height and its derivatives at a place, see ``_add_patch``, to ``height`` (6,)."""
    for i in range(6):
        height[i] = 0.0
    p = 0
    for _ in range(count):
        _add_patch(at(patches, p), s, angle, height)
        p += int(patches[p + LENGTH])


@compiled
def point_of(curvature, x, y, z):
    """Return a point as the searches take it, and its distance and angle in the cross-section.

    That is the curvature of the pipe's axis, 1/m, towards x; of a straight the distance from the
    axis and the angle about it, of a bend the distance from the bend's axis and the height along
    that; and the place along the pipe, m.
    """
    if curvature == 0.0:
        rho, theta = math.sqrt(x * x + y * y), math.atan2(y, x)
        return (curvature, rho, theta, z), rho, theta
    mean = 1.0 / curvature
    away, place = math.sqrt((mean - x) * (mean - x) + z * z), math.atan2(z, mean - x) * mean
    toward = mean - away
    rho, theta = math.sqrt(toward * toward + y * y), math.atan2(y, toward)
    return (curvature, away, y, place), rho, theta


@compiled
def _squared(point, radius, s, angle, height):
    """Half of the squared distance of a point from the place of the wall in ``height``."""
    curvature, p, q, along = point
    r = radius - height[0]
    if curvature == 0.0:
        half = math.sin(0.5 * (angle - q))
        return 0.5 * ((r - p) * (r - p) + (s - along) * (s - along)) + 2.0 * p * r * half * half
    far, up = 1.0 / curvature - r * math.cos(angle), r * math.sin(angle) - q
    half = math.sin(0.5 * (s - along) * curvature)
    return 0.5 * ((p - far) * (p - far) + up * up) + 2.0 * p * far * half * half


@compiled
def _slopes(point, radius, s, angle, height):
    """Return derivatives of ``_squared``: by s, by angle, s s, s angle, angle angle.

    The sixth number is the squared length of the wall's tangent along the pipe, m for a m of s.
    """
    curvature, p, q, along = point
    r, rs, ra = radius - height[0], -height[1], -height[2]
    rss, rsa, raa = -height[3], -height[4], -height[5]
    if curvature == 0.0:
        delta = angle - q
        cos, sin = math.cos(delta), math.sin(delta)
        away = r - p * cos
        return (
            rs * away + s - along,
            ra * away + p * r * sin,
            1.0 + rs * rs + rss * away,
            rsa * away + rs * (ra + p * sin),
            raa * away + ra * ra + 2.0 * ra * p * sin + p * r * cos,
            1.0 + rs * rs,
        )
    cos, sin = math.cos(angle), math.sin(angle)
    turn = (s - along) * curvature
    c, b = p * math.cos(turn), p * math.sin(turn) * curvature
    # Distance from the bend's axis, and height along it, of the place, and their derivatives.
    far, up = 1.0 / curvature - r * cos, r * sin - q
    far_s, far_a, up_s, up_a = -rs * cos, r * sin - ra * cos, rs * sin, ra * sin + r * cos
    far_aa, up_aa = r * cos + 2.0 * ra * sin - raa * cos, raa * sin + 2.0 * ra * cos - r * sin
    far_sa, up_sa = rs * sin - rsa * cos, rsa * sin + rs * cos
    out = far - c
    wide = far * curvature
    return (
        out * far_s + far * b + up * up_s,
        out * far_a + up * up_a,
        far_s * far_s
        - out * rss * cos
        + 2.0 * b * far_s
        + wide * c * curvature
        + up_s * up_s
        + up * rss * sin,
        far_s * far_a + out * far_sa + b * far_a + up_s * up_a + up * up_sa,
        far_a * far_a + out * far_aa + up_a * up_a + up * up_aa,
        wide * wide + rs * rs,
    )


@compiled
def _foot(patches, count, radius, point, s, angle, height):
    """Return place and squared distance of the foot that Newton's method reaches from a place.

    Place along the pipe, m, and angle, rad; ``height`` is that there, and then that at the foot.
    """
    f = _squared(point, radius, s, angle, height)
    for _ in range(STEPS):
        r, ra = radius - height[0], height[2]
        fs, fa, fss, fsa, faa, along = _slopes(point, radius, s, angle, height)
        under = fss * faa - fsa * fsa
        if fss > 0.0 and under > 1e-6 * fss * r * r:
            ds, da = (fsa * fa - faa * fs) / under, (fsa * fs - fss * fa) / under
        else:
            # Not near a minimum: downhill, as far as on a wall that is even.
            ds, da = -fs / max(along, 1e-3), -fa / (r * r + ra * ra)
        size = math.sqrt(ds * ds + r * r * da * da)
        if size > MAX_STEP:
            ds, da = ds * MAX_STEP / size, da * MAX_STEP / size
        is_lower, there = False, f
        for _ in range(8):
            height_at(patches, count, s + ds, angle + da, height)
            there = _squared(point, radius, s + ds, angle + da, height)
            if there <= f + 1e-18:
                is_lower = True
                break
            ds, da = 0.25 * ds, 0.25 * da
        if not is_lower:
            height_at(patches, count, s, angle, height)
            break
        s, angle, f = s + ds, angle + da, there
        if size < SETTLED:
            break
    return s, angle, f


@compiled
def _rows_near(patch, radius, point, aside):
    """Return the first and the last row of a patch up to ``aside`` m from a point along the pipe.

    The first is the higher one where there are none.
    """
    curvature, p, _, along = point
    if curvature != 0.0:
        # The chord between two places so far apart, at the inner side of the bend.
        near = 2.0 * math.sqrt(max(p * (1.0 / curvature - radius + patch[LOWEST]), 0.0))
        aside = 2.0 * math.asin(aside / near) / curvature if near > aside else math.inf
    rows = patch[ROWS] - 1.0
    low = (along - aside - patch[BEGIN]) / patch[SPACING]
    high = (along + aside - patch[BEGIN]) / patch[SPACING]
    return math.floor(min(max(low, 0.0), rows + 1.0)), math.ceil(max(min(high, rows), -1.0))


@compiled
def _slack(patch, radius, curvature, best):
    """Return by how much, m, a node beside a foot is farther than the foot, at most.

    Within half of the diagonal of a cell from a foot there is a node; the height bends between.
    """
    longest = patch[SPACING] * (1.0 + radius * curvature)
    return 0.5 * longest * longest * (patch[BEND] + 1.0 / max(best, longest))


@compiled
def _nodes(patch, radius, point, rho, theta, s, turned, best, starts):
    """Write the nearest nodes of a patch that may lead to a nearer foot to ``starts``.

    Args:
        patch: its numbers.
        radius: m, of the round bore.
        point: see ``point_of``.
        rho: m, distance of the point from the pipe's axis.
        theta: rad, its angle about that.
        s: m along the pipe, of the nearest place that is known, to which its neighbours lead.
        turned: rad, its angle.
        best: m, its distance.
        starts: room for three numbers of each start: squared distance, m², row and column.

    Returns:
        How many there are.
    """
    rows, columns, step, spacing = (
        int(patch[ROWS]),
        int(patch[COLUMNS]),
        patch[STEP],
        patch[SPACING],
    )
    gap = max(radius - patch[HIGHEST] - rho, 0.0)
    square = best * best - gap * gap
    if square <= 0.0:
        return 0
    aside = math.sqrt(square)
    low, high = _rows_near(patch, radius, point, aside)
    if low > high:
        return 0
    # The chord between the point's angle and a place's, at the lesser of both distances.
    near = 2.0 * math.sqrt(max(rho * (radius - patch[HIGHEST]), 0.0))
    first, last = 0, columns - 1
    is_ring = columns * step > 2.0 * math.pi - 0.5 * step
    turn = (theta - patch[FIRST]) / step
    if near > aside:
        room = 2.0 * math.asin(aside / near) / step
        whole = 2.0 * math.pi / step
        if is_ring:
            if 2.0 * room + 2.0 < columns:
                first, last = math.floor(turn - room), math.ceil(turn + room)
        else:
            turn -= whole * math.floor((turn + 0.5 * (whole - columns)) / whole)
            first = max(first, math.floor(turn - room))
            last = min(last, math.ceil(turn + room))
    curvature, p, _, place_along = point
    slack = _slack(patch, radius, curvature, best)
    n, limit = 0, (best + slack) * (best + slack)
    cosine, sine = math.cos(step), math.sin(step)
    angle = patch[FIRST] + first * step
    c, d = math.cos(angle - theta), math.sin(angle - theta)
    u, v = math.cos(angle), math.sin(angle)
    radii = HEAD + rows * columns
    s_row = (s - patch[BEGIN]) / spacing
    turned -= patch[FIRST]
    own = (turned - 2.0 * math.pi * math.floor(turned / (2.0 * math.pi))) / step
    around = 2.0 * math.pi / step
    for column in range(first, last + 1):
        j = column % columns
        flat = 2.0 * rho * c
        beside = abs(j - own)
        is_beside = min(beside, around - beside) <= 1.0
        for row in range(low, high + 1):
            if is_beside and abs(row - s_row) <= 1.0:
                continue
            r, along = patch[radii + row * columns + j], patch[BEGIN] + row * spacing - place_along
            square = rho * rho + r * (r - flat)
            if curvature == 0.0:
                square += along * along
            else:
                half = math.sin(0.5 * along * curvature)
                square += 4.0 * p * (1.0 / curvature - r * u) * half * half
            if square >= limit:
                continue
            # One start a neighbourhood: the nearest node of it.
            place, is_new = n, True
            for k in range(n):
                apart = abs(starts[3 * k + 2] - column)
                if abs(starts[3 * k + 1] - row) <= 1.0 and min(apart, abs(columns - apart)) <= 1.0:
                    is_new = False
                    place = k if square < starts[3 * k] else -1
                    break
            if is_new and n == STARTS:
                place = -1
                farthest = square
                for k in range(n):
                    if starts[3 * k] > farthest:
                        place, farthest = k, starts[3 * k]
            if place >= 0:
                starts[3 * place], starts[3 * place + 1] = square, float(row)
                starts[3 * place + 2] = float(column)
                n += 1 * (is_new and n < STARTS)
                # What is nearer lowers what may still lead to a nearer foot.
                there = math.sqrt(square) + slack
                limit = min(limit, there * there)
        c, d = c * cosine - d * sine, d * cosine + c * sine
        u, v = u * cosine - v * sine, v * cosine + u * sine
    return n


@compiled
def _foot_from_nodes(patches, count, radius, point, rho, theta, s, angle, f, starts, height):
    """Return place and squared distance of the nearest foot: a known one, or reached from nodes.

    ``f``: half of the known one's squared distance.
    """
    p = 0
    for _ in range(count):
        patch = at(patches, p)
        p += int(patch[LENGTH])
        n = _nodes(patch, radius, point, rho, theta, s, angle, math.sqrt(2.0 * f), starts)
        nearest = math.inf
        for k in range(n):
            nearest = min(nearest, starts[3 * k])
        slack = _slack(patch, radius, point[0], math.sqrt(2.0 * f))
        for k in range(n):
            if math.sqrt(starts[3 * k]) > math.sqrt(nearest) + slack:
                continue
            place = patch[BEGIN] + starts[3 * k + 1] * patch[SPACING]
            turn = patch[FIRST] + starts[3 * k + 2] * patch[STEP]
            height_at(patches, count, place, turn, height)
            u, v, g = _foot(patches, count, radius, point, place, turn, height)
            if g < f:
                s, angle, f = u, v, g
    return s, angle, f


@compiled
def distance(patches, count, radius, curvature, x, y, z, room, out):
    """Return the distance, m, of a point from a wall of patches; the gradient goes to ``out``.

    Args:
        patches: numbers of the patches, one after the other.
        count: of them.
        radius: m, of the round bore.
        curvature: 1/m, of its axis, towards x.
        x: m, across the pipe.
        y: likewise.
        z: m, along the pipe at its begin.
        room: for 6 + 3 ``STARTS`` numbers.
        out: see ``compiled.Wall``.
    """
    point, rho, theta = point_of(curvature, x, y, z)
    height, starts = room, at(room, 6)
    height_at(patches, count, point[3], theta, height)
    side = 1.0 if rho <= radius - height[0] else -1.0
    s, angle, f = _foot(patches, count, radius, point, point[3], theta, height)
    bend, p = 1.0 / radius, 0
    for _ in range(count):
        bend += patches[p + BEND]
        p += int(patches[p + LENGTH])
    if math.sqrt(2.0 * f) * bend > NEAR:
        s, angle, f = _foot_from_nodes(
            patches, count, radius, point, rho, theta, s, angle, f, starts, height
        )
        height_at(patches, count, s, angle, height)
    r, d = radius - height[0], math.sqrt(2.0 * f)
    cos, sin, c, b, wide = math.cos(angle), math.sin(angle), 1.0, 0.0, 1.0
    px, pz = r * cos, s
    if curvature != 0.0:
        c, b, far = math.cos(s * curvature), math.sin(s * curvature), 1.0 / curvature - r * cos
        px, pz, wide = 1.0 / curvature - far * c, far * b, far * curvature
    if d > CLOSE:
        scale = side / d
        put(out, scale * (x - px), scale * (y - r * sin), scale * (z - pz), FACE)
    else:
        # The normal of its two tangents, into the bore.
        nx, ny = wide * (height[2] * sin - r * cos), -wide * (r * sin + height[2] * cos)
        nz = -r * height[1]
        size = math.sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / size, ny / size, nz / size
        put(out, c * nx + b * nz, ny, c * nz - b * nx, FACE)
    return side * d


def _at_places(patches, count, places, number, heights):
    """Write the heights at places (number, 2) along, m, and round, rad, to ``heights``."""
    height = scratch()
    for i in range(number):
        height_at(patches, count, places[2 * i], places[2 * i + 1], height)
        heights[i] = height[0]
    return 0


_AT_PLACES = CFUNCTYPE(INTEGER, NUMBERS, WORD, NUMBERS, WORD, NUMBERS)
PAD = 4
"""Nodes beyond a height that ends, in which its spline dies out."""


@dataclass(frozen=True, eq=False)
class Patch:
    """A height over a grid along and round a pipe, as a cubic B-spline.

    Attributes:
        begin: m along the pipe, of the first row of nodes. spacing: m, of rows.
        first: rad about the axis, of the first column. step: rad, of columns.
        coefficients: (rows, columns) m, inward.
        width: m, of its narrowest waves.
        bulges: whether its waves stand in the bore, so that a flat face may touch them.
    """

    begin: float
    spacing: float
    first: float
    step: float
    coefficients: Array
    width: float
    bulges: bool = True

    @classmethod
    def through(
        cls,
        begin: float,
        spacing: float,
        first: float,
        step: float,
        samples: Array,
        width: float,
    ) -> Patch:
        """Return the patch with heights ``samples`` (rows, columns) m at the nodes.

        They die out towards its ends; round the pipe they do so, or the columns go all round.
        """
        rows, columns = (2 + np.cos(2 * np.pi * np.fft.fftfreq(n)) for n in samples.shape)
        gain = np.outer(rows, columns) / 9
        coefficients = np.fft.ifft2(np.fft.fft2(samples) / gain).real
        return cls(begin, spacing, first, step, coefficients, width)

    @classmethod
    def over(
        cls,
        height: Callable[[Array, Array], Array],
        ends: tuple[float, float],
        spacing: float,
        arc: tuple[float, float] | None,
        step: float,
        width: float,
    ) -> Patch:
        """Return the patch of a function of place, m, and angle, rad, that is 0 beyond its ends.

        Args:
            height: of arrays of both, m.
            ends: m, along the pipe.
            spacing: m, of rows, at most.
            arc: middle and half width, rad, beyond which it is 0; None: all round.
            step: rad, of columns, at most.
            width: m, of its narrowest waves.
        """
        rows = math.ceil((ends[1] - ends[0]) / spacing - 1e-9)
        spacing = (ends[1] - ends[0]) / rows
        begin, count = ends[0] - PAD * spacing, rows + 1 + 2 * PAD
        if arc is None:
            columns, first = 4 * math.ceil(math.pi / 2 / step - 1e-9), 0.0
            step = 2 * math.pi / columns
        else:
            cells = math.ceil(2 * arc[1] / step - 1e-9)
            step, columns = 2 * arc[1] / cells, cells + 1 + 2 * PAD
            first = arc[0] - arc[1] - PAD * step
        s: Array = begin + spacing * np.arange(count, dtype=float)
        angle: Array = first + step * np.arange(columns, dtype=float)
        return cls.through(begin, spacing, first, step, height(s[:, None], angle[None, :]), width)

    def numbers(self, radius: float = 0.0, total: Array | None = None) -> Array:
        """Return its numbers, see ``ROWS``.

        Args:
            radius: m, of the round bore.
            total: (rows, columns) m, height of all patches at its nodes; None: not asked for.
        """
        rows, columns = self.coefficients.shape
        bend = self.bend(max(radius, 1e-9))
        more = bend * self.spacing**2 / 4
        highest = 0.0 if total is None else float(total.max()) + more
        lowest = 0.0 if total is None else min(float(total.min()) - more, 0.0)
        nodes = np.zeros(0) if total is None else radius - total.ravel()
        head = [rows, columns, self.begin, self.spacing, self.first, self.step, highest, bend]
        length = HEAD + self.coefficients.size + len(nodes)
        return np.concatenate([head, [length, lowest], self.coefficients.ravel(), nodes])

    def bend(self, radius: float) -> float:
        """Return the largest curvature of its height, 1/m, about; for searches."""
        padded = np.pad(self.coefficients, 1)
        along = np.abs(np.diff(padded, 2, axis=0)).max() / self.spacing**2
        around = np.abs(np.diff(padded, 2, axis=1)).max() / (radius * self.step) ** 2
        return float(max(along, around))

    @property
    def nodes(self) -> Array:
        """Places (rows, columns, 2) of its nodes: m along the pipe, rad round it."""
        rows, columns = self.coefficients.shape
        s = self.begin + self.spacing * np.arange(rows)
        angle = self.first + self.step * np.arange(columns)
        return np.stack(np.meshgrid(s, angle, indexing="ij"), axis=-1)


def total_height(patches: Sequence[Patch], places: Array) -> Array:
    """Return the height (...,) m of all patches at places (..., 2): m along the pipe, rad."""
    places = np.ascontiguousarray(places, float)
    numbers = np.concatenate([[], *(patch.numbers() for patch in patches)])
    heights = np.zeros(places.shape[:-1])
    evaluate = c_function(_at_places, _AT_PLACES).ctypes
    evaluate(*pointers(numbers), len(patches), *pointers(places), heights.size, *pointers(heights))
    return heights


def numbers_of(patches: Sequence[Patch], radius: float) -> Array:
    """Return the numbers of patches on a round bore, see ``distance``."""
    each = [patch.numbers(radius, total_height(patches, patch.nodes)) for patch in patches]
    return np.concatenate([[], *each])
