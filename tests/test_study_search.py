"""The search of a study, without a simulator: what it finds, how several objectives are spread."""

import numpy as np
import pytest
from study_samples import OPTIMUM, explore, noisy_quadratic, places, quadratic_plan

from omnitrack_sim.trials.search import (
    Measured,
    best_of,
    front,
    front_of,
    scores_of,
    spread_weighings,
    to_be_checked,
    values_of,
    violations_of,
)
from omnitrack_sim.trials.search_plan import Objective, Variable


@pytest.mark.parametrize("seed", range(4))
def test_a_noisy_quadratic_has_its_optimum_within_a_percent(seed):
    """The centre of the search is within 1 % of the range of each variable, linear and logarithmic.

    The noise of a value is what 2 % of the range make in it; the start is 25 % away.
    """
    plan = quadratic_plan(generations=30, population=20, seed=seed)
    history = explore(plan, noisy_quadratic(plan, 0.004, seed))
    assert len(history) == plan.candidate_count == 1 + 30 * 20 + 1
    found = places(plan, history[-1][0])
    assert np.abs(found - OPTIMUM).max() < 0.01
    assert np.abs(places(plan, history[0][0]) - OPTIMUM).max() > 0.2


def test_the_goal_decides_the_way():
    """Maximising minus a value takes the very same way as minimising it."""
    plan = quadratic_plan(generations=5)
    turned = quadratic_plan(generations=5, objectives=(Objective(metric="f", goal="maximise"),))
    quadratic = noisy_quadratic(plan, 0.0, 0)

    def minus(candidates):
        return [Measured((-own.values[0],)) for own in quadratic(candidates)]

    down, up = explore(plan, quadratic), explore(turned, minus)
    assert [one for one, _ in down] == [one for one, _ in up]


def test_the_same_answers_give_the_same_search_and_another_seed_another_one():
    """Candidates follow from plan and values alone."""
    plan = quadratic_plan(generations=3)
    first, again = (explore(plan, noisy_quadratic(plan, 0.1, 0)) for _ in range(2))
    assert first == again
    other = explore(quadratic_plan(generations=3, seed=1), noisy_quadratic(plan, 0.1, 0))
    assert other[0][0] == first[0][0]
    assert other[1][0] != first[1][0]


def test_more_generations_begin_alike():
    """A longer search has the shorter one as its beginning, but for the centres in its end."""
    short, long = (
        explore(plan := quadratic_plan(generations=count), noisy_quadratic(plan, 0.1, 0))
        for count in (2, 4)
    )
    assert long[: len(short) - 1] == short[:-1]


def test_all_candidates_are_within_their_bounds():
    """Where the best value lies on a bound, candidates come to it and not beyond; whole numbers are
    whole, at the bounds too."""
    variables = (
        Variable(path="a", low=0.1, high=0.3, start=0.1),
        Variable(path="n", low=2, high=7, start=4, whole=True),
    )
    plan = quadratic_plan(variables=variables, generations=15, population=8)

    def evaluate(candidates):
        return [Measured((-10 * one.values[0] - one.values[1],)) for one in candidates]

    values = np.array([one.values for one, _ in explore(plan, evaluate)], float)
    assert values.min(axis=0) == pytest.approx([0.1, 2])
    assert (values.max(axis=0) <= [0.3, 7]).all()
    assert values[-1] == pytest.approx([0.3, 7], rel=0.05)
    assert (values[:, 1] == values[:, 1].round()).all()


def test_the_front_of_two_quadratics_is_the_line_between_their_optima():
    """Searches in five directions cover the known front: candidates lie near it from end to end,
    and no gap in it is wider than a fifth."""
    variables = tuple(Variable(path=name, low=0, high=1, start=0.9) for name in "ab")
    objectives = tuple(Objective(metric=name, goal="minimise") for name in "fg")
    plan = quadratic_plan(variables=variables, objectives=objectives, generations=20, population=8)
    one, other = np.array([0.2, 0.3]), np.array([0.7, 0.6])

    def evaluate(candidates):
        values = [np.array(candidate.values) for candidate in candidates]
        return [Measured((((v - one) ** 2).sum(), ((v - other) ** 2).sum())) for v in values]

    history = explore(plan, evaluate)
    assert plan.search_count == 5
    found = np.array([history[place][0].values for place in front(plan, history)])
    along = (found - one) @ (other - one) / ((other - one) @ (other - one))
    beside = np.linalg.norm(found - one - along[:, None] * (other - one), axis=1)
    assert np.median(beside) < 0.01
    steps = np.diff(np.concatenate([[0.0], np.sort(np.clip(along, 0, 1)), [1.0]]))
    assert steps.max() < 0.2


def test_an_infinite_value_is_only_the_worst():
    """Half of the range has no value; the search leaves it and finds the optimum of the rest."""
    variables = (Variable(path="a", low=0, high=1, start=0.9),)
    plan = quadratic_plan(variables=variables, generations=20, population=8)

    def evaluate(candidates):
        values = [one.values[0] for one in candidates]
        return [Measured((np.inf if v > 0.6 else (v - 0.5) ** 2,)) for v in values]

    history = explore(plan, evaluate)
    assert history[0][1].values == (np.inf,)
    assert history[-1][0].values[0] == pytest.approx(0.5, abs=0.01)


