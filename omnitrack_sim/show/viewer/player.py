"""Players of runs in a window, in step with wall time: of a simulation as it runs, of a saved run,
of a driven robot, whose keys become orders."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from omnitrack_sim.base.bounds import MAX_ORDERS
from omnitrack_sim.base.rotations import (
    Array,
    heading,
    matrix_from_quaternion,
    rotation_about,
    unit,
)
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.display import Lines, Moment
from omnitrack_sim.results.provenance import provenance_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.driving import ObeysOrders, Order
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.loading import to_drive, with_orders
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.viewer.keys import DRIVE, REPLAY, VIEW, Do, Key, action_of, help_lines
from omnitrack_sim.show.viewer.window import Window, covers_robot
from omnitrack_sim.sim.run import no_load_slips
from omnitrack_sim.sim.simulation import Simulation

LADDER = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0, 8.0, 16.0, math.inf)
"""Speeds that can be chosen, simulated over wall seconds; the last one is as fast as possible."""
FRAME = 1 / 30
"""Wall time between two pictures, s."""
LATE_FRAME = 0.25
"""The same while steps are overdue, s."""
STINT = 0.1
"""Wall time that steps may take before keys are looked at again, s."""
MOST_OVERDUE = 0.5
"""Largest delay of steps, s of wall time; beyond it simulated time falls behind."""
_MEASURED = 1.0  # s of wall time over which the reached speed is measured
_ROUNDING = 1e-9  # s


class Pace:
    """Takes the steps that are due, and says when to draw and how long to sleep.

    Steps come first: while some are overdue there are fewer pictures. What the machine cannot make
    up for is given up, so that simulated time falls behind and does not hurry afterwards.

    Args:
        speed: simulated over wall seconds; infinite: as fast as possible.
        clock: wall time, s.

    Attributes:
        speed: as above.
        paused: no steps are due.
        reached: the speed of the last second.
        overdue: steps are late.
    """

    def __init__(self, speed: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        self.speed, self.paused, self._clock = speed, False, clock
        self.reached, self.overdue = 0.0, False
        self._from: tuple[float, float] | None = None  # wall and simulated time, s, in step
        self._drawn = -math.inf
        self._mark: tuple[float, float] | None = None

    def anew(self) -> None:
        """Count from now on: after a leap, a pause, another speed."""
        self._from = self._mark = None
        self.overdue = False

    def faster(self, steps: int) -> None:
        """The speed that is ``steps`` further up the ladder, or down it."""
        nearest = min(
            range(len(LADDER)), key=lambda i: abs(self._log(LADDER[i]) - self._log(self.speed))
        )
        self.speed = LADDER[min(max(nearest + steps, 0), len(LADDER) - 1)]
        self.anew()

    @staticmethod
    def _log(speed: float) -> float:
        # The infinite speed is one rung above the fastest finite one.
        return min(math.log2(speed), math.log2(LADDER[-2]) + 1)

    def advance(self, run: LiveRun | SavedRun) -> None:
        """Take the steps that are due by now."""
        now = self._clock()
        if self.paused or run.next_time is None:
            self.anew()
            return
        if self._from is None:
            self._from = self._mark = (now, run.time)
        wall, simulated = self._from
        due = simulated + (now - wall) * self.speed if now > wall else simulated
        while run.next_time is not None and run.next_time <= due + _ROUNDING:
            run.step()
            if self._clock() > now + STINT:
                break
        self.overdue = run.next_time is not None and run.next_time <= due + _ROUNDING
        # Without this a slow stretch would be followed by a rush.
        if self.overdue and (due - run.time) / self.speed > MOST_OVERDUE:
            self._from = (self._clock(), run.time)
        self._measure(run.time)

    def _measure(self, simulated: float) -> None:
        now = self._clock()
        if self._mark is None:
            self._mark = (now, simulated)
        wall, before = self._mark
        if now - wall >= _MEASURED:
            self.reached, self._mark = (simulated - before) / (now - wall), (now, simulated)

    def draws(self) -> bool:
        """Return True if a picture is due; the next one is then due a frame later."""
        now = self._clock()
        if now - self._drawn < (LATE_FRAME if self.overdue else FRAME) - _ROUNDING:
            return False
        self._drawn = now
        return True

    def rest(self, run: LiveRun | SavedRun) -> float:
        """Return the time, s, in which nothing will be due; a key may come before."""
        if self.overdue:
            return 0.0
        now = self._clock()
        left = self._drawn + FRAME - now
        if self._from is not None and run.next_time is not None and not self.paused:
            wall, simulated = self._from
            left = min(left, wall + (run.next_time - simulated) / self.speed - now)
        return max(left, 0.0)


SPEED_STEPS = 4
"""Presses from standing still to the cruise speed."""
HEADING_STEP = math.radians(15.0)
"""Change of the heading by one press, rad."""
FARTHEST_HEADING = math.radians(120.0)
"""Angle of the heading from the nose beyond which no press takes it, rad: past half a turn the
robot would turn the other way round."""
ROLL_STEP_DEG = 15.0
"""Change of the modules' roll by one press, degrees; the robot turns by at most a third of it."""
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


