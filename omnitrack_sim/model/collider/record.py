"""What the user data of the geoms says: which fitting a wall is, its sizes, where it stops carrying
a track."""

from __future__ import annotations

import math

import numpy as np

from omnitrack_sim.pipes import Elbow, Reducer, Straight, Tee
from omnitrack_sim.pipes.fittings import Fitting
from omnitrack_sim.rotations import Array

MARK = 20260.5
"""First number of a record: geoms without it are none of ours."""
STRAIGHT, ELBOW, TEE, REDUCER = 0.0, 1.0, 2.0, 3.0
RECORD_SIZE = 12
"""Numbers in a record. Wall: mark, kind, radius, three sizes, centre of its bounding box (3), ends
at its ports (3)."""
_ROOM = 0.002  # m, of the bounding box around the bore: deeper than any lug presses


def wall_record(fitting: Fitting, ends: tuple[bool, ...]) -> Array:
    """The record (RECORD_SIZE,) of one fitting.

    Sizes: length of a straight; length and end radius of a reducer; mean radius, sine and cosine of
    the angle of an elbow; half run, branch length and fillet radius of a tee, m.

    Args:
        fitting: straight, reducer, elbow or tee.
        ends: for each port, whether a contact line stops being supported there (open end, or the
            wall bends or steps).
    """
    if isinstance(fitting, Straight):
        kind, sizes = STRAIGHT, (fitting.length, 0.0, 0.0)
    elif isinstance(fitting, Reducer):
        kind, sizes = REDUCER, (fitting.length, fitting.port_radius("end"), 0.0)
    elif isinstance(fitting, Elbow):
        kind, sizes = ELBOW, (fitting.mean_radius, math.sin(fitting.angle), math.cos(fitting.angle))
    elif isinstance(fitting, Tee):
        kind, sizes = TEE, (fitting.run_length / 2, fitting.branch_length, fitting.fillet_radius)
    else:
        raise TypeError(f"no exact wall for a {type(fitting).__name__}")
    centre, _ = bounding_box(fitting)
    flags = (*map(float, ends), 0.0, 0.0)[:3]
    return np.array([MARK, kind, fitting.radius, *sizes, *centre, *flags])


def line_record(lug_pitch: float, scale: float) -> Array:
    """The record (RECORD_SIZE,) of a track: mark, distance of its lugs, m, robot's scale."""
    return np.array([MARK, lug_pitch, scale, *[0.0] * (RECORD_SIZE - 3)])


def bounding_box(fitting: Fitting) -> tuple[Array, Array]:
    """Centre (3,) and half sizes (3,) m of a box around the bore, fitting frame."""
    r = fitting.largest_radius
    if isinstance(fitting, Straight | Reducer):
        low, high = [-r, -r, 0.0], [r, r, fitting.length]
    elif isinstance(fitting, Elbow):
        outer = fitting.mean_radius + r
        # The bore between two end planes: corners of both end discs, and the outermost circle
        # between them.
        angles = np.append(np.linspace(0, fitting.angle, 181), fitting.angle)
        rims = np.array([outer, max(fitting.mean_radius - r, 0.0)])
        x = fitting.mean_radius - rims[:, None] * np.cos(angles)
        z = rims[:, None] * np.sin(angles)
        low, high = [x.min(), -r, z.min()], [x.max(), r, z.max()]
    elif isinstance(fitting, Tee):
        low, high = (
            [-r, -r, -fitting.run_length / 2],
            [fitting.branch_length, r, fitting.run_length / 2],
        )
    else:
        raise TypeError(f"no exact wall for a {type(fitting).__name__}")
    low, high = np.array(low), np.array(high)
    return (low + high) / 2, (high - low) / 2 + _ROOM
