"""Names of the parts, placed where they cover neither each other nor the pipes nor the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.pipes import Assembly
from omnitrack_sim.plots.mission.layout import Layout
from omnitrack_sim.plots.network import middle, widest_view
from omnitrack_sim.plots.style import INK
from omnitrack_sim.rotations import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_names(
    axes: list[Axes], layout: Layout, renderer: Any, pipes: Assembly, way: Array
) -> None:
    """Write the name of each part into the view that shows most of the part.

    Args:
        axes: of the views.
        layout: of the figure.
        renderer: measures the text.
        pipes: the parts. Names keep off their bores where they can.
        way: (n, 3) m, points of the way driven; names keep off it.
    """
    pairs = [view.pair for view in layout.views]
    bores = np.concatenate([part.bore_samples() for part in pipes.parts])
    for part in pipes.parts:
        view = widest_view(part, pairs)
        axis, columns = axes[view], list(pairs[view])
        place = axis.transData.transform(middle(part)[columns])
        text = axis.text(0, 0, part.name, fontsize=7, color=INK, ha="center", va="center", zorder=6)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4})
        half = np.array(text.get_window_extent(renderer).size) / 2
        reach = _pixels(axis, part.fitting.radius)
        boxes = [
            np.array(other.get_window_extent(renderer).get_points())
            for other in axis.texts
            if other is not text
        ]
        covered = [
            (axis.transData.transform(points[:, columns]), worth)
            for points, worth in ((way, 20), (bores, 1))
        ]
        spots = place + _around(reach, half)
        costs = [_cost(spot, half, boxes, covered, axis) for spot in spots]
        x, y = axis.transData.inverted().transform(spots[int(np.argmin(costs))]).tolist()
        text.set_position((x, y))


def _pixels(axis: Axes, length: float) -> float:
    """A length in m, in pixels as it is drawn."""
    return float(np.ptp(axis.transData.transform([[0.0, 0.0], [length, 0.0]])[:, 0]))


def _around(reach: float, half: Array) -> Array:
    """Shifts (n, 2) pixels that put a box on or beside a disc.

    ``half`` (2,) is half the size of the box, ``reach`` the radius of the disc, pixels.
    """
    angle = np.radians([90, 270, 0, 180, 45, 135, 225, 315, 67, 113, 247, 293])
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.concatenate(
        [[[0.0, 0.0]], *(direction * (reach + half + gap) for gap in (4, 14, 26, 40))]
    )


def _cost(
    spot: Array, half: Array, boxes: list[Array], covered: list[tuple[Array, int]], axis: Axes
) -> float:
    """How bad a place for a name is, the smaller the better.

    By far the worst is to cover another name, then to stick out of the view, then to cover the way
    or a pipe. ``spot`` (2,) is the middle of the name and ``half`` (2,) half its size, pixels.
    """
    low, high = spot - half - (6, 2), spot + half + (6, 2)
    names = sum(bool((low < other[1]).all() and (high > other[0]).all()) for other in boxes)
    points = sum(worth * float(((p > low) & (p < high)).all(axis=1).sum()) for p, worth in covered)
    frame = axis.get_window_extent().get_points()
    outside = (low < frame[0]).any() or (high > frame[1]).any()
    return 1e6 * names + 1e5 * outside + points
