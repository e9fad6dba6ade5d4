"""What environments of Gymnasium refuse, and what they say then."""

from __future__ import annotations

import math
import re

import gymnasium
import numpy as np
import pytest
from environments import single, vector

import omnitrack_sim as ot
from omnitrack_sim.gym import RobotVectorEnv
from omnitrack_sim.robots.feature import DECISION_PERIOD


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"frction": 1}, "frction: unknown key"),
        ({"scenario": "tee_trun"}, "tee_turn"),
        ({"observation": "onbaord"}, "did you mean 'onboard'"),
        ({"observation": ["onboard", "tilt"]}, "more than once"),
        ({"sensing": "true"}, "choose from: onboard, truth"),
        ({"ranges": {"world.fricton": 0.5}}, "did you mean 'world.friction'"),
        ({"ranges": {"world.friction": (0.9, 0.5)}}, "the least value stands first"),
        ({"ranges": {"world.friction": (0.5, 50.0)}}, "world.friction"),
        ({"ranges": {"world.friction": float("nan")}}, "ranges.world.friction"),
        ({"reward": {"progres": 1.0}}, "did you mean 'progress'"),
        ({"changes": {"world.frction": 1.0}}, "did you mean 'friction'"),
        ({"changes": {"physics.control_period": 0.02}}, "physics.control_period"),
        ({"observation": "truth", "changes": {"physics.control_period": 0.02}}, "decision period"),
        ({"acting": "residuel"}, "did you mean 'residual'"),
        (
            {"ranges": {"world.friction": "high"}},
            "ranges.world.friction: is 'high'; it must be",
        ),
        ({"ranges": {"world.friction": (0.5, "x")}}, "is (0.5, 'x'); it must be a range"),
        ({"observation": ["onboard", 5]}, "observation: is ['onboard', 5]; it must be a name"),
        (
            {"sensing": "truth", "changes": {"sensing.kind": "onboard"}},
            "sensing: is 'truth' (left out, it follows from the observation), and the changes",
        ),
        ({"changes": {"sensing": {"kind": "truth"}}}, "the changes make sensing.kind 'truth'"),
        ({"picture": True, "sensing": "truth"}, "picture"),
        ({"observation": "truth", "sensing": "onboard"}, "truth"),
        ({"width": 1}, "width"),
        ({"render_mode": "rgb"}, "rgb_array, human"),
        ({"gravity": "none"}, "choose from: any, scenario"),
        ({"scenario": "missions/explore_house"}, "explores"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode.*")
def test_bad_options_are_refused(given, told):
    """The error names the option and what would be right."""
    with pytest.raises(ot.InputError) as caught:
        single(**given)
    assert told in str(caught.value)
    assert len(caught.value.faults) == 1


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"num_envs": 0}, "num_envs: is 0"),
        ({"num_envs": 65537}, "num_envs: is 65537; a number from 1 to 65536"),
        ({"autoreset_mode": "SameSteps"}, "NextStep, SameStep, Disabled"),
        ({"render_mode": "human"}, "for one robot alone"),
    ],
)
def test_bad_options_of_a_vector_are_refused(given, told):
    """Likewise."""
    with pytest.raises(ot.InputError) as caught:
        RobotVectorEnv(**given)
    assert told in str(caught.value)


def test_actions_that_are_no_numbers_are_refused():
    """Nothing has moved; what is beyond the space is cut off."""
    env = single(sensing="truth")
    env.reset(seed=1)
    for action in ([math.nan] * 4, [0.0, math.nan, 0.0, 0.0], [0.0, 0.0, 0.0, -math.inf]):
        with pytest.raises(ValueError, match="action"):
            env.step(np.array(action))
    *_, info = env.unwrapped.step(np.full(4, 5.0))
    assert info["time"] == pytest.approx(DECISION_PERIOD)


def test_actions_of_another_shape_are_refused():
    """Of one robot and of many, with the shape that was given."""
    env, envs = single(sensing="truth").unwrapped, vector(3, sensing="truth").unwrapped
    env.reset(seed=1)
    envs.reset(seed=1)
    with pytest.raises(ValueError, match=re.escape("has shape (3,), expected (4,)")):
        env.step(np.zeros(3))
    for shape in ((2, 4), (4,), (1, 4)):
        with pytest.raises(ValueError, match=re.escape(f"has shape {shape}, expected (3, 4)")):
            envs.step(np.zeros(shape))


def test_options_of_a_reset_that_there_are_not_are_refused():
    """Nothing begins."""
    env, envs = single(sensing="truth"), vector(2, sensing="truth")
    with pytest.raises(ot.InputError, match=r"options\.mask: .* reset of one robot has no options"):
        env.reset(options={"mask": np.array([True])})
    with pytest.raises(ot.InputError, match=r"options\.mask: .* \(choose from: reset_mask\)"):
        envs.reset(options={"mask": np.array([True, False])})
    with pytest.raises(gymnasium.error.ResetNeeded):
        _ = envs.unwrapped.scenarios
