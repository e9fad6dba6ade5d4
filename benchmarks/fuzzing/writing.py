"""Plain data, with odd values in it, as the text of a TOML or JSON file."""

from __future__ import annotations

import json
import re
from typing import Any

from fuzzing.values import Raw


def toml(data: dict[str, Any]) -> str:
    """As TOML: tables with heads, lists of tables with double brackets, all else in one line."""
    return "\n".join(_table(data, "")) + "\n"


def _table(data: dict[str, Any], path: str) -> list[str]:
    own, below = [], []
    for key, value in data.items():
        place = f"{path}.{_key(key)}" if path else _key(key)
        if isinstance(value, dict):
            below += ["", f"[{place}]", *_table(value, place)]
        elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
            for item in value:
                below += ["", f"[[{place}]]", *_table(item, place)]
        elif value is not None:
            own.append(f"{_key(key)} = {_value(value)}")
    return own + below


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _text(key)


def _value(value: Any) -> str:
    if isinstance(value, Raw):
        return value.text
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, dict):
        pairs = (f"{_key(k)} = {_value(v)}" for k, v in value.items() if v is not None)
        return "{" + ", ".join(pairs) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in value if item is not None) + "]"
    if isinstance(value, float):
        return repr(value)  # nan and inf as TOML writes them, too
    return json.dumps(value, default=str)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def as_json(data: dict[str, Any]) -> str:
    """As JSON; what is raw stands where its mark stood."""
    raw: list[str] = []

    def marked(value: Any) -> str:
        raw.append(value.text if isinstance(value, Raw) else json.dumps(str(value)))
        return f"\x01{len(raw) - 1}\x01"

    text = json.dumps(data, default=marked, indent=1)
    return re.sub(r'"\\u0001(\d+)\\u0001"', lambda found: raw[int(found[1])], text)
