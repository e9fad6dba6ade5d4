"""The learner of benchmarks/learning/ppo.py, in NumPy."""

import numpy as np
import pytest
from learning.ppo import Ppo, Rollout, Scale, Settings, log_probability

SMALL = Settings(layers=(8, 8), epochs=6, batch=128, rate=0.01, log_std=-1.0, hold=1)
ENTRIES, ACTIONS = 5, 3


def learner(robots=4, settings=SMALL):
    """A learner of few numbers."""
    return Ppo(ENTRIES, ACTIONS, robots, [0.0] * ACTIONS, settings, seed=1)


def test_gradients_of_policy_and_spread_are_those_of_differences():
    """Of the clipped gain, by every weight and spread, in double precision; what the layers below
    do to the spread does not count."""
    ppo, rng = learner(), np.random.default_rng(2)
    ppo.actor.parts = [rng.normal(0.0, 0.5, part.shape) for part in ppo.actor.parts]
    ppo.log_std = rng.normal(-0.5, 0.3, ppo.log_std.shape)
    seen, gain = rng.normal(size=(40, ENTRIES)), rng.normal(size=40)
    action = ppo.actor(seen)[-1] + rng.normal(0.0, 0.8, (40, ACTIONS))

    hidden = ppo.actor(seen)[-2].copy()

    def now():
        return log_probability(action - ppo.actor(seen)[-1], ppo._variance(hidden))

    before = now() - rng.normal(0.0, 0.3, 40)

    def loss():
        ratio = np.exp(now() - before)
        return -np.minimum(ratio * gain, np.clip(ratio, 0.8, 1.2) * gain).mean()

    slopes, _ = ppo._slopes(seen, action, before, gain)
    for array, slope in zip([*ppo.actor.parts, ppo.log_std], slopes, strict=True):
        for place in np.ndindex(array.shape):
            kept = array[place]
            array[place] = kept + 1e-6
            above = loss()
            array[place] = kept - 1e-6
            below = loss()
            array[place] = kept
            assert slope[place] == pytest.approx((above - below) / 2e-6, rel=1e-4, abs=1e-6)


def test_gradients_of_worth_are_those_of_differences():
    """Of the squared error, by every weight."""
    ppo, rng = learner(), np.random.default_rng(3)
    ppo.critic.parts = [rng.normal(0.0, 0.5, part.shape) for part in ppo.critic.parts]
    seen, worth = rng.normal(size=(20, ENTRIES)), rng.normal(size=20)

    def loss():
        return 0.5 * ((ppo.value(seen) - worth) ** 2).mean()

    outputs = ppo.critic(seen)
    error = (outputs[-1][:, 0] - worth)[:, None] / 20
    for array, slope in zip(ppo.critic.parts, ppo.critic.gradients(outputs, error), strict=True):
        for place in np.ndindex(array.shape):
            array[place] += 1e-6
            above = loss()
            array[place] -= 2e-6
            below = loss()
            array[place] += 1e-6
            assert slope[place] == pytest.approx((above - below) / 2e-6, rel=1e-4, abs=1e-7)


def test_advantages_are_discounted_rewards_less_worth():
    """With a trace of 1: up to the end of an episode, to what comes after one whose time was over,
    and to what is seen last."""
    rollout, rng = Rollout(6, 2, 1, 1), np.random.default_rng(4)
    rollout.reward[:], rollout.value[:] = rng.normal(size=(2, 6, 2))
    rollout.ended[2, 0] = rollout.ended[4, 1] = True
    rollout.value_after[4, 1] = 3.0
    found = rollout.advantages(np.array([1.0, 2.0], np.float32), 0.9, 1.0)
    r, v = rollout.reward, rollout.value
    assert found[0, 0] == pytest.approx(
        r[0, 0] + 0.9 * r[1, 0] + 0.81 * r[2, 0] - v[0, 0], abs=1e-5
    )
    assert found[4, 1] == pytest.approx(r[4, 1] + 0.9 * 3.0 - v[4, 1], abs=1e-5)
    assert found[5] == pytest.approx(r[5] + 0.9 * np.array([1.0, 2.0]) - v[5], abs=1e-5)


def test_scale_is_mean_and_variance_of_all_rows():
    """However they come."""
    rows, scale = np.random.default_rng(5).normal(2.0, 3.0, (100, 4)), Scale(4)
    for part in np.split(rows, [10, 11, 60]):
        scale.add(part)
    assert scale.mean == pytest.approx(rows.mean(axis=0), abs=1e-4)
    assert scale.variance == pytest.approx(rows.var(axis=0), rel=1e-4)


def test_a_policy_learns_to_do_what_is_rewarded():
    """Robots that are rewarded for actions near two of their entries come near them; the policy
    that a file holds decides the same."""
    ppo, rng = learner(64), np.random.default_rng(6)
    wanted = lambda seen: 0.3 * np.tanh(seen[:, :ACTIONS])  # noqa: E731
    first = None
    for _ in range(60):
        rollout = Rollout(8, 64, ENTRIES, ACTIONS)
        for t in range(8):
            seen = rollout.seen[t] = rng.normal(size=(64, ENTRIES))
            rollout.action[t], rollout.log_probability[t] = ppo.act(rollout.seen[t])
            rollout.value[t] = ppo.value(rollout.seen[t])
            rollout.reward[t] = -((rollout.action[t] - wanted(seen)) ** 2).sum(axis=1)
            rollout.ended[t] = True
        ppo.learn(rollout, rollout.seen[-1], 0.0)
        seen = rng.normal(size=(1000, ENTRIES)).astype(np.float32)
        error = np.abs(ppo.actor(seen)[-1] - wanted(seen)).mean()
        first = first or error
    assert error < 0.4 * first
    assert ppo.network()(seen) == pytest.approx(np.clip(ppo.actor(seen)[-1], -1, 1), abs=0.01)
