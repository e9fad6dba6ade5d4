"""How long trials will take, from a fraction of a second of each robot on this machine."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import InputError, ScenarioError
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.scenario.model import max_seconds, min_seconds
from omnitrack_sim.sim.builder import batch_key
from omnitrack_sim.sim.simulation import Simulation
from omnitrack_sim.trials.batches import Batch, Trial, changed
from omnitrack_sim.trials.plan import Plan
from omnitrack_sim.trials.store import read_part

STEPS = 20
"""Control steps by which the pace of a robot is measured: of a batch of 16 a tenth of a second."""
MAX_MEASURED = 16
"""Robots that are measured, two seconds each with their models; further ones take their mean."""


@dataclass(frozen=True)
class Estimate:
    """Extent of the trials of a plan.

    Attributes:
        trials: their number.
        done: trials that a folder holds already.
        shortest: s of computing for the rest, if every robot cruises to its goal without a stop.
        longest: the same if every robot runs to its time limit.
    """

    trials: int
    done: int
    shortest: float
    longest: float


@dataclass(frozen=True)
class _Pace:
    """CPU time, s, of a batch.

    Attributes:
        fixed: of its model and the settling of its robots.
        each: of a simulated second of one robot.
    """

    fixed: float
    each: float


def estimate(plan: Plan, folder: Path | None = None) -> Estimate:
    """Return how many trials a plan has and how long one process of this machine takes for them.

    Args:
        plan: a study's check, and generations of other values, count as its first generation does.
        folder: whose finished batches are left out.

    Raises:
        InputError: the plan cannot be run.
    """
    asked = next(plan.rounds())
    count = sum(len(batch.trials) for batch in asked.batches)
    total = max(count, asked.total or 0)
    unique = {batch.hash: batch for batch in asked.batches}.values()
    left = [b for b in unique if folder is None or read_part(folder, b) is None]
    there = count - sum(len(batch.trials) for batch in left)
    ends = np.zeros(2)
    robots: dict[str, list[tuple[Batch, Scenario]]] = defaultdict(list)
    for batch in left:
        scenario = _first(batch)
        if scenario is not None:
            robots[_robot_of(scenario)].append((batch, scenario))
    paces = _paces(robots)
    for name, own in robots.items():
        for batch, scenario in own:
            seconds = np.array([min_seconds(scenario), max_seconds(scenario)])
            ends += paces[name].fixed + paces[name].each * len(batch.trials) * seconds
    share = (total - there) / max(count - there, 1)
    shortest, longest = (ends * share).tolist()
    return Estimate(total, there, shortest, longest)


def _paces(robots: dict[str, list[tuple[Batch, Scenario]]]) -> dict[str, _Pace]:
    """Measure the pace of the first batch of each robot; others have the mean of these."""
    measured: dict[str, _Pace] = {}
    for name, own in list(robots.items())[:MAX_MEASURED]:
        pace = _measured(max(own, key=lambda one: len(one[0].trials))[0])
        if pace is not None:
            measured[name] = pace
    count = max(len(measured), 1)
    fixed = sum(pace.fixed for pace in measured.values()) / count
    each = sum(pace.each for pace in measured.values()) / count
    return {name: measured.get(name, _Pace(fixed, each)) for name in robots}


def _measured(batch: Batch) -> _Pace | None:
    """Measure the pace of a batch; None where none of its robots fits its pipe."""
    scenarios = [one for trial in batch.trials if (one := _scenario(batch, trial)) is not None]
    begin = time.process_time()
    try:
        simulation = Simulation(scenarios, threads=1, recording=False)
    except InputError:
        return None
    made = time.process_time()
    for _ in range(STEPS):
        simulation.step()
    simulated = STEPS * simulation.period * len(scenarios)
    return _Pace(made - begin, (time.process_time() - made) / simulated)


def _first(batch: Batch) -> Scenario | None:
    """Return the scenario of the first valid trial of a batch; None without one."""
    return next((one for t in batch.trials if (one := _scenario(batch, t)) is not None), None)


def _scenario(batch: Batch, trial: Trial) -> Scenario | None:
    try:
        return validate(changed(json.loads(batch.bases[trial.base]), trial.changes))
    except ScenarioError:
        return None


def _robot_of(scenario: Scenario) -> str:
    """Text of what the pace depends on most: robots that differ in their own values have one."""
    data: dict[str, Any] = scenario.model_dump(mode="json", include={"robot", "physics", "sensing"})
    return batch_key({**data, "control": scenario.control.kind})
