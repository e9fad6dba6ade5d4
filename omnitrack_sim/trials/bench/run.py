"""Runs the benchmark: a sweep for each task and entry, and the tables of the whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import counted
from omnitrack_sim.base.workers import WorkersLost
from omnitrack_sim.base.writing import check_folder, told, write_file
from omnitrack_sim.trials.bench.entries import Entry
from omnitrack_sim.trials.bench.figures import Trials, rows_of
from omnitrack_sim.trials.bench.tables import BENCH_FILE, FILES, write_tables
from omnitrack_sim.trials.bench.tasks import Task
from omnitrack_sim.trials.sweep import Status, Sweep, run_sweep
from omnitrack_sim.trials.sweep.dispatch import MakeExecutor, Progress
from omnitrack_sim.trials.sweep.folder import TABLE_FILE

if TYPE_CHECKING:
    import pyarrow as pa

TRIALS = "trials"
"""Folder with the sweeps of all tasks and entries."""


@dataclass(frozen=True)
class Bench:
    """What is to be run.

    Attributes:
        tasks, entries: each entry is put through each task.
        quick: only a few trials of each, to see that everything runs.
        trials: of each task, other ones than without it; none: as many as each task has.

    Raises:
        InputError: there is no task or no entry, two entries have one name, or the number of trials
            is said twice.
    """

    tasks: Sequence[Task]
    entries: Sequence[Entry]
    quick: bool = False
    trials: int | None = None

    def __post_init__(self) -> None:
        names = [entry.name for entry in self.entries]
        for name in names:
            if names.count(name) > 1:
                problem = f"{name!r} is the name of two; write NAME= before one of them"
                raise InputError(Fault("entries", problem))
        if not self.tasks or not self.entries:
            raise InputError(Fault("tasks, entries", "one of each at least"))
        if self.quick and self.trials is not None:
            raise InputError(Fault("--trials", "is the number of trials; leave out --quick"))

    @property
    def extent(self) -> str:
        """How many trials there are, in words."""
        if self.quick:
            return "a few trials of each"
        return "all trials" if self.trials is None else f"{counted(self.trials, 'trial')} of each"

    def sweeps(self) -> dict[tuple[str, str], Sweep]:
        """The sweep of each task and entry.

        Raises:
            InputError: an entry cannot drive a task.
        """
        found = {}
        for task in self.tasks:
            for entry in self.entries:
                count = task.quick if self.quick else self.trials or task.trials
                found[task.name, entry.name] = task.sweep(count, entry.changes)
        return found


def run_bench(
    bench: Bench,
    directory: str | Path,
    *,
    executor: MakeExecutor | None = None,
    progress: Progress | None = None,
) -> list[dict]:
    """Run the trials that are not done yet, and write the tables of the whole.

    Args:
        bench: what to run.
        directory: where everything goes; trials that are there already are not run again, whatever
            entries and tasks were asked for then.
        executor: makes the workers; without it this process runs the trials.
        progress: called with the ``Status`` of all trials together.

    Returns:
        One row for each task and entry, see ``figures.rows_of``.

    Raises:
        InputError: an entry cannot drive a task.
        OutputError: the folder holds something else, or cannot be written; finished trials stay.
    """
    folder = Path(directory)
    check_folder(folder, mark=BENCH_FILE, files=FILES)
    sweeps = bench.sweeps()
    with told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    if not (folder / BENCH_FILE).is_file():
        write_file(folder / BENCH_FILE, b"{}\n")
    places = {key: folder / TRIALS / key[0] / key[1] for key in sweeps}
    # Those that are finished come first, so that the first status tells all that was there.
    order = sorted(sweeps, key=lambda key: not (places[key] / TABLE_FILE).is_file())
    tally = _Tally(sum(sweep.size for sweep in sweeps.values()), progress)
    found = {}
    with _workers(executor) as run:
        for key in order:
            finished = (places[key] / TABLE_FILE).is_file()
            found[key] = run(sweeps[key], places[key], tally.note if finished else tally.tell)
            tally.next()
    tables = {key: found[key] for key in sweeps}
    rows = rows_of({key: Trials.of(table) for key, table in tables.items()})
    write_tables(bench, folder, rows, tables)
    return rows


class _Tally:
    """The status of all sweeps together, told while one after the other runs."""

    def __init__(self, total: int, progress: Progress | None) -> None:
        self._before = self._now = Status(total)
        self._progress = progress

    def note(self, status: Status) -> None:
        """The status of the sweep at hand, not told."""
        before = self._before
        self._now = Status(
            before.total,
            before.found + status.found,
            before.done + status.done,
            before.successes + status.successes,
            before.lost + status.lost,
        )

    def tell(self, status: Status) -> None:
        """The status of the sweep at hand, told as that of all."""
        self.note(status)
        if self._progress is not None:
            self._progress(self._now)

    def next(self) -> None:
        """The sweep at hand is over."""
        self._before = self._now
        if self._progress is not None and self._now.done == self._now.total:
            self._progress(self._now)


_Run = Callable[[Sweep, Path, Progress], "pa.Table"]


@contextmanager
def _workers(make: MakeExecutor | None) -> Iterator[_Run]:
    """What runs a sweep: by the same workers for all sweeps, and where they are lost by others."""
    pool: Executor | None = None

    def run(sweep: Sweep, place: Path, progress: Progress) -> pa.Table:
        nonlocal pool
        if make is None:
            return run_sweep(sweep, place, progress=progress)
        pool = pool or make()
        try:
            return run_sweep(sweep, place, executor=pool, progress=progress)
        except WorkersLost:
            pool.shutdown(wait=False)
            pool = None
            return run_sweep(sweep, place, executor=make, progress=progress)

    try:
        yield run
    except BaseException:
        if pool is not None:
            pool.shutdown(wait=False)
        raise
    if pool is not None:
        pool.shutdown()
