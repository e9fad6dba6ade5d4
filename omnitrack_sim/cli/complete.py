"""Shell completion: names of shipped files, paths of files, cameras and paths of `--set`."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import omnitrack_sim as ot
from omnitrack_sim.base.naming import ShippedKind, shipped_files

if TYPE_CHECKING:
    from pydantic import BaseModel

Choices = list[tuple[str, str]]
"""Completions, each with a help text that a shell may show beside it."""


def _shipped(kind: ShippedKind) -> Callable[[str], Choices]:
    """Completion by the names of shipped files, each with the comment at its head, and by files."""

    def complete(incomplete: str) -> Choices:
        files = {k: v for k, v in shipped_files(kind).items() if k.startswith(incomplete)}
        known = [(name, _short(comment(path))) for name, path in files.items()]
        return known + [(path, "") for path in _files(incomplete)]

    return complete


scenarios = _shipped("scenarios")
sweeps = _shipped("sweeps")
studies = _shipped("studies")
suites = _shipped("suites")
networks = _shipped("networks")
conditions = _shipped("conditions")


def policies(incomplete: str) -> Choices:
    """Shipped policies, and files."""
    names = [(name, "") for name in shipped_files("policies") if name.startswith(incomplete)]
    return names + [(path, "") for path in _files(incomplete, (".npz",))]


def towns(incomplete: str) -> Choices:
    """Towns that come with wntr, and files of networks of other programs."""
    from omnitrack_sim.pipes.importing import wntr_towns

    names = [(name, "") for name in wntr_towns() if name.startswith(incomplete)]
    return names + [(path, "") for path in _files(incomplete, (".inp", ".pcf"))]


def kinds(incomplete: str) -> Choices:
    """Kinds of robots."""
    from omnitrack_sim.robots.kinds import robot_kinds

    return [(kind, "") for kind in robot_kinds() if kind.startswith(incomplete)]


def reproduced(incomplete: str) -> Choices:
    """What `reproduce` takes: kinds of robots, and the ledger."""
    return kinds(incomplete) + [("measured", "")] * "measured".startswith(incomplete)


def robots(incomplete: str) -> Choices:
    """Kinds of robots, and scenarios."""
    return kinds(incomplete) + scenarios(incomplete)


def cameras(incomplete: str) -> Choices:
    """The cameras of films."""
    from omnitrack_sim.show.film.render import CAMERAS

    return [(name, "") for name in CAMERAS if name.startswith(incomplete)]


def settings(incomplete: str) -> Choices:
    """The paths of `--set`, each with unit and meaning; those of controllers are the default one's.

    A shell sets a blank behind the only one that is left, so that all of a path is offered at once.
    """
    return [
        (f"{path}=", _short(meaning)) for path, meaning in _paths() if path.startswith(incomplete)
    ]


def comment(path: Path) -> str:
    """The comment at the head of a scenario, sweep, study or network file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    length = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    return " ".join(line.lstrip("# ") for line in lines[:length])


def _short(text: str) -> str:
    """A text in one line of a shell; Typer breaks longer ones, and shells then read two."""
    return textwrap.shorten(text, 76, placeholder="...")


def _files(incomplete: str, endings: tuple[str, ...] = (".toml", ".json")) -> list[str]:
    """Folders, and files with such endings, whose paths begin so."""
    head, slash, tail = incomplete.rpartition("/")
    try:
        paths = sorted(Path(head + slash or ".").iterdir())
    except OSError:
        return []
    return [
        f"{head}{slash}{path.name}{'/' if path.is_dir() else ''}"
        for path in paths
        if path.name.startswith(tail)
        # Hidden files are offered only to who has typed the dot, as shells do.
        and (tail or not path.name.startswith("."))
        and (path.is_dir() or path.suffix in endings)
    ]


def _paths() -> Iterator[tuple[str, str]]:
    """Dotted path, and unit and meaning, of every value of a scenario."""
    from omnitrack_sim.pipes.fittings.kinds import shipped_fittings, table_of
    from omnitrack_sim.robots.control import parameters_model
    from omnitrack_sim.robots.kinds import default_robot
    from omnitrack_sim.scenario.tables import Pipe

    # Without validation, which would ask for pipes.
    scenario = ot.Scenario.model_construct()
    for name, table in scenario:
        if name == "robot":
            yield from ((f"robot.{row.name}", row.source) for row in default_robot().parameters())
        else:
            yield from _below(name, table)
    controller = next(iter(default_robot().controllers().values()))
    yield from _below("control.parameters", parameters_model(controller)())
    # Keys that several fittings have are offered once.
    keys = {
        key: meaning
        for kind in shipped_fittings()
        for key, meaning in _meanings(table_of(kind, Pipe)).items()
    }
    yield from ((f"pipes.*.{key}", meaning) for key, meaning in keys.items() if key != "kind")


def _below(path: str, table: Any) -> Iterator[tuple[str, str]]:
    """Yield path and meaning of the values of a table and of the tables in it."""
    from pydantic import BaseModel

    if not isinstance(table, BaseModel):
        return
    meanings = _meanings(type(table))
    for key, value in table:
        if isinstance(value, BaseModel):
            yield from _below(f"{path}.{key}", value)
        elif key != "parameters":
            yield f"{path}.{key}", meanings.get(key, "")


def _meanings(table: type[BaseModel]) -> dict[str, str]:
    """Unit and meaning of the keys of a table."""
    from omnitrack_sim.base.table import meanings_of, symbol_of

    return {
        key: ": ".join(filter(None, (symbol_of(table, key), meaning)))
        for key, meaning in meanings_of(table).items()
    }
