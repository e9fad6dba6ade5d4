"""Fittings joined port to port: placement, checks, routes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np

from omnitrack_sim.errors import Fault, GeometryError
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings import TEE_ARCS, Fitting, Reducer, Tee, TeeArcs
from omnitrack_sim.rotations import Array, Pose, rotation_about

SAMPLE_SPACING = 0.02
"""Spacing of the samples along the axis that overlaps are looked for with, m."""
OVERLAP = 1e-3
"""Depth by which two bores may share space unnoticed, m."""
JOINED = 1e-6
"""Distance within which two open ports are the same place, m."""
BORE_TOLERANCE = 1e-3
"""Difference of the diameters of joined bores that passes as manufacturing tolerance, m."""


@dataclass(frozen=True)
class Placed:
    """A fitting with its name and its pose in the world."""

    name: str
    fitting: Fitting
    pose: Pose

    def signed_distance(self, points: Array) -> tuple[Array, Array]:
        """As ``Fitting.signed_distance``, for points and gradient in the world frame."""
        distance, gradient = self.fitting.signed_distance(self.pose.inverse().apply(points))
        return distance, gradient @ self.pose.rotation.T

    def extent(self, points: Array) -> Array:
        """As ``Fitting.extent``, for points in the world frame."""
        return self.fitting.extent(self.pose.inverse().apply(points))

    def port(self, name: str) -> Pose:
        """A port in the world frame."""
        return self.pose @ self.fitting.ports[name]

    def axis(self, enter: str, leave: str, arcs: TeeArcs = TEE_ARCS) -> Centreline:
        """The axis curve from one port to another, world frame."""
        return Centreline(*_segments(self, enter, leave, arcs))

    def bore_samples(self) -> Array:
        """Points (k, 3) m on the fitting's axis curves and near its inner surface, world frame."""
        is_tee = isinstance(self.fitting, Tee)
        pairs = (
            [("run_start", "run_end"), ("branch", "run_end")]
            if is_tee
            else [tuple(self.fitting.ports)]
        )
        samples = []
        for enter, leave in pairs:
            line = self.axis(enter, leave, TeeArcs(self.fitting.radius, self.fitting.radius))
            s = np.linspace(0, line.length, max(2, int(np.ceil(line.length / SAMPLE_SPACING)) + 1))
            point, frame = line.at(s)[0], line.frame(s)
            around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
            radius = np.linspace(
                self.fitting.port_radius(enter), self.fitting.port_radius(leave), len(s)
            )
            ring = np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1)
            rings = 0.95 * radius[:, None, None] * np.einsum("sij,kj->ski", frame, ring)
            samples += [point, (point[:, None] + rings).reshape(-1, 3)]
        return np.concatenate(samples)

    def holds(self, points: Array, margin: float) -> bool:
        """Whether any of ``points`` (n, 3) m, world frame, lies in this bore by more than
        ``margin`` m."""
        inside = self.signed_distance(points)[0] > margin
        return bool((inside & (self.extent(points) > margin)).any())


