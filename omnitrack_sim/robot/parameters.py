"""The robot's parameters, each with its unit and where it comes from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

MODULES = 3
MODULE_ANGLES = (0.0, 2 * math.pi / 3, -2 * math.pi / 3)
"""Angle of each module about the robot's z axis from module 1, rad (paper, Fig. 5)."""

Provenance = Literal["published", "derived", "inferred", "assumed", "numerical"]


@dataclass(frozen=True)
class Quantity:
    """Unit, provenance and source of one parameter; stands in the field's annotation."""

    unit: str
    provenance: Provenance
    source: str


@dataclass(frozen=True)
class Parameter:
    """One row of the parameter table."""

    name: str
    value: Any
    unit: str
    provenance: Provenance
    source: str


class Robot(BaseModel):
    """Omnidirectional Tractable Three Module Robot, lumped as in the paper's simulation.

    SI units, radians. Frozen: change by ``robot.model_copy(update=...)`` or a scenario override.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    lug_radius: Annotated[
        float,
        Field(gt=0),
        Quantity("m", "derived", "r = V / theta_dot: 100 mm/s at the motor's no-load 3.62 rad/s"),
    ] = 0.0276
    reach: Annotated[
        float,
        Field(gt=0),
        Quantity(
            "m",
            "inferred",
            "axis to lug surface, springs extended; what the 96.54 degree sector needs",
        ),
    ] = 0.0961
    nominal_pipe_radius: Annotated[
        float,
        Field(gt=0),
        Quantity("m", "published", "Section II.A: 160 mm pipe; the slide coordinate is zero here"),
    ] = 0.080
    slide_travel_inward: Annotated[
        float,
        Field(gt=0),
        Quantity("m", "assumed", "arm travel from the nominal pipe towards the axis"),
    ] = 0.018
    contact_length: Annotated[
        float,
        Field(gt=0),
        Quantity("m", "assumed", "length of the contact line of a track; see docs/design-study.md"),
    ] = 0.090
    lugs_per_track: Annotated[
        int,
        Field(ge=1, le=200),
        Quantity("1", "numerical", "fine limit of the contact line; see docs/design-study.md"),
    ] = 15
    track_offset: Annotated[
        float,
        Field(gt=0),
        Quantity(
            "m",
            "numerical",
            "lug centres of the two tracks lie this far above and below the module axis",
        ),
    ] = 0.001
    spring_stiffness: Annotated[
        float, Field(gt=0), Quantity("N/m", "published", "Section VI: 0.5 N/mm, each spring")
    ] = 500.0
    springs_per_module: Annotated[
        int,
        Field(ge=2, multiple_of=2),
        Quantity("1", "derived", "Section II.A: four shafts a module, a spring on each"),
    ] = 4
    preload: Annotated[
        float,
        Field(ge=0),
        Quantity("N", "assumed", "force of a module's springs in the nominal pipe"),
    ] = 25.0
    shaft_spacing: Annotated[
        float,
        Field(gt=0),
        Quantity("m", "assumed", "front to rear shafts; sets the pitch stiffness of an arm"),
    ] = 0.140
    pitch_limit: Annotated[
        float,
        Field(gt=0, lt=0.5),
        Quantity("rad", "assumed", "slot clearance on the shafts (Section II.A)"),
    ] = math.radians(4.0)
    slide_damping: Annotated[
        float, Field(ge=0), Quantity("N s/m", "assumed", "sliding friction of an arm on its shafts")
    ] = 20.0
    pitch_damping: Annotated[
        float,
        Field(ge=0),
        Quantity("N m s/rad", "assumed", "as slide_damping, about the pitch axis"),
    ] = 0.05
    chassis_mass: Annotated[
        float, Field(gt=0), Quantity("kg", "assumed", "ABS chassis and steel shafts")
    ] = 0.28
    chassis_length: Annotated[
        float, Field(gt=0), Quantity("m", "assumed", "centre chassis along the robot axis")
    ] = 0.150
    arm_mass: Annotated[
        float, Field(gt=0), Quantity("kg", "assumed", "one arm pair, without its module")
    ] = 0.04
    module_mass: Annotated[
        float, Field(gt=0), Quantity("kg", "assumed", "one module: two gearmotors, chains, lugs")
    ] = 0.20
    motor: Annotated[
        Literal["simulation", "pololu_1000_hpcb"],
        Quantity("", "assumed", "crawler motor; see omnitrack_sim.robot.drive.MOTORS"),
    ] = "simulation"
    torque_limit: Annotated[
        float | None,
        Field(gt=0),
        Quantity("N m", "assumed", "limit on a crawler motor; none: the motor's own"),
    ] = None
    roll_rate: Annotated[
        float,
        Field(gt=0),
        Quantity(
            "rad/s", "assumed", "largest speed of the rotary motor (same gearmotor: 3.62 no-load)"
        ),
    ] = 1.5
    roll_torque: Annotated[
        float,
        Field(gt=0),
        Quantity("N m", "assumed", "limit on a rotary motor (same gearmotor as the crawler's)"),
    ] = 1.2

    @property
    def module_distance(self) -> float:
        """Module axis from robot axis in the nominal pipe, m: l = R - r (Table 1)."""
        return self.nominal_pipe_radius - self.lug_radius

    @property
    def module_stiffness(self) -> float:
        """Radial stiffness of one module's springs together, N/m."""
        return self.spring_stiffness * self.springs_per_module

    @property
    def pitch_stiffness(self) -> float:
        """Pitch stiffness of one arm while all its springs are loaded, N m/rad: k (spacing /
        2)^2."""
        return self.module_stiffness * (self.shaft_spacing / 2) ** 2

    @property
    def slide_range(self) -> tuple[float, float]:
        """Travel of an arm from the nominal pipe radius, m, outward positive."""
        return -self.slide_travel_inward, self.reach - self.nominal_pipe_radius

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
    def standing_room(self) -> float:
        """Room, m, between the nose and a fitting that the robot stops before to roll: D/8."""
        return self.nominal_pipe_radius / 4

    def parameters(self) -> list[Parameter]:
        """The parameter table: every field with value, unit, provenance and source."""
        rows = []
        for name, info in type(self).model_fields.items():
            quantity = next(item for item in info.metadata if isinstance(item, Quantity))
            rows.append(
                Parameter(
                    name, getattr(self, name), quantity.unit, quantity.provenance, quantity.source
                )
            )
        return rows
