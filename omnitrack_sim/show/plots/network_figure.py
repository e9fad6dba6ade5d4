"""Figure of a pipe network from two sides, from above and in space, with a route in it.

Its views and names of parts are those of all maps in figures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Part, Route
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.show.plots.style import (
    ALARM,
    CURVE_COLOURS,
    DPI,
    GREY,
    INK,
    PAGE,
    TICKS,
    chart,
    headline,
    new_figure,
    page,
)
from omnitrack_sim.show.projection import (
    Projection,
    aligned,
    axis_lines,
    bore_faces,
    port_discs,
    route_line,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_NAMES = 80
"""Parts that a figure names."""
PIPE, ROUTE = "#d3d8de", CURVE_COLOURS[0]
VIEWS = ("elevation", "side", "plan")
"""The larger elevation, the other one, and the plan."""
_NAMES, _FEW_NAMES, _FEW = 5.5, 6.5, 25
"""Size of the names, points; of up to ``_FEW`` parts ``_FEW_NAMES``."""
_ROOM = (6.0, 6.6)
"""Inches that the views may take together, to the right and up."""
_MIN_SIZE = (1.4, 1.2)
"""Inches that are left for a column or a row of views at least: the view in space has the last."""
_LEFT, _BELOW, _HEAD = 0.46, 0.36, 0.42  # inches around the views
_BESIDE, _BETWEEN = 0.46, 0.5  # inches between the views
_HEIGHTS = (2.0, 8.0)
"""Least and largest height of one view alone, inches."""
_PATH, _PIPE = 20, 1  # cost of covering a point of the path, or of a pipe
_SHIFT, _FAR = 3.0, 6.0  # cost of a point (1/72 inch) along the part, and away from it
_GAPS = np.array([0.7, 2.5, 5.0, 8.0, 13.0])
"""Distances at which a name may stand beside its part, points."""
_TIED = 3.5
"""Gap from which on a leader line joins name and part, points."""
_MARGIN = np.array([1.8, 0.3])  # points that are kept free beside a name, and above and below it
_ANCHORS = (0.5, 0.35, 0.65, 0.2, 0.8)
"""Places along a part where its name may stand, as parts of its length."""


def plot_network(
    network: Network,
    *,
    path: str | Path | None = None,
    route: Route | None = None,
    view: str | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """Plot a pipe network as an engineer draws it: elevations, plan, a view in space.

    The plan is below the first elevation, all to one scale.

    Parts are named, each in the view that shows most of it, and open ends are marked.

    Args:
        network: what to draw.
        path: file to write; none: the figure is returned and nothing is written.
        route: highlighted when given.
        view: ``elevation``, ``side`` or ``plan``, to draw this one alone; with ``ax`` none means
            the one that shows most.
        ax: where to draw one view, which has its limits and its size then; none: in a figure of its
            own.
        format: ``png``, ``pdf`` or ``svg``; none: from the ending of ``path``.

    Returns:
        The figure, or that of ``ax``.

    Raises:
        InputError: no such view or format; ``path`` is given with ``ax``.
        OutputError: the file cannot be written.

    Example:
        >>> import omnitrack_sim as ot
        >>> figure = ot.plot_network(ot.load_network("tower"), view="plan")
        >>> figure.axes[0].get_title(loc="left")
        'plan, from above'
    """
    check_is(Network, "network", network)
    if view is not None and view not in VIEWS:
        raise InputError(Fault("view", f"is {view!r}", VIEWS, str(view)))
    drawing = _Drawing(network, route)
    if view is None and ax is None:
        return page(drawing.page, path, format)
    one = drawing.widest if view is None else view
    wide, tall = drawing.size[list(drawing.views[one].columns)]
    size = (PAGE, float(np.clip(PAGE * tall / wide, *_HEIGHTS)))
    return chart(lambda axis: drawing.draw_one(axis, one), size, path, ax, format)


class _Drawing:
    """A network with the faces of its pipes, its extent and its open ends."""

    def __init__(self, network: Network, route: Route | None) -> None:
        self.network, self.route = network, route
        self.faces = bore_faces(network.pipes)
        self.low, self.high = extent(self.faces)
        self.views: dict[str, Projection] = dict(zip(VIEWS, aligned(self.size), strict=True))
        few = len(network.pipes.parts) <= _FEW
        self.letters = _FEW_NAMES if few else _NAMES  # points
        self.path = np.zeros((0, 3)) if route is None else route_line(route)
        self.ends = self._ends()

    @property
    def size(self) -> Array:
        """(3,) m, along the world axes."""
        return self.high - self.low

    @property
    def widest(self) -> str:
        """The view that is largest."""
        areas = {name: np.prod(self.size[list(v.columns)]) for name, v in self.views.items()}
        return max(areas, key=lambda name: float(areas[name]))

    def _ends(self) -> list[tuple[str, Array, Any]]:
        """Return name, position (3,) m and colour of each open end.

        The name is the user's, with "from" and "to" at the ends of a route, and empty where there
        is none.
        """
        named = {port: name for name, port in self.network.ports.items()}
        words = {}
        if self.route is not None:
            first, last = self.route.passages[0], self.route.passages[-1]
            words = {(first.index, first.enter): "from", (last.index, last.leave): "to"}
        ends = []
        for port in self.network.open_ends:
            index, own = self.network.end("", port)
            word = words.get((index, own))
            name = named.get(port, "") if word is None else f"{word} {named.get(port, port)}"
            position = self.network.pipes.parts[index].port(own).position
            ends.append((name, position, ALARM if word is None else ROUTE))
        return ends

    def page(self) -> Figure:
        """Return the figure of all views."""
        plan = self.views["plan"]
        wide, deep, tall = self.size[[*plan.columns, 2]]
        scale = min(_ROOM[0] / (wide + deep), _ROOM[1] / (tall + deep))  # inches a metre
        row, second = max(_MIN_SIZE[1], scale * deep), _LEFT + scale * wide + _BESIDE
        above = _BELOW + row + _BETWEEN
        height = above + scale * tall + _HEAD
        figure = new_figure((PAGE, height), dpi=DPI)
        places = {
            "elevation": (_LEFT, above, wide, tall),
            "side": (second, above, deep, tall),
            "plan": (_LEFT, _BELOW + row - scale * deep, wide, deep),
        }
        axes = {}
        for name, (x, y, w, h) in places.items():
            box = (x / PAGE, y / height, scale * w / PAGE, scale * h / height)
            axes[name] = figure.add_axes(box)
            self._draw_view(axes[name], self.views[name])
        self._name_parts(axes)
        corner = (second / PAGE, 0.1 / height, 1 - second / PAGE, (row + _BELOW) / height)
        self._draw_space(figure.add_axes(corner, projection="3d"))
        parts, ends = self.network.pipes.parts, self.network.open_ends
        text = f"{len(parts)} parts, {self.network.length:.2f} m, {len(ends)} open ends"
        if self.route is not None:
            length, passed = self.route.centreline.length, len(self.route.passages)
            text += f"; route of {length:.2f} m through {passed} parts"
        headline(figure, self.network.name, text, _LEFT)
        return figure

    def draw_one(self, axis: Axes, name: str) -> None:
        """Draw one view, with the names of the parts that are not seen along their axis."""
        self._draw_view(axis, self.views[name])
        axis.set_aspect("equal", adjustable="box")
        axis.get_figure(root=True).draw_without_rendering()  # type: ignore[union-attr]
        self._name_parts({name: axis}, shown_only=True)

    def _name_parts(self, axes: dict[str, Axes], shown_only: bool = False) -> None:
        """Write the names of parts into the views, off the route and the open ends."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        figure = next(iter(axes.values())).get_figure(root=True)
        renderer = FigureCanvasAgg(figure).get_renderer()  # measures the names as they are drawn
        views = [self.views[name] for name in axes]
        taken = np.concatenate([self.path, *(position[None] for _, position, _ in self.ends)])
        pipes = self.network.pipes
        draw_names([*axes.values()], views, renderer, pipes, taken, self.letters, shown_only)

    def _draw_space(self, space: Any) -> None:
        """Draw the network in space."""
        from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

        space.set_proj_type("ortho")
        space.set_axis_off()
        alpha = 0.2 if self.route is not None else 0.3
        colours = {"facecolors": "#7f93a8", "alpha": alpha, "edgecolors": "none"}
        space.add_collection3d(Poly3DCollection(self.faces, **colours))
        lines = [line for part in self.network.pipes.parts for line in axis_lines(part)]
        space.add_collection3d(Line3DCollection(lines, colors=GREY, linewidths=0.5))
        if self.route is not None:
            space.plot(*self.path.T, color=ROUTE, linewidth=1.6)
        for _, position, colour in self.ends:
            space.plot(*position[:, None], "o", color=colour, markersize=2.5)
        space.set(**{f"{axis}lim": (self.low[i], self.high[i]) for i, axis in enumerate("xyz")})
        space.set_box_aspect(self.size, zoom=1.25)
        space.view_init(elev=24, azim=-58)
        self._name_ends(space)

    def _name_ends(self, space: Any) -> None:
        """Write the names of the open ends beside them in space.

        They stand on the left of those whose names would be cut off by the right margin of the
        figure.
        """
        from mpl_toolkits.mplot3d.proj3d import proj_transform

        figure = space.get_figure(root=True)
        figure.draw_without_rendering()  # the axes take their place in the figure
        size, to_figure = figure.get_size_inches() * 72, figure.transFigure.inverted().transform
        gap = _GAPS[1]
        for name, position, colour in self.ends:
            along_x, along_y, along_z = position
            flat = proj_transform(along_x, along_y, along_z, space.get_proj())[:2]
            x, y = size * to_figure(space.transData.transform(flat))  # points
            look = {"fontsize": self.letters, "color": colour, "va": "center", "zorder": 6}
            text = space.text2D(0, 0, name, transform=figure.transFigure, **look)
            wide = text.get_window_extent().width * 72 / figure.dpi
            beside = x + gap
            if beside + wide > size[0]:
                beside = max(0.0, x - gap - wide)
            text.set_position((beside / size[0], y / size[1]))

    def _draw_view(self, axis: Axes, view: Projection) -> None:
        columns = list(view.columns)
        frame_view(axis, view, self.low, self.high)
        draw_pipes(axis, self.network.pipes, view, self.faces)
        if self.route is not None:
            axis.plot(*self.path[:, columns].T, color=ROUTE, linewidth=1.6, alpha=0.85)
        for _, position, colour in self.ends:
            axis.plot(*position[columns, None], "o", color=colour, markersize=2.5, zorder=4)


