"""How fast the tee turn runs, and what takes the time.

python benchmarks/speed.py [--trials N] [--quick]

Prints simulated seconds per wall second on one thread and trials per second on two, the shares of
physics, control and recording, of collision and solver within the physics, and the peak memory.
Before it prints it checks that the work was done right: all trials reach the goal.
"""

from __future__ import annotations

import resource
import time

import mujoco
import numpy as np
from shape import Arguments
from shares import Shares, timed
from tee_turns import random_tee_turns

from omnitrack_sim import Outcome, Simulation, load_scenario

EXACT = {"physics.collider": "exact"}


def timed_batch(trials: int, threads: int) -> tuple[Simulation, float, Shares]:
    """A batch of tee turns, run to its end, its wall seconds and what took them."""
    ranges = {"theta5_deg": 5.0, "preload": (25.0, 30.0), "friction": (0.95, 1.0)}
    simulation = Simulation(random_tee_turns(trials, **ranges, changes=EXACT), threads=threads)
    start = time.perf_counter()
    shares = timed(simulation)
    return simulation, time.perf_counter() - start, shares


def physics_shares(steps: int = 2000) -> dict[str, float]:
    """Shares of collision, constraint assembly and solver in a step of a robot in the tee's run."""
    scenario = load_scenario("tee_turn", EXACT)
    model = scenario.to_spec().compile()
    data = Simulation([scenario]).data(0)
    mujoco.mj_step(model, data, 200)
    data.timer.duration[:] = 0
    mujoco.mj_step(model, data, steps)
    kinds = mujoco.mjtTimer
    total = data.timer[kinds.mjTIMER_STEP].duration
    parts = {
        "collision": kinds.mjTIMER_POS_COLLISION,
        "constraints": kinds.mjTIMER_POS_MAKE,
        "solver": kinds.mjTIMER_CONSTRAINT,
        "kinematics": kinds.mjTIMER_POS_KINEMATICS,
    }
    return (
        {name: data.timer[kind].duration / total for name, kind in parts.items()} if total else {}
    )


def main() -> None:
    """Run the batches, check them, and print what they cost."""
    trials = Arguments(__doc__, trials=24, quick=4).read().trials
    single, wall, shares = timed_batch(trials, 1)
    simulated = float(single.end_time.sum())
    outcomes = [ending and ending.outcome for ending in single.endings]
    assert all(outcome is Outcome.REACHED_GOAL for outcome in outcomes), outcomes
    double, wall_two, _ = timed_batch(trials, 2)
    assert np.array_equal(double.end_time, single.end_time)

    robot = single.scenarios[0].robot
    print(f"tee turn, {robot.lugs_per_track} lugs a track, 2 ms, {trials} trials, all passed")
    print(f"one thread   {simulated / wall:7.1f} simulated s / wall s")
    print(
        f"two threads  {trials / wall_two:7.2f} trials / s, {wall / wall_two:.2f} times one thread"
    )
    for name, seconds in (
        ("physics", shares.physics),
        ("control", shares.control),
        ("recording", shares.recording),
    ):
        print(f"{name:12s} {100 * seconds / wall:7.1f} % of the wall time")
    for name, part in physics_shares().items():
        print(f"  {name:10s} {100 * part:7.1f} % of a physics step")
    print(f"peak memory  {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:7.0f} MB")


if __name__ == "__main__":
    main()
