"""Players of windows, without a window: what they show is what is computed, in step with the
clock."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from runs import rolling_tee, same_result

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack.track_display import region_of
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.viewer import keys
from omnitrack_sim.show.viewer.driver import Driver
from omnitrack_sim.show.viewer.keys import DRIVE, Do, action_of, help_lines
from omnitrack_sim.show.viewer.pace import FRAME, LADDER, LATE_FRAME, MAX_OVERDUE, Pace
from omnitrack_sim.show.viewer.player import LiveRun, Player, Replayer, SavedRun
from omnitrack_sim.show.viewer.window import covers_robot, window_spec


class Clock:
    """Wall time that passes only when it is told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Steps:
    """A stage of steps of 10 ms, each of which takes ``cost`` s of the clock."""

    def __init__(self, clock: Clock, cost: float = 0.0, end: float = math.inf) -> None:
        self.clock, self.cost, self.end, self.count = clock, cost, end, 0

    @property
    def time(self) -> float:
        return self.count * 0.01

    @property
    def next_time(self) -> float | None:
        return self.time + 0.01 if self.time < self.end else None

    def step(self) -> None:
        self.count += 1
        self.clock.now += self.cost


def played(pace: Pace, stage: Steps, clock: Clock, seconds: float, drawing: float = 0.0) -> int:
    """Play for some seconds; the number of pictures, each of which takes ``drawing`` s."""
    pictures, end = 0, clock.now + seconds
    while clock.now < end:
        pace.advance(stage)
        if pace.begin_frame():
            pictures += 1
            clock.now += drawing
        rest = pace.rest(stage)
        assert rest <= FRAME + 1e-9
        clock.now += max(rest, 1e-4)
    return pictures


@pytest.mark.parametrize("speed", [0.25, 1.0, 4.0])
def test_simulated_time_keeps_step_with_the_clock(speed):
    """At a quarter of the speed, at it and at four times it, with thirty pictures a second; a
    machine with time to spare rests."""
    clock = Clock()
    pace, stage = Pace(speed, clock), Steps(clock, cost=1e-4)
    pictures = played(pace, stage, clock, 10.0)
    assert stage.time == pytest.approx(10 * speed, abs=0.05 * speed + 0.01)
    assert 10 / FRAME * 0.9 < pictures <= 10 / FRAME + 1
    assert pace.reached == pytest.approx(speed, rel=0.05)


def test_slow_drawing_costs_pictures_and_no_steps():
    """Where a picture takes 0.1 s, there are fewer of them, and time keeps step all the same."""
    clock = Clock()
    pace, stage = Pace(1.0, clock), Steps(clock, cost=0.005)
    pictures = played(pace, stage, clock, 10.0, drawing=0.1)
    assert stage.time == pytest.approx(10.0, abs=0.3)
    assert pictures < 60


def test_slow_physics_falls_behind_and_does_not_hurry():
    """Steps of twice their simulated time: half the speed, told as reached, few pictures; as soon
    as they are fast again, no more than half a second is made up for."""
    clock = Clock()
    pace, stage = Pace(1.0, clock), Steps(clock, cost=0.02)
    pictures = played(pace, stage, clock, 10.0)
    assert stage.time == pytest.approx(5.0, abs=0.3)
    assert pace.reached == pytest.approx(0.5, abs=0.05)
    assert pictures < 1.2 * 10 / LATE_FRAME
    before, stage.cost = stage.time, 0.0
    played(pace, stage, clock, 1.0)
    assert stage.time - before < 1.0 + MAX_OVERDUE + 0.2


def test_pause_and_other_speeds_leap_over_nothing():
    """Time goes on from where it was paused; as fast as possible is as fast as steps are."""
    clock = Clock()
    pace, stage = Pace(1.0, clock), Steps(clock, cost=1e-4, end=30.0)
    played(pace, stage, clock, 1.0)
    pace.paused, before = True, stage.time
    played(pace, stage, clock, 5.0)
    assert stage.time == before
    pace.paused = False
    played(pace, stage, clock, 1.0)
    assert stage.time == pytest.approx(before + 1.0, abs=0.05)
    for _ in range(20):
        pace.faster(1)
    assert pace.speed == math.inf
    played(pace, stage, clock, 1.0)
    assert stage.time == pytest.approx(30.0, abs=0.02)
    assert stage.next_time is None
    for _ in range(20):
        pace.faster(-1)
    assert pace.speed == 1 / 16


