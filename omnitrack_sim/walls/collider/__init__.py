"""Exact contact of whole tracks with fittings of any kind, compiled into MuJoCo's collision table.

A track is one capsule, a fitting one geom; their user data says what they are. ``record`` makes
that data, ``line`` finds the contacts by the functions that each kind of fitting brings,
``compile`` turns them into C functions, ``install`` puts these into MuJoCo.
"""

from omnitrack_sim.walls.collider.install import bring, install
from omnitrack_sim.walls.collider.record import RECORD_SIZE, bounding_box, line_record, wall_record

__all__ = [
    "RECORD_SIZE",
    "bounding_box",
    "bring",
    "install",
    "line_record",
    "wall_record",
]
