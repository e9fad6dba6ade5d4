"""A recorded run: named arrays over time. What each holds is said in ``record.channels``."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.record.channels import CHANNELS, MODULE_COUNT, Channel, recorded

RECORDED = recorded(CHANNELS.values())
"""The channels of every trajectory, by name, in the order of the file."""
JOINT_POSITIONS = 7 + 5 * MODULE_COUNT
"""Width of the joint positions: the chassis' pose, and of each module slide, pitch, roll and the
travel of its two belts."""


@dataclass(frozen=True)
class Trajectory:
    """One recorded run.

    Attributes:
        time: (T,) s, strictly increasing.
        channels: one array (T, *shape) for each name in ``schema``.
        phases: names that the codes of ``phase`` index.
        qpos: (T, ``JOINT_POSITIONS``), MuJoCo's joint positions, for the replay.
        schema: what the channels hold: ``RECORDED``, and those of a user's own sensors.
    """

    time: NDArray[np.float64]
    channels: Mapping[str, NDArray]
    phases: tuple[str, ...]
    qpos: NDArray[np.float64]
    schema: Mapping[str, Channel] = field(default_factory=lambda: RECORDED)

    def __post_init__(self) -> None:
        if set(self.channels) != set(self.schema):
            differ = sorted(set(self.channels) ^ set(self.schema))
            raise ValueError(f"channels and schema differ by {', '.join(differ)}")
        for name, values in self.channels.items():
            expected = (len(self.time), *self.schema[name].shape)
            if values.shape != expected:
                raise ValueError(f"{name} has shape {values.shape}, expected {expected}")

    def __getitem__(self, name: str) -> NDArray:
        if name not in self.channels:
            near = difflib.get_close_matches(name, self.channels, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            choices = ", ".join(self.channels)
            raise KeyError(f"there is no channel {name!r}{hint} (choose from: {choices})")
        return self.channels[name]

    def __len__(self) -> int:
        return len(self.time)

    def phase_spans(self) -> list[tuple[str, float, float]]:
        """The phases in order: (name, start, end) with times in s."""
        codes = self["phase"]
        return [
            (self.phases[int(codes[a])], float(self.time[a]), float(self.time[b]))
            for a, b in spans(codes)
        ]


def spans(*codes: NDArray) -> list[tuple[int, int]]:
    """First sample of each span in which all codes (T,) stay as they are, and the one after it, or
    the last of all."""
    changed = np.any([np.diff(code) != 0 for code in codes], axis=0)
    starts = np.append(0, np.flatnonzero(changed) + 1)
    ends = np.append(starts[1:], len(codes[0]) - 1)
    return list(zip(starts.tolist(), ends.tolist(), strict=True))
