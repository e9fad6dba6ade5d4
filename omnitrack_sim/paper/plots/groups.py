"""Controllers or robots compared in elbows over the start orientation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.show.plots.style import ALARM, GREY, INK, styled
from omnitrack_sim.show.plots.success_figure import PASSED_COLOUR

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.results.result import Result


SERIES_COLOURS = ("#2f6db3", "#d1591f", "#1c9a72", "#a8478f", "#22262b", "#b8901c")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_MM = 1e3


def elbow_figure(results: Mapping[str, Sequence[Result]]) -> Figure:
    """Controllers or robots compared in elbows over the start orientation.

    Args:
        results: the runs of each line, by the line's name.

    Returns:
        Four panels over theta5 at the start [deg]: tilt at the exit and largest tilt [deg], slip
        distance as the mean of the modules [mm], duration [s]. Runs that failed have hollow marks.
    """
    from omnitrack_sim.show.plots.style import new_figure

    def draw() -> Figure:
        figure = new_figure((7.6, 5.2), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True)
        for axis, (label, value) in zip(axes.flat, _ELBOW_PANELS, strict=True):
            for k, runs in enumerate(results.values()):
                _series(axis, k, runs, value)
            axis.set_ylabel(label)
            _from_zero(axis)
            axis.locator_params(axis="y", nbins=7)
        for axis in axes[-1]:
            axis.set_xlabel("theta5 at the start [deg]")
        figure.align_ylabels()
        _series_legend(figure, list(results))
        return figure

    return styled(draw)


def _from_zero(axis: Axes) -> None:
    """Start the y range at zero, with room for the marks above the largest value."""
    axis.set_ylim(bottom=0.0, top=max(1.06 * axis.get_ylim()[1], 1e-3))


def _series(axis: Axes, k: int, runs: Sequence[Result], value: Callable[[Result], float]) -> None:
    """Draw one line of ``elbow_figure``, in the order of theta5."""
    # The line joins neighbours in theta5, whatever the order of the runs.
    ordered = sorted(runs, key=lambda run: run.scenario.start.theta5_deg)
    colour, marker = SERIES_COLOURS[k % len(SERIES_COLOURS)], _MARKERS[k % len(_MARKERS)]
    theta5 = [run.scenario.start.theta5_deg for run in ordered]
    values = [value(run) for run in ordered]
    axis.plot(theta5, values, color=colour, lw=1.0, alpha=0.8, zorder=2)
    faces = [colour if run.success else "white" for run in ordered]
    axis.scatter(theta5, values, s=26, marker=marker, fc=faces, ec=colour, lw=1.1, zorder=3)


def _series_legend(figure: Figure, names: Sequence[str]) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D(
            [],
            [],
            color=SERIES_COLOURS[k % len(SERIES_COLOURS)],
            marker=_MARKERS[k % len(_MARKERS)],
            label=name,
        )
        for k, name in enumerate(names)
    ]
    for face, label in ((GREY, "passed"), ("white", "failed")):
        handles.append(Line2D([], [], ls="none", marker="o", mfc=face, mec=GREY, ms=5, label=label))
    figure.legend(handles=handles, loc="outside upper left", ncols=min(len(handles), 5))


def _number(result: Result, name: str) -> float:
    """A metric, averaged over the modules if it has three values; NaN where it is missing."""
    value: Any = result.metrics[name]
    return math.nan if value is None else float(np.mean(value))


_ELBOW_PANELS: tuple[tuple[str, Callable[[Result], float]], ...] = (
    ("tilt at the exit [deg]", lambda result: _number(result, "tilt_exit_deg")),
    ("largest tilt [deg]", lambda result: _number(result, "tilt_max_deg")),
    (
        "slip distance,\nmean of the modules [mm]",
        lambda result: _MM * _number(result, "slip_distance_m"),
    ),
    ("duration [s]", lambda result: result.duration_s),
)


_DASHES: Any = (0, (4, 2))


def rates_figure(
    groups: Sequence[tuple[str, int, int]],
    reference: float | None = None,
    label: str = "success rate",
) -> Figure:
    """Rates of several groups of runs with their 95 % intervals (``statistics.wilson_interval``).

    Args:
        groups: (name, passed, total) of each bar, from the top.
        reference: a rate from 0 to 1, drawn as a dashed line.
        label: what the rate is; the axis shows it in %.
    """
    from omnitrack_sim.show.plots.style import new_figure

    def draw() -> Figure:
        figure = new_figure((6.4, 1.2 + 0.42 * max(1, len(groups))), layout="constrained")
        axis = figure.subplots()
        _bars(axis, groups)
        if reference is not None:
            _reference(axis, 100 * reference)
        axis.set_xlabel(f"{label} [%], with 95 % interval")
        return figure

    return styled(draw)


def _bars(axis: Axes, groups: Sequence[tuple[str, int, int]]) -> None:
    """One bar for each group, with its interval as a whisker and its counts at the right."""
    for k, (_, passed, total) in enumerate(groups):
        rate = passed / total if total else 0.0
        low, high = wilson_interval(passed, total)
        axis.barh(k, 100 * rate, height=0.56, color=PASSED_COLOUR, alpha=0.55, lw=0)
        if total:
            axis.plot(
                [100 * low, 100 * high],
                [k, k],
                color=INK,
                lw=1.1,
                marker="|",
                ms=7,
                mew=1.1,
                # Whiskers that end at 0 or 100 % are drawn whole.
                clip_on=False,
            )
        text = f"{100 * rate:.1f} %  ({passed} of {total})" if total else "none tried"
        axis.text(1.03, k, text, transform=axis.get_yaxis_transform(), va="center", color=INK)
    axis.set_yticks(range(len(groups)), [name for name, _, _ in groups])
    # Downward: the first group stands at the top.
    axis.set_ylim(max(len(groups), 1) - 0.4, -0.6)
    axis.set_xlim(0, 100)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")


def _reference(axis: Axes, percent: float) -> None:
    axis.axvline(percent, color=ALARM, lw=1.1, ls=_DASHES, label="reference")
    text = f"reference {percent:.2f} %"
    axis.text(
        percent, 1.02, text, transform=axis.get_xaxis_transform(), ha="center", color=ALARM, size=8
    )
