"""Kinds of robots by the name that ``robot.kind`` gives: the package's own, and strangers'.

A robot from outside the package is found by an entry point of the group ``omnitrack_sim.robots`` of
an installed distribution, or is named ``module:Class`` in the file.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeGuard

from pydantic import SerializeAsAny

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import installed, named
from omnitrack_sim.base.reading import by_kind
from omnitrack_sim.robots.robot import Robot

DEFAULT = "omnitrack"
"""Kind of the robot of a file that names none."""
ROBOTS = (
    DEFAULT,
    "climber",
    "presser",
    "inchworm",
    "screw",
    "snake",
    "pirate",
    "helix",
    "mjcf",
)
"""Kinds of the robots that come with the package."""
RECORDED = "recorded"
"""Kind of the robot of a saved run whose own class is not loaded; no file of a user's has it."""

MODEL_FILES = (".xml", ".mjcf", ".urdf")
"""Ends of the names of files that hold a model of a robot."""


def is_model_file(source: str) -> bool:
    """Return whether a text is the name of a file that holds a model of a robot."""
    return Path(source).suffix.lower() in MODEL_FILES


def robot_in_full(robot: Any) -> Any:
    """Return the table that a robot's name or file is short for; any other value as it is."""
    if not isinstance(robot, str):
        return robot
    return {"kind": "mjcf", "file": robot} if is_model_file(robot) else {"kind": robot}


def robot_kinds() -> tuple[str, ...]:
    """Return the names that ``robot.kind`` may give, those of entry points included."""
    return tuple(dict.fromkeys((*ROBOTS, *installed("robots"))))


def robot_class(kind: str) -> type[Robot]:
    """Return the class of robots that ``robot.kind`` names.

    Args:
        kind: name of a shipped robot, of an entry point of the group ``omnitrack_sim.robots``, or
            ``module:Class``.

    Raises:
        InputError: there is no such class.
    """
    shipped = _shipped(kind)
    if shipped is not None:
        return shipped
    robot = named(kind, "robot.kind", dict.fromkeys(ROBOTS), "robots", _is_robot)
    if not _is_robot(robot):
        choices = (*robot_kinds(), "module:Class")
        raise InputError(Fault("robot.kind", f"is {kind!r}, which is no ot.Robot", choices))
    return robot


def _is_robot(thing: object) -> TypeGuard[type[Robot]]:
    """Return whether an object is a class of robots."""
    return isinstance(thing, type) and issubclass(thing, Robot)


@cache
def default_robot() -> Robot:
    """Return the robot of a file that names none."""
    return robot_class(DEFAULT)()


def _shipped(kind: str) -> type[Robot] | None:
    """Return a class of the package, None for other kinds; no other robot's module is imported."""
    match kind:
        case "omnitrack":
            from omnitrack_sim.robots.omnitrack import Omnitrack

            return Omnitrack
        case "climber":
            from omnitrack_sim.robots.climber import Climber

            return Climber
        case "presser":
            from omnitrack_sim.robots.presser import Presser

            return Presser
        case "inchworm":
            from omnitrack_sim.robots.inchworm import Inchworm

            return Inchworm
        case "screw":
            from omnitrack_sim.robots.screw import Screw

            return Screw
        case "snake":
            from omnitrack_sim.robots.snake import Snake

            return Snake
        case "pirate":
            from omnitrack_sim.robots.pirate import Pirate

            return Pirate
        case "helix":
            from omnitrack_sim.robots.helix import Helix

            return Helix
        case "mjcf":
            from omnitrack_sim.robots.mjcf import Mjcf

            return Mjcf
        case "recorded":
            from omnitrack_sim.robots.recorded import Recorded

            return Recorded
    return None


RobotOfKind = Annotated[SerializeAsAny[Robot], by_kind(robot_class, DEFAULT)]
"""A robot as a table of a file, which its key ``kind`` reads."""
