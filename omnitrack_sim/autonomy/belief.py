"""Map that a robot makes of an unknown network.

The pose of each fitting follows from the joint that it hangs on, and the length of each straight is
measured between its ends, so an error of the robot's position leaves no gap in the map. Where a
loop closes, its lengths, angles and turns are adjusted by least squares, weighted by their standard
deviations, so that its ends meet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from typing import Literal

import numpy as np

from omnitrack_sim.base.rotations import (
    Array,
    Pose,
    angle_between,
    frame_along,
    unit,
    wrap_angle,
)
from omnitrack_sim.pipes import Elbow, Fitting, Part, Port, Straight
from omnitrack_sim.pipes.map_difference import LEAST_LENGTH, LENGTHS
from omnitrack_sim.pipes.network import CLOSES, Joint, Network, Origin, both_ways
from omnitrack_sim.pipes.planning import port_graph


@dataclass(frozen=True)
class BeliefSettings:
    """Tolerances of a robot's map.

    Attributes:
        shortest: m, least length of a straight.
        least_straight: m, gap between two fittings up to which they are joined without a straight:
            nobody welds closer than about half a bore.
        error: m, of a sighting out of a fitting: there a longer gap that is closed is in doubt.
        miss: m, by which the two ends of a loop may miss each other.
        miss_share: the same in addition, as a part of the loop's length.
        miss_angle: rad, by which their directions may miss being opposite.
        length_std: m, standard deviation of the length of a straight that is not measured, and
        length_share: the same in addition, as a part of the length.
        angle_std: rad, standard deviation of the angle of a bend: 25 measured with the depth camera
            were off by 0.3 degrees, at most by 0.75.
        turn_std: rad, standard deviation of a fitting's turn about the pipe before it.
        certain: standard deviations by which a size may be off.
        loop: squared standard deviations by which the two ends of a loop may miss each other in
            position and direction, six numbers: 99 of 100 loops do not miss by more.
        closing_std: m and rad, standard deviation of what two ports that meet are apart.
        adjustments: steps of the search for the changes that close a loop.
        digits: decimals that are kept of lengths in m and, less one, of angles in degrees.
    """

    shortest: float = 1e-3
    least_straight: float = 0.07
    error: float = 0.03
    miss: float = 0.1
    miss_share: float = 0.02
    miss_angle: float = math.radians(10)
    length_std: float = 0.003
    length_share: float = 0.01
    angle_std: float = math.radians(0.4)
    turn_std: float = math.radians(0.7)
    certain: float = 2.0
    loop: float = 16.8
    closing_std: float = 1e-3
    adjustments: int = 3
    digits: int = 6


BELIEF = BeliefSettings()


Noted = Literal["open", "closed", "impassable"]
"""State of an end: open, closed, or out of the robot's reach."""


