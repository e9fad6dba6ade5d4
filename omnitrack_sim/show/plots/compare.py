"""Two runs in one figure, one upon the other."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import clipped
from omnitrack_sim.results.comparison import Comparison, compare, told
from omnitrack_sim.show.plots.grid import Grid
from omnitrack_sim.show.plots.panels import PANELS, limits_of
from omnitrack_sim.show.plots.style import PAGE, PAPER, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from omnitrack_sim.results.result import Result

WHOLE = ("distance", "tilt", "offset")
"""Channels of the robot, in the first row."""
EACH = ("normal_force", "motor_torque", "slip_ratio")
"""Channels of the modules, a row for each module."""
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "#86b7e8", "lw": 2.0},
    {"color": "#a33a0a", "lw": 0.8},
)
"""Run A broad and pale below run B, so that both are seen where they coincide."""
_GRID = Grid(rows=1 + 3, columns=3, above=0.78)
_LONGEST = 60
"""Characters of the name of a run."""


def plot_compare(
    a: Result | str | os.PathLike[str],
    b: Result | str | os.PathLike[str],
    path: str | Path | None = None,
    *,
    labels: Sequence[str] | None = None,
    format: str | None = None,
) -> Figure:
    """Two runs over time, as wide as a page (7.16 inches): distance, tilt and offset, and of each
    module normal force, torque and slip ratio. A disc marks the end of a run at its goal, a cross
    that of a run that failed.

    Args:
        a, b: the runs, or the folders of saved ones.
        path: file to write; none: the figure is returned and nothing is written.
        labels: what the two are called; none: by what their scenarios differ in.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Raises:
        InputError: no such format; there are not two labels.
        OutputError: the file cannot be written, or a folder is no run.
    """
    from omnitrack_sim.show.plots.picture import page

    found = compare(a, b)
    if labels is not None and (isinstance(labels, str) or len(labels) != 2):
        raise InputError(Fault("labels", f"are {labels!r}; give two, one for each run"))
    names = [str(label) for label in labels] if labels is not None else _labels(found)
    return page(lambda: styled(lambda: _draw(found, names), PAPER), path, format)


def _labels(found: Comparison) -> list[str]:
    """Names of two runs: the scenarios' where they differ, else the first value that does."""
    names = [run.scenario.name for run in (found.a, found.b)]
    if names[0] != names[1] or not found.values:
        return names
    first = found.values[0]
    unit = "" if first.unit in ("", "1") else f" {first.unit}"
    more = f" and {len(found.values) - 1} more" if len(found.values) > 1 else ""
    return [f"{first.name} = {told(value)}{unit}{more}" for value in (first.a, first.b)]


def _draw(found: Comparison, names: list[str]) -> Figure:
    from omnitrack_sim.show.plots.picture import Picture

    figure, runs = Picture(figsize=(PAGE, _GRID.height)), (found.a, found.b)
    end = max(float(run.trajectory.time[-1]) for run in runs)
    for column, (whole, each) in enumerate(zip(WHOLE, EACH, strict=True)):
        for row, channel in enumerate((whole, each, each, each)):
            panel, module = PANELS[channel], row or None
            axis = _GRID.add(figure, row, column, panel, module)
            values = [panel.values(run.trajectory) for run in runs]
            for run, look, drawn in zip(runs, LOOKS, values, strict=True):
                line = drawn[:, row - 1] if row else drawn
                mark = "o" if run.success else "X"
                last = [len(line) - 1]
                axis.plot(run.trajectory.time, line, marker=mark, markevery=last, ms=3.5, **look)
            if end > 0:
                axis.set_xlim(0.0, 1.02 * end)
            limits = limits_of(panel, np.concatenate(values))
            if limits is not None:
                axis.set_ylim(*limits)
    _head(figure, found, names)
    return figure


def _head(figure: Figure, found: Comparison, names: list[str]) -> None:
    from matplotlib.lines import Line2D

    handles = []
    for side, name, run, look in zip("AB", names, (found.a, found.b), LOOKS, strict=True):
        ended = f"{run.outcome.value.replace('_', ' ')} after {run.duration_s:.2f} s"
        label = f"{side}: {clipped(name, _LONGEST)}; {ended}"
        handles.append(
            Line2D([], [], label=label, marker="o" if run.success else "X", ms=3.5, **look)
        )
    same = found.a.scenario.name == found.b.scenario.name
    title = (
        found.a.scenario.name if same else f"{found.a.scenario.name} and {found.b.scenario.name}"
    )
    _GRID.title(figure, title, found.headline, True)
    _GRID.legend(figure, handles, 0.28)
