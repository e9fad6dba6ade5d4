"""The loop by hand: the same bytes as a run, clear errors, and robots whose run is over."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from runs import rolling_tee, same_record, same_result, there_and_back
from shares import Shares, timed

import omnitrack_sim as ot
from omnitrack_sim.record.events import GoalReached
from omnitrack_sim.robots.omnitrack.events import Rolled


def straight(**changes: object) -> ot.Scenario:
    """Three tenths of a second in a straight pipe."""
    limit = {"run.time_limit": 0.3}
    return ot.override(ot.load_scenario("straight"), limit | changes)


def by_hand(simulation: ot.Simulation) -> list[ot.Result]:
    """Step a simulation to its end under its controller."""
    while simulation.active.any():
        simulation.step(simulation.controller.step(simulation.observation))
    return simulation.results()


@pytest.fixture(scope="module")
def runs() -> dict[str, ot.Result]:
    """What ``run`` gives of a tee turn and of a mission."""
    return {"tee": ot.run(rolling_tee()), "mission": ot.run(there_and_back())}


@pytest.mark.parametrize("others", [0, 3], ids=["alone", "among_4"])
@pytest.mark.parametrize(("name", "make"), [("tee", rolling_tee), ("mission", there_and_back)])
def test_steps_by_hand_give_the_bytes_of_a_run(
    runs: dict[str, ot.Result], name: str, make: Callable[..., ot.Scenario], others: int
) -> None:
    """A robot stepped by hand ends with the record, events, legs and figures of ``run``."""
    angles = np.linspace(-40.0, 40.0, others).tolist()
    neighbours = [make(**{"start.theta5_deg": a, "world.friction": 0.8}) for a in angles]
    at = others // 2
    results = by_hand(ot.Simulation([*neighbours[:at], make(), *neighbours[at:]]))
    assert same_result(results[at], runs[name])


def test_what_is_stepped_by_hand_decides_and_turns_round(runs: dict[str, ot.Result]) -> None:
    """The runs that are compared above roll their modules, reach a goal and change gear."""
    assert any(isinstance(event, Rolled) for event in runs["tee"].events)
    assert any(isinstance(event, GoalReached) for event in runs["mission"].events)
    assert [leg.gear for leg in runs["mission"].legs] == [1, -1]
    assert runs["mission"].success, runs["mission"].reason


def test_a_step_without_a_command_asks_the_controller() -> None:
    """``step()`` and the controller's own command are the same."""
    silent, told = ot.Simulation([straight()]), ot.Simulation([straight()])
    while silent.active.any():
        silent.step()
    assert same_result(silent.results()[0], by_hand(told)[0])


@pytest.mark.parametrize(
    ("name", "shape", "wanted"),
    [
        ("belt_speed", (3,), "(2, 3)"),
        ("roll", (1, 3), "(2, 3)"),
        ("phase", (3,), "(2,)"),
        ("resting", (2, 3), "(2,)"),
    ],
)
def test_a_command_of_a_wrong_shape_is_refused(name: str, shape: tuple, wanted: str) -> None:
    """The error has the field's name, its shape and the shape that it should have, and nothing has
    moved."""
    simulation = ot.Simulation([straight()] * 2)
    fields = {"belt_speed": np.zeros((2, 3))} | {name: np.zeros(shape)}
    with pytest.raises(ValueError, match="command") as caught:
        simulation.step(ot.Command(**fields))
    assert str(caught.value) == f"command.{name} has shape {shape}, expected {wanted}"
    assert simulation.time.tolist() == [0.0, 0.0]


def test_lists_are_commands_too() -> None:
    """A command of plain lists is carried out as one of arrays is."""
    listed, arrays = ot.Simulation([straight()]), ot.Simulation([straight()])
    for _ in range(5):
        listed.step(ot.Command([[0.1, 0.1, 0.1]]))  # type: ignore[arg-type]
        arrays.step(ot.Command(np.full((1, 3), 0.1)))
    assert listed.plant.qpos.tobytes() == arrays.plant.qpos.tobytes()


