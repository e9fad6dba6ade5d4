"""A town's walls: joints without a step or gap, nodes without a leak.

python benchmarks/town.py [--file FILE.inp] [--nodes 200] [--balls 8] [--seconds 0.5] [--seed 1]

Imports a town, wntr's ky10 without a file, and measures all joints: distance of the two ports,
angle between their axes, difference of their bores. Then throws balls, of a fifth of the narrowest
bore, about in the fittings of random nodes of three pipes and more, with plates a little way along
each pipe, and counts those that get out.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import mujoco
import numpy as np
from shape import Arguments

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import length

STEP, SOLREF = 0.0005, 0.002
"""Time step and contact time, s."""
STILL_IN = 1e-3
"""Depth of a ball's middle in the wall, m, up to which it is pressed against it."""
REACH = 0.3
"""Of pipe that is kept around a node's fitting, m."""


def joints(network: ot.Network) -> np.ndarray:
    """Gap, m, angle, rad, and step of the radius, m, of each joint (n, 3)."""
    rows = []
    for (i, one), (j, other) in network.pipes.joints:
        a, b = network.pipes.parts[i], network.pipes.parts[j]
        here, there = a.port(one), b.port(other)
        gap = length(here.position - there.position)
        angle = length(here.rotation[:, 2] + there.rotation[:, 2])
        step = abs(a.fitting.port_radius(one) - b.fitting.port_radius(other))
        rows.append((gap, angle, step))
    return np.array(rows)


def around(network: ot.Network, node: str) -> ot.Network:
    """The fitting of a node with its pipes cut short by caps."""
    part = network.around([node], REACH)
    fittings = {f.name: f.model_dump() for f in part.fittings}
    joints = [j.model_dump() for j in part.joints]
    for k, end in enumerate(part.open_ends):
        index, port = part.end("", end)
        fitting = part.pipes.parts[index].fitting
        if port in fitting.closed_ports:
            continue
        bore = 2 * fitting.port_radius(port)
        cap = {"kind": "cap", "name": f"end_{k}", "length": bore, "inner_diameter": bore}
        fittings[cap["name"]] = cap
        joints.append({"ports": (end, f"end_{k}.start")})
    return ot.Network(
        fittings=list(fittings.values()),
        joints=joints,
        place=part.place.model_dump() | {"position": (0.0, 0.0, 0.0)},
    )


def throw(
    network: ot.Network, node: str, balls: int, seconds: float, seed: int
) -> tuple[int, float]:
    """How many of so many balls get out of a node, and the deepest place of one's middle, m."""
    rng = np.random.default_rng([seed, *node.encode()])
    part = next(p for p in network.pipes.parts if p.name == node)
    narrow = min(part.fitting.port_radius(port) for port in part.fitting.port_names)
    spec = mujoco.MjSpec()
    spec.option.timestep = STEP
    pipes = ot.add_pipes(spec, network, solref=[SOLREF, 1], priority=1)
    for _ in range(balls):
        body = spec.worldbody.add_body()
        body.add_freejoint()
        # Balls pass through each other: only walls are tried.
        body.add_geom(size=[narrow / 5, 0, 0], contype=2, conaffinity=1)
    model = spec.compile()
    model.geom_conaffinity[model.geom_contype != 2] |= 2
    data = mujoco.MjData(model)
    low, high = part.fitting.bounds
    for ball in range(balls):
        while True:
            place = part.pose.apply(rng.uniform(low, high))
            if part.fitting.extent(part.pose.inverse().apply(place)) > 0 and (
                pipes.clearance(place) > narrow / 4
            ):
                break
        data.qpos[7 * ball : 7 * ball + 3] = place
        way = rng.normal(size=3)
        data.qvel[6 * ball : 6 * ball + 3] = rng.uniform(1, 8) * way / np.linalg.norm(way)
    deepest, out = -np.inf, np.zeros(balls, bool)
    for _ in range(10):
        mujoco.mj_step(model, data, round(seconds / STEP / 10))
        clearance = pipes.clearance(data.qpos.reshape(balls, 7)[:, :3])
        out |= ~(clearance > -STILL_IN)
        deepest = max(deepest, float(-clearance.min()))
    return int(out.sum()), deepest


def main() -> None:
    """Print the figures."""
    parser = Arguments(__doc__, trials=200, of="nodes", seed=1)
    parser.add_argument("--file", type=Path)
    parser.add_argument("--balls", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=0.5)
    asked = parser.read()
    begin = time.process_time()
    if asked.file is not None and asked.file.suffix == ".toml":
        network = ot.load_network(asked.file)
    else:
        imported = ot.import_network(asked.file or "ky10")
        network = imported.network
        there, built = (sum(column) for column in zip(*imported.lengths.values(), strict=True))
        print(
            f"{there:.1f} m in the file, {built:.1f} m built ({100 * (built / there - 1):+.4f} %)"
        )
        print({what: len(imported.of(what)) for what in ("assumed", "mended", "left out")})
    kinds = [f.kind for f in network.fittings]
    print(f"{len(kinds)} parts in {time.process_time() - begin:.1f} s of processor time:", end=" ")
    print({kind: kinds.count(kind) for kind in sorted(set(kinds))})
    worst = joints(network).max(axis=0)
    print(f"joints: gap {worst[0]:.1e} m, angle {worst[1]:.1e} rad, step {worst[2]:.1e} m at most")
    nodes = [f.name for f in network.fittings if f.kind in ("tee", "wye", "cross")]
    rng = np.random.default_rng(asked.seed)
    chosen = rng.choice(nodes, min(asked.nodes, len(nodes)), replace=False).tolist()
    lost, deepest = 0, -np.inf
    for node in chosen:
        out, depth = throw(around(network, node), node, asked.balls, asked.seconds, asked.seed)
        lost, deepest = lost + out, max(deepest, depth)
        if out:
            print(f"{node}: {out} balls got out")
    total = asked.balls * len(chosen)
    print(f"{lost} of {total} balls got out of {len(chosen)} nodes; deepest {1e3 * deepest:.2f} mm")
    sys.exit(bool(lost))


if __name__ == "__main__":
    main()
