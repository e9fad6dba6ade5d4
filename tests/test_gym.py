"""Environments of Gymnasium: what Gymnasium asks of them, their options, trials and pictures."""

from __future__ import annotations

import copy
import gc
import os
import subprocess
import sys
import tracemalloc

import gymnasium
import numpy as np
import pytest
from environments import single, vector
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from screens import needs_screen, screen

import omnitrack_sim as ot
from omnitrack_sim.gym import IDS, TERMS
from omnitrack_sim.gym.env import EpisodeStage, _along_the_route
from omnitrack_sim.gym.episodes import EpisodeSampler, with_values
from omnitrack_sim.gym.options import options_of
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions

BRIEF = {"changes": {"run.time_limit": 0.3}}


@pytest.mark.parametrize("id", IDS)
def test_gymnasium_finds_nothing_wrong(id):
    """Its checker has neither errors nor warnings, which are errors here."""
    check_env(gymnasium.make(id).unwrapped, skip_render_check=True)


@pytest.mark.parametrize("id", IDS)
def test_a_vector_is_what_gymnasium_expects(id):
    """Spaces, shapes, types and the masks of ``info``; the same from the same seed, and from no
    seed the next trials of the same numbers; what is returned is not written into again."""
    n = 3
    env = gymnasium.make_vec(id, num_envs=n)
    assert isinstance(env.metadata["autoreset_mode"], AutoresetMode)
    assert env.spec.vector_entry_point.endswith("RobotVectorEnv")
    first, _ = env.reset(seed=5)
    second, _ = env.reset()
    again, _ = env.reset(seed=5)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, second)
    assert first in env.observation_space
    env.action_space.seed(1)
    kept = copy.deepcopy(again)
    for _ in range(3):
        seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
        assert seen in env.observation_space
        assert (reward.dtype, terminated.dtype, truncated.dtype) == (float, bool, bool)
        assert reward.shape == terminated.shape == truncated.shape == (n,)
        assert info["_terms"].tolist() == [True] * n
        assert set(info["terms"]) == {key for term in TERMS for key in _both(term)}
        summed = sum(info["terms"][term] for term in TERMS)
        assert np.allclose(reward, summed)
    assert np.array_equal(again, kept)
    env.close()


def _both(name):
    return name, f"_{name}"


@pytest.mark.parametrize("name", ["TeeTurn", "Network"])
def test_gymnasiums_own_vectors_see_the_same(name):
    """``SyncVectorEnv`` of single environments and the vector of one batch agree."""
    ours = vector(2, name, **BRIEF)
    theirs = gymnasium.make_vec(
        f"omnitrack_sim/{name}-v0", num_envs=2, vectorization_mode="sync", **BRIEF
    )
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"]
    rows = [env.reset(seed=2)[0] for env in (ours, theirs)]
    assert np.array_equal(*rows)
    ours.action_space.seed(3)
    for _ in range(14):
        action = ours.action_space.sample()
        a, b = ours.step(action), theirs.step(action)
        for one, other in zip(a[:4], b[:4], strict=True):
            assert np.array_equal(one, other)
        assert _plain(a[4]) == _plain(b[4])


def _plain(info):
    """What ``info`` says of robots of which it says anything."""
    if isinstance(info, dict):
        found = {}
        for key, value in info.items():
            if not key.startswith("_"):
                mask = info.get(f"_{key}", np.ones(2, bool))
                found[key] = _plain(value) if isinstance(value, dict) else value[mask].tolist()
        return found
    return info


def test_entries_are_found_by_name():
    """In single and vector environments, where the names of entries say."""
    features = ["tilt", "way_ahead", "to_fitting"]
    given = {"observation": features, "sensing": "truth"}
    for env in (single(**given).unwrapped, vector(2, **given).unwrapped):
        assert env.entries == {
            "tilt": slice(0, 1),
            "way_ahead": slice(1, 10),
            "to_fitting": slice(10, 11),
        }


def test_trials_are_drawn_from_their_ranges():
    """Friction, preload, orientation and speed between their bounds, gravity in all directions; a
    value instead of a range stays, and so does what is not drawn at all."""
    options = options_of({"ranges": {"robot.preload": 22.0, "start.theta5_deg": None}})
    rng = np.random.default_rng(1)
    drawn = [EpisodeSampler(options).draw(rng) for _ in range(40)]
    friction = np.array([s.world.friction for s in drawn])
    low, high = Decisions.ranges["world.friction"]
    assert friction.min() >= low
    assert friction.max() <= high
    assert np.ptp(friction) > 0.8 * (high - low)
    gravity = np.array([s.world.gravity for s in drawn])
    assert np.linalg.norm(gravity, axis=1) == pytest.approx(9.81)
    assert np.abs(gravity.mean(axis=0)).max() < 4.0
    assert {s.robot.preload for s in drawn} == {22.0}
    assert {s.start.theta5_deg for s in drawn} == {0.0}
    assert len({s.seed for s in drawn}) == 40


