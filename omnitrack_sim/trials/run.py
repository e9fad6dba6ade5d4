"""One engine for all plans of trials: runs what is missing, and keeps what has been run."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pyarrow as pa

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.results.provenance import warn_of_unlike
from omnitrack_sim.trials.batches import Batch, Rows
from omnitrack_sim.trials.dispatch import MakeExecutor, Workers
from omnitrack_sim.trials.plan import Conclusion, Plan, Round
from omnitrack_sim.trials.store import TRIALS, Folder, Store
from omnitrack_sim.trials.table import joined, made_by, trials_table


@dataclass(frozen=True)
class Status:
    """Progress of a plan's trials.

    Attributes:
        total: number of trials; of a study those of its search and of its check, of which there
            are fewer where one candidate is among the best in several ways.
        found: trials that were done before this run.
        done: trials that are done now.
        successes: how many of these succeeded.
        lost: how often workers were lost.
        stage: of a study, such as "generation 2 of 20"; else empty.
        batch: trials of the largest batch of the round at hand: what an interruption costs each
            worker at most.
    """

    total: int
    found: int = 0
    done: int = 0
    successes: int = 0
    lost: int = 0
    stage: str = ""
    batch: int = 0


Progress = Callable[[Status], None]
Shard = tuple[int, int]


@dataclass(frozen=True, eq=False)
class TrialsResult:
    """Result of a plan of trials.

    Attributes:
        plan: that was run.
        tables: by name. ``trials`` has a row a trial: of all, or of what was run here if other
            shares are missing. A study adds ``history``, ``front`` and, with a check, ``final``; a
            bench ``results``; a passport ``passport``.
        summary: as in ``summary.json``; empty if shares are missing.
        status: how many trials there are, were found done, and are done now.
        folder: of the files; None if nothing was written.

    Example:
        >>> sweep = ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01})
        >>> result = ot.run_trials(sweep)
        >>> result.table.num_rows, result.status.done, result.summary["outcomes"], result.folder
        (120, 120, {'timed_out': 120}, None)
    """

    plan: Plan
    tables: Mapping[str, pa.Table]
    summary: dict[str, Any]
    status: Status
    folder: Path | None = None

    @property
    def table(self) -> pa.Table:
        """The trials, a row each, in order."""
        return self.tables[TRIALS]


def run_trials(
    plan: Plan,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    executor: Executor | MakeExecutor | None = None,
    progress: Progress | None = None,
    shard: Shard | None = None,
) -> TrialsResult:
    """Run the trials of a plan that are not done yet: a sweep, a study, a bench, a passport.

    The tables depend on the plan alone: not on the number of workers, and not on interruptions.

    Args:
        plan: what to run.
        out: folder of the files; trials of earlier runs are found there. Without one nothing is
            written.
        workers: processes that run trials; with 1 this one does.
        executor: runs them instead, or a callable that makes one, and is called again when workers
            die. An executor given as such is left open.
        progress: called with the ``Status`` at the beginning of each round of trials and after
            each batch.
        shard: (i, n), i from 1: run only every n-th batch. The shard that finishes last writes the
            files of the whole; a study ends at the first round with trials of other shards that
            are not there yet.

    Raises:
        SweepError, StudyError: no trial is valid; no value of an objective.
        InputError: no such shard or number of workers; the plan cannot be run.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.

    Example:
        >>> sweep = ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01})
        >>> reports = []
        >>> result = ot.run_trials(sweep, shard=(1, 4), progress=reports.append)
        >>> [status.done for status in reports], result.table.num_rows
        ([0, 32], 32)
    """
    check_is(Plan, "plan", plan)
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        problem = f"is {shard[0]}/{shard[1]}; it must be from 1/{shard[1]} to {shard[1]}/{shard[1]}"
        raise InputError(Fault("shard", problem))
    rounds = plan.rounds()
    asked = next(rounds)  # before anything is written: a plan that cannot be run says so here
    with Workers(workers, executor) as pool:
        store = Store() if out is None else Folder(out, plan)
        run = _Run(store, pool, progress, shard)
        while True:
            is_whole, table = run.table_of(asked)
            if not is_whole:
                return TrialsResult(plan, {TRIALS: table}, {}, run.status, store.path)
            try:
                asked = rounds.send(table)
            except StopIteration as end:
                return run.finish(plan, end.value)


class _Run:
    """The rounds of one plan so far, and the progress of its trials."""

    def __init__(self, store: Store, pool: Workers, progress: Progress | None, shard: Shard | None):
        self._store, self._pool, self._shard = store, pool, shard
        self._report = progress
        self._tables: list[pa.Table] = []
        self._makers: set[str] = set()  # versions and commits of the batches, as JSON
        self._is_new = False  # some trial of the round before has been run here
        self.status = Status(0)

    def table_of(self, asked: Round) -> tuple[bool, pa.Table]:
        """Run a round's missing trials; returns whether all are done, and the table of those."""
        if self._is_new:
            # A plan that is resumed passes rounds that are on the disk already.
            self._store.put_tables(asked.tables)
        mine = asked.batches
        if self._shard is not None:
            # Every n-th batch, not a stretch: neighbouring trials take like times, so shares last
            # as long.
            mine = mine[self._shard[0] - 1 :: self._shard[1]]
        many = self.status.done + sum(len(batch.trials) for batch in mine)
        total = asked.total
        if total is None or self._shard is not None:
            total = max(self.status.total, many)
        largest = max((len(batch.trials) for batch in mine), default=0)
        self.status = replace(self.status, total=total, stage=asked.stage, batch=largest)
        parts = self._run(mine)
        # With shards, others may have run the rest by now, or are still at it.
        for batch in asked.batches:
            if batch.hash not in parts and (part := self._store.read(batch)) is not None:
                parts[batch.hash] = part
        is_whole = all(batch.hash in parts for batch in asked.batches)
        done = asked.batches if is_whole else mine
        self._makers |= {made_by(part) for part in parts.values()}
        first = sum(len(table) for table in self._tables)
        own = [parts[batch.hash] for batch in done]
        table = trials_table(done, own, asked.columns, asked.units, first)
        self._tables.append(table)
        return is_whole, table

    def _run(self, batches: Sequence[Batch]) -> dict[str, pa.Table]:
        """Run those of some batches that are missing; returns the tables of all by hash."""
        # Equal batches are run once: two candidates of a search, say, may have the same values.
        times = Counter(batch.hash for batch in batches)
        unique = {batch.hash: batch for batch in batches}
        there = {name: self._store.read(batch) for name, batch in unique.items()}
        parts = {name: part for name, part in there.items() if part is not None}
        for name, part in parts.items():
            self._count(part, times[name], is_old=True)
        self._tell()
        before = self.status.lost

        def keep(batch: Batch, results: Rows, lost: int) -> None:
            parts[batch.hash] = part = self._store.write(batch, results)
            self.status = replace(self.status, lost=before + lost)
            self._count(part, times[batch.hash], is_old=False)
            self._tell()

        missing = [batch for name, batch in unique.items() if name not in parts]
        self._is_new = bool(missing)
        self._pool.run(missing, keep)
        return parts

    def _tell(self) -> None:
        if self._report is not None:
            self._report(self.status)

    def _count(self, part: pa.Table, times: int, is_old: bool) -> None:
        status, count = self.status, times * part.num_rows
        self.status = replace(
            status,
            found=status.found + (count if is_old else 0),
            done=status.done + count,
            successes=status.successes + times * sum(part["success"].to_pylist()),
        )

    def finish(self, plan: Plan, end: Conclusion) -> TrialsResult:
        """Keep what the plan has come to, and return it."""
        metadata = {"sha256": plan.hash}
        trials = joined(self._tables).replace_schema_metadata(metadata)
        tables = {TRIALS: trials, **end.tables}
        makers = [json.loads(text) for text in sorted(self._makers)]
        warn_of_unlike(makers, "trials")
        summary = {"name": plan.name, "sha256": plan.hash, **end.summary, "made_by": makers}
        self._store.finish(replace(end, summary=summary), tables)
        return TrialsResult(plan, tables, summary, self.status, self._store.path)
