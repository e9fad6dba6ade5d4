"""Command to the robot's modules; and driving tail first, as the same robot seen from behind.

Nose and tail are alike, so a robot that drives backward is one that drives forward with its frame
turned by 180 degrees about its x axis: z points the other way, module 1 stays, modules 2 and 3
change places. Everything the controllers know about orientation, turning and recovery then holds
backward too. How each channel changes is declared in its schema (``Channel.tail_first``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import TURNED, Array
from omnitrack_sim.base.text import shown
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.events import Event
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.robots.omnitrack.events import Rolled


class Command(NamedTuple):
    """Commands to n robots until the next control step. Fields that are None keep their values.

    Attributes:
        belt_speed: (n, 3) m/s asked of the crawler motors.
        roll: (n, 3) rad asked of the rotary motors.
        phase: (n,) index into the controller's ``phases``.
        resting: (n,) bool, robots that stand still or drive backward on purpose, which the monitor
            does not count as stuck; none when left out.
        events: decisions of the controller, kept in the result.
        brake: (n, 3) part of ``robot.brake_force``, 0 to 1, by which the belts are braked; all off
            when left out, and to be 0 where the robot has no brakes.
        over: (n,) bool, robots whose run is over after this control period; none when left out.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> ot.Command(belt_speed=np.full((2, 3), 0.1), roll=np.zeros((2, 3)))
        Command(2 robots: belt_speed, roll, events)
    """

    belt_speed: Array
    roll: Array | None = None
    phase: NDArray | None = None
    resting: NDArray[np.bool_] | None = None
    events: Sequence[Event] = ()
    brake: Array | None = None
    over: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        names = [name for name, value in zip(self._fields, self, strict=True) if value is not None]
        try:
            robots = f"{len(self.belt_speed)} robots"
        except TypeError:  # no array yet, and refused where it is used
            robots = f"belt_speed {shown(self.belt_speed)}, which is no (n, 3)"
        return f"Command({robots}: {', '.join(names)})"


SWAPPED = [0, 2, 1]
"""Modules in the turned robot's order."""


def mirror_readings(
    readings: Mapping[str, Array],
    gear: NDArray[np.int_],
    channels: Iterable[Channel] = tuple(CHANNELS.values()),
) -> Mapping[str, Array]:
    """Mirror the readings of robots in reverse gear, as if they drove nose first.

    Args:
        readings: of the sensors, by the names of their channels.
        gear: 1 nose first, -1 tail first.
        channels: schema of the readings.
    """
    back = gear < 0
    if not np.count_nonzero(back):
        return readings
    return {
        channel.name: readings[channel.name]
        if channel.tail_first == "same"
        else _mirrored(readings[channel.name], back, channel.tail_first)
        for channel in channels
        if channel.source == "plant"
    }


def mirror_command(command: Command, gear: NDArray[np.int_]) -> Command:
    """Mirror a command for robots in reverse gear (n,), and the angles that its events tell."""
    back = gear < 0
    if not np.count_nonzero(back):
        return command
    roll = None if command.roll is None else _mirrored(command.roll, back, "negated")
    speed = _mirrored(command.belt_speed, back, "negated")
    brake = None if command.brake is None else _mirrored(command.brake, back, "swapped")
    events = [
        replace(event, roll_deg=-event.roll_deg)
        if isinstance(event, Rolled) and back[event.robot]
        else event
        for event in command.events
    ]
    return command._replace(belt_speed=speed, roll=roll, brake=brake, events=events)


def _mirrored(values: Array, back: NDArray[np.bool_], how: str) -> Array:
    """Mirror the values (n, ...) of the robots ``back`` (n,)."""
    if how in ("turned", "facing"):
        turned = values * TURNED
    elif how == "behind":
        w, x, y, z = values.T
        # The quaternion times that of a half turn about x, (0, 1, 0, 0).
        turned = np.stack([-x, w, z, -y], axis=-1)
    elif values.ndim == 1:
        turned = -values
    else:
        turned = values[:, SWAPPED] * (-1.0 if how == "negated" else 1.0)
    return np.where(back.reshape(-1, *[1] * (values.ndim - 1)), turned, values)
