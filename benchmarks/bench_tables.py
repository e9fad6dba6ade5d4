"""Compares robots or controllers, as `omnitrack bench` does, and prints the result as tables.

python benchmarks/bench_tables.py SUITE --out DIR [--course COURSE ...] [--entry ENTRY ...]
    [--trials N] [--workers N]

Printed are the trials passed of each entry and course; of robots also what they are, what stopped
them, their figures over all courses, and, of all shipped ones, what these teach; of controllers the
means of each entry, and its paired differences to the default one, a table a course. Of courses
over ladders of sizes it prints the least size that stops each robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from mobility_lessons import lessons, plus_minus
from shape import Arguments, markdown

import omnitrack_sim as ot
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.trials.bench_table import ALL, rate_of, stops_table
from omnitrack_sim.trials.entries import robot_of
from omnitrack_sim.trials.suite import BenchMeasure

Row = dict[str, Any]
FIGURES = ("mean_speed_m_s", "energy_per_metre", "contact_force_max_n")
"""Measures that pages show over all courses."""
POSE = "pose_error"
"""The measure that only robots by onboard sensors have."""
PULL = "pull"


def rate_and_interval(row: Row) -> str:
    """Return the trials passed with the interval of their rate."""
    interval = f"{100 * row['success_low']:.1f} to {100 * row['success_high']:.1f} %"
    return f"{rate_of(row)} ({interval})" if row["trials"] else rate_of(row)


def passed(rows: Sequence[Row]) -> str:
    """Return the trials passed with intervals: a row an entry, a column a course."""
    courses, entries = ([*dict.fromkeys(row[key] for row in rows)] for key in ("course", "entry"))
    cells = {(row["course"], row["entry"]): rate_and_interval(row) for row in rows}
    body = [[f"`{one}`", *(cells.get((course, one), "-") for course in courses)] for one in entries]
    return markdown(["entry", *(f"`{course}`" for course in courses)], body)


def by_course(rows: Sequence[Row], text: Any) -> str:
    """Return a table of a text of each row: a row a course, a column an entry."""
    courses, entries = ([*dict.fromkeys(row[key] for row in rows)] for key in ("course", "entry"))
    cells = {(row["course"], row["entry"]): text(row) for row in rows}
    body = [[f"`{one}`", *(cells.get((one, entry), "-") for entry in entries)] for one in courses]
    return markdown(["course", *(f"`{entry}`" for entry in entries)], body)


def stops(rows: Sequence[Row]) -> str:
    """Return the trials passed, and how the others ended: a row a course, a column an entry."""
    most = max((row["trials"] for row in rows), default=0)

    def text(row: Row) -> str:
        rate = str(row["passed"]) if row["trials"] == most else rate_of(row)
        return f"{rate}: {row['others']}" if row["trials"] and row["others"] else rate

    return f"Passed of {most} trials, and how the others ended:\n\n{by_course(rows, text)}"


def spread(row: Row, name: str, sign: str = "") -> str:
    """Return a mean with half the width of its interval, which is Student's and so symmetric."""
    if row.get(f"{name}_low") is None:
        return "-"
    return plus_minus(row[name], (row[f"{name}_high"] - row[f"{name}_low"]) / 2, sign)


def measures(
    rows: Sequence[Row], figures: Sequence[BenchMeasure], ending: str, sign: str = ""
) -> str:
    """Return the measures of some rows, or with ``_more`` their differences to the default."""
    cells = [
        [f"`{row['entry']}`", *(spread(row, f"{m.name}{ending}", sign) for m in figures)]
        for row in rows
    ]
    return markdown(["entry", *(measure.head for measure in figures)], cells)


