"""How often the presser, the inchworm and the snake pass a fitting, however it lies.

    python benchmarks/other_robots.py [--trials 6] [--workers 2]

Each trial has a direction of the inlet, a turn of the fitting and a roll of the robot of its own,
drawn from the seed. A robot that needs more than 1.6 times as long as on the level has not
passed. Prints a table for each robot.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import numpy as np

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import unit
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.robots.inchworm import Inchworm
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.snake import Snake

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from in_pipes import Drive, pipe

ROBOTS = {"presser": (Presser, 0.2), "inchworm": (Inchworm, 0.3), "snake": (Snake, 0.35)}
"""Each robot, and the arc length, m, at which its chassis begins."""
THROUGH, OVER = ("start", "end"), ("run_start", "run_end")
FITTINGS = {
    "elbow, 240 mm": (ot.Elbow(0.24), *THROUGH),
    "elbow, 160 mm": (ot.Elbow(0.16), *THROUGH),
    "tee, over the branch": (ot.Tee(), *OVER),
    "wye, over the branch": (ot.Wye(angle=math.radians(50)), *OVER),
}
INLET, PAST = 0.5, 0.2
"""Length of the straights, and how far behind the fitting a robot has passed it, m."""


SPEEDS = {"presser": 0.087, "inchworm": 0.036, "snake": 0.033}
"""Of the robots in a level pipe, m/s."""


def passes(robot: str, fitting: str, trial: int) -> float | None:
    """Return the mean speed, m/s, of a robot through a fitting; None where it does not pass."""
    kind, start = ROBOTS[robot]
    rng = np.random.default_rng([trial, list(FITTINGS).index(fitting)])
    axis, turn, roll = unit(rng.normal(size=3)), rng.uniform(0, 360), rng.uniform(0, 360)
    course = pipe(FITTINGS[fitting], axis=axis, turns=[turn], length=INLET)
    drive = Drive(kind(), course, s=start, roll=roll)
    goal = course.length - INLET + PAST
    drive.run(1.6 * (goal - start) / SPEEDS[robot], until=goal)
    return None if drive.s < goal else (drive.s - start) / drive.data.time


def main() -> None:
    """Try all robots in all fittings and print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=6)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    trials = range(arguments.trials)
    cases = [(r, f, t) for r in ROBOTS for f in FITTINGS for t in trials]
    with LocalPool(arguments.workers) as workers:
        results = dict(zip(cases, workers.map(passes, *zip(*cases, strict=True)), strict=True))
    for robot in ROBOTS:
        print(f"## {robot}\n\n| fitting | passed | mean speed, mm/s |\n|---|---|---|")
        for fitting in FITTINGS:
            speeds = [results[robot, fitting, t] for t in trials]
            passed = [1e3 * v for v in speeds if v is not None]
            mean = f"{np.mean(passed):.0f}" if passed else ""
            print(f"| {fitting} | {len(passed)} of {len(speeds)} | {mean} |")
        print()


if __name__ == "__main__":
    main()
