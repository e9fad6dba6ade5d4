"""Comparison of two runs: differences of their scenarios, outcomes and metrics."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from omnitrack_sim.base.text import clipped, counted, printable
from omnitrack_sim.record.metrics import ESTIMATE_METRICS
from omnitrack_sim.results.html import LONGEST, safe, table_html
from omnitrack_sim.results.provenance import warn_of_unlike
from omnitrack_sim.results.result import Result, as_result
from omnitrack_sim.robots.tail import TAIL_METRICS, TETHER_METRICS
from omnitrack_sim.scenario.model import unit_of

NOISE = 1e-9
"""Relative difference up to which two numbers count as equal: effects of summation order or library
versions are far below it."""
_DIGITS, _MAX_DIGITS = 4, 12
"""Digits of a number, and most digits where two numbers hardly differ."""
ZERO = 1e-9
"""Size of a figure of a run, in its unit, below which it is printed as 0: such are errors of
rounding, as no quantity of a run is recorded more exactly."""
_ROUGH = 0.05
"""Part of a difference by which that of two rounded numbers may be off."""


@dataclass(frozen=True)
class ComparedValue:
    """A value of the scenario or a metric in two runs.

    Attributes:
        name: dotted path of a value of the scenario; or name of a metric, with ``_1`` to ``_3`` at
            the end where there is one for each module, or a dot and the phase.
        unit: of both; "1" for numbers without one, empty where none is known.
        a, b: what it is in each; None where it is not there.
    """

    name: str
    unit: str
    a: Any
    b: Any

    @property
    def difference(self) -> float | None:
        """Difference b - a; None where they are not both numbers."""
        # By exact type: a truth value is an integer to isinstance, but has no difference.
        numbers = all(type(value) in (int, float) for value in (self.a, self.b))
        return self.b - self.a if numbers else None

    @property
    def differs(self) -> bool:
        """True if a and b differ: numbers by more than ``NOISE`` of the larger; NaN equals NaN."""
        if self.difference is not None and math.isfinite(self.difference):
            return abs(self.difference) > NOISE * max(abs(self.a), abs(self.b))
        # Only NaN differs from itself.
        return self.a != self.b and not (self.a != self.a and self.b != self.b)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two runs side by side, as ``compare`` returns them.

    Attributes:
        a, b: the runs.

    Example:
        >>> base = ot.load_scenario("straight", {"run.time_limit": 0.1})
        >>> runs = ot.run_batch([base, ot.override(base, {"world.friction": 0.5})], no_load=False)
        >>> ot.compare(*runs).headline
        'the scenarios differ in 1 value'
    """

    a: Result
    b: Result

    def __repr__(self) -> str:
        ends = [f"{r.scenario.name!r} {r.outcome.value}" for r in (self.a, self.b)]
        return f"Comparison({' / '.join(ends)}; {self.headline})"

    @property
    def headline(self) -> str:
        """Number of values in which the scenarios differ, in words."""
        count = len(self.values)
        if count == 0:
            return "the scenarios are the same"
        return f"the scenarios differ in {counted(count, 'value')}"

    @cached_property
    def values(self) -> tuple[ComparedValue, ...]:
        """Values in which the resolved scenarios differ, by dotted path; names do not count."""
        first, second = (r.scenario.model_dump(mode="json") for r in (self.a, self.b))
        del first["name"], second["name"]
        robots = [run.scenario.robot for run in (self.a, self.b)]
        return tuple(
            ComparedValue(path, unit_of(path, robots) or "", a, b)
            for path, a, b in differing(first, second)
        )

    @cached_property
    def figures(self) -> tuple[ComparedValue, ...]:
        """Duration and metrics of both runs, equal ones included."""
        runs = ({"duration_s": r.duration_s, **r.metrics} for r in (self.a, self.b))
        first, second = (
            {name: value for key, own in run.items() for name, value in _flat(key, own)}
            for run in runs
        )
        names = [*first, *(name for name in second if name not in first)]
        robots = (run.scenario.robot for run in (self.a, self.b))
        metrics = (
            *(metric for robot in robots for metric in robot.metrics),
            *(*ESTIMATE_METRICS, *TAIL_METRICS, *TETHER_METRICS),
        )
        units = {"duration_s": "s"} | {metric.name: metric.unit for metric in metrics}
        return tuple(
            ComparedValue(name, _unit(name, units), first.get(name), second.get(name))
            for name in names
        )

    def summary(self) -> dict[str, Any]:
        """Return the comparison as plain data, as ``omnitrack compare --json`` prints it."""
        return {
            side: {
                "name": run.scenario.name,
                "outcome": run.outcome.value,
                "reason": run.reason,
                "scenario_sha256": run.scenario.hash,
            }
            for side, run in (("a", self.a), ("b", self.b))
        } | {
            "values": [dataclasses.asdict(one) for one in self.values],
            "figures": [
                dataclasses.asdict(one) | {"difference": one.difference} for one in self.figures
            ],
        }

    def _repr_html_(self) -> str:
        head = "".join(
            f"<p><b>{side}</b> {safe(run.scenario.name)}: {safe(run.ending)} after "
            f"{run.duration_s:.2f} s</p>"
            for side, run in (("A", self.a), ("B", self.b))
        )
        values = table_html(("value", "unit", "A", "B"), map(value_row, self.values))
        changed = [figure_row(one) for one in self.figures if one.differs]
        figures = table_html(("figure", "unit", "A", "B", "B - A"), changed)
        return f"<div>{head}{values}{figures}</div>"


