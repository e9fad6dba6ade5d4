"""Controllers or robots compared in elbows over the start orientation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.show.plots.style import GREY, styled

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
    from omnitrack_sim.show.plots.picture import Picture

    def draw() -> Figure:
        figure = Picture(figsize=(7.6, 5.2), layout="constrained")
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
