"""The loop, opened: n robots of one model, every one a control step on at each call of ``step``."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from omnitrack_sim.autonomy.ahead import Look, Sight
from omnitrack_sim.autonomy.judged_sight import JudgedSight
from omnitrack_sim.base.arguments import check_all, check_is
from omnitrack_sim.base.rotations import Array, heading
from omnitrack_sim.base.text import shown
from omnitrack_sim.pipes.route_map import Location
from omnitrack_sim.record.channels import CHANNELS, Channel
from omnitrack_sim.record.events import Event, Note, Outcome
from omnitrack_sim.record.metrics import ESTIMATES, Metric
from omnitrack_sim.results.pictures import Album, coding_of
from omnitrack_sim.results.result import Result
from omnitrack_sim.robots.omnitrack.control import (
    Command,
    Controller,
    ControlSetup,
    Observation,
    Settings,
)
from omnitrack_sim.robots.omnitrack.control.gear import carried_out, seen
from omnitrack_sim.robots.omnitrack.drive import SpeedLoop, drive_of
from omnitrack_sim.scenario import Scenario
from omnitrack_sim.scenario.model import METRIC_NAMES, refuse_taken
from omnitrack_sim.senses import SENSORS, Sensor, State
from omnitrack_sim.sim.builder import (
    scene_of,
    settings_of,
    start_of,
)
from omnitrack_sim.sim.gathering import gathered
from omnitrack_sim.sim.legs import Legs, Onward
from omnitrack_sim.sim.monitor import Monitor, Verdict
from omnitrack_sim.sim.plant import Plant, Start
from omnitrack_sim.sim.recorder import Recorder

if TYPE_CHECKING:
    from omnitrack_sim.sim.onboard import Onboard

Progress = Callable[[float, str], None]
"""Called with the part done, 0 to 1, and a word about the run."""
MakePlant = Callable[[Scenario, Start, int], Plant]
"""Makes a plant from the first scenario of a batch, the start values of all, and the number of
threads."""
REPORT_EVERY = 50
"""Control steps between two reports of progress."""


@dataclass(frozen=True)
class Ending:
    """How one robot's run ended."""

    outcome: Outcome
    reason: str


