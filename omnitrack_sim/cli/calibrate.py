"""calibrate: parameters of a scenario and its robot from logs of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.writing import check_file
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    JsonOption,
    SetOption,
    app,
    load,
    out,
    plain,
    print_json,
    print_saved,
    print_table,
    progress,
)


@app.command()
def calibrate(
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...",
            help="Logs of runs: CSV, Parquet or MCAP files whose columns have the names of the "
            "trajectory's, or tables in TOML that say which is which.",
        ),
    ],
    fit: Annotated[
        list[str],
        typer.Option(
            metavar="KEY,KEY",
            help="What is fitted, such as world.friction,robot.preload; KEY=LOW:HIGH gives the "
            "range. Repeat for several.",
            autocompletion=complete.settings,
        ),
    ],
    target: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE", help="File of the values, for --set @FILE; ends in .toml."
        ),
    ],
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="SCENARIO",
            help="Scenario of the runs: a file, or the name of a shipped one. A log's table may "
            "name its own.",
            autocompletion=complete.scenarios,
        ),
    ] = None,
    model_error: Annotated[
        float,
        typer.Option(
            metavar="PART",
            help="Part by which the model may be wrong in each log, beside noise.",
        ),
    ] = 0.01,
    assignments: SetOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fit parameters to logs of runs, and save them with their doubt and a page."""
    from omnitrack_sim.calibration.calibration import output_place

    check_file(output_place(target))
    ranges = dict(_range(text) for each in fit for text in each.split(","))
    base = None if scenario is None else load(scenario, assignments)
    if base is None and assignments:
        raise InputError(Fault("--set", "needs --scenario, whose values it overrides"))
    with progress("calibrate", quiet=as_json) as report:
        found = ot.calibrate(logs, base, ranges, model_error=model_error, progress=report)
    paths = found.save(target)
    if as_json:
        print_json(_summary(found))
        return
    _print(found)
    for path in paths:
        print_saved(path)


def _range(text: str) -> tuple[str, tuple[float, float] | None]:
    """Parse KEY or KEY=LOW:HIGH."""
    path, equals, within = (part.strip() for part in text.partition("="))
    if not path:
        raise InputError(Fault("--fit", f"is {text!r}; write KEY or KEY=LOW:HIGH"))
    if not equals:
        return path, None
    low, _, high = within.partition(":")
    try:
        return path, (float(low), float(high))
    except ValueError:
        problem = f"has the range {within!r}; write {path}=LOW:HIGH, such as {path}=0.3:1.2"
        raise InputError(Fault(f"--fit {path}", problem)) from None


def _summary(found: ot.Calibration) -> dict[str, object]:
    """Return a calibration for machines."""
    rows = zip(found.parameters, found.values.tolist(), found.std.tolist(), strict=True)
    return {
        "parameters": {
            one.path: {"value": value, "std": std, "unit": one.unit, "start": one.start}
            for one, value, std in rows
        },
        "covariance": found.covariance.tolist(),
        "indistinct": [
            {"weights": dict(one.weights), "doubt": one.doubt} for one in found.indistinct
        ],
        "contradictions": list(found.contradictions),
        "notes": list(found.notes),
        "columns": [
            {
                "log": one.log,
                "column": one.column,
                "unit": one.unit,
                "samples": len(one.time),
                "independent": one.independent,
                "rms": one.rms,
                "bias": one.bias,
                "noise": one.noise,
            }
            for one in found.columns
        ],
    }


def _print(found: ot.Calibration) -> None:
    """Print values with their doubt, and what the logs leave open and contradict."""
    rows = [
        (one.path, f"{value:.6g}", f"{std:.2g}", one.unit, f"{one.start:.6g}")
        for one, value, std in zip(found.parameters, found.values, found.std, strict=True)
    ]
    print_table(("parameter", "value", "std", "unit", "before"), rows)
    for text in found.contradictions:
        out.say(f"[yellow]contradicted:[/yellow] {plain(text)}")
    for one in found.indistinct:
        out.say(f"[yellow]open:[/yellow] {plain(one.text)}")
    for text in found.notes:
        out.say(plain(text))
