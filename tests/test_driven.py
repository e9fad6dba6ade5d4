"""Robots that obey a driver's orders, and what is kept of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from runs import rolling_tee, same_result, there_and_back
from test_robots import Ball

import omnitrack_sim as ot
from omnitrack_sim.base.bounds import MAX_ORDERS
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.robots.driving import DriverTable, ObeysOrders, Order
from omnitrack_sim.robots.omnitrack.control.driven import DrivenController
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.scenario.loading import to_drive, with_orders

Plan = Sequence[tuple[Callable[[ot.Simulation], bool], dict[str, Any]]]


def driven(scenario: Scenario, plan: Plan) -> ot.Result:
    """A run to whose driver each order of the plan occurs in turn, as soon as its condition
    holds."""
    scenario = to_drive(scenario, "a test")
    simulation, left = ot.Simulation([scenario]), list(plan)
    controller = simulation.controller
    assert isinstance(controller, DrivenController)
    while simulation.active.any():
        while left and left[0][0](simulation):
            controller.give(Order(time=float(simulation.time[0]), **left.pop(0)[1]))
        simulation.step()
    assert not left
    scenario = with_orders(scenario, controller.orders())
    (result,) = simulation.results()
    return replace(result, scenario=scenario, provenance=provenance_of(scenario))


def at(time: float) -> Callable[[ot.Simulation], bool]:
    return lambda simulation: bool(simulation.time[0] >= time)


@pytest.fixture(scope="module")
def handed_over() -> ot.Result:
    """Rolled by hand, turned by the autopilot, taken over in the turn, handed over again."""
    scenario = rolling_tee(**{"run.time_limit": None})
    plan = [
        (at(0), {"speed": 0.05}),
        (at(0.5), {"roll_deg": 30.0}),
        (at(1.0), {"by": "autopilot"}),
        (at(4.0), {"speed": 0.1}),
        (at(4.5), {"by": "autopilot"}),
    ]
    return driven(scenario, plan)


def test_saved_run_repeats_itself(handed_over, tmp_path):
    """A driven run's scenario makes the same run again, byte for byte in all files: alone, read
    from its folder, and in a batch with another one."""
    again = ot.run(handed_over.scenario)
    assert same_result(again, handed_over)
    again.save(tmp_path / "again")
    loaded = ot.load_result(tmp_path / "again")
    saved = ot.load_scenario(tmp_path / "again" / "scenario.json")
    other = with_orders(handed_over.scenario, [Order(time=0.0, speed=0.1), Order(time=1, by="end")])
    third, beside = ot.run_batch([saved, other])
    third.save(tmp_path / "third")
    names = [path.name for path in (tmp_path / "again").iterdir()]
    for name in names:
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "third" / name).read_bytes()
    assert loaded.provenance["driven_by"] == "a test"
    assert loaded.provenance["orders"] == 5
    assert same_result(beside, ot.run(other))


def test_record_tells_who_drove(handed_over):
    """Events and phases name driver and autopilot, and the run is not under the author's
    expectation, name, or time limit: who drives has an hour."""
    who = [event.who for event in handed_over.events if hasattr(event, "who")]
    assert who == ["a test", "controller jacobian", "a test", "controller jacobian"]
    names = [name for name, _, _ in handed_over.trajectory.phase_spans()]
    assert names[0] == "by_hand"
    assert names.count("by_hand") == 2
    assert {"align", "tee_turn"} <= set(names)
    assert handed_over.outcome is ot.Outcome.REACHED_GOAL
    assert handed_over.as_expected is None
    assert handed_over.scenario.name == "tee_turn_driven"
    assert handed_over.scenario.run.time_limit == 3600.0


def test_the_end_is_no_change_of_drivers():
    """Who ends a run while the autopilot drives does not drive from there on, and the last step is
    the autopilot's."""
    plan = [(at(0.05), {"by": "autopilot"}), (at(0.1), {"by": "end"})]
    result = driven(rolling_tee(), plan)
    assert [event.who for event in result.events if hasattr(event, "who")] == [
        "a test",
        "controller jacobian",
    ]
    assert result.trajectory.phase_spans()[-1][0] != "by_hand"
    assert result.duration_s < 0.2


