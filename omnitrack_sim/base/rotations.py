"""Rotations and poses on plain arrays. Quaternions are (w, x, y, z), as in MuJoCo."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
TURNED = np.array([1.0, -1.0, -1.0])
"""Diagonal of the rotation by 180 degrees about x."""
_FIRST_OF_CROSS, _SECOND_OF_CROSS = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])


def unit(vector: ArrayLike) -> Array:
    """Scale vectors (..., 3) to length 1; a zero vector stays zero."""
    vector = np.asarray(vector, float)
    norm = length(vector)
    # Adding 1 to a zero norm avoids 0/0 without a branch or a masked copy.
    return vector / (norm + (norm == 0))[..., None]


def direction_of(vector: ArrayLike) -> Array:
    """Unit vectors (..., 3) along vectors of any size; a zero vector stays zero.

    Users may give a direction with components such as 1e300 or 1e-300, whose squares overflow or
    vanish. The vector is first divided by a power of two near its largest component, which is
    exact: for any other vector the result is that of ``unit``, bit for bit.
    """
    vector = np.asarray(vector, float)
    _, exponent = np.frexp(np.abs(vector).max(axis=-1, keepdims=True))
    return unit(np.ldexp(vector, -exponent))


def ordered_sum(values: Array) -> Array:
    """Sums (...,) over the last axis of values (..., k), in one order at any batch size.

    NumPy's own sums add in an order that depends on the shape; runs have to repeat bit for bit.
    """
    total = values[..., 0]
    for k in range(1, values.shape[-1]):
        total = total + values[..., k]
    return total


def dot(a: Array, b: Array) -> Array:
    """Dot products (...,) of vectors (..., 3).

    They are summed in one order at any batch size, so that runs repeat bit for bit.
    """
    product = a * b
    return product[..., 0] + product[..., 1] + product[..., 2]


def length(vector: Array) -> Array:
    """Lengths (...,) of vectors (..., 3)."""
    return np.sqrt(dot(vector, vector))


def angle_between(a: Array, b: Array) -> Array:
    """Angle (...,) rad between unit vectors (..., 3); exact near zero."""
    # arccos of the dot product loses half of the digits near 0 and pi; this form keeps them.
    return 2 * np.arctan2(length(a - b), length(a + b))


def cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3) of vectors (..., 3), faster than NumPy's for small arrays."""
    # Two gathers give all six products at once; NumPy's own cross moves axes and checks shapes.
    products = a.take(_FIRST_OF_CROSS, axis=-1) * b.take(_SECOND_OF_CROSS, axis=-1)
    return products[..., :3] - products[..., 3:]


