"""Parameters of a fit: the keys of scenarios, their ranges, and what is known of them before."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from omnitrack_sim.base.errors import Fault, InputError, ScenarioError
from omnitrack_sim.base.paths import matches, value_at
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.robots.quantity import Provenance
from omnitrack_sim.scenario import Scenario, override
from omnitrack_sim.scenario.model import unit_of

TIMES = 10.0
"""A value is looked for from its start over this to its start times this: no estimate of a robot's
maker is worse, and beyond runs say nothing of the robot at hand."""
PRIOR: Mapping[Provenance, float] = {"published": 0.1, "derived": 0.1, "inferred": 0.25}
"""Standard deviation of what is known before of the logarithm of a value, by where the value is
from. One robot differs from the figure of its kind by the tolerances of its parts, some hundredths,
and of springs and motors up to a tenth."""
ASSUMED = math.log(2)
"""The same of all others, such as assumed ones: right within a factor of two. It decides only what
the logs do not tell, between several values that meet them as well."""
_BISECTIONS = 14
"""Halvings with which the end of the valid range is found: to 1/16000 of the range."""


@dataclass(frozen=True)
class Parameter:
    """A number of scenarios that a fit adjusts.

    Attributes:
        path: dotted, `*` as in sweeps.
        start: its value before the fit.
        low: lower end of its range.
        high: upper end.
        unit: empty without one.
        provenance: of the start value.
        prior: standard deviation of what is known before about ``start``.
    """

    path: str
    start: float
    low: float
    high: float
    unit: str
    provenance: Provenance
    prior: float

    @property
    def scale(self) -> float:
        """Size of its values, by which steps and doubts are measured."""
        return abs(self.start) or (self.high - self.low) / 2


Fit = Sequence[str] | Mapping[str, tuple[float, float] | None]
"""Paths of what is fitted, or their ranges by path; None for that of the key."""


def parameters_of(fit: Fit, scenarios: Sequence[Scenario]) -> list[Parameter]:
    """Return the parameters of a fit in the light of the scenarios of its logs.

    Raises:
        InputError: lists every path that leads to no number, and every range that does not fit.
    """
    faults: list[Fault] = []
    found: list[Parameter] = []
    ranges = dict(fit) if isinstance(fit, Mapping) else dict.fromkeys(fit)
    for path, within in ranges.items():
        try:
            found.append(_parameter(path, within, scenarios))
        except InputError as error:
            faults += error.faults
    faults += _twice(found, scenarios)
    if not ranges:
        faults.append(Fault("fit", "is empty; name one key or more, such as world.friction"))
    if faults:
        raise InputError(faults)
    return found


def places_in(scenario: Scenario, path: str) -> list[str]:
    """Return the places of a scenario that a path leads to."""
    return matches(scenario.model_dump(mode="json"), path)


def _twice(found: Sequence[Parameter], scenarios: Sequence[Scenario]) -> Iterator[Fault]:
    """Faults of places that two paths lead to."""
    owners: dict[str, str] = {}
    for parameter in found:
        for place in {place for one in scenarios for place in places_in(one, parameter.path)}:
            if owners.setdefault(place, parameter.path) != parameter.path:
                yield Fault(f"fit: {parameter.path}", f"{place!r} is fitted by {owners[place]} too")


def _parameter(
    path: str, within: tuple[float, float] | None, scenarios: Sequence[Scenario]
) -> Parameter:
    """Return one parameter, with its start from the first scenario that has it."""
    where = f"fit: {path}"
    scenario = next((one for one in scenarios if places_in(one, path)), None)
    if scenario is None:
        raise InputError(_unknown(where, path, scenarios[0].model_dump(mode="json")))
    data = scenario.model_dump(mode="json")
    value = value_at(data, matches(data, path)[0])
    _refuse_no_number(where, value)
    start = float(value)
    declared, provenance = _declared(scenario, path)
    low, high = _range(where, start, declared, within)
    if within is None:
        low, high = (_valid_end(scenario, path, start, end) for end in (low, high))
    # A range that somebody gives is what is known before.
    flat = (high - low) / math.sqrt(12)
    part = PRIOR.get(provenance, ASSUMED) * abs(start)
    prior = min(part, flat) if part and within is None else flat
    unit = unit_of(path, [one.robot for one in scenarios]) or ""
    return Parameter(path, start, low, high, unit, provenance, prior)


def _unknown(where: str, path: str, data: Mapping[str, Any]) -> Fault:
    """Fault of a path that leads nowhere, with the choices where it leaves the scenario."""
    keys = path.split(".")
    depth = next(i for i in range(len(keys)) if not matches(data, ".".join(keys[: i + 1])))
    inside = value_at(data, matches(data, ".".join(keys[:depth]))[0]) if depth else data
    if isinstance(inside, dict):
        return Fault(where, f"there is no {keys[depth]!r}", tuple(inside), given=keys[depth])
    if isinstance(inside, list):
        return Fault(where, f"there is no {keys[depth]!r}", (*map(str, range(len(inside))), "*"))
    name = ".".join(keys[:depth])
    return Fault(where, f"there is no {keys[depth]!r}: {name} is {inside!r}")


def _refuse_no_number(where: str, value: Any) -> None:
    """Raise an error for a value that cannot be fitted."""
    if isinstance(value, dict):
        keys = tuple(k for k, v in value.items() if isinstance(v, float | dict))
        raise InputError(Fault(where, "is a table; name one number in it", keys))
    if isinstance(value, list):
        raise InputError(Fault(where, "is a list; name one number in it, such as its item .0"))
    if isinstance(value, bool | str) or value is None:
        problem = f"is {'not set' if value is None else value}, and has to be a number"
        raise InputError(Fault(where, f"{problem} to be fitted"))
    if isinstance(value, int):
        raise InputError(Fault(where, f"is {value}, a whole number, which has no steps to fit"))


def _declared(scenario: Scenario, path: str) -> tuple[tuple[float, float] | None, Provenance]:
    """Range and provenance that a robot declares for one of its values; none for other keys."""
    table, _, inner = path.partition(".")
    if table == "robot":
        for row in scenario.robot.parameters():
            if row.name == inner:
                return row.within, row.provenance
    return None, "unstated"


def _range(
    where: str,
    start: float,
    declared: tuple[float, float] | None,
    within: tuple[float, float] | None,
) -> tuple[float, float]:
    """Return the range of a parameter: the given one, or what is declared around its start."""
    if within is not None:
        low, high = within
        if not low <= start <= high or low == high:
            problem = f"has the range {low:g} to {high:g}; its value {start:g} must lie in it"
            raise InputError(Fault(where, problem))
        return low, high
    low, high = declared or (-math.inf, math.inf)
    if start:
        ends = sorted((start / TIMES, start * TIMES))
        low, high = max(low, ends[0]), min(high, ends[1])
    if not math.isfinite(low + high):
        problem = "is 0, which says nothing of its size: give a range, KEY=LOW:HIGH"
        raise InputError(Fault(where, problem))
    return low, high


def _valid_end(scenario: Scenario, path: str, start: float, end: float) -> float:
    """Return the farthest value towards an end with which the scenario is valid."""
    if _is_valid(scenario, path, end):
        return end
    inside, outside = start, end
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        if _is_valid(scenario, path, middle):
            inside = middle
        else:
            outside = middle
    return inside


def _is_valid(scenario: Scenario, path: str, value: float) -> bool:
    try:
        override(scenario, {path: value})
    except ScenarioError:
        return False
    return True


def bounds_of(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    """Return lower and upper ends (p,) of parameters."""
    return np.array([one.low for one in parameters]), np.array([one.high for one in parameters])
