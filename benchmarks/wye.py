"""How often a robot gets through a wye: into its branch, out of it, straight over it.

python benchmarks/wye.py [--quick] [--workers N] [--trials N]

A wye's branch leans by an angle towards one end of its run. So there are two turns into the branch:
the turn by that angle, and the sharp one, by 180 degrees less it, for a robot that comes from the
other end; and the same two out of it, the merge and the sharp merge. Every cell of the table is a
batch of random trials with the exact collider where it loads (extra fast): any start orientation,
any direction of gravity, a preload of 20 to 35 N, friction of a dry wall (0.8 to 1.0) in one half
and of a wet one (0.6 to 0.8) in the other. The controller rolls the robot first, and backs off to
try again where it gets stuck. Straight over, trials go both ways in turn.

Prints how many passed with Wilson's 95 % interval, and how the others ended. Trial i has the same
draw in every cell, so cells differ only by wye and way.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

from omnitrack_sim import Result, Scenario, override, run_batch
from omnitrack_sim.model.collider import why_not
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.scenario import validate

WAYS = {
    "turn": (("run_start", "branch"),),
    "merge": (("branch", "run_start"),),
    "over": (("run_start", "run_end"), ("run_end", "run_start")),
    "sharp turn": (("run_end", "branch"),),
    "sharp merge": (("branch", "run_end"),),
}
"""Ports that a wye is entered and left at; where there are two ways trials take them in turn."""
ANGLES_DEG = (45.0, 60.0, 75.0, 90.0)
BORE = 0.16
REDUCING = (0.15, 0.14)
"""Bores of smaller branches, m, tried at ``REDUCING_DEG``."""
REDUCING_DEG = 60.0
WALLS = {"dry": (0.8, 1.0), "wet": (0.6, 0.8)}
"""Friction coefficients."""
PRELOAD = (20.0, 35.0)
"""N a module."""
TRIALS, QUICK_TRIALS = 60, 12
"""Of a cell, half of them on either wall."""
PIPE = 0.4
"""Length of the straight before and after the wye, m."""


class Cell(NamedTuple):
    """A way through a wye.

    Attributes:
        way: one of ``WAYS``. angle_deg: between branch and run. branch: its bore, m.
    """

    way: str
    angle_deg: float
    branch: float = BORE

    @property
    def turn_deg(self) -> float:
        """By how much the robot turns, deg."""
        if self.way == "over":
            return 0.0
        return 180.0 - self.angle_deg if self.way.startswith("sharp") else self.angle_deg


class Ended(NamedTuple):
    """What came of one trial: the wall it ran on, its outcome, how often it backed off, and how
    long it took, s."""

    wall: str
    outcome: str
    passed: bool
    retries: int
    duration: float


def cells() -> list[Cell]:
    """All cells. At 90 degrees the sharp ways are the others mirrored, and are left out."""
    angles = [
        Cell(way, angle)
        for way, angle in product(WAYS, ANGLES_DEG)
        if not (way.startswith("sharp") and angle == 90)
    ]
    smaller = [Cell(way, REDUCING_DEG, bore) for bore, way in product(REDUCING, WAYS)]
    return angles + [cell for cell in smaller if cell.way != "over"]


def wall_of(index: int) -> str:
    """The wall that trial ``index`` runs on."""
    return tuple(WALLS)[index % len(WALLS)]


def trial(cell: Cell, index: int, changes: Mapping[str, Any] | None = None) -> Scenario:
    """Trial ``index`` of a cell; ``changes`` as ``override`` takes them."""
    rng = np.random.default_rng(index)
    gravity = rng.normal(size=3)
    gravity *= 9.81 / np.linalg.norm(gravity)
    ways = WAYS[cell.way]
    enter, leave = ways[index // len(WALLS) % len(ways)]
    straights = [
        {"kind": "straight", "length": PIPE, "inner_diameter": bore}
        for bore in (cell.branch if port == "branch" else BORE for port in (enter, leave))
    ]
    wye = {
        "kind": "wye",
        "angle_deg": cell.angle_deg,
        "branch_diameter": cell.branch,
        "enter": enter,
        "leave": leave,
    }
    scenario = validate(
        {
            "pipes": [straights[0], wye, straights[1]],
            "start": {"theta5_deg": float(rng.uniform(-180, 180)), "distance": 0.12},
            "contact": {"friction": float(rng.uniform(*WALLS[wall_of(index)]))},
            "robot": {"preload": float(rng.uniform(*PRELOAD))},
            "world": {"gravity": gravity.tolist()},
            "physics": {"collider": "exact" if why_not() is None else "primitives"},
        }
    )
    return override(scenario, dict(changes)) if changes else scenario


def drive(task: tuple[Cell, Sequence[int]]) -> list[Ended]:
    """Run trials of a cell as one batch."""
    cell, indices = task
    results = run_batch([trial(cell, i) for i in indices], threads=1, no_load=False)
    return [ended(index, result) for index, result in zip(indices, results, strict=True)]


def ended(index: int, result: Result) -> Ended:
    """What came of trial ``index``."""
    retries = sum(visit.retries for visit in result.timeline())
    return Ended(wall_of(index), result.outcome.value, result.success, retries, result.duration_s)


def rate(trials: Iterable[Ended]) -> str:
    """How many passed, and the interval of the rate."""
    passed = [found.passed for found in trials]
    low, high = wilson_interval(sum(passed), len(passed))
    return f"{sum(passed)} of {len(passed)} ({100 * low:.0f} to {100 * high:.0f} %)"


def row(cell: Cell, trials: Sequence[Ended]) -> str:
    """One row of the table."""
    walls = [rate(t for t in trials if t.wall == wall) for wall in WALLS]
    failed = Counter(t.outcome for t in trials if not t.passed)
    ends = ", ".join(f"{count} {name}" for name, count in failed.most_common()) or "-"
    passed = [t for t in trials if t.passed]
    again = sum(t.retries > 0 for t in passed)
    columns = [
        cell.way,
        f"{cell.angle_deg:.0f} deg",
        f"{cell.turn_deg:.0f} deg",
        f"{1000 * cell.branch:.0f} mm",
        *walls,
        str(again),
        f"{np.mean([t.duration for t in passed]):.1f} s" if passed else "-",
        ends,
    ]
    return f"| {' | '.join(columns)} |"


HEADS = (
    "way",
    "branch at",
    "turn",
    "branch bore",
    "dry",
    "wet",
    "after backing off",
    "time",
    "failures",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_TRIALS} trials a cell")
    parser.add_argument("--trials", type=int, help=f"of a cell; default {TRIALS}")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count() or 1, help="processes; default: all cores"
    )
    asked = parser.parse_args()
    count = asked.trials or (QUICK_TRIALS if asked.quick else TRIALS)
    tasks = [(cell, range(count)) for cell in cells()]
    begin = time.perf_counter()
    with ProcessPoolExecutor(asked.workers, mp_context=get_context("spawn")) as pool:
        found = list(pool.map(drive, tasks))
    print(
        f"{count * len(tasks)} trials in {time.perf_counter() - begin:.0f} s; collider: "
        f"{'exact' if why_not() is None else 'primitives'}\n"
    )
    print(f"| {' | '.join(HEADS)} |")
    print("|---" * len(HEADS) + "|")
    for (cell, _), trials in zip(tasks, found, strict=True):
        print(row(cell, trials))


if __name__ == "__main__":
    main()
