"""What a sensor is, and what it may read."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robots.omnitrack import Robot


@dataclass(frozen=True)
class Sensor:
    """A channel and the function that reads it for n robots at once.

    Attributes:
        channel: name, shape, unit, meaning, and how it looks to a robot that drives tail first.
        read: from a ``State`` to an array of its own: n, then the channel's shape.
    """

    channel: Channel
    read: Callable[[State], Array]


@dataclass(frozen=True)
class Addresses:
    """Where the parts of the robot are in MuJoCo's arrays; modules first, then tracks.

    Attributes:
        slide, pitch, roll: (3,) and belts: (3, 2) in ``qpos``. slide_dofs: (3,) and belt_dofs:
            (3, 2) in ``qvel``.
        tracks: (3, 2) bodies.
        places: (3, 3) in ``xpos``, of the modules.
        forward: (3, 3) in ``xmat``: the modules' axes.
        contact: (3, 2, 7) in ``sensordata``: found, force (3,), position (3,) of each track.
        touch: (3, 2) in ``sensordata``: sum of the normal forces of each track.
        velocity, spin: (3, 3) in ``sensordata``, of the modules, world frame.
        belt_motors: (m,) and roll_motors: (3,) actuators.
    """

    slide: NDArray[np.intp]
    pitch: NDArray[np.intp]
    roll: NDArray[np.intp]
    belts: NDArray[np.intp]
    slide_dofs: NDArray[np.intp]
    belt_dofs: NDArray[np.intp]
    places: NDArray[np.intp]
    forward: NDArray[np.intp]
    tracks: NDArray[np.intp]
    contact: NDArray[np.intp]
    touch: NDArray[np.intp]
    velocity: NDArray[np.intp]
    spin: NDArray[np.intp]
    belt_motors: NDArray[np.intp]
    roll_motors: NDArray[np.intp]


MOST_UNREAD = 50
"""Moments that a sensor which looks back may find unread."""


class State(dict[str, Array]):
    """What the physics knows of n robots at one moment. Sensors read it, and each other by name.

    ``state["motor_torque"]`` is the value of that sensor at this moment. It is computed when it is
    first asked for, and once however often; a state stays what it was when the physics has moved
    on.

    Args:
        arrays: by the names of the attributes ``time`` to ``xmat``.
        at, robot, sensors: see below.
        before: the state at the moment before, or start values.

    Attributes:
        time: (n,) s.
        qpos: (n, nq).
        qvel: (n, nv).
        sensordata: (n, ns).
        actuator_force: (n, nu).
        xpos: (n, 3 nbody) m, world frame.
        xmat: (n, 9 nbody), row by row.
        at: addresses of the robot's parts.
        robot: its parameters.
        sensors: by the names of their channels.
        shared: what sensors keep for each other within one moment.
    """

    time: Array
    qpos: Array
    qvel: Array
    sensordata: Array
    actuator_force: Array
    xpos: Array
    xmat: Array

    def __init__(
        self,
        arrays: Mapping[str, Array],
        at: Addresses,
        robot: Robot,
        sensors: Mapping[str, Sensor],
        before: State | Mapping[str, Array],
    ) -> None:
        super().__init__()
        self.__dict__.update(arrays)
        self.at, self.robot, self.sensors, self._before = at, robot, sensors, before
        self.shared: dict[str, Any] = {}
        self._unread = before._unread + 1 if isinstance(before, State) else 0
        if self._unread > MOST_UNREAD:
            self.last("contact_position")

    def __missing__(self, name: str) -> Array:
        if name not in self.sensors:
            raise KeyError(f"no sensor reads {name!r} (choose from: {', '.join(self.sensors)})")
        value = self[name] = self.sensors[name].read(self)
        if name == "contact_position":
            # The one shipped sensor that looks back has done so: earlier moments may be forgotten.
            self._before, self._unread = dict(self._before), 0
        return value

    def last(self, name: str, start: Array | None = None) -> Array:
        """The value, at the moment before, of ``contact_position`` or of a user's own sensor.

        Own sensors are read at every control step, so a sensor may add up what it sees.

        Args:
            name: of the channel. start: what to return at the first moment.

        Raises:
            KeyError: there was no such value, and no ``start`` is given.
        """
        if start is not None and name not in self._before:
            return start
        return self._before[name]
