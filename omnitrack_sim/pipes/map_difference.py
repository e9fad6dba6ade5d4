"""Differences between a map that a robot has made and the true network.

Both are walked together from where the map begins. Kinds, lengths of axes, bores, directions of
ports, and whether an end is open or closed are compared; names, the order of parts, and which of
two like ports is called what, do not count. Straights that follow each other are one: a robot sees
no joint.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np

from omnitrack_sim.base.rotations import Array, Pose, angle_between, frame_of, length, unit
from omnitrack_sim.pipes import ARCS, Fitting, Port
from omnitrack_sim.pipes.network import Network, both_ways, connected

LENGTHS = 0.03
"""Difference of two lengths or bores that are the same, as a part of the true one."""
MIN_LENGTH = 0.01
"""Difference of two lengths that are the same whatever the true one is, m."""
ANGLES = math.radians(5)
"""Difference of two directions that are the same, rad."""
CLAIM = re.compile("(open|closed)_[0-9]+")
"""Names that a robot gives the ends of its map which it has inspected."""


SHOWN = {
    "straight": ("length",),
    "elbow": ("mean_radius", "angle"),
    "wye": ("angle",),
    "reducer": ("length", "inner_diameter", "end_diameter"),
}
"""Sizes of each kind that a robot can measure; it takes others to be as usual, and bores to be
those of the pipe before."""


class MapSize(NamedTuple):
    """One size of a part of a map.

    Attributes:
        part: of the map. true: that of the network which it stands for; "" for none. Both as in
            ``MapDifference``.
        key: the size: a length, diameter or radius in m, or an angle in rad.
        value: on the map.
        std: standard deviation that the robot gives it, m or rad; None where it has not measured
            it, such as a pipe whose end it has not seen: that is as long as known to be free.
        error: of ``value``, m or rad; None without a true part.

    Example:
        >>> size = ot.MapSize("straight_1", "inlet", "length", 0.5002, 0.0015, 0.0002)
        >>> abs(size.error) < 2 * size.std
        True
    """

    part: str
    true: str
    key: str
    value: float
    std: float | None
    error: float | None

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Return texts of unit, value, standard deviation and error, in mm or degrees.

        Two figures of the standard deviation, or else of the error, are shown.
        """
        unit, scale = ("deg", 180 / math.pi) if self.key == "angle" else ("mm", 1000.0)
        doubt = abs(scale * (self.std or self.error or 0.0))
        digits = min(max(1 - math.floor(math.log10(doubt)), 0), 3) if doubt > 0 else 3

        def text(x: float | None) -> str:
            return "-" if x is None else f"{scale * x:.{digits}f}"

        return unit, text(self.value), text(self.std), text(self.error)


