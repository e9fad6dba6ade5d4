"""The robot as data: its parameters, its motors, the law that scales it, and the motors' drive."""

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.robots.omnitrack.motors import MOTORS, Motor
from omnitrack_sim.robots.omnitrack.parameters import GRAVITY, MODULE_ANGLES, MODULES, Omnitrack
from omnitrack_sim.robots.quantity import Parameter, Quantity
from omnitrack_sim.robots.robot import Robot


def as_omnitrack(robot: Robot) -> Omnitrack:
    """Return the robot of a scenario where only the omnidirectional one serves.

    Raises:
        TypeError: it is another one.
    """
    return check_is(Omnitrack, "robot", robot)


__all__ = [
    "GRAVITY",
    "MODULES",
    "MODULE_ANGLES",
    "MOTORS",
    "Motor",
    "Omnitrack",
    "Parameter",
    "Quantity",
    "as_omnitrack",
]
