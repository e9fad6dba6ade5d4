"""What is drawn: distributions, and streams that do not depend on each other.

Seeds are fixed. Bounds are five standard deviations of what is counted, if nothing else is said.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from scipy.stats import norm

import omnitrack_sim as ot
from omnitrack_sim.gym.episodes import EpisodeSampler
from omnitrack_sim.gym.options import options_of
from omnitrack_sim.pipes.random import random_network
from omnitrack_sim.robots.kinds import robot_class
from omnitrack_sim.sim.onboard import _drawn_from
from omnitrack_sim.trials.mobility import mission_sweep
from omnitrack_sim.trials.search import Search
from omnitrack_sim.trials.search_plan import Objective, SearchPlan, Variable
from omnitrack_sim.trials.sweep_file import resolve

SIGMAS = 5.0
UNIFORM = {"path": "robot.preload", "kind": "uniform", "low": 10.0, "high": 30.0}
GRAVITY = {"path": "world.gravity", "kind": "direction"}
NORMAL = {"path": "world.friction", "kind": "normal", "mean": 0.8, "std": 0.2}


def draws(*axes, **keys):
    """Values of each axis of a sweep of ``tee_turn``, one a trial."""
    return resolve({"name": "s", "base": "tee_turn", "axes": axes, **keys}).trials()


def assert_frequent(counts, shares):
    """Counts follow the shares, by chi-square: k - 1 with a spread of sqrt(2 (k - 1))."""
    counts, shares = np.asarray(counts, float), np.asarray(shares, float)
    expected = counts.sum() * shares / shares.sum()
    assert expected.min() >= 5
    free = len(counts) - 1
    # By Wilson and Hilferty the cube root of chi-square is nearly normal.
    root = (((counts - expected) ** 2 / expected).sum() / free) ** (1 / 3)
    assert root < 1 - 2 / (9 * free) + SIGMAS * math.sqrt(2 / (9 * free))


def assert_uniform(values, low=0.0, high=1.0):
    """Values are uniform between two ends: none beyond, and equally many in each of 20 bins."""
    values = np.asarray(values)
    assert low <= values.min()
    assert values.max() <= high
    assert_frequent(np.histogram(values, 20, (low, high))[0], np.ones(20))


def assert_independent(a, b):
    """Two columns have no correlation, and equally many values in each of 5 x 5 cells of ranks."""
    a, b = np.argsort(np.argsort(a)), np.argsort(np.argsort(b))
    assert abs(np.corrcoef(a, b)[0, 1]) < SIGMAS / math.sqrt(len(a))
    cells = np.histogram2d(a, b, 5)[0].ravel()
    assert_frequent(cells, np.ones(25))


def assert_directions(vectors, length):
    """Vectors of one length are uniform on the sphere: heights and angles about any axis are."""
    vectors = np.asarray(vectors)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), length, rtol=1e-12)
    ways = vectors / length
    for k in range(3):
        # Slices of a sphere of one height have one area (Archimedes).
        assert_uniform(ways[:, k], -1, 1)
        angle = np.arctan2(ways[:, k - 1], ways[:, k - 2])
        assert_uniform(angle, -np.pi, np.pi)
        assert_independent(ways[:, k], angle)


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube"])
def test_axes_have_their_distributions(sampling):
    """Uniform, normal and direction are what they say, each apart from the others."""
    drawn = draws(UNIFORM, NORMAL, GRAVITY, samples=4000, sampling=sampling)
    preload, friction = np.array(drawn["robot.preload"]), np.array(drawn["world.friction"])
    assert_uniform(preload, 10, 30)
    assert_uniform(norm.cdf(friction, 0.8, 0.2))
    assert_directions(drawn["world.gravity"], 9.81)
    for other in (preload, *np.transpose(drawn["world.gravity"])):
        assert_independent(friction, other)


@pytest.mark.parametrize(
    "ends", [{"low": 0.7}, {"high": 0.75}, {"low": 0.7, "high": 1.0}, {"low": 0.9}, {"high": 0.5}]
)
def test_a_truncated_normal_is_the_normal_between_its_ends(ends):
    """Its distribution function is that of the whole one, from the lower to the upper end, and the
    higher of two points gives the value farther on."""
    values = np.array(draws(NORMAL | ends, samples=2000)["world.friction"])
    low, high = (norm.cdf(ends.get(key, far), 0.8, 0.2) for key, far in (("low", -9), ("high", 9)))
    assert_uniform((norm.cdf(values, 0.8, 0.2) - low) / (high - low))
    points = np.array(draws(UNIFORM, samples=2000)["robot.preload"])
    assert (np.argsort(values) == np.argsort(points)).all()


def test_a_clipped_normal_keeps_what_lies_between_its_ends():
    """What lies within the ends is as without them, what lies beyond is at the end."""
    ends = {"low": 0.7, "high": 0.9}
    whole = np.array(draws(NORMAL, samples=500)["world.friction"])
    clipped = draws(NORMAL | ends | {"clipped": True}, samples=500)["world.friction"]
    assert clipped == np.clip(whole, 0.7, 0.9).tolist()


@pytest.mark.parametrize("count", [64, 50])
def test_low_discrepancy_fills_its_strata(count):
    """Latin hypercubes have one value in each of n slices of every axis; Sobol's, of a power of
    two, one in each cell of any halving of two of them, and else no more than one."""
    other = {"path": "start.theta5_deg", "kind": "uniform", "low": 0.0, "high": 1.0}
    for sampling in ("latin_hypercube", "sobol"):
        columns = draws(UNIFORM, other, samples=count, sampling=sampling)
        x = (np.array(columns["robot.preload"]) - 10) / 20
        y = np.array(columns["start.theta5_deg"])
        if sampling == "latin_hypercube":
            for column in (x, y):
                assert sorted(np.floor(column * count)) == list(range(count))
            continue
        for k in range(7):
            cells = Counter(zip(np.floor(x * 2**k), np.floor(y * 2 ** (6 - k)), strict=True))
            assert max(cells.values()) == 1


def test_grids_and_lists_are_complete():
    """Every combination of a grid's evenly spaced values, ends included, and a list's is once
    there."""
    grid = {"path": "world.friction", "kind": "grid", "start": 0.2, "stop": 0.8, "count": 4}
    kinds = {"path": "control.kind", "kind": "list", "values": ["jacobian", "paper"]}
    columns = draws(grid, kinds)
    found = list(zip(np.round(columns["world.friction"], 12), columns["control.kind"], strict=True))
    expected = itertools.product((0.2, 0.4, 0.6, 0.8), ("jacobian", "paper"))
    assert sorted(found) == sorted(expected)


@pytest.mark.parametrize("sampling", ["random", "sobol"])
def test_the_draws_of_a_trial_do_not_depend_on_how_many_follow(sampling):
    """The first trials of a longer sweep are those of the shorter one."""
    axes = (UNIFORM, NORMAL, GRAVITY)
    few = draws(*axes, samples=20, sampling=sampling, seed=3)
    many = draws(*axes, samples=300, sampling=sampling, seed=3)
    assert few == {name: values[:20] for name, values in many.items()}


def test_draws_do_not_depend_on_crossed_axes_batches_or_bases():
    """A list, a second base, and the size of batches leave every draw as it is."""
    alone = draws(UNIFORM, GRAVITY, samples=30)
    kinds = {"path": "control.kind", "kind": "list", "values": ["jacobian", "paper"]}
    for more, keys in (
        ((kinds,), {}),
        ((), {"base": ["tee_turn", "elbow_short"]}),
        ((), {"batch": 7}),
    ):
        crossed = draws(*more, UNIFORM, GRAVITY, samples=30, **keys)
        for name, values in alone.items():
            assert crossed[name] in (values, values * 2)


def test_independent_draws_of_combinations_are_apart():
    """Asked for, no two combinations share a draw, and their draws have no correlation."""
    kinds = {"path": "control.kind", "kind": "list", "values": ["jacobian", "paper"]}
    both = np.reshape(
        draws(kinds, UNIFORM, samples=2000, draws="independent")["robot.preload"], (2, 2000)
    )
    assert len(np.unique(both)) == 4000
    assert_independent(*both)
    first = draws(UNIFORM, samples=2000)["robot.preload"]
    assert both[0].tolist() == first


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_neighbouring_seeds_draw_apart(sampling):
    """Seeds that differ by one share no value; Sobol's aside, whose values are digits scrambled,
    they have no correlation."""
    one, other = (
        draws(UNIFORM, samples=1024, sampling=sampling, seed=seed)["robot.preload"]
        for seed in (5, 6)
    )
    assert not set(one) & set(other)
    assert sampling == "sobol" or abs(np.corrcoef(one, other)[0, 1]) < SIGMAS / 32


def test_a_trial_runs_what_it_has_drawn():
    """Batches hold each trial once, with the values of its row."""
    sweep = resolve(
        {"name": "s", "base": "tee_turn", "axes": [UNIFORM, GRAVITY], "samples": 45, "batch": 16}
    )
    trials = [trial for batch in sweep.batches() for trial in batch.trials]
    assert [len(batch.trials) for batch in sweep.batches()] == [16, 16, 13]
    assert [trial.index for trial in trials] == list(range(45))
    columns = sweep.trials()
    for i in (0, 17, 44):
        assert trials[i].changes == {name: values[i] for name, values in columns.items()}
        scenario = sweep.scenario(i)
        assert scenario.robot.preload == columns["robot.preload"][i]
        assert list(scenario.world.gravity) == columns["world.gravity"][i]


# Episodes


def episodes(count, **options):
    """Scenarios of as many episodes, drawn from one generator."""
    sampler = EpisodeSampler(options_of({"scenario": "tee_turn", **options}))
    rng = np.random.default_rng(11)
    return [sampler.draw(rng) for _ in range(count)]


def test_episodes_have_their_distributions():
    """Values are uniform in their ranges and apart, gravity has any direction, and each episode
    has another seed of its sensors."""
    ranges = {"world.friction": (0.6, 1.0), "start.theta5_deg": (-30.0, 60.0)}
    drawn = episodes(3000, gravity="any", ranges=ranges)
    friction = [one.world.friction for one in drawn]
    theta5 = [one.start.theta5_deg for one in drawn]
    assert_uniform(friction, 0.6, 1.0)
    assert_uniform(theta5, -30, 60)
    assert_independent(friction, theta5)
    assert_directions([one.world.gravity for one in drawn], 9.81)
    seeds = np.array([one.seed for one in drawn], float) / 2**63
    assert len(set(seeds)) == len(drawn)
    assert_uniform(seeds)
    assert_independent(seeds, friction)
    assert_independent(seeds[:-1], seeds[1:])


def test_episodes_are_in_their_own_random_networks():
    """Of 25 episodes in random networks none has the pipes of another; start and goal are two
    different ends, each of them now and then."""
    drawn = episodes(25, scenario="random_network", fittings=(4, 4))
    assert len({one.network.model_dump_json(exclude={"name"}) for one in drawn}) == 25
    places = Counter()
    for one in drawn:
        ends = one.network.open_ends
        pair = [ends.index(end) for end in (one.mission.start, one.mission.goals[0])]
        assert pair[0] != pair[1]
        places.update(enumerate(pair))
    assert set(places) == set(itertools.product((0, 1), range(3)))


# Random networks


@pytest.fixture(scope="module")
def small():
    """Networks of one tee between three straights."""
    return [random_network(seed, 4) for seed in range(250)]


def test_a_tee_is_entered_by_any_port_turned_any_way(small):
    """The end of the first straight, the port of the tee and its turn are equally frequent, each
    apart from the others."""
    joints = [network.joints[0] for network in small]
    drawn = [(*(end.split(".")[1] for end in joint.ports), joint.turn_deg) for joint in joints]
    ends, ports, turns = map(Counter, zip(*drawn, strict=True))
    for counts, values in (
        (ends, ("start", "end")),
        (ports, ("run_start", "run_end", "branch")),
        (turns, (0.0, 90.0, 180.0, 270.0)),
    ):
        assert set(counts) == set(values)
        assert_frequent(list(counts.values()), np.ones(len(values)))
    every = Counter(drawn)
    assert len(every) == 24
    assert_frequent(list(every.values()), np.ones(24))


def test_straights_are_of_any_length(small):
    """Multiples of 10 mm are equally frequent, the ends of the range half as; all are apart."""
    lengths = [[part.length for part in one.fittings if part.kind == "straight"] for one in small]
    hundredths = np.round(100 * np.array(lengths)).astype(int)
    np.testing.assert_allclose(np.array(lengths) * 100, hundredths, atol=1e-9)
    counts = np.bincount(hundredths.ravel() - 30, minlength=51)
    shares = np.ones(51)
    shares[[0, -1]] = 0.5
    assert_frequent(counts, shares)
    for a, b in itertools.combinations(hundredths.T + np.random.default_rng(0).random((3, 250)), 2):
        assert_independent(a, b)


def test_fittings_are_drawn_by_their_shares():
    """Sizes are uniform; after the first tee, tees and reducers have their shares, elbows any of
    their radii; a reducer widens as often as it narrows."""
    counts = Counter(len(random_network(seed, (1, 4)).fittings) for seed in range(150))
    assert set(counts) == {1, 2, 3, 4}
    assert_frequent(list(counts.values()), np.ones(4))
    shares = {"tee_share": 0.3, "reducer_share": 0.4}
    bores = {"diameters": (0.16, 0.15), "mean_radii": (0.24, 0.32)}
    # Behind the first tee and its straights three fittings are left, so a tee may follow.
    second = [random_network(seed, 7, **shares, **bores).fittings[4] for seed in range(250)]
    kinds = Counter(part.kind for part in second)
    assert_frequent([kinds[k] for k in ("reducer", "tee", "elbow")], [0.4, 0.6 * 0.3, 0.6 * 0.7])
    radii = Counter(part.mean_radius for part in second if part.kind == "elbow")
    assert set(radii) == {0.24, 0.32}
    assert_frequent(list(radii.values()), [1, 1])
    # An entry at the start or at the end: either way round it leads from 160 to 150 mm.
    starts = Counter(part.inner_diameter for part in second if part.kind == "reducer")
    assert_frequent(list(starts.values()), [1, 1])


def test_neighbouring_seeds_make_other_networks(small):
    """No two of 250 seeds give the same network, and lengths of one seed say nothing of the
    next's."""
    assert len({network.model_dump_json(exclude={"name"}) for network in small}) == len(small)
    first = np.array([network.fittings[0].length for network in small])
    first = first + np.random.default_rng(1).uniform(-0.005, 0.005, len(first))
    assert_independent(first[:-1], first[1:])


