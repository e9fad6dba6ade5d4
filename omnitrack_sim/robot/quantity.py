"""Unit, provenance and source of a parameter, and the table of a model's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel
from pydantic.fields import FieldInfo

Provenance = Literal["published", "derived", "inferred", "assumed", "numerical"]


@dataclass(frozen=True)
class Quantity:
    """Unit, provenance and source of one parameter; stands in the field's annotation."""

    unit: str
    provenance: Provenance
    source: str


@dataclass(frozen=True)
class Parameter:
    """One row of the parameter table; ``name`` is the dotted path below the model."""

    name: str
    value: Any
    unit: str
    provenance: Provenance
    source: str


def quantity_of(info: FieldInfo) -> Quantity:
    """The ``Quantity`` in the annotation of a field."""
    return next(item for item in info.metadata if isinstance(item, Quantity))


def parameter_rows(model: BaseModel, prefix: str = "") -> list[Parameter]:
    """Every field of ``model``, and of the models in it, with value, unit, provenance and source.

    Args:
        model: all of its fields have a ``Quantity``.
        prefix: stands before every name, such as "motor.".
    """
    rows: list[Parameter] = []
    for name, info in type(model).model_fields.items():
        value, quantity = getattr(model, name), quantity_of(info)
        if isinstance(value, BaseModel):
            rows += parameter_rows(value, f"{prefix}{name}.")
        else:
            rows.append(Parameter(prefix + name, value, **vars(quantity)))
    return rows
