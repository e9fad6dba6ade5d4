"""Sensors that follow from a robot's model: of actuators, joints, contacts and named sensors."""

from __future__ import annotations

from collections.abc import Container, Sequence

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import COMMON, Channel, Display
from omnitrack_sim.robots.actuator_units import actuator_units
from omnitrack_sim.robots.sensor import Sensor, State

TOUCH = "touch_of_"
"""Names of the contact sensors that the scene adds begin like this."""
SLOTS = 4
"""Contacts of a body whose forces are added up: the largest ones."""


def add_touch(spec: mujoco.MjSpec, body: str) -> None:
    """Add a sensor of the contacts of a body with the walls.

    For each of the largest contacts it says whether there is one, its force in the frame of the
    contact, and the speed at which the surfaces slide.
    """
    fields = mujoco.mjtConDataField
    wanted = (fields.mjCONDATA_FOUND, fields.mjCONDATA_FORCE, fields.mjCONDATA_LINVEL)
    largest_first = 2
    spec.add_sensor(
        name=f"{TOUCH}{body}",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=body,
        reftype=mujoco.mjtObj.mjOBJ_BODY,
        refname="world",
        intprm=[sum(1 << int(f) for f in wanted), largest_first, SLOTS],
    )


def model_channels(model: mujoco.MjModel) -> dict[str, Channel]:
    """Return the channels that follow from a robot's model, by name.

    They are of actuators, of contacts of bodies, and of the named sensors of the model.
    """
    meaning, unit = "control inputs, by actuator", actuator_units(model)["ctrl"]
    shown = Display("Control inputs", unit, span=0.02, each="actuator")
    own = {"source": "command", "names": actuator_names(model), "shown": shown}
    ctrl = Channel("ctrl", (model.nu,), unit, meaning, **own)
    channels = [ctrl, *(sensor.channel for sensor in model_sensors(model))]
    return {channel.name: channel for channel in channels}


def model_sensors(model: mujoco.MjModel) -> list[Sensor]:
    """Sensors of the channels that follow from a robot's model."""
    names = [model.sensor(i).name for i in range(model.nsensor)]
    named = [name for name in names if name and not name.startswith(TOUCH)]
    own = [
        *_actuator_sensors(model),
        *_contact_sensors(model, [name for name in names if name.startswith(TOUCH)]),
        *_joint_sensors(model),
    ]
    taken = {*COMMON, "ctrl", *(sensor.channel.name for sensor in own)}
    return [*own, *(_named_sensor(model, name, taken) for name in named)]


def actuator_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the actuators; of one without, that of its joint or tendon, or its number from 1."""
    names = []
    for i in range(model.nu):
        actuator, driven = model.actuator(i), ""
        kind, target = int(actuator.trntype[0]), int(actuator.trnid[0])
        if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            driven = model.joint(target).name
        elif kind == mujoco.mjtTrn.mjTRN_TENDON:
            driven = model.tendon(target).name
        names.append(actuator.name or driven or str(i + 1))
    return tuple(names)


def _actuator_sensors(model: mujoco.MjModel) -> list[Sensor]:
    def each(name: str, unit: str, meaning: str) -> Channel:
        title = name.replace("_", " ").capitalize()
        shown = Display(title, unit, span=0.02, each="actuator")
        return Channel(name, (model.nu,), unit, meaning, names=names, shown=shown)

    names, order = actuator_names(model), "in the model's own order"
    units = actuator_units(model)
    force = each("actuator_force", units["actuator_force"], f"force of each actuator, {order}")
    unit, meaning = units["actuator_velocity"], "speed of each actuator's length"
    velocity = each("actuator_velocity", unit, meaning)
    power = each("actuator_power", "W", "force times speed of each actuator")
    return [
        Sensor(force, lambda state: state.actuator_force),
        Sensor(velocity, lambda state: state.actuator_velocity),
        Sensor(power, lambda state: state.actuator_force * state.actuator_velocity),
    ]


def _contact_sensors(model: mujoco.MjModel, names: Sequence[str]) -> list[Sensor]:
    """Sensors of force and slip of the bodies whose contact sensors have these ``names``."""
    touch = np.array([model.sensor(name).adr[0] for name in names], int)
    slots = (touch[:, None] + np.arange(SLOTS * 7)).reshape(-1, SLOTS, 7)

    def contacts(state: State) -> Array:
        """(n, bodies, slots, 7): found, force and velocity in the contact's frame."""
        return state.sensordata.take(slots, axis=1)

    def total_force(state: State) -> Array:
        return np.abs(contacts(state)[..., 1]).sum(axis=-1)

    def mean_speed(state: State) -> Array:
        contact = contacts(state)
        share = np.abs(contact[..., 1])
        slip = np.hypot(contact[..., 5], contact[..., 6])
        total = share.sum(axis=-1)
        return (share * slip).sum(axis=-1) / np.where(total > 0, total, 1.0)

    touched = tuple(name.removeprefix(TOUCH) for name in names)
    bodies = ", ".join(touched)
    force = Channel(
        "wall_force",
        (len(names),),
        "N",
        f"normal forces between the wall and each body, added up; bodies in order: {bodies}",
        names=touched,
        shown=Display("Force on the wall, by body", "N", low=0.0, span=2.0, each="body"),
    )
    speed = Channel(
        "contact_speed",
        (len(names),),
        "m/s",
        "speed of each body's surface over the wall where it touches, mean by force; 0 without "
        f"contact; bodies in order: {bodies}",
        names=touched,
        shown=Display("Slip speed at contacts", "mm/s", 1e3, low=0.0, span=1.0, each="body"),
    )
    return [Sensor(force, total_force), Sensor(speed, mean_speed)]


def _joint_sensors(model: mujoco.MjModel) -> list[Sensor]:
    position = Channel("qpos", (model.nq,), "m, rad", "joint positions", recorded=False)
    velocity = Channel("qvel", (model.nv,), "m/s, rad/s", "joint velocities", recorded=False)
    return [
        Sensor(position, lambda state: state.qpos),
        Sensor(velocity, lambda state: state.qvel),
    ]


def _named_sensor(model: mujoco.MjModel, name: str, taken: Container[str]) -> Sensor:
    """Sensor of a channel with the values of a named sensor of the model.

    The channel has its name, but for the names of channels that are ``taken``.
    """
    sensor = model.sensor(name)
    kind = mujoco.mjtSensor(int(sensor.type[0])).name.removeprefix("mjSENS_").lower()
    at = sensor.adr[0] + np.arange(sensor.dim[0])
    shape = () if len(at) == 1 else (len(at),)
    own = f"sensor_{name}" if name in taken else name
    channel = Channel(own, shape, "", f"sensor of the model: {kind}")
    return Sensor(channel, lambda state: state.sensordata.take(at, axis=1).reshape(-1, *shape))
