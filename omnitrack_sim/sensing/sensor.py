"""What a sensor is, and what it may read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array


@dataclass(frozen=True)
class Sensor:
    """A channel and the function that reads it for n robots at once.

    Attributes:
        channel: name, shape, unit, meaning, and how it looks to a robot that drives tail first.
        read: from a ``State`` to an array (n, *channel.shape) of its own.
    """

    channel: Channel
    read: Callable[[State], Array]


@dataclass(frozen=True)
class Addresses:
    """Where the parts of the robot are in MuJoCo's arrays; modules first, then tracks.

    Attributes:
        slide, pitch, roll: (3,) in ``qpos``. belt_dofs: (3, 2) in ``qvel``.
        tracks: (3, 2) bodies.
        places: (3, 3) in ``xpos``, of the modules.
        forward, outward: (3, 3) in ``xmat``: the modules' axes, and the arms' direction.
        contact: (3, 2, 7) in ``sensordata``: found, force (3,), position (3,) of each track.
        velocity, spin: (3, 3) in ``sensordata``, of the modules, world frame.
        belt_motors, roll_motors: (3,) actuators.
    """

    slide: NDArray[np.intp]
    pitch: NDArray[np.intp]
    roll: NDArray[np.intp]
    belt_dofs: NDArray[np.intp]
    places: NDArray[np.intp]
    forward: NDArray[np.intp]
    outward: NDArray[np.intp]
    tracks: NDArray[np.intp]
    contact: NDArray[np.intp]
    velocity: NDArray[np.intp]
    spin: NDArray[np.intp]
    belt_motors: NDArray[np.intp]
    roll_motors: NDArray[np.intp]


class State(dict[str, Array]):
    """What the physics knows of n robots at one moment. Sensors read it, and each other by name.

    ``state["motor_torque"]`` is the value of that sensor at this moment, computed once however
    often it is asked for.

    Attributes:
        time: (n,) s. qpos: (n, nq). qvel: (n, nv). sensordata: (n, ns). actuator_force: (n, nu).
        xpos: (n, 3 nbody) m, world frame. xmat: (n, 9 nbody), row by row. All are the engine's own
            arrays: a sensor does not write into them.
        at: addresses of the robot's parts. robot: its parameters.
        last: values of the sensors at the moment before; at the first one, start values.
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
        sensors: Iterable[Sensor],
        start: Mapping[str, Array],
    ) -> None:
        super().__init__(start)
        self.__dict__.update(arrays)
        self.at, self.robot = at, robot
        self._read = {sensor.channel.name: sensor.read for sensor in sensors}
        self.last: Mapping[str, Array] = {}
        self.shared: dict[str, Any] = {}

    def __missing__(self, name: str) -> Array:
        value = self._read[name](self)
        # A view of an array of the engine would change with the next step.
        value = self[name] = value if value.base is None else value.copy()
        return value

    def read(self) -> dict[str, Array]:
        """The values of all sensors at this moment, by name."""
        self.last = dict(self)
        self.clear()
        self.shared.clear()
        for name in self._read:
            self[name]
        return dict(self)
