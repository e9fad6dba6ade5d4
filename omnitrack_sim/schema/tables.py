"""The tables of a scenario file: keys, defaults, units and limits."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from omnitrack_sim.bounds import SHORTEST_STEP
from omnitrack_sim.pipes import ARCS, Arcs, Fitting, Step
from omnitrack_sim.pipes.fittings import known_fittings
from omnitrack_sim.record.outcome import Outcome
from omnitrack_sim.robot import Robot
from omnitrack_sim.schema.fittings import FittingEntry
from omnitrack_sim.table import Angle, Part, Positive, Table, units_of


def _has_a_direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*axis) == 0:
        raise ValueError("has no direction; give one such as [0, 0, 1]")
    return axis


Direction = Annotated[tuple[float, float, float], AfterValidator(_has_a_direction)]
"""A vector whose length means nothing, world frame."""


UNITS: dict[str, str] = {
    "start.distance": "m",
    "start.axis": "1",
    "world.gravity": "m/s²",
    "contact.friction": "1",
    "control.cruise_speed": "m/s",
    "control.speed_limit": "m/s",
    "control.tee_turn_radius": "m",
    "control.tee_merge_radius": "m",
    "physics.timestep": "s",
    "physics.control_period": "s",
    "physics.record_period": "s",
    "physics.time_limit": "s",
    "physics.wall_tolerance": "m",
    "physics.staves": "1",
    "goal.distance": "m",
}
"""Units of the numbers by path; those in degrees end in ``_deg``, the robot's parameters and the
fittings have their own."""


_ROBOT_UNITS = {
    # A robot with a rotary motor of its own has all the parameters that a robot can have.
    row.name: row.unit or None
    for row in Robot(roll_motor=Robot().motor).parameters()
}


def unit_of(path: str) -> str | None:
    """Unit of the value at a dotted path of a scenario; None where it has none."""
    table, *keys = path.split(".")
    if path.endswith("_deg"):
        return "deg"
    if table == "robot":
        return _ROBOT_UNITS.get(".".join(keys))
    named = [key for key in keys if not key.isdigit() and key != "*"]
    if table == "pipes":
        return pipe_units().get(named[-1]) if named else None
    return UNITS.get(".".join([table, *named]))


def pipe_units() -> dict[str, str]:
    """Units of the keys of all fittings that are known in this process."""
    tables = [fitting.Table for fitting in known_fittings().values()]
    return {key: unit.symbol for table in tables for key, unit in units_of(table).items()}


class Pipe(FittingEntry):
    """A fitting in the list ``pipes``, which is in the order of the route."""

    name: str | None = None
    enter: str  # one of the fitting's ports
    leave: str  # another one
    turn_deg: Angle = 0.0  # rotation about the joint's axis

    @classmethod
    def keys_for(cls, fitting: type[Fitting]) -> dict[str, Any]:
        """Ports with the fitting's own way as default."""
        enter, leave = fitting.default_way
        port = Literal[fitting.port_names]
        return {"enter": (port, enter), "leave": (port, leave)}

    @model_validator(mode="before")
    @classmethod
    def _leaves_by_the_other(cls, data: Any) -> Any:
        """Of two ports, the one that is not entered is left by."""
        if not isinstance(data, dict) or "leave" in data:
            return data
        ports = cls.of.port_names
        if len(ports) == 2:
            others = [port for port in ports if port != data.get("enter", cls.of.default_way[0])]
            return {**data, "leave": others[0]}
        return data

    @field_validator("leave")
    @classmethod
    def _is_another_port(cls, leave: str, info: ValidationInfo) -> str:
        if leave == info.data.get("enter"):
            raise ValueError(
                f"is where the {cls.of.kind} is entered; take one of the others of "
                f"{', '.join(cls.of.port_names)}"
            )
        return leave

    def step(self, index: int) -> Step:
        """As a step of a route."""
        name = self.name or f"{self.of.kind}_{index}"
        return Step(name, self.fitting(), self.enter, self.leave, math.radians(self.turn_deg))


class Start(Table):
    """Where and how the robot begins, and how the route lies in the world."""

    theta5_deg: Angle = 0.0  # module 1 from the turning direction of the next fitting
    distance: float = 0.10  # m along the centreline from the start port to the robot's centre
    roll_deg: Angle = 0.0  # roll of all modules; 0: upper track at the wall
    axis: Direction = (0.0, 0.0, 1.0)  # direction of the route's first axis, world frame
    turn_deg: Angle = 0.0  # rotation of the whole route about that axis


Acceleration = Annotated[float, Field(ge=-1000, le=1000)]
"""m/s², up to a hundred times that of the earth."""


class World(Table):
    """Gravity, world frame."""

    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, -9.81)  # m/s²