@dataclass(frozen=True)
class PipeNetwork:
    """Placed fittings and which ports are joined: ((part, port), (part, port)) by index and name.

    Raises:
        GeometryError: joined bores whose diameters differ by more than ``BORE_TOLERANCE``, or parts
            that run into each other.
    """

    parts: tuple[Placed, ...]
    joints: tuple[tuple[tuple[int, str], tuple[int, str]], ...] = ()

    def __post_init__(self) -> None:
        faults = [*self._mismatches(), *self._overlaps(), *self._closures()]
        if faults:
            raise GeometryError(faults)

    @property
    def open_ends(self) -> tuple[tuple[int, str], ...]:
        """Ports that nothing is joined to, (part index, port name)."""
        taken = {end for joint in self.joints for end in joint}
        return tuple(
            (i, p)
            for i, part in enumerate(self.parts)
            for p in part.fitting.ports
            if (i, p) not in taken
        )

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
            value = np.where(extent >= -JOINED, distance, np.minimum(distance, extent))
            better = value > best
            best, gradient = (
                np.where(better, value, best),
                np.where(better[..., None], direction, gradient),
            )
        return best, gradient

    def _mismatches(self) -> list[Fault]:
        faults = []
        for (i, port_i), (j, port_j) in self.joints:
            a, b = self.parts[i], self.parts[j]
            bore_a, bore_b = 2 * a.fitting.port_radius(port_i), 2 * b.fitting.port_radius(port_j)
            if abs(bore_a - bore_b) > BORE_TOLERANCE + JOINED:
                key = (
                    "end_diameter"
                    if isinstance(b.fitting, Reducer) and port_j == "end"
                    else "inner_diameter"
                )
                problem = (
                    f"joins {a.name!r} ({port_i}) of {bore_a:.6g} m to {b.name!r} ({port_j}) of "
                    f"{bore_b:.6g} m; "
                    "a reducer joins bores of two sizes"
                )
                faults.append(Fault(f"pipes.{j}.{key}", problem))
        return faults

    def _overlaps(self) -> list[Fault]:
        joined = {frozenset((i, j)) for (i, _), (j, _) in self.joints}
        samples = [part.bore_samples() for part in self.parts]
        centres = np.array([(s.max(axis=0) + s.min(axis=0)) / 2 for s in samples])  # (P, 3) m
        extents = np.array(
            [np.linalg.norm(s - c, axis=1).max() for s, c in zip(samples, centres, strict=True)]
        )
        faults = []
        for i in range(len(self.parts)):
            apart = np.linalg.norm(centres - centres[i], axis=1)
            # The samples stand at 0.95 R: twice that room covers the bores themselves.
            room = extents + extents[i] + 0.1 * (self.parts[i].fitting.largest_radius + extents)
            for j in np.flatnonzero(apart < room).tolist():
                if j > i and frozenset((i, j)) not in joined:
                    self._overlap(i, j, samples, faults)
        return faults

    def _overlap(self, i: int, j: int, samples: list[Array], faults: list[Fault]) -> None:
        """Add the fault of two parts that share space."""
        a, b = self.parts[i], self.parts[j]
        if a.holds(samples[j], OVERLAP) or b.holds(samples[i], OVERLAP):
            faults.append(Fault(f"pipes.{j}", f"{b.name!r} runs into {a.name!r} (pipes.{i})"))

    def _closures(self) -> list[Fault]:
        """Open ends of two parts in one place: the pipe closes on itself without being joined."""
        faults = []
        for (i, port_i), (j, port_j) in combinations(self.open_ends, 2):
            a, b = self.parts[i], self.parts[j]
            if (
                i != j
                and np.linalg.norm(a.port(port_i).position - b.port(port_j).position) < JOINED
            ):
                problem = (
                    f"{b.name!r} ({port_j}) ends where {a.name!r} ({port_i}, pipes.{i}) does, and "
                    "is not joined to it"
                )
                faults.append(Fault(f"pipes.{j}", problem))
        return faults


@dataclass(frozen=True)
class Step:
    """One fitting of a route: entered at port ``enter``, left at ``leave``, turned by ``turn`` rad
    at the joint."""

    name: str
    fitting: Fitting
    enter: str
    leave: str
    turn: float = 0.0


@dataclass(frozen=True)
class Passage:
    """One fitting as it is passed, in arc length along the route.

    Attributes:
        index: of the part. kind, enter, leave: of the fitting and its ports. radius: bore radius at
            the entry, m.
        s_enter, s_leave: port planes, m.
        is_turn: the route bends here.
        s_bend_start, s_bend_end, bend_radius: of the centreline's arc, m; nan where it does not
            bend.
        opening: first and last arc length beside a tee's opening, m; nan elsewhere.
        turn_direction: (3,) unit vector at the entry, world frame: where the route bends to, or
            where the branch opens.
    """

    index: int
    kind: str
    enter: str
    leave: str
    radius: float
    s_enter: float
    s_leave: float
    is_turn: bool
    s_bend_start: float
    s_bend_end: float
    bend_radius: float
    opening: tuple[float, float]
    turn_direction: Array

    @property
    def asks_orientation(self) -> bool:
        """Whether it matters here how the robot is turned about its axis: in bends and tees."""
        return self.is_turn or self.kind == "tee"

    @property
    def span(self) -> tuple[float, float]:
        """Arc lengths, m, where the bend or, straight over a tee, the opening begins and ends; nan
        elsewhere."""
        return (self.s_bend_start, self.s_bend_end) if self.is_turn else self.opening


@dataclass(frozen=True)
class Route:
    """A way through a network: the network itself, its centreline and the fittings in order."""

    network: PipeNetwork
    centreline: Centreline
    fittings: tuple[Passage, ...]

    def bore_radius(self, s: Array) -> Array:
        """Bore radius (n,) m at arc lengths (n,) m along the centreline; beyond its ends that at
        the ends.

        Linear between the ports of each fitting; at a joint of two bores either of them.
        """
        return np.interp(s, *self._bore)

    @cached_property
    def _bore(self) -> tuple[Array, Array]:
        """Arc lengths (k,) m of all ports passed, and the bore radii there, m."""
        ends = [
            end for p in self.fittings for end in ((p, p.enter, p.s_enter), (p, p.leave, p.s_leave))
        ]
        radii = [self.network.parts[p.index].fitting.port_radius(port) for p, port, _ in ends]
        return np.array([s for _, _, s in ends]), np.array(radii)


