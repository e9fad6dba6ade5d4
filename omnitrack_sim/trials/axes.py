"""Points of the unit cube, and the distributions made of them."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from omnitrack_sim.base.bounds import LARGEST, MOST_TRIALS
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import finite

Sampling = Literal["random", "latin_hypercube", "sobol"]
Draws = Literal["common", "independent"]
"""Whether all combinations of the crossed axes share their draws, or each has its own.

``common`` compares the combinations best, ``independent`` covers the random axes best.
"""


def unit_points(count: int, dimensions: int, sampling: Sampling, seed: int) -> Array:
    """Points (count, dimensions) of the open unit cube; the same arguments give the same points."""
    if dimensions == 0:
        return np.empty((count, 0))
    if sampling == "random":
        points = np.random.default_rng(seed).random((count, dimensions))
    else:
        from scipy.stats import qmc  # takes a second to load

        if sampling == "latin_hypercube":
            points = qmc.LatinHypercube(dimensions, rng=seed).random(count)
        else:
            exponent = max(0, (count - 1).bit_length())
            points = qmc.Sobol(dimensions, scramble=True, rng=seed).random_base2(exponent)[:count]
    least = 2.0**-53
    return np.clip(points, least, 1 - least)


def uniform(u: Array, low: float, high: float) -> Array:
    """Values (n,) between ``low`` and ``high``, made of ``u`` (n,) in the unit interval."""
    return np.clip(low + (high - low) * u, low, high)


def normal(u: Array, mean: float, std: float, low: float | None, high: float | None) -> Array:
    """Normal values (n,) made of uniform ``u`` (n,), truncated to ``low`` and ``high`` if given."""
    from scipy.special import ndtr, ndtri

    a = -np.inf if low is None else (low - mean) / std
    b = np.inf if high is None else (high - mean) / std
    # Numbers are finer near 0 than near 1, so an interval above the mean is mirrored.
    mirrored = a > 0
    if mirrored:
        a, b, u = -b, -a, 1 - u
    z = np.clip(ndtri(ndtr(a) + (ndtr(b) - ndtr(a)) * u), a, b)
    return mean + std * (-z if mirrored else z)


def direction(u: Array, v: Array, magnitude: float) -> Array:
    """Vectors (n, 3) of one length, uniform on the sphere.

    Each is made of a point of ``u`` (n,) and one of ``v`` (n,), both in the unit interval.
    """
    z, angle = 2 * u - 1, 2 * np.pi * v
    across = np.sqrt(1 - z**2)
    return magnitude * np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=-1)


BASE = "base"
"""Name of the axis that a list of base scenarios makes."""
Path = Annotated[str, Field(min_length=1)]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Spread = Annotated[float, Field(ge=1 / LARGEST, le=LARGEST)]


class AxisTable(Table):
    """What all axes have in common."""

    dimensions: ClassVar[int] = 0
    """How many coordinates of a sampling point the axis takes.

    With 0 its values are crossed with those of the other axes.
    """
    path: Path | Annotated[tuple[Path, ...], Field(min_length=1)]

    @property
    def paths(self) -> tuple[str, ...]:
        """All paths that take the value."""
        return (self.path,) if isinstance(self.path, str) else self.path

    @property
    def name(self) -> str:
        """The first path, by which the axis is known."""
        return self.paths[0]

    @property
    def crossed(self) -> bool:
        """Whether the values are crossed with those of other axes, not drawn."""
        return self.dimensions == 0


class GridAxis(AxisTable):
    """Evenly spaced values, both ends included."""

    kind: Literal["grid"]
    start: Number
    stop: Number
    count: Annotated[int, Field(ge=1, le=MOST_TRIALS)]

    @property
    def size(self) -> int:
        """Number of values."""
        return self.count

    def values_of(self) -> list[Any]:
        """The values in order."""
        return np.linspace(self.start, self.stop, self.count).tolist()


class ListAxis(AxisTable):
    """Values as written."""

    kind: Literal["list"]
    values: Annotated[tuple[Any, ...], Field(min_length=1, max_length=MOST_TRIALS)]
    labels: tuple[str, ...] | None = None

    @field_validator("values")
    @classmethod
    def _are_finite(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if finite(values) != list(values):
            raise ValueError("must be finite")
        return values

    @field_validator("labels")
    @classmethod
    def _one_a_value(
        cls, labels: tuple[str, ...] | None, info: ValidationInfo
    ) -> tuple[str, ...] | None:
        count = len(info.data.get("values", ()))
        if labels is not None and count and (len(labels) != count or len(set(labels)) != count):
            raise ValueError(f"needs {count} different labels, one for each value")
        return labels

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.values)

    def values_of(self) -> list[Any]:
        """The values in order."""
        return list(self.values)


class UniformAxis(AxisTable):
    """Uniform between two ends."""

    dimensions: ClassVar[int] = 1
    kind: Literal["uniform"]
    low: Number
    high: Number

    @field_validator("high")
    @classmethod
    def _is_above(cls, high: float, info: ValidationInfo) -> float:
        return _above(high, info)

    def draw(self, points: Array) -> list[Any]:
        """Values made of points (n, 1) of the unit interval."""
        return uniform(points[:, 0], self.low, self.high).tolist()


class NormalAxis(AxisTable):
    """Normal, truncated where an end is given."""

    dimensions: ClassVar[int] = 1
    kind: Literal["normal"]
    mean: Number
    std: Spread
    low: Number | None = None
    high: Number | None = None

    @field_validator("high")
    @classmethod
    def _is_above(cls, high: float | None, info: ValidationInfo) -> float | None:
        return high if high is None else _above(high, info)

    def draw(self, points: Array) -> list[Any]:
        """Values made of points (n, 1) of the unit interval."""
        return normal(points[:, 0], self.mean, self.std, self.low, self.high).tolist()


class DirectionAxis(AxisTable):
    """A vector of given length whose direction is uniform on the sphere."""

    dimensions: ClassVar[int] = 2
    kind: Literal["direction"]
    magnitude: Spread = 9.81

    def draw(self, points: Array) -> list[Any]:
        """Vectors, lists of three numbers, made of points (n, 2) of the unit square."""
        return direction(points[:, 0], points[:, 1], self.magnitude).tolist()


def _above(high: float, info: ValidationInfo) -> float:
    low = info.data.get("low")
    if low is not None and high <= low:
        raise ValueError(f"must be over low, {low:g}")
    return high


Axis = Annotated[
    GridAxis | ListAxis | UniformAxis | NormalAxis | DirectionAxis, Field(discriminator="kind")
]
AXES: dict[str, type[AxisTable]] = {
    "grid": GridAxis,
    "list": ListAxis,
    "uniform": UniformAxis,
    "normal": NormalAxis,
    "direction": DirectionAxis,
}
