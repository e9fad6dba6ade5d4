"""Rotations and poses on plain arrays. Quaternions are (w, x, y, z), as in MuJoCo."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def unit(vector: ArrayLike) -> Array:
    """Vectors (..., 3) scaled to length 1; a zero vector stays zero."""
    vector = np.asarray(vector, float)
    norm = np.linalg.norm(vector, axis=-1, keepdims=True)
    return vector / np.where(norm > 0, norm, 1.0)


def dot(a: Array, b: Array) -> Array:
    """Dot products (...,) of vectors (..., 3), summed in one order at any batch size: runs repeat
    bit for bit."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def length(vector: Array) -> Array:
    """Lengths (...,) of vectors (..., 3)."""
    return np.sqrt(dot(vector, vector))


def cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3) of vectors (..., 3), a few times faster than NumPy's for small
    arrays."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) by ``angle`` (...,) rad about ``axis`` (..., 3),
    right-handed."""
    axis, angle = unit(axis), np.asarray(angle, float)
    axis = np.broadcast_to(axis, (*np.broadcast_shapes(axis.shape[:-1], angle.shape), 3))
    half = np.broadcast_to(angle, axis.shape[:-1])[..., None] / 2
    return matrix_from_quaternion(np.concatenate([np.cos(half), axis * np.sin(half)], axis=-1))


def frame_along(axis: ArrayLike, turn: float) -> Array:
    """Rotation (3, 3) with z along ``axis`` (3,) and x near the reference's, turned by ``turn`` rad
    about the axis.

    Without a turn x is the reference's x made square to the axis; for an axis close to it, -z or z
    instead.
    """
    z = unit(axis)
    helper = (
        np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 0, -1.0 if z[0] > 0 else 1.0])
    )
    x = unit(helper - z * (helper @ z))
    x = x * math.cos(turn) + np.cross(z, x) * math.sin(turn)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def matrix_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    quaternion = np.asarray(quaternion, float)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    matrix = np.empty((*quaternion.shape[:-1], 3, 3))
    matrix[..., 0, 0], matrix[..., 0, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z)
    matrix[..., 0, 2], matrix[..., 1, 0] = 2 * (x * z + w * y), 2 * (x * y + w * z)
    matrix[..., 1, 1], matrix[..., 1, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    matrix[..., 2, 0], matrix[..., 2, 1] = 2 * (x * z - w * y), 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def quaternion_from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternions (..., 4) with w >= 0 of rotation matrices (..., 3, 3).

    The largest of the four components is found first, so no division is by a small number.
    """
    m = np.asarray(matrix, float)
    d = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = d.sum(-1)
    w = 1 + trace
    xyz = 1 + 2 * d - trace[..., None]
    candidates = np.stack(
        [
            np.stack(
                [
                    w,
                    m[..., 2, 1] - m[..., 1, 2],
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 1, 0] - m[..., 0, 1],
                ],
                -1,
            ),
            np.stack(
                [
                    m[..., 2, 1] - m[..., 1, 2],
                    xyz[..., 0],
                    m[..., 1, 0] + m[..., 0, 1],
                    m[..., 0, 2] + m[..., 2, 0],
                ],
                -1,
            ),
            np.stack(
                [
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 1, 0] + m[..., 0, 1],
                    xyz[..., 1],
                    m[..., 2, 1] + m[..., 1, 2],
                ],
                -1,
            ),
            np.stack(
                [
                    m[..., 1, 0] - m[..., 0, 1],
                    m[..., 0, 2] + m[..., 2, 0],
                    m[..., 2, 1] + m[..., 1, 2],
                    xyz[..., 2],
                ],
                -1,
            ),
        ],
        axis=-2,
    )  # (..., 4, 4): row k is exact where component k is large
    best = np.argmax(np.concatenate([w[..., None], xyz], axis=-1), axis=-1)
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def wrap_angle(angle: ArrayLike, period: float = 2 * np.pi) -> Array:
    """Angles (...,) rad wrapped into [-period/2, period/2)."""
    return (np.asarray(angle, float) + period / 2) % period - period / 2


@dataclass(frozen=True)
class Pose:
    """A frame B in a frame A: ``rotation`` (3, 3) has B's axes in A as columns, ``position`` (3,)
    m."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    position: Array = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: Pose) -> Pose:
        """A from C, given self = A from B and other = B from C."""
        return Pose(self.rotation @ other.rotation, self.apply(other.position))

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of frame B, in frame A."""
        return np.asarray(points, float) @ self.rotation.T + self.position

    def inverse(self) -> Pose:
        """B from A."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (4,), w >= 0."""
        return quaternion_from_matrix(self.rotation)
