"""Whether any command could have passed the tee turns that the default controller fails.

python benchmarks/open_loop.py [--quick] [--workers N] [--trials N] [--generations N] [--seed S]
    [--torque-limit N_M] [--friction LOW HIGH] [--preload LOW HIGH]

Drawn are random aligned tee turns (friction 0.5 to 0.8, preload 20 to 35 N, any gravity, no retry).
With --torque-limit the motor is the published one with this limit, N m, in place of one whose
speeds are prescribed: what then fails in physics is the floor of what so little torque can do.
For each that fails, CMA-ES (extra optimise) searches for belt speeds that pass, from the moment on
where the turn begins: knots over time for each module, within control.speed_limit, first as a
correction of the default controller's commands, then, where none passed, in their place. The best
commands that are found are run to the goal, and the belt speeds that were asked are told to the
same robot once more without any controller: what passes then is a command that could have passed,
and the failure is one of control. Otherwise it is one of physics as far as the number of commands
that were tried can tell. How robust the commands are tell four neighbours of each trial: friction
2 % lower and higher, and a start 1 degree to either side.

Printed are the failures by kind. Needs an operating system that can copy processes (fork).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from cmaes import CMA
from shape import Arguments, Row, Trials, run_tasks, table
from steered_turns import (
    KNOTS,
    SPACING,
    Turn,
    finish,
    go_on,
    ready,
    replay,
    steered,
    trace,
)
from tee_turns import PUBLISHED, random_tee_turns

from omnitrack_sim import Result, Scenario, override
from omnitrack_sim.base.rotations import Array

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
"""Friction that is added for commands to begin with."""


class Case(NamedTuple):
    """A failure of the default controller and what was found about it.

    Attributes:
        trial: its number. kind: how it failed.
        robust: on how many of the neighbours the best commands pass, None where none passed.
    """

    trial: int
    kind: str
    robust: int | None = None


def neighbours(scenario: Scenario) -> list[Scenario]:
    """Four trials that are hardly different."""
    friction, theta5 = scenario.world.friction, scenario.start.theta5_deg
    near = [{"world.friction": factor * friction} for factor in (0.98, 1.02)]
    near += [{"start.theta5_deg": theta5 + step} for step in (-1.0, 1.0)]
    return [override(scenario, change) for change in near]


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


class Search:
    """The search for commands that pass one trial, and its neighbours if there are such."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        short = override(scenario, SHORT)
        near = neighbours(short)
        own = ready([short, *near], 0.0)
        finish(own, np.zeros((own.n, KNOTS, 3)), False)
        begun = float(np.nanmin(steered(own).begun)) - own.period
        self.sim = ready([short] * POPULATION, begun)
        self.near = ready(near * WINNERS, begun)
        self.limit, self.seed = scenario.control.speed_limit, seed
        self.robust, self.best, self.replace = -1, np.zeros((KNOTS, 3)), False

    def run(self, replace: bool, start: Array, generations: int) -> None:
        """Search until commands pass all neighbours, for so many generations at most."""
        widest = 1.0 if replace else 2.0
        bounds = np.tile([-widest, widest], (start.size, 1))
        mean = np.clip(start.ravel() / self.limit, -0.99 * widest, 0.99 * widest)
        cma = CMA(mean, STEP, bounds, seed=self.seed, population_size=POPULATION)
        for _ in range(generations):
            asked = [cma.ask() for _ in range(POPULATION)]
            knots = self.limit * np.reshape(asked, (-1, KNOTS, 3))
            tried = go_on(self.sim, knots, replace)
            if tried.passed.any() and self._keep(knots[tried.passed][:WINNERS], replace):
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


class Lot(NamedTuple):
    """What the trials are drawn from.

    Attributes:
        seed: of the draws. friction: range of friction. preload: range of the preload, N.
        torque_limit: N m, of the published motor; None: the motor of the scenario.
    """

    seed: int
    friction: tuple[float, float]
    preload: tuple[float, float]
    torque_limit: float | None

    def turns(self, count: int) -> list[Scenario]:
        """Return the first trials."""
        motor = {"like": PUBLISHED, "torque_limit": self.torque_limit}
        changes = {} if self.torque_limit is None else {"robot.motor": motor}
        return random_tee_turns(
            count,
            seed=self.seed,
            friction=self.friction,
            preload=self.preload,
            changes=changes,
        )


def solve(case: Case, lot: Lot, generations: int) -> Case:
    """Search for commands that would have passed."""
    scenario, seed = lot.turns(case.trial + 1)[-1], lot.seed
    easier = override(scenario, {"world.friction": scenario.world.friction + EASIER})
    search = Search(scenario, seed)
    search.run(False, np.zeros((KNOTS, 3)), generations)
    if search.robust < 0:
        search.run(True, commands_of(easier), generations)
    if search.robust < 0:
        return case
    own = trace([scenario], search.best[None], np.array([search.replace]))
    assert own.passed[0]
    assert replay(scenario, own.belt_speed[:, 0]), "the same commands ended otherwise"
    return case._replace(robust=search.robust)


def commands_of(scenario: Scenario) -> Array:
    """The default controller's commands (KNOTS, 3) m/s in a turn, means about the knots."""
    own = trace([scenario], np.zeros((1, KNOTS, 3)), np.zeros(1, bool))
    at = own.since[:, 0] / SPACING
    near = [np.abs(at - knot) < 0.5 for knot in range(KNOTS)]
    cruise = np.full(3, scenario.control.cruise_speed)
    return np.array([own.wall_speed[m, 0].mean(axis=0) if m.any() else cruise for m in near])


HEADS = ("kind", "failures", "control", "of them all neighbours", "physics as far as tried")


def row(kind: str, cases: Sequence[Case]) -> list[object]:
    """Return how many failures of a kind commands could have passed."""
    control = [case.robust for case in cases if case.robust is not None]
    return [kind, len(cases), len(control), control.count(4), len(cases) - len(control)]


def main() -> None:
    """Run the trials, search for commands for those that fail, and print what was found."""
    parser = Arguments(__doc__, trials=200, quick=40, seed=1000, workers=True)
    parser.add_argument("--torque-limit", type=float, metavar="N_M", help="of the published motor")
    parser.add_argument("--friction", type=float, nargs=2, default=FRICTION, metavar="MU")
    parser.add_argument("--preload", type=float, nargs=2, default=PRELOAD, metavar="N")
    words = f"of {POPULATION} commands, of each search; {GENERATIONS} or {QUICK_GENERATIONS}"
    parser.add_argument("--generations", type=int, help=words)
    given = parser.read()
    generations = given.generations or (QUICK_GENERATIONS if given.quick else GENERATIONS)
    lot = Lot(given.seed, tuple(given.friction), tuple(given.preload), given.torque_limit)
    plan = Trials("open_loop", {"": lot.turns(given.trials)}, measure=measured)
    rows = plan.run(given.workers)[""]
    failed = [Case(i, how_it_failed(one)) for i, one in enumerate(rows) if not one["success"]]
    search = partial(solve, lot=lot, generations=generations)
    cases = run_tasks(search, failed, given.workers)
    kinds = sorted({case.kind for case in cases})
    text = f"{given.trials - len(failed)} of {given.trials} passed, seed {given.seed}"
    by_kind = (row(kind, [case for case in cases if case.kind == kind]) for kind in kinds)
    table("kinds", HEADS, by_kind, text)


if __name__ == "__main__":
    main()
