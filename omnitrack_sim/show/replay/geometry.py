"""The robot, its motion, the pipes and the cameras of a replay page."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, Pose
from omnitrack_sim.pipes import Assembly
from omnitrack_sim.record.channels import TRACKS
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack import MODULES
from omnitrack_sim.robots.omnitrack.looks import (
    FIELD_OF_VIEW,
    ROBOT_GROUP,
    follow_direction,
    look_pitch,
    view_direction,
)
from omnitrack_sim.show.film.shots import DISTANCE, view_directions
from omnitrack_sim.show.playback import belt_travel
from omnitrack_sim.show.replay.packing import Pack, rounded
from omnitrack_sim.show.surfaces import Surface, cut_pipe, geoms_surface, pipe_inside
from omnitrack_sim.walls.meshes import THICKNESS, cut_normal

SECTIONS = 96
"""Corners of a pipe's cross-section: a reader may come as near as he likes."""
NORMAL_STEPS = 127
"""A component of a normal is a whole number up to this, one byte."""
POSITION_STEP = 1e-5
"""Step of the positions of bodies, m."""
TURN_STEP = 1 / 32767
"""Step of the components of quaternions: 3e-5 rad, or 3 micrometres at the robot's rim."""
FARTHER = 1.35
"""Distance of the camera that follows, over that in films: a page can be zoomed."""
TIME_STEP = 1e-6
"""Step of the times, s."""


class Shapes:
    """Surfaces in a pack, each once, however many bodies or pipes have it."""

    def __init__(self, pack: Pack) -> None:
        self.tables: list[dict[str, Any]] = []
        self._pack = pack
        self._known: dict[bytes, int] = {}

    def add(self, surface: Surface) -> int:
        """Return the number of a surface."""
        normal = np.rint(NORMAL_STEPS * surface.normal).astype(np.int64)
        key = b"".join(a.tobytes() for a in (surface.position, normal, surface.faces))
        if key not in self._known:
            self._known[key] = len(self.tables)
            self.tables.append(
                {
                    "vertices": self._pack.ranged(surface.position),
                    "normals": self._pack.whole(normal),
                    "faces": self._pack.whole(surface.faces.ravel()),
                }
            )
        return self._known[key]


def robot_table(
    result: Result, trajectory: Trajectory, model: mujoco.MjModel, pack: Pack, shapes: Shapes
) -> dict[str, Any]:
    """The robot of a run and how it moves.

    Bodies but for the tracks have poses over time; a track lies on its module, as far along its
    axis as its belt has run within half a visible pitch.
    """
    robot = result.scenario.robot
    tracks = [(track, i) for i in range(1, MODULES + 1) for track in TRACKS]
    carried = {f"track_{track}_{i}": (track, i) for track, i in tracks}
    names = [model.body(i).name for i in range(1, model.nbody)]
    moved = [name for name in names if name not in carried]
    poses = body_poses(model, trajectory, moved)
    samples = len(poses)
    bodies = []
    for name in names:
        table = _body(model, name, shapes)
        if name in carried:
            track, module = carried[name]
            axis = np.array(model.joint(f"belt_{track}_{module}").axis)
            table |= {"on": moved.index(f"module_{module}"), "axis": rounded(axis, 6)}
            table |= {"module": module - 1, "track": TRACKS.index(track)}
        bodies.append(table)
    return {
        "bodies": bodies,
        "moved": moved,
        "positions": pack.steps(poses[..., :3].reshape(samples, -1), POSITION_STEP),
        "turns": pack.steps(poses[..., 3:].reshape(samples, -1), TURN_STEP),
        "travel": pack.steps(belt_travel(trajectory), POSITION_STEP),
        "pitch": look_pitch(robot),
        "scale": robot.scale,
    }


def _body(model: mujoco.MjModel, name: str, shapes: Shapes) -> dict[str, Any]:
    """Return the surface of a body, and how many of its vertices have which colour."""
    body = model.body(name).id
    geoms = np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == ROBOT_GROUP))
    if not len(geoms):
        return {"name": name}
    surface = geoms_surface(model, geoms, fine=True)
    paint = surface.colour[:, :3]
    first = np.flatnonzero((np.diff(paint, axis=0, prepend=-1.0) != 0).any(axis=1))
    counts = np.diff(np.append(first, len(paint))).tolist()
    colours = [[count, rounded(paint[i], 4)] for i, count in zip(first, counts, strict=True)]
    return {"name": name, "shape": shapes.add(surface), "colours": colours}


def body_poses(model: mujoco.MjModel, trajectory: Trajectory, names: list[str]) -> Array:
    """Position, m, and quaternion of bodies (T, B, 7) by MuJoCo's kinematics, world frame; no
    quaternion turns its sign from one sample to the next."""
    data, rows = mujoco.MjData(model), [model.body(name).id for name in names]
    poses = np.empty((len(trajectory.time), len(rows), 7))
    for pose, qpos in zip(poses, trajectory.qpos, strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        pose[:, :3], pose[:, 3:] = data.xpos[rows], data.xquat[rows]
    turns = poses[..., 3:]
    flips = np.where((turns[1:] * turns[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
    turns[1:] *= np.cumprod(flips, axis=0)[..., None]
    return poses


def pipes_table(network: Assembly, model: mujoco.MjModel, shapes: Shapes) -> dict[str, Any]:
    """Each part's half that stays when it is cut open towards the film's viewer, its half cut
    away, its inside, and where it lies; the plates; the directions of the camera that sees all."""
    towards = view_direction(network)

    def piece(surface: Surface, pose: Pose) -> dict[str, Any]:
        place = {"position": rounded(pose.position, 6), "turn": rounded(pose.quaternion, 7)}
        return {"shape": shapes.add(surface)} | place

    parts = []
    for part in network.parts:
        fitting, rotation, samples = part.fitting, part.pose.rotation, part.bore_samples()
        local = rotation.T @ towards
        table = {
            "name": part.name,
            "kept": piece(cut_pipe(fitting, local, SECTIONS), part.pose),
            "front": piece(cut_pipe(fitting, local, SECTIONS, keep=False), part.pose),
            "inside": piece(pipe_inside(fitting, SECTIONS), part.pose),
            "cut": rounded(rotation @ cut_normal(fitting, local), 6),
            "low": rounded(samples.min(axis=0) - THICKNESS, 4),
            "high": rounded(samples.max(axis=0) + THICKNESS, 4),
        }
        parts.append(table)
    world = np.flatnonzero((model.geom_bodyid == 0) & (model.geom_group == ROBOT_GROUP))
    plates = [geoms_surface(model, [geom], fine=True) for geom in world.tolist()]
    return {
        "parts": parts,
        "plates": [piece(p, Pose()) | {"colour": rounded(p.colour[0, :3], 4)} for p in plates],
        "pipe": rounded(model.mat("pipe").rgba[:3], 4),
        "towards": rounded(towards, 6),
        "back": rounded(follow_direction(network), 6),
        "fov": FIELD_OF_VIEW,
    }


def follow_table(result: Result, trajectory: Trajectory, pack: Pack) -> dict[str, Any]:
    """Return distance, m, and direction at each sample of the camera that keeps with the robot, as
    in films."""
    routes = result.routes()
    directions = view_directions(trajectory, routes, follow_direction(result.pipes))
    distance = FARTHER * DISTANCE * result.scenario.robot.scale
    return {"distance": distance, "directions": pack.steps(directions, 1e-4)}
