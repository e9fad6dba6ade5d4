"""Triangles with normals and colours: of compiled robots, and of exact surfaces of pipes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Self

import mujoco
import numpy as np
from manifold3d import Manifold, Mesh
from numpy.typing import ArrayLike, NDArray

from omnitrack_sim.base.rotations import Array, Pose, matrix_from_quaternion, unit
from omnitrack_sim.pipes import Fitting, Part
from omnitrack_sim.walls.meshes import (
    THICKNESS,
    TriangleMesh,
    cut_normal,
    cutaway_mesh,
    inside_mesh,
    opened_meshes,
)

PIPE, SECTION, JOINT = (0.64, 0.705, 0.775), (0.93, 0.95, 0.97), (0.36, 0.41, 0.47)
"""Red, green, blue of a pipe's wall, of where it is cut, and of the seams between parts."""
MARK = (0.50, 0.56, 0.63)
"""The same of the rings that cameras in a pipe see on its wall, between wall and seams."""
MARK_APART, MARK_WIDTH, MARK_HEIGHT, MARK_OFF = 0.5, 0.02, 0.0025, 0.01
"""Distance of the rings, in bores, their width and height over the wall, and how far from where it
is straight across they may lie: in a branch's mouth a ring is left open."""
_STEPS_TO_WALL = 16
"""Steps from the axis to a wall with relief, each as long as the distance that is left: at a slope
of 45 degrees, where a step leaves 0.3 of it, far more than enough."""
SEAM_WIDTH, SEAM_HEIGHT = 0.005, 0.001
"""Size of the weld between two parts, m: along the pipe, and into the bore."""
DRAWN = (
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_CYLINDER,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)
"""Shapes of geoms that have a surface here."""
_WHEEL_FINE, _WHEEL, _BALL_FINE, _BALL = 72, 48, 32, 20
"""Sides of cylinders and of balls, seen closely and in films: chords of a wheel of 25 mm are within
0.06 mm of its rim."""
_THIN, _THIN_RADIUS = 8, 0.005
"""Sides in films of what is thinner than this radius, m."""
UNPAINTED, PLAIN = (0.5, 0.5, 0.5, 1.0), (0.95, 0.55, 0.05)
"""MuJoCo's colour of geoms that state none, which is hard to tell from pipes, and ours."""
CREASE_DEG = 50.0
"""Angle between neighbouring faces of a mesh from which on the edge is sharp, degrees."""
_TO_CENTRE = 0.02  # of the way from a corner to its triangle's centre, where its normal is taken
_SECTIONS_CUT, _SECTIONS_INSIDE = 72, 48  # corners of a pipe's cross-section
_SAME = np.array(3 * [1e-5] + 3 * [0.03] + 4 * [0.01])  # m, and parts of unit vectors and colours

Faces = NDArray[np.int32]


@dataclass(frozen=True)
class Surface:
    """Triangles with normals and colours.

    Attributes:
        position: (V, 3) m, in the frame of the vertex's body.
        normal: (V, 3) unit vectors, in the same frame.
        colour: (V, 4) red, green, blue and gloss, each from 0 to 1.
        body: (V,) index of the body; 0 is the world.
        faces: (F, 3) vertices, counterclockwise from outside.
    """

    position: Array
    normal: Array
    colour: Array
    body: NDArray[np.int32]
    faces: Faces

    def placed(self, pose: Pose) -> Surface:
        """Return the surface in the frame in which its own has this pose."""
        position, normal = pose.apply(self.position), self.normal @ pose.rotation.T
        return replace(self, position=position, normal=normal)

    @classmethod
    def joined(cls, surfaces: list[Self]) -> Self:
        """All of them as one; at least one is needed."""
        offsets = np.cumsum([0, *(len(s.position) for s in surfaces[:-1])])
        faces = [s.faces + offset for s, offset in zip(surfaces, offsets, strict=True)]
        arrays = {
            f.name: np.concatenate([getattr(s, f.name) for s in surfaces])
            for f in fields(cls)
            if f.name != "faces"
        }
        return cls(**arrays, faces=np.concatenate(faces).astype(np.int32))


def geoms_surface(model: mujoco.MjModel, geoms: Iterable[int], fine: bool = False) -> Surface:
    """Return the surfaces of geoms as one, each in the frame of its body.

    ``fine``: for a viewer who may come near.
    """
    return Surface.joined([_geom(model, int(geom), fine) for geom in geoms])


def body_spheres(surface: Surface, bodies: int) -> tuple[Array, Array]:
    """Return bounding spheres of the visible bodies.

    Returns:
        Centres (bodies, 3) m in the bodies' frames, and radii (bodies,) m, 0 for invisible ones.
    """
    centres, radii = np.zeros((bodies, 3)), np.zeros(bodies)
    for body in np.unique(surface.body):
        points = surface.position[surface.body == body]
        centres[body] = (points.min(axis=0) + points.max(axis=0)) / 2
        radii[body] = np.linalg.norm(points - centres[body], axis=1).max()
    return centres, radii


