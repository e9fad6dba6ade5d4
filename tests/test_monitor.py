"""The monitor judges, and ends nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from samples import sample_trajectory

import omnitrack_sim as ot
from omnitrack_sim.autonomy.pilots import Hindrance
from omnitrack_sim.base.rotations import Array, rotation_about
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.robots.omnitrack.channels import CHANNELS
from omnitrack_sim.scenario.tables import MonitorTable
from omnitrack_sim.sim.monitor import Monitor, Verdict

PERIOD, SPEED, LENGTH = 0.01, 0.1, 0.8
ROUTES = RouteMap([ot.load_scenario("straight").route])
BORE = 0.16


def monitor(n: int = 2, time_limit: float = 1e3, rights: bool = False, **limits: float) -> Monitor:
    """A monitor of n robots that begin 0.1 m into a straight pipe, and may right themselves."""
    begin, speed, last = np.full(n, 0.1), np.full(n, SPEED), np.full(n, time_limit)
    table, each = MonitorTable(**limits), np.full(n, rights)
    return Monitor(
        ROUTES, [ot.Omnitrack()] * len(begin), table, begin, speed, last, PERIOD, 1, rights=each
    )


def location(distance: list[float], aside: float = 0.0, tilt_deg: Any = 0.0) -> Location:
    """Robots along the pipe, ``aside`` m off its centreline, tilted by ``tilt_deg``."""
    route, at = np.zeros(len(distance), np.intp), np.array(distance)
    line = ROUTES.routes[0].centreline
    points, frames = line.at(at)[0], line.frame(at)
    turned = rotation_about(frames[:, :, 0], np.radians(tilt_deg)) @ frames
    return ROUTES.locate(points + aside * frames[:, :, 0], turned, route, at)


def look(
    watching: Monitor,
    distance: list[float],
    time: float = 0.0,
    aside: float = 0.0,
    tilt_deg: float = 0.0,
    **more: Any,
) -> list[Verdict]:
    """One look at robots that drive as they should, but for what ``more`` says."""
    n = len(distance)
    readings = {name: np.zeros((n, *channel.shape)) for name, channel in CHANNELS.items()}
    readings |= {"normal_force": np.full((n, 3), 25.0), "time": np.full(n, time)}
    readings |= {"belt_speed": np.full((n, 3), SPEED)}
    nobody = np.zeros(n, bool)
    resting, diverged = more.pop("resting", nobody), more.pop("diverged", nobody)
    saturated = more.pop("saturated", np.zeros((n, 3), bool))
    readings |= more
    watching.average(readings, ot.Command(np.full((n, 3), SPEED)), saturated, np.ones(n, bool))
    goal = np.full(n, LENGTH - 0.1)
    return watching.look(
        readings,
        location(distance, aside, tilt_deg),
        np.ones(n, bool),
        arrived=np.asarray(distance) >= goal,
        resting=resting,
        diverged=diverged,
        lost=nobody,
        over=nobody,
    )


def looks(watching: Monitor, seconds: float, distance: list[float], **more: Any) -> list[Verdict]:
    """What is found while robots stand for a while."""
    found = []
    for _ in range(round(seconds / PERIOD)):
        found += look(watching, distance, **more)
    return found


def test_robots_on_their_way_are_left_alone() -> None:
    """Nothing is found of robots that make headway."""
    watching = monitor()
    route = np.arange(0.1, 0.69, SPEED * PERIOD).tolist()
    assert [found for at in route for found in look(watching, [at, at])] == []


def test_a_correction_of_where_a_robot_is_takes_no_headway_from_it() -> None:
    """Of two robots whose estimates go back by 150 mm, the one whose estimate has been corrected
    has not slid back."""
    watching = monitor()
    assert look(watching, [0.4, 0.4]) == []
    watching.shift_progress(0, -0.15)
    assert [verdict.robot for verdict in look(watching, [0.25, 0.25])] == [1]


def test_a_verdict_is_of_one_robot_and_is_given_again() -> None:
    """Of a robot at its goal it is told at every look that it has arrived: the monitor keeps no
    account of whose run is over."""
    watching = monitor()
    for _ in range(3):
        assert look(watching, [0.3, 0.75]) == [Verdict(1, ot.Outcome.REACHED_GOAL)]


@pytest.mark.parametrize(
    ("more", "outcome"),
    [
        ({"diverged": np.array([True])}, ot.Outcome.DIVERGED),
        ({"aside": 0.081}, Hindrance.OFF_ROUTE),
        ({"time": 1e3}, ot.Outcome.TIMED_OUT),
    ],
)
def test_what_is_wrong_is_named(more: dict[str, Any], outcome: ot.Outcome | Hindrance) -> None:
    """Broken physics, a place outside the pipe and the end of the time each have a verdict."""
    assert look(monitor(1), [0.3], **more) == [Verdict(0, outcome)]


def test_verdicts_come_in_the_order_in_which_they_count() -> None:
    """Of a robot that arrives just when its time is over the arrival comes first, of one that also
    has left the pipe that comes in between, and broken physics before all."""
    more = {"time": 1e3, "aside": 0.081, "diverged": np.array([True])}
    found = [verdict.found for verdict in look(monitor(1), [0.75], **more)]
    outcomes = ot.Outcome.DIVERGED, ot.Outcome.REACHED_GOAL, ot.Outcome.TIMED_OUT
    assert found == [*outcomes[:2], Hindrance.OFF_ROUTE, outcomes[2]]


WAYS = ("run_start", "branch"), ("branch", "run_end"), ("run_end", "branch")


def points_of(fitting: ot.Fitting, port: str, count: int, rng: np.random.Generator) -> Array:
    """Points (n, 3) of the bore from where the axes meet to a port, drawn about its axis."""
    pose, room = fitting.ports[port], 0.999 * fitting.port_radius(port)
    along = rng.uniform(0, float(np.linalg.norm(pose.position)), count)
    around, out = rng.uniform(0, 2 * np.pi, count), room * np.sqrt(rng.uniform(0, 1, count))
    beside = np.stack([out * np.cos(around), out * np.sin(around), along], axis=-1)
    return beside @ pose.rotation.T


def beside(fitting: ot.Fitting, port: str, points: Array) -> Array:
    """Depths (n,) of points in the round bore about a port's axis, which goes on both ways."""
    off = np.cross(points, fitting.ports[port].rotation[:, 2])
    return fitting.port_radius(port) - np.linalg.norm(off, axis=-1)


