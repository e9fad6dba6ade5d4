"""What a robot that explores puts into its map.

Free pipe, fittings, loops, and bends measured by coming through them.
"""

from __future__ import annotations

import math

import numpy as np

from omnitrack_sim.autonomy.belief import BELIEF, doubtful_sizes
from omnitrack_sim.autonomy.bore_survey import with_bore
from omnitrack_sim.autonomy.leg_planner import is_sharp
from omnitrack_sim.autonomy.looks import HARDLY_SHOWS, LOOKS, LookRecord, size_stds
from omnitrack_sim.autonomy.loop_closure import close_loop, known_port, meeting_ports
from omnitrack_sim.autonomy.mapping_pilot import MappingPilot, end_of
from omnitrack_sim.autonomy.rear_looks import RearLooks
from omnitrack_sim.autonomy.sight import Look, Sighting
from omnitrack_sim.autonomy.sighting_check import SightingCheck, direction_of
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Array, angle_between, unit
from omnitrack_sim.pipes import Elbow, Fitting, Port, Reducer, Tee, Wye
from omnitrack_sim.pipes.map_difference import ANGLES
from omnitrack_sim.pipes.routes import Edge
from omnitrack_sim.record.events import Event, FittingFound, LoopClosed

MAX_END_SHIFT = 0.06
"""Between the positions of an end by looks from afar and from close by, m, from which on the length
of the pipe is in doubt: the robot may have slipped."""
BLIND = 0.07
"""From the nose to where a lens of 100 degrees sees the wall of a pipe of 160 mm, m."""


