"""Players of runs in a window: of a simulation as it runs, and of a saved run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

import mujoco
import numpy as np

from omnitrack_sim.base.rotations import Array, heading, matrix_from_quaternion
from omnitrack_sim.pipes.route_map import Location, RouteMap
from omnitrack_sim.record.display import Lines, Moment
from omnitrack_sim.results.result import Result
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.show.run_playback import RunPlayback
from omnitrack_sim.show.viewer.keys import REPLAY, VIEW, Do, Key, action_of, help_lines
from omnitrack_sim.show.viewer.pace import Pace
from omnitrack_sim.show.viewer.window import Window, covers_robot
from omnitrack_sim.sim.simulation import Simulation

LEAP = 1.0
"""Time that a leap goes on or back, s."""
_CORNER = mujoco.mjtGridPos


class ShownRun:
    """Base class: a run of one robot at one moment.

    Attributes:
        scenario: of the run.
        routes: of its legs.
        outcome: how it ended, in words; "runs" before that.
        driver: who drove, where that was no controller.
    """

    scenario: Scenario
    routes: RouteMap
    driver: str | None = None

    @property
    def time(self) -> float:
        """Simulated time, s."""
        raise NotImplementedError

    @property
    def next_time(self) -> float | None:
        """Time after the next step, s; None at the end."""
        raise NotImplementedError

    @property
    def phase(self) -> str:
        """Phase of the controller."""
        raise NotImplementedError

    @property
    def outcome(self) -> str:
        """How the run ended, in words; "runs" before that."""
        raise NotImplementedError

    @property
    def location(self) -> Location:
        """Location of the robot, as of a batch of one."""
        raise NotImplementedError

    def value(self, channel: str) -> Array:
        """Return a channel's value at the moment."""
        raise NotImplementedError

    def qpos(self) -> Array:
        """Return the joint positions (nq,) as they are shown."""
        raise NotImplementedError

    def step(self) -> None:
        """Go on by one step."""
        raise NotImplementedError

    def time_text(self) -> str:
        """Return the time in words."""
        return f"{self.time:.2f} s"

    def status(self) -> Lines:
        """Return time, phase, outcome and place."""
        location = self.location
        route, distance = self.routes.routes[int(location.route[0])], float(location.distance[0])
        passages = route.passages
        passage = next((p for p in passages if distance < p.s_leave), passages[-1])
        return [
            ("time", self.time_text()),
            ("phase", self.phase.replace("_", " ")),
            ("outcome", self.outcome),
            *([] if self.driver is None else [("driven by", self.driver)]),
            ("in", route.network.parts[passage.index].name),
            ("travelled", f"{distance:.3f} of {route.centreline.length:.3f} m"),
            ("tilt", f"{np.degrees(location.tilt[0]):.1f} deg"),
        ]

    def measurements(self) -> Lines:
        """Return what the robot measures at the moment."""
        moment = Moment(self.time, self.phase, "", self.value)
        return self.scenario.robot.display.measurements(moment, self.routes, self.location)


class LiveRun(ShownRun):
    """A simulation of one robot, which only ``Simulation.step`` advances, as ``omnitrack run``."""

    def __init__(self, simulation: Simulation, model: mujoco.MjModel) -> None:
        self.simulation = simulation
        self.scenario, self.routes = simulation.scenarios[0], simulation.legs.routes
        self._model, self._display = model, self.scenario.robot.display
        self._travel = np.zeros(len({track.column for track in self._display.tracks.values()}))

    @property
    def time(self) -> float:
        """See ``ShownRun``."""
        return float(self.simulation.time[0])

    @property
    def next_time(self) -> float | None:
        """See ``ShownRun``."""
        return self.time + self.simulation.period if self.simulation.active[0] else None

    @property
    def phase(self) -> str:
        """See ``ShownRun``."""
        return self.simulation.phase[0]

    @property
    def outcome(self) -> str:
        """See ``ShownRun``."""
        ending = self.simulation.endings[0]
        return "runs" if ending is None else ending.outcome.value

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
        """See ``ShownRun``."""
        qpos = np.array(self.simulation.plant.qpos[0])
        self._display.place_tracks(self._model, qpos, self._travel)
        return qpos


class SavedRun(ShownRun):
    """A saved run.

    Attributes:
        row: sample that is shown.
        count: number of samples.
    """

    def __init__(self, playback: RunPlayback, result: Result) -> None:
        self._playback, self.row, self.scenario = playback, 0, result.scenario
        self.count = len(playback.time)
        self.routes = RouteMap(result.routes())
        self._outcome = result.outcome.value
        driver = result.provenance.get("driven_by")
        self.driver = None if driver is None else str(driver)

    @property
    def time(self) -> float:
        """See ``ShownRun``."""
        return float(self._playback.time[self.row])

    @property
    def next_time(self) -> float | None:
        """See ``ShownRun``."""
        last = self.row + 1 >= self.count
        return None if last else float(self._playback.time[self.row + 1])

    def time_text(self) -> str:
        """Return the time and the end of the run."""
        return f"{self.time:.2f} of {self._playback.time[-1]:.2f} s"

    @property
    def phase(self) -> str:
        """See ``ShownRun``."""
        return self._playback.moment(self.row).phase

    @property
    def outcome(self) -> str:
        """See ``ShownRun``."""
        return self._outcome

    @property
    def location(self) -> Location:
        """See ``ShownRun``."""
        rows, record = slice(self.row, self.row + 1), self._playback.trajectory
        one = {name: values[rows] for name, values in record.items()}
        frame = heading(matrix_from_quaternion(one["quaternion"]), one["gear"].astype(int))
        leg = one["leg"].astype(np.intp)
        return self.routes.locate(one["position"], frame, leg, one["distance"])

    def value(self, channel: str) -> Array:
        """See ``ShownRun``."""
        return self._playback.trajectory[channel][self.row]

    def qpos(self) -> Array:
        """See ``ShownRun``."""
        return self._playback.qpos[self.row]

    def step(self) -> None:
        """Go on to the next sample."""
        self.leap(1)

    def leap(self, samples: int) -> None:
        """Go on or back by some samples, as far as there are any."""
        self.row = min(max(self.row + samples, 0), self.count - 1)

    def leap_to(self, time: float) -> None:
        """Go to the first sample that is not before ``time`` s, or to the last one."""
        self.row = min(int(np.searchsorted(self._playback.time, time - 1e-9)), self.count - 1)


