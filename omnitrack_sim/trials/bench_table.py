"""Results of a bench: a row for each course and entry, as a table and as a page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import finite
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.record.statistics import mean_interval, paired_rate_interval, wilson_interval
from omnitrack_sim.trials.batches import INVALID
from omnitrack_sim.trials.suite import SCORES
from omnitrack_sim.trials.table import column, joined, passed_of

if TYPE_CHECKING:
    from omnitrack_sim.trials.bench import Bench
    from omnitrack_sim.trials.suite import Suite

MISFIT = "does not fit"
ALL = "all"
"""Course of the rows over all courses together."""


def rows_of(suite: Suite, tables: Mapping[tuple[str, str], pa.Table | str]) -> list[dict[str, Any]]:
    """Return one row for each course and entry: rates, means, scores, paired differences.

    Differences are paired: of the success over all trials that both ran, of the other figures over
    those that both passed.

    Args:
        suite: that was run.
        tables: of the trials, by (course, entry); a text says why the robot does not fit.
    """
    rows = []
    for (course, entry), table in {**tables, **_over_all(suite, tables)}.items():
        row: dict[str, Any] = {"course": course, "entry": entry}
        if course in suite.courses and (ladder := suite.courses[course].ladder):
            row |= {"ladder": ladder, "size": suite.courses[course].size}
        if isinstance(table, str):
            rows.append(row | _no_rates(table))
            continue
        row |= _rates(table, course not in suite.courses or suite.courses[course].is_passed)
        passed = passed_of(table)
        for measure in suite.measures:
            counts = np.isfinite(passed) if measure.of_failures else passed == 1
            row |= _spread(measure.name, measure.of(table)[counts])
        row |= finite({name: SCORES[name](table) for name in suite.scores})
        default = tables.get((course, suite.default), "")
        if not isinstance(default, str) and entry != suite.default:
            row |= _differences(suite, table, default)
        rows.append(row)
    return rows


def _over_all(
    suite: Suite, tables: Mapping[tuple[str, str], pa.Table | str]
) -> dict[tuple[str, str], pa.Table | str]:
    """The trials of each entry on all courses that it fits and can pass, if these are several."""
    idle = {course.name for course in suite.courses.values() if not course.is_passed}
    tables = {key: table for key, table in tables.items() if key[0] not in idle}
    if len({course for course, _ in tables}) < 2:
        return {}
    together = {}
    for entry in dict.fromkeys(entry for _, entry in tables):
        own = {key: table for key, table in tables.items() if key[1] == entry}
        fit = {key: table for key, table in own.items() if not isinstance(table, str)}
        together[ALL, entry] = joined(fit.values()) if fit else next(iter(own.values()))
    return together


def _no_rates(reason: str) -> dict[str, Any]:
    low, high = wilson_interval(0, 0)
    return {
        "trials": 0,
        "passed": 0,
        "success": None,
        "success_low": low,
        "success_high": high,
        "others": MISFIT,
        "reason": reason,
    }


def _rates(table: pa.Table, is_passed: bool) -> dict[str, Any]:
    judged = passed_of(table)
    counted, passed = int(np.isfinite(judged).sum()), int(np.nansum(judged))
    low, high = wilson_interval(passed, counted)
    outcomes = Counter(table["outcome"].to_pylist())
    ends = zip(table["outcome"].to_pylist(), table["reason"].to_pylist(), strict=True)
    reasons = [reason for outcome, reason in ends if outcome != Outcome.REACHED_GOAL and reason]
    if set(outcomes) == {INVALID}:
        return _no_rates(reasons[0])
    others = {name: n for name, n in sorted(outcomes.items()) if name != Outcome.REACHED_GOAL}
    return {
        "trials": counted,
        "passed": passed,
        "success": passed / counted if counted and is_passed else None,
        "success_low": low,
        "success_high": high,
        "others": ", ".join(f"{count} {name}" for name, count in others.items()),
        "reason": next(iter(reasons), ""),
    }


def _spread(name: str, values: Array) -> dict[str, Any]:
    """Mean of values with its interval; None where there is none."""
    values = values[np.isfinite(values)]
    low, high = mean_interval(values.tolist())
    ends = (float(np.mean(values)) if len(values) else math.nan, low, high)
    keys = (name, f"{name}_low", f"{name}_high")
    return finite(dict(zip(keys, ends, strict=True)))


def _differences(suite: Suite, table: pa.Table, default: pa.Table) -> dict[str, Any]:
    # Both entries have the same draws, so differences trial by trial cancel what the draws do.
    more = passed_of(table) - passed_of(default)
    gained, lost, total = (int(one.sum()) for one in (more == 1, more == -1, np.isfinite(more)))
    low, high = paired_rate_interval(gained, lost, total)
    row: dict[str, Any] = {
        "success_more": (gained - lost) / total if total else None,
        "success_more_low": low,
        "success_more_high": high,
    }
    both = passed_of(table) + passed_of(default) == 2
    for measure in suite.measures:
        own, others = measure.of(table)[both], measure.of(default)[both]
        row |= _spread(f"{measure.name}_more", own - others)
    return row


def results_table(suite: Suite, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Return the rows as a table with all columns, and the units of those that have one."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    kinds = {"trials": pa.int64(), "passed": pa.int64()}
    kinds |= dict.fromkeys(("course", "entry", "ladder", "others", "reason"), pa.string())
    # Means, their ends and their differences share the measure's name as a prefix.
    units = {name: m.unit for name in names for m in suite.measures if name.startswith(m.name)}
    fields = [column(name, kinds.get(name, pa.float64()), units.get(name, "1")) for name in names]
    return pa.Table.from_pylist([dict(row) for row in rows], pa.schema(fields))


def page(bench: Bench, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows as Markdown: the trials passed, then a table a course."""
    suite = bench.suite
    version = f"suite {suite.name}, version {suite.version}; {bench.extent}"
    lines = [f"# {suite.title}", "", version, "", *passed_table(rows)]
    if stops := stops_table(rows):
        lines += ["## least size that stops", "", *stops]
    units = [measure.head for measure in suite.measures]
    heads = ["entry", "passed", "95 % interval, %", *suite.heads.values(), "others"]
    for name, words in headings(bench, rows).items():
        own = [row for row in rows if row["course"] == name]
        lines += [f"## {name}: {words}", ""]
        cells = [
            [f"`{row['entry']}`", *figures_of(suite.heads, row), row["others"] or "-"]
            for row in own
        ]
        lines += markdown_table(heads, cells)
        others = [row for row in own if "success_more" in row]
        if others:
            differences = [
                ("success_more", 100.0),
                *((f"{m.name}_more", 1.0) for m in suite.measures),
            ]
            cells = [
                [f"`{row['entry']}`", *(_more(row, *d) for d in differences)] for row in others
            ]
            lines += markdown_table([f"entry less `{suite.default}`", "passed, %", *units], cells)
    return "\n".join(lines)


