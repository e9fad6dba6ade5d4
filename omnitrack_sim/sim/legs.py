"""The legs that n robots drive: the one at hand, those to come, and new ones where the way is
blocked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnitrack_sim.control.guide import Guide
from omnitrack_sim.network import Leg
from omnitrack_sim.network.layout import End
from omnitrack_sim.pipes import Route
from omnitrack_sim.scenario import Scenario


class Legs:
    """Legs of n robots. A robot in plain pipes has one leg, its route.

    Attributes:
        routes: of the first legs, each once. way: (n,) which of them each robot begins on.
        number: (n,) legs done so far. gear: (n,) 1 nose first, -1 tail first.
        end: (n,) m, arc length along the way where the leg at hand is over.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self._planners = [scenario.planner for scenario in scenarios]
        self._driven: list[list[Leg]] = [[] if p is None else [p.first] for p in self._planners]
        self._to_come: list[list[Leg]] = [[] for _ in scenarios]
        self._closed: list[list[End]] = [[] for _ in scenarios]
        self._way_numbers: dict[object, int] = {}
        self.routes: list[Route] = []
        self.way = np.zeros(len(scenarios), np.intp)
        for i, scenario in enumerate(scenarios):
            key = self._driven[i][0].way if self._driven[i] else None
            if key not in self._way_numbers:
                self._way_numbers[key] = len(self.routes)
                self.routes.append(scenario.route())
            self.way[i] = self._way_numbers[key]
        self.number = np.zeros(len(scenarios), int)
        self.gear = np.ones(len(scenarios), int)
        self.end = np.array([s.goal_distance for s in scenarios])

    def next_of(self, robot: int, distance: float, arrived: bool) -> tuple[Leg | None, list[str]]:
        """The leg that follows for a robot at arc length ``distance`` m, and what there is to tell
        about it.

        Args:
            robot: index.
            distance: m, along its way.
            arrived: at the end of its leg; otherwise it makes no headway.
        """
        planner = self._planners[robot]
        if planner is None:
            return None, []
        leg, told = self._driven[robot][-1], []
        if arrived and self._to_come[robot]:
            legs: list[Leg] | None = self._to_come[robot]
        elif arrived:
            if leg.goal + 1 == len(planner.mission.goals):
                return None, []
            told.append(f"reached {planner.mission.goals[leg.goal]}")
            legs = planner.onward(leg, distance, leg.goal + 1, self._closed[robot])
        elif leg.gear < 0:
            return None, ["no headway while backing out: gives up"]
        else:
            port = planner.obstacle(leg, distance)
            self._closed[robot].append(port)
            told.append(
                f"no headway at {distance:.3f} m: takes {planner.network.port_name(port)} for "
                "closed"
            )
            legs = planner.onward(leg, distance, leg.goal, self._closed[robot])
        if not legs:
            return None, [*told, "no other way: gives up"]
        following, *self._to_come[robot] = legs
        self._driven[robot].append(following)
        self.number[robot] += 1
        self.gear[robot], self.end[robot] = following.gear, following.end
        return following, [*told, following.note]

    def way_of(self, robot: int, guide: Guide) -> int:
        """The number that the guide gives the way of a robot's leg, added where it is a new one."""
        leg, planner = self._driven[robot][-1], self._planners[robot]
        assert planner is not None
        if leg.way not in self._way_numbers:
            self._way_numbers[leg.way] = guide.add(planner.route(leg))
        return self._way_numbers[leg.way]

    def missed(self, robot: int) -> tuple[str, ...]:
        """The goals of a robot's mission that its legs so far do not lead to; none in plain
        pipes."""
        planner = self._planners[robot]
        reached = [leg.goal for leg in self._driven[robot] if leg.goal >= 0]
        return () if planner is None else planner.mission.goals[reached[-1] + 1 :]

    def driven(self, robot: int) -> tuple[Leg, ...]:
        """The legs that a robot has begun."""
        return tuple(self._driven[robot])
