"""Routes through joined fittings: the passages in order, and the centreline through them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from math import inf, nan

import numpy as np

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array, Pose, rotation_about
from omnitrack_sim.pipes.assembly import Assembly, Part, attached
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings.base import (
    ARCS,
    Arcs,
    AxisCurve,
    Description,
    Fitting,
    Manoeuvre,
)

Edge = tuple[int, str, str]
"""A part from one port to another, an edge of the graph of ports: index, port entered, port
left."""


@dataclass(frozen=True)
class Step:
    """One fitting of a route that ``route`` joins.

    Attributes:
        name: of the part.
        fitting: its kind and sizes.
        enter: port by which it is entered.
        leave: port by which it is left.
        turn: rad, by which it is turned at the joint.

    Example:
        >>> import omnitrack_sim as ot
        >>> ot.Step("knee", ot.Elbow(0.24), enter="start", leave="end").fitting.kind
        'elbow'
    """

    name: str
    fitting: Fitting
    enter: str
    leave: str
    turn: float = 0.0


@dataclass(frozen=True, eq=False)
class Passage:
    """A part as it is passed, in arc length along a route.

    Attributes:
        part: the part.
        index: its number in the network.
        enter: port by which it is entered.
        leave: port by which it is left.
        curve: its axis between the two ports, fitting frame.
        description: what it means to pass it so.
        s_enter: m, where the port plane is by which it is entered.
    """

    part: Part
    index: int
    enter: str
    leave: str
    curve: AxisCurve
    description: Description
    s_enter: float = 0.0

    @classmethod
    def of(cls, network: Assembly, edge: Edge, arcs: Arcs = ARCS) -> Passage:
        """Return an edge of the graph of ports as a passage that begins at 0."""
        index, enter, leave = edge
        part = network.parts[index]
        curve = part.fitting.axis_curve(enter, leave, arcs)
        return cls(part, index, enter, leave, curve, part.fitting.describe(enter, leave))

    def at(self, s_enter: float) -> Passage:
        """Return the same passage, entered at arc length ``s_enter`` m."""
        return replace(self, s_enter=s_enter)

    @property
    def edge(self) -> Edge:
        """The passage as an edge of the graph of ports."""
        return self.index, self.enter, self.leave

    @property
    def kind(self) -> str:
        """Kind of the fitting."""
        return self.part.fitting.kind

    @property
    def radius(self) -> float:
        """Bore radius at the entry, m."""
        return self.part.fitting.port_radius(self.enter)

    @property
    def corner_radius(self) -> float:
        """The larger bore radius of both ports, m."""
        return max(self.radius, self.part.fitting.port_radius(self.leave))

    @property
    def length(self) -> float:
        """Length of the axis, m."""
        return self.curve.length

    @property
    def s_leave(self) -> float:
        """Arc length, m, of the port plane by which it is left."""
        return self._joints[-1]

    @cached_property
    def _joints(self) -> list[float]:
        """Arc lengths, m, where lines and arcs begin, and where the last one ends."""
        lengths = (length for length, _ in self.curve.segments)
        return [float(self.s_enter + s) for s in accumulate(lengths, initial=0.0)]

    @cached_property
    def _arcs(self) -> list[int]:
        """Numbers of the segments that bend."""
        return [i for i, (_, curvature) in enumerate(self.curve.segments) if curvature != 0]

    @property
    def s_bend_start(self) -> float:
        """Arc length, m, where the first arc begins; nan where the route does not bend."""
        return self._joints[self._arcs[0]] if self._arcs else nan

    @property
    def s_bend_end(self) -> float:
        """Arc length, m, where the last arc ends; nan where the route does not bend."""
        return self._joints[self._arcs[-1] + 1] if self._arcs else nan

    @property
    def bend_radius(self) -> float:
        """Least radius of the arcs, m; nan where the route does not bend."""
        # The least radius is where the curvature is largest; nan stays nan.
        return 1 / max((abs(self.curve.segments[i][1]) for i in self._arcs), default=nan)

    @property
    def opening(self) -> tuple[float, float]:
        """First and last arc length beside a branch's opening, m; nan elsewhere."""
        middle, half = self.description.opening or (nan, nan)
        return self.s_enter + middle - half, self.s_enter + middle + half

    @property
    def turn_direction(self) -> Array:
        """Unit vector (3,) at the entry, world frame, to where the route bends or a branch is."""
        return self.part.pose.rotation @ self.curve.normal

    def depth(self, points: Array) -> Array:
        """Return the depth (...,) m of ``points`` (..., 3) m in the bore that is passed.

        World frame; see ``Fitting.depth_between``.
        """
        own = self.part.pose.inverse().apply(points)
        return self.part.fitting.depth_between(self.enter, self.leave, own)

    @property
    def words(self) -> str:
        """The passage in words; see ``pipes.fittings.Description``."""
        return self.description.words

    @property
    def manoeuvre(self) -> Manoeuvre | None:
        """Manoeuvre that a robot needs; None where it drives on as it is."""
        return self.description.manoeuvre

    @property
    def is_turn(self) -> bool:
        """The route bends here."""
        return bool(self._arcs)

    @property
    def asks_orientation(self) -> bool:
        """It matters how the robot is turned about its axis: in bends and tees."""
        return self.description.manoeuvre is not None

    @cached_property
    def span(self) -> tuple[float, float]:
        """Arc lengths, m, where the bend or opening that is passed begins and ends, or nan."""
        return (self.s_bend_start, self.s_bend_end) if self._arcs else self.opening

    @property
    def s_prepared(self) -> float:
        """Arc length, m, by which a robot has to be prepared for the passage.

        It is where its bend or opening begins or, where any orientation will do, where it is left.
        """
        return self.span[0] if self.asks_orientation else self.s_leave

    @property
    def mark(self) -> float:
        """Arc length, m, of what a robot sees first: an opening's near edge or a bend's start.

        It is nan without either.
        """
        return self.s_bend_start if np.isnan(self.opening[0]) else self.opening[0]


