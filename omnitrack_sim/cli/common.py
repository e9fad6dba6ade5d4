"""What the commands share: the application, consoles, scenarios from arguments, progress bars."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from omnitrack_sim.errors import Fault, ScenarioError

if TYPE_CHECKING:
    from omnitrack_sim.scenario import Scenario

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Simulate the Omnidirectional Tractable Three Module Robot in pipes.",
)
out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def plain(text: str) -> str:
    """``text`` with its markup characters escaped, so that it is printed as it is."""
    from rich.markup import escape

    return escape(text)


ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a shipped one.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a value, such as control.cruise_speed=0.12; @FILE overrides many.",
    ),
]


FastOption = Annotated[
    bool,
    typer.Option(
        "--fast",
        help="Exact walls and whole tracks, compiled (physics.collider = exact; extra fast).",
    ),
]
FAST = 'physics.collider="exact"'
"""What ``--fast`` sets."""


def load(source: str, assignments: list[str] | None) -> Scenario:
    """The scenario of a file or name, with the overrides of ``--set``."""
    from omnitrack_sim.scenario import load_scenario, override

    scenario = load_scenario(source)
    return override(scenario, changes_of(assignments)) if assignments else scenario


def changes_of(assignments: list[str] | None) -> dict[str, Any]:
    """The overrides of ``--set`` by path: each a PATH=VALUE, or @FILE with many of them."""
    changes: dict[str, Any] = {}
    for text in assignments or ():
        if text.startswith("@"):
            changes |= settings_of(Path(text[1:]))
        else:
            path, value = assignment(text)
            changes[path] = value
    return changes


def settings_of(file: Path) -> dict[str, Any]:
    """The overrides of a TOML file by path, such as a study's ``best.toml``: ``"a.b" = 1``, or
    tables."""
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as reason:
        problem = f"cannot be read: {reason.strerror}"
        raise ScenarioError(Fault(f"--set @{file}", problem)) from reason
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as reason:
        raise ScenarioError(Fault(f"--set @{file}", f"is not valid TOML: {reason}")) from reason
    return dict(_leaves(tables, ""))


def _leaves(table: Mapping[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    """The values in a table and the tables in it, by dotted path."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def assignment(text: str) -> tuple[str, Any]:
    """Path and value of PATH=VALUE. The value is read as in TOML, a bare word as a string."""
    path, equals, value = text.partition("=")
    if not equals or not path:
        raise ScenarioError(
            Fault(f"--set {text}", "is not PATH=VALUE, such as control.cruise_speed=0.12")
        )
    try:
        return path.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return path.strip(), value.strip()


@contextmanager
def progress(title: str, quiet: bool) -> Iterator[Any]:
    """A progress bar on standard error.

    Yields the function that moves it, called with the fraction done and a text; None if ``quiet``.
    """
    if quiet:
        yield None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda part, text="": bar.update(
            task, completed=part, description=f"{title} {text}".strip()
        )
