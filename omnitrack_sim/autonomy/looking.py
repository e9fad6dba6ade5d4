"""Repeated looks of a robot that explores: when it looks again, and what several looks tell
together.

One sighting may be wrong in kind, position and sizes, most of all from afar and out of a fitting.
So a robot confirms a sighting out of a fitting by a second one (``Confirmation``), looks from close
by at what it has observed from afar (``LookingCloser``), takes the mean of several looks as the
sizes of a fitting (``CloseLooks``), and looks back at what it has passed (``LookingBack``), or has
passed unseen (``MissedReducer``).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.belief import BELIEF, Belief, unsure
from omnitrack_sim.autonomy.sight import Look, Sighting
from omnitrack_sim.base.rotations import TURNED, Array, angle_between
from omnitrack_sim.pipes import Elbow, Fitting, Reducer, Route, Straight, Wye
from omnitrack_sim.pipes.map_difference import ANGLES, LEAST_LENGTH, LENGTHS


@dataclass(frozen=True)
class LookSettings:
    """Conditions in which a robot that explores looks again at what it has observed or passed.

    Attributes:
        behind: m, from its rear to a fitting behind it when it looks back at that.
        in_sight: m, to a fitting behind it up to which a robot looks back whenever it looks ahead:
            a lamp shows no more from farther off.
        behind_again: m, travel to the next look back; it doubles with each one in a straight that
            tells nothing: what an elbow shows from behind changes little within 10 mm.
        most_lean: rad, tilt beyond which a look back is mistaken: no robot leans so in a straight.
        most_std: m, standard deviation up to which a look back places the robot. Round a bend the
            estimate of arc length is off by centimetres.
        most_shift: m, shift of arc length from which on two looks have to agree.
        agreement: m, difference of two looks that agree.
        close: m, from the robot's front to the end of a straight when it looks there once more:
            from there both cameras measure distances to 1 or 2 mm.
        closest: m, the same of the last try: nearer, a lens sees too little of the wall before it.
        out_of_fitting: m, farther off for an end that was observed out of a fitting, where a robot
            knows least how far it has come: an open end hardly shows from nearer than ``close``.
        slip: standard deviations of two looks by which travel between them has to be off for the
            belts to have slipped: of 440 looks by both cameras one was off by more than 3.
        least_slip: m, the same in addition.
        travel: standard deviation of a travel along a pipe, as a part of it. With 1 %, as in the
            filter, which has to follow belts that slip, ten lengths were off by a quarter of what
            was stated.
        again: m, travel to the next look where one was ambiguous.
        doubt: m, travel to the next look where two contradict each other.
        missed: m, travel to the next look back at a reducer that the map has missed.
        through_cone: m, from its rear to a fitting behind it up to which a robot may look through
            the cone of a reducer directly behind that, and not see it.
        least_std: m, standard deviation of a distance below which one look counts no more than
            another.
        most_off: rad, between the axis of a pipe on the map and in a picture, from which on sizes
            and distances in that are wrong: by a lamp radii and distances are 20 mm too great.
        most_size_std: m, standard deviation of a size measured from behind up to which it is known:
            half of what lengths on a map may be wrong by.
        most_reducer_std: m, standard deviation of the distance of a reducer from which on its ends
            hardly show: right ones have 8 to 14 mm, wrong ones 29 to 40.
        distance_floor: m, standard deviation of what looks at one end have in common, which no
            mean of them reduces.
        radius_floor: the same of the mean radius of an elbow, as a part of it: by a lamp means of
            five looks at 24 elbows of 90 degrees and 1.5 bores scattered by 2.2 mm, looks by 4.0.
        bore_floor: the same of a diameter, as a part of it.
        for_sizes: looks from close by that the sizes of a reducer or an elbow are the mean of.
        for_length: looks back that the length of a reducer is the mean of, or as many as its pipe
            has room for, at least ``for_sizes``: looks by depth at 3 % scatter by 5 to 7 mm, and
            now and then one is off by 20 mm.
        for_more: the same where they leave a size in doubt, or the length of the pipe before it,
            or differ in the radius of an elbow: of looks by a lamp at 45 degrees one in five is off
            by 60 mm, and the least and the greatest of five are left out.
    """

    behind: float = 0.1
    in_sight: float = 0.4
    behind_again: float = 0.01
    most_lean: float = math.radians(4)
    most_std: float = 0.01
    most_shift: float = 0.1
    agreement: float = 0.02
    close: float = 0.1
    closest: float = 0.05
    out_of_fitting: float = 0.03
    slip: float = 3.0
    least_slip: float = 0.005
    travel: float = 0.005
    again: float = 0.003
    doubt: float = 0.01
    missed: float = 0.005
    through_cone: float = 0.2
    least_std: float = 1e-4
    most_off: float = math.radians(1.5)
    most_size_std: float = 0.005
    most_reducer_std: float = 0.02
    distance_floor: float = 0.001
    radius_floor: float = 0.005
    bore_floor: float = 0.01
    for_sizes: int = 3
    for_length: int = 6
    for_more: int = 5


LOOKS = LookSettings()


def _slipped(shift: float, *stds: float) -> bool:
    """Return whether belts have slipped where looks of standard deviations ``stds`` m place a robot
    by ``shift`` m elsewhere."""
    return abs(shift) > LOOKS.least_slip + LOOKS.slip * math.hypot(*stds)


def _weights(stds: Sequence[float]) -> Array:
    """Weights (n,) of measurements, 1/m², by their standard deviations, m."""
    return np.maximum(stds, LOOKS.least_std) ** -2


def _without_extremes(values: Array) -> NDArray[np.intp]:
    """Indices of values in ascending order, without the least and the greatest of more than
    ``LOOKS.for_sizes``: one look may be far off."""
    order = np.argsort(values, kind="stable")
    return order[1:-1] if len(order) > LOOKS.for_sizes else order


def common_std(floor: float, stds: Sequence[float], values: Sequence[float] = ()) -> float:
    """Standard deviation of the mean of looks at one size.

    Args:
        floor: of what they have in common.
        stds: of each look, as it tells; 0 by error-free sight, whose mean has none.
        values: of the size by each look: what they scatter by counts where it is more.
    """
    if not any(stds):
        return 0.0
    told = float(_weights(stds).sum()) ** -0.5
    scatter = float(np.std(values, ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
    return math.hypot(floor, max(told, scatter))


def reducer_std(stds: Sequence[float], lengths: Sequence[float]) -> float:
    """Standard deviation, m, of the mean length of a reducer by looks from one side, as
    ``common_std``. What blurs the ends of a shallow cone is the same in all of them: their mean is
    known no better than by the best."""
    return max(common_std(LOOKS.distance_floor, stds, lengths), min(stds))


class Confirmation:
    """Confirms a fitting that is sighted out of another one by a second sighting of the same kind
    at the same position: a bend that is not over looks like another one that begins at the lens.

    Attributes:
        side: (3,) direction of the fitting, see ``side_of``, by the sighting that the last one has
            confirmed; None where it has confirmed none.
    """

    def __init__(self) -> None:
        # The sighting to be confirmed, where it is, and from where it was made, m, and the
        # direction of the fitting.
        self._first: tuple[Sighting, float, float, Array] | None = None
        self.side: Array | None = None

    def confirms(self, ahead: Sighting, distance: float, side: Array) -> bool:
        """Return whether a sighting made at arc length ``distance`` m, of a fitting in direction
        ``side`` (3,), confirms the one before; if it does not, the next one is compared with it."""
        at, bends, confirmed = distance + ahead.distance, isinstance(ahead.fitting, Elbow), False
        self.side = None
        if self._first is not None and _may_be_one(self._first[0], ahead):
            _, before, since, first = self._first
            # The rest of a bend begins at the lens and moves with it; another bend has to stay
            # where it is. Other fittings are not seen where there are none.
            confirmed = abs(at - before) < ((distance - since) / 2 if bends else BELIEF.error)
            if bends and not confirmed and at > before:
                return False  # Since the first sighting the rest of a bend has moved farthest.
            if confirmed:
                self.side = first
        # The robot's estimate may have been off at the first sighting, so this one replaces it: so
        # it was where a bend has come nearer, as its rest moves on alone.
        self._first = None if confirmed else (ahead, at, distance, side)
        return confirmed

    def cancel(self) -> str:
        """Forget the sighting that has not been confirmed; return the kind of its fitting, "" for
        none and for an elbow, which often is the rest of the bend before."""
        kind = "" if self._first is None else self._first[0].kind[0]
        self._first = self.side = None
        return "" if kind == Elbow.kind else kind


def _may_be_one(first: Sighting, second: Sighting) -> bool:
    """Return whether two sightings may show one fitting: of the same kind, and a reducer to the
    same bore. By a lamp what no form explains looks like any cone."""
    one, other = first.fitting, second.fitting
    if isinstance(one, Reducer) and isinstance(other, Reducer):
        return abs(one.end_diameter - other.end_diameter) < LENGTHS * one.end_diameter
    return first.kind == second.kind


class CloseLooks:
    """Sightings of one reducer or elbow from close by, the mean of which gives its sizes and its
    position."""

    def __init__(self) -> None:
        # Each sighting, and the arc length of the robot then, m.
        self._looks: list[tuple[Sighting, float]] = []

    @property
    def latest(self) -> tuple[Sighting, float] | None:
        """The latest sighting, and the arc length at which it was made, m; None without any."""
        return self._looks[-1] if self._looks else None

    def clear(self) -> None:
        """Forget all sightings."""
        self._looks = []

    def are_of(self, ahead: Sighting) -> bool:
        """Return whether the sightings are of the kind of ``ahead``; False without any."""
        return bool(self._looks) and self._looks[-1][0].kind == ahead.kind

    def add(self, ahead: Sighting, distance: float) -> None:
        """Add a sighting made at arc length ``distance`` m."""
        self._looks.append((ahead, distance))

    def are_few(self, before: float) -> bool:
        """Return whether another look is needed for the sizes to be known, and the length of the
        pipe before the fitting, as far as a map may not be wrong in them; ``before``: m, arc length
        where that pipe begins."""
        if len(self._looks) < LOOKS.for_sizes:
            return True
        radii = self._radii() or [0.0]
        begin, std = self.begin_of(*self._looks[-1])
        more = (
            max(radii) - min(radii) > LEAST_LENGTH / 2
            or unsure(Straight(max(begin - before, BELIEF.shortest)), {"length": std})
            or unsure(self.mean(), self.stds())
        )
        return bool(more) and len(self._looks) < LOOKS.for_more

    def begin_of(self, ahead: Sighting, distance: float) -> tuple[float, float]:
        """Return the arc length, m, at which a fitting or an end begins that is sighted from arc
        length ``distance`` m, and its standard deviation: the mean of all sightings of its kind,
        weighted by their variances. The last of them sees the cone of a reducer from too near."""
        looks = [look for look in self._looks if look[0].kind == ahead.kind]
        looks += [] if any(look is ahead for look, _ in looks) else [(ahead, distance)]
        ends = [at + look.distance for look, at in looks]
        stds = [look.distance_std for look, _ in looks]
        mean = float(np.average(ends, weights=_weights(stds)))
        return mean, common_std(LOOKS.distance_floor, stds, ends)

    def mean(self) -> Elbow | Reducer:
        """Return the fitting with the mean of its sizes."""
        elbows = [look.fitting for look, _ in self._looks if isinstance(look.fitting, Elbow)]
        if elbows:
            radii = np.array(self._radii())
            angle = float(np.mean([elbow.angle for elbow in elbows]))
            radius = float(np.mean(radii[_without_extremes(radii)]))
            return replace(elbows[0], mean_radius=radius, angle=angle)
        sizes, weights = self._reducer_sizes(), _weights(self._stds())
        middle = _without_extremes(sizes[:, 0])
        return Reducer(*np.average(sizes[middle], axis=0, weights=weights[middle]).tolist())

    def stds(self) -> dict[str, float]:
        """Return the standard deviations of these sizes, m, by their keys."""
        return size_stds([look for look, _ in self._looks], self.mean())

    def doubt(self) -> str:
        """Return why the sizes of a reducer are in doubt, "" where they are not. Its cone is
        shallow, and its far end may be hidden by what follows."""
        sizes = self._reducer_sizes()
        if not len(sizes):
            return ""
        least = min(self._stds())
        if least > LOOKS.most_reducer_std:
            return "its ends hardly show"
        mean = np.average(sizes, axis=0, weights=_weights(self._stds()))
        if np.any(np.ptp(sizes, axis=0) > [2 * LEAST_LENGTH, *(LENGTHS * mean[1:])]):
            return "looks at it differ in its sizes"
        return "its length was seen from one side only" if least > LOOKS.most_size_std else ""

    def weight(self) -> float:
        """Return the weight of the mean length of a reducer, or radius of an elbow, 1/m²: the
        inverse of its variance, 0 by error-free sight."""
        stds = self.stds()
        std = stds["mean_radius" if "mean_radius" in stds else "length"]
        return std**-2 if std else 0.0

    def _stds(self) -> list[float]:
        return [look.distance_std for look, _ in self._looks]

    def _radii(self) -> list[float]:
        """Mean radii of an elbow, m, ascending."""
        seen = (look.fitting for look, _ in self._looks)
        return sorted(elbow.mean_radius for elbow in seen if isinstance(elbow, Elbow))

    def _reducer_sizes(self) -> Array:
        """Lengths and both diameters (n, 3) of a reducer, m."""
        seen = (look.fitting for look, _ in self._looks)
        reducers = [fitting for fitting in seen if isinstance(fitting, Reducer)]
        return np.array([(one.length, one.end_diameter, one.inner_diameter) for one in reducers])


class LookingBack:
    """Looks back of one robot at the fittings that it has passed: one in each straight behind a
    fitting, and another as soon as it sees the far end of that straight, so that the length of the
    straight is measured by looks at both ends.

    Round a bend a robot knows least how far it has come, and sees that best when the bend is just
    behind it.

    Args:
        belief: its map.
        half: m, from its centre to its ends.
        least_confidence: probability from which on it believes what it sees.

    Attributes:
        doubts: by the names of pipes, what a look back has shown in them that the map has not.
        placed: the pipe in which the robot has last been placed on this leg from a known port, its
            arc length then, and the standard deviation of that, m; None: it has not.
    """

    def __init__(self, belief: Belief, half: float, least_confidence: float) -> None:
        self._belief, self._half, self._confidence = belief, half, least_confidence
        self.doubts: dict[str, str] = {}
        self.placed: tuple[int, float, float] | None = None
        # By part, reducers and elbows to be measured from behind: length or mean radius, m, by each
        # look, with its standard deviation; and the weight of the size on the map, 1/m².
        self._sizes: dict[int, list[tuple[float, float]]] = {}
        self._weights: dict[int, float] = {}
        self._enough: int | None = None  # one of these at which enough looks have been made
        self._done: set[int] = set()
        self._twice: set[int] = set()
        self._vain: Counter[int] = Counter()  # looks that told nothing, by straight
        self._again, self._shift, self._once_more = 0.0, math.inf, math.inf

    def begin(self) -> None:
        """Begin another leg."""
        self._again, self._once_more, self.placed = 0.0, math.inf, None
        self._shift = math.inf

    def measure(self, part: int, weight: float = 0.0) -> None:
        """Measure the length of a reducer, or the mean radius of an elbow, from behind as well.

        Args:
            part: of the map.
            weight: 1/m², with which the size that the map has counts beside these looks.
        """
        self._sizes[part], self._weights[part] = [], weight

    def forget(self, part: int) -> None:
        """Measure a part no more."""
        self._sizes.pop(part, None)

    def measured(self) -> tuple[int, str, float, float] | None:
        """Return a part that has been measured from behind, the key of its size in the fitting, and
        the size and its standard deviation, m; None where there is none, or where the looks at it
        disagree."""
        part, self._enough = self._enough, None
        if part is None or part not in self._sizes:
            return None
        looks = np.array(self._sizes.pop(part))
        sizes, stds = looks[_without_extremes(looks[:, 0])].T
        if np.ptp(sizes) > 2 * LEAST_LENGTH:
            return None
        size, fitting = float(np.average(sizes, weights=_weights(stds))), self._belief.fitting(part)
        if isinstance(fitting, Elbow):
            floor = LOOKS.radius_floor * size
            key, std = "mean_radius", common_std(floor, stds.tolist(), sizes.tolist())
        else:
            key, std = "length", reducer_std(stds.tolist(), sizes.tolist())
        if std and self._weights[part]:
            # Looks from both sides count by how exactly they show it.
            both = [std**-2, self._weights[part]]
            size = float(np.average([size, getattr(fitting, key)], weights=both))
            std = sum(both) ** -0.5
        return part, key, size, std

    def once_more(self, route: Route, distance: float) -> bool:
        """Plan a second look back, from arc length ``distance`` m on, if the robot has looked back
        once in the straight there; return whether it is planned."""
        here = route.passages[route.index_at(distance)]
        if here.index not in self._done - self._twice:
            return False
        self._twice.add(here.index)
        self._once_more = distance
        return True

    def in_sight(self, route: Route, distance: float) -> bool:
        """Return whether a robot at arc length ``distance`` m sees the fitting behind it, by which
        it has been placed: down a pipe belts slip by up to a tenth of the way to its end."""
        here = route.passages[route.index_at(distance)]
        return here.index in self._done and distance - here.s_enter < LOOKS.in_sight

    def at(self, route: Route) -> float:
        """Return the arc length on a route, m, of the next look back; infinite if there is none."""
        for before in route.passages[1:]:
            if before.index not in self._done and self._belief.fitting(before.index).is_plain:
                at = max(before.s_enter + self._half + LOOKS.behind, self._again)
                if at < before.s_leave - self._half:
                    return min(at, self._once_more)
        return self._once_more

    def located(self, route: Route, look: Look) -> float:
        """Return the arc length of a robot on a route, m, from a look back: that by its own
        estimate where the look is ambiguous."""
        distance, behind = look.distance, look.behind
        i = route.index_at(distance)
        here = route.passages[i]
        self._again, self._once_more = distance + LOOKS.behind_again, math.inf
        given = (
            None
            if i == 0 or behind is None
            else self._conditioned(behind, route.passages[i - 1].index)
        )
        if behind is None or given is None or not self._is_clear(route, i, given, look.frame):
            self._again = distance + LOOKS.behind_again * 2 ** self._vain[here.index]
            self._vain[here.index] += 1
            return distance
        self._vain[here.index] = 0
        if behind.kind[0] != route.passages[i - 1].part.fitting.kind:
            self._doubt(route, i, distance, behind)
            return distance
        located = here.s_enter + given.distance
        shift, before = located - distance, self._shift
        place = here.index, located, common_std(LOOKS.distance_floor, [given.distance_std])
        if here.index in self._done:
            if not _slipped(shift, given.distance_std):
                self._shift = math.inf
                return self._placed_again(here.index, distance, shift, place[2])
            if _slipped(shift - before, given.distance_std):
                # Of looks at elbows one in twenty is off by a centimetre.
                self._shift, self._once_more = shift, distance + LOOKS.doubt
                return distance
            self.placed, self._shift = place, math.inf
            self.slipped(shift)
            return located
        self._shift = shift
        # One wrong look must not move the robot far along its map.
        if abs(shift) > LOOKS.most_shift and abs(shift - before) > LOOKS.agreement:
            return distance
        self._shift = math.inf
        part = route.passages[i - 1].index
        sizes, enough = self._sizes.get(part), LOOKS.for_sizes
        if sizes is not None and isinstance(behind.fitting, Reducer):
            sizes.append((behind.fitting.length, behind.distance_std))
            if self._again < here.s_leave - self._half:
                enough = LOOKS.for_length
        elif sizes is not None and isinstance(behind.fitting, Elbow):
            std = behind.size_stds.get("mean_radius", 0.0)
            sizes.append((behind.fitting.mean_radius, std))
        if sizes is None:
            self._done.add(here.index)
        elif _is_measured(sizes, enough):
            self._done.add(here.index)
            self._enough = part
        again = self.placed is not None and self.placed[0] == here.index
        if again and place[2] > 0.0 and not _slipped(shift, given.distance_std):
            located = self._placed_again(here.index, distance, shift, place[2])
        else:
            self.placed = place
        # Nothing lies between: what another look back took for a fitting there was none.
        self.doubts.pop(here.part.name, None)
        return located

    def slipped(self, shift: float) -> None:
        """Take note that looks at one end of the pipe differ by ``shift`` m: belts have slipped by
        that, or one of the looks is as wrong."""
        if self.placed is not None:
            part, at, std = self.placed
            self.placed = part, at, math.hypot(std, shift)

    def _placed_again(self, part: int, distance: float, shift: float, std: float) -> float:
        """Return the arc length, m, of a robot in pipe ``part`` by one more look that agrees with
        that before, ``shift`` m farther on and to ``std`` m: the mean of both."""
        if std == 0.0 or self.placed is None or self.placed[0] != part:
            return distance
        _, at, before = self.placed
        before = math.hypot(before, LOOKS.travel * (distance - at))
        weights = _weights([before, std])
        located = distance + shift * float(weights[1] / weights.sum())
        self.placed = part, located, max(float(weights.sum()) ** -0.5, LOOKS.distance_floor)
        return located

    def _is_clear(self, route: Route, i: int, behind: Sighting, frame: Array) -> bool:
        """Return whether a look back from passage ``i``, by a robot in ``frame`` (3, 3), clearly
        shows a fitting."""
        passed, seen = route.passages[i - 1], behind.fitting
        if seen is None or behind.confidence < self._confidence:
            return False
        if behind.axis[2] < math.cos(LOOKS.most_lean) or behind.distance_std > LOOKS.most_std:
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

    def _conditioned(self, behind: Sighting, part: int) -> Sighting:
        """Return a look back at a part, given the sizes that the map has of it."""
        stds = self._belief.stds.get(self._belief.part_name(part), {})
        return behind.conditioned_on(self._belief.fitting(part), stds)

    def _doubt(self, route: Route, i: int, distance: float, behind: Sighting) -> None:
        """Note that a look back from passage ``i`` shows a fitting that is not on the map."""
        kind, at = behind.kind[0], distance - behind.distance
        # A shallow reducer may be overlooked for what is behind it.
        known = (p.s_leave for p in route.passages[:i] if p.part.fitting.kind == kind)
        if all(abs(at - s_leave) > LOOKS.most_shift for s_leave in known):
            self.doubts[route.passages[i].part.name] = f"a look back shows a {kind} in it"


def is_along(ahead: Sighting, frame: Array, axis: Array) -> bool:
    """Return whether a sighting in ``frame`` (3, 3) has the axis (3,) of the pipe, world frame,
    where it is: a picture in which that is wrong has wrong sizes and distances too."""
    return float(angle_between(frame @ ahead.axis, axis)) < LOOKS.most_off


def size_stds(looks: Sequence[Sighting], mean: Fitting) -> dict[str, float]:
    """Return the standard deviations of the sizes of a fitting, m, that is the mean of looks from
    before it. The angle of a bend is hidden there, and has none."""
    seen = [look.fitting for look in looks]
    stds: dict[str, float] = {}
    if isinstance(mean, Elbow):
        stds["mean_radius"] = common_std(
            LOOKS.radius_floor * mean.mean_radius,
            [look.size_stds.get("mean_radius", 0.0) for look in looks],
            [elbow.mean_radius for elbow in seen if isinstance(elbow, Elbow)],
        )
    elif isinstance(mean, Reducer):
        reducers = [one for one in seen if isinstance(one, Reducer)]
        stds["length"] = reducer_std(
            [look.distance_std for look in looks], [one.length for one in reducers]
        )
        stds["end_diameter"] = common_std(
            LOOKS.bore_floor * mean.end_diameter,
            [look.size_stds.get("end_diameter", 0.0) for look in looks],
            [one.end_diameter for one in reducers],
        )
    elif isinstance(mean, Wye):
        told = [look.size_stds.get("angle", 0.0) for look in looks]
        stds["angle"] = common_std(BELIEF.angle_std, told)
    return stds


def _is_measured(looks: Sequence[tuple[float, float]], enough: int) -> bool:
    """Return whether looks, each a size and its standard deviation, m, tell a size: as many as are
    ``enough`` have been made, and their mean is known well enough."""
    std = float(_weights([std for _, std in looks]).sum()) ** -0.5 if looks else math.inf
    return len(looks) >= enough and std < LOOKS.most_size_std


class LookingCloser:
    """Looks of one robot from close by at the end of a straight that it has observed from afar.

    From afar both cameras measure distances to centimetres, and may take one fitting for another.
    So the end of a straight is provisional (``Belief.provisional``) until the robot is near.

    Args:
        belief: its map.
        half: m, from its centre to its ends.
    """

    def __init__(self, belief: Belief, half: float) -> None:
        self._belief, self._half = belief, half
        self._kinds: Counter[tuple[str, str]] = Counter()
        self._far: Sighting | None = None

    def index(self, route: Route) -> int | None:
        """Return the number of the passage through the straight whose end is provisional."""
        parts = [passage.index for passage in route.passages]
        part = self._belief.provisional
        return None if part is None or part not in parts else parts.index(part)

    def begin(self, ahead: Sighting, route: Route, distance: float) -> float | None:
        """Make the end of a route provisional, as it was observed from ``distance`` m, where the
        route ends in a straight and the robot is not close to its end yet.

        Returns:
            Arc length, m, from which the robot looks at it again; None if it is not provisional.
        """
        last, close = route.passages[-1], route.length - self._half - LOOKS.close
        if not self._belief.fitting(last.index).is_plain or distance >= close - LOOKS.again:
            return None
        self._belief.settle(last.index)
        self._kinds, self._far = Counter([ahead.kind]), ahead
        # Until its rear is out of a bend, a robot knows least how far it has come.
        if distance > last.s_enter + self._half:
            return close
        self._far = None
        return max(close - LOOKS.out_of_fitting, distance + LOOKS.again)

    def moved(self, shift: float) -> None:
        """Take note that a look back has moved the robot by ``shift`` m: by more than cameras err,
        its estimate was off when it saw the end from afar, and where that was is forgotten."""
        if _slipped(shift):
            self._far = None

    def located(self, route: Route, distance: float, ahead: Sighting | None) -> float:
        """Return the arc length of a robot on a route, m, from a look at an end that it has seen
        from afar; arguments as of ``LookingBack.located``."""
        i, far = self.index(route), self._far
        if i is None or far is None or ahead is None or not _is_alike(far, ahead):
            return distance
        located = route.passages[i].s_leave - ahead.distance
        slipped = _slipped(located - distance, far.distance_std, ahead.distance_std)
        return located if slipped else distance

    def doubted(self, ahead: Sighting, route: Route, distance: float) -> float | None:
        """Return the arc length, m, of another look, needed where looks from close by and from afar
        differ in kind until one kind has been observed twice; None where none is needed, or where
        it is too late for one."""
        if self.index(route) is None:
            return None
        self._kinds[ahead.kind] += 1
        again = distance + LOOKS.doubt
        return None if self._kinds[ahead.kind] > 1 or self.too_late(again, route) else again

    def too_late(self, at: float, route: Route) -> bool:
        """Return whether arc length ``at`` m is too close to the provisional end for a look."""
        i = self.index(route)
        return i is not None and at > route.passages[i].s_leave - self._half - LOOKS.closest


def _is_alike(far: Sighting, near: Sighting) -> bool:
    """Return whether a look from afar places an end as one from nearby does: it shows the same,
    from the same port, and of a wye its angle. The distance goes with what a picture is taken for:
    wyes whose angle is told to 5 and 11 degrees were placed 35 and 147 mm off, 8 elbows up to 1."""
    placed = far.distance_std < LOOKS.most_std and far.kind == near.kind
    if not placed or far.fitting is None:
        return placed
    told = far.size_stds.get("angle", 0.0) if isinstance(far.fitting, Wye) else 0.0
    return BELIEF.certain * told < ANGLES and far.enter == near.enter


@dataclass
class MissedReducer:
    """A reducer that a robot has come through unseen, measured by looks back from behind it.

    Attributes:
        part: the straight behind it.
        bore: m, of the pipe before it.
        at: m, arc length on the leg of the next look.
        lengths: m, of the reducer, by the looks so far.
        latest: the last sighting of it, and the arc length then, m.
        vain: number of looks since the last that showed a reducer.
        others: number of looks from beyond its cone that showed the fitting before the straight.
    """

    part: int
    bore: float
    at: float
    lengths: list[float] = field(default_factory=list)
    latest: tuple[Sighting, float] | None = None
    vain: int = 0
    others: int = 0

    def shows_other(self, behind: Sighting | None, passed: str, half: float) -> bool:
        """Return whether looks back have shown the fitting of kind ``passed`` that is before the
        straight twice, as the last one does, and more often than a reducer: that is not behind it.
        From nearby they look through the cone; ``half``: m, from the robot's centre to its ends."""
        if behind is None or behind.distance < half + LOOKS.through_cone:
            return False
        if passed in ("", Straight.kind, Reducer.kind) or behind.kind[0] != passed:
            return False
        self.others += 1
        return self.others > max(len(self.lengths), 1)

    def measured(self, behind: Sighting | None, distance: float, end: float) -> Reducer | None:
        """Return the reducer, of mean length, after one more look back at it, from arc length
        ``distance`` m; None where too few looks have been made that are reliable. Fewer are enough
        where two more have shown none, as from farther off none will, and one where the next would
        be beyond the ``end`` of the leg, m."""
        reducer = None if behind is None else behind.fitting
        enough = LOOKS.for_length
        if behind is None or not isinstance(reducer, Reducer):
            self.at = distance + LOOKS.doubt * 2**self.vain
            self.vain += 1
            enough = LOOKS.for_sizes if self.vain > 1 else enough
        else:
            self.at, self.vain = distance + LOOKS.missed, 0
            (near,) = {"start", "end"} - {behind.enter}
            right = abs(2 * reducer.port_radius(near) - self.bore) < LENGTHS * self.bore
            if right and behind.distance_std < LOOKS.most_reducer_std:
                self.lengths.append(reducer.length)
                self.latest = behind, distance
        enough = 1 if self.at > end else enough
        if self.latest is None or len(self.lengths) < enough:
            return None
        seen, lengths = self.latest[0].fitting, np.array(self.lengths)
        assert isinstance(seen, Reducer)
        return replace(seen, length=float(np.mean(lengths[_without_extremes(lengths)])))

    def seen_from(self, distance: float) -> Sighting | None:
        """Return the last sighting of it as from arc length ``distance`` m; None without one."""
        if self.latest is None:
            return None
        behind, at = self.latest
        return replace(behind, distance=behind.distance + distance - at)
