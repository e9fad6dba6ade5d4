"""Shapes of the robot's visible parts as triangle meshes, m. They have no part in the physics."""

from __future__ import annotations

import math

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold

from omnitrack_sim.walls.meshes import manifold_to_trimesh

LUG_ARC_DEG = 164.0
"""Arc of a half-round lug about the module axis; the rest is the gap between the two tracks."""


def triangular_prism(inradius: float, length: float, corner: float = 0.003) -> trimesh.Trimesh:
    """Prism along z, centred, with a face towards each module (0, +-120 degrees) and rounded edges.

    Args:
        inradius: axis to face, m.
        length: m.
        corner: rounding radius, m.
    """
    angles = math.pi + np.arange(3) * 2 * math.pi / 3
    points = 2 * (inradius - corner) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    section = CrossSection.hull_points(points).offset(corner, circular_segments=24)
    return manifold_to_trimesh(Manifold.extrude(section, length).translate((0.0, 0.0, -length / 2)))


def lug_row(
    radius: float, depth: float, pitch: float, count: int, steps: int = 36
) -> trimesh.Trimesh:
    """A row of half-round lugs along z, centred, on the +x side of the module axis.

    Args:
        radius: module axis to lug surface, m.
        depth: radial height of a lug, m.
        pitch: distance of neighbouring lugs, m; a lug takes 62 % of it.
        count: number of lugs.
        steps: faces along the arc of a lug.
    """
    half, bevel = 0.31 * pitch, 0.1 * pitch
    profile = [
        (radius - depth, -half),
        (radius - bevel, -half),
        (radius, bevel - half),
        (radius, half - bevel),
        (radius - bevel, half),
        (radius - depth, half),
    ]
    lug = Manifold.revolve(
        CrossSection([np.array(profile)]), circular_segments=steps, revolve_degrees=LUG_ARC_DEG
    )
    lug = lug.rotate((0.0, 0.0, -LUG_ARC_DEG / 2))
    places = (np.arange(count) - (count - 1) / 2) * pitch
    return manifold_to_trimesh(
        Manifold.compose([lug.translate((0.0, 0.0, float(z))) for z in places])
    )


def coil(
    radius: float, wire: float, length: float, turns: float, steps: int = 14, sides: int = 6
) -> trimesh.Trimesh:
    """A helical spring along x from the origin, m.

    Args:
        radius: of the helix.
        wire: radius of the wire.
        length: along x.
        turns: number of turns.
        steps: points on one turn.
        sides: corners of the wire's section.
    """
    angle = np.linspace(0.0, 2 * math.pi * turns, round(turns * steps) + 1)
    outward = np.stack([np.zeros_like(angle), np.cos(angle), np.sin(angle)], axis=-1)
    centre = radius * outward + np.stack(
        [length * angle / angle[-1], 0 * angle, 0 * angle], axis=-1
    )
    around = np.arange(sides) * 2 * math.pi / sides
    ring = np.cos(around)[None, :, None] * outward[:, None] + np.sin(around)[
        None, :, None
    ] * np.array([1.0, 0, 0])
    vertices = (centre[:, None] + wire * ring).reshape(-1, 3)
    index = np.arange(len(vertices)).reshape(len(angle), sides)
    a, b = index[:-1], index[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = np.concatenate(
        [
            np.stack([a, a_next, b], -1).reshape(-1, 3),
            np.stack([a_next, b_next, b], -1).reshape(-1, 3),
        ]
    )
    fan = np.array([(0, i, i + 1) for i in range(1, sides - 1)])
    faces = np.concatenate([faces, index[0][fan][:, ::-1], index[-1][fan]])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh
