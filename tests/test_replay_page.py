"""Replay pages in a browser: what is seen, and that it is where MuJoCo has it."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from PIL import Image
from runs import COLLIDER
from samples import sample_result, sample_trajectory

from omnitrack_sim import Result, load_scenario, override, run, show_replay, write_replay
from omnitrack_sim.film.poses import smooth_belts
from omnitrack_sim.model.looks import look_pitch
from omnitrack_sim.record.events import Remark
from omnitrack_sim.scenario import validate
from omnitrack_sim.sim.builder import scene_of

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
TOLERANCE = 1e-4
"""How far a body in the page may be from where MuJoCo has it, m."""
MARKUP = "<img src=x onerror='window.hacked=1'><!--<script>"


@pytest.fixture(scope="module")
def browser():
    """Chromium without a screen or graphics hardware."""
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def mission() -> Result:
    """Through two reducers into a pipe, tail first out of it and on to another end."""
    changes = {"mission.goals": ["side", "outlet"], "physics.collider": COLLIDER}
    return run(override(load_scenario("missions/narrow"), changes))


@pytest.fixture(scope="module")
def mission_page(mission, place) -> Path:
    return write_replay(mission, place / "mission.html")


@pytest.fixture(scope="module")
def tees() -> list[Result]:
    """Two ways to a tee at two speeds."""
    common = {"physics.time_limit": 1.5, "physics.collider": COLLIDER}
    changes = [common | {"control.cruise_speed": speed} for speed in (0.1, 0.08)]
    return [run(override(load_scenario("tee_turn"), change)) for change in changes]


@pytest.fixture(scope="module")
def pair_page(tees, place) -> Path:
    return write_replay(tees[0], place / "pair.html", compare=tees[1])


@contextmanager
def opened(browser, path: Path, width: int = 1000, height: int = 700, hash: str = "") -> Iterator:
    """A page without a network. Errors and requests beyond the file fail the test."""
    context = browser.new_context(viewport={"width": width, "height": height}, offline=True)
    page, faults = context.new_page(), []
    page.on("console", lambda message: faults.append(message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda request: faults.append(request.url))
    page.goto(f"{path.as_uri()}{hash}")
    page.wait_for_function("window.replay?.ready", timeout=60_000)
    yield page
    context.close()
    own = (path.as_uri(), "blob:", "data:")
    assert [fault for fault in faults if not fault.startswith(own)] == []


@pytest.fixture(scope="module")
def mission_tab(browser, mission_page) -> Iterator:
    """One tab for all tests that look at the mission; what went wrong in it fails the last one."""
    with opened(browser, mission_page, hash="#t=3&camera=follow") as page:
        yield page


@pytest.fixture(scope="module")
def pair_tab(browser, pair_page) -> Iterator:
    with opened(browser, pair_page) as page:
        yield page


def picture(page) -> np.ndarray:
    """The drawn view (h, w, 3) as it is seen, without what lies over it."""
    page.wait_for_timeout(150)
    image = Image.open(io.BytesIO(page.locator("#stage").screenshot()))
    return np.asarray(image.convert("RGB"), float)


def poses(page, times: list[float]) -> dict[str, np.ndarray]:
    """Position and quaternion (len(times), 7) of each body in the page."""
    code = """times => times.map(time => {
        replay.seek(time);
        return Object.fromEntries(replay.bodies.map(name => {
            const { position, quaternion } = replay.pose(name);
            return [name, [...position, ...quaternion]];
        }));
    })"""
    found: list[dict[str, Any]] = page.evaluate(code, times)
    return {name: np.array([one[name] for one in found]) for name in found[0]}


def kinematics(result: Result, rows: np.ndarray) -> tuple[mujoco.MjModel, np.ndarray]:
    """The model of a run's film, and by it position and quaternion of all its bodies at samples
    (len(rows), nbody, 7)."""
    model = scene_of(result.scenario, looks=True).compile()
    qpos = smooth_belts(model, result.trajectory, look_pitch(result.scenario.robot))
    data, found = mujoco.MjData(model), []
    for row in rows:
        data.qpos[:] = qpos[row]
        mujoco.mj_kinematics(model, data)
        found.append(np.concatenate([data.xpos, data.xquat], axis=1))
    return model, np.array(found)


def test_bodies_are_where_mujoco_has_them(mission, mission_tab):
    """At 20 samples of a mission with reducers and a change of gear every body lies within 0.1 mm
    of MuJoCo's kinematics, lugs within a whole number of pitches."""
    assert set(mission.trajectory["gear"].tolist()) == {1.0, -1.0}
    rows = np.linspace(0, len(mission.trajectory.time) - 1, 20).astype(int)
    model, expected = kinematics(mission, rows)
    page = mission_tab
    found = poses(page, mission.trajectory.time[rows].tolist())
    assert len(found) == model.nbody - 1
    pitch = look_pitch(mission.scenario.robot)
    for name, pose in found.items():
        wanted = expected[:, model.body(name).id]
        apart = pose[:, :3] - wanted[:, :3]
        if name.startswith("track"):
            size = np.linalg.norm(apart, axis=1)
            whole = np.rint(size / pitch) * pitch
            apart *= (1 - whole / np.maximum(size, 1e-12))[:, None]
        assert np.linalg.norm(apart, axis=1).max() < TOLERANCE, name
        same = np.abs((pose[:, 3:] * wanted[:, 3:]).sum(axis=1))
        assert same.min() > 1 - 1e-7, name


