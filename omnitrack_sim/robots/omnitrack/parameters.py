"""Parameters of the robot, each with its unit and its source."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import (
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from omnitrack_sim.base.table import ObjectName
from omnitrack_sim.record.channels import Channel
from omnitrack_sim.record.display import SingularRange
from omnitrack_sim.record.events import Event, Outcome, Overloaded
from omnitrack_sim.record.metrics import Metric
from omnitrack_sim.record.timeline import Touch
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.robots.control import Controller
from omnitrack_sim.robots.odometry import Odometry
from omnitrack_sim.robots.omnitrack.channels import CHANNELS, MODULES
from omnitrack_sim.robots.omnitrack.drive import drive_of
from omnitrack_sim.robots.omnitrack.events import ADVICE, BeyondStop
from omnitrack_sim.robots.omnitrack.metrics import BeltRun, metrics_of
from omnitrack_sim.robots.omnitrack.motors import (
    MOTOR_FIGURES,
    MOTORS,
    WINDING_FIGURES,
    Motor,
    NamedMotor,
)
from omnitrack_sim.robots.quantity import (
    ROUNDING,
    SCALES,
    quantity,
    quantity_of,
    similar,
)
from omnitrack_sim.robots.robot import Robot, SceneOptions
from omnitrack_sim.robots.size import GRAVITY

if TYPE_CHECKING:
    import mujoco

    from omnitrack_sim.pipes import Assembly, Passage
    from omnitrack_sim.robots.display import RobotDisplay
    from omnitrack_sim.robots.omnitrack.track_diagnosis import TrackDiagnosis
    from omnitrack_sim.robots.omnitrack.track_plant import TrackPlant
    from omnitrack_sim.robots.plant import Start

JOINTS_OF_A_MODULE = (
    *("slide", "pitch", "roll", "belt_upper", "belt_lower"),
    *("sprocket_front", "sprocket_rear"),
)
"""Names of a module's joints in the model, before an underscore and the module's number."""
MODULE_ANGLES = (0.0, 2 * math.pi / 3, -2 * math.pi / 3)
"""Angle of each module about the robot's z axis from module 1, rad (paper, Fig. 5)."""

MASSES = ("chassis_mass", "arm_mass", "module_mass")
"""Fields in which robots of one batch may differ, though they enter the model's inertia."""

MAX_PRELOADS = 20.0
"""Normal force of a module over the preload, or the robot's weight where that is more, from which
on a result carries a note. Springs at their end press with 3 times the preload."""
STOP_ROOM = 0.001
"""Distance beyond its stop from which on an arm's place is noted, m, for a robot of scale 1."""
MAX_PRESS = 1.0
"""By how much the springs may be pressed together in the nominal pipe, m, in a robot of scale 1: a
force that hardly changes with the bore asks for long springs, but hardly for longer ones."""
SLIP_STEP, SLIP_EXCESS = 0.002, 0.1
"""Time step, s, for a robot of scale 1, and the share by which slip reads too large at it. Beyond
it the share grows so fast that a run carries a note."""


