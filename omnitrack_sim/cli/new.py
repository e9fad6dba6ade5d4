"""new: a scenario file to begin with."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from omnitrack_sim.base.errors import Fault, InputError, OutputError, ScenarioError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import app, out, plain

if TYPE_CHECKING:
    pass


@app.command()
def new(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Of the scenario; NAME.toml is written.")
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="SCENARIO",
            help="Whose values it has: a file or a name.",
            autocompletion=complete.scenarios,
        ),
    ] = "tee_turn",
) -> None:
    """Write a scenario file with all keys, their units, defaults and meanings."""
    from omnitrack_sim.base.writing import check_file, write_file

    target = _target(name)
    check_file(target)
    if os.path.lexists(target):
        raise OutputError(f"{target}: exists already; choose another name or take it away")
    write_file(target, _text(target, source).encode())
    out.print(f"wrote {plain(str(target))}; `omnitrack run {plain(str(target))}` runs it")


def _target(name: str) -> Path:
    """The file of a scenario's name, which may stand behind the path of a folder."""
    from omnitrack_sim.base.reading import NAME_PATTERN

    path = Path(name.removesuffix(".toml"))
    if not re.fullmatch(NAME_PATTERN, path.name):
        problem = f"is {name!r}; a scenario's name has no leading dot and no control characters"
        raise InputError(Fault("NAME", problem))
    return path.with_name(f"{path.name}.toml")


def _text(target: Path, source: str) -> str:
    """The text of the new file, which is read as the scenario that it begins from."""
    from omnitrack_sim.base.reading import SCENARIO, read_file
    from omnitrack_sim.cli.complete import comment
    from omnitrack_sim.scenario import load_scenario
    from omnitrack_sim.scenario.template import template

    path, data = read_file(source, SCENARIO, ScenarioError)
    scenario = load_scenario(source)
    title = f"{comment(path)} From the scenario {scenario.name}."
    return template(target.stem, title.strip(), _moved(data, path, target), scenario)


def _moved(data: dict[str, Any], path: Path, target: Path) -> dict[str, Any]:
    """The data of a file for one that may stand elsewhere: the path of a network leads there."""
    from omnitrack_sim.base.reading import beside

    network = data.get("network")
    if not isinstance(network, str):
        return data
    found = beside(path.parent, network)
    if isinstance(found, str):
        return data  # the name of a shipped one
    return data | {"network": os.path.relpath(found, target.parent)}
