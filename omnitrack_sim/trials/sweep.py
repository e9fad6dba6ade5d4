"""What is wrong with the axes of a sweep, given its base scenarios."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field

from omnitrack_sim.base.bounds import (
    MOST_AXES,
    MOST_BATCH,
    MOST_SAMPLES,
    MOST_TOLD,
    MOST_TRIALS,
    MOST_VALUES,
    MOST_WORDS,
)
from omnitrack_sim.base.errors import Fault, ScenarioError, SweepError
from omnitrack_sim.base.reading import NAME_PATTERN, SWEEP, beside, checked, fault_of, read_file
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import counted
from omnitrack_sim.scenario import Scenario, load_scenario, override, validate
from omnitrack_sim.scenario.model import samples_of
from omnitrack_sim.trials.axes import (
    AXES,
    BASE,
    Axis,
    AxisTable,
    DirectionAxis,
    Draws,
    GridAxis,
    ListAxis,
    Sampling,
)
from omnitrack_sim.trials.batches import (
    FORMAT,
    Batch,
    Columns,
    batches_of,
    changed,
    count,
    crossed_values,
    expand,
    matches,
    places_of,
    trial_of,
    value_at,
)


def axis_faults(
    number: int, axes: Sequence[AxisTable], bases: Mapping[str, Scenario]
) -> Iterator[Fault]:
    """What is wrong with axis ``number``, given the base scenarios."""
    where, axis = f"axes.{number}", axes[number]
    others = [other for other in axes if other is not axis and isinstance(other, ListAxis)]
    for i, path in enumerate(axis.paths):
        at = f"{where}.path" if isinstance(axis.path, str) else f"{where}.path.{i}"
        for name, scenario in bases.items():
            data = scenario.model_dump(mode="json")
            found = matches(data, path)
            if not found:
                yield missing(at, path, data, name if len(bases) > 1 else None)
                break
            value = value_at(data, found[0])
            inner = (
                value if isinstance(value, dict) else value[0] if isinstance(value, list) else None
            )
            if isinstance(inner, dict) and not _names_tables(axis, value):
                keys = value if isinstance(value, dict) else [*map(str, range(len(value))), "*"]
                yield Fault(at, f"{path!r} is a table; name one value in it", tuple(keys))
                break
            problem = _misfit(axis, value)
            if problem:
                yield Fault(at, f"{path!r} {problem}")
                break
            if isinstance(axis, ListAxis):
                yield from _misspelt(where, axis, scenario, found, others)


def _names_tables(axis: AxisTable, present: Any) -> bool:
    """Whether the axis sets a table by a name for it, such as the robot's motor."""
    return (
        isinstance(axis, ListAxis)
        and isinstance(present, dict)
        and all(isinstance(value, str) for value in axis.values)
    )


def missing(at: str, path: str, data: Mapping[str, Any], base: str | None) -> Fault:
    """The fault of a path that leads nowhere: where it leaves the scenario, and what there is."""
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
    """Why an axis of numbers or vectors cannot set a value like ``present``; None if it can."""
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
    where: str, axis: ListAxis, scenario: Scenario, places: list[str], others: Sequence[ListAxis]
) -> Iterator[Fault]:
    """Words and truth values that the scenario never takes, with any value of the ``others``.

    Numbers out of range, and values that do not go together, make invalid trials instead.
    """
    present = value_at(scenario.model_dump(mode="json"), places[0])
    words = [
        (i, value)
        for i, value in enumerate(axis.values)
        if isinstance(value, bool | str) or isinstance(present, bool | str)
    ]
    if len(words) > MOST_WORDS:
        problem = f"has {len(words)} texts and truth values; at most {MOST_WORDS}"
        yield Fault(f"{where}.values", problem)
        return
    told = 0
    for i, value in words:
        if told >= MOST_TOLD:
            return
        try:
            override(scenario, dict.fromkeys(places, value))
        except ScenarioError as error:
            found = [fault for fault in error.faults if fault.where in places]
            if found and not _goes_with_another(scenario, dict.fromkeys(places, value), others):
                told += 1
                yield from (fault.at(f"{where}.values.{i}") for fault in found)


def _goes_with_another(
    scenario: Scenario, changes: Mapping[str, Any], others: Sequence[ListAxis]
) -> bool:
    """Whether changes are valid together with some value of one of the axes ``others``."""
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


def clashes(
    file: SweepFile, bases: Mapping[str, Scenario], changes: Mapping[str, Any]
) -> Iterator[Fault]:
    """Values that are set twice, and groups that are no crossed axes."""
    data = next(iter(bases.values())).model_dump(mode="json")
    taken: dict[str, str] = {}
    for i, axis in enumerate(file.axes):
        for path in axis.paths:
            for place in matches(data, path):
                if place in taken and taken[place] != f"axes.{i}":
                    yield Fault(f"axes.{i}.path", f"{place!r} is set by {taken[place]} too")
                taken.setdefault(place, f"axes.{i}")
    for origin, given in (("set.", file.set), ("--set ", changes)):
        for path in given:
            clash = next((taken[place] for place in matches(data, path) if place in taken), None)
            if clash:
                yield Fault(origin + path, f"is set by {clash} too")
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


