"""Multi-objective search by ask and tell: CMA-ES in several directions at once.

Nothing here knows what a candidate is, or runs one. With several objectives there is no best value
but a front, and CMA-ES minimises one number. So the front is searched in directions: each is a
weighing of the objectives and has a CMA-ES of its own, which minimises the largest of the weighed
distances to the best values found so far (the augmented Chebyshev scalarisation, which reaches
every point of a front, also where it is hollow). All searches ask at once, which fills many
workers, and every candidate counts for the front.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import installing
from omnitrack_sim.trials.search_plan import SearchPlan

if TYPE_CHECKING:
    from cmaes import CMA


SLOPE = 0.05
"""Part of the sum of the distances that is added to the largest one, so that of two candidates that
are as far the one that is nearer by the other objectives is the better one."""
_LATTICE = 12
"""Steps along an edge of the lattice of weighings that directions are picked from: the middles of
two, three and four objectives are on it."""


class Searches:
    """One CMA-ES for each direction, in the unit cube of the variables.

    The same plan and the same values give the same candidates.
    """

    def __init__(self, plan: SearchPlan):
        self.weighings = weighings_of(plan)  # (K, m)
        start = np.array([v.place_of(v.start) for v in plan.variables if v.start is not None])
        self._searches = [
            _search(start, plan, number) for number in range(1, len(self.weighings) + 1)
        ]

    def ask(self) -> list[tuple[int, Array]]:
        """Return pairs of a search, from 1, and a point (n,) that it asks for.

        There are none of a search that has converged.
        """
        return [
            (number, search.ask())
            for number, search in enumerate(self._searches, start=1)
            if not search.should_stop()
            for _ in range(search.population_size)
        ]

    def tell(
        self, points: Sequence[tuple[int, Array]], losses: Array, violations: Array, last: slice
    ) -> None:
        """Update the searches with the losses of the candidates that ``ask`` returned.

        Args:
            points: as ``ask`` returned them.
            losses: (C, m) of all candidates so far, see ``losses_of``; infinite where there is no
                value.
            violations: (C,) of the limits, 0 where all are kept.
            last: places of ``points`` among them.
        """
        scores = scores_of(losses, violations, self.weighings)[:, last]
        kept = violations[last]
        numbers = np.array([number for number, _ in points])
        for number in np.unique(numbers):
            (own,) = np.nonzero(numbers == number)
            ranked = own[np.lexsort((scores[number - 1, own], kept[own]))]
            # CMA-ES goes by order alone. Ranks are numbers even where a value is infinite.
            pairs = [(points[i][1], float(rank)) for rank, i in enumerate(ranked)]
            self._searches[number - 1].tell(pairs)

    def centres(self) -> list[tuple[int, Array]]:
        """Return pairs of a search, from 1, and its mean (n,)."""
        return [
            (number, np.clip(search.mean, 0.0, 1.0))
            for number, search in enumerate(self._searches, start=1)
        ]


def _search(start: Array, plan: SearchPlan, number: int) -> CMA:
    try:
        from cmaes import CMA
    except ImportError:
        problem = f"needs the package cmaes: {installing('optimise')}"
        raise InputError(Fault("a study", problem)) from None
    # Seeds that differ by one may give correlated streams; a seed sequence mixes them.
    seed = np.random.SeedSequence([plan.seed, number]).generate_state(1)[0]
    bounds = np.tile([0.0, 1.0], (len(start), 1))
    return CMA(start, plan.step, bounds, seed=int(seed), population_size=plan.asked_each)


def weighings_of(plan: SearchPlan) -> Array:
    """Return the weighings of the searches (K, m): spread evenly, times the weights."""
    weights = [plan.objectives[i].weight for i in plan.weighed]
    return spread_weighings(len(weights), plan.search_count) * weights


def spread_weighings(objectives: int, count: int) -> Array:
    """Return ``count`` weighings (count, objectives) that add up to 1, far from each other.

    A single one weighs all objectives alike. Several begin with those of one objective alone; each
    further one is the point of a lattice that is farthest from all before it. Between two
    objectives they are evenly spaced.
    """
    if count == 1:
        return np.full((1, objectives), 1 / objectives)
    if objectives == 2:
        part = np.linspace(1.0, 0.0, count)
        return np.stack([part, 1 - part], axis=1)
    bars = itertools.combinations(range(_LATTICE + objectives - 1), objectives - 1)
    ends = np.array([[-1, *bar, _LATTICE + objectives - 1] for bar in bars])
    lattice = (np.diff(ends, axis=1) - 1) / _LATTICE
    # The corners come first: each is the search for the best value of one objective alone.
    chosen = [*np.eye(objectives)][:count]
    while len(chosen) < count:
        # Rounded below, so that of points that are equally far the first one wins on every machine.
        away = np.linalg.norm(lattice[:, None] - np.array(chosen), axis=2).min(axis=1)
        chosen.append(lattice[np.round(away, 9).argmax()])
    return np.array(chosen)


def scores_of(losses: Array, violations: Array, weighings: Array) -> Array:
    """Return the distance of each candidate from the best values of all, by weighing (K, C).

    Distances are counted in the width of the front. Infinite where a candidate lacks a value.

    Args:
        losses: see ``Searches.tell``.
        violations: see ``Searches.tell``.
        weighings: (K, m).
    """
    best, width = _frame(losses, violations)
    known = np.isfinite(losses).all(axis=1)
    weighed = weighings[:, None] * ((losses[known] - best) / width)  # (K, known, m)
    scores = np.full((len(weighings), len(losses)), np.inf)
    slope = SLOPE * weighings.mean(axis=0)
    scores[:, known] = weighed.max(axis=2) + (losses[known] - best) / width @ slope
    return scores


def _frame(losses: Array, violations: Array) -> tuple[Array, Array]:
    """Best value of each objective (m,), and the width of the front in it (m,)."""
    front = losses[front_of(losses, violations)]
    # Without any candidate that has all values there is no front to measure distances in.
    known = losses[np.isfinite(losses).all(axis=1)]
    if not len(known):
        return np.zeros(losses.shape[1]), np.ones(losses.shape[1])
    of_front, of_all = np.ptp(front, axis=0), np.ptp(known, axis=0)
    # A front of one point has no width; then the spread of all candidates sets the scale.
    width = np.where(of_front > 0, of_front, of_all)
    return front.min(axis=0), np.where(width > 0, width, 1.0)


def front_of(losses: Array, violations: Array) -> NDArray[np.intp]:
    """Return the indices of the candidates on the front, which no other one dominates.

    One dominates another if it is better in one objective and no worse in any. Candidates count
    that have all values and keep all limits; if there is none, those that break the limits least.
    """
    known = np.isfinite(losses).all(axis=1)
    smallest = violations[known].min(initial=np.inf)
    (counted,) = np.nonzero(known & (violations <= smallest))
    own = losses[counted]
    best = [not ((own <= one).all(axis=1) & (own < one).any(axis=1)).any() for one in own]
    return counted[np.array(best, bool)]


def violations_of(plan: SearchPlan, values: Array) -> Array:
    """Return the excess of each candidate (C,) over the limits: parts of the limits, added up.

    Args:
        plan: with the limits.
        values: (C, objectives).
    """
    total = np.zeros(len(values))
    for i, objective in enumerate(plan.objectives):
        if objective.limit is not None:
            excess = objective.sign * (values[:, i] - objective.limit)
            # Relative to the limit, so that excesses of different units can be added.
            total += np.maximum(excess, 0.0) / (abs(objective.limit) or 1.0)
    return total


def losses_of(plan: SearchPlan, values: Array) -> Array:
    """Return the weighed ones of the values (C, objectives), smaller ones better (C, m)."""
    weighed = list(plan.weighed)
    # An objective without a weight counts by its limit alone.
    return values[:, weighed] * [plan.objectives[i].sign for i in weighed]


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
    """Evaluation of a candidate.

    Attributes:
        values: of the objectives, in their order; infinite where there is none.
        trials: how many were run.
        passed: how many of them reached the goal.
        invalid: trials whose values did not fit.
        lost: trials that diverged, or that the program broke on.
    """

    values: tuple[float, ...]
    trials: int = 0
    passed: int = 0
    invalid: int = 0
    lost: int = 0


History = list[tuple[Candidate, Measured]]
"""Candidates with their evaluations, in the order of their numbers."""


class Search:
    """Search for the best values of all variables, by ask and tell.

    First comes the start. The last generation holds the centre of each search: the mean that it has
    come to, which owes less to luck than the best one of many candidates. With the same answers the
    search is the same.

    Attributes:
        history: candidates so far, with their evaluations.
        generation: that ``ask`` has asked for, from 1.

    Args:
        plan: what is searched; every variable has a start.
    """

    def __init__(self, plan: SearchPlan):
        self.plan = plan
        self.history: History = []
        self.generation = 0
        self._searches = Searches(plan)
        self._points: list[tuple[int, Array]] = []
        self._asked: list[Candidate] = []

    @property
    def is_at_centres(self) -> bool:
        """The last generation, of the centres, has been asked for."""
        return self.generation > self.plan.generations

    def ask(self) -> list[Candidate]:
        """Return the candidates of the next generation; none when the search is over."""
        if self.is_at_centres:
            return []
        self.generation += 1
        self._points = [] if self.is_at_centres else self._searches.ask()
        points = self._points
        if not points:  # the generations are over, or every search has converged
            self.generation = self.plan.generations + 1
            points = self._searches.centres()
        self._asked = [] if self.history else [self._start()]
        for search, point in points:
            values = tuple(
                variable.value_at(float(place))
                for variable, place in zip(self.plan.variables, point, strict=True)
            )
            number = len(self.history) + len(self._asked)
            self._asked.append(Candidate(number, self.generation, search, values))
        return self._asked

    def _start(self) -> Candidate:
        starts = (variable.start for variable in self.plan.variables)
        values = tuple(start for start in starts if start is not None)
        return Candidate(0, self.generation, START, values)

    def tell(self, measured: Sequence[Measured]) -> None:
        """Take the evaluations of the candidates that ``ask`` has returned, in order."""
        self.history += zip(self._asked, measured, strict=True)
        if not self._points:
            return
        plan, values = self.plan, values_of(self.history)
        last = slice(len(self.history) - len(self._points), None)
        losses, violations = losses_of(plan, values), violations_of(plan, values)
        self._searches.tell(self._points, losses, violations, last)


def values_of(history: Sequence[tuple[Candidate, Measured]]) -> Array:
    """Return the objectives of the candidates (C, objectives)."""
    return np.array([measured.values for _, measured in history], float)


def front(plan: SearchPlan, history: Sequence[tuple[Candidate, Measured]]) -> list[int]:
    """Return the places in the history of the candidates on the front.

    The best one of the first weighed objective comes first.
    """
    values = values_of(history)
    losses = losses_of(plan, values)
    places = front_of(losses, violations_of(plan, values))
    # Of equal losses the earlier candidate comes first, so that the order is always the same.
    return places[np.lexsort((places, losses[places, 0]))].tolist()


def to_be_checked(plan: SearchPlan, history: History, most: int) -> list[Candidate]:
    """Return the start, and of each direction the centre and the ``most`` best, by number."""
    order = _orders(plan, history, weighings_of(plan))
    chosen = {0, *(place for own in order for place in own[:most])}
    chosen |= {place for place, (one, _) in enumerate(history) if one.generation > plan.generations}
    return [history[place][0] for place in sorted(chosen)]


def best_of(plan: SearchPlan, history: Sequence[tuple[Candidate, Measured]]) -> int:
    """Return the place of the candidate that is the best one when all objectives weigh alike."""
    weights = [plan.objectives[i].weight for i in plan.weighed]
    return _orders(plan, history, spread_weighings(len(weights), 1) * weights)[0][0]


def _orders(
    plan: SearchPlan, history: Sequence[tuple[Candidate, Measured]], weighings: Array
) -> list[list[int]]:
    """Places of all candidates by weighing, best first; those within all limits come first."""
    values = values_of(history)
    violations = violations_of(plan, values)
    scores = scores_of(losses_of(plan, values), violations, weighings)
    return [np.lexsort((own, violations)).tolist() for own in scores]
