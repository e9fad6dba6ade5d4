"""bench-control: the same held-out trials for all controllers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import counted
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import app, out, plain, print_json
from omnitrack_sim.cli.trials import DaskOption, WorkersOption, make_workers, trials_bar

if TYPE_CHECKING:
    from omnitrack_sim.trials.bench import Task
    from omnitrack_sim.trials.bench_run import Bench
    from omnitrack_sim.trials.dispatch import Status


@app.command("bench-control")
def bench_control(
    policies: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[POLICY]...",
            help="Policies to enter beside the shipped entries or those of --entry: files, or "
            "NAME=FILE.",
            autocompletion=complete.policies,
        ),
    ] = None,
    entries: Annotated[
        list[str] | None,
        typer.Option(
            "--entry",
            metavar="ENTRY",
            help="This entry instead of all shipped ones: one of these, a kind of controller, "
            "module:Class or a policy file; NAME= before it renames it. Repeat for several.",
        ),
    ] = None,
    tasks: Annotated[
        list[str] | None,
        typer.Option("--task", metavar="TASK", help="Only this task. Repeat for several."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A few trials of each, to see that all runs.")
    ] = False,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials",
            metavar="N",
            min=1,
            help="So many trials of each task, for narrower intervals; drawn anew.",
        ),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where all goes; out/bench_control by default."),
    ] = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the rows as JSON instead of tables.")
    ] = False,
) -> None:
    """Put controllers and policies through the same held-out trials; the same command goes on after
    an interruption."""
    from omnitrack_sim.trials.bench import entry_of, shipped_entries
    from omnitrack_sim.trials.bench_run import Bench, run_bench

    asked = [*(entries or shipped_entries()), *(policies or [])]
    bench = Bench(_tasks(tasks), [entry_of(one) for one in asked], quick, trials)
    kind = "_quick" if quick else "" if trials is None else f"_{trials}"
    target = folder or Path("out") / f"bench_control{kind}"

    def words(status: Status, pace: str) -> tuple[str, ...]:
        return pace, f"{status.successes} passed"

    def reached(status: Status) -> str:
        return f"{status.done} of {counted(status.total, 'trial')} done"

    with trials_bar("bench-control", words, reached) as report:
        make = make_workers(workers, dask)
        rows = run_bench(bench, target, executor=make, progress=report)
    if as_json:
        print_json(rows)
    else:
        _print(bench, rows, target)


def _tasks(names: Sequence[str] | None) -> list[Task]:
    from omnitrack_sim.trials.bench import TASKS

    for name in names or ():
        if name not in TASKS:
            raise InputError(Fault("--task", f"is {name!r}", tuple(TASKS), given=name))
    return [task for name, task in TASKS.items() if not names or name in names]


def _print(bench: Bench, rows: Sequence[dict[str, Any]], target: Path) -> None:
    from omnitrack_sim.trials.bench_run import MEASURES

    named = [
        m.words.replace(" ", "\n") + ("" if m.unit == "1" else f"\n{m.unit}") for m in MEASURES
    ]
    for task in bench.tasks:
        table = Table("entry", "passed", "95 %\ninterval", *named, box=None, padding=(0, 1))
        table.title, table.title_justify = f"{task.name}: {task.words}", "left"
        for column in table.columns[1:]:
            column.justify, column.no_wrap = "right", True
        for row in (row for row in rows if row["task"] == task.name):
            interval = f"{100 * row['success_low']:.1f} to {100 * row['success_high']:.1f} %"
            figures = [row[m.name] for m in MEASURES]
            cells = ["-" if value is None else f"{value:.3g}" for value in figures]
            passed = f"{row['passed']} of {row['trials']}"
            table.add_row(plain(row["entry"]), passed, interval, *cells)
        out.print(table)
    out.print(f"  saved in {plain(str(target))}", soft_wrap=True)
