"""Largest contact forces of random runs: no sample may be absurd where a robot passes.

python benchmarks/contact_forces.py [--trials N] [--networks N] [--workers N] [--seed S]

Turns, merges, elbows (90 mm and 240 mm radius in turn) and wyes (every way through 45, 60 and 75
degrees in turn): any start orientation, any direction of gravity, friction 0.5 to 1.0, preload 15
to 35 N a module, by the default controller with its retries. Random networks of 6 to 12 fittings:
friction 0.6 to 1.0, the default preload. Forces are the normal forces of a module in all samples,
in preloads of the run; an arm's travel beyond its stop is that of the worst sample.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from missions import random_mission
from shape import Arguments, random_gravity, run_tasks, table
from wye import WAYS, Cell
from wye import trial as wye_trial

from omnitrack_sim import Scenario, load_scenario, override, run_batch
from omnitrack_sim.record.statistics import rate_text
from omnitrack_sim.robots.omnitrack.parameters import MAX_PRELOADS

SIMILAR = 24
"""Runs of a batch."""
WYES = [Cell(way, angle) for angle, way in product((45.0, 60.0, 75.0), WAYS) if way != "across"]
SHIPPED = {
    "turn": ("tee_turn",),
    "merge": ("tee_merge",),
    "elbow": ("elbow", "elbow_short"),
}
KINDS = (*SHIPPED, "wye", "network")


class Extremes(NamedTuple):
    """Extremes of one run.

    Attributes:
        passed: it reached its goal.
        preloads: largest force, in preloads of the run.
        force: the same, N.
        beyond: largest travel of an arm beyond its stops, mm.
    """

    passed: bool
    preloads: float
    force: float
    beyond: float


def scenario(kind: str, number: int, seed: int) -> Scenario:
    """Run ``number`` of a kind; its draw depends on nothing else than the seed."""
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    if kind == "network":
        return random_mission(10_000 * seed + number, friction_range=(0.6, 1.0))
    gravity = random_gravity(rng)
    draw = {
        "start.theta5_deg": float(rng.uniform(-180, 180)),
        "world.friction": float(rng.uniform(0.5, 1.0)),
        "robot.preload": float(rng.uniform(15, 35)),
        "world.gravity": gravity,
    }
    if kind == "wye":
        return wye_trial(WYES[number % len(WYES)], number, draw)
    names = SHIPPED[kind]
    return override(load_scenario(names[number % len(names)]), draw)


def extremes(task: tuple[str, range, int]) -> list[Extremes]:
    """Run some numbers of a kind."""
    kind, numbers, seed = task
    runs = []
    for result in run_batch([scenario(kind, i, seed) for i in numbers], threads=1, no_load=False):
        robot, trajectory = result.scenario.robot, result.trajectory
        low, high = robot.slide_range
        slide, force = trajectory["slide"], float(trajectory["normal_force"].max())
        beyond = 1e3 * max(0.0, float((slide - high).max()), float((low - slide).max()))
        runs.append(Extremes(result.success, force / robot.preload, force, beyond))
    return runs


def tasks(trials: int, networks: int, seed: int) -> Iterator[tuple[str, range, int]]:
    """Batches of similar runs; a network is a batch of its own, as no two share their walls."""
    for kind in KINDS:
        count, size = (networks, 1) if kind == "network" else (trials, SIMILAR)
        for first in range(0, count, size):
            yield kind, range(first, min(count, first + size)), seed


def row(kind: str, runs: Sequence[Extremes]) -> list[str]:
    """Return a row of the table."""
    passed = [run for run in runs if run.passed]
    over = [sum(run.preloads > MAX_PRELOADS for run in group) for group in (passed, runs)]
    return [
        kind,
        rate_text(len(passed), len(runs)),
        f"{max((run.preloads for run in passed), default=0.0):.1f}",
        f"{max(run.preloads for run in runs):.1f}, {max(run.force for run in runs):.0f} N",
        f"{over[0]}, {over[1] - over[0]}",
        f"{max(run.beyond for run in runs):.1f}",
    ]


HEADS = (
    "runs",
    "passed, 95 %",
    "largest force of those, preloads",
    "of all, preloads and N",
    "over 20 preloads: passed, not",
    "arm beyond its stop, mm",
)


def main() -> None:
    """Run all kinds and print the table."""
    arguments = Arguments(__doc__, trials=500, seed=61, workers=True)
    arguments.add_argument("--networks", type=int, default=200, help="random networks")
    given = arguments.read()
    work = list(tasks(given.trials, given.networks, given.seed))
    runs: dict[str, list[Extremes]] = {}
    for (kind, *_), batch in zip(work, run_tasks(extremes, work, given.workers), strict=True):
        runs.setdefault(kind, []).extend(batch)
    table("forces", HEADS, (row(*one) for one in runs.items()))


if __name__ == "__main__":
    main()
