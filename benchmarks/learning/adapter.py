"""Native vector environments as stable-baselines3 wants them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from batches import Batch
from stable_baselines3.common.vec_env import VecEnv


class Robots(VecEnv):
    """Robots of one batch, or of several that work at the same time.

    Args:
        batches: of one kind of environment, in the mode "SameStep".

    Attributes:
        ended: return, decisions and success of every episode that has ended, in this order, until
            somebody empties it.
        spent: processor time, s, of all decisions so far, each that of the batch that took longest.
    """

    def __init__(self, batches: Sequence[Batch]) -> None:
        self.batches, first = batches, batches[0]
        count = sum(batch.num_envs for batch in batches)
        super().__init__(count, first.observation_space, first.action_space)
        self.ended: list[tuple[float, int, bool]] = []
        self.spent = 0.0
        self._returns, self._lengths = np.zeros(count), np.zeros(count, int)

    def reset(self) -> np.ndarray:
        """Begin an episode of every robot."""
        for first, batch in self._numbered():
            batch.ask("reset", self._seeds[first])
        self._reset_seeds()
        self._returns[:], self._lengths[:] = 0.0, 0
        return np.concatenate([batch.answer() for batch in self.batches])

    def _numbered(self) -> Iterator[tuple[int, Batch]]:
        """Each batch, and the number of its first robot."""
        first = 0
        for batch in self.batches:
            yield first, batch
            first += batch.num_envs

    def step_async(self, actions: np.ndarray) -> None:
        """Let all batches begin with the actions of one decision."""
        for first, batch in self._numbered():
            batch.ask("step", actions[first : first + batch.num_envs])

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """What came of the decision."""
        infos: list[dict[str, Any]] = []
        parts = [self._stepped(batch, first, infos) for first, batch in self._numbered()]
        self.spent += max(batch.spent for batch in self.batches)
        observations, rewards, over = (np.concatenate(each) for each in zip(*parts, strict=True))
        self._returns[over], self._lengths[over] = 0.0, 0
        return observations, rewards.astype(np.float32), over, infos

    def _stepped(
        self, batch: Batch, first: int, infos: list[dict[str, Any]]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What came of the actions of one batch, whose robots are counted from ``first``."""
        observations, rewards, terminated, truncated, told = batch.answer()
        over = terminated | truncated
        own = slice(first, first + batch.num_envs)
        self._returns[own] += rewards
        self._lengths[own] += 1
        infos += [{} for _ in range(batch.num_envs)]
        for i in np.flatnonzero(over).tolist():
            robot, success = first + i, bool(told["final_info"]["is_success"][i])
            infos[robot] = {
                "terminal_observation": told["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i]),
            }
            self.ended.append((float(self._returns[robot]), int(self._lengths[robot]), success))
        return observations, rewards, over

    def close(self) -> None:
        """End the processes."""
        for batch in self.batches:
            batch.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Nothing draws these robots; they have no other attribute."""
        if attr_name != "render_mode":
            raise AttributeError(attr_name)
        return [None] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Robots of a batch have no attributes of their own."""
        raise NotImplementedError(attr_name)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Robots of a batch have no methods of their own."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002 - SB3's
        """No robot is wrapped by itself."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
