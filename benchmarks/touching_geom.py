"""Cost of a step of robots that touch the wall: exact pipes against other walls.

    python benchmarks/touching_geom.py [--repeats 2000]

Prints microseconds of processor time of three robots that climb in a straight pipe, the best of
three runs: in exact walls, in boxes and capsules, in a signed distance field of MuJoCo's, and in an
exact pipe of 300 pieces.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.robots.inchworm import Inchworm
from omnitrack_sim.robots.presser import Presser
from omnitrack_sim.robots.snake import Snake
from omnitrack_sim.walls.around import DECIDING
from omnitrack_sim.walls.geoms import add_walls

CONTROL_PERIOD = 0.02  # s
sys.path.append(str(Path(__file__).parent / "compare"))
from peer_walls import MeshSettings, sdf_walls  # noqa: E402
from shape import Arguments, table  # noqa: E402

GEOM = mujoco.mjtGeom
SHAPES = {
    "sphere": (GEOM.mjGEOM_SPHERE, [0.025, 0, 0]),
    "capsule": (GEOM.mjGEOM_CAPSULE, [0.015, 0.04, 0]),
    "wheel": (GEOM.mjGEOM_CYLINDER, [0.03, 0.01, 0]),
    "roller": (GEOM.mjGEOM_CYLINDER, [0.012, 0.04, 0]),
    "ellipsoid": (GEOM.mjGEOM_ELLIPSOID, [0.035, 0.02, 0.012]),
    "box": (GEOM.mjGEOM_BOX, [0.03, 0.02, 0.01]),
    "mesh": (GEOM.mjGEOM_MESH, [0, 0, 0]),
}


def add_body(spec: mujoco.MjSpec, shape: str) -> mujoco.MjsGeom:
    """Add a free body of one geom."""
    points = np.random.default_rng(1).normal(size=(24, 3))
    points *= 0.025 / np.linalg.norm(points, axis=1, keepdims=True)
    spec.add_mesh(name="stone", uservert=points.ravel())
    kind, size = SHAPES[shape]
    body = spec.worldbody.add_body()
    body.add_freejoint()
    geom = body.add_geom(type=kind, size=size)
    if shape == "mesh":
        geom.meshname = "stone"
    return geom


Robot = Presser | Inchworm | Snake


def step_cost(robot: Robot, walls: str, count: int, steps: int) -> str:
    """Return the cost of a step, and of collision detection, of a robot that climbs, us.

    Args:
        robot: in a straight pipe of 2 m, or of 1 m a piece.
        walls: "exact", "primitives" or "distance field".
        count: pieces of the pipe.
        steps: of each of three runs, of which the best counts.
    """
    spec = robot.spec()
    pipe = ot.Straight(2.0 if count == 1 else 1.0)
    parts = (Part(f"pipe_{k}", pipe, Pose(np.eye(3), [0, 0, k])) for k in range(count))
    joints = tuple(((k, "end"), (k + 1, "start")) for k in range(count - 1))
    network = Assembly(tuple(parts), joints)
    if walls == "exact":
        ot.add_pipes(spec, network, friction=0.8)
    elif walls == "primitives":
        add_walls(spec, network)
    else:
        sdf_walls(spec, network, MeshSettings())
    for geom in spec.geoms:
        if geom.name.startswith("wall_"):
            # The others are made for the omnidirectional robot's lugs. Contact as at the exact
            # walls, or the solver would have another task.
            geom.contype = geom.conaffinity = 1
            geom.friction, geom.condim = [0.8, 0.005, 0.0001], DECIDING["condim"]
            geom.priority, geom.solref = DECIDING["priority"], DECIDING["solref"]
    spec.body(robot.chassis).pos = [0, 0, 0.5]
    model = spec.compile()
    data, best, contacts = mujoco.MjData(model), np.inf, np.inf
    every = max(1, round(CONTROL_PERIOD / model.opt.timestep))
    for _ in range(3):
        spent = 0
        for _ in range(-(-steps // every)):
            seen = SimpleNamespace(qpos=data.qpos[None], time=np.array([data.time]))
            data.ctrl[:] = robot.gait(seen)[0]
            start = time.process_time_ns()
            mujoco.mj_step(model, data, every)
            spent += time.process_time_ns() - start
        best = min(best, spent / every / -(-steps // every))
        start = time.process_time_ns()
        for _ in range(steps):
            mujoco.mj_collision(model, data)
        contacts = min(contacts, (time.process_time_ns() - start) / steps)
    return f"{best / 1e3:,.0f} ({contacts / 1e3:,.{0 if contacts > 1e4 else 1}f})"


def row(robot: Robot, repeats: int) -> list[str]:
    """Return the costs of a robot by walls."""
    return [
        type(robot).__name__.lower(),
        step_cost(robot, "exact", 1, repeats),
        step_cost(robot, "primitives", 1, repeats),
        step_cost(robot, "distance field", 1, repeats // 20),
        step_cost(robot, "exact", 300, repeats),
    ]


def main() -> None:
    """Measure and print the table."""
    repeats = Arguments(__doc__, trials=2000, of="repeats").read().repeats
    heads = ("robot", "exact walls", "primitives", "distance field", "exact, 300 fittings")
    rows = (row(robot, repeats) for robot in (Presser(), Inchworm(), Snake()))
    table("steps", heads, rows, "Microseconds a step (of these for finding contacts):")


if __name__ == "__main__":
    main()
