"""The files of the benchmark's folder: tables for machines, one for people, a figure."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.text import strict_json
from omnitrack_sim.base.writing import write_files
from omnitrack_sim.results.provenance import environment
from omnitrack_sim.show.plots.bench import Bar, bench_figure
from omnitrack_sim.show.plots.style import attempt, save_figure
from omnitrack_sim.trials.bench.entries import DEFAULT
from omnitrack_sim.trials.bench.figures import MEASURES
from omnitrack_sim.trials.sweep.table import to_csv, to_parquet

if TYPE_CHECKING:
    import pyarrow as pa

    from omnitrack_sim.trials.bench.run import Bench

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
            told = map(_differences, others)
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


def _differences(row: Mapping[str, Any]) -> list[str]:
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
