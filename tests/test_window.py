"""The window without a screen: what it asks MuJoCo's own to show, and the commands that open it."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import ClassVar

import mujoco
import numpy as np
import pytest
from commands import omnitrack
from typer.testing import CliRunner

import omnitrack_sim as ot
from omnitrack_sim.base.errors import RenderError
from omnitrack_sim.cli import app
from omnitrack_sim.show.viewer import driver, player, window
from omnitrack_sim.show.viewer.window import Window

SCENARIO = ot.load_scenario("tee_turn")
CORNER = mujoco.mjtGridPos.mjGRID_TOPLEFT


class Handle:
    """What the window has of MuJoCo's, and what it was told."""

    def __init__(self) -> None:
        self.opt, self.cam = mujoco.MjvOption(), mujoco.MjvCamera()
        self.user_scn = mujoco.MjvScene()
        self.viewport = SimpleNamespace(width=800, height=600)
        self.m: object | None = object()
        self.texts, self.shown, self.open = [], 0, True
        self.lock, self.is_running = nullcontext, lambda: self.open

    def set_texts(self, texts) -> None:
        self.texts = texts

    def sync(self) -> None:
        self.shown += 1

    def close(self) -> None:
        self.open, self.m = False, None


@pytest.fixture
def opened(monkeypatch):
    """A window on the tee turn, and its handle."""
    handle = Handle()
    monkeypatch.setattr(Window, "_launched", lambda self: handle)
    with Window(SCENARIO) as shown:
        yield shown, handle
    assert not handle.open
    assert not shown.is_open


def start(shown: Window) -> np.ndarray:
    """Joint positions at the model's start."""
    return np.array(mujoco.MjData(shown.model).qpos)


def test_the_camera_keeps_with_the_robot(opened):
    """It looks at the robot, and moves as this does; what the mouse has moved it by stays."""
    shown, handle = opened
    qpos = start(shown)
    shown.show(qpos, [])
    data = mujoco.MjData(shown.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(shown.model, data)
    chassis = data.body(SCENARIO.robot.chassis).xpos
    assert handle.cam.lookat == pytest.approx(chassis)
    handle.cam.lookat[:] += [0.1, 0.0, 0.02]  # by the mouse
    before = np.array(handle.cam.lookat)
    qpos[:3] += [0.01, -0.02, 0.3]
    shown.show(qpos, [])
    assert handle.cam.lookat - before == pytest.approx([0.01, -0.02, 0.3])
    assert handle.shown == 2


@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (90, -30), (-120, 45), (30, 89)])
def test_the_viewer_is_where_the_camera_is(opened, azimuth, elevation):
    """Against where MuJoCo's camera looks."""
    shown, handle = opened
    handle.cam.azimuth, handle.cam.elevation = azimuth, elevation
    scene, option = mujoco.MjvScene(shown.model, 100), mujoco.MjvOption()
    data = mujoco.MjData(shown.model)
    mujoco.mj_forward(shown.model, data)
    mujoco.mjv_updateScene(shown.model, data, option, None, handle.cam, 7, scene)
    forward = (scene.camera[0].forward + scene.camera[1].forward) / 2
    assert shown.towards == pytest.approx(-forward, abs=1e-5)
    assert np.linalg.norm(shown.towards) == pytest.approx(1.0)


def test_it_opens_as_the_films_look(opened):
    """From the side on which pipes are cut open, so far away that the robot is seen whole."""
    shown, handle = opened
    back = window.follow_direction(SCENARIO.route.network)
    assert shown.towards == pytest.approx(back)
    assert handle.cam.distance == pytest.approx(
        1.25 * window.DISTANCE * SCENARIO.robot.length_scale
    )
    groups = [window.ROBOT_GROUP, window.INSIDE_GROUP]
    assert np.flatnonzero(handle.opt.geomgroup).tolist() == sorted(groups)
    assert not handle.opt.sitegroup.any()
    assert shown.size == (800, 600)


def test_pipes_before_the_robot_are_clear(opened):
    """Those between it and the viewer and no others; the light is over the viewer's shoulder."""
    shown, handle = opened
    qpos = start(shown)
    names = [part.name for part in SCENARIO.route.network.parts]
    clear = {}
    for name, around in (("here", 0.0), ("behind", 180.0)):
        handle.cam.azimuth += around
        shown.show(qpos, [])
        alpha = [shown.model.geom(f"look_inside_{part}").rgba[3] for part in names]
        clear[name] = [part for part, a in zip(names, alpha, strict=True) if a < 0.5]
        sun = shown._data.light_xdir[shown.model.light("sun").id]
        assert sun @ shown.towards < -0.3
    assert all(len(parts) < len(names) for parts in clear.values())


def test_panels_are_written_in_the_letters_of_the_window(opened):
    """Words on the left, values on the right, line by line; other letters as question marks."""
    shown, handle = opened
    shown.show(start(shown), [(CORNER, [("tilt", "3.1°"), ("time", "2 s")]), (CORNER, [])])
    (_, corner, left, right), (_, _, *empty) = handle.texts
    assert corner == int(CORNER)
    assert (left, right) == ("tilt\ntime", "3.1?\n2 s")
    assert empty == ["", ""]


