"""Pipes as geoms of a MuJoCo model: wall pieces or one exact wall a fitting, and closing plates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Assembly, Port
from omnitrack_sim.pipes.assembly import JOINED
from omnitrack_sim.pipes.obstacles import corners_of
from omnitrack_sim.pipes.shapes import Pieces
from omnitrack_sim.walls.record import (
    DEPTH_IN_BORE,
    RECORD_SIZE,
    bounding_box,
    has_record,
    obstacle_record,
    plate_record,
    wall_record,
)
from omnitrack_sim.walls.rims import OPEN, rim_record, section_rim_record

TIMESTEP = 0.002
"""Default physics step, s."""
IMPEDANCE_RATIO = 10.0
"""Stiffness of friction against that of normal contact: creep of 6e-6 m/s for a climbing robot
instead of 6e-5 at 1."""


MUJOCOS_LOG = "MUJOCO_LOG.TXT"
"""File in the working folder to which MuJoCo adds every warning by default."""


def leave_no_log() -> None:
    """Keep MuJoCo from leaving its log in the working folder, in all threads of this process.

    Warnings are counted and go to standard error as before. A log under another name, which
    somebody has asked for, stays.
    """
    config = mujoco.MjLogConfig.get()
    if config.logto_file and config.logfile == MUJOCOS_LOG:
        config.logto_file = False
        config.set()


def new_spec(name: str) -> mujoco.MjSpec:
    """Return an empty model with the project's numerics; every model of the package begins here.

    Radians, elliptic cones, implicitfast, dense Jacobian.
    """
    leave_no_log()
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    set_numerics(spec.option)
    return spec


def set_numerics(option: mujoco.MjOption) -> None:
    """Set the options of contacts and integration that the package's own models have."""
    # A pyramidal cone would raise the slip by half, and its friction depends on the direction.
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # MuJoCo 4.0.0's sparse Hessian is wrong from 60 dofs on.
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.impratio = IMPEDANCE_RATIO


GROUP = 3


def add_walls(
    spec: mujoco.MjSpec, network: Assembly, tolerance: float = 1e-4, staves: int | None = None
) -> int:
    """Add the walls of a network to the world body; returns the number of geoms.

    Args:
        spec: to add to. Geoms are named ``wall_<part>_<index>``, group 3, and collide with lugs
            only.
        network: joined parts.
        tolerance: m, largest distance from the exact surface on all but tees. Within 10 mm of a
            tee's rim it is 0.5 mm at the default.
        staves: pieces around a bore, instead of what the tolerance asks for.
    """
    count = 0
    for part in network.parts:
        pieces = Pieces()
        part.fitting.add_walls(pieces, tolerance, staves)
        for index, (centre, rotation, half) in enumerate(pieces.boxes):
            pose = part.pose @ Pose(rotation, centre)
            _add_geom(
                spec.worldbody,
                f"wall_{part.name}_{index}",
                mujoco.mjtGeom.mjGEOM_BOX,
                size=half,
                pos=pose.position,
                quat=pose.quaternion,
            )
        for index, (a, b, radius) in enumerate(pieces.capsules):
            ends = [*part.pose.apply(a), *part.pose.apply(b)]
            _add_geom(
                spec.worldbody,
                f"rim_{part.name}_{index}",
                mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[radius, 0, 0],
                fromto=ends,
            )
        count += len(pieces.boxes) + len(pieces.capsules)
    return count


SHARP, RIM_ROOM = 1e-6, 0.01
"""Turn of a wall, m/m, from which on it has an edge; and half height of the box around an edge,
radii."""
MIN_ROOM = 0.002
"""Of the bounding box around a bore, m: deeper than any lug presses."""


