"""From observation to command: routes, tracking, alignment, recovery; pure, over n robots."""

from omnitrack_sim.control.catalogue import CONTROLLERS
from omnitrack_sim.control.interface import (
    Command,
    Controller,
    ControlSetup,
    Observation,
    Settings,
)
from omnitrack_sim.control.jacobian import JacobianController
from omnitrack_sim.control.paper import EqualController, PaperController

__all__ = [
    "CONTROLLERS",
    "Command",
    "ControlSetup",
    "Controller",
    "EqualController",
    "JacobianController",
    "Observation",
    "PaperController",
    "Settings",
]
