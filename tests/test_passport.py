"""Passports: estimates from trials, what they cover, where they say nothing; and their files."""

import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import omnitrack_sim as ot
from omnitrack_sim.pipes import Passage
from omnitrack_sim.record.statistics import wilson_interval
from omnitrack_sim.towns.features import FEATURES, shape_of, slopes_of
from omnitrack_sim.towns.passage_model import KindTrials
from omnitrack_sim.towns.passport import PASSPORT_FILE

TRUTHS = {
    "steep": lambda x: 1 / (1 + np.exp(-25 * (x[:, 0] - 0.55 - 0.15 * x[:, 2]))),
    "smooth": lambda x: 1 / (1 + np.exp(-6 * (x[:, 0] - 0.6) + 0.8 * x[:, 1])),
    "sure": lambda x: np.full(len(x), 0.995),
}


def points(rng, n):
    """Random points in which friction, pull, climb and lift vary."""
    x = np.zeros((n, len(FEATURES)))
    x[:, 0], x[:, 1] = rng.uniform(0.3, 1.0, n), np.abs(rng.normal(0, 1, n))
    x[:, 2:4] = rng.uniform(-1, 1, (n, 2))
    x[:, 6] = 1.0
    return x


def drawn(truth, rng, n):
    """Trials of a robot that passes with probabilities ``truth``."""
    x = points(rng, n)
    passed = (rng.uniform(size=n) < truth(x)).astype(float)
    costs = np.stack([5 + x[:, 2] + rng.normal(0, 0.2, n), 2 + x[:, 0], 0 * passed], axis=-1)
    return KindTrials(x, passed, np.where(passed[:, None] == 1, costs, np.nan), ["stuck"] * n)


@pytest.mark.parametrize("name", TRUTHS)
def test_intervals_cover_the_true_probability_of_held_out_points(name):
    """On average over twenty robots and the points that are known, 95 % intervals hold the truth in
    90 % of points and more, to a hundredth, and sums of probabilities are those of the passes."""
    covered, passes, sure = [], 0.0, 0.0
    for seed in range(20):
        rng = np.random.default_rng([7, seed])
        kind = drawn(TRUTHS[name], rng, 160)
        x = points(rng, 100)
        made, truth = kind.estimate(x), TRUTHS[name](x)
        known = made.is_known
        within = (made.low - 0.01 <= truth) & (truth <= made.high + 0.01)
        covered.append(within[known])
        passes += (rng.uniform(size=100) < truth)[known].sum()
        sure += made.probability[known].sum()
    counts = np.concatenate(covered)
    assert len(counts) > 1500
    assert counts.mean() > 0.9
    low, high = wilson_interval(round(passes), len(counts))
    assert low - 0.01 <= sure / len(counts) <= high + 0.01


def test_features_that_matter_are_found():
    """What decides has a large effect on the logit, what does not a small one."""
    kind = drawn(TRUTHS["steep"], np.random.default_rng(3), 240)
    effects = [kind.effect(k) for k in range(len(FEATURES))]
    assert effects[0] > 10
    assert effects[2] > 2
    assert max(effects[1], effects[3]) < effects[2] / 2
    assert effects[4:] == [0] * (len(FEATURES) - 4)


