"""C functions of compiled Python, kept on disk.

MuJoCo, and compiled code that meets fittings of any kind, call functions through pointers. Numba
compiles such a function once a machine; each later process has LLVM load the code from disk. Numba
can keep code itself, but it has to be imported to load it, and it does not notice where a function
has changed that is called from another file: walls of before would go on being used. Here a file's
name is a digest of all that the code depends on.
"""

from __future__ import annotations

import ctypes
import gc
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from ctypes import CFUNCTYPE
from dataclasses import dataclass
from functools import cache, wraps
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeVar

import numpy as np
from llvmlite import binding, ir
from numpy.typing import NDArray

from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.writing import write_file

_CHECKSUM = hashlib.sha256().digest_size
_HELPERS = "numba_", "NRT_"
"""What the names of numba's own functions begin with, which compiled code calls where it raises."""
_PATIENCE = 300.0
"""s, for which a process waits for another that compiles the same function."""
_engines: list[Any] = []
"""Those that hold what has been loaded, for good."""


@cache
def machine() -> str:
    """Return what machine code depends on beside its source: compilers' versions, processor."""
    features = binding.get_host_cpu_features().flatten()
    versions = version("numba"), version("llvmlite")
    return repr((*versions, binding.get_process_triple(), binding.get_host_cpu_name(), features))


def code_file(source: str, name: str, digest: str) -> Path:
    """Return the file of a function's code.

    It lies beside the source, as Python keeps bytecode, or where that may not be written, with the
    user's caches.

    Args:
        source: file that defines it.
        name: of the function.
        digest: of all that its code depends on.
    """
    # The variable by which users of numba move its files.
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or Path(source).parent / "__pycache__")
    if not os.access(folder if folder.is_dir() else folder.parent, os.W_OK):
        folder = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "omnitrack_sim"
    return folder / f"{name}-{digest}.o"


def load_file(file: Path) -> int | None:
    """Return the address of the function in a file.

    None where there is no file, it is damaged, or it needs something that this process lacks.
    """
    octets = file.read_bytes() if file.is_file() else b""
    body = octets[_CHECKSUM:]
    # LLVM ends the process where code is damaged or refers to what there is not.
    return load_code(body) if hashlib.sha256(body).digest() == octets[:_CHECKSUM] else None


def load_code(body: bytes) -> int | None:
    """Return the address of the function in code as ``object_code`` returns it.

    None where it needs something that this process lacks.
    """
    head, _, code = body.partition(b"\n")
    symbol, externals = json.loads(head)
    target, process = _target(), ctypes.CDLL(None)
    for name in externals:
        if name.startswith(_HELPERS):
            # A C function has no way to raise: it ends the process.
            binding.add_symbol(name, ctypes.cast(process.abort, ctypes.c_void_p).value)
        elif not binding.address_of_symbol(name) and not hasattr(process, name):
            return None
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return engine.get_function_address(symbol)


def object_code(function: Any) -> bytes:
    """Return the code of a numba ``CFunc``, after a line that names it and what it refers to."""
    module = binding.parse_assembly(function.inspect_llvm())
    names = [
        each.name
        for each in (*module.functions, *module.global_variables)
        if each.is_declaration and not each.name.startswith("llvm.")
    ]
    head = json.dumps([function.native_name, names]).encode()
    return head + b"\n" + _target().emit_object(module)


def _target() -> Any:
    """Return LLVM's compiler for this processor; an engine takes it over."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(),
        features=binding.get_host_cpu_features().flatten(),
        opt=3,
        codemodel="jitdefault",
        jit=True,
    )


class CompilationError(Exception):
    """A function does not compile; the text is numba's."""


NUMBER, WORD = ctypes.c_double, ctypes.c_int64
FLOAT, INTEGER = ctypes.c_float, ctypes.c_int32
NUMBERS, WORDS = ctypes.POINTER(NUMBER), ctypes.POINTER(WORD)
SIGNATURES = {
    "surface": CFUNCTYPE(NUMBER, NUMBERS, *[NUMBER] * 3, NUMBERS),
    "span": CFUNCTYPE(NUMBER, NUMBERS, NUMBERS, *[NUMBER] * 6, NUMBERS),
    "clear": CFUNCTYPE(NUMBER, NUMBERS, *[NUMBER] * 6),
}
"""C types of the functions of ``compiled.Wall``."""
SCRATCH, ROW = 1300, 16
"""Numbers that ``scratch`` and ``row`` have room for."""


