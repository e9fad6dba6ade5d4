"""The geoms of a compiled model as triangles, with normals that keep sharp edges sharp."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array, unit
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.record.channels import TRACKS
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.robots.omnitrack.body import add_robot
from omnitrack_sim.robots.omnitrack.looks import (
    FIELD_OF_VIEW,
    ROBOT_GROUP,
    add_pipe_insides,
    add_pipe_looks,
    add_robot_looks,
    follow_direction,
    look_pitch,
    view_direction,
)
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.film.shots import DISTANCE, view_directions
from omnitrack_sim.show.film.surfaces import geom_colour
from omnitrack_sim.show.playback import belt_travel
from omnitrack_sim.show.replay.packing import Pack, rounded
from omnitrack_sim.walls.geoms import add_plates, new_spec
from omnitrack_sim.walls.meshes import THICKNESS, cut_normal, triangles_of

CREASE_DEG = 35.0
"""Angle between neighbouring faces from which on an edge is sharp, degrees: bends are made of
rings 3.75 degrees apart and bores of 96 sides, so that all that is round looks round."""
SECTIONS = 24
"""Sides of what is round and no mesh: rods, caps, the eye."""
NORMAL_STEPS = 127
"""A component of a normal is a whole number up to this, one byte."""


@dataclass(frozen=True)
class PackedMesh:
    """Triangles in a frame of their own.

    Attributes:
        vertices: (n, 3) m.
        normals: (n, 3) whole numbers, unit vectors times ``NORMAL_STEPS``.
        faces: (m, 3) indices of vertices.
    """

    vertices: Array
    normals: NDArray[np.int64]
    faces: NDArray[np.int64]


Normals = Callable[[Array], Array]
"""Directions (n, 3) across a known surface at points (n, 3) m near it, either way."""


def mesh_solid(model: mujoco.MjModel, geom: int, across: Normals | None = None) -> PackedMesh:
    """A geom's mesh or shape, in the geom's own frame; ``across`` as in ``creased``."""
    return creased(*_triangles(model, geom), across)


def in_body(model: mujoco.MjModel, geom: int, solid: PackedMesh) -> PackedMesh:
    """A geom's solid in the frame of its body."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    turn = turn.reshape(3, 3)
    normals = np.rint(solid.normals @ turn.T).astype(np.int64)
    return PackedMesh(solid.vertices @ turn.T + model.geom_pos[geom], normals, solid.faces)


def together(solids: list[PackedMesh]) -> PackedMesh:
    """Several solids as one."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids[:-1])])
    return PackedMesh(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([solid.normals for solid in solids]),
        np.concatenate([s.faces + start for s, start in zip(solids, starts, strict=True)]),
    )


def _triangles(model: mujoco.MjModel, geom: int) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (n, 3) m and faces (m, 3) of a geom, in its own frame."""
    kinds, kind = mujoco.mjtGeom, int(model.geom_type[geom])
    if kind == kinds.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        vertices = np.array(model.mesh_vert[first : first + count], float)
        return vertices, np.array(model.mesh_face[face : face + faces], np.int64)
    return triangles_of(_shape(kind, np.array(model.geom_size[geom], float)))


def _shape(kind: int, size: Array) -> Manifold:
    """A shape about its own centre, along z; ``size`` as MuJoCo has it."""
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_BOX:
        return Manifold.cube(2 * size, center=True)
    if kind == kinds.mjGEOM_CYLINDER:
        return Manifold.cylinder(2 * size[1], size[0], circular_segments=SECTIONS, center=True)
    if kind == kinds.mjGEOM_CAPSULE:
        cap = Manifold.sphere(size[0], SECTIONS)
        ends = [cap.translate((0.0, 0.0, side * size[1])) for side in (-1, 1)]
        return Manifold.batch_hull(ends)
    if kind == kinds.mjGEOM_SPHERE:
        return Manifold.sphere(size[0], SECTIONS)
    if kind == kinds.mjGEOM_ELLIPSOID:
        return Manifold.sphere(1.0, SECTIONS).scale(size)
    raise ValueError(f"geoms of type {kind} are not drawn")


