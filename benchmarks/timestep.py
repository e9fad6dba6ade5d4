"""What the time step does to slip, energy and tilt of random dry tee turns.

python benchmarks/timestep.py [--trials N] [--seed S]

Each step runs the same turns (friction 0.8 to 1.0, preload 15 to 35 N, any gravity); compared are
those that pass at all steps, with the finest: the ratio of the means, and the median of the ratios.
"""

from __future__ import annotations

import argparse

import numpy as np
from tee_turns import random_tee_turns

from omnitrack_sim import Result, run_batch

STEPS = (0.00025, 0.001, 0.002, 0.0025, 0.005)
"""s; the finest first."""
FIGURES = {"slip": "slip_distance_m", "energy": "energy_j", "largest tilt": "tilt_max_deg"}


def values(results: list[Result], metric: str) -> np.ndarray:
    """A metric of each run, summed over the modules where it is theirs."""
    return np.array([np.sum(result.metrics[metric]) for result in results])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--trials", type=int, default=64)
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    runs = {}
    for step in STEPS:
        changes = {"physics.timestep": step, "physics.control_period": 0.01}
        runs[step] = run_batch(
            random_tee_turns(given.trials, seed=given.seed, changes=changes), no_load=False
        )
    whole = np.all([[result.success for result in results] for results in runs.values()], axis=0)
    print(f"## steps\n\n{whole.sum()} of {given.trials} turns pass at all steps; of these:\n")
    heads = [f"{name}: {what}" for name in FIGURES for what in ("means", "median of pairs")]
    print(f"| step, ms | passed | {' | '.join(heads)} |\n{'|---' * (2 + len(heads))}|")
    for step, results in runs.items():
        cells = [f"{1000 * step:g}", str(sum(result.success for result in results))]
        for metric in FIGURES.values():
            own, finest = values(results, metric)[whole], values(runs[STEPS[0]], metric)[whole]
            ratios = (own.sum() / finest.sum(), np.median(own / finest))
            cells += [f"{100 * (ratio - 1):+.1f} %" for ratio in ratios]
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
