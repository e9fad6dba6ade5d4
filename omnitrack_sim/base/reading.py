"""Files that a user writes: located, read as TOML or JSON, and validated by a model.

All faults of a file are reported at once, each with its place in the file.
"""

from __future__ import annotations

import datetime
import json
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import PydanticCustomError

from omnitrack_sim.base.errors import Fault, InputError
from omnitrack_sim.base.naming import ShippedKind, look_beside, shipped_files
from omnitrack_sim.base.paths import Document
from omnitrack_sim.base.text import nearest, shown

NAME_PATTERN = r"^[^./\\\x00-\x1f\x7f-\x9f][^/\\\x00-\x1f\x7f-\x9f]*$"
"""A scenario's name is also that of a folder: not empty, not hidden, no separators."""
MAX_INTEGER = 2**63 - 1
"""Largest integer that TOML guarantees and other readers of JSON accept."""
KIND_FAULT, PLACE_FAULT = "kind", "place"
"""Types of pydantic's error where the ``kind`` of a table is missing or names nothing, and where
something below a key is wrong."""
CALIBRATION = "calibration"
"""Table of a calibration's file that holds all but the values, which ``--set`` passes over."""
MAX_LEVELS = 32
"""Deepest nesting of tables and lists."""
_Model = TypeVar("_Model", bound=BaseModel)
MAX_BYTES = {"TOML": 1_000_000, "JSON": 2_000_000}
"""Largest file that is read, by language: two seconds of reading and checking at worst. The
scenario.json of a run through 5,000 fittings is as large."""
TOWN_TIMES = 30
"""A network's file may be larger by this: a town of 20,000 parts has 4 MB."""
_TOO_DEEP = f"is nested too deeply: at most {MAX_LEVELS} levels of tables and lists"
# Python's TOML reader takes time with the square of the number of keys between dots.
_DEEP_KEY = re.compile(
    rf"(?<![^\s,=\[\]{{}}#])(?:[^\s.,=\[\]{{}}#]+\s*\.\s*){{{MAX_LEVELS}}}"  # a.b.c. and so on
)


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        noun: what messages call it.
        command: takes such a file, and the names of the shipped ones.
        keys: those that no other kind has at its top.
        files: name of its files that come with the package.
    """

    noun: str
    command: str
    keys: frozenset[str]
    files: ShippedKind

    def shipped(self) -> Mapping[str, Path]:
        """Return the files that come with the package, by name."""
        return shipped_files(self.files)


SCENARIO = Kind("scenario", "run", frozenset({"pipes", "network", "mission"}), "scenarios")
SWEEP = Kind("sweep", "sweep", frozenset({"base", "axes"}), "sweeps")
NETWORK = Kind("network", "network", frozenset({"fittings", "joints"}), "networks")
STUDY = Kind("study", "optimise", frozenset({"variables", "objectives", "trials"}), "studies")
SUITE = Kind("suite", "bench", frozenset({"courses", "measures"}), "suites")
COURSE = Kind("course", "bench --course", frozenset({"words"}), "courses")
CONDITION = Kind("condition", "import --condition", frozenset({"defects"}), "conditions")
KINDS = (SCENARIO, SWEEP, STUDY, NETWORK, COURSE, SUITE, CONDITION)
_RECORDS = {
    frozenset({"outcome", "metrics"}): "is the result of a run; what was run stands beside it in "
    "scenario.json",
    frozenset({"sha256", "sweep"}): "is the record of a sweep; give the file that the sweep was "
    "run from. Its folder is what ot.load_sweep_result and `omnitrack run --trial` take",
    frozenset({"sha256", "study"}): "is the record of a study; give the file that the study was "
    "run from",
}
"""Files of saved runs, sweeps and studies that are easily taken for another one, by some of their
keys."""


def read_file(
    source: str | Path, kind: Kind, error: type[InputError]
) -> tuple[Path, dict[str, Any]]:
    """Return path and contents of a file, by its path or by the name of a shipped one.

    Files whose name ends in ``.json`` are JSON, all others TOML. If the file has no ``name``, its
    own name without the ending is used.

    Raises:
        InputError: of class ``error``: there is no such file, it cannot be read, or it is of
            another kind.
    """
    path = _located(source, kind, error)
    data = table_of(path, kind.noun, error)
    look_beside(path)
    _refuse_other_kinds(str(path), data, kind, error)
    return path, {"name": path.stem} | data


def table_of(path: Path, noun: str, error: type[InputError]) -> dict[str, Any]:
    """Read a file as JSON if its name ends in ``.json``, else as TOML.

    Args:
        path: a regular file.
        noun: what messages call it.
        error: exception class to raise for faults.

    Raises:
        InputError: of class ``error``: it cannot be read, is too large, or holds no table.
    """
    language = "JSON" if path.suffix.lower() == ".json" else "TOML"
    most = MAX_BYTES[language] * (TOWN_TIMES if noun == NETWORK.noun else 1)
    try:
        content = read_bytes(path, most, f" of {language}")
        # Editors on Windows put a byte order mark first, which neither TOML nor JSON takes.
        text = content.decode("utf-8-sig")
        data = _read(text, language)
        if not isinstance(data, dict):
            raise ValueError(f"holds no table; a {noun} is a table of keys and values")
        return data
    except OSError as reason:
        raise error(Fault(str(path), f"cannot be read: {reason.strerror}")) from reason
    except UnicodeDecodeError as reason:
        problem = f"is no text in UTF-8; a {noun} is a file of TOML or JSON"
        raise error(Fault(str(path), f"{problem}{_scenario_beside(path)}")) from reason
    except ValueError as reason:
        raise error(Fault(str(path), str(reason))) from reason


def _read(text: str, language: str) -> Any:
    """Parse a file's text; say so if it is JSON under another ending."""
    try:
        return parsed(text, language)
    except ValueError:
        if language == "TOML" and text.lstrip().startswith("{"):
            raise ValueError("is JSON, it seems; the name of such a file ends in .json") from None
        raise