def route(steps: Sequence[Step], start: Pose | None = None, arcs: TeeArcs = TEE_ARCS) -> Route:
    """Join fittings one after the other and lay the centreline through them.

    The x axes of joined ports coincide, then the new fitting is turned by ``Step.turn`` about the
    joint's axis: a chain of elbows without turns stays in one plane.

    Args:
        steps: at least one.
        start: frame of the first entry, z into the pipe; the world frame when not given.
        arcs: of the centreline in tees.

    Raises:
        GeometryError: unknown ports, a fitting left where it is entered, bores that do not fit,
            parts that overlap.
    """
    _check_ports(steps)
    frame = start or Pose()
    parts = []
    for step in steps:
        parts.append(
            Placed(step.name, step.fitting, attached(frame, step.fitting, step.enter, step.turn))
        )
        frame = parts[-1].port(step.leave)
    joints = tuple(((i, a.leave), (i + 1, b.enter)) for i, (a, b) in enumerate(pairwise(steps)))
    side = (start or Pose()).rotation @ rotation_about([0, 0, 1], steps[0].turn)[:, 0]
    way = [(i, step.enter, step.leave) for i, step in enumerate(steps)]
    return _through(PipeNetwork(tuple(parts), joints), way, side, arcs)


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


def route_through(
    network: PipeNetwork, way: Sequence[tuple[int, str, str]], arcs: TeeArcs = TEE_ARCS
) -> Route:
    """The route that passes through parts of a network in order; side branches stay part of
    ``Route.network``.

    Args:
        network: placed fittings.
        way: (part index, port it is entered at, port it is left at), each joined to the next.
        arcs: of the centreline in tees.
    """
    index, enter, _ = way[0]
    return _through(network, way, network.parts[index].port(enter).rotation[:, 0], arcs)


def _through(
    network: PipeNetwork, way: Sequence[tuple[int, str, str]], side: Array, arcs: TeeArcs
) -> Route:
    """Centreline and passages; ``side`` (3,) is the x axis of the frame at the start."""
    distance, segments, passages = 0.0, [], []
    for index, enter, leave in way:
        new, _ = _segments(network.parts[index], enter, leave, arcs)
        passages.append(_passage(index, network.parts[index].fitting, enter, leave, new, distance))
        distance += sum(s.length for s in new)
        segments.extend(new)
    return Route(network, Centreline(segments, side), tuple(passages))


def _check_ports(steps: Sequence[Step]) -> None:
    faults = [] if steps else [Fault("pipes", "a route needs at least one pipe")]
    for i, step in enumerate(steps):
        choices = step.fitting.choices
        for end in ("enter", "leave"):
            if getattr(step, end) not in choices:
                faults.append(
                    Fault(
                        f"pipes.{i}.{end}",
                        f"{step.fitting.kind} has no port {getattr(step, end)!r}",
                        choices,
                    )
                )
        if step.enter == step.leave:
            faults.append(
                Fault(
                    f"pipes.{i}.leave",
                    f"is {step.leave!r}, where the {step.fitting.kind} is entered",
                    choices,
                )
            )
    if faults:
        raise GeometryError(faults)


def _segments(part: Placed, enter: str, leave: str, arcs: TeeArcs) -> tuple[list[Segment], Array]:
    """The axis curve of a placed fitting in the world frame, and the side vector at its start."""
    path = part.fitting.path(enter, leave, arcs)
    turn = part.pose.rotation
    point, t, n = part.pose.apply(path.point), turn @ path.tangent, turn @ path.normal
    side, segments = n, []
    for length, k in path.segments:
        segments.append(Segment(length, k, point, t, n))
        if k == 0:
            point = point + length * t
        else:
            sin, cos = np.sin(length * k), np.cos(length * k)
            point = point + (t * sin + n * (1 - cos)) / k
            t, n = t * cos + n * sin, n * cos - t * sin
    return segments, side


def _passage(
    index: int, fitting: Fitting, enter: str, leave: str, segments: list[Segment], distance: float
) -> Passage:
    starts = distance + np.cumsum([0.0, *(s.length for s in segments)])
    bend = next((i for i, s in enumerate(segments) if s.curvature > 0), None)
    is_turn = bend is not None
    radius = fitting.port_radius(enter)
    opening = (np.nan, np.nan)
    if isinstance(fitting, Tee):
        # The opening is as wide as the branch, about the point where the axes meet.
        into = fitting.branch_length if enter == "branch" else fitting.run_length / 2
        opening = (distance + into - radius, distance + into + radius)
    return Passage(
        index=index,
        kind=fitting.kind,
        enter=enter,
        leave=leave,
        radius=radius,
        s_enter=distance,
        s_leave=float(starts[-1]),
        is_turn=is_turn,
        s_bend_start=float(starts[bend]) if bend is not None else np.nan,
        s_bend_end=float(starts[bend + 1]) if bend is not None else np.nan,
        bend_radius=1 / segments[bend].curvature if bend is not None else np.nan,
        opening=opening,
        turn_direction=segments[0].normal,
    )
