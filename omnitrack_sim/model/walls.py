"""Collision walls from primitives: boxes tangent to the bore, capsules along a tee's rim.

Every facet is shifted by half its sagitta, so that the exact surface lies midway between the
facet's nearest and farthest points; the shift halves the error for the same number of pieces.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from omnitrack_sim.model.collider.record import RECORD_SIZE, bounding_box, wall_record
from omnitrack_sim.pipes import Elbow, PipeNetwork, Reducer, Straight, Tee
from omnitrack_sim.pipes.assembly import JOINED
from omnitrack_sim.pipes.fittings import Fitting
from omnitrack_sim.rotations import Array, Pose, unit

THICKNESS = 0.010
"""Depth of the wall pieces, m: many times what a lug moves in a step."""
GROUP = 3
_SIDE_SLIP = 4e-4  # m, how far a piece of an elbow's side may leave its row


@dataclass
class Pieces:
    """Boxes and capsules in a fitting's frame."""

    boxes: list[tuple[Array, Array, Array]] = field(
        default_factory=list
    )  # centre, rotation, half sizes
    capsules: list[tuple[Array, Array, float]] = field(default_factory=list)  # two ends, radius

    def facet(
        self, point: Array, normal: Array, along: Array, half_width: float, half_length: float
    ) -> None:
        """A box whose inner face has its centre at ``point``, facing ``-normal``, with ``along``
        its length."""
        rotation = np.stack([normal, np.cross(along, normal), along], axis=-1)
        half = np.array([THICKNESS / 2, half_width, half_length])
        self.boxes.append((point + normal * THICKNESS / 2, rotation, half))


def stave_count(radius: float, tolerance: float) -> int:
    """Least number of staves, a multiple of 4, that keep within ``tolerance`` m of a bore of
    ``radius`` m."""
    # R (1 / cos(pi / N) - 1) / 2 <= tolerance
    exact = math.pi / math.acos(1 / (1 + 2 * tolerance / radius))
    return max(8, 4 * math.ceil(exact / 4))


def sagitta(radius: float, half_angle: float) -> float:
    """Distance, m, by which a chord's tangent leaves a circle of ``radius`` m after ``half_angle``
    rad."""
    return radius * (1 / math.cos(half_angle) - 1)


def add_walls(
    spec: mujoco.MjSpec, network: PipeNetwork, tolerance: float = 1e-4, staves: int | None = None
) -> int:
    """Add the walls of a network to the world body; returns the number of geoms.

    Args:
        spec: to add to. Geoms are named ``wall_<part>_<index>``, group 3, and collide with lugs
            only.
        network: placed fittings.
        tolerance: m, largest distance from the exact surface on all but tees. Within 10 mm of a
            tee's rim it is 0.5 mm at the default.
        staves: pieces around a bore, instead of what the tolerance asks for.
    """
    count = 0
    for part in network.parts:
        pieces = wall_pieces(part.fitting, tolerance, staves)
        for index, (centre, rotation, half) in enumerate(pieces.boxes):
            pose = part.pose @ Pose(rotation, centre)
            _add_geom(
                spec,
                f"wall_{part.name}_{index}",
                mujoco.mjtGeom.mjGEOM_BOX,
                size=half,
                pos=pose.position,
                quat=pose.quaternion,
            )
        for index, (a, b, radius) in enumerate(pieces.capsules):
            ends = [*part.pose.apply(a), *part.pose.apply(b)]
            _add_geom(
                spec,
                f"rim_{part.name}_{index}",
                mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[radius, 0, 0],
                fromto=ends,
            )
        count += len(pieces.boxes) + len(pieces.capsules)
    return count


