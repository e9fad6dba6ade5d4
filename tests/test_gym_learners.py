"""Learners of others take the environments as they come."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

import omnitrack_sim as ot
import omnitrack_sim.gym as environments

pytestmark = pytest.mark.long

BRIEF = {"observation": "truth", "changes": {"run.time_limit": 0.4}}
ID = "omnitrack_sim/TeeTurn-v0"


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_statistics_of_episodes_are_recorded(mode):
    """``RecordEpisodeStatistics``: lengths and returns are those of the episodes."""
    n = 3
    envs = gymnasium.make_vec(ID, num_envs=n, autoreset_mode=mode, **BRIEF)
    envs = RecordEpisodeStatistics(envs)
    envs.reset(seed=1)
    returns = np.zeros(n)
    for step in range(1, 9):
        _, reward, _, truncated, infos = envs.step(np.full((n, 4), 0.3))
        returns += reward
        assert ("episode" in infos) == (step == 8)
    assert truncated.all()
    assert infos["episode"]["l"].tolist() == [8] * n
    assert infos["episode"]["r"] == pytest.approx(returns)


def test_a_loop_in_the_style_of_cleanrl_learns_from_true_transitions():
    """Rollouts are gathered over episodes' ends; a step that only begins an episode is masked, and
    the value of a truncated one is that of its own last observation. The parameters of a linear
    policy move."""
    n, steps = 4, 24
    envs = gymnasium.make_vec(ID, num_envs=n, vectorization_mode="vector_entry_point", **BRIEF)
    envs = NormalizeObservation(RecordEpisodeStatistics(envs))
    size = envs.single_observation_space.shape[0]
    rng, weights = np.random.default_rng(1), np.zeros((4, size))
    before, _ = envs.reset(seed=1)
    begun, counted, gradient = np.zeros(n, bool), 0, np.zeros_like(weights)
    for _ in range(steps):
        noise = rng.normal(scale=0.3, size=(n, 4))
        action = np.clip(before @ weights.T + noise, -1, 1).astype(np.float32)
        after, reward, terminated, truncated, _ = envs.step(action)
        assert not reward[begun].any()
        gradient += np.einsum("n,na,nk->ak", reward * ~begun, noise, before)
        counted += int(np.count_nonzero(~begun))
        begun, before = terminated | truncated, after
    weights += 1e-2 * gradient
    assert counted == n * (steps - 2)  # two episodes of eight steps have ended, and one step each
    assert np.isfinite(weights).all()
    assert weights.any()


def test_videos_are_recorded(tmp_path, monkeypatch):
    """``RecordVideo`` gets a picture a step."""
    pytest.importorskip("moviepy")
    monkeypatch.setenv("MUJOCO_GL", "egl")
    env = gymnasium.make(ID, render_mode="rgb_array", width=160, height=96, **BRIEF)
    env = RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda _: True)
    try:
        env.reset(seed=1)
    except ot.RenderError as error:
        pytest.skip(str(error))
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step(np.full(4, 0.3))
        over = terminated or truncated
    env.close()
    assert len(list(tmp_path.glob("videos/*.mp4"))) == 1


@pytest.mark.parametrize("kind", ["PPO", "SAC"])
def test_stable_baselines_learns(kind):
    """Its checker passes, and it learns for some steps."""
    sb3 = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_checker import check_env

    check_env(environments.RobotEnv(**BRIEF))
    few = {"PPO": {"n_steps": 16, "batch_size": 16}, "SAC": {"learning_starts": 8}}[kind]
    learner = getattr(sb3, kind)("MlpPolicy", gymnasium.make(ID, **BRIEF), seed=1, **few)
    learner.learn(32)
    action, _ = learner.predict(learner.env.reset())
    assert action.shape == (1, 4)
