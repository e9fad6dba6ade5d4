"""Laws of passports: known data in, known estimates out; features and costs worked out by hand."""

import math
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pyarrow as pa
import pytest
from scipy.optimize import minimize
from scipy.stats import norm, t

import omnitrack_sim as ot
from omnitrack_sim.pipes import Passage
from omnitrack_sim.towns import passage_model
from omnitrack_sim.towns.features import FEATURES, kind_of, relief_of, shape_of, slopes_of
from omnitrack_sim.towns.passage_model import MODEL, KindTrials
from omnitrack_sim.towns.passport_plan import PassportPlan, _pipes
from omnitrack_sim.towns.regression import fit, fit_with_best_priors

Z = norm.ppf(0.975)
MIDDLE = np.array([0.65, 0.0, 0.0, 0.0, 50.0, 0.5, 1.0, 0.02, 0.2, 0.05, 0.1])
TURN, SHARPNESS = FEATURES.index("turn"), FEATURES.index("sharpness")


def trials(passed, costs=None, **varying):
    """Trials at one point but for the features that are given."""
    passed = np.asarray(passed, float)
    points = np.tile(MIDDLE, (len(passed), 1))
    for name, values in varying.items():
        points[:, FEATURES.index(name)] = values
    costs = np.full((len(passed), 3), np.nan) if costs is None else np.asarray(costs, float)
    return KindTrials(points, passed, costs, ["stuck"] * len(passed))


def at(**features):
    """A point (1, features) that is the middle but for those that are given."""
    point = MIDDLE.copy()
    for name, value in features.items():
        point[FEATURES.index(name)] = value
    return point[None]


def logit(p):
    return np.log(p / (1 - p))


def sample(seed=0, n=60):
    """A basis of three columns, and outcomes of a logistic law."""
    rng = np.random.default_rng(seed)
    basis = np.concatenate([np.ones((n, 1)), rng.uniform(-1, 1, (n, 2))], axis=1)
    chance = 1 / (1 + np.exp(-basis @ [0.5, 2.0, -1.0]))
    return basis, (rng.uniform(size=n) < chance).astype(float)


def densities(w, basis, passed, std):
    """Logarithms (k,) of the joint density of outcomes and coefficients (k, c), whole."""
    signs = np.where(passed == 1, 1, -1)
    return norm.logpdf(w, scale=std).sum(axis=1) - np.logaddexp(0, -signs * (w @ basis.T)).sum(
        axis=1
    )


def test_the_fit_is_the_mode_and_its_covariance_the_curvature_there():
    """Another minimiser finds the same mode, and differences the same Hessian."""
    basis, passed = sample()
    std = np.array([10.0, 1.0, 0.3])
    made = fit(basis, passed, std**-2, np.zeros(3))

    def cost(w):
        return -densities(w[None], basis, passed, std)[0]

    best = minimize(
        cost, np.zeros(3), method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-12}
    )
    assert made.coefficients == pytest.approx(best.x, abs=1e-5)
    h = 1e-3 * np.eye(3)
    w = made.coefficients
    hessian = [
        [(cost(w + a + b) - cost(w + a - b) - cost(w - a + b) + cost(w - a - b)) / 4e-6 for a in h]
        for b in h
    ]
    assert made.covariance == pytest.approx(np.linalg.inv(hessian), rel=1e-3)


def test_certain_trials_are_fitted_from_afar():
    """Where every trial passes, and wherever the search starts, the mode is the same."""
    basis, passed = sample()
    precision = np.array([1e-4, 1e-4, 1e-4])
    near = fit(basis, np.ones_like(passed), precision, np.zeros(3))
    far = fit(basis, np.ones_like(passed), precision, np.array([30.0, -40.0, 25.0]))
    assert far.coefficients == pytest.approx(near.coefficients, abs=1e-5)
    assert near.coefficients[0] > 3


def test_the_evidence_compares_priors_as_the_integral_over_the_coefficients_does():
    """Laplace's ratio of two priors is that of the integrals within a twentieth, and the prior with
    the larger one is chosen."""
    basis, passed = sample()
    basis = basis[:, :2]
    stds = [np.array([2.0, width]) for width in (0.1, 1.0, 5.0)]

    # On a grid; of each prior only what it makes likely counts.
    a, b = np.meshgrid(np.linspace(-3, 4, 71), np.linspace(-6, 6, 401), indexing="ij")
    grid = np.stack([a.ravel(), b.ravel()], axis=-1)
    exact = [np.log(np.exp(densities(grid, basis, passed, std)).sum()) for std in stds]
    made = [fit(basis, passed, std**-2, np.zeros(2)).evidence for std in stds]
    assert np.diff(made) == pytest.approx(np.diff(exact), abs=0.05)
    best = fit_with_best_priors(basis, passed, stds)
    assert best.evidence == pytest.approx(max(made))
    assert best.coefficients == pytest.approx(
        fit(basis, passed, stds[int(np.argmax(exact))] ** -2, np.zeros(2)).coefficients
    )


