"""Real runs and a real sweep, whose folders are then damaged. Made once, kept as bytes."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omnitrack_sim import Result, Scenario, Sweep

Contents = Mapping[str, bytes]
"""The files of a folder by their paths below it."""


@cache
def runs() -> dict[str, Contents]:
    """Folders of runs by name: straight, a turn, a mission of several legs, a diverged one."""
    from omnitrack_sim import load_scenario, override, run

    short: dict[str, Any] = {"run.time_limit": 0.2}
    turn = {"start.distance": 0.3, "start.theta5_deg": 50.0, **short}
    results = {
        "plain": run(override(load_scenario("straight"), short)),
        "turn": run(override(load_scenario("tee_turn"), turn)),
        "mission": run(_there_and_back()),
        "diverged": _diverged(override(load_scenario("straight"), short)),
    }
    return {name: _saved(result) for name, result in results.items()}


def _there_and_back() -> Scenario:
    from omnitrack_sim.scenario import validate

    pipes = [{"kind": "straight", "name": name, "length": 0.2} for name in ("a", "b")]
    return validate(
        {
            "name": "there_and_back",
            "network": {"fittings": pipes, "joints": [{"ports": ["a.end", "b.start"]}]},
            "mission": {"start": "a.start", "goals": ["b.end", "a.start"]},
            "control": {"cruise_speed": 0.15},
        }
    )


def _diverged(scenario: Scenario) -> Result:
    """A run whose joint positions become infinite on the way.

    MuJoCo does not tell it on the screen.
    """
    import mujoco
    import numpy as np

    from omnitrack_sim import Simulation

    simulation = Simulation([scenario])
    for _ in range(5):
        simulation.step()
    simulation.plant.qpos[0, 0] = np.inf
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = False
    silent.set()
    try:
        simulation.advance()
    finally:
        before.set()
    return simulation.results()[0]


def _saved(result: Result) -> Contents:
    with tempfile.TemporaryDirectory() as place:
        return contents(result.save(Path(place) / "run"))


SWEEP: Mapping[str, Any] = {
    "name": "small",
    "base": "straight",
    "batch": 2,
    "set": {"run.time_limit": 0.05},
    "axes": [{"path": "world.friction", "kind": "list", "values": [0.5, 0.7, 0.8, 0.9]}],
}


@cache
def sweep() -> Sweep:
    """A sweep of four trials in two batches."""
    from omnitrack_sim.trials.sweep_file import resolve

    return resolve(SWEEP)


@cache
def sweeps() -> dict[str, Contents]:
    """Folders of that sweep by name: finished, and with half of its batches."""
    from omnitrack_sim import run_trials

    with tempfile.TemporaryDirectory() as place:
        run_trials(sweep(), out=Path(place) / "sweep")
        finished = contents(Path(place) / "sweep")
    parts = sorted(name for name in finished if name.startswith("parts/"))
    half = {name: finished[name] for name in ("sweep.json", parts[0])}
    return {"finished": finished, "half": half}


def contents(folder: Path) -> Contents:
    """The files of a folder."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def lay_out(files: Contents, folder: Path) -> None:
    """Write the files into a folder that is made for them."""
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
