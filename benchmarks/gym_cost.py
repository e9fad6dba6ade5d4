"""What an environment of many robots costs beside the engine alone.

python benchmarks/gym_cost.py [--robots N] [--decisions N] [--sensing truth|onboard]

Tee turns with exact walls on one core, stretch by stretch in turn on two sides: the vector
environment, and an `ot.Simulation` of the same trials that is given the same belt speeds and rolls,
and made anew when all of its robots are through. Both are timed by processor time, and only while
all robots drive. Printed are decisions of one robot a second on both sides, and their ratio.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import gymnasium
import numpy as np
from shape import Arguments

import omnitrack_sim.gym  # noqa: F401  registers the environments
from omnitrack_sim import Scenario, Simulation
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.file import DIRECT

ID = "omnitrack_sim/TeeTurn-v0"
STRETCH = 10
"""Decisions that one side does before it is the other's turn."""
SEED = 1


def environment(robots: int, sensing: str) -> gymnasium.vector.VectorEnv:
    """The vector environment; ``sensing`` of its robots."""
    env = gymnasium.make_vec(ID, num_envs=robots, sensing=sensing)
    env.reset(seed=SEED)
    return env


def actions(robots: int) -> Iterator[np.ndarray]:
    """Uneven driving ahead (n, 4), and some rolling."""
    rng = np.random.default_rng(SEED)
    while True:
        drawn = rng.uniform(0.3, 0.6, (robots, 4))
        drawn[:, 3] -= 0.45
        yield drawn.astype(np.float32)


class Engine:
    """The engine alone, given what the environment's robots are given."""

    def __init__(self, scenarios: list[Scenario]) -> None:
        self.scenarios = scenarios
        self._begin()

    def _begin(self) -> None:
        self.simulation = Simulation(self.scenarios, recording=False)
        self.decisions = Decisions(self.simulation.setup, (), DIRECT)

    def commands(self, action: np.ndarray) -> float:
        """Carry out actions for one decision; processor time of the engine's own steps, s."""
        if not self.simulation.active.all():
            self._begin()
        self.decisions.decide(action)
        spent = 0.0
        for _ in range(self.decisions.hold):
            command = self.decisions.command(self.simulation.observation)
            begin = time.process_time()
            self.simulation.step(command)
            spent += time.process_time() - begin
        return spent


def compared(robots: int, decisions: int, sensing: str) -> tuple[float, float]:
    """Decisions of one robot a second of processor time: environment, engine."""
    env, drawn = environment(robots, sensing), actions(robots)
    engine = Engine(env.unwrapped.scenarios)
    spent = [0.0, 0.0]
    for first in range(0, decisions + STRETCH, STRETCH):
        stretch = [next(drawn) for _ in range(STRETCH)]
        begin = time.process_time()
        for action in stretch:
            env.step(action)
        times = [time.process_time() - begin, sum(engine.commands(action) for action in stretch)]
        if first:  # compiled code is in memory by now
            spent = [total + more for total, more in zip(spent, times, strict=True)]
    done = robots * (decisions // STRETCH * STRETCH + (STRETCH if decisions % STRETCH else 0))
    return done / spent[0], done / spent[1]


def main() -> None:
    """Measure and print the ratio."""
    arguments = Arguments(__doc__, trials=64, of="robots")
    arguments.add_argument("--decisions", type=int, default=200, help="of each robot")
    arguments.add_argument("--sensing", choices=("truth", "onboard"), default="onboard")
    given = arguments.read()
    ours, alone = compared(given.robots, given.decisions, given.sensing)
    print(
        f"{given.robots} robots, {given.sensing}: environment {ours:.0f} decisions a second, "
        f"engine alone {alone:.0f}, ratio {ours / alone:.3f}"
    )


if __name__ == "__main__":
    main()
