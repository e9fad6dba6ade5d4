"""Networks as files: placement, faults, routes, random networks, exports."""

from __future__ import annotations

import itertools
import tomllib

import numpy as np
import pytest
from network_samples import branched, elbow, joint, narrowed, reducer, straight, tee

from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.base.naming import shipped_files
from omnitrack_sim.base.rotations import Pose, frame_along
from omnitrack_sim.pipes import Elbow, Step, Straight, Tee, route
from omnitrack_sim.pipes.network import Network, load_network, validate
from omnitrack_sim.pipes.planning import shortest_route
from omnitrack_sim.pipes.random import random_network


def ring(length: float) -> dict:
    """Four elbows and four straights in a rectangle; it closes where ``length`` m is that of the
    first side, 0.4."""
    sides = [0.4, 0.3, length, 0.3]
    fittings = [
        part for i, side in enumerate(sides) for part in (straight(f"s{i}", side), elbow(f"e{i}"))
    ]
    names = [part["name"] for part in fittings]
    joints = [joint(f"{a}.end", f"{b}.start") for a, b in itertools.pairwise([*names, names[0]])]
    return {"fittings": fittings, "joints": joints}


def faults_of(data: dict) -> dict[str, str]:
    with pytest.raises(NetworkError) as caught:
        validate(data)
    found: dict[str, str] = {}
    for fault in caught.value.faults:
        found[fault.where] = f"{found.get(fault.where, '')}{fault}\n"
    return found


def test_a_chain_lies_as_its_route():
    """A chain is placed as ``pipes.route`` places it, entered forwards or listed the other way
    round."""
    steps = [
        Step("a", Straight(0.3), "start", "end"),
        Step("b", Elbow(0.24), "start", "end", np.radians(70)),
        Step("c", Tee(), "run_start", "branch", np.radians(-40)),
        Step("d", Elbow(0.09), "end", "start", np.radians(25)),
    ]
    expected = route(steps, Pose(frame_along([1, 2, 3], np.radians(20)), np.array([1.0, 0, 2])))
    joints = [
        joint("a.end", "b.start", 70),
        joint("c.run_start", "b.end", -40),  # the ports of a joint have no order
        joint("c.branch", "d.end", 25),
    ]
    data = {
        "place": {"axis": [1, 2, 3], "turn_deg": 20, "position": [1, 0, 2]},
        "fittings": [straight("a", 0.3), elbow("b"), tee("c"), elbow("d", mean_radius=0.09)],
        "joints": joints,
    }
    network = validate(data)
    for mine, theirs in zip(network.pipes.parts, expected.network.parts, strict=True):
        assert np.allclose(mine.pose.rotation, theirs.pose.rotation, atol=1e-12)
        assert np.allclose(mine.pose.position, theirs.pose.position, atol=1e-12)
    way = shortest_route(network, "a.start", "d.start")
    s = np.linspace(0, expected.centreline.length, 100)
    assert way.centreline.length == pytest.approx(expected.centreline.length)
    for mine, theirs in zip(way.centreline.at(s), expected.centreline.at(s), strict=True):
        assert np.allclose(mine, theirs)
    assert np.allclose(way.centreline.frame(s), expected.centreline.frame(s))
    for mine, theirs in zip(way.passages, expected.passages, strict=True):
        assert (mine.kind, mine.enter, mine.leave) == (theirs.kind, theirs.enter, theirs.leave)
        assert np.allclose(mine.turn_direction, theirs.turn_direction)
        assert mine.opening == pytest.approx(theirs.opening, nan_ok=True)


def test_first_port_is_where_the_place_says():
    """``place`` puts the first port of the first fitting, with the pipe running along the axis."""
    pipes = validate(branched(place={"axis": [0, 1, 0], "position": [1, 2, 3]})).pipes
    assert np.allclose(pipes.parts[0].port("start").position, [1, 2, 3])
    assert np.allclose(pipes.parts[0].port("end").position, [1, 2.4, 3])