def test_between_samples_bodies_are_between(mission, mission_tab):
    """Halfway in time the chassis is halfway, within 0.1 mm."""
    time, position = mission.trajectory.time, mission.trajectory["position"]
    rows = np.linspace(0, len(time) - 2, 7).astype(int)
    page = mission_tab
    found = poses(page, ((time[rows] + time[rows + 1]) / 2).tolist())["chassis"]
    middle = (position[rows] + position[rows + 1]) / 2
    assert np.linalg.norm(found[:, :3] - middle, axis=1).max() < TOLERANCE


def test_curves_hold_what_was_recorded(mission, mission_tab):
    """Each shown channel within a hundred-thousandth of its range, gaps as gaps."""
    page = mission_tab
    code = """Object.fromEntries(Object.entries(replay.motions[0].curves).map(
        ([name, columns]) => [name, columns.map(values => Array.from(values))]))"""
    found = page.evaluate(code)
    assert len(found) > 12
    for name, columns in found.items():
        recorded = mission.trajectory[name].reshape(len(mission.trajectory.time), -1)
        shown = np.array([[np.nan if v is None else v for v in column] for column in columns]).T
        step = (np.nanmax(recorded, axis=0) - np.nanmin(recorded, axis=0)) / 1e5 + 1e-12
        there = np.isfinite(recorded)
        assert (np.abs(shown - recorded) <= step)[there].all(), name
        assert (np.isfinite(shown) == there).all()


def test_a_mission_is_small_and_quickly_drawn(mission_page, mission_tab):
    """48 s of run: below 4 MB, 100 draw calls and 300,000 triangles with any camera and any
    pipes."""
    assert mission_page.stat().st_size < 4e6
    page = mission_tab
    for camera in ("orbit", "follow", "onboard"):
        for pipes in ("cut away", "translucent", "whole"):
            counts = page.evaluate(
                "([camera, pipes]) => { replay.setCamera(camera); replay.setPipes(pipes);"
                " replay.draw(); return replay.counts; }",
                [camera, pipes],
            )
            assert 0 < counts["calls"] < 100, (camera, pipes)
            assert 1000 < counts["triangles"] < 300_000
    assert page.evaluate("replay.frames") > 9


def test_a_picture_shows_something_and_changes_with_time(mission_tab):
    """The view is not of one colour; at another time it is another one."""
    page = mission_tab
    page.evaluate("replay.setCamera('follow'); replay.seek(3)")
    assert page.evaluate("[replay.time, replay.cameras.mode]") == [3, "follow"]
    first = picture(page)
    page.evaluate("replay.seek(20)")
    second = picture(page)
    assert first.std() > 20
    assert np.abs(first - second).mean() > 3


def test_every_switch_changes_the_picture(pair_tab):
    """Cameras, pipes, tracks by slip, arrows: each can be chosen by a button and told by it."""
    page = pair_tab
    page.evaluate("replay.setCamera('orbit'); replay.seek(1.0)")
    before = picture(page)
    for name in ("translucent", "whole", "follow", "forces", "onboard", "cut away"):
        button = page.get_by_role("button", name=name, exact=True)
        was = button.get_attribute("aria-pressed")
        button.click()
        assert button.get_attribute("aria-pressed") == ("false" if was == "true" else "true")
        after = picture(page)
        assert name == "cut away" or np.abs(after - before).max() > 30, name
        before = after


