"""Where compiled code finds MuJoCo: fields of its C structures, and its library."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from math import prod
from pathlib import Path
from typing import Any

import mujoco

_SCALARS: dict[str, Any] = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtByte": ctypes.c_ubyte,
    "mjtBool": ctypes.c_bool,
}
_WORD = ctypes.sizeof(ctypes.c_size_t)


def words_of(structure: str, names: Sequence[str]) -> list[int]:
    """Return at which words of a structure, ``mjModel`` or ``mjData``, its fields lie.

    Raises:
        RuntimeError: the structures are not laid out as MuJoCo's own declarations say.
    """
    _check()
    return [_word_of(structure, name) for name in names]


def _word_of(structure: str, name: str) -> int:
    word, rest = divmod(getattr(_structure(structure), name).offset, _WORD)
    if rest:
        raise RuntimeError(f"{name} of MuJoCo's {structure} is no word")
    return word


@cache
def _structure(name: str) -> type[ctypes.Structure]:
    """Return a structure of MuJoCo's by the declarations in its package."""
    from mujoco.introspect.structs import STRUCTS  # half a megabyte of Python

    return _declared(name, STRUCTS[name])


def _declared(name: str, declaration: Any) -> type[ctypes.Structure]:
    fields = [(field.name, _type_of(field.type)) for field in declaration.fields]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def _type_of(kind: Any) -> Any:
    """Return the C type of a declared type; what a pointer points to does not matter."""
    from mujoco.introspect import ast_nodes

    if isinstance(kind, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(kind, ast_nodes.ArrayType):
        return _type_of(kind.inner_type) * prod(kind.extents)
    if isinstance(kind, ast_nodes.AnonymousStructDecl):
        return _declared("anonymous", kind)
    return _SCALARS.get(kind.name) or _structure(kind.name)


@cache
def _check() -> None:
    """Compare a count and a pointer of a model, and a pointer of its data, with their fields."""
    spec = mujoco.MjSpec()
    for _ in range(3):
        spec.worldbody.add_geom(size=[1, 1, 1])
    model = spec.compile()
    data = mujoco.MjData(model)
    known = (
        ("mjModel", model._address, "ngeom", model.ngeom),
        ("mjModel", model._address, "geom_size", model.geom_size.ctypes.data),
        ("mjData", data._address, "geom_xpos", data.geom_xpos.ctypes.data),
    )
    for structure, address, name, value in known:
        word = address + _WORD * _word_of(structure, name)
        if ctypes.c_size_t.from_address(word).value != value:
            raise RuntimeError(f"{name} of MuJoCo's {structure} is not where its package says")


@cache
def library() -> ctypes.CDLL:
    """Return the library of MuJoCo that Python's module has loaded: it lies beside that.

    Raises:
        RuntimeError: there is no library, or more than one.
    """
    folder = Path(mujoco.__file__).parent
    found = {path.resolve() for name in ("libmujoco*", "mujoco.dll") for path in folder.glob(name)}
    if len(found) != 1:
        raise RuntimeError(f"{folder} has {len(found)} libraries of MuJoCo")
    return ctypes.CDLL(str(found.pop()))
