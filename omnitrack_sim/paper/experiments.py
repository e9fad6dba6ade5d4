"""The runs that the claims are measured on: named lists of scenarios, run in batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.text import counted
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import Omnitrack, as_omnitrack
from omnitrack_sim.robots.omnitrack.control.open_loop import PaperController
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
FEW_LUGS = {"robot.lugs_per_track": 5}
PRIMITIVES = {"physics.collider": "primitives"}
"""Walls of the runs of Section V. Its simulation has a track as a row of balls, and so do these
walls; on exact ones it is a smooth line."""
EXACT = {"physics.collider": "exact"}
PUBLISHED = {"robot.motor": "pololu_1000_hpcb"}
"""The motor that Section VI names. Runs of Section V have the motor ``simulation``, whose speeds
are prescribed, as in the paper's simulation."""
REAL = PUBLISHED | EXACT
"""Changes that make a run one of the real robot, of Section VI."""
SINGLE: dict[str, Mapping[str, Any]] = {
    "paper/tee_turn_misaligned": PRIMITIVES,
    "paper/rolled_past_180": PRIMITIVES,
    "paper/no_motion_line": REAL,
    "paper/orient_climb_turn": REAL,
    "vertical_climb": PRIMITIVES,
}
"""Scenarios that are run once each, with the changes that make them Section V's or VI's."""
UNAIDED: dict[str, Any] = {"control.align": False, "control.retry": False}
AS_WRITTEN = {"control.kind": "paper"}
ELBOW_DRIVES: dict[str, dict[str, Any]] = {
    "jacobian": {"control.kind": "jacobian"},
    "paper": AS_WRITTEN,
    "equal": {"control.kind": "equal"},
    "differential": {"robot.drive": "differential"},
}
"""Changes of a scenario by drive: three motors by three controllers, or one motor."""
PLAYS = (1.0, 3.0, 6.0)
"""Play of the arms on their shafts that tee turns are tried with, degrees."""
BORES = (0.126, 0.135, 0.15, 0.17, 0.178, 0.184)
"""Bores that are climbed, m: by the friction law the springs are too weak for the last one."""
ENDS = ("inlet", "top", "side", "far", "low")
"""Open ends of the network of Fig. 14."""
_ASIDE = 5.0
"""By how much a robot that is put into an orientation by hand is off at most, degrees."""


class Preset(PaperController):
    """The paper's speeds computed beforehand: those of the preferred orientation, whatever it is.

    The orientation counts by the nearest one that it stands for, as modules are alike.
    """

    def _speeds(self, location: Location) -> NDArray[np.float64]:
        third = 2 * np.pi / 3
        return super()._speeds(replace(location, theta5=third * np.round(location.theta5 / third)))


PRESET = {"control.kind": f"{__name__}:{Preset.__name__}"}


def scenarios(quick: bool) -> dict[str, list[Scenario]]:
    """Return all runs by name.

    Args:
        quick: fewer orientations and trials of the same physics.
    """
    lists = {name.rpartition("/")[2]: [load_scenario(name, own)] for name, own in SINGLE.items()}
    return lists | _elbows(quick) | _tees(quick) | _straight_pipes(quick) | _network(quick)


