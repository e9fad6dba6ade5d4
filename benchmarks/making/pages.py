"""Pages of Markdown whose tables and sentences a program fills, between marks.

The marks are no text::

    <!-- made by: PART PIECE -->
    | a | table |
    <!-- end -->

and, once on each page that has such marks or pictures of parts, ``<!-- made by -->``: which parts
the page shows, and at which commit each was made.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path

from making.parts import Part, Record

WIDTH = 100
MARK = re.compile(
    r"^<!-- made by: (?P<part>\S+) (?P<piece>.+?) -->\n(?P<body>.*?)^<!-- end -->$",
    re.MULTILINE | re.DOTALL,
)
FOOT = re.compile(r"^<!-- made by -->\n(?P<body>.*?)^<!-- end -->$", re.MULTILINE | re.DOTALL)
PICTURE = re.compile(r"!\[[^\]]*\]\(([^)#]+)\)")
HEADING = re.compile(r"^## (.+)$", re.MULTILINE)
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
SENTENCE = re.compile(r"(?<=[.:])\s+|\n\s*\n")
FIGURE = re.compile(r"(?<![\w.])\d+(?:\.\d+ ?|\s+(?=[a-zA-Z%]))(?:[a-zA-Z%]+)?")
"""A number with a fraction, or one with the word behind it: "1.25 s", "90 times"."""
OLD = "*Made by older physics"
"""How the note above a piece of a part begins that today's code has not made."""


def pages_of(docs: Path) -> list[Path]:
    """Return all pages: those of docs, and the README beside it."""
    return [docs.parent / "README.md", *sorted(docs.rglob("*.md"))]


def pieces(printed: str) -> dict[str, str]:
    """Return what a part's commands have printed below each heading of the second level."""
    parts = HEADING.split(printed)
    return {name.strip(): text.strip() for name, text in zip(parts[1::2], parts[2::2], strict=True)}


def parts_of(page: Path, docs: Path, parts: Mapping[str, Part]) -> list[str]:
    """Return the parts that a page shows, by its marks and its pictures, in their order."""
    text = page.read_text(encoding="utf-8")
    named = {match["part"] for match in MARK.finditer(text)}
    pictures = {(page.parent / path).resolve() for path in PICTURE.findall(text)}
    return [
        name
        for name, part in parts.items()
        if name in named or any((docs / picture).resolve() in pictures for picture in part.files)
    ]


def filled(text: str, body: Callable[[re.Match[str]], str | None]) -> str:
    """Return a page with new bodies between its marks; None keeps one as it is."""

    def replaced(match: re.Match[str]) -> str:
        new = body(match)
        if new is None:
            return match[0]
        head = f"<!-- made by: {match['part']} {match['piece']} -->"
        return f"{head}\n{new}\n<!-- end -->"

    return MARK.sub(replaced, text)


def quoted(text: str) -> set[str]:
    """Return the figures of a text, as they are printed."""
    return {" ".join(match[0].split()) for match in FIGURE.finditer(text)}


def stale_sentences(text: str, name: str, made: Mapping[str, str]) -> list[str]:
    """Return the sentences of a page that quote a figure which its part no longer prints.

    Args:
        text: of the page before it is filled.
        name: of the part that is made anew.
        made: its new pieces by name.
    """
    old = {m["piece"]: m["body"] for m in MARK.finditer(text) if m["part"] == name}
    now = set[str]().union(*(quoted(made.get(piece, body)) for piece, body in old.items()))
    gone = set[str]().union(*map(quoted, old.values())) - now
    prose = CODE.sub("", FOOT.sub("", MARK.sub("", text)))
    sentences = (" ".join(sentence.split()) for sentence in SENTENCE.split(prose))
    return [sentence for sentence in sentences if quoted(sentence) & gone]


def note(name: str, record: Record | None) -> str:
    """Return what stands above a piece that today's code has not made; nothing above another."""
    make = f'`make figures PARTS="{name}"` makes it.*'
    if record is None:
        return f"*Not made yet; {make}"
    return f"{OLD}, at commit {record.commit[:7]}; {make}" if record.older else ""


def with_note(body: str, name: str, record: Record | None) -> str:
    """Return a body with the note that its part's record asks for, and no other."""
    lines = body.strip("\n").split("\n")
    if lines[0].startswith(("*Made by older", "*Not made yet")):
        lines = lines[2:]
    told = note(name, record)
    if record is None:
        return told
    return "\n".join([told, "", *lines] if told else lines).strip("\n")


def foot(names: list[str], records: Mapping[str, Record]) -> str:
    """Return the sentences that say of a page which code has made what it shows."""
    fresh: dict[str, list[str]] = {}
    for name in names:
        record = records.get(name)
        if record and not record.older:
            made = f"commit {record.commit[:7]} ({record.date[:10]})"
            fresh.setdefault(made, []).append(f"`{name}`")
    parts = "; ".join(f"{', '.join(own)} at {made}" for made, own in fresh.items())
    sentences = [f"Made by `make figures`: {parts}."] if fresh else []
    older = [name for name in names if name in records and records[name].older]
    if older:
        told = ", ".join(f"`{name}` (commit {records[name].commit[:7]})" for name in older)
        sentences.append(f"Of older physics: {told}.")
    missing = [f"`{name}`" for name in names if name not in records]
    if missing:
        sentences.append(f"Not made yet: {', '.join(missing)}.")
    return textwrap.fill(" ".join(sentences), WIDTH, break_long_words=False, break_on_hyphens=False)


def minutes(seconds: float) -> str:
    """Return a time as text, to the minute, or to the second below one."""
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"


def with_foot(text: str, sentences: str) -> str:
    """Return a page with new sentences at its foot mark."""
    return FOOT.sub(lambda _: f"<!-- made by -->\n{sentences}\n<!-- end -->", text)
