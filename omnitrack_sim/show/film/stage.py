"""A playback on a stage: its robot, pipes and light, to be painted at any time."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

import mujoco
import numpy as np

from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.text import installing
from omnitrack_sim.pipes import Assembly
from omnitrack_sim.show.film.overlay import Panel, draw_forces
from omnitrack_sim.show.film.shots import (
    FilmCamera,
    FollowCamera,
    OnboardCamera,
    OutsideCamera,
    SideCamera,
    is_outside,
)
from omnitrack_sim.show.playback import STANDARD, Playback
from omnitrack_sim.show.surfaces import (
    SEAM_ANGLES,
    Surface,
    body_spheres,
    cut_pipe,
    geoms_surface,
    pipe_inside,
    rings,
    seam,
)

if TYPE_CHECKING:
    from omnitrack_sim.show.film.painter import Image, Painter

APT_LINE = "sudo apt-get install -y libegl1 libgl1-mesa-dri libopengl0"
"""Command that installs the libraries of headless rendering on Debian and Ubuntu."""
_REACH = 1.1  # of the robot about its centre, over what it is at the start


class Stage:
    """A playback, to be painted at any time from one camera.

    Args:
        playback: bodies and pipes over time.
        size: width and height of the pictures, pixels.
        camera: ``side``, ``follow``, or one of the playback's mounts.
        panels: that are drawn over the pictures, in this order.
        covered: part of the pictures' height that panels take in the lower left corner.
        fine: paint with twice the width and height, and reduce.
    """

    def __init__(
        self,
        playback: Playback,
        size: tuple[int, int],
        camera: str,
        *,
        panels: Sequence[Panel] = (),
        covered: float = 0.0,
        fine: bool = True,
    ):
        self._context = _open_context(*size)
        self.playback, self._aspect, self._panels = playback, size[0] / size[1], panels
        self.model = playback.model
        self.data = mujoco.MjData(self.model)
        # Plates belong to the world: like pipes they stand still.
        self._plates = playback.still
        self._robot = geoms_surface(self.model, playback.moving)
        moving = set(playback.moving)
        self._casting = geoms_surface(self.model, [i for i in playback.casting if i in moving])
        self._camera = self._camera_of(camera, covered)
        self._painter = self._painter_of(playback.network, size, fine)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._context.free()

    def picture(self, time: float) -> Image:
        """The frame (height, width, 3) at ``time`` s, with panels."""
        row = self.playback.row(time)
        frame = self.paint(row)
        if self.playback.forces is not None:
            draw_forces(frame, self.playback.forces.lines(row), self._eye)
        for panel in self._panels:
            panel.write(frame, row)
        return frame

    def paint(self, row: int, qpos: Array | None = None) -> Image:
        """Paint the pipes and the robot from where the camera is at a sample.

        Joint positions (nq,) take the place of the sample's where these are given.
        """
        self._context.make_current()  # another stage may have been painted since
        self.playback.place(self.data, row, qpos)
        shot = self._camera.shot(row, self.data)
        self._eye = shot.eye
        # A seam is seen where both of its parts are seen in full.
        seams = [float(min(shot.clearness[i], shot.clearness[j]) == 1) for i, j in self._joined]
        rotation = self.data.xmat.reshape(-1, 3, 3)
        poses = np.concatenate([rotation, self.data.xpos[:, :, None]], axis=2)
        clearness = [*shot.clearness, *seams, *(1.0 for _ in self._plates)]
        return self._painter.paint(shot.eye, poses, shot.sun, clearness)

    def _camera_of(self, name: str, covered: float) -> FilmCamera:
        playback, aspect = self.playback, self._aspect
        if name not in STANDARD:
            mount = playback.mounts[name]
            if not is_outside(playback, mount):
                return OnboardCamera(playback, aspect, mount)
        reach = _REACH * max(self._extent(row) for row in playback.extremes)
        if name not in STANDARD:
            return OutsideCamera(playback, aspect, playback.mounts[name], reach)
        if name == "follow":
            return FollowCamera(playback, aspect, reach)
        return SideCamera(playback, aspect, reach, covered)

    def _extent(self, row: int) -> float:
        """Return the reach of the robot about its body at a sample, m."""
        self.playback.place(self.data, row)
        centres, radii = body_spheres(self._robot, self.model.nbody)
        seen = radii > 0
        body = self.data.xpos[self.playback.body]
        away = np.linalg.norm(self.data.xpos[seen] - body, axis=1)
        extent = np.linalg.norm(centres[seen], axis=1) + radii[seen]
        return float((away + extent).max())

    def _painter_of(self, network: Assembly, size: tuple[int, int], fine: bool) -> Painter:
        """The painter with robot, pipes, seams and plates."""
        # PyOpenGL chooses its platform when it is imported, by that of the context.
        from omnitrack_sim.show.film.painter import Painter

        cut = self._camera.cut
        pipes = []
        for part in network.parts:
            towards = part.pose.rotation.T @ cut
            wall = cut_pipe(part.fitting, towards) if cut.any() else pipe_inside(part.fitting)
            marks = rings(part) if self._camera.lamp else []
            pipes.append(Surface.joined([wall.placed(part.pose), *marks]))
        self._joined = []
        for (i, port), (j, other) in network.joints:
            a, b = network.parts[i], network.parts[j]
            radius: float | Array
            radius = min(a.fitting.port_radius(port), b.fitting.port_radius(other))
            if a.fitting.edge(port) is not None:
                radius = a.fitting.outline(port, SEAM_ANGLES)
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
    """Return a current offscreen OpenGL context: of ``MUJOCO_GL`` if set, else of this system.

    That is EGL or OSMesa on Linux, which need no screen, and GLFW elsewhere.
    """
    here = ["egl", "osmesa"] if sys.platform == "linux" else ["glfw"]
    wanted = os.environ.get("MUJOCO_GL", "").lower()
    reasons = []
    for backend in [wanted] if wanted in ("egl", "osmesa", "glfw") else here:
        try:
            context = import_module(f"mujoco.{backend}").GLContext(width, height)
            context.make_current()
            return context
        # OpenGL loaders raise anything: ImportError, AttributeError, RuntimeError, GLError
        except Exception as error:
            reasons.append(f"{backend}: {error}")
    hint = f"On Debian or Ubuntu: {APT_LINE}"
    if sys.platform != "linux":
        hint = f"It needs GLFW: {installing('view')}"
    raise RenderError(f"no offscreen OpenGL ({'; '.join(reasons)}). {hint}")
