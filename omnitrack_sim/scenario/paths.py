"""Dotted paths in a scenario as plain data: setting a value, keys that may stand at a place."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from omnitrack_sim.errors import Fault
from omnitrack_sim.robot import Motor
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.schema.fittings import choices_of
from omnitrack_sim.schema.tables import (
    Pipe,
)

OPEN_TABLE = "control.parameters."
"""Below this path the controller decides which keys there are."""


def set_value(data: Any, path: str, value: Any) -> Fault | None:
    """Set one dotted path in nested tables and lists; the fault where there is no such place."""
    keys = path.split(".")
    if path == "control.kind" and isinstance(data, dict) and data["control"]["kind"] != value:
        # Another controller has other parameters.
        data["control"] = {**data["control"], "parameters": {}}
    place = data
    for depth, key in enumerate(keys, start=1):
        if isinstance(place, list):
            entries: dict[str, Any] = {str(i): i for i in range(len(place))}
        else:
            entries = {name: name for name in place} if isinstance(place, dict) else {}
        if key not in entries and path.startswith(OPEN_TABLE) and isinstance(place, dict):
            place[key] = value if depth == len(keys) else {}  # what may stand here is checked later
            entries[key] = key
        if key not in entries:
            problem = f"there is no {key!r} here" if entries else f"{key!r} is below a plain value"
            return Fault(path, problem, tuple(entries))
        if depth == len(keys):
            place[entries[key]] = value
        else:
            place = place[entries[key]]
    return None


def choices_at(places: list[str], data: Mapping[str, Any]) -> tuple[str, ...]:
    """Valid keys of the table at a pydantic path into plain data."""
    tables: dict[str, type[BaseModel]] = {
        name: info.annotation
        for name, info in Scenario.model_fields.items()
        if isinstance(info.annotation, type) and issubclass(info.annotation, BaseModel)
    }
    if not places:
        return tuple(Scenario.model_fields)
    if places[0] == "pipes":
        return choices_of(Pipe, data["pipes"], places[1])
    if places[0] == "robot" and len(places) > 1:
        return ("like", *Motor.model_fields)
    return tuple(tables[places[0]].model_fields) if places[0] in tables else ()
