"""The policies that come with the package: what they say of themselves, and that they drive."""

from __future__ import annotations

import re
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
    assert "python benchmarks/learning/train.py tee_turn" in policy.note
    assert ("--residual" in policy.note) == (ACTING[name] == "residual")
    assert int(re.search(r"(\d+) decisions", policy.note)[1]) > 100_000
    assert shipped_files("policies")[name].stat().st_size < 200_000


def test_it_decides_as_the_network_of_its_file():
    """By matrix products of its arrays, for whatever is observed."""
    for name in ACTING:
        with np.load(shipped_files("policies")[name]) as file:
            layers = [(file[f"weight_{i}"], file[f"bias_{i}"]) for i in range(3)]
            entries = np.random.default_rng(3).normal(0, 1, (50, 53))
            rows = np.clip((entries - file["mean"]) / file["std"], -file["reach"], file["reach"])
        for weight, bias in layers[:-1]:
            rows = np.tanh(rows @ weight + bias)
        expected = np.clip(rows @ layers[-1][0] + layers[-1][1], -1, 1)
        np.testing.assert_allclose(ot.load_policy(name)(entries), expected, atol=1e-6)


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


@pytest.mark.long
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
