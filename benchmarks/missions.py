"""How often a robot gets through pipe networks.

python benchmarks/missions.py [--quick] [--only STUDY ...] [--networks N] [--workers N] [--out DIR]

Drawn are

* pairs: the network fig14 from every open end to every other one, with three start orientations
  each; one in the quick form.
* random: networks of 6 to 12 fittings grown from a seed. Start and goal are drawn from the open
  ends, gravity in any direction, friction from 0.7 to 1.0 and the start orientation, all from the
  same seed.
* wet: the same with friction from 0.6 to 0.7.
* slippery: the same with friction from 0.5 to 0.65 and a preload of 20 N.

They are run by the default controller with its retries. Printed is how many arrived with Wilson's
95 % interval, in how many the fittings were passed in the planned order, and how often robots
backed off to try again. --out keeps outcome, reason and events of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from shape import Arguments, Row, Trials, interval, random_gravity, table

from omnitrack_sim import Result, Scenario, load_network, override, random_network
from omnitrack_sim.scenario import validate

ORIENTATIONS_DEG = (0.0, 40.0, 80.0)
"""Start orientations of the pairs: a third of the period of three modules apart."""
FRICTION, WET, SLIPPERY = (0.7, 1.0), (0.6, 0.7), (0.5, 0.65)
SLIPPERY_PRELOAD = 20.0
"""N a module, in slippery networks."""
TITLES = {
    "pairs": "fig14, all pairs of ends",
    "random": "random networks",
    "wet": "wet random networks",
    "slippery": "slippery random networks",
}
NETWORKS = {"random": 300, "wet": 100, "slippery": 100}
"""Studies of one random network a seed, and how many."""
QUICK_NETWORKS = 10


def pairs(orientations: Sequence[float]) -> list[Scenario]:
    """Return missions from each open end of fig14 to each other one, by start orientation, deg."""
    return [
        _mission({"network": "fig14", "start": {"theta5_deg": theta5}}, start, goal)
        for start, goal in permutations(load_network("fig14").ports, 2)
        for theta5 in orientations
    ]


def random_mission(seed: int, friction_range: tuple[float, float] = FRICTION) -> Scenario:
    """Draw a mission in a random network, both from ``seed``."""
    network = random_network(seed)
    rng = np.random.default_rng([seed, 1])
    start, goal = rng.choice(network.open_ends, 2, replace=False)
    gravity = random_gravity(rng)
    friction, theta5 = float(rng.uniform(*friction_range)), float(rng.uniform(-180, 180))
    data = {
        "network": network.model_dump(mode="json"),
        "start": {"theta5_deg": theta5},
        "world": {"friction": friction, "gravity": gravity},
    }
    return _mission(data, str(start), str(goal))


def _mission(data: dict[str, Any], start: str, goal: str) -> Scenario:
    return validate(data | {"mission": {"start": start, "goals": [goal]}})


def drawn(study: str, count: int, orientations: Sequence[float]) -> list[Scenario]:
    """Return the missions of a study: of so many networks, or by so many orientations."""
    if study == "pairs":
        return pairs(orientations)
    ranges = {"wet": WET, "slippery": SLIPPERY}
    missions = [random_mission(seed, ranges.get(study, FRICTION)) for seed in range(count)]
    if study == "slippery":
        missions = [override(one, {"robot.preload": SLIPPERY_PRELOAD}) for one in missions]
    return missions


def measured(result: Result) -> dict[str, float]:
    """Return whether a robot passed the fittings in the planned order, and its retries."""
    retries = sum(passage.retries for passage in result.timeline())
    return {"in_order": float(in_order(result)), "retries": float(retries)}


def in_order(result: Result) -> bool:
    """Return whether the fittings of each leg were passed in the order of its route.

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


HEADS = (
    "study",
    "arrived",
    "95 % interval",
    "in planned order",
    "retries",
    "mean time of those that arrived",
)


def row(title: str, runs: Sequence[Row]) -> list[str]:
    """Return a row of the table of rates."""
    times = [run["duration_s"] for run in runs if run["success"]]
    retries = [int(run["retries"]) for run in runs]
    return [
        title,
        f"{len(times)} of {len(runs)}",
        interval((run["success"] for run in runs), 1),
        str(sum(run["in_order"] == 1 for run in runs)),
        f"{sum(retries)} in {sum(n > 0 for n in retries)} runs",
        f"{np.mean(times):.1f} s" if times else "-",
    ]


def main() -> None:
    """Run the studies that are asked for, and print their rates."""
    arguments = Arguments(__doc__, workers=True)
    arguments.add_argument(
        "--quick", action="store_true", help="one orientation a pair, 10 networks a study"
    )
    arguments.add_argument("--only", nargs="+", choices=tuple(TITLES), default=[*TITLES])
    arguments.add_argument("--networks", type=int, help="of each study of random networks")
    arguments.add_argument("--out", type=Path, help="folder for the table of all trials")
    given = arguments.read()
    orientations = ORIENTATIONS_DEG[:1] if given.quick else ORIENTATIONS_DEG
    missions = {}
    for study in (one for one in TITLES if one in given.only):
        count = given.networks or (QUICK_NETWORKS if given.quick else NETWORKS.get(study, 0))
        missions[study] = drawn(study, count, orientations)
    runs = Trials("missions", missions, measure=measured).run(given.workers, given.out)
    table("rates", HEADS, (row(TITLES[study], own) for study, own in runs.items()))


if __name__ == "__main__":
    main()
