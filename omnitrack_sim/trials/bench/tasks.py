"""The tasks of the benchmark, and the held-out trials of each.

Their seeds are for nothing else: neither the controllers nor the shipped studies have seen them,
and whoever trains a policy keeps away from them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.scenario import Scenario, load_scenario, validate
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep.axes import Axis, DirectionAxis, UniformAxis
from omnitrack_sim.walls.collider import why_not

SEED = 71_000
"""Of the first task; the others count on from it."""
FIRST_NETWORK = 71_000_000
"""Seed of the first random network."""
DRY, SLIPPERY = (0.7, 1.0), (0.5, 0.7)
BATCH = 16
"""Trials that run together."""
Changes = Mapping[str, Any]


@dataclass(frozen=True)
class Task:
    """One job.

    Attributes:
        name: of its rows. words: what the robot does.
        trials: of the whole benchmark. quick: with ``--quick``.
        sweep: makes the trials of an entry, from their number and the entry's changes.
    """

    name: str
    words: str
    trials: int
    quick: int
    sweep: Callable[[int, Changes], Sweep]


def _collider() -> Changes:
    return {"physics.collider": "exact" if why_not() is None else "primitives"}


def _axes(friction: tuple[float, float]) -> tuple[Axis, ...]:
    return (
        UniformAxis(path="start.theta5_deg", kind="uniform", low=-60, high=60),
        UniformAxis(path="contact.friction", kind="uniform", low=friction[0], high=friction[1]),
        UniformAxis(path="robot.preload", kind="uniform", low=20, high=35),
        DirectionAxis(path="world.gravity", kind="direction"),
    )


def _drawn(
    base: str, seed: int, friction: tuple[float, float], trials: int, changes: Changes
) -> Sweep:
    """Random trials of a shipped scenario."""
    scenario = load_scenario(base, {**_collider(), **changes})
    return Sweep(
        name=base,
        seed=seed,
        samples=trials,
        sampling="latin_hypercube",
        batch=BATCH,
        axes=_axes(friction),
        bases={base: scenario},
        set=dict(changes),
    )


def _networks(trials: int, changes: Changes) -> Sweep:
    """One mission through a random network a trial, each a base of its own."""
    bases = {f"network_{i}": _mission(FIRST_NETWORK + i, changes) for i in range(trials)}
    return Sweep(name="network", batch=BATCH, bases=bases, set=dict(changes))


def _mission(seed: int, changes: Changes) -> Scenario:
    """A mission between two ends of a random network with 6 to 12 fittings, all from ``seed``."""
    draw = np.random.default_rng([seed, 1])
    network = random_network(seed)
    start, goal = draw.choice(network.open_ends, 2, replace=False)
    gravity = draw.normal(size=3)
    data = {
        "name": f"network_{seed}",
        "network": network.model_dump(mode="json"),
        "mission": {"start": str(start), "goals": [str(goal)]},
        "start": {"theta5_deg": float(draw.uniform(-180, 180))},
        "contact": {"friction": float(draw.uniform(*DRY))},
        "world": {"gravity": (GRAVITY * gravity / np.linalg.norm(gravity)).tolist()},
    }
    return validate(data, changes={**_collider(), **changes})


TASKS: Mapping[str, Task] = {
    task.name: task
    for task in (
        Task(
            "turn",
            "up a run, out through the branch of a dry tee",
            200,
            8,
            partial(_drawn, "tee_turn", SEED, DRY),
        ),
        Task(
            "turn_slippery",
            "the same on slippery walls",
            200,
            8,
            partial(_drawn, "tee_turn", SEED + 1, SLIPPERY),
        ),
        Task(
            "merge",
            "out of the branch, up the run",
            200,
            8,
            partial(_drawn, "tee_merge", SEED + 2, DRY),
        ),
        Task("over", "straight over a tee", 200, 8, partial(_drawn, "tee_straight", SEED + 3, DRY)),
        Task(
            "elbow",
            "through an elbow of mean radius 90 mm",
            200,
            8,
            partial(_drawn, "elbow_short", SEED + 4, DRY),
        ),
        Task("network", "to a far end of a random network", 100, 4, _networks),
    )
}
"""All tasks by name."""