def creased(vertices: Array, faces: NDArray[np.int64], across: Normals | None = None) -> PackedMesh:
    """Triangles with a normal at each corner: that of the surface which ``across`` knows where it
    is less than ``CREASE_DEG`` from the face's own, and otherwise the mean of the faces that meet
    there less than that apart, weighted by their angles at the corner."""
    corners = vertices[faces]  # (m, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    faces, corners = faces[length > 0], corners[length > 0]
    normals = normals[length > 0] / length[length > 0, None]
    weight = _corner_angles(corners).ravel()  # (3 m,)
    order = np.argsort(faces.ravel(), kind="stable")
    of_face, vertex = order // 3, faces.ravel()[order]
    one, other = _meeting(vertex)
    unit = normals[of_face]
    least = math.cos(math.radians(CREASE_DEG))
    near = np.einsum("ij,ij->i", unit[one], unit[other]) > least
    share = np.where(near, weight[order][other], 0.0)[:, None] * unit[other]
    total = np.add.reduceat(share, np.flatnonzero(np.diff(one, prepend=-1)), axis=0)
    total /= np.linalg.norm(total, axis=1, keepdims=True)
    if across is not None:
        known = across(vertices)[vertex]
        facing = np.einsum("ij,ij->i", known, unit)
        total = np.where(np.abs(facing)[:, None] > least, np.sign(facing)[:, None] * known, total)
    told = np.column_stack([vertex, np.rint(NORMAL_STEPS * total).astype(np.int64)])
    kept, index = np.unique(told, axis=0, return_inverse=True)
    drawn = np.empty(len(order), np.int64)
    drawn[order] = index.reshape(-1)
    return PackedMesh(vertices[kept[:, 0]], kept[:, 1:], drawn.reshape(-1, 3))


def _corner_angles(corners: Array) -> Array:
    """Angles (m, 3) rad at the corners (m, 3, 3) of triangles."""
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(ahead, behind), axis=-1)
    return np.arctan2(across, (ahead * behind).sum(axis=-1))


def _meeting(vertex: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All pairs of places (p,), (p,) in the sorted numbers ``vertex`` (n,) that hold the same
    number, in the order of the first place."""
    starts = np.flatnonzero(np.diff(vertex, prepend=-1))
    counts = np.diff(np.append(starts, len(vertex)))
    group = np.repeat(np.arange(len(starts)), counts)
    partners = counts[group]  # of each place
    one = np.repeat(np.arange(len(vertex)), partners)
    before = np.cumsum(partners) - partners
    other = starts[group[one]] + np.arange(len(one)) - before[one]
    return one, other


POSITION_STEP = 1e-5
"""What positions of bodies are rounded to, m."""
TURN_STEP = 1 / 32767
"""What components of quaternions are rounded to: 3e-5 rad, or 3 micrometres at the robot's rim."""
FARTHER = 1.35
"""How much farther than in films the camera that follows stands: a page can be zoomed."""
TIME_STEP = 1e-6
"""What times are rounded to, s."""


def looks_model(scenario: Scenario, network: Assembly | None = None) -> mujoco.MjModel:
    """The robot, its joints as in the model of a run, and what is looked at of it and of the pipes
    of ``network``, if one is given."""
    spec = new_spec("replay")
    add_robot(spec, scenario.robot, line_tracks=True)
    add_robot_looks(spec, scenario.robot)
    if network is not None:
        add_plates(spec, network, scenario.plates, looks=True)
        add_pipe_looks(spec, network)
        add_pipe_insides(spec, network)
    return spec.compile()


class Shapes:
    """Solids in a pack, each once, however many bodies or pipes have it."""

    def __init__(self, pack: Pack) -> None:
        self.tables: list[dict[str, Any]] = []
        self._pack = pack
        self._known: dict[bytes, int] = {}

    def add(self, solid: PackedMesh) -> int:
        """The number of a solid."""
        key = b"".join(array.tobytes() for array in vars(solid).values())
        if key not in self._known:
            self._known[key] = len(self.tables)
            self.tables.append(
                {
                    "vertices": self._pack.ranged(solid.vertices),
                    "normals": self._pack.whole(solid.normals),
                    "faces": self._pack.whole(solid.faces.ravel()),
                }
            )
        return self._known[key]


def robot_table(
    result: Result, trajectory: Trajectory, model: mujoco.MjModel, pack: Pack, shapes: Shapes
) -> dict[str, Any]:
    """The robot of a run and how it moves.

    Bodies but for the tracks have poses over time; a track lies on its module, as far along its
    axis as its belt has run within half a visible pitch.
    """
    robot = result.scenario.robot
    tracks = [(track, i) for i in range(1, MODULES + 1) for track in TRACKS]
    carried = {f"track_{track}_{i}": (track, i) for track, i in tracks}
    names = [model.body(i).name for i in range(1, model.nbody)]
    moved = [name for name in names if name not in carried]
    poses = body_poses(model, trajectory, moved)
    samples = len(poses)
    bodies = []
    for name in names:
        table = _body(model, name, shapes)
        if name in carried:
            track, module = carried[name]
            axis = np.array(model.joint(f"belt_{track}_{module}").axis)
            table |= {"on": moved.index(f"module_{module}"), "axis": rounded(axis, 6)}
            table |= {"module": module - 1, "track": TRACKS.index(track)}
        bodies.append(table)
    return {
        "bodies": bodies,
        "moved": moved,
        "positions": pack.steps(poses[..., :3].reshape(samples, -1), POSITION_STEP),
        "turns": pack.steps(poses[..., 3:].reshape(samples, -1), TURN_STEP),
        "travel": pack.steps(belt_travel(trajectory), POSITION_STEP),
        "pitch": look_pitch(robot),
        "scale": robot.scale,
    }


def _body(model: mujoco.MjModel, name: str, shapes: Shapes) -> dict[str, Any]:
    """What is seen of a body: one solid, and how many of its vertices have which colour."""
    body = model.body(name).id
    geoms = np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == ROBOT_GROUP))
    solids = [in_body(model, geom, mesh_solid(model, geom)) for geom in geoms.tolist()]
    if not solids:
        return {"name": name}
    colours = [
        [len(solid.vertices), rounded(geom_colour(model, geom), 4)]
        for solid, geom in zip(solids, geoms.tolist(), strict=True)
    ]
    return {"name": name, "shape": shapes.add(together(solids)), "colours": colours}


