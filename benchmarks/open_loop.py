"""Whether any command could have passed the tee turns that the default controller fails.

python benchmarks/open_loop.py [--quick] [--workers N] [--trials N] [--generations N] [--seed S]

Runs random aligned tee turns (friction 0.5 to 0.8, preload 20 to 35 N, any gravity,
no retry). For each that fails, CMA-ES (extra optimise) searches for belt speeds that pass, from the
moment on where the turn begins: knots over time for each module, within control.speed_limit, first
as a correction of the default controller's commands, then, where none passed, in their place. The
best commands that are found are run to the goal, and the belt speeds that were asked are told to
the same robot once more without any controller: what passes then is a command that could have
passed, and the failure is one of control. Otherwise it is one of physics as far as the number of
commands that were tried can tell.

How robust the commands are, and how unlucky the controller was, tell four neighbours of each trial:
friction 2 % lower and higher, and a start 1 degree to either side.

Prints a line for each failure, the failures by kind, and where passing and failing commands differ.
Needs an operating system that can copy processes (fork).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from cmaes import CMA
from shape import Arguments, table
from steered_turns import (
    KNOTS,
    SPACING,
    Trace,
    Turn,
    finish,
    go_on,
    ready,
    replay,
    steered,
    trace,
)
from tee_turns import random_tee_turns

from omnitrack_sim import Result, Scenario, override, run_batch
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.workers import LocalPool

FRICTION, PRELOAD = (0.5, 0.8), (20.0, 35.0)
GENERATIONS, QUICK_GENERATIONS = 40, 4
POPULATION = 24
STEP = 0.3
"""Standard deviation with which a search begins, in parts of the speed limit."""
WINNERS = 6
"""Passing commands of a generation that are tried on the neighbours."""
SHORT = {"run.time_limit": 9.0}
"""Changes for the search: s, more than it takes to pass, and less than to hang."""
EASIER = 0.2
"""Friction that is added for runs to compare with."""
MARKS_MM = (80, 60, 40, 20, 0)
"""Places before the branch's axis where robots are compared."""


class Case(NamedTuple):
    """A failure of the default controller and what was found about it.

    Attributes:
        trial: its number. kind: how it failed. detail: the same with figures.
        neighbours: how many of its neighbours the default controller passes.
        tried: number of commands. passing: how many of them passed, and of the first generation of
            the first search.
        robust: on how many of the neighbours the best commands pass, None where none passed.
        traces: of the controller's own run, of the best commands, and with more friction; modules
            are the inner one, the outer one that is nearer to the branch, and the other one.
    """

    trial: int
    kind: str
    detail: str
    neighbours: int = 0
    tried: int = 0
    passing: int = 0
    at_random: int = 0
    robust: int | None = None
    traces: Trace | None = None

    @property
    def verdict(self) -> str:
        """What the failure is one of."""
        return "physics" if self.traces is None else "control"


def neighbours(scenario: Scenario) -> list[Scenario]:
    """Four trials that are hardly different."""
    friction, theta5 = scenario.world.friction, scenario.start.theta5_deg
    near = [{"world.friction": factor * friction} for factor in (0.98, 1.02)]
    near += [{"start.theta5_deg": theta5 + step} for step in (-1.0, 1.0)]
    return [override(scenario, change) for change in near]


def how_it_failed(result: Result) -> tuple[str, str]:
    """Kind of a failure, and the same with figures."""
    turn, run = Turn.of(result.scenario), result.trajectory
    w, x, y, z = run["quaternion"].T
    axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    heading = np.degrees(np.arctan2(axis @ turn.way_out, axis @ turn.way_in))
    past = -1000 * turn.before(run["position"])
    if result.outcome.value == "left_pipe":
        kind, there = "slides past", int(np.argmax(past > 0))
    else:
        kind = "hangs half turned" if heading[-1] < 70 else "hangs across the run"
        there = -1
    side = "past" if past[there] > 0 else "before"
    where = f"turned {heading[there]:.0f} deg, {abs(past[there]):.0f} mm {side} the branch's axis"
    return kind, f"{kind}: {where}"


