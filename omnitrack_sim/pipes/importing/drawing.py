"""Drawings of towns: nodes, and pipes between them as lines of points, before they are pipes.

What no fitting can be made of is mended here as far as lines go: a node of five pipes, repeated
points, a closed pipe, pipes that cross without a node.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from omnitrack_sim.base.rotations import Array, length, unit
from omnitrack_sim.pipes.assembly import between_lines
from omnitrack_sim.pipes.importing.assumptions import ImportNote

ROOM_AT_PUMP = 0.5
"""By how much a pipe ends before a pump or valve that is drawn as a point, m."""


@dataclass(frozen=True)
class DrawnPipe:
    """A pipe of a drawing.

    Attributes:
        name: of the pipe, or a piece of it. pipe: name in the file.
        ends: names of the nodes.
        points: (k, 3) m, from node to node.
        bore: m.
    """

    name: str
    pipe: str
    ends: tuple[str, str]
    points: Array
    bore: float

    @property
    def length(self) -> float:
        """Length of its line, m."""
        return float(length(np.diff(self.points, axis=0)).sum())

    def towards(self, end: int) -> Array:
        """Return the unit vector (3,) out of the node at an end, 0 or 1."""
        first, second = (self.points[0], self.points[1]) if end == 0 else self.points[[-1, -2]]
        return unit(second - first)

    def cut(self, at: float, name: str, node: str) -> tuple[DrawnPipe, DrawnPipe]:
        """Return the pieces up to a distance ``at`` m along it, and from there, at a new node."""
        s = np.append(0.0, np.cumsum(length(np.diff(self.points, axis=0))))
        k = min(int(np.searchsorted(s, at)), len(s) - 1)
        part = (at - s[k - 1]) / (s[k] - s[k - 1])
        point = self.points[k - 1] + part * (self.points[k] - self.points[k - 1])
        first = np.vstack([self.points[:k], point])
        second = np.vstack([point, self.points[k:]])
        return (
            replace(self, ends=(self.ends[0], node), points=first),
            replace(self, name=name, ends=(node, self.ends[1]), points=second),
        )


@dataclass
class Drawing:
    """Nodes and pipes of a town.

    Attributes:
        nodes: places (3,) m by name. legs: pipes by name.
        lengths: of the pipes in the file, m. open_ends: nodes at which a pipe ends
            open, as in a tank; others end in a cap. notes: what was changed.
    """

    nodes: dict[str, Array]
    legs: dict[str, DrawnPipe]
    lengths: dict[str, float] = field(default_factory=dict)
    open_ends: set[str] = field(default_factory=set)
    notes: list[ImportNote] = field(default_factory=list)

    def at_nodes(self) -> dict[str, list[tuple[str, int]]]:
        """Return the legs at each node, each with the end that is there, 0 or 1."""
        found: dict[str, list[tuple[str, int]]] = {name: [] for name in self.nodes}
        for leg in self.legs.values():
            for end in (0, 1):
                found[leg.ends[end]].append((leg.name, end))
        return found

    def new_name(self, name: str) -> str:
        """Return the first of a name with a number that no leg and no node has."""
        names = (f"{name}+{number}" for number in count(1))
        return next(n for n in names if n not in self.legs and n not in self.nodes)

    def simplify(self, tolerance: float) -> None:
        """Leave out points of lines that move them by less than ``tolerance`` m."""
        for name, leg in self.legs.items():
            apart = length(np.diff(leg.points, axis=0)) > 1e-3
            # The last point is the node's and stays; of two in one place the first goes.
            points = leg.points[np.append(apart, True)]
            points[0] = leg.points[0]
            self.legs[name] = replace(leg, points=without_straight(points, tolerance))

    def close(self, name: str) -> None:
        """Put a plate into the middle of a leg."""
        leg = self.legs[name]
        one, other = self.new_name(name), f"{self.new_name(name)}'"
        first, rest = leg.cut(leg.length / 2, other, one)
        _, second = rest.cut(0.005, other, other)
        self.nodes |= {one: first.points[-1], other: second.points[0]}
        self.legs |= {name: first, second.name: second}
        self.notes.append(
            ImportNote("mended", f"pipe {leg.pipe}", "is closed: a plate stands in its middle")
        )

    def split_crowds(self) -> None:
        """Move pipes of nodes with five or more, one by one, to a tee in a neighbour of theirs."""
        for node, here in self.at_nodes().items():
            here = list(here)
            while len(here) > 4:
                here = self._without_one(node, here)

    def _without_one(self, node: str, here: list[tuple[str, int]]) -> list[tuple[str, int]]:
        """Tap the narrowest pipe of a node into the one beside it; returns those that are left."""
        moved, end = min(here, key=lambda one: (self.legs[one[0]].bore, one[0]))
        others = [one for one in here if one[0] != moved]
        away = self.legs[moved].towards(end)
        # The pipe that the moved one is most nearly square to: there it makes a tee.
        host, host_end = min(others, key=lambda o: abs(self.legs[o[0]].towards(o[1]) @ away))
        leg, line = self.legs[moved], self.legs[host]
        at = min(8 * max(line.bore, leg.bore), line.length / 2)
        tap = self.new_name(node)
        name = self.new_name(host)
        one, other = line.cut(at if host_end == 0 else line.length - at, name, tap)
        self.nodes[tap] = one.points[-1]
        self.legs |= {host: one, name: other}
        points = leg.points.copy()
        points[0 if end == 0 else -1] = self.nodes[tap]
        ends = (tap, leg.ends[1]) if end == 0 else (leg.ends[0], tap)
        self.legs[moved] = replace(leg, ends=ends, points=points)
        problem = (
            f"joins {len(here)} pipes: pipe {leg.pipe} leaves pipe {line.pipe} {at:.2f} m beside it"
        )
        self.notes.append(ImportNote("mended", f"node {node}", problem))
        if host_end == 1:
            # The piece at the node is now the second one.
            others = [(name, 1) if o == (host, 1) else o for o in others]
        return others

    def move(self, node: str, by: Array) -> None:
        """Move a node, and the ends of the pipes there, by (3,) m."""
        self.nodes[node] = self.nodes[node] + by
        for name, end in self.at_nodes()[node]:
            points = self.legs[name].points.copy()
            points[0 if end == 0 else -1] = self.nodes[node]
            self.legs[name] = replace(self.legs[name], points=points)

    def part(self, one: str, other: str) -> None:
        """Draw pipes that end at two nodes in one place apart, as at a pump between them."""
        here = self.at_nodes()
        if length(self.nodes[one] - self.nodes[other]) > 2 * ROOM_AT_PUMP:
            return
        for node in (one, other):
            if len(here[node]) == 1:
                name, end = here[node][0]
                leg = self.legs[name]
                back = min(ROOM_AT_PUMP, leg.length / 4)
                at = back if end == 0 else leg.length - back
                first, second = leg.cut(at, name, node)
                kept = second if end == 0 else first
                self.legs[name] = replace(kept, ends=leg.ends)
                self.nodes[node] = kept.points[0 if end == 0 else -1]


def without_straight(points: Array, tolerance: float) -> Array:
    """Return a line (k, 3) m without points within ``tolerance`` m of it (Douglas-Peucker)."""
    kept, ranges = {0, len(points) - 1}, [(0, len(points) - 1)]
    while ranges:
        first, last = ranges.pop()
        if last - first < 2:
            continue
        chord, between = points[last] - points[first], points[first + 1 : last] - points[first]
        size = float(chord @ chord)
        along = np.clip(between @ chord / size, 0.0, 1.0) if size > 0 else np.zeros(len(between))
        off = length(between - along[:, None] * chord)
        worst = int(off.argmax())
        if off[worst] > tolerance:
            middle = first + 1 + worst
            kept.add(middle)
            ranges += [(first, middle), (middle, last)]
    return points[sorted(kept)]


def lowered(line: Array, by: float) -> Array:
    """Return a line (k, 3) m whose middle lies ``by`` m lower, and whose ends stay."""
    long = float(length(np.diff(line, axis=0)).sum())
    down = min(4 * by, long / 4)
    first, last = unit(line[1] - line[0]), unit(line[-2] - line[-1])
    inner = [p for p in line[1:-1] if min(length(p - line[0]), length(p - line[-1])) > 1.5 * down]
    points = [line[0] + down * first, *inner, line[-1] + down * last]
    return np.array([line[0], *(p - [0.0, 0.0, by] for p in points), line[-1]])


def under(line: Array, other: Array | None, node: Array | None, by: float) -> Array | None:
    """Return a line that passes ``by`` m below another one, or a node, where they are nearest.

    Lines are (k, 3) m; None where the nearest place is at one of its ends.
    """
    pieces = np.stack([line[:-1], line[1:]], axis=1)
    others = np.stack([other[:-1], other[1:]], axis=1) if other is not None else None
    if others is None:
        assert node is not None
        others = np.stack([[node, node]])
    i, j = (k.ravel() for k in np.indices((len(pieces), len(others))))
    best = int(between_lines(pieces[i], others[j]).argmin())
    piece, beside = pieces[i[best]], others[j[best]]
    # Where they are nearest when seen from above.
    s = np.linspace(0.0, 1.0, 2001)[:, None]
    places = piece[0] + s * (piece[1] - piece[0])
    spread = np.stack([places, places], axis=1)
    gap = between_lines(spread, np.broadcast_to(beside, spread.shape))
    place = places[int(gap.argmin())]
    ends = length(place - line[[0, -1]])
    if ends.min() < 3 * by:
        return None
    level = beside[0] + (beside[1] - beside[0]) * 0.5
    across = beside[1] - beside[0]
    if across @ across > 0:
        along = np.clip((place - beside[0]) @ across / (across @ across), 0.0, 1.0)
        level = beside[0] + along * across
    place = np.append(place[:2], min(place[2], level[2]) - by)
    return np.insert(line, int(i[best]) + 1, place, axis=0)