class Player:
    """Player of a scenario as it runs under its controller, in an open window.

    Args:
        scenario: that runs.
        window: on its pipes and robot.
        speed: simulated over wall seconds; infinite: as fast as possible.

    Attributes:
        keys: that it obeys.
        pace: of its steps.
        run: that is shown.
    """

    keys: tuple[Key, ...] = VIEW

    def __init__(self, scenario: Scenario, window: Window, speed: float = 1.0) -> None:
        self.scenario, self.window = scenario, window
        self.pace = Pace(speed)
        self._help: bool | None = None  # whether the keys are shown; where there is room for them
        self.run = self._begin()

    def _begin(self) -> ShownRun:
        """Return the run at its start."""
        return LiveRun(Simulation([self.scenario]), self.window.model)

    def play(self) -> None:
        """Run until the window is closed."""
        while self.window.is_open:
            for code in self.window.pressed(self.pace.rest(self.run)):
                do = action_of(self.keys, code)
                if do is not None:
                    self.act(do)
            self.pace.advance(self.run)
            if self.pace.begin_frame():
                self.window.show(self.run.qpos(), self.panels())

    def act(self, do: Do) -> None:
        """Do what a key asks for, if that is in ``actions``."""
        if do in (actions := self.actions()):
            actions[do]()

    def actions(self) -> Mapping[Do, Callable[[], None]]:
        """Return what it does for each key."""
        return {
            Do.PAUSE: self._pause,
            Do.STEP: self._step,
            Do.RESET: self._reset,
            Do.TIME_FASTER: partial(self.pace.faster, 1),
            Do.TIME_SLOWER: partial(self.pace.faster, -1),
            Do.HELP: self._toggle_help,
        }

    def _pause(self) -> None:
        self.pace.paused = not self.pace.paused

    def _step(self) -> None:
        self.pace.paused = True
        if self.run.next_time is not None:
            self.run.step()

    def _reset(self) -> None:
        self.run = self._begin()
        self.pace.anew()

    def _toggle_help(self) -> None:
        self._help = not self.shows_keys

    @property
    def shows_keys(self) -> bool:
        """True if the panel of the keys is shown.

        It is as it was asked for last, and before that where it does not lie over the robot.
        """
        if self._help is not None:
            return self._help
        return not covers_robot(help_lines(self.keys), *self.window.size)

    def panels(self) -> list[tuple[mujoco.mjtGridPos, Lines]]:
        """Return the panels in the corners of the window."""
        keys = help_lines(self.keys)
        return [
            (_CORNER.mjGRID_TOPLEFT, [*self.run.status(), ("speed", self._speed())]),
            (_CORNER.mjGRID_BOTTOMLEFT, self.run.measurements()),
            (_CORNER.mjGRID_TOPRIGHT, keys if self.shows_keys else keys[-1:]),
        ]

    def _speed(self) -> str:
        """Return the speed of time in words."""
        pace = self.pace
        if self.run.next_time is None:
            return "over"
        if pace.paused:
            return "paused"
        if pace.speed == math.inf:
            return f"as fast as possible ({pace.reached:.1f} x)"
        late = 0 < pace.reached < 0.9 * pace.speed
        return f"{pace.speed:g} x" + (f" (reached: {pace.reached:.2g} x)" if late else "")


class Replayer(Player):
    """Player of a saved run."""

    keys = REPLAY
    run: SavedRun

    def __init__(self, result: Result, window: Window, speed: float = 1.0) -> None:
        self._result, self._playback = result, RunPlayback(result)
        super().__init__(result.scenario, window, speed)

    def _begin(self) -> SavedRun:
        return SavedRun(self._playback, self._result)

    def actions(self) -> Mapping[Do, Callable[[], None]]:
        """Return what it does for each key."""
        run = self.run
        leaps = {
            Do.STEP_BACK: partial(run.leap, -1),
            Do.LEAP: partial(run.leap_to, run.time + LEAP),
            Do.LEAP_BACK: partial(run.leap_to, run.time - LEAP),
            Do.TO_START: partial(run.leap, -run.count),
            Do.TO_END: partial(run.leap, run.count),
        }
        return {**super().actions(), **{do: partial(self._leap, go) for do, go in leaps.items()}}

    def _leap(self, go: Callable[[], None]) -> None:
        go()
        self.pace.anew()
