"""Policies: actions from named features, by a network in NumPy that a file holds or by a callable.

A file is an ``.npz`` of numbers and names; nothing in it is executed.
"""

from __future__ import annotations

import functools
import hashlib
import io
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.bounds import MAX_LAYERS, MAX_POLICY_BYTES, MAX_WEIGHT, MAX_WIDTH
from omnitrack_sim.base.errors import Fault, InputError, PolicyError
from omnitrack_sim.base.naming import ByName, named, shipped_files, trusting
from omnitrack_sim.base.reading import is_file, read_bytes
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted
from omnitrack_sim.base.writing import npz_of, write_file
from omnitrack_sim.robots.feature import Feature, FloatRows
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURES, features_of


@dataclass(frozen=True)
class Acting:
    """Conversion of decisions to commands.

    Attributes:
        name: of this conversion.
        base: the shipped controller to whose command the decision is added; none: the decision is
            the command. While the base stands or backs off, the decision counts for nothing.
        roll_reach: by how much the roll may be off that of the base, rad.
    """

    name: str
    base: str | None = None
    roll_reach: float = np.inf


DIRECT = Acting("direct")
# Where walls are slippery and the way leads down, a turn has to be driven otherwise than the base
# drives it, so belts may do anything. 0.3 rad of roll turn the robot by 6 degrees, half the safe
# range of theta5.
RESIDUAL = Acting("residual", base="jacobian", roll_reach=0.3)
ACTINGS: Mapping[str, Acting] = ByName({acting.name: acting for acting in (DIRECT, RESIDUAL)})
"""Conversions of decisions to commands by name."""


TEXTS = ("features", "activation", "output", "acting", "note")
"""Arrays of a policy file that hold text; all others hold numbers."""
TILE = 16
"""Rows that are evaluated together: the products of a layer of 64 to 64 then take 0.5 MB and stay
in the processor's cache. 64 rows take twice as long in one tile."""


def _relu(x: Array) -> Array:
    return np.maximum(x, 0.0)


def _elu(x: Array) -> Array:
    # Both sides are computed for all x: without the minimum, expm1 would overflow.
    return np.where(x > 0, x, np.expm1(np.minimum(x, 0.0)))


def _clip(x: Array) -> Array:
    return np.minimum(np.maximum(x, -1.0), 1.0)


ACTIVATIONS: Mapping[str, Callable[[Array], Array]] = ByName(
    {"tanh": np.tanh, "relu": _relu, "elu": _elu}
)
"""Activations between layers, by name."""
OUTPUTS: Mapping[str, Callable[[Array], Array]] = ByName({"clip": _clip, "tanh": np.tanh})
"""Functions behind the last layer, by name: both end within -1 and 1."""


