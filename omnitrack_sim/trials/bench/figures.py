"""From the trials of all entries to the figures of the benchmark."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval, wilson_interval
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.trials.bench.entries import DEFAULT
from omnitrack_sim.trials.sweep.batch import ERROR, INVALID

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class Measure:
    """A figure of a run that passed.

    Attributes:
        name: of its columns. unit: of its values. words: what it is, short.
        columns: of the tables of sweeps, of which it is the mean: one, or one a module.
    """

    name: str
    unit: str
    words: str
    columns: tuple[str, ...]


def _of_modules(name: str, unit: str, words: str) -> Measure:
    return Measure(name, unit, words, tuple(f"{name}_{i + 1}" for i in range(MODULES)))


MEASURES = (
    Measure("duration_s", "s", "time", ("duration_s",)),
    _of_modules("slip_ratio_mean", "1", "slip"),
    Measure("energy_j", "J", "energy", ("energy_j",)),
    _of_modules("torque_change_nm_s", "N m/s", "torque change"),
    Measure("tilt_max_deg", "deg", "largest tilt", ("tilt_max_deg",)),
)
"""What is measured of the trials that an entry passed."""


@dataclass(frozen=True, eq=False)
class Trials:
    """The trials of one entry at one task.

    Attributes:
        ran: (T,) bool, they ran to an outcome. passed: (T,) bool, the robot arrived.
        outcomes: T. figures: (T,) of each measure by name; not a number where there is none.
    """

    ran: NDArray[np.bool_]
    passed: NDArray[np.bool_]
    outcomes: Sequence[str]
    figures: Mapping[str, Array]

    @classmethod
    def of(cls, table: pa.Table) -> Trials:
        """The trials of a sweep's table."""
        outcomes = table["outcome"].to_pylist()
        figures = {m.name: _mean([_numbers(table, c) for c in m.columns]) for m in MEASURES}
        return cls(
            np.array([one not in (INVALID, ERROR) for one in outcomes]),
            np.array([one == Outcome.REACHED_GOAL for one in outcomes]),
            outcomes,
            figures,
        )


def _numbers(table: pa.Table, column: str) -> Array:
    return np.array([math.nan if v is None else v for v in table[column].to_pylist()], float)


def _mean(columns: Sequence[Array]) -> Array:
    return np.mean(columns, axis=0)


def rows_of(found: Mapping[tuple[str, str], Trials]) -> list[dict[str, Any]]:
    """One row for each task and entry: rates, means, and what is different from the default.

    Differences are paired: of the success over all trials that both ran, of the other figures over
    those that both passed.

    Args:
        found: trials by (task, entry).
    """
    rows = []
    for (task, entry), trials in found.items():
        row: dict[str, Any] = {"task": task, "entry": entry, **_rates(trials)}
        for measure in MEASURES:
            own = trials.figures[measure.name][trials.passed]
            row |= _spread(measure.name, own)
        default = found.get((task, DEFAULT))
        if default is not None and entry != DEFAULT:
            row |= _differences(trials, default)
        rows.append(row)
    return rows


def _rates(trials: Trials) -> dict[str, Any]:
    counted, passed = int(trials.ran.sum()), int((trials.passed & trials.ran).sum())
    low, high = wilson_interval(passed, counted)
    others = Counter(one for one in trials.outcomes if one != Outcome.REACHED_GOAL)
    return {
        "trials": counted,
        "passed": passed,
        "success": passed / counted if counted else None,
        "success_low": low,
        "success_high": high,
        "others": ", ".join(f"{count} {name}" for name, count in sorted(others.items())),
    }


def _spread(name: str, values: Array) -> dict[str, Any]:
    """The mean of values with its interval, None where there is none."""
    low, high = mean_interval(values.tolist())
    ends = (float(np.mean(values)) if len(values) else math.nan, low, high)
    keys = (name, f"{name}_low", f"{name}_high")
    return {k: v if math.isfinite(v) else None for k, v in zip(keys, ends, strict=True)}


def _differences(trials: Trials, default: Trials) -> dict[str, Any]:
    both = trials.ran & default.ran
    gained = int((both & trials.passed & ~default.passed).sum())
    lost = int((both & ~trials.passed & default.passed).sum())
    total = int(both.sum())
    low, high = paired_rate_interval(gained, lost, total)
    row: dict[str, Any] = {
        "success_more": (gained - lost) / total if total else None,
        "success_more_low": low,
        "success_more_high": high,
    }
    passed = both & trials.passed & default.passed
    for measure in MEASURES:
        more = trials.figures[measure.name][passed] - default.figures[measure.name][passed]
        row |= _spread(f"{measure.name}_more", more)
    return row
