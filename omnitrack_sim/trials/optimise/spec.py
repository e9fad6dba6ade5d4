"""Study files: what a user writes, resolved and checked as a whole before anything runs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, Field

from omnitrack_sim.base.bounds import MOST_BASES
from omnitrack_sim.base.errors import Fault, OmnitrackError, StudyError, SweepError
from omnitrack_sim.base.files import STUDY, beside, read_file
from omnitrack_sim.base.reading import NAME_PATTERN, checked, fault_of
from omnitrack_sim.scenario import load_scenario
from omnitrack_sim.trials.optimise.checks import faults_of, number_faults
from omnitrack_sim.trials.optimise.tables import (
    MOST_OBJECTIVES,
    MOST_VARIABLES,
    Final,
    Objective,
    Plan,
    Variable,
)
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep.spec import resolve as resolve_sweep
from omnitrack_sim.trials.sweep.trials import FORMAT, matches, value_at

FOR_THE_RECORD = ("name", "generations", "final")
"""Keys of a study that what is tried first does not depend on: with another number of generations
it goes on, or stops earlier."""
_Table = TypeVar("_Table", bound=BaseModel)
_TABLES: dict[str, type[BaseModel]] = {
    "variables": Variable,
    "objectives": Objective,
    "final": Final,
}


class StudyFile(Plan):
    """A study file as it is written. docs/optimise.md explains the keys."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    trials: Annotated[tuple[dict[str, Any], ...], Field(min_length=1, max_length=100)]
    final: Final = Final()


