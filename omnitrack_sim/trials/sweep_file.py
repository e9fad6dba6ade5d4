"""Sweep files: read, and checked as a whole in the light of their base scenarios."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from omnitrack_sim.base.bounds import (
    MAX_FAULTS,
    MAX_SAMPLES,
    MAX_TRIALS,
    MAX_VALUES,
    MAX_WORDS,
)
from omnitrack_sim.base.errors import Fault, InputError, ScenarioError, SweepError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.reading import SWEEP, beside, checked, read_file
from omnitrack_sim.calibration.calibration import load_calibration
from omnitrack_sim.scenario import Scenario, load_scenario, override
from omnitrack_sim.scenario.model import samples_of
from omnitrack_sim.trials.axes import (
    BASE,
    AxisTable,
    CalibrationAxis,
    DirectionAxis,
    GridAxis,
    ListAxis,
)
from omnitrack_sim.trials.sweep import Sweep, SweepTable, trial_count


class SweepFile(SweepTable):
    """A sweep file as it is written; docs/how-to/sweeps.md has an example.

    Attributes:
        base: a scenario, or a list of scenarios, by name or by path relative to this file; of a
            list the first crossed axis is called `base`.
        set: changes of the base, by dotted path.
    """

    base: str | Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_WORDS)]
    set: dict[str, Any] = Field(default_factory=dict)


def load_sweep(
    source: str | Path, changes: Mapping[str, Any] | None = None, *, batch: int | None = None
) -> Sweep:
    """Read a sweep file, or a shipped sweep by name.

    Args:
        source: the file or name.
        changes: of the base scenarios by dotted path; they come after those of the file's
            ``[set]``. Both are set before the base scenarios are checked.
        batch: trials that run together, in place of the file's own number. An interruption costs
            each worker the batch that it is at; smaller batches take more time a trial.

    Raises:
        SweepError: no such file, bad TOML or JSON, or any fault in it; every fault is listed with
            its path in the file.

    Example:
        >>> ot.load_sweep("tee_lugs", {"robot.preload": 20.0}).bases["tee_turn"].robot.preload
        20.0
    """
    path, data = read_file(source, SWEEP, SweepError)
    own = {} if batch is None else {"batch": batch}
    return resolve(data | own, path.parent, changes)


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
    data = {**data, **_with_calibrations(data, folder)}
    file = checked(SweepFile, data, SweepError, own_fault=path_fault_of)
    bases = _bases(file, folder, changes or {})
    faults: list[Fault] = []
    for number in range(len(file.axes)):
        faults += _axis_faults(number, file.axes, bases)
    faults += _clashes(file, bases, changes or {})
    faults += _excess(file, bases)
    if faults:
        raise SweepError(faults)
    fields = {name: getattr(file, name) for name in SweepTable.model_fields}
    return Sweep(**fields, bases=bases, set=file.set | dict(changes or {}))


_FROM_FILE = "stands in the file of the calibration; leave it out here"


def _with_calibrations(data: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the axes of a sweep's data, those of calibrations with what stands in their files.

    Raises:
        SweepError: a file of a calibration cannot be read, or a key stands beside its name.
    """
    if not isinstance(axes := data.get("axes"), list | tuple):
        return {}
    read: list[Any] = []
    faults: list[Fault] = []
    for i, axis in enumerate(axes):
        is_named = isinstance(axis, Mapping) and axis.get("kind") == "calibration"
        file = axis.get("file") if is_named else None
        if not isinstance(file, str) or "values" in axis:
            read.append(axis)
            continue
        try:
            found = CalibrationAxis.of(load_calibration(beside(folder, file)), file)
        except InputError as error:
            faults += [fault.at(f"axes.{i}.file: {fault.where}") for fault in error.faults]
        else:
            own = found.model_dump(mode="json")
            given = (key for key in axis if key in own and key not in ("kind", "file"))
            faults += [Fault(f"axes.{i}.{key}", _FROM_FILE) for key in given]
            read.append({**own, **axis})
    if faults:
        raise SweepError(faults)
    return {"axes": read}


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
    if len(words) > MAX_WORDS:
        problem = f"has {len(words)} texts and truth values; at most {MAX_WORDS}"
        yield Fault(f"{where}.values", problem)
        return
    refused = 0
    for i, value in words:
        if refused >= MAX_FAULTS:
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
        for value in other.values[:MAX_WORDS]:
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
    if size > MAX_TRIALS:
        yield Fault("axes", f"make {size} trials; at most {MAX_TRIALS}")
    elif size * len(file.axes) > MAX_VALUES:
        problem = f"set {size * len(file.axes)} values, {len(file.axes)} in {size} trials each"
        yield Fault("axes", f"{problem}; at most {MAX_VALUES}")
    yield from excess_samples(min(file.batch, size), bases.values())


def excess_samples(together: int, bases: Iterable[Scenario]) -> Iterator[Fault]:
    """Yield the fault of a batch of ``together`` trials with more samples than fit into memory."""
    for scenario in bases:
        samples = samples_of(scenario)
        if samples * together > MAX_SAMPLES:
            problem = (
                f"takes {together} trials together, each of {samples} samples up to the time limit "
                f"of {scenario.name!r}: {samples * together} in memory; at most {MAX_SAMPLES}, "
                f"{MAX_SAMPLES // samples} trials"
            )
            yield Fault("batch", problem)
            return
