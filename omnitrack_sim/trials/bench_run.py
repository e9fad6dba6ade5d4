"""Runs the benchmark: a sweep for each task and entry, and the tables of the whole."""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import counted, strict_json
from omnitrack_sim.base.workers import WorkersLost
from omnitrack_sim.base.writing import check_folder, told, write_file, write_files
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval, wilson_interval
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.show.plots.bench import Bar, bench_figure
from omnitrack_sim.show.plots.style import attempt, save_figure
from omnitrack_sim.trials.batches import ERROR, INVALID
from omnitrack_sim.trials.bench import DEFAULT, Entry, Task
from omnitrack_sim.trials.dispatch import MakeExecutor, Progress, Status
from omnitrack_sim.trials.store import TABLE_FILE, to_csv, to_parquet
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_run import run_sweep

if TYPE_CHECKING:
    import pyarrow as pa
if TYPE_CHECKING:
    import pyarrow as pa
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


@dataclass(frozen=True)
class Measure:
    """A figure of a run that passed.

    Attributes:
        name: of its columns. unit: of its values. words: what it is, short.
        columns: of the tables of sweeps, of which it is the mean: one, or one a module.
    """

    name: str
    unit: str
    words: str
    columns: tuple[str, ...]


def _of_modules(name: str, unit: str, words: str) -> Measure:
    return Measure(name, unit, words, tuple(f"{name}_{i + 1}" for i in range(MODULES)))


MEASURES = (
    Measure("duration_s", "s", "time", ("duration_s",)),
    _of_modules("slip_ratio_mean", "1", "slip"),
    Measure("energy_j", "J", "energy", ("energy_j",)),
    _of_modules("torque_change_nm_s", "N m/s", "torque change"),
    Measure("tilt_max_deg", "deg", "largest tilt", ("tilt_max_deg",)),
)
"""What is measured of the trials that an entry passed."""


@dataclass(frozen=True, eq=False)
class Trials:
    """The trials of one entry at one task.

    Attributes:
        ran: (T,) bool, they ran to an outcome. passed: (T,) bool, the robot arrived.
        outcomes: T. figures: (T,) of each measure by name; not a number where there is none.
    """

    ran: NDArray[np.bool_]
    passed: NDArray[np.bool_]
    outcomes: Sequence[str]
    figures: Mapping[str, Array]

    @classmethod
    def of(cls, table: pa.Table) -> Trials:
        """The trials of a sweep's table."""
        outcomes = table["outcome"].to_pylist()
        figures = {m.name: _mean([_numbers(table, c) for c in m.columns]) for m in MEASURES}
        return cls(
            np.array([one not in (INVALID, ERROR) for one in outcomes]),
            np.array([one == Outcome.REACHED_GOAL for one in outcomes]),
            outcomes,
            figures,
        )


def _numbers(table: pa.Table, column: str) -> Array:
    return np.array([math.nan if v is None else v for v in table[column].to_pylist()], float)


def _mean(columns: Sequence[Array]) -> Array:
    return np.mean(columns, axis=0)


def rows_of(found: Mapping[tuple[str, str], Trials]) -> list[dict[str, Any]]:
    """One row for each task and entry: rates, means, and what is different from the default.

    Differences are paired: of the success over all trials that both ran, of the other figures over
    those that both passed.

    Args:
        found: trials by (task, entry).
    """
    rows = []
    for (task, entry), trials in found.items():
        row: dict[str, Any] = {"task": task, "entry": entry, **_rates(trials)}
        for measure in MEASURES:
            own = trials.figures[measure.name][trials.passed]
            row |= _spread(measure.name, own)
        default = found.get((task, DEFAULT))
        if default is not None and entry != DEFAULT:
            row |= _differences(trials, default)
        rows.append(row)
    return rows


def _rates(trials: Trials) -> dict[str, Any]:
    counted, passed = int(trials.ran.sum()), int((trials.passed & trials.ran).sum())
    low, high = wilson_interval(passed, counted)
    others = Counter(one for one in trials.outcomes if one != Outcome.REACHED_GOAL)
    return {
        "trials": counted,
        "passed": passed,
        "success": passed / counted if counted else None,
        "success_low": low,
        "success_high": high,
        "others": ", ".join(f"{count} {name}" for name, count in sorted(others.items())),
    }


def _spread(name: str, values: Array) -> dict[str, Any]:
    """The mean of values with its interval, None where there is none."""
    low, high = mean_interval(values.tolist())
    ends = (float(np.mean(values)) if len(values) else math.nan, low, high)
    keys = (name, f"{name}_low", f"{name}_high")
    return {k: v if math.isfinite(v) else None for k, v in zip(keys, ends, strict=True)}


def _differences(trials: Trials, default: Trials) -> dict[str, Any]:
    both = trials.ran & default.ran
    gained = int((both & trials.passed & ~default.passed).sum())
    lost = int((both & ~trials.passed & default.passed).sum())
    total = int(both.sum())
    low, high = paired_rate_interval(gained, lost, total)
    row: dict[str, Any] = {
        "success_more": (gained - lost) / total if total else None,
        "success_more_low": low,
        "success_more_high": high,
    }
    passed = both & trials.passed & default.passed
    for measure in MEASURES:
        more = trials.figures[measure.name][passed] - default.figures[measure.name][passed]
        row |= _spread(f"{measure.name}_more", more)
    return row