def extent(faces: Array) -> tuple[Array, Array]:
    """Lowest and highest coordinates (3,) m of pipes with these faces, with some room."""
    points = faces.reshape(-1, 3)
    room = 0.04 * np.ptp(points, axis=0).max()
    return points.min(axis=0) - room, points.max(axis=0) + room


def frame_view(axis: Axes, view: Projection, low: Array, high: Array) -> None:
    """Give a view its title, and its axes their names and limits ``low`` to ``high`` (3,) m."""
    for name, column in zip("xy", view.columns, strict=True):
        limits = (low[column], high[column])
        falls = name == "y" and view.falls
        getattr(axis, f"set_{name}lim")(*(limits[::-1] if falls else limits))
        getattr(axis, f"set_{name}label")(f"{'xyz'[column]} [m]", labelpad=1.5)
    axis.tick_params(**TICKS)
    axis.set_title(view.title, loc="left", fontsize=7, color=INK, pad=3)
    axis.autoscale(False)


def draw_pipes(
    axis: Axes, pipes: Assembly, view: Projection, faces: Array, colour: str = PIPE
) -> None:
    """Draw bores and axes of all parts in one view; ``faces`` are their ``bore_faces``."""
    from matplotlib.collections import LineCollection, PolyCollection

    columns = list(view.columns)
    filled = [*faces[:, :, columns], *(disc[:, columns] for disc in port_discs(pipes))]
    axis.add_collection(
        PolyCollection(filled, facecolors=colour, edgecolors=colour, linewidths=0.4)
    )
    lines = [line[:, columns] for part in pipes.parts for line in axis_lines(part)]
    axis.add_collection(LineCollection(lines, colors=GREY, linewidths=0.7, zorder=2))


