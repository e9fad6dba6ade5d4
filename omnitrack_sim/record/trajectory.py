"""Trajectory of a run, named arrays over time, and the recorder that makes trajectories.

Each array is described by its entry in ``channels``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import listed, no_such
from omnitrack_sim.record.channels import COMMON, Channel

if TYPE_CHECKING:
    import pandas

BLOCK = 1024
"""Number of samples that are stacked into one array: an array for each sample takes seven times the
memory."""

ReadTogether = Callable[[Sequence[Mapping[str, NDArray]], Iterable[str]], None]
"""Reads channels of several moments at once, so that looking them up costs nothing."""


@dataclass(frozen=True, eq=False)
class Trajectory(Mapping[str, NDArray]):
    """One recorded run: a mapping of its channels by name. It has T samples, ``len(time)``.

    Attributes:
        time: (T,) s, strictly increasing.
        channels: one array for each name in ``schema``: T, then the channel's shape.
        phases: names that the codes of ``phase`` index.
        qpos: (T, nq) MuJoCo's joint positions, for the replay.
        schema: what the channels hold, by name: those of the robot and of a user's own sensors.

    Example:
        >>> trajectory = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1})).trajectory
        >>> trajectory["normal_force"].shape  # six samples, three modules
        (6, 3)
        >>> trajectory.schema["normal_force"].unit
        'N'
    """

    time: NDArray[np.float64]
    channels: Mapping[str, NDArray]
    phases: tuple[str, ...]
    qpos: NDArray[np.float64]
    schema: Mapping[str, Channel]

    def __post_init__(self) -> None:
        if set(self.channels) != set(self.schema):
            differ = sorted(set(self.channels) ^ set(self.schema))
            raise ValueError(f"channels and schema differ by {', '.join(differ)}")
        for name, values in self.channels.items():
            # Checked once here, so that readers of saved files and of runs need no checks of their
            # own.
            expected = (len(self.time), *self.schema[name].shape)
            if values.shape != expected:
                raise ValueError(f"{name} has shape {values.shape}, expected {expected}")

    def __getitem__(self, name: str) -> NDArray:
        if name not in self.channels:
            raise KeyError(self._no_channel(name))
        return self.channels[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def __eq__(self, other: object) -> bool:
        # Mapping compares element by element, which for arrays has no single truth value.
        return self is other

    def __hash__(self) -> int:
        return id(self)

    def __repr__(self) -> str:
        end = f", {self.time[-1]:.6g} s" if len(self.time) else ""
        return f"Trajectory({len(self.time)} samples{end}, {len(self)} channels)"

    def _no_channel(self, name: object) -> str:
        """Message for a name that no recorded channel has."""
        if name == "time":
            return "the times of the samples are trajectory.time, no channel"
        if name in COMMON:
            kept = f"(choose from: {listed(list(self.schema))})"
            return f"{name!r} is observed, but not recorded {kept}"
        return no_such(name, list(self.schema), "channel ")

    def columns(self) -> Iterator[tuple[str, Channel, NDArray]]:
        """Name, channel and values (T,) of each column of ``trajectory.parquet`` after ``time``.

        A channel has a column for each of its numbers.
        """
        for name, channel in self.schema.items():
            # Codes and counts are kept as numbers like all else while a run is recorded.
            kind = np.int32 if channel.whole else np.float64
            flat = np.asarray(self[name]).reshape(len(self.time), -1).astype(kind)
            for column, values in zip(channel.columns, flat.T, strict=True):
                yield column, channel, np.ascontiguousarray(values)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a pandas table: one row a sample, columns as in ``trajectory.parquet``.

        ``frame.attrs["units"]`` has the unit of each column by its name, and
        ``frame.attrs["phases"]`` the names that the column ``phase`` indexes.

        Raises:
            ImportError: pandas is not installed; it is no dependency of this package.
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError("to_pandas needs pandas: pip install pandas") from error
        columns, units = {"time": self.time}, {"time": COMMON["time"].unit}
        for name, channel, values in self.columns():
            columns[name], units[name] = values, channel.unit
        frame = pandas.DataFrame(columns)
        frame.attrs.update(units=units, phases=list(self.phases))
        return frame

    def phase_spans(self) -> list[tuple[str, float, float]]:
        """Return the phases in order: (name, start, end) with times in s."""
        codes = self["phase"]
        return [
            (self.phases[int(codes[a])], float(self.time[a]), float(self.time[b]))
            for a, b in spans(codes)
        ]


class Recorder:
    """Recorder of n robots.

    Every sample is an array (n, ...) a channel; a robot's record ends where its run ended.

    Args:
        phases: names that the codes of the channel ``phase`` index.
        schema: the channels to keep, by name.
        read_together: called with the readings of some samples and the names of measured channels,
            before these are looked up.
        together: number of samples that are read together.

    Attributes:
        count: number of samples so far.
    """

    def __init__(
        self,
        phases: tuple[str, ...],
        schema: Mapping[str, Channel],
        read_together: ReadTogether = lambda *_: None,
        together: int = 1,
    ):
        self.phases, self.schema = phases, schema
        self.count = 0
        measured = ("time", *(c.name for c in schema.values() if c.source == "plant"))
        self._read_together, self._measured, self._together = read_together, measured, together
        self._readings: list[Mapping[str, NDArray]] = []
        self._samples: dict[str, list[NDArray]] = {n: [] for n in ("time", "qpos", *schema)}
        self._blocks: dict[str, list[NDArray]] = {name: [] for name in self._samples}

    def sample(
        self, qpos: Array, readings: Mapping[str, NDArray], values: Mapping[str, NDArray]
    ) -> None:
        """Add one sample.

        Args:
            qpos: (n, nq), copied.
            readings: ``time`` (n,) and every measured channel (n, ...), looked up later.
            values: every other channel (n, ...), which must not be changed afterwards.
        """
        samples = self._samples
        samples["qpos"].append(np.array(qpos))
        self._readings.append(readings)
        for name, value in values.items():
            samples[name].append(value)
        self.count += 1
        if len(self._readings) == self._together:
            self._read_samples()

    def _read_samples(self) -> None:
        """Look up the measured channels of the samples since the last time."""
        self._read_together(self._readings, self._measured)
        for name in self._measured:
            self._samples[name] += [readings[name] for readings in self._readings]
        self._readings.clear()
        if len(self._samples["time"]) >= BLOCK:
            self._join_samples()

    def _join_samples(self) -> None:
        """Make one array a channel of the samples since the last time."""
        for name, values in self._samples.items():
            if values:
                self._blocks[name].append(np.array(values))
                values.clear()

    def trajectories(self, end_time: Array) -> Iterator[Trajectory]:
        """Yield one trajectory a robot, up to ``end_time`` (n,) s."""
        self._read_samples()
        self._join_samples()
        stacked = {name: np.concatenate(blocks) for name, blocks in self._blocks.items()}
        time, qpos = stacked.pop("time"), stacked.pop("qpos")  # (T, n), (T, n, nq)
        for i, end in enumerate(end_time):
            # A robot whose run has ended stands still in time: keep the samples up to the first
            # one at the end.
            # 1e-9 s: times are sums of steps, and rounded.
            count = int(np.searchsorted(time[:, i], end - 1e-9)) + 1
            channels = {name: values[:count, i] for name, values in stacked.items()}
            yield Trajectory(time[:count, i], channels, self.phases, qpos[:count, i], self.schema)


def spans(*codes: NDArray) -> list[tuple[int, int]]:
    """Spans of samples in which all codes (T,) are constant: first, and first after or last."""
    changed = np.any([np.diff(code) != 0 for code in codes], axis=0)
    starts = np.append(0, np.flatnonzero(changed) + 1)
    # A span ends where the next one begins, so that neighbouring spans leave no gap in time.
    ends = np.append(starts[1:], len(codes[0]) - 1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))
