"""Section III of the paper, Eqs. 1-20: how module speeds and robot motion belong together.

Robot frame: z forward, x towards module 1, modules at 0, +120 and -120 degrees about z. SI units,
rad. All functions take arrays of any leading shape (...) and broadcast. Symbols, derivations, and
where the paper contradicts itself: docs/explanation/kinematics.md. ``lever`` is the distance from
the robot axis at which the speeds act: of a module's centre, D/2 - r, or of the wall, D/2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.base.rotations import Array, cross
from omnitrack_sim.pipes.native import compiled
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES

_COS, _SIN = np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES)  # (3,)
MODULE_AXES = np.stack([_COS, _SIN], axis=1)
"""Cosine and sine (3, 2) of the modules' angles."""
_ROOT3 = np.sqrt(3.0)
# (3, 3) unit vectors from the robot axis to the modules, and k x these
_OUTWARD = np.stack([_COS, _SIN, np.zeros(3)], axis=-1)
_TANGENT = np.stack([-_SIN, _COS, np.zeros(3)], axis=-1)

_ON_THE_LINE = 1e-9
"""Size of cos(roll) on the no-motion line: the rounding of 90 degrees, not a tolerance."""


def inertial_rate(rate: ArrayLike, omega: ArrayLike, vector: ArrayLike) -> Array:
    """Eq. 4, Coriolis's theorem: df/dt (inertial frame) = df/dt (rotating frame) + omega x f.

    Args:
        rate: df/dt (..., 3) as seen in the rotating frame.
        omega: (..., 3) rad/s, angular velocity of the rotating frame.
        vector: f (..., 3).
    """
    return np.asarray(rate, float) + cross(np.asarray(omega, float), np.asarray(vector, float))


def module_velocities(speeds: ArrayLike, theta4_dot: ArrayLike, arms: ArrayLike) -> Array:
    """Eqs. 5-7: velocities (..., 3, 3) m/s of the module centres, module by component.

    In the inertial frame: V_i k + theta4_dot k x l_i e_i, with e_i from the robot axis to module i.

    Args:
        speeds: V_i (..., 3), m/s along the robot axis.
        theta4_dot: (...,) rad/s, rotation of the robot about its z axis.
        arms: l_i (..., 3), m.
    """
    speeds, arms = np.asarray(speeds, float), np.asarray(arms, float)
    spin = np.asarray(theta4_dot, float)[..., None, None] * np.array([0.0, 0.0, 1.0])
    return inertial_rate(
        speeds[..., None] * np.array([0.0, 0.0, 1.0]), spin, arms[..., None] * _OUTWARD
    )


def mean_velocity(speeds: ArrayLike, theta4_dot: ArrayLike, arms: ArrayLike) -> Array:
    """Eq. 8: velocity (..., 3) m/s of the robot, the mean of ``module_velocities``."""
    return module_velocities(speeds, theta4_dot, arms).mean(axis=-2)


def forward_speed(speeds: ArrayLike) -> Array:
    """Eq. 9: V_cz (...,) m/s, the mean of the module speeds (..., 3).

    With equal arms it is all that Eq. 8 gives.
    """
    return np.asarray(speeds, float).mean(axis=-1)


def cross_velocity(theta4_dot: ArrayLike, arms: ArrayLike) -> Array:
    """Velocity (..., 2) m/s across the robot axis: what Eq. 8 has beyond Eq. 9.

    theta4_dot / 3 times the sum of l_i k x e_i; zero for equal arms. The walls do not let the robot
    go there, so this is the speed at which lugs scrub sideways when a robot that sags in a
    horizontal pipe rolls.

    Args:
        theta4_dot: (...,) rad/s.
        arms: l_i (..., 3), m.
    """
    spin, arms = np.asarray(theta4_dot, float), np.asarray(arms, float)
    return spin[..., None] / 3 * (arms @ _TANGENT[:, :2])


def rotation_by_module(speeds: ArrayLike, lever: ArrayLike) -> Array:
    """Eqs. 10-12: angular velocity (..., 3, 3) rad/s by each module alone, module by component.

    The robot turns about the line through the other two modules, at a = l/2 beyond the centre, so
    the rate is V_i / (a + l) = 2 V_i / (3 l).

    Args:
        speeds: V_i (..., 3), m/s.
        lever: l (...,), m, the same for all modules.
    """
    speeds, lever = np.asarray(speeds, float)[..., None], np.asarray(lever, float)[..., None, None]
    return rotation_part(speeds, lever, _TANGENT)


@compiled
def rotation_part(speed, lever, tangent):
    """Component of the rotation by one module; see ``rotation_by_module``.

    ``tangent``: the same component of k x e, where e points from the axis to the module.
    """
    return -(speed / (1.5 * lever)) * tangent


