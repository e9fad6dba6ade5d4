"""Notices that robots have been sent onto another leg."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.robots.omnitrack.control.interface import Observation


class LegWatch:
    """Compares the legs of one observation with those of the one before.

    Attributes:
        grown: routes have been added since the observation before: what was looked up in them has
            to be looked up again.
        longer: robots whose leg goes on, on a route that begins as the one before, and how many
            passages later that route's are counted.
    """

    def __init__(self, routes: RouteMap) -> None:
        self._routes, self._version = routes, routes.version
        self._leg: NDArray[np.int_] | None = None
        self._gear: NDArray[np.int_] | None = None
        self._way: NDArray[np.intp] | None = None
        self.grown = False
        self.longer: list[tuple[int, int]] = []

    def changes(self, observation: Observation) -> list[tuple[int, bool]]:
        """Robots on another leg than before, and whether each drives in the other gear now."""
        leg, gear = self._leg, self._gear
        self.grown = self._routes.version != self._version
        self._version = self._routes.version
        way, self._way = self._way, observation.place.way
        self.longer = []
        if leg is observation.leg and way is self._way:
            return []
        self._leg, self._gear = observation.leg, observation.gear
        if leg is None or gear is None or way is None:
            return []
        same = leg == observation.leg
        first = self._routes.first
        self.longer = [
            (robot, int(first[self._way[robot]] - first[way[robot]]))
            for robot in np.flatnonzero(same & (way != self._way)).tolist()
        ]
        robots = np.flatnonzero(~same).tolist()
        return [(robot, bool(gear[robot] != observation.gear[robot])) for robot in robots]
