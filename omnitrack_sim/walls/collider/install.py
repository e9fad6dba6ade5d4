"""Puts the compiled collider into MuJoCo's collision table, at the pair height field and capsule.

Of all pairs MuJoCo gives those with a height field the most room for contacts (50). Height fields
without a record are handed to the function that was there before. The compiled function holds no
interpreter lock, so batches scale over threads.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco

from omnitrack_sim.base.errors import Fault, GeometryError
from omnitrack_sim.pipes import Fitting
from omnitrack_sim.walls.collider import line
from omnitrack_sim.walls.collider.places import places
from omnitrack_sim.walls.collider.record import WALLS

_FIELD, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_KINDS = int(mujoco.mjtGeom.mjNGEOMTYPES)
_kept: list[Any] = []
"""Blocks and compiled functions, for good: tables and loaded code hold their addresses."""


@cache
def install() -> Any:
    """Enter the collider in MuJoCo's table, once a process; returns the block that ``native``
    describes. Code that is not on disk yet is compiled, which takes seconds.

    Raises:
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    from llvmlite import binding

    from omnitrack_sim.walls.collider import native
    from omnitrack_sim.walls.collider.compile import compile_entry

    table = (ctypes.c_void_p * (_KINDS * _KINDS)).in_dll(_library(), "mjCOLLISIONFUNC")
    place = _FIELD * _KINDS + _CAPSULE
    if not table[place]:
        raise RuntimeError("MuJoCo's collision table has no function for height field and capsule")
    block = (ctypes.c_int64 * native.WORDS)()
    _kept.append(block)
    block[native.ORIGINAL] = table[place]
    for name, index in places().items():
        block[getattr(line, name)] = index
    # Before any code that refers to it is loaded.
    binding.add_symbol(native.BLOCK, ctypes.addressof(block))
    function = compile_entry(line.collide)
    _kept.append(function)
    table[place] = function.address
    return block


def bring(fitting: type[Fitting]) -> None:
    """Have the installed collider know all kinds that records have numbers for.

    Args:
        fitting: the kind that was added last, for the message.

    Raises:
        GeometryError: the functions of its ``wall`` do not compile.
    """
    from omnitrack_sim.walls.collider import native
    from omnitrack_sim.walls.collider.compile import compile_entry

    block = install()
    for number in range(block[line.COUNT], len(WALLS)):
        if number >= native.MOST_KINDS:
            raise GeometryError(Fault(fitting.file_kind(), "is one kind of fitting too many"))
        wall = WALLS[number]
        for offset, function in enumerate((wall.surface, wall.span, wall.clear)):
            try:
                entry = compile_entry(function)
            except Exception as error:
                problem = f"{function.__name__} of its wall does not compile: {error}"
                raise GeometryError(Fault(fitting.file_kind(), problem)) from error
            _kept.append(entry)
            block[native.FIRST + native.PER_KIND * number + offset] = entry.address
        block[line.COUNT] = number + 1


def _library() -> ctypes.CDLL:
    """The libmujoco of this process."""
    with open("/proc/self/maps", encoding="utf-8") as maps:
        paths = {line.split(maxsplit=5)[-1].strip() for line in maps if "libmujoco" in line}
    if len(paths) != 1:
        raise RuntimeError(f"{len(paths)} libraries of MuJoCo are loaded")
    return ctypes.CDLL(paths.pop())
