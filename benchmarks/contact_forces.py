"""Largest contact forces of random runs: no sample may be absurd where a robot passes.

python benchmarks/contact_forces.py [--trials N] [--networks N] [--workers N] [--seed S]

Drawn are turns, merges, elbows (90 mm and 240 mm radius in turn) and wyes (every way through 45, 60
and 75 degrees in turn): any start orientation, any direction of gravity, friction 0.5 to 1.0,
preload 15 to 35 N a module; and random networks of 6 to 12 fittings: friction 0.6 to 1.0, the
default preload. They are run by the default controller with its retries. Printed are the normal
forces of a module in all samples, in preloads of the run; an arm's travel beyond its stop is that
of the worst sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from missions import random_mission
from shape import Arguments, Row, Trials, random_gravity, rate, table
from wye import WAYS, Cell
from wye import trial as wye_trial

from omnitrack_sim import Result, Scenario, load_scenario, override
from omnitrack_sim.robots.omnitrack.parameters import MAX_PRELOADS

WYES = [Cell(way, angle) for angle, way in product((45.0, 60.0, 75.0), WAYS) if way != "across"]
SHIPPED = {
    "turn": ("tee_turn",),
    "merge": ("tee_merge",),
    "elbow": ("elbow", "elbow_short"),
}
KINDS = (*SHIPPED, "wye", "network")


def scenario(kind: str, number: int, seed: int) -> Scenario:
    """Draw run ``number`` of a kind; its draw depends on nothing else than the seed."""
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


def extremes(result: Result) -> dict[str, float]:
    """Return the largest force, N and in preloads, and an arm's travel beyond its stop, mm."""
    robot, trajectory = result.scenario.robot, result.trajectory
    low, high = robot.slide_range
    slide, force = trajectory["slide"], float(trajectory["normal_force"].max())
    beyond = 1e3 * max(0.0, float((slide - high).max()), float((low - slide).max()))
    return {"force": force, "preloads": force / robot.preload, "beyond": beyond}


def row(kind: str, runs: Sequence[Row]) -> list[str]:
    """Return a row of the table."""
    passed = [run for run in runs if run["success"]]
    over = [sum(run["preloads"] > MAX_PRELOADS for run in group) for group in (passed, runs)]
    largest = {name: max(run[name] for run in runs) for name in ("preloads", "force", "beyond")}
    return [
        kind,
        rate(runs),
        f"{max((run['preloads'] for run in passed), default=0.0):.1f}",
        f"{largest['preloads']:.1f}, {largest['force']:.0f} N",
        f"{over[0]}, {over[1] - over[0]}",
        f"{largest['beyond']:.1f}",
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
    counts = dict.fromkeys(KINDS, given.trials) | {"network": given.networks}
    drawn = {kind: [scenario(kind, i, given.seed) for i in range(n)] for kind, n in counts.items()}
    runs = Trials("contact_forces", drawn, measure=extremes).run(given.workers)
    table("forces", HEADS, (row(*one) for one in runs.items()))


if __name__ == "__main__":
    main()