def _geom(model: mujoco.MjModel, geom: int, fine: bool) -> Surface:
    position, normal, faces = _corners(model, geom, fine)
    rotation = matrix_from_quaternion(model.geom_quat[geom])
    material = int(model.geom_matid[geom])
    colour = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    if material < 0 and (colour == UNPAINTED).all():
        colour = PLAIN
    gloss = 0.25 if material < 0 else float(model.mat_specular[material])
    return _painted(
        position @ rotation.T + model.geom_pos[geom],
        unit(normal) @ rotation.T,
        faces,
        (*map(float, colour[:3]), gloss),
        int(model.geom_bodyid[geom]),
    )


def _corners(model: mujoco.MjModel, geom: int, fine: bool) -> tuple[Array, Array, Faces]:
    """Return corners, normals and faces of a geom in its own frame."""
    # Normals are the mean of the faces that meet at a corner, and apart at an edge that is sharp.
    # MuJoCo's own are those of another face at many a sharp edge of a mesh.
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind != mujoco.mjtGeom.mjGEOM_MESH:
        return _smooth(_primitive(kind, np.array(model.geom_size[geom], float), fine))
    mesh = int(model.geom_dataid[geom])
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]]
    faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
    return _mesh_corners(vertices.tobytes(), faces.tobytes())


@lru_cache(maxsize=32)  # modules of a robot have the same meshes
def _mesh_corners(vertices: bytes, faces: bytes) -> tuple[Array, Array, Faces]:
    """Return corners, normals and faces of a mesh of float32 vertices and int32 faces."""
    corners = np.frombuffer(vertices, np.float32).reshape(-1, 3).copy()  # the kernel may write
    triangles = np.frombuffer(faces, np.int32).reshape(-1, 3)
    solid = Manifold(Mesh(corners, triangles.astype(np.uint32)))
    return _flat(corners, triangles) if solid.is_empty() else _smooth(solid)


def _smooth(solid: Manifold) -> tuple[Array, Array, Faces]:
    """Return corners, normals and faces of a solid."""
    mesh = solid.calculate_normals(0, CREASE_DEG).to_mesh()
    position, normal = np.split(mesh.vert_properties.astype(float), 2, axis=1)
    return position, normal, np.array(mesh.tri_verts, np.int32)  # a copy, to let go of the mesh


def _flat(vertices: NDArray[np.float32], faces: Faces) -> tuple[Array, Array, Faces]:
    """Return corners, normals and faces of a mesh that is no closed solid, each face flat."""
    corners = vertices.astype(float)[faces]
    normal = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    flat = np.repeat(np.nan_to_num(normal), 3, axis=0)
    return corners.reshape(-1, 3), flat, np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)


def _painted(
    position: Array, normal: Array, faces: ArrayLike, colour: ArrayLike, body: int = 0
) -> Surface:
    """A surface of one body; ``colour`` is (4,), or (V, 4)."""
    count = len(position)
    return Surface(
        position,
        normal,
        np.broadcast_to(np.asarray(colour, float), (count, 4)),
        np.full(count, body, np.int32),
        np.asarray(faces, np.int32),
    )


def _primitive(kind: mujoco.mjtGeom, size: Array, fine: bool) -> Manifold:
    """Return the solid of a primitive geom in its own frame."""
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Manifold.cube(2 * size, center=True)
    thin = size[0] < _THIN_RADIUS and not fine
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        around = _THIN if thin else _WHEEL_FINE if fine else _WHEEL
        return Manifold.cylinder(2 * size[1], size[0], circular_segments=around, center=True)
    ball = Manifold.sphere(1.0, _THIN if thin else _BALL_FINE if fine else _BALL)
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return ball.scale(size)
    ball = ball.scale(size[[0, 0, 0]])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return ball
    ends = [ball.translate((0.0, 0.0, side * size[1])) for side in (-1, 1)]
    return Manifold.batch_hull(ends)  # a capsule


def opened_pipe(
    fitting: Fitting, towards: Array, sections: int
) -> tuple[Surface, Surface, Surface]:
    """Return both halves of a fitting that is cut open, and its inner surface, in its frame.

    First comes the half that stays, away from a viewer in direction ``towards`` (3,).
    """
    kept, front, inside = opened_meshes(fitting, towards, sections)
    cut = cut_normal(fitting, towards)
    return (
        _wall(fitting, kept, cut),
        _wall(fitting, front, cut),
        _wall(fitting, inside, np.zeros(3)),
    )


def cut_pipe(fitting: Fitting, towards: Array) -> Surface:
    """Return the half of a fitting, in its frame, that stays when it is cut open.

    It is the one away from a viewer in direction ``towards`` (3,).
    """
    mesh = cutaway_mesh(fitting, towards, sections=_SECTIONS_CUT)
    return _wall(fitting, mesh, cut_normal(fitting, towards))


def pipe_inside(fitting: Fitting) -> Surface:
    """Return the inner surface of a fitting, in its frame, which is seen from within only.

    Painted without the faces that look away, the pipe is open towards any viewer.
    """
    return _wall(fitting, inside_mesh(fitting, _SECTIONS_INSIDE), np.zeros(3))


