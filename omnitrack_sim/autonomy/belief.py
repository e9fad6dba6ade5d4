"""Map that a robot makes of an unknown network.

The pose of each fitting follows from the joint by which it was attached, and the length of each
straight is measured between its ends, so an error of the robot's position leaves no gap in the map.
Loops are closed in ``loop_closure``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import takewhile
from typing import Literal

from omnitrack_sim.base.rotations import Array, Pose, frame_along, wrap_angle
from omnitrack_sim.pipes import Elbow, Fitting, Part, Port, Straight
from omnitrack_sim.pipes.map_difference import LENGTHS, MIN_LENGTH
from omnitrack_sim.pipes.network import Joint, Network, Origin, both_ways


@dataclass(frozen=True)
class BeliefSettings:
    """Tolerances of a robot's map.

    Attributes:
        min_length: m, of a straight.
        min_straight: m, gap between two fittings up to which they are joined without a straight:
            nobody welds closer than about half a bore.
        error: m, of a sighting out of a fitting: there a longer gap that is closed is in doubt, and
            an end is looked at once more from that much farther off.
        angle_std: rad, standard deviation of the angle of a bend: 25 measured with the depth camera
            were off by 0.3 degrees, at most by 0.75.
        turn_std: rad, standard deviation of a fitting's turn about the pipe before it.
        certain: standard deviations by which a size may be off.
        digits: decimals that are kept of lengths in m and, less one, of angles in degrees.
    """

    min_length: float = 1e-3
    min_straight: float = 0.07
    error: float = 0.03
    angle_std: float = math.radians(0.4)
    turn_std: float = math.radians(0.7)
    certain: float = 2.0
    digits: int = 6

    @property
    def kept_angle_std(self) -> float:
        """Standard deviation of a bend's angle that a map keeps as it agrees with another, rad."""
        # It may be off by any part of what it may differ by.
        return math.hypot(self.angle_std, self.angle_std / math.sqrt(3))

    @property
    def resolution(self) -> float:
        """Least difference of two lengths that a map keeps, m."""
        return 10.0**-self.digits


BELIEF = BeliefSettings()

