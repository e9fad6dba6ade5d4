"""The environment of one robot."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from omnitrack_sim.gym.fleet import Fleet, Seen, actions_of, one_of, reset_options_of
from omnitrack_sim.gym.options import options_of
from omnitrack_sim.gym.screen import Screen
from omnitrack_sim.record.events import Outcome
from omnitrack_sim.robots.omnitrack.policy import ACTIONS
from omnitrack_sim.scenario import Scenario

FPS = 20
"""Decisions a second."""


class RobotEnv(gymnasium.Env):
    """One robot in pipes: see docs/how-to/gym.md.

    Args:
        given: the options, see ``options.Options``.

    Attributes:
        entries: where each feature stands in the vector of entries: slices by name.

    Raises:
        InputError: an option cannot be used; the fault names it and the choices.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as of Env
        "render_modes": ["rgb_array", "human"],
        "render_fps": FPS,
    }

    def __init__(self, **given: Any) -> None:
        options = options_of(given)
        self._fleet = Fleet(options, 1)
        self.action_space = self._fleet.action_space
        self.observation_space = self._fleet.observation_space
        self.entries = self._fleet.entries
        self.render_mode = options.render_mode
        self._screen = None if options.render_mode is None else Screen(options)
        self._over = True

    @property
    def scenario(self) -> Scenario:
        """What the episode at hand runs: ``ot.run`` of it, under a controller that decides the
        same, gives the same bytes."""
        return self._fleet.scenario(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode. ``options`` is of Gymnasium's signature; there are none.

        Raises:
            InputError: ``options`` holds something.
        """
        reset_options_of(options, ())
        super().reset(seed=seed)
        self._fleet.begin(np.zeros(1, np.intp), [self.np_random])
        self._over = False
        self._show()
        told = {name: float(values[0]) for name, values in self._fleet.told().items()}
        return one_of(self._fleet.observe(), 0), told

    def step(self, action: Any) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Carry out an action (4,) for one decision, 0.05 s.

        Raises:
            ValueError: it has another shape, or holds what is not a number.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("the episode is over; call reset")
        done = self._fleet.advance(actions_of(action, (len(ACTIONS),))[None])
        terminated, truncated = bool(done.terminated[0]), bool(done.truncated[0])
        self._over = terminated or truncated
        info: dict[str, Any] = {
            name: float(values[0]) for name, values in self._fleet.told().items()
        }
        info["terms"] = {name: float(values[0]) for name, values in done.terms.items()}
        (outcome,) = self._fleet.outcomes()
        if outcome is not None:
            info["outcome"] = outcome.value
            info["is_success"] = outcome is Outcome.REACHED_GOAL
        self._show()
        seen = one_of(self._fleet.observe(), 0)
        return seen, float(done.reward[0]), terminated, truncated, info

    def _show(self) -> None:
        if self.render_mode == "human" and self._screen is not None:
            self._screen.show(*self._fleet.place_of(0))

    def render(self) -> Any:
        """A picture (height, width, 3) in the mode ``rgb_array``."""
        if self._screen is None:
            gymnasium.logger.warn("nothing is rendered: make the environment with a render_mode")
            return None
        if self.render_mode == "human":
            return self._show()
        return self._screen.picture(*self._fleet.place_of(0))

    def close(self) -> None:
        """Close window and pictures."""
        if self._screen is not None:
            self._screen.close()
