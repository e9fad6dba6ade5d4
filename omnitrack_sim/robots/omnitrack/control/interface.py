"""What a controller is given, what it sees and what it answers. Arrays have a leading axis of n
robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import did_you_mean, shown
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.events import Event
from omnitrack_sim.robots.omnitrack import Robot
from omnitrack_sim.robots.omnitrack.drive import Drive, drive_of


class Observation:
    """What n robots measure at one moment.

    Every observed channel of the schema (docs/reference/channels.md) is an attribute:
    ``observation.roll`` is an array (n, 3) in rad. Robots that drive tail first
    see everything as if they drove nose first.

    Attributes:
        location: where the robots are along their routes.
        leg: (n,) number of the leg that each robot drives. It changes when a robot is sent on.
        gear: (n,) 1 nose first, -1 tail first.
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
    """What n robots shall do until the next control step. What is left out stays as it is.

    Attributes:
        belt_speed: (n, 3) m/s asked of the crawler motors.
        roll: (n, 3) rad asked of the rotary motors.
        phase: (n,) index into the controller's ``phases``.
        resting: (n,) bool, robots that stand still or drive backward on purpose and are not to be
            taken for stuck; none when left out.
        events: what the controller decided, to be told in the result.
        brake: (n, 3) part of ``robot.brake_force``, 0 to 1, by which the belts are braked; all off
            when left out, and to be 0 where the robot has no brakes.
        over: (n,) bool, robots whose run is over after this control period; none when left out.
    """

    belt_speed: Array
    roll: Array | None = None
    phase: NDArray | None = None
    resting: NDArray[np.bool_] | None = None
    events: Sequence[Event] = ()
    brake: Array | None = None
    over: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        given = [name for name, value in zip(self._fields, self, strict=True) if value is not None]
        try:
            robots = f"{len(self.belt_speed)} robots"
        except TypeError:  # no array yet, and refused where it is used
            robots = f"belt_speed {shown(self.belt_speed)}, which is no (n, 3)"
        return f"Command({robots}: {', '.join(given)})"

    def checked(self, n: int) -> Command:
        """The same with arrays for ``n`` robots.

        Raises:
            ValueError: one has another shape.
        """
        changes = {}
        for name, columns in _COLUMNS.items():
            value, shape = getattr(self, name), (n, *columns)
            if value is None or (isinstance(value, np.ndarray) and value.shape == shape):
                continue
            array = np.asarray(value)
            if array.shape != shape:
                raise ValueError(f"command.{name} has shape {array.shape}, expected {shape}")
            changes[name] = array
        return self._replace(**changes) if changes else self


@dataclass(frozen=True)
class Settings:
    """What all controllers are asked for; each field is (n,). See ``[control]`` in
    docs/reference/scenarios.md."""

    cruise_speed: Array  # m/s
    align: NDArray[np.bool_]
    retry: NDArray[np.bool_]
    speed_limit: Array  # m/s
    safe_margin: Array  # rad; nan: by the reach
    reach: Array  # m

    def with_rows(self, robots: NDArray[np.intp], rows: Settings) -> Settings:
        """The same with those of ``robots`` (k,) from k ``rows``."""
        changed = {}
        for field in fields(self):
            values = getattr(self, field.name).copy()
            values[robots] = getattr(rows, field.name)
            changed[field.name] = values
        return Settings(**changed)


@dataclass(frozen=True)
class ControlSetup:
    """All that a controller is given when it is made.

    Attributes:
        routes: the routes of all robots. It grows when robots are sent onto new ways: what is
            looked up in it has to be looked up again when ``routes.version`` has changed.
        robot: shared by all robots of the batch.
        settings: what every controller is asked for.
        parameters: for each robot, ``[control.parameters]`` as the controller's own model; empty
            tables where it has none.
        location: where the robots begin.
        roll: (n, 3) rad, roll of the modules at the start.
        period: s between two steps.
        gravity: (n, 3) m/s², world frame, as a robot with an inertial unit knows it.
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
        """The robot's motors and gears. Where ``drive.steers`` is false, speeds that are asked of
        the belts count only as far as the motors can give them: of a differential, their mean."""
        return drive_of(self.robot.drive)

    @property
    def n(self) -> int:
        """Number of robots."""
        return len(self.roll)

    def each(self, path: str) -> NDArray:
        """A parameter of all robots, (n,), by its dotted path, such as ``"recovery.retries"``."""
        values = list(self.parameters)
        for name in path.split("."):
            values = [getattr(value, name) for value in values]
        return np.array(values)


class Controller(Protocol):
    """Turns observations into commands for n robots, each on its way. State is held per robot.

    A class of a user's own needs no more than these two methods and inherits from nothing. It may
    also have

    * ``phases``: names of what it does, which ``Command.phase`` indexes; ``("drive",)`` when it has
      none;
    * ``Parameters``: a pydantic model of its own ``[control.parameters]``.
    """

    def __init__(self, setup: ControlSetup) -> None: ...

    def step(self, observation: Observation) -> Command:
        """The command for the next control period."""
        ...
