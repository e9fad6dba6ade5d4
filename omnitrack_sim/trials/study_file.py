"""Study files: read, and checked as a whole in the light of their trials."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from omnitrack_sim.base.bounds import MAX_BASES, MAX_CANDIDATES, MAX_TRIALS
from omnitrack_sim.base.errors import Fault, ScenarioError, StudyError, SweepError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.reading import NAME_PATTERN, STUDY, checked, read_file
from omnitrack_sim.scenario import Scenario, override
from omnitrack_sim.trials.search_plan import (
    OF_TRIALS,
    SUCCESS_RATE,
    Objective,
    SearchPlan,
    Variable,
    metrics_of,
)
from omnitrack_sim.trials.study import RESERVED, Final, Study
from omnitrack_sim.trials.sweep import Sweep, trial_count
from omnitrack_sim.trials.sweep_file import (
    excess_samples,
    path_fault,
    path_fault_of,
    places_in_file,
)
from omnitrack_sim.trials.sweep_file import resolve as resolve_sweep

_ENDS = ("low", "high")


class StudyFile(SearchPlan):
    """A study file as it is written; docs/how-to/optimise.md has an example.

    Attributes:
        name: names the folder below `out/`; the file's own name if left out.
        trials: what every candidate is put through: sweeps, at least one.
        final: the check of the best candidates.
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)]
    trials: Annotated[tuple[dict[str, Any], ...], Field(min_length=1, max_length=100)]
    final: Final = Final()


def load_study(
    source: str | Path, changes: Mapping[str, Any] | None = None, *, batch: int | None = None
) -> Study:
    """Read a study file, or a shipped study by name.

    Args:
        source: the file or name.
        changes: of the base scenarios by dotted path; they come after those of the file's ``set``,
            and both are set before the base scenarios are checked.
        batch: trials that run together, see ``load_sweep``.

    Raises:
        StudyError: no such file, bad TOML or JSON, or any fault in it; every fault is listed with
            its path in the file.

    Example:
        >>> study = ot.load_study("controller_gains", {"control.cruise_speed": 0.08})
        >>> study.variables[0].name
        'robot.motor.speed_bandwidth'
    """
    path, data = read_file(source, STUDY, StudyError)
    trials = data.get("trials")
    if batch is not None and isinstance(trials, list):
        own = [one | {"batch": batch} if isinstance(one, dict) else one for one in trials]
        data = data | {"trials": own}
    return resolve(data, path.parent, changes)


def resolve(
    data: Mapping[str, Any], folder: Path = Path(), changes: Mapping[str, Any] | None = None
) -> Study:
    """Return a study from plain data as read from TOML or JSON.

    Args:
        data: of the file.
        folder: that paths of base scenarios are relative to.
        changes: see ``load_study``.

    Raises:
        StudyError: lists every fault with its dotted path.
    """
    file = checked(StudyFile, data, StudyError, own_fault=path_fault_of)
    sweeps = _sweeps(file.trials, folder, changes or {})
    faults = [*_table_faults(file, sweeps), *_disagreements(file, sweeps), *_excess(file, sweeps)]
    if faults:
        raise StudyError(list(dict.fromkeys(faults)))
    fields = {name: getattr(file, name) for name in SearchPlan.model_fields}
    # Variables start from the first base scenario: several may have different values.
    first = next(iter(sweeps[0].bases.values())).model_dump(mode="json")
    fields["variables"] = tuple(_started(variable, first) for variable in file.variables)
    fields["objectives"] = tuple(
        one.model_copy(update={"name": one.name or one.metric}) for one in file.objectives
    )
    return Study(**fields, name=file.name, trials=sweeps, final=file.final)


def _sweeps(
    tables: Sequence[Mapping[str, Any]], folder: Path, changes: Mapping[str, Any]
) -> tuple[Sweep, ...]:
    """Read the sweeps of ``trials``.

    Raises:
        StudyError: lists every fault with its dotted path.
    """
    sweeps: list[Sweep] = []
    faults: list[Fault] = []
    for i, table in enumerate(tables):
        if "group_by" in table:
            faults.append(Fault(f"trials.{i}.group_by", "is for sweeps; leave it out"))
        base = table.get("base")
        name = Path(base).stem if isinstance(base, str) else f"trials_{i}"
        try:
            sweep = resolve_sweep({"name": name} | dict(table), folder, changes)
        except SweepError as error:
            faults += [
                fault if fault.where.startswith("--set ") else fault.at(f"trials.{i}.{fault.where}")
                for fault in error.faults
            ]
            continue
        if sweep.name in [one.name for one in sweeps]:
            problem = f"{sweep.name!r} is the name of earlier trials; give these another name"
            faults.append(Fault(f"trials.{i}.name", problem))
        sweeps.append(sweep)
    if faults:
        raise StudyError(list(dict.fromkeys(faults)))
    return tuple(sweeps)


