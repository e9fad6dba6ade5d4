"""C functions of compiled Python: kept on disk, called by their address.

MuJoCo, and compiled code that meets fittings of any kind, call functions through pointers. Nothing
that changes from process to process stands in such a function, so that its code is kept on disk
and serves every process: the first one compiles it, which takes some tenths of a second to
seconds, later ones load it.
"""

from __future__ import annotations

import ctypes
import hashlib
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import cfunc, types
from numba.core import cgutils, extending
from numba.core.caching import FunctionCache
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher

from omnitrack_sim.base.rotations import Array

intrinsic: Any = extending.intrinsic
"""Decorator of functions whose code is made here, of instructions; their first parameter is
numba's."""
NUMBER, WORD = types.float64, types.int64
NUMBERS, WORDS = types.CPointer(NUMBER), types.CPointer(WORD)
SIGNATURES = {
    "surface": NUMBER(NUMBERS, *[NUMBER] * 3, NUMBERS),
    "span": NUMBER(NUMBERS, NUMBERS, *[NUMBER] * 6, NUMBERS),
    "clear": NUMBER(NUMBERS, *[NUMBER] * 6),
}
"""C types of the functions of ``compiled.Wall``."""
SCRATCH = 16
"""Numbers that ``scratch`` has room for."""


@cache
def announce() -> None:
    """Tell on standard error, once a process, that walls are being compiled."""
    print(
        "omnitrack_sim: compiling exact walls, once; takes some 10 s", file=sys.stderr, flush=True
    )


class _Announced(Compiler):
    """A compiler that tells when it sets to work, as it does not where code is loaded from disk."""

    def define_pipelines(self) -> Any:
        """See numba's ``CompilerBase``."""
        announce()
        return super().define_pipelines()


@cache
def c_function(function: Callable[..., Any], signature: Any, is_long: bool = False) -> Any:
    """Compile a function, or load its code from disk; returns the numba ``CFunc``, kept for good.

    Args:
        function: plain, or already marked by ``compiled``; it may call marked ones.
        signature: C types of its arguments and of what it returns.
        is_long: whether its compilation takes seconds and is announced.
    """
    options: dict[str, Any] = {"error_model": "numpy"}
    if is_long:
        options["pipeline_class"] = _Announced
    # A copy, since its module and name are changed below for numba's key of the code on disk.
    python = getattr(function, "py_func", function)
    copy = FunctionType(
        python.__code__, python.__globals__, python.__name__, None, python.__closure__
    )
    copy.__module__ = python.__module__
    # numba looks for changes in the file of the function alone, and would load stale code where a
    # helper or a constant elsewhere has changed. The name is part of the key of the code on disk.
    copy.__qualname__ = f"{python.__qualname__}_{_digest(python)}"
    try:
        return cfunc(signature, cache=True, **options)(copy)
    except Exception:  # no folder to keep it in, no file (a prompt), damage, or a fault of its own
        with suppress(Exception):
            FunctionCache(copy).flush()
            return cfunc(signature, cache=True, **options)(copy)
        return cfunc(signature, **options)(copy)


def _digest(function: Any) -> str:
    """Digest of the code of a function, of all compiled functions that it calls, of the constants
    that these use, and of this file, whose intrinsics they call."""
    reached, pending = [], [function]
    while pending:
        python = pending.pop()
        if python not in reached:
            reached.append(python)
            called = (python.__globals__.get(name) for name in python.__code__.co_names)
            pending += [value.py_func for value in called if isinstance(value, Dispatcher)]
    parts = [Path(__file__).read_bytes()]
    for python in reached:
        code = python.__code__
        # The first constant is the docstring, which does not change the code.
        parts += [code.co_code, repr(code.co_consts[1:]).encode()]
        values = {name: python.__globals__.get(name) for name in code.co_names}
        numbers = {name: v for name, v in values.items() if isinstance(v, int | float)}
        parts.append(repr(numbers).encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def pointers(*arrays: Array) -> list[Any]:
    """C pointers to the numbers of contiguous arrays of doubles."""
    return [array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for array in arrays]


def calling(signature: Any) -> tuple[Any, Any]:
    """Signature and code of an intrinsic that calls the C function at an address, its first
    argument, with the other ones."""

    def code(context, builder, own_signature, arguments):
        kinds = [context.get_value_type(kind) for kind in signature.args]
        function = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
        return builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])

    return signature.return_type(WORD, *signature.args), code


@intrinsic
def call_surface(context, address, sizes, x, y, z, out):
    """Call the ``surface`` at an address; see ``compiled.Wall``."""
    return calling(SIGNATURES["surface"])


@intrinsic
def call_span(context, address, sizes, ends, px, py, pz, ax, ay, az, out):
    """Call the ``span`` at an address; see ``compiled.Wall``."""
    return calling(SIGNATURES["span"])


@intrinsic
def call_clear(context, address, sizes, px, py, pz, ax, ay, az):
    """Call the ``clear`` at an address; see ``compiled.Wall``."""
    return calling(SIGNATURES["clear"])


@intrinsic
def at(context, array, index):
    """Pointer to ``array`` from ``index`` on."""

    def code(context, builder, signature, arguments):
        return builder.gep(arguments[0], [arguments[1]])

    return NUMBERS(NUMBERS, WORD), code


@intrinsic
def scratch(context):
    """Room for SCRATCH numbers, on the stack of the calling function."""

    def code(context, builder, signature, arguments):
        room = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), SCRATCH))
        return builder.bitcast(room, context.get_value_type(signature.return_type))

    return NUMBERS(), code
