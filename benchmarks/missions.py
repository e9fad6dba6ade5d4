"""How often a robot gets through pipe networks.

python benchmarks/missions.py [--quick] [--only STUDY ...] [--workers N] [--out DIR]

Seven studies:

* pairs: the network fig14 from every open end to every other one, with three start orientations
  each.
* random: networks of 6 to 12 fittings grown from a seed. Start and goal are drawn from the open
  ends, gravity in any direction, friction from 0.7 to 1.0 and the start orientation, all from the
  same seed.
* wet: the same with friction from 0.6 to 0.7.
* slippery: the same with friction from 0.5 to 0.65 and a preload of 20 N; falls: the same, but a
  robot that has fallen off its way does not plan on (monitor.falls = 0).
* bores: the same as random with reducers between bores of 160, 150, 155 and 165 mm.
* close: two fittings with less than a robot's length between: elbow and elbow, elbow and tee, tee
  and tee, in every passage and plane, with random gravity, friction and start orientation.

Prints how many arrived with Wilson's 95 % interval, whether the fittings were passed in the planned
order, how often robots backed off to try again, and for each failure its seed, outcome and written
cause. --out keeps all runs as CSV.
"""

from __future__ import annotations

import csv
import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path

import numpy as np
from shape import Arguments, interval, random_gravity, run_tasks, table

from omnitrack_sim import Result, Scenario, load_network, override, random_network, run_batch
from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.scenario import validate

ORIENTATIONS_DEG = (0.0, 40.0, 80.0)
"""Start orientations of the pairs: a third of the period of three modules apart."""
FRICTION, WET, SLIPPERY = (0.7, 1.0), (0.6, 0.7), (0.5, 0.65)
SLIPPERY_PRELOAD = 20.0
"""N a module, in slippery networks."""
BORES = (0.150, 0.155, 0.165)
"""Bores, m, that reducers lead to from 160 mm."""
CLOSE_TRIALS = 4
"""Random trials of each pair of close fittings."""
TITLES = {
    "pairs": "fig14, all pairs of ends",
    "random": "random networks",
    "bores": "random networks, four bores",
    "wet": "wet random networks",
    "slippery": "slippery random networks",
    "falls": "the same, no way on after a fall",
    "close": "fittings close together",
}
NETWORKS = {"random": 300, "bores": 100, "wet": 100, "slippery": 100, "falls": 100}
"""Studies of one random network a seed, and how many."""
QUICK_NETWORKS = 10
LAST_EVENTS = 4
"""How many of a failed run's events are printed."""


@dataclass(frozen=True)
class Run:
    """One mission and what came of it.

    Attributes:
        study: one of ``TITLES``.
        seed: of the random network or trial; -1 for pairs.
        start, goal: open ends; for close fittings the two fittings, and nothing.
        friction: coefficient.
        theta5_deg: start orientation, deg.
        gravity_x, gravity_y, gravity_z: m/s², world frame.
        fittings: number of fittings on the planned way.
        arrived: whether the robot reached its goal.
        in_order: see ``in_order``.
        retries: how often the robot backed off to try again.
        rolls: how often it stopped to roll its modules.
        duration_s: simulated time.
        wall_s: time that it took on this machine.
        reason, events: as the result tells them.
    """

    study: str
    seed: int
    start: str
    goal: str
    friction: float
    theta5_deg: float
    gravity_x: float
    gravity_y: float
    gravity_z: float
    fittings: int
    outcome: str
    arrived: bool
    in_order: bool
    retries: int
    rolls: int
    duration_s: float
    wall_s: float
    reason: str
    events: str


def pair(start: str, goal: str, theta5_deg: float) -> Scenario:
    """From one open end of fig14 to another."""
    return _mission("fig14", start, goal, theta5_deg=theta5_deg)


def random_mission(
    seed: int, bores: tuple[float, ...] = (), friction_range: tuple[float, float] = FRICTION
) -> Scenario:
    """A random mission in a random network, both from ``seed``; ``bores``, m, ask for reducers."""
    network = random_network(seed, diameters=bores or None)
    rng = np.random.default_rng([seed, 1])
    start, goal = rng.choice(network.open_ends, 2, replace=False)
    gravity = random_gravity(rng)
    friction, theta5_deg = float(rng.uniform(*friction_range)), float(rng.uniform(-180, 180))
    table = network.model_dump(mode="json")
    return _mission(
        table,
        str(start),
        str(goal),
        theta5_deg=theta5_deg,
        friction=friction,
        gravity=gravity,
    )


