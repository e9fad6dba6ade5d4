"""Tables of a user's file: base class, units and meanings of keys, valid keys at a dotted path.

Files leave out what has a default, so what may stand at a place does not follow from what does.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import PydanticUndefined, to_jsonable_python


class Table(BaseModel):
    """Frozen table of a file; unknown keys are errors.

    The string below a key states its meaning; see ``meanings_of``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def model_for(cls, value: Mapping[str, Any]) -> type[Table]:
        """Return the class that plain data ``value`` is read with, where a key decides which."""
        return cls

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            super().__setattr__(name, value)
        except ValidationError:
            hint = "ot.override(scenario, {'a.key': value}) makes a copy of a scenario with changes"
            raise TypeError(f"{type(self).__name__}.{name} cannot be set: {hint}") from None


@dataclass(frozen=True)
class Unit:
    """Unit of a number in a file, as part of the annotation of its key.

    Attributes:
        symbol: such as "m", "deg" or "1".
        short: the word before the number in a list of sizes; None where it is not listed.
    """

    symbol: str
    short: str | None = None


_Mark = TypeVar("_Mark")


@dataclass(frozen=True)
class FileName:
    """Mark, in the annotation of a key, that it names a file.

    A relative path is looked for first in the folder of the file that it stands in.

    Attributes:
        digest: key beside it that holds the file's SHA-256. Where another file is named it is left
            out.
    """

    digest: str


def marks_of(table: type[BaseModel], kind: type[_Mark]) -> dict[str, _Mark]:
    """Marks of a kind, such as ``Unit``, in the annotations of the keys that have one."""
    return {
        key: mark
        for key, info in table.model_fields.items()
        for mark in info.metadata
        if isinstance(mark, kind)
    }


def symbol_of(table: type[BaseModel], key: str) -> str:
    """Unit of a key; empty where it has none."""
    unit = marks_of(table, Unit).get(key)
    if unit is not None:
        return unit.symbol
    field = table.model_fields.get(key)
    extra = None if field is None else field.json_schema_extra
    if isinstance(extra, dict) and "unit" in extra:  # a robot's parameter
        return str(extra["unit"])
    return "deg" if key.endswith("_deg") else ""


@cache  # parsing the source of all tables takes some tenths of a second
def meanings_of(table: type[BaseModel]) -> Mapping[str, str]:
    """Meanings of the keys of a table: their own descriptions, or the strings below them in its
    class or its bases.

    They are read from the source on demand, so that classes are created without that cost.
    """
    meanings: dict[str, str] = {}
    # From the root of the hierarchy down, so that a class that says a meaning anew has the last
    # word.
    for base in reversed(table.__mro__):
        if base is BaseModel or not issubclass(base, BaseModel):
            continue
        try:
            source = textwrap.dedent(inspect.getsource(base))
        except (OSError, TypeError):
            continue  # made while running: nothing is said there
        body = next(item for item in ast.parse(source).body if isinstance(item, ast.ClassDef)).body
        for key, below in pairwise(body):
            if isinstance(key, ast.AnnAssign) and isinstance(below, ast.Expr):
                text = getattr(below.value, "value", None)
                if isinstance(key.target, ast.Name) and isinstance(text, str):
                    meanings[key.target.id] = " ".join(text.split())
    meanings |= {
        key: info.description for key, info in table.model_fields.items() if info.description
    }
    return {key: meanings[key] for key in table.model_fields if key in meanings}


def _has_a_direction(axis: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*axis) == 0:
        raise ValueError("has no direction; give one such as [0, 0, 1]")
    return axis


Direction = Annotated[tuple[float, float, float], AfterValidator(_has_a_direction)]
"""A vector whose length means nothing, world frame."""
Positive = Annotated[float, Field(gt=0)]
Part = Annotated[float, Field(ge=1e-6, le=1e6)]
"""A figure counted in something of about its own size, such as a bore, a second or a ratio."""
NotNegative = Annotated[float, Field(ge=0, le=1e6)]
"""The same where it may be zero, too."""
Angle = Annotated[float, Field(ge=-3600, le=3600)]
"""An angle in degrees, up to ten turns either way."""
Size = Annotated[float, Field(ge=1e-5, le=1000)]
"""A length of a pipe, m. The limits catch millimetres and keep the samples of a route in memory."""


def model_of(annotation: Any, value: Any) -> type[BaseModel] | None:
    """Return the model of the table at a place of type ``annotation`` that holds plain data
    ``value``; None where no table belongs."""
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
    """Type of the value below ``key`` at a place; None where it is unknown."""
    model = model_of(annotation, value)
    if model is not None:
        info = model.model_fields.get(key)
        return None if info is None else info.annotation
    bare = _bare(annotation)
    arguments = get_args(bare)
    return arguments[0] if get_origin(bare) is tuple and arguments else None


def index_of(items: Sequence[Any], key: str) -> int | None:
    """Index that a key of a dotted path means in a list; None where there is no such item."""
    # int() alone would take "+1", "1_0" and digits of other scripts, and be slow on huge ones.
    index = int(key) if key.isascii() and key.isdecimal() and len(key) < 10 else len(items)
    return index if index < len(items) and str(index) == key else None


def inside(value: Any, key: str) -> Any:
    """Value below ``key`` in a table or list; None where there is none."""
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
    """Default of ``key`` in a table as plain data; an empty table where there is no default."""
    model = model_of(annotation, value)
    info = None if model is None else model.model_fields.get(key)
    default = None if info is None else info.get_default(call_default_factory=True)
    return {} if default in (None, PydanticUndefined) else to_jsonable_python(default)


def _bare(annotation: Any) -> Any:
    """Strip a type of its metadata and of None."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif get_origin(annotation) in (Union, UnionType):
            kinds = [kind for kind in get_args(annotation) if kind is not NoneType]
            # A union of several types has no keys of its own that could be offered as choices.
            annotation = kinds[0] if len(kinds) == 1 else object
        else:
            return annotation