def test_limits_come_first():
    """With a limit on the other objective the best value is the one at the limit, and candidates
    beyond it are on no front."""
    variables = (Variable(path="a", low=0, high=1, start=0.2),)
    objectives = (
        Objective(metric="f", goal="minimise"),
        Objective(metric="g", goal="maximise", limit=0.7, weight=0),
    )
    plan = quadratic_plan(variables=variables, objectives=objectives, generations=20, population=8)

    def evaluate(candidates):
        return [Measured((one.values[0], one.values[0])) for one in candidates]

    history = explore(plan, evaluate)
    assert plan.search_count == 1
    assert history[best_of(plan, history)][0].values[0] == pytest.approx(0.7, abs=0.01)
    assert all(history[place][0].values[0] >= 0.7 for place in front(plan, history))


def test_violations_are_parts_of_the_limits():
    """At most 2 and at least 0.5 are broken by 3 and 0.25 by half a limit each."""
    objectives = (
        Objective(metric="f", goal="minimise", limit=2),
        Objective(metric="g", goal="maximise", limit=0.5),
    )
    plan = quadratic_plan(objectives=objectives)
    values = np.array([[2, 0.5], [3, 0.5], [1, 0.25], [3, 0.25], [np.inf, 1]])
    assert violations_of(plan, values).tolist() == [0, 0.5, 0.5, 1, np.inf]


def test_the_front_is_what_nothing_beats():
    """A candidate that is worse in one objective and better in none is not on it; equals both are;
    one without a value is not; where all break a limit, the one that does it least is."""
    losses = np.array([[1, 3], [2, 2], [2, 2], [2, 3], [3, 1], [0, np.inf]])
    none = np.zeros(6)
    assert front_of(losses, none).tolist() == [0, 1, 2, 4]
    assert front_of(losses, np.array([1, 1, 0.5, 0.2, 1, 0.1])).tolist() == [3]
    assert front_of(np.full((2, 1), np.inf), np.zeros(2)).tolist() == []


def test_scores_go_by_the_largest_weighed_distance():
    """On the ends of a front a weighing of one objective alone takes the end that is its own, and
    one of both takes the middle; each score is as the formula says."""
    losses = np.array([[0, 10], [2, 4], [4, 0], [np.inf, 0]])
    scores = scores_of(losses, np.zeros(4), np.array([[1, 0], [0.5, 0.5], [0, 1]]))
    assert scores.argmin(axis=1).tolist() == [0, 1, 2]
    assert scores[1, 1] == pytest.approx(0.5 * 0.5 + 0.05 * 0.5 * (0.5 + 0.4))
    assert np.isinf(scores[:, 3]).all()


@pytest.mark.parametrize(("objectives", "count"), [(1, 1), (2, 2), (2, 5), (3, 7), (4, 9), (4, 4)])
def test_weighings_are_spread(objectives, count):
    """Weighings add up to 1, differ, and hold each objective alone."""
    found = spread_weighings(objectives, count)
    assert found.shape == (count, objectives)
    assert found.sum(axis=1) == pytest.approx(1)
    assert found.min() >= 0
    away = np.linalg.norm(found[:, None] - found, axis=2)[~np.eye(count, dtype=bool)]
    assert count == 1 or away.min() > 0.3
    assert (found.max(axis=0) == 1).all()


def test_beyond_one_objective_alone_all_of_them_come_first():
    """Of three and of four objectives the first mixture weighs all alike: none is as far from the
    corners."""
    for objectives in (3, 4):
        made = spread_weighings(objectives, objectives + 1)
        assert made[-1] == pytest.approx(1 / objectives)


def test_a_single_weighing_is_that_of_all_alike():
    """One direction over three objectives weighs each with a third."""
    assert spread_weighings(3, 1) == pytest.approx(np.full((1, 3), 1 / 3))


def test_start_centres_and_the_best_are_checked():
    """Of one search with two best ones: the start, these two and the centre, in their order."""
    plan = quadratic_plan(generations=3, population=6)
    history = explore(plan, noisy_quadratic(plan, 0.0, 0))
    chosen = to_be_checked(plan, history, 2)
    values = values_of(history)[:, 0]
    best = np.argsort(values, kind="stable")[:2].tolist()
    assert [one.number for one in chosen] == sorted({0, *best, len(history) - 1})
    assert best_of(plan, history) == best[0]


def test_a_search_that_has_come_to_its_end_stops():
    """Without noise a search ends by itself long before its budget; the centre is then exact."""
    variables = (Variable(path="a", low=0, high=1, start=0.4),)
    plan = quadratic_plan(variables=variables, generations=1000, population=6)

    def evaluate(candidates):
        return [Measured(((one.values[0] - 0.5) ** 2,)) for one in candidates]

    history = explore(plan, evaluate)
    assert len(history) < 3000
    assert history[-1][0].values[0] == pytest.approx(0.5, abs=1e-6)
