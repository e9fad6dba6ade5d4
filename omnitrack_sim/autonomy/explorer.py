"""Exploration of an unknown network.

The pilot looks ahead, extends its map, and chooses the next leg. Its legs lead through the pipes of
its map. A leg leads to an unexplored port; when the robot's nose is there and it sees on, the leg
is extended. Among the ports of a fitting that it comes to, it takes the one with the shortest way
there, which is the branch of a tee; among all others, at an end or where its way is blocked, the
one that asks for the least travel, back and on. As whatever is ahead asks for less than anything
that it would have to back out for, it explores depth first, and it never backs out of a pipe that
it has not seen the end of. When nothing is left it goes back to where it began.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from omnitrack_sim.autonomy.belief import BELIEF, Belief
from omnitrack_sim.autonomy.leg_planner import LegPlanner, PartLocation
from omnitrack_sim.autonomy.pilots import Decision, MapPilot, Replan
from omnitrack_sim.autonomy.sight import (
    LOOKS,
    Ahead,
    Look,
    LookingBack,
    LookingCloser,
    is_measured,
    side_of,
    weights,
)
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Array, angle_between
from omnitrack_sim.pipes import BORE_TOLERANCE, Arcs, Elbow, Fitting, Reducer, Route, Wye
from omnitrack_sim.pipes.map_difference import LEAST_LENGTH, LENGTHS
from omnitrack_sim.pipes.network import End
from omnitrack_sim.pipes.planning import Closed, Leg
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.events import (
    EndInspected,
    Event,
    ExplorationComplete,
    ExplorationIncomplete,
    FittingFound,
    GoalReached,
    LoopClosed,
)
from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class ExplorerSettings:
    """Conditions in which a robot that explores looks, and thresholds for changes of its map.

    Attributes:
        creep: m, of free pipe that a robot assumes where it should see on and does not.
        most_creep: m, that it assumes in all before a look tells it something: what it comes
            through unseen is not on its map, and soon its pictures are not those of the map.
        look_step: m, travel between two looks along a pipe whose end is not in sight.
        look_before: m, before the end of a leg where a robot looks on: far enough for a second look
            before its nose is in what follows directly.
        least_bend: rad, least angle of an elbow.
        bend_tolerance: rad, error of an elbow's angle from which on the map is changed.
        settling: m, travel after such a change in which a robot relocalises on the new map.
        confidence: probability from which on a robot believes an observation.
        sure: probability from which on free pipe, and what else is seen, is not in doubt.
        sharp: rad, turn in a fitting from which on a robot falls about every second time, such as
            that from a wye's branch back along its run: ports beyond such turns come last.
        most_off: rad, between the pipe that a picture shows and the one that the robot is in, from
            which on its sizes are wrong: by a lamp radii are 20 mm too great beyond.
        most_move: m, between an end as it was seen from afar and from close by, from which on the
            length of the pipe is in doubt: the robot may have slipped.
        most_reducer_std: m, standard deviation of the distance of a reducer from which on its ends
            hardly show: right ones have 8 to 14 mm, wrong ones 29 to 40.
        detour: m, travel that a robot prefers to such a turn.
        reversals: most reversals by which it goes round such turns on its way to a port.
        touch: m, before an observed end from which on a robot without progress has come to it.
        rest: rad, most angle of a bend that may be the rest of the one before it: before a wide
            bend its far end is hidden, so that the map may have it too short by that much.
        same_side: rad, between the directions of two bends that may be one.
        steady: part of a bore by which two looks in a pipe of another bore may differ: the cones of
            reducers change faster.
    """

    creep: float = 0.1
    most_creep: float = 0.2
    look_step: float = 0.1
    look_before: float = 0.02
    least_bend: float = math.radians(5)
    bend_tolerance: float = math.radians(0.5)
    settling: float = 0.05
    confidence: float = 0.5
    sure: float = 0.95
    sharp: float = math.radians(100)
    most_off: float = math.radians(1.5)
    most_move: float = 0.06
    most_reducer_std: float = 0.02
    detour: float = 20.0
    reversals: int = 2
    touch: float = 0.05
    rest: float = math.radians(35)
    same_side: float = math.radians(20)
    steady: float = 0.005


EXPLORER = ExplorerSettings()

SHALLOW = "a shallow reducer may be in it"
"""Doubt about pipe that a lamp shows as free."""

ONE_SIDED = "its length was seen from one side only"
"""Doubt about a reducer whose ends show less exactly than lengths on a map may be wrong."""


@dataclass
class Missed:
    """A reducer that a robot has come through unseen, and now looks back for.

    Attributes:
        part: the straight behind it.
        bore: m, of the pipe before it.
        at: m, arc length on the leg of the next look.
        lengths: m, of the reducer, by the looks so far.
    """

    part: int
    bore: float
    at: float
    lengths: list[float]


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
        self._named: set[str] = set()
        self._assumed = 0.0  # m, of free pipe since the last look that told something
        # Sightings of the same one from close by, and from where, m.
        self._close: list[tuple[Ahead, float]] = []
        self._doubts: dict[str, str] = {}  # names of parts of the map, and why
        # Of reducers in doubt, by name: the weight of the looks from before them, 1/m².
        self._ahead: dict[str, float] = {}
        self._felt = math.nan  # m, bore by the arms at the last look, where the map has another
        self._missed: Missed | None = None
        # Out of a fitting: what was sighted first, where, and from where, m.
        self._sighted: tuple[tuple[str, str], float, float] | None = None
        self._left: dict[End, str] = {}
        self._tries_again = True
        self._back = LookingBack(belief, self._half, EXPLORER.confidence)
        self._closer = LookingCloser(belief, self._half)
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
    def left(self) -> str:
        """See ``Pilot``."""
        ports = {self.belief.name(end): why for end, why in self._left.items()}
        doubts = self._doubts | self._back.doubts
        return ", ".join(f"{name} ({why})" for name, why in (ports | doubts).items())

    def done_at(self, distance: float) -> float:
        """See ``Pilot``: the part of the ends known so far, and of the way home as one more."""
        done, to_come = len(self.belief.explored), len(self.belief.unexplored) + 1
        return (done + super().done_at(distance)) / (done + to_come)

    # What happens to it

    def on_look(self, look: Look) -> Decision:
        """See ``Pilot``; the look goes back as well where the robot ``looks_back``."""
        distance = look.distance
        if self._is_elsewhere(look):
            return Decision(self.leg, True, ())
        if self._missed is not None:
            decision = self._insert_missed(look)
            if decision is not None:
                return decision
        elif self.looks_back(distance):
            distance = self._back.located(self.route(), distance, look.behind)
            distance += self._measure_passed()
            if distance != look.distance:
                self._closer.forget()
        if look.distance < self.look_at:
            return Decision(self.leg, True, (), distance - look.distance)
        located = self._closer.located(self.route(), distance, look.ahead)
        self._doubt_end(located - distance)
        distance, shift = located, located - look.distance
        return self._look_on(look._replace(distance=distance))._replace(shift=shift)

    def _look_on(self, look: Look) -> Decision:
        """Decide after a look ahead from the corrected position."""
        ahead, distance = look.ahead, look.distance
        route = self.route()
        if ahead is None or ahead.confidence < EXPLORER.confidence:
            self.look_at = distance + LOOKS.again
            if not self._closer.too_late(self.look_at, route):
                return Decision(self.leg, True, ())
            if not self._close:
                # The robot has to rely on what it observed from afar. What no form explains from
                # close by, such as a cross, may look like a tee from there.
                self._doubts[self._provisional_name()] = "seen from afar only"
                self.belief.settle()
                observed = _end_of(self.leg.path) in self.belief.ends
                self.look_at = math.inf if observed else self.leg.end - EXPLORER.look_before
                return Decision(self.leg, True, ())
            ahead, distance = self._close[-1]
        else:
            again = self._next_look(ahead, look, route)
            if again is not None:
                self.look_at = again
                return Decision(self.leg, True, ())
        self._assumed = 0.0
        end = self._end_by_looks(ahead, distance)
        was_far = self._closer.index(route) is not None
        self._forget_what_was_far()
        measured = self._measure_bend(look.frame @ ahead.axis)
        more = end - self.route().length
        if was_far:
            self._doubt_end(more)
        path = self._reached(more)
        if measured:
            # The map has moved under the robot: it relocalises before it measures what is beyond.
            self._go_on(path)
            self.look_at = max(
                distance, min(distance + EXPLORER.settling, self.leg.end - EXPLORER.look_before)
            )
            return Decision(self.leg, True, ())
        if ahead.fitting is not None:
            return self._comes_to(ahead.fitting, ahead, path, look)
        if ahead.end == "open" or ahead.end == "closed":
            self.belief.note(_end_of(path), ahead.end)
        elif ahead.confidence < EXPLORER.sure:
            name = self.belief.part_name(_end_of(path)[0])
            self._doubts[name] = SHALLOW
        self._go_on(path)
        self.look_at = math.inf if ahead.end else distance + EXPLORER.look_step
        if ahead.end:
            self._look_closer(ahead, path, distance)
        return Decision(self.leg, True, ())

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
            # It should see on and does not: a little free pipe is assumed, and it looks again.
            self._assumed += EXPLORER.creep
            self._go_on(self._reached(EXPLORER.creep))
            self.look_at = distance
            return Decision(self.leg, True, ())
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
        """Give up the port that the robot was on its way to, and go on to another; give up all
        where it was on its way home."""
        port = _end_of([self.leg, *self._to_come][-1].path)
        if port not in self.belief.unexplored:
            return super()._on_last_fall(time, events, location)
        self._give_up_port(port, "has fallen too often on the way there")
        self._falls = self._most_falls
        return self._replan(time, events, self._from(location))

    # Looking once more

    @property
    def looks_at(self) -> float:
        """Arc length on its leg, m, of the next look."""
        missed = self._missed.at if self._missed else math.inf
        return min(self.look_at, missed, self._back.at(self.route()))

    def looks_back(self, distance: float) -> bool:
        """Return whether a look at arc length ``distance`` m of its leg goes back as well."""
        route = self.route()
        close = bool(self._closer.index(route)) and distance >= self.look_at
        return self._missed is not None or close or distance >= self._back.at(route)

    def _next_look(self, ahead: Ahead, look: Look, route: Route) -> float | None:
        """Return the arc length, m, of the look that is needed before a sighting is believed; None
        where none is."""
        distance = look.distance
        self._measure_sizes(ahead, look, route)
        again = self._closer.doubted(ahead, route, distance)
        if again is not None:
            return again
        begins = ahead.kind != ("", "") and self._closer.index(route) is None
        if begins and self._back.once_more(route, distance):
            return distance
        if not self._is_confirmed(ahead, look, route) or self._measures_on(ahead, route, distance):
            return distance + LOOKS.doubt
        return None

    def _is_confirmed(self, ahead: Ahead, look: Look, route: Route) -> bool:
        """Return whether a sighting out of a fitting has been made before, of the same at the same
        place: a bend that is not over looks like another one that begins at the lens."""
        out_of, distance = self._before(route), look.distance
        if ahead.fitting is None or self.belief.fitting(out_of[0]).is_plain:
            self._forget_sighted()
            return True
        at, bends = distance + ahead.distance, isinstance(ahead.fitting, Elbow)
        last = route.passages[-1]
        # What begins before the middle of the last fitting is that fitting itself.
        itself = last.index == out_of[0] and at < (last.s_enter + last.s_leave) / 2
        if itself or self._is_rest(ahead, look, out_of):
            return False
        confirmed = False
        if self._sighted is not None and self._sighted[0] == ahead.kind:
            _, before, since = self._sighted
            # What begins at the lens moves with it. Other fittings are not seen where there are
            # none.
            near = (distance - since) / 2 if bends else BELIEF.error
            confirmed = abs(at - before) < near
            if bends and not confirmed:
                return False
        # The robot may have been elsewhere at the first sighting than it took itself to be, so the
        # next one is compared with this.
        self._sighted = None if confirmed else (ahead.kind, at, distance)
        return confirmed

    def _forget_sighted(self) -> None:
        """Forget what was sighted out of a fitting and not confirmed: the pipe there is in doubt,
        but for bends, which are often the rest of the one before."""
        if self._sighted is not None and self._sighted[0][0] != Elbow.kind:
            name = self.belief.part_name(_end_of(self.leg.path)[0])
            self._doubts[name] = f"a {self._sighted[0][0]} in it was not confirmed"
        self._sighted = None

    def _out_of(self) -> Edge:
        """Return the last passage of the leg; of pipe that is assumed, the one before it."""
        *before, last = self.leg.path
        assumed = self._assumed > 0 and self.belief.fitting(last[0]).is_plain
        return before[-1] if assumed and before else last

    def _is_rest(self, ahead: Ahead, look: Look, out_of: Edge) -> bool:
        """Return whether a bend that is sighted out of a bend may be the rest of that."""
        part, enter, leave = out_of
        bend = self.belief.fitting(part)
        if not (isinstance(bend, Elbow) and isinstance(ahead.fitting, Elbow)):
            return False
        if ahead.fitting.angle > EXPLORER.rest:
            return False
        on = self.belief.port((part, leave)).rotation[:, 2]
        # Towards the middle of the bend, which lies behind who comes out of it.
        middle = self.belief.port((part, enter)).rotation[:, 2]
        middle = middle - on * (middle @ on)
        return float(angle_between(_side(ahead, look, on), middle)) < EXPLORER.same_side

    def _is_elsewhere(self, look: Look) -> bool:
        """Return whether the robot has just learned by its arms that it is in a pipe of another
        bore than its map has there, so that a reducer has been missed: it doubts that pipe, gives
        it the bore, and looks back for the reducer. Where the bore is right, there was none that
        did not show."""
        route = self.route()
        here = route.passages[route.index_at(look.distance)]
        within = here.s_enter + self._half < look.distance < here.s_leave - self._half
        if not (here.part.fitting.is_plain and within):
            return False
        bore, name = 2 * here.part.fitting.port_radius(here.enter), here.part.name
        if abs(look.bore - bore) < LENGTHS / 2 * bore and self._doubts.get(name) == SHALLOW:
            del self._doubts[name]
        felt, self._felt = self._felt, math.nan
        if not abs(look.bore - bore) > LENGTHS * bore:
            return False
        self._doubts[name] = f"its bore is {1000 * look.bore:.0f} mm by the arms"
        self._forget_what_was_far()
        part, entered, _ = self.leg.path[-1]
        if part != here.index or entered != "start" or not self.belief.is_last(part):
            return False
        if not abs(look.bore - felt) < EXPLORER.steady * bore:
            # It may still stand in the reducer.
            self._felt, self.look_at = look.bore, look.distance + 2 * LOOKS.doubt
            return True
        self.belief.resize(part, inner_diameter=round(look.bore, 3))
        self._missed, self.look_at = Missed(part, bore, look.distance, []), look.distance
        self._go_on(self.leg.path)
        # The same leg would keep its route, in which the pipe has the other bore.
        self.leg = replace(self.leg, note=f"{self.leg.note}: {self._doubts[name]}")
        return True

    def _insert_missed(self, look: Look) -> Decision | None:
        """Decide after a look back for a reducer that the robot has missed, to put it into the
        straight at the end of the map; None where the looks do not tell enough yet."""
        belief, behind, missed = self.belief, look.behind, self._missed
        assert missed is not None
        missed.at = look.distance + LOOKS.doubt
        if behind is None or not isinstance(behind.fitting, Reducer):
            return None
        self._forget_what_was_far()
        here = self.route().passages[-1]
        if not (here.part.fitting.is_plain and belief.is_last(here.index)):
            self._stop_looking_back()
            return None
        reducer = behind.fitting
        (near,) = {"start", "end"} - {behind.enter}
        right = abs(2 * reducer.port_radius(near) - missed.bore) < LENGTHS * missed.bore
        if not right or behind.distance_std > EXPLORER.most_reducer_std:
            return None
        missed.lengths.append(reducer.length)
        if len(missed.lengths) < LOOKS.for_sizes:
            return None
        fitting: Fitting = replace(reducer, length=float(np.mean(missed.lengths)))
        for port, bore in ((near, missed.bore), (behind.enter, 2 * here.part.fitting.radius)):
            fitting = _fitted(fitting, port, bore)
        at = look.distance - behind.distance
        gap = at - float(np.mean(missed.lengths)) - here.s_enter
        direct = gap <= BELIEF.least_straight
        if gap < -LOOKS.most_shift or (direct and not belief.drop(here.index)):
            self._stop_looking_back()
            return None
        self._missed = None
        noted, path = belief.ends.pop((here.index, here.leave), None), self.leg.path
        self._doubts.pop(here.part.name, None)
        if direct:
            path = path[:-1]
        else:
            belief.resize(here.index, inner_diameter=missed.bore, length=gap)
        part = belief.attach(_end_of(path), fitting, near, look.frame[:, 0])
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
        return Decision(self.leg, True, [event], -gap if direct else 0.0)

    def _stop_looking_back(self) -> None:
        """Give up a missed reducer: the pipe behind it has the bore again that it is joined by."""
        if self._missed is not None:
            self.belief.resize(self._missed.part, inner_diameter=self._missed.bore)
            self._missed = None

    def _provisional_name(self) -> str:
        """Return the name of the fitting at the end of the provisional straight, or of that end."""
        belief, straight = self.belief, self.belief.provisional
        assert straight is not None
        end = straight, "end"
        beyond = belief.joined.get(end)
        return belief.name(end) if beyond is None else belief.part_name(beyond[0])

    def _look_closer(self, ahead: Ahead, path: tuple[Edge, ...], distance: float) -> None:
        """Plan another look at the end of a path from close by, where that is still far away."""
        close = self._closer.begin(ahead, self.planner.route(path), distance)
        self.look_at = self.look_at if close is None else close

    def _doubt_end(self, move: float) -> None:
        """Doubt the straight at hand where its end is ``move`` m elsewhere than it was seen from
        afar."""
        if abs(move) > EXPLORER.most_move:
            part, _, _ = self._before(self.route())
            name = self.belief.part_name(part)
            self._doubts[name] = f"its end moved by {1000 * abs(move):.0f} mm between looks"

    def _forget_what_was_far(self) -> None:
        """Remove from the map what was observed from afar, now that the robot is close to it."""
        i = self._closer.index(self.route())
        if i is None:
            return
        for part in self.belief.take_back(self.leg.path[i][0]):
            self._bends.discard(part)
            self._back.sizes.pop(part, None)
        self.planner = self._through([])
        self.leg = replace(self.leg, path=self.leg.path[: i + 1])

    def _measure_sizes(self, ahead: Ahead, look: Look, route: Route) -> None:
        """Keep a sighting of a reducer or an elbow from close by; forget those of anything else."""
        sized = self._shows_sizes(ahead, route)
        if not sized or (self._close and self._close[-1][0].kind != ahead.kind):
            self._close = []
        # A picture that has the pipe another way than it is has wrong sizes too.
        part, _, leave = self._before(route)
        off = angle_between(look.frame @ ahead.axis, self.belief.port((part, leave)).rotation[:, 2])
        in_pipe = self.belief.fitting(part).is_plain
        if sized and not (in_pipe and off > EXPLORER.most_off):
            self._close.append((ahead, look.distance))

    def _end_by_looks(self, ahead: Ahead, distance: float) -> float:
        """Return the arc length, m, at which a sighting from ``distance`` m begins: the mean of the
        looks from close by, weighted by their variances. The last of them sees the cone of a
        reducer from too near."""
        looks = [look for look in self._close if look[0].kind == ahead.kind]
        looks += [] if any(look is ahead for look, _ in looks) else [(ahead, distance)]
        ends = [at + look.distance for look, at in looks]
        return float(np.average(ends, weights=weights([look.distance_std for look, _ in looks])))

    def _shows_sizes(self, ahead: Ahead, route: Route) -> bool:
        """Return whether a sighting is one of a reducer or an elbow from close by."""
        near = ahead.distance - self._half < LOOKS.close + LOOKS.doubt
        close = near or self._closer.index(route) is not None
        return isinstance(ahead.fitting, Reducer | Elbow) and close

    def _measures_on(self, ahead: Ahead, route: Route, distance: float) -> bool:
        """Return whether a robot close to a reducer or an elbow is to look at it once more."""
        again = distance + LOOKS.doubt
        late = again > self.leg.end or self._closer.too_late(again, route)
        # Out of a fitting, its nose is about to come into the reducer.
        plain = self.belief.fitting(self._before(route)[0]).is_plain
        radii = self._radii() or [0.0]
        differ = max(radii) - min(radii) > LEAST_LENGTH / 2
        few = len(self._close) < (LOOKS.for_radius if differ else LOOKS.for_sizes)
        return plain and not late and few and self._shows_sizes(ahead, route)

    def _radii(self) -> list[float]:
        """Return the mean radii, m, of an elbow by the looks from close by."""
        seen = (look.fitting for look, _ in self._close)
        return [elbow.mean_radius for elbow in seen if isinstance(elbow, Elbow)]

    def _before(self, route: Route) -> Edge:
        """Return the passage before what it looks at: the straight whose end is provisional, or
        else the last one."""
        i = self._closer.index(route)
        return self._out_of() if i is None else self.leg.path[i]

    def _mean_of_looks(self, name: str) -> Fitting:
        """Return a reducer or an elbow, ``name`` on the map, with the mean sizes of the looks at
        it. Where those of a reducer differ, or its ends hardly show, it is in doubt: its cone is
        shallow, and what follows it hides its end."""
        looks, radii, self._close = self._close, sorted(self._radii()), []
        elbows = [look.fitting for look, _ in looks if isinstance(look.fitting, Elbow)]
        if elbows:
            # One look may be far off.
            middle = radii[1:-1] if len(radii) > LOOKS.for_sizes else radii
            angle = float(np.mean([elbow.angle for elbow in elbows]))
            return replace(elbows[0], mean_radius=float(np.mean(middle)), angle=angle)
        reducers = [look.fitting for look, _ in looks if isinstance(look.fitting, Reducer)]
        sizes = np.array([(one.length, one.end_diameter, one.inner_diameter) for one in reducers])
        stds = [look.distance_std for look, _ in looks]
        differ, mean = np.ptp(sizes, axis=0), np.average(sizes, axis=0, weights=weights(stds))
        if np.any(differ > [2 * LEAST_LENGTH, *(LENGTHS * mean[1:])]):
            self._doubts[name] = "looks at it differ in its sizes"
        if min(stds) > EXPLORER.most_reducer_std:
            self._doubts[name] = "its ends hardly show"
        elif min(stds) > LOOKS.most_size_std and name not in self._doubts:
            self._doubts[name] = ONE_SIDED
        if name in self._doubts:
            self._ahead[name] = float(weights(stds).sum())
        return Reducer(*mean.tolist())

    def _measure_passed(self) -> float:
        """Resize a reducer or an elbow in doubt that the robot has measured from behind; return by
        how much longer it is now, m."""
        looks = self._back.sizes.items()
        part = next((part for part, seen in looks if is_measured(seen)), None)
        if part is None:
            return 0.0
        sizes, stds = np.array(self._back.sizes.pop(part)).T
        fitting, name = self.belief.fitting(part), self.belief.part_name(part)
        if np.ptp(sizes) > 2 * LEAST_LENGTH:
            return 0.0
        size = float(np.average(sizes, weights=weights(stds)))
        if isinstance(fitting, Reducer) and name in self._ahead:
            # Looks from both sides count by how exactly they show its ends.
            both = [weights(stds).sum(), self._ahead.pop(name)]
            size = float(np.average([size, fitting.length], weights=both))
        if isinstance(fitting, Elbow):
            key, longer = "mean_radius", (size - fitting.mean_radius) * fitting.angle
        else:
            assert isinstance(fitting, Reducer)
            key, longer = "length", size - fitting.length
        self.belief.resize(part, **{key: size})
        self._doubts.pop(name, None)
        self.planner = self._through([])
        self.leg, self.look_at = replace(self.leg, end=self.leg.end + longer), self.look_at + longer
        return longer

    # How the map grows

    def _reached(self, more: float) -> tuple[Edge, ...]:
        """Return the path at hand with ``more`` m of free pipe at its end."""
        path, end = self.leg.path, _end_of(self.leg.path)
        if self.belief.fitting(end[0]).is_plain:
            left = self.belief.lengthen(end[0], more)
            if left > BELIEF.least_straight or not self.belief.drop(end[0]):
                return path
            path, more = path[:-1], left
        if more <= BELIEF.least_straight:
            if more > BELIEF.error:
                name = self.belief.part_name(path[-1][0])
                self._doubts[name] = f"{1000 * more:.0f} mm of pipe behind it may be none"
            return path
        return (*path, (self.belief.straight_beyond(end, more), "start", "end"))

    def _comes_to(
        self,
        fitting: Fitting,
        ahead: Ahead,
        path: tuple[Edge, ...],
        look: Look,
    ) -> Decision:
        """Decide at the sight of a fitting at the end of a path: extend the map and the leg."""
        belief, end, enter = self.belief, _end_of(path), ahead.enter
        time, distance = look.time, look.distance
        if self._close and self._close[-1][0].kind == ahead.kind:
            fitting = self._mean_of_looks(belief.next_name(fitting))
        fitting = _fitted(fitting, enter, 2 * belief.fitting(end[0]).port_radius(end[1]))
        if end in belief.joined:  # by another way it is on the map already
            self._go_on(path)
            return self._replan(time, [], self._onward(distance))
        known = belief.known_at(end, fitting, enter)
        if known is not None:
            events = [self._closes(time, end, known)]
            self._go_on(path)
            return self._replan(time, events, self._onward(distance))
        side = _side(ahead, look, belief.port(end).rotation[:, 2])
        part = belief.attach(end, fitting, enter, side)
        if isinstance(fitting, Elbow | Wye):
            self._bends.add(part)
        name = belief.part_name(part)
        if name not in self._doubts and ahead.confidence < EXPLORER.sure:
            self._doubts[name] = "its sizes hardly show"
            # A lamp shows the cone of a reducer no better from behind.
            if isinstance(fitting, Elbow):
                self._back.sizes[part] = []
        elif name in self._doubts:
            self._back.sizes[part] = []
        events: list[Event] = []
        if name not in self._named:
            self._named.add(name)
            events.append(FittingFound(self._number, time, name, ahead.distance))
        for port, other in belief.meeting(part):
            if {port, other} <= set(belief.unexplored):
                events.append(self._closes(time, port, other))
        self._go_on(path)
        onward = self._through_new(part, enter, distance)
        if onward is None:
            return self._replan(time, events, self._onward(distance))
        self._go_on(onward)
        self.look_at = self.leg.end - EXPLORER.look_before
        if belief.is_last(part):
            self._look_closer(ahead, path, distance)
        return Decision(self.leg, True, events)

    def _measure_bend(self, axis: Array) -> bool:
        """Measure the elbow, or the branch of a wye, that the robot has come through into a pipe
        along ``axis`` (3,), world frame, estimate; return whether its angle on the map has
        changed."""
        # Before an elbow its far end is hidden, so a picture shows its angle badly. How the robot
        # is turned it knows better, even where it has come round by other fittings.
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
        angle = float(angle_between(-self.belief.port((part, enter)).rotation[:, 2], axis))
        assert isinstance(fitting, Elbow | Wye)
        if isinstance(fitting, Wye) and _is_sharp(fitting, enter, leave):
            angle = math.pi - angle
        if angle < EXPLORER.least_bend or abs(angle - fitting.angle) < EXPLORER.bend_tolerance:
            return False
        self.belief.resize(part, angle=angle)
        self.planner = self._through([])
        return True

    def _closes(self, time: float, end: End, other: End) -> Event:
        """Close a loop of the map; where it misses by more than a length may be wrong by, it is in
        doubt, as any of its lengths may be wrong."""
        miss = self.belief.close(end, other)
        if miss > 2 * LEAST_LENGTH:
            name = self.belief.part_name(end[0])
            self._doubts[name] = f"the loop there missed by {1000 * miss:.0f} mm"
        return LoopClosed(self._number, time, self.belief.name(end), self.belief.name(other), miss)

    def _through_new(self, part: int, enter: str, distance: float) -> tuple[Edge, ...] | None:
        """Return the path at hand, extended to the nearest unexplored port of a new fitting; None
        where there is none but round a sharp turn, or where the robot has come too far to stand
        before it: fittings that follow closely are prepared for together, before the first."""
        unexplored = self.belief.unexplored
        leaves = [end[1] for end in unexplored if end[0] == part]
        fitting = self.belief.fitting(part)
        leaves = [port for port in leaves if not _is_sharp(fitting, enter, port)]
        if not leaves:
            return None
        leave = min(
            leaves, key=lambda port: round(self.planner.route([(part, enter, port)]).length, 3)
        )
        path = (*self.leg.path, (part, enter, leave))
        return path if distance <= self.planner.latest_stand(path, len(path) - 1) else None

    def _inspected(self, time: float, distance: float, end: End, goal: str) -> Decision:
        """Decide at an observed end: note it as explored, and go on."""
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

    # Where it goes

    def _onward(self, distance: float) -> Replan:
        """Return what plans legs to a goal, ahead or back, from the leg at hand."""
        leg = self.leg

        def onward(planner: LegPlanner, goal: int, closed: Closed) -> list[Leg] | None:
            options = [
                planner.extend(leg, distance, goal, closed),
                planner.replan(leg, distance, goal, closed),
            ]
            if planner.ends[goal + 1] == self.belief.start:
                # It is behind; after a loop it may be nearer ahead.
                location = planner.location(leg, distance)
                options.append(planner.replan_from(location, goal, closed))
            legs = min((legs for legs in options if legs), key=_travel, default=None)
            return self._spared(legs, planner, planner.location(leg, distance), goal, closed)

        return onward

    def _from(self, location: PartLocation) -> Replan:
        def onward(planner: LegPlanner, goal: int, closed: Closed) -> list[Leg] | None:
            legs = planner.replan_from(location, goal, closed)
            return self._spared(legs, planner, location, goal, closed)

        return onward

    def _spared(
        self,
        legs: list[Leg] | None,
        planner: LegPlanner,
        location: PartLocation,
        goal: int,
        closed: Closed,
    ) -> list[Leg] | None:
        """Return legs to a goal, or others that spare the robot the sharp turns on them."""
        if legs is None or not self._sharp_turns(legs):
            return legs
        return self._gently(planner, location, goal, closed, EXPLORER.reversals) or legs

    def _gently(
        self,
        planner: LegPlanner,
        location: PartLocation,
        goal: int,
        closed: Closed,
        reversals: int,
    ) -> list[Leg] | None:
        """Return legs to a goal without sharp turns, with the robot either way round: it passes a
        branch and reverses into it instead; None where there are none."""
        legs = planner.replan_from(location, goal, (*closed, *self._sharp_edges()))
        sharp = legs or planner.replan_from(location, goal, closed)
        if legs or not sharp or not reversals:
            return legs
        number, index = self._sharp_turns(sharp)[0]
        over = planner.reverse_beyond(sharp[number], index, closed)
        if over is None:
            return None
        there = planner.location(over, over.end)
        rest = self._gently(planner, there, goal, closed, reversals - 1)
        return rest and [*sharp[:number], over, *rest]

    def _sharp_edges(self) -> list[Edge]:
        """Return the sharp turns in all fittings of the map that have another way through."""
        parts = enumerate(self.belief.network.pipes.parts)
        return [
            (i, enter, leave)
            for i, part in parts
            if len(part.fitting.port_names) > 2
            for enter, leave in permutations(part.fitting.port_names, 2)
            if _is_sharp(part.fitting, enter, leave)
        ]

    def _sharp_turns(self, legs: Sequence[Leg]) -> list[tuple[int, int]]:
        """Return the sharp turns on legs: the number of the leg, and that of the passage on it."""
        return [
            (number, index)
            for number, leg in enumerate(legs)
            for index, (part, *ports) in enumerate(leg.path)
            if _is_sharp(self.belief.fitting(part), *ports) and self._drives(leg, index)
        ]

    def _drives(self, leg: Leg, index: int) -> bool:
        """Return whether passage ``index`` of a leg's path lies between its begin and its end."""
        here = self.planner.route(leg.path).passages[index]
        return here.s_leave > leg.begin and here.s_enter < leg.end

    def _replan(self, time: float, events: Sequence[Event], plan: Replan) -> Decision:
        """Go to the unexplored port that asks for the least travel, or else to the start."""
        events = list(events)
        legs = self._least(self.belief.unexplored, plan)
        if legs is None and self._tries_again and (self._closed or self._left):
            self._try_again()
            legs = self._least(self.belief.unexplored, plan)
        if legs is None:
            self._leave_the_rest()
            legs = self._least([self.belief.start], plan)
        return self._begin(time, events, legs)

    def _try_again(self) -> None:
        """Take all that the robot has given up for possible, once: it comes there from elsewhere,
        and often it was a fall that stopped it."""
        self._tries_again = False
        self._closed.clear()
        for end in self._left:
            self.belief.reopen(end)
        self._left.clear()

    def _leave_the_rest(self) -> None:
        """Give up the ports that are out of reach, as no other is left."""
        hung = ", ".join(self.belief.name(end) for end in dict.fromkeys(self._closed))
        for end in self.belief.unexplored:
            self._give_up_port(end, f"no way past {hung}" if hung else "no way there is left")

    def _verdict(self, time: float) -> list[Event]:
        """Return what a robot says of its map when it has come home by it: before that, nothing has
        shown that it can be driven by."""
        belief = self.belief
        parts = belief.network.pipes.parts
        fittings = sum(not part.fitting.is_plain for part in parts)
        ends = len(belief.explored) - len(self._left)
        if self.left:
            return [ExplorationIncomplete(self._number, time, fittings, ends, self.left)]
        return [ExplorationComplete(self._number, time, fittings, ends)]

    def _give_up_port(self, end: End, why: str) -> None:
        """Leave a port unexplored."""
        self._assumed = 0.0
        self.belief.note(end, "impassable")
        self.belief.done(end)
        self._left[end] = why

    def _least(self, goals: Sequence[End], plan: Replan) -> list[Leg] | None:
        """Return legs to the one of some ports that asks for the least travel; None where no path
        leads to any."""
        planner = self._through(goals)
        for closed in self._obstacles():
            # Rounded, so that equal paths do not swap by the last bit of a length.
            options = [
                (round(self._cost(legs), 6), goal, legs)
                for goal in range(len(goals))
                if (legs := plan(planner, goal, closed))
            ]
            if options:
                self.planner = planner
                return min(options, key=lambda option: option[:2])[2]
        return None

    def _cost(self, legs: Sequence[Leg]) -> float:
        """Return the travel on legs, m, and what the sharp turns on them count for."""
        return _travel(legs) + EXPLORER.detour * len(self._sharp_turns(legs))

    def _begin(self, time: float, events: Sequence[Event], legs: Sequence[Leg] | None) -> Decision:
        before, decision = self.leg, super()._begin(time, events, legs)
        if decision.leg is None:
            return decision
        self.belief.settle()
        self._sighted, self._close = None, []
        self._stop_looking_back()
        self._back.begin()
        end = _end_of(self.leg.path)
        blind = self.leg.goal < 0 or end == self.belief.start or end in self.belief.ends
        self.look_at = math.inf if blind else self.leg.end - EXPLORER.look_before
        if self.leg.gear != before.gear or self.leg.path[: len(before.path)] != before.path:
            return decision
        self.leg = replace(self.leg, begin=before.begin)
        return Decision(self.leg, True, events)

    def _go_on(self, path: tuple[Edge, ...]) -> None:
        """Extend the leg at hand to the end of a path that begins as its own does."""
        self.planner = self._through([])
        self.leg = self._longer(replace(self.leg, path=path))

    def _longer(self, leg: Leg) -> Leg:
        """Return a leg that ends where its path does."""
        end = self.planner.route(leg.path).length - self._half - self._robot.nose_room
        return replace(leg, end=end, note=f"to {self.belief.name(_end_of(leg.path))}")

    def _through(self, goals: Sequence[End]) -> LegPlanner:
        """Return the planner of legs through the present map, to some of its ports."""
        names = ["the start" if g == self.belief.start else self.belief.name(g) for g in goals]
        ends = [self.belief.start, *goals]
        return LegPlanner(self.belief.network, ends, names, self._robot, self._arcs)


def _end_of(path: Sequence[Edge]) -> End:
    """Return the port that a path ends at."""
    part, _, leave = path[-1]
    return part, leave


def _side(ahead: Ahead, look: Look, axis: Array) -> Array:
    """Return the x axis (3,) of the port that is seen ahead, through a port with z along ``axis``
    (3,), world frame."""
    side = side_of(look.frame, axis)
    return math.cos(ahead.turn) * side + math.sin(ahead.turn) * np.cross(axis, side)


def _is_sharp(fitting: Fitting, enter: str, leave: str) -> bool:
    return fitting.describe(enter, leave).turn_angle > EXPLORER.sharp


def _travel(legs: Sequence[Leg]) -> float:
    return sum(leg.end - leg.begin for leg in legs)


def _fitted(fitting: Fitting, enter: str, bore: float) -> Fitting:
    """Return a fitting as observed, with the bore of the pipe that it is joined to."""
    if abs(2 * fitting.port_radius(enter) - bore) <= BORE_TOLERANCE:
        return fitting
    try:
        return replace(fitting, **{fitting.bore_key(enter): bore})  # type: ignore[type-var]
    except GeometryError:
        return fitting
