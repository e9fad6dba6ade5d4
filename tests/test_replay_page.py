"""Replay pages in a browser: what is seen, and that it is where MuJoCo has it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from pages import TOLERANCE, needs_browser, opened, picture

from omnitrack_sim import Result, load_scenario, override, render_replay, run
from omnitrack_sim.robots.omnitrack.looks import look_pitch

pytestmark = [needs_browser, pytest.mark.long]


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def mission() -> Result:
    """Through two reducers into a pipe, tail first out of it and on to another end."""
    changes = {"mission.goals": ["side", "outlet"]}
    return run(override(load_scenario("missions/narrow"), changes))


@pytest.fixture(scope="module")
def mission_page(mission, place) -> Path:
    path = place / "mission.html"
    render_replay(mission, path=path)
    return path


@pytest.fixture(scope="module")
def mission_tab(browser, mission_page) -> Iterator:
    """One tab for all tests that look at the mission; what went wrong in it fails the last one."""
    with opened(browser, mission_page, hash="#t=3&camera=follow") as page:
        yield page


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
    model = result.scenario.to_spec(looks=True).compile()
    qpos = result.scenario.robot.display.poses(model, result.trajectory)
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
