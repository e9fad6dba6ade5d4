"""Compares controllers, as `omnitrack bench-control` does, and prints the result as tables.

python benchmarks/bench_tables.py --out DIR [--task TASK ...] [--entry ENTRY ...] [--trials N]
    [--workers N]

Printed are the trials passed of each entry and task, the means of each entry, and its paired
differences to the default controller, a table a task.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import omnitrack_sim as ot
from omnitrack_sim.trials.bench_run import MEASURES

Row = dict[str, Any]


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [f"| {' | '.join(cells)} |" for cells in rows]
    return "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *lines])


def passed(rows: Sequence[Row]) -> str:
    """Trials passed with the interval of their rate: a row an entry, a column a task."""
    tasks, entries = ([*dict.fromkeys(row[key] for row in rows)] for key in ("task", "entry"))
    cells = {
        (row["task"], row["entry"]): f"{row['passed']} of {row['trials']} "
        f"({100 * row['success_low']:.1f} to {100 * row['success_high']:.1f} %)"
        for row in rows
    }
    body = [[f"`{one}`", *(cells.get((task, one), "-") for task in tasks)] for one in entries]
    return table(["entry", *(f"`{task}`" for task in tasks)], body)


def spread(row: Row, name: str, form: str) -> str:
    """A value with the ends of its interval."""
    ends = [row.get(f"{name}{end}") for end in ("", "_low", "_high")]
    if None in ends:
        return "-"
    middle, low, high = (format(end, form) for end in ends)
    return f"{middle} ({low} to {high})"


def measures(rows: Sequence[Row], ending: str, form: str) -> str:
    """The measures of some rows, or with ``_more`` their differences to the default."""
    heads = ["entry", *(measure.head for measure in MEASURES)]
    return table(
        heads,
        [
            [f"`{row['entry']}`", *(spread(row, f"{m.name}{ending}", form) for m in MEASURES)]
            for row in rows
        ],
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--task", nargs="+", dest="tasks")
    parser.add_argument("--entry", nargs="+", dest="entries")
    parser.add_argument("--trials", type=int)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    bench = ot.Bench.of(given.tasks, given.entries, trials=given.trials)
    rows = ot.run_bench(bench, out=given.out, workers=given.workers).rows
    print(f"## passed\n\n{passed(rows)}\n")
    for task in bench.tasks:
        own = [row for row in rows if row["task"] == task.name]
        print(f"## {task.name} means\n\n{measures(own, '', '.3g')}\n")
        others = [row for row in own if "success_more" in row]
        print(f"## {task.name} differences\n\n{measures(others, '_more', '+.3g')}\n")


if __name__ == "__main__":
    main()
