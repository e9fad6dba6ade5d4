"""Unknown networks explored: the shipped ones, or random ones.

python benchmarks/explorations.py [--missions N]
python benchmarks/explorations.py --random SENSE [--trials N] [--seed N] [--workers N] [--keep DIR]

Drawn are random networks of 8 to 14 fittings. A part of their straights is left out, so that
fittings follow each other directly, a part of their tees are wyes, half of them have reducers, and
a quarter are loops with pipes of random lengths. Robots begin at a random end, at any gravity and
friction 0.8 to 1.0. The shipped ones are explored by the true pose and by depth camera. Printed is
how each ended, or how many, how good the maps are, and the processor time. Random ones take minutes
each: those in the folder --keep are not made again.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from autonomy import FRICTION, NOT_KNOWN, SENSES
from shape import Arguments, interval, random_gravity, run_tasks, table

from omnitrack_sim import (
    Network,
    Scenario,
    load_network,
    load_scenario,
    override,
    random_network,
    run_batch,
)
from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.base.writing import write_file
from omnitrack_sim.pipes import network as networks
from omnitrack_sim.pipes.map_difference import MapDifference
from omnitrack_sim.record.events import ExplorationComplete
from omnitrack_sim.scenario import validate

MISSIONS = ("missions/explore_onboard", "missions/explore_loop", "missions/explore_house")
SEED, FIRST_NETWORK = 2, 9000
"""Seed of the first random network; 5000 to 5035 and 8000 to 8020 were looked at while exploring
was made."""
OPPOSITE = {
    "tower": (("riser_2", "shaft"), ("cross_low", "cross_high")),
    "ring": (("right", "left"), ("right_low", "right_high"), ("left_low", "left_high")),
}
"""Shipped networks with a loop, and the pairs of pipes of it that are equally long."""
CLOSE_TO = {"tower": ("drain", "roof"), "ring": ()}
"""Pipes of these networks that may be left out."""
FITTINGS = (8, 14)
BORES = (0.15, 0.17)
"""Bores, m, that reducers lead to from 160 mm: by less than 3 % a map need not know."""
CLOSE, WYES, REDUCERS, LOOPS = 0.6, 0.4, 0.5, 0.25
"""Parts of the straights between fittings that are left out, of the tees that are wyes, and of the
networks that have reducers, or are loops."""


def tree(seed: int, rng: np.random.Generator) -> Network:
    """A random network with fittings close together, wyes and reducers."""
    bores = BORES if rng.random() < REDUCERS else None
    network = random_network(seed, FITTINGS, diameters=bores)
    for fitting in network.fittings:
        share = {"straight": CLOSE, "tee": WYES}.get(fitting.kind, 0.0)
        if rng.random() < share:
            change = joined_directly if fitting.kind == "straight" else as_wye
            network = change(network, fitting.name)
    return network


def joined_directly(network: Network, name: str) -> Network:
    """The network without a straight between two fittings; as it is where they have no room."""
    table = network.model_dump(mode="json")
    joints = table["joints"]
    before = [joint for joint in joints if joint["ports"][1] == f"{name}.start"]
    after = [joint for joint in joints if joint["ports"][0] == f"{name}.end"]
    kinds = {port.split("_")[0] for joint in before + after for port in joint["ports"]}
    # A bore that changes and changes back at once is no pipe that anybody builds.
    if not (before and after) or kinds == {"straight", "reducer"}:
        return network
    joints.remove(before[0])
    after[0]["ports"] = [before[0]["ports"][0], after[0]["ports"][1]]
    table["fittings"] = [row for row in table["fittings"] if row["name"] != name]
    return _valid(table, network)


def as_wye(network: Network, name: str) -> Network:
    """The network with a wye in the place of a tee; as it is where that has no room."""
    table = network.model_dump(mode="json")
    for row in table["fittings"]:
        if row["name"] == name:
            bore = row["inner_diameter"]
            row.clear()
            row |= {"kind": "wye", "name": name, "inner_diameter": bore, "branch_diameter": bore}
    return _valid(table, network)


def _valid(table: dict[str, Any], otherwise: Network) -> Network:
    try:
        return networks.validate(table)
    except NetworkError:
        return otherwise


def loop(rng: np.random.Generator) -> Network:
    """A shipped network with a loop, with bends and pipes of random sizes."""
    name = str(rng.choice(list(OPPOSITE)))
    table = load_network(name).model_dump(mode="json")
    drawn = {row["name"]: round(float(rng.uniform(0.3, 0.8)), 2) for row in table["fittings"]}
    drawn |= {other: drawn[one] for one, other in OPPOSITE[name]}
    radius = float(rng.choice([0.09, 0.24]))
    for row in table["fittings"]:
        if row["kind"] == "straight":
            row["length"] = drawn[row["name"]]
        elif row["kind"] == "elbow":
            row["mean_radius"] = radius
    network = networks.validate(table)
    for straight in CLOSE_TO[name]:
        if rng.random() < CLOSE:
            network = joined_directly(network, straight)
    return network


def random_exploration(seed: int, sense: str) -> Scenario:
    """Draw a robot at a random end of a random network, any gravity, friction 0.8 to 1.0."""
    rng = np.random.default_rng([seed, 4])
    network = loop(rng) if rng.random() < LOOPS else tree(seed, rng)
    gravity = random_gravity(rng)
    start = str(rng.choice(list(network.open_ends)))
    scenario = validate(
        {
            "network": network.model_dump(mode="json"),
            "mission": {"start": start, "map": "unknown", "task": "explore"},
            "start": {"theta5_deg": float(rng.uniform(-180, 180))},
            "world": {"friction": float(rng.uniform(*FRICTION)), "gravity": gravity},
        }
    )
    return override(scenario, SENSES[sense])


@dataclass(frozen=True)
class Tour:
    """What came of one exploration.

    Attributes:
        outcome: its name. reason: in words, and the last events.
        map: how the robot's map differs from the network. duration_s: simulated time.
        distance_m: driven. cpu_s: processor time that it took. lost: the robot did once not know
            where it was. complete: the robot itself says that it explored all.
    """

    outcome: str
    reason: str
    map: MapDifference
    duration_s: float
    distance_m: float
    cpu_s: float
    lost: bool
    complete: bool

    @property
    def home(self) -> bool:
        """Whether it is back at the start, whatever its map."""
        return self.outcome in ("reached_goal", "wrong_map")


def tour(scenario: Scenario) -> Tour:
    """Explore."""
    begin = time.process_time()
    (result,) = run_batch([scenario], threads=1, no_load=False)
    spent, difference = time.process_time() - begin, result.map_difference()
    assert difference is not None
    events = [str(event) for event in result.events]
    return Tour(
        result.outcome.value,
        "; ".join([result.reason, *events[-4:]]),
        difference,
        result.duration_s,
        result.metrics["distance_m"],
        spent,
        any(NOT_KNOWN in event for event in events),
        any(isinstance(event, ExplorationComplete) for event in result.events),
    )


def random_tour(seed: int, sense: str, folder: Path | None) -> Tour:
    """Explore a random network, or return what the folder keeps of an earlier call."""
    file = None if folder is None else folder / f"{sense}_{seed}.pickle"
    if file is not None and file.is_file():
        return pickle.loads(file.read_bytes())
    found = tour(random_exploration(seed, sense))
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_file(file, pickle.dumps(found))
    right = "same" if found.map.same else found.map
    claim = "complete by its own word" if found.complete else "not called complete"
    told = f"{sense} {seed}: {found.outcome}, {right}, {claim}, {found.cpu_s:.0f} s; {found.reason}"
    print(told, file=sys.stderr, flush=True)
    return found


def yes(fact: bool) -> str:
    """Return a fact as a word."""
    return "yes" if fact else "no"


TOUR_COLUMNS: dict[str, Callable[[Tour], str]] = {
    "outcome": lambda tour: f"`{tour.outcome}`",
    "time, s": lambda tour: f"{tour.duration_s:.0f}",
    "driven, m": lambda tour: f"{tour.distance_m:.1f}",
    "parts found": lambda tour: f"{tour.map.found} of {tour.map.parts}",
    "map right": lambda tour: yes(tour.map.same),
    "called complete": lambda tour: yes(tour.complete),
    "lengths wrong, mm": lambda tour: f"{1000 * tour.map.length_error:.0f}",
    "processor time, s": lambda tour: f"{tour.cpu_s:.0f}",
}
"""Of the table of shipped networks."""
RANDOM_HEADS = (
    "sensing",
    "home, map right",
    "95 % interval",
    "home",
    "nothing missing",
    "called complete, wrong",
    "error of all lengths: median, 90 %",
    "lost",
    "processor time",
)


def shipped_row(name: str, sense: str) -> list[str]:
    """Explore a shipped network, and return its row."""
    found = tour(override(load_scenario(name), SENSES[sense] | {"record.pictures": False}))
    return [f"`{name}`", sense, *(text(found) for text in TOUR_COLUMNS.values())]


def random_row(sense: str, tours: Sequence[Tour]) -> list[str]:
    """Return the row of a way to sense."""
    right = [tour.home and tour.map.same for tour in tours]
    claimed = [tour.map.same for tour in tours if tour.complete]
    wrong = [1000 * tour.map.length_error for tour in tours if tour.map.complete]
    middle, most = np.percentile(wrong, (50, 90)) if wrong else (np.nan, np.nan)
    return [
        sense,
        f"{sum(right)} of {len(tours)}",
        interval(right, 1),
        str(sum(tour.home for tour in tours)),
        str(sum(tour.map.complete for tour in tours)),
        f"{claimed.count(False)} of {len(claimed)}",
        f"{middle:.0f}, {most:.0f} mm",
        str(sum(tour.lost for tour in tours)),
        f"{np.median([tour.cpu_s for tour in tours]):.0f} s",
    ]


def main() -> None:
    """Explore, and print the table."""
    parser = Arguments(__doc__, trials=50, seed=SEED, workers=True)
    parser.add_argument("--missions", type=int, default=len(MISSIONS), help="shipped ones")
    parser.add_argument("--random", choices=tuple(SENSES), metavar="SENSE")
    parser.add_argument("--keep", type=Path, metavar="DIR")
    given = parser.read()
    if not given.random:
        missions = MISSIONS[: given.missions]
        rows = (shipped_row(name, sense) for name in missions for sense in ("truth", "depth"))
        table("runs", ("run", "sensing", *TOUR_COLUMNS), rows)
        return
    first = FIRST_NETWORK + (given.seed - SEED) * 1000
    explore = partial(random_tour, sense=given.random, folder=given.keep)
    tours = run_tasks(explore, range(first, first + given.trials), given.workers)
    text = f"{given.trials} trials, seed {given.seed}:"
    table(f"unknown {given.random}", RANDOM_HEADS, [random_row(given.random, tours)], text)


if __name__ == "__main__":
    main()
