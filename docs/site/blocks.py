"""What is wrong with the code blocks of pages: each has to be what it says."""

from __future__ import annotations

import ast
import json
import re
import shlex
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import typer
from stage import ROOT

from omnitrack_sim.cli import app
from omnitrack_sim.pipes import Port

_BLOCK = re.compile(r"^( *)(`{3,})([^\n`]*)\n(.*?)^\1\2$", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"(?<!`)`(omnitrack [^`]+|make [\w-]+|python [^`]+)`(?!`)")


def blocks(text: str) -> Iterator[tuple[int, str, str]]:
    """Line, language and contents of each fenced block of a page of Markdown."""
    for match in _BLOCK.finditer(text):
        yield text.count("\n", 0, match.start()) + 1, match[3].strip(), match[4]


def inline_commands(text: str) -> Iterator[Port]:
    """Line and text of each command that stands as code in a sentence, outside of blocks."""
    text = _BLOCK.sub(lambda match: "\n" * match[0].count("\n"), text)
    for match in _INLINE.finditer(text):
        yield text.count("\n", 0, match.start()) + 1, match[1].replace("\n", " ")


def faults_of_blocks(folder: Path) -> list[str]:
    """Blocks without a language, of an unknown one, and those that are not what they say."""
    faults = []
    for path in sorted(folder.glob("*.md")):
        for line, language, code in blocks(path.read_text(encoding="utf-8")):
            if language.startswith("{"):
                continue  # a directive, which Sphinx checks
            problem = _problem(language, code)
            faults += [f"{path.name}:{line}: {problem}"] if problem else []
        for line, command in inline_commands(path.read_text(encoding="utf-8")):
            problem = _problem("sh", command)
            faults += [f"{path.name}:{line}: {problem}"] if problem else []
    return faults


def _problem(language: str, code: str) -> str | None:
    check = CHECKS.get(language)
    if check is None:
        known = ", ".join(sorted(CHECKS))
        return f"a block of {language or 'no language'}; the languages are {known}"
    try:
        check(code)
    except (SyntaxError, ValueError) as fault:
        return f"a block that is no {language}: {fault}"
    return None


def _shell(code: str) -> None:
    told = subprocess.run(["sh", "-n"], input=code, text=True, capture_output=True, check=False)
    if told.returncode:
        raise ValueError(told.stderr.strip())
    for line in code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["omnitrack"]:
            _check_command(words[1:])
        elif words[:1] == ["make"]:
            _check_target(words[1])
        elif words[:1] == ["python"] and words[1].endswith(".py"):
            _check_script(words[1])


def _check_command(words: list[str]) -> None:
    """Refuse commands and options of ``omnitrack`` that there are not."""
    commands = _commands()
    if words[0].startswith("-"):
        return
    if words[0] not in commands:
        raise ValueError(f"there is no command omnitrack {words[0]}")
    known = {
        name for item in commands[words[0]].params for name in (*item.opts, *item.secondary_opts)
    }
    for word in words[1:]:
        if word.startswith("--") and word.partition("=")[0] not in known:
            raise ValueError(f"omnitrack {words[0]} has no {word}")


@cache
def _commands() -> dict[str, Any]:
    """Commands by name, as Typer makes them of the functions."""
    group: Any = typer.main.get_command(app)
    return group.commands


def _check_script(name: str) -> None:
    if not (ROOT / name).is_file():
        raise ValueError(f"there is no {name}")


def _check_target(name: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    if not re.search(rf"^{re.escape(name)}:", makefile, re.MULTILINE):
        raise ValueError(f"make has no target {name}")


CHECKS: dict[str, Callable[[str], Any]] = {
    "python": ast.parse,
    "toml": tomllib.loads,
    "json": json.loads,
    "sh": _shell,
    "xml": lambda code: None,
    "yaml": lambda code: None,
    "text": lambda code: None,
    "math": lambda code: None,
}
"""What each language of a block is checked with; a fault is a SyntaxError or ValueError."""
