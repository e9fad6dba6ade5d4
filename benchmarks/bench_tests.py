"""What each short test of a bench tells of a robot, and what it cannot tell apart.

python benchmarks/bench_tests.py

Printed is how many standard deviations of its noise a channel of a test changes by, in the mean
square over time, if a parameter grows by 1 %, a mass by 1 % of the robot's; then which parameters a
test cannot tell apart: pairs whose effects on all its channels have the same course.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from shape import Arguments, table

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Array

SLIDE, PULL, TIGHT, CLIMB, STALL, ELBOW = TESTS = (
    "slide",
    "pull",
    "pull_tight",
    "climb",
    "stall",
    "elbow",
)
NOISE = {
    "distance": 2e-3,
    "tail_force": 0.5,
    "tail_force_max": 0.5,
    "belt_speed": 1e-3,
    "motor_current": 5e-3,
}
"""Standard deviations of what is measured: a film of the pipe, m; a spring balance and its drag
pointer, N; encoders at the belts, m/s; a motor driver's current, A."""
MEASURED = {
    SLIDE: ("distance",),
    PULL: ("tail_force_max", "motor_current"),
    TIGHT: ("tail_force_max", "motor_current"),
    CLIMB: ("belt_speed", "motor_current"),
    STALL: ("tail_force", "belt_speed", "motor_current"),
    ELBOW: ("belt_speed", "motor_current"),
}
"""Channels that a lab has of each test."""
MASS = "robot.chassis_mass"
FRICTION, PRELOAD = "world.friction", "robot.preload"
CONSTANT = "robot.motor.winding.torque_constant"
EFFICIENCY, IDLE = "robot.motor.efficiency", "robot.motor.winding.no_load_current"
NAMES = {
    FRICTION: "friction",
    PRELOAD: "preload",
    MASS: "mass",
    CONSTANT: "torque constant",
    EFFICIENCY: "gears' efficiency",
    IDLE: "no-load current",
    "robot.motor.no_load_speed": "no-load speed",
    "robot.motor.stall_torque": "stall torque",
    "robot.motor.rotor_inertia": "rotor inertia",
    "robot.contact_length": "contact length",
    "robot.pitch_limit": "play",
}
"""Parameters of the matrix, and what the tables call them."""
STEP = 0.05
"""Of central differences, as a part of a value."""
SAME_COURSE = 0.95
"""Size of the cosine of two parameters' effects from which on a test cannot tell them apart."""
SHOWN = 0.05
"""Effect of a parameter, in standard deviations for 1 %, below which a channel says nothing."""


def scenario_of(test: str, changes: Mapping[str, Any] | None = None) -> ot.Scenario:
    """Return the scenario of a test with a robot's values."""
    return ot.load_scenario(f"calibration/{test}", changes or {})


def value(scenario: ot.Scenario, path: str) -> float:
    """Return a number of a scenario by its dotted path."""
    return float(operator.attrgetter(path)(scenario))


def one_part(scenario: ot.Scenario, path: str) -> float:
    """Return the value by which 1 changes a parameter by its own size, of a mass the robot's."""
    return scenario.robot.mass if path == MASS else value(scenario, path)


Effects = Mapping[str, Mapping[str, Array]]
"""Changes (T, k) of channels, in standard deviations of their noise, for 1 % of each parameter."""


def effects(test: str) -> Effects:
    """Return what each parameter changes in a test, by central differences."""
    base = scenario_of(test)
    sides = [
        ot.override(base, {path: value(base, path) + side * STEP * one_part(base, path)})
        for path in NAMES
        for side in (1, -1)
    ]
    runs = [result.trajectory for result in ot.run_batch(sides, no_load=False)]
    length = min(len(run.time) for run in runs)  # a run is over where a robot has left the pipe
    found: dict[str, dict[str, Array]] = {}
    for path, up, down in zip(NAMES, runs[::2], runs[1::2], strict=True):
        found[path] = {}
        for name in MEASURED[test]:
            change = up[name][:length] - down[name][:length]
            found[path][name] = change.reshape(length, -1) / (200 * STEP * NOISE[name])
    return found


def matrix_rows(test: str, found: Effects) -> list[list[str]]:
    """Return a row for each channel of a test: the mean size of each parameter's effect."""
    rows = []
    for name in MEASURED[test]:
        sizes = [np.sqrt(np.mean(found[path][name] ** 2)) for path in NAMES]
        rows.append([test, name, *(f"{size:.2g}" if size >= SHOWN else "-" for size in sizes)])
    return rows


def alike(found: Effects) -> list[str]:
    """Return the parameters that a test sees, in groups that it cannot tell apart."""
    vectors = {
        path: np.concatenate([change.ravel() for change in changes.values()])
        for path, changes in found.items()
        if any(np.sqrt(np.mean(change**2)) >= SHOWN for change in changes.values())
    }
    pairs = []
    for a, b in combinations(vectors, 2):
        product = vectors[a] @ vectors[b]
        cosine = product / np.sqrt((vectors[a] @ vectors[a]) * (vectors[b] @ vectors[b]))
        if abs(cosine) > SAME_COURSE:
            pairs.append(f"{NAMES[a]} and {NAMES[b]}")
    return pairs


def main() -> None:
    """Print the matrix, and what each test cannot tell apart."""
    Arguments(__doc__).read()
    found = {test: effects(test) for test in TESTS}
    rows = [row for test in TESTS for row in matrix_rows(test, found[test])]
    table("sensitivities", ["test", "channel", *NAMES.values()], rows)
    pairs = [[test, "; ".join(alike(found[test])) or "-"] for test in TESTS]
    table("alike", ["test", "cannot tell apart"], pairs)


if __name__ == "__main__":
    main()
