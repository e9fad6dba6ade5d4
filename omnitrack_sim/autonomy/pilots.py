"""Pilots: decide where one robot goes next, on what its senses tell.

A pilot moves nothing. It names the leg that its robot drives and answers what happens on it: the
robot has come to the leg's end, makes no headway, lies off its route, has looked ahead. Three are
shipped: ``FixedRoute`` through plain pipes, ``Planned`` for a mission whose map is known, and
``Explorer`` (``autonomy/explorer.py``) for one whose map is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from enum import Enum
from typing import NamedTuple, Protocol

from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.autonomy.leg_planner import LegPlanner, PartLocation, travel
from omnitrack_sim.autonomy.mission import MissionPlanner
from omnitrack_sim.autonomy.sight import Look
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Port, Route
from omnitrack_sim.pipes.planning import Closed, Leg
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.events import (
    Event,
    FellOff,
    GaveUp,
    GoalReached,
    LegBegan,
    Outcome,
    TakenForClosed,
)


class Hindrance(Enum):
    """Finding of the monitor that need not end a run.

    The robot makes no headway, is in no bore of its route, or leans over.
    """

    NO_HEADWAY = "no_headway"
    OFF_ROUTE = "off_route"
    LEANING = "leaning"


class Decision(NamedTuple):
    """Decision on the leg that a robot drives from now on.

    Attributes:
        leg: the leg to drive; None: there is none.
        same_leg: ``leg`` is the leg at hand, maybe extended, and not another one.
        events: to be recorded.
        shift: m, correction of the robot's estimated arc length on its leg.
        doubt: there is no leg as the robot lies in no pipe that the pilot knows: by its own
            sensors it may be elsewhere, and looks for itself before its run ends.

    Example:
        >>> ot.Decision(None).same_leg
        False
    """

    leg: Leg | None
    same_leg: bool = False
    events: Sequence[Event] = ()
    shift: float = 0.0
    doubt: bool = False


class Situation(NamedTuple):
    """Situation of a robot on which its pilot has to decide, as its senses tell it.

    Attributes:
        time: s.
        distance, distance_std: m, arc length of its centre along its leg, and standard deviation.
        goal: name of the goal of an exploration that is at the robot's nose; "" at none.
        position: (3,) m, of its centre, world frame.
        axis: (3,) unit vector to its nose, world frame.
        across: it lies across its pipe.
    """

    time: float
    distance: float
    distance_std: float
    goal: str
    position: Array
    axis: Array
    across: bool


class Pilot(Protocol):
    """Decides where one robot goes next.

    A class of a user's own that inherits from this one needs ``leg`` and ``route``; by what it
    leaves out it gives up where it could decide, and never looks ahead. Times are in s, distances
    are arc lengths of the robot's centre along its leg in m, as its senses tell them.

    Attributes:
        leg: the leg at hand.

    Example:
        >>> pilot = ot.load_scenario("straight").pilot(0)
        >>> pilot.on_arrival(9.0, pilot.leg.end, "")  # there is no further leg
        Decision(leg=None, same_leg=False, events=(), shift=0.0, doubt=False)
    """

    leg: Leg

    def route(self) -> Route:
        """Return the route of the leg at hand: its passages and centreline."""
        ...

    @property
    def route_key(self) -> Hashable:
        """Key of the leg's route; robots of a batch with equal keys share the route.

        By default no other robot has the same.
        """
        return object()

    @property
    def missed(self) -> Sequence[str]:
        """Goals of the mission that the legs so far do not lead to."""
        return ()

    def done_at(self, distance: float) -> float:
        """Estimate the part of the task, 0 to 1, done at ``distance`` m along the leg."""
        begin, end = self.leg.begin, self.leg.end
        return min(max((distance - begin) / max(end - begin, 1e-9), 0.0), 1.0)

    @property
    def unexplored(self) -> str:
        """Ports of its own map that it has given up to explore, and why; "" for none."""
        return ""

    def decide(self, found: Outcome | Hindrance, robot: Situation) -> Decision:
        """Decide on what the monitor has found, by the methods below.

        Args:
            found: an outcome, which ends the run if the pilot has no further leg; or a hindrance.
            robot: where it is.
        """
        if found is Outcome.REACHED_GOAL:
            return self.on_arrival(robot.time, robot.distance, robot.goal)
        if found is Hindrance.NO_HEADWAY:
            return self._decide_on_blockage(robot)
        if found is Hindrance.LEANING:
            return self.on_fall(robot.time, robot.position, robot.axis)
        if found is not Hindrance.OFF_ROUTE:
            return Decision(None)
        decision = self.on_fall(robot.time, robot.position, robot.axis)
        # One that explores, and has fallen too often, is where it takes itself to be: it has been
        # there.
        knows = decision.leg is not None or (self.belief is not None and decision.events)
        return decision._replace(doubt=not knows)

    def _decide_on_blockage(self, robot: Situation) -> Decision:
        """Decide where the robot makes no headway, or have it right itself first."""
        if self.rights_itself and robot.across:
            # It lies across, which no other way helps: it is to right itself.
            decision = self.on_fall(robot.time, robot.position, robot.axis)
            if decision.leg is not None:
                return decision
        # Belts that slip before an obstacle push an estimate into it.
        hangs_at = robot.distance - 2 * robot.distance_std
        decision = self.on_blockage(robot.time, hangs_at, robot.goal)
        if decision.leg is not None or not self.rights_itself or robot.across:
            return decision
        # It hangs on a leg that was planned for it as it lay before, such as across; or it is
        # elsewhere, where it takes itself to lie in no pipe.
        fallen = self.on_fall(robot.time, robot.position, robot.axis)
        if fallen.leg is not None:
            return fallen
        return decision._replace(doubt=not fallen.events)

    def on_arrival(self, time: float, distance: float, goal: str) -> Decision:
        """Decide at the end of the leg.

        Args:
            time: s.
            distance: m.
            goal: name of the goal of an exploration that is at the robot's nose; "" at none.
        """
        return Decision(None)

    def on_blockage(self, time: float, distance: float, goal: str) -> Decision:
        """Decide where the robot makes no headway; arguments as in ``on_arrival``."""
        return Decision(None)

    def on_fall(self, time: float, position: Array, axis: Array) -> Decision:
        """Decide for a robot that lies off its route.

        Args:
            time: s.
            position: (3,) m, of its centre, world frame.
            axis: (3,) unit vector to its nose, world frame.
        """
        return Decision(None)

    @property
    def rights_itself(self) -> bool:
        """Whether ``on_fall`` is also asked for a robot that leans over or lies across.

        It then rights itself before it is wedged.
        """
        return False

    # For robots that look ahead

    @property
    def looks_at(self) -> float:
        """Distance, m, where the robot looks ahead next; infinite where it does not."""
        return math.inf

    def looks_back(self, distance: float) -> bool:
        """Return whether a look at ``distance`` m goes back as well as ahead."""
        return False

    def on_look(self, look: Look) -> Decision:
        """Decide after a look ahead."""
        return Decision(self.leg, same_leg=True)

    @property
    def belief(self) -> Belief | None:
        """Map that the robot makes; None where it is given one."""
        return None


class FixedRoute(Pilot):
    """Drives one route to its goal.

    Args:
        route: through plain pipes.
        begin: m, arc length of the robot's centre at the start.
        end: m, the same at the goal.
    """

    def __init__(self, route: Route, begin: float, end: float) -> None:
        # A leg of no parts: nothing has been planned, so the result lists no leg.
        self.leg = Leg((), 1, begin, end, 0, "")
        self._route = route

    def route(self) -> Route:
        """See ``Pilot``."""
        return self._route

    @property
    def route_key(self) -> Hashable:
        """See ``Pilot``: robots of one batch share their pipes."""
        return self.leg.path


Replan = Callable[[LegPlanner, int, Closed], list[Leg] | None]
"""Plans legs to a goal around what is closed."""


class MapPilot(Pilot):
    """Drives legs through a network by a map, and replans after a blockage or a fall.

    Args:
        number: of the robot in its batch, for events.
        falls: how often the robot may fall off its route.

    Attributes:
        planner: of legs through the map.
    """

    planner: LegPlanner

    def __init__(self, number: int, falls: int) -> None:
        self.number, self._falls = number, falls
        self._to_come: list[Leg] = []
        self._closed: list[Port] = []
        self._turns: list[Edge] = []  # that the robot has fallen off

    def route(self) -> Route:
        """See ``Pilot``."""
        return self.planner.route(self.leg.path)

    def on_blockage(self, time: float, distance: float, goal: str) -> Decision:
        """See ``Pilot``."""
        if self.leg.goal < 0:
            return self._give_up(time, [], f"no headway as it {self.leg.note}")
        port = self.planner.obstacle(self.leg, distance)
        self._closed.append(port)
        name = self.planner.network.port_name(port)
        events = [TakenForClosed(self.number, time, name, distance)]
        return self._replan(time, events, self._onward(distance))

    def on_fall(self, time: float, position: Array, axis: Array) -> Decision:
        """See ``Pilot``."""
        location = self.planner.locate(position, axis)
        if location is None:
            return Decision(None)
        network, part = self.planner.network, location.part
        port = network.port_name((part, location.ahead))
        events = [FellOff(self.number, time, network.fittings[part].name, port)]
        if self._falls == 0:
            return self._on_last_fall(time, events, location)
        self._falls -= 1
        self._turns += self.planner.turn_in(self.leg, part)
        return self._replan(time, events, self._replan_from(location))

    def _on_last_fall(
        self, time: float, events: Sequence[Event], location: PartLocation
    ) -> Decision:
        """Decide for a robot that has fallen more often than it may."""
        return self._give_up(time, events, "has fallen too often")

    def _replan_from(self, location: PartLocation) -> Replan:
        """Return what plans legs to a goal from where a robot lies, whatever its leg."""
        return lambda planner, goal, closed: planner.replan_from(location, goal, closed)

    def _onward(self, distance: float) -> Replan:
        """Return what plans legs to a goal from arc length ``distance`` m on the leg at hand."""
        leg = self.leg
        return lambda planner, goal, closed: planner.replan(leg, distance, goal, closed)

    def _replan(self, time: float, events: Sequence[Event], plan: Replan) -> Decision:
        """Decide on the legs from here, of which ``plan`` gives those to one goal."""
        raise NotImplementedError

    def _obstacles(self) -> Iterator[Closed]:
        """Yield what is closed to a plan, the most first.

        A turn that the robot has fallen off is taken from the other side, and tried again only
        where there is no other way.
        """
        if self._turns:
            yield (*self._closed, *self._turns)
        yield tuple(self._closed)

    def _begin(self, time: float, events: Sequence[Event], legs: Sequence[Leg] | None) -> Decision:
        """Begin the first of ``legs`` and keep the others for later; give up without any."""
        if not legs:
            return self._give_up(time, events, "no other way")
        self.leg, *self._to_come = legs
        return Decision(self.leg, events=[*events, LegBegan(self.number, time, self.leg.note)])

    def _give_up(self, time: float, events: Sequence[Event], cause: str) -> Decision:
        return Decision(None, events=[*events, GaveUp(self.number, time, cause)])


class Planned(MapPilot):
    """Drives a mission through a network whose map is known.

    Args:
        planner: of the mission.
        number: see ``MapPilot``.
        falls: see ``MapPilot``.
    """

    def __init__(self, planner: MissionPlanner, number: int, falls: int) -> None:
        super().__init__(number, falls)
        self.leg, self.planner, self._goals = planner.first, planner, planner.mission.goals
        self._goal = self.leg.goal  # the latest that a leg has led to
        self._driven = 0.0  # m, way of the legs that are over

    @property
    def route_key(self) -> Hashable:
        """See ``Pilot``: robots of one batch share their network."""
        return self.leg.path

    @property
    def missed(self) -> Sequence[str]:
        """See ``Pilot``."""
        return self._goals[self._goal + 1 :]

    def done_at(self, distance: float) -> float:
        """See ``Pilot``: of the way to all goals, which is longer by what a detour adds."""
        done = self._driven + distance - self.leg.begin
        # Of the plan without detours all legs after that to the goal ahead are still to come.
        plan, ahead = self.planner.plan(), self._goal_ahead
        known = max(i for i, leg in enumerate(plan) if leg.goal == ahead) + 1
        left = self.leg.end - distance + travel([*self._to_come, *plan[known:]])
        return min(max(done / max(done + left, 1e-9), 0.0), 1.0)

    @property
    def _goal_ahead(self) -> int:
        """Number of the goal that the leg at hand or one of those to come leads to."""
        # Legs that only back out have no goal; the next one of those to come has.
        return next(leg.goal for leg in (self.leg, *self._to_come) if leg.goal >= 0)

    def on_arrival(self, time: float, distance: float, goal: str) -> Decision:
        """See ``Pilot``."""
        self._driven += travel([self.leg])
        if self._to_come:
            return self._begin(time, [], self._to_come)
        following = self.leg.goal + 1
        if following == len(self._goals):
            return Decision(None)
        events = [GoalReached(self.number, time, self._goals[self.leg.goal])]
        return self._begin(time, events, self._plan(self._onward(distance), following))

    def _replan(self, time: float, events: Sequence[Event], plan: Replan) -> Decision:
        return self._begin(time, events, self._plan(plan, self._goal_ahead))

    def _plan(self, plan: Replan, goal: int) -> list[Leg] | None:
        plans = (plan(self.planner, goal, closed) for closed in self._obstacles())
        return next((legs for legs in plans if legs is not None), None)

    def _begin(self, time: float, events: Sequence[Event], legs: Sequence[Leg] | None) -> Decision:
        decision = super()._begin(time, events, legs)
        self._goal = max(self._goal, self.leg.goal)
        return decision
