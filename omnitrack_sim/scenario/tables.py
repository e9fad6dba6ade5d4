"""The tables of a scenario file: keys, defaults, units and limits."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from omnitrack_sim.base.bounds import MIN_STEP
from omnitrack_sim.base.table import Angle, Direction, NotNegative, Part, Positive, Table, Unit
from omnitrack_sim.pipes import ARCS, Fitting, Step
from omnitrack_sim.pipes.fittings.kinds import FittingEntry
from omnitrack_sim.record.events import Outcome


class Pipe(FittingEntry):
    """A fitting in the list ``pipes``, which is in the order of the route."""

    name: str | None = None
    """Name in messages. Left out: its kind and number."""
    enter: str
    """Port that is entered: `start` or `end`; of a tee or wye `run_start`, `run_end` or
    `branch`, of a cross also `opposite`."""
    leave: str
    """Another port. A pipe with two ports is left by the one that it is not entered by."""
    turn_deg: Angle = 0.0
    """Rotation about the joint's axis; elbows in a row without it stay in one plane."""

    @classmethod
    def keys_for(cls, fitting: type[Fitting]) -> dict[str, Any]:
        """Ports with the fitting's own way as default."""
        enter, leave = fitting.default_way
        port = Literal[fitting.port_names]
        return {"enter": (port, enter), "leave": (port, leave)}

    @model_validator(mode="before")
    @classmethod
    def _leaves_by_the_other(cls, data: Any) -> Any:
        """Leave a fitting of two ports by the one that is not entered."""
        if not isinstance(data, dict) or "leave" in data:
            return data
        ports = cls.of.port_names
        if len(ports) == 2:
            # Before validation: `leave` has the kind's default, which is wrong for a pipe entered
            # backward.
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


class StartTable(Table):
    """Pose of the robot at the start, and of the route in the world."""

    theta5_deg: Angle = 0.0
    """Module 1 from the turning direction of the next fitting: 0 points into the turn, or at a
    tee's opening."""
    distance: Annotated[float, Unit("m")] = 0.10
    """Along the centreline, from the start port to the robot's centre."""
    roll_deg: Angle = 0.0
    """Roll of all modules; 0: upper track at the wall, 180: lower track."""
    axis: Annotated[Direction, Unit("1")] = (0.0, 0.0, 1.0)
    """Direction of the route's first axis in the world; left out, it stands upright. Not with a
    network."""
    turn_deg: Angle = 0.0
    """Rotation of the whole route about that axis; not with a network. At 0 an elbow bends an
    upright route towards +x, one along +x down and one along +y towards +x. By 90, 180 and 270 one
    along +x bends to its left (+y), up and to its right; one along +y down, towards -x and up."""


Acceleration = Annotated[float, Field(ge=-1000, le=1000)]
"""m/s², up to a hundred times that of the earth."""


class WorldTable(Table):
    """Surroundings of the robot: gravity, and friction of the walls."""

    gravity: Annotated[tuple[Acceleration, Acceleration, Acceleration], Unit("m/s²")] = (
        0.0,
        0.0,
        -9.81,
    )
    """Acceleration, world frame."""
    friction: Annotated[float, Field(ge=0, le=5), Unit("1")] = 0.9
    """Coulomb coefficient of the lugs on the wall; 0.9 is assumed, for latex on dry plastic."""


class PullTable(Table):
    """A pull at the robot's tail, backward along the pipe; left out, there is none."""

    force: Annotated[NotNegative, Unit("N")] = 0.0
    """At the start."""
    rate: Annotated[NotNegative, Unit("N/s")] = 0.0
    """Growth, until the robot stops: the metric `pull_held_n` is what it still moved against."""


Radius = Annotated[float, Field(ge=1e-3, le=1000)]
"""Of an arc, m."""


class ControlTable(Table):
    """The controller, and what every controller is asked for."""

    kind: str = ""
    """The controller: one of the robot's by its name; `module:Class` names a class of your own, and
    an installed package may give it a word. Left out: the robot's first, as "jacobian"."""
    cruise_speed: Annotated[float, Field(ge=1e-6, le=1), Unit("m/s")] = 0.1
    """Speed of the robot's centre, in turns as well."""
    align: bool = True
    """Stop and roll to a safe orientation before a fitting."""
    retry: bool = True
    """Back off, align and try again where a turn makes no progress; at most
    `control.parameters.recovery.retries` times."""
    speed_limit: Annotated[float, Field(ge=1e-6, le=100), Unit("m/s")] = 0.2
    """Cap on the speed of the robot's fastest part, such as a belt."""
    tee_turn_radius: Annotated[Radius, Unit("m")] = ARCS.turn
    """Radius of the centreline's arc from run to branch, for a robot for D = 160 mm, with which it
    grows; a short tee gets what fits it."""
    tee_merge_radius: Annotated[Radius, Unit("m")] = ARCS.merge
    """Likewise from branch to run."""
    safe_margin_deg: Annotated[float, Field(ge=1e-3, le=60)] | None = None
    """Half-width of the safe range of theta5. Left out: by the motion singularity region of
    `robot.reach`, 11.73 for 96.1 mm."""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """A table that only this controller has."""