def add_exact_walls(
    spec: mujoco.MjSpec,
    network: Assembly,
    depths: Sequence[float] | None = None,
    ends: Mapping[Port, float] | None = None,
    body: mujoco.MjsBody | None = None,
    deposits: Mapping[str, Any] | None = None,
    **attributes: Any,
) -> int:
    """Add one geom a fitting to a body, for the compiled collider; returns their number.

    Each is a height field, of which only the box around the bore and the user data count, which say
    what it is. Geoms are named ``wall_<part>``. What stands on the walls follows, see
    ``_add_obstacles``.

    Args:
        spec: to add to. User data of the robot's own stay, before the records.
        network: joined parts.
        depths: m, to which the wall of each part is solid towards other bores, for geoms without a
            record of their own; None: there are no such geoms.
        ends: m, to which closed ports are solid; with ``depths``.
        body: whose frame the network stands in; None: the world.
        deposits: attributes of those with a friction of their own, in the place of the others'.
        attributes: of the geoms, by MuJoCo's names, in the place of those of ``_add_geom``.
    """
    rows = [geom.userdata for geom in spec.geoms]
    if not any(has_record(row) for row in rows):
        spec.nuser_geom = max([spec.nuser_geom, 0, *map(len, rows)]) + RECORD_SIZE
    before = np.zeros(spec.nuser_geom - RECORD_SIZE)
    # Both directions of each joint, so that the neighbour of any port is one look-up away.
    taken = {end: other for a, b in network.joints for end, other in ((a, b), (b, a))}
    for index, part in enumerate(network.parts):
        stops = [
            _line_ends(network, (index, port), taken.get((index, port)), rims=depths is not None)
            for port in part.fitting.ports
        ]
        depth = MIN_ROOM if depths is None else depths[index]
        # A body that sinks into a plate must not leave the wall beside it.
        behind = [(ends or {}).get((index, port), 0.0) for port in part.fitting.closed_ports]
        fitting = part.fitting.extended(max(behind)) if behind else part.fitting
        # Thin is a wall towards another bore only: its box does not end there.
        room = MIN_ROOM if depths is None else DEPTH_IN_BORE * fitting.max_radius
        centre, half = bounding_box(fitting, room)
        pose = part.pose @ Pose(np.eye(3), centre)
        own = wall_record(fitting, tuple(stops), depth, index, len(network.parts))
        record = np.append(before, own)
        _add_field(spec, body, f"wall_{part.name}", half, pose, record, attributes)
    _add_obstacles(spec, network, depths, body, deposits, **attributes)
    return len(network.parts)


def _add_obstacles(
    spec: mujoco.MjSpec,
    network: Assembly,
    depths: Sequence[float] | None,
    body: mujoco.MjsBody | None,
    deposits: Mapping[str, Any] | None,
    **attributes: Any,
) -> None:
    """Add a geom ``relief_<part>_<index>`` for each solid on a wall; see ``add_exact_walls``.

    Those with a friction of their own are ``deposit_<part>_<index>``.
    """
    before = np.zeros(spec.nuser_geom - RECORD_SIZE)
    for number, part in enumerate(network.parts):
        radius = part.fitting.max_radius
        limit = radius + (MIN_ROOM if depths is None else depths[number])
        for index, solid in enumerate(part.fitting.obstacles):
            low, high = corners_of(solid)
            frame = part.pose @ solid.pose(part.fitting.axis_frame(solid.s))
            pose, half = frame @ Pose(np.eye(3), (low + high) / 2), (high - low) / 2 + MIN_ROOM
            record = np.append(before, obstacle_record(solid, radius, limit))
            name, given = f"relief_{part.name}_{index}", attributes
            if solid.friction is not None:
                name = f"deposit_{part.name}_{index}"
                given = {**attributes, **(deposits or {}), **_rubbing(solid.friction)}
            _add_field(spec, body, name, half, pose, record, given)


def _rubbing(friction: float) -> dict[str, Any]:
    """Return the attributes of a geom whose friction decides over that of walls and robots."""
    # MuJoCo divides by the friction of a contact that has one.
    return {"priority": 2, "condim": 3 if friction else 1, "friction": [friction, 0.005, 0.0001]}


def add_rims(
    spec: mujoco.MjSpec,
    network: Assembly,
    depths: Sequence[float],
    body: mujoco.MjsBody | None = None,
    **attributes: Any,
) -> None:
    """Add one geom ``rim_<part>_<port>`` for each sharp edge of exact walls; see ``rims``.

    Arguments are those of ``add_exact_walls``, to be called before.
    """
    before = np.zeros(spec.nuser_geom - RECORD_SIZE)
    joints = [(end, other) for pair in network.joints for end, other in (pair, pair[::-1])]
    for (index, port), other in [*joints, *((end, None) for end in network.openings)]:
        part = network.parts[index]
        radius, behind = part.fitting.port_radius(port), part.fitting.flare(port)
        beyond = OPEN
        if other is not None:
            neighbour = network.parts[other[0]].fitting
            step = neighbour.port_radius(other[1]) - radius
            beyond = neighbour.flare(other[1]) if abs(step) <= JOINED else OPEN
            # Of two parts with one bore the first has the edge; of two bores the narrower one.
            if step < -JOINED or (abs(step) <= JOINED and (index, port) > other):
                continue
        # A joint at which the wall does not turn away from the bore has no edge.
        if behind + beyond > SHARP:
            own = rim_record(radius, behind, beyond, depths[index])
            edge = part.fitting.edge(port)
            if edge is not None:
                own, radius = section_rim_record(edge, depths[index]), edge.max_radius
            half = np.array([radius, radius, RIM_ROOM * radius])
            record = np.append(before, own)
            name = f"rim_{part.name}_{port}"
            _add_field(spec, body, name, half, part.port(port), record, attributes)


