"""How docstrings and signatures are shown in the reference."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.domains.python import PyClasslike

from omnitrack_sim.base.table import meanings_of, symbol_of
from omnitrack_sim.robots.quantity import QuantityModel, quantity_of

_PAGE = re.compile(r"(?<![`\w/])docs/(?:[\w-]+/)?([\w-]+)\.md")
_CODE = re.compile(r"(?<!`)`([^`]+)`(?!`)")
BEFORE_NAPOLEON = 400
"""Sphinx calls with lower numbers first; napoleon, which reads the sections, has 500."""
HIDDEN_COLON = "\ue000"
"""Stands for a colon that napoleon is not to see; no docstring has it."""


def _is_table(thing: Any) -> bool:
    return isinstance(thing, type) and issubclass(thing, BaseModel)


def _shorten(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str, returns: str
) -> tuple[str | None, str | None] | None:
    """A table of a file is made from its keys, which stand below. A default that is made anew for
    each object has no form that can be read as Python."""
    if what == "class" and _is_table(thing):
        return "(**keys)", returns
    return (signature or "").replace("<factory>", "...") or None, returns


def _prepare(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Add the keys of a table. Keep the sentence of a property whole: napoleon takes what stands
    before a colon in its first line for a type."""
    if what == "class" and _is_table(thing):
        lines += ["", "Keys:", "", *_keys(thing)]
    if what == "property":
        lines[:1] = [line.replace(":", HIDDEN_COLON) for line in lines[:1]]


def _keys(table: type[BaseModel]) -> Iterator[str]:
    """The keys of a table with unit and meaning, as a list."""
    said = meanings_of(table)
    for key, info in table.model_fields.items():
        default = info.get_default(call_default_factory=True)
        if issubclass(table, QuantityModel):
            quantity = quantity_of(table, key)
            unit, meaning = quantity.unit, f"{quantity.source} ({quantity.provenance})"
        elif isinstance(default, BaseModel) and key not in said:
            unit, meaning = "", (type(default).__doc__ or "").partition("\n\n")[0]
        else:
            unit, meaning = symbol_of(table, key), said.get(key, "")
        unit = "" if unit in ("", "1") else f" ({unit})"
        text = _CODE.sub(r"``\1``", " ".join(meaning.replace("``", "`").split()))
        yield f"* **{key}**{unit}{': ' if text else ''}{text}"


def _link(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Turn the pages that a docstring names into links, and show what was hidden."""
    shown = (line.replace(HIDDEN_COLON, ":") for line in lines)
    lines[:] = [_PAGE.sub(r":doc:`docs/\1.md <\1>`", line) for line in shown]


def setup(app: Sphinx) -> dict[str, bool]:
    """Mend them while autodoc reads them."""
    for field in PyClasslike.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    app.connect("autodoc-process-signature", _shorten)
    app.connect("autodoc-process-docstring", _prepare, priority=BEFORE_NAPOLEON)
    app.connect("autodoc-process-docstring", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
