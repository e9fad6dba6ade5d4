"""Environments on a device, on Warp's CPU back end, against those of the processor."""

import math

import numpy as np
import pytest

pytest.importorskip("warp")
pytest.importorskip("mujoco_warp")
pytest.importorskip("gymnasium")

import gymnasium
import warp as wp
from gymnasium.vector import AutoresetMode

import omnitrack_sim as ot
import omnitrack_sim.warp
from omnitrack_sim.base.errors import InputError
from omnitrack_sim.gym.episodes import EpisodeSampler
from omnitrack_sim.gym.options import TERMS, EnvOptions, Tally
from omnitrack_sim.robots.omnitrack.control.alignment import held_belt_sign
from omnitrack_sim.robots.omnitrack.drive import SpeedLoop, drive_of
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import TRUTH
from omnitrack_sim.warp import starts
from omnitrack_sim.warp.episodes import course_of
from omnitrack_sim.warp.omnitrack import driving
from omnitrack_sim.warp.omnitrack import env as driving_env

pytestmark = pytest.mark.device
wp.config.quiet = True
SHORT = {"run.goal_distance": 0.13, "run.time_limit": 0.5}
"""Of a straight pipe: four decisions to the goal at full speed, ten to the end of the time."""


def made(scenario="straight", num_envs=2, **given):
    """An environment that draws few starts."""
    return ot.warp.WarpVectorEnv(scenario, num_envs=num_envs, **{"starts": 2} | given)


def copied(results):
    """Results of a step as arrays of NumPy, which the next step leaves alone."""
    *arrays, infos = results
    return [each.numpy().copy() for each in arrays], infos


def ahead(env, speed=1.0):
    """Actions that drive straight on."""
    return np.tile(np.array([speed, speed, speed, 0.0], np.float32), (env.num_envs, 1))


@pytest.mark.parametrize(
    ("given", "where"),
    [
        ({"acting": "residual"}, "acting"),
        ({"picture": True}, "picture"),
        ({"sensing": "onboard"}, "sensing"),
        ({"observation": "odd"}, "observation"),
        ({"autoreset_mode": "Disabled"}, "autoreset_mode"),
        ({"num_envs": 0}, "num_envs"),
        ({"networks": 0}, "networks"),
        ({"scenario": "random_network", "networks": 3}, "starts"),
        ({"scenario": "robots/presser_tee"}, "robot.kind"),
        ({"changes": {"robot.drive": "differential"}}, "robot.drive"),
        ({"changes": {"physics.collider": "primitives"}}, "physics.collider"),
        ({"scenario": "missions/fig14"}, "scenario"),
    ],
)
def test_what_there_is_not_on_a_device_is_refused(given, where):
    """The error names the option."""
    with pytest.raises(InputError, match=rf"(?m)^.*{where}"):
        made(**given)


@pytest.mark.long
@pytest.mark.parametrize(
    ("scenario", "distance"), [("tee_turn", 0.33), ("random_network", (0.5, 1.0))]
)
def test_decisions_are_seen_and_rewarded_as_on_the_processor(scenario, distance):
    """All entries and terms, of robots about to turn at a tee, or each in its own network, that
    count their modules from other ones, and have masses of their own; the processor's robots carry
    out the same actions."""
    near = {"start.distance": distance, "robot.chassis_mass": (0.2, 0.6)}
    given = {"starts": 3, "start_seed": 1, "networks": 3}
    env = made(scenario, 3, observation="truth", ranges=near, **given)
    observed, _ = env.reset(seed=3)
    simulation, start = env.starts.simulation, env.start.numpy().copy()
    decisions, rng = Decisions(simulation.setup, TRUTH), np.random.default_rng(4)
    expected = decisions.observe(simulation.observation)[start]
    assert np.abs(observed.numpy() - expected).max() < 1e-5
    assert len(np.unique(np.round(simulation.location.theta5 / 2.09))) > 1
    for _ in range(8):
        actions = rng.uniform(0.5, 0.9, (3, 4)).astype(np.float32)
        actions[:, 3] = rng.uniform(-0.5, 0.5, 3)
        (observed, reward, terminated, truncated), infos = copied(env.step(actions[start]))
        tally = Tally(simulation)
        decisions.decide(actions)
        for _ in range(decisions.hold):
            simulation.step(decisions.command(simulation.observation))
            tally.add(simulation)
        expected = decisions.observe(simulation.observation)[start]
        assert np.abs(observed - expected).max() < 5e-3
        assert not (terminated | truncated).any()
        weights = {name: term.weight for name, term in TERMS.items()}
        for name, terms in infos["terms"].items():
            wanted = weights[name] * tally.measured[name][start]
            assert terms.numpy() == pytest.approx(wanted, rel=0.02, abs=2e-5), name
        assert reward == pytest.approx(sum(t.numpy() for t in infos["terms"].values()), abs=1e-6)
        assert infos["time"].numpy() == pytest.approx(simulation.time[start], abs=1e-5)
    assert simulation.location.tilt.max() > 0.02
    assert len(simulation.legs.routes.routes) == (1 if scenario == "tee_turn" else 3)


