"""Scenario files: reading, validation, changes by dotted path, and scenarios for a driver."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from omnitrack_sim.base.arguments import check_changes, check_is
from omnitrack_sim.base.bounds import MAX_PARTS
from omnitrack_sim.base.errors import Fault, InputError, NetworkError, ScenarioError, gathered
from omnitrack_sim.base.naming import TRUST, NotTrustedError, is_trusting, is_usable, trusting
from omnitrack_sim.base.paths import Document, keys_of, value_at
from omnitrack_sim.base.reading import SCENARIO, beside, checked, is_file, read_file
from omnitrack_sim.base.table import FileName, ObjectName, marks_of
from omnitrack_sim.base.text import finite, shown
from omnitrack_sim.pipes.network import network_data, with_scans
from omnitrack_sim.pipes.network import validate as validate_network
from omnitrack_sim.pipes.planning import around_route
from omnitrack_sim.pipes.profile import with_profiles
from omnitrack_sim.robots.control import Controller, controller_of, parameters_model
from omnitrack_sim.robots.driving import DriverTable, Order, obeys_orders
from omnitrack_sim.robots.kinds import DEFAULT, RECORDED, robot_class, robot_in_full
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.tables import RecordTable

OPEN_TABLE = ("control", "parameters")
"""Below this path the controller decides which keys there are."""


def set_value(data: Any, path: str, value: Any) -> Fault | None:
    """Set the value at a dotted path in a scenario's plain data, which may be incomplete.

    Tables along the path that the data leaves out are filled with their defaults.

    Returns:
        None; or the fault where there is no such place, and then the data is unchanged.
    """
    # Parameters of one controller mean nothing to another.
    if path == "control.kind":
        control = data.get("control") if isinstance(data, dict) else None
        if isinstance(control, dict) and _control_kind(data) != value:
            data["control"] = {**control, "parameters": {}}
    # Parameters of one robot mean nothing to another, and neither does its controller.
    if path == "robot.kind" and isinstance(data, dict) and _robot_kind(data) != value:
        data["robot"] = {}
        control = data.get("control")
        if isinstance(control, dict):
            own = ("kind", "parameters")
            data["control"] = {key: item for key, item in control.items() if key not in own}
    fault = _document(data).set(path, value)
    if fault is None:
        _forget_digest(data, path)
    return fault


def kinds_first(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes by path with the ``kind`` of a table before what else is set in that table.

    A new kind drops the values of the old one, and decides which keys there are. The kind of a
    robot drops its controller as well. All else stays in order.
    """
    order = {path: i for i, path in enumerate(changes)}

    def place(path: str) -> tuple[int, int]:
        table, _, key = path.rpartition(".")
        if key != "kind" or not table:
            return order[path], 2
        inside = (f"{table}.", "control.") if path == "robot.kind" else (f"{table}.",)
        first = min(i for other, i in order.items() if f"{other}.".startswith(inside))
        return first, 0 if path == "robot.kind" else 1

    return {path: changes[path] for path in sorted(changes, key=place)}


def _document(data: Any) -> Document:
    """Plain data of a scenario; the controller knows the keys of ``[control.parameters]``."""
    return Document(Scenario, data, {OPEN_TABLE: _parameters_of})


def _parameters_of(data: Any) -> Any:
    """Model of ``control.parameters`` of a scenario's data."""
    try:
        return parameters_model(controller_of(_control_kind(data), _controllers_of(data)))
    except InputError:
        return None  # reported where the controller is read


def _control_kind(data: Any) -> str:
    """``control.kind`` of a scenario's data, by default the first of the robot."""
    return str(value_at(data, "control.kind") or next(iter(_controllers_of(data))))


def _forget_digest(data: Any, path: str) -> None:
    """Remove what is known of the file beside a key that now names another one."""
    *before, key = keys_of(path)
    if tuple(before) == OPEN_TABLE:
        model = _parameters_of(data)
    elif before == ["robot"] and _knows_robot(data):
        model = robot_class(_robot_kind(data))
    else:
        return
    file = {} if model is None else marks_of(model, FileName)
    if key in file:
        for known in (file[key].digest, *file[key].values):
            value_at(data, ".".join(before)).pop(known, None)