def add_exact_walls(spec: mujoco.MjSpec, network: PipeNetwork) -> int:
    """Add one geom a fitting to the world body, for the compiled collider; returns their number.

    Each is a height field, of which only the box around the bore and the user data count, which say
    what it is.
    """
    spec.nuser_geom = RECORD_SIZE
    taken = {end: other for a, b in network.joints for end, other in ((a, b), (b, a))}
    for index, part in enumerate(network.parts):
        ends = [
            _line_ends(network, (index, port), taken.get((index, port)))
            for port in part.fitting.ports
        ]
        centre, half = bounding_box(part.fitting)
        pose = part.pose @ Pose(np.eye(3), centre)
        name = f"wall_{part.name}"
        spec.add_hfield(
            name=name,
            nrow=2,
            ncol=2,
            size=[half[0], half[1], half[2], half[2]],
            userdata=[0, 0, 1, 1],
        )
        _add_geom(
            spec,
            name,
            mujoco.mjtGeom.mjGEOM_HFIELD,
            hfieldname=name,
            pos=pose.position,
            quat=pose.quaternion,
            userdata=wall_record(part.fitting, tuple(ends)),
        )
    return len(network.parts)


def _line_ends(network: PipeNetwork, end: tuple[int, str], other: tuple[int, str] | None) -> bool:
    """Whether the wall stops carrying a track at port ``end``, which is joined to ``other`` or to
    nothing."""
    if other is None:
        return True
    mine, theirs = (network.parts[index].fitting for index, _ in (end, other))
    bore, next_bore = mine.port_radius(end[1]), theirs.port_radius(other[1])
    # An elbow bends away, a reducer's cone has a kink. At its narrow end that is a convex edge,
    # which the collider finds by itself.
    at_kink = isinstance(theirs, Elbow | Reducer) or (
        isinstance(mine, Reducer) and bore == mine.largest_radius
    )
    return at_kink or abs(bore - next_bore) > JOINED


def add_plates(
    spec: mujoco.MjSpec,
    network: PipeNetwork,
    plates: Sequence[tuple[int, str]],
    looks: bool = False,
) -> None:
    """Close ports (part index, port name) by plates that collide with lugs; they are seen in
    pictures.

    With ``looks`` they are as round as the bore; otherwise square, which touches faster and goes
    into the wall.
    """
    for index, port in plates:
        part = network.parts[index]
        pose, radius = part.port(port), part.fitting.port_radius(port)
        spec.worldbody.add_geom(
            name=f"plate_{part.name}_{port}",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER if looks else mujoco.mjtGeom.mjGEOM_BOX,
            size=[radius, PLATE_THICKNESS / 2, 0.0]
            if looks
            else [radius, radius, PLATE_THICKNESS / 2],
            pos=pose.position,
            quat=pose.quaternion,
            contype=2,
            conaffinity=1,
            group=PLATE_GROUP,
            rgba=PLATE_COLOUR,
        )


PLATE_GROUP, PLATE_COLOUR = 2, [0.72, 0.22, 0.18, 1.0]
PLATE_THICKNESS = 0.006
"""Of a plate that closes a pipe, m; assumed."""


def _add_geom(spec: mujoco.MjSpec, name: str, kind: mujoco.mjtGeom, **shape: object) -> None:
    spec.worldbody.add_geom(
        name=name, type=kind, group=GROUP, contype=2, conaffinity=1, rgba=WALL_COLOUR, **shape
    )


WALL_COLOUR = [0.62, 0.66, 0.70, 0.25]


def wall_pieces(fitting: Fitting, tolerance: float, staves: int | None = None) -> Pieces:
    """Boxes and capsules of one fitting, in its frame."""
    pieces = Pieces()
    if isinstance(fitting, Straight):
        _add_straight(pieces, fitting, staves or stave_count(fitting.radius, tolerance))
    elif isinstance(fitting, Reducer):
        _add_reducer(pieces, fitting, staves or stave_count(fitting.largest_radius, tolerance))
    elif isinstance(fitting, Elbow):
        # Half of the tolerance for the facets around, half for those along.
        _add_elbow(pieces, fitting, staves or stave_count(fitting.radius, tolerance / 2), tolerance)
    elif isinstance(fitting, Tee):
        _add_tee(pieces, fitting, staves or stave_count(fitting.radius, tolerance))
    return pieces


