"""Which sightings ahead a robot that explores believes, and which it checks by another look."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.autonomy.looks import LOOKS, is_along, provisional_passage
from omnitrack_sim.autonomy.mapping_pilot import MappingPilot
from omnitrack_sim.autonomy.near_looks import CloseLooks, Confirmation, NearLooks
from omnitrack_sim.autonomy.rear_looks import RearLooks
from omnitrack_sim.autonomy.sight import Look, Sighting, side_of
from omnitrack_sim.base.rotations import Array, angle_between
from omnitrack_sim.pipes import Elbow, Reducer, Route
from omnitrack_sim.pipes.routes import Edge


@dataclass(frozen=True)
class SightingCheckSettings:
    """What a bend that is not over looks like.

    Attributes:
        max_rest: rad, most angle of a bend that may be the rest of the one before it: before a wide
            bend its far end is hidden, so that the map may have it too short by that much.
        same_side: rad, between the directions of two bends that may be one.
    """

    max_rest: float = math.radians(35)
    same_side: float = math.radians(20)


SIGHTING_CHECK = SightingCheckSettings()


class SightingCheck:
    """Decides whether a sighting ahead is believed.

    Args:
        pilot: of the robot.
        rear: its looks back.

    Attributes:
        close: sightings of one fitting from close by.
        near: looks from close by at what was observed from afar.
        confirmation: of sightings out of a fitting.
    """

    def __init__(self, pilot: MappingPilot, rear: RearLooks) -> None:
        self._pilot, self._belief, self._rear = pilot, pilot.belief, rear
        self.close, self.confirmation = CloseLooks(), Confirmation()
        self.near = NearLooks(pilot.belief, pilot.half)

    def look_from(self, route: Route) -> Edge:
        """Return the passage that a look leads out of.

        The straight whose end is provisional, or else the last one on the leg that is not assumed
        pipe.
        """
        i, path = provisional_passage(self._belief, route), self._pilot.leg.path
        if i is not None:
            return path[i]
        *before, last = path
        assumed = self._pilot.assumed > 0 and self._belief.fitting(last[0]).is_plain
        return before[-1] if assumed and before else last

    def shows_pipe(self, look: Look) -> bool:
        """Return whether a look ahead has the axis of its pipe where the map has it.

        Of the pipe that it leads out of; see ``is_along``.
        """
        part, _, leave = self.look_from(self._pilot.route())
        axis = self._belief.port((part, leave)).rotation[:, 2]
        return look.ahead is not None and is_along(look.ahead, look.frame, axis)

    def is_impossible(self, look: Look) -> bool:
        """Return whether no robot can see what a look ahead shows.

        A plate nearer than a robot comes to one is the wall before a robot that leans in the mouth
        of a fitting. No robot lies across a straight either: one that takes itself to has stayed
        behind in the fitting before that.
        """
        ahead, route = look.ahead, self._pilot.route()
        here = route.passages[route.index_at(look.distance)]
        if here.part.fitting.is_plain:
            axis = route.centreline.frame(np.array([look.distance]))[0][:, 2]
            if look.frame[:, 2] @ axis < math.cos(LEG_PLANNER.along):
                return True
        near = self._pilot.half + self._pilot.robot.nose_room
        return ahead is not None and ahead.end == "closed" and ahead.distance < near

    def next_look(self, ahead: Sighting, look: Look, route: Route) -> float | None:
        """Return the arc length, m, of the look needed before a sighting is believed.

        None where none is.
        """
        distance, later = look.distance, look.distance + LOOKS.step_again
        self._keep_sizes(ahead, look, route)
        self.near.add(ahead, route)
        if self.near.is_doubted(ahead, route) and not self.near.is_too_late(later, route):
            return later
        begins = ahead.kind != ("", "") and provisional_passage(self._belief, route) is None
        if begins and look.behind is None and self._rear.may_look_again(route, distance):
            self._rear.look_again(route, distance)
            return distance
        if not self._is_plausible(ahead, look, route):
            return later
        self._confirm(ahead, look, route)
        if not self.confirmation.confirmed and self._needs_confirmation(ahead, route):
            return later
        return later if self._wants_more(ahead, route, distance) else None

    # Sightings out of a fitting

    def _needs_confirmation(self, ahead: Sighting, route: Route) -> bool:
        """Return whether a sighting is one of a fitting out of another one."""
        plain = self._belief.fitting(self.look_from(route)[0]).is_plain
        return ahead.fitting is not None and not plain

    def _confirm(self, ahead: Sighting, look: Look, route: Route) -> None:
        """Compare a sighting out of a fitting with the one before.

        Others need no confirmation, and one before them that was not confirmed is in doubt.
        """
        if self._needs_confirmation(ahead, route):
            part, _, leave = self.look_from(route)
            axis = self._belief.port((part, leave)).rotation[:, 2]
            self.confirmation.add(ahead, look.distance, direction_of(ahead, look, axis))
            return
        kind = self.confirmation.unconfirmed_kind
        self.confirmation.begin_leg()
        if kind:
            self._pilot.doubt(self._pilot.end[0], f"a {kind} in it was not confirmed")

    def _is_plausible(self, ahead: Sighting, look: Look, route: Route) -> bool:
        """Return whether a sighting out of a fitting may be another fitting."""
        if not self._needs_confirmation(ahead, route):
            return True
        out_of, last = self.look_from(route), route.passages[-1]
        # What begins before the middle of the last fitting is that fitting itself.
        before = look.distance + ahead.distance < (last.s_enter + last.s_leave) / 2
        itself = last.index == out_of[0] and before
        # Two cones in a row, and one whose ends do not show, are something else, such as the rest
        # of the fitting seen by a lens that leans.
        chain = isinstance(self._belief.fitting(out_of[0]), Reducer)
        unclear = chain or ahead.distance_std > LOOKS.max_reducer_std
        cone = isinstance(ahead.fitting, Reducer) and unclear
        return not (itself or cone or self._is_rest(ahead, look, out_of))

    def _is_rest(self, ahead: Sighting, look: Look, out_of: Edge) -> bool:
        """Return whether a bend sighted out of another bend may be the far end of that one."""
        part, enter, leave = out_of
        bend = self._belief.fitting(part)
        if not (isinstance(bend, Elbow) and isinstance(ahead.fitting, Elbow)):
            return False
        if ahead.fitting.angle > SIGHTING_CHECK.max_rest:
            return False
        on = self._belief.port((part, leave)).rotation[:, 2]
        # Towards the middle of the bend that the robot comes out of.
        middle = self._belief.port((part, enter)).rotation[:, 2]
        middle = middle - on * (middle @ on)
        apart = float(angle_between(direction_of(ahead, look, on), middle))
        return apart < SIGHTING_CHECK.same_side

    # Sizes from close by

    def _keep_sizes(self, ahead: Sighting, look: Look, route: Route) -> None:
        """Keep a sighting of a reducer or an elbow from close by.

        With those of the same kind just before it; now and then one shows free pipe where there is
        a shallow cone.
        """
        sized, free = self._shows_sizes(ahead, route), ahead.kind == ("", "")
        if not (free or (sized and self.close.are_of(ahead))):
            self.close.clear()
        in_pipe = self._belief.fitting(self.look_from(route)[0]).is_plain
        if sized and (self.shows_pipe(look) or not in_pipe):
            self.close.add(ahead, look.distance)

    def _shows_sizes(self, ahead: Sighting, route: Route) -> bool:
        """Return whether a sighting is one of a reducer or an elbow from close by."""
        near = ahead.distance - self._pilot.half < LOOKS.close + LOOKS.step_again
        close = near or provisional_passage(self._belief, route) is not None
        return isinstance(ahead.fitting, Reducer | Elbow) and close

    def _wants_more(self, ahead: Sighting, route: Route, distance: float) -> bool:
        """Return whether a robot close to a reducer or an elbow is to look at it once more."""
        again = distance + LOOKS.step_again
        late = again > self._pilot.leg.end or self.near.is_too_late(again, route)
        i = provisional_passage(self._belief, route)
        # Out of a fitting, its nose is about to come into the reducer.
        plain = self._belief.fitting(self.look_from(route)[0]).is_plain
        few = self.close.are_few(route.passages[-1 if i is None else i].s_enter)
        return plain and not late and few and self._shows_sizes(ahead, route)


def direction_of(ahead: Sighting, look: Look, axis: Array) -> Array:
    """Return the x axis (3,) of the port that is seen ahead, world frame.

    Args:
        ahead: the sighting.
        look: the look that made it.
        axis: (3,) along z of the port through which it was made, world frame.
    """
    side = side_of(look.frame, axis)
    return math.cos(ahead.turn) * side + math.sin(ahead.turn) * np.cross(axis, side)