def too_much(file: SweepFile, bases: Mapping[str, Scenario]) -> Iterator[Fault]:
    """More trials than a sweep may have, or more samples than a batch may keep in memory."""
    size = count(len(bases), file.axes, file.samples)
    if size > MOST_TRIALS:
        yield Fault("axes", f"make {size} trials; at most {MOST_TRIALS}")
    elif size * len(file.axes) > MOST_VALUES:
        problem = f"set {size * len(file.axes)} values, {len(file.axes)} in {size} trials each"
        yield Fault("axes", f"{problem}; at most {MOST_VALUES}")
    yield from too_many_samples(min(file.batch, size), bases.values())


def too_many_samples(together: int, bases: Iterable[Scenario]) -> Iterator[Fault]:
    """The fault of a batch of so many trials that has more samples than may be kept in memory."""
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


MOST_LISTED, MOST_GRID = 12, 24
"""Up to how many values a list or grid axis makes groups in the summary if the file names none."""
FOR_THE_RECORD = ("name", "group_by", "set")
"""Keys of a resolved sweep that its table does not depend on."""
_SAMPLINGS = ("latin_hypercube", "sobol")


class _Plan(Table):
    """What a sweep file and a resolved sweep share."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    samples: Annotated[int, Field(ge=1, le=MOST_TRIALS)] = 1
    sampling: Sampling = "random"
    draws: Draws = "common"
    batch: Annotated[int, Field(ge=1, le=MOST_BATCH)] = 32
    group_by: tuple[str, ...] | None = None
    axes: Annotated[tuple[Axis, ...], Field(max_length=MOST_AXES)] = ()


class SweepFile(_Plan):
    """A sweep file as it is written. docs/how-to/sweeps.md explains the keys."""

    base: str | Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST_WORDS)]
    set: dict[str, Any] = Field(default_factory=dict)


class Sweep(_Plan):
    """A resolved sweep.

    Attributes:
        bases: base scenarios in full, with all changes, by name; several make the axis ``base``.
        set: the changes, for the record.
    """

    bases: dict[str, Scenario]
    set: dict[str, Any]

    def __repr__(self) -> str:
        axes = ", ".join(axis.name for axis in self.axes) or "no axes"
        bases = ", ".join(self.bases)
        return f"Sweep({self.name!r}: {counted(self.size, 'trial')} of {bases}; {axes})"

    __str__ = __repr__

    def trials(self) -> dict[str, list[Any]]:
        """The values of each axis, one for each trial, by the first path of the axis.

        ``base`` comes first where there are several.
        """
        return {name: list(values) for name, values in self._columns.items()}

    def scenario(self, index: int) -> Scenario:
        """The scenario of one trial.

        Raises:
            ScenarioError: its values do not fit.
            IndexError: there is no such trial.
        """
        if not 0 <= index < self.size:
            raise IndexError(f"trial {index} of {self.size}")
        one = trial_of(places_of(self._plain, self.axes), self._columns, index)
        return validate(changed(self._plain[one.base], one.changes))

    def batches(self) -> list[Batch]:
        """The trials in batches that run together."""
        return batches_of(self._plain, self.axes, self._columns, self.batch)

    @property
    def size(self) -> int:
        """Number of trials."""
        return count(len(self.bases), self.axes, self.samples)

    @property
    def hash(self) -> str:
        """SHA-256 of everything that the table depends on: all but name, groups and labels."""
        left_out = dict.fromkeys(FOR_THE_RECORD, True) | {"axes": {"__all__": {"labels"}}}
        told = self.model_dump(mode="json", exclude=left_out)
        return hashlib.sha256(json.dumps([FORMAT, told], sort_keys=True).encode()).hexdigest()

    @property
    def crossed(self) -> dict[str, list[Any]]:
        """The values of ``base``, where there are several, and of each crossed axis, by name."""
        return crossed_values(self._plain, self.axes)

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
        """A value of a crossed axis as text: its label, the text itself, nine digits, or JSON."""
        for axis in self.axes:
            if axis.name == name and isinstance(axis, ListAxis) and axis.labels is not None:
                return axis.labels[axis.values.index(value)]
        if isinstance(value, float):
            return f"{value:.9g}"
        return value if isinstance(value, str) else json.dumps(value)

    @cached_property
    def _plain(self) -> dict[str, dict[str, Any]]:
        return {name: scenario.model_dump(mode="json") for name, scenario in self.bases.items()}

    @cached_property
    def _columns(self) -> Columns:
        return expand(self._plain, self.axes, self.samples, self.sampling, self.draws, self.seed)


def load_sweep(source: str | Path, changes: Mapping[str, Any] | None = None) -> Sweep:
    """Read a sweep file, or a shipped sweep by name.

    Args:
        source: the file or name.
        changes: of the base scenarios by dotted path; they come after those of the file's
            ``[set]``. Both are set before the base scenarios are checked.

    Raises:
        SweepError: no such file, bad TOML or JSON, or any fault in it; every fault is listed with
            its path in the file.
    """
    path, data = read_file(source, SWEEP, SweepError)
    return resolve(data, path.parent, changes)


def resolve(
    data: Mapping[str, Any], folder: Path = Path(), changes: Mapping[str, Any] | None = None
) -> Sweep:
    """A sweep from plain data as read from TOML or JSON.

    Args:
        data: of the file.
        folder: that paths of base scenarios are relative to.
        changes: see ``load_sweep``.

    Raises:
        SweepError: lists every fault with its dotted path.
    """
    file = checked(SweepFile, data, "", _fault, SweepError)
    bases, faults = _bases(file, folder, changes or {})
    if bases:
        faults += [
            fault for i in range(len(file.axes)) for fault in axis_faults(i, file.axes, bases)
        ]
        faults += clashes(file, bases, changes or {})
        faults += too_much(file, bases)
    if faults:
        raise SweepError(faults)
    fields = {name: getattr(file, name) for name in _Plan.model_fields}
    return Sweep(**fields, bases=bases, set=file.set | dict(changes or {}))


def _fault(item: Mapping[str, Any]) -> Fault:
    """One of pydantic's errors as a fault.

    A key that takes two kinds of value has an error for each; they become the same fault.
    """
    places, context = item["loc"], item.get("ctx", {})
    if item["type"] == "union_tag_invalid" and context["tag"] in _SAMPLINGS:
        where = ".".join(map(str, (*places, "kind")))
        tag = context["tag"]
        said = f'is {tag!r}, which is no kind of axis: write sampling = "{tag}" at the top'
        return Fault(where, f"{said} and a distribution here", tuple(sorted(AXES)))
    if set(places) & {"path", "base"}:
        where = places[: 1 + max(places.index(key) for key in ("path", "base") if key in places)]
        plain = ".".join(
            str(place) for i, place in enumerate(where) if not (i == 2 and place in AXES)
        )
        missing = item["type"] == "missing"
        return Fault(plain, "is missing" if missing else "is neither a text nor a list of texts")
    return fault_of(item, "axes", tuple(AXES), _choices_at)


def _choices_at(places: list[str]) -> tuple[str, ...]:
    """Valid keys of the table at a pydantic path."""
    table: type[BaseModel] = (
        AXES[places[2]] if places[:1] == ["axes"] and len(places) > 2 else SweepFile
    )
    return tuple(table.model_fields)


def _bases(
    file: SweepFile, folder: Path, changes: Mapping[str, Any]
) -> tuple[dict[str, Scenario], list[Fault]]:
    """The base scenarios with all changes, by name, and what is wrong with them."""
    bases: dict[str, Scenario] = {}
    faults: list[Fault] = []
    many = not isinstance(file.base, str)
    given = {**file.set, **changes}
    for i, source in enumerate([file.base] if isinstance(file.base, str) else file.base):
        where = f"base.{i}" if many else "base"
        scenario, found = _base(beside(folder, source), given)
        faults += [_in_sweep(fault, where, file.set, changes) for fault in found]
        if scenario is None:
            continue
        if scenario.name in bases:
            faults.append(Fault(where, f"{scenario.name!r} is the name of an earlier base"))
        bases[scenario.name] = scenario
    return bases, list(dict.fromkeys(faults))


def _base(
    source: str | Path, changes: Mapping[str, Any]
) -> tuple[Scenario | None, Sequence[Fault]]:
    """A base scenario with the changes, and what is wrong. Where changes are, it comes without
    them, so that the rest of the sweep can be looked at as well."""
    try:
        return load_scenario(source, changes), ()
    except ScenarioError as error:
        faults = error.faults
    sound = {
        path: value
        for path, value in changes.items()
        if not any(_covers(path, fault.where) for fault in faults)
    }
    try:
        return load_scenario(source, sound), faults
    except ScenarioError:
        return None, faults


def _in_sweep(
    fault: Fault, base: str, of_file: Mapping[str, Any], of_call: Mapping[str, Any]
) -> Fault:
    """A fault of a base scenario, told with where its value comes from: a change or the base."""
    for origin, changes in (("--set ", of_call), ("set.", of_file)):
        if any(_covers(path, fault.where) for path in changes):
            return fault.at(origin + fault.where)
    return fault.at(f"{base}: {fault.where}")


def _covers(path: str, place: str) -> bool:
    """Whether a path, in which ``*`` may stand, leads to a place or to a table that it is in."""
    keys, places = path.split("."), place.split(".")
    return len(keys) <= len(places) and all(
        key in ("*", at) for key, at in zip(keys, places, strict=False)
    )
