"""Objects and files by name: choices, a user's own ``module:Object``, files that come with the
package, and names that are nearly right. It is light: completions of a shell ask it."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, NoReturn, TypeVar

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import nearest, no_such

_ENDING = re.compile(r"\.(toml|json)$", re.IGNORECASE)
_HANDED_OVER: dict[str, Any] = {}
_Value = TypeVar("_Value")


class ByName(dict[str, _Value]):
    """Values by name. Asked for another name it raises a KeyError that lists those there are."""

    def __missing__(self, name: str) -> NoReturn:
        raise KeyError(no_such(name, list(self)))


def name_of(thing: Any) -> str:
    """``module:Object`` of a class or function; from now on the name leads back to it in this
    process, even where its module cannot be imported (a notebook, a function's inside)."""
    name = f"{thing.__module__}:{thing.__qualname__}"
    _HANDED_OVER[name] = thing
    return name


def named(name: str, where: str, shipped: Mapping[str, Any]) -> Any:
    """The shipped object of that name, or the user's own of the name ``module:Object``.

    Modules are looked for where Python looks for them, and in the working folder.

    Args:
        name: as it stands in a file.
        where: the dotted path where it stands, for the fault.
        shipped: objects by their short names.

    Raises:
        InputError: there is no such object; the fault says what was looked for and the choices.
    """
    if name in shipped:
        return shipped[name]
    if name in _HANDED_OVER:
        return _HANDED_OVER[name]
    choices = (*shipped, "module:Object")
    module_name, colon, path = name.partition(":")
    if not (colon and module_name and path):
        raise InputError(Fault(where, f"is {name!r}", choices, given=name))
    folder = os.getcwd()
    if folder not in sys.path and "" not in sys.path:
        sys.path.append(folder)
    try:
        found: Any = importlib.import_module(module_name)
    except (Exception, SystemExit) as error:  # whatever a module does while it is imported
        problem = (
            f"is {name!r}: module {module_name!r} cannot be imported ({error}); it is looked for "
            f"on Python's path and in {folder}"
        )
        raise InputError(Fault(where, problem, choices)) from error
    own = _own(found)
    for part in path.split("."):
        if not hasattr(found, part):
            problem = f"is {name!r}: there is no {part!r} in module {module_name!r}"
            raise InputError(Fault(where, problem, (*shipped, *own), given=name))
        found = getattr(found, part)
    return found


def _own(module: Any) -> list[str]:
    """What a module holds but does not import, as ``module:Object``."""
    found = []
    for name, thing in vars(module).items():
        defined = hasattr(thing, "__qualname__")  # a class or a function, here or elsewhere
        imported = isinstance(thing, ModuleType) or (
            defined and thing.__module__ != module.__name__
        )
        if not imported and not name.startswith("_"):
            found.append(f"{module.__name__}:{name}")
    return found


def without_ending(name: str) -> str:
    """The name of a file without ``.toml`` or ``.json``; of a folder as it is."""
    return _ENDING.sub("", name)


def entries_beside(path: Path, fits: Callable[[Path], bool]) -> dict[str, Path]:
    """What lies in the folder of ``path`` and fits, by its name without ending; nothing where the
    folder cannot be read."""
    try:
        names = sorted(os.listdir(path.parent))
        found = [path.with_name(name) for name in names]
        return {without_ending(entry.name): entry for entry in found if fits(entry)}
    except (OSError, ValueError):  # no such folder, no permission, too long, a null character
        return {}


def near_entry(path: Path, fits: Callable[[Path], bool]) -> Path | None:
    """What lies in the folder of a path that leads nowhere, fits, and may have been meant."""
    entries = entries_beside(path, fits)
    meant = nearest(without_ending(path.name), list(entries))
    return None if meant is None else entries[meant]


def _scenario_folder() -> Path:
    """Where the shipped scenarios are: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "_scenarios"
    return inside if inside.is_dir() else package.parent / "scenarios"


def shipped_scenarios() -> ByName[Path]:
    """Scenarios that come with the package, by name.

    The name is the file's path below ``scenarios/`` without its ending.

    Example:
        >>> ot.shipped_scenarios()["tee_turn"].name
        'tee_turn.toml'
    """
    folder = _scenario_folder()
    groups = ("*.toml", "paper/*.toml", "missions/*.toml")
    files = [path for group in groups for path in sorted(folder.glob(group))]
    return ByName((path.relative_to(folder).with_suffix("").as_posix(), path) for path in files)


def shipped_sweeps() -> ByName[Path]:
    """Sweep files that come with the package, by name.

    Example:
        >>> ot.shipped_sweeps()["tee_orientation"].name
        'tee_orientation.toml'
    """
    files = sorted((_scenario_folder() / "sweeps").glob("*.toml"))
    return ByName((path.stem, path) for path in files)


def shipped_studies() -> ByName[Path]:
    """Study files that come with the package, by name.

    Example:
        >>> ot.shipped_studies()["robot_design"].name
        'robot_design.toml'
    """
    files = sorted((_scenario_folder() / "studies").glob("*.toml"))
    return ByName((path.stem, path) for path in files)


def shipped_networks() -> ByName[Path]:
    """Network files that come with the package, by name.

    Example:
        >>> ot.shipped_networks()["fig14"].name
        'fig14.toml'
    """
    files = sorted((_scenario_folder() / "networks").glob("*.toml"))
    return ByName((path.stem, path) for path in files)


def shipped_policies() -> ByName[Path]:
    """Policy files that come with the package, by name.

    Example:
        >>> ot.shipped_policies()["tee_turn"].name
        'tee_turn.npz'
    """
    files = sorted((_scenario_folder() / "policies").glob("*.npz"))
    return ByName((path.stem, path) for path in files)