@dataclass(frozen=True)
class MapDifference:
    """Parts of a network that a map has, lacks or has wrong.

    Parts are given by their names, straights in a row by that of the first.

    Attributes:
        parts: number of parts of the network that can be reached from where the map begins.
        found: number of them that the map has, with the right kind.
        missing: those that it has not. extra: parts of the map that the network has not.
        kinds, wrong_sizes, angles: parts of the map and the true ones that differ in kind, in a
            bore by more than 3 %, in a length by more than 3 % and 10 mm, in the direction of a
            port's axis by more than 5 degrees.
        loose: ports of the network that are joined there and not in the map, though it has both
            parts.
        length: m, of all axes of the network that are in the map. length_error: m, of what is wrong
            in them, sizes added up.
        sizes: of the parts of the map, in its order, with how sure the robot is of them.
        ends: ports of the map that are named ``open_1`` and so on and are closed, or the reverse,
            and those of the network.

    Example:
        >>> import omnitrack_sim as ot
        >>> network = ot.load_network("fig14")
        >>> difference = ot.compare_maps(network, network)
        >>> difference.same, difference.missing
        (True, ())
    """

    parts: int
    found: int
    missing: tuple[str, ...]
    extra: tuple[str, ...]
    kinds: tuple[tuple[str, str], ...]
    wrong_sizes: tuple[tuple[str, str], ...]
    angles: tuple[tuple[str, str], ...]
    loose: tuple[tuple[str, str], ...]
    length: float
    length_error: float
    sizes: tuple[MapSize, ...] = ()
    ends: tuple[tuple[str, str], ...] = ()

    @property
    def complete(self) -> bool:
        """True if the map has every part that can be reached, joined as it is."""
        return not (self.missing or self.kinds or self.loose)

    @property
    def same(self) -> bool:
        """True if the map is complete, has nothing else, and all its sizes are right."""
        return self.consistent and not self.missing

    @property
    def consistent(self) -> bool:
        """True if nothing that the map has is wrong, whatever it lacks.

        It has no other kinds, sizes, directions, ends and joints than the network.
        """
        wrong = self.kinds, self.wrong_sizes, self.angles, self.ends, self.loose, self.extra
        return not any(wrong)

    def __str__(self) -> str:
        names = {
            "missing": self.missing,
            "too many": self.extra,
            "other kind": ["/".join(pair) for pair in self.kinds],
            "other size": ["/".join(pair) for pair in self.wrong_sizes],
            "other direction": ["/".join(pair) for pair in self.angles],
            "other end": ["/".join(pair) for pair in self.ends],
            "not joined": ["/".join(pair) for pair in self.loose],
        }
        faults = [f"{what}: {', '.join(parts)}" for what, parts in names.items() if parts]
        faults = faults or ["the same as the network"]
        count = f"{self.found} of {self.parts} parts are in the map"
        return "; ".join([count, f"lengths off by {self.length_error:.3f} m", *faults])

    def figures(self) -> dict[str, float]:
        """The metrics of a run that explores, see docs/reference/metrics.md."""
        return {
            "map_found": self.found / self.parts,
            "map_complete": float(self.complete),
            "map_length_error_m": self.length_error,
            "map_faults": float(
                sum(map(len, (self.kinds, self.wrong_sizes, self.angles, self.ends, self.extra)))
            ),
        }


def compare_maps(
    found: Network,
    true: Network,
    start: str | None = None,
    closed: Collection[str] = (),
    stds: Mapping[str, Mapping[str, float]] | None = None,
) -> MapDifference:
    """Compare a map with the true network.

    Args:
        found: the map; it begins at the first port of its first fitting.
        true: the network.
        start: where in it the map begins, as ``part.port`` or by a name in ``true.ports``; None:
            the open end nearest to there.
        closed: its ports that a plate closes; what is beyond cannot be reached.
        stds: of sizes of the map, m and rad, as in ``result.map_stds``; None: there are none.

    Raises:
        NetworkError: there is no such port.

    Example:
        >>> import omnitrack_sim as ot
        >>> inlet = {"kind": "straight", "name": "inlet", "length": 0.5}
        >>> knee = {"kind": "elbow", "name": "knee"}
        >>> joints = [{"ports": ("inlet.end", "knee.start")}]
        >>> true = ot.Network(fittings=[inlet, knee], joints=joints)
        >>> ot.compare_maps(ot.Network(fittings=[inlet]), true).missing
        ('knee',)
    """
    plates = {true.port(port, f"closed.{i}") for i, port in enumerate(closed)}
    mine, other = _Graph(found, ()), _Graph(true, plates)
    first = (0, found.fittings[0].of.port_names[0])
    at = _nearest_end(true, found.pipes.parts[0].port(first[1])) if start is None else start
    walk = _Walk(mine, other, stds or {})
    return walk.difference(mine.place[first], other.place[true.port(at, "start")])


def _nearest_end(network: Network, pose: Pose) -> str:
    ends = {end: network.port(end) for end in network.open_ends}
    places = {end: network.pipes.parts[i].port(port).position for end, (i, port) in ends.items()}
    return min(places, key=lambda end: float(length(places[end] - pose.position)))


