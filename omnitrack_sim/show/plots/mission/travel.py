"""The way of the robot's centre, coloured piece by piece with what was recorded there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Route
from omnitrack_sim.record.timeline import FORCE_WINDOW, running_mean
from omnitrack_sim.show.plots.mission.layout import COLUMN, Layout, View
from omnitrack_sim.show.plots.style import INK, TICKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.record.trajectory import Trajectory

BIN = 0.01
"""Length of the pieces of travel that have one colour each, m."""
BESIDE = 0.5
"""How far beside the pipe's axis tail-first travel is drawn, in bore radii."""


@dataclass(frozen=True)
class Stretch:
    """Travel on one leg, in n pieces of ``BIN``.

    Attributes:
        leg: index of the leg.
        tail_first: whether it was driven tail first.
        rows: (n + 1,) samples that bound the pieces.
        slip: (n,) mean slip ratio of the modules, as a magnitude.
        force: (n,) N, least normal force of a module.
    """

    leg: int
    tail_first: bool
    rows: NDArray[np.intp]
    slip: Array
    force: Array


def stretches_of(trajectory: Trajectory) -> Iterator[Stretch]:
    """The travel of each leg in pieces of ``BIN``."""
    slip = np.abs(trajectory["slip_ratio"]).mean(axis=1)
    force = running_mean(trajectory["normal_force"], trajectory.time, FORCE_WINDOW).min(axis=1)
    known = np.isfinite(trajectory["position"]).all(axis=1) & np.isfinite(trajectory["distance"])
    for leg in np.unique(trajectory["leg"]).tolist():
        rows = np.flatnonzero(known & (trajectory["leg"] == leg))
        if len(rows) == 0:
            continue
        travel = np.append(0.0, np.cumsum(np.abs(np.diff(trajectory["distance"][rows]))))
        starts = np.flatnonzero(np.diff(np.floor(travel / BIN), prepend=-1.0))
        count = np.diff(np.append(starts, len(rows)))
        yield Stretch(
            leg=int(leg),
            tail_first=bool(trajectory["gear"][rows[0]] < 0),
            rows=np.append(rows[starts], rows[-1]),
            slip=np.add.reduceat(slip[rows], starts) / count,
            force=np.minimum.reduceat(force[rows], starts),
        )


def colour_bar(
    figure: Figure, layout: Layout, column: int, text: str, colours: str, values: list[Array]
) -> Any:
    """The colour scale of one column, drawn above it.

    It goes from 0 to a round number that 98 % of the pieces stay below.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    every = np.concatenate(values) if values else np.zeros(0)
    every = every[np.isfinite(every)]
    largest = float(every.max()) if len(every) else 1.0
    top = _round_up(float(np.quantile(every, 0.98)) if len(every) else 1.0)
    scale = ScalarMappable(Normalize(0.0, top), colours)
    width = 0.62 * COLUMN
    left = layout.left_of[column] + (COLUMN - width) / 2
    axis = figure.add_axes(layout.box(left, layout.bar, width, 0.07))
    bar = figure.colorbar(
        scale,
        cax=axis,
        orientation="horizontal",
        extend="max" if largest > 1.001 * top else "neither",
    )
    bar.locator = MaxNLocator(6)
    bar.update_ticks()
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]
    axis.tick_params(**TICKS)
    axis.set_title(text, fontsize=7.5, color=INK, pad=3)
    return scale


def _round_up(value: float) -> float:
    """The next round number: 1, 1.5, 2, 2.5, ... times a power of ten; 1 if not positive."""
    if not value > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(
        power
        * next(
            (m for m in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if m * power >= value * (1 - 1e-9)), 10
        )
    )


def draw_way(
    axis: Axes,
    view: View,
    trajectory: Trajectory,
    routes: tuple[Route, ...],
    stretches: list[Stretch],
    values: list[Array],
    scale: Any,
) -> None:
    """The way of the robot's centre on a dark edge, each piece in the colour of its value."""
    from matplotlib.collections import LineCollection

    columns = list(view.pair)
    for stretch, value in zip(stretches, values, strict=True):
        points = trajectory["position"][stretch.rows]
        if stretch.tail_first:
            points = points + _beside(trajectory, routes[stretch.leg], stretch, view)
        flat = points[:, columns]
        pieces = np.stack([flat[:-1], flat[1:]], axis=1)
        axis.plot(*flat.T, color=INK, linewidth=3.0, solid_capstyle="round", zorder=3)
        lines = LineCollection(
            list(pieces), array=value, cmap=scale.cmap, norm=scale.norm, zorder=3.1
        )
        lines.set(linewidth=2.2, capstyle="projecting")
        axis.add_collection(lines, autolim=False)
        if stretch.tail_first:
            axis.plot(*flat.T, color="white", linewidth=0.7, linestyle=(0, (4, 4)), zorder=3.2)


def _beside(trajectory: Trajectory, route: Route, stretch: Stretch, view: View) -> Array:
    """Shifts (n + 1, 3) m to the right of the direction of travel as one view shows it."""
    i, j = view.pair
    tangent = route.centreline.at(trajectory["distance"][stretch.rows])[1]
    if view.flipped:
        i, j = j, i
    shift = np.zeros_like(tangent)
    shift[:, i], shift[:, j] = tangent[:, j], -tangent[:, i]
    return BESIDE * route.passages[0].radius * shift
