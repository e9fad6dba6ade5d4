"""A recorded run on a stage: its robot, pipes and light, to be painted at any time."""

from __future__ import annotations

import os
from bisect import bisect_right
from importlib import import_module
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.pipes import Assembly
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack.looks import look_pitch
from omnitrack_sim.robots.omnitrack.scene import build_looks
from omnitrack_sim.show.film.overlay import BOTH_PANELS, CameraPanel, MapPanel, StatusPanel
from omnitrack_sim.show.film.shaders import REACH
from omnitrack_sim.show.film.shots import (
    PANEL,
    FilmCamera,
    FollowCamera,
    Framing,
    OnboardCamera,
    PixelRect,
    SideCamera,
)
from omnitrack_sim.show.playback import smooth_belts, sound
from omnitrack_sim.show.projection import needs_map
from omnitrack_sim.show.surfaces import body_spheres, cut_pipe, geoms_surface, pipe_inside, seam
from omnitrack_sim.show.whereabouts import stays
from omnitrack_sim.walls.looks import ROBOT_GROUP

if TYPE_CHECKING:
    from omnitrack_sim.show.film.painter import Image, Painter

APT_LINE = "sudo apt-get install -y libegl1 libgl1-mesa-dri libopengl0"
"""Command that installs the libraries of headless rendering on Debian and Ubuntu."""
_REACH = 1.1  # of the robot about its centre, over what it is at the start


