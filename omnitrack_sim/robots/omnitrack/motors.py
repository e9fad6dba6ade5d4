"""Gearmotors as values: ratio, rotor inertia, torque-speed line, torque limit and speed servo."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, ValidationError
from pydantic_core import InitErrorDetails, PydanticKnownError

from omnitrack_sim.base.naming import ByName
from omnitrack_sim.robots.quantity import SCALES, NamedTable, quantity, quantity_of, similar


class Motor(NamedTable):
    """A gearmotor with its speed servo. Speeds and torques are those of the output shaft.

    SI units, radians. Frozen: change by ``motor.model_copy(update=...)`` or a scenario override.
    Speed, torque and inertia are figures of their own: another ``gear_ratio`` alone changes the
    reflected inertia and nothing else. Ranges are those of motors for robots of every scale.

    Example:
        >>> import omnitrack_sim as ot
        >>> motor = ot.MOTORS["pololu_1000_hpcb"]
        >>> motor.no_load_speed  # rad/s
        3.62
        >>> strong = motor.model_copy(update={"torque_limit": 0.4})
        >>> ot.Omnitrack(motor=strong).motor.torque_limit
        0.4
    """

    name: str = quantity("custom", "", "assumed", "what messages call the motor", min_length=1)
    source: str = quantity("", "", "assumed", "where the motor's figures come from")
    gear_ratio: float = quantity(
        ..., "1", "published", "turns of the rotor in one turn of the output shaft", (0.1, 1e5)
    )
    rotor_inertia: float = quantity(
        ..., "kg m²", "assumed", "about the rotor's own axis, before the gears", (1e-16, 100.0)
    )
    no_load_speed: float = quantity(
        ..., "rad/s", "assumed", "where the torque-speed line meets zero torque", (1e-3, 1e5)
    )
    stall_torque: float = quantity(
        ..., "N m", "assumed", "where the torque-speed line meets zero speed", (1e-7, 1e7)
    )
    torque_limit: float = quantity(
        ..., "N m", "assumed", "what the motor or its current limit gives at most", (1e-7, 1e7)
    )
    efficiency: float = quantity(
        1.0,
        "1",
        "assumed",
        "part of its power that the gears pass on, from rotor to shaft and from shaft to rotor",
        (0.05, 1.0),
    )
    speed_bandwidth: float = quantity(
        18.0,
        "rad/s",
        "derived",
        "of the speed loop's proportional part, without load: its gain over the reflected "
        "inertia; see docs/explanation/control.md",
        (0.01, 1e5),
    )
    speed_integral_time: float = quantity(
        0.1, "s", "derived", "integral time of the speed loop", (1e-4, 1e6)
    )
    speed_droop: float = quantity(
        1.0,
        "rad/N m s",
        "derived",
        "speed by which a motor gives way for each unit of torque beyond the mean of the "
        "robot's motors; see docs/explanation/control.md",
        (0.0, 1e6),
    )
    scale: float | None = quantity(
        None,
        "",
        "assumed",
        "robot.scale that the figures are for, which then scale with the robot; none: a "
        "product, which has its figures in a robot of any size",
        SCALES,
    )

    @classmethod
    def shipped(cls) -> Mapping[str, Motor]:
        """See ``NamedTable``."""
        return MOTORS

    @property
    def reflected_inertia(self) -> float:
        """Rotor inertia as felt at the output shaft, kg m²: J ratio²."""
        return self.rotor_inertia * self.gear_ratio**2

    @property
    def full_torque_speed(self) -> float:
        """Fastest speed at which the torque-speed line leaves the whole torque limit, rad/s.

        It is 0 where the limit is beyond the stall torque.
        """
        return self.no_load_speed * max(0.0, 1 - self.torque_limit / self.stall_torque)

    def at_scale(self, scale: float) -> Self:
        """Return the motor in a robot of ``scale``: itself, or with all figures scaled to it.

        The result is not checked.
        """
        if self.scale is None or self.scale == scale:
            return self
        figures = {
            name: similar(
                getattr(self, name), quantity_of(type(self), name).unit, scale / self.scale
            )
            for name in type(self).model_fields
        }
        return self.model_copy(update=figures | {"scale": scale})


# The rotor's inertia is stated at the output, as 0.0088 kg m²: two digits of 9e-9 kg m² (a rotor of
# 2 g and 3 mm radius, assumed) times 986.41².
_PUBLISHED_RATIO = 986.41
_ROTOR_INERTIA = 0.0088 / _PUBLISHED_RATIO**2

MOTORS: Mapping[str, Motor] = MappingProxyType(
    ByName(
        (motor.name, motor)
        for motor in (
            Motor(
                name="simulation",
                source="the paper's simulation prescribes the speeds: a torque-speed line beyond "
                "what they need, limited to the published motor's extrapolated stall torque",
                gear_ratio=_PUBLISHED_RATIO,
                rotor_inertia=_ROTOR_INERTIA,
                no_load_speed=20.0,
                stall_torque=12.0,
                torque_limit=1.18,
                scale=1.0,
            ),
            Motor(
                # 34.6 rpm without load, 12 kg cm extrapolated stall torque, 2.5 kg cm recommended
                # limit.
                name="pololu_1000_hpcb",
                source="Pololu 1000:1 HPCB 12 V (986.41:1): 34.6 rpm, 12 kg cm and 2.5 kg cm, "
                "scaled from the maker's figures for the other ratios of the family",
                gear_ratio=_PUBLISHED_RATIO,
                rotor_inertia=_ROTOR_INERTIA,
                no_load_speed=3.62,
                stall_torque=1.18,
                torque_limit=0.245,
            ),
        )
    )
)
"""Shipped motors by name.

Example:
    >>> import omnitrack_sim as ot
    >>> list(ot.MOTORS)
    ['simulation', 'pololu_1000_hpcb']
"""


def _motor_of(given: Any) -> Any:
    """Return the motor, or its table, for an entry of a file.

    That is a shipped motor's name, or a table that may start from one with ``like``.
    """
    if isinstance(given, str):
        if given not in MOTORS:
            raise PydanticKnownError("literal_error", {"expected": _CHOICES})
        return MOTORS[given]
    if isinstance(given, Mapping) and "like" in given:
        like = given["like"]
        if not isinstance(like, str) or like not in MOTORS:
            fault = InitErrorDetails(
                type="literal_error", loc=("like",), input=like, ctx={"expected": _CHOICES}
            )
            raise ValidationError.from_exception_data("Motor", [fault])
        # Name and source belong to the shipped figures, which the table is about to change.
        start = MOTORS[like].model_dump(exclude={"name", "source"})
        return start | {key: value for key, value in given.items() if key != "like"}
    return given


_CHOICES = " or ".join(map(repr, MOTORS))

NamedMotor = Annotated[Motor, BeforeValidator(_motor_of)]
"""A motor, the name of a shipped one, or a motor's table; ``like = NAME`` in a table takes what it
does not give from a shipped motor."""
