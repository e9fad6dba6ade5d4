"""The motors of the belts as MJCF, with the gears between motors and belts."""

from __future__ import annotations

import mujoco
import numpy as np

from omnitrack_sim.robots.omnitrack import MODULES, Robot
from omnitrack_sim.robots.omnitrack.drive import Drive, drive_of
from omnitrack_sim.robots.omnitrack.similarity import similar

OUTPUT_INERTIA = 0.02
"""Inertia of a belt with its sprockets behind gears that it shares with others, as a part of the
reflected inertia of a motor: 0.2 kg; numerical."""
GEAR_TIME, GEAR_IMPEDANCE, FRICTION_IMPEDANCE = 0.004, (0.99, 0.99), (0.9995, 0.9995)
"""Time constant, s, impedance of the tie between a shaft and its belts, and that of friction
in gears and brakes; numerical."""


def belt_inertia(robot: Robot) -> float:
    """Reflected inertia of the crawler gearmotor at the belt, kg: J / r²."""
    return robot.motor.reflected_inertia / robot.lug_radius**2


def belt_force(robot: Robot) -> float:
    """Largest force of a crawler motor at the belt, N: its torque limit over the lug radius."""
    return robot.crawler_motor.torque_limit / robot.lug_radius


def output_inertia(robot: Robot) -> float:
    """Inertia at a belt that is the belt's own, kg: the rotor's where the motor drives this belt
    alone, else a small part of it."""
    own = 1.0 if drive_of(robot.drive).direct else OUTPUT_INERTIA
    return own * belt_inertia(robot)


def add_belt_motors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Velocity servos ``belt_k`` of the robot's drive, m/s; their forces are in N at the belts.

    A motor that drives one belt alone acts on its upper run. Others act on the slide joint
    ``shaft_k`` of a body of its own, with the rotor's inertia, which is tied to the mean motion of
    its belts. (A tendon with armature would not do: MuJoCo leaves out the inertia that such a
    tendon puts between joints of different branches.) Where gears leave the belts free to move
    against each other, tendons ``gear_i`` can hold them by friction, see ``robot.gear_friction``.
    """
    drive = drive_of(robot.drive)
    if robot.brake_force > 0:
        for i in range(1, MODULES + 1):
            _hold_well(spec.joint(f"belt_upper_{i}"), robot)
    for number, row in enumerate(drive.matrix, start=1):
        joint = f"belt_upper_{number}" if drive.direct else _add_shaft(spec, robot, number, row)
        limit = drive.size * belt_force(robot)
        motor = spec.add_actuator(
            name=f"belt_{number}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=joint,
            forcelimited=True,
            forcerange=[-limit, limit],
        )
        motor.set_to_velocity(kv=drive.size * belt_inertia(robot) * robot.motor.speed_bandwidth)
    if robot.gear_friction > 0:
        for belt, name in friction_tendons(drive):
            _hold_well(_add_tendon(spec, name, drive.relative[belt]), robot)


def _hold_well(rubbing: mujoco.MjsJoint | mujoco.MjsTendon, robot: Robot) -> None:
    """Friction that lets what stands still creep by under 1 mm/s."""
    rubbing.solref_friction = [similar(GEAR_TIME, "s", robot.scale), 1.0]
    rubbing.solimp_friction = [*FRICTION_IMPEDANCE, 1.0, 0.5, 2.0]


def _add_shaft(spec: mujoco.MjSpec, robot: Robot, number: int, row: np.ndarray) -> str:
    """A motor's shaft, geared to belts with coefficients (3,); the name of its joint."""
    joint, inertia = f"shaft_{number}", drive_of(robot.drive).size * belt_inertia(robot)
    body = spec.worldbody.add_body(name=joint, mass=inertia, inertia=[inertia] * 3)
    body.explicitinertial, body.gravcomp = True, 1.0
    body.add_joint(name=joint, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    _add_tendon(spec, f"belts_{number}", row)
    spec.add_tendon(name=joint).wrap_joint(joint, 1.0)
    spec.add_equality(
        name=f"gears_{number}",
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
        name1=f"belts_{number}",
        name2=joint,
        data=[0, 1, *[0] * 10],
        solref=[similar(GEAR_TIME, "s", robot.scale), 1.0],
        solimp=[*GEAR_IMPEDANCE, 1.0, 0.5, 2.0],
    )
    return joint


def friction_tendons(drive: Drive) -> list[tuple[int, str]]:
    """Belts, from 0, that gears leave free to move against others, each with its tendon's name."""
    return [(i, f"gear_{i + 1}") for i, row in enumerate(drive.relative) if row.any()]


def _add_tendon(spec: mujoco.MjSpec, name: str, row: np.ndarray) -> mujoco.MjsTendon:
    """A tendon as long as the belts have moved, each times its coefficient in ``row`` (3,)."""
    tendon = spec.add_tendon(name=name)
    for belt, coefficient in enumerate(row, start=1):
        if coefficient:
            tendon.wrap_joint(f"belt_upper_{belt}", float(coefficient))
    return tendon