def of_robots(bench: ot.Bench, rows: Sequence[Row]) -> None:
    """Print the robots, what was passed and what stopped them, and figures over all courses."""
    print(f"## robots\n\n{robots(bench)}\n")
    single = [row for row in rows if row["course"] not in (ALL, PULL)]
    hard = {row["course"] for row in single if row["others"] or not row["trials"]}
    easy = dict.fromkeys(f"`{row['course']}`" for row in single if row["course"] not in hard)
    print("## easy\n")
    print(fill(f"All robots pass all trials of {', '.join(easy) or 'no course'}.", 100), "\n")
    stopped = [row for row in single if row["course"] in hard]
    print(f"## passed\n\n{stops(stopped)}\n")
    cells = {(row["course"], row["entry"]): row for row in rows}
    body = []
    for entry in bench.entries:
        over_all, pull = (cells.get((course, entry.name), {}) for course in (ALL, PULL))
        figures = (spread(over_all, name) for name in FIGURES)
        last = spread(pull, "pull_held_n")
        body.append([f"`{entry.name}`", rate_and_interval(over_all), *figures, last])
    heads = [m.head for m in bench.suite.measures if m.name in FIGURES]
    heads = ["entry", "passed", *heads, "pull left over, N"]
    errors = [
        f"Pose error of `{row['entry']}`: {spread(row, POSE)} m."
        for row in rows
        if row["course"] == ALL and row.get(f"{POSE}_low") is not None
    ]
    print(f"## all\n\n{markdown(heads, body)}\n\n{' '.join(errors)}\n")


def robots(bench: ot.Bench) -> str:
    """Return what each entry is: bore, range of bores, length, mass and speed."""
    body = []
    for entry in bench.entries:
        robot = robot_of(entry.changes)
        low, high = robot.bores
        fits = "not stated" if math.isinf(high) else f"{1000 * low:.0f} to {1000 * high:.0f}"
        bore, length = 1000 * robot.nominal_bore, robot.length / robot.nominal_bore
        figures = (f"{bore:.0f}", fits, f"{length:.1f}", f"{robot.mass:.2f}")
        speed = f"{1000 * robot.nominal_speed:.0f}"
        body.append([f"`{entry.name}`", *figures, speed])
    heads = ["entry", "bore, mm", "fits, mm", "length, bores", "mass, kg", "speed, mm/s"]
    return markdown(heads, body)


def of_ladders(rows: Sequence[Row]) -> None:
    """Print the least sizes that stop each robot, and the intervals of the rates."""
    most = max(row["trials"] for row in rows if row.get("ladder"))
    body = [
        [f"{passed} of {most}", *(f"{100 * end:.0f}" for end in wilson_interval(passed, most))]
        for passed in range(most + 1)
    ]
    print("## stops\n", *stops_table(rows), sep="\n")
    print(f"## intervals\n\n{markdown(['passed', 'from, %', 'to, %'], body)}\n")


def of_controllers(bench: ot.Bench, rows: Sequence[Row]) -> None:
    """Print what was passed, means, and differences to the default."""
    suite = bench.suite
    rows = [row for row in rows if row["course"] != ALL]
    print(f"## passed\n\n{passed(rows)}\n")
    for course in dict.fromkeys(row["course"] for row in rows):
        own = [row for row in rows if row["course"] == course]
        print(f"## {course} means\n\n{measures(own, suite.measures, '')}\n")
        others = [row for row in own if "success_more" in row]
        print(f"## {course} differences\n\n{measures(others, suite.measures, '_more', '+')}\n")


def main() -> None:
    """Compare, and print the tables."""
    parser = Arguments(__doc__, workers=True)
    parser.add_argument("suite")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--course", nargs="+", dest="courses")
    parser.add_argument("--entry", nargs="+", dest="entries")
    parser.add_argument("--trials", type=int)
    given = parser.read()
    bench = ot.Bench.of(given.suite, given.courses, given.entries, trials=given.trials)
    result = ot.run_trials(bench, out=given.out, workers=given.workers)
    if bench.suite.compares == "controllers":
        of_controllers(bench, result.summary["rows"])
    elif any(course.ladder for course in bench.courses):
        of_ladders(result.summary["rows"])
    else:
        of_robots(bench, result.summary["rows"])
        if not given.entries:
            print(f"## lessons\n\n{lessons(result.table.to_pylist())}\n")


if __name__ == "__main__":
    main()
