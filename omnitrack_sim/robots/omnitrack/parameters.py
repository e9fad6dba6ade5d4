"""Parameters of the robot, each with its unit and its source."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    ModelWrapValidatorHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.omnitrack.motors import MOTORS, Motor, NamedMotor
from omnitrack_sim.robots.omnitrack.quantity import (
    ROUNDING,
    SCALES,
    Parameter,
    QuantityModel,
    parameter_rows,
    quantity,
    quantity_of,
    similar,
)

MODULES = 3
MODULE_ANGLES = (0.0, 2 * math.pi / 3, -2 * math.pi / 3)
"""Angle of each module about the robot's z axis from module 1, rad (paper, Fig. 5)."""

GRAVITY = 9.81
"""Weight of a mass, N/kg, where a figure of the robot asks for it."""
REFERENCE_BORE = 0.16
"""Bore of the paper's pipe, m, for which control parameters with a unit are stated."""


LONGEST_PRESS = 1.0
"""By how much the springs may be pressed together in the nominal pipe, m, in a robot of scale 1: a
force that hardly changes with the bore asks for long springs, but hardly for longer ones."""


class Robot(QuantityModel):
    """Omnidirectional Tractable Three Module Robot, lumped as in the paper's simulation.

    SI units, radians. Frozen: change by ``robot.model_copy(update=...)`` or a scenario override,
    and the size by ``robot.scaled(factor)``.

    ``scale`` asks for the same robot in another size. Reading a robot scales every value by the
    law of dynamic similarity (``froude_exponent``), from the scale that the values are stated for,
    ``values_at_scale``, to ``scale``. A robot that has been read has the values of its own size
    and says so, ``values_at_scale == scale``, so that reading what it dumped changes nothing.

    Example:
        >>> import omnitrack_sim as ot
        >>> robot = ot.Robot(preload=30.0)
        >>> robot.nominal_bore, robot.mass
        (0.16, 1.0)
        >>> robot.scaled(2.0).nominal_bore
        0.32
        >>> robot.parameters()[2].name
        'lug_radius'
    """

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
        "slot clearance on the shafts (Section II.A); with 4 degrees turns jam in tees",
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
    drive: str = quantity(
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
        for name, info in cls.model_fields.items():
            # A value that is not given is the default, which is for scale 1.
            origin = stated.values_at_scale if name in stated.model_fields_set else 1.0
            value = getattr(stated, name)
            values[name] = (
                _plain_if_scaled(value, stated.scale)
                if isinstance(value, Motor)
                else similar(value, quantity_of(info).unit, stated.scale / origin)
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
            raise ValidationError.from_exception_data("Robot", faults)
        return robot

    def _misfits(self) -> Iterator[tuple[str, str]]:
        """Values, each within its range, that do not go together: the field to change, and the
        problem."""
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
        press, most = self.preload / self.module_stiffness, LONGEST_PRESS * self.scale
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
        """Torque of a third of the robot's weight at a module's shaft, N m: the worst steady
        climb."""
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

    def scale_for(self, bore: float) -> float:
        """Return the ``scale`` at which this robot is made for a bore of ``bore`` m."""
        return self.scale * bore / self.nominal_bore

    def own_length(self, length: ArrayLike) -> Array:
        """Return lengths that are given for the paper's pipe, m, in proportion to this robot."""
        # In this order a length such as 30 mm and its part of the bore give the same bits.
        return np.asarray(length, float) / REFERENCE_BORE * self.nominal_bore

    @property
    def length_scale(self) -> float:
        """Bore over the paper's, 1."""
        return self.nominal_bore / REFERENCE_BORE

    @property
    def time_scale(self) -> float:
        """Times over those in the paper's pipe, 1: the root of the lengths', at equal gravity
        (``froude_exponent``)."""
        return math.sqrt(self.length_scale)

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

    def spring_force(self, radius: float) -> float:
        """Return the force of a module's springs in a bore of ``radius`` m, N; 0 where they are
        slack."""
        return max(0.0, self.preload + self.module_stiffness * (self.nominal_pipe_radius - radius))

    @property
    def mass(self) -> float:
        """Whole robot, kg."""
        return self.chassis_mass + MODULES * (self.arm_mass + self.module_mass)

    @property
    def length(self) -> float:
        """Tip to tip along the robot axis, m: outermost lug centres and a lug radius at each
        end."""
        return self.contact_length + 2 * self.lug_radius

    @property
    def nose_room(self) -> float:
        """Room, m, between the nose and the port of a goal where the robot arrives: D/32."""
        return self.nominal_pipe_radius / 16

    @property
    def standing_room(self) -> float:
        """Room, m, between the nose and a fitting that the robot stops before to roll: D/8."""
        return self.nominal_pipe_radius / 4

    def parameters(self) -> list[Parameter]:
        """The parameter table: every field, and those of its motors as ``motor.NAME``, with value,
        unit, provenance and source."""
        return parameter_rows(self)


def _plain_if_scaled(motor: Motor, scale: float) -> Motor | dict[str, Any]:
    """The motor in a robot of ``scale``; as a table, which is checked, where it is another one."""
    scaled = motor.at_scale(scale)
    return motor if scaled is motor else scaled.model_dump()
