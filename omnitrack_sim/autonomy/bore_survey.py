"""Bores of a robot's map by what its arms measure, and the reducers that it has missed.

By a lamp a shallow reducer hardly shows ahead. Behind it the arms find another bore than the map
has: then the robot looks back for a reducer, or one is inferred where none can be seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from omnitrack_sim.autonomy.belief import BELIEF
from omnitrack_sim.autonomy.looks import (
    HARDLY_SHOWS,
    LOOKS,
    SHALLOW,
    LookRecord,
    reducer_std,
    weights_of,
    without_extremes,
)
from omnitrack_sim.autonomy.mapping_pilot import MappingPilot, end_of
from omnitrack_sim.autonomy.pilots import Decision
from omnitrack_sim.autonomy.rear_looks import RearLooks
from omnitrack_sim.autonomy.sight import Look, Sighting
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.pipes import BORE_TOLERANCE, Fitting, Passage, Reducer, Straight
from omnitrack_sim.pipes.fittings.base import Bores
from omnitrack_sim.pipes.map_difference import LENGTHS
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.events import FittingFound


@dataclass(frozen=True)
class BoreSurveySettings:
    """Tolerances of bores measured by arms.

    Attributes:
        repeatability: part of the bore by which two measurements by the arms in one pipe may
            differ; in the cone of a reducer they differ more.
        digits: decimals that are kept of a bore, m.
    """

    repeatability: float = 0.005
    digits: int = 3


BORE_SURVEY = BoreSurveySettings()


@dataclass
class ReducerSearch:
    """Search for a reducer that a robot has come through unseen, by looks back from behind it.

    Attributes:
        part: the straight behind it.
        bore: m, of the pipe before it.
        next_look: m, arc length on the leg of the next look.
        lengths: m, of the reducer, by the looks so far.
        latest: the last sighting of it, and the arc length then, m.
        uninformative_looks: number of looks since the last that showed a reducer.
        other_looks: number of looks from beyond its cone that showed the fitting before the
            straight.
    """

    part: int
    bore: float
    next_look: float
    lengths: list[float] = field(default_factory=list)
    latest: tuple[Sighting, float] | None = None
    uninformative_looks: int = 0
    other_looks: int = 0

    @property
    def is_elsewhere(self) -> bool:
        """Whether the reducer is not behind the fitting before the straight.

        Looks back have shown that fitting twice, and more often than a reducer.
        """
        return self.other_looks > max(len(self.lengths), 1)

    def shows_other(self, behind: Sighting | None, passed: str, half: float) -> bool:
        """Return whether a look back shows the fitting before the straight.

        Args:
            behind: the look; None where it is ambiguous.
            passed: kind of that fitting; "" for none.
            half: m, from the robot's centre to its ends. From nearby it looks through the cone.
        """
        if behind is None or behind.distance < half + LOOKS.through_cone:
            return False
        return passed not in ("", Straight.kind, Reducer.kind) and behind.kind[0] == passed

    def add(self, behind: Sighting | None, distance: float) -> None:
        """Add a look back from arc length ``distance`` m, and plan the next one."""
        reducer = None if behind is None else behind.fitting
        if behind is None or not isinstance(reducer, Reducer):
            self.next_look = distance + LOOKS.step_again * 2**self.uninformative_looks
            self.uninformative_looks += 1
            return
        self.next_look, self.uninformative_looks = distance + LOOKS.step_again, 0
        (near,) = {"start", "end"} - {behind.enter}
        right = abs(2 * reducer.port_radius(near) - self.bore) < LENGTHS * self.bore
        if right and behind.distance_std < LOOKS.max_reducer_std:
            self.lengths.append(reducer.length)
            self.latest = behind, distance

    def measured(self, end: float) -> Reducer | None:
        """Return the reducer, of mean length; None where too few looks have been reliable.

        Fewer are enough where two more have shown none, as from farther off none will, and one
        where the next would be beyond the ``end`` of the leg, m.
        """
        enough = LOOKS.min_looks if self.uninformative_looks > 1 else LOOKS.max_looks
        enough = 1 if self.next_look > end else enough
        if self.latest is None or len(self.lengths) < enough:
            return None
        seen, lengths = self.latest[0].fitting, np.array(self.lengths)
        assert isinstance(seen, Reducer)
        return replace(seen, length=float(np.mean(lengths[without_extremes(lengths)])))

    def last_sighting_from(self, distance: float) -> Sighting | None:
        """Return the last sighting of it as from arc length ``distance`` m; None without one."""
        if self.latest is None:
            return None
        behind, at = self.latest
        return replace(behind, distance=behind.distance + distance - at)


class BoreSurvey(LookRecord):
    """Keeps the bores of a robot's map as its arms measure them.

    Where they find another bore than the map has, the pipe around the robot is in doubt. As soon as
    two measurements agree the map takes that bore, also for the end of a reducer before it; without
    one, the robot looks back for one that it has missed. Where the bore is right, the pipe is no
    longer in doubt for a shallow reducer.

    Args:
        pilot: of the robot, whose map and leg are corrected.
        rear: its looks back.
        read_room: m, length of pipe from which on arms will have measured its bore.

    Attributes:
        overrides_look: the last measurement has changed or questioned the map, so that what the
            robot saw with it is not judged by the map.
    """

    def __init__(self, pilot: MappingPilot, rear: RearLooks, read_room: float) -> None:
        self._pilot, self._belief, self._rear = pilot, pilot.belief, rear
        self._read_room, self.overrides_look = read_room, False
        self._last_measured_bore = math.nan  # m, at the last look, where the map has another
        self._agreeing: set[int] = set()  # pipes in which the arms have found the bore of the map
        # m, what the arms have read more than the map has, in pipes where they agree with it.
        self._excess: list[float] = []
        self._search: ReducerSearch | None = None

    @property
    def searching(self) -> bool:
        """Whether the robot looks back for a missed reducer."""
        return self._search is not None

    @property
    def next_look(self) -> float:
        """Arc length on the leg, m, of the next look for a missed reducer; infinite for none."""
        return math.inf if self._search is None else self._search.next_look

    def begin_leg(self) -> None:
        """See ``LookRecord``."""
        self._give_up_search()

    def _give_up_search(self) -> None:
        """Give up the search for a missed reducer, and restore the bore of the straight."""
        if self._search is not None:
            self._belief.resize(self._search.part, inner_diameter=self._search.bore)
            self._search = None

    # Measurements by the arms

    def update_bore_from_arms(self, look: Look) -> None:
        """Compare the bore that the arms measure around the robot with that of the map."""
        pilot, route, self.overrides_look = self._pilot, self._pilot.route(), False
        here = route.passages[route.index_at(look.distance)]
        within = here.s_enter + pilot.half < look.distance < here.s_leave - pilot.half
        if not (here.part.fitting.is_plain and within):
            return
        bore, name = 2 * here.part.fitting.port_radius(here.enter), here.part.name
        if abs(look.bore - bore) < LENGTHS / 2 * bore:
            self._excess.append(look.bore - bore)
            self._agreeing.add(here.index)
            if pilot.doubts.get(name) == SHALLOW:
                del pilot.doubts[name]
        last, self._last_measured_bore = self._last_measured_bore, math.nan
        if not abs(look.bore - bore) > LENGTHS * bore:
            return
        pilot.doubts[name] = f"its bore is {1000 * look.bore:.0f} mm by the arms"
        pilot.remove_provisional()
        part, entered, _ = pilot.leg.path[-1]
        if part != here.index or entered != "start" or not self._belief.is_leaf(part):
            return
        self.overrides_look = True
        if abs(look.bore - last) < BORE_SURVEY.repeatability * bore:
            self._correct_bore(here, look)
        else:
            # The robot may still stand in the reducer.
            self._last_measured_bore = look.bore
            pilot.look_at = look.distance + 2 * LOOKS.step_again

    def _correct_bore(self, here: Passage, look: Look) -> None:
        """Give the pipe around the robot, the last of its leg, the bore that its arms measure."""
        pilot, name = self._pilot, here.part.name
        # Ends of modules that lean hold the arms out by up to 0.9 mm, alike in all pipes. A bore
        # that is 1 mm off makes a shallow reducer 10 mm longer.
        excess = float(np.median(self._excess)) if self._excess else 0.0
        bore, why = round(look.bore - excess, BORE_SURVEY.digits), pilot.doubts[name]
        before = 2 * here.part.fitting.port_radius(here.enter)
        self._belief.resize(here.index, inner_diameter=bore)
        pilot.look_at = look.distance
        passed = pilot.passed(look.distance)
        corrected = None if passed is None else _leading_to(passed, bore)
        if passed is None or corrected is None:
            self._search = ReducerSearch(here.index, before, look.distance)
        else:
            self._correct_passed(passed, corrected, here.index)
            del pilot.doubts[name]
        pilot.extend_leg_to(pilot.leg.path)
        # The same leg would keep its route, in which the pipe has the other bore.
        pilot.leg = replace(pilot.leg, note=f"{pilot.leg.note}: {why}")

    def _correct_passed(self, passed: Passage, corrected: Fitting, pipe: int) -> None:
        """Correct what was passed before ``pipe``: a reducer to another bore, or a straight."""
        if isinstance(corrected, Straight):
            self._pilot.doubts.pop(passed.part.name, None)
            self._rear.forget_part(passed.index)
            self._belief.replace_part(passed.index, corrected)
            self._belief.resize(pipe, inner_diameter=corrected.inner_diameter)
        else:
            key = corrected.bore_key(passed.leave)
            self._belief.resize(passed.index, **{key: getattr(corrected, key)})

    # Search for a missed reducer

    def look_for_reducer(self, look: Look) -> Decision | None:
        """Decide after a look back for a missed reducer.

        None where it has not been measured yet.
        """
        pilot, search = self._pilot, self._search
        assert search is not None
        passed = pilot.passed(look.distance)
        kind = "" if passed is None else passed.part.fitting.kind
        if search.shows_other(look.behind, kind, pilot.half):
            search.other_looks += 1
            decision = self._infer_reducer(search, look) if search.is_elsewhere else None
            if decision is not None:
                return decision
        search.add(look.behind, look.distance)
        reducer = search.measured(pilot.leg.end)
        behind = look.behind if reducer is None else search.last_sighting_from(look.distance)
        if behind is None or not isinstance(behind.fitting, Reducer):
            return None
        pilot.remove_provisional()
        here = pilot.route().passages[-1]
        if not (here.part.fitting.is_plain and self._belief.is_leaf(here.index)):
            self._give_up_search()
            return None
        if reducer is None:
            return None
        (near,) = {"start", "end"} - {behind.enter}
        fitted = with_bore(reducer, near, search.bore)
        fitted = with_bore(fitted, behind.enter, 2 * here.part.fitting.port_radius(here.enter))
        assert isinstance(fitted, Reducer)
        return self._insert_reducer(fitted, near, search, look._replace(behind=behind))

    def _insert_reducer(
        self, reducer: Reducer, near: str, search: ReducerSearch, look: Look
    ) -> Decision | None:
        """Insert a missed reducer into the straight around the robot.

        It is entered by its port ``near``. Gives up the search and returns None where it has no
        room there.
        """
        pilot, belief, behind = self._pilot, self._belief, look.behind
        assert behind is not None
        here = pilot.route().passages[-1]
        at = look.distance - behind.distance
        gap = at - reducer.length - here.s_enter
        direct = gap <= BELIEF.min_straight
        if gap < -LOOKS.max_shift or (direct and not belief.is_removable(here.index)):
            self._give_up_search()
            return None
        self._search = None
        state, path, shift = belief.ends.pop((here.index, here.leave), None), pilot.leg.path, 0.0
        pilot.doubts.pop(here.part.name, None)
        std = reducer_std([behind.distance_std] * len(search.lengths), search.lengths)
        placed = math.hypot(behind.distance_std, look.std)
        if direct:
            belief.remove(here.index)
            path = path[:-1]
            longer, std = _between_fittings(reducer, gap, std, placed)
            shift = longer.length - reducer.length - gap
            reducer = longer
        else:
            belief.resize(here.index, inner_diameter=search.bore, length=gap)
            belief.set_stds(here.index, length=math.hypot(std, placed))
        part = belief.attach(end_of(path), reducer, near, look.frame[:, 0])
        belief.set_stds(part, length=std)
        path = (*path, (part, near, behind.enter))
        straight = belief.attach_straight(end_of(path), here.s_leave - at)
        if state is not None:
            belief.set_end((straight, here.leave), state)
        pilot.look_at = look.distance
        pilot.extend_leg_to((*path, (straight, here.enter, here.leave)))
        if behind.confidence < LOOKS.sure:
            pilot.doubt(part, HARDLY_SHOWS)
        event = FittingFound(pilot.number, look.time, belief.part_name(part), -behind.distance)
        return Decision(pilot.leg, True, [event], shift)

    def _infer_reducer(self, search: ReducerSearch, look: Look) -> Decision | None:
        """Put a reducer in the place of a pipe of which the arms have not read the bore.

        They have found another one behind the fittings that follow it.

        By a lamp, a fitting behind a reducer looks like one that is as much smaller and nearer.

        Returns:
            None where there is no such pipe: then the reducer is in the straight that the robot
            looks back through.
        """
        pilot, belief = self._pilot, self._belief
        i = pilot.route().index_at(look.distance)
        here = pilot.route().passages[i]
        found = self._unread_pipe(here.index)
        bore = 2 * here.part.fitting.port_radius(here.enter)
        changed = None if found is None else self._with_reducer(found, search.bore, bore)
        if found is None or changed is None:
            return None
        self._search = None
        for part, fitting in changed.items():
            belief.replace_part(part, fitting)
        pipe, _, leave = found
        name = belief.part_name(pipe)
        # A picture may have replaced the doubt by the arms, and the arms have removed that one.
        pilot.doubts.pop(here.part.name, None)
        pilot.doubt(pipe, "it was felt behind it and not seen")
        pilot.extend_leg_to(pilot.leg.path)
        pilot.leg = replace(pilot.leg, note=f"{pilot.leg.note}: {name} inferred")
        pilot.look_at = look.distance
        shift = pilot.route().passages[i].s_enter - here.s_enter
        ends = (belief.port(end).position for end in ((pipe, leave), (here.index, here.enter)))
        away = look.distance - here.s_enter + math.dist(*ends)
        event = FittingFound(pilot.number, look.time, name, -away)
        return Decision(pilot.leg, True, [event], shift)

    def _with_reducer(self, pipe: Edge, before: float, behind: float) -> dict[int, Fitting] | None:
        """Return what is on the map with a reducer in the place of a pipe, by numbers of parts.

        The reducer is between two bores, m, and what is beyond it is of the latter. None where
        there is no such reducer.
        """
        belief, (part, enter, leave) = self._belief, pipe
        bores, length = {enter: before, leave: behind}, belief.fitting(part).length_of_axes
        try:
            reducer = Reducer(length, end_diameter=bores["end"], inner_diameter=bores["start"])
            beyond = {
                other: of_bore(belief.fitting(other), behind)
                for other in belief.parts_beyond((part, leave))
            }
        except GeometryError:
            return None
        return {part: reducer, **beyond}

    def _unread_pipe(self, part: int) -> Edge | None:
        """Return the pipe before ``part`` that is too short for the arms to have read its bore.

        It is on the way from the start, and only fittings lead from it there and on. None where
        there is none.
        """
        belief, joint = self._belief, self._belief.attached_to(part)
        while joint is not None and not _sets_bore(belief.fitting(joint[0][0])):
            joint = belief.attached_to(joint[0][0])
        before = None if joint is None else belief.attached_to(joint[0][0])
        if joint is None or before is None:
            return None
        pipe, leave = joint[0]
        behind, fitting = belief.parts_beyond((pipe, leave)), belief.fitting(pipe)
        others = any(isinstance(belief.fitting(other), Reducer) for other in behind)
        read = pipe in self._agreeing or fitting.length_of_axes > self._read_room
        unread = fitting.is_plain and not read and not others and pipe not in behind
        return (pipe, before[1][1], leave) if unread else None


def _between_fittings(
    reducer: Reducer, gap: float, std: float, placed: float
) -> tuple[Reducer, float]:
    """Return a reducer directly behind another fitting, and the standard deviation of its length.

    It begins where the fitting before it ends: where the robot is tells its length too. By a lamp
    the edge of a tee may look like the end of its cone: then the looks are off by as much as that
    is in the tee.

    Args:
        reducer: as looks show it.
        gap: m, between the fitting and the reducer by these looks.
        std: m, of the length by these looks; 0 by error-free sight.
        placed: m, standard deviation of where the robot is.
    """
    looks = math.hypot(std, min(gap, 0.0))
    weights = weights_of([looks, placed])
    length = reducer.length + gap * float(weights[1] / weights.sum())
    length = max(length, reducer.length / 2)  # not a step, however badly it knows its place
    std = math.hypot(LOOKS.common_std, weights.sum() ** -0.5) if std else 0.0
    return replace(reducer, length=length), std


def _leading_to(passed: Passage, bore: float) -> Reducer | Straight | None:
    """Return the reducer that was passed as one that leads to a bore, m.

    A straight where that is the bore from which it comes, None where it is no reducer or none may
    be so.
    """
    reducer = passed.part.fitting
    if not isinstance(reducer, Reducer):
        return None
    before = 2 * reducer.port_radius(passed.enter)
    if abs(bore - before) < LENGTHS / 2 * before:
        return Straight(reducer.length, before)
    try:
        return replace(reducer, **{reducer.bore_key(passed.leave): bore})
    except GeometryError:
        return None


def _sets_bore(fitting: Fitting) -> bool:
    """Return whether a fitting is a pipe or changes the bore."""
    return fitting.is_plain or isinstance(fitting, Reducer)


def of_bore(fitting: Fitting, bore: float) -> Fitting:
    """Return a fitting of another bore, m: what a robot cannot measure is as usual for that."""
    every = vars(type(fitting)).items()
    usual = {name: size for name, size in every if isinstance(size, Bores)}
    bores = {fitting.bore_key(port): bore for port in fitting.port_names}
    return replace(fitting, **{**usual, **bores})  # type: ignore[type-var]


def with_bore(fitting: Fitting, enter: str, bore: float) -> Fitting:
    """Return a fitting as observed, with the bore, m, of the pipe that it is joined to.

    Args:
        fitting: as observed; returned as it is where there is none of that bore.
        enter: its port there.
        bore: m, of the pipe.
    """
    if abs(2 * fitting.port_radius(enter) - bore) <= BORE_TOLERANCE:
        return fitting
    try:
        return replace(fitting, **{fitting.bore_key(enter): bore})  # type: ignore[type-var]
    except GeometryError:
        return fitting
