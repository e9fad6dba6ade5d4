"""Kinds of fittings by name: those of this folder, and those that a user brings."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import TypeGuard

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import named
from omnitrack_sim.pipes.fittings.base import Fitting


@cache
def shipped_fittings() -> Mapping[str, type[Fitting]]:
    """The kinds that come with the package, by name: every module, or folder, of this folder brings
    one."""
    package = __name__.rpartition(".")[0]
    folder = importlib.import_module(package).__path__
    found = {}
    for module in sorted(info.name for info in pkgutil.iter_modules(folder)):
        members = vars(importlib.import_module(f"{package}.{module}")).values()
        for member in members:
            if _is_kind(member) and f"{member.__module__}.".startswith(f"{package}.{module}."):
                found[member.kind] = member
    return MappingProxyType(found)


_brought: dict[str, type[Fitting]] = {}


def known_fittings() -> Mapping[str, type[Fitting]]:
    """The shipped kinds, and those that ``fitting_class`` has found elsewhere in this process, by
    their ``kind`` in files."""
    return {**shipped_fittings(), **_brought}


def fitting_class(kind: str) -> type[Fitting]:
    """The class of a ``kind`` of a file: a shipped one, or ``module:Class``, which is imported.

    Raises:
        InputError: there is no such kind; the fault has the shipped ones as choices.
    """
    found = known_fittings().get(kind)
    if found is not None:
        return found
    choices = tuple(shipped_fittings())
    found = named(kind, "kind", shipped_fittings())
    if not _is_kind(found):
        raise InputError(Fault("kind", f"is {kind!r}, which is no fitting", choices, given=kind))
    _brought[kind] = found
    return found


def _is_kind(member: object) -> TypeGuard[type[Fitting]]:
    """Whether a member of a module is a kind of fitting that can be made."""
    return (
        isinstance(member, type)
        and issubclass(member, Fitting)
        and hasattr(member, "kind")
        and not inspect.isabstract(member)
    )
