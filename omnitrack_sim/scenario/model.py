"""Scenario: the complete description of a run, checked as a whole."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import Field, SerializeAsAny, model_validator
from pydantic_core import to_json

from omnitrack_sim.autonomy.exploration import Exploration
from omnitrack_sim.autonomy.mission import Mission, MissionPlanner
from omnitrack_sim.autonomy.pilots import FixedRoute, Pilot, Planned
from omnitrack_sim.autonomy.sight import TrueSight
from omnitrack_sim.base.arguments import check_controller, refuse_taken
from omnitrack_sim.base.bounds import MAX_PARTS, MAX_PIECES, MAX_SAMPLES, MAX_STEPS, too_long
from omnitrack_sim.base.errors import (
    Fault,
    GeometryError,
    InputError,
    NetworkError,
    ScenarioError,
    gathered,
)
from omnitrack_sim.base.naming import NotTrustedError, name_of, named, shipped_files
from omnitrack_sim.base.reading import NAME_PATTERN, by_kind
from omnitrack_sim.base.rotations import Array, Pose, frame_along
from omnitrack_sim.base.table import Table, symbol_of
from omnitrack_sim.pipes import Arcs, Port, Route, route, route_through
from omnitrack_sim.pipes.fittings.kinds import known_fittings, table_of
from omnitrack_sim.pipes.network import Network
from omnitrack_sim.record.metrics import ESTIMATE_METRICS, Metric
from omnitrack_sim.robots.control import Controller, controller_of, parameters_model
from omnitrack_sim.robots.kinds import RECORDED, RobotOfKind, default_robot
from omnitrack_sim.robots.odometry import odometry_of
from omnitrack_sim.robots.robot import Robot, SceneOptions
from omnitrack_sim.robots.sensor import Sensor
from omnitrack_sim.robots.tail import TAIL_METRICS, TETHER_METRICS
from omnitrack_sim.scenario.tables import (
    ControlTable,
    MonitorTable,
    PhysicsTable,
    Pipe,
    PullTable,
    RecordTable,
    RunTable,
    StartTable,
    WorldTable,
    is_multiple,
)
from omnitrack_sim.senses.settings import SensingTable, camera_of

if TYPE_CHECKING:
    from mujoco import MjSpec

_Thing = TypeVar("_Thing")
ROUNDING = 1e-6
"""Part of a number of periods that may come from rounding."""


EXPLORED = 8.0
"""Ways of all its legs that a robot which explores drives, in lengths of the network, and with it
the time that it has."""


class Scenario(Table):
    """One run: pipes or a mission through a network, robot, start, world, control.

    Keys: see docs/reference/scenarios.md.

    Example:
        >>> scenario = ot.load_scenario("tee_turn")
        >>> scenario
        Scenario('tee_turn': 3 pipes, controller 'jacobian')
        >>> scenario.world.friction, scenario.run.expected_outcome.value
        (0.9, 'reached_goal')
    """

    name: Annotated[str, Field(pattern=NAME_PATTERN)] = "scenario"
    """Of the run, and of the folder that its results go to."""
    pipes: Annotated[
        tuple[
            Annotated[SerializeAsAny[Pipe], by_kind(partial(table_of, entry=Pipe))],
            ...,
        ],
        Field(max_length=MAX_PARTS),
    ] = ()
    """The pipes in the order of the route, each joined to the one before, the x axes of the ports
    together, then turned."""
    network: Network | None = None
    """Instead of `pipes`: a network, as a file, a shipped one's name or a table."""
    mission: Mission | None = None
    """Start, goals and task in the network."""
    start: StartTable = StartTable()
    world: WorldTable = WorldTable()
    pull: PullTable | None = None
    """A pull at the robot's tail, backward along the pipe."""
    robot: RobotOfKind = Field(default_factory=default_robot)
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
        """Return whether both have the same keys; values derived from them do not count."""
        if not isinstance(other, Scenario):
            return NotImplemented
        return all(getattr(self, key) == getattr(other, key) for key in Scenario.model_fields)

    @property
    def arcs(self) -> Arcs:
        """Radii of the centreline's arcs in tees, in proportion to the robot."""
        control = self.control
        radii = self.robot.own_length([control.tee_turn_radius, control.tee_merge_radius])
        return Arcs(*radii.tolist())

    @cached_property
    def planner(self) -> MissionPlanner | None:
        """Plans the legs of a mission with a known map; None without one."""
        if self.network is None or self.mission is None or self.mission.map == "unknown":
            return None
        return MissionPlanner(
            self.network, self.mission, self.robot, self.start.distance, self.arcs
        )

    @cached_property
    def exploration(self) -> Exploration | None:
        """The mission with an unknown map; None without one."""
        if self.network is None or self.mission is None or self.mission.map == "known":
            return None
        return Exploration(self.network, self.mission, self.robot, self.start.distance, self.arcs)

    @cached_property
    def route(self) -> Route:
        """The pipes joined, and the centreline through them.

        Of a mission it is the way to its first goal, or with an unknown map the straight in which
        the robot begins.
        """
        planner, exploration = self.planner, self.exploration
        if exploration is not None:
            pipes = exploration.network.pipes
            return route_through(pipes, exploration.path, self.arcs)
        if planner is not None:
            return planner.route(planner.first.path)
        pose = Pose(frame_along(self.start.axis, math.radians(self.start.turn_deg)), np.zeros(3))
        return route([p.step(i) for i, p in enumerate(self.pipes)], pose, self.arcs)

    def to_spec(self, *, looks: bool = False) -> MjSpec:
        """Return the pipes and the robot as one MuJoCo model, ready to compile.

        Args:
            looks: with what pictures need besides: visual geoms, cameras and lights.

        Example:
            >>> model = ot.load_scenario("tee_turn").to_spec().compile()
            >>> model.body("chassis").name
            'chassis'
        """
        physics = self.physics
        options = SceneOptions(
            plates=self.plates,
            timestep=physics.timestep,
            wall_tolerance=physics.wall_tolerance,
            staves=physics.staves,
            # An exact wall is a height field without shape, which a renderer cannot draw.
            exact=physics.collider == "exact" and not looks,
            looks=looks,
        )
        return self.robot.scene(self.route.network, options)

    @cached_property
    def bores(self) -> dict[Port, float]:
        """Bore radius, m, at each port that the robot passes, in order.

        With an unknown map it is that of each port that it may come to.
        """
        line, parts = self.route, self.route.network.parts
        legs = () if self.planner is None else self.planner.plan()
        ports = [(p.index, port) for p in line.passages for port in (p.enter, p.leave)]
        ports += [(i, port) for leg in legs for i, *both in leg.path for port in both]
        if self.exploration is not None:
            ports += [(i, port) for i, part in enumerate(parts) for port in part.fitting.port_names]
        return {(i, port): parts[i].fitting.port_radius(port) for i, port in ports}

    def pilot(self, robot: int) -> Pilot:
        """Return a pilot for the run, of robot number ``robot`` of its batch."""
        if self.exploration is not None:
            return self.exploration.explorer(robot, self.monitor.falls)
        if self.planner is not None:
            return Planned(self.planner, robot, self.monitor.falls)
        return FixedRoute(self.route, self.start.distance, self.goal_distance)

    # What is true of a run, by which it is judged

    @cached_property
    def sight(self) -> TrueSight:
        """Sight of the true pipes without error."""
        return TrueSight(self.route.network, self.plates, self.robot, self.arcs)

    def goal_at(self, nose: Array) -> str:
        """Return the goal of an exploration at a nose (3,) m, world frame; "" at none."""
        return "" if self.exploration is None else self.exploration.goal_at(nose)

    def is_done_at(self, position: Array, axis: Array, error: float) -> bool:
        """Return whether a robot that takes itself to be at its last goal is there.

        Args:
            position: (3,) m, of its centre, world frame.
            axis: (3,) unit vector to its nose, world frame.
            error: m, of the arc length that it takes itself to be at.
        """
        if self.exploration is None:
            return abs(error) <= self.robot.nominal_bore / 2
        # Goals that were searched for have been counted where the robot truly was.
        return self.exploration.mission.task == "find" or self.exploration.is_home(position, axis)

    def map_metrics(self, map: Network | None) -> dict[str, float]:
        """Return the differences of a robot's map from the part of the network it could reach."""
        if map is None or self.exploration is None:
            return {}
        return self.exploration.difference(map).figures()

    @property
    def controller_class(self) -> type[Controller]:
        """The class that ``control.kind`` names.

        Raises:
            InputError: there is no such class.
        """
        return controller_of(self.control.kind, self.robot.controllers())

    @property
    def control_parameters(self) -> Any:
        """``[control.parameters]`` as the controller's own model, or an empty table."""
        return parameters_model(self.controller_class)(**self.control.parameters)

    @property
    def own_sensors(self) -> tuple[Sensor, ...]:
        """Sensors that ``record.sensors`` names.

        Raises:
            InputError: there is no such sensor.
        """
        sensors = _of_kind("record.sensors", self.record.sensors, Sensor)
        names = [sensor.channel.name for sensor in sensors]
        refuse_taken("record.sensors", names, self.robot.channels)
        return sensors

    @property
    def is_pulled(self) -> bool:
        """Return whether something pulls at the robot's tail."""
        return self.pull is not None or self.robot.tether is not None

    @property
    def named_metrics(self) -> tuple[Metric, ...]:
        """Metrics of the user's own, that ``record.metrics`` names.

        Raises:
            InputError: there is no such metric.
        """
        return _of_kind("record.metrics", self.record.metrics, Metric)

    @property
    def own_metrics(self) -> tuple[Metric, ...]:
        """Metrics that ``record.metrics`` names, those of a pull at the tail, and of the estimate.

        Those of the estimate are there with onboard sensors.

        Raises:
            InputError: there is no such metric.
        """
        metrics = self.named_metrics
        shipped = (*self.robot.metrics, *ESTIMATE_METRICS, *TAIL_METRICS, *TETHER_METRICS)
        taken = {metric.name for metric in shipped}
        refuse_taken("record.metrics", [metric.name for metric in metrics], taken)
        of_tail = TAIL_METRICS if self.is_pulled else ()
        of_tail += TETHER_METRICS if self.robot.tether else ()
        return (*metrics, *of_tail, *(ESTIMATE_METRICS if self.sensing.kind == "onboard" else ()))

    @property
    def all_metrics(self) -> tuple[Metric, ...]:
        """Metrics of the run: those of every run of the robot, then ``own_metrics``."""
        return (*self.robot.metrics, *self.own_metrics)

    def driven_by(self, controller: type[Controller]) -> Scenario:
        """Return the same run under a user's own controller class.

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
        # By name, so that the scenario can be saved and sent to other processes.
        changes = {"kind": name_of(controller), "parameters": defaults}
        return self.model_copy(update={"control": self.control.model_copy(update=changes)})

    @property
    def goal_distance(self) -> float:
        """Arc length of the robot's centre at the goal, m."""
        if self.run.goal_distance is not None:
            return self.run.goal_distance
        if self.planner is not None:
            return self.planner.first.end
        return self.route.centreline.length - self.robot.length / 2 - self.robot.nose_room

    @property
    def plates(self) -> tuple[Port, ...]:
        """Ports (part index, port) that a plate or cap closes."""
        mission = self.planner or self.exploration
        return self.route.network.closed_ends if mission is None else mission.plates

    @property
    def time_limit_s(self) -> float:
        """Simulated seconds after which a run is over.

        Of a mission they are those of its first leg; each further one has its own.
        """
        if self.run.time_limit is not None:
            return self.run.time_limit
        return self.time_for(self.route.centreline.length)

    def time_for(self, length: float) -> float:
        """Simulated seconds that a way of ``length`` m may take: four times cruising, and 20 s.

        It is longer by as much as the drive slows the robot down in the sharpest bend.
        """
        # Room for rolls, retries and slow turns; the constant serves short routes.
        wanted = self.control.cruise_speed
        return (4 * length / wanted + 20.0) * (wanted / self.min_cruise_speed)

    @cached_property
    def sharpest_bend(self) -> float:
        """Largest radius of a bore over that of a bend on the route, or in a mission's network."""
        if self.mission is None:
            bends = (p.radius / p.bend_radius for p in self.route.passages if p.is_turn)
        else:
            parts = self.route.network.parts
            bends = (part.fitting.sharpest_bend(self.arcs) for part in parts)
        return max(bends, default=0.0)

    @property
    def min_cruise_speed(self) -> float:
        """Cruise speed in the sharpest bend, m/s: the motors hold that of the outer side."""
        return min(self.control.cruise_speed, self.robot.top_speed / (1 + self.sharpest_bend))

    @property
    def hash(self) -> str:
        """SHA-256 of the resolved scenario, hexadecimal."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()


def sha256_of(data: Mapping[str, Any]) -> str:
    """Return ``Scenario.hash`` of the plain data of a resolved scenario, as its file has them."""
    return hashlib.sha256(to_json(data)).hexdigest()


def unit_of(path: str, robots: Iterable[Robot] = ()) -> str | None:
    """Return the unit of the value at a dotted path of a scenario; None where it has none.

    Args:
        path: such as "world.gravity.2".
        robots: of the scenarios that have the value; the first one that knows it says the unit of
            a value of a robot.
    """
    table, *keys = path.split(".")
    if path.endswith("_deg"):
        return "deg"
    if table == "robot":
        units = (robot.unit_at(".".join(keys)) for robot in robots)
        return next((unit for unit in units if unit is not None), None) or None
    if table == "pipes":
        kinds: list[Any] = [fitting.Table for fitting in known_fittings().values()]
        keys = keys[-1:]
    else:
        # An item of a vector has the vector's unit.
        info, keys = Scenario.model_fields.get(table), keys[:1]
        kinds = [] if info is None else [info.annotation]
    tables = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Table)]
    return next(
        (symbol for kind in tables for key in keys if (symbol := symbol_of(kind, key))), None
    )


def words_of(path: str) -> str:
    """Return the value at a dotted path of a scenario in words, without its unit."""
    table, *keys = path.removesuffix("_deg").split(".")
    if table == "start" and keys:
        keys.append("at the start")
    elif table not in _PLAIN_TABLES or keys[-1:] in ([], ["kind"]):
        keys.insert(0, table)
    return " ".join(keys).replace("_", " ")


_PLAIN_TABLES = ("world", "robot", "control")
"""Tables whose keys say by themselves what they are, but for their kinds."""


def _of_kind(where: str, names: tuple[str, ...], kind: type[_Thing]) -> tuple[_Thing, ...]:
    """Objects by their names, each of which has to be a ``kind``."""
    objects = []
    for i, name in enumerate(names):
        thing = named(name, f"{where}.{i}", {})
        if not isinstance(thing, kind):
            raise InputError(Fault(f"{where}.{i}", f"is {name!r}, which is no {kind.__name__}"))
        objects.append(thing)
    return tuple(objects)


def faults_of(scenario: Scenario) -> list[Fault]:
    """Return the faults that concern several tables: geometry, start and goal, work."""
    faults = [*_missing(scenario)]
    for i, pipe in enumerate(scenario.pipes):
        with gathered(faults, lambda fault, i=i: f"pipes.{i}.{fault.where.partition('.')[2]}"):
            pipe.step(i)
    with gathered(faults):
        scenario.robot.check()
    faults += _meaningless(scenario)
    if scenario.sensing.kind == "onboard" and scenario.robot.kind != RECORDED:
        with gathered(faults):
            odometry_of(scenario.robot)
    # What follows lays out pipes and plans, which needs tables that are valid by themselves.
    period, step = scenario.record.period, scenario.physics.control_period
    if not is_multiple(period, step):
        problem = f"is {period} s, not a whole multiple of physics.control_period ({step} s)"
        faults.append(Fault("record.period", problem))
    faults += _impossible_cameras(scenario)
    if scenario.record.pictures and scenario.sensing.kind != "onboard":
        problem = 'is true, for which the robot needs cameras: sensing.kind = "onboard"'
        faults.append(Fault("record.pictures", problem))
    if not faults and scenario.pipes:
        lengths = (pipe.step(i).fitting.length_of_axes for i, pipe in enumerate(scenario.pipes))
        faults += too_long(sum(lengths), "pipes")
    if scenario.network is not None:
        faults += _too_large(scenario.network)
    if faults:
        return faults
    try:
        bores = scenario.bores
    except GeometryError as error:
        return list(error.faults)
    except NetworkError as error:
        return [fault.at(f"mission.{fault.where}") for fault in error.faults]
    return [
        *_taken_names(scenario),
        *_bores_out_of_reach(scenario, bores),
        *_misplaced(scenario),
        *too_much_work(scenario),
    ]


def _taken_names(scenario: Scenario) -> list[Fault]:
    """Names of pipes that an earlier pipe has."""
    names = [part.name for part in scenario.route.network.parts] if scenario.pipes else []
    return [
        Fault(f"pipes.{i}.name", f"{name!r} is taken by an earlier pipe")
        for i, name in enumerate(names)
        if name in names[:i]
    ]


def _too_large(network: Network) -> list[Fault]:
    """Return the faults of a town that is simulated as a whole."""
    count, hint = len(network.fittings), "simulate a part of it (Network.around)"
    if count > MAX_PARTS:
        return [Fault("network.fittings", f"are {count}; at most {MAX_PARTS} items: {hint}")]
    return too_long(network.length, "network.fittings")


def _missing(scenario: Scenario) -> Iterator[Fault]:
    """Pipes and mission: one of them, and what goes with it."""
    if scenario.network is None and scenario.mission is None:
        if not scenario.pipes:
            yield Fault("pipes", "is missing: a list of pipes, or give network and mission")
        return
    if scenario.pipes:
        other = "mission" if scenario.network is None else "network"
        yield Fault("pipes", f"are given as well as a {other}; give one of them")
        return
    if scenario.network is None:
        problem = "is missing: a file, a shipped network or a table"
        yield Fault("network", problem, tuple(shipped_files("networks")))
    if scenario.mission is None:
        yield Fault("mission", "is missing: a table with start and goals")
    for key in ("axis", "turn_deg"):
        if getattr(scenario.start, key) != getattr(StartTable(), key):
            yield Fault(f"start.{key}", "is for pipes; a network has its own place")
    if scenario.run.goal_distance is not None:
        yield Fault("run.goal_distance", "is for pipes; a mission has goals")


def _meaningless(scenario: Scenario) -> Iterator[Fault]:
    """Keys that mean nothing to the robot of the scenario."""
    robot, collider, roll = scenario.robot, scenario.physics.collider, scenario.start.roll_deg
    problem = f"which means nothing to a robot of kind {robot.kind!r}; leave it at"
    if collider not in robot.colliders:
        default = robot.colliders[0]
        yield Fault("physics.collider", f"is {collider!r}, {problem} {default!r}")
    if roll and not robot.rolls:
        yield Fault("start.roll_deg", f"is {roll!r}, {problem} 0.0")


def _impossible_cameras(scenario: Scenario) -> Iterator[Fault]:
    """A camera that there is not, or whose pictures fall between two control steps."""
    table, period = scenario.sensing, scenario.physics.control_period
    if table.kind != "onboard":
        return
    try:
        optics = camera_of(table).optics
    except NotTrustedError:
        return  # of a run that is only looked at
    except InputError as error:
        yield from error.faults
        return
    for key, steps in (("rate", 1 / (optics.rate * period)), ("latency", optics.latency / period)):
        if abs(steps - round(steps)) > ROUNDING * max(1.0, steps) or (key == "rate" and steps < 1):
            rule = f"is {getattr(optics, key):g}; it has to be a whole number of control periods"
            rates = tuple(f"{1 / (n * period):g}" for n in (1, 2, 4, 5, 10, 20))
            problem = f"{rule} (physics.control_period, {period:g} s)"
            choices = rates if key == "rate" else ()
            yield Fault(f"sensing.{table.camera}.{key}", problem, choices)


def _bores_out_of_reach(scenario: Scenario, bores: Mapping[Port, float]) -> Iterator[Fault]:
    """The first bore that the robot does not fit."""
    for (index, port), radius in bores.items():
        misfit = scenario.robot.misfit(2 * radius)
        if misfit:
            fitting = scenario.route.network.parts[index].fitting
            where = "pipes" if scenario.pipes else "network.fittings"
            problem = f"is {2 * radius:.4g} m; {misfit}"
            yield Fault(f"{where}.{index}.{fitting.bore_key(port)}", problem)
            return


def _misplaced(scenario: Scenario) -> Iterator[Fault]:
    """A start or goal that is not on the route."""
    half, length = scenario.robot.length / 2, scenario.route.centreline.length
    distance, goal = scenario.start.distance, scenario.run.goal_distance
    if length < 2 * half:
        problem = f"the robot is {2 * half:.4g} m long, and its way through them {length:.4g} m"
        yield Fault("pipes" if scenario.pipes else "network.fittings", problem)
    elif not half <= distance <= length - half:
        inside = f"the robot lies inside the pipe from {half:.4f} to {length - half:.4f} m"
        yield Fault("start.distance", f"is {distance} m; {inside}")
    elif goal is not None and not distance < goal <= length:
        problem = f"is {goal} m; must be over start.distance and at most {length:.4f} m"
        yield Fault("run.goal_distance", problem)


def samples_of(scenario: Scenario) -> int:
    """Most samples that a run records, up to its time limit."""
    return math.ceil(max_seconds(scenario) / scenario.record.period)


def max_seconds(scenario: Scenario) -> float:
    """Simulated time limit of a run, s; of a mission that of all its legs if none is blocked."""
    planner, exploration = scenario.planner, scenario.exploration
    if exploration is not None:
        return scenario.time_limit_s + scenario.time_for(EXPLORED * exploration.network.length)
    # The first leg is that of `time_limit_s`; each further one brings a limit of its own.
    more = [] if planner is None else planner.plan()[1:]
    lengths = [] if planner is None else [planner.route(leg.path).length for leg in more]
    return scenario.time_limit_s + sum(scenario.time_for(length) for length in lengths)


def min_seconds(scenario: Scenario) -> float:
    """Simulated time of a run, s, if the robot cruises to its goal; to its time limit at most."""
    planner, exploration = scenario.planner, scenario.exploration
    if exploration is not None:
        way = 2 * exploration.network.length  # there and back
    elif planner is not None:
        way = sum(leg.end - leg.begin for leg in planner.plan())
    else:
        way = scenario.goal_distance - scenario.start.distance
    return min(way / scenario.control.cruise_speed, max_seconds(scenario))


def too_much_work(scenario: Scenario) -> Iterator[Fault]:
    """Figures of a scenario that go beyond the bounds, at the key that is to be changed."""
    physics, seconds = scenario.physics, max_seconds(scenario)
    where = _unusual(scenario)
    work = f"makes {{:.4g}} {{}} in a time limit of {seconds:.4g} s{_origin(scenario, where)}"
    steps = seconds / physics.timestep
    if steps > MAX_STEPS:
        problem = work.format(steps, "time steps")
        yield Fault(where, f"{problem}; at most {MAX_STEPS:,}")
    elif (samples := samples_of(scenario)) > MAX_SAMPLES:
        problem = work.format(samples, "samples")
        yield Fault("record.period", f"{problem}; at most {MAX_SAMPLES:,}")
    yield from _too_many_pieces(scenario)


def _too_many_pieces(scenario: Scenario) -> Iterator[Fault]:
    """Fault of walls of primitives with too many pieces."""
    physics = scenario.physics
    if physics.collider != "primitives":
        return
    parts = scenario.route.network.parts
    pieces = sum(part.fitting.piece_count(physics.wall_tolerance, physics.staves) for part in parts)
    if pieces > MAX_PIECES:
        problem = f"makes walls of about {pieces:,} pieces; at most {MAX_PIECES:,}"
        yield Fault(
            _finest(scenario), f'{problem} (physics.collider = "exact" makes one a fitting)'
        )


def _finest(scenario: Scenario) -> str:
    """Key that makes the walls fine, or that of the pipes."""
    if scenario.physics.staves is not None:
        return "physics.staves"
    if scenario.physics.wall_tolerance < PhysicsTable().wall_tolerance:
        return "physics.wall_tolerance"
    return "pipes" if scenario.pipes else "network.fittings"


def _origin(scenario: Scenario, where: str) -> str:
    """Origin of the time limit in words; empty where it is the key ``where`` itself."""
    if scenario.run.time_limit is not None:
        return "" if where == "run.time_limit" else " (run.time_limit)"
    return f" at a cruise speed of {scenario.control.cruise_speed:.4g} m/s"


def _unusual(scenario: Scenario) -> str:
    """Key that is farthest from its default among those that determine the number of time steps."""
    slow = ControlTable().cruise_speed / scenario.control.cruise_speed
    fine = PhysicsTable().timestep / scenario.physics.timestep
    # Only a value ten times off its default is the likely mistake; else the pipes are too long.
    if fine >= 10 and fine >= slow:
        return "physics.timestep"
    if scenario.run.time_limit is not None:
        return "run.time_limit"
    if slow >= 10:
        return "control.cruise_speed"
    return "pipes" if scenario.pipes else "mission.goals"
