"""Reading files that a user writes: scenarios, sweeps and networks.

They are found by path or name, read as TOML and checked as a whole; faults are told with their
place in the file.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from omnitrack_sim.errors import Fault, InputError
from omnitrack_sim.schema.fittings import KIND_FAULT

NAME_PATTERN = r"^[^./\\\x00-\x1f][^/\\\x00-\x1f]*$"
"""A scenario's name is also that of a folder: not empty, not hidden, no separators."""
_Model = TypeVar("_Model", bound=BaseModel)


def read_toml(
    source: str | Path, what: str, shipped: Mapping[str, Path], error: type[InputError]
) -> tuple[Path, dict[str, Any]]:
    """Path and contents of a file that is given by its path or by the name of a shipped one.

    If the file has no ``name``, its own name without the ending is used.

    Args:
        source: path of the file, or a name.
        what: noun for the thing being read, used in messages ("scenario", "network").
        shipped: paths of the shipped files by name.
        error: exception class to raise for faults.

    Raises:
        InputError: of class ``error``: there is no such file, it cannot be read, or it is no TOML.
    """
    path = Path(source)
    if not path.is_file():
        if str(source) not in shipped:
            problem = (
                f"is a folder, not a {what} file"
                if path.is_dir()
                else f"no such file, nor a shipped {what} of that name"
            )
            raise error(Fault(str(source), problem, tuple(shipped)))
        path = shipped[str(source)]
    try:
        return path, {"name": path.stem} | tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as reason:
        raise error(Fault(str(path), f"is not valid TOML: {reason}")) from reason
    except OSError as reason:
        raise error(Fault(str(path), f"cannot be read: {reason.strerror}")) from reason


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
    try:
        # From JSON, pydantic's strict mode takes lists for tuples and names for enums, but no
        # "0.5" for 0.5.
        return model.model_validate_json(json.dumps(data, default=plain_value), strict=True)
    except ValidationError as reason:
        items = reason.errors()
        # pydantic does not count a table with a fault as an item, and then calls the list too
        # short, too.
        inside = any(item["loc"][:1] == (union,) and len(item["loc"]) > 1 for item in items)
        raise error(
            [fault(item) for item in items if not (inside and item["type"] == "too_short")]
        ) from None


def fields_at(model: type[BaseModel], places: list[str]) -> tuple[str, ...]:
    """Names of the fields of the table at a path below a model; none if there is no table."""
    for place in places:
        info = model.model_fields.get(place)
        inner = None if info is None else info.annotation
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return ()
        model = inner
    return tuple(model.model_fields)


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
        return Fault(where, "unknown key", choices_at(places[:-1]))
    if kind == "union_tag_invalid":
        return Fault(f"{where}.kind", f"is {context['tag']!r}", tuple(sorted(kinds)))
    if kind == "union_tag_not_found":
        return Fault(f"{where}.kind", "is missing", tuple(sorted(kinds)))
    if kind == KIND_FAULT:
        return Fault(f"{where}.kind", context["problem"], tuple(context["choices"]))
    if kind in ("literal_error", "enum"):
        choices = tuple(
            part.strip(" '") for part in str(context["expected"]).replace(" or ", ",").split(",")
        )
        return Fault(where, f"is {item['input']!r}", choices)
    if kind == "string_pattern_mismatch":
        return Fault(
            where,
            f"is {item['input']!r}; it names a folder: not empty, no leading dot, no separators",
        )
    message = _in_words_of_files(item["msg"])
    given = (
        ""
        if isinstance(item["input"], dict) or kind == "missing"
        else f" (given: {item['input']!r})"
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


def _scenario_folder() -> Path:
    """Where the shipped scenarios are: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "_scenarios"
    return inside if inside.is_dir() else package.parent / "scenarios"


def shipped_scenarios() -> dict[str, Path]:
    """Scenarios that come with the package, by name.

    The name is the file's path below ``scenarios/`` without its ending.
    """
    folder = _scenario_folder()
    groups = ("*.toml", "paper/*.toml", "missions/*.toml")
    files = [path for group in groups for path in sorted(folder.glob(group))]
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in files}


def shipped_sweeps() -> dict[str, Path]:
    """Sweep files that come with the package, by name."""
    return {path.stem: path for path in sorted((_scenario_folder() / "sweeps").glob("*.toml"))}


def shipped_studies() -> dict[str, Path]:
    """Study files that come with the package, by name."""
    return {path.stem: path for path in sorted((_scenario_folder() / "studies").glob("*.toml"))}


def shipped_networks() -> dict[str, Path]:
    """Network files that come with the package, by name."""
    return {path.stem: path for path in sorted((_scenario_folder() / "networks").glob("*.toml"))}
