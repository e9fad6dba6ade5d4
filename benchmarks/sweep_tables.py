"""Runs a shipped sweep and prints its success rates as tables.

python benchmarks/sweep_tables.py NAME --out DIR [--samples N] [--workers N]

The folder is that of `omnitrack sweep NAME --out DIR`, and is gone on with. --samples draws so many
of the random axes instead of the sweep's own number.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from shape import Arguments, table

import omnitrack_sim as ot
from omnitrack_sim.record.statistics import rate_text
from omnitrack_sim.trials.sweep_plot import spreads


class Cut(NamedTuple):
    """Trials apart by the value of an axis.

    Attributes:
        axis: of the sweep. words: of the head of a table. edges: of the ranges of a number; none:
            each value of the axis. factor: of the numbers that are shown.
    """

    axis: str
    words: str
    edges: tuple[float, ...] = ()
    factor: float = 1.0


FRICTION = Cut("world.friction", "friction", (0.6, 0.7, 0.8, 1.0))
TABLES: dict[str, dict[str, tuple[Cut, ...]]] = {
    "tee_monte_carlo": {
        "reliability": (Cut("robot.preload", "preload, N", (15.0, 20.0, 35.0)),),
        "preload": (
            Cut("robot.preload", "preload, N", (15.0, 17.0, 19.0, 21.0, 25.0, 35.0)),
            FRICTION,
        ),
    },
    "tee_merge": {
        "gravity": (
            Cut("world.friction", "friction", (0.5, 0.6, 0.7, 1.0)),
            Cut("world.gravity", "gravity"),
        ),
    },
    "tee_springs": {
        "springs": (
            Cut("robot.spring_stiffness", "stiffness of a spring, N/mm", factor=1e-3),
            Cut("robot.preload", "preload, N"),
        )
    },
    "tee_factors": {
        "alignment": (Cut("control.kind", "controller"), Cut("control.align", "aligned")),
    },
    "elbow_orientation": {"controllers": (Cut("control.kind", "controller"),)},
    "tee_orientation": {},
    "preload_friction": {},
    "design_reach_length": {
        "length": (Cut("robot.contact_length", "contact, mm", factor=1e3), Cut("base", "pipes")),
    },
}
"""Tables of each sweep that pages show: rows, and columns where there are two cuts."""


def groups(result: ot.TrialsResult, cut: Cut) -> dict[str, NDArray[np.bool_]]:
    """Return the trials of each range or value of a cut, by its label."""
    (spread,) = (one for one in spreads(result.plan) if one.name == cut.axis)
    if spread.order:
        words = np.array(spread.values)
        return {word: words == word for word in spread.order}
    values = np.asarray(spread.values, float)
    if not cut.edges:
        return {f"{cut.factor * value:g}": values == value for value in np.unique(values)}
    last = cut.edges[-1]
    return {
        f"{cut.factor * low:g} to {cut.factor * high:g}": (values >= low)
        & ((values < high) | (high == last))
        for low, high in pairwise(cut.edges)
    }


def rate(passed: NDArray[np.bool_], which: NDArray[np.bool_], interval: bool) -> str:
    """Return how many of some trials passed, with Wilson's 95 % interval where asked."""
    count, total = int((passed & which).sum()), int(which.sum())
    if not total:
        return "-"
    return rate_text(count, total) if interval else f"{count} of {total}"


def is_random(result: ot.TrialsResult) -> bool:
    """Return whether trials were drawn; those of grids and lists alone are a sample of nothing."""
    return any(axis.kind not in ("grid", "list") for axis in result.plan.axes)


def ran(result: ot.TrialsResult) -> NDArray[np.bool_]:
    """Return the trials that came to an end of their own."""
    return np.array(
        [one not in ("invalid", "error") for one in result.table["outcome"].to_pylist()]
    )


def rows_of(result: ot.TrialsResult, cuts: Sequence[Cut]) -> tuple[list[str], list[list[str]]]:
    """Return heads and rows of a table; its last column is of all trials of a row."""
    passed, valid = np.array(result.table["success"].to_pylist(), bool), ran(result)
    columns = groups(result, cuts[1]) if len(cuts) > 1 else {}
    heads = [cuts[0].words, *(f"{cuts[1].words} {label}" for label in columns), "passed"]
    rows = []
    for label, row in groups(result, cuts[0]).items():
        cells = [rate(passed, valid & row & column, False) for column in columns.values()]
        rows.append([label, *cells, rate(passed, valid & row, is_random(result))])
    return heads, rows


def summary(result: ot.TrialsResult) -> list[str]:
    """Return the row of the whole sweep: passed, at the first attempt, and how the others ended."""
    columns = result.table
    passed = np.array(columns["success"].to_pylist(), bool)
    outcomes = columns["outcome"].to_pylist()
    attempts = np.array(columns["attempts"].to_pylist(), float)
    first = int((passed & (attempts == 1)).sum())
    others = sorted({one for one, good in zip(outcomes, passed, strict=True) if not good})
    ends = ", ".join(f"{outcomes.count(one)} `{one}`" for one in others) or "-"
    return [rate(passed, ran(result), is_random(result)), str(first), ends]


def main() -> None:
    """Run the sweep and print its tables."""
    parser = Arguments(__doc__, workers=True)
    parser.add_argument("name", choices=tuple(TABLES), metavar="NAME")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--samples", type=int)
    given = parser.read()
    sweep = ot.load_sweep(given.name)
    if given.samples:
        sweep = sweep.model_copy(update={"samples": given.samples})
    result = ot.run_trials(sweep, out=given.out, workers=given.workers)
    table("summary", ("passed", "at the first attempt", "others"), [summary(result)])
    for name, cuts in TABLES[given.name].items():
        table(name, *rows_of(result, cuts))


if __name__ == "__main__":
    main()
