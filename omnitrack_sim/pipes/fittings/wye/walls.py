"""Collision walls of a wye from primitives: staves cut back along the rim, strips along it,
capsules as the rim."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.rotations import Array, unit
from omnitrack_sim.pipes.fittings.wye.exact import EQUAL, edge_curve
from omnitrack_sim.pipes.pieces import THICKNESS, Pieces, Ring, sagitta, stave_count

if TYPE_CHECKING:
    from omnitrack_sim.pipes.fittings.wye.fitting import Wye

CROTCH_PATCH = 0.007
"""Half width of the flat pieces where the two halves of the rim meet, m."""

RIM_STEP = 0.008
"""Longest capsule along the rim, m."""
RIM_SAGITTA = 1.5e-4
"""By how much a capsule's chord may leave the rim, m."""
STRIP_ROWS = 2
"""Rows of boxes along the rim, which fill what the square-ended staves leave open: a stave's
width."""
_DENSE = 4001
_CUT_SAMPLES = 17


def add_walls(wye: Wye, pieces: Pieces, tolerance: float, staves: int | None) -> None:
    """Add boxes and capsules of a wye in its frame; see ``Fitting.add_walls``."""
    run_ring = Ring.of(wye.radius, staves or stave_count(wye.radius, tolerance))
    branch_ring = Ring.of(wye.branch_radius, staves or stave_count(wye.branch_radius, tolerance))
    # A piece by the rim is no thicker than the wall is there: a ball of the fillet's radius fits.
    depth = min(THICKNESS, 2 * wye.fillet_radius)
    _add_run(pieces, wye, run_ring, depth)
    _add_branch(pieces, wye, branch_ring, depth)
    equal = wye.radius - wye.branch_radius < EQUAL
    if equal:
        # Where the halves of the rim meet the wall is flat: run and branch share their tangent
        # plane.
        for side in (1.0, -1.0):
            y = np.array([0, side, 0])
            point, z = (wye.radius + 5e-5) * y, np.array([0, 0, 1.0])
            pieces.facet(point, y, z, CROTCH_PATCH, CROTCH_PATCH, THICKNESS)
    for q in rim_angles(wye):
        _add_rim(pieces, wye, q, run_ring, branch_ring, depth)


def piece_count(wye: Wye, tolerance: float, staves: int | None) -> int:
    """About how many pieces ``add_walls`` adds; see ``Fitting.piece_count``."""
    around = staves or stave_count(wye.radius, tolerance)
    _, small = _edge_radii(wye)
    # The rim is about the ellipse in which a plane cuts the branch, bent round the run.
    rim = 2 * math.pi * small * 1.3 / math.sin(wye.angle)
    capsules = math.ceil(rim / min(RIM_STEP, math.sqrt(8 * RIM_SAGITTA * small)))
    return 3 * around + (1 + 2 * STRIP_ROWS) * capsules + 2


def rim_angles(wye: Wye) -> list[Array]:
    """Angles around the branch, rad, of the ends of the capsules: one closed line, or two where the
    bores are equal."""
    big, small = _edge_radii(wye)
    equal = wye.radius - wye.branch_radius < EQUAL
    parts = [(-np.pi / 2, np.pi / 2), (np.pi / 2, 3 * np.pi / 2)] if equal else [(0.0, 2 * np.pi)]
    lines = []
    for first, last in parts:
        q = np.linspace(first, last, _DENSE)
        chords = np.diff(edge_curve(q, big, small, wye.angle), axis=0)
        lengths = np.linalg.norm(chords, axis=1)
        turns = np.linalg.norm(np.diff(unit(chords), axis=0), axis=1)
        curvature = np.pad(turns / lengths[1:], (0, 1), mode="edge")
        step = np.minimum(RIM_STEP, np.sqrt(8 * RIM_SAGITTA / np.maximum(curvature, 1e-9)))
        count = np.concatenate([[0.0], np.cumsum(lengths / step)])
        # An even number of steps puts corners at heel and crotch.
        lines.append(
            np.interp(np.linspace(0, count[-1], 2 * math.ceil(count[-1] / 2) + 1), count, q)
        )
    return lines


def _edge_radii(wye: Wye) -> tuple[float, float]:
    return wye.radius + wye.fillet_radius, wye.branch_radius + wye.fillet_radius


