"""Missions with an unknown map, and the true networks, by which they are judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.autonomy.mission import Mission
from omnitrack_sim.base.errors import Fault, NetworkError
from omnitrack_sim.base.rotations import Array, Pose, length
from omnitrack_sim.pipes import Arcs, Part, Port
from omnitrack_sim.pipes.map_difference import MapDifference, compare_maps
from omnitrack_sim.pipes.network import Network, both_ways
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.robots.robot import Robot

if TYPE_CHECKING:
    from omnitrack_sim.autonomy.explorer import Explorer


class Exploration:
    """One mission with an unknown map in its true network.

    Args:
        network: the true one.
        mission: start and what is to be found.
        robot: see ``LegPlanner``.
        distance: m, from the start port to the robot's centre as it begins.
        arcs: of the centreline in tees.

    Attributes:
        ends: ports of the start and of the goals.
        plates: ports closed by a plate.
        path: the straight in which the robot begins.

    Raises:
        NetworkError: see ``Mission.ports_in``, or the robot does not begin in a straight.
    """

    def __init__(
        self, network: Network, mission: Mission, robot: Robot, distance: float, arcs: Arcs
    ) -> None:
        self.network, self.mission, self.robot, self.arcs = network, mission, robot, arcs
        self.ends, self.plates = mission.ports_in(network)
        self._distance = distance
        part, port = self.ends[0]
        fitting = network.pipes.parts[part].fitting
        if not fitting.is_plain:
            article = "an" if fitting.kind[0] in "aeiou" else "a"
            problem = (
                f"is in {article} {fitting.kind}; a robot begins to explore in a straight pipe"
            )
            raise NetworkError(Fault("start", problem))
        self.path: tuple[Edge, ...] = tuple(
            (part, port, leave) for leave in fitting.port_names if leave != port
        )

    def in_sight(self) -> tuple[list[Part], list[Port]]:
        """Return what is visible from any position that the robot can reach.

        The parts, and those of their ports that a plate closes: numbers are those of the parts
        returned.
        """
        # A plate closes both ports of its joint, and hides all that lies behind it.
        parts, joined = self.network.pipes.parts, both_ways(self.network.pipes.joints)
        plates = {*self.plates, *(joined[end] for end in self.plates if end in joined)}
        reachable, todo = {self.ends[0][0]}, [self.ends[0][0]]
        while todo:
            part = todo.pop()
            ends = {(part, port) for port in parts[part].fitting.port_names} - plates
            new = {joined[end][0] for end in ends if end in joined} - reachable
            reachable |= new
            todo += new
        numbers = {part: i for i, part in enumerate(sorted(reachable))}
        return (
            [parts[part] for part in numbers],
            [(numbers[part], port) for part, port in sorted(plates) if part in numbers],
        )

    def explorer(self, number: int, falls: int) -> Explorer:
        """Return the pilot of one robot, which knows its pose and the pipe up to its nose.

        Args:
            number: of the robot in its batch.
            falls: how often it may fall, see ``Explorer``.
        """
        port = self._port(self.ends[0])
        fitting = self.network.pipes.parts[self.ends[0][0]].fitting
        # Ports point outward; the robot's map begins with the z axis into the pipe.
        into = Pose(port.rotation * [1, -1, -1], port.position)
        # Recognising fittings takes as long to import as running a scenario, and few explore.
        from omnitrack_sim.autonomy.explorer import Explorer
        from omnitrack_sim.autonomy.looks import LOOKS

        free = self._distance + self.robot.length / 2 + LOOKS.step
        belief = Belief(into, fitting.inner_diameter, free)
        goals = list(self.mission.goals)
        return Explorer(self.robot, number, self.arcs, belief, goals, self._distance, falls)

    def goal_at(self, nose: Array) -> str:
        """Return the name of the goal at a robot's nose (3,) m, world frame; "" at none."""
        goals = zip(self.mission.goals, self.ends[1:], strict=True)
        return next((name for name, end in goals if self._is_at(end, nose)), "")

    def is_home(self, position: Array, axis: Array) -> bool:
        """Return whether a robot stands at the start, with either end.

        Its centre is at ``position`` (3,) m, world frame, and ``axis`` (3,) is a unit vector to its
        nose.
        """
        half = self.robot.length / 2 * axis
        return any(self._is_at(self.ends[0], position + side * half) for side in (1.0, -1.0))

    def difference(
        self, believed: Network, stds: Mapping[str, Mapping[str, float]] | None = None
    ) -> MapDifference:
        """Return the differences of a map from the reachable part of the network.

        For ``stds`` see ``compare_maps``.
        """
        plates = [self.network.port_name(end) for end in self.plates]
        start = self.network.port_name(self.ends[0])
        return compare_maps(believed, self.network, start, plates, stds)

    def points(self) -> Sequence[Array]:
        """Return the positions (3,) m of the goals, or else of the start."""
        return [self._port(end).position for end in self.ends[1:] or self.ends]

    def _port(self, end: Port) -> Pose:
        return self.network.pipes.parts[end[0]].port(end[1])

    def _is_at(self, end: Port, tip: Array) -> bool:
        """Return whether a tip of the robot is within a bore's radius of a port."""
        radius = self.network.pipes.parts[end[0]].fitting.port_radius(end[1])
        return float(length(self._port(end).position - tip)) < radius
