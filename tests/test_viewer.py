"""Windows: keys reach them, and what is driven at one is saved and repeated."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from screens import at_window, needs_screen, screen

import omnitrack_sim as ot

pytestmark = pytest.mark.long

SAVED = ("result.json", "scenario.json", "timeline.csv", "trajectory.parquet", "replay.npz")


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
