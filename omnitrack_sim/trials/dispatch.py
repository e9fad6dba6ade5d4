"""Hands out batches, keeps what comes back, and survives workers that die."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from omnitrack_sim.base.workers import WorkersLost, killed_its_worker
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.trials.batches import ERROR, Batch, Row, failed_row, run_trials

if TYPE_CHECKING:
    import pyarrow as pa

DEATHS = 3
"""How often a batch may lose its worker before its trials are run one by one.

A trial that loses its worker as often on its own counts as the cause.
"""


@dataclass(frozen=True)
class Status:
    """How far a sweep is.

    Attributes:
        total: number of trials.
        found: trials that were done before this run.
        done: trials that are done now.
        successes: how many of these succeeded.
        lost: how often workers were lost.
    """

    total: int
    found: int = 0
    done: int = 0
    successes: int = 0
    lost: int = 0


Progress = Callable[[Status], None]
MakeExecutor = Callable[[], Executor]


class Store(Protocol):
    """Where the rows of batches are kept."""

    def read(self, batch: Batch) -> pa.Table | None:
        """The rows of a batch; None where they are not there."""
        ...

    def write(self, batch: Batch, table: pa.Table) -> None:
        """Keep the rows of a batch."""
        ...


class TableMaker(Protocol):
    """What makes a table of the rows of a batch."""

    def table(self, batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any]) -> pa.Table:
        """The rows of a batch, with its hash and what made it in the metadata."""
        ...


def run_missing(
    mine: Sequence[Batch],
    store: Store,
    layout: TableMaker,
    pool: Pool,
    progress: Progress | None,
) -> None:
    """Run the batches that the store does not have.

    Args:
        mine: the batches that are to be there in the end.
        store: keeps their rows.
        layout: makes tables of them.
        pool: runs them.
        progress: see ``run_sweep``.
    """
    status = Status(sum(len(batch.trials) for batch in mine))
    missing = []
    for batch in mine:
        table = store.read(batch)
        if table is None:
            missing.append(batch)
        else:
            n = len(batch.trials)
            successes = status.successes + _successes(table)
            status = replace(
                status, found=status.found + n, done=status.done + n, successes=successes
            )

    def keep(batch: Batch, rows: Sequence[Row], made_by: Mapping[str, Any], lost: int) -> None:
        nonlocal status
        table = layout.table(batch, rows, made_by)
        store.write(batch, table)
        done, successes = status.done + len(rows), status.successes + _successes(table)
        status = replace(status, done=done, successes=successes, lost=lost)
        if progress is not None:
            progress(status)

    if progress is not None:
        progress(status)
    if pool.is_here:
        for batch in missing:
            keep(batch, *run_trials(batch), lost=0)
    elif missing:
        _Dispatch(missing, pool, keep).run()


def all_found(table: pa.Table) -> Status:
    """Of a sweep whose trials were all done before."""
    count = table.num_rows
    return Status(count, found=count, done=count, successes=_successes(table))


def _successes(table: pa.Table) -> int:
    return sum(table["success"].to_pylist())


class Pool:
    """An executor that was given, or executors that a callable makes, one after the other, the
    first one when it is needed; or this process, where there is neither."""

    def __init__(self, executor: Executor | MakeExecutor | None):
        self._now = executor if isinstance(executor, Executor) else None
        self._make = None if isinstance(executor, Executor) else executor

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(wait=kind is None)

    @property
    def is_here(self) -> bool:
        """Whether batches run in this process."""
        return self._now is None and self._make is None

    def _executor(self) -> Executor:
        if self._now is None:
            assert self._make is not None
            self._now = self._make()
        return self._now

    def _end(self, wait: bool) -> None:
        if self._make is not None and self._now is not None:
            self._now.shutdown(wait=wait, cancel_futures=not wait)
            self._now = None

    def submit(self, batch: Batch) -> Future:
        return self._executor().submit(run_trials, batch)

    @property
    def room(self) -> int | None:
        """How many batches run at a time; None where the executor does not tell.

        No more are handed out, so that only batches that ran are suspected when the executor
        breaks.
        """
        return getattr(self._executor(), "_max_workers", None)

    def renew(self) -> None:
        """Replace an executor that has lost its workers."""
        if self._make is None:
            raise WorkersLost(
                "the workers of the given executor are gone; the finished batches are kept. Give a "
                "callable that makes an executor, which is then made anew"
            )
        for _ in range(DEATHS):
            self._end(wait=False)
            try:
                self._executor().submit(environment).result()
                return
            except (BrokenExecutor, CancelledError):
                continue
        raise WorkersLost("the workers die before they run anything; the finished batches are kept")


@dataclass(eq=False)
class _Whole:
    """A batch whose trials may come back one by one."""

    batch: Batch
    rows: dict[int, Row] = field(default_factory=dict)
    made_by: Mapping[str, Any] = field(default_factory=dict)


@dataclass(eq=False)
class _Task:
    """Something to hand out: a batch, or a single trial of it."""

    batch: Batch
    whole: _Whole
    deaths: int = 0

    def singles(self) -> list[_Task]:
        """A task for each trial."""
        return [
            _Task(replace(self.batch, trials=(trial,)), self.whole) for trial in self.batch.trials
        ]


class _Dispatch:
    """Hands out batches and takes rows back.

    A task whose worker dies is handed out again. After ``DEATHS`` it is a suspect. Suspects run
    last, each alone in the pool and split into single trials, so that no other can be to blame. A
    trial that still loses its worker as often becomes a row ``error``.
    """

    def __init__(
        self,
        batches: Iterable[Batch],
        pool: Pool,
        keep: Callable[[Batch, Sequence[Row], Mapping[str, Any], int], None],
    ):
        self.pool, self.keep = pool, keep
        self.waiting = deque(_Task(batch, _Whole(batch)) for batch in batches)
        self.suspects: deque[_Task] = deque()
        self.flying: dict[Future, _Task] = {}
        self.lost = 0

    def run(self) -> None:
        """Go on until every batch is kept."""
        while self.waiting or self.flying or self.suspects:
            broken = self._hand_out()
            if self.flying:
                broken |= self._take_back()
            if broken:
                self.lost += 1
                while self.flying:  # a broken executor ends all of its tasks
                    self._take_back()
                self.pool.renew()

    def _hand_out(self) -> bool:
        """Fill the pool; returns whether it turned out to be broken."""
        if not self.waiting and not self.flying:
            self.waiting.append(self.suspects.popleft())
        room = self.pool.room
        while self.waiting and (room is None or len(self.flying) < room):
            task = self.waiting.popleft()
            try:
                self.flying[self.pool.submit(task.batch)] = task
            except (BrokenExecutor, RuntimeError):
                self.waiting.appendleft(task)
                return True
        return False

    def _take_back(self) -> bool:
        """Wait for some task to end; returns whether the pool is broken."""
        finished, _ = wait(self.flying, return_when=FIRST_COMPLETED)
        broken = False
        for future in finished:
            task = self.flying.pop(future)
            try:
                rows, made_by = future.result()
            except (BrokenExecutor, CancelledError):
                broken = True
                self._bury(task, 1)
            except Exception as error:
                if not killed_its_worker(error):
                    raise
                self.lost += 1
                self._bury(task, DEATHS)
            else:
                self._add(task, rows, made_by)
        return broken

    def _bury(self, task: _Task, deaths: int) -> None:
        """Note that a task has lost its worker ``deaths`` times, and decide what becomes of it."""
        task.deaths += deaths
        alone = task.batch is not task.whole.batch
        if task.deaths < DEATHS:
            (self.suspects if alone else self.waiting).appendleft(task)
        elif alone:
            row = failed_row(task.batch.trials[0].index, ERROR, "the worker died")
            self._add(task, [row], {})
        else:
            self.suspects.extend(task.singles())

    def _add(self, task: _Task, rows: Sequence[Row], made_by: Mapping[str, Any]) -> None:
        whole = task.whole
        whole.rows |= {row["trial"]: row for row in rows}
        whole.made_by = made_by or whole.made_by
        if len(whole.rows) == len(whole.batch.trials):
            ordered = [whole.rows[trial.index] for trial in whole.batch.trials]
            self.keep(whole.batch, ordered, whole.made_by, self.lost)
