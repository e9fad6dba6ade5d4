"""scenarios, parameters, models: what the package comes with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from omnitrack_sim.base.errors import Fault, ScenarioError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import app, load, out, plain, print_json


@app.command()
def scenarios(
    as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False,
) -> None:
    """List the scenarios, sweeps, studies and networks of the package; `omnitrack run`, `sweep`,
    `optimise` and `network NAME` find them."""
    from omnitrack_sim.base.naming import (
        shipped_networks,
        shipped_scenarios,
        shipped_studies,
        shipped_sweeps,
    )

    kinds = {
        "scenario": shipped_scenarios(),
        "sweep": shipped_sweeps(),
        "study": shipped_studies(),
        "network": shipped_networks(),
    }
    told = {
        kind: {name: complete.comment(path) for name, path in files.items()}
        for kind, files in kinds.items()
    }
    if as_json:
        rows = dict(told.pop("scenario"))
        for folder, kind in (("sweeps", "sweep"), ("studies", "study"), ("networks", "network")):
            rows |= {f"{folder}/{name}": text for name, text in told[kind].items()}
        print_json(rows)
        return
    for title, found in told.items():
        table = Table(title, "what it shows", box=None, padding=(0, 2))
        for name, text in found.items():
            table.add_row(name, plain(text))
        out.print(table)


@app.command()
def parameters(
    scenario: Annotated[
        str | None,
        typer.Argument(
            help="Show the robot of this scenario instead of the default one.",
            autocompletion=complete.scenarios,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For machines.")] = False,
) -> None:
    """The robot's parameters with unit, range, provenance and source."""
    from omnitrack_sim.robots.omnitrack import Robot

    robot = load(scenario, None).robot if scenario else Robot()
    rows = robot.parameters()
    if as_json:
        print_json([vars(row) for row in rows])
        return
    columns = ("parameter", "value", "range", "unit", "provenance", "source")
    table = Table(*columns, box=None, padding=(0, 1))
    table.columns[0].overflow = "fold"
    for row in rows:
        value = f"{row.value:.6g}" if isinstance(row.value, float) else str(row.value)
        within = "" if row.within is None else "{:.6g} to {:.6g}".format(*row.within)
        table.add_row(row.name, plain(value), within, row.unit, row.provenance, plain(row.source))
    out.print(table)


@app.command()
def models(
    check: Annotated[
        bool, typer.Option("--check", help="Say which files differ; status 1 if any does.")
    ] = False,
    write: Annotated[bool, typer.Option("--write", help="Write the files.")] = False,
    root: Annotated[Path, typer.Option(help="Folder that holds models/ and assets/.")] = Path(),
) -> None:
    """Check or write the published MJCF models and meshes."""
    from omnitrack_sim.robots.omnitrack.published import check_models, write_models

    if check == write:
        raise ScenarioError(
            Fault("omnitrack models", "say one of --check and --write", ("--check", "--write"))
        )
    folders = root / "models", root / "assets"
    if write:
        out.print(f"wrote {len(write_models(*folders))} files below {root.resolve()}")
        return
    different = check_models(*folders)
    for name in different:
        out.print(f"differs: {name}")
    out.print(
        "models and assets are up to date" if not different else "run `omnitrack models --write`"
    )
    raise typer.Exit(1 if different else 0)
