"""Unit, provenance, source and range of a parameter, and the table of a robot's parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, Literal, TypeVar, get_args

from pydantic import BaseModel, Field, ValidationInfo, field_validator

from omnitrack_sim.base.table import Table, meanings_of, symbol_of

Provenance = Literal["published", "derived", "inferred", "assumed", "numerical", "unstated"]
"""Kind of the source of a value; "unstated" where a field is not declared by ``quantity``."""


_Value = TypeVar("_Value")
_Table = TypeVar("_Table", bound=BaseModel)


@dataclass(frozen=True)
class Quantity:
    """Unit, provenance and source of one parameter.

    Attributes:
        unit: empty for values that are no numbers.
        provenance: kind of the source.
        source: meaning, and place in a publication or reason.
        within: range of a number, both ends included, for a robot of scale 1, with which it scales;
            None for values without one.
    """

    unit: str
    provenance: Provenance
    source: str
    within: tuple[float, float] | None = None

    def range_at(self, scale: float) -> tuple[float, float] | None:
        """The range for a robot of ``scale``."""
        if self.within is None:
            return None
        low, high = (similar(end, self.unit, scale) for end in self.within)
        return low, high


@dataclass(frozen=True, kw_only=True)
class Parameter(Quantity):
    """One row of the parameter table; ``name`` is the dotted path below the model."""

    name: str
    value: Any


ROUNDING = 1e-9
"""Part of a limit by which a number that was scaled may miss it."""


class QuantityModel(Table):
    """Table whose fields are declared by ``quantity``; checks the range of every number.

    Numbers are for a robot of the scale that the field ``values_at_scale`` gives, where the model
    has one, and of scale 1 elsewhere.
    """

    @field_validator("*")
    @classmethod
    def _is_in_its_range(cls, value: Any, info: ValidationInfo) -> Any:
        quantity = quantity_of(cls, str(info.field_name))
        scale = info.data.get("values_at_scale", 1.0)
        within = quantity.range_at(scale)
        if within is None or not isinstance(value, int | float):
            return value
        low, high = within
        if not low - ROUNDING * abs(low) <= value <= high + ROUNDING * abs(high):
            unit = "" if quantity.unit in ("", "1") else f" {quantity.unit}"
            at = "" if scale == 1 else f" at scale {scale:g}"
            raise ValueError(f"must be from {low:.6g} to {high:.6g}{unit}{at}")
        return value


class NamedTable(QuantityModel):
    """Table of figures in whose place a file may give the name of a shipped one.

    A table in a file may take over the figures of a shipped one by ``like = NAME``.
    """

    OTHER_KEYS: ClassVar[tuple[str, ...]] = ("like",)
    name: str

    @classmethod
    def shipped(cls) -> Mapping[str, NamedTable]:
        """Return the tables that come with the package, by name."""
        raise NotImplementedError


def quantity(
    default: Any,
    unit: str,
    provenance: Provenance,
    source: str,
    within: tuple[float, float] | None = None,
    **constraints: Any,
) -> Any:
    """Declare a parameter of a robot, or another field of a ``QuantityModel``.

    Args:
        default: its value; ``...`` where it must be given.
        unit: such as "m" or "N m s/rad"; "1" for a ratio or a count, "" for what is no number.
        provenance: kind of the source of the default.
        source: meaning, and place in a publication or reason.
        within: range of a number, both ends included.
        **constraints: of ``pydantic.Field``.

    Example:
        >>> class Crawler(ot.Robot):
        ...     speed: float = ot.quantity(0.05, "m/s", "assumed", "of its wheels", (0.0, 1.0))
        >>> Crawler.model_fields["speed"].description
        'of its wheels'
    """
    # pydantic carries these along: unit and source stand in one place with the value.
    extra: Any = {"unit": unit, "provenance": provenance, "within": within}
    return Field(default, description=source, json_schema_extra=extra, **constraints)


@cache
def quantity_of(table: type[BaseModel], key: str) -> Quantity:
    """Return unit and source of a field.

    One that is not declared by ``quantity`` has the meaning that stands below it and no provenance.
    """
    info = table.model_fields[key]
    extra: Any = info.json_schema_extra
    if extra is None:
        return Quantity(symbol_of(table, key), "unstated", meanings_of(table).get(key, ""))
    return Quantity(source=info.description or "", **extra)


def unit_at(table: type[BaseModel], path: str) -> str | None:
    """Return the unit of the field at a dotted path below a table, None where there is no field.

    Example:
        >>> from omnitrack_sim.robots.quantity import unit_at
        >>> unit_at(ot.Omnitrack, "motor.stall_torque")
        'N m'
    """
    name, _, rest = path.partition(".")
    info = table.model_fields.get(name)
    if info is None:
        return None
    if not rest:
        return symbol_of(table, name)
    units = (unit_at(inner, rest) for inner in _tables_in(info.annotation))
    return next((unit for unit in units if unit is not None), None)


def _tables_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables that a type is or is made of, such as those of a union."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _tables_in(part)


def borrowed(whose: str) -> Callable[[type[_Table]], type[_Table]]:
    """Decorate a robot that inherits from another one: what it does not declare anew is assumed.

    Args:
        whose: words before the sources of the other robot.
    """

    def mark(table: type[_Table]) -> type[_Table]:
        for name, info in table.model_fields.items():
            extra: Any = info.json_schema_extra
            if name not in table.__annotations__ and extra["provenance"] != "numerical":
                info.json_schema_extra = extra | {"provenance": "assumed"}
                info.description = f"{whose}: {info.description}"
        return table

    return mark


def parameter_rows(model: BaseModel, prefix: str = "") -> list[Parameter]:
    """Return value, unit, provenance and source of every field of a model and those in it.

    Args:
        model: robot, motor or the like.
        prefix: stands before every name, such as "motor.".
    """
    rows: list[Parameter] = []
    for name in type(model).model_fields:
        value, quantity = getattr(model, name), quantity_of(type(model), name)
        if isinstance(value, BaseModel):
            rows += parameter_rows(value, f"{prefix}{name}.")
        else:
            within = quantity.range_at(getattr(model, "values_at_scale", 1.0))
            scaled = replace(quantity, within=within)
            rows.append(Parameter(name=prefix + name, value=value, **vars(scaled)))
    return rows


SCALES = (0.1, 20.0)
"""Smallest and largest robot: for pipes of 16 mm and of 3.2 m. In a smaller one the inertia of a
run of lugs, which falls with the fifth power, is no longer a number that MuJoCo takes."""
# At equal gravity and density times grow with the root of lengths, masses and forces with their
# cube.
# Windings of similar motors are taken to have the same currents and temperatures: a power is then
# that of torque and speed, and so is the heat in a resistance.
_EXPONENTS = {
    "1": 0.0,
    "rad": 0.0,
    "m": 1.0,
    "kg": 3.0,
    "s": 0.5,
    "N": 3.0,
    "A": 0.0,
    "K": 0.0,
    "W": 3.5,
    "Ω": 3.5,
}
_POWERS = {"": 1, "²": 2, "³": 3}


@cache
def froude_exponent(unit: str) -> float:
    """Exponent of the scale factor s by which a quantity of this unit grows.

    Args:
        unit: products of m, kg, s, N, A, W, Ω, K, rad and 1, with ² or ³, over at most one stroke,
            such as "N m s/rad"; empty for what has no unit.

    Raises:
        ValueError: a unit that is not made of these.
    """
    above, _, below = unit.partition("/")
    return _exponent_of_product(above, unit) - _exponent_of_product(below, unit)


def _exponent_of_product(factors: str, unit: str) -> float:
    total = 0.0
    for factor in factors.split():
        symbol = factor.rstrip("²³")
        power = factor.removeprefix(symbol)
        if symbol not in _EXPONENTS or power not in _POWERS:
            raise ValueError(f"{factor!r} in the unit {unit!r} is not known to the scaling law")
        total += _EXPONENTS[symbol] * _POWERS[power]
    return total


def similar(value: _Value, unit: str, factor: float) -> _Value:
    """``value`` of a robot ``factor`` times as large; what is no number or has no dimension stays.

    A factor of exactly 1 returns the very same number.
    """
    exponent = froude_exponent(unit)
    if exponent == 0 or not isinstance(value, int | float):
        return value
    return value * factor**exponent
