"""replay: a page that plays a saved run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.cli.common import app, out, plain

PAGE = "replay.html"
"""Name of the page in the folder of its run."""


@app.command()
def replay(
    run_dir: Annotated[
        Path, typer.Argument(metavar="RUN_DIR", help="A folder that `omnitrack run` wrote.")
    ],
    compare: Annotated[
        Path | None,
        typer.Option(
            metavar="RUN_DIR2",
            help="A second run through the same pipes, shown as a translucent robot.",
        ),
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help=f"A .html; RUN_DIR/{PAGE} when not given."),
    ] = None,
) -> None:
    """Write a page that plays a saved run in any browser, without a network."""
    from omnitrack_sim.results.result import load_result
    from omnitrack_sim.show.replay import write_replay
    from omnitrack_sim.show.replay.alike import other_pipes

    result = load_result(run_dir)  # before the place of the page, which may be in its folder
    other = None if compare is None else load_result(compare)
    if other is not None and (problem := other_pipes(result, other)):
        hint = "compares figures and scenarios of any two runs"
        told = f"{problem}; `omnitrack compare {run_dir} {compare}` {hint}"
        raise InputError(Fault(f"--compare {compare}", told))
    target = write_replay(result, file or run_dir / PAGE, compare=other)
    out.print(f"saved {plain(str(target))}", soft_wrap=True)
