"""MuJoCo scenes with the package's robot and other walls.

These are convex pieces, a rigid flex, and a signed distance field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import trimesh
from decompose import convex_pieces
from manifold3d import Manifold, Mesh

from omnitrack_sim.pipes import Assembly, Fitting
from omnitrack_sim.pipes.shapes import sagitta
from omnitrack_sim.robots.omnitrack.body import LUG_CONAFFINITY, LUG_CONTYPE
from omnitrack_sim.walls.geoms import GROUP
from omnitrack_sim.walls.meshes import fitting_mesh, triangles_of

NEAR = 1e-3
"""A mesh vertex this close to the exact inner surface lies on the bore, m.

The outside is a wall thickness away.
"""
SLIVER = 1e-6
"""Triangles of less height than this, m, are left out: contacts with them are not numbers."""
WALL_MASKS = {"contype": LUG_CONAFFINITY, "conaffinity": LUG_CONTYPE, "group": GROUP}
"""Walls touch lugs and nothing else, as in ``omnitrack_sim.walls.geoms``."""


@dataclass(frozen=True)
class MeshSettings:
    """How fine a wall mesh is.

    Attributes:
        sections: corners of a bore's cross-section.
        edge: longest edge, m; none: as the solid has them, as long as a pipe.
        thickness: of the wall, m.
    """

    sections: int = 96
    edge: float | None = None
    thickness: float = 0.004


def wall_solid(fitting: Fitting, settings: MeshSettings) -> trimesh.Trimesh:
    """The wall of a fitting as a watertight solid, m, fitting frame.

    Vertices of the bore are moved onto the exact surface, and out of it by half the sagitta of the
    facets around: the exact surface then lies midway between a facet's nearest and farthest points,
    as with the package's own walls.
    """
    mesh = fitting_mesh(fitting, settings.thickness, settings.sections)
    if settings.edge is not None:
        exact = Mesh(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
        mesh = triangles_of(Manifold(exact).refine_to_length(settings.edge))
    shift = sagitta(fitting.radius, math.pi / settings.sections) / 2
    return _moved(trimesh.Trimesh(*mesh, process=False), fitting, -shift)


def bore_surface(fitting: Fitting, settings: MeshSettings, depth: float = 0.0) -> trimesh.Trimesh:
    """The triangles of ``wall_solid`` that face the bore, ``depth`` m inside the wall."""
    solid = wall_solid(fitting, settings)
    distance, _ = fitting.signed_distance(solid.vertices)
    on_bore = np.abs(distance) < NEAR
    faces = solid.faces[on_bore[solid.faces].all(axis=1)]
    surface = trimesh.Trimesh(solid.vertices, faces, process=False)
    surface.update_faces(surface.nondegenerate_faces(height=SLIVER))
    surface.remove_unreferenced_vertices()
    shift = sagitta(fitting.radius, math.pi / settings.sections) / 2
    return _moved(surface, fitting, -shift - depth)


def _moved(mesh: trimesh.Trimesh, fitting: Fitting, level: float) -> trimesh.Trimesh:
    """The mesh with its bore vertices where the exact distance is ``level`` m."""
    vertices = np.array(mesh.vertices)
    distance, gradient = fitting.signed_distance(vertices)
    near = np.abs(distance) < NEAR
    vertices[near] += ((level - distance)[:, None] * gradient)[near]
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def convex_walls(
    spec: mujoco.MjSpec,
    network: Assembly,
    mesh: MeshSettings,
    coacd: dict[str, Any],
    folder: Path,
    limit_s: float,
) -> float:
    """Convex pieces that CoACD finds in each fitting; returns the seconds that it took."""
    total = 0.0
    for part in network.parts:
        pieces, seconds = convex_pieces(wall_solid(part.fitting, mesh), coacd, folder, limit_s)
        total += seconds
        for index, (vertices, faces) in enumerate(pieces):
            name = f"wall_{part.name}_{index}"
            _add_mesh(spec, name, part.pose.apply(vertices), np.asarray(faces))
            spec.worldbody.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **WALL_MASKS
            )
    return total


def flex_walls(
    spec: mujoco.MjSpec,
    network: Assembly,
    mesh: MeshSettings,
    radius: float = 1e-3,
    offset: float = 0.0,
) -> None:
    """One rigid flex for each fitting: the triangles of the bore, with a thickness.

    They are ``radius`` m thick to either side, and set back by as much. ``offset`` widens the bore,
    m.
    """
    for part in network.parts:
        surface = bore_surface(part.fitting, mesh, depth=radius + offset)
        spec.add_flex(
            name=f"wall_{part.name}",
            dim=2,
            radius=radius,
            vertbody=["world"],
            vert=part.pose.apply(surface.vertices).ravel(),
            elem=np.asarray(surface.faces, np.int32).ravel(),
            condim=3,
            **WALL_MASKS,
        )


def sdf_walls(
    spec: mujoco.MjSpec,
    network: Assembly,
    mesh: MeshSettings,
    octree_depth: int | None = None,
    iterations: int = 10,
    initpoints: int = 40,
) -> None:
    """One signed distance field a fitting, from the mesh of its solid."""
    spec.option.sdf_iterations, spec.option.sdf_initpoints = iterations, initpoints
    for part in network.parts:
        solid = wall_solid(part.fitting, mesh)
        name = f"wall_{part.name}"
        asset = _add_mesh(spec, name, part.pose.apply(solid.vertices), solid.faces)
        asset.needsdf = True
        if octree_depth is not None:
            asset.octree_maxdepth = octree_depth
        spec.worldbody.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_SDF, meshname=name, **WALL_MASKS
        )


def _add_mesh(
    spec: mujoco.MjSpec, name: str, vertices: np.ndarray, faces: np.ndarray
) -> mujoco.MjsMesh:
    asset = spec.add_mesh(name=name)
    asset.uservert, asset.userface = np.ravel(vertices), np.asarray(faces, np.int32).ravel()
    return asset
