"""Native vector environments as stable-baselines3 wants them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import gymnasium
import numpy as np
from stable_baselines3.common.vec_env import VecEnv


class Robots(VecEnv):
    """Robots of one batch, or of several that follow each other.

    Args:
        envs: vector environments of one kind in the mode "SameStep".

    Attributes:
        ended: return, decisions and success of every episode that has ended, in this order, until
            somebody empties it.
    """

    def __init__(self, envs: Sequence[gymnasium.vector.VectorEnv]) -> None:
        self.envs, first = envs, envs[0]
        count = sum(env.num_envs for env in envs)
        super().__init__(count, first.single_observation_space, first.single_action_space)
        self.ended: list[tuple[float, int, bool]] = []
        self._returns, self._lengths = np.zeros(count), np.zeros(count, int)
        self._actions = np.zeros((count, *first.single_action_space.shape), np.float32)

    def reset(self) -> np.ndarray:
        """Begin an episode of every robot."""
        seen = [env.reset(seed=self._seeds[i])[0] for i, env in self._numbered()]
        self._reset_seeds()
        self._returns[:], self._lengths[:] = 0.0, 0
        return np.concatenate(seen)

    def _numbered(self) -> Iterator[tuple[int, gymnasium.vector.VectorEnv]]:
        """Each batch, and the number of its first robot."""
        first = 0
        for env in self.envs:
            yield first, env
            first += env.num_envs

    def step_async(self, actions: np.ndarray) -> None:
        """Remember what ``step_wait`` carries out."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Carry out the actions for one decision."""
        infos: list[dict[str, Any]] = []
        parts = [
            self._step(env, self._actions[i : i + env.num_envs], i, infos)
            for i, env in self._numbered()
        ]
        observations, rewards, over = (np.concatenate(each) for each in zip(*parts, strict=True))
        self._returns[over], self._lengths[over] = 0.0, 0
        return observations, rewards.astype(np.float32), over, infos

    def _step(
        self,
        env: gymnasium.vector.VectorEnv,
        actions: np.ndarray,
        first: int,
        infos: list[dict[str, Any]],
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Carry out actions of one batch, whose robots are counted from ``first``."""
        observations, rewards, terminated, truncated, told = env.step(actions)
        over = terminated | truncated
        own = slice(first, first + env.num_envs)
        self._returns[own] += rewards
        self._lengths[own] += 1
        infos += [{} for _ in range(env.num_envs)]
        for i in np.flatnonzero(over).tolist():
            robot, success = first + i, bool(told["final_info"]["is_success"][i])
            infos[robot] = {
                "terminal_observation": told["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i]),
            }
            self.ended.append((float(self._returns[robot]), int(self._lengths[robot]), success))
        return observations, rewards, over

    def close(self) -> None:
        """Nothing to close: no process, no window."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Of the first batch, the same for each robot."""
        return [getattr(self.envs[0], attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Robots of a batch have no attributes of their own."""
        raise NotImplementedError(attr_name)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Robots of a batch have no methods of their own."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No robot is wrapped by itself."""
        return [False] * len(self._chosen(indices))

    def _chosen(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