def test_a_trial_is_what_override_makes():
    """Values that were checked before are put in without checks, to the same scenario."""
    base = ot.load_scenario("tee_turn")
    values = {"world.friction": 0.7, "robot.preload": 21.0, "world.gravity": (1.0, 2.0, 3.0)}
    values |= {"seed": 5, "start.theta5_deg": 12.0}
    made, expected = with_values(base, values), ot.override(base, values)
    assert made == expected
    assert made.hash == expected.hash
    assert made.time_limit_s == expected.time_limit_s


def test_networks_are_others_in_each_episode():
    """And robots of a vector have networks of their own."""
    env = vector(2, "Network", sensing="truth")
    env.reset(seed=1)
    names = [scenario.name for scenario in env.unwrapped.scenarios]
    env.reset()
    names += [scenario.name for scenario in env.unwrapped.scenarios]
    assert len(set(names)) == 4


def test_the_picture_is_an_observation_of_its_own():
    """Beside the entries, between 0 and 1, near walls small."""
    env = single(picture=True)
    seen, _ = env.reset(seed=1)
    assert seen in env.observation_space
    picture = seen["picture"]
    assert picture.ndim == 2
    middle = picture.shape[0] // 2
    assert picture[middle, middle] > picture[0, middle]
    for _ in range(4):
        later, *_ = env.step(np.array([0.5, 0.5, 0.5, 0.0]))
    assert not np.array_equal(later["picture"], picture)


def test_residual_actions_of_nothing_are_the_feedback_controllers_own():
    """A robot whose learner asks for nothing drives as in a run, through the tee: to a step or two,
    as its commands end at the speed limit."""
    fixed = {"start.theta5_deg": 40.0, "control.cruise_speed": 0.12}
    env = single(acting="residual", sensing="truth", ranges=fixed)
    env.reset(seed=4)
    expected = ot.run(env.unwrapped.scenario)
    over = False
    while not over:
        *_, terminated, truncated, info = env.step(np.zeros(4))
        over = terminated or truncated
    assert info["outcome"] == expected.outcome.value
    assert info["time"] == pytest.approx(expected.duration_s, abs=0.02)


@pytest.mark.long
def test_memory_does_not_grow():
    """Over many episodes."""
    env = vector(8, observation="truth", changes={"run.time_limit": 0.2})
    env.reset(seed=1)
    action = np.full((8, 4), 0.3, np.float32)

    def drive(steps):
        for _ in range(steps):
            env.step(action)

    drive(20)
    tracemalloc.start()
    drive(20)
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    drive(60)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 60_000  # bytes; the record of 60 decisions of 8 robots takes a million


def test_pictures_of_one_and_of_many(monkeypatch):
    """``rgb_array``: the robot moves in the picture; another one is elsewhere."""
    monkeypatch.setenv("MUJOCO_GL", "egl")
    env = vector(2, render_mode="rgb_array", width=160, height=90, sensing="truth")
    env.reset(seed=1)
    try:
        first = env.render()
    except ot.RenderError as error:
        pytest.skip(str(error))
    assert [frame.shape for frame in first] == [(90, 160, 3)] * 2
    for _ in range(20):
        env.step(np.array([[0.6, 0.6, 0.6, 0.0], [0.0, 0.0, 0.0, 0.0]]))
    moved, still = (
        (np.abs(a.astype(int) - b) > 30).any(axis=2).sum()
        for a, b in zip(first, env.render(), strict=True)
    )
    assert moved > 200
    assert moved > 3 * still
    env.close()


@pytest.mark.long
@needs_screen
def test_a_window_shows_the_robot():
    """``human``: it opens, shows and closes."""
    code = """if True:
        import gymnasium, numpy as np, omnitrack_sim.gym
        options = {"render_mode": "human", "sensing": "truth"}
        env = gymnasium.make("omnitrack_sim/TeeTurn-v0", **options)
        env.reset(seed=1)
        for _ in range(4):
            env.step(np.full(4, 0.4))
        print(env.unwrapped._screen._window.is_open)
        env.close()
    """
    with screen() as display:
        environment = {**os.environ, "DISPLAY": display, "LIBGL_ALWAYS_SOFTWARE": "1"}
        environment.pop("MUJOCO_GL", None)
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True
        )
    assert done.stdout.split() == ["True"], done.stderr


def test_without_gymnasium_the_import_says_what_to_install():
    """And for what."""
    code = "import sys; sys.modules['gymnasium'] = None; import omnitrack_sim.gym"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "needs Gymnasium: pip install 'omnitrack_sim[gym]'" in done.stderr


def test_the_camera_goes_along_with_the_robot():
    """In a straight pipe a robot 6 cm further on gives nearly the same picture from the side."""
    scenario = ot.load_scenario("straight")
    stage = EpisodeStage(_along_the_route(scenario), (160, 96), "side")
    qpos = ot.Simulation([scenario]).plant.qpos[0].copy()
    pictures = []
    for distance in (0.2, 0.26):
        qpos[:3] = scenario.route.centreline.at(np.array([distance]))[0][0]
        pictures.append(stage.frame(qpos, np.zeros(3)).astype(float))
    stage.__exit__()
    assert 0.5 < np.abs(pictures[1] - pictures[0]).mean() < 8.0
