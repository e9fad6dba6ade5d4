"""Policies: a network in NumPy, and the files that hold it: arrays and one entry of JSON, nothing
that could be executed."""

from __future__ import annotations

import functools
import hashlib
import io
import math
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.bounds import LARGEST_WEIGHT, MOST_LAYERS, MOST_POLICY_BYTES, MOST_WIDTH
from omnitrack_sim.base.errors import Fault, InputError, PolicyError
from omnitrack_sim.base.naming import ByName, shipped_files
from omnitrack_sim.base.reading import checked, is_file, parsed
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import counted, strict_json
from omnitrack_sim.base.writing import npz_of, write_file
from omnitrack_sim.robots.feature import DECISION_PERIOD, Feature, FloatRows
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURES, features_of

HEADER = "policy"
"""Name of the entry of JSON, as bytes of UTF-8."""
Word = Annotated[str, Field(max_length=200)]


class Acting(Table):
    """Conversion of decisions to commands."""

    name: Word
    """Of this conversion."""
    base: Literal["jacobian", "paper", "equal"] | None = None
    """The shipped controller to whose command the decision is added; none: it is the command.
    While the base stands or backs off, the decision counts for nothing."""
    speed: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Part of the speed limit that an action of 1 stands for."""
    roll_reach: Annotated[float, Field(ge=0, le=math.pi)] | None = None
    """By how much the roll may be off that of the base, rad; none: by any angle."""


DIRECT = Acting(name="direct")
# Where walls are slippery and the way leads down, a turn has to be driven otherwise than the base
# drives it, so belts may do anything. 0.3 rad of roll turn the robot by 6 degrees, half the safe
# range of theta5.
RESIDUAL = Acting(name="residual", base="jacobian", roll_reach=0.3)
ACTINGS: Mapping[str, Acting] = ByName({acting.name: acting for acting in (DIRECT, RESIDUAL)})
"""Ways to act by name."""


TILE = 16
"""Rows that are evaluated together: the products of a layer of 64 to 64 then take 0.5 MB and stay
in the processor's cache. 64 rows take twice as long in one tile."""


def _relu(x: Array) -> Array:
    return np.maximum(x, 0.0)


def _elu(x: Array) -> Array:
    # Both sides are computed for all x: without the minimum, expm1 would overflow.
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
        weights: (inputs, outputs) of each layer, the first one first.
        biases: (outputs,) of each layer.
        mean: (inputs,) subtracted from the entries, ...
        std: ... (inputs,) by which they are divided then, ...
        reach: ... and size at which they are cut off.
        activation: between layers, see ``ACTIVATIONS``.
        output: behind the last layer, see ``OUTPUTS``.

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
        for name, array in self.arrays.items():
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
    def arrays(self) -> dict[str, Array]:
        """Its arrays by their names in a file."""
        arrays = {"mean": self.mean, "std": self.std}
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays |= {f"weight_{i}": weight, f"bias_{i}": bias}
        return arrays

    @property
    def inputs(self) -> int:
        """Number of entries."""
        return self.weights[0].shape[0] if self.weights[0].ndim else 0

    @property
    def widths(self) -> tuple[int, ...]:
        """Number of entries, and of the outputs of each layer."""
        return (self.inputs, *(len(bias) for bias in self.biases))

    def __call__(self, entries: ArrayLike) -> FloatRows:
        """Outputs (n, m) within -1 and 1 of entries (n, inputs).

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


class FeatureEntry(Table):
    """One feature, as it was when the policy was trained."""

    name: Word
    size: Annotated[int, Field(ge=1)]
    unit: Word
    low: float
    high: float

    @classmethod
    def of(cls, name: str, feature: Feature) -> Self:
        """Describe a feature that is known by ``name``."""
        low, high = float(feature.low), float(feature.high)
        return cls(name=name, size=feature.size, unit=feature.unit, low=low, high=high)

    def feature(self) -> Feature:
        """The feature of that name.

        Raises:
            ValueError: there is none, or it is another one by now.
        """
        try:
            features = features_of([self.name])
        except InputError as error:
            raise ValueError(str(error)) from None
        if len(features) != 1:
            raise ValueError(f"features: {self.name!r} is a set of them, not one")
        now = FeatureEntry.of(self.name, features[0])
        if now != self:
            raise ValueError(f"features: was made for {self._told()}, which is now {now._told()}")
        return features[0]

    def _told(self) -> str:
        numbers = "1 number" if self.size == 1 else f"{self.size} numbers"
        return f"{self.name!r} of {numbers} from {self.low:g} to {self.high:g} {self.unit}"


class TrainingRecord(Table):
    """Record of a policy's training."""

    command: Annotated[str, Field(max_length=2000)] = ""
    """That trained it."""
    seed: int | None = None
    """Of the training."""
    steps: Annotated[int, Field(ge=0)] | None = None
    """Decisions that it was trained for."""
    date: Word = ""
    """Of the training, as ISO 8601 has it."""
    package_version: Word = ""
    """Of omnitrack_sim."""
    note: Annotated[str, Field(max_length=2000)] = ""
    """Anything else, such as the scenarios that it was trained on."""