def test_missions_of_a_bench_are_drawn_apart():
    """Gravity has any direction, friction and orientation are uniform, start and goal differ; a
    mission does not depend on how many follow."""
    few, many = (mission_sweep("m", 40, (0.5, 1.0), count, {}).bases for count in (2, 64))
    assert all(many[name].hash == scenario.hash for name, scenario in few.items())
    drawn = list(many.values())
    gravity = np.array([one.world.gravity for one in drawn]) / 9.81
    spread = gravity.T @ gravity / len(drawn)
    # Of a direction each component has the mean 0 and the square 1/3, whose variance is 4/45.
    assert np.abs(gravity.mean(axis=0)).max() < SIGMAS * math.sqrt(1 / 3 / 64)
    assert np.abs(np.diag(spread) - 1 / 3).max() < SIGMAS * math.sqrt(4 / 45 / 64)
    friction = np.array([one.world.friction for one in drawn])
    theta5 = np.array([one.start.theta5_deg for one in drawn])
    for values, low, high in ((friction, 0.5, 1.0), (theta5, -180, 180)):
        assert_frequent(np.histogram(values, 8, (low, high))[0], np.ones(8))
    assert abs(np.corrcoef(friction, theta5)[0, 1]) < SIGMAS / 8
    assert all(one.mission.start != one.mission.goals[0] for one in drawn)


