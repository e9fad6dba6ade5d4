"""singularity, reproduce: the theory of the paper, and claims of robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    FolderOption,
    JsonOption,
    PlotOption,
    app,
    err,
    out,
    plain,
    print_json,
    print_saved,
    progress,
)
from omnitrack_sim.cli.word_table import WordTable

if TYPE_CHECKING:
    from omnitrack_sim.paper.claim import Finding


MAX_DEGREES = 1e6
"""Largest angle of an orientation or a roll, degrees."""


@app.command()
def singularity(
    pipe_diameter: Annotated[float, typer.Option(help="Inner diameter D, m.")] = 0.16,
    reach: Annotated[
        float | None,
        typer.Option(
            help="Robot axis to module surface, springs extended, m; the robot's if not given."
        ),
    ] = None,
    sector_deg: Annotated[
        float | None, typer.Option(help="Take the reach that gives this sector instead (inverse).")
    ] = None,
    turn_angle_deg: Annotated[float, typer.Option(help="Angle between run and branch.")] = 90.0,
    modules: Annotated[int, typer.Option(help="Number of equal modules.")] = 3,
    definition: Annotated[
        str, typer.Option(help="Definition of the region: ellipse, crotch or strip.")
    ] = "ellipse",
    contact_length: Annotated[
        float | None,
        typer.Option(help="Of a module, m, for the real geometry; the robot's if not given."),
    ] = None,
    bend_radius: Annotated[
        float | None,
        typer.Option(help="Arc of the robot's centre, m, for the real geometry; D/2 if not given."),
    ] = None,
    theta5_deg: Annotated[
        float | None,
        typer.Option(help="Also judge this orientation and plan the roll out of the region."),
    ] = None,
    roll_deg: Annotated[float, typer.Option(help="Roll of the modules now, for the plan.")] = 0.0,
    plot: PlotOption = None,
    figure: Annotated[
        str,
        typer.Option(help="Which one: all, sections, orientations, sector, definitions or map."),
    ] = "all",
    as_json: JsonOption = False,
) -> None:
    """Show the motion singularity region: sector, margin, success rate, real geometry, roll."""
    _check_output(plot, figure)
    for option, degrees in (("--theta5-deg", theta5_deg), ("--roll-deg", roll_deg)):
        if degrees is not None and not abs(degrees) <= MAX_DEGREES:
            problem = f"is {degrees:g}; it must lie between {-MAX_DEGREES:g} and {MAX_DEGREES:g}"
            raise InputError(Fault(option, problem))
    robot = {"modules": modules, "definition": definition, "contact_length": contact_length}
    options = robot | {"bend_radius": bend_radius, "reach": reach}
    case = _case(pipe_diameter / 2, math.radians(turn_angle_deg), sector_deg, options)
    orientation = None if theta5_deg is None else _orientation(case, theta5_deg, roll_deg)
    _report(case, orientation, plot, figure, as_json)


def _case(
    pipe_radius: float,
    turn_angle: float,
    sector_deg: float | None,
    options: dict[str, Any],
) -> ot.TurnCase:
    """Turn case, robot and tee; its reach is that given, or gives the sector ``sector_deg``."""
    from omnitrack_sim.robots.omnitrack.singularity import reach_from_sector

    # Options that are left out take the defaults of `TurnCase`, which are the robot's.
    fields = {name: value for name, value in options.items() if value is not None}
    case = ot.TurnCase(pipe_radius=pipe_radius, turn_angle=turn_angle, **fields)
    if sector_deg is None:
        return case
    if "reach" in fields:
        raise InputError(Fault("--reach, --sector-deg", "give one of the two"))
    sector = math.radians(sector_deg)
    reach = reach_from_sector(sector, pipe_radius, turn_angle, case.definition)
    return replace(case, reach=float(reach))


def _orientation(case: ot.TurnCase, theta5_deg: float, roll_deg: float) -> dict[str, Any]:
    """Verdict on one orientation, and the shortest roll to a safe one."""
    from omnitrack_sim.robots.omnitrack.control.roll_plan import Obstacle, plan_roll
    from omnitrack_sim.robots.omnitrack.singularity import is_singular

    theta5, roll = math.radians(theta5_deg), math.radians(roll_deg)
    # A module that rolls on the wall by phi turns the robot by -phi r / R.
    radius_ratio = ot.Omnitrack().lug_radius / case.pipe_radius
    plan = plan_roll(theta5, roll, case.best, case.margin, radius_ratio, modules=case.modules)
    return {
        "theta5_deg": theta5_deg,
        "roll_deg": roll_deg,
        "singular": bool(is_singular(theta5, case.sector, case.modules)),
        "plan": {
            "exists": bool(plan.exists),
            "reason": Obstacle(int(plan.obstacle)).text,
            "roll_change_deg": math.degrees(float(plan.change)),
            "roll_deg": math.degrees(float(plan.roll)),
            "theta5_deg": math.degrees(float(plan.theta5)),
            "belt_sign": int(plan.belt_sign),
        },
    }


def _report(
    case: ot.TurnCase,
    orientation: dict[str, Any] | None,
    plot: Path | None,
    figure: str,
    as_json: bool,
) -> None:
    """Write the figure if one is asked for, and print everything as a table or as JSON."""
    summary = case.summary()
    if orientation is not None:
        summary["orientation"] = orientation
    if plot is not None:
        ot.plot_singularity(case, path=plot, figure=figure)
    if as_json:
        print_json(summary)
    else:
        _print_singularity(summary)
        if plot is not None:
            print_saved(plot)


def _check_output(plot: Path | None, figure: str) -> None:
    """Refuse a figure that cannot be drawn or written, before anything is computed."""
    from omnitrack_sim.base.writing import check_file
    from omnitrack_sim.paper.region import FIGURES
    from omnitrack_sim.show.plots.style import figure_format

    # The place of the figure may be valid and the figure not: both are asked before any work.
    if figure not in ("all", *FIGURES):
        raise InputError(Fault("--figure", f"is {figure!r}", ("all", *FIGURES)))
    if plot is not None:
        figure_format(plot)
        check_file(plot)


def _print_singularity(summary: dict[str, Any]) -> None:
    real = summary["real_geometry"]
    out.say(
        f"pipe {1e3 * summary['pipe_diameter_m']:.1f} mm, reach {1e3 * summary['reach_m']:.3f} mm, "
        f"turn {summary['turn_angle_deg']:g} deg, {summary['modules']} modules, "
        f"best theta5 {summary['best_theta5_deg']:g} deg"
    )
    table = WordTable("region", "sector, deg", "margin, deg", "failure rate", "success rate")
    for name, rates in summary["definitions"].items():
        table.add_row(name, *_rates(rates), style="bold" if name == summary["definition"] else None)
    table.add_row(f"real, L = {1e3 * real['contact_length_m']:.0f} mm", *_rates(real))
    out.print(table)
    out.say(
        f"  real geometry: {100 * real['keeps_contact_rate']:.1f} % of the orientations keep all "
        f"modules on the wall (arc of {1e3 * real['bend_radius_m']:.0f} mm)"
    )
    if "orientation" in summary:
        _print_orientation(summary["orientation"])


def _rates(rates: dict[str, float]) -> list[str]:
    return [
        f"{rates['sector_deg']:.2f}",
        f"{rates['margin_deg']:.2f}",
        f"{rates['failure_rate']:.4f}",
        f"{rates['success_rate']:.4f}",
    ]


def _print_orientation(orientation: dict[str, Any]) -> None:
    plan = orientation["plan"]
    verdict = "[yellow]singular[/]" if orientation["singular"] else "[green]safe[/]"
    out.print(f"theta5 {orientation['theta5_deg']:g} deg: {verdict}")
    if not plan["exists"]:
        out.say(f"  no plan: {plan['reason']}")
    elif plan["roll_change_deg"] == 0:
        out.print("  no roll needed")
    else:
        out.say(
            f"  roll the modules by {plan['roll_change_deg']:.1f} deg to {plan['roll_deg']:.1f}: "
            "theta5 becomes "
            f"{plan['theta5_deg']:.2f} deg, and the belts then drive "
            f"{'forward' if plan['belt_sign'] > 0 else 'backward'} for a positive speed"
        )


COLOURS = {
    "HOLDS": "green",
    "CALIBRATED": "cyan",
    "CONTRADICTION": "yellow",
    "FAILS": "red",
    "STUDY": "dim",
}
"""Colours of the verdicts, by name."""


@app.command()
def reproduce(
    robot: Annotated[
        str,
        typer.Argument(
            help="Kind of the robot; the omnidirectional one, whose paper takes the longest, if "
            "left out. 'measured': measurements of several robots beside simulated values.",
            autocompletion=complete.reproduced,
        ),
    ] = "omnitrack",
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer orientations and trials: minutes.")
    ] = False,
    folder: FolderOption = None,
    format: Annotated[str, typer.Option(help="Format of figures/: svg, pdf or png.")] = "svg",
    as_json: JsonOption = False,
) -> None:
    """Measure what was published of a robot, or of several: claims.json and report.html.

    Exit status 1 if a verdict has changed.
    """
    from omnitrack_sim.paper.reproduce import reproduce as reproduce_robot
    from omnitrack_sim.show.plots.style import FORMATS

    # Refused before claims are measured, which takes minutes.
    if format not in FORMATS:
        raise InputError(Fault("--format", f"is {format!r}", FORMATS, given=format))
    ending = "" if robot == "omnitrack" else f"_{robot.rpartition(':')[2]}"
    folder = folder or Path(f"out/reproduce{ending}")
    with progress("reproduce", False) as report:
        findings = reproduce_robot(folder, robot=robot, quick=quick, format=format, progress=report)
    if as_json:
        print_json([finding.row() for finding in findings])
    else:
        _print_findings(findings, folder)
    for finding in findings:
        if finding.difference:
            mark = "[red]changed[/]" if finding.changed else "[yellow]not decided[/]"
            err.say(f"{mark}: {plain(finding.difference)}")
    # Only a changed verdict fails; one that few trials could not decide does not.
    raise typer.Exit(1 if any(finding.changed for finding in findings) else 0)


def _print_findings(findings: Sequence[Finding], folder: Path) -> None:
    """Print verdicts with measurements, reasons of claims that do not hold, and counts."""
    from omnitrack_sim.paper.claim import tally

    table = WordTable("verdict", "claim", "measured")
    table.columns[1].no_wrap = True
    for finding in findings:
        driven = f"\n[dim]{plain(finding.driven)}[/]" if finding.driven else ""
        measured = plain(finding.measurement.measured) + driven
        table.add_row(_verdict(finding), finding.claim.id, measured)
    out.print(table)
    for finding in findings:
        if finding.reason:
            out.say(f"{finding.claim.id}: {_verdict(finding)}. {plain(finding.reason)}")
    counts = ", ".join(f"{verdict}: {count}" for verdict, count in tally(findings).items())
    out.say(f"{counts}; {plain(str(folder / 'report.html'))}")


def _verdict(finding: Finding) -> str:
    return f"[{COLOURS[finding.verdict.name]}]{finding.label}[/]"
