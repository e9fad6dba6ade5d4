"""Laws of planning: ways are compared in metres, travel back counts, and what was found closed or
reached stays so."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import omnitrack_sim as ot
from omnitrack_sim import load_network, shortest_route
from omnitrack_sim.autonomy.mission import Mission, MissionPlanner
from omnitrack_sim.autonomy.pilots import Planned
from omnitrack_sim.base.errors import GeometryError
from omnitrack_sim.base.rotations import Pose, rotation_about
from omnitrack_sim.pipes import Assembly, Elbow, Part, Step, Straight, route
from omnitrack_sim.pipes.centreline import SEARCH
from omnitrack_sim.pipes.network import Network, validate
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.record.events import GaveUp, TakenForClosed
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.scenario import validate as validate_scenario

LENGTH = Omnitrack().length


def cut(network: Network, name: str, pieces: int) -> Network:
    """The same network with one of its straights cut into equal pieces, joined end to end."""
    data = network.model_dump(mode="json")
    at = next(i for i, part in enumerate(data["fittings"]) if part["name"] == name)
    whole = data["fittings"][at]
    names = [name, *(f"{name}_piece_{i}" for i in range(1, pieces))]
    rows = [whole | {"name": n, "length": whole["length"] / pieces} for n in names]
    data["fittings"][at : at + 1] = rows
    for joint in data["joints"]:
        joint["ports"] = [
            f"{names[-1]}.end" if port == f"{name}.end" else port for port in joint["ports"]
        ]
    data["joints"] += [{"ports": [f"{a}.end", f"{b}.start"]} for a, b in itertools.pairwise(names)]
    return validate(data)


@pytest.mark.parametrize("name", ["riser_2", "cross_low", "shaft"])
def test_a_pipe_that_is_cut_into_pieces_changes_no_way(name: str) -> None:
    """Ways are compared by their lengths: twelve short pipes are no detour, and a long pipe is none
    the less for being one."""
    whole = load_network("tower")
    pieces = cut(whole, name, 12)
    for start, goal in itertools.permutations(whole.ports, 2):
        ways = [shortest_route(network, start, goal) for network in (whole, pieces)]
        lengths = [way.centreline.length for way in ways]
        assert lengths[0] == pytest.approx(lengths[1], abs=1e-9)


def names(plan: MissionPlanner, leg: Leg) -> list[str]:
    return [plan.network.fittings[part].name for part, _, _ in leg.path]


def tower(*goals: str) -> MissionPlanner:
    return MissionPlanner(
        load_network("tower"), Mission(start="foot", goals=goals), Omnitrack(), 0.1
    )


def test_the_way_back_counts_in_what_a_new_way_costs() -> None:
    """From the roof to the drain the robot backs out to the next tee and goes down the shaft. From
    the foot the way on would be shorter, but the way back there is long."""
    plan = tower("roof", "drain")
    there, back, onward = plan.plan()
    parting = names(plan, there).index("tee_up")
    assert names(plan, onward)[: parting + 2] == [*names(plan, there)[: parting + 1], "shaft"]
    near = plan.route(onward.path).passages[parting]
    assert onward.begin == pytest.approx(near.s_bend_start - Omnitrack().standing_room - LENGTH / 2)
    assert back.end - back.begin < 1.2


@pytest.mark.parametrize(("room", "stands"), [(0.005, "before both"), (0.03, "between them")])
def test_a_robot_stands_where_it_has_room_to_roll(room: float, stands: str) -> None:
    """Between two fittings that are farther apart than robot and standing room; otherwise before
    the first of them."""
    gap = LENGTH + room
    tee = {"kind": "tee"}
    branches = [{"kind": "straight", "name": f"arm_{i}", "length": 0.4} for i in (1, 2)]
    fittings = [
        {"kind": "straight", "name": "in", "length": 0.5},
        tee | {"name": "first"},
        {"kind": "straight", "name": "gap", "length": 0.4},
        tee | {"name": "second"},
        {"kind": "straight", "name": "out", "length": 0.4},
        *branches,
    ]
    joints: list[dict[str, Any]] = [
        {"ports": ["in.end", "first.run_start"]},
        {"ports": ["first.run_end", "gap.start"]},
        {"ports": ["gap.end", "second.run_start"]},
        {"ports": ["second.run_end", "out.start"]},
        {"ports": ["first.branch", "arm_1.start"]},
        {"ports": ["second.branch", "arm_2.start"]},
    ]
    # What lies between the opening of the first tee and the bend into the branch of the second.
    network = validate({"fittings": fittings, "joints": joints})
    way = shortest_route(network, "in.start", "arm_2.end").passages
    between = way[3].s_bend_start - way[1].opening[1]
    fittings[2]["length"] = 0.4 - between + gap
    network = validate({"fittings": fittings, "joints": joints})
    plan = MissionPlanner(
        network, Mission(start="in.start", goals=("out.end", "arm_2.end")), Omnitrack(), 0.1
    )
    *_, onward = plan.plan()
    way = plan.route(onward.path).passages
    assert way[3].s_bend_start - way[1].opening[1] == pytest.approx(gap)
    before = way[3].s_bend_start if stands == "between them" else way[1].opening[0]
    assert onward.begin == pytest.approx(before - Omnitrack().standing_room - LENGTH / 2)


def up_the_tower(goals: list[str]) -> Planned:
    """The pilot of a mission up the tower, before its first leg."""
    mission = {"start": "foot", "goals": goals}
    pilot = validate_scenario({"network": "tower", "mission": mission}).pilot(0)
    assert isinstance(pilot, Planned)
    return pilot


def hang_before(pilot: Planned, port: str) -> list[Any]:
    """The events of a robot that hangs, on the leg at hand, with its nose before a port."""
    part, leave = pilot.planner.network.port(port)
    at = next(i for i, s in enumerate(pilot.leg.path) if (s[0], s[2]) == (part, leave))
    nose = pilot.route().passages[at].s_leave
    return list(pilot.on_blockage(10.0, nose - LENGTH / 2, "").events)


def arrive(pilot: Planned) -> None:
    """It comes to the end of the leg at hand."""
    pilot.on_arrival(10.0, pilot.leg.end, "")


def test_all_ports_that_were_found_closed_are_remembered() -> None:
    """The second closed port leaves no way to the top of the tower: the robot does not go back to
    the first one."""
    pilot = up_the_tower(["head"])
    (closed, _) = hang_before(pilot, "riser_2.end")
    assert isinstance(closed, TakenForClosed)
    arrive(pilot)
    assert pilot.leg.gear == 1
    *told, last = hang_before(pilot, "shaft.end")
    assert [event.port for event in told] == ["shaft.end"]
    assert isinstance(last, GaveUp)
    assert last.cause == "no other way"


def test_a_robot_that_finds_its_way_closed_sets_out_for_the_same_goal() -> None:
    """On its way to the second goal the legs round what is closed lead there, and not to the first
    one again."""
    pilot = up_the_tower(["drain", "head"])
    arrive(pilot)
    arrive(pilot)
    assert pilot.leg.goal == 1
    planner = pilot.planner
    blocked = "riser_2.end" if "riser_2" in names(planner, pilot.leg) else "shaft.end"
    hang_before(pilot, blocked)
    arrive(pilot)
    again = pilot.leg
    assert (again.goal, again.gear) == (1, 1)
    assert planner.network.fittings[again.path[-1][0]].name == "riser_3"
    assert tuple(pilot.missed) == ()


def test_a_place_is_looked_for_near_the_last_one() -> None:
    """In a U-bend a point on the other leg, nearer to it than to this one, does not carry the
    robot over: only arc lengths within reach of the last one count."""
    way = route(
        [
            Step("a", Straight(0.5), "start", "end"),
            Step("b", Elbow(0.09, np.pi), "start", "end"),
            Step("c", Straight(0.5), "start", "end"),
        ]
    )
    line, last = way.centreline, np.array([0.49])
    over = line.at(np.array([line.length - last[0]]))[0]
    assert line.locate(over) == pytest.approx([line.length - last[0]])
    assert np.abs(line.locate(over, last) - last) <= SEARCH
    assert line.locate(over, last) == pytest.approx(last, abs=1e-9)


@pytest.mark.parametrize("depth", [0.004, 0.012, 0.03])
@pytest.mark.parametrize("along", [0.2, 0.205, 0.21])
def test_an_overlap_is_seen_whichever_part_comes_first(depth: float, along: float) -> None:
    """The end of a thin pipe that stands in the side of a wide one, between the samples of its
    wall, is a fault, in either order."""
    wide = Part("wide", Straight(0.4), Pose())
    sideways = rotation_about([0, 1, 0], np.pi / 2)
    thin = Part("thin", Straight(0.3, 0.03), Pose(sideways, np.array([0.08 - depth, 0.0, along])))
    for parts in ((wide, thin), (thin, wide)):
        with pytest.raises(GeometryError, match="runs into"):
            Assembly(parts)
    apart = Part("thin", thin.fitting, Pose(sideways, np.array([0.085, 0.0, along])))
    assert len(Assembly((wide, apart)).parts) == 2


def test_a_route_through_a_town_is_cut_out_with_what_is_beside_it(monkeypatch):
    """From a fitting to an open end the scenario has the pipes of the shortest way and its side
    branches, and is cut at the fitting; a network beyond the bounds is cut out likewise."""
    changes = {"mission.start": "tee_1", "mission.goals": ["low"], "run.expected_outcome": None}
    scenario = ot.load_scenario("missions/fig14", changes)
    assert scenario.mission.start == "shelf.start"
    names = {fitting.name for fitting in scenario.network.fittings}
    whole = ot.load_network("fig14")
    assert {"shelf", "tee_3", "side_arm", "low_arm"} <= names < {f.name for f in whole.fittings}
    assert "riser" not in names
    kept = {part.name: part.pose.position for part in scenario.network.pipes.parts}
    for part in whole.pipes.parts:
        if part.name in kept:
            assert kept[part.name] == pytest.approx(part.pose.position, abs=1e-6)
    monkeypatch.setattr("omnitrack_sim.scenario.loading.MAX_PARTS", 5)
    far = ot.load_scenario("missions/fig14", changes | {"mission.start": "inlet"})
    assert far.mission.start == "inlet"
    assert len(far.network.fittings) < len(whole.fittings)
    assert far.route.length == pytest.approx(ot.shortest_route(whole, "inlet", "low").length)
