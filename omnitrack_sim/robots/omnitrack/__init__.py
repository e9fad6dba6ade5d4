"""The robot as data: its parameters, its motors, the law that scales it, and the motors' drive."""

from omnitrack_sim.base.arguments import check_is
from omnitrack_sim.robots.omnitrack.channels import MODULES as MODULES
from omnitrack_sim.robots.omnitrack.motors import MOTORS as MOTORS
from omnitrack_sim.robots.omnitrack.motors import Motor as Motor
from omnitrack_sim.robots.omnitrack.parameters import MODULE_ANGLES as MODULE_ANGLES
from omnitrack_sim.robots.omnitrack.parameters import Omnitrack as Omnitrack
from omnitrack_sim.robots.robot import Robot


def as_omnitrack(robot: Robot) -> Omnitrack:
    """Return the robot of a scenario where only the omnidirectional one serves.

    Raises:
        TypeError: it is another one.
    """
    return check_is(Omnitrack, "robot", robot)
