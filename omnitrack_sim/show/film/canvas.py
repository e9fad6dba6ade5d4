"""What OpenGL keeps: surfaces, programs, canvases and maps of shadows, in a context that is
current."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from OpenGL import GL

from omnitrack_sim.show.film.surfaces import Surface

_SIZES = (3, 3, 4, 1)  # floats of position, normal, colour, body
_FILLS_ITS_MAP = (1.5, 4.0)  # slope and units by which depths in a map lie behind

Image = NDArray[np.uint8]


class Region(NamedTuple):
    """A part of a picture, pixels from its upper left corner."""

    left: int
    top: int
    width: int
    height: int

    @property
    def end(self) -> tuple[int, int]:
        """Right and bottom, the first pixels beyond it."""
        return self.left + self.width, self.top + self.height


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
            GL.glVertexAttribPointer(place, size, GL.GL_FLOAT, False, data.strides[0], start)

    def draw(self) -> None:
        """With the program in use."""
        GL.glBindVertexArray(self._array)
        GL.glDrawElements(GL.GL_TRIANGLES, self.surface.faces.size, GL.GL_UNSIGNED_INT, None)


class Program:
    """A program of OpenGL, and its values by name."""

    def __init__(self, vertex: str, pixel: str):
        self.id = GL.glCreateProgram()
        for kind, source in ((GL.GL_VERTEX_SHADER, vertex), (GL.GL_FRAGMENT_SHADER, pixel)):
            shader = GL.glCreateShader(kind)
            GL.glShaderSource(shader, source)
            GL.glCompileShader(shader)
            if not GL.glGetShaderiv(shader, GL.GL_COMPILE_STATUS):
                raise RuntimeError(GL.glGetShaderInfoLog(shader).decode())
            GL.glAttachShader(self.id, shader)
        GL.glLinkProgram(self.id)
        if not GL.glGetProgramiv(self.id, GL.GL_LINK_STATUS):
            raise RuntimeError(GL.glGetProgramInfoLog(self.id).decode())
        self._places: dict[str, int] = {}

    def use(self, **values: int | float | ArrayLike) -> None:
        """From here on, with these values: of a texture's number, a number, vectors of 3, rows of
        vectors of 4, or a matrix (4, 4)."""
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
    """What is painted on: colours that can be looked up, and depths where they are asked for."""

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

    def begin(self, region: Region) -> None:
        """Paint here from now on, in this region only."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._buffer)
        GL.glViewport(0, 0, self.width, self.height)
        if region == (0, 0, self.width, self.height):
            GL.glDisable(GL.GL_SCISSOR_TEST)  # clearing all of it is faster
        else:
            GL.glEnable(GL.GL_SCISSOR_TEST)
            GL.glScissor(*region)

    def copy(self, source: Canvas, region: Region) -> None:
        """Take over a region of another canvas of this size."""
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, source._buffer)
        GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._buffer)
        left, top, right, bottom = region.left, region.top, *region.end
        box = (left, top, right, bottom)
        GL.glBlitFramebuffer(*box, *box, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)

    def read(self, region: Region) -> Image:
        """The pixels (h, w, 3) of a region."""
        return self._read(region, GL.GL_RGB, (3,))

    def grey(self, region: Region) -> Image:
        """The red of the pixels (h, w) of a region."""
        return self._read(region, GL.GL_RED, ())

    def _read(self, region: Region, form: int, channels: tuple[int, ...]) -> Image:
        pixels = np.empty((region.height, region.width, *channels), np.uint8)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._buffer)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        GL.glReadPixels(*region, form, GL.GL_UNSIGNED_BYTE, array=pixels)
        return pixels


class Points:
    """Points that are others each time."""

    def __init__(self) -> None:
        self._array, self._buffer = GL.glGenVertexArrays(1), GL.glGenBuffers(1)
        GL.glBindVertexArray(self._array)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
        GL.glEnableVertexAttribArray(0)
        GL.glVertexAttribPointer(0, 2, GL.GL_FLOAT, False, 8, ctypes.c_void_p(0))

    def draw(self, places: NDArray) -> None:
        """Points at ``places`` (n, 2), with the program in use."""
        if len(places):
            data = places.astype(np.float32)
            GL.glBindVertexArray(self._array)
            GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
            GL.glBufferData(GL.GL_ARRAY_BUFFER, data.nbytes, data, GL.GL_STREAM_DRAW)
            GL.glDrawArrays(GL.GL_POINTS, 0, len(data))


class ShadowMap:
    """Depths as a sun sees them."""

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
        GL.glDisable(GL.GL_SCISSOR_TEST)
        GL.glClear(GL.GL_DEPTH_BUFFER_BIT)
        GL.glEnable(GL.GL_POLYGON_OFFSET_FILL)
        GL.glPolygonOffset(*_FILLS_ITS_MAP)
        program.use(**values)
        for surface in surfaces:
            surface.draw()
        GL.glDisable(GL.GL_POLYGON_OFFSET_FILL)


def bind(unit: int, texture: int) -> None:
    """Have a texture looked up by this number."""
    GL.glActiveTexture(int(GL.GL_TEXTURE0) + unit)
    GL.glBindTexture(GL.GL_TEXTURE_2D, texture)


def _attach(place: int, texture: int) -> None:
    GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, place, GL.GL_TEXTURE_2D, texture, 0)


def _texture(kind: int, form: int, width: int, height: int) -> int:
    """A texture that is looked up between its pixels, and at its edge beyond it."""
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