class Stage:
    """A recorded run, to be painted at any time from one camera.

    Args:
        result: the run.
        size: width and height of the pictures, pixels.
        camera: one of ``CAMERAS``.
        inset: pictures of a long route have a map.
        fine: paint with twice the width and height, and reduce.
        overlay: pictures have panels of status and, where recorded, of the robot's cameras.
    """

    def __init__(
        self,
        result: Result,
        size: tuple[int, int],
        camera: str,
        *,
        inset: bool = True,
        fine: bool = True,
        overlay: bool = True,
    ):
        self._context = _open_context(*size)
        self._result, self._aspect = result, size[0] / size[1]
        self.trajectory, scenario = sound(result.trajectory), result.scenario
        looks = build_looks(result.pipes, scenario.robot, plates=scenario.plates)
        self.model = looks.compile()
        self.data = mujoco.MjData(self.model)
        self._qpos = smooth_belts(self.model, self.trajectory, look_pitch(scenario.robot))
        self._pose(self._qpos[0])
        shown = self.model.geom_group == ROBOT_GROUP
        # Plates belong to the world: like pipes they stand still, also where no robot is painted.
        self._plates = np.flatnonzero(shown & (self.model.geom_bodyid == 0)).tolist()
        robot = np.flatnonzero(shown & (self.model.geom_bodyid > 0)).tolist()
        self._robot = geoms_surface(self.model, robot)
        # Light between the coils of a spring would be a row of dots.
        solid = [i for i in robot if not self.model.geom(i).name.startswith("look_spring")]
        self._casting = geoms_surface(self.model, solid)
        self._camera = self._camera_of(camera, overlay)
        self._painter = self._painter_of(result.pipes, size, fine)
        self._status = StatusPanel(*size) if overlay else None
        album = result.album if overlay else None
        self._pictures = None if album is None else CameraPanel(album, *size)
        mapped = inset and camera != "side" and needs_map(result)
        self._map = MapPanel(result, self.trajectory, size) if mapped else None
        self._stays = stays(result, self.trajectory)
        self._stays_begin = [stay.first for stay in self._stays]
        self._still: Image | None = None

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self._context.free()

    def row(self, time: float) -> int:
        """The sample nearest to ``time`` s, the earlier one of two."""
        times = self.trajectory.time
        return int(np.abs(times - np.clip(time, times[0], times[-1])).argmin())

    def picture(self, time: float) -> Image:
        """The frame (height, width, 3) at ``time`` s, with panels and map."""
        row = self.row(time)
        frame = self.paint(row, self._qpos[row])
        if self._status is not None:
            stay = self._stays[bisect_right(self._stays_begin, row) - 1]
            self._status.write(frame, self.trajectory, row, stay.part.name)
        if self._pictures is not None:
            gear = int(self.trajectory["gear"][row])
            self._pictures.write(frame, float(self.trajectory.time[row]), gear)
        if self._map is not None:
            self._map.write(frame, row)
        return frame

    def paint(self, row: int, qpos: Array) -> Image:
        """Paint the pipes and the robot with joint positions (nq,), from where the camera is at a
        sample.

        With a camera that stands still, only what the robot and its shadow can change is painted
        anew: the rest is the picture without them.
        """
        self._context.make_current()  # another stage may have been painted since
        self._pose(qpos)
        shot = self._camera.shot(row, *self._chassis())
        if not self._camera.stands:
            return self._painted(shot)
        if self._still is None:
            self._still = self._painted(shot, robot=False)
        frame = self._still.copy()
        rect = self._changed(shot)
        if rect is None:
            return self._painted(shot)
        left, top, width, height = rect
        if width > 0 and height > 0:
            part = self._painted(shot, rect)
            frame[top : top + height, left : left + width] = part
        return frame

    def _painted(self, shot: Framing, rect: PixelRect | None = None, robot: bool = True) -> Image:
        # A seam is seen where both of its parts are seen in full.
        seams = [float(min(shot.clearness[i], shot.clearness[j]) == 1) for i, j in self._joined]
        robot = robot and not self._camera.lamp
        rotation = self.data.xmat.reshape(-1, 3, 3)
        poses = np.concatenate([rotation, self.data.xpos[:, :, None]], axis=2)
        clearness = [*shot.clearness, *seams, *(1.0 for _ in self._plates)]
        return self._painter.paint(shot.eye, poses, shot.sun, clearness, rect, robot)

    def _changed(self, shot: Framing) -> PixelRect | None:
        """The pixels that robot and shadow can change; None where that cannot be told."""
        size, sun = np.array([self._painter.width, self._painter.height]), shot.sun
        assert sun is not None
        ends = np.stack([sun.middle, sun.middle - sun.reach * sun.towards])
        box = shot.eye.box(ends, sun.radius, self._aspect)
        if box is None:
            return None
        low = np.clip(np.floor(box[:2] * size).astype(int) - REACH, 0, size)
        high = np.clip(np.ceil(box[2:] * size).astype(int) + REACH, 0, size)
        return PixelRect(*low.tolist(), *(high - low).tolist())

    def _pose(self, qpos: Array) -> None:
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)

    def _chassis(self) -> tuple[Array, Array]:
        body = self.data.body("chassis")
        return np.array(body.xpos), np.array(body.xquat)

    def _camera_of(self, name: str, panels: bool) -> FilmCamera:
        result = self._result
        if name == "onboard":
            return OnboardCamera(result.pipes, self._aspect, result.scenario.robot.scale)
        centres, radii = body_spheres(self._robot, self.model.nbody)
        seen = radii > 0
        away = np.linalg.norm(self.data.xpos[seen] - self._chassis()[0], axis=1)
        extent = np.linalg.norm(centres[seen], axis=1) + radii[seen]
        reach = _REACH * float((away + extent).max())
        if name == "follow":
            return FollowCamera(self.trajectory, result.pipes, self._aspect, reach)
        height = PANEL if result.album is None else BOTH_PANELS
        covered = height if panels else 0.0
        return SideCamera(self.trajectory, result.pipes, self._aspect, reach, covered)

    def _painter_of(self, network: Assembly, size: tuple[int, int], fine: bool) -> Painter:
        """The painter with robot, pipes, seams and plates."""
        # PyOpenGL chooses its platform when it is imported, by that of the context.
        from omnitrack_sim.show.film.painter import Painter

        cut = self._camera.cut
        pipes = []
        for part in network.parts:
            towards = part.pose.rotation.T @ cut
            wall = cut_pipe(part.fitting, towards) if cut.any() else pipe_inside(part.fitting)
            pipes.append(wall.placed(part.pose))
        self._joined = []
        for (i, port), (j, other) in network.joints:
            a, b = network.parts[i], network.parts[j]
            radius = min(a.fitting.port_radius(port), b.fitting.port_radius(other))
            pipes.append(seam(a.port(port), radius, cut))
            self._joined.append((i, j))
        pipes += [geoms_surface(self.model, [plate]) for plate in self._plates]
        return Painter(
            self._robot,
            self._casting,
            pipes,
            self.model.nbody,
            size,
            fine=fine,
            lamp=self._camera.lamp,
            sun=self._camera.still_sun,
        )


def _open_context(width: int, height: int) -> Any:
    """A current offscreen OpenGL context: by MUJOCO_GL if that is set, otherwise EGL, then
    OSMesa."""
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    reasons = []
    for backend in [wanted] if wanted in ("egl", "osmesa", "glfw") else ["egl", "osmesa"]:
        try:
            context = import_module(f"mujoco.{backend}").GLContext(width, height)
            context.make_current()
            return context
        # OpenGL loaders raise anything: ImportError, AttributeError, RuntimeError, GLError
        except Exception as error:
            reasons.append(f"{backend}: {error}")
    raise RenderError(
        f"no offscreen OpenGL ({'; '.join(reasons)}). On Debian or Ubuntu: {APT_LINE}"
    )