@dataclass(frozen=True)
class _Node:
    """A fitting, or straights in a row.

    Attributes:
        parts: names of all parts, the first one's is its own. fitting: its kind and sizes.
        ports: in the world, z outward. run: m, length of the run of straights.
    """

    parts: tuple[str, ...]
    fitting: Fitting
    ports: Mapping[str, Pose]
    run: float

    @property
    def name(self) -> str:
        """Name of the first part."""
        return self.parts[0]

    def size(self, key: str) -> float:
        """A size by the key of its constructor, m or rad."""
        return self.run or float(getattr(self.fitting, key))

    def std(self, key: str, stds: Mapping[str, Mapping[str, float]]) -> float | None:
        """Standard deviation of a size; None where that of any part is not known."""
        each = [stds.get(part, {}).get(key) for part in self.parts]
        known = [std for std in each if std is not None]
        return math.hypot(*known) if len(known) == len(each) else None

    def way(self, enter: str, leave: str) -> float:
        """Length of the axis between two ports, m."""
        return self.run or self.fitting.axis_curve(enter, leave, ARCS).length


class _Graph:
    """The parts of a network, straights in a row taken together.

    Attributes:
        nodes: the parts. place: of each port of the network that is one of a node, the node and the
            name of its port. names: of ports of nodes, as ``part.port``. joined: of each port of a
            node the one that it is joined to. closed: ports of nodes with a flat wall. claims: of
            ports of nodes that a robot has inspected, whether it is "open" or "closed".
    """

    def __init__(self, network: Network, plates: Collection[Port]) -> None:
        self._pipes = network.pipes
        # A plate closes both pipes that meet there: what is behind it cannot be in the robot's map.
        every = both_ways(self._pipes.joints)
        shut = {*plates, *(every[end] for end in plates if end in every)}
        self._joined = {end: other for end, other in every.items() if end not in shut}
        self.nodes: list[_Node] = []
        self.place: dict[Port, Port] = {}
        taken: set[int] = set()
        for index in range(len(self._pipes.parts)):
            if index not in taken:
                taken |= self._add(index)
        self.joined = {
            self.place[a]: self.place[b] for a, b in self._joined.items() if a in self.place
        }
        self.names = {at: network.port_name(end) for end, at in self.place.items()}
        flat = shut.union(self._pipes.closed_ends)
        self.closed = {self.place[end] for end in flat if end in self.place}
        ends = {network.port(port): CLAIM.fullmatch(name) for name, port in network.ports.items()}
        self.claims = {
            self.place[end]: claim[1] for end, claim in ends.items() if claim and end in self.place
        }

    def _add(self, index: int) -> set[int]:
        """Add the node of a part; return the parts that are in it."""
        part, number = self._pipes.parts[index], len(self.nodes)
        if not part.fitting.is_plain:
            self.place |= {(index, port): (number, port) for port in part.fitting.port_names}
            ports = {port: part.port(port) for port in part.fitting.port_names}
            self.nodes.append(_Node((part.name,), part.fitting, ports, 0.0))
            return {index}
        run, ends = {index}, dict[str, Port]()
        for port in part.fitting.port_names:
            ends[port] = self._end_of_run((index, port), run)
            self.place[ends[port]] = number, port
        total = sum(self._pipes.parts[i].fitting.length_of_axes for i in run)
        ports = {port: self._pipes.parts[i].port(name) for port, (i, name) in ends.items()}
        names = tuple(self._pipes.parts[i].name for i in sorted(run))
        self.nodes.append(_Node(names, part.fitting, ports, total))
        return run

    def _end_of_run(self, end: Port, run: set[int]) -> Port:
        """Return the last port of a run of straights beyond a port; add its parts to ``run``."""
        while end in self._joined:
            index, enter = self._joined[end]
            fitting = self._pipes.parts[index].fitting
            if not fitting.is_plain:
                break
            run.add(index)
            end = index, next(name for name in fitting.port_names if name != enter)
        return end

    def reached(self, start: Port) -> set[int]:
        """Nodes that can be reached from a port of one of them."""
        groups = connected(range(len(self.nodes)), ((a[0], b[0]) for a, b in self.joined.items()))
        return next(set(group) for group in groups if start[0] in group)


