"""Names of the parts of a map: on their part or right beside it, where they cover neither each
other nor other pipes nor the way; with a line to their part where there is room only further away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.show.plots.style import GREY, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WAY, _PIPE = 20, 1  # what it costs a name to cover a point of the way, or of a pipe
_SHIFT, _FAR = 3.0, 6.0  # what a point (1/72 inch) along the part costs, and one away from it
_GAPS = np.array([0.7, 2.5, 5.0, 8.0, 13.0])
"""How far beside its part a name may stand, points."""
_TIED = 3.5
"""From which gap on a line ties it to the part, points."""
_MARGIN = np.array([1.8, 0.3])  # points that are kept free beside a name, and above and below it
_ANCHORS = (0.5, 0.35, 0.65, 0.2, 0.8)
"""Places along a part where its name may stand, as parts of its length."""


def draw_names(
    axes: Sequence[Axes],
    pairs: Sequence[tuple[int, int]],
    renderer: Any,
    pipes: Assembly,
    parts: Sequence[Part],
    way: Array,
    size: float,
) -> None:
    """Write the name of each part into the view that shows most of it.

    Args:
        axes: of the views, with their limits and places.
        pairs: world axes to the right and up of each view.
        renderer: measures the text.
        pipes: all pipes; names keep off their bores where they can.
        parts: those to be named.
        way: (n, 3) m, points that names keep off above all: the way driven, marks.
        size: of the letters, points.
    """
    bores = np.concatenate([part.bore_samples() for part in pipes.parts])
    crowds = [
        _Crowd(axis, list(pair), renderer, way, bores, size)
        for axis, pair in zip(axes, pairs, strict=True)
    ]
    for part in parts:
        crowds[widest_view(part, pairs)].write(part)


def widest_view(part: Part, pairs: Sequence[tuple[int, int]]) -> int:
    """Index of the view, of ``pairs`` of world axes, that shows most of a part."""
    points = np.concatenate(
        [line.at(np.linspace(0, line.length, 9))[0] for line, _, _ in part.axes]
    )
    sizes = [np.ptp(points[:, list(pair)], axis=0) + part.fitting.largest_radius for pair in pairs]
    return int(np.argmax([np.prod(size) for size in sizes]))


class _Crowd:
    """What a name may cover in one view: the names that stand there already, pipes and the way."""

    def __init__(
        self, axis: Axes, columns: list[int], renderer: Any, way: Array, bores: Array, size: float
    ) -> None:
        self.axis, self.columns, self.renderer, self.size = axis, columns, renderer, size
        self.point = float(renderer.points_to_pixels(1.0))
        self.frame: Array = axis.get_window_extent().get_points()
        self.boxes = [self._box(text) for text in axis.texts if text.get_text()]
        self.way = self._covered(way[:, columns])
        self.pipes = self._covered(bores[:, columns])

    def write(self, part: Part) -> None:
        """Write the name of a part where it costs least."""
        text = self.axis.text(
            0, 0, part.name, fontsize=self.size, color=INK, ha="center", va="center", zorder=6
        )
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.3})
        half = np.ptp(self._box(text), axis=0) / 2
        line, _, _ = part.axes[0]
        along = line.at(line.length * np.array(_ANCHORS))[0][:, self.columns]
        radius = _pixels(self.axis, part.fitting.radius)
        spots = _spots(self.axis.transData.transform(along), radius, half, self.point)
        best = int(np.argmin(spots.costs + self._cost(spots, half)))
        self._put(text, spots.places[best], half, spots.anchors[best], radius)

    def _put(self, text: Any, spot: Array, half: Array, anchor: Array, radius: float) -> None:
        """Put a name at its spot, pixels, and tie it to a part that is far from it."""
        to_data = self.axis.transData.inverted().transform
        x, y = to_data(spot).tolist()
        text.set_position((x, y))
        self.boxes.append(np.stack([spot - half, spot + half]))
        nearest = np.clip(anchor, spot - half, spot + half)
        if np.linalg.norm(nearest - anchor) > radius + _TIED * self.point:
            ends = to_data(np.stack([anchor, nearest]))
            self.axis.plot(*ends.T, color=GREY, lw=0.5, zorder=5.9)

    def _box(self, text: Any) -> Array:
        """Lower left and upper right corner (2, 2) of a text, pixels."""
        return text.get_window_extent(self.renderer).get_points()

    def _covered(self, points: Array) -> Array:
        """The points in all pixels of the view below and to the left of a corner of pixels, so that
        those in a box of any size are looked up at its four corners."""
        size = np.ceil(np.ptp(self.frame, axis=0)).astype(int)
        sums = np.zeros(size + 1)
        pixels = self.axis.transData.transform(points) - self.frame[0]
        inside = pixels[((pixels >= 0) & (pixels < size)).all(axis=1)].astype(int)
        np.add.at(sums, tuple(inside.T + 1), 1)
        return sums.cumsum(axis=0).cumsum(axis=1)

    def _cost(self, spots: _Spots, half: Array) -> Array:
        """What names at spots cover (n,), the smaller the better; ``half`` (2,) is half their size,
        pixels.

        By far the worst is to cover another name, then to stick out of the view, then to cover the
        way or a pipe.
        """
        room = half + self.point * _MARGIN
        low, high = spots.places - room, spots.places + room
        boxes = np.array(self.boxes).reshape(-1, 2, 2)
        beside = (low[:, None] >= boxes[:, 1]) | (high[:, None] <= boxes[:, 0])
        names = (~beside.any(axis=-1)).sum(axis=-1)
        outside = ((low < self.frame[0]) | (high > self.frame[1])).any(axis=-1)
        pipes = np.where(spots.inside, 0, self._inside(self.pipes, low, high))
        way = self._inside(self.way, low, high)
        return 1e6 * names + 1e5 * outside + _WAY * way + _PIPE * pipes

    def _inside(self, sums: Array, low: Array, high: Array) -> Array:
        """How many of the points of ``_covered`` lie in boxes (n,)."""
        (left, bottom), (right, top) = self._corners(sums, low), self._corners(sums, high)
        return sums[right, top] - sums[left, top] - sums[right, bottom] + sums[left, bottom]

    def _corners(self, sums: Array, places: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The corners of pixels nearest to places (n, 2), as indices into ``sums``."""
        most = np.array(sums.shape) - 1
        x, y = np.clip(np.rint(places - self.frame[0]), 0, most).astype(np.intp).T
        return x, y


