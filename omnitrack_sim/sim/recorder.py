"""Keeps what a run measures and turns it into one trajectory a trial."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.record.trajectory import CHANNELS, Trajectory
from omnitrack_sim.rotations import Array


class Recorder:
    """Samples of n trials. Every sample is an array (n, ...) a channel; a trial's record ends where
    it ended."""

    def __init__(self, phases: tuple[str, ...]):
        self.phases = phases
        self._samples: dict[str, list[np.ndarray]] = {
            name: [] for name in ("time", "qpos", *CHANNELS)
        }

    def sample(self, **values: np.ndarray) -> None:
        """Add one sample: ``time`` (n,), ``qpos`` (n, nq) and every channel (n, ...)."""
        for name, samples in self._samples.items():
            samples.append(np.array(values[name]))

    def trajectories(self, end_time: Array) -> list[Trajectory]:
        """One trajectory a trial, up to ``end_time`` (n,) s."""
        stacked = {
            name: np.array(samples) for name, samples in self._samples.items()
        }  # (T, n, ...)
        time = stacked.pop("time")
        qpos = stacked.pop("qpos")
        trajectories = []
        for i, end in enumerate(end_time):
            # A trial that has ended stands still in time: keep the samples up to its first one at
            # the end.
            count = int(np.searchsorted(time[:, i], end - 1e-9)) + 1
            channels = {name: values[:count, i] for name, values in stacked.items()}
            trajectories.append(Trajectory(time[:count, i], channels, self.phases, qpos[:count, i]))
        return trajectories
