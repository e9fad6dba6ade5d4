"""passport: what a robot passes, measured once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    SetOption,
    app,
    out,
    plain,
    print_json,
    print_table,
    with_changes,
)
from omnitrack_sim.cli.trials import DaskOption, WorkersOption, trials_bar, worker_options


@app.command()
def passport(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            help="Kind of a robot, an MJCF or URDF file, or module:Class.",
            autocompletion=complete.robots,
        ),
    ],
    controller: Annotated[
        str, typer.Option(metavar="KIND", help="Another controller than the robot's own.")
    ] = "",
    assignments: SetOption = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer trials of each course.")] = False,
    trials: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="So many trials of each course.")
    ] = None,
    courses: Annotated[
        list[str] | None,
        typer.Option("--course", metavar="COURSE", help="Only this course. Repeat for several."),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where all goes; out/passport_ROBOT by default."),
    ] = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print passport.json instead of the table.")
    ] = False,
) -> None:
    """Measure what a robot passes, how surely, and at what cost; the same command goes on after an
    interruption."""
    from omnitrack_sim.towns.passport import FULL, PASSPORT_FILE, QUICK, run_passport

    name = plain(Path(robot).stem if Path(robot).suffix else robot.replace(":", "."))
    target = folder or Path("out") / f"passport_{name}{'_quick' if quick else ''}"
    options = worker_options(workers, dask)
    with trials_bar(f"passport {name}") as report:
        made = with_changes(
            lambda changes: run_passport(
                robot,
                controller=controller,
                changes=changes,
                trials=trials or (QUICK if quick else FULL),
                courses=courses,
                out=target,
                progress=report,
                **options,
            ),
            assignments,
        )
    summary = made.summary()
    if as_json:
        print_json(summary)
        return
    rows = []
    for row in summary["ways"]:
        low, high = row["success_95"]
        passes = f"{row['passed']} of {row['trials']}"
        stops = ", ".join(f"{n} {outcome}" for outcome, n in row["stopped_by"].items())
        rows.append([row["kind"], passes, f"{100 * low:.0f} to {100 * high:.0f} %", stops or "-"])
    print_table(["way", "passed", "95 %", "stopped"], rows)
    for course, why in made.misfits.items():
        out.say(f"{plain(course)}: does not fit: {plain(why)}")
    out.say(f"{plain(str(target / PASSPORT_FILE))}")
