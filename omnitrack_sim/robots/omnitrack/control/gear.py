"""Driving tail first: the same robot seen from behind.

Nose and tail are alike, so a robot that drives backward is one that drives forward with its frame
turned by 180 degrees about its x axis: z points the other way, module 1 stays, modules 2 and 3
change places. Everything the controllers know about orientation, turning and recovery then holds
backward too. How each channel changes is declared in its schema (``Channel.tail_first``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import TURNED, Array
from omnitrack_sim.record.channels import CHANNELS, Channel
from omnitrack_sim.robots.omnitrack.control.command import Command

SWAPPED = [0, 2, 1]
"""Modules in the turned robot's order."""


def seen(
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


def carried_out(command: Command, gear: NDArray[np.int_]) -> Command:
    """Mirror a command for robots in reverse gear (n,)."""
    back = gear < 0
    if not np.count_nonzero(back):
        return command
    roll = None if command.roll is None else _mirrored(command.roll, back, "negated")
    speed = _mirrored(command.belt_speed, back, "negated")
    brake = None if command.brake is None else _mirrored(command.brake, back, "swapped")
    return command._replace(belt_speed=speed, roll=roll, brake=brake)


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
