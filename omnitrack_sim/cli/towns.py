"""passport, reach: what a robot passes, and where in a town it gets to."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    JsonOption,
    SetOption,
    app,
    assignment,
    out,
    plain,
    print_json,
    print_saved,
    print_table,
    progress,
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


@app.command()
def reach(
    source: Annotated[
        str,
        typer.Argument(
            metavar="NETWORK",
            help="A network file, or the name of a shipped one.",
            autocompletion=complete.networks,
        ),
    ],
    passport_file: Annotated[
        str,
        typer.Option(
            "--passport", metavar="FILE", help="Of the robot: a file, its folder, or a shipped one."
        ),
    ] = "omnitrack",
    launches: Annotated[
        list[str] | None,
        typer.Option(
            "--from", metavar="NODE", help="Opening: an open end or a fitting. Repeat for several."
        ),
    ] = None,
    openings: Annotated[
        int | None,
        typer.Option("--launches", metavar="N", min=1, help="Only the N best of the openings."),
    ] = None,
    friction: Annotated[
        str, typer.Option(metavar="LOW:HIGH", help="Range of the walls' friction.")
    ] = "0.6:0.9",
    battery: Annotated[
        float | None, typer.Option("--battery-wh", min=0, help="Without limit when not given.")
    ] = None,
    efficiency: Annotated[
        float, typer.Option(min=0.01, max=1, help="From the battery to mechanical work.")
    ] = 0.3,
    base_power: Annotated[
        float, typer.Option("--base-w", min=0, help="Power of what runs all the time, W.")
    ] = 5.0,
    tether: Annotated[
        float | None, typer.Option("--tether-m", min=0.001, help="Length; no tether without it.")
    ] = None,
    line: Annotated[
        list[str] | None,
        typer.Option("--tether", metavar="KEY=VALUE", help="weight, friction, stiffness, tension."),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where all goes; out/reach_NAME by default."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Map where a robot gets to in a network and back, how surely, at what cost, and what stops
    it."""
    from omnitrack_sim.base.reading import checked
    from omnitrack_sim.pipes.network import load_network
    from omnitrack_sim.robots.tail import Tether
    from omnitrack_sim.towns.passport import load_passport
    from omnitrack_sim.towns.reach import Supply, map_reach
    from omnitrack_sim.towns.reach_files import save_reach, summary_of

    keys = dict(assignment(text) for text in line or ())
    if keys and tether is None:
        raise InputError(Fault("--tether", "is for a tether; give its length, --tether-m"))
    drags = None
    if tether is not None:
        drags = checked(Tether, {"length": tether, **keys}, InputError)
    supply = Supply(math.inf if battery is None else battery, efficiency, base_power)
    measured, network = load_passport(passport_file), load_network(source)
    target = folder or Path("out") / f"reach_{Path(source).stem}"
    with progress(f"reach {Path(source).stem}", as_json) as report:
        made = map_reach(
            network,
            measured,
            launches or (),
            friction=_range(friction),
            supply=supply,
            tether=drags,
            openings=openings,
            progress=report,
        )
    paths = save_reach(made, target)
    summary = summary_of(made)
    if as_json:
        print_json(summary)
        return
    rows = [[row["opening"], f"{row['adds_m']:.4g} m"] for row in summary["openings"]]
    print_table(["opening", "adds there and back"], rows)
    print_table(
        ["stopped by", "length"], [[why, f"{length:.4g} m"] for why, length in summary["stops"]]
    )
    out.say(
        f"{made.expected_length:.4g} of {made.length:.4g} m expected to be reached, "
        f"{summary['expected_there_and_back_m']:.4g} m there and back"
    )
    for path in paths:
        print_saved(path)


def _range(text: str) -> tuple[float, float]:
    """Parse LOW:HIGH, or one number."""
    low, _, high = text.partition(":")
    try:
        return float(low), float(high or low)
    except ValueError:
        raise InputError(Fault("--friction", f"is {text!r}, not LOW:HIGH")) from None