def parsed(text: str, language: str) -> Any:
    """Parse a text into plain data of at most ``MAX_LEVELS`` levels.

    Args:
        text: of a file, or a part of one.
        language: ``"TOML"`` or ``"JSON"``.

    Raises:
        ValueError: it is not in that language, or nested too deeply; the message says which.
    """
    try:
        if language == "JSON":
            data = json.loads(text, object_pairs_hook=_without_doubles)
        # Before the parser runs, since its time is what such keys would exhaust.
        elif _DEEP_KEY.search(text):
            raise ValueError(_TOO_DEEP)
        else:
            data = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as reason:
        raise ValueError(f"is not valid {language}: {reason}") from reason
    except ValueError as reason:
        if not str(reason).startswith("Exceeds the limit"):  # Python's, on digits of an integer
            raise
        raise ValueError("has an integer of thousands of digits; at most 64 bits") from reason
    if _is_deep(data):
        raise ValueError(_TOO_DEEP)
    return data


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Table of a JSON object; a repeated key is an error, as it is in TOML."""
    table = dict(pairs)
    if len(table) < len(pairs):
        earlier: set[str] = set()
        twice = next(key for key, _ in pairs if key in earlier or earlier.add(key))
        raise ValueError(f"is not valid JSON: the key {twice!r} stands twice in one object")
    return table


def _is_deep(data: Any) -> bool:
    """Return whether tables and lists are nested deeper than ``MAX_LEVELS``."""
    layer = [data]
    # Level by level and without recursion, which hostile data could drive into its limit.
    for _ in range(MAX_LEVELS + 1):
        layer = [
            inside
            for item in layer
            if isinstance(item, dict | list)
            for inside in (item.values() if isinstance(item, dict) else item)
        ]
    return bool(layer)


def read_bytes(path: str | os.PathLike[str], most: int, what: str = "") -> bytes:
    """Read a regular file of at most ``most`` bytes; nothing else is waited for or read.

    Args:
        path: of the file.
        most: bytes.
        what: words behind the number of bytes in a message, with their blank.

    Raises:
        OSError: it cannot be read.
        ValueError: it is a pipe, a device or the like, or larger.
    """
    size_of(path, most, what)  # before it is opened: a device may act on that
    with open(path, "rb", opener=_without_waiting) as file:
        _check_size(os.fstat(file.fileno()), most, what)
        # What the system makes up as it is read has no size before.
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f"is too large: at most {most} bytes{what} are read")
    return content


def size_of(path: str | os.PathLike[str], most: int, what: str = "") -> int:
    """Return the size of a regular file; arguments and errors as of ``read_bytes``."""
    return _check_size(os.stat(path), most, what)


def _without_waiting(path: str, flags: int) -> int:
    # A pipe that took the place of the file would else be waited for.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _check_size(status: os.stat_result, most: int, what: str) -> int:
    if stat.S_ISDIR(status.st_mode):
        raise ValueError("is a folder, no file")
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("is no regular file")
    if status.st_size > most:
        raise ValueError(f"is too large: at most {most} bytes{what} are read")
    return status.st_size


def is_file(path: Path) -> bool:
    """Return whether a path leads to a regular file; false if it cannot be examined."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long, no permission, a null character
        return False


