"""Driving by keyboard: keys of the window become orders to a controller that obeys them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from omnitrack_sim.base.bounds import MAX_ORDERS
from omnitrack_sim.base.rotations import Array, rotation_about, unit
from omnitrack_sim.record.display import Lines
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.driving import ObeysOrders, Order
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.loading import to_drive, with_orders
from omnitrack_sim.show.viewer.keys import DRIVE, Do
from omnitrack_sim.show.viewer.player import LiveRun, Player
from omnitrack_sim.show.viewer.window import Window
from omnitrack_sim.sim.run import no_load_slips
from omnitrack_sim.sim.simulation import Simulation

DRIVER = "keyboard"
"""Driver in the provenance of a driven run."""
SPEED_STEPS = 4
"""Presses from standing still to the cruise speed."""
HEADING_STEP = math.radians(15.0)
"""Change of the heading by one press, rad."""
MAX_HEADING = math.radians(120.0)
"""Angle of the heading from the nose beyond which no press takes it, rad: past half a turn the
robot would turn the other way round."""
ROLL_STEP_DEG = 15.0
"""Change of the modules' roll by one press, degrees; the robot turns by at most a third of it."""
MAX_ROLL_DEG = 3600.0
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
    """Set points of a driver, each of which a press changes by a step.

    They stay so until the next press. Left and right are those of the picture: the heading is
    turned about the line of sight, and away and towards about the line across it.

    Args:
        cruise_speed: m/s.
        speed_limit: m/s, which no press goes beyond.
        roll_deg: of the modules at first.

    Attributes:
        order: that was given last.
    """

    def __init__(self, cruise_speed: float, speed_limit: float, roll_deg: float) -> None:
        self._step, self._limit = cruise_speed / SPEED_STEPS, speed_limit
        self.order = Order(time=0.0, roll_deg=roll_deg)

    def press(self, do: Do, pose: KeyContext) -> Order | None:
        """Return the order that a key makes; None where it changes nothing.

        While the controller drives, only a stop takes over from it, and the run can be ended.
        """
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
        """Return the changes of the order by a key; none where the key does not drive."""
        changes: Mapping[Do, Callable[[], dict[str, object]]] = {
            Do.FORWARD: partial(self._faster, 1),
            Do.BACK: partial(self._faster, -1),
            Do.ROLL_ON: partial(self._rolled, ROLL_STEP_DEG),
            Do.ROLL_BACK: partial(self._rolled, -ROLL_STEP_DEG),
            Do.STRAIGHT: lambda: {"heading": None},
            Do.LEFT: lambda: self._turned(pose.towards, pose),
            Do.RIGHT: lambda: self._turned(-pose.towards, pose),
            Do.AWAY: lambda: self._turned(self._across(pose), pose),
            Do.TOWARDS: lambda: self._turned(-self._across(pose), pose),
        }
        return changes[do]() if do in changes else {}

    def _faster(self, steps: int) -> dict[str, object]:
        # Whole steps, so that as many back lead to exactly nothing.
        count = round(self.order.speed / self._step) + steps
        return {"speed": min(max(count * self._step, -self._limit), self._limit)}

    def _rolled(self, step_deg: float) -> dict[str, object]:
        assert self.order.roll_deg is not None
        asked = self.order.roll_deg + step_deg
        return {"roll_deg": min(max(asked, -MAX_ROLL_DEG), MAX_ROLL_DEG)}

    def _heading(self, pose: KeyContext) -> Array:
        """Return the heading at hand (3,): at first where the nose points."""
        return pose.nose if self.order.heading is None else np.array(self.order.heading)

    def _across(self, pose: KeyContext) -> Array:
        """Return the axis (3,) about which the heading turns away from the viewer."""
        return unit(np.cross(self._heading(pose), -pose.towards))

    def _turned(self, about: Array, pose: KeyContext) -> dict[str, object]:
        """Return the heading, turned by a step about an axis (3,); nothing where it stays."""
        before = self._heading(pose)
        heading = rotation_about(about, HEADING_STEP) @ before if about.any() else before
        far = heading @ pose.nose < min(math.cos(MAX_HEADING), float(before @ pose.nose))
        if far or not about.any():  # along the line of sight there is no way to turn
            return {}
        x, y, z = (heading / np.linalg.norm(heading)).tolist()
        return {"heading": (x, y, z)}


