"""Robots that have fallen off their way: where they are, what they plan from there, and how they
drive on."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
from network_samples import branched, joint, straight
from runs import same_result

import omnitrack_sim as ot
from omnitrack_sim.autonomy.leg_planner import PartLocation
from omnitrack_sim.autonomy.mission import Mission, MissionPlanner
from omnitrack_sim.autonomy.pilots import Decision, Planned
from omnitrack_sim.base.rotations import Array, unit
from omnitrack_sim.pipes.network import load_network, validate
from omnitrack_sim.record.events import FellOff, GaveUp
from omnitrack_sim.robots.omnitrack import Omnitrack
from omnitrack_sim.robots.omnitrack.control.jacobian import JacobianController
from omnitrack_sim.scenario import validate as validate_scenario

LENGTH = Omnitrack().length
TEE = 1
"""Index of the tee of ``branched``: its middle is 0.56 m up the z axis, its branch along x."""
MIDDLE = np.array([0.0, 0.0, 0.56])
UP = np.array([0.0, 0.0, 1.0])


def planner(network: str, *goals: str, start: str = "foot", **more) -> MissionPlanner:
    return MissionPlanner(
        load_network(network), Mission(start=start, goals=goals, **more), Omnitrack(), 0.1
    )


def tee(*goals: str, **more) -> MissionPlanner:
    mission = Mission(start="a.start", goals=goals or ("c.start",), **more)
    return MissionPlanner(validate(branched()), mission, Omnitrack(), 0.1)


def pose(plan: MissionPlanner, where: PartLocation) -> tuple[Array, Array]:
    """Position (3,) m and axis (3,) of a robot."""
    line = plan.network.pipes.parts[where.part].axis(where.behind, where.ahead, plan.arcs)
    position, tangent, _, _ = line.at(np.array([where.to_behind]))
    return position[0], tangent[0]


def everywhere(plan: MissionPlanner) -> list[PartLocation]:
    """In the middle of each part, from each port to each other one."""
    places = []
    for index, part in enumerate(plan.network.pipes.parts):
        for behind, ahead in itertools.permutations(part.fitting.port_names, 2):
            half = part.axis(behind, ahead, plan.arcs).length / 2
            places.append(PartLocation(index, behind, ahead, half, half))
    return places


# Where it lies


@pytest.mark.parametrize("network", ["tower", "close_fittings"])
def test_a_robot_is_found_where_it_lies(network: str) -> None:
    """In every pipe and elbow, either way round, at its place between the two ports."""
    inlet = next(iter(load_network(network).ports))
    far = list(load_network(network).ports)[-1]
    plan = planner(network, far, start=inlet)
    found = 0
    for where in everywhere(plan):
        if len(plan.network.pipes.parts[where.part].fitting.port_names) > 2:
            continue
        again = plan.locate(*pose(plan, where))
        if again is None:  # shorter than the robot, round a corner
            assert where.to_ahead < LENGTH / 2
            continue
        found += 1
        assert (again.behind, again.ahead, again.across) == (where.behind, where.ahead, False)
        assert again.part == where.part
        assert (again.to_behind, again.to_ahead) == pytest.approx(
            (where.to_behind, where.to_ahead), abs=1e-9
        )
    assert found > 10


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("tilt_deg", "lies"), [(0, "along"), (29, "along"), (31, "across"), (79, "across"), (81, None)]
)
def test_in_a_tee_a_robot_lies_along_the_run_or_across_it(
    tilt_deg: float, lies: str | None, side: int
) -> None:
    """By its angle to the run; where it is square across, no port is ahead of its nose."""
    angle = np.radians(tilt_deg)
    axis = np.array([np.sin(angle), 0.0, side * np.cos(angle)])
    found = tee().locate(MIDDLE + 0.1 * UP, axis)
    assert (found is None) is (lies is None)
    if found is not None:
        assert found.part == TEE
        assert found.ahead == ("run_end" if side > 0 else "run_start")
        assert found.across is (lies == "across")
        assert found.to_behind == pytest.approx(0.26 if side > 0 else 0.06)


@pytest.mark.parametrize(
    ("position", "axis"),
    [
        ([0.0, 0.0, 0.06], [0, 0, 1]),  # its tail out of the open end of a
        ([0.05, 0.0, 0.25], [0, 0, 1]),  # beside the axis, its ends in the bore
        ([0.0, 0.0, 0.25], [0.7, 0, 0.7]),  # across a straight
        ([0.0, 0.5, 0.56], [0, 0, 1]),  # outside
    ],
)
def test_a_robot_in_no_pipe_is_not_found(position: list[float], axis: list[float]) -> None:
    """Out of an open end, beside the axis, across a pipe without a branch, and elsewhere."""
    assert tee().locate(np.array(position), unit(axis)) is None
    assert tee().locate(0.25 * UP, UP) is not None


# What it plans


@pytest.mark.parametrize(("network", "ends"), [("tower", 4), ("fig14", 5)])
def test_from_everywhere_a_way_leads_to_every_goal(network: str, ends: int) -> None:
    """The first leg begins where the robot lies, in the gear that its nose or tail leads in; each
    further one begins where the one before it ended; the last one ends at the goal."""
    ports = list(load_network(network).ports)[:ends]
    for goal in ports[1:]:
        plan = planner(network, goal, start=ports[0])
        for where in everywhere(plan):
            legs = plan.replan_from(where, 0, ())
            assert legs is not None
            position, axis = pose(plan, where)
            for leg in legs:
                line = plan.route(leg.path).centreline
                points, tangents, _, _ = line.at(np.array([leg.begin, leg.end]))
                # The arcs into and out of a branch lie beside each other.
                assert np.linalg.norm(points[0] - position) < 0.06
                assert tangents[0] @ axis * leg.gear > 0.8
                position, axis = points[1], tangents[1] * leg.gear
            assert legs[-1].goal == 0
            assert legs[-1].path[-1][::2] == plan.ends[1]
            assert all(leg.goal == -1 for leg in legs[:-1])


def test_the_gear_is_that_in_which_it_has_to_travel_less() -> None:
    """In the far half of the run, nose up or down: the robot backs off to where it can stand before
    the opening, and takes the branch from there with that end first which is nearer to it."""
    plan = tee()
    for behind, gear in (("start", -1), ("end", 1)):
        ahead = "end" if behind == "start" else "start"
        (leg,) = plan.replan_from(PartLocation(2, behind, ahead, 0.2, 0.2), 0, ()) or ()
        assert leg.gear == gear
        assert leg.path == ((2, "end", "start"), (TEE, "run_end", "branch"), (3, "end", "start"))
    near = PartLocation(TEE, "run_start", "run_end", 0.28, 0.04)
    out, on = plan.replan_from(near, 0, ()) or ()
    assert (out.gear, on.gear, out.note, on.note) == (
        *(1, -1),
        *("drives out of t", "to c.start, tail first"),
    )
    opening = plan.route(on.path).passages[1].s_bend_start
    assert on.begin == pytest.approx(opening - LENGTH / 2 - Omnitrack().standing_room)


@pytest.mark.parametrize("driven", [True, False])
def test_a_robot_does_not_turn_in_a_tee_that_it_cannot_stand_before(driven: bool) -> None:
    """Out of a wye, its tail just before the tee that follows: it leaves the way it has come, to
    where it can roll for the turn. Where it has come out of the tee, it backs through that turn as
    it is, which is the shorter way."""
    pipes = [straight("a"), straight("b"), straight("c"), straight("d", 0.5)]
    fittings = [*pipes, {"kind": "wye", "name": "w"}, {"kind": "tee", "name": "t"}]
    joints = [
        joint("a.end", "w.run_start"),
        joint("w.branch", "d.start"),
        joint("w.run_end", "t.branch", 90.0),
        joint("t.run_start", "b.start"),
        joint("t.run_end", "c.start"),
    ]
    network = validate({"fittings": fittings, "joints": joints})
    plan = MissionPlanner(network, Mission(start="a.start", goals=("b.end",)), Omnitrack(), 0.1)
    lies = PartLocation(4, "run_end", "run_start", 0.08, 0.36)
    first, *_ = plan.replan_from(lies, 0, (), [(5, "run_end", "branch")] if driven else ()) or ()
    assert first.gear == (-1 if driven else 1)
    turn = (5, "branch", "run_end")
    assert (turn in first.path) is driven


@pytest.mark.parametrize(("ahead", "gear"), [("run_end", -1), ("run_start", 1)])
@pytest.mark.parametrize("goal", ["c.start", "b.end"])
def test_a_robot_that_lies_across_first_drives_over_the_opening(
    ahead: str, gear: int, goal: str
) -> None:
    """From the upper half of the run down, to where it can stand in the pipe below; from there it
    plans as any other."""
    plan = tee(goal)
    behind, passed = {"run_end": ("run_start", 0.26), "run_start": ("run_end", 0.06)}[ahead]
    lies = PartLocation(TEE, behind, ahead, passed, 0.32 - passed, across=True)
    first, *others = plan.replan_from(lies, 0, ()) or ()
    assert (first.gear, first.goal, first.note) == (gear, -1, "rights itself in t")
    assert first.path == ((2, "end", "start"), (TEE, "run_end", "run_start"), (0, "end", "start"))
    assert first.begin == pytest.approx(0.4 + 0.06)
    assert first.end == pytest.approx(0.4 + 0.32 + LENGTH / 2 + Omnitrack().standing_room)
    assert [leg.gear for leg in others] == [-gear]
    assert plan.route(others[0].path).length - others[0].end == pytest.approx(LENGTH / 2 + 0.005)


def test_a_turn_that_a_robot_has_fallen_off_is_taken_from_the_other_side() -> None:
    """It drives past the branch and comes back to it; where it cannot, it tries the turn again."""
    pilot = past_the_tee().pilot(0)
    righted = pilot.on_fall(1.0, MIDDLE + 0.1 * UP, unit([0.9, 0.0, 0.45])).leg
    out, on = (pilot.on_arrival(1.0, pilot.leg.end, "").leg for _ in range(2))
    assert [leg.gear for leg in (righted, out, on)] == [-1, 1, -1]
    assert (TEE, "run_end", "branch") in on.path
    assert [part for part, _, _ in out.path][:2] == [0, TEE]


@pytest.mark.parametrize("length", [0.3, 0.9])
def test_a_robot_below_a_turn_that_is_closed_to_it_comes_back_to_it(length: float) -> None:
    """Past the branch and back into it, also where the goal is the nearest open end; without a pipe
    there to turn in there is no way."""
    fittings = [straight("a"), {"kind": "tee", "name": "t"}, straight("b", length), straight("c")]
    mission = Mission(start="a.start", goals=("c.start",))
    plan = MissionPlanner(validate(branched(fittings=fittings)), mission, Omnitrack(), 0.1)
    lies = PartLocation(0, "start", "end", 0.3, 0.1)
    out, on = plan.replan_from(lies, 0, plan.turn_in(plan.first, TEE)) or ()
    assert (out.gear, on.gear) == (1, -1)
    assert on.path == ((2, "end", "start"), (TEE, "run_end", "branch"), (3, "end", "start"))
    closed = tee(avoid=("b",))
    assert closed.replan_from(lies, 0, closed.turn_in(closed.first, TEE)) is None
    assert closed.replan_from(lies, 0, ()) is not None


def test_what_is_closed_or_to_be_avoided_is_not_passed() -> None:
    """From the far half of the run: with the branch closed there is no way; a fitting to avoid that
    the robot has fallen into is left."""
    plan, lies = tee(), PartLocation(2, "start", "end", 0.2, 0.2)
    assert plan.replan_from(lies, 0, [plan.network.port("t.branch")]) is None
    careful = tee(avoid=("b",))
    out, on = careful.replan_from(lies, 0, ()) or ()
    assert (out.gear, on.gear) == (-1, 1)
    assert [part for part, _, _ in on.path] == [0, TEE, 3]


def test_a_robot_goes_on_from_a_goal_that_it_has_reached_tail_first() -> None:
    """The next leg is nose first, out of the pipe that it has backed into."""
    plan = tee("c.start", "b.end")
    (leg,) = plan.replan_from(PartLocation(2, "start", "end", 0.2, 0.2), 0, ()) or ()
    (onward,) = plan.replan(leg, leg.end, 1, ()) or ()
    assert (leg.gear, onward.gear, onward.goal) == (-1, 1, 1)
    assert [part for part, _, _ in onward.path] == [3, TEE, 2]
    assert onward.begin == pytest.approx(plan.route(leg.path).length - leg.end)


# What it does


def past_the_tee(*goals: str, **tables) -> ot.Scenario:
    """A mission from below a tee, by default into its branch, without gravity."""
    network = branched(fittings=[straight("a"), {"kind": "tee", "name": "t"}, straight("b", 0.5)])
    network["fittings"].append(straight("c", 0.3))
    return validate_scenario(
        {
            "network": network,
            "mission": {"start": "a.start", "goals": list(goals or ("c.start",))},
            "world": {"gravity": [0.0, 0.0, 0.0]},
            "control": {"cruise_speed": 0.15, "align": False},
            "start": {"distance": 0.3},
            **tables,
        }
    )


class Careless(JacobianController):
    """Drives straight on while it is on its first leg, or as often as ``times`` says."""

    times = 1

    def step(self, observation: ot.Observation) -> ot.Command:
        command = super().step(observation)
        careless = observation.leg < self.times
        speed = np.repeat(self.settings.cruise_speed[:, None], 3, axis=1)
        straight_on = speed * np.sign(np.cos(observation.roll))
        return command._replace(
            belt_speed=np.where(careless[:, None], straight_on, command.belt_speed),
            resting=np.zeros(len(careless), bool),
            events=[] if careless.all() else command.events,
        )


class AlwaysCareless(Careless):
    times = 1000


def falls(result: ot.Result) -> list[FellOff]:
    return [event for event in result.events if isinstance(event, FellOff)]


@pytest.fixture(scope="module")
def fallen() -> ot.Result:
    return ot.run_batch([past_the_tee()], controller=Careless, no_load=False)[0]


def test_a_robot_that_has_gone_past_its_branch_arrives_in_the_end(fallen: ot.Result) -> None:
    """It tells where it has come to, plans on from there, and reaches the goal."""
    assert fallen.success, fallen.reason
    (fell,) = falls(fallen)
    assert (fell.fitting, fell.port) == ("t", "t.run_end")
    assert str(fell).endswith(" s, in t: left its route, nose towards t.run_end")
    assert fallen.legs[-1].path[-1][2] == "start"
    assert [leg.goal for leg in fallen.legs] == [0, -1, 0]
    leg, trajectory = fallen.trajectory["leg"], fallen.trajectory
    assert np.unique(leg).tolist() == [0, 1, 2]
    assert np.linalg.norm(np.diff(trajectory["position"], axis=0), axis=1).max() < 0.02
    assert trajectory["offset"][leg > 0].max() < 0.04


def test_a_fall_is_saved_read_back_and_drawn(fallen: ot.Result, tmp_path: Path) -> None:
    """Events, legs and timeline come back as they were, and the map is drawn."""
    again = ot.load_result(fallen.save(tmp_path / "run"))
    assert (again.events, again.legs) == (fallen.events, fallen.legs)
    assert again.timeline() == fallen.timeline()
    ot.plot_mission(again, path=tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 0


def test_a_fall_does_not_depend_on_the_batch_or_its_threads(fallen: ot.Result) -> None:
    """With robots beside it, on two threads, that fall elsewhere or not at all: the same bytes."""
    others = [past_the_tee("b.end"), past_the_tee(start={"distance": 0.25})]
    together = ot.run_batch(
        [*others, past_the_tee()], controller=Careless, no_load=False, threads=2
    )
    assert [len(falls(result)) for result in together] == [0, 1, 1]
    assert same_result(together[2], fallen)


@pytest.mark.parametrize("allowed", [0, 1])
def test_a_robot_that_falls_too_often_gives_up(allowed: int) -> None:
    """After ``monitor.falls`` falls the next one ends its run, and the event says why."""
    scenario = past_the_tee(monitor={"falls": allowed})
    (result,) = ot.run_batch([scenario], controller=AlwaysCareless, no_load=False)
    assert result.outcome is ot.Outcome.LEFT_PIPE
    assert len(falls(result)) == allowed + 1
    assert str(result.events[-1]).endswith("has fallen too often: gives up")


def test_a_robot_without_a_way_from_where_it_lies_gives_up() -> None:
    """One that has found the branch closed before it falls."""
    run = ot.Simulation([past_the_tee()], controller=Careless)
    pilot = run.legs.pilots[0]
    assert isinstance(pilot, Planned)
    pilot._closed.append(pilot.planner.network.port("t.branch"))
    run.advance()
    (result,) = run.results()
    assert result.outcome is ot.Outcome.LEFT_PIPE
    assert [type(event) for event in result.events] == [FellOff, GaveUp]
    assert str(result.events[-1]).endswith("no other way: gives up")


def test_a_robot_in_plain_pipes_has_nowhere_to_fall() -> None:
    """Past the branch of a tee it drives on, and its run is over where its centre leaves the open
    end, not in the middle of the bore."""
    pipes = [
        {"kind": "straight", "length": 0.4},
        {"kind": "tee"},
        {"kind": "straight", "length": 0.3},
    ]
    tables = past_the_tee().model_dump(include={"world", "control", "start", "physics"})
    scenario = validate_scenario({"pipes": pipes, **tables})
    (result,) = ot.run_batch([scenario], controller=Careless, no_load=False)
    assert result.outcome is ot.Outcome.LEFT_PIPE
    assert falls(result) == []
    wye, end = scenario.route.passages[1], result.trajectory["position"][-1]
    assert abs(float(wye.part.extent(end))) < 0.01
    assert float(wye.part.signed_distance(end)[0]) > 0.06
    assert scenario.pilot(0).on_fall(1.0, MIDDLE, UP) == Decision(None)


def test_a_robot_that_lies_across_a_tee_rights_itself() -> None:
    """It slips out of a branch on a slippery wall, gravity along the run: within 1.5 s after its
    fall it stands upright in the opening, nose towards its goal."""
    scenario = ot.override(
        past_the_tee(),
        {
            "mission.start": "c.start",
            "mission.goals": ["a.start"],
            "world.gravity": [0.0, 0.0, 9.81],
            "world.friction": 0.45,
            "robot.preload": 20.0,
            "control.cruise_speed": 0.1,
            "control.align": True,
            # With these the robot does not fall.
            "control.parameters.tracking.upward_speed": 0.0,
            "control.parameters.tracking.retry_speed": 0.0,
            "control.parameters.recovery.upright": 1e3,
            "start.distance": 0.1,
            "run.time_limit": 12.0,
        },
    )
    (result,) = ot.run_batch([scenario], no_load=False)
    (fell, *_) = falls(result)
    trajectory = result.trajectory
    tilt = np.degrees(trajectory["tilt"][trajectory["leg"] == 1])
    assert (fell.fitting, fell.port) == ("t", "t.run_start")
    assert tilt[0] > 40
    assert tilt[: round(1.5 / 0.02)].min() < 20
