"""What is wrong with the variables and objectives of a study, given its trials."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from omnitrack_sim.base.bounds import MOST_BASES, MOST_CANDIDATES, MOST_STUDY_TRIALS, MOST_TRIALS
from omnitrack_sim.base.errors import Fault, ScenarioError
from omnitrack_sim.record.metrics import METRICS, Metric
from omnitrack_sim.scenario import Scenario, override
from omnitrack_sim.trials.optimise.tables import SUCCESS_RATE, Final, Objective, Plan, Variable
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep.checks import missing, too_many_samples
from omnitrack_sim.trials.sweep.trials import count, matches, value_at

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


def faults_of(
    variables: Mapping[int, Variable],
    objectives: Mapping[int, Objective],
    sweeps: Mapping[int, Sweep],
    all_trials: bool = True,
) -> list[Fault]:
    """Every fault of variables and objectives in the light of the trials.

    Args:
        variables: those that are sound by themselves, by their place in the file.
        objectives: likewise.
        sweeps: the trials whose base scenarios could be read, by their place in the file.
        all_trials: whether these are all of the file; if not, no objective is held against them.
    """
    faults: list[Fault] = []
    bases = [base for sweep in sweeps.values() for base in sweep.bases.values()]
    if len(bases) > MOST_BASES:
        return [Fault("trials", f"have {len(bases)} base scenarios; at most {MOST_BASES}")]
    for i, variable in variables.items():
        found = [*_path_faults(i, variable, bases), *_clashes(i, variables, sweeps)]
        faults += found or _bound_faults(i, variables, bases)
    names: list[str] = []
    taken = [variable.name for variable in variables.values()]
    counted = list(sweeps.values()) if all_trials else []
    for i, objective in objectives.items():
        faults += _objective_faults(i, objective, counted, names, taken)
        names.append(objective.name or objective.metric)
    return faults


def number_faults(plan: Plan, final: Final, sweeps: Mapping[int, Sweep]) -> list[Fault]:
    """Numbers of a file that do not go together, or ask for too much.

    Args:
        plan: of the file.
        final: of the file.
        sweeps: the trials that are sound, by their place in the file.
    """
    return [*_together(plan, final, sweeps), *_too_much(plan, final, sweeps)]


def _path_faults(number: int, variable: Variable, bases: Sequence[Scenario]) -> Iterator[Fault]:
    """Paths that lead nowhere, or to something that is no number."""
    for i, path in enumerate(variable.paths):
        at = f"variables.{number}.path" + ("" if isinstance(variable.path, str) else f".{i}")
        for base in bases:
            data = base.model_dump(mode="json")
            places = matches(data, path)
            if not places:
                yield missing(at, path, data, base.name if len(bases) > 1 else None)
                break
            present = value_at(data, places[0])
            if isinstance(present, dict):
                yield Fault(at, f"{path!r} is a table; name one value in it", tuple(present))
                break
            if isinstance(present, list):
                yield Fault(at, f"{path!r} is a list; name one of its numbers, as in {path}.0")
                break
            if isinstance(present, bool | str):
                yield Fault(at, f"{path!r} is {json.dumps(present)}, not a number")
                break


def _clashes(
    number: int, variables: Mapping[int, Variable], sweeps: Mapping[int, Sweep]
) -> Iterator[Fault]:
    """A value that something else sets as well: the first one found."""
    own = variables[number]
    for i, sweep in sweeps.items():
        data = next(iter(sweep.bases.values())).model_dump(mode="json")
        places = {place for path in own.paths for place in matches(data, path)}
        others = [(f"variables.{k}", one.paths) for k, one in variables.items() if k < number]
        others += [(f"trials.{i}.axes.{k}", one.paths) for k, one in enumerate(sweep.axes)]
        others += [(f"trials.{i}.set or --set", tuple(sweep.set))]
        for origin, paths in others:
            taken = {place for path in paths for place in matches(data, path)} & places
            if taken:
                yield Fault(f"variables.{number}.path", f"{min(taken)!r} is set by {origin} too")
                return


def _bound_faults(
    number: int, variables: Mapping[int, Variable], bases: Sequence[Scenario]
) -> Iterator[Fault]:
    """Bounds that the scenarios never take, wherever the other variables stand.

    A bound that only does not go with some values of the others is none: such candidates have
    invalid trials, which count as failed.
    """
    variable = variables[number]
    ends = {"low": variable.low, "high": variable.high}
    for end, bound in ends.items():
        for base in bases:
            found = _refused(base, variable, bound, {})
            if found and all(
                _refused(base, variable, bound, _others(base, variables, number, other))
                for other in _ENDS
            ):
                at = f"variables.{number}.{end}"
                yield from dict.fromkeys(fault.at(at) for fault in found)
                break


def _others(
    base: Scenario, variables: Mapping[int, Variable], number: int, end: str
) -> dict[str, float | int]:
    """All variables but one at one of their bounds."""
    data = base.model_dump(mode="json")
    changes: dict[str, float | int] = {}
    for i, variable in variables.items():
        if i != number:
            changes |= _placed(data, variable, getattr(variable, end))
    return changes


def _refused(
    base: Scenario, variable: Variable, bound: float, others: Mapping[str, float | int]
) -> list[Fault]:
    """Faults of a scenario at the very places that the variable sets."""
    own = _placed(base.model_dump(mode="json"), variable, bound)
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
    number: int,
    objective: Objective,
    sweeps: Sequence[Sweep],
    names: Sequence[str],
    taken: Sequence[str],
) -> Iterator[Fault]:
    """What is wrong with one objective; ``names`` are those of the objectives before it, ``taken``
    those of other columns."""
    where = f"objectives.{number}"
    name = objective.name or objective.metric
    if name in (*RESERVED, *taken):
        yield Fault(f"{where}.name", f"{name!r} is another column of the tables; give another")
    if name in names:
        yield Fault(f"{where}.name", f"{name!r} is the name of an earlier objective; give another")
    chosen = tuple(sweep.name for sweep in sweeps)
    if objective.trials is not None and sweeps and objective.trials not in chosen:
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
    """A metric that there is not, or that no trial gives; a module that is missing or too much."""
    bases = [base for sweep in sweeps for base in sweep.bases.values()]
    known = metrics_of(bases)
    given = [name for name, metric in known.items() if metric.in_tables]
    if objective.metric not in known and objective.metric not in OF_TRIALS and bases:
        choices = (SUCCESS_RATE, *OF_TRIALS, *given)
        problem = f"is {objective.metric!r}"
        yield Fault(f"{where}.metric", problem, choices, given=objective.metric)
        return
    metric = known.get(objective.metric)
    if metric is None and objective.metric not in OF_TRIALS:
        return  # it may be one of a base scenario that could not be read
    if metric is not None and not metric.in_tables:
        choices = (SUCCESS_RATE, *OF_TRIALS, *given)
        problem = f"{objective.metric!r} is measured in no trial of a study"
        yield Fault(f"{where}.metric", problem, choices)
        return
    for base in bases if metric is not None else ():
        if objective.metric not in metrics_of([base]):
            problem = f"{objective.metric!r} is none of base {base.name!r}; name the trials with it"
            yield Fault(f"{where}.metric", problem)
    if metric is not None and metric.per_module and objective.module is None:
        choices = ("1", "2", "3", "mean", "max", "min", "sum")
        yield Fault(f"{where}.module", "is missing: the metric has a value each module", choices)
    if objective.module is not None and not (metric is not None and metric.per_module):
        yield Fault(f"{where}.module", f"{objective.metric!r} has one value for all modules")


def metrics_of(bases: Sequence[Scenario]) -> dict[str, Metric]:
    """All metrics of trials of these scenarios, by name."""
    own = [metric for base in bases for metric in base.own_metrics]
    return {metric.name: metric for metric in (*METRICS, *own)}


def _together(plan: Plan, final: Final, sweeps: Mapping[int, Sweep]) -> Iterator[Fault]:
    """Numbers that do not go together."""
    weighed = len(plan.weighed)
    for i, objective in enumerate(plan.objectives):
        if objective.weight == 0 and objective.limit is None:
            yield Fault(f"objectives.{i}.weight", "is 0, which needs a limit")
    if not weighed:
        yield Fault("objectives", "have no weight; one at least is to be minimised or maximised")
    elif weighed == 1 and plan.search_count > 1:
        yield Fault("directions", f"is {plan.directions}; one objective has one direction")
    elif 1 < plan.search_count < weighed:
        problem = f"is {plan.directions}; must be 1, or at least the {weighed} objectives"
        yield Fault("directions", problem)
    for i, (place, sweep) in enumerate(sweeps.items()):
        if final.candidates and final.seed + i == sweep.seed:
            yield Fault("final.seed", f"draws the very trials of trials.{place}; take another")


def _too_much(plan: Plan, final: Final, sweeps: Mapping[int, Sweep]) -> Iterator[Fault]:
    """More candidates or trials than a study may have, or more samples than a batch."""
    if not plan.weighed:
        return
    if plan.candidate_count > MOST_CANDIDATES:
        problem = f"ask for {plan.candidate_count} candidates in all; at most {MOST_CANDIDATES}"
        yield Fault("generations", problem)
        return
    at_once = plan.search_count * plan.asked_each
    chosen = 1 + plan.search_count * (final.candidates + 1) if final.candidates else 0
    checked = {
        i: chosen * count(len(sweep.bases), sweep.axes, final.samples or sweep.samples)
        for i, sweep in sweeps.items()
    }
    size = sum(sweep.size for sweep in sweeps.values())
    for where, trials, most in (
        ("generations", plan.candidate_count * size, MOST_STUDY_TRIALS),
        ("population", at_once * size, MOST_TRIALS),
        ("final.samples", sum(checked.values()), MOST_TRIALS),
    ):
        if trials > most:
            yield Fault(where, f"makes {trials} trials; at most {most}")
    for i, sweep in sweeps.items():
        together = min(sweep.batch, max(sweep.size * at_once, checked[i]))
        for fault in too_many_samples(together, sweep.bases.values()):
            yield fault.at(f"trials.{i}.{fault.where}")
