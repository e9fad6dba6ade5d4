"""Policies, and the files that hold them: arrays and one entry of JSON, nothing that could be
executed."""

from __future__ import annotations

import functools
import hashlib
import io
import math
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.bounds import MOST_LAYERS, MOST_POLICY_BYTES
from omnitrack_sim.base.errors import Fault, InputError, PolicyError
from omnitrack_sim.base.files import is_file, parsed
from omnitrack_sim.base.reading import checked, fault_of
from omnitrack_sim.base.shipped import shipped_policies
from omnitrack_sim.base.text import counted, strict_json
from omnitrack_sim.base.writing import npz_of, write_file
from omnitrack_sim.robots.omnitrack.policy.actions import ACTIONS, DECISION_PERIOD, DIRECT, Acting
from omnitrack_sim.robots.omnitrack.policy.feature import Entries, Feature
from omnitrack_sim.robots.omnitrack.policy.features import FEATURES, features_of
from omnitrack_sim.robots.omnitrack.policy.header import (
    ActingEntry,
    FeatureEntry,
    Header,
    TrainingRecord,
)
from omnitrack_sim.robots.omnitrack.policy.mlp import Mlp

HEADER = "policy"
"""Name of the entry of JSON, as bytes of UTF-8."""


@dataclass(frozen=True, eq=False)
class Policy:
    """A trained controller: entries in, actions out.

    Attributes:
        network: evaluates it. features: names of single features, in the order of the entries.
        acting: how its decisions become commands.
        record: how it came about.
        sha256: of its file; empty before it is written.

    Raises:
        ValueError: the network takes or gives another number of entries.
        TypeError: ``features`` holds something else than names.
        InputError: a name is not that of a feature.
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

    def __call__(self, entries: ArrayLike) -> Entries:
        """Actions (n, 4) of entries (n, k).

        Raises:
            ValueError: entries of another shape.
        """
        return self.network(entries)

    def header(self) -> Header:
        """What its file says beside the arrays."""
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
            acting=ActingEntry.of(self.acting),
            record=self.record,
        )

    def save(self, path: str | Path) -> None:
        """Write a policy file, whole or not at all; equal policies give equal bytes.

        Raises:
            OutputError: it cannot be written there.
        """
        network, text = self.network, strict_json(self.header().model_dump(mode="json"))
        arrays = {HEADER: np.frombuffer(text.encode(), np.uint8)}
        arrays |= {"mean": network.mean, "std": network.std}
        for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            arrays |= {f"weight_{i}": weight, f"bias_{i}": bias}
        write_file(path, npz_of(arrays))


def named_features(names: str | Sequence[str]) -> tuple[str, ...]:
    """The names of single features, as ``Policy.features`` has them, of names as ``features_of``
    takes them.

    Raises:
        InputError: there is no such feature, or a list of a user's own is named: a file needs a
            name for each.
    """
    found: list[str] = []
    for name in [names] if isinstance(names, str | Feature) else names:
        several = features_of([name])
        shipped = [one.name for one in several if FEATURES.get(one.name) is one]
        if len(shipped) < len(several) > 1:
            problem = f"{name!r} is a list; name its features one by one, for a file to find them"
            raise InputError(Fault("features", problem))
        found += shipped or [name]
    return tuple(found)


def load_policy(source: str | Path) -> Policy:
    """Read a policy file, or a shipped policy by name. Nothing in it is executed.

    Raises:
        PolicyError: no such file, or it is damaged, too large, or made for something else.
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
    shipped = shipped_policies()
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
    # Made for other observations is told before shapes that do not fit for that very reason.
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
    return Policy(network, names, header.acting.acting(), header.record, digest)


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
            if sum(entry.file_size for entry in entries) > MOST_POLICY_BYTES:
                raise ValueError(f"unpacks to more than {MOST_POLICY_BYTES} bytes")
            return {e.filename.removesuffix(".npy"): _array(archive.read(e)) for e in entries}
    except zipfile.BadZipFile as error:
        raise ValueError(f"is no policy file, or damaged: {error}") from error
    except (EOFError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise ValueError(f"is damaged: {error}") from error


def _array(data: bytes) -> NDArray:
    """An array of plain numbers from the bytes of an ``npy`` file."""
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    if version != (1, 0):
        raise ValueError(f"holds an array of format {version}; expected (1, 0)")
    shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.kind not in "fu" or dtype.hasobject:
        raise ValueError(f"holds an array of {dtype}, no plain numbers; it is not read")
    if math.prod(shape) * dtype.itemsize != len(data) - file.tell():
        raise ValueError(f"holds an array of shape {shape} with other contents; it is damaged")
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)


def _header(arrays: Mapping[str, NDArray]) -> Header:
    """What the file says of itself."""
    text = arrays.get(HEADER)
    if text is None or text.dtype != np.uint8 or text.ndim != 1:
        raise ValueError(f"has no entry {HEADER!r}, so it is no policy file")
    try:
        data = parsed(text.tobytes().decode(), "JSON")
    except UnicodeDecodeError as error:
        raise ValueError(f"has an entry {HEADER!r} that is no text: {error}") from error
    if not isinstance(data, dict):
        raise ValueError(f"has an entry {HEADER!r} that is no table")
    return checked(Header, data, "", lambda item: fault_of(item, "", (), _no_choices), PolicyError)


def _no_choices(places: list[str]) -> tuple[str, ...]:
    return tuple(Header.model_fields) if not places else ()
