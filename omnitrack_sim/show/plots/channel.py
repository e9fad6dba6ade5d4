"""One channel of a run over time, in a figure of its own or beside others."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import clipped
from omnitrack_sim.record.channels import MODULE_COUNT, Vector
from omnitrack_sim.show.plots.panels import draw_panel, panel_of, phases_shown, shade
from omnitrack_sim.show.plots.style import COLUMN, GREY, PAPER, TICKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.channels import Channel
    from omnitrack_sim.results.result import Result

_SIZE = (COLUMN, 2.3)
_MOST_ACROSS = 4


def plot_channel(
    result: Result | str | os.PathLike[str],
    channel: str,
    path: str | Path | None = None,
    *,
    module: int | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """A channel of a run over time, with the phases shaded.

    A figure of its own is as wide as a column (3.5 inches) and has a legend. The lines have labels,
    so that ``ax.legend()`` names them elsewhere.

    Args:
        result: the run, or the folder of a saved one.
        channel: any recorded one (docs/reference/channels.md), also of a sensor of your own.
        path: file to write; none: nothing is written.
        module: 1 to 3, to show this one alone, with its command where there is one; none: all.
        ax: where to draw; none: in a figure of its own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: no such channel, module or format; ``path`` is given with ``ax``.
        OutputError: the file cannot be written, or the folder is no run.
    """
    from omnitrack_sim.results.result import as_result
    from omnitrack_sim.show.plots.picture import chart

    run = as_result(result)
    _check(run, channel, module)
    own = ax is None
    return chart(
        lambda axis: _draw(axis, run, channel, module, own), _SIZE, path, ax, format, PAPER
    )


def _check(result: Result, channel: str, module: int | None) -> None:
    schema = result.trajectory.schema
    if channel not in schema:
        raise InputError(Fault("channel", f"is {channel!r}", tuple(schema), str(channel)))
    modules = tuple(str(i + 1) for i in range(MODULE_COUNT))
    if module is not None and (str(module) not in modules or not _of_modules(schema[channel])):
        problem = f"is {module!r}" if _of_modules(schema[channel]) else f"{channel} has no modules"
        raise InputError(Fault("module", problem, modules if _of_modules(schema[channel]) else ()))


def _of_modules(channel: Channel) -> bool:
    """Whether a panel has one line a module."""
    counts = channel.name == "contact_count"
    return counts or (channel.shape == (MODULE_COUNT,) and not isinstance(channel, Vector))


def _draw(axis: Axes, result: Result, channel: str, module: int | None, own: bool) -> None:
    panel = panel_of(result.trajectory.schema[channel])
    shade(axis, result.trajectory)
    draw_panel(axis, panel, result.trajectory, module)
    axis.set_xlabel("time [s]")
    axis.set_ylabel(panel.label_of(module))
    if own:
        axis.tick_params(**TICKS)
        _legend(axis, result)


def _legend(axis: Axes, result: Result) -> None:
    """Lines above the chart, phases below it."""
    from matplotlib.patches import Patch

    shades: list[Any] = [
        Patch(fc=shade, ec=GREY, lw=0.4, label=clipped(name, 24))
        for name, shade in phases_shown(result.trajectory)
    ]
    lines = axis.get_legend_handles_labels()[0]
    legends: tuple[tuple[Any, list[Any]], ...] = (
        ("outside upper left", lines),
        ("outside lower left", shades),
    )
    for place, handles in legends:
        if handles:
            figure = axis.get_figure()
            figure.legend(  # type: ignore[union-attr]
                handles=handles, loc=place, ncols=_MOST_ACROSS, borderaxespad=0.4
            )
