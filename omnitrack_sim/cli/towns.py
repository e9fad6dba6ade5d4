"""passport, reach: what a robot passes, and where in a town it gets to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    CalibrationOption,
    FolderOption,
    JsonOption,
    NetworkArgument,
    SetOption,
    TrustOption,
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
from omnitrack_sim.cli.trials import (
    BatchOption,
    CoursesOption,
    DaskOption,
    ListOption,
    QuickOption,
    TrialsOption,
    WorkersOption,
    print_extent,
    trials_bar,
    worker_options,
)

MAX_BORES = 8
"""Bores that the terminal shows."""


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
    calibration: CalibrationOption = None,
    quick: QuickOption = False,
    trials: TrialsOption = None,
    courses: CoursesOption = None,
    folder: FolderOption = None,
    workers: WorkersOption = None,
    dask: DaskOption = None,
    batch: BatchOption = None,
    only_list: ListOption = False,
    as_json: JsonOption = False,
) -> None:
    """Measure what a robot passes, how surely, and at what cost.

    The same command resumes after an interruption.
    """
    from omnitrack_sim.towns.passport import PASSPORT_FILE
    from omnitrack_sim.towns.passport_plan import FULL, QUICK
    from omnitrack_sim.trials.mobility import BATCH

    name = plain(Path(robot).stem if Path(robot).suffix else robot.replace(":", "."))
    target = folder or Path("out") / f"passport_{name}{'_quick' if quick else ''}"
    options = worker_options(workers, dask)
    drawn = None if calibration is None else ot.load_calibration(calibration)
    plan = with_changes(
        lambda changes: ot.PassportPlan.of(
            robot,
            controller=controller,
            changes=changes,
            trials=trials or (QUICK if quick else FULL),
            courses=courses,
            batch=batch or BATCH,
            calibration=drawn,
        ),
        assignments,
    )
    if only_list:
        _print_passport(plan)
        print_extent(plan, target, workers)
        return
    with trials_bar(f"passport {name}") as report:
        summary = ot.run_trials(plan, out=target, progress=report, **options).summary
    if as_json:
        print_json(summary)
        return
    _print_ways(summary)
    out.say(f"{plain(str(target / PASSPORT_FILE))}")


def _print_passport(plan: ot.PassportPlan) -> None:
    """Print the courses of a passport, and those that the robot does not fit."""
    rows = [(name, str(plan.trials)) for name in plan.sweep.bases]
    print_table(("course", "trials"), rows)
    for course, why in plan.misfits.items():
        out.say(f"{plain(course)}: does not fit: {plain(why)}")


def _print_ways(summary: dict[str, Any]) -> None:
    """Print success rates by kind of fitting, and the courses that a robot does not fit."""
    rows = []
    for row in summary["ways"]:
        low, high = row["success_95"]
        passes = f"{row['passed']} of {row['trials']}"
        stops = ", ".join(f"{n} {outcome}" for outcome, n in row["stopped_by"].items())
        rows.append([row["kind"], passes, f"{100 * low:.0f} to {100 * high:.0f} %", stops or "-"])
    print_table(["way", "passed", "95 %", "stopped"], rows)
    for course, why in summary["misfits"].items():
        out.say(f"{plain(course)}: does not fit: {plain(why)}")


@app.command()
def reach(
    source: Annotated[str, NetworkArgument],
    passport_file: Annotated[
        str | None,
        typer.Option(
            "--passport",
            metavar="FILE",
            help="Of the robot: a file, its folder, or a shipped name; the default robot's if left "
            "out.",
        ),
    ] = None,
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
        float | None,
        typer.Option("--battery-wh", min=0, help="Energy of the battery; unlimited by default."),
    ] = None,
    efficiency: Annotated[
        float, typer.Option(min=0.01, max=1, help="Mechanical work over energy of the battery.")
    ] = 0.3,
    base_power: Annotated[
        float, typer.Option("--base-w", min=0, help="Power of what runs all the time, W.")
    ] = 5.0,
    tether: Annotated[
        float | None,
        typer.Option("--tether-m", min=0.001, help="Length of a tether; none by default."),
    ] = None,
    line: Annotated[
        list[str] | None,
        typer.Option("--tether", metavar="KEY=VALUE", help="weight, friction, stiffness, tension."),
    ] = None,
    folder: FolderOption = None,
    as_json: JsonOption = False,
    trust: TrustOption = False,
) -> None:
    """Map where a robot gets to in a network, at what cost, and what stops it."""
    from omnitrack_sim.robots.kinds import DEFAULT
    from omnitrack_sim.towns.reach_files import summary_of

    supply = ot.Supply(math.inf if battery is None else battery, efficiency, base_power)
    measured = ot.load_passport(passport_file or DEFAULT, trust=trust)
    network = ot.load_network(source, trust=trust)
    target = folder or Path("out") / f"reach_{Path(source).stem}"
    with progress(f"reach {Path(source).stem}", as_json) as report:
        made = ot.map_reach(
            network,
            measured,
            launches or (),
            friction=_range(friction),
            supply=supply,
            tether=_tether(tether, line or ()),
            openings=openings,
            progress=report,
        )
    paths = ot.save_reach(made, target)
    summary = summary_of(made)
    if as_json:
        print_json(summary)
        return
    _print_reach(summary)
    for path in paths:
        print_saved(path)


def _tether(length: float | None, keys: Sequence[str]) -> ot.Tether | None:
    """Return the tether of the options; None without a length."""
    from omnitrack_sim.base.reading import checked

    if length is not None:
        return checked(ot.Tether, {"length": length, **dict(map(assignment, keys))}, InputError)
    if keys:
        raise InputError(Fault("--tether", "is for a tether; give its length, --tether-m"))
    return None


def _print_reach(summary: dict[str, Any]) -> None:
    """Print the length that each opening adds, and the causes that stop the robot."""
    from omnitrack_sim.towns.reach_files import length_text

    rows = [[row["opening"], length_text(row["adds_m"])] for row in summary["openings"]]
    print_table(["opening", "adds there and back"], rows)
    print_table(
        ["stopped by", "length"], [[why, length_text(length)] for why, length in summary["stops"]]
    )
    shown, rest = summary["bores"][:MAX_BORES], len(summary["bores"]) - MAX_BORES
    rows = [
        [
            f"{1e3 * row['bore_m']:.1f} mm",
            *(length_text(row[key]) for key in ("length_m", "expected_m")),
            f"{row['scale']:.3f}",
            length_text(row["net_m"]),
        ]
        for row in shown
    ]
    print_table(["bore", "length", "reached", "scale", "net at that scale"], rows)
    if rest > 0:
        out.say(f"and {rest} more bores, in reach.json")
    best = max(summary["bores"], key=lambda row: row["net_m"])
    out.say(
        f"by bores alone a robot made for {1e3 * best['bore_m']:.1f} mm, at scale "
        f"{best['scale']:.3f} of this one, would reach most: a net of {length_text(best['net_m'])}"
    )
    keys = ("expected_m", "length_m", "expected_there_and_back_m")
    expected, whole, back = (length_text(summary[key]) for key in keys)
    out.say(f"{expected} of {whole} expected to be reached, {back} there and back")


def _range(text: str) -> tuple[float, float]:
    """Parse LOW:HIGH, or one number."""
    low, _, high = text.partition(":")
    try:
        return float(low), float(high or low)
    except ValueError:
        raise InputError(Fault("--friction", f"is {text!r}, not LOW:HIGH")) from None
