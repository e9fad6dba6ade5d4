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
from omnitrack_sim.model.meshes import fitting_mesh
from omnitrack_sim.pipes import Elbow, PipeNetwork, Straight
from omnitrack_sim.pipes.fittings import Fitting
from omnitrack_sim.rotations import Array

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
            robot.motor.servo_time`` is the motor's own lag without load.
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
    """Inner surface of a fitting, m, fitting frame.

    Around the bore the exact surface lies half way between the middles and the edges of the facets.
    """
    n = settings.sections
    if isinstance(fitting, (Straight, Elbow)):
        turns = (
            1
            if isinstance(fitting, Straight)
            else max(2, math.ceil(settings.along * fitting.angle / (math.pi / 2)))
        )
        mesh = _swept(fitting, n, turns)
    else:
        solid = fitting_mesh(fitting, sections=n)
        off = np.abs(fitting.signed_distance(solid.vertices)[0])
        keep = (off[solid.faces] < ON_SURFACE).all(axis=1)
        centre = solid.triangles_center[keep]
        # Triangles of end caps have corners on the surface, too, but lie in the port planes.
        faces = solid.faces[keep][fitting.extent(centre) > 1e-7]
        mesh = trimesh.Trimesh(solid.vertices, faces, process=False)
        mesh.remove_unreferenced_vertices()
    _, gradient = fitting.signed_distance(mesh.vertices)
    sagitta = fitting.radius * (1 - math.cos(math.pi / n))
    mesh.vertices = mesh.vertices - gradient * sagitta / 2
    return mesh


def _swept(fitting: Straight | Elbow, sections: int, turns: int) -> trimesh.Trimesh:
    """Rings along a straight or a bend, joined by triangles; corners on the exact surface."""
    u = 2 * np.pi * np.arange(sections) / sections
    s = np.linspace(0, 1, turns + 1)[:, None]
    ring, side = fitting.radius * np.cos(u), fitting.radius * np.sin(u)
    if isinstance(fitting, Straight):
        points = np.stack(np.broadcast_arrays(ring, side, s * fitting.length), axis=-1)
    else:
        a, from_axis = s * fitting.angle, fitting.mean_radius - ring
        x, z = fitting.mean_radius - from_axis * np.cos(a), from_axis * np.sin(a)
        points = np.stack(np.broadcast_arrays(x, side, z), axis=-1)
    index = np.arange((turns + 1) * sections).reshape(turns + 1, sections)
    a, b = index[:-1], index[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = [
        np.stack(corners, axis=-1).reshape(-1, 3)
        for corners in ((a, b, a_next), (a_next, b, b_next))
    ]
    return trimesh.Trimesh(points.reshape(-1, 3), np.concatenate(faces), process=False)


def add_wall(client: int, network: PipeNetwork, settings: BulletSettings) -> int:
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
    """Largest distance and 99 % quantile, mm, of the surface that lugs meet from the exact one.

    A sphere as large as a lug is held ``PROBE_GAP`` off the exact surface, and the engine is asked
    for the gap. On the fittings that bend or branch; in a straight route on all of it.
    """
    network = scenario.route.network
    radius = scenario.robot.lug_radius - scenario.robot.track_offset
    parts = [p for p in network.parts if not isinstance(p.fitting, Straight)] or list(network.parts)
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


def probe_centres(
    network: PipeNetwork, parts: list, radius: float, number: int, seed: int
) -> Array:
    """Centres (number, 3) m of spheres at random over ``parts``, ``PROBE_GAP`` off the surface."""
    rng = np.random.default_rng(seed)
    samples = np.concatenate([part.bore_samples() for part in parts])
    chosen = []
    while sum(map(len, chosen)) < number:
        points = samples[rng.integers(len(samples), size=number)] + rng.normal(0, 0.01, (number, 3))
        distance, gradient = network.signed_distance(points)
        points = points + gradient * (radius + PROBE_GAP - distance)[:, None]
        distance = network.signed_distance(points)[0]
        # Leave out spheres that reach past an open end or touch elsewhere, too.
        inside = np.max([part.extent(points) for part in parts], axis=0) > radius
        chosen.append(points[inside & (np.abs(distance - radius - PROBE_GAP) < PROBE_GAP / 2)])
    return np.concatenate(chosen)[:number]