def test_of_trials_at_one_point_the_chance_is_their_rate_and_its_deviation_that_of_a_count():
    """7 of 10 are a logit of 0.85 with the deviation (n p q)^-1/2, but for a prior of 10 logits."""
    made = trials([1] * 7 + [0] * 3).estimate(at())
    assert made.probability == pytest.approx(0.7, abs=0.003)
    p = made.probability
    # The mode: what it lacks of the passes is what the prior draws it back by.
    assert 7 - 10 * p == pytest.approx(logit(p) / 100, abs=1e-9)
    assert made.logit_std == pytest.approx((10 * p * (1 - p) + 0.01) ** -0.5)
    assert logit(made.low) == pytest.approx(logit(p) - Z * made.logit_std)
    assert logit(made.high) == pytest.approx(logit(p) + Z * made.logit_std)


def test_what_passes_and_what_fails_are_alike():
    """Trials turned round have the chances of failing, and features turned round those of the other
    end."""
    rng = np.random.default_rng(2)
    friction, pull = rng.uniform(0.3, 1.0, 80), rng.uniform(0, 6, 80)
    passed = (rng.uniform(size=80) < 1 / (1 + np.exp(-8 * (friction - 0.6) + pull))).astype(float)
    features = {"friction": friction, "pull": pull}
    asked = np.concatenate([at(friction=f, pull=p) for f, p in ((0.4, 1), (0.7, 2), (0.9, 0.2))])
    made = trials(passed, **features).estimate(asked)
    turned = trials(1 - passed, **features).estimate(asked)
    assert turned.probability == pytest.approx(1 - made.probability, abs=1e-6)
    assert turned.low == pytest.approx(1 - made.high, abs=1e-6)
    assert np.ptp(made.probability) > 0.5
    climb = 2 * (friction - 0.3) / 0.7 - 1
    asked = np.concatenate([at(climb=c) for c in (-0.6, 0.1, 0.8)])
    up = trials(passed, climb=climb).estimate(asked)
    turned_round = np.array([name == "climb" for name in FEATURES])
    down = trials(passed, climb=-climb).estimate(asked * np.where(turned_round, -1, 1))
    assert down.probability == pytest.approx(up.probability, abs=1e-6)


def test_the_effect_of_a_feature_is_the_change_of_the_logit_over_its_range():
    """With the others in the middle; of one that did not vary it is none."""
    rng = np.random.default_rng(4)
    turn, pull = rng.uniform(0, 90, 120), rng.uniform(0, 4, 120)
    passed = (rng.uniform(size=120) < 1 / (1 + np.exp(0.1 * (turn - 45)))).astype(float)
    kind = trials(passed, turn=turn, pull=pull)
    low, high = kind.bounds
    line = np.tile((low + high) / 2, (21, 1))
    line[:, TURN] = np.linspace(turn.min(), turn.max(), 21)
    assert kind.effect(TURN) == pytest.approx(np.ptp(logit(kind.estimate(line).probability)))
    assert kind.effect(TURN) > 3
    assert kind.effect(SHARPNESS) == 0


def test_costs_at_one_point_are_those_of_a_lognormal_distribution():
    """Mean exp(m + s²/2), deviation of a pass and error of the mean of so many, both widened as
    Student's distribution is against the normal one; failures count for nothing."""
    logs = np.array([1.0, 1.4, 0.7, 1.1, 1.6, 0.9, 1.3, 1.2, 0.8, 1.5])
    costs = np.exp(logs)[:, None] * [1.0, 2.0, 0.01]
    failed = np.full((3, 3), np.nan)
    kind = trials([1] * 10 + [0] * 3, np.concatenate([costs, failed]))
    made, (means, deviations, errors) = kind.estimate(at()), kind.cost(at())
    s = logs.std(ddof=1)
    mean = math.exp(logs.mean() + s**2 / 2)
    wide = t.ppf(0.975, 9) / Z
    assert made.seconds == pytest.approx(mean)
    assert made.joules == pytest.approx(2 * mean)
    assert made.slip == pytest.approx(0.01 * mean)
    assert made.seconds_std == pytest.approx(mean * math.sqrt(math.exp(s**2) - 1) * wide)
    assert made.joules_std == pytest.approx(2 * made.seconds_std)
    assert made.seconds_error == pytest.approx(mean * s / math.sqrt(10) * wide)
    assert np.stack([means[0], deviations[0], errors[0]]) == pytest.approx(
        np.stack([made.seconds, made.seconds_std, made.seconds_error])
    )


