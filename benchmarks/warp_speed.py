"""Speed of robots in exact walls in MuJoCo Warp, and whether they end as on the processor.

    python benchmarks/warp_speed.py [--quick] [--steps 500]

Prints three tables, each as soon as it is measured:

* for 1,024, 8,192 and 32,768 worlds (with --quick 16 and 64) of the robot of docs/how-to/gpu.md,
  which climbs over a tee: steps of all worlds a second, memory, the part of a step that is finding
  contacts with walls, and how far the robots have come against one that MuJoCo steps;
* for as many environments of tee turns: decisions and steps of all worlds a second, memory;
* of 1,024 random tee turns (with --quick 2) under the default controller how many pass on the
  processor and on the device, how many end alike, and the time that both take.

On a GPU steps are graphs; it takes some minutes, most of them for compilation.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from shape import Arguments, table

import omnitrack_sim as ot
import omnitrack_sim.warp as exact
from omnitrack_sim.paper.experiments import random_tee_turns
from omnitrack_sim.robots.feature import DECISION_PERIOD

PAGE = Path(__file__).parents[1] / "docs/how-to/gpu.md"
TURNS, FEW_TURNS = 1024, 2
DECISIONS, FEW_DECISIONS = 50, 2
WORLDS, FEW_WORLDS = (1024, 8192, 32768), (16, 64)
CONTACTS, ROWS = 32, 128
"""Room in a world for contacts, on average, and for rows of constraints."""


def robot() -> mujoco.MjModel:
    """Return the model of the page's robot in its tee."""
    block = re.search(r"```python\n(.*?)\nm = ", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert block is not None
    names: dict[str, Any] = {}
    exec(compile(block[1], str(PAGE), "exec"), names)
    return names["model"]


def graph(work: Callable[[], None]) -> Callable[[], None]:
    """Return work as a CUDA graph; as it is where there is no GPU."""
    work()
    if not wp.get_device().is_cuda:
        return work
    with wp.ScopedCapture() as capture:
        work()
    return lambda: wp.capture_launch(capture.graph)


def seconds(work: Callable[[], None], count: int) -> float:
    """Return the time of one of ``count`` goes."""
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(count):
        work()
    wp.synchronize()
    return (time.perf_counter() - start) / count


def row(model: mujoco.MjModel, worlds: int, steps: int) -> list[str]:
    """Measure a number of worlds."""
    device = wp.get_device()
    before = device.free_memory
    m = exact.put_model(model)
    d = mjw.make_data(model, nworld=worlds, nconmax=CONTACTS, njmax=ROWS)
    d.ctrl.fill_(4.0)
    step = graph(lambda: mjw.step(m, d))
    whole = seconds(step, steps)
    walls = graph(lambda: m.callback.contactfilter(m, d))
    d.nacon.zero_()
    part = seconds(walls, 20)
    memory = (before - device.free_memory) / worlds / 1024
    # What is timed has to be right: as far as MuJoCo's robot comes in as many steps.
    data = mujoco.MjData(model)
    data.ctrl[:] = 4.0
    taken = steps + (2 if device.is_cuda else 1)
    mujoco.mj_step(model, data, taken)
    apart = np.abs(d.qpos.numpy()[:, 2] - data.qpos[2]).max()
    return [
        f"{worlds:,}",
        f"{worlds / whole:,.0f}",
        f"{memory:.0f}" if device.is_cuda else "-",
        f"{100 * part / whole:.0f} %",
        f"{1e6 * apart:.0f}",
    ]


def env_row(worlds: int, decisions: int) -> list[str]:
    """Measure a number of environments, whose robots drive straight on."""
    device = wp.get_device()
    before = device.free_memory
    env = exact.WarpVectorEnv("tee_turn", num_envs=worlds, starts=min(worlds, 1024))
    env.reset(seed=1)
    actions = wp.full((worlds, 4), 0.5, dtype=float)
    actions[:, 3].zero_()
    env.step(actions)
    whole = seconds(lambda: env.step(actions), decisions)
    memory = (before - device.free_memory) / worlds / 1024
    steps = round(DECISION_PERIOD / env.model.opt.timestep)
    return [
        f"{worlds:,}",
        f"{worlds / whole:,.0f}",
        f"{steps * worlds / whole:,.0f}",
        f"{memory:.0f}" if device.is_cuda else "-",
    ]


def turn_rows(count: int) -> list[list[str]]:
    """Drive random tee turns on the processor and on the device."""
    scenarios = random_tee_turns(ot.load_scenario("tee_turn"), count, (0.6, 1.0))
    told, rows = [], []
    for name, make in (("processor", None), ("device", exact.make_plant)):
        start = time.perf_counter()
        simulation = ot.Simulation(scenarios, threads=0, recording=False, make_plant=make)
        simulation.advance()
        told.append([ending.outcome for ending in simulation.endings if ending is not None])
        passed = sum(outcome is ot.Outcome.REACHED_GOAL for outcome in told[-1])
        alike = sum(one is other for one, other in zip(told[0], told[-1], strict=True))
        taken = f"{time.perf_counter() - start:.1f}"
        rows.append([name, f"{count:,}", f"{passed:,}", f"{alike:,}", taken])
    return rows


def main() -> None:
    """Measure and print the tables."""
    arguments = Arguments(__doc__, trials=500, quick=50, of="steps")
    read, model = arguments.read(), robot()
    heads = ("worlds", "steps a second", "KiB a world", "walls", "apart, um")
    counts = FEW_WORLDS if read.quick else WORLDS
    lines = (row(model, worlds, read.steps) for worlds in counts)
    table("speed", heads, lines, f"Steps of 2 ms on {wp.get_device().name}:")
    heads = ("environments", "decisions a second", "steps a second", "KiB a world")
    decisions = FEW_DECISIONS if read.quick else DECISIONS
    table("environments", heads, (env_row(n, decisions) for n in counts), "Tee turns:")
    heads = ("by", "turns", "passed", "ended as on the processor", "seconds")
    table("turns", heads, turn_rows(FEW_TURNS if read.quick else TURNS), "Random tee turns:")


if __name__ == "__main__":
    main()
