"""A scenario: what a run is made from, checked as a whole."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection
from functools import cached_property
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import Field, SerializeAsAny, WrapValidator, model_validator

from omnitrack_sim.autonomy.exploration import Exploration
from omnitrack_sim.autonomy.goals import Mission
from omnitrack_sim.autonomy.mission import Planner
from omnitrack_sim.autonomy.ways import NOSE_ROOM
from omnitrack_sim.base.arguments import check_controller
from omnitrack_sim.base.bounds import MOST_PARTS
from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.base.naming import name_of, named
from omnitrack_sim.base.reading import NAME_PATTERN
from omnitrack_sim.base.rotations import Pose, frame_along
from omnitrack_sim.base.table import Table
from omnitrack_sim.pipes import Route, route, route_through
from omnitrack_sim.pipes.entries import by_kind
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.record.channels import CHANNELS
from omnitrack_sim.record.estimates import ESTIMATE_METRICS
from omnitrack_sim.record.metrics import METRICS, Metric
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.robots.omnitrack.control.catalogue import controller_of, parameters_model
from omnitrack_sim.robots.omnitrack.control.interface import Controller
from omnitrack_sim.scenario.checks import faults_of
from omnitrack_sim.scenario.tables import (
    ControlTable,
    MonitorTable,
    PhysicsTable,
    Pipe,
    RecordTable,
    RunTable,
    StartTable,
    WorldTable,
)
from omnitrack_sim.senses import Sensor
from omnitrack_sim.senses.table import SensingTable

_Thing = TypeVar("_Thing")
METRIC_NAMES = {metric.name for metric in (*METRICS, *ESTIMATE_METRICS)}


class Scenario(Table):
    """One run: pipes or a mission through a network, robot, start, world, control. Keys: see
    docs/reference/scenarios.md."""

    name: Annotated[str, Field(pattern=NAME_PATTERN)] = "scenario"
    """Of the run, and of the folder that its results go to."""
    pipes: Annotated[
        tuple[Annotated[SerializeAsAny[Pipe], WrapValidator(by_kind(Pipe))], ...],
        Field(max_length=MOST_PARTS),
    ] = ()
    """The pipes in the order of the route, each joined to the one before, the x axes of the ports
    together, then turned."""
    network: Network | None = None
    """Instead of `pipes`: a network, as a file, a shipped one's name or a table."""
    mission: Mission | None = None
    """Where to go in the network."""
    start: StartTable = StartTable()
    world: WorldTable = WorldTable()
    robot: Robot = Robot()
    control: ControlTable = ControlTable()
    sensing: SensingTable = SensingTable()
    physics: PhysicsTable = PhysicsTable()
    run: RunTable = RunTable()
    monitor: MonitorTable = MonitorTable()
    record: RecordTable = RecordTable()
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Of the noise of onboard sensors; a run without them draws no random number."""

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        faults = faults_of(self)
        if faults:
            raise ScenarioError(faults)
        return self

    def __repr__(self) -> str:
        if self.network is None or self.mission is None:
            where = f"{len(self.pipes)} pipes"
        elif self.mission.task == "explore":
            where = f"explores {self.network!r}"
        else:
            where = f"{len(self.mission.goals)} goals in {self.network!r}"
        return f"Scenario({self.name!r}: {where}, controller {self.control.kind!r})"

    __str__ = __repr__

    def __eq__(self, other: object) -> bool:
        """By the keys alone, not by what has been derived from them so far."""
        if not isinstance(other, Scenario):
            return NotImplemented
        return all(getattr(self, key) == getattr(other, key) for key in Scenario.model_fields)

    @cached_property
    def planner(self) -> Planner | None:
        """Plans the legs of a mission with a known map; None without one."""
        if self.network is None or self.mission is None or self.mission.map == "unknown":
            return None
        return Planner(
            self.network, self.mission, self.robot, self.start.distance, self.control.arcs
        )

    @cached_property
    def exploration(self) -> Exploration | None:
        """The mission with an unknown map; None without one."""
        if self.network is None or self.mission is None or self.mission.map == "known":
            return None
        return Exploration(
            self.network, self.mission, self.robot, self.start.distance, self.control.arcs
        )

    @cached_property
    def route(self) -> Route:
        """The pipes joined, and the centreline through them; of a mission the way to its first
        goal, or with an unknown map the straight in which the robot begins."""
        planner, exploration = self.planner, self.exploration
        if exploration is not None:
            pipes = exploration.network.pipes
            return route_through(pipes, exploration.way, self.control.arcs)
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
        found = _of_kind("record.sensors", self.record.sensors, Sensor)
        refuse_taken("record.sensors", [sensor.channel.name for sensor in found], CHANNELS)
        return found

    @property
    def own_metrics(self) -> tuple[Metric, ...]:
        """The metrics that ``record.metrics`` names, and those of the estimate where the robot
        drives by its own sensors.

        Raises:
            InputError: there is no such metric.
        """
        found = _of_kind("record.metrics", self.record.metrics, Metric)
        refuse_taken("record.metrics", [metric.name for metric in found], METRIC_NAMES)
        return (*found, *(ESTIMATE_METRICS if self.sensing.kind == "onboard" else ()))

    def driven_by(self, controller: type[Controller]) -> Scenario:
        """The same run under a controller class of a user's own.

        Where ``control.kind`` names that class already, its parameters stay; otherwise they are the
        class's defaults.

        Raises:
            TypeError: it is no class of a controller.
        """
        check_controller(controller)
        try:
            if self.controller_class is controller:
                return self
        except InputError:
            pass  # the name leads nowhere here; the class has been handed over instead
        defaults = parameters_model(controller)().model_dump(mode="json")
        changes = {"kind": name_of(controller), "parameters": defaults}
        return self.model_copy(update={"control": self.control.model_copy(update=changes)})

    @property
    def goal_distance(self) -> float:
        """Arc length of the robot's centre at the goal, m."""
        if self.run.goal_distance is not None:
            return self.run.goal_distance
        if self.planner is not None:
            return self.planner.first.end
        return self.route.centreline.length - self.robot.length / 2 - NOSE_ROOM

    @property
    def plates(self) -> tuple[tuple[int, str], ...]:
        """Ports (part index, port) that a plate closes."""
        mission = self.planner or self.exploration
        return () if mission is None else mission.plates

    @property
    def time_limit_s(self) -> float:
        """Simulated seconds after which a run is over; of a mission its first leg, and each further
        one has its own."""
        if self.run.time_limit is not None:
            return self.run.time_limit
        return self.time_for(self.route.centreline.length)

    def time_for(self, length: float) -> float:
        """Simulated seconds that a way of ``length`` m may take: four times what cruising takes,
        and 20 s."""
        return 4 * length / self.control.cruise_speed + 20.0

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved scenario, hexadecimal."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()


def refuse_taken(where: str, names: list[str], shipped: Collection[str]) -> None:
    """Refuse names that something else has already."""
    for i, name in enumerate(names):
        if name in shipped or name in names[:i]:
            raise InputError(Fault(f"{where}.{i}", f"{name!r} is taken; give it another name"))


def _of_kind(where: str, names: tuple[str, ...], kind: type[_Thing]) -> tuple[_Thing, ...]:
    """Objects by their names, each of which has to be a ``kind``."""
    found = []
    for i, name in enumerate(names):
        thing = named(name, f"{where}.{i}", {})
        if not isinstance(thing, kind):
            raise InputError(Fault(f"{where}.{i}", f"is {name!r}, which is no {kind.__name__}"))
        found.append(thing)
    return tuple(found)
