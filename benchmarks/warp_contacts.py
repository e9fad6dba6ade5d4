"""Contacts with exact walls in MuJoCo Warp against those of MuJoCo, in poses by lot.

    python benchmarks/warp_contacts.py [--quick] [--poses 100000] [--seed 1]

All fittings, some with relief, stand metres apart in one model with a body of each type of geom,
and a module with rows of lugs. Prints, for each body, the contacts of random poses up to 1 mm off
the wall and up to 1 mm in it: how many there are, how many are missing or are there in vain, how
deep those are, and the largest difference of depths, in micrometres.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import contact_lots
import mujoco
import numpy as np
from shape import Arguments, table
from touching_geom import SHAPES

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.robots.omnitrack import track
from omnitrack_sim.walls.geoms import set_numerics

MARGIN, GAP, FAR = 0.004, 1e-3, 0.2
"""Of the geoms, m; largest distance of a pose from the wall, m, to either side; and margin, m, by
which a body is placed."""
SAME = 2e-3
"""Distance, m, up to which two contacts of the same geoms may be the same one."""
APART = 3.0
"""Distance of the fittings, m."""
LUG_RADIUS, LUG_PITCH, TRACK_OFFSET, HALF = 0.0276, 0.018, 0.012, 0.045
"""Of the module, m: much as the paper's."""
MODULE = "module"
RELIEF = {
    "beads": ot.Straight(
        0.4,
        relief=[
            {"kind": "weld", "at": 0.1, "height": 0.004},
            {"kind": "weld", "at": 0.3, "from_deg": 30, "to_deg": 150},
        ],
    ),
    "bed": ot.Straight(
        0.4, relief=[{"kind": "deposit", "at": 0.2, "length": 0.2, "depth": 0.02, "angle_deg": 0}]
    ),
    "bend with a bead": ot.Elbow(0.24, relief=[{"kind": "weld", "at": 0.15}]),
    "dented": ot.Straight(
        0.4,
        relief=[
            {"kind": "dent", "at": 0.2, "depth": 0.006, "length": 0.1, "width": 0.08},
            {"kind": "weld", "at": 0.3},
        ],
    ),
    "dented bend": ot.Elbow(
        0.24, relief=[{"kind": "dent", "at": 0.15, "depth": 0.006, "length": 0.1, "width": 0.08}]
    ),
    "corroded": ot.Straight(0.3, relief=[{"kind": "corrosion", "roughness": 0.001}]),
}
"""Fittings whose walls differ from their bores."""
BATCH = 8192
"""Most worlds at once: 100,000 would need 20 GB."""