class Contact(Table):
    """Lugs on the wall."""

    friction: Annotated[float, Field(ge=0, le=5)] = (
        0.9  # Coulomb coefficient; latex on dry plastic, assumed
    )


Radius = Annotated[float, Field(ge=1e-3, le=1000)]
"""Of an arc, m."""


class Control(Table):
    """The controller, and what every controller is asked for."""

    kind: str = "jacobian"  # a shipped controller, or module:Class
    cruise_speed: Annotated[float, Field(ge=1e-6, le=1)] = 0.1  # m/s
    align: bool = True  # roll to a safe orientation before a fitting
    retry: bool = True  # back off and try again where a turn makes no headway
    speed_limit: Annotated[float, Field(ge=1e-6, le=100)] = 0.2  # m/s, of a belt
    # m, centreline's arc from run to branch, as far as it fits the tee
    tee_turn_radius: Radius = ARCS.turn
    tee_merge_radius: Radius = ARCS.merge  # m, likewise from branch to run
    # of theta5; none: by the robot's reach
    safe_margin_deg: Annotated[float, Field(ge=1e-3, le=60)] | None = None
    # The controller's own table, see docs/scenarios.md; all its keys stand here once it is checked.
    parameters: dict[str, Any] = Field(default_factory=dict)

    @property
    def arcs(self) -> Arcs:
        """Of the centreline in tees."""
        return Arcs(self.tee_turn_radius, self.tee_merge_radius)


class MonitorTable(Table):
    """When a run is over. D is the bore that the robot is made for."""

    progress: Part = 0.0125  # D, advance beyond the farthest point so far that is progress
    # Without progress for both of these a run is over: s at D = 160 mm (with the square root of D
    # at others), and D that cruising would have taken the robot.
    patience_time: Part = 3.0
    patience: Part = 1.875
    slide_back: Part = 0.625  # D, fall behind the farthest point that ends a run
    # s at D = 160 mm, with the square root of D at others: time constant of the averages that the
    # cause of a failure is read from.
    memory: Part = 0.5
    # Offset from the centreline, in pipe radii, beyond which a robot has gone astray in a tee turn;
    # 1 elsewhere.
    tee_room: Part = 1.5
    # How often a robot that has fallen into another pipe of its network plans on from there.
    falls: Annotated[int, Field(ge=0, le=1000)] = 2
    # Mean normal force, in weights of the robot, below which a module counts as having lost the
    # wall.
    lost_contact: Part = 0.102
    no_motion_cosine: Part = 0.2  # size of cos(roll) below which modules are on the line
    slipping_ratio: Part = 0.5  # mean slip ratio of two modules above which a robot slips
    # Part of the commanded belt speed below which a motor at its limit counts as stalled.
    stalled_speed: Part = 0.2


ColliderName = Literal["primitives", "exact"]


class Physics(Table):
    """Numerics."""

    timestep: Annotated[float, Field(ge=SHORTEST_STEP, le=0.005)] = 0.002  # s
    control_period: Annotated[float, Field(gt=0, le=0.05)] = 0.01  # s
    record_period: Annotated[float, Field(gt=0, le=1)] = 0.02  # s
    time_limit: Positive | None = None  # s; none: four times the route at cruise speed, and 20 s
    collider: ColliderName = (
        "primitives"  # walls of boxes and lugs, or "exact" surfaces and whole tracks (extra fast)
    )
    wall_tolerance: Annotated[float, Field(ge=1e-6, le=2e-3)] = (
        1e-4  # m, walls against the exact surface
    )
    staves: Annotated[int, Field(ge=8, le=720)] | None = (
        None  # wall pieces around a bore; none: by tolerance
    )

    @field_validator("control_period", "record_period")
    @classmethod
    def _is_whole_steps(cls, period: float, info: ValidationInfo) -> float:
        """A period is a whole multiple of the one below it."""
        below = "timestep" if info.field_name == "control_period" else "control_period"
        step = info.data.get(below)  # missing when it is at fault itself
        if step is not None and (
            round(period / step) < 1 or abs(period / step - round(period / step)) > 1e-6
        ):
            raise ValueError(f"is {period} s, not a whole multiple of physics.{below} ({step} s)")
        return period


class Goal(Table):
    """Where the run is over."""

    distance: Positive | None = (
        None  # m along the centreline; none: the robot's nose at the end of the route
    )


class RecordTable(Table):
    """Sensors and metrics of a user's own, by the name ``module:Object``; see docs/extending.md."""

    sensors: Annotated[
        tuple[str, ...], Field(max_length=100)
    ] = ()  # values of ot.Sensor: their channels are observed and recorded
    metrics: Annotated[tuple[str, ...], Field(max_length=100)] = ()  # values of ot.Metric


class Expect(Table):
    """What the author of the file expects; ``omnitrack run`` says whether it came true."""

    outcome: Outcome | None = None
