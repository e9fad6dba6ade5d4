"""Robots that explore, and what a user may write for them."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from commands import omnitrack
from network_samples import forked, tee
from typer.testing import CliRunner

from omnitrack_sim import (
    Network,
    Outcome,
    Result,
    ScenarioError,
    Simulation,
    load_network,
    load_result,
    load_scenario,
    override,
    run,
)
from omnitrack_sim.autonomy.pilots import Decision, Hindrance
from omnitrack_sim.cli import app
from omnitrack_sim.record.events import EndInspected, ExplorationComplete, GaveUp, GoalReached
from omnitrack_sim.scenario import Scenario, validate
from omnitrack_sim.sim.monitor import Verdict
from omnitrack_sim.sim.run import run_batch


def fork(**mission) -> Scenario:
    """A tee with a short pipe at each port; one of them is closed by a plate."""
    network = forked(on=0.2, off=0.2) | {"ports": {"far": "on.end"}}
    table = {"start": "foot.start", "map": "unknown", "task": "explore", **mission}
    data = {"name": "fork", "network": network, "mission": table}
    fast = {"control": {"cruise_speed": 0.15}}
    return validate(data | {"world": {"gravity": [0, 0, 0]}} | fast)


def test_a_robot_explores_and_comes_back(tmp_path):
    """Both ends are inspected, the closed one too; the map is saved, read back and a network."""
    result = run(fork(blocked=["on.end"]))
    assert result.outcome is Outcome.REACHED_GOAL, result.reason
    ends = [event.what for event in result.events if isinstance(event, EndInspected)]
    assert sorted(ends) == ["closed", "open"]
    difference = result.map_difference()
    assert difference is not None
    assert difference.same, difference
    assert result.metrics["map_complete"] == result.metrics["map_found"] == 1.0
    position = result.trajectory["position"][-1]
    assert np.linalg.norm(position) < 0.1
    folder = result.save(tmp_path / "run")
    again = load_result(folder)
    assert again.map == result.map == load_network(folder / "map.toml")
    assert again.legs == result.legs
    assert len(again.timeline()) == len(result.timeline())
    told = CliRunner().invoke(app, ["network", str(folder / "map.toml")])
    assert told.exit_code == 0, told.output
    assert "tee_1" in told.output
    (folder / "map.toml").write_text('name = "map"\n[[fittings]]\nname = "a"\nkind = "tee"\n')
    with pytest.raises(Exception, match=r"legs.0.path"):
        load_result(folder)
    check_that_a_part_missing_is_said(result)


def check_that_a_part_missing_is_said(whole: Result) -> None:
    """Outcome and advice say both where a robot is home and its map lacks a part; one that searches
    for goals needs no whole map."""
    assert (whole.ending, whole.missing) == ("reached goal", ())
    assert whole.map is not None
    table = whole.map.model_dump(mode="json")
    last = table["fittings"].pop()["name"]
    table["joints"] = [j for j in table["joints"] if not any(last in end for end in j["ports"])]
    table["ports"] = {k: end for k, end in table["ports"].items() if not end.startswith(last)}
    lacking = replace(whole, map=Network.model_validate(table))
    (missing,) = lacking.missing
    assert missing in ("on", "off")
    assert lacking.ending == "reached goal, 1 part not mapped"
    assert f"its map lacks {missing}" in lacking.advice == lacking.summary()["advice"]
    assert lacking.ending in lacking._repr_html_()
    searched = replace(lacking, scenario=fork(task="find", goals=["far"]))
    assert (searched.missing, searched.ending) == ((), "reached goal")


def test_a_wrong_map_is_no_goal_reached():
    """A robot that is back, and takes a pipe off its way home to be 0.5 m longer than it is, hears
    of it with figures; what it has done never reads as all before it is back."""
    sim, parts = Simulation([fork()]), [0.0]
    pilot = sim.legs.pilots[0]
    belief = pilot.belief
    assert belief is not None
    while sim.active.any():
        parts.append(pilot.done_at(float(sim.location.distance[0])))
        inspected = [event.port for event in sim.events[0] if isinstance(event, EndInspected)]
        sim.step()
        if len(inspected) == 1 and pilot.unexplored == "" and len(belief.explored) == 2:
            part, _ = belief.network.port(inspected[0])
            belief.lengthen(part, 0.5)
    (ending,) = sim.endings
    assert ending is not None
    assert ending.outcome is Outcome.WRONG_MAP
    assert "4 of 4 parts are in the map; lengths off by 0.5" in ending.reason
    assert max(parts) < 1


def test_a_robot_finds_alone_as_in_a_batch():
    """The run is over at the goal, whose name is in the map; the numbers are the same in a batch
    with another robot."""
    scenario = fork(task="find", goals=["far"])
    other = override(scenario, {"world.friction": 0.8})
    alone, (first, second) = run(scenario), run_batch([scenario, other])
    assert alone.outcome is second.outcome is Outcome.REACHED_GOAL
    assert not any(isinstance(event, ExplorationComplete) for event in alone.events)
    assert [event.goal for event in alone.events if isinstance(event, GoalReached)] == ["far"]
    assert alone.map is not None
    assert "far" in alone.map.ports
    assert alone.map == first.map
    assert alone.events == first.events
    for name in ("position", "distance", "belt_speed"):
        assert np.array_equal(alone.trajectory[name], first.trajectory[name])


def test_a_goal_that_cannot_be_found_is_told():
    """A plate is before it: the robot explores the rest, comes back, and the reason names it."""
    result = run(fork(task="find", goals=["far"], blocked=["on.start"]))
    assert result.outcome is Outcome.STUCK
    assert result.reason.startswith("no way to far is left")


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (
            {"mission.map": "known"},
            r'^mission.task: is for an unknown map \(mission.map = "unknown"\)',
        ),
        ({"mission.task": None}, r"^mission.task: is missing with an unknown map .*explore, find"),
        ({"mission.task": "wander"}, r"^mission.task: .*wander"),
        ({"mission.map": "old"}, r"^mission.map: .*old"),
        ({"mission.goals": ["bath"]}, r'^mission.goals: are for mission.task = "find"'),
        ({"mission.task": "find"}, r"^mission.goals: must have at least 1 item"),
        (
            {"mission.task": "find", "mission.goals": ["attic"]},
            r"^mission.goals.0: there is no port 'attic' \(choose from: sewer, ",
        ),
        (
            {"mission.task": "find", "mission.goals": ["sewer"]},
            r"^mission.goals.0: 'sewer' is where the robot is already",
        ),
        ({"mission.avoid": ["foot"]}, r"^mission.avoid: is for a known map"),
        ({"mission.blocked": ["attic.end"]}, r"^mission.blocked.0: "),
        ({"start.distance": 0.55}, r"^start.distance: is 0.55 m; the robot lies inside"),
    ],
)
def test_what_does_not_go_together_is_told_with_its_place(changes, problem):
    """Each with its key and the valid choices."""
    with pytest.raises(ScenarioError, match=problem):
        override(load_scenario("missions/explore_house"), changes)


def test_a_robot_begins_to_explore_in_a_straight():
    """Not in a bend, of which it would not know how far it goes."""
    with pytest.raises(ScenarioError, match=r"^mission.start: is in a tee; a robot begins"):
        validate(
            {
                "network": {"fittings": [tee("t")]},
                "mission": {"start": "t.branch", "map": "unknown", "task": "explore"},
            }
        )


def test_bad_input_ends_with_status_2():
    """And the message names the key."""
    done = omnitrack("run", "missions/explore_loop", "--set", "mission.task=find")
    assert done.returncode == 2
    assert "mission.goals: must have at least 1 item" in done.stderr


@pytest.mark.parametrize(("tilt", "called"), [(0.4, "on_blockage"), (0.6, "on_fall")])
def test_a_robot_that_hangs_across_its_pipe_is_to_right_itself(tilt, called, monkeypatch):
    """No other way helps one that lies across: it has fallen, though it is on its route."""
    simulation = Simulation([fork()])
    runs, senses = simulation.runs, simulation.senses
    here = {name: getattr(senses.location, name) for name in ("distance", "distance_std")}
    senses.location = SimpleNamespace(**here, tilt=np.array([tilt]))
    pilot, names = simulation.legs.pilots[0], []
    for name in ("on_fall", "on_blockage"):

        def decide(*told, name=name):
            names.append(name)
            return Decision(pilot.leg)

        monkeypatch.setattr(pilot, name, decide)
    runs.carry_out([Verdict(0, Hindrance.NO_HEADWAY)])
    assert names == [called]
    assert runs.active[0]


@pytest.mark.parametrize(
    ("lies", "sensing", "goes_on"),
    [(True, "truth", True), (False, "truth", False), (False, "onboard", True)],
    ids=["lies in a pipe", "lies in none", "takes itself to lie in none"],
)
def test_a_robot_that_hangs_as_it_rights_itself(lies, sensing, goes_on, monkeypatch):
    """The leg was planned for it as it lay across; where it lies along by now, others lead on.
    Where it lies in no pipe by its own estimate, that is wrong: it looks around."""
    simulation = Simulation([override(fork(), {"sensing.kind": sensing})])
    runs, senses = simulation.runs, simulation.senses
    names = "distance", "distance_std", "tangent"
    here = {name: getattr(senses.location, name) for name in names}
    monkeypatch.setattr(senses, "location", SimpleNamespace(**here, tilt=np.array([0.2])))
    pilot = simulation.legs.pilots[0]
    over = Decision(None, events=[GaveUp(0, 0.0, "no headway as it rights itself in tee_1")])
    monkeypatch.setattr(pilot, "on_blockage", lambda *told: over)
    monkeypatch.setattr(pilot, "on_fall", lambda *told: Decision(pilot.leg if lies else None))
    runs.carry_out([Verdict(0, Hindrance.NO_HEADWAY)])
    assert runs.active[0] == goes_on
    assert any(isinstance(event, GaveUp) for event in runs.events[0]) != goes_on
    if sensing == "onboard":
        assert senses.localiser.inconsistent[0]


@pytest.mark.parametrize(
    ("gear", "gone", "told"),
    [(-1, 0.1, True), (-1, 0.01, False), (-1, -0.1, False), (1, 0.1, False)],
)
def test_the_reason_says_that_a_robot_drove_against_its_gear(gear, gone, told):
    """One that is ahead of where a leg tail first began has gone nose first; by a centimetre, or
    tail first, or on a leg nose first, none is said to."""
    simulation = Simulation([fork()])
    runs, pilot = simulation.runs, simulation.legs.pilots[0]
    begin = float(runs.location.distance[0]) + gone
    pilot.leg = replace(pilot.leg, gear=gear, begin=begin)
    runs._end(0, Outcome.LEFT_PIPE)
    reason = runs.endings[0].reason
    words = "moved nose first by 100 mm though its leg is driven tail first: controllers get"
    assert (words in reason) == told
    assert ("nose first" in reason) == told


def test_an_explorer_that_has_fallen_too_often_gives_up_at_once(monkeypatch):
    """Also by its own sensors: it has been where it takes itself to be, and looks around no more.
    Where it does not even know on which pipe it lies, it does."""
    for events, over in (([GaveUp(0, 0.0, "has fallen too often")], True), ([], False)):
        simulation = Simulation([override(fork(), {"sensing.kind": "onboard"})])
        runs, pilot = simulation.runs, simulation.legs.pilots[0]
        fallen = Decision(None, events=events)
        monkeypatch.setattr(pilot, "on_fall", lambda *told, fallen=fallen: fallen)
        runs.carry_out([Verdict(0, Hindrance.OFF_ROUTE)])
        assert runs.active[0] != over


@pytest.mark.parametrize(
    ("tilts", "rights"),
    [([0.1, 0.9], True), ([0.1, 0.7], False), ([0.9, 0.9], False)],
    ids=["falls over", "leans", "lay across as its leg began"],
)
def test_a_robot_that_falls_over_rights_itself_before_it_is_wedged(tilts, rights, monkeypatch):
    """It leans by 52 degrees for longer than half a second, and was upright on this leg; 40 degrees
    a robot makes up for as it drives on. Where its pilot knows no leg, it is asked again."""
    simulation = Simulation([fork()])
    monitor, pilot = simulation.monitor, simulation.legs.pilots[0]
    times, clock, period = [], [], simulation.period
    nobody = np.zeros(1, bool)

    def fall(time, position, axis):
        times.append(clock[-1])
        return Decision(None)

    monkeypatch.setattr(pilot, "on_fall", fall)
    monitor.start_leg(0, 0.0)
    for tilt, step in product(tilts, range(round(1.3 / period))):
        clock.append(step * period)
        simulation.location.__dict__["tilt"] = np.array([tilt])
        flags = dict.fromkeys(("arrived", "diverged", "lost", "over"), nobody)
        found = monitor.look(
            simulation.readings, simulation.location, ~nobody, resting=~nobody, **flags
        )
        simulation.runs.carry_out(found)
    assert times == [pytest.approx(time, abs=0.03) for time in (0.5, 1.0)[: 2 * rights]]