@pytest.mark.parametrize("way", WAYS, ids=" to ".join)
@pytest.mark.parametrize(
    "fitting",
    [ot.Tee(), ot.Wye(), ot.Wye(angle=1.0, branch_diameter=0.14), ot.Cross(angle=1.2)],
    ids=str,
)
def test_a_robot_is_off_its_route_only_where_none_of_its_bores_is(
    fitting: ot.Fitting, way: tuple[str, str]
) -> None:
    """In a turn anywhere in the arms that are passed, and where their bores cross, it is not, be
    the arc of the centreline ever so far; beyond the mouths in another arm and in the wall it is,
    where the arc is farther than the radius."""
    rng = np.random.default_rng(1)
    routes = RouteMap([ot.route([ot.Step("t", fitting, *way)])])
    part = routes.routes[0].passages[0].part

    def locate(points: Array) -> Location:
        places, n = part.pose.apply(points), len(points)
        turned, begin = np.tile(np.eye(3), (n, 1, 1)), np.full(n, 0.2)
        return routes.locate(places, turned, np.zeros(n, np.intp), begin)

    def off(points: Array) -> Any:
        return routes.has_left(locate(points))

    arms = np.concatenate([points_of(fitting, port, 500, rng) for port in way])
    assert not off(arms).any()
    for third in set(fitting.port_names) - {*way}:
        points = points_of(fitting, third, 1000, rng)
        depths = [beside(fitting, port, points) for port in way]
        crossing = np.minimum(*depths) > 0
        assert crossing.sum() > 100
        assert not off(points[crossing]).any()
        beyond = np.min(depths, axis=0) < -0.001
        assert off(points[beyond & (locate(points).offset > fitting.radius)]).all()
        assert beyond.sum() > 100
    low, high = fitting.bounds
    walls = rng.uniform(low, high, (2000, 3))
    walls = walls[fitting.signed_distance(walls)[0] < -0.001]
    assert off(walls[locate(walls).offset > fitting.radius]).all()