def body_poses(model: mujoco.MjModel, trajectory: Trajectory, names: list[str]) -> Array:
    """Position, m, and quaternion of bodies (T, B, 7) by MuJoCo's kinematics, world frame; no
    quaternion turns its sign from one sample to the next."""
    data, rows = mujoco.MjData(model), [model.body(name).id for name in names]
    poses = np.empty((len(trajectory.time), len(rows), 7))
    for pose, qpos in zip(poses, trajectory.qpos, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        pose[:, :3], pose[:, 3:] = data.xpos[rows], data.xquat[rows]
    turns = poses[..., 3:]
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
    turns[1:] *= np.cumprod(flips, axis=0)[..., None]
    return poses


def pipes_table(network: Assembly, model: mujoco.MjModel, shapes: Shapes) -> dict[str, Any]:
    """Each part's half that stays when it is cut open towards the film's viewer, its half cut
    away, its inside, and where it lies; the plates; the directions of the camera that sees all."""
    data, towards = mujoco.MjData(model), view_direction(network)
    mujoco.mj_kinematics(model, data)

    def piece(geom: int, part: Part | None = None) -> dict[str, Any]:
        turn, place = np.zeros(4), data.geom_xpos[geom]
        mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
        frame = data.geom_xmat[geom].reshape(3, 3)

        def across(points: Array) -> Array:
            """The exact wall's normals, in the geom's frame."""
            assert part is not None
            return unit(part.signed_distance(points @ frame.T + place)[1] @ frame)

        return {
            "shape": shapes.add(mesh_solid(model, geom, across if part else None)),
            "position": rounded(place, 6),
            "turn": rounded(turn, 7),
        }

    parts = []
    for part in network.parts:
        rotation, samples = part.pose.rotation, part.bore_samples()
        looks = (f"look_{look}_{part.name}" for look in ("pipe", "front", "inside"))
        kept, front, inside = (piece(model.geom(look).id, part) for look in looks)
        table = {"name": part.name, "kept": kept, "front": front, "inside": inside}
        table["cut"] = rounded(rotation @ cut_normal(part.fitting, rotation.T @ towards), 6)
        table["low"] = rounded(samples.min(axis=0) - THICKNESS, 4)
        table["high"] = rounded(samples.max(axis=0) + THICKNESS, 4)
        parts.append(table)
    plates = np.flatnonzero((model.geom_bodyid == 0) & (model.geom_group == ROBOT_GROUP)).tolist()
    return {
        "parts": parts,
        "plates": [
            piece(geom) | {"colour": rounded(geom_colour(model, geom), 4)} for geom in plates
        ],
        "pipe": rounded(model.mat("pipe").rgba[:3], 4),
        "towards": rounded(towards, 6),
        "back": rounded(follow_direction(network), 6),
        "fov": FIELD_OF_VIEW,
    }


def follow_table(result: Result, trajectory: Trajectory, pack: Pack) -> dict[str, Any]:
    """Where the camera that keeps with the robot stands: its distance, m, and its direction at
    each sample, as in films."""
    routes = result.routes()
    directions = view_directions(trajectory, routes, follow_direction(result.pipes))
    distance = FARTHER * DISTANCE * result.scenario.robot.scale
    return {"distance": distance, "directions": pack.steps(directions, 1e-4)}
