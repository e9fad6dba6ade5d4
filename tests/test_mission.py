"""Missions through networks: the plan, the gears, and robots that drive them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from omnitrack_sim import (
    Network,
    NetworkError,
    Outcome,
    ScenarioError,
    load_network,
    load_scenario,
    override,
    shipped_files,
)
from omnitrack_sim.autonomy.mission import Mission, MissionPlanner
from omnitrack_sim.cli import app
from omnitrack_sim.pipes.planning import Leg
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.scenario import validate

LENGTH = Omnitrack().length


def planner(network: str, start: str, *goals: str, **more) -> MissionPlanner:
    mission = Mission(start=start, goals=goals, **more)
    return MissionPlanner(load_network(network), mission, Omnitrack(), 0.1)


def names(plan: MissionPlanner, leg: Leg) -> list[str]:
    return [plan.network.fittings[part].name for part, _, _ in leg.path]


# The plan


def test_first_leg_goes_the_shortest_way_to_the_goal():
    """Nose first from where the robot starts to where its nose is at the goal."""
    plan = planner("fig14", "inlet", "low")
    (leg,) = plan.plan()
    assert names(plan, leg) == [
        *("riser", "tee_1", "shelf", "elbow_side", "link", "tee_3", "drop", "elbow_low", "low_arm")
    ]
    assert (leg.gear, leg.goal, leg.begin) == (1, 0, 0.1)
    assert leg.end == pytest.approx(
        plan.route(leg.path).centreline.length - LENGTH / 2 - Omnitrack().nose_room
    )


def test_goals_come_in_order_and_each_is_backed_out_of():
    """Nose first to a goal, tail first out of it, as often as there are goals."""
    plan = planner("house_sewer", "sewer", "yard", "kitchen", "bath")
    legs = plan.plan()
    assert [(leg.gear, leg.goal) for leg in legs] == [(1, 0), (-1, -1), (1, 1), (-1, -1), (1, 2)]
    assert names(plan, legs[1]) == ["yard_drain", "tee_yard", "collector_1"]
    assert names(plan, legs[3])[:3] == ["kitchen_drain", "tee_ground", "stack_1"]


@pytest.mark.parametrize(
    ("network", "start", "goals"),
    [
        ("house_sewer", "sewer", ("yard", "kitchen", "bath")),
        ("fig14", "inlet", ("side", "low", "top", "far")),
        ("tower", "foot", ("head", "roof", "drain")),
        ("close_fittings", "inlet", ("under", "outlet", "over", "spur", "last")),
    ],
)
def test_backing_legs_end_where_the_robot_can_stand(network, start, goals):
    """Each leg begins where the one before it ended; the nose then is before the tee at which the
    ways part."""
    plan = planner(network, start, *goals)
    legs = plan.plan()
    assert len(legs) > len(goals)
    for old, back, new in zip(legs, legs[1:], legs[2:], strict=False):
        if back.gear > 0:
            continue
        for first, s, second, r in (
            (old, old.end, back, back.begin),
            (back, back.end, new, new.begin),
        ):
            places = [
                plan.route(leg.path).centreline.at(np.array([distance]))[:2]
                for leg, distance in ((first, s), (second, r))
            ]
            assert np.allclose(places[0][0], places[1][0], atol=1e-9)
            assert np.allclose(places[0][1], -places[1][1], atol=1e-9)
        parting = next(
            i for i, (a, b) in enumerate(zip(old.path, new.path, strict=False)) if a != b
        )
        passage = plan.route(new.path).passages[parting]
        opening = passage.s_bend_start if passage.is_turn else passage.opening[0]
        assert new.begin + LENGTH / 2 <= opening - Omnitrack().standing_room + 1e-9


def test_close_fittings_are_backed_out_of_together():
    """The ways part in a tee right after an elbow, or right after a tee: the robot backs out to
    before the first."""
    plan = planner("close_fittings", "inlet", "spur", "outlet", "last")
    _, back, onward, back_again, last = plan.plan()
    assert names(plan, back)[:4] == ["spur_arm", "tee_knee", "knee", "corridor"]
    knee = plan.route(onward.path).passages[names(plan, onward).index("knee")]
    assert onward.begin == pytest.approx(knee.s_bend_start - Omnitrack().standing_room - LENGTH / 2)
    assert names(plan, back_again)[:4] == ["exit_arm", "tee_c", "tee_b", "gap"]
    tee_b = plan.route(last.path).passages[names(plan, last).index("tee_b")]
    assert last.begin == pytest.approx(tee_b.s_bend_start - Omnitrack().standing_room - LENGTH / 2)


def test_a_closed_port_sends_the_robot_round_the_loop():
    """What stands before the nose is the obstacle; the way round the tower is found, and none where
    both are closed."""
    plan = planner("tower", "foot", "head")
    leg = plan.first
    assert names(plan, leg) == ["riser_1", "tee_low", "riser_2", "tee_high", "riser_3"]
    at = plan.route(leg.path).passages[2].s_leave - LENGTH / 2
    port = plan.obstacle(leg, at)
    assert plan.network.port_name(port) == "riser_2.end"
    legs = plan.replan(leg, at, 0, [port])
    assert legs is not None
    back, onward = legs
    assert (back.gear, back.goal, onward.gear, onward.goal) == (-1, -1, 1, 0)
    assert back.begin == pytest.approx(plan.route(leg.path).passages[2].s_leave - at)
    loop = ["cross_low", "tee_down", "shaft", "tee_up", "cross_high"]
    assert names(plan, onward) == ["riser_1", "tee_low", *loop, "tee_high", "riser_3"]
    assert plan.replan(leg, at, 0, [port, plan.network.port("cross_low.end")]) is None


def test_avoided_fittings_are_not_entered():
    """A fitting to avoid closes the short way; with both ways closed the goal is out of reach, and
    that is told."""
    plan = planner("tower", "foot", "head", avoid=("riser_2",))
    assert "shaft" in names(plan, plan.first)
    with pytest.raises(
        NetworkError,
        match=r"^goals.0: 'head' cannot be reached from 'foot' without cross_low, riser_2$",
    ):
        planner("tower", "foot", "head", avoid=("riser_2", "cross_low"))


def test_a_later_goal_that_is_out_of_reach_is_told_with_the_one_before():
    """From where the robot would have to go on to it."""
    parts = [{"kind": "straight", "name": name, "length": 0.6} for name in ("a", "b")]
    places = [{"fitting": "b", "position": [3.0, 0.0, 0.0]}]
    network = Network(fittings=parts, places=places)
    mission = Mission(start="a.start", goals=("a.end", "b.start", "a.start"))
    plan = MissionPlanner(network, mission, Omnitrack(), 0.1)
    with pytest.raises(NetworkError, match=r"^goals.1: 'b.start' cannot be reached from 'a.end'$"):
        plan.plan()


def test_turns_of_a_leg_are_those_into_and_out_of_branches():
    """Of a part that is driven straight through, or not at all, there are none."""
    plan = planner("fig14", "inlet", "side")
    parts = range(len(plan.network.fittings))
    turns = [edge for part in parts for edge in plan.turn_in(plan.first, part)]
    assert sorted(turns) == sorted(edge for edge in plan.first.path if "branch" in edge[1:])
    assert len(turns) > 0
    through = [edge for edge in plan.first.path if set(edge[1:]) == {"run_start", "run_end"}]
    assert through


def test_back_to_the_start_goes_tail_first():
    """A goal that is the start is backed out to; the next one is driven to from there."""
    plan = planner("fig14", "inlet", "side", "inlet", "top")
    there, back, onward = plan.plan()
    assert (back.gear, back.goal) == (-1, 1)
    assert names(plan, back) == names(plan, there)[::-1]
    assert back.end == pytest.approx(
        plan.route(back.path).centreline.length - LENGTH / 2 - Omnitrack().nose_room
    )
    assert (onward.gear, onward.goal) == (1, 2)
    assert onward.begin == pytest.approx(LENGTH / 2 + Omnitrack().nose_room)


# What a user writes


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"network": "nowhere"}, r"network: nowhere: no such file, .*choose from: .*fig14"),
        (
            {"mission.start": "nowhere"},
            r"^mission.start: there is no port 'nowhere' \(choose from: inlet, ",
        ),
        (
            {"mission.goals": ["riser.end"]},
            r"^mission.goals.0: .* joined to tee_1.run_start \(choose from: inlet, ",
        ),
        ({"mission.goals": ["inlet"]}, r"^mission.goals.0: 'inlet' is where the robot is already$"),
        (
            {"mission.goals": ["low", "low"]},
            r"^mission.goals.1: 'low' is where the robot is already$",
        ),
        ({"mission.goals": []}, r"^mission.goals: must have at least 1 item, not 0"),
        (
            {"mission.avoid": ["tee_1"]},
            r"^mission.goals.0: 'low' cannot be reached from 'inlet' without tee_1$",
        ),
        (
            {"mission.avoid": ["tee_9"]},
            r"^mission.avoid.0: there is no fitting 'tee_9'; .* \(choose from: riser, ",
        ),
        (
            {"mission.blocked": ["tee_1.end"]},
            r"^mission.blocked.0: .*choose from: tee_1.run_start, tee_1.run_end, ",
        ),
        (
            {"pipes": [{"kind": "straight", "length": 1.0}]},
            r"^pipes: are given as well as a network",
        ),
        ({"start.axis": [1.0, 0.0, 0.0]}, r"^start.axis: is for pipes"),
        ({"run.goal_distance": 1.0}, r"^run.goal_distance: is for pipes"),
        (
            {"start.distance": 0.01},
            r"^start.distance: is 0.01 m; the robot lies inside the pipe from ",
        ),
    ],
)
def test_bad_missions_are_refused_with_place_and_choices(changes, told):
    """Every fault has the dotted path of its value, and what there is to choose from."""
    with pytest.raises(ScenarioError, match=told):
        override(load_scenario("missions/fig14"), changes)


def test_what_belongs_together_is_asked_for():
    """A network needs a mission and a mission a network."""
    with pytest.raises(ScenarioError, match=r"^mission: is missing"):
        validate({"network": "fig14"})
    with pytest.raises(ScenarioError, match=r"^network: is missing: .*choose from: .*tower"):
        validate({"mission": {"start": "a", "goals": ["b"]}})


def test_bores_beyond_the_arms_are_found_on_every_leg():
    """A pipe too wide on the way to the second goal is told by its place in the network, and at
    which end it is."""
    table = load_network("house_sewer").model_dump(mode="json")
    names = [part["name"] for part in table["fittings"]]
    table["fittings"].append(
        {
            "kind": "reducer",
            "name": "funnel",
            "length": 0.2,
            "inner_diameter": 0.16,
            "end_diameter": 0.2,
        }
    )
    table["joints"].append({"ports": ["kitchen_drain.end", "funnel.start"]})
    table["ports"]["kitchen"] = "funnel.end"
    with pytest.raises(
        ScenarioError,
        match=rf"^network.fittings.{len(names)}.end_diameter: is 0.2 m; the arms reach",
    ):
        validate({"network": table, "mission": {"start": "sewer", "goals": ["yard", "kitchen"]}})


@pytest.mark.parametrize(
    "name", [name for name in shipped_files("scenarios") if name.startswith("missions/")]
)
def test_shipped_missions_are_planned_to_their_last_goal(name):
    """Each loads, says in a comment what it shows, expects to arrive, and with a known map has a
    way to every goal."""
    scenario = load_scenario(name)
    assert scenario.run.expected_outcome is Outcome.REACHED_GOAL
    assert shipped_files("scenarios")[name].read_text(encoding="utf-8").startswith("# ")
    assert scenario.mission is not None
    if scenario.mission.map == "unknown":
        assert scenario.exploration is not None
        return
    assert scenario.planner is not None
    assert scenario.planner.plan()[-1].goal == len(scenario.mission.goals) - 1


def test_network_files_are_found_beside_the_scenario(tmp_path):
    """A network may be a path relative to the scenario's folder, and another one may be set on the
    command line."""
    (tmp_path / "n.toml").write_text(load_network("fig14").to_toml())
    (tmp_path / "m.toml").write_text(
        'network = "n.toml"\n[mission]\nstart = "inlet"\ngoals = ["low"]\n'
    )
    scenario = load_scenario(tmp_path / "m.toml")
    assert scenario.network == load_network("fig14")
    changed = override(
        scenario, {"network": "tower", "mission.start": "foot", "mission.goals": ["roof"]}
    )
    assert changed.network == load_network("tower")
    assert json.loads(changed.model_dump_json())["network"]["name"] == "tower"


@pytest.mark.parametrize(("name", "camera"), [("missions/narrow", "follow"), ("straight", "side")])
def test_films_of_missions_follow_the_robot(name, camera, monkeypatch, tmp_path):
    """Without --camera the film of a mission follows, that of plain pipes is from the side."""
    used = []
    monkeypatch.setattr("omnitrack_sim.render_video", lambda *_, camera, **__: used.append(camera))
    short = ["--set", "run.time_limit=0.1", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(app, ["run", name, *short])
    assert done.exit_code == 0, done.output
    assert used == [camera]
    assert (tmp_path / "run" / "map.png").exists() == (camera == "follow")
