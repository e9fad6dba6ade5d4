"""How well a robot finds its way by its own sensors, with a map.

python benchmarks/autonomy.py [--only STUDY ...] [--quick] [--trials N] [--senses SENSE ...]
    [--seed N] [--workers N] [--out DIR]

Drawn are

* turns: tee turns from any orientation, with friction 0.8 to 1.0, any gravity and any preload of 15
  to 35 N, of robots that do not know how they are turned about their axis.
* missions: random networks of 6 to 12 fittings, likewise.
* robots: the presser and the climber through random networks of 9 to 12 fittings. Both go straight
  over tees and round elbows, and neither turns into a branch nor comes out of one: start and goal
  are drawn from those open ends between which a way leads that asks for no more.

They are run by truth, depth camera and headlight camera. Printed are how many arrived, and errors
of the estimates over runs. The default seed is not the one that anything was tuned on. --out keeps
outcome, reason and events of each trial, in a folder a study.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from itertools import permutations
from pathlib import Path

import numpy as np
from missions import random_mission
from shape import Arguments, Row, Trials, interval, random_gravity, table
from tee_turns import random_tee_turns

from omnitrack_sim import Result, Scenario, override, random_network, shortest_route
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.scenario import validate

TRIALS = {"turns": 200, "missions": 100, "robots": 30}
QUICK_TRIALS, SEED = 10, 2
SENSES = {
    "truth": {"sensing.kind": "truth"},
    "depth": {"sensing.kind": "onboard", "sensing.camera": "depth"},
    "headlight": {"sensing.kind": "onboard", "sensing.camera": "headlight"},
}
FRICTION = (0.8, 1.0)
FIRST_NETWORK = 7000
"""Seed of the first network of ``missions``; 5000 to 5035 were looked at while the filter was
made."""
ROBOTS = {
    "presser": {"control.cruise_speed": 0.08, "start.distance": 0.2},
    "climber": {},
}
FITTINGS, LENGTHS, TEES = (9, 12), (0.4, 0.6), 0.25
"""Of the networks of other robots: fittings, lengths of straights, m, and share of tees."""
RADIUS = 0.24
"""Mean radius of their elbows, m: in tighter ones the presser's wheelbase is long."""
NOT_KNOWN = "does not know"
"""In the event of a robot that does not know where it is."""


def turns(sense: str, trials: int, seed: int) -> list[Scenario]:
    """Draw tee turns from any orientation."""
    changes = {"control.align": True, "control.retry": True, **SENSES[sense]}
    return random_tee_turns(trials, seed=seed, friction=FRICTION, theta5_deg=180.0, changes=changes)


def missions(sense: str, trials: int, seed: int) -> list[Scenario]:
    """Draw missions through random networks."""
    first = FIRST_NETWORK + (seed - SEED) * 1000
    return [override(random_mission(first + i, FRICTION), SENSES[sense]) for i in range(trials)]


def missions_of(robot: str, sense: str, trials: int, seed: int) -> list[Scenario]:
    """Draw missions of another robot through random networks."""
    numbers = range(1000 * seed, 1000 * seed + trials)
    return [override(other_mission(robot, number), SENSES[sense]) for number in numbers]


def other_mission(robot: str, number: int) -> Scenario:
    """Draw network, ends, gravity, friction and orientation of another robot from a number."""
    for attempt in range(100):
        seed = number + 100_000 * attempt
        network = random_network(
            seed, FITTINGS, lengths=LENGTHS, mean_radii=(RADIUS,), tee_share=TEES
        )
        ways = _ways(network)
        if ways:
            break
    rng = np.random.default_rng([seed, 1])
    start, goal = ways[int(rng.integers(len(ways)))]
    gravity = random_gravity(rng)
    friction, theta5_deg = float(rng.uniform(*FRICTION)), float(rng.uniform(-180, 180))
    data = {
        "name": f"{robot}_{number}",
        "network": network.model_dump(mode="json"),
        "mission": {"start": start, "goals": [goal]},
        "robot": {"kind": robot},
        "world": {"gravity": gravity, "friction": friction},
        "start": {"theta5_deg": theta5_deg},
        "seed": number,
    }
    return override(validate(data), ROBOTS[robot])


def _ways(network: Network) -> list[tuple[str, str]]:
    """Return pairs of open ends between which a robot need not turn into or out of a branch.

    Of these, they are the ones with most fittings on the way.
    """
    ways: dict[tuple[str, str], int] = {}
    for start, goal in permutations(network.open_ends, 2):
        passages = shortest_route(network, start, goal).passages
        if not any("branch" in (passage.enter, passage.leave) for passage in passages):
            ways[start, goal] = sum(passage.kind != "straight" for passage in passages)
    most = max(ways.values(), default=0)
    return [way for way, count in ways.items() if count == most]


