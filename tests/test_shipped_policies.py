"""The policies that come with the package: what they say of themselves, and that they drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim.base.naming import shipped_files
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.record.events import BackedOff

ACTING = {"tee_turn": "direct", "tee_turn_residual": "residual"}


@pytest.mark.parametrize("name", ACTING)
def test_it_tells_how_it_came_about(name):
    policy = ot.load_policy(name)
    assert policy.acting.name == ACTING[name]
    record = policy.record
    assert record.command.startswith("python benchmarks/learning/train.py tee_turn")
    assert ("--residual" in record.command) == (ACTING[name] == "residual")
    assert record.steps is not None
    assert record.steps > 100_000
    assert shipped_files("policies")[name].stat().st_size < 200_000


@pytest.mark.parametrize("theta5_deg", [0.0, 25.0])
@pytest.mark.parametrize(("name", "friction"), [("tee_turn", 0.9), ("tee_turn_residual", 0.6)])
def test_it_turns_into_the_branch(name, friction, theta5_deg):
    """On the walls that it was trained for; dead on, and from where driving on as it is would
    fail."""
    changes = {
        "control.kind": "policy",
        "control.parameters.policy": name,
        "start.theta5_deg": theta5_deg,
        "world.friction": friction,
    }
    result = ot.run(ot.load_scenario("tee_turn", changes))
    assert result.outcome is ot.Outcome.REACHED_GOAL


def test_a_base_leaves_a_turn_that_slips_to_the_decisions():
    """Straight down on slippery walls the policy turns the belts against each other and passes at
    the first attempt; its base does not take that for a slide and back off."""
    tee = ot.load_scenario("tee_turn", {"robot.preload": 26.0})
    down = 9.81 * tee.route.centreline.at(np.zeros(1))[1][0]
    changes = {
        "control.kind": "policy",
        "control.parameters.policy": "tee_turn_residual",
        "start.theta5_deg": 7.0,
        "world.gravity": down.tolist(),
    }
    turns = [ot.override(tee, changes | {"world.friction": mu}) for mu in (0.52, 0.56, 0.6)]
    for result in ot.run_batch(turns, no_load=False):
        assert result.success
        assert not [event for event in result.events if isinstance(event, BackedOff)]


def test_they_run_in_a_sweep_in_another_process(tmp_path):
    """To the same table as in this one."""
    tee = (Path(__file__).parents[1] / "scenarios" / "tee_turn.toml").read_text(encoding="utf-8")
    policy = '[control]\nkind = "policy"\n[control.parameters]\npolicy = "tee_turn"\n'
    (tmp_path / "base.toml").write_text(tee + policy)
    (tmp_path / "sweep.toml").write_text(
        'base = "base.toml"\nbatch = 2\n'
        '[set]\n"run.time_limit" = 1.0\n'
        f'[[axes]]\npath = "control.parameters.policy"\nkind = "list"\nvalues = {list(ACTING)}\n'
        '[[axes]]\npath = "start.theta5_deg"\nkind = "list"\nvalues = [-20, 10]\n'
    )
    sweep = ot.load_sweep(tmp_path / "sweep.toml")
    alone = ot.run_trials(sweep).table
    with LocalPool(1) as pool:
        assert ot.run_trials(sweep, executor=pool).table.equals(alone)
    assert len(set(alone["distance_m"].to_pylist())) == 4
