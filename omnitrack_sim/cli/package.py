"""scenarios, parameters, models, new, policies: contents of the package, and new scenario files."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

import omnitrack_sim as ot
from omnitrack_sim.base.errors import Fault, InputError, OutputError, ScenarioError
from omnitrack_sim.cli import complete
from omnitrack_sim.cli.common import (
    JsonOption,
    app,
    load,
    out,
    plain,
    print_json,
    print_table,
)
from omnitrack_sim.cli.word_table import WordTable

_HASH = re.compile(r"[0-9a-f]{64}")


@app.command()
def scenarios(as_json: JsonOption = False) -> None:
    """List the scenarios, sweeps, studies and networks of the package.

    `omnitrack run`, `sweep`, `optimise` and `network NAME` find them.
    """
    from omnitrack_sim.base.reading import KINDS, SCENARIO

    rows: dict[str, str] = {}
    for kind in KINDS:
        files = kind.shipped()
        texts = {name: complete.comment(path) for name, path in files.items()}
        for name, text in texts.items():
            # Scenarios go by their bare names, as `run` takes them; the others behind their folder.
            rows[name if kind is SCENARIO else f"{files[name].parent.name}/{name}"] = text
        if not as_json:
            print_table((kind.noun, "what it shows"), texts.items())
    if as_json:
        print_json(rows)


@app.command()
def parameters(
    robot: Annotated[
        str | None,
        typer.Argument(
            metavar="[ROBOT]",
            help="A kind of robot, an MJCF or URDF file, or a scenario whose robot is shown; the "
            "default one if left out.",
            autocompletion=complete.robots,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """A robot's parameters with unit, range, provenance and source."""
    rows = _robot(robot).parameters()
    if as_json:
        print_json([vars(row) for row in rows])
        return
    columns = ("parameter", "value", "range", "unit", "provenance", "source")
    table = WordTable(*columns, gap=1)
    for row in rows:
        value = f"{row.value:.6g}" if isinstance(row.value, float) else str(row.value)
        within = "" if row.within is None else "{:.6g} to {:.6g}".format(*row.within)
        if _HASH.fullmatch(value):
            value = f"{value[:12]}..."  # whole in JSON
        table.add_row(row.name, plain(value), within, row.unit, row.provenance, plain(row.source))
    out.print(table)


def _robot(source: str | None) -> ot.Robot:
    """Return the robot of a kind, a model file or a scenario; None: the default one."""
    from omnitrack_sim.base.naming import trusting
    from omnitrack_sim.base.reading import checked
    from omnitrack_sim.robots.kinds import DEFAULT, is_model_file, robot_class, robot_kinds

    kind = source or DEFAULT
    # Of a model file with what a run finds in it: forward axis, bore, servos.
    if is_model_file(kind) or (kind not in robot_kinds() and ":" not in kind):
        return load(kind, None).robot
    with trusting():
        model = robot_class(kind)
    needed = [name for name, field in model.model_fields.items() if field.is_required()]
    if needed:
        problem = (
            f"needs {' and '.join(needed)}, which a kind alone does not give: name a scenario "
            "instead whose table [robot] has them"
        )
        raise InputError(Fault(kind, problem))
    return checked(model, {}, InputError)


@app.command()
def models(
    check: Annotated[
        bool, typer.Option("--check", help="Say which files differ; status 1 if any does.")
    ] = False,
    write: Annotated[bool, typer.Option("--write", help="Write the files.")] = False,
    root: Annotated[Path, typer.Option(help="Folder that holds models/ and assets/.")] = Path(),
) -> None:
    """Check or write the published MJCF models and meshes."""
    from omnitrack_sim.robots.omnitrack.published import check_models, write_models

    # Neither is the default: one of them changes files, the other one only reads.
    if check == write:
        raise ScenarioError(
            Fault("omnitrack models", "say one of --check and --write", ("--check", "--write"))
        )
    folders = root / "models", root / "assets"
    if write:
        out.print(f"wrote {len(write_models(*folders))} files below {root.resolve()}")
        return
    different = check_models(*folders)
    for name in different:
        out.print(f"differs: {name}")
    out.print(
        "models and assets are up to date" if not different else "run `omnitrack models --write`"
    )
    raise typer.Exit(1 if different else 0)


