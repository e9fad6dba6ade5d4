"""Parts, which are placed fittings, and assemblies of joined parts that do not overlap."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.bounds import MAX_FAULTS
from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array, Pose, dot, length, rotation_about, unit
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings.base import ARCS, Arcs, Axis, AxisCurve, Fitting

Port = tuple[int, str]
"""A port of an assembly: index of the part, and the port's name."""


def touching(centres: Array, radii: Array) -> Iterator[NDArray[np.intp]]:
    """Pairs (k, 2) of balls that touch, the smaller number first, those of one ball at a time.

    Args:
        centres: (n, 3) m.
        radii: (n,) m.
    """
    if len(radii) < 2:
        return
    # In order along the longest side of all a ball meets only those that begin before it ends.
    along = centres[:, np.ptp(centres, axis=0).argmax()]
    low, high = along - radii, along + radii
    order = low.argsort(kind="stable")
    ends = low[order].searchsorted(high[order])
    for place, (i, end) in enumerate(zip(order.tolist(), ends.tolist(), strict=True), start=1):
        others = order[place:end]
        others = others[length(centres[others] - centres[i]) < radii[others] + radii[i]]
        if len(others):
            yield np.sort(np.stack([np.full(len(others), i), others], axis=-1), axis=1)


def batched(blocks: Iterable[NDArray[np.intp]]) -> Iterator[NDArray[np.intp]]:
    """Yield blocks (k, 2) together, ``BATCH`` pairs or more at a time.

    NumPy takes as long for ten numbers as for a thousand.
    """
    waiting: list[NDArray[np.intp]] = []
    for block in blocks:
        waiting.append(block)
        if sum(map(len, waiting)) >= BATCH:
            yield np.concatenate(waiting)
            waiting = []
    if waiting:
        yield np.concatenate(waiting)


BATCH = 4096
"""Pairs that are compared at a time."""


def between_lines(a: Array, b: Array) -> Array:
    """Return distances (n,) m between straight pieces (n, 2, 3) m, given by their ends."""
    u, v, w = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0], a[:, 0] - b[:, 0]
    uu, vv, uv, uw, vw = dot(u, u), dot(v, v), dot(u, v), dot(u, w), dot(v, w)
    # The nearest places of the lines; of parallel ones any. Then brought to the pieces, that of the
    # second first, and that of the first after it.
    square = uu * vv - uv * uv
    square = np.where(square > 1e-12 * uu * vv, square, np.inf)
    s = np.clip((uv * vw - uw * vv) / square, 0.0, 1.0)
    t = np.clip((uv * s + vw) / np.where(vv > 0, vv, 1.0), 0.0, 1.0)
    s = np.clip((uv * t - uw) / np.where(uu > 0, uu, 1.0), 0.0, 1.0)
    return length(w + s[:, None] * u - t[:, None] * v)


