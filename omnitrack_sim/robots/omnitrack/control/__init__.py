"""From observation to command: routes, tracking, alignment, recovery; pure, over n robots."""

from omnitrack_sim.robots.control import Controller, ControlSetup, Observation, Settings
from omnitrack_sim.robots.omnitrack.control.command import Command
from omnitrack_sim.robots.omnitrack.control.jacobian import JacobianController

__all__ = [
    "Command",
    "ControlSetup",
    "Controller",
    "JacobianController",
    "Observation",
    "Settings",
]
