"""Batches: trials that share a model and run together, and the rows that a worker returns."""

from __future__ import annotations

import copy
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

from omnitrack_sim.base.errors import InputError, ScenarioError
from omnitrack_sim.base.text import finite
from omnitrack_sim.record.events import BackedOff, FellOff
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import Scenario, kinds_first, set_value, validate
from omnitrack_sim.sim.builder import batch_key, is_shared, robot_kind
from omnitrack_sim.sim.run import run_batch

FORMAT = 2
"""Version of the form of part files and table; part files of another version are not used."""
INVALID, ERROR = "invalid", "error"
"""Outcomes of trials without a run: values that do not fit, a fault of program or worker."""
Row = dict[str, Any]
"""Result columns of a trial by name; a missing column is null."""
Measure = Callable[[Result], Mapping[str, float]]
"""Further columns of a trial, by name, from its result: a function of a module, since workers
import it, for what no metric of the scenario says."""


@dataclass(frozen=True)
class Trial:
    """One trial.

    Attributes:
        index: its place among the trials that are asked for together, from 0.
        base: name of its base scenario.
        changes: values of the trial by dotted path, each path to a single value.
    """

    index: int
    base: str
    changes: dict[str, Any]


@dataclass(frozen=True)
class Batch:
    """Trials that share a model and run together, with all data that a worker needs.

    Attributes:
        model: short hash of the batch key.
        bases: JSON of the base scenarios, by name.
        trials: in the order of their indices.
        measure: adds columns to the rows of those that ran; none: it adds none.
    """

    model: str
    bases: dict[str, str]
    trials: tuple[Trial, ...]
    measure: Measure | None = None

    @cached_property
    def hash(self) -> str:
        """SHA-256 of everything that the rows depend on, hexadecimal, 16 digits."""
        trials = [[trial.base, trial.changes] for trial in self.trials]
        own = [] if self.measure is None else [self.measure.__module__, self.measure.__qualname__]
        return sha256_of([FORMAT, self.bases, trials, *own])[:16]


class Rows(NamedTuple):
    """Results of the trials of a batch.

    Attributes:
        rows: in the order of the trials.
        units: units of the metrics and measures that these hold, by the names of their columns;
            empty where there is none.
        made_by: versions and commit.
    """

    rows: Sequence[Row]
    units: Mapping[str, str]
    made_by: Mapping[str, Any]


def sha256_of(value: Any) -> str:
    """Return the SHA-256 of plain data, hexadecimal."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def fitted(value: Any, present: Any) -> Any:
    """Return ``value`` as the kind of number that it replaces, so that 1 and 1.0 are one trial."""
    # JSON writes 1 and 1.0 differently, and the hash of a batch is made of JSON.
    if type(value) is int and isinstance(present, float):
        return float(value)
    if isinstance(value, float) and value.is_integer() and type(present) is int:
        return int(value)
    if isinstance(value, list | tuple):
        return [fitted(item, 0.0) if isinstance(present, list) else item for item in value]
    return value


def changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a plain scenario with changes by path; the result is not checked."""
    plain = copy.deepcopy(dict(data))
    for path, value in kinds_first(changes).items():
        set_value(plain, path, value)
    return plain


def batched(
    bases: Mapping[str, Mapping[str, Any]],
    trials: Iterable[Trial],
    size: int,
    measure: Measure | None = None,
) -> list[Batch]:
    """Group trials into batches of at most ``size``; those of a batch share a model.

    Args:
        bases: plain base scenarios by name.
        trials: all trials of a base change the same paths.
        size: of a batch, at most.
        measure: see ``Batch``.
    """
    # Workers get text: it is quick to send, and what the hash of a batch is made of.
    texts = {name: json.dumps(data) for name, data in bases.items()}
    # Every trial of a base sets the same paths, so one copy is changed in place for all of them.
    plain = {name: copy.deepcopy(dict(data)) for name, data in bases.items()}
    groups: dict[str, list[Trial]] = {}
    keys: dict[str, str] = {}  # batch keys, by base and those values that decide them
    kinds = {name: robot_kind(data) for name, data in bases.items()}
    for one in trials:
        kind = str(one.changes.get("robot.kind", kinds[one.base]))
        shared = {path: value for path, value in one.changes.items() if is_shared(path, kind)}
        group = json.dumps([one.base, shared], default=str)
        if group not in keys:
            for path, value in kinds_first(shared).items():
                set_value(plain[one.base], path, value)
            keys[group] = batch_key(plain[one.base])
        groups.setdefault(keys[group], []).append(one)
    batches: list[Batch] = []
    for key, members in groups.items():
        # Consecutive trials in fixed numbers: the batches do not depend on workers or
        # interruptions, so that their files are found again.
        for start in range(0, len(members), size):
            chosen = tuple(members[start : start + size])
            used = {name: texts[name] for name in sorted({one.base for one in chosen})}
            batches.append(Batch(sha256_of(key)[:12], used, chosen, measure))
    return batches