class Mapper(LookRecord):
    """Puts what a robot sees into its map.

    Args:
        pilot: of the robot, whose leg leads through the map.
        rear: its looks back.
        check: its looks ahead.
    """

    def __init__(self, pilot: MappingPilot, rear: RearLooks, check: SightingCheck) -> None:
        self._pilot, self._belief, self._rear, self._check = pilot, pilot.belief, rear, check
        self._unmeasured_bends: set[int] = set()  # elbows and wyes whose angle is as seen
        self._named: set[str] = set()  # fittings that an event has named

    def forget_part(self, part: int) -> None:
        """See ``LookRecord``."""
        self._unmeasured_bends.discard(part)

    # Pipe

    def with_free_pipe(self, more: float, std: float = math.inf) -> tuple[Edge, ...]:
        """Put free pipe into the map at the end of the leg.

        Args:
            more: m, of free pipe.
            std: m, of where a fitting begins that is sighted at its end.

        Returns:
            The path at hand, extended by that pipe.
        """
        pilot, belief, path, end = self._pilot, self._belief, self._pilot.leg.path, self._pilot.end
        if belief.fitting(end[0]).is_plain:
            left = belief.lengthen(end[0], more)
            if left > BELIEF.min_straight or not belief.is_removable(end[0]):
                return path
            belief.remove(end[0])
            path, more = path[:-1], left
        if more <= BELIEF.min_straight:
            more -= self._correct_reducer(path[-1][0], more, std)
            if more > BELIEF.error:
                pilot.doubt(path[-1][0], f"{1000 * more:.0f} mm of pipe behind it may be none")
            return path
        return (*path, (belief.attach_straight(end, more), "start", "end"))

    def _correct_reducer(self, part: int, more: float, std: float) -> float:
        """Correct the length of a reducer by the fitting that directly follows.

        Where that begins tells the length better than the far end of a shallow cone.

        Args:
            part: the reducer; anything else is left as it is.
            more: m, from its end to where the fitting begins.
            std: m, of the latter.

        Returns:
            By how much longer it is now, m.
        """
        reducer, stds = self._belief.fitting(part), self._belief.stds
        known = stds.get(self._belief.part_name(part), {}).get("length", 0.0)
        if not isinstance(reducer, Reducer) or not known or abs(more) > BELIEF.min_straight:
            return 0.0
        share = known**2 / (known**2 + std**2)
        try:
            self._belief.resize(part, length=reducer.length + share * more)
        except GeometryError:
            return 0.0
        self._belief.set_stds(part, length=known * math.sqrt(1 - share))
        return share * more

    def measure_pipe(self, part: int, look: Look, end_std: float) -> None:
        """Note to what the length of a straight is known whose end a look has placed.

        ``part`` may be no straight; ``end_std`` is the standard deviation of its end, m.
        """
        if not self._belief.fitting(part).is_plain:
            return
        placement, std = self._rear.placement, math.hypot(end_std, look.std)
        if end_std > 0.0 and placement is not None and placement.part == part:
            slip = LOOKS.travel_std * (look.distance - placement.distance)
            std = math.hypot(end_std, placement.std, slip)
        self._belief.set_stds(part, length=std)

    def doubt_moved_end(self, move: float) -> None:
        """Doubt the length of the straight ahead if its end has moved between looks.

        By ``move`` m, from afar and from close by.
        """
        if abs(move) > MAX_END_SHIFT:
            part, _, _ = self._check.look_from(self._pilot.route())
            self._pilot.doubt(part, f"its end moved by {1000 * abs(move):.0f} mm between looks")

    # Fittings

    def correct_passed(self) -> float:
        """Correct the size of a fitting that has been measured from behind.

        Returns by how much longer it is now, m.
        """
        measured = self._rear.take_measured()
        if measured is None:
            return 0.0
        part, key, size, std = measured
        fitting = self._belief.fitting(part)
        longer = size - getattr(fitting, key)
        if isinstance(fitting, Elbow):
            longer *= fitting.angle
        self._belief.resize(part, **{key: size})
        self._belief.set_stds(part, **{key: std})
        self._pilot.doubts.pop(self._belief.part_name(part), None)
        self._pilot.lengthen_leg(longer)
        return longer

    def add_fitting(
        self, ahead: Sighting, path: tuple[Edge, ...], look: Look
    ) -> tuple[int | None, list[Event]]:
        """Put a fitting sighted at the end of a path into the map.

        Returns:
            Its part, None where the map had it already, by another way; and events.
        """
        pilot, belief, end, close = self._pilot, self._belief, end_of(path), self._check.close
        assert ahead.fitting is not None
        fitting, weight, stds = ahead.fitting, 0.0, size_stds([ahead], ahead.fitting)
        if close.are_of(ahead):
            fitting, weight, stds = close.mean(), close.weight(), close.stds()
            self._doubt_sizes(belief.next_name(fitting), ahead)
            close.clear()
        fitting = with_bore(fitting, ahead.enter, belief.bore(end))
        known = None if end in belief.joined else known_port(belief, end, fitting, ahead.enter)
        if end in belief.joined or known is not None:
            return None, [] if known is None else [self._close_loop(look.time, end, known)]
        side, apart = direction_of(ahead, look, belief.port(end).rotation[:, 2]), 0.0
        first = self._check.confirmation.side
        if first is not None:
            side, apart = _mean_direction(first, side, fitting, ahead.enter)
        part = belief.attach(end, fitting, ahead.enter, side)
        if apart > ANGLES and not fitting.is_axial:
            # Of its port: sizes that are measured later say nothing about it.
            name = belief.name((part, ahead.enter))
            pilot.doubts[name] = f"looks differ by {math.degrees(apart):.0f} deg in direction"
        belief.set_stds(part, **stds)
        self._measure_later(part, ahead, weight)
        return part, [*self._found(part, ahead, look.time), *self._meet(part, look.time)]

    def _doubt_sizes(self, name: str, ahead: Sighting) -> None:
        """Doubt the mean of looks from close by where they leave it open.

        They replace what was seen from afar.
        """
        doubts, doubt = self._pilot.doubts, self._check.close.doubt()
        if ahead.confidence > LOOKS.sure:
            doubts.pop(name, None)
        if doubt:
            doubts.setdefault(name, doubt)

    def _found(self, part: int, ahead: Sighting, time: float) -> list[Event]:
        """Return the event of a new fitting; none if one has named it before."""
        name = self._belief.part_name(part)
        if name in self._named:
            return []
        self._named.add(name)
        return [FittingFound(self._pilot.number, time, name, ahead.distance)]

    def _meet(self, part: int, time: float) -> list[Event]:
        """Close the loops where ports of a new part meet unexplored ones of others."""
        return [
            self._close_loop(time, port, other)
            for port, other in meeting_ports(self._belief, part)
            if {port, other} <= set(self._belief.unexplored)
        ]

    def _close_loop(self, time: float, end: Port, other: Port) -> Event:
        """Close a loop of the map.

        It is in doubt where its ends miss each other by more than what was measured around it may
        be off by.
        """
        belief = self._belief
        miss, doubtful = close_loop(belief, end, other)
        if doubtful:
            self._pilot.doubt(end[0], f"the loop there missed by {1000 * miss:.0f} mm")
        return LoopClosed(self._pilot.number, time, belief.name(end), belief.name(other), miss)

    def _measure_later(self, part: int, ahead: Sighting, weight: float) -> None:
        """Have a new fitting measured when the robot has come through it.

        The angle of a bend, and sizes that are in doubt; ``weight`` is that of those that the map
        has, see ``CloseLooks``.
        """
        fitting, name = self._belief.fitting(part), self._belief.part_name(part)
        if isinstance(fitting, Elbow | Wye):
            self._unmeasured_bends.add(part)
        if name in self._pilot.doubts:
            self._rear.measure(part, weight)
        elif ahead.confidence < LOOKS.sure:
            self._pilot.doubt(part, HARDLY_SHOWS)
            # A lamp shows the cone of a reducer no better from behind.
            if isinstance(fitting, Elbow):
                self._rear.measure(part, weight)
        elif self._will_be_doubtful(part):
            self._rear.measure(part, weight)

    def _will_be_doubtful(self, part: int) -> bool:
        """Return whether sizes of a reducer, or of an elbow of measured angle, are in doubt."""
        stds = self._belief.stds.get(self._belief.part_name(part), {})
        if stds.get("mean_radius"):
            stds = {**stds, "angle": BELIEF.kept_angle_std}
        fitting = self._belief.fitting(part)
        return isinstance(fitting, Elbow | Reducer) and bool(doubtful_sizes(fitting, stds))

    # Bends

    def measure_bend(self, ahead: Sighting, look: Look) -> None:
        """Measure the bend that the robot has come through into the pipe that it sees.

        An elbow, or the branch of a wye; the map has its angle and direction then.
        """
        # Before an elbow its far end is hidden, so a picture shows its angle badly, and now and
        # then one is off in direction. How the robot is turned it knows better, even where it has
        # come round by other fittings.
        bend = self._bend_passed()
        if bend is None or not self._shows_axis(ahead, look.std):
            return
        belief, axis, (part, enter, leave) = self._belief, look.frame @ ahead.axis, bend
        self._unmeasured_bends.remove(part)
        fitting = belief.fitting(part)
        before = -belief.port((part, enter)).rotation[:, 2]
        on = belief.port((part, leave)).rotation[:, 2]
        angle, off = float(angle_between(before, axis)), _turn_to(before, on, axis)
        assert isinstance(fitting, Elbow | Wye)
        if isinstance(fitting, Wye) and is_sharp(fitting, enter, leave):
            angle = math.pi - angle
        self._correct_angle(part, fitting, angle, look.std)
        joint = belief.attached_to(part)
        wrong = abs(off) > LOOKS.gate * BELIEF.turn_std
        if wrong and joint is not None and joint[1][1] == enter:
            belief.rotate_joint(joint[1], off)

    def _correct_angle(self, part: int, fitting: Elbow | Wye, angle: float, std: float) -> None:
        """Give a bend on the map its measured angle, rad; ``std``: m, of where the robot is."""
        right = abs(angle - fitting.angle) < BELIEF.angle_std
        if not right:
            try:
                self._belief.resize(part, angle=angle)
            except GeometryError:
                return
        told = BELIEF.kept_angle_std if right else BELIEF.angle_std
        self._belief.set_stds(part, angle=told if std else 0.0)

    def _bend_passed(self) -> Edge | None:
        """Return the bend out of which the leg leads, if its angle has not been measured."""
        path, belief = self._pilot.leg.path, self._belief
        last = len(path) - 1
        if last > 0 and belief.fitting(path[last][0]).is_plain:
            last -= 1
        part, enter, leave = path[last]
        straight_on = isinstance(belief.fitting(part), Wye) and "branch" not in (enter, leave)
        measured = part not in self._unmeasured_bends or straight_on
        return None if measured or self._pilot.end in belief.joined else path[last]

    def _shows_axis(self, ahead: Sighting, std: float) -> bool:
        """Return whether a sighting shows how the pipe lies.

        Where a bend begins nearer than a lens sees the wall, no straight wall does. ``std``: m, of
        the robot's arc length, 0 where it knows its pose.
        """
        near = ahead.distance - self._pilot.half < BLIND
        return std == 0.0 or not (near and isinstance(ahead.fitting, Elbow))


def _mean_direction(
    first: Array, second: Array, fitting: Fitting, enter: str
) -> tuple[Array, float]:
    """Return the mean of two directions (3,) of a fitting, and the angle between them, rad."""
    if isinstance(fitting, Tee) and enter == "branch" and first @ second < 0:
        first = -first  # From there a tee looks the same from both sides.
    apart = float(angle_between(first, second))
    return (unit(first + second) if apart < math.pi / 2 else second), apart


def _turn_to(axis: Array, one: Array, other: Array) -> float:
    """Return the angle, rad, by which one direction has to turn to lie beside another.

    ``one`` (3,) turns about ``axis`` (3,) into the half-plane of ``other`` (3,).
    """
    cross = np.cross(axis, one)
    return math.atan2(float(other @ cross), float(other @ np.cross(cross, axis)))
