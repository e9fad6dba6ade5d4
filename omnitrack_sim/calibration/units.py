"""Units of measured columns, converted to coherent SI units."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from omnitrack_sim.base.errors import Fault, InputError

Dimension = tuple[float, ...]
"""Exponents of metre, kilogram, second, ampere and kelvin."""


class Unit(NamedTuple):
    """A unit of measurement.

    Attributes:
        factor: number of coherent SI units, radians among them, in one of it.
        dimension: exponents of the base units.
    """

    factor: float
    dimension: Dimension


_NONE: Dimension = (0, 0, 0, 0, 0)
_FORCE, _TORQUE, _POWER = (1, 1, -2, 0, 0), (2, 1, -2, 0, 0), (2, 1, -3, 0, 0)
_GRAVITY = 9.80665  # m/s², of the definition of kilogram-force
_PREFIXES = {"": 1.0, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6}
_WITH_PREFIX = {
    "m": Unit(1.0, (1, 0, 0, 0, 0)),
    "g": Unit(1e-3, (0, 1, 0, 0, 0)),
    "s": Unit(1.0, (0, 0, 1, 0, 0)),
    "A": Unit(1.0, (0, 0, 0, 1, 0)),
    "N": Unit(1.0, _FORCE),
    "Nm": Unit(1.0, _TORQUE),
    "W": Unit(1.0, _POWER),
    "J": Unit(1.0, _TORQUE),
    "V": Unit(1.0, (2, 1, -3, -1, 0)),
    "Ω": Unit(1.0, (2, 1, -3, -2, 0)),
    "Hz": Unit(1.0, (0, 0, -1, 0, 0)),
    "rad": Unit(1.0, _NONE),
}
_AS_THEY_ARE = {
    "1": Unit(1.0, _NONE),
    "code": Unit(1.0, _NONE),
    "%": Unit(0.01, _NONE),
    "deg": Unit(math.pi / 180, _NONE),
    "°": Unit(math.pi / 180, _NONE),
    "rev": Unit(2 * math.pi, _NONE),
    "rpm": Unit(2 * math.pi / 60, (0, 0, -1, 0, 0)),
    "min": Unit(60.0, (0, 0, 1, 0, 0)),
    "h": Unit(3600.0, (0, 0, 1, 0, 0)),
    "in": Unit(0.0254, (1, 0, 0, 0, 0)),
    "ft": Unit(0.3048, (1, 0, 0, 0, 0)),
    "lb": Unit(0.45359237, (0, 1, 0, 0, 0)),
    "lbf": Unit(0.45359237 * _GRAVITY, _FORCE),
    "kgf": Unit(_GRAVITY, _FORCE),
    "gf": Unit(1e-3 * _GRAVITY, _FORCE),
    "Ncm": Unit(1e-2, _TORQUE),
    "Nmm": Unit(1e-3, _TORQUE),
    "K": Unit(1.0, (0, 0, 0, 0, 1)),
    "°C": Unit(1.0, (0, 0, 0, 0, 1)),
    "g0": Unit(_GRAVITY, (1, 0, -2, 0, 0)),
}
_KNOWN = _AS_THEY_ARE | {
    prefix + name: Unit(factor * unit.factor, unit.dimension)
    for name, unit in _WITH_PREFIX.items()
    for prefix, factor in _PREFIXES.items()
    if prefix + name not in _AS_THEY_ARE
}
_POWERS = {"²": 2, "³": 3, "^2": 2, "^3": 3, "": 1}
_FACTOR = re.compile(r"(.+?)(²|³|\^2|\^3|)")


def unit_of(text: str, where: str) -> Unit:
    """Return the unit that a text names, such as "mm/s", "N cm", "deg/s" or "kg m²"; "" is "1".

    Args:
        text: products of units with ², ³, ^2 or ^3, over at most one stroke.
        where: place of the text, for the error.

    Raises:
        InputError: a unit that is not known.

    Example:
        >>> from omnitrack_sim.calibration.units import unit_of
        >>> unit_of("mm/s", "columns.distance").factor
        0.001
    """
    above, _, below = text.replace("·", " ").replace("*", " ").partition("/")
    factor, dimension = 1.0, _NONE
    for part, sign in ((above, 1), (below, -1)):
        for word in part.split():
            unit = _power(word, text, where)
            factor *= unit.factor**sign
            pairs = zip(dimension, unit.dimension, strict=True)
            dimension = tuple(own + sign * its for own, its in pairs)
    return Unit(factor, dimension)


def named_units(dimension: Dimension) -> list[str]:
    """Return the units of a dimension that have names of their own, without prefixes."""
    known = _WITH_PREFIX | _AS_THEY_ARE
    return [name for name, unit in known.items() if unit.dimension == dimension]


def _power(word: str, text: str, where: str) -> Unit:
    """Return one unit with its power."""
    match = _FACTOR.fullmatch(word)
    name, power = (match[1], _POWERS[match[2]]) if match else (word, 1)
    if name not in _KNOWN:
        choices = (*_WITH_PREFIX, *_AS_THEY_ARE)
        raise InputError(Fault(where, f"has the unit {text!r}", choices, given=name))
    unit = _KNOWN[name]
    return Unit(unit.factor**power, tuple(power * each for each in unit.dimension))