def run_rows(batch: Batch) -> Rows:
    """Run the trials of a batch on one thread; nothing is written.

    A trial whose values do not fit becomes a row ``invalid``. After an exception the trials are run
    again, each alone, which gives the same numbers; one that fails alone becomes a row ``error``.
    """
    rows: dict[int, Row] = {}
    scenarios: dict[int, Scenario] = {}
    plain = {name: json.loads(text) for name, text in batch.bases.items()}
    for place, trial in enumerate(batch.trials):
        try:
            # In the worker, so that the checks of many scenarios are shared among the cores.
            scenarios[place] = validate(changed(plain[trial.base], trial.changes))
        except ScenarioError as error:
            rows[place] = failed_row(INVALID, "; ".join(str(error).splitlines()))
    units: dict[str, str] = {}
    rows |= _rows_of(scenarios, units, batch.measure)
    return Rows([rows[place] for place in range(len(batch.trials))], units, environment())


def failed_row(outcome: str, reason: str) -> Row:
    """Return the row of a trial that did not run to an outcome of the robot."""
    return {"outcome": outcome, "success": False, "reason": reason}


def _rows_of(
    scenarios: dict[int, Scenario], units: dict[str, str], measure: Measure | None
) -> dict[int, Row]:
    """Rows of scenarios by their places; the units of their metrics are added to ``units``."""
    try:
        # One thread, for there are as many workers as cores; the slip without load needs a run of
        # its own for each friction, and is left out.
        results = run_batch(list(scenarios.values()), threads=1, no_load=False)
        return {
            place: _row(result, units, measure)
            for place, result in zip(scenarios, results, strict=True)
        }
    except Exception as error:
        # A fault of one trial would otherwise cost all those that share its batch.
        if len(scenarios) == 1:
            (place,) = scenarios
            if isinstance(error, InputError):
                # A robot that does not fit its pipe shows it only once it has settled there.
                return {place: failed_row(INVALID, "; ".join(str(error).splitlines()))}
            return {place: failed_row(ERROR, f"{type(error).__name__}: {error}")}
        rows: dict[int, Row] = {}
        for place, scenario in scenarios.items():
            rows |= _rows_of({place: scenario}, units, measure)
        return rows


def _row(result: Result, units: dict[str, str], measure: Measure | None) -> Row:
    row: Row = {
        "scenario_sha256": result.scenario.hash,
        "outcome": result.outcome.value,
        "success": result.success,
        "duration_s": result.duration_s,
        "reason": result.reason,
        "attempts": 1 + sum(isinstance(event, BackedOff) for event in result.events),
        "falls": sum(isinstance(event, FellOff) for event in result.events),
        "collider": result.provenance["collider"],
        "events": " | ".join(map(str, result.events)),
    }
    for metric in result.scenario.all_metrics:
        if not metric.in_tables:
            continue
        value = result.metrics[metric.name]
        columns = {metric.name: value}
        if isinstance(value, list):
            columns = {f"{metric.name}_{i}": item for i, item in enumerate(value, start=1)}
        row |= columns
        units |= dict.fromkeys(columns, metric.unit)
    if measure is not None:
        own = measure(result)
        row |= own
        units |= dict.fromkeys(own, "")
    # A diverged run has left figures that are not finite.
    return finite(row)
