"""How far to roll before a fitting, so that theta5 is safe and the modules stay off the no-motion line.

Rolling all modules by phi turns the robot by -phi r / R. With R / r = 2.9, a third of a turn of the robot costs nearly
a whole turn of the modules, so there are many admissible rolls; the shortest one is taken.
"""

from __future__ import annotations

import numpy as np

from omnitrack_sim.frames import Array, wrap_angle

PERIOD = 2 * np.pi / 3
"""Three equal modules: an orientation repeats after 120 degrees."""
NO_MOTION_COSINE = 0.5
"""Least |cos roll| after an alignment: 30 degrees away from the no-motion line, where both tracks touch."""
AIM = 0.5
"""Part of the safe margin that is aimed at; the rest takes up slip while rolling."""
_OFFSETS = np.linspace(-1.0, 1.0, 17)
_TURNS = np.arange(-1, 2) * PERIOD


def orientation_error(theta5: Array, best: Array) -> Array:
    """Angle (n,) rad from the nearest of the three equal best orientations, in [-60, 60) degrees."""
    return wrap_angle(theta5 - best, PERIOD)


def plan_roll(theta5: Array, roll: Array, best: Array, margin: Array, radius_ratio: float) -> tuple[Array, Array]:
    """Shortest roll that brings the robot near ``best`` and keeps the modules off the no-motion line.

    Args:
        theta5: (n,) rad, module 1 from the turning direction.
        roll: (n,) rad, roll of the modules now.
        best: (n,) rad, wanted theta5, modulo 120 degrees.
        margin: (n,) rad, half-width of the safe range about it.
        radius_ratio: lug radius over pipe radius, r / R.

    Returns:
        The roll change (n,) rad, and whether one exists (n,) bool; the change is zero where none does.
    """
    turn = -orientation_error(theta5, best)[:, None, None] + _TURNS[:, None] + AIM * margin[:, None, None] * _OFFSETS
    turn = turn.reshape(len(theta5), -1)  # (n, candidates)
    change = -turn / radius_ratio
    admissible = np.abs(np.cos(roll[:, None] + change)) >= NO_MOTION_COSINE
    cost = np.where(admissible, np.abs(change), np.inf)
    shortest = np.argmin(cost, axis=1)
    rows = np.arange(len(theta5))
    exists = np.isfinite(cost[rows, shortest])
    return np.where(exists, change[rows, shortest], 0.0), exists
