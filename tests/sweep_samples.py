"""A small sweep, workers that die and controllers that wait, for the tests of sweeps. Workers of
other processes import this module."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omnitrack_sim.robots.omnitrack.control import ControlSetup, JacobianController
from omnitrack_sim.robots.omnitrack.control.open_loop import EqualController
from omnitrack_sim.trials.batches import Batch, Rows, run_rows
from omnitrack_sim.trials.sweep import Sweep
from omnitrack_sim.trials.sweep_file import resolve

TEXT = """
base = "straight"
samples = {samples}
batch = 3
[set]
"run.time_limit" = {time_limit}
"robot.lugs_per_track" = 3
[[axes]]
path = "control.kind"
kind = "list"
values = {kinds}
[[axes]]
path = "world.friction"
kind = "uniform"
low = 0.5
high = 1.0
[[axes]]
path = "world.gravity"
kind = "direction"
[[axes]]
path = "robot.preload"
kind = "normal"
mean = 10
std = 10
"""
KINDS = ("jacobian", "equal")
VALID = 3
"""A trial whose values fit."""
DEADLY = 4
"""The trial that ``deadly_batch`` dies of."""


def _text(samples: int, time_limit: float, kinds: Sequence[str]) -> str:
    return TEXT.format(samples=samples, time_limit=time_limit, kinds=list(kinds))


def write_sweep(
    folder: Path, samples: int = 5, time_limit: float = 0.1, kinds: Sequence[str] = KINDS
) -> Path:
    """The file of a sweep of twice ``samples`` trials, some of them invalid."""
    path = folder / "small.toml"
    path.write_text(_text(samples, time_limit, kinds), encoding="utf-8")
    return path


def small_sweep(**changes: Any) -> Sweep:
    """The same; ``changes`` replace keys of the file."""
    import tomllib

    data = tomllib.loads(_text(5, 0.1, KINDS))
    return resolve({"name": "small"} | data | changes)


def deadly_batch(batch: Batch) -> Rows:
    """As ``run_rows``, but the process dies of trial ``DEADLY``."""
    if DEADLY in [trial.index for trial in batch.trials]:
        os.kill(os.getpid(), signal.SIGKILL)
    return run_rows(batch)


def once_deadly_batch(batch: Batch) -> Rows:
    """As ``run_rows``, but the first process that comes to trial ``DEADLY`` dies."""
    mark = Path(os.environ["ONCE_DEADLY"])
    if DEADLY in [trial.index for trial in batch.trials] and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return run_rows(batch)


def parts(place: Path) -> list[Path]:
    """The part files in the folder of a sweep."""
    return sorted((place / "parts").glob("*.parquet"))


def wait_at_the_gate() -> None:
    """Wait while the sweep in the folder ``GATE_FOLDER`` has ``GATE_PARTS`` parts or more: whoever
    set the gate kills who waits there. Without a gate nobody waits."""
    folder, until = os.environ.get("GATE_FOLDER"), time.monotonic() + 600.0
    while folder and len(parts(Path(folder))) >= int(os.environ["GATE_PARTS"]):
        time.sleep(0.01)
        if time.monotonic() > until:
            raise RuntimeError("nobody came to the gate")


class Gated(JacobianController):
    """The default controller, which waits at the gate before it begins."""

    def __init__(self, setup: ControlSetup) -> None:
        wait_at_the_gate()
        super().__init__(setup)


class GatedEqual(EqualController):
    """The baseline, likewise."""

    def __init__(self, setup: ControlSetup) -> None:
        wait_at_the_gate()
        super().__init__(setup)


GATED = ("sweep_samples:Gated", "sweep_samples:GatedEqual")

FILES = ("trials.parquet", "trials.csv", "summary.json", "success_map.png", "sweep.json")
PATIENCE = 120.0
"""Seconds after which something that never comes is given up; nothing is measured by it."""


def environment(**more: object) -> dict[str, str]:
    """This process's, with the tests' own modules in the path."""
    paths = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    given = {name: str(value) for name, value in more.items()}
    return os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))} | given


def same(a: Path, b: Path, names=FILES) -> bool:
    return all((a / name).read_bytes() == (b / name).read_bytes() for name in names)