# Studies


def first_candidates(seed, directions=1, step=0.08):
    """Places (n, 2) between the bounds, and searches (n,), of the first candidates of a search for
    a linear and a logarithmic variable."""
    variables = (
        Variable(path="a.x", low=-2.0, high=2.0, start=0.4),
        Variable(path="a.y", low=0.01, high=100.0, scale="log", start=0.1),
    )
    goals = [Objective(metric=name, goal="minimise") for name in ("duration_s", "attempts")]
    plan = SearchPlan(
        variables=variables,
        objectives=tuple(goals[: 1 if directions == 1 else 2]),
        directions=directions,
        population=10,
        step=step,
        seed=seed,
    )
    asked = Search(plan).ask()[1:]
    places = [[v.place_of(x) for v, x in zip(variables, one.values, strict=True)] for one in asked]
    return np.array(places), np.array([one.search for one in asked])


def test_the_first_candidates_of_a_study_spread_about_its_start_by_the_step():
    """Over 100 seeds they are normal about the start, linear in one variable and in the logarithm
    of the other, and both are independent."""
    places = np.concatenate([first_candidates(seed)[0] for seed in range(100)])
    for values, start in zip(places.T, (0.6, 0.25), strict=True):
        assert_uniform(norm.cdf(values, start, 0.08))
    assert_independent(*places.T)