def _add_run(pieces: Pieces, wye: Wye, ring: Ring, depth: float) -> None:
    """Staves of the run; those that the mouth interrupts in two parts, square at their ends."""
    big, small = _edge_radii(wye)
    sin, cos, half = math.sin(wye.angle), math.cos(wye.angle), wye.run_length / 2
    half_angle, limit = np.pi / len(ring.azimuths), math.asin(min(1.0, small / big))
    z = np.array([0, 0, 1.0])
    for u in ring.azimuths:
        out = np.array([math.cos(u), math.sin(u), 0.0])
        middle = math.remainder(u, 2 * math.pi)
        first, last = max(middle - half_angle, -limit), min(middle + half_angle, limit)
        if last - first <= 1e-9:
            pieces.facet(ring.face * out, out, z, ring.half_width, half, THICKNESS)
            continue
        around = np.linspace(first, last, _CUT_SAMPLES)
        root = np.sqrt(np.maximum(small**2 - (big * np.sin(around)) ** 2, 0.0))
        low, high = ((big * np.cos(around) * cos + side * root) / sin for side in (-1.0, 1.0))
        for a, b in ((-half, low.min()), (high.max(), half)):
            if b - a > 1e-5:
                pieces.facet(
                    ring.face * out + z * (a + b) / 2,
                    out,
                    z,
                    ring.half_width,
                    (b - a) / 2,
                    depth,
                )


def _add_branch(pieces: Pieces, wye: Wye, ring: Ring, depth: float) -> None:
    """Staves of the branch, from the rim to the port."""
    big, small = _edge_radii(wye)
    sin, cos, along = math.sin(wye.angle), math.cos(wye.angle), wye.branch_axis
    across = np.array([cos, 0.0, -sin])
    half_angle = np.pi / len(ring.azimuths)
    for u in ring.azimuths:
        out = math.cos(u) * across + math.sin(u) * np.array([0, 1.0, 0])
        around = np.linspace(u - half_angle, u + half_angle, _CUT_SAMPLES)
        x = np.sqrt(np.maximum(big**2 - (small * np.sin(around)) ** 2, 0.0))
        a, b = ((x - small * np.cos(around) * cos) / sin).max(), wye.branch_length
        if b - a > 1e-5:
            pieces.facet(
                ring.face * out + along * (a + b) / 2,
                out,
                along,
                ring.half_width,
                (b - a) / 2,
                depth,
            )


def _add_rim(
    pieces: Pieces, wye: Wye, q: Array, run_ring: Ring, branch_ring: Ring, depth: float
) -> None:
    """Capsules along the angles ``q`` of the edge, and the strips on either side of them."""
    edge = edge_curve(q, *_edge_radii(wye), wye.angle)
    for a, b in itertools.pairwise(edge):
        pieces.capsule(a, b, wye.fillet_radius)
    axes = (
        (np.array([0, 0, 1.0]), wye.radius, run_ring),
        (wye.branch_axis, wye.branch_radius, branch_ring),
    )
    outward = [unit(edge - np.outer(edge @ axis, axis)) for axis, _, _ in axes]
    for (axis, radius, ring), mine, other in zip(axes, outward, reversed(outward), strict=True):
        strip = 1.1 * 2 * radius * math.tan(np.pi / len(ring.azimuths)) / STRIP_ROWS
        _add_strips(pieces, wye, edge - wye.fillet_radius * mine, axis, radius, other, strip, depth)


def _add_strips(
    pieces: Pieces,
    wye: Wye,
    line: Array,
    axis: Array,
    radius: float,
    away: Array,
    strip: float,
    depth: float,
) -> None:
    """Boxes tangent to the cylinder about ``axis``, along ``line`` (k, 3), where the fillet begins,
    on its wall side.

    ``away`` (k, 3) is roughly the direction to that side; ``strip`` m is the width of a row,
    ``depth`` m its thickness.
    """
    chords, middles = np.diff(line, axis=0), (line[:-1] + line[1:]) / 2
    out = unit(middles - np.outer(middles @ axis, axis))
    tangents = unit(chords - out * (chords * out).sum(axis=1)[:, None])
    beyond = np.cross(out, tangents)
    beyond *= np.sign((beyond * (away[:-1] + away[1:])).sum(axis=1))[:, None]
    # At the corners the rows are mitred: their directions, so long that neighbouring strips meet.
    closed = np.allclose(line[0], line[-1])
    before = np.vstack([beyond[-1:] if closed else beyond[:1], beyond])
    after = np.vstack([beyond, beyond[:1] if closed else beyond[-1:]])
    mitre = (before + after) / (1 + (before * after).sum(axis=1))[:, None]
    for i, (middle, tangent, side) in enumerate(zip(middles, tangents, beyond, strict=True)):
        for row in range(STRIP_ROWS):
            longest = max(
                abs((chords[i] + d * strip * (mitre[i + 1] - mitre[i])) @ tangent)
                for d in (row, row + 1)
            )
            half_length = 0.55 * longest
            point = middle + side * strip * (row + 0.5)
            normal = unit(point - axis * (point @ axis))
            around = np.cross(axis, normal)
            reach = strip / 2 * abs(side @ around) + half_length * abs(tangent @ around)
            face = axis * (point @ axis) + normal * (radius - sagitta(radius, reach / radius) / 2)
            if wye.extent(face) < 0:
                continue
            along = unit(tangent - normal * (tangent @ normal))
            pieces.facet(face, normal, along, strip / 2, half_length, depth)
