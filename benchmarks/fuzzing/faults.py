"""What is found: a fault, its place, and faults of one sort together."""

from __future__ import annotations

import json
import re
import traceback
from collections.abc import Iterable
from dataclasses import asdict, dataclass

PACKAGE = "omnitrack_sim/"


@dataclass(frozen=True)
class Fault:
    """One thing that went wrong.

    Attributes:
        what: in a word: the class of the exception, or what was seen.
        place: the innermost place in the package, ``file.py:function``; what was done, where there
            is none.
        detail: the message, cut short.
    """

    what: str
    place: str
    detail: str = ""

    def to_json(self) -> str:
        """Return the fault as a line of JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Fault:
        """Return the fault that ``to_json`` wrote."""
        return cls(**json.loads(text))


def fault_of(error: BaseException, doing: str) -> Fault:
    """An exception that should not have come out."""
    frames = [(f.filename, f.name) for f in traceback.extract_tb(error.__traceback__)]
    inside = [f"{below(file)}:{name}" for file, name in frames if PACKAGE in file]
    place = f"{doing}: {inside[-1]}" if inside else doing
    return Fault(type(error).__name__, place, _short(str(error)))


def place_in_dump(dump: str) -> str:
    """The innermost place in the package in a traceback that ``faulthandler`` wrote."""
    found = re.search(rf'File "[^"]*?{PACKAGE}([^"]+)", line \d+ in (\S+)', dump)
    return f"{found[1]}:{found[2]}" if found else "?"


def below(file: str) -> str:
    """A path below the package or the folder of installed ones, or else the whole."""
    file = file.rpartition("site-packages/")[2]
    return file.rpartition(PACKAGE)[2]


def _short(text: str, most: int = 300) -> str:
    line = text.encode("unicode_escape").decode()
    return line if len(line) <= most else f"{line[:most]}... ({len(text)} characters)"


def grouped(
    found: Iterable[tuple[str, Fault]],
) -> list[tuple[Fault, list[str]]]:
    """Faults of one sort together: the first of each, and the cases that showed it."""
    groups: dict[tuple[str, str], tuple[Fault, list[str]]] = {}
    for case, fault in found:
        groups.setdefault((fault.what, fault.place), (fault, []))[1].append(case)
    return sorted(groups.values(), key=lambda group: -len(group[1]))
