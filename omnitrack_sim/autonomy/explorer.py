"""Exploration of an unknown network.

The pilot extends its map by what the robot sees, and plans legs through the map to unexplored
ports. When the robot's nose is at such a port and it sees on, the leg is extended. Of the ports of
a new fitting the pilot takes the one with the shortest way there, which is the branch of a tee. At
an end, or where its way is blocked, it takes that of all unexplored ports that asks for the least
travel, back and on. As ports ahead ask for less travel than those that the robot has to back out
for, exploration is depth first, and the robot never backs out of a pipe whose end it has not seen.
When no port is left it returns to the start.

| what | where |
|---|---|
| a leg on a map that grows | ``mapping_pilot`` |
| what is put into the map | ``mapper``, ``loop_closure`` |
| which sightings are believed | ``sighting_check``, ``near_looks`` |
| looks back, and bores by the arms | ``rear_looks``, ``bore_survey`` |
| ports to explore | ``frontier`` |
| how legs are planned | ``leg_planner`` |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.autonomy.bore_survey import BoreSurvey
from omnitrack_sim.autonomy.frontier import Frontier
from omnitrack_sim.autonomy.leg_planner import LegPlanner, PartLocation, is_sharp, travel
from omnitrack_sim.autonomy.looks import LOOKS, SHALLOW, provisional_passage
from omnitrack_sim.autonomy.mapper import Mapper
from omnitrack_sim.autonomy.mapping_pilot import MappingPilot, end_of
from omnitrack_sim.autonomy.pilots import Decision, Replan
from omnitrack_sim.autonomy.rear_looks import RearLooks
from omnitrack_sim.autonomy.sight import Look, Sighting
from omnitrack_sim.autonomy.sighting_check import SightingCheck
from omnitrack_sim.pipes import Arcs, Port, Reducer
from omnitrack_sim.pipes.planning import Closed, Leg
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.events import (
    EndInspected,
    Event,
    ExplorationComplete,
    ExplorationIncomplete,
    FellOff,
    GoalReached,
)
from omnitrack_sim.robots.robot import Robot

TOUCH = 0.05
"""From the nose to an observed end, m, within which a robot without progress is there."""
LOOK_BEFORE = 2 * LOOKS.step_again
"""How far before the end of a leg a robot looks ahead, m: far enough for a second look before its
nose is in a fitting that follows directly."""


class Explorer(MappingPilot):
    """Pilot of one robot that explores; see ``Pilot``.

    Args:
        robot: the robot.
        number: its index in the batch, for events.
        arcs: of the centreline in tees.
        belief: its map.
        goals: names of the goals; with none, it explores all.
        distance: m, from the port where it began to its centre then.
        falls: how often it may fall off its route, or hang where it has come through before, until
            it has inspected one more end.

    Attributes:
        goals: those that are still to be reached.
        frontier: ports to explore.
    """

    def __init__(
        self,
        robot: Robot,
        number: int,
        arcs: Arcs,
        belief: Belief,
        goals: Sequence[str],
        distance: float,
        falls: int,
    ) -> None:
        super().__init__(robot, number, arcs, belief, distance, falls)
        self._max_falls = falls
        self.goals, self._explores = list(goals), not goals
        self.frontier = Frontier(belief)
        self._tries_home_again = True  # after as many falls as it may have
        self._rear = RearLooks(belief, self.half, distance)
        self._check = SightingCheck(self, self._rear)
        self._mapper = Mapper(self, self._rear, self._check)
        self._bores = BoreSurvey(self, self._rear, robot.length + LOOKS.step)
        looks_ahead = (self._check.near, self._check.confirmation, self._check.close)
        self.records = (*looks_ahead, self._bores, self._rear, self._mapper)

    @property
    def missed(self) -> tuple[str, ...]:
        """Goals that have not been reached."""
        return tuple(self.goals)

    @property
    def rights_itself(self) -> bool:
        """See ``Pilot``: on pipes that nobody has planned for, a robot leans more often."""
        return True

    @property
    def unexplored(self) -> str:
        """See ``Pilot``."""
        ports = {self.belief.name(end): why for end, why in self.frontier.abandoned.items()}
        doubts = self.belief.doubtful_sizes() | self.doubts | self._rear.doubts
        return ", ".join(f"{name} ({why})" for name, why in (ports | doubts).items())

    def done_at(self, distance: float) -> float:
        """See ``Pilot``: the part of the ends known so far, and of the way home as one more."""
        done, to_come = len(self.belief.explored), len(self.frontier.ports) + 1
        return (done + super().done_at(distance)) / (done + to_come)

    # Looks

    @property
    def looks_at(self) -> float:
        """See ``Pilot``."""
        # While the robot looks back for a missed reducer, other looks back wait.
        searching, route = self._bores.searching, self.route()
        rear = self._bores.next_look if searching else self._rear.next_look(route)
        return min(self.look_at, rear)

    def looks_back(self, distance: float) -> bool:
        """See ``Pilot``."""
        route = self.route()
        known = bool(provisional_passage(self.belief, route))
        known = known or self._rear.in_sight(route, distance)
        with_ahead = known and distance >= self.look_at
        return self._bores.searching or with_ahead or distance >= self._rear.next_look(route)

    def on_look(self, look: Look) -> Decision:
        """See ``Pilot``; the look goes back as well where the robot ``looks_back``."""
        distance = look.distance
        self._bores.update_bore_from_arms(look)
        if self._bores.overrides_look:
            return Decision(self.leg, True)
        if self._bores.searching:
            decision = self._bores.look_for_reducer(look)
            if decision is not None:
                return decision
        elif self.looks_back(distance):
            distance = self._rear.located(self.route(), look)
            self._check.near.shift_robot(distance - look.distance)
            distance += self._mapper.correct_passed()
        if look.distance < self.look_at:
            return Decision(self.leg, True, (), distance - look.distance)
        ahead = look.ahead if self._check.shows_pipe(look) else None
        located = self._check.near.located(self.route(), distance, ahead)
        self._mapper.doubt_moved_end(located - distance)
        self._rear.add_slip_uncertainty(located - distance)
        decision = self._look_ahead(look._replace(distance=located))
        return decision._replace(shift=located - look.distance)

    def _look_ahead(self, look: Look) -> Decision:
        """Decide after a look ahead from the corrected position."""
        ahead, distance, route = look.ahead, look.distance, self.route()
        if ahead is None or self._check.is_impossible(look):
            return self._on_ambiguous_look(look)
        again = self._check.next_look(ahead, look, route)
        if again is not None:
            self.look_at = again
            return Decision(self.leg, True)
        return self._map_sighting(ahead, distance, look)

    def _on_ambiguous_look(self, look: Look) -> Decision:
        """Decide after a look ahead that tells nothing: look again as long as there is room."""
        self.look_at = look.distance + LOOKS.step_again
        # It may have come too near to what it has seen before.
        latest = self._check.close.latest
        near = latest is not None and self.look_at > self.leg.end
        if not (near or self._check.near.is_too_late(self.look_at, self.route())):
            return Decision(self.leg, True)
        if latest is not None:
            return self._map_sighting(*latest, look)
        self._keep_provisional()
        return Decision(self.leg, True)

    def _keep_provisional(self) -> None:
        """Keep on the map, in doubt, what was observed only from afar.

        Looks from close by are ambiguous: a cross, which no form explains there, may look like a
        tee from afar.
        """
        belief, straight = self.belief, self.belief.provisional
        assert straight is not None
        end = straight, "end"
        beyond = belief.joined.get(end)
        name = belief.name(end) if beyond is None else belief.part_name(beyond[0])
        self.doubts[name] = "seen from afar only"
        belief.set_provisional(None)
        observed = self.end in belief.ends
        self.look_at = math.inf if observed else self.leg.end - LOOK_BEFORE

    def _map_sighting(self, ahead: Sighting, distance: float, look: Look) -> Decision:
        """Put a sighting made at arc length ``distance`` m into the map.

        It is that of the ``look``, or of one before it where that told nothing.
        """
        if ahead.kind == ("", ""):
            self._check.close.clear()  # So there is no fitting where these looks have shown one.
        self.assumed = 0.0
        end, end_std = self._check.close.begin_of(ahead, distance)
        provisional = provisional_passage(self.belief, self.route()) is not None
        self.remove_provisional()
        before = self.belief.network
        self._mapper.measure_bend(ahead, look)
        moved = self.belief.network is not before
        if moved:
            self.plan_anew()
        more = end - self.route().length
        if provisional:
            self._mapper.doubt_moved_end(more)
        placed = math.inf if ahead.fitting is None else math.hypot(end_std, look.std)
        path = self._mapper.with_free_pipe(more, placed)
        if ahead.kind != ("", ""):
            self._mapper.measure_pipe(path[-1][0], look, end_std)
        if moved and not (ahead.end or isinstance(ahead.fitting, Reducer)):
            # The map has moved under the robot: it relocalises before it measures what is beyond.
            # An end or a reducer is kept: soon the lens may be too near to see it.
            self.extend_leg_to(path)
            last = self.leg.end - LOOK_BEFORE
            self.look_at = max(distance, min(distance + LOOKS.step_again, last))
            return Decision(self.leg, True)
        if ahead.fitting is not None:
            return self._enter_fitting(ahead, path, look)
        return self._go_along_pipe(ahead, path, distance)

    def _go_along_pipe(self, ahead: Sighting, path: tuple[Edge, ...], distance: float) -> Decision:
        """Extend the leg along pipe that ends, or goes on as far as it is seen."""
        plain = self.belief.fitting(path[-1][0]).is_plain
        if ahead.end == "open" or ahead.end == "closed":
            self.belief.set_end(end_of(path), ahead.end)
        elif ahead.confidence < LOOKS.sure and plain:
            self.doubt(path[-1][0], SHALLOW)
        self.extend_leg_to(path)
        self.look_at = math.inf if ahead.end else distance + LOOKS.step
        if ahead.end:
            self._look_closer(ahead, path, distance)
        return Decision(self.leg, True)

    def _enter_fitting(self, ahead: Sighting, path: tuple[Edge, ...], look: Look) -> Decision:
        """Extend the leg into a fitting sighted at the end of a path."""
        distance = look.distance
        part, events = self._mapper.add_fitting(ahead, path, look)
        self.extend_leg_to(path)
        onward = None if part is None else self._through_new(part, ahead.enter, distance)
        if part is None or onward is None:
            return self._replan(look.time, events, self._onward(distance))
        self.extend_leg_to(onward)
        self.look_at = self.leg.end - LOOK_BEFORE
        if self.belief.is_leaf(part):
            self._look_closer(ahead, path, distance)
        return Decision(self.leg, True, events)

    def _look_closer(self, ahead: Sighting, path: tuple[Edge, ...], distance: float) -> None:
        """Plan another look at the end of a path from close by, if the robot is far from it."""
        close = self._check.near.plan(ahead, self.planner.route(path), distance)
        self.look_at = self.look_at if close is None else close

    # Ends, blockages and falls

    def on_arrival(self, time: float, distance: float, goal: str) -> Decision:
        """See ``Pilot``."""
        if self._to_come:
            return self._begin(time, [], self._to_come)
        end = self.end
        if end == self.belief.start:
            return Decision(None, False, self._verdict(time))
        if end in self.belief.ends:
            return self._inspect(time, distance, end, goal)
        if self.assumed > 1.5 * LOOKS.step:
            self._abandon(end, "no look into it tells anything")
            return self._replan(time, [], self._onward(distance))
        # The look has shown nothing: assume a little free pipe, and look again.
        self.assumed += LOOKS.step
        self.extend_leg_to(self._mapper.with_free_pipe(LOOKS.step))
        self.look_at = distance
        return Decision(self.leg, True)

    def on_blockage(self, time: float, distance: float, goal: str) -> Decision:
        """See ``Pilot``."""
        port, end = self.planner.obstacle(self.leg, distance), self.end
        ahead = self.route().length - distance - self.half
        if self.leg.goal >= 0:
            if port == end and end in self.belief.ends and ahead < TOUCH:
                return self._inspect(time, distance, end, goal)
            if port in self.frontier.ports:
                if self.belief.fitting(port[0]).is_plain:
                    self.belief.lengthen(port[0], -ahead)
                self._abandon(port, "no headway")
        if self.leg.goal < 0 or end == self.belief.start:
            # It has come this way, so nothing closes it: the robot lies badly.
            again = self.planner.once_more(self.leg, distance)
            if again and self._falls > 0:
                self._falls -= 1
                return self._begin(time, [], [*again, *self._to_come])
        return super().on_blockage(time, distance, goal)

    def _on_last_fall(
        self, time: float, events: Sequence[Event], location: PartLocation
    ) -> Decision:
        """Give up the port that the robot was on its way to, and go on to another.

        On its way home there is none, so it tries that once more before it gives up.
        """
        port = end_of([self.leg, *self._to_come][-1].path)
        if port in self.frontier.ports:
            self._abandon(port, "has fallen too often on the way there")
        elif self._tries_home_again:
            self._tries_home_again = False
        else:
            return super()._on_last_fall(time, events, location)
        self._falls = self._max_falls
        return self._replan(time, events, self._replan_from(location))

    def _inspect(self, time: float, distance: float, end: Port, goal: str) -> Decision:
        """Decide at an observed end: mark it as explored, and go on to another port."""
        belief, reached = self.belief, goal if goal in self.goals else ""
        self._falls = self._max_falls
        belief.set_explored(end, reached)
        events: list[Event] = [
            EndInspected(self.number, time, belief.name(end), belief.ends[end]),
        ]
        if reached:
            events.append(GoalReached(self.number, time, reached))
            self.goals.remove(reached)
        if not (self._explores or self.goals):
            return Decision(None, False, events)
        return self._replan(time, events, self._onward(distance))

    def _abandon(self, end: Port, why: str) -> None:
        """Leave a port unexplored."""
        self.assumed = 0.0
        self.frontier.abandon(end, why)

    def _verdict(self, time: float) -> list[Event]:
        """Return the robot's verdict on its map when it is home.

        Before that, nothing has shown that it can be driven by.
        """
        parts = self.belief.network.pipes.parts
        fittings = sum(not part.fitting.is_plain for part in parts)
        ends = len(self.belief.explored) - len(self.frontier.abandoned)
        if self.unexplored:
            return [ExplorationIncomplete(self.number, time, fittings, ends, self.unexplored)]
        return [ExplorationComplete(self.number, time, fittings, ends)]

    # Planning

    def _through_new(self, part: int, enter: str, distance: float) -> tuple[Edge, ...] | None:
        """Return the path at hand, extended to the nearest unexplored port of a new fitting.

        None where there is none but round a sharp turn, or where the robot has come too far to
        stand before it: fittings that follow closely are prepared for together, before the first.
        """
        leaves = [end[1] for end in self.frontier.ports if end[0] == part]
        fitting = self.belief.fitting(part)
        leaves = [port for port in leaves if not is_sharp(fitting, enter, port)]
        if not leaves:
            return None
        leave = min(
            leaves, key=lambda port: round(self.planner.route([(part, enter, port)]).length, 3)
        )
        path = (*self.leg.path, (part, enter, leave))
        return path if distance <= self.planner.latest_stand(path, len(path) - 1) else None

    def _onward(self, distance: float) -> Replan:
        """See ``MapPilot``; legs lead ahead or back, and round sharp turns where they can."""
        route = self.route()
        self.remove_assumed(route.passages[route.index_at(distance)].index)
        leg = self.leg

        def onward(planner: LegPlanner, goal: int, closed: Closed) -> list[Leg] | None:
            options = [
                planner.extend(leg, distance, goal, closed),
                planner.replan(leg, distance, goal, closed),
            ]
            if planner.ends[goal + 1] == self.belief.start:
                # The start is behind; after a loop it may be nearer ahead.
                location = planner.location(leg, distance)
                options.append(planner.replan_from(location, goal, closed))
            legs = min((legs for legs in options if legs), key=travel, default=None)
            return legs and planner.gentler(legs, planner.location(leg, distance), goal, closed)

        return onward

    def _replan_from(self, location: PartLocation) -> Replan:
        """See ``MapPilot``; legs lead round sharp turns where they can."""
        self.remove_assumed(location.part)

        def onward(planner: LegPlanner, goal: int, closed: Closed) -> list[Leg] | None:
            legs = planner.replan_from(location, goal, closed)
            return legs and planner.gentler(legs, location, goal, closed)

        return onward

    def _replan(self, time: float, events: Sequence[Event], plan: Replan) -> Decision:
        """Go to the unexplored port that asks for the least travel, or else to the start."""
        legs = self._cheapest_legs(self.frontier.ports, plan)
        if legs is None and (reopened := self.frontier.reopen(self._closed)):
            self._closed = [end for end in self._closed if end not in reopened]
            legs = self._cheapest_legs(self.frontier.ports, plan)
        if legs is None:
            self._abandon_unreachable_ports()
            legs = self._cheapest_legs([self.belief.start], plan)
        return self._begin(time, list(events), legs)

    def _abandon_unreachable_ports(self) -> None:
        """Give up the unexplored ports, none of which can be reached."""
        if self.frontier.ports:
            self.assumed = 0.0
        self.frontier.abandon_unreachable(self._closed)

    def _cheapest_legs(self, goals: Sequence[Port], plan: Replan) -> list[Leg] | None:
        """Return legs to that of the ports ``goals`` which costs least.

        None where no path leads to any.
        """
        planner = self.planner_to(goals)
        for closed in self._obstacles():
            # Rounded, so that equal paths do not swap by the last bit of a length.
            options = [
                (round(planner.cost(legs), 6), goal, legs)
                for goal in range(len(goals))
                if (legs := plan(planner, goal, closed))
            ]
            if options:
                self.planner = planner
                return min(options, key=lambda option: option[:2])[2]
        return None

    def _begin(self, time: float, events: Sequence[Event], legs: Sequence[Leg] | None) -> Decision:
        before, decision = self.leg, super()._begin(time, events, legs)
        if decision.leg is None:
            return decision
        for record in self.records:
            record.begin_leg()
        end = self.end
        blind = self.leg.goal < 0 or end == self.belief.start or end in self.belief.ends
        self.look_at = math.inf if blind else self.leg.end - LOOK_BEFORE
        if self.leg.gear != before.gear or self.leg.path[: len(before.path)] != before.path:
            return decision
        if any(isinstance(event, FellOff) for event in events):
            # Even on the path at hand, headway counts anew from where it lies: it was none there.
            return decision
        self.leg = replace(self.leg, begin=before.begin)
        return Decision(self.leg, True, events)
