"""Bodies thrown about in closed pipes: how many get out, and how deep they go into the walls.

    python benchmarks/thrown_bodies.py [--bodies 1000] [--seed 1]

Each fitting has a cap at every port. Bodies of the seven shapes of ``touching_geom.py`` begin at
random places in any position, at 1 to 12 m/s and up to 50 rad/s, and bounce about for 0.5 s, at
steps of 1 and 2 ms, without friction, by the bodies' own contact time, MuJoCo's 20 ms, and by that
of walls which state a friction, 5 ms. One is out when its centre is in no bore at the end, nor 20
mm beside one.
"""

from __future__ import annotations

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
}
TIMESTEPS = 0.001, 0.002
"""s; bodies of both count together."""
SECONDS, MIN_ROOM, STILL_IN = 0.5, 0.045, 0.02
"""Of a run; from the wall, m, in which a body begins; and depth of a centre in the wall, m, up to
which a body at high speed is pressed against it."""


def capped(fitting: dict) -> ot.Network:
    """Return a fitting with a cap at each port."""
    whole = ot.Network(fittings=[fitting | {"name": "pipe"}]).pipes
    part = whole.parts[0].fitting
    caps, joints = [], []
    for port in part.ports:
        bore = 2 * part.port_radius(port)
        name = f"cap_{port}"
        caps.append({"kind": "cap", "name": name, "length": 0.06, "inner_diameter": bore})
        joints.append({"ports": (f"pipe.{port}", f"{name}.start")})
    return ot.Network(fittings=[fitting | {"name": "pipe"}, *caps], joints=joints)


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
    part = pipes.assembly.parts[0]
    while len(states) < count:
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
    # MuJoCo begins anew where a motion diverges.
    out = ~(clearance[:, -1] > -STILL_IN) | (rolled[:, -1, 0] < SECONDS - timestep)
    return int(out.sum()), float(-np.nanmin(clearance))


def row(name: str, each: int, seed: int) -> list[str]:
    """Return how many bodies get out of a fitting, and how deep they go, by contact time."""
    network, cells = capped(FITTINGS[name]), [name]
    for friction in (None, 0.0):
        thrown = [
            throw(network, shape, timestep, friction, each, seed)
            for timestep in TIMESTEPS
            for shape in SHAPES
        ]
        out, deepest = sum(out for out, _ in thrown), max(deep for _, deep in thrown)
        cells.append(f"{out}; {1e3 * deepest:.0f}")
    return cells


def main() -> None:
    """Throw and print the table."""
    given = Arguments(__doc__, trials=1000, of="bodies", seed=1).read()
    each = -(-given.bodies // len(SHAPES))
    text = f"Of {len(TIMESTEPS) * each * len(SHAPES)} bodies out; deepest centre in a wall, mm:"
    rows = (row(name, each, given.seed) for name in FITTINGS)
    table("thrown", ("fitting", "contact time 20 ms", "5 ms"), rows, text)


if __name__ == "__main__":
    main()
