"""Where MuJoCo's structures keep what the collider reads."""

from __future__ import annotations

import ctypes
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

_CHUNK, _MOST_CHUNKS = 256, 240
"""Words that are searched at a time, so as to read little past a structure's end; and how often,
before the search gives up. The fields are found long before."""
_WORD = ctypes.sizeof(ctypes.c_size_t)


def places() -> dict[str, int]:
    """Which words of MuJoCo's mjModel and mjData hold what the collider reads, by the names of
    ``line``.

    Found by their values in two models, so that the layout of the installed version is used and not
    one assumed.

    Raises:
        RuntimeError: the fields are not found.
    """
    first, second = _places_in(101), _places_in(157)
    counts = np.intersect1d(first.pop("USER_SIZE"), second.pop("USER_SIZE"))
    if first != second or len(counts) != 1:
        raise RuntimeError("the fields of MuJoCo's structures are not where they are expected")
    return first | {"USER_SIZE": int(counts[0])}


def _places_in(user_size: int) -> dict[str, Any]:
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
    found: dict[str, Any] = {
        "SIZE": _place_of(model._address, model.geom_size),
        "USER": _place_of(model._address, model.geom_user),
        "POSITIONS": _place_of(data._address, data.geom_xpos),
        "MATRICES": _place_of(data._address, data.geom_xmat),
    }
    # The counts come before the pointers in mjModel.
    before = _words(model._address, found["SIZE"])
    return found | {"USER_SIZE": np.flatnonzero(before == user_size)}


def _place_of(structure: int, array: NDArray[Any]) -> int:
    """Which word of the structure at an address points to ``array``."""
    wanted = array.ctypes.data
    for chunk in range(_MOST_CHUNKS):
        hits = np.flatnonzero(_words(structure + chunk * _CHUNK * _WORD, _CHUNK) == wanted)
        if len(hits):
            return chunk * _CHUNK + int(hits[0])
    raise RuntimeError("a field of MuJoCo's structures was not found")


def _words(address: int, count: int) -> NDArray[np.uintp]:
    """Words (count,) of memory from an address on."""
    return np.ctypeslib.as_array((ctypes.c_size_t * count).from_address(address))
