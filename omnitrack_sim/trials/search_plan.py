"""Plans of a search: variables between bounds, objectives, and how long it goes on."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator

from omnitrack_sim.base.bounds import MAX_NUMBER
from omnitrack_sim.base.table import Table
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.trials.axes import Number, PathTable, above_low

SUCCESS_RATE = "success_rate"
"""The objective that is no metric of a run: the part of the trials that reached the goal."""
MAX_VARIABLES, MAX_OBJECTIVES = 100, 10
DIGITS = 9
"""Significant digits of the values that are tried, so that they read the same in every file."""
Name = Annotated[str, Field(min_length=1)]
Module = Literal[1, 2, 3, "mean", "max", "min", "sum"]
"""Module of a metric that has one value for each, or how the three become one number."""


class Variable(PathTable):
    """A value of the scenarios that is varied between two bounds.

    Attributes:
        path: dotted path of a number in all base scenarios, or several that all take the value;
            `*` as in sweeps.
        low: lower bound, included.
        high: upper bound, included.
        scale: "linear": steps are alike by difference; "log": by ratio.
        start: where the search begins; none: the value of the first base scenario if it lies
            within the bounds, else the middle.
        whole: only whole numbers are tried; none: if the value of the base scenario is one.
    """

    low: Number
    high: Number
    scale: Literal["linear", "log"] = "linear"
    start: float | None = None
    whole: bool | None = None

    _is_above = field_validator("high")(above_low)

    @field_validator("scale")
    @classmethod
    def _has_a_logarithm(cls, scale: str, info: ValidationInfo) -> str:
        low = info.data.get("low")
        if scale == "log" and low is not None and low < 1 / MAX_NUMBER:
            raise ValueError(f"needs bounds of {1 / MAX_NUMBER:g} or more, and low is {low:g}")
        return scale

    @field_validator("start")
    @classmethod
    def _is_within(cls, start: float | None, info: ValidationInfo) -> float | None:
        low, high = info.data.get("low", -math.inf), info.data.get("high", math.inf)
        if start is not None and not low <= start <= high:
            raise ValueError(f"must be from low to high, {low:g} to {high:g}")
        return start

    def value_at(self, place: float) -> float | int:
        """Return the value at a place between the bounds, 0 at ``low`` and 1 at ``high``."""
        if self.scale == "log":
            # Equal steps of `place` are equal ratios.
            value = self.low * (self.high / self.low) ** place
        else:
            value = self.low + (self.high - self.low) * place
        # Rounding to digits may lead beyond a bound that has more of them.
        value = min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value

    def place_of(self, value: float) -> float:
        """Return the place of a value between the bounds, from 0 to 1."""
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class Objective(Table):
    """Objective of a search: a metric of trials made one number, or their success rate.

    Attributes:
        metric: a metric of a sweep, also one of your own, `duration_s`, `attempts`, `falls`, or
            `success_rate`, the part of the trials that reached the goal.
        goal: "minimise" or "maximise".
        name: of its columns; none: the metric.
        trials: name of the trials that count; none: all of the study.
        module: for metrics that have one value a module: 1, 2, 3, "mean", "max", "min" or "sum".
        aggregate: what becomes of the values of the trials: "mean", "median", "min", "max", or a
            percentile such as "p95"; none: the mean.
        failed: what a trial in which the robot failed counts: nothing ("leave_out"), its value
            ("count") or the worst ("worst"); none: nothing.
        worst: what a trial without a value counts; none: infinitely bad.
        limit: the worst value that a candidate may have.
        weight: how much it counts beside the others; with 0 its limit alone counts.
    """

    metric: Name
    goal: Literal["minimise", "maximise"]
    name: Name | None = None
    trials: Name | None = None
    module: Module | None = None
    aggregate: str | None = None
    failed: Literal["leave_out", "count", "worst"] | None = None
    worst: Number | None = None
    limit: Number | None = None
    weight: Annotated[float, Field(ge=0, le=1e6)] = 1.0

    @field_validator("aggregate")
    @classmethod
    def _is_known(cls, aggregate: str | None) -> str | None:
        if aggregate is not None and not re.fullmatch(r"mean|median|min|max|p\d\d?", aggregate):
            raise ValueError("is none of mean, median, min, max and percentiles such as p95")
        return aggregate

    @property
    def sign(self) -> float:
        """Factor that makes smaller values the better ones."""
        return 1.0 if self.goal == "minimise" else -1.0

    @property
    def worst_value(self) -> float:
        """Value that a trial without one counts as."""
        return self.sign * math.inf if self.worst is None else self.worst


class SearchPlan(Table):
    """Plan of a search: its variables, objectives and extent.

    Attributes:
        variables: what is varied.
        objectives: what is asked for, at most ten.
        generations: how often each search asks for candidates.
        population: how many it asks for, at least 4; more of them bear more noise; none:
            4 + 3 ln(number of variables), as CMA-ES has it.
        directions: how many searches there are, each for another weighing of the objectives; none:
            1 for one objective, else twice their number and 1.
        step: standard deviation of the first candidates about the start, as part of the range.
        seed: of the candidates.
    """

    variables: Annotated[tuple[Variable, ...], Field(min_length=1, max_length=MAX_VARIABLES)]
    objectives: Annotated[tuple[Objective, ...], Field(min_length=1, max_length=MAX_OBJECTIVES)]
    generations: Annotated[int, Field(ge=1, le=100_000)] = 20
    population: Annotated[int, Field(ge=4, le=10_000)] | None = None
    directions: Annotated[int, Field(ge=1, le=100)] | None = None
    step: Annotated[float, Field(ge=1e-6, le=10)] = 0.25
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @property
    def weighed(self) -> tuple[int, ...]:
        """Indices of the objectives that are more than a limit."""
        return tuple(i for i, objective in enumerate(self.objectives) if objective.weight > 0)

    @property
    def search_count(self) -> int:
        """Number of searches."""
        if self.directions is not None:
            return self.directions
        return 1 if len(self.weighed) == 1 else 2 * len(self.weighed) + 1

    @property
    def asked_each(self) -> int:
        """Candidates that a search asks for in a generation."""
        return self.population or 4 + math.floor(3 * math.log(len(self.variables)))

    @property
    def candidate_count(self) -> int:
        """Candidates of the whole search: the start, the generations, and the centres."""
        return 1 + self.search_count * (self.generations * self.asked_each + 1)

    def max_checked(self, best: int) -> int:
        """Return the largest number of candidates of a check; 0 where there is none.

        These are the ``best`` ones of each search, its centre, and the start.
        """
        return 1 + self.search_count * (best + 1) if best else 0


OF_TRIALS = {"duration_s": "s", "attempts": "1", "falls": "1"}
"""Figures of a trial beside its metrics, with their units."""


def metrics_of(bases: Sequence[Scenario]) -> dict[str, Metric]:
    """Return all metrics of trials of these scenarios, by name."""
    return {metric.name: metric for base in bases for metric in base.all_metrics}