class ShownRun:
    """A run of one robot at one moment, in words and figures."""

    scenario: Scenario
    routes: RouteMap

    @property
    def time(self) -> float:
        """Simulated time, s."""
        raise NotImplementedError

    @property
    def location(self) -> Location:
        """Location of the robot, as of a batch of one."""
        raise NotImplementedError

    def value(self, channel: str) -> Array:
        """Return a channel's value at the moment."""
        raise NotImplementedError

    def place(self) -> Lines:
        """Return where the robot is."""
        location = self.location
        route, distance = self.routes.routes[int(location.route[0])], float(location.distance[0])
        passages = route.passages
        passage = next((p for p in passages if distance < p.s_leave), passages[-1])
        return [
            ("in", route.network.parts[passage.index].name),
            ("travelled", f"{distance:.3f} of {route.centreline.length:.3f} m"),
            ("tilt", f"{np.degrees(location.tilt[0]):.1f} deg"),
        ]

    def figures(self) -> Lines:
        """Return figures of the robot at the moment."""
        moment = Moment(self.time, "", "", self.value)
        return self.scenario.robot.display.measurements(moment, self.routes, self.location)


class LiveRun(ShownRun):
    """A simulation of one robot, shown in the model with visual geoms. Only ``Simulation.step``
    advances it, so the window shows what ``omnitrack run`` computes."""

    def __init__(self, simulation: Simulation, model: mujoco.MjModel) -> None:
        self.simulation = simulation
        self.scenario, self.routes = simulation.scenarios[0], simulation.legs.routes
        self._model, self._display = model, self.scenario.robot.display
        self._travel = np.zeros(len({track.column for track in self._display.tracks.values()}))

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self.simulation.time[0])

    @property
    def next_time(self) -> float | None:
        """The time after the next step, s; None when the run is over."""
        return self.time + self.simulation.period if self.simulation.active[0] else None

    @property
    def location(self) -> Location:
        """See ``ShownRun``."""
        return self.simulation.location

    def value(self, channel: str) -> Array:
        """See ``ShownRun``."""
        return self.simulation.readings[channel][0]

    def step(self) -> None:
        """Take one control step."""
        self.simulation.step()
        if self._display.track_speed:
            self._travel += self.value(self._display.track_speed) * self.simulation.period

    def qpos(self) -> Array:
        """Return the joint positions (nq,) as they are shown."""
        qpos = np.array(self.simulation.plant.qpos[0])
        self._display.place_tracks(self._model, qpos, self._travel)
        return qpos

    def status(self) -> Lines:
        """Return time, phase, outcome and place."""
        ending = self.simulation.endings[0]
        return [
            ("time", f"{self.time:.2f} s"),
            ("phase", self.simulation.phase[0].replace("_", " ")),
            ("outcome", "runs" if ending is None else ending.outcome.value),
            *self.place(),
        ]


