"""Networks of drawings of towns, and of the files that they come from."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from commands import omnitrack
from fuzzing.bases import TOWN
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.rotations import length
from omnitrack_sim.cli import app
from omnitrack_sim.pipes import importing
from omnitrack_sim.pipes.importing import wntr_towns
from omnitrack_sim.pipes.importing.assumptions import ImportSettings
from omnitrack_sim.pipes.importing.building import build
from omnitrack_sim.pipes.importing.drawing import (
    ROOM_AT_PUMP,
    Drawing,
    DrawnPipe,
    without_straight,
)
from omnitrack_sim.pipes.importing.epanet import _in_space

BORE = 0.16


def drawing(nodes: dict, pipes: list, bores: dict | None = None, **lines: list) -> Drawing:
    """Pipes between nodes at (x, y) or (x, y, z) m; ``lines`` have points between them."""
    places = {name: np.array([*place, 0.0][:3], float) for name, place in nodes.items()}
    legs = {}
    for pair in pipes:
        a, b = pair.split("-")
        inner = [np.array([*point, 0.0][:3], float) for point in lines.get(f"{a}_{b}", [])]
        points = np.array([places[a], *inner, places[b]])
        legs[pair] = DrawnPipe(pair, pair, (a, b), points, (bores or {}).get(pair, BORE))
    return Drawing(places, legs, {name: leg.length for name, leg in legs.items()})


def town(nodes: dict, pipes: list, bores: dict | None = None, **lines: list) -> ot.Import:
    return build("town", drawing(nodes, pipes, bores, **lines), ImportSettings())


def around(count: int, angles: list[float] | None = None, far: float = 10.0) -> dict:
    """A node at the origin and others around it, at angles in degrees."""
    angles = angles or [360 / count * k for k in range(count)]
    turned = [(far * math.cos(math.radians(a)), far * math.sin(math.radians(a))) for a in angles]
    return {"hub": (0.0, 0.0)} | {f"n{k}": place for k, place in enumerate(turned)}


def star(*angles: float, **more: object) -> ot.Import:
    return town(around(0, list(angles)), [f"hub-n{k}" for k in range(len(angles))], **more)


def kinds(imported: ot.Import) -> list[str]:
    return sorted(f.kind for f in imported.network.fittings if f.kind not in ("straight", "cap"))


@pytest.mark.parametrize(
    ("angles", "expected"),
    [
        ((0, 180), []),
        ((0, 177), ["mitre"]),
        ((0, 120), ["elbow"]),
        ((0, 180, 90), ["tee"]),
        ((0, 180, 88), ["mitre", "tee"]),
        ((0, 180, 60), ["wye"]),
        ((0, 180, 20), ["elbow", "wye"]),
        ((0, 120, 240), ["elbow", "elbow", "tee"]),
        ((0, 90, 180, 270), ["cross"]),
        ((0, 60, 180, 240), ["cross"]),
        ((0, 60, 180, 270), ["cross", "elbow", "elbow"]),
    ],
)
def test_a_node_becomes_the_fitting_of_its_pipes(angles, expected):
    """By the angles between them; what a fitting has no direction for is a bend behind it."""
    imported = star(*angles)
    assert kinds(imported) == expected
    assert imported.length_ratio == pytest.approx(1, abs=0.01)
    assert not imported.of("left out")


def test_bores_that_differ_meet_in_reducers():
    """The run is as wide as the widest pipe; a branch far smaller gets a reducer behind it."""
    bores = {"hub-n0": 0.3, "hub-n1": 0.2, "hub-n2": 0.05}
    imported = star(0, 180, 90, bores=bores)
    assert kinds(imported) == ["reducer", "reducer", "wye"]
    wye = next(f for f in imported.network.fittings if f.kind == "wye").fitting()
    assert wye.inner_diameter == 0.3
    assert wye.port_radius("branch") == pytest.approx(0.06)


def test_five_pipes_of_a_node_become_a_cross_and_a_tee():
    """The narrowest of them leaves another beside the node, and the note says where."""
    imported = star(0, 72, 144, 216, 288, bores={"hub-n2": 0.1})
    found = kinds(imported)
    assert "cross" in found
    assert {"tee", "wye"} & set(found)
    (note,) = imported.of("mended")
    assert note.where == "node hub"
    assert "joins 5 pipes: pipe hub-n2" in note.problem


@pytest.mark.parametrize("count", [5, 6, 8])
@pytest.mark.parametrize("away", [True, False])
def test_crowds_of_pipes_are_split_until_four_are_left(count, away):
    """Whichever way pipes were drawn: they end at their nodes, and those that leave a node leave
    the pipe that they are most nearly square to."""
    pipes = [f"hub-n{k}" if away else f"n{k}-hub" for k in range(count)]
    bores = {name: 0.1 + 0.01 * k for k, name in enumerate(pipes)}
    drawn = drawing(around(count), pipes, bores)
    drawn.split_crowds()
    assert max(map(len, drawn.at_nodes().values())) == 4
    assert len(drawn.at_nodes()["hub"]) == 4
    for leg in drawn.legs.values():
        assert [drawn.nodes[node] for node in leg.ends] == pytest.approx(leg.points[[0, -1]])
    taps = [node for node in drawn.nodes if node not in around(count)]
    assert len(taps) == count - 4
    assert all(length(drawn.nodes[tap]) == pytest.approx(8 * 0.17, abs=1.0) for tap in taps)


def test_a_town_of_rings_closes():
    """Streets in a grid, on a slope and bent: every ring closes, and lengths are kept."""
    rng = np.random.default_rng(4)
    grid = {
        f"{i}{j}": (40 * i + rng.uniform(-6, 6), 30 * j + rng.uniform(-6, 6), rng.uniform(0, 3))
        for i in range(5)
        for j in range(5)
    }
    pipes = [f"{i}{j}-{i + 1}{j}" for i in range(4) for j in range(5)]
    pipes += [f"{i}{j}-{i}{j + 1}" for i in range(5) for j in range(4)]
    bores = {pipe: float(rng.choice([0.1, 0.15, 0.2])) for pipe in pipes}
    bent = {"00_10": [(15, 4), (25, 9)], "11_12": [(38, 40)]}
    imported = town(grid, pipes, bores, **bent)
    assert not imported.of("left out")
    assert imported.length_ratio == pytest.approx(1, abs=1e-3)
    network = imported.network
    for (i, one), (j, other) in network.pipes.joints:
        a, b = network.pipes.parts[i].port(one), network.pipes.parts[j].port(other)
        assert length(a.position - b.position) < 1e-8
        assert length(a.rotation[:, 2] + b.rotation[:, 2]) < 1e-8
    assert len(network.ports) == 0


def test_a_short_pipe_gets_room_or_is_left_out_between_plates():
    """Nodes move by what is missing, up to a metre; else a plate stands where pipes go on."""
    nodes = {"a": (0, 0), "b": (0.1, 0), "c": (-9, 0), "d": (9, 0), "e": (0, 9), "f": (0.1, -9)}
    pipes = ["a-b", "c-a", "b-d", "a-e", "b-f"]
    imported = town(nodes, pipes)
    assert any("is moved by" in note.problem for note in imported.of("mended"))
    assert not imported.of("left out")
    still = build("town", drawing(nodes, pipes), ImportSettings(move=0.0))
    assert {note.where for note in still.of("left out")} == {"pipe a-b", "pipe c-a", "pipe a-e"}
    assert any("shorter than its fittings" in note.problem for note in still.of("left out"))
    assert "b:plate" in {part.name for part in still.network.fittings}


def test_pipes_that_cross_without_a_node_pass_under_each_other():
    """The narrower one is lowered; the network has no overlap."""
    nodes = {"w": (-20, 0), "e": (20, 0), "s": (0, -20), "n": (0, 20)}
    imported = town(nodes, ["w-e", "s-n"], {"w-e": 0.2, "s-n": 0.1})
    (note,) = imported.of("mended")
    assert note.where == "pipe s-n"
    assert "passes under it" in note.problem
    low = min(part.pose.position[2] for part in imported.network.pipes.parts)
    assert low < -0.2


def test_part_of_a_network_lies_where_the_whole_does():
    """A few fittings with what is beside them, in their places; apart, each group by itself."""
    network = star(0, 90, 180, 270).network
    names = [f.name for f in network.fittings]
    part = network.around(["hub"], reach=0.5)
    assert {f.name for f in part.fittings} == {"hub", *(n for n in names if ":1" in n or "-" in n)}
    for mine in part.pipes.parts:
        (theirs,) = (p for p in network.pipes.parts if p.name == mine.name)
        assert np.allclose(mine.pose.position, theirs.pose.position)
        assert np.allclose(mine.pose.rotation, theirs.pose.rotation)
    with pytest.raises(ot.NetworkError, match="there is no fitting"):
        network.around(["nothing"])


def test_a_town_of_epanet(tmp_path):
    """Pumps are left out, a closed pipe has a plate, a height of 0 among others is mended; the
    command lists all of it."""
    file, toml = tmp_path / "small.inp", tmp_path / "small.toml"
    file.write_text(TOWN)
    run = CliRunner().invoke(app, ["import", str(file), "--out", str(toml)], env={"COLUMNS": "200"})
    assert run.exit_code == 0, run.output
    for text in ("link u", "is a pump", "pipe p3", "is closed", "220.0 m"):
        assert text in run.output
    network = ot.load_network(toml)
    assert network.name == "small"
    assert {"R", "D"} <= set(network.ports)
    schematic = TOWN.replace("B 150 0", "B 900 0").replace("D 150 30", "D 900 700")
    file.write_text(schematic.replace("A 100 0", "A 10 0"))
    with pytest.raises(ot.NetworkError, match="schematic drawing"):
        ot.import_network(file)


@pytest.mark.parametrize(("profile", "height"), [("low", 10.0), ("high", 12.0)])
def test_a_pipe_lies_level_and_rises_at_one_end(tmp_path, profile, height):
    """By option at the height of its lower or higher end, joined to the other by a slope of 45
    degrees; the parts know their pipe, and the assumption is listed."""
    file = tmp_path / "small.inp"
    file.write_text(TOWN)
    imported = ot.import_network(file, profile=profile)
    network = imported.network
    pipes = zip(network.fittings, network.pipes.parts, strict=True)
    lines = [
        part.axes[0][0].at(np.array([0.0, part.axes[0][0].length]))[0]
        for fitting, part in pipes
        if fitting.pipe == "p1" and fitting.kind == "straight"
    ]
    longest = max(lines, key=lambda line: length(line[1] - line[0]))
    assert longest[:, 2] == pytest.approx([height, height], abs=1e-6)
    rises = [line for line in lines if abs(line[1, 2] - line[0, 2]) > 1]
    (rise,) = rises
    assert abs(rise[1, 2] - rise[0, 2]) == pytest.approx(abs(rise[1, 0] - rise[0, 0]), rel=1e-6)
    assert any("45 degrees" in note.problem for note in imported.of("assumed"))
    there, built = imported.lengths["p1"]
    assert built == pytest.approx(there + 2 * (math.sqrt(2) - 1), abs=0.2)  # bends cut corners


@pytest.mark.parametrize("profile", ["even", "low", "high"])
@pytest.mark.parametrize("heights", [(3.0, 9.0), (9.0, 3.0), (3.0, 3.2)])
def test_a_pipe_in_space_rises_where_its_profile_says(profile, heights):
    """By 45 degrees beside the higher of its ends or beside the lower, ten bores of level pipe from
    it; evenly, or where there is no room for that. It keeps to its line on the map."""
    line, bore = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 10.0]]), 0.15
    for bent in (line, line / 10):
        points = _in_space(bent, heights, profile, bore)
        steps = np.diff(points, axis=0)
        run, rise = np.linalg.norm(steps[:, :2], axis=1), np.abs(steps[:, 2])
        assert points[[0, -1], 2] == pytest.approx(heights)
        assert run.sum() == pytest.approx(np.linalg.norm(np.diff(bent, axis=0), axis=1).sum())
        assert rise.sum() == pytest.approx(abs(heights[1] - heights[0]))
        if profile == "even" or bent is not line or rise.sum() < 1:
            assert rise == pytest.approx(run * rise.sum() / run.sum())
            continue
        (at,) = np.flatnonzero(rise > 1e-9)
        assert rise[at] == pytest.approx(run[at])
        end = np.argmax(heights) if profile == "low" else np.argmin(heights)
        beside = run[:at].sum() if end == 0 else run[at + 1 :].sum()
        assert beside == pytest.approx(10 * bore)


def test_pipes_that_lie_in_each_other_are_laid_apart():
    """Two pipes drawn through each other along one street, from one node: one is laid below."""
    nodes = {"a": (0, 0), "b": (60, 0.2), "c": (60, -20), "d": (-20, 0)}
    line = {"a_c": [(20, 3), (40, -3), (50, -10)]}
    imported = town(nodes, ["a-b", "a-c", "d-a"], {"a-c": 0.1}, **line)
    assert not imported.of("left out")
    assert any("is laid below" in note.problem for note in imported.of("mended"))


def test_a_town_of_wntr_is_imported_by_its_name(tmp_path):
    """As its file is; of a name that there is not, those that there are, are told."""
    command = ("import", "Net1", "--scale", "30", "--out", "net.toml")
    assert omnitrack(*command, cwd=tmp_path).returncode == 0
    file = wntr_towns()["Net1"]
    assert file.suffix == ".inp"
    written = (tmp_path / "net.toml").read_text(encoding="utf-8")
    assert written == ot.import_network(file, scale=30).network.to_toml()
    missing = omnitrack("import", "Net7", cwd=tmp_path)
    assert missing.returncode == 2
    told = " ".join(missing.stderr.split())
    assert "Net7: no such file, nor a town of wntr of that name" in told
    assert "did you mean 'Net" in told


def test_without_wntr_a_town_by_name_says_what_has_some(monkeypatch):
    """And how it is installed."""
    monkeypatch.setattr(importing, "find_spec", lambda _: None)
    with pytest.raises(ot.NetworkError, match=r"pip install 'omnitrack_sim\[town\]'"):
        ot.import_network("ky10")


def test_names_of_pieces_count_from_one():
    """The first number that no pipe and no node has."""
    map_of_a_pipe = drawing({"a": (0, 0), "b+1": (9, 0)}, ["a-b+1"])
    assert map_of_a_pipe.new_name("a") == "a+1"
    assert map_of_a_pipe.new_name("b") == "b+2"
    map_of_a_pipe.close("a-b+1")
    assert set(map_of_a_pipe.legs) == {"a-b+1", "a-b+1+1'"}


@pytest.mark.parametrize("order", [("a-p", "q-b"), ("p-a", "b-q")])
def test_pipes_at_a_pump_end_apart(order):
    """Each gives up the same piece, at its end at the pump, whichever way it is drawn."""
    apart = drawing({"a": (0, 0), "p": (10, 0), "q": (10, 0), "b": (20, 0)}, list(order))
    long = {name: leg.length for name, leg in apart.legs.items()}
    apart.part("p", "q")
    given_up = {name: long[name] - leg.length for name, leg in apart.legs.items()}
    assert given_up == pytest.approx(dict.fromkeys(order, ROOM_AT_PUMP))
    for name, x in (("a", 0), ("b", 20), ("p", 10 - ROOM_AT_PUMP), ("q", 10 + ROOM_AT_PUMP)):
        assert apart.nodes[name] == pytest.approx([x, 0, 0])
    for leg in apart.legs.values():
        for end, node in enumerate(leg.ends):
            assert leg.points[-end] == pytest.approx(apart.nodes[node])
    far = drawing({"a": (0, 0), "p": (10, 0), "q": (12, 0), "b": (20, 0)}, list(order))
    far.part("p", "q")
    assert far.nodes["p"] == pytest.approx([10, 0, 0])


def test_a_line_loses_points_that_it_passes_near():
    """Those kept are the farthest of what is left, and none that is left out is farther off."""
    rng = np.random.default_rng(5)
    for _ in range(30):
        line = np.cumsum(rng.normal(size=(20, 3)), axis=0)
        tolerance = rng.uniform(0.2, 2.0)
        kept = without_straight(line, tolerance)
        rows = [int(np.flatnonzero((line == point).all(axis=1))[0]) for point in kept]
        assert rows[0] == 0
        assert rows[-1] == 19
        assert rows == sorted(rows)
        for first, last in itertools.pairwise(rows):
            chord = line[last] - line[first]
            for point in line[first + 1 : last] - line[first]:
                along = np.clip(point @ chord / (chord @ chord), 0, 1)
                assert np.linalg.norm(point - along * chord) <= tolerance
    bent = np.array([[0.0, 0, 0], [5.0, 0.05, 0], [10.0, 0, 0], [10.0, 8, 0]])
    assert without_straight(bent, 0.1).tolist() == bent[[0, 2, 3]].tolist()
    ring = np.array([[0.0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 0.05, 0], [0, 0, 0]])
    assert without_straight(ring, 0.1).tolist() == ring[[0, 1, 2, 4]].tolist()


@pytest.mark.parametrize("at", [0.5, 1.0, 2.5, 5.9])
def test_a_drawn_pipe_is_cut_where_it_is_said(at):
    """Both pieces follow the line, and meet at a new node; together they are as long."""
    line = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0], [1, 2, 3]])
    pipe = DrawnPipe("p", "p", ("a", "b"), line, 0.16)
    first, second = pipe.cut(at, "q", "n")
    assert (first.ends, second.ends) == (("a", "n"), ("n", "b"))
    assert (first.name, second.name) == ("p", "q")
    assert first.length == pytest.approx(at)
    assert second.length == pytest.approx(6.0 - at)
    np.testing.assert_array_equal(first.points[-1], second.points[0])
    np.testing.assert_array_equal(first.points[0], line[0])
    np.testing.assert_array_equal(second.points[-1], line[-1])
