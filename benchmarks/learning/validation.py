"""How good a policy is, on trials that it is not trained on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from batches import Batch
from variants import VALIDATION_SEED

import omnitrack_sim as ot
from omnitrack_sim.robots.feature import FloatRows


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

    Args:
        batches: in the mode "NextStep".

    Attributes:
        seen: (m, k) entries of the last validation, of robots that drove.
        spent: processor time of the batch that took longest in the last validation, s.
    """

    def __init__(self, batches: Sequence[Batch]) -> None:
        self._batches, self.spent = batches, 0.0
        self.seen: FloatRows = np.zeros((0, batches[0].observation_space.shape[0]), np.float32)

    def score(self, policy: ot.Policy) -> Score:
        """Drive all trials to their ends."""
        seed = VALIDATION_SEED
        for batch in self._batches:
            batch.ask("drive", policy, seed)
            seed += batch.num_envs
        *found, seen = zip(*[batch.answer() for batch in self._batches], strict=True)
        self.spent = max(batch.spent for batch in self._batches)
        self.seen = np.concatenate(seen)
        return Score(*(float(np.concatenate(each).mean()) for each in found))
