"""Axes of a sweep: the varied values, as lists, grids or random draws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, SerializeAsAny, ValidationInfo, field_validator

from omnitrack_sim.base.bounds import MAX_NUMBER, MAX_TRIALS
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.reading import by_kind
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import finite
from omnitrack_sim.calibration.doubt import draw_within

if TYPE_CHECKING:
    from omnitrack_sim.calibration.calibration import Calibration

BASE = "base"
"""Name of the axis that a list of base scenarios makes."""
Path = Annotated[str, Field(min_length=1)]
Paths = Path | Annotated[tuple[Path, ...], Field(min_length=1)]
Number = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
PositiveNumber = Annotated[float, Field(ge=1 / MAX_NUMBER, le=MAX_NUMBER)]
Sampling = Literal["random", "latin_hypercube", "sobol"]
Draws = Literal["common", "independent"]
"""All combinations of the crossed axes share their draws, or each has its own.

``common`` compares the combinations best, ``independent`` covers the random axes best.
"""


def unit_points(count: int, dimensions: int, sampling: Sampling, seed: int) -> Array:
    """Return points (count, dimensions) of the open unit cube, the same for the same arguments."""
    if dimensions == 0:
        return np.empty((count, 0))
    if sampling == "random":
        points = np.random.default_rng(seed).random((count, dimensions))
    else:
        from scipy.stats import qmc  # takes a second to load

        if sampling == "latin_hypercube":
            points = qmc.LatinHypercube(dimensions, rng=seed).random(count)
        else:
            # Sobol points are balanced in powers of two only; the first `count` of such a set are
            # taken.
            exponent = max(0, (count - 1).bit_length())
            points = qmc.Sobol(dimensions, scramble=True, rng=seed).random_base2(exponent)[:count]
    least = 2.0**-53  # half of the finest step below 1: 0 and 1 have no normal value
    return np.clip(points, least, 1 - least)


class PathTable(Table):
    """A table of a file that varies a value of the scenarios, at one path or at several."""

    path: Paths

    @property
    def paths(self) -> tuple[str, ...]:
        """All paths that take the value."""
        return (self.path,) if isinstance(self.path, str) else self.path

    @property
    def name(self) -> str:
        """The first path, by which the axis or variable is known."""
        return self.paths[0]


class AxisTable(PathTable):
    """Base of all axes."""

    coordinates: ClassVar[int] = 0

    @property
    def dimensions(self) -> int:
        """Number of coordinates of a sampling point that the axis takes.

        With 0 its values are crossed with those of the other axes.
        """
        return self.coordinates

    @property
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """The paths that take each of its values, by the name of the value's column."""
        return {self.name: self.paths}

    def drawn(self, points: Array) -> dict[str, list[Any]]:
        """Return the values of its columns that points (n, dimensions) of the unit cube make."""
        return {self.name: self.draw(points)}

    def draw(self, points: Array) -> list[Any]:
        """Return the values of an axis of one column; as ``drawn``."""
        raise NotImplementedError

    @classmethod
    def model_for(cls, value: Mapping[str, Any]) -> type[Table]:
        """Return the table of the ``kind`` that stands in ``value``; this one without one."""
        return AXES.get(str(value.get("kind")), cls)

    @property
    def crossed(self) -> bool:
        """True if the values are crossed with those of other axes, not drawn."""
        return self.dimensions == 0


class GridAxis(AxisTable):
    """Evenly spaced values, both ends included."""

    kind: Literal["grid"]
    start: Number
    stop: Number
    count: Annotated[int, Field(ge=1, le=MAX_TRIALS)]

    @property
    def size(self) -> int:
        """Number of values."""
        return self.count

    def values_of(self) -> list[Any]:
        """Return the values in order."""
        return np.linspace(self.start, self.stop, self.count).tolist()


class ListAxis(AxisTable):
    """Values as written."""

    kind: Literal["list"]
    values: Annotated[tuple[Any, ...], Field(min_length=1, max_length=MAX_TRIALS)]
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
        # Values with a fault of their own are missing here; their number is then unknown.
        count = len(info.data.get("values", ()))
        if labels is not None and count and (len(labels) != count or len(set(labels)) != count):
            raise ValueError(f"needs {count} different labels, one for each value")
        return labels

    @property
    def size(self) -> int:
        """Number of values."""
        return len(self.values)

    def values_of(self) -> list[Any]:
        """Return the values in order."""
        return list(self.values)


def above_low(high: float | None, info: ValidationInfo) -> float | None:
    """Check that an upper end is over the lower one: a pydantic validator."""
    low = info.data.get("low")
    if high is not None and low is not None and high <= low:
        raise ValueError(f"must be over low, {low:g}")
    return high


class UniformAxis(AxisTable):
    """Uniform between two ends."""

    coordinates: ClassVar[int] = 1
    kind: Literal["uniform"]
    low: Number
    high: Number
    _is_above = field_validator("high")(above_low)

    def draw(self, points: Array) -> list[Any]:
        """Return values made of points (n, 1) of the unit interval."""
        values = self.low + (self.high - self.low) * points[:, 0]
        # Rounding may lead past an end, which a limit of the scenario may refuse.
        return np.clip(values, self.low, self.high).tolist()


