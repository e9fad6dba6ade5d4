"""How well robots are calibrated by the logs of short tests on a bench.

python benchmarks/bench_robots.py robots [--quick] [--robots N] [--seed S] [--out DIR]
python benchmarks/bench_robots.py alone [--quick] [--robots N] [--seed S]
python benchmarks/bench_robots.py apart [--quick] [--robots N] [--seed S]
python benchmarks/bench_robots.py presser [--quick] [--robots N] [--seed S] [--out DIR]
python benchmarks/bench_robots.py stranger [--seed S]
python benchmarks/bench_robots.py turns [--seed S] [--out DIR]

``robots`` draws robots with parameters at random, makes the logs of their bench tests, and fits
them (``ot.calibrate``) from the shipped values on. The logs come from another model than the one
that is fitted: a time step of 0.5 ms, walls of primitives, 12 % more play of the arms, and noise on
what is measured. Printed are the errors of the values and how many lie within the stated 95 %. With
--out each robot is kept in a file, and is not fitted again; so are its turns.

``alone`` fits one parameter to one log without noise at a time, all others known: what it is off by
is the error of the model in that log, for which ``ot.calibrate(model_error=)`` stands.

``apart`` gives the fit the logs of fewer tests, which cannot tell two parameters apart, and counts
how often it says so.

``presser`` calibrates robots of another kind, wall-pressers by lot, from the encoders of their
wheels, their motors' currents and a spring balance, in pipes of two bores.

``stranger`` fits one log as it is, and as a stranger may keep it.

``turns`` prints the rate of tee turns of the first robot by parameters that are guessed, that are
calibrated, and that are its own, with the doubt that the parameters leave.
"""

from __future__ import annotations

import functools
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from bench_tests import (
    CLIMB,
    CONSTANT,
    EFFICIENCY,
    FRICTION,
    IDLE,
    MASS,
    MEASURED,
    NAMES,
    NOISE,
    PRELOAD,
    PULL,
    SLIDE,
    STALL,
    TIGHT,
    scenario_of,
    value,
)
from shape import Arguments, random_gravity, table

import omnitrack_sim as ot
from omnitrack_sim.scenario import validate

REVERSAL = {CLIMB: (1.45, 2.1)}
"""Times, s, that are left out of a log: a motor's current has no sign, and which way it flows while
a robot reverses is decided within a sample."""


class Drawn(NamedTuple):
    """A parameter of robots by lot: its range, and the share by which a fit may miss it."""

    low: float
    high: float


DRAWN = {
    FRICTION: Drawn(0.6, 0.95),
    PRELOAD: Drawn(18.0, 30.0),
    MASS: Drawn(0.18, 0.45),
    CONSTANT: Drawn(0.0025, 0.0035),
    EFFICIENCY: Drawn(0.5, 0.68),
    IDLE: Drawn(0.06, 0.1),
}
"""Ranges of the robots' values, all of which are fitted; the pull of the weakest robot is twice its
weight, that of the strongest what its motors hold."""
ASKED = {path: NAMES[path] for path in (FRICTION, PRELOAD, MASS, CONSTANT)}
"""Parameters whose errors are reported, and what tables call them."""
GRIP = "friction x preload"
REST = {MASS: 0.72, "robot.drum_mass": 0.54}
"""kg, of the rest of a robot: what is wrong with a part's mass is a part of the whole one."""
FITTED_BY = (SLIDE, PULL, TIGHT, CLIMB, STALL)
"""Tests whose logs are fitted."""
OTHER = {"physics.collider": "primitives", "physics.timestep": 0.0005}
MORE_PLAY = 1.12
"""The other model, by which the logs are made."""


def draw(rng: np.random.Generator) -> dict[str, float]:
    """Draw the values of a robot."""
    return {path: float(rng.uniform(*within)) for path, within in DRAWN.items()}


def log_of(
    test: str, robot: Mapping[str, float], rng: np.random.Generator, noise: float = 1.0
) -> ot.Log:
    """Return the log of a robot's test: another model's run, with ``noise`` times that of a lab."""
    play = value(scenario_of(test), "robot.pitch_limit") * MORE_PLAY
    scenario = scenario_of(test, {**robot, **OTHER, "robot.pitch_limit": play})
    trajectory = ot.run(scenario, no_load=False).trajectory
    columns = {name: values for name, _, values in trajectory.columns()}
    low, high = REVERSAL.get(test, (np.inf, np.inf))
    left_out = (trajectory.time > low) & (trajectory.time < high)
    measured = {}
    for channel in MEASURED[test]:
        for name in trajectory.schema[channel].columns:
            noisy = columns[name] + noise * rng.normal(0.0, NOISE[channel], len(columns[name]))
            measured[name] = np.where(left_out, np.nan, noisy)
    return ot.Log(test, trajectory.time, measured)


