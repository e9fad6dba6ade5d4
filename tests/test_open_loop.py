"""Pieces of the search for commands that pass failed tee turns; the search itself takes minutes."""

from __future__ import annotations

import numpy as np
import open_loop
import pytest
from steered_turns import KNOTS, Trace, Turn, between, finish, go_on, ready, replay, steered, trace

from omnitrack_sim import load_scenario, override, run_batch

NONE = np.zeros((1, KNOTS, 3))
ADD, REPLACE = np.array([False]), np.array([True])


@pytest.fixture(scope="module")
def scenario():
    """A dry tee turn that begins at once."""
    return override(
        load_scenario("tee_turn"),
        {
            "start.distance": 0.28,
            "run.goal_distance": 0.55,
            "control.align": False,
            "run.time_limit": 3.0,
        },
    )


@pytest.fixture(scope="module")
def own(scenario) -> Trace:
    """The default controller's turn."""
    return trace([scenario], NONE, ADD)


def test_corrections_of_nothing_are_the_default_controller(scenario, own):
    """The turn begins in the run before the branch and ends with the robot's axis along it."""
    (result,) = run_batch([scenario], no_load=False)
    assert result.success
    assert own.passed.all()
    assert len(own.belt_speed) == round(result.duration_s / scenario.physics.control_period)
    assert open_loop.measured(result)["heading_deg"] == pytest.approx(90.0, abs=3.0)


def test_commands_pass_unseen_that_passed_with_feedback(scenario, own):
    """The same belt speeds end alike without a controller; others do not."""
    assert replay(scenario, own.belt_speed[:, 0])
    assert not replay(scenario, own.belt_speed[:100, 0])


def test_copies_go_on_from_the_same_place(scenario, own):
    """Commands are tried one after the other from where the robots are, and end as in a run from
    the beginning; standing still passes nothing."""
    before = 0.05
    sim = ready([scenario] * 2, before)
    still = go_on(sim, NONE, replace=True)
    assert sim.time == pytest.approx([before] * 2)
    assert sim.active.all()
    assert not still.passed.any()
    assert still.loss[0] > 1.0
    again = go_on(sim, NONE, replace=False)
    assert (again.passed.tolist(), again.loss.tolist()) == (own.passed.tolist(), [-1.0])
    there = finish(sim, NONE, replace=False)
    assert there.passed.tolist() == again.passed.tolist()
    assert np.isnan(steered(sim).begun).tolist() == [False, True]  # the second was left out


def test_knots_are_joined_by_lines():
    """Before the first and after the last knot their values stay."""
    knots = np.arange(KNOTS * 3.0).reshape(1, KNOTS, 3)
    for at, first in ((0.0, 0.0), (0.5, 1.5), (1.0, 3.0), (KNOTS + 5.0, 3.0 * (KNOTS - 1))):
        assert between(knots, np.array([at]))[0] == pytest.approx(first + np.arange(3))


def test_a_turn_knows_its_places(scenario):
    """The arc ends in the branch as far beside the run's axis as it is wide."""
    turn = Turn.of(scenario)
    radius = scenario.arcs.turn
    assert turn.mouth @ turn.way_out == pytest.approx(radius)
    round_robot = np.stack([turn.way_in, np.cross(turn.way_out, turn.way_in), turn.way_out], axis=1)
    assert turn.left(turn.mouth[None], round_robot[None]) == pytest.approx(0.0, abs=1e-6)


def test_a_failure_tells_how_far_it_has_turned(scenario):
    """A robot whose time is out at once has not turned yet; one that is out has slid past."""
    (result,) = run_batch([override(scenario, {"run.time_limit": 0.1})], no_load=False)
    failed = {"outcome": result.outcome.value, **open_loop.measured(result)}
    assert failed["heading_deg"] == pytest.approx(0.0, abs=1.0)
    assert open_loop.how_it_failed(failed) == "hangs half turned"
    assert open_loop.how_it_failed(failed | {"heading_deg": 85.0}) == "hangs across the run"
    assert open_loop.how_it_failed(failed | {"outcome": "left_pipe"}) == "slides past"


def test_failures_are_counted_by_kind():
    """Of three that slide past, commands passed two, one of them with all four neighbours."""
    cases = [open_loop.Case(i, "slides past", robust) for i, robust in enumerate((None, 3, 4))]
    assert open_loop.row("slides past", cases) == ["slides past", 3, 2, 1, 1]