def rotation_about(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) by ``angle`` (...,) rad about ``axis`` (..., 3)."""
    axis, angle = unit(axis), np.asarray(angle, float)
    if axis.shape[:-1] != angle.shape:
        axis = np.broadcast_to(axis, (*np.broadcast_shapes(axis.shape[:-1], angle.shape), 3))
        angle = np.broadcast_to(angle, axis.shape[:-1])
    half = angle[..., None] / 2
    return matrix_from_quaternion(np.concatenate([np.cos(half), axis * np.sin(half)], axis=-1))


def frame_of(x: Array, z: Array) -> Array:
    """Rotations (..., 3, 3) whose x and z are given, unit vectors (..., 3) square to each other."""
    frame = np.empty((*z.shape, 3))
    frame[..., 0], frame[..., 1], frame[..., 2] = x, cross(z, x), z
    return frame


def frame_along(axis: ArrayLike, turn: float) -> Array:
    """Rotation (3, 3) whose z lies along ``axis`` (3,).

    Its x is the reference's x made square to the axis; for an axis close to that, -z or z instead.
    Then it is turned by ``turn`` rad about the axis.
    """
    z = direction_of(axis)
    # An x axis that is nearly parallel to z would leave a projection made of rounding errors.
    helper = (
        np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 0, -1.0 if z[0] > 0 else 1.0])
    )
    x = unit(helper - z * (helper @ z))
    x = x * math.cos(turn) + np.cross(z, x) * math.sin(turn)
    return frame_of(x, z)


def matrix_from_quaternion(quaternion: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    q = np.asarray(quaternion, float)
    products = (q[..., :, None] * q[..., None, :]).reshape(*q.shape[:-1], 16)
    # Elements off the diagonal are 2 (x y - w z) and the like, those on it 1 - 2 (y² + z²).
    terms = products.take(_TERM_PLACES, axis=-1) * _TERM_FACTORS
    matrix = terms[..., :9] + terms[..., 9:]
    matrix[..., ::4] += 1.0
    return matrix.reshape(*q.shape[:-1], 3, 3)


def _product(a: str, b: str) -> int:
    """Index of the product of two components in the flattened outer product of a quaternion."""
    return 4 * "wxyz".index(a) + "wxyz".index(b)


_TERMS = ("yy+zz", "xy-wz", "xz+wy", "xy+wz", "xx+zz", "yz-wx", "xz-wy", "yz+wx", "xx+yy")
_TERM_PLACES = np.array([_product(*t[:2]) for t in _TERMS] + [_product(*t[3:]) for t in _TERMS])
_FACTORS = np.array([-2.0, 2, 2, 2, -2, 2, 2, 2, -2])
_SIGNS = np.array([-1.0 if term[2] == "-" else 1.0 for term in _TERMS])
_TERM_FACTORS = np.concatenate([_FACTORS, _FACTORS * _SIGNS])


def quaternion_from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternions (..., 4) with w >= 0 of rotation matrices (..., 3, 3).

    The largest of the four components is found first, so no division is by a small number.
    """
    m = np.asarray(matrix, float)
    d = np.stack([m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], axis=-1)
    trace = d.sum(-1)
    w = 1 + trace
    xyz = 1 + 2 * d - trace[..., None]
    wx, wy, wz = (m[..., i, j] - m[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))  # 4 w x, ...
    xy, zx, yz = (m[..., i, j] + m[..., j, i] for i, j in ((1, 0), (0, 2), (2, 1)))  # 4 x y, ...
    x, y, z = xyz[..., 0], xyz[..., 1], xyz[..., 2]
    # Each row is the quaternion times four times one of its components, and so is exact where that
    # component is large.
    rows = (w, wx, wy, wz, wx, x, xy, zx, wy, xy, y, yz, wz, zx, yz, z)
    candidates = np.stack(rows, axis=-1).reshape(*w.shape, 4, 4)
    best = np.argmax(np.concatenate([w[..., None], xyz], axis=-1), axis=-1)
    q = candidates.reshape(-1, 4, 4)[np.arange(best.size), best.ravel()].reshape(*w.shape, 4)
    q = q / np.sqrt((q * q).sum(axis=-1, keepdims=True))
    return np.where(q[..., :1] < 0, -q, q)


def rotation_vector(rotation: Array) -> Array:
    """Rotation vectors (n, 3) rad of matrices (n, 3, 3) that turn by less than half a turn."""
    skew = np.stack(
        [
            rotation[:, 2, 1] - rotation[:, 1, 2],
            rotation[:, 0, 2] - rotation[:, 2, 0],
            rotation[:, 1, 0] - rotation[:, 0, 1],
        ],
        axis=-1,
    )
    cosine = np.clip((np.trace(rotation, axis1=1, axis2=2) - 1) / 2, -1.0, 1.0)
    sine = np.sqrt((skew**2).sum(axis=-1)) / 2
    # The arc tangent of both is accurate at any angle, where arcsin or arccos alone are not.
    angle = np.arctan2(sine, cosine)
    # For small angles angle / (2 sin angle) tends to 1/2; the maximum keeps the unused branch
    # finite.
    return skew * np.where(sine > 1e-9, angle / np.maximum(2 * sine, 1e-12), 0.5)[:, None]


