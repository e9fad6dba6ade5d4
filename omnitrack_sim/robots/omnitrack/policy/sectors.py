"""The symmetry of the robot: turned by 120 degrees about its axis it is the same.

Its modules are then counted from another one, and the x axis of its frame points to that.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import (
    Array,
    matrix_from_quaternion,
    quaternion_from_matrix,
    wrap_angle,
)
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.robots.control import Observation
from omnitrack_sim.robots.omnitrack.channels import CHANNELS, MODULES

SECTOR = 2 * math.pi / MODULES
"""Angle between two modules, rad."""
_EACH = np.arange(MODULES)
_SIN, _COS = np.sin(SECTOR * _EACH), np.cos(SECTOR * _EACH)
# The matrices turn about z.
_ROTATIONS = np.array([[[c, -s, 0], [s, c, 0], [0, 0, 1]] for s, c in zip(_SIN, _COS, strict=True)])


def modules_from(values: Array, first: NDArray[np.intp]) -> Array:
    """Return values (n, 3, ...) of modules in their order from module ``first`` (n,) on.

    Modules are numbered from 0; what is ordered so comes back by ``-first``.
    """
    order = (_EACH + first[:, None]) % MODULES
    return np.take_along_axis(values, order.reshape(*order.shape, *[1] * (values.ndim - 2)), axis=1)


def counted_from(observation: Observation, first: NDArray[np.intp]) -> Observation:
    """Return what robots observe that take module ``first`` (n,), numbered from 0, for module 1."""
    if not np.count_nonzero(first):
        return observation
    rotation, location = _ROTATIONS[first], observation.location
    theta5 = wrap_angle(location.theta5 + SECTOR * first)
    frame = location.frame @ rotation
    return Observation(
        _Readings(observation, first, rotation),
        replace(location, frame=frame, theta5=theta5),
        observation.leg,
        observation.gear,
    )


class _Readings(dict[str, Array]):
    """Readings of robots that count their modules from another one, turned as they are asked for.

    Args:
        seen: what they observe in their own order.
        first: (n,) see ``counted_from``.
        rotation: (n, 3, 3) of the new frames in the old ones.
    """

    def __init__(self, seen: Observation, first: NDArray[np.intp], rotation: Array) -> None:
        super().__init__()
        self._seen, self._first, self._rotation = seen, first, rotation
        self.sensors = seen.sensors

    def __missing__(self, name: str) -> Array:
        values = getattr(self._seen, name)
        channel = self.sensors[name].channel if name in self.sensors else CHANNELS.get(name)
        self[name] = turned = values if channel is None else self._turned(values, channel)
        return turned

    def _turned(self, values: Array, channel: Channel) -> Array:
        """Turn values (n, ...) by what their channel states for driving tail first."""
        how = channel.tail_first
        if how == "turned":
            return (self._rotation.swapaxes(1, 2) @ values[..., None])[..., 0]
        if how == "facing":
            return values @ self._rotation
        if how == "behind":
            return quaternion_from_matrix(matrix_from_quaternion(values) @ self._rotation)
        if how == "same" or values.ndim == 1:
            return values
        return modules_from(values, self._first)
