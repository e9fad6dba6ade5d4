"""A pipe network drawn: from two sides, from above and in space, with a route in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import clipped
from omnitrack_sim.pipes import Assembly, Centreline, Part, Route
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.show.plots.names import draw_names
from omnitrack_sim.show.plots.style import (
    ALARM,
    DPI,
    GREY,
    INK,
    MODULE_COLOURS,
    PAGE,
    PAPER,
    TICKS,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AROUND = 24
"""Corners of a drawn pipe's cross-section."""
BEND_SPACING = 0.03
"""Distance of neighbouring rings of a drawn bend, m."""
ROUTE_SPACING = 0.01
"""Distance of neighbouring points of a drawn route, m."""
MOST_NAMES = 80
"""Parts that a figure names; of more, each so-many-th is named, for no more names can be read."""
PIPE, ROUTE = "#d3d8de", MODULE_COLOURS[1]
VIEWS = ("elevation", "side", "plan")
"""The larger elevation, the other one, and the plan."""
_AXES = "xyz"
_NAMES, _FEW_NAMES, _FEW = 5.5, 6.5, 25
"""Size of the names, points; of up to ``_FEW`` parts ``_FEW_NAMES``."""
_ROOM = (6.0, 6.6)
"""Inches that the views may take together, to the right and up."""
_LEAST = (1.4, 1.2)
"""Inches that are left for a column or a row of views at least: the view in space has the last."""
_LEFT, _BELOW, _RIGHT, _HEAD = 0.46, 0.36, 0.08, 0.42  # inches around the views
_BESIDE, _BETWEEN = 0.46, 0.5  # inches between the views
_HEIGHTS = (2.0, 8.0)
"""Least and largest height of one view alone, inches."""


def plot_network(
    network: Network,
    path: str | Path | None = None,
    route: Route | None = None,
    *,
    view: str | None = None,
    ax: Axes | None = None,
    format: str | None = None,
) -> Figure:
    """A pipe network as an engineer draws it: elevations from two sides, the plan from above below
    the first one, all to one scale, and a view in space.

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
    """
    from omnitrack_sim.show.plots.picture import chart, page

    check_is(Network, "network", network)
    if view is not None and view not in VIEWS:
        raise InputError(Fault("view", f"is {view!r}", VIEWS, str(view)))
    drawing = _Drawing(network, route)
    if view is None and ax is None:
        return page(lambda: styled(lambda: _draw(drawing), PAPER), path, format)
    one = drawing.widest if view is None else view
    wide, tall = drawing.size[list(drawing.pairs[one])]
    size = (PAGE, float(np.clip(PAGE * tall / wide, *_HEIGHTS)))
    return chart(lambda axis: _draw_one(axis, drawing, one), size, path, ax, format, PAPER)


class _Drawing:
    """A network with the faces of its pipes, its extent, and the world axes of each view."""

    def __init__(self, network: Network, route: Route | None) -> None:
        self.network, self.route = network, route
        self.quads, self.ends = faces(network.pipes), _open_ends(network, route)
        points = self.quads.reshape(-1, 3)
        room = 0.04 * np.ptp(points, axis=0).max()
        self.low, self.high = points.min(axis=0) - room, points.max(axis=0) + room
        across = 0 if self.size[0] >= self.size[1] else 1
        self.pairs = {
            "elevation": (across, 2),
            "side": (1 - across, 2),
            "plan": (across, 1 - across),
        }

    @property
    def size(self) -> Array:
        """(3,) m, along the world axes."""
        return self.high - self.low

    @property
    def widest(self) -> str:
        """The view that is largest."""
        return max(self.pairs, key=lambda view: float(np.prod(self.size[list(self.pairs[view])])))

    @property
    def letters(self) -> float:
        """Size of the names, points."""
        return _FEW_NAMES if len(self.network.pipes.parts) <= _FEW else _NAMES

    def title(self, view: str) -> str:
        along = "xyz"[3 - sum(self.pairs[view])]
        return "plan, from above" if view == "plan" else f"elevation, along {along}"

    @property
    def head(self) -> str:
        """What the network is, in a line."""
        pipes, ends = self.network.pipes.parts, self.network.open_ends
        text = f"{len(pipes)} parts, {self.network.length:.2f} m, {len(ends)} open ends"
        if self.route is not None:
            length, passed = self.route.centreline.length, len(self.route.passages)
            text += f"; route of {length:.2f} m through {passed} parts"
        return text


