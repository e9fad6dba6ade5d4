"""From plain Python functions, marked by ``pipes.compiled``, to C functions, kept on disk."""

from __future__ import annotations

import hashlib
import types
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from omnitrack_sim.pipes.compiled import ENTRIES, MARKED, STANDS_FOR

_Function = Callable[..., Any]


def compile_entry(function: _Function) -> Any:
    """The numba ``CFunc`` of a function marked as an entry; its address is that of the code.

    The functions are compiled as copies, whose globals have the compiled ones in the place of the
    plain ones: modules stay as they are. Helpers are not kept on disk one by one; an entry is, with
    all that it calls.
    """
    from numba import cfunc
    from numba.core.caching import FunctionCache

    from omnitrack_sim.walls.collider.native import SIGNATURES

    copy, signature = _linked(function), SIGNATURES[ENTRIES[function]]
    # numba knows only the file of the entry itself and would load stale code where a helper or a
    # constant elsewhere has changed. The name is part of the key that the code is kept by.
    copy.__qualname__ = f"{function.__qualname__}_{_digest(function)}"
    try:
        return cfunc(signature, cache=True, error_model="numpy")(copy)
    except Exception:  # no folder to keep it in, no file (a prompt), damage, or a fault of its own
        with suppress(Exception):
            FunctionCache(copy).flush()
            return cfunc(signature, cache=True, error_model="numpy")(copy)
        return cfunc(signature, error_model="numpy")(copy)


def _linked(entry: _Function) -> Any:
    """A copy of an entry that calls compiled copies of what it calls."""
    from numba import njit

    from omnitrack_sim.walls.collider import native

    calls = _reached(entry)
    copies = {f: _copy(f) for f in calls}
    compiled = {id(f): njit(error_model="numpy")(c) for f, c in copies.items() if f is not entry}
    compiled |= {id(f): getattr(native, name) for f, name in STANDS_FOR.items()}
    for function, copy in copies.items():
        for name in function.__code__.co_names:
            place = id(function.__globals__.get(name))
            if place in compiled:
                copy.__globals__[name] = compiled[place]
    return copies[entry]


def _copy(function: _Function) -> Any:
    copy = types.FunctionType(
        function.__code__, dict(function.__globals__), function.__name__, function.__defaults__
    )
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    return copy


def _reached(entry: _Function) -> list[_Function]:
    """An entry and all marked functions that it calls, directly or not."""
    ours = {id(f): f for f in MARKED}
    found, todo = [], [entry]
    while todo:
        function = todo.pop()
        if function not in found:
            found.append(function)
            names = function.__code__.co_names
            called = (ours.get(id(function.__globals__.get(name))) for name in names)
            todo += [f for f in called if f is not None]
    return found


def _digest(entry: _Function) -> str:
    """Of the code of an entry, of all that it calls, and of the constants that these use."""
    parts = [_pointer_code()]
    for function in _reached(entry):
        code = function.__code__
        parts += [code.co_code, repr(code.co_consts[1:]).encode()]
        for name in code.co_names:
            value = function.__globals__.get(name)
            if isinstance(value, int | float):
                parts.append(f"{name}={value!r}".encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


@cache
def _pointer_code() -> bytes:
    """The text of what stands for ``through`` in compiled code."""
    names = ("native.py", "through.py")
    return b"".join(Path(__file__).with_name(name).read_bytes() for name in names)