@pytest.mark.parametrize(
    ("limits", "seconds"),
    [({}, 3.0), ({"patience_time": 1.0}, 3.0), ({"patience_time": 1.0, "patience": 0.16}, 1.6)],
)
def test_a_robot_that_stands_hangs_after_both_patiences(
    limits: dict[str, float], seconds: float
) -> None:
    """Without headway for the longer of the two it makes no headway, and not before: 3 s, and 0.3
    m at 0.1 m/s, which is 3 s as well."""
    watching = monitor(1, **limits)
    assert look(watching, [0.11]) == []  # headway for the last time
    waited = next(i for i in range(1, 1000) if look(watching, [0.11]))
    assert waited * PERIOD == pytest.approx(seconds, abs=1.5 * PERIOD)


def test_a_small_advance_is_no_headway_and_a_larger_one_is() -> None:
    """Up to ``progress``, 2 mm, beyond the farthest point the waiting goes on; beyond, it begins
    anew."""
    for step, hangs in ((0.0019, True), (0.0021, False)):
        watching = monitor(1)
        assert looks(watching, 2.0, [0.15]) == []
        found = looks(watching, 2.0, [0.15 + step])
        assert (Verdict(0, Hindrance.NO_HEADWAY) in found) is hangs


def test_a_robot_that_rests_does_not_hang() -> None:
    """While it stands on purpose no time is counted, and headway is counted from there."""
    watching = monitor(1)
    assert looks(watching, 5.0, [0.3], resting=np.array([True])) == []
    assert looks(watching, 2.9, [0.3]) == []
    assert look(watching, [0.1], resting=np.array([True])) == []
    assert look(watching, [0.1]) == []


def test_a_robot_that_slides_back_hangs_at_once() -> None:
    """Behind the farthest point by more than ``slide_back``, 0.1 m."""
    watching = monitor(1)
    assert look(watching, [0.4]) == []
    assert look(watching, [0.301]) == []
    assert look(watching, [0.299]) == [Verdict(0, Hindrance.NO_HEADWAY)]
    assert "0.800 m, goal at 0.700 m, slid back by 105 mm, after" in watching.reason(
        0, location([0.295]), 0.7, {"time": np.ones(1)}
    )


def test_a_robot_on_another_leg_is_judged_afresh() -> None:
    """On another leg it may be anywhere, waits from zero on, and has more time."""
    watching = monitor(1, time_limit=1.0)
    assert looks(watching, 2.9, [0.4]) == []
    watching.start_leg(0, 5.0)
    assert looks(watching, 2.9, [0.2], time=5.9) == []
    assert look(watching, [0.3], time=6.0) == [Verdict(0, ot.Outcome.TIMED_OUT)]


CAUSES = [
    (ot.Outcome.NO_MOTION_LINE, {"roll": np.full((1, 3), np.radians(80.0))}),
    (ot.Outcome.STALLED, {"saturated": np.ones((1, 3), bool), "belt_speed": np.zeros((1, 3))}),
    (ot.Outcome.SLIPPING, {"slip_ratio": np.array([[0.9, -0.9, 0.0]])}),
    (ot.Outcome.STUCK, {"slip_ratio": np.array([[0.9, 0.0, 0.0]])}),
]


@pytest.mark.parametrize(("outcome", "more"), CAUSES, ids=[outcome.value for outcome, _ in CAUSES])
def test_the_cause_is_read_from_what_was_measured(
    outcome: ot.Outcome, more: dict[str, Any]
) -> None:
    """Modules on the no-motion line, a motor that stalls, two modules that slip, or none of
    these."""
    watching = monitor(1)
    looks(watching, 1.0, [0.3], **more)
    assert watching.cause(0, location([0.3]), {}) is outcome


