"""Kinds of fittings by name, shipped or a user's own, and their tables in files.

The ``kind`` of a table selects its model, which has the keys of that kind and those of the list
that the table stands in.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
from functools import cache, cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeGuard, TypeVar

from pydantic import create_model

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import installed, named
from omnitrack_sim.base.table import Table
from omnitrack_sim.pipes.fittings.base import Fitting, FittingTable


@cache
def shipped_fittings() -> Mapping[str, type[Fitting]]:
    """Return the kinds that come with the package, by name: modules of this folder define them."""
    package = __name__.rpartition(".")[0]
    folder = importlib.import_module(package).__path__
    kinds = {}
    for module in sorted(info.name for info in pkgutil.iter_modules(folder)):
        members = vars(importlib.import_module(f"{package}.{module}")).values()
        for member in members:
            # Modules also hold the classes that they import; only what they define counts.
            if _is_kind(member) and f"{member.__module__}.".startswith(f"{package}.{module}."):
                kinds[member.kind] = member
    return MappingProxyType(kinds)


_brought: dict[str, type[Fitting]] = {}


def known_fittings() -> Mapping[str, type[Fitting]]:
    """Return the shipped kinds and those that ``fitting_class`` has imported, by their ``kind``."""
    return {**shipped_fittings(), **_brought}


def fitting_class(kind: str) -> type[Fitting]:
    """Return the class of a ``kind`` of a file.

    That is a shipped one, an entry point of the group ``omnitrack_sim.fittings``, or
    ``module:Class``, which is imported.

    Raises:
        InputError: there is no such kind; the fault has the shipped ones as choices.
    """
    known = known_fittings().get(kind)
    if known is not None:
        return known
    fitting = named(kind, "kind", shipped_fittings(), "fittings", _is_kind)
    if not _is_kind(fitting):
        choices = (*shipped_fittings(), *installed("fittings"))
        raise InputError(Fault("kind", f"is {kind!r}, which is no fitting", choices, given=kind))
    _brought[kind] = fitting
    return fitting


def _is_kind(member: object) -> TypeGuard[type[Fitting]]:
    """Return whether a member of a module is a fitting class that can be instantiated."""
    return (
        isinstance(member, type)
        and issubclass(member, Fitting)
        and hasattr(member, "kind")
        and not inspect.isabstract(member)
    )


class FittingEntry(Table):
    """A fitting in a list of a file; every list adds its keys, and ``table_of`` those of a kind."""

    kind: str
    """Kind of fitting: "straight", "reducer", "elbow", "mitre", "tee", "wye", "cross", "cap",
    "coupling", or `module:Class` of a fitting of your own."""
    of: ClassVar[type[Fitting]]

    @classmethod
    def model_for(cls, value: Mapping[str, Any]) -> type[Table]:
        """Return the table of the ``kind`` in ``value``; the entry's own without one."""
        try:
            return table_of(str(value["kind"]), cls)
        except (KeyError, InputError):
            return cls

    @classmethod
    def keys_for(cls, fitting: type[Fitting]) -> dict[str, Any]:  # noqa: ARG003 - default
        """Keys of the list that depend on the kind, as ``pydantic.create_model`` takes them."""
        return {}

    def fitting(self) -> Fitting:
        """Return the fitting that the table describes.

        Raises:
            GeometryError: sizes that do not go together.
        """
        return self._fitting

    @cached_property
    def _fitting(self) -> Fitting:
        assert isinstance(self, FittingTable)  # every table of ``table_of`` is
        return self.of.from_table(self)


_Entry = TypeVar("_Entry", bound=FittingEntry)


@cache
def table_of(kind: str, entry: type[_Entry]) -> type[_Entry]:
    """Return the table of one kind of fitting in one list: the list's keys, then its own.

    Raises:
        InputError: there is no such kind.
    """
    fitting = fitting_class(kind)
    # The bases are in this order so that the list's keys come first in messages and documentation.
    table = create_model(  # type: ignore[call-overload]
        f"{fitting.__name__}{entry.__name__}",
        __base__=(fitting.Table, entry),
        __doc__=fitting.__doc__,
        kind=(Literal[kind], ...),  # type: ignore[arg-type]
        **entry.keys_for(fitting),
    )
    table.of = fitting
    return table