def test_keys_come_once_and_in_their_order(opened):
    """All since the last question."""
    shown, _ = opened
    for key in (65, 66, 65):
        shown._keys.put(key)
    assert shown.pressed(0.0) == [65, 66, 65]
    assert shown.pressed(0.0) == []
    shown._keys.put(70)
    assert shown.pressed(5.0) == [70]


def test_nothing_is_shown_in_a_window_that_was_closed(opened):
    """By its user, for instance."""
    shown, handle = opened
    handle.open = False
    shown.show(start(shown), [])
    assert handle.shown == 0
    assert not shown.is_open


def test_a_screen_is_required(monkeypatch):
    """Without one the message says what does without."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RenderError, match="needs a screen; `omnitrack run`"):
        window.require_screen()


@pytest.mark.parametrize("name", ["DISPLAY", "WAYLAND_DISPLAY"])
def test_a_screen_of_either_kind_will_do(name, monkeypatch):
    """On it a window has to open; if none does, the message names the screen."""
    for each in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(each, raising=False)
    monkeypatch.setenv(name, "screen-7")
    monkeypatch.setattr(window, "_opens_window", lambda glfw: True)
    window.require_screen()
    monkeypatch.setattr(window, "_opens_window", lambda glfw: False)
    with pytest.raises(RenderError, match=r"opens on the screen 'screen-7' \(no reason"):
        window.require_screen()


class Played:
    """A player that only notes what it was made of."""

    made: ClassVar[list[tuple]] = []

    def __init__(self, *given) -> None:
        self.made.append((type(self).__name__, *given))
        self.driven = False

    def play(self) -> None:
        self.made.append(("played",))


@pytest.fixture
def commands(monkeypatch):
    """The commands with windows and players that do nothing; returns what they were made of."""
    handle = Handle()
    monkeypatch.setattr(Window, "_launched", lambda self: handle)
    monkeypatch.setattr(window, "require_screen", lambda: None)
    monkeypatch.setattr(Played, "made", [])
    for module, name in ((player, "Player"), (player, "Replayer"), (driver, "Driver")):
        monkeypatch.setattr(module, name, type(name, (Played,), {}))
    return Played.made


def test_a_scenario_is_played_and_a_saved_run_is_replayed(commands, tmp_path):
    """At the speed that is asked for; --set is for scenarios."""
    run = CliRunner().invoke(app, ["view", "straight", "--speed", "0.5", "--set", "seed=3"])
    assert run.exit_code == 0, run.output
    (name, scenario, _, pace), played = commands
    assert (name, scenario.name, scenario.seed, pace) == ("Player", "straight", 3, 0.5)
    assert played == ("played",)
    commands.clear()
    ot.run(ot.load_scenario("straight", {"run.time_limit": 0.1})).save(tmp_path / "run")
    run = CliRunner().invoke(app, ["view", str(tmp_path / "run"), "--speed", "max"])
    assert run.exit_code == 0, run.output
    (name, result, _, pace), _ = commands
    assert (name, result.duration_s, pace) == ("Replayer", pytest.approx(0.1), float("inf"))
    with pytest.raises(ot.InputError, match="is a saved run; --set is for scenarios"):
        CliRunner().invoke(
            app, ["view", str(tmp_path / "run"), "--set", "seed=1"], catch_exceptions=False
        )


def test_what_nobody_drove_is_not_saved(commands, tmp_path):
    """The command says so, and leaves no folder."""
    place = tmp_path / "driven"
    run = CliRunner().invoke(app, ["drive", "straight", "--out", str(place)])
    assert run.exit_code == 0, run.output
    assert [made[0] for made in commands] == ["Driver", "played"]
    assert "nothing was driven, and nothing is saved" in run.stdout
    assert not place.exists()


@pytest.mark.parametrize("text", ["0", "0.009", "1001", "-1", "nan", "fast", "inf"])
def test_speeds_out_of_range_are_refused(commands, text):
    """With the range, and what is asked for as it was written."""
    told = f"--speed: is '{text}'; it must be a number from 0.01 to 1000, or max"
    with pytest.raises(ot.InputError, match="--speed") as refused:
        CliRunner().invoke(app, ["view", "straight", "--speed", text], catch_exceptions=False)
    assert told in str(refused.value)
    assert not commands


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


def test_what_is_driven_is_kept_beside_its_scenario(tmp_path, monkeypatch):
    """Without --out in a folder of its name, which is looked at before a window opens."""
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "out" / "straight_driven"
    place.mkdir(parents=True)
    (place / "notes.txt").write_text("mine")
    done = omnitrack("drive", "straight")
    assert done.returncode == 2
    assert "straight_driven" in done.stderr
    assert "no run" in done.stderr