def _add_field(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody | None,
    name: str,
    half: Array,
    pose: Pose,
    record: Array,
    attributes: dict[str, Any],
) -> None:
    """Add a height field of half sizes ``half`` (3,) m for a record."""
    # A single cell: the field's shape is never used, only the box that bounds it.
    size = [half[0], half[1], half[2], half[2]]
    spec.add_hfield(name=name, nrow=2, ncol=2, size=size, userdata=[0, 0, 1, 1])
    kind, place = mujoco.mjtGeom.mjGEOM_HFIELD, {"pos": pose.position, "quat": pose.quaternion}
    shape = place | {"hfieldname": name, "userdata": record}
    _add_geom(body or spec.worldbody, name, kind, **shape, **attributes)


def _line_ends(network: Assembly, end: Port, other: Port | None, rims: bool) -> bool:
    """Tell whether contact of a line ends at port ``end``, joined to ``other`` or open.

    There may be a rim of its own.
    """
    if other is None:
        return not rims
    mine, theirs = (network.parts[index].fitting for index, _ in (end, other))
    bore, next_bore = mine.port_radius(end[1]), theirs.port_radius(other[1])
    # Where the wall flares into this part there is a kink at its end. At a narrow end that is a
    # convex edge, which the collider finds by itself.
    at_kink = theirs.bends_at(other[1]) or mine.flare(end[1]) < 0
    return at_kink or abs(bore - next_bore) > JOINED


def add_ends(
    spec: mujoco.MjSpec,
    network: Assembly,
    ends: Mapping[Port, float],
    body: mujoco.MjsBody | None = None,
    **attributes: Any,
) -> None:
    """Close ports of exact walls by one geom ``plate_<part>_<port>`` each, solid behind its plane.

    To be called after ``add_exact_walls``, whose arguments these are.

    Args:
        spec: likewise.
        network: likewise.
        ends: likewise; these ports are closed.
        body: likewise.
        attributes: likewise.
    """
    before = np.zeros(spec.nuser_geom - RECORD_SIZE)
    for (index, port), depth in ends.items():
        part, names = network.parts[index], [geom.name for geom in (body or spec.worldbody).geoms]
        radius, pose = part.fitting.port_reach(port), part.port(port)
        record = plate_record(radius, depth, len(names) - names.index(f"wall_{part.name}"))
        aside = radius + DEPTH_IN_BORE * radius
        # Its z axis leads into the bore.
        pose = Pose(pose.rotation * [1, -1, -1], pose.position)
        name = f"plate_{part.name}_{port}"
        half, row = np.array([aside, aside, depth]), np.append(before, record)
        _add_field(spec, body, name, half, pose, row, attributes)


PLATE_GROUP, PLATE_COLOUR = 2, [0.72, 0.22, 0.18, 1.0]
PLATE_THICKNESS = 0.006
"""Of a plate that closes a pipe, m; assumed."""


def add_plates(
    spec: mujoco.MjSpec,
    network: Assembly,
    plates: Sequence[Port],
    looks: bool = False,
    thickness: float = PLATE_THICKNESS,
    overlap: float = 0.0,
    body: mujoco.MjsBody | None = None,
    **attributes: Any,
) -> None:
    """Close ports (part index, port name) by plates that collide with lugs.

    With ``looks``, for pictures, they have the shape of the bore; otherwise they are square, which
    collides faster and reaches into the wall, by ``overlap`` m more than the bore. ``thickness`` is
    in m; ``body`` and ``attributes`` are those of ``add_exact_walls``.
    """
    for index, port in plates:
        part = network.parts[index]
        pose, radius = part.port(port), part.fitting.port_reach(port)
        # Between two pipes a plate lies in the plane of their joint; that of a cap begins there.
        beyond = thickness / 2 if port in part.fitting.closed_ports else 0.0
        half = radius + overlap
        shape: dict[str, Any] = {"pos": pose.apply([0.0, 0.0, beyond]), "quat": pose.quaternion}
        name, edge = f"plate_{part.name}_{port}", part.fitting.edge(port)
        kind, shape["size"] = mujoco.mjtGeom.mjGEOM_BOX, [half, half, thickness / 2]
        if looks and edge is None:
            kind, shape["size"] = mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, thickness / 2, 0.0]
        elif looks and edge is not None:
            from omnitrack_sim.walls.meshes import section_plate
            from omnitrack_sim.walls.pipe_looks import add_mesh

            add_mesh(spec, name, section_plate(edge, thickness))
            kind, shape["meshname"] = mujoco.mjtGeom.mjGEOM_MESH, name
            del shape["size"]
        whole = shape | {"group": PLATE_GROUP, "rgba": PLATE_COLOUR} | attributes
        _add_geom(body or spec.worldbody, name, kind, **whole)


def _add_geom(body: mujoco.MjsBody, name: str, kind: mujoco.mjtGeom, **attributes: Any) -> None:
    looks = {"group": GROUP, "rgba": WALL_COLOUR}
    # Walls and plates share these bits: they meet the robot's lugs, and never each other.
    touching = {"contype": 2, "conaffinity": 1}
    body.add_geom(name=name, type=kind, **looks | touching | attributes)


WALL_COLOUR = [0.62, 0.66, 0.70, 0.25]
