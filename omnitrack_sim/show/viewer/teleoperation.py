"""From keys to orders: the set points of a driver at a keyboard. Pure: no window, no physics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omnitrack_sim.base.rotations import Array, rotation_about, unit
from omnitrack_sim.robots.omnitrack.control.driven import Order
from omnitrack_sim.show.viewer.keys import Do

SPEED_STEPS = 4
"""Presses from standing still to the cruise speed."""
HEADING_STEP = math.radians(15.0)
"""By which one press turns the heading, rad."""
FARTHEST_HEADING = math.radians(120.0)
"""Angle of the heading from the nose beyond which no press takes it, rad: past half a turn the
robot would turn the other way round."""
ROLL_STEP_DEG = 15.0
"""By which one press rolls the modules, degrees: the robot turns by a third of that and less."""
MOST_ROLL_DEG = 3600.0
"""Roll either way that an order can ask for, degrees."""


@dataclass(frozen=True)
class KeyContext:
    """The state on which the effect of a key depends, when it is pressed.

    Attributes:
        time: s.
        nose: (3,) unit vector along the robot.
        roll_deg: last commanded roll of the modules.
        towards: (3,) unit vector from the picture to the viewer. All in the world frame.
    """

    time: float
    nose: Array
    roll_deg: float
    towards: Array


class Teleoperation:
    """The set points of a driver; ``order`` is the last one that was given.

    Every press changes one of them by a step, and it stays so until the next press. Left and right
    are those of the picture: the heading is turned about the line of sight, and away and towards
    about the line across it. Speeds are in m/s.
    """

    def __init__(self, cruise_speed: float, speed_limit: float, roll_deg: float) -> None:
        self._step, self._limit = cruise_speed / SPEED_STEPS, speed_limit
        self.order = Order(time=0.0, roll_deg=roll_deg)

    def press(self, do: Do, pose: KeyContext) -> Order | None:
        """The order that a key makes; None where it changes nothing. While the controller
        drives, only a stop takes over from it, and the run can be ended."""
        if do is Do.FINISH:
            return self._give(Order(time=pose.time, by="end"))
        if do is Do.STOP:
            stop = Order(time=pose.time, roll_deg=pose.roll_deg)
            return None if _same(stop, self.order) else self._give(stop)
        if self.order.by != "hand":
            return None
        if do is Do.HAND_OVER:
            return self._give(Order(time=pose.time, by="autopilot"))
        changed = self.order.model_copy(update={"time": pose.time} | self._changes(do, pose))
        return None if _same(changed, self.order) else self._give(changed)

    def _give(self, order: Order) -> Order:
        self.order = order
        return order

    def _changes(self, do: Do, pose: KeyContext) -> dict[str, object]:
        """Changes of the order at hand by a key; none where the key does not drive."""
        speeds, rolls = {Do.FORWARD: 1, Do.BACK: -1}, {Do.ROLL_ON: 1, Do.ROLL_BACK: -1}
        if do in speeds:
            # Whole steps, so that as many back lead to exactly nothing.
            count = round(self.order.speed / self._step) + speeds[do]
            return {"speed": min(max(count * self._step, -self._limit), self._limit)}
        if do in rolls:
            before = self.order.roll_deg
            assert before is not None
            asked = before + rolls[do] * ROLL_STEP_DEG
            return {"roll_deg": min(max(asked, -MOST_ROLL_DEG), MOST_ROLL_DEG)}
        if do is Do.STRAIGHT:
            return {"heading": None}
        heading = self._turned(do, pose)
        return {} if heading is None else {"heading": heading}

    def _turned(self, do: Do, pose: KeyContext) -> tuple[float, float, float] | None:
        """The heading, turned by a step; None where it stays."""
        before = pose.nose if self.order.heading is None else np.array(self.order.heading)
        across = unit(np.cross(before, -pose.towards))
        about = {
            Do.LEFT: pose.towards,
            Do.RIGHT: -pose.towards,
            Do.AWAY: across,
            Do.TOWARDS: -across,
        }.get(do)
        if about is None or not about.any():  # no steering, or along the line of sight
            return None
        heading = rotation_about(about, HEADING_STEP) @ before
        if heading @ pose.nose < min(math.cos(FARTHEST_HEADING), float(before @ pose.nose)):
            return None
        x, y, z = (heading / np.linalg.norm(heading)).tolist()
        return x, y, z


def _same(one: Order, other: Order) -> bool:
    """Return True if two orders ask for the same."""
    return one.model_copy(update={"time": other.time}) == other
