"""Template of a scenario file: all keys with units, defaults and meanings, and given values."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from omnitrack_sim.autonomy.mission import Mission
from omnitrack_sim.base.table import meanings_of, symbol_of
from omnitrack_sim.base.text import as_toml
from omnitrack_sim.pipes.fittings.kinds import shipped_fittings, table_of
from omnitrack_sim.robots.control import parameters_model
from omnitrack_sim.robots.kinds import DEFAULT
from omnitrack_sim.robots.quantity import NamedTable, Quantity, QuantityModel, quantity_of
from omnitrack_sim.robots.robot import Robot
from omnitrack_sim.scenario.model import Scenario
from omnitrack_sim.scenario.tables import Pipe, PullTable

WIDTH = 100
"""Longest line of a comment, characters."""
UNSET, INSTEAD = "#", "#: "
"""Marks before a key at its default, and before an alternative to what stands there."""
_HEAD = f"""
A key behind {UNSET} stands at its default: take the {UNSET} away to change it. (none) is a default
that no value stands for. What stands behind {INSTEAD.strip()} could be there as well or instead.
Units are SI, or degrees where a key ends in _deg. D is the bore that the robot is made for, 160 mm
times robot.scale; times in [monitor] and [control.parameters] are for 160 mm, and grow with the
square root of D.
"""
_ROBOT = "Behind a unit stands the range, and behind a meaning where the default comes from."
_SCALED = """
All values are for 160 mm pipes and are scaled together by `scale`, unless `values_at_scale` says
that they are for another size.
"""
_NAMED = "The {} as a table, in the place of its name."
_FURTHER = "Other kinds, which have the keys `name` to `inner_diameter` as well:"
_MISSION = "In the place of [[pipes]]: a network, and what the robot does in it."


def template(name: str, title: str, data: Mapping[str, Any], scenario: Scenario) -> str:
    """Return the text of a scenario file.

    Args:
        name: of the new scenario.
        title: what it shows, for its head.
        data: what the file that it begins from says, as plain data.
        scenario: that file's.

    Returns:
        TOML that is read as the same scenario of another name.
    """
    # A saved scenario.json writes every key, also those that nothing was given for.
    data = {**_without_none(data), "name": name}
    has_pipes = bool(data.get("pipes"))
    # Which controller is the default, the robot decides.
    data = data | {"control": {**data.get("control", {}), "kind": scenario.control.kind}}
    meanings = meanings_of(Scenario)
    lines = [*_comment(title), "#", *_comment(_HEAD), ""]
    for key in ("name", "seed", *(() if has_pipes else ("network",))):
        lines += _key(key, meanings[key], "", Scenario.model_fields[key].default, data)
    lines += _pipes(data["pipes"], scenario) if has_pipes else _table("mission", Mission, data)
    for key, info in Scenario.model_fields.items():
        if key == "robot":
            lines += _robot(data, scenario.robot)
        elif key == "control":
            lines += _control(data, scenario)
        elif isinstance(info.default, BaseModel):
            lines += _table(key, type(info.default), data)
        elif key == "pull":
            lines += _pull(data)
    return "\n".join([*lines, *(_other_mission() if has_pipes else ())]) + "\n"


def _without_none(value: Any) -> Any:
    """Plain data without keys that are None, which TOML cannot express."""
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value


def _comment(text: str) -> list[str]:
    """Lines of a comment."""
    return [f"# {line}" for line in textwrap.wrap(" ".join(text.split()), WIDTH - 2)]


def _key(
    key: str, meaning: str, unit: str, default: Any, values: Mapping[str, Any], mark: str = UNSET
) -> list[str]:
    """Lines of one key: its value, or its default after ``mark``, then unit and meaning."""
    if key in values:
        pair = f"{key} = {as_toml(values[key])}"
    else:
        pair = f"{mark}{key} = {_default_text(default)}"
    unit = "" if unit == "1" else unit
    whole = f"{pair}  # {': '.join(filter(None, (unit, meaning)))}"
    if len(whole) <= WIDTH:
        return [whole if unit or meaning else pair]
    if len(pair) > WIDTH and isinstance(values.get(key), list):
        items = [f"  {as_toml(item)}," for item in values[key]]
        return [*_comment(meaning), f"{key} = [", *items, "]"]
    return [*_comment(meaning), f"{pair}  # {unit}" if unit else pair]


def _default_text(default: Any) -> str:
    """A default as TOML, or a word for one that has no such form."""
    if default is PydanticUndefined:
        return "(needed)"
    return "(none)" if default is None else as_toml(to_jsonable_python(default))


def _keys(
    model: type[BaseModel], values: Mapping[str, Any], mark: str = UNSET
) -> Iterator[tuple[str, list[str]]]:
    """Keys of a table that are no tables themselves, with their lines."""
    meanings = meanings_of(model)
    for key, info in model.model_fields.items():
        default = info.get_default(call_default_factory=True)
        # Tables have heads of their own; which parameters there are, the controller decides.
        if not isinstance(default, BaseModel) and key != "parameters":
            if issubclass(model, QuantityModel):
                yield key, _figure(key, quantity_of(model, key), default, values, mark)
                continue
            unit = symbol_of(model, key)
            yield key, _key(key, meanings.get(key, ""), unit, default, values, mark)


def _table(path: str, model: type[BaseModel], above: Mapping[str, Any]) -> list[str]:
    """Lines of a table, and of those in it; ``above`` is the table that it stands in."""
    values = above.get(path.rpartition(".")[2], {})
    lines = ["", *_comment(_first_paragraph(model)), f"[{path}]"]
    lines += [line for _, rows in _keys(model, values) for line in rows]
    for key, info in model.model_fields.items():
        default = info.get_default(call_default_factory=True)
        if isinstance(default, BaseModel):
            lines += _table(f"{path}.{key}", type(default), values)
    return lines


def _first_paragraph(model: type[BaseModel]) -> str:
    """The first paragraph of a table's docstring, which is written for users of files."""
    return (model.__doc__ or "").partition("\n\n")[0].replace("``", "`")


