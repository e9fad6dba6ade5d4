"""Interface of controllers of n robots: setup, observation, command."""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeGuard, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import installed, named
from omnitrack_sim.base.rotations import Array, with_rows
from omnitrack_sim.base.table import Table
from omnitrack_sim.base.text import did_you_mean
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Event

if TYPE_CHECKING:
    from omnitrack_sim.robots.sensor import Sensor


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
            known = self._channels()
            near = did_you_mean(name, known)
            message = f"no channel {name!r} is observed{near} (choose from: {', '.join(known)})"
            raise AttributeError(message) from None
        return value

    def __repr__(self) -> str:
        return f"Observation({len(self.leg)} robots, {len(self._channels())} channels)"

    @property
    def sensors(self) -> Mapping[str, Sensor]:
        """Sensors by the names of their channels, where they are read when first asked for."""
        return getattr(self._readings, "sensors", {})

    def _channels(self) -> list[str]:
        """Names of the channels that are observed."""
        return list(self.sensors or self.__dict__.get("_readings", ()))


class Actuation(NamedTuple):
    """Command to the actuators of n robots until the next control step.

    Fields that are None keep their values.

    Attributes:
        ctrl: (n, nu) MuJoCo's control inputs, in the order of the model's actuators.
        phase: (n,) index into the controller's ``phases``.
        resting: (n,) bool, robots that stand still or drive backward on purpose, which the monitor
            does not count as stuck; none when left out.
        events: decisions of the controller, kept in the result.
        over: (n,) bool, robots whose run is over after this control period; none when left out.

    Example:
        >>> import numpy as np
        >>> ot.Actuation(np.zeros((2, 6))).ctrl.shape
        (2, 6)
    """

    ctrl: Array
    phase: NDArray | None = None
    resting: NDArray[np.bool_] | None = None
    events: Sequence[Event] = ()
    over: NDArray[np.bool_] | None = None


MOMENTARY = ("resting", "events", "brake", "over")
"""Fields of a command that hold for one control period; all others stand until they change."""
_Command = TypeVar("_Command", bound=NamedTuple)


def checked(command: _Command, start: _Command) -> _Command:
    """Return a command with arrays of the shapes that those of ``start`` have.

    Raises:
        ValueError: one has another shape.
    """
    changes = {}
    for name, value, like in zip(command._fields, command, start, strict=True):
        # The usual case passes without a copy: commands come at every control step.
        if value is None or name == "events" or np.shape(like) == getattr(value, "shape", None):
            continue
        array = np.asarray(value)
        if array.shape != like.shape:
            raise ValueError(f"command.{name} has shape {array.shape}, expected {like.shape}")
        changes[name] = array
    return command._replace(**changes) if changes else command


def held_command(command: _Command, held: _Command, active: NDArray[np.bool_]) -> _Command:
    """Return the command that n robots carry out.

    Fields that it omits, and all fields of robots that are not ``active`` (n,), are kept from the
    command ``held`` so far.

    A field that holds for one period is None where it is left out.
    """
    values: list[Any] = []
    all_active = np.count_nonzero(active) == len(active)
    for name, value, before in zip(command._fields, command, held, strict=True):
        if name in MOMENTARY:
            left_out = value is None and name in ("resting", "over")
            values.append(np.zeros(len(active), bool) if left_out else value)
        elif value is None:
            values.append(before)
        elif all_active:
            # Copies: whoever made the command may write into its arrays again.
            values.append(value.copy())
        else:
            # Robots whose run is over keep what they were asked last.
            rows = active.reshape(-1, *[1] * (value.ndim - 1))
            values.append(np.where(rows, value, before))
    return command._make(values)


def endless(command: NamedTuple, robots: NDArray[np.bool_]) -> tuple[Any, ...] | None:
    """Return the place of the first number of a command of ``robots`` (n,) that is not finite.

    Returns:
        Name of the field, number of the robot, and the other indices; None where all are finite.
    """
    for name, value in zip(command._fields, command, strict=True):
        is_float = isinstance(value, np.ndarray) and value.dtype.kind == "f"
        # A sum is finite where all its terms are, unless they are beyond all reason.
        if is_float and not math.isfinite(value.sum()):
            rows = robots.reshape(-1, *[1] * (value.ndim - 1))
            places = np.argwhere(rows & ~np.isfinite(value))
            if len(places):
                return name, *places[0].tolist()
    return None


def with_command_rows(command: _Command, rows: NDArray[np.intp], other: _Command) -> _Command:
    """Return a command with the rows (k,) of all its arrays (n, ...) taken from another one."""
    changes = {
        name: with_rows(value, rows, other_value[rows])
        for name, value, other_value in zip(command._fields, command, other, strict=True)
        if isinstance(value, np.ndarray) and isinstance(other_value, np.ndarray)
    }
    return command._replace(**changes)


