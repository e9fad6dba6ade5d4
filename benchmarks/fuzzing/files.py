"""Odd files: shipped scenarios, sweeps, studies, suites and networks, changed or damaged."""

from __future__ import annotations

import copy
import random
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from fuzzing import values
from fuzzing.writing import as_json, toml

SHAPED, STRAINED = 0.6, 0.2
"""Part of the cases that change values, and that change numbers only; in the others the text is
damaged."""
MAX_CHANGES = 4
KINDS = {"scenario": 6, "sweep": 2, "study": 2, "suite": 1, "network": 2}
"""How often which kind of file comes."""


@dataclass(frozen=True)
class File:
    """One odd file.

    Attributes:
        kind: what it is read as, one of ``KINDS``.
        name: of the file.
        data: its contents.
        story: what it is made from, and what was done to it.
    """

    kind: str
    name: str
    data: bytes
    story: tuple[str, ...]


def odd_file(seed: int, index: int) -> File:
    """The file of that number; the same at every call."""
    rng = random.Random(f"file {seed} {index}")
    kind = rng.choices(list(KINDS), list(KINDS.values()))[0]
    base, in_full = rng.choice(_bases(kind))
    data = _contents(kind, base, in_full)
    read_as = kind if rng.random() < 0.97 else rng.choice(list(KINDS))
    data, story = copy.deepcopy(data), [f"{base}{', in full' if in_full else ''}"]
    write, ending = (as_json, "json") if rng.random() < 0.15 else (toml, "toml")
    way = rng.random()
    if way < SHAPED + STRAINED:
        change = _change if way < SHAPED else _strained
        for _ in range(rng.choice((1, 1, 1, 2, 3, MAX_CHANGES))):
            story.append(change(rng, data))
        contents = _encoded(rng, write(data))
    else:
        contents = write(data).encode()
        for _ in range(rng.choice((1, 1, 2))):
            contents, what = _damage(rng, contents)
            story.append(what)
    return File(read_as, f"odd.{ending}", contents, tuple(story))


def changed(rng: random.Random, data: dict[str, Any], times: int) -> tuple[bytes, list[str]]:
    """Plain data with so many odd changes, as JSON, and what was done."""
    story = [_change(rng, data) for _ in range(times)]
    return as_json(data).encode("utf-8", "replace"), story


@cache
def _bases(kind: str) -> tuple[tuple[str, bool], ...]:
    """Names of the shipped files of a kind, and whether each can be written out in full again."""
    names = [(name, False) for name in _shipped(kind)]
    in_full = kind in ("scenario", "network")
    return (*names, *((name, True) for name, _ in names if in_full))


def _shipped(kind: str) -> Mapping[str, Path]:
    from omnitrack_sim.base import reading

    return next(one.shipped() for one in reading.KINDS if one.noun == kind)


@cache
def _contents(kind: str, name: str, in_full: bool) -> dict[str, Any]:
    """What a shipped file says, or with every key written out."""
    from omnitrack_sim import load_network, load_scenario

    if in_full:
        load = load_scenario if kind == "scenario" else load_network
        return load(name).model_dump(mode="json")
    return tomllib.loads(_shipped(kind)[name].read_text(encoding="utf-8"))


def _encoded(rng: random.Random, text: str) -> bytes:
    """UTF-8, now and then with marks or ends of lines of other systems."""
    way = rng.random()
    if way < 0.02:
        return b"\xef\xbb\xbf" + text.encode()
    if way < 0.04:
        return text.replace("\n", "\r\n").encode()
    return text.encode("utf-16" if way < 0.05 else "utf-8")


def _change(rng: random.Random, data: dict[str, Any]) -> str:
    """Change one thing in plain data; what was done, in words."""
    weights = {
        _new_number: 10,
        _new_text: 4,
        _other_kind: 4,
        _lost: 2,
        _renamed: 2,
        _added: 2,
        _lengthen: 2,
        _shorter: 1,
        _deeper: 1,
        _of_another: 2,
    }
    change = rng.choices(list(weights), list(weights.values()))[0]
    return change(rng, data)


Place = tuple[Any, Any]
"""A table or list, and the key or index of something in it."""


def _places(data: Any) -> Iterator[Place]:
    """Everything in nested tables and lists, one place after the other."""
    entries = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in list(entries):
        yield data, key
        if isinstance(value, dict | list):
            yield from _places(value)


def _pick(
    rng: random.Random, data: Any, fits: Callable[[Any], bool] = lambda _: True
) -> Place | None:
    found = [(holder, key) for holder, key in _places(data) if fits(holder[key])]
    return rng.choice(found) if found else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _set(rng: random.Random, data: Any, fits: Callable[[Any], bool], make: Callable) -> str:
    place = _pick(rng, data, fits)
    if place is None:
        return _added(rng, data)
    holder, key = place
    old, holder[key] = holder[key], make(holder[key])
    return f"{key}: {str(old)[:40]!r} becomes {str(holder[key])[:60]!r}"


def _new_number(rng: random.Random, data: Any) -> str:
    return _set(rng, data, _is_number, lambda old: values.number(rng, old))


