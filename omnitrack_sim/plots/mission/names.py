"""Names of the parts, placed where they cover neither each other nor the pipes nor the way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.pipes import Assembly
from omnitrack_sim.plots.mission.layout import Layout
from omnitrack_sim.plots.network import middle, named_parts, widest_view
from omnitrack_sim.plots.style import INK
from omnitrack_sim.rotations import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WAY, _BORE = 20, 1  # what it costs a name to cover a point of the way, or of a bore
_MARGIN = (6, 2)  # pixels that are kept free beside a name, and above and below it


def draw_names(
    axes: list[Axes], layout: Layout, renderer: Any, pipes: Assembly, way: Array
) -> None:
    """Write the name of each part of ``named_parts`` into the view that shows most of the part.

    Args:
        axes: of the views.
        layout: of the figure.
        renderer: measures the text.
        pipes: the parts. Names keep off their bores where they can.
        way: (n, 3) m, points of the way driven; names keep off it.
    """
    pairs = [view.pair for view in layout.views]
    bores = np.concatenate([part.bore_samples() for part in pipes.parts])
    crowds = [
        _Crowd(axis, renderer, [(way[:, pair], _WAY), (bores[:, pair], _BORE)])
        for axis, pair in zip(axes, map(list, pairs), strict=True)
    ]
    for part in named_parts(pipes):
        view = widest_view(part, pairs)
        place = middle(part)[list(pairs[view])]
        crowds[view].write(part.name, place, part.fitting.radius)


class _Crowd:
    """What a name may cover in one view: the names that stand there already, and points.

    Args:
        axis: of the view. renderer: measures the text.
        covered: points (n, 2) m, with what it costs to cover one of them.
    """

    def __init__(self, axis: Axes, renderer: Any, covered: list[tuple[Array, int]]) -> None:
        self.axis, self.renderer = axis, renderer
        self.frame: Array = axis.get_window_extent().get_points()
        self.boxes = [self._box(text) for text in axis.texts]
        self.costs = self._costs(covered)

    def write(self, name: str, place: Array, radius: float) -> None:
        """Write a name on or beside a disc of ``radius`` m at ``place`` (2,) m."""
        axis = self.axis
        text = axis.text(0, 0, name, fontsize=7, color=INK, ha="center", va="center", zorder=6)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4})
        half = np.ptp(self._box(text), axis=0) / 2
        spots = axis.transData.transform(place) + _around(_pixels(axis, radius), half)
        spot = spots[int(np.argmin(self._cost(spots, half)))]
        x, y = axis.transData.inverted().transform(spot).tolist()
        text.set_position((x, y))
        self.boxes.append(np.stack([spot - half, spot + half]))

    def _box(self, text: Any) -> Array:
        """Lower left and upper right corner (2, 2) of a text, pixels."""
        return text.get_window_extent(self.renderer).get_points()

    def _costs(self, covered: list[tuple[Array, int]]) -> Array:
        """What it costs to cover all pixels of the view below and to the left of a corner of
        pixels, so that a box of any size is looked up at its four corners."""
        size = np.ceil(np.ptp(self.frame, axis=0)).astype(int)
        sums = np.zeros(size + 1)
        for points, worth in covered:
            pixels = self.axis.transData.transform(points) - self.frame[0]
            inside = pixels[((pixels >= 0) & (pixels < size)).all(axis=1)].astype(int)
            np.add.at(sums, tuple(inside.T + 1), worth)
        return sums.cumsum(axis=0).cumsum(axis=1)

    def _corners(self, places: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The corners of pixels nearest to places (n, 2), as indices into ``costs``."""
        most = np.array(self.costs.shape) - 1
        x, y = np.clip(np.rint(places - self.frame[0]), 0, most).astype(np.intp).T
        return x, y

    def _cost(self, spots: Array, half: Array) -> Array:
        """How bad places for a name are (n,), the smaller the better.

        By far the worst is to cover another name, then to stick out of the view, then to cover the
        way or a pipe. ``spots`` (n, 2) are middles of the name, ``half`` (2,) half its size,
        pixels.
        """
        low, high = spots - half - _MARGIN, spots + half + _MARGIN
        boxes = np.array(self.boxes).reshape(-1, 2, 2)
        beside = (low[:, None] >= boxes[:, 1]) | (high[:, None] <= boxes[:, 0])
        names = (~beside.any(axis=-1)).sum(axis=-1)
        outside = ((low < self.frame[0]) | (high > self.frame[1])).any(axis=-1)
        (left, bottom), (right, top) = self._corners(low), self._corners(high)
        sums = self.costs
        points = sums[right, top] - sums[left, top] - sums[right, bottom] + sums[left, bottom]
        return 1e6 * names + 1e5 * outside + points


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
