"""Whether any command could have passed the tee turns that the default controller fails.

python benchmarks/open_loop.py STUDY [--quick] [--workers N] [--trials N] [--failures N] [--seed S]
    [--generations N] [--out FOLDER]

* slippery: aligned turns, friction 0.5 to 0.8, preload 20 to 35 N, any gravity, no retry; failures
  by kind.
* torque: the first turns of `tee_turns.py motors` with little torque, standard retries. What no
  command passes is the floor of what the motor can do.

For each of the first failures commands are searched that pass at one attempt:

1. Robots are driven by the default controller with sets of its parameters by lot.
2. Where none of them passes, the belt speeds of the one that came nearest are corrected while it
   turns, by knots over time for each module: CMA-ES (extra optimise) searches them.

The commands that pass, belt speeds and rolls, are told to the same robot once more without any
controller: what passes then is a command that could have passed, and the failure is one of control.
Otherwise it is one of physics as far as the number of commands that were tried can tell.

Needs an operating system that can copy processes (fork).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from cmaes import CMA
from shape import Arguments, Row, Trials, run_tasks, table
from steered_turns import KNOTS, Tried, Turn, finish, go_on, ready, replay
from tee_turns import AGAIN, PRELOAD_RANGES, PUBLISHED, STUDIES, random_tee_turns

from omnitrack_sim import Result, Scenario, override
from omnitrack_sim.record.statistics import rate_text, wilson_interval

LIMITS = {0.4: 1, 0.245: 2}
"""Limits of the published motor, N m, and by what the number of turns is divided: with little
torque more of them fail."""
SETS = 16
"""Of parameters."""
GENERATIONS, QUICK_GENERATIONS, POPULATION, STEP = 20, 1, 16, 0.4
"""Of CMA-ES, and the standard deviation with which it begins, in parts of the speed limit."""
WIDEST = 2.0
"""Largest correction, in parts of the speed limit: from one end to the other."""
SHORT = {
    "control.kind": "steered_turns:Steered",
    "control.retry": False,
    "run.time_limit": 16.0,
    "monitor.patience": 0.08,
    "monitor.patience_time": 1.5,
    "monitor.progress": 0.01,
}
"""Changes for the search: one attempt, which is over soon where a robot hangs or creeps."""
RANGES = {
    "tracking.turn_speed": (0.7, 2.0),
    "tracking.turn_yield": (0.0, 4.0),
    "tracking.gain": (20.0, 80.0),
    "tracking.lookahead": (0.0, 0.06),
    "tracking.rotation_limit": (8.0, 30.0),
    "tracking.heading_lead": (0.03, 0.15),
    "damping.tee_turn": (0.0, 3.0),
    "sway.lean_deg": (0.0, 70.0),
    "sway.slip": (0.0, 0.2),
    "recovery.hesitation": (0.01, 0.1),
}
"""Of ``control.parameters``, from which the sets are drawn."""
Z975 = 2.2414
"""Standard normal quantile of a two-sided 97.5 % interval: two of them hold together with 95 %."""


class Case(NamedTuple):
    """A failure of the default controller and what was found about it.

    Attributes:
        turn: that failed, a scenario as plain data: other processes take no scenario.
        kind: how it failed.
        sets: of parameters that passed.
        found: whether any commands passed.
    """

    turn: Mapping[str, Any]
    kind: str = ""
    sets: int = 0
    found: bool = False


def measured(result: Result) -> dict[str, float]:
    """Return by how much a robot has turned at its end, deg."""
    w, x, y, z = result.trajectory["quaternion"][-1]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    turn = Turn.of(result.scenario)
    return {"heading_deg": float(np.degrees(np.arctan2(axis @ turn.way_out, axis @ turn.way_in)))}


def how_it_failed(row: Row) -> str:
    """Return the kind of a failure."""
    if row["outcome"] == "left_pipe":
        return "slides past"
    return "hangs half turned" if row["heading_deg"] < 70 else "hangs across the run"


def drawn(scenario: Scenario, count: int, rng: np.random.Generator) -> list[Scenario]:
    """Return a turn with sets of the controller's parameters by lot, at one attempt."""
    turns = []
    for _ in range(count):
        own = {
            f"control.parameters.{key}": float(rng.uniform(*ends)) for key, ends in RANGES.items()
        }
        aside = float(rng.uniform(0.0, 0.5))
        own["control.parameters.alignment.aside_tee_turn"] = [aside, 0.9 * aside, 0.7 * aside]
        turns.append(override(scenario, SHORT | own))
    return turns


def corrected(scenario: Scenario, begun: float, seed: int, generations: int) -> Tried | None:
    """Search for corrections with which a turn passes that begins at ``begun`` s."""
    sim = ready([scenario] * POPULATION, begun - scenario.physics.control_period)
    settings = sim.setup.settings
    limit = float(min(settings.speed_limit[0], settings.top_speed[0]))
    bounds = np.tile([-WIDEST, WIDEST], (3 * KNOTS, 1))
    cma = CMA(np.zeros(3 * KNOTS), STEP, bounds, seed=seed, population_size=POPULATION)
    for _ in range(generations):
        asked = [cma.ask() for _ in range(POPULATION)]
        knots = limit * np.reshape(asked, (-1, KNOTS, 3))
        tried = go_on(sim, knots)
        if tried.passed.any():
            return finish(ready([scenario]), knots[tried.passed][:1])
        cma.tell([(x, float(loss)) for x, loss in zip(asked, tried.loss, strict=True)])
    return None


