"""A small study, and an evaluator without a simulator, for the tests of studies."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.trials.search import Candidate, History, Measured, Search
from omnitrack_sim.trials.search_plan import Objective, SearchPlan, Variable
from omnitrack_sim.trials.study import Study
from omnitrack_sim.trials.study_file import resolve

TEXT = """
generations = 2
population = 4
directions = 2
[[trials]]
base = "straight"
samples = 2
batch = {batch}
[trials.set]
"run.time_limit" = 0.02
"robot.lugs_per_track" = 3
"control.kind" = "{kind}"
[[trials.axes]]
path = "world.friction"
kind = "uniform"
low = 0.5
high = 1.0
[[variables]]
path = "control.cruise_speed"
low = 0.02
high = 0.2
scale = "log"
[[variables]]
path = "robot.preload"
low = 5
high = 30
[[objectives]]
metric = "distance_m"
goal = "maximise"
failed = "count"
[[objectives]]
metric = "torque_rms_nm"
goal = "minimise"
module = "mean"
failed = "count"
[final]
candidates = 1
samples = 3
"""


def study_data() -> dict[str, Any]:
    """The small study as plain data."""
    return {"name": "small"} | tomllib.loads(TEXT.format(kind="jacobian", batch=10))


def small_study(**changes: Any) -> Study:
    """19 candidates of 2 trials each; ``changes`` replace keys of the file."""
    return resolve(study_data() | changes)


def write_study(folder: Path, kind: str = "jacobian", batch: int = 10) -> Path:
    """The file of the same, or of one with another controller and other batches."""
    path = folder / "small.toml"
    path.write_text(TEXT.format(kind=kind, batch=batch), encoding="utf-8")
    return path


def explore(
    plan: SearchPlan, evaluate: Callable[[Sequence[Candidate]], Sequence[Measured]]
) -> History:
    """The history of a whole search whose candidates a function evaluates."""
    search = Search(plan)
    while candidates := search.ask():
        search.tell(evaluate(candidates))
    return search.history


OPTIMUM = (0.3, 0.62, 0.8)
"""Where the quadratic has its least value, as places between the bounds."""


def quadratic_plan(**changes: Any) -> SearchPlan:
    """Three variables of different scales, and the value of a quadratic."""
    variables = (
        Variable(path="a", low=-1, high=3, start=-0.8),
        Variable(path="b", low=0.01, high=100, scale="log", start=1.0),
        Variable(path="c", low=0, high=10, start=9),
    )
    fields = {"variables": variables, "objectives": (Objective(metric="f", goal="minimise"),)}
    return SearchPlan(**(fields | changes))


def places(plan: SearchPlan, candidate: Candidate) -> np.ndarray:
    """Where the values of a candidate stand between the bounds (n,)."""
    pairs = zip(plan.variables, candidate.values, strict=True)
    return np.array([variable.place_of(value) for variable, value in pairs])


def noisy_quadratic(plan: SearchPlan, noise: float, seed: int):
    """An evaluator of the quadratic; the standard deviation of its noise is that of one trial in
    64, whose mean is the value."""
    draws = np.random.default_rng(seed)

    def evaluate(candidates: Sequence[Candidate]) -> list[Measured]:
        found = []
        for one in candidates:
            value = ((places(plan, one) - OPTIMUM) ** 2 * [1, 4, 2]).sum()
            found.append(Measured((float(value + noise * draws.standard_normal(64).mean()),)))
        return found

    return evaluate
