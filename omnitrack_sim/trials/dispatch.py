"""Engine of trials: hands out batches, stores their rows, and survives workers that die."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass, replace
from typing import Any

import pyarrow as pa

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.workers import LocalPool, WorkersLost, killed_its_worker
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.trials.batches import ERROR, Batch, Row, failed_row, run_trials
from omnitrack_sim.trials.store import Store

DEATHS = 3
"""Number of times that a batch may lose its worker before its trials are run one by one.

A trial that loses its worker as often on its own counts as the cause.
"""


@dataclass(frozen=True)
class Status:
    """Progress of the trials of a sweep, a study or a benchmark.

    Attributes:
        total: number of trials; of a study those of its search and of its check, of which there
            are fewer where one candidate is among the best in several ways.
        found: trials that were done before this run.
        done: trials that are done now.
        successes: how many of these succeeded.
        lost: how often workers were lost.
        stage: of a study, such as "generation 2 of 20"; else empty.
    """

    total: int
    found: int = 0
    done: int = 0
    successes: int = 0
    lost: int = 0
    stage: str = ""


Progress = Callable[[Status], None]
MakeExecutor = Callable[[], Executor]


Job = tuple[Store, Batch]
"""A batch that is to be there in the end, and the store of its rows."""


class Engine:
    """Runs batches that stores lack, by the same workers for all, and reports the progress.

    Used in a ``with`` block, at the end of which its workers end.

    Attributes:
        status: of the trials since ``begin``.

    Args:
        workers: processes that run batches; with 1 this process does.
        executor: runs the batches instead, or a callable that makes one, and is called again when
            workers die. An executor given as such is left open.
        progress: called with the ``Status`` at the beginning and after each batch.

    Raises:
        InputError: no such number of workers, or both workers and executor are given.
    """

    def __init__(
        self,
        workers: int = 1,
        executor: Executor | MakeExecutor | None = None,
        progress: Progress | None = None,
    ):
        if workers < 1:
            raise InputError(Fault("workers", f"is {workers}; must be 1 or more"))
        if workers > 1 and executor is not None:
            raise InputError(Fault("workers, executor", "give one of the two"))
        self._given = (lambda: LocalPool(workers)) if workers > 1 else executor
        # Made when it is needed first: workers cost seconds, and a finished folder needs none.
        self._made: Executor | None = None
        self._progress = progress or (lambda status: None)
        self.status = Status(0)

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._close(wait=kind is None)

    def _close(self, wait: bool) -> None:
        """End the executor that was made here; without ``wait`` its tasks are given up."""
        # An executor that was handed over belongs to the caller, who may still need it.
        if self._made is not None:
            self._made.shutdown(wait=wait, cancel_futures=not wait)
            self._made = None

    @property
    def executor(self) -> Executor:
        """Executor of batches: the given one, or one that a callable makes."""
        if isinstance(self._given, Executor):
            return self._given
        if self._made is None:
            assert self._given is not None
            self._made = self._given()
        return self._made

    def renew(self) -> None:
        """Replace an executor that has lost its workers.

        Raises:
            WorkersLost: the executor was given, or new workers die at once.
        """
        if isinstance(self._given, Executor):
            raise WorkersLost(
                "the workers of the given executor are gone; the finished batches are kept. Give a "
                "callable that makes an executor, which is then made anew"
            )
        # Workers that cannot even say their versions are not the fault of any trial.
        for _ in range(DEATHS):
            self._close(wait=False)
            try:
                self.executor.submit(environment).result()
                return
            except (BrokenExecutor, CancelledError):
                continue
        raise WorkersLost("the workers die before they run anything; the finished batches are kept")

    def begin(self, total: int, stage: str = "") -> None:
        """Reset the status to 0 of ``total`` trials."""
        self.status = Status(total, stage=stage)

    def enter(self, stage: str, total: int | None = None) -> None:
        """Enter another stage of the same trials; ``total`` corrects their number."""
        self.status = replace(self.status, stage=stage, total=total or self.status.total)

    def run(self, jobs: Sequence[Job]) -> list[pa.Table]:
        """Run the batches that their stores lack, and return the tables of all, in order.

        Raises:
            OutputError: a store cannot keep a batch; those that are finished stay.
            WorkersLost: the given executor has broken; the same call goes on from there.
        """
        # By identity: batches of two sweeps may be equal, and each has its own store.
        tables = {id(batch): store.read(batch) for store, batch in jobs}
        missing = [(store, batch) for store, batch in jobs if tables[id(batch)] is None]
        for table in tables.values():
            self._count(table, is_old=True)
        self._progress(self.status)

        def keep(job: Job, rows: Sequence[Row], made_by: Mapping[str, Any], lost: int) -> None:
            store, batch = job
            tables[id(batch)] = table = store.write(batch, rows, made_by)
            self.status = replace(self.status, lost=before + lost)
            self._count(table, is_old=False)
            self._progress(self.status)

        before = self.status.lost
        if self._given is None:
            for job in missing:
                keep(job, *run_trials(job[1]), lost=0)
        elif missing:
            _Dispatch(missing, self, keep).run()
        return [table for table in tables.values() if table is not None]

    def _count(self, table: pa.Table | None, is_old: bool) -> None:
        if table is not None:
            status, count = self.status, table.num_rows
            self.status = replace(
                status,
                found=status.found + (count if is_old else 0),
                done=status.done + count,
                successes=status.successes + sum(table["success"].to_pylist()),
            )


@dataclass(eq=False)
class _Task:
    """Something to hand out: a batch, or a single trial of it.

    Attributes:
        batch: to run.
        job: that it is part of.
        deaths: number of workers that it has lost.
    """

    batch: Batch
    job: Job
    deaths: int = 0


class _Dispatch:
    """Hands out batches and takes rows back.

    A task whose worker dies is handed out again. After ``DEATHS`` it is a suspect. Suspects run
    last, each alone in the pool and split into single trials, so that no other can be to blame. A
    trial that still loses its worker as often becomes a row ``error``.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        engine: Engine,
        keep: Callable[[Job, Sequence[Row], Mapping[str, Any], int], None],
    ):
        self.engine, self.keep = engine, keep
        self.waiting = deque(_Task(job[1], job) for job in jobs)
        self.suspects: deque[_Task] = deque()
        self.flying: dict[Future, _Task] = {}
        # By identity: batches of two sweeps may be equal.
        self.rows: dict[int, dict[int, Row]] = {id(batch): {} for _, batch in jobs}
        self.lost = 0

    def run(self) -> None:
        """Run until every batch is kept."""
        while self.waiting or self.flying or self.suspects:
            broken = self._hand_out()
            if self.flying:
                broken |= self._take_back()
            if broken:
                self.lost += 1
                while self.flying:  # a broken executor ends all of its tasks
                    self._take_back()
                self.engine.renew()

    def _hand_out(self) -> bool:
        """Fill the pool; returns True if it turned out to be broken."""
        # A suspect that flies alone is the only one that can have broken the pool.
        if not self.waiting and not self.flying:
            self.waiting.append(self.suspects.popleft())
        # No more than run at a time, where the executor says how many, so that only batches that
        # ran are suspected when it breaks.
        room = getattr(self.engine.executor, "_max_workers", None)
        while self.waiting and (room is None or len(self.flying) < room):
            task = self.waiting.popleft()
            try:
                self.flying[self.engine.executor.submit(run_trials, task.batch)] = task
            except (BrokenExecutor, RuntimeError):  # the latter by executors that are shut down
                self.waiting.appendleft(task)
                return True
        return False

    def _take_back(self) -> bool:
        """Wait for some task to end; returns True if the pool is broken."""
        finished, _ = wait(self.flying, return_when=FIRST_COMPLETED)
        broken = False
        for future in finished:
            task = self.flying.pop(future)
            try:
                rows, made_by = future.result()
            except (BrokenExecutor, CancelledError):
                broken = True
                # Any of the tasks in flight may be the cause: the broken executor does not say
                # which.
                self._bury(task, 1)
            except Exception as error:
                if not killed_its_worker(error):
                    raise
                # Dask has tried the task on several workers before it gives up.
                self.lost += 1
                self._bury(task, DEATHS)
            else:
                self._add(task, rows, made_by)
        return broken

    def _bury(self, task: _Task, deaths: int) -> None:
        """Count ``deaths`` of a task's workers, and repeat, split or give up the task."""
        task.deaths += deaths
        alone = task.batch is not task.job[1]
        if task.deaths < DEATHS:
            (self.suspects if alone else self.waiting).appendleft(task)
        elif alone:
            row = failed_row(task.batch.trials[0].index, ERROR, "the worker died")
            self._add(task, [row], environment())
        else:
            trials = task.batch.trials
            self.suspects += [_Task(replace(task.batch, trials=(t,)), task.job) for t in trials]

    def _add(self, task: _Task, rows: Sequence[Row], made_by: Mapping[str, Any]) -> None:
        trials = task.job[1].trials
        known = self.rows[id(task.job[1])]
        known |= {row["trial"]: row for row in rows}
        # A batch is stored as a whole, also when its trials have come back one by one.
        if len(known) == len(trials):
            ordered = [known[trial.index] for trial in trials]
            self.keep(task.job, ordered, made_by, self.lost)
