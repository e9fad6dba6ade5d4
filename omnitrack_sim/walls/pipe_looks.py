"""Looks of pipes in models of MuJoCo: their meshes, cameras and lights, without mass or contact."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, frame_of, quaternion_from_matrix, unit
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.walls.meshes import THICKNESS, TriangleMesh, cutaway_mesh, inside_mesh

ROBOT_GROUP, PIPE_GROUP = 2, 1
"""Groups of what is seen of a robot, and of the pipes."""
FRONT_GROUP = 4
"""The halves of the pipes that are cut away: hidden, but for the camera within the pipe."""
INSIDE_GROUP = 5
"""The insides of the pipes, which are seen from within only: from outside one looks through the
nearer wall."""
FIELD_OF_VIEW = 32.0
"""Vertical field of view of the outside cameras, degrees."""
ASPECT = 16 / 9
SHADOW_CLIP = 0.6
"""Half-width of the shadow map over the model's extent: smaller is sharper, and has to hold the
pipes."""
PIPE_LOOK = ((0.60, 0.67, 0.74), 0.25, 0.3)
"""Red, green, blue, gloss and shininess of the pipes' material."""


def view_direction(network: Assembly) -> Array:
    """Unit vector (3,), world, from the pipes to the viewer: across the first bend or tee.

    Without a bend, across the first pipe's axis. Of two sides the one nearer to front and above
    (-y, +z).
    """
    # A little of x as well, which decides for a normal along x.
    liking = np.array([0.1, -1.0, 0.4])
    for part in network.parts:
        if not part.fitting.is_axial:
            normal = part.pose.rotation[:, 1]
            return normal * math.copysign(1.0, normal @ liking)
    axis = network.parts[0].pose.rotation[:, 2]
    return (
        unit(liking * [0, 1, 0] - (liking * [0, 1, 0] @ axis) * axis)
        if abs(axis[1]) < 0.99
        else np.array([1.0, 0, 0])
    )


def add_pipe_looks(spec: mujoco.MjSpec, network: Assembly) -> None:
    """Add each part cut open towards the viewer: ``pipe_<part>``, and ``front_<part>`` cut off.

    The first are in group 1, the others in group 4.
    """
    if spec.material("pipe") is None:
        add_material(spec, "pipe", PIPE_LOOK)
    towards = view_direction(network)
    for part in network.parts:
        local = part.pose.rotation.T @ towards
        for look, keep, group in (("pipe", True, PIPE_GROUP), ("front", False, FRONT_GROUP)):
            mesh = cutaway_mesh(part.fitting, local, keep=keep)
            _add_pipe(spec, f"{look}_{part.name}", mesh, part, group)


def add_pipe_insides(
    spec: mujoco.MjSpec,
    network: Assembly,
    body: mujoco.MjsBody | None = None,
    group: int = INSIDE_GROUP,
) -> None:
    """Add the inner surface of each part as ``inside_<part>``, for a viewer who moves about.

    ``body`` carries it, in whose frame the network then stands.

    Renderers that pass over faces seen from behind, as MuJoCo's does, open the pipes towards any
    viewer by themselves.
    """
    if spec.material("pipe") is None:
        add_material(spec, "pipe", PIPE_LOOK)
    for part in network.parts:
        mesh = inside_mesh(part.fitting)
        _add_pipe(spec, f"inside_{part.name}", mesh, part, group, body)


def follow_direction(network: Assembly) -> Array:
    """Unit vector (3,), world, from the robot to the camera that keeps with it."""
    return camera_frame(view_direction(network))[:, 2]


def add_material(
    spec: mujoco.MjSpec, name: str, look: tuple[Sequence[float], float, float]
) -> None:
    """Add a material of red, green and blue, gloss and shininess."""
    colour, specular, shininess = look
    spec.add_material(name=name, rgba=[*colour, 1.0], specular=specular, shininess=shininess)


def add_cameras(
    spec: mujoco.MjSpec,
    network: Assembly,
    chassis: mujoco.MjsBody | None = None,
    size: float = 1.0,
) -> None:
    """Add lights and the camera ``side``, and cameras ``follow`` and ``onboard`` to a robot.

    ``side`` shows all pipes, ``follow`` keeps with the robot on the cut side, ``onboard`` looks
    forward. ``chassis``: its nose is along its z axis. ``size``: the robot's scale.
    """
    towards = view_direction(network)
    frame = camera_frame(towards)
    up = _upward(towards)
    right, back = np.cross(up, towards), frame[:, 2]
    low, high = _corners(network)
    middle, distance = _fit(low, high, frame)
    quaternion = quaternion_from_matrix(frame)
    spec.worldbody.add_camera(
        name="side", pos=middle + distance * back, quat=quaternion, fovy=FIELD_OF_VIEW
    )
    if chassis is not None:
        track = mujoco.mjtCamLight.mjCAMLIGHT_TRACK
        chassis.add_camera(
            name="follow", pos=0.48 * size * back, quat=quaternion, fovy=FIELD_OF_VIEW, mode=track
        )
        # Cameras look along their -z: turned onto the robot's z, with module 1 upward in the
        # picture.
        forward = quaternion_from_matrix(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]))
        chassis.add_camera(name="onboard", pos=[0, 0, 0.086 * size], quat=forward, fovy=88.0)
        lamp = chassis.add_light(
            name="lamp", pos=[0, 0, 0.09 * size], dir=[0, 0, 1], castshadow=False, cutoff=80
        )
        lamp.exponent = 2
        lamp.diffuse, lamp.attenuation = [0.9, 0.87, 0.8], [1, 0, 3]
    _add_sun(spec, middle, distance, unit(towards + 0.55 * up - 0.40 * right))


