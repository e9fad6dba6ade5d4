"""Orders of a driver, and what a controller states that obeys them.

A controller whose ``Parameters`` inherit from ``DriverTable``, and that is an ``ObeysOrders``, lets
people drive its robot from the keyboard (``omnitrack drive``) or by a list in a scenario.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator

from omnitrack_sim.base.bounds import MAX_ORDERS
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Angle, Table, Unit
from omnitrack_sim.robots.control import (
    Controller,
    ControlSetup,
    Observation,
    OwnController,
    controller_of,
    parameters_model,
)

Component = Annotated[float, Field(ge=-1e6, le=1e6)]
"""Of a direction, whose length means nothing."""


class Order(Table):
    """Order of a driver from ``time`` on, until the next order."""

    time: Annotated[float, Field(ge=0), Unit("s")]
    """From which on it holds."""
    by: Literal["hand", "autopilot", "end"] = "hand"
    """Who drives: the driver, the autopilot, or nobody any more: the run is over after the control
    step."""
    speed: Annotated[float, Field(ge=-100, le=100), Unit("m/s")] = 0.0
    """Nose first; negative: tail first."""
    heading: tuple[Component, Component, Component] | None = None
    """Direction of the nose, world frame. Left out: wherever the pipe leads it."""
    roll_deg: Angle | None = None
    """Of all modules. Left out: as it is."""


class DriverTable(Table):
    """``[control.parameters]`` that every controller has which obeys a driver."""

    driver: Annotated[str, Field(min_length=1, max_length=80)] = "its orders"
    """Who drives, in events and provenance: "keyboard" of a robot that was driven by keys."""
    autopilot: str = "own"
    """The controller to which the driver can hand over: a shipped one, or `module:Class`."""
    autopilot_parameters: dict[str, Any] = Field(default_factory=dict)
    """The `control.parameters` of the autopilot; once the scenario is checked, all of them."""
    orders: Annotated[tuple[Order, ...], Field(max_length=MAX_ORDERS)] = ()
    """A list of tables with the keys below, in the order of their times; at most 5,000."""

    @classmethod
    def autopilots(cls) -> Mapping[str, type[Controller]]:
        """Return the shipped controllers that ``autopilot`` may name."""
        return {"own": OwnController}

    @field_validator("orders")
    @classmethod
    def _in_order(cls, orders: tuple[Order, ...]) -> tuple[Order, ...]:
        for before, order in pairwise(orders):
            if order.time < before.time:
                raise ValueError(f"has one for {order.time:g} s behind one for {before.time:g} s")
        return orders

    @model_validator(mode="after")
    def _knows_its_autopilot(self) -> DriverTable:
        try:
            model = self.autopilot_model
        except InputError as error:
            text = "; ".join(str(fault.at("autopilot")) for fault in error.faults)
            raise ValueError(text) from None
        if issubclass(model, DriverTable):
            raise ValueError("autopilot: obeys orders itself; name a controller that does not")
        try:
            parameters = model(**self.autopilot_parameters)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(map(str, ("autopilot_parameters", *fault["loc"])))
            raise ValueError(f"{where}: {fault['msg']}") from None
        self.autopilot_parameters.update(parameters.model_dump(mode="json"))
        return self

    @property
    def autopilot_class(self) -> type[Controller]:
        """The class that ``autopilot`` names.

        Raises:
            InputError: there is no such class.
        """
        return controller_of(self.autopilot, self.autopilots())

    @property
    def autopilot_model(self) -> type[BaseModel]:
        """The model of ``autopilot_parameters``."""
        return parameters_model(self.autopilot_class)


@runtime_checkable
class ObeysOrders(Protocol):
    """Protocol of controllers that obey a driver.

    Attributes:
        setup: what it was made from.
        roll: (n, 3) rad, of the modules, as asked last.
    """

    setup: ControlSetup
    roll: Array

    def give(self, order: Order, robot: int = 0) -> None:
        """Add an order, to be obeyed from the first step on that is not before its time."""

    def orders(self, robot: int = 0) -> tuple[Order, ...]:
        """Return all orders of a robot so far."""
        ...

    def step(self, observation: Observation) -> Any:
        """Return the command for the next control period."""
        ...


def obeys_orders(controller: type[Controller]) -> bool:
    """Return whether controllers of a class let somebody drive."""
    return issubclass(parameters_model(controller), DriverTable)
