"""Sight of the pipe ahead of a robot: what a look reports, error-free sight of the true network,
and when a robot that explores looks again."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import NamedTuple

import numpy as np

from omnitrack_sim.autonomy.belief import Belief, alike
from omnitrack_sim.autonomy.leg_planner import LEG_PLANNER
from omnitrack_sim.base.rotations import Array, length, unit
from omnitrack_sim.pipes import Arcs, Assembly, Elbow, Fitting, Part, Reducer, Route
from omnitrack_sim.pipes.network import End, both_ways
from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class SightSettings:
    """Reach and tolerances of error-free sight.

    Attributes:
        reach: bores that the robot is made for, seen beyond its nose: 0.96 m in 0.16 m.
        port: m, from its nose to the port by which it leaves a fitting, up to which it sees on.
        same_place: m, distance up to which an observation and the truth are of the same thing.
    """

    reach: float = 6.0
    port: float = 0.02
    same_place: float = 0.1


SIGHT = SightSettings()


@dataclass(frozen=True)
class Ahead:
    """Sighting of the pipe ahead of a robot, at one moment.

    "Ahead" is where the robot drives to: beyond its nose in gear 1, beyond its tail in gear -1. Its
    frame is that of the gear, which has z ahead and x towards module 1 in both
    (``robots/omnitrack/control/command.py``).

    Attributes:
        fitting: the next one that the robot's centre has not come into and that is no plain
            straight of the same bore, with its sizes as seen; None: nothing but straight pipe as
            far as is seen, or an end. The nose may be in it already.
        enter: port of ``fitting`` by which it would be entered; "" without one. Where a fitting
            looks the same from two ports, such as an elbow or a tee from either end of its run,
            either of them.
        end: the pipe ends there, "open" or "closed"; "" where it does not, or goes into a fitting.
        distance: m, along the pipe's axis from the robot's centre to the port plane of what is
            seen, or to where sight ends.
        turn: rad, from the robot's x axis, projected across the pipe, to the x axis of the port
            ``enter`` (``Fitting.ports``), about the pipe's axis ahead. It is the turn of
            ``pipes.attached`` for a placed port whose x axis is that projection (``side_of``). 0
            for a fitting that is round about its axis.
        distance_std: m, standard deviation of the distance.
        turn_std: rad, standard deviation of the turn.
        confidence: probability that the kind of ``fitting``, or of the end, is right.
        axis: (3,) unit vector along the pipe ahead, in the robot's frame.

    Example:
        >>> ot.Ahead(end="open", distance=0.4).kind  # an open end, 0.4 m ahead
        ('', 'open')
    """

    fitting: Fitting | None = None
    enter: str = ""
    end: str = ""
    distance: float = 0.0
    turn: float = 0.0
    distance_std: float = 0.0
    turn_std: float = 0.0
    confidence: float = 1.0
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]), compare=False)

    @property
    def kind(self) -> tuple[str, str]:
        """Kind of the fitting, and the end, without position and sizes."""
        return "" if self.fitting is None else self.fitting.kind, self.end


def side_of(frame: Array, ahead: Array) -> Array:
    """The x axis (3,) of a robot's ``frame`` (3, 3), projected across a pipe along ``ahead``
    (3,), world frame: what ``Ahead.turn`` is measured from."""
    x = frame[:, 0]
    return unit(x - ahead * (x @ ahead))


class Look(NamedTuple):
    """A robot has looked ahead, and maybe back.

    Attributes:
        time: s.
        distance: m, arc length of its centre on its leg, estimate.
        ahead: sighting; None where it is ambiguous.
        behind: the same back; None also where the robot has not looked.
        frame: (3, 3) of the robot in its gear, world frame, estimate.
        bore: m, of the pipe around it, by its arms; not a number where they were not read.
    """

    time: float
    distance: float
    ahead: Ahead | None
    behind: Ahead | None
    frame: Array
    bore: float = math.nan


class TrueSight:
    """Error-free sight of one network.

    Args:
        pipes: the network.
        plates: ports that a plate closes.
        robot: its length, and the bore that it is made for.
        arcs: of the centreline in tees, along which distances are measured.
    """

    def __init__(self, pipes: Assembly, plates: Collection[End], robot: Robot, arcs: Arcs) -> None:
        self._pipes, self._half, self._arcs = pipes, robot.length / 2, arcs
        self._reach = SIGHT.reach * robot.nominal_bore
        self._joined = both_ways(pipes.joints)
        closed = set(plates)
        self._closed = closed | {self._joined[end] for end in closed if end in self._joined}

    def look(self, robot: int, position: Array, frame: Array) -> Ahead | None:
        """Return the sighting of one robot now; None where it is ambiguous, such as within a bend.

        Args:
            robot: index in its batch.
            position: (3,) m, of the robot's centre, world frame, the true one.
            frame: (3, 3) of the robot in its gear, in the world, the true one.
        """
        nearest = min(self._ports_ahead(position[None], frame[:, 2]), default=None)
        return None if nearest is None else self._from(*nearest[1:], frame)

    def _ports_ahead(self, centre: Array, axis: Array) -> Iterator[tuple[float, float, End]]:
        """Yield the ports ahead of a robot with its centre (1, 3) m in a straight, or in another
        fitting with its nose at the port: the distance of the centre from the axis that leads
        there, and along it to the port plane, m, and the port."""
        for index, part in enumerate(self._pipes.parts):
            fitting = part.fitting
            if not part.holds(centre, 0.0):
                continue
            for enter, leave in permutations(fitting.port_names, 2):
                if float(axis @ part.port(leave).rotation[:, 2]) < math.cos(LEG_PLANNER.along):
                    continue
                line = part.axis(enter, leave, self._arcs)
                at = line.locate(centre)
                left = line.length - float(at[0])
                # Within a fitting its walls hide what is beyond, until the nose is at the port.
                if fitting.is_plain or left <= self._half + SIGHT.port:
                    beside = float(length(centre - line.at(at)[0])[0])
                    yield beside, left, (index, leave)

    def _from(self, distance: float, end: End, frame: Array) -> Ahead:
        """Return the sighting through a port at ``distance`` m."""
        axis = frame.T @ self._pipes.parts[end[0]].port(end[1]).rotation[:, 2]
        reach = self._half + self._reach
        while distance <= reach:
            if end in self._closed:
                return Ahead(end="closed", distance=distance, axis=axis)
            if end not in self._joined:
                return Ahead(end="open", distance=distance, axis=axis)
            index, enter = self._joined[end]
            part = self._pipes.parts[index]
            if not part.fitting.is_plain:
                turn = _turn(part, enter, frame)
                return Ahead(part.fitting, enter, distance=distance, turn=turn, axis=axis)
            # A straight of the same bore looks like more of the pipe: sight goes on through it.
            distance += part.fitting.length_of_axes
            end = index, next(name for name in part.fitting.port_names if name != enter)
        return Ahead(distance=reach, axis=axis)


def _turn(part: Part, enter: str, frame: Array) -> float:
    """See ``Ahead.turn``."""
    if part.fitting.is_axial:
        return 0.0
    port = part.port(enter).rotation
    ahead, x = -port[:, 2], port[:, 0]
    side = side_of(frame, ahead)
    return math.atan2(float(x @ np.cross(ahead, side)), float(x @ side))


def is_right(observed: Ahead, truth: Ahead) -> bool:
    """Return whether a sighting agrees with the truth: a fitting, an end, or, as far as is seen,
    nothing. Which of a fitting's ports is nearer counts where the ports differ."""
    if observed.fitting is None and not observed.end:
        return truth.distance > observed.distance - SIGHT.same_place
    if abs(observed.distance - truth.distance) > SIGHT.same_place or observed.end != truth.end:
        return False
    if observed.fitting is None or truth.fitting is None:
        return observed.fitting is truth.fitting
    same = observed.fitting.kind == truth.fitting.kind
    return same and alike(truth.fitting, observed.enter, truth.enter)


