"""Random tee turns: what laws, sizes of the robot and the time step are worth, on the same trials.

python benchmarks/tee_turns.py STUDY ... [--trials N] [--quick] [--seed S] [--workers N]

Trials have any gravity, and theta5 within 11 degrees of the best if a study does not say otherwise.

* rates: friction 0.5 to 0.8, preload 20 to 35 N; sway, alignment and retries.
* weak: friction 0.6 to 0.8, preload 15 to 20 N, theta5 within 60 degrees; how tracks back off.
* motors: friction 0.6 to 1.0, preload 15 to 35 N, any theta5, standard retries; the motor that the
  paper names by its own line, up to stall and with limits, beside `simulation`.
* torque: friction 0.6 and 1, any theta5, standard retries; preload against limits of the published
  motor, a table for each friction.
* length, shafts, preload: sizes of the robot, at friction 0.8 to 1.0.
* scales: similar robots in similar pipes, at friction 0.6 to 1.0, any theta5, standard retries.
* steps: time steps, at friction 0.8 to 1.0 and preload 15 to 35 N. Compared are turns that pass at
  all steps, with the finest: the ratio of the means, and the median of the ratios.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from shape import (
    Arguments,
    Row,
    Trials,
    compare,
    endings,
    mean_of,
    modules_of,
    random_gravity,
    rate,
    table,
)

from omnitrack_sim import Scenario, load_scenario, override


def random_tee_turns(
    count: int,
    *,
    seed: int = 0,
    friction: tuple[float, float] = (0.8, 1.0),
    preload: tuple[float, float] = (15.0, 35.0),
    theta5_deg: float = 11.0,
    changes: Mapping[str, Any] | None = None,
) -> list[Scenario]:
    """Draw tee turns with theta5 uniform within +-theta5_deg and random gravity.

    Friction and preload, N a module, are uniform in their ranges. The draw of trial i does not
    depend on ``changes``, so that two studies compare the same trials.
    """
    rng = np.random.default_rng(seed)
    base = load_scenario("tee_turn")
    scenarios = []
    for index in range(count):
        gravity = random_gravity(rng)
        draw = {
            "name": f"tee_turn_{index}",
            "start.theta5_deg": float(rng.uniform(-theta5_deg, theta5_deg)),
            "world.friction": float(rng.uniform(*friction)),
            "robot.preload": float(rng.uniform(*preload)),
            "world.gravity": gravity,
            "control.align": False,
            "control.retry": False,
        }
        scenarios.append(override(base, draw | dict(changes or {})))
    return scenarios


def ends(rows: Sequence[Row]) -> str:
    """Return how the turns ended that did not pass."""
    return endings(row["outcome"] for row in rows if not row["success"])


def rate_after_backing_off(rows: Sequence[Row]) -> str:
    """Return how many of the turns passed in which the robot backed off."""
    return rate([row for row in rows if row["attempts"] > 1])


def mean_time(rows: Sequence[Row]) -> str:
    """Return the mean time of the turns that passed."""
    times = [row["duration_s"] for row in rows if row["success"]]
    return f"{np.mean(times):.2f} s" if times else "-"


def preloaded(rows: Sequence[Row], low: float, high: float) -> list[Row]:
    """Return the turns with a preload from ``low`` to ``high`` N a module."""
    return [row for row in rows if low <= row["preload"] < high]


def figure_of(rows: Sequence[Row], metric: str, digits: int) -> str:
    """Return the mean, over turns that passed, of the module with the most of a metric."""
    each = [modules_of(row, metric) for row in rows if row["success"]]
    largest = [max(values) for values in each if values and None not in values]
    return f"{np.mean(largest):.{digits}f}" if largest else "-"


PRELOAD_RANGES = ((15.0, 20.0), (20.0, 35.0))
"""Ranges of the preload, N a module: below 20 N walls hold less, above it turns take torque."""
BY_PRELOAD = {
    f"passed, {low:g} to {high:g} N": lambda rows, low=low, high=high: rate(
        preloaded(rows, low, high)
    )
    for low, high in PRELOAD_RANGES
}
SIZES = {
    "passed": lambda rows: f"{sum(row['success'] for row in rows)} of {len(rows)}",
    "mean time": mean_time,
    "others": ends,
}
"""Columns of the studies of sizes."""


@dataclass(frozen=True)
class Study:
    """Variants of the same random turns.

    Attributes:
        variants: changes of the scenario by name.
        draws: arguments of ``random_tee_turns`` by name, of variants that draw other trials.
        trials: by default.
        seed: by default.
        turns: arguments of ``random_tee_turns`` of all variants.
        preloads: ranges of the preload, N a module, of which each has so many trials; none: one.
        columns: texts of the trials of a variant, by their heads.
        head: of the column of variants.
    """

    variants: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    draws: Mapping[Hashable, Mapping[str, Any]] = field(default_factory=dict)
    trials: int = 96
    seed: int = 1
    turns: Mapping[str, Any] = field(default_factory=dict)
    preloads: Sequence[tuple[float, float]] = ()
    columns: Mapping[str, Callable[[Sequence[Row]], str]] = field(default_factory=lambda: SIZES)
    head: str = "variant"

    def draw(self, trials: int, seed: int) -> dict[Hashable, list[Scenario]]:
        """Draw the turns of each variant."""
        arguments: dict[Hashable, Mapping[str, Any]] = {
            name: {"changes": changes} for name, changes in self.variants.items()
        }
        ranges = [{"preload": preload} for preload in self.preloads] or [{}]
        return {
            name: [
                turn
                for number, preload in enumerate(ranges)
                for turn in random_tee_turns(
                    trials, seed=seed + number, **self.turns, **preload, **own
                )
            ]
            for name, own in (arguments | dict(self.draws)).items()
        }


AGAIN = {"control.align": True, "control.retry": True}
NO_SWAY = {"control.parameters.sway.lean_deg": 0.0}
PUBLISHED = "pololu_1000_hpcb"
LIMITS = {"limit 0.6 N m": 0.6, "limit 0.4 N m": 0.4, "recommended limit, 0.245 N m": 0.245}
"""Limits of the published motor, N m."""
FRICTIONS, PRELOADS = (0.6, 1.0), (15.0, 20.0, 25.0, 30.0)
"""Friction and preload, N a module, of the map of limits."""
STEPS = (0.00025, 0.001, 0.002, 0.0025, 0.005)
"""Time steps, s; the finest first."""
SCALES = (0.625, 1.0, 1.875, 3.0)
"""Sizes of the robot: for pipes of 100, 160, 300 and 480 mm."""


def similar(scale: float) -> dict[str, Any]:
    """Return the changes that scale a tee turn, as docs/explanation/physics.md lists them."""
    one, root = load_scenario("tee_turn"), float(np.sqrt(scale))
    bore = {"inner_diameter": scale * one.robot.nominal_bore}
    way = {"enter": "run_start", "leave": "branch"}
    straights = [{"kind": "straight", "length": scale * m, **bore} for m in (0.3, 0.4)]
    slower = ("cruise_speed", "speed_limit")
    changes: dict[str, Any] = {
        "robot.scale": scale,
        "pipes": [straights[0], {"kind": "tee", **way, **bore}, straights[1]],
        "start.distance": scale * one.start.distance,
        "physics.wall_tolerance": scale * one.physics.wall_tolerance,
        "physics.timestep": root * one.physics.timestep,
        "physics.control_period": root * one.physics.control_period,
        "record.period": root * one.record.period,
    }
    return changes | {f"control.{key}": root * getattr(one.control, key) for key in slower}


STUDIES = {
    "rates": Study(
        {
            "one attempt": {},
            "one attempt, no sway": NO_SWAY,
            "rolled first": {"control.align": True},
            "rolled first, with retries": AGAIN,
            "the same, no sway": AGAIN | NO_SWAY,
        },
        trials=200,
        seed=202,
        turns={"friction": (0.5, 0.8), "preload": (20.0, 35.0)},
        columns={
            "passed": rate,
            "torque change, N m/s": lambda rows: mean_of(rows, "torque_change_nm_s"),
            "energy, J": lambda rows: mean_of(rows, "energy_j"),
            "largest tilt, deg": lambda rows: mean_of(rows, "tilt_max_deg"),
        },
    ),
    "weak": Study(
        {
            "tracks rolled to the wall": AGAIN,
            "tracks left as they are": AGAIN | {"control.parameters.recovery.square": False},
        },
        trials=400,
        seed=203,
        turns={"friction": (0.6, 0.8), "preload": (15.0, 20.0), "theta5_deg": 60.0},
        columns={"passed": rate, "of those that backed off": rate_after_backing_off},
        head="before backing off",
    ),
    "motors": Study(
        {
            "`simulation`": AGAIN,
            "published motor, up to stall (1.18 N m)": AGAIN | {"robot.motor": PUBLISHED},
        }
        | {
            f"published motor, {name}": AGAIN
            | {"robot.motor": {"like": PUBLISHED, "torque_limit": limit}}
            for name, limit in LIMITS.items()
        },
        trials=300,
        seed=31,
        turns={"friction": (0.6, 1.0), "theta5_deg": 180.0},
        preloads=PRELOAD_RANGES,
        columns={
            **BY_PRELOAD,
            "time, s": lambda rows: figure_of(rows, "duration_s", 1),
            "shaft above 0.245 N m, s": lambda rows: figure_of(rows, "time_above_recommended_s", 1),
            "largest current, A": lambda rows: figure_of(rows, "motor_current_max_a", 2),
            "winding, °C": lambda rows: figure_of(rows, "winding_temperature_max_c", 0),
            "others": ends,
        },
        head="motor",
    ),
    "torque": Study(
        draws={
            (friction, preload, limit): {
                "friction": (friction, friction),
                "preload": (preload, preload),
                "changes": AGAIN | {"robot.motor": {"like": PUBLISHED, "torque_limit": limit}},
            }
            for friction in FRICTIONS
            for preload in PRELOADS
            for limit in LIMITS.values()
        },
        trials=40,
        seed=37,
        turns={"theta5_deg": 180.0},
    ),
    "length": Study(
        {
            f"contact length {1000 * x:.0f} mm": {"robot.contact_length": x}
            for x in (0.07, 0.08, 0.09, 0.1, 0.11)
        }
    ),
    "shafts": Study(
        {
            f"shaft spacing {1000 * x:.0f} mm": {"robot.shaft_spacing": x}
            for x in (0.09, 0.11, 0.126, 0.15, 0.18)
        }
    ),
    "preload": Study(
        draws={
            f"preload {low:.0f}-{low + 5:.0f} N": {"preload": (low, low + 5)}
            for low in (10.0, 15.0, 20.0, 25.0, 30.0)
        }
    ),
    "scales": Study(
        {f"{scale:g}": AGAIN | similar(scale) for scale in SCALES},
        trials=100,
        seed=41,
        turns={"friction": (0.6, 1.0), "theta5_deg": 180.0},
        columns={"passed": rate, "mean time": mean_time, "others": ends},
        head="scale",
    ),
    "steps": Study(
        {
            f"{1000 * step:g}": {"physics.timestep": step, "physics.control_period": 0.01}
            for step in STEPS
        },
        trials=64,
        seed=5,
    ),
}
STEP_FIGURES = {"slip": "slip_distance_m", "energy": "energy_j", "largest tilt": "tilt_max_deg"}
"""Metrics that are compared between time steps."""


def print_steps(runs: Mapping[str, Sequence[Row]]) -> None:
    """Print the metrics of each time step against those of the finest."""
    whole = np.all([[row["success"] for row in rows] for rows in runs.values()], axis=0)
    finest, lines = next(iter(runs.values())), []
    for step, rows in runs.items():
        cells = [step, sum(row["success"] for row in rows)]
        for metric in STEP_FIGURES.values():
            own, best = (
                np.array([np.sum(modules_of(row, metric)) for row in turns])[whole]
                for turns in (rows, finest)
            )
            ratios = (own.sum() / best.sum(), np.median(own / best))
            cells += [f"{100 * (ratio - 1):+.1f} %" for ratio in ratios]
        lines.append(cells)
    heads = [f"{name}: {what}" for name in STEP_FIGURES for what in ("means", "median of pairs")]
    text = f"{whole.sum()} of {len(finest)} turns pass at all steps; of these:"
    table("steps", ["step, ms", "passed", *heads], lines, text)


def print_torque(runs: Mapping[Any, Sequence[Row]]) -> None:
    """Print how many turns pass by preload and limit of the motor, a table for each friction."""
    heads = ["preload, N", *(f"{limit:g} N m" for limit in LIMITS.values())]
    for friction in FRICTIONS:
        cells = (
            [f"{preload:g}", *(rate(runs[friction, preload, limit]) for limit in LIMITS.values())]
            for preload in PRELOADS
        )
        table(f"friction {friction:g}", heads, cells, f"Friction {friction:g}:")


def main() -> None:
    """Run the studies that are asked for, and print their tables."""
    arguments = Arguments(__doc__, workers=True)
    arguments.add_argument("studies", nargs="+", choices=tuple(STUDIES), metavar="STUDY")
    words = "of a variant, and of each of its ranges of preload; default of the study"
    arguments.add_argument("--trials", type=int, help=words)
    arguments.add_argument("--seed", type=int, help="of the trials; default of the study")
    arguments.add_argument("--quick", action="store_true", help="8 trials a variant")
    given = arguments.read()
    for name in given.studies:
        study = STUDIES[name]
        trials = given.trials or (8 if given.quick else study.trials)
        turns = study.draw(trials, study.seed if given.seed is None else given.seed)
        runs = Trials(name, turns, {"preload": lambda one: one.robot.preload}).run(given.workers)
        if name == "motors":
            compare("headline", runs, BY_PRELOAD, study.head)
        if name == "steps":
            print_steps(runs)
        elif name == "torque":
            print_torque(runs)
        else:
            compare(name, runs, study.columns, study.head)


if __name__ == "__main__":
    main()
