"""From axes to trials, and from trials to batches.

All values are plain ones: nothing is validated here, and no route is built.
"""

from __future__ import annotations

import copy
import hashlib
import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.record.events import BackedOff, FellOff
from omnitrack_sim.record.metrics import METRICS
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import Scenario, set_value, validate
from omnitrack_sim.sim.builder import batch_key, is_shared
from omnitrack_sim.sim.run import run_batch
from omnitrack_sim.trials.axes import BASE, AxisTable, Draws, Sampling, unit_points

FORMAT = 1
"""Version of the form of part files and table; part files of another version are not used."""
Columns = dict[str, list[Any]]
"""Values of each axis, one for each trial."""


@dataclass(frozen=True)
class Trial:
    """One trial.

    Attributes:
        index: its number, from 0.
        base: name of its base scenario.
        changes: what it changes there, by dotted path.
    """

    index: int
    base: str
    changes: dict[str, Any]


@dataclass(frozen=True)
class Batch:
    """Trials that share a model and run together, with all that a worker needs.

    Attributes:
        number: from 0, in the order of the batches.
        model: short hash of the batch key.
        bases: JSON of the base scenarios, by name.
        trials: consecutive among those of one model.
    """

    number: int
    model: str
    bases: dict[str, str]
    trials: tuple[Trial, ...]

    @property
    def hash(self) -> str:
        """SHA-256 of what the rows depend on, hexadecimal, 16 digits."""
        trials = [[trial.index, trial.base, trial.changes] for trial in self.trials]
        return _sha256([FORMAT, self.bases, trials])[:16]


def matches(data: Mapping[str, Any], path: str) -> list[str]:
    """The paths in a plain scenario that ``path`` stands for.

    That is the path itself; with ``*`` in it, one path for each item of the list that has the key.
    """
    found = [""]
    for key in path.split("."):
        longer = []
        for place in found:
            inside = value_at(data, place)
            keys = (
                [str(i) for i in range(len(inside))]
                if key == "*" and isinstance(inside, list)
                else [key]
            )
            longer += [f"{place}.{k}".lstrip(".") for k in keys if has(inside, k)]
        found = longer
    return found


def has(place: Any, key: str) -> bool:
    """Whether a table or list has ``key``."""
    return (
        key in place
        if isinstance(place, dict)
        else isinstance(place, list) and key in map(str, range(len(place)))
    )


def value_at(data: Any, path: str) -> Any:
    """The value at a path that exists; for the empty path, all of ``data``."""
    for key in filter(None, path.split(".")):
        data = data[int(key)] if isinstance(data, list) else data[key]
    return data


def fitted(value: Any, present: Any) -> Any:
    """``value`` as the kind of number that it takes the place of.

    So 1 and 1.0 make the same trial.
    """
    if type(value) is int and isinstance(present, float):
        return float(value)
    if isinstance(value, float) and value.is_integer() and type(present) is int:
        return int(value)
    if isinstance(value, list | tuple):
        return [fitted(item, 0.0) if isinstance(present, list) else item for item in value]
    return value


def expand(
    bases: Mapping[str, Mapping[str, Any]],
    axes: Sequence[AxisTable],
    samples: int,
    sampling: Sampling,
    draws: Draws,
    seed: int,
) -> Columns:
    """The values of all axes, one for each trial.

    Crossed axes are combined with the first one slowest, and each combination has ``samples`` draws
    of the random axes.

    Args:
        bases: plain base scenarios by name; several make the first axis, ``BASE``.
        axes: of the sweep.
        samples: draws for each combination.
        sampling, draws, seed: how the random axes are drawn.
    """
    random = [axis for axis in axes if not axis.crossed]
    crossed = crossed_values(bases, axes)
    combinations = list(itertools.product(*crossed.values()))
    each = samples if random else 1
    sets = len(combinations) if draws == "independent" else 1
    points = unit_points(each * sets, sum(axis.dimensions for axis in random), sampling, seed)
    drawn: Columns = {}
    used = 0
    for axis in random:
        drawn[axis.name] = axis.draw(points[:, used : used + axis.dimensions])
        used += axis.dimensions
    columns: Columns = {
        name: [] for name in (*([BASE] if len(bases) > 1 else []), *(axis.name for axis in axes))
    }
    for place, combination in enumerate(combinations):
        for name, value in zip(crossed, combination, strict=True):
            columns[name] += [value] * each
        first = place % sets * each
        for name, values in drawn.items():
            columns[name] += values[first : first + each]
    return columns