def test_networks_that_stand_side_by_side_are_driven_as_alone():
    """Each robot's route is as long, and turns as often, as that of its mission alone; all lie in
    one assembly, which refuses pipes that overlap, and networks take turns."""
    sampler = EpisodeSampler(EnvOptions(scenario="random_network", fittings=(1, 3)))
    side_by_side = starts.SideBySide(sampler, 3, np.random.default_rng(4))
    rng, values = np.random.default_rng(4), np.random.default_rng(1)
    alone = [sampler.mission(int(rng.integers(starts.NETWORKS))).route for _ in range(3)]
    drawn = [side_by_side.draw(values).route for _ in range(4)]
    parts = sum(len(route.network.parts) for route in alone)
    assert all(len(route.network.parts) == parts for route in drawn)
    for route, own in zip(drawn, [*alone, alone[0]], strict=True):
        assert route.centreline.length == pytest.approx(own.centreline.length)
        kinds = [[one.network.parts[p.index].fitting for p in one.passages] for one in (route, own)]
        assert kinds[0] == kinds[1]
    assert len({route.passages[0].index for route in drawn}) == 3


@pytest.mark.parametrize("at_once", [2, 5])
def test_as_many_robots_are_seated_as_are_asked_for(at_once, monkeypatch):
    """However many at once: each where its episode begins, by its own draws."""
    near = {"start.distance": (0.15, 0.3)}
    sampler = EpisodeSampler(EnvOptions(scenario="straight", ranges=near))
    monkeypatch.setattr(starts, "SEATINGS", at_once)
    found = starts.starts_of(sampler, 5, 3, 1, 1, lambda _: {})
    rng = np.random.default_rng(3)
    drawn = [sampler.draw(rng).start.distance for _ in range(5)]
    place = found.arrays["qpos"][:, :3] + found.origins
    assert len(place) == len(found.arrays["state"]) == 5
    away = np.linalg.norm(place - place[0], axis=1)
    assert away == pytest.approx(np.abs(np.array(drawn) - drawn[0]), abs=2e-3)
    assert np.ptp(drawn) > 0.01


