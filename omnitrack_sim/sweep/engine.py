"""Runs a sweep: hands out batches, keeps what comes back, and survives workers that die."""

from __future__ import annotations

import json
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
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.errors import Fault, InputError, SweepError
from omnitrack_sim.sim.provenance import environment
from omnitrack_sim.sweep.batch import ERROR, INVALID, Row, failed_row, run_trials
from omnitrack_sim.sweep.folder import Folder, Memory
from omnitrack_sim.sweep.picture import draw_map
from omnitrack_sim.sweep.spec import Sweep
from omnitrack_sim.sweep.summary import summarise_sweep
from omnitrack_sim.sweep.table import Layout, made_by
from omnitrack_sim.sweep.trials import Batch
from omnitrack_sim.sweep.workers import WorkersLost, killed_its_worker

if TYPE_CHECKING:
    import pyarrow as pa

DEATHS = 3
"""How often a batch may lose its worker before its trials are run one by one.

A trial that loses its worker as often on its own counts as the cause.
"""
_TOLD_REASONS = 3


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


def run_sweep(
    sweep: Sweep,
    directory: str | Path | None = None,
    *,
    executor: Executor | MakeExecutor | None = None,
    shard: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> pa.Table:
    """Run the trials that are not done yet.

    Args:
        sweep: what to run.
        directory: where part files and table are written, and part files of earlier runs are found;
            without one nothing is written.
        executor: runs the batches; without one this process does. A callable makes one, and is
            asked again when workers die. An executor given as such is left open.
        shard: (i, n), i from 1: run only every n-th batch. The shard that finishes last writes the
            files of the whole.
        progress: called with the ``Status`` after each batch.

    Returns:
        One row for each trial, in order: the whole sweep if all batches are done, else the trials
            of this shard.

    Raises:
        SweepError: all trials are invalid.
        InputError: no such shard.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.
    """
    layout, batches = Layout(sweep), sweep.batches()
    mine = batches if shard is None else batches[_checked(shard)[0] - 1 :: shard[1]]
    store: Folder | Memory = Memory() if directory is None else Folder(directory, sweep, layout)
    if isinstance(store, Folder):
        table = _finished(sweep, store)
        if table is not None:
            return table
    _run_missing(mine, store, layout, executor, progress)
    return _finish(sweep, batches, mine, store, layout)


def _finished(sweep: Sweep, folder: Folder) -> pa.Table | None:
    """The table of a sweep that is finished, with a summary that tells it as it is now; None where
    it has to be made from the batches."""
    table, there = folder.finished(), folder.summary()
    try:
        makers = {json.dumps(maker, sort_keys=True) for maker in there["provenance"]["made_by"]}
    except (KeyError, TypeError):
        return None
    if table is not None:
        summary = summarise_sweep(sweep, table, makers)
        if folder.renamed or json.loads(json.dumps(summary)) != there:
            folder.finish(table, summary, lambda: draw_map(sweep, table))
    return table


def _checked(shard: tuple[int, int]) -> tuple[int, int]:
    if not 1 <= shard[0] <= shard[1]:
        raise InputError(
            Fault(
                "shard",
                f"is {shard[0]}/{shard[1]}; it must be from 1/{shard[1]} to {shard[1]}/{shard[1]}",
            )
        )
    return shard


def _run_missing(
    mine: Sequence[Batch],
    store: Folder | Memory,
    layout: Layout,
    executor: Executor | MakeExecutor | None,
    progress: Progress | None,
) -> None:
    """Run the batches that the store does not have."""
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
    if executor is None:
        for batch in missing:
            keep(batch, *run_trials(batch), lost=0)
    elif missing:
        with _Pool(executor) as pool:
            _Dispatch(missing, pool, keep).run()


def _finish(
    sweep: Sweep,
    batches: Sequence[Batch],
    mine: Sequence[Batch],
    store: Folder | Memory,
    layout: Layout,
) -> pa.Table:
    """Merge the batches; if all are done, write the files of the whole sweep."""
    tables = [store.read(batch) for batch in batches]
    present = [table for table in tables if table is not None]
    if len(present) < len(batches):
        numbers = {batch.number for batch in mine}
        own = [
            table
            for batch, table in zip(batches, tables, strict=True)
            if table is not None and batch.number in numbers
        ]
        return layout.merged(own)
    table = layout.merged(present)
    _refuse_all_invalid(table)
    if isinstance(store, Folder):
        summary = summarise_sweep(sweep, table, {made_by(found) for found in present})
        store.finish(table, summary, lambda: draw_map(sweep, table))
    return table


def _refuse_all_invalid(table: pa.Table) -> None:
    if set(table["outcome"].to_pylist()) == {INVALID}:
        reasons = list(dict.fromkeys(table["reason"].to_pylist()))
        raise SweepError(
            [
                Fault("axes", f"all {table.num_rows} trials are invalid"),
                *(Fault("", r) for r in reasons[:_TOLD_REASONS]),
            ]
        )


def _successes(table: pa.Table) -> int:
    return sum(table["success"].to_pylist())


class _Pool:
    """An executor that was given, or executors that a callable makes, one after the other."""

    def __init__(self, executor: Executor | MakeExecutor):
        self._given = executor if isinstance(executor, Executor) else None
        self._make = None if isinstance(executor, Executor) else executor
        self._now: Executor | None = None

    def __enter__(self) -> _Pool:
        self._now = self._given or (self._make() if self._make else None)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._end(wait=kind is None)

    def _end(self, wait: bool) -> None:
        if self._make is not None and self._now is not None:
            self._now.shutdown(wait=wait, cancel_futures=not wait)

    def submit(self, batch: Batch) -> Future:
        assert self._now is not None
        return self._now.submit(run_trials, batch)

    @property
    def room(self) -> int | None:
        """How many batches run at a time; None where the executor does not tell.

        No more are handed out, so that only batches that ran are suspected when the executor
        breaks.
        """
        return getattr(self._now, "_max_workers", None)

    def renew(self) -> None:
        """Replace an executor that has lost its workers."""
        if self._make is None:
            raise WorkersLost(
                "the workers of the given executor are gone; the finished batches are kept. Give a "
                "callable that makes an executor, which is then made anew"
            )
        for _ in range(DEATHS):
            self._end(wait=False)
            self._now = self._make()
            try:
                self._now.submit(environment).result()
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
        pool: _Pool,
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
