"""Sight of what is ahead, and maps compared with the network that they are of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from network_samples import branched, elbow, joint, reducer, straight, tee

from omnitrack_sim.autonomy.pilots import FixedRoute
from omnitrack_sim.autonomy.sight import Look, Sighting, TrueSight, is_right
from omnitrack_sim.base.errors import NetworkError
from omnitrack_sim.base.rotations import Pose
from omnitrack_sim.pipes import ARCS, Elbow, Tee, attached
from omnitrack_sim.pipes.map_difference import compare_maps
from omnitrack_sim.pipes.network import load_network, validate
from omnitrack_sim.pipes.planning import shortest_route
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.scenario import load_scenario

HALF = Omnitrack().length / 2


def knee(**changes) -> dict:
    """A straight, an elbow of 60 degrees turned by 40, a straight, a tee, and straights there."""
    return {
        "fittings": [
            straight("in", 0.6),
            elbow("bend", angle_deg=60.0),
            straight("mid", 0.3),
            tee("fork"),
            straight("on", 0.4),
            straight("off", 0.5),
        ],
        "joints": [
            joint("in.end", "bend.start", 40.0),
            joint("bend.end", "mid.start"),
            joint("mid.end", "fork.run_start", -70.0),
            joint("fork.run_end", "on.start"),
            joint("fork.branch", "off.start"),
        ],
        **changes,
    }


def looks(network, start: str, goal: str, distances, turned: float = 0.3, blocked=()):
    """What a robot sees on its way from one end to another, its centre at these arc lengths, m,
    module 1 turned by ``turned`` rad from the way's frame."""
    route = shortest_route(network, start, goal)
    plates = [network.port(port) for port in blocked]
    sight = TrueSight(network.pipes, plates, Omnitrack(), ARCS)
    line, found = route.centreline, []
    for distance in distances:
        s = np.array([distance])
        frame = Pose(line.frame(s)[0]) @ Pose(
            np.array(
                [
                    [np.cos(turned), -np.sin(turned), 0],
                    [np.sin(turned), np.cos(turned), 0],
                    [0, 0, 1],
                ]
            )
        )
        found.append(sight.look(0, line.at(s)[0][0], frame.rotation))
    return route, found


def test_the_next_fitting_is_seen_with_its_sizes_and_how_it_lies():
    """Distance to its port plane, and the turn with which it would be attached."""
    network = validate(knee())
    route, (seen,) = looks(network, "in.start", "on.end", [0.1])
    bend = network.pipes.parts[1]
    assert (seen.fitting, seen.enter, seen.end) == (bend.fitting, "start", "")
    assert seen.distance == pytest.approx(0.5)
    line, s = route.centreline, np.array([0.1])
    z = line.frame(s)[0] @ [0, 0, 1]
    x = np.cos(0.3) * line.frame(s)[0][:, 0] + np.sin(0.3) * line.frame(s)[0][:, 1]
    robot = np.stack([x, np.cross(z, x), z], axis=-1)
    ahead = Pose(robot, line.at(s)[0][0] + seen.distance * z)
    placed = attached(ahead, seen.fitting, seen.enter, seen.turn)
    assert np.allclose(placed.rotation, bend.pose.rotation)
    assert np.allclose(placed.position, bend.pose.position)


def test_sight_ends_in_bends_and_at_its_range_and_goes_on_at_their_ports():
    """With its nose in the bend a robot cannot tell; from the port on it measures along the axis,
    with its centre still in the bend; farther than the range it sees free pipe only."""
    network = validate(knee())
    bend = network.pipes.parts[1].fitting.length_of_axes
    inside, out = 0.6 + bend / 2 - HALF, 0.6 + bend - HALF + 0.01
    _, (none, tee_ahead) = looks(network, "in.start", "on.end", [inside, out])
    assert none is None
    assert tee_ahead.fitting is network.pipes.parts[3].fitting
    assert tee_ahead.distance == pytest.approx(0.6 + bend + 0.3 - out, abs=1e-6)
    long = validate({"fittings": [straight("long", 3.0)]})
    _, (free, end) = looks(long, "long.start", "long.end", [0.5, 2.5])
    assert (free.fitting, free.end, free.distance) == (None, "", pytest.approx(HALF + 0.96))
    assert (end.fitting, end.end, end.distance) == (None, "open", pytest.approx(0.5))


