"""Runs a study: search, check, and the files of both."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError, StudyError
from omnitrack_sim.base.text import counted
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.trials.batches import (
    INVALID,
    Batch,
    Trial,
    batched,
    fitted,
    matches,
    places_of,
    trial_of,
    value_at,
)
from omnitrack_sim.trials.dispatch import MakeExecutor, Pool, Progress, Status, Store, run_missing
from omnitrack_sim.trials.objectives import Measure
from omnitrack_sim.trials.search import (
    Candidate,
    History,
    Measured,
    best_of,
    explore,
    to_be_checked,
)
from omnitrack_sim.trials.store import made_by, to_csv, to_parquet
from omnitrack_sim.trials.study import Study
from omnitrack_sim.trials.study_history import draw_front, final_table, front_table, history_table
from omnitrack_sim.trials.study_store import (
    BEST_FILE,
    FINAL_FILE,
    FRONT_FILE,
    HISTORY_CSV,
    HISTORY_FILE,
    SUMMARY_FILE,
    Folder,
    Layout,
    Memory,
)
from omnitrack_sim.trials.sweep import Sweep

if TYPE_CHECKING:
    import pyarrow as pa
if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class StudyStatus:
    """How far a study is.

    Attributes:
        stage: what is going on, in a few words.
        total: number of trials of the search, or of the check.
        found: those of them that were done before this run.
        done: those that are done now.
        lost: how often workers were lost.
    """

    stage: str
    total: int
    found: int = 0
    done: int = 0
    lost: int = 0


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What a study has found.

    Attributes:
        study: that was run.
        history: one row a candidate.
        front: the candidates that no other one beats.
        final: the best ones on trials that the search has not seen; None without a check.
        best: values of the best one, by path.
        summary: as in ``summary.json``.
    """

    study: Study
    history: pa.Table
    front: pa.Table
    final: pa.Table | None
    best: dict[str, float | int]
    summary: dict[str, Any]


def run_study(
    study: Study,
    out: str | Path | None = None,
    *,
    workers: int = 1,
    executor: Executor | MakeExecutor | None = None,
    progress: Callable[[StudyStatus], None] | None = None,
) -> StudyResult:
    """Run what is not done yet of a study.

    The history depends on the study alone: not on the number of workers, and not on interruptions.

    Args:
        study: what is searched.
        out: folder of the files; trials of earlier runs are found there. Without one nothing is
            written.
        workers: processes that run trials; with 1 this one does.
        executor: runs them instead, as in ``run_sweep``.
        progress: called with the ``StudyStatus`` after each batch of trials.

    Raises:
        StudyError: the first candidates have only invalid trials, or no value of an objective.
        InputError: no such number of workers.
        OutputError: the folder holds something else, or cannot be written; finished trials stay.
        WorkersLost: the given executor has broken; the same call goes on from there.
    """
    check_is(Study, "study", study)
    if workers < 1:
        raise InputError(Fault("workers", f"is {workers}; must be 1 or more"))
    if executor is None and workers > 1:
        executor = lambda: LocalPool(workers)  # noqa: E731
    folder = None if out is None else Folder(out, study)
    with Pool(executor) as pool:
        return _Run(study, folder, pool, progress or (lambda status: None)).all()


class _Run:
    """One run of a study."""

    def __init__(
        self,
        study: Study,
        folder: Folder | None,
        pool: Pool,
        progress: Callable[[StudyStatus], None],
    ):
        self.study, self.folder, self.progress = study, folder, progress
        self.status = StudyStatus("generation 1", study.candidate_count * study.size)
        self.before = self.status
        store = folder or Memory()
        self.search = Trials(study, study.trials, store, pool, self._show)
        self.check = Trials(study, study.unseen, store, pool, self._show)

    def all(self) -> StudyResult:
        """Search, check, write."""
        history = explore(self.study, self.search, self._after_generation)
        checked = self._checked(history)
        final = None if checked is None else final_table(self.study, checked)
        rows = history if checked is None else checked
        best = rows[best_of(self.study, rows)][0]
        front = front_table(self.study, history)
        summary = self._summary(history, checked, best, front.num_rows)
        table = history_table(self.study, history)
        settings = self.study.settings(best.values)
        result = StudyResult(self.study, table, front, final, settings, summary)
        if self.folder is not None:
            _write(self.folder, result, history, checked, best)
        return result

    def _checked(self, history: History) -> History | None:
        """The best candidates on trials that the search has not seen."""
        most = self.study.final.candidates
        if not most:
            return None
        chosen = to_be_checked(self.study, history, most)
        size = sum(sweep.size for sweep in self.study.unseen)
        self.status = StudyStatus("check of the best", len(chosen) * size)
        self.before = self.status
        return list(zip(chosen, self.check(chosen), strict=True))

    def _show(self, status: Status) -> None:
        """Tell how far all is, from how far this generation is."""
        before = self.before
        self.status = replace(
            before,
            found=before.found + status.found,
            done=before.done + status.done,
            lost=before.lost + status.lost,
        )
        self.progress(self.status)

    def _after_generation(self, history: History) -> None:
        """Keep the history so far, unless all of the generation was there before."""
        ran = self.status.done - self.before.done > self.status.found - self.before.found
        number, of = history[-1][0].generation, self.study.generations
        stage = f"generation {number + 1} of {of}" if number < of else "centres of the searches"
        self.before = self.status = replace(self.status, stage=stage)
        if self.folder is not None and ran:
            _write_history(self.folder, history_table(self.study, history))

    def _summary(
        self, history: History, checked: History | None, best: Candidate, on_front: int
    ) -> dict[str, Any]:
        """The contents of ``summary.json``."""
        shown = {one.number: own for one, own in history}
        again = {one.number: own for one, own in checked or ()}
        told = {}
        for name, number in (("start", 0), ("best", best.number)):
            told[name] = {
                "number": number,
                "values": self.study.settings(history[number][0].values),
                "search": _told(self.study, shown[number]),
                "check": _told(self.study, again[number]) if checked else None,
            }
        return {
            "name": self.study.name,
            "study_sha256": self.study.hash,
            "candidates": len(history),
            "trials_each": self.study.size,
            "on_front": on_front,
            **told,
            "provenance": {
                "seed": self.study.seed,
                "made_by": [
                    json.loads(text) for text in sorted(self.search.makers | self.check.makers)
                ],
            },
        }


