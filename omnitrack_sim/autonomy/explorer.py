"""Exploration of an unknown network.

The pilot extends its map by what the robot sees, and plans legs through the map to unexplored
ports. When the robot's nose is at such a port and it sees on, the leg is extended. Of the ports of
a new fitting the pilot takes the one with the shortest way there, which is the branch of a tee. At
an end, or where its way is blocked, it takes that of all unexplored ports that asks for the least
travel, back and on. As ports ahead ask for less travel than those that the robot has to back out
for, exploration is depth first, and the robot never backs out of a pipe whose end it has not seen.
When no port is left it returns to the start.

How several looks are put together is in ``looking``, how legs are planned in ``leg_planner``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from omnitrack_sim.autonomy.belief import BELIEF, Belief
from omnitrack_sim.autonomy.leg_planner import (
    LEG_PLANNER,
    LegPlanner,
    PartLocation,
    is_sharp,
    travel,
)
from omnitrack_sim.autonomy.looking import (
    LOOKS,
    CloseLooks,
    Confirmation,
    LookingBack,
    LookingCloser,
    MissedReducer,
    is_along,
    reducer_std,
    size_stds,
)
from omnitrack_sim.autonomy.pilots import Decision, MapPilot, Replan
from omnitrack_sim.autonomy.sight import Look, Sighting, side_of
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Array, angle_between, unit
from omnitrack_sim.pipes import (
    BORE_TOLERANCE,
    Arcs,
    Elbow,
    Fitting,
    Passage,
    Port,
    Reducer,
    Route,
    Straight,
    Tee,
    Wye,
)
from omnitrack_sim.pipes.fittings.base import Bores
from omnitrack_sim.pipes.map_difference import ANGLES, LENGTHS
from omnitrack_sim.pipes.planning import Closed, Leg
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.events import (
    EndInspected,
    Event,
    ExplorationComplete,
    ExplorationIncomplete,
    FellOff,
    FittingFound,
    GoalReached,
    LoopClosed,
)
from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class ExplorerSettings:
    """When a robot that explores looks ahead, and thresholds for changes of its map.

    Attributes:
        creep: m, of free pipe assumed at an unexplored port where a look shows nothing.
        most_creep: m, of free pipe assumed without a look that shows something: pipe that has not
            been seen is not on the map, by which the robot then localises itself badly.
        look_step: m, travel between two looks along a pipe whose end is not in sight.
        look_before: m, before the end of a leg where a robot looks ahead: far enough for a second
            look before its nose is in a fitting that follows directly.
        least_bend: rad, least angle of an elbow.
        bend_tolerance: rad, error of an elbow's angle from which on the map is corrected.
        turn_tolerance: rad, the same of its direction: a look is off by a degree, and so is how the
            robot takes itself to be turned.
        blind: m, from the nose to where a lens of 100 degrees sees the wall of a pipe.
        settling: m, travel after such a correction in which a robot relocalises on the map.
        confidence: probability from which on a robot believes an observation.
        sure: probability from which on an observation is not in doubt.
        most_move: m, between the positions of an end by looks from afar and from close by, from
            which on the length of the pipe is in doubt: the robot may have slipped.
        touch: m, from the nose to an observed end, within which a robot without progress is there.
        rest: rad, most angle of a bend that may be the rest of the one before it: before a wide
            bend its far end is hidden, so that the map may have it too short by that much.
        same_side: rad, between the directions of two bends that may be one.
        steady: part of the bore by which two measurements by the arms in one pipe may differ; in
            the cone of a reducer they differ more.
    """

    creep: float = 0.1
    most_creep: float = 0.2
    look_step: float = 0.1
    look_before: float = 0.02
    least_bend: float = math.radians(5)
    bend_tolerance: float = math.radians(0.5)
    turn_tolerance: float = math.radians(3)
    blind: float = 0.07
    settling: float = 0.05
    confidence: float = 0.5
    sure: float = 0.95
    most_move: float = 0.06
    touch: float = 0.05
    rest: float = math.radians(35)
    same_side: float = math.radians(20)
    steady: float = 0.005


EXPLORER = ExplorerSettings()

SHALLOW = "a shallow reducer may be in it"
"""Doubt about pipe that a lamp shows as free."""


class Explorer(MapPilot):
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
        look_at: m, arc length on its leg where the robot looks ahead next.
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
        super().__init__(number, falls)
        self._most_falls = falls
        self._robot, self._half, self._arcs = robot, robot.length / 2, arcs
        self._belief, self.goals, self._explores = belief, list(goals), not goals
        self._bends: set[int] = set()  # elbows and wyes whose angle has not been measured yet
        self._named: set[str] = set()  # fittings that an event has named
        self._assumed = 0.0  # m, of free pipe since the last look that showed something
        self._doubts: dict[str, str] = {}  # names of parts of the map, and why
        self._felt = math.nan  # m, bore by the arms at the last look, where the map has another
        self._right_bores: set[int] = set()  # pipes in which the arms have found that of the map
        # m, what the arms have read more than the map has, in pipes where they agree with it.
        self._read_more: list[float] = []
        self._missed: MissedReducer | None = None
        self._left: dict[Port, str] = {}  # ports that it has given up, and why
        self._tried_again: set[Port] = set()  # ports given up that it has reopened once
        self._tries_home_again = True  # after as many falls as it may have
        self._back = LookingBack(belief, self._half, EXPLORER.confidence)
        self._back.placed = 0, distance, 0.0
        self._closer = LookingCloser(belief, self._half)
        self._close, self._confirmation = CloseLooks(), Confirmation()
        self.planner = self._through([])
        self.leg = self._longer(Leg(((0, "start", "end"),), 1, distance, 0.0, 0, ""))
        self.look_at = distance

    @property
    def belief(self) -> Belief:
        """See ``Pilot``."""
        return self._belief

    @property
    def missed(self) -> tuple[str, ...]:
        """Goals that have not been reached."""
        return tuple(self.goals)

    @property
    def rights_itself(self) -> bool:
        """See ``Pilot``: on pipes that nobody has planned for, a robot leans more often."""
        return True

    @property
    def left(self) -> str:
        """See ``Pilot``."""
        ports = {self.belief.name(end): why for end, why in self._left.items()}
        doubts = self.belief.unsure() | self._doubts | self._back.doubts
        return ", ".join(f"{name} ({why})" for name, why in (ports | doubts).items())

    def done_at(self, distance: float) -> float:
        """See ``Pilot``: the part of the ends known so far, and of the way home as one more."""
        done, to_come = len(self.belief.explored), len(self.belief.unexplored) + 1
        return (done + super().done_at(distance)) / (done + to_come)

    # Decisions

    def on_look(self, look: Look) -> Decision:
        """See ``Pilot``; the look goes back as well where the robot ``looks_back``."""
        distance = look.distance
        if self._finds_other_bore(look):
            return Decision(self.leg, True)
        if self._missed is not None:
            decision = self._look_for_missed(look)
            if decision is not None:
                return decision
        elif self.looks_back(distance):
            distance = self._back.located(self.route(), look)
            self._closer.moved(distance - look.distance)
            distance += self._measure_passed()
        if look.distance < self.look_at:
            return Decision(self.leg, True, (), distance - look.distance)
        ahead = look.ahead if self._shows_pipe(look) else None
        located = self._closer.located(self.route(), distance, ahead)
        self._doubt_end(located - distance)
        self._back.slipped(located - distance)
        distance, shift = located, located - look.distance
        return self._look_on(look._replace(distance=distance))._replace(shift=shift)

    def _look_on(self, look: Look) -> Decision:
        """Decide after a look ahead from the corrected position."""
        ahead, distance = look.ahead, look.distance
        route = self.route()
        if ahead is None or ahead.confidence < EXPLORER.confidence or self._is_impossible(look):
            self.look_at = distance + LOOKS.again
            # It may have come too near to what it has seen before.
            near = self._close.latest is not None and self.look_at > self.leg.end
            if not (near or self._closer.too_late(self.look_at, route)):
                return Decision(self.leg, True)
            if self._close.latest is None:
                self._keep_provisional()
                return Decision(self.leg, True)
            ahead, distance = self._close.latest
        else:
            again = self._next_look(ahead, look, route)
            if again is not None:
                self.look_at = again
                return Decision(self.leg, True)
        if ahead.kind == ("", ""):
            self._close.clear()  # So there is no fitting where these looks have shown one.
        self._assumed = 0.0
        end, end_std = self._close.begin_of(ahead, distance)
        provisional = self._closer.index(route) is not None
        self._remove_provisional()
        axis = look.frame @ ahead.axis
        measured = self._shows_axis(ahead, look.std) and self._measure_bend(axis, look.std)
        more = end - self.route().length
        if provisional:
            self._doubt_end(more)
        placed = math.inf if ahead.fitting is None else math.hypot(end_std, look.std)
        path = self._with_free_pipe(more, placed)
        if ahead.kind != ("", "") and self.belief.fitting(path[-1][0]).is_plain:
            self.belief.measured(path[-1][0], length=self._length_std(path[-1][0], look, end_std))
        if measured and not (ahead.end or isinstance(ahead.fitting, Reducer)):
            # The map has moved under the robot: it relocalises before it measures what is beyond.
            # An end or a reducer is kept: soon the lens may be too near to see it.
            self._go_on(path)
            self.look_at = max(
                distance, min(distance + EXPLORER.settling, self.leg.end - EXPLORER.look_before)
            )
            return Decision(self.leg, True)
        if ahead.fitting is not None:
            return self._add_fitting(ahead.fitting, ahead, path, look)
        if ahead.end == "open" or ahead.end == "closed":
            self.belief.note(_end_of(path), ahead.end)
        elif ahead.confidence < EXPLORER.sure and self.belief.fitting(path[-1][0]).is_plain:
            self._doubt(path[-1][0], SHALLOW)
        self._go_on(path)
        self.look_at = math.inf if ahead.end else distance + EXPLORER.look_step
        if ahead.end:
            self._look_closer(ahead, path, distance)
        return Decision(self.leg, True)

    def on_arrival(self, time: float, distance: float, goal: str) -> Decision:
        """See ``Pilot``."""
        if self._to_come:
            return self._begin(time, [], self._to_come)
        end = _end_of(self.leg.path)
        if end == self.belief.start:
            return Decision(None, False, self._verdict(time))
        if end not in self.belief.ends:
            if self._assumed > EXPLORER.most_creep - EXPLORER.creep / 2:
                self._give_up_port(end, "no look into it tells anything")
                return self._replan(time, [], self._onward(distance))
            # The look has shown nothing: assume a little free pipe, and look again.
            self._assumed += EXPLORER.creep
            self._go_on(self._with_free_pipe(EXPLORER.creep))
            self.look_at = distance
            return Decision(self.leg, True)
        return self._inspected(time, distance, end, goal)

    def on_blockage(self, time: float, distance: float, goal: str) -> Decision:
        """See ``Pilot``."""
        port = self.planner.obstacle(self.leg, distance)
        ahead = self.route().length - distance - self._half
        if self.leg.goal >= 0:
            end = _end_of(self.leg.path)
            if port == end and end in self.belief.ends and ahead < EXPLORER.touch:
                return self._inspected(time, distance, end, goal)
            if port in self.belief.unexplored:
                if self.belief.fitting(port[0]).is_plain:
                    self.belief.lengthen(port[0], -ahead)
                self._give_up_port(port, "no headway")
        if self.leg.goal < 0 or _end_of(self.leg.path) == self.belief.start:
            # It has come this way, so nothing closes it: the robot lies badly.
            again = self.planner.once_more(self.leg, distance)
            if again and self._falls > 0:
                self._falls -= 1
                return self._begin(time, [], [*again, *self._to_come])
        return super().on_blockage(time, distance, goal)

    def _on_last_fall(
        self, time: float, events: Sequence[Event], location: PartLocation
    ) -> Decision:
        """Give up the port that the robot was on its way to, and go on to another; on its way home
        there is none, so it tries that once more before it gives up."""
        port = _end_of([self.leg, *self._to_come][-1].path)
        if port in self.belief.unexplored:
            self._give_up_port(port, "has fallen too often on the way there")
        elif self._tries_home_again:
            self._tries_home_again = False
        else:
            return super()._on_last_fall(time, events, location)
        self._falls = self._most_falls
        return self._replan(time, events, self._from(location))

    def _doubt(self, part: int, why: str) -> None:
        """Note why a part of the map may be wrong."""
        self._doubts[self.belief.part_name(part)] = why

    # Repeated looks

    @property
    def looks_at(self) -> float:
        """Arc length on its leg, m, of the next look."""
        # While the robot looks back for a missed reducer, other looks back wait.
        back = self._back.at(self.route()) if self._missed is None else self._missed.at
        return min(self.look_at, back)

    def looks_back(self, distance: float) -> bool:
        """Return whether a look at arc length ``distance`` m of its leg goes back as well."""
        route = self.route()
        known = bool(self._closer.index(route)) or self._back.in_sight(route, distance)
        with_ahead = known and distance >= self.look_at
        return self._missed is not None or with_ahead or distance >= self._back.at(route)

    def _next_look(self, ahead: Sighting, look: Look, route: Route) -> float | None:
        """Return the arc length, m, of the look that is needed before a sighting is believed; None
        where none is."""
        distance = look.distance
        self._measure_sizes(ahead, look, route)
        again = self._closer.doubted(ahead, route, distance)
        if again is not None:
            return again
        begins = ahead.kind != ("", "") and self._closer.index(route) is None
        if begins and look.behind is None and self._back.once_more(route, distance):
            return distance
        if not self._is_confirmed(ahead, look, route) or self._measures_on(ahead, route, distance):
            return distance + LOOKS.doubt
        return None

    def _is_impossible(self, look: Look) -> bool:
        """Return whether a plate is sighted nearer than a robot comes to one: where it leans in the
        mouth of a fitting, it sees the wall before it. No robot lies across a straight either: one
        that takes itself to has stayed behind in the fitting before that."""
        ahead, route = look.ahead, self.route()
        here = route.passages[route.index_at(look.distance)]
        if here.part.fitting.is_plain:
            axis = route.centreline.frame(np.array([look.distance]))[0][:, 2]
            if look.frame[:, 2] @ axis < math.cos(LEG_PLANNER.along):
                return True
        near = self._half + self._robot.nose_room
        return ahead is not None and ahead.end == "closed" and ahead.distance < near

    def _is_confirmed(self, ahead: Sighting, look: Look, route: Route) -> bool:
        """Return whether a sighting out of a fitting agrees with the one before; other sightings
        need no confirmation."""
        out_of, distance = self._before(route), look.distance
        if ahead.fitting is None or self.belief.fitting(out_of[0]).is_plain:
            kind = self._confirmation.cancel()
            if kind:
                self._doubt(_end_of(self.leg.path)[0], f"a {kind} in it was not confirmed")
            return True
        at, last = distance + ahead.distance, route.passages[-1]
        # What begins before the middle of the last fitting is that fitting itself.
        itself = last.index == out_of[0] and at < (last.s_enter + last.s_leave) / 2
        # Two cones in a row, and one whose ends do not show, are something else, such as the rest
        # of the fitting seen by a lens that leans.
        cone = isinstance(ahead.fitting, Reducer)
        chain = isinstance(self.belief.fitting(out_of[0]), Reducer)
        unclear = cone and (chain or ahead.distance_std > LOOKS.most_reducer_std)
        if itself or unclear or self._is_rest(ahead, look, out_of):
            return False
        side = _side(ahead, look, self.belief.port((out_of[0], out_of[2])).rotation[:, 2])
        return self._confirmation.confirms(ahead, distance, side)

    def _is_rest(self, ahead: Sighting, look: Look, out_of: Edge) -> bool:
        """Return whether a bend sighted out of another bend may be the far end of that one."""
        part, enter, leave = out_of
        bend = self.belief.fitting(part)
        if not (isinstance(bend, Elbow) and isinstance(ahead.fitting, Elbow)):
            return False
        if ahead.fitting.angle > EXPLORER.rest:
            return False
        on = self.belief.port((part, leave)).rotation[:, 2]
        # Towards the middle of the bend that the robot comes out of.
        middle = self.belief.port((part, enter)).rotation[:, 2]
        middle = middle - on * (middle @ on)
        return float(angle_between(_side(ahead, look, on), middle)) < EXPLORER.same_side

    def _finds_other_bore(self, look: Look) -> bool:
        """Return whether the arms find another bore than the map has for the pipe around the robot,
        and the map may have missed a reducer.

        Then the pipe is in doubt, and as soon as two looks agree on its bore the map takes that
        bore, also for the end of a reducer before it; without one, the robot looks back for one
        that it has missed. Where the bore is right, the pipe is no longer in doubt for a shallow
        reducer.
        """
        route = self.route()
        here = route.passages[route.index_at(look.distance)]
        within = here.s_enter + self._half < look.distance < here.s_leave - self._half
        if not (here.part.fitting.is_plain and within):
            return False
        bore, name = 2 * here.part.fitting.port_radius(here.enter), here.part.name
        if abs(look.bore - bore) < LENGTHS / 2 * bore:
            self._read_more.append(look.bore - bore)
            self._right_bores.add(here.index)
            if self._doubts.get(name) == SHALLOW:
                del self._doubts[name]
        felt, self._felt = self._felt, math.nan
        if not abs(look.bore - bore) > LENGTHS * bore:
            return False
        self._doubts[name] = f"its bore is {1000 * look.bore:.0f} mm by the arms"
        self._remove_provisional()
        part, entered, _ = self.leg.path[-1]
        if part != here.index or entered != "start" or not self.belief.is_last(part):
            return False
        if not abs(look.bore - felt) < EXPLORER.steady * bore:
            # The robot may still stand in the reducer.
            self._felt, self.look_at = look.bore, look.distance + 2 * LOOKS.doubt
            return True
        # Ends of modules that lean hold the arms out by up to 0.9 mm, alike in all pipes. A bore
        # that is 1 mm off makes a shallow reducer 10 mm longer.
        more = float(np.median(self._read_more)) if self._read_more else 0.0
        true, why = round(look.bore - more, 3), self._doubts[name]
        self.belief.resize(part, inner_diameter=true)
        self.look_at = look.distance
        if self._corrects_reducer(self._passed(look.distance), part, true):
            del self._doubts[name]
        else:
            self._missed = MissedReducer(part, bore, look.distance)
        self._go_on(self.leg.path)
        # The same leg would keep its route, in which the pipe has the other bore.
        self.leg = replace(self.leg, note=f"{self.leg.note}: {why}")
        return True

    def _corrects_reducer(self, passed: Passage | None, pipe: int, bore: float) -> bool:
        """Correct the end of a reducer that the robot has ``passed`` into a ``pipe`` in which the
        arms find ``bore`` m; return whether it is one that may lead to that. One that leads to the
        bore from which it comes is none."""
        if passed is None or not isinstance(passed.part.fitting, Reducer):
            return False
        before = 2 * passed.part.fitting.port_radius(passed.enter)
        if abs(bore - before) < LENGTHS / 2 * before:
            self._doubts.pop(passed.part.name, None)
            self._back.forget(passed.index)
            self.belief.put(passed.index, Straight(passed.part.fitting.length, before))
            self.belief.resize(pipe, inner_diameter=before)
            return True
        key = passed.part.fitting.bore_key(passed.leave)
        try:
            self.belief.resize(passed.index, **{key: bore})
        except GeometryError:
            return False
        return True

    def _look_for_missed(self, look: Look) -> Decision | None:
        """Decide after a look back for a missed reducer; None where it has not been measured
        yet."""
        behind, missed = look.behind, self._missed
        assert missed is not None
        passed = self._passed(look.distance)
        kind = "" if passed is None else passed.part.fitting.kind
        if missed.shows_other(behind, kind, self._half):
            decision = self._infer_reducer(missed, look)
            if decision is not None:
                return decision
        reducer = missed.measured(behind, look.distance, self.leg.end)
        behind = behind if reducer is None else missed.seen_from(look.distance)
        if behind is None or not isinstance(behind.fitting, Reducer):
            return None
        look = look._replace(behind=behind)
        self._remove_provisional()
        here = self.route().passages[-1]
        if not (here.part.fitting.is_plain and self.belief.is_last(here.index)):
            self._stop_looking_back()
            return None
        if reducer is None:
            return None
        (near,) = {"start", "end"} - {behind.enter}
        reducer = _fitted(reducer, near, missed.bore)
        reducer = _fitted(reducer, behind.enter, 2 * here.part.fitting.port_radius(here.enter))
        return self._insert_reducer(reducer, near, missed, look)

    def _insert_reducer(
        self, reducer: Fitting, near: str, missed: MissedReducer, look: Look
    ) -> Decision | None:
        """Insert a missed reducer, entered by its port ``near``, into the straight around the
        robot; give up the search and return None where it has no room there."""
        belief, behind, here = self.belief, look.behind, self.route().passages[-1]
        assert behind is not None
        assert isinstance(reducer, Reducer)
        at = look.distance - behind.distance
        gap = at - reducer.length - here.s_enter
        direct = gap <= BELIEF.least_straight
        if gap < -LOOKS.most_shift or (direct and not belief.drop(here.index)):
            self._stop_looking_back()
            return None
        self._missed = None
        noted, path = belief.ends.pop((here.index, here.leave), None), self.leg.path
        self._doubts.pop(here.part.name, None)
        stds = [behind.distance_std] * len(missed.lengths)
        std = reducer_std(stds, missed.lengths)
        placed, shift = math.hypot(behind.distance_std, look.std), 0.0
        if direct:
            path = path[:-1]
            # It begins where the fitting before it ends: where the robot is tells its length too.
            # By a lamp the edge of a tee may look like the end of its cone: then the looks are off
            # by as much as that is in the tee.
            looks = math.hypot(std, min(gap, 0.0))
            weights = np.maximum([looks, placed], LOOKS.least_std) ** -2
            length = reducer.length + gap * float(weights[1] / weights.sum())
            length = max(length, reducer.length / 2)  # not a step, however badly it knows its place
            shift = length - reducer.length - gap
            reducer = replace(reducer, length=length)
            std = math.hypot(LOOKS.distance_floor, weights.sum() ** -0.5) if std else 0.0
        else:
            belief.resize(here.index, inner_diameter=missed.bore, length=gap)
            belief.measured(here.index, length=math.hypot(std, placed))
        part = belief.attach(_end_of(path), reducer, near, look.frame[:, 0])
        belief.measured(part, length=std)
        path = (*path, (part, near, behind.enter))
        straight = belief.straight_beyond(_end_of(path), here.s_leave - at)
        if noted is not None:
            belief.note((straight, here.leave), noted)
        self.look_at = look.distance
        self._go_on((*path, (straight, here.enter, here.leave)))
        name = belief.part_name(part)
        if behind.confidence < EXPLORER.sure:
            self._doubts[name] = "its sizes hardly show"
        event = FittingFound(self._number, look.time, name, -behind.distance)
        return Decision(self.leg, True, [event], shift)

    def _passed(self, distance: float) -> Passage | None:
        """Return the passage that the robot has left behind at arc length ``distance`` m; None in
        the first of its leg."""
        route = self.route()
        i = route.index_at(distance)
        return route.passages[i - 1] if i else None

    def _infer_reducer(self, missed: MissedReducer, look: Look) -> Decision | None:
        """Put a reducer in the place of a pipe of which the arms have not read the bore, where they
        find another one behind the fittings that follow it; return None where there is no such
        pipe: then the reducer is in the straight that the robot looks back through.

        By a lamp, a fitting behind a reducer looks like one that is as much smaller and nearer.
        """
        belief, i = self.belief, self.route().index_at(look.distance)
        here = self.route().passages[i]
        found = self._unread_pipe(here.index)
        if found is None:
            return None
        pipe, enter, leave = found
        length = belief.fitting(pipe).length_of_axes
        bore = 2 * here.part.fitting.port_radius(here.enter)
        bores = {enter: missed.bore, leave: bore}
        behind = {part: belief.fitting(part) for part in belief.beyond((pipe, leave))}
        try:
            reducer = Reducer(length, end_diameter=bores["end"], inner_diameter=bores["start"])
            behind = {part: _of_bore(fitting, bore) for part, fitting in behind.items()}
        except GeometryError:
            return None
        self._missed = None
        name = belief.put(pipe, reducer)
        for part, fitting in behind.items():
            belief.put(part, fitting)
        # A picture may have replaced the doubt by the arms, and the arms have removed that one.
        self._doubts.pop(here.part.name, None)
        self._doubts[name] = "it was felt behind it and not seen"
        self._go_on(self.leg.path)
        self.leg = replace(self.leg, note=f"{self.leg.note}: {name} inferred")
        self.look_at = look.distance
        shift = self.route().passages[i].s_enter - here.s_enter
        ends = (belief.port(end).position for end in ((pipe, leave), (here.index, here.enter)))
        away = look.distance - here.s_enter + math.dist(*ends)
        return Decision(self.leg, True, [FittingFound(self._number, look.time, name, -away)], shift)

    def _unread_pipe(self, part: int) -> Edge | None:
        """Return the pipe on the way from the start to ``part`` from which only fittings lead there
        and on, if it is too short for the arms to have read its bore; None where there is none."""
        belief, joint = self.belief, self.belief.hangs_on(part)
        while joint is not None and not _has_bore(belief.fitting(joint[0][0])):
            joint = belief.hangs_on(joint[0][0])
        before = None if joint is None else belief.hangs_on(joint[0][0])
        if joint is None or before is None:
            return None
        pipe, leave = joint[0]
        behind, fitting = belief.beyond((pipe, leave)), belief.fitting(pipe)
        others = any(isinstance(belief.fitting(other), Reducer) for other in behind)
        # Arms read a bore where the whole robot is in it, and when it looks.
        most = self._robot.length + EXPLORER.look_step
        read = pipe in self._right_bores or fitting.length_of_axes > most
        unread = fitting.is_plain and not read and not others and pipe not in behind
        return (pipe, before[1][1], leave) if unread else None

    def _stop_looking_back(self) -> None:
        """Give up the search for a missed reducer, and restore the bore of the straight."""
        if self._missed is not None:
            self.belief.resize(self._missed.part, inner_diameter=self._missed.bore)
            self._missed = None

    def _keep_provisional(self) -> None:
        """Keep on the map, in doubt, what was observed only from afar, as looks from close by are
        ambiguous: a cross, which no form explains there, may look like a tee from afar."""
        belief, straight = self.belief, self.belief.provisional
        assert straight is not None
        end = straight, "end"
        beyond = belief.joined.get(end)
        name = belief.name(end) if beyond is None else belief.part_name(beyond[0])
        self._doubts[name] = "seen from afar only"
        belief.settle()
        observed = _end_of(self.leg.path) in belief.ends
        self.look_at = math.inf if observed else self.leg.end - EXPLORER.look_before

    def _look_closer(self, ahead: Sighting, path: tuple[Edge, ...], distance: float) -> None:
        """Plan another look at the end of a path from close by, if the robot is far from it."""
        close = self._closer.begin(ahead, self.planner.route(path), distance)
        self.look_at = self.look_at if close is None else close

    def _doubt_end(self, move: float) -> None:
        """Doubt the length of the straight ahead if its end has moved by ``move`` m between looks
        from afar and from close by."""
        if abs(move) > EXPLORER.most_move:
            part, _, _ = self._before(self.route())
            self._doubt(part, f"its end moved by {1000 * abs(move):.0f} mm between looks")

    def _remove_provisional(self) -> None:
        """Remove from the map what was observed only from afar at the end of the straight ahead, as
        looks from close by replace it."""
        i = self._closer.index(self.route())
        if i is None:
            return
        for part in self.belief.take_back(self.leg.path[i][0]):
            self._bends.discard(part)
            self._back.forget(part)
        self.planner = self._through([])
        self.leg = replace(self.leg, path=self.leg.path[: i + 1])

    def _measure_sizes(self, ahead: Sighting, look: Look, route: Route) -> None:
        """Keep a sighting of a reducer or an elbow from close by, with those of the same kind just
        before it; now and then one shows free pipe where there is a shallow cone."""
        sized, free = self._shows_sizes(ahead, route), ahead.kind == ("", "")
        if not (free or (sized and self._close.are_of(ahead))):
            self._close.clear()
        in_pipe = self.belief.fitting(self._before(route)[0]).is_plain
        if sized and (self._shows_pipe(look) or not in_pipe):
            self._close.add(ahead, look.distance)

    def _shows_pipe(self, look: Look) -> bool:
        """Return whether a look ahead has the axis of the pipe that it leads out of where the map
        has it; see ``is_along``."""
        part, _, leave = self._before(self.route())
        axis = self.belief.port((part, leave)).rotation[:, 2]
        return look.ahead is not None and is_along(look.ahead, look.frame, axis)

    def _shows_sizes(self, ahead: Sighting, route: Route) -> bool:
        """Return whether a sighting is one of a reducer or an elbow from close by."""
        near = ahead.distance - self._half < LOOKS.close + LOOKS.doubt
        close = near or self._closer.index(route) is not None
        return isinstance(ahead.fitting, Reducer | Elbow) and close

    def _measures_on(self, ahead: Sighting, route: Route, distance: float) -> bool:
        """Return whether a robot close to a reducer or an elbow is to look at it once more."""
        again = distance + LOOKS.doubt
        late = again > self.leg.end or self._closer.too_late(again, route)
        i = self._closer.index(route)
        # Out of a fitting, its nose is about to come into the reducer.
        plain = self.belief.fitting(self._before(route)[0]).is_plain
        few = self._close.are_few(route.passages[-1 if i is None else i].s_enter)
        return plain and not late and few and self._shows_sizes(ahead, route)

    def _before(self, route: Route) -> Edge:
        """Return the passage that a look leads out of: the straight whose end is provisional, or
        else the last one on the leg that is not assumed pipe."""
        i = self._closer.index(route)
        if i is not None:
            return self.leg.path[i]
        *before, last = self.leg.path
        assumed = self._assumed > 0 and self.belief.fitting(last[0]).is_plain
        return before[-1] if assumed and before else last

    def _measure_passed(self) -> float:
        """Correct the size of a fitting that has been measured from behind; return by how much
        longer it is now, m."""
        measured = self._back.measured()
        if measured is None:
            return 0.0
        part, key, size, std = measured
        fitting = self.belief.fitting(part)
        longer = size - getattr(fitting, key)
        if isinstance(fitting, Elbow):
            longer *= fitting.angle
        self.belief.resize(part, **{key: size})
        self.belief.measured(part, **{key: std})
        self._doubts.pop(self.belief.part_name(part), None)
        self.planner = self._through([])
        self.leg, self.look_at = replace(self.leg, end=self.leg.end + longer), self.look_at + longer
        return longer

    # Extending the map

    def _with_free_pipe(self, more: float, std: float = math.inf) -> tuple[Edge, ...]:
        """Return the path at hand with ``more`` m of free pipe at its end; ``std``: m, of where a
        fitting begins that is sighted there."""
        path, end = self.leg.path, _end_of(self.leg.path)
        if self.belief.fitting(end[0]).is_plain:
            left = self.belief.lengthen(end[0], more)
            if left > BELIEF.least_straight or not self.belief.drop(end[0]):
                return path
            path, more = path[:-1], left
        if more <= BELIEF.least_straight:
            more -= self._measure_reducer(path[-1][0], more, std)
            if more > BELIEF.error:
                self._doubt(path[-1][0], f"{1000 * more:.0f} mm of pipe behind it may be none")
            return path
        return (*path, (self.belief.straight_beyond(end, more), "start", "end"))

    def _measure_reducer(self, part: int, more: float, std: float) -> float:
        """Correct the length of a reducer behind which a fitting directly follows that begins
        ``more`` m beyond its end, to ``std`` m: that tells the length better than the far end of a
        shallow cone. Return by how much longer it is now, m."""
        reducer, stds = self.belief.fitting(part), self.belief.stds
        known = stds.get(self.belief.part_name(part), {}).get("length", 0.0)
        if not isinstance(reducer, Reducer) or not known or abs(more) > BELIEF.least_straight:
            return 0.0
        share = known**2 / (known**2 + std**2)
        try:
            self.belief.resize(part, length=reducer.length + share * more)
        except GeometryError:
            return 0.0
        self.belief.measured(part, length=known * math.sqrt(1 - share))
        return share * more

    def _add_fitting(
        self, fitting: Fitting, ahead: Sighting, path: tuple[Edge, ...], look: Look
    ) -> Decision:
        """Add a fitting sighted at the end of a path to the map, and extend the leg into it."""
        belief, end, time, distance = self.belief, _end_of(path), look.time, look.distance
        weight, stds = 0.0, {} if ahead.fitting is None else size_stds([ahead], fitting)
        if self._close.are_of(ahead):
            stds = self._close.stds()
            fitting, weight, doubt = self._close.mean(), self._close.weight(), self._close.doubt()
            name = belief.next_name(fitting)
            if ahead.confidence > EXPLORER.sure:
                # They replace what was seen from afar.
                self._doubts.pop(name, None)
            if doubt:
                self._doubts.setdefault(name, doubt)
            self._close.clear()
        fitting = _fitted(fitting, ahead.enter, 2 * belief.fitting(end[0]).port_radius(end[1]))
        # The map may have the fitting already, by another way.
        known = None if end in belief.joined else belief.known_at(end, fitting, ahead.enter)
        if end in belief.joined or known is not None:
            events = [] if known is None else [self._closes(time, end, known)]
            self._go_on(path)
            return self._replan(time, events, self._onward(distance))
        side, apart = _side(ahead, look, belief.port(end).rotation[:, 2]), 0.0
        if self._confirmation.side is not None:
            side, apart = _between(self._confirmation.side, side, fitting, ahead.enter)
        part = belief.attach(end, fitting, ahead.enter, side)
        if apart > ANGLES and not fitting.is_axial:
            # Of its port: sizes that are measured later say nothing about it.
            name = belief.name((part, ahead.enter))
            self._doubts[name] = f"looks differ by {math.degrees(apart):.0f} deg in direction"
        belief.measured(part, **stds)
        self._measure_later(part, ahead, weight)
        events, name = list[Event](), belief.part_name(part)
        if name not in self._named:
            self._named.add(name)
            events.append(FittingFound(self._number, time, name, ahead.distance))
        for port, other in belief.meeting(part):
            if {port, other} <= set(belief.unexplored):
                events.append(self._closes(time, port, other))
        self._go_on(path)
        onward = self._through_new(part, ahead.enter, distance)
        if onward is None:
            return self._replan(time, events, self._onward(distance))
        self._go_on(onward)
        self.look_at = self.leg.end - EXPLORER.look_before
        if belief.is_last(part):
            self._look_closer(ahead, path, distance)
        return Decision(self.leg, True, events)

    def _measure_later(self, part: int, ahead: Sighting, weight: float) -> None:
        """Have a new fitting measured when the robot has come through it: the angle of a bend, and
        sizes that are in doubt; ``weight``: of those that the map has, see ``CloseLooks``."""
        fitting, name = self.belief.fitting(part), self.belief.part_name(part)
        if isinstance(fitting, Elbow | Wye):
            self._bends.add(part)
        if name in self._doubts:
            self._back.measure(part, weight)
        elif ahead.confidence < EXPLORER.sure:
            self._doubt(part, "its sizes hardly show")
            # A lamp shows the cone of a reducer no better from behind.
            if isinstance(fitting, Elbow):
                self._back.measure(part, weight)
        elif name in self.belief.unsure() and isinstance(fitting, Elbow | Reducer):
            self._back.measure(part, weight)

    def _length_std(self, part: int, look: Look, end_std: float) -> float:
        """Return the standard deviation, m, of the length of a straight ``part`` whose end a look
        has placed to ``end_std`` m; 0 by error-free sight."""
        placed = self._back.placed
        if end_std == 0.0 or placed is None or placed[0] != part:
            return math.hypot(end_std, look.std)
        _, at, std = placed
        return math.hypot(end_std, std, LOOKS.travel * (look.distance - at))

    def _shows_axis(self, ahead: Sighting, std: float) -> bool:
        """Return whether a sighting shows how the pipe lies: where a bend begins nearer than a lens
        sees the wall, no straight wall does. ``std``: as of ``_measure_bend``."""
        near = ahead.distance - self._half < EXPLORER.blind
        return std == 0.0 or not (near and isinstance(ahead.fitting, Elbow))

    def _measure_bend(self, axis: Array, std: float) -> bool:
        """Measure the elbow, or the branch of a wye, that the robot has come through into a pipe
        along ``axis`` (3,), world frame, estimate; return whether its angle or its direction on the
        map has changed. ``std``: m, of the robot's arc length, 0 where it knows its pose."""
        # Before an elbow its far end is hidden, so a picture shows its angle badly, and now and
        # then one is off in direction. How the robot is turned it knows better, even where it has
        # come round by other fittings.
        path = self.leg.path
        last = len(path) - 1
        if last > 0 and self.belief.fitting(path[last][0]).is_plain:
            last -= 1
        part, enter, leave = path[last]
        fitting = self.belief.fitting(part)
        straight_on = isinstance(fitting, Wye) and "branch" not in (enter, leave)
        if part not in self._bends or straight_on or _end_of(path) in self.belief.joined:
            return False
        self._bends.remove(part)
        before = -self.belief.port((part, enter)).rotation[:, 2]
        on = self.belief.port((part, leave)).rotation[:, 2]
        angle, off = float(angle_between(before, axis)), _about(before, on, axis)
        assert isinstance(fitting, Elbow | Wye)
        if isinstance(fitting, Wye) and is_sharp(fitting, enter, leave):
            angle = math.pi - angle
        if angle < EXPLORER.least_bend:
            return False
        right = abs(angle - fitting.angle) < EXPLORER.bend_tolerance
        if not right:
            self.belief.resize(part, angle=angle)
        # Within the tolerance the map keeps an angle that may be off by any part of it.
        kept = EXPLORER.bend_tolerance / math.sqrt(3) if right else 0.0
        self.belief.measured(part, angle=math.hypot(BELIEF.angle_std, kept) if std else 0.0)
        joint = self.belief.hangs_on(part)
        turned = abs(off) > EXPLORER.turn_tolerance and joint is not None and joint[1][1] == enter
        if turned:
            self.belief.turn(part, off)
        if right and not turned:
            return False
        self.planner = self._through([])
        return True

    def _closes(self, time: float, end: Port, other: Port) -> Event:
        """Close a loop of the map; it is in doubt where its ends miss each other by more than what
        was measured around it may be off by."""
        miss, doubtful = self.belief.close(end, other)
        if doubtful:
            self._doubt(end[0], f"the loop there missed by {1000 * miss:.0f} mm")
        return LoopClosed(self._number, time, self.belief.name(end), self.belief.name(other), miss)

    def _through_new(self, part: int, enter: str, distance: float) -> tuple[Edge, ...] | None:
        """Return the path at hand, extended to the nearest unexplored port of a new fitting; None
        where there is none but round a sharp turn, or where the robot has come too far to stand
        before it: fittings that follow closely are prepared for together, before the first."""
        unexplored = self.belief.unexplored
        leaves = [end[1] for end in unexplored if end[0] == part]
        fitting = self.belief.fitting(part)
        leaves = [port for port in leaves if not is_sharp(fitting, enter, port)]
        if not leaves:
            return None
        leave = min(
            leaves, key=lambda port: round(self.planner.route([(part, enter, port)]).length, 3)
        )
        path = (*self.leg.path, (part, enter, leave))
        return path if distance <= self.planner.latest_stand(path, len(path) - 1) else None

    def _inspected(self, time: float, distance: float, end: Port, goal: str) -> Decision:
        """Decide at an observed end: mark it as explored, and go on to another port."""
        belief, reached = self.belief, goal if goal in self.goals else ""
        self._falls = self._most_falls
        belief.done(end, reached)
        events: list[Event] = [
            EndInspected(self._number, time, belief.name(end), belief.ends[end]),
        ]
        if reached:
            events.append(GoalReached(self._number, time, reached))
            self.goals.remove(reached)
        if not (self._explores or self.goals):
            return Decision(None, False, events)
        return self._replan(time, events, self._onward(distance))

    # Planning

    def _onward(self, distance: float) -> Replan:
        """See ``MapPilot``; legs lead ahead or back, and round sharp turns where they can."""
        route = self.route()
        self._drop_assumed(route.passages[route.index_at(distance)].index)
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

    def _from(self, location: PartLocation) -> Replan:
        """See ``MapPilot``; legs lead round sharp turns where they can."""
        self._drop_assumed(location.part)

        def onward(planner: LegPlanner, goal: int, closed: Closed) -> list[Leg] | None:
            legs = planner.replan_from(location, goal, closed)
            return legs and planner.gentler(legs, location, goal, closed)

        return onward

    def _drop_assumed(self, here: int) -> None:
        """Remove free pipe that the robot has only assumed, unless its part ``here`` is that: when
        it comes again it is to look from where the fitting before that pipe ends."""
        *path, (part, enter, _) = self.leg.path
        fitting, name = self.belief.fitting(part), self.belief.part_name(part)
        if self._assumed == 0.0 or not path or part == here or enter != "start":
            return
        more = fitting.length_of_axes > self._assumed + BELIEF.shortest
        if more or not fitting.is_plain or not self.belief.drop(part):
            return
        self._assumed = 0.0
        self._doubts.pop(name, None)
        self.planner = self._through([])
        self.leg = replace(self.leg, path=tuple(path))

    def _replan(self, time: float, events: Sequence[Event], plan: Replan) -> Decision:
        """Go to the unexplored port that asks for the least travel, or else to the start."""
        events = list(events)
        legs = self._least(self.belief.unexplored, plan)
        if legs is None and self._try_again():
            legs = self._least(self.belief.unexplored, plan)
        if legs is None:
            self._leave_the_rest()
            legs = self._least([self.belief.start], plan)
        return self._begin(time, events, legs)

    def _try_again(self) -> bool:
        """Reopen each port that the robot has given up and not tried again yet; return whether
        there is one. It comes there from elsewhere now, and often it was a fall that stopped it."""
        again = [end for end in [*self._closed, *self._left] if end not in self._tried_again]
        self._tried_again.update(again)
        self._closed = [end for end in self._closed if end not in again]
        for end in again:
            if self._left.pop(end, ""):
                self.belief.reopen(end)
        return bool(again)

    def _leave_the_rest(self) -> None:
        """Give up the unexplored ports, none of which can be reached."""
        hung = ", ".join(self.belief.name(end) for end in dict.fromkeys(self._closed))
        for end in self.belief.unexplored:
            self._give_up_port(end, f"no way past {hung}" if hung else "no way there is left")

    def _verdict(self, time: float) -> list[Event]:
        """Return the robot's verdict on its map when it is home: before that, nothing has shown
        that it can be driven by."""
        belief = self.belief
        parts = belief.network.pipes.parts
        fittings = sum(not part.fitting.is_plain for part in parts)
        ends = len(belief.explored) - len(self._left)
        if self.left:
            return [ExplorationIncomplete(self._number, time, fittings, ends, self.left)]
        return [ExplorationComplete(self._number, time, fittings, ends)]

    def _give_up_port(self, end: Port, why: str) -> None:
        """Leave a port unexplored."""
        self._assumed = 0.0
        self.belief.note(end, "impassable")
        self.belief.done(end)
        self._left[end] = why

    def _least(self, goals: Sequence[Port], plan: Replan) -> list[Leg] | None:
        """Return legs to that of the ports ``goals`` which costs least; None where no path leads to
        any."""
        planner = self._through(goals)
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
        self.belief.settle()
        self._confirmation.cancel()
        self._close.clear()
        self._stop_looking_back()
        self._back.begin()
        end = _end_of(self.leg.path)
        blind = self.leg.goal < 0 or end == self.belief.start or end in self.belief.ends
        self.look_at = math.inf if blind else self.leg.end - EXPLORER.look_before
        if self.leg.gear != before.gear or self.leg.path[: len(before.path)] != before.path:
            return decision
        if any(isinstance(event, FellOff) for event in events):
            # Even on the path at hand, headway counts anew from where it lies: it was none there.
            return decision
        self.leg = replace(self.leg, begin=before.begin)
        return Decision(self.leg, True, events)

    def _go_on(self, path: tuple[Edge, ...]) -> None:
        """Extend the leg at hand to the end of ``path``, which begins with its own path."""
        self.planner = self._through([])
        self.leg = self._longer(replace(self.leg, path=path))

    def _longer(self, leg: Leg) -> Leg:
        """Return a leg that ends where its path does."""
        end = self.planner.route(leg.path).length - self._half - self._robot.nose_room
        return replace(leg, end=end, note=f"to {self.belief.name(_end_of(leg.path))}")

    def _through(self, goals: Sequence[Port]) -> LegPlanner:
        """Return the planner of legs through the present map, to some of its ports."""
        names = ["the start" if g == self.belief.start else self.belief.name(g) for g in goals]
        ends = [self.belief.start, *goals]
        return LegPlanner(self.belief.network, ends, names, self._robot, self._arcs)


