"""Ranges of theta5 that fittings ask for, and how they go together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, wrap_angle
from omnitrack_sim.pipes.fittings.base import Manoeuvre
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.robots.control import ControlSetup
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.robots.omnitrack.singularity import best_theta5, safe_margin, sector_angle

AIMS = 3
"""Number of half-widths of a range that are tried, the narrowest first."""
SIDES = 2
"""Number of ranges of theta5 of one aim: one on either side of the best orientation."""
BY_IMPORTANCE: tuple[Manoeuvre, ...] = ("tee_turn", "tee_straight", "elbow")


def preferred_theta5(manoeuvre: Manoeuvre, modules: int = MODULES) -> float:
    """The orientation, rad, to reach before a fitting.

    theta5 is measured from the turning direction, or from the opening of the tee.

    * ``elbow``: one module on the innermost curve (Fig. 15);
    * ``tee_turn``: the outer direction midway between two modules (Fig. 8(b), Fig. 9);
    * ``tee_straight``: the opening midway between two modules, on either side of it (Fig. 17).

    Raises:
        InputError: there is no such manoeuvre.
    """
    orientations = {
        "elbow": 0.0,
        "tee_turn": float(best_theta5(modules)),
        "tee_straight": np.pi / modules,
    }
    if manoeuvre not in orientations:
        raise InputError(Fault("manoeuvre", f"is {manoeuvre!r}", tuple(orientations), manoeuvre))
    return orientations[manoeuvre]


def orientation_error(theta5: ArrayLike, best: ArrayLike, modules: int = MODULES) -> Array:
    """Angle (...,) rad from the nearest of the equal best orientations.

    In [-period / 2, period / 2).
    """
    return wrap_angle(np.asarray(theta5, float) - best, 2 * np.pi / modules)


class OrientationRange(NamedTuple):
    """A range of theta5 that a fitting asks for.

    Attributes:
        best: (n,) rad, or one for all, middle of the range, modulo the period.
        margin: (n,) rad to either side.
    """

    best: float | Array
    margin: Array


def intersect(ranges: Sequence[OrientationRange], modules: int = MODULES) -> tuple[Array, Array]:
    """Intersect ranges of theta5.

    The first range always counts. Each of the others narrows it, in order, and is left out for a
    robot for which nothing would be left.

    Returns:
        Middle (n,) and half-width (n,) of the intersection, rad.
    """
    first = ranges[0]
    low, high = -first.margin, np.array(first.margin)
    for best, margin in ranges[1:]:
        centre = orientation_error(best, first.best, modules)
        new_low, new_high = np.maximum(low, centre - margin), np.minimum(high, centre + margin)
        common = new_low <= new_high
        low, high = np.where(common, new_low, low), np.where(common, new_high, high)
    return first.best + (low + high) / 2, (high - low) / 2


def manoeuvres(routes: RouteMap) -> tuple[Manoeuvre | None, ...]:
    """Manoeuvre of each passage of the routes; None after the last one of a route."""
    return tuple(None if p is None else p.manoeuvre for p in routes.passages)


def keeps_the_wall(setup: ControlSetup) -> NDArray[np.bool_]:
    """Robots (n,) whose springs press both outer modules to the wall throughout a tee turn.

    From the best orientation; those of others do not reach far enough.
    """
    robot = setup.robot
    radius = robot.nominal_pipe_radius
    reach = radius + setup.own("preload") / robot.module_stiffness
    return safe_margin(sector_angle(radius, reach, np.pi / 2)) > 0


class OrientationRanges:
    """Ranges of theta5 of n robots for each of Q passages, which ``update`` computes beforehand.

    Fittings that follow each other with less room between than the robot needs to stand in are
    prepared for together, before the first of them: a tee turn comes first, then a tee to be passed
    straight, then elbows. What cannot be met beforehand is made up for on the way.

    Args:
        setup: of the controller.
        aims: (n, AIMS) half-widths for each manoeuvre, as parts of the safe margin.
        aside: (n, AIMS) distances from the best orientation for a turn into a branch, likewise.

    Attributes:
        best, half_width: (AIMS, SIDES, n, Q) rad, of the ranges.
        any_goes: (Q,) bool, passages that are driven in any orientation if need be.
    """

    def __init__(self, setup: ControlSetup, aims: Mapping[Manoeuvre, Array], aside: Array) -> None:
        self._routes, self._robot = setup.routes, setup.robot
        self._margin, self._aims, self._aside = setup.settings.safe_margin, aims, aside
        self.update()

    def update(self) -> None:
        """Compute the ranges of all passages, as where routes have been added.

        The safe margin is that of a right-angled corner, whatever the angle of the branch. With the
        angle put in, the region has no sector below 67 degrees and no safe orientation above 106,
        while wyes are passed, at 60 degrees as at 135, by about the orientations that pass a tee
        (docs/studies/wye.md).
        """
        routes, required = self._routes, manoeuvres(self._routes)
        fixed = self._margin[:, None]
        sector = sector_angle(routes.corner_radius, self._robot.reach, np.pi / 2)
        margin = np.where(np.isnan(fixed), safe_margin(sector), fixed)  # (n, Q) rad
        self.best, self.half_width = np.zeros((2, AIMS, SIDES, *margin.shape))
        self.any_goes = np.array([m in ("elbow", "tee_straight") for m in required])
        for q, manoeuvre in enumerate(required):
            if manoeuvre is None:
                continue
            together = self._together(q, manoeuvre, required)
            centres = [
                preferred_theta5(wanted) - self._turned_between(q, p) for p, wanted in together
            ]
            for i in range(AIMS):
                widths = [self._aims[wanted][:, i] * margin[:, p] for p, wanted in together]
                ranges = list(map(OrientationRange, centres, widths))
                sides = self._to_the_sides(together[0][0], ranges[0], i, margin)
                for j, first in enumerate(sides):
                    middle, half = intersect([first, *ranges[1:]])
                    self.best[i, j, :, q], self.half_width[i, j, :, q] = middle, half

    def _to_the_sides(
        self, q: int, whole: OrientationRange, aim: int, margin: Array
    ) -> tuple[OrientationRange, OrientationRange]:
        """Split the range of passage ``q`` into both sides of the best orientation.

        Where the best orientation itself is allowed, the range is returned twice.
        """
        if not self._routes.into_branch[q]:
            return whole, whole
        aside = np.minimum(self._aside[:, aim] * margin[:, q], whole.margin)
        # A side reaches from ``aside`` to the margin.
        middle = np.where(aside > 0, (whole.margin + aside) / 2, 0.0)
        half = whole.margin - middle
        return (
            OrientationRange(whole.best + middle, half),
            OrientationRange(whole.best - middle, half),
        )

    def _together(
        self, q: int, manoeuvre: Manoeuvre, required: Sequence[Manoeuvre | None]
    ) -> list[tuple[int, Manoeuvre]]:
        """Passage ``q`` and those that follow it closely, the one that matters most first."""
        together: list[tuple[int, Manoeuvre]] = [(q, manoeuvre)]
        for p in range(q + 1, len(required)):
            following = required[p]
            # With less room between, a robot that stands before the later fitting is still in the
            # earlier.
            room = self._robot.length + self._robot.standing_room
            if following is None or self._room_between(p - 1) >= room:
                break
            together.append((p, following))
        # The first range always counts: that of the most important passage.
        together.sort(key=lambda passage: BY_IMPORTANCE.index(passage[1]))
        return together

    def _room_between(self, passage: int) -> float:
        """Length, m, of the way from the end of a passage to the start of the next one."""
        return float(self._routes.start[passage + 1] - self._routes.end[passage])

    def _turned_between(self, first: int, later: int) -> float:
        """Increase of theta5, rad, from the passage ``first`` to ``later`` without twist."""
        routes, angles = self._routes, []
        for q in (first, later):
            passage = routes.passages[q]
            assert passage is not None
            entry = np.array([passage.s_enter])
            frame = routes.centreline.frame(entry, routes.route_of[[q]])[0]
            # The frame is carried along the centreline without twist, as a robot that does not roll
            # is.
            x, y, _ = routes.directions[q] @ frame
            angles.append(np.arctan2(y, x))
        return float(angles[0] - angles[1])
