"""The law of dynamic similarity under gravity (Froude): how each quantity grows with the robot.

Two robots of one shape move alike under the same gravity when lengths grow by s, masses by s³
(the same materials) and times by sqrt(s). A length over a time squared is an acceleration, and
s / sqrt(s)² = 1 leaves it at that of gravity. Every other exponent follows from the unit: forces
grow by s³, torques by s⁴, stiffnesses by s², speeds by sqrt(s), angles and ratios not at all.
"""

from __future__ import annotations

from typing import TypeVar

SCALES = (0.1, 20.0)
"""Smallest and largest robot: for pipes of 16 mm and of 3.2 m. In a smaller one the inertia of a
run of lugs, which falls with the fifth power, is no longer a number that MuJoCo takes."""
_EXPONENTS = {"1": 0.0, "rad": 0.0, "m": 1.0, "kg": 3.0, "s": 0.5, "N": 3.0}
_POWERS = {"": 1, "²": 2, "³": 3}
_Value = TypeVar("_Value")


def froude_exponent(unit: str) -> float:
    """Exponent of the scale factor s by which a quantity of this unit grows.

    Args:
        unit: products of m, kg, s, N, rad and 1, with ² or ³, over at most one stroke, such as
            "N m s/rad"; empty for what has no unit.

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