@dataclass(frozen=True)
class LookSettings:
    """Conditions in which a robot that explores looks again at what it has observed or passed.

    Attributes:
        behind: m, from its rear to a fitting behind it when it looks back at that.
        behind_again: m, travel to the next look back, where the one before was ambiguous.
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
        again: m, travel to the next look where one was ambiguous.
        doubt: m, travel to the next look where two contradict each other.
        least_std: m, standard deviation of a distance below which one look counts no more than
            another.
        most_size_std: m, standard deviation of a size measured from behind up to which it is known:
            half of what lengths on a map may be wrong by.
        for_sizes: looks from close by that the sizes of a reducer or an elbow are the mean of.
        for_radius: the same of an elbow whose radius they show differently. By a lamp one look at
            90 degrees of 1.5 bores is off by 9 mm (standard deviation), the mean of five without
            the least and the greatest by 3; of looks at 45 degrees one in five is off by 60 mm.
    """

    behind: float = 0.1
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
    again: float = 0.003
    doubt: float = 0.01
    least_std: float = 1e-4
    most_size_std: float = 0.005
    for_sizes: int = 3
    for_radius: int = 5


LOOKS = LookSettings()


def _slipped(shift: float, *stds: float) -> bool:
    """Return whether belts have slipped where looks of standard deviations ``stds`` m place a robot
    by ``shift`` m elsewhere."""
    return abs(shift) > LOOKS.least_slip + LOOKS.slip * math.hypot(*stds)