def headings(bench: Bench, rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the task of each course that has rows, by the name of the course."""
    words = {course.name: course.words for course in bench.courses}
    names = dict.fromkeys(row["course"] for row in rows)
    return {name: words.get(name, "over all courses that it fits") for name in names}


def passed_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return lines of Markdown: a row a course, a column an entry, with the trials passed."""
    courses, entries = ([*dict.fromkeys(row[key] for row in rows)] for key in ("course", "entry"))
    texts = {(row["course"], row["entry"]): rate_of(row) for row in rows}
    cells = [[f"`{one}`", *(texts.get((one, entry), "-") for entry in entries)] for one in courses]
    return markdown_table(["course", *(f"`{entry}`" for entry in entries)], cells)


def stops_table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return lines of Markdown: the least size that stops each entry, a row a ladder.

    None without ladders.
    """
    ladders, entries = (
        [*dict.fromkeys(row[key] for row in rows if row.get("ladder"))]
        for key in ("ladder", "entry")
    )
    cells = [[f"`{one}`", *(least_size(rows, one, entry) for entry in entries)] for one in ladders]
    heads = ["course", *(f"`{entry}`" for entry in entries)]
    return markdown_table(heads, cells) if ladders else []


def least_size(rows: Iterable[Mapping[str, Any]], ladder: str, entry: str) -> str:
    """Return the least size of a ladder at which an entry passes less than half of its trials.

    With how they ended.
    """
    own = [row for row in rows if row.get("ladder") == ladder and row["entry"] == entry]
    for row in own:
        if 2 * row["passed"] < row["trials"] or not row["trials"]:
            return f"{row['size']:g}: {row['others']}"
    return f"> {own[-1]['size']:g}" if own else "-"


def rate_of(row: Mapping[str, Any]) -> str:
    """Return the trials passed of a row as text; or the pull, or that its robot does not fit."""
    if row["trials"] and row["success"] is None:
        pull = row.get("pull_held_n")
        return "-" if pull is None else f"{pull:.3g} N"
    return f"{row['passed']} of {row['trials']}" if row["trials"] else row["others"]


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table of Markdown, and the empty line below it."""
    lines = [f"| {' | '.join(cells)} |" for cells in rows]
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *lines, ""]


def figures_of(names: Iterable[str], row: Mapping[str, Any]) -> list[str]:
    """Return trials passed, interval of the rate, and the figures ``names`` of a row, as texts."""
    interval = f"{100 * row['success_low']:.0f} to {100 * row['success_high']:.0f}"
    values = [row.get(name) for name in names]
    # Three digits, and more only before the point.
    texts = [
        "-" if value is None else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
        for value in values
    ]
    return [rate_of(row), "-" if row["success"] is None else interval, *texts]


def _more(row: Mapping[str, Any], name: str, factor: float) -> str:
    """A paired difference with its interval."""
    ends = [row.get(f"{name}{end}") for end in ("", "_low", "_high")]
    if None in ends:
        return "-"
    middle, low, high = (f"{factor * end:+.3g}" for end in ends if end is not None)
    return f"{middle} ({low} to {high})"