@dataclass(frozen=True, eq=False)
class Mlp:
    """Multilayer perceptron of normalised entries.

    It is evaluated in double precision, and all sums are taken in one order, so that a row gives
    the same bytes alone and among any number of others. Matrix products of BLAS do not.

    Attributes:
        weights: (inputs, outputs) of each layer, the first one first.
        biases: (outputs,) of each layer.
        mean: (inputs,) subtracted from the entries; 0 if left out.
        std: (inputs,) by which they are divided then; 1 if left out.
        reach: size at which they are cut off then.
        activation: between layers, see ``ACTIVATIONS``.
        output: behind the last layer, see ``OUTPUTS``.

    Raises:
        ValueError: shapes that do not fit, numbers that are none or too large, another name.
    """

    weights: Sequence[Array]
    biases: Sequence[Array]
    mean: ArrayLike = 0.0
    std: ArrayLike = 1.0
    reach: float = 10.0
    activation: str = "tanh"
    output: str = "clip"

    def __post_init__(self) -> None:
        for name, known in (("activation", ACTIVATIONS), ("output", OUTPUTS)):
            if getattr(self, name) not in known:
                choices = ", ".join(known)
                raise ValueError(f"{name} is {getattr(self, name)!r} (choose from: {choices})")
        if not 1 <= len(self.weights) <= MAX_LAYERS or len(self.weights) != len(self.biases):
            counts = f"{len(self.weights)} weights and {len(self.biases)} biases"
            raise ValueError(f"has {counts}; as many of each, 1 to {MAX_LAYERS}")
        for name in ("weights", "biases"):
            object.__setattr__(self, name, [np.array(a, float) for a in getattr(self, name)])
        for name in ("mean", "std"):
            value = np.array(getattr(self, name), float)
            object.__setattr__(self, name, np.full(self.inputs, value) if not value.ndim else value)
        self._check_shapes()
        self._check_numbers()

    def _check_shapes(self) -> None:
        width = self.inputs
        shapes = {"mean": (width,), "std": (width,)}
        for i, bias in enumerate(self.biases):
            outputs = bias.shape[0] if bias.ndim else 0
            shapes |= {f"weight_{i}": (width, outputs), f"bias_{i}": (outputs,)}
            width = outputs
        for name, shape in shapes.items():
            if self.arrays[name].shape != shape:
                raise ValueError(f"{name} has shape {self.arrays[name].shape}, expected {shape}")
            if not all(1 <= size <= MAX_WIDTH for size in shape):
                raise ValueError(f"{name} has shape {shape}; widths go from 1 to {MAX_WIDTH}")

    def _check_numbers(self) -> None:
        for name, array in self.arrays.items():
            if not np.isfinite(array).all():
                raise ValueError(f"{name} holds what is not a number, or infinite")
            if np.abs(array).max() > MAX_WEIGHT:
                raise ValueError(f"{name} holds numbers larger than {MAX_WEIGHT:g}")
        for name in ("std", "reach"):
            if not (self.arrays[name] > 1 / MAX_WEIGHT).all():
                raise ValueError(f"{name} holds numbers that are not larger than {1 / MAX_WEIGHT}")

    def __repr__(self) -> str:
        return f"Mlp({'-'.join(map(str, self.widths))}, {self.activation}, {self.output})"

    @property
    def arrays(self) -> dict[str, Array]:
        """Its arrays by their names in a file."""
        arrays = {"mean": self.mean, "std": self.std, "reach": self.reach}
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weight_{i}": weight, f"bias_{i}": bias}
        return {name: np.asarray(array) for name, array in arrays.items()}

    @property
    def inputs(self) -> int:
        """Number of entries."""
        return self.weights[0].shape[0] if self.weights[0].ndim else 0

    @property
    def widths(self) -> tuple[int, ...]:
        """Number of entries, and of the outputs of each layer."""
        return (self.inputs, *(len(bias) for bias in self.biases))

    def __call__(self, entries: ArrayLike) -> FloatRows:
        """Return outputs (n, m) within -1 and 1 of entries (n, inputs).

        Raises:
            ValueError: entries of another shape.
        """
        rows = np.asarray(entries, float)
        if rows.ndim != 2 or rows.shape[1] != self.inputs:
            raise ValueError(f"entries have shape {rows.shape}; needs (n, {self.inputs})")
        # Tiles keep the products in the cache; rows do not depend on each other.
        tiles = [self._tile(rows[i : i + TILE]) for i in range(0, len(rows), TILE)]
        return np.concatenate(tiles).astype(np.float32)

    def _tile(self, rows: Array) -> Array:
        x = (rows - np.asarray(self.mean)) / np.asarray(self.std)
        x = np.minimum(np.maximum(x, -self.reach), self.reach)
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = ACTIVATIONS[self.activation](_layer(x, weight, bias))
        return OUTPUTS[self.output](_layer(x, *last))


def _layer(x: Array, weight: Array, bias: Array) -> Array:
    """Return ``x @ weight + bias``, with sums whose order does not depend on the number of rows."""
    # The sum goes over an axis that is not the last one, where NumPy adds row after row.
    return np.add.reduce(x[:, :, None] * weight, axis=1) + bias


