"""From keys to orders, without a window and without physics."""

from __future__ import annotations

import re
import string

import mujoco
import numpy as np
import pytest
from documents import page

from omnitrack_sim.robots.driving import Order
from omnitrack_sim.show.viewer.driver import KeyContext, Teleoperation
from omnitrack_sim.show.viewer.keys import DRIVE, REPLAY, VIEW, Do, action_of, help_lines

UP, TOWARDS = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
"""A nose that points up the picture, and the viewer in front of it: x is to the right."""


def pose(time: float = 1.0, nose: np.ndarray = UP, roll_deg: float = 0.0) -> KeyContext:
    return KeyContext(time=time, nose=nose, roll_deg=roll_deg, towards=TOWARDS)


def wheel() -> Teleoperation:
    return Teleoperation(cruise_speed=0.1, speed_limit=0.2, roll_deg=0.0)


@pytest.mark.parametrize("keys", [VIEW, REPLAY, DRIVE])
def test_no_key_is_one_of_mujocos(keys):
    """Our keys are neither letters nor digits, nor anything that MuJoCo's window shows or hides
    things with, nor Tab, Escape, brackets or F1 to F7; and none asks for two things."""
    letters = set(string.ascii_uppercase + string.digits + "[]")
    letters |= {row[2] for row in (*mujoco.mjVISSTRING, *mujoco.mjRNDSTRING)} - {""}
    taken = {ord(letter) for letter in letters} | {256, 258, *range(290, 297)}
    codes = [code for key in keys for code in key.actions]
    assert len(set(codes)) == len(codes)
    assert not taken & set(codes)
    assert all(action_of(keys, code) is not None for code in codes)
    assert action_of(keys, ord("A")) is None


def test_every_key_is_told():
    """Each key stands in the help, alone or beside the one that it belongs to, and in
    viewer.md; nothing that can be asked for is left without a key."""
    for keys in (VIEW, REPLAY, DRIVE):
        for key in keys:
            assert len(re.split(r"\s{2,}", key.name)) == len(set(key.actions.values()))
        text = page("viewer")
        words = [word for name, _ in help_lines(keys) for word in re.split(r"\s{2,}", name)]
        assert [word for word in words if word not in text] == []
    assert {
        do for keys in (VIEW, REPLAY, DRIVE) for key in keys for do in key.actions.values()
    } == set(Do)


def test_speed_grows_by_steps_up_to_the_limit():
    """Four presses are the cruise speed, no press goes beyond the belts' limit, and as many back
    stand still, exactly."""
    driver = wheel()
    orders = [driver.press(Do.FORWARD, pose(t)) for t in range(12)]
    asked_for = [order.speed for order in orders if order is not None]
    assert asked_for == pytest.approx([0.025 * k for k in range(1, 9)])
    assert orders[8:] == [None] * 4  # at the limit a press changes nothing
    for _ in range(8):
        driver.press(Do.BACK, pose())
    assert driver.order.speed == 0.0
    for _ in range(20):
        driver.press(Do.BACK, pose())
    assert driver.order.speed == -0.2


@pytest.mark.parametrize(
    ("do", "heading"),
    [
        (Do.LEFT, [-np.sin(np.radians(15)), 0, np.cos(np.radians(15))]),
        (Do.RIGHT, [np.sin(np.radians(15)), 0, np.cos(np.radians(15))]),
        (Do.AWAY, [0, np.sin(np.radians(15)), np.cos(np.radians(15))]),
        (Do.TOWARDS, [0, -np.sin(np.radians(15)), np.cos(np.radians(15))]),
    ],
)
def test_steering_is_that_of_the_picture(do, heading):
    """One press turns the heading by 15 degrees to the left or right of the picture, away from the
    viewer or towards him; the first one from where the nose points."""
    order = wheel().press(do, pose())
    assert order is not None
    assert order.heading == pytest.approx(heading)


def test_left_and_right_are_those_of_a_driver_who_looks_along_the_nose():
    """A robot that drives down the picture turns to its own left, which is the picture's right."""
    order = wheel().press(Do.LEFT, pose(nose=-UP))
    assert order is not None
    assert order.heading is not None
    assert order.heading[0] > 0.2


def test_heading_stays_ahead_of_the_robot():
    """No press takes the heading further than 120 degrees from the nose, where the robot would
    come to turn the other way round; presses back are taken."""
    driver = wheel()
    for _ in range(20):
        driver.press(Do.LEFT, pose())
    assert driver.order.heading is not None
    assert np.degrees(np.arccos(driver.order.heading @ UP)) == pytest.approx(120.0)
    assert driver.press(Do.RIGHT, pose()) is not None
    straight = driver.press(Do.STRAIGHT, pose())
    assert straight is not None
    assert straight.heading is None


def test_line_of_sight_along_the_nose_steers_nowhere():
    """Seen from behind, there is no away and no towards, and nothing is asked."""
    along = KeyContext(time=1.0, nose=UP, roll_deg=0.0, towards=-UP)
    assert wheel().press(Do.AWAY, along) is None


def test_stop_stops_everything():
    """Space takes away speed and heading, and leaves the modules where their roll is by now."""
    driver = wheel()
    for do in (Do.FORWARD, Do.LEFT, Do.ROLL_ON, Do.ROLL_ON):
        driver.press(do, pose())
    assert driver.order.roll_deg == 30.0
    assert driver.press(Do.STOP, pose(time=2.0, roll_deg=17.5)) == Order(time=2.0, roll_deg=17.5)
    assert driver.press(Do.STOP, pose(time=3.0, roll_deg=17.5)) is None


def test_controller_gives_way_to_a_stop_only():
    """While the autopilot drives, the keys of driving do nothing; Space takes over, at rest."""
    driver = wheel()
    driver.press(Do.FORWARD, pose())
    handed = driver.press(Do.HAND_OVER, pose(time=2.0))
    assert handed is not None
    assert handed.by == "autopilot"
    driving = (Do.FORWARD, Do.LEFT, Do.ROLL_ON, Do.STRAIGHT, Do.HAND_OVER)
    assert [driver.press(do, pose(3.0)) for do in driving] == [None] * len(driving)
    taken = driver.press(Do.STOP, pose(time=4.0, roll_deg=90.0))
    assert taken == Order(time=4.0, by="hand", speed=0.0, roll_deg=90.0)
    assert driver.press(Do.ROLL_BACK, pose(5.0)) == Order(time=5.0, roll_deg=75.0)


def test_roll_goes_no_further_than_an_order_may_ask():
    """Ten turns either way."""
    driver = Teleoperation(0.1, 0.2, roll_deg=3590.0)
    assert driver.press(Do.ROLL_ON, pose()) == Order(time=1.0, roll_deg=3600.0)
    assert driver.press(Do.ROLL_ON, pose()) is None


def test_keys_that_are_none_of_driving_order_nothing():
    """Pause, speed of time and help are the window's own."""
    driver = wheel()
    assert [driver.press(do, pose()) for do in (Do.PAUSE, Do.TIME_FASTER, Do.HELP)] == [None] * 3
