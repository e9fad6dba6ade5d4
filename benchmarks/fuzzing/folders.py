"""What is done with a damaged folder: read it, and go on with what is accepted."""

from __future__ import annotations

import json
import random
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fuzzing import bases
from fuzzing.damage import damaged, removed
from fuzzing.desk import Desk

if TYPE_CHECKING:
    from omnitrack_sim import Result

READING, DRAWING = 5.0, 30.0
"""Seconds of processor time that reading may take, and pictures or the rest of a sweep."""
KINDS = {
    "run": 5,
    "plan": 4,
    "passport": 2,
    "policy": 2,
    "robot": 3,
    "town": 1,
    "plant": 2,
    "scan": 2,
}
"""How often which kind of folder comes."""
WHOLE = 0.02
"""Part of the folders that are hit as a whole."""
ROBOT = """
robot = { kind = "mjcf", file = "it/robot.xml", bore = 0.16 }
pipes = [{ kind = "straight", length = 0.6 }]
"""
"""Scenario of a model."""
PLOTTED, FILMED = 6, 40
"""Every which run that was read is plotted, and filmed."""


def prepare() -> None:
    """Load what the cases need, and make the folders."""
    import wntr  # noqa: F401

    from fuzzing import reading

    reading.prepare()
    bases.folders()


def laid_out(seed: int, number: int, folder: Path) -> tuple[str, str, str]:
    """Make the damaged folder of that number; its kind, its name, and what was done to it."""
    rng = random.Random(f"folder {seed} {number}")
    kind = rng.choices(list(KINDS), list(KINDS.values()))[0]
    known = bases.folders()[kind]
    name, other = rng.choice(sorted(known)), rng.choice(sorted(known))
    bases.lay_out(known[name], folder)
    if rng.random() < WHOLE:
        return kind, name, removed(rng, folder)
    others = {Path(path).name: data for path, data in known[other].items()}
    return kind, name, "; ".join(damaged(rng, folder, others, rng.choice((1, 1, 1, 2))))


def attempt(seed: int, number: int, desk: Desk) -> None:
    """Read the folder of that number, and go on with it as far as it gets."""
    kind, name, _ = laid_out(seed, number, desk.folder / "it")
    tries: dict[str, Callable[[], None]] = {
        "run": lambda: _try_run(number, desk),
        "plan": lambda: _try_plan(name.removeprefix("half a "), desk),
        "passport": lambda: _try_passport(desk),
        "policy": lambda: _try_policy(desk),
        "robot": lambda: _try_robot(desk),
        "town": lambda: _try_import("it/town.inp", desk),
        "plant": lambda: _try_import("it/plant.pcf", desk),
        "scan": lambda: _try_scan(desk),
    }
    tries[kind]()


def keep(seed: int, number: int, folder: Path) -> None:
    """Keep the folder of a case."""
    place = folder / f"folder_{seed}_{number}"
    shutil.rmtree(place, ignore_errors=True)
    kind, name, story = laid_out(seed, number, place / "it")
    (place / "story.txt").write_text(
        f"{kind} {name}: {story}\n", encoding="utf-8", errors="replace"
    )


def _try_run(number: int, desk: Desk) -> None:
    from omnitrack_sim import OmnitrackError, load_result

    folder = desk.folder / "it"
    result, error = desk.attempt(
        "load_result", READING, lambda: load_result(folder), OmnitrackError
    )
    if error is not None:
        desk.command(["render", "it", "--out", "film.mp4"], READING, (2,))
        desk.only("refusing a run", "it")
    if result is None:
        return
    uses = {
        "timeline": result.timeline,
        "repr": lambda: repr(result),
        "summary": lambda: json.dumps(result.summary()),
        "phase_spans": result.trajectory.phase_spans,
        "routes": result.routes,
        "save": lambda: load_result(result.save(desk.folder / "again")),
    }
    for name, use in uses.items():
        desk.attempt(f"a run that was read: {name}", READING, use, OmnitrackError)
        if desk.faults:
            return
    if number % PLOTTED == 0:
        desk.attempt(
            "a run that was read: plots", DRAWING, lambda: _draw(result, desk), OmnitrackError
        )
    if number % FILMED == 0:
        desk.command(["render", "it", "--out", "film.mp4"], DRAWING)
    desk.only("using a run", "it", "again", "summary.png", "map.png", "film.mp4")