@dataclass(frozen=True, eq=False)
class Policy:
    """A learned controller: actions from the entries of named features.

    Attributes:
        network: callable from entries (n, k) to actions (n, 4) within -1 and 1; an ``Mlp``, or any
            other. Each row should depend on its own entries alone.
        features: names of single features, in the order of the entries.
        acting: conversion of its decisions to commands.
        note: how it was trained.
        sha256: of its file; empty where it was read from none.

    Raises:
        ValueError: the network takes or gives another number of entries.
        TypeError: ``network`` cannot be called, or ``features`` holds something else than names.
        InputError: a name is not that of a feature.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> policy = ot.Policy(lambda entries: np.tile([0.5, 0.5, 0.5, 0.0], (len(entries), 1)),
        ...                    ["tilt", "theta5"])
        >>> entries = sum(feature.size for feature in policy.inputs)
        >>> policy(np.zeros((5, entries))).shape
        (5, 4)
    """

    network: Callable[[FloatRows], ArrayLike]
    features: Sequence[str]
    acting: Acting = DIRECT
    note: str = ""
    sha256: str = ""

    def __post_init__(self) -> None:
        if not callable(self.network):
            raise TypeError(f"network: is {self.network!r}; it must be a callable")
        object.__setattr__(self, "features", named_features(self.features))
        entries = sum(feature.size for feature in self.inputs)
        if isinstance(self.network, Mlp) and self.network.inputs != entries:
            wrong = f"takes {self.network.inputs} entries, and its features have {entries}"
            raise ValueError(wrong)
        shape = self(np.zeros((1, entries), np.float32)).shape
        if shape != (1, len(ACTIONS)):
            raise ValueError(f"gives {shape} for one robot, and an action is (1, {len(ACTIONS)})")

    def __repr__(self) -> str:
        known = f"{counted(len(self.features), 'feature')}, {self.acting.name}"
        return f"Policy({self.network}, {known}{self.sha256 and f', sha256 {self.sha256[:12]}'})"

    @property
    def inputs(self) -> tuple[Feature, ...]:
        """The features themselves."""
        return features_of(self.features)

    def __call__(self, entries: FloatRows) -> FloatRows:
        """Return actions (n, 4) of entries (n, k).

        Raises:
            ValueError: entries of another shape.
        """
        return np.asarray(self.network(entries), np.float32)

    def save(self, path: str | Path) -> None:
        """Write a policy file, whole or not at all; equal policies give equal bytes.

        Raises:
            TypeError: its network is no ``Mlp``.
            ValueError: its conversion of decisions to commands is none of ``ACTINGS``.
            OutputError: it cannot be written there.
        """
        if not isinstance(self.network, Mlp):
            raise TypeError(f"network: is {self.network!r}; a file holds an Mlp")
        if self.acting not in ACTINGS.values():
            choices = ", ".join(ACTINGS)
            raise ValueError(f"acting: is {self.acting}; a file names one of: {choices}")
        texts = {
            "features": self.features,
            "activation": self.network.activation,
            "output": self.network.output,
            "acting": self.acting.name,
            "note": self.note,
        }
        arrays = {name: np.array(text) for name, text in texts.items()}
        write_file(path, npz_of(arrays | {"ranges": _ranges(self.inputs)} | self.network.arrays))


def _ranges(features: Sequence[Feature]) -> Array:
    """Return the least and the largest value (k, 2) of each feature, in its unit."""
    return np.array([(feature.low, feature.high) for feature in features], float)


def named_features(names: str | Sequence[str]) -> tuple[str, ...]:
    """Return the names of single features of names as ``features_of`` takes them.

    Raises:
        InputError: there is no such feature, or a list of a user's own is named: a file needs a
            name for each.
    """
    single: list[str] = []
    for name in [names] if isinstance(names, str | Feature) else names:
        several = features_of([name])
        shipped = [one.name for one in several if FEATURES.get(one.name) is one]
        if len(shipped) < len(several) > 1:
            problem = f"{name!r} is a list; name its features one by one, for a file to find them"
            raise InputError(Fault("features", problem))
        single += shipped or [name]
    return tuple(single)


def load_policy(source: str | Path, *, trust: bool | None = None) -> Policy:
    """Read a policy file or a shipped policy by name, or a policy ``module:Object``.

    Nothing in a file is executed.

    Args:
        source: the file or name.
        trust: import a feature ``module:Object`` that a file names, or the policy itself. When not
            given, the caller decides: a scenario that is to be run does, all others do not.

    Raises:
        PolicyError: no such file, or it is damaged, too large, or made for something else.

    Example:
        >>> import omnitrack_sim as ot
        >>> policy = ot.load_policy("tee_turn_residual")
        >>> policy.acting.name, policy.network.widths[-1]
        ('residual', 4)
    """
    if trust is not None:
        with trusting(None if trust else ()):
            return load_policy(source)
    shipped = shipped_files("policies")
    path = shipped.get(str(source), Path(source))
    try:
        if is_file(path):
            return _read(path, path.stat().st_mtime_ns, path.stat().st_size)
        if ":" not in str(source):
            problem = "no such file, nor a shipped policy of that name"
            raise PolicyError(Fault(str(source), problem, tuple(shipped), given=str(source)))
        policy = named(str(source), "policy", {})
        if not isinstance(policy, Policy):
            raise ValueError("is no ot.Policy")
        return policy
    except OSError as error:
        raise PolicyError(Fault(str(source), f"cannot be read: {error.strerror}")) from error
    except ValueError as error:
        raise PolicyError(Fault(str(source), str(error))) from error
    except PolicyError:
        raise
    except InputError as error:
        faults = [fault.at(f"{source}: {fault.where}") for fault in error.faults]
        raise PolicyError(faults) from error