@pytest.mark.parametrize(
    ("share", "ahead", "outcome"),
    [
        (0.9, 0.0, ot.Outcome.MOTION_SINGULARITY),
        (1.1, 0.0, ot.Outcome.STUCK),  # it still pushes on the wall
        (0.9, 0.2, ot.Outcome.STUCK),  # its nose has not come to the branch yet
    ],
)
def test_a_module_that_has_lost_the_wall_in_a_tee_turn_is_the_cause(
    share: float, ahead: float, outcome: ot.Outcome
) -> None:
    """One of three whose mean normal force is below ``lost_contact`` weights of the robot, from
    where the turn begins."""
    robot, limits = ot.Omnitrack(), MonitorTable()
    routes = RouteMap([ot.load_scenario("tee_turn").route])
    one = np.ones(1)
    watching = Monitor(
        routes, [robot] * len(one), limits, 0.1 * one, SPEED * one, 1e3 * one, PERIOD, 1
    )
    weight = robot.mass * 9.81
    force = np.array([[25.0, share * limits.lost_contact * weight, 25.0]])
    for _ in range(100):
        readings = {name: np.zeros((1, *channel.shape)) for name, channel in CHANNELS.items()}
        readings |= {"normal_force": force, "belt_speed": np.full((1, 3), SPEED)}
        command = ot.Command(np.full((1, 3), SPEED))
        watching.average(readings, command, np.zeros((1, 3), bool), np.ones(1, bool))
    at = routes.start[:1] - ahead
    route, line = np.zeros(1, np.intp), routes.routes[0].centreline
    where = routes.locate(line.at(at)[0], line.frame(at), route, at)
    assert watching.cause(0, where, {}) is outcome


def test_the_limits_of_the_cause_are_the_scenarios() -> None:
    """With ``slipping_ratio`` above what is measured the same robot counts as stuck."""
    watching = monitor(1, slipping_ratio=0.95)
    looks(watching, 1.0, [0.3], slip_ratio=np.array([[0.9, -0.9, 0.0]]))
    assert watching.cause(0, location([0.3]), {}) is ot.Outcome.STUCK


def test_a_robot_across_its_pipe_is_wedged() -> None:
    """Whatever else holds it; one that lies along the pipe, either way round, is not."""
    watching, here = monitor(n=3), location([0.3] * 3, tilt_deg=np.array([20, 80, 160]))
    looks(watching, 0.2, [0.3] * 3, saturated=np.ones((3, 3), bool), belt_speed=np.zeros((3, 3)))
    causes = [watching.cause(robot, here, {}) for robot in range(3)]
    assert causes == [ot.Outcome.STALLED, ot.Outcome.WEDGED, ot.Outcome.STALLED]


def test_forces_and_places_that_should_not_be_are_noted() -> None:
    """A force of over 20 preloads, and an arm beyond its stop by over 1 mm, once each."""
    run, robot = sample_trajectory(), ot.Omnitrack()
    assert robot.strains(run) == []
    force, slide = run["normal_force"].copy(), run["slide"].copy()
    force[50, 1], slide[70, 2] = 21 * robot.preload, robot.slide_range[1] + 0.0012
    loaded, beyond = robot.strains(sample_trajectory(normal_force=force, slide=slide))
    assert (loaded.time, loaded.part) == (run.time[50], "module 2")
    assert (beyond.time, beyond.module) == (run.time[70], 3)
    assert "21 times the preload" in loaded.text
    assert "1.2 mm beyond its stop" in beyond.text


