"""The geoms of a compiled model as triangles, with normals that keep sharp edges sharp."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array

CREASE_DEG = 35.0
"""Angle between neighbouring faces from which on an edge is sharp, degrees: bends are made of
rings 3.75 degrees apart and bores of 96 sides, so that all that is round looks round."""
SECTIONS = 24
"""Sides of what is round and no mesh: rods, caps, the eye."""
NORMAL_STEPS = 127
"""A component of a normal is a whole number up to this, one byte."""


@dataclass(frozen=True)
class Solid:
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


def mesh_solid(model: mujoco.MjModel, geom: int, across: Normals | None = None) -> Solid:
    """A geom's mesh or shape, in the geom's own frame; ``across`` as in ``creased``."""
    return creased(*_triangles(model, geom), across)


def in_body(model: mujoco.MjModel, geom: int, solid: Solid) -> Solid:
    """A geom's solid in the frame of its body."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    turn = turn.reshape(3, 3)
    normals = np.rint(solid.normals @ turn.T).astype(np.int64)
    return Solid(solid.vertices @ turn.T + model.geom_pos[geom], normals, solid.faces)


def together(solids: list[Solid]) -> Solid:
    """Several solids as one."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids[:-1])])
    return Solid(
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
    shape = _shape(kind, np.array(model.geom_size[geom], float))
    return np.asarray(shape.vertices, float), np.asarray(shape.faces, np.int64)


def _shape(kind: int, size: Array) -> trimesh.Trimesh:
    """A shape about its own centre, along z; ``size`` as MuJoCo has it."""
    kinds, creation = mujoco.mjtGeom, trimesh.creation
    if kind == kinds.mjGEOM_BOX:
        return creation.box(extents=2 * size)
    if kind == kinds.mjGEOM_CYLINDER:
        return creation.cylinder(radius=size[0], height=2 * size[1], sections=SECTIONS)
    if kind == kinds.mjGEOM_CAPSULE:
        around = [SECTIONS // 2, SECTIONS // 2]
        shape = creation.capsule(radius=size[0], height=2 * size[1], count=around)
        return shape.apply_translation(-shape.bounds.mean(axis=0))
    if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        ball = creation.uv_sphere(radius=1.0, count=[SECTIONS // 2, SECTIONS])
        ball.vertices *= size if kind == kinds.mjGEOM_ELLIPSOID else size[0]
        return ball
    raise ValueError(f"geoms of type {kind} are not drawn")


def creased(vertices: Array, faces: NDArray[np.int64], across: Normals | None = None) -> Solid:
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
    return Solid(vertices[kept[:, 0]], kept[:, 1:], drawn.reshape(-1, 3))


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
