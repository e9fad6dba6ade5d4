"""Train a policy for the tee turn by PPO.

python benchmarks/learning/train.py tee_turn [--residual] [--minutes M] [--seed N] --out DIR

64 robots of the native vector environment, in exact walls, drive on two cores. Without --residual
the policy learns belts and roll from scratch, with it what is added to the feedback controller. The
same command goes on with a training that was killed, from its last checkpoint, which is at most a
minute old.

The minutes are of processor time, of the longer of the two batches and of the learning, so that
other work on the machine makes a training no worse.

DIR gets `policy.npz`, the policy that was best in validation so far, with a note of its training;
`curves.csv` and `curves.png`; and `checkpoint.pt`. How fast the steps shorten follows that time, so
two trainings from one seed are alike and not the same to the bit.
"""

from __future__ import annotations

import argparse
import datetime
import shlex
import sys
import time
from pathlib import Path
from typing import Any

import checkpoint
import curves
import numpy as np
import torch
from adapter import Robots
from export import NEARNESS, difference, policy_of
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize
from validation import Score, Validation
from variants import OBSERVATION, VALIDATION_SEED, VARIANTS, Variant

import omnitrack_sim as ot

ROLLOUT = 256
"""Decisions of each robot between two updates: 12.8 s, a whole turn. From a quarter of that, some
twenty episodes, the residual policy does not learn: what failed by chance outweighs the rest."""
LEARNING_RATE, LAST_PART = 3e-4, 0.1
"""At first, and the part of it at the end of the time."""
SETTINGS: dict[str, Any] = {
    "n_steps": ROLLOUT,
    "batch_size": 2048,
    "n_epochs": 8,
    "gamma": 0.995,  # a decision counts for 10 s, as long as a turn takes
    "gae_lambda": 0.95,
    "target_kl": 0.02,
    # Noise that is new in each decision shakes the robot on the spot: what is tried is a change of
    # the network's last weights, for so many decisions.
    "use_sde": True,
    "sde_sample_freq": 16,
}
LAYERS = [64, 64]
MIN_VARIANCE = 1e-4
"""Added to the variance of entries, so that those that never vary in training are not blown up."""
CHECKPOINT_EVERY, VALIDATE_EVERY = 60.0, 300.0
"""Seconds of processor time."""