BENCH_FILE = "bench.json"
RESULTS, TRIALS_TABLE, PAGE, FIGURE = "results", "trials.parquet", "results.md", "bench.png"
FILES = (BENCH_FILE, f"{RESULTS}.parquet", f"{RESULTS}.csv", TRIALS_TABLE, PAGE, FIGURE)


def write_tables(
    bench: Bench,
    folder: Path,
    rows: Sequence[Mapping[str, Any]],
    tables: Mapping[tuple[str, str], pa.Table],
) -> None:
    """Write everything but the trials' own folders, none before all are made.

    Args:
        bench: what ran. folder: where to.
        rows: of each task and entry. tables: of their trials.
    """
    table = _table(rows)
    told = {
        "quick": bench.quick,
        "trials": bench.trials,
        "tasks": {task.name: task.words for task in bench.tasks},
        "entries": {e.name: {"words": e.words, "changes": dict(e.changes)} for e in bench.entries},
        "rows": rows,
        **environment(),
    }
    files = {
        f"{RESULTS}.parquet": to_parquet(table),
        f"{RESULTS}.csv": to_csv(table),
        TRIALS_TABLE: to_parquet(_all_trials(tables)),
        PAGE: page(bench, rows).encode(),
        BENCH_FILE: (strict_json(told) + "\n").encode(),
    }
    figure = attempt(FIGURE, lambda: _figure(rows))
    files |= {} if figure is None else {FIGURE: figure}
    write_files({folder / name: data for name, data in files.items()})


def _table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """The rows as a table with all columns, and the units of those that have one."""
    import pyarrow as pa

    names = list(dict.fromkeys(name for row in rows for name in row))
    kinds = {"trials": pa.int64(), "passed": pa.int64()}
    kinds |= dict.fromkeys(("task", "entry", "others"), pa.string())
    fields = [
        pa.field(name, kinds.get(name, pa.float64()), metadata={"unit": _unit(name)})
        for name in names
    ]
    return pa.Table.from_pylist([dict(row) for row in rows], pa.schema(fields))


def _unit(column: str) -> str:
    return next((m.unit for m in MEASURES if column.startswith(m.name)), "1")


def _all_trials(tables: Mapping[tuple[str, str], pa.Table]) -> pa.Table:
    """All trials of all entries in one table; what a task does not vary is null."""
    import pyarrow as pa

    parts = []
    for (task, entry), table in tables.items():
        plain = table.replace_schema_metadata(None)
        for name, value in (("entry", entry), ("task", task)):
            plain = plain.add_column(0, name, pa.array([value] * len(plain), pa.string()))
        parts.append(plain)
    return pa.concat_tables(parts, promote_options="default")


def page(bench: Bench, rows: Sequence[Mapping[str, Any]]) -> str:
    """The rows as Markdown: for each task what the entries did, and the paired differences."""
    units = [m.words if m.unit == "1" else f"{m.words}, {m.unit}" for m in MEASURES]
    lines = [f"# Controllers compared, {bench.extent}", ""]
    for task in bench.tasks:
        own = [row for row in rows if row["task"] == task.name]
        lines += [f"## {task.name}: {task.words}", ""]
        lines += _table_of(["entry", "passed", "95 %", *units, "others"], map(_cells, own))
        others = [row for row in own if "success_more" in row]
        if others:
            told = map(_difference_cells, others)
            lines += _table_of([f"entry less `{DEFAULT}`", "passed, %", *units], told)
    return "\n".join(lines)


def _table_of(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table of Markdown, and the empty line below it."""
    told = [f"| {' | '.join(cells)} |" for cells in rows]
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *told, ""]


def _cells(row: Mapping[str, Any]) -> list[str]:
    interval = f"{100 * row['success_low']:.1f} to {100 * row['success_high']:.1f} %"
    figures = [row[measure.name] for measure in MEASURES]
    told = ["-" if value is None else f"{value:.3g}" for value in figures]
    passed = f"{row['passed']} of {row['trials']}"
    return [f"`{row['entry']}`", passed, interval, *told, row["others"] or "-"]


def _difference_cells(row: Mapping[str, Any]) -> list[str]:
    """Paired differences, each with its interval."""
    figures = [_more(row, f"{measure.name}_more") for measure in MEASURES]
    return [f"`{row['entry']}`", _more(row, "success_more", 100), *figures]


def _more(row: Mapping[str, Any], name: str, factor: float = 1.0) -> str:
    """A paired difference with its interval."""
    ends = [row.get(f"{name}{end}") for end in ("", "_low", "_high")]
    if None in ends:
        return "-"
    middle, low, high = (f"{factor * end:+.3g}" for end in ends if end is not None)
    return f"{middle} ({low} to {high})"


def _figure(rows: Sequence[Mapping[str, Any]]) -> bytes:
    bars = [
        Bar(
            row["task"],
            row["entry"],
            row["passed"],
            row["trials"],
            (row["success_low"], row["success_high"]),
        )
        for row in rows
    ]
    picture = io.BytesIO()
    save_figure(bench_figure(bars), picture, "png")
    return picture.getvalue()