def test_no_run_ends_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simulation whose monitor finds nothing goes on past its time limit; with the verdict it is
    over at the next step."""
    limit = {"run.time_limit": 0.1}
    simulation = ot.Simulation([ot.override(ot.load_scenario("straight"), limit)])
    usual, given = simulation.monitor.look, []

    def blind(*seen: Any, **flags: Any) -> list[Verdict]:
        given.extend(usual(*seen, **flags))
        return []

    monkeypatch.setattr(simulation.monitor, "look", blind)
    for _ in range(20):
        simulation.step()
    assert simulation.active.tolist() == [True]
    assert simulation.time[0] == pytest.approx(0.2)
    assert set(given) == {Verdict(0, ot.Outcome.TIMED_OUT)}
    monkeypatch.undo()
    simulation.step()
    assert simulation.active.tolist() == [False]
    (ending,) = simulation.endings
    assert ending is not None
    assert ending.outcome is ot.Outcome.TIMED_OUT


def test_the_end_is_told_beside_the_goal_and_the_length_of_the_route():
    """The goal is the nose at the end, so the centre has not come to the end of the route; means
    are of no longer than the run took."""
    watching = monitor(1)
    look(watching, [0.3])
    short = watching.reason(0, location([0.3]), 0.7, {"time": np.array([0.25])})
    assert short.startswith("at 0.300 m of a route of 0.800 m, goal at 0.700 m, after 0.25 s; tilt")
    assert short.endswith("(means of the last 0.25 s)")
    there = watching.reason(0, location([0.7]), 0.7, {"time": np.array([6.0])})
    assert there.startswith("at 0.700 m, the goal, of a route of 0.800 m, after 6.00 s; tilt")
    assert there.endswith("(means of the last 0.5 s)")


@pytest.mark.parametrize("rights", [True, False])
@pytest.mark.parametrize(
    ("tilt_deg", "seconds", "leans"), [(70.0, 0.8, True), (70.0, 0.3, False), (35.0, 2.0, False)]
)
def test_a_robot_that_leans_over_for_a_while_is_told_to_right_itself(
    tilt_deg: float, seconds: float, leans: bool, rights: bool
) -> None:
    """Not one that swings through, nor one that leans as far as turns make robots lean, nor one
    that does not right itself, nor one that has not been upright on its way."""
    told = Verdict(0, Hindrance.LEANING)
    upright, fallen = (monitor(1, rights=rights) for _ in range(2))
    look(upright, [0.3])
    assert (told in looks(upright, seconds, [0.31], tilt_deg=tilt_deg)) is (leans and rights)
    assert told not in looks(fallen, seconds, [0.31], tilt_deg=tilt_deg)


@pytest.mark.parametrize("steps", [1, 30, 205, 211])
def test_a_time_limit_lasts_no_step_longer_than_it_says(steps: int) -> None:
    """Though times are sums of time steps, which come out a little short at times."""
    limit, times = steps * PERIOD, np.cumsum(np.full(5 * steps, PERIOD / 5))[4::5].tolist()
    found = [look(monitor(1, time_limit=limit), [0.3], time) for time in times[-2:]]
    assert found[-1] == [Verdict(0, ot.Outcome.TIMED_OUT)]
    assert steps == 1 or found[0] == []


PRESSED = ot.override(ot.load_scenario("robots/presser_elbow"), {"run.time_limit": 5})
LEVEL = {"start.axis": [1, 0, 0], "start.turn_deg": 0}
WIDE = {f"pipes.{i}.inner_diameter": 0.25 for i in range(len(PRESSED.pipes))}


def test_a_robot_that_slides_back_without_grip_is_slipping() -> None:
    """Upright without friction it slides; the reason says so, and how fast."""
    result = ot.run(ot.override(PRESSED, {"world.friction": 0.02}))
    assert result.outcome is ot.Outcome.SLIPPING
    assert "slid back by" in result.reason
    assert "sliding over the wall at" in result.reason


def test_a_robot_that_touches_no_wall_falls_and_is_told_so_before() -> None:
    """In a bore that is too wide; the note has the bore that it is made for."""
    result = ot.run(ot.override(PRESSED, WIDE))
    assert result.outcome is ot.Outcome.SLIPPING
    assert "fell back by" in result.reason
    assert "touching no wall" in result.reason
    (note,) = [str(event) for event in result.events]
    assert "touches the wall" in note
    assert "250 mm" in note
    assert "160 mm" in note


def test_a_robot_that_drives_back_is_not_slipping() -> None:
    """Its wheels roll the wrong way round, and grip."""
    inputs = {"control.kind": "periodic", "control.parameters.inputs": {"*": -4.0}}
    result = ot.run(ot.override(PRESSED, inputs | LEVEL))
    assert result.outcome is ot.Outcome.STUCK
    assert "moved back by" in result.reason
    assert "sliding" not in result.reason


def test_a_robot_that_slides_down_to_its_goal_says_so() -> None:
    """A level pipe bends down, and nothing holds the robot there; one that drives says nothing."""
    goal = {"run.goal_distance": 0.9}
    sliding = ot.run(ot.override(PRESSED, LEVEL | goal | {"world.friction": 0.02}))
    assert sliding.outcome is ot.Outcome.REACHED_GOAL
    assert "sliding over the wall at" in sliding.reason
    driving = ot.run(ot.override(PRESSED, {"run.goal_distance": 0.3}))
    assert driving.outcome is ot.Outcome.REACHED_GOAL
    assert "sliding" not in driving.reason
