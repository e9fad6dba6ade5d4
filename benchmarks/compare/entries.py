"""What is compared: walls of this package and its peers, each with the settings that are tried."""

from __future__ import annotations

import dataclasses
import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from peer_walls import MeshSettings, convex_walls, flex_walls, sdf_walls

from omnitrack_sim import override
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly, Part
from omnitrack_sim.robots.omnitrack.body import LUG_CONAFFINITY, LUG_CONTYPE, add_robot
from omnitrack_sim.robots.omnitrack.track import line_record
from omnitrack_sim.robots.omnitrack.track_plant import TrackPlant
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.sim.simulation import MakePlant
from omnitrack_sim.walls.geoms import add_exact_walls, add_walls, new_spec

OWN = ("primitives", "exact")
TITLES = {
    "primitives": "primitives (this package)",
    "exact": "exact collider (this package)",
    "convex": "MuJoCo, convex pieces by CoACD",
    "flex": "MuJoCo, rigid flex",
    "sdf": "MuJoCo, signed distance field",
    "bullet": "PyBullet, concave triangle mesh",
}
NEEDS = {"convex": "coacd", "bullet": "pybullet"}
"""Packages that an entry needs beyond those of omnitrack_sim."""
PROBE_DEPTH = 1e-3
"""How far a lug is pressed into the exact surface to feel for the walls, m.

Signed distance fields have no contacts at a distance.
"""
PROBE_REACH = 5e-3
"""Farthest from the exact surface that a wall is found, m; one farther off counts as this far."""


@dataclass(frozen=True)
class Work:
    """Where decompositions are kept, and how long one fitting's may take, s."""

    folder: Path
    limit_s: float


@dataclass(frozen=True)
class Entry:
    """One way to simulate the wall, with one choice of its settings.

    Attributes:
        peer: key of ``TITLES``.
        settings: as they are reported.
        overrides: of the scenario, by key.
        walls: adds the walls of a network to a spec and returns seconds spent in other processes;
            none for entries whose plant is made elsewhere.
        line_tracks: rows of lugs are lines, for the compiled collider.
        depth_factor: depth of penetration over what contacts say of it.
    """

    peer: str
    settings: dict[str, Any]
    overrides: dict[str, Any] = dataclasses.field(default_factory=dict)
    walls: Callable[[mujoco.MjSpec, Assembly], float] | None = None
    line_tracks: bool = False
    depth_factor: float = 1.0

    @property
    def name(self) -> str:
        """Peer and settings in one line."""
        return f"{self.peer} " + ", ".join(f"{k}={v}" for k, v in self.settings.items())

    def scenario(self, job: Scenario) -> Scenario:
        """The job with this entry's time step and walls."""
        return override(job, self.overrides) if self.overrides else job

    def prepare(self, job: Scenario) -> Built:
        """Build the walls and the model once.

        Raises:
            RuntimeError, ValueError: it cannot be built; the message says why.
        """
        scenario = self.scenario(job)
        if self.walls is None:
            return _bullet_built(self, scenario)
        start = time.process_time()
        if self.peer in OWN:
            spec, outside = scenario.to_spec(), 0.0
        else:
            spec = new_spec("omnitrack_peer")
            spec.option.timestep = scenario.physics.timestep
            outside = self.walls(spec, scenario.route.network)
            add_robot(spec, scenario.robot)
        model = spec.compile()
        build_s = time.process_time() - start + outside
        elements = model.nflexelem if model.nflex else int((model.geom_bodyid == 0).sum())
        return Built(
            make_plant=lambda s, trials, threads: TrackPlant(
                model, s.robot, trials, s.physics.control_period, threads
            ),
            wall_error=lambda part, probes: probe_walls(self, scenario, part, probes),
            build_s=build_s,
            elements=elements,
        )


@dataclass(frozen=True)
class Built:
    """An entry's plant for one job.

    Attributes:
        make_plant: for ``Simulation``.
        wall_error: errors (k,) m of the collision surface at k probes in a part; see
            ``probe_walls``.
        build_s: CPU seconds to make walls and model.
        elements: wall pieces, or triangles.
    """

    make_plant: MakePlant
    wall_error: Callable[[Part, int], tuple[float, float]]
    build_s: float
    elements: int | None