def solve(case: Case, seed: int, generations: int) -> Case:
    """Search for commands that would have passed."""
    scenario = Scenario.model_validate(case.turn)
    turns = drawn(scenario, SETS, np.random.default_rng(seed))
    tried = finish(ready(turns))
    case = case._replace(sets=int(tried.passed.sum()))
    best = int(np.argmin(tried.loss))
    if not case.sets and np.isfinite(tried.begun[best]):
        tried = corrected(turns[best], float(tried.begun[best]), seed, generations) or tried
        best = int(np.argmin(tried.loss))
    if tried.passed[best]:
        again = replay(scenario, tried.belt_speed[:, best], tried.roll[:, best])
        case = case._replace(found=again)
    print(f"{scenario.name}: {case.sets} sets pass, {case.found}", file=sys.stderr, flush=True)
    return case


def floor_text(passed: int, total: int, found: int, tried: int) -> str:
    """Return the part of turns that commands pass, with its interval.

    Args:
        passed: turns that the controller passed.
        total: all turns.
        found: failures for which commands were found.
        tried: failures for which they were searched.
    """
    if passed == total:
        return rate_text(passed, total)
    part = 1 - (1 - passed / total) * (1 - found / tried)
    fails, lacks = (
        wilson_interval(*pair, Z975) for pair in ((total - passed, total), (tried - found, tried))
    )
    low, high = (1 - fails[end] * lacks[end] for end in (1, 0))
    return f"{100 * part:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"


def print_kinds(cases: Sequence[Case], rows: Sequence[Row]) -> None:
    """Print how many failures of each kind commands could have passed."""
    heads = ("kind", "failures", "control", "physics as far as tried")
    kinds = {kind: [one for one in cases if one.kind == kind] for kind in {c.kind for c in cases}}
    counts = (
        (kind, len(own), sum(one.found for one in own)) for kind, own in sorted(kinds.items())
    )
    text = f"{sum(row['success'] for row in rows)} of {len(rows)} passed"
    table("kinds", heads, ([kind, n, found, n - found] for kind, n, found in counts), text)


def print_floor(found: Mapping[Any, Sequence[Case]], rows: Mapping[Any, Sequence[Row]]) -> None:
    """Print by limit and range of the preload what the controller and what any command passes."""
    heads = (
        "limit, N m",
        "preload, N",
        "passed by the controller",
        "failures tried",
        "commands found",
        "some command passes, at least",
    )

    def lines() -> Iterator[list[object]]:
        for (limit, number), cases in found.items():
            low, high = PRELOAD_RANGES[number]
            turns = rows[limit, number]
            passed, count = sum(row["success"] for row in turns), sum(one.found for one in cases)
            yield [
                f"{limit:g}",
                f"{low:g} to {high:g}",
                rate_text(passed, len(turns)),
                len(cases),
                count,
                floor_text(passed, len(turns), count, len(cases)),
            ]

    tried = [case for cases in found.values() for case in cases]
    sets = sum(case.sets for case in tried) / max(1, SETS * len(tried))
    text = f"A set of parameters by lot passes {100 * sets:.0f} % of the failures at one attempt."
    table("floor", heads, lines(), text)


def main() -> None:
    """Run the trials, search for commands for those that fail, and print what was found."""
    parser = Arguments(__doc__, trials=200, quick=8, workers=True)
    parser.add_argument("study", choices=("slippery", "torque"), metavar="STUDY")
    parser.add_argument("--failures", type=int, default=200, metavar="N", help="of a cell, at most")
    words = f"of {POPULATION} corrections; default {GENERATIONS}, quick {QUICK_GENERATIONS}"
    parser.add_argument("--generations", type=int, help=words)
    parser.add_argument("--out", type=Path, help="keeps the trials, and goes on where it was")
    parser.add_argument("--seed", type=int, help="of the trials; default of the study")
    given = parser.read()
    study, slippery = STUDIES["motors"], given.study == "slippery"
    first = given.seed or (1000 if slippery else study.seed)
    if slippery:
        cells = {
            (): random_tee_turns(
                given.trials, seed=first, friction=(0.5, 0.8), preload=(20.0, 35.0)
            )
        }
    else:
        cells = {
            (limit, number): random_tee_turns(
                -(-given.trials // share),
                seed=first + number,
                **study.turns,
                preload=preload,
                changes=AGAIN | {"robot.motor": {"like": PUBLISHED, "torque_limit": limit}},
            )
            for limit, share in LIMITS.items()
            for number, preload in enumerate(PRELOAD_RANGES)
        }
    plan = Trials(f"open_loop_{given.study}", cells, measure=measured)
    rows = plan.run(given.workers, given.out)
    failed = {
        cell: [
            Case(turn.model_dump(mode="json"), how_it_failed(row))
            for turn, row in zip(turns, rows[cell], strict=True)
            if not row["success"]
        ][: given.failures]
        for cell, turns in cells.items()
    }
    generations = given.generations or (QUICK_GENERATIONS if given.quick else GENERATIONS)
    search = partial(solve, seed=first, generations=generations)
    cases = iter(
        run_tasks(search, [case for own in failed.values() for case in own], given.workers)
    )
    found = {cell: [next(cases) for _ in own] for cell, own in failed.items()}
    if slippery:
        print_kinds(found[()], rows[()])
    else:
        print_floor(found, rows)


if __name__ == "__main__":
    main()
