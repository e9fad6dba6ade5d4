"""Pilot over a map that grows: the leg at hand stays one on the map as that changes under it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from omnitrack_sim.autonomy.belief import BELIEF, Belief
from omnitrack_sim.autonomy.leg_planner import LegPlanner
from omnitrack_sim.autonomy.looks import LookRecord, provisional_passage
from omnitrack_sim.autonomy.pilots import MapPilot
from omnitrack_sim.pipes import Arcs, Passage, Port
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.robots.robot import Robot


class MappingPilot(MapPilot):
    """Drives legs over a map that the robot makes as it goes.

    Args:
        robot: the robot.
        number: its index in the batch, for events.
        arcs: of the centreline in tees.
        belief: its map.
        distance: m, from the port where it began to its centre then.
        falls: how often it may fall off its route.

    Attributes:
        robot: the robot.
        half: m, from its centre to its ends.
        number: see above.
        doubts: why parts of the map may be wrong, by their names.
        records: of looks, which hear of other legs and of parts that are removed.
        assumed: m, of free pipe at the end of the map that no look has shown.
        look_at: m, arc length on its leg where the robot looks ahead next.
    """

    def __init__(
        self, robot: Robot, number: int, arcs: Arcs, belief: Belief, distance: float, falls: int
    ) -> None:
        super().__init__(number, falls)
        self.robot, self.half, self.number = robot, robot.length / 2, number
        self._arcs, self._belief = arcs, belief
        self.doubts: dict[str, str] = {}
        self.records: tuple[LookRecord, ...] = ()
        self.assumed = 0.0
        self.planner = self.planner_to([])
        self.leg = self._to_path_end(Leg(((0, "start", "end"),), 1, distance, 0.0, 0, ""))
        self.look_at = distance

    @property
    def belief(self) -> Belief:
        """See ``Pilot``."""
        return self._belief

    @property
    def end(self) -> Port:
        """The port that the path of the leg at hand ends at."""
        return end_of(self.leg.path)

    def doubt(self, part: int, why: str) -> None:
        """Note why a part of the map may be wrong."""
        self.doubts[self.belief.part_name(part)] = why

    def passed(self, distance: float) -> Passage | None:
        """Return the passage that the robot has left behind at arc length ``distance`` m.

        None in the first of its leg.
        """
        route = self.route()
        i = route.index_at(distance)
        return route.passages[i - 1] if i else None

    def planner_to(self, goals: Sequence[Port]) -> LegPlanner:
        """Return the planner of legs through the present map, to some of its ports."""
        names = ["the start" if g == self.belief.start else self.belief.name(g) for g in goals]
        ends = [self.belief.start, *goals]
        return LegPlanner(self.belief.network, ends, names, self.robot, self._arcs)

    def plan_anew(self) -> None:
        """Take the map as it is now for the route of the leg at hand."""
        self.planner = self.planner_to([])

    def extend_leg_to(self, path: tuple[Edge, ...]) -> None:
        """Extend the leg at hand to the end of ``path``, which begins with its own path."""
        self.plan_anew()
        self.leg = self._to_path_end(replace(self.leg, path=path))

    def _to_path_end(self, leg: Leg) -> Leg:
        """Return a leg that ends where its path does."""
        end = self.planner.route(leg.path).length - self.half - self.robot.nose_room
        return replace(leg, end=end, note=f"to {self.belief.name(end_of(leg.path))}")

    def lengthen_leg(self, more: float) -> None:
        """Move the end of the leg, and the next look, by ``more`` m.

        So the map behind the robot has changed.
        """
        self.plan_anew()
        self.leg, self.look_at = replace(self.leg, end=self.leg.end + more), self.look_at + more

    def remove_provisional(self) -> None:
        """Remove from the map what was observed only from afar at the end of the straight ahead.

        Looks from close by replace it.
        """
        i = provisional_passage(self.belief, self.route())
        if i is None:
            return
        for part in self.belief.remove_provisional():
            for record in self.records:
                record.forget_part(part)
        self.plan_anew()
        self.leg = replace(self.leg, path=self.leg.path[: i + 1])

    def remove_assumed(self, here: int) -> None:
        """Remove free pipe that the robot has only assumed, unless its part ``here`` is that.

        When it comes again it is to look from where the fitting before that pipe ends.
        """
        *path, (part, enter, _) = self.leg.path
        fitting, name = self.belief.fitting(part), self.belief.part_name(part)
        if self.assumed == 0.0 or not path or part == here or enter != "start":
            return
        more = fitting.length_of_axes > self.assumed + BELIEF.min_length
        if more or not fitting.is_plain or not self.belief.is_removable(part):
            return
        self.belief.remove(part)
        self.assumed = 0.0
        self.doubts.pop(name, None)
        self.plan_anew()
        self.leg = replace(self.leg, path=tuple(path))


def end_of(path: Sequence[Edge]) -> Port:
    """Return the port that a path ends at."""
    part, _, leave = path[-1]
    return part, leave
