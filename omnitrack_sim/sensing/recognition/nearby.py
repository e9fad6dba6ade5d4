"""What cameras close to one see, without tracing their rays: the wall is flat about each hit."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.rotations import Array
from omnitrack_sim.sensing.optics import JOINT, LIT, NORMAL, RANGE

STEEPEST = 0.03
"""Least sine of the angle between a ray and the wall that it meets."""


def nearby(hits: Array, rays: Array, place: Array, rotation: Array, lamp: Array | None) -> Array:
    """Hits (m, k, 8) of m cameras, of which the first one's (k, 8) are known.

    Edges stay where they are, and so do shadows. The port plane that is approached is z = 0.

    Args:
        hits: (k, 8), of rays (k, 3), camera frame.
        place, rotation: (m, 3) m and (m, 3, 3) of the cameras. lamp: (3,) m, camera frame.
    """
    normal, reach = hits[:, NORMAL], hits[:, RANGE]
    met = np.isfinite(reach)
    reach = np.where(met, reach, 1.0)
    point = place[0] + reach[:, None] * (rays @ rotation[0].T)
    ahead = (normal * point).sum(axis=1) - place @ normal.T  # (m, k)
    directions = rays @ rotation.swapaxes(1, 2)  # (m, k, 3)
    steep = np.minimum((directions * normal).sum(axis=-1), -STEEPEST)
    found = np.repeat(hits[None], len(place), axis=0)
    far = np.clip(ahead / steep, 0.7 * reach, 1.4 * reach)
    found[..., RANGE] = np.where(met, far, np.inf)
    points = place[:, None] + far[..., None] * directions
    at_plane = np.abs(np.abs(point[:, 2]) - hits[:, JOINT]) < 1e-6
    found[..., JOINT] = np.where(at_plane, np.abs(points[..., 2]), hits[:, JOINT])
    if lamp is not None:
        to_lamp = (place + rotation @ lamp)[:, None] - points
        facing = (to_lamp * normal).sum(axis=-1) / np.sqrt((to_lamp**2).sum(axis=-1))
        found[..., LIT] = np.where(hits[:, LIT] > 0, np.maximum(facing, 0.0), 0.0)
    return found
