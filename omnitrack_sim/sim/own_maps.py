"""The maps by which robots with sensors of their own know their place, and how they move along
where these change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.localiser import Localiser
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Part
from omnitrack_sim.pipes.layout import End
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.walls.rays import RayWalls

MOVES = 1e-6
"""A part of a map that moves by less than this, m, has not moved: lengths are rounded to it."""


class OwnMaps:
    """The maps of n robots.

    Args:
        scenarios: of the robots. legs: of theirs.

    Attributes:
        walls: of the maps. which: (n,) map of each robot; those that do not explore share the true
            one, less its plates.
    """

    def __init__(self, scenarios: Sequence[Scenario], legs: Legs) -> None:
        n, self._legs = len(scenarios), legs
        self._known = [legs.map(robot) for robot in range(n)]  # None of those that do not explore
        if scenarios[0].exploration is None:
            self.which: NDArray[np.intp] = np.zeros(n, np.intp)
            self.walls = RayWalls([scenarios[0].route.network.parts], dirty=False)
            return
        self.which = np.arange(n)
        drawn = [self._drawn(robot) for robot in range(n)]
        parts, closed, unknown = zip(*drawn, strict=True)
        self.walls = RayWalls(parts, closed, unknown, dirty=False)

    def _drawn(self, robot: int) -> tuple[list[Part], list[End], list[End]]:
        """What a robot that explores compares its pictures with, see ``Belief.compared``."""
        belief = self._legs.belief(robot)
        assert belief is not None
        return belief.compared()

    def learn(self, robot: int, location: Location, localiser: Localiser) -> None:
        """A robot that explores, and took itself to be at ``location``, may have changed its map.
        Where the part moves that it is in, it moves along: it knows its place by what is around
        it."""
        before, after = self._known[robot], self._legs.map(robot)
        if before is None or after is None or after is before:
            return
        self._known[robot] = after
        self.walls.replace(robot, *self._drawn(robot))
        old, new = before.pipes.parts, after.pipes.parts
        if _bent(old, new):
            self._turn_with(robot, location, localiser)
            return
        here = localiser.filter.position[robot]
        for part, moved in zip(old, new, strict=False):
            if part.holds(here[None], 0.0):
                port = part.fitting.port_names[0]
                was, is_now = part.port(port), moved.port(port)
                if np.linalg.norm(is_now.position - was.position) > MOVES:
                    localiser.move(robot, was, is_now)
                return

    def shift(self, robot: int, location: Location, more: float, localiser: Localiser) -> None:
        """Move the estimate of a robot at ``location`` by ``more`` m along its route."""
        before, after = self._on_the_route(robot, location, int(location.route[robot]), more)
        localiser.move(robot, before, after)

    def _turn_with(self, robot: int, location: Location, localiser: Localiser) -> None:
        """A fitting behind a robot bends otherwise than was known: it is as far along its way as
        it was, and less sure of its place. How it is turned it knows as before: the gyro has told
        both that and the bend."""
        before, after = self._on_the_route(robot, location, int(self._legs.route[robot]), 0.0)
        localiser.move(robot, before, Pose(before.rotation, after.position))
        localiser.loosen(robot)

    def _on_the_route(
        self, robot: int, location: Location, route: int, more: float
    ) -> tuple[Pose, Pose]:
        """Poses of the centreline at a robot's ``location``, and ``more`` m on along ``route``."""
        pair = np.array([location.route[robot], route])
        along = location.distance[robot] + np.array([0.0, more])
        points, frames = self._legs.routes.poses(pair, along, np.zeros(2))
        return Pose(frames[0], points[0]), Pose(frames[1], points[1])


def _bent(old: Sequence[Part], new: Sequence[Part]) -> bool:
    """Whether a fitting other than a plain straight has another form than it had."""
    both = zip(old, new, strict=False)
    return any(a.fitting != b.fitting and not a.fitting.is_plain for a, b in both)