class _Walk:
    """Walks a map and the true network together."""

    def __init__(self, mine: _Graph, true: _Graph, stds: Mapping[str, Mapping[str, float]]) -> None:
        self._mine, self._true, self._stds = mine, true, stds
        self._partner: dict[int, int] = {}  # of each node of the true network, that of the map
        self._ports: dict[Port, Port] = {}  # likewise of ports
        self._kinds, self._sizes, self._angles, self._ends = ({} for _ in range(4))
        self._length, self._error = 0.0, 0.0

    def difference(self, mine: Port, true: Port) -> MapDifference:
        """Compare the map and the network from a port of each on."""
        # One direction across the pipe, for both: the maps are compared as they lie in the world.
        side = self._true.nodes[true[0]].ports[true[1]].rotation[:, 0]
        waiting = deque([(mine, true, side, side)])
        while waiting:
            here, there, my_side, true_side = waiting.popleft()
            # A loop leads back to a part that already has its counterpart.
            if there[0] in self._partner or here[0] in self._partner.values():
                continue
            self._partner[there[0]] = here[0]
            waiting += self._pair(here, there, my_side, true_side)
        reached = self._true.reached(true)
        names = [node.name for node in self._true.nodes]
        matched = {t: m for t, m in self._partner.items() if t not in self._kinds}
        return MapDifference(
            parts=len(reached),
            found=len(matched),
            missing=tuple(names[t] for t in sorted(reached - set(self._partner))),
            extra=tuple(
                node.name
                for i, node in enumerate(self._mine.nodes)
                if i not in self._partner.values()
            ),
            kinds=tuple(self._kinds.values()),
            wrong_sizes=tuple(self._sizes.values()),
            angles=tuple(self._angles.values()),
            loose=tuple(self._loose(matched)),
            length=self._length,
            length_error=self._error,
            sizes=tuple(self._all_sizes(matched)),
            ends=tuple(self._ends.values()),
        )

    def _all_sizes(self, matched: Mapping[int, int]) -> Iterator[MapSize]:
        """Yield the sizes of all parts of the map.

        ``matched``: to each part of the network, that of the map.
        """
        partners = {mine: self._true.nodes[true] for true, mine in matched.items()}
        ports = {mine: true for true, mine in self._ports.items()}
        for i, node in enumerate(self._mine.nodes):
            kind, partner = node.fitting.kind, partners.get(i)
            bores = {node.fitting.bore_key(port): port for port in node.ports}
            for key in SHOWN.get("straight" if node.run else kind, ()):
                value, std, error = node.size(key), node.std(key, self._stds), None
                if partner is not None and key in bores:
                    # A reducer may lie the other way round.
                    port = ports[i, bores[key]][1]
                    error = value - 2 * partner.fitting.port_radius(port)
                elif partner is not None:
                    error = value - partner.size(key)
                yield MapSize(node.name, partner.name if partner else "", key, value, std, error)

    def _pair(
        self, here: Port, there: Port, my_side: Array, true_side: Array
    ) -> list[tuple[Port, Port, Array, Array]]:
        """Compare two parts, entered by ``here`` and ``there``; return the next pairs."""
        mine, true = self._mine.nodes[here[0]], self._true.nodes[there[0]]
        names = (mine.name, true.name)
        plain = mine.fitting.is_plain and true.fitting.is_plain  # a cap is a straight with a plate
        if not plain and mine.fitting.kind != true.fitting.kind:
            self._kinds[there[0]] = names
            return []
        at_mine = _entered(mine, here[1], my_side)
        at_true = _entered(true, there[1], true_side)
        self._ports[there] = here
        onward, lengths = [], list[tuple[float, float]]()
        for port, leave in _matched(at_mine, at_true, here[1], there[1]):
            ends, ways = (here[0], port), (there[0], leave)
            self._ports[ways] = ends
            my_out, true_out = at_mine[port].rotation[:, 2], at_true[leave].rotation[:, 2]
            if angle_between(my_out, true_out) > ANGLES:
                self._angles[there[0]] = names
            lengths.append((mine.way(here[1], port), true.way(there[1], leave)))
            bores = [2 * n.fitting.port_radius(p) for n, p in ((mine, port), (true, leave))]
            if abs(bores[0] - bores[1]) > LENGTHS * bores[1]:
                self._sizes[there[0]] = names
            following = self._mine.joined.get(ends), self._true.joined.get(ways)
            claim, closed = self._mine.claims.get(ends), ways in self._true.closed
            if claim and following[1] is None and closed != (claim == "closed"):
                self._ends[ways] = self._mine.names[ends], self._true.names[ways]
            if following[0] is not None and following[1] is not None:
                sides = (
                    _side_beyond(node, came, port_left, side)
                    for node, came, port_left, side in (
                        (mine, here[1], port, my_side),
                        (true, there[1], leave, true_side),
                    )
                )
                onward.append((following[0], following[1], *sides))
        if any(abs(a - b) > max(LENGTHS * b, MIN_LENGTH) for a, b in lengths):
            self._sizes[there[0]] = names
        self._length += true.run or true.fitting.length_of_axes
        self._error += abs(
            (mine.run or mine.fitting.length_of_axes) - (true.run or true.fitting.length_of_axes)
        )
        return onward

    def _loose(self, matched: Mapping[int, int]) -> list[tuple[str, str]]:
        """Joints of the true network that the map lacks between parts that it has."""
        loose = []
        for a, b in self._true.joined.items():
            both = a[0] in matched and b[0] in matched
            if both and a < b and self._mine.joined.get(self._ports[a]) != self._ports[b]:
                loose.append((self._true.names[a], self._true.names[b]))
        return loose