def slippery_mission(seed: int, plans_on: bool) -> Scenario:
    """A random mission on slippery walls, of a robot that plans on after a fall or does not."""
    changes = {"robot.preload": SLIPPERY_PRELOAD} | ({} if plans_on else {"monitor.falls": 0})
    return override(random_mission(seed, friction_range=SLIPPERY), changes)


def close_fittings() -> dict[str, list[dict[str, object]]]:
    """Pipes with two fittings of every kind and passage close together, by what they are.

    The second one is turned by 0, 90 and 180 degrees.
    """
    tees = {
        "turn": ("run_start", "branch"),
        "merge": ("branch", "run_end"),
        "over": ("run_start", "run_end"),
    }
    passages: dict[str, dict[str, object]] = {
        name: {"kind": "tee", "enter": enter, "leave": leave}
        for name, (enter, leave) in tees.items()
    }
    passages |= {f"elbow {r}": {"kind": "elbow", "mean_radius": r / 1000} for r in (90, 240)}
    before, after = {"kind": "straight", "length": 0.4}, {"kind": "straight", "length": 0.5}
    found: dict[str, list[dict[str, object]]] = {}
    for first, second in product(passages, passages):
        gaps = (0.0, 0.1) if first in tees and second in tees else (0.0,)
        for gap, turn in product(gaps, (0.0, 90.0, 180.0)):
            between = [{"kind": "straight", "length": gap}] if gap else []
            name = f"{first}, {1000 * gap:.0f} mm, {second} at {turn:.0f} deg"
            found[name] = [
                before,
                passages[first],
                *between,
                passages[second] | {"turn_deg": turn},
                after,
            ]
    return found


def close(name: str, seed: int) -> Scenario | None:
    """A random trial of two close fittings; None where they run into each other."""
    rng = np.random.default_rng([seed, 2])
    gravity = random_gravity(rng)
    data = {
        "pipes": close_fittings()[name],
        "start": {"theta5_deg": float(rng.uniform(-180, 180)), "distance": 0.15},
        "world": {"friction": float(rng.uniform(*FRICTION)), "gravity": gravity},
    }
    try:
        return validate(data)
    except ScenarioError:
        return None


def _mission(
    network: object,
    start: str,
    goal: str,
    *,
    theta5_deg: float,
    friction: float = 0.9,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
) -> Scenario:
    return validate(
        {
            "network": network,
            "mission": {"start": start, "goals": [goal]},
            "start": {"theta5_deg": theta5_deg},
            "world": {"friction": friction, "gravity": list(gravity)},
        }
    )


def in_order(result: Result) -> bool:
    """Whether the fittings of each leg were passed in the order of its route.

    None may be left out, and the last leg has to be driven to its end.
    """
    routes, driven = result.routes(), result.timeline()
    for leg, route in enumerate(routes):
        planned = [route.network.parts[passage.index].name for passage in route.passages]
        visited = [passage.name for passage in driven if passage.leg == leg]
        first = planned.index(visited[0]) if visited else 0
        if visited != planned[first : first + len(visited)]:
            return False
        if leg == len(routes) - 1 and result.success and visited[-1:] != planned[-1:]:
            return False
    return True


def drive(task: tuple[str, int, str, str, float]) -> Run:
    """Run one mission.

    Args:
        task: study, seed, then for a pair start, goal and theta5 in deg; for close fittings, in
            place of the start, what they are.
    """
    study, seed, start, goal, theta5_deg = task
    if study == "pairs":
        scenario = pair(start, goal, theta5_deg)
    elif study == "close":
        found = close(start, seed)
        assert found is not None
        scenario = found
    elif study in ("slippery", "falls"):
        scenario = slippery_mission(seed, plans_on=study == "slippery")
    else:
        friction = WET if study == "wet" else FRICTION
        scenario = random_mission(seed, BORES if study == "bores" else (), friction)
    begin = time.perf_counter()
    (result,) = run_batch([scenario], threads=1, no_load=False)
    wall = time.perf_counter() - begin
    mission = scenario.mission
    driven = result.timeline()
    x, y, z = scenario.world.gravity
    return Run(
        study=study,
        seed=seed,
        start=start if mission is None else mission.start,
        goal="" if mission is None else mission.goals[-1],
        friction=scenario.world.friction,
        theta5_deg=scenario.start.theta5_deg,
        gravity_x=x,
        gravity_y=y,
        gravity_z=z,
        fittings=len(scenario.route.passages),
        outcome=result.outcome.value,
        arrived=result.success,
        in_order=in_order(result),
        retries=sum(passage.retries for passage in driven),
        rolls=sum(passage.rolls for passage in driven),
        duration_s=result.duration_s,
        wall_s=wall,
        reason=result.reason,
        events="\n".join(map(str, result.events)),
    )