def compare(
    a: Result | str | os.PathLike[str], b: Result | str | os.PathLike[str], *, trust: bool = False
) -> Comparison:
    """Compare two runs.

    Args:
        a: run, or folder of a saved one.
        b: the other.
        trust: see ``load_result``.

    Raises:
        OutputError: a folder is no run.
        TypeError: one is neither a result nor a folder.

    Example:
        >>> base = ot.load_scenario("straight", {"run.time_limit": 0.1})
        >>> runs = ot.run_batch([base, ot.override(base, {"world.friction": 0.5})], no_load=False)
        >>> [(one.name, one.a, one.b) for one in ot.compare(*runs).values]
        [('world.friction', 0.9, 0.5)]
    """
    runs = as_result(a, trust), as_result(b, trust)
    warn_of_unlike([run.provenance for run in runs], "these runs")
    return Comparison(*runs)


class _Absent:
    """Marker for a value that a scenario does not have."""


def differing(a: Any, b: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield dotted path and both values where two tables of plain data differ.

    Lists of numbers, and lists of tables of different length, differ as a whole.
    """
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(key for key in b if key not in a)]:
            there, here = a.get(key, _Absent), b.get(key, _Absent)
            yield from differing(there, here, f"{path}.{key}".lstrip("."))
    elif _tables(a) and _tables(b) and len(a) == len(b):
        for i, (there, here) in enumerate(zip(a, b, strict=True)):
            yield from differing(there, here, f"{path}.{i}")
    elif a != b:
        there, here = (None if value is _Absent else value for value in (a, b))
        yield path, there, here


def _tables(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(item, dict) for item in value)


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the numbers of a metric, each with a name of its own."""
    if isinstance(value, list):
        yield from ((f"{name}_{i + 1}", item) for i, item in enumerate(value))
    elif isinstance(value, dict):
        yield from ((f"{name}.{key}", item) for key, item in value.items())
    else:
        yield name, value


def _unit(name: str, units: Mapping[str, str]) -> str:
    """Return the unit of a figure of a run; empty for a user's own metric."""
    # The name as it is, without a module's number, without a phase.
    names = (name, name.rpartition("_")[0], name.partition(".")[0])
    return next((units[known] for known in names if known in units), "")


def value_row(one: ComparedValue) -> tuple[str, ...]:
    """Path, unit, A and B of a value of the scenarios as text."""
    return one.name, one.unit, value_text(one.a), value_text(one.b)


def figure_row(one: ComparedValue) -> tuple[str, ...]:
    """Name, unit, A, B and B - A of a figure as text.

    A and B have enough digits to show their difference; B - A is that of the printed numbers.
    """
    a, b = _not_rounding(one.a), _not_rounding(one.b)
    exact = one.difference
    if exact is None or not math.isfinite(exact):
        return one.name, one.unit, value_text(a), value_text(b), value_text(exact)
    exact = b - a if one.differs else 0.0
    digits = _DIGITS
    while True:
        texts = [f"{n:.{digits}g}" if isinstance(n, float) else str(n) for n in (a, b)]
        shown = float(texts[1]) - float(texts[0])
        # Readers subtract the printed numbers in their heads: these must give about the difference
        # shown.
        if digits == _MAX_DIGITS or abs(shown - exact) <= _ROUGH * abs(exact):
            break
        digits += 1
    return one.name, one.unit, *texts, value_text(shown if exact else 0.0)


def _not_rounding(value: Any) -> Any:
    return 0.0 if isinstance(value, float) and abs(value) < ZERO else value


def figure_text(value: float) -> str:
    """Text of a figure of a run: four digits, and 0 for what is an error of rounding."""
    return f"{_not_rounding(value):.{_DIGITS}g}"


def value_text(value: Any) -> str:
    """Text of a value: four digits for numbers, a dash for a missing one.

    Of tables it has their kinds, or how much is in them.
    """
    if value is None:
        return "-"
    if isinstance(value, Mapping):
        return value_text(value["kind"]) if "kind" in value else counted(len(value), "value")
    if value and _tables(value):
        kinds = [value_text(item) for item in value if "kind" in item]
        text = ", ".join(kinds) if len(kinds) == len(value) else counted(len(value), "table")
        return clipped(text, LONGEST)
    text = f"{value:.{_DIGITS}g}" if isinstance(value, float) else str(value)
    return clipped(printable(text), LONGEST)