def _strained(rng: random.Random, data: Any) -> str:
    """A number many times as large or as small, which may well be accepted."""
    return _set(rng, data, _is_number, lambda old: values.strained(rng, old))


def _new_text(rng: random.Random, data: Any) -> str:
    return _set(rng, data, lambda v: isinstance(v, str), lambda _: values.text(rng))


def _other_kind(rng: random.Random, data: Any) -> str:
    return _set(rng, data, lambda _: True, lambda _: values.thing(rng))


def _deeper(rng: random.Random, data: Any) -> str:
    return _set(rng, data, lambda _: True, lambda _: values.nested(rng))


def _of_another(rng: random.Random, data: Any) -> str:
    """A value from elsewhere in the same file."""
    place = _pick(rng, data)
    assert place is not None
    other = copy.deepcopy(place[0][place[1]])
    return _set(rng, data, lambda v: not isinstance(v, dict | list), lambda _: other)


def _lost(rng: random.Random, data: Any) -> str:
    place = _pick(rng, data)
    if place is None:
        return "nothing to lose"
    del place[0][place[1]]
    return f"{place[1]}: lost"


def _renamed(rng: random.Random, data: Any) -> str:
    tables = [data, *(h[k] for h, k in _places(data) if isinstance(h[k], dict) and h[k])]
    table = rng.choice(tables)
    if not table:
        return "no key to rename"
    key = rng.choice(list(table))
    table[new := _misspelt(rng, key)] = table.pop(key)
    return f"{key}: renamed {new[:60]!r}"


def _misspelt(rng: random.Random, key: str) -> str:
    at = rng.randrange(len(key)) if key else 0
    ways = (
        key[:at] + key[at + 1 :],
        key[:at] + key[at : at + 1] * 2 + key[at + 1 :],
        key.upper(),
        f"{key}.{key}",
        values.text(rng),
    )
    return rng.choice(ways)


def _added(rng: random.Random, data: Any) -> str:
    tables = [data, *(h[k] for h, k in _places(data) if isinstance(h[k], dict))]
    key = rng.choice((values.text(rng), "name", "kind", "path", "set", "seed", "network", "pipes"))
    rng.choice(tables)[key] = values.thing(rng)
    return f"{key[:60]!r} added"


def _lengthen(rng: random.Random, data: Any) -> str:
    """A list many times over; names in it may be told apart."""
    times = rng.choice((2, 10, 100, 1000, 5000))
    apart = rng.random() < 0.5

    def make(old: list[Any]) -> list[Any]:
        several = [copy.deepcopy(item) for _ in range(times) for item in old[:20]]
        for i, item in enumerate(several if apart else ()):
            if isinstance(item, dict) and isinstance(item.get("name"), str):
                item["name"] += f"_{i}"
        return several

    return _set(rng, data, lambda v: isinstance(v, list) and bool(v), make) + f" ({times} times)"


def _shorter(rng: random.Random, data: Any) -> str:
    return _set(rng, data, lambda v: isinstance(v, list), lambda old: old[: rng.randrange(2)])


def _damage(rng: random.Random, contents: bytes) -> tuple[bytes, str]:
    """Damage the text of a file; what was done, in words."""
    at = rng.randrange(len(contents) + 1)
    lines = contents.split(b"\n")
    row = rng.randrange(len(lines))
    junk = rng.choice(
        (
            b"\xff",
            b"\x00",
            b"\xc3(",
            b"\x1b[2J",
            b'"',
            b"'''",
            b"[",
            b"]]",
            b"=",
            b"#",
            b"\r",
            b"\\u12",
        )
    )
    deep = rng.choice((100, 1000, 10_000, 100_000))
    choices = {
        "cut off": contents[:at],
        "empty": b"",
        "a byte changed": contents[:at] + rng.randbytes(1) + contents[at + 1 :],
        "junk inside": contents[:at] + junk + contents[at:],
        "a line lost": b"\n".join(lines[:row] + lines[row + 1 :]),
        "a line twice": b"\n".join([*lines[: row + 1], *lines[row:]]),
        "all twice": contents + contents,
        "noise": rng.randbytes(rng.choice((1, 10, 1000))),
        "noise in between": contents[:at] + rng.randbytes(20) + contents[at:],
        f"{deep} brackets": b"x = " + b"[" * deep,
        f"{deep} keys deep": b".".join([b"a"] * deep) + b" = 1\n" + contents,
        f"a head {deep} deep": contents + b"\n[" + b".".join([b"b"] * deep) + b"]\n",
        "braces": b"x = " + b"{a=" * deep + b"1" + b"}" * deep,
        "a long line": contents + b'\nx = "' + b"y" * deep + b'"\n',
        "a long number": contents + b"\nx = " + b"7" * deep + b"\n",
        "a long comment": b"#" + b"\x07" * deep + b"\n" + contents,
        "zeros": bytes(deep),
        "brackets of JSON": b'{"a":' * deep,
    }
    what = rng.choice(list(choices))
    return choices[what], what
