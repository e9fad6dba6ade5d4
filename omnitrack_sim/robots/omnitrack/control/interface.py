"""Interface of controllers of n robots: setup, observation, command; shipped ones by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import named
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import did_you_mean, shown
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Event
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.robots.omnitrack.drive import Drive, drive_of


class Observation:
    """Measurements of n robots at one moment.

    Every observed channel of the schema (docs/reference/channels.md) is an attribute:
    ``observation.roll`` is an array (n, 3) in rad. In reverse gear all is mirrored, as if the robot
    drove nose first.

    Attributes:
        location: where the robots are along their routes.
        leg: (n,) number of the leg that each robot drives. It changes when a robot is sent on.
        gear: (n,) 1 nose first, -1 tail first.

    Example:
        >>> import omnitrack_sim as ot
        >>> observation = ot.Simulation([ot.load_scenario("straight")]).observation
        >>> observation.roll.shape
        (1, 3)
        >>> observation.location.distance  # m along the route
        array([0.1])
    """

    location: Location
    leg: NDArray[np.int_]
    gear: NDArray[np.int_]

    def __init__(
        self,
        readings: Mapping[str, Array],
        location: Location,
        leg: NDArray[np.int_],
        gear: NDArray[np.int_],
    ) -> None:
        self._readings = readings
        self.location, self.leg, self.gear = location, leg, gear

    def __getattr__(self, name: str) -> Array:
        try:
            # Kept as an attribute: Python comes here only where there is none yet.
            value = self.__dict__[name] = self.__dict__["_readings"][name]
        except KeyError:
            known = list(self.__dict__.get("_readings", ()))
            near = did_you_mean(name, known)
            message = f"no channel {name!r} is observed{near} (choose from: {', '.join(known)})"
            raise AttributeError(message) from None
        return value

    def __repr__(self) -> str:
        return f"Observation({len(self.leg)} robots, {len(self._readings)} channels)"


_COLUMNS = {"belt_speed": (3,), "roll": (3,), "phase": (), "resting": (), "brake": (3,), "over": ()}
"""Shapes of the arrays of a command, of one robot."""


class Command(NamedTuple):
    """Commands to n robots until the next control step. Fields that are None keep their values.

    Attributes:
        belt_speed: (n, 3) m/s asked of the crawler motors.
        roll: (n, 3) rad asked of the rotary motors.
        phase: (n,) index into the controller's ``phases``.
        resting: (n,) bool, robots that stand still or drive backward on purpose, which the monitor
            does not count as stuck; none when left out.
        events: decisions of the controller, kept in the result.
        brake: (n, 3) part of ``robot.brake_force``, 0 to 1, by which the belts are braked; all off
            when left out, and to be 0 where the robot has no brakes.
        over: (n,) bool, robots whose run is over after this control period; none when left out.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> ot.Command(belt_speed=np.full((2, 3), 0.1), roll=np.zeros((2, 3)))
        Command(2 robots: belt_speed, roll, events)
    """

    belt_speed: Array
    roll: Array | None = None
    phase: NDArray | None = None
    resting: NDArray[np.bool_] | None = None
    events: Sequence[Event] = ()
    brake: Array | None = None
    over: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        names = [name for name, value in zip(self._fields, self, strict=True) if value is not None]
        try:
            robots = f"{len(self.belt_speed)} robots"
        except TypeError:  # no array yet, and refused where it is used
            robots = f"belt_speed {shown(self.belt_speed)}, which is no (n, 3)"
        return f"Command({robots}: {', '.join(names)})"

    def checked(self, n: int) -> Command:
        """The same with arrays for ``n`` robots.

        Raises:
            ValueError: one has another shape.
        """
        changes = {}
        for name, columns in _COLUMNS.items():
            value, shape = getattr(self, name), (n, *columns)
            # The usual case passes without a copy: commands come at every control step.
            if value is None or (isinstance(value, np.ndarray) and value.shape == shape):
                continue
            array = np.asarray(value)
            if array.shape != shape:
                raise ValueError(f"command.{name} has shape {array.shape}, expected {shape}")
            changes[name] = array
        return self._replace(**changes) if changes else self


@dataclass(frozen=True)
class Settings:
    """Settings of all controllers; each field is (n,). See docs/reference/scenarios.md."""

    cruise_speed: Array  # m/s
    align: NDArray[np.bool_]
    retry: NDArray[np.bool_]
    speed_limit: Array  # m/s
    safe_margin: Array  # rad; nan: by the reach
    reach: Array  # m

    def with_rows(self, robots: NDArray[np.intp], rows: Settings) -> Settings:
        """Copy with the values of ``robots`` (k,) taken from the k ``rows``."""
        changed = {}
        for field in fields(self):
            values = getattr(self, field.name).copy()
            values[robots] = getattr(rows, field.name)
            changed[field.name] = values
        return Settings(**changed)


@dataclass(frozen=True)
class ControlSetup:
    """Everything that a controller is constructed from.

    Attributes:
        routes: the routes of all robots. It grows when robots are sent onto new routes: look up
            again what was looked up in it when ``routes.version`` has changed.
        robot: shared by all robots of the batch.
        settings: speeds, margins and switches, common to all controllers.
        parameters: for each robot, ``[control.parameters]`` as the controller's own model; empty
            tables where it has none.
        location: locations of the robots at the start.
        roll: (n, 3) rad, roll of the modules at the start.
        period: s between two steps.
        gravity: (n, 3) m/s², world frame, as a robot with an inertial unit knows it.

    Example:
        >>> import omnitrack_sim as ot
        >>> setup = ot.Simulation([ot.load_scenario("straight")] * 2).setup
        >>> setup.n, setup.period, setup.drive.name
        (2, 0.01, 'three_motors')
    """

    routes: RouteMap
    robot: Robot
    settings: Settings
    parameters: Sequence[Any]
    location: Location
    roll: Array
    period: float
    gravity: Array

    @cached_property
    def drive(self) -> Drive:
        """The robot's motors and gears. Where ``drive.steers`` is false, the motors realise belt
        speeds only in part: a differential their mean."""
        return drive_of(self.robot.drive)

    @property
    def n(self) -> int:
        """Number of robots."""
        return len(self.roll)

    def each(self, path: str) -> NDArray:
        """Return a parameter of all robots (n,) by its dotted path: ``"recovery.retries"``."""
        values = list(self.parameters)
        for name in path.split("."):
            values = [getattr(value, name) for value in values]
        return np.array(values)


class Controller(Protocol):
    """Protocol of controllers: turn observations into commands for n robots.

    A class of a user's own needs no more than these two methods and inherits from nothing. It may
    also have

    * ``phases``: names of its phases, which ``Command.phase`` indexes; ``("drive",)`` by default;
    * ``Parameters``: a pydantic model of its own ``[control.parameters]``.

    Example:
        >>> import numpy as np
        >>> import omnitrack_sim as ot
        >>> class Constant:
        ...     def __init__(self, setup):
        ...         self.speed = np.full((setup.n, 3), 0.1)  # m/s
        ...     def step(self, observation):
        ...         return ot.Command(self.speed)
        >>> scenario = ot.override(ot.load_scenario("straight"), {"run.time_limit": 0.2})
        >>> ot.run(scenario, controller=Constant).outcome.value
        'timed_out'
    """

    def __init__(self, setup: ControlSetup) -> None: ...

    def step(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        ...


CONTROLLERS = {
    "jacobian": "omnitrack_sim.robots.omnitrack.control.jacobian:JacobianController",
    "paper": "omnitrack_sim.paper.open_loop:PaperController",
    "equal": "omnitrack_sim.paper.open_loop:EqualController",
    "driven": "omnitrack_sim.robots.omnitrack.control.driven:DrivenController",
    "policy": "omnitrack_sim.robots.omnitrack.policy.controller:PolicyController",
}
"""Shipped controllers, ``module:Class`` by the short name that ``control.kind`` may give. Only the
one that a scenario names is imported, so a controller may itself name another one."""


class NoParameters(Table):
    """``[control.parameters]`` of a controller that has none."""


def controller_of(kind: str) -> type[Controller]:
    """The controller class that ``control.kind`` names.

    Raises:
        InputError: there is no such class, or it has no ``step``.
    """
    if kind in CONTROLLERS:
        return named(CONTROLLERS[kind], "control.kind", {})
    controller = named(kind, "control.kind", CONTROLLERS)
    if not (isinstance(controller, type) and callable(getattr(controller, "step", None))):
        problem = f"is {kind!r}, which is no class with a step"
        raise InputError(Fault("control.kind", problem, (*CONTROLLERS, "module:Object")))
    return controller


def parameters_model(controller: type[Controller]) -> type[BaseModel]:
    """The model of a controller's ``[control.parameters]``; an empty table where it has none."""
    return getattr(controller, "Parameters", NoParameters)
