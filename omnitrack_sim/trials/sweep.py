"""Sweeps: plans of trials, from axes over base scenarios."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from omnitrack_sim.base.bounds import MAX_AXES, MAX_BATCH, MAX_TRIALS
from omnitrack_sim.base.errors import SweepError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.reading import NAME_PATTERN
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import counted
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.robots.recorded import is_recorded, values_of
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.scenario.model import unit_of
from omnitrack_sim.trials.axes import (
    BASE,
    Axis,
    AxisTable,
    Draws,
    GridAxis,
    ListAxis,
    Sampling,
    unit_points,
)
from omnitrack_sim.trials.batches import (
    ERROR,
    FORMAT,
    INVALID,
    Batch,
    Trial,
    batched,
    changed,
    fitted,
    sha256_of,
)
from omnitrack_sim.trials.plan import Conclusion, Plan, Round, Rounds

if TYPE_CHECKING:
    import pyarrow as pa

MAX_LISTED, MAX_GRID = 12, 24
"""Most values of a list or grid axis that makes groups in the summary if the file names none."""
FOR_THE_RECORD = ("name", "group_by", "set")
"""Keys of a resolved sweep that its table does not depend on."""


class SweepTable(Table):
    """The keys that a sweep file and a resolved sweep share.

    Attributes:
        name: names the folder below `out/`; a file's own name if left out.
        seed: of the draws.
        samples: draws of the random axes for each combination of the crossed ones.
        sampling: how they are drawn: "random", "latin_hypercube" or "sobol" (scrambled; balanced
            when `samples` is a power of two).
        draws: "common": every combination of the crossed axes gets the same draws;
            "independent": each its own.
        batch: trials of a batch, and of a part file.
        group_by: axes by whose values the summary counts; left out: list axes of up to 12 values
            and grid axes of up to 24.
        axes: what is varied.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    samples: Annotated[int, Field(ge=1, le=MAX_TRIALS)] = 1
    sampling: Sampling = "random"
    draws: Draws = "common"
    batch: Annotated[int, Field(ge=1, le=MAX_BATCH)] = 32
    group_by: tuple[str, ...] | None = None
    axes: Annotated[tuple[Axis, ...], Field(max_length=MAX_AXES)] = ()


