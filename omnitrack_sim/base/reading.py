"""From the plain data of a file to a model, checked as a whole; faults are told with their place
in the file."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.text import shown

NAME_PATTERN = r"^[^./\\\x00-\x1f\x7f-\x9f][^/\\\x00-\x1f\x7f-\x9f]*$"
"""A scenario's name is also that of a folder: not empty, not hidden, no separators."""
LARGEST_INTEGER = 2**63 - 1
"""What TOML promises and other readers of JSON take."""
KIND_FAULT = "kind"
"""Type of pydantic's error where the ``kind`` of a table is missing or names nothing."""
MOST_LEVELS = 32
"""How deep tables and lists may stand in each other."""
_Model = TypeVar("_Model", bound=BaseModel)


def checked(
    model: type[_Model],
    data: Mapping[str, Any],
    union: str,
    fault: Callable[[Any], Fault],
    error: type[InputError],
) -> _Model:
    """A model from plain data, as read from TOML or JSON.

    Args:
        model: class of the model.
        data: contents of the file.
        union: key of the list whose tables have a ``kind``.
        fault: turns one of pydantic's errors into a fault.
        error: exception class to raise for faults.

    Raises:
        InputError: of class ``error``, with every fault.
    """
    data, odd = _tidied(data)
    try:
        # From JSON, pydantic's strict mode takes lists for tuples and names for enums, but no
        # "0.5" for 0.5.
        found = model.model_validate_json(json.dumps(data, default=plain_value), strict=True)
    except ValidationError as reason:
        items = reason.errors(include_url=False)
        # pydantic does not count a table with a fault as an item, and then calls the list too
        # short, too.
        inside = any(item["loc"][:1] == (union,) and len(item["loc"]) > 1 for item in items)
        faults = [fault(item) for item in items if not (inside and item["type"] == "too_short")]
        places = {one.where for one in odd}
        faults = [one for one in dict.fromkeys(faults) if one.where not in places]
        raise error([*odd, *faults]) from None
    if odd:
        raise error(odd)
    return found


def _tidied(data: Any) -> tuple[Any, list[Fault]]:
    """Plain data without values that no file of ours can hold, and these as faults."""
    faults: list[Fault] = []

    def tidy(value: Any, place: tuple[str, ...]) -> Any:
        problem = _oddity(value, len(place))
        if problem is not None:
            faults.append(Fault(".".join(place), problem))
            return None
        if isinstance(value, Mapping):
            return {_key(key): tidy(item, (*place, _key(key))) for key, item in value.items()}
        if isinstance(value, list | tuple):
            return [tidy(item, (*place, str(i))) for i, item in enumerate(value)]
        return value

    return tidy(data, ()), faults


def _oddity(value: Any, depth: int) -> str | None:
    """What is wrong with a value whatever its place; None for all that is common."""
    if isinstance(value, str) and not _is_text(value):
        return f"is {shown(value)}, which has bytes or halves of characters that are no text"
    if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        return "is an integer of more than 64 bits"
    if isinstance(value, datetime.date | datetime.time):
        return f"is the date or time {value}; a text stands in quotes"
    if isinstance(value, Mapping | list | tuple) and depth > MOST_LEVELS:
        return f"is nested too deeply: at most {MOST_LEVELS} levels of tables and lists"
    return None


def _is_text(text: str) -> bool:
    """Whether a text is without lone surrogates, in which nothing can be written."""
    return text.isascii() or not any("\ud800" <= character <= "\udfff" for character in text)


def _key(key: Any) -> str:
    """A key of a table as text that can be written."""
    return str(key).encode("utf-8", "backslashreplace").decode()


def plain_value(value: Any) -> Any:
    """A plain form of a value that JSON does not know.

    Models become tables, NumPy values numbers and lists, everything else text.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


def fault_of(
    item: Mapping[str, Any],
    union: str,
    kinds: tuple[str, ...],
    choices_at: Callable[[list[str]], tuple[str, ...]],
) -> Fault:
    """One of pydantic's errors as a fault, with the path in the file and the valid choices.

    Args:
        item: of ``ValidationError.errors()``.
        union: key of the list whose tables have a ``kind``.
        kinds: valid kinds.
        choices_at: gives the valid keys of the table at a pydantic path.
    """
    places = [str(p) for p in item["loc"]]
    # pydantic puts the kind of a table into the path. The file has no such level.
    where = ".".join(
        p for i, p in enumerate(places) if not (i == 2 and places[0] == union and p in kinds)
    )
    kind, context = item["type"], item.get("ctx", {})
    if kind == "extra_forbidden":
        return Fault(where, "unknown key", choices_at(places[:-1]), given=places[-1])
    if kind == "union_tag_invalid":
        tag = str(context["tag"])
        return Fault(f"{where}.kind", f"is {tag!r}", tuple(sorted(kinds)), given=tag)
    if kind == "union_tag_not_found":
        return Fault(f"{where}.kind", "is missing", tuple(sorted(kinds)))
    if kind == KIND_FAULT:
        choices, given = tuple(context["choices"]), str(context["given"])
        return Fault(f"{where}.kind", context["problem"], choices, given)
    if kind in ("literal_error", "enum"):
        choices = tuple(
            part.strip(" '") for part in str(context["expected"]).replace(" or ", ",").split(",")
        )
        given = item["input"]
        return Fault(where, f"is {shown(given)}", choices, given if isinstance(given, str) else "")
    if kind == "string_pattern_mismatch":
        rule = (
            "it names a folder, so it must not be empty, begin with a dot, or hold a slash, a "
            "backslash or a control character"
        )
        return Fault(where, f"is {shown(item['input'])}; {rule}")
    if kind in ("too_long", "too_short"):
        bound = "most" if kind == "too_long" else "least"
        limit = context["max_length" if kind == "too_long" else "min_length"]
        items = "item" if limit == 1 else "items"
        return Fault(where, f"must have at {bound} {limit} {items}, not {context['actual_length']}")
    if kind in ("list_type", "tuple_type") and isinstance(item["input"], dict):
        told = "is a table; it must be a list"
        told += "" if "." in where else f" of tables, each of which begins with [[{where}]] in TOML"
        return Fault(where, told)
    message = _in_words_of_files(item["msg"])
    given = (
        ""
        if isinstance(item["input"], dict) or kind == "missing"
        else f" (given: {shown(item['input'])})"
    )
    return Fault(where, message[0].lower() + message[1:] + given)


def _in_words_of_files(message: str) -> str:
    """A message of pydantic's without words that no file has."""
    message = message.removeprefix("Value error, ")
    for pydantics, ours in (
        ("valid tuple", "list"),
        ("valid array", "list"),
        ("an object", "a table"),
        ("Tuple", "List"),
    ):
        message = message.replace(pydantics, ours)
    return message
