"""Groups of runs compared: elbows over the start orientation, and success rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.show.plots.style import ALARM, GREY, INK, new_figure, style
from omnitrack_sim.show.plots.success import PASSED_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.results.result import Result


SERIES_COLOURS = ("#2f6db3", "#d1591f", "#1c9a72", "#a8478f", "#22262b", "#b8901c")
_MARKERS = ("o", "s", "^", "D", "v", "P")


@style()
def elbow_figure(results: Mapping[str, Sequence[Result]]) -> Figure:
    """Compare controllers or robots in elbows over the start orientation.

    Args:
        results: the runs of each line, by the line's name.

    Returns:
        Four panels over theta5 at the start [deg]: tilt at the exit and largest tilt [deg], slip
        distance as the mean of the modules [mm], duration [s]. Runs that failed have hollow marks.
    """
    figure = new_figure((7.6, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    for axis, (label, value) in zip(axes.flat, _ELBOW_PANELS, strict=True):
        for k, (name, runs) in enumerate(results.items()):
            _series(axis, k, name, runs, value)
        axis.set_ylabel(label)
        # From zero, with room for the marks above the largest value.
        axis.set_ylim(bottom=0.0, top=max(1.06 * axis.get_ylim()[1], 1e-3))
        axis.locator_params(axis="y", nbins=7)
    for axis in axes[-1]:
        axis.set_xlabel("theta5 at the start [deg]")
    figure.align_ylabels()
    # Not by their labels: a name may begin with an underscore, which hides it.
    handles = list(axes[0, 0].lines)
    for face, label in ((GREY, "passed"), ("white", "failed")):
        mark: dict[str, Any] = {"ls": "none", "marker": "o", "mec": GREY, "ms": 5}
        # Lines without data: the legend's own.
        handles += axes[0, 0].plot([], [], mfc=face, label=label, **mark)
    figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 5))
    return figure


def _series(
    axis: Axes, k: int, name: str, runs: Sequence[Result], value: Callable[[Result], float]
) -> None:
    """Draw one line of ``elbow_figure``, in the order of theta5."""
    # The line joins neighbours in theta5, whatever the order of the runs.
    ordered = sorted(runs, key=lambda run: run.scenario.start.theta5_deg)
    colour, marker = SERIES_COLOURS[k % len(SERIES_COLOURS)], _MARKERS[k % len(_MARKERS)]
    theta5 = [run.scenario.start.theta5_deg for run in ordered]
    values = [value(run) for run in ordered]
    line: dict[str, Any] = {"color": colour, "lw": 1.0, "alpha": 0.8, "zorder": 2}
    # Marks on the line for the legend only: those of the panel are filled run by run.
    axis.plot(theta5, values, marker=marker, markevery=[], label=name, **line)
    faces = [colour if run.success else "white" for run in ordered]
    axis.scatter(theta5, values, s=26, marker=marker, fc=faces, ec=colour, lw=1.1, zorder=3)


def _mean(name: str, scale: float = 1.0) -> Callable[[Result], float]:
    """Return what reads a metric, averaged over the modules; NaN where it is missing."""

    def read(result: Result) -> float:
        value: Any = result.metrics[name]
        return math.nan if value is None else scale * float(np.mean(value))

    return read


_ELBOW_PANELS: tuple[tuple[str, Callable[[Result], float]], ...] = (
    ("tilt at the exit [deg]", _mean("tilt_exit_deg")),
    ("largest tilt [deg]", _mean("tilt_max_deg")),
    ("slip distance,\nmean of the modules [mm]", _mean("slip_distance_m", 1e3)),
    ("duration [s]", lambda result: result.duration_s),
)


@style()
def rates_figure(
    groups: Sequence[tuple[str, int, int]],
    reference: float | None = None,
    label: str = "success rate",
) -> Figure:
    """Compare rates of several groups of runs with their 95 % intervals (``wilson_interval``).

    Args:
        groups: (name, passed, total) of each bar, from the top.
        reference: a rate from 0 to 1, drawn as a dashed line.
        label: name of the rate; the axis shows it in %.
    """
    figure = new_figure((6.4, 1.2 + 0.42 * max(1, len(groups))), layout="constrained")
    axis = figure.subplots()
    for k, group in enumerate(groups):
        _bar(axis, k, *group[1:])
    axis.set_yticks(range(len(groups)), [name for name, _, _ in groups])
    # Downward: the first group stands at the top.
    axis.set_ylim(max(len(groups), 1) - 0.4, -0.6)
    axis.set_xlim(0, 100)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    if reference is not None:
        percent = 100 * reference
        axis.axvline(percent, color=ALARM, lw=1.1, ls=(0, (4, 2)), label="reference")
        above: dict[str, Any] = {"transform": axis.get_xaxis_transform(), "ha": "center"}
        axis.text(percent, 1.02, f"reference {percent:.2f} %", color=ALARM, size=8, **above)
    axis.set_xlabel(f"{label} [%], with 95 % interval")
    return figure


def _bar(axis: Axes, k: int, passed: int, total: int) -> None:
    """Draw the bar of group ``k``, with its interval as a whisker and its counts at the right."""
    percent, text = 0.0, "none tried"
    if total:
        percent = 100 * passed / total
        text = f"{percent:.1f} %  ({passed} of {total})"
        ends = [100 * end for end in wilson_interval(passed, total)]
        whisker: dict[str, Any] = {"color": INK, "lw": 1.1, "marker": "|", "ms": 7, "mew": 1.1}
        # Whiskers that end at 0 or 100 % are drawn whole.
        axis.plot(ends, [k, k], clip_on=False, **whisker)
    axis.barh(k, percent, height=0.56, color=PASSED_COLOUR, alpha=0.55, lw=0)
    axis.text(1.03, k, text, transform=axis.get_yaxis_transform(), va="center", color=INK)
