"""Looks of a robot that explores back at the fittings that it has passed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from omnitrack_sim.autonomy.belief import Belief
from omnitrack_sim.autonomy.looks import (
    LOOKS,
    LookRecord,
    common_std,
    has_slipped,
    is_along,
    reducer_std,
    weights_of,
    without_extremes,
)
from omnitrack_sim.autonomy.sight import Look, Sighting
from omnitrack_sim.base.rotations import TURNED, Array
from omnitrack_sim.pipes import Elbow, Reducer, Route, Wye
from omnitrack_sim.pipes.map_difference import ANGLES, MIN_LENGTH


class Placement(NamedTuple):
    """Where a robot has last been placed on its leg by a look at a port of the map.

    Attributes:
        part: the pipe that it was in.
        distance: m, its arc length then.
        std: m, standard deviation of that.
    """

    part: int
    distance: float
    std: float


class RearLooks(LookRecord):
    """Looks back of one robot at the fittings that it has passed.

    It looks back once in each straight behind a fitting, and again as soon as it sees the far end
    of that straight, so that the length of the straight is measured by looks at both ends. Round a
    bend a robot knows least how far it has come, and sees that best when the bend is just behind.

    Args:
        belief: its map.
        half: m, from its centre to its ends.
        distance: m, from the port where it began to its centre then, in the first pipe.

    Attributes:
        doubts: by the names of pipes, what a look back has shown in them that the map has not.
        placement: in the pipe behind a fitting, by a look at that on this leg; None without one.
    """

    def __init__(self, belief: Belief, half: float, distance: float) -> None:
        self._belief, self._half = belief, half
        self.doubts: dict[str, str] = {}
        self.placement: Placement | None = Placement(0, distance, 0.0)
        # By part, reducers and elbows to be measured from behind: length or mean radius, m, by each
        # look, with its standard deviation; and the weight of the size on the map, 1/m².
        self._sizes: dict[int, list[tuple[float, float]]] = {}
        self._weights: dict[int, float] = {}
        self._measured: int | None = None  # one of these at which enough looks have been made
        self._looked_once: set[int] = set()
        self._looked_twice: set[int] = set()
        self._uninformative: Counter[int] = Counter()  # looks that told nothing, by straight
        # Arc lengths, m, from which on it looks back for the first and for the second time in a
        # straight; and the shift, m, that the last look has asked for, which another is to confirm.
        self._first_look, self._second_look, self._shift = 0.0, math.inf, math.inf

    # When

    def begin_leg(self) -> None:
        """See ``LookRecord``."""
        self._first_look, self._second_look, self._shift = 0.0, math.inf, math.inf
        self.placement = None

    def next_look(self, route: Route) -> float:
        """Return the arc length on a route, m, of the next look back; infinite for none."""
        for before in route.passages[1:]:
            new = before.index not in self._looked_once
            if new and self._belief.fitting(before.index).is_plain:
                at = max(before.s_enter + self._half + LOOKS.close, self._first_look)
                if at < before.s_leave - self._half:
                    return min(at, self._second_look)
        return self._second_look

    def may_look_again(self, route: Route, distance: float) -> bool:
        """Return whether the robot has looked back only once in the straight it is in.

        At arc length ``distance`` m.
        """
        here = route.passages[route.index_at(distance)]
        return here.index in self._looked_once - self._looked_twice

    def look_again(self, route: Route, distance: float) -> None:
        """Plan a second look back in the straight at arc length ``distance`` m, from there on."""
        self._looked_twice.add(route.passages[route.index_at(distance)].index)
        self._second_look = distance

    def in_sight(self, route: Route, distance: float) -> bool:
        """Return whether a robot sees the fitting by which it has been placed.

        It is at arc length ``distance`` m: down a pipe belts slip by up to a tenth of the way to
        its end.
        """
        here = route.passages[route.index_at(distance)]
        return here.index in self._looked_once and distance - here.s_enter < LOOKS.in_sight

    # Sizes

    def forget_part(self, part: int) -> None:
        """See ``LookRecord``."""
        self._sizes.pop(part, None)

    def measure(self, part: int, weight: float = 0.0) -> None:
        """Measure the length of a reducer, or the mean radius of an elbow, from behind as well.

        Args:
            part: of the map.
            weight: 1/m², with which the size that the map has counts beside these looks.
        """
        self._sizes[part], self._weights[part] = [], weight

    def take_measured(self) -> tuple[int, str, float, float] | None:
        """Take what has been measured from behind since the last call.

        Returns:
            A part, the key of its size in the fitting, and the size and its standard deviation, m;
            None where there is none, or where the looks at it disagree.
        """
        part, self._measured = self._measured, None
        if part is None or part not in self._sizes:
            return None
        looks = np.array(self._sizes.pop(part))
        sizes, stds = looks[without_extremes(looks[:, 0])].T
        if np.ptp(sizes) > 2 * MIN_LENGTH:
            return None
        size = float(np.average(sizes, weights=weights_of(stds)))
        fitting = self._belief.fitting(part)
        if isinstance(fitting, Elbow):
            key, std = "mean_radius", common_std(stds.tolist(), sizes.tolist())
        else:
            key, std = "length", reducer_std(stds.tolist(), sizes.tolist())
        if std and self._weights[part]:
            # Looks from both sides count by how exactly they show it.
            both = [std**-2, self._weights[part]]
            size = float(np.average([size, getattr(fitting, key)], weights=both))
            std = sum(both) ** -0.5
        return part, key, size, std

    def _add_size(self, part: int, behind: Sighting, more: bool) -> None:
        """Add what a look back tells of a size that is to be measured, if it is one.

        ``more``: the pipe has room for more looks.
        """
        sizes, enough = self._sizes.get(part), LOOKS.min_looks
        if sizes is None:
            return
        if isinstance(behind.fitting, Reducer):
            sizes.append((behind.fitting.length, behind.distance_std))
            enough = LOOKS.max_looks if more else enough
        elif isinstance(behind.fitting, Elbow):
            std = behind.size_stds.get("mean_radius", 0.0)
            sizes.append((behind.fitting.mean_radius, std))
        if _is_measured(sizes, enough):
            self._measured = part

    # Position

    def located(self, route: Route, look: Look) -> float:
        """Return the arc length of a robot on a route, m, from a look back.

        That by its own estimate where the look is ambiguous.
        """
        distance, behind = look.distance, look.behind
        i = route.index_at(distance)
        part = route.passages[i].index
        self._first_look, self._second_look = distance + LOOKS.step_again, math.inf
        known = None if i == 0 or behind is None else self._with_known_sizes(behind, route, i)
        if behind is None or known is None or not self._is_clear(route, i, known, look.frame):
            self._first_look = distance + LOOKS.step_again * 2 ** self._uninformative[part]
            self._uninformative[part] += 1
            return distance
        self._uninformative[part] = 0
        if behind.kind[0] != route.passages[i - 1].part.fitting.kind:
            self._doubt(route, i, distance, behind)
            return distance
        if part in self._looked_once:
            return self._relocated(route, i, distance, known)
        return self._first_located(route, i, distance, behind, known)

    def _relocated(self, route: Route, i: int, distance: float, known: Sighting) -> float:
        """Return the arc length, m, by one more look back in passage ``i``."""
        here = route.passages[i]
        located = here.s_enter + known.distance
        shift, before = located - distance, self._shift
        place = _placement(here.index, located, known)
        if not has_slipped(shift, known.distance_std):
            self._shift = math.inf
            return self._averaged(place, distance, shift)
        if has_slipped(shift - before, known.distance_std):
            # Of looks at elbows one in twenty is off by a centimetre.
            self._shift, self._second_look = shift, distance + LOOKS.step_again
            return distance
        self.placement, self._shift = place, math.inf
        self.add_slip_uncertainty(shift)
        return located

    def _first_located(
        self, route: Route, i: int, distance: float, behind: Sighting, known: Sighting
    ) -> float:
        """Return the arc length, m, by the first look back in a passage that tells something.

        ``behind`` is the look from passage ``i``, ``known`` that given the sizes that the map has.
        """
        here = route.passages[i]
        located = here.s_enter + known.distance
        shift, before = located - distance, self._shift
        self._shift = shift
        # One wrong look must not move the robot far along its map.
        if abs(shift) > LOOKS.max_shift and has_slipped(shift - before, known.distance_std):
            return distance
        self._shift = math.inf
        more = self._first_look < here.s_leave - self._half
        passed = route.passages[i - 1].index
        self._add_size(passed, behind, more)
        if passed not in self._sizes or passed == self._measured:
            self._looked_once.add(here.index)
        place = _placement(here.index, located, known)
        again = self.placement is not None and self.placement.part == here.index
        if again and place.std > 0.0 and not has_slipped(shift, known.distance_std):
            located = self._averaged(place, distance, shift)
        else:
            self.placement = place
        # Nothing lies between: what another look back took for a fitting there was none.
        self.doubts.pop(here.part.name, None)
        return located

    def add_slip_uncertainty(self, shift: float) -> None:
        """Take note that looks at one end of the pipe differ by ``shift`` m.

        Belts have slipped by that, or one of the looks is as wrong.
        """
        if self.placement is not None:
            std = math.hypot(self.placement.std, shift)
            self.placement = self.placement._replace(std=std)

    def _averaged(self, place: Placement, distance: float, shift: float) -> float:
        """Return the arc length, m, of a robot by one more look that agrees with that before.

        The mean of both; ``shift`` m is by what the latter differs from ``distance`` m by its own
        estimate.
        """
        if place.std == 0.0 or self.placement is None or self.placement.part != place.part:
            return distance
        _, at, before = self.placement
        before = math.hypot(before, LOOKS.travel_std * (distance - at))
        weights = weights_of([before, place.std])
        located = distance + shift * float(weights[1] / weights.sum())
        std = max(float(weights.sum()) ** -0.5, LOOKS.common_std)
        self.placement = Placement(place.part, located, std)
        return located

    def _is_clear(self, route: Route, i: int, behind: Sighting, frame: Array) -> bool:
        """Return whether a look back from passage ``i`` clearly shows a fitting.

        ``frame`` (3, 3) is that of the robot.
        """
        passed, seen = route.passages[i - 1], behind.fitting
        if seen is None or behind.distance_std > MIN_LENGTH:
            return False
        known = self._belief.fitting(passed.index)
        both = isinstance(known, Wye) and isinstance(seen, Wye)
        if both and abs(known.angle - seen.angle) > ANGLES:
            # Its angle has been measured from nearer: a picture that fits another one has a wrong
            # distance too.
            return False
        into = -self._belief.port((passed.index, passed.leave)).rotation[:, 2]
        plain = self._belief.fitting(route.passages[i].index).is_plain
        return plain and is_along(behind, frame * TURNED, into)

    def _with_known_sizes(self, behind: Sighting, route: Route, i: int) -> Sighting:
        """Return a look back given the sizes that the map has of the fitting it shows.

        That before passage ``i``.
        """
        part = route.passages[i - 1].index
        stds = self._belief.stds.get(self._belief.part_name(part), {})
        return behind.conditioned_on(self._belief.fitting(part), stds)

    def _doubt(self, route: Route, i: int, distance: float, behind: Sighting) -> None:
        """Note that a look back from passage ``i`` shows a fitting that is not on the map."""
        kind, at = behind.kind[0], distance - behind.distance
        # A shallow reducer may be overlooked for what is behind it.
        known = (p.s_leave for p in route.passages[:i] if p.part.fitting.kind == kind)
        if all(abs(at - s_leave) > LOOKS.max_shift for s_leave in known):
            self.doubts[route.passages[i].part.name] = f"a look back shows a {kind} in it"


def _placement(part: int, distance: float, sighting: Sighting) -> Placement:
    """Return the place of a robot in a part, at arc length ``distance`` m by one sighting."""
    std = common_std([sighting.distance_std])
    return Placement(part, distance, std)


def _is_measured(looks: Sequence[tuple[float, float]], enough: int) -> bool:
    """Return whether looks, each a size and its standard deviation, m, tell a size.

    As many as are ``enough`` have been made, and their mean is known well enough.
    """
    std = float(weights_of([std for _, std in looks]).sum()) ** -0.5 if looks else math.inf
    return len(looks) >= enough and std < MIN_LENGTH / 2
