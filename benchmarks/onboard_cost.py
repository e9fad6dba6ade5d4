"""What it costs that robots find their way by their own sensors.

python benchmarks/onboard_cost.py [--robots N] [--quick]

Tee turns from random orientations, exact walls, are begun as one batch on one thread: by robots
that are told the truth, by such with a depth camera, and by such with a headlight camera, 10
pictures a second. They are driven for as long as all robots are under way: after that, a single
robot that tries again pays for a batch of its own. The three are measured in turn, three times.
Printed are medians of the processor time for each simulated second of a robot, in milliseconds, and
of the ratio to the first in the same round, with the least and the greatest. All are begun once
before for a moment, so that compiled code is in memory.
"""

from __future__ import annotations

import time

import numpy as np
from autonomy import SENSES
from shape import Arguments, table

from omnitrack_sim import Scenario, load_scenario, override, run_batch

SPREAD, SEED = 60.0, 3
"""Orientations at the start, degrees to either side."""
MOMENT, SPAN = 0.2, 7.5
"""Simulated time, s, of what is begun before, by which pictures have arrived, and of what is
measured: the fastest robot is through the tee a tenth of a second later."""
ROUNDS = 3


def jobs(name: str, count: int, time_limit: float) -> list[Scenario]:
    """Return the turns of one way to sense, as far as they are driven."""
    base = override(load_scenario("tee_turn"), {**SENSES[name], "run.time_limit": time_limit})
    angles = np.random.default_rng(SEED).uniform(-SPREAD, SPREAD, count)
    return [override(base, {"start.theta5_deg": float(angle)}) for angle in angles]


def measured(turns: list[Scenario]) -> float:
    """Return the processor time of a simulated second of a robot, ms."""
    begin = time.process_time()
    results = run_batch(turns, threads=1)
    spent = time.process_time() - begin
    return 1e3 * spent / sum(result.duration_s for result in results)


def main() -> None:
    """Measure in turn and print the table."""
    given = Arguments(__doc__, trials=96, quick=16, of="robots").read()
    rounds = 1 if given.quick else ROUNDS
    for name in SENSES:
        run_batch(jobs(name, 1, MOMENT), threads=1)
    spent = np.array(
        [[measured(jobs(name, given.robots, SPAN)) for name in SENSES] for _ in range(rounds)]
    )
    shares = spent / spent[:, :1]
    rows = (
        (
            name,
            f"{np.median(times):.1f}",
            f"{np.median(share):.2f}",
            f"{share.min():.2f} to {share.max():.2f}",
        )
        for name, times, share in zip(SENSES, spent.T, shares.T, strict=True)
    )
    text = f"{given.robots} tee turns, processor time of a simulated second of a robot:"
    table("cost", ("sensing", "time, ms", "of truth", "least and greatest"), rows, text)


if __name__ == "__main__":
    main()