def _draw(drawing: _Drawing) -> Figure:
    from omnitrack_sim.show.plots.picture import Picture

    across, depth = drawing.pairs["plan"]
    wide, deep, tall = drawing.size[[across, depth, 2]]
    scale = min(_ROOM[0] / (wide + deep), _ROOM[1] / (tall + deep))  # inches a metre
    row, second = max(_LEAST[1], scale * deep), _LEFT + scale * wide + _BESIDE
    above = _BELOW + row + _BETWEEN
    height = above + scale * tall + _HEAD
    figure = Picture(figsize=(PAGE, height), dpi=DPI)
    places = {
        "elevation": (_LEFT, above, wide, tall),
        "side": (second, above, deep, tall),
        "plan": (_LEFT, _BELOW + row - scale * deep, wide, deep),
    }
    axes = {}
    for view, (x, y, w, h) in places.items():
        box = (x / PAGE, y / height, scale * w / PAGE, scale * h / height)
        axes[view] = figure.add_axes(box)
        _draw_view(axes[view], drawing, view)
    _name(axes, drawing, named_parts(drawing.network.pipes))
    _draw_space(figure, (second, 0.1, PAGE - second, row + _BELOW), height, drawing)
    top = 1 - 0.07 / height
    text: dict[str, Any] = {"color": INK, "va": "top"}
    name = clipped(drawing.network.name, 60)
    figure.text(_LEFT / PAGE, top, name, size=10, weight="bold", **text)
    figure.text(1 - _RIGHT / PAGE, top, drawing.head, size=8, ha="right", **text)
    return figure


def _draw_one(axis: Axes, drawing: _Drawing, view: str) -> None:
    """One view, with the names of the parts that are not seen along their axis."""
    _draw_view(axis, drawing, view)
    axis.set_aspect("equal", adjustable="box")
    axis.get_figure(root=True).draw_without_rendering()  # type: ignore[union-attr]
    columns = list(drawing.pairs[view])
    parts = named_parts(drawing.network.pipes)
    lengths = [np.ptp(_lines(part)[0][:, columns], axis=0).max() for part in parts]
    seen = [p for p, length in zip(parts, lengths, strict=True) if length > p.fitting.radius]
    _name({view: axis}, drawing, seen)


def _name(axes: dict[str, Axes], drawing: _Drawing, parts: Sequence[Part]) -> None:
    """Write the names of parts into the views, off the route and the open ends."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = next(iter(axes.values())).get_figure(root=True)
    renderer = FigureCanvasAgg(figure).get_renderer()  # measures the names as they are drawn
    pairs = [drawing.pairs[view] for view in axes]
    taken = [end.place[None] for end in drawing.ends]
    if drawing.route is not None:
        taken.append(_way(drawing.route))
    off: Array = np.concatenate([np.zeros((0, 3)), *taken])
    draw_names(
        [*axes.values()], pairs, renderer, drawing.network.pipes, parts, off, drawing.letters
    )


def _draw_space(
    figure: Figure, corner: tuple[float, float, float, float], height: float, drawing: _Drawing
) -> None:
    """The network in space, in a rectangle of the figure given in inches."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    x, y, w, h = corner
    space: Any = figure.add_axes((x / PAGE, y / height, w / PAGE, h / height), projection="3d")
    space.set_proj_type("ortho")
    space.set_axis_off()
    alpha = 0.2 if drawing.route is not None else 0.3
    colours = {"facecolors": "#7f93a8", "alpha": alpha, "edgecolors": "none"}
    space.add_collection3d(Poly3DCollection(drawing.quads, **colours))
    lines = [line for part in drawing.network.pipes.parts for line in _lines(part)]
    space.add_collection3d(Line3DCollection(lines, colors=GREY, linewidths=0.5))
    if drawing.route is not None:
        space.plot(*_way(drawing.route).T, color=ROUTE, linewidth=1.6)
    for end in drawing.ends:
        space.plot(*end.place[:, None], "o", color=end.colour, markersize=2.5)
        space.text(
            *end.place, end.name and f" {end.name}", fontsize=drawing.letters, color=end.colour
        )
    space.set(**{f"{axis}lim": (drawing.low[i], drawing.high[i]) for i, axis in enumerate(_AXES)})
    space.set_box_aspect(drawing.size, zoom=1.25)
    space.view_init(elev=24, azim=-58)