def beyond_an_end(a: Array, b: Array, reach: Array, square: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Tell which pieces of pipe ``b`` lie wholly beyond the end planes of pieces ``a``, (n,).

    Pieces are given by lines (n, 2, 3) m; the planes are square to ``a``.

    Args:
        a: ends of the lines of the first pieces.
        b: ends of the lines of the others.
        reach: (n,) m, radii about ``b``.
        square: (n,), whether the pieces end square too, so that they reach less far along.
    """
    way, along = unit(a[:, 1] - a[:, 0]), unit(b[:, 1] - b[:, 0])
    lean = dot(way, along)
    far = reach * np.where(square, np.sqrt(np.maximum(1 - lean * lean, 0.0)), 1.0)
    before = dot(b - a[:, :1], way[:, None]).max(axis=1) + far
    after = dot(b - a[:, 1:], way[:, None]).min(axis=1) - far
    return (before <= 0) | (after >= 0)


DRAWN_TURN = np.radians(5)
"""Turn of an axis between points by which it is drawn, rad."""
SAMPLE_SPACING = 0.02
"""Spacing of the samples along the axis that overlaps are looked for with, m."""
STRETCH = 0.5
"""Length of the stretches that are first compared as a whole, m."""
OVERLAP = 1e-3
"""Depth by which two bores may share space unnoticed, m."""
JOINED = 1e-6
"""Distance within which two open ports are the same place, m."""
BORE_TOLERANCE = 1e-3
"""Difference of the diameters of joined bores that passes as manufacturing tolerance, m."""


class Stretch(NamedTuple):
    """A stretch of one of a part's axes, and a ball around the bore there.

    Attributes:
        axis: number of the axis. middle, half: m, arc length of its middle, and half its length.
        centre: (3,) m, world frame. reach: m, radius of the ball, with room for rounded rims.
    """

    axis: int
    middle: float
    half: float
    centre: Array
    reach: float


@dataclass(frozen=True)
class Part:
    """A fitting placed in an assembly: its name and its pose in the world."""

    name: str
    fitting: Fitting
    pose: Pose

    def __repr__(self) -> str:
        return f"Part({self.name!r}, {self.fitting!r})"

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """As ``Fitting.signed_distance``, for points and gradient in the world frame."""
        distance, gradient = self.fitting.signed_distance(self.pose.inverse().apply(points))
        return distance, gradient @ self.pose.rotation.T

    def extent(self, points: Array) -> Array:
        """As ``Fitting.extent``, for points in the world frame."""
        return self.fitting.extent(self.pose.inverse().apply(points))

    def port(self, name: str) -> Pose:
        """A port in the world frame."""
        return self.pose @ self._ports[name]

    @cached_property
    def _ports(self) -> Mapping[str, Pose]:
        return self.fitting.ports

    def axis(self, enter: str, leave: str, arcs: Arcs = ARCS) -> Centreline:
        """The axis curve from one port to another, world frame."""
        return self._placed(self.fitting.axis_curve(enter, leave, arcs))

    @cached_property
    def axes(self) -> tuple[tuple[Centreline, float, float], ...]:
        """``Fitting.axes`` in the world frame, each with the bore radius at its ends, m."""
        return self._lines(self.fitting.axes)

    @property
    def drawn_bores(self) -> tuple[tuple[Centreline, float, float], ...]:
        """``Fitting.drawn_bores`` likewise."""
        return self._lines(self.fitting.drawn_bores)

    def _lines(self, axes: Sequence[Axis]) -> tuple[tuple[Centreline, float, float], ...]:
        return tuple(
            (self._placed(axis.curve), axis.start_radius, axis.end_radius) for axis in axes
        )

    def polylines(self) -> list[Array]:
        """Its axes as points (k, 3) m, world frame.

        A straight one by its ends, an arc by points at most ``DRAWN_TURN`` apart.
        """
        turns = [sum(s * abs(k) for s, k in axis.curve.segments) for axis in self.fitting.axes]
        return [
            line.at(np.linspace(0, line.length, 2 + int(turn / DRAWN_TURN)))[0]
            for (line, _, _), turn in zip(self.axes, turns, strict=True)
        ]

    def _placed(self, curve: AxisCurve) -> Centreline:
        segments = self.segments(curve)
        return Centreline(segments, segments[0].normal)

    def segments(self, curve: AxisCurve) -> list[Segment]:
        """One of the fitting's axis curves as segments of a centreline, world frame."""
        turn = self.pose.rotation
        point, t, n = self.pose.apply(curve.point), turn @ curve.tangent, turn @ curve.normal
        segments = []
        for s, k in curve.segments:
            segments.append(Segment(s, abs(k), point, t, -n if k < 0 else n))
            if k == 0:
                point = point + s * t
            else:
                # The arc's end and its axes, turned in the plane of tangent and normal.
                sin, cos = np.sin(s * k), np.cos(s * k)
                point = point + (t * sin + n * (1 - cos)) / k
                t, n = t * cos + n * sin, n * cos - t * sin
        return segments

    def bore_samples(self, stretch: Stretch | None = None) -> Array:
        """Points (k, 3) m on the fitting's axes and near its inner surface, world frame.

        With a ``stretch`` only those beside it.
        """
        samples = []
        for number, (line, start_radius, end_radius) in enumerate(self.axes):
            count = max(2, int(np.ceil(line.length / SAMPLE_SPACING)) + 1)
            s: Array = np.linspace(0, line.length, count)
            radius: Array = np.linspace(start_radius, end_radius, len(s))
            if stretch is not None:
                if stretch.axis != number:
                    continue
                wanted = np.abs(s - stretch.middle) <= stretch.half + SAMPLE_SPACING
                s, radius = s[wanted], radius[wanted]
            point, frame = line.at(s)[0], line.frame(s)
            # Rings stay 5 % off the wall, so that bores that merely touch do not count as
            # overlapping.
            around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
            ring = self.fitting.ring(around)
            rings = 0.95 * radius[:, None, None] * np.einsum("sij,kj->ski", frame, ring)
            samples += [point, (point[:, None] + rings).reshape(-1, 3)]
        return np.concatenate(samples)

    def stretches(self) -> list[Stretch]:
        """Its axes in stretches of about ``STRETCH`` m, or of two bores where that is more."""
        stretches, room = [], self.fitting.max_radius
        for number, (line, start_radius, end_radius) in enumerate(self.axes):
            widest = max(start_radius, end_radius)
            count = int(np.ceil(line.length / max(STRETCH, 4 * widest)))
            half = line.length / count / 2
            middles: Array = half * (2.0 * np.arange(count, dtype=float) + 1.0)
            stretches += [
                Stretch(number, middle, half, centre, half + widest + room)
                for middle, centre in zip(middles.tolist(), line.at(middles)[0], strict=True)
            ]
        return stretches

    def capsules(self) -> list[tuple[Array, Array, float]]:
        """Return capsules about the axes that hold the bore, with room for rounded rims.

        Each as start (3,) m, end (3,) m and radius, m.
        """
        # A bore without a rim reaches no farther than its radius from its axis.
        room = 0.0 if self.fitting.is_cut_square else self.fitting.max_radius
        capsules = []
        for axis in self.fitting.axes:
            widest = max(axis.start_radius, axis.end_radius)
            if not self.fitting.is_round:
                widest = self.fitting.max_radius
            for segment in self.segments(axis.curve):
                s, k, point = segment.length, segment.curvature, segment.point
                t, n = segment.tangent, segment.normal
                if k == 0:
                    capsules.append((point, point + s * t, widest + room))
                    continue
                sin, cos = np.sin(s * k), np.cos(s * k)
                bow = (1 - np.cos(min(s * k / 2, np.pi))) / k
                end = point + (t * sin + n * (1 - cos)) / k
                capsules.append((point, end, widest + room + bow))
        return capsules

    def holds(self, points: Array, margin: float) -> bool:
        """Return whether any of ``points`` (n, 3) m lies deeper than ``margin`` m in this bore.

        Points are in the world frame.
        """
        inside = self.signed_distance(points)[0] > margin
        return bool((inside & (self.extent(points) > margin)).any())


@dataclass(frozen=True)
class Assembly:
    """Part fittings and which ports are joined: ((part, port), (part, port)) by index and name.

    Raises:
        GeometryError: joined bores whose diameters differ by more than ``BORE_TOLERANCE``, joints
            of closed ports, or parts that run into each other.

    Example:
        >>> import omnitrack_sim as ot
        >>> pipes = ot.load_network("fig14").pipes
        >>> pipes.parts[0]
        Part(...)
        >>> distance, gradient = pipes.signed_distance(pipes.parts[0].pose.position)
        >>> round(float(distance), 6)  # m, from the wall to a point of the axis
        0.08
    """

    parts: tuple[Part, ...]
    joints: tuple[tuple[Port, Port], ...] = ()

    def __repr__(self) -> str:
        return f"Assembly({len(self.parts)} parts, {len(self.joints)} joints)"

    def __post_init__(self) -> None:
        self._settle()
        faults = [*self._mismatches(), *self._overlaps(), *self._closures()]
        if faults:
            raise GeometryError(faults)

    def _settle(self) -> None:
        """Have what lies on the floor of a part lie where that is, by its pose."""
        parts, faults = [], []
        for i, part in enumerate(self.parts):
            try:
                fitting = part.fitting.settled(-part.pose.rotation[2])
                parts.append(part if fitting is part.fitting else replace(part, fitting=fitting))
            except GeometryError as error:
                faults += [f.at(f"pipes.{i}.{f.where.partition('.')[2]}") for f in error.faults]
        if faults:
            raise GeometryError(faults)
        object.__setattr__(self, "parts", tuple(parts))

    @classmethod
    def unchecked(
        cls,
        parts: tuple[Part, ...],
        joints: tuple[tuple[Port, Port], ...],
    ) -> Assembly:
        """Return an assembly whose parts need not fit together, as in a map that a robot makes."""
        # A frozen dataclass sets its fields in __init__ only, which would run the checks.
        assembly = object.__new__(cls)
        object.__setattr__(assembly, "parts", parts)
        object.__setattr__(assembly, "joints", joints)
        return assembly

    @property
    def open_ends(self) -> tuple[Port, ...]:
        """Ports that nothing is joined to, (part index, port name); closed ones among them."""
        taken = {end for joint in self.joints for end in joint}
        return tuple(
            (i, p)
            for i, part in enumerate(self.parts)
            for p in part.fitting.ports
            if (i, p) not in taken
        )

    @property
    def openings(self) -> tuple[Port, ...]:
        """Open ends that no wall closes, (part index, port name)."""
        closed = set(self.closed_ends)
        return tuple(end for end in self.open_ends if end not in closed)

    @property
    def closed_ends(self) -> tuple[Port, ...]:
        """Ports at which a wall ends the pipe, (part index, port name)."""
        return tuple((i, p) for i, part in enumerate(self.parts) for p in part.fitting.closed_ports)

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (...,) m from points (..., 3) m to the inner surface; unit gradient (..., 3).

        World frame, positive in a bore.
        Each part counts between its port planes; beyond all of them the distance is negative,
        towards the nearest port plane. In the part that a reducer's wide end is joined to, points
        near the axis within a few millimetres of the joint can be nearer to the cone than to their
        own part's wall; this is not seen here.
        """
        points = np.asarray(points, float)
        best = np.full(points.shape[:-1], -np.inf)
        gradient = np.zeros(points.shape)
        for part in self.parts:
            distance, direction = part.signed_distance(points)
            extent = part.extent(points)
            # Where bores of two parts meet, a point is as free as in the roomier of them: the
            # union.
            value = np.where(extent >= -JOINED, distance, np.minimum(distance, extent))
            better = value > best
            best, gradient = (
                np.where(better, value, best),
                np.where(better[..., None], direction, gradient),
            )
        return best, gradient

    def holds(self, point: Array) -> bool:
        """Return whether a point (3,) m, world frame, is in a bore, between the port planes."""
        centres, reach, owners = self._balls
        near = owners[length(centres - point) <= reach]
        # A joint's plane belongs to both parts.
        return any(self.parts[i].holds(point, -JOINED) for i in dict.fromkeys(near.tolist()))

    @cached_property
    def _balls(self) -> tuple[Array, Array, NDArray[np.intp]]:
        """Balls around stretches of the bores: centres (k, 3) m, radii (k,) m, and their parts."""
        stretches = [part.stretches() for part in self.parts]
        owners = np.repeat(np.arange(len(stretches)), [len(each) for each in stretches])
        balls = [(*ball.centre, ball.reach) for each in stretches for ball in each]
        centres, reach = np.split(np.array(balls), [3], axis=1)
        return centres, reach[:, 0], owners

    def _mismatches(self) -> list[Fault]:
        faults = []
        closed = set(self.closed_ends)
        for (i, port_i), (j, port_j) in self.joints:
            a, b = self.parts[i], self.parts[j]
            if shut := closed & {(i, port_i), (j, port_j)}:
                part, port = min(shut)
                problem = f"joins {a.name!r} to {b.name!r} at {port!r} of {self.parts[part].name!r}"
                faults.append(Fault(f"pipes.{j}", f"{problem}, which is closed"))
            if not (a.fitting.is_round and b.fitting.is_round):
                if _apart(a, port_i, b, port_j) > JOINED:
                    words = [f"{part.name!r} ({port})" for part, port in ((a, port_i), (b, port_j))]
                    problem = (
                        f"joins {words[0]} to {words[1]} with a bore of another section; joined "
                        "sections have one shape and size, and stand the same way"
                    )
                    faults.append(Fault(f"pipes.{j}", problem))
                continue
            bore_a, bore_b = 2 * a.fitting.port_radius(port_i), 2 * b.fitting.port_radius(port_j)
            if abs(bore_a - bore_b) > BORE_TOLERANCE + JOINED:
                problem = (
                    f"joins {a.name!r} ({port_i}) of {bore_a:.6g} m to {b.name!r} ({port_j}) of "
                    f"{bore_b:.6g} m; "
                    "a reducer joins bores of two sizes, a coupling as a step"
                )
                faults.append(Fault(f"pipes.{j}.{b.fitting.bore_key(port_j)}", problem))
        return faults

    def _overlaps(self) -> list[Fault]:
        """Faults of parts that share space."""
        names = [part.name for part in self.parts]
        return [
            Fault(f"pipes.{j}", f"{names[j]!r} runs into {names[i]!r} (pipes.{i})")
            for i, j in self.overlaps()
        ]

    def overlaps(self, max_count: int = MAX_FAULTS) -> list[tuple[int, int]]:
        """Return up to ``max_count`` pairs (indices) of parts that overlap and are not joined."""
        joined = {(min(i, j), max(i, j)) for (i, _), (j, _) in self.joints}
        pairs = []
        for pair in sorted(self._near() - joined):
            if self._share_space(*pair):
                pairs.append(pair)
                if len(pairs) == max_count:
                    break
        return pairs

    def _near(self) -> set[tuple[int, int]]:
        """Return pairs of parts whose bores may share space.

        Capsules about their axes touch, and no port plane of a straight one separates them.
        """
        rows = [(i, *capsule) for i, part in enumerate(self.parts) for capsule in part.capsules()]
        owner = np.array([row[0] for row in rows])
        ends = np.array([row[1:3] for row in rows]).reshape(-1, 2, 3)
        reach = np.array([row[3] for row in rows])
        axial = np.array([part.fitting.is_cut_square for part in self.parts])[owner]
        half = length(ends[:, 1] - ends[:, 0]) / 2
        near: set[tuple[int, int]] = set()
        for block in batched(touching(ends.mean(axis=1), half + reach)):
            i, j = block.T
            apart = owner[i] != owner[j]
            i, j = i[apart], j[apart]
            close = between_lines(ends[i], ends[j]) < reach[i] + reach[j]
            i, j = i[close], j[close]
            beyond = axial[i] & beyond_an_end(ends[i], ends[j], reach[j], axial[j])
            beyond |= axial[j] & beyond_an_end(ends[j], ends[i], reach[i], axial[i])
            i, j = i[~beyond], j[~beyond]
            both = np.sort(np.stack([owner[i], owner[j]], axis=-1), axis=1)
            near.update(map(tuple, both.tolist()))
        return near

    def _share_space(self, i: int, j: int) -> bool:
        """Return whether the bores of two parts share space."""
        a, b = self.parts[i], self.parts[j]
        mine, theirs = a.stretches(), b.stretches()
        centres = [np.array([s.centre for s in part]) for part in (mine, theirs)]
        reaches = [np.array([s.reach for s in part]) for part in (mine, theirs)]
        apart = length(centres[0][:, None] - centres[1])
        for one, other in np.argwhere(apart < reaches[0][:, None] + reaches[1]).tolist():
            # Both ways round: the samples of a wide bore may all miss a narrow one inside it.
            if a.holds(b.bore_samples(theirs[other]), OVERLAP) or b.holds(
                a.bore_samples(mine[one]), OVERLAP
            ):
                return True
        return False

    def _closures(self) -> list[Fault]:
        """Open ends of two parts in one place: the pipe closes on itself without being joined."""
        ends = self.open_ends
        places = np.array([self.parts[i].port(port).position for i, port in ends])
        radii = np.full(len(ends), JOINED / 2)
        pairs = (pair for block in touching(places.reshape(-1, 3), radii) for pair in block)
        apart = (pair for pair in pairs if ends[pair[0]][0] != ends[pair[1]][0])
        return [
            self._closed(ends[first], ends[second])
            for first, second in sorted(map(tuple, islice(apart, MAX_FAULTS)))
        ]

    def _closed(self, first: Port, second: Port) -> Fault:
        (i, port_i), (j, port_j) = first, second
        problem = (
            f"{self.parts[j].name!r} ({port_j}) ends where {self.parts[i].name!r} ({port_i}, "
            f"pipes.{i}) does, and is not joined to it"
        )
        return Fault(f"pipes.{j}", problem)


def _apart(a: Part, port: str, b: Part, other: str) -> float:
    """Return by how much, m, the edges of two joined bores differ across the joint."""
    angles = np.linspace(0.0, 2 * np.pi, 72, endpoint=False)
    mine, theirs = a.port(port).rotation, b.port(other).rotation
    across = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ mine[:, :2].T
    x, y = across @ theirs[:, 0], across @ theirs[:, 1]
    edges = a.fitting.outline(port, angles), b.fitting.outline(other, np.arctan2(y, x))
    return float(np.abs(edges[0] - edges[1]).max())


def attached(port: Pose, fitting: Fitting, enter: str, turn: float) -> Pose:
    """Return the pose of a fitting whose port ``enter`` is joined to a placed ``port``.

    Both in the same frame, z of the port outward.

    The x axes of the two ports coincide, then the fitting is turned by ``turn`` rad about the axis
    of ``port``. Seen
    from the other side the turn is the same: either of two ports may be the placed one.
    """
    return joined(port, fitting.ports[enter], turn)


@lru_cache(maxsize=256)
def _about_z(turn: float) -> Array:
    """Rotation (3, 3) about z; few turns are used, most often none."""
    return rotation_about([0, 0, 1], turn)


def joined(port: Pose, entry: Pose, turn: float) -> Pose:
    """As ``attached``, for the port ``entry`` of a fitting in the fitting's frame."""
    rotation = port.rotation @ _about_z(turn)
    # The port looks back along the route.
    return Pose(rotation * [1, -1, -1], port.position) @ entry.inverse()