def test_commands_are_those_of_the_processor():
    """Of robots whose modules are rolled anyhow, two in three about the angle at which belts change
    their direction: speeds, roll, what motors are asked, and lugs that move back by whole pitches
    with the sprockets that they mesh with."""
    n, rng = 60, np.random.default_rng(5)
    simulation = ot.Simulation([ot.load_scenario("straight")], recording=False)
    setup, robot, course = simulation.setup, driving_env.robot_of(simulation), course_of(simulation)
    roll = rng.uniform(-math.pi, math.pi, (n, 3))
    roll[:40] = np.pi * rng.integers(-1, 1, (40, 3)) + np.pi / 2 + rng.uniform(-0.2, 0.2, (40, 3))
    before, action = rng.choice([-1.0, 1.0], (n, 3)), rng.uniform(-1.0, 1.0, (n, 4))
    limit, set_point = rng.uniform(0.05, 0.2, (n, 1)), rng.uniform(-4.0, 4.0, (n, 3))
    speed, torque = rng.uniform(-0.2, 0.2, (n, 3)), rng.uniform(-1.0, 1.0, (n, 3))
    loop = SpeedLoop(drive_of(setup.robot.drive), [setup.robot.motor] * n, robot.lug_radius)
    state = np.zeros((n, driving.STATE_SIZE), np.float32)
    for at, values in (
        (driving.ROLL, roll),
        (driving.FORWARD, before),
        (driving.ACTION, action),
        (driving.SPEED_LIMIT, limit),
        (driving.ROLL_SET, set_point),
        (driving.BELT_SPEED, speed),
        (driving.TORQUE, torque),
        (driving.MOTOR, loop.figures),
    ):
        state[:, at : at + values.shape[1]] = values
    model = simulation.model
    qpos = rng.uniform(-0.1, 0.1, (n, model.nq)).astype(np.float32)
    empty = [np.zeros((n, k), np.float32) for k in (3, 9)]
    given = [wp.array(each, dtype=float) for each in (state, *empty, qpos)]
    ctrl = wp.zeros((n, model.nu), dtype=float)
    forces = wp.zeros((n, model.nu), dtype=wp.vec2)
    wp.launch(driving.command, n, inputs=[robot, course, *given, ctrl, forces])
    _, wanted, _, moved = (each.numpy() for each in given)
    forward = held_belt_sign(roll, robot.band, before)
    assert (forward != np.sign(np.cos(roll))).any()
    assert wanted == pytest.approx(action[:, :3] * limit * forward, rel=1e-5)
    turned = action[:, 3:] * setup.robot.roll_rate * setup.period
    asked, least, most = loop.advance(wanted, speed, torque, setup.period)
    of_belts, of_rolls = list(robot.belt_motors), list(robot.roll_motors)
    assert ctrl.numpy()[:, of_rolls] == pytest.approx(set_point + turned, rel=1e-5)
    assert ctrl.numpy()[:, of_belts] == pytest.approx(asked, rel=1e-4, abs=1e-6)
    ranges = forces.numpy()[:, of_belts]
    assert ranges == pytest.approx(np.stack([least, most], axis=-1), rel=1e-4, abs=1e-3)
    belts, sprockets = (np.array(each).reshape(3, 2) for each in (robot.belts, robot.sprockets))
    back = (qpos - moved)[:, belts[:, 0], None]
    pitches = back / robot.lug_pitch
    assert pitches == pytest.approx(np.round(pitches), abs=1e-3)
    assert np.abs(moved[:, belts[:, 0]]).max() <= 0.501 * robot.lug_pitch
    expected = qpos.copy()
    expected[:, belts] -= back
    expected[:, sprockets] -= back / robot.lug_radius
    assert moved == pytest.approx(expected, abs=1e-5)


@pytest.mark.long
def test_a_robot_arrives_at_the_end_of_its_own_network():
    """In networks of one straight each, of other lengths, side by side."""
    near = {"start.distance": 0.3}
    env = made("random_network", 6, starts=3, networks=3, fittings=(1, 1), ranges=near)
    ends = env.starts.simulation.legs.end
    first, second = np.sort(ends)[:2]
    assert first < 0.35 < 0.4 < second
    env.reset(seed=1)
    start = env.start.numpy().copy()
    assert 0 < np.count_nonzero(start == np.argmin(ends)) < 6
    arrived = np.zeros(6, bool)
    for _ in range(10):
        (_, _, terminated, truncated), infos = copied(env.step(ahead(env)))
        for world in np.flatnonzero(terminated):
            assert env.outcomes[infos["outcome"].numpy()[world]] == "reached_goal"
        arrived |= terminated
    assert not truncated.any()
    assert (arrived == (start == np.argmin(ends))).all()


@pytest.mark.long
def test_a_world_that_begins_anew_is_a_fresh_one():
    """To the same bytes, in the midst of others, by a mask."""
    env = made("tee_turn", 3, starts=1)
    first = env.reset(seed=1)[0].numpy().copy()
    fresh = [copied(env.step(ahead(env)))[0] for _ in range(3)]
    again = env.reset(options={"reset_mask": np.array([False, True, False])})[0].numpy().copy()
    assert (again[1] == first[1]).all()
    assert (again[[0, 2]] == fresh[-1][0][[0, 2]]).all()
    for expected in fresh:
        found = copied(env.step(ahead(env)))[0]
        for one, other in zip(expected, found, strict=True):
            assert (one[1] == other[1]).all()