def test_searches_and_seeds_of_a_study_have_streams_of_their_own():
    """The searches of a study draw apart, and so do seeds that differ by one; more of them change
    nothing in the first."""
    two = [first_candidates(seed, directions=2) for seed in range(100)]
    streams = [
        np.concatenate([places[searches == number, 0] for places, searches in two])
        for number in (1, 2)
    ]
    assert_independent(*streams)
    assert_independent(streams[0][:-10], streams[0][10:])
    # Neither that of one seed's second search and the next seed's first.
    assert_independent(streams[1][:-10], streams[0][10:])
    alone = first_candidates(7)[0]
    np.testing.assert_array_equal(alone, two[7][0][two[7][1] == 1])


# Sensors


def test_sensors_draw_apart_from_the_scenario_and_alike_in_one_world():
    """Their stream is another with another seed, friction or start, and the same whatever drives
    the robot and whatever it is."""
    one = ot.load_scenario("tee_turn")
    key = _drawn_from(one)
    for path, value in (("seed", 1), ("world.friction", 0.77), ("start.theta5_deg", 1.0)):
        assert _drawn_from(ot.override(one, {path: value})) != key
    for path, value in (("control.cruise_speed", 0.05), ("robot.preload", 20.0), ("name", "other")):
        assert _drawn_from(ot.override(one, {path: value})) == key


