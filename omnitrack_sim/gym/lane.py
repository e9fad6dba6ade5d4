"""Robots that share a simulation, each in an episode of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.terms import Tally
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.omnitrack.policy import Acting, Decisions, Feature
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.onboard import Onboard
from omnitrack_sim.sim.simulation import Simulation

NOTHING_BACK = 1.0
"""What stands in a picture where nothing comes back: as far as the camera sees."""


class Lane:
    """n robots on one simulation, driven by actions.

    Args:
        scenarios: of their first episodes, of one batch.
        features: what they observe. acting: how actions become commands.
        threads: native threads of the physics.

    Attributes:
        simulation: of theirs. decisions: from actions to commands.
        travel: (n, 3) m, by which each belt has run on since its episode began.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        features: Sequence[Feature],
        acting: Acting,
        threads: int = 1,
    ) -> None:
        self._features, self._acting, self._threads = features, acting, threads
        self._make(scenarios)

    def _make(self, scenarios: Sequence[Scenario]) -> None:
        self.simulation = Simulation(scenarios, threads=self._threads, recording=False)
        self.decisions = Decisions(self.simulation.setup, self._features, self._acting)
        self.travel = np.zeros((self.simulation.n, 3))

    def begin(self, robots: NDArray[np.intp], scenarios: Sequence[Scenario], alike: bool) -> None:
        """Begin new episodes of ``robots`` (k,), ascending, with ``scenarios`` (k); ``alike``:
        whether they share the batch of the others."""
        if not alike:
            self._make(scenarios)
            return
        self.simulation.reset(robots, scenarios)
        self.decisions.reset(robots, self.simulation.setup)
        self.travel[robots] = 0.0

    def advance(self, actions: Array) -> Mapping[str, Array]:
        """Carry out actions (n, 4) for one decision; the terms (n,) of the reward, before weights.
        Robots whose episode is over stay as they are."""
        simulation, decisions = self.simulation, self.decisions
        running, tally = simulation.active, Tally(simulation)
        decisions.decide(np.where(running[:, None], actions, 0.0))
        for _ in range(decisions.hold):
            simulation.step(decisions.command(simulation.observation))
            tally.add(simulation)
            self.travel += simulation.readings["belt_speed"] * simulation.period
        ended = running & ~simulation.active
        arrived = ended & self._ended_as(Outcome.REACHED_GOAL)
        failed = ended & ~arrived & ~self._ended_as(Outcome.TIMED_OUT)
        return tally.over(arrived, failed, ended & self._ended_as(Outcome.DIVERGED))

    def _ended_as(self, outcome: Outcome) -> NDArray[np.bool_]:
        """Robots (n,) whose run has ended so."""
        endings = self.simulation.endings
        return np.array([ending is not None and ending.outcome is outcome for ending in endings])

    def outcomes(self) -> list[Outcome | None]:
        """How each robot's episode ended; None while it runs."""
        endings = self.simulation.endings
        return [None if ending is None else ending.outcome for ending in endings]

    def entries(self) -> NDArray[np.float32]:
        """What the robots observe (n, k)."""
        return self.decisions.observe(self.simulation.observation)

    def pictures(self) -> NDArray[np.float32]:
        """The last depth picture of each (n, rows, columns), over how far the camera sees."""
        senses = self.simulation.senses
        assert isinstance(senses, Onboard)
        far = senses.camera.optics.far
        near = np.nan_to_num(senses.picture / far, nan=NOTHING_BACK)
        side = round(np.sqrt(near.shape[1]))
        return np.clip(near, 0.0, 1.0).reshape(-1, side, side).astype(np.float32)
