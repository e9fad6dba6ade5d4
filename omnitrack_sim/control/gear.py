"""Driving tail first: the same robot seen from behind.

Nose and tail are alike, so a robot that drives backward is one that drives forward with its frame
turned by 180 degrees
about its x axis: z points the other way, module 1 stays, modules 2 and 3 change places. Everything
the controllers know about orientation, turning and recovery then holds backward too.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.control.interface import Command, Observation
from omnitrack_sim.rotations import Array

TURNED = np.array([1.0, -1.0, -1.0])
"""Diagonal of the rotation by 180 degrees about x."""
SWAPPED = [0, 2, 1]
"""Modules in the turned robot's order."""
_SIGNED = (
    "pitch",
    "roll",
    "belt_speed",
    "motor_torque",
    "traction",
    "slip_velocity",
    "module_speed",
)
_UNSIGNED = ("slide", "normal_force", "contact_count", "contact_position")


def heading(rotation: Array, gear: NDArray[np.int_]) -> Array:
    """Frames (n, 3, 3) that drive nose first, of robots with frames ``rotation`` in gear (n,) 1 or
    -1."""
    return np.where((gear < 0)[:, None, None], rotation * TURNED, rotation)


def seen(observation: Observation, gear: NDArray[np.int_]) -> Observation:
    """What robots in gear (n,) would measure if they drove nose first; ``place`` is for that
    already."""
    back = gear < 0
    if not back.any():
        return observation
    changes = {name: _of_modules(getattr(observation, name), back, -1.0) for name in _SIGNED}
    changes |= {name: _of_modules(getattr(observation, name), back, 1.0) for name in _UNSIGNED}
    turning = observation.angular_velocity
    return dataclasses.replace(
        observation,
        rotation=heading(observation.rotation, gear),
        angular_velocity=np.where(back[:, None], turning * TURNED, turning),
        **changes,
    )


def carried_out(command: Command, gear: NDArray[np.int_]) -> Command:
    """A command to robots that drive nose first, as robots in gear (n,) have to be told it."""
    back = gear < 0
    if not back.any():
        return command
    belt_speed, roll = (
        _of_modules(values, back, -1.0) for values in (command.belt_speed, command.roll)
    )
    return Command(belt_speed, roll, command.phase)


def _of_modules(values: Array, back: NDArray[np.bool_], sign: float) -> Array:
    """Values (n, 3, ...) of the modules with those of robots ``back`` (n,) in the turned robot's
    order and sign."""
    chosen = back.reshape(-1, *[1] * (values.ndim - 1))
    return np.where(chosen, sign * values[:, SWAPPED], values)
