"""What an entry of a learned controller's observation is, and what it is read from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, dot
from omnitrack_sim.robots.omnitrack.control.interface import ControlSetup, Observation
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign

Entries = NDArray[np.float32]


@dataclass(frozen=True)
class View:
    """What features are read from, of n robots at one moment.

    Attributes:
        setup: routes, robot and settings. observation: what the robots measure.
        action: (n, 4) that was decided last. roll: (n, 3) rad, asked of the rotary motors.
    """

    setup: ControlSetup
    observation: Observation
    action: Array
    roll: Array

    @cached_property
    def forward(self) -> Array:
        """Direction (n, 3) in which a positive belt speed drives each module."""
        return belt_sign(self.observation.roll)

    def in_robot(self, vectors: Array) -> Array:
        """Vectors (n, 3) of the world in the robot frame."""
        frame = self.observation.place.frame
        return np.stack([dot(vectors, frame[:, :, axis]) for axis in range(3)], axis=-1)


@dataclass(frozen=True)
class Feature:
    """One named quantity of a learned controller's observation: one entry, or several of a kind.

    An entry is the quantity, cut off at ``low`` and ``high``, over the larger of their sizes, so
    that it lies within -1 and 1. What is not a number becomes 0.

    Attributes:
        name: of the quantity. unit: of what ``read`` returns.
        low, high: range in that unit, beyond which it is cut off.
        meaning: one line for the docs.
        read: (n,) or (n, k) from a ``View`` of n robots, with no regard to other robots.
        labels: of the k entries, behind the name; one empty label where there is one entry.
    """

    name: str
    unit: str
    low: float
    high: float
    meaning: str
    read: Callable[[View], Array]
    labels: tuple[str, ...] = ("",)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"{self.name}: {self.low} to {self.high} is no range")
        if not self.labels:
            raise ValueError(f"{self.name}: labels is empty; one entry has the label ''")

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.labels)

    @property
    def scale(self) -> float:
        """What an entry of 1 stands for, in ``unit``."""
        return max(abs(self.low), abs(self.high))

    @property
    def entry_names(self) -> tuple[str, ...]:
        """The name of each entry."""
        return tuple(f"{self.name}_{label}" if label else self.name for label in self.labels)

    def entries(self, view: View) -> Entries:
        """The entries (n, size) of n robots.

        Raises:
            AttributeError: a channel is not observed.
            ValueError: ``read`` returns another shape.
        """
        values = np.asarray(self.read(view), float)
        values = values[:, None] if values.ndim == 1 else values
        if values.shape != (view.setup.n, self.size):
            expected = (view.setup.n, self.size)
            raise ValueError(f"feature {self.name!r} reads {values.shape}, not {expected}")
        values = np.nan_to_num(values, nan=0.0, posinf=self.high, neginf=self.low)
        scaled = np.minimum(np.maximum(values, self.low), self.high) / self.scale
        return scaled.astype(np.float32)


def bounds(features: Sequence[Feature]) -> tuple[Entries, Entries]:
    """Least and largest value (k,) of all entries of features, in their order."""
    sizes = [feature.size for feature in features]
    low = np.repeat([feature.low / feature.scale for feature in features], sizes)
    high = np.repeat([feature.high / feature.scale for feature in features], sizes)
    return low.astype(np.float32), high.astype(np.float32)


def entry_slices(features: Sequence[Feature]) -> dict[str, slice]:
    """Where the entries of each feature stand among the entries of all, by its name."""
    ends = np.cumsum([feature.size for feature in features]).tolist()
    return {
        feature.name: slice(end - feature.size, end)
        for feature, end in zip(features, ends, strict=True)
    }


def entry_names(features: Sequence[Feature]) -> tuple[str, ...]:
    """The names (k,) of all entries of features, in their order."""
    return tuple(name for feature in features for name in feature.entry_names)
