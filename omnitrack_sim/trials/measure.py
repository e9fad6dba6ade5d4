"""Objectives of a search, evaluated on the tables of its trials."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, StudyError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.trials.batches import ERROR, INVALID
from omnitrack_sim.trials.search import Measured
from omnitrack_sim.trials.search_plan import SUCCESS_RATE, Objective, SearchPlan
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import metric_columns, numbers_of

_OF_MODULES = {"mean": np.mean, "max": np.max, "min": np.min, "sum": np.sum}
LEAVE_OUT = "leave_out"
"""Default treatment of failed trials."""
LOST = (Outcome.DIVERGED.value, ERROR)
"""Outcomes of trials that ran and have no figures to be trusted."""


class Measure:
    """Evaluation of the objectives on a table of trials.

    Args:
        plan: with the objectives.
        sweeps: that the trials of a candidate are of, in their order.
    """

    def __init__(self, plan: SearchPlan, sweeps: Sequence[Sweep]):
        self.plan = plan
        self._part_of: dict[str | None, NDArray[np.bool_]] = {}
        owner = np.repeat([sweep.name for sweep in sweeps], [sweep.size for sweep in sweeps])
        for objective in plan.objectives:
            of_all = objective.trials is None
            self._part_of[objective.trials] = of_all | (owner == objective.trials)

    def __call__(self, table: pa.Table, count: int) -> list[Measured]:
        """Evaluate ``count`` candidates, whose trials stand one after the other."""
        outcome = np.array(table["outcome"].to_pylist()).reshape(count, -1)
        passed = np.array(table["success"].to_pylist(), bool).reshape(count, -1)
        invalid, lost = outcome == INVALID, np.isin(outcome, LOST)
        values = np.stack(
            [
                self._values(objective, table, passed, invalid | lost)
                for objective in self.plan.objectives
            ],
            axis=1,
        )
        return [
            Measured(
                tuple(own.tolist()),
                outcome.shape[1],
                int(passed[i].sum()),
                int(invalid[i].sum()),
                int(lost[i].sum()),
            )
            for i, own in enumerate(values)
        ]

    def _values(
        self,
        objective: Objective,
        table: pa.Table,
        passed: NDArray[np.bool_],
        without: NDArray[np.bool_],
    ) -> Array:
        """Values (C,) of one objective; ``passed`` and ``without`` (figures) are (C, T)."""
        part = self._part_of[objective.trials]
        if objective.metric == SUCCESS_RATE:
            return passed[:, part].mean(axis=1)
        figures = metric_values(objective, table).reshape(passed.shape)
        # A trial that broke must not help its candidate, as it would if it were left out.
        worst = without | ~np.isfinite(figures)
        if objective.failed == "worst":
            worst |= ~passed
        figures = np.where(worst, objective.worst_value, figures)
        counted = passed | worst if objective.failed in (None, LEAVE_OUT) else passed | True
        return np.array(
            [
                _aggregate(objective, own[part & kept])
                for own, kept in zip(figures, counted, strict=True)
            ]
        )

    def refuse_unmeasured(self, table: pa.Table) -> None:
        """Raise if an objective has no value in any completed trial.

        That is so where no trial gives its metric, or where it counts only trials that passed and
        none has: no candidate would have a value.

        Raises:
            StudyError: names each of them.
        """
        outcome = table["outcome"].to_pylist()
        ran = np.array([one not in (INVALID, *LOST) for one in outcome])
        passed = np.array(table["success"].to_pylist(), bool)
        faults = []
        for i, objective in enumerate(self.plan.objectives):
            # The trials of one candidate repeat for each of them.
            part = np.resize(self._part_of[objective.trials], len(ran)) & ran
            if objective.metric == SUCCESS_RATE or not part.any():
                continue
            if not np.isfinite(metric_values(objective, table)[part]).any():
                ran_there = counted(int(part.sum()), "trial")
                problem = f"{objective.metric!r} has no finite value in {ran_there}"
                faults.append(Fault(f"objectives.{i}.metric", problem))
            elif objective.failed != "count" and objective.worst is None and not passed[part].any():
                problem = f"{objective.metric}: no trial of the first generation passed, and with "
                problem += f"failed = {json.dumps(objective.failed or LEAVE_OUT)} only those that "
                problem += 'passed have a finite value: use failed = "count", or easier trials'
                faults.append(Fault(f"objectives.{i}", problem))
        if faults:
            raise StudyError(faults)


def metric_values(objective: Objective, table: pa.Table) -> Array:
    """Metric of an objective in each trial; NaN where a trial has none."""
    name, module = objective.metric, objective.module
    if module is None or isinstance(module, int):
        return numbers_of(table, name if module is None else f"{name}_{module}")
    each = [numbers_of(table, column) for column in metric_columns(table, name)]
    return _OF_MODULES[module](each, axis=0)


def _aggregate(objective: Objective, figures: Array) -> float:
    """Aggregate the values of trials to one number; the worst value where there are none."""
    how = objective.aggregate or "mean"
    if not len(figures):
        return objective.worst_value
    if how == "mean":
        return float(figures.mean())
    part = {"min": 0.0, "median": 0.5, "max": 1.0}.get(how)
    part = int(how[1:]) / 100 if part is None else part
    # Values are taken as they are: between an infinite one and another there is no middle.
    return float(np.quantile(figures, part, method="inverted_cdf"))