def _same(one: Order, other: Order) -> bool:
    """Return whether two orders ask for the same."""
    return one.model_copy(update={"time": other.time}) == other


class Driver(Player):
    """Player of a robot that somebody drives; the scenario's controller is the autopilot.

    Time stands still until the first order is given. The run is over when the driver ends it, when
    the window is closed, or when the robot's run ends as any other.
    """

    keys = DRIVE
    run: LiveRun

    def __init__(self, scenario: Scenario, window: Window, speed: float = 1.0) -> None:
        super().__init__(to_drive(scenario, DRIVER), window, speed)
        setup = self._controller.setup
        self._wheel = Teleoperation(
            float(setup.settings.cruise_speed[0]),
            float(setup.settings.speed_limit[0]),
            float(np.degrees(self._controller.roll[0, 0])),
        )
        self.pace.paused = True

    @property
    def waits(self) -> bool:
        """True while time stands still because no order has been given yet."""
        return self.pace.paused and not self.driven

    @property
    def simulation(self) -> Simulation:
        """Simulation of the driven robot."""
        return self.run.simulation

    @property
    def _controller(self) -> ObeysOrders:
        assert isinstance(self.simulation.controller, ObeysOrders)
        return self.simulation.controller

    def act(self, do: Do) -> None:
        """Do what a key asks for, and give the order that it makes."""
        waits = self.waits
        super().act(do)
        if self.simulation.active[0] and not (waits and do is Do.FINISH):
            # The last order that there is room for ends the run.
            full = len(self._controller.orders()) >= MAX_ORDERS - 1
            order = self._wheel.press(Do.FINISH if full else do, self._pose())
            if order is not None:
                self._controller.give(order)
                self.pace.paused &= not waits
        if do is Do.FINISH:
            self.window.close()

    def _pose(self) -> KeyContext:
        rotation = self.simulation.readings["rotation"][0]
        return KeyContext(
            time=self.run.time,
            nose=rotation[:, 2],
            roll_deg=float(np.degrees(self._controller.roll[0, 0])),
            towards=self.window.towards,
        )

    @property
    def driven(self) -> bool:
        """True once the driver has given an order."""
        return bool(self._controller.orders())

    def result(self) -> Result:
        """Return the run as it was driven, ended here if it is not over.

        Its scenario holds the orders, and repeats it to the same bytes.
        """
        simulation = self.simulation
        if simulation.active[0]:
            order = self._wheel.press(Do.FINISH, self._pose())
            if order is not None and self._controller.orders()[-1:] != (order,):
                self._controller.give(order)
            while simulation.active[0]:
                simulation.step()
        scenario = with_orders(self.scenario, self._controller.orders())
        (result,) = simulation.results(no_load_slips([scenario]))
        return replace(result, scenario=scenario, provenance=provenance_of(scenario))

    def panels(self) -> list[tuple[mujoco.mjtGridPos, Lines]]:
        """Return the panels in the corners of the window."""
        return [*super().panels(), (mujoco.mjtGridPos.mjGRID_BOTTOMRIGHT, self._orders())]

    def _orders(self) -> Lines:
        """Return the orders of the driver in words."""
        if not self.simulation.active[0]:
            return [("the run is over", "Delete saves it and closes")]
        if self.waits:
            return [("time stands still", "until your first order, such as Up")]
        order = self._wheel.order
        if order.by != "hand":
            return [("driven by", "the controller; Space takes over")]
        steer = "off"
        if order.heading is not None:
            nose = self.simulation.readings["rotation"][0][:, 2]
            away = np.degrees(np.arccos(np.clip(nose @ order.heading, -1, 1)))
            steer = f"nose {away:.0f} deg off its heading"
        return [
            ("driven by", "you"),
            ("speed asked", f"{1000 * order.speed:+.0f} mm/s"),
            ("steering", steer),
            ("roll asked", f"{order.roll_deg:.0f} deg"),
        ]
