"""The three windows: a scenario as it runs, a saved run again, a robot driven by keyboard."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from omnitrack_sim.base.bounds import MOST_ORDERS
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack.control.driven import DrivenController
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.loading import to_drive, with_orders
from omnitrack_sim.show.viewer.figures import Lines, covers_robot
from omnitrack_sim.show.viewer.keys import DRIVE, REPLAY, VIEW, Do, Key, asked, help_lines
from omnitrack_sim.show.viewer.pace import Pace
from omnitrack_sim.show.viewer.stages import LiveStage, ReplayStage
from omnitrack_sim.show.viewer.teleoperation import Pose, Teleoperation
from omnitrack_sim.show.viewer.window import Window
from omnitrack_sim.sim.run import no_load_slips
from omnitrack_sim.sim.simulation import Simulation

DRIVER = "keyboard"
"""Who drove, in the provenance of a driven run."""
_LEAP = 1.0  # s
_CORNER = mujoco.mjtGridPos


class Player:
    """Shows a scenario as it runs under its controller.

    Args:
        scenario: what to run. window: open, on this scenario. speed: see ``Pace``.

    Attributes:
        stage: what is shown. pace: when its steps are due.
    """

    keys: tuple[Key, ...] = VIEW

    def __init__(self, scenario: Scenario, window: Window, speed: float = 1.0) -> None:
        self.scenario, self.window = scenario, window
        self.pace = Pace(speed)
        self._help: bool | None = None  # whether the keys are shown; where there is room for them
        self.stage = self._begin()

    def _begin(self) -> LiveStage | ReplayStage:
        return LiveStage(Simulation([self.scenario]), self.window.model)

    def play(self) -> None:
        """Go on until the window is closed."""
        while self.window.is_open:
            for code in self.window.pressed(self.pace.rest(self.stage)):
                do = asked(self.keys, code)
                if do is not None:
                    self.act(do)
            self.pace.advance(self.stage)
            if self.pace.draws():
                self.window.show(self.stage.qpos(), self.panels())

    def act(self, do: Do) -> None:
        """Do what a key asks for."""
        pace = self.pace
        if do is Do.HELP:
            self._help = not self.shows_keys
        elif do is Do.PAUSE:
            pace.paused = not pace.paused
        elif do in (Do.TIME_FASTER, Do.TIME_SLOWER):
            pace.faster(1 if do is Do.TIME_FASTER else -1)
        elif do is Do.STEP:
            pace.paused = True
            if self.stage.next_time is not None:
                self.stage.step()
        elif do is Do.RESET:
            self.stage = self._begin()
            pace.anew()

    @property
    def shows_keys(self) -> bool:
        """Whether the panel of the keys is shown: as it was asked for last, and before that where
        it does not lie over the robot."""
        if self._help is not None:
            return self._help
        return not covers_robot(help_lines(self.keys), *self.window.size)

    def panels(self) -> list[tuple[mujoco.mjtGridPos, Lines]]:
        """What stands in the corners of the window."""
        keys = help_lines(self.keys)
        return [
            (_CORNER.mjGRID_TOPLEFT, [*self.stage.status(), ("speed", self._speed())]),
            (_CORNER.mjGRID_BOTTOMLEFT, self.stage.figures()),
            (_CORNER.mjGRID_TOPRIGHT, keys if self.shows_keys else keys[-1:]),
        ]

    def _speed(self) -> str:
        pace = self.pace
        if self.stage.next_time is None:
            return "over"
        if pace.paused:
            return "paused"
        if pace.speed == float("inf"):
            return f"as fast as possible ({pace.reached:.1f} x)"
        late = 0 < pace.reached < 0.9 * pace.speed
        return f"{pace.speed:g} x" + (f" (reached: {pace.reached:.2g} x)" if late else "")


class Replayer(Player):
    """Shows a saved run again."""

    keys = REPLAY

    def __init__(self, result: Result, window: Window, speed: float = 1.0) -> None:
        self._result = result
        super().__init__(result.scenario, window, speed)

    def _begin(self) -> ReplayStage:
        return ReplayStage(self._result, self.window.model)

    def act(self, do: Do) -> None:
        """Do what a key asks for."""
        stage = self.stage
        assert isinstance(stage, ReplayStage)
        leaps = {Do.LEAP: _LEAP, Do.LEAP_BACK: -_LEAP}
        ends = {Do.TO_START: -stage.count, Do.TO_END: stage.count}
        if do is Do.STEP_BACK:
            self.pace.paused = True
            stage.leap(-1)
        elif do in leaps:
            stage.leap_to(stage.time + leaps[do])
        elif do in ends:
            stage.leap(ends[do])
        else:
            super().act(do)
            return
        self.pace.anew()


class Driver(Player):
    """Lets a driver drive a scenario's robot; the scenario's controller is the autopilot.

    Time stands still until the first order is given. The run is over when the driver ends it, when
    the window is closed, or when the robot's run ends as any other.
    """

    keys = DRIVE

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
        """Whether time stands still because no order has been given yet."""
        return self.pace.paused and not self.driven

    @property
    def simulation(self) -> Simulation:
        """What is driven."""
        assert isinstance(self.stage, LiveStage)
        return self.stage.simulation

    @property
    def _controller(self) -> DrivenController:
        assert isinstance(self.simulation.controller, DrivenController)
        return self.simulation.controller

    def act(self, do: Do) -> None:
        """Do what a key asks for."""
        waits = self.waits
        super().act(do)
        if not self.simulation.active[0] or (waits and do is Do.FINISH):
            if do is Do.FINISH:
                self.window.close()
            return
        # The last order that there is room for ends the run.
        full = len(self._controller.orders()) >= MOST_ORDERS - 1
        order = self._wheel.press(Do.FINISH if full else do, self._pose())
        if order is not None:
            self._controller.give(order)
            self.pace.paused &= not waits
        if do is Do.FINISH:
            self.window.close()

    def _pose(self) -> Pose:
        rotation = self.simulation.readings["rotation"][0]
        return Pose(
            time=self.stage.time,
            nose=rotation[:, 2],
            roll_deg=float(np.degrees(self._controller.roll[0, 0])),
            towards=self.window.towards,
        )

    @property
    def driven(self) -> bool:
        """Whether the driver has asked for anything."""
        return bool(self._controller.orders())

    def result(self) -> Result:
        """The run as it was driven, ended here if it is not over. Its scenario holds the orders,
        and repeats it to the same bytes."""
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
        """What stands in the corners of the window."""
        return [*super().panels(), (_CORNER.mjGRID_BOTTOMRIGHT, self._orders())]

    def _orders(self) -> Lines:
        """What the driver asks for."""
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
