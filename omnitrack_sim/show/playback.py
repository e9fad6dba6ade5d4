"""Playback: a model in pipes with its states over time, which films, pages and maps show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.base.rotations import Array, matrix_from_quaternion
from omnitrack_sim.pipes import Assembly
from omnitrack_sim.record.display import CarriedCamera, Moment
from omnitrack_sim.record.trajectory import Trajectory
from omnitrack_sim.results.result import Result
from omnitrack_sim.walls.pipe_looks import ROBOT_GROUP

FARTHEST = 1e5
"""Largest magnitude of positions, m, and other shown values of a valid sample."""

POINTS_APART = 0.01
"""Travel between two points of a path on a map, m."""


@dataclass(frozen=True, eq=False)
class Playback:
    """A model in pipes with its states over time.

    Attributes:
        model: with the geoms that are seen.
        network: the pipes, world frame.
        time: (T,) s.
        qpos: (T, nq) joint positions.
        seen: numbers of the geoms that are seen; those of the world stand still like the pipes.
        casting: those of them that throw shadows.
        body: number of the body that cameras keep with.
        position: (T, 3) m, of that body.
        ahead: (T, 3) unit vectors, world frame, along which it drives.
        travel: (T,) m, way that it has gone, which always grows a little.
        path: (N,) samples through which maps draw the way that it has gone.
        backward: (T,) whether it drives tail first, which maps draw in another colour.
        estimate: (T, 3) m, where the robot takes itself to be; ``position`` where it does not say.
        mocap: (T, nmocap, 7) positions, m, and quaternions of the model's mocap bodies.
        mounts: cameras that bodies carry, by name.
        size: of lengths in pictures, over those for a robot in a bore of 160 mm.
        extremes: samples that tell how far the robot reaches about its body.
    """

    model: mujoco.MjModel
    network: Assembly
    time: Array
    qpos: Array
    seen: tuple[int, ...]
    casting: tuple[int, ...]
    body: int
    position: Array
    ahead: Array
    travel: Array
    path: NDArray[np.intp]
    backward: NDArray[np.bool_]
    estimate: Array
    mocap: Array
    mounts: Mapping[str, CarriedCamera]
    size: float = 1.0
    extremes: tuple[int, ...] = (0,)

    def row(self, time: float) -> int:
        """Return the sample nearest to ``time`` s, the earlier one of two."""
        clipped = np.clip(time, self.time[0], self.time[-1])
        return int(np.abs(self.time - clipped).argmin())

    def place(self, data: mujoco.MjData, row: int, qpos: Array | None = None) -> None:
        """Put the bodies of ``data`` where they are at a sample, or with joint positions (nq,)."""
        data.qpos[:] = self.qpos[row] if qpos is None else qpos
        data.mocap_pos[:], data.mocap_quat[:] = np.split(self.mocap[row], [3], axis=-1)
        mujoco.mj_kinematics(self.model, data)

    @property
    def still(self) -> tuple[int, ...]:
        """Geoms of the world that are seen, such as plates."""
        return tuple(geom for geom in self.seen if self.model.geom_bodyid[geom] == 0)

    @property
    def moving(self) -> tuple[int, ...]:
        """Geoms of bodies that are seen."""
        return tuple(geom for geom in self.seen if self.model.geom_bodyid[geom] > 0)


def playback_of(result: Result, coarse: bool = True) -> Playback:
    """Return the playback of a scenario's run; ``coarse`` faces are enough for films."""
    scenario, trajectory = result.scenario, sound(result)
    robot, display = scenario.robot, scenario.robot.display
    model = display.spec(result.pipes, scenario.plates, coarse).compile()
    seen = np.flatnonzero(model.geom_group == ROBOT_GROUP).tolist()
    position, samples = trajectory["position"], len(trajectory.time)
    return Playback(
        model=model,
        network=result.pipes,
        time=trajectory.time,
        qpos=display.poses(model, trajectory),
        seen=tuple(seen),
        casting=tuple(geom for geom in seen if display.casts_shadow(model.geom(geom).name)),
        body=model.body(robot.chassis).id,
        position=position,
        ahead=matrix_from_quaternion(trajectory["quaternion"])[:, :, 2],
        travel=_travel(trajectory),
        path=_path(trajectory),
        backward=trajectory["gear"] < 0,
        estimate=trajectory.channels.get("position_estimate", position),
        mocap=np.zeros((samples, model.nmocap, 7)),
        mounts={"onboard": display.camera},
    )


def _travel(trajectory: Trajectory) -> Array:
    """Travel (T,) m along the legs, which always grows a little, so that it can be inverted."""
    step = np.abs(np.diff(trajectory["distance"]))
    step = np.where((np.diff(trajectory["leg"]) == 0) & np.isfinite(step), step, 0.0)
    return np.append(0.0, np.cumsum(step + 1e-9))


def _path(trajectory: Trajectory) -> NDArray[np.intp]:
    """Samples at the beginnings of the legs, and about ``POINTS_APART`` of travel apart."""
    step = np.abs(np.diff(trajectory["distance"], prepend=trajectory["distance"][0]))
    marks = np.floor(np.cumsum(np.where(np.isfinite(step), step, 0.0)) / POINTS_APART)
    known = np.isfinite(trajectory["position"]).all(axis=1)
    new_leg = np.diff(trajectory["leg"], prepend=trajectory["leg"][:1]) != 0
    return np.flatnonzero(known & ((np.diff(marks, prepend=-1) > 0) | new_leg))


def moment_of(trajectory: Trajectory, row: int, part: str) -> Moment:
    """Return sample ``row`` of a record, with the robot's centre in the part of this name."""
    phase = trajectory.phases[int(trajectory["phase"][row])]
    return Moment(trajectory.time[row], phase, part, lambda name: trajectory[name][row])


def sound(result: Result) -> Trajectory:
    """Return the trajectory of a run, diverged samples replaced by the last finite one.

    Raises:
        RenderError: no sample is sound.
    """
    trajectory, names = result.trajectory, result.scenario.robot.display.finite
    values = [trajectory.qpos, *(trajectory[name] for name in names)]
    rows = sound_rows([value.reshape(len(trajectory.time), -1) for value in values])
    if (rows == np.arange(len(rows))).all():
        return trajectory
    channels = {name: values[rows] for name, values in trajectory.channels.items()}
    return replace(trajectory, channels=channels, qpos=trajectory.qpos[rows])


def sound_rows(values: list[Array]) -> NDArray[np.intp]:
    """Return for each sample of ``values``, each (T, ...), the last sound one up to it, or the
    first of all.

    Raises:
        RenderError: no sample is sound.
    """
    samples = len(values[0])
    far = [np.abs(value.reshape(samples, -1)).max(axis=1, initial=0.0) for value in values]
    sound = np.all([distance < FARTHEST for distance in far], axis=0)  # NaN is not less either
    if not sound.any():
        raise RenderError("the run has no pose that can be shown")
    first = int(np.argmax(sound))
    return np.maximum.accumulate(np.where(sound, np.arange(samples), first))