def crossed_values(bases: Mapping[str, Mapping[str, Any]], axes: Sequence[AxisTable]) -> Columns:
    """The values of ``BASE``, where there are several, and of each crossed axis."""
    first = next(iter(bases.values()))
    values: Columns = {BASE: list(bases)} if len(bases) > 1 else {}
    for axis in axes:
        if axis.crossed:
            present = value_at(first, matches(first, axis.name)[0])
            values[axis.name] = [fitted(value, present) for value in axis.values_of()]
    return values


def count(bases: int, axes: Sequence[AxisTable], samples: int) -> int:
    """Number of trials."""
    combinations = bases * math.prod(axis.size for axis in axes if axis.crossed)
    return combinations * (samples if any(not axis.crossed for axis in axes) else 1)


def places_of(
    bases: Mapping[str, Mapping[str, Any]], axes: Sequence[AxisTable]
) -> dict[str, list[tuple[str, str]]]:
    """For each base, (axis name, path) of every single value that the axes set there."""
    return {
        base: [
            (axis.name, place)
            for axis in axes
            for path in axis.paths
            for place in matches(data, path)
        ]
        for base, data in bases.items()
    }


def trial_of(
    places: Mapping[str, Sequence[tuple[str, str]]], columns: Columns, index: int
) -> Trial:
    """Trial ``index`` with its changes by single paths; ``places`` as ``places_of`` gives them."""
    base = columns[BASE][index] if BASE in columns else next(iter(places))
    return Trial(index, base, {place: columns[name][index] for name, place in places[base]})


def changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a plain scenario with changes by path; the result is not checked."""
    plain = copy.deepcopy(dict(data))
    for path, value in changes.items():
        set_value(plain, path, value)
    return plain


def batches_of(
    bases: Mapping[str, Mapping[str, Any]], axes: Sequence[AxisTable], columns: Columns, size: int
) -> list[Batch]:
    """The trials of a sweep in batches of at most ``size``; those of a batch share a model."""
    places = places_of(bases, axes)
    count = len(next(iter(columns.values())))
    return batched(bases, (trial_of(places, columns, index) for index in range(count)), size)


def batched(
    bases: Mapping[str, Mapping[str, Any]], trials: Iterable[Trial], size: int, first: int = 0
) -> list[Batch]:
    """Trials in batches of at most ``size``; those of a batch share a model.

    Args:
        bases: plain base scenarios by name.
        trials: all trials of a base change the same paths.
        size: of a batch, at most.
        first: number of the first batch.
    """
    texts = {name: json.dumps(data) for name, data in bases.items()}
    # Every trial of a base sets the same paths, so one copy is changed in place for all of them.
    plain = {name: copy.deepcopy(dict(data)) for name, data in bases.items()}
    groups: dict[str, list[Trial]] = {}
    keys: dict[str, str] = {}  # of batches, by what trials share of the values that are set
    for one in trials:
        shared = {path: value for path, value in one.changes.items() if is_shared(path)}
        told = json.dumps([one.base, shared], default=str)
        if told not in keys:
            for path, value in shared.items():
                set_value(plain[one.base], path, value)
            keys[told] = batch_key(plain[one.base])
        groups.setdefault(keys[told], []).append(one)
    batches: list[Batch] = []
    for key, members in groups.items():
        for start in range(0, len(members), size):
            chosen = tuple(members[start : start + size])
            used = {name: texts[name] for name in sorted({one.base for one in chosen})}
            batches.append(Batch(first + len(batches), _sha256(key)[:12], used, chosen))
    return batches


def _sha256(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


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
