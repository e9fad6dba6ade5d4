"""The unrolled pipe: where the modules of one run touched the wall, and how hard."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from omnitrack_sim.base.rotations import wrap_angle
from omnitrack_sim.paper.plots.phases import PHASE_NAMES, phase_patches, shade
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, MODULES
from omnitrack_sim.show.plots.style import GREY, INK, MODULE_COLOURS, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from omnitrack_sim.pipes import Route
    from omnitrack_sim.record.trajectory import Trajectory
    from omnitrack_sim.results.result import Result

NO_CONTACT_FORCE = 0.5
"""Normal force below which a module counts as off the wall, N."""


def contact_map_figure(result: Result, route: Route | None = None) -> Figure:
    """The unrolled pipe: where the modules ran, and how hard each was pressed to the wall.

    Args:
        result: the run.
        route: if given, its fittings are marked and named.

    Returns:
        One panel: arc length [m] to the right, angle of the module from the turning direction [deg]
            up, normal force [N] as colour. Grey rings show where a module is off the wall (below
            ``NO_CONTACT_FORCE``).
    """
    from omnitrack_sim.show.plots.picture import Picture

    def draw() -> Figure:
        figure = Picture(figsize=(7.6, 4.4), layout="constrained")
        axis = figure.subplots()
        _contacts(axis, result.trajectory)
        if route is not None:
            _fittings(axis, route)
        return figure

    return styled(draw)


def _contacts(axis: Axes, trajectory: Trajectory) -> None:
    """The marks of the contact map, its colour bar and its shades."""
    distance = np.repeat(trajectory["distance"], MODULES)
    angle = wrap_angle(trajectory["theta5"][:, None] + np.array(MODULE_ANGLES))
    angle = np.degrees(angle)  # (T, 3)
    force = trajectory["normal_force"].ravel()
    on, off = force >= NO_CONTACT_FORCE, ~(force >= NO_CONTACT_FORCE)
    shade(axis, trajectory, trajectory["distance"], ("elbow", "tee_turn", "tee_straight"))
    axis.scatter(
        distance[off],
        angle.ravel()[off],
        s=20,
        fc="white",
        ec=GREY,
        lw=0.9,
        label="no contact",
        zorder=4,
    )
    top = max(1.0, float(force[on].max(initial=0.0)))
    points = axis.scatter(
        distance[on],
        angle.ravel()[on],
        c=force[on],
        s=16,
        lw=0,
        cmap="viridis_r",
        vmin=0,
        vmax=top,
        label="contact",
    )
    bar = axis.figure.colorbar(points, ax=axis, pad=0.02)
    bar.set_label("normal force [N]")
    bar.outline.set_visible(False)  # type: ignore[operator]
    for i in range(MODULES):
        at = (trajectory["distance"][0], angle[0, i])
        axis.annotate(
            f"module {i + 1}",
            at,
            (2, 6),
            textcoords="offset points",
            color=MODULE_COLOURS[i],
            weight="bold",
            size=8,
        )
    _unrolled(axis, trajectory)


def _unrolled(axis: Axes, trajectory: Trajectory) -> None:
    """Axes and legend of the contact map."""
    from matplotlib.lines import Line2D

    axis.set_ylim(-188, 188)
    axis.set_yticks(range(-180, 181, 60))
    axis.set_xlabel("arc length of the robot's centre [m]")
    axis.set_ylabel("angle around the pipe\nfrom the turning direction [deg]")
    ring = Line2D(
        [],
        [],
        ls="none",
        marker="o",
        mfc="white",
        mec=GREY,
        ms=4.5,
        label=f"no contact, below {NO_CONTACT_FORCE} N",
    )
    shades = [
        patch for patch in phase_patches(trajectory) if patch.get_label() != PHASE_NAMES["align"]
    ]
    axis.figure.legend(handles=[ring, *shades], loc="outside upper left", ncols=4)  # type: ignore[union-attr]


def _fittings(axis: Axes, route: Route) -> None:
    """Name each bend or tee opening, between dotted lines where it begins and ends."""
    for fitting in route.fittings:
        start, end = fitting.span
        if math.isfinite(start) and math.isfinite(end):
            for s in (start, end):
                axis.axvline(s, color=INK, lw=0.8, ls=":")
            name = route.network.parts[fitting.index].name
            axis.text((start + end) / 2, 182, name, ha="center", va="top", size=8, color=INK)