def refuse_missing(path: Path, where: str = "") -> None:
    """Raise an ``InputError`` where a path leads to no regular file; ``where``: its own name."""
    if not is_file(path):
        raise InputError(Fault(where or str(path), "cannot be read: there is no such file"))


@contextmanager
def placed_in(path: Path) -> Iterator[None]:
    """Name a file in the faults of what is read from it, but in those that name it already."""
    try:
        yield
    except InputError as error:
        name = str(path)
        faults = [f if f.where == name else f.at(f"{name}: {f.where}") for f in error.faults]
        raise InputError(faults) from None


def exists(path: Path) -> bool:
    """Return whether a path leads to anything; false if it cannot be examined."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def beside(folder: Path, source: str) -> str | Path:
    """Resolve a path or name in a file of ``folder``: the file there, or else the same text."""
    path = folder / source
    return path if is_file(path) else source


def _located(source: str | Path, kind: Kind, error: type[InputError]) -> Path:
    """Path of a file that is named by its path or as a shipped one."""
    path, name, shipped = Path(source), str(source), kind.shipped()
    try:
        if path.is_file():
            return path
        if name in shipped:
            return shipped[name]
        there, is_folder = path.exists(), path.is_dir()
    except (OSError, ValueError) as reason:
        problem = f"cannot be read: {getattr(reason, 'strerror', None) or reason}"
        raise error(Fault(name, problem)) from reason
    # The folder of a run is the likeliest one to be given: its scenario is named then.
    if is_folder:
        problem = f"is a folder, not a {kind.noun} file"
        if kind is SCENARIO:
            problem += _scenario_beside(path / "scenario.json")
        problem += in_folder(path)
        raise error(Fault(name or "''", problem))
    if there:
        raise error(Fault(name, "is no regular file"))
    raise error(_unknown(name, kind))


def _scenario_beside(path: Path) -> str:
    """Hint at the scenario of a run, for a path in the run's folder; empty for other paths."""
    scenario = path.with_name("scenario.json")
    return f"; the scenario of this run is {scenario}" if is_file(scenario) else ""


def in_folder(folder: Path) -> str:
    """Return the hint that a folder is that of a sweep, and who takes it; empty for others."""
    if not is_file(folder / "sweep.json"):
        return ""
    return (
        f"; it is the folder of a sweep: ot.load_sweep_result({str(folder)!r}) reads it, "
        f"`omnitrack run {folder} --trial 0` runs a trial of it again"
    )


def _unknown(name: str, kind: Kind) -> Fault:
    """Fault of a name that is neither a file nor shipped."""
    shipped = tuple(kind.shipped())
    others = {other: known for known in KINDS if known is not kind for other in known.shipped()}
    if name in others:
        return Fault(name, _is_another(others[name], kind, name))
    problem = f"no such file, nor a shipped {kind.noun} of that name"
    meant = nearest(name, [*shipped, *others])
    if meant in others and meant not in shipped:
        of = others[meant]
        problem += f"; did you mean the {of.noun} {meant!r} (`omnitrack {of.command}`)?"
        return Fault(name, problem, shipped)
    return Fault(name, problem, shipped, given=name)


