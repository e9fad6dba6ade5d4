"""Missions of the presser and the climber through random networks, by truth and by camera.

Both go straight over tees and round elbows, and neither turns into a branch nor comes out of one:
start and goal are drawn from those open ends between which a way leads that asks for no more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from driving.by_sensors import SENSES
from omnitrack_sim import Scenario, override, random_network, run_batch, shortest_route
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.scenario import validate

ROBOTS = {
    "presser": {"control.cruise_speed": 0.08, "start.distance": 0.2},
    "climber": {},
}
FITTINGS, LENGTHS, TEES = (9, 12), (0.4, 0.6), 0.25
"""Of the networks: number of fittings, lengths of straights, m, and share of tees."""
RADIUS = 0.24
"""Mean radius of the elbows, m: in tighter ones the presser's wheelbase is long."""
FRICTION = (0.8, 1.0)


@dataclass(frozen=True)
class Drive:
    """What came of one run.

    Attributes:
        robot: its kind.
        sense: a key of ``SENSES``.
        number: of the network.
        outcome: its name.
        reason: in words, with the last events.
        error: m, 95th percentile over time of the distance from the true position.
        largest: m, the largest of it.
        lost: how often the robot did not know where it was.
    """

    robot: str
    sense: str
    number: int
    outcome: str
    reason: str
    error: float
    largest: float
    lost: int


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


def mission(robot: str, number: int) -> Scenario:
    """Return a random mission: network, ends, gravity, friction and orientation from a number."""
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
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    friction, theta5_deg = float(rng.uniform(*FRICTION)), float(rng.uniform(-180, 180))
    scenario = validate(
        {
            "name": f"{robot}_{number}",
            "network": network.model_dump(mode="json"),
            "mission": {"start": start, "goals": [goal]},
            "robot": {"kind": robot},
            "world": {"gravity": gravity.tolist(), "friction": friction},
            "start": {"theta5_deg": theta5_deg},
            "seed": number,
        }
    )
    return override(scenario, ROBOTS[robot])


def drive(task: tuple[str, str, int]) -> Drive:
    """Return what came of a mission: robot, sense, number."""
    robot, sense, number = task
    (result,) = run_batch([override(mission(robot, number), SENSES[sense])], no_load=False)
    channels, events = result.trajectory.channels, [str(event) for event in result.events]
    away = np.array([math.nan])
    if "position_estimate" in channels:
        away = np.linalg.norm(channels["position_estimate"] - channels["position"], axis=1)
    return Drive(
        robot,
        sense,
        number,
        result.outcome.value,
        "; ".join([result.reason, *events[-4:]]),
        float(np.percentile(away, 95)),
        float(away.max()),
        sum("does not know" in event for event in events),
    )


def runs(senses: Sequence[str], trials: int, seed: int, workers: int) -> list[Drive]:
    """Return all runs: each robot through ``trials`` networks by each of some senses."""
    first = 1000 * seed
    numbers = range(first, first + trials)
    with LocalPool(workers) as pool:
        return list(pool.map(drive, [(r, s, n) for r in ROBOTS for s in senses for n in numbers]))


def table(drives: Sequence[Drive]) -> str:
    """Return one row for each robot and sense."""
    rows = [
        "| robot | sensing | arrived | 95 % interval | of those that arrive by truth | "
        "localisation error: median, 95 % | largest error: median, 95 % | lost on the way |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    arrived = {
        (run.robot, run.number)
        for run in drives
        if run.sense == "truth" and run.outcome == "reached_goal"
    }
    for robot, sense in dict.fromkeys((run.robot, run.sense) for run in drives):
        own = [run for run in drives if (run.robot, run.sense) == (robot, sense)]
        good = [run for run in own if run.outcome == "reached_goal"]
        able = [run for run in own if (robot, run.number) in arrived]
        low, high = wilson_interval(len(good), len(own))
        cells = [robot, sense, f"{len(good)} of {len(own)}"]
        cells.append(f"{100 * low:.1f} to {100 * high:.1f} %")
        if sense == "truth":
            cells += ["-"] * 4
        else:
            cells += [
                f"{sum(run in good for run in able)} of {len(able)}",
                _two([1000 * run.error for run in own]),
                _two([1000 * run.largest for run in own]),
                f"{sum(run.lost > 0 for run in own)} runs",
            ]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _two(values: Sequence[float]) -> str:
    """Return the median and the 95th percentile of errors, mm, over the runs."""
    median, most = np.percentile(values, (50, 95))
    return f"{median:.0f}, {most:.0f} mm"


def failures(drives: Sequence[Drive]) -> str:
    """Return each run that did not arrive, with its cause."""
    return "\n".join(
        f"* {run.robot} {run.number}, {run.sense}: {run.outcome}; {run.reason}"
        for run in drives
        if run.outcome != "reached_goal"
    )
