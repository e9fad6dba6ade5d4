"""C functions of compiled Python: kept on disk, called by their address.

MuJoCo, and compiled code that meets fittings of any kind, call functions through pointers. Nothing
that changes from process to process stands in such a function, so that its code is kept on disk
and serves every process: the first one compiles it, which takes some tenths of a second to
seconds and loads numba; later ones load the code by LLVM alone, as numba takes half a second.
"""

from __future__ import annotations

import builtins
import ctypes
import gc
import hashlib
import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from ctypes import CFUNCTYPE
from dataclasses import dataclass
from functools import cache, cached_property, update_wrapper, wraps
from importlib.metadata import distribution, version
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

from llvmlite import binding, ir

from omnitrack_sim.base.errors import OutputError
from omnitrack_sim.base.rotations import Array
from omnitrack_sim.base.writing import write_file

_CHECKSUM = hashlib.sha256().digest_size
_HELPERS = {"_helperlib": "numba_", "core.runtime._nrt_python": "NRT_"}
"""Modules of numba, written in C, whose functions compiled code calls where it raises, and what
their names begin with there."""
_NUMBA = distribution("numba")
_engines: list[Any] = []
"""Those that hold what has been loaded, for good."""


@cache
def machine() -> str:
    """Return what machine code depends on beside its source: compilers' versions, processor."""
    features = binding.get_host_cpu_features().flatten()
    versions = _NUMBA.version, version("llvmlite")
    return repr((*versions, binding.get_process_triple(), binding.get_host_cpu_name(), features))


def code_file(source: str, name: str, digest: str) -> Path:
    """Return the file of a function's code: beside the source, as Python keeps bytecode, or where
    that may not be written, with the user's caches.

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


def load_code(file: Path) -> int | None:
    """Return the address of the function in a file; None where there is none, it is damaged, or it
    needs something that this process lacks."""
    octets = file.read_bytes() if file.is_file() else b""
    body = octets[_CHECKSUM:]
    # LLVM ends the process where code is damaged or refers to what there is not.
    if hashlib.sha256(body).digest() != octets[:_CHECKSUM]:
        return None
    head, _, code = body.partition(b"\n")
    symbol, externals = json.loads(head)
    _prepare()
    process = ctypes.CDLL(None)
    if not all(binding.address_of_symbol(each) or hasattr(process, each) for each in externals):
        return None
    target = binding.Target.from_default_triple().create_target_machine(jit=True)
    engine = binding.create_mcjit_compiler(binding.parse_assembly(""), target)
    engine.add_object_file(binding.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return engine.get_function_address(symbol)


def store_code(file: Path, function: Any) -> None:
    """Keep the code of a numba ``CFunc`` in a file, if it can be kept."""
    # Not numba's public names: another version may lack them, and then compiles in each process.
    with suppress(AttributeError, OSError, OutputError):
        library = function._library
        module, code = library._final_module, library._get_compiled_object()
        names = [
            each.name
            for each in (*module.functions, *module.global_variables)
            if each.is_declaration and not each.name.startswith("llvm.")
        ]
        body = json.dumps([function.native_name, names]).encode() + b"\n" + code
        file.parent.mkdir(parents=True, exist_ok=True)
        write_file(file, hashlib.sha256(body).digest() + body)


@cache
def _prepare() -> None:
    """Ready LLVM, and give it what compiled functions may refer to, as numba does."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    for module, prefix in _HELPERS.items():
        for name, address in _extension(module).c_helpers.items():
            binding.add_symbol(name if name.startswith("_") else prefix + name, address)
    for name, value in vars(builtins).items():
        if isinstance(value, type) and issubclass(value, BaseException):
            binding.add_symbol(f"PyExc_{name}", id(value))


