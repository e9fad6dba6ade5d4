"""compare: two saved runs beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli.common import app, out, plain, print_json

if TYPE_CHECKING:
    from omnitrack_sim.results.comparison import Comparison

TABLE_FILE, FIGURE_FILE = "comparison.json", "comparison.png"
"""What ``--out`` leaves in a folder."""
RunArgument = Annotated[
    Path, typer.Argument(metavar="RUN_DIR", help="A folder that `omnitrack run` wrote.")
]


@app.command()
def compare(
    a: RunArgument,
    b: RunArgument,
    target: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER_OR_FILE",
            help="A figure (.png, .pdf or .svg), or a folder for figure and table.",
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print everything as JSON instead of tables.")
    ] = False,
) -> None:
    """Compare two saved runs: scenarios, outcomes, metrics, and curves in one figure."""
    from omnitrack_sim.results.comparison import compare as compare_runs

    _check(target)
    found = compare_runs(a, b)
    if as_json:
        print_json(found.summary())
    else:
        _print(found)
    for path in _save(found, target):
        if not as_json:
            out.print(f"saved {plain(str(path))}", soft_wrap=True)


def _is_figure(target: Path) -> bool:
    from omnitrack_sim.show.plots.style import FORMATS

    return target.suffix[1:].lower() in FORMATS and not target.is_dir()


def _check(target: Path | None) -> None:
    """Refuse places that cannot be written, before anything is read."""
    from omnitrack_sim.base.writing import check_file, check_folder
    from omnitrack_sim.show.plots.style import FORMATS

    if target is not None and _is_figure(target):
        check_file(target)
    elif target is not None:
        if target.suffix and not target.is_dir():
            problem = f"no figure ends in {target.suffix}, and a new folder has no ending"
            endings = tuple(f".{format}" for format in FORMATS)
            raise InputError(Fault(f"--out {target}", problem, endings))
        check_folder(target)


def _save(found: Comparison, target: Path | None) -> list[Path]:
    """Write what ``--out`` asks for; returns the files written."""
    import io

    from omnitrack_sim.base.text import strict_json
    from omnitrack_sim.base.writing import write_files
    from omnitrack_sim.show.plots.compare import plot_compare
    from omnitrack_sim.show.plots.style import save_figure

    if target is None:
        return []
    figure = plot_compare(found.a, found.b)
    if _is_figure(target):
        save_figure(figure, target)
        return [target]
    picture = io.BytesIO()
    save_figure(figure, picture, "png")
    table = strict_json(found.summary()) + "\n"
    files = {target / TABLE_FILE: table.encode(), target / FIGURE_FILE: picture.getvalue()}
    return write_files(files)


def _print(found: Comparison) -> None:
    from omnitrack_sim.results.comparison import figure_row, value_row

    for side, run in (("A", found.a), ("B", found.b)):
        colour = "green" if run.success else "yellow"
        ended = f"[bold {colour}]{run.outcome.value}[/] after {run.duration_s:.2f} s"
        out.print(f"{side}  {plain(run.scenario.name)}: {ended}", soft_wrap=True)
        out.print(f"   {plain(run.reason)}", soft_wrap=True)
    if found.values:
        _table(("scenario value", "unit", "A", "B"), map(value_row, found.values))
    else:
        out.print("the scenarios are the same", soft_wrap=True)
    changed = [one for one in found.figures if one.differs]
    if changed:
        _table(("figure", "unit", "A", "B", "B - A"), map(figure_row, changed))
    else:
        out.print("all figures are the same", soft_wrap=True)


def _table(heads: tuple[str, ...], rows) -> None:
    table = Table(box=None, padding=(0, 2))
    for head in heads:
        numbers = head in ("A", "B", "B - A")
        table.add_column(head, justify="right" if numbers else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(plain, row))
    out.print(table)
