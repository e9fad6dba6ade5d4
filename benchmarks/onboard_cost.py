"""What it costs that robots find their way by their own sensors.

python benchmarks/onboard_cost.py [--robots N] [--quick]

Tee turns from random orientations, exact walls, are done three times as one batch on one thread:
by robots that are told the truth, by such with a depth camera, and by such with a headlight camera,
10 pictures a second. Printed are milliseconds of processor time for each simulated second of a
robot, the ratio to the first, and how many passed. All three are begun once before for a moment, so
that compiled code is in memory.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from omnitrack_sim import Scenario, load_scenario, override, run_batch

SENSING = {
    "truth": {},
    "depth": {"sensing.kind": "onboard", "sensing.camera": "depth"},
    "headlight": {"sensing.kind": "onboard", "sensing.camera": "headlight"},
}
SPREAD, SEED = 60.0, 3
"""Orientations at the start, degrees to either side."""
MOMENT = 0.2
"""Simulated time of what is begun before, s: pictures have arrived by then."""


def jobs(name: str, count: int) -> list[Scenario]:
    """The turns of one way to sense."""
    base = override(load_scenario("tee_turn"), SENSING[name])
    angles = np.random.default_rng(SEED).uniform(-SPREAD, SPREAD, count)
    return [override(base, {"start.theta5_deg": float(angle)}) for angle in angles]


def measured(turns: list[Scenario]) -> tuple[float, int]:
    """Milliseconds of processor time a simulated second, and how many passed."""
    begin = time.process_time()
    results = run_batch(turns, threads=1)
    spent = time.process_time() - begin
    simulated = sum(result.duration_s for result in results)
    return 1e3 * spent / simulated, sum(result.success for result in results)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robots", type=int, default=96)
    parser.add_argument("--quick", action="store_true", help="16 robots")
    options = parser.parse_args()
    count = 16 if options.quick else options.robots
    for name in SENSING:
        run_batch([override(jobs(name, 1)[0], {"run.time_limit": MOMENT})], threads=1)
    print(f"## cost\n\n{count} tee turns, processor time of a simulated second of a robot:\n")
    print("| sensing | time, ms | of truth | passed |\n|---|---|---|---|")
    truth = 0.0
    for name in SENSING:
        spent, passed = measured(jobs(name, count))
        truth = truth or spent
        print(f"| {name} | {spent:.1f} | {spent / truth:.2f} | {passed} |", flush=True)


if __name__ == "__main__":
    main()
