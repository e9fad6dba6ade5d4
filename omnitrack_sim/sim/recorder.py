"""Records samples of n robots for as long as their runs take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.trajectory import Trajectory

BLOCK = 1024
"""Samples that are put together into one array as soon as there are so many of them: an array of
its own for each sample takes seven times the memory."""


class Recorder:
    """Samples of n robots. Every sample is an array (n, ...) a channel; a robot's record ends where
    its run ended.

    Args:
        phases: names that the codes of the channel ``phase`` index.
        schema: the channels to keep, by name.

    Attributes:
        count: number of samples so far.
    """

    def __init__(self, phases: tuple[str, ...], schema: Mapping[str, Channel]):
        self.phases, self.schema = phases, schema
        self.count = 0
        self._samples: dict[str, list[NDArray]] = {n: [] for n in ("time", "qpos", *schema)}
        self._blocks: dict[str, list[NDArray]] = {name: [] for name in self._samples}

    def sample(self, qpos: Array, values: Mapping[str, NDArray]) -> None:
        """Add one sample.

        Args:
            qpos: (n, nq), copied.
            values: ``time`` (n,) and every channel (n, ...), which must not be changed afterwards.
        """
        samples = self._samples
        samples["qpos"].append(np.array(qpos))
        for name in ("time", *self.schema):
            samples[name].append(values[name])
        self.count += 1
        if len(samples["time"]) == BLOCK:
            self._put_together()

    def _put_together(self) -> None:
        """Make one array a channel of the samples since the last time."""
        for name, values in self._samples.items():
            if values:
                self._blocks[name].append(np.array(values))
                values.clear()

    def trajectories(self, end_time: Array) -> Iterator[Trajectory]:
        """Yield one trajectory a robot, up to ``end_time`` (n,) s."""
        self._put_together()
        stacked = {name: np.concatenate(blocks) for name, blocks in self._blocks.items()}
        time, qpos = stacked.pop("time"), stacked.pop("qpos")  # (T, n), (T, n, nq)
        for i, end in enumerate(end_time):
            # A robot whose run has ended stands still in time: keep the samples up to the first
            # one at the end.
            # 1e-9 s: times are sums of steps, and rounded.
            count = int(np.searchsorted(time[:, i], end - 1e-9)) + 1
            channels = {name: values[:count, i] for name, values in stacked.items()}
            yield Trajectory(time[:count, i], channels, self.phases, qpos[:count, i], self.schema)
