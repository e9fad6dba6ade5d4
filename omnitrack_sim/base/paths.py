"""Dotted paths into the plain data of a file, such as ``pipes.0.length`` or ``pipes.*.turn_deg``.

A path names keys of tables and indices of lists, from the outermost inward; ``*`` stands for every
item of a list. Files leave out what has a default, so what may stand at a path does not follow from
what does: ``Document`` asks the model that the file is read with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from functools import reduce
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from omnitrack_sim.base.errors import Fault
from omnitrack_sim.base.table import Table

Keys = Sequence[str]
"""Keys of a path, one by one."""


def keys_of(path: str) -> list[str]:
    """Return the keys of a path, from the outermost inward."""
    return path.split(".")


def has(value: Any, key: str) -> bool:
    """Return whether a table has a key, or a list an item of that index."""
    # int() alone would take "+1", "1_0" and digits of other scripts, and be slow on huge ones.
    if isinstance(value, list):
        is_index = key.isascii() and key.isdecimal() and len(key) < 10
        return is_index and str(int(key)) == key and int(key) < len(value)
    return isinstance(value, Mapping) and key in value


def below(value: Any, key: str) -> Any:
    """Return the value of a key in a table, or of an index in a list; None where there is none."""
    if not has(value, key):
        return None
    return value[int(key)] if isinstance(value, list) else value[key]


def value_at(data: Any, path: str) -> Any:
    """Return the value at a path, all of the data at the empty one; None where there is none.

    Example:
        >>> value_at({"pipes": [{"length": 0.5}]}, "pipes.0.length")
        0.5
    """
    return reduce(below, keys_of(path), data) if path else data


def expand(data: Any, path: str) -> list[str]:
    """Return the paths that a path stands for.

    These are one for each item of a list that a ``*`` meets, and one for each key of a table that
    a pattern such as ``wheel_*`` fits, unless it is a key itself.

    Example:
        >>> expand({"pipes": [{"length": 0.5}, {}]}, "pipes.*.length")
        ['pipes.0.length', 'pipes.1.length']
        >>> expand({"joint": {"wheel_1": {}, "wheel_2": {}, "arm": {}}}, "joint.wheel_*.damping")
        ['joint.wheel_1.damping', 'joint.wheel_2.damping']
    """
    paths: list[tuple[str, ...]] = [()]
    for key in keys_of(path):
        paths = [(*before, one) for before in paths for one in _fitting(data, before, key)]
    return [".".join(keys) for keys in paths]


def _fitting(data: Any, before: Keys, key: str) -> Sequence[str]:
    """Return what a key stands for at a path: itself, or where it has a ``*``, what fits it."""
    if "*" not in key:
        return [key]
    place = reduce(below, before, data)
    if isinstance(place, list) and key == "*":
        return [str(index) for index in range(len(place))]
    if isinstance(place, Mapping) and key not in place:
        return [one for one in place if fnmatchcase(one, key)] or [key]
    return [key]


def matches(data: Any, path: str) -> list[str]:
    """Return those of the paths that ``path`` stands for at which there is a value.

    Example:
        >>> matches({"pipes": [{"length": 0.5}, {}]}, "pipes.*.length")
        ['pipes.0.length']
    """
    places = [one.rpartition(".") for one in expand(data, path)]
    return [
        f"{before}{dot}{key}" for before, dot, key in places if has(value_at(data, before), key)
    ]


@dataclass(frozen=True)
class Document:
    """Plain data of a file, which may be incomplete, with the model that it is read with.

    Attributes:
        model: the model.
        data: tables as dictionaries, lists as lists.
        open_tables: tables of which something else knows the keys, by their path: what returns
            their model from all of the data, None where it is unknown. They may hold more keys
            than these.
    """

    model: type[BaseModel]
    data: Any
    open_tables: Mapping[tuple[str, ...], Callable[[Any], Any]] = field(default_factory=dict)

    def keys_at(self, keys: Keys) -> tuple[str, ...]:
        """Return the valid keys of the table at a path; none where no table belongs."""
        return self._keys_in(reduce(below, keys, self.data), keys)

    def paths(self) -> Iterator[str]:
        """Yield the paths of all keys, of those in lists only where the data has the list."""
        return self._paths_below(self.model, self.data, ())

    def _paths_below(self, kind: Any, place: Any, before: tuple[str, ...]) -> Iterator[str]:
        """Yield the paths of the keys of a value of a type at a path."""
        for key in _keys_of(_model_of(kind, {} if place is None else place)):
            keys = (*before, key)
            yield ".".join(keys)
            own = self.open_tables.get(keys)
            inner = own(self.data) if own else _type_below(kind, place, key)
            yield from self._paths_below(inner, below(place, key), keys)

    def expand(self, path: str) -> list[str]:
        """Return the paths of what a path with ``*`` stands for, or the path itself.

        Of the items of a list those count that may have the key.
        """
        return [one for one in expand(self.data, path) if self._may_stand(keys_of(one))] or [path]

    def set(self, path: str, value: Any) -> Fault | None:
        """Set the value at a path; tables on the way there are filled with their defaults.

        Returns:
            None; or the fault where there is no such place, and then the data is unchanged.
        """
        *before, last = keys_of(path)
        place, undo = self.data, None
        for depth, key in enumerate([*before, last]):
            fault = self._fault_at(place, before[:depth], key)
            if fault is not None:
                # Tables that were filled in on the way go again.
                if undo is not None:
                    undo[0].clear()
                    undo[0].update(undo[1])
                return (fault if depth else self._only_the_end(path) or fault).at(path)
            at: Any = int(key) if isinstance(place, list) else key
            if depth == len(before):
                place[at] = value
                break
            if isinstance(place, dict) and place.get(key) is None:
                undo = undo or (place, dict(place))
                place[key] = self._default(place, before[:depth], key)
            place = place[at]
        return None

    def _fault_at(self, place: Any, before: Keys, key: str) -> Fault | None:
        """Return the fault of a key that cannot stand in ``place``, at the path ``before``."""
        if has(place, key):
            return None
        if isinstance(place, list):
            return _nowhere(key, tuple(map(str, range(len(place)))))
        if not isinstance(place, dict):
            return Fault("", f"{key!r} is below a plain value")
        # An open table is checked by its own model, which may take more than it lists.
        is_open = any(tuple(before[: len(table)]) == table for table in self.open_tables)
        if is_open or get_origin(self._type_at(before)) is dict:
            return None
        known = self._keys_in(place, before)
        return None if key in known else _nowhere(key, known)

    def _only_the_end(self, path: str) -> Fault | None:
        """Return the fault of a path that is the end of others; None where it is of none."""
        whole = tuple(one for one in self.paths() if one.endswith(f".{path}"))
        return Fault("", "is the end of a path; give all of it", whole) if whole else None

    def _may_stand(self, keys: Keys) -> bool:
        *before, key = keys
        place = reduce(below, before, self.data)
        return below(place, key) is not None or key in self._keys_in(place, before)

    def _type_at(self, keys: Keys) -> Any:
        """Return the type of the value at a path; None where it is unknown."""
        kind, data = self.model, self.data
        for depth, key in enumerate(keys, start=1):
            own = self.open_tables.get(tuple(keys[:depth]))
            kind, data = own(self.data) if own else _type_below(kind, data, key), below(data, key)
        return kind

    def _keys_in(self, place: Any, before: Keys) -> tuple[str, ...]:
        """Return the valid keys of the table ``place`` at the path ``before``."""
        return _keys_of(_model_of(self._type_at(before), place))

    def _default(self, place: Any, before: Keys, key: str) -> Any:
        """Return the default of a key as plain data; an empty table where there is none."""
        model = _model_of(self._type_at(before), place)
        info = None if model is None else model.model_fields.get(key)
        default = None if info is None else info.get_default(call_default_factory=True)
        return {} if default in (None, PydanticUndefined) else to_jsonable_python(default)


def _nowhere(key: str, choices: tuple[str, ...]) -> Fault:
    return Fault("", f"there is no {key!r} here", choices, given=key)


def _keys_of(model: type[BaseModel] | None) -> tuple[str, ...]:
    return () if model is None else (*getattr(model, "OTHER_KEYS", ()), *model.model_fields)


def _model_of(kind: Any, value: Any) -> type[BaseModel] | None:
    """Return the model of the table of a type that holds ``value``; None where no table belongs."""
    kind = _bare(kind)
    if not (isinstance(kind, type) and issubclass(kind, BaseModel)):
        return None
    if issubclass(kind, Table) and isinstance(value, Mapping):
        return kind.model_for(value)
    return kind


def _type_below(kind: Any, value: Any, key: str) -> Any:
    """Return the type of the value of ``key`` in a value of a type; None where it is unknown."""
    model = _model_of(kind, value)
    if model is not None:
        info = model.model_fields.get(key)
        return None if info is None else info.annotation
    bare = _bare(kind)
    arguments, origin = get_args(bare), get_origin(bare)
    # Tables by names that nobody lists have values of one type.
    return arguments[{tuple: 0, dict: 1}[origin]] if origin in (tuple, dict) and arguments else None


def _bare(kind: Any) -> Any:
    """Strip a type of its metadata and of None."""
    while True:
        if get_origin(kind) is Annotated:
            kind = get_args(kind)[0]
        elif get_origin(kind) in (Union, UnionType):
            kinds = [one for one in get_args(kind) if one is not NoneType]
            # A union of several types has no keys of its own that could be offered as choices.
            kind = kinds[0] if len(kinds) == 1 else object
        else:
            return kind
