"""Model files of somebody else, MJCF, URDF and their archives: bounded before MuJoCo reads them.

A few lines of MJCF may ask for any memory (``<replicate count="1000000">``, a height field of
100,000 by 100,000), and name any file of the machine.
"""

from __future__ import annotations

import math
import re
import struct
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from omnitrack_sim.base.bounds import (
    MAX_MODEL_CELLS,
    MAX_MODEL_COUNT,
    MAX_MODEL_ELEMENTS,
    MAX_MODEL_FILES,
    MAX_MODEL_LEVELS,
    MAX_MODEL_MEMORY,
    MAX_MODEL_TEXT,
    MAX_PICTURE_CELLS,
)
from omnitrack_sim.base.reading import read_bytes, size_of

if TYPE_CHECKING:
    import mujoco

ARCHIVES = (".mjz", ".zip")
MODELS = ("include", "model")
"""Elements that name a further file of elements."""
GRIDS = ("flexcomp", "composite")
"""Elements that make a body or vertex of each cell."""
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_AROUND = b" \t\r\n\0"
"""Bytes that MuJoCo passes over before and behind the text of a file."""
_UNITS = {unit: 1024**power for power, unit in enumerate("KMGTPE", start=1)}
_CELLS: Mapping[str, tuple[str, ...]] = {
    "hfield": ("nrow", "ncol"),
    "texture": ("width", "height"),
    "flexcomp": ("count",),
    "composite": ("count",),
    "mesh": ("params",),
    "camera": ("resolution",),
    "global": ("offwidth", "offheight"),
    "quality": ("shadowsize",),
}
"""Attributes whose numbers, multiplied, are what an element asks for."""
_COUNTS = ("count", "dim", "num", "nsample", "cellcount", "nstack", "nconmax", "njmax")


def read_spec(path: Path) -> mujoco.MjSpec:
    """Read a model file, whose demands are checked first.

    Raises:
        OSError: it, or a file that it names, cannot be read.
        ValueError: it is no regular file, asks for too much, or MuJoCo cannot read it.
    """
    import mujoco

    from omnitrack_sim.walls.geoms import leave_no_log

    check_model(path)
    leave_no_log()
    return mujoco.MjSpec.from_file(str(path))


def check_model(path: Path) -> None:
    """Refuse a model file that asks for more than the bounds, or names what is no regular file.

    Raises:
        OSError, ValueError: see ``read_spec``.
    """
    if path.suffix.lower() not in ARCHIVES:
        _Demands(_Folder(path.parent)).add(path.name)
        return
    size = size_of(path, MAX_MODEL_FILES)
    with _unpacking(), zipfile.ZipFile(path) as archive:
        entries = {entry.filename: entry for entry in archive.infolist()}
        if size + sum(entry.file_size for entry in entries.values()) > MAX_MODEL_FILES:
            raise ValueError(f"unpacks to more than {MAX_MODEL_FILES} bytes")
        texts = [name for name in entries if name.lower().endswith((".xml", ".mjcf", ".urdf"))]
        demands = _Demands(_Archive(archive))
        for name in texts:
            demands.add(name)


@contextmanager
def _unpacking() -> Iterator[None]:
    """Turn errors of a damaged archive into a ``ValueError``."""
    try:
        yield
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise ValueError(f"is no archive of a model, or damaged: {error}") from error


class _Folder:
    """Files in a folder and around it."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, name: str) -> bytes:
        """Return the text of a file."""
        return read_bytes(self._folder / name, MAX_MODEL_TEXT)

    def size(self, names: list[str]) -> int:
        """Return the size of the first of these files that is there; 0 where none is."""
        for name in names:
            file = self._folder / name
            if file.exists():
                size = size_of(file, MAX_MODEL_FILES)
                with file.open("rb") as opened:
                    _check_picture(opened.read(_PNG.size), name)
                return size
        return 0  # said by MuJoCo


class _Archive:
    """Files in an archive, which names none outside of it."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def read(self, name: str) -> bytes:
        """Return the text of a file."""
        if self._archive.getinfo(name).file_size > MAX_MODEL_TEXT:
            raise ValueError(f"{name} is too large: at most {MAX_MODEL_TEXT} bytes are read")
        return self._archive.read(name)

    def size(self, names: list[str]) -> int:
        """Return 0, as all has been counted; a file must be in the archive."""
        there = set(self._archive.namelist())
        found = next((name for name in names if name in there), None)
        # MuJoCo looks elsewhere for what is named from elsewhere, even if it is here, too.
        if found is None or any(map(_is_outside, names)):
            raise ValueError(f"names {names[-1]!r}, which is not in it")
        with self._archive.open(found) as opened:
            _check_picture(opened.read(_PNG.size), found)
        return 0


def _is_outside(name: str) -> bool:
    """Return whether a path may lead out of the folder that it begins in, on any system."""
    path = PureWindowsPath(name)  # which takes both kinds of slashes
    return bool(path.anchor) or ".." in path.parts


_PNG = struct.Struct(">8s4s4sII")
"""Beginning of a PNG: its mark, length and name of the first part, width and height."""


def _check_picture(head: bytes, name: str) -> None:
    """Raise a ``ValueError`` for a PNG that unpacks to too much."""
    if len(head) == _PNG.size and head.startswith(b"\x89PNG"):
        *_, width, height = _PNG.unpack(head)
        _refuse(width * height, MAX_PICTURE_CELLS, f"pixels of {name}")