EndState = Literal["open", "closed", "impassable"]
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
        self._names: list[str] = []
        self._fittings: list[Fitting] = []
        self._joints: list[
            tuple[Port, Port, float]
        ] = []  # a port, what was attached there, turn_deg
        self._counts: dict[str, int] = {}
        self.ends: dict[Port, EndState] = {}
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
            joints = [
                Joint(ports=(self.name(end), self.name(other)), turn_deg=turn)
                for end, other, turn in self._joints
            ]
            fittings = dict(zip(self._names, self._fittings, strict=True))
            self._network = Network.believed(
                "map", self._place, fittings, joints, self._named_ends()
            )
        return self._network

    @property
    def joined(self) -> dict[Port, Port]:
        """The port that each port is joined to."""
        return both_ways((end, other) for end, other, _ in self._joints)

    @property
    def unexplored(self) -> list[Port]:
        """Ports that have not been looked into, the latest first, and of a fitting its branch."""
        return [end for end in self._free_ports()[::-1] if end not in self.explored]

    def _free_ports(self) -> list[Port]:
        """Return the ports, other than the start, that nothing is joined to."""
        joined = self.joined
        every = [(i, port) for i, one in enumerate(self._fittings) for port in one.port_names]
        return [end for end in every if end not in joined and end != self.start]

    def reliable_parts(self) -> tuple[list[Part], list[Port], list[Port]]:
        """Return the part of the map that pictures may be compared with.

        Returns:
            Reliable parts, those of their ports that are closed, and those beyond which nothing is
            known. Numbers are those of the parts returned.
        """
        parts, joined = list(self.network.pipes.parts), self.joined
        closed = [end for end, state in self.ends.items() if state == "closed"]
        seen = ("open", "closed")
        unknown = [end for end in self._free_ports() if self.ends.get(end) not in seen]
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
        return f"{self._names[end[0]]}.{end[1]}"

    def part_name(self, part: int) -> str:
        """Name of a part."""
        return self._names[part]

    def fitting(self, part: int) -> Fitting:
        """The fitting of a part."""
        return self._fittings[part]

    def bore(self, end: Port) -> float:
        """The bore at a port, m."""
        return 2 * self._fittings[end[0]].port_radius(end[1])

    def port(self, end: Port) -> Pose:
        """A port in the world, z outward."""
        return self.network.pipes.parts[end[0]].port(end[1])

    def attached_to(self, part: int) -> tuple[Port, Port] | None:
        """Return the port that a part was attached to and its own one there; None of the first."""
        # What is attached is the second of two; a loop is closed later.
        joints = ((end, other) for end, other, _ in self._joints)
        return next((ports for ports in joints if ports[1][0] == part), None)

    def joint(self, end: Port) -> tuple[Port, Port] | None:
        """Return the ports of the joint at a port, the one that was there first.

        None without one.
        """
        joints = ((one, other) for one, other, _ in self._joints)
        return next((ports for ports in joints if end in ports), None)

    def parts_beyond(self, end: Port) -> set[int]:
        """Return the parts that a port leads to, on any way but back through its own part.

        With that part where a loop leads to it.
        """
        joined, found, new = self.joined, set[int](), [end]
        while new:
            other = joined.get(new.pop())
            if other is None or other[0] in found:
                continue
            found.add(other[0])
            ports = self.fitting(other[0]).port_names
            new += [(other[0], port) for port in ports if port != other[1]]
        return found

    def is_leaf(self, part: int) -> bool:
        """Return whether nothing hangs on a part."""
        return sum(end[0] == part for end in self.joined) == (part > 0)

    def is_removable(self, part: int) -> bool:
        """Return whether a part is the latest, not the only one, and nothing hangs on it."""
        return part > 0 and part == len(self._fittings) - 1 and self.is_leaf(part)

    def doubtful_sizes(self) -> dict[str, str]:
        """Return why sizes may be off by more than those of two equal maps, by names of parts."""
        found, joined = dict[str, str](), self.joined
        for i, (name, fitting) in enumerate(zip(self._names, self._fittings, strict=True)):
            stds = self.stds.get(name, {})
            found[name] = doubtful_sizes(fitting, stds)
            # Pipe whose end has not been seen may be longer; a loop may have closed there.
            within = all((i, port) in joined or (i, port) == self.start for port in fitting.ports)
            if fitting.is_plain and within and "length" not in stds:
                found[name] = "its length has not been measured"
        return {name: why for name, why in found.items() if why}

    def next_name(self, fitting: Fitting) -> str:
        """Return the name that a new fitting gets."""
        return f"{fitting.kind}_{self._counts.get(fitting.kind, 0) + 1}"

    # Changes of parts

    def lengthen(self, part: int, more: float) -> float:
        """Make a straight ``more`` m longer; return its new length, m."""
        fitting = self._fittings[part]
        assert isinstance(fitting, Straight)
        length = max(round(fitting.length + more, BELIEF.digits), BELIEF.min_length)
        self.resize(part, length=length)
        return length

    def resize(self, part: int, **sizes: float) -> None:
        """Change sizes of a fitting, by keys of its constructor in SI units.

        What they were measured to holds no more.
        """
        self._fittings[part] = replace(self._fittings[part], **sizes)  # type: ignore[type-var]
        self._network = None
        for key in sizes:
            self.stds.get(self._names[part], {}).pop(key, None)

    def set_stds(self, part: int, **stds: float) -> None:
        """Note the standard deviations of measured sizes of a part, m and rad."""
        self.stds.setdefault(self._names[part], {}).update(
            {key: round(std, BELIEF.digits) for key, std in stds.items()}
        )

    def replace_part(self, part: int, fitting: Fitting) -> str:
        """Put another fitting with the same ports in the place of a part.

        Of what was measured stays what is a size of the other one too. Returns its name, which is
        another one where the kind is.
        """
        if fitting.kind != self._fittings[part].kind:
            sizes = {field.name for field in fields(fitting)}  # type: ignore[arg-type]
            stds = self.stds.pop(self._names[part], {})
            self._names[part] = self._new_name(fitting)
            if kept := {key: std for key, std in stds.items() if key in sizes}:
                self.set_stds(part, **kept)
        self._fittings[part], self._network = fitting, None
        return self._names[part]

    def rotate_joint(self, end: Port, more: float) -> None:
        """Turn what was attached to a port, and all that hangs on it, about the port's axis.

        By ``more`` rad.
        """
        (number,) = (i for i, joint in enumerate(self._joints) if end in joint[:2])
        one, other, turn_deg = self._joints[number]
        self._joints[number] = one, other, _rounded_turn(turn_deg + math.degrees(more))
        self._network = None

    def remove(self, part: int) -> None:
        """Remove a part that ``is_removable``."""
        name, kind = self._names[part], self._fittings[part].kind
        self.stds.pop(name, None)
        # A part before it has a later name where it has taken the place of another kind.
        self._counts[kind] -= name == f"{kind}_{self._counts[kind]}"
        del self._names[part], self._fittings[part], self._joints[-1]
        self._network = None

    def attach_straight(self, end: Port, length: float) -> int:
        """Join a straight of ``length`` m to a port; return its index."""
        length = max(round(length, BELIEF.digits), BELIEF.min_length)
        part = self._add(Straight(length, self.bore(end)))
        self.join(end, (part, "start"), 0.0)
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
        self.join(end, (part, enter), turn)
        return part

    def join(self, end: Port, other: Port, turn_deg: float) -> None:
        """Join two ports that lie in one place."""
        self._joints.append((end, other, _rounded_turn(turn_deg)))
        self._network = None

    # Changes of what is known of ends

    def set_provisional(self, part: int | None) -> None:
        """Set the straight whose end is provisional; None: the whole map is reliable."""
        if part != self.provisional:
            self.provisional, self._network = part, None

    def remove_provisional(self) -> list[int]:
        """Remove the parts and the state observed at the provisional end.

        That is provisional no more. Returns the parts, the latest first.
        """
        assert self.provisional is not None
        end = self.provisional, "end"
        beyond, _ = self.joined.get(end, (len(self._fittings), ""))
        removed = []
        for part in takewhile(self.is_removable, range(len(self._fittings) - 1, beyond - 1, -1)):
            self.remove(part)
            removed.append(part)
        self.ends.pop(end, None)
        self.set_provisional(None)
        return removed

    def set_end(self, end: Port, state: EndState) -> None:
        """Note the state of a port that nothing follows."""
        self.ends[end] = state
        self._network = None

    def set_explored(self, end: Port, goal: str = "") -> None:
        """Mark a port as inspected, or as given up; ``goal``: name of the one that is there."""
        self.explored.add(end)
        if goal:
            self.goals[end] = goal
        self._network = None

    def set_unexplored(self, end: Port) -> None:
        """Mark a port as unexplored again."""
        self.explored.discard(end)
        self.ends.pop(end, None)
        self._network = None

    def _add(self, fitting: Fitting) -> int:
        self._names.append(self._new_name(fitting))
        self._fittings.append(fitting)
        self._network = None
        return len(self._fittings) - 1

    def _new_name(self, fitting: Fitting) -> str:
        name = self.next_name(fitting)
        self._counts[fitting.kind] = self._counts.get(fitting.kind, 0) + 1
        return name

    def _named_ends(self) -> dict[str, str]:
        """Names of the ports that nothing is joined to: what is known of each."""
        counts: dict[str, int] = {}
        named = {"start": self.name(self.start)}
        for end in self._free_ports():
            word = self.ends.get(end, "") if end in self.explored else ""
            word = "goal" if end in self.goals else word or "unexplored"
            counts[word] = counts.get(word, 0) + 1
            goal = self.goals.get(end, "")
            # A name with a dot is a port of the true network, which means nothing on this map.
            plain = goal and "." not in goal and goal not in named
            named[goal if plain else f"{word}_{counts[word]}"] = self.name(end)
        return named