def network() -> Assembly:
    """All fittings apart, and some joined in a row that begins open and ends closed."""
    fittings = contact_lots.FITTINGS | RELIEF
    places = [[APART * (i % 5), APART * (i // 5 + 1), 0] for i in range(len(fittings))]
    parts = [
        Part(name.replace(" ", "_"), fitting, Pose(np.eye(3), place))
        for (name, fitting), place in zip(fittings.items(), places, strict=True)
    ]
    row = (
        ("inlet", ot.Straight(0.3)),
        ("bend", ot.Elbow(0.12)),
        ("cone", ot.Reducer(0.1, end_diameter=0.12)),
        ("end", ot.Cap(0.3, inner_diameter=0.12)),
    )
    pose, joints = Pose(), []
    for name, fitting in row:
        parts.append(Part(name, fitting, pose))
        if name != "end":
            joints.append(((len(parts) - 1, "end"), (len(parts), "start")))
            port = pose @ fitting.ports["end"]
            # Entered along z, whichever way it is turned about it.
            pose = Pose(port.rotation, port.position)
    return Assembly(tuple(parts), tuple(joints))


class Contacts(NamedTuple):
    """Contacts of one pose: geoms (n, 2), distances (n,) m, positions and normals (n, 3).

    In a corner two walls may be as near, so positions are those of the body's surface, m.
    """

    geoms: Any
    distances: Any
    positions: Any
    normals: Any


class Lot:
    """Bodies of all types of geoms, and the fittings that they touch.

    Attributes:
        model: with a free body of each.
        bodies: their names.
        pipes: the fittings.
    """

    def __init__(self, shapes: tuple[str, ...] = (*SHAPES, MODULE)) -> None:
        spec = mujoco.MjSpec()
        set_numerics(spec.option)
        points = np.random.default_rng(1).normal(size=(24, 3))
        points *= 0.025 / np.linalg.norm(points, axis=1, keepdims=True)
        spec.add_mesh(name="stone", uservert=points.ravel())
        touches = {"contype": 1, "conaffinity": 0, "margin": MARGIN, "mass": 0.1}
        if MODULE in shapes:
            track.install_lines()
            spec.nuser_geom = track.RECORD_SIZE
        for name in shapes:
            body = spec.worldbody.add_body(name=name)
            body.add_freejoint()
            if name == MODULE:
                _add_module(body, touches)
                continue
            kind, size = SHAPES[name]
            geom = body.add_geom(type=kind, size=size, **touches)
            if name == "mesh":
                geom.meshname = "stone"
        self.bodies, self.pipes = shapes, ot.add_pipes(spec, network(), friction=0.8)
        self.model = spec.compile()

    def poses(self, count: int, seed: int) -> tuple[Any, Any, Any]:
        """Return poses near the wall: states (n, nq), number of the body, origin (n, 3) m."""
        rng, parts = np.random.default_rng(seed), self.pipes.assembly.parts
        data, states, bodies, origins = mujoco.MjData(self.model), [], [], []
        while len(states) < count:
            body, part = len(states) % len(self.bodies), parts[rng.integers(len(parts))]
            if self.bodies[body] == "mesh" and part.fitting.closed_ports:
                continue  # of a mesh's vertices on a plane MuJoCo takes others
            stretches = part.stretches()
            points = part.bore_samples(stretches[rng.integers(len(stretches))])
            point = points[rng.integers(len(points))] + rng.normal(0, 0.01, 3)
            turn = rng.normal(size=4)
            state = self._state(body, np.concatenate([point, turn / np.linalg.norm(turn)]))
            if not self.pipes.clearance(point) > 0:
                continue
            if self._press(data, state, body, part, rng.uniform(-GAP, GAP)):
                states.append(state)
                bodies.append(body)
                origins.append(part.pose.position)
        return np.array(states), np.array(bodies), np.array(origins)

    def _press(self, data: mujoco.MjData, state: Any, body: int, part: Part, wanted: float) -> bool:
        """Move a body until it is ``wanted`` m off the wall; return whether it is."""
        place = state[7 * body : 7 * body + 3]
        margin = self.model.geom_margin.copy()
        self.model.geom_margin[self.model.geom_bodyid > 0] = FAR
        least = np.inf
        for _ in range(4):
            least = self._found(data, state).distances.min(initial=np.inf)
            if not np.isfinite(least) or abs(least - wanted) < 0.1 * GAP:
                break
            _, gradient = part.signed_distance(place[None])
            place -= (least - wanted) * gradient[0]
        self.model.geom_margin[:] = margin
        return abs(least - wanted) < 0.1 * GAP and bool(self.pipes.clearance(place) > 0)

    def _state(self, body: int, pose: Any) -> Any:
        """Return the state of a pose of one body, with all others far from the pipes."""
        state = np.tile([0.0, 0, 0, 1, 0, 0, 0], len(self.bodies))
        state[2::7] = 30.0 + np.arange(len(self.bodies))
        state[7 * body : 7 * body + 7] = pose
        return state

    def _found(self, data: mujoco.MjData, state: Any) -> Contacts:
        data.qpos[:] = state
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_collision(self.model, data)
        c = data.contact
        normals, distances = c.frame[:, :3].copy(), c.dist.copy()
        places = c.pos + 0.5 * distances[:, None] * normals
        return Contacts(c.geom.copy(), distances, places, normals)

    def by_mujoco(self, states: Any) -> list[Contacts]:
        """Return the contacts that MuJoCo finds in each of some states."""
        data = mujoco.MjData(self.model)
        return [self._found(data, state) for state in states]

    def by_warp(self, states: Any, origins: Any) -> list[Contacts]:
        """Return the contacts that the walls in MuJoCo Warp find, positions from the origins."""
        import mujoco_warp as mjw
        import warp as wp

        import omnitrack_sim.warp

        m = omnitrack_sim.warp.put_model(self.model)
        d = mjw.make_data(self.model, nworld=len(states), nconmax=24, njmax=1)
        local = states.reshape(len(states), -1, 7).copy()
        local[..., :3] -= origins[:, None]
        d.qpos = wp.array(local.reshape(len(states), -1), dtype=float)
        omnitrack_sim.warp.set_origins(m, d, origins)
        mjw.kinematics(m, d)
        d.nacon.zero_()
        m.callback.contactfilter(m, d)
        count = int(d.nacon.numpy()[0])
        assert count <= d.naconmax
        order = np.argsort(d.contact.worldid.numpy()[:count], kind="stable")
        worlds = d.contact.worldid.numpy()[order]
        geoms, frames = d.contact.geom.numpy()[order], d.contact.frame.numpy()[order]
        distances = d.contact.dist.numpy()[order]
        places = d.contact.pos.numpy()[order] + 0.5 * distances[:, None] * frames[:, 0]
        ends = np.searchsorted(worlds, np.arange(len(states) + 1))
        whole = geoms, distances, places + origins[worlds], frames[:, 0]
        return [Contacts(*(each[a:b] for each in whole)) for a, b in pairwise(ends)]


def _add_module(body: mujoco.MjsBody, touches: dict[str, Any]) -> None:
    """Add two rows of lugs and the sprockets between them."""
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    for end in (1, -1):
        record = track.sprocket_record(end)
        place, size = [0, 0, end * HALF], [LUG_RADIUS, 1e-9, 0]
        body.add_geom(type=capsule, size=size, pos=place, userdata=record, **touches)
    for side in (1.0, -1.0):
        record = track.line_record(LUG_PITCH, 1.0, side)
        place, size = [side * TRACK_OFFSET, 0, 0], [LUG_RADIUS, HALF, 0]
        body.add_geom(type=capsule, size=size, pos=place, userdata=record, **touches)


class Difference(NamedTuple):
    """How contacts of one pose differ.

    Attributes:
        deepest: depth of the deepest that was expected, m.
        missing: depths of those that are missing, m.
        in_vain: depths of those that were not expected, m.
        depths: by which the others differ in depth, m.
        places: by which they are apart, m.
        turns: by which their normals differ, rad.
    """

    deepest: float
    missing: list[float]
    in_vain: list[float]
    depths: list[float]
    places: list[float]
    turns: list[float]


def difference(expected: Contacts, found: Contacts) -> Difference:
    """Compare the contacts of one pose."""
    free = set(range(len(found.distances)))
    told = Difference(-float(expected.distances.min(initial=0.0)), [], [], [], [], [])
    for i in np.argsort(expected.distances):
        apart = np.linalg.norm(found.positions - expected.positions[i], axis=1)
        same = [j for j in free if apart[j] < SAME and (found.geoms[j] == expected.geoms[i]).all()]
        if not same:
            told.missing.append(-float(expected.distances[i]))
            continue
        j = min(same, key=lambda j: apart[j])
        free.remove(j)
        told.depths.append(abs(float(found.distances[j] - expected.distances[i])))
        told.places.append(float(apart[j]))
        told.turns.append(float(np.linalg.norm(found.normals[j] - expected.normals[i])))
    told.in_vain.extend(-float(found.distances[j]) for j in free)
    return told


def differences(lot: Lot, count: int, seed: int) -> tuple[Any, list[Difference]]:
    """Return the numbers of the bodies, and the difference in each of some poses."""
    states, bodies, origins = lot.poses(count, seed)
    told: list[Difference] = []
    for begin in range(0, count, BATCH):
        batch = slice(begin, begin + BATCH)
        found = lot.by_warp(states[batch], origins[batch])
        told += map(difference, lot.by_mujoco(states[batch]), found)
    return bodies, told


def rows(lot: Lot, count: int, seed: int) -> list[list[str]]:
    """Return the rows of the table."""
    bodies, told = differences(lot, count, seed)
    lines = []
    for number, name in enumerate(lot.bodies):
        own = [each for each, body in zip(told, bodies, strict=True) if body == number]
        missing, in_vain, depths = (
            np.array([x for each in own for x in each[k]] or [np.nan]) for k in range(1, 4)
        )
        lines.append(
            [
                name,
                f"{len(depths):,}",
                *(
                    f"{np.isfinite(each).sum()}; {1e6 * each.max():.1f}"
                    for each in (missing, in_vain)
                ),
                f"{1e6 * depths.max():.2f}",
                f"{1e6 * np.quantile(depths, 0.999):.2f}",
            ]
        )
    return lines


def main() -> None:
    """Measure and print the table."""
    read = Arguments(__doc__, trials=100_000, quick=4000, of="poses", seed=1).read()
    heads = ("body", "contacts", "missing; depth", "in vain; depth", "largest", "99.9 %")
    table("contacts", heads, rows(Lot(), read.poses, read.seed), "Depths, micrometres:")


if __name__ == "__main__":
    main()