def weights(stds: Sequence[float]) -> Array:
    """Weights (n,) of measurements, 1/m², by their standard deviations, m."""
    return np.maximum(stds, LOOKS.least_std) ** -2


def is_measured(looks: Sequence[tuple[float, float]]) -> bool:
    """Return whether looks, each a size and its standard deviation, m, are enough to tell a size:
    their mean is known well enough, and more than one has been made."""
    std = float(weights([std for _, std in looks]).sum()) ** -0.5 if looks else math.inf
    return len(looks) >= LOOKS.for_sizes and std < LOOKS.most_size_std


class LookingBack:
    """Looks of one robot at the fittings that it has passed: one in each straight behind a fitting,
    and one more where it sees the far end of that straight, which so is measured by looks alone.

    Round a bend a robot knows least how far it has come, and sees that best when the bend is just
    behind it.

    Args:
        belief: its map.
        half: m, from its centre to its ends.
        least_confidence: probability from which on it believes what it sees.

    Attributes:
        doubts: names of pipes in which a look back has shown something else than the map, and what.
        sizes: m, by their parts, of reducers and elbows to be measured from behind: lengths
            and mean radii, of each look, with the standard deviation of where the look has them.
    """

    def __init__(self, belief: Belief, half: float, least_confidence: float) -> None:
        self._belief, self._half, self._confidence = belief, half, least_confidence
        self.doubts: dict[str, str] = {}
        self.sizes: dict[int, list[tuple[float, float]]] = {}
        self._done: set[int] = set()
        self._twice: set[int] = set()
        self._again, self._shift, self._once_more = 0.0, math.inf, math.inf

    def begin(self) -> None:
        """Begin another leg."""
        self._again, self._once_more = 0.0, math.inf

    def once_more(self, route: Route, distance: float) -> bool:
        """Ask for one more look back from arc length ``distance`` m on, where the robot has looked
        back once in this straight; return whether it is asked for."""
        here = route.passages[route.index_at(distance)]
        if here.index not in self._done - self._twice:
            return False
        self._twice.add(here.index)
        self._once_more = distance
        return True

    def at(self, route: Route) -> float:
        """Return the arc length on a route, m, where it looks back next; infinite if nowhere."""
        for before in route.passages[1:]:
            if before.index not in self._done and self._belief.fitting(before.index).is_plain:
                at = max(before.s_enter + self._half + LOOKS.behind, self._again)
                if at < before.s_leave - self._half:
                    return min(at, self._once_more)
        return self._once_more

    def located(self, route: Route, distance: float, behind: Ahead | None) -> float:
        """Return the arc length of a robot on a route, m, from a look back.

        Args:
            route: it drives along.
            distance: m, its estimate of the arc length; returned where the look is ambiguous.
            behind: the look.
        """
        i = route.index_at(distance)
        self._again, self._once_more = distance + LOOKS.behind_again, math.inf
        if i == 0 or behind is None or not self._is_clear(route, i, behind):
            return distance
        here = route.passages[i]
        if behind.kind[0] != route.passages[i - 1].part.fitting.kind:
            self._doubt(route, i, distance, behind)
            return distance
        located = here.s_enter + behind.distance
        shift, before = located - distance, self._shift
        if here.index in self._done:
            return located if _slipped(shift, behind.distance_std) else distance
        self._shift = shift
        # One wrong look must not move the robot far along its map.
        if abs(shift) > LOOKS.most_shift and abs(shift - before) > LOOKS.agreement:
            return distance
        sizes = self.sizes.get(route.passages[i - 1].index)
        if sizes is not None and isinstance(behind.fitting, Reducer):
            sizes.append((behind.fitting.length, behind.distance_std))
        elif sizes is not None and isinstance(behind.fitting, Elbow):
            sizes.append((behind.fitting.mean_radius, behind.distance_std))
        if sizes is None or is_measured(sizes):
            self._done.add(here.index)
        # Nothing lies between: what another look back took for a fitting there was none.
        self.doubts.pop(here.part.name, None)
        return located

    def _is_clear(self, route: Route, i: int, behind: Ahead) -> bool:
        """Return whether a look back from passage ``i`` clearly shows a fitting."""
        if behind.fitting is None or behind.confidence < self._confidence:
            return False
        if behind.axis[2] < math.cos(LOOKS.most_lean) or behind.distance_std > LOOKS.most_std:
            return False
        return self._belief.fitting(route.passages[i].index).is_plain

    def _doubt(self, route: Route, i: int, distance: float, behind: Ahead) -> None:
        """Note that a look back from passage ``i`` shows a fitting that the map has not there."""
        kind, at = behind.kind[0], distance - behind.distance
        # A shallow reducer may be overlooked for what is behind it.
        known = (p.s_leave for p in route.passages[:i] if p.part.fitting.kind == kind)
        if all(abs(at - s_leave) > LOOKS.most_shift for s_leave in known):
            self.doubts[route.passages[i].part.name] = f"a look back shows a {kind} in it"


