"""The exact values of the shipped channels, read from the physics.

Forces and velocities are those of the last physics step. All sums over x, y and z are taken in one
order, so that a robot reads the same bits alone and in a batch.
"""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import Array, cross, dot, matrix_from_quaternion
from omnitrack_sim.record.channels import CHANNELS
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.robots.omnitrack.kinematics import belt_sign
from omnitrack_sim.senses.sensor import Sensor, State

AT_REST = 1e-3
"""Speed below which no slip ratio is formed, m/s."""


def _time(state: State) -> Array:
    return state.time


def _position(state: State) -> Array:
    return state.qpos[:, :3]


def _quaternion(state: State) -> Array:
    return state.qpos[:, 3:7]


def _rotation(state: State) -> Array:
    return matrix_from_quaternion(state["quaternion"])


def _angular_velocity(state: State) -> Array:
    return state.qvel[:, 3:6]


def _belt_speed(state: State) -> Array:
    return state.qvel.take(state.at.belt_dofs[:, 0], axis=1)


def _wall_speed(state: State) -> Array:
    return state["belt_speed"] * belt_sign(state["roll"])


def _motor_torque(state: State) -> Array:
    motors = state.actuator_force.take(state.at.belt_motors, axis=1)  # (n, m) N
    return drive_of(state.robot.drive).belt_values(motors) * state.robot.lug_radius


def _contact(state: State) -> Array:
    """Net contact of each track (n, 3, 2, 7): found, force on the wall, position; world frame."""
    found = state.shared.get("contact")
    if found is None:
        found = state.shared["contact"] = state.sensordata.take(state.at.contact, axis=1)
    return found


def _force(state: State) -> Array:
    """Force of the wall on each track (n, 3, 2, 3) N, world frame."""
    found = state.shared.get("force")
    if found is None:
        found = state.shared["force"] = -_contact(state)[..., 1:4]
    return found


def _forward(state: State) -> Array:
    """Axis of each module (n, 3, 3), world frame."""
    found = state.shared.get("forward")
    if found is None:
        found = state.shared["forward"] = state.xmat.take(state.at.forward, axis=1)
    return found


def _traction(state: State) -> Array:
    along = dot(_force(state), _forward(state)[:, :, None])  # (n, 3, 2) N
    return along[..., 0] + along[..., 1]


def _normal_force(state: State) -> Array:
    touch = state.sensordata.take(state.at.touch, axis=1)  # (n, 3, 2) N
    return touch[..., 0] + touch[..., 1]


def _contact_count(state: State) -> Array:
    return _contact(state)[..., 0]


def _contact_position(state: State) -> Array:
    contact, force = _contact(state), _force(state)
    weight = np.sqrt(dot(force, force))  # (n, 3, 2)
    total = weight[..., 0] + weight[..., 1]
    places = weight[..., :1] * contact[:, :, 0, 4:7] + weight[..., 1:] * contact[:, :, 1, 4:7]
    known = total > 0
    if np.count_nonzero(known) == known.size:
        return places / total[..., None]
    centre = places / np.where(known, total, 1.0)[..., None]
    return np.where(known[..., None], centre, state.last("contact_position"))


def _module_speed(state: State) -> Array:
    arm = state["contact_position"] - state.xpos.take(state.at.places, axis=1)
    velocity = state.sensordata.take(state.at.velocity, axis=1)
    return dot(velocity + cross(state.sensordata.take(state.at.spin, axis=1), arm), _forward(state))


def _slip_velocity(state: State) -> Array:
    count = state["contact_count"]
    touching = np.maximum(count[..., 0], count[..., 1]) > 0
    return np.where(touching, state["wall_speed"] - state["module_speed"], 0.0)


def _slip_ratio(state: State) -> Array:
    scale = np.maximum(np.abs(state["wall_speed"]), np.abs(state["module_speed"]))
    ratio = state["slip_velocity"] / np.maximum(scale, AT_REST)
    return np.where(scale > AT_REST, np.minimum(np.maximum(ratio, -1.0), 1.0), 0.0)


def _slide(state: State) -> Array:
    return state.qpos.take(state.at.slide, axis=1)


def _pitch(state: State) -> Array:
    return state.qpos.take(state.at.pitch, axis=1)


def _roll(state: State) -> Array:
    return state.qpos.take(state.at.roll, axis=1)


_READ = {
    "time": _time,
    "position": _position,
    "quaternion": _quaternion,
    "rotation": _rotation,
    "angular_velocity": _angular_velocity,
    "belt_speed": _belt_speed,
    "wall_speed": _wall_speed,
    "motor_torque": _motor_torque,
    "traction": _traction,
    "normal_force": _normal_force,
    "slip_velocity": _slip_velocity,
    "slip_ratio": _slip_ratio,
    "contact_count": _contact_count,
    "contact_position": _contact_position,
    "module_speed": _module_speed,
    "slide": _slide,
    "pitch": _pitch,
    "roll": _roll,
}
SENSORS = tuple(
    Sensor(channel, _READ[name]) for name, channel in CHANNELS.items() if channel.source == "plant"
)
"""One sensor for each channel of the schema that the plant measures."""
