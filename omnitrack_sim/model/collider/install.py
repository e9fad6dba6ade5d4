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
import numpy as np

from omnitrack_sim.model.collider.record import MARK, RECORD_SIZE

_FIELD, _CAPSULE = int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_KINDS = int(mujoco.mjtGeom.mjNGEOMTYPES)
_WORD = ctypes.sizeof(ctypes.c_void_p)
_MOST_WORDS = 60_000
"""Where the search for a field of MuJoCo's structures gives up; the fields are found long
before."""


@cache
def why_not() -> str | None:
    """Why the exact collider cannot be used here, in a sentence; None where it can, and then it is
    installed."""
    try:
        install()
    except ImportError:
        return "numba is missing; pip install 'omnitrack_sim[fast]' brings it"
    except (
        Exception
    ) as error:  # whatever keeps compiled code from loading here: walls of primitives always work
        return f"it does not load here ({type(error).__name__}: {error})"
    return None


@cache
def install() -> None:
    """Compile the collider and enter it in MuJoCo's table; once a process. Takes a few seconds the
    first time.

    Raises:
        ImportError: numba is missing.
        RuntimeError: MuJoCo's structures are not laid out as expected.
    """
    table = (ctypes.c_void_p * (_KINDS * _KINDS)).in_dll(_library(), "mjCOLLISIONFUNC")
    place = _FIELD * _KINDS + _CAPSULE
    if not table[place]:
        raise RuntimeError("MuJoCo's collision table has no function for height field and capsule")
    function = _compile(table[place], _places())
    install.keep = function  # type: ignore[attr-defined]  # the table holds its address for good
    table[place] = function.address


def _library() -> ctypes.CDLL:
    """The libmujoco of this process."""
    with open("/proc/self/maps", encoding="utf-8") as maps:
        paths = {line.split(maxsplit=5)[-1].strip() for line in maps if "libmujoco" in line}
    if len(paths) != 1:
        raise RuntimeError(f"{len(paths)} libraries of MuJoCo are loaded")
    return ctypes.CDLL(paths.pop())


def _places() -> dict[str, int]:
    """Which words of MuJoCo's mjModel and mjData hold what the collider reads.

    Found by their values in two models, so that the layout of the installed version is used and not
    one assumed.
    """
    first, second = _places_in(101), _places_in(157)
    sizes = first.pop("user_size") & second.pop("user_size")
    if first != second or len(sizes) != 1:
        raise RuntimeError("the fields of MuJoCo's structures are not where they are expected")
    return {name: place.pop() for name, place in first.items()} | {"user_size": sizes.pop()}


def _places_in(user_size: int) -> dict[str, set[int]]:
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
    places = {
        "size": {_place_of(model._address, model.geom_size)},
        "user": {_place_of(model._address, model.geom_user)},
        "position": {_place_of(data._address, data.geom_xpos)},
        "matrix": {_place_of(data._address, data.geom_xmat)},
    }
    # The counts come before the pointers in mjModel.
    before = range(min(places["size"]))
    return places | {"user_size": {i for i in before if _word(model._address, i) == user_size}}


def _place_of(structure: int, array: np.ndarray) -> int:
    """Which word of the structure at an address points to ``array``."""
    for index in range(_MOST_WORDS):
        if _word(structure, index) == array.ctypes.data:
            return index
    raise RuntimeError("a field of MuJoCo's structures was not found")


def _word(structure: int, index: int) -> int:
    return ctypes.c_size_t.from_address(structure + index * _WORD).value


def _compile(original: int, places: dict[str, int]) -> Any:
    """The C function (numba's ``CFunc``) for one pair of geoms; ``original`` is the address of
    MuJoCo's own."""
    from numba import cfunc, types
    from numba.core.extending import intrinsic

    from omnitrack_sim.model.collider.line import line_contacts

    pointer, doubles = types.voidptr, types.CPointer(types.float64)

    def cast_to(kind: Any) -> Any:
        @intrinsic
        def cast(context, address):
            def code(context, builder, signature, arguments):
                return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

            return kind(pointer), code

        return cast

    doubles_at, pointers_at, words_at = map(
        cast_to, (doubles, types.CPointer(doubles), types.CPointer(types.int64))
    )
    signature = types.int32(pointer, pointer, pointer, types.int32, types.int32, types.float64)
    arguments = (
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_int,
        ctypes.c_int,
        ctypes.c_double,
    )
    others = ctypes.CFUNCTYPE(ctypes.c_int, *arguments)(original)
    size, user, user_size = places["size"], places["user"], places["user_size"]
    position_of, matrix_of = places["position"], places["matrix"]

    @cfunc(signature, error_model="numpy")
    def collide(model, data, contacts, wall, line, margin):
        of_model, of_data = pointers_at(model), pointers_at(data)
        records = of_model[user]
        if words_at(model)[user_size] != RECORD_SIZE or records[RECORD_SIZE * wall] != MARK:
            return others(model, data, contacts, wall, line, margin)
        track = RECORD_SIZE * line
        if records[track] != MARK:
            return others(model, data, contacts, wall, line, margin)
        radius, half = of_model[size][3 * line], of_model[size][3 * line + 1]
        pitch, robot_scale = records[track + 1], records[track + 2]
        con, position, matrix = doubles_at(contacts), of_data[position_of], of_data[matrix_of]
        return line_contacts(
            con,
            records,
            RECORD_SIZE * wall,
            position,
            matrix,
            line,
            wall,
            radius,
            half,
            pitch,
            margin,
            robot_scale,
        )

    return collide