class LookingCloser:
    """Looks of one robot, from close by, at the end of a straight that it has observed from afar.

    From afar both cameras measure distances to centimetres, and may take one fitting for another.
    So the end of a straight is provisional (``Belief.provisional``) until the robot is near.

    Args:
        belief: its map.
        half: m, from its centre to its ends.
    """

    def __init__(self, belief: Belief, half: float) -> None:
        self._belief, self._half = belief, half
        self._kinds: Counter[tuple[str, str]] = Counter()
        self._far: Ahead | None = None

    def index(self, route: Route) -> int | None:
        """Return the number of the passage through the straight whose end is provisional."""
        parts = [passage.index for passage in route.passages]
        part = self._belief.provisional
        return None if part is None or part not in parts else parts.index(part)

    def begin(self, ahead: Ahead, route: Route, distance: float) -> float | None:
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
        self.forget()
        return max(close - LOOKS.out_of_fitting, distance + LOOKS.again)

    def forget(self) -> None:
        """Forget where the end is, as the robot was elsewhere than it took itself to be."""
        self._far = None

    def located(self, route: Route, distance: float, ahead: Ahead | None) -> float:
        """Return the arc length of a robot on a route, m, from a look at an end that it has seen
        from afar; arguments as of ``LookingBack.located``."""
        i, far = self.index(route), self._far
        if i is None or far is None or ahead is None or ahead.kind != far.kind:
            return distance
        located = route.passages[i].s_leave - ahead.distance
        slipped = _slipped(located - distance, far.distance_std, ahead.distance_std)
        return located if slipped else distance

    def doubted(self, ahead: Ahead, route: Route, distance: float) -> float | None:
        """Return the arc length, m, of another look by a robot that observes something else from
        close by than from afar, until it has observed one thing twice; None where the look is
        unambiguous, or where it is too late for another."""
        if self.index(route) is None:
            return None
        self._kinds[ahead.kind] += 1
        again = distance + LOOKS.doubt
        return None if self._kinds[ahead.kind] > 1 or self.too_late(again, route) else again

    def too_late(self, at: float, route: Route) -> bool:
        """Return whether arc length ``at`` m is too close to the provisional end for a look."""
        i = self.index(route)
        return i is not None and at > route.passages[i].s_leave - self._half - LOOKS.closest