def test_scrubbing_shows_the_pose_of_that_time(tees, pair_tab):
    """By the bar, by a click into a plot, by one on the time line."""
    trajectory = tees[0].trajectory
    page = pair_tab
    page.locator("#scrub").fill("0.7")
    times = [page.evaluate("replay.time")]
    for canvas in ("#plots canvas >> nth=1", "#strip"):
        box = page.locator(canvas).bounding_box()
        page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + box["height"] / 2)
        times.append(page.evaluate("replay.time"))
    shown = page.evaluate("replay.pose('chassis').position")
    assert times[0] == 0.7
    assert times[1] == pytest.approx(0.75, abs=0.1)
    assert times[2] == pytest.approx(0.75, abs=0.01)
    wanted = [np.interp(times[2], trajectory.time, c) for c in trajectory["position"].T]
    np.testing.assert_allclose(shown, wanted, atol=TOLERANCE)


def test_a_plot_has_two_ticks_at_least(pair_tab):
    """Whatever its bounds, so that its scale can be read."""
    code = """async () => {
        const { ticks } = await import("replay/plots");
        const counts = [];
        for (let i = 0; i < 400; i++) {
            const [low, size] = [-0.013 * i, 1.7 * 1.03 ** i];
            for (const steps of [[], [1, 2, 5, 10, 15, 30, 45, 90, 180]]) {
                counts.push(ticks([low, low + size], 4, steps).length);
            }
        }
        return Math.min(...counts);
    }"""
    assert pair_tab.evaluate(code) >= 2


def test_keys_drive_the_page(pair_tab):
    """Space plays and pauses, arrows step, home and end go to the ends, digits choose cameras, a
    question mark opens the help."""
    page = pair_tab
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate("replay.time") == pytest.approx(1.1)
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("replay.time") == pytest.approx(1.0)
    page.keyboard.press("Home")
    page.keyboard.press("Space")
    page.wait_for_function("replay.time > 0.05")
    page.keyboard.press("Space")
    assert page.evaluate("[replay.playing, replay.time < replay.span[1]]") == [False, True]
    page.keyboard.press("End")
    assert page.evaluate("replay.time === replay.span[1]")
    modes = []
    for key in "321":
        page.keyboard.press(key)
        modes.append(page.evaluate("replay.cameras.mode"))
    assert modes == ["onboard", "follow", "orbit"]
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    assert "MIT" in page.locator("#help").text_content()
    assert page.evaluate("document.activeElement.textContent") == "close"
    page.keyboard.press("?")
    assert page.locator("#help").is_hidden()
    page.keyboard.press("?")
    page.keyboard.press("Escape")
    assert page.locator("#help").is_hidden()


def test_a_dragged_view_keeps_with_the_robot(mission_tab):
    """What is turned by hand stays turned while the robot moves on."""
    page = mission_tab
    page.evaluate("replay.setCamera('follow'); replay.seek(3)")
    page.mouse.move(500, 400)
    page.mouse.down()
    page.mouse.move(620, 400, steps=4)
    page.mouse.up()
    page.wait_for_timeout(100)
    turned = page.evaluate("replay.cameras.turned.theta")
    page.evaluate("replay.seek(9); replay.draw()")
    code = "replay.cameras.controls.target.toArray().concat(replay.pose('chassis').position)"
    target = np.array(page.evaluate(code))
    assert page.evaluate("replay.cameras.turned.theta") == pytest.approx(turned)
    assert abs(turned) > 0.1
    np.testing.assert_allclose(target[:3], target[3:], atol=1e-9)


def test_a_second_run_is_a_ghost_with_curves(tees, pair_tab):
    """It is where its own record has it, the head tells what differs, the plots have its curves."""
    other = tees[1].trajectory
    page = pair_tab
    page.evaluate("replay.setCamera('orbit'); replay.seek(1.2)")
    ghost = page.evaluate("replay.pose('chassis', 1).position")
    own = page.evaluate("replay.pose('chassis').position")
    head = page.locator("header").text_content()
    assert "second run" in page.locator("#keys").text_content()
    curves = page.evaluate("replay.plots.plots[0].curves.length")
    page.get_by_role("button", name="figures").click()
    assert "control.cruise_speed" in page.locator("#figures-tab").inner_text()
    page.get_by_role("button", name="plots").click()
    wanted = [np.interp(1.2, other.time, column) for column in other["position"].T]
    np.testing.assert_allclose(ghost, wanted, atol=TOLERANCE)
    assert np.linalg.norm(np.subtract(ghost, own)) > 1e-3
    assert "second run (control.cruise_speed 0.08 m/s)" in head
    assert curves == 9
    assert head.index(tees[0].reason) < head.index("second run (")
    assert "second run, translucent" in page.locator("#legend").text_content()