class Search:
    """The search for commands that pass one trial, and its neighbours if there are such."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        short = override(scenario, SHORT)
        near = neighbours(short)
        own = ready([short, *near], 0.0)
        tried = finish(own, np.zeros((own.n, KNOTS, 3)), False)
        self.neighbours = int(tried.passed[1:].sum())
        begun = float(np.nanmin(steered(own).begun)) - own.period
        self.sim = ready([short] * POPULATION, begun)
        self.near = ready(near * WINNERS, begun)
        self.limit, self.seed = scenario.control.speed_limit, seed
        self.tried = self.passing = self.at_random = 0
        self.robust, self.best, self.replace = -1, np.zeros((KNOTS, 3)), False

    def run(self, replace: bool, start: Array, generations: int) -> None:
        """Search until commands pass all neighbours, for so many generations at most."""
        widest = 1.0 if replace else 2.0
        bounds = np.tile([-widest, widest], (start.size, 1))
        mean = np.clip(start.ravel() / self.limit, -0.99 * widest, 0.99 * widest)
        cma = CMA(mean, STEP, bounds, seed=self.seed, population_size=POPULATION)
        for generation in range(generations):
            asked = [cma.ask() for _ in range(POPULATION)]
            knots = self.limit * np.reshape(asked, (-1, KNOTS, 3))
            tried = go_on(self.sim, knots, replace)
            self.tried, passing = self.tried + POPULATION, int(tried.passed.sum())
            self.passing += passing
            if generation == 0 and not replace:
                self.at_random = passing
            if passing and self._keep(knots[tried.passed][:WINNERS], replace):
                return
            cma.tell([(x, float(loss)) for x, loss in zip(asked, tried.loss, strict=True)])

    def _keep(self, knots: Array, replace: bool) -> bool:
        """Keep the most robust of some commands that pass; whether they pass all neighbours."""
        count = self.near.n // WINNERS
        again = go_on(self.near, np.repeat(knots, count, axis=0), replace)
        robust = again.passed.reshape(-1, count).sum(axis=1)
        if robust.max() > self.robust:
            self.robust, self.replace = int(robust.max()), replace
            self.best = knots[robust.argmax()]
        return self.robust == count


def turns(count: int, seed: int) -> list[Scenario]:
    """The trials."""
    return random_tee_turns(count, seed=seed, friction=FRICTION, preload=PRELOAD)


def solve(case: Case, seed: int, generations: int) -> Case:
    """Search for commands that would have passed."""
    scenario = turns(case.trial + 1, seed)[-1]
    easier = override(scenario, {"world.friction": scenario.world.friction + EASIER})
    search = Search(scenario, seed)
    search.run(False, np.zeros((KNOTS, 3)), generations)
    if search.robust < 0:
        search.run(True, commands_of(easier), generations)
    found = case._replace(
        neighbours=search.neighbours,
        tried=search.tried,
        passing=search.passing,
        at_random=search.at_random,
    )
    if search.robust < 0:
        return found
    knots = np.zeros((3, KNOTS, 3))
    knots[1] = search.best
    traces = trace([scenario, scenario, easier], knots, np.array([False, search.replace, False]))
    assert traces.passed[1]
    assert replay(scenario, traces.belt_speed[:, 1]), "the same commands ended otherwise"
    order = [0, 1, 2] if scenario.start.theta5_deg < 0 else [0, 2, 1]
    traces = traces._replace(wall_speed=traces.wall_speed[..., order])
    return found._replace(robust=search.robust, traces=traces)


def commands_of(scenario: Scenario) -> Array:
    """The default controller's commands (KNOTS, 3) m/s in a turn, means about the knots."""
    own = trace([scenario], np.zeros((1, KNOTS, 3)), np.zeros(1, bool))
    at = own.since[:, 0] / SPACING
    near = [np.abs(at - knot) < 0.5 for knot in range(KNOTS)]
    cruise = np.full(3, scenario.control.cruise_speed)
    return np.array([own.wall_speed[m, 0].mean(axis=0) if m.any() else cruise for m in near])


def stretches(run: Trace, robot: int) -> Array:
    """Return what a robot did between two marks each (M - 1, 5).

    These are the heading at the second, deg; advance along the run and commands of the modules,
    mm/s. Not a number where it did not get there.
    """
    before, since = 1000 * run.before[:, robot], run.since[:, robot]
    found = np.full((len(MARKS_MM) - 1, 5), np.nan)
    reached = [np.flatnonzero((before <= mark) & (since >= 0))[:1] for mark in MARKS_MM]
    for i, (first, last) in enumerate(itertools.pairwise(reached)):
        if len(last) and last[0] > first[0]:
            speed = 1000 * run.wall_speed[first[0] : last[0], robot].mean(axis=0)
            advance = (before[first[0]] - before[last[0]]) / (since[last[0]] - since[first[0]])
            found[i] = np.degrees(run.heading[last[0], robot]), advance, *speed
    return found