def _is_another(actual: Kind, wanted: Kind, name: str) -> str:
    told = f"is a {actual.noun}, not a {wanted.noun}; `omnitrack {actual.command} {name}` takes it"
    if actual is SWEEP and wanted is SCENARIO:
        told += f", `omnitrack run {name} --trial 0` one of its trials"
    return told


def _refuse_other_kinds(
    name: str, data: Mapping[str, Any], kind: Kind, error: type[InputError]
) -> None:
    """Raise an error where a file has keys of another kind and none of its own."""
    if kind.keys & data.keys():
        return
    for other in KINDS:
        if other.keys & data.keys():
            raise error(Fault(name, _is_another(other, kind, name)))
    for keys, problem in _RECORDS.items():
        if keys <= data.keys():
            raise error(Fault(name, problem))


def checked(
    model: type[_Model],
    data: Mapping[str, Any],
    error: type[InputError],
    *,
    choices_at: Callable[[list[str]], tuple[str, ...]] | None = None,
    own_fault: Callable[[Mapping[str, Any]], Fault | None] = lambda _: None,
) -> _Model:
    """Return a model from plain data, as read from TOML or JSON, with every fault at its place.

    Args:
        model: class of the model.
        data: contents of the file.
        error: exception class to raise for faults.
        choices_at: gives the valid keys of the table at a path; by default those of ``model``.
        own_fault: words of the caller's own for one of ``ValidationError.errors()``; None for the
            common ones.

    Raises:
        InputError: of class ``error``, with every fault.
    """
    choices = choices_at or Document(model, data).keys_at
    plain, odd = _tidied(data)
    try:
        # From JSON, pydantic's strict mode takes lists for tuples and names for enums, but no
        # "0.5" for 0.5.
        made = model.model_validate_json(json.dumps(plain, default=plain_value), strict=True)
    except ValidationError as reason:
        faults, places = faults_of(reason, choices, own_fault), {one.where for one in odd}
        raise error([*odd, *(fault for fault in faults if fault.where not in places)]) from None
    if odd:
        raise error(odd)
    return made


