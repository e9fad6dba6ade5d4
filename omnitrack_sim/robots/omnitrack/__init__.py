"""The robot as data: its parameters, its motors, the law that scales it, and the motors' drive."""

from omnitrack_sim.robots.omnitrack.motors import MOTORS, Motor
from omnitrack_sim.robots.omnitrack.parameters import GRAVITY, MODULE_ANGLES, MODULES, Robot
from omnitrack_sim.robots.omnitrack.quantity import Parameter, Quantity

__all__ = [
    "GRAVITY",
    "MODULES",
    "MODULE_ANGLES",
    "MOTORS",
    "Motor",
    "Parameter",
    "Quantity",
    "Robot",
]
