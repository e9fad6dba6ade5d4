"""How docstrings and signatures are shown in the reference."""

from __future__ import annotations

import re
from typing import Any

from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.domains.python import PyClasslike

_PAGE = re.compile(r"(?<![`\w/])docs/([\w-]+)\.md")


def _shorten(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str, returns: str
) -> tuple[str | None, str | None] | None:
    """A table of a file is made from its keys, which its page lists. A default that is made anew
    for each object has no form that can be read as Python."""
    if what == "class" and isinstance(thing, type) and issubclass(thing, BaseModel):
        return "(**keys)", returns
    return (signature or "").replace("<factory>", "...") or None, returns


def _link(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Turn the pages that a docstring names into links."""
    lines[:] = [_PAGE.sub(r":doc:`docs/\1.md <\1>`", line) for line in lines]


def setup(app: Sphinx) -> dict[str, bool]:
    """Mend them while autodoc reads them."""
    for field in PyClasslike.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    app.connect("autodoc-process-signature", _shorten)
    app.connect("autodoc-process-docstring", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
