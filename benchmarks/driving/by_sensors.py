"""Tee turns from any orientation, and missions through random networks, by truth and by camera."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from missions import random_mission
from tee_turns import random_tee_turns

from omnitrack_sim import Result, Scenario, override, run_batch
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.record.statistics import wilson_interval

SENSES = {
    "truth": {"sensing.kind": "truth"},
    "depth": {"sensing.kind": "onboard", "sensing.camera": "depth"},
    "headlight": {"sensing.kind": "onboard", "sensing.camera": "headlight"},
}
FRICTION = (0.8, 1.0)
FIRST_NETWORK = 7000
"""Seed of the first network; 5000 to 5035 were looked at while the filter was made."""
TOGETHER = 25
"""Tee turns in one batch."""


@dataclass(frozen=True)
class Drive:
    """What came of one run.

    Attributes:
        study, sense, number: which one. outcome: its name. reason: in words, and the last events.
        error: localisation_error_rel. largest: m, localisation_error_max_m. theta5: deg,
            theta5_error_p95_deg. at_turn: deg, error of theta5 as the first turn begins. lost: how
            often the robot did not know where it was. Not numbers for runs by truth.
    """

    study: str
    sense: str
    number: int
    outcome: str
    reason: str
    error: float
    largest: float
    theta5: float
    at_turn: float
    lost: int


def _drive(study: str, sense: str, number: int, result: Result) -> Drive:
    figures = {
        name: float(result.metrics.get(name, math.nan))  # type: ignore[arg-type]
        for name in ("localisation_error_rel", "localisation_error_max_m", "theta5_error_p95_deg")
    }
    events = [str(event) for event in result.events]
    told = "; ".join([result.reason, *events[-4:]])
    lost = sum("does not know" in event for event in events)
    return Drive(
        study,
        sense,
        number,
        result.outcome.value,
        told,
        *figures.values(),
        _error_at_turn(result),
        lost,
    )


def _error_at_turn(result: Result) -> float:
    """Error of theta5, deg, as the first turn into a branch or round a bend begins."""
    found, phases = result.trajectory.channels, result.trajectory.phases
    turning = np.isin(found["phase"], [phases.index("tee_turn"), phases.index("elbow")])
    if "theta5_estimate" not in found or not turning.any():
        return math.nan
    first = int(turning.argmax())
    error = found["theta5_estimate"][first] - found["theta5"][first]
    return abs(math.degrees((error + math.pi) % (2 * math.pi) - math.pi))


def turns(task: tuple[str, int, int, int]) -> list[Drive]:
    """Some of the random tee turns from any orientation: sense, seed, first and number."""
    sense, seed, first, count = task
    changes = {
        "control.align": True,
        "control.retry": True,
        **SENSES[sense],
    }
    every = random_tee_turns(
        first + count, seed=seed, friction=FRICTION, theta5_deg=180.0, changes=changes
    )
    found = run_batch(every[first:], threads=1, no_load=False)
    return [_drive("turns", sense, first + i, result) for i, result in enumerate(found)]


def mission(task: tuple[str, int]) -> list[Drive]:
    """A random mission in a random network: sense, seed."""
    sense, seed = task
    scenario: Scenario = override(random_mission(seed, (), FRICTION), SENSES[sense])
    (result,) = run_batch([scenario], threads=1, no_load=False)
    return [_drive("missions", sense, seed, result)]


def runs(study: str, senses: Sequence[str], trials: int, seed: int, workers: int) -> list[Drive]:
    """All runs of a study, by some senses."""
    with LocalPool(workers) as pool:
        if study == "turns":
            batches = [
                (sense, seed, first, min(TOGETHER, trials - first))
                for sense in senses
                for first in range(0, trials, TOGETHER)
            ]
            found = pool.map(turns, batches)
        else:
            begin = FIRST_NETWORK + (seed - 2) * 1000
            found = pool.map(mission, [(s, begin + i) for s in senses for i in range(trials)])
        return [drive for part in found for drive in part]


def table(drives: Sequence[Drive]) -> str:
    """One row for each sense."""
    rows = [
        "| sensing | arrived | 95 % interval | localisation error: median, 90 % | largest error: "
        "median, 90 % | error of theta5 at the first turn: median, 95 % | lost on the way |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for sense in dict.fromkeys(run.sense for run in drives):
        own = [run for run in drives if run.sense == sense]
        good = [run for run in own if run.outcome == "reached_goal"]
        low, high = wilson_interval(len(good), len(own))
        cells = [sense, f"{len(good)} of {len(own)}", f"{100 * low:.1f} to {100 * high:.1f} %"]
        if sense == "truth":
            cells += ["-"] * 4
        else:
            cells += [
                _two([100 * run.error for run in own], (50, 90), "%", 2),
                _two([1000 * run.largest for run in own], (50, 90), "mm", 0),
                _two([run.at_turn for run in own], (50, 95), "deg", 1),
                f"{sum(run.lost > 0 for run in own)} runs",
            ]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _two(values: Sequence[float], parts: tuple[int, int], unit: str, digits: int) -> str:
    known = np.array([value for value in values if math.isfinite(value)])
    low, high = np.percentile(known, parts)
    return f"{low:.{digits}f}, {high:.{digits}f} {unit}"


def failures(drives: Sequence[Drive]) -> str:
    """Each run that did not arrive, with its cause."""
    rows = [
        f"* {run.study} {run.number}, {run.sense}: {run.outcome}; {run.reason}"
        for run in drives
        if run.outcome != "reached_goal"
    ]
    return "\n".join(rows)