class Omnitrack(Robot):
    """Omnidirectional Tractable Three Module Robot, lumped as in the paper's simulation.

    SI units, radians. Frozen: change by ``robot.model_copy(update=...)`` or a scenario override,
    and the size by ``robot.scaled(factor)``.

    ``scale`` asks for the same robot in another size. Reading a robot scales every value by the
    law of dynamic similarity (``froude_exponent``), from the scale that the values are stated for,
    ``values_at_scale``, to ``scale``. A robot that has been read has the values of its own size
    and says so, ``values_at_scale == scale``, so that reading what it dumped changes nothing.

    Example:
        >>> import omnitrack_sim as ot
        >>> robot = ot.Omnitrack(preload=30.0)
        >>> robot.nominal_bore, robot.mass
        (0.16, 1.0)
        >>> robot.scaled(2.0).nominal_bore
        0.32
        >>> robot.parameters()[2].name
        'lug_radius'
    """

    kind: ClassVar[str] = "omnitrack"
    colliders: ClassVar[tuple[str, ...]] = ("exact", "primitives")
    rolls: ClassVar[bool] = True
    modules: ClassVar[int] = MODULES
    built: ClassVar[Mapping[str, Any]] = MappingProxyType({"motor": "pololu_1000_hpcb"})
    own_values: ClassVar[tuple[str, ...]] = (
        *("preload", "roll_torque", *MASSES),
        *(f"motor.{name}" for name in MOTOR_FIGURES),
        *(f"motor.winding.{name}" for name in WINDING_FIGURES),
    )

    scale: float = quantity(
        1.0, "1", "assumed", "size of the robot; 1 is the one for 160 mm pipes", SCALES
    )
    values_at_scale: float = quantity(
        1.0,
        "1",
        "assumed",
        "size that the given values are for; they are scaled from it to `scale`, once",
        SCALES,
    )
    lug_radius: float = quantity(
        0.0276,
        "m",
        "derived",
        "r = V / theta_dot: 100 mm/s at the motor's no-load 3.62 rad/s",
        (0.004, 0.08),
    )
    reach: float = quantity(
        0.0961,
        "m",
        "inferred",
        "axis to lug surface, springs extended; what the 96.54 degree sector needs",
        (0.03, 0.4),
    )
    nominal_pipe_radius: float = quantity(
        0.080,
        "m",
        "published",
        "Section II.A: 160 mm pipe; the slide coordinate is zero here",
        (0.02, 0.3),
    )
    slide_travel_inward: float = quantity(
        0.018, "m", "assumed", "arm travel from the nominal pipe towards the axis", (1e-4, 0.25)
    )
    contact_length: float = quantity(
        0.090,
        "m",
        "assumed",
        "length of the contact line of a track; see docs/studies/design-study.md",
        (0.01, 1.0),
    )
    lugs_per_track: int = quantity(
        15,
        "1",
        "numerical",
        "fine limit of the contact line; see docs/studies/design-study.md",
        (2, 200),
    )
    track_offset: float = quantity(
        0.001,
        "m",
        "numerical",
        "lug centres of the two tracks lie this far above and below the module axis",
        (1e-5, 0.02),
    )
    spring_stiffness: float = quantity(
        500.0, "N/m", "published", "Section VI: 0.5 N/mm, each spring", (1.0, 1e5)
    )
    springs_per_module: int = quantity(
        4,
        "1",
        "derived",
        "Section II.A: four shafts a module, a spring on each",
        (2, 20),
        multiple_of=2,
    )
    preload: float = quantity(
        25.0, "N", "assumed", "force of a module's springs in the nominal pipe", (0.0, 2000.0)
    )
    shaft_spacing: float = quantity(
        0.140,
        "m",
        "assumed",
        "front to rear shafts; sets the pitch stiffness of an arm",
        (0.01, 1.0),
    )
    pitch_limit: float = quantity(
        math.radians(6.0),
        "rad",
        "assumed",
        "slot clearance on the shafts (Section II.A)",
        (1e-3, 0.5),
    )
    slide_damping: float = quantity(
        20.0, "N s/m", "assumed", "sliding friction of an arm on its shafts", (0.0, 1e4)
    )
    pitch_damping: float = quantity(
        0.05, "N m s/rad", "assumed", "as slide_damping, about the pitch axis", (0.0, 100.0)
    )
    chassis_mass: float = quantity(
        0.28, "kg", "assumed", "ABS chassis and steel shafts", (0.01, 50.0)
    )
    chassis_length: float = quantity(
        0.150, "m", "assumed", "centre chassis along the robot axis", (0.01, 1.0)
    )
    chassis_radius: float = quantity(
        0.025, "m", "assumed", "of the cylinder with the chassis's inertia", (0.002, 0.2)
    )
    arm_mass: float = quantity(
        0.04, "kg", "assumed", "one arm pair, without its module", (1e-3, 10.0)
    )
    arm_radius: float = quantity(
        0.01, "m", "assumed", "of the cylinder with the inertia of an arm pair", (1e-3, 0.1)
    )
    module_mass: float = quantity(
        0.20, "kg", "assumed", "one module: two gearmotors, chains, lugs", (0.01, 20.0)
    )
    track_mass: float = quantity(
        1e-3,
        "kg",
        "numerical",
        "one run of lugs, of which module_mass counts two",
        (1e-5, 1.0),
    )
    contact_time: float = quantity(
        0.01,
        "s",
        "numerical",
        "time constant of a lug's contact; at 4 ms lugs bounce on a tee's rim, see "
        "docs/studies/design-study.md",
        (5e-4, 0.2),
    )
    contact_depth: float = quantity(
        0.0005,
        "m",
        "numerical",
        "depth over which a lug's contact comes to its full stiffness",
        (1e-6, 0.01),
    )
    motor: NamedMotor = quantity(
        MOTORS["simulation"],
        "",
        "assumed",
        "crawler motor: a shipped motor's name, or a table of its own",
    )
    drive: Annotated[str, ObjectName()] = quantity(
        "three_motors",
        "",
        "published",
        "Section II.B: a motor a module; or another drive, see docs/studies/differential.md",
    )
    gear_friction: float = quantity(
        0.0,
        "1",
        "assumed",
        "friction between the outputs of one motor, as a part of the force that each passes on",
        (0.0, 1.0),
    )
    brake_force: float = quantity(
        0.0, "N", "assumed", "largest force of a brake on a module's belt; 0: no brakes", (0.0, 1e4)
    )
    roll_motor: NamedMotor | None = quantity(
        None,
        "",
        "assumed",
        "rotary motor, of which the reflected inertia counts; none: same as the crawler's",
    )
    roll_stiffness: float = quantity(
        20.0,
        "N m/rad",
        "assumed",
        "position gain of the rotary motor's servo, damped critically for its own inertia",
        (0.01, 1e5),
    )
    roll_rate: float = quantity(
        1.5,
        "rad/s",
        "assumed",
        "largest speed of the rotary motor (same gearmotor: 3.62 no-load)",
        (0.01, 100.0),
    )
    roll_torque: float = quantity(
        1.2,
        "N m",
        "assumed",
        "limit on a rotary motor (same gearmotor as the crawler's)",
        (1e-3, 1e4),
    )

    @model_validator(mode="wrap")
    @classmethod
    def _at_its_scale(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        stated = handler(data)
        values: dict[str, Any] = {}
        for name in cls.model_fields:
            # A value that is not given is the default, which is for scale 1.
            origin = stated.values_at_scale if name in stated.model_fields_set else 1.0
            value = getattr(stated, name)
            values[name] = (
                _plain_if_scaled(value, stated.scale)
                if isinstance(value, Motor)
                else similar(value, quantity_of(cls, name).unit, stated.scale / origin)
            )
        values["values_at_scale"] = stated.scale
        # What was scaled has to pass the checks of its own size.
        robot = stated if values == dict(stated) else handler(values)
        faults = [
            InitErrorDetails(
                type=PydanticCustomError("misfit", "{problem}", {"problem": problem}),
                loc=tuple(path.split(".")),
                input=functools.reduce(getattr, path.split("."), robot),
            )
            for path, problem in robot._misfits()
        ]
        if faults:
            raise ValidationError.from_exception_data("Omnitrack", faults)
        return robot

    def _misfits(self) -> Iterator[tuple[str, str]]:
        """Yield field and problem of values, each within its range, that do not go together."""
        nominal = self.nominal_pipe_radius
        if self.reach <= nominal:
            yield "reach", f"must be over nominal_pipe_radius, {nominal:.6g} m"
        room = nominal - self.lug_radius
        if room <= 0:
            yield "lug_radius", f"must be under nominal_pipe_radius, {nominal:.6g} m"
        elif self.slide_travel_inward >= room:
            problem = f"would take a module's axis beyond the robot's; must be under {room:.6g} m"
            yield "slide_travel_inward", problem
        if self.track_offset > self.lug_radius / 2:
            problem = f"must be at most half of lug_radius, {self.lug_radius / 2:.6g} m"
            yield "track_offset", problem
        if 2 * self.track_mass >= self.module_mass:
            problem = f"must be under half of module_mass, {self.module_mass / 2:.6g} kg"
            yield "track_mass", problem
        press, most = self.preload / self.module_stiffness, MAX_PRESS * self.scale
        if press > most * (1 + ROUNDING):
            problem = (
                f"would press the springs together by {press:.4g} m in the nominal pipe, at "
                f"{self.module_stiffness:.4g} N/m a module; at most {most:.4g} m"
            )
            yield "preload", problem
        if self.feasible_belt_speed <= 0:
            load = f"{self.climbing_torque:.4g} N m"
            problem = f"cannot carry the robot: a third of its weight is {load} at a module's shaft"
            yield "motor.stall_torque", problem

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """The size, and what differs from the standard robot of that size."""
        standard = type(self)(scale=self.scale)
        for name, value in self:
            if name == "scale" or value != getattr(standard, name):
                yield name, value

    def __str__(self) -> str:
        return repr(self)

    def scaled(self, factor: float) -> Self:
        """The same robot, ``factor`` times as large: every value scaled by the law of similarity.

        A motor that is a product keeps its figures (see ``Motor.scale``), so a robot with one is
        not similar to the other.
        """
        return type(self).model_validate(dict(self) | {"scale": self.scale * factor})

    @property
    def rotary_motor(self) -> Motor:
        """The motor that rolls a module."""
        return self.motor if self.roll_motor is None else self.roll_motor

    @property
    def climbing_torque(self) -> float:
        """Torque at a module's shaft in the worst steady climb, N m: of a third of the weight."""
        return self.mass * GRAVITY / 3 * self.lug_radius

    @property
    def feasible_belt_speed(self) -> float:
        """Belt speed that the crawler motor holds against ``climbing_torque``, m/s."""
        motor = self.motor
        part = max(0.0, 1 - self.climbing_torque / motor.stall_torque)
        return motor.no_load_speed * part * self.lug_radius

    @property
    def nominal_bore(self) -> float:
        """Inner diameter of the pipe that the robot is made for, m."""
        return 2 * self.nominal_pipe_radius

    @property
    def nominal_speed(self) -> float:
        """The paper's cruise speed, m/s, in any bore."""
        return 0.1

    def similar_to(self, bore: float) -> dict[str, Any]:
        """See ``Robot``. A product does not scale; the motor of the simulation takes its place."""
        motor = {} if self.motor.scale else {"motor": "simulation"}
        return {"scale": self.scale_for(bore)} | motor

    def scale_for(self, bore: float) -> float:
        """Return the ``scale`` at which this robot is made for a bore of ``bore`` m."""
        return self.scale * bore / self.nominal_bore

    @property
    def module_distance(self) -> float:
        """Module axis from robot axis in the nominal pipe, m: l = R - r (Table 1)."""
        return self.nominal_pipe_radius - self.lug_radius

    @property
    def module_stiffness(self) -> float:
        """Radial stiffness of one module's springs together, N/m."""
        return self.spring_stiffness * self.springs_per_module

    @property
    def slide_range(self) -> tuple[float, float]:
        """Travel of an arm from the nominal pipe radius, m, outward positive."""
        return -self.slide_travel_inward, self.reach - self.nominal_pipe_radius

    @property
    def lug_pitch(self) -> float:
        """Distance of neighbouring lugs along a track, m."""
        return self.contact_length / self.lugs_per_track

    def spring_force(self, radius: float) -> float:
        """Return the force of a module's springs in a bore of ``radius`` m, N, at least 0."""
        return max(0.0, self.preload + self.module_stiffness * (self.nominal_pipe_radius - radius))

    @property
    def mass(self) -> float:
        """Whole robot, kg."""
        return self.chassis_mass + MODULES * (self.arm_mass + self.module_mass)

    @property
    def length(self) -> float:
        """Tip to tip along the robot axis, m: outermost lug centres and two lug radii."""
        return self.contact_length + 2 * self.lug_radius

    @property
    def bores(self) -> tuple[float, float]:
        """Smallest and largest bore, m, that the arms reach."""
        # The arms slide from the nominal pipe between their stops.
        low, high = (self.nominal_pipe_radius + travel for travel in self.slide_range)
        return 2 * low, 2 * high

    def misfit(self, bore: float) -> str:
        """See ``Robot``."""
        low, high = self.bores
        if low < bore < high:
            return ""
        made = f"robot.scale = {self.scale_for(bore):.4g} makes the robot for it"
        if low < bore / 1000 < high:
            made = f"lengths are in m; {bore:.4g} mm are {bore / 1000:.4g} m"
        return f"the arms reach bores from {low:.4g} to {high:.4g} m ({made})"

    def check(self) -> None:
        """See ``Robot``."""
        drive_of(self.drive)

    @property
    def top_speed(self) -> float:
        """See ``feasible_belt_speed``."""
        return self.feasible_belt_speed

    @property
    def drive_name(self) -> str:
        """See ``Robot``."""
        return f"motor {self.motor.name} (robot.motor)"

    def slip_excess(self, timestep: float) -> float:
        """Return the share by which a typical turn's slip reads too large at a time step, s.

        Medians of 64 pairs of turns at 1, 2, 2.5 and 5 ms: 1, 10, 11 and 112 %
        (``benchmarks/tee_turns.py steps``).
        """
        return SLIP_EXCESS * (timestep / (SLIP_STEP * self.time_scale)) ** 2.6

    # What is made of the parameters

    @classmethod
    def controllers(cls) -> Mapping[str, type[Controller]]:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.control.driven import DrivenController
        from omnitrack_sim.robots.omnitrack.control.jacobian import JacobianController
        from omnitrack_sim.robots.omnitrack.control.open_loop import (
            BendController,
            EqualController,
            PaperController,
        )
        from omnitrack_sim.robots.omnitrack.policy.controller import PolicyController

        return {
            "jacobian": JacobianController,
            "paper": PaperController,
            "equal": EqualController,
            "eq20": BendController,
            "driven": DrivenController,
            "policy": PolicyController,
        }

    @property
    def decisions(self) -> Any:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.policy.controller import Decisions

        return Decisions

    def spec(self) -> mujoco.MjSpec:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.track_plant import robot_alone

        return robot_alone(self)

    def scene(self, network: Assembly, options: SceneOptions) -> mujoco.MjSpec:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.track_plant import scene

        return scene(self, network, options)

    def plant(self, model: mujoco.MjModel, start: Start, *more: Any) -> TrackPlant:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.track_plant import TrackPlant

        return TrackPlant(model, self, start, *more)

    def diagnosis(self, limits: Any, period: float, robots: Sequence[Robot]) -> TrackDiagnosis:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.track_diagnosis import TrackDiagnosis

        return TrackDiagnosis(self, limits, period, robots)

    @property
    def display(self) -> RobotDisplay:
        """What the robot shows of itself in films, pages, figures and windows."""
        from omnitrack_sim.robots.omnitrack.track_display import TrackDisplay

        return TrackDisplay(self)

    @property
    def joints(self) -> Mapping[str, slice]:
        """Columns of joint positions by the names of the joints; see ``Robot``.

        They are ``robot``, and of each module ``slide_1``, ``pitch_1``, ``roll_1``,
        ``belt_upper_1``, ``belt_lower_1``, ``sprocket_front_1`` and ``sprocket_rear_1``; then those
        of shafts.
        """
        modules = [f"{name}_{i + 1}" for i in range(MODULES) for name in JOINTS_OF_A_MODULE]
        shafts = [f"shaft_{i + 1}" for i in range(drive_of(self.drive).shafts)]
        columns = {name: slice(7 + i, 8 + i) for i, name in enumerate([*modules, *shafts])}
        return {"robot": slice(0, 7)} | columns

    def odometry(self) -> Odometry:
        """See ``Robot``."""
        from omnitrack_sim.robots.omnitrack.odometry import TrackOdometry  # imports this module

        return TrackOdometry(self)

    @property
    def channels(self) -> Mapping[str, Channel]:
        """See ``Robot``."""
        return CHANNELS

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """See ``Robot``."""
        return metrics_of(self.motor)

    def run_record(self, trajectory: Trajectory, no_load_slip: float, timestep: float) -> BeltRun:
        """See ``Robot``."""
        return BeltRun(
            trajectory,
            self.mass * GRAVITY,
            no_load_slip,
            self.lug_radius,
            motor=self.motor,
            drive=drive_of(self.drive),
            slip_excess=self.slip_excess(timestep),
        )

    def touch(self, trajectory: Trajectory) -> Touch:
        """See ``Robot``."""
        run = self.run_record(trajectory, math.nan, math.nan)
        return Touch(
            trajectory["contact_count"].sum(axis=-1) > 0,
            trajectory["normal_force"],
            trajectory["slip_velocity"],
            trajectory["slip_ratio"],
            run.power / self.motor.efficiency,
        )

    def advice(self, outcome: Outcome) -> str:
        """See ``Robot``."""
        return ADVICE.get(outcome, outcome.advice)

    def strains(self, trajectory: Trajectory) -> list[Event]:
        """Return notes on the largest force and travel of an arm, where they are beyond reason."""
        events: list[Event] = []
        low, high = self.slide_range
        forces = np.nan_to_num(trajectory["normal_force"])  # (T, 3); no number if it diverged
        slide = np.nan_to_num(trajectory["slide"])
        beyond = np.maximum(low - slide, slide - high)
        sample, module = np.unravel_index(forces.argmax(), forces.shape)
        force, preload = float(forces[sample, module]), max(self.preload, self.mass * GRAVITY)
        if force > MAX_PRELOADS * preload:
            time = float(trajectory.time[sample])
            part, times = f"module {module + 1}", force / preload
            events.append(Overloaded(0, time, part, force, times, "the preload"))
        sample, arm = np.unravel_index(beyond.argmax(), beyond.shape)
        depth = float(beyond[sample, arm])
        if depth > STOP_ROOM * self.scale:
            time = float(trajectory.time[sample])
            events.append(BeyondStop(0, time, int(arm) + 1, 1000 * depth))
        return events

    def singular_range(self, passage: Passage, bend_radius: float | None) -> SingularRange | None:
        """See ``Robot``: by the theory of a turn in a tee."""
        from omnitrack_sim.robots.omnitrack.singularity import TurnCase

        if passage.manoeuvre != "tee_turn":
            return None
        return TurnCase(
            pipe_radius=passage.corner_radius,
            turn_angle=passage.description.turn_angle,
            reach=self.reach,
            contact_length=self.contact_length,
            bend_radius=bend_radius,
        ).singular_range

    def notes(self, bores: Iterable[float], timestep: float) -> Iterator[str]:
        """See ``Robot``: on a time step whose slip is not that of small ones, and on a bore."""
        longest = SLIP_STEP * self.time_scale
        if timestep > longest * (1 + 1e-9):
            yield (
                f"physics.timestep is {timestep:.4g} s: above {longest:.4g} s slip comes out too "
                f"large, here by about {100 * self.slip_excess(timestep):.0f} %"
            )
        yield from self._bore_notes(bores)

    def _bore_notes(self, bores: Iterable[float]) -> Iterator[str]:
        """Yield a remark on the bore that the arms reach, but for which the springs are not made.

        It is the one where they press the modules most unlike they do in the nominal bore.
        """
        forces = {bore: self.spring_force(bore / 2) for bore in bores}
        narrowest, widest = min(forces), max(forces)
        # The springs of the standard robot stay within these limits from 135 to 172.5 mm.
        if forces[narrowest] > 2 * self.preload:
            bore = narrowest
        elif forces[widest] < self.preload / 2:
            bore = widest
        else:
            return
        held = f"press each module with {forces[bore]:.3g} N" if forces[bore] else "are slack"
        yield (
            f"in the bore of {bore:.4g} m the springs {held}, in the robot's own of "
            f"{self.nominal_bore:.4g} m with robot.preload, {self.preload:.3g} N; robot.scale = "
            f"{self.scale_for(bore):.4g} makes the robot for it"
        )


def _plain_if_scaled(motor: Motor, scale: float) -> Motor | dict[str, Any]:
    """The motor in a robot of ``scale``; as a table, which is checked, where it is another one."""
    scaled = motor.at_scale(scale)
    return motor if scaled is motor else scaled.model_dump()