class MonitorTable(Table):
    """Criteria that end a run. Lengths are for D = 160 mm and grow with the robot's bore."""

    progress: Annotated[Part, Unit("m")] = 0.002
    """Advance beyond the farthest point so far that counts as progress."""
    patience_time: Annotated[Part, Unit("s")] = 3.0
    """A robot hangs after this time without progress, for D = 160 mm, and after `patience` as
    well. In plain pipes the run is then over; in a mission another way is tried first."""
    patience: Annotated[Part, Unit("m")] = 0.3
    """Distance at cruise speed in the meantime."""
    slide_back: Annotated[Part, Unit("m")] = 0.1
    """A robot also hangs this far behind the farthest point."""
    memory: Annotated[Part, Unit("s")] = 0.5
    """Time constant of the averages that the outcome is judged by, for D = 160 mm."""
    falls: Annotated[int, Field(ge=0, le=1000), Unit("1")] = 2
    """Falls into another pipe of the network after which a robot replans; 0 to 1000."""
    lost_contact: Annotated[Part, Unit("robot weights")] = 0.102
    """`motion_singularity`: in a tee turn, the normal force of a module is below this part of the
    robot's weight."""
    no_motion_cosine: Annotated[Part, Unit("1")] = 0.2
    """`no_motion_line`: the size of cos(roll) of all modules is below this."""
    wedged_cosine: Annotated[Part, Unit("1")] = 0.7
    """`wedged`: the size of the cosine of the tilt is below this when the run ends for want of
    headway, or at the goal."""
    slipping_ratio: Annotated[Part, Unit("1")] = 0.5
    """`slipping`: two modules have a larger slip ratio than this, or another robot than the tracked
    one has slid back and slides faster than this part of its cruise speed; otherwise the robot is
    `stuck`."""
    stalled_speed: Annotated[Part, Unit("1")] = 0.2
    """`stalled`: a motor at its torque limit runs below this part of the commanded speed."""


def is_multiple(period: float, step: float) -> bool:
    """Test if a period is a whole number of steps, but for rounding."""
    count = round(period / step)
    # Decimal fractions are not exact in binary: 0.3 / 0.1 gives 2.9999999999999996.
    return count >= 1 and abs(period / step - count) <= 1e-6  # allows for rounding


ColliderName = Literal["primitives", "exact"]


class PhysicsTable(Table):
    """Numerics."""

    timestep: Annotated[float, Field(ge=MIN_STEP, le=0.005), Unit("s")] = 0.002
    """Of the physics."""
    control_period: Annotated[float, Field(gt=0, le=0.05), Unit("s")] = 0.01
    """Whole number of time steps."""
    collider: ColliderName = "exact"
    """True surfaces and whole tracks; or "primitives": walls of boxes and rows of sphere lugs, 5
    times slower, a second way to the same contacts."""
    wall_tolerance: Annotated[float, Field(ge=1e-6, le=2e-3), Unit("m")] = 1e-4
    """Largest distance of walls of primitives from the exact surface on straights, reducers and
    elbows."""
    staves: Annotated[Annotated[int, Field(ge=8, le=720)] | None, Unit("1")] = None
    """Pieces around a bore of walls of primitives. Left out: by the tolerance."""

    @field_validator("control_period")
    @classmethod
    def _is_whole_steps(cls, period: float, info: ValidationInfo) -> float:
        """Require a whole number of time steps."""
        step = info.data.get("timestep")  # missing when it is at fault itself
        if step is not None and not is_multiple(period, step):
            raise ValueError(f"is {period} s, not a whole multiple of physics.timestep ({step} s)")
        return period


class RunTable(Table):
    """End of the run: its goal, its time limit, and the outcome that its author expects."""

    goal_distance: Annotated[Positive | None, Unit("m")] = None
    """Arc length of the robot's centre at the goal; not with a mission. Left out: the robot's nose
    at the end of the route."""
    time_limit: Annotated[Positive | None, Unit("s")] = None
    """Simulated time after which the run is over; of a mission that of its first leg, and further
    legs add their own. Left out: four route lengths at cruise speed, and 20 s; longer where the
    motors slow the robot down in bends."""
    expected_outcome: Outcome | None = None
    """`omnitrack run` says whether it came true: `reached_goal`, `motion_singularity`, `stalled`,
    `stuck`, `wedged`, `slipping`, `held_by_tether`, `no_motion_line`, `left_pipe`, `timed_out`,
    `wrong_map`, `lost`, `ended` or `diverged`."""


class RecordTable(Table):
    """Contents of the record.

    Sensors and metrics of a user's own go by the name ``module:Object``; see
    docs/how-to/extending.md.
    """

    period: Annotated[float, Field(gt=0, le=1), Unit("s")] = 0.02
    """Time between two samples: a whole number of `physics.control_period`."""
    sensors: Annotated[tuple[str, ...], Field(max_length=100)] = ()
    """A list of sensors whose channels controllers see and the trajectory has; robots of one batch
    share it."""
    metrics: Annotated[tuple[str, ...], Field(max_length=100)] = ()
    """A list of metrics that are computed beside the shipped ones, also for the tables of sweeps;
    robots of one batch share it."""
    pictures: bool = False
    """Save all pictures of the robot's cameras in `pictures.parquet`: for `sensing.kind =
    "onboard"`."""
