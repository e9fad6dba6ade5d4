"""The motors of the belts as MJCF, with the gears between motors and belts."""

from __future__ import annotations

import mujoco
import numpy as np

from omnitrack_sim.drive import Drive, drive_of
from omnitrack_sim.robot import Robot

OUTPUT_INERTIA = 0.02
"""Inertia of a belt with its sprockets behind gears that it shares with others, as a part of the
reflected inertia of a motor: 0.2 kg; numerical."""


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
    """Velocity servos ``belt_k`` of the robot's drive, m/s; their forces are in N at the
    belts.

    A motor that drives one belt alone acts on its upper run. Others act on a tendon whose length
    changes as the motor turns: its armature is the rotor's inertia. Where gears leave the belts
    free to move against each other, tendons ``gear_i`` can hold them by friction, see
    ``robot.gear_friction``.
    """
    drive = drive_of(robot.drive)
    for number, row in enumerate(drive.matrix, start=1):
        name = f"belt_{number}"
        kind, target = mujoco.mjtTrn.mjTRN_JOINT, f"belt_upper_{number}"
        if not drive.direct:
            kind, target = mujoco.mjtTrn.mjTRN_TENDON, name
            _add_gear(spec, name, row).armature = drive.size * belt_inertia(robot)
        limit = drive.size * belt_force(robot)
        motor = spec.add_actuator(
            name=name,
            trntype=kind,
            target=target,
            forcelimited=True,
            forcerange=[-limit, limit],
        )
        motor.set_to_velocity(kv=drive.size * belt_inertia(robot) * robot.motor.speed_bandwidth)
    if robot.gear_friction > 0:
        for belt, name in friction_tendons(drive):
            _add_gear(spec, name, drive.relative[belt])


def friction_tendons(drive: Drive) -> list[tuple[int, str]]:
    """Belts, from 0, that gears leave free to move against others, each with its tendon's name."""
    return [(i, f"gear_{i + 1}") for i, row in enumerate(drive.relative) if row.any()]


def _add_gear(spec: mujoco.MjSpec, name: str, row: np.ndarray) -> mujoco.MjsTendon:
    """A tendon as long as the belts have moved, each times its coefficient in ``row`` (3,)."""
    tendon = spec.add_tendon(name=name)
    for belt, coefficient in enumerate(row, start=1):
        if coefficient:
            tendon.wrap_joint(f"belt_upper_{belt}", float(coefficient))
    return tendon
