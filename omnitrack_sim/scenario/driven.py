"""Scenarios that someone drives, and back: the same pipes and robot under the controller
``driven``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from omnitrack_sim.robots.omnitrack.control.driven import KIND, Order
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.reading import validate

LONGEST_DRIVE = 3600.0
"""Time limit of a drive whose scenario has none of its own, s."""


def to_drive(scenario: Scenario, driver: str) -> Scenario:
    """A scenario's pipes, robot and start for ``driver``; its controller becomes the autopilot.

    What the author expects of the controller is left out. Of a scenario that was driven, the orders
    are.
    """
    data = scenario.model_dump(mode="json")
    autopilot = autopilot_of(scenario)
    data["name"] = driven_name(scenario.name)
    data["run"]["expected_outcome"] = None
    data["control"] |= {
        "kind": KIND,
        "parameters": {
            "driver": driver,
            "autopilot": autopilot["kind"],
            "autopilot_parameters": autopilot["parameters"],
        },
    }
    if data["run"]["time_limit"] is None:
        data["run"]["time_limit"] = LONGEST_DRIVE
    return validate(data)


def driven_name(name: str) -> str:
    """The name of a scenario that somebody drives."""
    return f"{name.removesuffix('_driven')}_driven"


def with_orders(scenario: Scenario, orders: Sequence[Order]) -> Scenario:
    """A driven scenario that repeats the run of these orders."""
    data = scenario.model_dump(mode="json")
    data["control"]["parameters"]["orders"] = [order.model_dump(mode="json") for order in orders]
    return validate(data)


def autopilot_of(scenario: Scenario) -> dict[str, Any]:
    """``[control]`` of the scenario under its autopilot, as plain data; of one that nobody drives,
    under its controller."""
    control = scenario.control.model_dump(mode="json")
    if scenario.control.kind != KIND:
        return control
    table = scenario.control_parameters
    return control | {"kind": table.autopilot, "parameters": table.autopilot_parameters}