@dataclass(frozen=True)
class _Ring:
    """N staves around a bore: their azimuths, the distance of their faces and their half width at
    the back."""

    azimuths: Array
    face: float
    half_width: float

    @classmethod
    def of(cls, radius: float, staves: int) -> _Ring:
        face = radius - sagitta(radius, math.pi / staves) / 2
        width = (face + THICKNESS) * math.tan(math.pi / staves)
        return cls(2 * np.pi * np.arange(staves) / staves, face, width)


def _add_straight(pieces: Pieces, pipe: Straight, staves: int) -> None:
    ring = _Ring.of(pipe.radius, staves)
    for u in ring.azimuths:
        out = np.array([math.cos(u), math.sin(u), 0.0])
        pieces.facet(
            ring.face * out + [0, 0, pipe.length / 2],
            out,
            np.array([0, 0, 1.0]),
            ring.half_width,
            pipe.length / 2,
        )


def _add_reducer(pieces: Pieces, reducer: Reducer, staves: int) -> None:
    """Staves tangent to the cone, as wide as its wide end asks for."""
    ring, slope = _Ring.of(reducer.largest_radius, staves), reducer.slope
    shift = reducer.largest_radius - ring.face
    # The ends of the staves stand square to the cone: at the wide end they go on behind the wall of
    # the next pipe as far as their backs need to close the wedge; at the narrow end they would come
    # out into its bore.
    overlap = THICKNESS * abs(slope)
    half_length = (reducer.length * math.hypot(1.0, slope) + overlap) / 2
    for u in ring.azimuths:
        out = np.array([math.cos(u), math.sin(u), 0.0])
        along, normal = unit(slope * out + [0, 0, 1]), unit(out - slope * np.array([0, 0, 1.0]))
        middle = (reducer.radius + slope * reducer.length / 2) * out + [0, 0, reducer.length / 2]
        centre = middle - shift * normal + math.copysign(overlap / 2, slope) * along
        pieces.facet(centre, normal, along, ring.half_width, half_length)


def _add_elbow(pieces: Pieces, elbow: Elbow, staves: int, tolerance: float) -> None:
    """Rows of boxes along the bend, each row as fine as its own distance from the bend's axis asks
    for."""
    ring = _Ring.of(elbow.radius, staves)
    along_tolerance = max(
        0.8 * tolerance - sagitta(elbow.radius, math.pi / staves) / 2, tolerance / 4
    )
    for u in ring.azimuths:
        from_axis = elbow.mean_radius - ring.face * math.cos(u)
        # The facet leaves the surface by its sagitta times the part that points across it; the rest
        # slips sideways.
        least = min(2 * along_tolerance / max(abs(math.cos(u)), 1e-9), _SIDE_SLIP)
        step = 2 * math.acos(1 / (1 + least / max(from_axis, 1e-6)))
        count = max(2, math.ceil(elbow.angle / step))
        half = elbow.angle / count / 2
        shift = sagitta(from_axis, half) * math.cos(u) / 2
        back = from_axis - THICKNESS * math.cos(u)
        # Long enough for the edge that is farthest from the bend's axis; outer facets also for
        # their backs.
        widest = max(from_axis + abs(shift), back) + ring.half_width * abs(math.sin(u))
        half_length = widest * math.tan(half)
        for j in range(count):
            a = (2 * j + 1) * half
            inward, along = (
                np.array([math.cos(a), 0, -math.sin(a)]),
                np.array([math.sin(a), 0, math.cos(a)]),
            )
            out = math.cos(u) * inward + math.sin(u) * np.array([0, 1.0, 0])
            centre = elbow.mean_radius * (np.array([1.0, 0, 0]) - inward)
            pieces.facet(
                centre + (ring.face + shift) * out,
                out,
                along,
                ring.half_width,
                max(half_length, 1e-5),
            )


