"""Text for people, safe for a terminal, and JSON and TOML for machines."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from itertools import accumulate
from typing import Any

MAX_COMPARED = 2000
"""Number of choices that are compared with a misspelt name; each takes some 20 us."""
_MAX_WORD = 100
_NEAR_PART = 4
"""Letters from which on a word is compared with parts of names; a shorter one has to be a part."""
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxdict, _SHORT.maxlist, _SHORT.maxtuple = 3, 4, 8, 8
_SHORT.maxstring = _SHORT.maxother = 80


def printable(text: str) -> str:
    """Escape everything in ``text`` that is no visible character or blank.

    A terminal then obeys nothing in it: no escape sequence, line feed or mark that changes the
    direction of writing.
    """
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


FORMULA = r"^[=+\-@\t\r]"
"""Beginning of a text that a spreadsheet takes for a formula, and runs."""
NUMBER = r"^[+\-]?(\d+\.?\d*|\.\d+)([eE][+\-]?\d+)?$"
"""A number as text, which may begin like one."""


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Return rows as CSV; missing values are empty, and numbers read back exactly.

    A text that a spreadsheet would take for a formula begins with an apostrophe: names come from
    whoever made the file.
    """
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    for row in rows:
        writer.writerow([_inert(cell) if isinstance(cell, str) else cell for cell in row])
    return file.getvalue()


def _inert(text: str) -> str:
    is_formula = re.match(FORMULA, text) and not re.match(NUMBER, text)
    return f"'{text}" if is_formula else text


def installing(extra: str) -> str:
    """Return the command that installs an extra of this package, which no index has."""
    return f"pip install 'omnitrack_sim[{extra}]', or in a checkout of it pip install '.[{extra}]'"


def counted(count: int, one: str, more: str = "") -> str:
    """Count of things in words: "1 batch", "2 batches"; the plural ``more`` defaults to an s."""
    return f"{count} {one if count == 1 else more or f'{one}s'}"


def clipped(text: str, length: int) -> str:
    """Shorten ``text`` to its first ``length`` characters, and say how many there are."""
    return text if len(text) <= length else f"{text[:length]}... ({len(text)} characters)"


def shown(value: Any) -> str:
    """Abbreviated ``repr`` of a value."""
    return _SHORT.repr(value)


def listed(names: Sequence[str], length: int = 1000) -> str:
    """Join names with commas: as many as fit into ``length`` characters, at least one."""
    ends = accumulate(len(name) + 2 for name in names)
    count = max(1, sum(end - 2 <= length for end in ends))
    rest = max(0, len(names) - count)
    text = ", ".join(clipped(name, length) for name in names[:count])
    return f"{text} and {rest} more" if rest else text


def nearest(given: str, choices: Sequence[str]) -> str | None:
    """Choice that ``given`` is probably a misspelling of; None where none is near.

    If no whole name is near, a name counts of which a part between ``_``, ``/`` or dots is.
    """
    given = given[:_MAX_WORD].lower()
    known = {one.lower(): one for one in choices[:MAX_COMPARED] if len(one) < _MAX_WORD}
    for match in get_close_matches(given, known, n=1):
        return known[match]
    parts: dict[str, str] = {}
    for low, one in known.items():
        for part in re.split(r"[_/.]", low):
            # The first name with a part wins: choices come in the order in which they are listed to
            # users.
            parts.setdefault(part, one)
    # Short words are near to parts of many names that have nothing to do with them.
    cutoff = 0.75 if len(given) >= _NEAR_PART else 1.0
    for match in get_close_matches(given, parts, n=1, cutoff=cutoff):
        return parts[match]
    return None


def did_you_mean(given: str, choices: Sequence[str]) -> str:
    """Question for the nearest choice, with a semicolon before it; empty where none is near."""
    choice = nearest(given, choices) if given else None
    return "" if choice is None else f"; did you mean {choice!r}?"


def no_such(name: object, choices: Sequence[str], what: str = "") -> str:
    """Message for a name that is none of the choices; ``what`` is a word before it."""
    question = did_you_mean(str(name), choices)
    return f"there is no {what}{shown(name)}{question} (choose from: {listed(choices)})"


def toml_key(name: str) -> str:
    """Name as a key of TOML, in quotes where it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else as_toml(name)


def as_toml(value: Any) -> str:
    """Plain data as a value of TOML in one line: a text, number, truth value, list or table."""
    if isinstance(value, Mapping):
        inside = ", ".join(f"{toml_key(key)} = {as_toml(item)}" for key, item in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_toml, value))}]"
    # JSON's texts are TOML's but for one character.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def strict_json(value: Any) -> str:
    """``value`` as strict JSON: NaN and infinity become null."""
    return json.dumps(finite(value), indent=2, allow_nan=False)


def finite(value: Any) -> Any:
    """Replace NaN and infinity in ``value`` (the figures of a diverged run) by None."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
