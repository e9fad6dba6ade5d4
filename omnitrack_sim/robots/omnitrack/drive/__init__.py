"""Drives: motors, the gears between them and the three belts, and their speed loops."""

from omnitrack_sim.robots.omnitrack.drive.catalogue import DRIVES, drive_of
from omnitrack_sim.robots.omnitrack.drive.gears import Drive
from omnitrack_sim.robots.omnitrack.drive.speed_loop import SpeedLoop

__all__ = ["DRIVES", "Drive", "SpeedLoop", "drive_of"]
