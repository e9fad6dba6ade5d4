"""Tables of a user's file: base class, units and meanings of keys."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError


class Table(BaseModel):
    """Frozen table of a file; unknown keys are errors.

    The string below a key states its meaning; see ``meanings_of``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def model_for(cls, value: Mapping[str, Any]) -> type[Table]:  # noqa: ARG003 - default
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
        values: keys beside it that hold values of the file, and are left out as well.
    """

    digest: str
    values: tuple[str, ...] = ()


@dataclass(frozen=True)
class ObjectName:
    """Mark, in the annotation of a key, that it may name an object of a user's own."""


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
    """Meanings of the keys of a table.

    Their own descriptions, or the strings below them in its class or its bases.

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