def test_a_plate_is_seen_as_a_closed_end_from_both_sides():
    """Wherever it stands in a straight, it ends what is seen."""
    network = validate(knee())
    _, (seen,) = looks(network, "in.start", "on.end", [0.1], blocked=["bend.start"])
    assert (seen.fitting, seen.end, seen.distance) == (None, "closed", pytest.approx(0.5))
    _, (back,) = looks(network, "on.end", "in.start", [0.1], blocked=["fork.run_end"])
    assert (back.end, back.distance) == ("closed", pytest.approx(0.3))
    tee_begins = 0.9 + network.pipes.parts[1].fitting.length_of_axes
    near = np.linspace(tee_begins, tee_begins + 0.205, 50)
    _, branch = looks(network, "in.start", "off.end", near, blocked=["off.start"])
    seen = [one for one in branch if one is not None and one.end]
    assert len(seen) > 1
    assert {one.end for one in seen} == {"closed"}


def test_a_network_is_the_same_as_itself_whatever_its_parts_are_called():
    """Names, the order of parts, straights in pieces and the sense of a tee's run do not count."""
    true = validate(knee())
    other = knee()
    other["fittings"][2:3] = [straight("piece_1", 0.1), straight("piece_2", 0.2)]
    other["joints"][1:3] = [
        joint("bend.end", "piece_1.start", 25.0),
        joint("piece_1.end", "piece_2.end"),
        joint("piece_2.start", "fork.run_end", -70.0 - 25.0),
    ]
    other["joints"][4] = joint("fork.run_start", "on.start")
    difference = compare_maps(validate(other), true)
    assert difference.same, difference
    assert (difference.parts, difference.found, difference.length_error) == (6, 6, pytest.approx(0))
    for name in ("house_sewer", "fig14", "close_fittings", "narrow"):
        network = load_network(name)
        assert compare_maps(network, network).same


def test_what_a_map_has_wrong_is_told():
    """A wrong kind, length, angle or turn, a part too few or too many, each by its name."""
    true = validate(knee())

    def of(change) -> object:
        data = knee()
        change(data)
        return compare_maps(validate(data), true, "in.start")

    def longer(data):
        data["fittings"][4]["length"] = 0.43

    def bent(data):
        data["fittings"][1]["angle_deg"] = 67.0

    def twisted(data):
        data["joints"][2]["turn_deg"] = -60.0

    def wye(data):
        data["fittings"][3] = {"kind": "wye", "name": "fork", "angle_deg": 90.0}

    def shorter(data):
        del data["fittings"][5], data["joints"][4]

    def grown(data):
        data["fittings"].append(straight("more", 0.5))
        data["fittings"].append(elbow("extra"))
        data["joints"] += [joint("on.end", "extra.start"), joint("extra.end", "more.start")]

    assert of(longer).wrong_sizes == (("on", "on"),)
    assert of(longer).complete
    assert not of(longer).same
    assert of(longer).length_error == pytest.approx(0.03)
    assert of(bent).angles == (("bend", "bend"),)
    assert of(twisted).angles == (("fork", "fork"),)
    assert of(wye).kinds == (("fork", "fork"),)
    assert of(wye).missing == ("on", "off")
    assert of(shorter).missing == ("off",)
    assert not of(shorter).complete
    assert of(grown).extra == ("more", "extra")
    assert of(grown).complete
    assert not of(grown).same


def test_a_mirrored_map_is_another_one():
    """All turns the other way round: the same kinds and lengths, other directions."""
    data = knee()
    for row in data["joints"]:
        row["turn_deg"] = -row["turn_deg"]
    difference = compare_maps(validate(data), validate(knee()), "in.start")
    assert difference.angles == (("bend", "bend"), ("fork", "fork"))
    assert not difference.wrong_sizes
    assert not difference.same


def test_a_loop_that_the_map_leaves_open_is_told():
    """Both parts are there, and not joined."""
    true = load_network("tower")
    data = true.model_dump(mode="json")
    data["joints"] = [
        row for row in data["joints"] if set(row["ports"]) != {"cross_high.end", "tee_high.branch"}
    ]
    for row in data["fittings"]:
        if row["name"] == "cross_high":
            row["length"] = 0.39  # the joint alone left out, both ports would be in one place
    difference = compare_maps(validate(data), true)
    assert difference.loose == (("tee_high.branch", "cross_high.end"),)
    assert difference.found == difference.parts
    assert not difference.complete


def test_what_a_plate_hides_is_not_asked_for():
    """Only what can be reached counts, and the plate has to be a port of the network."""
    true = validate(branched())
    data = branched()
    del data["fittings"][3], data["joints"][2]
    found = validate(data)
    assert compare_maps(found, true).missing == ("c",)
    assert compare_maps(found, true, closed=["t.branch"]).same
    with pytest.raises(NetworkError, match=r"closed.0: there is no port 't.up'"):
        compare_maps(found, true, closed=["t.up"])
    with pytest.raises(NetworkError, match=r"start: there is no port 'start'.*: a.start"):
        compare_maps(found, true, "start")


