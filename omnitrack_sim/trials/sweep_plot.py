"""Success over the axes of a sweep, as a figure or in one's own."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import counted
from omnitrack_sim.show.plots.style import chart, page
from omnitrack_sim.show.plots.success import CHART, Spread, draw_chart, groups_of
from omnitrack_sim.trials.run import TrialsResult
from omnitrack_sim.trials.saved_sweep import as_sweep_result
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_figure import figure_of, spreads
from omnitrack_sim.trials.table import passed_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot_sweep(
    result: TrialsResult | str | os.PathLike[str],
    path: str | Path | None = None,
    *,
    over: str | Sequence[str] | None = None,
    ax: Axes | None = None,
    format: str | None = None,
    trust: bool = False,
) -> Figure:
    """Plot success over the axes of a sweep.

    Args:
        result: of a sweep, all trials; or the folder of a finished one.
        path: file to write; none: the figure is returned and nothing is written.
        over: one axis of the sweep for the rates over it with Wilson 95 % intervals, or two that
            are numbers for a map; none: as in a sweep's folder (docs/how-to/sweeps.md).
        ax: where to draw one chart; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.
        trust: of a folder, see ``load_sweep_result``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: trials are missing; no such axis or format; ``ax`` is given, and the sweep has
            more axes than one chart can show; ``path`` is given with ``ax``.
        OutputError: the file cannot be written, or the folder holds no sweep.

    Example:
        >>> result = ot.run_trials(ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01}))
        >>> figure = ot.plot_sweep(result)
    """
    result = as_sweep_result(result, trust)
    sweep = check_is(Sweep, "result.plan", result.plan)
    if result.table.num_rows != sweep.size:
        problem = f"has {result.table.num_rows} of {counted(sweep.size, 'trial')} of {sweep.name!r}"
        raise InputError(Fault("result", problem))
    passed = passed_of(result.table)
    if over is None and ax is None:
        return page(lambda: figure_of(sweep, result.table), path, format)
    axes = spreads(sweep, result.table)
    chosen, groups = _chosen(axes, over), groups_of(axes)
    return chart(lambda axis: draw_chart(axis, chosen, passed, groups), CHART, path, ax, format)


def _chosen(axes: list[Spread], over: str | Sequence[str] | None) -> list[Spread]:
    """Axes of one chart, by their names; all where none are named."""
    by_name = {spread.name: spread for spread in axes}
    names = list(by_name) if over is None else [over] if isinstance(over, str) else [*over]
    for name in names:
        if name not in by_name:
            raise InputError(Fault("over", f"is {name!r}", tuple(by_name), str(name)))
    chosen = [by_name[name] for name in names]
    if len(chosen) not in (1, 2) or (len(chosen) == 2 and any(one.order for one in chosen)):
        problem = "name one axis, or two of numbers, for one chart"
        raise InputError(Fault("over", problem, tuple(by_name)))
    return chosen
