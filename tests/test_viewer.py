"""The windows: what they show is what is computed, in step with the clock, and keys reach them."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import omnitrack
from runs import rolling_tee, same_result
from screens import at_window, needs_screen, screen

import omnitrack_sim as ot
from omnitrack_sim.robots.omnitrack.track_display import region_of
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.viewer.keys import DRIVE, help_lines
from omnitrack_sim.show.viewer.pace import FRAME, LATE_FRAME, MAX_OVERDUE, Pace
from omnitrack_sim.show.viewer.player import LiveRun, SavedRun
from omnitrack_sim.show.viewer.window import covers_robot, window_spec

pytestmark = pytest.mark.long

SAVED = ("result.json", "scenario.json", "timeline.csv", "trajectory.parquet", "replay.npz")


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


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("view", "straight"), "needs a screen"),
        (("drive", "straight"), "needs a screen"),
        (("drive", "strait"), "did you mean 'straight'"),
        (("view", "{folder}"), "is no run: result.json is missing"),
        (("view", "{folder}", "--set", "name=other"), "is a saved run"),
        (("drive", "{folder}"), "is a folder"),
        (("drive", "straight", "--out", "{folder}"), "no run"),
        (("view", "straight", "--speed", "fast"), "--speed: is 'fast'"),
        (("drive", "straight", "--speed", "0"), "--speed: is '0'"),
    ],
)
def test_bad_input_is_told_before_a_window_opens(tmp_path, monkeypatch, arguments, told):
    """Each with status 2, and what is in the folder stays."""
    (tmp_path / "notes.txt").write_text("mine")
    given = [argument.format(folder=tmp_path) for argument in arguments]
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.setenv(name, "")
    done = omnitrack(*given)
    assert done.returncode == 2, done.stderr
    assert told in done.stderr
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_screen_that_is_none_and_missing_library_are_told(monkeypatch):
    """A display without a server is an error with its name; without glfw, what to install."""
    pytest.importorskip("glfw")
    done = subprocess.run(
        [sys.executable, "-m", "omnitrack_sim.cli", "view", "straight"],
        capture_output=True,
        text=True,
        env={**os.environ, "WAYLAND_DISPLAY": "", "DISPLAY": ":987"},
    )
    assert done.returncode == 2, done.stderr
    assert "':987'" in done.stderr
    from omnitrack_sim.base.errors import RenderError
    from omnitrack_sim.show.viewer.window import require_screen

    monkeypatch.setenv("DISPLAY", ":987")
    monkeypatch.setitem(sys.modules, "glfw", None)
    with pytest.raises(RenderError, match=r"pip install 'omnitrack_sim\[view\]'"):
        require_screen()


DRIVE_SCRIPT = """
simulation = it.simulation
def order(): return (it._controller.orders() or (None,))[-1]
panels = lambda: [line for _, lines in it.panels() for line in lines]
time.sleep(0.5)
wait(lambda: it.run.time == 0 and ("speed", "paused") in panels(), "the clock to stand still")
wait(lambda: any("until your first order" in told for _, told in panels()), "what is waited for")
press("Next", "Next", "Next", "Next")
wait(lambda: it.run.time > 0 and not it.pace.paused, "the clock to go")
wait(lambda: order() is not None and order().roll_deg == -60, "the roll")
theta5 = lambda: abs(simulation.location.theta5[0])
wait(lambda: theta5() < 0.07, "the orientation")
press("Up", "Up", "Up", "Up", "Up", "Down")
wait(lambda: order().speed == 0.1, "the speed")
press(*["Right"] * 6)
wait(lambda: order().heading is not None and order().heading[2] < 0.2, "the heading")
wait(lambda: not simulation.active[0], "the end of the run")
press("Delete")
"""


@pytest.fixture(scope="module")
def driven(tmp_path_factory) -> Path:
    """The folder of a run in which somebody has rolled, driven and turned at a tee, by keys."""
    folder = tmp_path_factory.mktemp("driven")
    settings = {
        "start.theta5_deg": -20.0,
        "start.distance": 0.24,
        "run.goal_distance": 0.62,  # just behind the tee
    }
    changes = [part for key, value in settings.items() for part in ("--set", f"{key}={value}")]
    with screen() as display:
        done = at_window(
            display, "Driver", DRIVE_SCRIPT,
            "drive", "tee_turn", *changes, "--speed", "4", "--out", "run", folder=folder,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "reached_goal" in done.stdout
    return folder / "run"


@needs_screen
def test_tee_is_driven_by_keys(driven, tmp_path):
    """The robot gets through the tee by keys alone; the folder is that of a run, says who drove,
    and repeats itself byte for byte."""
    result = ot.load_result(driven)
    assert result.outcome is ot.Outcome.REACHED_GOAL
    assert result.provenance["driven_by"] == "keyboard"
    assert result.provenance["orders"] >= 16
    assert {name for name, _, _ in result.trajectory.phase_spans()} == {"by_hand"}
    assert np.degrees(result.trajectory["roll"][-1]) == pytest.approx([-60.0] * 3, abs=3)
    again = ot.run(ot.load_scenario(driven / "scenario.json"))
    assert [str(event) for event in again.events] == ["0.00 s, driven by keyboard from here on"]
    again.save(tmp_path)
    for name in SAVED:
        assert (driven / name).read_bytes() == (tmp_path / name).read_bytes(), name


@needs_screen
def test_driven_run_is_drawn_like_any_other(driven):
    """It has its plot, and a frame of its film shows the robot."""
    assert (driven / "summary.png").stat().st_size > 10_000
    frame = ot.render_frame(driven, time=3.0, camera="follow", width=320, height=180)
    assert frame.std() > 10


REPLAY_SCRIPT = """
run, handle = it.run, it.window._handle
def looks():
    option, eye = handle.opt, handle.cam
    flags = bytes(option.flags), bytes(handle.user_scn.flags), bytes(option.geomgroup)
    return (*flags, option.label, option.frame, eye.type, eye.distance, eye.azimuth, eye.elevation)
