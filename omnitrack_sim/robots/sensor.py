"""Sensors: functions from the state of the physics to measured quantities.

Forces and velocities are those of the last physics step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class Sensor:
    """A channel and the function that reads it for n robots at once.

    Attributes:
        channel: name, shape, unit, meaning, and how it looks to a robot that drives tail first.
        read: from a ``State`` to an array of its own: n, then the channel's shape.
        looks_back: it asks for its own value at the moment before (``State.last``) where it is
            read, which need not be at every moment.

    Example:
        >>> channel = ot.Channel("height", (), "m", "height of the centre", "world")
        >>> sensor = ot.Sensor(channel, lambda state: state["position"][:, 2])
        >>> sim = ot.Simulation([ot.load_scenario("straight")], sensors=[sensor])
        >>> sim.observation.height.shape
        (1,)
    """

    channel: Channel
    read: Callable[[State], Array]
    looks_back: bool = False


MOST_UNREAD = 50
"""Moments that may go unread before a sensor that looks back is read: each keeps the one before it
in memory."""


class State(dict[str, Array]):
    """State of the physics of n robots at one moment. Sensors read it, and each other by name.

    ``state["motor_torque"]`` is the value of that sensor at this moment. It is computed when it is
    first asked for, and once however often; a state stays what it was when the physics has moved
    on.

    Args:
        arrays: by the names of the attributes ``time`` to ``xmat``.
        at, robot, sensors, looks_back: see below.
        before: the state at the moment before, or start values.

    Attributes:
        time: (n,) s.
        qpos: (n, nq).
        qvel: (n, nv).
        sensordata: (n, ns).
        actuator_force: (n, nu).
        xpos: (n, 3 nbody) m, world frame.
        xmat: (n, 9 nbody), row by row.
        site_xpos: (n, 3 nsite) m, world frame.
        at: addresses of the robot's parts in these arrays, as its own sensors use them.
        robot: its parameters.
        sensors: by the names of their channels.
        looks_back: names of the shipped sensors that look back.
        shared: what sensors keep for each other within one moment.
    """

    time: Array
    qpos: Array
    qvel: Array
    sensordata: Array
    actuator_force: Array
    xpos: Array
    xmat: Array
    site_xpos: Array
    shared: dict[str, Any]

    def __init__(
        self,
        arrays: Mapping[str, Array],
        at: Any,
        robot: Robot,
        sensors: Mapping[str, Sensor],
        before: State | Mapping[str, Array],
        looks_back: Sequence[str] = (),
    ) -> None:
        super().__init__()
        self.__dict__.update(arrays)
        self.at, self.robot, self.sensors, self._before = at, robot, sensors, before
        self.looks_back, self.shared = looks_back, {}
        self._unread = 0
        if isinstance(before, State):
            self._unread = before._unread + 1
            if not before.looks_back:
                before._before = {}
        if self._unread > MOST_UNREAD:
            for name in self.looks_back:
                self.last(name)

    def __missing__(self, name: str) -> Array:
        if name not in self.sensors:
            raise KeyError(f"no sensor reads {name!r} (choose from: {', '.join(self.sensors)})")
        value = self[name] = self.sensors[name].read(self)
        if name in self.looks_back and all(each in self for each in self.looks_back):
            # All that look back have done so: earlier moments may be forgotten.
            self._before, self._unread = dict(self._before), 0
        return value

    def last(self, name: str, start: Array | None = None) -> Array:
        """The value, at the moment before, of a sensor that looks back or of a user's own.

        Own sensors are read at every control step, so a sensor may add up what it sees.

        Args:
            name: of the channel.
            start: what to return at the first moment.

        Raises:
            KeyError: there was no such value, and no ``start`` is given.
        """
        if start is not None and name not in self._before:
            return start
        return self._before[name]