_UNTURNED = np.eye(3)


def turned_by(vector: Array) -> Array:
    """Matrices (n, 3, 3) of rotation vectors (n, 3) rad, by Rodrigues."""
    angle = np.sqrt((vector**2).sum(axis=-1))
    small = angle < 1e-9
    # Both branches of np.where are evaluated: the small angles divide by 1 instead of 0.
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0, np.sin(angle) / safe)[:, None, None]
    b = np.where(small, 0.5, (1 - np.cos(angle)) / safe**2)[:, None, None]
    k = skew(vector)
    return _UNTURNED + a * k + b * (k @ k)


def skew(vector: Array) -> Array:
    """Matrices (..., 3, 3) whose product with w is ``vector`` (..., 3) x w."""
    matrix = np.zeros((*vector.shape, 3))
    # Element by element, which for the few robots of a batch is faster than by arrays of places.
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix[..., 2, 1], matrix[..., 0, 2], matrix[..., 1, 0] = x, y, z
    matrix[..., 1, 2], matrix[..., 2, 0], matrix[..., 0, 1] = -x, -y, -z
    return matrix


def orthonormal(rotation: Array) -> Array:
    """Orthonormalise rotations (n, 3, 3) by Gram-Schmidt, starting from the third column."""
    z = rotation[:, :, 2]
    z = z / np.sqrt((z**2).sum(axis=-1))[:, None]
    x = rotation[:, :, 0]
    x = x - (x * z).sum(axis=-1)[:, None] * z
    x = x / np.sqrt((x**2).sum(axis=-1))[:, None]
    return frame_of(x, z)


def heading(rotation: Array, gear: NDArray[np.int_]) -> Array:
    """Flip frames of robots in reverse gear, so that z points along travel.

    ``rotation`` (..., 3, 3); ``gear`` (...,), -1 in reverse.
    """
    back = gear < 0
    if not np.count_nonzero(back):
        return rotation
    return np.where(back[..., None, None], rotation * TURNED, rotation)


def with_rows(values: NDArray, rows: NDArray, new: ArrayLike) -> NDArray:
    """Return a copy of ``values`` (n, ...) with ``new`` (k, ...) in ``rows``: (k,), or a mask (n,).

    Holders of the original array see no change.
    """
    changed = values.copy()
    changed[rows] = new
    return changed


def set_rows(owner: object, rows: NDArray, **values: ArrayLike) -> None:
    """Set ``rows`` (k,) of an object's arrays (n, ...) to values (k, ...), by the arrays' names.

    Each becomes a new array; holders of the earlier one see no change.
    """
    for name, value in values.items():
        setattr(owner, name, with_rows(getattr(owner, name), rows, value))


def wrap_angle(angle: ArrayLike, period: float = 2 * np.pi) -> Array:
    """Wrap angles (...,) rad into [-period/2, period/2)."""
    return (np.asarray(angle, float) + period / 2) % period - period / 2


@dataclass(frozen=True)
class Pose:
    """A frame B in a frame A.

    Attributes:
        rotation: (3, 3), axes of B in A as columns.
        position: (3,) m, origin of B in A.
    """

    rotation: Array = field(default_factory=lambda: np.eye(3))
    position: Array = field(default_factory=lambda: np.zeros(3))

    def __matmul__(self, other: Pose) -> Pose:
        """Frame C in A, if this is B in A and ``other`` is C in B."""
        return Pose(self.rotation @ other.rotation, self.apply(other.position))

    def apply(self, points: ArrayLike) -> Array:
        """Points (..., 3) of frame B, expressed in frame A."""
        return np.asarray(points, float) @ self.rotation.T + self.position

    def inverse(self) -> Pose:
        """Frame A in B."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (4,), w >= 0."""
        return quaternion_from_matrix(self.rotation)
