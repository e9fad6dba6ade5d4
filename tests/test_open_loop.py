"""Pieces of the search for commands that pass failed tee turns; the search itself takes minutes."""

from __future__ import annotations

import numpy as np
import open_loop
import pytest
from steered_turns import KNOTS, Tried, Turn, between, finish, go_on, ready, replay

from omnitrack_sim import load_scenario, override, run_batch
from omnitrack_sim.record.statistics import wilson_interval

NONE, BACKWARD = np.zeros((1, KNOTS, 3)), np.full((1, KNOTS, 3), -0.4)


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
def own(scenario) -> Tried:
    """The default controller's turn."""
    return finish(ready([scenario]))


def test_corrections_of_nothing_are_the_default_controller(scenario, own):
    """The turn begins in the run before the branch and ends with the robot's axis along it."""
    (result,) = run_batch([scenario], no_load=False)
    assert result.success
    assert own.passed.all()
    assert len(own.belt_speed) == round(result.duration_s / scenario.physics.control_period)
    assert open_loop.measured(result)["heading_deg"] == pytest.approx(90.0, abs=3.0)


def test_commands_pass_unseen_that_passed_with_feedback(scenario, own):
    """The same belt speeds and rolls end alike without a controller; others do not."""
    belt_speed, roll = own.belt_speed[:, 0], own.roll[:, 0]
    assert replay(scenario, belt_speed, roll)
    assert not replay(scenario, belt_speed[:100], roll[:100])


def test_copies_go_on_from_the_same_place(scenario, own):
    """Corrections are tried one after the other from where the robots are, and end as in a run from
    the beginning; driving backward passes nothing."""
    before = 0.05
    sim = ready([scenario], before)
    back = go_on(sim, BACKWARD)
    assert sim.time == pytest.approx([before])
    assert sim.active.all()
    assert not back.passed.any()
    assert back.loss[0] > 1.0
    again = go_on(sim, NONE)
    assert (again.passed.tolist(), again.loss.tolist()) == (own.passed.tolist(), [-1.0])
    assert np.array_equal(again.belt_speed, own.belt_speed[-len(again.belt_speed) :])


def test_sets_of_parameters_drive_differently(scenario, own):
    """Sets by lot are taken by the controller that drives them, each at one attempt."""
    turns = open_loop.drawn(scenario, 2, np.random.default_rng(1))
    assert not any(turn.control.retry for turn in turns)
    tried = finish(ready(turns))
    steps = min(len(tried.belt_speed), len(own.belt_speed))
    first, second = tried.belt_speed[:steps].transpose(1, 0, 2)
    assert not np.array_equal(first, second)
    assert not np.array_equal(first, own.belt_speed[:steps, 0])


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


def test_failures_are_counted_by_kind(capsys):
    """Of three that slide past, commands passed two."""
    cases = [open_loop.Case({}, "slides past", found=found) for found in (False, True, True)]
    open_loop.print_kinds(cases, [{"success": False}] * 3)
    assert "| slides past | 3 | 2 | 1 |" in capsys.readouterr().out


def test_a_floor_counts_what_was_found():
    """Where commands are found for half of the failures, half of them are physics; where for all,
    none. Two intervals of 97.5 % that hold together are wider than one of 95 %."""
    assert open_loop.floor_text(60, 100, 4, 8).startswith("80 % (")
    assert open_loop.floor_text(60, 100, 8, 8).startswith("100 % (")
    assert open_loop.floor_text(100, 100, 0, 0).startswith("100 of 100 (")
    narrow, wide = wilson_interval(60, 100), wilson_interval(60, 100, open_loop.Z975)
    assert wide[0] < narrow[0] < 0.6 < narrow[1] < wide[1]
