"""Benchmark runs: the sweeps of all tasks and entries on one engine, and their tables."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import finite, strict_json
from omnitrack_sim.base.writing import check_folder, told, write_file, write_files
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval, wilson_interval
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.show.plots.style import attempt, figure_bytes
from omnitrack_sim.show.plots.success import bench_figure
from omnitrack_sim.trials.bench import DEFAULT, Bench
from omnitrack_sim.trials.dispatch import Engine, MakeExecutor, Progress, Status
from omnitrack_sim.trials.store import column, made_by, numbers_of, passed_of, to_csv, to_parquet
from omnitrack_sim.trials.sweep_run import finish_sweep, sweep_store

if TYPE_CHECKING:
    import pyarrow as pa

BENCH_FILE = "bench.json"
TRIALS = "trials"
"""Folder with the sweeps of all tasks and entries."""
RESULTS, TRIALS_TABLE, PAGE, FIGURE = "results", "trials.parquet", "results.md", "bench.png"
FILES = (BENCH_FILE, f"{RESULTS}.parquet", f"{RESULTS}.csv", TRIALS_TABLE, PAGE, FIGURE)


@dataclass(frozen=True, eq=False)
class BenchResult:
    """Result of a benchmark.

    Attributes:
        bench: that was run.
        table: one row for each task and entry: rates, means, differences from the default entry.
        status: how many trials there are, were found done, and are done now.
        folder: of the files; None if nothing was written.
        rows: of ``table``, each without the columns that it has no value for.
        trials: all trials of all entries.

    Example:
        >>> short = {"run.time_limit": 0.01}
        >>> bench = ot.Bench.of(["elbow"], ["feedback", "equal"], trials=1, changes=short)
        >>> result = ot.run_bench(bench)
        >>> [(row["entry"], row["passed"], row["others"]) for row in result.rows]
        [('feedback', 0, '1 timed_out'), ('equal', 0, '1 timed_out')]
    """

    bench: Bench
    table: pa.Table
    status: Status
    folder: Path | None
    rows: list[dict[str, Any]]
    trials: pa.Table


def run_bench(
    bench: Bench,
    *,
    out: str | Path | None = None,
    workers: int = 1,
    executor: Executor | MakeExecutor | None = None,
    progress: Progress | None = None,
) -> BenchResult:
    """Run the trials of a benchmark that are not done yet.

    Args:
        bench: what to run.
        out: folder of the files; trials that are there already are not run again, whatever entries
            and tasks were asked for then. Without one nothing is written.
        workers: processes that run trials; with 1 this one does.
        executor: runs them instead, as in ``run_sweep``.
        progress: called with the ``Status`` of all trials together.

    Raises:
        InputError: an entry cannot drive a task; no such number of workers.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.

    Example:
        >>> bench = ot.Bench.of(["elbow"], ["equal"], trials=2, changes={"run.time_limit": 0.01})
        >>> ot.run_bench(bench).trials.num_rows
        2
    """
    check_is(Bench, "bench", bench)
    folder = None if out is None else Path(out)
    if folder is not None:
        check_folder(folder, mark=BENCH_FILE, files=FILES)
    sweeps = bench.sweeps()
    if folder is not None and not (folder / BENCH_FILE).is_file():
        with told(folder):
            folder.mkdir(parents=True, exist_ok=True)
        # The record marks the folder as a benchmark's before the first batch, in case this is
        # killed.
        write_file(folder / BENCH_FILE, b"{}\n")
    jobs = []
    stores = {}
    for (task, entry), sweep in sweeps.items():
        place = None if folder is None else folder / TRIALS / task / entry
        stores[task, entry] = store = sweep_store(sweep, place)
        jobs.append([(store, batch) for batch in sweep.batches()])
    with Engine(workers, executor, progress) as engine:
        engine.begin(sum(sweep.size for sweep in sweeps.values()))
        # All sweeps as one list, so that workers stay busy from one task to the next.
        parts = iter(engine.run([job for own in jobs for job in own]))
    tables = {}
    for (key, sweep), own in zip(sweeps.items(), jobs, strict=True):
        made = [next(parts) for _ in own]
        tables[key] = stores[key].columns.merged(made)
        finish_sweep(sweep, stores[key], tables[key], {made_by(part) for part in made})
    # A sweep all of whose trials are invalid is no error here: the table says so.
    rows = rows_of(tables)
    result = BenchResult(bench, _table(rows), engine.status, folder, rows, _all_trials(tables))
    if folder is not None:
        _write(result, folder)
    return result


@dataclass(frozen=True)
class BenchMeasure:
    """A figure of a run that passed.

    Attributes:
        name: of its columns.
        unit: of its values.
        words: what it is, short.
        columns: of the tables of sweeps, of which it is the mean: one, or one a module.
    """

    name: str
    unit: str
    words: str
    columns: tuple[str, ...]

    def of(self, table: pa.Table) -> Array:
        """Return the figure of each trial of a table; not a number where there is none."""
        return np.mean([numbers_of(table, name) for name in self.columns], axis=0)

    @property
    def head(self) -> str:
        """Words and unit, for the head of a column."""
        return self.words if self.unit == "1" else f"{self.words}, {self.unit}"


def _of_modules(name: str, unit: str, words: str) -> BenchMeasure:
    return BenchMeasure(name, unit, words, tuple(f"{name}_{i + 1}" for i in range(MODULES)))


MEASURES = (
    BenchMeasure("duration_s", "s", "time", ("duration_s",)),
    _of_modules("slip_ratio_mean", "1", "slip"),
    BenchMeasure("energy_j", "J", "energy", ("energy_j",)),
    _of_modules("torque_change_nm_s", "N m/s", "torque change"),
    BenchMeasure("tilt_max_deg", "deg", "largest tilt", ("tilt_max_deg",)),
)
"""Measures of the trials that an entry passed."""


def rows_of(tables: Mapping[tuple[str, str], pa.Table]) -> list[dict[str, Any]]:
    """Return one row for each task and entry: rates, means, differences from the default entry.

    Differences are paired: of the success over all trials that both ran, of the other figures over
    those that both passed.

    Args:
        tables: of the trials, by (task, entry).
    """
    rows = []
    for (task, entry), table in tables.items():
        row: dict[str, Any] = {"task": task, "entry": entry, **_rates(table)}
        for measure in MEASURES:
            row |= _spread(measure.name, measure.of(table)[passed_of(table) == 1])
        default = tables.get((task, DEFAULT))
        if default is not None and entry != DEFAULT:
            row |= _differences(table, default)
        rows.append(row)
    return rows


def _rates(table: pa.Table) -> dict[str, Any]:
    ends = passed_of(table)
    counted, passed = int(np.isfinite(ends).sum()), int(np.nansum(ends))
    low, high = wilson_interval(passed, counted)
    outcomes = Counter(table["outcome"].to_pylist())
    others = {name: n for name, n in sorted(outcomes.items()) if name != Outcome.REACHED_GOAL}
    return {
        "trials": counted,
        "passed": passed,
        "success": passed / counted if counted else None,
        "success_low": low,
        "success_high": high,
        "others": ", ".join(f"{count} {name}" for name, count in others.items()),
    }


def _spread(name: str, values: Array) -> dict[str, Any]:
    """Mean of values with its interval; None where there is none."""
    low, high = mean_interval(values.tolist())
    ends = (float(np.mean(values)) if len(values) else math.nan, low, high)
    keys = (name, f"{name}_low", f"{name}_high")
    return finite(dict(zip(keys, ends, strict=True)))


def _differences(table: pa.Table, default: pa.Table) -> dict[str, Any]:
    # Both entries have the same draws, so differences trial by trial cancel what the draws do.
    more = passed_of(table) - passed_of(default)
    gained, lost, total = (int(one.sum()) for one in (more == 1, more == -1, np.isfinite(more)))
    low, high = paired_rate_interval(gained, lost, total)
    row: dict[str, Any] = {
        "success_more": (gained - lost) / total if total else None,
        "success_more_low": low,
        "success_more_high": high,
    }
    both = passed_of(table) + passed_of(default) == 2
    for measure in MEASURES:
        own, others = measure.of(table)[both], measure.of(default)[both]
        row |= _spread(f"{measure.name}_more", own - others)
    return row


def _write(result: BenchResult, folder: Path) -> None:
    """Write everything but the trials' own folders, none before all are made."""
    bench, rows = result.bench, result.rows
    record = {
        "quick": bench.quick,
        "trials": bench.trials,
        "changes": dict(bench.changes),
        "tasks": {task.name: task.words for task in bench.tasks},
        "entries": {e.name: {"words": e.words, "changes": dict(e.changes)} for e in bench.entries},
        "rows": rows,
        **environment(),
    }
    files = {
        f"{RESULTS}.parquet": to_parquet(result.table),
        f"{RESULTS}.csv": to_csv(result.table),
        TRIALS_TABLE: to_parquet(result.trials),
        PAGE: page(bench, rows).encode(),
        BENCH_FILE: (strict_json(record) + "\n").encode(),
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
    fields = [column(name, kinds.get(name, pa.float64()), _unit(name)) for name in names]
    return pa.Table.from_pylist([dict(row) for row in rows], pa.schema(fields))


def _unit(name: str) -> str:
    # Means, their ends and their differences share the measure's name as a prefix.
    return next((m.unit for m in MEASURES if name.startswith(m.name)), "1")


def _all_trials(tables: Mapping[tuple[str, str], pa.Table]) -> pa.Table:
    """All trials of all entries in one table; what a task does not vary is null."""
    import pyarrow as pa

    parts = []
    for (task, entry), table in tables.items():
        # Each sweep's table has its own hash in the metadata; tables with different ones do not
        # join.
        plain = table.replace_schema_metadata(None)
        for name, value in (("entry", entry), ("task", task)):
            plain = plain.add_column(0, name, pa.array([value] * len(plain), pa.string()))
        parts.append(plain)
    return pa.concat_tables(parts, promote_options="default")


def page(bench: Bench, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as Markdown: for each task the entries, and the paired differences."""
    units = [measure.head for measure in MEASURES]
    lines = [f"# Controllers compared, {bench.extent}", ""]
    for task in bench.tasks:
        own = [row for row in rows if row["task"] == task.name]
        lines += [f"## {task.name}: {task.words}", ""]
        cells = [[f"`{row['entry']}`", *figures_of(row), row["others"] or "-"] for row in own]
        lines += _table_of(["entry", "passed", "95 %", *units, "others"], cells)
        others = [row for row in own if "success_more" in row]
        if others:
            differences = [("success_more", 100.0), *((f"{m.name}_more", 1.0) for m in MEASURES)]
            cells = [
                [f"`{row['entry']}`", *(_more(row, *d) for d in differences)] for row in others
            ]
            lines += _table_of([f"entry less `{DEFAULT}`", "passed, %", *units], cells)
    return "\n".join(lines)


def _table_of(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table of Markdown, and the empty line below it."""
    lines = [f"| {' | '.join(cells)} |" for cells in rows]
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *lines, ""]


def figures_of(row: Mapping[str, Any]) -> list[str]:
    """Return the trials passed, their rate's interval, and the measures of a row, as texts."""
    interval = f"{100 * row['success_low']:.1f} to {100 * row['success_high']:.1f} %"
    values = [row[measure.name] for measure in MEASURES]
    texts = ["-" if value is None else f"{value:.3g}" for value in values]
    return [f"{row['passed']} of {row['trials']}", interval, *texts]


def _more(row: Mapping[str, Any], name: str, factor: float) -> str:
    """A paired difference with its interval."""
    ends = [row.get(f"{name}{end}") for end in ("", "_low", "_high")]
    if None in ends:
        return "-"
    middle, low, high = (f"{factor * end:+.3g}" for end in ends if end is not None)
    return f"{middle} ({low} to {high})"


def _figure(rows: Sequence[Mapping[str, Any]]) -> bytes:
    return figure_bytes(bench_figure(rows))
