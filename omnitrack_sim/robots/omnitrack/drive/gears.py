"""A drive as a value: how many motors there are, and the gears between them and the belts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack import MODULES

_NOTHING = 1e-9
"""Size of a coefficient that counts as zero."""


@dataclass(frozen=True)
class Drive:
    """m motors that drive the three belts through gears without loss between their speeds.

    The gears are a matrix B. A motor turns at B times the speeds of the belts; by the balance of
    power each belt is given B's transpose times the forces of the motors. For three motors B is
    the identity. For the 1-input 3-output differential it is (1/3, 1/3, 1/3): the speeds of the
    outputs add up to three times that of the input, and their forces are equal.

    Speeds are in m/s and forces in N, at the belts.

    Attributes:
        name: for messages.
        gears: (m, 3), the matrix B, row by row.
        size: torque and rotor inertia of each motor, as multiples of those of ``robot.motor``.

    Raises:
        ValueError: ``gears`` is not (m, 3), a motor drives nothing, or two drive the same.
    """

    name: str
    gears: Sequence[Sequence[float]]
    size: float = 1.0

    def __post_init__(self) -> None:
        matrix = self.matrix
        if matrix.ndim != 2 or matrix.shape[1] != MODULES or not np.isfinite(matrix).all():
            raise ValueError(f"gears of drive {self.name!r} are no rows of {MODULES} numbers")
        if np.linalg.matrix_rank(matrix) < len(matrix):
            raise ValueError(f"gears of drive {self.name!r}: its motors are not independent")
        if not self.size > 0:
            raise ValueError(f"size of drive {self.name!r} is {self.size}; it must be positive")

    @cached_property
    def matrix(self) -> Array:
        """The gears B (m, 3)."""
        return np.asarray(self.gears, float)

    @property
    def motors(self) -> int:
        """Number of motors, m."""
        return len(self.gears)

    @property
    def steers(self) -> bool:
        """Whether the belts can be given three speeds of their own."""
        return self.motors == MODULES

    @cached_property
    def direct(self) -> bool:
        """Whether motor i drives belt i and nothing else."""
        return np.array_equal(self.matrix, np.eye(MODULES))

    @property
    def strength(self) -> Array:
        """What the motors can give each belt at most (3,), as multiples of the torque limit of one
        ``robot.motor``."""
        return self.size * np.abs(self.matrix).sum(axis=0)

    @property
    def shafts(self) -> int:
        """Number of shafts that the model has beside the belts, each a joint of its own: one for
        each motor, none where every motor turns its own belt and nothing else."""
        return 0 if self.direct else self.motors

    @cached_property
    def relative(self) -> Array:
        """What the belts can do while all motors stand still (3, 3): a projection of their
        speeds."""
        free = np.eye(MODULES) - np.linalg.pinv(self.matrix) @ self.matrix
        return np.where(np.abs(free) > _NOTHING, free, 0.0)

    @cached_property
    def _inverse(self) -> Array:
        """Forces of the motors for those of the belts, (m, 3)."""
        return np.asarray(np.linalg.pinv(self.matrix.T), float)

    def motor_values(self, belts: Array) -> Array:
        """Speeds of the motors (n, m) for those of the belts (n, 3)."""
        return belts if self.direct else _product(belts, self.matrix)

    def belt_values(self, motors: Array) -> Array:
        """Forces of the belts (n, 3) for those of the motors (n, m)."""
        return motors if self.direct else _product(motors, self.matrix.T)

    def motor_forces(self, belts: Array) -> Array:
        """Forces of the motors (..., m) that give the belts theirs (..., 3)."""
        return belts if self.direct else _product(belts, self._inverse)


def _product(values: Array, matrix: Array) -> Array:
    """``matrix`` (a, b) times each of ``values`` (..., b), in one order of sums, so that a robot
    has the same bits alone and in a batch."""
    total = values[..., :1] * matrix[:, 0]
    for i in range(1, matrix.shape[1]):
        total = total + values[..., i : i + 1] * matrix[:, i]
    return total
