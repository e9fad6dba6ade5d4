"""reproduce: the paper, claim by claim."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from omnitrack_sim.cli.common import app, out, plain, print_json, progress
from omnitrack_sim.errors import Fault, InputError


@app.command()
def reproduce(
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer orientations and trials: minutes.")
    ] = False,
    folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where the page goes.")
    ] = Path("out/reproduce"),
    format: Annotated[str, typer.Option(help="Of the files in figures/: svg, pdf or png.")] = "svg",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the claims instead of the table.")
    ] = False,
) -> None:
    """Reproduce the paper: claims.json and report.html. Exit status 1 if a claim fails."""
    from omnitrack_sim.plots import FORMATS
    from omnitrack_sim.reproduce import reproduce as reproduce_paper

    if format not in FORMATS:
        raise InputError(Fault("--format", f"is {format!r}", FORMATS, given=format))
    with progress("reproduce", as_json) as report:
        claims = reproduce_paper(folder, quick=quick, format=format, progress=report)
    failed = sum(not claim.holds for claim in claims)
    if as_json:
        print_json([claim.row() for claim in claims])
    else:
        table = Table("verdict", "claim", "measured", box=None, padding=(0, 2))
        for claim in claims:
            colour = "green" if claim.holds else "red"
            table.add_row(f"[{colour}]{claim.verdict}[/]", claim.id, plain(claim.measured))
        out.print(table)
        page = plain(str(folder / "report.html"))
        out.print(f"{len(claims) - failed} of {len(claims)} claims hold; {page}", soft_wrap=True)
    raise typer.Exit(1 if failed else 0)
