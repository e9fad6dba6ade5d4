"""Ends of commands: surroundings that fail, interruptions, and numbers that are none."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from commands import omnitrack

import omnitrack_sim as ot
from omnitrack_sim.base.errors import ScenarioError
from omnitrack_sim.results.provenance import environment, unlike, warn_of_unlike
from omnitrack_sim.scenario import validate

COMMAND = [sys.executable, "-m", "omnitrack_sim.cli"]


def test_a_renderer_that_there_is_not_is_refused(monkeypatch):
    """MuJoCo would fail to be imported, wherever that is; valid ones pass in any spelling."""
    monkeypatch.setenv("MUJOCO_GL", "foo")
    done = omnitrack("network", "tower")
    assert done.returncode == 2
    assert "MUJOCO_GL: is 'foo' (choose from: glfw" in done.stderr
    for name in ("EGL", " glfw ", "off", ""):
        monkeypatch.setenv("MUJOCO_GL", name)
        assert omnitrack("network", "tower").returncode == 0


def test_a_working_folder_that_is_gone_is_told():
    """Every path would be looked for in it."""
    code = "import os, sys, tempfile, shutil; place = tempfile.mkdtemp(); os.chdir(place)"
    code += "; shutil.rmtree(place); from omnitrack_sim.cli import main; main()"
    # As the console script: where the folder itself is on the path, Python 3.13 fails to import.
    command = [sys.executable, "-P", "-c", code, "network", "tower"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: working folder: cannot be used (No such file or directory)")


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", [["--version"], ["network", "tower", "--json"]])
def test_what_cannot_be_printed_is_an_error(arguments, unbuffered):
    """Standard output on a full disk, at the first line or only as the command ends."""
    environ = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run(
            [*COMMAND, *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=environ,
            timeout=60,
        )
    assert done.returncode == 2
    told = "error: standard output: cannot be written: No space left on device"
    assert done.stderr.splitlines() == [told]


@pytest.mark.long
@pytest.mark.parametrize("delay", [0.08, 0.12, 0.16, 0.2, 0.3, 0.5])
def test_an_interruption_while_it_starts_ends_quietly(delay, tmp_path):
    """From the first tenth of a second on, before the commands are imported and after."""
    process = subprocess.Popen(
        [*COMMAND, "run", "straight", "--no-video", "--out", str(tmp_path / "run")],
        stderr=subprocess.PIPE,
        text=True,
        # Of tests that a shell runs in the background it is ignored.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    # Python itself ends by the signal before it has begun.
    assert process.returncode in (130, -signal.SIGINT)
    # Nor can the command speak before Python has come to it, later on a busy machine.
    assert told in ("", "interrupted\n") or f"omnitrack_sim{os.sep}cli" not in told
    assert not (tmp_path / "run").exists()


def test_a_library_that_fails_as_it_is_interrupted_is_an_interruption():
    """A compiled module that is interrupted while it is imported may raise an error of its own."""
    code = """
from omnitrack_sim.cli import program

def app(**_):
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as error:
        raise ImportError("initialization failed") from error

program.app = app
program.run_command()
"""
    arguments = [sys.executable, "-c", code, "run"]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "")


class Sideways:
    """Asks module 2 for no number in its third step."""

    value = np.nan

    def __init__(self, setup: ot.ControlSetup) -> None:
        self.n, self.steps = setup.n, 0

    def step(self, observation: ot.Observation) -> ot.Command:
        self.steps += 1
        speed = np.full((self.n, 3), 0.1)
        if self.steps == 3:
            speed[-1, 1] = self.value
        return ot.Command(belt_speed=speed)


class Pushing:
    """Gives the last actuator no number in its second step."""

    def __init__(self, setup: ot.ControlSetup) -> None:
        self.inputs, self.steps = setup.command.ctrl, 0

    def step(self, observation: ot.Observation) -> ot.Actuation:
        self.steps += 1
        inputs = self.inputs.copy()
        if self.steps == 2:
            inputs[0, -1] = np.inf
        return ot.Actuation(inputs)


def test_a_controllers_number_that_is_none_is_told_with_its_actuator_and_time():
    """The time step is not to blame; MuJoCo would go on with zeros, or diverge."""
    straight = ot.load_scenario("straight", {"run.time_limit": 0.2})
    with pytest.raises(ot.ControllerError) as caught:
        ot.run_batch([straight] * 2, controller=Sideways, no_load=False)
    told = f"{__name__}:Sideways, step 3 (0.02 s): command.belt_speed[1, 1] is nan"
    assert str(caught.value) == told
    snake = ot.load_scenario("robots/snake_elbow", {"run.time_limit": 0.2})
    model = ot.Simulation([snake]).model
    last = model.actuator(model.nu - 1).name
    with pytest.raises(ot.ControllerError, match=rf"step 2 .* \(actuator '{last}'\) is inf"):
        ot.run(snake, controller=Pushing, no_load=False)


@pytest.mark.parametrize("goals", [[{"a": 1}], [["a"]], [3], [None], {"a": "b"}, "low"])
def test_goals_that_are_no_names_are_faults(goals):
    """Before any way is looked for."""
    mission = {"start": "inlet", "goals": goals}
    with pytest.raises(ScenarioError, match=r"mission\.goals"):
        validate({"network": "fig14", "mission": mission})


def test_results_of_unlike_machines_are_told_apart():
    """By processor, libraries and their kernels; commits and what is not known do not count."""
    own = environment()
    assert own["processor"]
    assert own["blas"]
    assert {"numpy", "scipy", "numba", "mujoco"} <= set(own["versions"])
    other = own | {"processor": "a loom", "git_commit": "0"}
    assert unlike([own, own | {"git_commit": "0"}, {}]) == ""
    assert unlike([own, other]) == f"processor: {own['processor']} / a loom"
    newer = own | {"versions": own["versions"] | {"numpy": "99"}}
    assert unlike([own, newer]).startswith("numpy: ")
    with pytest.warns(UserWarning, match="trials were made by unlike machines .*a loom"):
        warn_of_unlike([own, other], "trials")
    escape = own | {"processor": "a loom\x1b[2J"}
    with pytest.warns(UserWarning, match="a loom") as told:
        warn_of_unlike([own, escape], "trials")
    assert str(told[0].message).isprintable(), "a file could move the cursor of a terminal"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_unlike([own, own], "trials")


def test_a_sweep_that_goes_on_elsewhere_says_so(tmp_path, monkeypatch):
    """As it is finished, not where one machine has made it all."""
    sweep = ot.load_sweep("elbow_orientation", {"run.time_limit": 0.01})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ot.run_trials(sweep, out=tmp_path / "a", shard=(1, 2))
    elsewhere = environment() | {"processor": "a loom"}
    monkeypatch.setattr("omnitrack_sim.trials.batches.environment", lambda: elsewhere)
    with pytest.warns(UserWarning, match="a loom"):
        ot.run_trials(sweep, out=tmp_path / "a")


def test_runs_of_unlike_machines_are_compared_with_a_warning(tmp_path: Path):
    """And equal ones without."""
    run = ot.run(ot.load_scenario("straight", {"run.time_limit": 0.05}), no_load=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ot.compare(run, run.save(tmp_path / "run"))
    run.provenance["blas"] = "by hand"
    with pytest.warns(UserWarning, match="these runs .*by hand"):
        ot.compare(run, tmp_path / "run")