def rings(part: Part) -> list[Surface]:
    """Return rings painted round the bore of a part, world frame, to judge distances by.

    There is one on each half a bore of its axes, where there is a wall. They lie on relief.
    """
    found, angle = [], np.linspace(0.0, 2 * np.pi, 2 * _SECTIONS_INSIDE + 1)
    edge = part.fitting.ring(angle)
    has_relief = bool(part.fitting.waves or part.fitting.obstacles)
    for line, first, last in part.axes:
        bore = 2 * first
        stations = np.arange(MARK_APART * bore, line.length, MARK_APART * bore)
        for middle in stations.tolist():
            s = middle + MARK_WIDTH * bore * np.array([-0.5, 0.5])
            height = MARK_HEIGHT * bore
            radius = first + (last - first) * middle / line.length - height
            ends = radius * np.einsum("sij,kj->ski", line.frame(s), edge)
            axis, out = line.at(s)[0][:, None], unit(ends)  # (2, 1, 3), (2, k, 3)
            points, normal = axis + ends, -out
            if has_relief:
                points, normal = _onto_wall(part, axis, out, height)
            off = np.abs(part.signed_distance(points)[0] - height) > MARK_OFF * bore
            whole = ~(off[:, :-1] | off[:, 1:]).any(axis=0)
            if whole.any():
                found.append(_band(points, normal, np.flatnonzero(whole)))
    return found


def _onto_wall(part: Part, points: Array, out: Array, height: float) -> tuple[Array, Array]:
    """Return points (..., 3) m of the axis moved outward, to ``height`` m over the wall.

    The normals (..., 3) of the wall there come with them. ``out``: (..., 3) unit vectors.
    """
    for _ in range(_STEPS_TO_WALL):
        points = points + (part.signed_distance(points)[0] - height)[..., None] * out
    return points, part.signed_distance(points)[1]


def _band(points: Array, normal: Array, columns: NDArray[np.intp]) -> Surface:
    """Return the given quadrangles of a ring, points and normals (2, k, 3), seen from within."""
    index = np.arange(2 * points.shape[1]).reshape(2, -1)
    a, b, c, d = (index[i, columns + j] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    return _painted(points.reshape(-1, 3), normal.reshape(-1, 3), faces, (*MARK, 0.0))


def _wall(fitting: Fitting, mesh: TriangleMesh, cut: Array) -> Surface:
    """Return a mesh of a fitting with exact normals, flat where it is cut or ends."""
    corners = np.asarray(mesh.vertices)[mesh.faces]  # (F, 3, 3)
    flat = np.asarray(mesh.face_normals)
    centre = corners.mean(axis=1, keepdims=True)
    near = corners + _TO_CENTRE * (centre - corners)
    distance, inward = fitting.signed_distance(near)
    inward = inward * np.where(distance > -THICKNESS / 2, 1.0, -1.0)[..., None]
    curved = (inward * flat[:, None]).sum(axis=-1).min(axis=1) > 0.7
    normal = np.where(curved[:, None, None], inward, flat[:, None])
    sectioned = ~curved & (flat @ cut > 0.99)
    colour = np.where(sectioned[:, None], (*SECTION, 0.0), (*PIPE, 0.0))
    colours = np.broadcast_to(colour[:, None], (len(colour), 3, 4))
    corner = np.concatenate([corners, unit(normal), colours], axis=-1).reshape(-1, 10)
    # Corners that meet with nearly the same normal are one vertex, which is painted once.
    _, first, index = np.unique(
        np.round(corner / _SAME),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    position, normal, colours = np.split(corner[first], [3, 6], axis=1)
    return _painted(position, normal, index.reshape(-1, 3), colours)


SEAM_ANGLES = np.linspace(0.0, 2 * np.pi, _SECTIONS_INSIDE + 1)
"""Angles, rad, of the points of a seam about a port's z axis, from its x axis."""


def seam(port: Pose, radius: float | Array, away: Array) -> Surface:
    """Return the weld at a port, a low ridge in the bore, world frame.

    It lacks the faces on the side ``away`` (3,), where pipes are cut away.

    Args:
        port: its frame.
        radius: of the bore, m; or at each of ``SEAM_ANGLES``.
        away: likewise.
    """
    angle = SEAM_ANGLES
    out = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)[:, None]
    along = np.array([-0.5, 0.0, 0.5])[:, None] * [[0.0, 0.0, SEAM_WIDTH]]
    height = np.array([0.3, 1.0, 0.3])[:, None] * SEAM_HEIGHT
    position = (np.reshape(radius, (-1, 1, 1)) - height) * out + along
    tilt = np.array([-0.7, 0.0, 0.7])[:, None] * [[0.0, 0.0, 1.0]]
    normal = unit((tilt - out).reshape(-1, 3))
    index = np.arange(position[..., 0].size).reshape(position.shape[:2])
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate(
        [np.stack(corners, -1).reshape(-1, 3) for corners in ([a, b, c], [a, c, d])]
    )
    world = port.apply(position.reshape(-1, 3))
    behind = (world[faces].mean(axis=1) - port.position) @ away <= 0
    turned = faces[behind][:, ::-1]  # seen from within
    return _painted(world, normal @ port.rotation.T, turned, (*JOINT, 0.0))
