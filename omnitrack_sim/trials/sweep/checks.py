"""What is wrong with the axes of a sweep, given its base scenarios."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.bounds import MOST_SAMPLES, MOST_TOLD, MOST_TRIALS, MOST_VALUES, MOST_WORDS
from omnitrack_sim.base.errors import Fault, ScenarioError
from omnitrack_sim.scenario import Scenario, override
from omnitrack_sim.scenario.work import samples_of
from omnitrack_sim.trials.sweep import trials
from omnitrack_sim.trials.sweep.axes import BASE, AxisTable, DirectionAxis, GridAxis, ListAxis

if TYPE_CHECKING:
    from omnitrack_sim.trials.sweep.spec import SweepFile


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
            found = trials.matches(data, path)
            if not found:
                yield missing(at, path, data, name if len(bases) > 1 else None)
                break
            value = trials.value_at(data, found[0])
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
    depth = next(i for i in range(len(keys)) if not trials.matches(data, ".".join(keys[: i + 1])))
    before = trials.matches(data, ".".join(keys[:depth])) if depth else [""]
    inside = trials.value_at(data, before[0])
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
    present = trials.value_at(scenario.model_dump(mode="json"), places[0])
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
        places = [place for path in other.paths for place in trials.matches(data, path)]
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
            for place in trials.matches(data, path):
                if place in taken and taken[place] != f"axes.{i}":
                    yield Fault(f"axes.{i}.path", f"{place!r} is set by {taken[place]} too")
                taken.setdefault(place, f"axes.{i}")
    for origin, given in (("set.", file.set), ("--set ", changes)):
        for path in given:
            clash = next(
                (taken[place] for place in trials.matches(data, path) if place in taken), None
            )
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
    size = trials.count(len(bases), file.axes, file.samples)
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
