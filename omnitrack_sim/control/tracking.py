"""Centreline tracking: turn the robot axis towards the pipe's tangent a short way ahead.

The wanted rotation is counted per metre of travel, not per second: what the contacts need to follow a bend is a matter
of distance, and a robot that slows down in a turn hangs in it.
"""

from __future__ import annotations

import numpy as np

from omnitrack_sim.control.guide import Place, angle_between
from omnitrack_sim.frames import Array, dot, unit
from omnitrack_sim.kinematics import module_speeds
from omnitrack_sim.pipes import Centreline


def wanted_rotation(
    centreline: Centreline, place: Place, rotation: Array, gain: Array, lookahead: Array, limit: Array
) -> Array:
    """Rotation per metre of travel (n, 3) rad/m, world frame: the bend's curvature plus gain x heading error.

    Args:
        centreline: of the route.
        place: where the robots are.
        rotation: (n, 3, 3) robot frame in the world.
        gain: (n,) 1/m. lookahead: (n,) m.
        limit: (n,) rad/m, cap on the length of the result.
    """
    _, tangent, normal, curvature = centreline.at(place.distance)
    _, ahead, _, _ = centreline.at(place.distance + lookahead)
    axis = rotation[:, :, 2]
    bend = np.cross(tangent, normal) * curvature[:, None]
    correction = unit(np.cross(axis, ahead)) * (gain * angle_between(axis, ahead))[:, None]
    wanted = bend + correction
    length = np.linalg.norm(wanted, axis=-1)
    return wanted * np.minimum(1.0, limit / np.maximum(length, 1e-12))[:, None]


def tracking_speeds(rotation: Array, wanted: Array, speed: Array, lever: float, speed_limit: Array) -> Array:
    """Wall speeds (n, 3) m/s of the modules for a wanted rotation per metre at forward speed ``speed`` (n,) m/s."""
    omega = wanted * speed[:, None]
    omega_x, omega_y = dot(omega, rotation[:, :, 0]), dot(omega, rotation[:, :, 1])
    speeds = module_speeds(speed, omega_x, omega_y, lever)
    return np.clip(speeds, -speed_limit[:, None], speed_limit[:, None])
