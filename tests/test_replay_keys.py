"""Replay pages in a browser: what switches, keys and pointer do, a second run, names as text."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pages import TOLERANCE, needs_browser, opened, picture
from samples import sample_result, sample_trajectory

from omnitrack_sim import Result, load_scenario, override, render_replay, run
from omnitrack_sim.record.events import Remark
from omnitrack_sim.scenario import validate

pytestmark = [needs_browser, pytest.mark.long]
MARKUP = "<img src=x onerror='window.hacked=1'><!--<script>"


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def tees() -> list[Result]:
    """Two ways to a tee at two speeds."""
    common = {"run.time_limit": 1.5}
    changes = [common | {"control.cruise_speed": speed} for speed in (0.1, 0.08)]
    return [run(override(load_scenario("tee_turn"), change)) for change in changes]


@pytest.fixture(scope="module")
def pair_page(tees, place) -> Path:
    path = place / "pair.html"
    render_replay(tees[0], path=path, compare=tees[1])
    return path


@pytest.fixture(scope="module")
def pair_tab(browser, pair_page) -> Iterator:
    with opened(browser, pair_page) as page:
        yield page


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


def test_events_are_told_under_the_pointer(browser, place):
    """On the time line, in words that are never markup; so are all other names."""
    scenario = validate(
        {"name": MARKUP, "pipes": [{"kind": "straight", "length": 1.0, "name": "b"}]}
    )
    reason = f"</script>{MARKUP}"
    events = [Remark(0, 1.0, f"met {reason}")]
    trajectory = sample_trajectory()
    trajectory = type(trajectory)(
        trajectory.time,
        trajectory.channels,
        (MARKUP, "turn", "leave"),
        trajectory.qpos,
        trajectory.schema,
    )
    result = sample_result(trajectory, scenario=scenario, events=events, reason=reason)
    path = place / "markup.html"
    render_replay(result, path=path)
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
    shown = render_replay(tees[0])
    render_replay(tees[0], path=place / "one.html")
    assert shown.html == (place / "one.html").read_text(encoding="utf-8")
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


@pytest.mark.parametrize("width", [390, 800, 1280])
def test_the_list_of_plots_wraps_within_its_labels(browser, pair_page, width):
    """At any width the box stands before its label, a second line of which begins below the first
    one, and no label reaches into the next one."""
    code = """[...document.querySelectorAll("#chosen label")].map((label) => {
        const text = document.createRange();
        text.selectNodeContents(label.lastChild);
        const sides = (box) => [box.left, box.right, box.top, box.bottom];
        return [sides(label.querySelector("input").getBoundingClientRect()),
            ...[...text.getClientRects()].map(sides)];
    })"""
    with opened(browser, pair_page, width, 800) as page:
        page.locator("#choose summary").click()
        labels = page.evaluate(code)
    assert len(labels) > 10
    for box, *lines in labels:
        assert {round(line[0]) for line in lines} == {round(lines[0][0])}
        assert lines[0][0] > box[1]
        assert lines[0][2] < (box[2] + box[3]) / 2 < lines[0][3]
        right, top, bottom = max(line[1] for line in lines), lines[0][2], lines[-1][3]
        for other, *_ in labels:
            beside = other[0] > box[0] and other[2] < bottom and other[3] > top
            assert not beside or right < other[0]


def test_no_seam_is_seen_from_within_a_pipe(pair_tab):
    """Before the joint of two pipes hardly a pixel is darker than those left and right of it, which
    are alike: the halves of a wall and the ends of two walls would leave a line of some 350 such
    pixels, and some 50 are at the edge of the branch."""
    page = pair_tab
    page.evaluate("replay.setCamera('onboard'); replay.seek(0.5)")

    def lines() -> int:
        """Pixels of upright lines that are darker than both sides, which are alike."""
        grey = picture(page)[60:-120].mean(axis=2)
        left, middle, right = grey[:, :-4], grey[:, 2:-2], grey[:, 4:]
        return ((np.minimum(left, right) - middle > 5) & (np.abs(left - right) < 4)).sum()

    assert lines() > 300, "rings half a bore apart"
    page.evaluate("replay.stage.ring.visible = false; replay.stale = true")
    assert lines() < 150
    page.evaluate("replay.stage.ring.visible = true; replay.stale = true")