class Belief:
    """The map of one robot.

    Args:
        port: where the robot began, z into the pipe.
        bore: m.
        length: m, of the first pipe as far as it is known to be free.

    Attributes:
        ends: observed state of ports that nothing follows.
        explored: of these ports, those that have been inspected, or cannot be.
        goals: names of goals by the ports where they are.
        start: the port where it began.
        stds: standard deviations of sizes that the robot has measured, m and rad, by the names of
            their parts and the keys of their constructors.
        provisional: a straight whose end has only been observed from afar: kind and position of
            what is there may be wrong; None where there is none.
    """

    def __init__(self, port: Pose, bore: float, length: float) -> None:
        x, y, z = port.rotation[:, 2].tolist()
        px, py, pz = port.position.tolist()
        # The turn from what a file takes for x to the port's own.
        right, up, _ = port.rotation[:, 0] @ frame_along((x, y, z), 0.0)
        turn = round(math.degrees(math.atan2(up, right)), BELIEF.digits) + 0.0
        self._place = Origin(axis=(x, y, z), turn_deg=turn, position=(px, py, pz))
        self._fittings: dict[str, Fitting] = {}
        self._joints: list[Joint] = []
        self._counts: dict[str, int] = {}
        self.ends: dict[Port, Noted] = {}
        self.explored: set[Port] = set()
        self.goals: dict[Port, str] = {}
        self.stds: dict[str, dict[str, float]] = {}
        self.provisional: int | None = None
        self._network: Network | None = None
        self._add(Straight(length, bore))
        self.start: Port = (0, "start")

    # Contents

    @property
    def network(self) -> Network:
        """The map as a network, which may contradict itself."""
        if self._network is None:
            self._network = Network.believed(
                "map", self._place, self._fittings, self._joints, self._named()
            )
        return self._network

    @property
    def joined(self) -> dict[Port, Port]:
        """The port that each port is joined to."""
        index = {name: i for i, name in enumerate(self._fittings)}

        def end(port: str) -> Port:
            part, _, name = port.partition(".")
            return index[part], name

        return both_ways((end(a), end(b)) for a, b in (joint.ports for joint in self._joints))

    @property
    def unexplored(self) -> list[Port]:
        """Ports that have not been looked into, the latest first, and of a fitting its branch."""
        return [end for end in self._free()[::-1] if end not in self.explored]

    def _free(self) -> list[Port]:
        """Return the ports, other than the start, that nothing is joined to."""
        joined, parts = self.joined, enumerate(self._fittings.values())
        every = [(i, port) for i, fitting in parts for port in fitting.port_names]
        return [end for end in every if end not in joined and end != self.start]

    def compared(self) -> tuple[list[Part], list[Port], list[Port]]:
        """Return the part of the map that pictures may be compared with: reliable parts, those of
        their ports that are closed, and those beyond which nothing is known. Numbers are those of
        the parts returned."""
        parts, joined = list(self.network.pipes.parts), self.joined
        closed = [end for end, state in self.ends.items() if state == "closed"]
        unknown = [end for end in self._free() if self.ends.get(end) not in ("open", "closed")]
        if self.provisional is not None:
            end = self.provisional, "end"
            beyond = joined.get(end)
            if beyond is not None and beyond[0] == len(parts) - 1:
                parts.pop()
                unknown = [other for other in unknown if other[0] != beyond[0]]
            closed = [other for other in closed if other != end]
            unknown = [*unknown, end] if end not in unknown else unknown
        return parts, closed, unknown

    def name(self, end: Port) -> str:
        """``part.port`` of a port."""
        return f"{self.part_name(end[0])}.{end[1]}"

    def part_name(self, part: int) -> str:
        """Name of a part."""
        return list(self._fittings)[part]

    def fitting(self, part: int) -> Fitting:
        """The fitting of a part."""
        return list(self._fittings.values())[part]

    def port(self, end: Port) -> Pose:
        """A port in the world, z outward."""
        return self.network.pipes.parts[end[0]].port(end[1])

    # Changes

    def lengthen(self, part: int, more: float) -> float:
        """Make a straight ``more`` m longer; return its new length, m."""
        name, fitting = list(self._fittings.items())[part]
        assert isinstance(fitting, Straight)
        length = max(round(fitting.length + more, BELIEF.digits), BELIEF.shortest)
        self._set(name, replace(fitting, length=length))
        self.stds.get(name, {}).pop("length", None)
        return length

    def resize(self, part: int, **sizes: float) -> None:
        """Change sizes of a fitting, by keys of its constructor in SI units."""
        name, fitting = list(self._fittings.items())[part]
        self._set(name, replace(fitting, **sizes))  # type: ignore[type-var]
        for key in sizes:
            self.stds.get(name, {}).pop(key, None)

    def put(self, part: int, fitting: Fitting) -> str:
        """Put another fitting in the place of a part, with the same ports; return its name, which
        is another one where the kind is."""
        old, new = self.part_name(part), self.part_name(part)
        if fitting.kind != self.fitting(part).kind:
            new = self.next_name(fitting)
            self._counts[fitting.kind] = self._counts.get(fitting.kind, 0) + 1

        def renamed(port: str) -> str:
            name, dot, end = port.partition(".")
            return f"{new if name == old else name}{dot}{end}"

        every = self._fittings.items()
        self._fittings = {new if name == old else name: one for name, one in every}
        self._joints = [
            joint.model_copy(update={"ports": (renamed(joint.ports[0]), renamed(joint.ports[1]))})
            for joint in self._joints
        ]
        self.stds = {new if name == old else name: stds for name, stds in self.stds.items()}
        self._set(new, fitting)
        return new

    def hangs_on(self, part: int) -> tuple[Port, Port] | None:
        """Return the port that a part was attached to and its own one there; None of the first."""
        joint = self._joint_of(part)
        if joint is None:
            return None
        index = {name: i for i, name in enumerate(self._fittings)}
        (one, _, port), (_, _, own) = (end.partition(".") for end in self._joints[joint].ports)
        return (index[one], port), (part, own)

    def _joint_of(self, part: int) -> int | None:
        """Return the number of the joint by which a part was attached; None of the first part."""
        # What is attached is the second of two; a loop is closed later.
        names = [joint.ports[1].partition(".")[0] for joint in self._joints]
        name = self.part_name(part)
        return names.index(name) if name in names else None

    def turn(self, part: int, more: float) -> None:
        """Turn a part, and what hangs on it, by ``more`` rad about the pipe that it was attached
        to, whose axis leads to it."""
        joint = self._joint_of(part)
        assert joint is not None
        self._turn(joint, more)

    def beyond(self, end: Port) -> set[int]:
        """Return the parts that a port leads to, on any way but back through its own part; with
        that part where a loop leads to it."""
        joined, found, new = self.joined, set[int](), [end]
        while new:
            other = joined.get(new.pop())
            if other is None or other[0] in found:
                continue
            found.add(other[0])
            ports = self.fitting(other[0]).port_names
            new += [(other[0], port) for port in ports if port != other[1]]
        return found

    def measured(self, part: int, **stds: float) -> None:
        """Note the standard deviations of measured sizes of a part, m and rad, which hold until
        these sizes change."""
        self.stds.setdefault(self.part_name(part), {}).update(
            {key: round(std, BELIEF.digits) for key, std in stds.items()}
        )

    def unsure(self) -> dict[str, str]:
        """Return why sizes may be off by more than those of two equal maps, by the names of their
        parts."""
        found, joined = dict[str, str](), self.joined
        for i, (name, fitting) in enumerate(self._fittings.items()):
            stds = self.stds.get(name, {})
            found[name] = unsure(fitting, stds)
            # Pipe whose end has not been seen may be longer; a loop may have closed there.
            within = all((i, port) in joined or (i, port) == self.start for port in fitting.ports)
            if fitting.is_plain and within and "length" not in stds:
                found[name] = "its length has not been measured"
        return {name: why for name, why in found.items() if why}

    def is_last(self, part: int) -> bool:
        """Return whether nothing hangs on a part."""
        return sum(end[0] == part for end in self.joined) == (part > 0)

    def drop(self, part: int) -> bool:
        """Remove a part, if it is the latest, not the only one, and nothing hangs on it; return
        whether it is removed."""
        if part == 0 or part != len(self._fittings) - 1 or not self.is_last(part):
            return False
        kind = self.fitting(part).kind
        self.stds.pop(self.part_name(part), None)
        del self._fittings[self.part_name(part)], self._joints[-1]
        self._counts[kind] -= 1
        self._network = None
        return True

    def straight_beyond(self, end: Port, length: float) -> int:
        """Join a straight of ``length`` m to a port; return its index."""
        bore = 2 * self.fitting(end[0]).port_radius(end[1])
        part = self._add(Straight(max(round(length, BELIEF.digits), BELIEF.shortest), bore))
        self._join(end, (part, "start"), 0.0)
        return part

    def attach(self, end: Port, fitting: Fitting, enter: str, side: Array) -> int:
        """Join a fitting to a port; return its index.

        Args:
            end: the port.
            fitting: as observed.
            enter: its port there.
            side: (3,) direction of the x axis of that port, world frame.
        """
        x, y, _ = side @ self.port(end).rotation
        turn = 0.0 if fitting.is_axial else math.degrees(math.atan2(y, x))
        part = self._add(fitting)
        self._join(end, (part, enter), turn)
        return part

    def known_at(self, end: Port, fitting: Fitting, enter: str) -> Port | None:
        """Return the free port of a known fitting that agrees with one observed at a port, in kind
        and position; None where there is none."""
        places = [
            (miss, other)
            for miss, other in self._near(end)
            if self.fitting(other[0]).kind == fitting.kind and alike(fitting, enter, other[1])
        ]
        return min(places, default=(0.0, None))[1]

    def meeting(self, part: int) -> list[tuple[Port, Port]]:
        """Return pairs of an unexplored port of a new part and another one at the same position."""
        free = [end for end in self.unexplored if end[0] == part]
        pairs = [(end, min(self._near(end), default=(0.0, None))[1]) for end in free]
        return [(end, other) for end, other in pairs if other is not None]

    def close(self, end: Port, other: Port) -> tuple[float, bool]:
        """Join two ports at which a loop closes; return their distance before, m, and whether that
        is more than the sizes and turns around the loop may be off by."""
        miss, surprise = float(np.linalg.norm(self._gap(end, other)[:3])), 0.0
        if miss > CLOSES / 2:
            sizes = self._measured_sizes()
            surprise = self._adjust(end, other)
            self._doubt_moved(sizes)
        a, b = self.port(end), self.port(other)
        # Both joints lie where they are; the turn is what is between their x axes.
        x, y, _ = b.rotation[:, 0] @ a.rotation
        self._join(end, other, math.degrees(math.atan2(y, x)))
        return miss, surprise > BELIEF.loop

    def settle(self, part: int | None = None) -> None:
        """Set the straight whose end is provisional; None: the whole map is reliable."""
        if part != self.provisional:
            self.provisional, self._network = part, None

    def take_back(self, part: int) -> list[int]:
        """Remove the parts and the state observed at the provisional end of a straight; return the
        parts."""
        end = part, "end"
        beyond, _ = self.joined.get(end, (len(self._fittings), ""))
        parts = range(len(self._fittings) - 1, beyond - 1, -1)
        removed = list(takewhile(self.drop, parts))
        self.ends.pop(end, None)
        self.settle()
        return removed

    def note(self, end: Port, noted: Noted) -> None:
        """Note the state of a port that nothing follows."""
        self.ends[end] = noted
        self._network = None

    def done(self, end: Port, goal: str = "") -> None:
        """Mark a port as inspected, or as given up; ``goal``: name of the one that is there."""
        self.explored.add(end)
        if goal:
            self.goals[end] = goal
        self._network = None

    def reopen(self, end: Port) -> None:
        """Mark a port as unexplored again."""
        self.explored.discard(end)
        self.ends.pop(end, None)
        self._network = None

    def _near(self, end: Port) -> Iterator[tuple[float, Port]]:
        """Yield unexplored ports of other parts that may be the same as ``end``, with their
        distances, m."""
        here = self.port(end)
        for other in self.unexplored:
            if other[0] == end[0]:
                continue
            there = self.port(other)
            miss = float(np.linalg.norm(there.position - here.position))
            # The error of the position grows with the way around the loop.
            around = sum(length for *_, length in self._loop(end, other))
            if miss > BELIEF.miss + BELIEF.miss_share * around:
                continue
            if (
                float(angle_between(here.rotation[:, 2], -there.rotation[:, 2]))
                <= BELIEF.miss_angle
            ):
                yield miss, other

    def _loop(self, end: Port, other: Port) -> list[tuple[int, str, str, float]]:
        """The parts from one port to another, with the ports between which they are passed and
        their lengths, m."""
        import networkx

        graph = port_graph(self.network)
        ports = networkx.shortest_path(graph, other, end, weight="length")
        steps = zip(ports[::2], ports[1::2], strict=True)
        return [(a[0], a[1], b[1], graph.edges[a, b]["length"]) for a, b in steps]

    def _gap(self, end: Port, other: Port) -> Array:
        """Return what two ports (6,) are apart that meet, m and rad."""
        here, there = self.port(end), self.port(other)
        turned = np.cross(here.rotation[:, 2], -there.rotation[:, 2])
        return np.concatenate([there.position - here.position, turned])

    def _adjust(self, end: Port, other: Port) -> float:
        """Adjust a loop by weighted least squares so that its ends ``end`` and ``other`` meet;
        return the squared standard deviations by which they missed."""
        total, surprise = np.zeros(len(self._variables(end, other))), 0.0
        for step in range(BELIEF.adjustments):
            variables = self._variables(end, other)
            std, slope = (np.array([each[i] for each in variables]) for i in (0, 1))
            # Gauss and Newton's step: the most probable changes of what was measured.
            gap, spread = self._gap(end, other), std[:, None] * slope
            both = spread.T @ spread + BELIEF.closing_std**2 * np.eye(len(gap))
            wanted = std * (spread @ np.linalg.solve(both, gap + total @ slope))
            if step == 0:
                surprise = float(gap @ np.linalg.solve(both, gap))
            for (_, _, change), more in zip(variables, (wanted - total).tolist(), strict=True):
                change(more)
            total = wanted
        return surprise

    def _measured_sizes(self) -> list[tuple[str, str, float, float]]:
        """Return names of parts, and keys, values and standard deviations of sizes measured."""
        return [
            (name, key, getattr(self._fittings[name], key), std)
            for name, stds in self.stds.items()
            for key, std in stds.items()
        ]

    def _doubt_moved(self, before: list[tuple[str, str, float, float]]) -> None:
        """Hold sizes that were other ones ``before`` to be off by as much as they have changed."""
        for name, key, size, std in before:
            moved = round(abs(getattr(self._fittings[name], key) - size), BELIEF.digits)
            self.stds[name][key] = max(std, moved)

    def _variables(
        self, end: Port, other: Port
    ) -> list[tuple[float, Array, Callable[[float], object]]]:
        """Return the variables of a loop from ``other`` to ``end``, m or rad: for each its standard
        deviation, the derivative (6,) of the position and rotation of ``end``, and a function that
        adds to it."""
        parts, at = self.network.pipes.parts, self.port(end).position
        joints = {port: i for i, joint in enumerate(self._joints) for port in joint.ports}

        def swing(axis: Array, centre: Array) -> Array:
            return np.concatenate([np.cross(axis, at - centre), axis])

        found: list[tuple[float, Array, Callable[[float], object]]] = []
        for part, enter, leave, length in self._loop(end, other):
            fitting, came, left = parts[part].fitting, *map(parts[part].port, (enter, leave))
            ahead, measured = left.rotation[:, 2], self.stds.get(parts[part].name, {})
            if fitting.is_plain:
                std = measured.get("length", 0.0)
                std = std or BELIEF.length_std + BELIEF.length_share * length
                along = np.concatenate([ahead, np.zeros(3)])
                found.append((std, along, partial(self.lengthen, part)))
            elif isinstance(fitting, Elbow):
                before = -came.rotation[:, 2]
                inwards = unit(ahead - before * (before @ ahead))
                middle = came.position + fitting.mean_radius * inwards
                about = swing(np.cross(before, inwards), middle)
                std = measured.get("angle", 0.0) or BELIEF.angle_std
                found.append((std, about, partial(self._bend, part)))
            joint = joints.get(self.name((part, leave)))
            # What hangs on a joint is its second port; of a round fitting the turn means nothing.
            if joint is not None and not self._is_round(self._joints[joint].ports[1]):
                about = swing(ahead, left.position)
                found.append((BELIEF.turn_std, about, partial(self._turn, joint)))
        return found

    def _is_round(self, port: str) -> bool:
        return self._fittings[port.partition(".")[0]].is_axial

    def _bend(self, part: int, more: float) -> None:
        elbow = self.fitting(part)
        assert isinstance(elbow, Elbow)
        self.resize(part, angle=elbow.angle + more)

    def _turn(self, number: int, more: float) -> None:
        joint = self._joints[number]
        self._joints[number] = self._joint(*joint.ports, joint.turn_deg + math.degrees(more))
        self._network = None

    def next_name(self, fitting: Fitting) -> str:
        """Return the name that a new fitting gets."""
        return f"{fitting.kind}_{self._counts.get(fitting.kind, 0) + 1}"

    def _add(self, fitting: Fitting) -> int:
        name = self.next_name(fitting)
        self._counts[fitting.kind] = self._counts.get(fitting.kind, 0) + 1
        self._set(name, fitting)
        return len(self._fittings) - 1

    def _set(self, name: str, fitting: Fitting) -> None:
        self._fittings[name] = fitting
        self._network = None

    def _join(self, end: Port, other: Port, turn_deg: float) -> None:
        self._joints.append(self._joint(self.name(end), self.name(other), turn_deg))
        self._network = None

    @staticmethod
    def _joint(port: str, other: str, turn_deg: float) -> Joint:
        turn = round(float(wrap_angle(turn_deg, 360.0)), BELIEF.digits - 1) + 0.0
        return Joint(ports=(port, other), turn_deg=turn)

    def _named(self) -> dict[str, str]:
        """Names of the ports that nothing is joined to: what is known of each."""
        counts: dict[str, int] = {}
        named = {"start": self.name(self.start)}
        for end in self._free():
            word = self.ends.get(end, "") if end in self.explored else ""
            word = "goal" if end in self.goals else word or "unexplored"
            counts[word] = counts.get(word, 0) + 1
            goal = self.goals.get(end, "")
            # A name with a dot is a port of the true network, which means nothing on this map.
            plain = goal and "." not in goal and goal not in named
            named[goal if plain else f"{word}_{counts[word]}"] = self.name(end)
        return named