def _end_of(path: Sequence[Edge]) -> Port:
    """Return the port that a path ends at."""
    part, _, leave = path[-1]
    return part, leave


def _side(ahead: Sighting, look: Look, axis: Array) -> Array:
    """Return the x axis (3,) of the port that is seen ahead, through a port with z along ``axis``
    (3,), world frame."""
    side = side_of(look.frame, axis)
    return math.cos(ahead.turn) * side + math.sin(ahead.turn) * np.cross(axis, side)


def _between(first: Array, side: Array, fitting: Fitting, enter: str) -> tuple[Array, float]:
    """Return the mean of two directions (3,) of a fitting, and the angle between them, rad."""
    if isinstance(fitting, Tee) and enter == "branch" and first @ side < 0:
        first = -first  # From there a tee looks the same from both sides.
    apart = float(angle_between(first, side))
    return (unit(first + side) if apart < math.pi / 2 else side), apart


def _about(axis: Array, one: Array, other: Array) -> float:
    """Return the angle, rad, by which ``one`` (3,) has to turn about ``axis`` (3,) to lie in the
    half-plane of ``other`` (3,)."""
    cross = np.cross(axis, one)
    return math.atan2(float(other @ cross), float(other @ np.cross(cross, axis)))


def _has_bore(fitting: Fitting) -> bool:
    """Return whether a fitting is a pipe or changes the bore."""
    return fitting.is_plain or isinstance(fitting, Reducer)


def _of_bore(fitting: Fitting, bore: float) -> Fitting:
    """Return a fitting of another bore, m: what a robot cannot measure is as usual for that."""
    every = vars(type(fitting)).items()
    usual = {name: size for name, size in every if isinstance(size, Bores)}
    bores = {fitting.bore_key(port): bore for port in fitting.port_names}
    return replace(fitting, **{**usual, **bores})  # type: ignore[type-var]


def _fitted(fitting: Fitting, enter: str, bore: float) -> Fitting:
    """Return a fitting as observed, with the bore of the pipe that it is joined to."""
    if abs(2 * fitting.port_radius(enter) - bore) <= BORE_TOLERANCE:
        return fitting
    try:
        return replace(fitting, **{fitting.bore_key(enter): bore})  # type: ignore[type-var]
    except GeometryError:
        return fitting
