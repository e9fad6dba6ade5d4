"""Robots in episodes, in as few simulations as their pipes allow: what single and vector
environments have in common."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.lane import Lane
from omnitrack_sim.gym.options import Options
from omnitrack_sim.gym.terms import TERMS
from omnitrack_sim.gym.trials import Trials
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.omnitrack.policy import ACTIONS, bounds, entry_slices
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.senses.cameras import camera_of

Seen = Any
"""Of one robot or of n: entries (k,) or (n, k), or a table of entries and picture."""


class Done(NamedTuple):
    """What one decision of n robots brought.

    Attributes:
        reward: (n,). terms: (n,) each by name, with their weights.
        terminated, truncated: (n,) bool.
    """

    reward: Array
    terms: Mapping[str, Array]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class Fleet:
    """n robots, each in episodes of its own.

    Args:
        options: of the environment. n: number of robots.

    Attributes:
        trials: draws what an episode begins with.
        action_space, observation_space: of one robot.
        entries: where each feature stands in the vector of entries, by name.
        lanes: simulations of theirs; empty before the first episode.
        seeds: (n) of the robots' random numbers.
    """

    def __init__(self, options: Options, n: int) -> None:
        self._options, self.n = options, n
        self.trials = Trials(options)
        ones = np.ones(len(ACTIONS), np.float32)
        self.action_space = gymnasium.spaces.Box(-ones, ones)
        self.observation_space = self._space()
        self.entries = entry_slices(options.features)
        self.lanes: list[Lane] = []
        self._weights = options.weights

    def _space(self) -> gymnasium.Space:
        low, high = bounds(self._options.features)
        entries = gymnasium.spaces.Box(low, high)
        if not self._options.picture:
            return entries
        table = self.trials.example.sensing
        side = len(range(*self._rows(camera_of(table).optics.pixels, table.filter.stride)))
        picture = gymnasium.spaces.Box(0.0, 1.0, (side, side), np.float32)
        return gymnasium.spaces.Dict({"entries": entries, "picture": picture})

    @staticmethod
    def _rows(pixels: int, stride: int) -> tuple[int, int, int]:
        """First, end and step of the rows of a picture that robots look at."""
        return stride // 2, pixels, stride

    def begin(self, robots: NDArray[np.intp], rngs: list[np.random.Generator]) -> None:
        """Begin new episodes of ``robots`` (k,), ascending; ``rngs``: n, from which each draws."""
        drawn = [self.trials.draw(rngs[robot]) for robot in robots.tolist()]
        options, alike = self._options, self.trials.alike
        if not self.lanes:
            if len(robots) < self.n:
                raise gymnasium.error.ResetNeeded("the first reset has to be of all robots")
            groups = [drawn] if alike else [[scenario] for scenario in drawn]
            rest = (options.features, options.acting_as, options.threads)
            self.lanes = [Lane(group, *rest) for group in groups]
        elif alike:
            self.lanes[0].begin(robots, drawn, alike)
        else:
            for robot, scenario in zip(robots.tolist(), drawn, strict=True):
                self.lanes[robot].begin(np.zeros(1, np.intp), [scenario], alike)

    def advance(self, actions: Array) -> Done:
        """Carry out actions (n, 4); robots whose episode is over stay as they are."""
        before = self._each(lambda lane: lane.simulation.active)
        size = self.n // len(self.lanes)
        found = [
            lane.advance(actions[i * size : (i + 1) * size]) for i, lane in enumerate(self.lanes)
        ]
        terms = {
            name: self._weights[name] * np.nan_to_num(np.concatenate([f[name] for f in found]))
            for name in TERMS
        }
        ended = before & ~self._each(lambda lane: lane.simulation.active)
        late = np.array([outcome is Outcome.TIMED_OUT for outcome in self.outcomes()])
        return Done(sum(terms.values(), np.zeros(self.n)), terms, ended & ~late, ended & late)

    def outcomes(self) -> list[Outcome | None]:
        """How each robot's episode ended; None while it runs."""
        return [outcome for lane in self.lanes for outcome in lane.outcomes()]

    def observe(self) -> Seen:
        """What all robots observe, fresh arrays."""
        entries = self._each(Lane.entries)
        if not self._options.picture:
            return entries
        return {"entries": entries, "picture": self._each(Lane.pictures)}

    def _each(self, read: Any) -> NDArray:
        """What ``read`` gives of every lane, one after the other."""
        return np.concatenate([read(lane) for lane in self.lanes])

    def told(self) -> dict[str, Array]:
        """What ``info`` tells of each robot (n,): its true place and time."""
        found = {
            "distance": self._each(lambda lane: lane.simulation.location.distance),
            "time": self._each(lambda lane: lane.simulation.time),
        }
        return {name: np.nan_to_num(values) for name, values in found.items()}

    def scenario(self, robot: int) -> Scenario:
        """What a robot's episode runs."""
        lane, row = self.place_of(robot)
        return lane.simulation.scenarios[row]

    def place_of(self, robot: int) -> tuple[Lane, int]:
        """The lane of a robot, and its number there."""
        if not self.lanes:
            raise gymnasium.error.ResetNeeded("call reset first")
        size = self.n // len(self.lanes)
        return self.lanes[robot // size], robot % size


def actions_of(given: Any, shape: tuple[int, ...]) -> NDArray:
    """Actions as an array.

    Raises:
        ValueError: it has not this ``shape``.
    """
    actions = np.asarray(given)
    if actions.shape != shape:
        raise ValueError(f"action has shape {actions.shape}, expected {shape}")
    return actions


def reset_options_of(given: Mapping[str, Any] | None, known: tuple[str, ...]) -> Mapping[str, Any]:
    """The options of a reset.

    Raises:
        InputError: one is not among the ``known``.
    """
    problem = "unknown key" if known else "unknown key; a reset of one robot has no options"
    odd = [
        Fault(f"options.{key}", problem, known, str(key)) for key in given or {} if key not in known
    ]
    if odd:
        raise InputError(odd)
    return given or {}


def one_of(seen: Seen, robot: int) -> Seen:
    """What one robot observes, of what all do."""
    if isinstance(seen, dict):
        return {name: values[robot].copy() for name, values in seen.items()}
    return seen[robot].copy()
