"""Controllers by name, and the models of their parameters."""

from __future__ import annotations

from pydantic import BaseModel

from omnitrack_sim.control.driven import KIND, DrivenController
from omnitrack_sim.control.interface import Controller
from omnitrack_sim.control.jacobian import JacobianController
from omnitrack_sim.control.paper import EqualController, PaperController
from omnitrack_sim.control.policy.controller import PolicyController
from omnitrack_sim.errors import Fault, InputError
from omnitrack_sim.naming import named
from omnitrack_sim.table import Table

CONTROLLERS: dict[str, type[Controller]] = {
    "jacobian": JacobianController,
    "paper": PaperController,
    "equal": EqualController,
    KIND: DrivenController,
    "policy": PolicyController,
}
"""Shipped controllers by the name that a scenario's ``control.kind`` gives. Others are named by
``module:Class`` or handed over in Python."""


class NoParameters(Table):
    """``[control.parameters]`` of a controller that has none."""


def controller_of(kind: str) -> type[Controller]:
    """The controller class that ``control.kind`` names.

    Raises:
        InputError: there is no such class, or it has no ``step``.
    """
    found = named(kind, "control.kind", CONTROLLERS)
    if not (isinstance(found, type) and callable(getattr(found, "step", None))):
        problem = f"is {kind!r}, which is no class with a step"
        raise InputError(Fault("control.kind", problem, (*CONTROLLERS, "module:Object")))
    return found


def parameters_model(controller: type[Controller]) -> type[BaseModel]:
    """The model of a controller's ``[control.parameters]``; an empty table where it has none."""
    return getattr(controller, "Parameters", NoParameters)