def test_what_a_command_leaves_out_stays() -> None:
    """Without a roll the modules keep the one that they were asked last."""
    simulation = ot.Simulation([straight()])
    speed = np.full((1, 3), 0.1)
    simulation.step(ot.Command(speed, roll=np.full((1, 3), 0.2)))
    while simulation.active.any():
        simulation.step(ot.Command(speed))
    (result,) = simulation.results()
    assert (result.trajectory["roll_command"][1:] == 0.2).all()
    assert result.trajectory["roll"][-1] == pytest.approx([0.2] * 3, abs=0.05)


def test_arrays_of_a_command_may_be_written_into_again() -> None:
    """A controller that keeps one array and changes it step by step has every value recorded."""
    simulation, speed, told = ot.Simulation([straight()]), np.zeros((1, 3)), []
    while simulation.active.any():
        speed += 0.001
        simulation.step(ot.Command(speed))
        told.append(speed[0].copy())
    recorded = simulation.results()[0].trajectory["belt_speed_command"]
    every = round(simulation.scenarios[0].record.period / simulation.period)
    assert np.array_equal(recorded[1:], np.array(told)[every - 1 :: every])


def test_results_wait_for_all_runs_to_be_over() -> None:
    """While a robot runs there are no results; the error says how many do."""
    simulation = ot.Simulation([straight(), straight(**{"run.time_limit": 0.1})])
    with pytest.raises(RuntimeError, match="2 of 2 robots still run"):
        simulation.results()
    while simulation.active.all():
        simulation.step()
    assert simulation.active.tolist() == [True, False]
    with pytest.raises(RuntimeError, match="1 of 2 robots still run"):
        simulation.results()
    simulation.advance()
    assert [r.duration_s for r in simulation.results()] == pytest.approx([0.3, 0.1])


def test_a_robot_whose_run_is_over_stays_as_it_is() -> None:
    """It keeps its pose, its last command, its ending, its events and its record, whatever is
    commanded while the other one goes on."""
    brief = straight(**{"run.time_limit": 0.1})
    simulation = ot.Simulation([brief, straight()])
    speed = np.full((2, 3), 0.1)
    while simulation.active.all():
        simulation.step(ot.Command(speed))
    pose, ending = simulation.plant.qpos[0].copy(), simulation.endings[0]
    assert ending is not None
    assert ending.outcome is ot.Outcome.TIMED_OUT
    while simulation.active.any():
        late = [ot.Remark(robot, 0.2, "still here") for robot in (0, 1)]
        moved = {"roll": np.ones((2, 3)), "phase": np.ones(2, int), "events": late}
        simulation.step(ot.Command(-speed, **moved))
    assert simulation.plant.qpos[0].tobytes() == pose.tobytes()
    assert simulation.endings[0] is ending
    assert [len(result.events) > 0 for result in simulation.results()] == [False, True]
    every_sample, _ = simulation.recorder.trajectories(np.full(2, np.inf))
    assert every_sample.time.max() == pytest.approx(0.1)
    assert len(every_sample) > len(simulation.results()[0].trajectory.time)
    assert (every_sample["belt_speed_command"][1:] == 0.1).all()
    assert (every_sample["roll_command"] == 0.0).all()
    assert (every_sample["phase"] == 0).all()
    alone = ot.Simulation([brief])
    while alone.active.any():
        alone.step(ot.Command(speed[:1]))
    assert same_record(alone.results()[0], simulation.results()[0])


def test_robots_stop_wherever_their_chains_are() -> None:
    """Chains are set back by a pitch now and then; one whose robot has stopped stays as it was,
    whatever the step at which it stopped."""
    limits = [0.01 * step for step in range(8, 18)]
    scenarios = [straight(**{"run.time_limit": limit}) for limit in (*limits, 0.3)]
    simulation = ot.Simulation(scenarios)
    poses: dict[int, bytes] = {}
    while simulation.active.any():
        simulation.step()
        over = np.flatnonzero(~simulation.active).tolist()
        poses = {robot: simulation.plant.qpos[robot].tobytes() for robot in over} | poses
    assert {robot: simulation.plant.qpos[robot].tobytes() for robot in poses} == poses
    for scenario, result in zip(scenarios, simulation.results(), strict=True):
        alone = ot.Simulation([scenario])
        alone.advance()
        assert same_record(alone.results()[0], result)


