"""Scenario files: what a user writes, validated as a whole before anything runs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import BaseModel, Field, SerializeAsAny, WrapValidator, model_validator

from omnitrack_sim.control.catalogue import controller_of, parameters_model
from omnitrack_sim.control.interface import Controller
from omnitrack_sim.errors import Fault, GeometryError, InputError, NetworkError, ScenarioError
from omnitrack_sim.naming import name_of, named
from omnitrack_sim.network import Mission, Network, Planner, load_network
from omnitrack_sim.network import validate as validate_network
from omnitrack_sim.network.mission import NOSE_ROOM
from omnitrack_sim.pipes import Route, route
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.robot import Motor, Robot
from omnitrack_sim.rotations import Pose, frame_along
from omnitrack_sim.schema.fittings import by_kind, choices_of
from omnitrack_sim.schema.reading import (
    NAME_PATTERN,
    checked,
    fault_of,
    fields_at,
    read_toml,
    shipped_networks,
    shipped_scenarios,
)
from omnitrack_sim.schema.tables import (
    Contact,
    Control,
    Expect,
    Goal,
    MonitorTable,
    Physics,
    Pipe,
    RecordTable,
    Start,
    World,
)
from omnitrack_sim.sensing import Sensor
from omnitrack_sim.table import Table

_Thing = TypeVar("_Thing")
OPEN_TABLE = "control.parameters."
"""Below this path the controller decides which keys there are."""


class Scenario(Table):
    """One run: pipes or a mission through a network, robot, start, world, control. Keys: see
    docs/scenarios.md."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)] = "scenario"
    pipes: tuple[Annotated[SerializeAsAny[Pipe], WrapValidator(by_kind(Pipe))], ...] = ()
    network: Network | None = None
    mission: Mission | None = None
    start: Start = Start()
    world: World = World()
    contact: Contact = Contact()
    robot: Robot = Robot()
    control: Control = Control()
    physics: Physics = Physics()
    goal: Goal = Goal()
    monitor: MonitorTable = MonitorTable()
    record: RecordTable = RecordTable()
    expect: Expect = Expect()
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        faults = self._faults()
        if faults:
            raise ScenarioError(faults)
        return self

    def __eq__(self, other: object) -> bool:
        """By the keys alone, not by what has been derived from them so far."""
        if not isinstance(other, Scenario):
            return NotImplemented
        return all(getattr(self, key) == getattr(other, key) for key in Scenario.model_fields)

    @cached_property
    def planner(self) -> Planner | None:
        """Plans the legs of the mission; None without one."""
        if self.network is None or self.mission is None:
            return None
        return Planner(
            self.network, self.mission, self.robot, self.start.distance, self.control.arcs
        )

    @cached_property
    def route(self) -> Route:
        """The pipes joined, and the centreline through them; of a mission the way to its first
        goal."""
        planner = self.planner
        if planner is not None:
            return planner.route(planner.first)
        pose = Pose(frame_along(self.start.axis, math.radians(self.start.turn_deg)), np.zeros(3))
        return route([p.step(i) for i, p in enumerate(self.pipes)], pose, self.control.arcs)

    @property
    def controller_class(self) -> type[Controller]:
        """The class that ``control.kind`` names.

        Raises:
            InputError: there is no such class.
        """
        return controller_of(self.control.kind)

    @property
    def control_parameters(self) -> Any:
        """``[control.parameters]`` as the controller's own model, or an empty table."""
        return parameters_model(self.controller_class)(**self.control.parameters)

    @property
    def own_sensors(self) -> tuple[Sensor, ...]:
        """The sensors that ``record.sensors`` names.

        Raises:
            InputError: there is no such sensor.
        """
        return _of_kind("record.sensors", self.record.sensors, Sensor)

    @property
    def own_metrics(self) -> tuple[Metric, ...]:
        """The metrics that ``record.metrics`` names.

        Raises:
            InputError: there is no such metric.
        """
        return _of_kind("record.metrics", self.record.metrics, Metric)

    def driven_by(self, controller: type[Controller]) -> Scenario:
        """The same run under a controller class of a user's own, with its default parameters."""
        defaults = parameters_model(controller)().model_dump(mode="json")
        changes = {"kind": name_of(controller), "parameters": defaults}
        return self.model_copy(update={"control": self.control.model_copy(update=changes)})

    @property
    def goal_distance(self) -> float:
        """Arc length of the robot's centre at the goal, m."""
        if self.goal.distance is not None:
            return self.goal.distance
        if self.planner is not None:
            return self.planner.first.end
        return self.route.centreline.length - self.robot.length / 2 - NOSE_ROOM

    @property
    def plates(self) -> tuple[tuple[int, str], ...]:
        """Ports (part index, port) that a plate closes."""
        planner = self.planner
        return () if planner is None else planner.plates

    @property
    def time_limit_s(self) -> float:
        """Simulated seconds after which a run is over; of a mission its first leg, and each further
        one has its own."""
        if self.physics.time_limit is not None:
            return self.physics.time_limit
        return self.time_for(self.route.centreline.length)

    def time_for(self, length: float) -> float:
        """Simulated seconds that a way of ``length`` m may take: four times what cruising takes,
        and 20 s."""
        return 4 * length / self.control.cruise_speed + 20.0

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved scenario, hexadecimal."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    def _missing(self) -> list[Fault]:
        """Pipes and mission: one of them, and what goes with it."""
        if self.network is None and self.mission is None:
            return (
                []
                if self.pipes
                else [Fault("pipes", "is missing: a list of pipes, or give network and mission")]
            )
        faults = []
        if self.pipes:
            faults.append(Fault("pipes", "are given as well as a network; give one of them"))
        if self.network is None:
            faults.append(
                Fault(
                    "network",
                    "is missing: a file, a shipped network or a table",
                    tuple(shipped_networks()),
                )
            )
        if self.mission is None:
            faults.append(Fault("mission", "is missing: a table with start and goals"))
        for key, default in (("axis", Start().axis), ("turn_deg", Start().turn_deg)):
            if getattr(self.start, key) != default:
                faults.append(Fault(f"start.{key}", "is for pipes; a network has its own place"))
        if self.goal.distance is not None:
            faults.append(Fault("goal.distance", "is for pipes; a mission has goals"))
        return faults

    def _faults(self) -> list[Fault]:
        """What the tables cannot see alone: geometry, start and goal on the route, arms that fit
        the bore."""
        faults = [
            Fault(f"robot.{field}", f"is {value}; must be finite")
            for field, value in self.robot
            if isinstance(value, float) and not math.isfinite(value)
        ]
        names = []
        faults += self._missing()
        for i, pipe in enumerate(self.pipes):
            try:
                names.append(pipe.step(i).name)
            except GeometryError as error:
                faults += [
                    Fault(f"pipes.{i}.{f.where.rpartition('.')[2]}", f.problem, f.choices)
                    for f in error.faults
                ]
        if faults:
            return faults
        try:
            line = self.route
            planner = self.planner
            routes = [line] if planner is None else [planner.route(leg) for leg in planner.plan()]
        except GeometryError as error:
            return list(error.faults)
        except NetworkError as error:
            return [Fault(f"mission.{f.where}", f.problem, f.choices) for f in error.faults]
        faults = [
            Fault(f"pipes.{i}.name", f"{name!r} is taken by an earlier pipe")
            for i, name in enumerate(names)
            if name in names[:i]
        ]
        low, high = self.robot.slide_range
        where = "pipes" if self.pipes else "network.fittings"
        bores = [
            (p.index, fitting.bore_key(port), fitting.port_radius(port))
            for driven in routes
            for p in driven.fittings
            for fitting in [line.network.parts[p.index].fitting]
            for port in (p.enter, p.leave)
        ]
        for i, key, radius in bores:
            if not low < radius - self.robot.nominal_pipe_radius < high:
                reach = [2 * (self.robot.nominal_pipe_radius + s) for s in (low, high)]
                faults.append(
                    Fault(
                        f"{where}.{i}.{key}",
                        (
                            f"is {2 * radius:.4g} m; the arms reach bores from {reach[0]:.4g} to "
                            f"{reach[1]:.4g} m (robot.scale makes the robot for other bores)"
                        ),
                    )
                )
                break
        half, length = self.robot.length / 2, line.centreline.length
        distance = self.start.distance
        if not half <= distance <= length - half:
            faults.append(
                Fault(
                    "start.distance",
                    (
                        f"is {distance} m; the robot lies inside the pipe from {half:.4f} to "
                        f"{length - half:.4f} m"
                    ),
                )
            )
        elif self.goal.distance is not None and not distance < self.goal.distance <= length:
            faults.append(
                Fault(
                    "goal.distance",
                    (
                        f"is {self.goal.distance} m; must be over start.distance and at most "
                        f"{length:.4f} m"
                    ),
                )
            )
        return faults


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


def _of_kind(where: str, names: tuple[str, ...], kind: type[_Thing]) -> tuple[_Thing, ...]:
    """Objects by their names, each of which has to be a ``kind``."""
    found = []
    for i, name in enumerate(names):
        thing = named(name, f"{where}.{i}", {})
        if not isinstance(thing, kind):
            raise InputError(Fault(f"{where}.{i}", f"is {name!r}, which is no {kind.__name__}"))
        found.append(thing)
    return tuple(found)


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
        lambda item: fault_of(item, "pipes", (), lambda places: _choices_at(places, data)),
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


def _choices_at(places: list[str], data: Mapping[str, Any]) -> tuple[str, ...]:
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
