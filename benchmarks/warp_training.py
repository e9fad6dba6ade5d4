"""Train a policy for the tee turn on a GPU, and judge it on the processor.

    python benchmarks/warp_training.py [--quick] [--minutes 3] [--worlds 4096] [--limit T] --out DIR

Robots with the motor that the paper names, by its own line up to stall or, with --limit, up to
T N m, drive on the device, and learn by PPO in NumPy (`learning/ppo.py`). DIR gets `policy.npz`,
`curves.csv` and `curves.png`.

Then the policy drives random tee turns on the processor, with the same motor, beside the default
controller and the policy `tee_turn` that comes with the package; printed is a table: turns that
pass with their interval, mean time and energy of these.

With --quick two robots learn from a few decisions, for a processor without a GPU.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from learning import curves
from learning.ppo import Ppo, Rollout, Scale, Settings
from shape import Arguments, Trials, compare, mean_of
from tee_turns import AGAIN, BY_PRELOAD, PRELOAD_RANGES, PUBLISHED, mean_time, random_tee_turns

import omnitrack_sim as ot
import omnitrack_sim.warp as exact
from omnitrack_sim.robots.feature import DECISION_PERIOD

OBSERVATION = "preview"
"""What robots without sensors for forces and slip know."""
TIME_LIMIT = 30.0
"""Of an episode, s."""
RANGES = {
    "world.friction": (0.6, 1.0),
    "robot.preload": (15.0, 35.0),
    # One period of the robot's threefold symmetry.
    "start.theta5_deg": (-60.0, 60.0),
}
REWARD = {"torque_change": -0.004, "failure": -1.0}
"""Weights in the place of the environment's own, by which standing still costs less than trying."""
AHEAD = (0.5, 0.5, 0.5, 0.0)
"""Actions at first."""
ROLLOUT, FEW_DECISIONS = 32, 4
"""Decisions of each robot between two updates."""
STARTS = 4096
SEED = 7
"""Of the turns that a policy is judged by."""


def motor(limit: float | None) -> dict[str, Any]:
    """Return the change of a scenario for the published motor, up to stall or a limit, N m."""
    return {"robot.motor": {"like": PUBLISHED, "torque_limit": limit} if limit else PUBLISHED}


def environment(worlds: int, limit: float | None) -> Any:
    """Return environments of tee turns on the device."""
    return exact.WarpVectorEnv(
        "tee_turn",
        num_envs=worlds,
        autoreset_mode="SameStep",
        starts=min(worlds, STARTS),
        threads=0,
        observation=OBSERVATION,
        changes={"run.time_limit": TIME_LIMIT} | motor(limit),
        ranges=RANGES,
        reward=REWARD,
    )