def calibrated(logs: Sequence[ot.Log], fit: Sequence[str]) -> ot.Calibration:
    """Return the fit to logs of bench tests, each by the scenario of its name."""
    return ot.calibrate(logs, [scenario_of(log.name) for log in logs], fit, threads=1)


def measure_robot(number: int, seed: int) -> dict[str, Any]:
    """Calibrate a robot by lot, and return what comes of it as plain data."""
    rng = np.random.default_rng((seed, number))
    robot = draw(rng)
    began = time.process_time()
    logs = [log_of(test, robot, rng) for test in FITTED_BY]
    made = time.process_time()
    found = calibrated(logs, tuple(DRAWN))
    fitted = time.process_time()
    return plain(robot, found) | {"seconds": {"logs": made - began, "fit": fitted - made}}


def plain(robot: Mapping[str, float], found: ot.Calibration) -> dict[str, Any]:
    """Return a robot's true values and what a fit says of them as plain data."""
    return {
        "true": robot,
        "values": dict(zip(found.fit, found.values.tolist(), strict=True)),
        "std": dict(zip(found.fit, found.std.tolist(), strict=True)),
        "indistinct": [one.text for one in found.indistinct],
        "covariance": found.covariance.tolist(),
        "contradictions": list(found.contradictions),
    }


def kept(out: Path | None, name: str, make: Any) -> dict[str, Any]:
    """Return what a file of the folder ``out`` holds, or make it, and keep it there."""
    file = None if out is None else out / f"{name}.json"
    if file is not None and file.is_file():
        return json.loads(file.read_text(encoding="utf-8"))
    found = make()
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return found


def error(row: Mapping[str, Any], path: str) -> tuple[float, float]:
    """Return the relative error of a fitted value, and the relative standard deviation stated."""
    true, found, std = (float(row[key][path]) for key in ("true", "values", "std"))
    size = true + REST.get(path, 0.0)
    return (found - true) / size, std / size


