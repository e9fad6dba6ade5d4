"""Paints triangles with OpenGL, in a context that is current, into pictures in memory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from omnitrack_sim.show.film import shaders
from omnitrack_sim.show.film.canvas import (
    Canvas,
    Image,
    Painted,
    Points,
    Program,
    Region,
    ShadowMap,
    bind,
)
from omnitrack_sim.show.film.sight import Eye, Sun
from omnitrack_sim.show.film.surfaces import Surface

NEAR_MAP, FINE_NEAR_MAP, FAR_MAP = 768, 1024, 3072
"""Width of the shadow maps of the robot, for each picture and for each fine one, and of all pipes,
texels: those of the robot are finer than the pixels of a film in its default size."""
GROUND = (0.145, 0.168, 0.2)
"""Red, green, blue behind everything outside of a pipe."""
MARGIN = shaders.REACH
"""How far what changes in a picture can change pixels beside it, pixels."""
_TO_TEXELS = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
_HERE = np.eye(3, 4)  # the pose of the world, which pipes belong to


class Painter:
    """A robot and pipes, painted in pictures of one size.

    Attributes:
        width, height: of the pictures, pixels.
        pipes: surfaces in the world frame, in the order handed over.
    """

    def __init__(
        self,
        robot: Surface,
        casting: Surface,
        pipes: Sequence[Surface],
        bodies: int,
        size: tuple[int, int],
        *,
        fine: bool = False,
        lamp: bool = False,
        sun: Sun | None = None,
    ):
        """
        Args:
            robot: in the frames of its bodies.
            casting: what of it throws shadows.
            pipes: what stands still, in the world frame.
            bodies: how many there are, with the world.
            size: width and height of the pictures, pixels.
            fine: paint with twice the width and height, and reduce.
            lamp: light from the eye instead of a sun.
            sun: that stands still, in whose light the pipes throw shadows.
        """
        self.width, self.height = size
        self._scale = 2 if fine else 1
        wide, high = self._scale * self.width, self._scale * self.height
        self._robot, self._casting = Painted(robot), Painted(casting)
        self.pipes = [Painted(pipe) for pipe in pipes]
        self._depth = Program(*shaders.depth(bodies))
        self._lamp, still = lamp, sun is not None
        self._light = Program(
            *(shaders.lamp(bodies) if lamp else shaders.sun(bodies, still, False))
        )
        self._gloss = Program(*shaders.sun(bodies, still, True))
        self._smooth = Program(*shaders.SMOOTH)
        self._edges, self._reduce = Program(*shaders.EDGES), Program(*shaders.REDUCE)
        self._drawn, self._smoothed = Canvas(wide, high, depths=True), Canvas(wide, high)
        self._reduced = Canvas(*size) if fine else self._smoothed
        blocks = (-(-wide // shaders.BLOCK), -(-high // shaders.BLOCK))
        self._contrast = Canvas(*blocks, form=(GL.GL_R8, GL.GL_RED))
        self._screen, self._points = GL.glGenVertexArrays(1), Points()
        self._near = ShadowMap(FINE_NEAR_MAP if fine else NEAR_MAP)
        self._far = ShadowMap(FAR_MAP)
        self._still: dict[str, Any] = {}
        if sun is not None:
            self._begin_map()
            self._far.cast(self.pipes, self._depth, view=sun.matrix, pose=_HERE)
            self._still = {"far_view": _TO_TEXELS @ sun.matrix, "far_map": 1}

    def paint(
        self,
        eye: Eye,
        poses: NDArray[np.float64],
        sun: Sun | None = None,
        clearness: Sequence[float] | None = None,
        region: Region | None = None,
        robot: bool = True,
    ) -> Image:
        """A picture (height, width, 3), or a region of it, the same to the bit.

        Args:
            eye: from where.
            poses: (bodies, 3, 4) rotation and place of each body.
            sun: its view of the robot; None with a lamp.
            clearness: of each pipe, 0 to 1: how much is seen of it; a pipe of 0 is left out.
            region: to paint; all when not given.
            robot: whether it is there.
        """
        region = region or Region(0, 0, self.width, self.height)
        rows = poses.reshape(-1, 4)
        shared: dict[str, Any] = {"pose": rows, "view": eye.matrix(self.width / self.height)}
        if sun is not None:
            self._begin_map()
            surfaces = [self._casting] if robot else []
            self._near.cast(surfaces, self._depth, view=sun.matrix, pose=rows)
            shared |= {"towards": sun.towards, "up": [0.0, 0.0, 1.0], "back": eye.frame[:, 2]}
            shared |= {"near_map": 0, "clearness": 1.0}
            shared |= {"near_view": _TO_TEXELS @ sun.matrix, **self._still}
        else:
            shared |= {"eye": eye.position, "ahead": -eye.frame[:, 2]}
        self._drawn.begin(self._around(region, self._scale, 2))
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthMask(True)
        GL.glDepthFunc(GL.GL_LEQUAL)
        GL.glClearColor(*((0.0, 0.0, 0.0) if self._lamp else GROUND), 1.0)
        GL.glClear(int(GL.GL_COLOR_BUFFER_BIT) | int(GL.GL_DEPTH_BUFFER_BIT))
        GL.glFrontFace(GL.GL_CW)  # rows come from the top
        GL.glEnable(GL.GL_CULL_FACE)
        bind(0, self._near.depths)
        bind(1, self._far.depths)
        if robot:
            self._gloss.use(**shared)
            self._robot.draw()
        self._light.use(**shared | {"pose": _HERE})
        self._draw(clearness or [1.0] * len(self.pipes))
        return self._finished(region)

    def _draw(self, clearness: Sequence[float]) -> None:
        """The pipes, then those that are partly clear."""
        for pipe, share in zip(self.pipes, clearness, strict=True):
            if share >= 1:
                pipe.draw()
        part = [(p, share) for p, share in zip(self.pipes, clearness, strict=True) if 0 < share < 1]
        if part:
            GL.glDepthMask(False)
            GL.glEnable(GL.GL_BLEND)
            GL.glBlendFunc(GL.GL_SRC_ALPHA, GL.GL_ONE_MINUS_SRC_ALPHA)
            for pipe, share in part:
                self._light.use(clearness=float(share))
                pipe.draw()
            GL.glDisable(GL.GL_BLEND)
            GL.glDepthMask(True)

    def _finished(self, region: Region) -> Image:
        """Smoothed, reduced and read."""
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        around = self._around(region, self._scale, 1)
        self._smoothed.copy(self._drawn, around)
        self._smooth_edges(around)
        if self._scale > 1:
            self._pass(self._smoothed, self._reduced, self._reduce, region)
        return self._reduced.read(region)

    def _smooth_edges(self, region: Region) -> None:
        """Smooth the blocks in which there are edges, as they are few."""
        size = shaders.BLOCK
        (left, top), (right, bottom) = (region.left // size, region.top // size), region.end
        blocks = Region(left, top, -(-right // size) - left, -(-bottom // size) - top)
        self._contrast.begin(blocks)
        bind(0, self._drawn.colours)
        pixel = [1 / self._drawn.width, 1 / self._drawn.height]
        self._edges.use(drawn=0, pixel=pixel)
        self._fill()
        rows, columns = np.nonzero(self._contrast.grey(blocks) >= 255 * shaders.LEAST_CONTRAST - 1)
        self._smoothed.begin(region)
        self._smooth.use(drawn=0, pixel=pixel)
        GL.glPointSize(size)
        self._points.draw(np.stack([columns + left, rows + top], axis=-1))

    def _pass(self, source: Canvas, target: Canvas, program: Program, region: Region) -> None:
        """Paint a region of one canvas from another one."""
        target.begin(region)
        bind(0, source.colours)
        program.use(drawn=0, pixel=[1 / target.width, 1 / target.height])
        self._fill()

    def _around(self, region: Region, scale: int, margins: int) -> Region:
        """A region in the pixels painted, with margins."""
        more = margins * MARGIN
        left, top = max(0, scale * region.left - more), max(0, scale * region.top - more)
        right = min(scale * self.width, scale * (region.left + region.width) + more)
        bottom = min(scale * self.height, scale * (region.top + region.height) + more)
        return Region(left, top, right - left, bottom - top)

    def _fill(self) -> None:
        GL.glBindVertexArray(self._screen)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)

    def _begin_map(self) -> None:
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glDepthMask(True)
        GL.glDepthFunc(GL.GL_LEQUAL)
        GL.glEnable(GL.GL_CULL_FACE)
        GL.glFrontFace(GL.GL_CCW)
