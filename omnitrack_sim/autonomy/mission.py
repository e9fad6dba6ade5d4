"""Missions through networks that are known: their legs, planned."""

from __future__ import annotations

from omnitrack_sim.autonomy.goals import Mission, ports_of
from omnitrack_sim.autonomy.ways import Ways
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.pipes import ARCS, Arcs
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import Leg, shortest_way, unreachable
from omnitrack_sim.robots.omnitrack import Robot


class Planner(Ways):
    """Plans the legs of one mission.

    Args:
        network: where.
        mission: start and goals.
        robot: see ``Ways``.
        distance: m along the way from the start port to the robot's centre as it begins.
        arcs: of the centreline in tees.

    Attributes:
        ends: ports (part index, port) of start and goals.
        plates: ports closed by a plate.

    Raises:
        NetworkError: no such port or fitting, no open end, or a goal that cannot be reached;
            ``start``, ``goals.0``, ``avoid.0`` or ``blocked.0`` say which.
    """

    def __init__(
        self,
        network: Network,
        mission: Mission,
        robot: Robot,
        distance: float,
        arcs: Arcs = ARCS,
    ) -> None:
        ends, self.plates = ports_of(network, mission)
        super().__init__(network, ends, mission.goals, robot, arcs, mission.avoid)
        self.mission = mission
        way = shortest_way(self._graph, self.ends[0], self.ends[1])
        if way is None:
            raise NetworkError(_unreachable(0, mission))
        self.first = self._forward(way, distance, 0)
        self._planned = [self.first]

    def plan(self) -> tuple[Leg, ...]:
        """The legs to all goals if nothing is in the way.

        Raises:
            NetworkError: a goal cannot be reached from the one before it.
        """
        for goal in range(self._planned[-1].goal + 1, len(self.mission.goals)):
            legs = self.onward(self._planned[-1], self._planned[-1].end, goal, ())
            if legs is None:
                raise NetworkError(_unreachable(goal, self.mission))
            self._planned += legs
        return tuple(self._planned)


def _unreachable(goal: int, mission: Mission) -> Fault:
    before = mission.goals[goal - 1] if goal else mission.start
    return unreachable(f"goals.{goal}", before, mission.goals[goal], mission.avoid)