RIM_SEGMENTS = 32
"""Capsules along each half of a tee's rim."""
RIM_STRIP = 0.006
"""Width of one strip of boxes along the rim, m; two strips fill what the square-ended staves leave
open."""


def _add_tee(pieces: Pieces, tee: Tee, staves: int) -> None:
    """Staves of run and branch up to the rim's fillet, strips of boxes along it, capsules as the
    fillet itself."""
    ring = _Ring.of(tee.radius, staves)
    rho = tee.radius + tee.fillet_radius
    half_angle = math.pi / staves
    run, branch = tee.run_length / 2, tee.branch_length
    z, x = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    for u in ring.azimuths:
        out = np.array([math.cos(u), math.sin(u), 0.0])
        edges = np.cos([u - half_angle, u, u + half_angle])
        if edges.max() <= 1e-9:
            pieces.facet(ring.face * out, out, z, ring.half_width, run)
        else:
            cut = rho * edges.max()
            for side in (1, -1):
                pieces.facet(
                    ring.face * out + side * z * (run + cut) / 2,
                    out,
                    z,
                    ring.half_width,
                    (run - cut) / 2,
                )
        out = np.array([0.0, math.sin(u), math.cos(u)])
        cut = rho * np.abs(edges).max()
        pieces.facet(
            ring.face * out + x * (branch + cut) / 2, out, x, ring.half_width, (branch - cut) / 2
        )
    for side in (1.0, -1.0):
        # Where the halves of the rim meet the wall is flat: run and branch share their tangent
        # plane.
        pieces.facet(
            side * (tee.radius + 5e-5) * np.array([0, 1.0, 0]),
            np.array([0, side, 0]),
            z,
            CROTCH_PATCH,
            CROTCH_PATCH,
        )
    _add_rim(pieces, tee, rho)


def _add_rim(pieces: Pieces, tee: Tee, rho: float) -> None:
    t = np.linspace(-np.pi / 2, np.pi / 2, RIM_SEGMENTS + 1)
    for side in (1.0, -1.0):
        saddle = rho * np.stack([np.cos(t), np.sin(t), side * np.cos(t)], axis=-1)
        for a, b in itertools.pairwise(saddle):
            pieces.capsules.append((a, b, tee.fillet_radius))
        run_edge = np.stack(
            [tee.radius * np.cos(t), tee.radius * np.sin(t), side * rho * np.cos(t)], axis=-1
        )
        branch_edge = np.stack(
            [rho * np.cos(t), tee.radius * np.sin(t), side * tee.radius * np.cos(t)], axis=-1
        )
        _add_strips(pieces, run_edge, np.array([0, 0, side]), np.array([1.0, 1.0, 0]), tee.radius)
        _add_strips(pieces, branch_edge, np.array([1.0, 0, 0]), np.array([0, 1.0, 1.0]), tee.radius)


CROTCH_PATCH = 0.007
"""Half width of the flat pieces where the two halves of the rim meet, m."""


def _add_strips(pieces: Pieces, edge: Array, away: Array, across: Array, radius: float) -> None:
    """Boxes along the line ``edge`` (k, 3) where the fillet begins, tangent to the cylinder, on its
    ``away`` side.

    ``across`` keeps the coordinates across the cylinder's axis.
    """
    for a, b in itertools.pairwise(edge):
        middle = (a + b) / 2
        out = unit(middle * across)
        tangent = unit((b - a) - out * ((b - a) @ out))
        beyond = np.cross(out, tangent)
        beyond = beyond if beyond @ away > 0 else -beyond
        half_length = 0.6 * float(np.linalg.norm(b - a))
        for strip in range(2):
            point = middle + beyond * RIM_STRIP * (strip + 0.5)
            normal = unit(point * across)
            bent = sagitta(radius, math.hypot(RIM_STRIP / 2, half_length) / radius / math.sqrt(2))
            face = point * (1 - across) + normal * (radius - bent / 2)
            along = unit(tangent - normal * (tangent @ normal))
            pieces.facet(face, normal, along, 0.5 * RIM_STRIP, half_length)
