"""Bodies thrown about in closed pipes: how many get out, and how deep they go into the walls.

    python benchmarks/thrown_bodies.py [--bodies 1000] [--seed 1]

Each fitting has a cap at every port. Bodies of the seven shapes of ``touching_geom.py`` begin at
random places in any position, at 1 to 12 m/s and up to 50 rad/s, and bounce about for 0.5 s, at
steps of 1 and 2 ms, without friction, by the bodies' own contact time, MuJoCo's 20 ms, and by that
of walls which state a friction, 5 ms. One is out when its centre is in no bore in the last 30 ms,
nor 20 mm beside one.
"""

from __future__ import annotations

import math

import mujoco
import mujoco.rollout
import numpy as np
from shape import Arguments, table
from touching_geom import SHAPES, add_body

import omnitrack_sim as ot

FITTINGS = {
    "straight": {"kind": "straight", "length": 0.4},
    "elbow": {"kind": "elbow", "mean_radius": 0.24},
    "tight elbow": {"kind": "elbow", "mean_radius": 0.09},
    "tee": {"kind": "tee"},
    "wye": {"kind": "wye", "angle_deg": 50},
    "reducing wye": {"kind": "wye", "angle_deg": 70, "branch_diameter": 0.1},
    "cross": {"kind": "cross"},
    "reducing cross": {"kind": "cross", "angle_deg": 60, "branch_diameter": 0.1},
    "mitre": {"kind": "mitre"},
    "sharp mitre": {"kind": "mitre", "angle_deg": 135, "leg_length": 0.35},
    "reducer": {"kind": "reducer", "length": 0.15, "end_diameter": 0.12},
    "oval": {"kind": "straight", "length": 0.4, "section": "oval", "ovality": 0.1},
    "egg": {"kind": "straight", "length": 0.4, "section": "egg"},
    "mouth": {"kind": "straight", "length": 0.4, "section": "mouth"},
    "arch": {"kind": "straight", "length": 0.4, "section": "arch"},
    "offset": {"kind": "coupling", "length": 0.4, "offset": 0.008},
    "step": {"kind": "coupling", "length": 0.4, "end_diameter": 0.144},
    "old joint": {
        "kind": "coupling",
        "length": 0.4,
        "offset": 0.004,
        "angle_deg": 3,
        "gap": 0.02,
        "depth": 0.015,
    },
}
LIMB = {"kind": "straight", "length": 0.4}
NETWORKS = {
    "bend back": ot.Network(
        fittings=[
            LIMB | {"name": "one"},
            {"kind": "elbow", "name": "bend", "mean_radius": 0.09, "angle_deg": 180},
            LIMB | {"name": "other"},
        ],
        joints=[{"ports": ("one.end", "bend.start")}, {"ports": ("bend.end", "other.start")}],
    ),
    "oblique branch": ot.Network(
        fittings=[
            {"kind": "wye", "name": "fork", "angle_deg": 45},
            LIMB | {"name": "one"},
            LIMB | {"name": "other"},
        ],
        joints=[
            {"ports": ("fork.run_end", "one.start")},
            {"ports": ("fork.branch", "other.start")},
        ],
    ),
}
"""Pipes that come near to others of the same network."""
RANDOM, DIAMETERS = 20, (None, (0.12, 0.16))
"""Random networks, and the bores that every other one has."""
TIMESTEPS = 0.001, 0.002
"""s; bodies of both count together."""
SECONDS, BOUNCE, MIN_ROOM, STILL_IN = 0.5, 0.03, 0.045, 0.02
"""Of a run, s, and of its end in which a body has to be in a bore at some time; from the wall, m,
in which a body begins; and depth of a centre in the wall, m, up to which a body at high speed is
pressed against it."""


