"""What learned controllers observe, and what comes of their decisions."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from runs import there_and_back

import omnitrack_sim as ot
from omnitrack_sim.robots.feature import DECISION_PERIOD, Feature, bounds, steps_of_decision
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import ACTIONS, FEATURE_SETS, features_of
from omnitrack_sim.robots.omnitrack.policy.file import DIRECT, RESIDUAL

Decide = Callable[[np.ndarray], np.ndarray]


def _driven(names: str, decide: Decide, acting=DIRECT):
    """A class of controllers that decide by a function; it keeps what was observed."""

    class Deciding:
        seen: ClassVar[list[np.ndarray]] = []

        def __init__(self, setup: ot.ControlSetup) -> None:
            self.decisions = Decisions(setup, features_of(names), acting)
            self.phases = self.decisions.phases

        def step(self, observation: ot.Observation) -> ot.Command:
            if self.decisions.due.any():
                entries = self.decisions.observe(observation)
                self.seen.append(entries)
                self.decisions.decide(decide(entries))
            return self.decisions.command(observation)

    return Deciding


def _run(scenario: ot.Scenario, controller: type) -> ot.Result:
    (result,) = ot.run_batch([scenario], controller=controller, no_load=False)
    return result


def _constant(*action: float) -> Decide:
    return lambda entries: np.tile(np.float32(action), (len(entries), 1))


def _tee(**changes) -> ot.Scenario:
    base = {"run.time_limit": 1.0}
    return ot.override(ot.load_scenario("tee_turn"), base | changes)


@pytest.mark.parametrize("name", [*FEATURE_SETS])
def test_every_entry_is_named_and_within_its_bounds(name):
    """In a run through a tee and one that is turned over in the open."""
    controller = _driven(name, _constant(-0.5, 0.7, 0.7, 0.3))
    scenarios = [_tee(), _tee(**{"start.theta5_deg": 170.0, "start.distance": 0.35})]
    ot.run_batch(scenarios, controller=controller, no_load=False)
    features = FEATURE_SETS[name]
    low, high = bounds(features)
    entries = np.concatenate(controller.seen)
    assert entries.dtype == np.float32
    assert (
        entries.shape[1] == len(low) == len({name for one in features for name in one.entry_names})
    )
    assert ((entries >= low) & (entries <= high)).all()
    assert np.abs(low).max() <= 1
    assert high.max() == 1
    assert (np.ptp(entries, axis=0) > 0).sum() > 0.7 * len(low)


def test_a_decision_is_wall_speeds_and_a_roll_rate_for_50_ms():
    controller = _driven("onboard", _constant(0.5, 0.5, 0.5, 1.0))
    scenario = _tee(**{"run.time_limit": 0.5, "control.speed_limit": 0.16})
    result = _run(scenario, controller)
    trajectory = result.trajectory
    assert trajectory["belt_speed_command"][-1] == pytest.approx([0.08] * 3)
    rate = np.diff(trajectory["roll_command"][:, 0])[2:] / np.diff(trajectory.time)[2:]
    assert rate == pytest.approx(scenario.robot.roll_rate)
    assert len(controller.seen) == pytest.approx(0.5 / 0.05, abs=1)
    controller.seen.clear()
    slower = {"physics.timestep": 0.00125, "physics.control_period": 0.0125, "record.period": 0.025}
    _run(ot.override(scenario, slower), controller)
    assert len(controller.seen) == pytest.approx(0.5 / 0.05, abs=1)


def test_belts_turn_round_beyond_the_no_motion_line():
    """The modules roll by half a turn; the robot drives on."""
    controller = _driven("onboard", _constant(0.5, 0.5, 0.5, 1.0))
    scenario = ot.override(
        ot.load_scenario("straight"),
        {"run.time_limit": 2.4, "world.friction": 1.0},
    )
    trajectory = _run(scenario, controller).trajectory
    assert trajectory["roll"][-1].min() > np.pi * 0.9
    assert (trajectory["belt_speed_command"][-1] < 0).all()
    assert trajectory["distance"][-1] > 0.25


def test_observations_are_the_same_bytes_alone_and_together():
    scenarios = [_tee(**{"start.theta5_deg": float(t), "start.distance": 0.3}) for t in (0, 20, 50)]
    together = _driven("truth", _constant(0.3, 0.6, 0.6, -0.4))
    ot.run_batch(scenarios, controller=together, no_load=False)
    rows = np.stack(together.seen)[:, 1]
    alone = _driven("truth", _constant(0.3, 0.6, 0.6, -0.4))
    ot.run_batch(scenarios[1:2], controller=alone, no_load=False)
    assert np.stack(alone.seen)[:, 0].tobytes() == rows[: len(alone.seen)].tobytes()


def test_without_a_residue_the_base_drives():
    """To the same bytes, through a roll before the tee."""
    scenario = _tee(**{"start.theta5_deg": 50.0, "start.distance": 0.25, "run.time_limit": 3.0})
    still = _driven("preview", _constant(0, 0, 0, 0), RESIDUAL)
    ours, base = _run(scenario, still), ot.run(scenario)
    assert ours.trajectory.qpos.tobytes() == base.trajectory.qpos.tobytes()
    assert ours.trajectory.phases == base.trajectory.phases
    assert [str(event) for event in ours.events] == [str(event) for event in base.events]


@pytest.mark.parametrize(("action", "driven"), [(0.25, 0.15), (1.0, 0.2)])
def test_a_residue_is_added_and_rests_with_its_base(action, driven):
    """The sum stays within the speed limit, 0.2 m/s; the base cruises at 0.1 m/s."""
    scenario = _tee(**{"start.theta5_deg": 50.0, "start.distance": 0.25, "run.time_limit": 2.0})
    trajectory = _run(scenario, _driven("preview", _constant(0, action, 0, 1), RESIDUAL)).trajectory
    speed, phase = trajectory["belt_speed_command"], trajectory["phase"]
    aligning = np.flatnonzero(phase == trajectory.phases.index("align"))
    cruising = np.flatnonzero(phase == trajectory.phases.index("cruise"))[1:5]
    assert speed[cruising, 1] == pytest.approx(driven, abs=1e-3)
    assert speed[cruising, 0] == pytest.approx(0.1, abs=1e-3)
    assert len(aligning) > 10
    assert (speed[aligning] == 0).all()


def test_what_is_held_is_mirrored_where_a_robot_turns_back():
    """It goes on physically as it did until the next decision."""
    scenario = there_and_back()
    sim = ot.Simulation([scenario], controller=_driven("onboard", _constant(0.6, 0.7, 0.8, 0.0)))
    decisions = sim.controller.decisions
    before = after = None
    while sim.active.any() and after is None:
        gear = sim.observation.gear[0]
        sim.step()
        if sim.observation.gear[0] != gear:
            before = decisions.action[0].copy()
            decisions.observe(sim.observation)
            after = decisions.action[0].copy()
    assert before == pytest.approx([0.6, 0.7, 0.8, 0.0])
    assert after == pytest.approx([-0.6, -0.8, -0.7, 0.0])


@pytest.mark.parametrize("acting", [DIRECT, RESIDUAL])
def test_robots_that_begin_anew_know_nothing_of_before(acting):
    sim = ot.Simulation(
        [_tee(), _tee()], controller=_driven("onboard", _constant(1, 1, 1, 1), acting)
    )
    decisions = sim.controller.decisions
    for _ in range(7):
        sim.step()
    assert (decisions.action == 1).all()
    decisions.reset(np.array([0]), decisions.setup)
    assert decisions.due.tolist() == [True, False]
    assert (decisions.action[0] == 0).all()
    assert (decisions.action[1] == 1).all()
    assert decisions.roll[0].tolist() == decisions.setup.command.roll[0].tolist()
    sim.step()
    assert decisions.roll[1, 0] > decisions.roll[0, 0]


def test_robots_that_begin_at_different_times_are_commanded_as_alone():
    """By the base, to the same bytes."""
    # Five: tables of three modules, or of as many passages, have other sizes.
    changes = ({}, {"start.theta5_deg": 40.0}, {"robot.preload": 30.0}, {}, {})
    scenarios = [_tee(**{"start.distance": 0.265}, **change) for change in changes]
    sim = ot.Simulation(scenarios, recording=False)
    decisions = Decisions(sim.setup, features_of("onboard"), RESIDUAL)
    told = []
    for moment in range(60):
        if moment in (5, 12):
            begun = np.array([moment % 3])
            sim.reset(begun, [scenarios[moment % 3]])
            decisions.reset(begun, sim.setup)
        command = decisions.command(sim.observation)
        told.append(command.belt_speed.copy())
        sim.step(command)
    for robot, begin in ((1, 0), (2, 5)):
        alone = ot.Simulation([scenarios[robot]], recording=False)
        own = Decisions(alone.setup, features_of("onboard"), RESIDUAL)
        for together in told[begin:]:
            command = own.command(alone.observation)
            assert together[robot].tolist() == command.belt_speed[0].tolist()
            alone.step(command)
        assert np.ptp([speed[robot, 0] for speed in told]) > 1e-3  # it stands to align


def test_only_a_robot_that_is_sent_on_in_the_other_gear_is_mirrored():
    """Modules and actions change sides, backward as before is forward; the other stays."""
    sim = ot.Simulation([_tee(), _tee()], recording=False)
    decisions, rng = Decisions(sim.setup, features_of("onboard"), DIRECT), np.random.default_rng(1)
    decisions.action, decisions.roll = rng.uniform(-1, 1, (2, 4)), rng.uniform(-1, 1, (2, 3))
    action, roll = decisions.action.copy(), decisions.roll.copy()
    decisions._legs = SimpleNamespace(changes=lambda _: [(0, True)])
    decisions._follow_legs(sim.observation)
    swapped = [0, 2, 1]
    assert decisions.roll[0].tolist() == (-roll[0, swapped]).tolist()
    assert decisions.action[0].tolist() == (-action[0, [*swapped, 3]]).tolist()
    assert decisions.roll[1].tolist() == roll[1].tolist()
    assert decisions.action[1].tolist() == action[1].tolist()


def test_bad_actions_are_refused():
    sim = ot.Simulation([_tee()], controller=_driven("onboard", _constant(0, 0, 0, 0)))
    decisions = sim.controller.decisions
    with pytest.raises(ValueError, match=r"shape \(4,\), expected \(1, 4\)"):
        decisions.decide(np.zeros(len(ACTIONS)))
    with pytest.raises(ValueError, match="not a number"):
        decisions.decide(np.full((1, 4), np.nan))
    decisions.decide([[3.0, -3.0, 0.5, 0.0]])
    assert decisions.action.tolist() == [[1.0, -1.0, 0.5, 0.0]]


def test_control_periods_that_miss_the_decisions_are_refused():
    controller = _driven("onboard", _constant(0, 0, 0, 0))
    with pytest.raises(ot.InputError, match=r"physics.control_period: is 0.02 s"):
        _run(_tee(**{"physics.control_period": 0.02}), controller)


SPEED_TWICE = Feature("twice", "1", -1, 1, "of nothing", lambda v: np.full(v.setup.n, np.nan))


def test_features_have_names_of_users_too():
    (own, time) = features_of([f"{__name__}:SPEED_TWICE", "tilt"])
    assert (own, time.name) == (SPEED_TWICE, "tilt")
    controller = _driven(f"{__name__}:SPEED_TWICE", _constant(0, 0, 0, 0))
    _run(_tee(**{"run.time_limit": 0.1}), controller)
    assert np.concatenate(controller.seen).tolist() == [[0.0]] * len(controller.seen)
    with pytest.raises(ot.InputError, match=r"'onbord'.*did you mean 'onboard'"):
        features_of("onbord")
    with pytest.raises(ot.InputError, match="tilt more than once"):
        features_of(["onboard", "tilt"])


def test_what_is_not_observed_is_told():
    """Onboard robots have no sensor of forces."""
    controller = _driven("truth", _constant(0, 0, 0, 0))
    with pytest.raises(ot.InputError, match="'normal_force' is not there for these robots"):
        _run(_tee(**{"sensing.kind": "onboard"}), controller)
    controller = _driven("preview", _constant(0.5, 0.5, 0.5, 0))
    scenario = _tee(**{"sensing.kind": "onboard", "run.time_limit": 0.3})
    _run(scenario, controller)
    assert len(controller.seen) > 4


@pytest.mark.parametrize("steps", range(1, 26))
def test_a_decision_takes_a_whole_number_of_control_periods(steps):
    """A period that is the quotient of both takes so many steps; one 1 % longer is refused."""
    assert steps_of_decision(DECISION_PERIOD / steps) == steps
    with pytest.raises(ot.InputError, match="no whole number makes a decision period"):
        steps_of_decision(1.01 * DECISION_PERIOD / steps)
