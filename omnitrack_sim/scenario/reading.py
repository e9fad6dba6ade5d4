"""Scenario files: found, read, validated; and scenarios with values changed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from omnitrack_sim.control.catalogue import controller_of, parameters_model
from omnitrack_sim.errors import Fault, InputError, NetworkError, ScenarioError
from omnitrack_sim.network import Network, load_network
from omnitrack_sim.network import validate as validate_network
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.paths import choices_at, set_value
from omnitrack_sim.schema.reading import (
    checked,
    fault_of,
    fields_at,
    read_toml,
    shipped_scenarios,
)
from omnitrack_sim.schema.tables import (
    Control,
)


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario file, or a shipped scenario by name.

    Raises:
        ScenarioError: no such file, bad TOML, or any fault in it; every fault is listed with its
            path in the file.
    """
    path, data = read_toml(source, "scenario", shipped_scenarios(), ScenarioError)
    return validate(data, path.parent)


def validate(data: Mapping[str, Any], folder: Path = Path()) -> Scenario:
    """A scenario from plain data, as read from TOML or JSON; a network may be a table, a file or a
    shipped one's name.

    Args:
        data: of the file.
        folder: that the path of a network is relative to.

    Raises:
        ScenarioError: lists every fault with its dotted path.
    """
    network = data.get("network")
    if isinstance(network, str | Mapping):
        data = {**data, "network": _network(network, folder)}
    data, faults = _with_parameters(data)
    try:
        scenario = read_back(data)
    except ScenarioError as error:
        raise ScenarioError([*error.faults, *faults]) from None
    for own in ("own_sensors", "own_metrics"):
        try:
            getattr(scenario, own)
        except InputError as error:
            faults = [*faults, *error.faults]
    if faults:
        raise ScenarioError(faults)
    return scenario


def _with_parameters(data: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[Fault]]:
    """A scenario's data with all keys of ``[control.parameters]``, and the faults found there."""
    control = data.get("control", {})
    kind = control.get("kind", Control().kind) if isinstance(control, Mapping) else None
    if not isinstance(kind, str):
        return data, []  # a fault that is told elsewhere
    try:
        model = parameters_model(controller_of(kind))
    except InputError as error:
        return {**data, "control": {**control, "kind": Control().kind}}, list(error.faults)
    given, where = control.get("parameters", {}), "control.parameters"
    if not isinstance(given, Mapping):
        return data, []
    try:
        parameters = checked(
            model, given, "", lambda item: _fault_below(where, model, item), ScenarioError
        )
    except ScenarioError as error:
        return {**data, "control": {**control, "parameters": {}}}, list(error.faults)
    known = parameters.model_dump(mode="json")
    return {**data, "control": {**control, "parameters": known}}, _unread(where, given, known)


def _unread(where: str, given: Mapping[str, Any], known: Mapping[str, Any]) -> list[Fault]:
    """Keys that a model passes over because it does not forbid others, as faults."""
    faults = [
        Fault(f"{where}.{key}", "unknown key", tuple(known)) for key in given if key not in known
    ]
    for key, value in given.items():
        inner = known.get(key)
        if isinstance(value, Mapping) and isinstance(inner, Mapping):
            faults += _unread(f"{where}.{key}", value, inner)
    return faults


def _fault_below(where: str, model: type[BaseModel], item: Any) -> Fault:
    """One of pydantic's errors in a table that stands at the path ``where``."""
    fault = fault_of(item, "", (), lambda places: fields_at(model, places))
    return Fault(f"{where}.{fault.where}", fault.problem, fault.choices)


def read_back(data: Mapping[str, Any]) -> Scenario:
    """The scenario of a saved run: as ``validate``, but controller, sensors and metrics of a user's
    own are not looked for."""
    return checked(
        Scenario,
        data,
        "pipes",
        lambda item: fault_of(item, "pipes", (), lambda places: choices_at(places, data)),
        ScenarioError,
    )


def _network(source: str | Mapping[str, Any], folder: Path) -> Network:
    """The network of a scenario: a table, a file or a shipped one's name."""
    try:
        if isinstance(source, Mapping):
            return validate_network(source)
        return load_network(folder / source if (folder / source).is_file() else source)
    except NetworkError as error:
        where = "network: " if isinstance(source, str) else "network."
        raise ScenarioError(
            [Fault(where + f.where, f.problem, f.choices) for f in error.faults]
        ) from None


def override(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """A copy with values changed by dotted path, such as ``{"control.cruise_speed": 0.12,
    "pipes.0.length": 1.0}``.

    Raises:
        ScenarioError: unknown paths (with the choices at that place) or values that do not fit.
    """
    data = scenario.model_dump(mode="json")
    faults = []
    for path, value in changes.items():
        fault = set_value(data, path, value)
        faults += [fault] if fault else []
    if faults:
        raise ScenarioError(faults)
    return validate(data)
