"""Section III of the paper: how module speeds and robot motion belong together.

Robot frame: z forward, x towards module 1, modules at 0, 120 and -120 degrees. ``lever`` is the distance from the robot
axis at which the speeds act: the paper's Jacobian takes the module centre l, its Eq. 20 the wall at D/2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from omnitrack_sim.frames import Array
from omnitrack_sim.robot import MODULE_ANGLES

_COS, _SIN = np.cos(MODULE_ANGLES), np.sin(MODULE_ANGLES)  # (3,)
_ROOT3 = np.sqrt(3.0)


def jacobian(lug_radius: float, lever: float) -> Array:
    """J (4, 4) of Eq. 18: (omega_x, omega_y, omega_z, V_cz) = J (theta_dot_1, theta_dot_2, theta_dot_3, theta_dot_4).

    The paper contradicts itself: Eqs. 6-7 have module 2 at +120 degrees, Eqs. 11-12 and the first row of Eq. 18 have it
    at -120. Here it is at +120 throughout, so the first row has the other sign than printed.

    Args:
        lug_radius: r, m.
        lever: l, m.
    """
    a = lug_radius / (3 * lever)
    return np.array(
        [
            [0, _ROOT3 * a, -_ROOT3 * a, 0],
            [-2 * a, a, a, 0],
            [0, 0, 0, 1],
            [lug_radius / 3, lug_radius / 3, lug_radius / 3, 0],
        ]
    )


def module_speeds(forward_speed: ArrayLike, omega_x: ArrayLike, omega_y: ArrayLike, lever: ArrayLike) -> Array:
    """Wall speeds (..., 3) m/s of the three modules for a wanted motion: the inverse of Eq. 18 times r.

    v_i = V_cz - lever (omega_y cos a_i - omega_x sin a_i), with a_i = 0, 120, -120 degrees.

    Args:
        forward_speed: V_cz (...,), m/s.
        omega_x: rotation about the robot's x axis (...,), rad/s.
        omega_y: rotation about the robot's y axis (...,), rad/s.
        lever: m.
    """
    v, wx, wy, arm = (np.asarray(q, float)[..., None] for q in (forward_speed, omega_x, omega_y, lever))
    return v - arm * (wy * _COS - wx * _SIN)


def turn_from_roll(roll: ArrayLike, lug_radius: float, pipe_radius: float) -> Array:
    """Turn of the robot about its z axis, rad, when all modules roll by ``roll`` without slip: -roll r / R."""
    return -np.asarray(roll, float) * lug_radius / pipe_radius


def belt_sign(roll: ArrayLike) -> Array:
    """Direction (...,) in which a positive belt speed drives a module rolled by ``roll`` rad: the sign of cos(roll).

    The upper track is at the wall for |roll| < 90 degrees, the lower one, running backward, beyond. Zero at the
    no-motion line (Fig. 18).
    """
    cosine = np.cos(roll)
    return np.where(np.abs(cosine) < 1e-9, 0.0, np.sign(cosine))
