"""The pages of the reference: every public name of the package, by the room that it lives in."""

from __future__ import annotations

import ast
import inspect
import re
from itertools import pairwise
from pathlib import Path
from types import FunctionType
from typing import Any

from pydantic import BaseModel

import omnitrack_sim as ot

TITLES = {
    "scenario": "Scenarios",
    "sim": "Simulation",
    "results": "Results",
    "record": "Channels, metrics and events",
    "trials": "Sweeps and studies",
    "show": "Figures, films and replay pages",
    "pipes": "Pipes and networks",
    "robots": "Robot and controllers",
    "senses": "Sensors",
    "autonomy": "Autonomy",
    "paper": "Theory",
    "base": "Errors and shipped files",
}
"""Rooms by their titles, in the order of the pages; a further room stands behind, by its name."""
_NAME = re.compile(r"^from \.(\S+) import \w+ as (\w+)$", re.MULTILINE)


def homes() -> dict[str, str]:
    """Public names with the modules that define them, as the stub of the package lists them."""
    stub = Path(str(ot.__file__)).with_suffix(".pyi").read_text(encoding="utf-8")
    return {name: module for module, name in _NAME.findall(stub)}


def rooms() -> dict[str, list[str]]:
    """Public names by the room that defines them."""
    names: dict[str, list[str]] = {room: [] for room in TITLES}
    for name, module in homes().items():
        names.setdefault(module.partition(".")[0], []).append(name)
    return {room: sorted(own, key=str.lower) for room, own in names.items() if own}


def write_reference(target: Path) -> None:
    """Write ``api.md`` and one page for each room."""
    lists, children = [], []
    for room, names in rooms().items():
        title = f"{TITLES.get(room, room.capitalize())} (Python)"
        links = ", ".join(f"{{py:obj}}`{name} <omnitrack_sim.{name}>`" for name in names)
        lists.append(f"| [{title}](api-{room}.md) | {links} |")
        children.append(f"api-{room}")
        directives = "\n".join(_directive(name) for name in names)
        page = f"# {title}\n\n```{{eval-rst}}\n{directives}```\n"
        (target / f"api-{room}.md").write_text(page, encoding="utf-8")
    (target / "api.md").write_text(_HEAD + "\n".join(lists) + _tail(children), encoding="utf-8")


_HEAD = """# Python names

The public names of `omnitrack_sim`. Units are SI and angles radians, unless a name ends in `_deg`.

```python
import omnitrack_sim as ot
```

| | names |
|---|---|
"""


def _tail(children: list[str]) -> str:
    listed = "\n".join(children)
    return f"\n\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def _directive(name: str) -> str:
    """How Sphinx is told to document a public name."""
    thing = getattr(ot, name)
    if inspect.isclass(thing):
        members = ", ".join(members_of(thing))
        chosen = f"   :members: {members}\n" if members else ""
        return f".. autoclass:: omnitrack_sim.{name}\n{chosen}"
    if isinstance(thing, FunctionType):
        return f".. autofunction:: omnitrack_sim.{name}\n"
    text = "\n   ".join(inspect.cleandoc(doc_of_value(name) or "").splitlines())
    return f".. py:data:: {name}\n   :module: omnitrack_sim\n\n   {text}\n"


def members_of(thing: type) -> list[str]:
    """The public methods and properties of a class that this package defines, in its order."""
    found: dict[str, None] = {}
    for base in reversed(thing.__mro__):
        if base.__module__.partition(".")[0] != "omnitrack_sim":
            continue
        validators = getattr(base, "__pydantic_decorators__", None)
        for name, value in vars(base).items():
            if name.startswith("_") or (validators and name in validators.field_validators):
                continue
            if isinstance(value, FunctionType | classmethod | staticmethod) or hasattr(
                value, "__get__"
            ):
                found[name] = None
    fields = thing.model_fields if issubclass(thing, BaseModel) else {}
    return [name for name in found if name not in fields and _is_callable_or_property(thing, name)]


def _is_callable_or_property(thing: type, name: str) -> bool:
    value = inspect.getattr_static(thing, name)
    kinds = FunctionType | classmethod | staticmethod | property
    return isinstance(value, kinds) or type(value).__name__ == "cached_property"


def undocumented() -> list[str]:
    """Public names, and public members of classes, without a docstring of their own."""
    missing = []
    for name in ot.__all__:
        thing = getattr(ot, name)
        if not inspect.isclass(thing):
            own = thing.__doc__ if isinstance(thing, FunctionType) else doc_of_value(name)
            missing += [] if own else [name]
            continue
        missing += [] if vars(thing).get("__doc__") else [name]
        missing += [
            f"{name}.{member}"
            for member in members_of(thing)
            if not inspect.getdoc(getattr(thing, member))
        ]
    return missing


def doc_of_value(name: str) -> str | None:
    """The text below the assignment of a public value, in the room that it comes from."""
    module = Path(str(ot.__file__)).parent / homes().get(name, "").replace(".", "/")
    file = module.with_suffix(".py")
    for path in sorted(module.glob("*.py")) if module.is_dir() else [file] * file.is_file():
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for statement, below in pairwise(body):
            if _assigned(statement) == name and isinstance(below, ast.Expr):
                value: Any = below.value
                return value.value if isinstance(value, ast.Constant) else None
    return None


def _assigned(statement: ast.stmt) -> str | None:
    target = None
    if isinstance(statement, ast.AnnAssign):
        target = statement.target
    elif isinstance(statement, ast.Assign):
        target = statement.targets[0]
    return target.id if isinstance(target, ast.Name) else None
