"""Gearmotors as values: gears, torque-speed line, limits, winding and speed servo."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Self, TypeVar

import numpy as np
from pydantic import BeforeValidator, ValidationError, ValidationInfo, field_validator
from pydantic_core import InitErrorDetails, PydanticKnownError

from omnitrack_sim.base.naming import ByName
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.quantity import (
    SCALES,
    NamedTable,
    QuantityModel,
    quantity,
    quantity_of,
    similar,
)

COPPER = 0.00393
"""Share by which the resistance of copper grows with each kelvin above 20 °C."""
AMBIENT = 20.0
"""Temperature of a motor at the start and of what is around it, °C."""


class Winding(QuantityModel):
    """The electrical and thermal side of a motor: of its rotor's winding, before the gears.

    Example:
        >>> import omnitrack_sim as ot
        >>> winding = ot.MOTORS["pololu_1000_hpcb"].winding
        >>> winding.resistance, winding.torque_constant  # ohm, N m/A
        (16.0, 0.003)
    """

    resistance: float = quantity(..., "Ω", "assumed", "at 20 °C, brushes included", (1e-4, 1e6))
    torque_constant: float = quantity(
        ...,
        "N m/A",
        "assumed",
        "torque of the rotor for its current, and back-EMF in V for its speed in rad/s",
        (1e-7, 1e3),
    )
    no_load_current: float = quantity(
        0.0, "A", "assumed", "what friction takes while nothing is driven", (0.0, 1e3)
    )
    current_limit: float | None = quantity(
        None, "A", "assumed", "what the driver lets through; none: as much as flows", (1e-6, 1e4)
    )
    thermal_resistance: float = quantity(
        10.0, "K/W", "assumed", "from the winding to the housing", (1e-3, 1e4)
    )
    thermal_time: float = quantity(
        5.6, "s", "assumed", "in which the winding warms against the housing", (1e-2, 1e5)
    )
    housing_resistance: float = quantity(
        40.0, "K/W", "assumed", "thermal, from the housing to what is around it", (1e-3, 1e4)
    )
    housing_time: float = quantity(220.0, "s", "assumed", "in which the housing warms", (1e-2, 1e6))

    @field_validator("current_limit")
    @classmethod
    def _moves_the_rotor(cls, value: float | None, info: ValidationInfo) -> float | None:
        friction = info.data.get("no_load_current", 0.0)
        if value is not None and value <= friction:
            raise ValueError(f"must be over no_load_current, {friction:g} A, to turn the rotor")
        return value

    def temperature(self, time: Array, current: Array) -> Array:
        """Return temperatures (T, ...) °C of the winding with currents (T, ...) A at times (T,) s.

        At first the motor is as cold as what is around it. Winding and housing warm by
        exponentials, as makers state them: a heat P lifts each by R (1 - exp(-t / tau)) P. The
        resistance of the winding grows with its temperature.
        """
        steps, heats = np.diff(time), self.resistance * (current[1:] ** 2 + current[:-1] ** 2) / 2
        decays = [np.exp(-steps / tau).tolist() for tau in (self.thermal_time, self.housing_time)]
        columns = [self._rises(heat, *decays) for heat in heats.T.tolist()]
        return AMBIENT + np.array(columns).T

    def _rises(self, heats: list[float], inner: list[float], outer: list[float]) -> list[float]:
        """Rises of the temperature, K, with heats, W, of the cold winding, and decays of a step."""
        over_housing = of_housing = 0.0
        found = [0.0]
        for heat, winding, housing in zip(heats, inner, outer, strict=True):
            hot = heat * (1 + COPPER * found[-1])
            over_housing = over_housing * winding + hot * self.thermal_resistance * (1 - winding)
            of_housing = of_housing * housing + hot * self.housing_resistance * (1 - housing)
            found.append(over_housing + of_housing)
        return found


class Motor(NamedTable):
    """A gearmotor with its speed servo. Speeds and torques are those of the output shaft.

    SI units, radians. Frozen: change by ``motor.model_copy(update=...)`` or a scenario override.
    Speed, torque and inertia are figures of their own: another ``gear_ratio`` alone changes the
    reflected inertia and the current, and nothing else. Ranges are those of motors for robots of
    every scale.

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
        ..., "N m", "assumed", "most that the motor is asked for, see also `winding`", (1e-7, 1e7)
    )
    recommended_torque: float | None = quantity(
        None, "N m", "assumed", "that its maker advises not to exceed; none: not known", (1e-7, 1e7)
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
    winding: Winding | None = quantity(
        None, "", "assumed", "what tells current, heat and temperature; none: not known"
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
    def max_torque(self) -> float:
        """Largest driving torque, N m: ``torque_limit``, or what the driver lets through."""
        winding = self.winding
        if winding is None or winding.current_limit is None:
            return self.torque_limit
        return min(self.torque_limit, self.torque_at(winding.current_limit))

    @property
    def full_torque_speed(self) -> float:
        """Fastest speed at which the torque-speed line leaves the whole of ``max_torque``, rad/s.

        It is 0 where that is beyond the stall torque.
        """
        return self.no_load_speed * max(0.0, 1 - self.max_torque / self.stall_torque)

    @property
    def friction_torque(self) -> float:
        """Friction of rotor and brushes as felt at the shaft through gears without loss, N m."""
        winding = self.winding
        return 0.0 if winding is None else self.torque_per_ampere * winding.no_load_current

    @property
    def backdriving_torque(self) -> float:
        """Torque at the shaft, N m, that turns the motor while it is off, cogging left out."""
        return self.friction_torque / self.efficiency

    @property
    def torque_per_ampere(self) -> float:
        """Torque, N m, of each ampere at the shaft without any loss; nan without a winding."""
        winding = self.winding
        return math.nan if winding is None else self.gear_ratio * winding.torque_constant

    def torque_at(self, current: float) -> float:
        """Return the torque at the driving shaft, N m, with a current of ``current`` A.

        Raises:
            ValueError: the motor has no ``winding``.
        """
        self._check_winding()
        return self.efficiency * max(0.0, self.torque_per_ampere * current - self.friction_torque)

    def current(self, torque: Array, speed: Array) -> Array:
        """Return the size of the current, A, that the shaft's torque takes at a speed.

        Driving, the gears take their part and friction comes on top. Against its direction of
        turning the motor has to give only what these do not hold. At rest it counts as driving.
        Beyond ``max_torque`` losses hold the rest.

        Args:
            torque: (...,) N m at the shaft.
            speed: (...,) rad/s of the shaft.

        Raises:
            ValueError: the motor has no ``winding``.

        Example:
            >>> import numpy as np
            >>> import omnitrack_sim as ot
            >>> motor = ot.MOTORS["pololu_1000_hpcb"]
            >>> motor.current(np.array([0.0, 0.245, 1.18]), np.array([3.62, 2.87, 0.0])).round(3)
            array([0.08 , 0.219, 0.75 ])
        """
        self._check_winding()
        own = self.efficiency, self.friction_torque, self.max_torque, self.torque_per_ampere
        return current_of(torque, speed, *own)

    def _check_winding(self) -> None:
        if self.winding is None:
            raise ValueError(f"motor {self.name!r} has no winding, which tells its current")

    def electric_power(self, torque: Array, speed: Array) -> Array:
        """Return the power (...,) W that the motor takes from its supply, at 20 °C.

        Arguments and error are those of ``current``. It is negative where a braking motor feeds its
        supply.
        """
        current, winding = self.current(torque, speed), self.winding
        assert winding is not None
        driving = torque * speed >= 0
        held = self.efficiency * np.abs(torque) > self.friction_torque
        back_emf = winding.torque_constant * self.gear_ratio * np.abs(speed)
        emf = np.where(driving | ~held, back_emf, -back_emf)
        return winding.resistance * current**2 + emf * current

    def at_scale(self, scale: float) -> Self:
        """Return the motor in a robot of ``scale``: itself, or with all figures scaled to it.

        The result is not checked.
        """
        if self.scale is None or self.scale == scale:
            return self
        factor = scale / self.scale
        winding = None if self.winding is None else _similar_to(self.winding, factor)
        return _similar_to(self, factor).model_copy(update={"scale": scale, "winding": winding})


def current_of(
    torque: Array,
    speed: Array,
    efficiency: Array | float,
    friction: Array | float,
    limit: Array | float,
    torque_per_ampere: Array | float,
) -> Array:
    """Return the sizes of motors' currents, A; see ``Motor.current``.

    Args:
        torque: (...,) N m at the shaft.
        speed: (...,) rad/s of the shaft.
        efficiency: of each motor, or of all.
        friction: N m, ``Motor.friction_torque``.
        limit: N m, ``Motor.max_torque``.
        torque_per_ampere: N m/A.
    """
    driving, size = torque * speed >= 0, np.abs(torque)
    before = np.where(driving, size / efficiency, -size * efficiency)
    most = limit / efficiency + friction
    return np.minimum(np.abs(before + friction), most) / torque_per_ampere


_Figures = TypeVar("_Figures", bound=QuantityModel)


def _similar_to(table: _Figures, factor: float) -> _Figures:
    """Figures of a robot ``factor`` times as large."""
    figures = {
        name: similar(getattr(table, name), quantity_of(type(table), name).unit, factor)
        for name in type(table).model_fields
    }
    return table.model_copy(update=figures)


WINDING_FIGURES = tuple(Winding.model_fields)
MOTOR_FIGURES = tuple(
    name for name in Motor.model_fields if name not in ("name", "source", "winding", "scale")
)
"""Numbers of a motor and of its winding, in which robots of one batch may differ."""

# The rotor's inertia is stated at the output, as 0.0088 kg m²: two digits of 9e-9 kg m² (a rotor of
# 2 g and 3 mm radius, assumed) times 986.41².
_PUBLISHED_RATIO = 986.41
_ROTOR_INERTIA = 0.0088 / _PUBLISHED_RATIO**2
_RECOMMENDED = 0.245
"""N m, 2.5 kg cm: the maker's upper limit of the torque of gearboxes of this ratio."""

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
                recommended_torque=_RECOMMENDED,
                scale=1.0,
            ),
            Motor(
                # 34.6 rpm without load and 12 kg cm extrapolated stall torque.
                name="pololu_1000_hpcb",
                source="Pololu 1000:1 HPCB 12 V (986.41:1): 34.6 rpm and 12 kg cm, scaled from the "
                "maker's figures for other ratios; 2.5 kg cm, 0.75 A and 80 mA of its pages; see "
                "docs/explanation/physics.md",
                gear_ratio=_PUBLISHED_RATIO,
                rotor_inertia=_ROTOR_INERTIA,
                no_load_speed=3.62,
                stall_torque=1.18,
                torque_limit=1.18,
                recommended_torque=_RECOMMENDED,
                efficiency=0.595,
                winding=Winding(resistance=16.0, torque_constant=0.003, no_load_current=0.08),
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
        own = {key: value for key, value in given.items() if key != "like"}
        if isinstance(own.get("winding"), Mapping) and start["winding"] is not None:
            own["winding"] = start["winding"] | own["winding"]
        return start | own
    return given


_CHOICES = " or ".join(map(repr, MOTORS))

NamedMotor = Annotated[Motor, BeforeValidator(_motor_of)]
"""A motor, the name of a shipped one, or a motor's table; ``like = NAME`` in a table takes what it
does not give from a shipped motor."""