def test_driven_scenario_is_driven_anew_without_its_orders(handed_over):
    """Name and autopilot stay, the orders go."""
    anew = to_drive(handed_over.scenario, "keyboard")
    assert anew.name == "tee_turn_driven"
    assert anew.control.parameters["autopilot"] == "jacobian"
    assert anew.control.parameters["orders"] == []


def test_no_load_slip_is_that_of_the_autopilot(handed_over):
    """It is measured with a controller that drives, and not with orders meant for other pipes."""
    scenario = rolling_tee(**{"run.time_limit": 0.1})
    plain = ot.run(scenario).metrics["no_load_slip_m_s"]
    again = ot.run(with_orders(handed_over.scenario, [Order(time=0.05, by="end")]))
    assert again.metrics["no_load_slip_m_s"] == plain


def test_heading_turns_the_robot_into_the_branch():
    """The nose is told where to point before the tee; the robot drives in and straightens up."""
    scenario = ot.override(ot.load_scenario("tee_turn"), {"start.distance": 0.25})
    result = driven(scenario, [(at(0), {"speed": 0.1, "heading": (1.0, 0.0, 0.0)})])
    assert result.outcome is ot.Outcome.REACHED_GOAL
    assert result.metrics["tilt_exit_deg"] < 2
    assert set(result.trajectory["phase"]) == {0}


def test_robot_in_the_region_hangs_in_the_tee():
    """The same heading with theta5 well within the motion singularity region: the robot gets into
    the opening, and no further."""
    changes = {"start.distance": 0.25, "start.theta5_deg": 40.0}
    scenario = ot.override(ot.load_scenario("tee_turn"), changes)
    plan = [(at(0), {"speed": 0.1, "heading": (1.0, 0.0, 0.0)}), (at(8.0), {"by": "end"})]
    result = driven(scenario, plan)
    assert result.outcome is ot.Outcome.ENDED
    assert 0.35 < result.trajectory["distance"][-1] < 0.5
    assert np.degrees(result.trajectory["tilt"][-1]) > 20


def test_forward_is_where_the_nose_points():
    """A driver who keeps going forward goes on forward where the mission wants to go back, and
    only his own order turns him round; standing still he is not taken for stuck."""
    plan = [
        (at(0), {"speed": 0.15}),
        (lambda s: bool(s.legs.number[0] == 1 and s.time[0] > 2.0), {"speed": 0.0}),
        (at(7.0), {"speed": -0.15}),
    ]
    result = driven(there_and_back(), plan)
    trajectory = result.trajectory
    forward = (trajectory["gear"] < 0) & (trajectory.time < 2.0)
    assert forward.any()
    assert (np.diff(trajectory["position"][forward, 2]) > 0).all()
    assert result.outcome is ot.Outcome.REACHED_GOAL
    assert result.duration_s > 9.0


def test_roll_keeps_to_the_motors_rate():
    """The modules roll no faster than the robot's rotary motors, to where they are told."""
    scenario = ot.load_scenario("straight")
    result = driven(scenario, [(at(0), {"roll_deg": 45.0}), (at(1.0), {"by": "end"})])
    asked = result.trajectory["roll_command"]
    rates = np.diff(asked[:, 0]) / np.diff(result.trajectory.time)
    assert rates.max() <= scenario.robot.roll_rate * (1 + 1e-6)
    assert asked[-1] == pytest.approx(np.radians([45.0] * 3))


def test_orders_beyond_the_belts_are_cut():
    """The belts are asked no more than their limit, forward as in a turn."""
    scenario = ot.load_scenario("straight")
    plan = [(at(0), {"speed": 5.0, "heading": (0.0, 1.0, 1.0)}), (at(0.2), {"by": "end"})]
    result = driven(scenario, plan)
    assert np.abs(result.trajectory["belt_speed_command"]).max() <= scenario.control.speed_limit


