"""Studies: searches for the values of scenarios that are best over their trials.

The trials are all that is kept of a search. With their results it takes the same way again, so it
goes on from wherever it was killed.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Sequence
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
import pyarrow as pa
from pydantic import Field

from omnitrack_sim.base.bounds import MAX_TRIALS
from omnitrack_sim.base.errors import StudyError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import finite
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.scenario.model import unit_of
from omnitrack_sim.show.plots.study_chart import ObjectiveAxis, TriedCandidates, study_figure
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.trials.batches import (
    FORMAT,
    Batch,
    Trial,
    batched,
    fitted,
    sha256_of,
)
from omnitrack_sim.trials.measure import Measure
from omnitrack_sim.trials.plan import Conclusion, Plan, Round, Rounds
from omnitrack_sim.trials.search import (
    Candidate,
    History,
    Measured,
    Search,
    best_of,
    front,
    to_be_checked,
    values_of,
    violations_of,
)
from omnitrack_sim.trials.search_plan import (
    OF_TRIALS,
    SUCCESS_RATE,
    Objective,
    SearchPlan,
    metrics_of,
)
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.table import column, refuse_all_invalid

BEST_FILE, VALUES = "best.toml", "values"
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
FOR_THE_RECORD = ("name", "generations", "final")
"""Keys of a study that its first candidates do not depend on: with another number of generations it
continues, or stops earlier."""


class Final(Table):
    """The check of the best candidates on trials that the search has not seen.

    Attributes:
        candidates: how many of the best are checked for each direction of the search; with 0 there
            is no check.
        samples: draws of the random axes; none: as many as in the search.
        seed: of the draws; the second table of trials has the next one, and so on.
    """

    candidates: Annotated[int, Field(ge=0, le=100)] = 3
    samples: Annotated[int, Field(ge=1, le=MAX_TRIALS)] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**62)] = 1_000_003


class Study(SearchPlan, Plan):
    """A search over variables by objectives, each candidate put through the same trials.

    Attributes:
        name: of the study.
        trials: sweeps whose trials every candidate is put through, the same for all.
        final: the check of the best.

    Example:
        >>> study = ot.load_study("controller_gains")
        >>> study.size, study.candidate_count
        (48, 605)
    """

    noun: ClassVar[str] = "study"
    names: ClassVar[tuple[str, ...]] = ("history", "front", "final")
    files: ClassVar[tuple[str, ...]] = (BEST_FILE,)
    figure: ClassVar[str] = "front.png"
    folder: ClassVar[str] = VALUES
    free: ClassVar[tuple[str, ...]] = FOR_THE_RECORD
    packages: ClassVar[tuple[str, ...]] = ("cmaes",)
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

    def data(self) -> dict[str, Any]:
        """Return the study as plain data, with all bases in full."""
        return self.model_dump(mode="json")

    def rounds(self) -> Rounds:
        """Ask for the trials of a generation of candidates at a time, then for those of the check.

        Raises:
            StudyError: no trial of the first generation could run, or gave an objective.
            InputError: the package cmaes is missing.
        """
        search = Search(self)
        while candidates := search.ask():
            search.tell((yield from self._generation(search, candidates)))
        history = search.history
        checked = yield from self._check(history)
        return _conclusion(self, history, checked)

    def _generation(
        self, search: Search, candidates: Sequence[Candidate]
    ) -> Generator[Round, pa.Table, list[Measured]]:
        """Ask for the trials of the next candidates of the search, and evaluate these."""
        table = yield Round(
            batches_of(self, self.trials, candidates),
            _columns(candidates, self.trials, is_check=False),
            self.max_trials,
            "centres of the searches"
            if search.is_at_centres
            else f"generation {search.generation} of {self.generations}",
            {"history": history_table(self, search.history)} if search.history else {},
        )
        measure = Measure(self, self.trials)
        # Only the first generation can tell a wrong set-up from candidates that are merely bad.
        if not search.history:
            refuse_all_invalid(table, "variables", "the first ", StudyError)
            measure.refuse_unmeasured(table)
        return measure(table, len(candidates))

    def _check(self, history: History) -> Generator[Round, pa.Table, History | None]:
        """Ask for trials of the best candidates that the search has not used."""
        if not self.final.candidates:
            return None
        chosen = to_be_checked(self, history, self.final.candidates)
        table = yield Round(
            batches_of(self, self.unseen, chosen),
            _columns(chosen, self.unseen, is_check=True),
            len(history) * self.size + len(chosen) * self._check_size,
            "check of the best",
            {"history": history_table(self, history)},
        )
        return list(zip(chosen, Measure(self, self.unseen)(table, len(chosen)), strict=True))

    @property
    def max_trials(self) -> int:
        """Largest number of trials, of search and check together."""
        checked = self.max_checked(self.final.candidates)
        return self.candidate_count * self.size + checked * self._check_size

    @property
    def _check_size(self) -> int:
        """Number of trials of a candidate in the check."""
        return sum(sweep.size for sweep in self.unseen)


def batches_of(
    study: Study, sweeps: Sequence[Sweep], candidates: Sequence[Candidate]
) -> list[Batch]:
    """Return the trials of candidates in batches that share a model.

    The trials of a candidate stand in the order of the sweeps, behind those of the candidates
    before it.
    """
    batches: list[Batch] = []
    size, first = sum(sweep.size for sweep in sweeps), 0
    for sweep in sweeps:
        trials = []
        for place, candidate in enumerate(candidates):
            values = {name: _values(study, candidate, base) for name, base in sweep.plain.items()}
            for one in map(sweep.trial, range(sweep.size)):
                index = place * size + first + one.index
                trials.append(Trial(index, one.base, one.changes | values[one.base]))
        batches += batched(sweep.plain, trials, sweep.batch)
        first += sweep.size
    return batches


def _values(study: Study, candidate: Candidate, base: dict[str, Any]) -> dict[str, Any]:
    """Values of a candidate by every single place of a plain scenario that takes them."""
    return {
        place: fitted(value, value_at(base, place))
        for path, value in study.settings(candidate.values).items()
        for place in matches(base, path)
    }


def _columns(
    candidates: Sequence[Candidate], sweeps: Sequence[Sweep], is_check: bool
) -> dict[str, list[Any]]:
    """What a study adds to the rows of the trials of candidates."""
    names = [sweep.name for sweep in sweeps for _ in range(sweep.size)]
    return {
        "candidate": [one.number for one in candidates for _ in names],
        "trials": names * len(candidates),
        "check": [is_check] * len(names) * len(candidates),
    }


def _conclusion(study: Study, history: History, checked: History | None) -> Conclusion:
    """What a study comes to: its tables, the best values, and the figure."""
    rows = history if checked is None else checked
    # Judged by the check where there is one: the search favours candidates with lucky draws.
    best = rows[best_of(study, rows)][0]
    table = history_table(study, history)
    # Of an empty list pyarrow does not know that it holds places.
    on_front = pa.array(front(study, history), pa.int64())
    tables = {"history": table, "front": table.take(on_front)}
    if checked is not None:
        tables["final"] = final_table(study, checked)
    kept = [one for one, _ in checked or [(best, None)]]
    values = {f"{VALUES}/{one.number}.toml": _settings(study, one) for one in kept}
    return Conclusion(
        _summary(study, history, checked, best),
        tables,
        {**values, BEST_FILE: _settings(study, best)},
        lambda: draw_front(study, history, checked, best),
    )


def _summary(
    study: Study, history: History, checked: History | None, best: Candidate
) -> dict[str, Any]:
    """Contents of ``summary.json``: the start and the best, in the search and in the check."""
    in_check = {one.number: own for one, own in checked or ()}
    compared = {}
    for name, number in (("start", 0), ("best", best.number)):
        candidate, measured = history[number]
        compared[name] = {
            "number": number,
            "values": study.settings(candidate.values),
            "search": _figures(study, measured),
            "check": _figures(study, in_check[number]) if checked else None,
        }
    counts = {"candidates": len(history), "trials_each": study.size}
    return {**counts, "on_front": len(front(study, history)), **compared}


def _figures(study: Study, measured: Measured) -> dict[str, float | None]:
    """Return objectives by name, None if not finite, and the numbers of passed and all trials."""
    figures = finite(dict(zip(study.columns, measured.values, strict=True)))
    return figures | {"passed": measured.passed, "trials": measured.trials}


def _settings(study: Study, candidate: Candidate) -> bytes:
    """Values of a candidate as ``--set @FILE`` takes them."""
    lines = [f"# Candidate {candidate.number} of the study {study.name}. For --set @FILE."]
    settings = study.settings(candidate.values)
    lines += [f"{json.dumps(path)} = {value!r}" for path, value in settings.items()]
    return ("\n".join(lines) + "\n").encode()


def history_table(study: Study, rows: History) -> pa.Table:
    """Return one row a candidate: its number, generation and search, values, objectives, limits."""
    return _table(study, _history_columns(study, rows))


def final_table(study: Study, rows: History) -> pa.Table:
    """Return the candidates that were checked with their values in the check.

    Success rates have their Wilson intervals beside them, in columns that end in ``_low`` and
    ``_high``.
    """
    columns = _history_columns(study, rows)
    for i, (name, objective) in enumerate(zip(study.columns, study.objectives, strict=True)):
        if objective.metric == SUCCESS_RATE:
            count = sum(s.size for s in study.unseen if objective.trials in (None, s.name))
            ends = [wilson_interval(round(own.values[i] * count), count) for _, own in rows]
            for k, end in enumerate(("low", "high")):
                columns.append((column(f"{name}_{end}", pa.float64()), [one[k] for one in ends]))
    # Front and best are taken anew among the candidates in the check, by their values there.
    on_front, best = set(front(study, rows)), best_of(study, rows)
    places = range(len(rows))
    columns.append((column("on_front", pa.bool_()), [place in on_front for place in places]))
    columns.append((column("best", pa.bool_()), [place == best for place in places]))
    return _table(study, columns)


def _table(study: Study, columns: Sequence[tuple[pa.Field, list[Any]]]) -> pa.Table:
    schema = pa.schema([field for field, _ in columns], metadata={"sha256": study.hash})
    arrays = [pa.array(values, field.type) for field, values in columns]
    return pa.Table.from_arrays(arrays, schema=schema)


def _history_columns(study: Study, rows: History) -> list[tuple[pa.Field, list[Any]]]:
    """The columns of all tables of candidates, with their values."""
    whole, real = pa.int64(), pa.float64()
    candidates, measured = [row[0] for row in rows], [row[1] for row in rows]
    columns = [
        (column(key, whole), [getattr(one, key) for one in candidates])
        for key in ("number", "generation", "search")
    ]
    robots = [base.robot for sweep in study.trials for base in sweep.bases.values()]
    for i, variable in enumerate(study.variables):
        unit = unit_of(variable.name, robots)
        field = column(variable.name, whole if variable.whole else real, unit)
        columns.append((field, [one.values[i] for one in candidates]))
    for i, (name, objective) in enumerate(zip(study.columns, study.objectives, strict=True)):
        field = column(name, real, _unit_of_objective(study, objective))
        columns.append((field, [one.values[i] for one in measured]))
    kept = violations_of(study, values_of(rows)) == 0
    columns.append((column("feasible", pa.bool_()), kept.tolist()))
    columns += [
        (column(key, whole), [getattr(one, key) for one in measured])
        for key in ("trials", "passed", "invalid", "lost")
    ]
    return columns


def _unit_of_objective(study: Study, objective: Objective) -> str:
    bases = [base for sweep in study.trials for base in sweep.bases.values()]
    metric = metrics_of(bases).get(objective.metric)
    return OF_TRIALS.get(objective.metric, "1") if metric is None else metric.unit


def draw_front(study: Study, history: History, checked: History | None, best: Candidate) -> bytes:
    """Draw ``front.png``, of the objectives with a weight; of the others the limits alone count."""
    weighed = list(study.weighed)
    scales = [
        ObjectiveAxis(name, _unit_of_objective(study, objective), objective.goal, objective.limit)
        for name, objective in ((study.columns[i], study.objectives[i]) for i in weighed)
    ]
    values = values_of(history)
    again = values_of(checked)[:, weighed] if checked else np.empty((0, len(scales)))
    places = [one.number for one, _ in checked or ()]
    feasible = violations_of(study, values) == 0
    on_front = front(study, history)
    tried = TriedCandidates(values[:, weighed], feasible, on_front, best.number, again, places)
    return figure_bytes(study_figure(scales, tried))
