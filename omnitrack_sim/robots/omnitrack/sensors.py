"""Sensors of the robot: functions from the state of the physics to its channels.

They read without error; forces and velocities are those of the last physics step. All sums over x,
y and z are taken in one order, so that a robot reads the same bits alone and in a batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array, cross, dot, matrix_from_quaternion, ordered_sum
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES
from omnitrack_sim.robots.omnitrack.channels import CHANNELS, MODULES
from omnitrack_sim.robots.omnitrack.drive import (
    EFFICIENCY,
    FRICTION,
    LIMIT,
    TORQUE_PER_AMPERE,
    Drive,
)
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.robots.omnitrack.motors import current_of
from omnitrack_sim.robots.sensor import Sensor, State


@dataclass(frozen=True)
class Addresses:
    """Addresses of the robot's parts in MuJoCo's arrays; modules first, then tracks.

    Attributes:
        slide, pitch, roll: (3,) in ``qpos``.
        belts: (3, 2) in ``qpos``.
        slide_dofs, pitch_dofs: (3,) in ``qvel``.
        belt_dofs: (3, 2) in ``qvel``.
        sprockets: (3, 2) in ``qpos``, front and rear.
        tracks: (3, 2) bodies.
        places: (3, 3) in ``xpos``, of the modules.
        forward: (3, 3) in ``xmat``: the modules' axes.
        chassis: (3,) in ``xpos``.
        frame: (3, 3) in ``xmat``: the chassis, axis by axis.
        contact: (3, k, 7) in ``sensordata``: found, force (3,), position (3,) of each part of the
            chain: upper and lower track, and on exact walls front and rear sprocket.
        touch: (3, k) in ``sensordata``: sum of the normal forces of each part.
        belt_motors: (m,) actuators.
        roll_motors: (3,) actuators.
        drive: the gears between the belts and their motors.
    """

    slide: NDArray[np.intp]
    pitch: NDArray[np.intp]
    roll: NDArray[np.intp]
    belts: NDArray[np.intp]
    slide_dofs: NDArray[np.intp]
    pitch_dofs: NDArray[np.intp]
    belt_dofs: NDArray[np.intp]
    places: NDArray[np.intp]
    forward: NDArray[np.intp]
    chassis: NDArray[np.intp]
    frame: NDArray[np.intp]
    sprockets: NDArray[np.intp]
    tracks: NDArray[np.intp]
    contact: NDArray[np.intp]
    touch: NDArray[np.intp]
    belt_motors: NDArray[np.intp]
    roll_motors: NDArray[np.intp]
    drive: Drive


_COS, _SIN = (f(MODULE_ANGLES)[:, None] for f in (np.cos, np.sin))  # (3, 1)
AT_REST = 1e-3
"""Speed below which no slip ratio is formed, m/s."""


def _motor_torque(state: State) -> Array:
    motors = state.actuator_force.take(state.at.belt_motors, axis=1)  # (n, m) N
    return state.at.drive.belt_values(motors) * state.robot.lug_radius


def _contact(state: State) -> Array:
    """Net contact of each part of the chains (n, 3, k, 7), world frame.

    The seven numbers are: found, force on the wall (3), position (3).
    """
    if "contact" not in state.shared:
        state.shared["contact"] = state.sensordata.take(state.at.contact, axis=1)
    return state.shared["contact"]


def _force(state: State) -> Array:
    """Force of the wall on each part of the chains (n, 3, k, 3) N, world frame."""
    if "force" not in state.shared:
        state.shared["force"] = -_contact(state)[..., 1:4]
    return state.shared["force"]


def _forward(state: State) -> Array:
    """Axis of each module (n, 3, 3), world frame."""
    if "forward" not in state.shared:
        state.shared["forward"] = state.xmat.take(state.at.forward, axis=1)
    return state.shared["forward"]


def _traction(state: State) -> Array:
    return ordered_sum(dot(_force(state), _forward(state)[:, :, None]))


def _normal_force(state: State) -> Array:
    return ordered_sum(state.sensordata.take(state.at.touch, axis=1))


def _contact_count(state: State) -> Array:
    count = _contact(state)[..., 0]
    # Both runs pass over the sprockets.
    return count[..., :2] + ordered_sum(count[..., 2:])[..., None] if count.shape[-1] > 2 else count


def _contact_position(state: State) -> Array:
    contact, force = _contact(state), _force(state)
    # Weighted by force: a track that hardly touches hardly moves the centre.
    weight = np.sqrt(dot(force, force))  # (n, 3, k)
    total = ordered_sum(weight)
    places = np.stack([ordered_sum(weight * contact[..., axis]) for axis in (4, 5, 6)], axis=-1)
    known = total > 0
    if np.count_nonzero(known) == known.size:
        return places / total[..., None]
    centre = places / np.where(known, total, 1.0)[..., None]
    return np.where(known[..., None], centre, state.last("contact_position"))


def _module_speed(state: State) -> Array:
    # Friction acts on the velocities at the end of a step in the geometry at its beginning, to
    # which positions and contacts belong; ``belt_speed`` is that of the end as well.
    at, qvel = state.at, state.qvel
    x, y, z = (state.xmat.take(axis, axis=1)[:, None] for axis in at.frame)  # (n, 1, 3)
    slide, pitch = (qvel.take(dofs, axis=1)[..., None] for dofs in (at.slide_dofs, at.pitch_dofs))
    spin = x * qvel[:, None, 3:4] + y * qvel[:, None, 4:5] + z * qvel[:, None, 5:6]
    place = state["contact_position"]
    from_centre = place - state.xpos.take(at.chassis, axis=1)[:, None]
    # A module that pitches or turns moves otherwise at the contact than at its centre.
    from_module = place - state.xpos.take(at.places, axis=1)
    velocity = qvel[:, None, :3] + cross(spin, from_centre) + slide * (x * _COS + y * _SIN)
    velocity += pitch * cross(y * _COS - x * _SIN, from_module)
    return dot(velocity, _forward(state))


def _slip_velocity(state: State) -> Array:
    count = state["contact_count"]
    # Off the wall there is nothing to slip on.
    touching = np.maximum(count[..., 0], count[..., 1]) > 0
    return np.where(touching, state["wall_speed"] - state["module_speed"], 0.0)


def _slip_ratio(state: State) -> Array:
    scale = np.maximum(np.abs(state["wall_speed"]), np.abs(state["module_speed"]))
    ratio = state["slip_velocity"] / np.maximum(scale, AT_REST)
    return np.where(scale > AT_REST, np.minimum(np.maximum(ratio, -1.0), 1.0), 0.0)


def _motor_current(state: State) -> Array:
    drive = state.at.drive
    if state.robot.motor.winding is None:
        fault = f"is {state.robot.motor.name!r}, which has no winding to tell its current"
        raise InputError(Fault("robot.motor", fault))
    torque = drive.motor_forces(state["motor_torque"]) / drive.size
    speed = drive.motor_values(state["belt_speed"]) / state.robot.lug_radius
    figures = (EFFICIENCY, FRICTION, LIMIT, TORQUE_PER_AMPERE)
    own = [state.motor_figures[:, k : k + 1] for k in figures]
    current = drive.size * current_of(torque, speed, *own)  # (n, m)
    driven = np.where(drive.matrix, current[..., None], 0.0)  # (n, m, 3)
    return driven.max(axis=-2)


_READ: dict[str, Callable[[State], Array]] = {
    "time": lambda state: state.time,
    "position": lambda state: state.qpos[:, :3],
    "quaternion": lambda state: state.qpos[:, 3:7],
    "rotation": lambda state: matrix_from_quaternion(state["quaternion"]),
    "angular_velocity": lambda state: state.qvel[:, 3:6],
    "belt_speed": lambda state: state.qvel.take(state.at.belt_dofs[:, 0], axis=1),
    "wall_speed": lambda state: state["belt_speed"] * belt_sign(state["roll"]),
    "motor_torque": _motor_torque,
    "traction": _traction,
    "normal_force": _normal_force,
    "slip_velocity": _slip_velocity,
    "slip_ratio": _slip_ratio,
    "contact_count": _contact_count,
    "contact_position": _contact_position,
    "module_speed": _module_speed,
    "slide": lambda state: state.qpos.take(state.at.slide, axis=1),
    "pitch": lambda state: state.qpos.take(state.at.pitch, axis=1),
    "roll": lambda state: state.qpos.take(state.at.roll, axis=1),
}
SENSORS = tuple(
    Sensor(channel, _READ[name], looks_back=name == "contact_position")
    for name, channel in CHANNELS.items()
    if channel.source == "plant"
)
"""One sensor for each channel of the schema that the plant measures."""
MOTOR_CURRENT = Sensor(
    Channel(
        "motor_current",
        (MODULES,),
        "A",
        "size of the current of the motor that drives each belt, the largest where several do",
        tail_first="swapped",
    ),
    _motor_current,
)
"""Sensor for ``record.sensors`` of a robot whose motor has a ``winding``, as a motor driver has it.

By name it is ``omnitrack_sim.robots.omnitrack.sensors:MOTOR_CURRENT``.
"""
