"""Sweeps: plans of trials, from axes over base scenarios; read and checked as a whole."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from omnitrack_sim.base.bounds import (
    MOST_AXES,
    MOST_BATCH,
    MOST_FAULTS,
    MOST_SAMPLES,
    MOST_TRIALS,
    MOST_VALUES,
    MOST_WORDS,
)
from omnitrack_sim.base.errors import Fault, ScenarioError, SweepError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.reading import NAME_PATTERN, SWEEP, beside, checked, read_file
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import counted
from omnitrack_sim.scenario import Scenario, load_scenario, override, validate
from omnitrack_sim.scenario.model import samples_of
from omnitrack_sim.trials.axes import (
    BASE,
    Axis,
    AxisTable,
    DirectionAxis,
    Draws,
    GridAxis,
    ListAxis,
    Sampling,
    unit_points,
)
from omnitrack_sim.trials.batches import (
    FORMAT,
    Batch,
    Trial,
    batched,
    changed,
    fitted,
    sha256_of,
)

MOST_LISTED, MOST_GRID = 12, 24
"""Most values of a list or grid axis that makes groups in the summary if the file names none."""
FOR_THE_RECORD = ("name", "group_by", "set")
"""Keys of a resolved sweep that its table does not depend on."""


class _SweepTable(Table):
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
    samples: Annotated[int, Field(ge=1, le=MOST_TRIALS)] = 1
    sampling: Sampling = "random"
    draws: Draws = "common"
    batch: Annotated[int, Field(ge=1, le=MOST_BATCH)] = 32
    group_by: tuple[str, ...] | None = None
    axes: Annotated[tuple[Axis, ...], Field(max_length=MOST_AXES)] = ()


class SweepFile(_SweepTable):
    """A sweep file as it is written; docs/how-to/sweeps.md has an example.

    Attributes:
        base: a scenario, or a list of scenarios, by name or by path relative to this file; of a
            list the first crossed axis is called `base`.
        set: changes of the base, by dotted path.
    """

    base: str | Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_WORDS)]
    set: dict[str, Any] = Field(default_factory=dict)


class Sweep(_SweepTable):
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
        # What only names things may be changed without running the trials again.
        left_out = dict.fromkeys(FOR_THE_RECORD, True) | {"axes": {"__all__": {"labels"}}}
        return sha256_of([FORMAT, self.model_dump(mode="json", exclude=left_out)])

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
        most = {axis.name: MOST_GRID for axis in self.axes if isinstance(axis, GridAxis)}
        return tuple(
            name
            for name, values in self.crossed.items()
            if len(values) <= most.get(name, MOST_LISTED)
        )

    def label(self, name: str, value: Any) -> str:
        """Return a value of a crossed axis as text: its label, the text itself, nine digits, or
        JSON."""
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
                (axis.name, place)
                for axis in self.axes
                for path in axis.paths
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
        drawn = {axis.name: axis.draw(own) for axis, own in zip(random, shares, strict=True)}
        names = [*([BASE] if len(self.bases) > 1 else []), *(axis.name for axis in self.axes)]
        values: dict[str, list[Any]] = {name: [] for name in names}
        # Common draws are one set, which each combination takes from its beginning.
        for number, combination in enumerate(combinations):
            for name, value in zip(self.crossed, combination, strict=True):
                values[name] += [value] * each
            first = number % sets * each
            for name, items in drawn.items():
                values[name] += items[first : first + each]
        return values


def trial_count(bases: int, axes: Sequence[AxisTable], samples: int) -> int:
    """Return the number of trials of a number of bases with these axes and samples."""
    combinations = bases * math.prod(axis.size for axis in axes if axis.crossed)
    return combinations * (samples if any(not axis.crossed for axis in axes) else 1)


def load_sweep(source: str | Path, changes: Mapping[str, Any] | None = None) -> Sweep:
    """Read a sweep file, or a shipped sweep by name.

    Args:
        source: the file or name.
        changes: of the base scenarios by dotted path; they come after those of the file's
            ``[set]``. Both are set before the base scenarios are checked.

    Raises:
        SweepError: no such file, bad TOML or JSON, or any fault in it; every fault is listed with
            its path in the file.

    Example:
        >>> ot.load_sweep("tee_lugs", {"robot.preload": 20.0}).bases["tee_turn"].robot.preload
        20.0
    """
    path, data = read_file(source, SWEEP, SweepError)
    return resolve(data, path.parent, changes)


def resolve(
    data: Mapping[str, Any], folder: Path = Path(), changes: Mapping[str, Any] | None = None
) -> Sweep:
    """Make a sweep from plain data as read from TOML or JSON.

    Args:
        data: of the file.
        folder: that paths of base scenarios are relative to.
        changes: see ``load_sweep``.

    Raises:
        SweepError: lists every fault with its dotted path.
    """
    file = checked(SweepFile, data, SweepError, own_fault=path_fault_of)
    bases = _bases(file, folder, changes or {})
    faults: list[Fault] = []
    for number in range(len(file.axes)):
        faults += _axis_faults(number, file.axes, bases)
    faults += _clashes(file, bases, changes or {})
    faults += _excess(file, bases)
    if faults:
        raise SweepError(faults)
    fields = {name: getattr(file, name) for name in _SweepTable.model_fields}
    return Sweep(**fields, bases=bases, set=file.set | dict(changes or {}))


def path_fault_of(item: Mapping[str, Any]) -> Fault | None:
    """Return the fault of a path or base for an error of pydantic; None for others.

    A key that takes two kinds of value has an error for each; they become the same fault.
    """
    places = item["loc"]
    keys = [places.index(key) for key in ("path", "base") if key in places]
    if not keys:
        return None
    where = ".".join(map(str, places[: 1 + max(keys)]))
    missing = item["type"] == "missing"
    return Fault(where, "is missing" if missing else "is neither a text nor a list of texts")


def _bases(file: SweepFile, folder: Path, changes: Mapping[str, Any]) -> dict[str, Scenario]:
    """Read the base scenarios with all changes, by name."""
    bases: dict[str, Scenario] = {}
    faults: list[Fault] = []
    for i, source in enumerate([file.base] if isinstance(file.base, str) else file.base):
        where = "base" if isinstance(file.base, str) else f"base.{i}"
        try:
            scenario = load_scenario(beside(folder, source), {**file.set, **changes})
        except ScenarioError as error:
            faults += [_in_sweep(fault, where, file.set, changes) for fault in error.faults]
            continue
        if scenario.name in bases:
            faults.append(Fault(where, f"{scenario.name!r} is the name of an earlier base"))
        bases[scenario.name] = scenario
    if faults:
        raise SweepError(list(dict.fromkeys(faults)))
    return bases


def _in_sweep(
    fault: Fault, base: str, of_file: Mapping[str, Any], of_call: Mapping[str, Any]
) -> Fault:
    """Fault of a base scenario at the origin of its value: a change or the base."""
    for origin, changes in (("--set ", of_call), ("set.", of_file)):
        if any(_covers(path, fault.where) for path in changes):
            return fault.at(origin + fault.where)
    return fault.at(f"{base}: {fault.where}")


def _covers(path: str, place: str) -> bool:
    """True if a path, in which ``*`` may stand, leads to a place or to a table that it is in."""
    keys, places = path.split("."), place.split(".")
    return len(keys) <= len(places) and all(
        key in ("*", at) for key, at in zip(keys, places, strict=False)
    )


def _axis_faults(
    number: int, axes: Sequence[AxisTable], bases: Mapping[str, Scenario]
) -> Iterator[Fault]:
    """Faults of an axis in the light of the base scenarios."""
    axis = axes[number]
    others = [other for other in axes if other is not axis and isinstance(other, ListAxis)]
    # A table that has names, such as the robot's motor, may be set by a list of these.
    named = isinstance(axis, ListAxis) and all(isinstance(value, str) for value in axis.values)
    for at, path in places_in_file(f"axes.{number}", axis.path):
        fault = path_fault(at, path, [*bases.values()], partial(_misfit, axis), named)
        if fault is not None:
            yield fault
        elif isinstance(axis, ListAxis):
            for scenario in bases.values():
                yield from _misspelt(f"axes.{number}", axis, scenario, path, others)


def places_in_file(table: str, path: str | Sequence[str]) -> list[tuple[str, str]]:
    """Return each path of an axis or variable with its own place in the file."""
    if isinstance(path, str):
        return [(f"{table}.path", path)]
    return [(f"{table}.path.{i}", one) for i, one in enumerate(path)]


def path_fault(
    at: str,
    path: str,
    bases: Sequence[Scenario],
    misfit: Callable[[Any], str | None],
    named: bool = False,
) -> Fault | None:
    """Return the fault of a path that leads nowhere, to a table, or to a value that does not fit.

    Args:
        at: place of the path in the file.
        path: dotted, into the base scenarios.
        bases: the first one in which the path has a fault counts.
        misfit: problem of a value that the path leads to; None if it has none.
        named: a table may be set, by a name for it.
    """
    for scenario in bases:
        data = scenario.model_dump(mode="json")
        places = matches(data, path)
        if not places:
            return _missing(at, path, data, scenario.name if len(bases) > 1 else None)
        present = value_at(data, places[0])
        if isinstance(present, dict) and not named:
            return Fault(at, f"{path!r} is a table; name one value in it", tuple(present))
        # A list of tables, such as `pipes`: an axis may set a key of one of them, or of all by `*`.
        if isinstance(present, list) and present and isinstance(present[0], dict):
            keys = (*map(str, range(len(present))), "*")
            return Fault(at, f"{path!r} is a table; name one value in it", keys)
        problem = misfit(present)
        if problem:
            return Fault(at, f"{path!r} {problem}")
    return None


def _missing(at: str, path: str, data: Mapping[str, Any], base: str | None) -> Fault:
    """Fault of a path that leads nowhere, with the choices where it leaves the scenario."""
    keys = path.split(".")
    depth = next(i for i in range(len(keys)) if not matches(data, ".".join(keys[: i + 1])))
    before = matches(data, ".".join(keys[:depth])) if depth else [""]
    inside = value_at(data, before[0])
    choices = tuple(inside) if isinstance(inside, dict) else ()
    choices = (*map(str, range(len(inside))), "*") if isinstance(inside, list) else choices
    of = f" in base {base!r}" if base else ""
    problem = f"is {path!r}; there is no {keys[depth]!r}{of}"
    return Fault(at, problem, choices, given=keys[depth])


def _misfit(axis: AxisTable, present: Any) -> str | None:
    """Problem of an axis that cannot set a value like ``present``; None if it can."""
    vector = isinstance(present, list)
    if isinstance(axis, DirectionAxis):
        return None if vector else "takes no vector"
    if isinstance(axis, ListAxis):
        return None
    if isinstance(present, bool | str):
        return f"is {json.dumps(present)}, not a number; use a list axis"
    if vector:
        return "is a vector; use a list or direction axis, or one of its numbers"
    whole = isinstance(axis, GridAxis) and all(value.is_integer() for value in axis.values_of())
    return "takes whole numbers only" if isinstance(present, int) and not whole else None


def _misspelt(
    where: str, axis: ListAxis, scenario: Scenario, path: str, others: Sequence[ListAxis]
) -> Iterator[Fault]:
    """Faults of words and truth values that are invalid with every value of the ``others``."""
    data = scenario.model_dump(mode="json")
    places = matches(data, path)
    present = value_at(data, places[0])
    words = [
        (i, value)
        for i, value in enumerate(axis.values)
        if isinstance(value, bool | str) or isinstance(present, bool | str)
    ]
    if len(words) > MOST_WORDS:
        problem = f"has {len(words)} texts and truth values; at most {MOST_WORDS}"
        yield Fault(f"{where}.values", problem)
        return
    refused = 0
    for i, value in words:
        if refused >= MOST_FAULTS:
            return
        changes = dict.fromkeys(places, value)
        try:
            override(scenario, changes)
        except ScenarioError as error:
            # Faults elsewhere are of the combination, not of this word.
            faults = [fault for fault in error.faults if fault.where in places]
            if faults and not _goes_with_another(scenario, changes, others):
                refused += 1
                yield from (fault.at(f"{where}.values.{i}") for fault in faults)


def _goes_with_another(
    scenario: Scenario, changes: Mapping[str, Any], others: Sequence[ListAxis]
) -> bool:
    """True if changes are valid together with some value of one of the axes ``others``."""
    data = scenario.model_dump(mode="json")
    for other in others:
        places = [place for path in other.paths for place in matches(data, path)]
        for value in other.values[:MOST_WORDS]:
            try:
                override(scenario, dict(changes) | dict.fromkeys(places, value))
            except ScenarioError:
                continue
            return True
    return False


def _clashes(
    file: SweepFile, bases: Mapping[str, Scenario], changes: Mapping[str, Any]
) -> Iterator[Fault]:
    """Faults of values that are set twice, and of groups that are no crossed axes."""
    data = next(iter(bases.values())).model_dump(mode="json")
    owners: dict[str, str] = {}
    for i, axis in enumerate(file.axes):
        for place in (place for path in axis.paths for place in matches(data, path)):
            if owners.setdefault(place, f"axes.{i}") != f"axes.{i}":
                yield Fault(f"axes.{i}.path", f"{place!r} is set by {owners[place]} too")
    for origin, paths in (("set.", file.set), ("--set ", changes)):
        for path in paths:
            others = [owners[place] for place in matches(data, path) if place in owners]
            if others:
                yield Fault(origin + path, f"is set by {others[0]} too")
    if not file.axes and len(bases) < 2:
        yield Fault("axes", "is missing: a sweep has at least one axis, or several bases")
    groups = (
        *([BASE] if len(bases) > 1 else []),
        *(axis.name for axis in file.axes if axis.crossed),
    )
    for i, name in enumerate(file.group_by or ()):
        if name not in groups:
            problem = f"{name!r} is no grid or list axis of this sweep"
            yield Fault(f"group_by.{i}", problem, groups, given=name)


def _excess(file: SweepFile, bases: Mapping[str, Scenario]) -> Iterator[Fault]:
    """Faults of too many trials, or of more samples in a batch than fit into memory."""
    size = trial_count(len(bases), file.axes, file.samples)
    if size > MOST_TRIALS:
        yield Fault("axes", f"make {size} trials; at most {MOST_TRIALS}")
    elif size * len(file.axes) > MOST_VALUES:
        problem = f"set {size * len(file.axes)} values, {len(file.axes)} in {size} trials each"
        yield Fault("axes", f"{problem}; at most {MOST_VALUES}")
    yield from excess_samples(min(file.batch, size), bases.values())


def excess_samples(together: int, bases: Iterable[Scenario]) -> Iterator[Fault]:
    """Yield the fault of a batch of ``together`` trials with more samples than fit into memory."""
    for scenario in bases:
        samples = samples_of(scenario)
        if samples * together > MOST_SAMPLES:
            problem = (
                f"takes {together} trials together, each of {samples} samples up to the time limit "
                f"of {scenario.name!r}: {samples * together} in memory; at most {MOST_SAMPLES}, "
                f"{MOST_SAMPLES // samples} trials"
            )
            yield Fault("batch", problem)
            return