def _started(variable: Variable, base: Mapping[str, Any]) -> Variable:
    """Variable with its start, and whether it takes whole numbers, filled in from a base."""
    present = value_at(base, matches(base, variable.name)[0])
    whole = type(present) is int if variable.whole is None else variable.whole
    start = variable.start
    if start is None and isinstance(present, int | float):
        # A value outside of its bounds cannot be a start: then the middle is taken.
        start = float(present) if variable.low <= present <= variable.high else None
    if start is None:
        start = variable.value_at(0.5)
    start = round(start) if whole else start
    return variable.model_copy(update={"start": start, "whole": whole})


def _table_faults(file: StudyFile, sweeps: Sequence[Sweep]) -> list[Fault]:
    """Faults of variables and objectives in the light of the trials."""
    bases = [base for sweep in sweeps for base in sweep.bases.values()]
    if len(bases) > MAX_BASES:
        return [Fault("trials", f"have {len(bases)} base scenarios; at most {MAX_BASES}")]
    faults: list[Fault] = []
    for i, variable in enumerate(file.variables):
        own = [
            path_fault(at, path, bases, partial(_misfit, path))
            for at, path in places_in_file(f"variables.{i}", variable.path)
        ]
        own = [*filter(None, own), *_clashes(i, file.variables, sweeps)]
        # Bounds can be tried only where all paths lead somewhere.
        faults += own
    if not faults:
        for i in range(len(file.variables)):
            faults += _bound_faults(i, file.variables, bases)
    names = [variable.name for variable in file.variables]
    for i, objective in enumerate(file.objectives):
        earlier = [one.name or one.metric for one in file.objectives[:i]]
        faults += _objective_faults(f"objectives.{i}", objective, sweeps, earlier, names)
    return faults


def _misfit(path: str, present: Any) -> str | None:
    """Problem of replacing ``present`` by a number; None if there is none."""
    if isinstance(present, list):
        return f"is a list; name one of its numbers, as in {path}.0"
    is_word = isinstance(present, bool | str)
    return f"is {json.dumps(present)}, not a number" if is_word else None


def _clashes(
    number: int, variables: Sequence[Variable], sweeps: Sequence[Sweep]
) -> Iterator[Fault]:
    """Fault of the first value that something else sets as well."""
    own = variables[number]
    for i, sweep in enumerate(sweeps):
        data = next(iter(sweep.bases.values())).model_dump(mode="json")
        places = {place for path in own.paths for place in matches(data, path)}
        others = [(f"variables.{k}", one.paths) for k, one in enumerate(variables[:number])]
        others += [(f"trials.{i}.axes.{k}", one.paths) for k, one in enumerate(sweep.axes)]
        others += [(f"trials.{i}.set or --set", tuple(sweep.set))]
        for origin, paths in others:
            taken = {place for path in paths for place in matches(data, path)} & places
            if taken:
                yield Fault(f"variables.{number}.path", f"{min(taken)!r} is set by {origin} too")
                return


def _bound_faults(
    number: int, variables: Sequence[Variable], bases: Sequence[Scenario]
) -> Iterator[Fault]:
    """Faults of bounds that are invalid at both ends of the other variables.

    A bound that only does not go with some values of the others is none: such candidates have
    invalid trials, which count as failed.
    """
    variable, others = variables[number], [*variables[:number], *variables[number + 1 :]]
    for end in _ENDS:
        at = f"variables.{number}.{end}"
        for base in bases:
            data = base.model_dump(mode="json")
            own = _placed(data, variable, getattr(variable, end))
            # Nearly all bounds fit the base as it is, and are tried no further.
            faults = _refused(base, own, {})
            if not faults:
                continue
            # Only the two corners of the other variables are tried: all of them would be
            # exponentially many.
            corners: list[dict[str, float | int]] = []
            for side in _ENDS:
                placed = [_placed(data, other, getattr(other, side)) for other in others]
                corners.append({place: value for one in placed for place, value in one.items()})
            if all(_refused(base, own, corner) for corner in corners):
                yield from dict.fromkeys(fault.at(at) for fault in faults)
                break


def _refused(
    base: Scenario, own: Mapping[str, float | int], others: Mapping[str, float | int]
) -> list[Fault]:
    """Faults of a scenario with all these values at the places of ``own``."""
    try:
        override(base, {**others, **own})
    except ScenarioError as error:
        return [fault for fault in error.faults if fault.where in own]
    return []


def _placed(data: Mapping[str, Any], variable: Variable, value: float) -> dict[str, float | int]:
    """A value of a variable by every single place that takes it."""
    places = [place for path in variable.paths for place in matches(data, path)]
    whole = variable.whole is not False and value.is_integer()
    return {
        place: int(value) if whole and type(value_at(data, place)) is int else value
        for place in places
    }