class NormalAxis(AxisTable):
    """Normal, truncated where an end is given; clipped, values beyond an end are put on it."""

    coordinates: ClassVar[int] = 1
    kind: Literal["normal"]
    mean: Number
    std: PositiveNumber
    low: Number | None = None
    high: Number | None = None
    clipped: Annotated[bool, Field(exclude_if=lambda clipped: not clipped)] = False
    _is_above = field_validator("high")(above_low)

    def draw(self, points: Array) -> list[Any]:
        """Return values made of points (n, 1) of the unit interval."""
        from scipy.special import ndtr, ndtri

        u = points[:, 0]
        if self.clipped:
            return np.clip(self.mean + self.std * ndtri(u), self.low, self.high).tolist()
        a = -np.inf if self.low is None else (self.low - self.mean) / self.std
        b = np.inf if self.high is None else (self.high - self.mean) / self.std
        # Numbers are finer near 0 than near 1, so an interval above the mean is mirrored.
        mirrored = a > 0
        if mirrored:
            a, b, u = -b, -a, 1 - u
        # The inverse of the distribution function maps uniform points to normal ones, one to one,
        # so that points of a low-discrepancy set stay evenly spread.
        z = np.clip(ndtri(ndtr(a) + (ndtr(b) - ndtr(a)) * u), a, b)
        return (self.mean + self.std * (-z if mirrored else z)).tolist()


class DirectionAxis(AxisTable):
    """A vector of given length whose direction is uniform on the sphere."""

    coordinates: ClassVar[int] = 2
    kind: Literal["direction"]
    magnitude: PositiveNumber = 9.81

    def draw(self, points: Array) -> list[Any]:
        """Return vectors, lists of three numbers, made of points (n, 2) of the unit square."""
        # Slices of a sphere that are as high have the same area: z is uniform.
        z, angle = 2 * points[:, 0] - 1, 2 * np.pi * points[:, 1]
        across = np.sqrt(1 - z**2)
        vectors = np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=-1)
        return (self.magnitude * vectors).tolist()


class CalibrationAxis(AxisTable):
    """Parameters of a calibration, drawn together by their doubt, within their ranges.

    In a sweep's file ``file`` alone is given; the others are what stands in it.

    Attributes:
        file: that ``omnitrack calibrate`` wrote, relative to the sweep's.
        values: that were fitted, one a path.
        covariance: of their doubt.
        low: ends of their ranges; high: as well.
    """

    kind: Literal["calibration"]
    file: str
    values: tuple[Number, ...]
    covariance: tuple[tuple[Number, ...], ...]
    low: tuple[Number, ...]
    high: tuple[Number, ...]

    @field_validator("values", "covariance", "low", "high")
    @classmethod
    def _one_a_path(cls, values: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        path = info.data.get("path", ())
        count = 1 if isinstance(path, str) else len(path)
        rows = [values, *values] if info.field_name == "covariance" else [values]
        if count and any(len(row) != count for row in rows):
            raise ValueError(f"needs {count} numbers, one for each path")
        return values

    @classmethod
    def of(cls, calibration: Calibration, file: str) -> CalibrationAxis:
        """Return the axis of a calibration that stands in a file."""
        low, high = calibration.bounds
        return cls(
            kind="calibration",
            file=file,
            path=calibration.fit,
            values=tuple(calibration.values.tolist()),
            covariance=tuple(map(tuple, calibration.covariance.tolist())),
            low=tuple(low.tolist()),
            high=tuple(high.tolist()),
        )

    @property
    def dimensions(self) -> int:
        """One coordinate for each parameter."""
        return len(self.paths)

    @property
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """A column for each parameter."""
        return {path: (path,) for path in self.paths}

    def drawn(self, points: Array) -> dict[str, list[Any]]:
        """Return the values of all parameters."""
        given = (np.array(each) for each in (self.values, self.covariance, self.low, self.high))
        return dict(zip(self.paths, draw_within(points, *given).T.tolist(), strict=True))


AXES: dict[str, type[AxisTable]] = {
    "grid": GridAxis,
    "list": ListAxis,
    "uniform": UniformAxis,
    "normal": NormalAxis,
    "direction": DirectionAxis,
    "calibration": CalibrationAxis,
}


def axis_table(kind: str) -> type[AxisTable]:
    """Return the table of a kind of axis.

    Raises:
        InputError: there is no such kind.
    """
    if kind in AXES:
        return AXES[kind]
    problem = f"is {kind!r}"
    if kind in ("latin_hypercube", "sobol"):
        problem += f', which is no kind of axis: write sampling = "{kind}" at the top and a '
        problem += "distribution here"
    raise InputError(Fault("kind", problem, tuple(sorted(AXES)), kind))


Axis = Annotated[SerializeAsAny[AxisTable], by_kind(axis_table)]
"""An axis of any kind, as its ``kind`` says."""