@dataclass(frozen=True, eq=False)
class Route:
    """Passages through a network in order, with the centreline through them.

    Attributes:
        network: all parts, side branches included.
        passages: each begins where the one before it ends.
        side: (3,) x axis of the frame at the start, world frame; None: that of the first port.

    Example:
        >>> import omnitrack_sim as ot
        >>> route = ot.load_scenario("tee_turn").route
        >>> [passage.words for passage in route.passages]
        ['straight', 'run to branch', 'straight']
    """

    network: Assembly
    passages: tuple[Passage, ...]
    side: Array | None = None

    @classmethod
    def of(cls, network: Assembly, passages: Iterable[Passage], side: Array | None = None) -> Route:
        """Return a route of ``passages``, each moved to begin where the one before it ends."""
        placed, distance = [], 0.0
        for passage in passages:
            placed.append(passage.at(distance))
            distance += passage.length
        return cls(network, tuple(placed), side)

    def __repr__(self) -> str:
        return f"Route({len(self.passages)} passages, {self.length:.6g} m)"

    @property
    def length(self) -> float:
        """Arc length of the centreline, m."""
        # Added up piece by piece, as the centreline does, so that both are equal to the last bit.
        return sum(length for p in self.passages for length, _ in p.curve.segments)

    @property
    def segments(self) -> list[Segment]:
        """Lines and arcs of the centreline, in order."""
        return [s for p in self.passages for s in p.part.segments(p.curve)]

    @cached_property
    def centreline(self) -> Centreline:
        """The centreline through all passages."""
        first = self.passages[0]
        side = first.part.port(first.enter).rotation[:, 0] if self.side is None else self.side
        return Centreline(self.segments, side)

    def index_at(self, s: float) -> int:
        """Return the number of the passage at arc length ``s`` m; beyond the end the last one."""
        # At a joint the passage that begins there counts.
        ahead = (i for i, passage in enumerate(self.passages) if s < passage.s_leave)
        return next(ahead, len(self.passages) - 1)

    def cleared(self, index: int) -> float:
        """Return the arc length, m, where the last bend or opening up to passage ``index`` ends.

        It is minus infinity without one.
        """
        before = (p for p in self.passages[index::-1] if p.asks_orientation)
        return next((p.span[1] for p in before), -inf)


def route(steps: Sequence[Step], start: Pose | None = None, arcs: Arcs = ARCS) -> Route:
    """Join fittings one after the other and lay the centreline through them.

    The x axes of joined ports coincide, then the new fitting is turned by ``Step.turn`` about the
    joint's axis: a chain of elbows without turns stays in one plane.

    Args:
        steps: at least one.
        start: frame of the first entry, z into the pipe; the world frame when not given.
        arcs: of the centreline round corners.

    Raises:
        GeometryError: unknown ports, a fitting left where it is entered, bores that do not fit,
            parts that overlap.

    Example:
        >>> import omnitrack_sim as ot
        >>> steps = [
        ...     ot.Step("inlet", ot.Straight(0.5), "start", "end"),
        ...     ot.Step("knee", ot.Elbow(0.24), "start", "end"),
        ... ]
        >>> round(ot.route(steps).length, 3)
        0.877
    """
    _check_ports(steps)
    frame = start or Pose()
    parts = []
    for step in steps:
        parts.append(
            Part(step.name, step.fitting, attached(frame, step.fitting, step.enter, step.turn))
        )
        frame = parts[-1].port(step.leave)
    joints = tuple(((i, a.leave), (i + 1, b.enter)) for i, (a, b) in enumerate(pairwise(steps)))
    network = Assembly(tuple(parts), joints)
    # The first fitting's turn must not turn the route's frame away from the entry's x axis.
    side = (start or Pose()).rotation @ rotation_about([0, 0, 1], steps[0].turn)[:, 0]
    edges = [(i, step.enter, step.leave) for i, step in enumerate(steps)]
    return Route.of(network, [Passage.of(network, edge, arcs) for edge in edges], side)


def route_through(network: Assembly, path: Iterable[Edge], arcs: Arcs = ARCS) -> Route:
    """Return the route along a path through parts of a network.

    Side branches stay part of ``Route.network``.

    Args:
        network: joined parts.
        path: edges of the graph of ports, each joined to the next.
        arcs: of the centreline round corners.
    """
    return Route.of(network, [Passage.of(network, edge, arcs) for edge in path])


def _check_ports(steps: Sequence[Step]) -> None:
    faults = [] if steps else [Fault("pipes", "a route needs at least one pipe")]
    for i, step in enumerate(steps):
        kind, choices = step.fitting.kind, step.fitting.port_names
        for end, port in (("enter", step.enter), ("leave", step.leave)):
            if port not in choices:
                faults.append(Fault(f"pipes.{i}.{end}", f"{kind} has no port {port!r}", choices))
        if step.enter == step.leave:
            problem = f"is {step.leave!r}, where the {kind} is entered"
            faults.append(Fault(f"pipes.{i}.leave", problem, choices))
    if faults:
        raise GeometryError(faults)
