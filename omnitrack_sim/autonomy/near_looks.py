"""Looks of a robot that explores from close by at what it has seen ahead.

It confirms a sighting out of a fitting by a second one (``Confirmation``), looks once more at the
end of a pipe that it has observed from afar (``NearLooks``), and takes the mean of several looks
as the sizes of a fitting (``CloseLooks``).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from omnitrack_sim.autonomy.belief import BELIEF, Belief, doubtful_sizes
from omnitrack_sim.autonomy.looks import (
    LOOKS,
    LookRecord,
    common_std,
    has_slipped,
    provisional_passage,
    size_stds,
    weights_of,
    without_extremes,
)
from omnitrack_sim.autonomy.sight import Sighting
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Elbow, Reducer, Route, Straight, Wye
from omnitrack_sim.pipes.map_difference import ANGLES, LENGTHS, MIN_LENGTH


class Confirmation(LookRecord):
    """Confirms a fitting sighted out of another one by a second sighting of it in the same place.

    A bend that is not over looks like another one that begins at the lens.

    Attributes:
        confirmed: the last sighting has confirmed the one before.
        side: (3,) direction of the fitting, see ``side_of``, by the sighting that was confirmed;
            None where none was.
    """

    def __init__(self) -> None:
        # The sighting to be confirmed, where it is, and from where it was made, m, and the
        # direction of the fitting.
        self._first: tuple[Sighting, float, float, Array] | None = None
        self.confirmed = False
        self.side: Array | None = None

    @property
    def unconfirmed_kind(self) -> str:
        """Kind of the fitting that has not been confirmed.

        "" for none and for an elbow, which often is the rest of the bend before.
        """
        kind = "" if self._first is None else self._first[0].kind[0]
        return "" if kind == Elbow.kind else kind

    def begin_leg(self) -> None:
        """See ``LookRecord``."""
        self._first, self.confirmed, self.side = None, False, None

    def add(self, ahead: Sighting, distance: float, side: Array) -> None:
        """Compare a sighting with the one before.

        Args:
            ahead: the sighting.
            distance: m, arc length at which it was made.
            side: (3,) direction of the fitting.
        """
        at, bends, self.confirmed = (
            distance + ahead.distance,
            isinstance(ahead.fitting, Elbow),
            False,
        )
        self.side = None
        if self._first is not None and _may_be_one(self._first[0], ahead):
            _, before, since, first = self._first
            # The rest of a bend begins at the lens and moves with it; another bend has to stay
            # where it is. Other fittings are not seen where there are none.
            tolerance = (distance - since) / 2 if bends else BELIEF.error
            self.confirmed = abs(at - before) < tolerance
            if bends and not self.confirmed and at > before:
                return  # Since the first sighting the rest of a bend has moved farthest.
            if self.confirmed:
                self.side = first
        # The robot's estimate may have been off at the first sighting, so this one replaces it: so
        # it was where a bend has come nearer, as its rest moves on alone.
        self._first = None if self.confirmed else (ahead, at, distance, side)


def _may_be_one(first: Sighting, second: Sighting) -> bool:
    """Return whether two sightings may show one fitting.

    They are of the same kind, and a reducer leads to the same bore. By a lamp what no form explains
    looks like any cone.
    """
    one, other = first.fitting, second.fitting
    if isinstance(one, Reducer) and isinstance(other, Reducer):
        return abs(one.end_diameter - other.end_diameter) < LENGTHS * one.end_diameter
    return first.kind == second.kind


class CloseLooks(LookRecord):
    """Sightings of one reducer or elbow from close by, whose mean gives its sizes and position."""

    def __init__(self) -> None:
        # Each sighting, and the arc length of the robot then, m.
        self._looks: list[tuple[Sighting, float]] = []

    @property
    def latest(self) -> tuple[Sighting, float] | None:
        """The latest sighting, and the arc length at which it was made, m; None without any."""
        return self._looks[-1] if self._looks else None

    def begin_leg(self) -> None:
        """See ``LookRecord``."""
        self.clear()

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
        """Return whether another look is needed for sizes and position to be known.

        As far as a map may not be wrong in them, and in the length of the pipe before the fitting,
        which begins at arc length ``before`` m.
        """
        if len(self._looks) < LOOKS.min_looks:
            return True
        radii = self._radii() or [0.0]
        begin, std = self.begin_of(*self._looks[-1])
        more = (
            max(radii) - min(radii) > MIN_LENGTH / 2
            or doubtful_sizes(Straight(max(begin - before, BELIEF.min_length)), {"length": std})
            or doubtful_sizes(self.mean(), self.stds())
        )
        return bool(more) and len(self._looks) < LOOKS.max_looks

    def begin_of(self, ahead: Sighting, distance: float) -> tuple[float, float]:
        """Return the arc length at which a fitting or an end begins, and its standard deviation.

        Both in m. It is sighted from arc length ``distance`` m. The mean of all sightings of its
        kind, weighted by their variances: the last of them sees the cone of a reducer from too
        near.
        """
        looks = [look for look in self._looks if look[0].kind == ahead.kind]
        looks += [] if any(look is ahead for look, _ in looks) else [(ahead, distance)]
        ends = [at + look.distance for look, at in looks]
        stds = [look.distance_std for look, _ in looks]
        mean = float(np.average(ends, weights=weights_of(stds)))
        return mean, common_std(stds, ends)

    def mean(self) -> Elbow | Reducer:
        """Return the fitting with the mean of its sizes."""
        elbows = [look.fitting for look, _ in self._looks if isinstance(look.fitting, Elbow)]
        if elbows:
            radii = np.array(self._radii())
            angle = float(np.mean([elbow.angle for elbow in elbows]))
            radius = float(np.mean(radii[without_extremes(radii)]))
            return replace(elbows[0], mean_radius=radius, angle=angle)
        sizes, weights = self._reducer_sizes(), weights_of(self._stds())
        middle = without_extremes(sizes[:, 0])
        return Reducer(*np.average(sizes[middle], axis=0, weights=weights[middle]).tolist())

    def stds(self) -> dict[str, float]:
        """Return the standard deviations of these sizes, m, by their keys."""
        return size_stds([look for look, _ in self._looks], self.mean())

    def doubt(self) -> str:
        """Return why the sizes of a reducer are in doubt, "" where they are not.

        Its cone is shallow, and its far end may be hidden by what follows.
        """
        sizes = self._reducer_sizes()
        if not len(sizes):
            return ""
        least = min(self._stds())
        if least > LOOKS.max_reducer_std:
            return "its ends hardly show"
        mean = np.average(sizes, axis=0, weights=weights_of(self._stds()))
        if np.any(np.ptp(sizes, axis=0) > [2 * MIN_LENGTH, *(LENGTHS * mean[1:])]):
            return "looks at it differ in its sizes"
        return "its length was seen from one side only" if least > MIN_LENGTH / 2 else ""

    def weight(self) -> float:
        """Return the weight of the mean length of a reducer, or radius of an elbow, 1/m².

        The inverse of its variance, 0 by error-free sight.
        """
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


class NearLooks(LookRecord):
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

    def plan(self, ahead: Sighting, route: Route, distance: float) -> float | None:
        """Plan a look at the end of a route from close by, and make that end provisional.

        Args:
            ahead: what was observed there.
            route: to its end.
            distance: m, from where it was observed.

        Returns:
            Arc length, m, from which the robot looks at it again; None, and nothing is provisional,
            where the route does not end in a straight or the robot is close to its end already.
        """
        last, close = route.passages[-1], route.length - self._half - LOOKS.close
        if not self._belief.fitting(last.index).is_plain or distance >= close - LOOKS.step_again:
            return None
        self._belief.set_provisional(last.index)
        self._kinds, self._far = Counter([ahead.kind]), ahead
        # Until its rear is out of a bend, a robot knows least how far it has come.
        if distance > last.s_enter + self._half:
            return close
        self._far = None
        return max(close - BELIEF.error, distance + LOOKS.step_again)

    def begin_leg(self) -> None:
        """See ``LookRecord``."""
        self._belief.set_provisional(None)

    def shift_robot(self, shift: float) -> None:
        """Take note that a look back has moved the robot by ``shift`` m.

        By more than cameras err, its estimate was off when it saw the end from afar, and where that
        was is forgotten.
        """
        if has_slipped(shift):
            self._far = None

    def located(self, route: Route, distance: float, ahead: Sighting | None) -> float:
        """Return the arc length of a robot on a route, m, from a look at an end seen from afar.

        Args:
            route: of its leg.
            distance: m, by its own estimate.
            ahead: what it sees there from close by; None where that is ambiguous.
        """
        i, far = provisional_passage(self._belief, route), self._far
        if i is None or far is None or ahead is None or not _is_alike(far, ahead):
            return distance
        located = route.passages[i].s_leave - ahead.distance
        slipped = has_slipped(located - distance, far.distance_std, ahead.distance_std)
        return located if slipped else distance

    def add(self, ahead: Sighting, route: Route) -> None:
        """Count the kind of a sighting of the provisional end, if there is one on a route."""
        if provisional_passage(self._belief, route) is not None:
            self._kinds[ahead.kind] += 1

    def is_doubted(self, ahead: Sighting, route: Route) -> bool:
        """Return whether looks from close by and from afar differ in kind.

        Until the kind of ``ahead`` has been observed twice.
        """
        there = provisional_passage(self._belief, route) is not None
        return there and self._kinds[ahead.kind] < 2

    def is_too_late(self, at: float, route: Route) -> bool:
        """Return whether arc length ``at`` m is too close to the provisional end for a look."""
        i = provisional_passage(self._belief, route)
        return i is not None and at > route.passages[i].s_leave - self._half - LOOKS.close / 2


def _is_alike(far: Sighting, near: Sighting) -> bool:
    """Return whether a look from afar places an end as one from nearby does.

    It shows the same, from the same port, and of a wye its angle. The distance goes with what a
    picture is taken for: wyes whose angle is told to 5 and 11 degrees were placed 35 and 147 mm
    off, 8 elbows up to 1.
    """
    placed = far.distance_std < MIN_LENGTH and far.kind == near.kind
    if not placed or far.fitting is None:
        return placed
    told = far.size_stds.get("angle", 0.0) if isinstance(far.fitting, Wye) else 0.0
    return BELIEF.certain * told < ANGLES and far.enter == near.enter
