"""Batches of robots, each in a process of its own."""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import gymnasium
import numpy as np

import omnitrack_sim as ot
import omnitrack_sim.gym
from omnitrack_sim.robots.feature import FloatRows


class Batch:
    """A native vector environment that another process drives.

    Several batches work at the same time where all are asked before the first one is answered.

    Args:
        id: of the environment. options: further keyword arguments of ``gymnasium.make_vec``.

    Attributes:
        num_envs: robots. observation_space, action_space: of one robot.
        spent: processor time that the last answer took, s.
    """

    def __init__(self, id: str, options: Mapping[str, Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, far = context.Pipe()
        self._process = context.Process(target=_serve, args=(far, id, dict(options)), daemon=True)
        self._process.start()
        far.close()
        self.spent = 0.0
        self.num_envs, self.observation_space, self.action_space = self.answer()

    def ask(self, task: str, *given: Any) -> None:
        """Let the process begin a task.

        Args:
            task: "reset" with a seed, "step" with actions, or "drive" with a policy and the seed of
                the first episode.
            given: what belongs to it.
        """
        self._pipe.send((task, given))

    def answer(self) -> Any:
        """What the environment returned, or an ``Episodes``.

        Raises:
            RuntimeError: the process has ended.
        """
        try:
            found, self.spent = self._pipe.recv()
        except (EOFError, ConnectionError) as error:
            raise RuntimeError("a process that drives robots has ended") from error
        return found

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.join()


class Episodes(NamedTuple):
    """One episode of each robot.

    Attributes:
        value: (n,) return. success: (n,). duration: (n,) s.
        seen: (m, k) entries of all decisions.
    """

    value: np.ndarray
    success: np.ndarray
    duration: np.ndarray
    seen: FloatRows


def _serve(pipe: Connection, id: str, options: dict[str, Any]) -> None:
    """Drive one batch until nobody asks any more."""
    envs = gymnasium.make_vec(id, **options)
    found: Any = (envs.num_envs, envs.single_observation_space, envs.single_action_space)
    begin = time.process_time()
    while True:
        try:
            pipe.send((found, time.process_time() - begin))
            task, given = pipe.recv()
        except (EOFError, ConnectionError):
            return
        begin = time.process_time()
        if task == "reset":
            found = envs.reset(seed=given[0])[0]
        elif task == "step":
            found = envs.step(given[0])
        else:
            found = _driven(envs, *given)


def _driven(envs: gymnasium.vector.VectorEnv, policy: ot.Policy, seed: int) -> Episodes:
    """Drive to the ends of the episodes of some seeds.

    Robots that are through drive on and do not count.
    """
    n, period = envs.num_envs, 1 / envs.metadata["render_fps"]
    entries, _ = envs.reset(seed=seed)
    seen: list[FloatRows] = []
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
    return Episodes(returns, passed, durations, np.concatenate(seen))
