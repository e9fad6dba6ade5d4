"""A run, or two of them, as a page that plays them."""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.writing import check_file, format_of, write_file
from omnitrack_sim.results.result import Result
from omnitrack_sim.show.film.poses import sound
from omnitrack_sim.show.replay.alike import other_pipes
from omnitrack_sim.show.replay.packing import Pack

FORMATS = ("html",)
_Source = Result | str | os.PathLike[str]


@dataclass(frozen=True, repr=False)
class ReplayPage:
    """A page that plays a run; notebooks show it as it is.

    Attributes:
        html: the whole page. height: of the frame in a notebook, pixels.
    """

    html: str
    height: int = 640

    def __repr__(self) -> str:
        return f"ReplayPage({len(self.html)} characters)"

    def _repr_html_(self) -> str:
        style = f"width:100%;height:{self.height}px;border:1px solid #ccc"
        return f'<iframe srcdoc="{escape(self.html)}" style="{style}" allowfullscreen></iframe>'


def show_replay(result: _Source, compare: _Source | None = None) -> ReplayPage:
    """The page of ``write_replay`` for a notebook, which shows it and saves it with its outputs.

    Args:
        result: a ``Result``, or the folder of a saved one.
        compare: a second run through the same pipes.

    Raises:
        InputError: a second run through other pipes.
        RenderError: a run has no pose that can be shown.
        OutputError: a folder is no run.
    """
    from omnitrack_sim.results.result import as_result
    from omnitrack_sim.show.replay.page import page_of

    runs = [as_result(result)]
    if compare is not None:
        runs.append(as_result(compare))
        if problem := other_pipes(*runs):
            hint = "ot.compare(a, b) compares figures and scenarios of any two runs"
            raise InputError(Fault("compare", f"{problem}; {hint}"))
    return ReplayPage(page_of(replay_data(runs)))


def write_replay(result: _Source, path: str | Path, compare: _Source | None = None) -> Path:
    """Write a page that plays a run in a browser: one file, which needs no network.

    Args:
        result: a ``Result``, or the folder of a saved one.
        path: file to write, ``.html``.
        compare: a second run through the same pipes, shown as a translucent robot and as paler
            curves.

    Returns:
        The path.

    Raises:
        InputError: another ending, or a second run through other pipes.
        RenderError: a run has no pose that can be shown.
        OutputError: a folder is no run, or the file cannot be written.
    """
    format_of(path, None, "page", FORMATS)
    check_file(path)
    write_file(path, show_replay(result, compare).html.encode("utf-8"))
    return Path(path)


def replay_data(runs: list[Result]) -> dict[str, Any]:
    """All that the page knows of its runs, of which the first one brings the pipes."""
    from omnitrack_sim.show.replay.chart import map_table
    from omnitrack_sim.show.replay.curves import arrow_scales, panels_of
    from omnitrack_sim.show.replay.heading import HEADLINE, differences
    from omnitrack_sim.show.replay.scene import Shapes, follow_table, looks_model, pipes_table
    from omnitrack_sim.show.replay.seen import seen_table

    first, pack = runs[0], Pack()
    network, trajectory = first.pipes, sound(first.trajectory)
    shapes, model = Shapes(pack), looks_model(first.scenario, network)
    return {
        "runs": [_run_table(run, pack, shapes) for run in runs],
        "pipes": pipes_table(network, model, shapes),
        "follow": follow_table(first, trajectory, pack),
        "map": map_table(first),
        "seen": seen_table(first.album, trajectory),
        "panels": [dataclasses.asdict(panel) for panel in panels_of(first.trajectory)],
        "headline": HEADLINE,
        "arrows": arrow_scales(trajectory, first.scenario.robot.scale),
        "differences": differences(*runs) if len(runs) > 1 else [],
        "shapes": shapes.tables,
        "data": pack.text(),
    }


def _run_table(result: Result, pack: Pack, shapes: Any) -> dict[str, Any]:
    """What the page knows of one run, its robot included."""
    from omnitrack_sim.show.replay import curves
    from omnitrack_sim.show.replay.heading import heading_table
    from omnitrack_sim.show.replay.scene import TIME_STEP, looks_model, robot_table

    trajectory = sound(result.trajectory)
    model = looks_model(result.scenario)
    with np.errstate(invalid="ignore", over="ignore"):  # of physics that has diverged
        return {
            "heading": heading_table(result),
            "time": pack.steps(trajectory.time, TIME_STEP),
            "robot": robot_table(result, trajectory, model, pack, shapes),
            "curves": curves.curves_table(trajectory, pack),
            "phases": curves.phases_table(trajectory),
            "fittings": curves.fittings_table(trajectory, result.routes()),
            "events": curves.events_table(result),
            "notes": curves.notes(result),
        }