def test_an_open_end_that_the_map_calls_closed_is_told():
    """And the reverse, a cap or a plate; a port without such a name says nothing."""
    data = branched()
    data["fittings"][3] = {"kind": "cap", "name": "c", "length": 0.5}
    data["joints"][2] = joint("t.branch", "c.start")
    true = validate(data)

    def of(closed=(), **ports):
        found = validate(data | {"ports": ports})
        return compare_maps(found, true, "a.start", closed)

    assert of(open_1="b.end", closed_1="c.end").same
    assert of(bath="b.end", impassable_1="c.end").same
    wrong = of(closed_1="b.end", open_1="c.end")
    assert wrong.ends == (("b.end", "b.end"), ("c.end", "c.end"))
    assert wrong.complete
    assert not wrong.consistent
    assert wrong.figures()["map_faults"] == 2
    assert "other end: b.end/b.end, c.end/c.end" in str(wrong)
    assert of(closed_1="b.end", closed=["b.end"]).same


def test_a_map_says_how_sure_it_is_of_each_size():
    """Errors stand beside the standard deviations, of straights in a row together, of a reducer
    also where it lies the other way round on the map; figures are rounded by their doubt."""
    data = {
        "fittings": [straight("a", 0.5), reducer("r"), straight("b", 0.4, inner_diameter=0.12)],
        "joints": [joint("a.end", "r.start"), joint("r.end", "b.start")],
    }
    mine = {
        "fittings": [
            straight("s_1", 0.3),
            straight("s_2", 0.203),
            {**reducer("r_1", 0.16), "inner_diameter": 0.121},
            straight("s_3", 0.25, inner_diameter=0.121),
        ],
        "joints": [
            joint("s_1.end", "s_2.start"),
            joint("s_2.end", "r_1.end"),
            joint("r_1.start", "s_3.start"),
        ],
    }
    stds = {"s_1": {"length": 0.003}, "s_2": {"length": 0.004}, "r_1": {"inner_diameter": 0.0012}}
    sizes = compare_maps(validate(mine), validate(data), "a.start", stds=stds).sizes
    known = {(size.part, size.key): size for size in sizes}
    run = known["s_1", "length"]
    assert (run.true, run.std, run.error) == ("a", pytest.approx(0.005), pytest.approx(0.003))
    assert run.cells == ("mm", "503.0", "5.0", "3.0")
    bore = known["r_1", "inner_diameter"]
    assert (bore.std, bore.error) == (0.0012, pytest.approx(0.001))
    assert known["r_1", "end_diameter"].std is None
    assert known["r_1", "end_diameter"].error == pytest.approx(0.0)
    # The end of the last pipe has not been seen: it is as long as it is known to be free.
    assert known["s_3", "length"].std is None
    assert known["s_3", "length"].cells[2] == "-"
    assert [size.error for size in compare_maps(validate(data), validate(data)).sizes] == [0.0] * 5


def test_a_sighting_is_right_within_a_decimetre_of_the_same_thing():
    """A fitting of that kind by a port that is like it, an end that is as open; free pipe as far as
    was seen, though something may begin a decimetre before that."""
    tee, elbow = Tee(), Elbow(0.24)
    truth = Sighting(tee, "run_start", distance=0.5)
    for ahead, right in (
        (replace(truth, distance=0.41), True),
        (replace(truth, distance=0.59, turn=1.0), True),
        (replace(truth, distance=0.39), False),
        (replace(truth, distance=0.61), False),
        (replace(truth, enter="run_end"), True),
        (replace(truth, enter="branch"), False),
        (replace(truth, fitting=elbow, enter="start"), False),
        (Sighting(end="open", distance=0.5), False),
        (Sighting(distance=0.59), True),
        (Sighting(distance=0.61), False),
    ):
        assert is_right(ahead, truth) == right, ahead
    for end, other in (("open", "closed"), ("closed", "open")):
        there = Sighting(end=end, distance=0.5)
        assert is_right(replace(there, distance=0.45), there)
        assert not is_right(Sighting(end=other, distance=0.5), there)


def test_a_robot_that_does_not_look_stays_on_its_leg():
    """Whatever a look would tell it."""
    pilot = FixedRoute(load_scenario("straight").route, 0.1, 0.4)
    decision = pilot.on_look(Look(0.0, 0.2, None, None, np.eye(3)))
    assert (decision.leg, decision.same_leg, list(decision.events)) == (pilot.leg, True, [])
    assert np.isinf(pilot.looks_at)
    leg = pilot.leg
    assert (leg.gear, leg.begin, leg.end, leg.goal, leg.note) == (1, 0.1, 0.4, 0, "")