def by_kind(
    model_of: Callable[[str], type[BaseModel]], default: str = "", *, strict: bool = False
) -> WrapValidator:
    """Return a wrap validator that reads a table with the model of its ``kind``.

    Faults within a table are reported at its keys.

    Args:
        model_of: returns the model of a kind, or raises an ``InputError`` with the valid ones.
        default: kind of a table that does not say one.
        strict: whether values in Python have to be of the types of the keys, as those of files.
    """

    def opened(data: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        # The common handler takes what is read already, and says that a table is expected.
        if not isinstance(data, Mapping):
            return handler(data)
        try:
            model = model_of(str(data.get("kind", default)))
        except InputError as error:
            fault = error.faults[0]
            problem = fault.problem if "kind" in data else "is missing"
            context = {"problem": problem, "choices": fault.choices, "given": fault.given}
            # Only a pydantic error is collected beside the other faults; the parts of ours travel
            # in its context.
            raise PydanticCustomError(KIND_FAULT, "{problem}", context) from error
        own = "kind" in model.model_fields
        table = {key: value for key, value in data.items() if own or key != "kind"}
        if info.mode == "json":  # strict, as ``checked`` is
            return model.model_validate_json(json.dumps(table), strict=True)
        return model.model_validate(table, strict=strict or None)

    return WrapValidator(opened)


def below(error: InputError) -> PydanticCustomError:
    """Return what a validator of a key raises for a fault at a place below it."""
    fault = error.faults[0]
    context = {"below": fault.where, "problem": fault.problem}
    context |= {"choices": fault.choices, "given": fault.given}
    return PydanticCustomError(PLACE_FAULT, "{problem}", context)


def faults_of(
    reason: ValidationError,
    choices: Callable[[list[str]], tuple[str, ...]],
    own_fault: Callable[[Mapping[str, Any]], Fault | None],
) -> list[Fault]:
    """Return the faults that pydantic found, once each.

    Args as in ``checked``.
    """
    items = reason.errors(include_url=False)
    # pydantic does not count a table with a fault as an item, and then calls the list too short,
    # too.
    lists = {item["loc"][:1] for item in items if len(item["loc"]) > 1}
    # The caller's own words come first, the common translation serves all other faults.
    faults = [
        own_fault(item) or _fault_of(item, choices)
        for item in items
        if item["loc"] not in lists or item["type"] != "too_short"
    ]
    return list(dict.fromkeys(faults))


def _tidied(data: Any) -> tuple[Any, list[Fault]]:
    """Plain data without the values that no file can hold, and those as faults."""
    faults: list[Fault] = []

    def tidy(value: Any, place: tuple[str, ...]) -> Any:
        if value is None or type(value) in (float, bool):
            return value  # most values of a file: no oddity is of these types
        problem = _oddity(value, len(place))
        if problem is not None:
            faults.append(Fault(".".join(place), problem))
            return None
        if isinstance(value, Mapping):
            # Keys, too, have to be texts that can be encoded.
            texts = map(str, value)
            keys = [
                k if k.isascii() else k.encode("utf-8", "backslashreplace").decode() for k in texts
            ]
            items = zip(keys, value.values(), strict=True)
            return {key: tidy(item, (*place, key)) for key, item in items}
        if isinstance(value, list | tuple):
            return [tidy(item, (*place, str(i))) for i, item in enumerate(value)]
        return value

    return tidy(data, ()), faults


def _oddity(value: Any, depth: int) -> str | None:
    """Problem of a value that is invalid at any place; None for ordinary values."""
    # A lone surrogate is half a character, which no encoding can write.
    if isinstance(value, str):
        if value.isascii() or not re.search(r"[\ud800-\udfff]", value):
            return None
        return f"is {shown(value)}, which has bytes or halves of characters that are no text"
    if isinstance(value, int) and abs(value) > MAX_INTEGER:
        return "is an integer of more than 64 bits"
    if isinstance(value, datetime.date | datetime.time):
        return f"is the date or time {value}; a text stands in quotes"
    if isinstance(value, Mapping | list | tuple) and depth > MAX_LEVELS:
        return _TOO_DEEP
    return None


def plain_value(value: Any) -> Any:
    """Return the plain form of a value that JSON does not know.

    Models become tables, numbers and lists of NumPy's plain ones, all else its text.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


def _fault_of(item: Mapping[str, Any], choices_at: Callable[[list[str]], tuple[str, ...]]) -> Fault:
    """Translate a pydantic error into a fault with its path in the file and the valid choices."""
    places = [str(p) for p in item["loc"]]
    where = ".".join(places)
    kind, context = item["type"], item.get("ctx", {})
    if kind == "extra_forbidden":
        return Fault(where, "unknown key", choices_at(places[:-1]), given=places[-1])
    if kind == KIND_FAULT:
        choices, word = tuple(context["choices"]), str(context["given"])
        return Fault(f"{where}.kind", context["problem"], choices, word)
    if kind == PLACE_FAULT:
        choices, word = tuple(context["choices"]), str(context["given"])
        return Fault(f"{where}.{context['below']}", context["problem"], choices, word)
    if kind in ("literal_error", "enum"):
        # pydantic lists the valid values as text only: "'a', 'b' or 'c'".
        choices = tuple(
            part.strip(" '") for part in str(context["expected"]).replace(" or ", ",").split(",")
        )
        value = item["input"]
        return Fault(where, f"is {shown(value)}", choices, value if isinstance(value, str) else "")
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
        problem = "is a table; it must be a list"
        if "." not in where:
            problem += f" of tables, each of which begins with [[{where}]] in TOML"
        return Fault(where, problem)
    message = _in_words_of_files(item["msg"])
    if kind in ("model_type", "dict_type"):  # which name a class where data come from Python
        message = "input should be a table"
    # A missing key has the whole table as its input, which would fill the message.
    if not isinstance(item["input"], dict) and kind != "missing":
        message += f" (given: {shown(item['input'])})"
    return Fault(where, message[0].lower() + message[1:])


def _in_words_of_files(message: str) -> str:
    """Message of pydantic in the terms of TOML and JSON instead of Python's."""
    message = message.removeprefix("Value error, ")
    for pydantics, ours in (
        ("valid tuple", "list"),
        ("valid array", "list"),
        ("an object", "a table"),
        ("Tuple", "List"),
    ):
        message = message.replace(pydantics, ours)
    return message
