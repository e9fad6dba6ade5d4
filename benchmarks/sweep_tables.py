"""Runs a shipped sweep and prints its success rates as tables.

python benchmarks/sweep_tables.py NAME --out DIR [--samples N] [--workers N] [--over AXIS FILE]

The folder is that of `omnitrack sweep NAME --out DIR`, and is gone on with. --samples draws so many
of the random axes instead of the sweep's own number; --over draws the rates over one axis as well.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
GRAVITY = Cut("world.gravity", "gravity")
TABLES: dict[str, dict[str, tuple[Cut, ...]]] = {
    "tee_monte_carlo": {
        "reliability": (Cut("robot.preload", "preload, N", (15.0, 20.0, 35.0)),),
        "preload": (
            Cut("robot.preload", "preload, N", (15.0, 17.0, 19.0, 21.0, 25.0, 35.0)),
            FRICTION,
        ),
        "gravity": (GRAVITY, FRICTION),
        "orientation": (
            Cut(
                "start.theta5_deg", "theta5, degrees", (-60.0, -40.0, -20.0, 0.0, 20.0, 40.0, 60.0)
            ),
        ),
    },
    "tee_merge": {
        "gravity": (Cut("world.friction", "friction", (0.5, 0.6, 0.7, 1.0)), GRAVITY),
    },
    "tee_springs": {
        "springs": (
            Cut("robot.spring_stiffness", "stiffness of a spring, N/mm", factor=1e-3),
            Cut("robot.preload", "preload, N"),
        )
    },
    "tee_factors": {
        "design": (
            Cut("control.kind", "controller"),
            Cut("robot.contact_length", "contact, mm", factor=1e3),
        ),
        "alignment": (Cut("control.kind", "controller"), Cut("control.align", "aligned")),
        "reach": (Cut("robot.reach", "reach, mm", factor=1e3),),
    },
    "tee_lugs": {"lugs": (Cut("robot.lugs_per_track", "lugs a track"),)},
    "elbow_orientation": {"controllers": (Cut("control.kind", "controller"),)},
    "tee_orientation": {},
    "preload_friction": {},
    "fig14_pairs": {},
    "design_reach_length": {
        "reach": (Cut("robot.reach", "reach, mm", factor=1e3), Cut("base", "pipes")),
        "length": (Cut("robot.contact_length", "contact, mm", factor=1e3), Cut("base", "pipes")),
    },
    "elbow_drives": {
        "drives": (
            Cut("robot.drive", "drive"),
            Cut("world.friction", "friction"),
        )
    },
}
"""Tables of each sweep: rows, and columns where there are two cuts."""


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


def table(result: ot.TrialsResult, cuts: Sequence[Cut]) -> str:
    """Return one table of Markdown; its last column is of all trials of a row."""
    passed = np.array(result.table["success"].to_pylist(), bool)
    ran = np.array([one not in ("invalid", "error") for one in result.table["outcome"].to_pylist()])
    rows = groups(result, cuts[0])
    columns = groups(result, cuts[1]) if len(cuts) > 1 else {}
    heads = [cuts[0].words, *(f"{cuts[1].words} {label}" for label in columns), "passed"]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for label, row in rows.items():
        cells = [rate(passed, ran & row & column, False) for column in columns.values()]
        lines.append(f"| {' | '.join([label, *cells, rate(passed, ran & row, True)])} |")
    return "\n".join(lines)


def summary(result: ot.TrialsResult) -> str:
    """Return the row of the whole sweep: passed, at the first attempt, and how the others ended."""
    columns = result.table
    passed = np.array(columns["success"].to_pylist(), bool)
    outcomes = columns["outcome"].to_pylist()
    ran = np.array([one not in ("invalid", "error") for one in outcomes])
    attempts = np.array(columns["attempts"].to_pylist(), float)
    first = int((passed & (attempts == 1)).sum())
    others = sorted({one for one, good in zip(outcomes, passed, strict=True) if not good})
    ends = ", ".join(f"{outcomes.count(one)} `{one}`" for one in others) or "-"
    return "\n".join(
        [
            "| passed | at the first attempt | others |",
            "|---|---|---|",
            f"| {rate(passed, ran, True)} | {first} | {ends} |",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", choices=tuple(TABLES), metavar="NAME")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--samples", type=int)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--over", nargs=2, metavar=("AXIS", "FILE"))
    given = parser.parse_args()
    sweep = ot.load_sweep(given.name)
    if given.samples:
        sweep = sweep.model_copy(update={"samples": given.samples})
    result = ot.run_trials(sweep, out=given.out, workers=given.workers)
    print(f"## summary\n\n{summary(result)}\n")
    for name, cuts in TABLES[given.name].items():
        print(f"## {name}\n\n{table(result, cuts)}\n")
    if given.over:
        ot.plot_sweep(result, given.over[1], over=given.over[0])


if __name__ == "__main__":
    main()