@dataclass(frozen=True)
class Settings:
    """Settings of all controllers; each field is (n,). See docs/reference/scenarios.md."""

    cruise_speed: Array  # m/s
    min_cruise_speed: Array  # m/s, in the sharpest bend of the way; see ``speed_in``
    top_speed: Array  # m/s, of the robot's fastest part, that the drive holds
    align: NDArray[np.bool_]
    retry: NDArray[np.bool_]
    speed_limit: Array  # m/s
    safe_margin: Array  # rad; nan: by the reach

    def speed_in(self, sharpness: Array) -> Array:
        """Return the cruise speed (..., n) m/s in bends of a sharpness (..., n).

        The outer side of a robot goes 1 + sharpness times as far as its centre, and no faster than
        the drive holds.

        Args:
            sharpness: radius of the bore over that of the bend, 0 where the way is straight; see
                ``RouteMap``.
        """
        return np.minimum(self.cruise_speed, self.top_speed / (1 + sharpness))

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
        robot: its parameters, shared by all robots of the batch.
        settings: speeds, margins and switches, common to all controllers.
        parameters: for each robot, ``[control.parameters]`` as the controller's own model; empty
            tables where it has none.
        location: locations of the robots at the start.
        command: that the robots carry out at the start, with a value in every field.
        period: s between two steps.
        gravity: (n, 3) m/s², world frame, as a robot with an inertial unit knows it.
        model: MuJoCo's model of pipes and robot.
        robots: the parameters of each robot, where ``Robot.own_values`` differ; empty: all have
            those of ``robot``.

    Example:
        >>> import omnitrack_sim as ot
        >>> setup = ot.Simulation([ot.load_scenario("straight")] * 2).setup
        >>> setup.n, setup.period, setup.robot.drive
        (2, 0.01, 'three_motors')
    """

    routes: RouteMap
    robot: Any
    settings: Settings
    parameters: Sequence[Any]
    location: Location
    command: Any
    period: float
    gravity: Array
    model: Any = None
    robots: Sequence[Any] = ()

    @property
    def n(self) -> int:
        """Number of robots."""
        return len(self.gravity)

    def each(self, path: str) -> NDArray:
        """Return a parameter of all robots (n,) by its dotted path: ``"recovery.retries"``."""
        values = list(self.parameters)
        for name in path.split("."):
            values = [getattr(value, name) for value in values]
        return np.array(values)

    def own(self, path: str) -> Array:
        """Return a parameter of all robots (n,), one of ``Robot.own_values`` or what follows."""
        read = operator.attrgetter(path)
        return np.array([read(robot) for robot in self.robots or [self.robot] * self.n])


class Controller(Protocol):
    """Protocol of controllers: turn observations into commands for n robots.

    What ``step`` returns is the kind of command of the robot: ``ot.Command`` of the package's own,
    ``ot.Actuation`` of every other one.

    A class of a user's own needs no more than these two methods and inherits from nothing. It may
    also have

    * ``phases``: names of its phases, which a command's ``phase`` indexes; ``("drive",)`` by
      default;
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

    def step(self, observation: Observation) -> Any:
        """Return the command for the next control period."""
        ...


class OwnController:
    """The controller that a robot brings along: its ``Robot.gait``."""

    def __init__(self, setup: ControlSetup) -> None:
        self._robot, self._start = setup.robot, setup.command

    def step(self, observation: Observation) -> Any:
        """Return the inputs of the robot's own gait, or those of the start."""
        inputs = self._robot.gait(observation)
        return self._start if inputs is None else Actuation(inputs)


class NoParameters(Table):
    """``[control.parameters]`` of a controller that has none."""


def controller_of(kind: str, shipped: Mapping[str, type[Controller]]) -> type[Controller]:
    """Return the controller class that ``control.kind`` names.

    Args:
        kind: name of a shipped controller, of an entry point of the group
            ``omnitrack_sim.controllers``, or ``module:Class``.
        shipped: classes by their names; see ``Robot.controllers``.

    Raises:
        InputError: there is no such class, or it has no ``step``.
    """
    controller = named(kind, "control.kind", shipped, "controllers", _is_controller)
    if not _is_controller(controller):
        choices = (*shipped, *installed("controllers"), "module:Object")
        problem = f"is {kind!r}, which is no class with a step"
        raise InputError(Fault("control.kind", problem, choices))
    return controller


def _is_controller(thing: object) -> TypeGuard[type[Controller]]:
    """Return whether an object is a class with a ``step``."""
    return isinstance(thing, type) and callable(getattr(thing, "step", None))


def parameters_model(controller: type[Controller]) -> type[BaseModel]:
    """The model of a controller's ``[control.parameters]``; an empty table where it has none."""
    return getattr(controller, "Parameters", NoParameters)
