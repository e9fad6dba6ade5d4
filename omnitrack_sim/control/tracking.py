"""Centreline tracking: turn the robot axis towards the pipe's tangent a short way ahead.

The wanted rotation is counted per metre of travel, not per second: what the contacts need to follow
a bend is a matter of distance, and a robot that slows down in a turn hangs in it.

The heading is compared with a stretch of the centreline, from the lookahead point on: a robot that
points anywhere into that stretch is right.
"""

from __future__ import annotations

import numpy as np

from omnitrack_sim.control.guide import Guide, Place, angle_between
from omnitrack_sim.rotations import Array, cross, dot, length, unit
from omnitrack_sim.theory.kinematics import module_speeds

HEADING_LEAD = 0.09
"""How far the heading may be ahead of the lookahead point, m. In the open middle of a tee the robot
turns faster than the arc; turning it back would push it out of the branch again."""
MOST_SLOPE = 0.1
"""Steepest way back to the centreline, rad."""
_LEADS = np.linspace(0.0, HEADING_LEAD, 7)


def wanted_rotation(
    guide: Guide,
    place: Place,
    rotation: Array,
    gain: Array,
    lookahead: Array,
    limit: Array,
    direction: Array,
    centring: Array,
) -> Array:
    """Rotation per metre of travel (n, 3) rad/m, world frame: the bend's curvature plus gain x
    heading error.

    Args:
        guide: of the routes.
        place: where the robots are.
        rotation: (n, 3, 3) robot frame in the world.
        gain: (n,) 1/m. lookahead: (n,) m.
        limit: (n,) rad/m, cap on the length of the result.
        direction: (n,) 1 forward, -1 backward: the heading is then compared with the centreline
            behind.
        centring: (n,) 1/m, slope towards the centreline that is wanted per metre beside it, up to
            ``MOST_SLOPE``.
    """
    axis = rotation[:, :, 2]
    _, tangent, normal, curvature = guide.at(place.distance)
    ahead = place.distance[:, None] + direction[:, None] * (
        lookahead[:, None] + _LEADS
    )  # (n, leads) m
    tangents = guide.at(ahead)[1]
    angles = angle_between(axis[:, None], tangents)
    nearest = np.argmin(angles, axis=1)
    rows = np.arange(len(nearest))
    target, angle = tangents[rows, nearest], angles[rows, nearest]
    slope = centring[:, None] * place.aside
    slope = slope * np.minimum(1.0, MOST_SLOPE / np.maximum(length(slope), 1e-12))[:, None]
    target = np.where((centring > 0)[:, None], unit(target - direction[:, None] * slope), target)
    angle = np.where(centring > 0, angle_between(axis, target), angle)
    # A robot that has turned ahead of the bend goes straight until the bend has caught up.
    bend = cross(tangent, normal) * (curvature * (nearest == 0))[:, None]
    wanted = bend + unit(cross(axis, target)) * (direction * gain * angle)[:, None]
    return wanted * np.minimum(1.0, limit / np.maximum(length(wanted), 1e-12))[:, None]


def tracking_speeds(
    rotation: Array,
    angular_velocity: Array,
    rate_gain: Array,
    wanted: Array,
    speed: Array,
    lever: Array,
    speed_limit: Array,
) -> Array:
    """Wall speeds (n, 3) m/s of the modules for a wanted rotation per metre.

    Args:
        rotation: (n, 3, 3) robot frame in the world.
        angular_velocity: (n, 3) rad/s, robot frame, as it is.
        rate_gain: (n,) rotation asked in addition, per rad/s that the rotation is too slow or too
            fast.
        wanted: (n, 3) rad/m, world frame.
        speed: (n,) m/s forward.
        lever: (n,) m, distance of the walls from the robot's axis.
        speed_limit: (n,) m/s, cap on each speed.
    """
    omega = (
        np.stack([dot(wanted, rotation[:, :, 0]), dot(wanted, rotation[:, :, 1])], axis=-1)
        * speed[:, None]
    )
    omega = omega + rate_gain[:, None] * (omega - angular_velocity[:, :2])
    speeds = module_speeds(speed, omega[:, 0], omega[:, 1], lever)
    return np.clip(speeds, -speed_limit[:, None], speed_limit[:, None])
