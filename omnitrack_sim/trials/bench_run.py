"""Benchmark runs: the sweeps of all courses and entries on one engine, and their tables."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import finite, strict_json
from omnitrack_sim.base.writing import as_output_error, check_folder, write_file, write_files
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval, wilson_interval
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.show.plots.style import attempt, figure_bytes
from omnitrack_sim.show.plots.success import bench_figure
from omnitrack_sim.trials.batches import INVALID
from omnitrack_sim.trials.bench import Bench, Suite
from omnitrack_sim.trials.dispatch import Engine, MakeExecutor, Progress, Status
from omnitrack_sim.trials.store import column, made_by, passed_of, to_csv, to_parquet
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_run import finish_sweep, sweep_store

BENCH_FILE = "bench.json"
TRIALS = "trials"
"""Folder with the sweeps of all courses and entries."""
MISFIT = "does not fit"
ALL = "all"
"""Course of the rows over all courses together."""
RESULTS, TRIALS_TABLE, PAGE, FIGURE = "results", "trials.parquet", "results.md", "bench.png"
FILES = (BENCH_FILE, f"{RESULTS}.parquet", f"{RESULTS}.csv", TRIALS_TABLE, PAGE, FIGURE)


@dataclass(frozen=True, eq=False)
class BenchResult:
    """Result of a benchmark.

    Attributes:
        bench: that was run.
        table: one row for each course and entry: rates, means, scores, differences from the default
            entry.
        status: how many trials there are, were found done, and are done now.
        folder: of the files; None if nothing was written.
        rows: of ``table``, each without the columns that it has no value for.
        trials: all trials of all entries.

    Example:
        >>> short = {"run.time_limit": 0.01}
        >>> bench = ot.Bench.of(
        ...     "control", ["elbow"], ["feedback", "equal"], trials=1, changes=short
        ... )
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
            and courses were asked for then. Without one nothing is written.
        workers: processes that run trials; with 1 this one does.
        executor: runs them instead, as in ``run_sweep``.
        progress: called with the ``Status`` of all trials together.

    Raises:
        InputError: an entry cannot drive a course; no such number of workers.
        OutputError: the folder holds something else, or cannot be written; finished batches stay.
        WorkersLost: the given executor has broken; the same call goes on from there.

    Example:
        >>> bench = ot.Bench.of(
        ...     "mobility", ["elbow_15"], ["presser"], trials=2, changes={"run.time_limit": 0.01}
        ... )
        >>> ot.run_bench(bench).trials.num_rows
        2
    """
    check_is(Bench, "bench", bench)
    folder = None if out is None else Path(out)
    if folder is not None:
        check_folder(folder, mark=BENCH_FILE, files=FILES)
        _check_record(bench, folder)
    planned = bench.sweeps()
    if folder is not None and not (folder / BENCH_FILE).is_file():
        with as_output_error(folder):
            folder.mkdir(parents=True, exist_ok=True)
        # The record marks the folder as a benchmark's before the first batch, in case this is
        # killed.
        write_file(folder / BENCH_FILE, (strict_json(_plan(bench)) + "\n").encode())
    sweeps = {key: sweep for key, sweep in planned.items() if isinstance(sweep, Sweep)}
    with Engine(workers, executor, progress) as engine:
        tables = _tables(sweeps, folder, engine)
    # A sweep all of whose trials are invalid is no error here: the table says so.
    rows = rows_of(bench.suite, {key: tables.get(key, misfit) for key, misfit in planned.items()})
    result = BenchResult(
        bench, _table(bench.suite, rows), engine.status, folder, rows, _all_trials(tables)
    )
    if folder is not None:
        _write(result, folder)
    return result


def _tables(
    sweeps: Mapping[tuple[str, str], Sweep], folder: Path | None, engine: Engine
) -> dict[tuple[str, str], pa.Table]:
    """Run the missing trials of sweeps, and return the table of each."""
    stores = {
        key: sweep_store(sweep, None if folder is None else folder.joinpath(TRIALS, *key))
        for key, sweep in sweeps.items()
    }
    jobs = {
        key: [(stores[key], batch) for batch in sweep.batches()] for key, sweep in sweeps.items()
    }
    engine.begin(sum(sweep.size for sweep in sweeps.values()))
    # All sweeps as one list, so that workers stay busy from one course to the next.
    parts = iter(engine.run([job for own in jobs.values() for job in own]))
    tables = {}
    for key, sweep in sweeps.items():
        made = [next(parts) for _ in jobs[key]]
        tables[key] = stores[key].columns.merged(made)
        makers = {made_by(part) for part in made}
        # The benchmark has a figure of its own: one for each of hundreds of sweeps would take long.
        finish_sweep(sweep, stores[key], tables[key], makers, draws=False)
    return tables


def _plan(bench: Bench) -> dict[str, Any]:
    """Return the values that all runs in one folder share."""
    return {
        "suite": bench.suite.name,
        "version": bench.suite.version,
        "quick": bench.quick,
        "trials": bench.trials,
        "changes": dict(bench.changes),
    }


def _check_record(bench: Bench, folder: Path) -> None:
    """Refuse a folder with another benchmark.

    Raises:
        OutputError: its suite, version, number of trials or changes are others.
    """
    file = folder / BENCH_FILE
    try:
        record = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    except (ValueError, OSError):
        record = {}
    for key, value in json.loads(strict_json(_plan(bench))).items():
        if record.get(key, value) != value:
            raise OutputError(
                f"{folder}: holds a benchmark with {key} {record[key]!r}, not {value!r}; choose "
                "another folder with --out, or remove this one to begin anew"
            )


def rows_of(suite: Suite, tables: Mapping[tuple[str, str], pa.Table | str]) -> list[dict[str, Any]]:
    """Return one row for each course and entry: rates, means, scores, differences from the default
    entry.

    Differences are paired: of the success over all trials that both ran, of the other figures over
    those that both passed.

    Args:
        suite: that was run.
        tables: of the trials, by (course, entry); a text says why the robot does not fit.
    """
    rows = []
    for (course, entry), table in {**tables, **_over_all(suite, tables)}.items():
        row: dict[str, Any] = {"course": course, "entry": entry}
        if isinstance(table, str):
            rows.append(row | _no_rates(table))
            continue
        row |= _rates(table, course not in suite.courses or suite.courses[course].is_passed)
        passed = passed_of(table)
        for measure in suite.measures:
            counts = np.isfinite(passed) if measure.of_failures else passed == 1
            row |= _spread(measure.name, measure.of(table)[counts])
        row |= finite({name: score(table) for name, score in suite.scores.items()})
        default = tables.get((course, suite.default), "")
        if not isinstance(default, str) and entry != suite.default:
            row |= _differences(suite, table, default)
        rows.append(row)
    return rows


def _over_all(
    suite: Suite, tables: Mapping[tuple[str, str], pa.Table | str]
) -> dict[tuple[str, str], pa.Table | str]:
    """The trials of each entry on all courses that it fits and can pass, if these are several."""
    idle = {course.name for course in suite.courses.values() if not course.is_passed}
    tables = {key: table for key, table in tables.items() if key[0] not in idle}
    if len({course for course, _ in tables}) < 2:
        return {}
    together = {}
    for entry in dict.fromkeys(entry for _, entry in tables):
        own = {key: table for key, table in tables.items() if key[1] == entry}
        fit = {key: table for key, table in own.items() if not isinstance(table, str)}
        together[ALL, entry] = _all_trials(fit) if fit else next(iter(own.values()))
    return together


def _no_rates(reason: str) -> dict[str, Any]:
    low, high = wilson_interval(0, 0)
    return {
        "trials": 0,
        "passed": 0,
        "success": None,
        "success_low": low,
        "success_high": high,
        "others": MISFIT,
        "reason": reason,
    }


def _rates(table: pa.Table, is_passed: bool) -> dict[str, Any]:
    judged = passed_of(table)
    counted, passed = int(np.isfinite(judged).sum()), int(np.nansum(judged))
    low, high = wilson_interval(passed, counted)
    outcomes = Counter(table["outcome"].to_pylist())
    ends = zip(table["outcome"].to_pylist(), table["reason"].to_pylist(), strict=True)
    reasons = [reason for outcome, reason in ends if outcome != Outcome.REACHED_GOAL and reason]
    if set(outcomes) == {INVALID}:
        return _no_rates(reasons[0])
    others = {name: n for name, n in sorted(outcomes.items()) if name != Outcome.REACHED_GOAL}
    return {
        "trials": counted,
        "passed": passed,
        "success": passed / counted if counted and is_passed else None,
        "success_low": low,
        "success_high": high,
        "others": ", ".join(f"{count} {name}" for name, count in others.items()),
        "reason": next(iter(reasons), ""),
    }


def _spread(name: str, values: Array) -> dict[str, Any]:
    """Mean of values with its interval; None where there is none."""
    values = values[np.isfinite(values)]
    low, high = mean_interval(values.tolist())
    ends = (float(np.mean(values)) if len(values) else math.nan, low, high)
    keys = (name, f"{name}_low", f"{name}_high")
    return finite(dict(zip(keys, ends, strict=True)))


def _differences(suite: Suite, table: pa.Table, default: pa.Table) -> dict[str, Any]:
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
    for measure in suite.measures:
        own, others = measure.of(table)[both], measure.of(default)[both]
        row |= _spread(f"{measure.name}_more", own - others)
    return row


def _write(result: BenchResult, folder: Path) -> None:
    """Write everything but the trials' own folders, none before all are made."""
    bench, rows = result.bench, result.rows
    record = {
        **_plan(bench),
        "courses": {course.name: course.words for course in bench.courses},
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
    passable = {course.name for course in bench.courses if course.is_passed} | {ALL}
    judged = [row for row in rows if row["course"] in passable]
    figure = attempt(FIGURE, lambda: figure_bytes(bench_figure(judged))) if judged else None
    files |= {} if figure is None else {FIGURE: figure}
    write_files({folder / name: data for name, data in files.items()})


def _table(suite: Suite, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """The rows as a table with all columns, and the units of those that have one."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    kinds = {"trials": pa.int64(), "passed": pa.int64()}
    kinds |= dict.fromkeys(("course", "entry", "others", "reason"), pa.string())
    # Means, their ends and their differences share the measure's name as a prefix.
    units = {name: m.unit for name in names for m in suite.measures if name.startswith(m.name)}
    fields = [column(name, kinds.get(name, pa.float64()), units.get(name, "1")) for name in names]
    return pa.Table.from_pylist([dict(row) for row in rows], pa.schema(fields))


def _all_trials(tables: Mapping[tuple[str, str], pa.Table]) -> pa.Table:
    """All trials of all entries in one table; columns that a course does not vary are null."""
    parts = []
    for (course, entry), table in tables.items():
        # Each sweep's table has its own hash in the metadata; tables with different ones do not
        # join.
        plain = table.replace_schema_metadata(None)
        for name, value in (("entry", entry), ("course", course)):
            plain = plain.add_column(0, name, pa.array([value] * len(plain), pa.string()))
        parts.append(plain)
    # Without a single trial, as where no robot fits, there is nothing to join.
    return pa.concat_tables(parts, promote_options="permissive") if parts else pa.table({})


def page(bench: Bench, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as Markdown: the trials passed, then for each course the entries, and the
    paired differences."""
    suite = bench.suite
    version = f"suite {suite.name}, version {suite.version}; {bench.extent}"
    lines = [f"# {suite.title}", "", version, "", *passed_table(rows)]
    units = [measure.head for measure in suite.measures]
    heads = ["entry", "passed", "95 % interval, %", *suite.heads.values(), "others"]
    for name, words in headings(bench, rows).items():
        own = [row for row in rows if row["course"] == name]
        lines += [f"## {name}: {words}", ""]
        cells = [
            [f"`{row['entry']}`", *figures_of(suite.heads, row), row["others"] or "-"]
            for row in own
        ]
        lines += markdown_table(heads, cells)
        others = [row for row in own if "success_more" in row]
        if others:
            differences = [
                ("success_more", 100.0),
                *((f"{m.name}_more", 1.0) for m in suite.measures),
            ]
            cells = [
                [f"`{row['entry']}`", *(_more(row, *d) for d in differences)] for row in others
            ]
            lines += markdown_table([f"entry less `{suite.default}`", "passed, %", *units], cells)
    return "\n".join(lines)


def headings(bench: Bench, rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the task of each course that has rows, by the name of the course."""
    words = {course.name: course.words for course in bench.courses}
    names = dict.fromkeys(row["course"] for row in rows)
    return {name: words.get(name, "over all courses that it fits") for name in names}


def passed_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return lines of Markdown: a row a course, a column an entry, with the trials passed."""
    courses, entries = ([*dict.fromkeys(row[key] for row in rows)] for key in ("course", "entry"))
    texts = {(row["course"], row["entry"]): rate_of(row) for row in rows}
    cells = [[f"`{one}`", *(texts.get((one, entry), "-") for entry in entries)] for one in courses]
    return markdown_table(["course", *(f"`{entry}`" for entry in entries)], cells)


def rate_of(row: Mapping[str, Any]) -> str:
    """Return the trials passed of a row as text; or the pull, or that its robot does not fit."""
    if row["trials"] and row["success"] is None:
        pull = row.get("pull_held_n")
        return "-" if pull is None else f"{pull:.3g} N"
    return f"{row['passed']} of {row['trials']}" if row["trials"] else row["others"]


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table of Markdown, and the empty line below it."""
    lines = [f"| {' | '.join(cells)} |" for cells in rows]
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *lines, ""]


def figures_of(names: Iterable[str], row: Mapping[str, Any]) -> list[str]:
    """Return the trials passed, their rate's interval, and the figures ``names`` of a row, as
    texts."""
    interval = f"{100 * row['success_low']:.0f} to {100 * row['success_high']:.0f}"
    values = [row.get(name) for name in names]
    # Three digits, and more only before the point.
    texts = [
        "-" if value is None else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
        for value in values
    ]
    return [rate_of(row), "-" if row["success"] is None else interval, *texts]


def _more(row: Mapping[str, Any], name: str, factor: float) -> str:
    """A paired difference with its interval."""
    ends = [row.get(f"{name}{end}") for end in ("", "_low", "_high")]
    if None in ends:
        return "-"
    middle, low, high = (f"{factor * end:+.3g}" for end in ends if end is not None)
    return f"{middle} ({low} to {high})"
