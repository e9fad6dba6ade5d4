"""What the user data of the geoms says: which fitting a wall is, its sizes, where it stops carrying
a track."""

from __future__ import annotations

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Fitting
from omnitrack_sim.pipes.compiled import Wall
from omnitrack_sim.pipes.fittings.base import MOST_PORTS, MOST_SIZES

MARK = 20260.5
"""First number of a record: geoms without it are none of ours."""
KIND, BOX = 1, 2
ENDS = BOX + 3
SIZES = ENDS + MOST_PORTS
RECORD_SIZE = SIZES + MOST_SIZES
"""Places in a record of a wall, and its size: mark, number of the kind in ``WALLS``, centre of the
bounding box (3), whether contact ends at each port, the fitting's ``sizes``."""
PITCH, SCALE = 1, 2
"""Places in a record of a track: distance of its lugs, m, and the robot's scale."""
ROOM = 0.002
"""Of the bounding box around the bore, m: deeper than any lug presses."""
WALLS: list[Wall] = []
"""Kinds by the number that records of this process have for them."""


def wall_number(wall: Wall) -> int:
    """The number of a kind's wall; a new one where it has none."""
    if wall not in WALLS:
        WALLS.append(wall)
    return WALLS.index(wall)


def wall_record(fitting: Fitting, ends: tuple[bool, ...]) -> Array:
    """The record (RECORD_SIZE,) of one fitting, for this process only.

    Args:
        fitting: of any kind.
        ends: for each port, whether a contact line stops being supported there (open end, or the
            wall bends or steps).
    """
    record = np.zeros(RECORD_SIZE)
    record[0], record[KIND] = MARK, wall_number(fitting.wall)
    record[BOX:ENDS] = bounding_box(fitting)[0]
    record[ENDS : ENDS + len(ends)] = ends
    record[SIZES : SIZES + len(fitting.sizes)] = fitting.sizes
    return record


def line_record(lug_pitch: float, scale: float) -> Array:
    """The record (RECORD_SIZE,) of a track: mark, distance of its lugs, m, and the robot's
    scale."""
    record = np.zeros(RECORD_SIZE)
    record[0], record[PITCH], record[SCALE] = MARK, lug_pitch, scale
    return record


def bounding_box(fitting: Fitting) -> tuple[Array, Array]:
    """Centre (3,) and half sizes (3,) m of a box around the bore, fitting frame."""
    low, high = fitting.bounds
    return (low + high) / 2, (high - low) / 2 + ROOM