def angular_velocity(speeds: ArrayLike, theta4_dot: ArrayLike, lever: ArrayLike) -> Array:
    """Eqs. 13-16: angular velocity (..., 3) rad/s of the robot, robot frame.

    The sum of Eqs. 10-12, and theta4_dot about z.

    Args:
        speeds: V_i (..., 3), m/s.
        theta4_dot: (...,) rad/s.
        lever: l (...,), m.
    """
    omega = rotation_by_module(speeds, lever).sum(axis=-2)
    spin = np.asarray(theta4_dot, float)[..., None] * np.array([0.0, 0.0, 1.0])
    return omega + spin


def jacobian(lug_radius: ArrayLike, lever: ArrayLike) -> Array:
    """J (..., 4, 4) of Eqs. 17-18.

    (omega_x, omega_y, omega_z, V_cz) = J (theta_dot_1, theta_dot_2, theta_dot_3, theta_dot_4).

    Args:
        lug_radius: r, m.
        lever: l, m.
    """
    r, l = np.broadcast_arrays(np.asarray(lug_radius, float), np.asarray(lever, float))
    j = np.zeros((*r.shape, 4, 4))
    # Rows: omega_x, omega_y, omega_z, V_cz. Modules 2 and 3 are exchanged against the printed
    # matrix.
    j[..., 0, :3] = (r / l)[..., None] * np.array([0.0, _ROOT3 / 3, -_ROOT3 / 3])
    j[..., 1, :3] = (r / l)[..., None] * np.array([-2.0, 1.0, 1.0]) / 3
    j[..., 2, 3] = 1.0
    j[..., 3, :3] = (r / 3)[..., None]
    return j


def module_speeds(
    forward_speed: ArrayLike, omega_x: ArrayLike, omega_y: ArrayLike, lever: ArrayLike
) -> Array:
    """Wall speeds (..., 3) m/s for a wanted motion.

    The first three rows of the inverse of ``jacobian``, times r.

    Args:
        forward_speed: V_cz (...,), m/s.
        omega_x: rotation about the robot's x axis (...,), rad/s.
        omega_y: rotation about the robot's y axis (...,), rad/s.
        lever: m.
    """
    v, arm = np.asarray(forward_speed, float)[..., None], np.asarray(lever, float)[..., None]
    wx, wy = np.asarray(omega_x, float)[..., None], np.asarray(omega_y, float)[..., None]
    return module_speed(v, wx, wy, arm, _COS, _SIN)


@compiled
def module_speed(forward_speed, omega_x, omega_y, lever, cosine, sine):
    """Wall speed of the module at an angle of that cosine and sine; see ``module_speeds``."""
    return forward_speed - lever * (omega_y * cosine - omega_x * sine)


def elbow_radii(theta5: ArrayLike, mean_radius: ArrayLike, module_distance: ArrayLike) -> Array:
    """Eq. 20: radius (..., 3) m of each module's path through an elbow: R_e - d cos(theta5 + a_i).

    The printed case is R_e = 1.5 D and d = 0.5 D. V_1 : V_2 : V_3 are as these radii, their mean is
    R_e. A negative one (d > R_e) is a module that runs backward.

    Args:
        theta5: (...,) rad, module 1 from the turning direction.
        mean_radius: R_e (...,), m, of the elbow's centreline.
        module_distance: d (...,), m, from the robot axis to where the modules touch.
    """
    angle = np.asarray(theta5, float)[..., None] + np.array(MODULE_ANGLES)
    return np.asarray(mean_radius, float)[..., None] - np.asarray(module_distance, float)[
        ..., None
    ] * np.cos(angle)


def elbow_speeds(
    forward_speed: ArrayLike, theta5: ArrayLike, mean_radius: ArrayLike, module_distance: ArrayLike
) -> Array:
    """Wall speeds (..., 3) m/s through an elbow: Eq. 20, scaled to the mean ``forward_speed``.

    They equal ``module_speeds`` with lever d and a rotation of forward_speed / R_e towards the
    turning direction.
    """
    radii = elbow_radii(theta5, mean_radius, module_distance)
    return (
        np.asarray(forward_speed, float)[..., None]
        * radii
        / np.asarray(mean_radius, float)[..., None]
    )


def turn_from_roll(roll: ArrayLike, lug_radius: ArrayLike, pipe_radius: ArrayLike) -> Array:
    """Turn (...,) rad of the robot about its z axis when all modules roll without slip.

    For a roll of ``roll`` rad it is -roll r / R. The modules roll on the inside of the pipe. In
    rates: theta4_dot = -omega_z r / R.
    """
    return -np.asarray(roll, float) * np.asarray(lug_radius, float) / np.asarray(pipe_radius, float)


def belt_sign(roll: ArrayLike) -> Array:
    """Direction (...,) in which a positive belt speed drives a module: the sign of cos(roll).

    The upper track is at the wall for |roll| < 90 degrees, the lower one, running backward, beyond.
    Zero at the no-motion line (Fig. 18).
    """
    cosine = np.cos(roll)
    return np.where(np.abs(cosine) < _ON_THE_LINE, 0.0, np.sign(cosine))
