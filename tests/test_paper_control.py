"""The paper's controller, the baseline without modulation, and the retry of the default one."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from omnitrack_sim import load_scenario, override, run_batch
from omnitrack_sim.pipes.route_map import RouteMap
from omnitrack_sim.record.events import BackedOff
from omnitrack_sim.robots.omnitrack import MODULE_ANGLES
from omnitrack_sim.robots.omnitrack.control import Command, ControlSetup, Settings
from omnitrack_sim.robots.omnitrack.control.open_loop import PaperController
from omnitrack_sim.robots.omnitrack.kinematics import elbow_speeds
from omnitrack_sim.sim.builder import settings_of

BORE = 0.16
"""D, m: the unit of lengths in ``[control.parameters]``."""


@cache
def _turn_speeds(name: str, theta5_deg: float, **more) -> tuple[np.ndarray, object]:
    """Commanded wall speeds (3,) in the middle of the turn, and the result."""
    changes = {
        "control.kind": "paper",
        "control.align": False,
        "start.theta5_deg": theta5_deg,
        **more,
    }
    (result,) = run_batch([override(load_scenario(name), changes)], no_load=False)
    phases = np.array(result.trajectory.phases)[result.trajectory["phase"].astype(int)]
    turning = np.flatnonzero((phases == "elbow") | (phases == "tee_turn"))
    return result.trajectory["belt_speed_command"][turning[len(turning) // 2]], result


def test_elbow_speeds_are_equation_20():
    """At theta5 = 20 degrees in the 90 mm elbow."""
    speeds, _ = _turn_speeds("elbow_short", 20.0)
    assert np.allclose(speeds, elbow_speeds(0.1, np.radians(20.0), 0.09, 0.08), atol=1e-3)


def test_tee_speeds_are_backward_inside_and_forward_outside():
    """Inner module -100 mm/s, outer ones +100, from the moment the head is R/2 past the opening's
    near edge."""
    speeds, result = _turn_speeds("tee_turn", 0.0)
    assert speeds.tolist() == [-0.1, 0.1, 0.1]
    trajectory = result.trajectory
    begin = np.flatnonzero(trajectory["phase"] == trajectory.phases.index("tee_turn"))[0]
    head = trajectory["distance"][begin] + result.scenario.robot.length / 2
    assert head == pytest.approx(0.3 + 0.16 - 0.08 + 0.04, abs=0.005)


def test_turn_ends_when_the_axis_has_turned():
    """The last sample of the turn is within 4 degrees of the way out, or past it, in the plane of
    the bend."""
    _, result = _turn_speeds("tee_turn", 0.0)
    trajectory = result.trajectory
    last = np.flatnonzero(trajectory["phase"] == trajectory.phases.index("tee_turn"))[-1]
    w, x, y, z = trajectory["quaternion"][last]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    branch = result.scenario.route.passages[1].turn_direction
    assert axis @ branch > np.sin(np.radians(86))


def test_equal_speeds_are_equal():
    """The baseline never modulates."""
    speeds, _ = _turn_speeds("elbow_short", 0.0, **{"control.kind": "equal", "run.time_limit": 4.0})
    assert speeds.tolist() == [0.1, 0.1, 0.1]


def _alone():
    """A controller of one robot before a tee, and the robot's location."""
    scenario = override(load_scenario("tee_turn"), {"control.kind": "paper"})
    routes, route = RouteMap([scenario.route]), np.zeros(1, np.intp)
    settings, _ = settings_of([scenario])
    assert isinstance(settings, Settings)
    at = np.array([0.1])
    location = routes.locate(np.array([[0.0, 0.0, 0.1]]), np.eye(3)[None], route, at)
    parameters = [scenario.control_parameters]
    none = np.zeros((1, 3))
    controller = PaperController(
        ControlSetup(
            routes, scenario.robot, settings, parameters, location, Command(none, none), 0.01, none
        )
    )
    return controller, location


@pytest.mark.parametrize(
    ("before", "after"), [((-1, -1), (-1, -1)), ((0, 2), (3, 5)), ((4, -1), (7, -1))]
)
def test_on_a_route_that_is_extended_turns_keep_their_passages(before, after):
    """Whose numbers are larger now; -1, which stands for none, stays."""
    controller, location = _alone()
    (controller.turning[0], controller.turned[0]), aligned = before, controller.aligner.aligned[0]
    legs = SimpleNamespace(changes=lambda _: [], grown=False, extended=[(0, 3)])
    controller._legs = legs
    controller._follow_legs(SimpleNamespace(location=location))
    assert (controller.turning[0], controller.turned[0]) == after
    assert controller.aligner.aligned[0] == aligned + 3


def test_two_modules_are_inner_in_the_worst_orientation():
    """At theta5 = 60 degrees the modules at 60 and -60 from the turn go backward."""
    controller, location = _alone()
    theta5 = np.radians(60.0)
    location.theta5 = np.array([theta5])
    speeds = controller._speeds(location)
    assert (np.sign(speeds[0]) == -np.sign(np.cos(theta5 + np.array(MODULE_ANGLES)))).all()


def test_a_failed_turn_is_tried_again():
    """Unaligned from the worst orientation the turn hangs; with retry the robot backs off to before
    the tee."""
    base = override(load_scenario("tee_turn"), {"start.theta5_deg": 60, "control.align": False})
    without, tried = run_batch([override(base, {"control.retry": False}), base], no_load=False)
    assert without.events == []
    assert not without.success
    assert any("backs off and tries again" in str(event) for event in tried.events)
    phases = np.array(tried.trajectory.phases)[tried.trajectory["phase"].astype(int)]
    backing = phases == "back_off"
    assert tried.trajectory["distance"][backing].min() < 0.38 - tried.scenario.robot.length / 2
    assert 1 <= len([e for e in tried.events if isinstance(e, BackedOff)]) <= 2


def test_an_elbow_can_begin_later():
    """With a delay of 50 mm the turn begins with the head 50 mm past the bend's start."""
    _, result = _turn_speeds(
        "elbow_short",
        0.0,
        **{"control.parameters.elbow_delay": 0.05, "run.time_limit": 3.0},
    )
    trajectory = result.trajectory
    begin = np.flatnonzero(trajectory["phase"] == trajectory.phases.index("elbow"))[0]
    head = trajectory["distance"][begin] + result.scenario.robot.length / 2
    assert head == pytest.approx(result.scenario.route.passages[1].s_bend_start + 0.05, abs=0.005)


def test_a_tee_turn_begins_at_its_trigger():
    """Half a radius past the opening's edge, as published, or where the scenario says."""
    base = {"control.align": False, "control.kind": "paper", "run.time_limit": 4.5}
    later = {"control.parameters.tee_trigger": 0.06}
    scenarios = [override(load_scenario("tee_turn"), base | changes) for changes in ({}, later)]
    results = run_batch(scenarios, no_load=False)
    for result, expected in zip(results, (0.04, 0.06), strict=True):
        trajectory = result.trajectory
        begin = np.flatnonzero(trajectory["phase"] == trajectory.phases.index("tee_turn"))[0]
        head = trajectory["distance"][begin] + result.scenario.robot.length / 2
        assert head == pytest.approx(
            result.scenario.route.passages[1].opening[0] + expected, abs=0.005
        )