def _extension(name: str) -> Any:
    """Load a module of numba that is written in C, without the package around it."""
    (path,) = Path(str(_NUMBA.locate_file("numba"))).glob(f"{name.replace('.', '/')}.*.so")
    spec = spec_from_file_location(f"numba.{name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
SCRATCH = 16
"""Numbers that ``scratch`` has room for."""


def in_numba(signature: Any) -> Any:
    """Return the C types of a function as numba has them."""
    from numba.core.typing.ctypes_utils import from_ctypes

    return from_ctypes(signature._restype_)(*map(from_ctypes, signature._argtypes_))


class Marked:
    """A function that compiled ones may call, as numba knows it: made when numba asks for it, so
    that numba is loaded by a process that compiles and by no other.

    Args:
        python: the function.
        make: returns what numba makes of it.
    """

    def __init__(self, python: Callable[..., Any], make: Callable[..., Any]) -> None:
        update_wrapper(self, python)
        self.py_func, self._make = python, make

    @cached_property
    def _made(self) -> Any:
        return self._make(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        """The type by which numba knows this object among the names of a function's module."""
        from numba.core.registry import cpu_target

        made, context = self._made, cpu_target.typing_context
        context.refresh()
        return context.resolve_value_type(made)

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


def compiled(python: Callable[..., Any]) -> Marked:
    """Mark a function of a ``Wall``, or a helper of one."""
    return Marked(python, _dispatcher)


def _dispatcher(python: Callable[..., Any]) -> Any:
    from numba import njit

    # A division by zero gives an infinite number, as in NumPy: checks for it would cost time in the
    # innermost loops, and a raised error has no way out of a C function. Only compiled code calls
    # these functions: the wrappers for other callers are 30 % of the time to compile.
    bare: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return njit(error_model="numpy", **bare)(python)


def intrinsic(definition: Callable[..., Any]) -> Any:
    """Mark a function that returns the signature and the code of a function, made of instructions;
    its first parameter is numba's."""
    return Marked(definition, _intrinsic)


def _intrinsic(definition: Callable[..., Any]) -> Any:
    from numba.core import extending

    @wraps(definition)
    def typed(*arguments: Any) -> Any:
        signature, code = definition(*arguments)
        return in_numba(signature), code

    return extending.intrinsic(typed)


@dataclass(frozen=True)
class CFunction:
    """A compiled function, kept for good.

    Attributes:
        address: of its code.
        ctypes: calls it from Python.
    """

    address: int
    ctypes: Callable[..., Any]


_kept: list[Any] = []
"""What numba has compiled in this process, whose code goes with it."""


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
        function: plain, or already marked by ``compiled``; it may call marked ones.
        signature: C types of what it returns and of its arguments, made by ``CFUNCTYPE``.
        is_long: whether its compilation takes seconds and is announced.

    Raises:
        CompilationError: it does not compile.
    """
    python = getattr(function, "py_func", function)
    code, name = python.__code__, python.__qualname__.rpartition(".")[2]
    file = code_file(code.co_filename, name, _digest(python, signature))
    try:
        address = load_code(file)
    except Exception:  # numba or LLVM are not as they are known: every process compiles
        address = None
    if address is None:
        if is_long:
            announce()
        made = _made(python, signature)
        store_code(file, made)
        _kept.append(made)
        address = made.address
    return CFunction(address, signature(address))


def _made(python: Callable[..., Any], signature: Any) -> Any:
    """Return the ``CFunc`` that numba compiles."""
    from numba import cfunc
    from numba.core.errors import NumbaError

    # Numba keeps nearly all objects that it makes: searching them takes 15 % of its time.
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        return cfunc(in_numba(signature), error_model="numpy")(python)
    except NumbaError as error:
        raise CompilationError(str(error)) from error
    finally:
        if was_enabled:
            gc.enable()


def _digest(function: Any, signature: Any) -> str:
    """Digest of the code of a function, of all marked functions that it calls, of the constants
    that these use, and of this file, whose intrinsics they call."""
    reached, pending = [], [function]
    while pending:
        python = pending.pop()
        if python not in reached:
            reached.append(python)
            called = (python.__globals__.get(name) for name in python.__code__.co_names)
            # Functions that are numba's own already are marked ones, too.
            below = (getattr(value, "py_func", None) for value in called)
            pending += [value for value in below if isinstance(value, FunctionType)]
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
    """Return a constant of a function in a form that is the same in each process, also where it is
    the code of a function within it."""
    if isinstance(constant, CodeType):
        return constant.co_code, list(map(_lasting, constant.co_consts))
    return constant


def pointers(*arrays: Array) -> list[Any]:
    """C pointers to the numbers of contiguous arrays of doubles."""
    return [array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for array in arrays]


def calling(signature: Any) -> tuple[Any, Any]:
    """Signature and code of an intrinsic that calls the C function at an address, its first
    argument, with the other ones."""

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

    def code(context, builder, signature, arguments):
        from numba.core import cgutils

        room = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), SCRATCH))
        return builder.bitcast(room, context.get_value_type(signature.return_type))

    return CFUNCTYPE(NUMBERS), code
