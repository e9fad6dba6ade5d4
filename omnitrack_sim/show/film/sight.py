"""Eyes and suns: from where pictures are seen and lit, and what of the world comes into them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omnitrack_sim.base.rotations import Array, cross, unit


@dataclass(frozen=True)
class Eye:
    """From where and how a picture is seen.

    Attributes:
        position: (3,) m.
        frame: (3, 3) directions right, up and back as columns.
        angle: vertical field of view, rad.
        near, far: what lies between these distances is seen, m.
    """

    position: Array
    frame: Array
    angle: float
    near: float
    far: float

    def matrix(self, aspect: float) -> Array:
        """World to clip coordinates (4, 4); y points down, so that rows come from the top."""
        scale, depth = 1 / np.tan(self.angle / 2), self.near - self.far
        view = np.zeros((4, 4))
        view[0, 0], view[1, 1] = scale / aspect, -scale
        view[2, 2:] = (self.far + self.near) / depth, 2 * self.far * self.near / depth
        view[3, 2] = -1.0
        return view @ _rigid(self.frame.T, -self.frame.T @ self.position)

    def box(self, centres: Array, radii: Array, aspect: float) -> Array | None:
        """Left, top, right and bottom (4,) of spheres in the picture, which goes from 0 to 1.

        Args:
            centres: (n, 3) m. radii: (n,) m. aspect: width over height.

        Returns:
            None where a sphere reaches behind the eye.
        """
        seen = (centres - self.position) @ self.frame
        depth = -seen[:, 2:] - radii[:, None]
        if (depth <= self.near).any():
            return None
        # The sphere lies within a square of its own size at the distance of its nearest point.
        scale = np.array([1 / aspect, 1.0]) / np.tan(self.angle / 2)
        across = seen[:, :2] * [1, -1]
        spans = [across + side * radii[:, None] for side in (-1, 1)]
        # Nearer things are farther from the middle, farther ones nearer to it: both are looked at.
        far = depth + 2 * radii[:, None]
        ends = np.concatenate([scale * span / d for span in spans for d in (depth, far)])
        return 0.5 + 0.5 * np.concatenate([ends.min(axis=0), ends.max(axis=0)])

    def sees(self, centre: Array, radius: float, aspect: float) -> bool:
        """Whether a sphere can come into the picture."""
        right, up, back = (centre - self.position) @ self.frame
        half = np.tan(self.angle / 2)
        inside = [-back * half * a - abs(v) for a, v in ((aspect, right), (1.0, up))]
        walls = [np.hypot(1.0, half * a) * radius for a in (aspect, 1.0)]
        near = -back + radius > self.near
        return near and all(i > -w for i, w in zip(inside, walls, strict=True))


@dataclass(frozen=True)
class Sun:
    """Parallel light on a part of the world.

    Attributes:
        towards: (3,) unit vector to the sun.
        middle: (3,) m, radius: m, of the sphere that is looked at.
        reach: how far behind the middle there may be shadows, m.
    """

    towards: Array
    middle: Array
    radius: float
    reach: float

    @cached_property
    def matrix(self) -> Array:
        """World to clip coordinates (4, 4) of the sun's view."""
        side = unit(cross(np.eye(3)[np.abs(self.towards).argmin()], self.towards))
        frame = np.stack([side, cross(self.towards, side), self.towards])
        place = self.middle + (self.radius - self.reach) / 2 * self.towards
        scale = 2 / np.array([2 * self.radius, 2 * self.radius, -(self.radius + self.reach)])
        return np.diag([*scale, 1.0]) @ _rigid(frame, -frame @ place)


def _rigid(rotation: Array, place: Array) -> Array:
    """Rotation (3, 3) and place (3,) as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, place
    return matrix