def _entered(node: _Node, enter: str, side: Array) -> dict[str, Pose]:
    """The ports of a part in the frame of who enters it: z ahead, x to ``side``."""
    port = node.ports[enter]
    z = -port.rotation[:, 2]
    x = unit(side - z * (z @ side))
    frame = Pose(frame_of(x, z), port.position).inverse()
    return {name: frame @ pose for name, pose in node.ports.items()}


def _matched(
    mine: Mapping[str, Pose], true: Mapping[str, Pose], enter: str, true_enter: str
) -> list[tuple[str, str]]:
    """Pairs of ports by which two parts are left, by where they look.

    Which run of a tee is "start" is a matter of naming.
    """
    leaves = [port for port in true if port != true_enter]
    order = min(
        permutations([port for port in mine if port != enter], len(leaves)),
        key=lambda ports: sum(
            float(angle_between(mine[a].rotation[:, 2], true[b].rotation[:, 2]))
            for a, b in zip(ports, leaves, strict=True)
        ),
    )
    return [*zip(order, leaves, strict=True)]


def _side_beyond(node: _Node, enter: str, leave: str, side: Array) -> Array:
    """Carry a direction (3,) across the pipe through a part, alike in all parts of a kind."""
    ahead, out = -node.ports[enter].rotation[:, 2], node.ports[leave].rotation[:, 2]
    # A bend gives a direction of its own, in its plane, which does not depend on earlier errors.
    if length(np.cross(ahead, out)) > math.sin(ANGLES):
        side = ahead
    elif ahead @ out < 0:  # a bend right back
        side = node.ports[leave].position - node.ports[enter].position
    return unit(side - out * (out @ side))