def in_numba(signature: Any) -> Any:
    """Return the C types of a function as numba has them."""
    import numba

    def kind(c: Any) -> Any:
        if hasattr(c, "contents"):
            return numba.types.CPointer(kind(c._type_))
        return numba.from_dtype(np.dtype(c))

    return kind(signature._restype_)(*map(kind, signature._argtypes_))


_Function = TypeVar("_Function", bound=Callable[..., Any])


def compiled(python: _Function) -> _Function:
    """Mark a function of a ``Wall``, or a helper of one: compiled functions may call it."""
    python.numba = _dispatcher  # type: ignore[attr-defined]
    return python


def intrinsic(definition: Callable[..., Any]) -> Any:
    """Mark a function that returns signature and code of a compiled one, made of instructions.

    Its first parameter is numba's.
    """
    definition.numba = _intrinsic  # type: ignore[attr-defined]
    return definition


@cache
def _dispatcher(python: FunctionType) -> Any:
    from numba import njit

    # A division by zero gives an infinite number, as in NumPy: checks for it would cost time in the
    # innermost loops, and a raised error has no way out of a C function. Only compiled code calls
    # these functions: the wrappers for other callers are 30 % of the time to compile.
    bare: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(error_model="numpy", **bare)(_with_numba(python))


@cache
def _intrinsic(definition: FunctionType) -> Any:
    from numba import extending

    @wraps(definition)
    def typed(*arguments: Any) -> Any:
        signature, code = definition(*arguments)
        return in_numba(signature), code

    return extending.intrinsic(typed)


def _with_numba(python: FunctionType) -> FunctionType:
    """Return a copy of a function that calls marked ones as numba knows them.

    Made where a process compiles, so that no other one loads numba.
    """
    known = {name: value.numba(value) for name, value in _called(python)}
    names = python.__globals__ | known
    return FunctionType(
        python.__code__, names, python.__name__, python.__defaults__, python.__closure__
    )