def unsure(fitting: Fitting, stds: Mapping[str, float]) -> str:
    """Return which of the lengths and bores of a fitting, measured to ``stds``, may be off by more
    than those of two equal maps; "" for none."""
    length, most = fitting.length_of_axes, dict[str, float]()
    if isinstance(fitting, Elbow):
        along = fitting.angle * stds.get("mean_radius", 0.0)
        std = math.hypot(along, fitting.mean_radius * stds.get("angle", 0.0))
    else:
        std = stds.get("length", 0.0)
    if BELIEF.certain * std > max(LENGTHS * length, LEAST_LENGTH):
        most["length"] = BELIEF.certain * std
    for port in fitting.port_names:
        std = stds.get(fitting.bore_key(port), 0.0)
        if BELIEF.certain * std > LENGTHS * 2 * fitting.port_radius(port):
            most["bore"] = BELIEF.certain * std
    return ", ".join(f"its {size} may be off by {1000 * off:.0f} mm" for size, off in most.items())


def alike(fitting: Fitting, enter: str, port: str) -> bool:
    """Return whether two ports of fittings of a kind may be the same: both on the run, or not."""
    one, other = (
        fitting.describe(name, next(other for other in fitting.port_names if other != name))
        for name in (enter, port)
    )
    return one == other
