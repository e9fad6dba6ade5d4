"""What is done with an odd file: read it as the commands do, and go on with what is accepted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from fuzzing.desk import Desk
from fuzzing.files import File, odd_file

if TYPE_CHECKING:
    from omnitrack_sim import Scenario

READING = 5.0
"""Seconds that reading a file may take, or one of its commands that runs nothing."""
BUILDING = 20.0
"""Seconds that the model and the first control steps of an accepted scenario may take."""
STEPS = 5
REAL = 40
"""Every which file is also given to commands that are processes of their own."""
SAMPLE = 8
"""Every which accepted scenario also goes through the whole of ``omnitrack run``."""


def prepare() -> None:
    """Load what the cases need, so that workers have it from the start."""
    import matplotlib.pyplot  # noqa: F401
    import mujoco  # noqa: F401
    import networkx  # noqa: F401
    import pyarrow.parquet  # noqa: F401
    import scipy.stats  # noqa: F401

    from omnitrack_sim.robots.omnitrack.track import install_lines
    from omnitrack_sim.walls.collider import install

    install()  # compiled once on a machine, which takes longer than a case may
    install_lines()
    odd_file(0, 0)


def keep(seed: int, number: int, folder: Path) -> None:
    """Keep the file of a case."""
    file = odd_file(seed, number)
    folder.mkdir(parents=True, exist_ok=True)
    ending = file.name.partition(".")[2]
    (folder / f"{file.kind}_{seed}_{number}.{ending}").write_bytes(file.data)


def attempt(seed: int, number: int, desk: Desk) -> None:
    """Read the file of that number, and go on with it as far as it gets."""
    file = odd_file(seed, number)
    path = desk.folder / file.name
    path.write_bytes(file.data)
    tries = {
        "scenario": _try_scenario,
        "sweep": _try_sweep,
        "study": _try_study,
        "suite": _try_suite,
        "network": _try_network,
    }
    desk.real = number % REAL == 0
    tries[file.kind](file, path, number, desk)
    if file.kind != "scenario":
        desk.only(f"reading a {file.kind}", file.name)


def _try_scenario(file: File, path: Path, number: int, desk: Desk) -> None:
    from omnitrack_sim import InputError, OmnitrackError, load_scenario

    scenario, error = desk.attempt(
        "load_scenario", READING, lambda: load_scenario(path), InputError
    )
    if error is not None:
        desk.command(["run", file.name, "--no-video"], READING, (2,))
        desk.only("refusing a scenario", file.name)
    if scenario is None:
        return
    desk.attempt("the same again", READING, lambda: _same_again(scenario), InputError)
    desk.attempt("first steps", BUILDING, lambda: first_steps(scenario, desk), OmnitrackError)
    desk.only("first steps", file.name, "run")
    if number % SAMPLE == 0 and not desk.faults:
        short = f"run.time_limit={STEPS * scenario.physics.control_period!r}"
        wanted = ["--set", short, "--no-video", "--out", "given"]
        desk.command(["run", file.name, *wanted], BUILDING)
        desk.only("omnitrack run", file.name, "run", "given")


def _same_again(scenario: Scenario) -> None:
    """What a run writes down of its scenario is the same scenario when it is read."""
    from omnitrack_sim.scenario import validate

    assert validate(json.loads(scenario.model_dump_json())) == scenario, "differs when read again"


def first_steps(scenario: Scenario, desk: Desk) -> None:
    """Model, a few control steps, and the result saved and read back."""
    from omnitrack_sim import load_result, override
    from omnitrack_sim.sim.run import run_batch

    short = override(scenario, {"run.time_limit": STEPS * scenario.physics.control_period})
    result = run_batch([short], no_load=False)[0]
    result.save(desk.folder / "run")
    back = load_result(desk.folder / "run")
    back.timeline()
    repr(back)
    json.dumps(back.summary(), allow_nan=False)


def _try_sweep(file: File, path: Path, _number: int, desk: Desk) -> None:
    from omnitrack_sim import InputError, load_sweep

    sweep, error = desk.attempt("load_sweep", READING, lambda: load_sweep(path), InputError)
    if error is not None:
        desk.command(["sweep", file.name], READING, (2,))
    if sweep is not None:
        desk.attempt("first trial", READING, lambda: sweep.scenario(0), InputError)
        desk.command(["sweep", file.name, "--list"], BUILDING)


def _try_study(file: File, path: Path, _number: int, desk: Desk) -> None:
    from omnitrack_sim import InputError, load_study

    _, error = desk.attempt("load_study", READING, lambda: load_study(path), InputError)
    if error is not None:
        desk.command(["optimise", file.name], READING, (2,))
    else:  # the list tells how long a trial takes, and runs one
        desk.command(["optimise", file.name, "--list"], BUILDING, (0,))


def _try_suite(file: File, path: Path, _number: int, desk: Desk) -> None:
    from omnitrack_sim import Bench, InputError

    bench, error = desk.attempt("load a suite", READING, lambda: Bench.of(path), InputError)
    if error is not None:
        desk.command(["bench", file.name], READING, (2,))
    if bench is not None:
        first = replace(bench, entries=bench.entries[:1], quick=True)
        desk.attempt("trials of a suite", BUILDING, first.sweeps, InputError)


def _try_network(file: File, path: Path, _number: int, desk: Desk) -> None:
    from omnitrack_sim import InputError, load_network
    from omnitrack_sim.pipes.network import validate

    network, error = desk.attempt("load_network", READING, lambda: load_network(path), InputError)
    desk.command(["network", file.name], READING, (2,) if error else (0,))
    if network is None:
        return
    ends = network.open_ends
    if len(ends) > 1:
        desk.command(["network", file.name, "--from", ends[0], "--to", ends[-1]], READING)

    def again() -> None:
        import tomllib

        assert validate(tomllib.loads(network.to_toml())) == network, "differs when read again"

    desk.attempt("the same again", READING, again, InputError)
