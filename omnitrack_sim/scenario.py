"""Scenario files: what a user writes, validated as a whole before anything runs."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BaseModel, Field, model_validator

from omnitrack_sim.errors import Fault, GeometryError, ScenarioError
from omnitrack_sim.files import NAME_PATTERN, checked, fault_of, read_toml, shipped_scenarios
from omnitrack_sim.frames import Pose, frame_along
from omnitrack_sim.pipes import Route, route
from omnitrack_sim.robot import Robot
from omnitrack_sim.tables import (
    Contact,
    Control,
    ElbowPipe,
    Expect,
    Goal,
    Physics,
    Pipe,
    ReducerPipe,
    Start,
    StraightPipe,
    Table,
    TeePipe,
    World,
)

NOSE_ROOM = 0.005
"""Room between the robot's nose and the end of the route at the goal, m."""
PER_TRIAL_ROBOT_FIELDS = {"preload", "torque_limit", "roll_torque"}
"""Robot fields that may differ between the trials of one batch: they are floats of the compiled model."""
_PIPES: dict[str, type[BaseModel]] = {
    "straight": StraightPipe,
    "reducer": ReducerPipe,
    "elbow": ElbowPipe,
    "tee": TeePipe,
}


class Scenario(Table):
    """One run: pipes, robot, start, world, control. Keys and units: see docs/scenarios.md."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)] = "scenario"
    pipes: Annotated[tuple[Pipe, ...], Field(min_length=1)]
    start: Start = Start()
    world: World = World()
    contact: Contact = Contact()
    robot: Robot = Robot()
    control: Control = Control()
    physics: Physics = Physics()
    goal: Goal = Goal()
    expect: Expect = Expect()
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        faults = self._faults()
        if faults:
            raise ScenarioError(faults)
        return self

    def route(self) -> Route:
        """The pipes joined, and the centreline through them."""
        pose = Pose(frame_along(self.start.axis, math.radians(self.start.turn_deg)), np.zeros(3))
        return route([p.step(i) for i, p in enumerate(self.pipes)], pose, self.control.arcs)

    @property
    def goal_distance(self) -> float:
        """Arc length of the robot's centre at the goal, m."""
        if self.goal.distance is not None:
            return self.goal.distance
        return self.route().centreline.length - self.robot.length / 2 - NOSE_ROOM

    @property
    def time_limit_s(self) -> float:
        """Simulated seconds after which a run is over."""
        if self.physics.time_limit is not None:
            return self.physics.time_limit
        return 4 * self.route().centreline.length / self.control.cruise_speed + 20.0

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved scenario, hexadecimal."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    def _faults(self) -> list[Fault]:
        """What the tables cannot see alone: geometry, start and goal on the route, arms that fit the bore."""
        faults = [
            Fault(f"robot.{field}", f"is {value}; must be finite")
            for field, value in self.robot
            if isinstance(value, float) and not math.isfinite(value)
        ]
        names = []
        for i, pipe in enumerate(self.pipes):
            try:
                names.append(pipe.step(i).name)
            except GeometryError as error:
                faults += [Fault(f"pipes.{i}.{f.where.rpartition('.')[2]}", f.problem, f.choices) for f in error.faults]
        if faults:
            return faults
        try:
            line = self.route()
        except GeometryError as error:
            return list(error.faults)
        faults = [
            Fault(f"pipes.{i}.name", f"{name!r} is taken by an earlier pipe")
            for i, name in enumerate(names)
            if name in names[:i]
        ]
        low, high = self.robot.slide_range
        for i, passage in enumerate(line.fittings):
            slide = passage.radius - self.robot.nominal_pipe_radius
            if not low < slide < high:
                reach = [2 * (self.robot.nominal_pipe_radius + s) for s in (low, high)]
                faults.append(
                    Fault(
                        f"pipes.{i}.inner_diameter",
                        f"is {2 * passage.radius:.4g} m; the arms reach bores from {reach[0]:.4g} to {reach[1]:.4g} m",
                    )
                )
                break
        half, length = self.robot.length / 2, line.centreline.length
        distance = self.start.distance
        if not half <= distance <= length - half:
            faults.append(
                Fault(
                    "start.distance",
                    f"is {distance} m; the robot lies inside the pipe from {half:.4f} to {length - half:.4f} m",
                )
            )
        elif self.goal.distance is not None and not distance < self.goal.distance <= length:
            faults.append(
                Fault(
                    "goal.distance",
                    f"is {self.goal.distance} m; must be over start.distance and at most {length:.4f} m",
                )
            )
        return faults


def model_key(data: Mapping[str, Any]) -> str:
    """What the compiled model depends on, of a scenario as plain data with every key."""
    physics = [data["physics"][key] for key in ("timestep", "collider", "wall_tolerance", "staves")]
    start = [data["start"][key] for key in ("axis", "turn_deg")]
    robot = {key: value for key, value in data["robot"].items() if key not in PER_TRIAL_ROBOT_FIELDS}
    return json.dumps([data["pipes"], start, robot, physics], sort_keys=True)


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario file, or a shipped scenario by name.

    Raises:
        ScenarioError: no such file, bad TOML, or any fault in it; every fault is listed with its path in the file.
    """
    path, data = read_toml(source, "scenario", shipped_scenarios(), ScenarioError)
    return validate({"name": path.stem} | data)


def validate(data: Mapping[str, Any]) -> Scenario:
    """A scenario from plain data, as read from TOML or JSON.

    Raises:
        ScenarioError: lists every fault with its dotted path.
    """
    return checked(
        Scenario, data, "pipes", lambda item: fault_of(item, "pipes", tuple(_PIPES), _choices_at), ScenarioError
    )


def override(scenario: Scenario, changes: Mapping[str, Any]) -> Scenario:
    """A copy with values changed by dotted path, such as ``{"control.cruise_speed": 0.12, "pipes.0.length": 1.0}``.

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
    place = data
    for depth, key in enumerate(keys, start=1):
        if isinstance(place, list):
            entries: dict[str, Any] = {str(i): i for i in range(len(place))}
        else:
            entries = {name: name for name in place} if isinstance(place, dict) else {}
        if key not in entries:
            problem = f"there is no {key!r} here" if entries else f"{key!r} is below a plain value"
            return Fault(path, problem, tuple(entries))
        if depth == len(keys):
            place[entries[key]] = value
        else:
            place = place[entries[key]]
    return None


def _choices_at(places: list[str]) -> tuple[str, ...]:
    """Valid keys of the table at a pydantic path."""
    tables: dict[str, type[BaseModel]] = {
        name: info.annotation
        for name, info in Scenario.model_fields.items()
        if isinstance(info.annotation, type) and issubclass(info.annotation, BaseModel)
    }
    if not places:
        return tuple(Scenario.model_fields)
    if places[0] == "pipes" and len(places) > 2:
        return tuple(_PIPES[places[2]].model_fields)
    return tuple(tables[places[0]].model_fields) if places[0] in tables else ()