def _add_sun(spec: mujoco.MjSpec, middle: Array, distance: float, direction: Array) -> None:
    sun = spec.worldbody.add_light(
        name="sun", pos=middle + distance * direction, dir=-direction, castshadow=True
    )
    sun.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun.diffuse, sun.specular, sun.ambient = [0.50, 0.49, 0.46], [0.2, 0.2, 0.2], [0.0, 0.0, 0.0]
    spec.visual.map.shadowclip = SHADOW_CLIP
    head = spec.visual.headlight
    head.ambient, head.diffuse, head.specular = (
        [0.36, 0.36, 0.38],
        [0.34, 0.34, 0.35],
        [0.1, 0.1, 0.1],
    )
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        sky = spec.add_texture(
            name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=256, height=1536
        )
        sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
        sky.rgb1, sky.rgb2 = [0.16, 0.19, 0.24], [0.42, 0.46, 0.52]


def _upward(towards: Array) -> Array:
    """Return up in the picture (3,), square to the viewing direction: world z, or y along z."""
    up = np.array([0.0, 0, 1]) if abs(towards[2]) < 0.9 else np.array([0.0, 1, 0])
    return unit(up - (up @ towards) * towards)


def camera_frame(towards: Array) -> Array:
    """Return right, up and back (columns, world) of a camera that looks at pipes cut open.

    ``towards``: (3,), in which they are; it looks from a little above and to the right of it.
    """
    up = _upward(towards)
    back = unit(towards + 0.20 * up + 0.16 * np.cross(up, towards))
    right = unit(np.cross(up, back))
    return frame_of(right, back)


def _corners(network: Assembly) -> tuple[Array, Array]:
    """Corners (3,), (3,) m of the box about all pipes, world frame."""
    points = np.concatenate([part.bore_samples() for part in network.parts])
    return points.min(axis=0) - THICKNESS, points.max(axis=0) + THICKNESS


def _fit(low: Array, high: Array, frame: Array) -> tuple[Array, float]:
    """Return centre (3,) m and camera distance, m, that bring a box into the picture."""
    corners = np.array(list(product(*zip(low, high, strict=True))))
    middle = (low + high) / 2
    in_view = (corners - middle) @ frame  # (8, 3) right, up, back
    half = math.tan(math.radians(FIELD_OF_VIEW / 2))
    wanted = (
        np.maximum(np.abs(in_view[:, 0]) / (half * ASPECT), np.abs(in_view[:, 1]) / half)
        + in_view[:, 2]
    )
    return middle, 1.06 * float(wanted.max())


def add_mesh(spec: mujoco.MjSpec, name: str, mesh: TriangleMesh) -> None:
    """Add a mesh of triangles to a model, as a shell."""
    spec.add_mesh(
        name=name,
        uservert=np.asarray(mesh.vertices, np.float32).ravel(),
        userface=np.asarray(mesh.faces, np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )


def _add_pipe(
    spec: mujoco.MjSpec,
    name: str,
    mesh: TriangleMesh,
    part: Part,
    group: int,
    body: mujoco.MjsBody | None = None,
) -> None:
    """Show ``mesh``, in the frame of a fitting, where that part of the network lies."""
    add_mesh(spec, name, mesh)
    position, quaternion = part.pose.position, part.pose.quaternion
    carrier = body or spec.worldbody
    geom = add_look(carrier, name, "pipe", meshname=name, pos=position, quat=quaternion)
    geom.group = group


def add_look(
    body: mujoco.MjsBody, name: str, material: str, kind: str = "mesh", **fields: object
) -> mujoco.MjsGeom:
    """Add a geom ``look_<name>`` that is only seen; ``kind`` is MuJoCo's word for its shape."""
    return body.add_geom(
        name=f"look_{name}",
        material=material,
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"),
        group=ROBOT_GROUP,
        contype=0,
        conaffinity=0,
        mass=0,
        density=0,
        **fields,
    )
