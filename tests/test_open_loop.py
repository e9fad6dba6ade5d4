"""Pieces of the search for commands that pass failed tee turns; the search itself takes minutes."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import open_loop
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
    assert own.before[0, 0] == pytest.approx(0.46 - 0.28, abs=1e-3)
    assert np.degrees(own.heading[[0, -1], 0]) == pytest.approx([0.0, 90.0], abs=3.0)


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
    """The branch's axis crosses the run 0.46 m from its beginning, and the arc ends in the branch
    as far beside it as it is wide."""
    turn = Turn.of(scenario)
    radius = scenario.control.tee_turn_radius
    assert turn.axis_at == pytest.approx(0.46)
    assert turn.before(turn.mouth[None]) == pytest.approx(0.0, abs=1e-9)
    assert turn.mouth @ turn.way_out == pytest.approx(radius)
    round_robot = np.stack([turn.way_in, np.cross(turn.way_out, turn.way_in), turn.way_out], axis=1)
    assert turn.left(turn.mouth[None], round_robot[None]) == pytest.approx(0.0, abs=1e-6)
    assert turn.heading(round_robot[None]) == pytest.approx(np.pi / 2)


def test_a_failure_tells_where_it_hangs(scenario):
    """A robot whose time is out has not turned yet, a bit on from its start 180 mm before the axis
    of the branch."""
    (result,) = run_batch([override(scenario, {"run.time_limit": 0.1})], no_load=False)
    kind, detail = open_loop.how_it_failed(result)
    assert kind == "hangs half turned"
    assert re.fullmatch(
        r"hangs half turned: turned -?0 deg, 1[78]\d mm before the branch's axis", detail
    )


def test_stretches_are_measured_between_marks():
    """A robot at 100 mm/s that turns by a degree each millimetre and stops 30 mm before the axis:
    what it did not reach is not a number."""
    since = np.arange(0.0, 1.0, 0.01)[:, None]
    before = np.maximum(0.1 - 0.1 * since, 0.03)
    speeds = np.tile([-0.2, 0.1, 0.2], (len(since), 1, 1))
    run = Trace(np.array([False]), since, before, np.radians(100 - 1000 * before), speeds, speeds)
    found = open_loop.stretches(run, 0)
    assert found[0] == pytest.approx([40.0, 100.0, -200.0, 100.0, 200.0], abs=1.5)
    assert found[1] == pytest.approx([60.0, 100.0, -200.0, 100.0, 200.0], abs=1.5)
    assert np.isnan(found[2:]).all()


def test_failures_are_counted_by_kind(capsys):
    """Of two that slide past, commands passed one; what has no such commands is physics."""
    cases = [
        open_loop.Case(1, "slides past", ""),
        open_loop.Case(2, "slides past", "", robust=3, traces=_turned()),
    ]
    open_loop.report(cases)
    assert "| slides past | 2 | 1 | 0 | 1 |" in capsys.readouterr().out
    assert [case.verdict for case in cases] == ["physics", "control"]


def _turned() -> Trace:
    """Three robots that drive from 100 mm before the branch's axis to 20 mm past it."""
    since = np.tile(np.linspace(0.0, 1.2, 121)[:, None], (1, 3))
    speeds = np.full((len(since), 3, 3), 0.1)
    return Trace(np.ones(3, bool), since, 0.1 - 0.1 * since, since, speeds, speeds)
