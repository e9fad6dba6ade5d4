"""The controller that a policy file is: in runs, batches, sweeps and missions."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from documents import page
from policy_samples import driver, random_policy
from runs import same_result, there_and_back

import omnitrack_sim as ot
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.robots.omnitrack.policy.controller import Decisions
from omnitrack_sim.robots.omnitrack.policy.features import features_of
from omnitrack_sim.robots.omnitrack.policy.file import DIRECT, RESIDUAL

TEE = """
[[pipes]]
kind = "straight"
length = 0.3
[[pipes]]
kind = "tee"
enter = "run_start"
leave = "branch"
[[pipes]]
kind = "straight"
length = 0.4
[run]
time_limit = 0.5
[control]
kind = "policy"
[control.parameters]
policy = "own/random.npz"
"""


def _tee(policy: Path, **changes) -> ot.Scenario:
    base = {
        "run.time_limit": 0.5,
        "start.distance": 0.3,
        "control.kind": "policy",
        "control.parameters.policy": str(policy),
    }
    return ot.override(ot.load_scenario("tee_turn"), base | changes)


def test_a_scenario_names_a_file_beside_it(tmp_path):
    """A saved run finds it from anywhere, and refuses another one."""
    (tmp_path / "own").mkdir()
    random_policy().save(tmp_path / "own" / "random.npz")
    (tmp_path / "tee.toml").write_text(TEE)
    scenario = ot.load_scenario(tmp_path / "tee.toml")
    result = ot.run(scenario)
    result.save(tmp_path / "run")
    again = ot.load_scenario(tmp_path / "run" / "scenario.json")
    assert again.hash == scenario.hash
    assert same_result(ot.run(again), result)
    random_policy(seed=1).save(tmp_path / "own" / "random.npz")
    with pytest.raises(ot.ScenarioError, match=r"parameters.sha256: the file has changed"):
        ot.load_scenario(tmp_path / "run" / "scenario.json")
    shutil.rmtree(tmp_path / "own")
    with pytest.raises(ot.ScenarioError, match=r"parameters.policy: .*no such file, nor a shipped"):
        ot.load_scenario(tmp_path / "tee.toml")


def test_robots_of_several_policies_share_a_batch(tmp_path):
    """Each runs to the same bytes as alone."""
    scenarios = []
    for i, acting in enumerate((None, RESIDUAL)):
        path = tmp_path / f"{i}.npz"
        random_policy("preview", seed=i, **({} if acting is None else {"acting": acting})).save(
            path
        )
        scenarios.append(_tee(path, **{"start.theta5_deg": 10.0 * i}))
    scenarios.append(_tee(tmp_path / "0.npz", **{"start.theta5_deg": 40.0}))
    together = ot.run_batch(scenarios, no_load=False)
    for scenario, result in zip(scenarios, together, strict=True):
        (alone,) = ot.run_batch([scenario], no_load=False)
        assert alone.trajectory.qpos.tobytes() == result.trajectory.qpos.tobytes()
    assert together[0].trajectory.phases == ("decide", "cruise", "align", *RESIDUAL_REST)


RESIDUAL_REST = ("elbow", "tee_turn", "tee_straight", "back_off")


def test_a_sweep_in_another_process_gives_the_same_table(tmp_path):
    """Over orientations and policies, which take the place of the one of the base scenario."""
    for seed in (0, 1):
        random_policy(seed=seed).save(tmp_path / f"{seed}.npz")
    (tmp_path / "base.toml").write_text(TEE.replace("own/random", "0"))
    policies = [str(tmp_path / f"{seed}.npz") for seed in (0, 1)]
    (tmp_path / "sweep.toml").write_text(
        'base = "base.toml"\nbatch = 2\n[[axes]]\npath = "start.theta5_deg"\nkind = "list"\n'
        'values = [0, 40]\n[[axes]]\npath = "control.parameters.policy"\nkind = "list"\n'
        f"values = {policies}\n"
    )
    sweep = ot.load_sweep(tmp_path / "sweep.toml")
    alone = ot.run_trials(sweep).table
    with LocalPool(1) as pool:
        together = ot.run_trials(sweep, executor=pool).table
    assert alone.equals(together)
    assert set(alone["outcome"].to_pylist()) <= {"timed_out", "no_motion_line"}
    assert len(set(alone["distance_m"].to_pylist())) == 4


def test_it_drives_a_mission_there_and_back(tmp_path):
    """Nose first and tail first, by what it sees as if it drove nose first."""
    driver(0.75).save(tmp_path / "driver.npz")
    scenario = there_and_back(
        **{"control.kind": "policy", "control.parameters.policy": str(tmp_path / "driver.npz")}
    )
    result = ot.run(scenario)
    assert result.outcome is ot.Outcome.REACHED_GOAL
    assert [leg.gear for leg in result.legs] == [1, -1]


class Learner:
    """A controller whose decisions come from elsewhere, in the steps of a policy's."""

    def __init__(self, setup: ot.ControlSetup) -> None:
        self.decisions = Decisions(setup, features_of("onboard"), DIRECT)
        self.phases = self.decisions.phases

    def step(self, observation: ot.Observation) -> ot.Command:
        if self.decisions.due.any():
            entries = self.decisions.observe(observation)
            self.decisions.decide(0.5 * (entries[:, :4] > -1))
        return self.decisions.command(observation)