class Header(Table):
    """The JSON entry of a policy file."""

    format: Literal[1]
    architecture: Literal["mlp"]
    activation: Word
    output: Word
    reach: float
    features: Annotated[tuple[FeatureEntry, ...], Field(min_length=1, max_length=200)]
    actions: tuple[Word, ...]
    decision_period_s: float
    acting: Acting
    record: TrainingRecord = TrainingRecord()

    @model_validator(mode="after")
    def _is_for_these_actions(self) -> Self:
        for key, now in (("actions", ACTIONS), ("decision_period_s", DECISION_PERIOD)):
            made_for = getattr(self, key)
            if made_for != now:
                raise ValueError(f"{key}: was made for {made_for}, and here it is {now}")
        return self


@dataclass(frozen=True, eq=False)
class Policy:
    """A trained controller: entries in, actions out.

    Attributes:
        network: from entries to actions.
        features: names of single features, in the order of the entries.
        acting: conversion of its decisions to commands.
        record: of its training.
        sha256: of its file; empty before it is written.

    Raises:
        ValueError: the network takes or gives another number of entries.
        TypeError: ``features`` holds something else than names.
        InputError: a name is not that of a feature.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> policy = ot.load_policy("tee_turn")
        >>> entries = sum(feature.size for feature in policy.read)
        >>> policy(np.zeros((5, entries))).shape
        (5, 4)
    """

    network: Mlp
    features: tuple[str, ...]
    acting: Acting = DIRECT
    record: TrainingRecord = field(default_factory=TrainingRecord)
    sha256: str = ""

    def __post_init__(self) -> None:
        check_is(Mlp, "network", self.network)
        object.__setattr__(self, "features", named_features(self.features))
        entries = sum(feature.size for feature in self.read)
        inputs, outputs = self.network.widths[0], self.network.widths[-1]
        if inputs != entries:
            raise ValueError(f"takes {inputs} entries, and its features have {entries}")
        if outputs != len(ACTIONS):
            raise ValueError(f"gives {outputs} numbers, and an action has {len(ACTIONS)}")

    def __repr__(self) -> str:
        known = f"{counted(len(self.features), 'feature')}, {self.acting.name}"
        return f"Policy({self.network}, {known}{self.sha256 and f', sha256 {self.sha256[:12]}'})"

    @property
    def read(self) -> tuple[Feature, ...]:
        """The features themselves."""
        return features_of(self.features)

    def __call__(self, entries: ArrayLike) -> FloatRows:
        """Actions (n, 4) of entries (n, k).

        Raises:
            ValueError: entries of another shape.
        """
        return self.network(entries)

    def header(self) -> Header:
        """Return the JSON entry of its file."""
        known = zip(self.features, self.read, strict=True)
        return Header(
            format=1,
            architecture="mlp",
            activation=self.network.activation,
            output=self.network.output,
            reach=self.network.reach,
            features=tuple(FeatureEntry.of(name, feature) for name, feature in known),
            actions=ACTIONS,
            decision_period_s=DECISION_PERIOD,
            acting=self.acting,
            record=self.record,
        )

    def save(self, path: str | Path) -> None:
        """Write a policy file, whole or not at all; equal policies give equal bytes.

        Raises:
            OutputError: it cannot be written there.
        """
        text = strict_json(self.header().model_dump(mode="json"))
        header = np.frombuffer(text.encode(), np.uint8)
        write_file(path, npz_of({HEADER: header, **self.network.arrays}))


