"""Missions: what a user asks for in a network, and its legs where that is known."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from omnitrack_sim.autonomy.leg_planner import LegPlanner
from omnitrack_sim.base.bounds import MAX_GOALS, MAX_PARTS
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.table import Table
from omnitrack_sim.pipes import ARCS, Arcs, Port
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.pipes.planning import Leg, shortest_path, unknown_fittings, unreachable
from omnitrack_sim.robots.robot import Robot


class Mission(Table):
    """Start, goals and task in a network."""

    start: str
    """Open end where the robot begins, such as "inlet" or "riser.start"."""
    map: Literal["known", "unknown"] = "known"
    """Map that the robot has: "known", or "unknown" where it makes one of its own."""
    task: Literal["explore", "find"] | None = None
    """With an unknown map: "explore" all of it and come back, or "find" the goals."""
    goals: Annotated[tuple[str, ...], Field(max_length=MAX_GOALS)] = ()
    """Open ends, in the order they are driven to; at least one. To find: in any order. None to
    explore."""
    avoid: Annotated[tuple[str, ...], Field(max_length=MAX_PARTS)] = ()
    """Fittings that are not entered; with a known map."""
    blocked: Annotated[tuple[str, ...], Field(max_length=MAX_PARTS)] = ()
    """Ports closed by a plate that the robot does not know of."""

    def ports_in(self, network: Network) -> tuple[list[Port], tuple[Port, ...]]:
        """Return the ports of start and goals, and the ports closed by a plate or a cap.

        Raises:
            NetworkError: no such port or fitting, no open end, or map, task and goals that do not
                go together; ``start``, ``goals.0``, ``avoid.0`` or ``blocked.0`` say which.
        """
        ends, plates, faults = [], [*network.pipes.closed_ends], self._task_faults()
        for where, port in [
            ("start", self.start),
            *((f"goals.{i}", goal) for i, goal in enumerate(self.goals)),
        ]:
            try:
                ends.append(network.end(where, port))
                # The same goal may come twice, but a leg between equal ports has no length.
                if len(ends) > 1 and ends[-1] == ends[-2]:
                    faults.append(Fault(where, f"{port!r} is where the robot is already"))
            except NetworkError as error:
                faults += error.faults
        avoid = [(f"avoid.{i}", name) for i, name in enumerate(self.avoid)]
        faults += unknown_fittings(network, avoid)
        for i, port in enumerate(self.blocked):
            try:
                plates.append(network.port(port, f"blocked.{i}"))
            except NetworkError as error:
                faults += error.faults
        if faults:
            raise NetworkError(faults)
        return ends, tuple(plates)

    def _task_faults(self) -> list[Fault]:
        """Faults of map, task and goals that do not go together."""
        faults = []
        if self.map == "known" and self.task is not None:
            faults.append(Fault("task", 'is for an unknown map (mission.map = "unknown")'))
        if self.map == "unknown" and self.task is None:
            faults.append(Fault("task", "is missing with an unknown map", ("explore", "find")))
        if self.map == "unknown" and self.avoid:
            faults.append(Fault("avoid", "is for a known map: nobody avoids what he does not know"))
        if self.task == "explore" and self.goals:
            faults.append(Fault("goals", 'are for mission.task = "find"'))
        if self.task != "explore" and not self.goals:
            task = f' (mission.task = "{self.task}")' if self.task else ""
            faults.append(Fault("goals", f"must have at least 1 item, not 0{task}"))
        return faults


class MissionPlanner(LegPlanner):
    """Plans the legs of one mission.

    Args:
        network: where.
        mission: start and goals.
        robot: see ``LegPlanner``.
        distance: m along the route from the start port to the robot's centre as it begins.
        arcs: of the centreline in tees.

    Attributes:
        ends: ports (part index, port) of start and goals.
        plates: ports closed by a plate.
        first: the leg to the first goal.

    Raises:
        NetworkError: see ``Mission.ports_in``, or a goal that cannot be reached.
    """

    def __init__(
        self, network: Network, mission: Mission, robot: Robot, distance: float, arcs: Arcs = ARCS
    ) -> None:
        ends, self.plates = mission.ports_in(network)
        super().__init__(network, ends, mission.goals, robot, arcs, mission.avoid)
        self.mission = mission
        path = shortest_path(self._graph, self.ends[0], self.ends[1])
        if path is None:
            raise self._unreachable(0)
        self.first = self.leg_to(0, path, distance)
        self._planned = [self.first]

    def plan(self) -> tuple[Leg, ...]:
        """Plan the legs to all goals if nothing is in the way.

        Raises:
            NetworkError: a goal cannot be reached from the one before it.
        """
        # Legs are planned once and kept: each one starts where the one before it ends.
        for goal in range(self._planned[-1].goal + 1, len(self.mission.goals)):
            legs = self.replan(self._planned[-1], self._planned[-1].end, goal, ())
            if legs is None:
                raise self._unreachable(goal)
            self._planned += legs
        return tuple(self._planned)

    def _unreachable(self, goal: int) -> NetworkError:
        goals, avoid = self.mission.goals, self.mission.avoid
        before = goals[goal - 1] if goal else self.mission.start
        return NetworkError(unreachable(f"goals.{goal}", before, goals[goal], avoid))
