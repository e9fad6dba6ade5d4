"""sweep: many trials into one table."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from omnitrack_sim.base.errors import Fault, InputError, OutputError
from omnitrack_sim.base.text import clipped, counted
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    SetOption,
    app,
    out,
    plain,
    print_json,
    with_changes,
)
from omnitrack_sim.cli.trials import DaskOption, WorkersOption, make_workers, trials_bar

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from omnitrack_sim.trials.dispatch import Status
    from omnitrack_sim.trials.sweep import Sweep

LISTED = 10
"""How many trials --list shows."""
_LONGEST = 1000
"""Characters of the values of a trial that it shows."""


@app.command()
def sweep(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SWEEP",
            help="A sweep file, or the name of a shipped one.",
            autocompletion=complete.sweeps,
        ),
    ],
    assignments: SetOption = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Where parts and table go; out/NAME when not given."
        ),
    ] = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Only the I-th of N shares, I from 1.")
    ] = None,
    go_on: Annotated[
        bool, typer.Option("--continue", help="DIR must hold this sweep already.")
    ] = False,
    only_list: Annotated[
        bool, typer.Option("--list", help="Count the trials, show the first, run nothing.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print summary.json instead of the table.")
    ] = False,
) -> None:
    """Run a sweep; the same command goes on after an interruption."""
    from omnitrack_sim.trials.store import holds_sweep
    from omnitrack_sim.trials.sweep import load_sweep

    loaded = with_changes(lambda changes: load_sweep(source, changes), assignments)
    if only_list:
        _print_trials(loaded)
        return
    share = _share(shard)
    target = folder or Path("out") / loaded.name
    if go_on and not holds_sweep(target):
        raise OutputError(
            f"{target}: holds no sweep to go on with; leave out --continue to begin one"
        )
    done = _run(loaded, target, make_workers(workers, dask), share)
    _print_outcome(loaded, target, done, as_json)


def _run(
    loaded: Sweep,
    target: Path,
    executor: Callable[[], Executor] | None,
    share: tuple[int, int] | None,
) -> int:
    """Run a sweep and tell how far it is; returns the number of rows that are there afterwards."""
    from omnitrack_sim.trials.sweep_run import run_sweep

    def words(status: Status, pace: str) -> tuple[str, ...]:
        return pace, f"{status.successes} passed"

    def reached(status: Status) -> str:
        return f"{status.done} of {counted(status.total, 'trial')} done"

    with trials_bar(f"sweep {loaded.name}", words, reached) as report:
        table = run_sweep(loaded, target, executor=executor, shard=share, progress=report)
    return table.num_rows


def _print_outcome(loaded: Sweep, target: Path, done: int, as_json: bool) -> None:
    """Print the summary of a finished sweep, or how far a share of it is."""
    from omnitrack_sim.trials.store import SUMMARY_FILE

    summary = (
        json.loads((target / SUMMARY_FILE).read_text(encoding="utf-8"))
        if done == loaded.size
        else None
    )
    if as_json:
        print_json(summary)
    elif summary is None:
        out.print(
            (
                f"of this share {counted(done, 'trial')} done; the table follows when all "
                f"{loaded.size} are in {plain(str(target))}"
            ),
            soft_wrap=True,
        )
    else:
        _print_summary(summary, target)


def _share(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    if not found or not 1 <= int(found[1]) <= int(found[2]):
        raise InputError(
            Fault("--shard", f"is {text!r}; write I/N with I from 1 to N, such as 1/4")
        )
    return int(found[1]), int(found[2])


def _print_trials(loaded: Sweep) -> None:
    columns = loaded.trials()
    batches = loaded.batches()
    models = {batch.model for batch in batches}
    size, parts = counted(loaded.size, "trial"), counted(len(batches), "batch", "batches")
    out.print(f"{size} in {parts} of {counted(len(models), 'model')}")
    table = Table("trial", "values", box=None, padding=(0, 2))
    for i in range(min(LISTED, loaded.size)):
        values = ", ".join(f"{name} = {_shown(column[i])}" for name, column in columns.items())
        table.add_row(str(i), plain(clipped(values, _LONGEST)))
    out.print(table)
    if loaded.size > LISTED:
        out.print(f"and {loaded.size - LISTED} more")


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "[" + ", ".join(map(_shown, value)) + "]" if isinstance(value, list) else str(value)


def _print_summary(summary: dict[str, Any], target: Path) -> None:
    table = Table("group", "passed", "of", "rate", "95 % interval", box=None, padding=(0, 2))
    table.add_row("all", *_rate(summary), style="bold")
    for name, rows in summary["groups"].items():
        for row in rows:
            table.add_row(plain(f"{name} = {row['value']}"), *_rate(row))
    out.print(table)
    ends = ", ".join(f"{count} {name}" for name, count in summary["outcomes"].items())
    out.print(f"  {ends}", soft_wrap=True)
    if summary["invalid"] or summary["error"]:
        out.print(
            f"  not in the rates: {summary['invalid']} invalid, {summary['error']} error",
            soft_wrap=True,
        )
    out.print(f"  saved in {plain(str(target))}", soft_wrap=True)


def _rate(row: dict[str, Any]) -> list[str]:
    rate = row["success_rate"]
    low, high = row["success_rate_95"]
    return [
        str(row["successes"]),
        str(row["counted"]),
        "-" if rate is None else f"{100 * rate:.2f} %",
        f"{100 * low:.2f} to {100 * high:.2f} %",
    ]