def test_head_and_figures_tell_the_run(mission, mission_tab):
    """Name, outcome, figures with units, the version that made it."""
    page = mission_tab
    head = page.locator("header").inner_text()
    assert "narrow" in head
    assert "reached goal after" in head
    assert f"{mission.metrics['distance_m']:.2f} m" in head
    made = page.locator("#provenance").text_content()
    assert mission.provenance["versions"]["omnitrack_sim"] in made
    page.get_by_role("button", name="figures").click()
    rows = page.locator("#figures-tab tbody tr")
    assert rows.count() >= 12
    assert "[object" not in page.locator("#figures-tab").inner_text()
    assert page.locator("#figures-tab td", has_text="phase_time_s cruise").count() == 1
    distance = rows.filter(has_text="headway along the centreline")
    assert distance.locator("td").last.get_attribute("colspan") == "3"
    page.get_by_role("button", name="events").click()
    first = page.locator("#events li button").first
    first.click()
    assert page.evaluate("replay.time") == pytest.approx(float(first.inner_text()[:-2]), abs=0.01)
    assert page.locator("#map").is_visible()


def test_events_are_told_under_the_pointer(browser, place):
    """On the time line, in words that are never markup; so are all other names."""
    scenario = validate(
        {"name": MARKUP, "pipes": [{"kind": "straight", "length": 1.0, "name": "b"}]}
    )
    reason = f"</script>{MARKUP}"
    events = [Remark(0, 1.0, f"met {reason}")]
    trajectory = sample_trajectory()
    trajectory = type(trajectory)(
        trajectory.time, trajectory.channels, (MARKUP, "turn", "leave"), trajectory.qpos
    )
    result = sample_result(trajectory, scenario=scenario, events=events, reason=reason)
    path = write_replay(result, place / "markup.html")
    with opened(browser, path) as page:
        assert page.locator("h1").text_content() == MARKUP
        assert page.locator("#reason").text_content() == reason
        assert page.locator("#state b").text_content() == MARKUP
        box = page.locator("#strip").bounding_box()
        page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 44)
        assert page.locator("#tip").text_content() == f"1.00 s, met {reason}"
        assert page.evaluate("[window.hacked === undefined, document.images.length]") == [True, 0]
        assert MARKUP in page.title()


def test_a_notebook_shows_the_page_in_a_frame(browser, place, tees):
    """What a notebook gets plays in a page of another's, and is the page that would be written."""
    shown = show_replay(tees[0])
    assert shown.html == write_replay(tees[0], place / "one.html").read_text(encoding="utf-8")
    notebook = place / "notebook.html"
    notebook.write_text(f"<body>{shown._repr_html_()}</body>", encoding="utf-8")
    context = browser.new_context(offline=True)
    page = context.new_page()
    page.goto(notebook.as_uri())
    (frame,) = [frame for frame in page.frames if frame != page.main_frame]
    frame.wait_for_function("window.replay?.ready", timeout=60_000)
    frame.evaluate("replay.seek(1.0)")
    assert frame.evaluate("replay.time") == pytest.approx(1.0)
    context.close()


def test_a_phone_shows_all_of_it(browser, mission_page):
    """390 pixels wide, nothing lies beyond the side, and the picture and its buttons are there."""
    with opened(browser, mission_page, 390, 844, "#t=5") as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for name in ("orbit", "whole", "forces", "play", "plots"):
            box = page.get_by_role("button", name=name, exact=True).bounding_box()
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= 390
        assert picture(page).std() > 20
        assert page.locator("#map").is_visible()
        assert page.locator("#plots canvas").first.bounding_box()["width"] > 300


def test_a_page_without_graphics_still_tells_the_run(browser, place, mission_page):
    """Where there is no WebGL the message says so; time, curves and figures are there."""
    text = mission_page.read_text(encoding="utf-8")
    mark, off = "<script type=", "<script>HTMLCanvasElement.prototype.getContext = ((own) => "
    off += "function (kind, ...rest) { return /webgl/.test(kind) ? null : own.call(this, kind, "
    off += "...rest); })(HTMLCanvasElement.prototype.getContext);</script>"
    path = place / "flat.html"
    path.write_text(text.replace(mark, off + mark, 1), encoding="utf-8")
    context = browser.new_context(offline=True)
    page = context.new_page()
    page.goto(path.as_uri())
    page.wait_for_function("window.replay?.ready")
    assert "no picture" in page.locator("#message").inner_text()
    page.keyboard.press("End")
    page.keyboard.press("2")
    at_end = "document.getElementById('clock').textContent === `${end} / ${end} s`"
    page.wait_for_function(f"() => {{ const end = replay.span[1].toFixed(2); return {at_end}; }}")
    assert page.locator(".values span").first.inner_text()
    context.close()