def draw_names(
    axes: Sequence[Axes],
    views: Sequence[Projection],
    renderer: Any,
    pipes: Assembly,
    path: Array,
    size: float,
    shown_only: bool = False,
) -> None:
    """Write the name of each part into the view that shows most of it.

    Names keep off the bores where they can, and above all off the points ``path`` (n, 3) m;
    ``size`` is that of the letters, points; ``shown_only`` leaves out parts that are seen along
    their axis.
    """
    bores = np.concatenate([part.bore_samples() for part in pipes.parts])
    crowds = [
        _Crowd(axis, list(view.columns), renderer, path, bores, size)
        for axis, view in zip(axes, views, strict=True)
    ]
    # Of very many parts every so-many-th is named, for no more names can be read.
    for part in pipes.parts[:: math.ceil(len(pipes.parts) / MAX_NAMES)]:
        points = np.concatenate(axis_lines(part))
        extents = [np.ptp(points[:, list(view.columns)], axis=0) for view in views]
        sizes = [np.prod(extent + part.fitting.max_radius) for extent in extents]
        best = int(np.argmax(sizes))
        if not shown_only or extents[best].max() > part.fitting.radius:
            crowds[best].write(part)


class _Crowd:
    """Names, pipes and path of one view, which a new name should not cover."""

    def __init__(
        self, axis: Axes, columns: list[int], renderer: Any, path: Array, bores: Array, size: float
    ) -> None:
        self.axis, self.columns, self.renderer, self.size = axis, columns, renderer, size
        self.point = float(renderer.points_to_pixels(1.0))
        self.frame: Array = axis.get_window_extent().get_points()
        self.boxes = [self._box(text) for text in axis.texts if text.get_text()]
        self.path = self._covered(path[:, columns])
        self.pipes = self._covered(bores[:, columns])

    def write(self, part: Part) -> None:
        """Write the name of a part where it costs least, tied to a part that is far from it."""
        text = self.axis.text(
            0, 0, part.name, fontsize=self.size, color=INK, ha="center", va="center", zorder=6
        )
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.3})
        half = np.ptp(self._box(text), axis=0) / 2
        line, _, _ = part.axes[0]
        along = line.at(line.length * np.array(_ANCHORS))[0][:, self.columns]
        anchors = self.axis.transData.transform(along)  # (a, 2) pixels
        lengths = self.axis.transData.transform([[0.0, 0.0], [part.fitting.radius, 0.0]])
        radius = float(np.ptp(lengths[:, 0]))
        shifts, gaps = self._shifts(radius, half)
        length = np.ptp(anchors[:, 0]) / np.ptp(_ANCHORS)  # as seen, to the right
        fits = bool(half[1] < radius and 2 * half[0] < length)
        away = _SHIFT / self.point * np.linalg.norm(anchors - anchors[0], axis=1)
        places = (anchors[:, None] + shifts).reshape(-1, 2)
        # A name that fits into its part covers nothing else there.
        inside = np.tile(fits & (gaps == 0), len(anchors))
        cost = (away[:, None] + _FAR * gaps).ravel() + self._cost(places, inside, half)
        best = int(np.argmin(cost))
        spot, anchor = places[best], anchors[best // len(shifts)]
        to_data = self.axis.transData.inverted().transform
        text.set_position(to_data(spot).tolist())
        self.boxes.append(np.stack([spot - half, spot + half]))
        nearest = np.clip(anchor, spot - half, spot + half)
        if np.linalg.norm(nearest - anchor) > radius + _TIED * self.point:
            self.axis.plot(*to_data([anchor, nearest]).T, color=GREY, lw=0.5, zorder=5.9)

    def _shifts(self, radius: float, half: Array) -> tuple[Array, Array]:
        """Return places of a name beside an axis.

        Returns:
            Shifts (n, 2) pixels from the axis to the middle of a name of ``half`` its size, and how
            far (n,) points it then stands beside a bore of ``radius`` pixels.
        """
        angle = np.radians([90, 270, 0, 180, 45, 135, 225, 315, 67, 113, 247, 293])
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        beside = [direction * (radius + half + self.point * gap) for gap in _GAPS]
        gaps = np.append(0.0, np.repeat(_GAPS, len(angle)))
        return np.concatenate([[[0.0, 0.0]], *beside]), gaps

    def _box(self, text: Any) -> Array:
        """Lower left and upper right corner (2, 2) of a text, pixels."""
        return text.get_window_extent(self.renderer).get_points()

    def _covered(self, points: Array) -> Array:
        """Return the number of points in all pixels below and to the left of a corner of pixels.

        Those in a box of any size are then looked up at its four corners.
        """
        size = np.ceil(np.ptp(self.frame, axis=0)).astype(int)
        # Summed once, a box of any size costs four look-ups, and there are hundreds of boxes.
        sums = np.zeros(size + 1)
        pixels = self.axis.transData.transform(points) - self.frame[0]
        inside = pixels[((pixels >= 0) & (pixels < size)).all(axis=1)].astype(int)
        np.add.at(sums, tuple(inside.T + 1), 1)
        return sums.cumsum(axis=0).cumsum(axis=1)

    def _cost(self, places: Array, inside: NDArray[np.bool_], half: Array) -> Array:
        """Return the cost (n,) of names centred at ``places`` (n, 2) pixels.

        ``inside`` (n,) says which lie in their part; ``half`` (2,) is half their size, pixels.

        By far the worst is to cover another name, then to stick out of the view, then to cover the
        path or a pipe.
        """
        room = half + self.point * _MARGIN
        low, high = places - room, places + room
        boxes = np.array(self.boxes).reshape(-1, 2, 2)
        beside = (low[:, None] >= boxes[:, 1]) | (high[:, None] <= boxes[:, 0])
        names = (~beside.any(axis=-1)).sum(axis=-1)
        outside = ((low < self.frame[0]) | (high > self.frame[1])).any(axis=-1)
        pipes = np.where(inside, 0, self._count(self.pipes, low, high))
        path = self._count(self.path, low, high)
        return 1e6 * names + 1e5 * outside + _PATH * path + _PIPE * pipes

    def _count(self, sums: Array, low: Array, high: Array) -> Array:
        """Number of the points of ``_covered`` in boxes (n,)."""
        most = np.array(sums.shape) - 1
        corners = np.clip(np.rint([low, high] - self.frame[0]), 0, most).astype(np.intp)
        (left, bottom), (right, top) = corners.transpose(0, 2, 1)
        return sums[right, top] - sums[left, top] - sums[right, bottom] + sums[left, bottom]
