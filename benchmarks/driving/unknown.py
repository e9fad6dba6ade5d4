"""Random networks explored without a map, by truth and by camera.

Networks have 8 to 14 fittings. A part of their straights is left out, so that fittings follow each
other directly, a part of their tees are wyes, half of them have reducers, and a quarter are
loops with pipes of random lengths.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from driving.by_sensors import FRICTION, SENSES
from omnitrack_sim import (
    Network,
    Scenario,
    load_network,
    override,
    random_network,
    run_batch,
)
from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.base.writing import write_file
from omnitrack_sim.pipes import network as networks
from omnitrack_sim.pipes.map_difference import MapDifference
from omnitrack_sim.record.events import ExplorationComplete
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.scenario import validate

FIRST_NETWORK = 9000
"""Seed of the first network; 5000 to 5035 and 8000 to 8020 were looked at while exploring was
made."""
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


@dataclass(frozen=True)
class Tour:
    """What came of one exploration.

    Attributes:
        sense, seed: which one. outcome: its name. reason: in words, and the last events.
        map: how the robot's map differs from the network. duration_s: simulated time. cpu_s:
            processor time that it took. lost: how often the robot did not know where it was.
        complete: the robot itself says that it explored all.
    """

    sense: str
    seed: int
    outcome: str
    reason: str
    map: MapDifference
    duration_s: float
    cpu_s: float
    lost: int
    complete: bool

    @property
    def home(self) -> bool:
        """Whether it is back at the start, whatever its map."""
        return self.outcome in ("reached_goal", "wrong_map")


def random_exploration(seed: int, sense: str) -> Scenario:
    """A robot at a random end of a random network, any gravity, friction 0.8 to 1.0."""
    rng = np.random.default_rng([seed, 4])
    network = loop(rng) if rng.random() < LOOPS else tree(seed, rng)
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    start = str(rng.choice(list(network.open_ends)))
    scenario = validate(
        {
            "network": network.model_dump(mode="json"),
            "mission": {"start": start, "map": "unknown", "task": "explore"},
            "start": {"theta5_deg": float(rng.uniform(-180, 180))},
            "world": {"friction": float(rng.uniform(*FRICTION)), "gravity": gravity.tolist()},
        }
    )
    return override(scenario, SENSES[sense])


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


def tour(task: tuple[str, int]) -> Tour:
    """One exploration: sense, seed."""
    sense, seed = task
    begin = time.process_time()
    (result,) = run_batch([random_exploration(seed, sense)], threads=1, no_load=False)
    events, difference = [str(event) for event in result.events], result.map_difference()
    assert difference is not None
    return Tour(
        sense,
        seed,
        result.outcome.value,
        "; ".join([result.reason, *events[-4:]]),
        difference,
        result.duration_s,
        time.process_time() - begin,
        sum("does not know" in event for event in events),
        any(isinstance(event, ExplorationComplete) for event in result.events),
    )


def kept_tour(task: tuple[str, int, Path | None]) -> Tour:
    """One exploration: sense, seed, and the folder where it is kept, from an earlier call too."""
    sense, seed, folder = task
    if folder is None:
        return tour((sense, seed))
    file = folder / f"{sense}_{seed}.pickle"
    if not file.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        write_file(file, pickle.dumps(tour((sense, seed))))
    found = pickle.loads(file.read_bytes())
    assert isinstance(found, Tour)
    return found


def runs(
    senses: Sequence[str], trials: int, seed: int, workers: int, keep: Path | None
) -> list[Tour]:
    """All explorations, by some senses; those in the folder ``keep`` are not made again."""
    first = FIRST_NETWORK + (seed - 2) * 1000
    tasks = [(sense, first + i, keep) for sense in senses for i in range(trials)]
    with LocalPool(workers) as pool:
        found = []
        for run in pool.map(kept_tour, tasks):
            found.append(run)
            right = "same" if run.map.same else run.map
            claim = "complete by its own word" if run.complete else "not called complete"
            told = f"{run.sense} {run.seed}: {run.outcome}, {right}, {claim}, {run.cpu_s:.0f} s"
            print(told, file=sys.stderr, flush=True)
        return found


def table(tours: Sequence[Tour]) -> str:
    """One row for each sense."""
    rows = [
        "| sensing | home, map right | 95 % interval | home | nothing missing | called complete, "
        "wrong | error of all lengths: median, 90 % | lost | processor time |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for sense in dict.fromkeys(run.sense for run in tours):
        own = [run for run in tours if run.sense == sense]
        good = sum(run.home and run.map.same for run in own)
        low, high = wilson_interval(good, len(own))
        wrong = [1000 * run.map.length_error for run in own if run.map.complete]
        middle, most = np.percentile(wrong, (50, 90)) if wrong else (np.nan, np.nan)
        cells = [
            sense,
            f"{good} of {len(own)}",
            f"{100 * low:.1f} to {100 * high:.1f} %",
            f"{sum(run.home for run in own)}",
            f"{sum(run.map.complete for run in own)}",
            f"{sum(run.complete and not run.map.same for run in own)} of "
            f"{sum(run.complete for run in own)}",
            f"{middle:.0f}, {most:.0f} mm",
            f"{sum(run.lost > 0 for run in own)}",
            f"{np.median([run.cpu_s for run in own]):.0f} s",
        ]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def failures(tours: Sequence[Tour]) -> str:
    """Each run that did not come home, or whose map is wrong, with the cause."""
    return "\n".join(
        f"* {run.sense} {run.seed}: {run.outcome}; {run.map if not run.map.same else run.reason}"
        + ("" if run.map.same or run.home else f"; {run.reason}")
        for run in tours
        if not (run.home and run.map.same)
    )
