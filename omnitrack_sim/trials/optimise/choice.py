"""Which candidates of a search are the best, and what they are checked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.trials.optimise.explore import Candidate, History, Measured, values_of
from omnitrack_sim.trials.optimise.search import (
    front_of,
    losses_of,
    scores_of,
    spread_weighings,
    violations_of,
    weighings_of,
)
from omnitrack_sim.trials.optimise.tables import Plan


def front(plan: Plan, history: Sequence[tuple[Candidate, Measured]]) -> list[int]:
    """Places in the history of the candidates on the front, in the order of the first weighed
    objective, the best one first."""
    values = values_of(history)
    losses = losses_of(plan, values)
    found = front_of(losses, violations_of(plan, values))
    return found[np.lexsort((found, losses[found, 0]))].tolist()


def to_be_checked(plan: Plan, history: History, most: int) -> list[Candidate]:
    """The start, and for each direction the centre of the search and its ``most`` best ones.

    They are in the order of their numbers.
    """
    order = _orders(plan, history, weighings_of(plan))
    chosen = {0, *(place for own in order for place in own[:most])}
    chosen |= {place for place, (one, _) in enumerate(history) if one.generation > plan.generations}
    return [history[place][0] for place in sorted(chosen)]


def best_of(plan: Plan, history: Sequence[tuple[Candidate, Measured]]) -> int:
    """Place of the candidate that is the best one when all directions weigh alike."""
    weights = [plan.objectives[i].weight for i in plan.weighed]
    return _orders(plan, history, spread_weighings(len(weights), 1) * weights)[0][0]


def _orders(
    plan: Plan, history: Sequence[tuple[Candidate, Measured]], weighings: Array
) -> list[list[int]]:
    """For each weighing the places of all candidates, the best one first; those that keep all
    limits before the others."""
    values = values_of(history)
    violations = violations_of(plan, values)
    scores = scores_of(losses_of(plan, values), violations, weighings)
    return [np.lexsort((own, violations)).tolist() for own in scores]