def probe_places(part: Part, radius: float, count: int, seed: int = 0) -> Array:
    """Draw centres (count, 3) m of spheres that touch a part's exact inner surface.

    They are in the world frame, and away from the ports.
    """
    rng = np.random.default_rng(seed)
    samples = part.bore_samples()
    low, high = samples.min(axis=0), samples.max(axis=0)
    points = np.zeros((0, 3))
    while len(points) < count:
        more = rng.uniform(low, high, (20 * count, 3))
        more = more[part.signed_distance(more)[0] > radius]
        for _ in range(20):
            distance, gradient = part.signed_distance(more)
            more = more - (distance - radius)[:, None] * gradient
        distance, _ = part.signed_distance(more)
        kept = (np.abs(distance - radius) < 1e-8) & (part.extent(more) > PROBE_REACH)
        points = np.concatenate([points, more[kept]])
    return points[:count]


def probe_walls(entry: Entry, scenario: Scenario, part: Part, count: int) -> tuple[float, float]:
    """Return the largest error of an entry's collision surface in a part, and 99 % of them, mm.

    A lug is pressed into the exact surface at ``count`` places; its deepest contact is that deep,
    or off by the error. The compiled collider is probed with its own kind of geom, a line of no
    length.
    """
    assert entry.walls is not None
    spec = new_spec("probe")
    radius = scenario.robot.lug_radius - scenario.robot.track_offset
    entry.walls(spec, scenario.route.network)
    probe = spec.worldbody.add_body(
        name="probe", mass=1.0, inertia=[1.0, 1.0, 1.0], explicitinertial=True
    )
    probe.add_freejoint()
    shape: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [radius, 0, 0]}
    if entry.line_tracks:
        shape = {
            "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
            "size": [radius, 1e-9, 0],
            "userdata": line_record(scenario.robot.lug_pitch, scenario.robot.scale),
        }
    probe.add_geom(
        contype=LUG_CONTYPE, conaffinity=LUG_CONAFFINITY, priority=1, margin=PROBE_REACH, **shape
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    errors = []
    for place in probe_places(part, radius - PROBE_DEPTH, count):
        data.qpos[:3] = place
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_flex(model, data)
        mujoco.mj_collision(model, data)
        found = (
            entry.depth_factor * float(data.contact.dist.min()) + PROBE_DEPTH
            if data.ncon
            else PROBE_REACH
        )
        errors.append(min(abs(found), PROBE_REACH) if np.isfinite(found) else PROBE_REACH)
    return 1000 * max(errors), 1000 * float(np.percentile(errors, 99))


def entries(work: Work, peers: tuple[str, ...] = tuple(TITLES), quick: bool = False) -> list[Entry]:
    """Every entry of ``peers``; ``quick`` takes two of this package and one of each other peer."""
    found: dict[str, list[Entry]] = {
        "primitives": [_primitives(t, w) for t, w in OWN_PRIMITIVES],
        "exact": [_exact(t) for t in (0.002, 0.001, 0.004)],
        "convex": [_convex(work, t, mesh, **coacd) for t, mesh, coacd in CONVEX],
        "flex": [_flex(*settings) for settings in FLEX],
        "sdf": [_sdf(*settings) for settings in SDF],
        "bullet": _bullet_entries(),
    }
    return [
        entry
        for peer in peers
        for entry in (found[peer][: 2 if peer in OWN else 1] if quick else found[peer])
    ]


def missing(peer: str) -> str | None:
    """What to do so that a peer can run, or None when it can."""
    package = NEEDS.get(peer)
    if package is not None and importlib.util.find_spec(package) is None:
        return f"pip install {package}"
    return None


OWN_PRIMITIVES = [(0.002, 1e-4), (0.004, 1e-4), (0.001, 1e-4), (0.002, 5e-4), (0.002, 2e-5)]
"""Time step, s, and tolerance of the walls, m."""
_UNPROCESSED: dict[str, Any] = {"preprocess_mode": "off", "mcts_iterations": 50}
CONVEX: list[tuple[float, MeshSettings, dict[str, Any]]] = [
    (0.002, MeshSettings(48), {"threshold": 0.05, **_UNPROCESSED}),
    (0.002, MeshSettings(48), {"threshold": 0.02, **_UNPROCESSED}),
    (0.002, MeshSettings(48), {"threshold": 0.01, **_UNPROCESSED}),
    (0.002, MeshSettings(48), {"threshold": 0.01, "max_convex_hull": 100, **_UNPROCESSED}),
    (
        0.002,
        MeshSettings(48),
        {"threshold": 0.05, "preprocess_resolution": 30, "mcts_iterations": 50},
    ),
]
"""Time step, s, mesh and arguments of CoACD."""
FLEX = [
    (0.002, 96, None, 1e-3),
    (0.004, 96, None, 1e-3),
    (0.002, 48, None, 1e-3),
    (0.002, 192, None, 1e-3),
    (0.002, 96, 0.03, 1e-3),
]
"""Time step, s, corners around, longest edge, m, radius of the triangles, m."""
SDF = [
    (0.002, MeshSettings(96, thickness=0.010), None, 5, 8),
    (0.002, MeshSettings(96, thickness=0.010), 7, 3, 4),
    (0.002, MeshSettings(96, thickness=0.010), 7, 10, 40),
]
"""Time step, s, mesh, depth of the octree, iterations and starting points of the contact search."""
SDF_DEPTH_FACTOR = 2.0
"""A contact with a signed distance field lies where both shapes are equally deep.

It tells that depth, which is half of all.
"""


CONTROL_PERIOD, COARSE_CONTROL_PERIOD = 0.010, 0.008
"""Period of the controller, s: as shipped, and where the time step does not divide that."""


def _clock(timestep: float) -> dict[str, float]:
    """The time step, and another control period where the usual one is no multiple of it."""
    fits = abs(CONTROL_PERIOD / timestep - round(CONTROL_PERIOD / timestep)) < 1e-9
    if fits:
        return {"physics.timestep": timestep}
    period = COARSE_CONTROL_PERIOD
    return {
        "physics.timestep": timestep,
        "physics.control_period": period,
        "record.period": 5 * period,
    }


def _primitives(timestep: float, tolerance: float) -> Entry:
    return Entry(
        "primitives",
        {"timestep_ms": 1000 * timestep, "wall_tolerance_mm": 1000 * tolerance},
        {**_clock(timestep), "physics.wall_tolerance": tolerance},
        lambda spec, network: float(0 * add_walls(spec, network, tolerance=tolerance)),
    )


def _exact(timestep: float) -> Entry:
    return Entry(
        "exact",
        {"timestep_ms": 1000 * timestep},
        {**_clock(timestep), "physics.collider": "exact"},
        lambda spec, network: float(0 * add_exact_walls(spec, network)),
        line_tracks=True,
    )


def _convex(work: Work, timestep: float, mesh: MeshSettings, **coacd: Any) -> Entry:
    return Entry(
        "convex",
        {
            "timestep_ms": 1000 * timestep,
            "sections": mesh.sections,
            "wall_mm": 1000 * mesh.thickness,
            **coacd,
        },
        _clock(timestep),
        lambda spec, network: convex_walls(spec, network, mesh, coacd, work.folder, work.limit_s),
    )


def _flex(timestep: float, sections: int, edge: float | None, radius: float) -> Entry:
    def walls(spec: mujoco.MjSpec, network: Assembly) -> float:
        flex_walls(spec, network, MeshSettings(sections, edge), radius)
        return 0.0

    edge_mm = None if edge is None else 1000 * edge
    settings = {
        "timestep_ms": 1000 * timestep,
        "sections": sections,
        "edge_mm": edge_mm,
        "radius_mm": 1000 * radius,
    }
    return Entry("flex", settings, _clock(timestep), walls)


def _sdf(
    timestep: float, mesh: MeshSettings, depth: int | None, iterations: int, points: int
) -> Entry:
    def walls(spec: mujoco.MjSpec, network: Assembly) -> float:
        sdf_walls(spec, network, mesh, depth, iterations, points)
        return 0.0

    settings = {
        "timestep_ms": 1000 * timestep,
        "sections": mesh.sections,
        "wall_mm": 1000 * mesh.thickness,
        "octree_depth": depth,
        "sdf_iterations": iterations,
        "sdf_initpoints": points,
    }
    return Entry("sdf", settings, _clock(timestep), walls, depth_factor=SDF_DEPTH_FACTOR)


def _bullet_entries() -> list[Entry]:
    if missing("bullet") is not None:
        return []
    from bullet_walls import SETTINGS

    return [
        Entry("bullet", {"name": name} | dataclasses.asdict(settings), _clock(settings.time_step))
        for name, settings in SETTINGS.items()
    ]


def _bullet_built(entry: Entry, scenario: Scenario) -> Built:
    from bullet_plant import make_bullet_plant
    from bullet_walls import SETTINGS, bullet_wall_error

    settings = SETTINGS[entry.settings["name"]]
    return Built(
        make_plant=make_bullet_plant(settings),
        wall_error=lambda *_: bullet_wall_error(scenario, settings),
        build_s=float("nan"),
        elements=None,
    )
