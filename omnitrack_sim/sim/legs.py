"""The legs that n robots drive, as their pilots decide."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pilots import Decision, Pilot
from omnitrack_sim.base.rotations import set_rows
from omnitrack_sim.pipes import Route
from omnitrack_sim.pipes.network import Network, both_ways
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.pipes.routes import Edge


class Legs:
    """Legs of n robots, each chosen by a pilot.

    The arrays are replaced when they change, never written into: records and observations keep
    them.

    Args:
        pilots: n, one for each robot.

    Attributes:
        pilots: of the robots.
        routes: of all legs so far.
        route: (n,) number in ``routes`` of each robot's route.
        number: (n,) legs done so far.
        gear: (n,) 1 nose first, -1 tail first.
        end: (n,) m, arc length along the route where the leg at hand is over.
        near: (n,) m, last estimated arc length of each robot, or the beginning of its leg.
        look_at: (n,) m, arc length where each robot looks ahead next; infinite where it does not.
    """

    def __init__(self, pilots: Sequence[Pilot]) -> None:
        n = len(pilots)
        self.pilots = list(pilots)
        self.routes = RouteMap()
        self.route: NDArray[np.intp] = np.zeros(n, np.intp)
        self.number, self.gear = np.zeros(n, int), np.ones(n, int)
        self.end, self.near, self.look_at = np.zeros((3, n))
        self._numbers: dict[Hashable, int] = {}
        self._begun: list[list[Leg]] = [[] for _ in pilots]
        self.reset(np.arange(n), pilots)

    def reset(self, rows: NDArray[np.intp], pilots: Sequence[Pilot]) -> None:
        """Put robots ``rows`` (k,) onto the first legs of new ``pilots`` (k)."""
        new: list[Route] = []
        number = np.zeros(len(rows), np.intp)
        for i, pilot in enumerate(pilots):
            key = pilot.route_key
            if key not in self._numbers:
                self._numbers[key] = len(self.routes.routes) + len(new)
                new.append(pilot.route())
            number[i] = self._numbers[key]
            self.pilots[rows[i]], self._begun[rows[i]] = pilot, [pilot.leg]
        self.routes.add(new)
        legs = [pilot.leg for pilot in pilots]
        set_rows(self, rows, route=number, number=0, gear=[leg.gear for leg in legs])
        set_rows(self, rows, end=[leg.end for leg in legs], near=[leg.begin for leg in legs])
        set_rows(self, rows, look_at=[pilot.looks_at for pilot in pilots])

    def follow(self, robot: int, decision: Decision) -> float:
        """Put a robot onto the leg that its pilot has decided for.

        Returns:
            The length of pipe, m, that the robot has before it and had not before: of a leg that
            goes on what it has grown by, of another one that of its whole route.
        """
        pilot, leg, row = self.pilots[robot], decision.leg, np.array([robot])
        set_rows(self, row, look_at=pilot.looks_at)
        before = float(self.routes.lengths[self.route[robot]])
        if leg is not None and leg != self._begun[robot][-1]:
            if decision.same_leg:
                self._begun[robot][-1] = leg
            else:
                self._begun[robot].append(leg)
                set_rows(self, row, number=self.number[robot] + 1, gear=leg.gear, near=leg.begin)
            set_rows(self, row, end=leg.end, route=self._number_of(pilot))
        length = float(self.routes.lengths[self.route[robot]])
        return max(length - before, 0.0) if decision.same_leg else length

    def _number_of(self, pilot: Pilot) -> int:
        """The number of the route of a pilot's leg, which is added where it is new."""
        key = pilot.route_key
        if key not in self._numbers:
            self._numbers[key] = len(self.routes.routes)
            self.routes.add([pilot.route()])
        return self._numbers[key]

    def rights(self, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which of robots ``rows`` (k,) right themselves where they lean over."""
        return np.array([self.pilots[row].rights_itself for row in rows.tolist()], bool)

    def begun(self, robot: int) -> tuple[Leg, ...]:
        """Return the legs that a robot has begun, less those that nobody planned."""
        legs, network = [leg for leg in self._begun[robot] if leg.path], self.map(robot)
        return tuple(legs if network is None else (_on_map(leg, network) for leg in legs))

    def map(self, robot: int) -> Network | None:
        """Return the map that a robot makes; None where it makes none."""
        belief = self.pilots[robot].belief
        return None if belief is None else belief.network

    def map_stds(self, robot: int) -> dict[str, dict[str, float]]:
        """Return the standard deviations of the sizes on that map; see ``Belief.stds``."""
        belief = self.pilots[robot].belief
        stds = {} if belief is None else belief.stds
        return {name: dict(sizes) for name, sizes in stds.items() if sizes}


def _on_map(leg: Leg, network: Network) -> Leg:
    """Return a leg with that stretch of its path which is on a map.

    Pipe that a robot assumed to be there, or saw from afar, may have been taken back since.
    """
    parts, joined = network.pipes.parts, both_ways(network.pipes.joints)
    path: list[Edge] = []
    for part, enter, leave in leg.path:
        ports = parts[part].fitting.port_names if part < len(parts) else ()
        if not {enter, leave} <= set(ports):
            if path:
                break
            continue
        if path and joined.get((path[-1][0], path[-1][2])) != (part, enter):
            break
        path.append((part, enter, leave))
    return replace(leg, path=tuple(path))
