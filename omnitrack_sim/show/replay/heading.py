"""What a replay says of a run in words and figures, and how two scenarios differ."""

from __future__ import annotations

from typing import Any

from omnitrack_sim.base.text import finite
from omnitrack_sim.record.metrics import METRICS
from omnitrack_sim.results.comparison import compare, value_row
from omnitrack_sim.results.result import Result

HEADLINE = {
    "distance_m": "distance",
    "mean_speed_m_s": "mean speed",
    "tilt_max_deg": "largest tilt",
    "slip_ratio_mean": "mean slip ratio, modules 1, 2, 3",
    "energy_j": "energy",
}
"""Figures at the head of a page, with the words for them."""
MOST_DIFFERENCES = 60
"""Differences of two scenarios that are listed; of further ones the number is told."""


def heading_table(result: Result) -> dict[str, Any]:
    """Name, outcome, versions and figures of a run."""
    return finite(
        {
            "name": result.scenario.name,
            "outcome": result.outcome.value.replace("_", " "),
            "success": result.success,
            "advice": result.outcome.advice,
            "reason": result.reason,
            "duration": result.duration_s,
            "figures": _figures(result),
            "provenance": _provenance(result),
        }
    )


def _figures(result: Result) -> list[dict[str, Any]]:
    """The metrics of a run in the order of its file, with a row for each entry of a table."""
    known = {metric.name: metric for metric in METRICS}
    rows = []
    for name, value in result.metrics.items():
        metric = known.get(name)
        words = {"unit": "", "meaning": "a metric of the user's own"}
        if metric is not None:
            words = {"unit": metric.unit, "meaning": metric.meaning.replace("`", "")}
        entries = value if isinstance(value, dict) else {"": value}
        for entry, one in entries.items():
            rows.append({"name": f"{name} {entry}".strip(), "value": one, **words})
    return rows


def _provenance(result: Result) -> list[list[str]]:
    """What made the run, as pairs of words."""
    made = result.provenance
    versions: dict[str, Any] = made.get("versions") or {}
    rows = [[str(name), str(version)] for name, version in versions.items() if version]
    for key in ("seed", "scenario_sha256", "git_commit", "platform"):
        if made.get(key) is not None:
            rows.append([key.replace("_", " "), str(made[key])])
    return rows


def differences(one: Result, other: Result) -> list[list[str]]:
    """Where the scenarios of two runs differ, as ``compare`` tells it: dotted path, unit and both
    values, as text. Names are left out: they change nothing of a run."""
    rows = [
        list(value_row(value))
        for value in compare(one, other).values
        if value.name.rpartition(".")[2] != "name"
    ]
    rest = len(rows) - MOST_DIFFERENCES
    return [*rows[:MOST_DIFFERENCES], [f"and {rest} more", "", "", ""]] if rest > 0 else rows