def test_a_loop_closes():
    """A rectangle of pipes is a network without open ends; off by less than a millimetre it still
    is."""
    assert validate(ring(0.4)).open_ends == ()
    assert validate(ring(0.4008)).open_ends == ()


def test_a_loop_that_misses_says_by_how_much():
    """The fault names the joint, both ports, and the gap."""
    faults = faults_of(ring(0.405))
    (text,) = [text for where, text in faults.items() if where.startswith("joints.")]
    assert "5.000 mm" in text
    assert "0.000 degrees" in text
    data = ring(0.4)
    data["fittings"][1]["angle_deg"] = 91.0
    texts = " ".join(text for where, text in faults_of(data).items() if where.startswith("joints."))
    assert "miss by" in texts
    assert "1.000 degrees" in texts


@pytest.mark.parametrize(
    ("changes", "where", "told"),
    [
        ({"nonsense": 1}, "nonsense", "fittings"),
        ({"fittings": [straight("a", colour=1)]}, "fittings.0.colour", "inner_diameter"),
        (
            {"fittings": [{"kind": "crank", "name": "x"}]},
            "fittings.0.kind",
            "elbow, mitre, reducer, straight, cap, tee",
        ),
        ({"fittings": [{"kind": "tee"}]}, "fittings.0.name", "required"),
        ({"fittings": [straight("a.b")]}, "fittings.0.name", "no dot"),
        ({"fittings": []}, "fittings", "at least 1"),
        (
            {"fittings": [elbow("a", mean_radius=0.05)], "joints": []},
            "fittings.0.mean_radius",
            "at least",
        ),
        (
            {"fittings": [{"kind": "reducer", "name": "r", "length": 0.1}]},
            "fittings.0.end_diameter",
            "required",
        ),
        (
            {"fittings": [reducer("r", length=0.02)], "joints": []},
            "fittings.0.length",
            "20 degrees",
        ),
        (
            {"fittings": [reducer("r", 0.16)], "joints": []},
            "fittings.0.end_diameter",
            "use a straight",
        ),
        ({"place": {"axis": [0, 0, 0]}}, "place.axis", "no direction"),
        (
            {"joints": [joint("a.end", "t.middle")]},
            "joints.0.ports.1",
            "t.run_start, t.run_end, t.branch",
        ),
        ({"joints": [joint("a.end", "u.branch")]}, "joints.0.ports.1", "choose from: a, t, b, c"),
        ({"joints": [joint("a.end", "a.start")]}, "joints.0.ports", "itself"),
        (
            {"joints": [joint("a.end", "t.branch"), joint("b.end", "t.branch")]},
            "joints.1.ports.1",
            "joints.0",
        ),
        ({"joints": [joint("a.end", "t.branch")]}, "fittings.2", "not connected"),
        ({"ports": {"inlet": "a.end"}}, "ports.inlet", "a.start"),
        ({"ports": {"inlet": "z.end"}}, "ports.inlet", "no fitting 'z'"),
    ],
)
def test_faults_are_named(changes, where, told):
    """Each fault stands at its dotted path, with the choices or what clashes."""
    assert told in faults_of(branched(**changes))[where]


def test_duplicate_names_and_bad_joints_are_told_together():
    """Every fault of a file is listed, not only the first."""
    data = branched()
    data["fittings"][2]["name"] = "a"
    data["joints"][2]["ports"] = ["t.branch", "c.middle"]
    faults = faults_of(data)
    assert "earlier" in faults["fittings.2.name"]
    assert {"joints.1.ports.1", "joints.2.ports.1"} <= set(faults)


def test_a_network_made_in_python_tells_its_faults_as_a_file_does():
    """All at once, by their places, as the project's own error."""
    data = {
        "fittings": [straight("a", 0.3) | {"lenght": 2}, elbow("b") | {"mean_radius": "wide"}],
        "joints": [joint("a.end", "b.start") | {"turn": 3}],
    }
    with pytest.raises(NetworkError) as caught:
        Network(**data)
    assert {fault.where for fault in caught.value.faults} == set(faults_of(data))