def test_nothing_is_said_outside_what_was_tried():
    """Neither beyond the range of a feature nor of a kind without trials; means are those near."""
    kind = drawn(TRUTHS["sure"], np.random.default_rng(5), 200)
    inside = np.array([[0.7, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    made = kind.estimate(inside)
    assert made.is_known.all()
    assert made.seconds == pytest.approx(5.0, abs=1.0)
    for feature, value in ((0, 0.1), (1, 9.0), (4, 45.0), (6, 1.2)):
        outside = inside.copy()
        outside[0, feature] = value
        unknown = kind.estimate(outside)
        assert not unknown.is_known.any()
        assert np.isnan([unknown.probability, unknown.low, unknown.seconds]).all()
    passport = ot.Passport(ot.load_scenario("robots/presser_elbow").robot, {}, {"elbow": kind})
    assert not passport.estimate("tee, run to branch", inside).is_known.any()


def test_a_few_passes_do_not_vouch_for_a_strong_pull():
    """Friction and pull always matter: where all of a few trials pass, the largest pull that was
    tried is less certain than the middle of the trials."""
    x = points(np.random.default_rng(1), 24)
    kind = KindTrials(x, np.ones(24), np.full((24, 3), np.nan), ["stuck"] * 24)
    middle, pulled = (x.mean(axis=0) for _ in range(2))
    pulled[1] = x[:, 1].max()
    made = kind.estimate(np.stack([middle, pulled]))
    assert made.low[1] < made.low[0] / 5


def test_a_combination_that_nobody_tried_is_unknown():
    """Slippery walls were tried going down and dry ones going up; the other way round nothing is
    said, though each feature alone lies in its range."""
    rng = np.random.default_rng(1)
    x = points(rng, 200)
    x[:, 2] = np.clip(2 * (x[:, 0] - 0.3) / 0.7 - 1 + rng.normal(0, 0.05, 200), -1, 1)
    kind = KindTrials(x, np.ones(200), np.full((200, 3), np.nan), ["stuck"] * 200)
    asked = np.tile(x.mean(axis=0), (2, 1))
    asked[:, 0], asked[:, 2] = 0.95, (0.85, -0.9)
    assert kind.estimate(asked).is_known.tolist() == [True, False]


def test_costs_of_few_passes_scatter_all_the_same():
    """Two passes of equal cost say little of what a third one takes."""
    x, passed = points(np.random.default_rng(1), 20), np.zeros(20)
    passed[:2] = 1
    costs = np.where(passed[:, None] == 1, [[5.0, 2.0, 0.1]], np.nan)
    made = KindTrials(x, passed, costs, ["stuck"] * 20).estimate(x[:1])
    assert made.seconds == pytest.approx(5.0, rel=0.1)
    assert made.seconds_std > 0.3 * made.seconds


def test_a_pass_without_a_cost_of_its_own_does_not_spoil_the_mean():
    """Less than nothing may be left of a run without its straights; the mean is of the others."""
    x = points(np.random.default_rng(1), 20)
    costs = np.tile([[5.0, 2.0, 0.1]], (20, 1))
    costs[3, 0] = -0.2
    kind = KindTrials(x, np.ones(20), costs, ["stuck"] * 20)
    made = kind.estimate(x.mean(axis=0)[None])
    assert made.seconds == pytest.approx(5.0, rel=0.2)


def test_features_of_a_passage_are_slopes_and_shape():
    """Up a run and out through the branch: climb 1, lift 0, a right angle; the other way round the
    robot climbs last."""
    turn, merge = (ot.load_scenario(name).route.passages[1] for name in ("tee_turn", "tee_merge"))
    gravity = np.array([0.0, 0.0, -9.81])
    assert slopes_of(turn, gravity) == pytest.approx((1, 0, 0), abs=1e-12)
    assert slopes_of(merge, -turn.turn_direction) == pytest.approx(
        slopes_of(merge, -turn.turn_direction * 9.81), abs=1e-12
    )
    assert shape_of(turn, 0.16) == pytest.approx((90, 0, 1))
    elbow = ot.load_scenario("elbow").route.passages[1]
    assert shape_of(elbow, 0.16) == pytest.approx((90, 0.16 / 0.24, 1))
    # Across a run that is wider than both branches: the bore grows by a third.
    cross = {"kind": "cross", "name": "c", "inner_diameter": 0.16, "branch_diameter": 0.12}
    across = Passage.of(ot.Network(fittings=[cross]).pipes, (0, "branch", "opposite"))
    assert shape_of(across, 0.12) == pytest.approx((0, -1 / 3, 1))


def test_a_passport_is_resumed_to_the_same_bytes(tmp_path):
    """A passport whose batches are lost in part is finished to the bytes of one that ran through;
    what is loaded estimates as what was made."""
    plan = ot.PassportPlan.of("presser", courses=["straight", "reducer_105"], trials=2)
    made = plan.passport(ot.run_trials(plan, out=tmp_path / "a").table)
    whole = (tmp_path / "a" / PASSPORT_FILE).read_bytes()
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    (tmp_path / "b" / PASSPORT_FILE).unlink()
    (tmp_path / "b" / "trials.parquet").unlink()
    next((tmp_path / "b" / "parts").glob("*.parquet")).unlink()
    ot.run_trials(plan, out=tmp_path / "b")
    assert (tmp_path / "b" / PASSPORT_FILE).read_bytes() == whole
    loaded = ot.load_passport(tmp_path / "a")
    assert loaded.summary() == made.summary()
    straight = loaded.kinds["straight"]
    assert straight.costs[straight.passed == 1, 0].mean() == pytest.approx(1 / 0.085, rel=0.1)
    with pytest.raises(ot.InputError, match="is no passport"):
        ot.load_passport(tmp_path / "b" / "trials.parquet")


@pytest.fixture(scope="module")
def whole():
    """The table of a shipped passport."""
    return pq.read_table(ot.shipped_files("passports")["omnitrack"])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seconds", "text"),
        ("joules", [1.0]),
        ("slip", np.inf),
        ("friction", np.nan),
        ("outcome", None),
        ("passed", None),
        ("kind", [1.0]),
    ],
)
def test_a_table_with_odd_columns_is_no_passport(tmp_path, whole, name, value):
    """Texts, lists, nothing, what is infinite, and features that are not a number."""
    column = pa.array([value] * whole.num_rows)
    pq.write_table(whole.set_column(whole.column_names.index(name), name, column), tmp_path / "odd")
    with pytest.raises(ot.InputError, match="is no passport"):
        ot.load_passport(tmp_path / "odd")


@pytest.mark.parametrize(
    "about", ["[]", "1", '{"format": 2, "changes": [], "misfits": {}}', '{"format": 2}', "["]
)
def test_what_says_nothing_of_the_robot_is_no_passport(tmp_path, whole, about):
    """The words beside the table are no table, or lack one."""
    pq.write_table(whole.replace_schema_metadata({"passport": about}), tmp_path / "odd")
    with pytest.raises(ot.InputError, match="is no passport"):
        ot.load_passport(tmp_path / "odd")
