"""What errors say of poses: normal equations, weights of errors, probabilities; and what arms and
gravity say."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.pose_filter import POSE, wall_slopes
from omnitrack_sim.base.rotations import Array, skew
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES, Robot
from omnitrack_sim.senses.optics import Walls

HUBER = 2.0
"""Errors beyond so many standard deviations count less."""
AT_STOP = 0.0005
"""Distance from its outer stop, m, at which an arm may have no wall."""
FEW = 0.1
"""Part of the pixels of a picture with which it tells whether the map is right."""
_ARMS = np.stack([np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES), np.zeros(3)], axis=-1)


def of_arms(
    robot: Robot,
    walls: Walls,
    which: NDArray[np.intp],
    position: Array,
    rotation: Array,
    slide: Array,
    spread: float,
) -> tuple[Array, Array]:
    """Where an arm's module is pressed to the wall, the wall is as far as the arm reaches.

    Where the wall is not along the robot's axis, one end of the track touches it, and the middle
    may be off it by half of the track times the slope.

    Args:
        robot: shared by all. walls: of the maps. which: (n,) map of each robot.
        position: (n, 3) m. rotation: (n, 3, 3). Where the robots take themselves to be.
        slide: (n, 3) m, of the arms. spread: m, standard deviation where the wall is along the
            axis.

    Returns:
        Information and evidence, see ``normal``.
    """
    outermost = robot.slide_range[1] - AT_STOP
    reach = robot.nominal_pipe_radius + slide  # (n, 3) m
    lever = np.einsum("nij,nkj->nki", rotation, reach[..., None] * _ARMS)
    distance, gradient, part = walls.nearest(which, position[:, None] + lever)
    held = (slide < outermost) & (part >= 0)
    slope = np.abs((gradient * rotation[:, None, :, 2]).sum(axis=-1))
    spreads = spread + robot.contact_length / 2 * slope
    weight = held * huber(distance / spreads) / spreads**2
    return normal(wall_slopes(gradient, lever), -distance, weight)


def of_gravity(
    gravity: Array, force: Array, rotation: Array, spread: float, asked: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """At rest the accelerometer measures the direction of what holds the robot up.

    Args:
        gravity: (n, 3) m/s², world frame. force: (n, 3) m/s², measured, robot frame.
        rotation: (n, 3, 3). spread: m/s², standard deviation. asked: (n,) of whom it counts.

    Returns:
        Information and evidence, see ``normal``.
    """
    held = -np.einsum("nij,nj->ni", rotation, force)  # (n, 3) world
    error = gravity - held
    slopes = np.zeros((len(held), 3, POSE))
    slopes[:, :, 3:] = -skew(held)
    weight = np.where(asked, 1.0 / spread**2, 0.0)
    return normal(slopes, error, np.repeat(weight[:, None], 3, axis=1))


def normal(slopes: Array, error: Array, weight: Array) -> tuple[Array, Array]:
    """Information (n, 6, 6) and evidence (n, 6) of errors (n, k) with slopes (n, k, 6)."""
    weighted = slopes * weight[..., None]
    return np.swapaxes(weighted, 1, 2) @ slopes, np.einsum("nki,nk->ni", weighted, error)


def chances(cost: Array) -> Array:
    """Probabilities (m, ...), in proportion to exp(-cost)."""
    axes = tuple(range(1, cost.ndim))
    weight = np.exp(cost.min(axis=axes, keepdims=True) - cost)
    return weight / weight.sum(axis=axes, keepdims=True)


def moments(values: Array, chances: Array) -> tuple[Array, Array]:
    """Mean and variance (m,) of values (m, c)."""
    mean = (chances * values).sum(axis=1)
    return mean, (chances * (values - mean[:, None]) ** 2).sum(axis=1)


def huber(error: Array) -> Array:
    """Weights of errors counted in standard deviations."""
    return np.minimum(1.0, HUBER / np.maximum(np.abs(error), 1e-12))


def median(size: Array, said: NDArray[np.bool_]) -> Array:
    """Median (n,) of those ``size`` (n, k) that are ``said``; 0 where hardly any are."""
    ordered = np.sort(np.where(said, size, np.inf), axis=1)
    count = said.sum(axis=1)
    middle = np.take_along_axis(ordered, (count // 2 % size.shape[1])[:, None], axis=1)[:, 0]
    return np.where(count > FEW * size.shape[1], middle, 0.0)
