"""Figure of a recording of any model: its way through the pipes, and its curves over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.record.display import Curve
from omnitrack_sim.show.plots.mission_figure import SHADES
from omnitrack_sim.show.plots.network_figure import draw_pipes, extent, frame_view
from omnitrack_sim.show.plots.run_figures import LEFT, RIGHT, PanelGrid, limits_of
from omnitrack_sim.show.plots.style import CURVE_COLOURS, INK, PAGE, headline, page
from omnitrack_sim.show.projection import aligned, bore_faces

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
"""Panels beside each other."""
_GAP, _BELOW, _TALLEST = 0.5, 0.6, 3.0  # inches between views, below them; largest height
_WAY = (0.82, 0.0, 0.42)


def plot_recording(
    *,
    path: Path | None,
    title: str,
    network: Assembly,
    time: Array,
    curves: Mapping[str, Curve],
    stays: Sequence[tuple[Part, int, int]],
) -> Figure:
    """Draw the figure of ``Recording.plot``.

    Args:
        path: file to write; None: nothing is written.
        title: above the figure.
        network: the pipes.
        time: (T,) s.
        curves: by name; ``position`` (T, 3) m is drawn into the pipes, too.
        stays: parts that the body was in, with first and last sample.
    """

    def draw() -> Figure:
        faces = bore_faces(network)
        low, high = extent(faces)
        elevation, _, plan = aligned(high - low)
        wide, deep, tall = (high - low)[[*plan.columns, 2]]
        width = (PAGE - LEFT - RIGHT - _GAP) / 2
        scale = min(width / wide, _TALLEST / max(tall, deep))  # inches a metre
        above = 0.3 + scale * max(tall, deep) + _BELOW
        grid = PanelGrid(-(-len(curves) // COLUMNS), COLUMNS, above)
        top = 1 - 0.38 / grid.height
        for number, view in enumerate((elevation, plan)):
            size = scale * np.array([wide, deep if number else tall])
            left = (LEFT + number * (width + _GAP) + (width - size[0]) / 2) / PAGE
            bottom = top - size[1] / grid.height
            box = (left, bottom, size[0] / PAGE, size[1] / grid.height)
            axis = grid.figure.add_axes(box)
            frame_view(axis, view, low, high)
            draw_pipes(axis, network, view, faces)
            flat = curves["position"].values[:, list(view.columns)]
            axis.plot(*flat.T, color=_WAY, lw=1.4, zorder=3)
            axis.plot(*flat[:1].T, "o", color=_WAY, mfc="white", ms=4, zorder=4)
        for number, curve in enumerate(curves.values()):
            last = number + COLUMNS >= len(curves)
            axis = grid.add(*divmod(number, COLUMNS), curve.display.label(), last)
            _draw_curve(axis, time, curve, stays)
        duration = f"{len(time)} samples, {time[-1] - time[0]:.2f} s"
        headline(grid.figure, title, duration, LEFT)
        return grid.figure

    return page(draw, path, None)


def _draw_curve(
    axis: Axes, time: Array, curve: Curve, stays: Sequence[tuple[Part, int, int]]
) -> None:
    """Draw one panel, with the parts as bands behind it."""
    display = curve.display
    for part, first, last in stays:
        colour = SHADES.get(part.fitting.kind, SHADES["straight"])
        axis.axvspan(time[first], time[last], color=colour, lw=0, zorder=0)
    shown = display.scale * curve.values
    for column, values in enumerate(shown.T):
        look: dict[str, Any] = {"color": INK}
        if curve.names:
            look = {"color": CURVE_COLOURS[column], "label": curve.names[column]}
        axis.plot(time, values, **look)
    if curve.names:
        axis.legend(fontsize=5.5, ncols=3, loc="best", handlelength=1.0, columnspacing=0.8)
    if len(time) > 1:
        axis.set_xlim(time[0], time[-1])
    limits = limits_of(display, shown)
    if limits is not None:
        axis.set_ylim(*limits)
