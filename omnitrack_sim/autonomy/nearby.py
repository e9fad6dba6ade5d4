"""What cameras close to others see, without tracing their rays: the wall is flat about each hit."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.senses.optics import LIT, NORMAL, RANGE

STEEPEST = 0.03
"""Least sine of the angle between a ray and the wall that it meets."""


def nearby(
    hits: Array,
    rays: Array,
    place: Array,
    frame: Array,
    other: Array,
    turned: Array,
    lamp: Array | None,
) -> Array:
    """Hits (n, k, 8) of n cameras, from those (n, k, 8) of cameras close to them. Edges and shadows
    stay at their pixels.

    Args:
        hits: of rays (k, 3). place: (n, 3) m and frame: (n, 3, 3) of their cameras.
        other, turned: the same of the others. lamp: (3,) m, camera frame.
    """
    normal, reach = hits[..., NORMAL], hits[..., RANGE]
    met = np.isfinite(reach)
    reach = np.where(met, reach, 1.0)
    before = np.einsum("nij,kj->nki", frame, rays)
    after = np.einsum("nij,kj->nki", turned, rays)
    ahead = reach * _dot(normal, before) + _dot(normal, (place - other)[:, None])
    far = ahead / np.minimum(_dot(normal, after), -STEEPEST)
    found = hits.copy()
    found[..., RANGE] = np.where(met, np.clip(far, 0.7 * reach, 1.4 * reach), np.inf)
    if lamp is not None:
        reach = np.where(met, found[..., RANGE], 1.0)
        to_lamp = np.einsum("nij,j->ni", turned, lamp)[:, None] - reach[..., None] * after
        facing = _dot(to_lamp, normal) / np.sqrt(_dot(to_lamp, to_lamp))
        found[..., LIT] = np.where(hits[..., LIT] > 0, np.maximum(facing, 0.0), 0.0)
    return found


def _dot(a: Array, b: Array) -> Array:
    return (a * b).sum(axis=-1)
