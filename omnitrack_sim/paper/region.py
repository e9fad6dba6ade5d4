"""Figures of the motion singularity region.

They are the paper's Figs. 7, 8 and 9, the three definitions, and the contact map.

In sections the turning direction points right and the outer direction left; in the cut through the
tee the robot comes up the run and leaves to the right.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.robots.omnitrack.singularity import (
    DEFINITIONS,
    TurnCase,
    failure_rate,
    section_ellipse,
    sector_angle,
    worst_theta5,
)
from omnitrack_sim.robots.omnitrack.tee_contact import (
    TeePath,
    outer_sector,
    wall_distance,
)
from omnitrack_sim.show.plots.style import ALARM, GREY, INK, new_figure, page, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

SECTOR_COLOUR = "#f2d16b"
COLOURS: tuple[Any, ...] = (*MODULE_COLOURS, "#8a5aa5", "#7a7f87", "#b5703c")
"""Colours of the modules, of which a robot of another design may have more than three."""
_CIRCLE = np.linspace(0, 2 * np.pi, 361)
_MM = 1e3


def plot_singularity(
    case: TurnCase,
    *,
    path: str | Path | None = None,
    figure: str = "all",
    format: str | None = None,
) -> Figure:
    """Draw the motion singularity region of a robot at a tee.

    Args:
        case: the robot and the tee.
        path: file to write; none: the figure is returned and nothing is written.
        figure: a key of ``FIGURES``, or ``all`` for a page with all of them.
        format: ``png``, ``svg`` or ``pdf``; none: from the ending of ``path``.

    Raises:
        InputError: no such figure or format.
        OutputError: the file cannot be written.

    Example:
        >>> import omnitrack_sim as ot
        >>> figure = ot.plot_singularity(ot.TurnCase(reach=0.1), figure="sector")
        >>> figure.get_size_inches().tolist()
        [4.6, 4.4]
    """
    check_is(TurnCase, "case", case)
    if figure != "all" and figure not in FIGURES:
        raise InputError(Fault("figure", f"is {figure!r}", ("all", *FIGURES), figure))
    return page(lambda: _drawn(case, figure), path, format)


@style()
def _drawn(case: TurnCase, figure: str) -> Figure:
    """A figure, or a page with all of them."""
    if figure != "all":
        size, fill = FIGURES[figure]
        drawn = new_figure(size, layout="constrained")
        fill(drawn, case)
        return drawn
    drawn = new_figure((15, 9.2), layout="constrained")
    top, bottom = np.asarray(drawn.subfigures(2, 1), object)
    rows = (top.subfigures(1, 2), bottom.subfigures(1, 3, width_ratios=(0.9, 1, 1.1)))
    places = [place for row in rows for place in np.ravel(np.asarray(row, object))]
    for place, (_, fill) in zip(places, FIGURES.values(), strict=True):
        fill(place, case)
    return drawn


def _sections(figure: Figure | SubFigure, case: TurnCase) -> None:
    """Fig. 7: planes that cut the pipe during a turn about the crotch, and their ellipses."""
    import matplotlib

    cut, shapes = figure.subplots(1, 2, width_ratios=(1, 1.15))
    half, radius = case.turn_angle / 2, case.pipe_radius * _MM
    tilts = np.linspace(0, half, 4)
    colours = matplotlib.colormaps["viridis"](np.linspace(0.05, 0.85, len(tilts)))
    # The inner corner of the mitre, about which the robot turns.
    crotch = radius * np.array([1.0, -np.tan(half)])
    _draw_tee(cut, radius, case.turn_angle)
    for tilt, colour in zip(tilts, colours, strict=True):
        outer = crotch + 2 * radius / np.cos(tilt) * np.array([-np.cos(tilt), np.sin(tilt)])
        cut.plot(*np.stack([crotch, outer], axis=-1), color=colour, lw=2)
        a, b = (float(axis) for axis in section_ellipse(radius, tilt))
        label = f"{np.degrees(tilt):.0f}°, {np.sin(tilt):.2f}"
        shapes.plot(a * np.cos(_CIRCLE), b * np.sin(_CIRCLE), color=colour, lw=1.6, label=label)
    cut.plot(*crotch, "o", color=INK, ms=4)
    cut.annotate("crotch", crotch, (6, -11), textcoords="offset points", color=INK)
    reach = case.reach * _MM
    shapes.plot(
        reach * np.cos(_CIRCLE),
        reach * np.sin(_CIRCLE),
        color=ALARM,
        ls=(0, (4, 2)),
        label=f"reach {reach:.1f} mm",
    )
    shapes.legend(
        title="tilt, eccentricity",
        loc="upper center",
        bbox_to_anchor=(0.5, -0.1),
        ncols=2,
        fontsize=8,
    )
    for axis, title in (
        (cut, "(a) Cuts through the turn [mm]"),
        (shapes, "(b) Sections of the cut pipe [mm]"),
    ):
        _square(axis, title)


def _draw_tee(axis: Axes, radius: float, turn_angle: float) -> None:
    """Walls of run and branch in the plane of the turn."""
    tangent, length = np.tan(turn_angle / 2), 2.3 * radius
    along = np.array([np.sin(turn_angle), np.cos(turn_angle)])  # of the branch, in (x, z)
    inner, outer = radius * np.array([1, -tangent]), radius * np.array([1, 1 / tangent])
    axis.plot([-radius, -radius], [-length, length], color=GREY, lw=2)
    for corner, run_end in ((inner, -length), (outer, length)):
        end = corner + along * max(0.0, length - corner @ along)
        axis.plot([end[0], corner[0], radius], [end[1], corner[1], run_end], color=GREY, lw=2)


def _orientations(figure: Figure | SubFigure, case: TurnCase) -> None:
    """Fig. 8: the worst and the best orientation in the section of the tee square to the robot."""
    best, worst = case.best, float(worst_theta5(case.modules))
    # Steps of half a degree in a right angle are enough for a picture.
    path = case.path(181)
    outer = wall_distance(path, np.pi, case.pipe_radius, case.contact_length)
    lost = np.flatnonzero(outer > case.reach)
    # Where the outer wall is never missing, the middle of the turn.
    pose = int(np.median(lost)) if len(lost) else len(outer) // 2
    there = TeePath(path.centre[[pose]], path.axis[[pose]], path.turn_angle)
    section = (
        # Through the open branch the section has no end: it is drawn up to 2.6 R.
        np.minimum(wall_distance(there, _CIRCLE, case.pipe_radius, 0.0)[0], 2.6 * case.pipe_radius)
        * _MM
    )
    reach, turned = case.reach * _MM, np.degrees(path.turned[pose])
    for axis, theta5, name in zip(
        figure.subplots(1, 2), (worst, best), ("(a) Worst", "(b) Best"), strict=True
    ):
        axis.fill(section * np.cos(_CIRCLE), section * np.sin(_CIRCLE), fc="white", ec=GREY, lw=2)
        axis.plot(
            reach * np.cos(_CIRCLE), reach * np.sin(_CIRCLE), color=ALARM, lw=0.9, ls=(0, (4, 2))
        )
        angles = theta5 + 2 * np.pi * np.arange(case.modules) / case.modules
        walls = case.wall_distance(there, np.array([theta5]))[0, 0] * _MM
        for k, (angle, wall) in enumerate(zip(angles, walls, strict=True)):
            _draw_module(axis, angle, wall, reach, COLOURS[k % len(COLOURS)])
        _turning_arrow(axis, reach)
        axis.set_xlim(-1.06 * section.max(), 1.62 * reach)
        missing = walls.max() - reach
        state = (
            f"a module is {missing:.0f} mm short of the wall"
            if missing > 0
            else "all modules touch"
        )
        axis.set_xlabel(f"theta5 = {np.degrees(theta5):.0f}°: {state}")
        _square(axis, f"{name} orientation, turned {turned:.0f}° [mm]")


def _draw_module(axis: Axes, angle: float, wall: float, reach: float, colour: Any) -> None:
    """A module at its reach, or at the wall if that is nearer, with the gap marked."""
    outward = np.array([np.cos(angle), np.sin(angle)])
    # A module stops at the wall, or where its springs end.
    tip, size = min(wall, reach), 0.25 * reach
    axis.plot(*np.outer(outward, [0, tip - size]), color=GREY, lw=3, solid_capstyle="round")
    middle = outward * (tip - size)
    axis.fill(
        *(middle[:, None] + size * np.array([np.cos(_CIRCLE), np.sin(_CIRCLE)])),
        fc=colour,
        ec="none",
        alpha=0.9,
    )
    if wall > reach:
        axis.plot(*np.outer(outward, [reach, min(wall, 2.6 * reach)]), color=ALARM, lw=3)


def _sector(figure: Figure | SubFigure, case: TurnCase) -> None:
    """Fig. 9: the region on the circle at the end of the turn, with the best orientation."""
    axis = figure.subplots()
    radius, half, margin = case.pipe_radius * _MM, case.sector / 2, case.margin
    if half > 0:
        arc = np.pi + np.linspace(-half, half, 181)
        rim = np.concatenate([[[0, 0]], radius * np.stack([np.cos(arc), np.sin(arc)], axis=-1)])
        axis.fill(*rim.T, fc=SECTOR_COLOUR, ec="none", alpha=0.85)
        axis.text(
            -0.52 * radius,
            0,
            f"{np.degrees(case.sector):.2f}°",
            ha="center",
            va="center",
            color=INK,
        )
    axis.plot(radius * np.cos(_CIRCLE), radius * np.sin(_CIRCLE), color=GREY, lw=2)
    for k in range(case.modules):
        angle, colour = case.best + 2 * np.pi * k / case.modules, COLOURS[k % len(COLOURS)]
        for side in (-margin, margin):
            line = np.outer([np.cos(angle + side), np.sin(angle + side)], [0, radius])
            axis.plot(*line, color=colour, lw=0.8, ls=(0, (3, 2)))
        middle = np.outer([np.cos(angle), np.sin(angle)], [0, radius])
        axis.plot(*middle, color=colour, lw=2)
        axis.plot(*middle[:, 1], "o", color=colour, ms=9)
    _turning_arrow(axis, radius)
    failure = 100 * float(failure_rate(case.sector, case.modules))
    text = f"±{np.degrees(margin):.2f}° of theta5 safe, failure rate {failure:.2f} %"
    axis.set_xlabel(text if margin > 0 else "no safe orientation")
    _square(axis, "Sector on the end of the turn [mm]")


def _definitions(figure: Figure | SubFigure, case: TurnCase) -> None:
    """Sector over reach: the three definitions and the real geometry."""
    axis = figure.subplots()
    radius = case.pipe_radius
    # To beyond R / cos(delta / 2), from which on the ellipse has no sector.
    rho = radius * np.linspace(1.0, max(1.45, 1.05 / np.cos(case.turn_angle / 2)), 241)
    path = case.path(721)
    # A point and the robot's own contact line: the length of the modules makes the difference.
    for length, colour in ((0.0, "#8fb6dc"), (case.contact_length, MODULE_COLOURS[1])):
        real = outer_sector(path, rho, radius, length)
        axis.plot(
            rho * _MM,
            np.degrees(real),
            color=colour,
            lw=2.2,
            alpha=0.9,
            label=f"real, L = {length * _MM:.0f} mm",
        )
    for name, dashes in zip(DEFINITIONS, ("-", (0, (5, 2)), (0, (1, 1.5))), strict=True):
        sector = sector_angle(radius, rho, case.turn_angle, name)
        axis.plot(rho * _MM, np.degrees(sector), color=INK, ls=dashes, lw=1.5, label=name)
    period = 360 / case.modules
    axis.axhline(period, color=ALARM, lw=0.9)
    axis.annotate(
        "above: no safe orientation",
        (rho[-1] * _MM, period),
        (-2, 3),
        textcoords="offset points",
        ha="right",
        color=ALARM,
        fontsize=8,
    )
    axis.axvline(case.reach * _MM, color=GREY, lw=0.9, ls=(0, (4, 2)))
    axis.plot([case.reach * _MM], [np.degrees(case.sector)], "o", color=INK, ms=5)
    axis.set_title("Singular sector over reach", loc="left")
    axis.set_xlabel("reach [mm]")
    axis.set_ylabel("[deg]")
    axis.set_ylim(0, 200)
    axis.margins(x=0)
    axis.legend(fontsize=8, loc="lower left")


def _map(figure: Figure | SubFigure, case: TurnCase) -> None:
    """Draw the distance of the wall beyond the worst module, over theta5 and turned angle."""
    axis = figure.subplots()
    path, angles = case.path(181), case.orientations(241)
    distance = case.wall_distance(path, angles)
    # Where a module looks through an open end the wall is infinitely far: the scale ends at 20 mm.
    beyond = np.clip((distance.max(axis=-1) - case.reach) * _MM, -20, 20)  # (T, M)
    theta5, turned = np.degrees(angles), np.degrees(path.turned)
    mesh = axis.pcolormesh(
        theta5, turned, beyond, cmap="RdBu_r", vmin=-20, vmax=20, shading="nearest", rasterized=True
    )
    if beyond.min() < 0 < beyond.max():
        axis.contour(theta5, turned, beyond, levels=[0], colors=INK, linewidths=1.2)
    for side in (-case.margin, case.margin):
        axis.axvline(np.degrees(case.best + side), color=INK, lw=1, ls=(0, (4, 2)))
    bar = figure.colorbar(mesh, ax=axis, shrink=0.9, extend="both")
    bar.set_label("wall beyond the reach of the worst module [mm]")
    bar.outline.set_visible(False)  # type: ignore[operator]
    axis.grid(False)
    axis.set_title(
        f"Real geometry, L = {case.contact_length * _MM:.0f} mm; dashed: safe by {case.definition}",
        loc="left",
    )
    axis.set_xlabel("theta5 [deg]")
    axis.set_ylabel("turned [deg]")


def _turning_arrow(axis: Axes, length: float) -> None:
    axis.annotate(
        "", (1.32 * length, 0), (1.06 * length, 0), arrowprops={"arrowstyle": "-|>", "color": INK}
    )
    axis.text(1.36 * length, 0, "turn", va="center", color=INK)
    axis.set_xlim(-1.12 * length, 1.62 * length)


def _square(axis: Axes, title: str) -> None:
    axis.set_title(title, loc="left")
    axis.set_aspect("equal")
    axis.grid(False)


FIGURES: dict[str, tuple[tuple[float, float], Any]] = {
    "sections": ((8.5, 4.6), _sections),
    "orientations": ((8.5, 4.0), _orientations),
    "sector": ((4.6, 4.4), _sector),
    "definitions": ((5.4, 4.4), _definitions),
    "map": ((6.2, 4.4), _map),
}
"""Figures by name: size in inches and drawing function."""