def capped(network: ot.Network) -> ot.Network:
    """Return a network with a cap at each open end."""
    tables = network.model_dump()
    fittings, joints = list(tables["fittings"]), list(tables["joints"])
    for k, end in enumerate(network.open_ends):
        index, port = network.port(end)
        fitting = network.pipes.parts[index].fitting
        edge, bore = fitting.edge(port), 2 * fitting.port_radius(port)
        cap = {"kind": "cap", "name": f"cap_{k}", "length": 0.06, "inner_diameter": bore}
        if edge is not None:
            cap |= {"section": edge.name, "inner_diameter": edge.size, "ovality": edge.ovality}
            cap["direction_deg"] = math.degrees(edge.direction)
        fittings.append(cap)
        joints.append({"ports": (end, f"cap_{k}.start")})
    return ot.Network(fittings=fittings, joints=joints)


def fitting_alone(fitting: dict) -> ot.Network:
    """Return a fitting with a cap at each port."""
    return capped(ot.Network(fittings=[fitting | {"name": "pipe"}]))


def random_networks() -> list[ot.Network]:
    """Return closed random networks of 5 to 9 fittings."""
    networks = (ot.random_network(k, (5, 9), diameters=DIAMETERS[k % 2]) for k in range(RANDOM))
    return [capped(network) for network in networks]


def throw(
    network: ot.Network, shape: str, timestep: float, friction: float | None, count: int, seed: int
) -> tuple[int, float]:
    """Return how many of ``count`` bodies get out, and the deepest place of a centre, m."""
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    # Flat bodies that turn fast about a middle axis would diverge by others.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    pipes = ot.add_pipes(spec, network, friction=friction)
    add_body(spec, shape).condim = 1
    model = spec.compile()
    rng, data, states = np.random.default_rng([seed, *shape.encode()]), mujoco.MjData(model), []
    parts = pipes.assembly.parts
    while len(states) < count:
        part = parts[rng.integers(len(parts))]
        place = part.pose.apply(rng.uniform(*part.fitting.bounds))
        if not pipes.clearance(place) > MIN_ROOM:
            continue
        way = rng.normal(size=3)
        data.qpos[:3], data.qpos[3:] = place, rng.normal(size=4)
        mujoco.mj_normalizeQuat(model, data.qpos)
        data.qvel[:3] = rng.uniform(1.0, 12.0) * way / np.linalg.norm(way)
        data.qvel[3:] = rng.uniform(-50, 50, 3)
        state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states.append(state)
    steps = round(SECONDS / timestep)
    rolled, _ = mujoco.rollout.rollout(model, data, np.array(states), nstep=steps)
    clearance = pipes.clearance(rolled[:, :, 1:4])
    # One that bounces off a cap is behind its plane, where there is no bore, for a moment. MuJoCo
    # begins anew where a motion diverges.
    last = clearance[:, -round(BOUNCE / timestep) :]
    out = ~(last > -STILL_IN).any(axis=1) | (rolled[:, -1, 0] < SECONDS - timestep)
    return int(out.sum()), float(-np.nanmin(clearance))


def row(name: str, networks: list[ot.Network], bodies: int, seed: int) -> list[str]:
    """Return how many of so many bodies get out of networks, and how deep they go."""
    each, cells = -(-bodies // (len(SHAPES) * len(TIMESTEPS) * len(networks))), [name]
    for friction in (None, 0.0):
        thrown = [
            throw(network, shape, timestep, friction, each, seed + k)
            for k, network in enumerate(networks)
            for timestep in TIMESTEPS
            for shape in SHAPES
        ]
        out, deepest = sum(out for out, _ in thrown), max(deep for _, deep in thrown)
        cells.append(f"{out} of {each * len(thrown)}; {1e3 * deepest:.0f}")
    return cells


def main() -> None:
    """Throw and print the table."""
    given = Arguments(__doc__, trials=2000, quick=300, of="bodies", seed=1).read()
    closed = {name: [fitting_alone(fitting)] for name, fitting in FITTINGS.items()}
    closed |= {name: [capped(network)] for name, network in NETWORKS.items()}
    closed |= {f"{RANDOM} random networks": random_networks()}
    text = "Bodies that get out; deepest centre in a wall, mm:"
    rows = (row(name, networks, given.bodies, given.seed) for name, networks in closed.items())
    table("thrown", ("pipes", "contact time 20 ms", "5 ms"), rows, text)


if __name__ == "__main__":
    main()
