"""How fast the tee turn runs, and what takes the time.

python benchmarks/speed.py [--trials N] [--quick] [--primitives]

Prints simulated seconds per wall second on one thread and trials per second on two, the shares of
physics, control and recording, of collision and solver within the physics, and the peak memory.
Before it prints it checks that the work was done right: all trials reach the goal. With
``--primitives`` walls are boxes and capsules, checked to lie within 0.1 mm of the exact ones.
"""

from __future__ import annotations

import resource
import time

import mujoco
import numpy as np
from shape import Arguments
from shares import Shares, timed
from tee_turns import random_tee_turns

from omnitrack_sim import Outcome, Simulation, load_scenario, override


def timed_batch(trials: int, threads: int, collider: str) -> tuple[Simulation, float, Shares]:
    """A batch of tee turns, run to its end, its wall seconds and what took them."""
    ranges = {"theta5_deg": 5.0, "preload": (25.0, 30.0), "friction": (0.95, 1.0)}
    scenarios = random_tee_turns(trials, **ranges, changes={"physics.collider": collider})
    simulation = Simulation(scenarios, threads=threads)
    start = time.perf_counter()
    shares = timed(simulation)
    return simulation, time.perf_counter() - start, shares


def physics_shares(collider: str, steps: int = 2000) -> dict[str, float]:
    """Shares of collision, constraint assembly and solver in a step of a robot in the tee's run."""
    scenario = override(load_scenario("tee_turn"), {"physics.collider": collider})
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


def check_walls(rays: int = 4000) -> float:
    """Largest distance, m, of ray hits from the exact surface, on the straights of the tee turn."""
    scenario = override(load_scenario("tee_turn"), {"physics.collider": "primitives"})
    network = scenario.route.network
    model = scenario.to_spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    origin = np.zeros((rays, 3))
    origin[:, 2] = rng.uniform(0.02, 0.25, rays)
    angle = rng.uniform(-np.pi, np.pi, rays)
    across = np.stack([np.cos(angle), np.sin(angle), np.zeros(rays)], axis=-1)
    groups = np.array([0, 0, 0, 1, 0, 0], np.uint8)
    robot = model.body("chassis").id
    data.qpos[:3] = [5.0, 0.0, 0.0]  # the robot is out of the way
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, np.int32)
    length = [
        mujoco.mj_ray(model, data, p, v, groups, 1, robot, hit)
        for p, v in zip(origin, across, strict=True)
    ]
    distance, _ = network.signed_distance(origin + across * np.array(length)[:, None])
    return float(np.abs(distance).max())


def main() -> None:
    """Run the batches, check them, and print what they cost."""
    arguments = Arguments(__doc__, trials=24, quick=4)
    arguments.add_argument("--primitives", action="store_true", help="walls of boxes and capsules")
    options = arguments.read()
    collider, trials = "primitives" if options.primitives else "exact", options.trials

    # Exact walls are checked by tests/test_collider.py.
    wall_error = check_walls() if options.primitives else 0.0
    assert wall_error <= 1e-4, f"walls are off by {1000 * wall_error:.3f} mm"
    single, wall, shares = timed_batch(trials, 1, collider)
    simulated = float(single.end_time.sum())
    outcomes = [ending and ending.outcome for ending in single.endings]
    assert all(outcome is Outcome.REACHED_GOAL for outcome in outcomes), outcomes
    double, wall_two, _ = timed_batch(trials, 2, collider)
    assert np.array_equal(double.end_time, single.end_time)

    robot = single.scenarios[0].robot
    walls = f"walls within {1000 * wall_error:.3f} mm" if options.primitives else "exact walls"
    print(
        f"tee turn, {robot.lugs_per_track} lugs a track, 2 ms, {walls}, {trials} trials, all passed"
    )
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
    for name, part in physics_shares(collider).items():
        print(f"  {name:10s} {100 * part:7.1f} % of a physics step")
    print(f"peak memory  {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:7.0f} MB")


if __name__ == "__main__":
    main()