def test_orders_come_in_order():
    """An order for the past of another one is refused, live."""
    simulation = ot.Simulation([to_drive(ot.load_scenario("straight"), "a test")])
    controller = simulation.controller
    assert isinstance(controller, DrivenController)
    controller.give(Order(time=1.0))
    with pytest.raises(ValueError, match="comes behind"):
        controller.give(Order(time=0.5))


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"orders": [{"time": 2.0}, {"time": 1.0}]}, "orders: has one for 1 s behind one for 2 s"),
        ({"orders": [{"time": 0.0}] * (MAX_ORDERS + 1)}, f"at most {MAX_ORDERS} items"),
        ({"orders": [{"time": 0.0, "by": "luck"}]}, "'hand', 'autopilot'|hand, autopilot, end"),
        ({"autopilot": "driven"}, "autopilot: obeys orders itself"),
        ({"autopilot": "jacobean"}, "did you mean 'jacobian'"),
        ({"autopilot": "paper", "autopilot_parameters": {"elbow_delay": -1}}, "elbow_delay"),
        ({"autopilot_parameters": {"nonsense": 1}}, "autopilot_parameters.nonsense"),
    ],
)
def test_faults_of_orders_are_told(parameters, told):
    """Each fault of ``control.parameters`` is named by its place."""
    changes = {"control.kind": "driven", "control.parameters": parameters}
    with pytest.raises(ot.ScenarioError, match=told) as caught:
        ot.override(ot.load_scenario("straight"), changes)
    assert "control.parameters" in str(caught.value)


class SpunBall(Ball):
    """A ball that a torque about its y axis rolls through a level pipe."""

    def spec(self) -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        ball = spec.worldbody.add_body(name="chassis")
        _ = ball.add_freejoint(name="root"), ball.add_geom(size=[self.radius, 0, 0])
        motor = spec.add_actuator(name="spin", target="root", gear=[0, 0, 0, 0, 1, 0])
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        return spec

    @classmethod
    def controllers(cls) -> Mapping[str, type[Any]]:
        return {**super().controllers(), "by_orders": ByOrders}


class ByOrders:
    """Torque of the ball by its driver's orders, 1 N m for each m/s."""

    Parameters = DriverTable

    def __init__(self, setup: ot.ControlSetup) -> None:
        self.setup, self.roll = setup, np.zeros((setup.n, 3))
        self._orders = [list(table.orders) for table in setup.parameters]

    def give(self, order: Order, robot: int = 0) -> None:
        self._orders[robot].append(order)

    def orders(self, robot: int = 0) -> tuple[Order, ...]:
        return tuple(self._orders[robot])

    def step(self, observation: ot.Observation) -> ot.Actuation:
        due = [
            [order for order in orders if order.time <= time]
            for time, orders in zip(observation.time, self._orders, strict=True)
        ]
        return ot.Actuation(np.array([[one[-1].speed if one else 0.0] for one in due]))


def test_a_robot_from_outside_is_driven_by_its_own_controller():
    """The controller is found by its parameters; orders move the robot, and are kept."""
    pipes, name = [{"kind": "straight", "length": 1.0}], f"{__name__}:{SpunBall.__name__}"
    level = {"axis": [1, 0, 0], "distance": 0.2}
    scenario = to_drive(validate({"robot": name, "pipes": pipes, "start": level}), "a test")
    assert scenario.control.kind == "by_orders"
    assert scenario.control_parameters.autopilot == "own"
    scenario = with_orders(ot.override(scenario, {"run.time_limit": 0.5}), [])
    still = ot.run(scenario)
    moved = ot.run(with_orders(scenario, [Order(time=0.1, speed=0.05)]))
    ways = [np.ptp(result.trajectory["distance"]) for result in (still, moved)]
    assert ways[0] < 0.001 < 0.01 < ways[1]
    assert moved.provenance["driven_by"] == "a test"
    assert moved.provenance["orders"] == 1
    assert isinstance(ot.Simulation([scenario]).controller, ObeysOrders)


def test_a_robot_that_nobody_can_drive_is_refused():
    """The fault says so at the robot's kind."""
    with pytest.raises(ot.ScenarioError, match=r"robot\.kind: is 'presser'.*obeys a driver"):
        to_drive(ot.load_scenario("robots/presser_elbow"), "a test")


def test_controller_of_a_users_own_ends_its_run():
    """``Command.over`` ends the runs that it names, the others go on."""

    class Patient:
        def __init__(self, setup: Any) -> None:
            self.until = np.linspace(0.1, 0.2, setup.n)

        def step(self, observation: ot.Observation) -> ot.Command:
            over = observation.time >= self.until - 1e-9
            return ot.Command(np.zeros((len(over), 3)), over=over)

    scenario = ot.load_scenario("straight")
    results = ot.run_batch([scenario] * 2, controller=Patient, no_load=False)
    assert [result.outcome for result in results] == [ot.Outcome.ENDED] * 2
    assert [result.duration_s for result in results] == pytest.approx([0.11, 0.21])
