"""The end of the page of commands: each with its arguments and options, as `--help` has it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import typer

from omnitrack_sim.cli import app

PAGE = "commands"
_CODE = re.compile(r"(`[^`]*`)")
_MARKUP = re.compile(r"([\\*_\[\]<>|])")
_HEAD = """
## Arguments and options

What `--help` of each command says.
"""


def write_commands(target: Path) -> None:
    """Append the commands to the page ``commands.md`` of the staged sources."""
    with (target / f"{PAGE}.md").open("a", encoding="utf-8") as page:
        page.write("\n".join(_lines()))


def _lines() -> Iterator[str]:
    # Typer tells its commands and options only by the objects that it makes of the functions.
    group: Any = typer.main.get_command(app)
    above = typer.Context(group, info_name="omnitrack")
    yield _HEAD
    yield from _table("option", group.get_params(above), above)
    for name, command in group.commands.items():
        within = typer.Context(command, info_name=name, parent=above)
        usage = command.get_usage(within).removeprefix("Usage: ").translate({123: "", 125: ""})
        yield f"\n## omnitrack {name}\n\n{_text(command.help)}\n\n```text\n{usage}\n```\n"
        parameters = command.get_params(within)
        for kind in ("argument", "option"):
            chosen = [one for one in parameters if one.param_type_name == kind]
            yield from _table(kind, chosen, within) if chosen else ()
        yield f"\n{_text(command.epilog)}" if command.epilog else ""


def _table(kind: str, parameters: Iterable[Any], context: typer.Context) -> Iterator[str]:
    yield f"\n| {kind} | meaning |\n|---|---|"
    for parameter in parameters:
        name, meaning = parameter.get_help_record(context)
        yield f"| `{name.replace('|', chr(92) + '|')}` | {_text(meaning)} |"


def _text(text: str) -> str:
    """Help text as Markdown: its code stays code, and nothing else in it is markup."""
    parts = _CODE.split(" ".join(text.split()))
    return "".join(part if part.startswith("`") else _MARKUP.sub(r"\\\1", part) for part in parts)