def row(title: str, runs: Sequence[Run]) -> list[str]:
    """Return a row of the table of rates."""
    arrived = [run for run in runs if run.arrived]
    retried = sum(run.retries > 0 for run in runs)
    return [
        title,
        f"{len(arrived)} of {len(runs)}",
        interval((run.arrived for run in runs), 1),
        str(sum(run.in_order for run in runs)),
        f"{sum(run.retries for run in runs)} in {retried} runs",
        f"{np.mean([run.duration_s for run in arrived]):.1f} s" if arrived else "-",
    ]


HEADS = (
    "study",
    "arrived",
    "95 % interval",
    "in planned order",
    "retries",
    "mean time of those that arrived",
)


def main() -> None:
    """Run the studies that are asked for, and print rates and failures."""
    arguments = Arguments(__doc__, workers=True)
    arguments.add_argument(
        "--quick", action="store_true", help="one orientation a pair, 10 networks a study"
    )
    arguments.add_argument("--only", nargs="+", choices=tuple(TITLES), help="these studies")
    arguments.add_argument("--networks", type=int, help="of each study of random networks")
    arguments.add_argument("--out", type=Path, help="folder for missions.csv")
    given = arguments.read()
    every = every_task(given.quick, given.networks)
    tasks = [t for t in every if given.only is None or t[0] in given.only]
    runs = run_tasks(drive, tasks, given.workers)
    by_study: dict[str, list[Run]] = {}
    for run in runs:
        by_study.setdefault(run.study, []).append(run)
    shown = (row(title, by_study[study]) for study, title in TITLES.items() if study in by_study)
    table("rates", HEADS, shown)
    report_failures(runs)
    if given.out is not None:
        save(runs, given.out)


def every_task(
    quick: bool, max_networks: int | None = None
) -> list[tuple[str, int, str, str, float]]:
    """Return the tasks of ``drive`` in all studies.

    Args:
        quick: one orientation a pair, few networks.
        max_networks: random networks of a study; none: as many as it has.
    """
    orientations = ORIENTATIONS_DEG[:1] if quick else ORIENTATIONS_DEG
    names = tuple(load_network("fig14").ports)
    tasks = [
        ("pairs", -1, start, goal, angle)
        for start, goal in permutations(names, 2)
        for angle in orientations
    ]
    for study, networks in NETWORKS.items():
        count = max_networks or (QUICK_NETWORKS if quick else networks)
        tasks += [(study, seed, "", "", 0.0) for seed in range(count)]
    trials = range(1 if quick else CLOSE_TRIALS)
    chains = [name for name in close_fittings() if close(name, 0) is not None]
    return tasks + [("close", seed, name, "", 0.0) for name in chains for seed in trials]


def report_failures(runs: Sequence[Run]) -> None:
    """Where, with which outcome and why a robot did not arrive, with the last events."""
    failures = [run for run in runs if not run.arrived or not run.in_order]
    if failures:
        print("\n## failures\n\nAnd runs not in the planned order:\n")
    for run in failures:
        where = (
            f"fig14, theta5 {run.theta5_deg:g} deg"
            if run.study == "pairs"
            else f"{run.study}, seed {run.seed}"
        )
        order = "" if run.in_order else ", not in the planned order"
        print(
            f"* {where}, {run.start} to {run.goal}, friction {run.friction:.2f}: "
            f"{run.outcome}{order}; {run.reason}"
        )
        for event in run.events.splitlines()[-LAST_EVENTS:]:
            print(f"    * {event}")


def save(runs: Sequence[Run], folder: Path) -> None:
    """Write all runs into ``missions.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "missions.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(field.name for field in dataclasses.fields(Run))
        rows.writerows(dataclasses.astuple(run) for run in runs)
    print(f"\nsaved {folder / 'missions.csv'}")


if __name__ == "__main__":
    main()
