"""Real folders of runs, plans and single files, to be damaged. Made once, kept as bytes."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from omnitrack_sim import Plan, Result, Scenario
    from omnitrack_sim.base.naming import ShippedKind

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


@cache
def plans() -> dict[str, Plan]:
    """Plans of a few short trials by name, one of each kind."""
    from omnitrack_sim import Bench, PassportPlan
    from omnitrack_sim.trials import study_file, sweep_file

    short = {"run.time_limit": 0.05}
    axis = {"path": "world.friction", "kind": "list", "values": [0.5, 0.7, 0.8, 0.9]}
    variable = {"path": "robot.preload", "low": 20, "high": 30}
    objective = {"metric": "distance_m", "goal": "maximise", "failed": "count"}
    sweep = {"name": "small", "base": "straight", "set": short, "batch": 2, "axes": [axis]}
    search = {"variables": [variable], "objectives": [objective], "trials": [sweep]}
    search |= {"name": "small", "generations": 1, "population": 4, "final": {"candidates": 0}}
    return {
        "sweep": sweep_file.resolve(sweep),
        "study": study_file.resolve(search),
        "bench": Bench.of("control", ["elbow"], ["feedback"], trials=2, changes=short),
        "passport": PassportPlan.of("presser", courses=["straight"], trials=2, changes=short),
    }


@cache
def folders() -> dict[str, dict[str, Contents]]:
    """Folders by kind and name: runs, plans whole and with half of their batches, single files."""
    whole = {name: _finished(plan) for name, plan in plans().items()}
    half = {f"half a {name}": _half(plans()[name], files) for name, files in whole.items()}
    alike = {"small": {"passport.parquet": whole["passport"]["passport.parquet"]}}
    return {
        "run": runs(),
        "plan": whole | half,
        "passport": _shipped("passports") | alike,
        "policy": _shipped("policies"),
        "robot": _models("presser", "inchworm"),
        "town": {"small": {"town.inp": TOWN.encode()}},
        "plant": {"small": {"plant.pcf": PLANT.encode()}},
        "scan": {"small": {"scan.csv": SCAN.encode()}},
    }


def _finished(plan: Plan) -> Contents:
    from omnitrack_sim import run_trials

    with tempfile.TemporaryDirectory() as place:
        run_trials(plan, out=Path(place) / "it")
        return contents(Path(place) / "it")


def _half(plan: Plan, files: Contents) -> Contents:
    """Record and first half of the parts, as an interruption leaves them."""
    parts = sorted(name for name in files if name.startswith("parts/"))
    return {name: files[name] for name in (f"{plan.noun}.json", *parts[: len(parts) // 2])}


def _shipped(kind: ShippedKind) -> dict[str, Contents]:
    """Files of the package by name, each under the last word of its kind."""
    from omnitrack_sim import shipped_files

    noun = {"passports": "passport", "policies": "policy"}[kind]
    files = shipped_files(kind).items()
    return {name: {f"{noun}{path.suffix}": path.read_bytes()} for name, path in files}


def _models(*robots: str) -> dict[str, Contents]:
    """Models of robots of the package, with all that their files name."""
    from omnitrack_sim.robots import kinds

    folders = {name: Path(kinds.__file__).parent / name for name in robots}
    return {
        name: {path.name: path.read_bytes() for path in folder.glob("*.xml")}
        for name, folder in folders.items()
    }


TOWN = """[JUNCTIONS]
A 10
B 11
C 10
D 0
[RESERVOIRS]
R 12
[PIPES]
p1 R A 100 200 100 0 Open
p2 A B 50 200 100 0 Open
p3 A C 40 100 100 0 Closed
p4 B D 30 100 100 0 Open
[PUMPS]
u B C POWER 5
[COORDINATES]
R 0 0
A 100 0
B 150 0
C 100 40
D 150 30
[OPTIONS]
UNITS LPS
HEADLOSS H-W
[END]
"""
SCAN = "length_mm,angle_deg,radius_mm\n" + "".join(
    f"{s},{a},{80 + (s + a) % 3}\n" for s in range(0, 500, 50) for a in range(0, 360, 30)
)
PLANT = """ISOGEN-FILES ISOGEN.FLS
UNITS-BORE INCH
UNITS-CO-ORDS MM
PIPELINE-REFERENCE P-1
    PIPING-SPEC CS150
PIPE
    END-POINT 0.0 0.0 0.0 4 PL
    END-POINT 1000.0 0.0 0.0 4 BW
ELBOW
    END-POINT 1000.0 0.0 0.0 4
    END-POINT 1152.0 152.0 0.0 4
    CENTRE-POINT 1152.0 0.0 0.0
    SKEY ELBW
    ANGLE 9000
TEE
    END-POINT 1152.0 152.0 0.0 4
    END-POINT 1152.0 362.0 0.0 4
    CENTRE-POINT 1152.0 257.0 0.0
    BRANCH1-POINT 1257.0 257.0 0.0 4
REDUCER-CONCENTRIC
    END-POINT 1257.0 257.0 0.0 4
    END-POINT 1359.0 257.0 0.0 3
    SKEY RCBW
PIPE
    END-POINT 1152.0 362.0 0.0 4
    END-POINT 1152.0 2362.0 0.0 4
WELDOLET
    CENTRE-POINT 1152.0 1362.0 0.0
    BRANCH1-POINT 1152.0 1362.0 95.0 2
    SKEY WTBW
VALVE
    END-POINT 1152.0 2362.0 0.0 4
    END-POINT 1152.0 2591.0 0.0 4
    SKEY VTBW
    STATUS CLOSED
PIPE
    END-POINT 1152.0 2591.0 0.0 4
    END-POINT 1152.0 3591.0 0.0 4
CAP
    END-POINT 1152.0 3591.0 0.0 4
"""


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
