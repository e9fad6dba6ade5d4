"""Laws of episodes: rewards against the record of the same run, and how an episode ends."""

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.gym import TERMS, env
from omnitrack_sim.gym.options import options_of
from omnitrack_sim.show.viewer import window

SEED = 11


def driven(made, action):
    """Sums of the rewards' terms of one episode, its steps, and how it ended."""
    made.reset(seed=SEED)
    sums, steps, over = dict.fromkeys(TERMS, 0.0), 0, False
    while not over:
        _, reward, terminated, truncated, info = made.step(action)
        assert reward == pytest.approx(sum(info["terms"].values()))
        for name, value in info["terms"].items():
            sums[name] += value
        steps, over = steps + 1, terminated or truncated
    return sums, steps, (terminated, truncated), info


def test_terms_of_the_reward_are_those_of_the_recorded_run():
    """Way in bores, tilt over time, slip in bores and changes of torque over their limits, each
    added up over the control steps of the run that the same scenario makes, times its weight."""
    changes = {"record.period": 0.01, "run.time_limit": 2.0, "start.distance": 0.35}
    made = gymnasium.make("omnitrack_sim/Any-v0", scenario="robots/presser_tee", changes=changes)
    sums, steps, ended, info = driven(made, np.ones(6))
    run = ot.run(made.unwrapped.scenario, no_load=False)
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


@pytest.mark.parametrize("values", [(-0.5, 0.9), (0.6, 9.0), -0.5])
def test_both_ends_of_a_range_have_to_be_possible(values):
    """A friction below nothing or beyond five is refused before the first episode."""
    with pytest.raises(ot.InputError, match="friction"):
        gymnasium.make("omnitrack_sim/TeeTurn-v0", ranges={"world.friction": values})


def test_a_window_shows_the_robot_as_fast_as_it_drives_and_nothing_that_has_diverged(monkeypatch):
    """Two decisions of 0.05 s shown at once leave a pause of 0.05 s between them; a pose that is no
    number is left out."""
    scenario, shown, pauses, clock = ot.load_scenario("robots/presser_tee"), [], [], [7.0]
    fake = SimpleNamespace(model=None, show=lambda qpos, _: shown.append(qpos.copy()))
    fake.__enter__ = fake.__exit__ = lambda *_: fake
    monkeypatch.setattr(window, "Window", lambda _: fake)
    monkeypatch.setattr(window, "require_screen", lambda: None)
    monkeypatch.setattr(env.time, "sleep", pauses.append)
    monkeypatch.setattr(env.time, "monotonic", lambda: clock[0])
    poses = np.zeros((2, 7))
    plant = SimpleNamespace(qpos=poses)
    simulation = SimpleNamespace(scenarios=[scenario] * 2, plant=plant, period=0.01)
    batch = SimpleNamespace(
        simulation=simulation, decisions=SimpleNamespace(hold=5), travel=np.zeros((2, 0))
    )
    screen = env.EpisodeScreen(options_of({"scenario": "robots/presser_tee"}))
    for pose in (1.0, np.nan, 2.0):
        poses[1] = pose
        screen.show(batch, 1)
    assert [row.tolist() for row in shown] == [[1.0] * 7, [2.0] * 7]
    assert pauses == pytest.approx([0.0, 0.05])