def _draw(result: Result, desk: Desk) -> None:
    from omnitrack_sim import plot_mission, plot_summary

    plot_summary(result, path=desk.folder / "summary.png")
    plot_mission(result, path=desk.folder / "map.png")


def _try_plan(name: str, desk: Desk) -> None:
    """Go on with a damaged plan: a clean error, or the table that it would have had."""
    from omnitrack_sim import OmnitrackError, run_trials

    doing, folder = f"resuming a {name}", desk.folder / "it"
    plan = bases.plans()[name]
    result, _ = desk.attempt(doing, DRAWING, lambda: run_trials(plan, out=folder), OmnitrackError)
    desk.only(doing, "it")
    if result is None:
        return
    whole = run_trials(plan).table
    if result.table.num_rows != whole.num_rows:
        desk.add("rows lost", doing, f"{result.table.num_rows} rows of {whole.num_rows}")
    if left := [path.name for path in folder.rglob(".*")]:
        desk.add("left behind", doing, ", ".join(left))


def _try_passport(desk: Desk) -> None:
    from omnitrack_sim import (
        InputError,
        OmnitrackError,
        load_network,
        load_passport,
        map_reach,
    )

    passport, error = desk.attempt(
        "load_passport", READING, lambda: load_passport("it"), InputError
    )
    if error is not None:
        desk.command(["reach", "fig14", "--passport", "it"], READING, (2,))
    if passport is not None:
        desk.attempt("summary", READING, lambda: json.dumps(passport.summary()), OmnitrackError)
        network = load_network("knee_and_tee")
        desk.attempt("map_reach", DRAWING, lambda: map_reach(network, passport), OmnitrackError)
    desk.only("reading a passport", "it")


def _try_policy(desk: Desk) -> None:
    from omnitrack_sim import InputError, load_policy

    file = "it/policy.npz"
    policy, error = desk.attempt("load_policy", READING, lambda: load_policy(file), InputError)
    desk.command(["policies", file], READING, (2,) if error else (0,))
    if policy is None:
        return

    def again() -> None:
        policy.save("again.npz")
        rows = np.random.default_rng(0).normal(size=(4, policy.network.inputs))
        assert (load_policy("again.npz")(rows) == policy(rows)).all(), "differs when read again"

    desk.attempt("the same policy again", READING, again, InputError)
    desk.only("reading a policy", "it", "again.npz")


def _try_robot(desk: Desk) -> None:
    from fuzzing.reading import BUILDING, first_steps
    from omnitrack_sim import InputError, OmnitrackError, load_scenario

    (desk.folder / "odd.toml").write_text(ROBOT)
    scenario, error = desk.attempt(
        "load a model", READING, lambda: load_scenario("odd.toml"), InputError
    )
    if error is not None:
        desk.command(["run", "odd.toml", "--no-video"], READING, (2,))
    if scenario is not None:
        desk.attempt(
            "steps of a model", BUILDING, lambda: first_steps(scenario, desk), OmnitrackError
        )
    # MuJoCo's own warnings, as of a NaN in the file, are for the user.
    desk.faults = [fault for fault in desk.faults if fault.what != "prints"]
    desk.only("reading a model", "it", "odd.toml", "run")


def _try_scan(desk: Desk) -> None:
    from omnitrack_sim import InputError, Straight, load_profile

    read, _ = desk.attempt("read a scan", READING, lambda: load_profile("it/scan.csv"), InputError)
    if read is not None:
        desk.attempt("a pipe of it", READING, lambda: Straight(0.5, profile=read), InputError)
    # That gaps are filled is for the user.
    desk.faults = [fault for fault in desk.faults if "has no ray" not in fault.detail]
    desk.only("reading a scan", "it")


def _try_import(file: str, desk: Desk) -> None:
    from omnitrack_sim import InputError, import_network
    from omnitrack_sim.pipes.network import validate

    read, error = desk.attempt("import", READING, lambda: import_network(file), InputError)
    desk.command(["import", file], READING, (2,) if error else (0,))
    if read is None:
        return

    def again() -> None:
        network = read.network
        assert validate(tomllib.loads(network.to_toml())) == network, "differs when read again"

    desk.attempt("the same network again", READING, again, InputError)
    desk.only("reading a file of another program", "it")
