"""Tables of keys that are made from the models of a scenario, which say each key once."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from omnitrack_sim.base.table import meanings_of, symbol_of
from omnitrack_sim.paper.open_loop import PaperTable
from omnitrack_sim.robots.omnitrack.control.driven import DrivenTable
from omnitrack_sim.robots.omnitrack.control.jacobian import FeedbackTable
from omnitrack_sim.robots.omnitrack.policy.controller import PolicyTable
from omnitrack_sim.robots.tail import Tether
from omnitrack_sim.senses.settings import SensingTable

MARK = re.compile(r"^<!-- keys: (.+) -->$", re.MULTILINE)


def subtables(name: str, model: BaseModel) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the name and type of each table within a table."""
    for key, value in model:
        if isinstance(value, BaseModel):
            yield f"{name}.{key}", type(value)


MODELS: dict[str, type[BaseModel]] = {
    **dict(subtables("control.parameters", FeedbackTable())),
    **dict(subtables("sensing", SensingTable())),
    "robot.tether": Tether,
    "paper": PaperTable,
    "driven": DrivenTable,
    "policy": PolicyTable,
}
"""Models by the names that pages have for their tables."""


def table_of_keys(model: type[BaseModel]) -> str:
    """Return a table of the keys of a model, with defaults, units and meanings; subtables apart."""
    meanings = meanings_of(model)
    lines = ["| key | default | unit | meaning |", "|---|---|---|---|"]
    for key, info in model.model_fields.items():
        default = info.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            continue
        absent = default is None or default is PydanticUndefined
        value = "" if absent else json.dumps(default)
        lines.append(f"| `{key}` | {value} | {symbol_of(model, key)} | {meanings[key]} |")
    return "\n".join(lines)


def with_tables(text: str) -> str:
    """Return a page with the table of keys in the place of each mark."""
    return MARK.sub(lambda match: table_of_keys(MODELS[match[1]]), text)