def load_scenario(source: str | Path, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario file, or a shipped scenario by name.

    The ``scenario.json`` of a saved run is such a file.

    Args:
        source: the file or name.
        changes: values by dotted path, set before anything is checked, so that they may mend what
            the file has wrong; otherwise as ``override`` sets them.

    Raises:
        ScenarioError: no such file, bad TOML or JSON, or any fault in it or in the changes; every
            fault is listed with its path in the file.
        TypeError: the changes are no mapping.

    Example:
        >>> ot.load_scenario("tee_turn", {"pipes.0.length": 0.5}).pipes[0].length
        0.5
    """
    path, data = read_file(source, SCENARIO, ScenarioError)
    return validate(data, path.parent, changes)


@trusting()
def validate(
    data: Mapping[str, Any], folder: Path = Path(), changes: Mapping[str, Any] | None = None
) -> Scenario:
    """Return a scenario from plain data, as read from TOML or JSON.

    A network may be a table, a file or the name of a shipped one. What is validated is to be run:
    modules of the user's own objects that it names are imported.

    Args:
        data: of the file.
        folder: that the path of a network is relative to.
        changes: values by dotted path, set before anything is checked.

    Raises:
        ScenarioError: lists every fault with its dotted path.
    """
    if changes is not None:
        check_changes(changes)
    data, unset = _changed(data, folder, changes) if changes else (data, [])
    data, networks = _with_network(data, folder)
    data, scans = _with_scans(data, folder)
    data, robots = _with_robot(data, folder)
    data, parameters = _with_parameters(data, folder)
    # Each part is checked alone, so that one fault does not hide those of the others.
    faults = [*unset, *networks, *scans, *robots, *parameters, *_own_faults(data)]
    try:
        scenario = read_back(data)
    except ScenarioError as error:
        # A network with faults of its own is left out here, and is not missing for that.
        others = [f for f in error.faults if not (networks and f.where == "network")]
        raise ScenarioError([*others, *faults]) from None
    if faults:
        raise ScenarioError(faults)
    return scenario


def _own_faults(data: Mapping[str, Any]) -> list[Fault]:
    """Faults of the user's own sensors and metrics that a scenario names."""
    try:
        record = RecordTable.model_validate(data.get("record", {}))
    except ValidationError:
        return []  # reported with the table
    faults: list[Fault] = []
    if not (record.sensors or record.metrics):
        return faults
    for own in ("own_sensors", "own_metrics"):
        with gathered(faults):
            getattr(Scenario.model_construct(record=record), own)
    return faults


def _changed(
    data: Mapping[str, Any], folder: Path, changes: Mapping[str, Any]
) -> tuple[dict[str, Any], list[Fault]]:
    """Copy a scenario's data with values changed by dotted path; faults of invalid paths."""
    plain, faults = copy.deepcopy(dict(data)), []
    changes = {path: robot_in_full(v) if path == "robot" else v for path, v in changes.items()}
    if "robot" in plain:
        plain["robot"] = robot_in_full(plain["robot"])
    if any(path.startswith("robot.") for path in changes):
        # `values_at_scale` may state the robot at another size; a change means the robot at hand.
        plain["robot"] = _at_its_scale(plain.get("robot", {}), changes)
    for path, value in kinds_first(changes).items():
        network = plain.get("network")
        if path.startswith("network.") and isinstance(network, str):
            try:
                plain["network"] = network_data(beside(folder, network))
            except NetworkError:
                continue  # reported when the network is read
        if path.startswith("robot.") and path != "robot.kind" and not _knows_robot(plain):
            continue  # reported when the robot is read
        for place in _document(plain).expand(path):
            fault = set_value(plain, place, value)
            faults += [fault] if fault else []
    return plain, faults


def _knows_robot(data: Mapping[str, Any]) -> bool:
    """Return whether there is a class of the kind of robot of a scenario's data."""
    try:
        robot_class(_robot_kind(data))
    except InputError:
        return False
    return True


def _at_its_scale(robot: Any, changes: Mapping[str, Any]) -> Any:
    """Robot table with all values at its own scale, to which changes refer."""
    if not isinstance(robot, Mapping):
        return robot
    try:
        model = robot_class(str(robot.get("kind", DEFAULT)))
    except InputError:
        return robot  # reported where the robot is read
    if "values_at_scale" not in model.model_fields:
        return robot
    changed = {keys_of(path)[1] for path in changes if path.startswith("robot.")}
    # A change may mend the very value that makes the table invalid: then it is tried without it.
    for left_out in ({"kind"}, {"kind", *changed}):
        table = {key: value for key, value in robot.items() if key not in left_out}
        try:
            return model.model_validate(table, strict=True).model_dump(mode="json")
        except (ValidationError, RecursionError):
            continue
    return robot


def _with_network(data: Mapping[str, Any], folder: Path) -> tuple[Mapping[str, Any], list[Fault]]:
    """Scenario data with its network read; or data without it, and its faults."""
    source = data.get("network")
    if not isinstance(source, str | Mapping):
        return data, []
    try:
        is_table = isinstance(source, Mapping)
        table = with_scans(source, folder) if is_table else network_data(beside(folder, source))
        return _cut_out({**data, "network": validate_network(table)}), []
    except NetworkError as error:
        where = "network: " if isinstance(source, str) else "network."
        faults = [fault.at(where + fault.where) for fault in error.faults]
        return {key: value for key, value in data.items() if key != "network"}, faults


def _with_scans(data: Mapping[str, Any], folder: Path) -> tuple[Mapping[str, Any], list[Fault]]:
    """Scenario data with the scans read that its pipes name; or without them, and their faults."""
    pipes, faults = with_profiles(data.get("pipes"), folder, "pipes")
    return ({**data, "pipes": pipes} if pipes else data), faults


def _cut_out(data: dict[str, Any]) -> dict[str, Any]:
    """Return the data with the part of its network near the route alone.

    Only of a town, or of a mission that leads from or to a fitting.

    Raises:
        NetworkError: there is no way.
    """
    network, mission = data["network"], data.get("mission")
    if not isinstance(mission, Mapping) or mission.get("map") == "unknown":
        return data
    start, goals = mission.get("start"), mission.get("goals")
    if not (isinstance(goals, Sequence) and len(goals) == 1):
        return data
    if not (isinstance(start, str) and isinstance(goals[0], str)):
        return data  # reported with the table
    names = {fitting.name for fitting in network.fittings} - network.ports.keys()
    if len(network.fittings) <= MAX_PARTS and not names & {start, goals[0]}:
        return data
    part, start, goal = around_route(network, start, goals[0])
    return {**data, "network": part, "mission": {**mission, "start": start, "goals": [goal]}}


def _with_robot(data: Mapping[str, Any], folder: Path) -> tuple[Mapping[str, Any], list[Fault]]:
    """Return the data with the robot as a table, files by absolute paths; faults of its kind."""
    robot = data.get("robot", {})
    if isinstance(robot, str):
        robot = robot_in_full(robot)
        data = {**data, "robot": robot}
    kind = robot.get("kind", DEFAULT) if isinstance(robot, Mapping) else DEFAULT
    if kind == DEFAULT or not isinstance(kind, str):
        return data, []
    try:
        model = robot_class(kind)
    except InputError as error:
        return {key: value for key, value in data.items() if key != "robot"}, list(error.faults)
    return {**data, "robot": {**robot, **_absolute_files(robot, model, folder)}}, []


def _with_parameters(
    data: Mapping[str, Any], folder: Path
) -> tuple[Mapping[str, Any], list[Fault]]:
    """Return the data with the controller and all its parameters, and the faults of both.

    The controller is the robot's first where none is named.
    """
    control = data.get("control", {})
    if not isinstance(control, Mapping) or not isinstance(control.get("kind", ""), str):
        return data, []  # reported with the table
    control, controllers = {**control, "kind": _control_kind(data)}, _controllers_of(data)
    data = {**data, "control": control}
    try:
        model = parameters_model(controller_of(control["kind"], controllers))
    except InputError as error:
        return {**data, "control": {**control, "kind": next(iter(controllers))}}, list(error.faults)
    table, where = control.get("parameters", {}), "control.parameters"
    if not isinstance(table, Mapping):
        return data, []
    table = {**table, **_absolute_files(table, model, folder)}
    try:
        parameters = checked(model, table, ScenarioError)
    except ScenarioError as error:
        faults = [fault.at(f"{where}.{fault.where}".rstrip(".")) for fault in error.faults]
        return {**data, "control": {**control, "parameters": {}}}, faults
    known = parameters.model_dump(mode="json")
    faults = [*_unread(where, table, known), *_endless(where, known)]
    return {**data, "control": {**control, "parameters": known}}, faults


def _controllers_of(data: Mapping[str, Any]) -> Mapping[str, type[Controller]]:
    """Shipped controllers of the robot of a scenario's data."""
    try:
        return robot_class(_robot_kind(data)).controllers()
    except InputError:
        return robot_class(DEFAULT).controllers()  # reported where the robot is read


def _robot_kind(data: Any) -> str:
    """``robot.kind`` of a scenario's data."""
    kind = value_at(data, "robot.kind")
    return DEFAULT if kind is None else str(kind)


def _absolute_files(
    table: Mapping[str, Any], model: type[BaseModel], folder: Path
) -> dict[str, str]:
    """Absolute paths of the existing files that a controller's parameters name, by key."""
    # A saved scenario then finds them from any folder.
    paths = {}
    for key in marks_of(model, FileName):
        name = table.get(key)
        if isinstance(name, str) and is_file(path := Path(beside(folder, name))):
            paths[key] = str(path.resolve())
    return paths


def _endless(where: str, known: Mapping[str, Any]) -> list[Fault]:
    """Faults of parameters that a user's own model allows to be infinite or NaN."""
    faults = []
    for key, value in known.items():
        if isinstance(value, Mapping):
            faults += _endless(f"{where}.{key}", value)
        elif finite(value) != value:
            problem = f"is {shown(value)}; it must be finite, for scenario.json to say it"
            faults.append(Fault(f"{where}.{key}", problem))
    return faults


def _unread(where: str, table: Mapping[str, Any], known: Mapping[str, Any]) -> list[Fault]:
    """Faults of keys that a model ignores because it does not forbid unknown ones."""
    faults = [
        Fault(f"{where}.{key}", "unknown key", tuple(known), given=key)
        for key in table
        if key not in known
    ]
    for key, value in table.items():
        inner = known.get(key)
        if isinstance(value, Mapping) and isinstance(inner, Mapping):
            faults += _unread(f"{where}.{key}", value, inner)
    return faults


def read_back(data: Mapping[str, Any], kept: Mapping[str, Any] | None = None) -> Scenario:
    """Return the scenario of a saved run, without importing the user's own objects it names.

    Args:
        data: of its file.
        kept: what the run has recorded of its robot, ``Recorded``'s ``file`` and ``values``.

    Raises:
        ScenarioError: a fault of the data.
        NotTrustedError: it names code that is not loaded, and there is no record.
    """
    robot = data.get("robot")
    if isinstance(robot, Mapping):
        if kept is None:
            refuse_file(robot)
        elif not can_be_made(robot):
            table = {"table": json.dumps(robot), "tether": robot.get("tether")}
            data = {**data, "robot": {"kind": RECORDED, **table, **kept}}
    return checked(Scenario, data, ScenarioError, choices_at=_document(data).keys_at)


def refuse_file(robot: Mapping[str, Any]) -> None:
    """Raise a ``NotTrustedError`` for a robot of a file, unless the run is trusted."""
    for key in () if is_trusting() else marks_of(robot_class(_kind_in(robot)), FileName):
        problem = f"is {robot.get(key)!r}, a file that only looking at a run does not read; if you"
        raise NotTrustedError(Fault(f"robot.{key}", f"{problem} trust it: {TRUST}"))


def _kind_in(robot: Mapping[str, Any]) -> str:
    return str(robot.get("kind", DEFAULT))


def can_be_made(robot: Mapping[str, Any]) -> bool:
    """Return whether a robot's table may be read: its code is loaded, and no file is asked for."""
    try:
        model = robot_class(_kind_in(robot))
    except NotTrustedError:
        return False
    names = [str(robot.get(key, "")) for key in marks_of(model, ObjectName)]
    if not all(is_usable(name) for name in names if ":" in name):
        return False
    return is_trusting() or not marks_of(model, FileName)


def as_scenario(scenario: Scenario | str | os.PathLike[str]) -> Scenario:
    """Return a scenario itself, or read the one of a file or of a shipped name.

    Raises:
        ScenarioError: as of ``load_scenario``. TypeError: it is neither of these.
    """
    if isinstance(scenario, str | os.PathLike):
        return load_scenario(os.fspath(scenario))
    return check_is(Scenario, "scenario", scenario)


def override(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """Return a copy with values changed by dotted path.

    A change is such as ``{"control.cruise_speed": 0.12, "pipes.0.length": 1.0}``; ``*`` stands for
    every item of a list, as in ``"pipes.*.turn_deg"``.

    Raises:
        ScenarioError: unknown paths (with the choices at that place) or values that do not fit.
        TypeError: an argument is of another type.

    Example:
        >>> longer = ot.override(ot.load_scenario("straight"), {"pipes.*.length": 2.0})
        >>> [pipe.length for pipe in longer.pipes]
        [2.0]
    """
    check_is(Scenario, "scenario", scenario)
    return validate(scenario.model_dump(mode="json"), changes=changes)


MAX_DRIVE = 3600.0
"""Time limit of a drive whose scenario has none of its own, s."""


def to_drive(scenario: Scenario, driver: str) -> Scenario:
    """Return a scenario for a human ``driver``; its controller becomes the autopilot.

    What the author expects of the controller is left out. Of a scenario that was driven, the orders
    are.
    """
    data = scenario.model_dump(mode="json")
    autopilot = autopilot_of(scenario)
    data["name"] = driven_name(scenario.name)
    data["run"]["expected_outcome"] = None
    data["control"] |= {
        "kind": _driven_kind(scenario.robot),
        "parameters": {
            "driver": driver,
            "autopilot": autopilot["kind"],
            "autopilot_parameters": autopilot["parameters"],
        },
    }
    # The default follows from the route's length, which says nothing of how long somebody drives.
    if data["run"]["time_limit"] is None:
        data["run"]["time_limit"] = MAX_DRIVE
    return validate(data)


def _driven_kind(robot: Robot) -> str:
    """Return the kind of a robot's controller that obeys a driver.

    Raises:
        ScenarioError: it has none.
    """
    for kind, controller in robot.controllers().items():
        if obeys_orders(controller):
            return kind
    problem = f"is {robot.kind!r}, of which no controller obeys a driver"
    raise ScenarioError([Fault("robot.kind", problem)])


def driven_name(name: str) -> str:
    """Name of a scenario that somebody drives."""
    return f"{name.removesuffix('_driven')}_driven"


def with_orders(scenario: Scenario, orders: Sequence[Order]) -> Scenario:
    """Return a driven scenario that repeats the run of these orders."""
    data = scenario.model_dump(mode="json")
    data["control"]["parameters"]["orders"] = [order.model_dump(mode="json") for order in orders]
    return validate(data)


def autopilot_of(scenario: Scenario) -> dict[str, Any]:
    """Plain data of ``[control]`` with the autopilot as controller; unchanged if nobody drives."""
    control = scenario.control.model_dump(mode="json")
    table = scenario.control_parameters
    if not isinstance(table, DriverTable):
        return control
    return control | {"kind": table.autopilot, "parameters": table.autopilot_parameters}
