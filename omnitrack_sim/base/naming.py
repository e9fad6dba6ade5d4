"""Objects and files by name: shipped ones, entry points, ``module:Object``, and shipped files.

Imports stay light, because shell completion loads this module.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, NoReturn, TypeVar

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import no_such

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_HANDED_OVER: dict[str, Any] = {}
_FOLDERS: list[Path] = []
"""Of the files that were read, the newest last: modules may lie beside them."""
_TRUSTED: ContextVar[Collection[str] | None] = ContextVar("_TRUSTED", default=())
"""Modules that a name in a file may import; None: any."""
_Value = TypeVar("_Value")


TRUST = "--trust, or in Python trust=True"
"""How a user says that the code which a file names may be run."""


class NotTrustedError(InputError):
    """A file names code that is not loaded, and what reads it runs none."""


@contextmanager
def trusting(modules: Collection[str] | None = None) -> Iterator[None]:
    """Let names in files import their modules, as what is about to be run has to.

    Outside of this no name imports anything: saved runs, maps and passports are looked at, and
    whoever made them may not be trusted.

    Args:
        modules: that may be imported; None: all.
    """
    before = _TRUSTED.set(modules)
    try:
        yield
    finally:
        _TRUSTED.reset(before)


def is_trusting() -> bool:
    """Return whether names in files may import any module at this moment."""
    return _TRUSTED.get() is None


def is_usable(name: str) -> bool:
    """Return whether an object ``module:Object`` is loaded, or may be."""
    try:
        module_name, _, path = name.partition(":")
        return (
            is_trusting()
            or name in _HANDED_OVER
            or bool(_already_loaded(name, module_name, path, ""))
        )
    except NotTrustedError:
        return False


class ByName(dict[str, _Value]):
    """Values by name; the KeyError of an unknown name lists the valid ones."""

    def __missing__(self, name: str) -> NoReturn:
        raise KeyError(no_such(name, list(self)))


def name_of(thing: Any) -> str:
    """Return the name ``module:Object`` of a class or function, and register it.

    Within this process the name then leads back to it, also where its module cannot be imported (a
    notebook, the inside of a function).
    """
    name = f"{thing.__module__}:{thing.__qualname__}"
    _HANDED_OVER[name] = thing
    return name


def by_pattern(table: Mapping[str, _Value], names: Sequence[str], where: str) -> dict[str, _Value]:
    """Return values by names of which a table has some, or patterns of them such as ``wheel_*``.

    Args:
        table: where several keys fit one name, the last one counts.
        names: all that there are.
        where: dotted path of the table.

    Raises:
        InputError: a key fits none of the names.
    """
    found: dict[str, _Value] = {}
    for key, value in table.items():
        fitting = [key] if key in names else [n for n in names if fnmatchcase(n, key)]
        if not fitting:
            raise InputError(Fault(f"{where}.{key}", "fits no name", tuple(names), given=key))
        found |= dict.fromkeys(fitting, value)
    return found


Group = Literal["robots", "controllers", "fittings"]
"""What installed distributions may add, by entry points of the groups ``omnitrack_sim.GROUP``."""


def installed(group: Group) -> Mapping[str, EntryPoint]:
    """Return the entry points that installed distributions declare in a group, by name.

    None of them is loaded.
    """
    return _installed(f"omnitrack_sim.{group}", tuple(sys.path))


@lru_cache(maxsize=8)
def _installed(group: str, _path: tuple[str, ...]) -> Mapping[str, EntryPoint]:
    """Return entry points by name; ``_path``, where Python looks for them, is part of the key."""
    from importlib.metadata import entry_points

    # Of two of one name the first counts, as of two modules of one name.
    return {entry.name: entry for entry in reversed(tuple(entry_points(group=group)))}


def named(
    name: str,
    where: str,
    shipped: Mapping[str, Any],
    group: Group | None = None,
    fits: Callable[[Any], bool] | None = None,
) -> Any:
    """Return the object that a name in a file stands for.

    That is a shipped one, one that an installed distribution adds, or the user's own
    ``module:Object``. Where the caller trusts the file (``trusting``) its module is imported; it is
    looked for where Python looks for modules, in the working folder, and beside the files that were
    read. Elsewhere the name stands for an object only if its module has been imported already.

    Args:
        name: as it stands in a file.
        where: the dotted path where it stands, for the fault.
        shipped: objects by their short names.
        group: of the entry points that count; None: there are none.
        fits: tells which objects of a module are choices where the one asked for is not in it;
            None: all.

    Raises:
        NotTrustedError: the object is not loaded, and the file is not trusted.
        InputError: there is no such object; the fault says what was looked for and the choices.
    """
    if name in shipped:
        return shipped[name]
    # Before any import: a class of a notebook or of a function's inside has no importable module.
    if name in _HANDED_OVER:
        return _HANDED_OVER[name]
    added = {} if group is None else installed(group)
    value = added[name].value if name in added else name
    module_name, colon, path = value.partition(":")
    if not (colon and module_name and path):
        choices = (*shipped, *added, "module:Object")
        raise InputError(Fault(where, f"is {name!r}", choices, given=name))
    trusted = _TRUSTED.get()
    if trusted is not None and module_name not in trusted:
        return _already_loaded(name, module_name, path, where)
    if name in added:
        return _loaded(added[name], where)
    return _imported(module_name, path, where, (*shipped, *added), fits)


def _already_loaded(name: str, module_name: str, path: str, where: str) -> Any:
    """Return the object ``path`` of a module that this process has imported; nothing is run.

    Raises:
        NotTrustedError: there is none.
    """
    thing: Any = sys.modules.get(module_name)
    for part in path.split("."):
        # Not by getattr, at which modules and classes may run code, such as a lazy import.
        members = getattr(thing, "__dict__", {}) if isinstance(thing, ModuleType | type) else {}
        if part not in members:
            problem = f"is {name!r}, code that only looking at a file does not run; if you trust it"
            raise NotTrustedError(Fault(where, f"{problem}: {TRUST}"))
        thing = members[part]
    return thing


def _loaded(entry: EntryPoint, where: str) -> Any:
    """Return the object of an entry point.

    Raises:
        InputError: it cannot be imported.
    """
    try:
        return entry.load()
    except (Exception, SystemExit) as error:  # whatever a module does while it is imported
        whose = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
        problem = f"is {entry.name!r}: {entry.value!r}{whose} cannot be imported ({error})"
        raise InputError(Fault(where, problem)) from error


def _imported(
    module_name: str,
    path: str,
    where: str,
    known: tuple[str, ...],
    fits: Callable[[Any], bool] | None,
) -> Any:
    """Return the object ``path`` of a user's module; ``known`` are the short names there are.

    Raises:
        InputError: there is no such module or object.
    """
    folders, name = [Path.cwd(), *_FOLDERS], f"{module_name}:{path}"
    # Appended, not put first, so that a file in these folders cannot hide an installed module.
    here = [] if "" in sys.path else folders[:1]
    sys.path += [str(f) for f in (*here, *_FOLDERS) if str(f) not in sys.path]
    try:
        thing: Any = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:  # whatever a module does while it is imported
        # A process that reads many files has many folders; this file's is the last.
        searched = " and ".join(dict.fromkeys(map(str, (folders[0], folders[-1]))))
        problem = (
            f"is {name!r}: module {module_name!r} cannot be imported ({error}); start in its "
            f"folder, or add that to PYTHONPATH: it is looked for on Python's path, in {searched}"
        )
        raise InputError(Fault(where, problem, (*known, "module:Object"))) from error
    _refuse_twin(thing, name, where)
    # Listed before the walk, since `thing` then moves on to the attributes of the module.
    own = _own(thing, fits)
    for part in path.split("."):
        if not hasattr(thing, part):
            problem = f"is {name!r}: there is no {part!r} in module {module_name!r}"
            raise InputError(Fault(where, problem, (*known, *own), given=name))
        thing = getattr(thing, part)
    return thing


def look_beside(file: Path) -> None:
    """Let modules that a file names lie beside it."""
    folder = file.resolve().parent
    if not folder.is_relative_to(_scenario_folder()):
        _FOLDERS[:] = [other for other in _FOLDERS if other != folder] + [folder]


def _refuse_twin(module: ModuleType, name: str, where: str) -> None:
    """Refuse a module where another one of this name lies beside the file that was read last."""
    if not _FOLDERS or not getattr(module, "__file__", None):
        return
    file = Path(str(module.__file__)).resolve()
    beside = _FOLDERS[-1] / f"{module.__name__.partition('.')[0]}.py"
    if file.parent in _FOLDERS[:-1] and beside.is_file():
        problem = f"is {name!r}: {beside} has the name of {file}, which is in use; rename one"
        raise InputError(Fault(where, problem))


def _own(module: Any, fits: Callable[[Any], bool] | None) -> list[str]:
    """Names ``module:Object`` of what a module defines itself and what fits."""
    names = []
    for name, thing in vars(module).items():
        defined = hasattr(thing, "__qualname__")  # a class or a function, here or elsewhere
        imported = isinstance(thing, ModuleType) or (
            defined and thing.__module__ != module.__name__
        )
        if not imported and not name.startswith("_") and (fits is None or fits(thing)):
            names.append(f"{module.__name__}:{name}")
    return names


def _scenario_folder() -> Path:
    """Folder of the shipped scenarios: in the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "_scenarios"
    return inside if inside.is_dir() else package.parent / "scenarios"


ShippedKind = Literal[
    "scenarios",
    "sweeps",
    "studies",
    "networks",
    "conditions",
    "suites",
    "courses",
    "policies",
    "passports",
]


def shipped_files(kind: ShippedKind) -> ByName[Path]:
    """Return the files of a kind that come with the package, by name.

    The name is the file's own without its ending; of a scenario, its path below ``scenarios/``.

    Args:
        kind: ``scenarios``, ``sweeps``, ``studies``, ``networks``, ``conditions`` of pipes,
            ``policies``, ``suites`` and ``courses`` of benches, or ``passports`` of robots.

    Example:
        >>> ot.shipped_files("scenarios")["tee_turn"].name
        'tee_turn.toml'
        >>> ot.shipped_files("policies")["tee_turn"].name
        'tee_turn.npz'
    """
    folder = _scenario_folder()
    if kind != "scenarios":
        return ByName((path.stem, path) for path in sorted((folder / kind).glob("*.*")))
    folders = ("paper", "missions", "robots", "calibration")
    groups = ("*.toml", *(f"{one}/*.toml" for one in folders))
    files = [path for group in groups for path in sorted(folder.glob(group))]
    return ByName((path.relative_to(folder).with_suffix("").as_posix(), path) for path in files)