@pytest.mark.long
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_episodes_end_and_begin_as_gymnasium_has_it(mode):
    """A robot at its goal is terminated, one whose time is over truncated; then the next begins."""
    env = made(autoreset_mode=mode, changes=SHORT, ranges={"control.cruise_speed": 0.1})
    begun = env.reset(seed=1)[0].numpy().copy()
    assert env.observation_space.contains(begun)
    actions = ahead(env)
    actions[1] = 0.0
    k, terminated = 0, np.zeros(2, bool)
    while not terminated[0] and k < 10:
        k += 1
        (observed, reward, terminated, truncated), infos = copied(env.step(actions))
        assert env.observation_space.contains(observed)
        outcomes = [env.outcomes[each] for each in infos["outcome"].numpy()]
    assert 4 <= k < 10
    assert terminated.tolist() == [True, False]
    assert outcomes == ["reached_goal", ""]
    assert infos["terms"]["arrival"].numpy().tolist() == [2.5, 0.0]
    assert reward[0] > 2.5
    at_once = mode is AutoresetMode.SAME_STEP
    last = infos["final_obs"].numpy().copy() if at_once else observed
    tilt, action = env.entries["tilt"], env.entries["last_action"]
    assert (last[0, action] == 1.0).sum() == 3
    assert last[0, tilt] < 0.01
    if not at_once:
        (observed, reward, terminated, _), infos = copied(env.step(actions))
        assert not terminated[0]
        assert reward[0] == 0.0
        assert infos["outcome"].numpy()[0] == 0
        assert not any(term.numpy()[0] for term in infos["terms"].values())
        k += 1
    assert (observed[0, action] == 0.0).all()
    assert infos["time"].numpy()[0] == 0.0
    assert infos["time"].numpy()[1] == pytest.approx(0.05 * k)
    for _ in range(k, 10):
        (observed, reward, terminated, truncated), infos = copied(env.step(actions))
    assert truncated.tolist()[1]
    assert not terminated[1]
    assert env.outcomes[infos["outcome"].numpy()[1]] == "timed_out"


@pytest.mark.long
def test_robots_that_leave_hang_or_diverge_are_terminated():
    """Numbers stay finite, also where the physics is lost."""
    patience = {"monitor.patience_time": 0.08, "monitor.patience": 0.001}
    env = made(num_envs=4, starts=4, changes=patience)
    env.reset(seed=2)
    qpos = env.d.qpos.numpy()  # on the processor it is the array itself
    qpos[0, :3] += [0.3, 0.3, 0.3]
    env.d.qvel.numpy()[1, 8] = np.nan
    actions = ahead(env)
    actions[2] = 0.0
    ended = np.zeros(4, bool)
    outcomes = [""] * 4
    for _ in range(3):
        (observed, reward, terminated, truncated), infos = copied(env.step(actions))
        assert np.isfinite(observed).all()
        assert np.isfinite(reward).all()
        assert not truncated.any()
        for world in np.flatnonzero(terminated & ~ended):
            outcomes[world] = env.outcomes[infos["outcome"].numpy()[world]]
            assert infos["terms"]["failure"].numpy()[world] == -2.5
        ended |= terminated
    assert outcomes == ["left_pipe", "diverged", "stuck", ""]


@pytest.mark.long
def test_draws_of_a_world_follow_from_its_seed_alone():
    """World 1 of one seed begins as world 0 of the next; a step before a reset is refused."""
    env = made("straight", 8, starts=6)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(ahead(env))
    first = env.reset(seed=10)[0].numpy().copy()
    shifted = env.reset(seed=11)[0].numpy().copy()
    assert (first[1:] == shifted[:-1]).all()
    assert len(np.unique(first, axis=0)) > 2
    assert (env.reset(seed=10)[0].numpy() == first).all()
    assert (env.reset()[0].numpy() != first).any()
    with pytest.raises(ValueError, match="expected"):
        env.step(np.zeros((8, 3)))
    for options in ({"reset_mask": np.ones(3, bool)}, {"odd": 1}):
        with pytest.raises(InputError, match="options"):
            env.reset(options=options)
    results = env.step(wp.array(ahead(env), dtype=float))
    assert all(isinstance(each, wp.array) for each in results[:4])
