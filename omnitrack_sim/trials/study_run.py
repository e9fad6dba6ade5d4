"""Study runs: the search, the values of its objectives by the tables of trials, the check of its
best candidates, and the files of all.

The trials are all that is kept of a search. With their values it takes the same way again, so it
goes on from wherever it was killed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, StudyError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted, finite
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.scenario.model import unit_of
from omnitrack_sim.show.plots.study_chart import ObjectiveAxis, Tried, study_figure
from omnitrack_sim.show.plots.style import figure_bytes
from omnitrack_sim.trials.batches import (
    ERROR,
    INVALID,
    Batch,
    Trial,
    batched,
    fitted,
)
from omnitrack_sim.trials.dispatch import Engine, MakeExecutor, Progress, Status
from omnitrack_sim.trials.search import (
    Candidate,
    History,
    Measured,
    Searches,
    best_of,
    explore,
    front,
    to_be_checked,
    values_of,
    violations_of,
)
from omnitrack_sim.trials.store import (
    PARTS,
    Folder,
    Store,
    TrialColumns,
    column,
    made_by,
    numbers_of,
    refuse_all_invalid,
    to_csv,
    to_json,
    to_parquet,
)
from omnitrack_sim.trials.study import (
    FOR_THE_RECORD,
    OF_TRIALS,
    SUCCESS_RATE,
    Objective,
    SearchPlan,
    Study,
    metrics_of,
)
from omnitrack_sim.trials.sweep import Sweep

_OF_MODULES = {"mean": np.mean, "max": np.max, "min": np.min, "sum": np.sum}
LEAVE_OUT = "leave_out"
"""Default treatment of failed trials."""
LOST = (Outcome.DIVERGED.value, ERROR)
"""Outcomes of trials that ran and have no figures to be trusted."""


class Measure:
    """Evaluation of the objectives on a table of trials.

    Args:
        plan: with the objectives.
        sweeps: that the trials of a candidate are of, in their order.
    """

    def __init__(self, plan: SearchPlan, sweeps: Sequence[Sweep]):
        self.plan = plan
        self._part_of: dict[str | None, NDArray[np.bool_]] = {}
        owner = np.repeat([sweep.name for sweep in sweeps], [sweep.size for sweep in sweeps])
        for objective in plan.objectives:
            of_all = objective.trials is None
            self._part_of[objective.trials] = of_all | (owner == objective.trials)

    def __call__(self, table: pa.Table, count: int) -> list[Measured]:
        """Evaluate ``count`` candidates, whose trials stand one after the other."""
        outcome = np.array(table["outcome"].to_pylist()).reshape(count, -1)
        passed = np.array(table["success"].to_pylist(), bool).reshape(count, -1)
        invalid, lost = outcome == INVALID, np.isin(outcome, LOST)
        values = np.stack(
            [
                self._values(objective, table, passed, invalid | lost)
                for objective in self.plan.objectives
            ],
            axis=1,
        )
        return [
            Measured(
                tuple(own.tolist()),
                outcome.shape[1],
                int(passed[i].sum()),
                int(invalid[i].sum()),
                int(lost[i].sum()),
            )
            for i, own in enumerate(values)
        ]

    def _values(
        self,
        objective: Objective,
        table: pa.Table,
        passed: NDArray[np.bool_],
        without: NDArray[np.bool_],
    ) -> Array:
        """Values (C,) of one objective; ``passed`` and ``without`` (figures) are (C, T)."""
        part = self._part_of[objective.trials]
        if objective.metric == SUCCESS_RATE:
            return passed[:, part].mean(axis=1)
        figures = metric_values(objective, table).reshape(passed.shape)
        # A trial that broke must not help its candidate, as it would if it were left out.
        worst = without | ~np.isfinite(figures)
        if objective.failed == "worst":
            worst |= ~passed
        figures = np.where(worst, objective.worst_value, figures)
        counted = passed | worst if objective.failed in (None, LEAVE_OUT) else passed | True
        return np.array(
            [
                _aggregate(objective, own[part & kept])
                for own, kept in zip(figures, counted, strict=True)
            ]
        )

    def refuse_unmeasured(self, table: pa.Table) -> None:
        """Raise if an objective has no value in any completed trial.

        That is so where no trial gives its metric, or where it counts only trials that passed and
        none has: no candidate would have a value.

        Raises:
            StudyError: names each of them.
        """
        outcome = table["outcome"].to_pylist()
        ran = np.array([one not in (INVALID, *LOST) for one in outcome])
        passed = np.array(table["success"].to_pylist(), bool)
        faults = []
        for i, objective in enumerate(self.plan.objectives):
            # The trials of one candidate repeat for each of them.
            part = np.resize(self._part_of[objective.trials], len(ran)) & ran
            if objective.metric == SUCCESS_RATE or not part.any():
                continue
            if not np.isfinite(metric_values(objective, table)[part]).any():
                ran_there = counted(int(part.sum()), "trial")
                problem = f"{objective.metric!r} has no finite value in {ran_there}"
                faults.append(Fault(f"objectives.{i}.metric", problem))
            elif objective.failed != "count" and objective.worst is None and not passed[part].any():
                problem = f"{objective.metric}: no trial of the first generation passed, and with "
                problem += f"failed = {json.dumps(objective.failed or LEAVE_OUT)} only those that "
                problem += 'passed have a finite value: use failed = "count", or easier trials'
                faults.append(Fault(f"objectives.{i}", problem))
        if faults:
            raise StudyError(faults)


def metric_values(objective: Objective, table: pa.Table) -> Array:
    """Metric of an objective in each trial; NaN where a trial has none."""
    name, module = objective.metric, objective.module
    if module is None or isinstance(module, int):
        return numbers_of(table, name if module is None else f"{name}_{module}")
    each = [numbers_of(table, f"{name}_{i}") for i in range(1, MODULES + 1)]
    return _OF_MODULES[module](each, axis=0)


def _aggregate(objective: Objective, figures: Array) -> float:
    """Aggregate the values of trials to one number; the worst value where there are none."""
    how = objective.aggregate or "mean"
    if not len(figures):
        return objective.worst_value
    if how == "mean":
        return float(figures.mean())
    part = {"min": 0.0, "median": 0.5, "max": 1.0}.get(how)
    part = int(how[1:]) / 100 if part is None else part
    # Values are taken as they are: between an infinite one and another there is no middle.
    return float(np.quantile(figures, part, method="inverted_cdf"))


HISTORY_FILE, HISTORY_CSV, FRONT_FILE = "history.parquet", "history.csv", "front.csv"
FINAL_FILE, BEST_FILE, SUMMARY_FILE = "final.csv", "best.toml", "summary.json"
VALUES = "values"


class StudyFolder(Folder):
    """The folder of a study."""

    noun = "study"
    files = (
        HISTORY_FILE,
        HISTORY_CSV,
        FRONT_FILE,
        FINAL_FILE,
        BEST_FILE,
        SUMMARY_FILE,
        "front.png",
    )
    folders = (PARTS, VALUES)
    digits = 9
    free = FOR_THE_RECORD
    packages = ("cmaes",)


@dataclass(frozen=True, eq=False)
class StudyResult:
    """Result of a study.

    Attributes:
        study: that was run.
        table: one row a candidate.
        status: how many trials of the last stage there are, were found done, and are done now.
        folder: of the files; None if nothing was written.
        summary: as in ``summary.json``.
        front: rows of the candidates that no other one beats.
        final: the best ones on trials that the search has not seen; None without a check.
        best: values of the best one, by path.

    Example:
        >>> result = ot.run_study(ot.load_study("controller_gains"))  # doctest: +SKIP
        >>> ot.override(ot.load_scenario("tee_turn"), result.best)  # doctest: +SKIP
    """

    study: Study
    table: pa.Table
    status: Status
    folder: Path | None
    summary: dict[str, Any]
    front: pa.Table
    final: pa.Table | None
    best: dict[str, float | int]


def run_study(
    study: Study,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    executor: Executor | MakeExecutor | None = None,
    progress: Progress | None = None,
) -> StudyResult:
    """Run the missing trials of a study.

    The history depends on the study alone: not on the number of workers, and not on interruptions.

    Args:
        study: what is searched.
        out: folder of the files; trials of earlier runs are found there. Without one nothing is
            written.
        workers: processes that run trials; with 1 this one does.
        executor: runs them instead, as in ``run_sweep``.
        progress: called with the ``Status`` at the beginning of each generation and after each
            batch of trials.

    Raises:
        StudyError: the first candidates have only invalid trials, or no value of an objective.
        InputError: no such number of workers, or the package cmaes is missing.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.

    Example:
        >>> study = ot.load_study("controller_gains")
        >>> ot.run_study(study, out="out/gains", workers=8).best  # doctest: +SKIP
    """
    check_is(Study, "study", study)
    Searches(study)  # refuses before anything is written where cmaes is missing
    with Engine(workers, executor, progress) as engine:
        return _StudyRun(study, out, engine).result()


def batches_of(
    study: Study, sweeps: Sequence[Sweep], candidates: Sequence[Candidate]
) -> list[Batch]:
    """Return the trials of candidates in batches that share a model.

    The trials of a candidate are numbered in the order of the sweeps, after those of the candidates
    with smaller numbers.
    """
    batches: list[Batch] = []
    size, first = sum(sweep.size for sweep in sweeps), 0
    for sweep in sweeps:
        trials = []
        for candidate in candidates:
            values = {name: _values(study, candidate, base) for name, base in sweep.plain.items()}
            for one in map(sweep.trial, range(sweep.size)):
                number = candidate.number * size + first + one.index
                trials.append(Trial(number, one.base, one.changes | values[one.base]))
        batches += batched(sweep.plain, trials, sweep.batch)
        first += sweep.size
    # In the folder batches of all generations stand together, so each has its first trial's number.
    return [replace(batch, number=batch.trials[0].index) for batch in batches]


def _values(study: Study, candidate: Candidate, base: dict[str, Any]) -> dict[str, Any]:
    """Values of a candidate by every single place of a plain scenario that takes them."""
    return {
        place: fitted(value, value_at(base, place))
        for path, value in study.settings(candidate.values).items()
        for place in matches(base, path)
    }


class _StudyRun:
    """One run of a study."""

    def __init__(self, study: Study, out: str | Path | None, engine: Engine):
        self.study, self.engine = study, engine
        columns = TrialColumns(base for sweep in study.trials for base in sweep.bases.values())
        data = study.model_dump(mode="json")
        self.folder = None if out is None else StudyFolder(out, study.hash, data, columns)
        self.store = self.folder or Store(columns)
        self.makers: set[str] = set()  # versions and commits of the batches, as JSON
        self.ran = 0

    def result(self) -> StudyResult:
        """Run search and check, write the files, and return the result."""
        study, engine = self.study, self.engine
        check = study.most_checked(study.final.candidates) * self._size_of_check
        engine.begin(study.candidate_count * study.size + check, "generation 1")
        search = partial(self._evaluate, study.trials)
        history = explore(study, search, self._after_generation)
        checked = self._checked(history)
        final = None if checked is None else final_table(study, checked)
        rows = history if checked is None else checked
        # Judged by the check where there is one: the search favours candidates with lucky draws.
        best = rows[best_of(study, rows)][0]
        table = history_table(study, history)
        result = StudyResult(
            study=study,
            table=table,
            status=engine.status,
            folder=None if self.folder is None else self.folder.path,
            summary=self._summary(history, checked, best),
            # Of an empty list pyarrow does not know that it holds places.
            front=table.take(pa.array(front(study, history), pa.int64())),
            final=final,
            best=study.settings(best.values),
        )
        if self.folder is not None:
            files = _files(result, self.folder.path, checked or [(best, Measured(()))], best)
            self.folder.finish(files, lambda: draw_front(study, history, checked, best))
        return result

    @property
    def _size_of_check(self) -> int:
        """Trials of a candidate in the check."""
        return sum(sweep.size for sweep in self.study.unseen)

    def _evaluate(self, sweeps: Sequence[Sweep], candidates: Sequence[Candidate]) -> list[Measured]:
        """Put all candidates through the trials of ``sweeps``, and evaluate the objectives.

        Raises:
            StudyError: no trial of the first generation could run, or gave an objective.
        """
        batches = batches_of(self.study, sweeps, candidates)
        tables = self.engine.run([(self.store, batch) for batch in batches])
        self.makers |= {made_by(table) for table in tables}
        table, measure = self.store.columns.merged(tables), Measure(self.study, sweeps)
        # Only the first generation can tell a wrong set-up from candidates that are merely bad.
        if candidates[0].number == 0 and sweeps is self.study.trials:
            refuse_all_invalid(table, "variables", "the first ", StudyError)
            measure.refuse_unmeasured(table)
        return measure(table, len(candidates))

    def _after_generation(self, history: History) -> None:
        """Keep the history so far, unless all of the generation was there before."""
        status = self.engine.status
        before, self.ran = self.ran, status.done - status.found
        number, last = history[-1][0].generation, self.study.generations
        stage = f"generation {number + 1} of {last}" if number < last else "centres of the searches"
        self.engine.enter(stage)
        # A study that is resumed passes generations that are on the disk already.
        if self.folder is not None and self.ran > before:
            for name, data in _history_files(history_table(self.study, history)).items():
                self.folder.put(name, data)

    def _checked(self, history: History) -> History | None:
        """Evaluate the best candidates on trials that the search has not used."""
        most = self.study.final.candidates
        if not most:
            return None
        chosen = to_be_checked(self.study, history, most)
        total = self.engine.status.done + len(chosen) * self._size_of_check
        self.engine.enter("check of the best", total)
        return list(zip(chosen, self._evaluate(self.study.unseen, chosen), strict=True))

    def _summary(
        self, history: History, checked: History | None, best: Candidate
    ) -> dict[str, Any]:
        """Contents of ``summary.json``."""
        study, makers = self.study, sorted(self.makers)
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
        return {
            "name": study.name,
            "study_sha256": study.hash,
            "candidates": len(history),
            "trials_each": study.size,
            "on_front": len(front(study, history)),
            **compared,
            "provenance": {"seed": study.seed, "made_by": [json.loads(text) for text in makers]},
        }


def _figures(study: Study, measured: Measured) -> dict[str, float | None]:
    """Return objectives by name, None if not finite, and the numbers of passed and all trials."""
    figures = finite(dict(zip(study.columns, measured.values, strict=True)))
    return figures | {"passed": measured.passed, "trials": measured.trials}


def _files(
    result: StudyResult, folder: Path, kept: History, best: Candidate
) -> dict[str, bytes | None]:
    """The files of a study that is finished, but for its figure."""
    study = result.study
    values = {f"{VALUES}/{one.number}.toml": _settings(study, one) for one, _ in kept}
    # Files of an earlier, shorter search go; those that are still valid follow below.
    stale = [path.name for path in (folder / VALUES).glob("*.toml")]
    return {
        **_history_files(result.table),
        FRONT_FILE: to_csv(result.front),
        FINAL_FILE: None if result.final is None else to_csv(result.final),
        **{f"{VALUES}/{name}": None for name in stale},
        **values,
        BEST_FILE: _settings(study, best),
        SUMMARY_FILE: to_json(result.summary),
    }


def _history_files(table: pa.Table) -> dict[str, bytes | None]:
    return {HISTORY_CSV: to_csv(table), HISTORY_FILE: to_parquet(table)}


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
    schema = pa.schema([field for field, _ in columns], metadata={"study_sha256": study.hash})
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
    for i, variable in enumerate(study.variables):
        field = column(variable.name, whole if variable.whole else real, unit_of(variable.name))
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
    tried = Tried(values[:, weighed], feasible, on_front, best.number, again, places)
    return figure_bytes(study_figure(scales, tried))
