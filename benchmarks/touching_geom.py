"""Cost of a geom that touches a wall: exact pipes against walls of boxes and capsules.

    python benchmarks/touching_geom.py [--repeats 2000]

Prints microseconds of processor time: of MuJoCo's collision detection, the best of five, for one
geom of each type that lies against the wall of each fitting, less those of a geom that touches
nothing; and of a step of three robots that climb in a straight pipe, the best of three runs: also
in one of 300 pieces, and in one that is a signed distance field of MuJoCo's.
"""

from __future__ import annotations

import argparse
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

GEOM = mujoco.mjtGeom
FITTINGS = {
    "straight": ot.Straight(0.4),
    "elbow": ot.Elbow(0.24),
    "reducer": ot.Reducer(0.2, end_diameter=0.14),
    "tee": ot.Tee(),
    "wye": ot.Wye(),
}
SHAPES = {
    "sphere": (GEOM.mjGEOM_SPHERE, [0.025, 0, 0]),
    "capsule": (GEOM.mjGEOM_CAPSULE, [0.015, 0.04, 0]),
    "wheel": (GEOM.mjGEOM_CYLINDER, [0.03, 0.01, 0]),
    "roller": (GEOM.mjGEOM_CYLINDER, [0.012, 0.04, 0]),
    "ellipsoid": (GEOM.mjGEOM_ELLIPSOID, [0.035, 0.02, 0.012]),
    "box": (GEOM.mjGEOM_BOX, [0.03, 0.02, 0.01]),
    "mesh": (GEOM.mjGEOM_MESH, [0, 0, 0]),
}


def model_of(fitting: ot.Fitting, shape: str, exact: bool) -> mujoco.MjModel:
    """A free body of one geom in a fitting, its walls exact or of primitives."""
    spec = mujoco.MjSpec()
    network = Assembly((Part("pipe", fitting, Pose()),))
    if exact:
        ot.add_pipes(spec, network)
    else:
        add_walls(spec, network)
    geom = add_body(spec, shape)
    geom.contype = geom.conaffinity = 3
    return spec.compile()


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


def poses(model: mujoco.MjModel, fitting: ot.Fitting, count: int) -> list[np.ndarray]:
    """States (7,) in which the geom touches exact walls."""
    rng, data, states = np.random.default_rng(2), mujoco.MjData(model), []
    low, high = fitting.bounds
    while len(states) < count:
        point = rng.uniform(low, high)
        distance, gradient = fitting.signed_distance(point)
        if distance > 0 and fitting.extent(point) > 0.04:
            data.qpos[:3] = point - gradient * (distance - rng.uniform(0.01, 0.03))
            data.qpos[3:] = rng.normal(size=4)
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            if data.ncon and data.contact.dist.min() > -0.002:
                states.append(data.qpos.copy())
    return states


def cost(model: mujoco.MjModel, states: list[np.ndarray], repeats: int) -> float:
    """Microseconds of one collision detection, mean over states, best of five."""
    total = 0.0
    for state in states:
        data = mujoco.MjData(model)
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        best = np.inf
        for _ in range(5):
            start = time.process_time_ns()
            for _ in range(repeats // len(states)):
                mujoco.mj_collision(model, data)
            best = min(best, time.process_time_ns() - start)
        total += best / (repeats // len(states))
    return total / len(states) / 1e3


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=2000, help="of each measurement")
    repeats = parser.parse_args().repeats
    print("## cost\n\nMicroseconds with exact walls / with primitives:\n")
    print("| geom |", " | ".join(FITTINGS), "|")
    print("|---|" + "---|" * len(FITTINGS))
    for shape in SHAPES:
        cells = [pair(fitting, shape, repeats) for fitting in FITTINGS.values()]
        print(f"| {shape} |", " | ".join(cells), "|", flush=True)
    print("\n## steps\n\nMicroseconds a step (of these for finding contacts):\n")
    print("| robot | exact walls | primitives | distance field | exact, 300 fittings |")
    print("|---|---|---|---|---|")
    for robot in (Presser(), Inchworm(), Snake()):
        exact, fine = step_cost(robot, "exact", 1, repeats), step_cost(robot, "exact", 300, repeats)
        primitives = step_cost(robot, "primitives", 1, repeats)
        field = step_cost(robot, "distance field", 1, repeats // 20)
        name = type(robot).__name__.lower()
        print(f"| {name} |", " | ".join((exact, primitives, field, fine)), "|", flush=True)


def step_cost(robot: Presser | Inchworm | Snake, walls: str, count: int, steps: int) -> str:
    """Microseconds of a step, the best of three runs, and of collision detection, of a robot that
    climbs in a straight pipe of 2 m, or of 1 m a piece."""
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


def pair(fitting: ot.Fitting, shape: str, repeats: int) -> str:
    """Cost of a geom at exact walls and at walls of primitives, as text."""
    models = [model_of(fitting, shape, exact) for exact in (True, False)]
    states, away = poses(models[0], fitting, 10), [np.array([9.0, 0, 0, 1, 0, 0, 0])]
    costs = [cost(model, states, repeats) - cost(model, away, repeats) for model in models]
    return " / ".join(f"{each:.2g}" for each in costs)


if __name__ == "__main__":
    main()
