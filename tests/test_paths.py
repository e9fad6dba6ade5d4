"""Dotted paths: one grammar for ``--set``, axes of sweeps, variables of studies, and messages."""

from __future__ import annotations

import copy
import random
from typing import Any

import pytest
from pydantic import Field

from omnitrack_sim.base.paths import Document, expand, keys_of, matches, value_at
from omnitrack_sim.base.table import Table


class Pipe(Table):
    length: float = 1.0
    turn_deg: float = 0.0


class World(Table):
    friction: float = 0.8
    gravity: tuple[float, ...] = (0.0, 0.0, -9.81)


class File(Table):
    world: World = World()
    pipes: tuple[Pipe, ...] = ()
    parameters: dict[str, Any] = Field(default_factory=dict)


def drawn(draw: random.Random, depth: int = 4) -> Any:
    """Plain data: tables and lists in each other, of random sizes."""
    kind = draw.choice(["value", "list", "table"]) if depth < 4 else draw.choice(["list", "table"])
    if kind == "value" or depth == 0:
        return draw.choice([None, 1, "text"])
    items = [drawn(draw, depth - 1) for _ in range(draw.randrange(4))]
    return items if kind == "list" else dict(zip(["a", "0", "*"], items, strict=False))


SAMPLES = [drawn(random.Random(seed)) for seed in range(200)]


def places(data: Any, before: str = "") -> list[str]:
    """Every path into plain data."""
    items = enumerate(data) if isinstance(data, list) else getattr(data, "items", tuple)()
    return [
        place
        for key, value in items
        for place in (f"{before}{key}", *places(value, f"{before}{key}."))
    ]


EVERY = [(data, place) for data in SAMPLES for place in places(data)]


def test_what_is_there_is_found_at_its_path() -> None:
    """Each path into data stands for itself, and for its value."""
    for data, place in EVERY:
        assert matches(data, place) == [place]
        value = data
        for key in keys_of(place):
            value = value[int(key)] if isinstance(value, list) else value[key]
        assert value_at(data, place) is value


def test_a_star_stands_for_every_item_of_a_list() -> None:
    """The paths with items in place of stars are those that the path with stars stands for."""
    for data, place in EVERY:
        every = places(data)
        keys = keys_of(place)
        for depth in range(len(keys)):
            if not isinstance(value_at(data, ".".join(keys[:depth])), list):
                continue
            starred = ".".join([*keys[:depth], "*", *keys[depth + 1 :]])
            found = matches(data, starred)
            assert place in found
            assert set(found) == {one for one in expand(data, starred) if one in every}


@pytest.mark.parametrize("key", ["+0", "00", "-1", "1_0", "2", "٠", "0x0", " 0", "9" * 5000, ""])
def test_what_is_no_plain_index_leads_nowhere(key: str) -> None:
    """Neither in what is read nor in what is set; the choices are the indices."""
    data = {"pipes": [{}, {}]}
    assert matches(data, f"pipes.{key}") == []
    assert value_at(data, f"pipes.{key}") is None
    fault = Document(File, data).set(f"pipes.{key}.length", 2.0)
    assert fault is not None
    assert fault.choices == ("0", "1")


def test_tables_on_the_way_are_filled_with_their_defaults() -> None:
    """A number of a vector that the data leaves out is set in the default vector."""
    data: dict[str, Any] = {}
    assert Document(File, data).set("world.gravity.2", 0.0) is None
    assert data["world"]["gravity"] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("world.fiction", "there is no 'fiction' here"),
        ("world.gravity.3", "there is no '3' here"),
        ("world.friction.x", "'x' is below a plain value"),
        ("friction", "is the end of a path"),
        ("", "there is no '' here"),
    ],
)
def test_a_path_to_nowhere_leaves_the_data_as_it_is(path: str, told: str) -> None:
    """Its fault has the path and says what is wrong."""
    data = {"pipes": [{"length": 2.0}]}
    before = copy.deepcopy(data)
    fault = Document(File, data).set(path, 1.0)
    assert fault is not None
    assert fault.where == path
    assert told in str(fault)
    assert data == before


def test_open_tables_take_any_key_and_tell_those_that_are_known() -> None:
    """Their model comes from the whole of the data."""
    document = Document(
        File, {"world": {"friction": 1}}, {("parameters",): lambda data: type(World())}
    )
    assert document.keys_at(["parameters"]) == ("friction", "gravity")
    assert document.set("parameters.own", 1.0) is None
    assert "parameters.gravity" in document.paths()


def test_of_items_only_those_that_may_have_the_key_are_meant() -> None:
    """By what they hold, or by their model; where none may, the path stays for the message."""
    document = Document(File, {"pipes": [{"length": 2.0}, {}]})
    assert document.expand("pipes.*.length") == ["pipes.0.length", "pipes.1.length"]
    assert document.expand("pipes.*.width") == ["pipes.*.width"]
    assert document.expand("world.friction") == ["world.friction"]
