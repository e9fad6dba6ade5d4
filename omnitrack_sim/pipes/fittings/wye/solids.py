"""A wye as a solid for pictures and export, with the rim rounded within and without, so that the
wall is as thick at the crotch as elsewhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, unit
from omnitrack_sim.pipes.fittings.base import Y
from omnitrack_sim.pipes.fittings.wye.exact import EQUAL, edge_curve
from omnitrack_sim.pipes.kit import Kit, Solid

if TYPE_CHECKING:
    from omnitrack_sim.pipes.fittings.wye.fitting import Wye

ARC_STEP = math.radians(15)
"""Largest angle between neighbouring points on the fillet's arc, rad."""


def fill(wye: Wye, kit: Kit, more: float, longer: float = 0.0) -> Solid:
    """Solid of the bores, their rim rounded, and ``more`` m around them, between the ports.

    The branch is ``longer`` m: the ends of turned solids differ by rounding, which may leave a film
    between them.
    """
    radius, branch_radius = wye.radius + more, wye.branch_radius + more
    solid = kit.cylinder(wye.run_length, radius, centred=True)
    along = wye.branch_axis
    turned = Pose(np.stack([np.cross(Y, along), Y, along], axis=-1))
    solid += kit.moved(kit.cylinder(wye.branch_length + longer, branch_radius), turned)
    fillet = wye.fillet_radius - more
    if fillet > 2 * kit.overcut:
        for q in _rim_angles(wye, kit.sections):
            solid += _fillet(wye, kit, q, radius, branch_radius, fillet)
    return solid


def _rim_angles(wye: Wye, sections: int) -> list[Array]:
    """Angles around the branch, rad, of the cross-sections: a closed line, or two that end short of
    where they meet."""
    step = 2 * np.pi / sections
    if wye.radius - wye.branch_radius < EQUAL:
        # Half way between the corners of the cylinders: threads may stay where corners coincide.
        around = (np.arange(sections // 2) + 0.5) * step
        return [np.asarray(around + turn, float) for turn in (-np.pi / 2, np.pi / 2)]
    # Where the edge bends sharply, even steps along the hyperbola as well (see ``exact``).
    big, small = wye.radius + wye.fillet_radius, wye.branch_radius + wye.fillet_radius
    gap = math.sqrt(big**2 - small**2)
    along = gap / small * np.sinh(np.linspace(-3, 3, 25))
    bend = np.arccos(along[np.abs(along) < 1])
    q = np.sort(np.concatenate([np.arange(sections) * step, bend, 2 * np.pi - bend]))
    return [np.asarray(q[np.diff(q, append=q[0] + 2 * np.pi) > 0.1 * step], float)]


def _fillet(
    wye: Wye, kit: Kit, q: Array, radius: float, branch_radius: float, fillet: float
) -> Solid:
    """What a ball of radius ``fillet`` m rounds off the rim of two bores, at the angles ``q``
    around the branch.

    The ball's centre runs on the edge where the cylinders, wider by the fillet, meet. Each
    cross-section is bounded by the ball's arc between its two points of tangency and closed within
    the bores.
    """
    centre = edge_curve(q, radius + fillet, branch_radius + fillet, wye.angle)
    corner = edge_curve(q, radius - kit.overcut, branch_radius - kit.overcut, wye.angle)
    axis = wye.branch_axis
    to_run = unit(centre * [1, 1, 0])
    to_branch = unit(centre - np.outer(centre @ axis, axis))
    between = np.arccos(np.clip((to_run * to_branch).sum(axis=1), -1.0, 1.0))
    count = max(6, math.ceil(between.max() / ARC_STEP))
    weight = np.linspace(0.0, 1.0, count + 1)[:, None, None]
    turn = np.maximum(between, 1e-9)[:, None]
    arc = (np.sin((1 - weight) * turn) * to_run + np.sin(weight * turn) * to_branch) / np.sin(turn)
    arc = centre - fillet * arc  # (count + 1, m, 3)
    rings = np.concatenate(
        [
            arc,
            (arc[-1] - kit.overcut * to_branch)[None],
            corner[None],
            (arc[0] - kit.overcut * to_run)[None],
        ]
    ).transpose(1, 0, 2)
    hub = None if wye.radius - wye.branch_radius >= EQUAL else rings.shape[1] - 2
    return kit.loft(rings, hub)
