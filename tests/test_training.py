"""The training of policies: what it exports, and from where it goes on."""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks" / "learning"))

import checkpoint
import train
import variants
from adapter import Robots
from export import NEARNESS, difference, network_of
from variants import VARIANTS, Trials

import omnitrack_sim as ot

FEW = [Trials(2, (0.8, 0.9)), Trials(1, (0.5, 0.6), downward=True)]


def _variant(residual: bool):
    return replace(VARIANTS["tee_turn", residual], trials=FEW, validation=FEW[:1])


def _given(out: Path, minutes: float = 1e-9, seed: int = 3):
    parser = train.arguments()
    return parser.parse_args(
        ["tee_turn", "--out", str(out), "--minutes", str(minutes), "--seed", str(seed)]
    )


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    """Episodes of half a second, and batches that fit."""
    monkeypatch.setattr(variants, "TIME_LIMIT", 0.5)
    monkeypatch.setitem(train.SETTINGS, "batch_size", 3 * train.ROLLOUT)
    monkeypatch.setattr(sys, "argv", ["train.py", "tee_turn"])


@pytest.mark.parametrize("residual", [False, True])
def test_a_policy_decides_as_the_trainers_network(tmp_path, residual):
    """To 1e-6, after an update, for what robots observe and for what is far from it."""
    training = train.Training(_variant(residual), _given(tmp_path))
    training.run()
    policy = ot.load_policy(tmp_path / "policy.npz")
    assert policy.acting.name == ("residual" if residual else "direct")
    assert f"seed 3, {3 * train.ROLLOUT} decisions" in policy.note
    far = np.random.default_rng(1).uniform(-1, 1, (100, policy.network.inputs))
    for entries in (training.validation.seen, far.astype(np.float32)):
        assert difference(policy, training.model, training.normalise, entries) < NEARNESS
    assert np.abs(policy(far)).max() > 1e-3
    assert (tmp_path / "curves.png").stat().st_size > 1000
    header, *rows = (tmp_path / "curves.csv").read_text().splitlines()
    assert len(rows) == 1
    assert "validation_success" in header.split(",")


def test_a_training_goes_on_from_its_checkpoint(tmp_path):
    """With the same weights, optimiser, normalisation, time and curve; another seed is refused."""
    first = train.Training(_variant(False), _given(tmp_path))
    first.run()
    again = train.Training(_variant(False), _given(tmp_path))
    assert again.model.num_timesteps == first.model.num_timesteps > 0
    assert (again.spent, again.rows, again.best) == (first.spent, first.rows, first.best)
    mine, theirs = (network_of(t.model, t.normalise) for t in (first, again))
    for a, b in zip([*mine.weights, mine.mean], [*theirs.weights, theirs.mean], strict=True):
        np.testing.assert_array_equal(a, b)
    moments = [t.model.policy.optimizer.state_dict()["state"] for t in (first, again)]
    assert moments[0].keys() == moments[1].keys()
    assert all((moments[0][i]["exp_avg"] == moments[1][i]["exp_avg"]).all() for i in moments[0])
    with pytest.raises(SystemExit, match="is of another training"):
        train.Training(_variant(False), _given(tmp_path, seed=4))


def test_a_checkpoint_is_read_without_running_it(tmp_path):
    """Only tensors and plain values are read."""
    training = train.Training(_variant(False), _given(tmp_path))
    (tmp_path / "bad.pt").write_bytes(pickle.dumps(Path, protocol=2))
    with pytest.raises(pickle.UnpicklingError):
        checkpoint.load(tmp_path / "bad.pt", training.model, training.normalise)


def test_ends_of_episodes_reach_the_trainer():
    """Each robot's last observation, whether time alone ended it, and its return."""
    robots = Robots(_variant(False).batches())
    robots.seed(5)
    seen = robots.reset()
    assert seen.shape[0] == 3
    returns = np.zeros(3)
    for step in range(1, 11):
        seen, rewards, over, infos = robots.step(np.full((3, 4), 0.25, np.float32))
        returns += rewards
        assert over.all() == (step == 10)
    assert all(info["TimeLimit.truncated"] for info in infos)
    assert all(not np.array_equal(infos[i]["terminal_observation"], seen[i]) for i in range(3))
    assert [length for _, length, _ in robots.ended] == [10, 10, 10]
    assert [value for value, _, _ in robots.ended] == pytest.approx(returns, abs=1e-5)