def _rounded_turn(turn_deg: float) -> float:
    """Return the turn of a joint, degrees, from -180 to 180, to the digits that a map keeps."""
    return round(float(wrap_angle(turn_deg, 360.0)), BELIEF.digits - 1) + 0.0


def doubtful_sizes(fitting: Fitting, stds: Mapping[str, float]) -> str:
    """Return which lengths and bores of a fitting may be off by more than those of two equal maps.

    Args:
        fitting: the fitting.
        stds: standard deviations that its sizes were measured to, m and rad, by their keys.

    Returns:
        A text; "" where none may be.
    """
    length, off = fitting.length_of_axes, dict[str, float]()
    if isinstance(fitting, Elbow):
        along = fitting.angle * stds.get("mean_radius", 0.0)
        std = math.hypot(along, fitting.mean_radius * stds.get("angle", 0.0))
    else:
        std = stds.get("length", 0.0)
    if BELIEF.certain * std > max(LENGTHS * length, MIN_LENGTH):
        off["length"] = BELIEF.certain * std
    for port in fitting.port_names:
        std = stds.get(fitting.bore_key(port), 0.0)
        if BELIEF.certain * std > LENGTHS * 2 * fitting.port_radius(port):
            off["bore"] = BELIEF.certain * std
    return ", ".join(f"its {size} may be off by {1000 * by:.0f} mm" for size, by in off.items())


def are_alike(fitting: Fitting, port: str, other: str) -> bool:
    """Return whether two ports of a fitting may be the same one: both on its run, or not."""
    one, two = (
        fitting.describe(name, next(port for port in fitting.port_names if port != name))
        for name in (port, other)
    )
    return one == two