def _draw_view(axis: Axes, drawing: _Drawing, view: str) -> None:
    columns = list(drawing.pairs[view])
    draw_pipes(axis, drawing.network.pipes, drawing.pairs[view], drawing.quads)
    if drawing.route is not None:
        axis.plot(*_way(drawing.route)[:, columns].T, color=ROUTE, linewidth=1.6, alpha=0.85)
    for end in drawing.ends:
        axis.plot(*end.place[columns, None], "o", color=end.colour, markersize=2.5, zorder=4)
    for name, column in zip("xy", columns, strict=True):
        getattr(axis, f"set_{name}lim")(drawing.low[column], drawing.high[column])
        getattr(axis, f"set_{name}label")(f"{_AXES[column]} [m]", labelpad=1.5)
    axis.tick_params(**TICKS)
    axis.set_title(drawing.title(view), loc="left", fontsize=7, color=INK, pad=3)


def draw_pipes(
    axis: Axes, pipes: Assembly, pair: tuple[int, int], quads: Array, colour: str = PIPE
) -> None:
    """Bores and axes of all parts in one view; ``pair``: world axes to the right and up; ``quads``:
    of ``faces``."""
    from matplotlib.collections import LineCollection, PolyCollection

    columns = list(pair)
    caps = [cap[:, columns] for part in pipes.parts for cap in _caps(part)]
    axis.add_collection(
        PolyCollection(
            [*quads[:, :, columns], *caps], facecolors=colour, edgecolors=colour, linewidths=0.4
        )
    )
    lines = [line[:, columns] for part in pipes.parts for line in _lines(part)]
    axis.add_collection(LineCollection(lines, colors=GREY, linewidths=0.7, zorder=2))


def faces(pipes: Assembly) -> Array:
    """Corners (n, 4, 3) m of the faces of all bores, world frame."""
    return np.concatenate([_quads(part) for part in pipes.parts])


def named_parts(pipes: Assembly) -> Sequence[Part]:
    """The parts that a figure names: all, or where they are many at most ``MOST_NAMES``, evenly
    spread over their list."""
    return pipes.parts[:: math.ceil(len(pipes.parts) / MOST_NAMES)]


@dataclass(frozen=True)
class _End:
    """An open end.

    Attributes:
        name: the user's, with "from" and "to" at the ends of a route; empty where there is none.
        place: (3,) m.
        colour: of its sign.
    """

    name: str
    place: Array
    colour: Any


def _open_ends(network: Network, route: Route | None) -> list[_End]:
    named = {port: name for name, port in network.ports.items()}
    ends = {}
    if route is not None:
        first, last = route.passages[0], route.passages[-1]
        ends = {(first.index, first.enter): "from", (last.index, last.leave): "to"}
    found = []
    for port in network.open_ends:
        index, own = network.end("", port)
        word = ends.get((index, own))
        name = named.get(port, "") if word is None else f"{word} {named.get(port, port)}"
        place = network.pipes.parts[index].port(own).position
        found.append(_End(name, place, ALARM if word is None else ROUTE))
    return found


def _way(route: Route) -> Array:
    """Points (n, 3) m of the route's centreline."""
    length = route.centreline.length
    return route.centreline.at(np.linspace(0, length, max(2, round(length / ROUTE_SPACING))))[0]


def _lines(part: Part) -> list[Array]:
    """Axes of a part, points (n, 3) m."""
    return [line.at(_places(line))[0] for line, _, _ in part.axes]


def _caps(part: Part) -> list[Array]:
    """Discs that close a part's ports, corners (AROUND, 3) m: seen along its axis a pipe is one of
    them."""
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    disc = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    return [
        part.port(port).apply(part.fitting.port_radius(port) * disc)
        for port in part.fitting.port_names
    ]


def _quads(part: Part) -> Array:
    """Corners (n, 4, 3) m of the faces of a part's bore."""
    found = []
    angle = np.linspace(0, 2 * np.pi, AROUND + 1)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    for line, first, last in part.axes:
        s = _places(line)
        ring = np.einsum("sij,kj->ski", line.frame(s), circle)  # (n, AROUND + 1, 3)
        ring = line.at(s)[0][:, None] + np.linspace(first, last, len(s))[:, None, None] * ring
        corners = np.stack([ring[:-1, :-1], ring[1:, :-1], ring[1:, 1:], ring[:-1, 1:]], axis=-2)
        found.append(corners.reshape(-1, 4, 3))
    return np.concatenate(found)


def _places(line: Centreline) -> Array:
    """Arc lengths (n,) m of the points that an axis is drawn through: its ends where it is
    straight."""
    count = 2 if line.is_straight else max(2, round(line.length / BEND_SPACING) + 1)
    return np.linspace(0, line.length, count)