def measured(result: Result) -> dict[str, float]:
    """Return errors of the estimates that no metric says: of position, m, and of theta5, deg."""
    channels = result.trajectory.channels
    if "position_estimate" not in channels:
        return {}
    away = np.linalg.norm(channels["position_estimate"] - channels["position"], axis=1)
    return {"error_m": float(np.percentile(away, 95)), "at_turn_deg": _error_at_turn(result)}


def _error_at_turn(result: Result) -> float:
    """Return the error of theta5, deg, as the first turn into a branch or round a bend begins."""
    channels, phases = result.trajectory.channels, result.trajectory.phases
    codes = [phases.index(name) for name in ("tee_turn", "elbow") if name in phases]
    turning = np.isin(channels["phase"], codes)
    if not turning.any():
        return math.nan
    first = int(turning.argmax())
    error = channels["theta5_estimate"][first] - channels["theta5"][first]
    return abs(math.degrees((error + math.pi) % (2 * math.pi) - math.pi))


def quantiles(
    rows: Sequence[Row], column: str, parts: tuple[int, int], unit: str, digits: int = 0
) -> str:
    """Return two percentiles over the trials in which a column is known."""
    factor = {"%": 100, "mm": 1000, "deg": 1}[unit]
    known = [factor * row[column] for row in rows if row[column] is not None]
    low, high = np.percentile(known, parts)
    return f"{low:.{digits}f}, {high:.{digits}f} {unit}"


def lost(rows: Sequence[Row]) -> str:
    """Return in how many trials the robot did once not know where it was."""
    return f"{sum(NOT_KNOWN in row['events'] for row in rows)} runs"


def arrived(rows: Sequence[Row], digits: int) -> list[str]:
    """Return how many arrived, and the interval of the rate."""
    good = [row["success"] for row in rows]
    return [f"{sum(good)} of {len(good)}", interval(good, digits)]


HEADS = (
    "sensing",
    "arrived",
    "95 % interval",
    "localisation error: median, 90 %",
    "largest error: median, 90 %",
    "error of theta5 at the first turn: median, 95 %",
    "lost on the way",
)
ROBOT_HEADS = (
    "robot",
    "sensing",
    "arrived",
    "95 % interval",
    "of those that arrive by truth",
    "localisation error: median, 95 %",
    "largest error: median, 95 %",
    "lost on the way",
)


def row(sense: str, rows: Sequence[Row]) -> list[str]:
    """Return the row of a way to sense."""
    if sense == "truth":
        return [sense, *arrived(rows, 1), *["-"] * 4]
    return [
        sense,
        *arrived(rows, 1),
        quantiles(rows, "localisation_error_rel", (50, 90), "%", 2),
        quantiles(rows, "localisation_error_max_m", (50, 90), "mm"),
        quantiles(rows, "at_turn_deg", (50, 95), "deg", 1),
        lost(rows),
    ]


def robot_row(robot: str, sense: str, runs: Mapping[Hashable, Sequence[Row]]) -> list[str]:
    """Return the row of another robot and a way to sense."""
    rows = runs[robot, sense]
    if sense == "truth":
        return [robot, sense, *arrived(rows, 0), *["-"] * 4]
    by_truth = runs.get((robot, "truth"), ())
    taken = [own["success"] for own, one in zip(rows, by_truth, strict=False) if one["success"]]
    return [
        robot,
        sense,
        *arrived(rows, 0),
        f"{sum(taken)} of {len(taken)}",
        quantiles(rows, "error_m", (50, 95), "mm"),
        quantiles(rows, "localisation_error_max_m", (50, 95), "mm"),
        lost(rows),
    ]


def main() -> None:
    """Run the studies that are asked for, and print their tables."""
    parser = Arguments(__doc__, seed=SEED, workers=True)
    parser.add_argument("--only", nargs="+", choices=tuple(TRIALS), default=list(TRIALS))
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_TRIALS} trials a study")
    parser.add_argument("--trials", type=int, help="trials a study")
    parser.add_argument("--senses", nargs="+", choices=tuple(SENSES), default=list(SENSES))
    parser.add_argument("--out", type=Path, help="folder for the tables of all trials")
    given = parser.read()
    for study in given.only:
        trials = given.trials or (QUICK_TRIALS if given.quick else TRIALS[study])
        drawn: dict[Hashable, list[Scenario]]
        if study == "robots":
            drawn = {
                (robot, sense): missions_of(robot, sense, trials, given.seed)
                for robot in ROBOTS
                for sense in given.senses
            }
        else:
            draw = turns if study == "turns" else missions
            drawn = {sense: draw(sense, trials, given.seed) for sense in given.senses}
        out = None if given.out is None else given.out / study
        runs = Trials(study, drawn, measure=measured).run(given.workers, out)
        text = f"{trials} trials, seed {given.seed}:"
        if study == "robots":
            table(study, ROBOT_HEADS, (robot_row(*key, runs) for key in runs), text)
        else:
            table(study, HEADS, (row(*one) for one in runs.items()), text)


if __name__ == "__main__":
    main()