before = looks()
wait(lambda: not it.shows_keys and len(it.panels()[2][1]) == 1, "a small window without the keys")
press("space")
wait(lambda: it.pace.paused, "the pause")
press("End")
wait(lambda: run.next_time is None, "the end")
press("Left", "Left", "Left", "Right")
wait(lambda: run.row == run.count - 3, "two samples before the end")
press("Next")
wait(lambda: abs(run.time - (run._playback.time[-3] - 1)) < 0.03, "a second before")
press("Home")
wait(lambda: run.row == 0, "the start")
press("equal", "minus", "minus", "period", "Prior", "Insert", "Delete", "BackSpace", "Return")
wait(lambda: it.pace.speed == 0.5 and it.shows_keys, "the keys of time and help")
press("Up", "Down")
assert looks() == before, "a key of ours has changed MuJoCo's picture"
press("ctrl+q")
"""


@needs_screen
def test_saved_run_is_replayed_by_keys(driven):
    """Pause, steps, leaps, both ends and the speed of time; none of the keys that any window has
    changes what MuJoCo draws; a window that is closed ends the command."""
    with screen() as display:
        done = at_window(display, "Replayer", REPLAY_SCRIPT, "view", str(driven), folder=driven)
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr


VIEW_SCRIPT = """
wait(lambda: it.run.time > 0.1, "the run")
press("Right")
wait(lambda: it.pace.paused, "the pause")
before = it.run.time
press("Right")
wait(lambda: 0.005 < it.run.time - before < 0.015, "one step")
press("Home", "space")
wait(lambda: it.run.time < before, "the start")
wait(lambda: it.run.next_time is None, "the end")
print(dict(it.run.status())["outcome"])
press("ctrl+q")
"""


UNDRIVEN_SCRIPT = """
wait(lambda: it.waits, "the clock to stand still")
press("Insert")
wait(lambda: it.run.time > 0, "the clock to go")
press("Insert")
wait(lambda: it.waits, "the pause")
press("Delete")
"""


@needs_screen
def test_nothing_is_saved_of_a_robot_that_was_not_driven(tmp_path):
    """A window that is closed before the first order leaves no folder; the clock goes without an
    order, too, when it is told to."""
    with screen() as display:
        done = at_window(display, "Driver", UNDRIVEN_SCRIPT, "drive", "straight", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "nothing is saved" in done.stdout
    assert list(tmp_path.iterdir()) == []


@needs_screen
def test_scenario_is_viewed_with_its_controller(tmp_path):
    """It runs by itself, a step at a time, from the start again, to its end."""
    changes = ["--set", "run.time_limit=0.5"]
    with screen() as display:
        done = at_window(
            display, "Player", VIEW_SCRIPT, "view", "straight", *changes, folder=tmp_path
        )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "timed_out"
