"""Surfaces, programs, canvases and shadow maps in the memory of a current OpenGL context.

The programs are for OpenGL 4.0, from the files in ``glsl/``: vectors in the world frame, lengths in
m. A software OpenGL skips no branches, but loops that are over before they begin, and pixels that
are discarded: so a branch that costs much is written as one of these. What is linear over a
triangle is worked out at its corners, of which there are far fewer than pixels.

MuJoCo's renderer takes 4.6 to 6.7 times the processor time for a tee turn with smooth edges, from
either camera, and 1.7 to 2.4 times with jagged ones (1280 x 720, Mesa's software OpenGL).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from OpenGL import GL
from OpenGL.GL.shaders import compileProgram, compileShader
from OpenGL.raw.GL.VERSION.GL_2_0 import glVertexAttribPointer

from omnitrack_sim.show.film.shots import Eye, Sun
from omnitrack_sim.show.surfaces import Surface, body_spheres

_SIZES = (3, 3, 4, 1)  # floats of position, normal, colour, body
# Slope and units by which depths in a map lie behind: else a wall would throw dots of shadow on
# itself where a texel is wider than the pixel that looks it up.
_FILLS_ITS_MAP = (1.5, 4.0)
BLOCK = 4
"""Width of the blocks in which edges are looked for, pixels."""
MIN_CONTRAST = 0.06
"""Least contrast of green, 0 to 1, that counts as an edge."""

_MARGIN = 4 * BLOCK
"""Pixels about an edge that smoothing may change: it is followed for 10, from a block beside it."""

Image = NDArray[np.uint8]
Box = tuple[int, int, int, int]
"""Column and row of a first pixel, width and height."""


class Painted:
    """A surface in the memory of OpenGL."""

    def __init__(self, surface: Surface):
        self.surface = surface
        columns = (surface.position, surface.normal, surface.colour, surface.body[:, None])
        data = np.concatenate(columns, axis=1).astype(np.float32)
        self._array = GL.glGenVertexArrays(1)
        GL.glBindVertexArray(self._array)
        targets = (GL.GL_ARRAY_BUFFER, GL.GL_ELEMENT_ARRAY_BUFFER)
        for target, values in zip(targets, (data, surface.faces), strict=True):
            GL.glBindBuffer(target, GL.glGenBuffers(1))
            GL.glBufferData(target, values.nbytes, values, GL.GL_STATIC_DRAW)
        for place, size in enumerate(_SIZES):
            start = ctypes.c_void_p(data.itemsize * sum(_SIZES[:place]))
            GL.glEnableVertexAttribArray(place)
            # Raw: PyOpenGL would keep the offset as a pointer, by a context that it does not find
            # where something else has loaded it for another platform before.
            glVertexAttribPointer(place, size, GL.GL_FLOAT, False, data.strides[0], start)

    def draw(self) -> None:
        """Draw the surface with the program in use."""
        GL.glBindVertexArray(self._array)
        GL.glDrawElements(GL.GL_TRIANGLES, self.surface.faces.size, GL.GL_UNSIGNED_INT, None)


class Program:
    """A program of OpenGL, and its values by name.

    Args:
        vertex, pixel: names of its two files.
        words: defined in both, each maybe with a value.
    """

    def __init__(self, vertex: str, pixel: str, *words: str):
        def shader(name: str, kind: int) -> int:
            file = Path(__file__).parent / "glsl" / name
            version, rest = file.read_text(encoding="utf-8").split("\n", 1)
            return compileShader("\n".join([version, *definitions, rest]), kind)

        definitions = [f"#define {word}" for word in words]
        # Validated by the first picture: before there is one, nothing is bound that it could use.
        self.id = compileProgram(
            shader(vertex, GL.GL_VERTEX_SHADER),
            shader(pixel, GL.GL_FRAGMENT_SHADER),
            validate=False,
        )
        self._places: dict[str, int] = {}

    def use(self, **values: int | float | ArrayLike) -> None:
        """Use the program with these uniforms.

        They are texture units, numbers, vectors of 2 or 3, rows of vectors of 4, or matrices (4,
        4).
        """
        GL.glUseProgram(self.id)
        for name, value in values.items():
            if name not in self._places:
                self._places[name] = GL.glGetUniformLocation(self.id, name)
            if self._places[name] >= 0:  # it is used
                self._set(self._places[name], value)

    def _set(self, place: int, value: int | float | ArrayLike) -> None:
        if isinstance(value, int):
            GL.glUniform1i(place, value)
        elif isinstance(value, float):
            GL.glUniform1f(place, value)
        else:
            array = np.ascontiguousarray(value, np.float32)
            if array.shape == (4, 4):
                GL.glUniformMatrix4fv(place, 1, GL.GL_TRUE, array)
            else:
                setters = {2: GL.glUniform2fv, 3: GL.glUniform3fv, 4: GL.glUniform4fv}
                setters[array.shape[-1]](place, array.size // array.shape[-1], array)


class Canvas:
    """Canvas: colours that can be looked up, and depths where they are wanted."""

    def __init__(
        self,
        width: int,
        height: int,
        depths: bool = False,
        form: tuple[int, int] = (GL.GL_RGBA8, GL.GL_RGBA),
    ):
        self.width, self.height = width, height
        self.colours = _texture(*form, width, height)
        self._buffer = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._buffer)
        _attach(GL.GL_COLOR_ATTACHMENT0, self.colours)
        if depths:
            store = GL.glGenRenderbuffers(1)
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, store)
            target = GL.GL_RENDERBUFFER
            GL.glRenderbufferStorage(target, GL.GL_DEPTH_COMPONENT24, width, height)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, target, store)

    def begin(self) -> None:
        """Make the canvas the target of painting."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._buffer)
        GL.glViewport(0, 0, self.width, self.height)

    @property
    def whole(self) -> Box:
        """Box of all pixels."""
        return 0, 0, self.width, self.height

    def copy(self, source: Canvas, box: Box) -> None:
        """Copy the colours in a box of another canvas."""
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, source._buffer)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._buffer)
        x, y, width, height = box
        edges = x, y, x + width, y + height
        GL.glBlitFramebuffer(*edges, *edges, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)

    def read(self, box: Box, grey: bool = False) -> Image:
        """Return the pixels (h, w, 3) of a box; with ``grey`` their red (h, w) alone."""
        form, channels = (GL.GL_RED, ()) if grey else (GL.GL_RGB, (3,))
        pixels = np.empty((box[3], box[2], *channels), np.uint8)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._buffer)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        GL.glReadPixels(*box, form, GL.GL_UNSIGNED_BYTE, array=pixels)
        return pixels


