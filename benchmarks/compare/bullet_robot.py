"""The robot as URDF text, for PyBullet."""

from __future__ import annotations

import math

import numpy as np

from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, Omnitrack
from omnitrack_sim.robots.omnitrack.body import lug_places
from omnitrack_sim.robots.omnitrack.channels import TRACKS
from omnitrack_sim.robots.omnitrack.track_plant import NUMBERS

SLIDER_MASS = 1e-3
"""Mass of the link between slide and pitch joint, kg; taken off the arm."""


def _vector(*values: float) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def _inertial(mass: float, across: float, axial: float) -> str:
    return (
        f'<inertial><mass value="{mass:.9g}"/><inertia ixx="{across:.9g}" iyy="{across:.9g}" '
        f'izz="{axial:.9g}"'
        ' ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def _cylinder(mass: float, radius: float, length: float) -> str:
    """Inertia of a solid cylinder along z."""
    return _inertial(mass, mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2)


def _joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str,
    limits: tuple[float, float],
    origin: str = "",
) -> str:
    bounds = f'<limit lower="{limits[0]:.9g}" upper="{limits[1]:.9g}" effort="1e4" velocity="1e3"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child '
        f'link="{child}"/>{origin}'
        f'<axis xyz="{axis}"/>{bounds}<dynamics damping="0" friction="0"/></joint>'
    )


def robot_urdf(robot: Omnitrack) -> str:
    """The robot as URDF text, frames and signs as in ``omnitrack_sim.robots.omnitrack.body``."""
    chassis = _cylinder(robot.chassis_mass, robot.chassis_radius, robot.chassis_length)
    slider_body = _cylinder(SLIDER_MASS, robot.arm_radius, robot.shaft_spacing)
    arm_body = _cylinder(robot.arm_mass - SLIDER_MASS, robot.arm_radius, robot.shaft_spacing)
    parts = [f'<link name="chassis">{chassis}</link>']
    radius, free = robot.lug_radius - robot.track_offset, (1.0, -1.0)
    track_inertia = robot.track_mass * robot.lug_radius**2
    track_body = _inertial(robot.track_mass, track_inertia, track_inertia)
    for number, angle in zip(NUMBERS, MODULE_ANGLES, strict=True):
        place = robot.module_distance * np.array([math.cos(angle), math.sin(angle), 0.0])
        origin = f'<origin xyz="{_vector(*place)}" rpy="{_vector(0, 0, angle)}"/>'
        slider, arm, module = f"slider_{number}", f"arm_{number}", f"module_{number}"
        parts += [
            f'<link name="{slider}">{slider_body}</link>',
            _joint(
                f"slide_{number}",
                "prismatic",
                "chassis",
                slider,
                "1 0 0",
                robot.slide_range,
                origin,
            ),
            f'<link name="{arm}">{arm_body}</link>',
            _joint(
                f"pitch_{number}",
                "revolute",
                slider,
                arm,
                "0 1 0",
                (-robot.pitch_limit, robot.pitch_limit),
            ),
            "<link "
            f'name="{module}">'
            f"{_cylinder(robot.module_mass, robot.lug_radius, robot.length)}</link>",
            _joint(f"roll_{number}", "continuous", arm, module, "0 0 1", free),
        ]
        for track, side in zip(TRACKS, (1.0, -1.0), strict=True):
            name = f"track_{track}_{number}"
            lugs = "".join(
                f'<collision><origin xyz="{_vector(side * robot.track_offset, 0, z)}"/>'
                f'<geometry><sphere radius="{radius:.9g}"/></geometry></collision>'
                for z in lug_places(robot)
            )
            parts += [
                f'<link name="{name}">{track_body}{lugs}</link>',
                _joint(f"belt_{track}_{number}", "prismatic", module, name, f"0 0 {-side:g}", free),
            ]
    return f'<?xml version="1.0"?><robot name="omnitrack">{"".join(parts)}</robot>'
