"""reproduce: the paper, claim by claim."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli.common import app, err, out, plain, print_json, progress

if TYPE_CHECKING:
    from omnitrack_sim.paper.claim import Claim

COLOURS = {"HOLDS": "green", "CONTRADICTION": "yellow", "FAILS": "red", "STUDY": "dim"}
"""Of the verdicts, by name."""


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
    """Reproduce the paper: claims.json and report.html. Exit status 1 if a verdict has changed."""
    from omnitrack_sim.paper.command import reproduce as reproduce_paper
    from omnitrack_sim.show.plots import FORMATS

    if format not in FORMATS:
        raise InputError(Fault("--format", f"is {format!r}", FORMATS, given=format))
    with progress("reproduce", False) as report:
        claims = reproduce_paper(folder, quick=quick, format=format, progress=report)
    if as_json:
        print_json([claim.row() for claim in claims])
    else:
        _print_claims(claims, folder)
    for claim in claims:
        if claim.difference:
            mark = "[red]changed[/]" if claim.changed else "[yellow]not decided[/]"
            err.print(f"{mark}: {plain(claim.difference)}", soft_wrap=True)
    raise typer.Exit(1 if any(claim.changed for claim in claims) else 0)


def _print_claims(claims: Sequence[Claim], folder: Path) -> None:
    """The verdicts and what they follow from, then why some claims do not hold, then counts."""
    from omnitrack_sim.paper.claim import tally

    table = Table("verdict", "claim", "measured", box=None, padding=(0, 2))
    table.columns[1].no_wrap = True
    for claim in claims:
        table.add_row(_verdict(claim), claim.id, plain(claim.measured))
    out.print(table)
    for claim in claims:
        if claim.reason:
            out.print(f"{claim.id}: {_verdict(claim)}. {plain(claim.reason)}", soft_wrap=True)
    counts = ", ".join(f"{verdict}: {count}" for verdict, count in tally(claims).items())
    out.print(f"{counts}; {plain(str(folder / 'report.html'))}", soft_wrap=True)


def _verdict(claim: Claim) -> str:
    return f"[{COLOURS[claim.verdict.name]}]{claim.told}[/]"
