"""The environment of many robots: one batch of the engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.gym.env import FPS
from omnitrack_sim.gym.fleet import Done, Fleet, Seen, actions_of, one_of, reset_options_of
from omnitrack_sim.gym.options import options_of
from omnitrack_sim.gym.screen import Screen
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.omnitrack.policy import ACTIONS
from omnitrack_sim.scenario import Scenario

MOST = 65536
"""Most robots of one environment."""


class RobotVectorEnv(VectorEnv):
    """Many robots in pipes, each in an episode of its own: see docs/how-to/gym.md.

    Robot i with the seed s + i sees, bit for bit, what the single environment with that seed sees.

    Args:
        num_envs: number of robots.
        autoreset_mode: when an episode that is over is followed by the next, see Gymnasium.
        given: the options, see ``options.Options``.

    Attributes:
        entries: where each feature stands in a robot's vector of entries: slices by name.

    Raises:
        InputError: an option cannot be used; the fault names it and the choices.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as of VectorEnv
        "render_modes": ["rgb_array"],
        "render_fps": FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **given: Any,
    ) -> None:
        self._mode = _mode_of(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": self._mode}
        if not isinstance(num_envs, int) or not 1 <= num_envs <= MOST:
            raise InputError(Fault("num_envs", f"is {num_envs!r}; a number from 1 to {MOST}"))
        options = options_of(given)
        if options.render_mode == "human":
            problem = "is 'human', which is for one robot alone"
            raise InputError(Fault("render_mode", problem, ("rgb_array",)))
        self.num_envs, self._fleet = num_envs, Fleet(options, num_envs)
        self.single_action_space = self._fleet.action_space
        self.single_observation_space = self._fleet.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.entries = self._fleet.entries
        self.render_mode = options.render_mode
        self._screen = None if options.render_mode is None else Screen(options)
        self._rngs: list[np.random.Generator] = []
        self._over = np.ones(num_envs, bool)

    @property
    def scenarios(self) -> list[Scenario]:
        """What the episodes at hand run."""
        return [self._fleet.scenario(robot) for robot in range(self.num_envs)]

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode of every robot, or of those of ``options["reset_mask"]`` (n,) bool.

        ``seed``: robot i gets ``seed + i``; a list has one each.
        """
        mask = self._mask(options)
        self._seed(seed, mask)
        self._fleet.begin(np.flatnonzero(mask), self._rngs)
        self._over = self._over & ~mask
        return self._fleet.observe(), _told(self._fleet.told(), mask)

    def _mask(self, options: Mapping[str, Any] | None) -> NDArray[np.bool_]:
        """The robots (n,) that a reset is of."""
        mask = reset_options_of(options, ("reset_mask",)).get("reset_mask")
        if mask is None:
            return np.ones(self.num_envs, bool)
        whole = isinstance(mask, np.ndarray) and mask.dtype == bool
        if not whole or mask.shape != (self.num_envs,) or not mask.any():
            problem = f"must be an array ({self.num_envs},) of bool, with one True at least"
            raise InputError(Fault("options.reset_mask", problem))
        return mask.copy()

    def _seed(self, seed: int | Sequence[int | None] | None, mask: NDArray[np.bool_]) -> None:
        """Seed the robots' random numbers; those without a seed go on with theirs."""
        n = self.num_envs
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seeds: Sequence[int | None] = [int(seed) + robot for robot in range(n)]
        else:
            seeds = [None] * n if seed is None else list(seed)
        if len(seeds) != n:
            raise InputError(Fault("seed", f"is a list of {len(seeds)}; {n} robots need as many"))
        if not self._rngs:
            self._rngs = [seeding.np_random(given)[0] for given in seeds]
            return
        for robot in np.flatnonzero(mask).tolist():
            if seeds[robot] is not None:
                self._rngs[robot] = seeding.np_random(seeds[robot])[0]

    def step(self, actions: Any) -> tuple[Seen, Array, NDArray, NDArray, dict[str, Any]]:
        """Carry out actions (n, 4) for one decision, 0.05 s.

        Raises:
            ValueError: they have another shape, or hold what is not a number.
        """
        fleet, over = self._fleet, self._over
        if not fleet.lanes or (self._mode is AutoresetMode.DISABLED and over.any()):
            raise gymnasium.error.ResetNeeded("an episode is over; call reset")
        given = actions_of(actions, (self.num_envs, len(ACTIONS)))
        actions = np.where(over[:, None], 0.0, given)
        done = fleet.advance(actions)
        ended = done.terminated | done.truncated
        if self._mode is AutoresetMode.SAME_STEP and ended.any():
            info = self._follow(done, ended)
        else:
            info = _ended(fleet.outcomes(), ended) | _terms(done, ~over)
            if self._mode is AutoresetMode.NEXT_STEP and over.any():
                fleet.begin(np.flatnonzero(over), self._rngs)
        info |= _told(fleet.told(), np.ones(self.num_envs, bool))
        self._over = ended & (self._mode is not AutoresetMode.SAME_STEP)
        return fleet.observe(), done.reward, done.terminated, done.truncated, info

    def _follow(self, done: Done, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Begin the episodes that follow those that have ended in this very step; what is told of
        the former."""
        fleet, robots, last = self._fleet, np.flatnonzero(ended), self._fleet.observe()
        seen = np.full(self.num_envs, None, object)
        for robot in robots.tolist():
            seen[robot] = one_of(last, robot)
        told = _told(fleet.told(), ended)
        final = _ended(fleet.outcomes(), ended) | _terms(done, ended) | told
        fleet.begin(robots, self._rngs)
        return _told({"final_obs": seen, "final_info": final}, ended) | _terms(done, ~ended)

    def render(self) -> tuple[NDArray, ...] | None:
        """A picture (height, width, 3) of each robot in the mode ``rgb_array``."""
        if self._screen is None:
            return None
        places = [self._fleet.place_of(robot) for robot in range(self.num_envs)]
        return tuple(self._screen.picture(*place) for place in places)

    def close_extras(self, **_: Any) -> None:
        """Free what pictures are painted with."""
        if self._screen is not None:
            self._screen.close()


def _mode_of(given: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(given)
    except ValueError:
        choices = tuple(mode.value for mode in AutoresetMode)
        raise InputError(
            Fault("autoreset_mode", f"is {given!r}", choices, given=str(given))
        ) from None


def _terms(done: Done, which: NDArray[np.bool_]) -> dict[str, Any]:
    """The reward's terms of some robots (n,), as ``info`` has them."""
    return _told({"terms": _told(done.terms, which)}, which) if which.any() else {}


def _ended(outcomes: Sequence[Outcome | None], ended: NDArray[np.bool_]) -> dict[str, Any]:
    """How the episodes of some robots (n,) ended, as ``info`` has it."""
    if not ended.any():
        return {}
    words = np.full(len(ended), None, object)
    for robot in np.flatnonzero(ended).tolist():
        outcome = outcomes[robot]
        words[robot] = None if outcome is None else outcome.value
    reached = np.array([outcome is Outcome.REACHED_GOAL for outcome in outcomes])
    return _told({"outcome": words, "is_success": reached & ended}, ended)


def _told(values: Mapping[str, Any], which: NDArray[np.bool_]) -> dict[str, Any]:
    """Values (n,) as ``info`` has them: beside each, of which robots it is."""
    told: dict[str, Any] = {}
    for name, value in values.items():
        told |= {name: value, f"_{name}": which.copy()}
    return told
