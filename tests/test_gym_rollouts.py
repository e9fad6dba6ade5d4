"""Environments of Gymnasium: the same bytes single, in a vector and in a run; episodes that follow
each other."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from environments import single, vector
from gymnasium.vector import AutoresetMode

import omnitrack_sim as ot
from omnitrack_sim.gym import TERMS
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import features_of
from omnitrack_sim.robots.omnitrack.policy.file import DIRECT, RESIDUAL, Mlp

BRIEF = {"changes": {"run.time_limit": 0.6}}
SHORT = {"changes": {"run.time_limit": 0.4}}
SEED = 7


def drive_ahead(n, steps, seed=3):
    """Actions (steps, n, 4) that drive ahead, unevenly, and roll a little."""
    rng = np.random.default_rng(seed)
    actions = rng.uniform(0.2, 0.6, (steps, n, 4))
    actions[..., 3] -= 0.4
    return actions.astype(np.float32)


def told_by(env, actions, seed):
    """Observations, rewards and flags of one robot over all its ``actions`` (steps, 4), from
    ``reset`` on; a new episode begins at once where one is over."""
    seen = [env.reset(seed=seed)[0]]
    told = []
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        seen.append(observation)
        told.append((reward, terminated, truncated))
        if terminated or truncated:
            seen.append(env.reset()[0])
    return seen, told


@pytest.mark.parametrize("name", ["TeeTurn", "Network"])
@pytest.mark.parametrize("observation", ["onboard", "truth"])
def test_robots_of_a_vector_see_what_single_ones_see(name, observation):
    """Bit for bit, over several episodes of different lengths that follow in the same step."""
    options = {"observation": observation, "changes": {"run.time_limit": 0.4}}
    n, steps = 2, 20
    actions = drive_ahead(n, steps)
    many = vector(n, name, autoreset_mode=AutoresetMode.SAME_STEP, **options)
    seen, _ = many.reset(seed=SEED)
    rows = [[seen[robot]] for robot in range(n)]
    flags = [[] for _ in range(n)]
    for action in actions:
        seen, reward, terminated, truncated, info = many.step(action)
        for robot in range(n):
            if terminated[robot] or truncated[robot]:
                rows[robot].append(info["final_obs"][robot])
            rows[robot].append(seen[robot])
            flags[robot].append((reward[robot], terminated[robot], truncated[robot]))
    assert all(sum(truncated for *_, truncated in told) == 2 for told in flags)
    for robot in range(n):
        alone, told = told_by(single(name, **options), actions[:, robot], SEED + robot)
        assert [row.tobytes() for row in alone] == [row.tobytes() for row in rows[robot]]
        assert told == flags[robot]


class Replayed:
    """A controller that decides what an environment was told, and keeps what it sees."""

    actions: np.ndarray
    seen: list

    def __init__(self, setup):
        self.decisions = Decisions(setup, features_of("onboard"), DIRECT)
        self.left = iter(self.actions)

    def step(self, observation):
        if self.decisions.due.any():
            self.seen.append(self.decisions.observe(observation)[0])
            self.decisions.decide(next(self.left)[None])
        return self.decisions.command(observation)


@pytest.mark.parametrize("sensing", ["onboard", "truth"])
def test_a_run_sees_what_the_environment_sees(sensing):
    """A robot in ``ot.run`` whose controller decides the same, and that draws the same noise, sees
    the same bytes and ends the same way at the same time."""
    actions = drive_ahead(1, 12)[:, 0]
    kind = ot.override(ot.load_scenario("tee_turn"), {}).driven_by(Replayed).control.kind
    changes = {"run.time_limit": 0.6, "control.kind": kind, "control.parameters": {}}
    Replayed.actions, Replayed.seen = actions, []
    env = single(sensing=sensing, changes=changes)
    seen, told = told_by(env, actions, SEED)
    env.reset(seed=SEED)
    scenario = env.unwrapped.scenario
    Replayed.seen = []
    (result,) = ot.run_batch([scenario], no_load=False)
    assert [row.tobytes() for row in Replayed.seen] == [row.tobytes() for row in seen[:12]]
    assert result.outcome is ot.Outcome.TIMED_OUT
    assert told[-1][1:] == (False, True)


@pytest.mark.parametrize("acting", [DIRECT, RESIDUAL], ids=["direct", "residual"])
def test_a_policy_drives_in_a_run_as_in_a_vector(tmp_path, acting):
    """The controller ``policy`` takes the robot of a vector's trial along the same way, bit for
    bit: what was trained here drives there."""
    draw = np.random.default_rng(0)
    shapes = ((32, 8), (8, 4))
    network = Mlp(
        [draw.normal(0, 0.3, shape) for shape in shapes],
        [np.zeros(8), np.array([0.4, 0.4, 0.4, 0.0])],
        mean=np.zeros(32),
        std=np.ones(32),
        activation="tanh",
        output="clip",
    )
    policy = ot.Policy(network, ["onboard"], acting=acting, note="drawn")
    policy.save(tmp_path / "drawn.npz")
    changes = {
        "run.time_limit": 1.0,
        "control.kind": "policy",
        "control.parameters": {"policy": str(tmp_path / "drawn.npz")},
    }
    env = vector(3, acting=acting.name, changes=changes)
    seen, _ = env.reset(seed=SEED)
    scenario = env.unwrapped.scenarios[1]
    ways = []
    for _ in range(20):
        seen, _, _, truncated, info = env.step(policy(seen))
        ways.append(info["distance"][1])
    assert truncated[1]
    (result,) = ot.run_batch([scenario], no_load=False)
    recorded = result.trajectory["distance"][5::5]  # every 0.1 s, of a sample every 0.02 s
    assert recorded.tolist() == ways[1::2]
    assert np.ptp(recorded) > 0.01


def test_the_next_step_begins_the_next_episode():
    """At the end of an episode the last observation is its own; the step after it ignores the
    action, brings the first of the next episode and no reward, and the one after that counts."""
    n, actions = 2, drive_ahead(2, 12)
    env = vector(n, **SHORT)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    env.reset(seed=SEED)
    for action in actions[:8]:
        last, reward, terminated, truncated, info = env.step(action)
    assert truncated.all()
    assert not terminated.any()
    assert reward.all()
    assert info["outcome"].tolist() == ["timed_out"] * n
    first, reward, terminated, truncated, info = env.step(np.full((n, 4), np.nan))
    for values in (reward, terminated, truncated):
        assert not values.any()
    assert "outcome" not in info
    assert info["time"].tolist() == [0.0, 0.0]
    alone = single(**SHORT)
    alone.reset(seed=SEED)
    assert not np.array_equal(first[0], last[0])
    assert np.array_equal(first[0], alone.reset()[0])
    _, reward, *_, info = env.step(actions[8])
    assert reward.all()
    assert info["time"] == pytest.approx([0.05, 0.05])


def test_the_same_step_keeps_the_last_observation_aside():
    """``final_obs`` and ``final_info`` are those of the episode that is over."""
    env, alone = vector(2, autoreset_mode=AutoresetMode.SAME_STEP, **SHORT), single(**SHORT)
    actions = drive_ahead(2, 8)
    env.reset(seed=SEED)
    alone.reset(seed=SEED)
    for action in actions:
        seen, _, _, truncated, info = env.step(action)
        last, *_, final = alone.step(action[0])
    assert truncated.all()
    assert info["_final_obs"].all()
    assert np.array_equal(info["final_obs"][0], last)
    assert np.array_equal(seen[0], alone.reset()[0])
    assert info["final_info"]["time"][0] == final["time"] == pytest.approx(0.4)
    assert info["final_info"]["outcome"][0] == final["outcome"] == "timed_out"
    assert info["final_info"]["terms"]["progress"][0] == final["terms"]["progress"]
    assert info["time"].tolist() == [0.0, 0.0]


def test_without_autoreset_a_mask_begins_episodes():
    """Those of the mask begin anew, the others go on; an episode that is over is not stepped."""
    env = vector(3, autoreset_mode=AutoresetMode.DISABLED, **BRIEF)
    env.reset(seed=SEED)
    actions = drive_ahead(3, 16)
    for action in actions[:4]:
        before, *_ = env.step(action)
    mask = np.array([False, True, False])
    seen, info = env.reset(options={"reset_mask": mask})
    assert np.array_equal(seen[[0, 2]], before[[0, 2]])
    assert info["time"].tolist() == pytest.approx([0.2, 0.0, 0.2])
    for action in actions[4:12]:
        _, _, _, truncated, _ = env.step(action)
    assert truncated.tolist() == [True, False, True]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(actions[12])
    env.reset(options={"reset_mask": truncated})
    env.step(actions[13])


def test_a_terminated_episode_says_how_it_ended():
    """A robot that stands still hangs: terminated, not truncated, with its failure in the
    reward."""
    env = single("Straight", sensing="truth")
    env.reset(seed=SEED)
    for _ in range(200):
        _, reward, terminated, truncated, info = env.step(np.zeros(4))
        if terminated or truncated:
            break
    assert (terminated, truncated) == (True, False)
    assert info["outcome"] == "stuck"
    assert info["is_success"] is False
    assert info["terms"]["failure"] == TERMS["failure"].weight
    assert reward == pytest.approx(sum(info["terms"].values()))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(4))


def test_a_robot_that_arrives_is_told_so():
    """In a straight pipe, driving ahead is enough."""
    env = single("Straight", sensing="truth", ranges={"control.cruise_speed": 0.1})
    env.reset(seed=SEED)
    progress, terminated = 0.0, False
    while not terminated:
        _, _, terminated, truncated, info = env.step(np.array([0.9, 0.9, 0.9, 0.0]))
        progress += info["terms"]["progress"]
        assert not truncated
    assert info["is_success"] is True
    assert info["terms"]["arrival"] == TERMS["arrival"].weight
    scenario = env.unwrapped.scenario
    way = scenario.goal_distance - scenario.start.distance
    assert progress == pytest.approx(way / 0.16, rel=0.02)


@pytest.mark.parametrize("observation", ["onboard", "truth"])
def test_what_has_diverged_ends_without_a_number_that_is_none(observation):
    """Observation, reward, terms and info are finite, and the outcome says what happened."""
    env = vector(3, observation=observation, **BRIEF)
    env.reset(seed=SEED)
    env._episodes.batches[0].simulation.plant._batch.bind("qvel")[1, 0] = 1e15
    seen, reward, terminated, _, info = env.step(drive_ahead(3, 1)[0])
    assert terminated.tolist() == [False, True, False]
    assert info["outcome"][1] == "diverged"
    assert reward[1] == TERMS["failure"].weight
    for _ in range(3):
        for values in (seen, reward, info["distance"], info["time"], *info["terms"].values()):
            assert np.isfinite(np.asarray(values, float)).all()
        seen, reward, terminated, _, info = env.step(drive_ahead(3, 1)[0])
    assert not terminated.any()
