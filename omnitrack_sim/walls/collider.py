"""Exact contact of whole tracks with fittings of any kind, compiled into MuJoCo's collision table.

A track is one capsule, a fitting one height field; their user data say what they are (``track``).
Of all pairs of geoms MuJoCo gives those with a height field the most room for contacts (50). Pairs
without records are handed to the function that was there before. The compiled function holds no
interpreter lock, so batches scale over threads.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco
import numpy as np
from llvmlite import binding, ir
from numba import types
from numpy.typing import NDArray

from omnitrack_sim.pipes.native import NUMBER, NUMBERS, WORD, WORDS, c_function, calling, intrinsic
from omnitrack_sim.walls.track import MARK, RECORD_SIZE, line_contacts

# The height field comes first: the table is filled for pairs of ascending geom types only.
_FIELD, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_KINDS = int(mujoco.mjtGeom.mjNGEOMTYPES)
_COLLIDE = types.int32(WORDS, WORDS, NUMBERS, types.int32, types.int32, NUMBER)
"""C types of MuJoCo's collision functions (mjfCollision): model, data, room for contacts, the two
geoms, margin."""
BLOCK = "omnitrack_collider_block"
"""Symbol of the words that change from process to process and from one MuJoCo to the next. Compiled
code reads them when it runs, so it can be kept on disk."""
ORIGINAL, TOKEN, SIZE, USER, USER_SIZE, POSITIONS, MATRICES, BLOCK_SIZE = range(8)
"""Indices in the block, and its size: address of MuJoCo's own function; mark of this process's
records; words of MuJoCo's structures that hold sizes of geoms, their user data and its length,
their positions and orientations."""
_CHUNK, _MOST_CHUNKS = 256, 240
"""Words that are searched at a time, so as to read little past a structure's end; and how often,
before the search gives up. The fields come long before that."""
_WORD = ctypes.sizeof(ctypes.c_size_t)


@intrinsic
def word(context, index):
    """Read a word of the block."""

    def code(context, builder, signature, arguments):
        module, kind = builder.module, ir.IntType(64)
        block = module.globals.get(BLOCK)
        if block is None:  # without an initialiser it is an external symbol
            block = ir.GlobalVariable(module, ir.ArrayType(kind, BLOCK_SIZE), BLOCK)
        return builder.load(builder.gep(block, [kind(0), arguments[0]], inbounds=True))

    return WORD(WORD), code


@intrinsic
def doubles(context, address):
    """Pointer to the numbers at an address."""

    def code(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return NUMBERS(WORD), code


@intrinsic
def call_collide(context, address, model, data, contacts, wall, line, margin):
    """Call the collision function at an address."""
    return calling(_COLLIDE)


def collide(model, data, contacts, wall, line, margin):
    """MuJoCo's collision function of height field and capsule."""
    # A foreign model may have user data of another length, which must not be read as a record.
    if model[word(USER_SIZE)] != RECORD_SIZE:
        return call_collide(word(ORIGINAL), model, data, contacts, wall, line, margin)
    records = doubles(model[word(USER)])
    track, w = RECORD_SIZE * line, RECORD_SIZE * wall
    # A record of another process holds addresses that mean nothing here.
    mark = float(word(TOKEN))
    if records[w] != mark or records[track] != mark:
        return call_collide(word(ORIGINAL), model, data, contacts, wall, line, margin)
    # MuJoCo has three sizes a geom; of a capsule they are its radius and half length.
    sizes = doubles(model[word(SIZE)])
    radius, half = sizes[3 * line], sizes[3 * line + 1]
    position, matrix = doubles(data[word(POSITIONS)]), doubles(data[word(MATRICES)])
    return line_contacts(
        contacts, records, w, track, position, matrix, line, wall, radius, half, margin
    )


@cache
def install() -> Any:
    """Enter the collider in MuJoCo's table, once a process; returns its block, to be kept.

    Raises:
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    table = (ctypes.c_void_p * (_KINDS * _KINDS)).in_dll(_library(), "mjCOLLISIONFUNC")
    pair = _FIELD * _KINDS + _CAPSULE
    if not table[pair]:
        raise RuntimeError("MuJoCo's collision table has no function for height field and capsule")
    block = (ctypes.c_int64 * BLOCK_SIZE)()
    block[ORIGINAL], block[TOKEN] = table[pair], int(MARK)
    block[SIZE], block[USER], block[USER_SIZE], block[POSITIONS], block[MATRICES] = _fields()
    # Before any code that refers to it is loaded.
    binding.add_symbol(BLOCK, ctypes.addressof(block))
    table[pair] = c_function(collide, _COLLIDE).address
    return block


def _fields() -> tuple[int, ...]:
    """Return the words of MuJoCo's mjModel and mjData that hold what the collider reads, in the
    order of the block.

    Found by their values in two models, so that the layout of the installed version is used and not
    one assumed.

    Raises:
        RuntimeError: the fields are not found.
    """
    # Of the words that hold the length in one model, only the true field also does in the other.
    first, second = _fields_of_model(101), _fields_of_model(157)
    lengths = np.intersect1d(first[0], second[0])
    if first[1:] != second[1:] or len(lengths) != 1:
        raise RuntimeError("the fields of MuJoCo's structures are not where they are expected")
    size, user, positions, matrices = first[1:]
    return size, user, int(lengths[0]), positions, matrices


def _fields_of_model(user_size: int) -> tuple[Any, ...]:
    """Return the words (k,) that may be the length of the user data in a model of that length, and
    those of sizes, user data, positions and orientations."""
    # A part of every kind: an empty field would have the same address as its neighbour.
    spec = mujoco.MjSpec()
    spec.nuser_geom = user_size
    for _ in range(user_size % 10):
        body = spec.worldbody.add_body()
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 1])
        body.add_site()
        body.add_camera()
        body.add_light()
    model = spec.compile()
    data = mujoco.MjData(model)
    size = _word_of(model._address, model.geom_size)
    return (
        # The counts come before the pointers in mjModel.
        np.flatnonzero(_words(model._address, size) == user_size),
        size,
        _word_of(model._address, model.geom_user),
        _word_of(data._address, data.geom_xpos),
        _word_of(data._address, data.geom_xmat),
    )


def _word_of(structure: int, array: NDArray[Any]) -> int:
    """Return which word of the structure at an address points to ``array``."""
    # NumPy's views of a model share its memory, so the address is that in the structure's pointer.
    wanted = array.ctypes.data
    for chunk in range(_MOST_CHUNKS):
        hits = np.flatnonzero(_words(structure + chunk * _CHUNK * _WORD, _CHUNK) == wanted)
        if len(hits):
            return chunk * _CHUNK + int(hits[0])
    raise RuntimeError("a field of MuJoCo's structures was not found")


def _words(address: int, count: int) -> NDArray[np.uintp]:
    """Return the words (count,) of memory from an address on."""
    return np.ctypeslib.as_array((ctypes.c_size_t * count).from_address(address))


def _library() -> ctypes.CDLL:
    """Return the libmujoco of this process."""
    # The library has to be the very one that Python's module uses, wherever it was installed.
    with open("/proc/self/maps", encoding="utf-8") as maps:
        paths = {line.split(maxsplit=5)[-1].strip() for line in maps if "libmujoco" in line}
    if len(paths) != 1:
        raise RuntimeError(f"{len(paths)} libraries of MuJoCo are loaded")
    return ctypes.CDLL(paths.pop())
