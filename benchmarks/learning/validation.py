"""How good a policy is, on trials that it is not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import gymnasium
import numpy as np
from variants import VALIDATION_SEED

import omnitrack_sim as ot
from omnitrack_sim.control.policy.feature import Entries


class Score(NamedTuple):
    """Means over the validation trials.

    Attributes:
        value: return. success: part of the trials. duration: s of an episode.
    """

    value: float
    success: float
    duration: float


class Validation:
    """The same trials for every policy.

    Attributes:
        seen: (m, k) entries of the last validation, of robots that drove.
    """

    def __init__(self, envs: Sequence[gymnasium.vector.VectorEnv]) -> None:
        self._envs = envs
        self.seen: Entries = np.zeros((0, envs[0].single_observation_space.shape[0]), np.float32)

    def score(self, policy: ot.Policy) -> Score:
        """Drive all trials to their ends; robots that are through drive on and do not count."""
        found, seen = [], []
        for i, envs in enumerate(self._envs):
            found.append(_driven(envs, policy, VALIDATION_SEED + i * envs.num_envs, seen))
        self.seen = np.concatenate(seen)
        return Score(*(float(np.concatenate(each).mean()) for each in zip(*found, strict=True)))


def _driven(
    envs: gymnasium.vector.VectorEnv, policy: ot.Policy, seed: int, seen: list[Entries]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, success and duration (n,) of the episodes of some seeds."""
    n, period = envs.num_envs, 1 / envs.metadata["render_fps"]
    entries, _ = envs.reset(seed=seed)
    returns, durations = np.zeros(n), np.zeros(n)
    passed, active = np.zeros(n, bool), np.ones(n, bool)
    while active.any():
        seen.append(entries[active])
        entries, reward, terminated, truncated, told = envs.step(policy(entries))
        returns += np.where(active, reward, 0.0)
        durations += active * period
        over = (terminated | truncated) & active
        if over.any():
            passed |= over & told["is_success"]
        active &= ~over
    return returns, passed, durations
