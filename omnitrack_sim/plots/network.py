"""A pipe network drawn: in space, from above and from the side, with a route in it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from omnitrack_sim.network import Network
from omnitrack_sim.pipes import Assembly, Centreline, Part, Route
from omnitrack_sim.plots.style import ALARM, GREY, INK, MODULE_COLOURS, save_figure, styled
from omnitrack_sim.rotations import Array

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
_AXES = "xyz"


def plot_network(
    network: Network,
    path: str | Path | BinaryIO,
    route: Route | None = None,
    format: str | None = None,
) -> None:
    """Write the figure of ``network_figure``.

    Raises:
        InputError: no such format. OutputError: the file cannot be written.
    """
    save_figure(network_figure(network, route), path, format)


def network_figure(network: Network, route: Route | None = None) -> Figure:
    """Three views of a network: in space, an elevation, and the plan from above.

    Of the two elevations the wider one is shown. Parts are named, and open ends are marked.

    Args:
        network: what to draw.
        route: highlighted when given.
    """
    return styled(lambda: _draw(network, route))


def _draw(network: Network, route: Route | None) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    quads = faces(network.pipes)
    low, high = quads.reshape(-1, 3).min(axis=0), quads.reshape(-1, 3).max(axis=0)
    across = 0 if high[0] - low[0] >= high[1] - low[1] else 1
    figure = Figure(figsize=(13.5, 5.4), layout="constrained")
    grid = figure.add_gridspec(1, 3, width_ratios=[1.15, 1, 1])
    space: Any = figure.add_subplot(grid[0], projection="3d")
    _draw_space(space, network, quads, low, high, route)
    views = [((across, 2), f"elevation, along {'yx'[across]}"), ((0, 1), "plan, from above")]
    axes = [figure.add_subplot(grid[column]) for column in (1, 2)]
    for axis, (pair, title) in zip(axes, views, strict=True):
        _draw_view(axis, network, quads, pair, title, route)
    canvas = FigureCanvasAgg(figure)  # measures the names as they are drawn
    canvas.draw()
    renderer = canvas.get_renderer()
    taken: list[list[Any]] = [[] for _ in axes]
    for part in named_parts(network.pipes):
        view = widest_view(part, [pair for pair, _ in views])
        point = middle(part)[list(views[view][0])]
        taken[view].append(label(axes[view], renderer, part.name, point, taken[view]))
    title = (
        f"{network.name}: {len(network.pipes.parts)} parts, {network.length:.2f} m, "
        f"{len(network.open_ends)} open ends"
    )
    if route is not None:
        title += f"; route of {route.centreline.length:.2f} m through {len(route.fittings)} parts"
    figure.suptitle(title, fontsize=10.5, color=INK)
    return figure


def _draw_space(
    space: Any, network: Network, quads: Array, low: Array, high: Array, route: Route | None
) -> None:
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    space.set_proj_type("ortho")
    alpha = 0.16 if route is not None else 0.24
    space.add_collection3d(
        Poly3DCollection(quads, facecolors="#7f93a8", alpha=alpha, edgecolors="none")
    )
    for part in network.pipes.parts:
        for line in _lines(part):
            space.plot(*line.T, color=GREY, linewidth=0.7)
    if route is not None:
        space.plot(*_way(route).T, color=ROUTE, linewidth=2.4)
    for name, point in _open_ends(network, route):
        space.plot(*point[:, None], "o", color=_mark(name), markersize=5)
        space.text(*point, f"  {name}", fontsize=7.5, color=_mark(name))
    for axis, a, b in zip(_AXES, low, high, strict=True):
        getattr(space, f"set_{axis}lim")(a, b)
        getattr(space, f"set_{axis}label")(f"{axis}, m", labelpad=8)
        getattr(space, f"{axis}axis").set_major_locator(
            MaxNLocator(max(1, round(5 * (b - a) / (high - low).max())))
        )
    space.set_box_aspect(high - low, zoom=0.9)
    space.view_init(elev=24, azim=-58)


def _draw_view(
    axis: Axes,
    network: Network,
    quads: Array,
    pair: tuple[int, int],
    title: str,
    route: Route | None,
) -> None:
    columns = list(pair)
    draw_pipes(axis, network.pipes, pair, quads)
    if route is not None:
        axis.plot(*_way(route)[:, columns].T, color=ROUTE, linewidth=2.4, alpha=0.85)
    for name, point in _open_ends(network, route):
        axis.plot(*point[columns, None], "o", color=_mark(name), markersize=5, zorder=4)
    axis.set_aspect("equal", adjustable="box", anchor="W")
    axis.set_title(title, loc="left")
    axis.set_xlabel(f"{_AXES[pair[0]]}, m")
    axis.set_ylabel(f"{_AXES[pair[1]]}, m")
    axis.margins(0.06)


def draw_pipes(axis: Axes, pipes: Assembly, pair: tuple[int, int], quads: Array) -> None:
    """Bores and axes of all parts in one view; ``pair``: world axes to the right and up; ``quads``:
    of ``faces``."""
    from matplotlib.collections import LineCollection, PolyCollection

    columns = list(pair)
    caps = [cap[:, columns] for part in pipes.parts for cap in _caps(part)]
    axis.add_collection(
        PolyCollection(
            [*quads[:, :, columns], *caps], facecolors=PIPE, edgecolors=PIPE, linewidths=0.4
        )
    )
    lines = [line[:, columns] for part in pipes.parts for line in _lines(part)]
    axis.add_collection(LineCollection(lines, colors=GREY, linewidths=0.7, zorder=2))


def faces(pipes: Assembly) -> Array:
    """Corners (n, 4, 3) m of the faces of all bores, world frame."""
    return np.concatenate([_quads(part) for part in pipes.parts])


def widest_view(part: Part, pairs: Sequence[tuple[int, int]]) -> int:
    """Index of the view, of ``pairs`` of world axes, that shows most of a part."""
    points = np.concatenate(_lines(part))
    return int(
        np.argmax(
            [
                np.prod(np.ptp(points[:, list(pair)], axis=0) + part.fitting.largest_radius)
                for pair in pairs
            ]
        )
    )


def named_parts(pipes: Assembly) -> Sequence[Part]:
    """The parts that a figure names: all, or where they are many at most ``MOST_NAMES``, evenly
    spread over their list."""
    return pipes.parts[:: math.ceil(len(pipes.parts) / MOST_NAMES)]


def label(axis: Axes, renderer: Any, text: str, point: Array, taken: Sequence[Any]) -> Any:
    """Write a name at a place (2,) m, moved up or down until it covers none of the boxes ``taken``;
    returns its own box, pixels."""
    found: Any = None
    for shift in (0, 9, -9, 18, -18, 27, -27, 36, -36):
        if found is not None:
            found.remove()
        found = axis.annotate(
            text,
            (float(point[0]), float(point[1])),
            xytext=(0, shift),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7,
            color=INK,
            zorder=6,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.6},
        )
        box = found.get_window_extent(renderer)
        if not any(box.overlaps(other) for other in taken):
            break
    return box


def _open_ends(network: Network, route: Route | None) -> list[tuple[str, Array]]:
    """Name and place (3,) m of each open end.

    The name is the user's where there is one. The ends of the route are marked by "from" and "to".
    """
    named = {port: name for name, port in network.ports.items()}
    ends = {}
    if route is not None:
        first, last = route.fittings[0], route.fittings[-1]
        ends = {(first.index, first.enter): "from ", (last.index, last.leave): "to "}
    found = []
    for port in network.open_ends:
        index, name = network.end("", port)
        place = network.pipes.parts[index].port(name).position
        found.append((ends.get((index, name), "") + named.get(port, port), place))
    return found


def _mark(name: str) -> Any:
    return ROUTE if name.startswith(("from ", "to ")) else ALARM


def _way(route: Route) -> Array:
    """Points (n, 3) m of the route's centreline."""
    length = route.centreline.length
    return route.centreline.at(np.linspace(0, length, max(2, round(length / ROUTE_SPACING))))[0]


def _lines(part: Part) -> list[Array]:
    """Axes of a part, points (n, 3) m."""
    return [line.at(_places(line))[0] for line, _, _ in part.axes]


def middle(part: Part) -> Array:
    """Where a part's name stands (3,) m."""
    line, _, _ = part.axes[0]
    return line.at(np.array([line.length / 2]))[0][0]


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
