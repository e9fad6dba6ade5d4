"""Random tee turns on slippery walls and with weak springs: what the laws for them are worth.

python benchmarks/slippery_turns.py [--trials N] [--weak N] [--seed S]

Slippery: friction 0.5 to 0.8, preload 20 to 35 N, any gravity, theta5 within 11 degrees of the
best. Weak: friction 0.6 to 0.8, preload 15 to 20 N, any gravity and theta5. The trials are the same
in each row.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

import numpy as np
from tee_turns import random_tee_turns

from omnitrack_sim import Result, run_batch
from omnitrack_sim.record.events import BackedOff
from omnitrack_sim.record.statistics import rate_text

AGAIN = {"control.align": True, "control.retry": True}
VARIANTS: dict[str, dict[str, Any]] = {
    "one attempt": {},
    "one attempt, no sway": {"control.parameters.sway.lean_deg": 0.0},
    "rolled first": {"control.align": True},
    "rolled first, with retries": AGAIN,
    "the same, no sway": AGAIN | {"control.parameters.sway.lean_deg": 0.0},
}
WEAK: dict[str, dict[str, Any]] = {
    "tracks rolled to the wall": AGAIN,
    "tracks left as they are": AGAIN | {"control.parameters.recovery.square": False},
}
"""Ways to back off."""
FIGURES = {
    "torque change, N m/s": "torque_change_nm_s",
    "energy, J": "energy_j",
    "largest tilt, deg": "tilt_max_deg",
}
"""Metrics of the runs that passed, means of modules and trials."""
SEED = 202


def rate(results: list[Result]) -> str:
    """How many passed, and their interval."""
    return rate_text(sum(result.success for result in results), len(results))


def row(name: str, results: list[Result]) -> str:
    """How many passed, and the figures of those."""
    passed = [result for result in results if result.success]
    means = [
        f"{np.mean([np.mean(result.metrics[metric]) for result in passed]):.3g}"
        for metric in FIGURES.values()
    ]
    return f"| {' | '.join([name, rate(results), *means])} |"


def weak_row(name: str, results: list[Result]) -> str:
    """How many passed, and how many of those that backed off."""
    backed = [r for r in results if any(isinstance(e, BackedOff) for e in r.events)]
    return f"| {name} | {rate(results)} | {rate(backed)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--weak", type=int, default=400, help="trials with weak springs")
    parser.add_argument("--seed", type=int, default=SEED)
    given = parser.parse_args()
    print("## rates\n")
    heads = ["variant", "passed", *FIGURES]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    slippery = partial(
        random_tee_turns, given.trials, seed=given.seed, friction=(0.5, 0.8), preload=(20.0, 35.0)
    )
    for name, changes in VARIANTS.items():
        print(row(name, run_batch(slippery(changes=changes), no_load=False)), flush=True)
    print("\n## weak\n\n| before backing off | passed | of those that backed off |\n|---|---|---|")
    weak = partial(
        random_tee_turns,
        given.weak,
        seed=given.seed + 1,
        friction=(0.6, 0.8),
        preload=(15.0, 20.0),
        theta5_deg=60.0,
    )
    for name, changes in WEAK.items():
        print(weak_row(name, run_batch(weak(changes=changes), no_load=False)), flush=True)


if __name__ == "__main__":
    main()