class Study(Plan):
    """A resolved study.

    Attributes:
        name: of the study.
        trials: sweeps whose trials every candidate is put through, the same for all.
        final: the check of the best.
    """

    name: str
    trials: tuple[Sweep, ...]
    final: Final

    @property
    def size(self) -> int:
        """Number of trials of a candidate."""
        return sum(sweep.size for sweep in self.trials)

    @property
    def hash(self) -> str:
        """SHA-256 of everything that the candidates and their trials depend on."""
        told = self.model_dump(mode="json", exclude=dict.fromkeys(FOR_THE_RECORD, True))
        return hashlib.sha256(json.dumps([FORMAT, told], sort_keys=True).encode()).hexdigest()

    @cached_property
    def unseen(self) -> tuple[Sweep, ...]:
        """The trials of the check: the same sweeps, drawn anew."""
        found = []
        for i, sweep in enumerate(self.trials):
            drawn = {"seed": self.final.seed + i, "samples": self.final.samples or sweep.samples}
            found.append(Sweep.model_validate(dict(sweep) | drawn))
        return tuple(found)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the objectives."""
        return tuple(objective.name or objective.metric for objective in self.objectives)

    def settings(self, values: tuple[float | int, ...]) -> dict[str, float | int]:
        """The values of a candidate by path, as ``--set`` takes them."""
        return {
            path: value
            for variable, value in zip(self.variables, values, strict=True)
            for path in variable.paths
        }


def load_study(source: str | Path, changes: Mapping[str, Any] | None = None) -> Study:
    """Read a study file, or a shipped study by name.

    Args:
        source: the file or name.
        changes: of the base scenarios by dotted path; they come after those of the file's ``set``,
            and both are set before the base scenarios are checked.

    Raises:
        StudyError: no such file, bad TOML or JSON, or any fault in it; every fault is listed with
            its path in the file.
    """
    path, data = read_file(source, STUDY, StudyError)
    return resolve(data, path.parent, changes)


def resolve(
    data: Mapping[str, Any], folder: Path = Path(), changes: Mapping[str, Any] | None = None
) -> Study:
    """A study from plain data as read from TOML or JSON.

    Args:
        data: of the file.
        folder: that paths of base scenarios are relative to.
        changes: see ``load_study``.

    Raises:
        StudyError: lists every fault with its dotted path.
    """
    tables = data.get("trials")
    sweeps, known, faults = _sweeps(tables, folder, changes or {})
    try:
        file = checked(StudyFile, data, "", _fault, StudyError)
        variables, objectives = dict(enumerate(file.variables)), dict(enumerate(file.objectives))
    except StudyError as error:
        # pydantic calls a list with a fault in it too short as well.
        places = [fault.where for fault in error.faults]
        own = [f for f in error.faults if not any(one.startswith(f"{f.where}.") for one in places)]
        file, faults = None, [*own, *faults]
        variables = _sound(Variable, data.get("variables"), MOST_VARIABLES)
        objectives = _sound(Objective, data.get("objectives"), MOST_OBJECTIVES)
    all_trials = isinstance(tables, list | tuple) and len(known) == len(tables)
    faults += faults_of(variables, objectives, known, all_trials)
    if file is not None:
        faults += number_faults(file, file.final, sweeps)
    if file is None or faults:
        raise StudyError(list(dict.fromkeys(faults)))
    fields = {name: getattr(file, name) for name in Plan.model_fields}
    first = next(iter(next(iter(sweeps.values())).bases.values())).model_dump(mode="json")
    fields["variables"] = tuple(_started(variable, first) for variable in file.variables)
    fields["objectives"] = tuple(_named(objective) for objective in file.objectives)
    return Study(**fields, name=file.name, trials=tuple(sweeps.values()), final=file.final)


def _sweeps(
    tables: Any, folder: Path, changes: Mapping[str, Any]
) -> tuple[dict[int, Sweep], dict[int, Sweep], list[Fault]]:
    """The sweeps of ``trials`` by their place in the file; the same with those that have a fault
    but base scenarios that can be read, without their axes; and what is wrong with them."""
    sweeps: dict[int, Sweep] = {}
    known: dict[int, Sweep] = {}
    faults: list[Fault] = []
    for i, table in enumerate(tables if isinstance(tables, list | tuple) else ()):
        if not isinstance(table, Mapping):
            continue  # told when the file is checked
        if "group_by" in table:
            faults.append(Fault(f"trials.{i}.group_by", "is for sweeps; leave it out"))
        base = table.get("base")
        name = Path(base).stem if isinstance(base, str) else f"trials_{i}"
        try:
            sweeps[i] = known[i] = resolve_sweep({"name": name} | dict(table), folder, changes)
        except SweepError as error:
            faults += [_placed(fault, i) for fault in error.faults]
            alone = _of_bases({"name": name} | dict(table), folder, changes)
            if alone is not None:
                known[i] = alone
    names = {i: sweep.name for i, sweep in sweeps.items()}
    for i, name in names.items():
        if name in [names[k] for k in names if k < i]:
            problem = f"{name!r} is the name of earlier trials; give these another name"
            faults.append(Fault(f"trials.{i}.name", problem))
    return sweeps, known, faults


def _of_bases(table: Mapping[str, Any], folder: Path, changes: Mapping[str, Any]) -> Sweep | None:
    """A sweep of nothing but the base scenarios of a table, if they can be read: to hold variables
    and objectives against, where the rest of the table has a fault."""
    name, base, own = table["name"], table.get("base"), table.get("set", {})
    sources = [base] if isinstance(base, str) else base
    if not isinstance(sources, list | tuple) or not 0 < len(sources) <= MOST_BASES:
        return None
    if not isinstance(own, Mapping) or not all(
        isinstance(one, str) for one in (name, *sources, *own)
    ):
        return None
    try:
        bases = [load_scenario(beside(folder, one), {**own, **changes}) for one in sources]
    except OmnitrackError:
        return None
    named = {one.name: one for one in bases}
    return Sweep.model_construct(name=name, bases=named, set=dict(own))


def _sound(kind: type[_Table], tables: Any, most: int) -> dict[int, _Table]:
    """The tables of a list that have no fault by themselves, by their place in it."""
    found: dict[int, _Table] = {}
    for i, table in enumerate(tables[:most] if isinstance(tables, list | tuple) else ()):
        with suppress(StudyError):
            if isinstance(table, Mapping):
                found[i] = checked(kind, table, "", _fault, StudyError)
    return found


def _placed(fault: Fault, number: int) -> Fault:
    """A fault of a sweep, with its place in the study."""
    if fault.where.startswith("--set "):
        return fault
    return fault.at(f"trials.{number}.{fault.where}")


def _started(variable: Variable, base: Mapping[str, Any]) -> Variable:
    """A variable that knows where the search begins, and whether it takes whole numbers."""
    present = value_at(base, matches(base, variable.name)[0])
    whole = type(present) is int if variable.whole is None else variable.whole
    start = variable.start
    if start is None and isinstance(present, int | float):
        start = float(present) if variable.low <= present <= variable.high else None
    if start is None:
        start = variable.value_at(0.5)
    start = round(start) if whole else start
    return variable.model_copy(update={"start": start, "whole": whole})


def _named(objective: Objective) -> Objective:
    return objective.model_copy(update={"name": objective.name or objective.metric})


def _fault(item: Mapping[str, Any]) -> Fault:
    """One of pydantic's errors as a fault; a path, which takes two kinds of value, has two."""
    places = [str(place) for place in item["loc"]]
    if places[:1] == ["variables"] and "path" in places:
        where = ".".join(places[: places.index("path") + 1])
        missing = item["type"] == "missing"
        return Fault(where, "is missing" if missing else "is neither a text nor a list of texts")
    return fault_of(item, "", (), _choices_at)


def _choices_at(places: list[str]) -> tuple[str, ...]:
    """Valid keys of the table at a pydantic path."""
    table = _TABLES.get(places[0]) if places else StudyFile
    return tuple(table.model_fields) if table else ()
