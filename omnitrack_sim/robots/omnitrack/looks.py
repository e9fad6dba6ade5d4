"""Looks of the robot: visual geoms, without mass or contact."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from manifold3d import CrossSection, Manifold

from omnitrack_sim.record.display import MODULE_COLOURS
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, Omnitrack
from omnitrack_sim.robots.omnitrack.body import MODULE_ENDS
from omnitrack_sim.robots.omnitrack.channels import TRACKS
from omnitrack_sim.walls.meshes import TriangleMesh, loft, triangles_of
from omnitrack_sim.walls.pipe_looks import PIPE_LOOK, ROBOT_GROUP, add_look, add_material, add_mesh

LOWER_TRACK_TINT = 0.6
"""Part of its module's colour in a lower track, the rest is white: roll is seen, and the module
still told by its colour, which a dark shade would hide."""
LUGS_SHOWN = 6
"""Lugs drawn on a track. They stand wider than the lugs of the physics, so that a film shows which
way they run."""

_MATERIALS = {
    "abs": ((0.97, 0.95, 0.90), 0.25, 0.2),
    "steel": ((0.74, 0.76, 0.80), 0.9, 0.8),
    "dark": ((0.13, 0.14, 0.16), 0.4, 0.4),
    "lens": ((0.35, 0.75, 1.0), 1.0, 0.9),
    "pipe": PIPE_LOOK,
}


def look_pitch(robot: Omnitrack) -> float:
    """Return the distance of neighbouring lugs in pictures, m.

    A picture looks the same when a belt has run this far.
    """
    return robot.contact_length / LUGS_SHOWN


def add_robot_looks(spec: mujoco.MjSpec, robot: Omnitrack, coarse: bool = False) -> None:
    """Add the looks of chassis, shafts, springs, arms, modules and lugs (group 2).

    Lugs are drawn on their tracks, or on the module of a robot that has none.

    Everything is drawn on a robot of scale 1, and then made as large as this one. ``coarse``: lugs
    and springs have a third of the faces, for films, in which a face is as large as a pixel.
    """
    _add_materials(spec)
    size = robot.scale
    robot = robot if size == 1 else robot.scaled(1 / size)
    end, spacing = robot.length / 2, robot.shaft_spacing
    shaft = min(spacing / 2, end - 0.008) + 0.004
    meshes = {
        "chassis_core": triangular_prism(0.010, 2 * shaft),
        "chassis_end": triangular_prism(0.016, 0.018),
        "spring": coil(0.0056, 0.0009, 0.024, 6, *((8, 3) if coarse else (14, 6))),
        "lugs": lug_row(
            robot.lug_radius, 0.0065, look_pitch(robot), LUGS_SHOWN, 10 if coarse else 36
        ),
    }
    for name, mesh in meshes.items():
        add_mesh(spec, name, TriangleMesh(size * mesh.vertices, mesh.faces))
    _dress_chassis(spec, robot, shaft)
    for number in range(1, len(MODULE_ANGLES) + 1):
        _dress_arm(spec.body(f"arm_{number}"), number, shaft)
        _dress_module(spec.body(f"module_{number}"), robot, number)
        for track, flip in zip(TRACKS, ([1, 0, 0, 0], [0, 0, 0, 1]), strict=True):
            body = spec.body(f"track_{track}_{number}") or spec.body(f"module_{number}")
            add_look(
                body, f"lugs_{track}_{number}", f"{track}_{number}", meshname="lugs", quat=flip
            )
    visible = [geom for geom in spec.body("chassis").find_all("geom") if geom.group == ROBOT_GROUP]
    for geom in visible if size != 1 else ():
        for place in ("pos", "size", "fromto"):
            setattr(geom, place, size * getattr(geom, place))


def _dress_chassis(spec: mujoco.MjSpec, robot: Omnitrack, shaft: float) -> None:
    chassis = spec.body("chassis")
    add_look(chassis, "chassis_core", "abs", meshname="chassis_core")
    for end, side in MODULE_ENDS.items():
        add_look(chassis, f"chassis_{end}", "abs", meshname="chassis_end", pos=[0, 0, side * shaft])
        for number, angle in enumerate(MODULE_ANGLES, start=1):
            out = np.array([math.cos(angle), math.sin(angle), 0.0])
            across = np.array([-out[1], out[0], 0.0])
            for k, offset in enumerate((0.0095, -0.0095)):
                root = offset * across + [0, 0, side * shaft]
                tip = root + (robot.module_distance + 0.012) * out
                add_look(
                    chassis,
                    f"shaft_{end}_{number}_{k}",
                    "steel",
                    "capsule",
                    fromto=[*root, *tip],
                    size=[0.0025, 0, 0],
                )
    nose = shaft + 0.009
    _drum(chassis, "eye_ring", nose - 0.004, nose + 0.006, 0.0095)
    add_look(chassis, "eye", "lens", "sphere", pos=[0, 0, nose + 0.004], size=[0.0065, 0, 0])


def _dress_arm(arm: mujoco.MjsBody, number: int, shaft: float) -> None:
    """Brackets that carry the module at both ends, and the springs that push them out."""
    for end, side in MODULE_ENDS.items():
        z = side * shaft
        bracket, size = f"bracket_{end}_{number}", [0.011, 0.0165, 0.005]
        add_look(arm, bracket, "abs", "box", pos=[-0.004, 0, z], size=size)
        _drum(arm, f"hub_{end}_{number}", z - side * 0.008, z + side * 0.007, 0.008)
        for k, offset in enumerate((0.0095, -0.0095)):
            place = [-0.038, offset, z]
            add_look(arm, f"spring_{end}_{number}_{k}", "steel", meshname="spring", pos=place)


def _dress_module(module: mujoco.MjsBody, robot: Omnitrack, number: int) -> None:
    """Core of the module and the rounded ends of its tracks."""
    half, radius = robot.contact_length / 2, robot.lug_radius - 0.0058
    _drum(module, f"core_{number}", -half - 0.004, half + 0.004, radius)
    for end, side in MODULE_ENDS.items():
        tip, size = [0, 0, side * (half + 0.004)], [radius, radius, 0.011]
        add_look(module, f"cap_{end}_{number}", "dark", "ellipsoid", pos=tip, size=size)


def _add_materials(spec: mujoco.MjSpec) -> None:
    if spec.material("abs") is not None:
        return
    materials: dict[str, tuple[tuple[float, ...], float, float]] = {
        name: (*look,) for name, look in _MATERIALS.items()
    }
    for number, colour in enumerate(MODULE_COLOURS, start=1):
        materials[f"upper_{number}"] = (colour, 0.35, 0.3)
        pale = tuple(1.0 - LOWER_TRACK_TINT * (1.0 - part) for part in colour)
        materials[f"lower_{number}"] = (pale, 0.35, 0.3)
    for name, look in materials.items():
        add_material(spec, name, look)


def _drum(body: mujoco.MjsBody, name: str, start: float, end: float, radius: float) -> None:
    """Add a dark cylinder about the z axis of a body, from ``start`` to ``end`` m."""
    ends = [0, 0, start, 0, 0, end]
    add_look(body, name, "dark", "cylinder", fromto=ends, size=[radius, 0, 0])


LUG_ARC_DEG = 164.0
"""Arc of a half-round lug about the module axis; the rest is the gap between the two tracks."""


CORNER = 0.003
"""Rounding radius of the chassis's edges, m."""


def triangular_prism(inradius: float, length: float) -> TriangleMesh:
    """Return a prism along z, centred, with a face towards each module and rounded edges.

    Args:
        inradius: from its axis to a face, m.
        length: m.
    """
    angles = math.pi + np.arange(3) * 2 * math.pi / 3
    points = 2 * (inradius - CORNER) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    section = CrossSection.hull_points(points).offset(CORNER, circular_segments=24)
    return triangles_of(Manifold.extrude(section, length).translate((0.0, 0.0, -length / 2)))


def lug_row(radius: float, depth: float, pitch: float, count: int, steps: int) -> TriangleMesh:
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
    return triangles_of(Manifold.compose([lug.translate((0.0, 0.0, float(z))) for z in places]))


def coil(
    radius: float, wire: float, length: float, turns: float, steps: int, sides: int
) -> TriangleMesh:
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
    # Faces have to look outward, whichever way the rings were joined: back faces are not drawn.
    return TriangleMesh(*loft(centre[:, None] + wire * ring, hub=0)).outward()
