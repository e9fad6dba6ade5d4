"""sweep, optimise, bench: many trials; their workers, progress and interruption."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError, OutputError
from omnitrack_sim.base.text import clipped, counted
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    CalibrationOption,
    FolderOption,
    JsonOption,
    SetOption,
    app,
    clock,
    err,
    out,
    plain,
    print_json,
    print_table,
    progress,
    with_changes,
)
from omnitrack_sim.cli.word_table import WordTable

if TYPE_CHECKING:
    from omnitrack_sim.trials.run import Status

FAILED, FILM = "failed", "video.mp4"
"""Folder of the runs of trials that failed, in that of a sweep, and the film in each."""
LISTED = 10
"""Number of trials of a sweep that --list shows."""
_LONGEST = 1000
"""Characters of the values of a trial that it shows."""
WorkersOption = Annotated[
    int | None,
    typer.Option(min=1, help="Processes on this machine; one for each core by default."),
]
DaskOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, such as tcp://host:8786.")
]
ListOption = Annotated[
    bool,
    typer.Option(
        "--list",
        help="Show what would be run, how much, and how long it takes; some steps of a trial, with "
        "its controller, measure that. Save nothing.",
    ),
]
BatchOption = Annotated[
    int | None,
    typer.Option(
        "--batch",
        metavar="N",
        min=1,
        help="Trials that run together: so many an interruption costs each worker at most, and the "
        "fewer they are the longer each takes.",
    ),
]
CoursesOption = Annotated[
    list[str] | None,
    typer.Option("--course", metavar="COURSE", help="Only this course. Repeat for several."),
]
QuickOption = Annotated[bool, typer.Option("--quick", help="A few trials of each course.")]
TrialsOption = Annotated[
    int | None,
    typer.Option("--trials", metavar="N", min=1, help="Number of trials of each course."),
]


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
    folder: FolderOption = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Only the I-th of N shares, I from 1.")
    ] = None,
    go_on: Annotated[
        bool, typer.Option("--continue", help="DIR must hold this sweep already.")
    ] = False,
    batch: BatchOption = None,
    film_failed: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Run N of the trials that failed again, as runs with films, into DIR/failed: "
            "first one of each outcome.",
        ),
    ] = None,
    only_list: ListOption = False,
    as_json: JsonOption = False,
) -> None:
    """Run a sweep; the same command resumes it after an interruption."""
    from omnitrack_sim.trials.store import record_name

    loaded = with_changes(lambda changes: ot.load_sweep(source, changes, batch=batch), assignments)
    target = folder or Path("out") / loaded.name
    if only_list:
        _print_trials(loaded)
        print_extent(loaded, target, workers)
        return
    share = _share(shard)
    if go_on and not (target / record_name(ot.Sweep)).is_file():
        raise OutputError(
            f"{target}: holds no sweep to go on with; leave out --continue to begin one"
        )
    options = worker_options(workers, dask)
    with trials_bar(f"sweep {loaded.name}") as report:
        result = ot.run_trials(loaded, out=target, shard=share, progress=report, **options)
    if as_json:
        print_json(result.summary)
    else:
        _print_sweep(result, loaded.size, target)
    if film_failed is not None:
        _film_failed(result, loaded, film_failed, target, as_json)


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
    folder: FolderOption = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    batch: BatchOption = None,
    only_list: ListOption = False,
    as_json: JsonOption = False,
) -> None:
    """Search for the best values of a scenario; the same command resumes an interrupted search."""
    study = with_changes(lambda changes: ot.load_study(source, changes, batch=batch), assignments)
    target = folder or Path("out") / study.name
    if only_list:
        _print_plan(study)
        print_extent(study, target, workers)
        return
    options = worker_options(workers, dask)
    with trials_bar(f"optimise {study.name}") as report:
        result = ot.run_trials(study, out=target, progress=report, **options)
    if as_json:
        print_json(result.summary)
    else:
        _print_study(study, result, target)


@app.command()
def bench(
    suite: Annotated[
        str,
        typer.Argument(
            metavar="SUITE",
            help="A suite file, or a shipped one by name: mobility, of robots; or control, of "
            "controllers and policies of the default robot.",
            autocompletion=complete.suites,
        ),
    ] = "mobility",
    robots: Annotated[
        list[str] | None,
        typer.Option(
            "--robot",
            metavar="ROBOT",
            help="Beside the shipped ones: an MJCF file, module:Class or the name of a shipped "
            "one; NAME= before it renames it, @BORE after it makes a similar robot for a bore in "
            "metres. Repeat for several.",
        ),
    ] = None,
    controllers: Annotated[
        list[str] | None,
        typer.Option(
            "--controller",
            metavar="CONTROLLER",
            help="Of each --robot, in order: module:Class or one of the robot's own. Without "
            "--robot it drives the package's own, and may be a policy file.",
        ),
    ] = None,
    alone: Annotated[
        bool, typer.Option("--alone", help="Leave out what comes with the package.")
    ] = False,
    courses: CoursesOption = None,
    quick: QuickOption = False,
    trials: TrialsOption = None,
    assignments: SetOption = None,
    calibration: CalibrationOption = None,
    folder: FolderOption = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    batch: BatchOption = None,
    only_list: ListOption = False,
    as_json: JsonOption = False,
) -> None:
    """Put robots or controllers through the same courses.

    The same command resumes after an interruption.
    """
    from omnitrack_sim.trials.suite import load_suite

    shipped = [] if alone else [*load_suite(suite).entries]
    own = _pairs(robots or [], controllers or [])
    entries = [*shipped, *own]
    drawn = None if calibration is None else ot.load_calibration(calibration)
    planned = with_changes(
        lambda changes: ot.Bench.of(
            suite,
            courses,
            entries,
            quick=quick,
            trials=trials,
            changes=changes,
            batch=batch,
            calibration=drawn,
        ),
        assignments,
    )
    if own and shipped:
        beside = counted(len(shipped), "shipped entry", "shipped entries")
        err.say(f"runs beside {beside}; --alone leaves these out")
    kind = "_quick" if quick else "" if trials is None else f"_{trials}"
    target = folder or Path("out") / f"bench_{Path(suite).stem}{kind}"
    if only_list:
        _print_courses(planned)
        print_extent(planned, target, workers)
        return
    options = worker_options(workers, dask)
    with trials_bar(f"bench {planned.name}") as report:
        result = ot.run_trials(planned, out=target, progress=report, **options)
    if as_json:
        print_json(result.summary["rows"])
    else:
        _print_bench(planned, result, target)


def _pairs(robots: list[str], controllers: list[str]) -> list[tuple[str, str]]:
    """Pair robots with their controllers; "" stands for a missing one."""
    if robots and controllers and len(robots) != len(controllers):
        problem = "give one for each --robot, or none"
        raise InputError(Fault("--controller", problem))
    count = max(len(robots), len(controllers))
    return list(zip(robots or [""] * count, controllers or [""] * count, strict=True))


def worker_options(workers: int | None, dask: str | None) -> dict[str, Any]:
    """Return the workers as keyword arguments of ``run_trials``: processes, or a Dask cluster.

    Raises:
        InputError: both are asked for.
    """
    from omnitrack_sim.base.workers import DaskPool, cores

    if dask is None:
        return {"workers": workers or cores(), "executor": None}
    if workers is not None:
        raise InputError(Fault("--workers, --dask", "give one of the two"))
    logging.disable(logging.ERROR)  # distributed logs each lost connection with its traceback
    return {"workers": 1, "executor": lambda: DaskPool(dask)}


@contextmanager
def trials_bar(title: str) -> Iterator[Callable[[Status], None]]:
    """Show the progress of trials on standard error, and yield the function that takes it.

    It is a bar, or a line now and then where standard error is no terminal.

    Raises:
        typer.Exit: with status 130, when Ctrl-C has been pressed.
    """
    last: Status | None = None
    try:
        with progress(title) as tell:

            def report(status: Status) -> None:
                nonlocal last
                if last is None:
                    many = "all" if status.found == status.total else str(status.found)
                    earlier = f", {many} of them done before" if status.found else ""
                    tell(0.0, f"{counted(status.total, 'trial')}{earlier}")
                else:
                    # Trials of an earlier run took no time now, and count for no pace.
                    part = (status.done - status.found) / max(status.total - status.found, 1)
                    tell(part, _in_words(status))
                last = status

            yield report
    except KeyboardInterrupt:
        done = "nothing is done"
        if last is not None and last.stage:
            done = f"{last.stage}, {counted(last.done, 'trial')} done"
        elif last is not None:
            done = f"{last.done} of {counted(last.total, 'trial')} done"
        if last is not None and last.batch:
            batch = "the trial" if last.batch == 1 else f"the batch of up to {last.batch} trials"
            done += f", and {batch} that each worker was at begins anew"
        err.say(f"interrupted: {done}; the same command goes on from there")
        raise typer.Exit(130) from None


def _in_words(status: Status) -> str:
    # The trials of a study that pass say little: it tells its stage.
    what = status.stage or f"{status.successes} passed"
    lost = f"workers lost {counted(status.lost, 'time')}" if status.lost else ""
    count = f"{status.done} of {counted(status.total, 'trial')}"
    return ", ".join(filter(None, (count, what, lost)))


def _share(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    numbers = re.fullmatch(r"(\d+)/(\d+)", text)
    if not numbers or not 1 <= int(numbers[1]) <= int(numbers[2]):
        raise InputError(
            Fault("--shard", f"is {text!r}; write I/N with I from 1 to N, such as 1/4")
        )
    return int(numbers[1]), int(numbers[2])


def _print_trials(loaded: ot.Sweep) -> None:
    values = loaded.trials()
    batches = loaded.batches()
    models = {batch.model for batch in batches}
    size, parts = counted(loaded.size, "trial"), counted(len(batches), "batch", "batches")
    out.print(f"{size} in {parts} of {counted(len(models), 'model')}")
    rows = [
        ", ".join(f"{name} = {_shown(column[i])}" for name, column in values.items())
        for i in range(min(LISTED, loaded.size))
    ]
    texts = ((str(i), clipped(text, _LONGEST)) for i, text in enumerate(rows))
    print_table(("trial", "values"), texts)
    if loaded.size > LISTED:
        out.print(f"and {loaded.size - LISTED} more")


def _print_courses(planned: ot.Bench) -> None:
    """Print the courses of a bench, and how many trials each entry has on each."""
    names = [entry.name for entry in planned.entries]
    sweeps = planned.sweeps()
    rows = []
    for course in planned.courses:
        own = [sweeps[course.name, name] for name in names]
        trials = [sweep.size for sweep in own if not isinstance(sweep, str)]
        rows.append((course.name, str(len(trials)), str(sum(trials)), course.words))
    print_table(("course", "entries that fit", "trials", "what"), rows)
    out.say(f"entries: {plain(', '.join(names))}")


def print_extent(plan: ot.Plan, target: Path, workers: int | None) -> None:
    """Print how many trials a plan has, and how long they take on this machine."""
    from omnitrack_sim.base.workers import cores
    from omnitrack_sim.trials.estimate import estimate

    count = workers or cores()
    extent = estimate(plan, target if target.is_dir() else None)
    ends = [clock(seconds / count) for seconds in (extent.shortest, extent.longest)]
    if extent.done == extent.trials:
        out.say(f"all {counted(extent.trials, 'trial')} done before, in {plain(str(target))}")
        return
    takes = "takes" if extent.trials == 1 else "take"
    before = f"; {extent.done} of them done before" if extent.done else ""
    out.say(
        f"{counted(extent.trials, 'trial')} {takes} {ends[0]} (each robot cruises to its goal) to "
        f"{ends[1]} (each runs to its time limit) with "
        f"{counted(count, 'process', 'processes')} on cores of their own{before}"
    )


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "[" + ", ".join(map(_shown, value)) + "]" if isinstance(value, list) else str(value)


def _print_sweep(result: ot.TrialsResult, size: int, target: Path) -> None:
    """Print the summary of a finished sweep of ``size`` trials, or how far a share of it is."""
    summary, place = result.summary, plain(str(target))
    if not summary:
        out.say(
            f"of this share {counted(result.table.num_rows, 'trial')} done; the table follows when "
            f"all {size} are in {place}"
        )
        return
    table = WordTable("group", "passed", "of", "rate", "95 % interval")
    table.add_row("all", *_rate(summary), style="bold")
    for name, rows in summary["groups"].items():
        for row in rows:
            table.add_row(plain(f"{name} = {row['value']}"), *_rate(row))
    out.print(table)
    ends = ", ".join(f"{count} {name}" for name, count in summary["outcomes"].items())
    out.say(f"  {ends}")
    if summary["invalid"] or summary["error"]:
        out.say(f"  not in the rates: {summary['invalid']} invalid, {summary['error']} error")
    out.say(f"  saved in {place}")


def _film_failed(
    result: ot.TrialsResult, sweep: ot.Sweep, count: int, target: Path, quiet: bool
) -> None:
    """Run trials that failed again, and save each with its pictures below ``failed``."""
    from omnitrack_sim.cli.runs import draw, usual_camera
    from omnitrack_sim.results.files import RESULT_FILE
    from omnitrack_sim.trials.table import failures

    chosen = failures(result.table, count)
    if not chosen and not quiet:
        out.say("  no trial failed: nothing to film")
    for trial in chosen:
        folder = target / FAILED / f"trial_{trial}"
        scenario = sweep.scenario(trial)
        if not ((folder / RESULT_FILE).is_file() and (folder / FILM).is_file()):
            with progress(f"trial {trial}", quiet) as report:
                run = ot.run(scenario, progress=report)
            run.save(folder)
            draw(run, folder, usual_camera(scenario), quiet)
        if not quiet:
            out.say(f"  trial {trial} in {plain(str(folder))}")


def _rate(row: dict[str, Any]) -> list[str]:
    rate = row["success_rate"]
    low, high = row["success_rate_95"]
    return [
        str(row["successes"]),
        str(row["counted"]),
        "-" if rate is None else f"{100 * rate:.2f} %",
        f"{100 * low:.2f} to {100 * high:.2f} %",
    ]


def _print_plan(study: ot.Study) -> None:
    """Print variables and objectives of a study, and the amount of work."""
    variables = [
        (one.name, f"{one.low:g}", f"{one.high:g}", one.scale, f"{one.start:g}")
        for one in study.variables
    ]
    print_table(("variable", "from", "to", "scale", "start"), variables)
    objectives = []
    for name, one in zip(study.columns, study.objectives, strict=True):
        of = "" if one.metric == "success_rate" else one.aggregate or "mean"
        limit = "" if one.limit is None else f"{one.limit:g}"
        objectives.append((name, one.goal, of, one.trials or "all", limit))
    print_table(("objective", "goal", "of", "trials", "limit"), objectives)
    searches, candidates = study.search_count, study.candidate_count
    out.say(
        f"search: the start, {searches} x {counted(study.generations, 'generation')} x "
        f"{counted(study.asked_each, 'candidate')}, and {counted(searches, 'centre')}: "
        f"{_work(candidates, study.size)}"
    )
    most = study.final.candidates
    if not most:
        out.print("check: none")
        return
    # At most, since directions may share their best candidates.
    checked = min(1 + searches * (most + 1), candidates)
    size = sum(sweep.size for sweep in study.unseen)
    out.say(
        f"check: the start, {counted(searches, 'centre')}, and the best {most} of each "
        f"of {counted(searches, 'direction')}: at most "
        f"{_work(checked, size)}"
    )


def _work(candidates: int, trials: int) -> str:
    """Text of the number of trials of candidates."""
    total = counted(candidates * trials, "trial")
    return f"{counted(candidates, 'candidate')} of {counted(trials, 'trial')}, {total} in all"


def _print_study(study: ot.Study, result: ot.TrialsResult, target: Path) -> None:
    """Print the start and the best candidate side by side."""
    from omnitrack_sim.trials.study import BEST_FILE

    summary = result.summary
    table = WordTable("", "start", "best")
    for name in study.columns:
        for key, of in (("search", name), ("check", f"{name}, other trials")):
            pair = [summary[which][key] for which in ("start", "best")]
            if pair[0] is not None:
                table.add_row(plain(of), *(_figure(one[name]) for one in pair))
    for key, of in (("search", "passed"), ("check", "passed, other trials")):
        pair = [summary[which][key] for which in ("start", "best")]
        if pair[0] is not None:
            table.add_row(of, *(f"{one['passed']} of {one['trials']}" for one in pair))
    for path in summary["best"]["values"]:
        pair = [summary[which]["values"][path] for which in ("start", "best")]
        table.add_row(plain(path), *map(_figure, pair), style="dim")
    out.print(table)
    number = summary["best"]["number"]
    text = f"{summary['on_front']} on the front of the search"
    if not result.tables["front"].num_rows:
        text = "none has a value in every objective, so none is better than the start"
    elif number not in result.tables["front"]["number"].to_pylist():
        text += ", not this one, which is the best in the check"
    out.say(f"  candidate {number} of {summary['candidates']}; {text}")
    place, file = plain(str(target)), plain(str(target / BEST_FILE))
    out.say(f"  saved in {place}; its values: --set @{file}")


def _figure(value: Any) -> str:
    return "-" if value is None else f"{value:.6g}"


def _print_bench(planned: ot.Bench, result: ot.TrialsResult, target: Path) -> None:
    from omnitrack_sim.trials.bench_table import figures_of, headings

    every = result.summary["rows"]
    figures = {
        name: head.replace(", ", "\n").replace(" ", "\n")
        for name, head in planned.suite.heads.items()
        if any(row.get(name) is not None for row in every)
    }
    for name, words in headings(planned, every).items():
        table = WordTable("entry", "passed", "95 %\ninterval\n%", *figures.values(), gap=1)
        table.title, table.title_justify = f"{name}: {words}", "left"
        for column in table.columns:
            column.no_wrap = True
        for column in table.columns[1:]:
            column.justify = "right"
        for row in (row for row in every if row["course"] == name):
            table.add_row(plain(row["entry"]), *figures_of(figures, row))
        out.print(table)
    out.say(f"  saved in {plain(str(target))}")