def _pixels(axis: Axes, length: float) -> float:
    """A length in m, in pixels as it is drawn."""
    return float(np.ptp(axis.transData.transform([[0.0, 0.0], [length, 0.0]])[:, 0]))


@dataclass(frozen=True)
class _Spots:
    """Where a name may stand.

    Attributes:
        places: (n, 2) pixels, its middle.
        anchors: (n, 2) pixels, what it stands beside: places on the axis of its part.
        costs: (n,) of standing there and not on the middle of the part.
        inside: (n,) whether it lies in its part and covers nothing else.
    """

    places: Array
    anchors: Array
    costs: Array
    inside: NDArray[np.bool_]


def _spots(anchors: Array, radius: float, half: Array, point: float) -> _Spots:
    """Spots on and beside a part.

    Args:
        anchors: (a, 2) pixels, at ``_ANCHORS`` of its axis.
        radius: of its bore, pixels.
        half: (2,) half the size of the name, pixels.
        point: pixels of a point.
    """
    angle = np.radians([90, 270, 0, 180, 45, 135, 225, 315, 67, 113, 247, 293])
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    beside = [direction * (radius + half + point * gap) for gap in _GAPS]
    shifts = np.concatenate([[[0.0, 0.0]], *beside])
    gaps = np.append(0.0, np.repeat(_GAPS, len(angle)))  # points
    length = np.ptp(anchors[:, 0]) / np.ptp(_ANCHORS)  # as seen, to the right
    fits = bool(half[1] < radius and 2 * half[0] < length)
    along = _SHIFT / point * np.linalg.norm(anchors - anchors[0], axis=1)
    return _Spots(
        places=(anchors[:, None] + shifts).reshape(-1, 2),
        anchors=np.repeat(anchors, len(shifts), axis=0),
        costs=(along[:, None] + _FAR * gaps).ravel(),
        inside=np.tile(fits & (gaps == 0), len(anchors)),
    )
