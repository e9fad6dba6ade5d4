"""The figure of the benchmark of controllers: how many trials of each task each entry passed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from omnitrack_sim.base.text import clipped
from omnitrack_sim.record.channels import MODULE_COLOURS
from omnitrack_sim.show.plots.style import GREY, INK, PAGE, PAPER, TICKS, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ACROSS = 3
"""Panels beside each other."""
ROW, HEAD = 0.17, 0.62
"""Height of an entry, and of what a panel has beside them, inches."""
MARGIN = 3
"""Beside 0 and 100 %, so that a point there is whole."""
_LONGEST_NAME = 24


@dataclass(frozen=True)
class Bar:
    """One entry at one task: trials passed, trials in all, and the interval of the rate."""

    task: str
    entry: str
    passed: int
    trials: int
    interval: tuple[float, float]


def bench_figure(bars: Sequence[Bar]) -> Figure:
    """A panel for each task, with a row for each entry."""
    return styled(lambda: _figure(bars), PAPER)


def _figure(bars: Sequence[Bar]) -> Figure:
    tasks = list(dict.fromkeys(bar.task for bar in bars))
    entries = list(dict.fromkeys(bar.entry for bar in bars))
    across, down = min(len(tasks), ACROSS), math.ceil(len(tasks) / ACROSS)
    height = down * (HEAD + ROW * len(entries))
    figure = new_figure((PAGE, height), layout="constrained")
    panels = figure.subplots(down, across, sharex=True, sharey=True, squeeze=False).ravel()
    for panel, task in zip(panels, tasks, strict=False):
        _panel(panel, [bar for bar in bars if bar.task == task], entries)
        panel.set_title(task.replace("_", " "), loc="left")
    for panel in panels[len(tasks) :]:
        panel.set_axis_off()
    for panel in panels[max(len(tasks) - across, 0) : len(tasks)]:
        panel.set_xlabel("passed [%]")
        panel.tick_params(labelbottom=True)
    return figure


def _panel(panel: Axes, bars: Sequence[Bar], entries: Sequence[str]) -> None:
    for bar in bars:
        row = entries.index(bar.entry)
        colour = MODULE_COLOURS[1] if row == 0 else INK
        low, high = (100 * end for end in bar.interval)
        panel.plot((low, high), (row, row), color=colour, linewidth=1.4, solid_capstyle="butt")
        if bar.trials:
            rate = 100 * bar.passed / bar.trials
            panel.plot(rate, row, "o", color=colour, markersize=3.6, clip_on=False)
    default = next((bar for bar in bars if bar.entry == entries[0]), None)
    if default is not None and default.trials:
        rate = 100 * default.passed / default.trials
        panel.axvline(rate, color=MODULE_COLOURS[1], linewidth=0.6, linestyle=":")
    panel.set_xlim(-MARGIN, 100 + MARGIN)
    panel.set_ylim(len(entries) - 0.5, -0.5)
    panel.set_yticks(range(len(entries)), [clipped(name, _LONGEST_NAME) for name in entries])
    panel.tick_params(**TICKS)
    panel.grid(axis="y", visible=False)
    panel.spines["left"].set_color(GREY)