def test_shares_of_time_add_up_over_several_calls() -> None:
    """Two stretches of a run, timed into one place, took as long together as the clock says."""
    simulation, shares, ticks = ot.Simulation([straight()]), Shares(), iter(range(10**9))
    first = timed(simulation, 5, clock=lambda: float(next(ticks)), into=shares)
    assert first is shares
    assert shares.physics == 5.0  # of a clock that goes on by 1 s at each look
    whole = shares.physics + shares.control + shares.recording
    timed(simulation, clock=lambda: float(next(ticks)), into=shares)
    assert shares.physics == pytest.approx(0.3 / simulation.period)
    both = shares.physics + shares.control + shares.recording
    assert both == next(ticks) - 2.0  # the moments between the two calls, and before the first
    assert 0.0 < whole < both


class HalfWay(ot.Pilot):
    """Drives half of what the scenario's own pilot would."""

    def __init__(self, scenario: ot.Scenario, robot: int) -> None:
        self._own = scenario.pilot(robot)
        leg = self._own.leg
        self.leg = dataclasses.replace(leg, end=(leg.begin + leg.end) / 2)

    def route(self):
        return self._own.route()


class Blurred(ot.Truth):
    """Takes itself to be 5 mm farther on than it is."""

    def locate(self, truth) -> None:
        self.location = dataclasses.replace(truth, distance=truth.distance + 0.005)


def test_own_pilots_and_senses_drive_a_run() -> None:
    """The pilot's leg is driven to its end; a robot that takes itself to be farther on arrives
    earlier."""
    base = ot.override(ot.load_scenario("straight"), {"run.goal_distance": 0.4})
    half, early = (
        ot.run(base, no_load=False, **more) for more in ({"pilot": HalfWay}, {"senses": Blurred})
    )
    begin = base.start.distance
    assert half.outcome is ot.Outcome.REACHED_GOAL
    assert half.trajectory["distance"][-1] == pytest.approx((begin + 0.4) / 2, abs=0.002)
    assert early.outcome is ot.Outcome.REACHED_GOAL
    assert early.trajectory["distance"][-1] == pytest.approx(0.395, abs=0.002)


def test_looks_of_senses_without_error_tell_the_truth_for_sure() -> None:
    """What is ahead and behind, how far it is from where the robot is, and no doubt of it."""
    simulation = ot.Simulation([ot.load_scenario("tee_turn")])
    simulation.step()
    look, place = simulation.senses.look(0, True), simulation.location.distance[0]
    assert (look.time, look.distance, look.std) == (simulation.time[0], place, 0.0)
    assert look.ahead is not None
    assert look.behind is not None
    assert (look.ahead.kind[0], look.ahead.enter) == ("tee", "run_start")
    assert place + look.ahead.distance == pytest.approx(0.3)
    assert (look.behind.end, look.behind.distance) == ("open", pytest.approx(place))
    for seen in (look.ahead, look.behind):
        assert (seen.distance_std, seen.turn_std, seen.confidence) == (0.0, 0.0, 1.0)
    assert simulation.senses.look(0, False).behind is None


def test_rotary_motors_of_each_robot_give_as_much_both_ways() -> None:
    """As its scenario says, whatever the others of the batch have."""
    base = ot.load_scenario("straight")
    torques = (0.02, 0.05)
    simulation = ot.Simulation([ot.override(base, {"robot.roll_torque": t}) for t in torques])
    simulation.step()
    given = simulation.plant._force_range[:, simulation.readings.at.roll_motors]
    for own, torque in zip(given, torques, strict=True):
        assert own == pytest.approx(np.tile([-torque, torque], (3, 1)))


def test_the_engine_s_own_objects_are_within_reach() -> None:
    """Model and data of a simulation are MuJoCo's, and those of the scenario's own model."""
    scenario = ot.load_scenario("straight")
    simulation = ot.Simulation([scenario] * 2)
    simulation.step()
    assert simulation.model.ngeom == scenario.to_spec().compile().ngeom
    data = simulation.data(1)
    assert data.qpos.tobytes() == simulation.plant.qpos[1].tobytes()
    assert data.time == simulation.time[1]
