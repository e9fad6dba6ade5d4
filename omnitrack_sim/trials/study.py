"""Studies: plans of a search over variables by objectives; read from files, checked as a whole."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from omnitrack_sim.base.bounds import (
    LARGEST,
    MOST_BASES,
    MOST_CANDIDATES,
    MOST_STUDY_TRIALS,
    MOST_TRIALS,
)
from omnitrack_sim.base.errors import Fault, ScenarioError, StudyError, SweepError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.reading import NAME_PATTERN, STUDY, checked, read_file
from omnitrack_sim.base.table import Table
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.scenario import Scenario, override
from omnitrack_sim.trials.axes import Number, PathTable, above_low
from omnitrack_sim.trials.batches import FORMAT, sha256_of
from omnitrack_sim.trials.sweep import (
    Sweep,
    excess_samples,
    path_fault,
    path_fault_of,
    places_in_file,
    trial_count,
)
from omnitrack_sim.trials.sweep import resolve as resolve_sweep

SUCCESS_RATE = "success_rate"
"""The objective that is no metric of a run: the part of the trials that reached the goal."""
MOST_VARIABLES, MOST_OBJECTIVES = 100, 10
DIGITS = 9
"""Significant digits of the values that are tried, so that they read the same in every file."""
Name = Annotated[str, Field(min_length=1)]
Module = Literal[1, 2, 3, "mean", "max", "min", "sum"]
"""Module of a metric that has one value for each, or how the three become one number."""


class Variable(PathTable):
    """A value of the scenarios that is varied between two bounds.

    Attributes:
        path: dotted path of a number in all base scenarios, or several that all take the value;
            `*` as in sweeps.
        low: lower bound, included.
        high: upper bound, included.
        scale: "linear": steps are alike by difference; "log": by ratio.
        start: where the search begins; none: the value of the first base scenario if it lies
            within the bounds, else the middle.
        whole: only whole numbers are tried; none: if the value of the base scenario is one.
    """

    low: Number
    high: Number
    scale: Literal["linear", "log"] = "linear"
    start: float | None = None
    whole: bool | None = None

    _is_above = field_validator("high")(above_low)

    @field_validator("scale")
    @classmethod
    def _has_a_logarithm(cls, scale: str, info: ValidationInfo) -> str:
        low = info.data.get("low")
        if scale == "log" and low is not None and low < 1 / LARGEST:
            raise ValueError(f"needs bounds of {1 / LARGEST:g} or more, and low is {low:g}")
        return scale

    @field_validator("start")
    @classmethod
    def _is_within(cls, start: float | None, info: ValidationInfo) -> float | None:
        low, high = info.data.get("low", -math.inf), info.data.get("high", math.inf)
        if start is not None and not low <= start <= high:
            raise ValueError(f"must be from low to high, {low:g} to {high:g}")
        return start

    def value_at(self, place: float) -> float | int:
        """Return the value at a place between the bounds, 0 at ``low`` and 1 at ``high``."""
        if self.scale == "log":
            # Equal steps of `place` are equal ratios.
            value = self.low * (self.high / self.low) ** place
        else:
            value = self.low + (self.high - self.low) * place
        # Rounding to digits may lead beyond a bound that has more of them.
        value = min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)
        return round(value) if self.whole else value

    def place_of(self, value: float) -> float:
        """Return the place of a value between the bounds, from 0 to 1."""
        if self.scale == "log":
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class Objective(Table):
    """Objective of a search: a metric of trials made one number, or their success rate.

    Attributes:
        metric: a metric of a sweep, also one of your own, `duration_s`, `attempts`, `falls`, or
            `success_rate`, the part of the trials that reached the goal.
        goal: "minimise" or "maximise".
        name: of its columns; none: the metric.
        trials: name of the trials that count; none: all of the study.
        module: for metrics that have one value a module: 1, 2, 3, "mean", "max", "min" or "sum".
        aggregate: what becomes of the values of the trials: "mean", "median", "min", "max", or a
            percentile such as "p95"; none: the mean.
        failed: what a trial in which the robot failed counts: nothing ("leave_out"), its value
            ("count") or the worst ("worst"); none: nothing.
        worst: what a trial without a value counts; none: infinitely bad.
        limit: the worst value that a candidate may have.
        weight: how much it counts beside the others; with 0 its limit alone counts.
    """

    metric: Name
    goal: Literal["minimise", "maximise"]
    name: Name | None = None
    trials: Name | None = None
    module: Module | None = None
    aggregate: str | None = None
    failed: Literal["leave_out", "count", "worst"] | None = None
    worst: Number | None = None
    limit: Number | None = None
    weight: Annotated[float, Field(ge=0, le=1e6)] = 1.0

    @field_validator("aggregate")
    @classmethod
    def _is_known(cls, aggregate: str | None) -> str | None:
        if aggregate is not None and not re.fullmatch(r"mean|median|min|max|p\d\d?", aggregate):
            raise ValueError("is none of mean, median, min, max and percentiles such as p95")
        return aggregate

    @property
    def sign(self) -> float:
        """Factor that makes smaller values the better ones."""
        return 1.0 if self.goal == "minimise" else -1.0

    @property
    def worst_value(self) -> float:
        """Value that a trial without one counts as."""
        return self.sign * math.inf if self.worst is None else self.worst


class Final(Table):
    """The check of the best candidates on trials that the search has not seen.

    Attributes:
        candidates: how many of the best are checked for each direction of the search; with 0 there
            is no check.
        samples: draws of the random axes; none: as many as in the search.
        seed: of the draws; the second table of trials has the next one, and so on.
    """

    candidates: Annotated[int, Field(ge=0, le=100)] = 3
    samples: Annotated[int, Field(ge=1, le=MOST_TRIALS)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**62)] = 1_000_003


class SearchPlan(Table):
    """Plan of a search: its variables, objectives and extent.

    Attributes:
        variables: what is varied.
        objectives: what is asked for, at most ten.
        generations: how often each search asks for candidates.
        population: how many it asks for, at least 4; more of them bear more noise; none:
            4 + 3 ln(number of variables), as CMA-ES has it.
        directions: how many searches there are, each for another weighing of the objectives; none:
            1 for one objective, else twice their number and 1.
        step: standard deviation of the first candidates about the start, as part of the range.
        seed: of the candidates.
    """

    variables: Annotated[tuple[Variable, ...], Field(min_length=1, max_length=MOST_VARIABLES)]
    objectives: Annotated[tuple[Objective, ...], Field(min_length=1, max_length=MOST_OBJECTIVES)]
    generations: Annotated[int, Field(ge=1, le=100_000)] = 20
    population: Annotated[int, Field(ge=4, le=10_000)] | None = None
    directions: Annotated[int, Field(ge=1, le=100)] | None = None
    step: Annotated[float, Field(ge=1e-6, le=10)] = 0.25
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0

    @property
    def weighed(self) -> tuple[int, ...]:
        """Indices of the objectives that are more than a limit."""
        return tuple(i for i, objective in enumerate(self.objectives) if objective.weight > 0)

    @property
    def search_count(self) -> int:
        """Number of searches."""
        if self.directions is not None:
            return self.directions
        return 1 if len(self.weighed) == 1 else 2 * len(self.weighed) + 1

    @property
    def asked_each(self) -> int:
        """Candidates that a search asks for in a generation."""
        return self.population or 4 + math.floor(3 * math.log(len(self.variables)))

    @property
    def candidate_count(self) -> int:
        """Candidates of the whole search: the start, the generations, and the centres."""
        return 1 + self.search_count * (self.generations * self.asked_each + 1)

    def most_checked(self, best: int) -> int:
        """Most candidates of a check of the ``best`` ones of each search, its centre, and the
        start; 0 where there is none."""
        return 1 + self.search_count * (best + 1) if best else 0


OF_TRIALS = {"duration_s": "s", "attempts": "1", "falls": "1"}
"""Figures of a trial beside its metrics, with their units."""
RESERVED = (
    "number",
    "generation",
    "search",
    "feasible",
    "trials",
    "passed",
    "invalid",
    "lost",
    "on_front",
    "best",
)
"""Columns that the tables of a study have beside variables and objectives."""
_ENDS = ("low", "high")


FOR_THE_RECORD = ("name", "generations", "final")
"""Keys of a study that its first candidates do not depend on: with another number of generations it
continues, or stops earlier."""


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


class Study(SearchPlan):
    """A resolved study.

    Attributes:
        name: of the study.
        trials: sweeps whose trials every candidate is put through, the same for all.
        final: the check of the best.

    Example:
        >>> study = ot.load_study("controller_gains")
        >>> study.size, study.candidate_count
        (48, 605)
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
        data = self.model_dump(mode="json", exclude=dict.fromkeys(FOR_THE_RECORD, True))
        return sha256_of([FORMAT, data])

    @cached_property
    def unseen(self) -> tuple[Sweep, ...]:
        """The trials of the check: the same sweeps, drawn anew."""
        sweeps = []
        for i, sweep in enumerate(self.trials):
            fields = {name: getattr(sweep, name) for name in Sweep.model_fields}
            # A seed for each sweep, so that sweeps with the same axes do not share their draws.
            drawn = {"seed": self.final.seed + i, "samples": self.final.samples or sweep.samples}
            sweeps.append(Sweep.model_validate(fields | drawn))
        return tuple(sweeps)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """Names of the objectives."""
        return tuple(objective.name or objective.metric for objective in self.objectives)

    def settings(self, values: tuple[float | int, ...]) -> dict[str, float | int]:
        """Return the values of a candidate by path, as ``--set`` takes them."""
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

    Example:
        >>> study = ot.load_study("controller_gains", {"control.cruise_speed": 0.08})
        >>> study.variables[0].name
        'robot.motor.speed_bandwidth'
    """
    path, data = read_file(source, STUDY, StudyError)
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
    if len(bases) > MOST_BASES:
        return [Fault("trials", f"have {len(bases)} base scenarios; at most {MOST_BASES}")]
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
        modules = ("1", "2", "3", "mean", "max", "min", "sum")
        yield Fault(f"{where}.module", "is missing: the metric has a value each module", modules)
    if objective.module is not None and not per_module:
        yield Fault(f"{where}.module", f"{name!r} has one value for all modules")


def metrics_of(bases: Sequence[Scenario]) -> dict[str, Metric]:
    """Return all metrics of trials of these scenarios, by name."""
    return {metric.name: metric for base in bases for metric in base.all_metrics}


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
    if file.candidate_count > MOST_CANDIDATES:
        problem = f"ask for {file.candidate_count} candidates in all; at most {MOST_CANDIDATES}"
        yield Fault("generations", problem)
        return
    at_once = file.search_count * file.asked_each
    chosen = file.most_checked(file.final.candidates)
    checks = [
        chosen * trial_count(len(sweep.bases), sweep.axes, file.final.samples or sweep.samples)
        for sweep in sweeps
    ]
    size = sum(sweep.size for sweep in sweeps)
    for where, trials, most in (
        ("generations", file.candidate_count * size, MOST_STUDY_TRIALS),
        ("population", at_once * size, MOST_TRIALS),
        ("final.samples", sum(checks), MOST_TRIALS),
    ):
        if trials > most:
            yield Fault(where, f"makes {trials} trials; at most {most}")
    for i, (sweep, check) in enumerate(zip(sweeps, checks, strict=True)):
        together = min(sweep.batch, max(sweep.size * at_once, check))
        for fault in excess_samples(together, sweep.bases.values()):
            yield fault.at(f"trials.{i}.{fault.where}")