class Points:
    """Points in a buffer that is filled anew for each picture."""

    def __init__(self) -> None:
        self._array, self._buffer = GL.glGenVertexArrays(1), GL.glGenBuffers(1)
        GL.glBindVertexArray(self._array)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
        GL.glEnableVertexAttribArray(0)
        glVertexAttribPointer(0, 2, GL.GL_FLOAT, False, 8, ctypes.c_void_p(0))

    def draw(self, places: NDArray) -> None:
        """Draw points at ``places`` (n, 2) with the program in use."""
        if len(places):
            data = places.astype(np.float32)
            GL.glBindVertexArray(self._array)
            GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
            GL.glBufferData(GL.GL_ARRAY_BUFFER, data.nbytes, data, GL.GL_STREAM_DRAW)
            GL.glDrawArrays(GL.GL_POINTS, 0, len(data))


class ShadowMap:
    """Shadow map: depths from the direction of a sun."""

    def __init__(self, size: int):
        self.size = size
        self.depths = _texture(GL.GL_DEPTH_COMPONENT24, GL.GL_DEPTH_COMPONENT, size, size)
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_NEAREST)
        mode, function = GL.GL_TEXTURE_COMPARE_MODE, GL.GL_TEXTURE_COMPARE_FUNC
        GL.glTexParameteri(GL.GL_TEXTURE_2D, mode, GL.GL_COMPARE_REF_TO_TEXTURE)
        GL.glTexParameteri(GL.GL_TEXTURE_2D, function, GL.GL_LEQUAL)
        self._buffer = GL.glGenFramebuffers(1)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._buffer)
        _attach(GL.GL_DEPTH_ATTACHMENT, self.depths)
        GL.glDrawBuffer(GL.GL_NONE)
        GL.glReadBuffer(GL.GL_NONE)

    def cast(self, surfaces: Sequence[Painted], program: Program, **values: Any) -> None:
        """Fill the map with these surfaces."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._buffer)
        GL.glViewport(0, 0, self.size, self.size)
        GL.glClear(GL.GL_DEPTH_BUFFER_BIT)
        GL.glEnable(GL.GL_POLYGON_OFFSET_FILL)
        GL.glPolygonOffset(*_FILLS_ITS_MAP)
        program.use(**values)
        for surface in surfaces:
            surface.draw()
        GL.glDisable(GL.GL_POLYGON_OFFSET_FILL)


def bind(unit: int, texture: int) -> None:
    """Bind a texture to a texture unit."""
    GL.glActiveTexture(int(GL.GL_TEXTURE0) + unit)
    GL.glBindTexture(GL.GL_TEXTURE_2D, texture)


def _test_depths(front: int) -> None:
    """Enable the depth test and cull back faces; ``front``: winding of front faces."""
    GL.glEnable(GL.GL_DEPTH_TEST)
    GL.glDepthMask(True)
    GL.glDepthFunc(GL.GL_LEQUAL)
    GL.glEnable(GL.GL_CULL_FACE)
    GL.glFrontFace(front)


def _attach(place: int, texture: int) -> None:
    GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, place, GL.GL_TEXTURE_2D, texture, 0)


def _texture(kind: int, form: int, width: int, height: int) -> int:
    """Make a texture with linear filtering, clamped to its edge."""
    texture = GL.glGenTextures(1)
    bind(0, texture)
    GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, kind, width, height, 0, form, GL.GL_UNSIGNED_BYTE, None)
    for name, value in (
        (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
        (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
        (GL.GL_TEXTURE_WRAP_S, GL.GL_CLAMP_TO_EDGE),
        (GL.GL_TEXTURE_WRAP_T, GL.GL_CLAMP_TO_EDGE),
    ):
        GL.glTexParameteri(GL.GL_TEXTURE_2D, name, value)
    return texture


NEAR_MAP, FINE_NEAR_MAP, FAR_MAP = 768, 1024, 3072
"""Width of the shadow maps of the robot, for each picture and for each fine one, and of all pipes,
texels: those of the robot are finer than the pixels of a film in its default size."""
GROUND = (0.145, 0.168, 0.2)
"""Red, green, blue behind everything outside of a pipe."""
DAYLIGHT = (0.74, 0.81, 0.88)
"""The same where the eye has a lamp: what is seen through an open end."""
_TO_TEXELS = np.array([[0.5, 0, 0, 0.5], [0, 0.5, 0, 0.5], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
_HERE = np.eye(3, 4)  # the pose of the world, which pipes belong to


class Painter:
    """Painter of a robot and pipes in pictures of one size.

    Args:
        robot: in the frames of its bodies.
        casting: what of it throws shadows.
        pipes: what stands still, in the world frame; clearness is given in this order.
        bodies: number of bodies, with the world.
        size: width and height of the pictures, pixels.
        fine: paint with twice the width and height, and reduce.
        lamp: light from the eye instead of a sun.
        sun: that stands still, in whose light the pipes throw shadows.
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
        self.width, self.height = size
        scale = 2 if fine else 1
        wide, high = scale * self.width, scale * self.height
        self._robot, self._casting = Painted(robot), Painted(casting)
        self.pipes = [Painted(pipe) for pipe in pipes]
        self._lamp = lamp
        self._make_programs(bodies, sun is not None)
        self._drawn, self._smoothed = Canvas(wide, high, depths=True), Canvas(wide, high)
        self._reduced = Canvas(*size) if fine else self._smoothed
        blocks = (-(-wide // BLOCK), -(-high // BLOCK))
        self._contrast = Canvas(*blocks, form=(GL.GL_R8, GL.GL_RED))
        self._screen, self._points = GL.glGenVertexArrays(1), Points()
        self._near = ShadowMap(FINE_NEAR_MAP if fine else NEAR_MAP)
        self._far = ShadowMap(FAR_MAP)
        self._still: dict[str, Any] = {}
        self._spheres = body_spheres(Surface.joined([robot, casting]), bodies)
        self._backdrop: tuple[Canvas, Image] | None = None
        self._painted: Box = (0, 0, 0, 0)  # what the backdrop has to be brought back to
        if sun is not None:
            _test_depths(GL.GL_CCW)
            self._far.cast(self.pipes, self._depth, view=sun.matrix, pose=_HERE)
            self._still = {"far_view": _TO_TEXELS @ sun.matrix, "far_map": 1}

    def _make_programs(self, bodies: int, still: bool) -> None:
        """Make the programs; with a ``still`` sun the pipes throw shadows, too."""
        body, block = f"BODIES {bodies}", f"BLOCK {BLOCK}.0"
        sun = ("body.vert", "sun.frag", body, "PICTURE", "SUN", *(["STILL"] if still else []))
        lamp = ("body.vert", "lamp.frag", body, "PICTURE", "LAMP")
        self._depth = Program("body.vert", "nothing.frag", body)
        self._light = Program(*(lamp if self._lamp else sun))
        self._gloss = Program(*sun, "GLOSSY")
        # The contrast within each block and those around it, and the stairs of edges in blocks.
        self._edges = Program("screen.vert", "edges.frag", block)
        contrast = f"MIN_CONTRAST {MIN_CONTRAST}"
        self._smooth = Program("blocks.vert", "smooth.frag", block, contrast)
        self._reduce = Program("screen.vert", "reduce.frag")  # the mean of each two by two pixels

    def paint(
        self,
        eye: Eye,
        poses: NDArray[np.float64],
        sun: Sun | None,
        clearness: Sequence[float],
    ) -> Image:
        """Return a picture (height, width, 3).

        Args:
            eye: from where.
            poses: (bodies, 3, 4) rotation and place of each body.
            sun: its view of the robot; None with a lamp.
            clearness: of each pipe, 0 to 1: how much is seen of it.
        """
        if not self._still or sun is None or self._reduced is not self._smoothed:
            self._paint(eye, poses, sun, clearness, self._drawn.whole)
            return self._reduced.read(self._reduced.whole)
        # Pipes in the light of a sun that stands still, seen by an eye that does, too: only the
        # robot and its shadow change.
        canvas, picture = self._backdrop or self._make_backdrop((eye, poses, sun, clearness))
        self._drawn.copy(canvas, self._painted)
        self._painted = box = self._box_of_robot(eye, poses, sun)
        self._paint(eye, poses, sun, clearness, box)
        picture, (x, y, width, height) = picture.copy(), box
        picture[y : y + height, x : x + width] = self._smoothed.read(box)
        return picture

    def _make_backdrop(
        self, shot: tuple[Eye, NDArray[np.float64], Sun, Sequence[float]]
    ) -> tuple[Canvas, Image]:
        """Return the pipes without the robot: before their edges are smoothed, and after."""
        canvas = Canvas(self.width, self.height)
        self._paint(*shot, self._drawn.whole, robot=False)
        canvas.copy(self._drawn, canvas.whole)
        self._backdrop = canvas, self._smoothed.read(self._smoothed.whole)
        return self._backdrop

    def _box_of_robot(self, eye: Eye, poses: NDArray[np.float64], sun: Sun) -> Box:
        """Return the box, of whole blocks, of the pixels that robot and shadow may change."""
        centres, radii = self._spheres
        seen = radii > 0
        world = np.einsum("bij,bj->bi", poses[seen, :, :3], centres[seen]) + poses[seen, :, 3]
        to_sun = sun.matrix
        places = world @ to_sun[:3, :3].T + to_sun[:3, 3]
        reach = radii[seen, None] * np.linalg.norm(to_sun[:3, :3], axis=1)
        low, high = (places - reach).min(axis=0), (places + reach).max(axis=0)
        high[2] = max(high[2], 1.0)  # as far as there are shadows
        corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), -1).reshape(-1, 3)
        to_eye = eye.matrix(self.width / self.height) @ np.linalg.inv(to_sun)
        clip = np.c_[corners, np.ones(8)] @ to_eye.T
        if not (clip[:, 3] > 0).all():  # behind the eye
            return self._drawn.whole
        size = np.array([self.width, self.height])
        pixels = (clip[:, :2] / clip[:, 3:] + 1) / 2 * size
        first = np.clip((pixels.min(axis=0) - _MARGIN) // BLOCK * BLOCK, 0, size - 1)
        last = np.clip(pixels.max(axis=0) + _MARGIN, first + 1, size)
        x, y, right, top = np.ceil([*first, *last]).astype(int).tolist()
        return x, y, right - x, top - y

    def _paint(
        self,
        eye: Eye,
        poses: NDArray[np.float64],
        sun: Sun | None,
        clearness: Sequence[float],
        box: Box,
        robot: bool = True,
    ) -> None:
        """Paint the pixels of a box, with the robot or without."""
        rows = poses.reshape(-1, 4)
        shared: dict[str, Any] = {"pose": rows, "view": eye.matrix(self.width / self.height)}
        if sun is not None:
            _test_depths(GL.GL_CCW)
            casting = [self._casting] if robot else []
            self._near.cast(casting, self._depth, view=sun.matrix, pose=rows)
            shared |= {"towards": sun.towards, "up": [0.0, 0.0, 1.0], "back": eye.frame[:, 2]}
            shared |= {"near_map": 0, "clearness": 1.0}
            shared |= {"near_view": _TO_TEXELS @ sun.matrix, **self._still}
        else:
            shared |= {"eye": eye.position, "ahead": -eye.frame[:, 2]}
        self._drawn.begin()
        GL.glEnable(GL.GL_SCISSOR_TEST)
        GL.glScissor(*box)
        _test_depths(GL.GL_CW)  # rows come from the top
        GL.glClearColor(*(DAYLIGHT if self._lamp else GROUND), 1.0)
        GL.glClear(int(GL.GL_COLOR_BUFFER_BIT) | int(GL.GL_DEPTH_BUFFER_BIT))
        bind(0, self._near.depths)
        bind(1, self._far.depths)
        if robot and not self._lamp:  # who sees by a lamp is the robot itself
            self._gloss.use(**shared)
            self._robot.draw()
        self._light.use(**shared | {"pose": _HERE})
        self._draw(clearness)
        self._finish(box)
        GL.glDisable(GL.GL_SCISSOR_TEST)

    def _draw(self, clearness: Sequence[float]) -> None:
        """Draw the opaque pipes, then the translucent ones."""
        for pipe, share in zip(self.pipes, clearness, strict=True):
            if share >= 1:
                pipe.draw()
        # After all that is opaque, and without depths of their own, or one would hide the next.
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

    def _finish(self, box: Box) -> None:
        """Smooth and reduce the pixels of a box."""
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        # Pixels that are not smoothed stay as they were drawn.
        self._smoothed.copy(self._drawn, box)
        self._smooth_edges(box)
        if self._reduced is not self._smoothed:
            GL.glDisable(GL.GL_SCISSOR_TEST)
            self._reduced.begin()
            bind(0, self._smoothed.colours)
            self._reduce.use(drawn=0, pixel=[1 / self.width, 1 / self.height])
            self._fill()

    def _smooth_edges(self, box: Box) -> None:
        """Smooth the blocks of a box in which there are edges, as they are few."""
        x, y = box[0] // BLOCK, box[1] // BLOCK
        blocks = x, y, -(-(box[0] + box[2]) // BLOCK) - x, -(-(box[1] + box[3]) // BLOCK) - y
        self._contrast.begin()
        GL.glScissor(*blocks)
        bind(0, self._drawn.colours)
        pixel = [1 / self._drawn.width, 1 / self._drawn.height]
        self._edges.use(drawn=0, pixel=pixel)
        self._fill()
        edges = self._contrast.read(blocks, grey=True) >= 255 * MIN_CONTRAST - 1
        self._smoothed.begin()
        GL.glScissor(*box)
        self._smooth.use(drawn=0, pixel=pixel)
        GL.glPointSize(BLOCK)
        self._points.draw(np.argwhere(edges)[:, ::-1] + [x, y])

    def _fill(self) -> None:
        GL.glBindVertexArray(self._screen)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
