"""What a worker does: run the trials of a batch and tell how they ended. It writes nothing."""

from __future__ import annotations

import json
import math
from typing import Any

from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.record.events import BackedOff, FellOff
from omnitrack_sim.record.metrics import METRICS
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.trials.sweep.trials import Batch, changed

INVALID, ERROR = "invalid", "error"
"""Outcomes of trials without a run: values that do not fit, a fault of program or worker."""
Row = dict[str, Any]
"""Result columns of a trial by name, and ``trial``; a column that is not there is null."""


def run_trials(batch: Batch) -> tuple[list[Row], dict[str, Any]]:
    """Run the trials of a batch on one thread.

    A trial whose values do not fit becomes a row ``invalid``. After an exception the trials are run
    again, each alone, which gives the same numbers; one that fails alone becomes a row ``error``.

    Returns:
        Rows in the order of the trials, and what made them (versions, commit).
    """
    rows: dict[int, Row] = {}
    scenarios: dict[int, Scenario] = {}
    plain = {name: json.loads(text) for name, text in batch.bases.items()}
    for trial in batch.trials:
        try:
            scenarios[trial.index] = validate(changed(plain[trial.base], trial.changes))
        except ScenarioError as error:
            rows[trial.index] = failed_row(trial.index, INVALID, "; ".join(str(error).splitlines()))
    rows |= _together(scenarios)
    return [rows[trial.index] for trial in batch.trials], environment()


def failed_row(index: int, outcome: str, reason: str) -> Row:
    """The row of a trial that did not run to an outcome."""
    return {"trial": index, "outcome": outcome, "success": False, "reason": reason}


def _together(scenarios: dict[int, Scenario]) -> dict[int, Row]:
    try:
        results = run_batch(list(scenarios.values()), threads=1, no_load=False)
        return {
            index: _row(index, result) for index, result in zip(scenarios, results, strict=True)
        }
    except Exception as error:
        if len(scenarios) == 1:
            (index,) = scenarios
            return {index: failed_row(index, ERROR, f"{type(error).__name__}: {error}")}
        rows: dict[int, Row] = {}
        for index, scenario in scenarios.items():
            rows |= _together({index: scenario})
        return rows


def _row(index: int, result: Result) -> Row:
    row: Row = {
        "trial": index,
        "scenario_sha256": result.scenario.hash,
        "outcome": result.outcome.value,
        "success": result.success,
        "duration_s": _finite(result.duration_s),
        "reason": result.reason,
        "attempts": 1 + sum(isinstance(event, BackedOff) for event in result.events),
        "falls": sum(isinstance(event, FellOff) for event in result.events),
        "collider": result.provenance["collider"],
        "events": " | ".join(map(str, result.events)),
    }
    for metric in (*METRICS, *result.scenario.own_metrics):
        value = result.metrics[metric.name]
        if isinstance(value, list):
            row |= {f"{metric.name}_{i}": _finite(item) for i, item in enumerate(value, start=1)}
        elif metric.in_tables:
            assert not isinstance(value, dict)
            row[metric.name] = _finite(value)
    return row


def _finite(value: float) -> float | None:
    """A number, or None where a diverged run has left no finite one."""
    return value if math.isfinite(value) else None