def _told(study: Study, measured: Measured) -> dict[str, float | None]:
    """Objectives by name, None where there is no finite value; and how many trials passed."""
    named = zip(study.columns, measured.values, strict=True)
    told = {name: value if math.isfinite(value) else None for name, value in named}
    return told | {"passed": measured.passed, "trials": measured.trials}


def _write(
    folder: Folder, result: StudyResult, history: History, checked: History | None, best: Candidate
) -> None:
    """Write all files of a study that is finished; the figure last, for it holds nothing new."""
    study = result.study
    _write_history(folder, result.history)
    folder.write_file(FRONT_FILE, to_csv(result.front))
    if result.final is None:
        folder.remove(FINAL_FILE)
    else:
        folder.write_file(FINAL_FILE, to_csv(result.final))
    folder.write_values(
        {f"{one.number}.toml": _settings(study, one) for one, _ in checked or [(best, None)]}
    )
    folder.write_file(BEST_FILE, _settings(study, best))
    folder.write_file(SUMMARY_FILE, json.dumps(result.summary, indent=2) + "\n")
    folder.write_figure(lambda: draw_front(study, history, checked, best))


def _write_history(folder: Folder, table: pa.Table) -> None:
    folder.write_file(HISTORY_CSV, to_csv(table))
    folder.write_file(HISTORY_FILE, to_parquet(table))


def _settings(study: Study, candidate: Candidate) -> str:
    """The values of a candidate as ``--set @FILE`` takes them."""
    lines = [f"# Candidate {candidate.number} of the study {study.name}. For --set @FILE."]
    settings = study.settings(candidate.values)
    lines += [f"{json.dumps(path)} = {value!r}" for path, value in settings.items()]
    return "\n".join(lines) + "\n"


_TOLD_REASONS = 3


class Trials:
    """Evaluates candidates of a study: an ``Evaluate``.

    Every candidate is put through the same trials: one with the same number has the same draws.

    Args:
        study: with variables and objectives.
        sweeps: whose trials they are.
        store: keeps what has been run, and has what was run before.
        pool: runs the rest.
        progress: called with the status of each generation.
    """

    def __init__(
        self,
        study: Study,
        sweeps: Sequence[Sweep],
        store: Store,
        pool: Pool,
        progress: Progress | None,
    ):
        self.study, self.sweeps, self.store, self.pool = study, sweeps, store, pool
        self.progress = progress
        self.layout = Layout(sweeps)
        self.measure = Measure(study, sweeps)
        self.makers: set[str] = set()

    def __call__(self, candidates: Sequence[Candidate]) -> list[Measured]:
        """What the candidates have shown.

        Raises:
            StudyError: no trial of the first generation could run, or gave an objective.
        """
        import pyarrow as pa

        batches = batches_of(self.study, self.sweeps, candidates)
        run_missing(batches, self.store, self.layout, self.pool, self.progress)
        tables = [table for batch in batches if (table := self.store.read(batch)) is not None]
        self.makers |= {made_by(table) for table in tables}
        plain = [table.replace_schema_metadata(None) for table in tables]
        table = pa.concat_tables(plain).sort_by("trial")
        if candidates[0].number == 0 and self.sweeps is self.study.trials:
            _refuse_all_invalid(table)
            self.measure.refuse_unmeasured(table)
        return self.measure(table, len(candidates))


def _refuse_all_invalid(table: pa.Table) -> None:
    if set(table["outcome"].to_pylist()) == {INVALID}:
        reasons = list(dict.fromkeys(table["reason"].to_pylist()))
        first = counted(table.num_rows, "trial")
        raise StudyError(
            [
                Fault("variables", f"none of the first {first} is valid"),
                *(Fault("", reason) for reason in reasons[:_TOLD_REASONS]),
            ]
        )


def batches_of(
    study: Study, sweeps: Sequence[Sweep], candidates: Sequence[Candidate]
) -> list[Batch]:
    """The trials of candidates in batches that share a model.

    The trials of a candidate are numbered in the order of the sweeps, after those of the candidates
    with smaller numbers.
    """
    batches: list[Batch] = []
    size, first = sum(sweep.size for sweep in sweeps), 0
    for sweep in sweeps:
        plain = {name: base.model_dump(mode="json") for name, base in sweep.bases.items()}
        places, columns = places_of(plain, sweep.axes), sweep.trials()
        members = []
        for candidate in candidates:
            values = {name: _values(study, candidate, data) for name, data in plain.items()}
            for index in range(sweep.size):
                one = trial_of(places, columns, index)
                number = candidate.number * size + first + index
                members.append(Trial(number, one.base, one.changes | values[one.base]))
        batches += batched(plain, members, sweep.batch, len(batches))
        first += sweep.size
    return batches


def _values(study: Study, candidate: Candidate, data: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a candidate by every single place of a plain scenario that takes them."""
    return {
        place: fitted(value, value_at(data, place))
        for path, value in study.settings(candidate.values).items()
        for place in matches(data, path)
    }
