"""The training on a device, in its quick form on Warp's CPU back end."""

import sys

import numpy as np
import pytest

pytest.importorskip("warp")
pytest.importorskip("mujoco_warp")

import warp as wp
import warp_training

import omnitrack_sim as ot

pytestmark = pytest.mark.device
wp.config.quiet = True


@pytest.mark.long
def test_a_policy_is_trained_and_judged(tmp_path, monkeypatch, capsys):
    """A file of it, curves, and a table of what drives the same turns on the processor."""
    command = ["warp_training.py", "--quick", "--workers", "1", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", command)
    warp_training.main()
    policy = ot.load_policy(tmp_path / "policy.npz")
    assert "motor pololu_1000_hpcb, 8 decisions, seed 1" in policy.note
    entries = np.zeros((1, policy.network.inputs))
    assert policy(entries)[0] == pytest.approx([0.5, 0.5, 0.5, 0.0], abs=0.2)
    assert len((tmp_path / "curves.csv").read_text().splitlines()) == 2
    assert (tmp_path / "curves.png").stat().st_size > 1000
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" | ")[0] for line in lines if line.startswith("| ")] == [
        "| driven by",
        "| default controller",
        "| policy `tee_turn`",
        "| trained on the device",
    ]


@pytest.mark.long
def test_rollouts_are_what_the_environment_told():
    """Rewards over their spread, and the ends of episodes: those whose time is over go on in worth,
    those that have arrived do not."""
    env = ot.warp.WarpVectorEnv(
        "straight",
        num_envs=2,
        autoreset_mode="SameStep",
        starts=2,
        observation=warp_training.OBSERVATION,
        changes={"run.goal_distance": 0.13, "run.time_limit": 0.5},
        ranges={"control.cruise_speed": 0.1},
    )
    training = warp_training.Training(env, 10, 1, warp_training.Settings(log_std=-20.0))
    training.ppo.actor.parts[-2][:] = 0.0
    training.ppo.actor.parts[-1][:] = [1.0, 1.0, 1.0, 0.0]
    told = training._drive()
    assert all(passed for *_, passed in told)
    rollout = training._rollout
    assert (rollout.ended.sum(axis=0) > 0).all()
    assert (rollout.reward[rollout.ended] > 0).all()
    assert not rollout.value_after.any()
    training.ppo.actor.parts[-1][:] = 0.0
    told = training._drive()
    assert not any(passed for *_, passed in told)
    late = rollout.ended
    assert late.any(axis=0).all()
    assert (rollout.value_after[late] != 0.0).all()
    assert not rollout.value_after[~late].any()
