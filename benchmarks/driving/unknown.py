"""Random networks explored without a map, by truth and by camera."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
from missions import random_mission

from driving.by_sensors import FRICTION, SENSES
from omnitrack_sim import Scenario, override, run_batch
from omnitrack_sim.pipes.map_difference import MapDifference
from omnitrack_sim.record.statistics import wilson_interval

FIRST_NETWORK = 9000
"""Seed of the first network; 5000 to 5035 were looked at while exploring was made."""


@dataclass(frozen=True)
class Tour:
    """What came of one exploration.

    Attributes:
        sense, seed: which one. outcome: its name. reason: in words, and the last events.
        map: how the robot's map differs from the network. duration_s: simulated time. wall_s: time
            that it took. lost: how often the robot did not know where it was.
    """

    sense: str
    seed: int
    outcome: str
    reason: str
    map: MapDifference
    duration_s: float
    wall_s: float
    lost: int

    @property
    def home(self) -> bool:
        """Whether it is back at the start."""
        return self.outcome == "reached_goal"

    @property
    def faults(self) -> str:
        """What its map has wrong, in words."""
        told = {
            "missing": self.map.missing,
            "extra": self.map.extra,
            "other kind": self.map.kinds,
            "other size": self.map.wrong_sizes,
            "other direction": self.map.angles,
            "not joined": self.map.loose,
        }
        names = {
            what: [part if isinstance(part, str) else "/".join(part) for part in parts]
            for what, parts in told.items()
        }
        return "; ".join(f"{what}: {', '.join(parts)}" for what, parts in names.items() if parts)


def random_exploration(seed: int, sense: str) -> Scenario:
    """A robot at a random end of a random network, any gravity, friction 0.8 to 1.0."""
    known = random_mission(seed, (), FRICTION)
    assert known.mission is not None
    mission = {"start": known.mission.start, "map": "unknown", "task": "explore"}
    return override(known, {"mission": mission, **SENSES[sense]})


def tour(task: tuple[str, int]) -> Tour:
    """One exploration: sense, seed."""
    sense, seed = task
    begin = time.perf_counter()
    (result,) = run_batch([random_exploration(seed, sense)], threads=1, no_load=False)
    events = [str(event) for event in result.events]
    return Tour(
        sense,
        seed,
        result.outcome.value,
        "; ".join([result.reason, *events[-4:]]),
        result.map_difference(),
        result.duration_s,
        time.perf_counter() - begin,
        sum("does not know" in event for event in events),
    )


def runs(study: str, senses: Sequence[str], trials: int, seed: int, workers: int) -> list[Tour]:
    """All explorations, by some senses."""
    first = FIRST_NETWORK + (seed - 2) * 1000
    tasks = [(sense, first + i) for sense in senses for i in range(trials)]
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        found = []
        for run in pool.map(tour, tasks):
            found.append(run)
            right = "same" if run.map.same else run.faults
            told = f"{run.sense} {run.seed}: {run.outcome}, {right}, {run.wall_s:.0f} s"
            print(told, file=sys.stderr, flush=True)
        return found


def table(tours: Sequence[Tour]) -> str:
    """One row for each sense."""
    rows = [
        "| sensing | home, and the map the same as the network | 95 % interval | home | map "
        "complete | wrong in all lengths: median, 90 % | lost on the way |",
        "| --- | --- | --- | --- | --- | --- | --- |",
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
            f"{middle:.0f}, {most:.0f} mm",
            f"{sum(run.lost > 0 for run in own)} runs",
        ]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def failures(tours: Sequence[Tour]) -> str:
    """Each run that did not come home, or whose map is wrong, with the cause."""
    return "\n".join(
        f"* {run.sense} {run.seed}: {run.outcome}; {run.faults or run.reason}"
        + (f"; {run.reason}" if run.faults and not run.home else "")
        for run in tours
        if not (run.home and run.map.same)
    )
