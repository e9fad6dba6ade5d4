"""Laws of episodes: rewards against the record of the same run, and how an episode ends."""

import gymnasium
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.gym import TERMS

SEED = 11


def driven(env, action):
    """Sums of the rewards' terms of one episode, its steps, and how it ended."""
    env.reset(seed=SEED)
    sums, steps, over = dict.fromkeys(TERMS, 0.0), 0, False
    while not over:
        _, reward, terminated, truncated, info = env.step(action)
        assert reward == pytest.approx(sum(info["terms"].values()))
        for name, value in info["terms"].items():
            sums[name] += value
        steps, over = steps + 1, terminated or truncated
    return sums, steps, (terminated, truncated), info


def test_terms_of_the_reward_are_those_of_the_recorded_run():
    """Way in bores, tilt over time, slip in bores and changes of torque over their limits, each
    added up over the control steps of the run that the same scenario makes, times its weight."""
    changes = {"record.period": 0.01, "run.time_limit": 2.0, "start.distance": 0.35}
    env = gymnasium.make("omnitrack_sim/Any-v0", scenario="robots/presser_tee", changes=changes)
    sums, steps, ended, info = driven(env, np.ones(6))
    run = ot.run(env.unwrapped.scenario, no_load=False)
    record, robot = run.trajectory, run.scenario.robot
    assert (ended, steps) == ((False, True), 40)
    assert info["time"] == pytest.approx(2.0)
    assert len(record.time) == 201
    touching = record["wall_force"][1:] > 0
    slip = (record["contact_speed"][1:] * touching).sum(axis=1) / touching.sum(axis=1).clip(1)
    torque = np.abs(np.diff(record["actuator_force"], axis=0)) / robot.torque_limit
    law = {
        "progress": np.ptp(record["distance"][[0, -1]]) / 0.16,
        "tilt": -0.2 * record["tilt"][1:].sum() * 0.01,
        "slip": -0.2 * slip.sum() * 0.01 / 0.16,
        "torque_change": -0.02 * torque.mean(axis=1).sum(),
        "arrival": 0.0,
        "failure": 0.0,
    }
    assert sums == pytest.approx(law, rel=1e-6)
    assert min(abs(sums[name]) for name in list(law)[:4]) > 1e-7, sums
