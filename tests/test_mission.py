"""Missions through networks: the plan, the gears, and robots that drive them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence

import numpy as np
import pytest
from typer.testing import CliRunner

from omnitrack_sim import (
    NetworkError,
    Outcome,
    ScenarioError,
    Simulation,
    load_network,
    load_result,
    load_scenario,
    override,
    run_batch,
    shipped_scenarios,
)
from omnitrack_sim.cli import app
from omnitrack_sim.control.alignment import Wish, agreed
from omnitrack_sim.control.gear import SWAPPED, carried_out, heading, seen
from omnitrack_sim.control.interface import Command
from omnitrack_sim.model.collider import why_not
from omnitrack_sim.network import Leg, Mission, Planner
from omnitrack_sim.network.mission import NOSE_ROOM
from omnitrack_sim.record.channels import CHANNELS
from omnitrack_sim.record.events import GoalReached
from omnitrack_sim.robot import Robot
from omnitrack_sim.rotations import Array
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.sim.builder import scene_of
from omnitrack_sim.sim.legs import Legs
from omnitrack_sim.sim.plant import Plant, Start
from omnitrack_sim.sim.result import Result

LENGTH = Robot().length
needs_exact = pytest.mark.skipif(why_not() is not None, reason="the exact collider does not load")


def planner(network: str, start: str, *goals: str, **more) -> Planner:
    mission = Mission(start=start, goals=goals, **more)
    return Planner(load_network(network), mission, Robot(), 0.1)


def names(plan: Planner, leg: Leg) -> list[str]:
    return [plan.network.fittings[part].name for part, _, _ in leg.way]


def mission_of(network, start: str, /, *goals: str, **tables) -> Scenario:
    """A mission on exact walls."""
    mission = {"start": start, "goals": list(goals)} | tables.pop("mission", {})
    physics = {"collider": "exact"} | tables.pop("physics", {})
    return validate({"network": network, "mission": mission, "physics": physics, **tables})


def driven(scenario: Scenario) -> Result:
    return run_batch([scenario], threads=1, no_load=False)[0]


# The plan


def test_first_leg_goes_the_shortest_way_to_the_goal():
    """Nose first from where the robot starts to where its nose is at the goal."""
    plan = planner("fig14", "inlet", "low")
    (leg,) = plan.plan()
    assert names(plan, leg) == [
        *("riser", "tee_1", "shelf", "elbow_side", "link", "tee_3", "drop", "elbow_low", "low_arm")
    ]
    assert (leg.gear, leg.goal, leg.begin) == (1, 0, 0.1)
    assert leg.end == pytest.approx(plan.route(leg).centreline.length - LENGTH / 2 - NOSE_ROOM)


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
                plan.route(leg).centreline.at(np.array([distance]))[:2]
                for leg, distance in ((first, s), (second, r))
            ]
            assert np.allclose(places[0][0], places[1][0], atol=1e-9)
            assert np.allclose(places[0][1], -places[1][1], atol=1e-9)
        parting = next(i for i, (a, b) in enumerate(zip(old.way, new.way, strict=False)) if a != b)
        passage = plan.route(new).fittings[parting]
        opening = passage.s_bend_start if passage.is_turn else passage.opening[0]
        assert new.begin + LENGTH / 2 <= opening - Robot().standing_room + 1e-9


def test_close_fittings_are_backed_out_of_together():
    """The ways part in a tee right after an elbow, or right after a tee: the robot backs out to
    before the first."""
    plan = planner("close_fittings", "inlet", "spur", "outlet", "last")
    _, back, onward, back_again, last = plan.plan()
    assert names(plan, back)[:4] == ["spur_arm", "tee_knee", "knee", "corridor"]
    knee = plan.route(onward).fittings[names(plan, onward).index("knee")]
    assert onward.begin == pytest.approx(knee.s_bend_start - Robot().standing_room - LENGTH / 2)
    assert names(plan, back_again)[:4] == ["exit_arm", "tee_c", "tee_b", "gap"]
    tee_b = plan.route(last).fittings[names(plan, last).index("tee_b")]
    assert last.begin == pytest.approx(tee_b.s_bend_start - Robot().standing_room - LENGTH / 2)


def test_a_closed_port_sends_the_robot_round_the_loop():
    """What stands before the nose is the obstacle; the way round the tower is found, and none where
    both are closed."""
    plan = planner("tower", "foot", "head")
    leg = plan.first
    assert names(plan, leg) == ["riser_1", "tee_low", "riser_2", "tee_high", "riser_3"]
    at = plan.route(leg).fittings[2].s_leave - LENGTH / 2
    port = plan.obstacle(leg, at)
    assert plan.network.port_name(port) == "riser_2.end"
    legs = plan.onward(leg, at, 0, [port])
    assert legs is not None
    back, onward = legs
    assert (back.gear, back.goal, onward.gear, onward.goal) == (-1, -1, 1, 0)
    assert back.begin == pytest.approx(plan.route(leg).fittings[2].s_leave - at)
    loop = ["cross_low", "tee_down", "shaft", "tee_up", "cross_high"]
    assert names(plan, onward) == ["riser_1", "tee_low", *loop, "tee_high", "riser_3"]
    assert plan.onward(leg, at, 0, [port, plan.network.port("cross_low.end")]) is None


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


def test_back_to_the_start_goes_tail_first():
    """A goal that is the start is backed out to; the next one is driven to from there."""
    plan = planner("fig14", "inlet", "side", "inlet", "top")
    there, back, onward = plan.plan()
    assert (back.gear, back.goal) == (-1, 1)
    assert names(plan, back) == names(plan, there)[::-1]
    assert back.end == pytest.approx(plan.route(back).centreline.length - LENGTH / 2 - NOSE_ROOM)
    assert (onward.gear, onward.goal) == (1, 2)
    assert onward.begin == pytest.approx(LENGTH / 2 + NOSE_ROOM)


# Gears


def readings(n: int = 4) -> dict[str, Array]:
    """Random values of all channels that controllers see, for n robots."""
    rng = np.random.default_rng(0)
    observed = [channel for channel in CHANNELS.values() if channel.source == "plant"]
    values = {channel.name: rng.normal(size=(n, *channel.shape)) for channel in observed}
    return values | {"rotation": np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]}


def test_turning_twice_is_the_identity():
    """Seen from behind and from behind again, a robot is what it was; likewise a command and a
    frame."""
    gear = np.array([1, -1, -1, 1])
    first = readings()
    once, twice = seen(first, gear), seen(seen(first, gear), gear)
    assert not np.array_equal(once["rotation"], first["rotation"])
    assert set(once) == set(twice) == set(first)
    for name, values in first.items():
        # A quaternion and its negative are one rotation.
        sign = np.where(gear < 0, -1.0, 1.0)[:, None] if name == "quaternion" else 1.0
        assert np.array_equal(twice[name], sign * values), name
    frames = first["rotation"]
    assert np.allclose(np.linalg.det(heading(frames, gear)), np.linalg.det(frames))
    command = Command(belt_speed=first["belt_speed"], roll=first["roll"], phase=gear)
    again = carried_out(carried_out(command, gear), gear)
    assert np.array_equal(again.belt_speed, command.belt_speed)
    assert again.roll is not None
    assert np.array_equal(again.roll, first["roll"])
    assert np.array_equal(carried_out(command, gear).belt_speed[1], -command.belt_speed[1, SWAPPED])


def test_every_channel_is_seen_from_behind_as_its_schema_says():
    """Robots in reverse see each observed channel turned as its ``tail_first`` says, the others as
    it is."""
    gear, first = np.array([1, -1]), readings(2)
    turned = {
        "same": lambda v: v,
        "swapped": lambda v: v[SWAPPED],
        "negated": lambda v: -v[SWAPPED],
        "turned": lambda v: v * [1.0, -1.0, -1.0],
        "facing": lambda v: v * [1.0, -1.0, -1.0],
        "behind": lambda v: np.array([-v[1], v[0], v[3], -v[2]]),
    }
    for name, values in seen(first, gear).items():
        assert np.array_equal(values[0], first[name][0]), name
        expected = turned[CHANNELS[name].tail_first](first[name][1])
        assert np.array_equal(values[1], expected), name


def tail_first_plant(scenario: Scenario, start: Start, threads: int) -> Plant:
    """The robots turned by 180 degrees about their x axes."""
    w, x, y, z = start.quaternion.T
    turned = np.stack([-x, w, z, -y], axis=-1)  # the product with a half turn about x
    return Plant(
        scene_of(scenario).compile(),
        scenario.robot,
        dataclasses.replace(start, quaternion=turned),
        threads,
    )


class TailFirstLegs(Legs):
    """Legs that are driven tail first from the start."""

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        super().__init__(scenarios)
        self.gear = -self.gear


@needs_exact
@pytest.mark.parametrize(("theta5_deg", "until"), [(0.0, 99.0), (50.0, 4.5)])
def test_tail_first_is_nose_first_seen_from_behind(theta5_deg, until, monkeypatch):
    """Through an elbow: the same way, with belts and rolls of modules 2 and 3 exchanged.

    From 50 degrees the modules are rolled first. In the elbow, where the robot is then not
    symmetric, contacts that come and go make much of differences by rounding from about 5 s on.
    """
    pipes = [{"kind": "straight", "length": 0.4}, {"kind": "elbow", "mean_radius": 0.24}]
    pipes.append({"kind": "straight", "length": 0.4})
    start = {"distance": 0.12, "theta5_deg": theta5_deg}
    scenario = validate({"pipes": pipes, "start": start, "physics": {"collider": "exact"}})
    there = Simulation([scenario])
    monkeypatch.setattr("omnitrack_sim.sim.simulation.Legs", TailFirstLegs)
    runs = [there, Simulation([scenario], make_plant=tail_first_plant)]
    for run in runs:
        run.advance()
    nose, tail = (run.results()[0] for run in runs)
    assert nose.outcome is tail.outcome is Outcome.REACHED_GOAL
    assert (tail.trajectory["gear"] == -1).all()
    assert tail.duration_s == pytest.approx(nose.duration_s, abs=0.1)
    a, b = nose.trajectory, tail.trajectory
    n = int(np.searchsorted(a.time, min(until, tail.duration_s)))
    assert a["distance"][n - 1] > 0.35  # the nose is in the elbow at least
    assert np.abs(a["position"][:n] - b["position"][:n]).max() < 0.001
    assert np.abs(a["tilt"][:n] - b["tilt"][:n]).max() < np.radians(0.5)
    assert np.abs(a["roll_command"][:n] + b["roll_command"][:n][:, SWAPPED]).max() < np.radians(0.1)
    assert np.abs(a["belt_speed"][:n] + b["belt_speed"][:n][:, SWAPPED]).max() < 0.005


# What an aligner wishes for


def test_wishes_agree_on_what_they_have_in_common():
    """The common range of two wishes, the first one's where they have none, modulo the period of
    the modules."""
    margin = np.radians([10.0])
    best, width = agreed([Wish(0.0, margin), Wish(np.radians(12.0), margin)])
    assert np.degrees([best[0], width[0]]) == pytest.approx([6.0, 4.0])
    best, width = agreed([Wish(0.0, margin), Wish(np.radians(132.0), margin)])
    assert np.degrees([best[0], width[0]]) == pytest.approx([6.0, 4.0])
    best, width = agreed(
        [Wish(0.0, margin), Wish(np.radians(60.0), margin), Wish(np.radians(-8.0), margin)]
    )
    assert np.degrees([best[0], width[0]]) == pytest.approx([-4.0, 6.0])
    best, width = agreed([Wish(0.3, np.array([0.1, 0.2])), Wish(0.5, np.array([0.05, 0.1]))])
    assert best == pytest.approx([0.3, 0.45])
    assert width == pytest.approx([0.1, 0.05])


# Robots that drive


@pytest.fixture(scope="module")
def dead_end() -> Result:
    # At theta5 = 0 the last merge, against gravity, is close: some processors' sines decide it.
    changes = {"physics.collider": "exact", "start.theta5_deg": 10.0}
    return driven(override(load_scenario("missions/dead_end"), changes))


@needs_exact
def test_a_robot_before_a_plate_backs_out_and_goes_round(dead_end):
    """It takes the port for closed, backs out tail first, goes round the loop and arrives."""
    assert dead_end.success, dead_end.reason
    assert [leg.gear for leg in dead_end.legs] == [1, -1, 1]
    assert any("takes riser_2.end for closed" in str(event) for event in dead_end.events)
    trajectory = dead_end.trajectory
    assert np.unique(trajectory["leg"]).tolist() == [0, 1, 2]
    assert (trajectory["gear"] == np.array([1, -1, 1])[trajectory["leg"].astype(int)]).all()
    jump = np.linalg.norm(np.diff(trajectory["position"], axis=0), axis=1)
    assert jump.max() < 0.02
    visits = dead_end.timeline()
    assert [visit.name for visit in visits if visit.leg == 1] == ["riser_2", "tee_low", "riser_1"]
    assert visits[-1].name == "riser_3"
    assert sum(visit.duration_s for visit in visits) == pytest.approx(dead_end.duration_s)
    way = sum(
        abs(trajectory["distance"][trajectory["leg"] == leg][[0, -1]] @ [-1, 1]) for leg in range(3)
    )
    assert dead_end.metrics["distance_m"] == pytest.approx(way)
    end = dead_end.goal_points()[-1] - trajectory["position"][-1]
    assert np.linalg.norm(end) == pytest.approx(LENGTH / 2 + NOSE_ROOM, abs=0.005)


@needs_exact
def test_a_mission_is_saved_and_read_back(dead_end, tmp_path):
    """Legs, events, routes and plates come back as they were."""
    again = load_result(dead_end.save(tmp_path / "run"))
    assert again.legs == dead_end.legs
    assert again.events == dead_end.events
    assert again.scenario == dead_end.scenario
    assert again.timeline() == dead_end.timeline()
    assert [r.centreline.length for r in again.routes()] == [
        r.centreline.length for r in dead_end.routes()
    ]
    assert again.plate_rims().shape == (1, 25, 3)
    assert np.allclose(
        np.linalg.norm(
            again.plate_rims() - again.plate_rims().mean(axis=1, keepdims=True), axis=-1
        ),
        0.08,
        atol=0.01,
    )


@needs_exact
def test_a_robot_with_no_other_way_gives_up():
    """A plate in the only way: the run ends there, and the events tell why."""
    pipes = [{"kind": "straight", "name": name, "length": 0.4} for name in ("a", "b")]
    network = {"fittings": pipes, "joints": [{"ports": ["a.end", "b.start"]}]}
    result = driven(mission_of(network, "a.start", "b.end", mission={"blocked": ["a.end"]}))
    assert result.outcome in (Outcome.STUCK, Outcome.SLIPPING, Outcome.STALLED)
    assert str(result.events[-1]).endswith("no other way: gives up")
    assert len(result.legs) == 1


@needs_exact
def test_a_goal_that_is_cut_off_on_the_way_is_no_success(monkeypatch):
    """At the first goal with the second one out of reach by what was found closed: not arrived, and
    told so."""
    scenario = mission_of("fig14", "top", "far", "low")
    run = Simulation([scenario])
    assert run.legs.missed(0) == ("low",)
    onward = Planner.onward
    closed = [scenario.network.port("drop.end")]  # type: ignore[union-attr]
    monkeypatch.setattr(
        Planner, "onward", lambda self, leg, at, goal, _: onward(self, leg, at, goal, closed)
    )
    run.advance()
    (result,) = run.results()
    assert result.outcome is Outcome.STUCK
    assert result.reason.startswith("no way to low is left; ")
    assert str(result.events[-2]).endswith("reached far")


@needs_exact
def test_two_goals_one_after_the_other():
    """The robot tells each goal it reaches and backs out of the first."""
    result = driven(mission_of("house_sewer", "sewer", "yard", "kitchen"))
    assert result.success, result.reason
    assert [leg.goal for leg in result.legs] == [0, -1, 1]
    assert any(isinstance(event, GoalReached) and event.goal == "yard" for event in result.events)
    assert result.goal_points().shape == (2, 3)


@needs_exact
def test_fittings_close_together_are_passed():
    """An S-bend, then a tee right after an elbow."""
    sizes = [
        ("straight", 0.3),
        ("elbow", 0.09),
        ("elbow", 0.09),
        ("straight", 0.3),
        ("elbow", 0.09),
        ("tee", None),
    ]
    sizes.append(("straight", 0.3))
    keys = {"straight": "length", "elbow": "mean_radius"}
    fittings = [
        {"kind": kind, "name": f"p{i}"} | ({keys[kind]: size} if size else {})
        for i, (kind, size) in enumerate(sizes)
    ]
    joints = [{"ports": [f"p{i}.end", f"p{i + 1}.start"]} for i in range(4)]
    joints[1]["turn_deg"] = 180.0
    joints += [
        {"ports": ["p4.end", "p5.run_start"], "turn_deg": 90.0},
        {"ports": ["p5.branch", "p6.start"]},
    ]
    result = driven(mission_of({"fittings": fittings, "joints": joints}, "p0.start", "p6.end"))
    assert result.success, result.reason
    assert [visit.name for visit in result.timeline()] == [f"p{i}" for i in range(7)]


@needs_exact
def test_a_mission_does_not_depend_on_its_batch():
    """Missions with other starts and goals share a batch, one with a leg added on the way: same
    bits as alone."""
    scenarios = [
        mission_of("fig14", "top", "far"),
        mission_of("fig14", "far", "top", start={"theta5_deg": 20.0}),
        mission_of("fig14", "top", "far", "top"),
    ]
    together = run_batch(scenarios, threads=1, no_load=False)
    assert [len(result.legs) for result in together] == [1, 1, 2]
    for scenario, result in zip(scenarios, together, strict=True):
        alone = driven(scenario)
        assert alone.events == result.events
        assert alone.legs == result.legs
        assert np.array_equal(alone.trajectory.time, result.trajectory.time)
        for name, values in alone.trajectory.channels.items():
            assert np.array_equal(values, result.trajectory[name], equal_nan=True), name


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
        ({"mission.goals": []}, r"^mission.goals: list should have at least 1 item"),
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
        ({"goal.distance": 1.0}, r"^goal.distance: is for pipes"),
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
    "name", [name for name in shipped_scenarios() if name.startswith("missions/")]
)
def test_shipped_missions_are_planned_to_their_last_goal(name):
    """Each loads, says in a comment what it shows, expects to arrive, and has a way to every
    goal."""
    scenario = load_scenario(name)
    assert scenario.expect.outcome is Outcome.REACHED_GOAL
    assert scenario.physics.collider == "primitives"
    assert shipped_scenarios()[name].read_text(encoding="utf-8").startswith("# ")
    assert scenario.planner is not None
    assert scenario.mission is not None
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
    monkeypatch.setattr(
        "omnitrack_sim.film.render.render_video", lambda *_, camera, **__: used.append(camera)
    )
    short = ["--set", "physics.time_limit=0.1", "--fast", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(app, ["run", name, *short])
    assert done.exit_code == 0, done.output
    assert used == [camera]
    assert (tmp_path / "run" / "map.png").exists() == (camera == "follow")
