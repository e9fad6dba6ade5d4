"""What notebooks show of results and comparisons: HTML, with every name escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from omnitrack_sim.base.text import clipped, printable
from omnitrack_sim.results.sketch import sketch

if TYPE_CHECKING:
    from omnitrack_sim.results.comparison import Comparison, Difference
    from omnitrack_sim.results.result import Result

_HEADLINE = (
    ("distance_m", "distance", "m", 3),
    ("mean_speed_m_s", "mean speed", "m/s", 4),
    ("tilt_max_deg", "largest tilt", "deg", 1),
    ("energy_j", "energy", "J", 1),
    ("slip_ratio_mean", "mean slip ratio", "", 3),
    ("normal_force_mean_n", "mean normal force", "N", 1),
    ("motor_torque_max_nm", "largest motor torque", "N m", 3),
)
"""Metric, what people call it, unit, digits."""
_DIGITS, _MOST_DIGITS = 4, 12
"""Of a number as people read it, and at most where two numbers hardly differ."""
_ROUGH = 0.05
"""Part of a difference by which that of two rounded numbers may be off."""
_MOST_EVENTS = 12
_LONGEST = 200
"""Characters of a name, value or event."""


def result_html(result: Result) -> str:
    """Outcome, headline figures, a small picture and the events of a run."""
    name, outcome = result.scenario.name, result.outcome.value.replace("_", " ")
    colour = "#1a7f4b" if result.success else "#c8322b"
    head = (
        f"<p><b>{_safe(name)}</b>: <b style='color:{colour}'>{_safe(outcome)}</b> after "
        f"{result.duration_s:.2f} s<br>{_safe(result.reason)}</p>"
    )
    figures = [_headline(result, *row) for row in _HEADLINE if row[0] in result.metrics]
    table = _table(("figure", "unit", "value"), figures)
    beside = (
        f"<div style='display:flex;gap:2em;flex-wrap:wrap'>{table}{sketch(result.trajectory)}</div>"
    )
    return "".join(["<div>", head, beside, _events(result), "</div>"])


def _headline(result: Result, key: str, name: str, unit: str, digits: int) -> tuple[str, ...]:
    value = result.metrics[key]
    numbers: Sequence[Any] = value if isinstance(value, list) else [value]
    return name, unit, " / ".join("-" if n is None else f"{n:.{digits}f}" for n in numbers)


def _events(result: Result) -> str:
    lines = [str(event) for event in result.events[:_MOST_EVENTS]]
    rest = len(result.events) - len(lines)
    lines += [f"and {rest} more events"] if rest else []
    return f"<ul>{''.join(f'<li>{_safe(line)}</li>' for line in lines)}</ul>" if lines else ""


def comparison_html(comparison: Comparison) -> str:
    """The outcomes, the values in which the scenarios differ, and the metrics that do."""
    ends = [(r.scenario.name, r.outcome.value, f"{r.duration_s:.2f} s") for r in _sides(comparison)]
    head = "".join(
        f"<p><b>{side}</b> {_safe(name)}: {_safe(outcome)} after {time}</p>"
        for side, (name, outcome, time) in zip("AB", ends, strict=True)
    )
    values = _table(("value", "unit", "A", "B"), map(value_row, comparison.values))
    changed = [one for one in comparison.figures if one.differs]
    heads = ("figure", "unit", "A", "B", "B - A")
    return f"<div>{head}{values}{_table(heads, map(figure_row, changed))}</div>"


def _sides(comparison: Comparison) -> tuple[Result, Result]:
    return comparison.a, comparison.b


def value_row(one: Difference) -> tuple[str, ...]:
    """Path, unit, A and B of a value of the scenarios as text."""
    return one.name, one.unit, told(one.a), told(one.b)


def figure_row(one: Difference) -> tuple[str, ...]:
    """Name, unit, A, B and B - A of a figure as text. A and B have as many digits as show how they
    differ, and B - A is the difference of what is shown."""
    a, b, exact = one.a, one.b, one.difference
    if exact is None or not math.isfinite(exact):
        return one.name, one.unit, told(a), told(b), told(exact)
    digits = _DIGITS
    while True:
        texts = [f"{n:.{digits}g}" if isinstance(n, float) else str(n) for n in (a, b)]
        shown = float(texts[1]) - float(texts[0])
        if digits == _MOST_DIGITS or abs(shown - exact) <= _ROUGH * abs(exact):
            break
        digits += 1
    return one.name, one.unit, *texts, told(shown)


def told(value: Any) -> str:
    """A value as people read it: four digits, and a dash for what is not there."""
    if value is None:
        return "-"
    text = f"{value:.{_DIGITS}g}" if isinstance(value, float) else str(value)
    return clipped(printable(text), _LONGEST)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in rows)
    return f"<table><thead><tr>{_cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def _cells(tag: str, texts: Sequence[str]) -> str:
    return "".join(f"<{tag} style='text-align:left'>{_safe(text)}</{tag}>" for text in texts)


def _safe(text: str) -> str:
    return escape(clipped(printable(text), _LONGEST))