class Training:
    """One training, from its beginning or its last checkpoint."""

    def __init__(self, variant: Variant, given: argparse.Namespace) -> None:
        self.variant, self.given, self.out = variant, given, Path(given.out)
        self.out.mkdir(parents=True, exist_ok=True)
        self.robots = Robots(variant.batches())
        self.normalise = VecNormalize(self.robots, gamma=SETTINGS["gamma"], epsilon=MIN_VARIANCE)
        self.spent, self.saved, self.validated = 0.0, 0.0, 0.0
        self.best, self.rows = -np.inf, []
        self.model = PPO(
            "MlpPolicy",
            self.normalise,
            learning_rate=lambda _: LEARNING_RATE * max(LAST_PART, 1 - self.part),
            policy_kwargs={"net_arch": LAYERS, "log_std_init": variant.log_std},
            seed=given.seed,
            device="cpu",
            **SETTINGS,
        )
        with torch.no_grad():
            self.model.policy.action_net.bias[:3] = variant.ahead
        self.checkpoint = self.out / "checkpoint.pt"
        if self.checkpoint.is_file():
            self._resume()
        # Other trials after each beginning; below those of the validation.
        self.robots.seed((given.seed * 7919 + self.model.num_timesteps) % (VALIDATION_SEED // 2))
        self.validation = Validation(variant.batches(validation=True))

    @property
    def part(self) -> float:
        """Of the time, that is over."""
        return self.spent / (60 * self.given.minutes)

    def _resume(self) -> None:
        progress = checkpoint.load(self.checkpoint, self.model, self.normalise)
        if (progress["seed"], progress["id"], progress["acting"]) != self._identity():
            sys.exit(f"{self.checkpoint} is of another training; give another --out")
        self.spent = self.saved = progress["spent"]
        self.validated, self.best = progress["validated"], progress["best"]
        self.rows = progress["rows"]
        print(f"goes on after {self.spent / 60:.1f} minutes, {self.model.num_timesteps} decisions")

    def _identity(self) -> tuple[int, str, str]:
        return self.given.seed, self.variant.id, self.variant.acting

    def run(self) -> None:
        """Train until the time is over."""
        while self.part < 1:
            begin = self._clock()
            self.model.learn(ROLLOUT * self.robots.num_envs, reset_num_timesteps=False)
            self.spent += self._clock() - begin
            row = self._row()
            due = self.spent - self.validated >= VALIDATE_EVERY or self.part >= 1
            if due:
                row |= self._validate()
                self.spent += self.validation.spent
                self.validated = self.spent
            self.rows.append(row)
            if due or self.spent - self.saved >= CHECKPOINT_EVERY:
                self._save()
            self._tell(row)

    def _clock(self) -> float:
        """Processor time of learning and driving, s."""
        return time.process_time() + self.robots.spent

    def _row(self) -> dict[str, Any]:
        ended, self.robots.ended = self.robots.ended, []
        logged = self.model.logger.name_to_value
        row: dict[str, Any] = {
            "minutes": round(self.spent / 60, 2),
            "decisions": self.model.num_timesteps,
            "episodes": len(ended),
            "std": round(float(self.model.policy.log_std.detach().exp().mean()), 4),
            "kl": round(float(logged["train/approx_kl"]), 4),
        }
        if ended:
            returns, lengths, passed = np.array(ended, float).T
            row["return_mean"] = round(float(returns.mean()), 3)
            row["success"] = round(float(passed.mean()), 3)
            row["duration_s"] = round(float(lengths.mean()) / 20, 2)
        return row

    def _validate(self) -> dict[str, float]:
        """Score the policy as it is, and keep it where it is the best so far."""
        policy = self._policy()
        score = self.validation.score(policy)
        if score.value > self.best:
            self.best = float(score.value)
            self._policy(score).save(self.out / "policy.npz")
        return {
            "validation_return": round(float(score.value), 3),
            "validation_success": round(float(score.success), 4),
            "validation_duration_s": round(float(score.duration), 2),
        }

    def _policy(self, score: Score | None = None) -> ot.Policy:
        note = f"{self.variant.words}; PPO of stable-baselines3, {self.spent / 60:.0f} minutes"
        if score is not None:
            note += (
                f"; passed {score.success:.1%} of the validation trials, return {score.value:.2f}"
            )
        command = shlex.join(["python", "benchmarks/learning/train.py", *sys.argv[1:]])
        today = datetime.datetime.now(datetime.UTC).date().isoformat()
        note += f"; {command}, seed {self.given.seed}, {self.model.num_timesteps} decisions"
        note += f", {today}, omnitrack_sim {ot.__version__}"
        return policy_of(self.model, self.normalise, OBSERVATION, self.variant.acting, note)

    def _save(self) -> None:
        seed, id, acting = self._identity()
        progress = {"seed": seed, "id": id, "acting": acting, "spent": self.spent}
        progress |= {"validated": self.validated, "best": float(self.best), "rows": self.rows}
        checkpoint.save(self.checkpoint, self.model, self.normalise, progress)
        curves.write(self.out, self.rows, self.variant.words)
        self.saved = self.spent

    @staticmethod
    def _tell(row: dict[str, Any]) -> None:
        print(", ".join(f"{name} {value}" for name, value in row.items()), flush=True)

    def check(self) -> None:
        """Print how near the policy in NumPy is to the trainer's network; end if it is not."""
        policy = self._policy()
        self.validation.score(policy)
        entries = self.validation.seen
        off = difference(policy, self.model, self.normalise, entries)
        print(f"actions of policy and trainer differ by {off:.1e} in {len(entries)} decisions")
        if off > NEARNESS:
            sys.exit(f"that is more than {NEARNESS:g}")


def arguments() -> argparse.ArgumentParser:
    """What the command takes."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("task", choices=sorted({task for task, _ in VARIANTS}))
    parser.add_argument("--residual", action="store_true", help="on the feedback controller")
    parser.add_argument("--minutes", type=float, default=45.0, help="of processor time, in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", required=True, help="folder of the results")
    return parser


def main() -> None:
    """Train."""
    given = arguments().parse_args()
    torch.set_num_threads(1)  # the network is small; a second thread would only wait
    training = Training(VARIANTS[given.task, given.residual], given)
    training.run()
    training.check()
    print(f"best validation return {training.best:.3f}: {training.out / 'policy.npz'}")


if __name__ == "__main__":
    main()
