"""Parts, which are placed fittings, and assemblies of joined parts that do not overlap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.bounds import MOST_FAULTS
from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array, Pose, length, rotation_about
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings.base import ARCS, Arcs, AxisCurve, Fitting


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
        return tuple(
            (self._placed(axis.curve), axis.start_radius, axis.end_radius)
            for axis in self.fitting.axes
        )

    def _placed(self, curve: AxisCurve) -> Centreline:
        segments = self.segments(curve)
        return Centreline(segments, segments[0].normal)

    def segments(self, curve: AxisCurve) -> list[Segment]:
        """One of the fitting's axis curves as segments of a centreline, world frame."""
        turn = self.pose.rotation
        point, t, n = self.pose.apply(curve.point), turn @ curve.tangent, turn @ curve.normal
        segments = []
        for s, k in curve.segments:
            segments.append(Segment(s, k, point, t, n))
            if k == 0:
                point = point + s * t
            else:
                # The arc's end and its axes, turned in the plane of tangent and normal.
                sin, cos = np.sin(s * k), np.cos(s * k)
                point = point + (t * sin + n * (1 - cos)) / k
                t, n = t * cos + n * sin, n * cos - t * sin
        return segments

    def bore_samples(self, stretch: Stretch | None = None) -> Array:
        """Points (k, 3) m on the fitting's axes and near its inner surface, world frame; with a
        ``stretch`` only those beside it."""
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
            ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1)
            rings = 0.95 * radius[:, None, None] * np.einsum("sij,kj->ski", frame, ring)
            samples += [point, (point[:, None] + rings).reshape(-1, 3)]
        return np.concatenate(samples)

    def stretches(self) -> list[Stretch]:
        """Its axes in stretches of about ``STRETCH`` m, or of two bores where that is more."""
        stretches, room = [], self.fitting.largest_radius
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
    joints: tuple[tuple[tuple[int, str], tuple[int, str]], ...] = ()

    def __repr__(self) -> str:
        return f"Assembly({len(self.parts)} parts, {len(self.joints)} joints)"

    def __post_init__(self) -> None:
        faults = [*self._mismatches(), *self._overlaps(), *self._closures()]
        if faults:
            raise GeometryError(faults)

    @classmethod
    def unchecked(
        cls,
        parts: tuple[Part, ...],
        joints: tuple[tuple[tuple[int, str], tuple[int, str]], ...],
    ) -> Assembly:
        """Return an assembly whose parts need not fit together, as in a map that a robot makes."""
        # A frozen dataclass sets its fields in __init__ only, which would run the checks.
        assembly = object.__new__(cls)
        object.__setattr__(assembly, "parts", parts)
        object.__setattr__(assembly, "joints", joints)
        return assembly

    @property
    def open_ends(self) -> tuple[tuple[int, str], ...]:
        """Ports that nothing is joined to, (part index, port name); closed ones among them."""
        taken = {end for joint in self.joints for end in joint}
        return tuple(
            (i, p)
            for i, part in enumerate(self.parts)
            for p in part.fitting.ports
            if (i, p) not in taken
        )

    @property
    def openings(self) -> tuple[tuple[int, str], ...]:
        """Open ends that no wall closes, (part index, port name)."""
        closed = set(self.closed_ends)
        return tuple(end for end in self.open_ends if end not in closed)

    @property
    def closed_ends(self) -> tuple[tuple[int, str], ...]:
        """Ports at which a wall ends the pipe, (part index, port name)."""
        return tuple((i, p) for i, part in enumerate(self.parts) for p in part.fitting.closed_ports)

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """Distance (...,) m from ``points`` (..., 3) m to the inner surface; unit gradient (...,
        3).

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

    def _mismatches(self) -> list[Fault]:
        faults = []
        closed = set(self.closed_ends)
        for (i, port_i), (j, port_j) in self.joints:
            a, b = self.parts[i], self.parts[j]
            if shut := closed & {(i, port_i), (j, port_j)}:
                part, port = min(shut)
                problem = f"joins {a.name!r} to {b.name!r} at {port!r} of {self.parts[part].name!r}"
                faults.append(Fault(f"pipes.{j}", f"{problem}, which is closed"))
            bore_a, bore_b = 2 * a.fitting.port_radius(port_i), 2 * b.fitting.port_radius(port_j)
            if abs(bore_a - bore_b) > BORE_TOLERANCE + JOINED:
                problem = (
                    f"joins {a.name!r} ({port_i}) of {bore_a:.6g} m to {b.name!r} ({port_j}) of "
                    f"{bore_b:.6g} m; "
                    "a reducer joins bores of two sizes"
                )
                faults.append(Fault(f"pipes.{j}.{b.fitting.bore_key(port_j)}", problem))
        return faults

    def _overlaps(self) -> list[Fault]:
        """Parts that share space and are not joined, up to ``MOST_FAULTS``."""
        joined = {frozenset((i, j)) for (i, _), (j, _) in self.joints}
        pairs: set[tuple[int, int]] = set()
        every = [(i, stretch) for i, part in enumerate(self.parts) for stretch in part.stretches()]
        centres = np.array([stretch.centre for _, stretch in every]).reshape(-1, 3)
        near = touching(centres, np.array([stretch.reach for _, stretch in every]))
        for one, other in (pair for block in near for pair in block.tolist()):
            (i, mine), (j, theirs) = every[one], every[other]
            if i == j or (i, j) in pairs or frozenset((i, j)) in joined:
                continue
            # Both ways round: the samples of a wide bore may all miss a narrow one inside it.
            a, b = self.parts[i], self.parts[j]
            if a.holds(b.bore_samples(theirs), OVERLAP) or b.holds(a.bore_samples(mine), OVERLAP):
                pairs.add((i, j))
                if len(pairs) == MOST_FAULTS:
                    break
        names = [part.name for part in self.parts]
        return [
            Fault(f"pipes.{j}", f"{names[j]!r} runs into {names[i]!r} (pipes.{i})")
            for i, j in sorted(pairs)
        ]

    def _closures(self) -> list[Fault]:
        """Open ends of two parts in one place: the pipe closes on itself without being joined."""
        ends = self.open_ends
        places = np.array([self.parts[i].port(port).position for i, port in ends])
        radii = np.full(len(ends), JOINED / 2)
        pairs = (pair for block in touching(places.reshape(-1, 3), radii) for pair in block)
        apart = (pair for pair in pairs if ends[pair[0]][0] != ends[pair[1]][0])
        return [
            self._closed(ends[first], ends[second])
            for first, second in sorted(map(tuple, islice(apart, MOST_FAULTS)))
        ]

    def _closed(self, first: tuple[int, str], second: tuple[int, str]) -> Fault:
        (i, port_i), (j, port_j) = first, second
        problem = (
            f"{self.parts[j].name!r} ({port_j}) ends where {self.parts[i].name!r} ({port_i}, "
            f"pipes.{i}) does, and is not joined to it"
        )
        return Fault(f"pipes.{j}", problem)


def attached(port: Pose, fitting: Fitting, enter: str, turn: float) -> Pose:
    """Pose of a fitting whose port ``enter`` is joined to a placed ``port`` (z outward), same
    frame.

    The x axes of the two ports coincide, then the fitting is turned by ``turn`` rad about the axis
    of ``port``. Seen
    from the other side the turn is the same: either of two ports may be the placed one.
    """
    rotation = port.rotation @ rotation_about([0, 0, 1], turn)
    entry = Pose(rotation * [1, -1, -1], port.position)  # the port looks back along the route
    return entry @ fitting.ports[enter].inverse()