@functools.lru_cache(maxsize=64)
def _read(path: Path, *_version: int) -> Policy:
    """Return the policy of a file; another ``_version`` of it is read anew."""
    data = read_bytes(path, MAX_POLICY_BYTES)
    arrays = _arrays(data)
    texts = {name: arrays.pop(name) for name in TEXTS if name in arrays}
    features = [str(name) for name in texts.pop("features")]
    _check_ranges(features, arrays.pop("ranges", None))
    words: dict[str, Any] = {name: str(text.item()) for name, text in texts.items()}
    acting, note = words.pop("acting", DIRECT.name), words.pop("note", "")
    if acting not in ACTINGS:
        raise ValueError(f"acting is {acting!r} (choose from: {', '.join(ACTINGS)})")
    layers = range(sum(name.startswith("weight_") for name in arrays))
    weights, biases = ([arrays.pop(f"{kind}_{i}") for i in layers] for kind in ("weight", "bias"))
    if "reach" in arrays:
        words["reach"] = float(arrays.pop("reach").item())
    network = Mlp(weights, biases, **arrays, **words)
    return Policy(network, features, ACTINGS[acting], note, hashlib.sha256(data).hexdigest())


def _check_ranges(features: Sequence[str], ranges: Array | None) -> None:
    """Raise a ``ValueError`` if a feature has another range by now, or there is none such."""
    known = _ranges(features_of(features))
    made = known if ranges is None else ranges
    if made.shape != known.shape:
        raise ValueError(f"ranges has shape {made.shape}, expected {known.shape}")
    for name, (low, high), (low_now, high_now) in zip(features, made, known, strict=True):
        if (low, high) != (low_now, high_now):
            was, now = f"{name!r} from {low:g} to {high:g}", f"from {low_now:g} to {high_now:g}"
            raise ValueError(f"features: was made for {was}, which is now {now}")


def _arrays(data: bytes) -> dict[str, NDArray]:
    """Return the arrays of a policy file by name, none of objects, all of them known.

    Raises:
        ValueError: it is no npz, damaged, too large, or has not the arrays of a policy.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            # Before anything is unpacked: a small archive may hold more than the memory.
            if sum(entry.file_size for entry in archive.infolist()) > MAX_POLICY_BYTES:
                raise ValueError(f"unpacks to more than {MAX_POLICY_BYTES} bytes")
            _check_names([name.removesuffix(".npy") for name in archive.namelist()])
        # An array of objects would be unpickled, which executes what the file says.
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = dict(archive)
    except zipfile.BadZipFile as error:
        raise ValueError(f"is no policy file, or damaged: {error}") from error
    except (EOFError, MemoryError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise ValueError(f"is damaged: {error}") from error
    for name, array in arrays.items():
        if array.dtype.kind not in ("U" if name in TEXTS else "fiu"):
            kind = "text" if name in TEXTS else "plain numbers"
            raise ValueError(f"holds {name}, an array of {array.dtype}: no {kind}")
    return arrays


def _check_names(names: Sequence[str]) -> None:
    """Raise a ``ValueError`` if these are not the names of the arrays of a policy."""
    layers = max(1, min(MAX_LAYERS, sum(name.startswith("weight_") for name in names)))
    needed = {f"{kind}_{i}" for i in range(layers) for kind in ("weight", "bias")} | {"features"}
    optional = {"mean", "std", "reach", "ranges", *TEXTS}
    problems = {"lacks": needed - set(names), "has unknown": set(names) - needed - optional}
    for problem, odd in problems.items():
        if odd:
            raise ValueError(f"{problem} arrays: {', '.join(sorted(odd)[:5])}")
