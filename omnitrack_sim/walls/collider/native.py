"""What only numba has: C signatures, and the intrinsics for ``through``.

All that changes from process to process (addresses of functions, places of MuJoCo's fields) is read
at run time from one block of words, an external symbol that the loader of compiled code binds.
Nothing of it is in the code, so compiled code is kept on disk and serves any process.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic

from omnitrack_sim.walls.collider.through import SCRATCH

BLOCK = "omnitrack_collider_block"
"""Name of the symbol."""
WORDS = 512
ORIGINAL, FIRST, PER_KIND = 0, 16, 3
"""Words: MuJoCo's own function; from FIRST on ``surface``, ``span`` and ``clear`` of each
kind."""
MOST_KINDS = (WORDS - FIRST) // PER_KIND

_double, _pointer, _word = types.float64, types.voidptr, types.int64
_doubles = types.CPointer(types.float64)
SIGNATURES = {
    "surface": types.float64(_doubles, _double, _double, _double, _doubles),
    "span": types.float64(_doubles, _doubles, *[_double] * 6, _doubles),
    "clear": types.float64(_doubles, *[_double] * 6),
    "collide": types.int32(_pointer, _pointer, _pointer, types.int32, types.int32, _double),
    "trace": types.int32(
        _doubles, _doubles, _doubles, _word, _doubles, _word, _doubles, _double, _doubles, _doubles
    ),
    "nearest": types.int32(_doubles, _doubles, _doubles, _word, _word, _doubles, _doubles),
}
_I64 = ir.IntType(64)


def _load(builder: Any, index: Any) -> Any:
    """A word of the block."""
    module = builder.module
    block = module.globals.get(BLOCK)
    if block is None:  # without an initialiser it is an external symbol
        block = ir.GlobalVariable(module, ir.ArrayType(_I64, WORDS), BLOCK)
    return builder.load(builder.gep(block, [_I64(0), index], inbounds=True))


def _call(context: Any, builder: Any, index: Any, signature: Any, arguments: Any) -> Any:
    """Call the C function whose address is a word of the block."""
    kinds = [context.get_value_type(t) for t in signature.args]
    kind = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
    return builder.call(builder.inttoptr(_load(builder, index), kind.as_pointer()), arguments)


@intrinsic
def word(context, index):
    """See ``through``."""

    def code(context, builder, signature, arguments):
        return _load(builder, arguments[0])

    return _word(_word), code


@intrinsic
def scratch(context):
    """See ``through``."""

    def code(context, builder, signature, arguments):
        room = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), SCRATCH))
        return builder.bitcast(room, context.get_value_type(signature.return_type))

    return _doubles(), code


@intrinsic
def at(context, array, index):
    """See ``through``."""

    def code(context, builder, signature, arguments):
        return builder.gep(arguments[0], [arguments[1]])

    return _doubles(_doubles, _word), code


@intrinsic
def as_doubles(context, pointer):
    """See ``through``."""

    def code(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

    return _doubles(_pointer), code


@intrinsic
def number_at(context, structure, index):
    """See ``through``."""

    def code(context, builder, signature, arguments):
        words = builder.bitcast(arguments[0], _I64.as_pointer())
        return builder.load(builder.gep(words, [arguments[1]]))

    return _word(_pointer, _word), code


@intrinsic
def doubles_of(context, structure, index):
    """See ``through``."""

    def code(context, builder, signature, arguments):
        kind = context.get_value_type(signature.return_type)
        words = builder.bitcast(arguments[0], kind.as_pointer())
        return builder.load(builder.gep(words, [arguments[1]]))

    return _doubles(_pointer, _word), code


def _of_kind(name: str, number: int) -> tuple[Any, Any]:
    """Signature and code of a call of one of a kind's functions, the kind being the first
    argument."""
    signature = SIGNATURES[name]

    def code(context, builder, own_signature, arguments):
        index = builder.add(builder.mul(arguments[0], _I64(PER_KIND)), _I64(FIRST + number))
        return _call(context, builder, index, signature, arguments[1:])

    return signature.return_type(_word, *signature.args), code


@intrinsic
def call_surface(context, kind, sizes, x, y, z, out):
    """See ``through``."""
    return _of_kind("surface", 0)


@intrinsic
def call_span(context, kind, sizes, ends, px, py, pz, ax, ay, az, out):
    """See ``through``."""
    return _of_kind("span", 1)


@intrinsic
def call_clear(context, kind, sizes, px, py, pz, ax, ay, az):
    """See ``through``."""
    return _of_kind("clear", 2)


@intrinsic
def call_original(context, model, data, contacts, wall, line, margin):
    """See ``through``."""
    signature = SIGNATURES["collide"]

    def code(context, builder, own_signature, arguments):
        return _call(context, builder, _I64(ORIGINAL), signature, arguments)

    return signature, code
