"""The trials of an environment: one scenario an episode, drawn from its random numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.gym.options import Options
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.robots.omnitrack import GRAVITY
from omnitrack_sim.robots.omnitrack.policy import DECISION_PERIOD
from omnitrack_sim.robots.omnitrack.policy.controller import steps_of
from omnitrack_sim.scenario import Scenario, load_scenario, override, validate

RANDOM = "random_network"
"""In the place of a scenario: a random network in each episode."""
NETWORKS = 2**31
"""How many random networks there are."""


class Trials:
    """Draws the scenario of each episode.

    Args:
        options: of the environment.

    Raises:
        InputError: the scenario, or one of the values that may be drawn, cannot be used; the faults
            name their places.

    Attributes:
        alike: whether all trials share a batch; otherwise each has pipes of its own.
        example: one of them.
    """

    def __init__(self, options: Options) -> None:
        self._options, self.alike = options, options.scenario != RANDOM
        changes: dict[str, Any] = {"sensing.kind": options.senses}
        if options.picture:
            changes["sensing.both_ends"] = False
        self._changes = changes | options.changes
        if self.alike:
            self._base = load_scenario(options.scenario, self._changes)
            if self._base.exploration is not None:
                problem = "explores: its pipes are to be known"
                raise InputError(Fault("scenario", problem))
            _ = self._base.route  # all trials share it
        drawn = options.drawn
        # What both ends of the ranges are valid with, values between them are, too.
        self._with(0, {path: low for path, (low, _) in drawn.items()}, override)
        self.example = self._with(0, {path: high for path, (_, high) in drawn.items()}, override)
        kind = self.example.sensing.kind
        if kind != options.senses:
            problem = (
                f"is {options.senses!r} (left out, it follows from the observation), and the "
                f"changes make sensing.kind {kind!r}; use the option, and leave out the change"
            )
            raise InputError(Fault("sensing", problem))
        steps_of(DECISION_PERIOD, self.example.physics.control_period)
        if options.picture and self.example.sensing.camera != "depth":
            raise InputError(Fault("picture", "is that of the camera 'depth'", ("depth",)))

    def draw(self, rng: np.random.Generator) -> Scenario:
        """The scenario of the next episode; the same from the same numbers."""
        options = self._options
        values: dict[str, Any] = {
            path: float(rng.uniform(low, high)) for path, (low, high) in options.drawn.items()
        }
        if options.gravity == "any":
            direction = rng.normal(size=3)
            direction *= GRAVITY / np.linalg.norm(direction)
            values["world.gravity"] = tuple(direction.tolist())
        values["seed"] = int(rng.integers(2**63))
        network = 0 if self.alike else int(rng.integers(NETWORKS))
        return self._with(network, values, with_values if self.alike else override)

    def _with(
        self,
        network: int,
        values: Mapping[str, Any],
        change: Callable[[Scenario, Mapping[str, Any]], Scenario],
    ) -> Scenario:
        """A trial with these values."""
        base = self._base if self.alike else self._mission(network)
        return change(base, values)

    def _mission(self, seed: int) -> Scenario:
        """A random mission through the random network of a seed, and what the options change."""
        network = random_network(seed, self._options.fittings)
        start, goal = np.random.default_rng([seed, 1]).choice(network.open_ends, 2, replace=False)
        data = {
            "name": f"random_{seed}",
            "network": network.model_dump(mode="json"),
            "mission": {"start": str(start), "goals": [str(goal)]},
        }
        return validate(data, changes=self._changes)


def with_values(scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """A copy of a scenario in plain pipes with values by dotted path, as of ``override``, that are
    within limits that were checked.

    The route stays: nothing of what a batch's robots need not share changes it.
    """
    return _changed(scenario, {tuple(path.split(".")): v for path, v in values.items()}, ("route",))


def _changed(
    table: BaseModel, values: Mapping[tuple[str, ...], Any], kept: tuple[str, ...] = ()
) -> Any:
    """A copy of a table with values by path, without what has been derived from it but ``kept``."""
    inner: dict[str, dict[tuple[str, ...], Any]] = {}
    own = {}
    for (key, *rest), value in values.items():
        if rest:
            inner.setdefault(key, {})[tuple(rest)] = value
        else:
            own[key] = value
    own |= {key: _changed(getattr(table, key), below) for key, below in inner.items()}
    fields = {key: own.get(key, getattr(table, key)) for key in type(table).model_fields}
    copy = table.model_construct(_fields_set=set(table.model_fields_set) | set(own), **fields)
    copy.__dict__.update({key: table.__dict__[key] for key in kept if key in table.__dict__})
    return copy