class Sweep(SweepTable, Plan):
    """A plan of trials: base scenarios, and axes over which their values are varied.

    Attributes:
        bases: base scenarios in full, with all changes, by name; several make the axis ``base``.
        set: the changes, for the record.

    Example:
        >>> sweep = ot.load_sweep("tee_orientation")
        >>> sweep.size
        120
        >>> sweep.scenario(60).start.theta5_deg == sweep.trials()["start.theta5_deg"][60]
        True
    """

    noun: ClassVar[str] = "sweep"
    figure: ClassVar[str] = "success_map.png"
    free: ClassVar[tuple[str, ...]] = FOR_THE_RECORD
    bases: dict[str, Scenario]
    set: dict[str, Any]

    def __repr__(self) -> str:
        axes = ", ".join(axis.name for axis in self.axes) or "no axes"
        bases = ", ".join(self.bases)
        return f"Sweep({self.name!r}: {counted(self.size, 'trial')} of {bases}; {axes})"

    __str__ = __repr__

    @property
    def size(self) -> int:
        """Number of trials."""
        return trial_count(len(self.bases), self.axes, self.samples)

    def trials(self) -> dict[str, list[Any]]:
        """Return the values of each axis, one for each trial, by the first path of the axis.

        ``base`` comes first where there are several.
        """
        return {name: list(values) for name, values in self._values.items()}

    @cached_property
    def units(self) -> dict[str, str | None]:
        """Units of the values of each axis; None where they have none."""
        robots = [base.robot for base in self.bases.values()]
        return {name: unit_of(name, robots) for name in self._values}

    def trial(self, index: int) -> Trial:
        """Return one trial, with its values by single paths."""
        base = self._values[BASE][index] if BASE in self._values else next(iter(self.bases))
        values = {place: self._values[name][index] for name, place in self._places[base]}
        return Trial(index, base, values)

    def scenario(self, index: int) -> Scenario:
        """Return the scenario of one trial.

        Raises:
            ScenarioError: its values do not fit.
            IndexError: there is no such trial.
        """
        if not 0 <= index < self.size:
            raise IndexError(f"trial {index} of {self.size}")
        trial = self.trial(index)
        return validate(changed(self.plain[trial.base], trial.changes))

    def batches(self) -> list[Batch]:
        """Return the trials in batches that run together."""
        return batched(self.plain, map(self.trial, range(self.size)), self.batch)

    @property
    def hash(self) -> str:
        """SHA-256 of everything that the table depends on: all but name, groups and labels."""
        return hash_of(self.data())

    def data(self) -> dict[str, Any]:
        """Return the sweep as plain data, with its bases in full."""
        return self.model_dump(mode="json")

    def kept(self) -> dict[str, Any]:
        """Return what is to be known of robots from outside the package, by their base."""
        robots = {name: base.robot for name, base in self.bases.items()}
        own = {name: values_of(one) for name, one in robots.items() if is_recorded(one)}
        return {"robots": own} if own else {}

    def rounds(self) -> Rounds:
        """Ask for all trials at once, and count them.

        Raises:
            SweepError: all trials are invalid.
        """
        from omnitrack_sim.trials.table import refuse_all_invalid

        table = yield Round(self.batches(), self.trials(), units=self.units)
        refuse_all_invalid(table, "axes", "", SweepError)
        return Conclusion(self.summary(table), draw=lambda: self.draw_map(table))

    def draw_map(self, table: pa.Table) -> bytes:
        """Draw the figure of all trials: success over what was varied."""
        from omnitrack_sim.trials.sweep_figure import draw_map

        return draw_map(self, table)

    def summary(self, table: pa.Table) -> dict[str, Any]:
        """Return outcomes and success rates of all trials, and of groups of them.

        Rates are over the trials that ran to an outcome: ``invalid`` and ``error`` are counted, but
        not in the rates.
        """
        outcomes = table["outcome"].to_pylist()
        values = self.trials()
        groups = {}
        for name in self.groups:
            members: dict[str, list[str]] = {
                self.label(name, value): [] for value in self.crossed[name]
            }
            for value, outcome in zip(values[name], outcomes, strict=True):
                members[self.label(name, value)].append(outcome)
            groups[name] = [{"value": label, **_rate(own)} for label, own in members.items()]
        counts = dict(sorted(Counter(outcomes).items()))
        return {**_rate(outcomes), "outcomes": counts, "groups": groups}

    @cached_property
    def plain(self) -> dict[str, dict[str, Any]]:
        """The base scenarios as plain data, by name."""
        return {name: scenario.model_dump(mode="json") for name, scenario in self.bases.items()}

    @cached_property
    def crossed(self) -> dict[str, list[Any]]:
        """The values of ``base``, where there are several, and of each crossed axis, by name."""
        # All bases have every path of the axes; the first one decides between 1 and 1.0.
        first = next(iter(self.plain.values()))
        values: dict[str, list[Any]] = {BASE: list(self.bases)} if len(self.bases) > 1 else {}
        for axis in self.axes:
            if axis.crossed:
                present = value_at(first, matches(first, axis.name)[0])
                values[axis.name] = [fitted(value, present) for value in axis.values_of()]
        return values

    @property
    def groups(self) -> tuple[str, ...]:
        """The axes by whose values the summary counts."""
        if self.group_by is not None:
            return self.group_by
        most = {axis.name: MAX_GRID for axis in self.axes if isinstance(axis, GridAxis)}
        return tuple(
            name
            for name, values in self.crossed.items()
            if len(values) <= most.get(name, MAX_LISTED)
        )

    def label(self, name: str, value: Any) -> str:
        """Return a value of a crossed axis as text: its label, itself, nine digits, or JSON."""
        for axis in self.axes:
            if axis.name == name and isinstance(axis, ListAxis) and axis.labels is not None:
                return axis.labels[axis.values.index(value)]
        if isinstance(value, float):
            return f"{value:.9g}"
        return value if isinstance(value, str) else json.dumps(value)

    @cached_property
    def _places(self) -> dict[str, list[tuple[str, str]]]:
        """For each base (axis name, path) of every single value that the axes set there."""
        return {
            base: [
                (name, place)
                for axis in self.axes
                for name, paths in axis.columns.items()
                for path in paths
                for place in matches(data, path)
            ]
            for base, data in self.plain.items()
        }

    @cached_property
    def _values(self) -> dict[str, list[Any]]:
        """The values of each axis, one for each trial."""
        random = [axis for axis in self.axes if not axis.crossed]
        combinations = list(itertools.product(*self.crossed.values()))
        # Without random axes a combination has nothing to draw: one trial of each.
        each = self.samples if random else 1
        sets = len(combinations) if self.draws == "independent" else 1
        dimensions = [axis.dimensions for axis in random]
        points = unit_points(each * sets, sum(dimensions), self.sampling, self.seed)
        # One set of points for all axes together, since only that covers their product evenly.
        shares = np.split(points, np.cumsum(dimensions)[:-1], axis=1) if random else []
        drawn: dict[str, list[Any]] = {}
        for axis, own in zip(random, shares, strict=True):
            drawn |= axis.drawn(own)
        names = [BASE] if len(self.bases) > 1 else []
        names += [name for axis in self.axes for name in axis.columns]
        values: dict[str, list[Any]] = {name: [] for name in names}
        # Common draws are one set, which each combination takes from its beginning.
        for number, combination in enumerate(combinations):
            for name, value in zip(self.crossed, combination, strict=True):
                values[name] += [value] * each
            first = number % sets * each
            for name, items in drawn.items():
                values[name] += items[first : first + each]
        return values


def hash_of(data: Mapping[str, Any]) -> str:
    """Return the ``Sweep.hash`` of a sweep as plain data."""
    # What only names things may be changed without running the trials again. Of a file of a
    # calibration the contents stand beside its name.
    kept = {key: value for key, value in data.items() if key not in FOR_THE_RECORD}
    named = ("labels", "file")
    axes = [{k: v for k, v in axis.items() if k not in named} for axis in kept["axes"]]
    return sha256_of([FORMAT, kept | {"axes": axes}])


def trial_count(bases: int, axes: Sequence[AxisTable], samples: int) -> int:
    """Return the number of trials of a number of bases with these axes and samples."""
    combinations = bases * math.prod(axis.size for axis in axes if axis.crossed)
    return combinations * (samples if any(not axis.crossed for axis in axes) else 1)


def _rate(outcomes: Collection[str]) -> dict[str, Any]:
    """Numbers of trials and successes, and the success rate with its Wilson 95 % interval."""
    counts = Counter(outcomes)
    # They say nothing of the robot, only of the plan or the program.
    valid = len(outcomes) - counts[INVALID] - counts[ERROR]
    passed = counts[Outcome.REACHED_GOAL]
    low, high = wilson_interval(passed, valid)
    return {
        "trials": len(outcomes),
        "invalid": counts[INVALID],
        "error": counts[ERROR],
        "counted": valid,
        "successes": passed,
        "success_rate": passed / valid if valid else None,
        "success_rate_95": [low, high],
    }
