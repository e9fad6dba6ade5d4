"""Sensors: functions from the state of the physics to measured quantities.

Forces and velocities are those of the last physics step.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.record.channels import Channel

if TYPE_CHECKING:
    from omnitrack_sim.robots.robot import Robot


@dataclass(frozen=True)
class Sensor:
    """A channel and the function that reads it for n robots at once.

    Attributes:
        channel: name, shape, unit, meaning, and how it looks to a robot that drives tail first.
        read: from a ``State`` to an array of its own: n, then the channel's shape.
        looks_back: where it has no value of its own it returns that of the moment before, as
            ``State.last`` gives it. It need not be read at every moment.

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


MAX_UNREAD = 50
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
        motor_figures: (n, k), of the package's own robot; see its ``SpeedLoop``.
        at: addresses of the robot's parts in these arrays, as its own sensors use them.
        robot: its parameters.
        sensors: by the names of their channels.
        looks_back: names of the shipped sensors that look back.
        arrays: all of these, by name.
        shared: what sensors keep for each other within one moment.
        moments: states that have been read together from this one on.
    """

    time: Array
    qpos: Array
    qvel: Array
    sensordata: Array
    actuator_force: Array
    xpos: Array
    xmat: Array
    site_xpos: Array
    motor_figures: Array
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
        self.arrays = arrays
        self.at, self.robot, self.sensors, self._before = at, robot, sensors, before
        self.looks_back, self.shared = looks_back, {}
        self.moments: _Moments | None = None
        self._unread = 0
        if isinstance(before, State):
            self._unread = before._unread + 1
            if not before.looks_back:
                before._before = {}
        if self._unread > MAX_UNREAD:
            for name in self.looks_back:
                self.last(name)

    def __missing__(self, name: str) -> Array:
        if name not in self.sensors:
            raise KeyError(f"no sensor reads {name!r} (choose from: {', '.join(self.sensors)})")
        value = self[name] = self.sensors[name].read(self)
        if name in self.looks_back:
            self._forget()
        return value

    def _forget(self) -> None:
        """Drop earlier moments once all sensors that look back have been read."""
        if all(name in self for name in self.looks_back):
            self._before, self._unread = dict(self._before), 0

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


MOMENTS = 16
"""Moments that are read together: of one robot in 14 us each where one alone takes 107; earlier
moments are kept no longer than ``MAX_UNREAD``."""
MAX_ROBOTS = 64
"""Number of robots up to which that pays: of 64 a moment takes 125 us for 170 alone, of 128 275 for
236, as the arrays leave the cache."""


def moments_together(n: int) -> int:
    """Return how many moments of n robots are best read together."""
    return MOMENTS if n <= MAX_ROBOTS else 1


def read_together(moments: Iterable[Mapping[str, Array]], names: Iterable[str]) -> None:
    """Read sensors at several moments at once, to the bits of one moment after the other.

    Of few robots this takes about as long as one moment does, which is the cost of the calls. What
    each ``State`` lacks is put into it; other readings have their values already.

    Args:
        moments: of the same robots, in order.
        names: of channels.
    """
    states = [each for each in moments if isinstance(each, State)]
    missing = [name for name in names if any(name not in state for state in states)]
    if len(states) < 2 or not missing:
        return
    block = _moments_of(states)
    for name in (*states[0].looks_back, *missing):
        values = block[name]  # (k n, ...), of which a robot may have nothing
        robots = len(values) // len(states)
        values = values.reshape(len(states), robots, *values.shape[1:])
        for state, value in zip(states, values, strict=True):
            state.setdefault(name, value)
    for state in states:
        state._forget()


def _moments_of(states: Sequence[State]) -> _Moments:
    """Return several states as one; the same if the same were read together before."""
    block = states[0].moments
    if block is None or [id(ref()) for ref in block.states] != list(map(id, states)):
        block = states[0].moments = _Moments(states)
    return block


class _Moments(State):
    """States of n robots at k moments as one of k n robots."""

    def __init__(self, states: Sequence[State]) -> None:
        first = states[0]
        arrays = {name: np.concatenate([s.arrays[name] for s in states]) for name in first.arrays}
        super().__init__(arrays, first.at, first.robot, first.sensors, {})
        # Weak: the first of them keeps this block, and a cycle with arrays in it would stay in
        # memory until Python looks for cycles, by the number of objects and not by their size.
        self.states = [weakref.ref(state) for state in states]
        for name in first.looks_back:
            # Unknown at one of the moments: it is that of the moment before, which was perhaps
            # none of these.
            values = first.sensors[name].read(self).reshape(len(states), -1)
            for state, value in zip(states, values, strict=True):
                if np.isnan(value).any():
                    value[:] = state[name].ravel()
            self[name] = values.reshape(-1, *first.sensors[name].channel.shape)

    def last(self, name: str, start: Array | None = None) -> Array:  # noqa: ARG002 - protocol
        return np.full((len(self.time), *self.sensors[name].channel.shape), np.nan)
