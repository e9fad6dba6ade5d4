"""Controllers of a user's own: named in a scenario, handed over in Python, saved, and in sweeps."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from runs import same_result

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault
from omnitrack_sim.base.workers import LocalPool
from omnitrack_sim.cli import main
from omnitrack_sim.robots.omnitrack.control import JacobianController
from omnitrack_sim.sim.own_controller import own_errors
from omnitrack_sim.trials.sweep_file import resolve

MODULE = '''
from typing import Literal

import numpy as np
from pydantic import BaseModel, Field

import omnitrack_sim as ot


class Plain:
    """As little as a controller can be: cruise, and say so once."""

    def __init__(self, setup):
        self.speed = np.repeat(setup.settings.cruise_speed[:, None], 3, axis=1)
        self.told = False

    def step(self, observation):
        times = [] if self.told else observation.time.tolist()
        events = [ot.Remark(i, time, "off we go") for i, time in enumerate(times)]
        self.told = True
        return ot.Command(self.speed, events=events)


class Inner(BaseModel):
    depth: float = 1.0


class Tuned(Plain):
    """Cruises at a part of the speed, in phases of its own."""

    phases = ("slow", "fast")

    class Parameters(BaseModel):
        part: float = Field(0.5, gt=0)
        mode: Literal["slow", "fast"] = "slow"
        inner: Inner = Inner()

    def __init__(self, setup):
        super().__init__(setup)
        self.speed = self.speed * setup.each("part")[:, None]
        self.phase = (setup.each("mode") == "fast").astype(int)

    def step(self, observation):
        return super().step(observation)._replace(phase=self.phase)


class Broken(Plain):
    """Drives, and then indexes what is not there."""

    def step(self, observation):
        if observation.time.max() > 0.045:
            self.find(observation)
        return super().step(observation)

    def find(self, observation):
        return np.take(observation.time, 7)


class NoController:
    pass


function = print
'''
BRIEF = {"run.time_limit": 0.4}


@pytest.fixture
def drivers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A module ``drivers`` in a folder outside the package, where Python finds it."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "drivers.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    yield importlib.import_module("drivers")
    del sys.modules["drivers"]


def straight(**changes: object) -> ot.Scenario:
    return ot.override(ot.load_scenario("straight"), BRIEF | changes)


def faults_of(**changes: object) -> dict[str, Fault]:
    with pytest.raises(ot.ScenarioError) as caught:
        straight(**changes)
    return {fault.where: fault for fault in caught.value.faults}


def test_a_class_with_two_methods_drives(drivers: ModuleType) -> None:
    """Named by ``module:Class``, it is asked for every command, and what it tells stands in the
    result."""
    result = ot.run(straight(**{"control.kind": "drivers:Plain"}))
    assert result.outcome is ot.Outcome.TIMED_OUT
    assert (result.trajectory["belt_speed_command"][1:] == 0.1).all()
    assert result.trajectory.phases == ("drive",)
    assert list(map(str, result.events)) == ["0.00 s, off we go"]
    assert result.scenario.control.kind == "drivers:Plain"
    assert np.isfinite(result.metrics["no_load_slip_m_s"])  # type: ignore[arg-type]


def test_an_error_in_it_is_one_line_with_the_step_and_its_own_line(
    drivers: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    """The command line ends with status 2 and names controller, step, error and the deepest line of
    the user's module; in Python the error itself is the cause. Errors of the package's controllers
    pass as they are, and what the user can mend is told as it is."""
    line = ["omnitrack", "run", "straight", "--no-video", "--set", "control.kind=drivers:Broken"]
    monkeypatch.setattr(sys, "argv", [*line, "--out", str(tmp_path / "run")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert "drivers:Broken, step 6 (0.05 s): IndexError: index 7 is out of bounds" in told
    assert told.endswith("in find: return np.take(observation.time, 7))")
    assert not (tmp_path / "run").exists()
    with pytest.raises(ot.ControllerError) as caught:
        ot.run(straight(**{"control.kind": "drivers:Broken"}), no_load=False)
    assert isinstance(caught.value.__cause__, IndexError)
    with pytest.raises(KeyError), own_errors(JacobianController, lambda: ""):
        raise KeyError("ours")
    with pytest.raises(ot.InputError), own_errors(drivers.Broken, lambda: ""):
        raise ot.InputError([])


def test_its_parameters_are_its_own_model(drivers: ModuleType) -> None:
    """``[control.parameters]`` is filled in with the defaults of its model, handed over robot by
    robot, and recorded."""
    kind = {"control.kind": "drivers:Tuned"}
    fast = {"control.parameters.part": 0.8, "control.parameters.mode": "fast"}
    slow_run, fast_run = ot.run_batch([straight(**kind), straight(**kind, **fast)], no_load=False)
    filled_in = {"part": 0.5, "mode": "slow", "inner": {"depth": 1.0}}
    assert slow_run.scenario.control.parameters == filled_in
    assert fast_run.scenario.control.parameters == filled_in | {"part": 0.8, "mode": "fast"}
    assert slow_run.trajectory["belt_speed_command"][-1] == pytest.approx([0.05] * 3)
    assert fast_run.trajectory["belt_speed_command"][-1] == pytest.approx([0.08] * 3)
    assert [span[0] for span in fast_run.trajectory.phase_spans()][-1] == "fast"


@pytest.mark.parametrize(
    ("path", "value", "told", "choice"),
    [
        ("part", -1.0, "greater than 0", None),
        ("part", "half", "valid number", None),
        ("mode", "slwo", "'slwo'", "fast"),
        ("prat", 0.5, "unknown key", "part"),
        ("inner.deep", 0.5, "unknown key", "depth"),
        ("inner.depth", "x", "valid number", None),
    ],
)
def test_a_bad_parameter_is_a_fault_at_its_path(
    drivers: ModuleType, path: str, value: object, told: str, choice: str | None
) -> None:
    """It is told by its dotted path, with what there is to choose from; a key that the model does
    not have is a fault, too, though the model does not forbid it."""
    where = f"control.parameters.{path}"
    faults = faults_of(**{"control.kind": "drivers:Tuned", where: value})
    assert set(faults) == {where}
    assert told in str(faults[where])
    assert choice is None or choice in faults[where].choices


def test_parameters_of_a_controller_without_a_model_are_refused(drivers: ModuleType) -> None:
    """A class without ``Parameters`` has an empty table."""
    where = "control.parameters.part"
    faults = faults_of(**{"control.kind": "drivers:Plain", where: 1.0})
    assert set(faults) == {where}


def test_faults_of_the_parameters_are_told_with_all_others(drivers: ModuleType) -> None:
    """A bad parameter and a bad friction are told at once."""
    where = "control.parameters.part"
    changes = {"control.kind": "drivers:Tuned", where: -1.0, "world.friction": -1.0}
    assert set(faults_of(**changes)) == {where, "world.friction"}


def test_a_class_handed_over_gives_the_same_as_its_name(drivers: ModuleType) -> None:
    """By ``ot.run(..., controller=Class)``: the same bytes, and the name is recorded."""
    named = ot.run(straight(**{"control.kind": "drivers:Tuned"}))
    handed_over = ot.run(straight(), controller=drivers.Tuned)
    assert same_result(named, handed_over)
    assert handed_over.scenario.control.kind == "drivers:Tuned"
    assert handed_over.scenario.hash == named.scenario.hash
    assert handed_over.summary() == named.summary()


def test_a_simulation_takes_a_class_as_well(drivers: ModuleType) -> None:
    """``ot.Simulation(..., controller=Class)`` is driven by it."""
    simulation = ot.Simulation([straight()], controller=drivers.Plain)
    assert isinstance(simulation.controller, drivers.Plain)
    simulation.advance()
    assert simulation.results()[0].scenario.control.kind == "drivers:Plain"


def test_a_class_inside_a_function_drives_as_well() -> None:
    """No module need be found for a class that is handed over; its name says where it was."""

    class Still:
        def __init__(self, setup: ot.ControlSetup) -> None:
            self.still = np.zeros((setup.n, 3))

        def step(self, observation: ot.Observation) -> ot.Command:
            return ot.Command(self.still)

    result = ot.run(straight(), controller=Still)
    assert result.scenario.control.kind.endswith("<locals>.Still")
    assert np.ptp(result.trajectory["distance"]) < 0.002


READ = """
import sys
import omnitrack_sim as ot
from omnitrack_sim.base.errors import InputError
result = ot.load_result(sys.argv[1])
print(result.scenario.control.kind, result.scenario.control.parameters["part"], result.events[0])
try:
    ot.run(result.scenario)