def named_features(names: str | Sequence[str]) -> tuple[str, ...]:
    """The names of single features, as ``Policy.features`` has them, of names as ``features_of``
    takes them.

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


def load_policy(source: str | Path) -> Policy:
    """Read a policy file, or a shipped policy by name. Nothing in it is executed.

    Raises:
        PolicyError: no such file, or it is damaged, too large, or made for something else.

    Example:
        >>> import omnitrack_sim as ot
        >>> policy = ot.load_policy("tee_turn_residual")
        >>> policy.acting.name, policy.network.widths[-1]
        ('residual', 4)
    """
    path = policy_path(source)
    try:
        status = path.stat()
        if status.st_size > MOST_POLICY_BYTES:
            raise ValueError(f"is too large: at most {MOST_POLICY_BYTES} bytes are read")
        return _read(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise PolicyError(Fault(str(path), f"cannot be read: {error.strerror}")) from error
    except ValueError as error:
        raise PolicyError(Fault(str(path), str(error))) from error
    except InputError as error:
        raise PolicyError([fault.at(f"{path}: {fault.where}") for fault in error.faults]) from error


def policy_path(source: str | Path) -> Path:
    """The file that is meant: by its path, or by the name of a shipped policy.

    Raises:
        PolicyError: there is none.
    """
    if is_file(Path(source)):
        return Path(source)
    shipped = shipped_files("policies")
    if str(source) in shipped:
        return shipped[str(source)]
    problem = "no such file, nor a shipped policy of that name"
    raise PolicyError(Fault(str(source), problem, tuple(shipped), given=str(source)))


@functools.lru_cache(maxsize=64)
def _read(path: Path, changed: int, size: int) -> Policy:
    """The policy of a file of that age and size."""
    with path.open("rb") as file:
        data = file.read(MOST_POLICY_BYTES + 1)
    arrays = _arrays(data)
    header = _header(arrays)
    # First, since other observations are the reason for shapes that do not fit.
    for entry in header.features:
        entry.feature()
    count = sum(name.startswith("weight_") for name in arrays)
    wanted = [f"{kind}_{i}" for i in range(count) for kind in ("weight", "bias")]
    wanted += ["mean", "std", HEADER]
    if set(wanted) != set(arrays):
        odd = ", ".join(sorted(set(wanted) ^ set(arrays))[:5])
        raise ValueError(f"holds not the arrays of an mlp; at odds: {odd}")
    network = Mlp(
        weights=[arrays[f"weight_{i}"] for i in range(count)],
        biases=[arrays[f"bias_{i}"] for i in range(count)],
        mean=arrays["mean"],
        std=arrays["std"],
        reach=header.reach,
        activation=header.activation,
        output=header.output,
    )
    names = tuple(entry.name for entry in header.features)
    digest = hashlib.sha256(data).hexdigest()
    return Policy(network, names, header.acting, header.record, digest)


def _arrays(data: bytes) -> dict[str, NDArray]:
    """The arrays of an npz, none of objects, and together no larger than a policy may be.

    Raises:
        ValueError: it is no npz, or damaged, or too large.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            if len(entries) > 2 * MOST_LAYERS + 3:
                raise ValueError(f"holds {len(entries)} arrays; at most {2 * MOST_LAYERS + 3}")
            # Before anything is unpacked: a small archive may hold more than the memory.
            if sum(entry.file_size for entry in entries) > MOST_POLICY_BYTES:
                raise ValueError(f"unpacks to more than {MOST_POLICY_BYTES} bytes")
            arrays = {
                entry.filename.removesuffix(".npy"): np.load(
                    # An array of objects would be unpickled, which executes what the file says.
                    io.BytesIO(archive.read(entry)),
                    allow_pickle=False,
                )
                for entry in entries
            }
    except zipfile.BadZipFile as error:
        raise ValueError(f"is no policy file, or damaged: {error}") from error
    except (EOFError, MemoryError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise ValueError(f"is damaged: {error}") from error
    for name, array in arrays.items():
        if array.dtype.kind not in "fu":
            raise ValueError(f"holds {name}, an array of {array.dtype}: no plain numbers")
    return arrays


def _header(arrays: Mapping[str, NDArray]) -> Header:
    """Read the JSON entry of a policy file."""
    text = arrays.get(HEADER)
    if text is None or text.dtype != np.uint8 or text.ndim != 1:
        raise ValueError(f"has no entry {HEADER!r}, so it is no policy file")
    try:
        data = parsed(text.tobytes().decode(), "JSON")
    except UnicodeDecodeError as error:
        raise ValueError(f"has an entry {HEADER!r} that is no text: {error}") from error
    if not isinstance(data, dict):
        raise ValueError(f"has an entry {HEADER!r} that is no table")
    return checked(Header, data, PolicyError)