def test_costs_follow_a_feature_by_a_line_in_their_logarithm():
    """Of n balanced trials at both ends, whose logarithms differ by 2 d, the line's slope is
    n d / (n + 1); half-way out its error is that of the constant and half of the slope's."""
    n, d = 40, 0.5
    ends = np.repeat([-1.0, 1.0], n // 2)
    noise = 0.1 * np.tile([-1.0, 1.0], n // 2)
    costs = np.exp(1.0 + d * ends + noise)[:, None] * np.ones(3)
    kind = trials(np.ones(n), costs, turn=50 + 40 * ends)
    slope = n * d / (n + 1)
    residuals = noise + (d - slope) * ends
    # A trial's weight less than one degree of freedom goes to the slope.
    free = n - 1 - n / (n + 1)
    variance = residuals @ residuals / free
    wide = t.ppf(0.975, free) / Z
    for z in (-1.0, 0.0, 0.5, 1.0):
        made = kind.estimate(at(turn=50 + 40 * z))
        mean = math.exp(1.0 + slope * z + variance / 2)
        assert made.seconds == pytest.approx(mean, rel=1e-6)
        error = mean * math.sqrt(variance * (1 / n + z**2 / (n + 1))) * wide
        assert made.seconds_error == pytest.approx(error, rel=1e-6)


def test_of_few_passes_costs_scatter_as_those_of_others_do():
    """Of four of the eight that are enough, half of the variance is 0.4 squared."""
    logs = np.array([1.0, 1.2, 0.9, 1.1])
    kind = trials([1] * 4, np.exp(logs)[:, None] * np.ones(3))
    variance = logs.var(ddof=1) / 2 + 0.4**2 / 2
    made = kind.estimate(at())
    mean = math.exp(logs.mean() + variance / 2)
    assert made.seconds == pytest.approx(mean)
    deviation = mean * math.sqrt(math.exp(variance) - 1)
    assert made.seconds_std == pytest.approx(deviation * t.ppf(0.975, 3) / Z)
    nothing = trials([0] * 4).estimate(at())
    assert np.isnan([nothing.seconds, nothing.joules_std, nothing.seconds_error]).all()
    assert nothing.is_known.all()


def test_what_costs_next_to_nothing_counts_as_a_twentieth_of_the_others():
    """A pass of less than that is taken for a twentieth of the median."""
    costs = np.full((20, 3), 8.0)
    odd = costs.copy()
    costs[0], odd[0] = 0.4, (-3.0, 0.0, 0.1)
    same, other, more = (trials(np.ones(20), c).estimate(at()) for c in (costs, odd, 1.02 * costs))
    assert same.seconds == pytest.approx(other.seconds, rel=1e-6)
    assert more.seconds == pytest.approx(1.02 * same.seconds, rel=1e-9)
    costs[0] = 0.45
    assert trials(np.ones(20), costs).estimate(at()).seconds != pytest.approx(same.seconds, 1e-4)


DRAWN = ("friction", "climb", "lift")
EDGES = {
    # Of these three the range that they are drawn from, of the rest what was tried; and how far
    # beyond a point still counts as inside.
    "friction": (0.3, 1.0, 0.02),
    "pull": (0.0, 4.0, 0.05),
    "climb": (-1.0, 1.0, 0.02),
    "lift": (-1.0, 1.0, 0.02),
    "turn": (6.0, 90.0, 5.0),
    "sharpness": (0.2, 0.7, 0.06),
    "bore": (0.95, 1.05, 0.015),
    "step": (0.01, 0.05, 0.002),
    "gap": (0.1, 0.5, 0.02),
    "ovality": (0.02, 0.15, 0.01),
    "deposit": (0.05, 0.2, 0.01),
}


def test_at_the_edge_of_what_was_tried_something_is_said_and_beyond_nothing():
    """A hair inside the edge there is an estimate, a hair outside there is none; of a feature that
    did not vary the edges are its value."""
    rng = np.random.default_rng(6)
    for name, (low, high, slack) in EDGES.items():
        values = rng.uniform(low, high, 200)
        if name in DRAWN:
            values = 0.9 * values + 0.05 * (low + high)  # the ends themselves were not drawn
        elif name == "pull":
            values[:2] = 0.3, high
        else:
            values = np.repeat([low, high], 100)
        kind = trials(np.ones(200), **{name: values})
        for edge, side in ((low, -1), (high, 1)):
            inside, outside = (at(**{name: edge + side * (slack + d)}) for d in (-1e-6, 1e-6))
            assert kind.estimate(inside).is_known.all(), (name, edge)
            assert not kind.estimate(outside).is_known.any(), (name, edge)
        alike, value = trials(np.ones(20)), MIDDLE[FEATURES.index(name)]
        for side in (-1, 1):
            assert alike.estimate(at(**{name: value + side * 0.9 * slack})).is_known.all()
            assert not alike.estimate(at(**{name: value + side * 1.1 * slack})).is_known.any()


def test_half_as_far_again_as_the_farthest_trial_is_known_in_the_measure_of_regression():
    """Two features went together, so that across the leverage grows four times as fast: there
    1/4 + v² is at most one and a half times the trials' 3/4."""
    z = np.array([[1, 1], [-1, -1], [0.5, -0.5], [-0.5, 0.5]])
    kind = trials(np.ones(4), turn=50 + 40 * z[:, 0], sharpness=0.5 + 0.4 * z[:, 1])
    for v, known in ((0.93, True), (0.94, False)):
        across = v / math.sqrt(2)
        for side in (-1, 1):
            point = at(turn=50 + 40 * side * across, sharpness=0.5 - 0.4 * side * across)
            assert kind.estimate(point).is_known.all() == known


def test_a_longer_way_through_a_fitting_costs_as_much_as_straight_pipe():
    """Beyond half a bore each metre adds a straight's time, work and slip at the same friction,
    pull, climb and bore, whatever the turn, and a shorter way takes it off; chances stay."""
    rng = np.random.default_rng(8)
    climb = np.repeat([-1.0, 1.0], 500)
    metre = (10 * np.exp(0.3 * climb))[:, None] * [1.0, 2.0, 0.001]
    straight = trials(np.ones(1000), metre, climb=climb, turn=0.0, sharpness=0.0, bore=1.0)
    own = trials(
        rng.uniform(size=50) < 0.8,
        np.tile([[4.0, 6.0, 0.01]], (50, 1)),
        climb=np.linspace(-1, 1, 50),
    )
    robot = ot.load_scenario("robots/presser_elbow").robot
    passport = ot.Passport(robot, {}, {"elbow": own, "straight": straight})
    points = np.concatenate([at(climb=c, lift=0.01) for c in (0.9, -0.9, 0.9)])
    lengths = np.array([1.08, 1.08, 0.03])
    made, plain = passport.estimate("elbow", points, lengths), passport.estimate("elbow", points)
    more = (lengths - 0.08) * 10 * np.exp(0.3 * np.array([0.9, -0.9, 0.9]))
    assert made.seconds - plain.seconds == pytest.approx(more, rel=0.01)
    assert made.joules - plain.joules == pytest.approx(2 * more, rel=0.01)
    assert made.slip - plain.slip == pytest.approx(0.001 * more, rel=0.01)
    assert made.probability.tolist() == plain.probability.tolist()
    assert made.seconds_std.tolist() == plain.seconds_std.tolist()
    free = at(turn=0.0, sharpness=0.0)
    assert (
        passport.estimate("straight", free, np.array([3.0])).seconds
        == passport.estimate("straight", free).seconds
    )


def test_a_summary_counts_what_passed_and_what_stopped():
    """Means are of the passes, outcomes of the failures."""
    kind = trials([1, 1, 0, 0, 0, 1], [[2, 3, 0.1], [4, 5, 0.3], *[[np.nan] * 3] * 3, [6, 1, 0.2]])
    outcomes = ["reached_goal"] * 2 + ["stuck", "slipping", "stuck", "reached_goal"]
    robot = ot.load_scenario("robots/presser_elbow").robot
    kinds = {"elbow": replace(kind, outcomes=outcomes), "mitre": trials([0, 0])}
    passport = ot.Passport(robot, {}, kinds, {"tee": "too wide"})
    row, other = passport.summary()["ways"]
    assert (row["kind"], row["trials"], row["passed"]) == ("elbow", 6, 3)
    assert (row["seconds"], row["joules"], row["slip_m"]) == pytest.approx((4.0, 3.0, 0.2))
    assert row["stopped_by"] == {"slipping": 1, "stuck": 2}
    assert row["success_95"] == pytest.approx((0.1876, 0.8124), abs=1e-3)
    assert (other["seconds"], other["passed"]) == (None, 0)
    assert passport.summary()["misfits"] == {"tee": "too wide"}


PIPES = {"length": 2.0, "inner_diameter": 0.16}
BEAD = {"kind": "weld", "at": 1.0, "height": 0.004, "width": 0.016}
OVAL = {"kind": "ovality", "ratio": 0.05}
BEDS = [
    {"kind": "deposit", "at": 1.0, "length": 0.5, "depth": d, "angle_deg": 0}
    for d in (0.008, 0.016)
]
DENT = {"kind": "dent", "at": 1.5, "depth": 0.02, "length": 0.2, "width": 0.2}
ROUGH = {"kind": "corrosion"}
WORN = [
    # Fitting, whether it is driven from its end; kind; step, gap, ovality, deposit.
    ({"kind": "straight", **PIPES}, False, "straight", (0, 0, 0, 0)),
    ({"kind": "straight", "relief": [BEAD], **PIPES}, True, "straight, relief", (0.025, 0, 0, 0)),
    ({"kind": "straight", "relief": [OVAL], **PIPES}, False, "straight, relief", (0, 0, 0.05, 0)),
    ({"kind": "straight", "relief": BEDS, **PIPES}, False, "straight, relief", (0, 0, 0, 0.1)),
    (
        {"kind": "straight", "relief": [BEAD, *BEDS, DENT], **PIPES},
        False,
        "straight, relief",
        (0.025, 0, 0, 0.125),
    ),
    ({"kind": "cap", "relief": [BEAD], **PIPES}, True, "straight, relief", (0.025, 0, 0, 0)),
    ({"kind": "straight", "relief": [BEAD, ROUGH], **PIPES}, False, "straight, corrosion", None),
    ({"kind": "straight", "section": "egg", **PIPES}, False, "straight, egg", None),
    (
        {"kind": "straight", "section": "oval", "ovality": 0.1, **PIPES},
        False,
        "straight, relief",
        (0, 0, 0.1, 0),
    ),
    # The step is met from the wider side alone, what lies aside from both.
    ({"kind": "coupling", "end_diameter": 0.144}, False, "coupling", (0.05, 0, 0, 0)),
    ({"kind": "coupling", "end_diameter": 0.144}, True, "coupling", (0, 0, 0, 0)),
    ({"kind": "coupling", "offset": 0.008, "gap": 0.04}, False, "coupling", (0.05, 0.25, 0, 0)),
    ({"kind": "coupling", "offset": 0.008, "gap": 0.04}, True, "coupling", (0.05, 0.25, 0, 0)),
    (
        {"kind": "coupling", "offset": 0.004, "end_diameter": 0.168},
        False,
        "coupling",
        (0, 0, 0, 0),
    ),
    (
        {"kind": "coupling", "offset": 0.004, "end_diameter": 0.168},
        True,
        "coupling",
        (0.05, 0, 0, 0),
    ),
]


def test_features_of_pipes_as_they_are_by_hand():
    """The largest of each kind, in bores of the robot; what no feature tells of is another kind."""
    for table, back, kind, sizes in WORN:
        network = ot.Network(fittings=[{"name": "p", **table}], place={"axis": (1.0, 0.0, 0.0)})
        ports = ("end", "start") if back else ("start", "end")
        way = Passage.of(network.pipes, (0, *ports))
        assert kind_of(way) == kind, table
        if sizes is not None:
            assert relief_of(way, 0.16) == pytest.approx(sizes, abs=1e-9), (table, back)
            halves = [size if k == 2 else size / 2 for k, size in enumerate(sizes)]
            assert relief_of(way, 0.32) == pytest.approx(halves, abs=1e-9), table


UP, COS_30 = (0, 0, 1), math.sqrt(0.75)
ELBOW, TEE = {"kind": "elbow", "mean_radius": 0.2}, {"kind": "tee"}
PIPE, CONE = {"kind": "straight", "length": 1.0}, {"kind": "reducer", "length": 0.3}
BY_HAND = [
    # Fitting, ports, axis of the first port; kind; slopes in, aside and out; shape.
    (PIPE, "start end", (0.8, 0, 0.6), "straight", (0.6, 0, 0.6), (0, 0, 1)),
    (PIPE, "end start", (0.8, 0, 0.6), "straight", (-0.6, 0, -0.6), (0, 0, 1)),
    (ELBOW, "start end", UP, "elbow", (1, 0, 0), (90, 0.8, 1)),
    (ELBOW, "end start", UP, "elbow", (0, -1, -1), (90, 0.8, 1)),
    ({**ELBOW, "angle_deg": 60}, "end start", UP, "elbow", (-0.5, -COS_30, -1), (60, 0.8, 1)),
    (TEE, "run_start branch", UP, "tee, run to branch", (1, 0, 0), (90, 0, 1)),
    (TEE, "run_end branch", UP, "tee, run to branch", (-1, 0, 0), (90, 0, 1)),
    (TEE, "branch run_start", UP, "tee, branch to run", (0, -1, -1), (90, 0, 1)),
    (TEE, "run_start run_end", UP, "tee, over the run", (1, 0, 1), (0, 0, 1)),
    ({**CONE, "end_diameter": 0.15}, "start end", UP, "reducer", (1, 0, 1), (0, 1 / 16, 1)),
    ({**CONE, "end_diameter": 0.15}, "end start", UP, "reducer", (-1, 0, -1), (0, -1 / 15, 0.9375)),
    ({"kind": "cap", "length": 0.3}, "end start", UP, "straight", (-1, 0, -1), (0, 0, 1)),
]


def test_features_by_hand():
    """Slopes are sines, whatever the size of gravity, and both ways through a fitting are passages
    of their own: a reducer narrows one way and widens the other."""
    down = np.array([0.0, 0.0, -3.7])
    for table, ports, axis, kind, slopes, shape in BY_HAND:
        network = ot.Network(fittings=[{"name": "p", **table}], place={"axis": axis})
        way = Passage.of(network.pipes, (0, *ports.split()))
        assert kind_of(way) == kind, (table, ports)
        assert slopes_of(way, down) == pytest.approx(slopes, abs=1e-9), (table, ports)
        assert shape_of(way, 0.16) == pytest.approx(shape, abs=1e-9), (table, ports)
        assert slopes_of(way, 0 * down) == (0, 0, 0)
        assert shape_of(way, 0.32)[2] == pytest.approx(shape[2] / 2)


TURNS = {
    "straight": [0, 0, 0],
    "elbow": [6, 30, 45, 90, 90, 90, 90, 90, 90, 150],
    "mitre": [3, 8, 22.5, 45, 90],
    "reducer": [0, 0],
    "tee, run to branch": [90, 90, 90],
    "tee, branch to run": [90, 90, 90],
    "tee, over the run": [0, 0, 0],
    "wye, run to branch": [35, 70, 70, 110, 145],
    "wye, branch to run": [35, 70, 110, 110, 145],
    "wye, over the run": [0, 0],
    "cross, run to branch": [60, 90, 120],
    "cross, branch to run": [60, 90, 120],
    "cross, over the run": [0],
    "cross, across the run": [0],
    "straight, relief": [0] * 8,
    "coupling": [0] * 8,
}


def test_the_courses_are_those_that_a_passport_promises():
    """65, of which each has one fitting between straights, as far as robots pass them: sharp and
    wide elbows, acute and obtuse branches, one of them narrower, reducers to both sides, and the
    commonest ways in bores 5 % too small and too large; relief and couplings."""
    tried = {}
    for name, pipes in _pipes():
        assert len(pipes) in (1, 3), name
        assert {lead["kind"] for lead in pipes[::2]} == {"straight"}
        middle = pipes[len(pipes) // 2] | {"name": "p"}
        ports = middle.pop("enter", "start"), middle.pop("leave", "end")
        network = ot.Network(fittings=[{"inner_diameter": 1.0, **middle}])
        way = Passage.of(network.pipes, (0, *ports))
        tried.setdefault(kind_of(way), []).append(shape_of(way, 1.0))
    shapes = {kind: np.array(sorted(own)).T for kind, own in tried.items()}
    assert {kind: own[0].round(6).tolist() for kind, own in shapes.items()} == TURNS
    assert len({name for name, _ in _pipes()}) == sum(map(len, TURNS.values())) == 65
    for kind, low, high in (
        ("elbow", 1 / 3, 1 / 0.6),  # bore over bend radius
        ("reducer", -0.05, 0.05),
        ("wye, run to branch", 0.0, 0.1),
        ("wye, branch to run", -1 / 9, 0.0),
    ):
        assert (shapes[kind][1].min(), shapes[kind][1].max()) == pytest.approx((low, high))
    for kind in ("straight", "elbow", *(kind for kind in TURNS if kind.startswith("tee"))):
        assert sorted({*shapes[kind][2]}) == pytest.approx([0.95, 1.0, 1.05]), kind


PARTITIONS = 2


@cache
def left_out_loss(**model):
    """Logarithmic losses of the trials of the passport that comes along, with other settings of the
    model: a fifth at a time is left out, in ``PARTITIONS`` ways."""
    losses = []
    for kind, seed in product(ot.load_passport("omnitrack").kinds.values(), range(PARTITIONS)):
        fold = np.random.default_rng(seed).permutation(len(kind.passed)) % 5
        for k in range(5):
            seen, out = fold != k, fold == k
            part = KindTrials(kind.points[seen], kind.passed[seen], kind.costs[seen], ())
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(passage_model, "MODEL", replace(MODEL, leverage=np.inf, **model))
                p = part.estimate(kind.points[out]).probability
            losses += (-np.log(np.where(kind.passed[out] == 1, p, 1 - p))).tolist()
    return np.array(losses)


@pytest.mark.parametrize(
    "other",
    [
        {"intercept": 100.0},
        {"linear": (0.3,)},
        {"linear": (10.0,)},
        {"quadratic": (1.0,)},
        {"quadratic": (0.1, 10.0)},
        {"certain": 0.0},
    ],
    ids=str,
)
def test_no_other_priors_predict_left_out_trials_better(other):
    """Those that know less or allow for more lower the loss by three standard errors at most; each
    was worse by about two or more for another passport, of the motor ``simulation``."""
    more = left_out_loss(**other) - left_out_loss()
    more = more[np.isfinite(more)]
    error = more.std() / np.sqrt(len(more) / PARTITIONS)
    assert more.mean() > -3 * error


def test_squares_that_may_say_anything_predict_left_out_trials_worse():
    """Their loss is higher by a twentieth and more."""
    losses = left_out_loss(quadratic=(0.1, 10.0)), left_out_loss()
    assert np.nanmean(losses[0]) > 1.05 * np.nanmean(losses[1])


def test_the_more_trials_the_more_a_square_may_say():
    """A robot that passes in the middle of a slope's range alone: of six trials hardly anything is
    believed of that, of six hundred nearly all."""
    for count, low, high in ((6, 0.0, 2.0), (600, 5.0, 9.0)):
        climb = np.linspace(-1, 1, count)
        chance = 1 / (1 + np.exp(12 * np.abs(climb) - 6))
        kind = trials(np.arange(count) * 0.618 % 1 < chance, climb=climb)
        p = kind.estimate(np.concatenate([at(climb=0.0), at(climb=0.95)])).probability
        assert low < logit(p[0]) - logit(p[1]) < high, count


def test_half_of_the_pulls_are_none_and_the_others_normal_up_to_six_weights():
    """A deviation of two robot weights: of 65 courses a sixth pulls harder, some at the largest."""
    plan = PassportPlan.of("presser")
    weight = 9.81 * ot.load_scenario("robots/presser_elbow").robot.mass
    pulls = np.array(plan.sweep.trials()["pull.force"]) / weight
    assert len(pulls) == 64 * len(plan.sweep.bases)
    for pull, part in ((1e-9, 0.5), (1.0, norm.sf(0.5)), (2.0, norm.sf(1)), (4.0, norm.sf(2))):
        assert np.mean(pulls > pull) == pytest.approx(part, abs=0.005)
    assert pulls.max() == pytest.approx(6.0)


def test_a_feature_matters_from_one_logit_on():
    """Over its range, as the summary says it."""
    robot = ot.load_scenario("robots/presser_elbow").robot
    for slope, told in ((0.6, ["climb"]), (0.4, [])):
        climb = np.linspace(-1, 1, 4000)
        chance = 1 / (1 + np.exp(-slope * climb))
        kind = trials(np.arange(4000) * 0.6180339887 % 1 < chance, climb=climb)
        row = ot.Passport(robot, {}, {"elbow": kind}).summary()["ways"][0]
        assert row["matters"] == told


def test_the_passport_that_comes_along_knows_every_kind_of_way():
    """It is read by its name, has 16 trials of each course, and says something at the middle of
    each kind."""
    made = ot.load_passport("omnitrack")
    counts = {name: len(kind.passed) for name, kind in made.kinds.items()}
    assert counts == {name: 16 * len(turns) for name, turns in TURNS.items()}
    for name, kind in made.kinds.items():
        middle = (kind.bounds[0] + kind.bounds[1]) / 2
        near = kind.points[np.argmin(np.abs(kind.points - middle).sum(axis=1))]
        said = made.estimate(name, near)
        assert said.is_known.all(), name
        assert 0 < said.low[0] < said.probability[0] < said.high[0] < 1, name


def test_a_passport_takes_the_straights_off_what_a_fitting_cost():
    """A made-up robot whose time by the metre grows with the slope spends four seconds in each
    elbow: that is what the passport finds, with the pull in robot weights, the friction, and the
    slopes of the trial."""
    courses = ["straight", "elbow_150", "tee_run_start_branch"]
    plan = ot.PassportPlan.of("presser", courses=courses, trials=64)
    sweep, rows = plan.sweep, plan.sweep.trials()
    weight = 9.81 * ot.load_scenario("robots/presser_elbow").robot.mass
    columns = {"base": rows["base"], "outcome": [], "success": [], "duration_s": [], "energy_j": []}
    columns |= {"distance_m": [], "slip_distance_m": []}
    columns |= {name: rows[name] for name in ("world.friction", "pull.force")}
    for k, axis in enumerate("xyz"):
        columns[f"world.gravity_{axis}"] = [g[k] for g in rows["world.gravity"]]
    wanted = {}
    for i, base in enumerate(rows["base"]):
        scenario = sweep.bases[base]
        up = -np.array(rows["world.gravity"][i]) / 9.81
        way = scenario.route.centreline
        s = np.linspace(scenario.start.distance, scenario.goal_distance, 4001)
        s = (s[1:] + s[:-1]) / 2
        middle = scenario.route.length / 2
        # Half a bore about the middle of the fitting is its own; the straights' slopes lead there.
        ends = way.at(np.array([0.0, scenario.route.length - 1e-9]))[1] @ up
        pace = 10 * np.exp(0.3 * np.where(s < middle, *ends))
        through = pace if base == "straight" else np.where(abs(s - middle) < 0.04, 0.0, pace)
        step = (scenario.goal_distance - scenario.start.distance) / 4000
        passed = i % 7 > 0
        columns["outcome"].append("reached_goal" if passed else "stuck")
        columns["success"].append(passed)
        columns["distance_m"].append(scenario.goal_distance - scenario.start.distance)
        own = 0.0 if base == "straight" else 4.0
        for name, factor in (("duration_s", 1.0), ("energy_j", 2.0), ("slip_distance_m", 0.01)):
            columns[name].append(factor * (through.sum() * step + own))
        slopes = (*ends[:1], ends[1]) if base != "straight" else (ends[0], 0.0)
        wanted.setdefault(base, []).append(
            (rows["world.friction"][i], rows["pull.force"][i] / weight, *slopes)
        )
    made = plan.passport(pa.table(columns))
    assert list(made.kinds) == ["straight", "elbow", "tee, run to branch"]
    for kind, base in zip(made.kinds.values(), courses, strict=True):
        assert kind.points[:, :4] == pytest.approx(np.array(wanted[base]), abs=1e-9)
        assert kind.passed.tolist() == [i % 7 > 0 for i, b in enumerate(rows["base"]) if b == base]
        assert np.isnan(kind.costs[kind.passed == 0]).all()
        done = kind.costs[kind.passed == 1]
        if base != "straight":
            assert done == pytest.approx(np.tile([[4.0, 8.0, 0.04]], (len(done), 1)), rel=0.05)
    straight = made.kinds["straight"]
    level = straight.estimate(np.array([[0.6, 0.5, 0.0, 0, 0, 0, 1, 0, 0, 0, 0]]))
    assert level.seconds == pytest.approx(10.0, rel=0.02)


def test_the_hash_of_a_plan_is_that_of_what_its_trials_depend_on():
    """Robot, changes, courses and trials; a folder of another plan is not gone on with."""
    given = {"courses": ["straight"], "trials": 2}

    def made(robot="presser", **changes):
        return ot.PassportPlan.of(robot, **{**given, **changes}).hash

    others = [
        made("screw"),
        made(trials=3),
        made(courses=["straight", "elbow_150"]),
        made(changes={"robot.preload": 30.0}),
    ]
    assert made() == made()
    assert len({made(), *others}) == 5
    assert all(len(one) == 64 for one in others)
