"""A multilayer perceptron in NumPy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.base.bounds import LARGEST_WEIGHT, MOST_LAYERS, MOST_WIDTH
from omnitrack_sim.base.naming import ByName
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack.policy.feature import Entries

TILE = 16
"""Rows that are evaluated together: the products of a layer of 64 to 64 then take 0.5 MB and stay
in the processor's cache. 64 rows take twice as long in one tile."""


def _relu(x: Array) -> Array:
    return np.maximum(x, 0.0)


def _elu(x: Array) -> Array:
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0.0)))


def _cut(x: Array) -> Array:
    return np.minimum(np.maximum(x, -1.0), 1.0)


ACTIVATIONS: Mapping[str, Callable[[Array], Array]] = ByName(
    {"tanh": np.tanh, "relu": _relu, "elu": _elu}
)
"""Between layers, by name."""
OUTPUTS: Mapping[str, Callable[[Array], Array]] = ByName({"clip": _cut, "tanh": np.tanh})
"""Behind the last layer, by name: both end within -1 and 1."""


@dataclass(frozen=True, eq=False)
class Mlp:
    """Layers with an activation between them, of normalised entries.

    It is evaluated in double precision, and all sums are taken in one order, so that a row gives
    the same bytes alone and among any number of others. Matrix products of BLAS do not.

    Attributes:
        weights: (inputs, outputs) of each layer, the first one first. biases: (outputs,) of each.
        mean, std: (inputs,) of the entries: they are taken less ``mean`` and over ``std``, ...
        reach: ... and cut off at this size.
        activation, output: names, see ``ACTIVATIONS`` and ``OUTPUTS``.

    Raises:
        ValueError: shapes that do not fit, numbers that are none or too large, another name.
    """

    weights: Sequence[Array]
    biases: Sequence[Array]
    mean: Array
    std: Array
    reach: float = 10.0
    activation: str = "tanh"
    output: str = "clip"

    def __post_init__(self) -> None:
        for name, known in (("activation", ACTIVATIONS), ("output", OUTPUTS)):
            if getattr(self, name) not in known:
                choices = ", ".join(known)
                raise ValueError(f"{name} is {getattr(self, name)!r} (choose from: {choices})")
        if not 1 <= len(self.weights) <= MOST_LAYERS or len(self.weights) != len(self.biases):
            counts = f"{len(self.weights)} weights and {len(self.biases)} biases"
            raise ValueError(f"has {counts}; as many of each, 1 to {MOST_LAYERS}")
        for name in ("weights", "biases"):
            object.__setattr__(self, name, [np.array(a, float) for a in getattr(self, name)])
        for name in ("mean", "std"):
            object.__setattr__(self, name, np.array(getattr(self, name), float))
        self._check_shapes()
        self._check_numbers()

    def _check_shapes(self) -> None:
        width = self.inputs
        wanted: dict[str, tuple[Array, tuple[int, ...]]] = {
            "mean": (self.mean, (width,)),
            "std": (self.std, (width,)),
        }
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            outputs = weight.shape[1] if weight.ndim == 2 else bias.shape[0] if bias.ndim else 1
            wanted[f"weight_{i}"] = weight, (width, outputs)
            wanted[f"bias_{i}"] = bias, (outputs,)
            width = outputs
        for name, (array, shape) in wanted.items():
            if array.shape != shape:
                raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
            if not all(1 <= size <= MOST_WIDTH for size in shape):
                raise ValueError(f"{name} has shape {shape}; widths go from 1 to {MOST_WIDTH}")

    def _check_numbers(self) -> None:
        every = {"mean": self.mean, "std": self.std}
        every |= {f"weight_{i}": weight for i, weight in enumerate(self.weights)}
        every |= {f"bias_{i}": bias for i, bias in enumerate(self.biases)}
        for name, array in every.items():
            if not np.isfinite(array).all():
                raise ValueError(f"{name} holds what is not a number, or infinite")
            if np.abs(array).max() > LARGEST_WEIGHT:
                raise ValueError(f"{name} holds numbers larger than {LARGEST_WEIGHT:g}")
        if not (self.std > 1 / LARGEST_WEIGHT).all():
            raise ValueError(f"std holds numbers that are not larger than {1 / LARGEST_WEIGHT:g}")
        if not 0 < self.reach <= LARGEST_WEIGHT:
            raise ValueError(f"reach is {self.reach}; above 0, at most {LARGEST_WEIGHT:g}")

    def __repr__(self) -> str:
        return f"Mlp({'-'.join(map(str, self.widths))}, {self.activation}, {self.output})"

    @property
    def inputs(self) -> int:
        """Number of entries."""
        return self.weights[0].shape[0] if self.weights[0].ndim else 0

    @property
    def widths(self) -> tuple[int, ...]:
        """Number of entries, and of the outputs of each layer."""
        return (self.inputs, *(len(bias) for bias in self.biases))

    def __call__(self, entries: ArrayLike) -> Entries:
        """Outputs (n, m) within -1 and 1 of entries (n, inputs).

        Raises:
            ValueError: entries of another shape.
        """
        rows = np.asarray(entries, float)
        if rows.ndim != 2 or rows.shape[1] != self.inputs:
            raise ValueError(f"entries have shape {rows.shape}; needs (n, {self.inputs})")
        tiles = [self._tile(rows[i : i + TILE]) for i in range(0, len(rows), TILE)]
        return np.concatenate(tiles).astype(np.float32)

    def _tile(self, rows: Array) -> Array:
        x = (rows - self.mean) / self.std
        x = np.minimum(np.maximum(x, -self.reach), self.reach)
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = ACTIVATIONS[self.activation](_layer(x, weight, bias))
        return OUTPUTS[self.output](_layer(x, *last))


def _layer(x: Array, weight: Array, bias: Array) -> Array:
    """``x @ weight + bias``. The sum goes over an axis that is not the last one, where NumPy adds
    row after row."""
    return np.add.reduce(x[:, :, None] * weight, axis=1) + bias
