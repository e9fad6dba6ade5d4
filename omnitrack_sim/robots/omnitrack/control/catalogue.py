"""Controllers by name, and the models of their parameters."""

from __future__ import annotations

from pydantic import BaseModel

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import named
from omnitrack_sim.base.table import Table
from omnitrack_sim.robots.omnitrack.control.interface import Controller

CONTROLLERS = {
    "jacobian": "omnitrack_sim.robots.omnitrack.control.jacobian:JacobianController",
    "paper": "omnitrack_sim.paper.open_loop:PaperController",
    "equal": "omnitrack_sim.paper.open_loop:EqualController",
    "driven": "omnitrack_sim.robots.omnitrack.control.driven:DrivenController",
    "policy": "omnitrack_sim.robots.omnitrack.policy.controller:PolicyController",
}
"""Shipped controllers, ``module:Class`` by the short name that ``control.kind`` may give. Only the
one that a scenario names is imported, so a controller may itself name another one."""


class NoParameters(Table):
    """``[control.parameters]`` of a controller that has none."""


def controller_of(kind: str) -> type[Controller]:
    """The controller class that ``control.kind`` names.

    Raises:
        InputError: there is no such class, or it has no ``step``.
    """
    if kind in CONTROLLERS:
        return named(CONTROLLERS[kind], "control.kind", {})
    controller = named(kind, "control.kind", CONTROLLERS)
    if not (isinstance(controller, type) and callable(getattr(controller, "step", None))):
        problem = f"is {kind!r}, which is no class with a step"
        raise InputError(Fault("control.kind", problem, (*CONTROLLERS, "module:Object")))
    return controller


def parameters_model(controller: type[Controller]) -> type[BaseModel]:
    """The model of a controller's ``[control.parameters]``; an empty table where it has none."""
    return getattr(controller, "Parameters", NoParameters)
