"""Machine code of compiled functions on disk, loaded by LLVM alone.

To import numba and to ready its registries takes half a second of each process. Where all code is
on disk already nothing needs it: the files hold what numba has made, to the byte.
"""

from __future__ import annotations

import builtins
import ctypes
import hashlib
import json
import os
from contextlib import suppress
from functools import cache
from importlib.metadata import distribution, version
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from llvmlite import binding

from omnitrack_sim.base.errors import OutputError
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


def file_of(source: str, name: str, digest: str) -> Path:
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


def load(file: Path) -> int | None:
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


def store(file: Path, function: Any) -> None:
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
