"""The search itself: candidates are asked for, evaluated by whoever can, and told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array
from omnitrack_sim.trials.optimise.search import Searches, losses_of, violations_of
from omnitrack_sim.trials.optimise.tables import Plan

START = 0
"""The search that the start belongs to."""


@dataclass(frozen=True)
class Candidate:
    """Values of all variables that are tried together.

    Attributes:
        number: from 0, the start.
        generation: in which it was tried, from 1; one more than the study has for the centres.
        search: that asked for it, from 1; ``START`` for the start.
        values: in the order of the variables.
    """

    number: int
    generation: int
    search: int
    values: tuple[float | int, ...]


@dataclass(frozen=True)
class Measured:
    """What a candidate has shown.

    Attributes:
        values: of the objectives, in their order; infinite where there is none.
        trials, passed: how many were run, and how many reached the goal.
        invalid: trials whose values did not fit.
        lost: trials that diverged, or that the program broke on.
    """

    values: tuple[float, ...]
    trials: int = 0
    passed: int = 0
    invalid: int = 0
    lost: int = 0


Evaluate = Callable[[Sequence[Candidate]], Sequence[Measured]]
"""Runs candidates of one generation and returns what they have shown, in their order."""
History = list[tuple[Candidate, Measured]]
Told = Callable[[History], None]


def explore(plan: Plan, evaluate: Evaluate, told: Told | None = None) -> History:
    """Search for the best values of all variables.

    First comes the start. The last generation holds the centre of each search: the mean that it has
    come to, which owes less to luck than the best one of many candidates.

    Args:
        plan: what is searched; every variable has a start.
        evaluate: called once for each generation. With the same answers the search is the same.
        told: called after each generation with the history so far.

    Returns:
        All candidates in the order of their numbers.
    """
    searches = Searches(plan)
    history: History = []
    starts = tuple(variable.start for variable in plan.variables if variable.start is not None)
    for generation in range(1, plan.generations + 1):
        asked = searches.ask()
        if not asked:
            break
        first = [Candidate(0, generation, START, starts)] if not history else []
        _try(plan, evaluate, history, generation, first, asked)
        values = values_of(history)
        last = slice(len(history) - len(asked), None)
        searches.tell(asked, losses_of(plan, values), violations_of(plan, values), last)
        if told is not None:
            told(history)
    _try(plan, evaluate, history, plan.generations + 1, [], searches.centres())
    if told is not None:
        told(history)
    return history


def _try(
    plan: Plan,
    evaluate: Evaluate,
    history: History,
    generation: int,
    first: Sequence[Candidate],
    asked: Sequence[tuple[int, Array]],
) -> None:
    """Evaluate the candidates at the points that are asked for, and add them to the history."""
    candidates = list(first)
    for search, point in asked:
        values = tuple(
            variable.value_at(float(place))
            for variable, place in zip(plan.variables, point, strict=True)
        )
        number = len(history) + len(candidates)
        candidates.append(Candidate(number, generation, search, values))
    history += zip(candidates, evaluate(candidates), strict=True)


def values_of(history: Sequence[tuple[Candidate, Measured]]) -> Array:
    """The objectives of the candidates (C, objectives)."""
    return np.array([measured.values for _, measured in history], float)
