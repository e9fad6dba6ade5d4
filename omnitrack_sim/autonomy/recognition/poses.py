"""Where a camera stands before a fitting, as numbers that are sought."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.autonomy.recognition.sighting import Motion
from omnitrack_sim.base.rotations import Array, rotation_about

ASIDE, TILT, DISTANCE, TURN, PLACES = slice(0, 2), slice(2, 4), 4, 5, 6
"""Places in a row of numbers: m and rad, as of a ``Sighting``."""


def cameras(numbers: Array, motions: list[Motion]) -> tuple[Array, Array]:
    """Positions (n, v, 3) m and rotations (n, v, 3, 3) of v cameras, in the frame of the port plane
    (z on into the fitting, x as of the port), for rows of numbers (n, 6)."""
    turn, tilt = numbers[:, TURN], numbers[:, TILT]
    cos, sin = np.cos(turn), np.sin(turn)
    zero, one = np.zeros_like(cos), np.ones_like(cos)
    back = np.stack([cos, sin, zero, -sin, cos, zero, zero, zero, one], axis=-1).reshape(-1, 3, 3)
    lean = np.hypot(tilt[:, 0], tilt[:, 1])
    axis = np.stack([-tilt[:, 1], tilt[:, 0], zero], axis=-1)
    leaning = rotation_about(np.where(lean[:, None] > 0, axis, [0.0, 0.0, 1.0]), lean)
    rotation = back @ leaning.transpose(0, 2, 1)  # (n, 3, 3) camera to port
    lens = -np.concatenate([numbers[:, ASIDE], numbers[:, DISTANCE, None]], axis=1)
    position = np.einsum("nij,nj->ni", back, lens)
    turned = np.stack([motion.rotation for motion in motions])
    moved = np.stack([motion.position for motion in motions])
    places = position[:, None] + np.einsum("nij,vj->nvi", rotation, moved)
    return places, rotation[:, None] @ turned[None]


def straightened(numbers: Array, directions: Array, radius: float) -> Array:
    """Directions (k, 3), camera frame, in which a camera at ``numbers`` (6,) sees the points of a
    straight wall that one on the pipe's axis, which looks along it, sees in ``directions``."""
    across = np.hypot(directions[:, 0], directions[:, 1])
    points = directions * (radius / across)[:, None]
    points = points + np.array([*numbers[ASIDE], 0.0])
    row = np.concatenate([numbers[:TURN], [0.0]])[None]
    rotation = cameras(row, [STILL])[1][0, 0]
    seen = points @ rotation  # port to camera
    return seen / np.linalg.norm(seen, axis=-1, keepdims=True)


STILL = Motion(np.eye(3), np.zeros(3))
"""Of the last picture itself."""
