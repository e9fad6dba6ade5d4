"""Pipe walls in PyBullet: one concave triangle mesh, how fine it is, and how far it is off."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
import pybullet as bullet
import trimesh

from omnitrack_sim import Scenario
from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Assembly, Fitting, Part
from omnitrack_sim.walls.meshes import fitting_mesh

LUG_GROUP, WALL_GROUP = 1, 2
"""Collision groups: lugs touch walls and nothing else."""
ON_SURFACE = 2e-4
"""Distance from the exact inner surface within which a mesh vertex belongs to it, m."""
PROBE_GAP = 5e-4
"""Gap between probe sphere and exact surface, m."""


@dataclass(frozen=True)
class BulletSettings:
    """Numerics of Bullet.

    Attributes:
        time_step: of ``stepSimulation``, s. Springs are computed once in each.
        substeps: Bullet's own steps within it.
        iterations: of the constraint solver.
        sections, along: edges of the wall mesh around the bore; rings in 90 degrees of an elbow.
        erp: part of a contact's depth that is corrected in a step.
        breaking: distance from which contacts are kept, m.
        stiffness, damping: of a contact, N/m and N s/m, instead of ``erp``; None for rigid
            contacts.
        servo: part of a belt's speed error that its motor corrects in a step; ``time_step /
            robot.motor.speed_bandwidth`` is the motor's own lag without load.
        cone: friction cone instead of a pyramid.
    """

    time_step: float = 0.001
    substeps: int = 1
    iterations: int = 50
    sections: int = 96
    along: int = 24
    erp: float = 0.2
    breaking: float = 0.001
    stiffness: float | None = None
    damping: float | None = None
    servo: float = 1.0
    cone: bool = False


SETTINGS: dict[str, BulletSettings] = {
    "default": BulletSettings(),
    "2ms": BulletSettings(time_step=0.002),
    "4ms": BulletSettings(time_step=0.004),
    "iterations_200": BulletSettings(iterations=200),
    "fine_mesh": BulletSettings(sections=192, along=48),
    "breaking_20mm": BulletSettings(breaking=0.02),
    "soft_4ms": BulletSettings(time_step=0.004, stiffness=2e4, damping=50.0),
    "4ms_iterations_200": BulletSettings(time_step=0.004, iterations=200),
    "4ms_iterations_100": BulletSettings(time_step=0.004, iterations=100),
    "4ms_iterations_200_fine": BulletSettings(
        time_step=0.004, iterations=200, sections=192, along=48
    ),
}


def inner_mesh(fitting: Fitting, settings: BulletSettings) -> trimesh.Trimesh:
    """Return the inner surface of a fitting, m, in its frame.

    The exact surface lies amid each facet around the bore.
    """
    n = settings.sections
    if len(fitting.axes) == 1:
        mesh = _swept(fitting, n, settings.along)
    else:
        solid = trimesh.Trimesh(*fitting_mesh(fitting, sections=n), process=False)
        off = np.abs(fitting.signed_distance(solid.vertices)[0])
        keep = (off[solid.faces] < ON_SURFACE).all(axis=1)
        centre = solid.triangles_center[keep]
        # End caps have their corners on the surface too, and their middles in the port planes.
        faces = solid.faces[keep][fitting.extent(centre) > 1e-7]
        mesh = trimesh.Trimesh(solid.vertices, faces, process=False)
        mesh.remove_unreferenced_vertices()
    _, gradient = fitting.signed_distance(mesh.vertices)
    sagitta = fitting.radius * (1 - math.cos(math.pi / n))
    mesh.vertices = mesh.vertices - gradient * sagitta / 2
    return mesh


def _swept(fitting: Fitting, sections: int, along: int) -> trimesh.Trimesh:
    """Return rings along the one axis of a fitting, joined by triangles.

    There are ``along`` of them in a right angle, and their corners lie on the exact surface.
    """
    line, first, last = Part("part", fitting, Pose()).axes[0]
    ends = line.at(np.array([0.0, line.length]))
    bend = line.length * float(ends[3].max())
    turns = max(2, math.ceil(along * bend / (math.pi / 2))) if bend else 1
    s, u = np.linspace(0, line.length, turns + 1), 2 * np.pi * np.arange(sections) / sections
    circle = np.stack([np.cos(u), np.sin(u), 0 * u], axis=-1)
    radius = np.linspace(first, last, turns + 1)[:, None, None]
    points = line.at(s)[0][:, None] + radius * np.einsum("sij,kj->ski", line.frame(s), circle)
    index = np.arange((turns + 1) * sections).reshape(turns + 1, sections)
    a, b = index[:-1], index[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = [
        np.stack(corners, axis=-1).reshape(-1, 3)
        for corners in ((a, b, a_next), (a_next, b, b_next))
    ]
    return trimesh.Trimesh(points.reshape(-1, 3), np.concatenate(faces), process=False)


def add_wall(client: int, network: Assembly, settings: BulletSettings) -> int:
    """The inner surface of a network as one static concave body; returns its number."""
    meshes = []
    for part in network.parts:
        mesh = inner_mesh(part.fitting, settings)
        meshes.append(trimesh.Trimesh(part.pose.apply(mesh.vertices), mesh.faces, process=False))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "wall.obj"
        file.write_text(
            trimesh.util.concatenate(meshes).export(file_type="obj", digits=9), encoding="utf-8"
        )
        shape = bullet.createCollisionShape(
            bullet.GEOM_MESH,
            fileName=str(file),
            flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=client,
        )
    if shape < 0:
        raise RuntimeError("Bullet did not take the wall mesh")
    wall = bullet.createMultiBody(0, shape, physicsClientId=client)
    bullet.setCollisionFilterGroupMask(wall, -1, WALL_GROUP, LUG_GROUP, physicsClientId=client)
    bullet.changeDynamics(wall, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
    return wall


def bullet_wall_error(
    scenario: Scenario, settings: BulletSettings, probes: int = 4000, seed: int = 0
) -> tuple[float, float]:
    """Largest and 99 % distance, mm, of the surface that lugs meet from the exact one.

    A sphere as large as a lug is held ``PROBE_GAP`` off the exact surface, and the engine is asked
    for the gap. On the fittings that bend or branch; in a straight route on all of it.
    """
    network = scenario.route.network
    radius = scenario.robot.lug_radius - scenario.robot.track_offset
    parts = [p for p in network.parts if not p.fitting.is_plain] or list(network.parts)
    centres = probe_centres(network, parts, radius, probes, seed)
    client = bullet.connect(bullet.DIRECT)
    try:
        wall = add_wall(client, network, settings)
        shape = bullet.createCollisionShape(
            bullet.GEOM_SPHERE, radius=radius, physicsClientId=client
        )
        probe = bullet.createMultiBody(1.0, shape, physicsClientId=client)
        errors = np.full(len(centres), np.inf)
        exact = network.signed_distance(centres)[0]
        for i, centre, distance in zip(count(), centres, exact):
            bullet.resetBasePositionAndOrientation(
                probe, centre.tolist(), [0, 0, 0, 1], physicsClientId=client
            )
            points = bullet.getClosestPoints(probe, wall, 0.01, physicsClientId=client)
            if points:
                errors[i] = distance - radius - min(point[8] for point in points)
    finally:
        bullet.disconnect(client)
    size = 1e3 * np.abs(errors)
    return float(size.max()), float(np.quantile(size, 0.99))


def probe_centres(network: Assembly, parts: list, radius: float, number: int, seed: int) -> Array:
    """Draw centres (number, 3) m of spheres ``PROBE_GAP`` off the exact surface of ``parts``."""
    rng = np.random.default_rng(seed)
    samples = np.concatenate([part.bore_samples() for part in parts])
    chosen = []
    while sum(map(len, chosen)) < number:
        points = samples[rng.integers(len(samples), size=number)] + rng.normal(0, 0.01, (number, 3))
        distance, gradient = network.signed_distance(points)
        points = points + gradient * (radius + PROBE_GAP - distance)[:, None]
        distance = network.signed_distance(points)[0]
        # Not where a sphere reaches past an open end, nor where it touches elsewhere.
        inside = np.max([part.extent(points) for part in parts], axis=0) > radius
        chosen.append(points[inside & (np.abs(distance - radius - PROBE_GAP) < PROBE_GAP / 2)])
    return np.concatenate(chosen)[:number]
