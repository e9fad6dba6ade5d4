"""Text for people, whatever stands in it, and JSON for machines."""

from __future__ import annotations

import json
import math
import re
import reprlib
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any

MOST_COMPARED = 2000
"""Among how many choices a near one is looked for; each takes some 20 us."""
_LONGEST_WORD = 100
_NEAR_PART = 4
"""Letters from which on a word is compared with parts of names; a shorter one has to be a part."""
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxdict, _SHORT.maxlist, _SHORT.maxtuple = 3, 4, 8, 8
_SHORT.maxstring = _SHORT.maxother = 80


def printable(text: str) -> str:
    """``text`` in which everything that is no visible character or blank stands as an escape.

    A terminal then shows it, and obeys nothing in it: no escape sequence, line feed or mark that
    turns the direction of writing.
    """
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode()
        for character in text
    )


def counted(count: int, one: str, more: str = "") -> str:
    """A number of things in words: "1 batch", "2 batches"; ``more`` when not given is ``one`` and
    an s."""
    return f"{count} {one if count == 1 else more or f'{one}s'}"


def clipped(text: str, most: int) -> str:
    """``text``, or its first ``most`` characters and how many there are."""
    return text if len(text) <= most else f"{text[:most]}... ({len(text)} characters)"


def shown(value: Any) -> str:
    """A value as Python writes it, with the inside of what is long left out."""
    return _SHORT.repr(value)


def listed(names: Sequence[str], most: int = 1000) -> str:
    """Names with commas between them: as many as fit into ``most`` characters, at least one."""
    length, count = 0, 0
    while count < len(names) and (count == 0 or length + len(names[count]) <= most):
        length += len(names[count]) + 2
        count += 1
    rest = len(names) - count
    text = ", ".join(clipped(name, most) for name in names[:count])
    return f"{text} and {rest} more" if rest else text


def nearest(given: str, choices: Sequence[str]) -> str | None:
    """The choice that ``given`` may have been meant for. If no whole name is near, one of which a
    part between ``_``, ``/`` or dots is; None where there is none."""
    given = given[:_LONGEST_WORD].lower()
    known = {one.lower(): one for one in choices[:MOST_COMPARED] if len(one) < _LONGEST_WORD}
    for found in get_close_matches(given, known, n=1):
        return known[found]
    parts: dict[str, str] = {}
    for low, one in known.items():
        for part in re.split(r"[_/.]", low):
            parts.setdefault(part, one)
    # Short words are near to parts of many names that have nothing to do with them.
    cutoff = 0.75 if len(given) >= _NEAR_PART else 1.0
    for found in get_close_matches(given, parts, n=1, cutoff=cutoff):
        return parts[found]
    return None


def did_you_mean(given: str, choices: Sequence[str]) -> str:
    """The question after a name that is none of the choices, with a semicolon before it; empty
    where nothing is near."""
    found = nearest(given, choices) if given else None
    return "" if found is None else f"; did you mean {found!r}?"


def no_such(name: object, choices: Sequence[str], what: str = "") -> str:
    """What to say of a name that none of the choices is; ``what`` is a word before it."""
    question = did_you_mean(str(name), choices)
    return f"there is no {what}{shown(name)}{question} (choose from: {listed(choices)})"


def toml_key(name: str) -> str:
    """A name as a key of TOML, in quotes where it needs them."""
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
    """``value`` as JSON that every reader takes: numbers that are none become null."""
    return json.dumps(finite(value), indent=2, allow_nan=False)


def finite(value: Any) -> Any:
    """``value`` with None for numbers that JSON cannot hold (the figures of a diverged run)."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
