"""From observation to command: routes, tracking, alignment, recovery; pure, over n robots."""

from omnitrack_sim.robots.omnitrack.control.interface import (
    CONTROLLERS,
    Command,
    Controller,
    ControlSetup,
    Observation,
    Settings,
)
from omnitrack_sim.robots.omnitrack.control.jacobian import JacobianController

__all__ = [
    "CONTROLLERS",
    "Command",
    "ControlSetup",
    "Controller",
    "JacobianController",
    "Observation",
    "Settings",
]
