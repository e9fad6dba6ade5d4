"""Odd values for files and arguments: numbers, texts, shapes."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel


@dataclass(frozen=True)
class Raw:
    """Text that stands in a file as it is, where a value is expected."""

    text: str


EXTREMES: tuple[Any, ...] = (
    *(0, 0.0, -0.0, 1, -1, -1.0, 2**31, 2**63 - 1, -(2**63), 2**63, 2**64, 10**30),
    *(1e-300, 5e-324, 1e-12, 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9, 1e12, 1e154, 1e160, 1e300, -1e300),
    *(math.nan, math.inf, -math.inf, 1.7976931348623157e308, 0.1 + 0.2, 1 + 2**-52),
)
WRITTEN = (
    *("9" * 5000, "-" + "1" * 4301, "1e999", "1e-999", "-1e400", "0." + "3" * 5000),
    *("0x7fffffffffffffff", "0o777", "0b1011", "1_000.000_1", "+5", "00", "1.", ".5", "1e", "--1"),
    *("1979-05-27", "1979-05-27T07:32:00Z", "07:32:00", "9999-12-31T23:59:59.999999+23:59"),
    *("true", "false", "null", "None", "NaN", "Infinity", "-Infinity", "nan", "+inf", "inf"),
)
TEXTS = (
    *("", " ", ".", "..", "...", "/", "\\", "~", "-", "--help", "*", "$", "$x$", "$\\frac{1}{2$"),
    *(
        "a$b",
        "$^2$",
        "\\alpha",
        "{",
        "}{",
        "{0}",
        "%s",
        "%(name)s",
        "$(id)",
        "`id`",
        "a;b",
        "'",
        '"',
    ),
    *("../up", "/etc/passwd", "a/b", "a\\b", "C:\\x", "con", "nul.txt", ".hidden", "trailing "),
    *(
        "\x1b[31mred\x1b[0m",
        "\x1b]0;title\x07",
        "a\nb",
        "a\rb",
        "a\tb",
        "\x00",
        "a\x00b",
        "\x7f\x85",
    ),
    *("[bold]x[/bold]", "[/]", "[red", "[link=http://x]y[/link]", ":smile:", "&<b>x</b>"),
    *("über", "名前", "🤖", "e\u0301", "\u202egnp.x", "\u200b", "\ufeff", "\u2028", "\ud7ff", "İ"),
    *("n" * 250, "n" * 300, "名" * 90, "/".join(["d" * 100] * 50), "x" * 100_000, "$" * 500),
    *("os:getcwd", "sys:modules", "math:pi", ":", "a:", ":b", "a:b:c", "json:nope", "no.such:X"),
    *(
        "builtins:int",
        "builtins:object",
        "omnitrack_sim:Omnitrack",
        "collections:",
        "..:x",
        "os.path:join",
    ),
    *(
        "0",
        "1",
        "1.0",
        "true",
        "nan",
        "straight",
        "tee",
        "run_start",
        "branch",
        "fig14",
        "tee_turn",
    ),
)


def number(rng: random.Random, near: float | None = None) -> Any:
    """An odd number; sometimes a multiple or a neighbour of ``near``, or of a limit."""
    kinds = ("extreme", "written", "limit", "near", "near", "draw")
    kind = rng.choice(kinds)
    if kind == "extreme":
        return rng.choice(EXTREMES)
    if kind == "written":
        return Raw(rng.choice(WRITTEN))
    if kind == "limit":
        return _beside(rng, rng.choice(limits()))
    if kind == "near" and near is not None and math.isfinite(near):
        factor = rng.choice((-1, 0.001, 0.1, 0.5, 0.9, 1.1, 2, 3, 10, 100, 1000, 1e4))
        value = rng.choice((near * factor, near + rng.choice((-1, 1)), _beside(rng, near)))
        return round(value) if isinstance(near, int) and rng.random() < 0.8 else value
    return math.copysign(10 ** rng.uniform(-9, 9), rng.random() - 0.3)


def strained(rng: random.Random, old: float) -> Any:
    """A number like ``old``, many times as large or as small, or a limit."""
    if rng.random() < 0.25:
        return _beside(rng, rng.choice(limits()))
    power = rng.choice((rng.uniform(-2, 2), rng.uniform(-12, 12), rng.uniform(-300, 300)))
    value = (old or rng.choice((1.0, -1.0))) * 10.0**power
    return round(value) if isinstance(old, int) and abs(value) < 1e18 else value


def _beside(rng: random.Random, value: float) -> Any:
    """The value, as a whole number or not, or one of its neighbours."""
    above, below = math.nextafter(value, math.inf), math.nextafter(value, -math.inf)
    near = [float(value), above, below, value * (1 + 1e-9), value * (1 - 1e-9)]
    return rng.choice([*near, *([int(value)] if float(value).is_integer() else [])])


@cache
def limits() -> tuple[float, ...]:
    """Every limit that the tables of files and the robot set on a number."""
    from omnitrack_sim import Network, Omnitrack, Scenario
    from omnitrack_sim.trials.axes import AXES
    from omnitrack_sim.trials.study_file import StudyFile
    from omnitrack_sim.trials.suite import SuiteFile
    from omnitrack_sim.trials.sweep_file import SweepFile

    models = (Scenario, Omnitrack, Network, SweepFile, StudyFile, SuiteFile, *AXES.values())
    found = {limit for model in models for limit in _of(model)}
    return tuple(sorted({*found, 1000.0}))


def _of(model: type[BaseModel]) -> Iterator[float]:
    """Limits of one table and those in it."""
    for info in model.model_fields.values():
        yield from _inside(info.annotation)
        about = info.json_schema_extra  # a robot's fields say their range there
        if isinstance(about, dict):
            yield from about.get("within") or ()
        for item in info.metadata:
            yield from _bounds(item)


def _inside(annotation: Any) -> Iterator[float]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from _of(annotation)
    for item in (*get_args(annotation), *getattr(annotation, "__metadata__", ())):
        yield from _inside(item)
        yield from _bounds(item)


def _bounds(item: Any) -> Iterator[float]:
    for key in ("ge", "gt", "le", "lt"):
        for holder in (item, *getattr(item, "metadata", ())):
            bound = getattr(holder, key, None)
            if isinstance(bound, int | float):
                yield bound


def text(rng: random.Random) -> str:
    """An odd text."""
    return rng.choice(TEXTS)


def thing(rng: random.Random) -> Any:
    """A value of any kind: a number, a text, a list, a table, deep nesting."""
    makers = (
        lambda: number(rng),
        lambda: text(rng),
        lambda: rng.choice((True, False)),
        lambda: [number(rng) for _ in range(rng.choice((0, 1, 2, 3, 4, 1000)))],
        lambda: [text(rng) for _ in range(rng.randrange(3))],
        lambda: {text(rng): number(rng) for _ in range(rng.randrange(3))},
        lambda: [{}] * rng.choice((1, 2, 100)),
        lambda: nested(rng),
    )
    return rng.choice(makers)()


def nested(rng: random.Random) -> Raw:
    """Brackets in brackets, up to thousands deep; some are not closed."""
    depth = rng.choice((3, 50, 90, 101, 500, 999, 3000, 20000))
    left, right = rng.choice((("[", "]"), ("{a=", "}"), ('{"a":', "}"), ("[[", "]]")))
    return Raw(left * depth + "1" + right * (depth - rng.choice((0, 0, 0, 1))))