def test_bores_that_differ_name_both_parts_and_ports():
    """A joint of two diameters is refused."""
    data = branched()
    data["fittings"][3]["inner_diameter"] = 0.12
    text = faults_of(data)["fittings.3.inner_diameter"]
    for word in ("'t' (branch)", "'c' (end)", "0.16 m", "0.12 m", "a reducer joins"):
        assert word in text


def test_a_reducer_joins_bores_of_two_sizes():
    """Joined the right way round it fits; turned about, both of its joints are faults."""
    network = validate(narrowed())
    assert network.length == pytest.approx(0.4 + 0.32 + 0.16 + 0.4 + 0.5 + 0.15 + 0.5)
    way = shortest_route(network, "d.end", "a.start")
    assert [p.words for p in way.passages] == [
        "straight",
        "reducer",
        "straight",
        "branch to run",
        "straight",
    ]
    assert [p.radius for p in way.passages] == pytest.approx([0.06, 0.06, 0.08, 0.08, 0.08])
    data = narrowed()
    data["joints"][3:] = [joint("c.start", "r.end"), joint("r.start", "d.start")]
    faults = faults_of(data)
    assert "of 0.12 m" in faults["fittings.4.end_diameter"]
    assert "of 0.16 m" in faults["fittings.5.inner_diameter"]


def test_bores_may_differ_by_a_millimetre():
    """Pipes of one nominal size are joined without a reducer."""
    data = branched()
    data["fittings"][3]["inner_diameter"] = 0.161
    assert validate(data).pipes.parts[3].fitting.radius == 0.0805


def test_overlaps_name_both_parts():
    """A straight that comes back through the riser is refused; places are those of the file though
    a part is loose."""
    bends = [elbow(f"e{i}", mean_radius=0.09) for i in range(3)]
    data = {
        "fittings": [straight("a"), straight("loose"), tee("t"), *bends, straight("back", 0.8)],
        "joints": [
            joint("a.end", "t.run_start"),
            joint("t.branch", "e0.start", 180),
            joint("e0.end", "e1.start"),
            joint("e1.end", "back.start"),
        ],
    }
    faults = faults_of(data)
    assert "not connected" in faults["fittings.1"]
    assert "'back' runs into 'a' (fittings.0)" in faults["fittings.6"]
    assert "'back' runs into 't' (fittings.2)" in faults["fittings.6"]


@pytest.mark.parametrize(
    ("start", "goal", "avoid", "where", "told"),
    [
        ("a.start", "nowhere", (), "goal", "b.end"),
        ("a.start", "t.branch", (), "goal", "joined to c.end"),
        ("a.end", "b.end", (), "start", "no open end"),
        ("a.start", "a.start", (), "goal", "is the start"),
        ("inlet", "a.start", (), "goal", "is the start"),
        ("a.start", "b.end", ("t",), "goal", "cannot be reached"),
        ("a.start", "b.end", ("q",), "avoid", "choose from: a, t, b, c"),
        ("a.start", "b.end", ("a",), "goal", "cannot be reached"),
    ],
)
def test_routes_that_cannot_be(start, goal, avoid, where, told):
    """Start and goal are two open ends with a way between them."""
    network = validate(branched(ports={"inlet": "a.start"}))
    with pytest.raises(NetworkError) as caught:
        shortest_route(network, start, goal, avoid)
    assert [fault.where for fault in caught.value.faults] == [where]
    assert told in str(caught.value)


def simple_ways(network, start, goal):
    """Lengths, m, of all ways that pass no fitting twice, by search without a graph library."""
    ends = network._ends

    def onward(port, passed):
        index, enter = ends[port]
        if index in passed:
            return
        part = network.pipes.parts[index]
        for leave in part.fitting.port_names:
            if leave == enter:
                continue
            length = part.axis(enter, leave).length
            out = f"{part.name}.{leave}"
            if out == goal:
                yield length
            elif out in network.joined_to:
                for rest in onward(network.joined_to[out], passed | {index}):
                    yield length + rest

    return list(onward(start, frozenset()))