def test_a_window_rests_until_its_next_picture_or_step():
    """Paused until the next picture, otherwise until the next step where that comes sooner."""
    clock = Clock()
    pace, stage = Pace(1.0, clock), Steps(clock)
    pace.paused = True
    pace.advance(stage)
    assert pace.begin_frame()
    assert not pace.begin_frame()
    assert pace.rest(stage) == pytest.approx(FRAME)
    clock.now += 0.6 * FRAME
    assert pace.rest(stage) == pytest.approx(0.4 * FRAME)
    pace.paused = False
    pace.advance(stage)
    clock.now += 0.004
    assert pace.rest(stage) == pytest.approx(0.006)


def test_viewed_run_is_the_run():
    """A stage that is stepped, posed and read at every step leaves the same bytes as ``run``, and
    what it shows are the joints of the simulation, less the travel of the belts."""
    scenario = rolling_tee()
    model = window_spec(scenario).compile()
    stage = LiveRun(ot.Simulation([scenario]), model)
    belts = [model.joint(f"belt_{t}_{i}").qposadr[0] for t in ("upper", "lower") for i in (1, 2, 3)]
    while stage.next_time is not None:
        stage.step()
        shown, joints = stage.qpos(), stage.simulation.plant.qpos[0]
        assert np.array_equal(np.delete(shown, belts), np.delete(joints, belts))
        assert dict(stage.status())["time"] == f"{stage.time:.2f} s"
        stage.measurements()
    assert dict(stage.status())["outcome"] == "timed_out"
    assert same_result(stage.simulation.results()[0], ot.run(scenario))


def test_replayed_run_is_the_record():
    """Every sample can be gone to, on and back, and past neither end; place and phase are those of
    the record."""
    result = ot.run(rolling_tee())
    stage = SavedRun(RunPlayback(result), result)
    stage.leap(10**6)
    assert stage.next_time is None
    assert stage.time == result.duration_s
    stage.leap(-(10**6))
    assert stage.row == 0
    stage.leap_to(1.0)
    assert stage.time == pytest.approx(1.0)
    stage.step()
    trajectory = result.trajectory
    told = dict(stage.status())
    assert told["phase"] == trajectory.phases[int(trajectory["phase"][stage.row])]
    assert told["travelled"].startswith(f"{trajectory['distance'][stage.row]:.3f} ")
    theta5 = np.degrees(trajectory["theta5"][stage.row])
    assert dict(stage.measurements())["theta5"] == f"{theta5:.1f} deg"


@pytest.mark.parametrize("robot", ["snake", "presser"])
def test_any_robot_is_viewed(robot):
    """What the window shows of a robot of another kind are its joints in its pipe, with what it
    measures; one step goes on as in a run."""
    changes = {"robot": robot, "start.distance": 0.3, "run.time_limit": 0.1}
    scenario = ot.load_scenario("straight", changes)
    model = window_spec(scenario).compile()
    stage = LiveRun(ot.Simulation([scenario]), model)
    stage.step()
    assert np.array_equal(stage.qpos(), stage.simulation.plant.qpos[0])
    assert model.nq == len(stage.qpos())
    assert dict(stage.measurements()).keys() >= {"wall force, N", "power, W"}
    assert dict(stage.status())["in"] == scenario.route.network.parts[0].name


@pytest.mark.parametrize(
    ("theta5", "inside", "border"),
    [(0.0, False, 11.73), (10.0, False, 1.73), (-15.0, True, 3.27), (60.0, True, 48.27)],
)
def test_region_tells_the_way_to_its_border(theta5, inside, border):
    """The best orientation is 11.73 degrees from the region on either side, the worst one deepest
    in it (singularity.md)."""
    changes = {"start.theta5_deg": theta5}
    simulation = ot.Simulation([ot.override(ot.load_scenario("tee_turn"), changes)])
    reach = simulation.scenarios[0].robot.reach
    region = region_of(simulation.legs.routes, simulation.location, reach)
    assert region == (inside, pytest.approx(np.radians(border), abs=2e-4))


def test_no_region_without_a_tee_turn():
    """Before an elbow there is none."""
    simulation = ot.Simulation([ot.load_scenario("elbow")])
    reach = simulation.scenarios[0].robot.reach
    assert region_of(simulation.legs.routes, simulation.location, reach) is None


@pytest.mark.parametrize(
    ("size", "covers"), [((320, 240), True), ((853, 533), True), ((1000, 600), False)]
)
def test_the_keys_are_shown_where_they_do_not_lie_over_the_robot(size, covers):
    """Of a robot that is driven; one line fits everywhere."""
    keys = help_lines(DRIVE)
    assert covers_robot(keys, *size) is covers
    assert not covers_robot(keys[-1:], *size)