# Passports


@pytest.mark.parametrize("kind", ["presser", "climber"])
def test_trials_of_a_passport_are_drawn_in_the_robots_own_weights(kind):
    """Friction and roll uniform, gravity in any direction, and pulls of which half are none: the
    others half a normal distribution of 2 weights, up to 6 of them."""
    count = 2000
    plan = ot.PassportPlan.of(kind, courses=["straight"], trials=count)
    trials = plan.sweep.trials()
    weight = 9.81 * robot_class(kind)().mass
    pulls = np.array(trials["pull.force"], float) / weight
    assert pulls.min() == 0
    assert pulls.max() <= 6 + 1e-9
    assert np.mean(pulls == 0) == pytest.approx(0.5, abs=SIGMAS * 0.5 / math.sqrt(count))
    drawn = pulls[pulls > 0]
    edges = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0 + 1e-9])
    assert_frequent(np.histogram(drawn, edges)[0], np.diff(norm.cdf(edges / 2.0)))
    for path, low, high in (("world.friction", 0.3, 1.0), ("start.theta5_deg", -180.0, 180.0)):
        values = np.array(trials[path], float)
        assert low <= values.min()
        assert values.max() <= high
        assert_frequent(np.histogram(values, 10, (low, high))[0], np.ones(10))
    gravity = np.array(trials["world.gravity"], float)
    assert np.linalg.norm(gravity, axis=1) == pytest.approx(np.full(count, 9.81), rel=1e-3)
    assert_frequent(np.histogram(gravity[:, 2] / 9.81, 10, (-1.001, 1.001))[0], np.ones(10))
