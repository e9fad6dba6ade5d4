"""The runs that the claims are measured on: named lists of scenarios, run in batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from omnitrack_sim.base.text import counted
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import Omnitrack, as_omnitrack
from omnitrack_sim.robots.size import GRAVITY
from omnitrack_sim.scenario import Scenario, load_scenario, override
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.sim.simulation import Progress

Runs = Mapping[str, Sequence[Result]]
"""Results, by the names that ``scenarios`` gives to its lists."""
GRAVITIES = {
    "along, up the run": (0.0, 0.0, -9.81),
    "along, down the run": (0.0, 0.0, 9.81),
    "across, towards the branch": (9.81, 0.0, 0.0),
    "across, away from it": (-9.81, 0.0, 0.0),
    "across, sideways": (0.0, 9.81, 0.0),
    "none": (0.0, 0.0, 0.0),
}
"""Gravity of the random trials, m/s², in the frame of the tee: run along z, branch towards +x."""
PRELOAD_FACTORS = (0.8, 0.9, 0.95, 1.05, 1.1, 1.2)
"""Preloads of the climbing test, as multiples of the least one by the friction law."""
FRICTIONS = (0.2, 0.4, 0.8)
SEED = 7
SINGLE = (
    "holonomic_alignment",
    "climb_into_elbow",
    "tee_turn_misaligned",
    "tee_turn_as_written",
    "orient_climb_turn",
    "rolled_past_180",
    "no_motion_line",
)
"""Scenarios below ``paper/`` that are run as they are, once each."""
FEW_LUGS = {"robot.lugs_per_track": 5}
PRIMITIVES = {"physics.collider": "primitives"}
"""Walls of all claims. The paper simulates a track as a row of balls, and so do these walls; on
exact ones it is a smooth line."""
_UNAIDED: dict[str, Any] = {"control.align": False, "control.retry": False}
ELBOW_DRIVES: dict[str, dict[str, Any]] = {
    "jacobian": {"control.kind": "jacobian"},
    "paper": {"control.kind": "paper"},
    "equal": {"control.kind": "equal"},
    "differential": {"robot.drive": "differential"},
}
"""Changes of a scenario by drive: three motors by three controllers, or one motor."""


def scenarios(quick: bool) -> dict[str, list[Scenario]]:
    """Return all runs by name.

    Args:
        quick: fewer orientations and trials of the same physics.
    """
    lists = {name: [_of_primitives(f"paper/{name}")] for name in SINGLE}
    lists["vertical_climb"] = [_of_primitives("vertical_climb")]
    lists |= _elbows_and_tees(quick) | _straight_pipes(quick)
    # The published motor in the shipped scenarios.
    names = ("vertical_climb", "elbow", "elbow_short", "tee_turn", "tee_straight")
    pololu = {"robot.motor": "pololu_1000_hpcb"}
    lists["pololu"] = [override(_of_primitives(name), pololu) for name in names]
    return lists


def _of_primitives(name: str) -> Scenario:
    return load_scenario(name, PRIMITIVES)


def _elbows_and_tees(quick: bool) -> dict[str, list[Scenario]]:
    """Turns over the start orientation, random tee turns, and straight over a tee."""
    tee, trials = _of_primitives("tee_turn"), 24 if quick else 200
    # A third of a turn holds all orientations: the modules are alike.
    turn = np.arange(-60, 60, 10 if quick else 2)
    lists = {
        f"map_{kind}": _orientations(tee, turn, _UNAIDED | {"control.kind": kind})
        for kind in ("jacobian", "paper")
    }
    lists |= _elbows(np.arange(-60, 60, 30 if quick else 10))
    few_lugs = override(tee, FEW_LUGS)
    lists["aligned"] = random_tee_turns(tee, trials, (0.8, 1.0))
    lists["slippery"] = random_tee_turns(tee, trials, (0.6, 0.8))
    lists["few_lugs"] = random_tee_turns(few_lugs, trials, (0.8, 1.0))
    lists["few_lugs_slippery"] = random_tee_turns(few_lugs, trials, (0.6, 0.8))
    for state in ("aligned", "unaligned"):
        base = _of_primitives(f"paper/straight_over_tee_{state}")
        lists[f"straight_over_{state}"] = [
            override(base, {"world.gravity": list(g)}) for g in GRAVITIES.values()
        ]
    # The hardest case: the inner module slips, and the weight carries the robot past the branch.
    downward = {"world.gravity": [0.0, 0.0, 9.81], "world.friction": 0.65, "control.retry": False}
    lists["slippery_downward"] = [override(tee, downward)]
    return lists


def _elbows(theta5_deg: np.ndarray) -> dict[str, list[Scenario]]:
    """Both elbows with every controller and drive, from each of the start orientations."""
    lists = {
        f"elbow_{radius}_{kind}": _orientations(
            _of_primitives(name), theta5_deg, _UNAIDED | changes
        )
        for radius, name in (("240", "elbow"), ("90", "elbow_short"))
        for kind, changes in ELBOW_DRIVES.items()
    }
    half = Omnitrack().length / 2  # from the head to the centre, m
    # Eq. 20 begun with the robot's centre at the bend, to show why it fails with the head there.
    late = _UNAIDED | {"control.kind": "paper", "control.parameters.elbow_delay": half}
    lists["elbow_240_paper_late"] = _orientations(_of_primitives("elbow"), theta5_deg, late)
    return lists


def _straight_pipes(quick: bool) -> dict[str, list[Scenario]]:
    """Rolling on the spot, and climbing with more and less preload."""
    holonomic = _of_primitives("paper/holonomic_alignment")
    climb = _of_primitives("vertical_climb")
    angles = np.arange(-60, 60, 20 if quick else 5)
    return {
        "holonomic": _orientations(holonomic, angles, {}),
        "rolling_upright": [holonomic],
        "rolling_flat": [override(holonomic, {"world.gravity": [-9.81, 0.0, 0.0]})],
        "preload": [
            override(
                climb,
                {
                    "world.friction": friction,
                    "robot.preload": factor * min_preload(as_omnitrack(climb.robot), friction),
                    # Enough for a start-up and the second in which the climb is judged.
                    "run.time_limit": 3.0,
                },
            )
            for friction in FRICTIONS
            for factor in PRELOAD_FACTORS
        ],
    }


def run_all(lists: Mapping[str, Sequence[Scenario]], progress: Progress | None = None) -> Runs:
    """Run every list on all cores. Scenarios that share a model share a batch across all lists."""
    flat = [scenario for group in lists.values() for scenario in group]
    if progress is not None:
        progress(0.0, counted(len(flat), "run"))
    done = iter(run_batch(flat, threads=0, progress=progress))
    return {name: [next(done) for _ in group] for name, group in lists.items()}


def random_tee_turns(base: Scenario, count: int, friction: tuple[float, float]) -> list[Scenario]:
    """Tee turns like ``base``, with alignment, drawn at random.

    Start orientation and friction are uniform, gravity is one of ``GRAVITIES``.
    """
    # One generator for all trials, in this order of draws: other lists would be other trials.
    rng = np.random.default_rng(SEED)
    gravities = list(GRAVITIES.values())
    return [
        override(
            base,
            {
                "start.theta5_deg": float(rng.uniform(-60, 60)),
                "world.friction": float(rng.uniform(*friction)),
                "world.gravity": list(gravities[rng.integers(len(gravities))]),
            },
        )
        for _ in range(count)
    ]


def _orientations(
    base: Scenario, theta5_deg: np.ndarray, changes: Mapping[str, Any]
) -> list[Scenario]:
    return [override(base, {"start.theta5_deg": float(angle), **changes}) for angle in theta5_deg]


def min_preload(robot: Omnitrack, friction: float) -> float:
    """Least preload of a module, N, at which friction can hold the robot's weight: m g / (3 mu)."""
    return robot.mass * GRAVITY / (3 * friction)
