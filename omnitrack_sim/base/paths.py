"""What may stand at a dotted path of a file, by the model that the file is read with.

Files leave out what has a default, so what may stand at a place does not follow from what does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from omnitrack_sim.base.table import Table


def model_of(annotation: Any, value: Any) -> type[BaseModel] | None:
    """The model of the table at a place; None where no table belongs.

    Args:
        annotation: type of the place.
        value: what stands there; see ``Table.model_for``.
    """
    annotation = _bare(annotation)
    if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        return None
    if issubclass(annotation, Table) and isinstance(value, Mapping):
        return annotation.model_for(value)
    return annotation


def keys_of(annotation: Any, value: Any) -> tuple[str, ...]:
    """Valid keys of the table at a place; see ``model_of``."""
    model = model_of(annotation, value)
    if model is None:
        return ()
    return (*getattr(model, "OTHER_KEYS", ()), *model.model_fields)


def below(annotation: Any, value: Any, key: str) -> Any:
    """Type of what stands below ``key`` at a place; None where it is not known."""
    model = model_of(annotation, value)
    if model is not None:
        info = model.model_fields.get(key)
        return None if info is None else info.annotation
    bare = _bare(annotation)
    arguments = get_args(bare)
    return arguments[0] if get_origin(bare) is tuple and arguments else None


def index_of(items: Sequence[Any], key: str) -> int | None:
    """The index that a key of a dotted path means in a list; None where there is no such item."""
    index = int(key) if key.isascii() and key.isdecimal() and len(key) < 10 else len(items)
    return index if index < len(items) and str(index) == key else None


def inside(value: Any, key: str) -> Any:
    """What stands below ``key`` in a table or list; None where there is nothing."""
    if isinstance(value, list):
        index = index_of(value, key)
        return None if index is None else value[index]
    return value.get(key) if isinstance(value, Mapping) else None


def keys_at(model: type[BaseModel], data: Any, places: Sequence[str]) -> tuple[str, ...]:
    """Valid keys of the table at a path into plain data that a model is made from."""
    annotation: Any = model
    for key in places:
        annotation, data = below(annotation, data, key), inside(data, key)
    return keys_of(annotation, data)


def default_of(annotation: Any, value: Any, key: str) -> Any:
    """What a table has at ``key`` if its file leaves it out, as plain data; an empty table where
    there is no default."""
    model = model_of(annotation, value)
    info = None if model is None else model.model_fields.get(key)
    default = None if info is None else info.get_default(call_default_factory=True)
    return {} if default in (None, PydanticUndefined) else to_jsonable_python(default)


def _bare(annotation: Any) -> Any:
    """A type without its metadata, and without None."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif get_origin(annotation) in (Union, UnionType):
            kinds = [kind for kind in get_args(annotation) if kind is not NoneType]
            annotation = kinds[0] if len(kinds) == 1 else object
        else:
            return annotation