class Simulation:
    """n robots of one model in closed loop.

    ::

        sim = ot.Simulation([scenario] * 64)
        while sim.active.any():
            command = ...  # made from sim.observation
            sim.step(command)
        results = sim.results()

    Args:
        scenarios: at least one; they share pipes, robot and clock, see ``builder.batch_key``.
        controller: a class in the place of the scenarios' own; see ``ot.Controller``.
        sensors: further ones; their channels are observed and recorded as the shipped ones are.
        threads: native threads for the physics; 0 uses all cores. The results do not depend on it.
        make_plant: puts another plant in the place of the scenarios' own: other walls, another
            engine.
        recording: without it nothing is kept, however long it runs; there are no results then, and
            robots can begin anew, see ``restart``.

    Raises:
        TypeError: an argument is of another type.
        ValueError: there are no scenarios.

    Attributes:
        scenarios: as given.
        n: their number.
        period: s between two control steps.
        controller: made for these robots.
        active: (n,) bool, robots whose run is not over.
        observation: what the robots measure now.
        setup: what the controller was made from, with the settings of the runs at hand.
        endings: how each robot's run ended; None while it runs.
        end_time: (n,) s. events: what there is to tell of each robot.
        legs: what they drive. plant, motors, monitor, recorder: the parts of the loop.
        sights: what tells each robot that explores what is ahead; None for those that do not.
        album: the pictures that robots have taken; None where they are not recorded.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        *,
        controller: type[Controller] | None = None,
        sensors: Sequence[Sensor] = (),
        threads: int = 1,
        make_plant: MakePlant | None = None,
        recording: bool = True,
    ):
        scenarios = check_all(Scenario, "scenarios", scenarios)
        if not scenarios:
            raise ValueError("scenarios: is empty; a simulation is of one robot at least")
        self.scenarios = [s if controller is None else s.driven_by(controller) for s in scenarios]
        first, self.n = self.scenarios[0], len(self.scenarios)
        self.period, self._recording = first.physics.control_period, recording
        self._substeps = max(1, round(self.period / first.physics.timestep))
        self._record_every = max(1, round(first.record.period / self.period))
        self.legs = Legs(self.scenarios)
        start = start_of(self.scenarios, self.legs.routes, self.legs.route)
        settings, notes = settings_of(self.scenarios, self.legs.routes, self.legs.route)
        sensors = (*first.own_sensors, *check_all(Sensor, "sensors", sensors))
        refuse_taken("sensors", [sensor.channel.name for sensor in sensors], CHANNELS)
        every = (*SENSORS, *sensors)
        self.channels: tuple[Channel, ...] = (
            *CHANNELS.values(),
            *(sensor.channel for sensor in sensors),
            *(ESTIMATES if first.sensing.kind == "onboard" else ()),
        )
        self.plant = (
            Plant(scene_of(first).compile(), first.robot, start, threads, every)
            if make_plant is None
            else make_plant(first, start, threads)
        )
        limits = [s.robot.motor.torque_limit for s in self.scenarios]
        drive, motor = drive_of(first.robot.drive), first.robot.motor
        self.motors = SpeedLoop(drive, motor, limits, first.robot.lug_radius, self.n)
        self.active = np.ones(self.n, bool)
        self._begin(settings, start, sensors)
        self.endings: list[Ending | None] = [None] * self.n
        self.events: list[list[Event]] = [self._noted(i, note) for i, note in enumerate(notes)]
        self.end_time: Array = np.full(self.n, np.nan)
        self._tick = 0
        self._begun = np.zeros(self.n, int)  # ticks at which the runs at hand began
        self._settle()

    def __repr__(self) -> str:
        names = ", ".join(dict.fromkeys(scenario.name for scenario in self.scenarios))
        running = f"{np.count_nonzero(self.active)} of {self.n} robots run"
        return f"Simulation({running}, at {self.time.max():.6g} s: {shown(names)})"

    def _begin(self, settings: Settings, start: Start, sensors: Sequence[Sensor]) -> None:
        """Make the parts that need the first place: controller, monitor, recorder."""
        first, robot = self.scenarios[0], self.scenarios[0].robot
        readings = self.plant.read()
        for channel in (sensor.channel for sensor in sensors):
            value, shape = readings[channel.name], (self.n, *channel.shape)
            if np.shape(value) != shape:
                raise ValueError(f"sensor {channel.name!r} reads {np.shape(value)}, not {shape}")
        self._near = self.legs.near
        self.onboard = self._senses(readings)
        self._readings = readings
        self._find()
        self.sights = self._made_sights()
        self.setup = ControlSetup(
            routes=self.legs.routes,
            robot=robot,
            settings=settings,
            parameters=[s.control_parameters for s in self.scenarios],
            location=self._believed,
            roll=start.roll,
            period=self.period,
            gravity=start.gravity,
        )
        self.controller: Controller = first.controller_class(self.setup)
        self.phases: tuple[str, ...] = getattr(self.controller, "phases", ("drive",))
        limits = np.array([s.time_limit_s for s in self.scenarios])
        self.monitor = Monitor(
            self.legs.routes,
            robot,
            first.monitor,
            np.array([s.start.distance for s in self.scenarios]),
            settings.cruise_speed,
            limits,
            self.period,
            self.period * self._record_every,
        )
        schema = {c.name: c for c in self.channels if c.recorded}
        self.recorder = Recorder(self.phases, schema)
        self.album: Album | None = None
        if self.onboard is not None and first.record.pictures:
            self.album = Album(coding_of(self.onboard.camera), self.n)
            self._keep_picture()
        self._measured = ["time", *(c.name for c in schema.values() if c.source == "plant")]
        self._belt_command, self._roll_command = np.zeros((self.n, 3)), start.roll.copy()
        self._phase, self._nobody = np.zeros(self.n, int), np.zeros(self.n, bool)
        self._resting, self._over, self._brake = self._nobody, self._nobody, None
        self._gave_up = self._nobody

    def _noted(self, robot: int, note: str | None) -> list[Event]:
        """The remarks with which a robot's run begins."""
        return [] if note is None else [Note(robot, 0.0, note)]

    @property
    def observation(self) -> Observation:
        """What the robots measure now, as their controllers see it."""
        gear = self.legs.gear
        told, channels = self._readings, self.channels
        if self.onboard is not None:
            told = self.onboard.readings
            channels = tuple(channel for channel in channels if channel.name in told)
        readings = seen(told, gear, channels)
        return Observation(readings, self._believed, self.legs.number, gear)

    @property
    def readings(self) -> Mapping[str, Array]:
        """What the robots measure now, each in its own frame whatever its gear, by the names of the
        channels."""
        return self._readings

    @property
    def location(self) -> Location:
        """Where the robots are along their routes."""
        return self._location

    @property
    def phase(self) -> list[str]:
        """The phase of each robot."""
        return [self.phases[code] for code in self._phase]

    @property
    def time(self) -> Array:
        """Simulated time (n,) s."""
        return self._readings["time"]

    def step(self, command: Command | None = None) -> None:
        """Carry out a command for one control period; robots whose run is over stay as they are.

        Args:
            command: for all n robots; the controller's own when not given.

        Raises:
            TypeError: it is no ``Command``.
            ValueError: an array of the command has the wrong shape.
        """
        where = "command"
        if command is None:
            command = self.controller.step(self.observation)
            where = f"what {type(self.controller).__name__}.step returns"
        check_is(Command, where, command)
        if command.brake is not None and not self.plant.robot.brake_force and np.any(command.brake):
            raise ValueError("command.brake is given to a robot whose robot.brake_force is 0")
        command = self._guarded(command.checked(self.n))
        self._take(carried_out(command, self.legs.gear))
        readings = self._readings
        motors = self.motors.advance(
            self._belt_command, readings["belt_speed"], readings["motor_torque"], self.period
        )
        self.plant.step(self.active, motors, self._roll_command, self._substeps, self._brake)
        self._tick += 1
        self._readings = self.plant.read()
        if self.onboard is not None:
            self.onboard.look(self._readings, self.legs.gear, self._believed, self.active)
            self._keep_picture()
        self._find()
        self._settle()

    def _guarded(self, command: Command) -> Command:
        """A command, less what robots that do not know where they are may not do."""
        if self.onboard is None:
            return command
        guarded = self.onboard.guarded(command, self._believed, self.observation.roll)
        self._gave_up = guarded.given_up
        told = [event for event in command.events if not guarded.searching[event.robot]]
        return guarded.command._replace(events=[*told, *guarded.events])

    def restart(self, robots: Sequence[int] | NDArray, scenarios: Sequence[Scenario]) -> None:
        """Have robots begin new runs, each to the bytes of a simulation of its own; the others are
        left as they are. The controller is not told: who calls this gives the commands.

        Args:
            robots: their numbers, k, ascending.
            scenarios: what each runs now, k of the same ``builder.batch_key``, which is not
                checked here.

        Raises:
            RuntimeError: the simulation records, or its robots explore.
        """
        if self._recording or self.scenarios[0].exploration is not None:
            raise RuntimeError("restart is for robots that do not explore, and are not recorded")
        which = np.asarray(robots, np.intp)
        for robot, scenario in zip(which.tolist(), scenarios, strict=True):
            self.scenarios[robot], self.endings[robot] = scenario, None
        self.legs.restart(which, scenarios)
        routes, route = self.legs.routes, self.legs.route[which]
        start = start_of(scenarios, routes, route)
        settings, notes = settings_of(scenarios, routes, route)
        for robot, note in zip(which.tolist(), notes, strict=True):
            self.events[robot] = self._noted(robot, note)
        self._restart_parts(which, scenarios, start, settings)
        self._readings = readings = self.plant.read()
        if self.onboard is not None:
            limits = self.motors.torque_limit[which, 0]
            self.onboard.restart(which, scenarios, readings, limits)
        self._find()
        gravity, parameters = self.setup.gravity.copy(), list(self.setup.parameters)
        gravity[which] = start.gravity
        for robot, scenario in zip(which.tolist(), scenarios, strict=True):
            parameters[robot] = scenario.control_parameters
        self.setup = replace(
            self.setup,
            settings=self.setup.settings.with_rows(which, settings),
            parameters=parameters,
            location=self._believed,
            roll=self._roll_command.copy(),
            gravity=gravity,
        )
        begun = np.zeros(self.n, bool)
        begun[which] = True
        self._average(begun)
        self.monitor.first_look(which, self._believed.distance)

    def _restart_parts(
        self,
        robots: NDArray[np.intp],
        scenarios: Sequence[Scenario],
        start: Start,
        settings: Settings,
    ) -> None:
        """Put all that is kept for ``robots`` (k,) back to the start of ``scenarios`` (k)."""
        self.plant.restart(robots, start)
        limits = np.array([s.robot.motor.torque_limit for s in scenarios])
        self.motors.restart(robots, limits)
        distance = np.array([s.start.distance for s in scenarios])
        time_limit = np.array([s.time_limit_s for s in scenarios])
        self.monitor.restart(robots, distance, settings.cruise_speed, time_limit)
        self.active, self._near = self.active.copy(), self._near.copy()
        self._belt_command, self._roll_command = (
            self._belt_command.copy(),
            self._roll_command.copy(),
        )
        self._belt_command[robots], self._roll_command[robots] = 0.0, start.roll
        self._near[robots] = self.legs.near[robots]
        self.active[robots], self.end_time[robots] = True, np.nan
        self._begun[robots], self._phase[robots] = self._tick, 0

    def advance(self, progress: Progress | None = None) -> None:
        """Run all robots to their ends under their controller."""
        while self.active.any():
            self.step()
            if progress is not None and self._tick % REPORT_EVERY == 0:
                self._report(progress)

    def _take(self, command: Command) -> None:
        """Keep what is asked of the robots that still run."""
        speed, roll, phase, resting, _, brake, over = command
        roll = self._roll_command if roll is None else roll
        phase = self._phase if phase is None else phase
        if np.count_nonzero(self.active) < self.n:
            each, active = self.active[:, None], self.active
            speed = np.where(each, speed, self._belt_command)
            roll = np.where(each, roll, self._roll_command)
            phase = np.where(active, phase, self._phase)
        # Copies: whoever made the command may write into its arrays again.
        self._belt_command, self._roll_command = speed.copy(), roll.copy()
        self._phase = phase.copy()
        self._resting = self._nobody if resting is None else resting
        self._over = self._nobody if over is None else over
        self._brake = None if brake is None else np.minimum(np.maximum(brake, 0.0), 1.0)
        for event in command.events:
            if self.active[event.robot]:
                self.events[event.robot].append(event)

    def _senses(self, state: State) -> Onboard | None:
        """The robots' own sensors; None where they are told the truth."""
        first = self.scenarios[0]
        if first.sensing.kind != "onboard":
            return None
        from omnitrack_sim.sim.onboard import Onboard

        limits = self.motors.torque_limit[:, 0]
        return Onboard(self.scenarios, state, limits, self.legs, self.period)

    def _made_sights(self) -> Sequence[Sight | None]:
        """What tells each robot that explores what is ahead; None for those that do not."""
        explorations = [scenario.exploration for scenario in self.scenarios]
        true = [None if e is None else e.sight() for e in explorations]
        if self.onboard is None or explorations[0] is None:
            return true
        from omnitrack_sim.autonomy.camera_sight import CameraSight

        first, bore = self.scenarios[0].sensing, self.legs.bore_ahead
        return [JudgedSight(CameraSight(self.onboard.eyes, first, bore), true)] * self.n

    def _keep_picture(self) -> None:
        """Keep the picture of this moment, where one was taken and pictures are recorded."""
        assert self.onboard is not None
        if self.album is not None and self.onboard.whole is not None:
            picture, end = self.onboard.whole
            self.album.add(self._readings["time"], end, picture, self.active)

    def _find(self) -> None:
        """Find the robots on their routes, and where they take themselves to be."""
        legs, readings = self.legs, self._readings
        self._location = self._locate(readings, self._near)
        self._near = self._location.distance
        self._believed = self._location
        if self.onboard is not None:
            self._believed = self.onboard.location(
                self._locate(self.onboard.readings, self.onboard.near(legs.near, legs.route))
            )
        legs.seen_at(self._believed.distance)

    def _locate(self, readings: Mapping[str, Array], near: Array) -> Location:
        legs = self.legs
        frames = heading(readings["rotation"], legs.gear)
        return legs.routes.locate(readings["position"], frames, legs.route, near)

    def _settle(self) -> None:
        """Judge where the robots are now, send on who is due, record."""
        self._average(np.ones(self.n, bool))
        self._look_ahead()
        verdicts = self.monitor.look(
            self._readings,
            self._believed,
            self._believed.distance >= self.legs.end,
            self._resting,
            self.plant.diverged,
        )
        if np.count_nonzero(self._gave_up):
            lost = np.flatnonzero(self._gave_up).tolist()
            verdicts = [*(Verdict(robot, Outcome.LOST) for robot in lost), *verdicts]
        if np.count_nonzero(self._over):
            ended = np.flatnonzero(self._over).tolist()
            verdicts += [Verdict(robot, Outcome.ENDED) for robot in ended]
        if verdicts:
            self._dispatch(verdicts)
        if self.onboard is not None:
            self._end_those_outside()
        if self._recording and (self._tick % self._record_every == 0 or not self.active.any()):
            self._record()

    def _average(self, robots: NDArray[np.bool_]) -> None:
        """Let the monitor have a sample of those of ``robots`` (n,) whose turn it is."""
        due = robots & ((self._tick - self._begun) % self._record_every == 0)
        if np.count_nonzero(due):
            self.monitor.average(self._readings, self._belt_command, self.motors.saturated, due)

    def _end_those_outside(self) -> None:
        """End the runs of robots that are in no pipe of their network, whatever they believe."""
        outside = self.monitor.outside(self._location) & self.active
        for robot in np.flatnonzero(outside).tolist() if np.count_nonzero(outside) else ():
            if not self.legs.in_a_pipe(
                robot,
                self._readings["position"][robot],
                self._readings["rotation"][robot, :, 2],
            ):
                self._end(robot, Outcome.LEFT_PIPE, float(self.time[robot]))

    def _dispatch(self, verdicts: Sequence[Verdict]) -> None:
        """Send robots that have arrived, hang, or have fallen off their way onto their next legs;
        end the runs of others."""
        location, sent = self._location, set[int]()
        for robot, outcome in verdicts:
            if robot in sent or not self.active[robot]:
                continue
            onward = self._onward(robot, outcome)
            self.events[robot] += onward.events
            if onward.leg is not None:
                sent.add(robot)
                self._give_time(robot, onward)
                continue
            if outcome is Outcome.LEFT_PIPE and self.onboard is not None:
                self.onboard.localiser.doubt(robot)
                continue
            time = float(self.time[robot])
            self._end(robot, outcome or self.monitor.cause(robot, location), time)
        self._find_again(sent)

    def _look_ahead(self) -> None:
        """Let robots that explore, and have come to where they want to look ahead, do so."""
        looking = (self._believed.distance >= self.legs.look_at) & self.active
        if not np.count_nonzero(looking):
            return
        if self.onboard is not None and not self.onboard.takes_pictures:
            return
        told = self._readings if self.onboard is None else self.onboard.readings
        gear = self.legs.gear
        true, frames = (heading(r["rotation"], gear) for r in (self._readings, told))
        back = heading(self._readings["rotation"], -gear)
        turned = true if self.onboard is None else heading(self.onboard.turned, gear)
        for robot in np.flatnonzero(looking).tolist():
            sight = self.sights[robot]
            assert sight is not None
            position, behind = self._readings["position"][robot], None
            ahead = sight.look(robot, position, true[robot])
            time, distance = float(self.time[robot]), float(self._believed.distance[robot])
            if self.legs.looks_back(robot, distance):
                behind = sight.look(robot, position, back[robot])
            look = Look(time, distance, ahead, behind, frames[robot], turned[robot])
            onward = self.legs.see(robot, look)
            if onward.shift and self.onboard is not None:
                self.onboard.shift(robot, self._believed, onward.shift)
            self.events[robot] += onward.events
            self._give_time(robot, onward)
        self._find_again(np.flatnonzero(looking).tolist())

    def _give_time(self, robot: int, onward: Onward) -> None:
        """Let the monitor know what a robot does from now on."""
        scenario = self.scenarios[robot]
        if onward.goes_on:
            more = scenario.time_for(max(onward.more, 0.0)) - scenario.time_for(0.0)
            self.monitor.goes_on(robot, more)
        else:
            length = float(self.legs.routes.lengths[self.legs.route[robot]])
            self.monitor.sent_on(robot, scenario.time_for(length))

    def _find_again(self, robots: Collection[int]) -> None:
        """Find robots on their routes that are on another one now."""
        if robots:
            if self.onboard is not None:
                self.onboard.learn(robots, self._believed)
            again = np.isin(np.arange(self.n), list(robots))
            self._near = np.where(again, self.legs.near, self._near)
            self._find()

    def _onward(self, robot: int, outcome: Outcome | None) -> Onward:
        """Put a robot onto the leg that a verdict asks for, where there is one."""
        time, readings = float(self.time[robot]), self._readings
        if outcome is Outcome.LEFT_PIPE:
            told = readings if self.onboard is None else self.onboard.readings
            axis = told["rotation"][robot, :, 2]
            return self.legs.plan_anew(robot, time, told["position"][robot], axis)
        if outcome in (None, Outcome.REACHED_GOAL):
            distance = float(self._believed.distance[robot])
            if outcome is None and self._believed.distance_std is not None:
                # Belts that slip before an obstacle push the estimate into it.
                distance -= 2 * float(self._believed.distance_std[robot])
            half = self.scenarios[robot].robot.length / 2 * self.legs.gear[robot]
            nose = readings["position"][robot] + half * readings["rotation"][robot, :, 2]
            return self.legs.send_on(robot, time, distance, outcome is not None, nose)
        return Onward(None, ())

    def _end(self, robot: int, outcome: Outcome, time: float) -> None:
        reason = self.monitor.reason(robot, self._location, float(self.legs.end[robot]), time)
        missed = self.legs.missed(robot)
        if outcome is Outcome.REACHED_GOAL and self._elsewhere(robot):
            outcome, reason = Outcome.LOST, f"took itself to be at the goal; {reason}"
        if outcome is Outcome.REACHED_GOAL and missed:
            outcome, reason = Outcome.STUCK, f"no way to {', '.join(missed)} is left; {reason}"
        self.endings[robot] = Ending(outcome, reason)
        self.active = self.active.copy()
        self.active[robot], self.end_time[robot] = False, time

    def _elsewhere(self, robot: int) -> bool:
        """Whether a robot that takes itself to be at the end of its leg is not there."""
        exploration = self.scenarios[robot].exploration
        if exploration is not None:
            if exploration.mission.task == "find":
                return False  # that it has found its goals is known from where it truly was
            axis = self._readings["rotation"][robot, :, 2]
            return not exploration.is_home(self._readings["position"][robot], axis)
        missing = float(self.legs.end[robot] - self._location.distance[robot])
        return abs(missing) > self.scenarios[robot].robot.nominal_pipe_radius and (
            self.onboard is not None
        )

    def _record(self) -> None:
        location, legs = self._location, self.legs
        if self._phase.max() >= len(self.phases):
            raise ValueError(f"command.phase is {self._phase.max()}; phases are {self.phases}")
        self.recorder.sample(
            self.plant.qpos,
            {
                **{name: self._readings[name] for name in self._measured},
                "leg": legs.number,
                "gear": legs.gear,
                "distance": location.distance,
                "offset": location.offset,
                "tilt": location.tilt,
                "theta5": location.theta5,
                "phase": self._phase,
                "belt_speed_command": self._belt_command,
                "roll_command": self._roll_command,
                **({} if self.onboard is None else self.onboard.estimates(self._believed)),
            },
        )

    def _report(self, progress: Progress) -> None:
        part = np.clip(self._location.distance / self.legs.end, 0, 1)
        part = np.where(self.active, part, 1.0)
        running = np.flatnonzero(self.active)
        if len(running) == 0:
            return
        phase = self.phases[self._phase[running[0]]]
        text = phase if self.n == 1 else f"{len(running)} of {self.n} running"
        progress(float(part.mean()), text)

    def results(
        self, no_load_slip: Sequence[float] | None = None, metrics: Sequence[Metric] = ()
    ) -> list[Result]:
        """One result a robot, after all runs are over.

        Args:
            no_load_slip: (n,) m/s, what slip reads without load; see ``run.no_load_slips``. Without
                it ``no_load_slip_m_s`` is not a number.
            metrics: further ones beside the shipped.

        Raises:
            RuntimeError: a robot still runs, or nothing was recorded.
        """
        if not self._recording:
            raise RuntimeError("nothing was recorded")
        if self.active.any():
            raise RuntimeError(f"{int(self.active.sum())} of {self.n} robots still run")
        metrics = check_all(Metric, "metrics", metrics)
        taken = {*METRIC_NAMES, *(metric.name for metric in self.scenarios[0].own_metrics)}
        refuse_taken("metrics", [metric.name for metric in metrics], taken)
        return gathered(self, no_load_slip, metrics)
