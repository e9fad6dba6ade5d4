"""Observation -> command: guide along the route, tracking law, alignment, motors. Pure, vectorised
over trials."""

from omnitrack_sim.control.interface import Command, Controller, Observation, Settings
from omnitrack_sim.control.jacobian import JacobianController
from omnitrack_sim.control.paper import EqualController, PaperController

CONTROLLERS: dict[str, type[Controller]] = {
    "jacobian": JacobianController,
    "paper": PaperController,
    "equal": EqualController,
}
"""Controllers by the name that a scenario's ``control.kind`` gives."""

__all__ = ["CONTROLLERS", "Command", "Controller", "Observation", "Settings"]