def _objective_faults(
    where: str,
    objective: Objective,
    sweeps: Sequence[Sweep],
    names: Sequence[str],
    taken: Sequence[str],
) -> Iterator[Fault]:
    """Faults of one objective.

    Args:
        where: its place in the file.
        objective: to be checked.
        sweeps: the trials that it may name.
        names: of the objectives before it.
        taken: names of other columns.
    """
    name = objective.name or objective.metric
    if name in (*RESERVED, *taken):
        yield Fault(f"{where}.name", f"{name!r} is another column of the tables; give another")
    if name in names:
        yield Fault(f"{where}.name", f"{name!r} is the name of an earlier objective; give another")
    chosen = tuple(sweep.name for sweep in sweeps)
    if objective.trials is not None and objective.trials not in chosen:
        problem = f"is {objective.trials!r}"
        yield Fault(f"{where}.trials", problem, chosen, given=objective.trials)
        return
    if objective.metric == SUCCESS_RATE:
        for key in ("module", "aggregate", "failed", "worst"):
            if getattr(objective, key) is not None:
                yield Fault(f"{where}.{key}", f"is not for {SUCCESS_RATE}, which counts all trials")
        return
    counted = [one for one in sweeps if objective.trials in (None, one.name)]
    yield from _metric_faults(where, objective, counted)


def _metric_faults(where: str, objective: Objective, sweeps: Sequence[Sweep]) -> Iterator[Fault]:
    """Faults of a metric that is unknown or not measured, or of its module."""
    bases = [base for sweep in sweeps for base in sweep.bases.values()]
    known, name = metrics_of(bases), objective.metric
    metric = known.get(name)
    measured = [one for one, metric in known.items() if metric.in_tables]
    choices = (SUCCESS_RATE, *OF_TRIALS, *measured)
    if metric is None and name not in OF_TRIALS:
        yield Fault(f"{where}.metric", f"is {name!r}", choices, given=name)
        return
    if metric is not None and not metric.in_tables:
        yield Fault(f"{where}.metric", f"{name!r} is measured in no trial of a study", choices)
        return
    for base in bases if metric is not None else ():
        if name not in metrics_of([base]):
            problem = f"{name!r} is none of base {base.name!r}; name the trials with it"
            yield Fault(f"{where}.metric", problem)
    per_module = metric is not None and metric.per_module
    if per_module and objective.module is None:
        count = max(base.robot.modules for base in bases)
        modules = (*(str(i + 1) for i in range(count)), "mean", "max", "min", "sum")
        yield Fault(f"{where}.module", "is missing: the metric has a value each module", modules)
    if objective.module is not None and not per_module:
        yield Fault(f"{where}.module", f"{name!r} has one value for all modules")


def _disagreements(file: StudyFile, sweeps: Sequence[Sweep]) -> Iterator[Fault]:
    """Faults of numbers that contradict each other."""
    weighed = len(file.weighed)
    for i, objective in enumerate(file.objectives):
        if objective.weight == 0 and objective.limit is None:
            yield Fault(f"objectives.{i}.weight", "is 0, which needs a limit")
    if not weighed:
        yield Fault("objectives", "have no weight; one at least is to be minimised or maximised")
    elif weighed == 1 and file.search_count > 1:
        yield Fault("directions", f"is {file.directions}; one objective has one direction")
    elif 1 < file.search_count < weighed:
        problem = f"is {file.directions}; must be 1, or at least the {weighed} objectives"
        yield Fault("directions", problem)
    for i, sweep in enumerate(sweeps):
        if file.final.candidates and file.final.seed + i == sweep.seed:
            yield Fault("final.seed", f"draws the very trials of trials.{i}; take another")


def _excess(file: StudyFile, sweeps: Sequence[Sweep]) -> Iterator[Fault]:
    """Faults of too many candidates or trials, or of too many samples in a batch."""
    if not file.weighed:
        return
    if file.candidate_count > MAX_CANDIDATES:
        problem = f"ask for {file.candidate_count} candidates in all; at most {MAX_CANDIDATES}"
        yield Fault("generations", problem)
        return
    at_once = file.search_count * file.asked_each
    chosen = file.max_checked(file.final.candidates)
    checks = [
        chosen * trial_count(len(sweep.bases), sweep.axes, file.final.samples or sweep.samples)
        for sweep in sweeps
    ]
    size = sum(sweep.size for sweep in sweeps)
    for where, trials in (
        ("generations", file.candidate_count * size),
        ("final.samples", sum(checks)),
    ):
        if trials > MAX_TRIALS:
            yield Fault(where, f"makes {trials} trials; at most {MAX_TRIALS}")
    for i, (sweep, check) in enumerate(zip(sweeps, checks, strict=True)):
        together = min(sweep.batch, max(sweep.size * at_once, check))
        for fault in excess_samples(together, sweep.bases.values()):
            yield fault.at(f"trials.{i}.{fault.where}")