@app.command()
def new(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the scenario; NAME.toml is written.")
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="SCENARIO",
            help="Scenario whose values it takes: a file or a name.",
            autocompletion=complete.scenarios,
        ),
    ] = "tee_turn",
    robot: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="MJCF or URDF file of a robot: a short scenario for it in a straight pipe, and "
            "NAME_control.py, a controller to fill in.",
        ),
    ] = None,
    body: Annotated[
        str, typer.Option(metavar="BODY", help="Its chassis, where several could be it.")
    ] = "",
) -> None:
    """Write a scenario file with all keys, their units, defaults and meanings.

    With `--robot` it looks at a model and writes what it finds: bore, forward axis, wheels.
    """
    from omnitrack_sim.base.writing import check_file, write_file

    target = _target(name)
    if robot is None:
        texts = {target: _text(target, source)}
    else:
        texts = _texts_of_robot(target, robot, body)
    for file in texts:
        check_file(file)
        # A link that leads nowhere counts, too: writing would follow it.
        if os.path.lexists(file):
            raise OutputError(f"{file}: exists already; choose another name or take it away")
    for file, text in texts.items():
        write_file(file, text.encode())
    written = " and ".join(plain(str(file)) for file in texts)
    out.print(f"wrote {written}; `omnitrack run {plain(str(target))}` runs it")


def _texts_of_robot(target: Path, robot: str, body: str) -> dict[Path, str]:
    """Return the texts of a scenario for the robot of a model file, and of its controller."""
    from omnitrack_sim.sim.model_template import model_template

    template = model_template(target.stem, robot, target.parent, body)
    controller = target.with_name(f"{template.module}.py")
    return {target: template.scenario, controller: template.controller}


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
    from omnitrack_sim.scenario.template import template

    path, data = read_file(source, SCENARIO, ScenarioError)
    scenario = ot.load_scenario(source)
    title = f"{comment(path)} From the scenario {scenario.name}."
    return template(target.stem, title.strip(), _moved(data, path, target), scenario)


def _moved(data: dict[str, Any], path: Path, target: Path) -> dict[str, Any]:
    """The data of a file for one that may stand elsewhere: its paths lead to the same files."""
    from omnitrack_sim.robots.kinds import robot_in_full

    robot = robot_in_full(data.get("robot"))
    if isinstance(robot, Mapping) and "file" in robot:
        data = data | {"robot": {**robot, "file": _moved_file(robot["file"], path, target)}}
    if "network" in data:
        data = data | {"network": _moved_file(data["network"], path, target)}
    return data


def _moved_file(name: Any, path: Path, target: Path) -> Any:
    """The path of a file that a scenario at ``path`` names, for one at ``target``."""
    from omnitrack_sim.base.reading import beside

    place = beside(path.parent, name) if isinstance(name, str) else name
    # Relative to the new file, so that both can be moved together; a shipped one has a name.
    return os.path.relpath(place, target.parent) if isinstance(place, Path) else name


@app.command()
def policies(
    policy: Annotated[
        str | None,
        typer.Argument(
            help="Policy to check and describe: a file or a shipped one.",
            autocompletion=complete.policies,
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the policies of the package, or describe one; `control.parameters.policy` names one."""
    if policy is not None:
        _print_policy(ot.load_policy(policy), as_json)
        return
    shipped = {name: ot.load_policy(path) for name, path in ot.shipped_files("policies").items()}
    if as_json:
        print_json({name: _contents(one) for name, one in shipped.items()})
        return
    if not shipped:
        out.print("the package comes with none; docs/how-to/policies.md says what a policy file is")
        return
    rows = [(name, one.acting.name, repr(one.network), one.note) for name, one in shipped.items()]
    print_table(("policy", "acts", "network", "what it is"), rows)


def _print_policy(policy: ot.Policy, as_json: bool) -> None:
    contents = _contents(policy)
    if as_json:
        print_json(contents)
        return
    table = WordTable()
    table.show_header = False
    for key, value in contents.items():
        text = value if isinstance(value, str) else ", ".join(value)
        table.add_row(key, plain(text))
    out.print(table)


def _contents(policy: ot.Policy) -> dict[str, Any]:
    """Return what a policy is, by words."""
    base = f", added to {policy.acting.base}" if policy.acting.base else ""
    return {
        "acts": f"{policy.acting.name}{base}",
        "network": repr(policy.network),
        "features": list(policy.features),
        "note": policy.note,
        "sha256": policy.sha256,
    }
