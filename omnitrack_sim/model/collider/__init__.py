"""Exact contact of whole tracks with straights, reducers, elbows and tees, compiled into MuJoCo's
collision table.

A track is one capsule, a fitting one geom; their user data says what they are. ``record`` makes
that data, ``line`` finds the contacts, ``install`` puts them into MuJoCo. Needs numba (extra
``fast``).
"""

from omnitrack_sim.model.collider.install import install, why_not
from omnitrack_sim.model.collider.record import RECORD_SIZE, bounding_box, line_record, wall_record

__all__ = ["RECORD_SIZE", "bounding_box", "install", "line_record", "wall_record", "why_not"]
