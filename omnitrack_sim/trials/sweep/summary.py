"""Counts and rates of a finished sweep."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.trials.sweep.batch import ERROR, INVALID
from omnitrack_sim.trials.sweep.spec import Sweep

if TYPE_CHECKING:
    import pyarrow as pa


def summarise_sweep(sweep: Sweep, table: pa.Table, makers: Collection[str]) -> dict[str, Any]:
    """The contents of ``summary.json``.

    Rates are over the trials that ran to an outcome: ``invalid`` and ``error`` are counted, but not
    in the rates.

    Args:
        sweep: the sweep that ran.
        table: all trials.
        makers: versions and commits that the batches were made by, as JSON.
    """
    outcomes = table["outcome"].to_pylist()
    columns = sweep.trials()
    groups = {}
    for name in sweep.groups:
        members: dict[str, list[str]] = {
            sweep.label(name, value): [] for value in sweep.crossed[name]
        }
        for value, outcome in zip(columns[name], outcomes, strict=True):
            members[sweep.label(name, value)].append(outcome)
        groups[name] = [{"value": label, **_rate(found)} for label, found in members.items()]
    return {
        "name": sweep.name,
        "sweep_sha256": sweep.hash,
        **_rate(outcomes),
        "outcomes": dict(sorted(Counter(outcomes).items())),
        "groups": groups,
        "provenance": {
            "seed": sweep.seed,
            "sampling": sweep.sampling,
            "samples": sweep.samples,
            "made_by": [json.loads(text) for text in sorted(makers)],
        },
    }


def _rate(outcomes: Collection[str]) -> dict[str, Any]:
    """Numbers of trials and successes, and the success rate with its Wilson 95 % interval.

    The rate is None if no trial counts.
    """
    counts = Counter(outcomes)
    counted = len(outcomes) - counts[INVALID] - counts[ERROR]
    passed = counts[Outcome.REACHED_GOAL]
    low, high = wilson_interval(passed, counted)
    return {
        "trials": len(outcomes),
        "invalid": counts[INVALID],
        "error": counts[ERROR],
        "counted": counted,
        "successes": passed,
        "success_rate": passed / counted if counted else None,
        "success_rate_95": [low, high],
    }