def _pull(data: Mapping[str, Any]) -> list[str]:
    """The pull at the tail, which could be there where none is."""
    if "pull" in data:
        return _table("pull", PullTable, data)
    return ["", *_comment(_first_paragraph(PullTable)), *_instead("pull", PullTable)]


def _instead(path: str, model: type[BaseModel]) -> list[str]:
    """Lines of a table that could be there, without the tables in it."""
    keys = (line for _, rows in _keys(model, {}, INSTEAD) for line in rows)
    return [f"{INSTEAD}[{path}]", *keys]


def _other_mission() -> list[str]:
    """Keys of a mission, for a scenario that has none."""
    network = _key("network", meanings_of(Scenario)["network"], "", "fig14", {}, INSTEAD)
    return ["", *_comment(_MISSION), *network, *_instead("mission", Mission)]


def _pipes(pipes: list[Mapping[str, Any]], scenario: Scenario) -> list[str]:
    """The pipes, and the shipped kinds that are not among them; each meaning stands there once."""
    lines = ["", *_comment(meanings_of(Scenario)["pipes"])]
    explained: set[str] = set()
    for values, pipe in zip(pipes, scenario.pipes, strict=True):
        model = table_of(pipe.kind, Pipe)
        meanings = meanings_of(model)
        lines += ["", "[[pipes]]"]
        for key in ("kind", *(key for key in model.model_fields if key != "kind")):
            meaning = meanings.get(key, "")
            once = "" if meaning in explained else meaning
            lines += _key(key, once, symbol_of(model, key), getattr(pipe, key), values)
            explained.add(meaning)
    return [*lines, *_further_fittings({pipe.kind for pipe in scenario.pipes})]


def _further_fittings(kinds: set[str]) -> list[str]:
    """Keys of the shipped kinds of pipe other than ``kinds``."""
    common = {*Pipe.model_fields, "inner_diameter"}
    lines = ["", *_comment(_FURTHER)]
    for kind in shipped_fittings():
        if kind not in kinds:
            lines += [f"{INSTEAD}[[pipes]]", f'{INSTEAD}kind = "{kind}"']
            keys = _keys(table_of(kind, Pipe), {}, INSTEAD)
            lines += [line for key, rows in keys if key not in common for line in rows]
    return lines


def _robot(data: Mapping[str, Any], robot: Robot) -> list[str]:
    """The parameters of a robot; its tables, such as that of a motor, stand at the end."""
    model, given = type(robot), data.get("robot")
    values = given if isinstance(given, Mapping) else {}
    tables = {
        key: default
        for key, info in model.model_fields.items()
        if isinstance(default := info.get_default(call_default_factory=True), BaseModel)
    }
    scaled = _SCALED if "values_at_scale" in model.model_fields else ""
    lines = ["", *_comment(_first_paragraph(model)), *_comment(f"{_ROBOT} {scaled}"), "[robot]"]
    lines += [] if robot.kind == DEFAULT else [f"kind = {as_toml(robot.kind)}"]
    lines += [line for _, rows in _keys(model, values) for line in rows]
    for key, table in tables.items():
        if isinstance(table, NamedTable) and not isinstance(values.get(key), Mapping):
            lines += _figure(key, quantity_of(model, key), table.name, values)
    # In TOML all that follows the head of a table belongs to it: tables must come last.
    for key, table in tables.items():
        if isinstance(table, NamedTable):
            lines += _named(f"robot.{key}", table, values.get(key))
        else:
            lines += _table(f"robot.{key}", type(table), values)
    return lines


def _named(path: str, default: NamedTable, given: Any) -> list[str]:
    """A table that may be given by its name, as ``given``; else as what could be there instead."""
    model = type(default)
    values = given if isinstance(given, Mapping) else {}
    mark = UNSET if values else INSTEAD
    like = [f"like = {as_toml(values['like'])}"] if "like" in values else []
    comment = [] if values else _comment(_NAMED.format(path.rpartition(".")[2].replace("_", " ")))
    head = f"[{path}]" if values else f"{INSTEAD}[{path}]"
    shipped = model.shipped()[values.get("like", default.name)]
    lines = ["", *comment, head, *like]
    for key, info in model.model_fields.items():
        value = info.default if key in ("name", "source") else getattr(shipped, key)
        lines += _figure(key, quantity_of(model, key), value, values, mark)
    return lines


def _figure(
    key: str, quantity: Quantity, default: Any, values: Mapping[str, Any], mark: str = UNSET
) -> list[str]:
    """Lines of one parameter of the robot, or figure of a motor."""
    unit = "" if quantity.unit == "1" else quantity.unit
    if quantity.within is not None:
        unit = ", ".join(filter(None, (unit, "{:g} to {:g}".format(*quantity.within))))
    return _key(key, f"{quantity.source} ({quantity.provenance})", unit, default, values, mark)


def _control(data: Mapping[str, Any], scenario: Scenario) -> list[str]:
    """The controller's table, and the one that only it has."""
    model = parameters_model(scenario.controller_class)
    own = _table("control.parameters", model, data.get("control", {}))
    return [*_table("control", type(scenario.control), data), *own]
