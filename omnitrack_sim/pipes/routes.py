"""Routes through joined fittings: the passages in order, and the centreline through them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.base.rotations import Array, Pose, rotation_about
from omnitrack_sim.pipes.assembly import Assembly, Part, attached
from omnitrack_sim.pipes.centreline import Centreline, Segment
from omnitrack_sim.pipes.fittings.base import ARCS, Arcs, Fitting, Manoeuvre


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
            the entry, m. corner_radius: the larger bore radius of both ports, m.
        s_enter, s_leave: port planes, m.
        s_bend_start, s_bend_end, bend_radius: of the centreline's arc, m; nan where it does not
            bend. Of several arcs the first one's start, the last one's end, the least radius.
        opening: first and last arc length beside a branch's opening, m; nan elsewhere.
        turn_direction: (3,) unit vector at the entry, world frame: where the route bends to, or
            where the branch opens.
        words, manoeuvre, into_branch, out_of_branch, turn_angle: see
            ``pipes.fittings.Description``.
    """

    index: int
    kind: str
    enter: str
    leave: str
    radius: float
    corner_radius: float
    s_enter: float
    s_leave: float
    s_bend_start: float
    s_bend_end: float
    bend_radius: float
    opening: tuple[float, float]
    turn_direction: Array
    words: str
    manoeuvre: Manoeuvre | None
    into_branch: bool
    out_of_branch: bool
    turn_angle: float

    @property
    def is_turn(self) -> bool:
        """Whether the route bends here."""
        return not np.isnan(self.bend_radius)

    @property
    def asks_orientation(self) -> bool:
        """Whether it matters here how the robot is turned about its axis: in bends and tees."""
        return self.manoeuvre is not None

    @property
    def span(self) -> tuple[float, float]:
        """Arc lengths, m, where the bend or, straight over an opening, the opening begins and ends;
        nan elsewhere."""
        return (self.s_bend_start, self.s_bend_end) if self.is_turn else self.opening

    @property
    def mark(self) -> float:
        """Arc length, m, of what a robot sees first: an opening's near edge or a bend's start; nan
        without either."""
        return self.s_bend_start if np.isnan(self.opening[0]) else self.opening[0]


@dataclass(frozen=True)
class Route:
    """A way through a network: the network itself, its centreline and the fittings in order."""

    network: Assembly
    centreline: Centreline
    fittings: tuple[Passage, ...]

    def __repr__(self) -> str:
        return f"Route({len(self.fittings)} fittings, {self.centreline.length:.6g} m)"

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
    side = (start or Pose()).rotation @ rotation_about([0, 0, 1], steps[0].turn)[:, 0]
    way = [(i, step.enter, step.leave) for i, step in enumerate(steps)]
    return _through(Assembly(tuple(parts), joints), way, side, arcs)


def route_through(
    network: Assembly, way: Sequence[tuple[int, str, str]], arcs: Arcs = ARCS
) -> Route:
    """The route that passes through parts of a network in order; side branches stay part of
    ``Route.network``.

    Args:
        network: joined parts.
        way: (part index, port it is entered at, port it is left at), each joined to the next.
        arcs: of the centreline round corners.
    """
    index, enter, _ = way[0]
    return _through(network, way, network.parts[index].port(enter).rotation[:, 0], arcs)


def _through(
    network: Assembly, way: Sequence[tuple[int, str, str]], side: Array, arcs: Arcs
) -> Route:
    """Centreline and passages; ``side`` (3,) is the x axis of the frame at the start."""
    distance, segments, passages = 0.0, [], []
    for index, enter, leave in way:
        part = network.parts[index]
        new = part.segments(part.fitting.axis_curve(enter, leave, arcs))
        passages.append(_passage(index, part.fitting, enter, leave, new, distance))
        distance += sum(s.length for s in new)
        segments.extend(new)
    return Route(network, Centreline(segments, side), tuple(passages))


def _check_ports(steps: Sequence[Step]) -> None:
    faults = [] if steps else [Fault("pipes", "a route needs at least one pipe")]
    for i, step in enumerate(steps):
        choices = step.fitting.port_names
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


def _passage(
    index: int, fitting: Fitting, enter: str, leave: str, segments: list[Segment], distance: float
) -> Passage:
    told = fitting.describe(enter, leave)
    starts = distance + np.cumsum([0.0, *(s.length for s in segments)])
    bends = [i for i, s in enumerate(segments) if s.curvature > 0]
    opening = (np.nan, np.nan)
    if told.opening is not None:
        middle, half = told.opening
        opening = (distance + middle - half, distance + middle + half)
    return Passage(
        index=index,
        kind=fitting.kind,
        enter=enter,
        leave=leave,
        radius=fitting.port_radius(enter),
        corner_radius=max(fitting.port_radius(enter), fitting.port_radius(leave)),
        s_enter=distance,
        s_leave=float(starts[-1]),
        s_bend_start=float(starts[bends[0]]) if bends else np.nan,
        s_bend_end=float(starts[bends[-1] + 1]) if bends else np.nan,
        bend_radius=1 / max(segments[i].curvature for i in bends) if bends else np.nan,
        opening=opening,
        turn_direction=segments[0].normal,
        words=told.words,
        manoeuvre=told.manoeuvre,
        into_branch=told.into_branch,
        out_of_branch=told.out_of_branch,
        turn_angle=told.turn_angle,
    )