def _called(python: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the marked functions that a function calls, and their names in its module."""
    for name in python.__code__.co_names:
        value = python.__globals__.get(name)
        if hasattr(value, "numba") and value is not python:
            yield name, value


def _is_known(value: Any) -> bool:
    """Return whether a value is a function that compiled ones may call."""
    return hasattr(value, "numba") or hasattr(value, "py_func")


@dataclass(frozen=True)
class CFunction:
    """A compiled function, kept for good.

    Attributes:
        address: of its code.
        ctypes: calls it from Python.
    """

    address: int
    ctypes: Callable[..., Any]


@cache
def announce() -> None:
    """Tell on standard error, once a process, that walls are being compiled."""
    print(
        "omnitrack_sim: compiling exact walls, once; takes some 10 s", file=sys.stderr, flush=True
    )


@cache
def c_function(function: Callable[..., Any], signature: Any, is_long: bool = False) -> CFunction:
    """Compile a function, or load its code from disk.

    Args:
        function: it may call functions that are marked by ``compiled``.
        signature: C types of what it returns and of its arguments, made by ``CFUNCTYPE``.
        is_long: whether its compilation takes seconds and is announced.

    Raises:
        CompilationError: it does not compile.
    """
    source, name = function.__code__.co_filename, function.__qualname__.rpartition(".")[2]
    file = code_file(source, name, _digest(function, signature))
    address = load_file(file)
    if address is None:
        with _alone(file):
            address = load_file(file)
            if address is None:
                if is_long:
                    announce()
                address = _compile(function, signature, file)
    return CFunction(address, signature(address))


@contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Let one process at a time make a file, while others wait for it."""
    from filelock import FileLock  # only where something is compiled

    lock = file.with_suffix(".lock")
    with ExitStack() as stack:
        # Without a lock, where nothing can be written or the other hangs, each makes its own.
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(FileLock(lock, timeout=_PATIENCE))
        try:
            yield
        finally:
            # Those who wait find the code, and need the lock no more.
            with suppress(OSError):
                lock.unlink()


def _compile(function: Callable[..., Any], signature: Any, file: Path) -> int:
    """Compile a function, keep its code in a file and return its address."""
    code = object_code(_made(function, signature))
    address = load_code(code)
    if address is None:
        raise CompilationError(f"{function.__qualname__} refers to what this process lacks")
    with suppress(OSError, OutputError):
        write_file(file, hashlib.sha256(code).digest() + code)
    return address


def _made(python: Callable[..., Any], signature: Any) -> Any:
    """Return the ``CFunc`` that numba compiles."""
    from numba import cfunc
    from numba.core.errors import NumbaError

    # Numba keeps nearly all objects that it makes: searching them takes 15 % of its time.
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        return cfunc(in_numba(signature), error_model="numpy")(_with_numba(python))
    except NumbaError as error:
        raise CompilationError(str(error)) from error
    finally:
        if was_enabled:
            gc.enable()


def _digest(function: Any, signature: Any) -> str:
    """Digest of all that the machine code of a function depends on.

    These are the code of the function and of all marked ones that it calls, the constants that they
    use, the compilers and processor, and this file, whose intrinsics they call.
    """
    reached, pending = [], [function]
    while pending:
        python = pending.pop()
        if python not in reached:
            reached.append(python)
            # Users' own functions may be numba's already.
            called = (python.__globals__.get(name) for name in python.__code__.co_names)
            pending += [getattr(value, "py_func", value) for value in called if _is_known(value)]
    # By name alone: the module of a pointer's type is that which has made the first such type.
    types = [each.__name__ for each in (signature._restype_, *signature._argtypes_)]
    parts = [Path(__file__).read_bytes(), repr(types).encode(), machine().encode()]
    for python in reached:
        code = python.__code__
        # The first constant is the docstring, which does not change the code.
        parts += [code.co_code, repr(list(map(_lasting, code.co_consts[1:]))).encode()]
        values = {name: python.__globals__.get(name) for name in code.co_names}
        numbers = {name: v for name, v in values.items() if isinstance(v, int | float)}
        parts.append(repr(numbers).encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:32]


def _lasting(constant: Any) -> Any:
    """Return a constant of a function in a form that is the same in each process.

    It may be the code of a function within it.
    """
    if isinstance(constant, CodeType):
        return constant.co_code, list(map(_lasting, constant.co_consts))
    return constant


_KINDS = {np.dtype(kind).char: kind for kind in (NUMBER, WORD)} | {np.dtype(np.intp).char: WORD}


def pointers(*arrays: NDArray[Any]) -> list[Any]:
    """C pointers to the numbers of contiguous arrays of doubles or of words."""
    return [_pointer(array) for array in arrays]


def _pointer(array: Any) -> Any:
    kind = _KINDS[array.dtype.char]
    try:
        # As an argument it is the address of the array's first number; found in a third of the time
        # that ``array.ctypes`` takes.
        return kind.from_buffer(array)
    except (TypeError, ValueError):  # read-only, or empty
        assert array.flags.c_contiguous, "strided array"
        return array.ctypes.data_as(ctypes.POINTER(kind))


def calling(signature: Any) -> tuple[Any, Any]:
    """Signature and code of an intrinsic that calls the C function at its first argument."""
    returned, kinds = signature._restype_, signature._argtypes_

    def code(context, builder, own_signature, arguments):
        numba = in_numba(signature)
        function = ir.FunctionType(
            context.get_value_type(numba.return_type), map(context.get_value_type, numba.args)
        )
        return builder.call(builder.inttoptr(arguments[0], function.as_pointer()), arguments[1:])

    return CFUNCTYPE(returned, WORD, *kinds), code


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

    return CFUNCTYPE(NUMBERS, NUMBERS, WORD), code


@intrinsic
def scratch(context):
    """Room for SCRATCH numbers, on the stack of the calling function."""
    return _room(SCRATCH)


@intrinsic
def row(context):
    """Room for ROW numbers, on the stack of the calling function."""
    return _room(ROW)


def _room(count: int) -> tuple[Any, Any]:
    """Signature and code of an intrinsic that returns room for some numbers."""

    def code(context, builder, signature, arguments):
        # Numba's own way would set it all to zero, each time.
        with builder.goto_entry_block():
            room = builder.alloca(ir.ArrayType(ir.DoubleType(), count))
        return builder.bitcast(room, context.get_value_type(signature.return_type))

    return CFUNCTYPE(NUMBERS), code


def _pointer_to(kind: Any) -> Any:
    """Return an intrinsic that makes a pointer to numbers of a kind of an address."""

    @intrinsic
    def pointer(_context, _address):
        def code(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return CFUNCTYPE(kind, WORD), code

    return pointer


_FLOATS, _INTEGERS = ctypes.POINTER(FLOAT), ctypes.POINTER(INTEGER)
doubles, words, floats, integers = map(_pointer_to, (NUMBERS, WORDS, _FLOATS, _INTEGERS))
"""Pointers to numbers of a kind at an address."""