class Sitter:
    """A window that nobody sees, at which keys are pressed by a script.

    Args:
        scenario: whose model it has.
        presses: codes of keys, one list for each look at the keyboard; then it is closed.
    """

    towards = np.array([0.0, -1.0, 0.0])
    size = (1200, 900)

    def __init__(self, scenario: ot.Scenario, presses: Iterable[list[int]] = ()) -> None:
        self.model = window_spec(scenario).compile()
        self._presses, self.is_open, self.clock = iter(presses), True, Clock()
        self.shown: list[tuple[np.ndarray, dict[str, str]]] = []
        self.corners: list[mujoco.mjtGridPos] = []

    def pressed(self, seconds: float) -> list[int]:
        self.clock.now += FRAME
        found = next(self._presses, None)
        if found is None:
            self.close()
        return found or []

    def close(self) -> None:
        self.is_open = False

    def show(self, qpos, panels) -> None:
        self.corners = [corner for corner, _ in panels]
        self.shown.append((np.array(qpos), dict(line for _, lines in panels for line in lines)))


def panels(player: Player) -> dict[str, str]:
    """All lines of the panels of a window."""
    return dict(line for _, lines in player.panels() for line in lines)


def test_a_window_shows_the_run_from_its_start_to_its_end():
    """A key that means nothing changes nothing; every corner has its panel; when the run is over
    the speed says so, and its last picture is that of its end."""
    scenario = rolling_tee()

    def sits():
        while player.run.next_time is not None:
            yield [ord("J")]
        yield from [[]] * 3

    window = Sitter(scenario, sits())
    player = Player(scenario, window, math.inf)
    player.pace = Pace(math.inf, window.clock)
    start = player.run.qpos()
    player.play()
    assert not window.is_open
    assert np.array_equal(window.shown[-1][0], player.run.qpos())
    assert np.array_equal(window.shown[0][0], start)
    assert not np.array_equal(window.shown[-1][0], start)
    told = window.shown[-1][1]
    assert told["outcome"] == "timed_out"
    assert told["speed"] == "over"
    assert told["time"] == f"{player.run.time:.2f} s"
    assert len({*window.corners}) == 3


def test_keys_pause_step_and_begin_again():
    """A step stands still behind it; from the start again nothing is made up for."""
    scenario = rolling_tee()
    player = Player(scenario, Sitter(scenario))
    player.pace = Pace(1.0, clock := Clock())
    period = player.run.simulation.period
    player.act(Do.STEP)
    assert player.pace.paused
    assert player.run.time == pytest.approx(period)
    assert panels(player)["speed"] == "paused"
    player.act(Do.PAUSE)
    assert not player.pace.paused
    player.pace.advance(player.run)
    clock.now += 0.5
    player.pace.advance(player.run)
    assert player.run.time == pytest.approx(0.5 + period, abs=period)
    player.act(Do.RESET)
    assert player.run.time == 0.0
    player.pace.advance(player.run)
    assert player.run.time == 0.0
    player.act(Do.LEAP)  # of no meaning here
    while player.run.next_time is not None:
        player.run.step()
    end = player.run.time
    player.act(Do.STEP)
    assert player.run.time == end


def test_the_speed_of_time_is_told_in_words():
    """With what is reached where that is less, and of the fastest always."""
    scenario = rolling_tee()
    player = Player(scenario, Sitter(scenario))
    assert panels(player)["speed"] == "1 x"
    player.act(Do.TIME_FASTER)
    assert panels(player)["speed"] == "2 x"
    player.act(Do.TIME_SLOWER)
    player.act(Do.TIME_SLOWER)
    player.pace.reached = 0.46
    assert panels(player)["speed"] == "0.5 x"
    player.pace.reached = 0.4
    assert panels(player)["speed"] == "0.5 x (reached: 0.4 x)"
    for _ in LADDER:
        player.act(Do.TIME_FASTER)
    assert panels(player)["speed"] == "as fast as possible (0.4 x)"


def test_help_is_shown_where_there_is_room_or_as_asked_for():
    """Otherwise the line alone that says how to get it."""
    scenario = rolling_tee()
    player = Player(scenario, window := Sitter(scenario))
    lines = help_lines(player.keys)
    assert {*lines} <= {*panels(player).items()}
    window.size = (320, 240)
    assert {*lines} & {*panels(player).items()} == {lines[-1]}
    player.act(Do.HELP)
    assert {*lines} <= {*panels(player).items()}
    player.act(Do.HELP)
    window.size = (1200, 900)
    assert {*lines} & {*panels(player).items()} == {lines[-1]}