def line(case: Case, scenario: Scenario) -> list[str]:
    """Return a failure's row of the table."""
    turn = Turn.of(scenario)
    gravity = np.array(scenario.world.gravity)
    along, towards = gravity @ turn.way_in, gravity @ turn.way_out
    aside = np.sqrt(max(0.0, gravity @ gravity - along**2 - towards**2))
    best = "-" if case.robust is None else f"{case.robust} of 4"
    return [
        str(case.trial),
        f"{scenario.world.friction:.2f}",
        f"{scenario.robot.preload:.0f} N",
        f"{along:.1f}, {towards:.1f}, {aside:.1f}",
        case.detail,
        f"{case.neighbours} of 4",
        f"{case.at_random} of {POPULATION}",
        str(case.tried),
        best,
        case.verdict,
    ]


HEADS = (
    "trial",
    "friction",
    "preload",
    "gravity along the run, towards the branch, aside, m/s2",
    "how it failed",
    "neighbours passed",
    "random corrections passed",
    "commands tried",
    "best on neighbours",
    "verdict",
)


STRETCH_HEADS = (
    "before the branch's axis",
    "run",
    "heading at its end, deg",
    "advance, mm/s",
    "inner module asked",
    "outer one nearer to the branch",
    "the other",
)


KIND_HEADS = ("kind", "failures", "control", "of them all neighbours", "physics as far as tried")


def kind_row(kind: str, cases: Sequence[Case]) -> list[object]:
    """Return how many failures of a kind commands could have passed."""
    control = [case for case in cases if case.verdict == "control"]
    robust = sum(case.robust == 4 for case in control)
    return [kind, len(cases), len(control), robust, len(cases) - len(control)]


def stretch_rows(traces: Sequence[Trace]) -> Iterator[list[str]]:
    """Yield the means of each stretch and run."""
    for i, (far, near) in enumerate(itertools.pairwise(MARKS_MM)):
        for robot, name in enumerate(("controller", "commands that pass", "controller, friction")):
            values = np.array([stretches(run, robot)[i] for run in traces])
            there = values[~np.isnan(values).any(axis=1)]
            means = [f"{mean:.0f}" for mean in there.mean(axis=0)] if len(there) else ["-"] * 5
            label = f"{name} +{EASIER}" if robot == 2 else name
            yield [f"{far} to {near} mm", label, *means]


def report(cases: Sequence[Case]) -> None:
    """Print the failures by kind, and where passing commands differ."""
    kinds = sorted({case.kind for case in cases})
    rows = (kind_row(kind, [case for case in cases if case.kind == kind]) for kind in kinds)
    table("kinds", KIND_HEADS, rows)
    traces = [case.traces for case in cases if case.traces is not None]
    if traces:
        text = f"Means of {len(traces)} failures with commands that pass, of runs that get there:"
        table("stretches", STRETCH_HEADS, stretch_rows(traces), text)


def main() -> None:
    """Run the trials, search for commands for those that fail, and print what was found."""
    parser = Arguments(__doc__, trials=200, quick=40, seed=1000, workers=True)
    words = f"of {POPULATION} commands, of each search; {GENERATIONS} or {QUICK_GENERATIONS}"
    parser.add_argument("--generations", type=int, help=words)
    given = parser.read()
    generations = given.generations or (QUICK_GENERATIONS if given.quick else GENERATIONS)
    scenarios = turns(given.trials, given.seed)
    results = run_batch(scenarios, threads=given.workers, no_load=False)
    failed = [
        Case(trial, *how_it_failed(result))
        for trial, result in enumerate(results)
        if not result.success
    ]
    cases: list[Case] = []

    def solved() -> Iterator[list[str]]:
        with LocalPool(given.workers) as pool:
            for case in pool.map(partial(solve, seed=given.seed, generations=generations), failed):
                cases.append(case)
                yield line(case, scenarios[case.trial])

    text = f"{given.trials - len(failed)} of {given.trials} passed, seed {given.seed}"
    table("failures", HEADS, solved(), text)
    report(cases)


if __name__ == "__main__":
    main()