class SavedRun(ShownRun):
    """A saved run of ``count`` samples, of which sample ``row`` is shown."""

    def __init__(self, result: Result, model: mujoco.MjModel) -> None:
        self._result, self.row, self.scenario = result, 0, result.scenario
        self._trajectory = RunPlayback(result).trajectory
        self.count = len(self._trajectory.time)
        self._qpos = self.scenario.robot.display.poses(model, self._trajectory)
        self.routes = RouteMap(result.routes())

    @property
    def time(self) -> float:
        """Time of the sample, s."""
        return float(self._trajectory.time[self.row])

    @property
    def next_time(self) -> float | None:
        """Time of the next sample, s; None at the end."""
        last = self.row + 1 >= self.count
        return None if last else float(self._trajectory.time[self.row + 1])

    @property
    def location(self) -> Location:
        """See ``ShownRun``."""
        one = {name: values[self.row : self.row + 1] for name, values in self._trajectory.items()}
        frame = heading(matrix_from_quaternion(one["quaternion"]), one["gear"].astype(int))
        leg = one["leg"].astype(np.intp)
        return self.routes.locate(one["position"], frame, leg, one["distance"])

    def value(self, channel: str) -> Array:
        """See ``ShownRun``."""
        return self._trajectory[channel][self.row]

    def step(self) -> None:
        """Go on to the next sample."""
        self.leap(1)

    def leap(self, samples: int) -> None:
        """Go on or back by some samples, as far as there are any."""
        self.row = min(max(self.row + samples, 0), self.count - 1)

    def leap_to(self, time: float) -> None:
        """Go to the first sample that is not before ``time`` s, or to the last one."""
        self.row = min(int(np.searchsorted(self._trajectory.time, time - 1e-9)), self.count - 1)

    def qpos(self) -> Array:
        """Return the joint positions (nq,) as they are shown."""
        return self._qpos[self.row]

    def status(self) -> Lines:
        """Return time, phase, outcome and place."""
        trajectory = self._trajectory
        driver = self._result.provenance.get("driven_by")
        return [
            ("time", f"{self.time:.2f} of {trajectory.time[-1]:.2f} s"),
            ("phase", trajectory.phases[int(trajectory["phase"][self.row])].replace("_", " ")),
            ("outcome", self._result.outcome.value),
            *([("driven by", str(driver))] if driver is not None else []),
            *self.place(),
        ]


DRIVER = "keyboard"
"""Driver in the provenance of a driven run."""
_LEAP = 1.0  # s
_CORNER = mujoco.mjtGridPos


class Player:
    """Shows a scenario in an open window as it runs under its controller, at a speed of
    ``Pace``."""

    keys: tuple[Key, ...] = VIEW

    def __init__(self, scenario: Scenario, window: Window, speed: float = 1.0) -> None:
        self.scenario, self.window = scenario, window
        self.pace = Pace(speed)
        self._help: bool | None = None  # whether the keys are shown; where there is room for them
        self.run = self._begin()

    def _begin(self) -> LiveRun | SavedRun:
        return LiveRun(Simulation([self.scenario]), self.window.model)

    def play(self) -> None:
        """Run until the window is closed."""
        while self.window.is_open:
            for code in self.window.pressed(self.pace.rest(self.run)):
                do = action_of(self.keys, code)
                if do is not None:
                    self.act(do)
            self.pace.advance(self.run)
            if self.pace.draws():
                self.window.show(self.run.qpos(), self.panels())

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
            if self.run.next_time is not None:
                self.run.step()
        elif do is Do.RESET:
            self.run = self._begin()
            pace.anew()

    @property
    def shows_keys(self) -> bool:
        """True if the panel of the keys is shown: as it was asked for last, and before that where
        it does not lie over the robot."""
        if self._help is not None:
            return self._help
        return not covers_robot(help_lines(self.keys), *self.window.size)

    def panels(self) -> list[tuple[mujoco.mjtGridPos, Lines]]:
        """Return the panels in the corners of the window."""
        keys = help_lines(self.keys)
        return [
            (_CORNER.mjGRID_TOPLEFT, [*self.run.status(), ("speed", self._speed())]),
            (_CORNER.mjGRID_BOTTOMLEFT, self.run.figures()),
            (_CORNER.mjGRID_TOPRIGHT, keys if self.shows_keys else keys[-1:]),
        ]

    def _speed(self) -> str:
        pace = self.pace
        if self.run.next_time is None:
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

    def _begin(self) -> SavedRun:
        return SavedRun(self._result, self.window.model)

    def act(self, do: Do) -> None:
        """Do what a key asks for."""
        run = self.run
        assert isinstance(run, SavedRun)
        leaps = {Do.LEAP: _LEAP, Do.LEAP_BACK: -_LEAP}
        ends = {Do.TO_START: -run.count, Do.TO_END: run.count}
        if do is Do.STEP_BACK:
            self.pace.paused = True
            run.leap(-1)
        elif do in leaps:
            run.leap_to(run.time + leaps[do])
        elif do in ends:
            run.leap(ends[do])
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
        """True while time stands still because no order has been given yet."""
        return self.pace.paused and not self.driven

    @property
    def simulation(self) -> Simulation:
        """Simulation of the driven robot."""
        assert isinstance(self.run, LiveRun)
        return self.run.simulation

    @property
    def _controller(self) -> ObeysOrders:
        assert isinstance(self.simulation.controller, ObeysOrders)
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
        """Return the panels in the corners of the window."""
        return [*super().panels(), (_CORNER.mjGRID_BOTTOMRIGHT, self._orders())]

    def _orders(self) -> Lines:
        """Return the orders of the driver."""
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