def drawn(base: Scenario, theta5_deg: Sequence[float], spread: float = _ASIDE) -> list[Scenario]:
    """Return draws of what the paper leaves open: friction, preload, orientation and walls.

    The k-th draw of any two lists has the same friction, preload and walls and the same deviation
    from its orientation, so that lists are compared pair by pair.

    Args:
        base: a scenario.
        theta5_deg: orientation about which each draw lies.
        spread: largest deviation from it, degrees.
    """
    rng = np.random.default_rng(SEED)  # in this order of draws: other ones would be other trials
    runs = []
    for k, angle in enumerate(theta5_deg):
        changes = {
            "start.theta5_deg": float(angle + rng.uniform(-spread, spread)),
            "world.friction": float(rng.uniform(0.8, 1.0)),
            "robot.preload": float(rng.uniform(15.0, 35.0)),
        }
        runs.append(override(base, changes | (EXACT if k // 2 % 2 else PRIMITIVES)))
    return runs


def _elbows(quick: bool) -> dict[str, list[Scenario]]:
    """Both elbows with every controller and drive from any orientation, and from two of them."""
    base = {
        radius: load_scenario(name, UNAIDED | motor)
        for radius, name, motor in (("240", "elbow", {}), ("90", "elbow_short", PUBLISHED))
    }
    # A third of a turn holds all orientations: the modules are alike.
    angles = range(-55, 60, 10)
    half = Omnitrack().length / 2  # from the head to the centre, m
    ways = {f"{r}_{kind}": (r, changes) for r in base for kind, changes in ELBOW_DRIVES.items()}
    # Eq. 20 begun with the robot's centre at the bend, to show why it fails with the head there.
    ways["240_paper_late"] = "240", AS_WRITTEN | {"control.parameters.elbow_delay": half}
    for kind in ("equal", "differential"):
        ways[f"240_{kind}_real"] = "240", ELBOW_DRIVES[kind] | PUBLISHED
    lists = {
        f"elbow_{name}": drawn(override(base[radius], changes), angles)[:: 2 if quick else 1]
        for name, (radius, changes) in ways.items()
    }
    draws, kinds = 6 if quick else 24, {"jacobian": {}, "paper": AS_WRITTEN, "preset": PRESET}
    for kind, changes in kinds.items():
        elbow = override(base["90"], changes)
        lists[f"inner_{kind}"] = drawn(elbow, [0.0] * draws)
        if kind != "preset":
            lists[f"two_inner_{kind}"] = drawn(elbow, [60.0] * draws)
    # By the golden ratio any number of them lies evenly over a third of a turn.
    anywhere = [120 * (0.618034 * k % 1) - 60 for k in range(draws)]
    lists["any_paper"] = drawn(override(base["90"], AS_WRITTEN), anywhere)
    return lists


def _tees(quick: bool) -> dict[str, list[Scenario]]:
    """Turns over the start orientation, random tee turns, and straight over a tee."""
    tee, many, few = (
        load_scenario("tee_turn", PRIMITIVES),
        24 if quick else 200,
        12 if quick else 100,
    )
    turn = np.arange(-60, 60, 10 if quick else 2)
    lists = {
        f"map_{kind}": _orientations(tee, turn, REAL | UNAIDED | {"control.kind": kind})
        for kind in ("jacobian", "paper")
    }
    real, few_lugs = override(tee, REAL), override(tee, FEW_LUGS)
    lists["aligned"] = random_tee_turns(tee, many, (0.8, 1.0))
    lists["aligned_real"] = random_tee_turns(real, many, (0.8, 1.0))
    lists["written"] = random_tee_turns(override(tee, AS_WRITTEN), few, (0.8, 1.0))
    lists["written_real"] = random_tee_turns(override(real, AS_WRITTEN), few, (0.8, 1.0))
    lists["slippery"] = random_tee_turns(tee, many, (0.6, 0.8))
    lists["few_lugs"] = random_tee_turns(few_lugs, few, (0.8, 1.0))
    lists["few_lugs_slippery"] = random_tee_turns(few_lugs, few, (0.6, 0.8))
    for play in PLAYS:
        arms = override(real, {"robot.pitch_limit": float(np.radians(play))})
        lists[f"play_{play:g}"] = random_tee_turns(arms, few, (0.8, 1.0))
    draws = 2 if quick else 4
    for state in ("aligned", "unaligned"):
        base = load_scenario(f"paper/straight_over_tee_{state}", PUBLISHED)
        runs = drawn(base, [0.0] * draws * len(GRAVITIES))
        lists[f"straight_over_{state}"] = [
            override(run, {"world.gravity": list(gravity)})
            for run, gravity in zip(runs, [*GRAVITIES.values()] * draws, strict=True)
        ]
    # The hardest case: the inner module slips, and the weight carries the robot past the branch.
    downward = {"world.gravity": [0.0, 0.0, 9.81], "world.friction": 0.65, "control.retry": False}
    lists["slippery_downward"] = [override(tee, downward)]
    return lists


def _straight_pipes(quick: bool) -> dict[str, list[Scenario]]:
    """Rolling on the spot, and climbing with other motors, preloads and bores."""
    holonomic = load_scenario("paper/holonomic_alignment")
    angles, draws = np.arange(-60, 60, 20 if quick else 5), 4 if quick else 12
    climb = load_scenario("vertical_climb", REAL)
    level = {"world.gravity": [-GRAVITY, 0.0, 0.0]}
    return {
        "holonomic": _orientations(override(holonomic, PRIMITIVES), angles, {}),
        "rolling_upright": drawn(holonomic, [60.0] * draws),
        "rolling_flat": drawn(override(holonomic, level), [60.0] * draws),
        "straights": [climb, override(climb, level)],
        "bores": [
            override(climb, {"pipes.0.inner_diameter": bore, "run.time_limit": 3.0})
            for bore in BORES
        ],
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


def _network(quick: bool) -> dict[str, list[Scenario]]:
    """Drives between open ends of the network of Fig. 14, on exact walls."""
    pairs = [(start, goal) for start in ENDS for goal in ENDS if start != goal]
    kinds = {"jacobian": REAL, "simulation": EXACT, "paper": REAL | AS_WRITTEN}
    return {
        f"network_{kind}": [
            load_scenario("missions/fig14", {"mission.start": start, "mission.goals": [goal]} | own)
            for start, goal in pairs[:: 5 if quick else 1]
        ]
        for kind, own in kinds.items()
    }


def run_all(lists: Mapping[str, Sequence[Scenario]], progress: Progress | None = None) -> Runs:
    """Run every list on all cores. Scenarios that share a model share a batch across all lists."""
    flat = [scenario for group in lists.values() for scenario in group]
    if progress is not None:
        progress(0.0, counted(len(flat), "run"))
    done = iter(run_batch(flat, threads=0, progress=progress, no_load=False))
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