def test_a_saved_run_is_leapt_through_by_keys():
    """From its first sample on: a sample or a second either way, and to both ends; a leap is not
    made up for."""
    result = ot.run(rolling_tee())
    player = Replayer(result, Sitter(result.scenario))
    player.pace = Pace(1.0, clock := Clock())
    run, times = player.run, result.trajectory.time
    assert (run.row, run.driver) == (0, None)
    assert panels(player)["time"] == f"0.00 of {times[-1]:.2f} s"
    assert panels(player)["outcome"] == result.outcome.value

    def after(*actions: Do) -> int:
        for do in actions:
            player.act(do)
        return run.row

    assert after(Do.STEP_BACK) == 0
    assert after(Do.STEP, Do.STEP) == 2
    assert after(Do.STEP_BACK) == 1
    second = run.time + 1
    assert times[after(Do.LEAP)] >= second - 1e-9 > times[run.row - 1]
    assert after(Do.LEAP_BACK) == 1
    assert after(Do.LEAP_BACK) == 0
    assert after(Do.TO_END) == len(times) - 1
    assert after(Do.LEAP) == len(times) - 1
    assert panels(player)["speed"] == "over"
    assert after(Do.TO_START) == 0
    player.act(Do.PAUSE)
    player.pace.advance(run)
    clock.now += 0.3
    player.pace.advance(run)
    assert run.time == pytest.approx(0.3, abs=0.03)
    before = after(Do.TO_START)
    player.pace.advance(run)
    assert run.row == before == 0
    driven = replace(result, provenance={**result.provenance, "driven_by": "keyboard"})
    assert dict(SavedRun(RunPlayback(driven), driven).status())["driven by"] == "keyboard"


def test_a_driven_run_waits_for_its_first_order_and_repeats_itself():
    """Time stands still before it; the panel tells the orders; the controller takes over and gives
    back; the end of the run closes the window, and the scenario with its orders repeats it."""
    scenario = ot.load_scenario("straight", {"run.time_limit": 2.0})
    window = Sitter(scenario)
    player = Driver(scenario, window)
    assert player.waits
    assert not player.driven
    assert panels(player)["time stands still"].startswith("until your first order")
    assert panels(player)["speed"] == "paused"
    player.act(Do.FORWARD)
    assert player.driven
    assert not player.waits
    assert not player.pace.paused
    told = panels(player)
    assert (told["driven by"], told["steering"], told["roll asked"]) == ("you", "off", "0 deg")
    assert told["speed asked"] == "+25 mm/s"  # a quarter of 0.1 m/s
    player.act(Do.RIGHT)
    assert panels(player)["steering"] == "nose 15 deg off its heading"
    player.act(Do.STRAIGHT)
    for _ in range(20):
        player.run.step()
    player.act(Do.PAUSE)
    assert player.pace.paused
    assert not player.waits
    assert panels(player)["driven by"] == "you"
    assert player.simulation.location.distance[0] > 0.002 + scenario.start.distance
    player.act(Do.HAND_OVER)
    player.run.step()
    assert panels(player)["driven by"] == "the controller; Space takes over"
    player.act(Do.STOP)
    assert panels(player)["speed asked"] == "+0 mm/s"
    player.act(Do.FINISH)
    assert not window.is_open
    player.run.step()
    assert panels(player)["the run is over"] == "Delete saves it and closes"
    result = player.result()
    assert result.provenance["driven_by"] == "keyboard"
    assert same_result(result, ot.run(result.scenario))
    assert result.duration_s == pytest.approx(player.run.time)


def test_a_window_that_is_closed_ends_the_run_where_it_is():
    """The result is that of the orders so far, and no order is given twice."""
    scenario = ot.load_scenario("straight", {"run.time_limit": 2.0})
    player = Driver(scenario, Sitter(scenario))
    player.act(Do.FINISH)  # before any order: nothing was driven
    assert not player.driven
    player.act(Do.FORWARD)
    for _ in range(10):
        player.run.step()
    now = player.run.time
    result = player.result()
    assert [order["by"] for order in result.scenario.control.parameters["orders"]] == [
        "hand",
        "end",
    ]
    assert now <= result.duration_s <= now + 2 * player.simulation.period
    assert player.result().scenario == result.scenario


def test_each_key_of_each_window_asks_for_one_thing():
    """No code stands for two; what has no key is told by none."""
    for table in (keys.VIEW, keys.REPLAY, keys.DRIVE):
        codes = [code for key in table for code in key.actions]
        assert len(codes) == len({*codes})
        for key in table:
            assert all(action_of(table, code) is do for code, do in key.actions.items())
        assert action_of(table, ord("J")) is None