except InputError as error:
    print(error.faults[0].where, "No module named 'drivers'" in str(error))
"""


def test_a_run_is_read_where_its_controller_is_unknown(drivers: ModuleType, tmp_path: Path) -> None:
    """A saved run is loaded by a process that cannot import the controller; only to run it anew is
    an error, which names the place."""
    saved = ot.run(straight(), controller=drivers.Tuned).save(tmp_path / "run")
    paths = [str(Path(ot.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, "-c", READ, str(saved)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "drivers:Tuned 0.5 0.00 s, off we go",
        "control.kind True",
    ]


@pytest.mark.parametrize(
    ("kind", "told", "choices"),
    [
        ("jacobain", "'jacobain'", {"jacobian", "paper", "equal", "module:Object"}),
        ("nowhere:Plain", "'nowhere' cannot be imported", {"jacobian", "module:Object"}),
        ("drivers:Plan", "no 'Plan' in module", {"jacobian", "drivers:Plain", "drivers:Tuned"}),
        ("drivers:NoController", "no class with a step", {"jacobian", "module:Object"}),
        ("drivers:function", "no class with a step", {"jacobian", "module:Object"}),
        (":Plain", "':Plain'", {"jacobian", "module:Object"}),
    ],
)
def test_an_unknown_controller_is_a_fault(
    drivers: ModuleType, kind: str, told: str, choices: set[str]
) -> None:
    """A ``ScenarioError`` names ``control.kind``, what was looked for, and the choices."""
    fault = faults_of(**{"control.kind": kind})["control.kind"]
    assert told in fault.problem
    assert choices <= set(fault.choices)


def test_a_module_that_fails_is_a_fault(drivers: ModuleType) -> None:
    """Whatever a module raises while it is imported is told at ``control.kind``."""
    Path(drivers.__file__ or "").with_name("broken.py").write_text("1 / 0", encoding="utf-8")
    assert "division by zero" in faults_of(**{"control.kind": "broken:Any"})["control.kind"].problem


def test_modules_are_found_in_the_working_folder(tmp_path: Path) -> None:
    """The command line finds a module beside where it is called, as ``python`` does a script's."""
    (tmp_path / "beside.py").write_text(MODULE, encoding="utf-8")
    paths = [str(Path(ot.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    changes = ["control.kind=beside:Tuned", "control.parameters.part=0.7", "run.time_limit=0.1"]
    options = [part for change in changes for part in ("--set", change)]
    done = subprocess.run(
        [Path(sys.executable).with_name("omnitrack"), "run", "straight", "--no-video", *options],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    result = ot.load_result(tmp_path / "out" / "straight")
    assert result.scenario.control.parameters["part"] == 0.7


def test_a_sweep_over_controllers_and_their_parameters(drivers: ModuleType) -> None:
    """A worker imports the user's module and gives the table of this process."""
    kinds = {"path": "control.kind", "kind": "list", "values": ["jacobian", "drivers:Plain"]}
    parts = {"path": "control.parameters.part", "kind": "list", "values": [0.25, 0.5]}
    by_kind = resolve({"name": "kinds", "base": "straight", "set": BRIEF, "axes": [kinds]})
    tuned = {"control.kind": "drivers:Tuned"}
    by_part = resolve({"name": "p", "base": "straight", "set": BRIEF | tuned, "axes": [parts]})
    with LocalPool(1) as pool:
        for sweep in (by_kind, by_part):
            alone = ot.run_trials(sweep).table
            assert alone["outcome"].to_pylist() == ["timed_out"] * 2, alone["reason"].to_pylist()
            assert ot.run_trials(sweep, executor=pool).table.equals(alone)
    speeds = ot.run_trials(by_part).table["mean_speed_m_s"].to_pylist()
    assert speeds == pytest.approx([0.025, 0.05], rel=0.15)
    misspelt = kinds | {"values": ["drivers:Nil"]}
    with pytest.raises(ot.SweepError) as caught:
        resolve({"name": "kinds", "base": "straight", "axes": [misspelt]})
    (fault,) = caught.value.faults
    assert fault.where == "axes.0.values.0"
    assert "drivers:Plain" in fault.choices


def test_a_class_that_the_scenario_names_keeps_its_parameters(tmp_path, monkeypatch) -> None:
    """Handed over, the class that ``control.kind`` names already runs with the scenario's own
    parameters."""
    code = """
import numpy as np
from pydantic import BaseModel
import omnitrack_sim as ot

class Part(BaseModel):
    speed: float = 0.1

class Steady:
    Parameters = Part

    def __init__(self, setup):
        self.speed = setup.each("speed")

    def step(self, observation):
        return ot.Command(belt_speed=np.repeat(self.speed[:, None], 3, axis=1))
"""
    (tmp_path / "steady_control.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    changes = {
        "run.time_limit": 0.5,
        "control.kind": "steady_control:Steady",
        "control.parameters.speed": 0.05,
    }
    scenario = ot.override(ot.load_scenario("straight"), changes)
    from steady_control import Steady  # type: ignore[import-not-found]

    named, handed = ot.run(scenario), ot.run(scenario, controller=Steady)
    assert handed.scenario.control.parameters == {"speed": 0.05}
    assert named.metrics["distance_m"] == handed.metrics["distance_m"]


def test_a_module_may_lie_beside_the_scenario(tmp_path: Path) -> None:
    """Its class is found from any working folder, also by the workers of a sweep; a second module
    of its name beside another scenario is refused, not taken for the first."""
    for folder in ("one", "two"):
        place = tmp_path / folder
        place.mkdir()
        (place / "beside_it.py").write_text(MODULE, encoding="utf-8")
        text = 'control.kind = "beside_it:Plain"\npipes = [{ kind = "straight", length = 0.6 }]\n'
        (place / "mine.toml").write_text(text, encoding="utf-8")
    scenario = ot.load_scenario(tmp_path / "one" / "mine.toml", {"run.time_limit": 0.02})
    sweep = ot.Sweep(name="s", bases={"mine": scenario}, set={})
    assert ot.run_trials(sweep, executor=lambda: LocalPool(1)).table.num_rows == 1
    with pytest.raises(ot.ScenarioError, match=r"two.beside_it\.py has the name of .*one"):
        ot.load_scenario(tmp_path / "two" / "mine.toml")
