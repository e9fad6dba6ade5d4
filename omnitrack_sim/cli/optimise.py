"""optimise: the values of a scenario that are best by what its trials show."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from omnitrack_sim.base.text import counted
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

    from omnitrack_sim.trials.study import Study
    from omnitrack_sim.trials.study_run import StudyResult, StudyStatus


@app.command()
def optimise(
    source: Annotated[
        str,
        typer.Argument(
            metavar="STUDY",
            help="A study file, or the name of a shipped one.",
            autocompletion=complete.studies,
        ),
    ],
    assignments: SetOption = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where all files go; out/NAME when not given."),
    ] = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    only_list: Annotated[
        bool, typer.Option("--list", help="Show what is varied and asked for, run nothing.")
    ] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print summary.json instead of the table.")
    ] = False,
) -> None:
    """Search for the best values of a scenario; the same command goes on after an interruption."""
    from omnitrack_sim.trials.study import load_study

    study = with_changes(lambda changes: load_study(source, changes), assignments)
    if only_list:
        _print_plan(study)
        return
    target = folder or Path("out") / study.name
    result = _run(study, target, make_workers(workers, dask))
    if as_json:
        print_json(result.summary)
    else:
        _print_result(result, target)


def _run(study: Study, target: Path, executor: Callable[[], Executor] | None) -> StudyResult:
    """Run a study and tell how far it is."""
    from omnitrack_sim.trials.study_run import run_study

    def words(status: StudyStatus, pace: str) -> tuple[str, ...]:
        return status.stage, pace

    def reached(status: StudyStatus) -> str:
        return f"{status.stage}, {counted(status.done, 'trial')} done"

    with trials_bar(f"optimise {study.name}", words, reached) as report:
        return run_study(study, target, executor=executor, progress=report)


def _print_plan(study: Study) -> None:
    """What is varied, what is asked for, and how much work that is."""
    varied = Table("variable", "from", "to", "scale", "start", box=None, padding=(0, 2))
    for one in study.variables:
        varied.add_row(
            plain(one.name), f"{one.low:g}", f"{one.high:g}", one.scale, f"{one.start:g}"
        )
    asked = Table("objective", "goal", "of", "trials", "limit", box=None, padding=(0, 2))
    for name, one in zip(study.columns, study.objectives, strict=True):
        of = "" if one.metric == "success_rate" else one.aggregate or "mean"
        limit = "" if one.limit is None else f"{one.limit:g}"
        asked.add_row(plain(name), one.goal, of, plain(one.trials or "all"), limit)
    out.print(varied)
    out.print(asked)
    searches, candidates = study.search_count, study.candidate_count
    out.print(
        f"search: the start, {searches} x {counted(study.generations, 'generation')} x "
        f"{counted(study.asked_each, 'candidate')}, and {counted(searches, 'centre')}: "
        f"{_work(candidates, study.size)}",
        soft_wrap=True,
    )
    most = study.final.candidates
    if not most:
        out.print("check: none")
        return
    checked = min(1 + searches * (most + 1), candidates)
    size = sum(sweep.size for sweep in study.unseen)
    out.print(
        f"check: the start, {counted(searches, 'centre')}, and the best {most} of each "
        f"of {counted(searches, 'direction')}: at most "
        f"{_work(checked, size)}",
        soft_wrap=True,
    )


def _work(candidates: int, trials: int) -> str:
    """How many trials so many candidates are, each in so many."""
    total = counted(candidates * trials, "trial")
    return f"{counted(candidates, 'candidate')} of {counted(trials, 'trial')}, {total} in all"


def _print_result(result: StudyResult, target: Path) -> None:
    """The start and the best beside each other."""
    from omnitrack_sim.trials.study_store import BEST_FILE

    summary, study = result.summary, result.study
    table = Table("", "start", "best", box=None, padding=(0, 2))
    for name in study.columns:
        for key, of in (("search", name), ("check", f"{name}, other trials")):
            pair = [summary[which][key] for which in ("start", "best")]
            if pair[0] is not None:
                table.add_row(plain(of), *(_shown(one[name]) for one in pair))
    for key, of in (("search", "passed"), ("check", "passed, other trials")):
        pair = [summary[which][key] for which in ("start", "best")]
        if pair[0] is not None:
            table.add_row(of, *(f"{one['passed']} of {one['trials']}" for one in pair))
    for path in result.best:
        pair = [summary[which]["values"][path] for which in ("start", "best")]
        table.add_row(plain(path), *map(_shown, pair), style="dim")
    out.print(table)
    number = summary["best"]["number"]
    told = f"{summary['on_front']} on the front of the search"
    if not result.front.num_rows:
        told = "none has a value in every objective, so none is better than the start"
    elif number not in result.front["number"].to_pylist():
        told += ", not this one, which is the best in the check"
    out.print(f"  candidate {number} of {summary['candidates']}; {told}", soft_wrap=True)
    place, file = plain(str(target)), plain(str(target / BEST_FILE))
    out.print(f"  saved in {place}; its values: --set @{file}", soft_wrap=True)


def _shown(value: Any) -> str:
    return "-" if value is None else f"{value:.6g}"