class _Demands:
    """What the elements of a model and of the files that it includes ask for, added up."""

    def __init__(self, files: _Folder | _Archive) -> None:
        self._files, self._read = files, set[str]()
        self._elements = self._cells = self._size = self._memory = 0.0
        self._folders = {""}

    def add(self, name: str, times: float = 1.0, level: int = 0) -> None:
        """Add the elements of a file, each ``times``, at a level of nesting.

        Raises:
            ValueError: beyond a bound.
        """
        if name in self._read:
            return
        self._read.add(name)
        text = _COMMENT.sub(b"", self._files.read(name)).strip(_AROUND)
        if b"<!ENTITY" in text:
            raise ValueError("has entities of its own, which are not read")
        stack = [times]
        parser = expat.ParserCreate()

        def begin(tag: str, attributes: dict[str, str]) -> None:
            own = stack[-1] * (_number(attributes.get("count", "1")) if tag == "replicate" else 1)
            stack.append(max(1.0, own))
            self._element(tag, attributes, stack[-1], level + len(stack))

        parser.StartElementHandler = begin
        parser.EndElementHandler = lambda _: stack.pop()
        try:
            parser.Parse(text, True)
        except expat.ExpatError as error:
            raise ValueError(f"is no XML: {error}") from error

    def _element(self, tag: str, attributes: dict[str, str], times: float, level: int) -> None:
        self._elements += times
        _refuse(level, MAX_MODEL_LEVELS, "levels of elements in each other")
        if cells := [attributes[key] for key in _CELLS.get(tag, ()) if key in attributes]:
            numbers = [abs(_number(word)) for text in cells for word in text.split()]
            asked = times * math.prod(max(1.0, number) for number in numbers)
            if tag in GRIDS:
                self._elements += asked
            else:
                self._cells += asked
        _refuse(self._elements, MAX_MODEL_ELEMENTS, "elements, with all copies")
        _refuse(self._cells, MAX_MODEL_CELLS, "cells of fields, pictures and meshes")
        if tag == "compiler":
            keys = ("meshdir", "texturedir", "assetdir")
            self._folders |= {attributes[key] for key in keys if key in attributes}
        for key, text in attributes.items():
            self._attribute(tag, key, text, times, level)

    def _attribute(self, tag: str, key: str, text: str, times: float, level: int) -> None:
        if key in _COUNTS or (tag == "size" and key.startswith("n")):
            for word in text.split():
                _refuse(times * abs(_number(word)), MAX_MODEL_COUNT, f"in {tag} {key}")
        if key == "memory" and tag == "size":
            unit = _UNITS.get(text[-1:].upper())
            size = _number(text[:-1]) * unit if unit else _number(text)
            _refuse(size, MAX_MODEL_MEMORY, "bytes of memory")
        if key.startswith("file") and text:
            names = [str(PurePosixPath(folder) / text) for folder in sorted(self._folders)]
            self._size += self._files.size([*names, text])
            _refuse(self._size, MAX_MODEL_FILES, "bytes of files")
            if tag in MODELS and self._names_elements(text):
                self.add(text, times, level)

    def _names_elements(self, name: str) -> bool:
        """Return whether a further file has elements and is there; MuJoCo says so where not."""
        try:
            self._files.read(name)
        except (FileNotFoundError, KeyError):
            return False
        return not name.lower().endswith((".mjb", ".txt", *ARCHIVES))


def _number(text: str) -> float:
    """Return a number of an attribute; 0 where it is none, which MuJoCo says."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def _refuse(value: float, most: float, what: Any) -> None:
    """Raise a ``ValueError`` for a value beyond a bound, not a number included."""
    if not value <= most:
        raise ValueError(f"asks for {value:.6g} {what}; at most {most:.6g}")


def check_binary(model: bytes) -> None:
    """Refuse a model in MuJoCo's binary form whose sizes are not those of its bytes.

    MuJoCo takes memory by the sizes at its beginning, and looks only then for what they are of.

    Raises:
        ValueError: a size is out of bounds.
    """
    from mujoco.introspect import structs

    # The sizes come first.
    fields = takewhile(lambda field: field.name.startswith("n"), structs.STRUCTS["mjModel"].fields)
    names = [field.name for field in fields]
    head = struct.Struct(f"<{_HEAD}i")
    if len(model) < head.size:
        raise ValueError("is no model of MuJoCo's")
    count = head.unpack_from(model)[2]
    if count != len(names) or len(model) < head.size + 8 * count:
        raise ValueError("is no model of this release of MuJoCo")
    sizes = struct.unpack_from(f"<{count}q", model, head.size)
    limits = {"narena": MAX_MODEL_MEMORY, "nbuffer": 2 * len(model) + MAX_MODEL_COUNT}
    for name, size in zip(names, sizes, strict=True):
        most = MAX_MODEL_COUNT if name in _MADE else len(model)
        if not -1 <= size <= limits.get(name, most):
            raise ValueError(f"has {size} as its {name}")


_HEAD = 5
"""Integers before the sizes: mark, bytes of a number, count of sizes, release, count of arrays."""
_MADE = ("nuserdata", "njmax", "nconmax", "nemax")
"""Sizes of what is no part of the file, but made with the data."""