def test_the_python_of_the_page_runs(tmp_path, monkeypatch, capsys):
    """A policy that it writes, which turns in a tee as the page says; a learner drives in its
    steps."""
    monkeypatch.chdir(tmp_path)
    text = page("policies")
    saved, made, onnx = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    for block in (saved, made):
        exec(compile(block, "policies.md", "exec"), {"__name__": "page"})
    assert capsys.readouterr().out.split()[-2:] == ["(5,", "4)"]
    ahead = ot.run(_tee(tmp_path / "ahead.npz"))
    assert ahead.trajectory["distance"][-1] > ahead.trajectory["distance"][0] + 0.01
    session = SimpleNamespace(
        run=lambda outputs, given: [ot.load_policy("tee_turn")(given["entries"])]
    )
    runtime = SimpleNamespace(InferenceSession=lambda path: session)
    monkeypatch.setitem(sys.modules, "onnxruntime", runtime)
    page_module: dict[str, Any] = {"__name__": "page"}
    exec(compile(onnx, "policies.md", "exec"), page_module)
    assert page_module["POLICY"](np.zeros((2, 53), np.float32)).shape == (2, 4)
    turn = {"control.kind": "policy", "control.parameters.policy": str(tmp_path / "mine.npz")}
    result = ot.run(ot.load_scenario("tee_turn", turn))
    assert result.outcome is ot.Outcome.REACHED_GOAL
    scenario = _tee(tmp_path / "mine.npz")
    for controller in (None, Learner):
        (result,) = ot.run_batch([scenario], controller=controller, no_load=False)
        assert result.outcome is ot.Outcome.TIMED_OUT


def test_it_is_handed_over_to(tmp_path):
    """As the autopilot of a robot that is driven by orders."""
    driver().save(tmp_path / "driver.npz")
    orders = [{"time": 0.0, "by": "autopilot"}]
    parameters = {
        "autopilot": "policy",
        "autopilot_parameters": {"policy": str(tmp_path / "driver.npz")},
        "orders": orders,
    }
    changes = {"control.kind": "driven", "control.parameters": parameters}
    driven = ot.run(_tee(tmp_path / "driver.npz", **changes))
    alone = ot.run(_tee(tmp_path / "driver.npz"))
    assert driven.trajectory.qpos.tobytes() == alone.trajectory.qpos.tobytes()


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        ({"control.parameters": {}}, r"control.parameters.policy: field required"),
        ({"control.parameters.policy": 3}, r"control.parameters.policy: .*string \(given: 3\)"),
        ({"control.parameters.polcy": "x"}, r"polcy: unknown key.*did you mean 'policy'"),
    ],
)
def test_bad_parameters_are_refused(tmp_path, changes, pattern):
    driver().save(tmp_path / "driver.npz")
    with pytest.raises(ot.ScenarioError, match=re.compile(pattern)):
        _tee(tmp_path / "driver.npz", **changes)


def test_a_file_for_other_observations_is_refused_before_the_run(tmp_path):
    random_policy("truth").save(tmp_path / "truth.npz")
    scenario = _tee(tmp_path / "truth.npz", **{"sensing.kind": "onboard"})
    with pytest.raises(ot.InputError, match="'normal_force' is not there"):
        ot.run(scenario)