def with_grip(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a robot's row with the product of friction and preload beside its values."""
    i, j = ([*row["values"]].index(path) for path in (FRICTION, PRELOAD))
    covariance = np.array(row["covariance"])
    grips = {key: row[key][FRICTION] * row[key][PRELOAD] for key in ("true", "values")}
    slope = np.zeros(len(covariance))
    slope[[i, j]] = row["values"][PRELOAD], row["values"][FRICTION]
    grips["std"] = float(np.sqrt(slope @ covariance @ slope))
    return {**row, **{key: {**row[key], GRIP: grip} for key, grip in grips.items()}}


def print_errors(title: str, rows: Sequence[Mapping[str, Any]], asked: Mapping[str, str]) -> None:
    """Print errors and coverage of robots' values; ``asked``: paths, and what they are called."""
    cells = []
    for path, name in asked.items():
        errors, stds = np.array([error(row, path) for row in rows]).T
        within = np.count_nonzero(np.abs(errors) <= 1.96 * stds)
        shares = np.median(np.abs(errors)), np.abs(errors).max(), np.median(stds)
        percent = [f"{100 * share:.1f} %" for share in shares]
        bias = f"{100 * np.median(errors):+.1f} %"
        cells.append([name, *percent[:2], bias, percent[2], f"{within} of {len(rows)}"])
    head = ["parameter", "error, median", "largest", "bias", "stated", "within 95 %"]
    table(title, head, cells)


def print_seconds(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print the processor time of a robot's fit."""
    made, fitted = (np.median([row["seconds"][key] for row in rows]) for key in ("logs", "fit"))
    print(f"\nProcessor seconds a robot: {made:.0f} for the logs, {fitted:.0f} for the fit.")


# The error of the model in one log

ALONE = {SLIDE: FRICTION, PULL: FRICTION, TIGHT: FRICTION, CLIMB: CONSTANT, STALL: CONSTANT}
"""The parameter that each log alone tells best."""


def error_alone(number: int, seed: int, test: str) -> float:
    """Return the relative error of a parameter that is fitted to one log without noise."""
    rng = np.random.default_rng((seed, number))
    robot, path = draw(rng), ALONE[test]
    known = {other: own for other, own in robot.items() if other != path}
    log = log_of(test, robot, rng, noise=0.0)
    found = ot.calibrate([log], scenario_of(test, known), (path,), threads=1)
    return float(found.values[0]) / robot[path] - 1


def print_alone(robots: int, seed: int) -> None:
    """Print what a parameter is off by that is fitted to one log of another model."""
    rows = []
    for test, path in ALONE.items():
        errors = 100 * np.array([error_alone(number, seed, test) for number in range(robots)])
        mean_square = np.sqrt(np.mean(errors**2))
        cells = [f"{mean_square:.1f} %", f"{errors.min():+.1f} to {errors.max():+.1f} %"]
        rows.append([test, NAMES[path], *cells])
    table("alone", ["log of", "parameter", "error, mean square", "from, to"], rows)


# Logs that cannot tell two parameters apart

APART = {
    "friction and preload": ((PULL,), (FRICTION, PRELOAD)),
    "torque constant and efficiency": ((PULL,), (CONSTANT, EFFICIENCY)),
}
"""Tests whose logs are fitted, and parameters that these cannot tell apart."""


def says_so(number: int, seed: int, tests: Sequence[str], pair: Sequence[str]) -> bool:
    """Return whether the fit to a robot's logs names a pair as what they do not tell apart."""
    rng = np.random.default_rng((seed, number))
    robot = draw(rng)
    logs = [log_of(test, robot, rng) for test in tests]
    known = {path: own for path, own in robot.items() if path not in pair}
    scenarios = [scenario_of(test, known) for test in tests]
    found = ot.calibrate(logs, scenarios, pair, threads=1)
    return any(set(pair) <= set(one.weights) for one in found.indistinct)


def print_apart(robots: int, seed: int) -> None:
    """Print how often fits say what their logs cannot tell apart."""
    rows = []
    for name, (tests, pair) in APART.items():
        said = [says_so(number, seed, tests, pair) for number in range(robots)]
        rows.append([", ".join(tests), name, f"{sum(said)} of {robots}"])
    table("apart", ["logs of", "parameters", "said so"], rows)


# A robot of another kind, from its wheel encoders and currents

BORES = (0.176, 0.183)
"""In the wider pipe the springs are 3.5 mm longer, and press less by a known force."""
PRESSER = {
    "world.friction": Drawn(0.6, 0.8),
    "robot.preload": Drawn(36.0, 44.0),
    "robot.drum_mass": Drawn(0.2, 0.5),
    "robot.motor_gain": Drawn(0.25, 0.4),
}
"""Ranges of a presser's values, all of which are fitted."""
WHEEL = {"tail_force_max": 0.5, "actuator_velocity": 0.05, "actuator_force": 0.002}
"""Standard deviations of what is measured: a spring balance's drag pointer, N; encoders of the
wheels, rad/s; currents times the known torque constant, N m."""


def presser_scenario(bore: float, robot: Mapping[str, float] | None = None) -> ot.Scenario:
    """Return a presser that drives up a pipe against a spring balance."""
    balance = {"weight": 0.0, "friction": 0.0, "stiffness": 48.0, "length": 0.12}
    data = {
        "name": f"presser_{1000 * bore:.0f}",
        "pipes": [{"kind": "straight", "length": 0.8, "inner_diameter": bore}],
        "start": {"distance": 0.18},
        "world": {"friction": 0.8},
        "robot": {"kind": "presser", "tether": balance},
        "run": {"time_limit": 3.0},
    }
    return ot.override(validate(data), robot or {})


def presser_log(bore: float, robot: Mapping[str, float], rng: np.random.Generator) -> ot.Log:
    """Return a log of a presser: a run with a step of 0.5 ms, and noise."""
    scenario = presser_scenario(bore, {**robot, "physics.timestep": OTHER["physics.timestep"]})
    trajectory = ot.run(scenario, no_load=False).trajectory
    measured = {}
    for name, _, values in trajectory.columns():
        noise = next((own for one, own in WHEEL.items() if name.startswith(one)), None)
        if noise is not None:
            measured[name] = values + rng.normal(0.0, noise, len(values))
    return ot.Log(scenario.name, trajectory.time, measured)


def measure_presser(number: int, seed: int) -> dict[str, Any]:
    """Calibrate a presser by lot, and return what comes of it as plain data."""
    rng = np.random.default_rng((seed, number))
    robot = {path: float(rng.uniform(*within)) for path, within in PRESSER.items()}
    logs = [presser_log(bore, robot, rng) for bore in BORES]
    found = ot.calibrate(logs, [presser_scenario(bore) for bore in BORES], [*PRESSER], threads=1)
    return plain(robot, found)


# What a calibration is worth to a rate

GUESSED = {
    FRICTION: Drawn(0.5, 1.0),
    PRELOAD: Drawn(15.0, 35.0),
    MASS: Drawn(0.14, 0.56),
}
"""Ranges of what is known of a robot without a bench: rubber on plastic, and assumed springs."""
WEAK = {"robot.motor": {"like": "pololu_1000_hpcb", "torque_limit": 0.4}}
"""A motor with which success in the tee turn depends on preload and friction."""
SETS, TURNS = 12, 8
"""Sets of parameters, and turns with each: orientation and direction of gravity by lot."""


def turns(values: Mapping[str, float], rng: np.random.Generator) -> list[ot.Scenario]:
    """Return tee turns by lot of a robot."""
    return [
        ot.load_scenario(
            "tee_turn",
            {
                **WEAK,
                **values,
                "start.theta5_deg": float(rng.uniform(-60.0, 60.0)),
                "world.gravity": random_gravity(rng),
            },
        )
        for _ in range(TURNS)
    ]


def spread_of(passed: Sequence[int]) -> tuple[float, float, float]:
    """Return a rate, its standard deviation between sets of parameters, and that of chance.

    Args:
        passed: of ``TURNS`` turns, by each set of parameters.
    """
    rates = np.array(passed) / TURNS
    mean = float(rates.mean())
    chance = mean * (1 - mean) / TURNS
    between = max(float(rates.var(ddof=1)) - chance, 0.0)
    return mean, float(np.sqrt(between)), float(np.sqrt(chance / len(rates)))


def drawn_sets(row: Mapping[str, Any], seed: int) -> dict[str, list[dict[str, float]]]:
    """Return sets of parameters: guessed, of a robot's calibration, and as the robot is."""
    rng = np.random.default_rng(seed)
    names = [*GUESSED]
    guessed = [
        {path: float(rng.uniform(*within)) for path, within in GUESSED.items()} for _ in range(SETS)
    ]
    at = [[*row["values"]].index(path) for path in names]
    mean, covariance = [row["values"][path] for path in names], np.array(row["covariance"])
    draws = rng.multivariate_normal(mean, covariance[np.ix_(at, at)], SETS)
    calibrated = [dict(zip(names, own, strict=True)) for own in draws.tolist()]
    return {
        "guessed": guessed,
        "calibrated": calibrated,
        "the robot itself": [{path: row["true"][path] for path in names}] * SETS,
    }


def passed_turns(sets: Sequence[Mapping[str, float]], seed: int) -> dict[str, Any]:
    """Return how many turns pass with each set of parameters, as plain data."""
    rng = np.random.default_rng(seed)
    trials = [turns(values, rng) for values in sets]
    results = ot.run_batch([one for group in trials for one in group], threads=1, no_load=False)
    success = np.array([result.success for result in results]).reshape(SETS, TURNS)
    return {"passed": success.sum(axis=1).tolist()}


def print_turns(row: Mapping[str, Any], seed: int, out: Path | None) -> None:
    """Print the rate of tee turns with the doubt of parameters, before and after calibration."""
    passed = {
        name: kept(out, f"turns, {name}", functools.partial(passed_turns, sets, seed))["passed"]
        for name, sets in drawn_sets(row, seed).items()
    }
    *_, own = passed.values()
    rows = []
    for name, each in passed.items():
        rate, between, chance = spread_of(each)
        more = 100 * (np.array(each) - own) / TURNS
        error = more.std(ddof=1) / np.sqrt(SETS)
        cells = [f"{100 * share:.0f} %" for share in (rate, between, chance)]
        rows.append(
            [name, *cells, f"{more.mean():+.0f} +- {error:.0f} points" if more.any() else "-"]
        )
    head = ["parameters", "rate", "its doubt by parameters", "by chance", "beyond the robot itself"]
    table("turns", head, rows)


# A stranger's log

STRANGER = """
file = "pull.csv"
[time]
column = "Zeit"
unit = "ms"
[columns]
tail_force_max = {{ column = "Zug", unit = "kgf" }}
{currents}
"""
"""Table of a log with other names and units; currents in mA, each module a column."""
KGF = 9.80665
"""N, of a kilogram-force."""
GAP = (1.0, 1.4)
"""Times, s, in which the stranger's logger was busy."""


def strangers_rows(log: ot.Log) -> list[str]:
    """Return lines of a log as a stranger keeps it: decimal commas, a slow balance, a gap."""
    lines = ["Zeit;Zug;Strom 1;Strom 2;Strom 3"]
    for k, at in enumerate(log.time.tolist()):
        if GAP[0] < at < GAP[1]:
            continue
        force = f"{log.values['tail_force_max'][k] / KGF:.4f}" if k % 5 == 0 else ""
        currents = [f"{1000 * log.values[f'motor_current_{i}'][k]:.2f}" for i in (1, 2, 3)]
        lines.append(";".join([f"{1000 * at:.1f}", force, *currents]).replace(".", ","))
    return lines


def written(folder: Path, lines: Sequence[str]) -> Path:
    """Write a stranger's log and its table, and return the table's path."""
    (folder / "pull.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    currents = "\n".join(
        f'motor_current_{i} = {{ column = "Strom {i}", unit = "mA" }}' for i in (1, 2, 3)
    )
    table = folder / "pull.toml"
    table.write_text(STRANGER.format(currents=currents), encoding="utf-8")
    return table


def jumped(lines: Sequence[str]) -> list[str]:
    """Return a log whose clock is put on by an hour in the middle."""
    middle, later = len(lines) // 2, []
    for line in lines[middle:]:
        at, rest = line.split(";", 1)
        later.append(f"{float(at.replace(',', '.')) + 3.6e6:.1f}".replace(".", ",") + f";{rest}")
    return [*lines[:middle], *later]


def spoilt(lines: Sequence[str]) -> list[str]:
    """Return a log with a word among its numbers."""
    return [*lines[:40], lines[40].replace(",", "x", 1), *lines[41:]]


def print_stranger(seed: int) -> None:
    """Print what the fit makes of a stranger's log, of a clock that jumps and of a spoilt line."""
    rng = np.random.default_rng(seed)
    robot = draw(rng)
    log = log_of(PULL, robot, rng)
    known = {path: own for path, own in robot.items() if path not in (FRICTION, CONSTANT)}
    scenario, lines = scenario_of(PULL, known), strangers_rows(log)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        cases = {
            "the log itself": log,
            "other names, units, rates, a gap": lines,
            "a clock that jumps": jumped(lines),
            "a word among numbers": spoilt(lines),
        }
        for name, case in cases.items():
            source = case if isinstance(case, ot.Log) else written(Path(folder), case)
            try:
                found = ot.calibrate([source], scenario, (FRICTION, CONSTANT), threads=1)
            except ot.InputError as refused:
                rows.append([name, f"refused: {str(refused).replace(folder, '')}"])
            else:
                of = zip(found.fit, found.values, found.std, strict=True)
                values = [
                    f"{NAMES[path]} {100 * (own / robot[path] - 1):+.1f} % (stated "
                    f"{100 * std / robot[path]:.1f} %)"
                    for path, own, std in of
                ]
                rows.append([name, ", ".join(values)])
    table("stranger", ["log", "error of the fit"], rows)


def main() -> None:
    """Run what the command line asks for."""
    arguments = Arguments(__doc__, trials=20, quick=2, of="robots", seed=1)
    arguments.add_argument(
        "what", choices=("robots", "alone", "apart", "presser", "stranger", "turns")
    )
    arguments.add_argument(
        "--out", type=Path, metavar="DIR", help="keeps each robot and its turns, to go on later"
    )
    given = arguments.read()
    count, seed, out = given.robots, given.seed, given.out
    if given.what == "apart":
        print_apart(count, seed)
    elif given.what == "alone":
        print_alone(count, seed)
    elif given.what == "stranger":
        print_stranger(seed)
    elif given.what == "turns":
        print_turns(kept(out, "robots_0", functools.partial(measure_robot, 0, seed)), seed, out)
    else:
        measure, asked = {
            "robots": (measure_robot, {**ASKED, GRIP: GRIP}),
            "presser": (measure_presser, {path: path.partition(".")[2] for path in PRESSER}),
        }[given.what]
        rows = [
            kept(out, f"{given.what}_{i}", functools.partial(measure, i, seed))
            for i in range(count)
        ]
        if given.what == "robots":
            rows = [with_grip(row) for row in rows]
        print_errors(given.what, rows, asked)
        if given.what == "robots":
            print_seconds(rows)


if __name__ == "__main__":
    main()
