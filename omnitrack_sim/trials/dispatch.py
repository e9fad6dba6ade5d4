"""Workers of trials: hand out batches, take their rows back, and survive workers that die."""

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

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.workers import LocalPool, WorkersLost, killed_its_worker
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.trials.batches import ERROR, Batch, Rows, failed_row, run_rows

DEATHS = 3
"""Number of times that a batch may lose its worker before its trials are run one by one.

A trial that loses its worker as often on its own counts as the cause.
"""
MakeExecutor = Callable[[], Executor]
Keep = Callable[[Batch, Rows, int], None]
"""Function that keeps the results of a batch; it is told how many workers have been lost so far."""


class Workers:
    """What runs batches: this process, others of this machine, or an executor.

    Used in a ``with`` block, at the end of which those that were made here end.

    Args:
        workers: processes that run batches; with 1 this process does.
        executor: runs the batches instead, or a callable that makes one, and is called again when
            workers die. An executor given as such is left open.

    Raises:
        InputError: no such number of workers, or both workers and executor are given.
    """

    def __init__(self, workers: int = 1, executor: Executor | MakeExecutor | None = None):
        if workers < 1:
            raise InputError(Fault("workers", f"is {workers}; must be 1 or more"))
        if workers > 1 and executor is not None:
            raise InputError(Fault("workers, executor", "give one of the two"))
        self._given = (lambda: LocalPool(workers)) if workers > 1 else executor
        # Made when it is needed first: workers cost seconds, and a finished folder needs none.
        self._made: Executor | None = None

    def __enter__(self) -> Workers:
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

    def run(self, batches: Sequence[Batch], keep: Keep) -> None:
        """Run batches, no two of which are equal, and hand the results of each to ``keep``.

        Raises:
            WorkersLost: the given executor has broken.
        """
        if self._given is None:
            for batch in batches:
                keep(batch, run_rows(batch), 0)
        elif batches:
            _Dispatch(batches, self, keep).run()


@dataclass(eq=False)
class _Task:
    """Something to hand out: a batch, or a single trial of it.

    Attributes:
        batch: to run.
        whole: batch that it is part of.
        place: of the single trial in it.
        deaths: number of workers that it has lost.
    """

    batch: Batch
    whole: Batch
    place: int | None = None
    deaths: int = 0


class _Dispatch:
    """Hands out batches and takes rows back.

    A task whose worker dies is handed out again. After ``DEATHS`` it is a suspect. Suspects run
    last, each alone in the pool and split into single trials, so that no other can be to blame. A
    trial that still loses its worker as often becomes a row ``error``.
    """

    def __init__(self, batches: Sequence[Batch], workers: Workers, keep: Keep):
        self.workers, self.keep = workers, keep
        self.waiting = deque(_Task(batch, batch) for batch in batches)
        self.suspects: deque[_Task] = deque()
        self.flying: dict[Future, _Task] = {}
        # Of batches whose trials come back one by one, by hash and place.
        self.single: dict[str, dict[int, Rows]] = {}
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
                self.workers.renew()

    def _hand_out(self) -> bool:
        """Fill the pool; returns True if it turned out to be broken."""
        # A suspect that flies alone is the only one that can have broken the pool.
        if not self.waiting and not self.flying:
            self.waiting.append(self.suspects.popleft())
        # No more than run at a time, where the executor says how many, so that only batches that
        # ran are suspected when it breaks.
        room = getattr(self.workers.executor, "_max_workers", None)
        while self.waiting and (room is None or len(self.flying) < room):
            task = self.waiting.popleft()
            try:
                self.flying[self.workers.executor.submit(run_rows, task.batch)] = task
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
                results = future.result()
            except (BrokenExecutor, CancelledError):
                broken = True
                # Any of the tasks in flight may be the cause: the broken executor does not say
                # which.
                self._retry_or_give_up(task, 1)
            except Exception as error:
                if not killed_its_worker(error):
                    raise
                # Dask has tried the task on several workers before it gives up.
                self.lost += 1
                self._retry_or_give_up(task, DEATHS)
            else:
                self._add(task, results)
        return broken

    def _retry_or_give_up(self, task: _Task, deaths: int) -> None:
        """Count ``deaths`` of a task's workers, and repeat, split or give up the task."""
        task.deaths += deaths
        is_single = task.place is not None
        if task.deaths < DEATHS:
            (self.suspects if is_single else self.waiting).appendleft(task)
        elif is_single:
            self._add(task, Rows([failed_row(ERROR, "the worker died")], {}, environment()))
        else:
            for place, trial in enumerate(task.batch.trials):
                one = replace(task.batch, trials=(trial,))
                self.suspects.append(_Task(one, task.whole, place))

    def _add(self, task: _Task, results: Rows) -> None:
        if task.place is None:
            self.keep(task.whole, results, self.lost)
            return
        known = self.single.setdefault(task.whole.hash, {})
        known[task.place] = results
        # A batch is kept as a whole, also when its trials have come back one by one.
        if len(known) == len(task.whole.trials):
            self.keep(task.whole, _together(known), self.lost)


def _together(single: Mapping[int, Rows]) -> Rows:
    """Results of trials that were run one by one, in the order of their places."""
    each = [single[place] for place in sorted(single)]
    units = {name: unit for one in each for name, unit in one.units.items()}
    return Rows([row for one in each for row in one.rows], units, each[0].made_by)