@pytest.mark.parametrize("name", ["tower", "house_sewer", "random"])
def test_shortest_route_is_the_shortest(name):
    """Between any two open ends no way that passes each fitting once is shorter, and its parts are
    joined in order."""
    network = random_network(11) if name == "random" else load_network(name)
    for start, goal in itertools.permutations(network.open_ends, 2):
        way = shortest_route(network, start, goal)
        assert way.centreline.length == pytest.approx(
            min(simple_ways(network, start, goal)), abs=1e-9
        )
        assert len({p.index for p in way.passages}) == len(way.passages)


def test_a_loop_gives_a_second_way():
    """Where the short way is barred, the tower's route goes over the other crossing."""
    network = load_network("tower")
    short = shortest_route(network, "foot", "roof")
    names = [network.fittings[p.index].name for p in short.passages]
    assert len(simple_ways(network, "riser_1.start", "roof_arm.end")) == 2
    crossing = next(name for name in names if name.startswith("cross_"))
    other = shortest_route(network, "foot", "roof", avoid=[crossing])
    assert other.centreline.length >= short.centreline.length - 1e-9
    assert crossing not in [network.fittings[p.index].name for p in other.passages]


@pytest.mark.parametrize("name", sorted(shipped_files("networks")))
def test_routes_of_shipped_networks(name):
    """Every pair of open ends has a route: parts joined in order, arc lengths that follow on, a
    line without jumps."""
    network = load_network(name)
    assert set(network.ports.values()) == set(network.open_ends)
    for start, goal in itertools.permutations(network.open_ends, 2):
        way = shortest_route(network, start, goal)
        assert way.network is network.pipes
        ports = [
            (
                f"{network.fittings[p.index].name}.{p.enter}",
                f"{network.fittings[p.index].name}.{p.leave}",
            )
            for p in way.passages
        ]
        assert (ports[0][0], ports[-1][1]) == (start, goal)
        for (_, leave), (enter, _) in itertools.pairwise(ports):
            assert network.joined_to[leave] == enter
        for a, b in itertools.pairwise(way.passages):
            assert a.s_leave == b.s_enter
        point = way.centreline.at(np.linspace(0, way.centreline.length, 400))[0]
        step = way.centreline.length / 399
        assert np.linalg.norm(np.diff(point, axis=0), axis=1).max() <= step + 1e-9
        assert network.pipes.signed_distance(point)[0].min() > 0.04


def test_turns_of_a_tee():
    """Branch to run bends towards the run's port; run to branch towards the branch; over the run
    the branch is told."""
    network = validate(branched())
    pipes = network.pipes
    outward = {port: pipes.parts[1].port(port).rotation[:, 2] for port in Tee.port_names}
    cases = {
        ("c.start", "a.start"): ("branch to run", "run_start"),
        ("c.start", "b.end"): ("branch to run", "run_end"),
        ("a.start", "c.start"): ("run to branch", "branch"),
        ("b.end", "c.start"): ("run to branch", "branch"),
        ("b.end", "a.start"): ("over the run", "branch"),
    }
    for (start, goal), (name, towards) in cases.items():
        passage = shortest_route(network, start, goal).passages[1]
        assert passage.words == name
        assert np.allclose(passage.turn_direction, outward[towards])
        assert passage.is_turn == (name != "over the run")
        assert passage.index == 1
    into = shortest_route(network, "c.start", "a.start").passages[1]
    assert np.mean(into.opening) - into.s_enter == pytest.approx(0.16)


def test_toml_keeps_place_and_names():
    """What is written loads back equal, names that need quotes included."""
    network = validate(
        branched(name='odd "name" é', place={"position": [0, 0, 1]}, ports={"in let": "a.start"})
    )
    assert validate(tomllib.loads(network.to_toml())) == network