class Training:
    """Robots that learn.

    Args:
        env: environments in the mode ``SameStep``.
        decisions: of each robot between two updates.
        seed: of the learner and of the episodes.
        settings: of the learner.

    Attributes:
        ppo: the learner.
        rows: of the table of the training.
    """

    def __init__(self, env: Any, decisions: int, seed: int, settings: Settings) -> None:
        self.env, n = env, env.num_envs
        entries = env.single_observation_space.shape[0]
        actions = env.single_action_space.shape[0]
        self.ppo = Ppo(entries, actions, n, AHEAD, settings, seed)
        self.rows: list[dict[str, Any]] = []
        self._rollout = Rollout(decisions, n, entries, actions)
        self._observed = _array(env.reset(seed=seed)[0])
        self.ppo.scale.add(self._observed)
        self._worth, self._returns = Scale(1), np.zeros(n)
        self._sum, self._length = np.zeros(n), np.zeros(n, int)

    def run(self, seconds: float) -> None:
        """Learn for a time, one update at least."""
        begin = time.perf_counter()
        spent, taken = 0.0, 0
        while not self.rows or spent < seconds:
            ended = self._drive()
            taken += self._rollout.value.size
            part = spent / seconds if seconds else 1.0
            change = self.ppo.learn(self._rollout, self.ppo.scale(self._observed), part)
            spent = time.perf_counter() - begin
            self.rows.append(self._row(spent, taken, change, ended))
            print(", ".join(f"{key} {value}" for key, value in self.rows[-1].items()), flush=True)

    def _row(
        self, spent: float, taken: int, change: float, ended: list[tuple[float, int, bool]]
    ) -> dict[str, Any]:
        row: dict[str, Any] = {
            "minutes": round(spent / 60, 2),
            "decisions": taken,
            "episodes": len(ended),
            "std": round(float(np.exp(self.ppo.log_std).mean()), 4),
            "kl": round(change, 4),
        }
        if ended:
            returns, lengths, passed = np.array(ended, float).T
            row["return_mean"] = round(float(returns.mean()), 3)
            row["success"] = round(float(passed.mean()), 3)
            row["duration_s"] = round(float(lengths.mean()) * DECISION_PERIOD, 2)
        return row

    def _drive(self) -> list[tuple[float, int, bool]]:
        """Fill a rollout; returns the return, the decisions and the success of ended episodes."""
        ppo, rollout, told = self.ppo, self._rollout, []
        for t in range(len(rollout.value)):
            seen = rollout.seen[t] = ppo.scale(self._observed)
            rollout.value[t] = ppo.value(seen)
            rollout.action[t], rollout.log_probability[t] = ppo.act(seen)
            observed, reward, terminated, truncated, infos = self.env.step(rollout.action[t])
            self._observed, reward = _array(observed), _array(reward)
            late, ended = _array(truncated), _array(terminated) | _array(truncated)
            self._returns = reward + ppo.settings.discount * self._returns
            self._worth.add(self._returns[:, None])
            rollout.reward[t], rollout.ended[t] = reward / self._worth.std[0], ended
            if late.any():
                last = ppo.scale(_array(infos["final_obs"]))
                rollout.value_after[t] = np.where(late, ppo.value(last), 0.0)
            else:
                rollout.value_after[t] = 0.0
            self._sum += reward
            self._length += 1
            if ended.any():
                passed = self._passed(infos)
                told += [
                    (float(self._sum[i]), int(self._length[i]), bool(passed[i]))
                    for i in np.flatnonzero(ended).tolist()
                ]
            for values in (self._returns, self._sum, self._length):
                values[ended] = 0
            ppo.scale.add(self._observed)
        return told

    def _passed(self, infos: Mapping[str, Any]) -> Any:
        """Return the robots (n,) that have come to their goals."""
        return _array(infos["outcome"]) == self.env.outcomes.index("reached_goal")


def _array(values: Any) -> Any:
    """Return an array of the device as one of NumPy, which the next step leaves alone."""
    return values.numpy().copy()


def judged(policy: Path, trials: int, limit: float | None, workers: int) -> Mapping[str, Any]:
    """Return the rows of random turns on the processor, by what drives them."""
    kinds = {
        "default controller": AGAIN,
        "policy `tee_turn`": _by_policy("tee_turn"),
        "trained on the device": _by_policy(str(policy.resolve())),
    }
    turns = {
        name: [
            turn
            for number, preload in enumerate(PRELOAD_RANGES)
            for turn in random_tee_turns(
                trials,
                seed=SEED + number,
                friction=(0.6, 1.0),
                preload=preload,
                theta5_deg=180.0,
                changes=motor(limit) | changes,
            )
        ]
        for name, changes in kinds.items()
    }
    return Trials("warp_training", turns, {"preload": lambda one: one.robot.preload}).run(workers)


def _by_policy(name: str) -> dict[str, Any]:
    return {"control.kind": "policy", "control.parameters": {"policy": name}}


def main() -> None:
    """Train, and judge."""
    arguments = Arguments(__doc__, trials=150, quick=1, workers=True)
    arguments.add_argument("--minutes", type=float, default=3.0, help="of training")
    arguments.add_argument("--worlds", type=int, default=4096)
    arguments.add_argument("--limit", type=float, help="of the motor's torque, N m")
    arguments.add_argument("--seed", type=int, default=1)
    arguments.add_argument("--out", type=Path, required=True, help="folder of the results")
    given = arguments.read()
    given.out.mkdir(parents=True, exist_ok=True)
    worlds, decisions = (2, FEW_DECISIONS) if given.quick else (given.worlds, ROLLOUT)
    training = Training(environment(worlds, given.limit), decisions, given.seed, Settings())
    training.run(0.0 if given.quick else 60 * given.minutes)
    words = f"{worlds} worlds on the device, motor {PUBLISHED}"
    words += f" up to {given.limit:g} N m" if given.limit else ""
    curves.write(given.out, training.rows, words)
    note = f"PPO in NumPy, {words}, {training.rows[-1]['decisions']} decisions, seed {given.seed}"
    path = given.out / "policy.npz"
    ot.Policy(training.ppo.network(), [OBSERVATION], note=note).save(path)
    rows = judged(path, given.trials, given.limit, given.workers)
    columns = BY_PRELOAD | {
        "time, s": mean_time,
        "energy, J": lambda own: mean_of(own, "energy_j"),
    }
    compare("turns", rows, columns, "driven by")


if __name__ == "__main__":
    main()
