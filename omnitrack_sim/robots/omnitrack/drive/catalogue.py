"""Drives by name."""

from __future__ import annotations

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import ByName, named
from omnitrack_sim.robots.omnitrack.drive.gears import Drive

DRIVES: ByName[Drive] = ByName(
    three_motors=Drive("three_motors", ((1, 0, 0), (0, 1, 0), (0, 0, 1))),
    # One motor as strong and as heavy as the three together, so that only the gears differ.
    differential=Drive("differential", ((1 / 3, 1 / 3, 1 / 3),), size=3.0),
)
"""Shipped drives by the name that a scenario's ``robot.drive`` gives. Others are named by
``module:Object``."""


def drive_of(name: str) -> Drive:
    """The drive that ``robot.drive`` names.

    Raises:
        InputError: there is no such drive.
    """
    found = named(name, "robot.drive", DRIVES)
    if not isinstance(found, Drive):
        problem = f"is {name!r}, which is no ot.Drive"
        raise InputError(Fault("robot.drive", problem, (*DRIVES, "module:Object")))
    return found
